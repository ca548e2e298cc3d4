//! Paths of points between frames.

use super::body_tree::Frames;
use glam::DVec3;
use ndarray::Array2;

/// Frames at the times `at`, counted in frames from the first: cubics through the four frames
/// around each.
pub(crate) fn sampled(frames: &Frames, at: &[f64]) -> Frames {
    let last = frames.nrows() as f64 - 1.0;
    let most = frames.nrows().saturating_sub(4);
    Array2::from_shape_fn((at.len(), frames.ncols()), |(k, p)| {
        let x = at[k].clamp(0.0, last);
        let first = (x.floor() as usize).saturating_sub(1).min(most);
        let count = frames.nrows().min(4);
        (0..count).fold(DVec3::ZERO, |sum, i| {
            let weight = (0..count).filter(|j| *j != i).fold(1.0, |w, j| {
                w * (x - (first + j) as f64) / (i as f64 - j as f64)
            });
            sum + weight * frames[[first + i, p]]
        })
    })
}

/// The cubic spline through `values` at even steps from 0 to 1, with no slope at its ends, at each
/// of `at`.
pub(crate) fn clamped_spline(values: &[DVec3], at: &[f64]) -> Vec<DVec3> {
    let n = values.len() - 1;
    // The slopes s, in units of a step: s₋ + 4 s + s₊ = 3 (y₊ - y₋), by the Thomas algorithm.
    let mut slopes = vec![DVec3::ZERO; n + 1];
    let mut upper = vec![0.0; n + 1];
    for i in 1..n {
        let divisor = 4.0 - upper[i - 1];
        upper[i] = 1.0 / divisor;
        let right = 3.0 * (values[i + 1] - values[i - 1]);
        slopes[i] = (right - slopes[i - 1]) / divisor;
    }
    for i in (1..n).rev() {
        let next = if i + 1 == n {
            DVec3::ZERO
        } else {
            slopes[i + 1]
        };
        slopes[i] -= upper[i] * next;
    }
    let value = |u: &f64| {
        let x = (u * n as f64).clamp(0.0, n as f64);
        let i = (x.floor() as usize).min(n - 1);
        super::windows::cubic(
            x - i as f64,
            1.0,
            [values[i], values[i + 1]],
            [slopes[i], slopes[i + 1]],
        )
    };
    at.iter().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_are_sampled_exactly() {
        let of = |x: f64| DVec3::new(x * x * x - 3.0 * x, 2.0 - x, x * x);
        let frames = Array2::from_shape_fn((9, 1), |(t, _)| of(t as f64));
        let at = [0.0, 0.3, 1.0, 4.75, 7.9, 8.0];
        for (found, x) in sampled(&frames, &at).iter().zip(at) {
            assert!((*found - of(x)).length() < 1e-9);
        }
    }

    #[test]
    fn a_spline_goes_through_its_values_and_is_smooth() {
        let values: Vec<DVec3> = (0..7).map(|i| DVec3::splat(f64::from(i * i % 5))).collect();
        let at = |u: f64| clamped_spline(&values, &[u])[0].x;
        for (i, value) in values.iter().enumerate() {
            assert!((at(i as f64 / 6.0) - value.x).abs() < 1e-9);
        }
        assert!((at(1e-5) - at(0.0)).abs() < 1e-7 && (at(1.0) - at(1.0 - 1e-5)).abs() < 1e-7);
        // Curvature does not jump at a knot.
        let h = 1e-4;
        let bend = |u: f64| (at(u + h) - 2.0 * at(u) + at(u - h)) / (h * h);
        let knot = 2.0 / 6.0;
        assert!((bend(knot - 2.0 * h) - bend(knot + 2.0 * h)).abs() < 1.0);
    }
}
