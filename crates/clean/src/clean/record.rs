//! The record beside a result: what it was made from and by which settings, what the file was taken
//! for, what was found and changed.

use super::named_by::NamedBy;
use super::person::TakePerson;
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
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
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
    /// The digest of the labeled takes beside a capture without names.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub labeled_beside: Option<String>,
}

impl MadeFrom {
    /// Whether a result that was made from this is what would be made `now`. A segment that
    /// somebody had done again, or whose label somebody kept, stays so in later runs that do not
    /// ask for any.
    pub(super) fn holds_for(&self, now: &MadeFrom) -> bool {
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
    /// By what tracks without names got some: the files of labeled takes, or a marker set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub named_by: Option<String>,
    /// How well labels and tracks fit each other, 0 to 1, where tracks had no names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub names_fit: Option<f64>,
    /// How many changes of labels of each kind put them right.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub put_right: BTreeMap<String, usize>,
    /// The people of the take, each with skeleton and picture.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub people: Vec<TakePerson>,
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
    /// By what a capture without names got some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub named: Option<NamedBy>,
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

/// The path of the record of a result.
pub(crate) fn record_path(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".json");
    PathBuf::from(name)
}
