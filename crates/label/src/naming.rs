//! The tracks of a take named as the markers of a set, on one person or on several.
//!
//! 1. Tracks are cut to fragments, and these linked to paths, each of which is one marker
//!    (`loose_tracks`).
//! 2. A model of the labels names the points of some frames, each by itself, and these vote for the
//!    labels of the paths.
//! 3. Some rounds: the model is fitted to the take as it is labeled then, and says where each label
//!    is in every frame; each path is the label that it stays nearest to.
//! 4. What is not sure has no label.

use super::label_model::{FittedLabels, LabelModel, NamedFrame};
use super::loose_tracks::{LooseTracks, PathLabels};
use super::templates::Templates;
use super::tuning::naming::*;
use crate::Result;
use crate::numeric::assignment::assign;
use crate::numeric::parallel::map_chunks;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, concatenate, s};
use std::cmp::Reverse;
use std::collections::BTreeSet;

/// The names of one frame by its paths, and how much they count.
struct Vote {
    weight: f64,
    named: Vec<(usize, Option<usize>)>,
}

/// Labels of paths, and the model that is fitted by them.
pub(super) struct Run {
    pub labels: PathLabels,
    /// How far each path is from each label: nats a frame by which it is likelier than none.
    nats: Array2<f64>,
    /// How far each label is from where such labels are mostly, standard deviations.
    deviations: Vec<f64>,
    /// The nats of all paths.
    score: f64,
}

/// The labels of some people, all of one set, and the tracks that may be theirs.
#[derive(Clone)]
pub(super) struct Naming<'a> {
    pub tracks: &'a LooseTracks<'a>,
    pub model: &'a dyn LabelModel,
    /// How many people they are. The labels of each follow those of the one before.
    pub people: usize,
    /// Whether each path may be theirs.
    pub is_open: Vec<bool>,
    /// The frames that the model is fitted to.
    pub frames: Vec<usize>,
}

impl<'a> Naming<'a> {
    /// Labels of one person, whose any path may be.
    pub(super) fn new(tracks: &'a LooseTracks<'a>, model: &'a dyn LabelModel) -> Naming<'a> {
        Naming {
            tracks,
            model,
            people: 1,
            is_open: vec![true; tracks.paths.len()],
            frames: tracks.frames_of_all(RATE, FEWEST_PLACES),
        }
    }

    /// The labels of a person.
    pub(super) fn set(&self) -> &[String] {
        self.model.labels()
    }

    /// How many labels there are.
    pub(super) fn labels(&self) -> usize {
        self.people * self.set().len()
    }

    /// Whether a label is one of several that the model cannot tell apart.
    pub(super) fn is_one_of_several(&self, label: usize) -> bool {
        self.model.is_one_of_several(label % self.set().len())
    }

    /// What the labels are called: of several people by the labeled takes of `like`.
    pub(super) fn names(&self, of: &PathLabels, like: &Templates) -> Vec<String> {
        let set = self.set();
        if self.people == 1 {
            return set.to_vec();
        }
        let people = like.who(set, &self.positions(of));
        let named = people
            .iter()
            .flat_map(|p| set.iter().map(move |l| format!("{p}:{l}")));
        named.collect()
    }

    /// Where the labels of each person are (frames, 3 L), cm.
    pub(super) fn positions(&self, of: &PathLabels) -> Vec<Array2<f64>> {
        let (all, width) = (
            self.tracks.positions(of, self.labels()),
            3 * self.set().len(),
        );
        let one = |k: usize| all.slice(s![.., width * k..width * (k + 1)]).to_owned();
        (0..self.people).map(one).collect()
    }

    /// How well labels and tracks fit each other, where the people are those of labeled takes or
    /// not; see [`NamedTracks::fit`].
    ///
    /// [`NamedTracks::fit`]: super::named_tracks::NamedTracks::fit
    pub(super) fn fit_of(&self, of: &PathLabels, are_like: bool) -> f64 {
        let tracks = self.tracks;
        let shortest = (SHORTEST * tracks.rate) as usize;
        let (mut named, mut seen) = (0, 0);
        for (path, label) in of.iter().enumerate() {
            let frames = tracks.frames(path);
            named += label.map_or(0, |_| frames);
            // Shorter ones may be reflections.
            seen += if label.is_some() || frames > shortest {
                frames
            } else {
                0
            };
        }
        let alike = (0..self.set().len()).filter(|l| self.model.is_one_of_several(*l));
        let set = self.set().len() - alike.count();
        let is_there = |row: &ArrayView1<'_, f64>| {
            row.iter().filter(|v| v.is_finite()).count() * PRESENT_SHARE >= row.len()
        };
        let positions = self.positions(of);
        let rows = positions.iter().flat_map(|of| of.rows());
        // A take of a person that is known may have part of the labels.
        let due = if are_like {
            named
        } else {
            set * rows.filter(is_there).count()
        };
        2.0 * named as f64 / (seen + due).max(1) as f64
    }

    /// The paths that are seen in a frame and may be theirs, each with its position.
    pub(super) fn seen(&self, t: usize) -> impl Iterator<Item = (usize, DVec3)> + '_ {
        self.tracks.seen(t).filter(|(path, _)| self.is_open[*path])
    }

    /// A person by the labels for which some frames vote; `None` where that is no body.
    pub(super) fn one_body(&self) -> Result<Option<Run>> {
        let votes = self.votes()?;
        let all = self.elected(&votes);
        let points: usize = votes.iter().map(|vote| vote.named.len()).sum();
        let seen = points as f64 / votes.len().max(1) as f64;
        let due = LEAST_ELECTED * seen.min(self.set().len() as f64);
        let elected = count_labels(&all);
        if elected < FEWEST_LABELS.min(self.set().len()) || (elected as f64) < due {
            return Ok(None);
        }
        self.improved(self.fitted(all, self.rounds())?).map(Some)
    }

    /// Fits the model of each person to where the labels are in the frames (frames, 3 L).
    fn fit(&self, known: ArrayView2<'_, f64>) -> Result<FittedLabels> {
        let width = 3 * self.set().len();
        let of = |k: usize| {
            self.model
                .fit(known.slice(s![.., width * k..width * (k + 1)]))
        };
        let fits = (0..self.people)
            .map(of)
            .collect::<Result<Vec<FittedLabels>>>()?;
        let places: Vec<_> = fits.iter().map(|fit| fit.places.view()).collect();
        Ok(FittedLabels {
            places: concatenate(Axis(1), &places).map_err(|e| e.to_string())?,
            sd: fits.iter().flat_map(|fit| fit.sd.iter().copied()).collect(),
            reach: fits
                .iter()
                .flat_map(|fit| fit.reach.iter().copied())
                .collect(),
            deviations: fits
                .iter()
                .flat_map(|fit| fit.deviations.iter().copied())
                .collect(),
        })
    }

    /// Frames in which the longest paths are seen, one of each of equal stretches.
    fn key_frames(&self) -> Vec<usize> {
        let tracks = self.tracks;
        let count = tracks.xyz.nrows();
        let length = |t: usize| self.seen(t).map(|(path, _)| tracks.frames(path)).sum();
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
            let long = self
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
        let mut sums = Array2::zeros((self.tracks.paths.len(), self.labels() + 1));
        for vote in votes {
            for (path, label) in &vote.named {
                sums[[*path, label.unwrap_or(self.labels())]] += vote.weight;
            }
        }
        self.tracks.elect(&sums)
    }

    /// Rounds of a fit, at most.
    pub(super) fn rounds(&self) -> usize {
        if self.model.is_of_neighbors() {
            GROWING_ROUNDS
        } else {
            ROUNDS
        }
    }

    /// Fits the model, and labels by it, in so many rounds at most.
    pub(super) fn fitted(&self, mut labels: PathLabels, rounds: usize) -> Result<Run> {
        let mut best: Option<Run> = None;
        for round in 1.. {
            let known = self
                .tracks
                .positions(&labels, self.labels())
                .select(Axis(0), &self.frames);
            let fit = self.fit(known.view())?;
            let mut costs = self.costs(&fit);
            let mut next = self.nearest(&costs);
            self.drop_needless(&mut costs, &mut next);
            // Nothing changes, and what is new is of labels that the fit knew.
            let is_known = |label| labels.contains(label) && !self.model.is_of_neighbors();
            let is_settled = labels.iter().zip(&next).all(|(was, is)| match (was, is) {
                (None, Some(_)) => is_known(is),
                _ => was == is,
            });
            labels = next;
            let run = Run {
                score: self.score(&labels, &costs),
                labels: labels.clone(),
                nats: costs.mapv(nats),
                deviations: fit.deviations,
            };
            if is_settled || round == rounds {
                // One that goes round in circles is best in one of its rounds.
                let is_better = |best: &Run| !is_settled && best.score > run.score;
                return Ok(best.filter(is_better).unwrap_or(run));
            }
            if best.as_ref().is_none_or(|best| run.score > best.score) {
                best = Some(run);
            }
        }
        Err("no round".into())
    }

    /// Improves a run: one that has fitted itself to wrong names sees no better ones, so long paths
    /// without a label are given one near them that is not in its usual position.
    fn improved(&self, mut best: Run) -> Result<Run> {
        let long = self.tracks.xyz.nrows() as f64 * LONG;
        let is_left =
            |path: &usize| best.labels[*path].is_none() && self.tracks.frames(*path) as f64 >= long;
        let mut left: Vec<usize> = (0..best.labels.len()).filter(is_left).collect();
        left.sort_by_key(|path| Reverse(self.tracks.frames(*path)));
        for path in left.into_iter().take(TRIED) {
            let near = self.unusual_near(&best, path);
            let Some(label) = near.filter(|_| best.labels[path].is_none()) else {
                continue;
            };
            let run = self.fitted(self.given(&best.labels, path, label), 1)?;
            if run.score > best.score {
                best = self.fitted(run.labels, self.rounds() - 1)?;
            }
        }
        Ok(best)
    }

    /// The label nearest to a path that nobody has or that is not in its usual position.
    fn unusual_near(&self, run: &Run, path: usize) -> Option<usize> {
        let is_near = |l: &usize| {
            run.nats[[path, *l]] > nats(FARTHEST * FARTHEST)
                && (run.deviations[*l] >= UNUSUAL || !run.labels.contains(&Some(*l)))
        };
        let nearer = |a: &usize, b: &usize| run.nats[[path, *a]].total_cmp(&run.nats[[path, *b]]);
        (0..self.labels()).filter(is_near).max_by(nearer)
    }

    /// The labels with one given to a path, by those that have it in its frames.
    fn given(&self, labels: &PathLabels, path: usize, label: usize) -> PathLabels {
        let holders = self.tracks.holders(labels, self.labels());
        let mut labels = labels.clone();
        for other in self.tracks.held(&holders, label, path) {
            labels[other] = None;
        }
        labels[path] = Some(label);
        labels
    }

    /// Does without labels where others, which no path has, fit their paths hardly worse.
    fn drop_needless(&self, costs: &mut Array2<f64>, labels: &mut PathLabels) {
        for label in 0..self.labels() {
            let own: Vec<usize> = (0..labels.len())
                .filter(|path| labels[*path] == Some(label))
                .collect();
            let held: usize = own.iter().map(|path| self.tracks.frames(*path)).sum();
            let holders = self.tracks.holders(labels, self.labels());
            // Nobody has it, or somebody for a short while.
            let is_free = |path: usize, other: usize| {
                let held = self.tracks.held(&holders, other, path).into_iter();
                let held: usize = held.map(|q| self.tracks.frames(q)).sum();
                other != label && held * SHORT <= self.tracks.frames(path)
            };
            let is_near = |path: &usize| {
                let own = nats(costs[[*path, label]]);
                (0..self.labels())
                    .filter(|l| nats(costs[[*path, *l]]) >= own - NEEDLESS)
                    .any(|l| is_free(*path, l))
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
        // A position that may be anywhere is less likely to be this one.
        let anywhere: Vec<f64> = wider.iter().map(|w| -3.0 * SD * SD * w.ln()).collect();
        let row_of = |t: usize| self.frames.binary_search(&t).ok();
        let rows = map_chunks(tracks.paths.len(), 4, |range| {
            let row = |path: usize| {
                let mut sums = vec![(0.0, 0.0); self.labels()];
                let known = tracks
                    .positions_of(path)
                    .filter_map(|(t, at)| Some((row_of(t)?, at)));
                for (n, at) in known {
                    for (label, (sum, count)) in sums.iter_mut().enumerate() {
                        let far = point_at(fit.places.view(), n, label).distance_squared(at);
                        if far.is_finite() {
                            let far = far / fit.reach[label].powi(2);
                            *sum += (far * wider[label] + anywhere[label]).min(FARTHEST * FARTHEST);
                            *count += 1.0;
                        }
                    }
                }
                let mean = |(sum, count): (f64, f64)| {
                    if count > 0.0 {
                        sum / count
                    } else {
                        FARTHEST * FARTHEST
                    }
                };
                sums.into_iter().map(mean)
            };
            range.flat_map(row).collect::<Vec<f64>>()
        });
        let all = rows.concat();
        let shape = (tracks.paths.len(), self.labels());
        Array2::from_shape_fn(shape, |(path, label)| all[path * self.labels() + label])
    }

    /// The labels of the paths that are nearest to them: of all that are seen in a frame together.
    fn nearest(&self, costs: &Array2<f64>) -> PathLabels {
        let tracks = self.tracks;
        let step = ((EVERY * tracks.rate) as usize).max(1);
        let frames: Vec<usize> = (0..tracks.xyz.nrows()).step_by(step).collect();
        let found = map_chunks(frames.len(), 8, |range| {
            let of = |t: usize| {
                let seen: Vec<usize> = self.seen(t).map(|(path, _)| path).collect();
                let cost = |label: usize, n: usize| costs[[seen[n], label]];
                let of_labels = assign(self.labels(), seen.len(), REJECTED, cost);
                let mut named: Vec<(usize, usize)> =
                    seen.iter().map(|path| (*path, self.labels())).collect();
                for (label, n) in of_labels.into_iter().enumerate() {
                    if let Some(n) = n {
                        named[n].1 = label;
                    }
                }
                named
            };
            range.flat_map(|n| of(frames[n])).collect::<Vec<_>>()
        });
        let mut votes = Array2::zeros((tracks.paths.len(), self.labels() + 1));
        for (path, label) in found.into_iter().flatten() {
            votes[[path, label]] += 1.0;
        }
        tracks.elect(&votes)
    }
}

/// How many labels some paths have.
pub(super) fn count_labels(of: &PathLabels) -> usize {
    of.iter().flatten().collect::<BTreeSet<_>>().len()
}

/// The nats a frame by which a path is likelier a label, at some mean squared distance, than none.
fn nats(cost: f64) -> f64 {
    (REJECTED - cost) / (2.0 * SD * SD)
}

impl Run {
    /// The labels by which the paths are more likely by so many nats than with any other that is
    /// free then or that another path gives for theirs.
    pub(super) fn sure(&self, tracks: &LooseTracks<'_>, least: f64) -> PathLabels {
        let holders = tracks.holders(&self.labels, self.nats.ncols());
        let rare = tracks.xyz.nrows() as f64 * RARE;
        let is_rare = |label: usize| (holders.row(label).iter().flatten().count() as f64) < rare;
        let is_rare: Vec<bool> = (0..self.nats.ncols()).map(is_rare).collect();
        let of = |(path, label): (usize, &Option<usize>)| {
            let label = (*label).filter(|l| self.deviations[*l] < ODD && !is_rare[*l])?;
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
