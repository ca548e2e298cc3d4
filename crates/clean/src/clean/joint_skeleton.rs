//! The skeleton of a take of joints, such as keypoints of video: measured from it and fitted to it.

use super::person::picture;
use crate::Result;
use crate::ik::{FitVerdict, SkeletonFit, named_skeleton};
use crate::io::Bvh;
use crate::pose::rotation::Axis;
use crate::pose::{NameMap, Poses, point_at};
use glam::DMat3;
use ndarray::Array2;
use serde_json::{Value, json};

/// A skeleton and its motion, and what is to be known of them.
pub(super) struct SolvedJoints {
    pub bvh: Bvh,
    pub report: Value,
}

impl SolvedJoints {
    /// Fits the skeleton of a take whose points `map` names; `sd` are their deviations (frames,
    /// points), cm, `rate` is in frames a second.
    ///
    /// # Errors
    /// Those of [`named_skeleton`] and [`SkeletonFit::fit`].
    pub(super) fn of(
        poses: &Poses,
        map: &NameMap,
        sd: &Array2<f64>,
        rate: f64,
    ) -> Result<SolvedJoints> {
        let order = [Axis::Z, Axis::Y, Axis::X];
        let named = named_skeleton(poses, map, order)?;
        let sd = named.with_middles(sd);
        let fit = SkeletonFit::with_joints(&named.template);
        let fitted = fit.map(Some(map)).sd(Some(sd.view())).fit(&named.poses)?;
        let quality = fitted.quality(&named.poses);
        let far = quality.filter(|quality| quality.verdict() != FitVerdict::Good);
        let finding = far.map(|quality| {
            let mean = quality.mean;
            format!("its joints are {mean:.2} cm from their points in the mean")
        });
        let seen = |t: usize| {
            let is_seen = |p: &usize| point_at(poses.xyz.view(), t, *p).is_finite();
            (0..poses.points.len()).filter(is_seen).count()
        };
        let report = json!({
            "map": map.name,
            "joints": fitted.points,
            "frames": named.poses.frames(),
            "mean": quality.map(|quality| quality.mean),
            "findings": finding.into_iter().collect::<Vec<_>>(),
            "picture": picture(poses, None, seen),
        });
        Ok(SolvedJoints {
            bvh: fitted.to_bvh_with(order, DMat3::IDENTITY, rate)?,
            report,
        })
    }
}
