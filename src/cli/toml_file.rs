//! TOML files of settings: read, and parsed with file and line in errors.

use super::input;
use crate::{Error, Place, Result};
use serde::de::DeserializeOwned;
use std::path::Path;

/// No TOML file is larger.
const LARGEST: u64 = 1 << 20;

/// Reads a TOML file; also its name in messages.
///
/// # Errors
/// [`Error::Data`] if it cannot be read, is not UTF-8, or is no `T`.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<(T, String)> {
    let input = input::open(path)?;
    let name = input.name.clone();
    let text = String::from_utf8(input.read_all(LARGEST)?)
        .map_err(|_| Error::data(Place::file(&name), "is not a TOML file: it is not UTF-8"))?;
    Ok((parse(&text, &name)?, name))
}

/// Parses TOML; `name` names the file in errors.
///
/// # Errors
/// [`Error::Data`] with file and line.
pub fn parse<T: DeserializeOwned>(text: &str, name: &str) -> Result<T> {
    toml::from_str(text).map_err(|e| {
        let at = e.span().map_or(0, |s| s.start.min(text.len()));
        let line = 1 + text[..at].matches('\n').count();
        let what: Vec<&str> = e.message().lines().collect();
        Error::data(Place::line(name, line as u64), what.join(" "))
    })
}
