//! The points of a take that cannot be where they were captured: they count for nothing.
//!
//! First [`strays`] are told by time alone. Of the other points some break rigid bones; in those frames distances and the
//! model tell together which points are corrupt ([`super::treat`]), where they can.

use super::job::Job;
use super::noise::{self, shared, worth_a_search};
use super::strays;
use super::suspects::RigidBones;
use crate::par;
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// No clean point is taken for more exact, cm.
const LEAST_NOISE: f64 = 0.01;
/// So often strays are looked for, each time by the noise without those found before.
const TIMES: usize = 2;
/// Frames looked at by one piece of parallel work.
const CHUNK: usize = 8;

/// What is rejected.
pub struct Rejects {
    /// The points of each frame.
    pub points: Vec<Vec<usize>>,
    /// Those of them that time tells, which knows where they should have been too.
    pub strays: Vec<Vec<usize>>,
}

impl Rejects {
    /// Nothing of so many frames.
    pub fn none(frames: usize) -> Rejects {
        Rejects {
            points: vec![Vec::new(); frames],
            strays: vec![Vec::new(); frames],
        }
    }

    /// Of a take (frames, 3 J; cm): `runs` are the stretches of frames that follow one another, `rate` frames a second,
    /// `given` the standard deviation of a coordinate, cm, if it is known.
    pub fn find(
        job: &Job,
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        rate: f64,
        given: Option<f64>,
    ) -> Rejects {
        let mut strays: Vec<Vec<usize>> = vec![Vec::new(); xyz.nrows()];
        let mut counted = xyz.to_owned();
        let mut noise = noise::by_point(job, xyz, runs, given);
        // Strays spoil the noise too, which hides others.
        for _ in 0..TIMES {
            let before = strays.clone();
            for (strays, found) in strays
                .iter_mut()
                .zip(strays::strays(xyz, runs, rate, &noise))
            {
                // By less noise no path may be left to be off of: what was found stays.
                strays.extend(found);
                strays.sort_unstable();
                strays.dedup();
            }
            if strays == before {
                break;
            }
            counted.assign(&xyz);
            leave_out(&mut counted, &strays);
            noise = noise::by_point(job, counted.view(), runs, given);
        }
        // One point's may be garbage.
        noise.sort_by(f64::total_cmp);
        let usual = noise.get(noise.len() / 2).copied().unwrap_or(0.0);
        let bones = RigidBones::measure(&job.parents(), counted.view());
        let mut points = broken(&bones, &counted, usual);
        let looked_at = doubtful(job, &bones, &counted, &points);
        corrupt(job, &counted, usual, &looked_at, &mut points);
        for (points, strays) in points.iter_mut().zip(&strays) {
            points.extend(strays);
        }
        Rejects { points, strays }
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
fn broken(bones: &RigidBones, xyz: &Array2<f64>, noise: f64) -> Vec<Vec<usize>> {
    let parts = par::map_chunks(xyz.nrows(), 64, |range| {
        range
            .map(|t| bones.suspects(&xyz.row(t).to_vec(), noise, |_| 0.0))
            .collect::<Vec<_>>()
    });
    parts.concat()
}

/// The frames that may hold corrupt points: those with broken bones, and where not all bones are known to be rigid, those whose
/// distances tell so.
fn doubtful(job: &Job, bones: &RigidBones, xyz: &Array2<f64>, blamed: &[Vec<usize>]) -> Vec<usize> {
    let bones_tell = bones.count() > 0 && bones.count() == job.parents().iter().flatten().count();
    let is_doubtful = |t: usize| {
        let told = || job.unmeasured(&xyz.row(t).to_vec());
        !blamed[t].is_empty() || (!bones_tell && told().is_some_and(|(_, base)| base.has_outliers))
    };
    let parts = par::map_chunks(blamed.len(), 64, |range| {
        range.filter(|t| is_doubtful(*t)).collect::<Vec<_>>()
    });
    parts.concat()
}

/// Of some frames the points that are corrupt, in place of those blamed, where the model can tell.
fn corrupt(job: &Job, xyz: &Array2<f64>, noise: f64, frames: &[usize], blamed: &mut [Vec<usize>]) {
    if frames.is_empty() {
        return;
    }
    let mut sound = xyz.clone();
    leave_out(&mut sound, blamed);
    let adapted = job.prior_for(sound.view(), noise);
    let treatment = job.treatment_for(&adapted, sound.view(), noise);
    let restorer = job.restorer(&adapted).treating(&treatment);
    let found = par::map_chunks(frames.len(), CHUNK, |range| {
        let of = |t: usize| {
            let y = xyz.row(t).to_vec();
            let base = treatment.base_noise(&y).filter(worth_a_search)?;
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
