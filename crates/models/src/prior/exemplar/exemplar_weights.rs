//! Weights of all training poses given an observation, and their weighted mean and covariance.

use ndarray::linalg::general_mat_mul;
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis};

/// Poses of a density below e⁻²⁰ of the best's are left out: even a million of them weigh less than
/// 1/400.
const NEGLIGIBLE: f64 = 20.0;
/// The covariance leaves out poses with less than this share of the largest weight.
const LIGHT: f64 = 1e-5;
/// Largest number of poses in the covariance; with a large width nearly all poses have a weight.
/// Measured with 10,500 poses of CMU's 01 and 02, whole takes held out: the error is the same to
/// 0.2%.
const SAMPLE: usize = 2048;

/// Training poses, centered for fast distances.
#[derive(Debug)]
pub(crate) struct ExemplarWeights {
    /// The mean pose (D), subtracted so that squared distances cancel less.
    pub middle: Vec<f64>,
    /// x − middle, (n, D).
    pub rows: Array2<f32>,
    /// Their squares (n, D).
    squares: Array2<f32>,
    /// The greatest magnitude of each column of `rows`.
    reach: Vec<f64>,
}

/// The poses with a weight for an observation, and their normalized weights.
pub(crate) struct Explained {
    rows: Vec<u32>,
    weights: Vec<f64>,
    /// ln Σ_n exp(−½ d_n²) over all n.
    pub log: f64,
}

impl ExemplarWeights {
    pub(crate) fn new(poses: ArrayView2<'_, f64>) -> ExemplarWeights {
        let mean = poses.mean_axis(Axis(0));
        let middle = mean.unwrap_or_else(|| Array1::zeros(poses.ncols()));
        let rows = (&poses - &middle).mapv(|v| v as f32);
        let greatest = |c: ArrayView1<'_, f32>| c.fold(0.0, |m: f64, v| m.max(f64::from(v.abs())));
        ExemplarWeights {
            reach: rows.columns().into_iter().map(greatest).collect(),
            squares: rows.mapv(|v| v * v),
            middle: middle.to_vec(),
            rows,
        }
    }

    pub(crate) fn centered(&self, y: ArrayView1<'_, f64>, weights: &[f64]) -> Vec<f64> {
        let each = y.iter().zip(&self.middle).zip(weights);
        each.map(|((y, m), w)| if *w > 0.0 { y - m } else { 0.0 })
            .collect()
    }

    pub(crate) fn uncentered(&self, mut pose: Vec<f64>) -> Vec<f64> {
        pose.iter_mut().zip(&self.middle).for_each(|(p, m)| *p += m);
        pose
    }

    /// Σ_o w_o (x_o² − 2 y_o x_o), f32: (observations, n). Smaller is nearer, off by at most
    /// [`ExemplarWeights::margin`].
    pub(crate) fn scores(&self, y: &[Vec<f64>], weights: &[Vec<f64>]) -> Array2<f32> {
        let (m, d) = (y.len(), self.middle.len());
        let w = Array2::from_shape_fn((m, d), |(i, c)| weights[i][c] as f32);
        let crossed = Array2::from_shape_fn((m, d), |(i, c)| (weights[i][c] * y[i][c]) as f32);
        let mut scores = if weights.windows(2).all(|p| p[0] == p[1]) {
            let own = self.squares.dot(&w.row(0));
            let shared = own.broadcast((m, self.rows.nrows()));
            shared.map_or_else(|| Array2::zeros((m, self.rows.nrows())), |v| v.to_owned())
        } else {
            w.dot(&self.squares.t())
        };
        general_mat_mul(-2.0, &crossed, &self.rows.t(), 1.0, &mut scores);
        scores
    }

    /// How far a score may be off, by rounding in f32 (Higham, Accuracy and Stability of Numerical
    /// Algorithms, eq. 3.5).
    fn margin(&self, y: &[f64], weights: &[f64]) -> f64 {
        let terms = y.iter().zip(weights).zip(&self.reach);
        let sum: f64 = terms.map(|((y, w), r)| w * r * (2.0 * y.abs() + r)).sum();
        f64::from(f32::EPSILON) * (y.len() as f64 + 4.0) * sum
    }

    /// The poses that matter and their weights, from the scores of all.
    pub(crate) fn explain(
        &self,
        scores: ArrayView1<'_, f32>,
        y: &[f64],
        weights: &[f64],
    ) -> Explained {
        let least = scores.fold(f32::INFINITY, |m, v| m.min(*v));
        let within = f64::from(least) + 2.0 * (NEGLIGIBLE + self.margin(y, weights));
        let terms: Vec<(usize, f64, f64)> = (0..y.len())
            .filter(|&c| weights[c] > 0.0)
            .map(|c| (c, weights[c], y[c]))
            .collect();
        // `!(a > b)`: an overflow is no reason to leave a pose out.
        let mut near: Vec<(u32, f64)> = (0u32..)
            .zip(scores)
            .filter(|(_, score)| !(f64::from(**score) > within))
            .map(|(row, _)| (row, 0.5 * self.distance(row as usize, &terms)))
            .collect();
        let least = near.iter().fold(f64::INFINITY, |m, (_, h)| m.min(*h));
        near.retain(|(_, half)| half - least <= NEGLIGIBLE);
        let mut weights: Vec<f64> = near.iter().map(|(_, half)| (least - half).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Explained {
            rows: near.into_iter().map(|(row, _)| row).collect(),
            weights,
            log: sum.ln() - least,
        }
    }

    fn distance(&self, row: usize, terms: &[(usize, f64, f64)]) -> f64 {
        let pose = self.rows.row(row);
        let square = |&(c, w, y): &(usize, f64, f64)| {
            let d = y - f64::from(pose[c]);
            w * d * d
        };
        // Four sums at a time: one alone waits for itself.
        let quads = terms.chunks_exact(4);
        let rest: f64 = quads.remainder().iter().map(square).sum();
        let mut sums = [0.0; 4];
        for quad in quads {
            for (sum, term) in sums.iter_mut().zip(quad) {
                *sum += square(term);
            }
        }
        sums.iter().sum::<f64>() + rest
    }

    /// Σ p (x − average)(x − average)ᵀ; poses that are [`LIGHT`] are left out.
    pub(crate) fn covariance(&self, explained: &Explained, average: &[f64]) -> Array2<f64> {
        let most = explained.weights.iter().fold(0.0, |m: f64, p| m.max(*p));
        let each = explained.rows.iter().zip(&explained.weights);
        let heavy = each
            .filter(|(_, p)| **p >= LIGHT * most)
            .map(|(row, p)| (*row, *p))
            .collect();
        let heavy = sampled(heavy);
        let mut spread = Array2::<f64>::zeros((heavy.len(), average.len()));
        for (mut to, (row, p)) in spread.rows_mut().into_iter().zip(heavy) {
            let pose = self.rows.row(row as usize);
            let root = p.sqrt();
            for ((to, x), m) in to.iter_mut().zip(pose).zip(average) {
                *to = root * (f64::from(*x) - m);
            }
        }
        spread.t().dot(&spread)
    }

    /// Σ p x, about the middle.
    pub(crate) fn average(&self, explained: &Explained) -> Vec<f64> {
        let mut sum = vec![0.0; self.middle.len()];
        for (&row, p) in explained.rows.iter().zip(&explained.weights) {
            let pose = self.rows.row(row as usize);
            let each = sum.iter_mut().zip(pose);
            each.for_each(|(s, x)| *s += p * f64::from(*x));
        }
        sum
    }
}

/// At most [`SAMPLE`] of weighted poses: what stands at even steps along the sum of their weights.
/// A heavy one keeps its weight, to a step; light ones stand for their neighbors in time.
fn sampled(poses: Vec<(u32, f64)>) -> Vec<(u32, f64)> {
    if poses.len() <= SAMPLE {
        return poses;
    }
    let step = poses.iter().map(|(_, p)| p).sum::<f64>() / SAMPLE as f64;
    let mut sum = 0.5 * step;
    let taken = poses.into_iter().filter_map(|(row, p)| {
        let before = (sum / step).floor();
        sum += p;
        let steps = (sum / step).floor() - before;
        (steps > 0.0).then_some((row, steps * step))
    });
    taken.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_keeps_the_weight_and_the_covariance() {
        let n = 9000;
        let poses = Array2::from_shape_fn((n, 6), |(t, c)| {
            20.0 * (t as f64 * 0.01 * (1.0 + c as f64)).sin() + ((t * 7 + c * 3) % 11) as f64
        });
        let cloud = ExemplarWeights::new(poses.view());
        let mut weights: Vec<f64> = (0..n).map(|t| 1.0 + (t as f64 * 0.003).cos()).collect();
        weights[77] = 500.0;
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let rows: Vec<u32> = (0..n as u32).collect();
        let all: Vec<(u32, f64)> = rows.iter().copied().zip(weights.clone()).collect();
        let some = sampled(all.clone());
        assert!(some.len() <= SAMPLE && some.len() >= SAMPLE / 2);
        let step = 1.0 / SAMPLE as f64;
        assert!((some.iter().map(|s| s.1).sum::<f64>() - 1.0).abs() <= 1.01 * step);
        let heavy = some.iter().find(|s| s.0 == 77).unwrap();
        assert!((heavy.1 - weights[77]).abs() <= 1.01 * step);
        assert_eq!(sampled(all[..SAMPLE].to_vec()), all[..SAMPLE]);
        let explained = Explained {
            rows,
            weights,
            log: 0.0,
        };
        let mean = cloud.average(&explained);
        let found = cloud.covariance(&explained, &mean);
        let mut want = Array2::<f64>::zeros((6, 6));
        for (row, p) in all {
            let away =
                Array1::from_shape_fn(6, |c| f64::from(cloud.rows[[row as usize, c]]) - mean[c]);
            let away = away.insert_axis(Axis(0));
            want.scaled_add(p, &away.t().dot(&away));
        }
        let size = want.diag().sum() / 6.0;
        let off = (&found - &want).mapv(f64::abs);
        assert!(off.iter().all(|d| *d <= 0.03 * size), "{off:?} {size}");
    }
}
