//! A cluster's covariance under noise: evidence of a residual, posterior mean and covariance.
//!
//! The cluster has the mean m (d) and the covariance C = U diag(λ) Uᵀ (d, d), cm²; its components
//! have the covariance a C with several scales a. An observation y has independent noise of the
//! variances R = diag(noise), cm²; o are the observed coordinates. With r = y − m (the mean of the
//! component) and S_a = (a C_oo + R)⁻¹:
//!
//! ```text
//! evidence              log N(r; 0, a C_oo + R)
//! posterior mean        m + a C_:o S_a r
//! posterior covariance  a C − a C_:o S_a a C_o:
//! ```
//!
//! S_a is diagonal for every a in the axes T, up to a correction: see
//! [`scaled_precision`](super::scaled_precision).
//!
//! - Near-isotropic noise, R = b I + diag(δ) with δ = 0 for most coordinates: T = U, s = 1 / (a λ +
//!   b). Missing coordinates have δ = ∞. No decomposition is needed.
//! - Any other noise: T = W V with W = R^-½ and an eigendecomposition W C_oo W = V diag(λ) Vᵀ, s =
//!   1 / (a λ + 1).
//!
//! Accuracy: axes are single precision, so that means are good to 1e-4 cm or so.

use super::eigen_covariance::EigenCovariance;
use super::noise_pattern::NoisePattern;
use super::scaled_precision::{Exceptions, ScaledPrecisions};
use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::simd::{self, combine, padded, row_dots};
use ndarray::Array2;
use std::sync::Arc;

const LOG_2_PI: f64 = 1.837_877_066_409_345_5;

/// A cluster's covariance under one noise, for every scale of it.
#[derive(Debug, Clone)]
pub(crate) struct NoisyCovariance {
    covariance: Arc<EigenCovariance>,
    /// The observed coordinates.
    observed: Arc<[usize]>,
    /// The noise variance b of most coordinates; 1 where residuals are whitened.
    base: f64,
    exceptions: Arc<Exceptions>,
    log_constant: f64,
    /// The axes where they are not those of the covariance.
    whitened: Option<Whitened>,
}

/// The axes W V of the observed coordinates, n of them.
#[derive(Debug, Clone)]
struct Whitened {
    /// W V, (n, n), padded.
    axes: Vec<f32>,
    /// λ of W C_oo W.
    values: Vec<f64>,
    /// (C_:o W V)ᵀ, (n, d), padded.
    gain: Vec<f32>,
}

/// One scale of a cluster's covariance and a weight.
pub(crate) type WeightedScale<'a> = (&'a ScaledPrecisions, usize, f64);

impl NoisyCovariance {
    /// `noise` (d) has the given pattern; `observed` lists its finite coordinates.
    pub(crate) fn new(
        covariance: &Arc<EigenCovariance>,
        noise: &[f64],
        observed: &Arc<[usize]>,
        pattern: &NoisePattern,
    ) -> NoisyCovariance {
        let noisy = NoisyCovariance {
            covariance: covariance.clone(),
            observed: observed.clone(),
            base: 1.0,
            exceptions: Arc::default(),
            log_constant: -0.5 * observed.len() as f64 * LOG_2_PI,
            whitened: None,
        };
        match pattern {
            NoisePattern::NearIsotropic { base, exceptions } => {
                let rows = exceptions.iter().flat_map(|(i, _)| covariance.row(*i));
                NoisyCovariance {
                    base: *base,
                    exceptions: Arc::new(Exceptions {
                        rows: rows.copied().collect(),
                        excess: exceptions.iter().map(|(_, n)| n - base).collect(),
                    }),
                    ..noisy
                }
            }
            NoisePattern::Unobserved | NoisePattern::Diagonal => noisy.whiten(noise),
        }
    }

    fn whiten(mut self, noise: &[f64]) -> NoisyCovariance {
        let (n, d) = (self.observed.len(), self.covariance.len());
        let w: Vec<f64> = self
            .observed
            .iter()
            .map(|&i| 1.0 / noise[i].sqrt())
            .collect();
        let atoms = self.covariance.atoms();
        let white_atoms =
            Array2::from_shape_fn((n, d), |(i, k)| w[i] * atoms[[self.observed[i], k]]);
        // Finite and symmetric, so that LAPACK does not fail; if it did, nothing would be learned
        // from the observation.
        let (values, vectors) = symmetric_eigen(&white_atoms.dot(&white_atoms.t()))
            .unwrap_or_else(|| (ndarray::Array1::zeros(n), Array2::eye(n)));
        let axes = Array2::from_shape_fn((n, n), |(i, k)| w[i] * vectors[[i, k]]);
        // (C_:o W V)ᵀ = Vᵀ (W A_o) Aᵀ with the atoms A = U diag(√λ).
        let gain = vectors.t().dot(&white_atoms).dot(&atoms.t());
        self.log_constant += w.iter().map(|w| w.ln()).sum::<f64>();
        self.whitened = Some(Whitened {
            axes: simd::rows(&axes),
            values: values.iter().map(|v| v.max(0.0)).collect(),
            gain: simd::rows(&gain),
        });
        self
    }

    fn values(&self) -> &[f64] {
        match &self.whitened {
            Some(whitened) => &whitened.values,
            None => &self.covariance.values,
        }
    }

    /// The length of z.
    pub(crate) fn stride(&self) -> usize {
        padded(self.values().len())
    }

    /// S_a at several scales a.
    pub(crate) fn precisions(&self, scales: Vec<f64>) -> ScaledPrecisions {
        ScaledPrecisions::new(
            scales,
            self.values(),
            self.base,
            &self.exceptions,
            self.log_constant,
        )
    }

    /// z = Tᵀ r of a residual `r` (d; read where observed), padded, in place of what was in `z`.
    pub(crate) fn project(&self, r: &[f32], z: &mut Vec<f32>) {
        let stride = self.stride();
        z.clear();
        z.resize(stride, 0.0);
        // The observed part of the residual stands behind z for a while.
        let axes = match &self.whitened {
            None => {
                z.resize(stride + self.covariance.len(), 0.0);
                self.observed.iter().for_each(|&i| z[stride + i] = r[i]);
                self.covariance.vectors()
            }
            Some(whitened) => {
                z.extend(self.observed.iter().map(|&i| r[i]));
                &whitened.axes
            }
        };
        let (out, observed) = z.split_at_mut(stride);
        combine(axes, stride, observed, out);
        z.truncate(stride);
    }

    /// Adds C_:o T w to `out` (d): the posterior mean's part, given the coordinates w of S r.
    pub(crate) fn add_gain(&self, w: &[f32], out: &mut [f64]) {
        let d = out.len();
        let mut sum = vec![0.0; padded(d)];
        match &self.whitened {
            None => {
                let scaled = w.iter().zip(self.values()).map(|(w, l)| w * *l as f32);
                let mut scaled: Vec<f32> = scaled.collect();
                let stride = self.stride();
                scaled.resize(stride, 0.0);
                row_dots(self.covariance.vectors(), stride, &scaled, &mut sum[..d]);
            }
            Some(whitened) => combine(
                &whitened.gain,
                padded(d),
                &w[..self.observed.len()],
                &mut sum,
            ),
        }
        out.iter_mut()
            .zip(&sum)
            .for_each(|(o, s)| *o += f64::from(*s));
    }

    /// Adds the weighted sum of the posterior covariances at some scales to `out` (d, d), cm².
    pub(crate) fn add_posterior_covariance(
        &self,
        weights: &[WeightedScale<'_>],
        out: &mut Array2<f64>,
    ) {
        let Some(whitened) = &self.whitened else {
            self.covariance
                .add_spread(&self.posterior_variances(weights), out);
            for &(precisions, at, weight) in weights {
                let rows = self.correction_rows(precisions, at);
                if !rows.is_empty() {
                    out.scaled_add(weight, &rows.t().dot(&rows));
                }
            }
            return;
        };
        let scale: f64 = weights
            .iter()
            .map(|(p, at, weight)| weight * p.scales[*at])
            .sum();
        let prior: Vec<f64> = self.covariance.values.iter().map(|l| l * scale).collect();
        self.covariance.add_spread(&prior, out);
        let (n, d) = (self.observed.len(), self.covariance.len());
        let explained = |k: usize| -> f64 {
            let terms = weights.iter().map(|&(precisions, at, weight)| {
                weight * precisions.scales[at].powi(2) * f64::from(precisions.diagonal(at)[k])
            });
            terms.sum::<f64>().sqrt()
        };
        let roots: Vec<f64> = (0..n).map(explained).collect();
        let half = Array2::from_shape_fn((n, d), |(k, i)| {
            f64::from(whitened.gain[k * padded(d) + i]) * roots[k]
        });
        *out -= &half.t().dot(&half);
    }

    /// Σ weight a λ b s along the axes: the posterior variances without the correction.
    fn posterior_variances(&self, weights: &[WeightedScale<'_>]) -> Vec<f64> {
        let mut variances = vec![0.0; self.values().len()];
        for &(precisions, at, weight) in weights {
            let terms = self.values().iter().zip(precisions.diagonal(at));
            for (variance, (l, s)) in variances.iter_mut().zip(terms) {
                *variance += weight * precisions.scales[at] * l * self.base * f64::from(*s);
            }
        }
        variances
    }

    /// The correction's rows K, (c, d): the posterior covariance is larger by Kᵀ K because of the
    /// exceptions.
    fn correction_rows(&self, precisions: &ScaledPrecisions, at: usize) -> Array2<f64> {
        let (stride, d) = (self.stride(), self.covariance.len());
        let correction = precisions.correction(at);
        let mut out = Array2::zeros((correction.len() / stride.max(1), d));
        let (mut scaled, mut products) = (vec![0.0; stride], vec![0.0; d]);
        for (row, mut out) in correction.chunks_exact(stride.max(1)).zip(out.rows_mut()) {
            for ((s, v), l) in scaled.iter_mut().zip(row).zip(&self.covariance.values) {
                *s = (precisions.scales[at] * l) as f32 * v;
            }
            row_dots(self.covariance.vectors(), stride, &scaled, &mut products);
            out.iter_mut()
                .zip(&products)
                .for_each(|(o, p)| *o = f64::from(*p));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::scaled_precision::StepForms;
    use super::*;
    use crate::numeric::gaussian::ConditionalGaussian;

    const INF: f64 = f64::INFINITY;

    /// A covariance (6, 6) of full rank.
    fn covariance() -> Array2<f64> {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        b.dot(&b.t()) + Array2::<f64>::eye(6) * 0.01
    }

    fn noisy(covariance: &Array2<f64>, noise: &[f64]) -> NoisyCovariance {
        let observed = (0..noise.len()).filter(|&i| noise[i].is_finite()).collect();
        let eigen = Arc::new(EigenCovariance::of(covariance.view()));
        NoisyCovariance::new(&eigen, noise, &observed, &NoisePattern::of(noise))
    }

    fn z_of(noisy: &NoisyCovariance, r: &[f64]) -> Vec<f32> {
        let single: Vec<f32> = r.iter().map(|v| *v as f32).collect();
        let mut z = Vec::new();
        noisy.project(&single, &mut z);
        z
    }

    /// Every pattern of noise gives what conditioning the Gaussian gives.
    #[test]
    fn equals_the_conditional_gaussian_for_every_pattern() {
        let c = covariance();
        let noises = [
            [0.5; 6],
            [0.5, INF, 0.5, 0.5, 2.0, 0.5],
            [0.5, INF, 0.5, INF, 0.5, 0.5],
            [0.5, INF, 0.1, 2.0, INF, 0.1],
            [INF, INF, INF, 0.1, 0.1, INF],
        ];
        let y = [1.0, 3.0, -0.5, 0.2, -1.4, 0.7];
        let step = [0.5, -1.0, 0.25, 2.0, 0.0, -0.75];
        for noise in noises {
            let noisy = noisy(&c, &noise);
            let scales = vec![1.0, 2.5, 0.03];
            let precisions = noisy.precisions(scales.clone());
            let (z, v) = (z_of(&noisy, &y), z_of(&noisy, &step));
            let logs = precisions.log_evidences(&z);
            let mut step_forms = StepForms::default();
            precisions.step_forms(&z, &v, &mut step_forms);
            let forms = step_forms.forms;
            for (at, scale) in scales.into_iter().enumerate() {
                let prior = &c * scale;
                let want = ConditionalGaussian::new(prior.view(), &noise);
                let (mut w, mut mean) = (vec![0.0; z.len()], vec![0.0; 6]);
                precisions.add_product(at, &z, scale, &mut w);
                noisy.add_gain(&w, &mut mean);
                let near = |a: f64, b: f64| (a - b).abs() <= 1e-4;
                assert!(mean.iter().zip(want.mean(&y)).all(|(a, b)| near(*a, b)));
                let log = want.log_density(&y);
                assert!(near(logs[at], log), "{noise:?} {}", logs[at]);
                assert!(near(
                    precisions.log_evidence_along_step(at, forms[at], 0.0),
                    log
                ));
                let weights = [(&precisions, at, 0.5), (&precisions, at, 0.5)];
                let mut posterior = Array2::zeros((6, 6));
                noisy.add_posterior_covariance(&weights, &mut posterior);
                posterior -= &want.covariance(prior.view());
                assert!(posterior.iter().all(|v| v.abs() <= 1e-4), "{posterior:?}");
                // Wider along a step by a rank-one term.
                let outer = Array2::from_shape_fn((6, 6), |(i, j)| 1.5 * step[i] * step[j]);
                let wide = ConditionalGaussian::new((&prior + &outer).view(), &noise);
                let log = precisions.log_evidence_along_step(at, forms[at], 1.5);
                assert!(near(log, wide.log_density(&y)));
            }
        }
    }
}
