//! Results: none replaces a file that the command reads or another result, and none appears before
//! all are complete.

use super::common::{command, command_names, fails, long, run, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Arguments that name a file to be read.
const READ: &[&str] = &[
    "--asf",
    "--classes",
    "--config",
    "--damaged",
    "--database",
    "--init",
    "--into",
    "--joints",
    "--labels",
    "--like",
    "--map",
    "--merge",
    "--model",
    "--on",
    "--pairs",
    "--paper",
    "--parts",
    "--points",
    "--pose",
    "--poses",
    "--prior",
    "--scan",
    "--skeleton",
    "--static",
    "--table",
    "--template",
    "--to",
    "--truth",
    "--valid",
    "body-synth --rotations",
    "body-train --shapes",
    "xyz2amc --rotations",
    "xyz2bvh --rotations",
    "xyz2glb --rotations",
    "dictionaries",
    "file",
    "files",
    "first",
    "folders",
    "inputs",
    "keys",
    "model",
    "poses",
    "result",
    "scan",
    "second",
    "takes",
    "truth",
    "--norm",
    "walks",
];

/// Arguments that name a file or folder to be written; some are read where they are there already.
const WRITTEN: &[&str] = &[
    "--amc",
    "--angles",
    "--asf-out",
    "--blend",
    "--bvh",
    "--checkpoint",
    "--csv",
    "--index",
    "--json",
    "--learn",
    "--log",
    "--make-norm",
    "--meshes",
    "--output",
    "--page",
    "--picture",
    "--report",
    "--save",
    "--session",
    "--split",
    "body-animate --rotations",
    "body-animate --shapes",
    "body-fit --rotations",
    "body-fit --shapes",
    "demo folder",
];

/// The commands and below each its subcommands, each with its arguments.
fn arguments(command: &Value, found: &mut Vec<(String, Value)>) {
    let name = command["name"].as_str().unwrap();
    for argument in command["arguments"].as_array().unwrap() {
        found.push((name.to_string(), argument.clone()));
    }
    for below in command["commands"].as_array().into_iter().flatten() {
        arguments(below, found);
    }
}

/// A path that is written must be an `OutputPath`, or no result is kept from replacing an input.
#[test]
fn every_path_is_known_as_read_or_written() {
    let usage: Value = serde_json::from_str(&run("posing", &["--json-usage"], "")).unwrap();
    let mut all = Vec::new();
    for command in usage["commands"].as_array().unwrap() {
        arguments(command, &mut all);
    }
    for (command, argument) in all.iter().filter(|(_, a)| a["type"] == "path") {
        let flag = argument["flag"].as_str().or(argument["name"].as_str());
        let flag = flag.unwrap();
        let own = format!("{command} {flag}");
        let is_in = |list: &[&str]| list.contains(&flag) || list.contains(&&*own);
        let is_written = argument["written"] == true;
        assert_ne!(
            is_in(READ),
            is_in(WRITTEN),
            "{own}: list it in one of the two"
        );
        assert_eq!(is_in(WRITTEN), is_written, "{own}: OutputPath or PathBuf?");
        let help = argument["help"].as_str().unwrap();
        let says_so = help.starts_with("Write") || help.starts_with("Also write");
        assert!(is_written || !says_so, "{own}: {help}");
        assert!(
            is_written || argument["heading"] != "Output" || command == "evaluate",
            "{own}: {help}"
        );
    }
    assert!(command_names().len() > 40 && all.len() > 450);
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn a_result_replaces_no_input_by_any_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    let table = long(60);
    fs::write(at("t.csv"), &table).unwrap();
    fs::write(at("u.csv"), &table).unwrap();
    std::os::unix::fs::symlink("t.csv", at("link.csv")).unwrap();
    fs::hard_link(at("t.csv"), at("hard.csv")).unwrap();
    fs::create_dir(at("out")).unwrap();
    let before = names(folder.path());
    let t = at("t.csv");
    for same in ["t.csv", "./t.csv", "out/../t.csv", "link.csv", "hard.csv"] {
        let same = at(same);
        for words in [
            vec!["trim", &t, "-o", &same],
            vec!["corrupt", "--dense", "1cm", &t, "-o", &same],
            vec!["score", &at("u.csv"), &t, "-o", &same],
            vec!["plot", &t, "--to", "html", "-o", &same],
            vec!["plot", &t, "--table", &same, "-o", &at("p.html")],
            vec!["clean", &t, "-o", &at("c.csv"), "--page", &same],
            vec!["clean", &t, "-o", &at("c.csv"), &format!("--json={same}")],
            vec!["label", &t, "-o", &same],
        ] {
            let said = fails(words[0], &words[1..], b"", 2);
            assert!(said.contains(&same), "{words:?}: {said}");
        }
    }
    // By way of standard input, of a folder of results, of what stands beside a result.
    let input = fs::File::open(&t).unwrap();
    let program = command("trim");
    let mut trim = std::process::Command::new(program.get_program());
    let done = trim.args(["-o", &t]).stdin(input).output().unwrap();
    assert_eq!(done.status.code(), Some(2));
    let here = text(folder.path());
    for words in [
        vec!["label", &t, &at("u.csv"), "-o", here],
        vec!["clean", &t, &at("u.csv"), "-o", here],
        vec![
            "clean",
            &t,
            "-o",
            &at("c.csv"),
            &format!("--json={}", at("c.csv.json")),
        ],
        vec![
            "label",
            &t,
            "-o",
            &at("c.csv"),
            &format!("--json={}", at("out/../c.csv.html")),
        ],
        vec![
            "score",
            &t,
            &at("u.csv"),
            "-o",
            &at("new"),
            &format!("--json={}", at("./new")),
        ],
    ] {
        fails(words[0], &words[1..], b"", 2);
    }
    for words in [
        vec!["audit", here, "-o", &at("u.csv")],
        vec![
            "clean",
            here,
            "-o",
            &at("out"),
            &format!("--json={}", at("u.csv")),
        ],
        vec![
            "label",
            here,
            "-o",
            &at("out"),
            &format!("--json={}", at("u.csv")),
        ],
    ] {
        fails(words[0], &words[1..], b"", 2);
    }
    assert_eq!(names(folder.path()), before);
    assert_eq!(fs::read_to_string(&t).unwrap(), table);
    // What is no input is replaced as before, and streams are no files.
    for sound in ["new.csv", "new.csv", "u.csv", "/dev/null"] {
        let to = if sound.starts_with('/') {
            sound.to_string()
        } else {
            at(sound)
        };
        run("trim", &["-q", &t, "-o", &to], "");
    }
    assert!(run("trim", &["-q", &t, "-o", "-"], "").starts_with("take,"));
    assert!(run("trim", &["-q", &t, "-o", "/dev/stdout"], "").starts_with("take,"));
    run(
        "score",
        &["-q", &t, &t, "-o", "/dev/null", "--json=/dev/null"],
        "",
    );
}

#[test]
fn no_result_appears_before_all_are_complete() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_string();
    fs::write(at("t.csv"), long(60)).unwrap();
    let words = |to: &str| {
        [
            "--save",
            &at("c.npz"),
            "-o",
            &at(to),
            "-k",
            "4",
            &at("t.csv"),
        ]
        .map(String::from)
    };
    let failing = words("none/c.csv");
    fails("cluster", &failing.each_ref().map(|w| &**w), b"", 1);
    assert_eq!(names(folder.path()), ["t.csv"]);
    run("cluster", &words("c.csv").each_ref().map(|w| &**w), "");
    assert_eq!(names(folder.path()), ["c.csv", "c.npz", "t.csv"]);
}
