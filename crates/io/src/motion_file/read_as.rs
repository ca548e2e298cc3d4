//! What a file is taken for: by what it says itself, else by options, else by the custom of its
//! format.

use serde::Serialize;

/// Where something that was taken for true comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The file says so.
    File,
    /// An option does.
    #[serde(rename = "flag")]
    Option,
    /// The custom of the format.
    Custom,
}

/// Something that was taken for true, and where it comes from.
#[derive(Debug, Clone, Serialize)]
pub struct Assumed<T> {
    /// What it is.
    pub value: T,
    /// Where it comes from.
    pub from: Source,
}

/// What a file was taken for.
#[derive(Debug, Clone, Serialize)]
pub struct ReadAs {
    /// Frames per second; `None`: a single frame.
    pub rate: Option<Assumed<f64>>,
    /// The unit of length.
    pub unit: Assumed<String>,
    /// The axis that points up.
    pub up: Assumed<String>,
}
