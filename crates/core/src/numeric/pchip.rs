//! PCHIP: piecewise cubic interpolation that keeps the shape of its data (Fritsch and Butland
//! 1984): between two data points it never leaves their range.

/// The interpolant through the points (`x`, `y`), x rising, at each of `at`. Outside it goes on as
/// the first or last piece; one point alone gives a constant.
pub fn pchip(x: &[f64], y: &[f64], at: &[f64]) -> Vec<f64> {
    let n = x.len();
    if n < 2 {
        return vec![y.first().copied().unwrap_or(f64::NAN); at.len()];
    }
    let slopes = slopes(x, y);
    let value = |&t: &f64| {
        let k = x.partition_point(|v| *v <= t).clamp(1, n - 1) - 1;
        let h = x[k + 1] - x[k];
        let u = (t - x[k]) / h;
        let (a, b) = ((1.0 + 2.0 * u) * (1.0 - u).powi(2), u * (1.0 - u).powi(2));
        let (c, d) = (u * u * (3.0 - 2.0 * u), u * u * (u - 1.0));
        a * y[k] + b * h * slopes[k] + c * y[k + 1] + d * h * slopes[k + 1]
    };
    at.iter().map(value).collect()
}

/// The slope at each of at least two points.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = (0..n - 1).map(|k| (y[k + 1] - y[k]) / h[k]).collect();
    if n == 2 {
        return vec![d[0]; 2];
    }
    let inner = (1..n - 1).map(|k| {
        let (before, after) = (d[k - 1], d[k]);
        if before * after <= 0.0 {
            return 0.0;
        }
        let (a, b) = (2.0 * h[k] + h[k - 1], h[k] + 2.0 * h[k - 1]);
        (a + b) / (a / before + b / after)
    });
    let mut out = vec![end_slope(h[0], h[1], d[0], d[1])];
    out.extend(inner);
    out.push(end_slope(h[n - 2], h[n - 3], d[n - 2], d[n - 3]));
    out
}

/// The slope at an end: that of the parabola through three points, unless it would leave their
/// range.
fn end_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    let slope = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if slope * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && slope.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_as_scipy_does() {
        // scipy.interpolate.PchipInterpolator of SciPy 1.14.
        let (x, y) = ([0.0, 1.0, 2.0, 4.0, 5.0], [0.0, 1.0, 4.0, 3.0, 3.5]);
        let got = pchip(&x, &y, &[0.0, 0.5, 1.5, 3.0, 4.25, 5.0]);
        let want = [0.0, 0.3125, 2.6875, 3.5, 3.0390625, 3.5];
        for (g, w) in got.iter().zip(want) {
            assert!((g - w).abs() <= 1e-12, "{got:?}");
        }
        assert_eq!(pchip(&[1.0], &[2.0], &[0.0, 3.0]), [2.0, 2.0]);
        assert_eq!(pchip(&[0.0, 2.0], &[0.0, 4.0], &[1.0]), [2.0]);
    }
}
