//! The commands there are, with a line each.

/// A command: its name, what it is for, and whether it is one of the seven that `make install` puts on the path.
pub struct Listed {
    /// What the user types.
    pub name: &'static str,
    /// One line.
    pub about: &'static str,
    /// Whether it stands on the path by itself.
    pub on_path: bool,
}

const fn listed(name: &'static str, about: &'static str, on_path: bool) -> Listed {
    Listed {
        name,
        about,
        on_path,
    }
}

/// In the order in which the launcher lists them.
pub const COMMANDS: &[Listed] = &[
    listed(
        "amc2xyz",
        "Turn ASF/AMC takes into a table of joint positions",
        true,
    ),
    listed("cluster", "Group poses by hierarchical k-means", true),
    listed("ksvd-train", "Learn a dictionary of poses", true),
    listed("dict-concat", "Join dictionaries into one", true),
    listed("denoise", "Take the noise out of captured poses", true),
    listed("complete", "Fill in what a capture did not see", true),
    listed("xyz2bvh", "Turn a pose table into a BVH file", true),
    listed("bvh2xyz", "Turn a BVH file into a pose table", false),
    listed("xyz2amc", "Turn a pose table into an AMC take", false),
    listed("prior-train", "Learn a prior of poses of any kind", false),
    listed("encode", "Turn poses into sparse codes", false),
    listed("decode", "Turn sparse codes back into poses", false),
    listed("corrupt", "Damage poses on purpose, for tests", false),
    listed("score", "Compare poses with the truth", false),
    listed(
        "evaluate",
        "Compare models on poses they have not learnt from",
        false,
    ),
    listed(
        "plot",
        "Draw a table as SVG, or as a page that plays it",
        false,
    ),
    listed(
        "model",
        "Tell what a model is and where it came from",
        false,
    ),
];
