//! Features chosen by boosting: the distance of Chen, Zhuang, Xiao and Liang (Perceptual 3D pose
//! distance estimation by boosting relational geometric features, 2009), which (45) of Chen et
//! al. 2011 sums up.
//!
//! A weak classifier calls a pair alike when the difference of one feature is below a threshold.
//! AdaBoost (Freund and Schapire 1997) picks one at a time, and then raises the weight of the pairs
//! that it gets wrong. The distance is the sum of the differences of the features picked, each with
//! weight 1. The reference draws from a pool of some 500,000 features; here the pool
//! is the features given.

use crate::Result;
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView2};

/// Weak classifiers, at most.
const ROUNDS: usize = 100;

/// A threshold on a feature: below it a pair is called alike.
struct Stump {
    feature: usize,
    threshold: f32,
    /// The weight of the pairs that it gets wrong, of a total of 1.
    error: f64,
}

/// The features (those with true) that tell pairs that are alike from others, given the magnitudes
/// of differences (pairs, features).
///
/// # Errors
/// [`crate::Error::Unfit`]: one of the labels is missing.
pub(super) fn choose(differences: ArrayView2<'_, f32>, is_alike: &[bool]) -> Result<Vec<bool>> {
    for (label, wanted) in [(1, true), (0, false)] {
        if !is_alike.contains(&wanted) {
            return Err(format!("boost needs pairs of label {label} too").into());
        }
    }
    let orders = parallel::map_chunks(differences.ncols(), 16, |features| {
        features
            .map(|f| {
                let mut order: Vec<u32> = (0..is_alike.len() as u32).collect();
                let value = |k: &u32| differences[[*k as usize, f]];
                order.sort_by(|a, b| value(a).total_cmp(&value(b)));
                order
            })
            .collect::<Vec<_>>()
    })
    .concat();
    let balanced = |wanted: bool| 0.5 / is_alike.iter().filter(|a| **a == wanted).count() as f64;
    let mut weights: Vec<f64> = is_alike.iter().map(|a| balanced(*a)).collect();
    let mut chosen = vec![false; differences.ncols()];
    for _ in 0..ROUNDS {
        let Some(stump) = best_stump(differences, is_alike, &orders, &weights, &chosen) else {
            break;
        };
        // No better than chance.
        if stump.error >= 0.5 - 1e-9 {
            break;
        }
        chosen[stump.feature] = true;
        let right = (stump.error.max(1e-9) / (1.0 - stump.error)).sqrt();
        for (k, weight) in weights.iter_mut().enumerate() {
            let called = differences[[k, stump.feature]] < stump.threshold;
            *weight *= if called == is_alike[k] {
                right
            } else {
                1.0 / right
            };
        }
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= total);
    }
    Ok(chosen)
}

/// The best threshold on a feature that is not chosen yet.
fn best_stump(
    differences: ArrayView2<'_, f32>,
    is_alike: &[bool],
    orders: &[Vec<u32>],
    weights: &[f64],
    chosen: &[bool],
) -> Option<Stump> {
    let all_alike: f64 = (weights.iter().zip(is_alike))
        .filter(|(_, a)| **a)
        .map(|(w, _)| w)
        .sum();
    let stumps = parallel::map_chunks(orders.len(), 16, |features| {
        features
            .filter(|f| !chosen[*f])
            .map(|f| {
                let value = |k: u32| differences[[k as usize, f]];
                // All pairs are called unlike until the threshold has passed them.
                let mut error = all_alike;
                let mut best = Stump {
                    feature: f,
                    threshold: 0.0,
                    error,
                };
                for (at, k) in orders[f].iter().enumerate() {
                    let weight = weights[*k as usize];
                    error += if is_alike[*k as usize] {
                        -weight
                    } else {
                        weight
                    };
                    let next = orders[f].get(at + 1).map_or(f32::INFINITY, |k| value(*k));
                    if error < best.error && next > value(*k) {
                        best.error = error;
                        best.threshold = next;
                    }
                }
                best
            })
            .collect::<Vec<_>>()
    });
    let stumps = stumps.into_iter().flatten();
    stumps.min_by(|a, b| a.error.total_cmp(&b.error).then(a.feature.cmp(&b.feature)))
}

/// The magnitudes of the differences of pairs of rows (pairs, dimensions).
pub(super) fn magnitudes(x: ArrayView2<'_, f64>, pairs: &[[usize; 2]]) -> Array2<f32> {
    Array2::from_shape_fn((pairs.len(), x.ncols()), |(k, j)| {
        (x[[pairs[k][0], j]] as f32 - x[[pairs[k][1], j]] as f32).abs()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn features_that_tell_are_chosen_before_others() {
        let mut rng = parallel::rng(1, 0);
        let is_alike: Vec<bool> = (0..80).map(|k| k % 2 == 0).collect();
        // Feature 2 tells most pairs, 4 the others.
        let differences = Array2::from_shape_fn((80, 6), |(k, f)| {
            let apart = if is_alike[k] { 0.0 } else { 1.0 };
            let noise: f32 = rng.random_range(0.0..0.9);
            match f {
                2 if k < 60 => apart + 0.1 * noise,
                4 if k >= 60 => apart + 0.1 * noise,
                _ => noise,
            }
        });
        let chosen = choose(differences.view(), &is_alike).unwrap();
        assert!(chosen[2] && chosen[4]);
        let error = choose(differences.view(), &[true; 80]).unwrap_err();
        assert!(error.to_string().contains("label 0"), "{error}");
    }

    #[test]
    fn equal_differences_are_never_split() {
        let differences = Array2::from_elem((10, 1), 0.5);
        let is_alike: Vec<bool> = (0..10).map(|k| k < 5).collect();
        assert_eq!(choose(differences.view(), &is_alike).unwrap(), [false]);
    }
}
