//! One spelling, and lines that fit beside one another.

use std::fs;
use std::path::{Path, PathBuf};

/// British spellings, parted so that they do not stand here themselves. `typos.toml` knows more.
const BRITISH: &[&str] = &[
    "behavi|our",
    "cancel|led",
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
    "toward|s",
];

/// Texts beside the sources.
const PAGES: [&str; 7] = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "CITATION.cff",
    "Cargo.toml",
    "testdata/FIGURES.md",
    "testdata/RECIPES.md",
];

/// The papers that this project began with: the title, and how names of the authors end, in order.
const PAPERS: [(&str, &[&str]); 3] = [
    (
        "Interactive Character Posing by Sparse Coding",
        &["Lai", "Yuen", "Lee", "Lai"],
    ),
    (
        "Learning a 3D Human Pose Distance Metric from Geometric Pose Descriptor",
        &["Chen", "Zhuang", "Nie", "Yang", "Wu", "Xiao"],
    ),
    (
        "SCAPE: Shape Completion and Animation of People",
        &[
            "Anguelov",
            "Srinivasan",
            "Koller",
            "Thrun",
            "Rodgers",
            "Davis",
        ],
    ),
];

/// Names in files and flags that users have.
const KEPT: &[&str] = &["learnt_from", "unlabelled"];

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, out)
        } else {
            out.push(path)
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
    paths.extend(PAGES.map(|page| root.join(page)));
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

/// The words of a text, without the marks of comments at the starts of lines.
fn words(text: &str) -> String {
    let bare = text.lines().map(|line| {
        let line = line.trim_start();
        line.trim_start_matches(['/', '!', '#'])
    });
    let joined = bare.collect::<Vec<_>>().join(" ");
    joined.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether the names stand in this order in a text.
fn in_order(text: &str, names: &[&str]) -> bool {
    let mut rest = text;
    names.iter().all(|name| match rest.find(name) {
        Some(start) => {
            rest = &rest[start + name.len()..];
            true
        }
        None => false,
    })
}

/// A citation by title has all authors before the title, or after it in CITATION.cff; a short one is
/// "Lai et al.".
#[test]
fn papers_are_cited_by_all_their_authors() {
    let mut cited = [0; PAPERS.len()];
    for (name, text) in texts()
        .iter()
        .filter(|(name, _)| name != "tests/it/prose.rs")
    {
        let text = words(text);
        for ((title, authors), cited) in PAPERS.iter().zip(&mut cited) {
            for (start, _) in text.match_indices(title) {
                let from = text.floor_char_boundary(start.saturating_sub(160));
                let to = text.floor_char_boundary((start + 700).min(text.len()));
                let near = if name == "CITATION.cff" {
                    &text[start + title.len()..to]
                } else {
                    &text[from..start]
                };
                let short = format!("{} et al.", authors[0]);
                let is_whole = in_order(near, authors) || near.contains(&short);
                assert!(is_whole, "{name} cites {title}: {near}");
                *cited += 1;
            }
        }
    }
    assert!(cited.iter().all(|&n| n >= 2), "{cited:?}");
}

/// Each file that speaks of "the paper" names one: by authors, or by a year.
#[test]
fn the_paper_says_which() {
    let is_year = |word: &str| {
        let digits = word.trim_matches(|c: char| !c.is_ascii_digit());
        digits.len() == 4 && (digits.starts_with("19") || digits.starts_with("20"))
    };
    let unchecked = ["tests/it/prose.rs"];
    for (name, text) in texts() {
        if unchecked.contains(&name.as_str()) {
            continue;
        }
        let text = words(&text)
            .replace("on the paper", "")
            .replace("The paper", "the paper");
        let names_one = ["et al.", "Y.Q. Lai"].iter().any(|by| text.contains(by));
        let says = names_one || text.split(' ').any(is_year);
        assert!(says || !text.contains("the paper"), "{name}: which paper?");
    }
}

#[test]
fn entries_of_the_changelog_are_short() {
    let (_, text) = (texts().into_iter())
        .find(|(name, _)| name == "CHANGELOG.md")
        .unwrap();
    for entry in text.lines().filter_map(|line| line.strip_prefix("- ")) {
        assert!(entry.split_whitespace().count() <= 30, "{entry}");
    }
}
