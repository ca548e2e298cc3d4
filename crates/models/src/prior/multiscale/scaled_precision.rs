//! The inverse of a noisy covariance at several scales: S_a = (a C_oo + R)⁻¹ for every a that is
//! asked for.
//!
//! With axes T (columns) that diagonalise S_a for every a, z = Tᵀ r of a residual r, and s_a the n
//! values on the diagonal:
//!
//! ```text
//! S_a = T (diag(s_a) − diag(s_a) E_cᵀ G⁻¹ E_c diag(s_a)) Tᵀ,
//!     G = E_c diag(s_a) E_cᵀ + diag(1 / δ) = L Lᵀ
//! ```
//!
//! The second term is the correction (Woodbury) for the coordinates c whose noise exceeds the
//! others' by δ; E_c are their rows of the axes. It is kept as K = L⁻¹ E_c diag(s_a), so that S_a =
//! T (diag(s_a) − Kᵀ K) Tᵀ. [`noisy_covariance`](super::noisy_covariance) says what T is.
//!
//! Cost: a scale takes O(c² n + c³) once, then O(c n) a residual.

use crate::numeric::simd::{self, row_dots, weighted_products, weighted_rows};
use crate::numeric::small_linalg::{factorize, log_product};

/// Rows of the axes for the coordinates with more noise than the rest.
#[derive(Debug, Clone, Default)]
pub(crate) struct Exceptions {
    /// E_c, (c, stride).
    pub rows: Vec<f32>,
    /// δ: by how much the noise variance exceeds the rest's, cm²; infinite where missing.
    pub excess: Vec<f64>,
}

/// S_a at several scales a.
#[derive(Debug, Clone)]
pub(crate) struct ScaledPrecisions {
    /// a of each.
    pub scales: Vec<f64>,
    /// s_a, (scales, stride), 0 beyond the axes.
    diagonals: Vec<f32>,
    stride: usize,
    /// log N(0; 0, a C_oo + R) of each scale, nats.
    log_normalizers: Vec<f64>,
    /// K of each scale, (c, stride); none without exceptions.
    corrections: Vec<Vec<f32>>,
}

/// rᵀ S r, vᵀ S r and vᵀ S v at each scale, and buffers that serve one exemplar after another.
#[derive(Debug, Default)]
pub(crate) struct StepForms {
    /// The three forms of each scale.
    pub forms: Vec<[f64; 3]>,
    single: Vec<[f32; 3]>,
    white: Vec<f32>,
    white_step: Vec<f32>,
}

impl ScaledPrecisions {
    /// Precisions s = 1 / (a λ + `base`) along axes of the variances λ (`values`). `log_constant`
    /// is what does not depend on the scale: −½ (observed coordinates) log 2π, and log |W|
    /// where residuals are whitened by W first.
    pub(crate) fn new(
        scales: Vec<f64>,
        values: &[f64],
        base: f64,
        exceptions: &Exceptions,
        log_constant: f64,
    ) -> ScaledPrecisions {
        let (stride, c) = (simd::padded(values.len()), exceptions.excess.len());
        let finite = exceptions.excess.iter().copied().filter(|e| e.is_finite());
        let log_constant = log_constant - 0.5 * log_product(finite);
        let mut diagonals = vec![0.0; scales.len() * stride];
        let mut log_normalizers = Vec::with_capacity(scales.len());
        let mut corrections = Vec::new();
        for (a, row) in scales.iter().zip(diagonals.chunks_exact_mut(stride)) {
            let precision = |l: &f64| 1.0 / (a * l + base);
            row.iter_mut()
                .zip(values)
                .for_each(|(s, l)| *s = precision(l) as f32);
            let mut log = log_constant + 0.5 * log_product(values.iter().map(precision));
            if c > 0 {
                let factor = exceptions.factor(row);
                log -= log_product((0..c).map(|i| factor[i * c + i]));
                corrections.push(exceptions.correction(row, &factor));
            }
            log_normalizers.push(log);
        }
        ScaledPrecisions {
            scales,
            diagonals,
            stride,
            log_normalizers,
            corrections,
        }
    }

    /// s_a of one scale.
    pub(crate) fn diagonal(&self, at: usize) -> &[f32] {
        &self.diagonals[at * self.stride..(at + 1) * self.stride]
    }

    /// The index of a scale.
    pub(crate) fn at(&self, scale: f64) -> usize {
        self.scales.iter().position(|s| *s == scale).unwrap_or(0)
    }

    /// log N(r; 0, a C_oo + R) at each scale, from z of the residual.
    pub(crate) fn log_evidences(&self, z: &[f32]) -> Vec<f64> {
        let mut forms = vec![0.0; self.scales.len()];
        weighted_rows(&self.diagonals, z, z, &mut forms);
        let mut white = Vec::new();
        let each = forms.into_iter().enumerate();
        each.map(|(at, form)| {
            self.whiten(at, z, &mut white);
            self.log_normalizers[at] - 0.5 * (f64::from(form) - dot(&white, &white))
        })
        .collect()
    }

    /// Works out `out` from z of a residual r and of a step v.
    pub(crate) fn step_forms(&self, z: &[f32], step: &[f32], out: &mut StepForms) {
        out.single.resize(self.scales.len(), [0.0; 3]);
        simd::weighted_forms(&self.diagonals, z, step, |_| true, &mut out.single);
        let (r, v) = (&mut out.white, &mut out.white_step);
        out.forms.clear();
        for (at, form) in out.single.iter().enumerate() {
            let [zz, vz, vv] = form.map(f64::from);
            self.whiten(at, z, r);
            self.whiten(at, step, v);
            let corrected = [zz - dot(r, r), vz - dot(v, r), vv - dot(v, v)];
            out.forms.push(corrected);
        }
    }

    /// log N(r; 0, a C_oo + R + b v vᵀ) at one scale, by the matrix determinant lemma and Sherman
    /// and Morrison's formula; the three forms are those of [`StepForms`], `b` at least 0.
    pub(crate) fn log_evidence_along_step(&self, at: usize, [zz, vz, vv]: [f64; 3], b: f64) -> f64 {
        let gain = b * vz * vz / (1.0 + b * vv);
        self.log_normalizers[at] - 0.5 * (zz - gain + (b * vv).ln_1p())
    }

    /// Adds `weight` times the axes' coordinates of S r at one scale to `out`, from z of the
    /// residual.
    pub(crate) fn add_product(&self, at: usize, z: &[f32], weight: f64, out: &mut [f32]) {
        let weight = weight as f32;
        let both = out.iter_mut().zip(self.diagonal(at).iter().zip(z));
        both.for_each(|(o, (s, z))| *o += weight * s * z);
        let mut white = Vec::new();
        self.whiten(at, z, &mut white);
        if let Some(correction) = self.corrections.get(at) {
            for (row, w) in correction.chunks_exact(self.stride).zip(&white) {
                let both = out.iter_mut().zip(row);
                both.for_each(|(o, k)| *o -= weight * w * k);
            }
        }
    }

    /// K of one scale, (c, stride); empty without exceptions.
    pub(crate) fn correction(&self, at: usize) -> &[f32] {
        self.corrections.get(at).map_or(&[], |k| k)
    }

    /// K z into `out`; empty without exceptions.
    fn whiten(&self, at: usize, z: &[f32], out: &mut Vec<f32>) {
        let correction = self.correction(at);
        out.resize(correction.len() / self.stride.max(1), 0.0);
        row_dots(correction, self.stride, z, out);
    }
}

/// Σ aᵢ bᵢ in double precision.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let both = a.iter().zip(b);
    both.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

impl Exceptions {
    /// K of one scale, whose s_a (`diagonal`) and L (`factor`) are given.
    fn correction(&self, diagonal: &[f32], factor: &[f64]) -> Vec<f32> {
        let mut wide = Vec::with_capacity(self.rows.len());
        for row in self.rows.chunks_exact(diagonal.len().max(1)) {
            wide.extend(row.iter().zip(diagonal).map(|(e, s)| f64::from(e * s)));
        }
        simd::forward(factor, &mut wide, diagonal.len());
        wide.iter().map(|v| *v as f32).collect()
    }

    /// L of one scale, whose s_a are given.
    fn factor(&self, diagonal: &[f32]) -> Vec<f64> {
        let c = self.excess.len();
        let mut gram = vec![0.0; c * c];
        weighted_products(&self.rows, diagonal.len(), diagonal, &mut gram);
        let mut lower: Vec<f64> = gram.iter().map(|v| f64::from(*v)).collect();
        for (i, excess) in self.excess.iter().enumerate() {
            // 1 / ∞ is 0: a missing coordinate.
            lower[i * c + i] += 1.0 / excess;
        }
        factorize(&mut lower, c);
        lower
    }
}
