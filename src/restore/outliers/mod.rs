//! The points of a take that cannot be where they were captured: they count for nothing.
//!
//! First [`spikes`] are told by time alone. Of the other points some break rigid bones; in those frames distances and the
//! model tell together which points are corrupt ([`super::treat`]), where they can.

mod assignment;
mod bone_lengths;
pub mod frame_posterior;
mod frame_state;
mod leave_one_out;
mod rescoring;
pub mod rigid_likelihood;
mod trajectory;

use crate::numeric::parallel;
use crate::restore::bound_model::BoundModel;
use crate::restore::noise_estimation::{self, shared};
use bone_lengths::RigidBones;
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// No clean point is taken for more exact, cm.
const LEAST_NOISE: f64 = 0.01;
/// So often strays are looked for, each time by the noise without those found before.
const TIMES: usize = 2;
/// So many frames on either side tell of a frame too. (Not seconds: each is a measurement of its own.)
const NEAR: usize = 10;
/// Nats that are enough: of a frame by itself, of it and its neighbours, and of the neighbours on each side where it tells
/// nothing itself.
const ALONE: f64 = 3.0;
const TOGETHER: f64 = 8.0;
const EITHER_SIDE: f64 = 5.0;
/// Frames looked at by one piece of parallel work.
const CHUNK: usize = 8;

/// What is rejected.
pub struct Outliers {
    /// The points of each frame.
    pub points: Vec<Vec<usize>>,
    /// Those of them that time tells, which knows where they should have been too.
    pub spikes: Vec<Vec<usize>>,
}

impl Outliers {
    /// Nothing of so many frames.
    pub fn none(frames: usize) -> Outliers {
        Outliers {
            points: vec![Vec::new(); frames],
            spikes: vec![Vec::new(); frames],
        }
    }

    /// Of a take (frames, 3 J; cm): `runs` are the stretches of frames that follow one another, `rate` frames a second,
    /// `given` the standard deviation of a coordinate, cm, if it is known.
    pub fn find(
        bound: &BoundModel,
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        rate: f64,
        given: Option<f64>,
    ) -> Outliers {
        let mut spikes: Vec<Vec<usize>> = vec![Vec::new(); xyz.nrows()];
        let mut counted = xyz.to_owned();
        let mut noise = noise_estimation::by_point(bound, xyz, runs, given);
        // Strays spoil the noise too, which hides others.
        for _ in 0..TIMES {
            let before = spikes.clone();
            for (spikes, found) in spikes
                .iter_mut()
                .zip(trajectory::spikes(xyz, runs, rate, &noise))
            {
                // By less noise no path may be left to be off of: what was found stays.
                spikes.extend(found);
                spikes.sort_unstable();
                spikes.dedup();
            }
            if spikes == before {
                break;
            }
            counted.assign(&xyz);
            leave_out(&mut counted, &spikes);
            noise = noise_estimation::by_point(bound, counted.view(), runs, given);
        }
        // One point's may be garbage.
        noise.sort_by(f64::total_cmp);
        let usual = noise.get(noise.len() / 2).copied().unwrap_or(0.0);
        let bones = RigidBones::measure(&bound.parents(), counted.view());
        let mut points = broken_bones(&bones, &counted, usual);
        let looked_at = frames_to_search(bound, &bones, &counted, runs, &points);
        corrupt(bound, &counted, usual, &looked_at, &mut points);
        for (points, spikes) in points.iter_mut().zip(&spikes) {
            points.extend(spikes);
        }
        Outliers { points, spikes }
    }
}

/// Points of each frame become missing.
pub fn leave_out(xyz: &mut Array2<f64>, points: &[Vec<usize>]) {
    for (t, points) in points.iter().enumerate() {
        for &p in points {
            xyz.slice_mut(s![t, 3 * p..3 * p + 3]).fill(f64::NAN);
        }
    }
}

/// The points of each frame that are blamed for broken bones.
fn broken_bones(bones: &RigidBones, xyz: &Array2<f64>, noise: f64) -> Vec<Vec<usize>> {
    let parts = parallel::map_chunks(xyz.nrows(), 64, |range| {
        range
            .map(|t| bones.outliers(&xyz.row(t).to_vec(), noise, |_| 0.0))
            .collect::<Vec<_>>()
    });
    parts.concat()
}

/// The frames that may hold corrupt points: those with broken bones, and where not all bones are known to be rigid, those whose
/// distances tell so, with those of their neighbours.
fn frames_to_search(
    bound: &BoundModel,
    bones: &RigidBones,
    xyz: &Array2<f64>,
    runs: &[Range<usize>],
    blamed: &[Vec<usize>],
) -> Vec<usize> {
    let bones_tell = bones.count() > 0 && bones.count() == bound.parents().iter().flatten().count();
    let noise_variance = if bones_tell {
        vec![false; blamed.len()]
    } else {
        let odds = parallel::map_chunks(xyz.nrows(), 64, |range| {
            let of = |t: usize| bound.noise_floor_of(&xyz.row(t).to_vec());
            let odds = range.map(|t| of(t).map_or(0.0, |(_, base)| base.odds.max(0.0)));
            odds.collect::<Vec<f64>>()
        });
        pooled_over_time(&odds.concat(), runs)
    };
    let is_doubtful = |t: &usize| noise_variance[*t] || !blamed[*t].is_empty();
    (0..blamed.len()).filter(is_doubtful).collect()
}

/// Which frames hold corrupt points, by the odds (nats, not negative) that each has of it by itself.
///
/// By much noise distances tell so of one frame in eight where no point is off, and then of one by itself; a point that is off,
/// but for a moment that time tells, is so in frames that follow one another, some of which do not tell.
fn pooled_over_time(odds: &[f64], runs: &[Range<usize>]) -> Vec<bool> {
    let mut noise_variance = vec![false; odds.len()];
    for run in runs {
        for t in run.clone() {
            let sum = |frames: Range<usize>| odds[frames].iter().sum::<f64>();
            let before = sum(t.saturating_sub(NEAR).max(run.start)..t);
            let after = sum(t + 1..run.end.min(t + NEAR + 1));
            noise_variance[t] = match odds[t] > 0.0 {
                true => odds[t] >= ALONE || before + odds[t] + after >= TOGETHER,
                false => before.min(after) >= EITHER_SIDE,
            };
        }
    }
    noise_variance
}

/// Of some frames the points that are corrupt, in place of those blamed, where the model can tell.
fn corrupt(
    bound: &BoundModel,
    xyz: &Array2<f64>,
    noise: f64,
    frames: &[usize],
    blamed: &mut [Vec<usize>],
) {
    if frames.is_empty() {
        return;
    }
    let mut sound = xyz.clone();
    leave_out(&mut sound, blamed);
    let adapted = bound.prior_for(sound.view(), noise);
    let rigid = bound.treatment_for(&adapted, sound.view(), noise);
    let restorer = bound.restorer(&adapted).with_rigid_model(&rigid);
    let found = parallel::map_chunks(frames.len(), CHUNK, |range| {
        let of = |t: usize| {
            let y = xyz.row(t).to_vec();
            let base = rigid.noise_floor(&y)?;
            let base = shared(base.sd.min(noise.max(LEAST_NOISE)));
            let corrupt = restorer.restore_outliers(&y, base * base)?.1;
            Some((0..corrupt.len()).filter(|p| corrupt[*p] > 0.5).collect())
        };
        frames[range]
            .iter()
            .map(|t| of(*t))
            .collect::<Vec<Option<Vec<usize>>>>()
    });
    for (&t, found) in frames.iter().zip(found.into_iter().flatten()) {
        if let Some(found) = found {
            blamed[t] = found;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_tell_of_corrupt_points_together_with_their_neighbours() {
        let mut odds = vec![0.0; 200];
        // Now and then by noise, and once for sure.
        (0..60).step_by(7).for_each(|t| odds[t] = 0.8);
        odds[40] = 4.0;
        // For a while, though not in all of it; up to the end of a run.
        (90..110).for_each(|t| odds[t] = 2.0 * f64::from(u8::from(t % 3 != 0)));
        (145..150).for_each(|t| odds[t] = 2.5);
        let noise_variance = pooled_over_time(&odds, &[0..150, 150..200]);
        let noise_variance: Vec<usize> = (0..200).filter(|t| noise_variance[*t]).collect();
        // At its ends a frame that does not tell has too little on one side.
        let a_while = [91, 92].into_iter().chain(94..108).chain([109]);
        let want: Vec<usize> = [40].into_iter().chain(a_while).chain(145..150).collect();
        assert_eq!(noise_variance, want);
    }
}
