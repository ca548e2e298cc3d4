//! Labels put right: exchanged ones back, fragments without a label joined, stretches away from a
//! point taken out.
//!
//! 1. Tracks are cut into fragments and these linked; exchanges between labels follow
//!    ([`fragments`], [`super::links`], [`super::identities`]), and which side of each is right
//!    ([`super::sides`]). That alone puts exchanges back.
//! 2. Fragments that are linked are a path. Each path, the best known ones aside, may move to a
//!    label that fits it far better, or to none ([`super::paths`]).
//!
//! No position changes. What is not sure stays as it was and is told.

use super::changes::{Change, ChangeKind};
use super::evidence::{Evidence, independent_frames};
use super::fragments::{Fragment, fragments};
use super::identities::exchanges;
use super::labeled_take::LabeledTake;
use super::links::Links;
use super::paths::Paths;
use super::sides::{Exchanged, SideBy, Sides, Unsure};
use super::tuning::repair::{FEWEST_FRAMES, MOST_FRAMES, MOST_WEIGHT, ROUNDS};
use crate::io::PointMove;
use crate::numeric::track_noise::LEAST_RATE;
use crate::pose::point_at;
use ndarray::Array2;

/// What becomes of the tracks of a take.
pub(crate) struct Repair {
    /// Every fragment, track after track, and the label that it is: its own where it stays.
    pub fragments: Vec<PointMove>,
    /// What decided which side of an exchange is right, by its labels.
    pub decided: Vec<(Vec<usize>, SideBy)>,
    pub unsure: Vec<Unsure>,
    /// The distances within the take as it is labeled then.
    pub evidence: Evidence,
    /// Where each label is then (frames, 3 L), cm.
    pub positions: Array2<f64>,
}

/// Puts the labels of a take right; `None` where most fragments are too short to say anything, or
/// so few frames a second were measured that no path leads from one to the next.
pub(crate) fn repair(take: LabeledTake<'_>) -> Option<Repair> {
    if take.rate < LEAST_RATE {
        return None;
    }
    let fragments = fragments(take.xyz, take.runs, take.rate);
    let short = fragments.iter().filter(|p| p.frames.len() < FEWEST_FRAMES);
    if 2 * short.count() > fragments.len() {
        return None;
    }
    let mut links = Links::new(take.xyz, &fragments, take.labels, take.rate);
    let found = exchanges(&fragments, &mut links.links, take.labels);
    let named = take.xyz.slice(ndarray::s![.., ..3 * take.labels]);
    let sides = if found.is_empty() {
        Sides::default()
    } else {
        take.sides(&found, named, &fragments)
    };
    let identity = |fragment: &Fragment| {
        if fragment.track < take.labels {
            Some(point_in(
                fragment.track,
                fragment.frames.start,
                &sides.exchanged,
            ))
        } else {
            None
        }
    };
    let identities: Vec<Option<usize>> = fragments.iter().map(identity).collect();
    links.close(|fragment| identities[fragment]);
    let mut paths = Paths::new(take, fragments, links.ends, identities);
    paths.join(&links.links);
    let unsure: Vec<usize> = sides.unsure.iter().flat_map(|u| u.labels.clone()).collect();
    paths.keep(&unsure);
    for round in 0..ROUNDS {
        if !paths.round(round) {
            break;
        }
    }
    let fragments = paths.assigned();
    let (evidence, positions) = paths.learned();
    Some(Repair {
        fragments,
        decided: sides.decided,
        unsure: sides.unsure,
        evidence,
        positions,
    })
}

impl Repair {
    /// How much likelier the positions that a change moves are as they are then than as they were,
    /// by the distances to other labels, nats. `xyz` are those of the tracks (frames, 3 N).
    pub(crate) fn nats(&self, change: &Change, xyz: &Array2<f64>, rate: f64) -> f64 {
        let of = |step: &PointMove| {
            let every = step.frames.len().div_ceil(MOST_FRAMES).max(1);
            let at = |label: usize, t: usize| {
                let position = point_at(xyz.view(), t, step.from);
                let positions = self.positions.view();
                self.evidence
                    .at(label, position, t, positions, &change.tracks)
                    .unwrap_or(0.0)
            };
            let labels = self.positions.ncols() / 3;
            let own = Some(step.from).filter(|from| *from < labels);
            let gain =
                |t: usize| step.to.map_or(0.0, |to| at(to, t)) - own.map_or(0.0, |l| at(l, t));
            let is_seen = |t: &usize| point_at(xyz.view(), *t, step.from).is_finite();
            let seen = step.frames.clone().step_by(every).filter(is_seen);
            let gains: Vec<f64> = seen.map(gain).collect();
            let mean = gains.iter().sum::<f64>() / gains.len().max(1) as f64;
            mean * independent_frames(step.frames.len(), rate).min(MOST_WEIGHT)
        };
        change.moves.iter().map(of).sum()
    }

    /// What decided which side of an exchange is right.
    pub(crate) fn side(&self, change: &Change) -> Option<SideBy> {
        if !matches!(change.kind, ChangeKind::Swap | ChangeKind::Cycle) {
            return None;
        }
        let mut labels = change.tracks.clone();
        labels.sort_unstable();
        let of = self.decided.iter().find(|(of, _)| *of == labels);
        of.map(|(_, by)| *by)
    }
}

/// The point whose positions a track has from a frame on.
fn point_in(track: usize, frame: usize, stretches: &[Exchanged]) -> usize {
    let mut point = track;
    // The last exchange that began comes off first.
    let then = stretches.iter().rev().filter(|s| s.frames.contains(&frame));
    for stretch in then {
        if let Some(k) = stretch.to.iter().position(|to| *to == point) {
            point = stretch.labels[k];
        }
    }
    point
}

#[cfg(test)]
mod tests {
    use super::super::changes::{changes, moves};
    use super::super::templates::Templates;
    use super::*;
    use glam::{DMat3, DVec3};
    use std::ops::Range;

    const FRAMES: usize = 900;
    const NAMES: [&str; 15] = [
        "LSHO", "LUPA", "LELB", "LFRM", "LWRA", "LWRB", "RSHO", "RUPA", "RELB", "RFRM", "RWRA",
        "RWRB", "CLAV", "STRN", "C7",
    ];

    /// Two arms that swing, each about its shoulder and its elbow, and a trunk.
    fn body() -> Array2<f64> {
        let mut xyz = Array2::zeros((FRAMES, 45));
        for t in 0..FRAMES {
            let time = t as f64 / 120.0;
            let trunk = DVec3::new(10.0 * time, 3.0 * (5.0 * time).sin(), 0.0);
            for side in 0..2 {
                let s = if side == 0 { 1.0 } else { -1.0 };
                let upper = DMat3::from_rotation_x(0.6 * (3.0 * time + s).sin());
                let lower = upper * DMat3::from_rotation_x(0.5 + 0.4 * (4.0 * time - s).sin());
                let shoulder = trunk + DVec3::new(18.0 * s, 140.0, 0.0);
                let elbow = shoulder + upper * DVec3::new(2.0 * s, -28.0, 0.0);
                let positions = [
                    shoulder,
                    shoulder + upper * DVec3::new(5.0 * s, -14.0, 2.0),
                    elbow,
                    elbow + lower * DVec3::new(3.0 * s, -12.0, 3.0),
                    elbow + lower * DVec3::new(3.0 * s, -24.0, 2.5),
                    elbow + lower * DVec3::new(-3.0 * s, -24.0, -2.5),
                ];
                for (k, position) in positions.into_iter().enumerate() {
                    set(&mut xyz, t, 6 * side + k, position);
                }
            }
            for (k, off) in [[0.0, 135.0, 9.0], [0.0, 118.0, 11.0], [0.0, 146.0, -8.0]]
                .into_iter()
                .enumerate()
            {
                set(&mut xyz, t, 12 + k, trunk + DVec3::from_array(off));
            }
        }
        for (i, v) in xyz.iter_mut().enumerate() {
            *v += 0.03 * (i as f64 * 12.9898).sin();
        }
        xyz
    }

    fn set(xyz: &mut Array2<f64>, t: usize, point: usize, position: DVec3) {
        (0..3).for_each(|c| xyz[[t, 3 * point + c]] = position[c]);
    }

    fn swap(xyz: &mut Array2<f64>, frames: Range<usize>, [a, b]: [usize; 2]) {
        for (t, c) in frames.flat_map(|t| (0..3).map(move |c| (t, c))) {
            xyz.swap([t, 3 * a + c], [t, 3 * b + c]);
        }
    }

    /// What is changed in a take of these tracks, and what is not sure; tracks beyond the names
    /// have no label.
    fn found(xyz: &Array2<f64>) -> (Vec<Change>, Vec<Unsure>) {
        let mut names: Vec<String> = NAMES.map(String::from).to_vec();
        names.extend((NAMES.len()..xyz.ncols() / 3).map(|n| format!("*{n}")));
        let run = 0..xyz.nrows();
        let repair = repair(LabeledTake {
            names: &names,
            labels: NAMES.len(),
            xyz: xyz.view(),
            runs: std::slice::from_ref(&run),
            rate: 120.0,
            person: "",
            like: &Templates::default(),
            body: None,
        })
        .unwrap();
        (
            changes(moves(&repair.fragments), NAMES.len()),
            repair.unsure,
        )
    }

    fn of(change: &Change) -> (ChangeKind, Range<usize>, Vec<usize>) {
        (change.kind, change.frames.clone(), change.tracks.clone())
    }

    #[test]
    fn a_take_that_is_right_stays() {
        assert_eq!(found(&body()), (vec![], vec![]));
    }

    #[test]
    fn exchanges_and_stretches_away_are_found_to_the_frame() {
        let mut xyz = body();
        swap(&mut xyz, 200..260, [4, 5]);
        // To the end of the take, and in a ring.
        swap(&mut xyz, 700..900, [10, 11]);
        swap(&mut xyz, 400..450, [1, 2]);
        swap(&mut xyz, 400..450, [2, 3]);
        for t in 300..330 {
            let position = point_at(xyz.view(), t, 8) + DVec3::new(9.0, 12.0, 5.0);
            set(&mut xyz, t, 8, position);
        }
        let (changes, unsure) = found(&xyz);
        let all: Vec<_> = changes.iter().map(of).collect();
        assert_eq!(unsure, []);
        assert_eq!(all[0], (ChangeKind::Swap, 200..260, vec![4, 5]));
        assert_eq!(all[1], (ChangeKind::Out, 300..330, vec![8]));
        assert_eq!((all[2].0, &all[2].1), (ChangeKind::Cycle, &(400..450)));
        assert_eq!(all[3], (ChangeKind::Swap, 700..900, vec![10, 11]));
        assert_eq!(all.len(), 4);
    }

    #[test]
    fn pieces_are_joined_and_reflections_are_not() {
        let truth = body();
        let mut xyz = Array2::from_elem((FRAMES, 51), f64::NAN);
        xyz.slice_mut(ndarray::s![.., ..45]).assign(&truth);
        for t in 240..420 {
            let position = point_at(truth.view(), t, 4);
            set(&mut xyz, t, 4, DVec3::NAN);
            if (246..415).contains(&t) {
                set(&mut xyz, t, 15, position);
            }
            set(&mut xyz, t, 16, position + DVec3::new(12.0, 7.0, 9.0));
        }
        let (changes, unsure) = found(&xyz);
        let all: Vec<_> = changes.iter().map(of).collect();
        assert_eq!(all, [(ChangeKind::Joined, 246..415, vec![15, 4])]);
        assert_eq!(unsure, []);
    }

    #[test]
    fn the_mirror_image_says_which_side_of_a_long_exchange_is_right() {
        for frames in [300..700, 100..650] {
            let mut xyz = body();
            swap(&mut xyz, frames.clone(), [2, 4]);
            let (changes, unsure) = found(&xyz);
            assert_eq!(unsure, []);
            let all: Vec<_> = changes.iter().map(of).collect();
            assert_eq!(all, [(ChangeKind::Swap, frames, vec![2, 4])]);
        }
        // Mirror images of each other say nothing; not even where another fragment is like the
        // rest.
        let mut xyz = body();
        swap(&mut xyz, 300..700, [4, 10]);
        let (changes, unsure) = found(&xyz);
        assert_eq!(changes, []);
        assert_eq!(unsure.len(), 1);
        assert_eq!(unsure[0].labels, [4, 10]);
    }

    /// A take in which a label is lost in some frames, and a track without one is at `place` of
    /// what it is then, in those frames but the first and the last.
    fn with_loose(
        truth: &Array2<f64>,
        label: usize,
        lost: Range<usize>,
        place: impl Fn(usize, DVec3) -> DVec3,
    ) -> Array2<f64> {
        let mut xyz = Array2::from_elem((FRAMES, truth.ncols() + 3), f64::NAN);
        xyz.slice_mut(ndarray::s![.., ..truth.ncols()])
            .assign(truth);
        for t in lost.clone() {
            let position = place(t, point_at(truth.view(), t, label));
            set(&mut xyz, t, label, DVec3::NAN);
            if t > lost.start && t + 1 < lost.end {
                set(&mut xyz, t, truth.ncols() / 3, position);
            }
        }
        xyz
    }

    #[test]
    fn what_closes_a_gap_at_both_ends_is_the_label_and_what_lies_beside_is_not() {
        // A marker that hangs loose swings away and back: no distance to it holds.
        let mut truth = body();
        for t in 280..360 {
            let share = (std::f64::consts::PI * (t as f64 - 280.0) / 80.0)
                .sin()
                .powi(2);
            let away = point_at(truth.view(), t, 3) + 25.0 * share * DVec3::new(1.0, 0.5, -1.0);
            set(&mut truth, t, 3, away);
        }
        let closed = with_loose(&truth, 3, 300..340, |_, position| position);
        let (changes, unsure) = found(&closed);
        let all: Vec<_> = changes.iter().map(of).collect();
        assert_eq!(all, [(ChangeKind::Joined, 301..339, vec![15, 3])]);
        assert_eq!(unsure, []);
        // As long, and as still beside the marker as a reflection.
        let beside = |_, position| position + DVec3::new(3.0, 4.0, -3.0);
        let (changes, unsure) = found(&with_loose(&truth, 3, 300..340, beside));
        assert_eq!((changes, unsure), (vec![], vec![]));
    }

    #[test]
    fn a_label_goes_on_in_its_own_track_and_not_in_its_neighbor_s_a_frame_earlier() {
        // Two markers at rest, 4 cm apart; the track of one begins where the other's label ends.
        let mut truth = body();
        for t in 0..FRAMES {
            let rest = DVec3::new(0.0, 130.0, 9.0) + 0.02 * (t as f64).sin();
            set(&mut truth, t, 12, rest);
            set(&mut truth, t, 13, rest - 4.0 * DVec3::Y);
        }
        let xyz = with_loose(&truth, 12, 299..340, |_, position| position);
        let mut xyz = with_loose(&xyz, 13, 300..341, |_, position| position);
        set(&mut xyz, 339, 15, DVec3::NAN);
        let (changes, unsure) = found(&xyz);
        let all: Vec<_> = changes.iter().map(of).collect();
        let joined = |frames, tracks| (ChangeKind::Joined, frames, tracks);
        assert_eq!(
            all,
            [
                joined(300..339, vec![15, 12]),
                joined(301..340, vec![16, 13])
            ]
        );
        assert_eq!(unsure, []);
    }

    fn lose(xyz: &mut Array2<f64>, frames: Range<usize>, points: &[usize]) {
        for (t, p) in frames.flat_map(|t| points.iter().map(move |p| (t, *p))) {
            set(xyz, t, p, DVec3::NAN);
        }
    }

    #[test]
    fn an_exchange_ends_in_a_gap_where_the_distances_say_so() {
        for (labels, gap) in [(vec![1, 2], 600..630), (vec![1, 2, 3], 270..300)] {
            let mut right = body();
            lose(&mut right, gap, &labels);
            assert_eq!(found(&right), (vec![], vec![]));
            let mut xyz = right.clone();
            for pair in labels.windows(2) {
                swap(&mut xyz, 300..600, [pair[0], pair[1]]);
            }
            let (changes, unsure) = found(&xyz);
            assert_eq!(unsure, []);
            let all: Vec<_> = changes
                .iter()
                .map(|c| (c.frames.clone(), c.tracks.len()))
                .collect();
            assert_eq!(all, [(300..600, labels.len())]);
            changes
                .iter()
                .for_each(|c| PointMove::make_all(&c.moves, &mut xyz));
            let is_same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
            assert!(xyz.iter().zip(&right).all(is_same));
        }
    }

    #[test]
    fn an_exchange_whose_end_nobody_sees_moves_nothing() {
        // From one frame to the next it ends while the labels are at one position.
        let mut xyz = body();
        for (t, k) in (560..640).flat_map(|t| [0, 1].map(|k| (t, k))) {
            let share = (1.0 - (t as f64 - 600.0).abs() / 40.0).clamp(0.0, 1.0);
            let [own, other] = [k, 1 - k].map(|k| point_at(body().view(), t, 1 + k));
            set(&mut xyz, t, 1 + k, own.lerp(other, 0.5 * share));
        }
        assert_eq!(found(&xyz).1, []);
        swap(&mut xyz, 250..600, [1, 2]);
        let (changes, unsure) = found(&xyz);
        assert_eq!(changes, []);
        assert_eq!(unsure.len(), 1);
        assert_eq!(unsure[0].labels, [1, 2]);
    }
}
