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
    let page = run(
        "plot",
        &["-q", "--fps", "30", "--to", "html", text(&input)],
        "",
    );
    assert!(page.contains("left_foot_index"));
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
    // The folder, and folders of such, are takes of clean, audit and plot too.
    let flags = [&flags[..], &["--fps", "20", "--force"]].concat();
    let at = |name: &str| folder.path().join(name);
    let clean = |input: &str, output: &str| {
        let output = at(output);
        run(
            "clean",
            &[&flags[..], &[input, "-o", text(&output)]].concat(),
            "",
        );
    };
    clean(path, "one.csv");
    clean(path, "out/");
    clean(text(folder.path()), "all/");
    for name in ["out/walk.csv", "all/walk.csv"] {
        assert_eq!(
            fs::read(at(name)).unwrap(),
            fs::read(at("one.csv")).unwrap(),
            "{name}"
        );
    }
    // The record is the same, however the path is written.
    let record = |output: &str| {
        let record = fs::read(at(&format!("{output}.json"))).unwrap();
        serde_json::from_slice::<Value>(&record).unwrap()["made_from"]["input"]["sha256"].clone()
    };
    clean(&format!("{}/../walk", path), "two.csv");
    assert!(record("one.csv").is_string());
    assert_eq!(record("one.csv"), record("two.csv"));
    // A broken frame is named, and the others are no takes of their own.
    let first = at("walk/walk_000000000007_keypoints.json");
    let whole = fs::read_to_string(&first).unwrap();
    fs::write(&first, &whole[..whole.len() / 2]).unwrap();
    let done = command("clean")
        .args(&flags)
        .args([text(folder.path()), "-o", text(&at("broken"))])
        .output()
        .unwrap();
    let said =
        String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("07_keypoints.json:1: ends early"), "{said}");
    assert!(!said.contains("--keep-whole"), "{said}");
    fs::write(&first, whole).unwrap();
    let drawn = run(
        "plot",
        &[&flags[..5], &["--fps", "20", "--to", "html", path]].concat(),
        "",
    );
    assert!(drawn.contains("MidHip"));
    let audited = command("audit")
        .args(&flags[1..7])
        .arg(path)
        .output()
        .unwrap();
    let audited = String::from_utf8_lossy(&audited.stdout).into_owned();
    assert!(audited.contains("25 points"), "{audited}");
    let said = fails("csv2xyz", &["--fps", "20", text(folder.path())], b"", 1);
    assert!(
        said.ends_with("is a directory, expected a file\n"),
        "{said}"
    );
}

/// Joints by the names of Human3.6M, and CMU's.
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

/// A walk by the names of Human3.6M, 30 frames a second, as a pose table; with noise of 1 cm, three
/// along z, most of which is that of the frame before.
fn video(is_noisy: bool) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let asf = posing::io::Asf::open(folder.join("07.asf")).unwrap();
    let amc = posing::io::Amc::open(folder.join("07_01.amc"), &asf).unwrap();
    let walk = amc.to_poses(120.0).unwrap();
    let columns = JOINTS.map(|[_, cmu]| walk.points.iter().position(|p| p == cmu).unwrap());
    let mut seed = 1_u64;
    let mut noise = || {
        let mut sum = 0.0;
        for _ in 0..12 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            sum += (seed >> 40) as f64 / (1_u64 << 24) as f64;
        }
        sum - 6.0
    };
    let mut slow = [0.0; 39];
    let titles = JOINTS.map(|[name, _]| ["x", "y", "z"].map(|axis| format!("{name}.{axis}")));
    let mut out = format!("time,{}\n", titles.concat().join(","));
    for (n, row) in walk.xyz.rows().into_iter().step_by(4).enumerate() {
        out += &format!("{:.6}", n as f64 / 30.0);
        for (i, slow) in slow.iter_mut().enumerate() {
            let sd = if i % 3 == 2 { 3.0 } else { 1.0 };
            *slow = 0.85 * *slow + 0.53 * sd * noise();
            let by = if is_noisy { *slow } else { 0.0 };
            out += &format!(",{:.4}", row[3 * columns[i / 3] + i % 3] + by);
        }
        out += "\n";
    }
    out
}

#[test]
fn keypoints_of_video_become_a_table_and_a_bvh_in_one_command() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("video.csv"), video(true)).unwrap();
    fs::write(path("sound.csv"), video(false)).unwrap();
    let clean = |input: &str, output: &str| {
        let done = command("clean")
            .args([text(&path(input)), "--solve", "-o", text(&path(output))])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stdout).into_owned()
            + &String::from_utf8_lossy(&done.stderr);
        (done.status.code(), said)
    };
    let (code, said) = clean("video.csv", "out.csv");
    assert!(matches!(code, Some(0 | 3)), "{said}");
    let numbers = |name: &str| Numbers::read(&fs::read_to_string(path(name)).unwrap());
    let (truth, input, out) = (
        numbers("sound.csv"),
        numbers("video.csv"),
        numbers("out.csv"),
    );
    assert!(out.rows.iter().flatten().all(|v| v.is_finite()));
    let error = |of: &Numbers| {
        let all = of.rows.iter().flatten().zip(truth.rows.iter().flatten());
        all.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    assert!(
        error(&out) < 0.85 * error(&input),
        "{} {}",
        error(&out),
        error(&input)
    );
    let bvh = posing::io::Bvh::open(path("out.bvh")).unwrap();
    assert_eq!(bvh.motion.nrows(), input.rows.len());
    assert!(bvh.joints.iter().any(|joint| joint.name == "LAnkle"));
    let record = fs::read_to_string(path("out.csv.json")).unwrap();
    let record: Value = serde_json::from_str(&record).unwrap();
    assert_eq!(record["solved"]["map"], "h36m");
    assert_eq!(record["solved"]["output"]["file"], "out.bvh");
    // Without noise nothing changes, and nothing is to be told.
    let (code, said) = clean("sound.csv", "same.csv");
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(
        fs::read(path("same.csv")).unwrap(),
        fs::read(path("sound.csv")).unwrap()
    );
    assert!(path("same.bvh").exists());
}

/// The points of a table twice, called `Ann:` and `Ben:`, the second a meter aside; by their names
/// in `as_called`, all if that is empty.
fn of_two(table: &Numbers, as_called: &[[&str; 2]]) -> String {
    let called = |name: &str| match as_called {
        [] => Some(name.to_string()),
        all => all
            .iter()
            .find(|[_, cmu]| *cmu == name)
            .map(|[own, _]| own.to_string()),
    };
    let points: Vec<(usize, String)> = (table.points.iter().enumerate())
        .filter_map(|(p, name)| Some((p, called(name)?)))
        .collect();
    let mut out = "time".to_string();
    for person in ["Ann", "Ben"] {
        for (_, name) in &points {
            out += &format!(",{person}:{name}.x,{person}:{name}.y,{person}:{name}.z");
        }
    }
    for (t, row) in table.rows.iter().enumerate() {
        out += &format!("\n{}", t as f64 / 120.0);
        for aside in [0.0, 100.0] {
            for (p, _) in &points {
                (0..3).for_each(|c| {
                    out += &format!(",{}", row[3 * p + c] + if c == 0 { aside } else { 0.0 });
                });
            }
        }
    }
    out + "\n"
}

#[test]
fn joints_of_any_naming_and_of_two_people_get_skeletons() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let cmu = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let (asf, amc) = (cmu.join("07.asf"), cmu.join("07_01.amc"));
    let flags = ["-q", "--fps", "120", "--asf", text(&asf), text(&amc)];
    let walk = run("amc2xyz", &flags, "");
    let table = Numbers::read(&walk);
    fs::write(path("walk.csv"), &walk).unwrap();
    fs::write(path("cmu.csv"), of_two(&table, &[])).unwrap();
    fs::write(path("video.csv"), of_two(&table, &JOINTS)).unwrap();
    // A take called as the skeleton of a person would be.
    fs::write(path("cmu-Ben.csv"), &walk).unwrap();
    let flags = [
        "-q",
        "--solve",
        "--outliers",
        "none",
        text(folder.path()),
        "-o",
    ];
    run("clean", &[&flags[..], &[text(&path("out"))]].concat(), "");
    for name in [
        "walk",
        "cmu-Ann",
        "cmu.csv-Ben",
        "cmu-Ben",
        "video-Ann",
        "video-Ben",
    ] {
        let bvh = posing::io::Bvh::open(path(&format!("out/{name}.bvh"))).unwrap();
        assert_eq!(bvh.motion.nrows(), table.rows.len(), "{name}");
    }
    // The joints of the skeleton are at the points.
    let joints = run("bvh2xyz", &["-q", text(&path("out/walk.bvh"))], "");
    let solved = Numbers::read(&joints);
    let column = |of: &Numbers, name: &str| of.points.iter().position(|p| p == name).unwrap();
    // The end of the thigh is the start of the shin.
    let (knee, shin) = (column(&table, "lfemur"), column(&solved, "ltibia"));
    for (a, b) in table.rows.iter().zip(&solved.rows) {
        let far = (0..3).map(|c| (a[3 * knee + c] - b[3 * shin + c]).powi(2));
        assert!(far.sum::<f64>().sqrt() < 0.1);
    }
}

#[test]
fn keypoints_in_folders_are_takes_and_results_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("in")).unwrap();
    write(
        &path("in/walk.json"),
        &json!({"fps": 30, "frames": frames(60)}),
    );
    write(&path("in/camera.json"), &json!([[[1, 0, 0], [0, 1, 0]]]));
    let coco = json!({"annotations": [{"keypoints": [1, 2, 2]}]});
    write(&path("in/coco.json"), &coco);
    fs::write(path("in/sound.csv"), video(false)).unwrap();
    let all = |input: &str, output: &str| {
        let paths = [path(input), path(output)];
        let flags = ["--json", "--force", text(&paths[0]), "-o", text(&paths[1])];
        let done = command("clean").args(flags).output().unwrap();
        let list: Value = serde_json::from_slice(&done.stdout).unwrap();
        let files = list["files"].as_array().unwrap();
        let name = |file: &Value| file["file"].as_str().unwrap().to_string();
        files.iter().map(name).collect::<Vec<String>>()
    };
    assert_eq!(all("in", "out"), ["sound.csv", "walk.json"]);
    // Records, lists and other JSON are no keypoints.
    let said = fails(
        "clean",
        &["-o", text(&path("again")), text(&path("out"))],
        b"",
        1,
    );
    assert!(said.contains("no files of motion in it"), "{said}");
    let audited = command("audit").arg(path("out")).output().unwrap();
    let audited = String::from_utf8_lossy(&audited.stdout).into_owned();
    assert!(!audited.contains("json"), "{audited}");
    let audited = command("audit").arg(path("in")).output().unwrap();
    let audited = String::from_utf8_lossy(&audited.stdout).into_owned();
    assert!(
        audited.contains("walk.json") && !audited.contains("camera") && !audited.contains("coco"),
        "{audited}"
    );
}
