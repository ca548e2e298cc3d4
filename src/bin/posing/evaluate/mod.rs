//! Compares models on poses they have not learned from: on takes, and as papers do.

#[cfg(feature = "papers")]
mod benchmark;
#[cfg(feature = "papers")]
mod metric;
#[cfg(feature = "papers")]
mod papers;
mod takes;
#[cfg(not(feature = "papers"))]
mod takes_alone;

#[cfg(feature = "papers")]
pub use papers::{Args, work};
#[cfg(not(feature = "papers"))]
pub use takes_alone::{Args, work};

use posing::cli::args::InputArgs;
use posing::cli::input;
use posing::cli::paths::check_written;
use posing::pose::Poses;
use posing::{Error, Result};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Reads the tables, each by itself.
fn sources(flags: &InputArgs, tables: &[PathBuf]) -> Result<Vec<(String, Poses)>> {
    let tables = input::or_stdin(tables);
    input::check_single_stdin(&tables)?;
    let read = |path: &PathBuf| {
        let mut table = input::read_table(&flags.with_files(vec![path.clone()]), false, false)?;
        let frames = table.poses.frames();
        (table.poses.take).get_or_insert_with(|| vec![stem(path).into(); frames]);
        Ok((table.name, table.poses))
    };
    tables.iter().map(read).collect()
}

/// Writes the results into a folder.
fn write(folder: &Path, files: &[(&str, String)]) -> Result<()> {
    check_written(files.iter().map(|(name, _)| folder.join(name)))?;
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    for (name, text) in files {
        posing::io::output::write_file(folder.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// JSON as it is written to a file.
#[cfg(feature = "papers")]
fn parsed(json: &str) -> Result<Value> {
    serde_json::from_str(json).map_err(|e| Error::usage(e.to_string()))
}

/// The rows of a table, each an object with the titles as names.
fn rows_of(csv: &str) -> Vec<Value> {
    let mut lines = csv.lines().map(|line| line.split(','));
    let titles: Vec<&str> = lines.next().into_iter().flatten().collect();
    let cell = |text: &str| match (text.parse::<u64>(), text.parse::<f64>()) {
        _ if text.is_empty() => Value::Null,
        (Ok(number), _) => number.into(),
        (_, Ok(number)) => number.into(),
        _ => text.into(),
    };
    let row = |cells: std::str::Split<'_, char>| -> Value {
        let named = titles.iter().map(|title| (*title).to_string());
        Value::Object(named.zip(cells.map(cell)).collect())
    };
    lines.map(row).collect()
}

/// The name of a file without folder and last extension.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
    stem.unwrap_or_else(|| "model".into())
}
