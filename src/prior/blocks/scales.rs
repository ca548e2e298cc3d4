//! A block seen through noise, at some scales of its covariance: evidence and what a residual is solved to.

use super::basis::Basis;
use super::part::Active;
use crate::prior::small::{backward, dot, factorise, forward};
use crate::simd::{self, combine, row_dots, weighted_rows};
use std::borrow::Cow;

/// A lens at some scales of the covariance.
#[derive(Debug, Clone)]
pub struct Scales {
    /// a of each.
    pub scales: Vec<f64>,
    /// s of each, by rows: (scales, directions), padded.
    shares: Vec<f32>,
    stride: usize,
    normalisers: Vec<f64>,
    /// U_c diag(s) of each, or L⁻¹ of that: (scales × changed, directions), padded.
    rows: Vec<f32>,
    /// L of each, L Lᵀ = G, by rows: (scales, changed, changed). Empty where it is taken off the rows already.
    factors: Vec<f64>,
    /// How many coordinates are changed.
    changed: usize,
}

/// A block seen through noise that is everywhere the same, at some scales: what noise that is not starts from.
#[derive(Debug, Clone)]
pub struct Even {
    /// At all directions.
    pub scales: Scales,
    /// P = U diag(s) Uᵀ of each scale, (scales, d, d), rows padded.
    pub precisions: Vec<f32>,
}

/// One scale of a lens, with a weight.
pub type Weighed<'a> = (&'a Scales, usize, f64);

/// Leaves are of so many scales at most.
pub const MOST_LEAVES: usize = 16;
/// So many products with changed coordinates are taken at a time.
const AT_ONCE: usize = 32;

impl Scales {
    /// Nothing known of any scale yet.
    pub fn of(scales: Vec<f64>, stride: usize) -> Scales {
        Scales {
            shares: Vec::with_capacity(scales.len() * stride),
            normalisers: Vec::with_capacity(scales.len()),
            rows: Vec::new(),
            factors: Vec::new(),
            changed: 0,
            scales,
            stride,
        }
    }

    /// Adds the next scale: s by directions, and the log evidence of a residual of nothing.
    pub fn push(&mut self, shares: &[f64], normaliser: f64) {
        let end = self.shares.len() + self.stride;
        self.shares.extend(shares.iter().map(|s| *s as f32));
        self.shares.resize(end, 0.0);
        self.normalisers.push(normaliser);
    }

    /// The same where coordinates have more noise than `unit`, of which all have it; `constant` is added to the log
    /// evidence. `many` where more residuals than there are changed coordinates are to come.
    pub fn changed(
        even: &Even,
        basis: &Basis,
        changed: &[(usize, f64)],
        unit: f64,
        constant: f64,
        many: bool,
    ) -> Scales {
        let mut out = even.scales.clone();
        let (n, stride) = (changed.len(), out.stride);
        out.changed = n;
        out.rows.reserve_exact(out.scales.len() * n * stride);
        if !many {
            out.factors.reserve_exact(out.scales.len() * n * n);
        }
        let mut factor = vec![0.0; n * n];
        let of_scale = even.precisions.chunks_exact(basis.len() * stride);
        for (at, precision) in of_scale.enumerate() {
            let mut normaliser = constant;
            for (a, (i, noise)) in changed.iter().enumerate() {
                let row = &precision[i * stride..(i + 1) * stride];
                let before = factor[a * n..].iter_mut().zip(&changed[..=a]);
                before.for_each(|(f, (j, _))| *f = f64::from(row[*j]));
                let above = noise - unit;
                // 1 / ∞ is 0: a missing coordinate.
                factor[a * n + a] += 1.0 / above;
                if above.is_finite() {
                    normaliser -= 0.5 * above.ln();
                }
            }
            factorise(&mut factor, n);
            let pivots: Vec<f64> = (0..n).map(|a| factor[a * n + a]).collect();
            out.normalisers[at] += normaliser - log_product(&pivots);
            let shares = &even.scales.shares[at * stride..(at + 1) * stride];
            let start = out.rows.len();
            for (i, _) in changed {
                let row = basis.row(*i).iter().zip(shares);
                out.rows.extend(row.map(|(u, s)| u * s));
            }
            if many {
                let solved = whitened_rows(&factor, &out.rows[start..], stride);
                out.rows[start..].copy_from_slice(&solved);
            } else {
                out.factors.extend_from_slice(&factor);
            }
        }
        out
    }

    /// s of one scale.
    pub fn shares(&self, at: usize) -> &[f32] {
        &self.shares[at * self.stride..(at + 1) * self.stride]
    }

    /// U_c diag(s) of one scale by rows, or L⁻¹ of that, where coordinates are changed.
    fn rows_at(&self, at: usize) -> Option<&[f32]> {
        let size = self.changed * self.stride;
        (size > 0).then(|| &self.rows[at * size..(at + 1) * size])
    }

    /// L of one scale, where it is not taken off the rows.
    fn factor_at(&self, at: usize) -> Option<&[f64]> {
        let size = self.changed * self.changed;
        (!self.factors.is_empty()).then(|| &self.factors[at * size..(at + 1) * size])
    }

    /// L⁻¹ U_c diag(s) of one scale by rows, where coordinates are changed.
    pub fn fix_at(&self, at: usize) -> Option<Cow<'_, [f32]>> {
        let rows = self.rows_at(at)?;
        let Some(factor) = self.factor_at(at) else {
            return Some(rows.into());
        };
        Some(whitened_rows(factor, rows, self.stride).into())
    }

    /// Σ s a b of two residuals, given their z, at each scale; into `out`.
    fn plain(&self, a: &[f32], b: &[f32], out: &mut Vec<f64>) {
        let mut plain = [0.0; 16];
        out.clear();
        for (at, shares) in self.shares.chunks(16 * self.stride.max(1)).enumerate() {
            weighted_rows(shares, a, b, &mut plain);
            let left = self.scales.len() - 16 * at;
            out.extend(plain[..left.min(16)].iter().map(|v| f64::from(*v)));
        }
    }

    /// aᵀ (a C_oo + R)⁻¹ b of two residuals, given their z, at each scale; into `out`.
    pub fn forms(&self, a: &[f32], b: &[f32], out: &mut Vec<f64>) {
        self.plain(a, b, out);
        if self.changed == 0 {
            return;
        }
        let (mut p, mut q) = (Vec::new(), Vec::new());
        for (at, out) in out.iter_mut().enumerate() {
            self.whiten(at, a, &mut p);
            *out -= match std::ptr::eq(a, b) {
                true => dot(&p, &p),
                false => {
                    self.whiten(at, b, &mut q);
                    dot(&p, &q)
                }
            };
        }
    }

    /// L⁻¹ q of a residual; nothing where no coordinate is changed.
    pub fn whitened(&self, at: usize, z: &[f32]) -> Vec<f64> {
        let mut out = Vec::new();
        self.whiten(at, z, &mut out);
        out
    }

    /// The same into `out`.
    fn whiten(&self, at: usize, z: &[f32], out: &mut Vec<f64>) {
        out.clear();
        let mut some = [0.0; AT_ONCE];
        let rows = self.rows_at(at).unwrap_or_default();
        for rows in rows.chunks(AT_ONCE * self.stride.max(1)) {
            row_dots(rows, self.stride, z, &mut some);
            let n = rows.len() / self.stride;
            out.extend(some[..n].iter().map(|v| f64::from(*v)));
        }
        if let Some(factor) = self.factor_at(at) {
            forward(factor, self.changed, out);
        }
    }

    /// The log evidence of a residual at each scale, given its z; into `out`.
    pub fn logs(&self, z: &[f32], out: &mut Vec<f64>) {
        self.forms(z, z, out);
        for (out, normaliser) in out.iter_mut().zip(&self.normalisers) {
            *out = normaliser - 0.5 * *out;
        }
    }

    /// The log evidence of a residual at each of the leaves' levels, whose scales these are, given its z and that of the
    /// leaf's step; into `out`.
    pub fn logs_of_leaf(&self, z: &[f32], step: &[f32], levels: &[Active], out: &mut Vec<f64>) {
        let mut forms = [[0.0f32; 3]; MOST_LEAVES];
        let forms = &mut forms[..self.scales.len()];
        let reaches = |at: usize| levels.iter().any(|l| l.at == at && l.along > 0.0);
        simd::weighted_forms(&self.shares, z, step, reaches, forms);
        let (mut p, mut q) = (Vec::new(), Vec::new());
        out.clear();
        out.resize(levels.len(), 0.0);
        for (at, form) in forms.iter().enumerate() {
            let mut form = form.map(f64::from);
            if self.changed > 0 {
                self.whiten(at, z, &mut p);
                form[0] -= dot(&p, &p);
                if reaches(at) {
                    self.whiten(at, step, &mut q);
                    form[1] -= dot(&p, &q);
                    form[2] -= dot(&q, &q);
                }
            }
            let plain = self.normalisers[at] - 0.5 * form[0];
            for (out, level) in out.iter_mut().zip(levels).filter(|(_, l)| l.at == at) {
                let vv = level.along * form[2];
                let gain = 0.5 * level.along * form[1] * form[1] / (1.0 + vv);
                *out = if level.along > 0.0 {
                    plain + gain - 0.5 * vv.ln_1p()
                } else {
                    plain
                };
            }
        }
    }

    /// Adds `weight` a w of a residual at a scale to `out`, given its z: w is the residual with the inverse of a C_oo + R
    /// applied to it.
    pub fn add_solved(&self, at: usize, z: &[f32], weight: f64, out: &mut [f32]) {
        let weight = (weight * self.scales[at]) as f32;
        for ((o, s), z) in out.iter_mut().zip(self.shares(at)).zip(z) {
            *o += weight * s * z;
        }
        if let Some(rows) = self.rows_at(at) {
            let mut q = self.whitened(at, z);
            if let Some(factor) = self.factor_at(at) {
                backward(factor, self.changed, &mut q);
            }
            let q: Vec<f32> = q.iter().map(|v| *v as f32).collect();
            let mut changed = vec![0.0; self.stride];
            combine(rows, self.stride, &q, &mut changed);
            let both = out.iter_mut().zip(&changed);
            both.for_each(|(o, c)| *o -= weight * c);
        }
    }
}

/// L⁻¹ of rows.
fn whitened_rows(factor: &[f64], rows: &[f32], stride: usize) -> Vec<f32> {
    let mut wide: Vec<f64> = rows.iter().map(|v| f64::from(*v)).collect();
    simd::forward(factor, &mut wide, stride);
    wide.iter().map(|v| *v as f32).collect()
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
