//! Takes with one fault each, made from a body that walks.

use super::*;
use ndarray::Array2;

const FRAMES: usize = 240;

/// Ten points of a body that walks and swings, 120 frames a second.
fn walk() -> Poses {
    let points: Vec<String> = (0..10).map(|p| format!("p{p}")).collect();
    let xyz = Array2::from_shape_fn((FRAMES, 30), |(t, c)| {
        let (p, axis, time) = (c / 3, c % 3, t as f64 / 120.0);
        let swing = 8.0 * (6.0 * time + p as f64).sin();
        match axis {
            0 => 5.0 * p as f64 % 15.0 + 0.3 * swing + 1.0,
            1 => 18.0 * p as f64 + 5.0,
            _ => 120.0 * time + 0.3 * swing,
        }
    });
    Poses {
        points,
        xyz,
        time: Some((0..FRAMES).map(|t| t as f64 / 120.0).collect()),
        take: None,
    }
}

fn found(poses: &Poses) -> Vec<(FindingKind, Vec<String>)> {
    let takes = audit(poses, None, &Limits::default());
    let findings = takes[0].findings.iter();
    findings.map(|f| (f.kind, f.points.clone())).collect()
}

fn only(kind: FindingKind, points: &[&str]) -> Vec<(FindingKind, Vec<String>)> {
    vec![(kind, points.iter().map(|p| p.to_string()).collect())]
}

#[test]
fn a_sound_take_has_no_findings() {
    assert_eq!(found(&walk()), []);
}

#[test]
fn a_wrong_unit_or_axis_or_rate_is_found() {
    let mut poses = walk();
    poses.xyz *= 0.01;
    assert_eq!(found(&poses), only(FindingKind::Unit, &[]));
    let mut poses = walk();
    for mut row in poses.xyz.rows_mut() {
        (0..10).for_each(|p| row.swap(3 * p + 1, 3 * p + 2));
    }
    assert_eq!(found(&poses), only(FindingKind::UpAxis, &[]));
    let mut poses = walk();
    poses.time = poses.time.map(|t| t.iter().map(|t| t / 20.0).collect());
    let kinds: Vec<FindingKind> = found(&poses).iter().map(|f| f.0).collect();
    assert!(kinds.contains(&FindingKind::Rate), "{kinds:?}");
}

/// CMU's rest pose that walks, knees bent and hands down.
fn person() -> Poses {
    use crate::pose::joints::{CMU_REST, cmu_names};
    let mut poses = walk();
    poses.points = cmu_names();
    poses.xyz = Array2::from_shape_fn((FRAMES, 69), |(t, c)| {
        let (p, time) = (c / 3, t as f64 / 120.0);
        let [x, y, z] = CMU_REST[p];
        let hand = [17, 18, 21, 22].contains(&p);
        let knee = [2, 6].contains(&p);
        match c % 3 {
            0 => {
                if hand {
                    0.3 * x
                } else {
                    x
                }
            }
            1 => 92.0 + if hand { y - 45.0 } else { y },
            _ => z + 120.0 * time + if knee { 8.0 } else { 0.0 },
        }
    });
    poses
}

#[test]
fn a_body_upside_down_on_its_side_or_mirrored_is_found() {
    let turned = |turn: fn([f64; 3]) -> [f64; 3]| {
        let mut poses = person();
        for mut row in poses.xyz.rows_mut() {
            for mut at in row.exact_chunks_mut(3) {
                let to = turn([at[0], at[1], at[2]]);
                (0..3).for_each(|c| at[c] = to[c]);
            }
        }
        found(&poses)
    };
    assert_eq!(turned(|at| at), []);
    assert_eq!(
        turned(|[x, y, z]| [x, -y, -z]),
        only(FindingKind::UpAxis, &[])
    );
    assert_eq!(
        turned(|[x, y, z]| [x, -z, y]),
        only(FindingKind::UpAxis, &[])
    );
    assert_eq!(
        turned(|[x, y, z]| [-x, y, z]),
        only(FindingKind::Mirrored, &[])
    );
}

#[test]
fn gaps_and_zeros_are_found() {
    let mut poses = walk();
    poses.xyz.slice_mut(s![20..100, 9..12]).fill(f64::NAN);
    assert_eq!(found(&poses), only(FindingKind::LongGap, &["p3"]));
    let mut poses = walk();
    (0..4).for_each(|k| {
        poses
            .xyz
            .slice_mut(s![50 * k..50 * k + 8, 9..12])
            .fill(f64::NAN)
    });
    assert_eq!(found(&poses), only(FindingKind::Missing, &["p3"]));
    let mut poses = walk();
    poses.xyz.slice_mut(s![20..60, 9..12]).fill(0.0);
    let kinds: Vec<FindingKind> = found(&poses).iter().map(|f| f.0).collect();
    assert!(kinds.contains(&FindingKind::Zeros), "{kinds:?}");
    let mut poses = walk();
    poses.xyz.slice_mut(s![.., ..15]).fill(0.0);
    let zeros = found(&poses)
        .into_iter()
        .filter(|f| f.0 == FindingKind::Zeros);
    assert_eq!(zeros.map(|f| f.1.len()).collect::<Vec<_>>(), [5]);
}

#[test]
fn swaps_jumps_held_and_fallen_points_are_found() {
    let mut poses = walk();
    for mut row in poses.xyz.rows_mut().into_iter().skip(100) {
        (0..3).for_each(|c| row.swap(12 + c, 15 + c));
    }
    let swapped = found(&poses);
    assert!(
        swapped.contains(&only(FindingKind::Swap, &["p4", "p5"])[0]),
        "{swapped:?}"
    );
    let mut poses = walk();
    poses.xyz[[60, 13]] += 40.0;
    assert_eq!(found(&poses), only(FindingKind::Jump, &["p4"]));
    let mut poses = walk();
    let last = poses.xyz.slice(s![80, 6..9]).to_owned();
    for t in 81..130 {
        poses.xyz.slice_mut(s![t, 6..9]).assign(&last);
    }
    let held = found(&poses);
    assert!(
        held.contains(&only(FindingKind::Held, &["p2"])[0]),
        "{held:?}"
    );
    let mut poses = walk();
    for t in 150..FRAMES {
        let floor = [30.0 + 1e-4 * (t % 7) as f64, 0.5, 10.0];
        (0..3).for_each(|c| poses.xyz[[t, 6 + c]] = floor[c]);
    }
    let fallen = found(&poses);
    assert!(
        fallen.contains(&only(FindingKind::Fallen, &["p2"])[0]),
        "{fallen:?}"
    );
}

#[test]
fn distances_that_drift_are_found() {
    let mut poses = walk();
    for t in 0..FRAMES {
        poses.xyz[[t, 28]] += 6.0 * t as f64 / FRAMES as f64;
    }
    let drifting = found(&poses);
    assert!(
        drifting.iter().all(|f| f.0 == FindingKind::Drift),
        "{drifting:?}"
    );
    assert!(
        drifting.iter().any(|f| f.1.contains(&"p9".to_string())),
        "{drifting:?}"
    );
}

#[test]
fn faults_are_found_among_many_points_too() {
    let body = walk();
    let bodies = 60;
    let mut poses = Poses {
        points: (0..10 * bodies).map(|p| format!("p{p}")).collect(),
        xyz: Array2::from_shape_fn((FRAMES, 30 * bodies), |(t, c)| {
            let beside = if c % 3 == 0 {
                300.0 * (c / 30) as f64
            } else {
                0.0
            };
            body.xyz[[t, c % 30]] + beside
        }),
        ..body
    };
    for mut row in poses.xyz.rows_mut().into_iter().skip(100) {
        (0..3).for_each(|c| row.swap(12 + c, 15 + c));
    }
    let last = poses.xyz.slice(s![80, 336..339]).to_owned();
    for t in 81..130 {
        poses.xyz.slice_mut(s![t, 336..339]).assign(&last);
    }
    for t in 150..FRAMES {
        let floor = [30.0 + 1e-4 * (t % 7) as f64, 0.5, 10.0];
        (0..3).for_each(|c| poses.xyz[[t, 606 + c]] = floor[c]);
    }
    for t in 0..FRAMES {
        poses.xyz[[t, 928]] += 6.0 * t as f64 / FRAMES as f64;
    }
    let found = found(&poses);
    for (kind, points) in [
        (FindingKind::Swap, &["p4", "p5"][..]),
        (FindingKind::Held, &["p112"]),
        (FindingKind::Fallen, &["p202"]),
    ] {
        assert!(found.contains(&only(kind, points)[0]), "{found:?}");
    }
    let is_drift = |f: &(FindingKind, Vec<String>)| f.0 == FindingKind::Drift;
    assert!(
        found
            .iter()
            .filter(|f| is_drift(f))
            .any(|f| f.1.contains(&"p309".to_string()))
    );
}
