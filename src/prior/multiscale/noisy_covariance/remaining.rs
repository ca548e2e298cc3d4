//! The covariance that is left of a block once it is seen.

use super::super::scaled_precision::{WeightedScale, merged};
use super::{NoisyCovariance, Whitened};
use crate::numeric::simd::{padded, row_dots};
use ndarray::Array2;

impl NoisyCovariance {
    /// The covariance that is left at some scales (which of them, with what weight), added to `out` (d, d).
    pub fn add_covariance(&self, weights: &[WeightedScale<'_>], out: &mut Array2<f64>) {
        match &self.mixed {
            None => {
                let (remaining_variances, shared) = self.remaining_variances(weights);
                self.basis.add_spread(&remaining_variances, out);
                out.diag_mut().mapv_inplace(|v| v + shared);
                for (scales, at, weight) in merged(weights) {
                    if let Some(correction) = scales.correction_at(at) {
                        let half = self.correction_rows(scales.scales[at], &correction);
                        out.scaled_add(weight, &half.t().dot(&half));
                    }
                }
            }
            Some(m) => {
                let (prior, known) = self.known(m, weights);
                self.basis.add_spread(&prior, out);
                let (n, d) = (known.len(), self.basis.len());
                let half = Array2::from_shape_fn((n, d), |(k, i)| {
                    f64::from(m.gain[k * padded(d) + i]) * known[k].sqrt()
                });
                *out -= &half.t().dot(&half);
            }
        }
    }

    /// The diagonal of what [`add_covariance`](NoisyCovariance::add_covariance) adds, added to `out` (d).
    pub fn add_variances(&self, weights: &[WeightedScale<'_>], out: &mut [f64]) {
        let add = |out: &mut [f64], more: Vec<f64>| {
            out.iter_mut().zip(more).for_each(|(o, v)| *o += v);
        };
        match &self.mixed {
            None => {
                let (remaining_variances, shared) = self.remaining_variances(weights);
                add(out, self.basis.diagonal_of(&remaining_variances));
                out.iter_mut().for_each(|v| *v += shared);
                for (scales, at, weight) in merged(weights) {
                    if let Some(correction) = scales.correction_at(at) {
                        for row in self.correction_rows(scales.scales[at], &correction).rows() {
                            add(out, row.iter().map(|v| weight * v * v).collect());
                        }
                    }
                }
            }
            Some(m) => {
                let (prior, known) = self.known(m, weights);
                add(out, self.basis.diagonal_of(&prior));
                for (row, known) in m.gain.chunks_exact(padded(out.len())).zip(known) {
                    let taken = row.iter().map(|g| -known * f64::from(g * g));
                    out.iter_mut().zip(taken).for_each(|(o, v)| *o += v);
                }
            }
        }
    }

    /// Σ weight aλ r s by directions, beyond that of the shared ones; and that.
    fn remaining_variances(&self, weights: &[WeightedScale<'_>]) -> (Vec<f64>, f64) {
        let mut remaining_variances = vec![0.0; self.values().len()];
        for &(scales, at, weight) in weights {
            let precisions = scales.precisions(at);
            let terms = self.values().iter().zip(precisions);
            for (remaining_variances, (l, precision)) in remaining_variances.iter_mut().zip(terms) {
                *remaining_variances +=
                    weight * scales.scales[at] * l * self.base_variance * f64::from(*precision);
            }
        }
        let shared = match self.cut {
            Some(_) => remaining_variances.pop().unwrap_or(0.0),
            None => 0.0,
        };
        remaining_variances.iter_mut().for_each(|v| *v -= shared);
        (remaining_variances, shared)
    }

    /// Where the noise is mixed: Σ weight aλ by directions, and Σ weight a² s by those seen.
    fn known(&self, mixed: &Whitened, weights: &[WeightedScale<'_>]) -> (Vec<f64>, Vec<f64>) {
        let whole: f64 = weights.iter().map(|(s, at, w)| w * s.scales[*at]).sum();
        let prior = self.basis.values.iter().map(|l| l * whole).collect();
        let of = |k: usize| -> f64 {
            let terms = weights.iter().map(|&(scales, at, w)| {
                let precision = scales.precisions(at)[k];
                w * scales.scales[at].powi(2) * f64::from(precision)
            });
            terms.sum()
        };
        (prior, (0..mixed.values.len()).map(of).collect())
    }

    /// (B L⁻ᵀ)ᵀ with L Lᵀ = G: what is not learnt since coordinates are worse than the rest, (changed, d).
    fn correction_rows(&self, scale: f64, correction: &[f32]) -> Array2<f64> {
        let (n, d) = (self.basis.stride(), self.basis.len());
        let mut out = Array2::zeros((correction.len() / n, d));
        let mut step = vec![0.0; n];
        let mut products = vec![0.0; d];
        for (row, mut out) in correction.chunks_exact(n).zip(out.rows_mut()) {
            for ((s, v), l) in step.iter_mut().zip(row).zip(&self.basis.values) {
                *s = (scale * l) as f32 * v;
            }
            row_dots(self.basis.vectors(), n, &step, &mut products);
            let both = out.iter_mut().zip(&products);
            both.for_each(|(o, p)| *o = f64::from(*p));
        }
        out
    }
}
