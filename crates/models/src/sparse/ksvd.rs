//! K-SVD: a dictionary learned from poses (Aharon, Elad, Bruckstein 2006).
//!
//! ```text
//! min_{A, X} |Y - A X|_F^2   with |x_i|_0 <= kappa for each pose i, |a_j|_2 = 1 for each atom j
//!     (3)
//! ```
//!
//! Y = posesᵀ (D x m), A = atomsᵀ (D x n), X the codes (n x m); here poses, atoms and codes are
//! rows. An iteration
//!
//! 1. updates the atoms one after the other: with the poses that use atom j, and E the residual of
//!    those poses without it, the best rank-one approximation of E gives the atom and its
//!    coefficients at once;
//! 2. gives each atom that no pose uses (and, if wanted, each that is too close to a better used
//!    one) the place of a pose that is coded worst;
//! 3. codes all poses anew. With [`Ksvd::keep`], where the greedy code is worse than the old atoms
//!    refitted, the old ones stay.
//!
//! The poses are coded before the first iteration, so that `i` iterations are `i` updates, and the
//! error of every [`IterationStats`] is that of the dictionary in the same [`TrainingState`]. The
//! update cannot raise the training error, and replacing an unused atom is free; the greedy coding
//! can. With `keep` it cannot either, so that the error falls (but for rounding, and unless close
//! atoms are replaced).
//!
//! Cost of an iteration: O(m n D kappa) for the coding, O(m D kappa s) for the update with s power
//! steps in all. Memory: the poses again (the residual) and the codes. The result does not depend
//! on the number of threads, and nothing is random but the start. It fails where poses are missing
//! numbers: learning needs whole poses.

use super::atom_replacement::replace;
use super::atom_update::{AtomUsage, residuals, update};
use super::checkpoint::{IterationStats, TrainingState};
use super::codes::{SparseCodes, UNUSED};
use super::initialize::random_atoms;
use super::omp::Omp;
use super::support_reuse::keep_better;
use super::{Dictionary, Encoder, SelectionRule, Tolerance};
use crate::{Error, Place, Result};
use ndarray::ArrayView2;
use serde::{Deserialize, Serialize};

/// The parameters of K-SVD.
///
/// Measured on a random half of the frames of CMU's subject 01 (1,000 atoms, 3 per pose, ten
/// iterations), mean squared error of fresh coding in raw ASF units, training and unseen: 0.043 and
/// 0.050 as it is by default; 0.034 and 0.039 with a `coherence` of 0.99; 0.049 and 0.055 with
/// `keep`; 0.044 and 0.051 with one sweep; 0.071 and 0.083 with the plain pursuit.
///
/// ```
/// use ndarray::Array2;
/// use posing_models::sparse::{Encoder, Ksvd};
///
/// // 200 poses (m, D) on two lines
/// let value = |(i, j)| if i % 2 == j % 2 { 1.0 + i as f32 } else { 0.0 };
/// let poses = Array2::from_shape_fn((200, 4), value);
/// let ksvd = Ksvd { atoms: 2, sparsity: 1, ..Ksvd::default() };
/// let dictionary = ksvd.train(poses.view())?;
/// let codes = Encoder::new(&dictionary, ksvd.omp())?.encode(poses.view())?;
/// assert!(codes.mean_squared_error(4) < 1e-6);
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ksvd {
    /// The number of atoms. At least 1; default 1000.
    pub atoms: usize,
    /// The seed that draws the initial atoms from the training poses. Default 0.
    pub seed: u64,
    /// The number of iterations; 0 returns the initial atoms. Default 30.
    pub iterations: usize,
    /// The largest number of atoms in a code, kappa. At least 1; default 3.
    pub sparsity: usize,
    /// How matching pursuit selects atoms. Default: OOMP.
    pub rule: SelectionRule,
    /// Replaces an atom whose |<a, b>| with a more used atom exceeds this limit, in (0, 1].
    /// Default: no limit.
    pub coherence: Option<f64>,
    /// The number of updates of all atoms per iteration; at least 1, default 4. An update costs
    /// little beside the coding.
    pub sweeps: usize,
    /// Keeps the old support of a pose, refitted, where the greedy code is worse. The training
    /// error then never rises, but the dictionary adapts to codes that fresh coding does not
    /// find. Default: off.
    pub keep: bool,
    /// Stops when the RMS per coordinate of a fresh coding of the training poses is at most this.
    /// Default: never.
    pub target: Option<f64>,
}

impl Default for Ksvd {
    fn default() -> Self {
        Ksvd {
            atoms: 1000,
            seed: 0,
            iterations: 30,
            sparsity: 3,
            rule: SelectionRule::Oomp,
            coherence: None,
            sweeps: 4,
            keep: false,
            target: None,
        }
    }
}

impl Ksvd {
    /// Checks the parameters, before any work.
    ///
    /// # Errors
    /// [`Error::Usage`] if a parameter is out of its range: the message has the range.
    pub fn check(&self) -> Result<()> {
        self.omp().check()?;
        if self.atoms == 0 {
            return Err(Error::usage("0 atoms: at least 1 is needed"));
        }
        if self.sweeps == 0 {
            return Err(Error::usage("0 sweeps an iteration: at least 1 is needed"));
        }
        if let Some(c) = self.coherence.filter(|&c| !(c > 0.0 && c <= 1.0)) {
            return Err(Error::usage(format!(
                "a coherence of {c}: it must be above 0 and at most 1"
            )));
        }
        if let Some(t) = self.target.filter(|&t| !(t >= 0.0 && t.is_finite())) {
            return Err(Error::usage(format!(
                "a target of {t}: it must be a number not below 0"
            )));
        }
        Ok(())
    }

    /// Codes the poses (m, D) with the dictionary to start from: the state after 0 iterations.
    ///
    /// # Errors
    /// A parameter out of range, no poses, another width, or a pose that is not finite (the row is
    /// named, from 1).
    pub fn start(
        &self,
        dictionary: Dictionary,
        poses: ArrayView2<f32>,
        validation: Option<ArrayView2<f32>>,
    ) -> Result<TrainingState> {
        self.check()?;
        if poses.nrows() == 0 {
            return Err(Error::data(Place::file("training poses"), "there are none"));
        }
        let codes = self.encode(&dictionary, poses)?;
        let mut state = TrainingState {
            dictionary,
            support: codes.atoms.clone(),
            coefficients: codes.coefficients.clone(),
            history: Vec::new(),
        };
        let fresh = codes.mean_squared_error(poses.ncols());
        let report = self.report(&state, &codes, fresh, validation, (0, 0))?;
        state.history.push(report);
        Ok(state)
    }

    /// Continues from `state` until all iterations are done or the target is reached.
    ///
    /// `observer` sees the state after each iteration (its last report is the iteration's); it may
    /// save the state, and an error of its ends the run.
    ///
    /// # Errors
    /// As [`Ksvd::start`]; a state that does not belong to these poses; what `observer` answers.
    pub fn run(
        &self,
        state: &mut TrainingState,
        poses: ArrayView2<f32>,
        validation: Option<ArrayView2<f32>>,
        observer: &mut dyn FnMut(&TrainingState) -> Result<()>,
    ) -> Result<()> {
        self.check()?;
        self.belongs(state, poses)?;
        while !self.finished(state) {
            self.step(state, poses, validation)?;
            observer(state)?;
        }
        Ok(())
    }

    /// Learns a dictionary from poses (m, D): draws the initial atoms with [`random_atoms`], then
    /// iterates.
    ///
    /// # Errors
    /// [`Error::Usage`] if a parameter is out of its range, or fewer distinct, nonzero poses than
    /// atoms are given. [`Error::Data`] if a pose is not finite (the row is named, from 1).
    pub fn train(&self, poses: ArrayView2<f32>) -> Result<Dictionary> {
        let state = self.train_with(poses, &mut |_| Ok(()))?;
        Ok(state.dictionary)
    }

    /// [`Ksvd::train`] with an observer of the state after each iteration; the first call is for
    /// the initial atoms. Returns the final state.
    ///
    /// # Errors
    /// As [`Ksvd::train`]; also the errors of `observer`, which end the training.
    pub fn train_with(
        &self,
        poses: ArrayView2<f32>,
        observer: &mut dyn FnMut(&TrainingState) -> Result<()>,
    ) -> Result<TrainingState> {
        self.check()?;
        let atoms = random_atoms(poses, self.atoms, self.seed)?;
        self.train_from(atoms, poses, None, observer)
    }

    /// Learns from a given initial dictionary, whatever [`Ksvd::atoms`] and [`Ksvd::seed`] say.
    /// `validation` (m', D) poses are coded after each iteration, for the statistics only.
    ///
    /// # Errors
    /// As [`Ksvd::start`] and [`Ksvd::run`].
    pub fn train_from(
        &self,
        dictionary: Dictionary,
        poses: ArrayView2<f32>,
        validation: Option<ArrayView2<f32>>,
        observer: &mut dyn FnMut(&TrainingState) -> Result<()>,
    ) -> Result<TrainingState> {
        let mut state = self.start(dictionary, poses, validation)?;
        observer(&state)?;
        self.run(&mut state, poses, validation, observer)?;
        Ok(state)
    }

    /// Whether a target is given and the state reaches it.
    pub fn reached(&self, state: &TrainingState) -> bool {
        match (self.target, state.history.last()) {
            (Some(target), Some(report)) => report.fresh_rms <= target,
            _ => false,
        }
    }

    /// Whether all iterations are done or the target is reached.
    pub(crate) fn finished(&self, state: &TrainingState) -> bool {
        state.iteration() >= self.iterations || self.reached(state)
    }

    /// The parameters of coding.
    pub fn omp(&self) -> Omp {
        Omp {
            sparsity: self.sparsity,
            rule: self.rule,
            tolerance: Tolerance::Never,
        }
    }

    fn encode(&self, dictionary: &Dictionary, poses: ArrayView2<f32>) -> Result<SparseCodes> {
        Encoder::new(dictionary, self.omp())?.encode(poses)
    }

    fn belongs(&self, state: &TrainingState, poses: ArrayView2<f32>) -> Result<()> {
        let (m, d) = poses.dim();
        let n = state.dictionary.len();
        let k = state.dictionary.capacity(self.sparsity);
        let fits = state.support.dim() == (m, k)
            && state.coefficients.dim() == (m, k)
            && state.dictionary.width() == d
            && state
                .support
                .iter()
                .all(|&a| a == UNUSED || (a as usize) < n)
            && state.coefficients.iter().all(|x| x.is_finite());
        if fits {
            return Ok(());
        }
        let what = format!(
            "it does not match {m} poses of {d} coordinates coded with {k} atoms; start again"
        );
        Err(Error::data(Place::file("state of the training"), what))
    }

    /// One iteration.
    fn step(
        &self,
        state: &mut TrainingState,
        poses: ArrayView2<f32>,
        validation: Option<ArrayView2<f32>>,
    ) -> Result<()> {
        let TrainingState {
            dictionary,
            support,
            coefficients,
            ..
        } = &mut *state;
        let mut residual = residuals(dictionary, support, coefficients, poses);
        let uses = AtomUsage::of(support, dictionary.len());
        for _ in 0..self.sweeps {
            update(dictionary, &uses, coefficients, &mut residual);
        }
        let replaced = replace(dictionary, support, &uses, poses, &residual, self.coherence);
        drop(residual);
        let mut codes = self.encode(&state.dictionary, poses)?;
        let fresh = codes.mean_squared_error(poses.ncols());
        if self.keep {
            keep_better(&mut codes, state, poses);
        }
        state.support.assign(&codes.atoms);
        state.coefficients.assign(&codes.coefficients);
        let report = self.report(state, &codes, fresh, validation, replaced)?;
        state.history.push(report);
        Ok(())
    }

    fn report(
        &self,
        state: &TrainingState,
        codes: &SparseCodes,
        fresh_mse: f64,
        validation: Option<ArrayView2<f32>>,
        (unused, coherent): (usize, usize),
    ) -> Result<IterationStats> {
        let d = state.dictionary.width();
        let mse = codes.mean_squared_error(d);
        let validation_rms = match validation {
            Some(poses) => {
                let codes = self.encode(&state.dictionary, poses)?;
                Some(codes.mean_squared_error(d).sqrt())
            }
            None => None,
        };
        Ok(IterationStats {
            iteration: state.history.last().map_or(0, |r| r.iteration + 1),
            mse,
            rms: mse.sqrt(),
            fresh_rms: fresh_mse.sqrt(),
            validation_rms,
            unused,
            coherent,
            mean_sparsity: codes.mean_sparsity(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::random_atoms;
    use super::super::testdata::encode;
    use super::super::testdata::poses;
    use super::*;
    use ndarray::{Array2, s};

    fn quiet() -> impl FnMut(&TrainingState) -> Result<()> {
        |_| Ok(())
    }

    fn trained(k: &Ksvd, y: &Array2<f32>, n: usize) -> TrainingState {
        k.train_from(
            random_atoms(y.view(), n, 1).unwrap(),
            y.view(),
            None,
            &mut quiet(),
        )
        .unwrap()
    }

    #[test]
    fn no_iterations_change_nothing() {
        let y = poses(300, 12, 1);
        let start = random_atoms(y.view(), 30, 1).unwrap();
        let k = Ksvd {
            iterations: 0,
            ..Ksvd::default()
        };
        let state = k
            .train_from(start.clone(), y.view(), None, &mut quiet())
            .unwrap();
        assert_eq!(state.dictionary, start);
        assert_eq!((state.iteration(), state.history.len()), (0, 1));
    }

    #[test]
    fn the_error_falls_well_below_that_of_the_start() {
        let y = poses(3000, 20, 3);
        let unseen = poses(500, 20, 4);
        let k = Ksvd {
            iterations: 15,
            ..Ksvd::default()
        };
        let start = random_atoms(y.view(), 60, 1).unwrap();
        let state = k
            .train_from(start, y.view(), Some(unseen.view()), &mut quiet())
            .unwrap();
        let (first, last) = (&state.history[0], &state.history[15]);
        assert!(last.rms <= 0.5 * first.rms, "{first:?} {last:?}");
        assert!(last.validation_rms <= first.validation_rms.map(|v| 0.6 * v));
        let codes = encode(&k.omp(), &state.dictionary, y.view(), None).unwrap();
        assert_eq!(codes.mean_squared_error(20).sqrt(), last.fresh_rms);
        assert_eq!(last.fresh_rms, last.rms);
        for atom in state.dictionary.atoms().outer_iter() {
            let norm = atom.iter().map(|&a| f64::from(a).powi(2)).sum::<f64>();
            assert!((norm - 1.0).abs() <= 1e-6);
        }
    }

    /// What a checkpoint keeps, through text.
    fn saved(state: &TrainingState) -> TrainingState {
        let history = serde_json::to_string(&state.history).unwrap();
        TrainingState {
            dictionary: Dictionary::from_rows(state.dictionary.atoms()).unwrap(),
            history: serde_json::from_str(&history).unwrap(),
            ..state.clone()
        }
    }

    #[test]
    fn threads_and_interruptions_change_no_bit() {
        let y = poses(1300, 12, 5);
        for (keep, coherence) in [(false, None), (true, Some(0.98))] {
            let k = Ksvd {
                iterations: 6,
                keep,
                coherence,
                ..Ksvd::default()
            };
            let whole = trained(&k, &y, 50);
            for threads in [1, 2, 7] {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                assert_eq!(pool.install(|| trained(&k, &y, 50)), whole);
            }
            for stop in 0..6 {
                let part = Ksvd {
                    iterations: stop,
                    ..k.clone()
                };
                let mut state = saved(&trained(&part, &y, 50));
                k.run(&mut state, y.view(), None, &mut quiet()).unwrap();
                assert_eq!(state, whole);
            }
        }
    }

    #[test]
    fn unused_atoms_give_way_to_poses_and_the_count_stays() {
        let y = poses(600, 12, 6);
        // Directions that no pose has: all atoms but two are useless.
        let mut rows = random_atoms(y.view(), 30, 1).unwrap().into_atoms();
        let first = rows.row(0).to_owned();
        rows.slice_mut(s![2.., ..])
            .outer_iter_mut()
            .for_each(|mut r| r.assign(&first));
        let start = Dictionary::from_rows(rows.view()).unwrap();
        let k = Ksvd {
            iterations: 3,
            ..Ksvd::default()
        };
        let state = k.train_from(start, y.view(), None, &mut quiet()).unwrap();
        assert_eq!((state.history[1].unused, state.dictionary.len()), (28, 30));
        assert!(state.history[1].rms <= 0.7 * state.history[0].rms);
        assert!(state.dictionary.copies().is_empty());
    }

    #[test]
    fn close_atoms_give_way_to_poses() {
        let y = poses(900, 12, 7);
        let k = Ksvd {
            iterations: 8,
            coherence: Some(0.97),
            ..Ksvd::default()
        };
        let state = trained(&k, &y, 60);
        assert!(state.history.iter().any(|r| r.coherent > 0));
        assert_eq!(state.dictionary.len(), 60);
    }

    #[test]
    fn the_target_ends_the_run() {
        let y = poses(900, 12, 8);
        let free = trained(
            &Ksvd {
                iterations: 8,
                ..Ksvd::default()
            },
            &y,
            60,
        );
        let target = Some(free.history[4].fresh_rms);
        let k = Ksvd {
            iterations: 8,
            target,
            ..Ksvd::default()
        };
        let state = trained(&k, &y, 60);
        assert!(state.iteration() <= 4 && k.reached(&state));
        let never = Ksvd {
            iterations: 2,
            target: Some(0.0),
            ..Ksvd::default()
        };
        let state = trained(&never, &y, 60);
        assert!(!never.reached(&state) && never.finished(&state));
    }

    #[test]
    fn few_poses_and_poses_that_are_all_the_same() {
        let k = Ksvd {
            iterations: 3,
            ..Ksvd::default()
        };
        for m in [1, 2, 5] {
            let state = trained(&k, &poses(m, 6, 9), m);
            assert!(state.history[3].rms <= 1e-5);
        }
        let same = Array2::from_elem((50, 6), 2f32);
        assert!(random_atoms(same.view(), 2, 0).is_err());
        let state = trained(&k, &same, 1);
        assert!(state.history[3].rms <= 1e-5);
        // More atoms than poses, half of the poses zero.
        let mut y = poses(10, 6, 10);
        y.slice_mut(s![5.., ..]).fill(0.0);
        let many = Dictionary::from_rows(poses(40, 6, 11).view()).unwrap();
        let state = k.train_from(many, y.view(), None, &mut quiet()).unwrap();
        assert!(state.history[3].rms <= state.history[0].rms && state.dictionary.len() == 40);
        assert!(state.dictionary.atoms().iter().all(|a| a.is_finite()));
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        let y = poses(100, 6, 12);
        let start = random_atoms(y.view(), 10, 0).unwrap();
        let k = Ksvd {
            iterations: 2,
            ..Ksvd::default()
        };
        let mut bad = y.clone();
        bad[[17, 3]] = f32::NAN;
        let said = k
            .train_from(start.clone(), bad.view(), None, &mut quiet())
            .unwrap_err();
        assert!(said.to_string().contains(":18"), "{said}");
        assert!(
            k.start(start.clone(), Array2::zeros((0, 6)).view(), None)
                .is_err()
        );
        assert!(k.start(start.clone(), poses(9, 7, 1).view(), None).is_err());
        let mut state = k.start(start.clone(), y.view(), None).unwrap();
        assert!(
            k.run(&mut state, poses(99, 6, 1).view(), None, &mut quiet())
                .is_err()
        );
        state.support[[0, 0]] = 10;
        assert!(k.run(&mut state, y.view(), None, &mut quiet()).is_err());
        let stop = &mut |_: &TrainingState| Err(Error::usage("enough"));
        assert!(k.train_from(start, y.view(), None, stop).is_err());
        for c in [0.0, 1.5, f64::NAN] {
            assert!(
                Ksvd {
                    coherence: Some(c),
                    ..Ksvd::default()
                }
                .check()
                .is_err()
            );
        }
        assert!(
            Ksvd {
                sweeps: 0,
                ..Ksvd::default()
            }
            .check()
            .is_err()
        );
        assert!(
            Ksvd {
                target: Some(f64::NAN),
                ..Ksvd::default()
            }
            .check()
            .is_err()
        );
    }
}
