//! Rotations of a source carried to a rig.
//!
//! `G'_j = G_s Q_j` for a rig's joint j that follows a source's joint s, G global rotations. With
//! the global rotations R and R' of both rest poses, `Q_j = Rᵀ A R'`, and A carries the rig's rest
//! pose to the source's: `A = B` for pelvis, spine and head, B by the line of the hips or of the
//! shoulders; `A = swing(B d', d) B` for a bone of a limb, d and d' its directions in both rest
//! poses. So the direction of each limb is the source's to the digit. Chains of other numbers of
//! joints are blended along their index; a joint that follows nothing keeps its rest pose. Feet may
//! turn by how they stand instead (`soles`).

use super::figure::Figure;
use super::hierarchy::{Hierarchy, Pose};
use super::rest::between;
use super::segments::BodyJoints;
use super::shape::Limb;
use super::soles::Sole;
use crate::pose::rotation::shortest_arc;
use glam::{DMat3, DQuat, DVec3};

/// What a rig's joint follows: a source's joint, or two blended; each with its Q.
struct Follow {
    from: (usize, DMat3),
    to: (usize, DMat3),
    share: f64,
    /// Where other joints or a changing length lie on the source's bone: its end, and its rest
    /// direction in the joint's frame.
    aim: Option<(usize, DVec3)>,
}

/// What each joint of a rig follows.
pub(super) struct Transfer {
    follows: Vec<Option<Follow>>,
    /// By joint, its rest rotation in its parent's frame.
    locals: Vec<DMat3>,
    /// By joint, its A.
    carried: Vec<Option<DMat3>>,
}

impl Transfer {
    /// What each joint of `rig` follows of `source`; with `is_same`, both have the same joints, and
    /// each follows its own.
    pub(super) fn new(source: Figure, rig: Figure, is_same: bool) -> Transfer {
        let rotations = &rig.rest.pose.rotations;
        let local = |(j, parent): (usize, &Option<usize>)| match parent {
            Some(p) => rotations[*p].transpose() * rotations[j],
            None => rotations[j],
        };
        let mut out = Transfer {
            follows: (0..rig.tree.len()).map(|_| None).collect(),
            locals: rig.tree.parents.iter().enumerate().map(local).collect(),
            carried: vec![None; rig.tree.len()],
        };
        let [lower, upper] = between([source.rest, rig.rest], [source.body, rig.body]);
        out.trunk([source, rig], [lower, upper]);
        for (s, r) in source.body.legs.iter().zip(&rig.body.legs) {
            out.limb([source, rig], [s, r], lower);
            let ends = s.end.zip(r.end);
            out.bone([source, rig], [s.joints[2], r.joints[2]], ends, lower);
            if let Some((s, r)) = ends {
                out.follow([source, rig], (s, lower), (s, lower), 0.0, r);
            }
        }
        if let (Some(s), Some(r)) = (&source.body.arms, &rig.body.arms) {
            for (s, r) in s.iter().zip(r) {
                out.limb([source, rig], [s, r], upper);
                out.hand([source, rig], [s, r]);
            }
        }
        out.same_names([source, rig], lower, is_same);
        out
    }

    /// Lets a rig's feet and toes turn as the source's do, relative to how each stands: by the
    /// soles of source and rig, left and right.
    pub(super) fn stand(&mut self, bodies: [&BodyJoints; 2], soles: &[Option<[Sole; 2]>; 2]) {
        for (side, soles) in soles.iter().enumerate() {
            let Some([of_source, of_rig]) = soles else {
                continue;
            };
            let [source, rig] = bodies.map(|body| &body.legs[side]);
            let feet = [source.joints[2], rig.joints[2]];
            let toes = source.end.zip(rig.end).map(|(s, r)| [s, r]);
            for (n, [s, r]) in std::iter::once(feet).chain(toes).enumerate() {
                let q = of_source.axes[n] * of_rig.axes[n].transpose();
                if let Some(follow) = &mut self.follows[r] {
                    (follow.from, follow.to) = ((s, q), (s, q));
                }
            }
        }
    }

    /// Lets joint `r` of the rig follow the source's joints `from` and `to`, each with its A.
    fn follow(
        &mut self,
        [source, rig]: [Figure; 2],
        from: (usize, DMat3),
        to: (usize, DMat3),
        share: f64,
        r: usize,
    ) {
        let q = |(s, a): (usize, DMat3)| {
            let rest = source.rest.pose.rotations[s].transpose();
            (s, rest * a * rig.rest.pose.rotations[r])
        };
        self.carried[r] = Some(if share > 0.5 { to.1 } else { from.1 });
        self.follows[r] = Some(Follow {
            from: q(from),
            to: q(to),
            share,
            aim: None,
        });
    }

    /// Blends a chain of the source along the index of the rig's. The first of each is what they
    /// hang on; `a` tells the A of the rig's joint for the source's n-th.
    fn chain(
        &mut self,
        figures: [Figure; 2],
        [source, rig]: [&[usize]; 2],
        a: impl Fn(usize, usize) -> DMat3,
    ) {
        let (n, m) = (source.len() - 1, rig.len() - 1);
        for (i, &r) in rig.iter().enumerate().skip(1).filter(|_| n > 0) {
            let at = (i * n) as f64 / m as f64;
            let (low, high) = ((i * n) / m, (i * n).div_ceil(m));
            let one = |k: usize| (source[k], a(k, r));
            self.follow(figures, one(low), one(high), at - low as f64, r);
        }
    }

    /// Pelvis, spine, neck and collars.
    fn trunk(&mut self, figures: [Figure; 2], [lower, upper]: [DMat3; 2]) {
        let [source, rig] = figures.map(|f| f.body);
        let pelvis = (source.pelvis, lower);
        let base = match (source.chest, rig.chest) {
            (Some(s), Some(r)) if r == rig.base => (s, upper),
            _ => pelvis,
        };
        self.follow(figures, base, base, 0.0, rig.base);
        self.follow(figures, pelvis, pelvis, 0.0, rig.pelvis);
        let (Some(s_chest), Some(r_chest)) = (source.chest, rig.chest) else {
            return;
        };
        let from = |first: usize, path: Vec<usize>| [vec![first], path].concat();
        let spine = from(source.pelvis, figures[0].tree.path(source.base, s_chest));
        let n = (spine.len() - 1).max(1) as f64;
        let r_spine = from(rig.pelvis, figures[1].tree.path(rig.base, r_chest));
        self.chain(figures, [&spine, &r_spine], |k, _| {
            blend(lower, upper, k as f64 / n)
        });
        let to = |figure: Figure, joint: usize, chest: usize| {
            let tree = figure.tree;
            from(tree.common(chest, joint), tree.path(chest, joint))
        };
        if let (Some(s), Some(r)) = (source.head, rig.head) {
            let [s, r] = [to(figures[0], s, s_chest), to(figures[1], r, r_chest)];
            self.chain(figures, [&s, &r], |_, _| upper);
        }
        if let (Some(s), Some(r)) = (&source.arms, &rig.arms) {
            for (s, r) in s.iter().zip(r) {
                let s = to(figures[0], s.joints[0], s_chest);
                let r = to(figures[1], r.joints[0], r_chest);
                let [s, r] = [&s[..s.len() - 1], &r[..r.len() - 1]];
                if !s.is_empty() && !r.is_empty() {
                    self.chain(figures, [s, r], |_, _| upper);
                }
            }
        }
    }

    /// The two long bones of a limb.
    fn limb(&mut self, figures: [Figure; 2], [s, r]: [&Limb; 2], b: DMat3) {
        for n in 0..2 {
            let ends = Some((s.joints[n + 1], r.joints[n + 1]));
            self.bone(figures, [s.joints[n], r.joints[n]], ends, b);
        }
    }

    /// A bone that has the source's direction, where both have ends.
    fn bone(
        &mut self,
        figures: [Figure; 2],
        [s, r]: [usize; 2],
        ends: Option<(usize, usize)>,
        b: DMat3,
    ) {
        let directions = ends.and_then(|(s_end, r_end)| {
            let d = figures[0].direction(s, Some(s_end))?;
            Some((d, figures[1].direction(r, Some(r_end))?))
        });
        let swing = directions.and_then(|(d, rig)| shortest_arc(b * rig, d));
        let a = swing.map_or(b, |swing| swing * b);
        self.follow(figures, (s, a), (s, a), 0.0, r);
        let aim = directions.zip(ends).map(|((d, _), (end, _))| {
            let local = figures[0].rest.pose.rotations[s].transpose() * d;
            (end, local)
        });
        if let Some(follow) = &mut self.follows[r] {
            follow.aim = aim;
        }
    }

    /// A hand, which turns with the forearm where nothing tells its direction.
    fn hand(&mut self, figures: [Figure; 2], [s, r]: [&Limb; 2]) {
        let forearm = self.carried[r.joints[1]].unwrap_or(DMat3::IDENTITY);
        let [source, rig] = figures;
        let (s_hand, r_hand) = (source.hand(s), rig.hand(r));
        let direction = |figure: Figure, hand: &[usize], limb: &Limb, joint: usize| {
            let next = hand
                .iter()
                .position(|&j| j == joint)
                .and_then(|n| hand.get(n + 1));
            let end = limb.end.filter(|&end| end != joint);
            figure.direction(joint, next.copied().or(end))
        };
        let (s_chain, r_chain) = (
            [vec![s.joints[1]], s_hand.clone()].concat(),
            [vec![r.joints[1]], r_hand.clone()].concat(),
        );
        let a = |k: usize, j: usize| {
            let s_joint = s_chain[k];
            let d = direction(source, &s_hand, s, s_joint).filter(|_| k > 0);
            let swing = d
                .zip(direction(rig, &r_hand, r, j))
                .and_then(|(d, rig)| shortest_arc(forearm * rig, d));
            swing.map_or(forearm, |swing| swing * forearm)
        };
        self.chain(figures, [&s_chain, &r_chain], a);
    }

    /// Fingers of one name in both follow each other, and so do all joints with `is_same`.
    fn same_names(&mut self, figures: [Figure; 2], lower: DMat3, is_same: bool) {
        let [source, rig] = figures;
        for r in 0..rig.tree.len() {
            let mut arms = rig.body.arms.iter().flatten();
            let hangs = arms.any(|arm| rig.tree.is_below(r, arm.joints[2]));
            let above = match rig.tree.parents[r] {
                Some(parent) => self.carried[parent].filter(|_| hangs || is_same),
                None => Some(lower).filter(|_| is_same),
            };
            let Some(above) = above.filter(|_| self.follows[r].is_none()) else {
                continue;
            };
            let own = &rig.body.bare_names[r];
            let Some(s) = source.body.bare_names.iter().position(|name| name == own) else {
                continue;
            };
            let directions = source.direction(s, None).zip(rig.direction(r, None));
            let swing = directions.and_then(|(d, rig)| shortest_arc(above * rig, d));
            let a = swing.map_or(above, |swing| swing * above);
            self.follow(figures, (s, a), (s, a), 0.0, r);
        }
    }

    /// Whether a joint follows nothing.
    pub(super) fn rests(&self, joint: usize) -> bool {
        self.follows[joint].is_none()
    }

    /// The joints that follow nothing.
    pub(super) fn resting(&self) -> usize {
        (0..self.follows.len()).filter(|j| self.rests(*j)).count()
    }

    /// The joint's rotation at rest in its parent's frame.
    pub(super) fn rest_local(&self, joint: usize) -> DMat3 {
        self.locals[joint]
    }

    /// The global rotation of a rig's joint in a frame of the source; `None`: it keeps its rest.
    pub(super) fn rotation(&self, joint: usize, source: &Pose) -> Option<DMat3> {
        let follow = self.follows[joint].as_ref()?;
        let global = |(s, q): (usize, DMat3)| source.rotations[s] * q;
        let rotation = if follow.share > 0.0 {
            blend(global(follow.from), global(follow.to), follow.share)
        } else {
            global(follow.from)
        };
        let aimed = follow.aim.and_then(|(end, local)| {
            let s = follow.from.0;
            let now = source.positions[end] - source.positions[s];
            shortest_arc(source.rotations[s] * local, now)
        });
        Some(aimed.map_or(rotation, |swing| swing * rotation))
    }

    /// The joints of the source on which a rig's joint's rotation in its parent's frame depends:
    /// what hangs above all of them cancels out.
    pub(super) fn needed(&self, joint: usize, [source, rig]: [&Hierarchy; 2]) -> Vec<usize> {
        if self.follows[joint].is_none() {
            return Vec::new();
        }
        let above = rig.parents[joint].map(|p| rig.upwards(p));
        let above = above.and_then(|mut above| above.find_map(|j| self.follows[j].as_ref()));
        let joints_of = |follow: &Follow| {
            let on_bone = follow.aim.and_then(|(end, _)| source.parents[end]);
            [Some(follow.from.0), Some(follow.to.0), on_bone]
        };
        let own = self.follows[joint].as_ref();
        let joints = own.into_iter().chain(above).flat_map(joints_of).flatten();
        let ways: Vec<Vec<usize>> = joints.map(|j| source.upwards(j).collect()).collect();
        let is_common = |j: &usize| above.is_some() && ways.iter().all(|way| way.contains(j));
        let mut needed: Vec<usize> = ways.iter().flatten().copied().collect();
        needed.retain(|j| !is_common(j));
        needed.sort_unstable();
        needed.dedup();
        needed
    }
}

/// The rotation at a share of the way between two.
fn blend(a: DMat3, b: DMat3, share: f64) -> DMat3 {
    let [a, b] = [a, b].map(|r| DQuat::from_mat3(&r));
    DMat3::from_quat(a.slerp(b, share))
}
