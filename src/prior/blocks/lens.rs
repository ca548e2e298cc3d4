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
//! (Coordinates that are missing count neither in n nor in Σ log δ.) Where the noise is of many kinds or few coordinates
//! are seen, a decomposition of R^-1/2 C_oo R^-1/2 takes the place of U, and nothing is changed.

use super::basis::Basis;
use crate::linalg::symmetric_eigen;
use crate::prior::small::{add, dot, factorise, weighted};
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
}

#[derive(Debug, Clone)]
struct Mixed {
    /// W V by rows of the seen coordinates: (n, n).
    across: Vec<f64>,
    values: Vec<f64>,
    /// (C_:o W V)ᵀ by rows of the directions: (n, d).
    gain: Vec<f64>,
}

/// A lens at one scale.
#[derive(Debug, Clone)]
pub struct Scaled {
    /// a.
    pub scale: f64,
    /// s.
    shares: Vec<f64>,
    normaliser: f64,
    fix: Option<Fix>,
}

/// What the changed coordinates change.
#[derive(Debug, Clone)]
struct Fix {
    /// U_c diag(s), by rows of the changed coordinates.
    rows: Vec<f64>,
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
        };
        match pattern {
            Pattern::Changed { unit, changed } => Lens {
                unit: *unit,
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
            across: across.iter().copied().collect(),
            values: values.iter().map(|v| v.max(0.0)).collect(),
            gain: gain.iter().copied().collect(),
        });
        self
    }

    /// Whether z is in the block's own directions, of all coordinates.
    pub fn is_own(&self) -> bool {
        self.mixed.is_none()
    }

    /// z of the residuals `r` (d; read where seen).
    pub fn project(&self, r: impl Fn(usize) -> f64, z: &mut Vec<f64>) {
        z.clear();
        match &self.mixed {
            None => {
                z.resize(self.basis.len(), 0.0);
                for &i in &self.seen {
                    add(z, r(i), self.basis.row(i));
                }
            }
            Some(m) => {
                z.resize(m.values.len(), 0.0);
                for (&i, row) in self.seen.iter().zip(m.across.chunks_exact(m.values.len())) {
                    add(z, r(i), row);
                }
            }
        }
    }

    /// At one scale.
    pub fn at(&self, scale: f64) -> Scaled {
        let values = self
            .mixed
            .as_ref()
            .map_or(&self.basis.values, |m| &m.values);
        let shares: Vec<f64> = values
            .iter()
            .map(|l| 1.0 / (scale * l + self.unit))
            .collect();
        let mut normaliser = self.constant + 0.5 * log_product(&shares);
        let fix = (!self.changed.is_empty()).then(|| self.fix(&shares, &mut normaliser));
        Scaled {
            scale,
            shares,
            normaliser,
            fix,
        }
    }

    fn fix(&self, shares: &[f64], normaliser: &mut f64) -> Fix {
        let (count, n) = (self.changed.len(), shares.len());
        let mut rows = Vec::with_capacity(count * n);
        for &(i, _) in &self.changed {
            rows.extend(self.basis.row(i).iter().zip(shares).map(|(u, s)| u * s));
        }
        let mut factor = vec![0.0; count * count];
        for (a, row) in rows.chunks_exact(n).enumerate() {
            for (b, &(j, _)) in self.changed[..=a].iter().enumerate() {
                factor[a * count + b] = dot(row, self.basis.row(j));
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

    /// Adds `weight` times a C_:o (a C_oo + R)⁻¹ r to `out` (d), given w of r.
    pub fn add_gain(&self, scale: f64, w: &[f64], weight: f64, out: &mut [f64]) {
        match &self.mixed {
            None => {
                let step: Vec<f64> = (w.iter().zip(&self.basis.values))
                    .map(|(w, l)| weight * scale * l * w)
                    .collect();
                for (i, o) in out.iter_mut().enumerate() {
                    *o += dot(self.basis.row(i), &step);
                }
            }
            Some(m) => {
                for (row, w) in m.gain.chunks_exact(out.len()).zip(w) {
                    add(out, weight * scale * w, row);
                }
            }
        }
    }

    /// The covariance that is left at some scales, each with a weight, summed: (d, d).
    pub fn covariance(&self, scales: &[(&Scaled, f64)]) -> Array2<f64> {
        let d = self.basis.len();
        let Some(m) = &self.mixed else {
            let mut left = vec![0.0; d];
            for (s, weight) in scales {
                for ((left, l), share) in left.iter_mut().zip(&self.basis.values).zip(&s.shares) {
                    *left += weight * s.scale * l * self.unit * share;
                }
            }
            let mut out = self.basis.spread(&left);
            for (i, (s, weight)) in scales.iter().enumerate() {
                // Many blocks share a scale.
                let met = |o: &(&Scaled, f64)| std::ptr::eq(o.0, *s);
                if scales[..i].iter().any(met) {
                    continue;
                }
                let same = scales[i + 1..].iter().filter(|o| met(o));
                let weight = weight + same.map(|o| o.1).sum::<f64>();
                if let Some(fix) = &s.fix {
                    let half = self.unlearnt(s.scale, fix);
                    out.scaled_add(weight, &half.t().dot(&half));
                }
            }
            return out;
        };
        let whole: f64 = scales.iter().map(|(s, w)| w * s.scale).sum();
        let prior: Vec<f64> = self.basis.values.iter().map(|l| l * whole).collect();
        let known: Vec<f64> = (0..m.values.len())
            .map(|k| {
                scales
                    .iter()
                    .map(|(s, w)| w * s.scale * s.scale * s.shares[k])
                    .sum()
            })
            .collect();
        let half = Array2::from_shape_fn((m.values.len(), d), |(k, i)| {
            m.gain[k * d + i] * f64::sqrt(known[k])
        });
        self.basis.spread(&prior) - half.t().dot(&half)
    }

    /// (B L⁻ᵀ)ᵀ with L Lᵀ = G: what is not learnt since coordinates are worse than the rest, (changed, d).
    fn unlearnt(&self, scale: f64, fix: &Fix) -> Array2<f64> {
        let (n, d) = (self.basis.values.len(), self.basis.len());
        let mut solved = fix.rows.clone();
        for i in 0..fix.count {
            let (before, rest) = solved.split_at_mut(i * n);
            let row = &mut rest[..n];
            for (j, other) in before.chunks_exact(n).enumerate() {
                add(row, -fix.factor[i * fix.count + j], other);
            }
            let scale = 1.0 / fix.factor[i * fix.count + i];
            row.iter_mut().for_each(|v| *v *= scale);
        }
        for row in solved.chunks_exact_mut(n) {
            row.iter_mut()
                .zip(&self.basis.values)
                .for_each(|(v, l)| *v *= scale * l);
        }
        let solved = Array2::from_shape_vec((fix.count, n), solved).unwrap_or_default();
        let vectors = Array2::from_shape_fn((n, d), |(k, i)| self.basis.row(i)[k]);
        solved.dot(&vectors)
    }
}

impl Scaled {
    /// The log evidence of a residual, given its z.
    pub fn log(&self, z: &[f64]) -> f64 {
        let mut squares = weighted(&self.shares, z, z);
        if let Some(fix) = &self.fix {
            let q = fix.whitened(z);
            squares -= dot(&q, &q);
        }
        self.normaliser - 0.5 * squares
    }

    /// w of a residual, given its z: the inverse of a C_oo + R has been applied to it.
    pub fn solve(&self, z: &[f64]) -> Vec<f64> {
        let mut w: Vec<f64> = self.shares.iter().zip(z).map(|(s, z)| s * z).collect();
        if let Some(fix) = &self.fix {
            let mut q = fix.whitened(z);
            // L⁻ᵀ
            for i in (0..fix.count).rev() {
                q[i] /= fix.factor[i * fix.count + i];
                for j in 0..i {
                    q[j] -= fix.factor[i * fix.count + j] * q[i];
                }
            }
            for (row, q) in fix.rows.chunks_exact(w.len()).zip(&q) {
                add(&mut w, -q, row);
            }
        }
        w
    }
}

impl Fix {
    /// L⁻¹ q.
    fn whitened(&self, z: &[f64]) -> Vec<f64> {
        let mut q: Vec<f64> = self
            .rows
            .chunks_exact(z.len())
            .map(|row| dot(row, z))
            .collect();
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
                lens.project(|i| y[i], &mut z);
                let scaled = lens.at(scale);
                lens.add_gain(scale, &scaled.solve(&z), 1.0, &mut mean);
                let told = want.mean(&y);
                assert!(mean.iter().zip(told).all(|(a, b)| (a - b).abs() <= 1e-8));
                let log = scaled.log(&z);
                assert!(
                    (log - want.log_density(&y)).abs() <= 1e-8,
                    "{noise:?} {log}"
                );
                let half = lens.covariance(&[(&scaled, 0.5), (&scaled, 0.5)]);
                let left = half - want.covariance(prior.view());
                assert!(left.iter().all(|v| v.abs() <= 1e-8));
            }
        }
        assert_eq!(kinds, [true, true, true, false, false]);
        assert_eq!(Pattern::of(&[inf; 3]), Pattern::Nothing);
    }
}
