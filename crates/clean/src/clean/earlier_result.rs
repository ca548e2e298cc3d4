//! What an earlier run left at the path of a result: the result itself, and its record, by which
//! it is known. What may be replaced, what need not be made again, and what a run says there before
//! it has a result.

use super::record::{Fingerprint, MadeFrom, Summary, make_folder_of, record_path};
use crate::io::output::write_file;
use crate::{Error, Place, Result};
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::Path;

/// What an earlier run left at the path of a result.
pub(super) struct EarlierResult<'a> {
    /// The path.
    pub output: &'a Path,
    record: Option<EarlierRecord>,
}

/// What is read of an earlier record.
#[derive(Deserialize)]
struct EarlierRecord {
    command: String,
    /// A file that failed has none.
    made_from: Option<MadeFrom>,
    /// The digest of what stood there as a run began to write the result.
    replaces: Option<String>,
    /// Without it, `output` and `error`, a run was stopped while it wrote the result.
    summary: Option<Summary>,
    output: Option<Fingerprint>,
    /// Why the last run failed. With `output`, that is of a run before.
    error: Option<String>,
    /// The skeleton beside the result, or why there is none.
    #[serde(default)]
    solved: Value,
}

impl EarlierRecord {
    fn read(output: &Path) -> Option<EarlierRecord> {
        let text = std::fs::read(record_path(output)).ok()?;
        let earlier: EarlierRecord = serde_json::from_slice(&text).ok()?;
        (earlier.command == "clean").then_some(earlier)
    }

    /// Whether no run made the result, but one that failed.
    fn is_failure(&self) -> bool {
        self.error.is_some() && self.output.is_none()
    }

    /// Whether a result is as the run left it; one that was stopped says nothing of that.
    fn is_of(&self, output: &Path) -> Result<bool> {
        match &self.output {
            Some(was) => Ok(Fingerprint::read(output)?.sha256 == was.sha256),
            None => Ok(true),
        }
    }
}

impl<'a> EarlierResult<'a> {
    /// What stands there now.
    pub(super) fn read(output: &'a Path) -> EarlierResult<'a> {
        EarlierResult {
            output,
            record: EarlierRecord::read(output),
        }
    }

    /// Whether there is a record that `clean` wrote.
    pub(super) fn has_record(&self) -> bool {
        self.record.is_some()
    }

    /// What the record says of the skeleton beside the result.
    pub(super) fn solved(&self) -> &Value {
        self.record.as_ref().map_or(&Value::Null, |r| &r.solved)
    }

    /// Whether the names of the result came from labeled takes beside the capture, or would have
    /// if there had been any.
    pub(super) fn names_came_from_beside(&self) -> bool {
        let made_from = self.record.as_ref().and_then(|r| r.made_from.as_ref());
        made_from.is_some_and(|made_from| made_from.labeled_beside.is_some())
    }

    /// What became of the file, where the result is still what was made of the same.
    pub(super) fn unchanged(&self, made_from: &MadeFrom) -> Option<Summary> {
        let earlier = self.record.as_ref()?;
        let is_made_from = |was: &MadeFrom| was.holds_for(made_from);
        let is_same = earlier.made_from.as_ref().is_some_and(is_made_from)
            && Fingerprint::read(self.output).ok() == earlier.output;
        if is_same && earlier.error.is_some() {
            // Where it cannot be written, it says of an old failure what the result does not need.
            let _ = set_error(self.output, None);
        }
        earlier.summary.clone().filter(|_| is_same)
    }

    /// Fails where something stands at the path of the result or of its record that is not what a
    /// run of `clean` left there; with `again`, a result that was changed since may be made again.
    ///
    /// # Errors
    /// [`Error::Data`].
    pub(super) fn may_be_replaced(&self, again: bool) -> Result<()> {
        let (output, record) = (self.output, record_path(self.output));
        let (path, what) = match &self.record {
            Some(earlier) if earlier.is_failure() && output.exists() => (
                output,
                "is there, but no run of clean made it; move it, or give another place with -o",
            ),
            None if record.exists() => (
                record.as_path(),
                "stands in the place of a record and is none; move it, or give another place with \
                 -o",
            ),
            None if output.exists() => (
                output,
                "is there and has no record that clean made it; move it, or give another place \
                 with -o",
            ),
            Some(earlier) if !again && output.exists() && !earlier.is_of(output)? => (
                output,
                "was changed since clean made it; move it, or make it again with the option \
                 `again`",
            ),
            _ => return Ok(()),
        };
        Err(Error::data(Place::file(path.display().to_string()), what))
    }

    /// Whether it is open who made the file at the path of the result: a run that was stopped, or
    /// somebody since.
    pub(super) fn is_in_doubt(&self) -> bool {
        let is_changed = |earlier: &EarlierRecord| {
            let now = Fingerprint::read(self.output).ok().map(|now| now.sha256);
            let is_stopped = earlier.output.is_none() && earlier.error.is_none();
            is_stopped && self.output.exists() && now != earlier.replaces
        };
        self.record.as_ref().is_some_and(is_changed)
    }

    /// Says beside the result that it is being made, in a folder that is made if need be: what a
    /// stopped run left is known by that.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub(super) fn begin(&self, made_from: &MadeFrom) -> Result<Begun<'a>> {
        let output = self.output;
        make_folder_of(output)?;
        let old = std::fs::read(record_path(output)).ok();
        let replaces = Fingerprint::read(output).ok().map(|was| was.sha256);
        let json = json!({"command": "clean", "made_from": made_from, "replaces": replaces});
        write_file(record_path(output), format!("{json}\n").as_bytes())?;
        Ok(Begun { output, old })
    }

    /// Leaves a record of why a file failed, where no file of somebody else stands: alone where
    /// there is no result, else within the record of the result that an earlier run made. What says
    /// so already is not written again. Whether the result of an earlier run still stands there.
    pub(super) fn leave_failure(&self, error: &str) -> bool {
        let output = self.output;
        // Where no record can be left, the table has the error all the same.
        let _ = match &self.record {
            None if record_path(output).exists() || output.exists() => Ok(()),
            Some(earlier) if earlier.error.as_deref() == Some(error) => Ok(()),
            Some(earlier) if output.exists() => match earlier.output {
                Some(_) => set_error(output, Some(error)),
                None => Ok(()),
            },
            _ => write_failure(output, error),
        };
        output.exists() && self.record.as_ref().is_some_and(|r| !r.is_failure())
    }
}

/// A result that is being made.
pub(super) struct Begun<'a> {
    output: &'a Path,
    /// The record that was there.
    old: Option<Vec<u8>>,
}

impl Begun<'_> {
    /// Takes back that it is being made, where no result came of it: the file that still stands
    /// there keeps its old record, by which it is known whether somebody changed it.
    pub(super) fn give_up(self) {
        let record = record_path(self.output);
        // Where that fails, a later run finds that nothing was made.
        let _ = match self.old.filter(|_| self.output.exists()) {
            Some(old) => write_file(&record, &old).is_ok(),
            None => !self.output.exists() && std::fs::remove_file(&record).is_ok(),
        };
    }
}

/// Writes a record that says nothing but why a file failed.
fn write_failure(output: &Path, error: &str) -> Result<()> {
    make_folder_of(output)?;
    let json = json!({"command": "clean", "error": error});
    write_file(record_path(output), format!("{json}\n").as_bytes())
}

/// Changes only what the record of a result says of a later run that failed.
fn set_error(output: &Path, error: Option<&str>) -> Result<()> {
    let path = record_path(output);
    let text = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
    let broken =
        |e: serde_json::Error| Error::data(Place::file(path.display().to_string()), e.to_string());
    let mut json: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(&text).map_err(broken)?;
    json.remove("error");
    json.extend(error.map(|error| ("error".to_string(), json!(error))));
    let text = serde_json::to_string_pretty(&json).map_err(broken)? + "\n";
    write_file(&path, text.as_bytes())
}
