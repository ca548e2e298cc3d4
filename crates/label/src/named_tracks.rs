//! The names that tracks got from nothing, and what is to be told of them.

use super::loose_tracks::{LooseTracks, PathLabels};
use super::naming::Naming;
use super::templates::Templates;
use super::tuning::naming::{MISSING, MIXED};
use crate::io::PointMove;
use crate::pose::{Poses, point_at};
use serde::Serialize;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The names of tracks, each of which had none.
#[derive(Debug, Clone, Default, Serialize)]
pub struct NamedTracks {
    /// Fragments of tracks that are another's.
    #[serde(skip)]
    #[doc(hidden)]
    pub moves: Vec<PointMove>,
    /// The tracks that then are labels.
    #[serde(skip)]
    #[doc(hidden)]
    pub names: Vec<(usize, String)>,
    /// How many people have them.
    pub people: usize,
    /// Whether the people are those of the labeled takes.
    #[serde(skip)]
    #[doc(hidden)]
    pub are_like: bool,
    /// The labeled takes of these people.
    #[serde(skip)]
    #[doc(hidden)]
    pub like: Arc<Templates>,
    /// How well labels and tracks fit each other, 0 to 1: what is named, twice, in all that is
    /// seen of the tracks and all that would be of the people's labels. People whose distances are
    /// those of labeled takes may have part of the labels.
    pub fit: f64,
    /// The labels that were found.
    pub labels: Vec<FoundLabel>,
    /// The labels that are no track's.
    pub missing: Vec<String>,
    /// Fragments of tracks that moved to the columns of others.
    pub moved: Vec<MovedFragment>,
    /// Fragments of tracks that may be a label and are not sure.
    pub unsure: Vec<UnsureTrack>,
    /// Tracks that are seen in most of the take and have no label.
    pub others: Vec<String>,
    /// Labels that the model cannot tell apart, which no track gets.
    pub alike: Vec<String>,
}

/// A fragment of a track in the column of another.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MovedFragment {
    /// The track, by the name that it had.
    pub track: String,
    /// The first frame, from 0, and the one after the last.
    pub frames: [usize; 2],
    /// The track in whose column it is, by the name that that had; `None`: no column was free, and
    /// it was taken out.
    pub to: Option<String>,
    /// Where it was, frame by frame, cm, y up, where it was taken out.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub positions: Vec<[f64; 3]>,
}

/// Tracks that a line names.
const SHOWN: usize = 5;

/// A label that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundLabel {
    /// The label's name.
    pub label: String,
    /// The tracks that it was, by the names that they had.
    pub tracks: Vec<String>,
    /// In how many frames it is.
    pub frames: usize,
}

/// A fragment of a track that may be a label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnsureTrack {
    /// The track in whose column it is in the result, by its name.
    pub track: String,
    /// The first frame, from 0, and the one after the last.
    pub frames: [usize; 2],
    /// The label that is most likely.
    pub label: String,
}

impl NamedTracks {
    pub(super) fn new(
        moves: Vec<PointMove>,
        names: Vec<(usize, String)>,
        poses: &Poses,
    ) -> NamedTracks {
        let points = &poses.points;
        let moved = moves.iter().map(|m| MovedFragment {
            track: points[m.from].clone(),
            frames: [m.frames.start, m.frames.end],
            to: m.to.map(|to| points[to].clone()),
            positions: match m.to {
                Some(_) => Vec::new(),
                None => m
                    .frames
                    .clone()
                    .map(|t| point_at(poses.xyz.view(), t, m.from).to_array())
                    .collect(),
            },
        });
        NamedTracks {
            moved: moved.collect(),
            moves,
            names,
            ..NamedTracks::default()
        }
    }

    /// Whether something is not sure.
    pub fn is_unsure(&self) -> bool {
        !self.unsure.is_empty() || self.is_other_set()
    }

    /// Whether tracks of several people may stand under each other's names: some labels are no
    /// track's while some tracks are no label's.
    #[doc(hidden)]
    pub fn may_mix_people(&self) -> bool {
        self.people > 1 && self.missing.len().min(self.others.len()) >= MIXED
    }

    /// Whether so many labels are no track's that these may be of another marker set.
    fn is_other_set(&self) -> bool {
        !self.are_like
            && self.missing.len() as f64 > MISSING * (self.labels.len() + self.missing.len()) as f64
    }

    /// Lines for people: what was named, and what somebody should look at.
    pub fn lines(&self) -> Vec<String> {
        [self.notes(), self.doubts()].concat()
    }

    /// What was named, a line each.
    pub fn notes(&self) -> Vec<String> {
        let count = self.labels.len() + self.missing.len() + self.alike.len();
        let tracks: usize = self.labels.iter().map(|l| l.tracks.len()).sum();
        let (found, people) = (self.labels.len(), self.people);
        let of_people = match people {
            0 | 1 => String::new(),
            people => format!(" of {people} people"),
        };
        let mut lines = vec![format!(
            "{found} of {count} labels{of_people} named, from {tracks} tracks"
        )];
        if !self.missing.is_empty() && !self.is_other_set() {
            lines.push(format!("no track is {}", self.missing.join(", ")));
        }
        lines
    }

    /// What somebody should look at, a line each.
    pub fn doubts(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.is_other_set() {
            lines.push(format!(
                "no track is {}: so many labels are no track's that it may be another set, and \
                 names be wrong",
                self.missing.join(", ")
            ));
        }
        if !self.alike.is_empty() {
            lines.push(format!(
                "{} cannot be told apart by the set; learn it from a labeled take, or give that as \
                 the option `like`",
                self.alike.join(", ")
            ));
        }
        if !self.others.is_empty() {
            let (count, some) = (self.others.len(), self.others.iter().take(SHOWN));
            let some = some.map(String::as_str).collect::<Vec<_>>().join(", ");
            let more = if count > SHOWN { ", …" } else { "" };
            lines.push(format!(
                "no label fits {count} tracks that are seen in most of the take ({some}{more}): \
                 other markers, or another person?"
            ));
        }
        let lost = self.moved.iter().filter(|m| m.to.is_none()).count();
        if lost > 0 {
            lines.push(format!(
                "{lost} pieces of tracks are no label's, and no column was free for them: taken out"
            ));
        }
        lines.extend(self.unsure.iter().map(|fragment| {
            let [start, end] = fragment.frames;
            let UnsureTrack { track, label, .. } = fragment;
            let last = end - 1;
            format!(
                "{track} in frames {start} to {last} may be {label}: not sure, so it has no label"
            )
        }));
        lines
    }

    /// Tells which of `labels` are which of `points`; of the two ways to label paths the first is
    /// sure.
    pub(super) fn tell(
        &mut self,
        tracks: &LooseTracks<'_>,
        [sure, likely]: [&PathLabels; 2],
        naming: &Naming<'_>,
        (labels, points): (&[String], &[String]),
    ) {
        self.people = naming.people;
        self.fit = naming.fit_of(sure, self.are_like);
        let is_other =
            |path: &usize| likely[*path].is_none() && 2 * tracks.frames(*path) > tracks.xyz.nrows();
        let others = (0..likely.len()).filter(is_other);
        self.others = others
            .flat_map(|path| tracks.tracks_of(path).take(1))
            .map(|t| points[t].clone())
            .collect();
        for (l, label) in labels.iter().enumerate() {
            let own: Vec<usize> = (0..sure.len()).filter(|p| sure[*p] == Some(l)).collect();
            let frames = own.iter().map(|path| tracks.frames(*path)).sum();
            let of: BTreeSet<usize> = own
                .iter()
                .flat_map(|path| tracks.tracks_of(*path))
                .collect();
            match frames {
                0 if naming.is_one_of_several(l) => self.alike.push(label.clone()),
                0 => self.missing.push(label.clone()),
                _ => self.labels.push(FoundLabel {
                    label: label.clone(),
                    tracks: of.into_iter().map(|track| points[track].clone()).collect(),
                    frames,
                }),
            }
        }
        for (path, label) in likely
            .iter()
            .enumerate()
            .filter(|(path, _)| sure[*path].is_none())
        {
            let Some(label) = label else { continue };
            for fragment in tracks.fragments_of(path) {
                let is_it =
                    |m: &&PointMove| (m.from, &m.frames) == (fragment.track, &fragment.frames);
                let moved = self.moves.iter().find(is_it).and_then(|m| m.to);
                self.unsure.push(UnsureTrack {
                    track: points[moved.unwrap_or(fragment.track)].clone(),
                    frames: [fragment.frames.start, fragment.frames.end],
                    label: labels[*label].clone(),
                });
            }
        }
    }
}
