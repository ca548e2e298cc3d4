//! Tracks without labels, cut to paths each of which is one marker, and the label of each path.

use super::evidence::independent_frames;
use super::fragments::{Fragment, Link, fragments};
use super::links::{Links, chains};
use super::tuning::naming::{LOOKED_AT, ONE_TRACK, REACH, SHORTEST};
use super::tuning::repair::MOST_WEIGHT;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::{Array2, ArrayView2};
use std::collections::BTreeSet;
use std::ops::Range;

/// The paths of a take's tracks.
pub(super) struct LooseTracks<'a> {
    /// (frames, 3 N), cm; NaN is missing.
    pub xyz: ArrayView2<'a, f64>,
    /// Frames a second.
    pub rate: f64,
    pub fragments: Vec<Fragment>,
    /// The fragments of each path.
    pub paths: Vec<Vec<usize>>,
    /// The path that a track is in a frame (frames, N).
    owner: Array2<Option<usize>>,
}

/// The label of each path; `None` where it has none.
pub(super) type PathLabels = Vec<Option<usize>>;

impl<'a> LooseTracks<'a> {
    /// Cuts tracks to fragments and links these; `runs` are ranges of consecutive frames.
    pub(super) fn new(
        xyz: ArrayView2<'a, f64>,
        runs: &[Range<usize>],
        rate: f64,
    ) -> LooseTracks<'a> {
        let fragments = fragments(xyz, runs, rate);
        let mut links = Links::new(xyz, &fragments, 0, rate).links;
        links.extend(across_gaps(xyz, &fragments, &links, rate));
        let paths = chains(fragments.len(), links.into_iter());
        let mut owner = Array2::from_elem((xyz.nrows(), xyz.ncols() / 3), None);
        for (path, of) in paths.iter().enumerate() {
            for &p in of {
                let Fragment { track, frames, .. } = &fragments[p];
                frames.clone().for_each(|t| owner[[t, *track]] = Some(path));
            }
        }
        LooseTracks {
            xyz,
            rate,
            fragments,
            paths,
            owner,
        }
    }

    /// How many frames a path has.
    pub(super) fn frames(&self, path: usize) -> usize {
        self.paths[path]
            .iter()
            .map(|p| self.fragments[*p].frames.len())
            .sum()
    }

    /// The middle one of the frames of a path.
    pub(super) fn middle(&self, path: usize) -> usize {
        let frames: Vec<usize> = self.frames_of(path).collect();
        frames.get(frames.len() / 2).copied().unwrap_or_default()
    }

    /// The paths that are seen in a frame, each with its position.
    pub(super) fn seen(&self, t: usize) -> impl Iterator<Item = (usize, DVec3)> + '_ {
        let owners = self.owner.row(t);
        let of = move |track: usize| Some((owners[track]?, point_at(self.xyz, t, track)));
        (0..self.owner.ncols()).filter_map(of)
    }

    /// The positions of a path, each with its frame.
    pub(super) fn positions_of(&self, path: usize) -> impl Iterator<Item = (usize, DVec3)> + '_ {
        self.paths[path].iter().flat_map(|p| {
            let Fragment { track, frames, .. } = &self.fragments[*p];
            frames.clone().map(|t| (t, point_at(self.xyz, t, *track)))
        })
    }

    /// Frames at about `rate` a second, and more where else fewer than `fewest` of a path, or not
    /// all of it, are among them; in their order. The shortest paths may be reflections.
    pub(super) fn frames_of_all(&self, rate: f64, fewest: usize) -> Vec<usize> {
        let step = ((self.rate / rate).round() as usize).max(1);
        let mut frames: BTreeSet<usize> = (0..self.xyz.nrows()).step_by(step).collect();
        let shortest = (SHORTEST * self.rate) as usize;
        let long = (0..self.paths.len()).filter(|path| self.frames(*path) > shortest);
        for path in long {
            let own: Vec<usize> = self.frames_of(path).collect();
            if own.iter().filter(|t| frames.contains(t)).count() < fewest {
                frames.extend(own.iter().step_by(own.len().div_ceil(fewest)));
            }
        }
        frames.into_iter().collect()
    }

    /// Gives each path the label that most of its votes are for, at least half of them, the
    /// strongest first; no label is in two positions at once.
    pub(super) fn elect(&self, votes: &Array2<f64>) -> PathLabels {
        let labels = votes.ncols() - 1;
        let mut all: Vec<(f64, usize, usize)> = Vec::new();
        for (path, row) in votes.rows().into_iter().enumerate() {
            let sum = row.sum();
            let own = row.iter().enumerate().take(labels);
            let best = own.max_by(|a, b| a.1.total_cmp(b.1));
            let best = best.filter(|(_, v)| **v > 0.0 && 2.0 * **v >= sum);
            all.extend(best.map(|(label, v)| (*v, path, label)));
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut is_held = Array2::from_elem((labels, self.xyz.nrows()), false);
        let mut out = vec![None; self.paths.len()];
        for (_, path, label) in all {
            let frames = || {
                self.paths[path]
                    .iter()
                    .flat_map(|p| self.fragments[*p].frames.clone())
            };
            if frames().all(|t| !is_held[[label, t]]) {
                frames().for_each(|t| is_held[[label, t]] = true);
                out[path] = Some(label);
            }
        }
        out
    }

    /// Where each of so many labels is (frames, 3 L), cm.
    pub(super) fn positions(&self, of: &PathLabels, labels: usize) -> Array2<f64> {
        let mut positions = Array2::from_elem((self.xyz.nrows(), 3 * labels), f64::NAN);
        for (path, label) in of.iter().enumerate() {
            let Some(label) = label else { continue };
            for (t, at) in self.positions_of(path) {
                (0..3).for_each(|c| positions[[t, 3 * label + c]] = at[c]);
            }
        }
        positions
    }

    /// How many frames that say something of their own a path has.
    pub(super) fn weight(&self, path: usize) -> f64 {
        independent_frames(self.frames(path), self.rate).min(MOST_WEIGHT)
    }

    /// The path that holds each label in each frame (L, frames).
    pub(super) fn holders(&self, of: &PathLabels, labels: usize) -> Array2<Option<usize>> {
        let mut holders = Array2::from_elem((labels, self.xyz.nrows()), None);
        for (path, label) in of.iter().enumerate() {
            let Some(label) = label else { continue };
            for t in self.frames_of(path) {
                holders[[*label, t]] = Some(path);
            }
        }
        holders
    }

    /// The other paths that hold a label in the frames of one.
    pub(super) fn held(
        &self,
        holders: &Array2<Option<usize>>,
        label: usize,
        path: usize,
    ) -> BTreeSet<usize> {
        let all = self.frames_of(path).filter_map(|t| holders[[label, t]]);
        all.filter(|other| *other != path).collect()
    }

    /// The paths that are seen in some of the frames of one.
    pub(super) fn seen_with(&self, path: usize) -> BTreeSet<usize> {
        let step = self.frames(path).div_ceil(LOOKED_AT).max(1);
        let frames = self.frames_of(path).step_by(step);
        let all = frames.flat_map(|t| self.seen(t).map(|(other, _)| other).collect::<Vec<_>>());
        all.filter(|other| *other != path).collect()
    }

    /// The fragments of a path.
    pub(super) fn fragments_of(&self, path: usize) -> impl Iterator<Item = &Fragment> + '_ {
        self.paths[path].iter().map(|p| &self.fragments[*p])
    }

    /// The tracks of a path, fragment by fragment.
    pub(super) fn tracks_of(&self, path: usize) -> impl Iterator<Item = usize> + '_ {
        self.fragments_of(path).map(|fragment| fragment.track)
    }

    fn frames_of(&self, path: usize) -> impl Iterator<Item = usize> + '_ {
        self.paths[path]
            .iter()
            .flat_map(|p| self.fragments[*p].frames.clone())
    }
}

/// Links across gaps of a track that nothing else goes on in: who wrote the track took both sides
/// for one marker.
fn across_gaps(
    xyz: ArrayView2<'_, f64>,
    fragments: &[Fragment],
    links: &[Link],
    rate: f64,
) -> Vec<Link> {
    let (mut goes_on, mut is_met) = (vec![false; fragments.len()], vec![false; fragments.len()]);
    for link in links {
        (goes_on[link.from], is_met[link.to]) = (true, true);
    }
    let link = |from: usize| {
        let (early, late) = (&fragments[from], fragments.get(from + 1)?);
        let is_free = !goes_on[from] && !is_met[from + 1] && early.track == late.track;
        let time = late.frames.start.saturating_sub(early.frames.end) as f64 / rate;
        let [a, b] = [early.frames.end - 1, late.frames.start];
        let apart = point_at(xyz, a, early.track).distance(point_at(xyz, b, late.track));
        let is_gap = !early.jumps[1] && !late.jumps[0] && time <= ONE_TRACK;
        let to = from + 1;
        (is_free && is_gap && apart <= REACH * time).then_some(Link { from, to })
    };
    (0..fragments.len()).filter_map(link).collect()
}
