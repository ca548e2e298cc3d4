//! Weights of several estimates of the same, by the products of their errors.
//!
//! ```text
//! w = argmin wᵀ G w + h g |w - w₀|²,   w ≥ 0,  Σ w = 1
//! ```
//!
//! G is the Gram matrix of the errors, g the median of its diagonal.

use super::linalg::cholesky_solve;
use ndarray::{Array1, Array2, Axis};

/// The best weights: the best of the solutions on each set of estimates, which are few. `gram` is
/// G (k, k), `plain` the weights w₀ without evidence, which are held to by `hold`, h.
pub fn best_weights(gram: &Array2<f64>, plain: &Array1<f64>, hold: f64) -> Array1<f64> {
    let k = plain.len();
    let mut diagonal: Vec<f64> = gram.diag().to_vec();
    diagonal.sort_by(f64::total_cmp);
    let hold = hold * diagonal[k / 2];
    let mut a = gram.clone();
    a.diag_mut().mapv_inplace(|v| v + hold + 1e-12);
    let linear = plain * hold;
    let objective = |w: &Array1<f64>| w.dot(&a.dot(w)) - 2.0 * linear.dot(w);
    let mut best = (objective(plain), plain.clone());
    for set in 1u32..1 << k {
        let members: Vec<usize> = (0..k).filter(|i| set >> i & 1 == 1).collect();
        let pick = |v: &Array1<f64>| v.select(Axis(0), &members);
        let sub = Array2::from_shape_fn((members.len(), members.len()), |(i, j)| {
            a[[members[i], members[j]]]
        });
        // A w = c + λ 1 with Σ w = 1.
        let ones = Array1::ones(members.len());
        let (Some(u), Some(v)) = (
            cholesky_solve(sub.clone(), pick(&linear)),
            cholesky_solve(sub, ones),
        ) else {
            continue;
        };
        let found = &u + &(&v * ((1.0 - u.sum()) / v.sum()));
        if found.iter().all(|w| *w >= 0.0) {
            let mut w = Array1::zeros(k);
            members.iter().zip(&found).for_each(|(m, f)| w[*m] = *f);
            let value = objective(&w);
            if value < best.0 {
                best = (value, w);
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn no_other_weights_are_better() {
        let plain = array![1.0, 0.0, 0.0];
        for gram in [
            array![[2.0, 0.5, 0.1], [0.5, 1.0, 0.3], [0.1, 0.3, 4.0]],
            array![[1.0, 0.99, 0.9], [0.99, 1.0, 0.9], [0.9, 0.9, 1.0]],
            array![[0.1, 0.3, 0.1], [0.3, 2.0, 0.4], [0.1, 0.4, 3.0]],
            Array2::zeros((3, 3)),
        ] {
            let cost = |w: &Array1<f64>| w.dot(&gram.dot(w));
            let best = best_weights(&gram, &plain, 0.0);
            assert!((best.sum() - 1.0).abs() < 1e-9 && best.iter().all(|w| *w >= 0.0));
            for [i, j] in (0..=20).flat_map(|i| (0..=20 - i).map(move |j| [i, j])) {
                let w = array![f64::from(i), f64::from(j), f64::from(20 - i - j)] / 20.0;
                assert!(cost(&best) <= cost(&w) + 1e-9, "{best} {w}");
            }
            assert!(cost(&(best_weights(&gram, &plain, 1e6) - &plain)) < 1e-6);
        }
    }
}
