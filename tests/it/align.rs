//! align: recordings of one performance, in time.

use crate::common::{Numbers, command, fails, run, text};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A folder with a take of CMU as table and BVH, and the names of its files.
fn folder() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    let at = move |name: &str| at.join(name);
    let cmu = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu");
    for subject in ["07/07_01", "09/09_06"] {
        let (subject, take) = subject.split_once('/').unwrap();
        let of = |name: String| cmu.join(subject).join(name);
        let asf = of(format!("{subject}.asf"));
        let amc = of(format!("{take}.amc"));
        let out = at(&format!("{subject}.csv"));
        let flags = ["--asf", text(&asf), "--fps", "120", "-o", text(&out)];
        run("amc2xyz", &[&flags[..], &[text(&amc)]].concat(), "");
    }
    (folder, at)
}

/// Some frames of a table, with times from 0 by a rate, and an error on each number.
fn part(table: &str, frames: std::ops::Range<usize>, rate: f64) -> String {
    let mut lines = table.lines();
    let mut out = lines.next().unwrap().to_string() + "\n";
    for (t, line) in lines.enumerate().skip(frames.start).take(frames.len()) {
        let mut cells: Vec<String> = line.split(',').map(String::from).collect();
        cells[1] = ((t - frames.start) as f64 / rate).to_string();
        for (c, cell) in cells.iter_mut().enumerate().skip(2) {
            let error = 0.1 * ((t * 37 + c * 91) as f64 * 12.9898).sin();
            *cell = (cell.parse::<f64>().unwrap() + error).to_string();
        }
        out += &(cells.join(",") + "\n");
    }
    out
}

#[test]
fn columns_that_are_left_out_are_told() {
    let (_kept, at) = folder();
    let own = fs::read_to_string(at("07.csv")).unwrap();
    fs::write(at("a.csv"), part(&own, 0..250, 120.0)).unwrap();
    let b = part(&own, 40..300, 120.0);
    let noted: Vec<String> = b.lines().map(|line| format!("{line},1")).collect();
    fs::write(
        at("b.csv"),
        noted.join("\n").replacen(",1\n", ",grade\n", 1),
    )
    .unwrap();
    let told = |b: &str| {
        let done = command("align")
            .args([text(&at("a.csv")), text(&at(b))])
            .output();
        String::from_utf8(done.unwrap().stderr).unwrap()
    };
    let said = told("b.csv");
    assert!(
        said.contains("b.csv: other columns are left out: grade\n"),
        "{said}"
    );
    assert!(!told("07.csv").contains("left out"));
}

#[test]
fn a_later_recording_comes_onto_the_frames_of_the_first() {
    let (_kept, at) = folder();
    let own = fs::read_to_string(at("07.csv")).unwrap();
    fs::write(at("a.csv"), part(&own, 0..250, 120.0)).unwrap();
    fs::write(at("b.csv"), part(&own, 40..300, 120.0)).unwrap();
    let (a, b, out, json) = (at("a.csv"), at("b.csv"), at("out.csv"), at("r.json"));
    let flag = format!("--json={}", text(&json));
    let done = command("align")
        .args([text(&a), text(&b), "-o", text(&out), &flag])
        .output()
        .unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.success() && said.lines().count() == 1, "{said}");
    assert!(
        said.contains("+-") && said.contains("23 points shared"),
        "{said}"
    );
    let report: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
    let frames = report["shift_frames"].as_f64().unwrap();
    assert!((frames - 40.0).abs() < 0.1, "{report}");
    let result = Numbers::read(&fs::read_to_string(&out).unwrap());
    let own = Numbers::read(&own);
    assert_eq!(result.rows.len(), 250);
    for (t, row) in result.rows.iter().enumerate() {
        let is_there = t >= 41;
        assert!(
            t == 40 || row.iter().all(|v| v.is_finite() == is_there),
            "{t}"
        );
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 0.4;
        assert!(!is_there || row.iter().zip(&own.rows[t]).all(near), "{t}");
    }
    // With the clock of the other, and drift.
    fs::write(
        at("slow.csv"),
        part(&fs::read_to_string(at("07.csv")).unwrap(), 0..300, 120.5),
    )
    .unwrap();
    let slow = at("slow.csv");
    run(
        "align",
        &[
            "-q",
            "--drift",
            text(&a),
            text(&slow),
            "-o",
            text(&out),
            &flag,
        ],
        "",
    );
    let report: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
    let drift = report["drift"].as_f64().unwrap();
    assert!((drift - 0.5 / 120.0).abs() < 1e-3, "{report}");
}

#[test]
fn a_file_beside_itself_is_the_file() {
    let (_kept, at) = folder();
    run(
        "xyz2bvh",
        &["-q", text(&at("07.csv")), "-o", text(&at("walk.bvh"))],
        "",
    );
    for name in ["07.csv", "walk.bvh"] {
        let (file, copy) = (at(name), at("copy"));
        fs::copy(&file, &copy).unwrap();
        let out = run("align", &["-q", text(&copy), text(&file)], "");
        assert!(out.as_bytes() == fs::read(&file).unwrap(), "{name}");
    }
}

#[test]
fn rotations_come_as_rotations_with_as_many_frames() {
    let (_kept, at) = folder();
    let (table, bvh, out) = (at("07.csv"), at("walk.bvh"), at("out.bvh"));
    run("xyz2bvh", &["-q", text(&table), "-o", text(&bvh)], "");
    let (late, a) = (at("late.bvh"), at("a.csv"));
    run(
        "trim",
        &["-q", "--from", "0.5", text(&bvh), "-o", text(&late)],
        "",
    );
    let own = fs::read_to_string(&table).unwrap();
    fs::write(&a, part(&own, 0..280, 120.0)).unwrap();
    let done = command("align")
        .args([text(&a), text(&late), "-o", text(&out)])
        .output()
        .unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(
        done.status.success() && said.contains("first and last pose"),
        "{said}"
    );
    let [new, was] = [&out, &bvh].map(|file| {
        let file = fs::read_to_string(file).unwrap();
        Numbers::read(&run("bvh2xyz", &["-q"], &file)).rows
    });
    assert_eq!(new.len(), 280);
    for t in 64..276 {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 0.3;
        assert!(new[t].iter().zip(&was[t]).all(near), "{t}");
    }
    assert_eq!(new[0], new[50]);
    // Some of a rig's joints do not show that they stand where bones start; their names are enough.
    let (all, few) = (at("all.csv"), at("few.csv"));
    run("bvh2xyz", &["-q", text(&bvh), "-o", text(&all)], "");
    let some = [
        "-q",
        "--points",
        "root,ltibia,rtibia,lwrist,head",
        "--from",
        "0.25",
    ];
    run(
        "trim",
        &[&some[..], &[text(&all), "-o", text(&few)]].concat(),
        "",
    );
    let said = command("align")
        .args([text(&all), text(&few), "-o", text(&at("on.csv"))])
        .output()
        .unwrap();
    let said = String::from_utf8(said.stderr).unwrap();
    assert!(
        said.contains("30.000 frames") && said.contains("5 points"),
        "{said}"
    );
}

#[test]
fn what_shares_nothing_is_told() {
    let (_kept, at) = folder();
    let own = fs::read_to_string(at("07.csv")).unwrap();
    let (walk, run_) = (at("07.csv"), at("09.csv"));
    let out = at("out.csv");
    let said = fails(
        "align",
        &[text(&walk), text(&run_), "-o", text(&out)],
        b"",
        3,
    );
    assert!(said.contains("23 points") && !out.exists(), "{said}");
    let other = own.replacen("root.", "a.", 3);
    let names: Vec<&str> = other.lines().next().unwrap().split(',').collect();
    let renamed = names
        .iter()
        .enumerate()
        .map(|(i, name)| match name.rsplit_once('.') {
            Some((_, axis)) => format!("p{}.{axis}", (i - 2) / 3),
            None => name.to_string(),
        });
    let head = renamed.collect::<Vec<_>>().join(",");
    let nameless = other.replacen(&names.join(","), &head, 1);
    fs::write(at("other.csv"), &nameless).unwrap();
    let other = at("other.csv");
    let said = fails(
        "align",
        &[text(&walk), text(&other), "-o", text(&out)],
        b"",
        3,
    );
    assert!(said.contains("--map"), "{said}");
    // A map says which are the same.
    fs::write(
        at("map.toml"),
        "lfoot = \"p4\"\nrfoot = \"p8\"\nhead = \"p14\"\n",
    )
    .unwrap();
    let map = at("map.toml");
    let words = [
        "-q",
        "--map",
        text(&map),
        text(&walk),
        text(&other),
        "-o",
        text(&out),
    ];
    run("align", &words, "");
    assert_eq!(fs::read_to_string(&out).unwrap(), nameless);
    for (table, what) in [
        ("a.x,a.y,a.z\n1,2,3\n1,2,3\n", "--fps"),
        ("time,root.x,root.y,root.z\n0,2,3,4\n", "too few frames"),
    ] {
        fs::write(&other, table).unwrap();
        let said = fails("align", &[text(&walk), text(&other)], b"", 1);
        assert!(said.contains(what), "{said}");
    }
}
