//! The noise that is reckoned with: of few kinds, so that frames share what is made for it.
//!
//! A smoother leaves each coordinate a variance of its own. What a block is through such noise would have to be worked out
//! anew for every frame, by a decomposition; where most coordinates have noise of one kind, it is that noise's, with a
//! few coordinates [changed](super::noisy).

use super::MIN_NOISE;

/// Variances up to so many times the median count as the median's kind where poses are answered.
pub const POSTERIOR_TOLERANCE: f64 = 1.25;
/// The same where they are placed, which hangs on all points together.
pub const PLACEMENT_TOLERANCE: f64 = 3.0;
/// Those below it count as its kind as well, unless one is this many times smaller: what is nearly exact stays so.
const EXACT_RATIO: f64 = 4.0;

/// Noise variances (cm², infinite missing), none below the floor. Where they are of three kinds or more, those up to `alike`
/// times their median become one kind, and each of the others is rounded to a quarter of an octave.
pub fn quantize(noise: &[f64], alike: f64) -> Vec<f64> {
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
    let is_usual = |n: f64| least * EXACT_RATIO >= median && n <= alike * median;
    let usual = || sorted.iter().copied().filter(|n| is_usual(*n));
    let mean = usual().map(f64::ln).sum::<f64>() / usual().count().max(1) as f64;
    let one = rounded(mean.exp());
    let kind = |n: &f64| match *n {
        n if !n.is_finite() => n,
        n if is_usual(n) => one,
        n => rounded(n),
    };
    noise.iter().map(kind).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn noise_that_is_alike_counts_as_one() {
        let one = quantize(&[0.9, 1.0, 1.2, INF, 1.4], 1.5);
        assert!(one[..3].iter().chain(&one[4..]).all(|n| *n == one[0]));
        assert!((0.9..1.4).contains(&one[0]) && one[3] == INF);
        // What is much worse stays so, and does not make the others worse.
        let some = quantize(&[1.0, 1.1, 0.9, 1.0, 9.0, 9.1, INF], 1.25);
        assert!(some[..4].iter().all(|n| *n == 1.0));
        assert!(some[4] == some[5] && (8.0..10.0).contains(&some[4]));
    }

    #[test]
    fn two_kinds_stay_as_they_are_and_none_is_below_the_floor() {
        assert_eq!(
            quantize(&[1.0, 5.0, INF], POSTERIOR_TOLERANCE),
            [1.0, 5.0, INF]
        );
        assert_eq!(quantize(&[INF; 2], POSTERIOR_TOLERANCE), [INF; 2]);
        // What is nearly exact keeps all apart.
        let many = quantize(&[0.0, 1.0, 2.0, 2.1, INF], PLACEMENT_TOLERANCE);
        assert!(many[0] == MIN_NOISE && many[1] == 1.0 && many[2] == many[3] && many[2] < 2.5);
        // What is no number is no noise.
        assert_eq!(
            quantize(&[f64::NAN, 1.0, 2.0, 3.0], POSTERIOR_TOLERANCE)[0],
            MIN_NOISE
        );
    }
}
