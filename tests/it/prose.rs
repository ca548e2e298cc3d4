//! One spelling, and lines that fit beside one another.

use std::fs;
use std::path::{Path, PathBuf};

/// British spellings, parted so that they do not stand here themselves. `typos.toml` knows more.
const BRITISH: &[&str] = &[
    "behavi|our",
    "cent|re",
    "col|our",
    "initiali|s",
    "label|led",
    "lear|nt",
    "maximi|s",
    "met|re",
    "minimi|s",
    "model|led",
    "neighb|our",
    "normali|s",
    "optimi|s",
    "quanti|s",
    "synthesi|se",
];

/// Names in files and flags that users have.
const KEPT: &[&str] = &["learnt_from", "unlabelled"];

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => files(&path, out),
            false => out.push(path),
        }
    }
}

/// All texts that users and developers read, with their names.
fn texts() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    for folder in ["src", "crates", "man", "tests/it"] {
        files(&root.join(folder), &mut paths);
    }
    paths.extend(
        ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "Cargo.toml"].map(|f| root.join(f)),
    );
    let read = |path: PathBuf| {
        let name = path.strip_prefix(root).unwrap().display().to_string();
        Some((name, fs::read_to_string(&path).ok()?))
    };
    paths.into_iter().filter_map(read).collect()
}

fn british(text: &str) -> Vec<String> {
    let mut text = text.to_lowercase();
    KEPT.iter().for_each(|kept| text = text.replace(kept, ""));
    let words = BRITISH.iter().map(|word| word.replace('|', ""));
    words.filter(|word| text.contains(word)).collect()
}

#[test]
fn spelling_is_american() {
    let wrong: Vec<String> = (texts().iter())
        .flat_map(|(name, text)| {
            british(text)
                .into_iter()
                .map(move |w| format!("{name}: {w}"))
        })
        .collect();
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn a_british_word_is_seen() {
    let word = "cent|re".replace('|', "");
    assert_eq!(
        british(&format!("the {word} of a body; learnt_from")),
        [word]
    );
}

#[test]
fn lines_of_code_have_at_most_100_columns() {
    let is_source = |name: &str| {
        ["src/", "crates/"].iter().any(|f| name.starts_with(f)) && name.ends_with(".rs")
    };
    let mut wide = Vec::new();
    for (name, text) in texts().iter().filter(|(name, _)| is_source(name)) {
        let lines = text
            .lines()
            .enumerate()
            .filter(|(_, line)| line.chars().count() > 100);
        wide.extend(lines.map(|(i, _)| format!("{name}:{}", i + 1)));
    }
    assert!(wide.is_empty(), "\n{}", wide.join("\n"));
}
