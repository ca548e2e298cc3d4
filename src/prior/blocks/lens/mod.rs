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

mod aside;
mod cut;
mod left;
mod pattern;

use super::basis::Basis;
use super::scales::{Even, Scales};
use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::simd::{self, combine, padded, row_dots};
use crate::numeric::small_linalg::log_product;
use cut::Cut;
use ndarray::Array2;
use std::sync::Arc;

pub use aside::Blend;
pub use pattern::Pattern;

/// A block's covariance through one noise, for every scale of it.
#[derive(Debug, Clone)]
pub struct Lens {
    basis: Arc<Basis>,
    /// The coordinates that are seen.
    seen: Arc<[usize]>,
    changed: Arc<[(usize, f64)]>,
    unit: f64,
    constant: f64,
    /// What stands in for the basis where the noise is mixed.
    mixed: Option<Mixed>,
    /// Where few directions matter.
    cut: Option<Cut>,
}

#[derive(Debug, Clone)]
struct Mixed {
    /// W V by rows of the seen coordinates: (n, n), padded.
    across: Vec<f32>,
    values: Vec<f64>,
    /// (C_:o W V)ᵀ by rows of the directions: (n, d), padded.
    gain: Vec<f32>,
}

const LOG_2_PI: f64 = 1.837_877_066_409_345_5;

impl Lens {
    /// Looks at a block through noise variances (d), of that pattern; `seen` are those that are finite.
    pub fn new(basis: &Arc<Basis>, noise: &[f64], seen: &Arc<[usize]>, pattern: &Pattern) -> Lens {
        let constant = -0.5 * seen.len() as f64 * LOG_2_PI;
        let lens = Lens {
            basis: basis.clone(),
            seen: seen.clone(),
            changed: Arc::default(),
            unit: 1.0,
            constant,
            mixed: None,
            cut: None,
        };
        match pattern {
            Pattern::Changed { unit, changed } => Lens {
                unit: *unit,
                cut: changed
                    .is_empty()
                    .then(|| Cut::of(&basis.values, *unit))
                    .flatten(),
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
        let (d, stride) = (self.basis.len(), self.basis.stride());
        let all = self.seen.len() == d;
        z.clear();
        z.reserve(self.stride() + if all { 0 } else { d });
        z.resize(self.stride(), 0.0);
        if let Some(m) = &self.mixed {
            // What is seen of the residual stands behind z for a while.
            z.extend(self.seen.iter().map(|&i| r[i]));
            let (z, seen) = z.split_at_mut(self.stride());
            combine(&m.across, z.len(), seen, z);
        } else if all {
            combine(self.basis.vectors(), stride, &r[..d], z);
        } else {
            z.resize(self.stride() + d, 0.0);
            let (z, seen) = z.split_at_mut(self.stride());
            self.seen.iter().for_each(|&i| seen[i] = r[i]);
            combine(self.basis.vectors(), stride, seen, z);
        }
        z.truncate(self.stride());
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

    /// At some scales; nothing may be changed.
    pub fn at(&self, scales: &[f64]) -> Scales {
        let shared = match (&self.cut, self.values()) {
            (Some(cut), [.., last]) => Some((cut.shared - 1.0, *last)),
            _ => None,
        };
        self.of(scales, self.values(), shared)
    }

    /// The same with no direction shared, to be [changed](Lens::changed).
    pub fn even(&self, scales: &[f64]) -> Even {
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
            simd::weighted_products(vectors, stride, scales.shares(at), &mut whole);
            let both = precisions[at / 4].iter_mut().zip(&whole);
            both.for_each(|(p, w)| p[at % 4] = *w);
        }
        Even { scales, precisions }
    }

    /// Where coordinates are changed: at the scales at which the same block was seen without. `many` where more residuals
    /// than there are changed coordinates are to come.
    pub fn changed(&self, even: &Even, many: bool) -> Scales {
        let unseen = self.basis.len() - self.seen.len();
        let constant = 0.5 * unseen as f64 * LOG_2_PI;
        Scales::changed(even, &self.basis, &self.changed, self.unit, constant, many)
    }

    fn of(&self, scales: &[f64], values: &[f64], shared: Option<(f64, f64)>) -> Scales {
        Scales::new(scales, padded(values.len()), |scale, shares| {
            let share = |l: &f64| 1.0 / (scale * l + self.unit);
            shares.extend(values.iter().map(|l| share(l) as f32));
            let more = shared.map_or(0.0, |(count, last)| count * share(&last).ln());
            self.constant + 0.5 * (log_product(values.iter().map(share)) + more)
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
    use super::super::part::Active;
    use super::super::scales::Room;
    use super::*;
    use crate::numeric::gaussian::ConditionalGaussian;

    /// Directions that drown share one: next to the same evidence, mean and variances.
    #[test]
    fn shared_directions_change_next_to_nothing() {
        let d = 40;
        let b = Array2::from_shape_fn((d, 4), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) * 5.0 + Array2::<f64>::eye(d) * 1e-3;
        let noise = vec![1.0; d];
        let lens = Lens::new(
            &Arc::new(Basis::of(c.view())),
            &noise,
            &(0..d).collect(),
            &Pattern::of(&noise),
        );
        assert!(lens.cut.is_some() && lens.stride() < d);
        let want = ConditionalGaussian::new(c.view(), &noise);
        let y: Vec<f64> = (0..d).map(|i| (i as f64 * 1.3).cos()).collect();
        let r: Vec<f32> = y.iter().map(|v| *v as f32).collect();
        let scales = lens.at(&[1.0]);
        let (mut z, mut logs, mut mean) = (Vec::new(), Vec::new(), vec![0.0; d]);
        lens.project(&r, &mut z);
        scales.logs(&z, &mut Room::default(), &mut logs);
        assert!((logs[0] - want.log_density(&y)).abs() <= 1e-3, "{logs:?}");
        let mut w = vec![0.0; z.len()];
        scales.add_solved(0, &z, 1.0, &mut Room::default(), &mut w);
        lens.add_gain(&w, &mut mean);
        let told = want.mean(&y);
        assert!(mean.iter().zip(told).all(|(a, b)| (a - b).abs() <= 5e-3));
        let mut variances = vec![0.0; d];
        lens.add_variances(&[(&scales, 0, 1.0)], &mut variances);
        let told = want.covariance(c.view());
        let off = variances.iter().zip(told.diag());
        assert!(off.into_iter().all(|(a, b)| (a - b).abs() <= 1e-3));
    }

    #[test]
    fn a_scale_is_the_same_beside_any_number_of_others() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t()) + Array2::<f64>::eye(6) * 0.01;
        let basis = Arc::new(Basis::of(c.view()));
        let noise = [0.5, f64::INFINITY, 0.5, 0.5, 2.0, 0.5];
        let seen: Arc<[usize]> = (0..6).filter(|&i| noise[i].is_finite()).collect();
        let lens = Lens::new(&basis, &noise, &seen, &Pattern::of(&noise));
        let plain = Lens::new(
            &basis,
            &[0.5; 6],
            &(0..6).collect(),
            &Pattern::of(&[0.5; 6]),
        );
        let r = [1.0, 3.0, -0.5, 0.2, -1.4, 0.7, 0.0, 0.0];
        let (mut z, mut room) = (Vec::new(), Room::default());
        lens.project(&r, &mut z);
        let mut told = |scales: &[f64], many: bool| {
            let scales = lens.changed(&plain.even(scales), many);
            let (mut logs, mut solved) = (Vec::new(), Vec::new());
            scales.logs(&z, &mut room, &mut logs);
            for at in 0..logs.len() {
                let mut w = vec![0.0; z.len()];
                scales.add_solved(at, &z, 1.0, &mut room, &mut w);
                solved.push(w);
            }
            (logs, solved)
        };
        let all = [0.03, 0.2, 1.0, 2.5, 6.0, 15.0];
        let many = told(&all, true);
        let (logs, solved) = told(&all, false);
        assert_eq!(logs.len(), all.len());
        for (at, scale) in all.iter().enumerate() {
            let (alone, own) = told(&[*scale], false);
            assert_eq!(alone[0], logs[at]);
            assert_eq!(own[0], solved[at]);
            assert!((many.0[at] - logs[at]).abs() <= 1e-4);
            let both = many.1[at].iter().zip(&solved[at]);
            assert!(both.into_iter().all(|(a, b)| (a - b).abs() <= 1e-4));
        }
    }

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
            let finite = (0..6).filter(|&i| noise[i].is_finite());
            let lens = Lens::new(&basis, &noise, &finite.collect(), &pattern);
            kinds.push(lens.is_own());
            let at = |scales: [f64; 2], many: bool| match &pattern {
                Pattern::Changed { unit, changed } if !changed.is_empty() => {
                    let noise = [*unit; 6];
                    let even = Pattern::of(&noise);
                    let plain = Lens::new(&basis, &noise, &(0..6).collect(), &even);
                    lens.changed(&plain.even(&scales), many)
                }
                _ => lens.at(&scales),
            };
            for (scale, many) in [(1.0, false), (2.5, true), (0.03, true), (0.03, false)] {
                let prior = &c * scale;
                let want = ConditionalGaussian::new(prior.view(), &noise);
                let (mut z, mut mean) = (Vec::new(), vec![0.0; 6]);
                let mut r: Vec<f32> = y.iter().map(|y| *y as f32).collect();
                r.resize(padded(6), 0.0);
                lens.project(&r, &mut z);
                let scales = at([scale, 0.5 * scale], many);
                let mut w = vec![0.0; z.len()];
                scales.add_solved(0, &z, 1.0, &mut Room::default(), &mut w);
                lens.add_gain(&w, &mut mean);
                let told = want.mean(&y);
                assert!(mean.iter().zip(told).all(|(a, b)| (a - b).abs() <= 1e-4));
                let mut logs = Vec::new();
                scales.logs(&z, &mut Room::default(), &mut logs);
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
                // Leaves, which are wide along a step as well.
                let step: [f32; 6] = [0.5, -1.0, 0.25, 2.0, 0.0, -0.75];
                let mut long = step.to_vec();
                long.resize(padded(6), 0.0);
                let mut of_step = Vec::new();
                lens.project(&long, &mut of_step);
                let level = |at, along| Active {
                    level: 0,
                    scale: scales.scales[at],
                    at,
                    along,
                };
                let levels = [level(0, 0.0), level(0, 1.5), level(1, 0.5)];
                scales.logs_of_leaf((&z, &of_step), &levels, &mut Room::default(), &mut logs);
                for (level, log) in levels.iter().zip(&logs) {
                    let prior = Array2::from_shape_fn((6, 6), |(i, j)| {
                        level.scale * c[[i, j]] + level.along * f64::from(step[i] * step[j])
                    });
                    let want = ConditionalGaussian::new(prior.view(), &noise).log_density(&y);
                    assert!((log - want).abs() <= 1e-4, "{log} {want}");
                }
            }
        }
        assert_eq!(kinds, [true, true, true, false, false]);
        assert_eq!(Pattern::of(&[inf; 3]), Pattern::Nothing);
    }
}
