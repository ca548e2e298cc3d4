//! Gaps of a whole body in a BVH file: positions by motion that is known, and the rotations that
//! put the joints there.

use crate::Result;
use crate::ik::solve_missing_channels;
use crate::io::MotionFile;
use crate::pose::Poses;
use crate::restore::BodyGap;
use crate::restore::inbetween::{MotionFiller, MotionLibrary, Verdict};
use ndarray::Array2;

/// A file of rotations whose gaps of a whole body were filled.
pub(super) struct BodyMotion {
    /// (frames, channels), radians and centimeters.
    pub motion: Array2<f64>,
    pub bodies: Vec<BodyGap>,
    /// Standard deviation of a coordinate (frames, points), cm; NaN where nothing is said.
    pub sd: Array2<f64>,
}

/// The gaps of a file in which most channels of the frames are missing, filled; `None` where there
/// are none that motion may fill.
///
/// # Errors
/// Those of solving for rotations.
pub(super) fn body_motion(
    file: &MotionFile,
    library: Option<&MotionLibrary>,
    longest: Option<f64>,
) -> Result<Option<BodyMotion>> {
    let (Some(bvh), Some(rate)) = (file.bvh(), file.rate()) else {
        return Ok(None);
    };
    let channels = bvh.motion.ncols();
    let missing = |t: usize| bvh.motion.row(t).iter().filter(|v| v.is_nan()).count();
    let bare: Vec<bool> = (0..bvh.motion.nrows())
        .map(|t| 2 * missing(t) > channels)
        .collect();
    if !bare.contains(&true) {
        return Ok(None);
    }
    let poses = file.poses();
    let run = 0..poses.frames();
    let runs = std::slice::from_ref(&run);
    let filler = MotionFiller::new(&poses.points, poses.xyz.view(), runs, rate, library);
    let Some(mut filler) = filler else {
        return Ok(None);
    };
    let points = filler.points().to_vec();
    let mut xyz = poses.xyz.clone();
    let mut sd = Array2::from_elem((poses.frames(), poses.points.len()), f64::NAN);
    let mut bodies = Vec::new();
    for frames in filler.gaps(&bare, longest) {
        let verdict = filler.fill(&frames);
        if let Verdict::Filled(fill) = &verdict {
            for (k, t) in frames.clone().enumerate() {
                for (b, p) in points.iter().enumerate() {
                    (0..3).for_each(|c| xyz[[t, 3 * p + c]] = fill.xyz[[k, 3 * b + c]]);
                    sd[[t, *p]] = fill.variance[[k, b]].sqrt();
                }
            }
        }
        bodies.push(BodyGap::of(frames, &verdict));
    }
    let mut motion = bvh.motion.clone();
    if bodies.iter().any(|body| body.source.is_some()) {
        let filled = Poses {
            xyz,
            ..poses.clone()
        };
        let solved = solve_missing_channels(bvh, &filled, file.units().up.rotation())?;
        for body in bodies.iter().filter(|body| body.source.is_some()) {
            for t in body.frames.clone() {
                motion.row_mut(t).assign(&solved.row(t));
            }
        }
    }
    Ok(Some(BodyMotion { motion, bodies, sd }))
}
