//! The page of a solved take: it plays joints and markers, each with a line to its bone.

use super::landmarks::JointSet;
use super::solved_take::SolvedTake;
use crate::Result;
use crate::draw::scene::Figure;
use crate::draw::take_page::TakePage;
use crate::pose::{Poses, point_at};
use ndarray::{Array2, Axis, concatenate};

impl SolvedTake {
    /// The page of the take `name`, whose markers are `poses`; `None` of one that cannot be played.
    ///
    /// # Errors
    /// The page cannot be made.
    pub fn page(&self, name: &str, poses: &Poses) -> Result<Option<String>> {
        let used = self.used.iter().filter_map(|m| {
            let point = poses.points.iter().position(|p| *p == m.name)?;
            Some((point, m))
        });
        let used: Vec<_> = used.collect();
        let columns: Vec<usize> = used.iter().flat_map(|(p, _)| 3 * p..3 * p + 3).collect();
        let xyz = concatenate![
            Axis(1),
            self.joints.xyz,
            poses.xyz.select(Axis(1), &columns)
        ];
        let (mut bones, joints) = self.joint_lines();
        for (n, (_, marker)) in used.iter().enumerate() {
            let own = joints.len() + n;
            bones.extend(
                self.joint_of(&marker.bone, &joints, &xyz, own)
                    .map(|j| (j, own)),
            );
        }
        let names = used.iter().map(|(p, _)| poses.points[*p].clone());
        let all = Poses {
            points: self.joints.points.iter().cloned().chain(names).collect(),
            ..self.joints.clone()
        };
        TakePage {
            name,
            note: "The joints and the markers, each with a line to its bone. Centimeters, y up.",
            poses: &all,
            rate: poses.rate(),
            bones: &bones,
            markers: Some(joints.len()),
            figures: vec![Figure::new("solved", xyz.view())],
            table: None,
        }
        .html()
    }

    /// The lines between joints, and the bones that end at these.
    fn joint_lines(&self) -> (Vec<(usize, usize)>, Vec<String>) {
        let of = JointSet::of(&self.joints.points).joints();
        let joints: Vec<String> = of.into_iter().map(|(_, bone)| bone).collect();
        let line = |(j, bone): (usize, &String)| Some((self.above(bone, &joints)?, j));
        (joints.iter().enumerate().filter_map(line).collect(), joints)
    }

    /// The joint nearest above the end of a bone.
    fn above(&self, bone: &str, joints: &[String]) -> Option<usize> {
        let bones = self.skeleton.skeleton.bones();
        let own = bones.iter().position(|b| b.name == bone)?;
        let mut up = std::iter::successors(bones[own].parent, |&b| bones[b].parent);
        up.find_map(|b| joints.iter().position(|j| *j == bones[b].name))
    }

    /// The end of a bone that a marker is nearer to, where both are first seen.
    fn joint_of(
        &self,
        bone: &str,
        joints: &[String],
        xyz: &Array2<f64>,
        marker: usize,
    ) -> Option<usize> {
        let end = joints.iter().position(|j| j == bone);
        let ends = [end, self.above(bone, joints)].into_iter().flatten();
        let far = |j: usize| {
            let lengths = (0..xyz.nrows())
                .map(|t| point_at(xyz.view(), t, j).distance(point_at(xyz.view(), t, marker)));
            lengths
                .into_iter()
                .find(|l| l.is_finite())
                .unwrap_or(f64::INFINITY)
        };
        ends.min_by(|a, b| far(*a).total_cmp(&far(*b)))
    }
}
