//! The sources themselves: arrows between rooms run one way, and what belongs to one room stays in it.

use std::fs;
use std::path::{Path, PathBuf};

/// What each room may name of the crate, besides itself and `Error`, `Place`, `Result`.
/// `numeric` stands below all rooms.
const MAY_NAME: &[(&str, &[&str])] = &[
    ("numeric", &[]),
    ("pose", &["numeric"]),
    ("io", &["pose"]),
    ("cluster", &["pose", "numeric"]),
    ("sparse", &["pose", "numeric"]),
    ("metric", &["pose", "numeric"]),
    ("body", &["pose", "numeric"]),
    // A prior is made from a model, a restoration changes a table: of io these two may name `IO_TYPES` only.
    (
        "prior",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "io",
        ],
    ),
    (
        "restore",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "prior", "io",
        ],
    ),
    (
        "evaluate",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "prior", "restore",
        ],
    ),
    (
        "edit",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "prior", "restore", "io",
        ],
    ),
    (
        "cli",
        &[
            "pose", "numeric", "io", "cluster", "sparse", "metric", "body", "prior", "restore",
            "evaluate", "edit",
        ],
    ),
];

/// Rooms that know only some types of io: data that they are made from or turned into.
const IO_TYPES: &[(&str, &[&str])] = &[
    ("prior", &["io::Model", "io::model"]),
    (
        "restore",
        &["io::Model", "io::model", "io::Table", "io::Bvh", "io::bvh"],
    ),
    ("edit", &["io::Model"]),
];

/// Words, and the only places under src/ that may hold them.
const HOMES: &[(&str, &[&str])] = &[
    ("clap", &["cli/", "bin/"]),
    ("indicatif", &["cli/", "bin/"]),
    ("println!", &["cli/", "bin/"]),
    ("print!", &["cli/", "bin/"]),
    ("process::exit", &["cli/", "bin/"]),
    ("stdin(", &["cli/", "bin/"]),
    ("stdout(", &["cli/", "bin/"]),
    ("ndarray_linalg", &["numeric/linalg.rs"]),
    ("bvh_anim", &["io/bvh"]),
];

fn sources() -> Vec<(String, String)> {
    fn walk(folder: &Path, out: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, out);
            } else if path.extension().is_some_and(|e| e == "rs") {
                out.push(path);
            }
        }
    }
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    walk(&src, &mut paths);
    paths.sort();
    let read = |path: &PathBuf| {
        let name = path
            .strip_prefix(&src)
            .unwrap()
            .to_string_lossy()
            .into_owned();
        (name, code(&fs::read_to_string(path).unwrap()))
    };
    paths.iter().map(read).collect()
}

/// The source without comments (line for line), so that documentation may link upwards, and without the unit tests at
/// its foot, which may look around.
fn code(source: &str) -> String {
    let source = source
        .split("\n#[cfg(test)]\nmod ")
        .next()
        .unwrap_or_default();
    let line = |line: &str| match line.find("//") {
        // `://` is an address in a text.
        Some(at) if !line[..at].ends_with(':') => line[..at].to_string(),
        _ => line.to_string(),
    };
    source.lines().map(|l| line(l) + "\n").collect()
}

/// The paths after each `crate::`; groups such as `{a, b::{c, d}}` give one path for each member.
fn named(source: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in source.match_indices("crate::") {
        // `$crate::` counts, `mycrate::` does not.
        if source[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        members("", &source[at + "crate::".len()..], &mut found);
    }
    found
}

/// Adds the paths at the start of `rest`, each after `prefix`; returns how many bytes they take.
fn members(prefix: &str, rest: &str, found: &mut Vec<String>) -> usize {
    let is_path = |c: char| c.is_alphanumeric() || "_:".contains(c);
    let length = rest.find(|c| !is_path(c)).unwrap_or(rest.len());
    let path = format!("{prefix}{}", &rest[..length]);
    let Some(group) = rest[length..].strip_prefix('{') else {
        found.extend(Some(path).filter(|p| !p.is_empty()));
        return length;
    };
    let mut at = 0;
    while at < group.len() && !group[at..].starts_with('}') {
        match group[at..].starts_with(is_path) || group[at..].starts_with('{') {
            true => at += members(&path, &group[at..], found),
            false => at += group[at..].chars().next().map_or(1, char::len_utf8),
        }
    }
    length + at + 2
}

fn broken(name: &str, source: &str) -> Vec<String> {
    let mut broken = Vec::new();
    let Some((room, _)) = name.split_once('/') else {
        return broken;
    };
    let Some((_, may)) = MAY_NAME.iter().find(|(r, _)| *r == room) else {
        if room != "bin" {
            broken.push(format!(
                "src/{name}: the room {room} has no arrows in MAY_NAME"
            ));
        }
        return broken;
    };
    for path in named(source) {
        let to = path.split("::").next().unwrap_or_default();
        let is_room = MAY_NAME.iter().any(|(r, _)| *r == to) || ["numeric"].contains(&to);
        if is_room && to != room && !may.contains(&to) {
            broken.push(format!("src/{name}: {room} -> {to} ({path})"));
        }
        let types = IO_TYPES.iter().find(|(r, _)| *r == room);
        if to == "io" && types.is_some_and(|(_, types)| !types.iter().any(|t| path.starts_with(t)))
        {
            broken.push(format!("src/{name}: {room} may not name {path}"));
        }
    }
    broken
}

#[test]
fn arrows_run_one_way() {
    let broken: Vec<String> = sources()
        .iter()
        .flat_map(|(name, source)| broken(name, source))
        .collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn a_broken_arrow_is_seen() {
    assert_eq!(broken("pose/x.rs", "use crate::io::Model;").len(), 1);
    assert_eq!(
        broken(
            "sparse/x.rs",
            "use crate::{Error, cluster::{Kmeans, Tree}, pose::Poses};"
        )
        .len(),
        2
    );
    assert_eq!(
        broken("restore/x.rs", "let t = crate::io::Amc::default();").len(),
        1
    );
    assert_eq!(broken("cellar/x.rs", "").len(), 1);
    assert!(
        broken(
            "prior/x.rs",
            "use crate::io::{Model};\nuse crate::io::Model;"
        )
        .is_empty()
    );
    assert_eq!(
        broken("prior/x.rs", "use crate::{Error, io::{Model, csv}};").len(),
        1
    );
    assert!(
        broken(
            "prior/x.rs",
            &code("/// [`crate::restore`] uses it\nuse crate::io::Model;")
        )
        .is_empty()
    );
}

#[test]
fn words_stay_at_home() {
    let mut strays = Vec::new();
    for (name, source) in sources() {
        for (word, homes) in HOMES {
            if source.contains(word) && !homes.iter().any(|home| name.starts_with(home)) {
                strays.push(format!(
                    "src/{name}: {word} belongs to src/{}",
                    homes.join(", src/")
                ));
            }
        }
    }
    assert!(strays.is_empty(), "{}", strays.join("\n"));
}
