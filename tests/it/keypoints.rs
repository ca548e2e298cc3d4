//! Keypoints of MediaPipe and OpenPose as JSON: `csv2xyz`, `clean` and `audit`.

use crate::common::{Numbers, command, fails, run, text};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// A coordinate of a moving point, meters, y down as MediaPipe's.
fn at(t: usize, p: usize, c: usize) -> f64 {
    let phase = t as f64 / 12.0 + p as f64 * 0.4 + c as f64;
    (p * (c + 2) % 7) as f64 / 5.0 - 0.6 + 0.05 * phase.sin()
}

/// Frames of world landmarks, with a wrist hidden for some of them.
fn frames(count: usize) -> Vec<Value> {
    let point = |t: usize, p: usize| {
        let is_hidden = p == 15 && (30..34).contains(&t);
        json!({"x": at(t, p, 0), "y": at(t, p, 1), "z": at(t, p, 2),
               "visibility": if is_hidden { 0.0 } else { 0.9 }})
    };
    let frame = |t| json!({"frame": t, "pose_world_landmarks": (0..33).map(|p| point(t, p)).collect::<Vec<_>>()});
    (0..count).map(frame).collect()
}

fn write(path: &Path, value: &Value) -> String {
    fs::write(path, value.to_string()).unwrap();
    text(path).to_string()
}

#[test]
fn world_landmarks_are_converted_and_cleaned() {
    let folder = tempfile::tempdir().unwrap();
    let at_path = |name: &str| folder.path().join(name);
    let json = write(&at_path("walk.json"), &json!(frames(90)));
    let done = command("csv2xyz")
        .args(["--fps", "30", &json])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(
        said.contains("in meters, y down, z away from the camera"),
        "{said}"
    );
    let table = String::from_utf8(done.stdout).unwrap();
    let read = Numbers::read(&table);
    assert_eq!((read.points.len(), &*read.points[15]), (33, "left_wrist"));
    let first = table.lines().nth(1).unwrap().split(',').nth(3).unwrap();
    assert!((first.parse::<f64>().unwrap() + 100.0 * at(0, 0, 1)).abs() < 1e-9);
    // An axis that is given goes before that of the documentation.
    let up = run("csv2xyz", &["-q", "--fps", "30", "--up", "y", &json], "");
    let up = up
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .nth(3)
        .unwrap()
        .to_string();
    assert!((up.parse::<f64>().unwrap() - 100.0 * at(0, 0, 1)).abs() < 1e-9);
    // What clean makes of the file is what it makes of its table.
    fs::write(at_path("table.csv"), &table).unwrap();
    for (input, output, flags) in [
        ("walk.json", "of-json.csv", &["--fps", "30"][..]),
        ("table.csv", "of-table.csv", &[]),
    ] {
        let (input, output) = (at_path(input), at_path(output));
        run(
            "clean",
            &[&["-q", text(&input), "-o", text(&output)], flags].concat(),
            "",
        );
    }
    let [json, table] = ["of-json.csv", "of-table.csv"].map(|name| {
        let result = fs::read_to_string(at_path(name)).unwrap();
        assert!(!result.contains(",,"), "{name}");
        Numbers::read(&result)
    });
    let (far, _) = json.far(&table);
    assert!(far <= 1e-9, "{far}");
    // The name of a result says what it is.
    let input = at_path("walk.json");
    let said = fails(
        "clean",
        &["--fps", "30", text(&input), "-o", "x.json"],
        b"",
        1,
    );
    assert!(
        said.contains("JSON is read and not written; the result is CSV, so call it .csv"),
        "{said}"
    );
    let out = at_path("out");
    run(
        "clean",
        &[
            "-q",
            "--fps",
            "30",
            text(&input),
            "-o",
            &format!("{}/", out.display()),
        ],
        "",
    );
    assert!(out.join("walk.csv").exists());
    let audited = command("audit")
        .args(["--fps", "30", text(&input)])
        .output()
        .unwrap();
    let audited = String::from_utf8_lossy(&audited.stdout).into_owned();
    assert!(audited.contains("33 points"), "{audited}");
    // Other commands name the way.
    let said = fails("complete", &["-q", text(&input)], b"", 1);
    assert!(
        said.contains("is a JSON file: csv2xyz converts keypoints"),
        "{said}"
    );
}

#[test]
fn a_folder_of_openpose_is_a_take() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk");
    fs::create_dir(&path).unwrap();
    for t in [7, 8, 10] {
        let numbers: Vec<f64> = (0..25)
            .flat_map(|p| [at(t, p, 0), at(t, p, 1), at(t, p, 2), 1.0])
            .collect();
        let frame =
            json!({"version": 1.3, "people": [{"person_id": [-1], "pose_keypoints_3d": numbers}]});
        write(&path.join(format!("walk_{t:012}_keypoints.json")), &frame);
    }
    let path = text(&path);
    let said = fails("csv2xyz", &["-q", "--fps", "20", path], b"", 1);
    assert!(
        said.contains("does not say its unit; give it with --units"),
        "{said}"
    );
    let flags = ["-q", "--units", "m", "--up", "-y"];
    let said = fails("csv2xyz", &[&flags[..], &[path]].concat(), b"", 1);
    assert!(said.contains("--fps"), "{said}");
    let table = run(
        "csv2xyz",
        &[&flags[..], &["--fps", "20", path]].concat(),
        "",
    );
    let rows: Vec<Vec<&str>> = table
        .lines()
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(
        (rows.len(), rows[0][26], rows[1][0]),
        (5, "MidHip.x", "walk")
    );
    let times: Vec<&str> = rows[1..].iter().map(|row| row[1]).collect();
    assert_eq!(times, ["0.35", "0.4", "0.45", "0.5"]);
    assert!(rows[3][2..].iter().all(|cell| cell.is_empty()));
    let said = fails("csv2xyz", &["--fps", "20", text(folder.path())], b"", 1);
    assert!(
        said.contains("is a directory, expected a file, or a folder"),
        "{said}"
    );
}
