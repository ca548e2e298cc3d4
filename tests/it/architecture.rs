//! The sources themselves: arrows between rooms run one way, and what belongs to one room stays in
//! it.

use std::fs;
use std::path::{Path, PathBuf};

/// What each room may name of the crate, besides itself and `Error`, `Place`, `Result`.
/// `numeric` stands below all rooms.
const MAY_NAME: &[(&str, &[&str])] = &[
    ("numeric", &[]),
    ("pose", &["numeric"]),
    ("label", &["pose", "numeric", "io"]),
    ("io", &["pose", "numeric"]),
    ("cluster", &["pose", "numeric"]),
    ("sparse", &["pose", "numeric"]),
    ("metric", &["pose", "numeric", "io"]),
    ("body", &["pose", "numeric", "io"]),
    ("ik", &["pose", "numeric", "prior", "io"]),
    // A prior is made from a model, a restoration changes a table: of io some rooms may name
    // `IO_TYPES` only.
    (
        "prior",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "io",
        ],
    ),
    (
        "restore",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "prior", "label", "io",
        ],
    ),
    (
        "solve",
        &["pose", "numeric", "prior", "label", "io", "ik", "draw"],
    ),
    ("draw", &["pose", "numeric", "io"]),
    (
        "evaluate",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "prior", "restore", "io",
            "draw",
        ],
    ),
    (
        "audit",
        &["pose", "numeric", "label", "restore", "io", "draw", "solve"],
    ),
    (
        "clean",
        &[
            "pose", "numeric", "prior", "restore", "io", "ik", "draw", "audit", "label", "solve",
        ],
    ),
    (
        "edit",
        &[
            "pose", "numeric", "cluster", "sparse", "metric", "body", "prior", "restore", "io",
            "ik",
        ],
    ),
    ("server", &["pose", "restore", "io", "ik", "draw", "edit"]),
    (
        "cli",
        &[
            "pose", "numeric", "io", "cluster", "sparse", "metric", "body", "prior", "restore",
            "ik", "draw", "evaluate", "edit", "audit", "clean", "server", "label", "solve",
        ],
    ),
];

/// The crates that the rooms will be: what each holds, longer paths before shorter ones, and what it
/// may import. The facade, `cli` and the programs import all.
const CRATES: &[(&str, &[&str], &[&str])] = &[
    ("core", &["error", "names", "numeric", "pose"], &[]),
    ("io", &["io"], &["core"]),
    ("draw", &["draw"], &["core", "io"]),
    ("models", &["cluster", "sparse", "prior"], &["core", "io"]),
    ("label", &["label"], &["core", "io"]),
    ("restore", &["restore"], &["core", "io", "models", "label"]),
    (
        "joints",
        &["ik", "solve"],
        &["core", "io", "draw", "models", "label"],
    ),
    (
        "clean",
        &["audit", "clean"],
        &["core", "io", "draw", "models", "label", "restore", "joints"],
    ),
    ("likeness", &["metric"], &["core", "io"]),
    ("body", &["body"], &["core", "io"]),
    (
        "edit",
        &["edit", "server"],
        &["core", "io", "draw", "models", "label", "restore", "joints"],
    ),
    (
        "papers",
        &[
            "prior/published",
            "metric/baselines",
            "metric/learners",
            "evaluate",
        ],
        &[
            "core", "io", "draw", "models", "label", "restore", "likeness",
        ],
    ),
];

/// Rooms that know only some types of io: data that they are made from or turned into.
const IO_TYPES: &[(&str, &[&str])] = &[
    ("metric", &["io::Model"]),
    ("body", &["io::Model", "io::glb"]),
    ("ik", &["io::Bvh", "io::bvh"]),
    ("prior", &["io::Model", "io::model"]),
    (
        "restore",
        &["io::Model", "io::model", "io::Table", "io::Output"],
    ),
    // What is tested restores tables with a model.
    ("evaluate", &["io::Model", "io::Table"]),
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
    ("ndarray_linalg", &["numeric/linalg/"]),
    ("bvh_anim", &["io/bvh"]),
];

/// Words of modules that are to stand in a crate above the room that they lie in, the only places
/// under src/ that may hold them besides [`ABOVE_PAPERS`], and what others do instead.
const PAPERS: &[(&[&str], &[&str], &str)] = &[
    (
        &["published::"],
        &["prior/published/"],
        "a kind of prior is an entry that prior::register makes known; tests of one stand beside it",
    ),
    (
        &["learners::", "PublishedLearner"],
        &["metric/learners/", "metric/baselines.rs"],
        "a learner is a metric::train::PairLearner, which the caller passes as Learner::Other",
    ),
    (
        &["baselines::", "Baseline"],
        &["metric/baselines.rs"],
        "what baselines and others share stands in metric, below both",
    ),
];

/// Rooms that stand above the published kinds, learners and distances.
const ABOVE_PAPERS: &[&str] = &["evaluate/", "cli/", "bin/"];

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

/// The source without comments (line for line), so that documentation may link upwards, and without
/// the unit tests at its foot, which may look around.
fn code(source: &str) -> String {
    let tests =
        ["mod ", "pub(super) mod ", "pub(crate) mod "].map(|m| format!("\n#[cfg(test)]\n{m}"));
    let source = tests.iter().fold(source, |source, tests| {
        source.split(&tests[..]).next().unwrap_or_default()
    });
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

/// The module of a file: `restore/placement/mod.rs` is `["restore", "placement"]`.
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
        let mut paths: Vec<String> = named(source);
        for ups in 1..=own.len() {
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

/// The crate of a file, as its place in [`CRATES`].
fn crate_of(name: &str) -> Option<usize> {
    let is_in = |room: &str| {
        let rest = name.strip_prefix(room);
        rest.is_some_and(|rest| rest.starts_with(['/', '.']))
    };
    let rooms = CRATES.iter().enumerate();
    let rooms = rooms.flat_map(|(at, (_, rooms, _))| rooms.iter().map(move |room| (at, *room)));
    let own = rooms.filter(|(_, room)| is_in(room));
    own.max_by_key(|(_, room)| room.len()).map(|(at, _)| at)
}

#[test]
fn crates_import_those_above_them() {
    let sources = sources();
    let mut broken = Vec::new();
    for ((name, _), imports) in sources.iter().zip(imports(&sources)) {
        let Some(from) = crate_of(name) else { continue };
        let (own, _, may) = CRATES[from];
        for to in imports {
            let Some(to_crate) = crate_of(&sources[to].0).map(|at| CRATES[at].0) else {
                continue;
            };
            if to_crate != own && !may.contains(&to_crate) {
                broken.push(format!(
                    "src/{name} ({own}) -> {} ({to_crate})",
                    sources[to].0
                ));
            }
        }
    }
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
fn no_file_imports_a_file_that_imports_it_back() {
    let sources: Vec<(String, String)> = sources()
        .into_iter()
        .filter(|(name, _)| !name.starts_with("bin/"))
        .collect();
    let circles = in_circles(&imports(&sources));
    let names: Vec<&str> = circles.iter().map(|&f| sources[f].0.as_str()).collect();
    assert!(names.is_empty(), "in a circle: {}", names.join(", "));
}

#[test]
fn a_circle_is_seen() {
    let file = |name: &str, source: &str| (name.to_string(), source.to_string());
    let sources = [
        file("a/mod.rs", "mod b; mod c; use b::B; use super::d::D;"),
        file("a/b.rs", "use super::{A, c::C};"),
        file("a/c.rs", "use crate::a::b::B;"),
        file("d.rs", "use crate::{Error, e::{E, F}};"),
        file("e.rs", "fn f() { super::a::g() }"),
        file("lib.rs", "pub mod a;"),
    ];
    assert_eq!(in_circles(&imports(&sources)), [0, 1, 2, 3, 4]);
    let sources = [
        file("a/mod.rs", "mod b; use b::B;"),
        file("a/b.rs", "use super::A; use crate::d::D;"),
        file("d.rs", "use crate::Error;"),
        file("lib.rs", "pub mod a;"),
    ];
    assert!(in_circles(&imports(&sources)).is_empty());
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

/// The lines of a file that name a module of [`PAPERS`], and what to do instead. A room's own `mod`
/// and `pub use` are how it shows what lies in it.
fn names_papers(name: &str, source: &str) -> Vec<String> {
    let mut found = Vec::new();
    let is_in = |places: &[&str]| places.iter().any(|place| name.starts_with(place));
    if is_in(ABOVE_PAPERS) {
        return found;
    }
    for line in source.lines().filter(|line| !line.starts_with("pub use ")) {
        for (words, homes, instead) in PAPERS {
            let word = words.iter().find(|word| line.contains(**word));
            if let Some(word) = word.filter(|_| !is_in(homes)) {
                found.push(format!("src/{name}: {word} stands above it: {instead}"));
            }
        }
    }
    found
}

#[test]
fn priors_and_metrics_name_nothing_of_papers() {
    let mut wrong = Vec::new();
    for (name, source) in sources() {
        wrong.extend(names_papers(&name, &source));
        // In a room of its own crate such a line would be off always.
        let is_room = ["prior/", "metric/"].iter().any(|r| name.starts_with(r));
        if is_room && !name.ends_with("/mod.rs") && source.contains("feature = \"published\"") {
            wrong.push(format!(
                "src/{name}: the feature `published` chooses modules in mod.rs: make it one, or \
                 keep it always"
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_name_of_papers_is_seen() {
    let count = |name: &str, source: &str| names_papers(name, source).len();
    let source = "use super::published;\nfn f(k: published::Kind) {}\nfn g() { options.published }";
    assert_eq!(count("prior/registry.rs", source), 1);
    assert_eq!(count("prior/published/mod.rs", source), 0);
    assert_eq!(count("evaluate/benchmark/method.rs", source), 0);
    let source = "use super::learners::{self, lms};\nlet b = super::Baseline::Jod;";
    assert_eq!(count("metric/train.rs", source), 2);
    assert_eq!(count("metric/baselines.rs", source), 0);
    let source = "pub mod baselines;\npub use baselines::Baseline;";
    assert_eq!(count("metric/mod.rs", source), 0);
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
        if name.starts_with("cli/") || name.starts_with("bin/") {
            continue;
        }
        let flags = source.lines().filter(|line| names_flag(line));
        wrong.extend(flags.map(|line| format!("src/{name}: a flag: {}", line.trim())));
        let texts = text_errors(&source).into_iter();
        wrong.extend(texts.map(|f| format!("src/{name}: no crate::Error: {f}")));
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
