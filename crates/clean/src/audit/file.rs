//! The audit of files of motion, and its text.

use super::take_pages::TakePages;
use super::{
    Finding, FindingKind, GapSummary, Limits, PointGaps, TakeAudit, audit_points, labels,
    rotation_findings,
};
use crate::error::OptionNames;
use crate::io::motion_file::{ReadRules, format_of};
use crate::io::motion_folder::{EXTENSIONS, MotionFolder};
use crate::io::{MotionFile, MotionFormat};
use crate::label::LabelSettings;
use crate::{Error, Place, Result};
use posing_gait::{Trial, contradictions};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Points whose gaps are listed, and findings of one kind.
const LISTED: usize = 5;

/// How files are audited.
pub struct FileAuditor {
    /// What is taken for files that do not say it.
    pub read: ReadRules,
    /// What is still as it should be.
    pub limits: Limits,
    /// Where pages of takes go, if they are wanted.
    pub pages: Option<TakePages>,
    /// How labels are checked.
    pub labels: LabelSettings,
    /// Files that a given rate may not contradict; others are taken at their own.
    pub named: Vec<PathBuf>,
}

impl FileAuditor {
    /// The audit of a file, the `number`th, whose bytes, unpacked, are `bytes`; one that cannot be
    /// read stops no other. Where something was found, or is missing, its page is written.
    ///
    /// # Errors
    /// [`Error::Usage`], for all files alike; [`Error::Io`]: a page cannot be written.
    pub fn audit(&self, path: &Path, bytes: Result<Vec<u8>>, number: usize) -> Result<FileAudit> {
        let mut out = FileAudit {
            file: if path == Path::new("-") {
                "standard input".to_string()
            } else {
                path.display().to_string()
            },
            ..FileAudit::default()
        };
        match bytes.and_then(|bytes| self.read(path, bytes)) {
            Ok(file) => {
                out.takes = audit_motion(&file, &self.limits);
                out.notes.clone_from(&file.notes);
                out.computed = file.computed().into_iter().map(String::from).collect();
                out.notes
                    .extend(labels::add(&file, &self.labels, &mut out.takes));
                let names = self.labels.option_names;
                name_options(&mut out.takes, names);
                out.notes
                    .iter_mut()
                    .for_each(|note| *note = names.in_text(note));
                out.has_markers = is_of_markers(file.format);
                if let Some(pages) = self.pages.as_ref().filter(|_| out.has_something()) {
                    out.page = pages.write(number, &out.file, &file)?;
                }
            }
            Err(wrong @ Error::Usage(_)) => return Err(wrong),
            Err(e) => out.error = Some(self.labels.option_names.in_text(&e.to_string())),
        }
        Ok(out)
    }

    fn read(&self, path: &Path, bytes: Vec<u8>) -> Result<MotionFile> {
        let options = self.read.of(path, format_of(&bytes));
        let file = MotionFile::read(path, bytes, &options)?;
        let is_named = self.named.iter().any(|named| named == path);
        file.check_rate(options.fps.filter(|_| is_named))?;
        Ok(file)
    }
}

/// Whether a format is one of labeled markers.
fn is_of_markers(format: MotionFormat) -> bool {
    use MotionFormat::{C3d, MotiveCsv, NexusCsv, QualisysTsv, Trc};
    matches!(format, C3d | Trc | MotiveCsv | QualisysTsv | NexusCsv)
}

/// Whether the points of a file are joints that follow from its rotations: only the root has
/// positions of its own.
pub(crate) fn are_joints(file: &MotionFile) -> bool {
    let joints = file.channels();
    file.motion().is_some()
        && joints
            .iter()
            .skip(1)
            .all(|joint| joint.positions.is_empty())
}

/// Calls the options that findings name as `names` says.
pub(crate) fn name_options(takes: &mut [TakeAudit], names: OptionNames) {
    for finding in takes.iter_mut().flat_map(|take| &mut take.findings) {
        finding.what = names.in_text(&finding.what);
    }
}

/// The audit of what a file holds: its positions, and its angles if it has some.
///
/// ```
/// use posing_clean::audit::{Limits, audit_motion};
/// use posing_io::{MotionFile, motion_file::ReadOptions};
///
/// let path = "../../testdata/examples/biomechanist/gait.c3d";
/// let file = MotionFile::open(path, &ReadOptions::default())?;
/// let audits = audit_motion(&file, &Limits::default());
/// assert_eq!((audits.len(), audits[0].rate), (1, Some(60.0)));
/// assert_eq!(audits[0].gaps.missing, 0.0);
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn audit_motion(file: &MotionFile, limits: &Limits) -> Vec<TakeAudit> {
    let are_joints = are_joints(file);
    let mut takes = audit_points(&file.table.poses, file.rate(), limits, are_joints);
    // Only files of one take have angles.
    if let Some(take) = takes.first_mut() {
        let found = rotation_findings(&file.joint_angles(), file.rate());
        take.findings.extend(found);
        take.findings.extend(gait_findings(file));
    }
    takes
}

/// What in a C3D file with the markers of Plug-in Gait contradicts itself.
fn gait_findings(file: &MotionFile) -> Vec<Finding> {
    let units = file.units();
    let trial = file.c3d().and_then(|c3d| {
        // One that cannot be a trial of gait has nothing to contradict.
        Trial::from_c3d(c3d, Some(units.unit), Some(units.up)).ok()
    });
    let found = trial.iter().flat_map(contradictions);
    let found = found.map(|found| Finding {
        kind: FindingKind::Gait,
        points: found.points,
        frames: None,
        what: found.what,
    });
    found.collect()
}

/// The files and those of folders, in order, and audits of the folders that cannot be read or have
/// no files of motion.
pub fn files_to_audit(paths: &[PathBuf]) -> (Vec<PathBuf>, Vec<FileAudit>) {
    let refused = |path: &Path, error: &Error| FileAudit {
        file: path.display().to_string(),
        error: Some(error.to_string()),
        ..FileAudit::default()
    };
    let (mut files, mut unreadable) = (Vec::new(), Vec::new());
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let found = MotionFolder::with_keypoints(path, None, |_| true);
        if found.files.is_empty() && found.unreadable.is_empty() {
            let what = format!(
                "no files of motion in it ({}, keypoints as json)",
                EXTENSIONS.join(", ")
            );
            let error = Error::data(Place::file(path.display().to_string()), what);
            unreadable.push(refused(path, &error));
        }
        files.extend(found.files.into_iter().map(|(file, _)| file));
        let found = found.unreadable.iter();
        unreadable.extend(found.map(|(folder, _, error)| refused(folder, error)));
    }
    (files, unreadable)
}

/// The audit of one file.
#[derive(Debug, Clone, Default, Serialize)]
pub struct FileAudit {
    /// The file's name.
    pub file: String,
    /// Why it could not be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The names of its computed points, which are left alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub computed: Vec<String>,
    /// The takes of the file.
    pub takes: Vec<TakeAudit>,
    /// Whether its tracks are of markers, each with a label.
    #[serde(skip)]
    pub has_markers: bool,
    /// What was odd in it, a line each.
    #[serde(skip)]
    pub notes: Vec<String>,
    /// The address of the page that plays it, from the page of the audit.
    #[serde(skip)]
    pub page: Option<String>,
}

impl FileAudit {
    /// Whether something was found.
    pub fn has_findings(&self) -> bool {
        self.takes.iter().any(|take| !take.findings.is_empty())
    }

    /// Whether something was found or is missing.
    fn has_something(&self) -> bool {
        let has_gaps = |take: &TakeAudit| !take.gaps.by_point.is_empty();
        self.has_findings() || self.takes.iter().any(has_gaps)
    }

    /// A take in one line: its frames, rate, points and size, and what is missing.
    pub(crate) fn line(take: &TakeAudit) -> String {
        let mut out = count(take.frames, "frame");
        if let Some(rate) = take.rate {
            let _ = write!(
                out,
                " at {} a second, {:.1} s",
                (1e3 * rate).round() / 1e3,
                take.frames as f64 / rate
            );
        }
        let _ = write!(out, "; {}", count(take.points, "point"));
        if take.unlabeled > 0 {
            let _ = write!(
                out,
                " and {} without a label",
                count(take.unlabeled, "track")
            );
        }
        if let Some(size) = take.size {
            let _ = write!(out, ", {size:.0} cm");
        }
        let _ = write!(out, "; {}", missing(&take.gaps, take.rate));
        out
    }

    /// The audit as text.
    pub fn text(&self) -> String {
        let mut out = format!("{}\n", self.file);
        if let Some(error) = &self.error {
            let _ = writeln!(out, "  not read: {error}");
        }
        for take in &self.takes {
            push_take(&mut out, take);
        }
        out
    }
}

fn push_take(out: &mut String, take: &TakeAudit) {
    let name = take
        .take
        .as_deref()
        .map_or(String::new(), |name| format!("{name}: "));
    let _ = writeln!(out, "  {name}{}", FileAudit::line(take));
    let mut kinds: Vec<FindingKind> = Vec::new();
    for finding in &take.findings {
        if !kinds.contains(&finding.kind) {
            kinds.push(finding.kind);
        }
    }
    for kind in kinds {
        let alike: Vec<&Finding> = take.findings.iter().filter(|f| f.kind == kind).collect();
        for finding in alike.iter().take(LISTED) {
            let _ = writeln!(out, "    {}: {}", kind_name(kind), finding.what);
        }
        if alike.len() > LISTED {
            let _ = writeln!(
                out,
                "    {}: {} more",
                kind_name(kind),
                alike.len() - LISTED
            );
        }
    }
    if take.findings.is_empty() {
        let _ = writeln!(out, "    nothing found");
    }
}

/// What is missing, the points with most first.
fn missing(gaps: &GapSummary, rate: Option<f64>) -> String {
    if gaps.by_point.is_empty() {
        return "nothing is missing".to_string();
    }
    let mut points: Vec<_> = gaps.by_point.iter().collect();
    points.sort_by_key(|p| std::cmp::Reverse(p.frames));
    let one = |p: &&PointGaps| {
        let longest = p.longest[1] - p.longest[0];
        let longest = match rate {
            Some(rate) => format!("{:.2} s", longest as f64 / rate),
            None => format!("{longest} frames"),
        };
        format!("{} {}, up to {longest}", p.point, count(p.gaps, "gap"))
    };
    let some: Vec<String> = points.iter().take(LISTED).map(one).collect();
    let more = match points.len().saturating_sub(LISTED) {
        0 => String::new(),
        n => format!(", and {}", count(n, "more point")),
    };
    format!(
        "{:.1}% is missing ({}{more})",
        100.0 * gaps.missing,
        some.join(", ")
    )
}

/// A number of things: `1 point`, `2 points`.
pub fn count(n: usize, what: &str) -> String {
    match n {
        1 => format!("1 {what}"),
        n => format!("{n} {what}s"),
    }
}

/// The name of a kind in text.
pub fn kind_name(kind: FindingKind) -> &'static str {
    match kind {
        FindingKind::Time => "time",
        FindingKind::Rate => "rate",
        FindingKind::Unit => "unit",
        FindingKind::UpAxis => "up axis",
        FindingKind::Mirrored => "mirrored",
        FindingKind::Stray => "stray point",
        FindingKind::LongGap => "long gap",
        FindingKind::Missing => "missing",
        FindingKind::Zeros => "zeros",
        FindingKind::Swap => "swap",
        FindingKind::Label => "label",
        FindingKind::WholeTake => "whole take",
        FindingKind::Hand => "left and right",
        FindingKind::Jump => "jump",
        FindingKind::Held => "held value",
        FindingKind::HeldFrames => "held frames",
        FindingKind::Fallen => "fallen",
        FindingKind::Drift => "drift",
        FindingKind::EulerFlip => "Euler flip",
        FindingKind::Gait => "gait",
    }
}
