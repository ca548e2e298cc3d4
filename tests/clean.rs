//! `clean`: files of any format, one by one and by the folder.

mod common;

use common::{Numbers, bin, command, fails, run, shared, text};
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
    assert!(
        first.contains("left out, as none of motion or results: 1"),
        "{first}"
    );
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
    let (code, said) = folder.clean(&["in", "-o", "out", "--fps", "120", "--up", "y"]);
    assert_eq!(code, 3, "{said}");
    assert_eq!(fate(&said, "a.csv"), "cleaned");
    for name in ["cut.c3d", "empty.trc", "words.csv", "x.bvh", "y.amc"] {
        assert_eq!(fate(&said, name), "failed", "{said}");
        assert!(said.contains(&format!("clean: in/{name}")), "{said}");
        assert!(!folder.at(&format!("out/{name}")).exists());
    }
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
    for i in 0..6 {
        folder.put(
            &format!("in/{i}.csv"),
            gaps.replace("07_01", &format!("walk{i}")),
        );
    }
    let mut child = std::process::Command::new(bin().join("clean"))
        .current_dir(folder.0.path())
        .args(["in", "-o", "out", "--threads", "1"])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // A record has its result's digest once that is whole.
    let is_done = |i: &usize| {
        let record = fs::read_to_string(folder.at(&format!("out/{i}.csv.json")));
        record.is_ok_and(|text| text.contains("\"output\""))
    };
    while !is_done(&1) {
        assert!(child.try_wait().unwrap().is_none(), "it ended before");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let done = (0..6).filter(is_done).count();
    let (_, said) = folder.clean(&["in", "-o", "out"]);
    let count = |word: &str| said.lines().filter(|l| l.ends_with(word)).count();
    assert_eq!(
        (count("unchanged"), count("cleaned")),
        (done, 6 - done),
        "{said}"
    );
    let once = folder.clean(&["in", "-o", "again"]);
    assert!(once.0 == 0 || once.0 == 3);
    for i in 0..6 {
        let name = format!("{i}.csv");
        let of = |out: &str| fs::read(folder.at(out).join(&name)).unwrap();
        assert_eq!(of("out"), of("again"));
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
    assert_eq!(fate(&said, "07_01.amc"), "cleaned", "{said}");
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
    fails("clean", &[path, "-o", path], b"", 1);
    fails("clean", &[path, "-o", text(&folder.at("in"))], b"", 1);
    folder.put("b/a.csv", with_gaps());
    let said = folder.clean(&["in/a.csv", "b/a.csv", "-o", "out"]);
    assert_eq!(said.0, 2, "{}", said.1);
    // Captures that are no inputs of the run, and a page in the place of one.
    folder.put("raw/a.csv", "mine");
    folder.put("raw/day1/a.csv", with_gaps());
    let (code, said) = folder.clean(&["raw/day1", "-o", "raw"]);
    assert!(
        code == 3 && said.contains("no record that clean made it"),
        "{said}"
    );
    let page = folder.clean(&["raw/day1", "-o", "out", "--page", "raw/a.csv"]);
    assert_eq!(page.0, 1, "{}", page.1);
    folder.put("kept/a.csv.json", "{\"of\": \"somebody\"}");
    let (code, said) = folder.clean(&["raw/day1", "-o", "kept"]);
    assert!(
        code == 3 && said.contains("stands in the place of a record"),
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
    assert_eq!(code, 3);
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

/// Held rotations are found by audit; filled, they are nearer to the truth, and every other byte stays.
#[test]
fn held_rotations_are_found_and_filled() {
    let Some(file) = common::shared("data/field/bvh-held-rotation.bvh") else {
        return;
    };
    let held = fs::read_to_string(&file).unwrap();
    let truth = fs::read_to_string(file.with_extension("truth.bvh")).unwrap();
    let done = common::command("audit").arg(&file).assert().code(3);
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
