//! Shift and drift by least squares over all speeds, with their standard deviations.

use super::speeds::{Speeds, ends};
use crate::numeric::cubic_spline::CubicSpline;

/// Speeds are compared this often at most, a second: filtered ones tell no more.
const SAMPLES: f64 = 40.0;
/// Steps of the iteration at most, and the last, seconds.
const STEPS: usize = 20;
const LAST_STEP: f64 = 1e-8;
/// The longest step, seconds: further away is another place.
const LONGEST_STEP: f64 = 0.05;
/// Blocks of time whose residuals count as independent: how many at most, and their length,
/// seconds.
const BLOCKS: f64 = 40.0;
const SHORTEST_BLOCK: f64 = 0.4;
/// A residual below this share of the speeds' variation is one of rounding.
const ROUNDING: f64 = 1e-12;

/// A refined place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Seconds.
    pub shift: f64,
    pub drift: f64,
    /// The standard deviations of both.
    pub deviations: [f64; 2],
    pub correlation: f64,
}

/// A speed of A: its time, itself, and its slope.
type Sample = [f64; 3];

/// Sums over pairs of speeds.
struct Equations {
    /// The products of the derivatives by shift and drift, and theirs with the residuals.
    normal: [[f64; 2]; 2],
    /// By blocks of time.
    right: Vec<[f64; 2]>,
    covariance: f64,
    variances: [f64; 2],
}

/// Refines the shift of `start` (seconds) and, with `drifts`, the drift; `None` where nothing is
/// compared.
pub(super) fn refine([a, b]: &[Speeds; 2], start: [f64; 2], drifts: bool) -> Option<Fit> {
    let samples: Vec<Vec<Sample>> = a
        .tracks
        .iter()
        .map(|track| sampled(track, a.rate))
        .collect();
    let [mut shift, mut drift] = start;
    let mut last = None;
    for _ in 0..STEPS {
        let equations = Equations::at(&samples, b, [shift, drift], a.seconds);
        let right = equations
            .right
            .iter()
            .fold([0.0; 2], |s, r| [s[0] + r[0], s[1] + r[1]]);
        let inverse = inverse(equations.normal, drifts)?;
        let step = multiply(inverse, right);
        last = Some((equations, inverse));
        // What the drift does at the middle is the shift's.
        let moved = step[0] + step[1] * a.seconds / 2.0;
        let scale = (LONGEST_STEP / moved.abs().max(step[1].abs() * a.seconds)).min(1.0);
        (shift, drift) = (shift + scale * step[0], drift + scale * step[1]);
        if step[0].abs() + step[1].abs() * a.seconds < LAST_STEP {
            break;
        }
    }
    let (equations, inverse) = last?;
    let [xx, yy] = equations.variances;
    Some(Fit {
        shift,
        drift,
        deviations: deviations(&equations.right, inverse, drifts),
        correlation: equations.covariance / (xx * yy).sqrt(),
    })
}

/// The speeds of a track that are compared.
fn sampled(track: &[CubicSpline], rate: f64) -> Vec<Sample> {
    let every = ((rate / SAMPLES) as usize).max(1);
    let of = |run: &CubicSpline| {
        let times = run.points().iter().step_by(every);
        let samples = times.map(|t| [*t, run.value(*t), run.slope(*t)]);
        samples.collect::<Vec<_>>()
    };
    track.iter().flat_map(of).collect()
}

impl Equations {
    /// Those at a shift and drift.
    fn at(samples: &[Vec<Sample>], b: &Speeds, place: [f64; 2], seconds: f64) -> Equations {
        let block = (seconds / BLOCKS).max(SHORTEST_BLOCK);
        let mut out = Equations {
            normal: [[0.0; 2]; 2],
            right: vec![[0.0; 2]; (seconds / block) as usize + 1],
            covariance: 0.0,
            variances: [0.0; 2],
        };
        for (samples, track) in samples.iter().zip(&b.tracks) {
            let pairs = paired(samples, track, place);
            if pairs.len() > 2 {
                out.add(&pairs, place[1], block);
            }
        }
        out
    }

    /// Adds the pairs of a point: what A has, and the time, speed and slope of B.
    fn add(&mut self, pairs: &[(Sample, Sample)], drift: f64, block: f64) {
        let n = pairs.len() as f64;
        let mean = |of: &dyn Fn(&(Sample, Sample)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let (x, y) = (mean(&|p| p.0[1]), mean(&|p| p.1[1]));
        let xx = mean(&|p| (p.0[1] - x).powi(2));
        let yy = mean(&|p| (p.1[1] - y).powi(2));
        let xy = mean(&|p| (p.0[1] - x) * (p.1[1] - y));
        if !(xy > 0.0 && xx > 0.0) {
            return;
        }
        let gain = xy / yy;
        let residual = |p: &(Sample, Sample)| p.0[1] - x - gain * (p.1[1] - y);
        let weight = 1.0 / mean(&|p| residual(p).powi(2)).max(ROUNDING * xx);
        for p in pairs {
            let slopes = [p.0[2], gain * p.1[2] / (1.0 + drift)];
            // Later speeds of B where its slope is positive are lower ones here.
            let push = -weight * residual(p) * (slopes[0] + slopes[1]) / 2.0;
            let product = weight * slopes[0] * slopes[1];
            let along = [1.0, p.1[0]];
            let k = ((p.0[0] / block) as usize).min(self.right.len() - 1);
            for i in 0..2 {
                self.right[k][i] += push * along[i];
                (0..2).for_each(|j| self.normal[i][j] += product * along[i] * along[j]);
            }
        }
        // As many as both vary: a point that a weight favors is no more alike.
        self.covariance += n * xy;
        self.variances[0] += n * xx;
        self.variances[1] += n * yy;
    }
}

/// The speeds of A for which B has one.
fn paired(samples: &[Sample], track: &[CubicSpline], place: [f64; 2]) -> Vec<(Sample, Sample)> {
    let mut runs = track
        .iter()
        .filter_map(|run| Some((run, ends(run)?)))
        .peekable();
    let mut out = Vec::with_capacity(samples.len());
    for sample in samples {
        let t = (sample[0] - place[0]) / (1.0 + place[1]);
        while runs.next_if(|(_, (_, last))| *last < t).is_some() {}
        if let Some((run, (first, _))) = runs.peek()
            && *first <= t
        {
            out.push((*sample, [t, run.value(t), run.slope(t)]));
        }
    }
    out
}

/// The inverse of a symmetric matrix, of its first element alone without drift; `None` where it has
/// none.
fn inverse(m: [[f64; 2]; 2], drifts: bool) -> Option<[[f64; 2]; 2]> {
    let [[a, b], [_, d]] = m;
    if !drifts {
        return (a > 0.0).then(|| [[1.0 / a, 0.0], [0.0, 0.0]]);
    }
    let determinant = a * d - b * b;
    let is_definite = a > 0.0 && determinant > 1e-12 * a * d;
    is_definite.then(|| {
        let [a, b, d] = [a, b, d].map(|v| v / determinant);
        [[d, -b], [-b, a]]
    })
}

fn multiply(m: [[f64; 2]; 2], v: [f64; 2]) -> [f64; 2] {
    m.map(|row| row[0] * v[0] + row[1] * v[1])
}

/// The standard deviations of shift and drift, by the sums of each block.
fn deviations(right: &[[f64; 2]], inverse: [[f64; 2]; 2], drifts: bool) -> [f64; 2] {
    let used: Vec<&[f64; 2]> = right.iter().filter(|r| r[0] != 0.0).collect();
    let mut squares = [0.0; 2];
    for own in &used {
        let step = multiply(inverse, **own);
        (0..2).for_each(|i| squares[i] += step[i] * step[i]);
    }
    let free = used.len() as f64 - if drifts { 2.0 } else { 1.0 };
    if used.is_empty() {
        return [0.0; 2]; // the speeds are the same
    }
    if free <= 2.0 {
        return [f64::INFINITY; 2]; // what the sums over so few blocks must add up to says nothing
    }
    // Few blocks tell it badly: that of Student's t.
    let few = used.len() as f64 / (free - 2.0);
    squares.map(|sum| (sum * few).sqrt())
}
