//! The record beside a result: what it was made from and by which settings, what the file was taken
//! for, what was found and changed; of a file that failed, why.

use super::places::PlaceToSee;
use super::replaced::ReplacedPosition;
use super::rotations::RotationLines;
use crate::audit::TakeAudit;
use crate::io::motion_file::ReadAs;
use crate::io::output::write_file;
use crate::label::LabelReport;
use crate::pose::Segment;
use crate::prior::provenance::hex;
use crate::restore::gap_report::{GapLine, PointGapLine, by_point};
use crate::{Error, Place, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// A file by its name and content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Fingerprint {
    /// The file's name, without its folder.
    pub file: String,
    /// The SHA-256 of its bytes.
    pub sha256: String,
}

impl Fingerprint {
    /// The fingerprint of a file whose bytes are `bytes`.
    pub(crate) fn of(path: &Path, bytes: &[u8]) -> Fingerprint {
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
    pub(crate) fn read(path: &Path) -> Result<Fingerprint> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        Ok(Fingerprint::of(path, &bytes))
    }
}

/// What a result was made from. Where nothing of it changes, the result does not either.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct MadeFrom {
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

impl MadeFrom {
    /// Whether a result that was made from this is what would be made `now`. A segment that
    /// somebody had done again, or whose label somebody kept, stays so in later runs that do not
    /// ask for any.
    fn holds_for(&self, now: &MadeFrom) -> bool {
        let mut was = self.clone();
        let keeps = |of: &MadeFrom| {
            let keep = of.settings["labels"]["keep"].as_array();
            keep.is_some_and(|keep| !keep.is_empty())
        };
        if keeps(&was) && !keeps(now) {
            was.settings["labels"]["keep"] = json!([]);
        }
        let is_redone = was.settings.get("redo").is_some();
        if is_redone && now.settings.get("redo").is_none() {
            // `--redo` alone looks for no outliers elsewhere.
            was.settings["outliers"] = now.settings["outliers"].clone();
            if let Some(settings) = was.settings.as_object_mut() {
                settings.remove("redo");
            }
        }
        was == *now
    }
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
    /// The names of computed points, which are left alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub computed: Vec<String>,
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
    /// Noise of the rotations of a file that keeps them, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_deg: Option<f64>,
    /// Whether it was removed.
    pub denoised: bool,
    /// Whether it is over the limit and stays.
    #[serde(default)]
    pub noise_stays: bool,
    /// Whether there was nothing to change: the result is a copy.
    #[serde(default)]
    pub copied: bool,
    /// What somebody should look at, a line each.
    pub findings: Vec<String>,
    /// How the file was taken, and what was odd in it, a line each.
    pub notes: Vec<String>,
    /// Where to look in the take, for links to its page.
    #[serde(default)]
    pub places: Vec<PlaceToSee>,
}

/// The record of a result.
#[derive(Debug, Serialize)]
pub(crate) struct Record<'a> {
    /// The command that made it.
    pub command: &'static str,
    /// What it was made from.
    pub made_from: &'a MadeFrom,
    /// What the file was taken for.
    pub read_as: &'a ReadAs,
    /// The map of its points' names, where one was used.
    pub map: Option<&'a str>,
    /// What was wrong before.
    pub audit: Vec<TakeAudit>,
    /// What became of it.
    pub summary: &'a Summary,
    /// Segments that counted as missing.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    pub redone: &'a [Segment],
    /// What was done to its labels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelReport>,
    /// Every gap, and how it was filled; none where that would take more room than the take.
    pub gaps: Vec<GapLine>,
    /// Instead, the gaps of each point together.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gaps_by_point: Vec<PointGapLine>,
    /// Measured positions that were replaced as outliers.
    pub outliers: Vec<ReplacedPosition>,
    /// What was done to the rotations of a file that keeps them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotations: Option<RotationLines>,
    /// The skeleton beside the result, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solved: Option<serde_json::Value>,
    /// Points and outliers that are left out, since there are so many.
    #[serde(skip_serializing_if = "is_zero")]
    pub left_out: usize,
    /// The result.
    pub output: Fingerprint,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// A record may have so many bytes, however small the take is.
const SMALL: usize = 1 << 13;
/// Points and outliers that the record of a take of very many has.
const FEW: usize = 50;

/// What is read of an earlier record.
#[derive(Deserialize)]
struct Earlier {
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
}

impl Earlier {
    fn read(output: &Path) -> Option<Earlier> {
        let text = std::fs::read(record_path(output)).ok()?;
        let earlier: Earlier = serde_json::from_slice(&text).ok()?;
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

/// Fails where something stands in the place of a result or of its record that is not what a run of
/// `clean` left there; with `again`, a result that was changed since may be made again.
///
/// # Errors
/// [`Error::Data`].
pub(crate) fn may_write(output: &Path, again: bool) -> Result<()> {
    let record = record_path(output);
    let (path, what) = match Earlier::read(output) {
        Some(earlier) if earlier.is_failure() && output.exists() => (
            output,
            "is there, but no run of clean made it; move it, or give another place with -o",
        ),
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
            "was changed since clean made it; move it, or make it again with the option `again`",
        ),
        _ => return Ok(()),
    };
    Err(Error::data(Place::file(path.display().to_string()), what))
}

/// Says beside a result that it is being made, in a folder that is made if need be: what a stopped
/// run left is known by that. Returns the record that was there.
///
/// # Errors
/// [`Error::Io`]: writing fails.
pub(crate) fn begin(output: &Path, made_from: &MadeFrom) -> Result<Option<Vec<u8>>> {
    make_folder_of(output)?;
    let old = std::fs::read(record_path(output)).ok();
    let replaces = Fingerprint::read(output).ok().map(|was| was.sha256);
    let json = json!({"command": "clean", "made_from": made_from, "replaces": replaces});
    write_file(record_path(output), format!("{json}\n").as_bytes())?;
    Ok(old)
}

/// Whether it is open who made the file in the place of a result: a run that was stopped, or
/// somebody since.
pub(crate) fn is_in_doubt(output: &Path) -> bool {
    let is_changed = |earlier: Earlier| {
        let now = Fingerprint::read(output).ok().map(|now| now.sha256);
        let is_stopped = earlier.output.is_none() && earlier.error.is_none();
        is_stopped && output.exists() && now != earlier.replaces
    };
    Earlier::read(output).is_some_and(is_changed)
}

/// Takes back what [`begin`] said, where no result came of it: the file that still stands there
/// keeps its `old` record, by which it is known whether somebody changed it.
pub(crate) fn give_up(output: &Path, old: Option<&[u8]>) {
    let record = record_path(output);
    // Where that fails, a later run finds that nothing was made.
    let _ = match old.filter(|_| output.exists()) {
        Some(old) => write_file(&record, old).is_ok(),
        None => !output.exists() && std::fs::remove_file(&record).is_ok(),
    };
}

/// Whether a result of an earlier run stands there.
pub(crate) fn has_result(output: &Path) -> bool {
    output.exists() && Earlier::read(output).is_some_and(|earlier| !earlier.is_failure())
}

/// Whether a record that `clean` wrote stands beside a result.
pub(crate) fn has_record(output: &Path) -> bool {
    Earlier::read(output).is_some()
}

/// Leaves a record of why a file failed, where no file of somebody else stands: alone where there
/// is no result, else within the record of the result that an earlier run made. What says so
/// already is not written again.
///
/// # Errors
/// [`Error::Io`]: writing fails.
pub(crate) fn leave_failure(output: &Path, error: &str) -> Result<()> {
    match Earlier::read(output) {
        None if record_path(output).exists() || output.exists() => Ok(()),
        Some(earlier) if earlier.error.as_deref() == Some(error) => Ok(()),
        Some(earlier) if output.exists() => match earlier.output {
            Some(_) => set_error(output, Some(error)),
            None => Ok(()),
        },
        _ => {
            make_folder_of(output)?;
            let json = json!({"command": "clean", "error": error});
            write_file(record_path(output), format!("{json}\n").as_bytes())
        }
    }
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

impl Record<'_> {
    /// Writes it beside the result of a take of `size` bytes: no larger than that, unless the take
    /// is very small.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub(crate) fn write(mut self, output: &Path, size: usize) -> Result<()> {
        let most = size.max(SMALL);
        let mut json = self.text(true)?;
        if json.len() > most {
            self.sum_up();
            json = self.text(true)?;
        }
        if json.len() > most {
            json = self.text(false)?;
        }
        if json.len() > most {
            self.cut();
            json = self.text(false)?;
        }
        write_file(record_path(output), json.as_bytes())
    }

    fn text(&self, pretty: bool) -> Result<String> {
        let json = if pretty {
            serde_json::to_string_pretty(self)
        } else {
            serde_json::to_string(self)
        };
        Ok(json.map_err(|e| Error::usage(e.to_string()))? + "\n")
    }

    /// The gaps point by point instead of one by one.
    fn sum_up(&mut self) {
        self.gaps_by_point = by_point(&std::mem::take(&mut self.gaps));
        let takes = self.audit.iter_mut();
        let points = takes.flat_map(|take| &mut take.gaps.by_point);
        points.for_each(|point| point.ranges.clear());
    }

    /// The points with most gaps, and the first outliers and findings only.
    fn cut(&mut self) {
        let mut left_out = 0;
        let mut cut = |count: usize| left_out += count.saturating_sub(FEW);
        cut(self.gaps_by_point.len());
        self.gaps_by_point.truncate(FEW);
        cut(self.outliers.len());
        self.outliers.truncate(FEW);
        if let Some(rotations) = &mut self.rotations {
            rotations.cut(FEW);
        }
        if let Some(labels) = &mut self.labels {
            cut(labels.changes.len());
            labels.changes.truncate(FEW);
            labels.changes.iter_mut().for_each(|c| c.positions.clear());
        }
        for take in &mut self.audit {
            cut(take.findings.len());
            take.findings.truncate(FEW);
            take.gaps.by_point.clear();
        }
        self.left_out = left_out;
    }
}

/// What an earlier run says of a result that is still what it made of the same.
pub(crate) fn unchanged(output: &Path, made_from: &MadeFrom) -> Option<Summary> {
    let earlier = Earlier::read(output)?;
    let is_made_from = |was: &MadeFrom| was.holds_for(made_from);
    let is_same = earlier.made_from.as_ref().is_some_and(is_made_from)
        && Fingerprint::read(output).ok() == earlier.output;
    if is_same && earlier.error.is_some() {
        // Where it cannot be written, it says of an old failure what the result does not need.
        let _ = set_error(output, None);
    }
    earlier.summary.filter(|_| is_same)
}

/// Makes the folder of a file.
///
/// # Errors
/// [`Error::Io`]: it cannot be made.
pub(crate) fn make_folder_of(path: &Path) -> Result<()> {
    match path.parent() {
        Some(folder) => std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e)),
        None => Ok(()),
    }
}

/// The place of the record of a result.
pub(crate) fn record_path(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".json");
    PathBuf::from(name)
}
