//! The noise of a capture: how large it is at each point, and how much of it one frame leaves to
//! the next.
//!
//! Fourth differences over time measure noise that is white. That of cameras and of soft tissue is
//! not; bones are rigid, and show it. Their lengths l, less their mean over a second, vary by the
//! noise of both ends:
//!
//! ```text
//! r = median over bones of var(l) / 2           a = (ρ₁ + √ρ₂) / 2
//!     ρ_k the median over bones of the correlation of l_t and l_t+k
//! ```
//!
//! The mean over M frames takes a share c ≈ (1 + a) / ((1 − a) M) of the variance along, which is
//! put back. Without a model the steadiest distances stand in for bones: those of markers of one
//! segment, less their mean over a shorter time, as skin moves. What is alike for longer than noise
//! is, or not as noise is (ρ₂ ≠ ρ₁²), is skin too, and counts for nothing.

use super::kalman_smoother::PathNoise;
use super::noise_estimation;
use super::take::{PointMapping, Take};
use super::tuning::adaptive_smoothing::{LEAST_VARIANCE, MOTION_VARIANCE};
use super::tuning::capture_noise::*;
use crate::label::marker_distances::Distance;
use crate::numeric::parallel;
use crate::numeric::statistics::{less_local_mean, mean_of_finite, median};
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// The noise of a capture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CaptureNoise {
    /// Standard deviation of a coordinate of each point (J), cm.
    pub sd: Vec<f64>,
    /// The correlation of the noise in one frame and the next; 0 is white.
    pub correlation: f64,
}

impl CaptureNoise {
    /// Measures the noise of a take without outliers: by fourth differences, and where a model says
    /// which points are joined by bones, by their lengths. `given` is the standard deviation of a
    /// coordinate, cm, if known.
    pub(crate) fn measure(
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        given: Option<f64>,
    ) -> CaptureNoise {
        let in_model = mapping.map(|mapping| (mapping.model, mapping.gather(take.xyz)));
        let model = (in_model.as_ref()).map(|(model, seen)| (*model, seen.view()));
        let white = noise_estimation::by_point(model, take, given);
        let (bones, by_bones) = match mapping {
            Some(mapping) => {
                let bones = mapping.bones();
                let found = of_bones(take, &bones, LOCAL_SECONDS);
                (bones, found.map(|found| found.noise))
            }
            None => {
                let pairs = steadiest_pairs(take.xyz);
                let found = of_bones(take, &pairs, PAIR_SECONDS).filter(Lengths::is_noise);
                (pairs, found.map(|found| found.noise))
            }
        };
        match by_bones {
            Some(by_bones) => CaptureNoise::mixed(white, &by_bones, &bones, given.is_some()),
            None => CaptureNoise::white(white),
        }
    }

    /// White noise (J).
    fn white(sd: Vec<f64>) -> CaptureNoise {
        CaptureNoise {
            sd,
            correlation: 0.0,
        }
    }

    /// White noise as it was measured, unless bones show more: fourth differences see little of
    /// noise that is correlated, and none of rounding.
    fn mixed(
        mut sd: Vec<f64>,
        by_bones: &PathNoise,
        bones: &[[usize; 2]],
        is_given: bool,
    ) -> CaptureNoise {
        let (r, a) = (by_bones.variance, by_bones.correlation);
        let of_bone = |[p, q]: &[usize; 2]| (sd[*p].powi(2) + sd[*q].powi(2)) / 2.0;
        let white = median(bones.iter().map(of_bone).collect()).unwrap_or(0.0);
        if MORE * r <= white {
            // Joints of rotations that tremble: their bones do not.
            return CaptureNoise::white(sd);
        }
        // The variance of fourth differences of such noise, over 70 of its own variances.
        let seen = (70.0 - a * (112.0 - a * (56.0 - a * (16.0 - 2.0 * a)))) / 70.0;
        let level = white / (seen * r);
        let is_alike = (1.0 / ALIKE..=ALIKE).contains(&level);
        let is_white = a == 0.0 && level >= 1.0 / MORE;
        if !is_given && !is_white {
            sd.iter_mut().for_each(|sd| {
                let share = (*sd * *sd / white).clamp(1.0 / POINTS_DIFFER, POINTS_DIFFER);
                let own = if is_alike { share * r } else { r };
                *sd = own.sqrt();
            });
        }
        CaptureNoise { sd, correlation: a }
    }

    /// The noise of a point's path. What motion without any noise reads as is taken off white
    /// noise: a clean take stays as it is.
    pub(crate) fn of_path(&self, point: usize) -> PathNoise {
        let r = self.sd[point] * self.sd[point];
        let own = if self.correlation > 0.0 {
            r
        } else {
            r * r / (r + MOTION_VARIANCE)
        };
        PathNoise {
            variance: own.max(LEAST_VARIANCE),
            correlation: self.correlation,
        }
    }

    /// The mean of the standard deviations, cm; 0 for no points.
    pub(crate) fn mean(&self) -> f64 {
        self.sd.iter().sum::<f64>() / self.sd.len().max(1) as f64
    }
}

/// The pairs of points whose distance is the steadiest, each point with one other: a third of them,
/// the steadiest.
fn steadiest_pairs(xyz: ArrayView2<'_, f64>) -> Vec<[usize; 2]> {
    let points = xyz.ncols() / 3;
    let step = xyz.nrows().div_ceil(PAIR_FRAMES).max(1);
    let frames: Vec<Vec<DVec3>> = (0..xyz.nrows())
        .step_by(step)
        .map(|t| (0..points).map(|p| point_at(xyz, t, p)).collect())
        .collect();
    let spread = |a: usize, b: usize| {
        let lengths = frames.iter().map(|frame| frame[a].distance(frame[b]));
        let known = Distance::of(lengths.filter(|l| l.is_finite()).collect())?;
        (2 * known.frames >= frames.len()).then_some(known.spread)
    };
    let steadiest = parallel::map_chunks(points, 1, |range| {
        let a = range.start;
        let others = (0..points).filter(|b| *b != a);
        let known = others.filter_map(|b| Some((spread(a, b)?, [a.min(b), a.max(b)])));
        known.min_by(|one, other| one.0.total_cmp(&other.0))
    });
    let mut pairs: Vec<(f64, [usize; 2])> = steadiest.into_iter().flatten().collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    pairs.dedup_by_key(|(_, pair)| *pair);
    pairs.truncate((pairs.len() / 3).max(FEWEST_BONES));
    pairs.into_iter().map(|(_, pair)| pair).collect()
}

/// The noise that lengths show, and by how much it is alike two frames later.
struct Lengths {
    noise: PathNoise,
    /// √ρ₂ less ρ₁: 0 for what is alike from one frame to the next only.
    longer: f64,
}

impl Lengths {
    /// Whether it is alike as noise is.
    fn is_noise(&self) -> bool {
        self.noise.correlation <= PAIR_CORRELATION && self.longer.abs() <= UNLIKE_NOISE
    }
}

/// The noise that the lengths of `bones` show in a take, less their mean over some seconds. `None`
/// where too few are seen.
fn of_bones(take: &Take<'_>, bones: &[[usize; 2]], seconds: f64) -> Option<Lengths> {
    let reach = (seconds * take.rate / 2.0).ceil() as usize;
    let measure = |bone: &[usize; 2]| Bone::new(take.xyz, take.runs, *bone, reach);
    let bones: Vec<Bone> = bones.iter().filter_map(measure).collect();
    if bones.len() < FEWEST_BONES {
        return None;
    }
    let of = |value: &dyn Fn(&Bone) -> f64| median(bones.iter().map(value).collect());
    let variance = of(&|b| b.variance / 2.0)?;
    let seen = [of(&|b| b.correlation[0])?, of(&|b| b.correlation[1])?];
    let frames = (2 * reach + 1) as f64;
    let (mut a, mut lost, mut longer) = (0.0f64, 0.0, 0.0);
    for _ in 0..ROUNDS {
        lost = ((1.0 + a) / (1.0 - a) / frames).min(0.5);
        let [first, second] = seen.map(|rho| rho * (1.0 - lost) + lost);
        let root = second.max(0.0).sqrt();
        longer = root - first;
        a = ((first + root) / 2.0).clamp(0.0, MOST_CORRELATION);
        if first < LEAST_CORRELATION {
            (a, longer) = (0.0, 0.0);
        }
    }
    Some(Lengths {
        noise: PathNoise {
            variance: variance / (1.0 - lost),
            correlation: a,
        },
        longer,
    })
}

/// How the length of a bone varies about its local mean.
struct Bone {
    /// cm².
    variance: f64,
    /// With the next frame, and the one after it.
    correlation: [f64; 2],
}

impl Bone {
    fn new(
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        [a, b]: [usize; 2],
        reach: usize,
    ) -> Option<Bone> {
        let length = |t: usize| {
            let square = |axis: usize| (xyz[[t, 3 * a + axis]] - xyz[[t, 3 * b + axis]]).powi(2);
            (0..3).map(square).sum::<f64>().sqrt()
        };
        // Runs are joined by missing values, which no correlation crosses.
        let mut off: Vec<f64> = Vec::new();
        for run in runs {
            let lengths: Vec<f64> = run.clone().map(length).collect();
            off.extend(less_local_mean(&lengths, reach));
            off.extend([f64::NAN; 2]);
        }
        let seen: Vec<f64> = off.iter().copied().filter(|v| v.is_finite()).collect();
        if seen.len() < FEWEST_FRAMES {
            return None;
        }
        let sd = Distance::of(seen)?.spread;
        off.iter_mut()
            .for_each(|v| *v = v.clamp(-FAR * sd, FAR * sd));
        let whole = mean(off.iter().map(|v| v * v));
        let correlation = [1, 2].map(|lag| {
            let products = off.iter().zip(&off[lag..]).map(|(u, v)| u * v);
            mean(products) / whole.max(1e-300)
        });
        Some(Bone {
            variance: sd * sd,
            correlation,
        })
    }
}

/// The mean of the values that are known; 0 for none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    mean_of_finite(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use ndarray::Array2;
    use rand_distr::{Distribution, StandardNormal};

    /// A chain of 12 points that swings, and its noise added.
    fn noisy(frames: usize, sd: f64, a: f64) -> Array2<f64> {
        let mut rng = parallel::rng(7, 0);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut n: Vec<f64> = (0..36).map(|_| draw()).collect();
        let mut out = Array2::zeros((frames, 36));
        for t in 0..frames {
            let mut at = [60.0 * (t as f64 / 70.0).sin(), 0.0, 0.0];
            for p in 0..12 {
                let turn = (t as f64 / 40.0 + p as f64).sin();
                at = [at[0] + 20.0 * turn.cos(), at[1] + 20.0 * turn.sin(), at[2]];
                for c in 0..3 {
                    let i = 3 * p + c;
                    out[[t, i]] = at[c] + sd * n[i];
                    n[i] = a * n[i] + (1.0 - a * a).sqrt() * draw();
                }
            }
        }
        out
    }

    #[test]
    fn bones_show_noise_and_its_correlation() {
        let bones: Vec<[usize; 2]> = (0..11).map(|p| [p, p + 1]).collect();
        for (sd, a) in [(0.3, 0.77), (2.0, 0.46), (1.0, 0.0)] {
            let xyz = noisy(400, sd, a);
            let take = Take {
                names: &[],
                xyz: xyz.view(),
                runs: std::slice::from_ref(&(0..400)),
                rate: 120.0,
                sd: None,
                motion: Default::default(),
            };
            let found = of_bones(&take, &bones, LOCAL_SECONDS).unwrap().noise;
            assert!(
                (found.variance.sqrt() / sd - 1.0).abs() <= 0.1,
                "{sd} {a}: {found:?}"
            );
            assert!((found.correlation - a).abs() <= 0.08, "{sd} {a}: {found:?}");
            let white = noise_estimation::by_point(None, &take, None);
            let noise = CaptureNoise::mixed(white, &found, &bones, false);
            assert_eq!(noise.correlation > 0.0, a > 0.0);
            assert!(
                (noise.mean() / sd - 1.0).abs() <= 0.15,
                "{sd} {a}: {noise:?}"
            );
        }
    }

    #[test]
    fn markers_show_it_too_and_skin_that_moves_is_none() {
        let measured = |xyz: &Array2<f64>| {
            let take = Take {
                names: &[],
                xyz: xyz.view(),
                runs: std::slice::from_ref(&(0..400)),
                rate: 120.0,
                sd: None,
                motion: Default::default(),
            };
            CaptureNoise::measure(None, &take, None)
        };
        for (sd, a) in [(0.3, 0.62), (0.5, 0.0)] {
            let noise = measured(&noisy(400, sd, a));
            assert!(
                (noise.mean() / sd - 1.0).abs() <= 0.2,
                "{sd} {a}: {noise:?}"
            );
            assert!((noise.correlation - a).abs() <= 0.1, "{sd} {a}: {noise:?}");
        }
        // Millimeters of skin at three hertz, each marker at its own time.
        let mut xyz = noisy(400, 0.0, 0.0);
        for ((t, c), v) in xyz.indexed_iter_mut() {
            *v += 0.3 * (t as f64 * 0.157 + 1.7 * c as f64).sin();
        }
        let noise = measured(&xyz);
        assert_eq!(noise.correlation, 0.0);
        assert!(noise.mean() <= 0.01, "{noise:?}");
    }
}
