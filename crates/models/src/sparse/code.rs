//! The sparse code of one pose: a few atoms and their least-squares coefficients.

use super::active_set::ActiveSet;
use super::{Dictionary, StopReason, Tolerance};
use crate::{Error, Place, Result};
use ndarray::{Array1, ArrayView1};

/// The code of one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseCode {
    /// The atoms taken, in the order in which they were.
    pub atoms: Vec<u32>,
    /// Their coefficients, in the pose's unit: the weighted least-squares fit on these atoms.
    pub coefficients: Vec<f64>,
    /// sum_i w_i (y_i - (A x)_i)^2.
    pub squared_residual: f64,
    /// Why there are no more atoms.
    pub stop: StopReason,
}

impl SparseCode {
    /// The pose (D) that the code represents, A x, missing coordinates included.
    ///
    /// # Panics
    /// If the code is of another, larger dictionary.
    pub(crate) fn decode(&self, dictionary: &Dictionary) -> Array1<f64> {
        dictionary.combine(&self.atoms, &self.coefficients)
    }
}

/// The best coefficients of given atoms for one pose: weighted least squares, in f64.
///
/// Atoms are taken in the order given. An atom that depends on those before it (a repeated one,
/// say) is left out, and the code's `stop` is [`StopReason::Dependent`], else
/// [`StopReason::Sparsity`]. Pose and weights are as in
/// [`Encoder::encode_one`](super::Encoder::encode_one).
///
/// ```
/// use ndarray::array;
/// use posing_models::sparse::{Dictionary, refit};
///
/// let dictionary = Dictionary::from_rows(array![[1.0, 0.0], [0.0, 1.0]].view())?;
/// let code = refit(&dictionary, &[1], array![3.0, 4.0].view(), None)?;
/// assert_eq!(code.coefficients, [4.0]);
/// assert!((code.squared_residual - 9.0).abs() < 1e-9); // what the other atom would explain
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Data`] as [`Encoder::encode_one`](super::Encoder::encode_one); also if an atom is not
/// below the dictionary's length.
pub fn refit(
    dictionary: &Dictionary,
    support: &[u32],
    pose: ArrayView1<f64>,
    weights: Option<ArrayView1<f64>>,
) -> Result<SparseCode> {
    let capacity = support.len().min(dictionary.len()).min(dictionary.width());
    let mut fit = started(dictionary, capacity, pose, weights, Tolerance::Never)?;
    let n = dictionary.len();
    if let Some(&atom) = support.iter().find(|&&a| a as usize >= n) {
        return Err(Error::data(
            Place::file("code"),
            format!("atom {atom} of a dictionary of {n}"),
        ));
    }
    let empty = fit.stop == Some(StopReason::Nothing);
    let mut stop = if empty {
        StopReason::Nothing
    } else {
        StopReason::Sparsity
    };
    for &atom in support.iter().filter(|_| !empty) {
        if !fit.push(atom, dictionary.row(atom)) {
            stop = StopReason::Dependent;
        }
    }
    fit.stop = Some(stop);
    Ok(finished(&fit))
}

pub(super) fn started(
    dictionary: &Dictionary,
    capacity: usize,
    pose: ArrayView1<f64>,
    weights: Option<ArrayView1<f64>>,
    tolerance: Tolerance,
) -> Result<ActiveSet> {
    let d = dictionary.width();
    for (what, len) in [
        ("pose", Some(pose.len())),
        ("weights", weights.map(|w| w.len())),
    ] {
        if let Some(len) = len.filter(|&len| len != d) {
            let said = format!("{len} coordinates, but the dictionary's atoms have {d}");
            return Err(Error::data(Place::file(what), said));
        }
    }
    let mut fit = ActiveSet::new(capacity, d);
    fit.start(pose, weights, tolerance)
        .map_err(|e| e.at(Place::file("pose")))?;
    Ok(fit)
}

pub(super) fn finished(fit: &ActiveSet) -> SparseCode {
    let mut coefficients = vec![0.0; fit.support.len()];
    fit.coefficients(&mut coefficients);
    SparseCode {
        atoms: fit.support.clone(),
        coefficients,
        squared_residual: fit.squared_residual(),
        stop: fit.stop.unwrap_or(StopReason::Sparsity),
    }
}

#[cfg(test)]
mod tests {
    use super::super::testdata::encode_one;
    use super::super::testdata::{alike, random};
    use super::super::{Omp, SelectionRule};
    use super::*;

    #[test]
    fn refitting_the_atoms_of_a_code_gives_the_code() {
        let d = alike(40, 12, 27);
        let y = random(1, 12, 28).row(0).to_owned();
        let with_five = Omp {
            sparsity: 5,
            rule: SelectionRule::Oomp,
            tolerance: Tolerance::Never,
        };
        let code = encode_one(&with_five, &d, y.view(), None).unwrap();
        assert_eq!(refit(&d, &code.atoms, y.view(), None).unwrap(), code);
        let twice = refit(&d, &[3, 3, 5], y.view(), None).unwrap();
        assert_eq!(
            (twice.atoms, twice.stop),
            (vec![3, 5], StopReason::Dependent)
        );
        assert!(refit(&d, &[40], y.view(), None).is_err());
        let none = refit(&d, &[], y.view(), None).unwrap();
        assert!((none.squared_residual - y.dot(&y)).abs() <= 1e-12);
    }
}
