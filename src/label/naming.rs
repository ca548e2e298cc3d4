//! Labels from nothing: the tracks of a take named as the markers of a set.
//!
//! 1. Tracks are cut to pieces, and these linked to paths, each of which is one marker
//!    ([`super::loose_tracks`]).
//! 2. A model of the labels names the points of some frames, each by itself, and these vote for the
//!    labels of the paths.
//! 3. Some rounds: the model is fitted to the take as it is labeled then, and says where each label
//!    is in every frame; each path is the label that it stays nearest to.
//! 4. What is not sure has no label.

use super::hosts::Hosts;
use super::loose_tracks::{LooseTracks, PathLabels};
use super::tuning::naming::*;
use crate::Result;
use crate::io::PointMove;
use crate::numeric::assignment::assign;
use crate::numeric::parallel::map_chunks;
use crate::pose::{Poses, point_at};
use glam::DVec3;
use ndarray::{Array2, ArrayView2, Axis};
use serde::Serialize;
use std::collections::BTreeSet;

/// The points of a frame, named.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedFrame {
    /// The label of each point.
    pub labels: Vec<Option<usize>>,
    /// How badly they fit; comparable between the frames of a take.
    pub cost: f64,
}

/// A model of where the labels of a person are.
pub trait LabelModel: Sync {
    /// The labels (L).
    fn labels(&self) -> &[String];

    /// Whether a label is one of several that the model cannot tell apart.
    fn is_one_of_several(&self, label: usize) -> bool;

    /// Whether a track of this name has a label already, one of these or of others.
    fn is_label(&self, name: &str) -> bool;

    /// Names the points of frames, each by itself; cm, y up.
    ///
    /// # Errors
    /// As the model says.
    fn name_frames(&self, frames: &[Vec<DVec3>]) -> Result<Vec<NamedFrame>>;

    /// Fits the model to frames of a take, of whose labels some are known in some frames
    /// (frames, 3 L; cm, y up; NaN is missing).
    ///
    /// # Errors
    /// As the model says.
    fn fit(&self, known: ArrayView2<'_, f64>) -> Result<FittedLabels>;
}

/// A model that is fitted to a take.
#[derive(Debug, Clone)]
pub struct FittedLabels {
    /// Where each label is in every frame (frames, 3 L), cm.
    pub places: Array2<f64>,
    /// How little is known of where each label is on the body, cm: large of those that are known in
    /// no frame.
    pub sd: Vec<f64>,
    /// Whether it is where no such label is.
    pub is_odd: Vec<bool>,
}

/// The names of tracks, each of which had none.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct NamedTracks {
    /// Pieces of tracks that are another's.
    #[serde(skip)]
    pub(crate) moves: Vec<PointMove>,
    /// The tracks that then are labels.
    #[serde(skip)]
    pub(crate) names: Vec<(usize, String)>,
    /// The labels that were found.
    pub labels: Vec<FoundLabel>,
    /// The labels that are no track's.
    pub missing: Vec<String>,
    /// Pieces of tracks that moved to the columns of others.
    pub moved: Vec<MovedPiece>,
    /// Pieces of tracks that may be a label and are not sure.
    pub unsure: Vec<UnsureTrack>,
    /// Tracks that are seen in most of the take and have no label.
    pub others: Vec<String>,
    /// Labels that the model cannot tell apart, which no track gets.
    pub alike: Vec<String>,
}

/// A piece of a track in the column of another.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MovedPiece {
    /// The track, by the name that it had.
    pub track: String,
    /// The first frame, from 0, and the one after the last.
    pub frames: [usize; 2],
    /// The track in whose column it is, by the name that that had; `None`: no column was free, and
    /// it was taken out.
    pub to: Option<String>,
}

/// Tracks that a line names.
const SHOWN: usize = 5;

/// A label that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundLabel {
    /// Its name.
    pub label: String,
    /// The tracks that it was, by the names that they had.
    pub tracks: Vec<String>,
    /// In how many frames it is.
    pub frames: usize,
}

/// A piece of a track that may be a label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnsureTrack {
    /// The track, by its name.
    pub track: String,
    /// The first frame, from 0, and the one after the last.
    pub frames: [usize; 2],
    /// The label that is most likely.
    pub label: String,
}

/// Names the tracks of a take at `rate` frames a second, none of which has a label; what is less
/// than `sure` (0 to 1) keeps none.
///
/// # Errors
/// Those of the model.
pub(crate) fn name_tracks(
    poses: &Poses,
    rate: f64,
    model: &dyn LabelModel,
    sure: f64,
) -> Result<NamedTracks> {
    let tracks = LooseTracks::new(poses.xyz.view(), &poses.runs(), rate);
    let naming = Naming {
        tracks: &tracks,
        model,
        labels: model.labels().len(),
        frames: tracks.frames_of_all(RATE, FEWEST_PLACES),
    };
    let votes = naming.votes()?;
    let all = naming.elected(&votes);
    if (0..naming.labels)
        .filter(|l| all.contains(&Some(*l)))
        .count()
        < FEWEST_LABELS
    {
        let what = "no body with these labels is found in its tracks; is it another marker set, or \
                    does another axis point up (the option `up`)?";
        return Err(what.into());
    }
    let mut runs = vec![naming.fitted(all)?];
    // One choice of frames may end in a wrong ring of names, which no exchange of two undoes.
    let half = |n| naming.elected(&votes.iter().skip(n).step_by(2).cloned().collect::<Vec<_>>());
    let halves = [half(0), half(1)];
    if tracks.unlike(&halves[0], &halves[1]) > UNLIKE {
        for half in halves {
            runs.push(naming.fitted(half)?);
        }
    }
    runs.sort_by(|a, b| b.score.total_cmp(&a.score));
    let least = sure.max(0.5);
    let mut labels = runs[0].sure(&tracks, SLOPE * (least / (1.0 - least)).ln());
    for other in runs.iter().filter(|run| run.score >= NEAR * runs[0].score) {
        for (own, other) in labels.iter_mut().zip(&other.labels) {
            *own = own.filter(|own| other.is_none_or(|other| other == *own));
        }
    }
    labels
        .iter_mut()
        .for_each(|label| *label = label.filter(|l| !model.is_one_of_several(*l)));
    let hosts = Hosts::new(&tracks, &labels, naming.labels);
    // A label without a column of its own has nowhere to go.
    labels
        .iter_mut()
        .for_each(|label| *label = label.filter(|l| hosts.has(*l)));
    let mut named = NamedTracks {
        moves: hosts.moves(&tracks, &labels),
        names: hosts.names(model.labels()),
        ..NamedTracks::default()
    };
    named.tell(&tracks, [&labels, &runs[0].labels], model, &poses.points);
    Ok(named)
}

impl NamedTracks {
    /// Whether something is not sure.
    pub fn is_unsure(&self) -> bool {
        !self.unsure.is_empty() || self.is_other_set()
    }

    /// Whether so many labels are no track's that these may be of another marker set.
    fn is_other_set(&self) -> bool {
        self.missing.len() as f64 > MISSING * (self.labels.len() + self.missing.len()) as f64
    }

    /// What is to be told of them, a line each.
    pub fn lines(&self) -> Vec<String> {
        let count = self.labels.len() + self.missing.len() + self.alike.len();
        let tracks: usize = self.labels.iter().map(|l| l.tracks.len()).sum();
        let found = self.labels.len();
        let mut lines = vec![format!(
            "{found} of {count} labels named, from {tracks} tracks"
        )];
        if !self.missing.is_empty() {
            lines.push(format!("no track is {}", self.missing.join(", ")));
        }
        if self.is_other_set() {
            let what = "so many labels are no track's: it may be another set, and names be wrong";
            lines.push(what.to_string());
        }
        if !self.alike.is_empty() {
            lines.push(format!(
                "{} cannot be told apart by the set; learn it from a labeled take, or give that as \
                 the option `like`",
                self.alike.join(", ")
            ));
        }
        let of_piece = |piece: &UnsureTrack| {
            let [start, end] = piece.frames;
            let UnsureTrack { track, label, .. } = piece;
            let last = end - 1;
            format!(
                "{track} in frames {start} to {last} may be {label}: not sure, so it has no label"
            )
        };
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
        lines.extend(self.unsure.iter().map(of_piece));
        lines
    }

    /// Tells which of `labels` are which of `points`; of the two ways to label paths the first is
    /// sure.
    fn tell(
        &mut self,
        tracks: &LooseTracks<'_>,
        [sure, likely]: [&PathLabels; 2],
        model: &dyn LabelModel,
        points: &[String],
    ) {
        let labels = model.labels();
        let moved = self.moves.iter().map(|m| MovedPiece {
            track: points[m.from].clone(),
            frames: [m.frames.start, m.frames.end],
            to: m.to.map(|to| points[to].clone()),
        });
        self.moved = moved.collect();
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
                0 if model.is_one_of_several(l) => self.alike.push(label.clone()),
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
            for piece in tracks.pieces_of(path) {
                self.unsure.push(UnsureTrack {
                    track: points[piece.track].clone(),
                    frames: [piece.frames.start, piece.frames.end],
                    label: labels[*label].clone(),
                });
            }
        }
    }
}

/// The names of one frame by its paths, and how much they count.
#[derive(Debug, Clone)]
struct Vote {
    weight: f64,
    named: Vec<(usize, Option<usize>)>,
}

/// Labels of paths, and the model that is fitted by them.
struct Run {
    labels: PathLabels,
    /// How far each path is from each label: nats a frame by which it is likelier than none.
    nats: Array2<f64>,
    is_odd: Vec<bool>,
    /// The nats of all paths.
    score: f64,
}

struct Naming<'a> {
    tracks: &'a LooseTracks<'a>,
    model: &'a dyn LabelModel,
    labels: usize,
    /// The frames that the model is fitted to.
    frames: Vec<usize>,
}

impl Naming<'_> {
    /// Of equal stretches those frames in which the longest paths are seen.
    fn key_frames(&self) -> Vec<usize> {
        let tracks = self.tracks;
        let count = tracks.xyz.nrows();
        let length = |t: usize| tracks.seen(t).map(|(path, _)| tracks.frames(path)).sum();
        let of_stretch = |n: usize| {
            let stretch = n * count / KEY_FRAMES..(n + 1) * count / KEY_FRAMES;
            let step = stretch.len().div_ceil(LOOKED_AT).max(1);
            stretch
                .step_by(step)
                .max_by_key(|t| -> (usize, usize) { (length(*t), usize::MAX - t) })
        };
        (0..KEY_FRAMES).filter_map(of_stretch).collect()
    }

    /// Names frames by themselves.
    fn votes(&self) -> Result<Vec<Vote>> {
        let tracks = self.tracks;
        let longest = (0..tracks.paths.len())
            .map(|path| tracks.frames(path))
            .max();
        let shortest = ((SHORTEST * tracks.rate) as usize).min(longest.unwrap_or(1) / 2);
        let of_frame = |t: usize| {
            let long = tracks
                .seen(t)
                .filter(|(path, _)| tracks.frames(*path) > shortest);
            long.collect::<Vec<(usize, DVec3)>>()
        };
        let seen: Vec<Vec<(usize, DVec3)>> = self.key_frames().into_iter().map(of_frame).collect();
        let points = seen.iter().map(|s| s.iter().map(|(_, at)| *at).collect());
        let named = self.model.name_frames(&points.collect::<Vec<_>>())?;
        let least = named.iter().map(|n| n.cost).fold(f64::INFINITY, f64::min);
        let vote = |(seen, named): (Vec<(usize, DVec3)>, &NamedFrame)| Vote {
            weight: (-WEIGHT * (named.cost - least) / least).exp(),
            named: seen
                .iter()
                .map(|(path, _)| *path)
                .zip(named.labels.iter().copied())
                .collect(),
        };
        Ok(seen.into_iter().zip(&named).map(vote).collect())
    }

    /// The labels for which some frames vote.
    fn elected(&self, votes: &[Vote]) -> PathLabels {
        let mut sums = Array2::zeros((self.tracks.paths.len(), self.labels + 1));
        for vote in votes {
            for (path, label) in &vote.named {
                sums[[*path, label.unwrap_or(self.labels)]] += vote.weight;
            }
        }
        self.tracks.elect(&sums)
    }

    /// Fits the model, and labels by it, in rounds.
    fn fitted(&self, mut labels: PathLabels) -> Result<Run> {
        let mut round = 0;
        loop {
            let known = self
                .tracks
                .places(&labels, self.labels)
                .select(Axis(0), &self.frames);
            let fit = self.model.fit(known.view())?;
            let mut costs = self.costs(&fit);
            let mut next = self.nearest(&costs);
            self.drop_needless(&mut costs, &mut next);
            round += 1;
            // Nothing changes, and what is new is of labels that the fit knew.
            let is_settled = labels.iter().zip(&next).all(|(was, is)| match (was, is) {
                (None, Some(_)) => labels.contains(is),
                _ => was == is,
            });
            labels = next;
            if is_settled || round == ROUNDS {
                let nats = costs.mapv(nats);
                return Ok(Run {
                    score: self.score(&labels, &costs),
                    labels,
                    nats,
                    is_odd: fit.is_odd,
                });
            }
        }
    }

    /// Does without labels where others, which no path has, fit their paths hardly worse.
    fn drop_needless(&self, costs: &mut Array2<f64>, labels: &mut PathLabels) {
        for label in 0..self.labels {
            let own: Vec<usize> = (0..labels.len())
                .filter(|path| labels[*path] == Some(label))
                .collect();
            let held: usize = own.iter().map(|path| self.tracks.frames(*path)).sum();
            let is_free = |l: &usize| !labels.contains(&Some(*l));
            let free: Vec<usize> = (0..self.labels).filter(is_free).collect();
            let is_near = |path: &usize| {
                let own = nats(costs[[*path, label]]);
                free.iter()
                    .any(|l| nats(costs[[*path, *l]]) >= own - NEEDLESS)
            };
            if !own.iter().any(is_near) {
                continue;
            }
            let mut without = costs.clone();
            without.column_mut(label).fill(FARTHEST * FARTHEST);
            let others = self.nearest(&without);
            let lost = self.score(labels, costs) - self.score(&others, &without);
            if lost <= NEEDLESS * held as f64 {
                (*costs, *labels) = (without, others);
            }
        }
    }

    /// The nats of all paths, frame by frame.
    fn score(&self, labels: &PathLabels, costs: &Array2<f64>) -> f64 {
        let own = labels.iter().enumerate();
        let own = own.filter_map(|(path, l)| Some((path, nats(costs[[path, (*l)?]]))));
        own.map(|(path, nats)| self.tracks.frames(path) as f64 * nats)
            .sum()
    }

    /// The mean squared distance of each path from each label, cm² (paths, L); less of a label
    /// that may be anywhere.
    fn costs(&self, fit: &FittedLabels) -> Array2<f64> {
        let tracks = self.tracks;
        let wider = |sd: &f64| REJECTED / (REJECTED + WIDER * sd * sd);
        let wider: Vec<f64> = fit.sd.iter().map(wider).collect();
        // A place that may be anywhere is less likely to be this one.
        let anywhere: Vec<f64> = wider.iter().map(|w| -3.0 * SD * SD * w.ln()).collect();
        let row_of = |t: usize| self.frames.binary_search(&t).ok();
        let rows = map_chunks(tracks.paths.len(), 4, |range| {
            let row = |path: usize| {
                let (mut sums, mut count) = (vec![0.0; self.labels], 0.0);
                let known = tracks
                    .places_of(path)
                    .filter_map(|(t, at)| Some((row_of(t)?, at)));
                for (n, at) in known {
                    count += 1.0;
                    for (label, sum) in sums.iter_mut().enumerate() {
                        let far = point_at(fit.places.view(), n, label).distance_squared(at);
                        *sum += (far * wider[label] + anywhere[label]).min(FARTHEST * FARTHEST);
                    }
                }
                sums.into_iter().map(move |s| s / count)
            };
            range.flat_map(row).collect::<Vec<f64>>()
        });
        let all = rows.concat();
        let shape = (tracks.paths.len(), self.labels);
        Array2::from_shape_fn(shape, |(path, label)| all[path * self.labels + label])
    }

    /// The labels of the paths that are nearest to them: of all that are seen in a frame together.
    fn nearest(&self, costs: &Array2<f64>) -> PathLabels {
        let tracks = self.tracks;
        let step = ((EVERY * tracks.rate) as usize).max(1);
        let frames: Vec<usize> = (0..tracks.xyz.nrows()).step_by(step).collect();
        let found = map_chunks(frames.len(), 8, |range| {
            let of = |t: usize| {
                let seen: Vec<usize> = tracks.seen(t).map(|(path, _)| path).collect();
                let cost = |label: usize, n: usize| costs[[seen[n], label]];
                let of_labels = assign(self.labels, seen.len(), REJECTED, cost);
                let mut named: Vec<(usize, usize)> =
                    seen.iter().map(|path| (*path, self.labels)).collect();
                for (label, n) in of_labels.into_iter().enumerate() {
                    if let Some(n) = n {
                        named[n].1 = label;
                    }
                }
                named
            };
            range.flat_map(|n| of(frames[n])).collect::<Vec<_>>()
        });
        let mut votes = Array2::zeros((tracks.paths.len(), self.labels + 1));
        for (path, label) in found.into_iter().flatten() {
            votes[[path, label]] += 1.0;
        }
        tracks.elect(&votes)
    }
}

/// The nats a frame by which a path is likelier a label, at some mean squared distance, than none.
fn nats(cost: f64) -> f64 {
    (REJECTED - cost) / (2.0 * SD * SD)
}

impl Run {
    /// The labels by which the paths are more likely by so many nats than with any other that is
    /// free then or that another path gives for theirs.
    fn sure(&self, tracks: &LooseTracks<'_>, least: f64) -> PathLabels {
        let holders = tracks.holders(&self.labels, self.nats.ncols());
        let of = |(path, label): (usize, &Option<usize>)| {
            let label = (*label).filter(|l| !self.is_odd[*l])?;
            let own = tracks.weight(path) * self.nats[[path, label]];
            let loss = |other: usize| {
                let held = tracks.held(&holders, other, path);
                let give = |q: usize| {
                    let [theirs, mine] = [other, label].map(|l| self.nats[[q, l]]);
                    tracks.weight(q) * (theirs - mine.max(0.0))
                };
                let lost: f64 = held.into_iter().map(give).sum();
                own - tracks.weight(path) * self.nats[[path, other]] + lost
            };
            let others = (0..self.nats.ncols()).filter(|l| *l != label);
            let gain = others.map(loss).fold(own, f64::min);
            // A path without a label may be it as well.
            let rivals = tracks
                .seen_with(path)
                .into_iter()
                .filter(|q| self.labels[*q].is_none());
            let rival = rivals.map(|q| self.nats[[q, label]]).fold(0.0, f64::max);
            let gain = gain.min(own - tracks.weight(path) * rival);
            (gain >= least).then_some(label)
        };
        self.labels.iter().enumerate().map(of).collect()
    }
}
