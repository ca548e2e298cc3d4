//! Every command has a page of the manual, completions and examples.
//!
//! `POSING_BLESS=1 cargo test --release --test it pages` writes the pages anew: look at the
//! difference before you commit it.

use crate::common::{bin, command_names, fails};
use std::fs;
use std::path::Path;
use std::process::Command;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The commands and the program itself.
fn names() -> Vec<String> {
    let mut names = command_names();
    names.push("posing".into());
    names
}

fn asked(name: &str, request: &[&str]) -> String {
    let out = Command::new(bin().join(name))
        .args(request)
        .output()
        .unwrap();
    assert!(out.status.success(), "{name} {request:?}");
    String::from_utf8(out.stdout).unwrap()
}

#[test]
fn a_command_runs_by_its_own_name_and_as_a_word() {
    for name in command_names() {
        let version = asked(&name, &["--version"]);
        assert!(version.starts_with(&format!("{name} ")), "{version}");
        assert_eq!(asked("posing", &[&name, "--version"]), version);
        assert!(version.contains(env!("CARGO_PKG_VERSION")), "{version}");
        assert_eq!(asked("posing", &[&name, "-h"]), asked(&name, &["-h"]));
    }
}

#[test]
fn the_manual_is_what_the_commands_print() {
    let bless = std::env::var_os("POSING_BLESS").is_some_and(|v| v == "1");
    let man = root().join("man");
    let mut stale = Vec::new();
    for name in names() {
        let (page, path) = (
            asked("posing", &["man", &name]),
            man.join(format!("{name}.1")),
        );
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
        let known = by_hand || names().contains(&name);
        assert!(known, "{}: there is no such command", path.display());
    }
}

#[test]
fn pages_are_named_after_the_program() {
    for name in command_names() {
        let page = asked("posing", &["man", &name]);
        let title = format!("POSING-{}", name.to_uppercase());
        assert!(page.contains(&format!(".TH {title} 1")), "{name}");
        let synopsis = page.split(".SH SYNOPSIS\n").nth(1).unwrap();
        let usage = format!("posing {name}").replace('-', "\\-");
        assert!(synopsis.starts_with(&usage), "{synopsis}");
    }
}

#[test]
fn the_program_lists_every_command_in_a_group() {
    let (bare, page) = (asked("posing", &[]), asked("posing", &["man", "posing"]));
    assert_eq!(bare, asked("posing", &["--help"]));
    for name in command_names() {
        let about = asked(&name, &["--help"])
            .lines()
            .next()
            .unwrap()
            .to_string();
        let is_listed = |l: &&str| l.trim().starts_with(&format!("{name} "));
        let line = bare.lines().find(is_listed).expect(&name);
        assert!(line.ends_with(&about), "{line}");
        let reference = format!("posing-{name}(1)").replace('-', "\\-");
        assert!(page.contains(&reference), "{reference}");
    }
    let groups = bare
        .lines()
        .filter(|l| l.ends_with(':') && !l.starts_with(' '));
    assert!(groups.count() >= 8, "{bare}");
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
    for name in names() {
        let help = asked(&name, &["--help"]);
        assert!(help.contains("\nExamples:\n"), "{name}");
    }
}

/// The flags that a help lists, each at the beginning of a line.
fn flags(help: &str) -> Vec<&str> {
    let (list, _) = help.split_once("\nExamples:\n").unwrap();
    let entries = list.lines().filter_map(|line| {
        let entry = line.strip_prefix("      ").or(line.strip_prefix("  "))?;
        entry.starts_with('-').then_some(entry)
    });
    let flags = entries.filter_map(|entry| {
        let mut words = entry.split([' ', ',', '=', '[']).filter(|w| !w.is_empty());
        let first = words.next()?;
        let long = words.next().filter(|w| w.starts_with("--"));
        Some(long.filter(|_| !first.starts_with("--")).unwrap_or(first))
    });
    flags.collect()
}

#[test]
fn a_short_help_has_what_is_needed_first_and_says_where_the_rest_is() {
    let usage: serde_json::Value =
        serde_json::from_str(&asked("posing", &["--json-usage"])).unwrap();
    let count = |arguments: &serde_json::Value| {
        let all = arguments.as_array().unwrap().iter();
        all.filter(|a| !(a["flag"].is_null() && a["short"].is_null()))
            .count()
    };
    for entry in usage["commands"].as_array().unwrap() {
        let name = entry["name"].as_str().unwrap();
        let (short, long) = (asked(name, &["-h"]), asked(name, &["--help"]));
        let (first, all) = (flags(&short), flags(&long));
        assert!(first.len() <= 12, "{name}: {first:?}");
        assert!(
            first.iter().all(|flag| all.contains(flag)),
            "{name}: {first:?}, {all:?}"
        );
        assert_eq!(
            all.len(),
            count(&entry["arguments"]) + count(&usage["common"]),
            "{name}"
        );
        let last = format!("All flags: posing {name} --help");
        assert_eq!(short.trim_end().lines().last(), Some(&*last));
        assert!(
            short.contains("\nExamples:\n") && !long.contains(&last),
            "{name}"
        );
    }
}

#[test]
fn a_mistyped_command_gets_the_one_that_is_like_it() {
    let said = |words: &[&str]| fails("posing", words, b"", 2);
    for words in [
        &["clen"][..],
        &["clen", "walk.bvh", "-o", "whole.bvh"],
        &["help", "clen"],
    ] {
        let said = said(words);
        assert!(said.contains("'clean'"), "{said}");
        assert!(
            said.len() < 140 && said.trim_end().lines().count() == 1,
            "{said}"
        );
    }
    assert!(said(&["nonsense"]).contains("see posing --help"));
}

#[test]
fn a_flag_that_converts_tables_is_found_with_trim() {
    for (name, flag) in [
        ("retrieve", "--units"),
        ("bvh2xyz", "--out-up"),
        ("encode", "--joints"),
    ] {
        let said = fails(name, &[flag, "m", "walk.csv"], b"", 2);
        assert!(
            said.contains(&format!("posing trim {flag} converts tables")),
            "{said}"
        );
    }
}
