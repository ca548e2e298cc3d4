//! Gait from C3D files to tables, and what it says of trials that lack something.

use crate::common::{command, text};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A folder with the trials of the worked case.
fn trials() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait");
    for name in ["static.c3d", "walk.c3d", "norm.json"] {
        fs::copy(case.join(name), folder.path().join(name)).unwrap();
    }
    folder
}

/// What a run says on standard error.
fn gait(folder: &Path, line: &str, code: i32) -> String {
    let out = command("gait")
        .args(line.split(' '))
        .current_dir(folder)
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(code), "{line}: {said}");
    said
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("gait.json")).unwrap()).unwrap()
}

/// The columns of a table; NaN in empty cells.
fn columns(path: &Path) -> BTreeMap<String, Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut all: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            let value = cell.parse().unwrap_or(f64::NAN);
            all.entry(name.to_string()).or_default().push(value);
        }
    }
    all
}

/// A copy of a trial with some of its bytes exchanged.
fn exchanged(folder: &Path, from: &str, to: &str, words: [&str; 2]) -> PathBuf {
    let mut bytes = fs::read(folder.join(from)).unwrap();
    let [old, new] = words.map(str::as_bytes);
    for at in 0..bytes.len() - old.len() {
        if bytes[at..].starts_with(old) {
            bytes[at..at + old.len()].copy_from_slice(new);
        }
    }
    fs::write(folder.join(to), bytes).unwrap();
    folder.join(to)
}

/// Writes a copy of the walk whose left knee's cells are changed, by the row of the table, the axis
/// and the cell; the first column of the knee.
fn with_knee(folder: &Path, to: &str, change: &dyn Fn(usize, usize, &str) -> String) -> usize {
    let mut read = command("c3d2xyz");
    let read = read.args(["-q", "walk.c3d"]).current_dir(folder);
    let text = String::from_utf8(read.output().unwrap().stdout).unwrap();
    let mut titles = text.lines().next().unwrap().split(',');
    let knee = titles.position(|title| title == "LKNE.x").unwrap();
    let row = |(row, line): (usize, &str)| {
        let cell = |(i, cell): (usize, &str)| match i.checked_sub(knee) {
            Some(axis @ 0..3) if row > 0 => change(row, axis, cell),
            _ => cell.to_string(),
        };
        let cells: Vec<String> = line.split(',').enumerate().map(cell).collect();
        cells.join(",") + "\n"
    };
    let table: String = text.lines().enumerate().map(row).collect();
    fs::write(folder.join("changed.csv"), table).unwrap();
    let into = ["-q", "changed.csv", "--into", "walk.c3d", "-o", to];
    command("xyz2c3d")
        .args(into)
        .current_dir(folder)
        .assert()
        .success();
    knee
}

const ALL: &str = "--static static.c3d walk.c3d --norm norm.json -o out";

#[test]
fn a_session_is_written_whole_and_again_the_same() {
    let folder = trials();
    let folder = folder.path();
    let before = ["static.c3d", "walk.c3d"].map(|name| fs::read(folder.join(name)).unwrap());
    assert_eq!(gait(folder, ALL, 0), "");
    let out = folder.join("out");
    let files = [
        "walk.csv",
        "walk.mot",
        "walk.sto",
        "cycles.csv",
        "gait.json",
    ];
    let first = files.map(|name| fs::read(out.join(name)).unwrap());
    gait(folder, ALL, 0);
    let second = files.map(|name| fs::read(out.join(name)).unwrap());
    assert!(first == second, "another result of a second run");
    let after = ["static.c3d", "walk.c3d"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(before == after);
    let told = report(&out);
    let trial = &told["trials"][0];
    assert_eq!(
        (&trial["name"], &trial["frames"]),
        (&"walk".into(), &246.into())
    );
    assert_eq!(trial["parameters"]["LLegLength"]["source"], "trial");
    assert_eq!(trial["findings"], Value::Array(Vec::new()));
    let table = columns(&out.join("walk.csv"));
    assert_eq!(table["time"].len(), 246);
    let knee = &table["LKneeAngles.rx"];
    let most = knee.iter().copied().fold(f64::NAN, f64::max);
    assert!((55.0..75.0).contains(&most), "{most}");
    let cycles = fs::read_to_string(out.join("cycles.csv")).unwrap();
    let own = |start: &str| {
        cycles
            .lines()
            .filter(|line| line.starts_with(start))
            .count()
    };
    assert_eq!(own("walk,left,1,"), 101);
    assert_eq!((own("walk,left,mean,,,"), own(",left,sd,,,")), (101, 101));
    let gps = told["scores"]["gps_deg"]["overall"].as_f64().unwrap();
    assert!((1.0..6.0).contains(&gps), "{gps}");
    let motion = fs::read_to_string(out.join("walk.mot")).unwrap();
    assert!(motion.starts_with("walk\nversion=1\nnRows=246\n") && motion.contains("inDegrees=yes"));
}

#[test]
fn inputs_and_files_of_others_are_not_replaced() {
    let folder = trials();
    let folder = folder.path();
    let said = gait(folder, "walk.c3d -o .", 2);
    assert!(
        said.contains("walk.c3d") && said.lines().count() == 1,
        "{said}"
    );
    fs::create_dir(folder.join("raw")).unwrap();
    fs::write(folder.join("raw/walk.c3d"), "another capture").unwrap();
    let said = gait(folder, "walk.c3d -o raw", 2);
    assert!(said.contains("no earlier run of gait wrote it"), "{said}");
    assert_eq!(
        fs::read(folder.join("raw/walk.c3d")).unwrap(),
        b"another capture"
    );
    fs::create_dir(folder.join("own")).unwrap();
    for name in ["walk.csv", "index.html", "gait.json"] {
        fs::write(folder.join("own").join(name), "mine").unwrap();
        let said = gait(folder, "walk.c3d -o own", 2);
        assert!(
            said.contains(name) && said.contains("no earlier run"),
            "{said}"
        );
        fs::remove_file(folder.join("own").join(name)).unwrap();
    }
    let said = gait(folder, "walk.c3d --make-norm static.c3d -o out", 2);
    assert!(said.contains("is no norm of gait"), "{said}");
    fs::create_dir(folder.join("b")).unwrap();
    fs::copy(folder.join("walk.c3d"), folder.join("b/walk.c3d")).unwrap();
    let said = gait(folder, "walk.c3d b/walk.c3d -o out", 2);
    assert!(said.contains("would both be written as walk"), "{said}");
    assert!(!folder.join("out").exists());
}

#[test]
fn what_is_missing_is_empty_and_told() {
    let folder = trials();
    let folder = folder.path();
    for name in ["static.c3d", "walk.c3d"] {
        exchanged(folder, name, &format!("k-{name}"), ["LKNE", "XKNE"]);
    }
    let said = gait(folder, "--static k-static.c3d k-walk.c3d -o out", 3);
    assert!(said.contains("LKNE is missing"), "{said}");
    let table = columns(&folder.join("out/k-walk.csv"));
    let is_empty = |name: &str| table[name].iter().all(|v| v.is_nan());
    assert!(
        ["LKneeAngles.rx", "LKJC.x", "LAnkleAngles.rx"]
            .into_iter()
            .all(is_empty)
    );
    assert!(!is_empty("RKneeAngles.rx") && !is_empty("LPelvisAngles.rx"));
}

#[test]
fn parameters_are_estimated_or_given_and_say_so() {
    let folder = trials();
    let folder = folder.path();
    for name in ["static.c3d", "walk.c3d"] {
        exchanged(
            folder,
            name,
            &format!("p-{name}"),
            ["PROCESSING", "XROCESSING"],
        );
    }
    let said = gait(folder, "--static p-static.c3d p-walk.c3d -o out", 3);
    assert!(said.contains("estimated from markers"), "{said}");
    let source = |told: &Value, name: &str| told["trials"][0]["parameters"][name]["source"].clone();
    let told = report(&folder.join("out"));
    assert_eq!(source(&told, "LLegLength"), "estimate");
    assert!(!columns(&folder.join("out/p-walk.csv")).contains_key("LKneeMoment.mx"));
    let given = "--parameter LegLength=850 --parameter RKneeWidth=100 --marker-diameter 16";
    gait(folder, &format!("p-walk.c3d {given} -o out"), 3);
    let told = report(&folder.join("out"));
    let sources = ["LLegLength", "RLegLength", "RKneeWidth", "MarkerDiameter"];
    assert!(sources.iter().all(|name| source(&told, name) == "option"));
    assert_eq!(source(&told, "LKneeWidth"), "estimate");
    let said = gait(folder, "p-walk.c3d --parameter Length=8 -o out", 2);
    assert!(
        said.contains("KneeWidth") && said.lines().count() == 1,
        "{said}"
    );
}

#[test]
fn other_trials_go_on_where_one_fails() {
    let folder = trials();
    let folder = folder.path();
    fs::write(folder.join("bad.c3d"), "no trial").unwrap();
    let said = gait(folder, "--static static.c3d bad.c3d walk.c3d -o out", 1);
    assert!(said.contains("bad.c3d"), "{said}");
    let told = report(&folder.join("out"));
    assert_eq!(told["failed"][0]["file"], "bad.c3d");
    assert_eq!(told["trials"].as_array().unwrap().len(), 1);
    // Earlier results stay where none of several can be computed.
    let before = fs::read(folder.join("out/gait.json")).unwrap();
    fs::copy(folder.join("bad.c3d"), folder.join("worse.c3d")).unwrap();
    gait(folder, "bad.c3d worse.c3d -o out", 1);
    assert!(before == fs::read(folder.join("out/gait.json")).unwrap());
    let said = gait(folder, "bad.c3d -o none", 1);
    assert!(
        said.lines().count() == 1 && !folder.join("none").exists(),
        "{said}"
    );
}

#[test]
fn a_norm_is_made_of_trials_and_compared_with() {
    let folder = trials();
    let folder = folder.path();
    gait(
        folder,
        "--static static.c3d walk.c3d --make-norm own.json -o out",
        0,
    );
    gait(
        folder,
        "--static static.c3d walk.c3d --norm own.json -o out",
        0,
    );
    let told = report(&folder.join("out"));
    let gps = told["scores"]["gps_deg"]["overall"].as_f64().unwrap();
    assert!(gps < 4.0, "{gps}");
    let said = gait(folder, "walk.c3d --norm walk.c3d -o out", 1);
    assert!(said.contains("is no norm of gait"), "{said}");
    let path = text(&folder.join("own.json")).to_string();
    assert!(
        fs::read_to_string(path)
            .unwrap()
            .contains("\"kind\":\"gait norm\"")
    );
}

#[test]
fn audit_tells_what_of_a_trial_cannot_be() {
    let folder = trials();
    let folder = folder.path();
    let audit = |name: &str| {
        let out = command("audit")
            .arg(name)
            .current_dir(folder)
            .output()
            .unwrap();
        let said = String::from_utf8(out.stdout).unwrap();
        said.lines()
            .filter(|line| line.trim().starts_with("gait: "))
            .count()
    };
    assert_eq!(["static.c3d", "walk.c3d"].map(audit), [0, 0]);
    exchanged(folder, "walk.c3d", "a.c3d", ["LTHI", "XXXX"]);
    exchanged(folder, "a.c3d", "b.c3d", ["LKNE", "LTHI"]);
    exchanged(folder, "b.c3d", "swapped.c3d", ["XXXX", "LKNE"]);
    assert_eq!(audit("swapped.c3d"), 1);
    let said = gait(folder, "--static static.c3d swapped.c3d -o out", 3);
    assert!(
        said.contains("LKNE is further up the leg than LTHI"),
        "{said}"
    );
}

#[test]
fn gaps_are_filled_in_memory_and_stay_in_the_file() {
    let folder = trials();
    let folder = folder.path();
    let knee = with_knee(folder, "hidden.c3d", &|row, _, cell| match row {
        120..130 => String::new(),
        _ => cell.to_string(),
    });
    let said = gait(folder, "--static static.c3d hidden.c3d --sd -o out", 0);
    assert!(said.contains("1 gap of LKNE filled, 10 frames"), "{said}");
    gait(folder, "--static static.c3d walk.c3d -o whole", 0);
    let [own, whole] = ["out/hidden.csv", "whole/walk.csv"].map(|name| columns(&folder.join(name)));
    let (sd, first) = (&own["LKneeAngles.ry.sd"], 119);
    for t in 0..sd.len() {
        let apart = (own["LKneeAngles.ry"][t] - whole["LKneeAngles.ry"][t]).abs();
        let is_filled = (first..first + 10).contains(&t);
        assert!(sd[t].is_nan() || (sd[t] > 0.0) == is_filled, "{t}");
        assert!(
            apart.is_nan() || apart < if is_filled { 2.0 } else { 1e-4 },
            "{t} {apart}"
        );
    }
    let points = command("c3d2xyz")
        .args(["-q", "out/hidden.c3d"])
        .current_dir(folder)
        .output();
    let text = String::from_utf8(points.unwrap().stdout).unwrap();
    let row: Vec<&str> = text.lines().nth(125).unwrap().split(',').collect();
    assert_eq!(row[knee], "");
    let page = fs::read_to_string(folder.join("out/index.html")).unwrap();
    assert!(page.contains("hidden.html") && page.contains("@media print"));
}

#[test]
fn folders_are_trials_and_other_markers_are_told() {
    let folder = trials();
    let folder = folder.path();
    fs::create_dir(folder.join("all")).unwrap();
    for name in ["static.c3d", "walk.c3d"] {
        fs::copy(folder.join(name), folder.join("all").join(name)).unwrap();
    }
    assert_eq!(gait(folder, "all --static all/static.c3d -o out", 0), "");
    assert_eq!(
        report(&folder.join("out"))["trials"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
    fs::create_dir(folder.join("none")).unwrap();
    assert!(gait(folder, "none -o x", 1).contains("no C3D files in it"));
    // Knees and ankles inside and outside instead of wands.
    let lower = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/biomechanist");
    let bytes = fs::read(lower.join("gait.c3d")).unwrap();
    fs::write(folder.join("other.c3d"), bytes).unwrap();
    for wand in ["LTHI", "RTHI", "LTIB", "RTIB"] {
        exchanged(
            folder,
            "other.c3d",
            "other.c3d",
            [wand, &wand.replace("T", "Q")],
        );
    }
    let said = gait(folder, "other.c3d -o bones", 3);
    assert!(said.contains("not Plug-in Gait"), "{said}");
    let told = report(&folder.join("bones"));
    assert_eq!(told["trials"][0]["model"], "not Plug-in Gait");
    let knee = &columns(&folder.join("bones/other.csv"))["LKneeAngles.rx"];
    assert!(knee.iter().copied().fold(f64::NAN, f64::max) > 40.0);
    assert!(!folder.join("bones/other.c3d").exists());
}

#[test]
fn a_marker_off_its_path_stays_and_is_doubted() {
    let folder = trials();
    let folder = folder.path();
    with_knee(folder, "spike.c3d", &|row, axis, cell| match (row, axis) {
        (120, 0) => (cell.parse::<f64>().unwrap() + 30.0).to_string(),
        _ => cell.to_string(),
    });
    let said = gait(folder, "--static static.c3d spike.c3d --sd -o out", 3);
    assert!(said.contains("LKNE leaves its path"), "{said}");
    let own = columns(&folder.join("out/spike.csv"));
    let doubted: Vec<usize> = (0..246)
        .filter(|t| own["LKneeAngles.rx.sd"][*t] > 0.0)
        .collect();
    assert_eq!(doubted, [119]);
    assert!(own["LKneeAngles.rx.sd"][119] > 10.0);
}
