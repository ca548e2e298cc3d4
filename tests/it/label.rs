//! `posing label`.

use crate::common::*;
use std::fs;
use std::path::Path;

/// A take of markers as a table, whose cells have digits of their own; two markers changed places
/// in frames 100 to 139, and a third has a piece without a label.
fn table(is_wrong: bool) -> String {
    let names = ["a", "b", "c", "d", "e", "*7"];
    let mut text = "time".to_string();
    for name in names {
        text += &["x", "y", "z"]
            .map(|axis| format!(",{name}.{axis}"))
            .concat();
    }
    text.push('\n');
    for t in 0..300 {
        let time = f64::from(t) / 100.0;
        let place = |k: i32| {
            let off = [[0, 0, 0], [12, 3, 0], [3, 14, 5], [9, 9, 16], [20, 2, 9]][k as usize];
            let all = [0, 1, 2].map(|c| {
                f64::from(off[c])
                    + 40.0 * (time + c as f64).sin()
                    + f64::from((t * 7 + k) % 5) * 0.01
            });
            format!("{:.3},{:.3},{:.3}", all[0], all[1], all[2])
        };
        let mut cells: Vec<String> = (0..5).map(place).collect();
        cells.push(",,".into());
        if is_wrong {
            if (100..140).contains(&t) {
                cells.swap(0, 1);
            }
            if (200..250).contains(&t) {
                cells.swap(2, 5);
            }
        }
        text += &format!("{time:.2},{}\n", cells.join(","));
    }
    text
}

#[test]
fn labels_are_put_back_digit_for_digit() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
    fs::write(&from, table(true)).unwrap();
    let done = command("label")
        .args([text(&from), "-o", text(&to)])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("a and b changed places in frames 100 to 139: put back"),
        "{said}"
    );
    assert!(
        said.contains("*7 in frames 200 to 249 is c: joined"),
        "{said}"
    );
    assert_eq!(fs::read_to_string(&to).unwrap(), table(false));
    let said = command("label")
        .args(["--dry-run", text(&from)])
        .assert()
        .success();
    assert_eq!(said.get_output().stderr, done.get_output().stderr);
}

#[test]
fn labels_are_put_back_in_every_frame_that_repeats_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
    // Every frame twice, and one of twelve dropped, the one before in its place.
    for (is_doubled, frames, exchanged) in [(true, 600, "200 to 279"), (false, 300, "100 to 139")] {
        let shown = |t: usize| {
            if is_doubled {
                t / 2
            } else {
                t - usize::from(t % 12 == 5)
            }
        };
        let held = |is_wrong: bool| {
            let table = table(is_wrong);
            let rows: Vec<&str> = table.lines().collect();
            let row = |t: usize| {
                let places = rows[1 + shown(t)].split_once(',').unwrap().1;
                format!("{:.3},{places}\n", t as f64 / 100.0)
            };
            format!("{}\n{}", rows[0], (0..frames).map(row).collect::<String>())
        };
        fs::write(&from, held(true)).unwrap();
        let done = command("label")
            .args([text(&from), "-o", text(&to)])
            .assert()
            .success();
        let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        let what = format!("a and b changed places in frames {exchanged}: put back");
        assert!(said.contains(&what), "{said}");
        assert_eq!(fs::read_to_string(&to).unwrap(), held(false));
    }
}

#[test]
fn files_of_markers_keep_all_else() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, is_wrong) in [("wrong", true), ("right", false)] {
        let csv = at(&format!("{name}.csv"));
        fs::write(&csv, table(is_wrong)).unwrap();
        for (to, ending) in [("xyz2c3d", "c3d"), ("xyz2trc", "trc")] {
            let out = at(&format!("{name}.{ending}"));
            command(to)
                .args(["-q", "-o", text(&out), text(&csv)])
                .assert()
                .success();
        }
    }
    for ending in ["c3d", "trc"] {
        let (from, to) = (
            at(&format!("wrong.{ending}")),
            at(&format!("label.{ending}")),
        );
        let flags = ["-q", "--up", "y", "-o", text(&to), text(&from)];
        command("label").args(flags).assert().success();
        let bytes = |path: &Path| {
            let bytes = fs::read(path).unwrap();
            String::from_utf8_lossy(&bytes).replace("wrong.", "right.")
        };
        assert_eq!(
            bytes(&to),
            bytes(&at(&format!("right.{ending}"))),
            "{ending}"
        );
    }
}

#[test]
fn audit_says_what_labels_are_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("right.csv"), table(false)).unwrap();
    fs::write(at("wrong.csv"), table(true)).unwrap();
    let audit = |args: &[&str], code: i32| {
        let done = command("audit").args(args).assert().code(code);
        String::from_utf8_lossy(&done.get_output().stdout).into_owned()
    };
    let said = audit(&[text(&at("wrong.csv"))], 3);
    for line in [
        "swap: a and b changed places in frames 100 to 139: label puts them back",
        "label: *7 in frames 200 to 249 is c: label joins it",
    ] {
        assert!(said.contains(line), "{said}");
    }
    assert_eq!(said.matches("swap:").count(), 1, "{said}");
    // Exchanged in every frame.
    let names = table(false)
        .replace("a.", "A.")
        .replace("b.", "a.")
        .replace("A.", "b.");
    fs::write(at("named.csv"), names).unwrap();
    audit(&[text(&at("named.csv"))], 0);
    for flags in [&["--same-person"][..], &[]] {
        let right = at("right.csv");
        let like = [&["--like", text(&right)], flags].concat();
        audit(&[&like[..], &[text(&right)]].concat(), 0);
        let said = audit(
            &[&like[..], &["--json", text(&at("named.csv"))]].concat(),
            3,
        );
        let audits: serde_json::Value = serde_json::from_str(&said).unwrap();
        let found = &audits[0]["takes"][0]["findings"];
        assert_eq!(found[0]["kind"], "whole-take", "{said}");
        assert_eq!(found[0]["points"], serde_json::json!(["b", "a"]));
        assert_eq!(found[1], serde_json::Value::Null);
    }
}

#[test]
fn clean_puts_labels_right_first_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let from = at("in.csv");
    fs::write(&from, table(true)).unwrap();
    let clean = |to: &str, flags: &[&str]| {
        let to = at(to);
        let mut run = command("clean");
        run.args([text(&from), "-o", text(&to)]).args(flags);
        // A track that is whole but for its ends is missing there, which is a finding.
        run.assert().code(predicates::ord::le(3));
        let record = fs::read_to_string(to.with_added_extension("json")).unwrap();
        let record: serde_json::Value = serde_json::from_str(&record).unwrap();
        (fs::read_to_string(&to).unwrap(), record)
    };
    let (all, record) = clean("all.csv", &[]);
    assert_eq!(all, table(false));
    let changes = record["labels"]["changes"].as_array().unwrap();
    assert_eq!(changes[0]["kind"], "swap");
    assert_eq!(changes[0]["frames"], serde_json::json!([100, 140]));
    assert_eq!([&changes[1]["from"], &changes[1]["to"]], ["*7", "c"]);
    let (none, record) = clean("none.csv", &["--no-labels", "--outliers", "none"]);
    assert!(record["labels"].is_null());
    // The piece without a label stays as it is, and none is filled from it.
    let column = |csv: &str, t: usize, from: usize| {
        let row = csv.lines().nth(1 + t).unwrap();
        row.split(',')
            .skip(from)
            .take(3)
            .collect::<Vec<_>>()
            .join(",")
    };
    assert_eq!(column(&none, 220, 16), column(&table(true), 220, 16));
    let (kept, _) = clean("kept.csv", &["--keep-labels", "a:1.2-1.3"]);
    assert_eq!(column(&kept, 120, 1), column(&table(true), 120, 1));
    assert_eq!(column(&kept, 220, 7), column(&table(false), 220, 7));
}

/// A body with two sides, each with its own bones, as a table; labels `exchanged` bear each other's
/// names in all frames.
fn body(exchanged: [usize; 2], from: f64) -> String {
    let names = [
        "LSHO", "LELB", "LWRA", "LWRB", "RSHO", "RELB", "RWRA", "RWRB", "C7", "T10",
    ];
    let mut names = names.map(String::from);
    names.swap(exchanged[0], exchanged[1]);
    let mut text = "time".to_string();
    for name in &names {
        text += &["x", "y", "z"]
            .map(|axis| format!(",{name}.{axis}"))
            .concat();
    }
    text.push('\n');
    for t in 0..300 {
        let time = from + f64::from(t) / 100.0;
        text += &format!("{:.2}", f64::from(t) / 100.0);
        for k in 0..10 {
            let side = if k < 4 { 1.0 } else { -1.0 };
            let (sin, cos) = (0.7 * (3.0 * time + side).sin()).sin_cos();
            let arm: [f64; 3] = match k % 4 {
                _ if k > 7 => [0.0, f64::from(8 * (9 - k)) - 20.0, -9.0],
                0 => [18.0 * side, 0.0, 0.0],
                1 => [20.0 * side, -28.0, 1.0],
                2 => [23.0 * side, -50.0, 3.0],
                _ => [17.0 * side, -52.0, -2.0],
            };
            let turned = match k {
                8.. => arm,
                _ => [
                    arm[0],
                    arm[1] * cos - arm[2] * sin,
                    arm[1] * sin + arm[2] * cos,
                ],
            };
            for (c, v) in turned.into_iter().enumerate() {
                let noise = 0.02 * (f64::from(t * 31 + k * 7) + c as f64 * 2.3).sin();
                text += &format!(",{:.4}", v + [12.0 * time, 140.0, 3.0][c] + noise);
            }
        }
        text.push('\n');
    }
    text
}

#[test]
fn a_labeled_take_of_the_person_puts_back_what_no_frame_shows() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, exchanged, from) in [
        ("like", [0, 0], 0.7),
        ("right", [0, 0], 0.0),
        ("wrong", [1, 2], 0.0),
    ] {
        fs::write(at(&format!("{name}.csv")), body(exchanged, from)).unwrap();
    }
    let out = at("out.csv");
    let like = at("like.csv");
    let flags = ["--like", text(&like), "--same-person", "-o", text(&out)];
    let done = command("label")
        .args(flags)
        .arg(at("wrong.csv"))
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("LWRA and LELB are exchanged in every frame: put back"),
        "{said}"
    );
    let cells = |csv: &str| -> Vec<Vec<String>> {
        let mut rows = csv
            .lines()
            .map(|l| l.split(',').map(String::from).collect::<Vec<_>>());
        let titles = rows.next().unwrap();
        let mut order: Vec<usize> = (0..titles.len()).collect();
        order.sort_by_key(|c| titles[*c].clone());
        rows.map(|row| order.iter().map(|c| row[*c].clone()).collect())
            .collect()
    };
    let (out, right) = (fs::read_to_string(&out).unwrap(), body([0, 0], 0.0));
    assert_eq!(cells(&out), cells(&right));
    // Another person's take tells it, and nothing moves.
    let told = command("label")
        .args(["--like", text(&like), "--dry-run"])
        .arg(at("wrong.csv"))
        .assert()
        .code(3);
    let said = String::from_utf8_lossy(&told.get_output().stderr).into_owned();
    assert!(
        said.contains("LWRA and LELB are exchanged in every frame, here or in"),
        "{said}"
    );
}

#[test]
fn one_labeled_take_against_another_only_tells() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // The sides of the body say nothing of labels in its middle.
    for (name, exchanged, from) in [
        ("first", [0, 0], 0.7),
        ("second", [0, 0], 1.9),
        ("wrong", [8, 9], 0.0),
    ] {
        fs::write(at(&format!("{name}.csv")), body(exchanged, from)).unwrap();
    }
    let label = |like: &[&str], take: &str, code: i32| {
        let out = at(&format!("{}-{take}", like.len()));
        let mut run = command("label");
        let files: Vec<_> = like.iter().map(|name| at(name)).collect();
        files.iter().for_each(|file| {
            run.args(["--like", text(file)]);
        });
        run.args(["--same-person", "-o", text(&out)]);
        run.arg(at(take)).assert().code(code);
        fs::read_to_string(&out).unwrap()
    };
    let wrong = fs::read_to_string(at("wrong.csv")).unwrap();
    assert_eq!(label(&["first.csv"], "wrong.csv", 3), wrong);
    assert_ne!(label(&["first.csv", "second.csv"], "wrong.csv", 0), wrong);
    // Nor does a wrong one change a take that is right.
    let right = fs::read_to_string(at("first.csv")).unwrap();
    assert_eq!(label(&["wrong.csv"], "first.csv", 3), right);
}

#[test]
fn one_of_two_people_is_taken_out() {
    let folder = tempfile::tempdir().unwrap();
    let both = folder.path().join("both.csv");
    let one = body([0, 0], 0.0);
    let rows = one.lines().enumerate().map(|(n, line)| {
        let (time, cells) = line.split_once(',').unwrap();
        let of = |who: &str| match n {
            0 => cells.split(',').map(|c| format!(",{who}:{c}")).collect(),
            _ => format!(",{cells}"),
        };
        format!("{time}{}{}\n", of("Ann"), of("Ben"))
    });
    fs::write(&both, rows.collect::<String>()).unwrap();
    let ben = command("trim")
        .args(["--person", "Ben", text(&both)])
        .assert()
        .success();
    let titles = String::from_utf8_lossy(&ben.get_output().stdout).into_owned();
    assert!(
        titles.starts_with("time,LSHO.x,LSHO.y,LSHO.z,LELB.x"),
        "{}",
        &titles[..60]
    );
    assert!(!titles.contains("Ann"));
    let said = command("trim")
        .args(["--person", "Eve", text(&both)])
        .assert()
        .code(1);
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(
        said.contains("has no person \"Eve\", but Ann, Ben"),
        "{said}"
    );
}

/// A table without the names of its markers, in another order.
fn nameless(table: &str) -> (String, Vec<String>) {
    let numbers = Numbers::read(table);
    let count = numbers.points.len();
    let order: Vec<usize> = (0..count).map(|n| (7 * n + 3) % count).collect();
    let mut text = "time".to_string();
    for n in 0..count {
        text += &["x", "y", "z"].map(|axis| format!(",*{n}.{axis}")).concat();
    }
    text.push('\n');
    for (time, row) in numbers.time.iter().zip(&numbers.rows) {
        text += &format!("{time}");
        for p in &order {
            for v in &row[3 * p..3 * p + 3] {
                text += &if v.is_nan() {
                    ",".to_string()
                } else {
                    format!(",{v:.4}")
                };
            }
        }
        text.push('\n');
    }
    let bare = |p: &usize| numbers.points[*p].rsplit(':').next().unwrap().to_string();
    (text, order.iter().map(bare).collect())
}

#[test]
fn takes_without_labels_are_named_in_their_own_format() {
    let Some(path) = shared("data/markers/cmu-06_01.c3d") else {
        return skipped("no takes of markers");
    };
    let table = thin(&run("c3d2xyz", &["-q", text(&path)], ""), 494, 4);
    let (raw, names) = nameless(&table);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("raw.csv"), &raw).unwrap();
    let convert = |to: &str, name: &str| {
        run(
            to,
            &["-q", "-o", text(&path(name)), text(&path("raw.csv"))],
            "",
        );
    };
    convert("xyz2c3d", "raw.c3d");
    convert("xyz2trc", "raw.trc");
    let set = path("set.json");
    let like = shared("data/formats/hdm05/HDM_dg_06-03_03_120.c3d").unwrap();
    let learn = ["--learn", "--up", "z", "-q", text(&like), "-o", text(&set)];
    command("label").args(learn).assert().success();
    for (file, set) in [
        ("raw.csv", "cmu41"),
        ("raw.c3d", "cmu41"),
        ("raw.trc", text(&set)),
    ] {
        let done = command("label")
            .args([
                "--from-nothing",
                "--set",
                set,
                "--up",
                "trc=y",
                text(&path(file)),
            ])
            // A folder, as it has no ending.
            .args(["-o", text(&path("out"))])
            .assert()
            .success();
        let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        assert!(
            said.contains("41 of 41 labels named, from 41 tracks"),
            "{said}"
        );
        let reader: &[&str] = match file.rsplit_once('.').unwrap().1 {
            "csv" => &["trim", "-q"],
            "c3d" => &["c3d2xyz", "-q"],
            _ => &["trc2xyz", "-q", "--up", "y"],
        };
        let read = |file: &Path| {
            let args = [&reader[1..], &[text(file)]].concat();
            Numbers::read(&run(reader[0], &args, ""))
        };
        let (found, was) = (read(&path("out").join(file)), read(&path(file)));
        assert_eq!(found.points, names);
        let same = found.rows.iter().flatten().zip(was.rows.iter().flatten());
        assert!(same.clone().count() > 10_000);
        for (a, b) in same {
            assert!(a == b || a.is_nan() && b.is_nan());
        }
    }
    let record = fs::read_to_string(path("out").join("raw.c3d.json")).unwrap();
    assert!(record.contains("\"named\"") && record.contains("\"label\": \"LFHD\""));
    let labeled = path("out").join("raw.csv");
    let error = fails(
        "label",
        &[
            "--from-nothing",
            "--set",
            "pig",
            text(&labeled),
            "-o",
            "x.csv",
        ],
        b"",
        1,
    );
    assert!(error.contains("has labels already, such as"), "{error}");
    let error = fails(
        "label",
        &[
            "--from-nothing",
            "--set",
            "nil",
            text(&labeled),
            "-o",
            "x.csv",
        ],
        b"",
        2,
    );
    assert!(error.contains("there is no marker set nil"), "{error}");
}

#[test]
fn a_folder_makes_a_set_of_any_labels() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("takes")).unwrap();
    let labeled = table(false);
    fs::write(path("takes").join("ann.csv"), &labeled).unwrap();
    fs::write(path("takes").join("notes.csv"), "who\nAnn\n").unwrap();
    let mut raw = labeled;
    for (name, track) in [
        ("a", "*3"),
        ("b", "*1"),
        ("c", "*5"),
        ("d", "*2"),
        ("e", "*4"),
    ] {
        raw = raw.replace(&format!(",{name}."), &format!(",{track}."));
    }
    fs::write(path("raw.csv"), raw).unwrap();
    let (set, to) = (path("set.json"), path("out.csv"));
    let done = command("label")
        .args(["--learn-set", text(&path("takes")), "-o", text(&set)])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("learned from") && said.contains("ann.csv"),
        "{said}"
    );
    command("label")
        .args([
            "--from-nothing",
            "--set",
            text(&set),
            text(&path("raw.csv")),
        ])
        .args(["-o", text(&to)])
        .assert()
        .success();
    let header = |file: &Path| {
        fs::read_to_string(file)
            .unwrap()
            .lines()
            .next()
            .unwrap()
            .to_string()
    };
    assert_eq!(header(&to), header(&path("takes").join("ann.csv")));
    // It names tracks, and makes no skeleton.
    let error = fails(
        "solve",
        &["--set", text(&set), text(&to), "-o", "x.csv"],
        b"",
        1,
    );
    assert!(error.contains("no skeleton: the set"), "{error}");
}
