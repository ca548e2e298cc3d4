//! The missing values of a BVH file by time alone, as an animator's curve has them, and how far
//! joints are off then.

use super::tuning::channel_paths::*;
use crate::io::Bvh;
use crate::io::bvh::BvhSkeleton;
use crate::numeric::pchip::pchip;
use crate::pose::kinematics::Posture;
use crate::pose::rotation::nearest_equivalent_angle;
use glam::DVec3;
use ndarray::Array2;
use std::collections::HashMap;
use std::ops::Range;

/// The motion of `bvh` (frames, channels; radians and centimeters) with each missing value on a
/// smooth path (PCHIP) from those before to those after, angles unwound; at the ends of the take
/// the nearest value, and 0 where a channel has none.
pub(crate) fn interpolated(bvh: &Bvh) -> Array2<f64> {
    let kinds = bvh.joints.iter().flat_map(|j| &j.channels);
    let mut out = bvh.motion.clone();
    for (c, kind) in kinds.enumerate() {
        let is_known = |t: &usize| bvh.motion[[*t, c]].is_finite();
        let known: Vec<usize> = (0..out.nrows()).filter(is_known).collect();
        let missing: Vec<usize> = (0..out.nrows()).filter(|t| !is_known(t)).collect();
        if missing.is_empty() {
            continue;
        }
        let values = known.iter().map(|&t| bvh.motion[[t, c]]).collect();
        let path = path(&known, values, kind.is_angle(), &missing);
        for (t, value) in missing.iter().zip(path) {
            out[[*t, c]] = value;
        }
    }
    out
}

/// The values at the frames `at` from those at the frames `known`.
fn path(known: &[usize], mut values: Vec<f64>, is_angle: bool, at: &[usize]) -> Vec<f64> {
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else {
        return vec![0.0; at.len()];
    };
    if is_angle {
        for i in 1..values.len() {
            values[i] = nearest_equivalent_angle(values[i], values[i - 1]);
        }
    }
    let x: Vec<f64> = known.iter().map(|&t| t as f64).collect();
    let at: Vec<f64> = at.iter().map(|&t| t.clamp(first, last) as f64).collect();
    pchip(&x, &values, &at)
}

/// How far each bone of `bones` is off along these paths: the variance of a coordinate, cm²
/// (frames, bones), by gaps of the same channels and lengths that are simulated elsewhere in the
/// take; infinite where it is too short to tell, 0 in frames that lack nothing. `filled` is what
/// [`interpolated`] gives.
pub(crate) fn variances(
    bvh: &Bvh,
    rig: &BvhSkeleton,
    bones: &[usize],
    filled: &Array2<f64>,
) -> Array2<f64> {
    let mut out = Array2::zeros((filled.nrows(), bones.len()));
    // Gaps of the same channels and length have the same variances.
    let mut known: HashMap<ChannelGap, Option<Array2<f64>>> = HashMap::new();
    let lacks = |t: usize| bvh.motion.row(t).iter().any(|v| v.is_nan());
    let mut t = 0;
    while t < filled.nrows() {
        if !lacks(t) {
            t += 1;
            continue;
        }
        let end = (t..filled.nrows()).find(|&t| !lacks(t));
        let frames = t..end.unwrap_or(filled.nrows());
        t = frames.end;
        let simulated = known
            .entry(ChannelGap::new(bvh, frames.clone()))
            .or_insert_with_key(|gap| gap.simulate(bvh, rig, bones, filled));
        for (k, t) in frames.enumerate() {
            for j in 0..bones.len() {
                out[[t, j]] = simulated.as_ref().map_or(f64::INFINITY, |v| v[[k, j]]);
            }
        }
    }
    out
}

/// Frames on end in which channels are missing.
#[derive(PartialEq, Eq, Hash)]
struct ChannelGap {
    length: usize,
    /// The channels, each with whether it is an angle.
    channels: Vec<(usize, bool)>,
    /// Frames that are there before and after, up to [`SIDE`].
    sides: [usize; 2],
}

impl ChannelGap {
    fn new(bvh: &Bvh, frames: Range<usize>) -> ChannelGap {
        let kinds = bvh.joints.iter().flat_map(|j| &j.channels).enumerate();
        let is_missing = |c: usize| frames.clone().any(|t| bvh.motion[[t, c]].is_nan());
        let channels = kinds.filter(|(c, _)| is_missing(*c));
        ChannelGap {
            channels: channels.map(|(c, kind)| (c, kind.is_angle())).collect(),
            sides: [
                frames.start.min(SIDE),
                (bvh.motion.nrows() - frames.end).min(SIDE),
            ],
            length: frames.len(),
        }
    }

    /// The mean squared error of a coordinate, cm² (frames of the gap, bones), over gaps like it;
    /// `None` where there is no room for some.
    fn simulate(
        &self,
        bvh: &Bvh,
        rig: &BvhSkeleton,
        bones: &[usize],
        filled: &Array2<f64>,
    ) -> Option<Array2<f64>> {
        let (length, [before, after]) = (self.length, self.sides);
        let is_whole = |s: &usize| {
            let frames = s - before..s + length + after;
            let mut channels = self.channels.iter();
            channels.all(|(c, _)| frames.clone().all(|t| bvh.motion[[t, *c]].is_finite()))
        };
        let last = (filled.nrows() + 1).checked_sub(length + after)?;
        let step = (last.saturating_sub(before) / TRIED).max(1);
        let places = (before..last).step_by(step);
        let room: Vec<usize> = places.filter(is_whole).collect();
        let count = room.len().min(SIMULATED);
        if count < LEAST_SIMULATED {
            return None;
        }
        let mut sum = Array2::zeros((length, bones.len()));
        let mut joints = Joints::new(rig, bones);
        for i in 0..count {
            let start = room[i * (room.len() - 1) / (count - 1)];
            let known = (start - before..start).chain(start + length..start + length + after);
            let known: Vec<usize> = known.collect();
            let at: Vec<usize> = (start..start + length).collect();
            let mut paths = Vec::with_capacity(self.channels.len());
            for &(c, is_angle) in &self.channels {
                let values = known.iter().map(|&t| filled[[t, c]]).collect();
                paths.push(path(&known, values, is_angle, &at));
            }
            for (k, &t) in at.iter().enumerate() {
                let mut frame = filled.row(t).to_vec();
                let truth = joints.places(&frame);
                for (path, (c, _)) in paths.iter().zip(&self.channels) {
                    frame[*c] = path[k];
                }
                let off = joints.places(&frame);
                for (j, (a, b)) in truth.iter().zip(off).enumerate() {
                    sum[[k, j]] += (*a - b).length_squared() / (3 * count) as f64;
                }
            }
        }
        Some(sum)
    }
}

/// Where bones end in a frame of channels.
pub(crate) struct Joints<'a> {
    rig: &'a BvhSkeleton,
    bones: &'a [usize],
    posture: Posture,
    values: Vec<f64>,
}

impl<'a> Joints<'a> {
    /// The ends of `bones`.
    pub(crate) fn new(rig: &'a BvhSkeleton, bones: &'a [usize]) -> Joints<'a> {
        Joints {
            rig,
            bones,
            posture: Posture::default(),
            values: vec![0.0; rig.skeleton.dof_count()],
        }
    }

    /// The places, cm.
    pub(crate) fn places(&mut self, frame: &[f64]) -> Vec<DVec3> {
        self.rig.values(frame, &mut self.values);
        self.rig
            .skeleton
            .posture_into(&self.values, &mut self.posture);
        self.bones.iter().map(|&b| self.posture.ends[b]).collect()
    }
}
