//! The commands, in the groups and the order in which they are listed: a first-time user's jobs
//! first.

use clap::Command;
use posing::cli::{command, run};
use std::ffi::OsString;
use std::process::ExitCode;

/// A command.
pub struct Entry {
    /// The word after `posing`, and the name of its link.
    pub name: &'static str,
    /// Whether `make install` links it into `bin` under its own name. No shell may own that name:
    /// `complete` is a builtin of bash and fish, which would run instead.
    pub linked: bool,
    /// Its parser.
    pub command: fn() -> Command,
    /// Runs it by its parser, with its name and its arguments.
    pub run: fn(Command, Vec<OsString>) -> ExitCode,
}

/// What `--version` says: the version, and the commit where `make` built it in a checkout. Only
/// here, so that pages, models and records stay the same from commit to commit.
pub fn version() -> String {
    let version = env!("CARGO_PKG_VERSION");
    match option_env!("POSING_COMMIT").filter(|commit| !commit.is_empty()) {
        Some(commit) => format!("{version} ({commit})"),
        None => version.to_string(),
    }
}

/// The entry of the command in the module $module.
macro_rules! entry {
    ($name:literal, $module:ident) => {
        entry!($name, $module, false)
    };
    ($name:literal, $module:ident, $linked:expr) => {
        Entry {
            name: $name,
            linked: $linked,
            command: command::<crate::$module::Args>,
            run: |command, words| run(command, words, version(), crate::$module::work),
        }
    };
}

/// The title and the commands of each group.
pub const GROUPS: &[(&str, &[Entry])] = &[
    ("First steps", &[entry!("demo", demo)]),
    (
        "Clean and complete",
        &[
            entry!("audit", audit),
            entry!("clean", clean),
            entry!("complete", complete),
            entry!("between", between),
            entry!("denoise", denoise, true),
            entry!("label", label),
            entry!("edit", edit),
        ],
    ),
    (
        "Convert to pose tables",
        &[
            entry!("bvh2xyz", bvh2xyz),
            #[cfg(feature = "fbx")]
            entry!("fbx2xyz", fbx2xyz),
            #[cfg(feature = "fbx")]
            entry!("fbx2bvh", fbx2bvh),
            entry!("c3d2xyz", c3d2xyz),
            entry!("trc2xyz", trc2xyz),
            entry!("csv2xyz", csv2xyz),
            entry!("solve", solve),
            entry!("amc2xyz", amc2xyz, true),
        ],
    ),
    (
        "Convert from pose tables",
        &[
            entry!("xyz2bvh", xyz2bvh, true),
            entry!("xyz2c3d", xyz2c3d),
            entry!("xyz2trc", xyz2trc),
            entry!("xyz2amc", xyz2amc),
            entry!("xyz2glb", xyz2glb),
        ],
    ),
    (
        "Other skeletons and floors",
        &[entry!("retarget", retarget), entry!("ground", ground)],
    ),
    (
        "Gait",
        &[entry!("gait", gait), entry!("c3d2forces", c3d2forces)],
    ),
    (
        "Choose and draw",
        &[
            entry!("trim", trim),
            entry!("mirror", mirror),
            entry!("align", align),
            entry!("plot", plot),
        ],
    ),
    (
        "Train pose models",
        &[
            entry!("prior-train", prior_train),
            entry!("rotations-train", rotations_train),
            entry!("cluster", cluster, true),
            entry!("ksvd-train", ksvd_train, true),
            entry!("dict-concat", dict_concat, true),
            entry!("encode", encode),
            entry!("decode", decode),
            entry!("model", model),
        ],
    ),
    (
        "Compare poses",
        &[
            entry!("gpd", gpd),
            entry!("pose-distance", pose_distance),
            entry!("retrieve", retrieve),
            entry!("transition", transition),
            entry!("rdsr-train", rdsr_train),
            entry!("pair-label", pair_label),
        ],
    ),
    (
        "Bodies",
        &[
            entry!("body-fit", body_fit),
            entry!("body-animate", body_animate),
            entry!("body-scan", body_scan),
            entry!("body-synth", body_synth),
            entry!("body-train", body_train),
            entry!("mesh-register", mesh_register),
        ],
    ),
    (
        "Evaluate",
        &[
            entry!("evaluate", evaluate),
            entry!("score", score),
            entry!("corrupt", corrupt),
        ],
    ),
];

/// All commands.
pub fn all() -> impl Iterator<Item = &'static Entry> {
    GROUPS.iter().flat_map(|(_, entries)| *entries)
}

/// The command of that name.
pub fn find(name: &str) -> Option<&'static Entry> {
    all().find(|entry| entry.name == name)
}
