//! The file `cells.jsonl` of a run's folder: finished results, a line of JSON each, from which the
//! next run goes on.

use super::BenchmarkResult;
use super::runner::Results;
use crate::{Error, Place, Result};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file's name.
const NAME: &str = "cells.jsonl";

/// A line of the cache.
#[derive(Serialize, Deserialize)]
struct CacheLine<T> {
    key: String,
    #[serde(rename = "done", alias = "cell")]
    result: T,
}

/// The results of a folder and the file that holds them.
pub struct ResultCache {
    path: PathBuf,
    file: File,
    results: Results,
}

impl ResultCache {
    /// Opens the file, or creates it with its folder. An incomplete last line, left by a killed
    /// run, is removed.
    ///
    /// # Errors
    /// A line that is not a result, with its number.
    pub fn open(folder: &Path) -> Result<ResultCache> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let path = folder.join(NAME);
        let fail = |e| Error::io(&path, e);
        let text = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(fail(e)),
            _ => Vec::new(),
        };
        let whole = whole_lines(&text);
        let results = parse(whole, &path)?;
        let file = File::options().create(true).append(true).open(&path);
        let file = file.map_err(fail)?;
        file.set_len(whole.len() as u64).map_err(fail)?;
        Ok(ResultCache {
            path,
            file,
            results,
        })
    }

    /// The results.
    pub fn results(&self) -> &Results {
        &self.results
    }

    /// Takes the results out; the file keeps them.
    pub fn take(&mut self) -> Results {
        std::mem::take(&mut self.results)
    }

    /// Adds results that are not there yet.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, results: Results) -> Result<()> {
        for (key, result) in results {
            if self.results.get(&key) != Some(&result) {
                self.append(&key, &result)?;
                self.results.insert(key, result);
            }
        }
        Ok(())
    }

    /// Writes a result into the file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn append(&mut self, key: &str, result: &BenchmarkResult) -> Result<()> {
        let key = key.into();
        let line = serde_json::to_string(&CacheLine { key, result });
        let line = line.map_err(|e| Error::usage(e.to_string()))? + "\n";
        let write = self.file.write_all(line.as_bytes());
        write.map_err(|e| Error::io(&self.path, e))
    }
}

/// Reads the results of a folder, which may be still at work. Returns the file's name with them.
///
/// # Errors
/// When there is no such file; a line that is not a result, with its number.
pub fn read(folder: &Path) -> Result<(String, Results)> {
    let path = folder.join(NAME);
    let text = fs::read(&path).map_err(|e| Error::io(&path, e))?;
    let results = parse(whole_lines(&text), &path)?;
    Ok((path.display().to_string(), results))
}

fn whole_lines(text: &[u8]) -> &[u8] {
    let end = text.iter().rposition(|b| *b == b'\n');
    &text[..end.map_or(0, |at| at + 1)]
}

fn parse(lines: &[u8], path: &Path) -> Result<Results> {
    let mut results = Results::new();
    let lines = lines.split(|b| *b == b'\n').enumerate();
    for (i, line) in lines.filter(|(_, l)| !l.is_empty()) {
        let line: CacheLine<BenchmarkResult> = serde_json::from_slice(line).map_err(|e| {
            let name = path.display().to_string();
            let what = format!("is not a cached result ({e}); remove the file");
            Error::data(Place::line(name, i as u64 + 1), what)
        })?;
        results.insert(line.key, line.result);
    }
    Ok(results)
}
