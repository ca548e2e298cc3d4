//! The points of a body as a tree of bones, by CMU's names: headings, other bone lengths, the
//! mirror image.

use crate::Result;
use crate::pose::joints::{CMU, cmu_names, parents_by_name};
use crate::pose::sides::mirrored;
use crate::pose::{Body, PointNaming, Poses, point_at};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};

/// Positions of a body's points in frames (frames, points), cm, y up.
pub(crate) type Frames = Array2<DVec3>;

/// Fewer points make no body.
const FEWEST: usize = 5;

/// The points whose bones make the length of a leg.
const LEGS: [&str; 4] = ["lfemur", "rfemur", "ltibia", "rtibia"];

/// The bones of a body.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BodyTree {
    /// CMU's names of the points.
    pub names: Vec<String>,
    pub root: usize,
    parents: Vec<Option<usize>>,
    /// The points, parents first.
    order: Vec<usize>,
    hips: [usize; 2],
    legs: Vec<usize>,
    /// The other side's point of each; `None` where a side has a point that the other lacks.
    mirror: Option<Vec<usize>>,
}

impl BodyTree {
    /// The tree of those of some points that CMU's skeleton has, and which they are; `None` without
    /// the root and both hips.
    pub(crate) fn of(points: &[String]) -> Option<(BodyTree, Vec<usize>)> {
        let column = |name: &&str| points.iter().position(|p| p == name);
        let columns: Vec<usize> = CMU.iter().filter_map(column).collect();
        let names: Vec<String> = columns.iter().map(|c| points[*c].clone()).collect();
        let at = |name: &str| names.iter().position(|n| n == name);
        let root = at(CMU[0])?;
        let hips = [at("lhipjoint")?, at("rhipjoint")?];
        let parents = parents_by_name(&names);
        let is_tree = (0..names.len()).all(|p| p == root || parents[p].is_some());
        if !is_tree || names.len() < FEWEST {
            return None;
        }
        let all = cmu_names();
        let is_central = |p: usize| {
            let own = all.iter().position(|n| *n == names[p]);
            own.is_some_and(|own| mirrored(&all, own).is_none())
        };
        let other = |p: usize| mirrored(&names, p).or_else(|| is_central(p).then_some(p));
        let tree = BodyTree {
            mirror: (0..names.len()).map(other).collect(),
            legs: LEGS.iter().filter_map(|name| at(name)).collect(),
            order: Body::unknown(parents.clone()).order(),
            names,
            root,
            parents,
            hips,
        };
        Some((tree, columns))
    }

    /// The tree of the points of a table, and which they are; `naming` says how points are named,
    /// else the names tell.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: the names tell no body.
    pub(crate) fn of_table(
        poses: &Poses,
        naming: Option<&PointNaming>,
    ) -> Result<(BodyTree, Vec<usize>)> {
        let of = || PointNaming::of(&poses.points, poses.xyz.view(), &cmu_names());
        let naming = naming.cloned().unwrap_or_else(of);
        let tree = BodyTree::of(&naming.model_names(&poses.points));
        tree.ok_or(
            "has no body that is known by name, with root and hips; the option `map` names points"
                .into(),
        )
    }

    pub(crate) fn points(&self) -> usize {
        self.names.len()
    }

    /// The positions of the tree's points, which are these `columns` of `xyz` (frames, 3 J).
    pub(crate) fn frames(xyz: ArrayView2<'_, f64>, columns: &[usize]) -> Frames {
        let shape = (xyz.nrows(), columns.len());
        Array2::from_shape_fn(shape, |(t, p)| point_at(xyz, t, columns[p]))
    }

    /// The median length of each point's bone over the frames that show it, cm; 0 for the root.
    pub(crate) fn lengths(&self, frames: &Frames) -> Vec<f64> {
        let flat = Array2::from_shape_fn((frames.nrows(), 3 * frames.ncols()), |(t, i)| {
            frames[[t, i / 3]][i % 3]
        });
        let body = Body::measure(&self.parents, flat.view());
        let known = |l: f64| if l.is_finite() { l } else { 0.0 };
        body.lengths.into_iter().map(known).collect()
    }

    /// The length of both legs, cm.
    pub(crate) fn legs(&self, lengths: &[f64]) -> f64 {
        self.legs.iter().map(|p| lengths[*p]).sum()
    }

    /// Frames with bones of other lengths, directions kept; the root's path is `scale` times as
    /// long.
    pub(crate) fn with_lengths(&self, frames: &Frames, scale: f64, lengths: &[f64]) -> Frames {
        let mut out = frames.clone();
        for (mut to, from) in out.rows_mut().into_iter().zip(frames.rows()) {
            for &p in &self.order {
                to[p] = match self.parents[p] {
                    None => scale * from[p],
                    Some(parent) => {
                        let bone = from[p] - from[parent];
                        to[parent] + bone / bone.length().max(1e-6) * lengths[p]
                    }
                };
            }
        }
        out
    }

    /// The mirror image of frames.
    pub(crate) fn mirrored(&self, frames: &Frames) -> Option<Frames> {
        let mirror = self.mirror.as_ref()?;
        Some(Array2::from_shape_fn(frames.dim(), |(t, p)| {
            frames[[t, mirror[p]]] * DVec3::new(-1.0, 1.0, 1.0)
        }))
    }

    /// The angle about the vertical that turns x to the left hip, radians.
    pub(crate) fn heading(&self, frames: &Frames, t: usize) -> f64 {
        let across = frames[[t, self.hips[0]]] - frames[[t, self.hips[1]]];
        (-across.z).atan2(across.x)
    }
}

/// A turn about the vertical.
pub(crate) fn turn(angle: f64) -> DMat3 {
    DMat3::from_rotation_y(angle)
}

/// An angle between -π and π.
pub(crate) fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Somebody who walks in a curve with arms that swing; `rate` in frames a second.
    pub(crate) fn walk(frames: usize, rate: f64, pace: f64) -> (BodyTree, Frames) {
        let (tree, _) = BodyTree::of(&cmu_names()).unwrap();
        let rest = crate::pose::joints::CMU_REST;
        let frames = Array2::from_shape_fn((frames, tree.points()), |(t, p)| {
            let s = t as f64 / rate;
            let step = (pace * 6.0 * s).sin();
            let rest = DVec3::from_array(rest[p]);
            let side = rest.x.signum() * f64::from(rest.x.abs() > 1.0);
            let reach = if rest.y < 0.0 {
                -rest.y
            } else {
                0.3 * rest.x.abs()
            };
            let swing = DVec3::new(0.0, 0.04 * reach * step.abs(), 0.5 * reach * side * step);
            let ahead = turn(0.4 * s);
            ahead * (rest + swing) + DVec3::new(100.0 * s, 95.0 + 2.0 * (2.0 * step).cos(), 30.0)
        });
        let rest = Array2::from_shape_fn((1, tree.points()), |(_, p)| DVec3::from_array(rest[p]));
        let frames = tree.with_lengths(&frames, 1.0, &tree.lengths(&rest));
        (tree, frames)
    }

    #[test]
    fn other_lengths_keep_directions_and_the_mirror_is_its_own_inverse() {
        let (tree, frames) = walk(20, 30.0, 1.0);
        let lengths: Vec<f64> = tree.lengths(&frames).iter().map(|l| 1.2 * l).collect();
        let other = tree.with_lengths(&frames, 1.2, &lengths);
        assert!((other[[7, 4]] - 1.2 * frames[[7, 4]]).length() < 1e-9);
        let back = tree.mirrored(&tree.mirrored(&frames).unwrap()).unwrap();
        assert_eq!(back, frames);
        let ahead = tree.heading(&frames, 3);
        let left = turn(-ahead) * (frames[[3, 1]] - frames[[3, 5]]);
        assert!(left.x > 0.0 && left.z.abs() < 1e-9);
        assert!((wrapped(6.0) - (6.0 - std::f64::consts::TAU)).abs() < 1e-12);
    }

    #[test]
    fn a_body_has_a_root_and_hips() {
        assert!(BodyTree::of(&["a".to_string(), "root".to_string()]).is_none());
        let some: Vec<String> = cmu_names().into_iter().filter(|n| n != "lwrist").collect();
        let (tree, columns) = BodyTree::of(&some).unwrap();
        assert_eq!((columns.len(), tree.points()), (22, 22));
        assert!(tree.mirror.is_none());
    }
}
