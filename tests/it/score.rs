//! The command `score` from outside.

use assert_cmd::Command;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }
    fn file(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, text).unwrap();
        path
    }
}

fn score(args: &[&str], files: &[&Path], input: &str) -> assert_cmd::assert::Assert {
    Command::new(crate::common::bin().join("score"))
        .args(args)
        .args(files)
        .write_stdin(input)
        .assert()
}

fn json(args: &[&str], files: &[&Path]) -> Value {
    let done = score(&[&["--json"], args].concat(), files, "").success();
    serde_json::from_slice(&done.get_output().stdout).unwrap()
}

const TRUTH: &str = "take,time,root.x,root.y,root.z,lhipjoint.x,lhipjoint.y,lhipjoint.z\n\
    w,0,0,0,0,3,4,0\nw,0.1,0,0,0,3,4,0\nw,0.2,0,0,0,3,4,0\nw,0.3,0,0,0,,,\n";

#[test]
fn points_are_matched_by_name_and_missing_ones_counted() {
    let dir = Folder::new();
    let truth = dir.file("truth.csv", TRUTH);
    let result = dir.file(
        "result.csv",
        "lhipjoint.x,lhipjoint.y,lhipjoint.z,hat.x,hat.y,hat.z,root.z,root.y,root.x\n\
         3,4,0,,,,0,0,2\n3,4,0,,,,0,0,0\n3,6,0,,,,0,0,0\n3,4,0,,,,0,,0\n",
    );
    let files = [truth.as_path(), &result];
    let r = json(&[], &files);
    assert_eq!(r["frames"], 4);
    assert_eq!(r["rate"], 10.0);
    assert_eq!(r["all"]["coordinates"], 20);
    assert_eq!(r["all"]["still_missing"], 1);
    assert_eq!(r["all"]["mse"], 8.0 / 20.0);
    assert_eq!(r["all"]["max"], 2.0);
    assert_eq!(r["all"]["mean_distance"], 4.0 / 6.0);
    assert_eq!(r["by_point"][0]["point"], "root");
    assert_eq!(r["by_point"][1]["mse"], 4.0 / 9.0);
    assert_eq!(r["bones"]["by_bone"][0]["truth"], 5.0);
    let said = score(&[], &files, "").success();
    said.stderr(contains("ignored 1 point that"))
        .stdout(contains("still missing: 1 of 21"));
}

#[test]
fn units_scale_what_is_printed() {
    let dir = Folder::new();
    let truth = dir.file("t.csv", "a.x,a.y,a.z\n0,0,0\n");
    let result = dir.file("r.csv", "a.x,a.y,a.z\n10,10,10\n");
    for (unit, cm) in [("cm", 1.0), ("m", 100.0), ("asf", 2.54 / 0.45)] {
        let r = json(&["--units", unit], &[&truth, &result]);
        assert_eq!(r["units"], unit);
        let mse = r["all"]["mse"].as_f64().unwrap();
        assert!((mse * cm * cm - 100.0).abs() <= 1e-9);
        let max = r["all"]["max"].as_f64().unwrap();
        assert!((max * cm - 10.0).abs() <= 1e-9);
    }
}

#[test]
fn a_damaged_table_tells_what_was_missing() {
    let dir = Folder::new();
    let rows = |at: &dyn Fn(usize) -> &'static str| -> String {
        let rows = (0..20).map(|i| format!("{},{}\n", i as f64 / 10.0, at(i)));
        "time,a.x,a.y,a.z\n".to_string() + &rows.collect::<String>()
    };
    let truth = dir.file("t.csv", rows(&|_| "0,0,0"));
    let hole = |i| (5..8).contains(&i) || i == 10;
    let damaged = dir.file("d.csv", rows(&|i| if hole(i) { ",," } else { "0,0,0" }));
    let result = dir.file(
        "r.csv",
        rows(&|i| match i {
            5..8 => "2,2,2",
            10 => "1,1,",
            0 => "3,0,0",
            _ => "0,0,0",
        }),
    );
    let damaged = damaged.to_str().unwrap();
    let d = &json(&["--damaged", damaged], &[&truth, &result])["damaged"];
    assert_eq!(d["missing"]["coordinates"], 11);
    assert_eq!(d["missing"]["still_missing"], 1);
    assert_eq!(d["missing"]["mse"], (9.0 * 4.0 + 2.0) / 11.0);
    assert_eq!(d["by_gap"][0]["gaps"], 1);
    assert_eq!(d["by_gap"][1]["gaps"], 1);
    assert_eq!(d["by_gap"][1]["rms"], 2.0);
    assert_eq!(d["by_gap"][1]["up_to"], 0.3);
    assert_eq!(d["observed"]["coordinates"], 48);
    assert_eq!(d["changed"]["coordinates"], 1);
    assert_eq!(d["before"]["still_missing"], 12);
    let said = score(&["--damaged", damaged], &[&truth, &result], "").success();
    said.stdout(contains("1 gap <= 0.1 s").and(contains("1 gap <= 0.3 s")));
}

#[test]
fn frames_must_be_the_same() {
    let dir = Folder::new();
    let truth = dir.file("truth.csv", TRUTH);
    let says = |text: &str, part: &str| {
        let other = dir.file("other.csv", text);
        for files in [[truth.as_path(), &other], [&other, truth.as_path()]] {
            let said = score(&[], &files, "").failure().code(1);
            let said = String::from_utf8_lossy(&said.get_output().stderr).to_string();
            assert!(said.contains(part) && said.lines().count() == 1, "{said}");
        }
    };
    says(&TRUTH.replace("w,0.2", "w,0.25"), ".csv: has time 0.2");
    says(
        &TRUTH.replace("w,0.2", "v,0.2"),
        "in frame 2 (counted from 0), not",
    );
    says(&TRUTH.replace("w,0.3,0,0,0,,,\n", ""), "frames, not");
    // A time that was rounded is the same.
    let other = dir.file("other.csv", TRUTH.replace("w,0.2", "w,0.20001"));
    score(&[], &[&truth, &other], "").success();
}

#[test]
fn bad_inputs_are_told() {
    let dir = Folder::new();
    let truth = dir.file("truth.csv", TRUTH);
    let less = dir.file("less.csv", "root.x,root.y,root.z\n0,0,0\n");
    let head = dir.file("head.csv", "root.x,root.y,root.z\n");
    let dash = Path::new("-");
    let lacks = "less.csv: has no point \"lhipjoint\" as in";
    score(&[], &[&truth, &less], "")
        .code(1)
        .stderr(contains(lacks));
    let damaged = ["--damaged", less.to_str().unwrap()];
    score(&damaged, &[&truth, &truth], "")
        .code(1)
        .stderr(contains(lacks));
    score(&[], &[&head, &head], "")
        .code(1)
        .stderr(contains("no frames"));
    score(&[], &[dash, dash], TRUTH)
        .code(2)
        .stderr(contains("more than once"));
    score(&[], &[&truth], "").code(2);
    score(&[], &[&truth, dash], "")
        .code(1)
        .stderr(contains("empty"));
    let fps = ["--fps", "20"];
    score(&fps, &[&truth, &truth], "")
        .code(2)
        .stderr(contains("--fps 20 contradicts"));
    score(&[], &[&truth, dash], TRUTH).success();
    score(&[], &[dash, &truth], TRUTH).success();
}

#[test]
fn an_array_is_scored_against_a_table() {
    let dir = Folder::new();
    let text = "time,a.x,a.y,a.z\n0,1,2,3\n0.5,4,5,6\n1,7,8,9\n";
    let truth = dir.file("t.csv", text);
    let array = dir.0.path().join("r.npy");
    let made = Command::new(crate::common::bin().join("corrupt"))
        .args(["--drop", "a", "-o"])
        .arg(&array)
        .write_stdin(text)
        .assert();
    made.success();
    let r = json(&["--joints", "a"], &[&truth, &array]);
    assert_eq!(r["all"]["still_missing"], 9);
    assert_eq!(r["all"]["mse"], Value::Null);
    // Whichever tells the time.
    assert_eq!(json(&["--joints", "a"], &[&array, &truth])["rate"], 2.0);
    assert_eq!(
        json(&["--joints", "a", "--fps", "9"], &[&array, &array])["rate"],
        9.0
    );
}

#[test]
fn noise_of_one_unit_on_a_real_take_is_an_mse_of_one() {
    let cmu = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let dir = Folder::new();
    let truth = dir.0.path().join("walk.csv");
    Command::new(crate::common::bin().join("amc2xyz"))
        .args(["--fps", "120", "--asf"])
        .arg(cmu.join("07.asf"))
        .arg(cmu.join("07_01.amc"))
        .arg("-o")
        .arg(&truth)
        .assert()
        .success();
    let noisy = dir.0.path().join("noisy.csv");
    Command::new(crate::common::bin().join("corrupt"))
        .args(["--dense", "1asf", "--seed", "1", "-o"])
        .args([&noisy, &truth])
        .assert()
        .success();
    let r = json(&["--units", "asf"], &[&truth, &noisy]);
    assert!((r["all"]["mse"].as_f64().unwrap() - 1.0).abs() <= 0.05);
    assert_eq!(r["bones"]["by_bone"].as_array().unwrap().len(), 22);
    let sd = r["bones"]["truth_sd"].as_f64().unwrap();
    assert!(sd <= 1e-9, "{sd}");
}

#[test]
fn takes_of_several_rates_are_each_judged_by_their_own() {
    let dir = Folder::new();
    // Each rises by 1, 3, 5 … a frame, and lacks the point for three frames.
    let take = |name: &str, rate: f64| -> String {
        let row = |i: u32| {
            let y = i * i;
            format!("{name},{},0,{y},0\n", f64::from(i) / rate)
        };
        (0..20).map(row).collect()
    };
    let header = "take,time,root.x,root.y,root.z\n";
    let (slow, fast) = (take("slow", 10.0), take("fast", 100.0));
    let gap = |take: &str| -> String {
        let line = |(i, line): (usize, &str)| match i {
            3..6 => line.splitn(3, ',').take(2).collect::<Vec<_>>().join(",") + ",,,\n",
            _ => line.to_string() + "\n",
        };
        take.lines().enumerate().map(line).collect()
    };
    let table = |name: &str, parts: [&str; 2]| dir.file(name, header.to_string() + &parts.concat());
    for (i, order) in [[&slow, &fast], [&fast, &slow]].into_iter().enumerate() {
        let truth = table(&format!("truth{i}.csv"), order.map(String::as_str));
        let [a, b] = order.map(|take| gap(take));
        let damaged = table(&format!("damaged{i}.csv"), [&a, &b]);
        let damaged = damaged.to_str().unwrap();
        let r = json(&["--damaged", damaged], &[truth.as_path(), &truth]);
        assert_eq!(r["rate"], Value::Null);
        let rates = [[10.0, 100.0], [100.0, 10.0]][i];
        assert_eq!(r["rates"], serde_json::json!(rates));
        // Second differences of 2 along one axis of three: 200 and 20,000 a second squared, as many
        // of each.
        let want = ((200f64.powi(2) + 20_000f64.powi(2)) / 6.0).sqrt();
        let told = r["accelerations"]["truth"].as_f64().unwrap();
        assert!((told - want).abs() <= 1e-6 * want, "{told} {want}");
        // Three frames are 0.3 s and 0.03 s.
        let gaps: Vec<u64> = (0..3)
            .map(|bin| r["damaged"]["by_gap"][bin]["gaps"].as_u64().unwrap())
            .collect();
        assert_eq!(gaps, [1, 1, 0]);
        let said = score(&[], &[truth.as_path(), &truth], "").success();
        let said = String::from_utf8(said.get_output().stdout.clone()).unwrap();
        let told = ["10 and 100 frames/s", "100 and 10 frames/s"][i];
        assert!(said.contains(told), "{said}");
    }
}

#[test]
fn takes_of_few_frames_have_the_rate_of_others_where_their_times_allow_it() {
    let dir = Folder::new();
    let mut table = String::from("take,time,root.x,root.y,root.z\n");
    // 120 a second in milliseconds; the first lasts two frames, and one alone has no rate.
    for (take, frames) in [2, 500, 1, 5, 700].into_iter().enumerate() {
        for i in 0..frames {
            let time = (f64::from(i) / 0.12).round() / 1e3;
            table += &format!("{take},{time},0,{},0\n", i % 7);
        }
    }
    let truth = dir.file("truth.csv", &table);
    let both = [truth.as_path(), &truth];
    for args in [&[][..], &["--fps", "120"]] {
        let r = json(args, &both);
        assert_eq!((&r["frames"], &r["rate"]), (&1208.into(), &120.0.into()));
        assert_eq!(r["rates"], serde_json::json!([120.0]));
        // Of one coordinate in three: all but two frames of each take.
        assert_eq!(r["accelerations"]["count"], 3 * (498 + 3 + 698));
    }
    let said = score(&["--fps", "100"], &both, "").code(2);
    said.stderr(contains("--fps 100 contradicts"));
    // A later take contradicts too.
    (0..90).for_each(|i| table += &format!("slow,{:.3},0,0,0\n", f64::from(i) / 30.0));
    let other = dir.file("other.csv", table);
    let said = score(&["--fps", "120"], &[other.as_path(), &other], "").code(2);
    said.stderr(contains("(30 frames per second)"));
}
