//! Motion that is known over gaps of a whole body, and between key poses.

use crate::common::{Numbers, cmu, fails, run, take, text};
use serde_json::Value;
use std::path::Path;

/// A walk at 30 frames a second, and another person's.
fn walks() -> [String; 2] {
    [("07", "07_01"), ("09", "09_06")].map(|(subject, name)| {
        let table = take(subject, name, &[]).expect("a take of testdata");
        run("trim", &["-q", "--resample", "30"], &table)
    })
}

/// A library of a walk of others, at other speeds; what is known of a gap is tried on other people.
fn library(folder: &Path, walk: &str) -> String {
    let mut files = Vec::new();
    let column = walk.split(',').position(|c| c.trim() == "time").unwrap();
    for (name, pace) in [("a", 1.01), ("b", 1.04), ("c", 0.97), ("d", 1.1)] {
        let slow = |line: &str| {
            let mut cells: Vec<String> = line.split(',').map(String::from).collect();
            if let Ok(time) = cells[column].parse::<f64>() {
                cells[column] = format!("{:.6}", pace * time);
                // Others, who are smaller or larger.
                for cell in &mut cells[column + 1..] {
                    let value: f64 = cell.parse().unwrap();
                    *cell = format!("{:.6}", value * pace);
                }
            }
            cells.join(",") + "\n"
        };
        let path = folder.join(format!("{name}.csv"));
        let table: String = walk.lines().map(slow).collect();
        std::fs::write(&path, table.replace("07_01", name)).unwrap();
        files.push(path);
    }
    let library = folder.join("motion.npz");
    let mut args = vec!["-q", "--motion", "-o", text(&library)];
    args.extend(files.iter().map(|path| text(path)));
    run("prior-train", &args, "");
    text(&library).to_string()
}

/// A table without the positions of some of its rows.
fn without(table: &str, rows: std::ops::Range<usize>) -> String {
    let mut out = String::new();
    for (n, line) in table.lines().enumerate() {
        let is_hidden = n > 0 && rows.contains(&(n - 1));
        let cells: Vec<&str> = line.split(',').collect();
        let known = table
            .lines()
            .next()
            .unwrap()
            .split(',')
            .take_while(|c| !c.contains('.'));
        let keep = if is_hidden {
            known.count()
        } else {
            cells.len()
        };
        let all: Vec<&str> = (0..cells.len())
            .map(|c| if c < keep { cells[c] } else { "" })
            .collect();
        out += &(all.join(",") + "\n");
    }
    out
}

#[test]
fn a_gap_of_a_whole_body_is_filled_from_motion_that_is_alike() {
    let folder = tempfile::tempdir().unwrap();
    let [walk, other] = walks();
    let library = library(folder.path(), &walk);
    let info = run("model", &["info", &library], "");
    assert!(
        info.contains("people") && info.contains("minutes"),
        "{info}"
    );
    // The walk itself is known: its gap is filled as it was.
    let (report, rows) = (folder.path().join("r.json"), 30..45);
    let args = [
        "-q",
        "--status",
        "--report",
        text(&report),
        "--prior",
        &library,
    ];
    let whole = run("complete", &args, &without(&walk, rows.clone()));
    let plain = run("complete", &["-q"], &without(&walk, rows.clone()));
    let truth = Numbers::read(&walk);
    let off = |table: &str| {
        let found = Numbers::read(table);
        let rows = rows.clone();
        rows.map(|t| {
            let pairs = truth.rows[t].iter().zip(&found.rows[t]);
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>()
        })
        .sum::<f64>()
    };
    assert!(
        off(&whole) < 0.25 * off(&plain),
        "{} {}",
        off(&whole),
        off(&plain)
    );
    let report: Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let gap = &report["gaps"][0];
    assert_eq!(
        (&gap["method"], &gap["first_frame"]),
        (&"motion".into(), &30.into())
    );
    assert!(gap["expected"].as_f64().unwrap() < 0.7 && gap["nearest"][0]["seconds"].is_number());
    // What was measured stays, and a take without gaps is the same bytes.
    let found = Numbers::read(&whole);
    let seen = (0..truth.rows.len()).filter(|t| !rows.contains(t));
    assert!(seen.clone().all(|t| found.rows[t] == truth.rows[t]));
    let untouched = run("complete", &["-q", "--prior", &library], &other);
    assert_eq!(untouched, run("complete", &["-q"], &other));
}

#[test]
fn too_little_beside_a_gap_or_another_body_leaves_it_as_without() {
    let folder = tempfile::tempdir().unwrap();
    let [walk, other] = walks();
    let library = library(folder.path(), &walk);
    let names = other.replace("lhipjoint", "left").replace("root", "middle");
    for (table, rows) in [(other.clone(), 4..14), (names, 30..40)] {
        let gappy = without(&table, rows);
        let args = ["-q", "--self", "--prior", &library];
        assert_eq!(
            run("complete", &args, &gappy),
            run("complete", &["-q", "--self"], &gappy)
        );
    }
}

#[test]
fn what_is_no_library_or_has_no_body_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let hat = folder.path().join("hat.csv");
    std::fs::write(&hat, "time,hat.x,hat.y,hat.z\n0,1,2,3\n0.1,1,2,3\n").unwrap();
    let out = folder.path().join("m.npz");
    let said = fails(
        "prior-train",
        &["--motion", "-o", text(&out), text(&hat)],
        b"",
        1,
    );
    assert!(
        said.contains("hat.csv: has no body") && said.contains("--map"),
        "{said}"
    );
    assert!(!out.exists());
    // A folder's other files are kept.
    std::fs::write(folder.path().join("walk.csv"), &walks()[0]).unwrap();
    run(
        "prior-train",
        &["-q", "--motion", "-o", text(&out), text(folder.path())],
        "",
    );
    assert!(run("model", &["info", text(&out)], "").contains("1: 07_01"));
    let said = fails("complete", &["--prior", text(&hat)], b"", 1);
    assert!(said.contains("hat.csv"), "{said}");
    let model = folder.path().join("model.npz");
    run("model", &["save", "-o", text(&model)], "");
    let said = fails("complete", &["--prior", text(&model)], b"", 1);
    assert!(said.contains("no library of motion"), "{said}");
    let said = fails(
        "prior-train",
        &["--fps", "30", "-o", text(&out), text(&hat)],
        b"",
        2,
    );
    assert!(said.contains("--motion"), "{said}");
}

/// Every tenth row of a table.
fn keys(table: &str) -> String {
    let lines: Vec<&str> = table.lines().collect();
    let rows = lines[1..].iter().step_by(10);
    [&lines[0]]
        .into_iter()
        .chain(rows)
        .map(|l| format!("{l}\n"))
        .collect()
}

#[test]
fn motion_between_keys_leaves_them_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let [walk, _] = walks();
    let library = library(folder.path(), &walk);
    let (json, out) = (folder.path().join("j.json"), folder.path().join("o.csv"));
    let flag = format!("--json={}", text(&json));
    let keyed = keys(&walk);
    run(
        "between",
        &["-q", "--prior", &library, &flag, "-o", text(&out)],
        &keyed,
    );
    let (found, given) = (
        Numbers::read(&std::fs::read_to_string(&out).unwrap()),
        Numbers::read(&keyed),
    );
    let shift = |t: usize| found.rows[10 * t].iter().zip(&given.rows[t]);
    assert!((0..given.rows.len()).all(|t| shift(t).all(|(a, b)| (a - b).abs() < 1e-6)));
    let report: Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let spans = report["spans"].as_array().unwrap();
    assert_eq!(spans.len(), given.rows.len() - 1);
    assert!(
        spans
            .iter()
            .any(|s| s["method"] == "motion" && s["expected"].is_number())
    );
    let truth = Numbers::read(&walk);
    let linear = |t: usize, i: usize| {
        let (k, u) = (t / 10, (t % 10) as f64 / 10.0);
        let next = given.rows.get(k + 1).unwrap_or(&given.rows[k]);
        (1.0 - u) * given.rows[k][i] + u * next[i]
    };
    let (mut own, mut plain) = (0.0, 0.0);
    for (t, row) in found.rows.iter().enumerate() {
        for (i, v) in row.iter().enumerate() {
            own += (v - truth.rows[t][i]).powi(2);
            plain += (linear(t, i) - truth.rows[t][i]).powi(2);
        }
    }
    assert!(own < 0.25 * plain, "{own} {plain}");
    let said = fails(
        "between",
        &["--prior", &library, "--fps", "7"],
        keyed.as_bytes(),
        1,
    );
    assert!(
        said.contains("between two frames") && said.contains("--fps"),
        "{said}"
    );
}

#[test]
fn a_bvh_file_keeps_its_keys_and_its_rotations_follow_the_motion() {
    let folder = tempfile::tempdir().unwrap();
    let [walk, _] = walks();
    let library = library(folder.path(), &walk);
    let bvh = folder.path().join("walk.bvh");
    let skeleton = cmu("07/07.asf").unwrap();
    run(
        "xyz2bvh",
        &["-q", "--skeleton", text(&skeleton), "-o", text(&bvh)],
        &walk,
    );
    let whole = std::fs::read_to_string(&bvh).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    let first = lines
        .iter()
        .position(|l| l.starts_with("Frame Time"))
        .unwrap()
        + 1;
    // Every twelfth frame as keys.
    let rows: Vec<&str> = lines[first..].iter().step_by(12).copied().collect();
    let mut file = lines[..first - 2].join("\n");
    file += &format!(
        "\nFrames: {}\nFrame Time: 0.4\n{}\n",
        rows.len(),
        rows.join("\n")
    );
    let (keyed, out) = (
        folder.path().join("keys.bvh"),
        folder.path().join("between.bvh"),
    );
    std::fs::write(&keyed, file).unwrap();
    run(
        "between",
        &["-q", "--prior", &library, "-o", text(&out), text(&keyed)],
        "",
    );
    let positions = |path: &Path| Numbers::read(&run("bvh2xyz", &["-q", text(path)], ""));
    let (found, given) = (positions(&out), positions(&keyed));
    assert_eq!(found.rows.len(), 12 * (given.rows.len() - 1) + 1);
    for (t, row) in given.rows.iter().enumerate() {
        assert!(
            row.iter()
                .zip(&found.rows[12 * t])
                .all(|(a, b)| (a - b).abs() < 1e-3)
        );
    }
    // A sound file comes out as the same bytes, with a library too.
    let copy = folder.path().join("copy.bvh");
    let args = ["-q", "--prior", &library, "-o", text(&copy), text(&bvh)];
    crate::common::command("clean").args(args).output().unwrap();
    assert_eq!(std::fs::read_to_string(&copy).unwrap(), whole);
    // The same through clean: a whole body missing in frames of the file.
    let mut gappy: Vec<String> = lines.iter().map(|l| l.to_string()).collect();
    let channels = lines[first].split_whitespace().count();
    for line in &mut gappy[first + 40..first + 52] {
        *line = vec!["nan"; channels].join(" ");
    }
    let (hidden, cleaned) = (
        folder.path().join("gap.bvh"),
        folder.path().join("clean.bvh"),
    );
    std::fs::write(&hidden, gappy.join("\n") + "\n").unwrap();
    run(
        "clean",
        &[
            "-q",
            "--prior",
            &library,
            "-o",
            text(&cleaned),
            text(&hidden),
        ],
        "",
    );
    let (found, truth) = (positions(&cleaned), positions(&bvh));
    let off = |t: usize| {
        let pairs = found.rows[t].iter().zip(&truth.rows[t]);
        pairs.fold(0.0f64, |most, (a, b)| most.max((a - b).abs()))
    };
    assert!(
        (40..52).all(|t| off(t) < 10.0),
        "{:?}",
        (40..52).map(off).collect::<Vec<_>>()
    );
    assert!((0..40).all(|t| off(t) < 1e-3));
    let record = std::fs::read_to_string(folder.path().join("clean.bvh.json")).unwrap();
    assert!(record.contains("\"method\": \"motion\"") || record.contains("\"method\":\"motion\""));
}
