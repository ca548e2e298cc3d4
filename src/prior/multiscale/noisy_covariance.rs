//! A cluster's covariance under noise: evidence of a residual, posterior mean and covariance.
//!
//! The cluster has the mean m (d) and the covariance C = U diag(λ) Uᵀ (d, d), cm²; its components have the covariance a C
//! with several scales a. An observation y has independent noise of the variances R = diag(noise), cm²; o are the
//! observed coordinates. With r = y − m (the mean of the component) and S_a = (a C_oo + R)⁻¹:
//!
//! ```text
//! evidence              log N(r; 0, a C_oo + R)
//! posterior mean        m + a C_:o S_a r
//! posterior covariance  a C − a C_:o S_a a C_o:
//! ```
//!
//! S_a is diagonal for every a in the axes T, up to a correction: see [`scaled_precision`](super::scaled_precision).
//!
//! - Near-isotropic noise, R = b I + diag(δ) with δ = 0 for most coordinates: T = U, s = 1 / (a λ + b). Missing
//!   coordinates have δ = ∞. No decomposition is needed, and exemplars' coordinates along U are shared by all noises.
//! - Any other noise: T = W V with W = R^-½ and an eigendecomposition W C_oo W = V diag(λ) Vᵀ, s = 1 / (a λ + 1).
//!
//! Where no coordinate is an exception, eigenvectors whose variance is nothing beside b share one axis ([`Truncation`]): dense
//! noise leaves few that matter.
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
pub struct NoisyCovariance {
    covariance: Arc<EigenCovariance>,
    /// The observed coordinates.
    observed: Arc<[usize]>,
    /// The noise variance b of most coordinates; 1 where residuals are whitened.
    base: f64,
    exceptions: Arc<Exceptions>,
    log_constant: f64,
    /// The axes where they are not those of the covariance.
    whitened: Option<Whitened>,
    truncation: Option<Truncation>,
}

/// The leading eigenvectors, and one axis for the rest: z there is the length of the rest of the residual, and its variance
/// their mean variance.
#[derive(Debug, Clone)]
struct Truncation {
    /// λ of the leading eigenvectors, then the mean of the rest.
    values: Vec<f64>,
    /// The number of eigenvectors that share the last axis.
    shared: usize,
}

/// Eigenvectors share an axis where their variance is below this share of the noise's.
const NEGLIGIBLE_RATIO: f64 = 0.01;

impl Truncation {
    /// Truncates falling eigenvalues under noise of the variance `base`; `None` where that would save too little.
    fn of(values: &[f64], base: f64) -> Option<Truncation> {
        let matter = values.partition_point(|l| *l > NEGLIGIBLE_RATIO * base);
        // With the shared axis they fill the lanes.
        let kept = padded(matter + 1) - 1;
        if padded(values.len()) < kept + 1 + simd::LANES {
            return None;
        }
        let rest = &values[kept..];
        let mean = rest.iter().sum::<f64>() / rest.len() as f64;
        Some(Truncation {
            values: values[..kept].iter().copied().chain([mean]).collect(),
            shared: rest.len(),
        })
    }
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
pub type WeightedScale<'a> = (&'a ScaledPrecisions, usize, f64);

impl NoisyCovariance {
    /// `noise` (d) has the given pattern; `observed` lists its finite coordinates.
    pub fn new(
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
            truncation: None,
        };
        match pattern {
            NoisePattern::NearIsotropic { base, exceptions } => {
                let rows = exceptions.iter().flat_map(|(i, _)| covariance.row(*i));
                let isotropic = exceptions.is_empty();
                NoisyCovariance {
                    base: *base,
                    truncation: isotropic
                        .then(|| Truncation::of(&covariance.values, *base))
                        .flatten(),
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
        // Finite and symmetric, so that LAPACK does not fail; if it did, nothing would be learnt from the observation.
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

    /// Whether the axes are the covariance's eigenvectors.
    pub fn uses_eigenvectors(&self) -> bool {
        self.whitened.is_none()
    }

    fn values(&self) -> &[f64] {
        match (&self.whitened, &self.truncation) {
            (Some(whitened), _) => &whitened.values,
            (None, Some(truncation)) => &truncation.values,
            (None, None) => &self.covariance.values,
        }
    }

    /// λ of the eigenvectors that are axes by themselves.
    fn leading(&self) -> &[f64] {
        match &self.truncation {
            Some(_) => &self.values()[..self.values().len() - 1],
            None => &self.covariance.values,
        }
    }

    /// The axis that eigenvectors share, if there is one.
    pub fn shared_axis(&self) -> Option<usize> {
        self.truncation.as_ref().map(|t| t.values.len() - 1)
    }

    /// Sets z along the shared axis for a residual of that squared length.
    pub fn complete_shared_axis(&self, squared_length: f32, z: &mut [f32]) {
        if let Some(last) = self.shared_axis() {
            z[last..].fill(0.0);
            z[last] = (squared_length - simd::dot(z, z)).max(0.0).sqrt();
        }
    }

    /// The length of z.
    pub fn stride(&self) -> usize {
        padded(self.values().len())
    }

    /// S_a at several scales a.
    pub fn precisions(&self, scales: Vec<f64>) -> ScaledPrecisions {
        let shared = self.truncation.as_ref().map_or(1, |t| t.shared);
        ScaledPrecisions::new(
            scales,
            (self.values(), shared),
            self.base,
            &self.exceptions,
            self.log_constant,
        )
    }

    /// z = Tᵀ r of a residual `r` (d, padded with 0; read where observed), padded.
    pub fn project(&self, r: &[f32], z: &mut Vec<f32>) {
        let (d, stride) = (self.covariance.len(), self.stride());
        z.clear();
        z.resize(stride, 0.0);
        match &self.whitened {
            None if self.observed.len() == d => combine(
                self.covariance.vectors(),
                self.covariance.stride(),
                &r[..d],
                z,
            ),
            None => {
                // The residual with zeros for missing values stands behind z for a while.
                z.resize(stride + d, 0.0);
                let (z, masked) = z.split_at_mut(stride);
                self.observed.iter().for_each(|&i| masked[i] = r[i]);
                combine(
                    self.covariance.vectors(),
                    self.covariance.stride(),
                    masked,
                    z,
                );
            }
            Some(whitened) => {
                z.extend(self.observed.iter().map(|&i| r[i]));
                let (z, observed) = z.split_at_mut(stride);
                combine(&whitened.axes, stride, observed, z);
            }
        }
        z.truncate(stride);
        self.complete_shared_axis(simd::dot(r, r), z);
    }

    /// Adds C_:o T w to `out` (d): the posterior mean's part, given the coordinates w of S r.
    pub fn add_gain(&self, w: &[f32], out: &mut [f64]) {
        let d = out.len();
        let mut sum = vec![0.0; padded(d)];
        match &self.whitened {
            None => {
                let scaled = w.iter().zip(self.leading()).map(|(w, l)| w * *l as f32);
                let mut scaled: Vec<f32> = scaled.collect();
                scaled.resize(self.stride(), 0.0);
                let stride = self.covariance.stride();
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
    pub fn add_posterior_covariance(&self, weights: &[WeightedScale<'_>], out: &mut Array2<f64>) {
        let Some(whitened) = &self.whitened else {
            let mut variances = self.posterior_variances(weights);
            // Eigenvectors that share an axis: their variance in all directions, and the leading ones' beyond that.
            let shared = self
                .shared_axis()
                .and_then(|_| variances.pop())
                .unwrap_or(0.0);
            variances.iter_mut().for_each(|v| *v -= shared);
            self.covariance.add_spread(&variances, out);
            out.diag_mut().mapv_inplace(|v| v + shared);
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

    /// The correction's rows K, (c, d): the posterior covariance is larger by Kᵀ K because of the exceptions.
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
    use super::super::scaled_precision::Scratch;
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
        let mut single: Vec<f32> = r.iter().map(|v| *v as f32).collect();
        single.resize(padded(r.len()), 0.0);
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
        let mut near_isotropic = Vec::new();
        for noise in noises {
            let noisy = noisy(&c, &noise);
            near_isotropic.push(noisy.uses_eigenvectors());
            let scales = vec![1.0, 2.5, 0.03];
            let precisions = noisy.precisions(scales.clone());
            let (z, v) = (z_of(&noisy, &y), z_of(&noisy, &step));
            let (mut scratch, mut logs, mut forms) = (Scratch::default(), Vec::new(), Vec::new());
            precisions.log_evidences(&z, &mut scratch, &mut logs);
            precisions.step_forms(&z, &v, &mut scratch, &mut forms);
            for (at, scale) in scales.into_iter().enumerate() {
                let prior = &c * scale;
                let want = ConditionalGaussian::new(prior.view(), &noise);
                let (mut w, mut mean) = (vec![0.0; z.len()], vec![0.0; 6]);
                precisions.add_product(at, &z, scale, &mut scratch, &mut w);
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
                // Wider along a step by a rank-one term .
                let outer = Array2::from_shape_fn((6, 6), |(i, j)| 1.5 * step[i] * step[j]);
                let wide = ConditionalGaussian::new((&prior + &outer).view(), &noise);
                let log = precisions.log_evidence_along_step(at, forms[at], 1.5);
                assert!(near(log, wide.log_density(&y)));
            }
        }
        assert_eq!(near_isotropic, [true, true, true, false, false]);
    }

    #[test]
    fn a_scale_does_not_depend_on_the_others() {
        let noisy = noisy(&covariance(), &[0.5, INF, 0.5, 0.5, 2.0, 0.5]);
        let z = z_of(&noisy, &[1.0, 3.0, -0.5, 0.2, -1.4, 0.7]);
        let mut scratch = Scratch::default();
        let mut evaluate = |scales: &[f64]| {
            let precisions = noisy.precisions(scales.to_vec());
            let (mut logs, mut products) = (Vec::new(), Vec::new());
            precisions.log_evidences(&z, &mut scratch, &mut logs);
            for at in 0..scales.len() {
                let mut w = vec![0.0; z.len()];
                precisions.add_product(at, &z, 1.0, &mut scratch, &mut w);
                products.push(w);
            }
            (logs, products)
        };
        let all = [0.03, 0.2, 1.0, 2.5, 6.0, 15.0];
        let (logs, products) = evaluate(&all);
        for (at, scale) in all.iter().enumerate() {
            let (alone, product) = evaluate(&[*scale]);
            assert_eq!((alone[0], &product[0]), (logs[at], &products[at]));
        }
    }

    /// Eigenvectors that share an axis change next to nothing.
    #[test]
    fn truncation_changes_next_to_nothing() {
        let d = 40;
        let b = Array2::from_shape_fn((d, 4), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) * 5.0 + Array2::<f64>::eye(d) * 1e-3;
        let noisy = noisy(&c, &vec![1.0; d]);
        assert!(noisy.shared_axis().is_some() && noisy.stride() < d);
        let want = ConditionalGaussian::new(c.view(), &vec![1.0; d]);
        let y: Vec<f64> = (0..d).map(|i| (i as f64 * 1.3).cos()).collect();
        let (z, mut scratch, mut logs) = (z_of(&noisy, &y), Scratch::default(), Vec::new());
        let precisions = noisy.precisions(vec![1.0]);
        precisions.log_evidences(&z, &mut scratch, &mut logs);
        assert!((logs[0] - want.log_density(&y)).abs() <= 1e-3, "{logs:?}");
        let (mut w, mut mean) = (vec![0.0; z.len()], vec![0.0; d]);
        precisions.add_product(0, &z, 1.0, &mut scratch, &mut w);
        noisy.add_gain(&w, &mut mean);
        let off = mean.iter().zip(want.mean(&y)).map(|(a, b)| (a - b).abs());
        assert!(off.into_iter().all(|off| off <= 5e-3));
        let mut posterior = Array2::zeros((d, d));
        noisy.add_posterior_covariance(&[(&precisions, 0, 1.0)], &mut posterior);
        posterior -= &want.covariance(c.view());
        assert!(posterior.diag().iter().all(|v| v.abs() <= 1e-3));
    }
}
