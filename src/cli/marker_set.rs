//! Marker sets by their name or file on the command line.

use crate::solve::MarkerSet;
use crate::{Error, Result};
use std::borrow::Cow;
use std::path::Path;

/// The marker set of a name, or of a file: lines `NAME = "LANDMARK"` (TOML), or one that was
/// learned (JSON).
///
/// # Errors
/// [`Error::Usage`]: there is no such set and no such file. Those of [`MarkerSet::open`].
pub fn marker_set(word: &str) -> Result<Cow<'static, MarkerSet>> {
    if let Some(set) = MarkerSet::find(word) {
        return Ok(Cow::Borrowed(set));
    }
    if Path::new(word).exists() {
        return MarkerSet::open(word).map(Cow::Owned);
    }
    let all: Vec<&str> = MarkerSet::shipped()
        .iter()
        .map(|s| s.name.as_str())
        .collect();
    Err(Error::usage(format!(
        "there is no marker set {word}, nor a file of that name; there are {}",
        all.join(", ")
    )))
}
