//! Vectors beside a lens, and their forms with each other: what slopes are made of.

use super::super::scales::Scales;
use super::Lens;
use crate::prior::small::dot;
use crate::simd;

/// A vector beside a lens at some scales.
pub struct Aside<'a> {
    lens: &'a Lens,
    scales: &'a Scales,
    of: &'a [f32],
    /// In the directions; 0 for those that are shared.
    z: Vec<f32>,
    /// L⁻¹ q at each scale, where coordinates are changed.
    fixed: Vec<f64>,
}

impl<'a> Aside<'a> {
    /// Of a vector (d, padded with 0; read where seen).
    pub fn of(lens: &'a Lens, scales: &'a Scales, of: &'a [f32]) -> Aside<'a> {
        let mut z = Vec::new();
        lens.project(of, &mut z);
        if let Some(cut) = &lens.cut {
            z[cut.values.len() - 1] = 0.0;
        }
        let all = 0..scales.scales.len();
        Aside {
            fixed: all.flat_map(|at| scales.whitened(at, &z)).collect(),
            lens,
            scales,
            of,
            z,
        }
    }

    /// aᵀ (a C_oo + R)⁻¹ b with another at each scale, into `out`.
    pub fn forms(&self, other: &Aside<'_>, out: &mut Vec<f64>) {
        self.scales.plain(&self.z, &other.z, out);
        let changed = self.fixed.len() / self.scales.scales.len().max(1);
        if changed > 0 {
            let pairs = self.fixed.chunks(changed).zip(other.fixed.chunks(changed));
            for (out, (p, q)) in out.iter_mut().zip(pairs) {
                *out -= dot(p, q);
            }
        }
        let Some(cut) = &self.lens.cut else { return };
        let left = simd::dot(self.of, other.of) - simd::dot(&self.z, &other.z);
        for (at, out) in out.iter_mut().enumerate() {
            *out += f64::from(self.scales.shares(at)[cut.values.len() - 1] * left);
        }
    }
}
