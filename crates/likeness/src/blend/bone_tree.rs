//! Which points hang on which, measured: the tree in which the distances along branches vary
//! least. For a skeleton's joints these are the bones, for markers those of one segment.

use crate::clip::Clip;
use crate::pose::rotation::shortest_arc;
use crate::pose::similarity::{TransformKind, fit_similarity};
use glam::{DMat3, DQuat, DVec3};
use std::collections::VecDeque;

/// Frames of a clip that are measured, at most.
const MEASURED: usize = 200;
/// What a branch costs besides how it varies, a share of its length: of rigid ones the shortest
/// counts.
const LENGTH: f64 = 1e-3;

/// A tree of points.
#[derive(Debug, Clone)]
pub(super) struct BoneTree {
    /// The point that all hang on.
    pub root: usize,
    /// By point, what it hangs on; `None` for the root.
    parents: Vec<Option<usize>>,
    /// Points before those that hang on them.
    order: Vec<usize>,
}

impl BoneTree {
    /// The tree of the points of two clips, from `root` (Prim's algorithm).
    pub(super) fn new(clips: [&Clip; 2], root: usize) -> BoneTree {
        let count = clips[0].poses.points.len();
        let mut parents = vec![None; count];
        let mut cost = vec![f64::INFINITY; count];
        let mut is_in = vec![false; count];
        let mut order = Vec::new();
        let mut next = Some(root);
        while let Some(point) = next {
            is_in[point] = true;
            order.push(point);
            for other in (0..count).filter(|p| !is_in[*p]) {
                let own = clips.map(|clip| branch_cost(clip, point, other));
                // Points that are never seen together hang on the root.
                let own = f64::min(own[0].max(own[1]), 1e9);
                if own < cost[other] {
                    (cost[other], parents[other]) = (own, Some(point));
                }
            }
            let left = (0..count).filter(|p| !is_in[*p]);
            next = left.min_by(|a, b| cost[*a].total_cmp(&cost[*b]));
        }
        BoneTree {
            root,
            parents,
            order,
        }
    }

    /// Whether `point` is `above` or hangs on it, over others or not.
    pub(super) fn hangs_on(&self, point: usize, above: usize) -> bool {
        let mut at = Some(point);
        while let Some(p) = at.filter(|p| *p != above) {
            at = self.parents[p];
        }
        at.is_some()
    }

    /// The points that hang on `point` directly.
    pub(super) fn children(&self, point: usize) -> impl Iterator<Item = usize> {
        let parents = self.parents.iter().enumerate();
        parents
            .filter(move |(_, p)| **p == Some(point))
            .map(|(k, _)| k)
    }

    /// The pose between poses `a` and `b`, at the share `weight` from one to the other, with the
    /// root at the origin: what hangs on a point turns together about it, and lengths go from
    /// those of `a` to those of `b`. NaN where either lacks a point.
    pub(super) fn between(&self, a: &[DVec3], b: &[DVec3], weight: f64) -> Vec<DVec3> {
        let mut out = vec![DVec3::NAN; a.len()];
        out[self.root] = a[self.root] * 0.0 + b[self.root] * 0.0;
        let is_seen = |p: usize| a[p].is_finite() && b[p].is_finite();
        let mut queue = VecDeque::from(self.order.clone());
        while let Some(point) = queue.pop_front() {
            let seen: Vec<usize> = self.children(point).filter(|c| is_seen(*c)).collect();
            // Where a point is missing, what hangs on it hangs on the next above.
            let mut above = Some(point);
            while let Some(p) = above.filter(|p| !out[*p].is_finite()) {
                above = self.parents[p];
            }
            let Some(from) = above else {
                continue;
            };
            let offsets = |c: usize| (a[c] - a[from], b[c] - b[from]);
            let turn = match seen.len() {
                0 | 1 => None,
                _ => common_turn(seen.iter().map(|c| offsets(*c))),
            };
            for c in seen {
                let (own, other) = offsets(c);
                out[c] = out[from] + offset_between(own, other, turn, weight);
            }
        }
        out
    }
}

/// How much the distance of two points varies (its standard deviation, cm), and something for its
/// length.
fn branch_cost(clip: &Clip, p: usize, q: usize) -> f64 {
    let frames = clip.poses.frames();
    let step = frames.div_ceil(MEASURED).max(1);
    let length = |t: usize| (clip.point(t as isize, p) - clip.point(t as isize, q)).length();
    let lengths = (0..frames).step_by(step).map(length);
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    let lengths: Vec<f64> = lengths.filter(|l| l.is_finite()).collect();
    let first = lengths.first().copied().unwrap_or(0.0);
    for length in lengths {
        n += 1.0;
        sum += length - first;
        squares += (length - first).powi(2);
    }
    let mean = sum / n;
    (squares / n - mean * mean).max(0.0).sqrt() + LENGTH * (first + mean).abs()
}

/// The rotation that carries the first offsets to the second ones best; `None` where they leave it
/// open.
fn common_turn(offsets: impl Iterator<Item = (DVec3, DVec3)> + Clone) -> Option<DMat3> {
    let pairs = offsets.map(|(a, b)| (a, b, 1.0));
    let fit = fit_similarity(pairs, TransformKind::Rotation)?;
    fit.determined.then_some(fit.similarity.rotation)
}

/// An offset on its way from `a` to `b`: turned by a share of `turn`, and of what is left of the
/// way then.
fn offset_between(a: DVec3, b: DVec3, turn: Option<DMat3>, weight: f64) -> DVec3 {
    let turn = turn.unwrap_or(DMat3::IDENTITY);
    let part = |turn: DMat3| {
        DMat3::from_quat(DQuat::IDENTITY.slerp(DQuat::from_mat3(&turn).normalize(), weight))
    };
    let rest = turn.transpose() * b;
    let length = (1.0 - weight) * a.length() + weight * b.length();
    let direction = match shortest_arc(a, rest) {
        Some(arc) => part(arc) * a,
        None => a.lerp(rest, weight),
    };
    part(turn) * direction.normalize_or_zero() * length
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::tests::stroll;
    use crate::joint_map::joint;

    #[test]
    fn bones_keep_their_lengths_halfway_between_any_two_poses() {
        let clip = stroll(60, 30.0, 0.0);
        let tree = BoneTree::new([&clip, &clip], joint::HIP);
        let pose = |t: isize| (0..16).map(|p| clip.point(t, p)).collect::<Vec<_>>();
        let turned: Vec<DVec3> = pose(40)
            .into_iter()
            .map(|p| DMat3::from_rotation_x(1.0) * p)
            .collect();
        let between = tree.between(&pose(3), &turned, 0.4);
        assert_eq!(between[joint::HIP], DVec3::ZERO);
        for p in 0..16 {
            for c in tree.children(p) {
                let length = |pose: &[DVec3]| (pose[c] - pose[p]).length();
                let [a, b] = [&pose(3), &turned].map(|pose| length(pose));
                assert!((length(&between) - (0.6 * a + 0.4 * b)).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn what_hangs_on_a_missing_point_is_there_still() {
        let clip = stroll(60, 30.0, 0.0);
        let tree = BoneTree::new([&clip, &clip], joint::HIP);
        let pose: Vec<DVec3> = (0..16).map(|p| clip.point(5, p)).collect();
        let mut cut = pose.clone();
        cut[joint::LKNEE] = DVec3::NAN;
        let between = tree.between(&pose, &cut, 0.5);
        assert!(between[joint::LKNEE].is_nan());
        for p in (0..16).filter(|p| *p != joint::LKNEE) {
            let own = pose[p] - pose[joint::HIP];
            assert!((between[p] - own).length() < 1e-9, "{p}");
        }
    }
}
