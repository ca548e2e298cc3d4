//! The bones of a skin: one per part, joined as the template's parts are.

use crate::template::{Joint, Template};
use glam::{DAffine3, DMat3, DVec3};

/// Joints between a vertex's part and the farthest bone that it may follow.
const REACH: usize = 2;

/// The tree of the bones.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tree {
    /// Joints, each after the joint on which its first part hangs.
    joints: Vec<[usize; 2]>,
    /// The bone without a parent.
    root: usize,
}

impl Tree {
    pub(crate) fn of(template: &Template) -> Tree {
        let joints: Vec<[usize; 2]> = template.joints.iter().map(|j| j.parts).collect();
        let root = joints.first().map_or(0, |j| j[0]);
        Tree { joints, root }
    }

    /// Bones.
    pub(crate) fn len(&self) -> usize {
        self.joints.len() + 1
    }

    /// The parent of each bone.
    pub(crate) fn parents(&self) -> Vec<Option<usize>> {
        let mut parents = vec![None; self.len()];
        for [parent, child] in &self.joints {
            parents[*child] = Some(*parent);
        }
        parents
    }

    /// The bones within [`REACH`] joints of a bone, in order, itself among them.
    pub(crate) fn near(&self, bone: usize) -> Vec<usize> {
        let mut near = vec![bone];
        for _ in 0..REACH {
            let joined = self.joints.iter().flat_map(|[a, b]| {
                let other = |from: usize, to: usize| near.contains(&from).then_some(to);
                [other(*a, *b), other(*b, *a)]
            });
            let joined: Vec<usize> = joined.flatten().collect();
            near.extend(joined);
            near.sort_unstable();
            near.dedup();
        }
        near
    }

    /// For each joint and bone whether the bone hangs on the joint.
    pub(crate) fn hanging(&self) -> Vec<Vec<bool>> {
        let hanging = |first: usize| {
            let mut hangs = vec![false; self.len()];
            hangs[self.joints[first][1]] = true;
            for [parent, child] in &self.joints[first + 1..] {
                hangs[*child] |= hangs[*parent];
            }
            hangs
        };
        (0..self.joints.len()).map(hanging).collect()
    }

    /// R_parent - R_child of each joint.
    pub(crate) fn differences(&self, rotations: &[DMat3]) -> Vec<DMat3> {
        let difference = |j: &[usize; 2]| rotations[j[0]] - rotations[j[1]];
        self.joints.iter().map(difference).collect()
    }

    /// The motion of each bone by forward kinematics: both bones of a joint carry its rest position
    /// `at` to one position. The root turns about the origin.
    pub(crate) fn forward(&self, rotations: &[DMat3], at: &[DVec3]) -> Vec<DAffine3> {
        let mut shifts = vec![DVec3::ZERO; self.len()];
        for ([parent, child], at) in self.joints.iter().zip(at) {
            shifts[*child] = shifts[*parent] + (rotations[*parent] - rotations[*child]) * *at;
        }
        (rotations.iter().zip(shifts))
            .map(|(r, t)| DAffine3::from_mat3_translation(*r, t))
            .collect()
    }

    /// The position about which each bone turns: `at` of the joint with its parent, and for the
    /// root the middle of its part.
    pub(crate) fn positions(&self, template: &Template, at: &[DVec3]) -> Vec<DVec3> {
        let of_root = (template.vertices.iter().zip(&template.vertex_parts))
            .filter(|(_, part)| **part == self.root);
        let (sum, count) = of_root.fold((DVec3::ZERO, 0.0), |(s, n), (v, _)| (s + *v, n + 1.0));
        let mut positions = vec![sum / f64::max(count, 1.0); self.len()];
        for ([_, child], at) in self.joints.iter().zip(at) {
            positions[*child] = *at;
        }
        positions
    }
}

/// The rest positions of the template's joints.
pub(crate) fn borders(template: &Template) -> Vec<DVec3> {
    template.joints.iter().map(|j: &Joint| j.at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;

    /// 2 is the root; 0 and 4 hang on it, 1 on 0, 3 on 1.
    fn tree() -> Tree {
        Tree {
            joints: vec![[2, 0], [0, 1], [2, 4], [1, 3]],
            root: 2,
        }
    }

    #[test]
    fn bones_reach_two_joints_far_and_hang_on_all_joints_above() {
        let tree = tree();
        assert_eq!(tree.near(3), [0, 1, 3]);
        assert_eq!(tree.near(2), [0, 1, 2, 4]);
        assert_eq!(tree.parents(), [Some(2), Some(0), None, Some(1), Some(2)]);
        let bones = |joint: usize| -> Vec<usize> {
            let hanging = &tree.hanging()[joint];
            (0..5).filter(|b| hanging[*b]).collect()
        };
        assert_eq!([bones(0), bones(1)], [vec![0, 1, 3], vec![1, 3]]);
        assert_eq!([bones(2), bones(3)], [vec![4], vec![3]]);
    }

    #[test]
    fn both_bones_of_a_joint_carry_it_to_one_position() {
        let tree = tree();
        let spread = |k: usize| DVec3::new(k as f64, 1.0 - k as f64, (2 * k) as f64);
        let rotations: Vec<DMat3> = (0..5)
            .map(|b| from_rotation_vector(0.3 * spread(b)))
            .collect();
        let at: Vec<DVec3> = (5..9).map(spread).collect();
        let motions = tree.forward(&rotations, &at);
        assert_eq!(motions[2].translation, DVec3::ZERO);
        for ([parent, child], at) in tree.joints.iter().zip(&at) {
            let positions = [parent, child].map(|b| motions[*b].transform_point3(*at));
            assert!((positions[0] - positions[1]).length() <= 1e-12);
        }
    }
}
