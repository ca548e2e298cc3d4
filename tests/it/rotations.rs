//! Rotations from points, end to end: joints of other names, and what the positions leave open.

use crate::common::{Numbers, cmu, run, take, text, thin};
use std::collections::HashMap;
use std::fs;

/// A table under MediaPipe's names for the points that it has.
fn media_pipe(table: &str) -> String {
    let (head, rows) = table.split_once('\n').unwrap();
    let others = HashMap::from([
        ("hipjoint", "hip"),
        ("femur", "knee"),
        ("tibia", "ankle"),
        ("foot", "foot_index"),
        ("clavicle", "shoulder"),
        ("humerus", "elbow"),
        ("radius", "wrist"),
    ]);
    let renamed = |cell: &str| {
        let (point, axis) = cell.rsplit_once('.')?;
        let side = if point.starts_with('l') {
            "left"
        } else {
            "right"
        };
        let other = others.get(point.get(1..)?)?;
        Some(format!("{side}_{other}.{axis}"))
    };
    let cells: Vec<Option<String>> = head.split(',').map(renamed).collect();
    let keep = |line: &str| {
        let all = line.split(',').zip(&cells).enumerate();
        let kept = all.filter(|(i, (_, to))| *i < 2 || to.is_some());
        kept.map(|(_, (cell, _))| cell.to_string())
            .collect::<Vec<_>>()
            .join(",")
    };
    let first = cells.iter().flatten().cloned().collect::<Vec<_>>();
    let mut out = format!("take,time,{}\n", first.join(","));
    for row in rows.lines() {
        out += &keep(row);
        out.push('\n');
    }
    out
}

#[test]
fn named_points_become_a_body_that_stands_at_them() {
    let table = take("07", "07_01", &[]).unwrap();
    let keypoints = media_pipe(&thin(&table, 120, 1));
    let bvh = run("xyz2bvh", &["-q", "--map", "mediapipe"], &keypoints);
    assert!(bvh.contains("ROOT hips"), "{}", &bvh[..200]);
    let joints = ["left_knee", "right_wrist", "left_foot_index"];
    assert!(joints.iter().all(|j| bvh.contains(j)));
    let back = Numbers::read(&run("bvh2xyz", &["-q"], &bvh));
    let was = Numbers::read(&keypoints);
    for (k, point) in was.points.iter().enumerate() {
        let at = back.points.iter().position(|p| p == point).expect(point);
        for (a, b) in was.rows.iter().zip(&back.rows) {
            let off = (0..3).map(|c| (a[3 * k + c] - b[3 * at + c]).powi(2));
            let off = off.sum::<f64>().sqrt();
            assert!(off < 1.0, "{point}: {off}");
        }
    }
    // The rest pose is a T: arms along x, legs down.
    let offset = |joint: &str| {
        let from = bvh.find(&format!("JOINT {joint}\n")).expect(joint);
        let line = bvh[from..].lines().find(|l| l.contains("OFFSET")).unwrap();
        let numbers = line.split_whitespace().skip(1);
        numbers.map(|v| v.parse().unwrap()).collect::<Vec<f64>>()
    };
    let [arm, leg] = ["left_elbow", "right_knee"].map(offset);
    assert!(arm[0] > 20.0 && arm[1].abs() < 0.01 * arm[0]);
    assert!(leg[1] < -30.0 && leg[0].abs() < 0.01 * -leg[1]);
}

/// The angles of a bone in a take, degrees, frame by frame.
fn angles(amc: &str, bone: &str) -> Vec<Vec<f64>> {
    let lines = amc.lines().filter_map(|l| l.strip_prefix(bone));
    let lines = lines.filter(|l| l.starts_with(' '));
    lines
        .map(|l| l.split_whitespace().map(|v| v.parse().unwrap()).collect())
        .collect()
}

#[test]
fn what_positions_leave_open_follows_from_a_prior_of_ones_own() {
    let (asf, amc) = (cmu("07/07.asf").unwrap(), cmu("07/07_01.amc").unwrap());
    let folder = tempfile::tempdir().unwrap();
    let own = folder.path().join("own.npz");
    let other = cmu("09/09.asf").unwrap();
    let other = text(other.parent().unwrap()).to_string();
    run("rotations-train", &["-q", "-o", text(&own), &other], "");
    let table = take("07", "07_01", &[]).unwrap();
    let solve = |flags: &[&str]| {
        let flags = [&["-q", "--asf", text(&asf)], flags].concat();
        run("xyz2amc", &flags, &table)
    };
    let truth = fs::read_to_string(&amc).unwrap();
    let (builtin, by_own) = (solve(&[]), solve(&["--rotations", text(&own)]));
    assert_ne!(builtin, by_own);
    // Twist included: turns that positions do not show.
    for (result, most) in [(&builtin, 12.0), (&by_own, 30.0)] {
        for bone in ["lhumerus", "rfemur", "head"] {
            let (a, b) = (angles(result, bone), angles(&truth, bone));
            assert_eq!((a.len(), a[0].len()), (b.len(), b[0].len()));
            let off = a.iter().flatten().zip(b.iter().flatten());
            let mut off: Vec<f64> = off.map(|(a, b)| (a - b).abs()).collect();
            off.sort_by(f64::total_cmp);
            let median = off[off.len() / 2];
            assert!(median < most, "{bone}: {median}");
        }
    }
}
