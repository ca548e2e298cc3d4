//! The noise of an observation: which coordinates are observed, and how alike their variances are.
//!
//! A component has to be conditioned on each new vector of noise variances, and that costs far more
//! than evaluating it. [`quantize`] therefore rounds variances, so that the frames of a take share
//! a few vectors, and [`NoisePattern`] tells which of two ways to condition is cheaper.

use crate::pose::ASF_UNIT_CM;

/// The smallest noise variance, cm² (1e-3 asf²): the components are no more accurate than that.
pub(crate) const MIN_NOISE: f64 = 1e-3 * ASF_UNIT_CM * ASF_UNIT_CM;
/// For posteriors: variances up to this many times the median are taken for equal.
pub(crate) const POSTERIOR_TOLERANCE: f64 = 1.25;
/// For placement, which depends on all points together: the same.
pub(crate) const PLACEMENT_TOLERANCE: f64 = 3.0;
/// Variances below the median are taken for equal to it too, unless the smallest is this many times
/// smaller: a nearly exact coordinate must stay nearly exact.
const EXACT_RATIO: f64 = 4.0;

/// How the noise variances of a part's coordinates are distributed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum NoisePattern {
    /// No coordinate is observed.
    Unobserved,
    /// R = `base` I, but for some coordinates.
    NearIsotropic {
        /// The smallest variance, cm²; most coordinates have it.
        base: f64,
        /// The other coordinates and their variances, cm², above `base`; infinite where missing.
        exceptions: Vec<(usize, f64)>,
    },
    /// Any other diagonal R.
    Diagonal,
}

impl NoisePattern {
    /// The pattern of the noise variances (d), cm², infinite where missing.
    pub(crate) fn of(noise: &[f64]) -> NoisePattern {
        let base = noise.iter().copied().fold(f64::INFINITY, f64::min);
        if base == f64::INFINITY {
            return NoisePattern::Unobserved;
        }
        let each = noise.iter().copied().enumerate();
        let exceptions: Vec<(usize, f64)> = each.filter(|(_, n)| *n > base).collect();
        // With more exceptions their factorizations cost more than an eigendecomposition of the
        // observed coordinates.
        if 5 * exceptions.len() > 3 * noise.len() {
            return NoisePattern::Diagonal;
        }
        NoisePattern::NearIsotropic { base, exceptions }
    }
}

/// Rounds noise variances (cm², infinite where missing) and raises them to [`MIN_NOISE`].
///
/// Up to two different variances are kept as they are. Of three or more, those up to `tolerance`
/// times the median become their geometric mean, and every variance is rounded to a quarter of an
/// octave.
pub(crate) fn quantize(noise: &[f64], tolerance: f64) -> Vec<f64> {
    let noise: Vec<f64> = noise.iter().map(|n| n.max(MIN_NOISE)).collect();
    let mut sorted: Vec<f64> = noise.iter().copied().filter(|n| n.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let (Some(&least), Some(&most)) = (sorted.first(), sorted.last()) else {
        return noise;
    };
    if sorted.iter().all(|n| *n == least || *n == most) {
        return noise;
    }
    let rounded = |v: f64| ((v.log2() * 4.0).round() / 4.0).exp2().max(MIN_NOISE);
    let median = sorted[sorted.len() / 2];
    let is_common = |n: f64| least * EXACT_RATIO >= median && n <= tolerance * median;
    let common = || sorted.iter().copied().filter(|n| is_common(*n));
    let mean_log = common().map(f64::ln).sum::<f64>() / common().count().max(1) as f64;
    let shared = rounded(mean_log.exp());
    let quantized = |n: &f64| match *n {
        n if !n.is_finite() => n,
        n if is_common(n) => shared,
        n => rounded(n),
    };
    noise.iter().map(quantized).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn similar_variances_become_one() {
        let one = quantize(&[0.9, 1.0, 1.2, INF, 1.4], 1.5);
        assert!(one[..3].iter().chain(&one[4..]).all(|n| *n == one[0]));
        assert!((0.9..1.4).contains(&one[0]) && one[3] == INF);
        // Much larger variances stay apart and do not raise the others.
        let some = quantize(&[1.0, 1.1, 0.9, 1.0, 9.0, 9.1, INF], 1.25);
        assert!(some[..4].iter().all(|n| *n == 1.0));
        assert!(some[4] == some[5] && (8.0..10.0).contains(&some[4]));
    }

    #[test]
    fn two_variances_are_kept_and_all_reach_the_minimum() {
        let two = [1.0, 5.0, INF];
        assert_eq!(quantize(&two, POSTERIOR_TOLERANCE), two);
        assert_eq!(quantize(&[INF; 2], POSTERIOR_TOLERANCE), [INF; 2]);
        // A nearly exact coordinate keeps all others apart.
        let many = quantize(&[0.0, 1.0, 2.0, 2.1, INF], PLACEMENT_TOLERANCE);
        assert!(many[0] == MIN_NOISE && many[1] == 1.0 && many[2] == many[3] && many[2] < 2.5);
        // NaN counts as exact.
        let broken = quantize(&[f64::NAN, 1.0, 2.0, 3.0], POSTERIOR_TOLERANCE);
        assert_eq!(broken[0], MIN_NOISE);
    }

    #[test]
    fn patterns_are_told_apart() {
        assert_eq!(NoisePattern::of(&[INF; 3]), NoisePattern::Unobserved);
        let exceptions = vec![(1, INF), (4, 2.0)];
        let near = NoisePattern::NearIsotropic {
            base: 0.5,
            exceptions,
        };
        assert_eq!(NoisePattern::of(&[0.5, INF, 0.5, 0.5, 2.0, 0.5]), near);
        assert_eq!(NoisePattern::of(&[0.5, 2.0, INF]), NoisePattern::Diagonal);
    }
}
