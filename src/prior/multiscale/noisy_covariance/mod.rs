//! A block seen through noise.
//!
//! Most noise is alike in all coordinates but a few: R = r I but on the coordinates c. Then the directions of the
//! covariance serve every r and every scale a of it, and c is a change of low rank. With z = Uᵀ (y − m),
//! s = 1 / (aλ + r), P = U diag(s) Uᵀ = (aC + r I)⁻¹, δ what the noise of c is above r (infinite: missing), and
//! G = P_cc + diag(1/δ), q = (P (y − m))_c:
//!
//! ```text
//! log N(y; m, aC + R) = −½ (Σ s z² − qᵀ G⁻¹ q) + ½ Σ log s − ½ log |G| − ½ Σ log δ − ½ n log 2π
//! w                   = s z − s U_cᵀ G⁻¹ q
//! mean                = m + U (aλ w)
//! covariance          = U diag(aλ r s) Uᵀ + B G⁻¹ Bᵀ,   B = U diag(aλ s) U_cᵀ
//! ```
//!
//! Directions whose variance is nothing beside r share one: the length of what is left of y − m without the others, and
//! their mean variance.
//!
//! (Coordinates that are missing count neither in n nor in Σ log δ.) Where the noise is of many kinds or few coordinates
//! are seen, a decomposition of R^-1/2 C_oo R^-1/2 takes the place of U, and nothing is changed.

mod noise_pattern;
mod quadratic_form;
mod remaining;
mod truncation;

use super::eigen_covariance::EigenCovariance;
use super::scaled_precision::{IsotropicPrecisions, ScaledPrecisions};
use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::simd::{self, combine, padded, row_dots};
use crate::numeric::small_linalg::log_product;
use ndarray::Array2;
use std::sync::Arc;
use truncation::Truncation;

pub use noise_pattern::NoisePattern;
pub use quadratic_form::WeightedPrecision;

/// A block's covariance through one noise, for every scale of it.
#[derive(Debug, Clone)]
pub struct NoisyCovariance {
    basis: Arc<EigenCovariance>,
    /// The coordinates that are seen.
    observed: Arc<[usize]>,
    exceptions: Arc<[(usize, f64)]>,
    base_variance: f64,
    constant: f64,
    /// What stands in for the basis where the noise is mixed.
    mixed: Option<Whitened>,
    /// Where few directions matter.
    cut: Option<Truncation>,
}

#[derive(Debug, Clone)]
struct Whitened {
    /// W V by rows of the seen coordinates: (n, n), padded.
    across: Vec<f32>,
    values: Vec<f64>,
    /// (C_:o W V)ᵀ by rows of the directions: (n, d), padded.
    gain: Vec<f32>,
}

const LOG_2_PI: f64 = 1.837_877_066_409_345_5;

impl NoisyCovariance {
    /// Looks at a block through noise variances (d), of that pattern; `seen` are those that are finite.
    pub fn new(
        basis: &Arc<EigenCovariance>,
        noise: &[f64],
        observed: &Arc<[usize]>,
        pattern: &NoisePattern,
    ) -> NoisyCovariance {
        let constant = -0.5 * observed.len() as f64 * LOG_2_PI;
        let noisy = NoisyCovariance {
            basis: basis.clone(),
            observed: observed.clone(),
            exceptions: Arc::default(),
            base_variance: 1.0,
            constant,
            mixed: None,
            cut: None,
        };
        match pattern {
            NoisePattern::NearIsotropic {
                base_variance,
                exceptions,
            } => NoisyCovariance {
                base_variance: *base_variance,
                cut: exceptions
                    .is_empty()
                    .then(|| Truncation::of(&basis.values, *base_variance))
                    .flatten(),
                exceptions: exceptions.clone(),
                ..noisy
            },
            _ => noisy.mixed(noise),
        }
    }

    fn mixed(mut self, noise: &[f64]) -> NoisyCovariance {
        let (n, d) = (self.observed.len(), self.basis.len());
        let w: Vec<f64> = self
            .observed
            .iter()
            .map(|&i| 1.0 / noise[i].sqrt())
            .collect();
        let atoms = self.basis.atoms();
        let observed = Array2::from_shape_fn((n, d), |(i, k)| w[i] * atoms[[self.observed[i], k]]);
        let whitened = observed.dot(&observed.t());
        let (values, vectors) = symmetric_eigen(&whitened)
            .unwrap_or_else(|| (ndarray::Array1::zeros(n), Array2::eye(n)));
        let across = Array2::from_shape_fn((n, n), |(i, k)| w[i] * vectors[[i, k]]);
        // (C_:o W V)ᵀ = Vᵀ (W A_o) Aᵀ with the atoms A.
        let gain = vectors.t().dot(&observed).dot(&atoms.t());
        self.constant += w.iter().map(|w| w.ln()).sum::<f64>();
        self.mixed = Some(Whitened {
            across: simd::rows(&across),
            values: values.iter().map(|v| v.max(0.0)).collect(),
            gain: simd::rows(&gain),
        });
        self
    }

    /// Whether z is in the block's own directions, of all coordinates.
    pub fn uses_eigenvectors(&self) -> bool {
        self.mixed.is_none()
    }

    fn values(&self) -> &[f64] {
        match (&self.mixed, &self.cut) {
            (Some(m), _) => &m.values,
            (None, Some(cut)) => &cut.values,
            (None, None) => &self.basis.values,
        }
    }

    /// The length of z.
    pub fn stride(&self) -> usize {
        padded(self.values().len())
    }

    /// z of the residual `r` (d, padded with 0; read where seen), padded.
    pub fn project(&self, r: &[f32], z: &mut Vec<f32>) {
        let (d, stride) = (self.basis.len(), self.basis.stride());
        let all = self.observed.len() == d;
        z.clear();
        z.reserve(self.stride() + if all { 0 } else { d });
        z.resize(self.stride(), 0.0);
        if let Some(m) = &self.mixed {
            // What is seen of the residual stands behind z for a while.
            z.extend(self.observed.iter().map(|&i| r[i]));
            let (z, observed) = z.split_at_mut(self.stride());
            combine(&m.across, z.len(), observed, z);
        } else if all {
            combine(self.basis.vectors(), stride, &r[..d], z);
        } else {
            z.resize(self.stride() + d, 0.0);
            let (z, observed) = z.split_at_mut(self.stride());
            self.observed.iter().for_each(|&i| observed[i] = r[i]);
            combine(self.basis.vectors(), stride, observed, z);
        }
        z.truncate(self.stride());
        if self.cut.is_some() {
            self.precision(simd::dot(r, r), z);
        }
    }

    /// z of one of the cell's leaves, given that of the cell's mean, the leaf's code, and both y and the leaf's pose
    /// (padded).
    pub fn shift(&self, of_cell: &[f32], code: &[f32], y: &[f32], pose: &[f32], z: &mut Vec<f32>) {
        z.clear();
        z.extend(of_cell.iter().zip(code).map(|(z, c)| z - c));
        if self.cut.is_some() {
            self.precision(simd::distance(y, pose), z);
        }
    }

    /// z of a leaf's step, given it in the cell's directions: of those that are shared it has next to nothing.
    pub fn step_coordinates(&self, step_coordinates: &[f32], z: &mut Vec<f32>) {
        z.clear();
        z.extend_from_slice(&step_coordinates[..self.stride()]);
        if let Some(cut) = &self.cut {
            z[cut.values.len() - 1..].fill(0.0);
        }
    }

    /// Where directions share one, what is left for it of a residual of that squared length.
    fn precision(&self, length: f32, z: &mut [f32]) {
        if let Some(cut) = &self.cut {
            let last = cut.values.len() - 1;
            z[last..].fill(0.0);
            z[last] = (length - simd::dot(z, z)).max(0.0).sqrt();
        }
    }

    /// At some scales; nothing may be changed.
    pub fn at(&self, scales: &[f64]) -> ScaledPrecisions {
        let shared = match (&self.cut, self.values()) {
            (Some(cut), [.., last]) => Some((cut.shared - 1.0, *last)),
            _ => None,
        };
        self.of(scales, self.values(), shared)
    }

    /// The same with no direction shared, to be [changed](NoisyCovariance::changed).
    pub fn isotropic(&self, scales: &[f64]) -> IsotropicPrecisions {
        let scales = self.of(scales, &self.basis.values, None);
        let (d, stride) = (self.basis.len(), self.basis.stride());
        let vectors = self.basis.vectors();
        // Beyond the last scale there is that of nothing.
        let mut nothing = vec![[0.0; 4]; d * d];
        (0..d).for_each(|i| nothing[i * d + i] = [1.0; 4]);
        let count = scales.scales.len();
        let mut precisions = vec![nothing; count.div_ceil(4)];
        let mut whole = vec![0.0; d * d];
        for at in 0..count {
            simd::weighted_products(vectors, stride, scales.precisions(at), &mut whole);
            let both = precisions[at / 4].iter_mut().zip(&whole);
            both.for_each(|(p, w)| p[at % 4] = *w);
        }
        IsotropicPrecisions { scales, precisions }
    }

    /// Where coordinates are changed: at the scales at which the same block was seen without. `many` where more residuals
    /// than there are changed coordinates are to come.
    pub fn exceptions(&self, isotropic: &IsotropicPrecisions, many: bool) -> ScaledPrecisions {
        let unseen = self.basis.len() - self.observed.len();
        let constant = 0.5 * unseen as f64 * LOG_2_PI;
        ScaledPrecisions::exceptions(
            isotropic,
            &self.basis,
            &self.exceptions,
            self.base_variance,
            constant,
            many,
        )
    }

    fn of(&self, scales: &[f64], values: &[f64], shared: Option<(f64, f64)>) -> ScaledPrecisions {
        ScaledPrecisions::new(scales, padded(values.len()), |scale, precisions| {
            let precision = |l: &f64| 1.0 / (scale * l + self.base_variance);
            precisions.extend(values.iter().map(|l| precision(l) as f32));
            let more = shared.map_or(0.0, |(count, last)| count * precision(&last).ln());
            self.constant + 0.5 * (log_product(values.iter().map(precision)) + more)
        })
    }

    /// λ of the directions that are not shared.
    fn leading(&self) -> &[f64] {
        match &self.cut {
            None => &self.basis.values,
            Some(cut) => &cut.values[..cut.values.len() - 1],
        }
    }

    /// Adds a C_:o (a C_oo + R)⁻¹ r to `out` (d), given w of r, times a and whatever weight.
    pub fn add_gain(&self, w: &[f32], out: &mut [f64]) {
        let d = out.len();
        let mut sum = vec![0.0; padded(d)];
        match &self.mixed {
            None => {
                let mut step = vec![0.0; self.stride()];
                for ((s, w), l) in step.iter_mut().zip(w).zip(self.leading()) {
                    *s = w * *l as f32;
                }
                let stride = self.basis.stride();
                row_dots(self.basis.vectors(), stride, &step, &mut sum[..d]);
            }
            Some(m) => combine(&m.gain, padded(d), &w[..m.values.len()], &mut sum),
        }
        out.iter_mut()
            .zip(&sum)
            .for_each(|(o, s)| *o += f64::from(*s));
    }
}

#[cfg(test)]
mod tests {
    use super::super::part_mixture::ActiveSubMixture;
    use super::super::scaled_precision::Scratch;
    use super::*;
    use crate::numeric::gaussian::ConditionalGaussian;

    /// Directions that drown share one: next to the same evidence, mean and variances.
    #[test]
    fn shared_directions_change_next_to_nothing() {
        let d = 40;
        let b = Array2::from_shape_fn((d, 4), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) * 5.0 + Array2::<f64>::eye(d) * 1e-3;
        let noise = vec![1.0; d];
        let noisy = NoisyCovariance::new(
            &Arc::new(EigenCovariance::of(c.view())),
            &noise,
            &(0..d).collect(),
            &NoisePattern::of(&noise),
        );
        assert!(noisy.cut.is_some() && noisy.stride() < d);
        let want = ConditionalGaussian::new(c.view(), &noise);
        let y: Vec<f64> = (0..d).map(|i| (i as f64 * 1.3).cos()).collect();
        let r: Vec<f32> = y.iter().map(|v| *v as f32).collect();
        let scales = noisy.at(&[1.0]);
        let (mut z, mut log_evidences, mut mean) = (Vec::new(), Vec::new(), vec![0.0; d]);
        noisy.project(&r, &mut z);
        scales.log_evidences(&z, &mut Scratch::default(), &mut log_evidences);
        assert!(
            (log_evidences[0] - want.log_density(&y)).abs() <= 1e-3,
            "{log_evidences:?}"
        );
        let mut w = vec![0.0; z.len()];
        scales.add_precision_product(0, &z, 1.0, &mut Scratch::default(), &mut w);
        noisy.add_gain(&w, &mut mean);
        let detail = want.mean(&y);
        assert!(mean.iter().zip(detail).all(|(a, b)| (a - b).abs() <= 5e-3));
        let mut variances = vec![0.0; d];
        noisy.add_variances(&[(&scales, 0, 1.0)], &mut variances);
        let detail = want.covariance(c.view());
        let off = variances.iter().zip(detail.diag());
        assert!(off.into_iter().all(|(a, b)| (a - b).abs() <= 1e-3));
    }

    #[test]
    fn a_scale_is_the_same_beside_any_number_of_others() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) + Array2::<f64>::eye(6) * 0.01;
        let basis = Arc::new(EigenCovariance::of(c.view()));
        let noise = [0.5, f64::INFINITY, 0.5, 0.5, 2.0, 0.5];
        let observed: Arc<[usize]> = (0..6).filter(|&i| noise[i].is_finite()).collect();
        let noisy = NoisyCovariance::new(&basis, &noise, &observed, &NoisePattern::of(&noise));
        let plain = NoisyCovariance::new(
            &basis,
            &[0.5; 6],
            &(0..6).collect(),
            &NoisePattern::of(&[0.5; 6]),
        );
        let r = [1.0, 3.0, -0.5, 0.2, -1.4, 0.7, 0.0, 0.0];
        let (mut z, mut scratch) = (Vec::new(), Scratch::default());
        noisy.project(&r, &mut z);
        let mut detail = |scales: &[f64], many: bool| {
            let scales = noisy.exceptions(&plain.isotropic(scales), many);
            let (mut log_evidences, mut solved) = (Vec::new(), Vec::new());
            scales.log_evidences(&z, &mut scratch, &mut log_evidences);
            for at in 0..log_evidences.len() {
                let mut w = vec![0.0; z.len()];
                scales.add_precision_product(at, &z, 1.0, &mut scratch, &mut w);
                solved.push(w);
            }
            (log_evidences, solved)
        };
        let all = [0.03, 0.2, 1.0, 2.5, 6.0, 15.0];
        let many = detail(&all, true);
        let (log_evidences, solved) = detail(&all, false);
        assert_eq!(log_evidences.len(), all.len());
        for (at, scale) in all.iter().enumerate() {
            let (alone, own) = detail(&[*scale], false);
            assert_eq!(alone[0], log_evidences[at]);
            assert_eq!(own[0], solved[at]);
            assert!((many.0[at] - log_evidences[at]).abs() <= 1e-4);
            let both = many.1[at].iter().zip(&solved[at]);
            assert!(both.into_iter().all(|(a, b)| (a - b).abs() <= 1e-4));
        }
    }

    /// Every pattern gives what conditioning the Gaussian gives.
    #[test]
    fn a_lens_is_the_conditional_gaussian() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) + Array2::<f64>::eye(6) * 0.01;
        let basis = Arc::new(EigenCovariance::of(c.view()));
        let inf = f64::INFINITY;
        let noises = [
            [0.5; 6],
            [0.5, inf, 0.5, 0.5, 2.0, 0.5],
            [0.5, inf, 0.5, inf, 0.5, 0.5],
            [0.5, inf, 0.1, 2.0, inf, 0.1],
            [inf, inf, inf, 0.1, 0.1, inf],
        ];
        let y = [1.0, 3.0, -0.5, 0.2, -1.4, 0.7];
        let mut kinds = Vec::new();
        for noise in noises {
            let pattern = NoisePattern::of(&noise);
            let finite = (0..6).filter(|&i| noise[i].is_finite());
            let noisy = NoisyCovariance::new(&basis, &noise, &finite.collect(), &pattern);
            kinds.push(noisy.uses_eigenvectors());
            let at = |scales: [f64; 2], many: bool| match &pattern {
                NoisePattern::NearIsotropic {
                    base_variance,
                    exceptions,
                } if !exceptions.is_empty() => {
                    let noise = [*base_variance; 6];
                    let isotropic = NoisePattern::of(&noise);
                    let plain = NoisyCovariance::new(&basis, &noise, &(0..6).collect(), &isotropic);
                    noisy.exceptions(&plain.isotropic(&scales), many)
                }
                _ => noisy.at(&scales),
            };
            for (scale, many) in [(1.0, false), (2.5, true), (0.03, true), (0.03, false)] {
                let prior = &c * scale;
                let want = ConditionalGaussian::new(prior.view(), &noise);
                let (mut z, mut mean) = (Vec::new(), vec![0.0; 6]);
                let mut r: Vec<f32> = y.iter().map(|y| *y as f32).collect();
                r.resize(padded(6), 0.0);
                noisy.project(&r, &mut z);
                let scales = at([scale, 0.5 * scale], many);
                let mut w = vec![0.0; z.len()];
                scales.add_precision_product(0, &z, 1.0, &mut Scratch::default(), &mut w);
                noisy.add_gain(&w, &mut mean);
                let detail = want.mean(&y);
                assert!(mean.iter().zip(detail).all(|(a, b)| (a - b).abs() <= 1e-4));
                let mut log_evidences = Vec::new();
                scales.log_evidences(&z, &mut Scratch::default(), &mut log_evidences);
                let log = log_evidences[0];
                assert!(
                    (log - want.log_density(&y)).abs() <= 1e-4,
                    "{noise:?} {log}"
                );
                let mut remaining = Array2::zeros((6, 6));
                noisy.add_covariance(&[(&scales, 0, 0.5), (&scales, 0, 0.5)], &mut remaining);
                let mut variances = vec![0.0; 6];
                noisy.add_variances(&[(&scales, 0, 0.5), (&scales, 0, 0.5)], &mut variances);
                let off = remaining.diag().to_vec().into_iter().zip(variances);
                assert!(off.into_iter().all(|(a, b)| (a - b).abs() <= 1e-4));
                remaining -= &want.covariance(prior.view());
                assert!(remaining.iter().all(|v| v.abs() <= 1e-4), "{remaining:?}");
                // Leaves, which are wide along a step as well.
                let step: [f32; 6] = [0.5, -1.0, 0.25, 2.0, 0.0, -0.75];
                let mut long = step.to_vec();
                long.resize(padded(6), 0.0);
                let mut of_step = Vec::new();
                noisy.project(&long, &mut of_step);
                let level = |at, step_scale| ActiveSubMixture {
                    level: 0,
                    scale: scales.scales[at],
                    at,
                    step_scale,
                };
                let levels = [level(0, 0.0), level(0, 1.5), level(1, 0.5)];
                scales.exemplar_log_evidences(
                    (&z, &of_step),
                    &levels,
                    &mut Scratch::default(),
                    &mut log_evidences,
                );
                for (level, log) in levels.iter().zip(&log_evidences) {
                    let prior = Array2::from_shape_fn((6, 6), |(i, j)| {
                        level.scale * c[[i, j]] + level.step_scale * f64::from(step[i] * step[j])
                    });
                    let want = ConditionalGaussian::new(prior.view(), &noise).log_density(&y);
                    assert!((log - want).abs() <= 1e-4, "{log} {want}");
                }
            }
        }
        assert_eq!(kinds, [true, true, true, false, false]);
        assert_eq!(NoisePattern::of(&[inf; 3]), NoisePattern::Unobserved);
    }
}
