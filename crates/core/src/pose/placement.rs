//! Placement: how a captured pose is carried into the model's space and back.
//!
//! For CMU's joints the model's space is the root's frame, found from the root, the hip joints
//! (which are rigid with it) and, where one of those is missing, the lower back; for other points
//! it is a rigid fit to the mean pose.

use super::rotation::angle_between;
use super::similarity::{Similarity, TransformKind, fit_similarity};
use glam::{DMat3, DVec3};

/// Where CMU's hip joints and lower back stand in the root's frame: means over the database's
/// skeletons, cm.
const CMU_PELVIS: [(&str, [f64; 3], f64); 4] = [
    ("root", [0.0, 0.0, 0.0], 1.0),
    ("lhipjoint", [9.4, -9.9, 5.1], 1.0),
    ("rhipjoint", [-9.1, -10.0, 5.1], 1.0),
    // The lower back turns against the pelvis: it only decides where the others do not.
    ("lowerback", [0.1, 11.8, -0.1], 1e-3),
];

/// A pose within this angle of the model's frame, its root at the origin, is aligned already.
const ALIGNED: f64 = 0.26;

/// The points that place a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchor {
    /// The point at the model's origin, if there is one.
    pub root: Option<usize>,
    /// Points, where they stand in the model's space (cm), and their weights.
    points: Vec<(usize, DVec3, f64)>,
}

impl Anchor {
    /// CMU's pelvis, where the points have its root and both hip joints.
    pub fn pelvis(names: &[String]) -> Option<Anchor> {
        let find = |name: &str| names.iter().position(|n| n == name);
        let mut points = Vec::new();
        for (name, position, weight) in CMU_PELVIS {
            match find(name) {
                Some(i) => points.push((i, DVec3::from_array(position), weight)),
                None if weight == 1.0 => return None,
                None => {}
            }
        }
        Some(Anchor {
            root: find("root"),
            points,
        })
    }

    /// An anchor of all points, by a mean pose (3 J, cm).
    #[doc(hidden)]
    pub fn mean(pose: &[f64]) -> Anchor {
        Anchor::of_points(pose, &(0..pose.len() / 3).collect::<Vec<_>>())
    }

    /// An anchor of some points of a mean pose (3 J, cm).
    #[doc(hidden)]
    pub fn of_points(pose: &[f64], points: &[usize]) -> Anchor {
        let at = |&i: &usize| (i, DVec3::from_slice(&pose[3 * i..3 * i + 3]), 1.0);
        Anchor {
            root: None,
            points: points.iter().map(at).collect(),
        }
    }

    /// The anchor without points that turn against the others.
    #[doc(hidden)]
    pub fn rigid_only(mut self) -> Anchor {
        self.points.retain(|(.., weight)| *weight >= 1.0);
        self
    }

    /// The points that place a pose.
    #[doc(hidden)]
    pub fn points(&self) -> impl Iterator<Item = usize> {
        self.points.iter().map(|p| p.0)
    }

    /// The placement of a pose of 3 J numbers: what carries the model's space to where the pose
    /// stands.
    ///
    /// `None` when the points that the pose shows do not determine it. An aligned pose gets
    /// the identity.
    #[doc(hidden)]
    pub fn place(&self, pose: &[f64]) -> Option<Similarity> {
        let fitted = self.fit(pose)?;
        let is_at_origin = self.root.is_some() && fitted.shift.length() <= 1e-6;
        let is_aligned =
            is_at_origin && angle_between(&fitted.rotation, &DMat3::IDENTITY) <= ALIGNED;
        Some(if is_aligned {
            Similarity::IDENTITY
        } else {
            fitted
        })
    }

    /// Places a pose like [`Anchor::place`], but fits an aligned one too: frames of a take
    /// that turns through there stay continuous.
    #[doc(hidden)]
    pub fn fit(&self, pose: &[f64]) -> Option<Similarity> {
        let at = |i: usize| DVec3::from_slice(&pose[3 * i..3 * i + 3]);
        let seen = || self.points.iter().filter(|(i, ..)| at(*i).is_finite());
        let Some(root) = self.root.map(at).filter(|r| r.is_finite()) else {
            let pairs = seen().map(|&(i, position, weight)| (position, at(i), weight));
            let fit = fit_similarity(pairs, TransformKind::Rigid)?;
            return fit.determined.then_some(fit.similarity);
        };
        // The root's own position is exact; the turn is about it.
        let pairs = seen().map(|&(i, position, weight)| (position, at(i) - root, weight));
        let turn = fit_similarity(pairs, TransformKind::Rotation)?;
        turn.determined.then_some(Similarity {
            shift: root,
            ..turn.similarity
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::joints::cmu_names;
    use super::super::rotation::from_rotation_vector;
    use super::*;

    fn pose() -> Vec<f64> {
        let names = cmu_names();
        let mut pose: Vec<f64> = (0..69).map(|i| (i as f64 * 0.7).sin() * 30.0).collect();
        for (name, position, _) in CMU_PELVIS {
            let i = names.iter().position(|n| n == name).unwrap();
            pose[3 * i..3 * i + 3].copy_from_slice(&position);
        }
        pose
    }

    #[test]
    fn a_turned_pose_is_placed_by_its_pelvis() {
        let anchor = Anchor::pelvis(&cmu_names()).unwrap();
        let moved = Similarity {
            rotation: from_rotation_vector(DVec3::new(0.4, 2.0, -0.3)),
            shift: DVec3::new(9.0, 90.0, 3.0),
            scale: 1.0,
        };
        let mut world = vec![0.0; 69];
        moved.apply_pose(&pose(), &mut world);
        let found = anchor.place(&world).unwrap();
        assert!(angle_between(&found.rotation, &moved.rotation) <= 1e-9);
        assert!((found.shift - moved.shift).length() <= 1e-9);
        // One hip joint missing: the lower back decides.
        world[3..6].fill(f64::NAN);
        let found = anchor.place(&world).unwrap();
        assert!(angle_between(&found.rotation, &moved.rotation) <= 1e-6);
        world[15..18].fill(f64::NAN);
        world[27..30].fill(f64::NAN);
        assert!(anchor.place(&world).is_none());
    }

    #[test]
    fn an_aligned_pose_stays_as_it_is() {
        let anchor = Anchor::pelvis(&cmu_names()).unwrap();
        assert_eq!(anchor.place(&pose()), Some(Similarity::IDENTITY));
        assert!(Anchor::pelvis(&["root".to_string()]).is_none());
        // A pose with a small turn counts as aligned, but is fitted where frames are compared.
        let turn = from_rotation_vector(DVec3::Y * 0.1);
        let turned: Vec<f64> = (pose().chunks_exact(3))
            .flat_map(|p| (turn * DVec3::from_slice(p)).to_array())
            .collect();
        assert_eq!(anchor.place(&turned), Some(Similarity::IDENTITY));
        let fitted = anchor.fit(&turned).unwrap();
        assert!(angle_between(&fitted.rotation, &turn) <= 1e-9);
    }

    #[test]
    fn other_points_are_fitted_to_their_mean() {
        let mean: Vec<f64> = (0..12).map(|i| (i as f64 * 1.3).cos() * 10.0).collect();
        let moved = Similarity {
            rotation: from_rotation_vector(DVec3::X),
            shift: DVec3::Y * 5.0,
            scale: 1.0,
        };
        let mut world = vec![0.0; 12];
        moved.apply_pose(&mean, &mut world);
        let found = Anchor::mean(&mean).place(&world).unwrap();
        assert!(angle_between(&found.rotation, &moved.rotation) <= 1e-7);
    }
}
