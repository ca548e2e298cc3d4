//! The list of commands: the one place that the launcher, completions, installation and tests read.

use clap::Command;

/// A command of the family.
#[derive(Debug, Clone, Copy)]
pub struct CommandEntry {
    /// The name of its binary, and the word after `posing`.
    pub name: &'static str,
    /// One line for the launcher's list; the command's own help opens with it.
    pub about: &'static str,
    /// Whether `make install` links it into `bin` under its own name. No shell may own that name: `complete` is a
    /// builtin of bash and fish, which would run instead.
    pub linked: bool,
}

const fn entry(name: &'static str, about: &'static str, linked: bool) -> CommandEntry {
    CommandEntry {
        name,
        about,
        linked,
    }
}

/// All commands, in the order in which the launcher lists them.
pub const COMMANDS: &[CommandEntry] = &[
    entry(
        "amc2xyz",
        "Convert ASF/AMC takes to a table of joint positions",
        true,
    ),
    entry("cluster", "Group poses by hierarchical k-means", true),
    entry(
        "ksvd-train",
        "Train a sparse dictionary of poses by K-SVD",
        true,
    ),
    entry("dict-concat", "Join dictionaries into one", true),
    entry(
        "audit",
        "Find what is wrong in takes: rate, unit, gaps, swaps, jumps",
        false,
    ),
    entry(
        "clean",
        "Clean takes of any format: fill gaps, replace outliers, remove noise",
        false,
    ),
    entry("denoise", "Remove noise and outliers from poses", true),
    entry("complete", "Fill gaps and missing points", false),
    entry(
        "edit",
        "Pose a figure by hand: drag joints on a local page",
        false,
    ),
    entry(
        "trim",
        "Choose frames, takes and points, resample, rename, filter",
        false,
    ),
    entry("xyz2bvh", "Convert a pose table to a BVH file", true),
    entry(
        "xyz2glb",
        "Convert a pose table to binary glTF: a skeleton that viewers play",
        false,
    ),
    entry("bvh2xyz", "Convert a BVH file to a pose table", false),
    entry("c3d2xyz", "Convert a C3D file to a pose table", false),
    entry("xyz2c3d", "Convert a pose table to a C3D file", false),
    entry("trc2xyz", "Convert a TRC file to a pose table", false),
    entry("xyz2trc", "Convert a pose table to a TRC file", false),
    entry(
        "csv2xyz",
        "Convert a table of another program to a pose table",
        false,
    ),
    entry("xyz2amc", "Convert a pose table to an AMC take", false),
    entry("prior-train", "Train a pose model", false),
    entry("encode", "Convert poses to sparse codes", false),
    entry("decode", "Convert sparse codes back to poses", false),
    entry("gpd", "Describe poses by 1,683 geometric features", false),
    entry(
        "rdsr-train",
        "Learn how alike poses are from labelled pairs",
        false,
    ),
    entry("pose-distance", "Compute how alike poses are", false),
    entry(
        "retrieve",
        "Find the poses of a database that are most like given ones",
        false,
    ),
    entry(
        "pair-label",
        "Propose pairs of poses, and label them alike or not on a page",
        false,
    ),
    entry(
        "transition",
        "Find frames at which one take can go over into another",
        false,
    ),
    entry("mesh-register", "Lay a template mesh on a raw scan", false),
    entry(
        "body-train",
        "Learn a body's pose and shape from meshes",
        false,
    ),
    entry(
        "body-synth",
        "Make meshes of a body from rotations or a pose table",
        false,
    ),
    entry(
        "body-fit",
        "Complete a body from markers on its skin",
        false,
    ),
    entry(
        "body-animate",
        "Animate a body from a take of markers",
        false,
    ),
    entry(
        "body-scan",
        "Complete a body from a partial scan and a few points",
        false,
    ),
    entry(
        "corrupt",
        "Add noise, outliers or gaps to poses, for tests",
        false,
    ),
    entry("score", "Compare poses with the truth", false),
    entry(
        "evaluate",
        "Compare models on poses they were not trained on",
        false,
    ),
    entry(
        "plot",
        "Draw poses or meshes as SVG, or as an HTML page that plays them",
        false,
    ),
    entry(
        "model",
        "Show a model's training data, settings and credits",
        false,
    ),
];

/// The entry of `name`.
pub fn find(name: &str) -> Option<&'static CommandEntry> {
    COMMANDS.iter().find(|entry| entry.name == name)
}

/// The commands as subcommands of the launcher, for its help and manual page.
pub fn subcommands() -> impl Iterator<Item = Command> {
    COMMANDS
        .iter()
        .map(|entry| Command::new(entry.name).about(entry.about))
}
