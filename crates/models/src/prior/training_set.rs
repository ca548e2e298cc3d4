//! Training poses in the model's space, and how they are used.
//!
//! Complete poses are placed (root at the origin, no global rotation) and, in world space, given
//! the bone lengths of the mean body; incomplete or unplaceable frames are left out and counted.

use super::provenance::digest;
use super::representative_poses::representative_poses;
use super::rigid_pairs::RigidPairs;
use super::up_directions;
use crate::io::Model;
use crate::io::model::{BodyMeta, check_point_count};
use crate::pose::similarity::Similarity;
use crate::pose::{Anchor, Body, PoseTransform, Poses, Space, joints};
use crate::{Error, Place, Result};
use ndarray::{Array2, Axis};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Training poses, ready for learning.
#[derive(Debug, Clone)]
pub struct TrainingSet {
    /// The points' names.
    pub points: Vec<String>,
    /// (m, 3 J), cm, in the model's space.
    pub xyz: Array2<f32>,
    /// The rows of each take, in time order.
    pub takes: Vec<Range<usize>>,
    /// The bone lengths of all poses (world) or of their mean (body); `None` if the points' bones
    /// are unknown.
    pub body: Option<Body>,
    /// The anchor by which the poses were placed, in world space.
    pub anchor: Option<Anchor>,
    /// The unit vector of the world's y axis in each pose's model space (m, 3); `None` in body
    /// space, and where y is not up.
    pub up: Option<Array2<f32>>,
    /// Number of frames left out because a point is missing.
    pub incomplete: usize,
    /// Number of frames left out because their placement is not determined.
    pub unplaced: usize,
}

/// How a prior is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TrainOptions {
    /// The seed of all random draws.
    pub seed: u64,
    /// Which poses are held out for tuning.
    pub hold_back: HoldBack,
}

/// Which training poses are held out for tuning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HoldBack {
    /// About a fifth of the poses, as whole takes; as contiguous segments of time if the takes are
    /// too few. For motion that was not seen before.
    #[default]
    Takes,
    /// A fifth of the frames at random (Lai et al.'s split). For frames between those of the
    /// training.
    Frames,
}

impl TrainingSet {
    /// Carries complete poses to the model's space. [`Space::World`]: root at the origin, no global
    /// rotation, and the mean body's bone lengths. Other spaces: rows as they are. `source`
    /// names the poses in messages.
    ///
    /// ```
    /// use ndarray::array;
    /// use posing_core::pose::{Poses, kinematics::Space};
    /// use posing_models::prior::training_set::TrainingSet;
    ///
    /// let (points, nan) = (vec!["hand".into()], f64::NAN);
    /// let xyz = array![[1.0, 2.0, 3.0], [nan, nan, nan], [1.5, 2.0, 3.0]];
    /// let poses = Poses { points, xyz, ..Poses::default() };
    /// let set = TrainingSet::from_poses(&poses, Space::Body, "hands")?; // rows as they are
    /// assert_eq!(set.xyz, array![[1.0, 2.0, 3.0], [1.5, 2.0, 3.0]]);
    /// assert_eq!(set.incomplete, 1);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// Data: too many points, or no complete pose that can be placed.
    pub fn from_poses(poses: &Poses, space: Space, source: &str) -> Result<TrainingSet> {
        prepare(poses, space == Space::World, None, source)
    }

    /// Carries other poses to where these are: the same points in the same order, the same body,
    /// the same placement.
    ///
    /// # Errors
    /// Data: as [`TrainingSet::from_poses`], or a point of these poses is missing.
    pub fn comparable(&self, poses: &Poses, source: &str) -> Result<TrainingSet> {
        prepare(poses, self.anchor.is_some(), Some(self), source)
    }

    /// An untrained model of a kind with what all kinds hold: points, space, bones, the number of
    /// frames, representative poses and rigid pairs.
    ///
    /// # Errors
    /// Data: no poses.
    pub fn model(&self, kind: &str) -> Result<Model> {
        let space = if self.anchor.is_some() {
            "world"
        } else {
            "body"
        };
        let mut model = Model::new(kind, &self.points, space);
        model.meta.body = self.body.as_ref().map(BodyMeta::from);
        let frames = self.xyz.nrows();
        model.meta.details.insert("frames".into(), frames.into());
        model.insert("typical", representative_poses(self.xyz.view())?);
        RigidPairs::learn(self.xyz.view(), &self.takes).write(&mut model);
        Ok(model)
    }

    /// What a model's history keeps of its inputs: the digest of all poses and, where there are
    /// several, of each take, so that a model is never tested on a take it was trained from.
    pub fn digests(&self) -> Vec<String> {
        let mut all = vec![digest(&self.points, self.xyz.view())];
        if self.takes.len() > 1 {
            let take =
                |r: &Range<usize>| digest(&self.points, self.xyz.slice(ndarray::s![r.clone(), ..]));
            all.extend(self.takes.iter().map(take));
        }
        all
    }
}

/// Carries complete poses to the model's space, or with `like` makes them comparable to those
/// poses.
fn prepare(
    poses: &Poses,
    world: bool,
    like: Option<&TrainingSet>,
    name: &str,
) -> Result<TrainingSet> {
    check_point_count(poses.points.len(), name)?;
    let ordered;
    let poses = match like {
        Some(like) if like.points != poses.points => {
            ordered = in_order(poses, &like.points, name)?;
            &ordered
        }
        _ => poses,
    };
    let parents = joints::parents_by_name(&poses.points);
    let bones = parents.iter().any(Option::is_some);
    let takes = poses.takes();
    let bodies: Vec<Body> = takes
        .iter()
        .map(|r| Body::measure(&parents, poses.xyz.slice(ndarray::s![r.clone(), ..])))
        .collect();
    let (body, anchor) = match like {
        Some(like) => (like.body.clone(), like.anchor.clone()),
        None => (
            bones.then(|| mean_body(&parents, &bodies)),
            world.then(|| anchor(poses)),
        ),
    };
    let mut out = TrainingSet {
        points: poses.points.clone(),
        xyz: Array2::zeros((0, 0)),
        takes: Vec::new(),
        body,
        anchor,
        up: None,
        incomplete: 0,
        unplaced: 0,
    };
    let placements = out.carry(poses, &takes, &bodies)?;
    if out.xyz.nrows() == 0 {
        let what = match out.unplaced {
            0 => "has no complete pose to train on",
            _ => "has no pose that can be placed; that needs three points not on one line",
        };
        return Err(Error::data(Place::file(name), what));
    }
    out.up = up_directions::of_placements(&placements);
    Ok(out)
}

impl TrainingSet {
    /// Takes over the poses that are complete and can be placed, of takes of some `bodies`. Where
    /// they were placed.
    fn carry(
        &mut self,
        poses: &Poses,
        takes: &[Range<usize>],
        bodies: &[Body],
    ) -> Result<Vec<Similarity>> {
        let mut rows: Vec<f32> = Vec::new();
        let mut placements = Vec::new();
        let width = poses.xyz.ncols();
        let (mut pose, mut placed) = (vec![0.0; width], vec![0.0; width]);
        for (take, measured) in takes.iter().zip(bodies) {
            let map = match (&self.anchor, &self.body) {
                (Some(_), Some(common)) => Some(PoseTransform::reshape(measured, common)),
                _ => None,
            };
            let first = rows.len() / width.max(1);
            for t in take.clone() {
                pose.iter_mut()
                    .zip(poses.xyz.row(t))
                    .for_each(|(p, v)| *p = *v);
                if pose.iter().any(|v| !v.is_finite()) {
                    self.incomplete += 1;
                    continue;
                }
                if let Some(anchor) = &self.anchor {
                    let Some(placement) = anchor.place(&pose) else {
                        self.unplaced += 1;
                        continue;
                    };
                    placements.push(placement);
                    placement.undo_pose(&pose, &mut placed);
                    match &map {
                        Some(map) => map.apply(&placed, &mut pose),
                        None => pose.copy_from_slice(&placed),
                    }
                }
                rows.extend(pose.iter().map(|v| *v as f32));
            }
            let end = rows.len() / width.max(1);
            if end > first {
                self.takes.push(first..end);
            }
        }
        let frames = rows.len() / width.max(1);
        self.xyz = Array2::from_shape_vec((frames, width), rows)
            .map_err(|e| Error::usage(e.to_string()))?;
        Ok(placements)
    }
}

/// The poses with their points in another order; every point must be there.
fn in_order(poses: &Poses, points: &[String], name: &str) -> Result<Poses> {
    let mut columns = Vec::new();
    for point in points {
        let Some(p) = poses.points.iter().position(|n| n == point) else {
            let what = format!("lacks the point \"{point}\" of the training poses");
            return Err(Error::data(Place::file(name), what));
        };
        columns.extend(3 * p..3 * p + 3);
    }
    let xyz = poses.xyz.select(Axis(1), &columns);
    Ok(Poses {
        points: points.to_vec(),
        xyz,
        time: poses.time.clone(),
        take: poses.take.clone(),
    })
}

/// What poses are placed by: CMU's pelvis, or their own mean, found by aligning them to each other.
fn anchor(poses: &Poses) -> Anchor {
    if let Some(pelvis) = Anchor::pelvis(&poses.points) {
        return pelvis;
    }
    let complete: Vec<Vec<f64>> = poses
        .xyz
        .rows()
        .into_iter()
        .filter(|r| r.iter().all(|v| v.is_finite()))
        .step_by((poses.frames() / 500).max(1))
        .map(|r| r.to_vec())
        .collect();
    let Some(mut mean) = complete.first().map(|p| centered(p)) else {
        return Anchor::mean(&[]);
    };
    // Generalized Procrustes analysis: three rounds settle it to far below the noise of a capture.
    for _ in 0..3 {
        let anchor = Anchor::mean(&mean);
        let mut sum = vec![0.0; mean.len()];
        let mut placed = mean.clone();
        for pose in &complete {
            if let Some(placement) = anchor.place(pose) {
                placement.undo_pose(pose, &mut placed);
                sum.iter_mut().zip(&placed).for_each(|(s, p)| *s += p);
            }
        }
        mean = centered(
            &sum.iter()
                .map(|s| s / complete.len() as f64)
                .collect::<Vec<_>>(),
        );
    }
    Anchor::mean(&mean)
}

/// The pose about its own center.
fn centered(pose: &[f64]) -> Vec<f64> {
    let count = (pose.len() / 3).max(1) as f64;
    let center: Vec<f64> = (0..3)
        .map(|a| pose.iter().skip(a).step_by(3).sum::<f64>() / count)
        .collect();
    pose.iter()
        .enumerate()
        .map(|(i, v)| v - center[i % 3])
        .collect()
}

fn mean_body(parents: &[Option<usize>], bodies: &[Body]) -> Body {
    let lengths = (0..parents.len())
        .map(|k| {
            let seen: Vec<f64> = bodies
                .iter()
                .map(|b| b.lengths[k])
                .filter(|l| l.is_finite())
                .collect();
            seen.iter().sum::<f64>() / seen.len() as f64
        })
        .collect();
    Body {
        parents: parents.to_vec(),
        lengths,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Similarity;
    use crate::pose::rotation::from_rotation_vector;
    use glam::DVec3;

    fn table(world: bool) -> Poses {
        let names = joints::cmu_names();
        let mut xyz = Array2::zeros((40, 69));
        for t in 0..40 {
            let pose: Vec<f64> = (0..69)
                .map(|i| match i / 3 {
                    0 => 0.0,
                    1 => [9.4, -9.9, 5.1][i % 3],
                    5 => [-9.1, -10.0, 5.1][i % 3],
                    9 => [0.1, 11.8, -0.1][i % 3],
                    j => {
                        20.0 * (j as f64 * 1.3 + (i % 3) as f64).sin()
                            + (t as f64 * 0.2 + i as f64).cos()
                    }
                })
                .collect();
            let mut out = pose.clone();
            if world {
                let v = DVec3::new(0.3, t as f64 * 0.4, -0.2);
                let s = Similarity {
                    rotation: from_rotation_vector(v),
                    shift: DVec3::new(9.0, 80.0, t as f64),
                    scale: 1.0,
                };
                s.apply_pose(&pose, &mut out);
            }
            xyz.row_mut(t).iter_mut().zip(out).for_each(|(a, b)| *a = b);
        }
        Poses {
            points: names,
            xyz,
            time: None,
            take: None,
        }
    }

    #[test]
    fn turned_poses_are_learned_from_as_unturned_ones() {
        let here = TrainingSet::from_poses(&table(false), Space::World, "t").unwrap();
        let there = TrainingSet::from_poses(&table(true), Space::World, "t").unwrap();
        assert!(
            here.xyz
                .iter()
                .zip(&there.xyz)
                .all(|(a, b)| (a - b).abs() <= 1e-3)
        );
        let as_is = TrainingSet::from_poses(&table(true), Space::Body, "t").unwrap();
        assert!(
            as_is
                .xyz
                .iter()
                .zip(&there.xyz)
                .any(|(a, b)| (a - b).abs() > 1.0)
        );
    }

    #[test]
    fn incomplete_frames_are_counted_and_left_out() {
        let mut poses = table(true);
        poses.xyz[[3, 50]] = f64::NAN;
        let out = TrainingSet::from_poses(&poses, Space::World, "t").unwrap();
        assert_eq!((out.xyz.nrows(), out.incomplete), (39, 1));
        poses.xyz.fill(f64::NAN);
        assert!(
            TrainingSet::from_poses(&poses, Space::World, "t")
                .unwrap_err()
                .to_string()
                .contains("no complete pose")
        );
    }
}
