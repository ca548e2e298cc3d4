//! What commands print with --json: names that the page has, a stream of its own, all notes.

use crate::common::{bin, command, command_names, fails, run, text};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Objects whose names are those of points, bones, files or arrays, or are told elsewhere.
const FREE: [&str; 8] = [
    "arrays",
    "parameters",
    "range_of_motion_deg",
    "details",
    "body",
    "history",
    "bones/",
    "left_out/",
];

/// A folder with a take, a copy with gaps, and a skeleton.
fn takes() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let cmu = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/09");
    fs::copy(cmu.join("09.asf"), at("09.asf")).unwrap();
    fs::copy(cmu.join("09_06.amc"), at("09_06.amc")).unwrap();
    let gait = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait");
    for name in ["static.c3d", "walk.c3d", "norm.json"] {
        fs::copy(gait.join(name), at(name)).unwrap();
    }
    for line in [
        "amc2xyz --asf 09.asf --fps 120 -o walk.csv 09_06.amc",
        "corrupt -q --gaps 2 --length 0.1 --points 2 -o gaps.csv walk.csv",
        "xyz2bvh -q -o walk.bvh walk.csv",
    ] {
        said(line, folder.path(), 0);
    }
    folder
}

/// What a command prints on both streams.
fn said(line: &str, folder: &Path, code: i32) -> [String; 2] {
    let words: Vec<&str> = line.split(' ').collect();
    let out = Command::new(bin().join(words[0]))
        .args(&words[1..])
        .current_dir(folder)
        .output()
        .unwrap();
    let said = [out.stdout, out.stderr].map(|text| String::from_utf8(text).unwrap());
    assert_eq!(out.status.code(), Some(code), "{line}: {said:?}");
    said
}

/// The names in JSON, but those of [`FREE`] objects.
fn names(value: &Value, at: &str, into: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (name, inner) in map {
                into.insert(name.clone());
                let is_free = FREE.iter().any(|free| match free.strip_suffix('/') {
                    Some(free) => free == name && at.is_empty() == (free == "bones"),
                    None => free == name,
                });
                if !is_free || name == "bones" && inner.get("by_bone").is_some() {
                    names(inner, name, into);
                }
            }
        }
        Value::Array(values) => values.iter().for_each(|value| names(value, at, into)),
        _ => {}
    }
}

#[test]
fn names_are_those_of_the_page() {
    let folder = takes();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = |name: &str| fs::read_to_string(root.join("man").join(name)).unwrap();
    let page_of_json = page("posing-json.5");
    // What the page leaves to others.
    let [of_clean, of_models] = ["posing-formats.7", "posing-table.5"].map(page);
    for (line, code) in [
        ("complete --json -o whole.csv gaps.csv", 0),
        ("denoise --json -o smooth.csv walk.csv", 0),
        ("clean --json -o cleaned.csv gaps.csv", 0),
        ("label --json --dry-run gaps.csv", 0),
        ("audit --json gaps.csv", 0),
        ("score --json --damaged gaps.csv walk.csv whole.csv", 0),
        ("model info --json", 0),
        ("xyz2bvh --json -o new.bvh walk.csv", 0),
        ("xyz2amc --json --asf 09.asf -o new.amc walk.csv", 0),
        ("xyz2glb --json -o new.glb walk.csv", 0),
        ("retarget --json --to walk.bvh -o new.bvh walk.bvh", 0),
        (
            "gait --json --static static.c3d walk.c3d --norm norm.json -o gait",
            0,
        ),
        ("evaluate takes --json --self --gaps 4 walk.csv", 0),
    ] {
        let [out, _] = said(line, folder.path(), code);
        let object: Value = serde_json::from_str(&out).unwrap();
        let mut found = BTreeSet::new();
        names(&object, "", &mut found);
        if !line.starts_with("audit") {
            let command = line.split(' ').next().unwrap();
            assert_eq!(object["command"], command, "{line}");
            assert!(object["notes"].is_array(), "{line}");
        }
        if line.starts_with("evaluate") {
            continue;
        }
        let more = match line.split(' ').next() {
            Some("clean") => of_clean.as_str(),
            Some("model") => of_models.as_str(),
            _ => "",
        };
        let words = [page_of_json.as_str(), more].into_iter();
        let known: BTreeSet<&str> = words
            .flat_map(|text| text.split(|c: char| !c.is_alphanumeric() && c != '_'))
            .collect();
        let new: Vec<_> = found
            .iter()
            .filter(|n| !known.contains(n.as_str()))
            .collect();
        assert!(new.is_empty(), "{line}: posing-json(5) lacks {new:?}");
    }
}

#[test]
fn the_object_has_a_stream_of_its_own_and_all_notes() {
    let folder = takes();
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    let gaps = at("gaps.csv");
    for name in ["complete", "denoise", "xyz2bvh"] {
        let line = fails(name, &["--json", &gaps], b"", 2);
        assert!(line.contains("-o FILE"), "{line}");
    }
    let same = at("same.csv");
    let line = fails(
        "complete",
        &[&format!("--json={same}"), "-o", &same, &gaps],
        b"",
        2,
    );
    assert!(line.contains("are one file; name another"), "{line}");
    // A file for the object leaves standard output to the table.
    let to = format!("--json={}", at("report.json"));
    let table = run("complete", &["-q", &to, &gaps], "");
    assert_eq!(table, run("complete", &["-q", &gaps], ""));
    let report: Value =
        serde_json::from_str(&fs::read_to_string(at("report.json")).unwrap()).unwrap();
    let listed = at("gaps.json");
    run("complete", &["-q", "--report", &listed, &gaps], "");
    let listed: Value = serde_json::from_str(&fs::read_to_string(listed).unwrap()).unwrap();
    assert_eq!(report["gaps"], listed["gaps"]);
    assert_eq!(report["filled"], 2 * 2 * 12);
    let [loud, told] = said("xyz2bvh --json -o a.bvh walk.csv", folder.path(), 0);
    let [quiet, none] = said("xyz2bvh -q --json -o a.bvh walk.csv", folder.path(), 0);
    assert_eq!((loud.clone(), none.as_str()), (quiet, ""));
    let loud: Value = serde_json::from_str(&loud).unwrap();
    let lines: Vec<String> = loud["notes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|note| format!("xyz2bvh: {}", note.as_str().unwrap()))
        .collect();
    assert_eq!(told.lines().collect::<Vec<_>>(), lines);
}

#[test]
fn the_usage_has_every_command_and_every_flag_of_its_help() {
    let usage: Value = serde_json::from_str(&run("posing", &["--json-usage"], "")).unwrap();
    let commands = usage["commands"].as_array().unwrap();
    let told: Vec<&str> = commands
        .iter()
        .map(|c| c["name"].as_str().unwrap())
        .collect();
    assert_eq!(told, command_names());
    for entry in commands {
        let name = entry["name"].as_str().unwrap();
        let (common, own) = (&usage["common"], &entry["arguments"]);
        let all = common.as_array().unwrap().iter();
        let flags: BTreeSet<&str> = all
            .chain(own.as_array().unwrap())
            .filter_map(|argument| argument["flag"].as_str())
            .collect();
        let done = command(name)
            .env("COLUMNS", "1000")
            .arg("--help")
            .assert()
            .success();
        let help = String::from_utf8(done.get_output().stdout.clone()).unwrap();
        let lines = help
            .lines()
            .map(str::trim_start)
            .filter(|line| line.starts_with('-'));
        let shown: BTreeSet<&str> = lines
            .filter_map(|line| {
                line.split([' ', ',', '=', '['])
                    .find(|word| word.starts_with("--"))
            })
            .collect();
        assert_eq!(shown, flags, "{name}");
    }
}
