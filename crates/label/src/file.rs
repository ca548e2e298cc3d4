//! The labels of a file put right, and what is said of it.

use super::changes::{Change, ChangeKind};
use super::label_model::LabelModel;
use super::label_settings::LabelSettings;
use super::named_tracks::{NamedTracks, UnsureTrack};
use super::nameless::name_tracks;
use super::relabeling::{Relabeling, relabel};
use super::sides::{SideBy, Unsure};
use super::templates::Templates;
use super::unlabeled::own_name;
use crate::error::OptionNames;
use crate::io::{MotionFile, PointMove};
use crate::pose::{Poses, point_at};
use crate::{Error, Place, Result};
use serde::Serialize;
use std::ops::Range;

/// What is wrong with the labels of a file, and the moves that put it right.
#[derive(Debug, Clone, Default, Serialize)]
pub struct LabelReport {
    /// Positions that are another label's, or none's.
    #[serde(skip)]
    pub moves: Vec<PointMove>,
    /// The labels that tracks without any got from nothing, before what was changed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub named: Option<NamedTracks>,
    /// What was changed.
    pub changes: Vec<LabelChange>,
    /// What is not sure and stays.
    pub unsure: Vec<UnsureLabels>,
    /// What is to be known of the people and of labeled takes that they were compared with.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Why labels were not checked, if they were not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unchecked: Option<String>,
}

/// A change of labels.
#[derive(Debug, Clone, Serialize)]
pub struct LabelChange {
    /// What it is.
    pub kind: ChangeKind,
    /// The track whose positions it moves.
    pub from: String,
    /// The label whose these are; none's where it is missing.
    pub to: Option<String>,
    /// All labels, where three or more changed places, each moving to the next.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ring: Vec<String>,
    /// The first frame, from 0 over the file, and the one after the last.
    pub frames: [usize; 2],
    /// How much likelier the positions are now, by the distances to other labels, nats.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<f64>,
    /// What says which side of an exchange is right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side: Option<SideBy>,
    /// Positions that were taken out, frame by frame, cm, y up.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub positions: Vec<[f64; 3]>,
    /// A line for people.
    pub what: String,
}

/// Labels that changed places, and nothing says which of their names are right when.
#[derive(Debug, Clone, Serialize)]
pub struct UnsureLabels {
    /// The labels.
    pub labels: Vec<String>,
    /// The first frame, from 0 over the file, and the one after the last, of each stretch.
    pub frames: Vec<[usize; 2]>,
    /// A line for people.
    pub what: String,
}

/// Finds what is wrong with the labels of a file.
///
/// Nothing is written, and no position changes: [`MotionFile::write_moved`] makes the moves.
///
/// ```
/// use posing_io::{MotionFile, PointMove, motion_file::ReadOptions};
/// use posing_label::{LabelSettings, check_labels};
///
/// let path = "../../testdata/examples/biomechanist/gait.c3d";
/// let file = MotionFile::open(path, &ReadOptions::default())?;
/// # let column = |name: &str| file.poses().points.iter().position(|point| point == name);
/// let (knee, ankle) = (column("LKNE").ok_or("none")?, column("LANK").ok_or("none")?);
/// // For half a second, the knee's marker is called ankle and the ankle's knee.
/// let one = |from, to| PointMove { from, to: Some(to), frames: 30..60 };
/// let wrong = file.moved(&[one(knee, ankle), one(ankle, knee)])?;
/// let report = check_labels(&wrong, &LabelSettings::default())?;
/// assert_eq!(report.changes[0].frames, [30, 60]);
/// assert_eq!(wrong.moved(&report.moves)?.poses().xyz, file.poses().xyz);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Error::Data`]: neither the file nor an option says its rate, it holds rotations, or it has no
/// point that is to keep its label.
pub fn check_labels(file: &MotionFile, settings: &LabelSettings) -> Result<LabelReport> {
    let poses = file.poses();
    let refuse = |what: &str| Err(Error::data(Place::file(&file.table.name), what));
    let rate = rate_of(file)?;
    let is_point = |name: &String| poses.points.contains(name);
    if let Some(segment) = settings.keep.iter().find(|s| !is_point(&s.point)) {
        return refuse(&format!("has no point \"{}\" to keep", segment.point));
    }
    for [a, b] in &settings.exchange {
        let has = |name: &str| poses.points.iter().any(|p| own_name(p) == own_name(name));
        if has(a) != has(b) {
            let [there, missing] = if has(a) { [a, b] } else { [b, a] };
            return refuse(&format!(
                "has no point \"{missing}\" to be exchanged with {there}"
            ));
        }
    }
    Ok(LabelReport::new(
        &relabel(poses, rate, settings),
        poses,
        settings.option_names,
    ))
}

/// Names the tracks of a file, none of which has a label, as a model says, and puts these labels
/// right: the file with them, and what [`check_labels`] finds then. What is less than `sure` (from
/// 0.5, below 1) has no label. Several people are called as the labeled takes of the settings are
/// that have their distances, else by numbers.
///
/// # Errors
/// [`Error::Data`]: neither the file nor an option says its rate; it holds several takes, rotations
/// or one of these labels; or no body is found in its tracks.
pub fn label_from_nothing(
    file: &MotionFile,
    model: &dyn LabelModel,
    sure: f64,
    settings: &LabelSettings,
) -> Result<(MotionFile, LabelReport)> {
    let named = name_file(file, model, sure, &settings.like)?;
    labeled_as(file, named, settings)
}

/// The names of the tracks of a file, none of which has a label, by a model.
///
/// # Errors
/// See [`label_from_nothing`].
#[doc(hidden)]
pub fn name_file(
    file: &MotionFile,
    model: &dyn LabelModel,
    sure: f64,
    like: &Templates,
) -> Result<NamedTracks> {
    let poses = file.poses();
    let refuse = |what: &str| Err(Error::data(Place::file(&file.table.name), what));
    let rate = rate_of(file)?;
    if poses.takes().len() > 1 {
        return refuse("holds several takes; cut one out with the command `trim`");
    }
    if let Some(label) = poses.points.iter().find(|p| model.is_label(p)) {
        return refuse(&format!(
            "has labels already, such as {label}; without the option `from_nothing` its other \
             tracks are joined to them"
        ));
    }
    let named = name_tracks(poses, rate, model, sure, like);
    named.map_err(|e| e.at(Place::file(&file.table.name)))
}

/// A file whose tracks got names, and what [`check_labels`] finds then.
///
/// # Errors
/// The file cannot hold these names; those of [`check_labels`].
#[doc(hidden)]
pub fn labeled_as(
    file: &MotionFile,
    mut named: NamedTracks,
    settings: &LabelSettings,
) -> Result<(MotionFile, LabelReport)> {
    let labeled = file.moved(&named.moves)?.renamed(&named.names)?;
    let mut report = check_labels(&labeled, settings)?;
    named
        .unsure
        .retain(|u| !report.changes.iter().any(|c| c.is_joined(u)));
    report.named = Some(named);
    Ok((labeled, report))
}

/// The rate of a file of points.
fn rate_of(file: &MotionFile) -> Result<f64> {
    let refuse = |what: &str| Err(Error::data(Place::file(&file.table.name), what));
    if file.motion().is_some() {
        return refuse("holds rotations, whose points have no labels to change");
    }
    match file.rate().or((file.poses().frames() < 2).then_some(1.0)) {
        Some(rate) => Ok(rate),
        None => refuse(
            "has no times that give a rate; give it with the option `fps F` (frames per second)",
        ),
    }
}

impl LabelReport {
    /// Whether something is not sure.
    pub fn is_unsure(&self) -> bool {
        !self.unsure.is_empty() || self.named.as_ref().is_some_and(NamedTracks::is_unsure)
    }

    /// What is to be told, a line each: changes, what is not sure, and why nothing was checked.
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        let changes = self.changes.iter().map(|c| c.what.as_str());
        let unsure = self.unsure.iter().map(|u| u.what.as_str());
        let notes = self.notes.iter().map(String::as_str);
        changes
            .chain(unsure)
            .chain(notes)
            .chain(self.unchecked.as_deref())
    }

    fn new(found: &Relabeling, poses: &Poses, names: OptionNames) -> LabelReport {
        let all = |labels: &[usize]| labels.iter().map(|l| poses.points[*l].clone()).collect();
        let unsure = found.unsure.iter().map(|u| UnsureLabels {
            labels: all(&u.labels),
            frames: u.frames.iter().map(|f| [f.start, f.end]).collect(),
            what: unsure_line(u, &poses.points),
        });
        let open = found.whole.iter().filter(|(_, whole)| !whole.is_put_back);
        let wrong = open.map(|(take, whole)| UnsureLabels {
            labels: all(&whole.points),
            frames: vec![[take.start, take.end]],
            what: names.in_text(&whole.sentence(&poses.points)),
        });
        LabelReport {
            named: None,
            moves: found.moves(),
            changes: found
                .changes
                .iter()
                .map(|c| LabelChange::new(c, poses))
                .collect(),
            unsure: unsure.chain(wrong).collect(),
            notes: found.notes.clone(),
            unchecked: found
                .unchecked
                .map(|why| format!("labels were not checked: {why}")),
        }
    }
}

impl LabelChange {
    /// Whether it joins a fragment of a track to a label.
    fn is_joined(&self, fragment: &UnsureTrack) -> bool {
        self.kind == ChangeKind::Joined
            && self.from == fragment.track
            && self.frames[0] < fragment.frames[1]
            && fragment.frames[0] < self.frames[1]
    }

    fn new(change: &Change, poses: &Poses) -> LabelChange {
        let names: Vec<String> = (change.tracks.iter())
            .map(|t| poses.points[*t].clone())
            .collect();
        let taken_out = change.moves.iter().filter(|m| m.to.is_none());
        let indices = taken_out.flat_map(|m| m.frames.clone().map(|t| (t, m.from)));
        LabelChange {
            kind: change.kind,
            what: line(change, &poses.points),
            from: names[0].clone(),
            to: names.get(1).cloned(),
            ring: if names.len() > 2 { names } else { Vec::new() },
            frames: [change.frames.start, change.frames.end],
            evidence: Some((10.0 * change.nats).round() / 10.0).filter(|nats| nats.is_finite()),
            side: change.side,
            positions: indices
                .map(|(t, p)| point_at(poses.xyz.view(), t, p).to_array())
                .collect(),
        }
    }
}

/// A change in words.
fn line(change: &Change, names: &[String]) -> String {
    let name = |k: usize| names[change.tracks[k]].as_str();
    let frames = frames(&change.frames);
    match change.kind {
        ChangeKind::Swap => format!(
            "{} and {} changed places in {frames}: put back",
            name(0),
            name(1)
        ),
        ChangeKind::Cycle => {
            let all: Vec<&str> = (0..change.tracks.len()).map(name).collect();
            format!(
                "{} changed places in a ring in {frames}: put back",
                all.join(", ")
            )
        }
        ChangeKind::Joined => format!("{} in {frames} is {}: joined", name(0), name(1)),
        ChangeKind::Moved => format!("{} in {frames} is {}: moved", name(0), name(1)),
        ChangeKind::WholeTake => format!(
            "{} and {} are exchanged in every frame: put back",
            name(0),
            name(1)
        ),
        ChangeKind::Out => format!("{} in {frames} is not {}: taken out", name(0), name(0)),
    }
}

/// What is not sure in words.
fn unsure_line(unsure: &Unsure, names: &[String]) -> String {
    let all: Vec<&str> = unsure.labels.iter().map(|l| names[*l].as_str()).collect();
    let frames: Vec<String> = unsure.frames.iter().map(frames).collect();
    let (all, frames) = (all.join(" and "), frames.join(", "));
    if unsure.is_part {
        format!(
            "{all} changed places, perhaps in {frames} too: the distances do not say, so nothing \
         moves there"
        )
    } else {
        format!(
            "{all} changed places in {frames}, or in all others: nothing says which, so nothing \
         moves"
        )
    }
}

/// Frames in words, counted from 0.
fn frames(range: &Range<usize>) -> String {
    match range.len() {
        1 => format!("frame {}", range.start),
        _ => format!("frames {} to {}", range.start, range.end.saturating_sub(1)),
    }
}
