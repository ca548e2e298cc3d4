//! A dictionary reweighted for poses that share their weights.
//!
//! With weights w, coding y over atoms a is coding √w∘y over √w∘a: an unweighted problem on the
//! coordinates with a weight. If many poses share their weights (a take with the same joints
//! missing, a dragged joint), the atoms are converted once, and the fast searches for unweighted
//! poses apply.

use super::code::refit;
use super::index::UNSEEN;
use super::{Dictionary, Encoder, Omp, SparseCode, StopReason, Tolerance};
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2, ArrayView1};

/// A dictionary with the atoms √w∘a.
pub(crate) struct WeightedDictionary {
    /// n and D of the dictionary.
    of: (usize, usize),
    /// (D), not negative.
    weights: Array1<f64>,
    /// The coordinates with a weight, and √(w / max w).
    seen: Vec<(usize, f64)>,
    /// √w∘a on those coordinates, of unit norm; `None` if all are zero.
    atoms: Option<Dictionary>,
    /// The indices of those atoms in the dictionary; `None` if all atoms are there.
    names: Option<Vec<u32>>,
}

impl WeightedDictionary {
    /// Reweights a dictionary by weights (D).
    ///
    /// # Errors
    /// [`Error::Data`] if there are not D weights, or one is negative or not finite.
    pub(crate) fn new(
        dictionary: &Dictionary,
        weights: ArrayView1<'_, f64>,
    ) -> Result<WeightedDictionary> {
        let d = dictionary.width();
        if weights.len() != d {
            let said = format!(
                "{} coordinates, but the dictionary's atoms have {d}",
                weights.len()
            );
            return Err(Error::data(Place::file("weights"), said));
        }
        if let Some(bad) = weights.iter().position(|w| !(*w >= 0.0 && w.is_finite())) {
            let said = format!(
                "number {bad} is {}: it must be finite and not negative",
                weights[bad]
            );
            return Err(Error::data(Place::file("weights"), said));
        }
        let heaviest = weights.iter().fold(0.0f64, |a, b| a.max(*b));
        let seen: Vec<(usize, f64)> = (weights.iter().enumerate())
            .filter(|(_, w)| **w > 0.0)
            .map(|(i, w)| (i, (w / heaviest).sqrt()))
            .collect();
        let (atoms, names) = through(dictionary, &seen);
        Ok(WeightedDictionary {
            of: (dictionary.len(), d),
            weights: weights.to_owned(),
            seen,
            atoms,
            names,
        })
    }

    /// Codes a pose (D) with `dictionary`, from which this was made, as [`Encoder::encode_one`]
    /// does with these weights. Ties within rounding may be resolved otherwise: as good on the
    /// observed coordinates, but the others can differ.
    ///
    /// # Errors
    /// [`Error::Data`] as [`Encoder::encode_one`]; also if the dictionary has another size than the
    /// one this was made from.
    pub(crate) fn code(
        &self,
        omp: &Omp,
        dictionary: &Dictionary,
        pose: ArrayView1<'_, f64>,
    ) -> Result<SparseCode> {
        if (dictionary.len(), dictionary.width()) != self.of {
            let said = "it is not the one that was seen through these weights";
            return Err(Error::data(Place::file("dictionary"), said));
        }
        let weights = Some(self.weights.view());
        let Some(atoms) = self
            .atoms
            .as_ref()
            .filter(|_| pose.len() == self.weights.len())
        else {
            return Encoder::new(dictionary, *omp)?.encode_one(pose, weights);
        };
        let scaled = Omp {
            tolerance: self.tolerance(omp),
            ..*omp
        };
        let signal: Array1<f64> = self.seen.iter().map(|(i, root)| pose[*i] * root).collect();
        if signal.iter().any(|v| !v.is_finite()) {
            // This call reports the error.
            return Encoder::new(dictionary, *omp)?.encode_one(pose, weights);
        }
        let found = Encoder::new(atoms, scaled)?.encode_one(signal.view(), None)?;
        let name = |a: &u32| self.names.as_ref().map_or(*a, |names| names[*a as usize]);
        let support: Vec<u32> = found.atoms.iter().map(name).collect();
        // Refit with the dictionary's own atoms: the reweighted ones are rounded.
        let mut code = refit(dictionary, &support, pose, weights)?;
        if code.stop != StopReason::Dependent {
            code.stop = found.stop;
        }
        Ok(code)
    }

    /// The tolerance for weights divided by the largest.
    fn tolerance(&self, omp: &Omp) -> Tolerance {
        let heaviest = self.weights.iter().fold(0.0f64, |a, b| a.max(*b));
        match omp.tolerance {
            Tolerance::Never => Tolerance::Never,
            Tolerance::Norm(t) => Tolerance::Norm(t / heaviest.sqrt()),
            Tolerance::Rms(t) => Tolerance::Norm(t * (self.weights.sum() / heaviest).sqrt()),
        }
    }
}

/// The reweighted atoms, and their indices if some are left out.
fn through(
    dictionary: &Dictionary,
    seen: &[(usize, f64)],
) -> (Option<Dictionary>, Option<Vec<u32>>) {
    // On this thread alone: callers are many threads at work on poses of their own.
    let n = dictionary.len();
    let (mut numbers, mut names) = (Vec::with_capacity(n * seen.len()), Vec::with_capacity(n));
    let mut atom = vec![0.0; seen.len()];
    for i in 0..n as u32 {
        let whole = dictionary.row(i);
        for (a, (c, root)) in atom.iter_mut().zip(seen) {
            *a = f64::from(whole[*c]) * root;
        }
        let squared: f64 = atom.iter().map(|a| a * a).sum();
        // An atom that is nearly zero here is never selected.
        if squared > f64::from(UNSEEN) {
            let scale = 1.0 / squared.sqrt();
            numbers.extend(atom.iter().map(|a| (a * scale) as f32));
            names.push(i);
        }
    }
    let atoms = Array2::from_shape_vec((names.len(), seen.len()), numbers).ok();
    let atoms = atoms.filter(|a| !a.is_empty()).map(Dictionary::of);
    let all = names.len() == dictionary.len();
    (atoms, (!all).then_some(names))
}

#[cfg(test)]
mod tests {
    use super::super::SelectionRule;
    use super::super::testdata::encode_one;
    use super::super::testdata::{alike, random};
    use super::*;

    fn pursuits() -> impl Iterator<Item = Omp> {
        let rules = [SelectionRule::Oomp, SelectionRule::Omp].into_iter();
        rules.flat_map(|rule| {
            [Tolerance::Never, Tolerance::Rms(0.05), Tolerance::Norm(0.2)].map(|tolerance| Omp {
                sparsity: 4,
                rule,
                tolerance,
            })
        })
    }

    #[test]
    fn poses_get_the_codes_that_weights_give() {
        for n in [60, 2100] {
            let d = alike(n, 21, 1);
            let poses = random(30, 21, 2);
            let weights = random(1, 21, 3)
                .row(0)
                .mapv(|w| if w < -0.1 { 0.0 } else { 5.0 * w + 2.0 });
            let seen = WeightedDictionary::new(&d, weights.view()).unwrap();
            for pursuit in pursuits() {
                for pose in poses.outer_iter() {
                    let pose = ndarray::Zip::from(&pose)
                        .and(&weights)
                        .map_collect(|y, w| if *w > 0.0 { *y } else { f64::NAN });
                    let a = seen.code(&pursuit, &d, pose.view()).unwrap();
                    let b = encode_one(&pursuit, &d, pose.view(), Some(weights.view())).unwrap();
                    assert_eq!((&a.atoms, a.stop), (&b.atoms, b.stop), "{pursuit:?}");
                    assert_eq!(a.coefficients, b.coefficients);
                    assert_eq!(a.squared_residual, b.squared_residual);
                }
            }
        }
    }

    #[test]
    fn atoms_that_are_nothing_where_there_are_weights_keep_the_names_of_the_others() {
        let mut rows = random(40, 9, 4);
        rows.slice_mut(ndarray::s![..;3, ..3]).fill(0.0);
        let d = Dictionary::from_rows(rows.view()).unwrap();
        let weights = Array1::from_shape_fn(9, |i| if i < 3 { 1.5 } else { 0.0 });
        let seen = WeightedDictionary::new(&d, weights.view()).unwrap();
        for pose in random(20, 9, 5).outer_iter() {
            // Of the third and last all atoms left would do.
            for pursuit in pursuits().map(|p| Omp { sparsity: 2, ..p }) {
                let a = seen.code(&pursuit, &d, pose).unwrap();
                assert_eq!(
                    a,
                    encode_one(&pursuit, &d, pose, Some(weights.view())).unwrap()
                );
                assert!(a.atoms.iter().all(|a| a % 3 != 0));
            }
        }
    }

    #[test]
    fn an_atom_that_is_next_to_nothing_where_there_are_weights_is_not_seen() {
        let d = Dictionary::from_rows(ndarray::array![[1e-12, 1.0, 0.0]].view()).unwrap();
        let weights = ndarray::array![1.0, 0.0, 0.0];
        let pose = ndarray::array![5.0, 1.0, 1.0];
        let seen = WeightedDictionary::new(&d, weights.view()).unwrap();
        let code = seen.code(&Omp::default(), &d, pose.view()).unwrap();
        assert!(code.atoms.is_empty());
        assert_eq!(
            code,
            encode_one(&Omp::default(), &d, pose.view(), Some(weights.view())).unwrap()
        );
        let other = alike(20, 3, 8);
        assert!(seen.code(&Omp::default(), &other, pose.view()).is_err());
    }

    #[test]
    fn where_nothing_is_seen_the_code_is_empty() {
        let d = alike(20, 6, 6);
        let mut rows = d.atoms().to_owned();
        rows.column_mut(2).fill(0.0);
        let flat = Dictionary::from_rows(rows.view()).unwrap();
        let pose = Array1::ones(6);
        for (d, seen) in [(&d, None), (&flat, Some(2))] {
            let weights = Array1::from_shape_fn(6, |i| if Some(i) == seen { 1.0 } else { 0.0 });
            let through = WeightedDictionary::new(d, weights.view()).unwrap();
            let code = through.code(&Omp::default(), d, pose.view()).unwrap();
            assert_eq!(
                code,
                encode_one(&Omp::default(), d, pose.view(), Some(weights.view())).unwrap()
            );
            assert!(code.atoms.is_empty());
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused_as_without() {
        let d = alike(20, 6, 7);
        for bad in [vec![1.0; 5], vec![-1.0; 6], vec![f64::NAN; 6]] {
            assert!(WeightedDictionary::new(&d, Array1::from(bad).view()).is_err());
        }
        let seen = WeightedDictionary::new(&d, Array1::ones(6).view()).unwrap();
        let pursuit = Omp::default();
        for bad in [vec![1.0; 5], vec![f64::NAN; 6], vec![1e300; 6]] {
            let (bad, ones) = (Array1::from(bad), Array1::ones(6));
            let said = seen.code(&pursuit, &d, bad.view()).unwrap_err();
            let other = encode_one(&pursuit, &d, bad.view(), Some(ones.view())).unwrap_err();
            assert_eq!(said.to_string(), other.to_string());
        }
    }
}
