//! The parameters of greedy sparse coding: orthogonal matching pursuit (OMP) and optimized OMP
//! (OOMP).
//!
//! For a pose y (D), weights w (D) and a dictionary with atoms a_1..a_n (the rows here; the columns
//! of Lai et al.'s A),
//!
//! ```text
//! min_x  sum_i w_i (y_i - (A x)_i)^2    with at most kappa entries of x different from 0
//!     (9)-(11) of Lai et al.
//! ```
//!
//! is solved approximately: atoms are selected one at a time, and all coefficients are refitted
//! after each. A weight is the precision of a coordinate: 0 where it is missing (Lai et al.'s P).
//! Atoms are compared as if renormalized for the weights; coefficients belong to the dictionary's
//! unit-norm atoms.
//!
//! - [`SelectionRule::Oomp`] takes the atom that leaves the smallest residual: the largest |<a, r>|
//!   / |(I - P) a|, with P the projection on the chosen atoms (also called order-recursive matching
//!   pursuit). Poses share the mean body, so atoms are strongly correlated, and only what an atom
//!   adds to the others counts.
//! - [`SelectionRule::Omp`] takes the largest |<a, r>| / |a| (Pati, Rezaiifar, Krishnaprasad 1993),
//!   as in Lai et al.
//!
//! Cost of a pose: O(kappa n D) for dense scans, O(kappa^2 D) for the least squares. The Gram
//! matrix lowers the scans after the first to O(kappa^2 n); a ball tree visits a few percent of the
//! atoms for poses near them.
//!
//! Atoms are compared in single precision. Rounding, at most about 1e-6 of the pose's length, can
//! change which of two nearly equal atoms is selected. An atom within an angle of 1e-3 of the span
//! of those taken is scored as if it were at 1e-3. Coefficients and residual are computed in double
//! precision for the atoms taken.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// How the next atom is selected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SelectionRule {
    /// The atom that leaves the smallest residual after refitting all coefficients. The more
    /// accurate rule.
    #[default]
    #[serde(rename = "oomp")]
    Oomp,
    /// The atom most correlated with the residual.
    #[serde(rename = "omp")]
    Omp,
}

/// The residual at which a pose takes no more atoms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub enum Tolerance {
    /// No tolerance: a pose takes atoms up to the sparsity, or until the residual is zero to single
    /// precision.
    #[default]
    Never,
    /// √(sum w r^2 / sum w) at most this: the RMS over the observed coordinates, in the poses'
    /// unit.
    Rms(f64),
    /// √(sum w r^2) at most this: with precisions as weights, a length in standard deviations.
    Norm(f64),
}

impl Tolerance {
    /// The squared residual to stop at, for weights that sum to `total`.
    pub(super) fn squared(self, total: f64) -> f64 {
        match self {
            Tolerance::Never => 0.0,
            Tolerance::Rms(t) => t * t * total,
            Tolerance::Norm(t) => t * t,
        }
    }
}

/// Why a code has no more atoms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum StopReason {
    /// The code has as many atoms as the sparsity allows.
    Sparsity,
    /// The residual is within the tolerance, or zero to single precision.
    Tolerance,
    /// No further useful atom is independent of those taken on the observed coordinates.
    Dependent,
    /// The pose is zero wherever it is observed, or observed nowhere: the code is empty.
    Nothing,
}

/// The parameters of matching pursuit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Omp {
    /// The largest number of atoms in a code: Lai et al.'s kappa. At least 1; default 3.
    pub sparsity: usize,
    /// How atoms are selected. Default: OOMP.
    pub rule: SelectionRule,
    /// When to stop before that. Default: never.
    pub tolerance: Tolerance,
}

impl Default for Omp {
    fn default() -> Self {
        Omp {
            sparsity: 3,
            rule: SelectionRule::Oomp,
            tolerance: Tolerance::Never,
        }
    }
}

impl Omp {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`Error::Usage`] if a parameter is out of its range.
    pub(crate) fn check(&self) -> Result<()> {
        if self.sparsity == 0 {
            return Err(Error::usage(
                "a sparsity of 0: it must be at least 1 atom per pose",
            ));
        }
        match self.tolerance {
            Tolerance::Rms(t) | Tolerance::Norm(t) if !(t >= 0.0 && t.is_finite()) => {
                Err(Error::usage(format!(
                    "a tolerance of {t}: it must be a number that is not negative"
                )))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Dictionary;
    use super::super::testdata::encode_one;
    use super::super::testdata::{alike, random};
    use super::super::{SparseCode, StopReason, refit};
    use super::*;
    use crate::numeric::parallel;
    use ndarray::{Array1, Array2, Axis, array};

    fn with(sparsity: usize, rule: SelectionRule) -> Omp {
        Omp {
            sparsity,
            rule,
            tolerance: Tolerance::Never,
        }
    }

    const RULES: [SelectionRule; 2] = [SelectionRule::Oomp, SelectionRule::Omp];

    /// The squared weighted residual of a code, from scratch.
    fn left(d: &Dictionary, code: &SparseCode, y: &Array1<f64>, w: &Array1<f64>) -> f64 {
        let r = y - &code.decode(d);
        (&r * &r * w).sum()
    }

    #[test]
    fn a_planted_code_is_found() {
        let d = Dictionary::from_rows(random(60, 200, 1).view()).unwrap();
        let mut g = parallel::rng(2, 0);
        for rule in RULES {
            let mut planted = rand::seq::index::sample(&mut g, 60, 5).into_vec();
            let x: Vec<f64> = (0..5)
                .map(|i| (i as f64 + 2.0) * if i % 2 == 0 { 1.0 } else { -1.0 })
                .collect();
            let code = SparseCode {
                atoms: planted.iter().map(|&a| a as u32).collect(),
                coefficients: x.clone(),
                squared_residual: 0.0,
                stop: StopReason::Tolerance,
            };
            let y = code.decode(&d);
            let found = encode_one(&with(9, rule), &d, y.view(), None).unwrap();
            assert_eq!(found.stop, StopReason::Tolerance, "{found:?}");
            let mut atoms: Vec<usize> = found.atoms.iter().map(|&a| a as usize).collect();
            for (a, c) in found.atoms.iter().zip(&found.coefficients) {
                let i = planted.iter().position(|p| p == &(*a as usize)).unwrap();
                assert!((c - x[i]).abs() <= 1e-5);
            }
            atoms.sort();
            planted.sort();
            assert_eq!(atoms, planted);
        }
    }

    #[test]
    fn the_residual_is_orthogonal_to_the_chosen_atoms_and_falls_with_each() {
        let d = alike(80, 20, 3);
        let y = random(1, 20, 4).row(0).to_owned();
        let w = random(1, 20, 5)
            .row(0)
            .mapv(|v| if v < -0.2 { 0.0 } else { v + 1.0 });
        for rule in RULES {
            let mut before = (&y * &y * &w).sum();
            for k in 1..=14 {
                let code = encode_one(&with(k, rule), &d, y.view(), Some(w.view())).unwrap();
                let now = left(&d, &code, &y, &w);
                assert!(
                    (now - code.squared_residual).abs() <= 1e-9 * before,
                    "{now} {code:?}"
                );
                assert!(now <= before * (1.0 + 1e-12));
                let r = (&y - &code.decode(&d)) * &w;
                for &a in &code.atoms {
                    let c = d.atom(a as usize).mapv(f64::from).dot(&r);
                    assert!(c.abs() <= 1e-9, "{c}");
                }
                before = now;
            }
        }
    }

    #[test]
    fn the_optimized_rule_takes_the_atom_after_which_least_is_left() {
        for seed in 0..20 {
            let d = alike(40, 12, seed);
            let y = random(1, 12, seed + 50).row(0).to_owned();
            let w = random(1, 12, seed + 60)
                .row(0)
                .mapv(|v| if v < -0.3 { 0.0 } else { v + 1.0 });
            // By dense scans, and by the Gram matrix.
            for w in [Some(w.view()), None] {
                let code = encode_one(&with(4, SelectionRule::Oomp), &d, y.view(), w).unwrap();
                for step in 0..4 {
                    let left = |support: &[u32]| refit(&d, support, y.view(), w).unwrap();
                    let tried = (0..40u32).map(|a| left(&[&code.atoms[..step], &[a]].concat()));
                    let best = tried.map(|c| c.squared_residual).fold(f64::MAX, f64::min);
                    let taken = left(&code.atoms[..=step]).squared_residual;
                    assert!(taken <= best * (1.0 + 1e-4), "{step}");
                }
            }
        }
    }

    #[test]
    fn the_plain_rule_takes_the_most_correlated_atom() {
        let d = alike(40, 12, 7);
        let y = random(1, 12, 8).row(0).to_owned();
        let code = encode_one(&with(4, SelectionRule::Omp), &d, y.view(), None).unwrap();
        for step in 0..4 {
            let before = refit(&d, &code.atoms[..step], y.view(), None).unwrap();
            let r = &y - &before.decode(&d);
            let c = d.atoms().mapv(f64::from).dot(&r).mapv(f64::abs);
            let most = c.iter().fold(0.0, |a: f64, &b| a.max(b));
            assert!(c[code.atoms[step] as usize] >= most * (1.0 - 1e-5));
        }
    }

    #[test]
    fn a_mask_is_the_same_as_deleting_the_columns() {
        let rows = random(50, 15, 9) + 0.4;
        let d = Dictionary::from_rows(rows.view()).unwrap();
        let mut y = random(1, 15, 10).row(0).to_owned();
        let seen: Vec<usize> = (0..15).filter(|i| i % 3 != 1).collect();
        let w = Array1::from_shape_fn(15, |i| if i % 3 != 1 { 2.5 } else { 0.0 });
        let cut_rows = d.atoms().select(Axis(1), &seen);
        let cut = Dictionary::from_rows(cut_rows.view()).unwrap();
        let cut_y = y.select(Axis(0), &seen);
        y.iter_mut()
            .enumerate()
            .filter(|(i, _)| i % 3 == 1)
            .for_each(|(_, v)| *v = f64::NAN);
        for rule in RULES {
            let whole = encode_one(&with(4, rule), &d, y.view(), Some(w.view())).unwrap();
            let part = encode_one(&with(4, rule), &cut, cut_y.view(), None).unwrap();
            assert_eq!(whole.atoms, part.atoms);
            assert!((whole.squared_residual - 2.5 * part.squared_residual).abs() <= 1e-7);
            for (i, &a) in part.atoms.iter().enumerate() {
                let norm = cut_rows
                    .row(a as usize)
                    .mapv(|v| f64::from(v).powi(2))
                    .sum()
                    .sqrt();
                assert!((whole.coefficients[i] * norm - part.coefficients[i]).abs() <= 1e-5);
            }
        }
    }

    #[test]
    fn a_tolerance_ends_the_code_when_it_is_met_and_not_before() {
        let d = alike(300, 12, 11);
        let y = random(1, 12, 12).row(0).to_owned();
        for rule in RULES {
            let full = encode_one(&with(8, rule), &d, y.view(), None).unwrap();
            for k in 0..8 {
                let at = |k: usize| {
                    refit(&d, &full.atoms[..k], y.view(), None)
                        .unwrap()
                        .squared_residual
                };
                let length = at(k).sqrt() * (1.0 + 1e-9);
                let rms = length / 12f64.sqrt();
                for tolerance in [Tolerance::Norm(length), Tolerance::Rms(rms)] {
                    let omp = Omp {
                        sparsity: 8,
                        rule,
                        tolerance,
                    };
                    let code = encode_one(&omp, &d, y.view(), None).unwrap();
                    assert_eq!((code.atoms.len(), code.stop), (k, StopReason::Tolerance));
                }
            }
        }
    }

    #[test]
    fn identical_atoms_are_taken_once() {
        let one = Dictionary::from_rows(Array2::<f64>::ones((30, 6)).view()).unwrap();
        let y = random(1, 6, 13).row(0).to_owned();
        // Different atoms that look alike where the pose is seen.
        let mut rows = random(30, 6, 14);
        rows.outer_iter_mut()
            .for_each(|mut r| (0..3).for_each(|i| r[i] = i as f64 + 1.0));
        let half = Dictionary::from_rows(rows.view()).unwrap();
        let w = array![1.0, 1.0, 1.0, 0.0, 0.0, 0.0];
        for rule in RULES {
            for (d, w) in [(&one, None), (&half, Some(w.view()))] {
                let code = encode_one(&with(5, rule), d, y.view(), w).unwrap();
                assert_eq!((code.atoms.len(), code.stop), (1, StopReason::Dependent));
                assert!(code.coefficients[0].is_finite());
            }
        }
    }

    #[test]
    fn nothing_seen_and_nothing_there_give_empty_codes() {
        let d = alike(10, 6, 15);
        let y = random(1, 6, 16).row(0).to_owned();
        let zero = Array1::zeros(6);
        for (y, w) in [(&y, Some(zero.view())), (&zero, None)] {
            for rule in RULES {
                let code = encode_one(&with(3, rule), &d, y.view(), w).unwrap();
                assert_eq!(
                    (code.atoms.len(), code.stop, code.squared_residual),
                    (0, StopReason::Nothing, 0.0)
                );
                assert_eq!(code.decode(&d), zero);
            }
            assert_eq!(
                refit(&d, &[1, 2], y.view(), w).unwrap().stop,
                StopReason::Nothing
            );
        }
    }

    #[test]
    fn more_atoms_than_numbers_and_more_than_there_are() {
        let wide = alike(50, 4, 17);
        let few = alike(3, 9, 18);
        let single = alike(1, 9, 19);
        for rule in RULES {
            let code = encode_one(&with(64, rule), &wide, random(1, 4, 20).row(0), None).unwrap();
            assert!(code.atoms.len() <= 4 && code.squared_residual <= 1e-10);
            let code = encode_one(&with(64, rule), &few, random(1, 9, 21).row(0), None).unwrap();
            assert_eq!((code.atoms.len(), code.stop), (3, StopReason::Dependent));
            let code = encode_one(&with(1, rule), &single, random(1, 9, 21).row(0), None).unwrap();
            assert_eq!((code.atoms.len(), code.stop), (1, StopReason::Sparsity));
        }
        let big = Dictionary::from_rows(random(300, 100, 22).view()).unwrap();
        for rule in RULES {
            let y = random(1, 100, 23).row(0).to_owned();
            let code = encode_one(&with(64, rule), &big, y.view(), None).unwrap();
            assert_eq!(code.atoms.len(), 64);
            let now = left(&big, &code, &y, &Array1::ones(100));
            assert!((now - code.squared_residual).abs() <= 1e-9);
        }
    }

    #[test]
    fn scale_and_precision_of_the_weights_do_not_matter() {
        let d = alike(40, 12, 24);
        let y = random(1, 12, 25).row(0).to_owned();
        let w = random(1, 12, 26).row(0).mapv(|v| v + 0.6);
        let p = with(4, SelectionRule::Oomp);
        let a = encode_one(&p, &d, y.view(), Some(w.view())).unwrap();
        for scale in [1e-12, 1e12] {
            let b = encode_one(&p, &d, (&y * scale).view(), Some((&w * scale).view())).unwrap();
            assert_eq!(a.atoms, b.atoms);
            let ratio = b.squared_residual / (a.squared_residual * scale.powi(3));
            assert!((ratio - 1.0).abs() <= 1e-6);
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        let d = alike(10, 3, 29);
        let p = Omp::default();
        for bad in [f64::NAN, f64::INFINITY, 1e200] {
            assert!(encode_one(&p, &d, array![1.0, bad, 0.0].view(), None).is_err());
        }
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            let w = array![1.0, bad, 0.0];
            assert!(encode_one(&p, &d, array![1.0, 1.0, 0.0].view(), Some(w.view())).is_err());
        }
        assert!(encode_one(&p, &d, array![1.0, 1.0].view(), None).is_err());
        assert!(
            encode_one(
                &p,
                &d,
                array![1.0, 1.0, 1.0].view(),
                Some(array![1.0].view())
            )
            .is_err()
        );
        assert!(with(0, SelectionRule::Omp).check().is_err());
        for t in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(
                Omp {
                    tolerance: Tolerance::Rms(t),
                    ..p
                }
                .check()
                .is_err()
            );
        }
    }
}
