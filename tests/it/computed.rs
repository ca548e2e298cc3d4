//! Computed points, such as centers of pressure and joint centers: read and written back, and no
//! markers.

use crate::common::*;
use serde_json::Value;
use std::fs;

/// Nine markers of a walk, and between them a center of pressure that is loaded in frames 60 to 94
/// and has a gap while it is idle. A marker has a gap too, or another leaves its path for two
/// frames.
fn take(has_gap: bool, has_spike: bool) -> String {
    let names = ["M0", "M1", "M2", "M3", "cop", "M4", "M5", "M6", "M7", "M8"];
    let columns = names.map(|name| format!(",{name}.x,{name}.y,{name}.z"));
    let mut out = format!("time{}\n", columns.concat());
    for t in 0..160 {
        let time = f64::from(t) / 100.0;
        let marker = |k: usize| {
            let turn = 0.4 * (3.0 * time).sin();
            let off = [
                [0.0, 160.0],
                [9.0, 150.0],
                [-8.0, 142.0],
                [3.0, 120.0],
                [14.0, 101.0],
            ];
            let off = [
                off[k % 5][0] + 5.0 * (k / 5) as f64,
                off[k % 5][1] - 90.0 * (k / 5) as f64,
            ];
            let jitter = |c: i32| f64::from((t * 7919 + k as i32 * 104 + c * 31) % 100) * 1e-4;
            let spike = if has_spike && k == 1 && (30..32).contains(&t) {
                12.0
            } else {
                0.0
            };
            format!(
                "{:.4},{:.4},{:.4}",
                110.0 * time + off[0] * turn.cos() + jitter(0) + spike,
                off[1] + 2.0 * (9.0 * time).sin() + jitter(1),
                off[0] * turn.sin() + 4.0 * (k as f64).cos() + jitter(2)
            )
        };
        let cop = match t {
            60..95 => format!(
                "{:.1},0,{:.1}",
                50.0 + 0.7 * f64::from(t),
                4.0 + 0.02 * f64::from(t)
            ),
            120..140 if has_gap => ",,".to_string(),
            _ => "23.2,0,-25.4".to_string(),
        };
        let mut cells: Vec<String> = (0..9).map(marker).collect();
        if has_gap && (100..110).contains(&t) {
            cells[3] = ",,".to_string();
        }
        cells.insert(4, cop);
        out += &format!("{time:.2},{}\n", cells.join(","));
    }
    out
}

/// The cells of a point, row by row.
fn cells(table: &str, point: &str) -> Vec<String> {
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let first = format!("{point}.x");
    let at = header.iter().position(|name| *name == first).unwrap();
    let row = |line: &str| line.split(',').collect::<Vec<_>>()[at..at + 3].join(",");
    table.lines().skip(1).map(row).collect()
}

#[test]
fn a_sound_take_stays_and_a_wrong_marker_is_found() {
    let folder = tempfile::tempdir().unwrap();
    for (has_gap, has_spike) in [(false, false), (true, false), (false, true)] {
        let from = folder.path().join("take.csv");
        let to = folder.path().join(format!("out-{has_gap}-{has_spike}.csv"));
        let table = take(has_gap, has_spike);
        fs::write(&from, &table).unwrap();
        let done = command("clean")
            .args([text(&from), "-o", text(&to)])
            .output();
        let said = String::from_utf8(done.unwrap().stderr).unwrap();
        let result = fs::read_to_string(&to).unwrap();
        assert_eq!(cells(&result, "cop"), cells(&table, "cop"), "{said}");
        assert!(
            said.contains("cop is computed, no marker: left alone"),
            "{said}"
        );
        assert_eq!(result == table, !has_gap && !has_spike, "{said}");
        assert!(!cells(&result, "M3").contains(&",,".to_string()));
        let is_moved = cells(&result, "M1") != cells(&table, "M1");
        assert_eq!(is_moved, has_spike, "{said}");
        let record = fs::read(format!("{}.json", to.display())).unwrap();
        let record: Value = serde_json::from_slice(&record).unwrap();
        assert_eq!(record["summary"]["computed"], serde_json::json!(["cop"]));
        let filled = if has_gap { 10 } else { 0 };
        assert_eq!(record["summary"]["filled"], filled);
        assert_eq!(record["summary"]["outliers"], if has_spike { 2 } else { 0 });
    }
}

#[test]
fn it_is_no_finding_and_no_label() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
    fs::write(&from, take(true, false)).unwrap();
    let found = command("audit").args(["--json", text(&from)]).output();
    let found: Value = serde_json::from_slice(&found.unwrap().stdout).unwrap();
    assert_eq!(found[0]["takes"][0]["findings"], serde_json::json!([]));
    assert_eq!(found[0]["computed"], serde_json::json!(["cop"]));
    let label = [text(&from), "-o", text(&to)];
    command("label").args(label).assert().success();
    assert_eq!(fs::read(&from).unwrap(), fs::read(&to).unwrap());
}

#[test]
fn tables_are_restored_without_it() {
    let table = take(true, false);
    for (name, args) in [("complete", &["--self"][..]), ("denoise", &["--self"])] {
        let done = run(name, args, &table);
        assert_eq!(cells(&done, "cop"), cells(&table, "cop"), "{name}");
        let is_filled = !cells(&done, "M3").contains(&",,".to_string());
        assert_eq!(is_filled, name == "complete", "{name}");
    }
}

#[test]
fn points_that_a_file_lists_as_computed_stay() {
    let Some(path) = shared("data/trust/oxford-ghosts.c3d.gz") else {
        return skipped("no ../shared/data/trust");
    };
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("out.c3d");
    let done = command("clean")
        .args([text(&path), "-o", text(&to)])
        .output();
    let said = String::from_utf8(done.unwrap().stderr).unwrap();
    assert!(
        said.contains("22 points are computed, no markers"),
        "{said}"
    );
    let [before, after] = [&path, &to].map(|path| run("c3d2xyz", &["-q", text(path)], ""));
    for point in ["RHLX0", "LHE1", "LArchHeight", "LHLX3"] {
        assert_eq!(cells(&before, point), cells(&after, point), "{point}");
    }
}
