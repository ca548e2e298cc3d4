//! Keeps the old support of a pose where its new code is worse.

use super::active_set::ActiveSet;
use super::codes::{SparseCodes, UNUSED};
use super::{Tolerance, TrainingState};
use crate::numeric::parallel;
use ndarray::{ArrayView1, ArrayView2};

/// The number of poses per task.
const CHUNK: usize = 512;

/// Replaces each code that is worse than the refitted support of `state`.
pub(crate) fn keep_better(codes: &mut SparseCodes, state: &TrainingState, poses: ArrayView2<f32>) {
    let k = codes.atoms.ncols();
    let kept = parallel::map_chunks(poses.nrows(), CHUNK, |rows| {
        let mut fit = ActiveSet::new(k, poses.ncols());
        let mut x = vec![0.0; k];
        let mut better = Vec::new();
        for i in rows {
            if state.support.row(i) == codes.atoms.row(i) {
                continue;
            }
            let tolerance = Tolerance::Never;
            if fit
                .start(poses.row(i), None::<ArrayView1<f32>>, tolerance)
                .is_err()
            {
                continue;
            }
            for &atom in state.support.row(i).iter().filter(|&&a| a != UNUSED) {
                fit.push(atom, state.dictionary.row(atom));
            }
            if fit.squared_residual() < codes.squared_residuals[i] {
                let mut code = SparseCodes::empty(1, k);
                code.set(0, &fit, &mut x);
                better.push((i, code));
            }
        }
        better
    });
    kept.into_iter()
        .flatten()
        .for_each(|(i, code)| codes.put(&[i as u32], &code));
}

#[cfg(test)]
mod tests {
    use super::super::testdata::poses;
    use super::super::{Ksvd, SelectionRule, random_atoms};

    #[test]
    fn with_old_codes_kept_the_error_never_rises() {
        let y = poses(900, 12, 2);
        for rule in [SelectionRule::Oomp, SelectionRule::Omp] {
            let k = Ksvd {
                iterations: 25,
                keep: true,
                rule,
                ..Ksvd::default()
            };
            let start = random_atoms(y.view(), 60, 1).unwrap();
            let state = k
                .train_from(start, y.view(), None, &mut |_| Ok(()))
                .unwrap();
            for pair in state.history.windows(2) {
                assert!(pair[1].mse <= pair[0].mse * (1.0 + 1e-5), "{pair:?}");
                assert!(pair[1].fresh_rms >= pair[1].rms);
            }
        }
    }
}
