//! Takes of points on their floor.

use super::contacts::Contacts;
use super::feet::{Feet, target, told};
use super::report::{GroundReport, Grounded};
use super::tuning::*;
use crate::pose::head_and_feet::head_and_feet;
use crate::pose::{Poses, point_at};
use crate::{Error, Result};
use glam::DVec3;
use ndarray::Array2;

/// Puts a take of points on its floor: points that are called as of feet, joints or markers, tell
/// it. Feet are not held.
///
/// # Errors
/// [`Error::Unfit`]: no point is called as of a foot, or no frames.
pub fn ground_points(poses: &Poses, rate: f64) -> Result<Grounded<Array2<f64>>> {
    let [_, feet] = head_and_feet(&poses.points);
    if poses.frames() == 0 {
        return Err(Error::unfit("has no frames"));
    }
    if feet.is_empty() {
        return Err(Error::unfit(
            "no point is called as of a foot (ankle, heel, toe, foot): name them, with label or \
             trim",
        ));
    }
    let xyz = poses.xyz.view();
    let all = |t: usize| (0..poses.points.len()).map(move |p| point_at(xyz, t, p));
    let every = (0..poses.frames()).flat_map(all).filter(|p| p.is_finite());
    let (sum, count) = every.fold((DVec3::ZERO, 0.0), |(sum, n), p| (sum + p, n + 1.0));
    let middle = sum / f64::max(count, 1.0);
    let track = |p: &usize| (0..poses.frames()).map(|t| point_at(xyz, t, *p)).collect();
    let tracks = Feet {
        points: feet.iter().map(track).collect(),
        scale: [rate, 1.0],
        pivot: [middle.x, middle.z],
    };
    let mut take = poses.xyz.clone();
    let floor = match tracks.floor(|_, _| true) {
        Ok(floor) => floor,
        Err(standing) => {
            let report = GroundReport::left(standing);
            return Ok(Grounded { take, report });
        }
    };
    let lowest = floor.lowest(1.0);
    let height = target(&floor, lowest, 0.0, [-AT_ZERO[0], MARKERS], 1.0);
    let level = floor.level(lowest, height, rate);
    let mut report = told(&level, [lowest, height], poses.frames());
    for (t, mut row) in take.rows_mut().into_iter().enumerate() {
        for p in 0..poses.points.len() {
            let place = level.place(t, point_at(xyz, t, p));
            (0..3).for_each(|c| row[3 * p + c] = place[c]);
        }
    }
    for (track, point) in feet.into_iter().enumerate() {
        if level.height(track) <= height + ALIKE {
            let points = level.places(&tracks.points[track]);
            let contacts = Contacts::of(points, level.height(track), tracks.scale);
            report.add(contacts.told(&poses.points[point], rate));
        }
    }
    Ok(Grounded { take, report })
}
