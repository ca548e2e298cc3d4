//! ground: takes on a level floor, with feet that stand.

use crate::common::{command, fails, run, text};
use glam::{DMat3, DVec3};
use posing::io::Bvh;
use posing::pose::Poses;
use posing::pose::rotation::{Axis, decompose, shortest_arc};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Frames per second, and frames.
const RATE: f64 = 60.0;
const FRAMES: usize = 420;
/// Joints below the hips: name, parent, offset; and End Sites.
const JOINTS: [(&str, usize, [f64; 3]); 17] = [
    ("Hips", 0, [0.0; 3]),
    ("LeftUpLeg", 0, [9.0, 0.0, 0.0]),
    ("LeftLeg", 1, [0.0, -42.0, 0.0]),
    ("LeftFoot", 2, [0.0, -40.0, 0.0]),
    ("LeftToeBase", 3, [0.0, -8.0, 13.0]),
    ("RightUpLeg", 0, [-9.0, 0.0, 0.0]),
    ("RightLeg", 5, [0.0, -42.0, 0.0]),
    ("RightFoot", 6, [0.0, -40.0, 0.0]),
    ("RightToeBase", 7, [0.0, -8.0, 13.0]),
    ("Spine", 0, [0.0, 12.0, 0.0]),
    ("Neck", 9, [0.0, 40.0, 0.0]),
    ("LeftArm", 9, [18.0, 36.0, 0.0]),
    ("LeftForeArm", 11, [28.0, 0.0, 0.0]),
    ("LeftHand", 12, [25.0, 0.0, 0.0]),
    ("RightArm", 9, [-18.0, 36.0, 0.0]),
    ("RightForeArm", 14, [-28.0, 0.0, 0.0]),
    ("RightHand", 15, [-25.0, 0.0, 0.0]),
];

/// What is odd about a walk on a ring.
#[derive(Clone, Copy, Default)]
struct Odd {
    lower: f64,
    /// About z, degrees.
    tilt: f64,
    /// Over the take, cm.
    sink: f64,
    /// Of feet that stand, cm/s.
    slide: f64,
    /// How much higher each step is than the one before, cm.
    rise: f64,
    /// Of the whole body through the air, cm/s.
    flight: f64,
}

/// How far along the ring, radians, a foot of a side stands that stands at a time, or swings; how
/// high it is, and how far aside it slides. It stands for six tenths of each second.
fn foot(side: usize, t: f64, odd: &Odd) -> (f64, DVec3) {
    let phase = t + 0.5 * side as f64 + 1e-9;
    let (step, share) = (phase.floor(), phase.fract());
    let swing = ((share - 0.6) / 0.4).max(0.0);
    let eased = swing.powi(3) * (10.0 - 15.0 * swing + 6.0 * swing * swing);
    let angle = 0.45 * (step - 0.5 * side as f64 + 0.3 + eased);
    let slid = if swing > 0.0 {
        0.3 - 0.6 * eased
    } else {
        share - 0.3
    };
    let stairs = odd.rise * (2.0 * (step + eased) - side as f64);
    let lift = 160.0 * swing * swing * (1.0 - swing);
    (angle, DVec3::new(odd.slide * slid, stairs + lift, 0.0))
}

/// Whether a foot has stood for two frames, and will.
fn stands(side: usize, frame: usize) -> bool {
    let share = (frame as f64 / RATE + 0.5 * side as f64).fract();
    (0.04..0.56).contains(&share)
}

/// The rotations of all joints in the world in a frame, and where the hips are.
fn pose(frame: usize, odd: &Odd) -> (DVec3, Vec<DMat3>) {
    let t = frame as f64 / RATE;
    let ring = |angle: f64, far: f64| DVec3::new(far * angle.cos(), 0.0, far * angle.sin());
    let hips = ring(0.45 * t, 200.0) + DVec3::Y * (78.0 + odd.rise * (2.0 * t - 0.6));
    let facing = DMat3::from_rotation_y(-0.45 * t);
    let mut turns = vec![facing; JOINTS.len()];
    for side in 0..2 {
        let (angle, moved) = foot(side, t, odd);
        let ankle = ring(angle, [209.0, 191.0][side]) + moved + 8.0 * DVec3::Y;
        let first = 1 + 4 * side;
        let hip = hips + facing * DVec3::from_array(JOINTS[first].2);
        let (way, [a, b]) = (ankle - hip, [42.0, 40.0]);
        let far = way.length();
        let along = (a * a + far * far - b * b) / (2.0 * far);
        let ahead = (facing * DVec3::Z).reject_from(way).normalize();
        let knee = hip + along * way / far + (a * a - along * along).max(0.0).sqrt() * ahead;
        let bone = |from, to| shortest_arc(facing * -DVec3::Y, to - from).unwrap() * facing;
        turns[first] = bone(hip, knee);
        turns[first + 1] = bone(knee, ankle);
        let foot = DMat3::from_rotation_y(-angle);
        (turns[first + 2], turns[first + 3]) = (foot, foot);
    }
    let tilt = DMat3::from_rotation_z(odd.tilt.to_radians());
    let sunk = odd.lower + odd.sink * frame as f64 / FRAMES as f64;
    let hips = tilt * hips - sunk * DVec3::Y + odd.flight * t * DVec3::X;
    (hips, turns.into_iter().map(|turn| tilt * turn).collect())
}

/// A joint and all below it, as a BVH file has them.
fn hierarchy(joint: usize, out: &mut String) {
    let (name, _, [x, y, z]) = JOINTS[joint];
    let (kind, channels) = if joint == 0 {
        ("ROOT", "6 Xposition Yposition Zposition")
    } else {
        ("JOINT", "3")
    };
    let _ = write!(
        out,
        "{kind} {name}\n{{\nOFFSET {x} {y} {z}\nCHANNELS {channels} "
    );
    out.push_str("Zrotation Yrotation Xrotation\n");
    let below: Vec<usize> = (1..JOINTS.len())
        .filter(|j| JOINTS[*j].1 == joint)
        .collect();
    below.iter().for_each(|j| hierarchy(*j, out));
    if below.is_empty() {
        out.push_str("End Site\n{\nOFFSET 0 0 6\n}\n");
    }
    out.push_str("}\n");
}

/// The text of a walk.
fn walk(odd: Odd) -> String {
    let mut out = String::from("HIERARCHY\n");
    hierarchy(0, &mut out);
    let _ = write!(
        out,
        "MOTION\nFrames: {FRAMES}\nFrame Time: {:.8}\n",
        1.0 / RATE
    );
    let mut near = [[0.0; 3]; JOINTS.len()];
    for frame in 0..FRAMES {
        let (hips, turns) = pose(frame, &odd);
        let _ = write!(out, "{:.6} {:.6} {:.6}", hips.x, hips.y, hips.z);
        for (joint, (_, parent, _)) in JOINTS.iter().enumerate() {
            let above = if joint == 0 {
                DMat3::IDENTITY
            } else {
                turns[*parent]
            };
            let local = above.transpose() * turns[joint];
            near[joint] = decompose(&local, [Axis::Z, Axis::Y, Axis::X], near[joint]);
            let degrees = near[joint].map(f64::to_degrees);
            let _ = write!(
                out,
                " {:.6} {:.6} {:.6}",
                degrees[0], degrees[1], degrees[2]
            );
        }
        out.push('\n');
    }
    out
}

/// A walk on a sloping, sinking, low floor, over which feet slide.
const ALL: Odd = Odd {
    lower: 20.0,
    tilt: 4.0,
    sink: 30.0,
    slide: 4.0,
    rise: 0.0,
    flight: 0.0,
};

fn poses(text: &str) -> Poses {
    let bvh = Bvh::from_bytes("t.bvh", text.as_bytes().to_vec()).unwrap();
    bvh.to_poses().unwrap()
}

/// The positions of a point.
fn track(poses: &Poses, name: &str) -> Vec<DVec3> {
    let point = poses.points.iter().position(|p| p == name).unwrap();
    let at = |t| DVec3::from_array([0, 1, 2].map(|c| poses.xyz[[t, 3 * point + c]]));
    (0..poses.frames()).map(at).collect()
}

/// The largest height of toes that stand, and how far they are from their mean.
fn standing(poses: &Poses) -> [f64; 2] {
    let (mut height, mut slide) = (0.0, 0.0);
    for (side, name) in ["LeftToeBase", "RightToeBase"].into_iter().enumerate() {
        let track = track(poses, name);
        let mut stance: Vec<DVec3> = Vec::new();
        for frame in 0..=FRAMES {
            if frame < FRAMES && stands(side, frame) {
                stance.push(track[frame]);
                continue;
            }
            let mean = stance.iter().sum::<DVec3>() / stance.len() as f64;
            for at in stance.drain(..) {
                height = f64::max(height, at.y.abs());
                slide = f64::max(slide, at.distance(mean));
            }
        }
    }
    [height, slide]
}

/// Writes a file, grounds it, and gives the result, the last line of standard error and the exit
/// code.
fn grounded(folder: &Path, input: &str, flags: &[&str]) -> (String, String, i32) {
    let [file, out] = ["in.bvh", "out.bvh"].map(|name| folder.join(name));
    fs::write(&file, input).unwrap();
    let done = command("ground")
        .args(flags)
        .arg(&file)
        .arg("-o")
        .arg(&out)
        .output()
        .unwrap();
    assert_eq!(fs::read_to_string(&file).unwrap(), input);
    let said = String::from_utf8(done.stderr).unwrap();
    let last = said.lines().last().unwrap_or_default().to_string();
    (
        fs::read_to_string(&out).unwrap(),
        last,
        done.status.code().unwrap(),
    )
}

#[test]
fn a_walk_comes_onto_its_floor_and_feet_stand() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("r.json");
    let flags = ["--report", text(&report)];
    let (out, said, code) = grounded(folder.path(), &walk(ALL), &flags);
    assert_eq!(code, 0, "{said}");
    let [before, after] = [walk(ALL), out.clone()].map(|text| standing(&poses(&text)));
    assert!(before[0] > 20.0 && before[1] > 1.0, "{before:?}");
    assert!(after[0] <= 0.2 && after[1] <= 0.1, "{after:?}: {said}");
    // The rest of the body is where it was without damage, but for where the floor is and the pivot.
    let (truth, found) = (poses(&walk(Odd::default())), poses(&out));
    let [truth, found] = [truth, found].map(|poses| {
        let [hand, hips] = ["LeftHand", "Hips"].map(|name| track(&poses, name));
        (0..FRAMES).map(|t| hand[t] - hips[t]).collect::<Vec<_>>()
    });
    let far = (0..FRAMES).map(|t| truth[t].distance(found[t]));
    assert!(far.fold(0.0, f64::max) <= 0.3);
    let report: Value = serde_json::from_str(&fs::read_to_string(report).unwrap()).unwrap();
    let floor = |name: &str| report["floor"][name].as_f64().unwrap();
    assert!((floor("slope") - 4.0).abs() <= 0.05 && (floor("direction").abs() - 90.0).abs() <= 1.0);
    assert!((floor("sinking") - 30.0 * 60.0 * RATE / FRAMES as f64).abs() <= 3.0);
    assert!((floor("height") + 20.0).abs() <= 1.0 && floor("sole") == 0.0);
    let contacts = report["contacts"].as_array().unwrap();
    let right = contacts
        .iter()
        .find(|c| c["foot"] == "right" && c["start"].as_f64() > Some(0.2));
    let right = right.unwrap();
    assert!(
        (right["start"].as_f64().unwrap() - 0.5).abs() <= 0.05,
        "{right}"
    );
    assert!(
        (right["end"].as_f64().unwrap() - 1.1).abs() <= 0.05,
        "{right}"
    );
    assert!((13..=15).contains(&contacts.len()) && report["held"].as_u64() > Some(12));
}

#[test]
fn level_only_turns_and_moves_the_root_alone() {
    let folder = tempfile::tempdir().unwrap();
    let input = walk(ALL);
    let (out, said, code) = grounded(folder.path(), &input, &["--level-only"]);
    assert_eq!(code, 0, "{said}");
    let rest = |text: &str| -> Vec<String> {
        let rows = text
            .lines()
            .skip_while(|line| !line.starts_with("Frame Time"))
            .skip(1);
        let others = |row: &str| row.split(' ').skip(6).map(String::from).collect::<Vec<_>>();
        rows.flat_map(others).collect()
    };
    assert_eq!(rest(&out), rest(&input));
    let [height, slide] = standing(&poses(&out));
    assert!(height <= 0.1 && slide > 1.0);
}

#[test]
fn a_sound_take_keeps_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let input = walk(Odd::default());
    let (out, said, code) = grounded(folder.path(), &input, &[]);
    assert!(code == 0 && out == input, "{said}");
    // As a table, too, and through pipes.
    let table = run("bvh2xyz", &["-q"], &input);
    assert_eq!(run("ground", &["-q", "-"], &table), table);
}

#[test]
fn who_never_stands_or_climbs_is_told_and_left() {
    let folder = tempfile::tempdir().unwrap();
    let flight = Odd {
        flight: 300.0,
        ..Odd::default()
    };
    let stairs = Odd {
        rise: 18.0,
        ..Odd::default()
    };
    for (odd, why) in [(flight, "never stands"), (stairs, "several heights")] {
        let input = walk(odd);
        let (out, said, code) = grounded(folder.path(), &input, &[]);
        assert!(
            code == 3 && out == input && said.contains(why),
            "{code}: {said}"
        );
        let (_, quiet, _) = grounded(folder.path(), &input, &["-q"]);
        assert!(quiet.is_empty());
    }
}

#[test]
fn tables_are_leveled_and_their_feet_not_held() {
    let folder = tempfile::tempdir().unwrap();
    let table = run("bvh2xyz", &["-q"], &walk(ALL));
    let [file, out] = ["in.csv", "out.csv"].map(|name| folder.path().join(name));
    fs::write(&file, &table).unwrap();
    let done = command("ground")
        .arg(&file)
        .arg("-o")
        .arg(&out)
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(said.contains("leveled alone"), "{said}");
    let rows = fs::read_to_string(&out).unwrap();
    let heights = rows
        .lines()
        .skip(1)
        .map(|row| row.split(',').collect::<Vec<_>>());
    let title: Vec<&str> = rows.lines().next().unwrap().split(',').collect();
    let toe = title.iter().position(|t| *t == "LeftToeBase.y").unwrap();
    let of_stance = heights.enumerate().filter(|(frame, _)| stands(0, *frame));
    let far = of_stance.map(|(_, row)| row[toe].parse::<f64>().unwrap().abs());
    assert!(far.fold(0.0, f64::max) <= 0.1);
    // Nothing is called as a foot is.
    let nameless = table.replace("Foot", "A").replace("Toe", "B");
    let said = fails("ground", &["-", "-o", text(&out)], nameless.as_bytes(), 1);
    assert!(said.contains("no point is called as of a foot"), "{said}");
}

#[test]
fn missing_values_stay_missing_and_other_axes_and_units_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let input = walk(ALL);
    let (head, rows) = input.split_once("Frame Time").unwrap();
    let mut rows: Vec<String> = rows.lines().map(String::from).collect();
    // The left knee in a swing.
    for row in &mut rows[44..52] {
        let mut words: Vec<&str> = row.split(' ').collect();
        words[10] = "nan";
        *row = words.join(" ");
    }
    let holes = format!("{head}Frame Time{}\n", rows.join("\n"));
    let (out, said, code) = grounded(folder.path(), &holes, &[]);
    assert!(code == 0 && out.matches("nan").count() == 8, "{said}");
    let [height, slide] = standing(&poses(&out));
    assert!(height <= 0.2 && slide <= 0.3, "{height} {slide}");
    // A take of CMU: its skeleton is beside it.
    let Some(take) = crate::common::cmu("07/07_01.amc") else {
        return;
    };
    let bvh = run("ground", &["-q", "--fps", "120", text(&take)], "");
    assert!(bvh.starts_with("HIERARCHY") && poses(&bvh).frames() == 316);
}

#[test]
fn bad_takes_are_told_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.bvh");
    let whole = walk(Odd::default());
    let (head, _) = whole.split_once("MOTION").unwrap();
    let empty = format!("{head}MOTION\nFrames: 0\nFrame Time: 0.01\n");
    // Without the position of the hips.
    let (_, rows) = whole.split_once("Frame Time").unwrap();
    let rows = rows.lines().skip(1).map(|row| {
        let words: Vec<&str> = row.split(' ').skip(3).collect();
        words.join(" ") + "\n"
    });
    let rows: String = rows.collect();
    let no_root = format!("{head}MOTION\nFrames: {FRAMES}\nFrame Time: 0.01\n{rows}");
    let no_root = no_root.replace("6 Xposition Yposition Zposition", "3");
    for (input, why) in [
        (head, ""),
        (&*empty, "no frames"),
        ("", ""),
        ("words\n", ""),
        (&*no_root, "channels for position and rotation"),
    ] {
        let said = fails("ground", &["-", "-o", text(&out)], input.as_bytes(), 1);
        assert!(said.lines().count() == 1 && said.contains(why), "{said}");
        assert!(!out.exists());
    }
}

#[test]
fn a_result_never_replaces_its_take() {
    let folder = tempfile::tempdir().unwrap();
    let [file, link, hard] = ["a.bvh", "link.bvh", "b.bvh"].map(|name| folder.path().join(name));
    let input = walk(ALL);
    fs::write(&file, &input).unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    fs::hard_link(&file, &hard).unwrap();
    for flag in ["-o", "--report"] {
        for out in [&file, &link, &hard] {
            fails("ground", &[text(&file), flag, text(out)], b"", 2);
            assert_eq!(fs::read_to_string(&file).unwrap(), input);
        }
    }
}
