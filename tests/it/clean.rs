//! `clean`: files of any format, one by one and by the folder.

use crate::common::{Numbers, bin, command, fails, run, shared, text};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// The walk of the test data, 120 frames a second.
fn walk() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let (asf, amc) = (folder.join("07.asf"), folder.join("07_01.amc"));
    run(
        "amc2xyz",
        &["-q", "--asf", text(&asf), "--fps", "120", text(&amc)],
        "",
    )
}

/// Its first frames, three points missing for .2 s at a time.
fn with_gaps() -> String {
    let table: Vec<String> = walk().lines().take(200).map(str::to_string).collect();
    let table = table.join("\n") + "\n";
    run(
        "corrupt",
        &["-q", "--gaps", "3", "--length", "0.2", "--points", "3"],
        &table,
    )
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, content).unwrap();
        path
    }

    /// Runs `clean` in the folder; its exit code and its table.
    fn clean(&self, args: &[&str]) -> (i32, String) {
        let done = command("clean")
            .current_dir(self.0.path())
            .args(args)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stderr);
        let table = String::from_utf8_lossy(&done.stdout);
        (done.status.code().unwrap(), format!("{table}{said}"))
    }

    /// The row of a file in the list of a folder of results.
    fn row(&self, results: &str, file: &str) -> Value {
        let list = fs::read(self.at(results).join("clean.json")).unwrap();
        let list: Vec<Value> = serde_json::from_slice(&list).unwrap();
        let mut rows = list.into_iter().filter(|row| row["file"] == file);
        let row = rows.next().unwrap();
        assert!(rows.next().is_none());
        row
    }

    fn record(&self, result: &str) -> Value {
        serde_json::from_slice(&fs::read(self.at(&format!("{result}.json"))).unwrap()).unwrap()
    }
}

/// The last word of a file's row.
fn fate<'a>(table: &'a str, file: &str) -> &'a str {
    let row = table.lines().find(|l| l.starts_with(file)).unwrap();
    row.rsplit(' ').next().unwrap()
}

#[test]
fn markers_are_filled_and_all_else_of_a_file_stays() {
    let folder = Folder::new();
    let gaps = with_gaps();
    let written = command("xyz2c3d")
        .arg("-q")
        .write_stdin(gaps.clone())
        .output();
    let original = written.unwrap().stdout;
    folder.put("a.c3d", &original);
    let trc = run("xyz2trc", &["-q"], &gaps);
    // A row of another writer: blanks at its end stay.
    let trc = trc.replacen("\t\n", "\t  \n", 1);
    folder.put("a.trc", &trc);
    folder.put("a.csv", &gaps);
    let (code, said) = folder.clean(&[
        "a.c3d",
        "a.trc",
        "a.csv",
        "-o",
        "out",
        "--up",
        "y",
        "--outliers",
        "none",
    ]);
    assert_eq!(code, 0, "{said}");

    let truth = Numbers::read(&run("complete", &["-q"], &gaps));
    let out = |name: &str| fs::read(folder.at(&format!("out/{name}"))).unwrap();
    let table = String::from_utf8(out("a.csv")).unwrap();
    assert_eq!(Numbers::read(&table).missing(), 0);
    for (was, is) in gaps.lines().zip(table.lines()) {
        for (was, is) in was.split(',').zip(is.split(',')) {
            assert!(was == is || was.is_empty());
        }
    }
    let filled = String::from_utf8(out("a.trc")).unwrap();
    for (was, is) in trc.split(['\t', '\n']).zip(filled.split(['\t', '\n'])) {
        assert!(was == is || was.is_empty(), "{was} {is}");
    }
    let back = Numbers::read(&run("trc2xyz", &["-q", "--up", "y"], &filled));
    assert_eq!(back.missing(), 0);
    let (far, _) = back.far(&truth);
    assert!(far < 0.1, "{far}");
    let whole = out("a.c3d");
    assert_eq!(whole.len(), original.len());
    let changed = whole.iter().zip(&original).filter(|(a, b)| a != b).count();
    assert!(changed > 0 && changed <= 16 * Numbers::read(&gaps).missing());
    let record = folder.record("out/a.c3d");
    assert_eq!(record["read_as"]["rate"]["value"], 120.0);
    assert_eq!(record["summary"]["missing"], record["summary"]["filled"]);
    assert!(record["gaps"].as_array().unwrap().len() >= 3);
    assert!(folder.at("out/clean.html").exists());
}

#[test]
fn a_second_run_does_nothing_until_something_changes() {
    let folder = Folder::new();
    let gaps = with_gaps();
    folder.put("in/a.csv", &gaps);
    folder.put("in/deep/b.csv", &gaps);
    folder.put("in/notes.txt", "no motion");
    let run = |more: &[&str]| folder.clean(&[&["in", "-o", "out"], more].concat()).1;
    let both = |table: &str| {
        (
            fate(table, "a.csv").to_string(),
            fate(table, "deep/b.csv").to_string(),
        )
    };
    let words = |a: &str, b: &str| (a.to_string(), b.to_string());
    let first = run(&[]);
    assert!(first.contains("1 other file ignored"), "{first}");
    let time = || {
        fs::metadata(folder.at("out/deep/b.csv"))
            .unwrap()
            .modified()
            .unwrap()
    };
    let written = time();
    assert_eq!(both(&run(&[])), words("unchanged", "unchanged"));
    assert_eq!(time(), written);
    folder.put(
        "in/a.csv",
        gaps.replacen("07_01", "walk", 1).replace("07_01", "walk"),
    );
    assert_eq!(both(&run(&[])), words("cleaned", "unchanged"));
    // A result that somebody changed, and one whose record is gone, are somebody's work.
    folder.put("out/a.csv", "x");
    fs::remove_file(folder.at("out/deep/b.csv.json")).unwrap();
    let said = run(&[]);
    assert_eq!(both(&said), words("stays", "failed"));
    assert!(said.contains("failed, old result stays"));
    assert!(said.contains("was changed since clean made it") && said.contains("has no record"));
    assert_eq!(both(&run(&["--again"])), words("cleaned", "failed"));
    fs::remove_file(folder.at("out/deep/b.csv")).unwrap();
    assert_eq!(
        both(&run(&["--max-gap", "0.1"])),
        words("cleaned", "cleaned")
    );
    assert_eq!(
        both(&run(&["--max-gap", "0.1", "--again"])),
        words("cleaned", "cleaned")
    );
    assert_eq!(
        both(&run(&["--max-gap", "0.1"])),
        words("unchanged", "unchanged")
    );
}

#[test]
fn a_bad_file_stops_no_other_and_is_told() {
    let folder = Folder::new();
    folder.put("in/a.csv", with_gaps());
    for (name, content) in [
        ("in/cut.c3d", &b"\x02\x50\x01\x00\x00"[..]),
        ("in/empty.trc", b""),
        ("in/words.csv", b"neither,one\nnor,the\n"),
        ("in/x.bvh", b"HIERARCHY\nROOT a\n{\n"),
        (
            "in/y.amc",
            b"#!OML:ASF\n:FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 0 0 0 0 0\n",
        ),
    ] {
        folder.put(name, content);
    }
    let run = || folder.clean(&["in", "-o", "out", "--fps", "120", "--up", "y"]);
    let (code, said) = run();
    assert_eq!(code, 1, "{said}");
    assert_eq!(fate(&said, "a.csv"), "cleaned");
    for name in ["cut.c3d", "empty.trc", "words.csv", "x.bvh", "y.amc"] {
        assert_eq!(fate(&said, name), "failed", "{said}");
        assert!(said.contains(&format!("clean: in/{name}")), "{said}");
        assert!(!folder.at(&format!("out/{name}")).exists());
        let row = folder.row("out", name);
        let error = row["error"].as_str().unwrap();
        assert!(row["outcome"] == "failed" && error.contains(name), "{row}");
        assert_eq!(folder.record(&format!("out/{name}"))["error"], error);
        assert_eq!(row["record"], format!("{name}.json"));
    }
    // Their records stay as they are, block no later run, and give nobody's file away.
    let written = |name: &str| fs::metadata(folder.at(name)).unwrap().modified().unwrap();
    let time = written("out/words.csv.json");
    assert_eq!(run().0, 1);
    assert_eq!(written("out/words.csv.json"), time);
    folder.put("out/words.csv", "mine");
    folder.put("in/words.csv", with_gaps());
    let said = run().1;
    assert!(said.contains("no run of clean made it"), "{said}");
    assert_eq!(fs::read(folder.at("out/words.csv")).unwrap(), b"mine");
    assert_eq!(fate(&said, "words.csv"), "failed");
    fs::remove_file(folder.at("out/words.csv")).unwrap();
    assert_eq!(fate(&run().1, "words.csv"), "cleaned");
    assert_eq!(folder.record("out/words.csv")["error"], Value::Null);
    folder.put("in/words.csv", "neither,one\nnor,the\n");
    let page = fs::read_to_string(folder.at("out/clean.html")).unwrap();
    assert!(
        page.contains("skeleton") && page.contains("cut.c3d"),
        "{page}"
    );
    // Alone, it is an error as of any command.
    let bad = folder.at("in/words.csv");
    fails(
        "clean",
        &[text(&bad), "-o", text(&folder.at("x.csv"))],
        b"",
        1,
    );
}

#[test]
fn a_killed_run_goes_on_where_it_was() {
    let folder = Folder::new();
    let gaps = with_gaps();
    const FILES: usize = 9;
    for i in 0..FILES {
        folder.put(
            &format!("in/{i}.csv"),
            gaps.replace("07_01", &format!("walk{i}")),
        );
    }
    let killed = |out: &str| {
        let mut child = std::process::Command::new(bin().join("clean"))
            .current_dir(folder.0.path())
            .args(["in", "-o", out, "--threads", "1"])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // A record has its result's digest once that is whole.
        let is_done = |i: &usize| {
            let record = fs::read_to_string(folder.at(&format!("{out}/{i}.csv.json")));
            record.is_ok_and(|text| text.contains("\"output\""))
        };
        while !is_done(&1) && child.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        (0..FILES).filter(is_done).count()
    };
    // Where this test got no time meanwhile, a run may have ended before.
    let outs: Vec<String> = (0..9).map(|i| format!("out{i}")).collect();
    let runs = outs.iter().map(|out| (out, killed(out)));
    let (out, done) = runs.into_iter().find(|run| run.1 < FILES).unwrap();
    let (_, said) = folder.clean(&["in", "-o", out]);
    let count = |word: &str| said.lines().filter(|l| l.ends_with(word)).count();
    assert_eq!(
        (count("unchanged"), count("cleaned")),
        (done, FILES - done),
        "{said}"
    );
    let once = folder.clean(&["in", "-o", "again"]);
    assert!(once.0 == 0 || once.0 == 3);
    for i in 0..FILES {
        let name = format!("{i}.csv");
        let of = |out: &str| fs::read(folder.at(out).join(&name)).unwrap();
        assert_eq!(of(out), of("again"));
    }
}

#[test]
fn rotations_stay_but_for_what_is_missing() {
    let folder = Folder::new();
    let table: Vec<String> = walk().lines().take(150).map(str::to_string).collect();
    let bvh = run("xyz2bvh", &["-q"], &(table.join("\n") + "\n"));
    let (head, rows) = bvh.split_once("Frame Time").unwrap();
    let (time, rows) = rows.split_once('\n').unwrap();
    let gaps = |(t, row): (usize, &str)| {
        let mut cells: Vec<&str> = row.split(' ').collect();
        if (60..80).contains(&t) {
            cells[12..15].fill("nan");
        }
        cells.join(" ") + "\n"
    };
    let rows: String = rows.lines().enumerate().map(gaps).collect();
    let broken = format!("{head}Frame Time{time}\n{rows}");
    folder.put("in/a.bvh", &broken);
    let testdata = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    for name in ["07.asf", "07_01.amc"] {
        folder.put(
            &format!("in/{name}"),
            fs::read(testdata.join(name)).unwrap(),
        );
    }
    let (_, said) = folder.clean(&["in", "-o", "out", "--fps", "120"]);
    assert_eq!(fate(&said, "a.bvh"), "cleaned", "{said}");
    assert_eq!(fate(&said, "07_01.amc"), "copied", "{said}");
    assert_eq!(folder.row("out", "07_01.amc")["outcome"], "copied");
    let whole = fs::read_to_string(folder.at("out/a.bvh")).unwrap();
    for (was, is) in broken.split(' ').zip(whole.split(' ')) {
        assert!(was == is || was == "nan" && is != "nan");
    }
    // A gap that is too long stays, in the file and in the record.
    let (code, said) = folder.clean(&["in/a.bvh", "-o", "long.bvh", "--max-gap", "0.1"]);
    assert!(
        code == 3 && said.contains("60 values of the file are still nan"),
        "{said}"
    );
    assert_eq!(fs::read_to_string(folder.at("long.bvh")).unwrap(), broken);
    let amc = |folder_of: PathBuf| fs::read(folder_of.join("07_01.amc")).unwrap();
    assert_eq!(amc(folder.at("in")), amc(folder.at("out")));
    let (_, said) = folder.clean(&["in", "-o", "csv", "--fps", "120", "--to", "csv"]);
    let table = fs::read_to_string(folder.at("csv/07_01.csv")).unwrap();
    assert_eq!(Numbers::read(&table).missing(), 0, "{said}");
}

#[test]
fn noise_is_removed_where_there_is_much_and_a_clean_take_keeps_its_text() {
    let folder = Folder::new();
    let whole: Vec<String> = walk().lines().take(200).map(str::to_string).collect();
    let whole = whole.join("\n") + "\n";
    folder.put("whole.csv", &whole);
    folder.put(
        "noisy.csv",
        run("corrupt", &["-q", "--dense", "0.5"], &whole),
    );
    let (_, said) = folder.clean(&["whole.csv", "noisy.csv", "-o", "out"]);
    let result = |name: &str| fs::read_to_string(folder.at("out").join(name)).unwrap();
    let cells = |table: &str| {
        table
            .split([',', '\n'])
            .map(str::to_string)
            .collect::<Vec<_>>()
    };
    let outliers = folder.record("out/whole.csv")["summary"]["outliers"].as_u64();
    let same = result("whole.csv");
    let (same, was) = (cells(&same), cells(&whole));
    let changed = same.iter().zip(&was).filter(|(a, b)| a != b);
    let changed = changed.count() as u64;
    assert!(
        changed <= 3 * outliers.unwrap() && changed <= 6,
        "{changed} {said}"
    );
    let truth = Numbers::read(&whole);
    let off = |table: &str| Numbers::read(table).rms(&truth);
    let noisy = fs::read_to_string(folder.at("noisy.csv")).unwrap();
    assert!(off(&result("noisy.csv")) < 0.6 * off(&noisy), "{said}");
    assert_eq!(folder.record("out/noisy.csv")["summary"]["denoised"], true);
    assert_eq!(folder.record("out/whole.csv")["summary"]["denoised"], false);
}

#[test]
fn zeros_are_missing_only_where_that_is_said() {
    let folder = Folder::new();
    let mut lines: Vec<String> = walk().lines().take(120).map(str::to_string).collect();
    for line in &mut lines[50..60] {
        let mut cells: Vec<&str> = line.split(',').collect();
        cells[8..11].fill("0");
        *line = cells.join(",");
    }
    folder.put("a.csv", lines.join("\n") + "\n");
    let kept = folder.clean(&["a.csv", "-o", "kept.csv", "--outliers", "none"]);
    assert_eq!(kept.0, 3);
    assert!(kept.1.contains("zeros: "), "{}", kept.1);
    let same = |name: &str| {
        let [was, is] = ["a.csv", name].map(|name| fs::read(folder.at(name)).unwrap());
        assert!(was == is, "{name}");
    };
    same("kept.csv");
    // Nor are true positions beside them changed: no others than without zeros.
    let whole: Vec<String> = walk().lines().take(120).map(str::to_string).collect();
    folder.put("whole.csv", whole.join("\n") + "\n");
    let changed = |name: &str| {
        folder.clean(&[name, "-o", "out", "--again"]);
        let [was, is] = [name.to_string(), format!("out/{name}")]
            .map(|name| fs::read_to_string(folder.at(&name)).unwrap());
        let cells = |text: &str| {
            text.split([',', '\n'])
                .map(String::from)
                .collect::<Vec<_>>()
        };
        let (was, is) = (cells(&was), cells(&is));
        (0..was.len())
            .filter(|k| was[*k] != is[*k])
            .collect::<Vec<_>>()
    };
    assert_eq!(changed("a.csv"), changed("whole.csv"));
    let args = [
        "a.csv",
        "-o",
        "out.csv",
        "--outliers",
        "none",
        "--zeros-are-missing",
    ];
    let (code, said) = folder.clean(&args);
    assert_eq!(code, 0, "{said}");
    assert_eq!(folder.record("out.csv")["summary"]["filled"], 10);
}

#[test]
fn a_capture_is_never_overwritten_and_results_never_collide() {
    let folder = Folder::new();
    let path = folder.put("in/a.csv", with_gaps());
    let path = text(&path);
    fails("clean", &[path, "-o", path], b"", 2);
    fails("clean", &[path, "-o", text(&folder.at("in"))], b"", 2);
    folder.put("b/a.csv", with_gaps());
    let said = folder.clean(&["in/a.csv", "b/a.csv", "-o", "out"]);
    assert_eq!(said.0, 2, "{}", said.1);
    // Captures that are no inputs of the run, and a page in the place of one.
    folder.put("raw/a.csv", "mine");
    folder.put("raw/day1/a.csv", with_gaps());
    let (code, said) = folder.clean(&["raw/day1", "-o", "raw"]);
    assert!(
        code == 1 && said.contains("no record that clean made it"),
        "{said}"
    );
    let page = folder.clean(&["raw/day1", "-o", "out", "--page", "raw/a.csv"]);
    assert_eq!(page.0, 1, "{}", page.1);
    folder.put("kept/a.csv.json", "{\"of\": \"somebody\"}");
    let (code, said) = folder.clean(&["raw/day1", "-o", "kept"]);
    assert!(
        code == 1 && said.contains("stands in the place of a record"),
        "{said}"
    );
    assert!(!folder.at("kept/a.csv").exists());
    // A capture that broke since.
    assert_eq!(folder.clean(&["raw/day1", "-o", "broke"]).0, 0);
    folder.put("raw/day1/a.csv", "x");
    let (_, said) = folder.clean(&["raw/day1", "-o", "broke"]);
    assert!(said.contains("failed, old result stays"), "{said}");
    assert_eq!(fs::read(folder.at("raw/a.csv")).unwrap(), b"mine");
    assert_eq!(folder.clean(&["raw", "-o", "raw"]).0, 2);
    assert_eq!(folder.clean(&["in/a.csv", "-o", "a.bvh"]).0, 2);
    assert_eq!(folder.clean(&["in/a.csv", "-o", "-"]).0, 2);
    fs::create_dir(folder.at("empty")).unwrap();
    assert_eq!(folder.clean(&["empty", "-o", "out"]).0, 1);
}

#[test]
fn every_format_of_the_collection_is_cleaned_or_refused_with_a_reason() {
    let Some(formats) = shared("data/formats") else {
        return;
    };
    let folder = Folder::new();
    let run = || {
        folder.clean(&[
            text(&formats),
            "-o",
            "out",
            "--fps",
            "120",
            "--units",
            "mm",
            "--up",
            "z",
            "--force",
        ])
    };
    let (code, said) = run();
    assert_eq!(code, 1);
    let failed = |said: &str| {
        let lines = said.lines().filter(|l| l.ends_with(" failed"));
        lines
            .map(|l| l.split(' ').next().unwrap().to_string())
            .collect::<Vec<_>>()
    };
    let refused = failed(&said);
    for name in &refused {
        let told = said
            .lines()
            .any(|l| l.starts_with("clean: ") && l.contains(name.as_str()));
        assert!(told, "{name}\n{said}");
    }
    // Without bytes or frames, or cut short by their publisher.
    let names = [
        "Empty.c3d",
        "Empty.trc",
        "Truncated.trc",
        "motive-example.csv",
    ];
    let is_known = |path: &String| names.iter().any(|n| path.ends_with(n));
    let unknown: Vec<&String> = refused.iter().filter(|p| !is_known(p)).collect();
    assert!(unknown.is_empty(), "{unknown:?}\n{said}");
    let (_, again) = run();
    assert_eq!(failed(&again), refused);
    assert!(again.contains(" 0 cleaned"), "{again}");
}

/// A body of ten points that walks, 120 frames a second, without anything to find; `change` is
/// given each row (30 cells).
fn sound(change: impl Fn(usize, &mut Vec<String>)) -> String {
    let mut text = String::from("take,time");
    (0..10).for_each(|p| text += &format!(",p{p}.x,p{p}.y,p{p}.z"));
    for t in 0..240 {
        let time = t as f64 / 120.0;
        let cell = |c: usize| {
            let swing = 2.4 * (6.0 * time + (c / 3) as f64).sin();
            format!(
                "{:.5}",
                match c % 3 {
                    0 => 5.0 * (c / 3) as f64 % 15.0 + swing + 1.0,
                    1 => 6.0 * c as f64 + 5.0,
                    _ => 120.0 * time + swing,
                }
            )
        };
        let mut row: Vec<String> = (0..30).map(cell).collect();
        change(t, &mut row);
        text += &format!("\nw,{time:.6},{}", row.join(","));
    }
    text + "\n"
}

/// Its point `p` is missing for .8 s.
fn without(p: usize) -> String {
    sound(|t, row| {
        if (60..156).contains(&t) {
            row[3 * p..3 * p + 3].fill(String::new());
        }
    })
}

#[test]
fn the_exit_code_is_1_for_failures_and_3_for_findings_alone() {
    let folder = Folder::new();
    folder.put("in/a.csv", sound(|_, _| ()));
    let run = || folder.clean(&["in", "-o", "out", "--max-gap", "0.5"]);
    assert_eq!(run().0, 0);
    assert_eq!(folder.row("out", "a.csv")["outcome"], "copied");
    assert!(!folder.at("out/a.csv.html").exists(), "nothing to see");
    folder.put("in/b.csv", without(4));
    assert_eq!(run().0, 3);
    let row = folder.row("out", "b.csv");
    let findings = row["findings"].as_array().unwrap();
    assert!(findings[0].as_str().unwrap().contains("p4"), "{row}");
    assert_eq!(
        (&row["missing"], &row["filled"], &row["rate"]),
        (&96.into(), &0.into(), &120.0.into())
    );
    folder.put("in/c.c3d", "x");
    assert_eq!(run().0, 1);
    assert_eq!(folder.row("out", "a.csv")["outcome"], "unchanged");
    // A list of somebody else is not written over.
    folder.put("other/clean.json", "[]x");
    assert_eq!(folder.clean(&["in", "-o", "other"]).0, 1);
    assert_eq!(fs::read(folder.at("other/clean.json")).unwrap(), b"[]x");
    assert!(!folder.at("other/a.csv").exists());
}

#[test]
fn only_what_is_new_is_told_with_new_only() {
    let folder = Folder::new();
    folder.put("in/h.csv", without(4));
    folder.put("in/bad.c3d", "x");
    let run = || folder.clean(&["in", "-o", "out", "--max-gap", "0.5", "--new-only"]);
    let (code, said) = run();
    assert!(
        code == 1 && said.contains("p4") && said.contains("bad.c3d"),
        "{said}"
    );
    let (code, said) = run();
    assert!(
        code == 0 && !said.contains("p4") && !said.contains("bad.c3d"),
        "{said}"
    );
    assert!(said.contains("1 failed; findings in 1, new in 0"), "{said}");
    folder.put("in/k.csv", without(7));
    let (code, said) = run();
    assert!(
        code == 3 && said.contains("p7") && !said.contains("p4"),
        "{said}"
    );
    // Without the flag, all of it is told again.
    let (code, said) = folder.clean(&["in", "-o", "out", "--max-gap", "0.5"]);
    assert!(
        code == 1 && said.contains("p7") && said.contains("p4"),
        "{said}"
    );
}

/// A finding of another capture is new, also where its words are those of the last one.
#[test]
fn a_new_capture_has_new_findings() {
    let folder = Folder::new();
    folder.put("in/h.csv", without(4));
    folder.put("in/bad.c3d", "x");
    let run = || folder.clean(&["in", "-o", "out", "--max-gap", "0.5", "--new-only"]);
    run();
    assert_eq!(run().0, 0);
    folder.put("in/h.csv", without(4).replace("\nw,", "\nv,"));
    let (code, said) = run();
    assert!(
        code == 3 && said.contains("p4") && !said.contains("bad"),
        "{said}"
    );
    folder.put("in/bad.c3d", "y");
    assert_eq!(run().0, 1);
    let digest = folder.row("out", "h.csv")["sha256"].clone();
    let made_from = folder.record("out/h.csv")["made_from"].clone();
    assert_eq!(digest, made_from["input"]["sha256"]);
}

/// Where nobody reads the table, nothing counts as told, and the exit code is that of the run.
#[test]
fn a_reader_that_is_gone_was_told_nothing() {
    let folder = Folder::new();
    folder.put("in/h.csv", without(4));
    folder.put("in/bad.c3d", "x");
    let args = ["in", "-o", "out", "--max-gap", "0.5", "--new-only"];
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let done = std::process::Command::new(bin().join("clean"))
        .current_dir(folder.0.path())
        .args(args)
        .stdout(writer)
        .stderr(Stdio::null())
        .status()
        .unwrap();
    assert_eq!(done.code(), Some(1));
    assert!(!folder.at("out/clean.json").exists());
    let (code, said) = folder.clean(&args);
    assert!(code == 1 && said.contains("p4"), "{said}");
}

#[test]
fn flags_that_would_do_harm_are_refused() {
    let folder = Folder::new();
    folder.put("in/a.csv", sound(|_, _| ()));
    let (code, said) = folder.clean(&["in", "-o", "out", "--page", "p.json"]);
    assert!(code == 2 && said.contains("--page"), "{said}");
    let (code, said) = folder.clean(&["in/a.csv", "-o", "b.csv", "--new-only"]);
    assert!(code == 2 && said.contains("--new-only"), "{said}");
    assert!(!folder.at("b.csv").exists() && !folder.at("out").exists());
}

/// Runs `clean` in a folder with a limit of the size of files, in 512 bytes; its exit code.
#[cfg(target_os = "linux")]
fn clean_limited(folder: &Folder, limit: u32, args: &str) -> Option<i32> {
    let clean = bin().join("clean");
    let line = format!("ulimit -f {limit}; exec {} {args}", text(&clean));
    let mut sh = std::process::Command::new("sh");
    let sh = sh.args(["-c", &line]).current_dir(folder.0.path());
    sh.stdout(Stdio::null()).stderr(Stdio::null());
    sh.status().unwrap().code()
}

/// A result that could not be replaced keeps its record, by which it is known whether somebody
/// changed it.
#[cfg(target_os = "linux")]
#[test]
fn a_write_that_fails_leaves_the_record_of_what_is_there() {
    let folder = Folder::new();
    folder.put("a.csv", sound(|_, _| ()));
    assert_eq!(folder.clean(&["a.csv", "-o", "b.csv"]).0, 0);
    let record = folder.record("b.csv");
    folder.put("a.csv", sound(|_, row| row[0] += "1"));
    assert_eq!(clean_limited(&folder, 40, "a.csv -o b.csv"), Some(1));
    let now = folder.record("b.csv");
    assert!(now["error"].is_string(), "{now}");
    assert_eq!(now["output"], record["output"]);
    // What somebody changed is not made again after such a failure either.
    folder.put("b.csv", "mine");
    let again = clean_limited(&folder, 40, "a.csv -o b.csv --again");
    assert_eq!(again, Some(1));
    let (code, said) = folder.clean(&["a.csv", "-o", "b.csv"]);
    assert!(code == 1 && said.contains("was changed since"), "{said}");
    assert_eq!(fs::read(folder.at("b.csv")).unwrap(), b"mine");
}

/// What a killed run left is made again, but not what somebody put there since.
#[test]
fn a_killed_run_gives_no_file_of_somebody_away() {
    let folder = Folder::new();
    folder.put("a.csv", sound(|_, _| ()));
    let run = |more: &[&str]| folder.clean(&[&["a.csv", "-o", "b.csv"], more].concat());
    let stopped = |replaces: &Value| {
        let record = folder.record("b.csv");
        let bare = serde_json::json!({
            "command": "clean", "made_from": record["made_from"], "replaces": replaces,
        });
        folder.put("b.csv.json", bare.to_string());
    };
    assert_eq!(run(&[]).0, 0);
    let digest = folder.record("b.csv")["output"]["sha256"].clone();
    // After the result, before its record.
    stopped(&Value::Null);
    assert_eq!(run(&[]).0, 0);
    assert_eq!(folder.record("b.csv")["output"]["sha256"], digest);
    // Before the result, which is to replace that.
    folder.put("a.csv", sound(|_, row| row[0] += "1"));
    stopped(&digest);
    assert_eq!(run(&[]).0, 0);
    assert_ne!(folder.record("b.csv")["output"]["sha256"], digest);
    stopped(&digest);
    folder.put("b.csv", "mine");
    for _ in 0..2 {
        let (code, said) = run(&[]);
        assert!(code == 1 && said.contains("was stopped"), "{said}");
        assert_eq!(fs::read(folder.at("b.csv")).unwrap(), b"mine");
    }
    assert_eq!(run(&["--again"]).0, 0);
}

/// The result and its record are whole where the page, which is larger, cannot be written.
#[cfg(target_os = "linux")]
#[test]
fn a_page_that_cannot_be_written_is_a_finding() {
    let folder = Folder::new();
    folder.put("a.csv", without(4));
    assert_eq!(
        folder
            .clean(&["a.csv", "-o", "b.csv", "--max-gap", "0.5"])
            .0,
        3
    );
    let size = |name: &str| fs::metadata(folder.at(name)).unwrap().len();
    let result = size("b.csv").max(size("b.csv.json"));
    let limit = u32::try_from(result.div_ceil(512) + 2).unwrap();
    assert!(size("b.csv.html") > u64::from(limit) * 512);
    let code = clean_limited(&folder, limit, "a.csv -o c.csv --max-gap 0.5");
    assert_eq!(code, Some(3));
    assert_eq!(size("c.csv"), size("b.csv"));
    let findings = folder.record("c.csv")["summary"]["findings"].to_string();
    assert!(findings.contains("page: not written"), "{findings}");
    assert!(!folder.at("c.csv.html").exists());
}

#[test]
fn only_what_is_left_of_a_stretch_done_again_is_told() {
    let folder = Folder::new();
    let table = without(4);
    folder.put("a.trc", run("xyz2trc", &["-q"], &table));
    let redo = |out: &str, stretch: &str| {
        let args = ["a.trc", "-o", out, "--up", "y", "--max-gap", "0.5"];
        let (_, said) = folder.clean(&[&args[..], &["--redo", stretch]].concat());
        said.contains("could not be filled again")
    };
    // The point is missing from .5 to 1.3 s.
    assert!(!redo("b.trc", "p4:1.6-1.7"));
    assert!(redo("c.trc", "p4:1.3-1.4"));
}

#[test]
fn the_page_links_to_takes_records_and_places() {
    let folder = Folder::new();
    folder.put("in/Lab 1/a#.csv", without(4));
    folder.put("in/c.c3d", "x");
    folder.clean(&["in", "-o", "out"]);
    let page = fs::read_to_string(folder.at("out/clean.html")).unwrap();
    let addresses: Vec<&str> = (page.split("<a href=\"").skip(1))
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    let has = |address: &str| assert!(addresses.contains(&address), "{address}: {addresses:?}");
    has("Lab%201/a%23.csv.html");
    has("Lab%201/a%23.csv.html#frame=60&amp;trail=p4");
    has("Lab%201/a%23.csv.json");
    has("c.c3d.json");
    let row = folder.row("out", "Lab 1/a#.csv");
    assert_eq!(row["result"], "Lab 1/a#.csv");
    assert_eq!(row["page"], "Lab 1/a#.csv.html");
    let take = fs::read_to_string(folder.at("out/Lab 1/a#.csv.html")).unwrap();
    assert!(take.contains("<script type=\"application/json\">"));
    // A second run writes nothing but the page and the list.
    let time = || {
        fs::metadata(folder.at("out/Lab 1/a#.csv.html"))
            .unwrap()
            .modified()
            .unwrap()
    };
    let written = time();
    folder.clean(&["in", "-o", "out"]);
    assert_eq!(time(), written);
    assert_eq!(
        fs::read_to_string(folder.at("out/clean.html"))
            .unwrap()
            .matches("#frame=")
            .count(),
        page.matches("#frame=").count()
    );
    // Somebody's page stays.
    folder.put("mine/Lab 1/a#.csv.html", "mine");
    let (_, said) = folder.clean(&["in", "-o", "mine"]);
    assert_eq!(
        fs::read(folder.at("mine/Lab 1/a#.csv.html")).unwrap(),
        b"mine"
    );
    let notes = folder.row("mine", "Lab 1/a#.csv")["notes"].to_string();
    assert!(
        notes.contains("is there and is none of posing's"),
        "{said} {notes}"
    );
}

#[test]
fn a_bad_stretch_is_done_again() {
    let folder = Folder::new();
    let truth = sound(|_, _| ());
    let bad = sound(|t, row| {
        if (100..120).contains(&t) {
            row[12] = format!("{:.5}", row[12].parse::<f64>().unwrap() + 2.0);
        }
    })
    .replace("p4.", "Ann:p4.");
    folder.put("a.csv", &bad);
    let (_, said) = folder.clean(&["a.csv", "-o", "b.csv", "--redo", "Ann:p4:0.8333-0.9917"]);
    let table = fs::read_to_string(folder.at("b.csv")).unwrap();
    let (far, _) = Numbers::read(&table.replace("Ann:", "")).far(&Numbers::read(&truth));
    assert!(far < 0.5, "{far} {said}");
    let record = folder.record("b.csv");
    assert_eq!(record["summary"]["filled"], 20);
    assert_eq!(record["redone"][0]["point"], "Ann:p4");
    for (was, is) in bad.lines().zip(table.lines()) {
        let differ = was.split(',').zip(is.split(',')).enumerate();
        let differ: Vec<usize> = differ
            .filter(|(_, (a, b))| a != b)
            .map(|(i, _)| i)
            .collect();
        assert!(differ.iter().all(|i| (14..17).contains(i)), "{differ:?}");
    }
    // It stays so in later runs without the flag, such as those of a night.
    let (_, said) = folder.clean(&["a.csv", "-o", "b.csv"]);
    assert!(said.contains("1 unchanged"), "{said}");
    assert_eq!(fs::read_to_string(folder.at("b.csv")).unwrap(), table);
    let code = |args: &[&str]| folder.clean(&[&["a.csv", "-o", "c.csv"], args].concat()).0;
    assert_eq!(code(&["--redo", "p5:2-1"]), 2);
    assert_eq!(code(&["--redo", "q:0-1"]), 1);
    assert_eq!(code(&["--redo", "p5:7-8"]), 1);
    let several = folder.clean(&["a.csv", "b.csv", "-o", "out", "--redo", "p5:0-1"]);
    assert_eq!(several.0, 2, "{}", several.1);
}

#[test]
fn positions_are_smoothed_as_by_trim() {
    let folder = Folder::new();
    folder.put("a.csv", sound(|_, _| ()));
    folder.clean(&["a.csv", "-o", "b.csv", "--butterworth", "6Hz"]);
    let smooth = run(
        "trim",
        &["-q", "--butterworth", "6", text(&folder.at("a.csv"))],
        "",
    );
    let table = fs::read_to_string(folder.at("b.csv")).unwrap();
    let (far, _) = Numbers::read(&table).far(&Numbers::read(&smooth));
    assert!(far < 1e-9, "{far}");
    assert_eq!(
        folder.record("b.csv")["made_from"]["settings"]["butterworth"],
        6.0
    );
    let said = folder.clean(&["a.csv", "-o", "c.csv", "--butterworth", "60"]);
    assert!(said.0 == 1 && said.1.contains("below .4"), "{}", said.1);
}

/// The numbers of the frames of a BVH file.
fn bvh_frames(text: &str) -> Vec<Vec<f64>> {
    let rows = text.split("Frame Time:").nth(1).unwrap().lines().skip(1);
    rows.map(|l| l.split_whitespace().map(|w| w.parse().unwrap()).collect())
        .collect()
}

#[test]
fn noisy_rotations_are_smoothed_in_their_own_channels() {
    let folder = Folder::new();
    let table: Vec<String> = walk().lines().take(240).map(str::to_string).collect();
    let truth = run("xyz2bvh", &["-q"], &(table.join("\n") + "\n"));
    let frames = bvh_frames(&truth);
    let (head, rows) = truth.split_once("Frame Time").unwrap();
    let time = rows.lines().next().unwrap();
    // A degree, white.
    let noise = |t: usize, c: usize| {
        let x = (t * 97 + c * 57) as f64;
        ((x * 12.9898).sin() * 43758.5453).rem_euclid(1.0) * 3.46 - 1.73
    };
    let row = |(t, row): (usize, &Vec<f64>)| {
        let cells = row.iter().enumerate();
        let cells = cells.map(|(c, v)| format!("{:.4}", if c < 3 { *v } else { v + noise(t, c) }));
        cells.collect::<Vec<_>>().join(" ") + "\n"
    };
    let rows: String = frames.iter().enumerate().map(row).collect();
    let noisy = format!("{head}Frame Time{time}\n{rows}");
    folder.put("in/a.bvh", &noisy);
    let (_, said) = folder.clean(&["in", "-o", "out"]);
    assert_eq!(fate(&said, "a.bvh"), "cleaned", "{said}");
    assert!(said.contains("deg removed"), "{said}");
    let clean = fs::read_to_string(folder.at("out/a.bvh")).unwrap();
    assert_eq!(clean.split("MOTION").next(), noisy.split("MOTION").next());
    let off = |text: &str| {
        let (mut sum, mut count) = (0.0, 0);
        for (a, b) in bvh_frames(text).iter().zip(&frames) {
            for (a, b) in a[3..].iter().zip(&b[3..]) {
                (sum, count) = (sum + (a - b).powi(2), count + 1);
            }
        }
        (sum / f64::from(count)).sqrt()
    };
    assert!(
        off(&clean) < 0.7 * off(&noisy),
        "{} {}",
        off(&clean),
        off(&noisy)
    );
    let record = folder.record("out/a.bvh");
    let joints = record["rotations"]["joints"].as_array().unwrap();
    assert!(
        joints
            .iter()
            .any(|j| j["smoothed"]["cutoff_hz"].as_f64() > Some(0.0))
    );
    // Again: nothing to do; another limit: done again.
    assert!(folder.clean(&["in", "-o", "out"]).1.contains("1 unchanged"));
    let (_, said) = folder.clean(&["in", "-o", "out", "--noise-limit", "9deg"]);
    assert_eq!(fate(&said, "a.bvh"), "copied", "{said}");
    let (code, said) = folder.clean(&["in", "-o", "left", "--no-smooth"]);
    assert!(code == 3 && said.contains("degrees stay"), "{said}");
    assert_eq!(fs::read_to_string(folder.at("left/a.bvh")).unwrap(), noisy);
    assert_eq!(
        folder.clean(&["in", "-o", "x", "--noise-limit", "1turn"]).0,
        2
    );
}

/// A take of a skeleton's own angles: what pops is put back, and all else stays.
#[test]
fn angles_of_an_amc_file_that_pop_are_put_back() {
    let folder = Folder::new();
    let testdata = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let read = |name: &str| fs::read_to_string(testdata.join(name)).unwrap();
    folder.put("07.asf", read("07.asf"));
    let whole = read("07_01.amc");
    let mut lines: Vec<String> = whole.lines().map(str::to_string).collect();
    let at = lines.iter().position(|l| l == "50").unwrap();
    let line = (at..).find(|&l| lines[l].starts_with("ltibia ")).unwrap();
    let angle: f64 = lines[line][7..].trim().parse().unwrap();
    lines[line] = format!("ltibia {:.4}", angle + 60.0);
    folder.put("07_01.amc", lines.join("\n") + "\n");
    let (_, said) = folder.clean(&["07_01.amc", "-o", "out.amc", "--fps", "120"]);
    assert_eq!(fate(&said, "07_01.amc"), "cleaned", "{said}");
    let result = fs::read_to_string(folder.at("out.amc")).unwrap();
    let result: Vec<&str> = result.lines().collect();
    for (l, (is, was)) in result.iter().zip(&lines).enumerate() {
        assert!(l == line || is == was, "{is} {was}");
    }
    let found: f64 = result[line][7..].trim().parse().unwrap();
    assert!((found - angle).abs() < 1.0, "{found} {angle}");
    assert_eq!(folder.record("out.amc")["summary"]["outliers"], 1);
}

#[test]
fn axes_are_given_by_format_and_by_folder() {
    let folder = Folder::new();
    let trc = run("xyz2trc", &["-q"], &sound(|_, _| ()));
    folder.put("in/y/a.trc", &trc);
    folder.put("in/a.csv", sound(|_, _| ()));
    let up = |args: &[&str]| {
        folder.clean(&[&["in", "-o", "out"], args].concat());
        let of = |result: &str| folder.record(result)["read_as"]["up"]["value"].clone();
        (of("out/y/a.trc"), of("out/a.csv"))
    };
    let said = (Value::from("y"), Value::from("z"));
    assert_eq!(up(&["--up", "csv=z", "--up", "trc=y", "--force"]), said);
    // What a flag says of another format changes nothing here.
    let again = folder.clean(&["in", "-o", "out", "--up", "csv=z,trc=y,c3d=x", "--force"]);
    assert!(again.1.contains("2 unchanged"), "{}", again.1);
    assert_eq!(up(&["--up", "z,in/y=y", "--force"]), said);
    assert_eq!(folder.clean(&["in", "-o", "out", "--up", "c4d=z"]).0, 2);
}

#[test]
fn a_record_is_no_larger_than_its_take() {
    let folder = Folder::new();
    let every_second = sound(|t, row| {
        for p in 0..10 {
            if (t + p) % 2 == 0 {
                row[3 * p..3 * p + 3].fill(String::new());
            }
        }
    });
    folder.put("a.csv", &every_second);
    folder.clean(&["a.csv", "-o", "b.csv"]);
    let record = fs::metadata(folder.at("b.csv.json")).unwrap().len();
    assert!(record <= every_second.len() as u64, "{record}");
    let record = folder.record("b.csv");
    assert_eq!(record["gaps"].as_array().unwrap().len(), 0);
    assert_eq!(record["gaps_by_point"][0]["gaps"], 120);
}

/// Held rotations are found by audit; filled, they are nearer to the truth, and every other byte
/// stays.
#[test]
fn held_rotations_are_found_and_filled() {
    let Some(file) = crate::common::shared("data/field/bvh-held-rotation.bvh") else {
        return;
    };
    let held = fs::read_to_string(&file).unwrap();
    let truth = fs::read_to_string(file.with_extension("truth.bvh")).unwrap();
    let done = crate::common::command("audit").arg(&file).assert().code(3);
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert_eq!(
        said.matches("RightForeArm stands still in frames 40 to 60")
            .count(),
        1,
        "{said}"
    );
    let folder = Folder::new();
    folder.put("a.bvh", held.clone());
    let (code, said) = folder.clean(&["a.bvh", "-o", "kept.bvh"]);
    assert_eq!(code, 3, "{said}");
    assert_eq!(fs::read_to_string(folder.at("kept.bvh")).unwrap(), held);
    folder.clean(&["a.bvh", "-o", "filled.bvh", "--held-is-missing"]);
    let filled = fs::read_to_string(folder.at("filled.bvh")).unwrap();
    let rows = |text: &str| -> Vec<Vec<String>> {
        let rows = text.split("Frame Time:").nth(1).unwrap().lines().skip(1);
        rows.map(|l| l.split_whitespace().map(String::from).collect())
            .collect()
    };
    assert_eq!(
        held.split("Frame Time:").next(),
        filled.split("Frame Time:").next()
    );
    let (held, filled, truth) = (rows(&held), rows(&filled), rows(&truth));
    let number = |v: &String| v.parse::<f64>().unwrap();
    let (mut before, mut after) = (0.0, 0.0);
    for t in 0..held.len() {
        for c in 0..held[t].len() {
            if held[t][c] == filled[t][c] {
                continue;
            }
            assert!((41..61).contains(&t), "frame {t}, channel {c}");
            let off = |v: &String| (number(v) - number(&truth[t][c])).powi(2);
            (before, after) = (before + off(&held[t][c]), after + off(&filled[t][c]));
        }
    }
    assert!(after > 0.0 && after < 0.36 * before, "{after} {before}");
}

#[test]
fn a_unit_that_is_wrong_stops_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // A body of 20 points, 170 cm tall, that walks; in meters.
    let names = (0..20).map(|p| format!("p{p}.x,p{p}.y,p{p}.z"));
    let mut table = format!("time,{}\n", names.collect::<Vec<_>>().join(","));
    for t in 0..60 {
        table += &format!("{}", f64::from(t) / 60.0);
        for p in 0..20 {
            let p = f64::from(p);
            let (x, y, z) = (
                0.12 * (2.0 * p).sin(),
                0.02 + 0.085 * p,
                0.01 * f64::from(t),
            );
            table += &format!(",{x:.5},{y:.5},{z:.5}");
        }
        table += "\n";
    }
    fs::write(path("m.csv"), &table).unwrap();
    let clean = |flags: &[&str]| {
        let done = command("clean")
            .args([text(&path("m.csv")), "-o", text(&path("out.csv"))])
            .args(flags)
            .output()
            .unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    let (code, said) = clean(&[]);
    assert!(
        code == Some(1) && said.contains("100 times too small"),
        "{code:?} {said}"
    );
    assert!(
        said.contains("meters, not centimeters; give --units m"),
        "{said}"
    );
    assert!(!path("out.csv").exists());
    assert_eq!(clean(&["--units", "m"]).0, Some(0));
    assert_eq!(fs::read_to_string(path("out.csv")).unwrap(), table);
}

/// Joint centers stand beside the result, as solve has them.
#[test]
fn centers_stand_beside_their_result() {
    let Some(file) = shared("data/gait/HC031A_Straight.c3d") else {
        return;
    };
    let folder = Folder::new();
    folder.put("in/walk.c3d", fs::read(file).unwrap());
    let args = ["in", "-o", "out", "--solve=anatomical"];
    let (_, said) = folder.clean(&args);
    assert_eq!(fate(&said, "walk.c3d"), "copied", "{said}");
    let own = folder.at("out/walk.centers.csv");
    let centers = fs::read_to_string(&own).unwrap();
    let head = centers.lines().next().unwrap();
    assert!(
        head.starts_with("take,time,LHJC.x,LHJC.y,LHJC.z,LHJC.sd,LKJC.x"),
        "{head}"
    );
    let record = folder.record("out/walk.c3d");
    assert_eq!(record["solved"]["centers"], "plug-in gait");
    assert_eq!(record["solved"]["output"]["file"], "walk.centers.csv");
    let result = folder.at("out/walk.c3d");
    let solved = command("solve")
        .args(["-q", "--joints", "anatomical", "--sd", text(&result)])
        .output();
    assert_eq!(solved.unwrap().stdout, centers.as_bytes());
    // They are none of the captures, and nobody's file is written over.
    assert!(folder.clean(&args).1.contains("unchanged"));
    let (_, said) = folder.clean(&["out", "-o", "again"]);
    assert!(!said.contains("centers"), "{said}");
    fs::write(&own, "mine").unwrap();
    let (code, said) = folder.clean(&args);
    assert!(code == 1 && said.contains("in the place of"), "{said}");
    assert_eq!(fs::read(&own).unwrap(), b"mine");
    // A skeleton takes their place.
    fs::write(&own, &centers).unwrap();
    folder.clean(&["in", "-o", "out", "--solve"]);
    assert!(folder.at("out/walk.bvh").exists() && !own.exists());
}
