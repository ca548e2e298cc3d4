//! Every command has a binary, a page of the manual, completions and examples.
//!
//! `POSING_BLESS=1 cargo test --release --test pages` writes the pages anew: look at the difference before you commit it.

use posing::cli::commands::COMMANDS;
use posing::cli::manual::{COMPLETIONS, MAN};
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
        let known = path.extension().is_some_and(|e| e == "5") || binaries().contains(&name);
        assert!(known, "{}: there is no such command", path.display());
    }
}

#[test]
fn every_command_completes_in_three_shells() {
    for name in binaries() {
        for shell in ["bash", "zsh", "fish"] {
            let script = asked(&name, &[COMPLETIONS, shell]);
            assert!(script.contains(&name), "{name} {shell}");
        }
    }
}

#[test]
fn every_help_shows_examples() {
    for name in binaries() {
        let help = asked(&name, &["--help"]);
        assert!(help.contains("\nExamples:\n"), "{name}");
    }
}
