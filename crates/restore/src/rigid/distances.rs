//! Observed distances between rigid pairs of points.

use crate::prior::EXACT_VARIANCE;
use crate::prior::rigid_pairs::RigidPairs;

fn distance(y: &[f64], [i, j]: [usize; 2]) -> f64 {
    (0..3)
        .map(|c| (y[3 * i + c] - y[3 * j + c]).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Whether all three coordinates of a point are seen.
pub(crate) fn is_seen(y: &[f64], noise_variance: &[f64], p: usize) -> bool {
    (3 * p..3 * p + 3).all(|i| y[i].is_finite() && noise_variance[i].is_finite())
}

/// Noise variance of a clean point's coordinate, cm².
pub(crate) fn base_of(noise_variance: &[f64], p: usize) -> f64 {
    (noise_variance[3 * p..3 * p + 3].iter().sum::<f64>() / 3.0).max(EXACT_VARIANCE)
}

/// Index, distance (cm) and noise variance of the distance (cm²) of each pair whose ends are both
/// seen.
pub(crate) fn deviations<'a>(
    pairs: &'a RigidPairs,
    y: &'a [f64],
    noise_variance: &'a [f64],
) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
    let both =
        move |&(_, ends): &(usize, [usize; 2])| ends.iter().all(|p| is_seen(y, noise_variance, *p));
    let of = pairs.pairs.iter().map(|p| p.ends).enumerate().filter(both);
    of.map(move |(k, ends)| {
        (
            k,
            distance(y, ends),
            base_of(noise_variance, ends[0]) + base_of(noise_variance, ends[1]),
        )
    })
}
