//! Weights of the terms of a distance by least squares (Wang and Bodenheimer: An Evaluation of a
//! Cost Metric for Selecting Transitions between Motion Segments. SCA 2003), as Chen et al. 2011
//! learn equations 41, 43 and 44.
//!
//! The distance of a pair p is Σ_j w_j t_pj, of terms t at least 0 such as squared differences of
//! joints. It is fitted to 0 for alike pairs and 1 for unlike ones:
//!
//! minimize (1/P) Σ_p (Σ_j w_j t_pj − y_p)² + ridge Σ_j m_j w_j² over w ≥ 0,
//!
//! where P is the number of pairs and m_j the mean of t_pj² over them, so that the ridge does not
//! depend on the terms' units. Solved on the Gram matrix of the terms ([`crate::numeric::nnls`]).
//! Cost: O(P k²) for k terms, and O(k³).

use crate::Result;
use crate::numeric::nnls::nonnegative_least_squares;
use crate::numeric::product::transposed_product;
use ndarray::{Array1, ArrayView2, Axis};

/// Share of a term's mean square. It makes the weights of equal terms equal, and changes others by
/// about as little.
const RIDGE: f64 = 1e-6;

/// Learns the weights w (terms) from the `terms` of pairs (pairs, terms) and whether each pair is
/// alike.
///
/// # Errors
/// [`crate::Error::Unfit`]: no pairs of one label, a term that is negative or not finite, shapes
/// that do not fit, or unlike pairs
/// whose terms are all 0.
pub(crate) fn fit(terms: ArrayView2<'_, f64>, is_alike: &[bool]) -> Result<Vec<f64>> {
    check(terms, is_alike)?;
    let target: Array1<f64> = is_alike
        .iter()
        .map(|&a| if a { 0.0 } else { 1.0 })
        .collect();
    let pairs = terms.nrows() as f64;
    let mut gram = transposed_product(terms, terms) / pairs;
    let mut with_target = terms.t().dot(&target) / pairs;
    // Terms of mean square 1; a term that is always 0 has weight 0.
    let size = gram.diag().mapv(|v| if v > 0.0 { v.sqrt() } else { 1.0 });
    gram /= &size;
    gram /= &size.view().insert_axis(Axis(1));
    gram.diag_mut().mapv_inplace(|v| v + RIDGE);
    with_target /= &size;
    if !(with_target.iter().any(|&b| b > 0.0)) {
        return Err("lms needs pairs of label 0 whose poses differ".into());
    }
    let w = nonnegative_least_squares(&gram, &with_target)
        .ok_or("lms did not find weights: the terms are too large or too nearly the same")?;
    Ok((w / size).to_vec())
}

fn check(terms: ArrayView2<'_, f64>, is_alike: &[bool]) -> Result<()> {
    if terms.nrows() != is_alike.len() {
        let (pairs, labels) = (terms.nrows(), is_alike.len());
        return Err(format!("lms needs one label for each pair: {labels} for {pairs}").into());
    }
    if !is_alike.contains(&true) {
        return Err("lms needs pairs of label 1".into());
    }
    if !is_alike.contains(&false) {
        return Err("lms needs pairs of label 0 too".into());
    }
    if terms.iter().all(|&t| t >= 0.0 && t.is_finite()) {
        Ok(())
    } else {
        Err("lms needs differences that are finite and at least 0".into())
    }
}

#[cfg(test)]
mod tests {
    use super::super::scatter::differences;
    use super::super::testdata::Planted;
    use super::*;
    use ndarray::{Array2, array, concatenate};

    /// Squared differences of planted pairs, and their labels.
    fn planted() -> (Array2<f64>, Vec<bool>, Planted) {
        let data = Planted::new(3, 6);
        let of = |pairs: &[[usize; 2]]| differences(data.x.view(), pairs).mapv(|v| v * v);
        let (alike, unlike) = (of(&data.alike), of(&data.unlike));
        let terms = concatenate![Axis(0), alike, unlike];
        let labels = (0..terms.nrows()).map(|p| p < alike.nrows()).collect();
        (terms, labels, data)
    }

    #[test]
    fn weights_meet_the_conditions_of_the_minimum() {
        let (terms, labels, _) = planted();
        let w = Array1::from(fit(terms.view(), &labels).unwrap());
        assert!(w.iter().all(|&v| v >= 0.0) && w.iter().any(|&v| v > 0.0));
        let y: Array1<f64> = labels.iter().map(|&a| if a { 0.0 } else { 1.0 }).collect();
        let (pairs, mean_square) = (labels.len() as f64, |j| {
            terms.column(j).dot(&terms.column(j)) / labels.len() as f64
        });
        let gradient = terms.t().dot(&(terms.dot(&w) - &y)) / pairs;
        for j in 0..w.len() {
            let size = f64::sqrt(mean_square(j));
            let g = gradient[j] / size + RIDGE * size * w[j];
            assert!(
                g >= -2e-9 && g.min(w[j] * size) <= 2e-9,
                "{j}: {g}, {}",
                w[j]
            );
        }
    }

    #[test]
    fn noise_is_suppressed() {
        let (terms, labels, data) = planted();
        let w = fit(terms.view(), &labels).unwrap();
        let map = Array2::from_diag(&Array1::from(w).mapv(f64::sqrt));
        let (before, after) = (data.precision(&Array2::eye(9)), data.precision(&map));
        assert!(after >= before + 0.15, "{after} after {before}");
    }

    #[test]
    fn planted_weights_are_found_and_useless_terms_get_none() {
        // Alike pairs have no difference in the terms that count, so the distance can be exact.
        let terms = array![
            [0.0, 0.0, 5.0],
            [0.0, 0.0, 1.0],
            [2.0, 1.0, 4.0],
            [1.0, 3.0, 0.0]
        ];
        let labels = [true, true, false, false];
        let w = fit(terms.view(), &labels).unwrap();
        assert!(
            (w[0] - 0.4).abs() <= 1e-4 && (w[1] - 0.2).abs() <= 1e-4 && w[2] <= 1e-4,
            "{w:?}"
        );
        // Units are the terms' own.
        let scaled = fit((&terms * &array![1e6, 1.0, 1e-6]).view(), &labels).unwrap();
        assert!((scaled[0] * 1e6 - w[0]).abs() <= 1e-9 && (scaled[1] - w[1]).abs() <= 1e-9);
    }

    #[test]
    fn equal_terms_and_more_terms_than_pairs_are_served() {
        let terms =
            Array2::from_shape_fn((6, 40), |(p, j)| ((p * 7 + j % 20 * 3) as f64).sin().abs());
        let w = fit(terms.view(), &[true, false, true, false, true, false]).unwrap();
        for j in 0..20 {
            assert!(
                (w[j] - w[j + 20]).abs() <= 1e-6 * (1.0 + w[j]),
                "{j}: {} {}",
                w[j],
                w[j + 20]
            );
        }
    }

    #[test]
    fn what_cannot_be_learned_from_is_told() {
        let refuses = |terms: Array2<f64>, labels: &[bool], phrase: &str| {
            let error = fit(terms.view(), labels).unwrap_err();
            assert!(error.to_string().contains(phrase), "{error}");
        };
        let both = [true, false];
        refuses(array![[1.0], [2.0]], &[true, true], "label 0 too");
        refuses(array![[1.0], [2.0]], &[false, false], "label 1");
        refuses(array![[1.0], [-2.0]], &both, "at least 0");
        refuses(array![[1.0], [f64::NAN]], &both, "at least 0");
        refuses(array![[1.0]], &both, "2 for 1");
        refuses(array![[1.0], [0.0]], &both, "differ");
        refuses(Array2::zeros((2, 0)), &both, "differ");
        assert!(fit(array![[1.0], [2.0]].view(), &both).unwrap()[0] > 0.0);
    }
}
