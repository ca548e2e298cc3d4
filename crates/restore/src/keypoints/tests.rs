use super::*;
use crate::numeric::parallel;
use crate::pose::NameMap;
use crate::{Clean, Restorer};
use posing_io::{Amc, Asf, Table};
use rand_distr::{Distribution, StandardNormal};

const RATE: f64 = 30.0;
/// Names of Human3.6M, and the joints of CMU that stand for them.
const JOINTS: [[&str; 2]; 13] = [
    ["Pelvis", "root"],
    ["LHip", "lhipjoint"],
    ["LKnee", "lfemur"],
    ["LAnkle", "ltibia"],
    ["RHip", "rhipjoint"],
    ["RKnee", "rfemur"],
    ["RAnkle", "rtibia"],
    ["LShoulder", "lclavicle"],
    ["LElbow", "lhumerus"],
    ["LWrist", "lradius"],
    ["RShoulder", "rclavicle"],
    ["RElbow", "rhumerus"],
    ["RWrist", "rradius"],
];

/// A walk, 30 frames a second.
fn walk() -> Poses {
    let asf = Asf::open("../../testdata/cmu/07/07.asf").unwrap();
    let amc = Amc::open("../../testdata/cmu/07/07_01.amc", &asf).unwrap();
    let all = amc.to_poses(120.0).unwrap();
    let columns: Vec<usize> = JOINTS
        .iter()
        .map(|[_, cmu]| all.points.iter().position(|p| p == cmu).unwrap())
        .collect();
    let frames = all.frames().div_ceil(4);
    Poses {
        points: JOINTS.map(|[name, _]| name.to_string()).to_vec(),
        xyz: Array2::from_shape_fn((frames, 39), |(t, i)| {
            all.xyz[[4 * t, 3 * columns[i / 3] + i % 3]]
        }),
        time: Some((0..frames).map(|t| t as f64 / RATE).collect()),
        ..Poses::default()
    }
}

/// Noise of a coordinate, of which `lag` is that of the frame before; along z 2.5 times as much.
fn noisy(poses: &Poses, sd: f64, lag: f64) -> Poses {
    let mut rng = parallel::rng(7, 0);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut out = poses.clone();
    for i in 0..out.xyz.ncols() {
        let sd = if i % 3 == 2 { 2.5 * sd } else { sd };
        let mut noise = sd * normal();
        for t in 0..out.xyz.nrows() {
            out.xyz[[t, i]] += noise;
            noise = lag * noise + (1.0 - lag * lag).sqrt() * sd * normal();
        }
    }
    out
}

fn names(poses: &Poses) -> Vec<String> {
    NameMap::fitting(&poses.points)
        .unwrap()
        .model_names(&poses.points)
}

fn cleaned(poses: Poses) -> (Array2<f64>, Vec<Status>) {
    let model = crate::prior::builtin_model().unwrap();
    let table = Table::from_poses(poses);
    let out = Restorer::new(&model)
        .clean(&table, &Clean::default())
        .unwrap();
    let (frames, points) = (table.poses.frames(), table.poses.points.len());
    let states = (0..frames).flat_map(|t| (0..points).map(move |p| (t, p)));
    let states = states.map(|(t, p)| out.status(t, p)).collect();
    (out.xyz().to_owned(), states)
}

/// The root mean square of the differences of positions, and of their second differences.
fn errors(xyz: &Array2<f64>, truth: &Poses) -> [f64; 2] {
    let off = xyz - &truth.xyz;
    let rms = |all: Vec<f64>| (all.iter().map(|v| v * v).sum::<f64>() / all.len() as f64).sqrt();
    let second = (1..off.nrows() - 1).flat_map(|t| {
        let off = &off;
        (0..off.ncols()).map(move |i| off[[t - 1, i]] - 2.0 * off[[t, i]] + off[[t + 1, i]])
    });
    [rms(off.iter().copied().collect()), rms(second.collect())]
}

#[test]
fn lengths_tell_noise_from_motion() {
    let walk = walk();
    assert_eq!(keypoint_noise(&walk, &names(&walk)), None);
    for lag in [0.0, 0.85] {
        let found = keypoint_noise(&noisy(&walk, 1.0, lag), &names(&walk));
        assert!(found.is_some_and(|sd| sd > 0.3), "{lag}: {found:?}");
    }
    let skeleton = Skeleton::of(&names(&walk), walk.xyz.view()).unwrap();
    let lag = |lag: f64| {
        let noisy = noisy(&walk, 1.0, lag);
        skeleton.noise(noisy.xyz.view(), &noisy.runs()).unwrap().lag
    };
    assert!(lag(0.0).abs() < 0.25 && (lag(0.85) - 0.85).abs() < 0.25);
}

#[test]
fn noise_that_changes_lengths_by_much_is_noise() {
    // Somebody stands and points along the line of sight, where noise is largest.
    let walk = walk();
    let names = names(&walk);
    let mut still = walk.clone();
    let at = |name: &str| 3 * names.iter().position(|n| n == name).unwrap();
    for t in 0..still.frames() {
        (0..39).for_each(|i| still.xyz[[t, i]] = walk.xyz[[0, i]]);
        for side in ["l", "r"] {
            let shoulder = at(&format!("{side}clavicle"));
            for (joint, z) in [("humerus", 28.0), ("radius", 47.0)] {
                let own = at(&format!("{side}{joint}"));
                for axis in 0..3 {
                    let along = if axis == 2 { z } else { 0.0 };
                    still.xyz[[t, own + axis]] = still.xyz[[t, shoulder + axis]] + along;
                }
            }
        }
    }
    let found = keypoint_noise(&noisy(&still, 1.3, 0.85), &names);
    assert!(found.is_some_and(|sd| sd > 0.3), "{found:?}");
    assert_eq!(keypoint_noise(&still, &names), None);
}

#[test]
fn motion_without_noise_stays() {
    let walk = walk();
    let (xyz, states) = cleaned(walk.clone());
    assert_eq!(xyz, walk.xyz);
    assert!(states.iter().all(|s| *s == Status::Observed));
}

#[test]
fn slow_noise_goes_and_jumps_and_exchanges_with_it() {
    let walk = walk();
    let mut noisy = noisy(&walk, 1.0, 0.85);
    let [before, trembling] = errors(&noisy.xyz, &walk);
    for t in 30..36 {
        for i in 0..9 {
            noisy.xyz.swap([t, 3 + i], [t, 12 + i]);
        }
    }
    noisy.xyz[[50, 30]] += 40.0;
    (60..66).for_each(|t| (27..30).for_each(|i| noisy.xyz[[t, i]] = f64::NAN));
    let (xyz, states) = cleaned(noisy);
    let [after, left] = errors(&xyz, &walk);
    assert!(after < 0.85 * before, "{after} of {before}");
    assert!(left < 0.4 * trembling, "{left} of {trembling}");
    assert_eq!(states[50 * 13 + 10], Status::Rejected);
    assert_eq!(states[62 * 13 + 9], Status::Inferred);
}

#[test]
fn the_line_of_sight_is_where_noise_is_largest() {
    let walk = walk();
    let noisy = noisy(&walk, 1.0, 0.85);
    let axes = line_of_sight::noise_axes(noisy.xyz.view(), &noisy.runs());
    assert!(axes.z_axis.z.abs() > 0.95, "{axes}");
}

#[test]
fn feet_stand_where_they_stand() {
    // The body stands for two seconds before it goes.
    let walk = walk();
    let rows: Vec<usize> = [0; 60].into_iter().chain(0..walk.frames()).collect();
    let still = Poses {
        xyz: walk.xyz.select(ndarray::Axis(0), &rows),
        time: Some((0..rows.len()).map(|t| t as f64 / RATE).collect()),
        ..walk
    };
    let noisy = noisy(&still, 1.0, 0.85);
    let far = |xyz: &Array2<f64>| {
        let middle = point_at(xyz.view(), 25, 3);
        let all = (5..50).map(|t| point_at(xyz.view(), t, 3).distance(middle));
        all.fold(0.0, f64::max)
    };
    let before = far(&noisy.xyz);
    let after = far(&cleaned(noisy).0);
    assert!(after < 1.0 && after < before / 4.0, "{after} of {before}");
}

#[test]
fn few_frames_and_points_of_no_body_are_left() {
    let walk = walk();
    let short = noisy(&walk, 1.0, 0.85).slice(0..12);
    assert_eq!(keypoint_noise(&short, &names(&walk)), None);
    let empty = walk.slice(0..0);
    assert_eq!(keypoint_noise(&empty, &names(&walk)), None);
    let missing = Poses {
        xyz: Array2::from_elem(walk.xyz.dim(), f64::NAN),
        ..walk.clone()
    };
    assert_eq!(keypoint_noise(&missing, &names(&walk)), None);
    assert_eq!(keypoint_noise(&walk, &walk.points), None);
}

#[test]
fn keypoints_in_a_plane_are_left() {
    for axis in [0, 2] {
        let mut flat = noisy(&walk(), 1.0, 0.85);
        for i in (axis..39).step_by(3) {
            flat.xyz.column_mut(i).fill(0.0);
        }
        assert_eq!(keypoint_noise(&flat, &names(&flat)), None);
    }
}

#[test]
fn outliers_are_told_only_where_they_are_wanted() {
    let mut noisy = noisy(&walk(), 1.0, 0.85);
    noisy.xyz[[50, 30]] += 40.0;
    let model = crate::prior::builtin_model().unwrap();
    let table = Table::from_poses(noisy);
    let options = Clean {
        outliers: false,
        ..Clean::default()
    };
    let out = Restorer::new(&model).clean(&table, &options).unwrap();
    assert_eq!(out.counts().rejected, 0);
    assert_eq!(out.status(50, 10), Status::Changed);
}

#[test]
fn a_largest_deviation_that_is_given_holds_for_noisy_points_too() {
    let mut noisy = noisy(&walk(), 2.0, 0.85);
    (40..46).for_each(|t| (30..33).for_each(|i| noisy.xyz[[t, i]] = f64::NAN));
    let model = crate::prior::builtin_model().unwrap();
    let table = Table::from_poses(noisy);
    let sd_with = |max_sd: Option<f64>| {
        let options = Clean {
            max_sd,
            ..Clean::default()
        };
        let out = Restorer::new(&model).clean(&table, &options).unwrap();
        (40..46)
            .map(|t| out.sd(t, 10))
            .fold(f64::INFINITY, f64::min)
    };
    let least = sd_with(None);
    assert!(least.is_finite());
    assert!(sd_with(Some(0.95 * least)).is_nan() || sd_with(Some(0.95 * least)).is_infinite());
    assert!(sd_with(Some(3.0 * least)).is_finite());
}

#[test]
fn every_take_of_a_table_has_to_have_noise() {
    let walk = walk();
    let both = |first: &Poses| Poses {
        points: walk.points.clone(),
        xyz: ndarray::concatenate![ndarray::Axis(0), first.xyz, noisy(&walk, 1.0, 0.85).xyz],
        time: walk.time.as_ref().map(|time| [&time[..], time].concat()),
        take: Some(
            ["a", "b"]
                .map(|take| vec![take.into(); walk.frames()])
                .concat(),
        ),
    };
    assert_eq!(keypoint_noise(&both(&walk), &names(&walk)), None);
    assert!(keypoint_noise(&both(&noisy(&walk, 1.0, 0.85)), &names(&walk)).is_some());
}
