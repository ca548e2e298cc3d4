//! The points of a gap regressed on the points that are seen: a Gaussian conditional, and a
//! Gaussian process on what it leaves.
//!
//! x (3 P) are the predictors' coordinates of a frame and y (3 T) the targets', in a frame of
//! reference of their own (cm). Training frames are the take's own and, where a model knows the
//! points, its training poses ("others").
//!
//! ```text
//! y ≈ m_y + K (x − m_x) + r(z, t)      K = C_yx (C_xx + (0.01 + r) I)⁻¹
//!     means and covariance: half own, half others'; r: the noise of the predictors
//! cov(r, r′) = σ² [1 / (1 + d² / (w h)) + τ M(t − t′) + 3·10⁻⁴ δ]
//!     d² = |z − z′|²,  z = s ∘ (x − m_x)
//! ```
//!
//! - s: .1 + the predictor's share in K, so that predictors that matter count most.
//! - h: the mean over training frames of the 10th percentile of d² to the others.
//! - M: the Matérn 3/2 correlation over time, .21 s, zero between takes and runs.
//!
//! Three processes differ in w, τ and whose frames they learn from ([`Kernel`]); [`super::weights`]
//! says what each is worth. The training frames are spread over the take and dense next to the gap;
//! of the others, those nearest to the gap's own.

use super::local_poses::LocalPoses;
use super::tuning::regression::*;
use crate::numeric::linalg::Cholesky;
use ndarray::{Array1, Array2, ArrayView1, Axis, s};
use std::collections::BTreeSet;
use std::ops::Range;

/// Poses of a model, with their moments.
pub(crate) struct OtherPoses {
    pub poses: LocalPoses,
    moments: Moments,
}

impl OtherPoses {
    /// Complete poses.
    pub(crate) fn new(poses: LocalPoses) -> OtherPoses {
        let rows: Vec<usize> = (0..poses.predictors.nrows()).collect();
        OtherPoses {
            moments: Moments::new(&poses, &rows),
            poses,
        }
    }
}

/// What a gap's points are regressed on.
pub(crate) struct Regression<'a> {
    /// The take's frames.
    pub own: &'a LocalPoses,
    /// Which of them are complete.
    pub complete: &'a [bool],
    /// Seconds of each frame, with long breaks between runs.
    pub seconds: &'a [f64],
    /// Frames a second.
    pub rate: f64,
    /// Others' poses.
    pub others: Option<&'a OtherPoses>,
    /// The variance of a predictor's coordinate, cm².
    pub noise: f64,
}

/// The prediction of one process for some frames.
#[derive(Debug, Clone)]
pub(crate) struct Prediction {
    /// (frames, 3 T), cm.
    pub mean: Array2<f64>,
    /// (frames, 3 T), cm²; of the frames in which it is wanted.
    pub variance: Array2<f64>,
}

impl Regression<'_> {
    /// The processes that predict.
    pub(crate) fn kernels(&self) -> &'static [Kernel] {
        let own = self.complete.iter().filter(|c| **c).count() as f64;
        match self.others {
            // The last learns from the take alone.
            Some(_) if own < OWN_FRAMES => &POOLED[..2],
            Some(_) => &POOLED,
            None => &OWN,
        }
    }

    /// Predicts the targets in `frames`, which lie in `gaps`, and then in those `beside` them,
    /// where no variance is wanted; the gaps' frames are not learned from. One prediction a
    /// kernel, and last that of the conditional alone, without a variance. `None` where there is
    /// nothing to learn from.
    pub(crate) fn predict(
        &self,
        gaps: &[Range<usize>],
        frames: &[usize],
        beside: &[usize],
    ) -> Option<Vec<Prediction>> {
        let sure = frames.len();
        let frames = &[frames, beside].concat();
        let with_others = match self.others {
            Some(others) => Some(Basis::new(self, gaps, Some(others))?),
            None => None,
        };
        let is_alone = self.kernels().iter().any(|k| !k.others);
        let alone = if is_alone {
            Some(Basis::new(self, gaps, None)?)
        } else {
            None
        };
        let of_kernel = |kernel: &Kernel| {
            let basis = if kernel.others { &with_others } else { &alone };
            basis.as_ref()?.predict(self, kernel, frames, sure)
        };
        let mut out: Vec<Prediction> =
            (self.kernels().iter().map(of_kernel)).collect::<Option<_>>()?;
        let basis = with_others.as_ref().or(alone.as_ref())?;
        let mean = basis.linear(&self.own.predictors.select(Axis(0), frames));
        let variance = Array2::zeros(mean.dim());
        out.push(Prediction { mean, variance });
        Some(out)
    }
}

/// Means and covariance of predictors and targets together.
#[derive(Debug, Clone)]
struct Moments {
    mean: Array1<f64>,
    covariance: Array2<f64>,
}

impl Moments {
    /// The moments of some rows.
    fn new(poses: &LocalPoses, rows: &[usize]) -> Moments {
        let x = poses.predictors.select(Axis(0), rows);
        let y = poses.targets.select(Axis(0), rows);
        let Ok(mut all) = ndarray::concatenate(Axis(1), &[x.view(), y.view()]) else {
            unreachable!("predictors and targets have the same rows");
        };
        let n = all.nrows().max(1) as f64;
        let mean = all.sum_axis(Axis(0)) / n;
        all -= &mean;
        Moments {
            covariance: all.t().dot(&all) / (n - 1.0).max(1.0),
            mean,
        }
    }

    /// The mean of both, this one with the weight `w`.
    fn pooled(&self, w: f64, other: &Moments) -> Moments {
        Moments {
            mean: &self.mean * w + &other.mean * (1.0 - w),
            covariance: &self.covariance * w + &other.covariance * (1.0 - w),
        }
    }
}

/// The Gaussian conditional and the training frames of the processes on what it leaves.
struct Basis {
    mean_x: Array1<f64>,
    mean_y: Array1<f64>,
    /// Kᵀ (3 P, 3 T).
    coefficients: Array2<f64>,
    /// s (3 P).
    scale: Array1<f64>,
    /// z of the training frames (n, 3 P).
    z: Array2<f64>,
    /// What the conditional leaves of them (n, 3 T).
    residual: Array2<f64>,
    /// Seconds; NaN for others.
    seconds: Vec<f64>,
    /// d² between them (n, n).
    distances: Array2<f64>,
    /// h.
    typical: f64,
}

impl Basis {
    fn new(
        regression: &Regression<'_>,
        gaps: &[Range<usize>],
        others: Option<&OtherPoses>,
    ) -> Option<Basis> {
        let own = regression.own;
        let is_left_out = |t: usize| gaps.iter().any(|g| g.contains(&t));
        let known: Vec<usize> = (0..regression.complete.len())
            .filter(|&t| regression.complete[t] && !is_left_out(t))
            .collect();
        if known.len() < 2 {
            return None;
        }
        let step = known.len().div_ceil(COVARIANCE_FRAMES);
        let measured: Vec<usize> = known.iter().copied().step_by(step).collect();
        let mut moments = Moments::new(own, &measured);
        if let Some(others) = others {
            let w = 0.5 * (known.len() as f64 / OWN_FRAMES).min(1.0);
            moments = moments.pooled(w, &others.moments);
        }
        let (p, coefficients) = (
            own.predictors.ncols(),
            conditional(&moments, own, RIDGE + regression.noise)?,
        );
        let mut basis = Basis {
            mean_x: moments.mean.slice(s![..p]).to_owned(),
            mean_y: moments.mean.slice(s![p..]).to_owned(),
            scale: scales(&coefficients),
            coefficients,
            z: Array2::zeros((0, 0)),
            residual: Array2::zeros((0, 0)),
            seconds: Vec::new(),
            distances: Array2::zeros((0, 0)),
            typical: 1.0,
        };
        let training = training_frames(&known, gaps, regression.rate);
        let mut x = own.predictors.select(Axis(0), &training);
        let mut y = own.targets.select(Axis(0), &training);
        basis.seconds = training.iter().map(|&t| regression.seconds[t]).collect();
        if let Some(others) = others {
            let nearest = basis.nearest(others, own, gaps);
            basis
                .seconds
                .resize(training.len() + nearest.len(), f64::NAN);
            let rows = |all: &Array2<f64>| all.select(Axis(0), &nearest);
            x.append(Axis(0), rows(&others.poses.predictors).view())
                .ok()?;
            y.append(Axis(0), rows(&others.poses.targets).view()).ok()?;
        }
        basis.residual = &y - &basis.linear(&x);
        basis.z = basis.scaled(&x);
        basis.distances = squared_distances(&basis.z, &basis.z);
        basis.typical = typical_distance(&basis.distances);
        Some(basis)
    }

    /// What the conditional expects (n, 3 T) of predictors (n, 3 P).
    fn linear(&self, x: &Array2<f64>) -> Array2<f64> {
        (x - &self.mean_x).dot(&self.coefficients) + &self.mean_y
    }

    /// z (n, 3 P) of predictors.
    fn scaled(&self, x: &Array2<f64>) -> Array2<f64> {
        (x - &self.mean_x) * &self.scale
    }

    /// The rows of others that are nearest to frames of the gaps.
    fn nearest(&self, others: &OtherPoses, own: &LocalPoses, gaps: &[Range<usize>]) -> Vec<usize> {
        let frames: Vec<usize> = gaps.iter().flat_map(|g| spread(g, NEAR_TO)).collect();
        let frames = self.scaled(&own.predictors.select(Axis(0), &frames));
        let frames: Vec<_> = (frames.outer_iter())
            .filter(|z| z.iter().all(|v| v.is_finite()))
            .map(|z| z.to_owned())
            .collect();
        let Ok(frames) = ndarray::stack(
            Axis(0),
            &frames.iter().map(|f| f.view()).collect::<Vec<_>>(),
        ) else {
            return Vec::new();
        };
        let distances = squared_distances(&self.scaled(&others.poses.predictors), &frames);
        let mut nearest: Vec<(f64, usize)> = (distances.outer_iter().enumerate())
            .map(|(row, d)| (d.iter().copied().fold(f64::INFINITY, f64::min), row))
            .collect();
        let count = NEAREST_OTHERS.min(nearest.len());
        if count < nearest.len() {
            nearest.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        }
        let mut rows: Vec<usize> = nearest[..count].iter().map(|n| n.1).collect();
        rows.sort_unstable();
        rows
    }

    /// The prediction for some frames, with the variance of the first `sure`.
    fn predict(
        &self,
        regression: &Regression<'_>,
        kernel: &Kernel,
        frames: &[usize],
        sure: usize,
    ) -> Option<Prediction> {
        let n = self.z.nrows();
        let mut gram = self.covariance(kernel, &self.distances, &self.seconds);
        let variance =
            self.residual.iter().map(|r| r * r).sum::<f64>() / self.residual.len() as f64;
        let noise = (regression.noise / variance.max(1e-12)).min(MOST_NOISE);
        (0..n).for_each(|i| gram[[i, i]] += NUGGET + noise);
        let factor = Cholesky::new(gram)?;
        let weights = factor.solve(&self.residual)?;
        // The most likely σ² of each coordinate; that of a point is the mean of its three.
        let sigma: Vec<f64> = (0..self.residual.ncols())
            .map(|c| self.residual.column(c).dot(&weights.column(c)) / n as f64)
            .collect();
        let x = regression.own.predictors.select(Axis(0), frames);
        let z = self.scaled(&x);
        let seconds: Vec<f64> = frames.iter().map(|&t| regression.seconds[t]).collect();
        let distances = squared_distances(&self.z, &z);
        let cross = self.covariance(kernel, &distances, &seconds);
        let half = factor.half_solve(&cross.slice(s![.., ..sure]).to_owned())?;
        let left: Vec<f64> = (half.columns().into_iter())
            .map(|c| (1.0 + kernel.time - c.dot(&c)).max(1e-9))
            .collect();
        let variance = Array2::from_shape_fn((sure, sigma.len()), |(t, c)| {
            let point = &sigma[c / 3 * 3..c / 3 * 3 + 3];
            left[t] * point.iter().sum::<f64>() / 3.0
        });
        Some(Prediction {
            mean: self.linear(&x) + cross.t().dot(&weights),
            variance,
        })
    }

    /// The covariance (over σ²) of training frames and others at squared distances (n, m) and
    /// `seconds` (m).
    fn covariance(&self, kernel: &Kernel, distances: &Array2<f64>, seconds: &[f64]) -> Array2<f64> {
        let width = kernel.width * self.typical;
        let mut out = distances.mapv(|d| 1.0 / (1.0 + d / width));
        if kernel.time > 0.0 {
            for (mut row, a) in out.outer_iter_mut().zip(&self.seconds) {
                for (v, b) in row.iter_mut().zip(seconds) {
                    let apart = (a - b).abs() / TIME_SCALE;
                    // NaN and what is far apart have nothing in common.
                    if apart < 20.0 {
                        *v += kernel.time * matern(apart);
                    }
                }
            }
        }
        out
    }
}

/// The Matérn 3/2 correlation.
fn matern(apart: f64) -> f64 {
    let a = 3f64.sqrt() * apart;
    (1.0 + a) * (-a).exp()
}

/// Kᵀ (3 P, 3 T).
fn conditional(moments: &Moments, own: &LocalPoses, ridge: f64) -> Option<Array2<f64>> {
    let p = own.predictors.ncols();
    let mut xx = moments.covariance.slice(s![..p, ..p]).to_owned();
    xx.diag_mut().mapv_inplace(|v| v + ridge);
    let xy = moments.covariance.slice(s![..p, p..]).to_owned();
    Cholesky::new(xx)?.solve(&xy)
}

/// s: .1 and each predictor's share in the targets' coefficients (3 P, 3 T), of 1 for the largest
/// of each target.
fn scales(coefficients: &Array2<f64>) -> Array1<f64> {
    let mut sum = Array1::<f64>::zeros(coefficients.nrows());
    for target in 0..coefficients.ncols() / 3 {
        let of_target = coefficients.slice(s![.., 3 * target..3 * target + 3]);
        let squares = of_target.map_axis(Axis(1), |row: ArrayView1<'_, f64>| row.dot(&row));
        let largest = squares.iter().copied().fold(1e-300, f64::max);
        sum += &(squares / largest);
    }
    let largest = sum.iter().copied().fold(1e-300, f64::max);
    sum.mapv(|v| 0.1 + (v / largest).sqrt())
}

/// Frames to learn from: some spread over the take, and those beside each gap.
fn training_frames(known: &[usize], gaps: &[Range<usize>], rate: f64) -> Vec<usize> {
    let mut frames: BTreeSet<usize> = (spread(&(0..known.len()), SPREAD_FRAMES))
        .into_iter()
        .map(|k| known[k])
        .collect();
    for away in BESIDE {
        let away = ((away * rate / 120.0).round() as usize).max(1);
        for gap in gaps {
            let before = gap.start.checked_sub(away);
            let beside = before.into_iter().chain([gap.end - 1 + away]);
            frames.extend(beside.filter(|t| known.binary_search(t).is_ok()));
        }
    }
    frames.into_iter().collect()
}

/// At most `count` numbers of a range, evenly spread, its ends among them.
pub(crate) fn spread(range: &Range<usize>, count: usize) -> Vec<usize> {
    let n = range.len();
    if n <= count {
        return range.clone().collect();
    }
    (0..count)
        .map(|k| range.start + k * (n - 1) / (count - 1))
        .collect()
}

/// |a − b|² between the rows of (n, d) and (m, d).
fn squared_distances(a: &Array2<f64>, b: &Array2<f64>) -> Array2<f64> {
    let squares = |x: &Array2<f64>| x.map_axis(Axis(1), |row| row.dot(&row));
    let mut out = a.dot(&b.t()) * -2.0;
    out += &squares(a).insert_axis(Axis(1));
    out += &squares(b);
    out.mapv_inplace(|v| v.max(0.0));
    out
}

/// The mean over the rows of the 10th percentile of each.
fn typical_distance(distances: &Array2<f64>) -> f64 {
    let tenth = |row: ArrayView1<'_, f64>| {
        let mut row = row.to_vec();
        let at = row.len() / 10;
        *row.select_nth_unstable_by(at, f64::total_cmp).1
    };
    let sum: f64 = distances.outer_iter().map(tenth).sum();
    (sum / distances.nrows().max(1) as f64).max(1e-12)
}
