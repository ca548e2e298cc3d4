//! The sources themselves: arrows between rooms run one way, and what belongs to one room stays in
//! it.

use std::fs;
use std::path::{Path, PathBuf};

/// Rooms that know only some types of io: data that they are made from or turned into.
const IO_TYPES: &[(&str, &[&str])] = &[
    ("likeness/", &["io::Matrix", "io::Model"]),
    ("body/", &["io::Model"]),
    ("joints/ik/", &["io::Bvh", "io::bvh"]),
    ("models/prior/", &["io::Model", "io::model"]),
    (
        "restore/",
        &["io::Model", "io::model", "io::Table", "io::Output"],
    ),
    ("edit/edit/", &["io::Model"]),
    (
        "gait/",
        &[
            "io::Analog",
            "io::C3d",
            "io::FileEvent",
            "io::ForcePlate",
            "io::OutputPoint",
            "io::Quantity",
            "io::csv::push_cell",
            "io::opensim",
            "io::text::push_f64",
        ],
    ),
];

/// Words, and the only places that may hold them.
const HOMES: &[(&str, &[&str])] = &[
    ("clap", &["posing/"]),
    ("indicatif", &["posing/"]),
    ("println!", &["posing/"]),
    ("print!", &["posing/"]),
    ("process::exit", &["posing/"]),
    ("stdin(", &["posing/"]),
    ("stdout(", &["posing/"]),
    ("ndarray_linalg", &["core/numeric/linalg/"]),
    ("bvh_anim", &["io/bvh"]),
];

/// The sources of all crates, by name: `io/table.rs` is crates/io/src/table.rs, `posing/` the program
/// and the facade.
pub fn sources() -> Vec<(String, String)> {
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
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut crates = vec![("posing".to_string(), root.join("src"))];
    for entry in fs::read_dir(root.join("crates")).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().to_string_lossy().into_owned();
        crates.push((name, entry.path().join("src")));
    }
    crates.sort();
    let mut found = Vec::new();
    for (name, src) in crates {
        let mut paths = Vec::new();
        walk(&src, &mut paths);
        paths.sort();
        found.extend(paths.iter().map(|path| {
            let file = path.strip_prefix(&src).unwrap().to_string_lossy();
            (
                format!("{name}/{file}"),
                code(&fs::read_to_string(path).unwrap()),
            )
        }));
    }
    found
}

/// The source without comments (line for line), so that documentation may link upwards, and without
/// the unit tests at its foot, which may look around.
fn code(source: &str) -> String {
    let is_tests = |at: &usize| {
        let module = source[*at..].lines().nth(2).unwrap_or_default();
        module.contains("mod ") && module.ends_with('{')
    };
    let mut marked = source.match_indices("\n#[cfg(test)]\n").map(|(at, _)| at);
    let source = &source[..marked.find(is_tests).unwrap_or(source.len())];
    let line = |line: &str| match line.find("//") {
        // `://` is an address in a text.
        Some(at) if !line[..at].ends_with(':') => line[..at].to_string(),
        _ => line.to_string(),
    };
    source.lines().map(|l| line(l) + "\n").collect()
}

/// The paths after each `crate::`; groups such as `{a, b::{c, d}}` give one path for each member.
fn named(source: &str) -> Vec<String> {
    named_after("crate::", source)
}

/// The paths after each `root`, such as `crate::`, that begins a path.
fn named_after(root: &str, source: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, _) in source.match_indices(root) {
        // `$crate::` counts; `mycrate::` and `super::super::` (from its second half) do not.
        if source[..at].ends_with(|c: char| c.is_alphanumeric() || "_:".contains(c)) {
            continue;
        }
        members("", &source[at + root.len()..], &mut found);
    }
    found
}

/// The module of a file, after its crate: `restore/placement/mod.rs` is `["restore", "placement"]`.
fn module(name: &str) -> Vec<&str> {
    let mut parts: Vec<&str> = name.trim_end_matches(".rs").split('/').collect();
    if parts.last().is_some_and(|p| ["mod", "lib"].contains(p)) {
        parts.pop();
    }
    parts
}

/// For each file the files that it names, those of its own children aside: a parent and the
/// children that it shows are one.
fn imports(sources: &[(String, String)]) -> Vec<Vec<usize>> {
    let modules: Vec<Vec<&str>> = sources.iter().map(|(name, _)| module(name)).collect();
    let file_of = |path: &[&str]| {
        (0..=path.len())
            .rev()
            .find_map(|n| modules.iter().position(|m| m == &path[..n]))
    };
    let of = |(at, (_, source)): (usize, &(String, String))| {
        let own = &modules[at];
        let within = |path: String| format!("{}::{path}", own[0]);
        let mut paths: Vec<String> = named(source).into_iter().map(within).collect();
        for ups in 1..own.len() {
            let root = "super::".repeat(ups);
            let above = own[..own.len() - ups].join("::");
            let below = named_after(&root, source).into_iter();
            // A longer chain of `super::` is found from each of its links; only its whole counts.
            let below = below.filter(|p| !p.starts_with("super"));
            paths.extend(below.map(|p| format!("{above}::{p}")));
        }
        let mut files: Vec<usize> = paths
            .iter()
            .filter_map(|p| {
                let parts: Vec<&str> = p.split("::").filter(|s| !s.is_empty()).collect();
                file_of(&parts)
            })
            .filter(|&to| to != at && !modules[to].starts_with(own))
            .collect();
        files.sort_unstable();
        files.dedup();
        files
    };
    sources.iter().enumerate().map(of).collect()
}

/// The files that can be reached from themselves.
fn in_circles(imports: &[Vec<usize>]) -> Vec<usize> {
    let reaches_itself = |from: usize| {
        let mut seen = vec![false; imports.len()];
        let mut open = imports[from].clone();
        while let Some(at) = open.pop() {
            if !std::mem::replace(&mut seen[at], true) {
                open.extend(&imports[at]);
            }
        }
        seen[from]
    };
    (0..imports.len()).filter(|&f| reaches_itself(f)).collect()
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
        if group[at..].starts_with(is_path) || group[at..].starts_with('{') {
            at += members(&path, &group[at..], found)
        } else {
            at += group[at..].chars().next().map_or(1, char::len_utf8)
        }
    }
    length + at + 2
}

/// What of io a file names that its room may not know.
fn strangers(name: &str, source: &str) -> Vec<String> {
    let Some((room, types)) = IO_TYPES.iter().find(|(room, _)| name.starts_with(room)) else {
        return Vec::new();
    };
    let known = |path: &String| types.iter().any(|t| path.starts_with(t));
    let io = named(source).into_iter().filter(|p| p.starts_with("io::"));
    io.filter(|path| !known(path))
        .map(|path| format!("{name}: {room} may not name {path}"))
        .collect()
}

#[test]
fn some_rooms_know_little_of_io() {
    let found: Vec<String> = (sources().iter())
        .flat_map(|(name, source)| strangers(name, source))
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
    let count = |source: &str| strangers("models/prior/x.rs", source).len();
    assert_eq!(count("use crate::io::{Model};\nuse crate::io::Model;"), 0);
    assert_eq!(count("use crate::{Error, io::{Model, csv}};"), 1);
    assert_eq!(
        count(&code("/// [`crate::io::Bvh`]\nuse crate::io::Model;")),
        0
    );
}

/// The rows of a table of the facade's documentation: crate, and the crates that it imports.
fn documented_imports(doc: &str) -> Vec<(String, Vec<String>)> {
    let rows = doc.lines().filter_map(|l| l.strip_prefix("//! | posing-"));
    rows.map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let imports = cells[2].split(", ").filter(|i| !i.is_empty());
        (cells[0].to_string(), imports.map(String::from).collect())
    })
    .collect()
}

#[test]
fn the_table_of_crates_is_that_of_their_manifests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let doc = fs::read_to_string(root.join("src/lib.rs")).unwrap();
    let table = documented_imports(&doc);
    let mut names: Vec<&str> = table.iter().map(|(name, _)| name.as_str()).collect();
    names.sort_unstable();
    let crates = fs::read_dir(root.join("crates")).unwrap();
    let mut folders: Vec<_> = crates.map(|c| c.unwrap().file_name()).collect();
    folders.sort();
    assert_eq!(names, folders);
    for (name, imports) in &table {
        let manifest = root.join("crates").join(name).join("Cargo.toml");
        let manifest = fs::read_to_string(manifest).unwrap();
        let named = manifest.lines().filter_map(|l| l.strip_prefix("posing-"));
        let mut named: Vec<&str> = named.filter_map(|l| l.split(['.', ' ']).next()).collect();
        named.sort_unstable();
        assert_eq!(*imports, named, "posing-{name}");
    }
}

/// The modules that a facade declares or re-exports, those of crates with the crate's name.
fn facade_modules(source: &str) -> Vec<(String, Option<String>)> {
    let mut found = Vec::new();
    let mut module = None;
    for line in source.lines() {
        let text = line.trim().trim_end_matches([';', '{']).trim_end();
        let own = line.starts_with("pub");
        if let Some(name) = text.strip_prefix("pub mod ").filter(|_| own) {
            found.push((name.to_string(), None));
            module = line.ends_with('{').then(|| name.to_string());
        } else if let Some(path) = text.strip_prefix("pub use posing_") {
            let (name, rest) = path.split_once([':', ' ']).unwrap();
            let of = name.to_string();
            match &module {
                Some(module) if !own => found.push((module.clone(), Some(of))),
                _ => {
                    let names = rest
                        .trim_start_matches([':', '{'])
                        .trim_start_matches("as ");
                    let names = names.trim_end_matches('}').split(", ");
                    let modules = names.filter(|n| n.starts_with(char::is_lowercase));
                    found.extend(modules.map(|n| (n.to_string(), Some(of.clone()))));
                }
            }
        }
    }
    found.sort();
    found.dedup();
    found
}

#[test]
fn the_table_of_modules_is_that_of_the_facade() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let doc = fs::read_to_string(root.join("src/lib.rs")).unwrap();
    let modules = facade_modules(&doc);
    let mut listed: Vec<&str> = doc
        .lines()
        .filter_map(|line| line.strip_prefix("//! | [`")?.split_once("`] |"))
        .map(|(name, _)| name)
        .collect();
    listed.sort_unstable();
    let mut shown: Vec<&str> = modules.iter().map(|(name, _)| name.as_str()).collect();
    shown.retain(|name| !["error", "prelude"].contains(name));
    shown.dedup();
    assert_eq!(listed, shown);
    for row in doc.lines().filter_map(|l| l.strip_prefix("//! | posing-")) {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let of_crate = |(_, own): &&(String, Option<String>)| own.as_deref() == Some(cells[0]);
        let names: Vec<&str> = modules
            .iter()
            .filter(of_crate)
            .map(|(n, _)| n.as_str())
            .collect();
        assert_eq!(cells[1], names.join(", "), "posing-{}", cells[0]);
    }
}

#[test]
fn no_file_imports_a_file_that_imports_it_back() {
    let sources: Vec<(String, String)> = sources()
        .into_iter()
        .filter(|(name, _)| !name.starts_with("posing/bin/"))
        .collect();
    let circles = in_circles(&imports(&sources));
    let names: Vec<&str> = circles.iter().map(|&f| sources[f].0.as_str()).collect();
    assert!(names.is_empty(), "in a circle: {}", names.join(", "));
}

#[test]
fn a_circle_is_seen() {
    let file = |name: &str, source: &str| (name.to_string(), source.to_string());
    let sources = [
        file("k/a/mod.rs", "mod b; mod c; use b::B; use super::d::D;"),
        file("k/a/b.rs", "use super::{A, c::C};"),
        file("k/a/c.rs", "use crate::a::b::B;"),
        file("k/d.rs", "use crate::{Error, e::{E, F}};"),
        file("k/e.rs", "fn f() { super::a::g() }"),
        file("k/lib.rs", "pub mod a;"),
    ];
    assert_eq!(in_circles(&imports(&sources)), [0, 1, 2, 3, 4]);
    let sources = [
        file("k/a/mod.rs", "mod b; use b::B;"),
        file("k/a/b.rs", "use super::A; use crate::d::D;"),
        file("k/d.rs", "use crate::Error;"),
        file("k/lib.rs", "pub mod a;"),
        // Of another crate.
        file("l/d.rs", "use crate::a::b::B;"),
    ];
    assert!(in_circles(&imports(&sources)).is_empty());
}

#[test]
fn words_stay_at_home() {
    let mut strays = Vec::new();
    for (name, source) in sources() {
        for (word, homes) in HOMES {
            if source.contains(word) && !homes.iter().any(|home| name.starts_with(home)) {
                strays.push(format!("{name}: {word} belongs to {}", homes.join(", ")));
            }
        }
    }
    assert!(strays.is_empty(), "{}", strays.join("\n"));
}

/// Whether a line names a flag, such as `--map` or `--{name}`. `var(--line)` is CSS.
fn names_flag(line: &str) -> bool {
    let is_flag = |(at, _): (usize, &str)| {
        let is_name = |c: char| c.is_ascii_lowercase() || c == '{';
        line[at + 2..].starts_with(is_name) && !line[..at].ends_with("var(")
    };
    line.match_indices("--").any(is_flag)
}

/// The signatures of functions that others can call and whose error is a text.
fn text_errors(source: &str) -> Vec<&str> {
    let is_shown = |line: &str| line.trim_start().starts_with("pub") && line.contains("fn ");
    let mut found = Vec::new();
    let mut at = 0;
    for line in source.split_inclusive('\n') {
        let signature = source[at..].split('{').next().unwrap_or_default();
        let result = signature.split("where").next().unwrap_or_default();
        let result = result.rsplit("->").next().unwrap_or_default().trim();
        if is_shown(line) && result.contains("Result<") && result.ends_with(", String>") {
            found.push(signature.trim());
        }
        at += line.len();
    }
    found
}

#[test]
fn the_library_names_no_flags_and_its_errors_have_one_type() {
    let mut wrong = Vec::new();
    for (name, source) in sources() {
        if name.starts_with("posing/") {
            continue;
        }
        let flags = source.lines().filter(|line| names_flag(line));
        wrong.extend(flags.map(|line| format!("{name}: a flag: {}", line.trim())));
        let texts = text_errors(&source).into_iter();
        wrong.extend(texts.map(|f| format!("{name}: no crate::Error: {f}")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_flag_and_an_error_of_text_are_seen() {
    assert!(names_flag("\"give --fps F\"") && names_flag("--{name} 3"));
    assert!(!names_flag("stroke=\"var(--line)\"") && !names_flag("a -- b"));
    let source = "pub(super) fn a(\n    x: u8,\n) -> Result<u8, String> {\n}\nfn b() -> Result<u8, String> {}\n";
    assert_eq!(text_errors(source).len(), 1);
    let source = "    pub fn c<T>() -> Result<(), String>\n    where\n        T: Copy,\n    {\n";
    assert_eq!(text_errors(source).len(), 1);
    let source = "pub fn d() -> Result<BTreeMap<String, String>> {}\npub fn e() -> String {}\n";
    assert!(text_errors(source).is_empty());
}
