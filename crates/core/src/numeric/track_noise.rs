//! How much of what trembles in the tracks of a take is noise: positions, or rotations.
//!
//! The fourth difference of a track, D⁴y, holds hardly any motion and √70 times the white noise.
//! Where frames are few a second it holds motion too. That comes and goes in all tracks together;
//! noise does not:
//!
//! ```text
//! e_c(t) = |D⁴y_c|² / (70 d_c)          power of track c, of d_c free coordinates
//! z_c(t) = log e_c(t), less its median (for `common`: less its mean over a second)
//! u_c    = lower quartile of e_c where the other tracks are quiet, over that of χ²_d / d
//! τ      = Σ_{i≠j} w_i w_j cov(z_i, z_j) / Σ_{i≠j} w_i w_j         w_c = 1 / ψ′(d_c / 2)
//! common = max(τ, 0) + 2 s.e.,          s.e. = 2 / (√T Σ w)        T frames
//! ```
//!
//! u_c is the variance of the noise of a coordinate. It is read where the other tracks are quiet,
//! so that neither motion nor the track's own noise selects the frames (in all frames, where that
//! is the same); a quartile, as spikes in a fifth of the frames spoil most differences. `common`
//! tells whether that level is noise: white noise shows .01 to .05, motion alone more.
//! Frames that repeat the one before have to be left out: they hold no measurement.
//!
//! Measured on 62 CMU takes, whole or low-passed, at ten rates from 8 to 120 frames a second and
//! with three kinds of held frames: none of 1,612 files is smoothed. Noise of .2 cm or one degree
//! is found in all of 12 takes at 60 and 120, in 10 at 30, where the others have under 60 frames.
//! Tried beside it, and left out, as they changed neither: the variance of z, a share of the level
//! that is sure.
//!
//! Noise that is common to all tracks, or changes slowly, looks like motion.

use super::statistics::{less_local_mean, median, quantile};
use std::f64::consts::PI;

/// Share of the frames that are quiet.
const QUIET: f64 = 0.3;
/// Where the level is this share of that of all frames in the median track, or more, all is noise,
/// and the level of all frames is the better one: with a third of them points differ by chance.
const ALL_NOISE: f64 = 0.9;
/// Frames that a level is read from, at least.
const LEAST_FOR_LEVEL: usize = 8;
/// Noise shows at most this much power in common, squared nats: at 30 frames a second and one
/// degree .03 in nine of ten takes, .05 in 98%; motion alone at least .072.
const MOST_COMMON: f64 = 0.05;
/// Seconds over which log power is compared with its mean: noise may grow as a person walks away.
const SECONDS: f64 = 1.0;
/// Differences and tracks by which noise is told from motion, at least: of 762 readings of the
/// rotations of motion alone at 10 to 30 frames a second, 6 of 31 to 46 differences show less power
/// in common than the limit; the least of 60 and more is .067.
const LEAST_FRAMES: f64 = 60.0;
const LEAST_TRACKS: usize = 6;
/// Frames a second below which motion changes from one to the next as faults do: takes of 4 to 8
/// show as little power in common as noise, and labels of key poses at 4 seem exchanged.
pub const LEAST_RATE: f64 = 9.5;
/// Log power further off its median counts as this, nats: a value that is held, and a spike.
const LOWEST: f64 = -4.0;
const HIGHEST: f64 = 6.0;
/// Tracks with less power, cm² or radians², in more than this share of their frames hold a value
/// that rarely changes.
const NO_POWER: f64 = 1e-14;
const RESTING: f64 = 0.3;

/// A track: positions, cm, or unit quaternions of one sign doubled, whose steps are those of the
/// rotation, radians.
pub struct Track {
    /// (frames, 4): NaN where missing, and between runs; unused coordinates are 0.
    pub rows: Vec<[f64; 4]>,
    /// How many coordinates are free: 1, 2 or 3.
    pub freedoms: usize,
}

/// The noise of some tracks.
pub struct TrackNoise {
    /// The variance of a coordinate of each track's noise, cm² or radians², if it is noise; `None`
    /// for one that is too short, or never moves.
    pub variance: Vec<Option<f64>>,
    /// What the variance of each is at most: that of all frames, with any motion in it.
    pub most: Vec<Option<f64>>,
    powers: Vec<Power>,
}

impl TrackNoise {
    /// Measures tracks of as many frames each.
    pub fn of(tracks: &[Track]) -> TrackNoise {
        let mut most = vec![None; tracks.len()];
        let mut powers = Vec::new();
        for (c, track) in tracks.iter().enumerate() {
            let power = Power::of(c, track);
            most[c] = power.level(&power.power).filter(|_| power.is_any());
            // A value that rarely changes tells of no other track.
            if !power.is_resting() {
                powers.push(power);
            }
        }
        let sums = Sums::of(&powers);
        let quiet = |power: &Power| Some((power.track, power.level(&power.quiet(&sums))?));
        let quiet: Vec<(usize, f64)> = powers.iter().filter_map(quiet).collect();
        let shares = quiet
            .iter()
            .filter_map(|(c, quiet)| Some(quiet / most[*c]?));
        let is_all_noise = median(shares.collect()).is_some_and(|share| share >= ALL_NOISE);
        let mut variance = most.clone();
        for (c, quiet) in quiet.into_iter().filter(|_| !is_all_noise) {
            variance[c] = Some(quiet);
        }
        TrackNoise {
            variance,
            most,
            powers,
        }
    }

    /// The median of the tracks' variances; 0 for none.
    pub fn typical(&self) -> f64 {
        median(self.variance.iter().flatten().copied().collect()).unwrap_or(0.0)
    }

    /// Whether what the variances measure is noise, and no motion; `rate`: frames of the take a
    /// second.
    pub fn is_noise(&self, rate: f64) -> bool {
        let common = self.common(rate).filter(|_| rate >= LEAST_RATE);
        common.is_some_and(|common| common <= MOST_COMMON)
    }

    /// The upper bound of the power that the tracks have in common, squared nats; `None` where too
    /// few frames or tracks tell.
    fn common(&self, rate: f64) -> Option<f64> {
        if self.powers.len() < LEAST_TRACKS {
            return None;
        }
        let reach = (SECONDS * rate / 2.0) as usize;
        // For each frame: Σ w z, Σ (w z)², Σ w, Σ w².
        let mut sums = vec![[0.0; 4]; self.powers[0].log.len()];
        for power in &self.powers {
            let w = power.weight;
            for (sum, z) in sums.iter_mut().zip(less_local_mean(&power.log, reach)) {
                if z.is_finite() {
                    let terms = [w * z, (w * z).powi(2), w, w * w];
                    (0..4).for_each(|i| sum[i] += terms[i]);
                }
            }
        }
        let (mut shared, mut pairs, mut weight, mut told) = (0.0, 0.0, 0.0, 0.0);
        for [z, own, w, square] in sums {
            shared += z * z - own;
            pairs += w * w - square;
            weight += w;
            told += f64::from(u8::from(w > 0.0));
        }
        let error = 2.0 * told.sqrt() / weight;
        (pairs > 0.0 && told >= LEAST_FRAMES).then(|| (shared / pairs).max(0.0) + 2.0 * error)
    }
}

/// The power of a track in its fourth differences.
struct Power {
    track: usize,
    freedoms: usize,
    /// By frame but the last four, NaN where missing.
    power: Vec<f64>,
    /// Its logarithm less its median, nats.
    log: Vec<f64>,
    weight: f64,
}

impl Power {
    fn of(track: usize, of: &Track) -> Power {
        let power = |y: &[[f64; 4]]| {
            let d = |c: usize| y[0][c] - 4.0 * y[1][c] + 6.0 * y[2][c] - 4.0 * y[3][c] + y[4][c];
            (0..4).map(|c| d(c).powi(2)).sum::<f64>() / (70.0 * of.freedoms as f64)
        };
        let power: Vec<f64> = of.rows.windows(5).map(power).collect();
        let seen = power.iter().copied().filter(|e| e.is_finite());
        let typical = median(seen.collect()).map_or(0.0, f64::ln);
        let log = (power.iter()).map(|e| (e.ln() - typical).clamp(LOWEST, HIGHEST));
        Power {
            track,
            freedoms: of.freedoms,
            log: log.collect(),
            power,
            weight: 1.0 / log_variance(of.freedoms),
        }
    }

    fn is_any(&self) -> bool {
        self.power.iter().any(|e| *e > NO_POWER)
    }

    /// Whether there is no power in many of the frames, or none is seen.
    fn is_resting(&self) -> bool {
        let seen = self.power.iter().filter(|e| e.is_finite());
        let (resting, all) = seen.fold((0usize, 0usize), |(resting, all), e| {
            (resting + usize::from(*e <= NO_POWER), all + 1)
        });
        all == 0 || resting as f64 > RESTING * all as f64
    }

    /// The power where the other tracks are quiet.
    fn quiet(&self, all: &Sums) -> Vec<f64> {
        // The mean of the others; alone, all frames are alike.
        let others = |t: usize| {
            let (sum, weight) = all.at(t);
            let rest = weight - self.weight;
            if rest > 1e-9 * weight {
                (sum - self.weight * self.log[t]) / rest
            } else {
                0.0
            }
        };
        let seen = (0..self.power.len()).filter(|t| self.power[*t].is_finite());
        let mut seen: Vec<(f64, f64)> = seen.map(|t| (others(t), self.power[t])).collect();
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = LEAST_FOR_LEVEL.max((QUIET * seen.len() as f64) as usize);
        let loudest = seen
            .get(count - 1)
            .map_or(f64::INFINITY, |(others, _)| *others);
        let quiet = seen
            .into_iter()
            .take_while(|(others, _)| *others <= loudest);
        quiet.map(|(_, power)| power).collect()
    }

    /// The lower quartile of powers as a variance of noise; `None` of too few.
    fn level(&self, powers: &[f64]) -> Option<f64> {
        let seen = powers.iter().copied().filter(|e| e.is_finite());
        let seen: Vec<f64> = seen.collect();
        let quartile = (seen.len() >= LEAST_FOR_LEVEL).then(|| quantile(seen, 0.25))??;
        Some(quartile / lower_quartile(self.freedoms))
    }
}

/// The sums over the tracks of weighted log power, and of the weights, by frame.
struct Sums(Vec<(f64, f64)>);

impl Sums {
    fn of(powers: &[Power]) -> Sums {
        let frames = powers.first().map_or(0, |p| p.log.len());
        let mut sums = vec![(0.0, 0.0); frames];
        for power in powers {
            for (sum, z) in sums.iter_mut().zip(&power.log) {
                if z.is_finite() {
                    *sum = (sum.0 + power.weight * z, sum.1 + power.weight);
                }
            }
        }
        Sums(sums)
    }

    fn at(&self, frame: usize) -> (f64, f64) {
        self.0[frame]
    }
}

/// ψ′(d / 2): the variance of the logarithm of a chi-squared variable of d freedoms.
fn log_variance(freedoms: usize) -> f64 {
    match freedoms {
        1 => PI * PI / 2.0,
        2 => PI * PI / 6.0,
        _ => PI * PI / 2.0 - 4.0,
    }
}

/// The lower quartile of a chi-squared variable of d freedoms, over d.
fn lower_quartile(freedoms: usize) -> f64 {
    match freedoms {
        1 => 0.1015,
        2 => 0.5754 / 2.0,
        _ => 1.2125 / 3.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Points that swing, all fast at times and slow at others, and their noise.
    fn tracks(frames: usize, rate: f64, sd: f64) -> Vec<Track> {
        let mut random = rng(5, 0);
        let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
        let mut tracks = Vec::new();
        for c in 0..10 {
            let mut rows = Vec::new();
            for t in 0..frames {
                let s = t as f64 / rate;
                // A burst of 6 Hz every two seconds.
                let burst = (-(((s % 2.0) - 1.0) / 0.25).powi(2)).exp();
                let at = |i: f64| {
                    20.0 * (0.8 * s + i).sin() + 2.0 * burst * (38.0 * s + i + f64::from(c)).sin()
                };
                rows.push([
                    at(0.0) + sd * draw(),
                    at(1.0) + sd * draw(),
                    at(2.0) + sd * draw(),
                    0.0,
                ]);
            }
            tracks.push(Track { rows, freedoms: 3 });
        }
        tracks
    }

    #[test]
    fn noise_is_measured_and_motion_is_none_at_any_rate() {
        for rate in [10.0, 24.0, 30.0, 60.0, 120.0] {
            let frames = (20.0 * rate) as usize;
            let sound = TrackNoise::of(&tracks(frames, rate, 0.0));
            assert!(!sound.is_noise(rate), "{rate}: {:?}", sound.common(rate));
            let noisy = TrackNoise::of(&tracks(frames, rate, 0.5));
            if rate >= 30.0 {
                let sd = noisy.typical().sqrt();
                assert!(
                    noisy.is_noise(rate) && (0.45..0.58).contains(&sd),
                    "{rate}: {sd}"
                );
            }
        }
    }

    #[test]
    fn spikes_and_missing_frames_do_not_count() {
        let (frames, rate) = (1200, 60.0);
        let mut some = tracks(frames, rate, 0.3);
        let is_drawn = |c: usize, t: usize, every| (7919 * t + 104_729 * c).is_multiple_of(every);
        for (c, track) in some.iter_mut().enumerate() {
            for t in 0..frames {
                if is_drawn(c, t, 17) {
                    track.rows[t] = [f64::NAN; 4];
                } else if is_drawn(c, t, 23) {
                    track.rows[t][0] += 30.0;
                }
            }
        }
        let noise = TrackNoise::of(&some);
        let sd = noise.typical().sqrt();
        assert!(
            noise.is_noise(rate) && (0.25..0.4).contains(&sd),
            "{sd} {:?}",
            noise.common(rate)
        );
    }

    #[test]
    fn too_little_tells_nothing() {
        for frames in [0, 4, 5, 39] {
            let noise = TrackNoise::of(&tracks(frames, 30.0, 1.0));
            assert!(!noise.is_noise(30.0), "{frames}");
        }
        let few: Vec<Track> = tracks(300, 30.0, 1.0).into_iter().take(5).collect();
        let noise = TrackNoise::of(&few);
        assert!(!noise.is_noise(30.0) && noise.typical() > 0.5);
        let missing = Track {
            rows: vec![[f64::NAN; 4]; 50],
            freedoms: 3,
        };
        assert_eq!(TrackNoise::of(&[missing]).variance, [None]);
        assert_eq!(TrackNoise::of(&[]).typical(), 0.0);
    }
}
