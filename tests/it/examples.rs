//! The examples of every help text, typed as they stand, in a folder that holds the files they
//! name.

use crate::common::command_names;
use crate::common::examples::{BVH, SETUP, SMALLER, bash, must, until_ready};
use std::fs;
use std::path::Path;

/// The lines below `Examples:`; what stands after three spaces or more tells what the line does.
fn examples(help: &str) -> Vec<String> {
    let below = help
        .split_once("\nExamples:\n")
        .map_or("", |(_, below)| below);
    let command = |line: &str| {
        line.trim()
            .split("   ")
            .next()
            .unwrap_or_default()
            .to_string()
    };
    below
        .lines()
        .map(command)
        .filter(|line| line.starts_with("posing"))
        .collect()
}

#[test]
fn examples_run_as_they_stand() {
    let base = tempfile::tempdir().unwrap();
    let base = base.path();
    must(SETUP, base);
    crate::common::meshes::of_examples(base);
    must(BVH, base);
    let bin = crate::common::bin();
    for name in command_names().iter().map(String::as_str).chain(["posing"]) {
        let lines = examples(&must(
            &format!("{name} --help", name = bin.join(name).display()),
            base,
        ));
        assert!(!lines.is_empty(), "{name}: no examples");
        for line in lines {
            // Each in a fresh copy of the folder, so that none lives on what another left.
            let folder = tempfile::tempdir().unwrap();
            must(&format!("cp -R '{}'/. .", base.display()), folder.path());
            let smaller = SMALLER.iter().fold(line, |l, (a, b)| l.replace(a, b));
            match name {
                "edit" => must(&until_ready(&smaller), folder.path()),
                _ => must(&smaller, folder.path()),
            };
        }
    }
}

/// The commands of a crontab, run as cron does, with the folder as home.
fn cron(file: &str, folder: &Path) -> std::process::Output {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
    let jobs = text
        .lines()
        .filter(|l| l.starts_with(|c: char| c.is_ascii_digit()));
    let command = |job: &str| job.splitn(6, ' ').last().unwrap().to_string();
    let jobs: Vec<String> = jobs.map(command).collect();
    assert_eq!(jobs.len(), 1);
    bash(&format!("HOME=$PWD; {}", jobs[0]), folder)
}

#[test]
fn nights_clean_what_is_new_and_mail_what_somebody_should_see() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    must(SETUP, folder);
    must(
        "mkdir -p takes/captures && cp walk.csv takes/captures/a.csv",
        folder,
    );
    let night = || cron("testdata/examples/nightly.cron", folder);
    let first = night();
    assert!(folder.join("takes/cleaned/a.csv").exists(), "{first:?}");
    let time = || {
        let file = fs::metadata(folder.join("takes/cleaned/a.csv"));
        file.unwrap().modified().unwrap()
    };
    let written = time();
    must("echo nonsense > takes/captures/c.csv", folder);
    let second = night();
    assert_eq!(time(), written);
    let mail = String::from_utf8_lossy(&second.stdout).into_owned();
    assert!(
        mail.contains("1 unchanged") && mail.contains("1 failed"),
        "{mail}"
    );
    assert!(!folder.join("takes/cleaned/c.csv").exists());
}

#[test]
fn captures_are_cleaned_by_make() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    must(SETUP, folder);
    let root = env!("CARGO_MANIFEST_DIR");
    must(
        &format!(
            "cp '{root}/testdata/examples/clean.mk' Makefile
            mkdir -p captures && cp walk.csv captures/a.csv && posing xyz2c3d -q -o captures/b.c3d walk.csv
            make -s -j2 && test -s cleaned/a.csv.json && test -s cleaned/b.c3d && make -q"
        ),
        folder,
    );
}
