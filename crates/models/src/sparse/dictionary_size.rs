//! The number of atoms that a target error needs (section 4.1 of Lai et al.).
//!
//! Draw n0 random poses as atoms. If their coding error e_s is at most delta e_t, with e_t the
//! wanted error, K-SVD may be trusted to bring it down from there: take them as the start. Else n0
//! <- 1.5 n0, and again.
//!
//! Then train with [`super::Ksvd::target`] set to e_t; [`super::Ksvd::reached`] says whether it
//! came to that. The error is the RMS a coordinate, in the poses' unit. The draws of one seed are
//! nested, and those of [`super::initialize::random_atoms`]: each begins with the atoms of the one
//! before. Cost: O(m n D kappa) for n atoms at the end, some three times one coding.

use super::initialize::{atoms_of, distinct};
use super::{Dictionary, Encoder, Omp};
use crate::{Error, Place, Result};
use ndarray::ArrayView2;
use serde::{Deserialize, Serialize};

/// The parameters of the growth search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GrowthSearch {
    /// e_t, the wanted RMS a coordinate in the poses' unit: above 0. Default 1.
    pub error: f64,
    /// delta: the allowed ratio of the error of untrained atoms to the target. At least 1; default
    /// 2, as in Lai et al.
    pub delta: f64,
    /// What n0 grows by, rounded up: above 1. Default 1.5, Lai et al.'s.
    pub growth: f64,
    /// The first n0: at least 1. Default 100.
    pub first: usize,
    /// The seed that draws the atoms. Default 0.
    pub seed: u64,
    /// The parameters of coding.
    pub omp: Omp,
}

impl Default for GrowthSearch {
    fn default() -> Self {
        let omp = Omp::default();
        GrowthSearch {
            error: 1.0,
            delta: 2.0,
            growth: 1.5,
            first: 100,
            seed: 0,
            omp,
        }
    }
}

/// One dictionary size that was tested.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// n0.
    pub atoms: usize,
    /// e_s, the RMS a coordinate of the poses coded with that many random poses.
    pub rms: f64,
}

/// The result of the search: a dictionary to start K-SVD from.
#[derive(Debug, Clone, PartialEq)]
pub struct GrowthResult {
    /// The random poses that were good enough, or all that differ if fewer were not.
    pub dictionary: Dictionary,
    /// The sizes tried, the last of which is the dictionary's.
    pub tried: Vec<Trial>,
    /// Whether e_s is at most delta e_t. If not, all poses are atoms already, and more of them
    /// would be needed.
    pub enough: bool,
}

impl GrowthSearch {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`Error::Usage`] if a parameter is out of its range.
    pub(crate) fn check(&self) -> Result<()> {
        self.omp.check()?;
        let least = |what, value: f64, least: f64, open: bool| {
            let good = value.is_finite() && (value > least || (value == least && !open));
            let than = if open { "above" } else { "at least" };
            let said = || Error::usage(format!("{what} of {value}: it must be {than} {least}"));
            if good { Ok(()) } else { Err(said()) }
        };
        least("an error", self.error, 0.0, true)?;
        least("a delta", self.delta, 1.0, false)?;
        least("a growth", self.growth, 1.0, true)?;
        least("a first size", self.first as f64, 1.0, false)
    }

    /// Finds the size for the training poses (m, D). `observer` sees each size tried.
    ///
    /// # Errors
    /// A parameter out of range, a pose that is not finite (the row is named, from 1), or no pose
    /// that is not zero.
    pub fn start(
        &self,
        poses: ArrayView2<f32>,
        observer: &mut dyn FnMut(&Trial),
    ) -> Result<GrowthResult> {
        self.check()?;
        let rows = distinct(poses, usize::MAX, self.seed);
        if rows.is_empty() {
            let what = "all training poses are zero";
            return Err(Error::data(Place::file("training poses"), what));
        }
        let mut tried = Vec::new();
        let mut n = self.first.min(rows.len());
        loop {
            let dictionary = atoms_of(poses, &rows[..n])?;
            let codes = Encoder::new(&dictionary, self.omp)?.encode(poses)?;
            let rms = codes.mean_squared_error(poses.ncols()).sqrt();
            tried.push(Trial { atoms: n, rms });
            observer(&Trial { atoms: n, rms });
            let enough = rms <= self.delta * self.error;
            if enough || n == rows.len() {
                return Ok(GrowthResult {
                    dictionary,
                    tried,
                    enough,
                });
            }
            // A float beyond usize becomes its maximum; a growth just above 1 still adds an atom.
            n = ((n as f64 * self.growth).ceil() as usize)
                .max(n + 1)
                .min(rows.len());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Ksvd, random_atoms};
    use super::*;
    use crate::numeric::parallel;
    use ndarray::Array2;
    use rand::Rng;

    fn poses(m: usize) -> Array2<f32> {
        let mut g = parallel::rng(3, 0);
        Array2::from_shape_fn((m, 9), |_| g.random::<f32>() - 0.5)
    }

    fn search(error: f64, first: usize) -> GrowthSearch {
        GrowthSearch {
            error,
            first,
            seed: 2,
            ..GrowthSearch::default()
        }
    }

    #[test]
    fn the_size_grows_by_half_until_the_error_is_near_enough() {
        let y = poses(800);
        let mut seen = Vec::new();
        let start = search(0.06, 10)
            .start(y.view(), &mut |t| seen.push(*t))
            .unwrap();
        assert!(start.enough && seen == start.tried);
        let (last, before) = start.tried.split_last().unwrap();
        assert!(last.rms <= 0.12 && before.iter().all(|t| t.rms > 0.12));
        let sizes: Vec<usize> = start.tried.iter().map(|t| t.atoms).collect();
        assert!([10, 15, 23, 35, 53, 80].starts_with(&sizes), "{sizes:?}");
        assert!(sizes.len() > 2);
        assert_eq!(
            start.dictionary,
            random_atoms(y.view(), last.atoms, 2).unwrap()
        );
        let k = Ksvd {
            target: Some(0.06),
            iterations: 100,
            ..Ksvd::default()
        };
        let state = k
            .train_from(start.dictionary, y.view(), None, &mut |_| Ok(()))
            .unwrap();
        assert_eq!(
            k.reached(&state),
            state.history.last().unwrap().fresh_rms <= 0.06
        );
    }

    #[test]
    fn a_loose_error_takes_the_first_size_and_a_tight_one_all_poses() {
        let y = poses(120);
        let loose = search(10.0, 7).start(y.view(), &mut |_| {}).unwrap();
        assert_eq!(
            (loose.dictionary.len(), loose.tried.len(), loose.enough),
            (7, 1, true)
        );
        let tight = search(1e-12, 1).start(y.view(), &mut |_| {}).unwrap();
        assert_eq!(tight.dictionary.len(), 120);
        let more = search(10.0, 1000).start(y.view(), &mut |_| {}).unwrap();
        assert_eq!(more.dictionary.len(), 120);
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(search(bad, 1).check().is_err());
            assert!(
                GrowthSearch {
                    growth: bad,
                    ..GrowthSearch::default()
                }
                .check()
                .is_err()
            );
            assert!(
                GrowthSearch {
                    delta: bad,
                    ..GrowthSearch::default()
                }
                .check()
                .is_err()
            );
        }
        assert!(
            GrowthSearch {
                growth: 1.0,
                ..GrowthSearch::default()
            }
            .check()
            .is_err()
        );
        assert!(search(1.0, 0).check().is_err());
        assert!(
            search(1.0, 5)
                .start(Array2::zeros((9, 4)).view(), &mut |_| {})
                .is_err()
        );
        assert!(
            search(1.0, 5)
                .start(Array2::zeros((0, 4)).view(), &mut |_| {})
                .is_err()
        );
        let mut y = poses(30);
        y[[4, 4]] = f32::NAN;
        assert!(search(1e-9, 5).start(y.view(), &mut |_| {}).is_err());
    }
}
