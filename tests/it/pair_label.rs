//! The command `pair-label` from outside.

use crate::common::{fails, run, take, text};
use std::collections::HashMap;
use std::fs;

const HEADER: &str = "a_take,a_frame,b_take,b_frame,label";
/// Two short takes have few near pairs; with these flags they have some 20.
const WIDE: &[&str] = &["--near", "15", "--seconds", "0.2"];

/// A walk and a run of CMU, from testdata.
fn two_people() -> String {
    let (walk, run) = (take("07", "07_01", &[]), take("09", "09_06", &[]));
    let run = run.unwrap();
    let (_, rows) = run.split_once('\n').unwrap();
    walk.unwrap() + rows
}

/// The proposed pairs of a CSV: take and frame of both poses.
fn pairs(csv: &str) -> Vec<(String, usize, String, usize)> {
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some(HEADER));
    let pair = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells.len(), cells[4]), (5, ""), "{line}");
        let frame = |cell: &str| cell.parse().unwrap();
        (
            cells[0].to_string(),
            frame(cells[1]),
            cells[2].to_string(),
            frame(cells[3]),
        )
    };
    lines.map(pair).collect()
}

/// The sixteen joints of each frame of a take in the body's frame, body heights.
fn bodies(table: &str) -> HashMap<String, Vec<[[f64; 3]; 16]>> {
    use posing::metric::{BodyFramePoses, JointMap};
    let reader = posing::io::Input::new("table", std::io::Cursor::new(table.to_string())).unwrap();
    let poses = posing::io::Table::read(reader, &Default::default())
        .unwrap()
        .poses;
    let named = |range: std::ops::Range<usize>| {
        let name = poses.take.as_ref().unwrap()[range.start].to_string();
        let take = BodyFramePoses::new(&poses.slice(range), Some(120.0), &JointMap::cmu()).unwrap();
        let frames = (0..take.frames()).map(|t| take.frame(t).map(|p| p.to_array()));
        (name, frames.collect())
    };
    poses.takes().into_iter().map(named).collect()
}

#[test]
fn proposals_obey_the_rules() {
    let table = two_people();
    let csv = run("pair-label", &[&["--to", "csv"], WIDE].concat(), &table);
    let (pairs, bodies) = (pairs(&csv), bodies(&table));
    assert!(pairs.len() > 10, "{}", pairs.len());
    for (i, (a, s, b, t)) in pairs.iter().enumerate() {
        assert!(a != b || t - s >= 120, "{a} {s} {t}");
        for (take, frame) in [(a, *s), (b, *t)] {
            assert!(frame >= 24 && frame + 24 < bodies[take].len());
        }
        let (x, y) = (&bodies[a][*s], &bodies[b][*t]);
        let length = |k: usize| {
            (0..3)
                .map(|c| (x[k][c] - y[k][c]).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        // Bodies are at most 180 cm and at least 140 cm high, from ankle to head.
        let mean = (0..16).map(length).sum::<f64>() / 16.0 * 180.0;
        assert!(mean > 0.0 && mean < 15.0 * 180.0 / 140.0, "{mean}");
        for (c, u, d, v) in &pairs[..i] {
            assert!((a, b) != (c, d) || s.abs_diff(*u) > 30 || t.abs_diff(*v) > 30);
        }
    }
}

#[test]
fn the_seed_decides_and_threads_do_not() {
    let table = two_people();
    let ask = |more: &[&str]| {
        let args = [&["--to", "csv", "--count", "5"], WIDE, more].concat();
        run("pair-label", &args, &table)
    };
    assert_eq!(ask(&[]), ask(&["--threads", "1"]));
    assert_ne!(ask(&[]), ask(&["--seed", "1"]));
    assert_eq!(ask(&[]).lines().count(), 6);
    let other = run(
        "pair-label",
        &["--to", "csv", "--other-takes", "--seconds", "0.3"],
        &table,
    );
    let other = pairs(&other);
    assert!(!other.is_empty() && other.iter().all(|(a, _, b, _)| a != b));
}

#[test]
fn one_page_carries_the_pairs_and_fetches_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (page, csv) = (
        folder.path().join("pairs.html"),
        folder.path().join("pairs.csv"),
    );
    let args = [
        "--csv",
        text(&csv),
        "-o",
        text(&page),
        "--title",
        "Mine & <co>",
    ];
    assert_eq!(run("pair-label", &args, &two_people()), "");
    let (page, csv) = (
        fs::read_to_string(page).unwrap(),
        fs::read_to_string(csv).unwrap(),
    );
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    assert!(page.contains("<h1>Mine &amp; &lt;co&gt;</h1>") && !page.contains("{{"));
    for loading in ["http://", "https://", "src=", "url(", "@import", "fetch("] {
        assert!(!page.contains(loading), "{loading}");
    }
    let (_, data) = page
        .split_once("<script type=\"application/json\">")
        .unwrap();
    let data: serde_json::Value =
        serde_json::from_str(data.split("</script").next().unwrap()).unwrap();
    let of_page = data["pairs"].as_array().unwrap().iter().map(|pair| {
        let pose = |side: &str| {
            let name = pair[side][0].as_str().unwrap().to_string();
            (name, pair[side][1].as_u64().unwrap() as usize)
        };
        let ((a, s), (b, t)) = (pose("a"), pose("b"));
        (a, s, b, t)
    });
    assert_eq!(of_page.collect::<Vec<_>>(), pairs(&csv));
}

#[test]
fn fewer_than_asked_is_explained() {
    let done = crate::common::command("pair-label")
        .args(["--to", "csv", "--count", "2000"])
        .write_stdin(two_people())
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.contains(" of 2000: any other is within 0.25 s of one of these on both sides"),
        "{said}"
    );
}

#[test]
fn each_failure_is_one_clear_line() {
    let (table, csv) = (two_people(), ["--to", "csv"]);
    let walk = take("07", "07_01", &[]).unwrap();
    let says = |more: &[&str], table: &str, code: i32, part: &str| {
        let args = [&csv, more].concat();
        let said = fails("pair-label", &args, table.as_bytes(), code);
        assert!(said.contains(part), "{said}");
    };
    says(
        &["--near", "0.2"],
        &table,
        1,
        "are within 0.2 cm; see --near",
    );
    says(&["--near", "0"], &table, 2, "--near 0: expected");
    says(
        &["--count", "0"],
        &table,
        2,
        "--count 0: expected 1 to 2000",
    );
    says(&["--seconds", "9"], &table, 2, "--seconds 9: expected");
    says(
        &["--seconds", "2"],
        &table,
        1,
        "longest unbroken motion lasts",
    );
    let short: Vec<&str> = walk.lines().take(181).collect();
    let part = "one take of 1.49 s is too short";
    says(&[], &short.join("\n"), 1, part);
    says(&["--other-takes"], &walk, 1, "--other-takes needs two");
    says(
        &[],
        &table.replace("lwrist.", "paw."),
        1,
        "\"lwrist\" (LHand)",
    );
    let twice = table.clone() + walk.split_once('\n').unwrap().1;
    says(&[], &twice, 1, "has take \"07_01\" in two places");
    let untimed = |line: &str| line.splitn(3, ',').nth(2).unwrap().to_string();
    let untimed: Vec<String> = walk.lines().map(untimed).collect();
    says(&[], &untimed.join("\n"), 2, "--fps");
    let said = fails("pair-label", &[], walk.as_bytes(), 2);
    assert!(said.contains("-o FILE.html"), "{said}");
}
