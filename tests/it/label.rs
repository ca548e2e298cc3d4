//! `posing label`.

use crate::common::*;
use std::fs;
use std::path::Path;

/// A take of markers as a table, whose cells have digits of their own; two markers changed places
/// in frames 101 to 140, and a third has a piece without a label.
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
        said.contains("a and b changed places in frames 101-140: put back"),
        "{said}"
    );
    assert!(said.contains("*7 in frames 201-250 is c: joined"), "{said}");
    assert_eq!(fs::read_to_string(&to).unwrap(), table(false));
    let said = command("label")
        .args(["--dry-run", text(&from)])
        .assert()
        .success();
    assert_eq!(said.get_output().stderr, done.get_output().stderr);
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
