//! Rotations cleaned by themselves: the channels of a BVH or AMC file, joint by joint, without a
//! model, names or positions.
//!
//! Pops are bridged, missing rotations filled, and where the joints tremble more than a limit, and
//! by noise, all are smoothed, each as strongly as it bears. What does not change keeps its value
//! to the last bit. Slow noise, correlated over more than some frames, cannot be told from motion.
//! Frames that repeat the one before follow it; rotations that were held stay.

mod gaps;
mod movement;
mod pops;
mod smoothing;
mod tracks;
mod tuning;

pub use smoothing::Strength;

use self::gaps::{FilledGap, Gappy, Predictors};
use self::movement::Movable;
use self::pops::{bridge, pops};
use self::smoothing::{Noisy, smooth_all};
use self::tracks::{Track, tracks};
use crate::numeric::parallel;
use crate::numeric::statistics::median;
use crate::numeric::track_noise::{self, TrackNoise};
use crate::pose::JointChannels;
use crate::pose::repeated_frames::RepeatedFrames;
use glam::{DQuat, DVec3};
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// How rotations are cleaned.
#[derive(Debug, Clone, PartialEq)]
pub struct RotationCleaning {
    /// The noise over which all is smoothed: median over the joints of the standard deviation about
    /// an axis, radians. Infinite: nothing is smoothed.
    pub noise_limit: f64,
    /// Whether pops are looked for.
    pub pops: bool,
    /// Longer gaps stay, seconds.
    pub max_gap: Option<f64>,
    /// Joints, by their index, and frames in which their rotations were held: they are no
    /// measurements, and stay as they are.
    pub held: Vec<(usize, Range<usize>)>,
}

impl Default for RotationCleaning {
    fn default() -> Self {
        RotationCleaning {
            noise_limit: tuning::NOISE_LIMIT,
            pops: true,
            max_gap: None,
            held: Vec::new(),
        }
    }
}

/// Channels that were cleaned, and what was done.
#[derive(Debug, Clone, PartialEq)]
pub struct CleanedRotations {
    /// (frames, channels), radians and centimeters; NaN is missing still.
    pub motion: Array2<f64>,
    /// The noise of the file, radians: the median over the joints that move; at most that, unless
    /// `is_noise`.
    pub noise: f64,
    /// Whether it can be told from motion.
    pub is_noise: bool,
    /// What became of each joint that moves.
    pub tracks: Vec<CleanedTrack>,
}

/// What was done to a joint: its rotation, one of its angles, or its position.
#[derive(Debug, Clone, PartialEq)]
pub struct CleanedTrack {
    /// The joint's index.
    pub joint: usize,
    /// Channels.
    pub channels: Vec<usize>,
    /// Whether it is a position and no rotation.
    pub is_place: bool,
    /// The standard deviation of its noise, radians about an axis, or centimeters.
    pub noise: f64,
    /// How it was smoothed.
    pub strength: Option<Strength>,
    /// Runs of frames that were pops.
    pub pops: Vec<Range<usize>>,
    /// Gaps that were filled, and the error over gaps like each (rms, radians or cm; NaN where
    /// there are none).
    pub gaps: Vec<(Range<usize>, f64)>,
}

/// Cleans the channels of `joints` in `motion` (frames, channels; radians and centimeters; NaN is
/// missing), which has `rate` frames a second.
///
/// ```
/// use posing_core::pose::{JointChannels, rotation::Axis};
/// use posing_joints::ik::rotation_cleaning::{RotationCleaning, clean_rotations};
///
/// // A knee that bends at an even pace, with a gap of three frames.
/// let mut motion = ndarray::Array2::from_shape_fn((100, 1), |(t, _)| 0.01 * t as f64);
/// motion.slice_mut(ndarray::s![40..43, ..]).fill(f64::NAN);
/// let (angles, positions) = (vec![(0, Axis::X)], vec![]);
/// let knee = JointChannels { joint: "knee".into(), angles, positions };
/// let how = RotationCleaning::default();
/// let clean = clean_rotations(&[knee], motion.view(), 100.0, &how);
/// assert_eq!(clean.tracks[0].gaps[0].0, 40..43);
/// assert!((clean.motion[[41, 0]] - 0.41).abs() < 1e-3);
/// ```
pub fn clean_rotations(
    joints: &[JointChannels],
    motion: ArrayView2<'_, f64>,
    rate: f64,
    how: &RotationCleaning,
) -> CleanedRotations {
    let repeated = RepeatedFrames::of(motion);
    if !repeated.is_any() {
        return clean_frames(joints, motion, rate, how);
    }
    let held = how.held.iter().map(|(joint, frames)| {
        let kept = repeated.kept_runs(std::slice::from_ref(frames));
        (*joint, kept.into_iter().next().unwrap_or(0..0))
    });
    let how = RotationCleaning {
        held: held.collect(),
        ..how.clone()
    };
    let kept = repeated.rows(motion);
    let mut out = clean_frames(joints, kept.view(), repeated.rate(rate), &how);
    let cleaned = std::mem::replace(&mut out.motion, motion.to_owned());
    for ((t, c), value) in out.motion.indexed_iter_mut() {
        let k = repeated.shown[t];
        let is_same = kept[[k, c]].to_bits() == cleaned[[k, c]].to_bits();
        if !is_same || value.is_nan() {
            *value = cleaned[[k, c]];
        }
    }
    for track in &mut out.tracks {
        let gaps = track.gaps.iter_mut().map(|gap| &mut gap.0);
        for frames in track.pops.iter_mut().chain(gaps) {
            *frames = repeated.frames(frames);
        }
    }
    out
}

/// [`clean_rotations`] of frames none of which repeats the one before.
fn clean_frames(
    joints: &[JointChannels],
    motion: ArrayView2<'_, f64>,
    rate: f64,
    how: &RotationCleaning,
) -> CleanedRotations {
    let (mut rotations, mut positions) = tracks(joints, motion);
    let pops = bridge_pops(&mut rotations, rate, how.pops);
    let held: Vec<Vec<Range<usize>>> = rotations.iter().map(|t| how.held_of(t.joint)).collect();
    let counts: Vec<Vec<bool>> = (rotations.iter().zip(pops.iter().zip(&held)))
        .map(|(track, (pops, held))| counting(&track.seen, pops, held))
        .collect();
    let noise_of_all = measure(&rotations, &positions, &counts);
    let is_noise = noise_of_all.is_noise(rate);
    let measured = Measured::split(noise_of_all.variance, rotations.len());
    let moving = measured.rotations.iter().flatten().map(|v| v.sqrt());
    let noise = median(moving.collect()).unwrap_or(0.0);
    let strengths = if noise >= how.noise_limit && is_noise {
        smooth(&mut rotations, &mut positions, counts, &held, &measured)
    } else {
        Default::default()
    };
    let longest = how
        .max_gap
        .map_or(usize::MAX, |s| (s * rate + 1e-6) as usize);
    let gaps = fill(&mut rotations, &mut positions, 1.0 / rate, longest);
    let mut out = motion.to_owned();
    rotations.iter().for_each(|track| track.write(&mut out));
    positions.iter().for_each(|track| track.write(&mut out));
    let mut report = Vec::new();
    for (i, track) in rotations.iter().enumerate() {
        let noise = measured.rotations[i];
        report.extend(track.report(noise, false, strengths.0.get(i), &pops[i], &gaps.0[i]));
    }
    for (i, track) in positions.iter().enumerate() {
        let noise = measured.positions[i];
        report.extend(track.report(noise, true, strengths.1.get(i), &[], &gaps.1[i]));
    }
    CleanedRotations {
        motion: out,
        noise,
        is_noise,
        tracks: report,
    }
}

impl RotationCleaning {
    /// The frames in which a joint was held.
    fn held_of(&self, joint: usize) -> Vec<Range<usize>> {
        let own = self.held.iter().filter(|held| held.0 == joint);
        own.map(|held| held.1.clone()).collect()
    }
}

impl<M> Track<M> {
    fn report(
        &self,
        noise: Option<f64>,
        is_place: bool,
        strength: Option<&Option<Strength>>,
        pops: &[Range<usize>],
        gaps: &[FilledGap],
    ) -> Option<CleanedTrack> {
        (noise.is_some() || !pops.is_empty() || !gaps.is_empty()).then(|| CleanedTrack {
            joint: self.joint,
            channels: self.channels.iter().map(|c| c.0).collect(),
            is_place,
            noise: noise.unwrap_or(0.0).sqrt(),
            strength: strength.copied().flatten(),
            pops: pops.to_vec(),
            gaps: gaps.iter().map(|g| (g.frames.clone(), g.error)).collect(),
        })
    }
}

/// Finds the pops of each rotation and bridges them.
fn bridge_pops(rotations: &mut [Track<DQuat>], rate: f64, wanted: bool) -> Vec<Vec<Range<usize>>> {
    let found = parallel::map_chunks(rotations.len(), 1, |i| {
        let track = &rotations[i.start];
        if wanted {
            pops(&track.values, &track.seen, rate)
        } else {
            Vec::new()
        }
    });
    for (track, pops) in rotations.iter_mut().zip(&found) {
        if pops.is_empty() {
            continue;
        }
        let counts = counting(&track.seen, pops, &[]);
        bridge(&mut track.values, &counts);
        for t in pops.iter().flat_map(|run| run.clone()) {
            track.is_new[t] = true;
        }
    }
    found
}

/// Whether each frame was measured, is no pop, and was not held: the first of those was measured.
fn counting(seen: &[bool], pops: &[Range<usize>], held: &[Range<usize>]) -> Vec<bool> {
    let mut out = seen.to_vec();
    pops.iter().for_each(|run| out[run.clone()].fill(false));
    for held in held {
        let after_first = out.get_mut(held.start + 1..held.end);
        after_first
            .into_iter()
            .for_each(|frames| frames.fill(false));
    }
    out
}

/// The variance of each track that moves: rad² about an axis, or cm².
struct Measured {
    rotations: Vec<Option<f64>>,
    positions: Vec<Option<f64>>,
}

impl Measured {
    fn split(mut rotations: Vec<Option<f64>>, count: usize) -> Measured {
        let positions = rotations.split_off(count);
        Measured {
            rotations,
            positions,
        }
    }
}

/// The noise of the rotations in the frames that count, and after them of the positions.
fn measure(
    rotations: &[Track<DQuat>],
    positions: &[Track<DVec3>],
    counts: &[Vec<bool>],
) -> TrackNoise {
    let track = |rows: Vec<[f64; 4]>, counts: &[bool], scale: f64, freedoms: usize| {
        let seen = rows.into_iter().zip(counts);
        let row = |(row, counts): ([f64; 4], &bool)| {
            if *counts {
                row.map(|v| scale * v)
            } else {
                [f64::NAN; 4]
            }
        };
        track_noise::Track {
            rows: seen.map(row).collect(),
            freedoms,
        }
    };
    // A quaternion moves by half the angle.
    let rotations = rotations.iter().zip(counts);
    let rotations = rotations.map(|(t, counts)| track(t.rows(), counts, 2.0, t.freedoms()));
    let positions = positions.iter().map(|t| track(t.rows(), &t.seen, 1.0, 3));
    TrackNoise::of(&rotations.chain(positions).collect::<Vec<_>>())
}

/// Smooths all that moves, by the frames that count; what was held stays.
fn smooth(
    rotations: &mut [Track<DQuat>],
    positions: &mut [Track<DVec3>],
    mut counts: Vec<Vec<bool>>,
    held: &[Vec<Range<usize>>],
    measured: &Measured,
) -> (Vec<Option<Strength>>, Vec<Option<Strength>>) {
    counts.extend(positions.iter().map(|track| track.seen.clone()));
    let rows = (rotations.iter().map(Track::<DQuat>::rows))
        .chain(positions.iter().map(Track::<DVec3>::rows));
    // Over all coordinates of a frame; a quaternion's are those of half the angle.
    let of_rotations = rotations.iter().zip(&measured.rotations);
    let noise = of_rotations
        .map(|(track, v)| v.unwrap_or(0.0) / 4.0 * track.freedoms() as f64)
        .chain(measured.positions.iter().map(|v| 3.0 * v.unwrap_or(0.0)));
    let noisy: Vec<Noisy<'_>> = rows
        .zip(&counts)
        .zip(noise)
        .map(|((values, counts), noise)| Noisy {
            values,
            counts,
            noise,
        })
        .collect();
    let mut strengths = Vec::new();
    for (i, smoothed) in smooth_all(&noisy).into_iter().enumerate() {
        strengths.push(smoothed.as_ref().map(|s| s.1));
        let Some((smooth, _)) = smoothed else {
            continue;
        };
        match i.checked_sub(rotations.len()) {
            None => rotations[i].take(&smooth, &held[i], |q| DQuat::from_array(q).normalize()),
            Some(i) => positions[i].take(&smooth, &[], |p| DVec3::new(p[0], p[1], p[2])),
        }
    }
    let of_positions = strengths.split_off(rotations.len());
    (strengths, of_positions)
}

impl<M: Copy> Track<M> {
    /// Takes new values in all frames that are seen and not `held`.
    fn take(&mut self, rows: &[[f64; 4]], held: &[Range<usize>], value: impl Fn([f64; 4]) -> M) {
        let is_held = |t: usize| held.iter().any(|held| held.contains(&t));
        for (t, row) in rows.iter().enumerate().filter(|(t, _)| !is_held(*t)) {
            self.values[t] = value(*row);
            self.is_new[t] |= self.seen[t];
        }
    }
}

/// Fills the gaps of no more than `longest` frames; `step`: seconds a frame.
fn fill(
    rotations: &mut [Track<DQuat>],
    positions: &mut [Track<DVec3>],
    step: f64,
    longest: usize,
) -> (Vec<Vec<FilledGap>>, Vec<Vec<FilledGap>>) {
    let is_whole = |seen: &[bool]| !seen.contains(&false);
    let all_whole =
        rotations.iter().all(|t| is_whole(&t.seen)) && positions.iter().all(|t| is_whole(&t.seen));
    if all_whole {
        return (
            vec![Vec::new(); rotations.len()],
            vec![Vec::new(); positions.len()],
        );
    }
    let frames = rotations.first().map_or(0, |t| t.seen.len());
    let others: Vec<(&[DQuat], &[bool], usize)> = (rotations.iter())
        .map(|t| (&t.values[..], &t.seen[..], t.freedoms()))
        .collect();
    let predictors = Predictors::new(&others, frames);
    let of_rotations = parallel::map_chunks(rotations.len(), 1, |i| {
        rotations[i.start].filled(&predictors, Some(i.start), step, longest)
    });
    let of_positions = parallel::map_chunks(positions.len(), 1, |i| {
        positions[i.start].filled(&predictors, None, step, longest)
    });
    (put(rotations, of_rotations), put(positions, of_positions))
}

impl<M: Movable> Track<M> {
    fn filled(
        &self,
        predictors: &Predictors,
        own: Option<usize>,
        step: f64,
        longest: usize,
    ) -> Vec<(FilledGap, Vec<M>)> {
        let gappy = Gappy {
            values: &self.values,
            seen: &self.seen,
            predictors,
            own,
            step,
        };
        gappy.fill(longest)
    }
}

/// Puts what fills the gaps into each track.
fn put<M: Copy>(
    tracks: &mut [Track<M>],
    filled: Vec<Vec<(FilledGap, Vec<M>)>>,
) -> Vec<Vec<FilledGap>> {
    let put_one = |(track, filled): (&mut Track<M>, Vec<(FilledGap, Vec<M>)>)| {
        let mut out = Vec::new();
        for (gap, values) in filled {
            track.values[gap.frames.clone()].copy_from_slice(&values);
            track.is_new[gap.frames.clone()].fill(true);
            out.push(gap);
        }
        out
    };
    tracks.iter_mut().zip(filled).map(put_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use ndarray::s;
    use rand_distr::{Distribution, Normal};

    /// A root with a position, five ball joints and a hinge.
    fn joints() -> Vec<JointChannels> {
        let ball = |first: usize| {
            let axes = [Axis::Z, Axis::X, Axis::Y].into_iter();
            axes.enumerate()
                .map(|(i, axis)| (first + i, axis))
                .collect()
        };
        let joint = |joint: &str, angles, positions| JointChannels {
            joint: joint.to_string(),
            angles,
            positions,
        };
        vec![
            joint(
                "root",
                ball(3),
                vec![(0, Axis::X), (1, Axis::Y), (2, Axis::Z)],
            ),
            joint("arm", ball(6), Vec::new()),
            joint("elbow", vec![(9, Axis::X)], Vec::new()),
            joint("chest", ball(10), Vec::new()),
            joint("leg", ball(13), Vec::new()),
            joint("foot", ball(16), Vec::new()),
        ]
    }

    /// Their motion, with noise of so many degrees.
    fn motion(frames: usize, noise: f64) -> Array2<f64> {
        let mut random = parallel::rng(5, 0);
        let normal = Normal::new(0.0, noise.to_radians().max(1e-12)).unwrap();
        Array2::from_shape_fn((frames, 19), |(t, c)| {
            let way = (0.04 * t as f64 + 0.7 * c as f64).sin();
            match c {
                0..3 => 20.0 * way + 5.0 * normal.sample(&mut random),
                _ => 0.6 * way + normal.sample(&mut random),
            }
        })
    }

    fn cleaned(motion: &Array2<f64>) -> CleanedRotations {
        clean_rotations(&joints(), motion.view(), 60.0, &RotationCleaning::default())
    }

    fn error(a: &Array2<f64>, b: &Array2<f64>) -> f64 {
        ((a - b).mapv(|d| d * d).mean().unwrap_or(0.0)).sqrt()
    }

    #[test]
    fn a_clean_file_stays_to_the_last_bit_and_a_noisy_one_comes_nearer() {
        let truth = motion(400, 0.0);
        let same = cleaned(&truth);
        assert_eq!(same.motion, truth);
        assert!(same.noise < 0.001 && same.tracks.iter().all(|t| t.strength.is_none()));
        let noisy = motion(400, 1.0);
        let better = cleaned(&noisy);
        assert!(
            (0.8..1.2).contains(&better.noise.to_degrees()),
            "{}",
            better.noise
        );
        let (before, after) = (error(&noisy, &truth), error(&better.motion, &truth));
        assert!(after < 0.4 * before, "{after} {before}");
        let off = RotationCleaning {
            noise_limit: f64::INFINITY,
            ..RotationCleaning::default()
        };
        let left = clean_rotations(&joints(), noisy.view(), 60.0, &off);
        assert_eq!(left.motion, noisy);
    }

    #[test]
    fn only_what_is_missing_or_pops_changes_in_a_clean_file() {
        let truth = motion(400, 0.0);
        let mut file = truth.clone();
        file.slice_mut(s![100..110, 6..9]).fill(f64::NAN);
        file.slice_mut(s![200..205, 7]).fill(f64::NAN);
        file.slice_mut(s![300..304, 0..3]).fill(f64::NAN);
        file.slice_mut(s![0..4, 9]).fill(f64::NAN);
        file[[250, 9]] += 1.0;
        let result = cleaned(&file);
        for ((t, c), value) in result.motion.indexed_iter() {
            let is_changed = file[[t, c]].is_nan() || (t, c) == (250, 9);
            assert!(is_changed || *value == file[[t, c]], "{t} {c}");
            let most = if c < 3 { 1.0 } else { 0.05 };
            assert!((value - truth[[t, c]]).abs() < most, "{t} {c}: {value}");
        }
        let elbow = result.tracks.iter().find(|t| t.channels == [9]).unwrap();
        assert_eq!(elbow.pops.len(), 1);
        assert_eq!(elbow.pops[0], 250..251);
        assert_eq!(elbow.gaps[0].0, 0..4);
        // Longer gaps stay.
        let short = RotationCleaning {
            max_gap: Some(0.1),
            ..RotationCleaning::default()
        };
        let left = clean_rotations(&joints(), file.view(), 60.0, &short).motion;
        assert!(left[[105, 6]].is_nan() && left[[202, 7]].is_finite());
    }

    #[test]
    fn odd_files_are_cleaned_too() {
        for frames in [0, 1, 2, 5, 12] {
            for noise in [0.0, 3.0] {
                let mut file = motion(frames, noise);
                assert_eq!(cleaned(&file).motion.dim(), (frames, 19));
                file.slice_mut(s![.., 6]).fill(f64::NAN);
                let left = cleaned(&file).motion;
                assert!(left.column(6).iter().all(|v| v.is_nan()));
                assert_eq!(left.column(7), file.column(7));
                file.fill(f64::NAN);
                assert!(cleaned(&file).motion.iter().all(|v| v.is_nan()));
                file.fill(1e300);
                cleaned(&file);
            }
        }
        let nothing = clean_rotations(&[], Array2::zeros((9, 0)).view(), 60.0, &Default::default());
        assert!(nothing.tracks.is_empty() && nothing.noise == 0.0);
    }
}
