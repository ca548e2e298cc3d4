//! Filled points held to the distances that the take itself shows to be rigid: bones, and markers
//! of one segment.
//!
//! The estimates of a frame's missing points, x ~ N(m, P) with P diagonal, are updated by the
//! measured distances d = |a − b| with variances v, by an iterated extended Kalman update, whose
//! steps are halved until they help:
//!
//! ```text
//! x ← m + P Hᵀ (H P Hᵀ + V)⁻¹ (d − g(x) − H (m − x))
//!     g(x) the distances at x, H their Jacobian
//! ```

use super::tuning::rigid_distances::*;
use super::{FilledGap, Gap};
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel;
use crate::pose::{FillMethod, point_at};
use crate::take::Take;
use glam::DVec3;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis};
use std::collections::BTreeMap;

/// Holds filled gaps to the rigid distances of the take.
pub(crate) fn hold(take: &Take<'_>, gaps: &[Gap], filled: &mut [Option<FilledGap>]) {
    let captured = take.xyz;
    // frame -> gaps that are filled there
    let mut frames: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (k, gap) in (gaps.iter().enumerate()).filter(|(k, _)| filled[*k].is_some()) {
        (gap.frames.clone()).for_each(|t| frames.entry(t).or_default().push(k));
    }
    let mut points: Vec<usize> = frames.values().flatten().map(|k| gaps[*k].point).collect();
    points.sort_unstable();
    points.dedup();
    let distances = TakeDistances::measure(captured, &points);
    let frames: Vec<(usize, Vec<usize>)> = frames.into_iter().collect();
    let held = parallel::map_chunks(frames.len(), 16, |range| {
        let hold = |(t, here): &(usize, Vec<usize>)| {
            let points: Vec<usize> = here.iter().map(|k| gaps[*k].point).collect();
            let mut frame = captured.row(*t).to_vec();
            let mut variance = Vec::with_capacity(3 * here.len());
            for k in here {
                let Some(filled) = &filled[*k] else { continue };
                let (row, first) = (t - gaps[*k].frames.start, 3 * gaps[*k].point);
                for axis in 0..3 {
                    // What was measured of a point seen in part stays.
                    if frame[first + axis].is_finite() {
                        variance.push(MEASURED);
                    } else {
                        frame[first + axis] = filled.xyz[[row, axis]];
                        // Motion comes with the take's bones.
                        let is_moved = filled.method == FillMethod::Motion;
                        variance.push(if is_moved {
                            MEASURED
                        } else {
                            filled.variance[row]
                        });
                    }
                }
            }
            let noise = |p: usize| take.sd.map_or(0.0, |sd| sd[[*t, p]].powi(2));
            distances.hold(&mut frame, &points, &mut variance, noise);
            (frame, variance)
        };
        frames[range].iter().map(hold).collect::<Vec<_>>()
    });
    for ((t, here), (frame, variance)) in frames.iter().zip(held.into_iter().flatten()) {
        for (k, variance) in here.iter().zip(variance.chunks_exact(3)) {
            let gap = &gaps[*k];
            let open = filled[*k]
                .as_mut()
                .filter(|f| f.method != FillMethod::Motion);
            if let Some(filled) = open {
                let row = t - gap.frames.start;
                filled.variance[row] = variance.iter().sum::<f64>() / 3.0;
                let held = ArrayView1::from(&frame[3 * gap.point..3 * gap.point + 3]);
                filled.xyz.row_mut(row).assign(&held);
            }
        }
    }
}

/// A rigid distance between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pair {
    points: [usize; 2],
    /// cm.
    length: f64,
    /// cm².
    variance: f64,
}

/// The rigid distances of a take.
pub(crate) struct TakeDistances(Vec<Pair>);

impl TakeDistances {
    /// Measures the distances of `points` to all points in `xyz` (frames, 3 J; NaN missing).
    pub(crate) fn measure(xyz: ArrayView2<'_, f64>, points: &[usize]) -> TakeDistances {
        let count = xyz.ncols() / 3;
        let step = xyz.nrows().div_ceil(MOST_FRAMES).max(1);
        let frames: Vec<Vec<DVec3>> = (0..xyz.nrows())
            .step_by(step)
            .map(|t| (0..count).map(|p| point_at(xyz, t, p)).collect())
            .collect();
        let mut pairs = Vec::new();
        for &a in points {
            let mut own: Vec<Pair> = (0..count)
                .filter(|b| *b != a)
                .filter_map(|b| measure(&frames, a, b))
                .collect();
            own.sort_by(|a, b| a.variance.total_cmp(&b.variance));
            own.truncate(MOST_PAIRS);
            pairs.extend(own);
        }
        pairs.sort_by_key(|p| p.points);
        pairs.dedup_by_key(|p| p.points);
        TakeDistances(pairs)
    }

    /// Moves the missing `points` of a frame (3 J, all that is known filled in) to where their
    /// distances are right; `variance` is that of each of their coordinates, cm², and becomes
    /// what is left of it; `noise` gives the variance of a seen point, cm². What else the frame
    /// lacks may be NaN.
    pub(crate) fn hold(
        &self,
        frame: &mut [f64],
        points: &[usize],
        variance: &mut [f64],
        noise: impl Fn(usize) -> f64,
    ) {
        let Some(update) = Update::new(&self.0, frame, points, noise) else {
            return;
        };
        let mut reached = update.objective(frame, variance);
        for _ in 0..STEPS {
            let Some(step) = update.step(frame, variance) else {
                break;
            };
            let halved =
                (0..HALVINGS).map(|k| update.stepped(frame, &step, 0.5_f64.powi(k as i32)));
            let lower = halved
                .map(|f| (update.objective(&f, variance), f))
                .find(|(o, _)| *o < reached);
            let Some((found, moved)) = lower else { break };
            frame.copy_from_slice(&moved);
            let is_converged = reached - found < CONVERGED;
            reached = found;
            if is_converged {
                break;
            }
        }
        // Missing points err together: their distances tell their shape, not where they are.
        let seen = update.with_seen_points();
        let Some(step) = seen.step(frame, variance) else {
            return;
        };
        let Some(half) = step.factor.half_solve(&step.weighted) else {
            return;
        };
        let explained = half.map_axis(Axis(0), |column| column.dot(&column));
        (variance.iter_mut().zip(explained)).for_each(|(v, e)| *v = (*v - e).max(1e-3 * *v));
    }
}

fn position(frame: &[f64], point: usize) -> DVec3 {
    DVec3::from_slice(&frame[3 * point..3 * point + 3])
}

/// The update of a frame's missing points by their distances.
struct Update<'a> {
    points: &'a [usize],
    /// Where the points were estimated to be, cm: m above.
    mean: Vec<DVec3>,
    /// The distances that tell something, with the noise of seen points, and which of the missing
    /// points each ends at.
    pairs: Vec<(Pair, [Option<usize>; 2])>,
}

/// A step of it.
struct Step {
    /// (3 missing points, 1), from the mean.
    change: Array2<f64>,
    /// The Cholesky factor of H P Hᵀ + V.
    factor: Cholesky,
    /// H P (distances, 3 missing points).
    weighted: Array2<f64>,
}

impl<'a> Update<'a> {
    /// `None` where no distance tells anything.
    fn new(
        distances: &[Pair],
        frame: &[f64],
        points: &'a [usize],
        noise: impl Fn(usize) -> f64,
    ) -> Option<Update<'a>> {
        let together = points.len() <= MOST_POINTS;
        let mut missing = vec![None; frame.len() / 3];
        for (k, p) in points.iter().enumerate() {
            missing[*p] = Some(k);
        }
        let noisy = |pair: &Pair| {
            let seen = pair.points.iter().filter(|p| missing[**p].is_none());
            let noise: f64 = seen.map(|p| noise(*p)).filter(|v| v.is_finite()).sum();
            Pair {
                variance: pair.variance + noise,
                ..*pair
            }
        };
        let pairs = distances.iter();
        let pairs: Vec<(Pair, [Option<usize>; 2])> = pairs
            .map(|pair| (noisy(pair), pair.points.map(|p| missing[p])))
            .filter(|(pair, ends)| {
                let missing = ends.iter().flatten().count();
                let is_known = pair.points.iter().all(|p| position(frame, *p).is_finite());
                is_known && (missing == 1 || missing == 2 && together)
            })
            .collect();
        (!pairs.is_empty()).then(|| Update {
            points,
            mean: points.iter().map(|p| position(frame, *p)).collect(),
            pairs,
        })
    }

    /// By the distances to seen points alone.
    fn with_seen_points(mut self) -> Update<'a> {
        (self.pairs).retain(|(_, ends)| ends.iter().any(Option::is_none));
        self
    }

    /// −2 log of the density, but for a constant.
    fn objective(&self, frame: &[f64], variance: &[f64]) -> f64 {
        let moved = self.points.iter().zip(&self.mean).enumerate();
        let moved = moved.map(|(k, (p, m))| {
            let off = position(frame, *p) - *m;
            (0..3)
                .map(|axis| off[axis].powi(2) / variance[3 * k + axis])
                .sum::<f64>()
        });
        let missed = self.pairs.iter().map(|(pair, _)| {
            let apart = position(frame, pair.points[0]) - position(frame, pair.points[1]);
            (apart.length() - pair.length).powi(2) / pair.variance
        });
        moved.sum::<f64>() + missed.sum::<f64>()
    }

    /// The Jacobian H (distances, 3 missing points) at a frame, and d − g(x) − H (m − x).
    fn linearized(&self, frame: &[f64]) -> (Array2<f64>, Array2<f64>) {
        let mut jacobian = Array2::<f64>::zeros((self.pairs.len(), 3 * self.points.len()));
        let mut rest = Array2::<f64>::zeros((self.pairs.len(), 1));
        for (k, (pair, ends)) in self.pairs.iter().enumerate() {
            let apart = position(frame, pair.points[0]) - position(frame, pair.points[1]);
            let length = apart.length().max(1e-9);
            rest[[k, 0]] = pair.length - length;
            for (end, sign) in ends.iter().zip([1.0, -1.0]) {
                let Some(i) = *end else { continue };
                let direction = sign * apart / length;
                rest[[k, 0]] -= direction.dot(self.mean[i] - position(frame, self.points[i]));
                for axis in 0..3 {
                    jacobian[[k, 3 * i + axis]] = direction[axis];
                }
            }
        }
        (jacobian, rest)
    }

    /// The step at a frame.
    fn step(&self, frame: &[f64], variance: &[f64]) -> Option<Step> {
        let (jacobian, rest) = self.linearized(frame);
        let mut weighted = jacobian.clone();
        for (c, mut column) in weighted.columns_mut().into_iter().enumerate() {
            column *= variance[c];
        }
        let mut gain = weighted.dot(&jacobian.t());
        (self.pairs.iter().enumerate()).for_each(|(k, (p, _))| gain[[k, k]] += p.variance);
        let factor = Cholesky::new(gain)?;
        let change = weighted.t().dot(&factor.solve(&rest)?);
        Some(Step {
            change,
            factor,
            weighted,
        })
    }

    /// The frame after a share of a step.
    fn stepped(&self, frame: &[f64], step: &Step, share: f64) -> Vec<f64> {
        let mut moved = frame.to_vec();
        for (i, p) in self.points.iter().enumerate() {
            let full = DVec3::from_array([0, 1, 2].map(|a| step.change[[3 * i + a, 0]]));
            let to = position(frame, *p).lerp(self.mean[i] + full, share);
            moved[3 * p..3 * p + 3].copy_from_slice(&to.to_array());
        }
        moved
    }
}

/// The distance of two points, if it is rigid.
fn measure(frames: &[Vec<DVec3>], a: usize, b: usize) -> Option<Pair> {
    let lengths: Vec<f64> = (frames.iter())
        .map(|f| (f[a] - f[b]).length())
        .filter(|l| l.is_finite())
        .collect();
    if lengths.len() < FEWEST_FRAMES {
        return None;
    }
    let n = lengths.len() as f64;
    let length = lengths.iter().sum::<f64>() / n;
    let variance = lengths.iter().map(|l| (l - length).powi(2)).sum::<f64>() / n;
    (variance <= RIGID * RIGID && length > 10.0 * RIGID).then_some(Pair {
        points: [a.min(b), a.max(b)],
        length,
        variance: variance + LEAST_VARIANCE,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_point_is_moved_to_its_distances() {
        // Point 2 stands 3 cm above point 0 and 5 cm from point 1, wherever they are.
        let xyz = Array2::from_shape_fn((60, 9), |(t, c)| {
            let shift = [(t as f64 * 0.1).sin(), t as f64 * 0.2, 0.0][c % 3];
            [0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 3.0, 0.0][c] + shift
        });
        let distances = TakeDistances::measure(xyz.view(), &[2]);
        assert_eq!(distances.0.len(), 2);
        let mut frame = xyz.row(10).to_vec();
        let truth = frame.clone();
        frame[6] += 0.3;
        frame[7] -= 0.4;
        distances.hold(&mut frame, &[2], &mut [1.0; 3], |_| 0.0);
        let off = (6..9)
            .map(|i| (frame[i] - truth[i]).abs())
            .fold(0.0, f64::max);
        assert!(off <= 0.01, "{off}");
        // A sure point hardly moves, and unknown ends count for nothing.
        let mut frame = truth.clone();
        frame[6] += 0.3;
        distances.hold(&mut frame, &[2], &mut [1e-9; 3], |_| 0.0);
        assert!((frame[6] - truth[6] - 0.3).abs() <= 1e-3);
        frame[0] = f64::NAN;
        frame[3] = f64::NAN;
        distances.hold(&mut frame, &[2], &mut [1.0; 3], |_| 0.0);
        assert!((frame[6] - truth[6] - 0.3).abs() <= 1e-3);
    }
}
