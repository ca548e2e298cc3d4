//! Keypoints of video restored: joints whose noise is slow and largest along the line of sight.
//!
//! Noise that changes slowly looks like motion, but for one thing: it changes the lengths of bones.
//!
//! 1. `skeleton` knows the bones between the points by their names, and how much of what trembles
//!    in their ends trembles in their lengths: all of it where it is noise, nothing where it is
//!    motion. Joints without such noise are left to the other methods.
//! 2. Left and right that were exchanged are put back (`exchanged`), points that jump are taken
//!    out, gaps filled (`complete`).
//! 3. `bands` keeps of each band of frequencies what is more than noise, where and when it is.
//! 4. The bones are drawn to their lengths, as slowly as the noise is.
//! 5. `stances` holds feet where they stand.

mod bands;
mod filtered_take;
mod jumps;
mod line_of_sight;
mod skeleton;
mod stances;
mod tuning;

use super::complete::Complete;
use super::denoise::Denoise;
use super::exchanged::{Exchanged, put_back};
use super::outliers::spikes_by_time;
use super::take::{Method, PointMapping, Take, TakeResult, without};
use crate::numeric::statistics::median;
use crate::pose::foot_contacts::fade;
use crate::pose::repeated_frames::RepeatedFrames;
use crate::pose::{FillMethod, Poses, Status, point_at, ranges};
use filtered_take::FilteredTake;
use glam::DVec3;
use jumps::jumps;
use ndarray::Array2;
use skeleton::{Lengths, Noise, Skeleton};
use std::ops::Range;
use tuning::*;

/// The joints of a take, which a map names and the lengths of whose bones tremble.
pub(crate) struct Keypoints<'a, 't> {
    take: &'a Take<'t>,
    skeleton: Skeleton,
    noise: Noise,
}

/// Standard deviation of the fast noise of a coordinate, cm, of `poses` whose points are called as
/// CMU's joints in `names`: that of the take with the least. `None` where the lengths of bones do
/// not tell it in every take, or it is motion.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_restore::keypoint_noise;
///
/// // Points of no body.
/// let poses = Poses { points: vec!["knee".into()], xyz: ndarray::Array2::zeros((90, 3)),
///     ..Poses::default() };
/// assert_eq!(keypoint_noise(&poses, &poses.points), None);
/// ```
pub fn keypoint_noise(poses: &Poses, names: &[String]) -> Option<f64> {
    let of_take = |frames: Range<usize>| {
        let take = poses.slice(frames);
        let repeated = RepeatedFrames::at_their_times(take.xyz.view());
        let rate = repeated.rate(take.rate().unwrap_or(LEAST_RATE));
        let rows = repeated.rows(take.xyz.view());
        let skeleton = Skeleton::of(names, rows.view()).filter(|_| rate >= LEAST_RATE)?;
        let noise = skeleton.noise(rows.view(), &repeated.kept_runs(&take.runs()))?;
        Some(noise.sd)
    };
    let takes: Option<Vec<f64>> = poses.takes().into_iter().map(of_take).collect();
    takes?.into_iter().min_by(f64::total_cmp)
}

impl<'a, 't> Keypoints<'a, 't> {
    /// The joints of a take, if the fast noise of a coordinate is over `limit`, cm, and is no
    /// motion.
    pub(crate) fn find(take: &'a Take<'t>, limit: f64) -> Option<Keypoints<'a, 't>> {
        let skeleton = Skeleton::of(take.names, take.xyz).filter(|_| take.rate >= LEAST_RATE)?;
        let noise = skeleton.noise(take.xyz, take.runs)?;
        (noise.sd > limit).then_some(Keypoints {
            take,
            skeleton,
            noise,
        })
    }

    /// The restored take. White noise `denoise` removes, by what a model knows of bodies; slow
    /// noise, which would stay, goes by the bands of each track.
    pub(crate) fn restore(
        &self,
        mapping: &PointMapping<'_>,
        methods: (&Complete, &Denoise),
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult {
        let (complete, denoise) = methods;
        if self.noise.lag < SLOW {
            let mut out = denoise.restore_take(Some(mapping), self.take, done);
            out.doubtful_noise = None;
            if let Some(filtered) = FilteredTake::of(self.take.xyz, self.take) {
                let lengths = self.skeleton.lengths(out.xyz.view());
                let known = out.states.iter().map(|state| state.sd);
                let sd = median(known.filter(|sd| sd.is_finite()).collect()).unwrap_or(0.0);
                self.hold_feet(&mut out, &lengths, &filtered, DVec3::splat(sd));
            }
            return out;
        }
        self.restore_slow(mapping, complete, denoise.outliers, done)
    }

    /// The take without its slow noise.
    fn restore_slow(
        &self,
        mapping: &PointMapping<'_>,
        complete: &Complete,
        outliers: bool,
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult {
        let take = self.take;
        let mut exchanged = Exchanged::none(take.xyz);
        let mut spikes = vec![Vec::new(); take.xyz.nrows()];
        if outliers {
            // Spikes are on the way to the other side at times.
            let seen = without(take.xyz, &spikes_by_time(take, None));
            exchanged = put_back(&take.with_xyz(seen.view()), take.xyz, self.noise.sd);
            spikes = jumps(&take.with_xyz(exchanged.xyz.view()));
        }
        let seen = without(exchanged.xyz.view(), &spikes);
        let sd = Array2::from_elem((take.xyz.nrows(), take.names.len()), self.noise.sd);
        let seen = Take {
            sd: Some(sd.view()),
            ..take.with_xyz(seen.view())
        };
        let mut out = complete.restore_take(Some(mapping), &seen, done);
        if !outliers {
            // They are left, and smoothed as all else.
            let rejected = out
                .states
                .iter_mut()
                .filter(|s| s.status == Status::Rejected);
            rejected.for_each(|state| state.status = Status::Observed);
        }
        if let Some(filtered) = FilteredTake::of(out.xyz.view(), take) {
            self.smooth(&mut out, &filtered);
        }
        self.tell(&mut out, &exchanged, &spikes);
        out
    }

    /// Smooths the points, draws bones to their lengths, and holds the feet.
    fn smooth(&self, out: &mut TakeResult, filtered: &FilteredTake) {
        filtered.put(&mut out.xyz);
        let lengths = self.skeleton.lengths(out.xyz.view());
        let covariance = filtered.covariance();
        let scale = lengths.scale(out.xyz.view(), covariance);
        let sd = (scale * filtered.variance.element_sum() / 3.0).sqrt();
        let held = lengths.hold(out.xyz.view(), covariance, |_, _| false);
        self.add_slowly(out, &held, &filtered.pieces);
        let along = (scale * filtered.variance).map(f64::sqrt);
        self.hold_feet(out, &lengths, filtered, along);
        for state in &mut out.states {
            state.sd = match state.status {
                Status::Unknown => f64::NAN,
                Status::Inferred | Status::Rejected => sd.max(OF_FILL * state.sd),
                _ => sd,
            };
        }
        (out.noise, out.noise_left) = (self.noise.sd, sd);
    }

    /// Holds both feet; `sd` is the standard deviation of what noise is left along each axis, cm.
    fn hold_feet(
        &self,
        out: &mut TakeResult,
        lengths: &Lengths,
        filtered: &FilteredTake,
        sd: DVec3,
    ) {
        for side in [0, 1] {
            let leg = self.skeleton.leg(lengths, side);
            self.hold_foot(out, side, &leg, (filtered, STANCE_RADIUS * sd));
        }
    }

    /// Holds the points of a foot where they stand, and its leg's bones to their lengths meanwhile.
    fn hold_foot(
        &self,
        out: &mut TakeResult,
        side: usize,
        leg: &Lengths,
        (filtered, radius): (&FilteredTake, DVec3),
    ) {
        let (axes, pieces) = (filtered.axes, &filtered.pieces);
        let (rate, points) = (self.take.rate, out.points());
        let mut stands = vec![false; out.states.len()];
        for (p, frames) in pieces
            .iter()
            .filter(|(p, _)| self.skeleton.feet[side].contains(p))
        {
            let stances = stances::hold(&mut out.xyz, *p, frames.clone(), rate, axes, radius);
            for t in stances.into_iter().flatten() {
                stands[t * points + p] = true;
                out.states[t * points + p].method = Some(FillMethod::Contact);
            }
        }
        let held = leg.hold(out.xyz.view(), filtered.covariance(), |t, p| {
            stands[t * points + p]
        });
        let any = |t: &usize| stands[t * points..(t + 1) * points].contains(&true);
        let frames = out.xyz.nrows();
        let mut weights: Vec<f64> = (0..frames).map(|t| f64::from(u8::from(any(&t)))).collect();
        let stances = ranges((0..frames).filter(any));
        fade(
            &stances,
            (FADE * rate).round() as usize,
            &mut vec![DVec3::ZERO; frames],
            &mut weights,
        );
        let weighed = Array2::from_shape_fn(held.dim(), |(t, i)| {
            out.xyz[[t, i]] + weights[t] * (held[[t, i]] - out.xyz[[t, i]])
        });
        let standing = out.xyz.clone();
        self.add_slowly(out, &weighed, pieces);
        for (n, _) in stands.iter().enumerate().filter(|(_, stands)| **stands) {
            let (t, p) = (n / points, n % points);
            put(&mut out.xyz, t, p, point_at(standing.view(), t, p));
        }
    }

    /// Moves the points to where their bones have one length, as slowly as noise changes: what is
    /// fast in that is motion that was lost at one end of a bone.
    fn add_slowly(
        &self,
        out: &mut TakeResult,
        held: &Array2<f64>,
        pieces: &[(usize, Range<usize>)],
    ) {
        for (p, frames) in pieces {
            let now = |t: usize| point_at(out.xyz.view(), t, *p);
            let by = frames
                .clone()
                .map(|t| point_at(held.view(), t, *p) - now(t));
            let by = bands::low_passed(by.collect(), LENGTHS_CUTOFF, self.take.rate);
            for (t, by) in frames.clone().zip(by) {
                let now = point_at(out.xyz.view(), t, *p);
                put(&mut out.xyz, t, *p, now + by);
            }
        }
    }

    /// Says of each point what became of it.
    fn tell(&self, out: &mut TakeResult, exchanged: &Exchanged, spikes: &[Vec<usize>]) {
        for t in 0..out.xyz.nrows() {
            for p in 0..out.points() {
                let (is, was) = [&out.xyz, &exchanged.xyz]
                    .map(|xyz| point_at(xyz.view(), t, p))
                    .into();
                let status = match out.state(t, p).status {
                    Status::Inferred if spikes[t].contains(&p) => Status::Rejected,
                    Status::Observed if is != was => Status::Changed,
                    status => status,
                };
                let at = t * out.points() + p;
                out.states[at].status = status;
            }
        }
        out.exchanged = exchanged.count;
        out.vacate(&exchanged.emptied);
    }
}

fn put(xyz: &mut Array2<f64>, frame: usize, point: usize, at: DVec3) {
    (0..3).for_each(|axis| xyz[[frame, 3 * point + axis]] = at[axis]);
}

#[cfg(test)]
mod tests;
