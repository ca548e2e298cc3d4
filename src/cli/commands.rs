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
        "Convert ASF/AMC takes to a table of joint positions",
        true,
    ),
    listed("cluster", "Group poses by hierarchical k-means", true),
    listed(
        "ksvd-train",
        "Train a sparse dictionary of poses by K-SVD",
        true,
    ),
    listed("dict-concat", "Join dictionaries into one", true),
    listed("denoise", "Remove noise and outliers from poses", true),
    listed("complete", "Fill gaps and missing points", true),
    listed("xyz2bvh", "Convert a pose table to a BVH file", true),
    listed("bvh2xyz", "Convert a BVH file to a pose table", false),
    listed("xyz2amc", "Convert a pose table to an AMC take", false),
    listed("prior-train", "Train a pose model", false),
    listed("encode", "Convert poses to sparse codes", false),
    listed("decode", "Convert sparse codes back to poses", false),
    listed(
        "corrupt",
        "Add noise, outliers or gaps to poses, for tests",
        false,
    ),
    listed("score", "Compare poses with the truth", false),
    listed(
        "evaluate",
        "Compare models on poses they were not trained on",
        false,
    ),
    listed(
        "plot",
        "Draw poses as SVG, or as an HTML page that plays them",
        false,
    ),
    listed(
        "model",
        "Show a model's training data, settings and credits",
        false,
    ),
];
