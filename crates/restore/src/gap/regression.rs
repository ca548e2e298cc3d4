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
//! says what each is worth, by gaps that are simulated. The training frames are spread over the
//! take and dense next to the gap; of the others, those nearest to the gap's own.
//!
//! A gap and those simulated for it share training frames, s and h. Those within simulated gaps
//! come last: the leading rows of the Cholesky factor are the factor without them, and so one
//! serves both.

use super::conditional::{Conditional, Moments, moments_without};
use super::local_poses::LocalPoses;
use super::tuning::regression::*;
use crate::numeric::linalg::{Cholesky, gram};
use ndarray::{Array1, Array2, ArrayView1, Axis, concatenate, s};
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

/// Frames that are predicted.
pub(crate) struct Wanted<'a> {
    /// Frames in gaps, of which a variance is wanted too, and those beside them.
    pub frames: &'a [usize],
    pub beside: &'a [usize],
    /// Whether the gaps are the simulated ones.
    pub is_simulated: bool,
}

/// The prediction of one process for some frames.
#[derive(Debug, Clone)]
pub(crate) struct Prediction {
    /// Means of the wanted frames, and of those beside them (frames, 3 T), cm.
    pub mean: Array2<f64>,
    pub beside: Array2<f64>,
    /// (frames, 3 T), cm²; empty of a process without time and of the conditional.
    pub variance: Array2<f64>,
}

impl Regression<'_> {
    /// The processes that predict a gap.
    pub(crate) fn kernels(&self, gap: &Range<usize>) -> &'static [Kernel] {
        let own = self.complete.iter().filter(|c| **c).count() as f64;
        match self.others {
            // The last learns from the take alone.
            Some(_) if own < OWN_FRAMES => &POOLED[..2],
            Some(_) => &POOLED,
            None if (gap.len() as f64) < ONE_PROCESS * self.rate => &OWN[..1],
            None => &OWN,
        }
    }

    /// Learns from the frames outside `gap`, to predict those of simulated gaps without what is in
    /// any of these. `None` where there is nothing to learn from.
    pub(crate) fn learn(&self, gap: &Range<usize>, simulated: &[Range<usize>]) -> Option<Learned> {
        let kernels = self.kernels(gap);
        let mut bases = Vec::new();
        if let Some(others) = self.others {
            bases.push(Basis::new(self, gap, simulated, Some(others))?);
        }
        if kernels.iter().any(|k| !k.others) {
            bases.push(Basis::new(self, gap, simulated, None)?);
        }
        let last = bases.len().checked_sub(1)?;
        let most = self.others.map_or(0.0, |_| MOST_NOISE);
        let process = |kernel: &Kernel| {
            let basis = if kernel.others { 0 } else { last };
            Some((
                basis,
                Process::new(&bases[basis], kernel, [self.noise, most])?,
            ))
        };
        let processes = kernels.iter().map(process).collect::<Option<_>>()?;
        Some(Learned { bases, processes })
    }
}

/// The processes, trained.
pub(crate) struct Learned {
    /// With others' poses, if there are any, and of the take alone, if a process wants it.
    bases: Vec<Basis>,
    /// Each with the number of its basis.
    processes: Vec<(usize, Process)>,
}

impl Learned {
    /// One prediction a process, and last that of the conditional alone.
    pub(crate) fn predict(
        &self,
        regression: &Regression<'_>,
        wanted: &Wanted<'_>,
    ) -> Option<Vec<Prediction>> {
        let inputs = |basis| Inputs::new(basis, regression, wanted);
        let inputs: Vec<Inputs> = self.bases.iter().map(inputs).collect();
        let of_process = |(basis, process): &(usize, Process)| {
            process.predict(&self.bases[*basis], &inputs[*basis], wanted)
        };
        let all = self.processes.iter().map(of_process);
        let mut out: Vec<Prediction> = all.collect::<Option<_>>()?;
        let mean = self.bases[0].conditional(wanted).expects(&inputs[0].x);
        out.push(wanted.prediction(mean, Array2::zeros((0, 0))));
        Some(out)
    }
}

impl Wanted<'_> {
    /// A prediction of means, those in gaps first.
    fn prediction(&self, mean: Array2<f64>, variance: Array2<f64>) -> Prediction {
        let n = self.frames.len();
        Prediction {
            beside: mean.slice(s![n.., ..]).to_owned(),
            mean: mean.slice(s![..n, ..]).to_owned(),
            variance,
        }
    }
}

/// The conditional and the training frames of the processes on what it leaves; what has `without`
/// in its name is learned without the frames in simulated gaps.
struct Basis {
    with: Conditional,
    without: Conditional,
    /// s (3 P).
    scale: Array1<f64>,
    /// z of the training frames (n, 3 P), those in simulated gaps last.
    z: Array2<f64>,
    /// How many are in none.
    kept: usize,
    /// What the conditionals leave of them (n, 3 T), without those in simulated gaps: 0.
    residual: Array2<f64>,
    residual_without: Array2<f64>,
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
        gap: &Range<usize>,
        simulated: &[Range<usize>],
        others: Option<&OtherPoses>,
    ) -> Option<Basis> {
        let own = regression.own;
        let is_held = |t: &usize| simulated.iter().any(|g| g.contains(t));
        let known: Vec<usize> = (0..regression.complete.len())
            .filter(|&t| regression.complete[t] && !gap.contains(&t))
            .collect();
        let [with, without] = conditionals(regression, &known, is_held, others)?;
        let (frames, held): (Vec<usize>, Vec<usize>) =
            (training_frames(&known, gap, simulated, regression.rate).into_iter())
                .partition(|t| !is_held(t));
        let scale = with.scales();
        let mut x = own.predictors.select(Axis(0), &frames);
        let mut y = own.targets.select(Axis(0), &frames);
        let mut seconds: Vec<f64> = frames.iter().map(|&t| regression.seconds[t]).collect();
        if let Some(others) = others {
            let scaled = |x: &Array2<f64>| with.centered(x) * &scale;
            let of_others = scaled(&others.poses.predictors);
            let mut nearest = BTreeSet::new();
            for gaps in [std::slice::from_ref(gap), simulated] {
                let frames: Vec<usize> = gaps.iter().flat_map(|g| spread(g, NEAR_TO)).collect();
                let z = scaled(&own.predictors.select(Axis(0), &frames));
                nearest.extend(nearest_rows(&of_others, z));
            }
            let nearest: Vec<usize> = nearest.into_iter().collect();
            let rows = |all: &Array2<f64>| all.select(Axis(0), &nearest);
            x.append(Axis(0), rows(&others.poses.predictors).view())
                .ok()?;
            y.append(Axis(0), rows(&others.poses.targets).view()).ok()?;
            seconds.resize(x.nrows(), f64::NAN);
        }
        let kept = x.nrows();
        x.append(Axis(0), own.predictors.select(Axis(0), &held).view())
            .ok()?;
        y.append(Axis(0), own.targets.select(Axis(0), &held).view())
            .ok()?;
        seconds.extend(held.iter().map(|&t| regression.seconds[t]));
        let z = with.centered(&x) * &scale;
        let distances = squared_distances_within(&z);
        let mut residual_without = &y - &without.expects(&x);
        residual_without.slice_mut(s![kept.., ..]).fill(0.0);
        Some(Basis {
            residual: &y - &with.expects(&x),
            residual_without,
            typical: typical_distance(&distances, &z),
            distances,
            with,
            without,
            scale,
            z,
            kept,
            seconds,
        })
    }

    /// What the wanted frames are predicted by.
    fn conditional(&self, wanted: &Wanted<'_>) -> &Conditional {
        if wanted.is_simulated {
            &self.without
        } else {
            &self.with
        }
    }

    /// The covariance (over σ²) of training frames, its lower triangle.
    fn own_covariance(&self, kernel: &Kernel) -> Array2<f64> {
        let mut out = Array2::zeros(self.distances.dim());
        for (k, mut row) in out.outer_iter_mut().enumerate() {
            let row = row.as_slice_mut().unwrap_or_default();
            self.set_row(
                kernel,
                k,
                &self.distances,
                &self.seconds[..=k],
                &mut row[..=k],
            );
        }
        out
    }

    /// The covariance (over σ²) of training frames and others (n, m).
    fn covariance(&self, kernel: &Kernel, inputs: &Inputs) -> Array2<f64> {
        let mut out = Array2::zeros(inputs.distances.dim());
        for (k, mut row) in out.outer_iter_mut().enumerate() {
            let row = row.as_slice_mut().unwrap_or_default();
            self.set_row(kernel, k, &inputs.distances, &inputs.seconds, row);
        }
        out
    }

    /// The covariance of the k-th training frame and others at squared distances in the k-th row,
    /// and `seconds`.
    fn set_row(
        &self,
        kernel: &Kernel,
        k: usize,
        distances: &Array2<f64>,
        seconds: &[f64],
        out: &mut [f64],
    ) {
        let width = kernel.width * self.typical;
        for (v, d) in out.iter_mut().zip(distances.row(k)) {
            *v = width / (width + d);
        }
        if kernel.time == 0.0 {
            return;
        }
        for (v, b) in out.iter_mut().zip(seconds) {
            let apart = (self.seconds[k] - b).abs() / TIME_SCALE;
            // NaN and what is far apart have nothing in common.
            if apart < FAR_APART {
                *v += kernel.time * matern(apart);
            }
        }
    }
}

/// The conditionals of the frames `known`, with and without those that are held.
fn conditionals(
    regression: &Regression<'_>,
    known: &[usize],
    is_held: impl Fn(&usize) -> bool,
    others: Option<&OtherPoses>,
) -> Option<[Conditional; 2]> {
    let step = known.len().div_ceil(COVARIANCE_FRAMES).max(1);
    let (kept, held): (Vec<usize>, Vec<usize>) =
        (known.iter().copied().step_by(step)).partition(|t| !is_held(t));
    if kept.len() < 2 {
        return None;
    }
    let (with, without) = moments_without(regression.own, &kept, &held);
    let (p, ridge) = (regression.own.predictors.ncols(), RIDGE + regression.noise);
    let of = |moments: Moments, count: usize| match others {
        Some(others) => {
            let w = 0.5 * ((count * step) as f64 / OWN_FRAMES).min(1.0);
            Conditional::new(&moments.pooled(w, &others.moments), p, ridge)
        }
        None => Conditional::new(&moments, p, ridge),
    };
    Some([of(with, kept.len() + held.len())?, of(without, kept.len())?])
}

/// The rows of `all` that are nearest to any of `z` that is known.
fn nearest_rows(all: &Array2<f64>, z: Array2<f64>) -> Vec<usize> {
    let known: Vec<usize> = (0..z.nrows())
        .filter(|k| z.row(*k).iter().all(|v| v.is_finite()))
        .collect();
    if known.is_empty() {
        return Vec::new();
    }
    let distances = squared_distances(all, &z.select(Axis(0), &known));
    let mut nearest: Vec<(f64, usize)> = (distances.outer_iter().enumerate())
        .map(|(row, d)| (d.iter().copied().fold(f64::INFINITY, f64::min), row))
        .collect();
    let count = NEAREST_OTHERS.min(nearest.len());
    if count < nearest.len() {
        nearest.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
    nearest[..count].iter().map(|n| n.1).collect()
}

/// Frames that are predicted: their predictors, and their squared distances to training frames.
struct Inputs {
    x: Array2<f64>,
    seconds: Vec<f64>,
    distances: Array2<f64>,
}

impl Inputs {
    fn new(basis: &Basis, regression: &Regression<'_>, wanted: &Wanted<'_>) -> Inputs {
        let frames = [wanted.frames, wanted.beside].concat();
        let x = regression.own.predictors.select(Axis(0), &frames);
        let z = basis.with.centered(&x) * &basis.scale;
        Inputs {
            distances: squared_distances(&basis.z, &z),
            seconds: frames.iter().map(|&t| regression.seconds[t]).collect(),
            x,
        }
    }
}

/// A Gaussian process, trained.
struct Process {
    kernel: Kernel,
    factor: Cholesky,
    /// (C + noise)⁻¹ r (n, 3 T), with and without the frames in simulated gaps.
    weights: [Array2<f64>; 2],
    /// The most likely σ² of each point, the mean of its three coordinates'.
    sigma: [Vec<f64>; 2],
}

impl Process {
    fn new(basis: &Basis, kernel: &Kernel, [noise, most]: [f64; 2]) -> Option<Process> {
        let n = basis.z.nrows();
        let mut gram = basis.own_covariance(kernel);
        let squares = basis.residual.iter().map(|r| r * r).sum::<f64>();
        let variance = squares / basis.residual.len() as f64;
        let noise = (noise / variance.max(1e-12)).min(most);
        gram.diag_mut().mapv_inplace(|v| v + NUGGET + noise);
        let factor = Cholesky::new(gram)?;
        let both = [basis.residual.view(), basis.residual_without.view()];
        let mut half = factor.half_solve(&concatenate(Axis(1), &both).ok()?)?;
        let columns = basis.residual.ncols();
        half.slice_mut(s![basis.kept.., columns..]).fill(0.0);
        let sigma = |first: usize, n: usize| {
            let of_point = |point: usize| {
                let half = half.slice(s![.., first + 3 * point..first + 3 * point + 3]);
                half.iter().map(|v| v * v).sum::<f64>() / (3 * n) as f64
            };
            (0..columns / 3).map(of_point).collect()
        };
        let weights = factor.half_solve_transposed(&half)?;
        Some(Process {
            sigma: [sigma(0, n), sigma(columns, basis.kept)],
            weights: [s![.., ..columns], s![.., columns..]].map(|c| weights.slice(c).to_owned()),
            kernel: *kernel,
            factor,
        })
    }

    /// The prediction for the wanted frames.
    fn predict(&self, basis: &Basis, inputs: &Inputs, wanted: &Wanted<'_>) -> Option<Prediction> {
        let which = usize::from(wanted.is_simulated);
        let cross = basis.covariance(&self.kernel, inputs);
        let mean =
            basis.conditional(wanted).expects(&inputs.x) + cross.t().dot(&self.weights[which]);
        if self.kernel.time == 0.0 {
            return Some(wanted.prediction(mean, Array2::zeros((0, 0))));
        }
        let sure = cross.slice(s![.., ..wanted.frames.len()]).to_owned();
        let half = self.factor.half_solve(&sure)?;
        let rows = if wanted.is_simulated {
            basis.kept
        } else {
            half.nrows()
        };
        let left: Vec<f64> = (half.slice(s![..rows, ..]).columns().into_iter())
            .map(|c| (1.0 + self.kernel.time - c.dot(&c)).max(1e-9))
            .collect();
        let shape = (left.len(), mean.ncols());
        let variance = Array2::from_shape_fn(shape, |(t, c)| left[t] * self.sigma[which][c / 3]);
        Some(wanted.prediction(mean, variance))
    }
}

/// The Matérn 3/2 correlation.
fn matern(apart: f64) -> f64 {
    let a = 3f64.sqrt() * apart;
    (1.0 + a) * (-a).exp()
}

/// Frames to learn from: some spread over the take, at least half as many outside simulated gaps,
/// which may hide most of it, and those beside each gap.
fn training_frames(
    known: &[usize],
    gap: &Range<usize>,
    simulated: &[Range<usize>],
    rate: f64,
) -> BTreeSet<usize> {
    let some = |of: &[usize], count: usize| -> BTreeSet<usize> {
        (spread(&(0..of.len()), count).into_iter().map(|k| of[k])).collect()
    };
    let is_kept = |t: &usize| !simulated.iter().any(|g| g.contains(t));
    let mut frames = some(known, SPREAD_FRAMES);
    if frames.iter().filter(|t| is_kept(t)).count() < SPREAD_FRAMES / 2 {
        let kept: Vec<usize> = known.iter().copied().filter(is_kept).collect();
        frames.extend(some(&kept, SPREAD_FRAMES / 2));
    }
    for away in BESIDE {
        let away = ((away * rate / 120.0).round() as usize).max(1);
        for gap in simulated.iter().chain([gap]) {
            let before = gap.start.checked_sub(away);
            let beside = before.into_iter().chain([gap.end - 1 + away]);
            frames.extend(beside.filter(|t| known.binary_search(t).is_ok()));
        }
    }
    frames
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

/// |a − b|² between the rows of (n, d).
fn squared_distances_within(a: &Array2<f64>) -> Array2<f64> {
    let products = gram(a.t());
    let squares = products.diag().to_owned();
    distances_by(products, &squares, &squares)
}

/// |a − b|² between the rows of (n, d) and (m, d).
fn squared_distances(a: &Array2<f64>, b: &Array2<f64>) -> Array2<f64> {
    let squares = |x: &Array2<f64>| x.map_axis(Axis(1), |row| row.dot(&row));
    distances_by(a.dot(&b.t()), &squares(a), &squares(b))
}

/// |a − b|² by the products a · b and the squares of both.
fn distances_by(products: Array2<f64>, a: &Array1<f64>, b: &Array1<f64>) -> Array2<f64> {
    let mut out = products * -2.0;
    out += &a.view().insert_axis(Axis(1));
    out += b;
    out.mapv_inplace(|v| v.max(0.0));
    out
}

/// The mean over the rows of the 10th percentile of each, at least what rounding leaves of z.
fn typical_distance(distances: &Array2<f64>, z: &Array2<f64>) -> f64 {
    let tenth = |row: ArrayView1<'_, f64>| {
        let mut row = row.to_vec();
        let at = row.len() / 10;
        *row.select_nth_unstable_by(at, f64::total_cmp).1
    };
    let sum: f64 = distances.outer_iter().map(tenth).sum();
    let largest = z.iter().fold(0.0, |largest: f64, v| largest.max(v * v));
    (sum / distances.nrows().max(1) as f64).max(1e-12 + ROUNDING * largest)
}
