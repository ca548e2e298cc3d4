//! The record beside a result: what it was made from and by which settings, what the file was taken for, what was found and changed.

use super::replaced::ReplacedPosition;
use crate::audit::TakeAudit;
use crate::cli::gap_report::GapLine;
use crate::cli::motion_file::ReadAs;
use crate::io::output::write_file;
use crate::prior::provenance::hex;
use crate::{Error, Place, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// A file by its name and content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// The file's name, without its folder.
    pub file: String,
    /// The SHA-256 of its bytes.
    pub sha256: String,
}

impl Fingerprint {
    /// The fingerprint of a file whose bytes are `bytes`.
    pub fn of(path: &Path, bytes: &[u8]) -> Fingerprint {
        let name = path.file_name().unwrap_or(path.as_os_str());
        Fingerprint {
            file: name.to_string_lossy().into_owned(),
            sha256: hex(&Sha256::digest(bytes)),
        }
    }

    /// The fingerprint of a file on disk.
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be read.
    pub fn read(path: &Path) -> Result<Fingerprint> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        Ok(Fingerprint::of(path, &bytes))
    }
}

/// What a result was made from. Where nothing of it changes, the result does not either.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MadeFrom {
    /// The version of posing.
    pub posing: String,
    /// The settings that change results.
    pub settings: serde_json::Value,
    /// The capture.
    pub input: Fingerprint,
    /// The skeleton of an AMC take.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub skeleton: Option<Fingerprint>,
}

/// What became of a file, in numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The format of the capture.
    pub format: String,
    /// Frames.
    pub frames: usize,
    /// Points.
    pub points: usize,
    /// Frames a second.
    pub rate: Option<f64>,
    /// Positions that were missing: points times frames.
    pub missing: usize,
    /// Missing positions that were filled.
    pub filled: usize,
    /// Outliers that were replaced.
    pub outliers: usize,
    /// Noise of a coordinate, cm.
    pub noise: f64,
    /// Whether it was removed.
    pub denoised: bool,
    /// What somebody should look at, a line each.
    pub findings: Vec<String>,
    /// How the file was taken, and what was odd in it, a line each.
    pub notes: Vec<String>,
}

/// The record of a result.
#[derive(Debug, Serialize)]
pub struct Record<'a> {
    /// The command that made it.
    pub command: &'static str,
    /// What it was made from.
    pub made_from: &'a MadeFrom,
    /// What the file was taken for.
    pub read_as: &'a ReadAs,
    /// The map of its points' names, where one was used.
    pub map: Option<&'a str>,
    /// What was wrong before.
    pub audit: &'a [TakeAudit],
    /// What became of it.
    pub summary: &'a Summary,
    /// Every gap, and how it was filled.
    pub gaps: Vec<GapLine<'a>>,
    /// Measured positions that were replaced as outliers.
    pub outliers: Vec<ReplacedPosition>,
    /// The result.
    pub output: Fingerprint,
}

/// What is read of an earlier record.
#[derive(Deserialize)]
struct Earlier {
    command: String,
    made_from: MadeFrom,
    /// Without it and `output`, a run was stopped while it wrote the result.
    summary: Option<Summary>,
    output: Option<Fingerprint>,
}

impl Earlier {
    fn read(output: &Path) -> Option<Earlier> {
        let text = std::fs::read(record_path(output)).ok()?;
        let earlier: Earlier = serde_json::from_slice(&text).ok()?;
        (earlier.command == "clean").then_some(earlier)
    }

    /// Whether a result is as the run left it; one that was stopped says nothing of that.
    fn is_of(&self, output: &Path) -> Result<bool> {
        match &self.output {
            Some(was) => Ok(Fingerprint::read(output)?.sha256 == was.sha256),
            None => Ok(true),
        }
    }
}

/// Fails where something stands in the place of a result or of its record that is not what a run of `clean` left there; with `again`, a
/// result that was changed since may be made again.
///
/// # Errors
/// [`Error::Data`].
pub fn may_write(output: &Path, again: bool) -> Result<()> {
    let record = record_path(output);
    let (path, what) = match Earlier::read(output) {
        None if record.exists() => (
            record.as_path(),
            "stands in the place of a record and is none; move it, or give another place with -o",
        ),
        None if output.exists() => (
            output,
            "is there and has no record that clean made it; move it, or give another place with -o",
        ),
        Some(earlier) if !again && output.exists() && !earlier.is_of(output)? => (
            output,
            "was changed since clean made it; move it, or make it again with --again",
        ),
        _ => return Ok(()),
    };
    Err(Error::data(Place::file(path.display().to_string()), what))
}

/// Says beside a result that it is being made, in a folder that is made if need be: what a stopped run left is known by that.
///
/// # Errors
/// [`Error::Io`]: writing fails.
pub fn begin(output: &Path, made_from: &MadeFrom) -> Result<()> {
    make_folder_of(output)?;
    let json = json!({"command": "clean", "made_from": made_from});
    write_file(record_path(output), format!("{json}\n").as_bytes())
}

/// Takes back what [`begin`] said, where no result came of it.
pub fn give_up(output: &Path) {
    if !output.exists() {
        // It is gone, or a later run finds that nothing was made.
        let _ = std::fs::remove_file(record_path(output));
    }
}

/// Whether a result of an earlier run stands there.
pub fn has_result(output: &Path) -> bool {
    output.exists() && Earlier::read(output).is_some()
}

impl Record<'_> {
    /// Writes it beside the result.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub fn write(&self, output: &Path) -> Result<()> {
        let json = serde_json::to_string_pretty(self).map_err(|e| Error::usage(e.to_string()))?;
        write_file(record_path(output), (json + "\n").as_bytes())
    }
}

/// What an earlier run says of a result that is still what it made of the same.
pub fn unchanged(output: &Path, made_from: &MadeFrom) -> Option<Summary> {
    let earlier = Earlier::read(output)?;
    let is_same =
        earlier.made_from == *made_from && Fingerprint::read(output).ok() == earlier.output;
    earlier.summary.filter(|_| is_same)
}

/// Makes the folder of a file.
///
/// # Errors
/// [`Error::Io`]: it cannot be made.
pub fn make_folder_of(path: &Path) -> Result<()> {
    match path.parent() {
        Some(folder) => std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e)),
        None => Ok(()),
    }
}

/// The place of the record of a result.
pub fn record_path(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".json");
    PathBuf::from(name)
}
