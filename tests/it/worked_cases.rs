//! The worked cases in testdata/examples: each script runs, and its page names commands that the
//! script has and files that are there.

use crate::common::bin;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What names of files end in.
const ENDINGS: &[&str] = &[
    "amc", "asf", "awk", "bvh", "c3d", "csv", "glb", "html", "json", "npz", "png", "sh", "svg",
    "txt",
];

/// What a page names.
#[derive(Default)]
struct Page {
    /// The lines of its indented blocks that are commands of posing.
    commands: Vec<String>,
    /// What stands between backquotes in its text.
    spans: Vec<String>,
    /// Where its links and pictures lead, without the place in a page.
    links: Vec<String>,
}

impl Page {
    fn read(path: &Path) -> Page {
        let mut page = Page::default();
        let mut fenced = false;
        for line in fs::read_to_string(path).unwrap().lines() {
            if line.starts_with("```") {
                fenced = !fenced;
            } else if fenced {
                // What a command prints.
            } else if let Some(code) = line.strip_prefix("    ") {
                let command = code.trim();
                let is_ours = command.starts_with("posing ");
                page.commands.extend(is_ours.then(|| command.to_string()));
            } else {
                let spans = line.split('`').skip(1).step_by(2);
                page.spans.extend(spans.map(String::from));
                let links = line.split("](").skip(1);
                let links = links.filter_map(|rest| rest.split([')', '#']).next());
                page.links.extend(links.map(String::from));
            }
        }
        page
    }

    /// The files that its commands and its text name. A command in the text is for files of the
    /// reader.
    fn files(&self) -> Vec<&str> {
        let spans = self.spans.iter();
        let spans = spans.filter(|span| !span.starts_with("posing "));
        let texts = self.commands.iter().chain(spans);
        let words = texts.flat_map(|text| text.split_whitespace());
        let is_file = |word: &&str| {
            let ending = word.rsplit_once('.').map(|(_, ending)| ending);
            ending.is_some_and(|ending| ENDINGS.contains(&ending)) && !word.contains('$')
        };
        words.filter(is_file).collect()
    }
}

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples")
}

/// Runs a case into a new folder, from a folder that is not its own, and checks its page.
fn check(case: &str) {
    let folder = tempfile::tempdir().unwrap();
    let here = examples().join(case);
    let path = format!("{}:{}", bin().display(), std::env::var("PATH").unwrap());
    let done = Command::new("sh")
        .arg(here.join("run.sh"))
        .arg("out")
        .current_dir(folder.path())
        .env("PATH", path)
        .output()
        .unwrap();
    let [printed, said] = [&done.stdout, &done.stderr].map(|text| String::from_utf8_lossy(text));
    assert!(
        done.status.success(),
        "{case}: {}\n{printed}\n{said}",
        done.status
    );

    let page = Page::read(&here.join("README.md"));
    let script = fs::read_to_string(here.join("run.sh")).unwrap();
    assert!(page.commands.len() >= 5, "{case}: {:?}", page.commands);
    for command in &page.commands {
        let is_run = script.lines().any(|line| {
            let rest = line.trim().strip_prefix(command.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest == " || findings $?")
        });
        assert!(is_run, "{case}: run.sh does not run\n{command}");
    }
    let out = folder.path().join("out");
    let files = page.files();
    assert!(files.len() >= 10, "{case}: {files:?}");
    for file in files {
        let is_there = out.join(file).exists() || here.join(file).exists();
        assert!(is_there, "{case}: README.md names {file}");
    }
    for link in &page.links {
        assert!(here.join(link).exists(), "{case}: README.md links {link}");
    }
}

#[test]
fn the_case_of_an_animator_runs_as_its_page_says() {
    check("animator");
}

#[test]
fn the_case_of_a_gait_laboratory_runs_as_its_page_says() {
    check("gait");
}

#[test]
fn the_case_of_a_biomechanist_runs_as_its_page_says() {
    check("biomechanist");
}

#[test]
fn the_case_of_a_researcher_runs_as_its_page_says() {
    check("researcher");
}

#[test]
fn the_index_names_every_example() {
    let folder = examples();
    let index = Page::read(&folder.join("README.md"));
    for link in &index.links {
        assert!(folder.join(link).exists(), "README.md links {link}");
    }
    for entry in fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let is_of = |link: &String| link.split('/').next() == Some(name.as_str());
        let is_named = name == "README.md" || index.links.iter().any(is_of);
        assert!(is_named, "README.md does not name {name}");
    }
}
