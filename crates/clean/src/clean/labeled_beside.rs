//! The labeled takes in the folders of captures, by which tracks without names are named.

use super::earlier_result::EarlierResult;
use super::name_source::Source;
use super::record::Fingerprint;
use crate::io::MotionFile;
use crate::io::motion_file::ReadRules;
use crate::io::motion_folder::{motion_files_in, name_of};
use crate::label::people::named_people;
use crate::label::unlabeled::{marker_labels, own_name};
use crate::label::{LabelSettings, check_labels};
use crate::pose::zeros::Zeros;
use crate::pose::{Poses, point_at};
use crate::prior::provenance::hex;
use crate::solve::on_body;
use crate::{Error, Result};
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

/// Files of a folder that are read for labels, at most; those come first whose names say that
/// somebody stands still in them for this, then the smallest.
const MOST_READ: usize = 60;
const STATICS: [&str; 6] = ["static", "still", "cal", "tpose", "t-pose", "rom"];
/// Fewer labels are no marker set.
const FEWEST_LABELS: usize = 8;

/// The labeled takes beside captures, folder by folder; a folder is read when it is asked for.
#[derive(Default)]
pub(super) struct LabeledBeside {
    folders: Mutex<BTreeMap<PathBuf, Arc<OnceLock<Arc<LabeledTakes>>>>>,
}

/// What the labeled takes of a folder say.
#[derive(Default)]
pub(super) struct LabeledTakes {
    /// What the takes of each marker set say.
    pub sources: Vec<Source>,
    /// Takes that name nothing, and why, a line each.
    pub passed_over: Vec<String>,
    /// What tells these takes from others.
    pub digest: String,
}

/// A labeled take.
struct Labeled {
    file: MotionFile,
    labels: BTreeSet<String>,
    sha256: String,
}

impl LabeledBeside {
    /// The labeled takes in the folder of a capture.
    pub(super) fn of(&self, capture: &Path, rules: &ReadRules) -> Arc<LabeledTakes> {
        let folder = capture.parent().unwrap_or(Path::new("")).to_path_buf();
        let mut folders = self.folders.lock().unwrap_or_else(|e| e.into_inner());
        let cell = folders.entry(folder.clone()).or_default().clone();
        drop(folders);
        let read = || Arc::new(LabeledTakes::read(&folder, rules));
        cell.get_or_init(read).clone()
    }
}

impl LabeledTakes {
    fn read(folder: &Path, rules: &ReadRules) -> LabeledTakes {
        let mut out = LabeledTakes::default();
        let mut by_labels: BTreeMap<BTreeSet<String>, Vec<Labeled>> = BTreeMap::new();
        let mut digest = Sha256::new();
        for path in candidates(folder) {
            let Some(take) = Labeled::open(&path, rules) else {
                continue;
            };
            let name = name_of(&path).display().to_string();
            digest.update(format!("{name} {}\n", take.sha256));
            match take.put_right() {
                Err(why) => {
                    out.passed_over.push(format!("{name} names nothing: {why}"));
                }
                Ok(take) => by_labels.entry(take.labels.clone()).or_default().push(take),
            }
        }
        out.digest = hex(&digest.finalize());
        // The set with most labels comes first.
        let mut groups: Vec<_> = by_labels.into_iter().collect();
        groups.sort_by_key(|(labels, _)| std::cmp::Reverse(labels.len()));
        for (_, takes) in groups {
            let files: Vec<MotionFile> = takes.into_iter().map(|take| take.file).collect();
            match Source::of_takes(files) {
                Ok(sources) => out.sources.extend(sources),
                Err(why) => out.passed_over.push(why.to_string()),
            }
        }
        out
    }
}

/// The captures of a folder, those first that say most of labels.
fn candidates(folder: &Path) -> Vec<PathBuf> {
    let mut files = motion_files_in(folder);
    files.retain(|path| !EarlierResult::read(path).has_record());
    let rank = |path: &PathBuf| {
        let name = name_of(path).to_string_lossy().to_lowercase();
        let size = std::fs::metadata(path).map_or(u64::MAX, |m| m.len());
        (!STATICS.iter().any(|s| name.contains(s)), size)
    };
    files.sort_by_cached_key(|path| (rank(path), path.clone()));
    files.truncate(MOST_READ);
    files
}

impl Labeled {
    /// A take with labels; `None` where it cannot be read, or is none of one person with labels.
    fn open(path: &Path, rules: &ReadRules) -> Option<Labeled> {
        let file = MotionFile::open_by(path, rules).ok()?;
        if file.motion().is_some() || named_people(&file.poses().points) > 1 {
            return None;
        }
        let labels = labels_of(file.poses());
        let sha256 = Fingerprint::read(path).ok()?.sha256;
        (labels.len() >= FEWEST_LABELS).then_some(Labeled {
            file,
            labels,
            sha256,
        })
    }

    /// The take with its labels put right.
    ///
    /// # Errors
    /// Why they are not to be believed.
    fn put_right(self) -> Result<Labeled> {
        let settings = on_body(&LabelSettings::default(), &self.file.poses().points);
        let report = check_labels(&self.file, &settings)?;
        if let Some(unsure) = report.unsure.first() {
            return Err(Error::usage(unsure.what.clone()));
        }
        let file = if report.moves.is_empty() {
            self.file
        } else {
            self.file.moved(&report.moves)?
        };
        Ok(Labeled { file, ..self })
    }
}

/// The labels of markers that are seen.
pub(super) fn labels_of(poses: &Poses) -> BTreeSet<String> {
    let poses = &*Zeros::emptied(poses);
    let is_seen =
        |p: &usize| (0..poses.frames()).any(|t| point_at(poses.xyz.view(), t, *p).is_finite());
    let seen = marker_labels(&poses.points).into_iter().filter(is_seen);
    seen.map(|p| own_name(&poses.points[p]).to_string())
        .collect()
}
