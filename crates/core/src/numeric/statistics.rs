//! Medians, quantiles and bootstrap intervals.

use rand::Rng;
use std::cmp::Ordering;

/// Draws of a bootstrap.
pub const DRAWS: usize = 1000;

/// The middle of the sorted values, of an even number the upper of both in the middle; `None` for
/// none.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    median_of(&mut values)
}

/// The [`median`] of values whose order may change.
pub fn median_of(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The values that have some ranks once finite ones are sorted. The ranks fall, and each is below
/// the number of values.
pub fn at_ranks<const N: usize>(values: &mut [f64], ranks: [usize; N]) -> [f64; N] {
    debug_assert!(ranks.is_sorted_by(|a, b| a >= b) && values.iter().all(|v| v.is_finite()));
    // What is below a rank stays before it.
    let mut open = values.len();
    ranks.map(|at| {
        if at < open {
            let order = |a: &f64, b: &f64| a.partial_cmp(b).unwrap_or(Ordering::Equal);
            values[..open].select_nth_unstable_by(at, order);
            open = at;
        }
        values[at]
    })
}

/// The value below which a share of the values lies, that of the nearest rank; `None` for none.
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let at = (share * values.len().checked_sub(1)? as f64).round() as usize;
    Some(*values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// The mean of the values that are finite; `None` for none.
pub fn mean_of_finite(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let finite = values.into_iter().filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Values less the mean of those within `reach` of each; NaN where missing.
pub fn less_local_mean(values: &[f64], reach: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0)];
    for v in values {
        let (sum, count) = sums[sums.len() - 1];
        sums.push(if v.is_finite() {
            (sum + v, count + 1.0)
        } else {
            (sum, count)
        });
    }
    let local = |t: usize| {
        let (from, to) = (t.saturating_sub(reach), (t + reach + 1).min(values.len()));
        (sums[to].0 - sums[from].0) / (sums[to].1 - sums[from].1)
    };
    (0..values.len()).map(|t| values[t] - local(t)).collect()
}

/// The least and the largest value; +∞ and −∞ for none.
pub fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    values
        .into_iter()
        .fold(none, |(low, high), v| (low.min(v), high.max(v)))
}

/// The largest value less the least; −∞ for none.
pub fn span(values: impl IntoIterator<Item = f64>) -> f64 {
    let (low, high) = range(values);
    high - low
}

/// The 2.5% and 97.5% quantiles of the values; NaN for none.
pub fn interval_95(values: &[f64]) -> [f64; 2] {
    [0.025, 0.975].map(|share| quantile(values.to_vec(), share).unwrap_or(f64::NAN))
}

/// The 95% interval of `statistic` over [`DRAWS`] bootstrap draws of `n` units with replacement.
pub fn bootstrap_interval(
    n: usize,
    random: &mut impl Rng,
    statistic: impl Fn(&mut dyn Iterator<Item = usize>) -> f64,
) -> [f64; 2] {
    let draw = |_| statistic(&mut (0..n).map(|_| random.random_range(0..n)));
    interval_95(&(0..DRAWS).map(draw).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;

    #[test]
    fn values_at_ranks_are_those_of_the_sorted_ones() {
        for n in [1, 2, 5, 40, 401] {
            let mut values: Vec<f64> = (0..n).map(|k| ((k * 7919) % 31) as f64).collect();
            let ranks = [n - 1, 3 * n / 4, 3 * n / 4, n / 2, 0];
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            assert_eq!(at_ranks(&mut values, ranks), ranks.map(|at| sorted[at]));
        }
    }

    #[test]
    fn the_middle_value_is_found() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 3.0, 2.0]), Some(3.0));
        assert_eq!(median(Vec::new()), None);
    }

    #[test]
    fn quantiles_are_values_of_the_nearest_rank() {
        let values: Vec<f64> = (0..=10).rev().map(f64::from).collect();
        assert_eq!(quantile(values.clone(), 0.5), Some(5.0));
        assert_eq!(quantile(values.clone(), 0.96), Some(10.0));
        assert_eq!(interval_95(&values), [0.0, 10.0]);
        assert_eq!(quantile(Vec::new(), 0.5), None);
        assert!(interval_95(&[]).iter().all(|v| v.is_nan()));
    }

    #[test]
    fn a_span_goes_from_the_least_to_the_largest() {
        assert_eq!(span([2.0, -1.0, f64::NAN, 4.0]), 5.0);
        assert_eq!(range([3.0]), (3.0, 3.0));
        assert_eq!(span([]), f64::NEG_INFINITY);
    }

    #[test]
    fn an_interval_of_a_bootstrap_holds_the_statistic() {
        let mean =
            |drawn: &mut dyn Iterator<Item = usize>| drawn.map(|k| (k % 2) as f64 / 50.0).sum();
        let [low, high] = bootstrap_interval(50, &mut parallel::rng(0, 0), mean);
        assert!(low > 0.3 && low < 0.45 && high > 0.55 && high < 0.7);
    }

    #[test]
    fn what_changes_slowly_is_taken_off() {
        let values: Vec<f64> = (0..600).map(|t| 40.0 + (t as f64 / 200.0).sin()).collect();
        let off = less_local_mean(&values, 60);
        assert!(off[60..540].iter().all(|v| v.abs() <= 0.02));
        assert!(less_local_mean(&[1.0, f64::NAN, 3.0], 1)[1].is_nan());
    }
}
