//! A block seen through noise, at some scales of its covariance: evidence and what a residual is solved to.

use super::basis::Basis;
use crate::prior::small::factorise;
use crate::simd::{self, combine, products, row_dots, weighted_rows};

/// A lens at some scales of the covariance.
#[derive(Debug, Clone)]
pub struct Scales {
    /// a of each.
    pub scales: Vec<f64>,
    /// s of each, by rows: (scales, directions), padded.
    shares: Vec<f32>,
    stride: usize,
    normalisers: Vec<f64>,
    /// L⁻¹ U_c diag(s) of each, with L Lᵀ = G: (scales × changed, directions), padded.
    fixes: Vec<f32>,
    /// How many coordinates are changed.
    changed: usize,
}

/// One scale of a lens, with a weight.
pub type Weighed<'a> = (&'a Scales, usize, f64);

/// So many products with changed coordinates are taken at a time.
const AT_ONCE: usize = 32;

impl Scales {
    /// Nothing known of any scale yet.
    pub fn of(scales: Vec<f64>, stride: usize, changed: usize) -> Scales {
        Scales {
            shares: Vec::with_capacity(scales.len() * stride),
            normalisers: Vec::with_capacity(scales.len()),
            fixes: Vec::with_capacity(scales.len() * changed * stride),
            scales,
            stride,
            changed,
        }
    }

    /// Adds the next scale: s by directions, and the log evidence of a residual of nothing.
    pub fn push(&mut self, shares: &[f64], normaliser: f64) {
        let end = self.shares.len() + self.stride;
        self.shares.extend(shares.iter().map(|s| *s as f32));
        self.shares.resize(end, 0.0);
        self.normalisers.push(normaliser);
    }

    /// Adds what coordinates of more noise than `unit` change at the next scale, whose s are `shares`; gives what is to be
    /// added to the log evidence.
    pub fn fix(
        &mut self,
        basis: &Basis,
        changed: &[(usize, f64)],
        unit: f64,
        shares: &[f64],
    ) -> f64 {
        let (n, stride) = (changed.len(), self.stride);
        let roots: Vec<f64> = shares.iter().map(|s| s.sqrt()).collect();
        let scaled = |row: &mut [f64]| row.iter_mut().zip(&roots).for_each(|(v, r)| *v *= r);
        let mut rows = vec![0.0; n * stride];
        for (row, (i, _)) in rows.chunks_exact_mut(stride).zip(changed) {
            let from = row.iter_mut().zip(basis.row(*i));
            from.for_each(|(v, u)| *v = f64::from(*u));
            scaled(row);
        }
        let mut factor = vec![0.0; n * n];
        products(&rows, stride, &mut factor);
        let mut normaliser = 0.0;
        for (a, (_, noise)) in changed.iter().enumerate() {
            let above = noise - unit;
            // 1 / ∞ is 0: a missing coordinate.
            factor[a * n + a] += 1.0 / above;
            if above.is_finite() {
                normaliser -= 0.5 * above.ln();
            }
        }
        factorise(&mut factor, n);
        normaliser -= (0..n).map(|a| factor[a * n + a].ln()).sum::<f64>();
        rows.chunks_exact_mut(stride).for_each(scaled);
        simd::forward(&factor, &mut rows, stride);
        self.fixes.extend(rows.iter().map(|v| *v as f32));
        normaliser
    }

    /// s of one scale.
    pub fn shares(&self, at: usize) -> &[f32] {
        &self.shares[at * self.stride..(at + 1) * self.stride]
    }

    /// L⁻¹ U_c diag(s) of one scale by rows, where coordinates are changed.
    pub fn fix_at(&self, at: usize) -> Option<&[f32]> {
        let size = self.changed * self.stride;
        (size > 0).then(|| &self.fixes[at * size..(at + 1) * size])
    }

    /// aᵀ (a C_oo + R)⁻¹ b of two residuals, given their z, at each scale; into `out`.
    pub fn forms(&self, a: &[f32], b: &[f32], out: &mut Vec<f64>) {
        let mut plain = [0.0; 16];
        out.clear();
        for (at, shares) in self.shares.chunks(16 * self.stride.max(1)).enumerate() {
            weighted_rows(shares, a, b, &mut plain);
            let left = self.scales.len() - 16 * at;
            out.extend(plain[..left.min(16)].iter().map(|v| f64::from(*v)));
        }
        for (at, out) in out.iter_mut().enumerate() {
            let Some(rows) = self.fix_at(at) else { break };
            *out -= self.fixed(rows, a, b);
        }
    }

    /// qᵀ G⁻¹ q of two residuals.
    fn fixed(&self, rows: &[f32], a: &[f32], b: &[f32]) -> f64 {
        let (mut p, mut q) = ([0.0; AT_ONCE], [0.0; AT_ONCE]);
        let mut sum = 0.0;
        for rows in rows.chunks(AT_ONCE * self.stride) {
            let n = rows.len() / self.stride;
            row_dots(rows, self.stride, a, &mut p);
            let other = match std::ptr::eq(a, b) {
                true => &p,
                false => {
                    row_dots(rows, self.stride, b, &mut q);
                    &q
                }
            };
            let terms = p[..n].iter().zip(other);
            sum += terms.map(|(p, q)| f64::from(p * q)).sum::<f64>();
        }
        sum
    }

    /// The log evidence of a residual at each scale, given its z; into `out`.
    pub fn logs(&self, z: &[f32], out: &mut Vec<f64>) {
        self.forms(z, z, out);
        for (out, normaliser) in out.iter_mut().zip(&self.normalisers) {
            *out = normaliser - 0.5 * *out;
        }
    }

    /// Adds `weight` a w of a residual at a scale to `out`, given its z: w is the residual with the inverse of a C_oo + R
    /// applied to it.
    pub fn add_solved(&self, at: usize, z: &[f32], weight: f64, out: &mut [f32]) {
        let weight = (weight * self.scales[at]) as f32;
        for ((o, s), z) in out.iter_mut().zip(self.shares(at)).zip(z) {
            *o += weight * s * z;
        }
        if let Some(rows) = self.fix_at(at) {
            let mut q = vec![0.0; self.changed];
            row_dots(rows, self.stride, z, &mut q);
            let mut changed = vec![0.0; self.stride];
            combine(rows, self.stride, &q, &mut changed);
            let both = out.iter_mut().zip(&changed);
            both.for_each(|(o, c)| *o -= weight * c);
        }
    }
}

/// The weight of each that is named, once.
pub fn merged<'a>(weights: &[Weighed<'a>]) -> Vec<Weighed<'a>> {
    let mut out: Vec<Weighed<'a>> = Vec::new();
    for &(scales, at, weight) in weights {
        let same = |o: &&mut Weighed<'a>| std::ptr::eq(o.0, scales) && o.1 == at;
        match out.iter_mut().find(same) {
            Some(o) => o.2 += weight,
            None => out.push((scales, at, weight)),
        }
    }
    out
}

/// Σ log, by products of eight: logarithms cost more than all else here.
pub fn log_product(values: &[f64]) -> f64 {
    values
        .chunks(8)
        .map(|c| c.iter().product::<f64>().ln())
        .sum()
}
