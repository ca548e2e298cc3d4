//! Which track becomes which label: the one that has most of it. Its other fragments go elsewhere.

use super::loose_tracks::{LooseTracks, PathLabels};
use crate::io::PointMove;
use ndarray::Array2;
use std::ops::Range;

/// The track that each label becomes.
pub(super) struct Hosts {
    track: Vec<Option<usize>>,
    /// The label that each track becomes.
    label: Vec<Option<usize>>,
}

impl Hosts {
    pub(super) fn new(tracks: &LooseTracks<'_>, of: &PathLabels, labels: usize) -> Hosts {
        let count = tracks.xyz.ncols() / 3;
        let mut frames: Array2<usize> = Array2::zeros((labels, count));
        for (path, label) in of.iter().enumerate() {
            for fragment in tracks.fragments_of(path) {
                if let Some(label) = label {
                    frames[[*label, fragment.track]] += fragment.frames.len();
                }
            }
        }
        let own = frames.indexed_iter().filter(|(_, n)| **n > 0);
        let mut most: Vec<(usize, usize, usize)> =
            own.map(|((label, track), n)| (*n, label, track)).collect();
        most.sort_by_key(|(n, label, track)| (std::cmp::Reverse(*n), *label, *track));
        let mut hosts = Hosts {
            track: vec![None; labels],
            label: vec![None; count],
        };
        for (_, label, track) in most {
            if hosts.track[label].is_none() && hosts.label[track].is_none() {
                (hosts.track[label], hosts.label[track]) = (Some(track), Some(label));
            }
        }
        hosts
    }

    /// Whether a label becomes a track.
    pub(super) fn has(&self, label: usize) -> bool {
        self.track[label].is_some()
    }

    /// The tracks and the names that they get.
    pub(super) fn names(&self, labels: &[String]) -> Vec<(usize, String)> {
        let all = self.track.iter().zip(labels);
        all.filter_map(|(track, name)| Some(((*track)?, name.clone())))
            .collect()
    }

    /// The fragments that move: labels to their tracks, and what else stands there to tracks that
    /// are empty then, or nowhere if there is none.
    pub(super) fn moves(&self, tracks: &LooseTracks<'_>, of: &PathLabels) -> Vec<PointMove> {
        let (mut moves, mut strays) = (Vec::new(), Vec::new());
        let shape = (tracks.xyz.nrows(), self.label.len());
        let mut is_full = Array2::from_elem(shape, false);
        let mut fill = |frames: &Range<usize>, track: usize| {
            frames.clone().for_each(|t| is_full[[t, track]] = true);
        };
        for (path, label) in of.iter().enumerate() {
            for fragment in tracks.fragments_of(path) {
                let (from, frames) = (fragment.track, fragment.frames.clone());
                let to = label.map_or(Some(from), |label| self.track[label]);
                match to {
                    Some(to) if label.is_some() || self.label[from].is_none() => {
                        fill(&frames, to);
                        if to != from {
                            moves.push(PointMove {
                                from,
                                to: Some(to),
                                frames,
                            });
                        }
                    }
                    _ => strays.push((from, frames)),
                }
            }
        }
        for (from, frames) in strays {
            let is_free = |track: &usize| {
                self.label[*track].is_none() && frames.clone().all(|t| !is_full[[t, *track]])
            };
            let to = (0..self.label.len()).find(is_free);
            if let Some(to) = to {
                frames.clone().for_each(|t| is_full[[t, to]] = true);
            }
            moves.push(PointMove { from, to, frames });
        }
        moves
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::point_at;

    #[test]
    fn pieces_go_to_their_labels_and_strays_elsewhere() {
        // Track 0 is label 1 in frames 0 to 29 and nothing from 40 on; track 1 is label 1 there;
        // track 2 is label 0 all along.
        let mut xyz = Array2::from_elem((60, 9), f64::NAN);
        for t in 0..60 {
            let mut put = |track: usize, at: f64| {
                (0..3).for_each(|c| xyz[[t, 3 * track + c]] = at + c as f64);
            };
            if !(30..40).contains(&t) {
                put(0, if t < 30 { 1.0 } else { 50.0 });
            }
            if t >= 40 {
                put(1, 1.0);
            }
            put(2, 9.0);
        }
        let run = 0..60;
        let tracks = LooseTracks::new(xyz.view(), std::slice::from_ref(&run), 10.0);
        let of = |path: usize| {
            let fragment = tracks.fragments_of(path).next().unwrap();
            match (fragment.track, fragment.frames.start) {
                (0, 40) => None,
                (2, _) => Some(0),
                _ => Some(1),
            }
        };
        let labels: PathLabels = (0..tracks.paths.len()).map(of).collect();
        assert_eq!(labels.len(), 4);
        let hosts = Hosts::new(&tracks, &labels, 2);
        let names = hosts.names(&["a".into(), "b".into()]);
        assert_eq!(names, [(2, "a".to_string()), (0, "b".to_string())]);
        let mut moved = xyz.clone();
        PointMove::make_all(&hosts.moves(&tracks, &labels), &mut moved);
        for t in 0..60 {
            let at = |track| point_at(moved.view(), t, track).x;
            match t {
                0..30 => assert_eq!((at(0), at(2)), (1.0, 9.0)),
                30..40 => assert!(at(0).is_nan() && at(1).is_nan()),
                _ => assert_eq!((at(0), at(1), at(2)), (1.0, 50.0, 9.0)),
            }
        }
    }
}
