//! The skeleton of a take of joints, such as keypoints of video: measured from it and fitted to it.

use super::person::picture;
use crate::Result;
use crate::ik::{FitVerdict, SkeletonFit, estimate_skeleton, named_skeleton};
use crate::io::Bvh;
use crate::pose::rotation::Axis;
use crate::pose::{PointNaming, Poses, point_at};
use glam::DMat3;
use ndarray::Array2;
use serde_json::{Value, json};

/// The order of the rotation channels.
const ORDER: [Axis; 3] = [Axis::Z, Axis::Y, Axis::X];

/// A skeleton and its motion, and what is to be known of them.
pub(super) struct SolvedJoints {
    pub bvh: Bvh,
    pub report: Value,
}

impl SolvedJoints {
    /// Fits the skeleton of a take whose points are named so; `sd` are their deviations (frames,
    /// points), cm, `rate` is in frames a second.
    ///
    /// # Errors
    /// Those of [`named_skeleton`], [`estimate_skeleton`] and [`SkeletonFit::fit`].
    pub(super) fn of(
        poses: &Poses,
        naming: &PointNaming,
        sd: &Array2<f64>,
        rate: f64,
    ) -> Result<SolvedJoints> {
        let mut solved = match naming {
            PointNaming::Map(map) => {
                let named = named_skeleton(poses, map, ORDER)?;
                let fit = SkeletonFit::with_joints(&named.template).map(Some(map));
                SolvedJoints::fitted(fit, &named.poses, &named.with_middles(sd), rate)?
            }
            PointNaming::Bones(_) => {
                let mut ends = poses.clone();
                ends.points = naming.model_names(&poses.points).into_owned();
                let skeleton = estimate_skeleton(&ends)?;
                SolvedJoints::fitted(SkeletonFit::new(&skeleton), &ends, sd, rate)?
            }
        };
        if let PointNaming::Map(map) = naming {
            solved.report["map"] = json!(map.name);
        }
        let seen = |t: usize| {
            let is_seen = |p: &usize| point_at(poses.xyz.view(), t, *p).is_finite();
            (0..poses.points.len()).filter(is_seen).count()
        };
        solved.report["picture"] = json!(picture(poses, None, seen));
        Ok(solved)
    }

    /// The fit to poses whose points the skeleton has.
    fn fitted<'a>(
        fit: SkeletonFit<'a>,
        poses: &Poses,
        sd: &'a Array2<f64>,
        rate: f64,
    ) -> Result<SolvedJoints> {
        let fitted = fit.sd(Some(sd.view())).fit(poses)?;
        let quality = fitted.quality(poses);
        let far = quality.filter(|quality| quality.verdict() != FitVerdict::Good);
        let finding = far.map(|quality| {
            let mean = quality.mean;
            format!("its joints are {mean:.2} cm from their points in the mean")
        });
        let report = json!({
            "joints": fitted.points,
            "frames": poses.frames(),
            "mean": quality.map(|quality| quality.mean),
            "findings": finding.into_iter().collect::<Vec<_>>(),
        });
        Ok(SolvedJoints {
            bvh: fitted.to_bvh_with(ORDER, DMat3::IDENTITY, rate)?,
            report,
        })
    }
}
