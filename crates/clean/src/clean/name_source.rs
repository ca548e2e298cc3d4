//! What names tracks without names: labeled takes, or a marker set.

use crate::io::MotionFile;
use crate::io::motion_folder::name_of;
use crate::label::{LabelModel, PostureModel, Templates};
use crate::pose::Poses;
use crate::prior::provenance::hex;
use crate::solve::{MarkerSet, naming_model};
use crate::{Error, Result};
use sha2::{Digest, Sha256};
use std::path::Path;
use std::sync::Arc;

/// Takes of one marker set by which markers are placed on a body, at most.
const MOST_LEARNED: usize = 8;
/// So many are called by their names.
const MOST_CALLED: usize = 3;
/// People of a take, as far as sets are chosen by the number of its tracks.
const MOST_PEOPLE: usize = 4;

/// What may name the tracks of captures without names, beside labeled takes in their folders.
#[derive(Default)]
pub struct NamingSettings {
    /// What labeled takes that were given say.
    pub(super) like: Vec<Source>,
    /// The marker set that was given.
    pub(super) set: Option<Source>,
    /// What tells that set from others.
    pub(super) set_digest: Option<String>,
}

impl NamingSettings {
    /// What labeled takes and a marker set say.
    ///
    /// # Errors
    /// The takes say nothing of labels, or the set has too few markers.
    pub fn new(like: Vec<MotionFile>, set: Option<&MarkerSet>) -> Result<NamingSettings> {
        let like = if like.is_empty() {
            Vec::new()
        } else {
            Source::of_takes(like)?
        };
        Ok(NamingSettings {
            like,
            set: set.map(Source::of_set).transpose()?,
            set_digest: set.map(digest).transpose()?,
        })
    }
}

/// What names tracks.
pub(super) struct Source {
    /// What it is called: the files of labeled takes, or a set.
    pub by: String,
    /// The files of labeled takes, all of them.
    pub takes: Vec<String>,
    pub model: Arc<dyn LabelModel>,
    /// The labeled takes; none of a set.
    pub like: Arc<Templates>,
    /// Whether it is for where the one before does not fit.
    pub is_second: bool,
}

impl Source {
    /// What labeled takes of one marker set say: by the body that they are on, if they are, and by
    /// their postures alone; why they say nothing.
    pub(super) fn of_takes(files: Vec<MotionFile>) -> Result<Vec<Source>> {
        let name = |f: &MotionFile| name_of(Path::new(&f.table.name)).display().to_string();
        let names: Vec<String> = files.iter().map(name).collect();
        let by = called(&names);
        let takes = files.iter().map(MotionFile::poses);
        let takes: Vec<&Poses> = takes.take(MOST_LEARNED).collect();
        let not = |e: Error| Error::usage(format!("{by} names nothing: {e}"));
        let like = Arc::new(Templates::learn(&files, true).map_err(not)?);
        let source = |model: Arc<dyn LabelModel>, is_second| Source {
            by: by.clone(),
            takes: names.clone(),
            model,
            like: like.clone(),
            is_second,
        };
        let first = source(naming_model(&takes, None).map_err(not)?.into(), false);
        if first.model.is_of_neighbors() {
            return Ok(vec![first]);
        }
        let postures = PostureModel::learn(&takes).ok();
        let postures = postures.map(|model| source(Arc::new(model), true));
        Ok([first].into_iter().chain(postures).collect())
    }

    pub(super) fn of_set(set: &MarkerSet) -> Result<Source> {
        Ok(Source {
            by: set.name.clone(),
            takes: Vec::new(),
            model: naming_model(&[], Some(set))?.into(),
            like: Arc::default(),
            is_second: false,
        })
    }

    /// How well the set fits so many tracks at best; see [`NamedTracks::fit`].
    pub(super) fn best_fit(&self, tracks: usize) -> f64 {
        let labels = self.model.labels().len();
        let alike = (0..labels).filter(|l| self.model.is_one_of_several(*l));
        let labels = labels - alike.count();
        let of = |people: usize| {
            let due = people * labels;
            2.0 * due.min(tracks) as f64 / (due + tracks).max(1) as f64
        };
        (1..=MOST_PEOPLE).map(of).fold(0.0, f64::max)
    }
}

/// What tells a set from others.
///
/// # Errors
/// None for sets of finite numbers.
pub(super) fn digest(set: &MarkerSet) -> Result<String> {
    Ok(hex(&Sha256::digest(set.to_json()?)))
}

/// What takes of some files are called.
pub(super) fn called(files: &[String]) -> String {
    match files.len() {
        0..=MOST_CALLED => files.join(" and "),
        n => format!("{} and {} more", files[..2].join(", "), n - 2),
    }
}
