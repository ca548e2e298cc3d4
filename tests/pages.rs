//! Every command has a binary, a page of the manual, completions and examples.
//!
//! `POSING_BLESS=1 cargo test --release --test pages` writes the pages anew: look at the difference before you commit it.

use posing::cli::commands::COMMANDS;
use posing::cli::completions::Outline;
use posing::cli::manual::{MAN, OUTLINE};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The binaries there are, by their sources.
fn binaries() -> BTreeSet<String> {
    let entries = fs::read_dir(root().join("src/bin")).unwrap();
    let stem = |p: PathBuf| p.file_stem().unwrap().to_string_lossy().into_owned();
    entries.map(|e| stem(e.unwrap().path())).collect()
}

fn asked(name: &str, request: &[&str]) -> String {
    let folder = Path::new(env!("CARGO_BIN_EXE_posing")).parent().unwrap();
    let out = Command::new(folder.join(name))
        .args(request)
        .output()
        .unwrap();
    assert!(out.status.success(), "{name} {request:?}");
    String::from_utf8(out.stdout).unwrap()
}

#[test]
fn every_command_has_a_binary_and_every_binary_is_listed() {
    let mut listed: BTreeSet<String> = COMMANDS.iter().map(|c| c.name.to_string()).collect();
    listed.insert("posing".into());
    assert_eq!(listed, binaries());
}

#[test]
fn the_manual_is_what_the_commands_print() {
    let bless = std::env::var_os("POSING_BLESS").is_some_and(|v| v == "1");
    let man = root().join("man");
    let mut stale = Vec::new();
    for name in binaries() {
        let (page, path) = (asked(&name, &[MAN]), man.join(format!("{name}.1")));
        if fs::read_to_string(&path).is_ok_and(|kept| kept == page) {
            continue;
        }
        if bless {
            fs::write(&path, page).unwrap();
        } else {
            stale.push(format!("man/{name}.1"));
        }
    }
    assert!(
        stale.is_empty(),
        "{stale:?} differ from the flags; `make bless` writes them anew"
    );
    for entry in fs::read_dir(man).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let by_hand = path.extension().is_some_and(|e| e == "5" || e == "7");
        let known = by_hand || binaries().contains(&name);
        assert!(known, "{}: there is no such command", path.display());
    }
}

#[test]
fn the_list_describes_each_command_as_its_help_does() {
    for entry in COMMANDS {
        let outline: Outline = serde_json::from_str(&asked(entry.name, &[OUTLINE])).unwrap();
        assert_eq!(
            (outline.name.as_str(), outline.about.as_str()),
            (entry.name, entry.about)
        );
    }
}

#[test]
fn pages_are_named_after_the_launcher() {
    for entry in COMMANDS {
        let page = asked(entry.name, &[MAN]);
        let title = format!("POSING-{}", entry.name.to_uppercase());
        assert!(page.contains(&format!(".TH {title} 1")), "{}", entry.name);
        let synopsis = page.split(".SH SYNOPSIS\n").nth(1).unwrap();
        let usage = format!("posing {}", entry.name).replace('-', "\\-");
        assert!(synopsis.starts_with(&usage), "{synopsis}");
        assert_eq!(asked("posing", &["man", entry.name]), page);
    }
}

#[test]
fn the_launcher_lists_every_command() {
    let (bare, help, page) = (
        asked("posing", &[]),
        asked("posing", &["--help"]),
        asked("posing", &[MAN]),
    );
    for entry in COMMANDS {
        for text in [&bare, &help] {
            let line = text.lines().find(|l| l.trim().starts_with(entry.name));
            assert!(
                line.is_some_and(|l| l.ends_with(entry.about)),
                "{}",
                entry.name
            );
        }
        let name = format!("posing-{}(1)", entry.name).replace('-', "\\-");
        assert!(page.contains(&name), "{name}");
    }
}

#[test]
fn a_model_is_summed_up_on_a_screen_and_told_whole_as_json() {
    let summary = asked("model", &["info"]);
    assert!(summary.lines().count() <= 24, "{summary}");
    assert!(summary.contains("mocap.cs.cmu.edu"), "{summary}");
    let json: serde_json::Value =
        serde_json::from_str(&asked("model", &["info", "--json"])).unwrap();
    let points = json["points"].as_array().unwrap().len();
    assert_eq!(json["arrays"]["poses"][1], 3 * points);
    assert!(json["history"][0]["inputs"].as_array().unwrap().len() > 1);
}

#[test]
fn every_help_shows_examples() {
    for name in binaries() {
        let help = asked(&name, &["--help"]);
        assert!(help.contains("\nExamples:\n"), "{name}");
    }
}
