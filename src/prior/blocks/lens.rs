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

use super::basis::Basis;
use crate::linalg::symmetric_eigen;
use crate::prior::small::{add, dot, factorise};
use crate::simd::{self, combine, padded, row_dots, weighted_rows};
use ndarray::Array2;
use std::sync::Arc;

/// How the coordinates of a part are seen.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// None is.
    Nothing,
    /// Noise of one variance, but for some coordinates: (which, their variance, above that of the rest).
    Changed {
        /// The variance of most, and the least.
        unit: f64,
        /// Those of another.
        changed: Vec<(usize, f64)>,
    },
    /// Of many kinds.
    Mixed,
}

impl Pattern {
    /// Of noise variances (infinite: missing).
    pub fn of(noise: &[f64]) -> Pattern {
        let unit = noise.iter().copied().fold(f64::INFINITY, f64::min);
        if unit == f64::INFINITY {
            return Pattern::Nothing;
        }
        let changed: Vec<(usize, f64)> = (noise.iter().copied().enumerate())
            .filter(|(_, n)| *n > unit)
            .collect();
        // Above this the small solves cost more than a decomposition of what is seen.
        if 5 * changed.len() > 2 * noise.len() {
            return Pattern::Mixed;
        }
        Pattern::Changed { unit, changed }
    }
}

/// A block's covariance through one noise, for every scale of it.
#[derive(Debug, Clone)]
pub struct Lens {
    basis: Arc<Basis>,
    /// The coordinates that are seen.
    seen: Vec<usize>,
    changed: Vec<(usize, f64)>,
    unit: f64,
    constant: f64,
    /// What stands in for the basis where the noise is mixed.
    mixed: Option<Mixed>,
    /// Where few directions matter.
    cut: Option<Cut>,
}

/// The first directions, and one for all others.
#[derive(Debug, Clone)]
struct Cut {
    /// Their λ; the last is the others' mean.
    values: Vec<f64>,
    /// How many share the last.
    shared: f64,
}

/// Directions share one where their variance is below this share of the noise's.
const DROWNED: f64 = 0.01;

#[derive(Debug, Clone)]
struct Mixed {
    /// W V by rows of the seen coordinates: (n, n), padded.
    across: Vec<f32>,
    values: Vec<f64>,
    /// (C_:o W V)ᵀ by rows of the directions: (n, d), padded.
    gain: Vec<f32>,
}

/// A lens at some scales of the covariance.
#[derive(Debug, Clone)]
pub struct Scales {
    /// a of each.
    pub scales: Vec<f64>,
    /// s of each, by rows: (scales, directions), padded.
    shares: Vec<f32>,
    stride: usize,
    normalisers: Vec<f64>,
    /// Of each, where coordinates are changed.
    fixes: Vec<Fix>,
}

/// One scale of a lens, with a weight.
pub type Weighed<'a> = (&'a Scales, usize, f64);

/// What the changed coordinates change.
#[derive(Debug, Clone)]
struct Fix {
    /// U_c diag(s), by rows of the changed coordinates, padded.
    rows: Vec<f32>,
    /// The Cholesky factor of G by rows.
    factor: Vec<f64>,
    count: usize,
}

const LOG_2_PI: f64 = 1.837_877_066_409_345_5;

impl Lens {
    /// Looks at a block through noise variances (d), of that pattern.
    pub fn new(basis: &Arc<Basis>, noise: &[f64], pattern: &Pattern) -> Lens {
        let seen: Vec<usize> = (0..noise.len()).filter(|&i| noise[i].is_finite()).collect();
        let constant = -0.5 * seen.len() as f64 * LOG_2_PI;
        let lens = Lens {
            basis: basis.clone(),
            seen,
            changed: Vec::new(),
            unit: 1.0,
            constant,
            mixed: None,
            cut: None,
        };
        match pattern {
            Pattern::Changed { unit, changed } => Lens {
                unit: *unit,
                cut: Cut::of(&basis.values, *unit).filter(|_| changed.is_empty()),
                changed: changed.clone(),
                ..lens
            },
            _ => lens.mixed(noise),
        }
    }

    fn mixed(mut self, noise: &[f64]) -> Lens {
        let (n, d) = (self.seen.len(), self.basis.len());
        let w: Vec<f64> = self.seen.iter().map(|&i| 1.0 / noise[i].sqrt()).collect();
        let atoms = self.basis.atoms();
        let seen = Array2::from_shape_fn((n, d), |(i, k)| w[i] * atoms[[self.seen[i], k]]);
        let whitened = seen.dot(&seen.t());
        let (values, vectors) = symmetric_eigen(&whitened)
            .unwrap_or_else(|| (ndarray::Array1::zeros(n), Array2::eye(n)));
        let across = Array2::from_shape_fn((n, n), |(i, k)| w[i] * vectors[[i, k]]);
        // (C_:o W V)ᵀ = Vᵀ (W A_o) Aᵀ with the atoms A.
        let gain = vectors.t().dot(&seen).dot(&atoms.t());
        self.constant += w.iter().map(|w| w.ln()).sum::<f64>();
        self.mixed = Some(Mixed {
            across: simd::rows(&across),
            values: values.iter().map(|v| v.max(0.0)).collect(),
            gain: simd::rows(&gain),
        });
        self
    }

    /// Whether z is in the block's own directions, of all coordinates.
    pub fn is_own(&self) -> bool {
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
        z.clear();
        z.resize(self.stride(), 0.0);
        if let Some(m) = &self.mixed {
            let weights: Vec<f32> = self.seen.iter().map(|&i| r[i]).collect();
            return combine(&m.across, z.len(), &weights, z);
        }
        let (d, stride) = (self.basis.len(), self.basis.stride());
        if self.seen.len() == d {
            combine(self.basis.vectors(), stride, &r[..d], z);
        } else {
            let mut weights = vec![0.0; d];
            self.seen.iter().for_each(|&i| weights[i] = r[i]);
            combine(self.basis.vectors(), stride, &weights, z);
        }
        if self.cut.is_some() {
            self.share(simd::dot(r, r), z);
        }
    }

    /// z of one of the cell's leaves, given that of the cell's mean, the leaf's code, and both y and the leaf's pose
    /// (padded).
    pub fn shift(&self, of_cell: &[f32], code: &[f32], y: &[f32], pose: &[f32], z: &mut Vec<f32>) {
        z.clear();
        z.extend(of_cell.iter().zip(code).map(|(z, c)| z - c));
        if self.cut.is_some() {
            self.share(simd::distance(y, pose), z);
        }
    }

    /// z of a leaf's step, given it in the cell's directions: of those that are shared it has next to nothing.
    pub fn turn(&self, turn: &[f32], z: &mut Vec<f32>) {
        z.clear();
        z.extend_from_slice(&turn[..self.stride()]);
        if let Some(cut) = &self.cut {
            z[cut.values.len() - 1..].fill(0.0);
        }
    }

    /// Where directions share one, what is left for it of a residual of that squared length.
    fn share(&self, length: f32, z: &mut [f32]) {
        if let Some(cut) = &self.cut {
            let last = cut.values.len() - 1;
            z[last..].fill(0.0);
            z[last] = (length - simd::dot(z, z)).max(0.0).sqrt();
        }
    }

    /// At some scales.
    pub fn at(&self, scales: impl Iterator<Item = f64>) -> Scales {
        let (values, stride) = (self.values(), self.stride());
        let mut out = Scales {
            scales: scales.collect(),
            shares: Vec::new(),
            stride,
            normalisers: Vec::new(),
            fixes: Vec::new(),
        };
        for scale in &out.scales {
            let shares: Vec<f64> = values
                .iter()
                .map(|l| 1.0 / (scale * l + self.unit))
                .collect();
            let mut normaliser = self.constant + 0.5 * log_product(&shares);
            if let (Some(cut), Some(last)) = (&self.cut, shares.last()) {
                normaliser += 0.5 * (cut.shared - 1.0) * last.ln();
            }
            if !self.changed.is_empty() {
                out.fixes.push(self.fix(&shares, &mut normaliser));
            }
            out.normalisers.push(normaliser);
            let end = out.shares.len() + stride;
            out.shares.extend(shares.iter().map(|s| *s as f32));
            out.shares.resize(end, 0.0);
        }
        out
    }

    fn fix(&self, shares: &[f64], normaliser: &mut f64) -> Fix {
        let (count, stride) = (self.changed.len(), self.basis.stride());
        let mut rows = Vec::with_capacity(count * stride);
        for (a, &(i, _)) in self.changed.iter().enumerate() {
            let scaled = self.basis.row(i).iter().zip(shares);
            rows.extend(scaled.map(|(u, s)| u * *s as f32));
            rows.resize((a + 1) * stride, 0.0);
        }
        let mut factor = vec![0.0; count * count];
        let wide = |i: usize| -> Vec<f64> {
            let row = self.basis.row(i).iter();
            row.zip(shares).map(|(u, _)| f64::from(*u)).collect()
        };
        let all: Vec<Vec<f64>> = self.changed.iter().map(|c| wide(c.0)).collect();
        for (a, row) in all.iter().enumerate() {
            let row: Vec<f64> = row.iter().zip(shares).map(|(u, s)| u * s).collect();
            for (b, other) in all[..=a].iter().enumerate() {
                factor[a * count + b] = dot(&row, other);
            }
            let above = self.changed[a].1 - self.unit;
            // 1 / ∞ is 0: a missing coordinate.
            factor[a * count + a] += 1.0 / above;
            if above.is_finite() {
                *normaliser -= 0.5 * above.ln();
            }
        }
        factorise(&mut factor, count);
        *normaliser -= (0..count).map(|i| factor[i * count + i].ln()).sum::<f64>();
        Fix {
            rows,
            factor,
            count,
        }
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

    /// The covariance that is left at some scales (which of them, with what weight), added to `out` (d, d).
    pub fn add_covariance(&self, weights: &[Weighed<'_>], out: &mut Array2<f64>) {
        match &self.mixed {
            None => {
                let (left, shared) = self.left(weights);
                self.basis.add_spread(&left, out);
                out.diag_mut().mapv_inplace(|v| v + shared);
                for (scales, at, weight) in merged(weights) {
                    if let Some(fix) = scales.fixes.get(at) {
                        let half = self.unlearnt(scales.scales[at], fix);
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

    /// The diagonal of what [`add_covariance`](Lens::add_covariance) adds, added to `out` (d).
    pub fn add_variances(&self, weights: &[Weighed<'_>], out: &mut [f64]) {
        let add = |out: &mut [f64], more: Vec<f64>| {
            out.iter_mut().zip(more).for_each(|(o, v)| *o += v);
        };
        match &self.mixed {
            None => {
                let (left, shared) = self.left(weights);
                add(out, self.basis.diagonal_of(&left));
                out.iter_mut().for_each(|v| *v += shared);
                for (scales, at, weight) in merged(weights) {
                    if let Some(fix) = scales.fixes.get(at) {
                        for row in self.unlearnt(scales.scales[at], fix).rows() {
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
    fn left(&self, weights: &[Weighed<'_>]) -> (Vec<f64>, f64) {
        let mut left = vec![0.0; self.values().len()];
        for &(scales, at, weight) in weights {
            let shares = &scales.shares[at * scales.stride..];
            let terms = self.values().iter().zip(shares);
            for (left, (l, share)) in left.iter_mut().zip(terms) {
                *left += weight * scales.scales[at] * l * self.unit * f64::from(*share);
            }
        }
        let shared = match self.cut {
            Some(_) => left.pop().unwrap_or(0.0),
            None => 0.0,
        };
        left.iter_mut().for_each(|v| *v -= shared);
        (left, shared)
    }

    /// Where the noise is mixed: Σ weight aλ by directions, and Σ weight a² s by those seen.
    fn known(&self, mixed: &Mixed, weights: &[Weighed<'_>]) -> (Vec<f64>, Vec<f64>) {
        let whole: f64 = weights.iter().map(|(s, at, w)| w * s.scales[*at]).sum();
        let prior = self.basis.values.iter().map(|l| l * whole).collect();
        let of = |k: usize| -> f64 {
            let terms = weights.iter().map(|&(scales, at, w)| {
                let share = scales.shares[at * scales.stride + k];
                w * scales.scales[at].powi(2) * f64::from(share)
            });
            terms.sum()
        };
        (prior, (0..mixed.values.len()).map(of).collect())
    }

    /// (B L⁻ᵀ)ᵀ with L Lᵀ = G: what is not learnt since coordinates are worse than the rest, (changed, d).
    fn unlearnt(&self, scale: f64, fix: &Fix) -> Array2<f64> {
        let (n, d) = (self.basis.stride(), self.basis.len());
        let mut solved: Vec<f64> = fix.rows.iter().map(|v| f64::from(*v)).collect();
        for i in 0..fix.count {
            let (before, rest) = solved.split_at_mut(i * n);
            let row = &mut rest[..n];
            for (j, other) in before.chunks_exact(n).enumerate() {
                add(row, -fix.factor[i * fix.count + j], other);
            }
            let scale = 1.0 / fix.factor[i * fix.count + i];
            row.iter_mut().for_each(|v| *v *= scale);
        }
        let mut out = Array2::zeros((fix.count, d));
        let mut step = vec![0.0; n];
        let mut products = vec![0.0; d];
        for (row, mut out) in solved.chunks_exact(n).zip(out.rows_mut()) {
            for ((s, v), l) in step.iter_mut().zip(row).zip(&self.basis.values) {
                *s = (scale * l * v) as f32;
            }
            row_dots(self.basis.vectors(), n, &step, &mut products);
            out.iter_mut()
                .zip(&products)
                .for_each(|(o, p)| *o = f64::from(*p));
        }
        out
    }
}

impl Cut {
    /// Of falling variances, seen through noise of variance `unit`; none where next to all matter.
    fn of(values: &[f64], unit: f64) -> Option<Cut> {
        let matter = values.partition_point(|l| *l > DROWNED * unit);
        // With the shared one they fill the lanes.
        let kept = simd::padded(matter + 1) - 1;
        if simd::padded(values.len()) < kept + 1 + simd::LANES {
            return None;
        }
        let rest = &values[kept..];
        let mean = rest.iter().sum::<f64>() / rest.len() as f64;
        Some(Cut {
            values: values[..kept].iter().copied().chain([mean]).collect(),
            shared: rest.len() as f64,
        })
    }
}

/// The weight of each that is named, once.
fn merged<'a>(weights: &[Weighed<'a>]) -> Vec<Weighed<'a>> {
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

impl Scales {
    /// aᵀ (a C_oo + R)⁻¹ b of two residuals, given their z, at each scale; into `out`.
    pub fn forms(&self, a: &[f32], b: &[f32], out: &mut Vec<f64>) {
        let mut plain = [0.0; 16];
        out.clear();
        for (at, shares) in self.shares.chunks(16 * self.stride.max(1)).enumerate() {
            weighted_rows(shares, a, b, &mut plain);
            let left = self.scales.len() - 16 * at;
            out.extend(plain[..left.min(16)].iter().map(|v| f64::from(*v)));
        }
        for (fix, out) in self.fixes.iter().zip(out) {
            let q = fix.whitened(a);
            *out -= match std::ptr::eq(a, b) {
                true => dot(&q, &q),
                false => dot(&q, &fix.whitened(b)),
            };
        }
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
        let shares = &self.shares[at * self.stride..(at + 1) * self.stride];
        let weight = (weight * self.scales[at]) as f32;
        for ((o, s), z) in out.iter_mut().zip(shares).zip(z) {
            *o += weight * s * z;
        }
        if let Some(fix) = self.fixes.get(at) {
            let mut q = fix.whitened(z);
            // L⁻ᵀ
            for i in (0..fix.count).rev() {
                q[i] /= fix.factor[i * fix.count + i];
                for j in 0..i {
                    q[j] -= fix.factor[i * fix.count + j] * q[i];
                }
            }
            let q: Vec<f32> = q.iter().map(|q| *q as f32).collect();
            let mut changed = vec![0.0; out.len()];
            combine(&fix.rows, self.stride, &q, &mut changed);
            let both = out.iter_mut().zip(&changed);
            both.for_each(|(o, c)| *o -= weight * c);
        }
    }
}

/// A vector beside a lens: in its directions, with what is left where some of them are shared.
pub struct Aside<'a> {
    lens: &'a Lens,
    of: &'a [f32],
    /// In the directions, that of the shared ones 0.
    z: Vec<f32>,
}

impl<'a> Aside<'a> {
    /// Of a vector (d, padded with 0; read where seen).
    pub fn of(lens: &'a Lens, of: &'a [f32]) -> Aside<'a> {
        let mut z = Vec::new();
        lens.project(of, &mut z);
        if let Some(cut) = &lens.cut {
            z[cut.values.len() - 1] = 0.0;
        }
        Aside { lens, of, z }
    }

    /// aᵀ (a C_oo + R)⁻¹ b with another, at each scale; into `out`.
    pub fn forms(&self, other: &Aside<'_>, scales: &Scales, out: &mut Vec<f64>) {
        scales.forms(&self.z, &other.z, out);
        let Some(cut) = &self.lens.cut else { return };
        let left = simd::dot(self.of, other.of) - simd::dot(&self.z, &other.z);
        let shares = scales.shares.chunks_exact(scales.stride);
        for (out, shares) in out.iter_mut().zip(shares) {
            *out += f64::from(shares[cut.values.len() - 1] * left);
        }
    }
}

impl Fix {
    /// L⁻¹ q.
    fn whitened(&self, z: &[f32]) -> Vec<f64> {
        let mut products = vec![0.0; self.count];
        row_dots(&self.rows, z.len(), z, &mut products);
        let mut q: Vec<f64> = products.iter().map(|q| f64::from(*q)).collect();
        for i in 0..self.count {
            let row = &self.factor[i * self.count..i * self.count + i];
            q[i] = (q[i] - dot(row, &q[..i])) / self.factor[i * self.count + i];
        }
        q
    }
}

/// Σ log, by products of eight: logarithms cost more than all else here.
fn log_product(values: &[f64]) -> f64 {
    values
        .chunks(8)
        .map(|c| c.iter().product::<f64>().ln())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::conditional::Conditional;

    /// Every pattern gives what conditioning the Gaussian gives.
    #[test]
    fn a_lens_is_the_conditional_gaussian() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) + Array2::<f64>::eye(6) * 0.01;
        let basis = Arc::new(Basis::of(c.view()));
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
            let pattern = Pattern::of(&noise);
            let lens = Lens::new(&basis, &noise, &pattern);
            kinds.push(lens.is_own());
            for scale in [1.0, 2.5, 0.03] {
                let prior = &c * scale;
                let want = Conditional::new(prior.view(), &noise);
                let (mut z, mut mean) = (Vec::new(), vec![0.0; 6]);
                let mut r: Vec<f32> = y.iter().map(|y| *y as f32).collect();
                r.resize(padded(6), 0.0);
                lens.project(&r, &mut z);
                let scales = lens.at([scale, 0.5 * scale].into_iter());
                let mut w = vec![0.0; z.len()];
                scales.add_solved(0, &z, 1.0, &mut w);
                lens.add_gain(&w, &mut mean);
                let told = want.mean(&y);
                assert!(mean.iter().zip(told).all(|(a, b)| (a - b).abs() <= 1e-4));
                let mut logs = Vec::new();
                scales.logs(&z, &mut logs);
                let log = logs[0];
                assert!(
                    (log - want.log_density(&y)).abs() <= 1e-4,
                    "{noise:?} {log}"
                );
                let mut left = Array2::zeros((6, 6));
                lens.add_covariance(&[(&scales, 0, 0.5), (&scales, 0, 0.5)], &mut left);
                let mut variances = vec![0.0; 6];
                lens.add_variances(&[(&scales, 0, 0.5), (&scales, 0, 0.5)], &mut variances);
                let off = left.diag().to_vec().into_iter().zip(variances);
                assert!(off.into_iter().all(|(a, b)| (a - b).abs() <= 1e-4));
                left -= &want.covariance(prior.view());
                assert!(left.iter().all(|v| v.abs() <= 1e-4), "{left:?}");
            }
        }
        assert_eq!(kinds, [true, true, true, false, false]);
        assert_eq!(Pattern::of(&[inf; 3]), Pattern::Nothing);
    }
}
