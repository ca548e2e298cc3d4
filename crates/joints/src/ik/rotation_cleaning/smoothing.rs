//! Penalized smoothing, each track as strongly as Stein's unbiased estimate of its error says.
//!
//! ```text
//! s = (W + λ D'D)⁻¹ W y                         D: differences of order 2 or 3
//! risk = |W (y − s)|² + 2 ρ tr − n ρ            ρ: noise variance of a frame, all coordinates
//! tr = n/T Σ_i 1 / (1 + λ e_i),  e_i ≈ (2 − 2 cos(π i / T))^k
//! ```
//!
//! The order k and the strength λ with the least risk are taken; no smoothing at all competes. The
//! system is banded: one pass forward and one backward, linear in time.

use super::tuning::*;
use crate::numeric::parallel;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// A track to smooth.
pub(super) struct Noisy<'a> {
    /// (frames, 4); unused coordinates are 0.
    pub values: Vec<[f64; 4]>,
    /// Whether each frame counts.
    pub counts: &'a [bool],
    /// The noise variance of a frame: the sum over its coordinates.
    pub noise: f64,
}

/// How strongly a track is smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strength {
    /// The order of the differences that are kept small.
    pub order: usize,
    /// λ.
    pub lambda: f64,
}

impl Strength {
    /// The frequency that is left by half, Hz; `rate`: frames a second.
    ///
    /// ```
    /// use posing_joints::ik::rotation_cleaning::Strength;
    ///
    /// let strength = Strength { order: 2, lambda: 16.0 }; // rate / 2π / 16^(1/4)
    /// assert!((strength.cutoff(120.0) - 60.0 / std::f64::consts::TAU).abs() < 1e-12);
    /// ```
    pub fn cutoff(&self, rate: f64) -> f64 {
        rate / TAU * self.lambda.powf(-0.5 / self.order as f64)
    }

    /// All that are tried.
    fn grid() -> Vec<Strength> {
        let of = |order: usize| {
            (0..STRENGTHS).map(move |i| Strength {
                order,
                lambda: 10_f64.powf(FIRST_STRENGTH + STRENGTH_STEP * i as f64),
            })
        };
        of(2).chain(of(3)).collect()
    }

    /// The trace of the smoother a frame.
    fn trace(&self, frames: usize) -> f64 {
        let eigenvalue = |i: usize| {
            let e = 2.0 - 2.0 * (PI * i as f64 / frames as f64).cos();
            e.powi(self.order as i32)
        };
        let terms = (0..frames).map(|i| 1.0 / (1.0 + self.lambda * eigenvalue(i)));
        terms.sum::<f64>() / frames.max(1) as f64
    }
}

/// The tracks, of as many frames each, smoothed; `None` for one that is best left as it is.
pub(super) fn smooth_all(tracks: &[Noisy<'_>]) -> Vec<Option<(Vec<[f64; 4]>, Strength)>> {
    let frames = tracks.first().map_or(0, |t| t.values.len());
    let grid = Strength::grid();
    // Tracks of which the same frames count share their systems.
    let mut groups: BTreeMap<&[bool], Vec<usize>> = BTreeMap::new();
    for (i, track) in tracks.iter().enumerate() {
        groups.entry(track.counts).or_default().push(i);
    }
    let groups: Vec<(&[bool], Vec<usize>)> = groups.into_iter().collect();
    let traces: Vec<f64> = grid.iter().map(|s| s.trace(frames)).collect();
    let risks = parallel::map_chunks(groups.len() * grid.len(), 1, |item| {
        let (group, g) = (item.start / grid.len(), item.start % grid.len());
        let (counts, members) = &groups[group];
        let system = System::new(counts, grid[g]);
        let mut smooth = Vec::new();
        let risk = |&i: &usize| {
            system.solve(&tracks[i].values, &mut smooth);
            (i, g, tracks[i].risk(&smooth, traces[g]))
        };
        members.iter().map(risk).collect::<Vec<_>>()
    });
    let mut best: Vec<(f64, Option<usize>)> =
        tracks.iter().map(|t| (t.unsmoothed(), None)).collect();
    for (i, g, risk) in risks.into_iter().flatten() {
        if risk < best[i].0 {
            best[i] = (risk, Some(g));
        }
    }
    parallel::map_chunks(tracks.len(), 1, |item| {
        let strength = grid[best[item.start].1?];
        let track = &tracks[item.start];
        let mut smooth = Vec::new();
        System::new(track.counts, strength).solve(&track.values, &mut smooth);
        Some((smooth, strength))
    })
}

impl Noisy<'_> {
    fn count(&self) -> f64 {
        self.counts.iter().filter(|c| **c).count() as f64
    }

    /// The risk without smoothing: the noise.
    fn unsmoothed(&self) -> f64 {
        self.count() * self.noise
    }

    fn risk(&self, smooth: &[[f64; 4]], trace: f64) -> f64 {
        let all = self.values.iter().zip(smooth).zip(self.counts);
        let mut residuals = [0.0; 4];
        for ((y, s), _) in all.filter(|(_, counts)| **counts) {
            for c in 0..4 {
                residuals[c] += (y[c] - s[c]) * (y[c] - s[c]);
            }
        }
        residuals.iter().sum::<f64>() + self.count() * self.noise * (2.0 * trace - 1.0)
    }
}

/// Zeros before the first and after the last frame, so that each has three neighbors.
const PAD: usize = 3;

/// The factors L D L' of W + λ D'D.
struct System<'a> {
    counts: &'a [bool],
    /// L below its diagonal: of row t, the entries at t − 1, t − 2 and t − 3. Padded.
    lower: Vec<[f64; 3]>,
    /// 1 / D. Padded.
    inverse: Vec<f64>,
}

fn weight(counts: bool) -> f64 {
    if counts { 1.0 } else { NO_WEIGHT }
}

impl<'a> System<'a> {
    fn new(counts: &'a [bool], strength: Strength) -> System<'a> {
        let frames = counts.len();
        let (mut lower, mut inverse) = (
            vec![[0.0; 3]; frames + 2 * PAD],
            vec![0.0; frames + 2 * PAD],
        );
        let within = penalty_row(strength, usize::MAX, usize::MAX);
        for t in 0..frames {
            let is_within = t >= PAD && t + PAD < frames;
            let a = if is_within {
                within
            } else {
                penalty_row(strength, t, frames - 1 - t)
            };
            let i = t + PAD;
            // L D, from the farthest entry to the nearest.
            let c3 = a[3];
            let c2 = a[2] - c3 * lower[i - 2][0];
            let c1 = a[1] - c2 * lower[i - 1][0] - c3 * lower[i - 1][1];
            let row = [
                c1 * inverse[i - 1],
                c2 * inverse[i - 2],
                c3 * inverse[i - 3],
            ];
            let pivot = weight(counts[t]) + a[0] - c1 * row[0] - c2 * row[1] - c3 * row[2];
            // What rounding has eaten is a direction that nothing penalizes.
            inverse[i] = 1.0 / pivot.max(NO_WEIGHT * 1e-3);
            lower[i] = row;
        }
        System {
            counts,
            lower,
            inverse,
        }
    }

    /// s = (W + λ D'D)⁻¹ W y into `out`.
    fn solve(&self, y: &[[f64; 4]], out: &mut Vec<[f64; 4]>) {
        // About the first value, so that rounding is relative to what moves.
        let origin = y.first().copied().unwrap_or_default();
        out.clear();
        out.resize(y.len(), [0.0; 4]);
        let mut near = [[0.0; 4]; 3];
        for (t, (y, out)) in y.iter().zip(out.iter_mut()).enumerate() {
            let (w, l) = (weight(self.counts[t]), self.lower[t + PAD]);
            for c in 0..4 {
                out[c] = w * (y[c] - origin[c]);
            }
            *out = eliminated(*out, l, &near);
            near = [*out, near[0], near[1]];
        }
        near = [[0.0; 4]; 3];
        for (t, out) in out.iter_mut().enumerate().rev() {
            let i = t + PAD;
            let l = [
                self.lower[i + 1][0],
                self.lower[i + 2][1],
                self.lower[i + 3][2],
            ];
            for v in out.iter_mut() {
                *v *= self.inverse[i];
            }
            *out = eliminated(*out, l, &near);
            near = [*out, near[0], near[1]];
            for c in 0..4 {
                out[c] += origin[c];
            }
        }
    }
}

/// A row less its three neighbors, the farthest first: the nearest is known last.
#[inline(always)]
fn eliminated(mut row: [f64; 4], l: [f64; 3], near: &[[f64; 4]; 3]) -> [f64; 4] {
    for k in (0..3).rev() {
        for c in 0..4 {
            row[c] -= l[k] * near[k][c];
        }
    }
    row
}

/// The entries of λ D'D at a frame and at those 1, 2 and 3 before it; `before` and `after` are the
/// frames that the take has on each side.
fn penalty_row(strength: Strength, before: usize, after: usize) -> [f64; 4] {
    let difference: &[f64] = match strength.order {
        2 => &[1.0, -2.0, 1.0],
        _ => &[-1.0, 3.0, -3.0, 1.0],
    };
    let order = difference.len() - 1;
    // A row of D begins `a` frames before this one.
    let entry = |j: usize| {
        let rows = (j..=order).filter(|&a| a <= before && order - a <= after);
        rows.map(|a| difference[a] * difference[a - j]).sum::<f64>()
    };
    [0, 1, 2, 3].map(|j| strength.lambda * entry(j))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array1, Array2};
    use rand_distr::{Distribution, Normal};

    fn random(frames: usize) -> Vec<[f64; 4]> {
        let mut random = parallel::rng(9, frames as u64);
        let normal = Normal::new(0.0, 1.0).unwrap();
        (0..frames)
            .map(|_| [0; 4].map(|_| normal.sample(&mut random)))
            .collect()
    }

    #[test]
    fn the_banded_system_is_the_dense_one() {
        for frames in [1, 2, 3, 4, 7, 40] {
            let y = random(frames);
            let counts: Vec<bool> = (0..frames).map(|t| t % 7 != 5).collect();
            for strength in Strength::grid().into_iter().step_by(9) {
                let k = strength.order;
                let mut a = Array2::<f64>::zeros((frames, frames));
                let d = if k == 2 {
                    vec![1.0, -2.0, 1.0]
                } else {
                    vec![-1.0, 3.0, -3.0, 1.0]
                };
                for r in 0..frames.saturating_sub(k) {
                    for (i, x) in d.iter().enumerate() {
                        for (j, z) in d.iter().enumerate() {
                            a[[r + i, r + j]] += strength.lambda * x * z;
                        }
                    }
                }
                (0..frames).for_each(|t| a[[t, t]] += weight(counts[t]));
                let mut smooth = Vec::new();
                System::new(&counts, strength).solve(&y, &mut smooth);
                for c in 0..4 {
                    let s = Array1::from_iter(smooth.iter().map(|s| s[c]));
                    let right = Array1::from_shape_fn(frames, |t| weight(counts[t]) * y[t][c]);
                    let error = (a.dot(&s) - &right)
                        .iter()
                        .fold(0.0, |m: f64, v| m.max(v.abs()));
                    let size = 1.0 + strength.lambda * 64.0;
                    assert!(error <= 1e-13 * size, "{frames} {strength:?}: {error}");
                }
            }
        }
    }

    #[test]
    fn lines_stay_at_every_strength() {
        let line: Vec<[f64; 4]> = (0..3000)
            .map(|t| [0, 1, 2, 3].map(|c| 0.3 + 0.001 * (c * t) as f64))
            .collect();
        let counts = vec![true; 3000];
        for strength in Strength::grid() {
            let mut smooth = Vec::new();
            System::new(&counts, strength).solve(&line, &mut smooth);
            for (s, y) in smooth.iter().zip(&line) {
                assert!((0..4).all(|c| (s[c] - y[c]).abs() < 1e-4), "{strength:?}");
            }
        }
    }

    #[test]
    fn noise_goes_and_motion_stays() {
        let noise = random(600);
        let truth = |t: usize| [0, 1, 2, 3].map(|c| (0.03 * t as f64 + c as f64).sin());
        let values: Vec<[f64; 4]> = (0..600)
            .map(|t| [0, 1, 2, 3].map(|c| truth(t)[c] + 0.05 * noise[t][c]))
            .collect();
        let error = |track: &[[f64; 4]]| {
            let squares = track
                .iter()
                .enumerate()
                .map(|(t, y)| (0..4).map(|c| (y[c] - truth(t)[c]).powi(2)).sum::<f64>());
            (squares.sum::<f64>() / (4.0 * track.len() as f64)).sqrt()
        };
        let all = vec![true; 600];
        let track = |noise: f64| Noisy {
            values: values.clone(),
            counts: &all,
            noise,
        };
        let smooth = smooth_all(&[track(4.0 * 0.05_f64.powi(2)), track(0.0)]);
        let (smooth, strength) = smooth[0].as_ref().unwrap();
        assert!(error(smooth) < 0.3 * error(&values), "{}", error(smooth));
        assert!((1.0..60.0).contains(&strength.cutoff(120.0)));
        assert!(smooth_all(&[]).is_empty());
        // No noise: nothing to gain.
        assert!(smooth_all(&[track(0.0)])[0].is_none());
    }
}
