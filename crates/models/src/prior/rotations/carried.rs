//! The prior carried from CMU's bones to the joints of another skeleton, with another rest pose and
//! another number of bones in the spine.
//!
//! Each joint b is oriented as one bone o of CMU's: that which ends at the nearest of CMU's points
//! that b moves. Q_b turns the direction of b in its rest pose to that of the bone in CMU's, so
//! that G_b = G_o Q_b, and with p the joint above b, L_b = Q_pᵀ (G_o(p)ᵀ G_o(b)) Q_b. Small
//! rotations of CMU's bones add up on the way from o(p) to o(b), which carries the covariance.

use super::bones::CENTRAL;
use super::tuning::*;
use super::{BONES, RotationPrior, is_free};
use crate::pose::Skeleton;
use crate::pose::joints::{CMU, CMU_PARENT, CMU_REST};
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{frame_along, shortest_arc};
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// Shorter than this, cm, a bone has no direction.
const NO_LENGTH: f64 = 1e-9;

/// Means and covariance of the rotations of a skeleton's joints.
#[doc(hidden)]
#[derive(Debug, Clone)]
pub struct JointPrior {
    /// The bones that turn below the root.
    pub bones: Vec<usize>,
    /// The mean rotation of each against the nearest of them above, or the root.
    pub means: Vec<DMat3>,
    /// Covariance of the rotation vectors from the means, in the axes of the bone above, (3 bones,
    /// 3 bones), squared radians.
    pub covariance: Array2<f64>,
}

/// Where a skeleton shows points of CMU's: (bone at whose end the point is, index among
/// [`CMU`]).
pub(crate) type CmuPoints<'a> = &'a [(usize, usize)];

impl JointPrior {
    /// The prior of the joints of `skeleton` below the bone `root`, at which the pelvis turns.
    pub fn new(
        prior: &RotationPrior,
        skeleton: &Skeleton,
        root: usize,
        points: CmuPoints<'_>,
    ) -> JointPrior {
        let joints = Joints::new(skeleton, root, points);
        let mean_pose = MeanPose::new(prior);
        let turn = joints.facing();
        let mut oriented: Vec<Option<Orientation>> = vec![None; skeleton.bones().len()];
        oriented[root] = Some(Orientation::root(turn));
        for &bone in &joints.turning {
            let above = oriented[joints.above(bone)].unwrap_or(Orientation::root(turn));
            let own = joints.segment(bone, above.bone).and_then(|segment| {
                let direction = joints.direction(bone)?;
                mean_pose.orientation(&segment, turn * direction, turn)
            });
            oriented[bone] = Some(own.unwrap_or(Orientation {
                is_own: false,
                ..above
            }));
        }
        let of = |bone: usize| oriented[bone].unwrap_or(Orientation::root(turn));
        let pairs = joints.turning.iter().map(|&b| (of(joints.above(b)), of(b)));
        let pairs: Vec<(Orientation, Orientation)> = pairs.collect();
        let means = pairs
            .iter()
            .map(|(above, own)| above.ours().transpose() * own.ours());
        let means = means.collect();
        let mut covariance = mean_pose.carried_covariance(prior, &pairs);
        for (n, &bone) in joints.turning.iter().enumerate() {
            let floor = joints.floor(bone, &pairs[n]);
            let mut block = covariance.slice_mut(ndarray::s![3 * n..3 * n + 3, 3 * n..3 * n + 3]);
            for ((i, j), value) in block.indexed_iter_mut() {
                *value += floor.col(j)[i];
            }
        }
        JointPrior {
            bones: joints.turning,
            means,
            covariance,
        }
    }
}

/// The bone of CMU's by which a joint is oriented.
#[derive(Debug, Clone, Copy)]
struct Orientation {
    bone: usize,
    /// Q: what turns the joint's rest pose to that of the bone.
    turn: DMat3,
    /// The bone's global rotation in the mean pose.
    global: DMat3,
    /// Whether points tell of this joint; else it is oriented as the one above.
    is_own: bool,
}

impl Orientation {
    fn root(turn: DMat3) -> Orientation {
        let (global, is_own) = (DMat3::IDENTITY, true);
        Orientation {
            bone: 0,
            turn,
            global,
            is_own,
        }
    }

    /// The joint's own global rotation in the mean pose.
    fn ours(&self) -> DMat3 {
        self.global * self.turn
    }
}

/// Bones of CMU's, one below the other, that one joint stands for.
struct Segment {
    /// From the first to the last.
    bones: Vec<usize>,
    /// The points at its end; of several the middle counts.
    ends: Vec<usize>,
}

/// CMU's body with all rotations at their mean.
struct MeanPose {
    rotations: [DMat3; BONES],
    ends: [DVec3; BONES],
}

impl MeanPose {
    fn new(prior: &RotationPrior) -> MeanPose {
        let mut pose = MeanPose {
            rotations: [DMat3::IDENTITY; BONES],
            ends: [DVec3::ZERO; BONES],
        };
        for b in 1..BONES {
            let above = CMU_PARENT[b];
            pose.rotations[b] = pose.rotations[above] * prior.mean[b];
            pose.ends[b] = pose.ends[above] + pose.rotations[b] * (rest(b) - rest(above));
        }
        pose
    }

    /// The orientation of a joint that stands for a segment and points along `direction` in its
    /// rest pose, turned by `turn` to face as CMU's does; `None` where there is no direction.
    fn orientation(&self, segment: &Segment, direction: DVec3, turn: DMat3) -> Option<Orientation> {
        let (&first, &bone) = (segment.bones.first()?, segment.bones.last()?);
        let start = CMU_PARENT[first];
        let middle = |at: &dyn Fn(usize) -> DVec3| {
            segment.ends.iter().map(|&e| at(e)).sum::<DVec3>() / segment.ends.len() as f64
        };
        let at_rest = middle(&rest) - rest(start);
        let in_mean = middle(&|e| self.ends[e]) - self.ends[start];
        // A segment of several bones lies along its chord, and turns as its last bone does.
        let bend = shortest_arc(self.rotations[bone] * at_rest, in_mean)?;
        let swing = shortest_arc(direction, at_rest)?;
        // How a rig's neck leans at rest is where its maker put the joints, not how the head is
        // held.
        let is_lean = is_trunk(bone) && direction.angle_between(at_rest) < LEAN.to_radians();
        Some(Orientation {
            bone,
            turn: if is_lean { turn } else { swing * turn },
            global: bend * self.rotations[bone],
            is_own: true,
        })
    }

    /// B Σ Bᵀ: the covariance of the rotations between pairs of orientations, each in the axes of
    /// its first.
    fn carried_covariance(
        &self,
        prior: &RotationPrior,
        pairs: &[(Orientation, Orientation)],
    ) -> Array2<f64> {
        let mut b = Array2::zeros((3 * pairs.len(), 3 * BONES));
        for (n, (above, own)) in pairs.iter().enumerate() {
            let back = above.ours().transpose();
            let (up, down) = (path(above.bone), path(own.bone));
            let differ = |from: &[usize], other: &[usize]| -> Vec<usize> {
                from.iter()
                    .copied()
                    .filter(|k| !other.contains(k))
                    .collect()
            };
            let lost = differ(&up, &down).into_iter().map(|k| (k, -1.0));
            let gained = differ(&down, &up).into_iter().map(|k| (k, 1.0));
            for (k, sign) in lost.chain(gained).filter(|(k, _)| is_free(*k)) {
                let carried = back * self.rotations[CMU_PARENT[k]] * sign;
                for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                    b[[3 * n + i, 3 * k + j]] = carried.col(j)[i];
                }
            }
        }
        b.dot(&prior.covariance).dot(&b.t())
    }
}

/// The joints of a skeleton, and the points of CMU's that they move.
struct Joints<'a> {
    skeleton: &'a Skeleton,
    root: usize,
    points: CmuPoints<'a>,
    rest: Posture,
    /// The bones that turn below the root, parents first.
    turning: Vec<usize>,
    /// By bone, the nearest points of CMU's that it moves, as (bone at whose end, index).
    moved: Vec<Vec<(usize, usize)>>,
}

impl<'a> Joints<'a> {
    fn new(skeleton: &'a Skeleton, root: usize, points: CmuPoints<'a>) -> Joints<'a> {
        let bones = skeleton.bones();
        let dofs = bones.iter().flat_map(|b| &b.dofs);
        let rest = skeleton.posture(&dofs.map(|d| -d.offset).collect::<Vec<f64>>());
        let turns = |b: &usize| bones[*b].dofs.iter().any(|d| d.channel.is_angle());
        let below_root = |b: &usize| {
            std::iter::successors(bones[*b].parent, |&b| bones[b].parent).any(|b| b == root)
        };
        let turning = (0..bones.len()).filter(turns).filter(below_root).collect();
        let mut children = vec![Vec::new(); bones.len()];
        for (i, bone) in bones.iter().enumerate() {
            bone.parent.into_iter().for_each(|p| children[p].push(i));
        }
        let of = |b| moved(&children, &rest, points, b);
        let moved = (0..bones.len()).map(|b| if turns(&b) { of(b) } else { Vec::new() });
        let moved = moved.collect();
        Joints {
            skeleton,
            root,
            points,
            rest,
            turning,
            moved,
        }
    }

    /// The nearest bone above that turns, or the root.
    fn above(&self, bone: usize) -> usize {
        let bones = self.skeleton.bones();
        let mut up = std::iter::successors(bones[bone].parent, |&b| bones[b].parent);
        up.find(|b| self.turning.contains(b)).unwrap_or(self.root)
    }

    /// Of the nearest points that a joint moves, those that orient it: the neck of a trunk, both
    /// shoulders where it has none, else the first.
    fn main(&self, bone: usize) -> Vec<(usize, usize)> {
        let moved = &self.moved[bone];
        let named = |names: &[&str]| -> Vec<(usize, usize)> {
            let is_named = |(_, p): &&(usize, usize)| names.contains(&CMU[*p]);
            moved.iter().filter(is_named).copied().collect()
        };
        let neck = named(&["thorax", "lowerneck"]);
        let shoulders = named(&["lclavicle", "rclavicle"]);
        match (neck.first(), shoulders.len()) {
            (Some(first), _) => vec![*first],
            (None, 2) => shoulders,
            _ => moved.first().copied().into_iter().collect(),
        }
    }

    /// The joints in a row, this one among them, that move the same points: a spine of any number.
    fn row(&self, bone: usize) -> (usize, usize) {
        let main = self.main(bone);
        let same = |b: &usize| self.turning.contains(b) && self.main(*b) == main;
        let up = std::iter::successors(Some(bone), |&b| Some(self.above(b)).filter(same));
        let before = up.count() - 1;
        let next = |&b: &usize| {
            self.turning
                .iter()
                .copied()
                .find(|&t| self.above(t) == b && self.main(t) == main)
        };
        (
            before,
            before + std::iter::successors(Some(bone), next).count(),
        )
    }

    /// The bones that a joint stands for below one that is oriented as bone `above` of CMU's.
    fn segment(&self, bone: usize, above: usize) -> Option<Segment> {
        let main = self.main(bone);
        let ends: Vec<usize> = main.iter().map(|m| m.1).collect();
        let last = match ends[..] {
            [] => return None,
            [one] => one,
            // Between the shoulders.
            _ => CMU_PARENT[ends[0]],
        };
        let (at, count) = self.row(bone);
        // The joints of the row above this one stand for the first bones already.
        let known = path(above);
        let mut chain = path(last);
        chain.retain(|b| !known.contains(b));
        // A hip joint is rigid with the root: what stands for more than that turns below it.
        if chain.iter().any(|b| is_free(*b)) {
            chain.retain(|b| is_free(*b));
        }
        let share = chain.len().div_ceil(count - at);
        let bones: Vec<usize> = chain.iter().copied().take(share).collect();
        let ends = if bones.len() == chain.len() {
            ends
        } else {
            bones.last().copied().into_iter().collect()
        };
        Some(Segment { bones, ends })
    }

    /// Where a joint points in the rest pose: to the joint that goes on with its row, else to the
    /// points that orient it.
    fn direction(&self, bone: usize) -> Option<DVec3> {
        let main = self.main(bone);
        let start = self.rest.starts[bone];
        let next = |t: &&usize| self.above(**t) == bone && self.main(**t) == main;
        let next = self
            .turning
            .iter()
            .find(next)
            .map(|&t| self.rest.starts[t] - start);
        let to_points = || {
            let ends = main.iter().map(|m| self.rest.ends[m.0]).sum::<DVec3>();
            ends / main.len() as f64 - start
        };
        let direction = next
            .filter(|d| d.length() > NO_LENGTH)
            .unwrap_or_else(to_points);
        (direction.length() > NO_LENGTH).then_some(direction)
    }

    /// What turns the skeleton's rest pose to face as CMU's does: left hip to x, up to y. The
    /// identity where its points tell no facing.
    fn facing(&self) -> DMat3 {
        let at = |name: &str| {
            let point = self.points.iter().find(|(_, p)| CMU[*p] == name)?;
            Some(self.rest.ends[point.0])
        };
        let frame = |[left, right, l, r]: [Option<DVec3>; 4]| {
            let (left, right) = (left?, right?);
            frame_along(left - right, (l? + r?) / 2.0 - (left + right) / 2.0)
        };
        let names = ["lhipjoint", "rhipjoint", "lclavicle", "rclavicle"];
        let cmu = |name: &str| CMU.iter().position(|c| *c == name).map(rest);
        match (frame(names.map(at)), frame(names.map(cmu))) {
            (Some(own), Some(cmu)) => cmu * own.transpose(),
            _ => DMat3::IDENTITY,
        }
    }

    /// The variance that a joint has beside the carried one, in the axes of the joint above.
    fn floor(&self, bone: usize, (above, own): &(Orientation, Orientation)) -> DMat3 {
        let square = |degrees: f64| degrees.to_radians().powi(2);
        let all = |degrees: f64| DMat3::from_diagonal(DVec3::splat(square(degrees)));
        if self.points.iter().all(|(b, _)| *b == self.root) {
            return all(NO_BODY);
        }
        if !own.is_own {
            return all(UNKNOWN);
        }
        let name = CMU[own.bone];
        // A hand's bend: about all axes but the forearm's.
        if name.ends_with("wrist") && above.bone == CMU_PARENT[own.bone] {
            let along = self
                .direction(self.above(bone))
                .unwrap_or(DVec3::X)
                .normalize();
            let twist = DMat3::from_cols(along * along.x, along * along.y, along * along.z);
            return all(FLOOR) + (DMat3::IDENTITY - twist) * square(HAND_BEND);
        }
        if name.ends_with("clavicle") && self.skeleton.bones()[bone].name != name {
            all(COLLAR)
        } else {
            all(FLOOR)
        }
    }
}

/// The nearest points of CMU's that a bone moves by turning.
fn moved(
    children: &[Vec<usize>],
    rest: &Posture,
    points: CmuPoints<'_>,
    bone: usize,
) -> Vec<(usize, usize)> {
    let (start, mut found, mut open) = (rest.starts[bone], Vec::new(), vec![bone]);
    while let Some(at) = open.pop() {
        let point = points.iter().find(|(b, _)| *b == at);
        match point.filter(|_| (rest.ends[at] - start).length() > NO_LENGTH) {
            Some(point) => found.push(*point),
            None => open.extend(&children[at]),
        }
    }
    found.sort_unstable();
    found
}

/// The bones of CMU's from the root to one of them.
fn path(bone: usize) -> Vec<usize> {
    let up = std::iter::successors(Some(bone), |&b| (b != 0).then_some(CMU_PARENT[b]));
    let mut path: Vec<usize> = up.collect();
    path.reverse();
    path
}

/// Whether a bone of CMU's is one of the back, the neck or the head.
fn is_trunk(bone: usize) -> bool {
    CENTRAL.contains(&CMU[bone])
}

/// The end of a bone of CMU's in the rest pose, cm from the root.
fn rest(bone: usize) -> DVec3 {
    DVec3::from_array(CMU_REST[bone])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::{Axis, from_rotation_vector, rotation_vector};
    use crate::pose::{Bone, Channel, Dof};

    /// CMU's bones, those of `wanted`, turned by `turn` as a whole; each turns and has a length.
    fn skeleton(wanted: &dyn Fn(usize) -> bool, turn: DMat3) -> (Skeleton, Vec<(usize, usize)>) {
        let kept: Vec<usize> = (0..BONES).filter(|b| wanted(*b)).collect();
        let parent = |b: usize| {
            let mut up = std::iter::successors(Some(CMU_PARENT[b]), |&b| Some(CMU_PARENT[b]));
            up.find(|p| kept.contains(p)).unwrap_or(0)
        };
        let bone = |&b: &usize| Bone {
            name: format!("bone{b}"),
            parent: (b > 0).then(|| kept.iter().position(|k| *k == parent(b)).unwrap()),
            offset: turn * (rest(b) - rest(parent(b))),
            axis: DMat3::IDENTITY,
            dofs: if CMU[b].ends_with("hipjoint") {
                Vec::new()
            } else {
                [Axis::X, Axis::Y, Axis::Z]
                    .map(|a| Dof::free(Channel::Rotate(a)))
                    .to_vec()
            },
        };
        let skeleton = Skeleton::new(kept.iter().map(bone).collect()).unwrap();
        (skeleton, kept.iter().copied().enumerate().collect())
    }

    #[test]
    fn a_turned_copy_of_cmus_body_has_cmus_prior_turned() {
        let prior = RotationPrior::builtin().unwrap();
        for turn in [DMat3::IDENTITY, DMat3::from_rotation_y(2.0)] {
            let (own, points) = skeleton(&|_| true, turn);
            let carried = JointPrior::new(&prior, &own, 0, &points);
            assert_eq!(carried.bones.len(), 20);
            for (n, &b) in carried.bones.iter().enumerate() {
                let expected = turn * prior.mean[b] * turn.transpose();
                let off = rotation_vector(&(carried.means[n] * expected.transpose()));
                assert!(off.length() <= 1e-9, "{}: {off}", CMU[b]);
                // The variance about an axis, the floor apart.
                let axis = turn * DVec3::X;
                let of = |i: usize, j: usize| carried.covariance[[3 * n + i, 3 * n + j]];
                let along: f64 = (0..3)
                    .flat_map(|i| (0..3).map(move |j| (i, j)))
                    .map(|(i, j)| axis[i] * of(i, j) * axis[j])
                    .sum();
                let known = prior.covariance[[3 * b, 3 * b]];
                assert!(
                    along >= known + FLOOR.to_radians().powi(2) - 1e-9,
                    "{}",
                    CMU[b]
                );
                assert!(
                    along <= known + HAND_BEND.to_radians().powi(2) + 1e-2,
                    "{}",
                    CMU[b]
                );
            }
        }
    }

    #[test]
    fn a_bone_for_several_turns_by_all_of_them() {
        let prior = RotationPrior::builtin().unwrap();
        let spine = ["lowerback", "upperback"];
        let (own, points) = skeleton(&|b| !spine.contains(&CMU[b]), DMat3::IDENTITY);
        let carried = JointPrior::new(&prior, &own, 0, &points);
        let thorax = points.iter().find(|p| CMU[p.1] == "thorax").unwrap().0;
        let n = carried.bones.iter().position(|b| *b == thorax).unwrap();
        // The small rotations of three bones in a row, about nearly the same axes.
        let twist = carried.covariance[[3 * n + 1, 3 * n + 1]];
        let index = |name: &str| CMU.iter().position(|c| *c == name).unwrap();
        let [a, b, c] = ["lowerback", "upperback", "thorax"].map(|n| 3 * index(n) + 1);
        let all = [a, b, c].map(|i| [a, b, c].map(|j| prior.covariance[[i, j]]));
        let expected: f64 = all.iter().flatten().sum();
        assert!((twist - expected - FLOOR.to_radians().powi(2)).abs() <= 0.2 * expected);
    }

    #[test]
    fn joints_without_points_follow_the_one_above() {
        let prior = RotationPrior::builtin().unwrap();
        let (own, points) = skeleton(&|_| true, DMat3::IDENTITY);
        let few: Vec<(usize, usize)> = points.iter().copied().filter(|p| p.1 == 0).collect();
        let carried = JointPrior::new(&prior, &own, 0, &few);
        let wide = NO_BODY.to_radians().powi(2);
        for (n, mean) in carried.means.iter().enumerate() {
            assert!(mean.abs_diff_eq(DMat3::IDENTITY, 1e-12));
            assert!((carried.covariance[[3 * n, 3 * n]] - wide).abs() <= 1e-12);
        }
        assert!(JointPrior::new(&prior, &own, 0, &[]).bones.len() == 20);
        // One leg's points are enough for that leg.
        let leg = |p: &&(usize, usize)| ["root", "lhipjoint", "lfemur"].contains(&CMU[p.1]);
        let leg: Vec<(usize, usize)> = points.iter().filter(leg).copied().collect();
        let carried = JointPrior::new(&prior, &own, 0, &leg);
        let femur = carried
            .bones
            .iter()
            .position(|b| CMU[*b] == "lfemur")
            .unwrap();
        let index = CMU.iter().position(|c| *c == "lfemur").unwrap();
        let off = carried.means[femur] * prior.mean[index].transpose();
        assert!(rotation_vector(&off).length() <= 1e-9);
        assert!(from_rotation_vector(DVec3::ZERO).abs_diff_eq(DMat3::IDENTITY, 0.0));
    }
}
