//! Vectors beside a lens, and their forms with each other: what slopes are made of.

use super::super::scaled_precision::ScaledPrecisions;
use super::NoisyCovariance;
use crate::numeric::simd;
use crate::numeric::small_linalg::dot;

/// A lens at some scales that have weights, Σ weight (a C_oo + R)⁻¹.
pub struct WeightedPrecision<'a> {
    noisy: &'a NoisyCovariance,
    scales: &'a ScaledPrecisions,
    /// Those with any weight, and its root.
    roots: Vec<(usize, f64)>,
    /// Σ weight s by directions; 0 for those that are shared.
    precisions: Vec<f32>,
    /// The same for what is shared.
    shared: f32,
}

/// A vector beside it.
pub struct ProjectedVector<'a> {
    through: &'a WeightedPrecision<'a>,
    of: &'a [f32],
    /// In the directions; 0 for those that are shared.
    z: Vec<f32>,
    /// The same times the shares.
    weighted: Vec<f32>,
    /// L⁻¹ q at each scale times the weight's root, where coordinates are changed.
    fixed: Vec<f64>,
}

impl<'a> WeightedPrecision<'a> {
    /// `weights` are of the scales.
    pub fn of(
        noisy: &'a NoisyCovariance,
        scales: &'a ScaledPrecisions,
        weights: &[f64],
    ) -> WeightedPrecision<'a> {
        let some = weights.iter().enumerate().filter(|(_, w)| **w > 0.0);
        let mut sums = vec![0.0; noisy.stride()];
        for (at, weight) in some.clone() {
            let precisions = sums.iter_mut().zip(scales.precisions(at));
            precisions.for_each(|(sum, s)| *sum += weight * f64::from(*s));
        }
        let shared = noisy.cut.as_ref().map(|cut| cut.values.len() - 1);
        let shared = shared.map_or(0.0, |last| std::mem::take(&mut sums[last]));
        WeightedPrecision {
            roots: some.map(|(at, weight)| (at, weight.sqrt())).collect(),
            precisions: sums.iter().map(|s| *s as f32).collect(),
            shared: shared as f32,
            noisy,
            scales,
        }
    }

    /// A vector (d, padded with 0; read where seen).
    pub fn project(&'a self, of: &'a [f32]) -> ProjectedVector<'a> {
        let mut z = Vec::new();
        self.noisy.project(of, &mut z);
        if let Some(cut) = &self.noisy.cut {
            z[cut.values.len() - 1] = 0.0;
        }
        let mut fixed = Vec::new();
        for &(at, root) in &self.roots {
            let white = self.scales.whitened(at, &z);
            fixed.extend(white.iter().map(|v| root * v));
        }
        ProjectedVector {
            weighted: z.iter().zip(&self.precisions).map(|(z, s)| z * s).collect(),
            through: self,
            of,
            z,
            fixed,
        }
    }
}

impl ProjectedVector<'_> {
    /// aᵀ Σ weight (a C_oo + R)⁻¹ b with another.
    pub fn form(&self, other: &ProjectedVector<'_>) -> f64 {
        let form = simd::dot(&self.weighted, &other.z);
        let form = f64::from(form) - dot(&self.fixed, &other.fixed);
        if self.through.noisy.cut.is_none() {
            return form;
        }
        let left = simd::dot(self.of, other.of) - simd::dot(&self.z, &other.z);
        form + f64::from(self.through.shared * left)
    }
}
