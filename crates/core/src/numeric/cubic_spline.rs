//! Cubic splines through data points: twice continuously differentiable, the first two pieces one
//! cubic, and the last two (not-a-knot; de Boor, A Practical Guide to Splines, chapter IV).

/// The cubic spline through points (x, y), x rising. Three points give a parabola, two a line, one
/// a constant, none NaN.
#[derive(Debug, Clone)]
pub struct CubicSpline {
    x: Vec<f64>,
    y: Vec<f64>,
    /// At each point.
    slopes: Vec<f64>,
}

impl CubicSpline {
    /// The spline through the points (`x`, `y`), as many of both.
    pub fn new(x: Vec<f64>, y: Vec<f64>) -> CubicSpline {
        let slopes = slopes(&x, &y);
        CubicSpline { x, y, slopes }
    }

    /// The x of its points.
    pub fn points(&self) -> &[f64] {
        &self.x
    }

    /// The value at `t`; outside of the points the first or last piece goes on.
    pub fn value(&self, t: f64) -> f64 {
        let Some((k, h, u)) = self.piece(t) else {
            return self.y.first().copied().unwrap_or(f64::NAN);
        };
        let (a, b) = ((1.0 + 2.0 * u) * (1.0 - u).powi(2), u * (1.0 - u).powi(2));
        let (c, d) = (u * u * (3.0 - 2.0 * u), u * u * (u - 1.0));
        let (y, s) = (&self.y, &self.slopes);
        a * y[k] + b * h * s[k] + c * y[k + 1] + d * h * s[k + 1]
    }

    /// The slope at `t`.
    pub fn slope(&self, t: f64) -> f64 {
        let Some((k, h, u)) = self.piece(t) else {
            return 0.0;
        };
        let (y, s) = (&self.y, &self.slopes);
        6.0 * u * (1.0 - u) * (y[k + 1] - y[k]) / h
            + (1.0 - u) * (1.0 - 3.0 * u) * s[k]
            + u * (3.0 * u - 2.0) * s[k + 1]
    }

    /// The piece of `t`, its length, and where in it `t` is, from 0 to 1.
    fn piece(&self, t: f64) -> Option<(usize, f64, f64)> {
        let n = self.x.len();
        if n < 2 {
            return None;
        }
        let k = self.x.partition_point(|v| *v <= t).clamp(1, n - 1) - 1;
        let h = self.x[k + 1] - self.x[k];
        Some((k, h, (t - self.x[k]) / h))
    }
}

/// The slopes of the spline at its points: a tridiagonal system, solved without pivoting, as its
/// diagonal dominates but at the ends, where it is eliminated first.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = (1..n).map(|k| (y[k] - y[k - 1]) / h[k - 1]).collect();
    match n {
        0 | 1 => return vec![0.0; n],
        2 => return vec![d[0]; 2],
        3 => {
            let middle = (h[1] * d[0] + h[0] * d[1]) / (h[0] + h[1]);
            return vec![2.0 * d[0] - middle, middle, 2.0 * d[1] - middle];
        }
        _ => {}
    }
    // Rows (below, diagonal, above | right).
    let mut rows = Vec::with_capacity(n);
    rows.push(end_row([h[0], h[1]], [d[0], d[1]]));
    for k in 1..n - 1 {
        let right = 3.0 * (h[k] * d[k - 1] + h[k - 1] * d[k]);
        rows.push([h[k], 2.0 * (h[k - 1] + h[k]), h[k - 1], right]);
    }
    let last = end_row([h[n - 2], h[n - 3]], [d[n - 2], d[n - 3]]);
    rows.push([last[2], last[1], 0.0, last[3]]);
    for k in 1..n {
        let factor = rows[k][0] / rows[k - 1][1];
        rows[k][1] -= factor * rows[k - 1][2];
        rows[k][3] -= factor * rows[k - 1][3];
    }
    let mut out = vec![0.0; n];
    for k in (0..n).rev() {
        let next = out.get(k + 1).copied().unwrap_or(0.0);
        out[k] = (rows[k][3] - rows[k][2] * next) / rows[k][1];
    }
    out
}

/// The row of an end, where the two outermost pieces, of lengths `h` and chords `d` from the end
/// on, are one cubic.
fn end_row(h: [f64; 2], d: [f64; 2]) -> [f64; 4] {
    let both = h[0] + h[1];
    let right = ((h[0] + 2.0 * both) * h[1] * d[0] + h[0] * h[0] * d[1]) / both;
    [0.0, h[1], both, right]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_comes_back_with_its_slope() {
        let cubic = |t: f64| 2.0 - t + 0.5 * t * t - 0.25 * t * t * t;
        let slope = |t: f64| -1.0 + t - 0.75 * t * t;
        let x = [0.0, 0.5, 1.75, 2.0, 3.5, 4.0];
        for n in 4..=6 {
            let y: Vec<f64> = x[..n].iter().map(|t| cubic(*t)).collect();
            let spline = CubicSpline::new(x[..n].to_vec(), y);
            for t in [-0.5, 0.0, 0.2, 1.0, 1.9, 2.0, 3.9] {
                assert!((spline.value(t) - cubic(t)).abs() < 1e-12, "{n} {t}");
                assert!((spline.slope(t) - slope(t)).abs() < 1e-12, "{n} {t}");
            }
        }
    }

    #[test]
    fn few_points_give_what_they_determine() {
        let parabola = CubicSpline::new(vec![0.0, 1.0, 3.0], vec![0.0, 1.0, 9.0]);
        assert!((parabola.value(2.0) - 4.0).abs() < 1e-12);
        assert_eq!(
            CubicSpline::new(vec![0.0, 2.0], vec![1.0, 5.0]).value(0.5),
            2.0
        );
        let one = CubicSpline::new(vec![1.0], vec![3.0]);
        assert_eq!((one.value(9.0), one.slope(9.0)), (3.0, 0.0));
        assert!(CubicSpline::new(Vec::new(), Vec::new()).value(0.0).is_nan());
    }

    #[test]
    fn it_meets_its_points_without_a_kink() {
        let x: Vec<f64> = (0..20)
            .map(|k| f64::from(k) + 0.3 * f64::from(k % 3))
            .collect();
        let y: Vec<f64> = x.iter().map(|t| t.sin()).collect();
        let spline = CubicSpline::new(x.clone(), y.clone());
        for k in 1..19 {
            assert!((spline.value(x[k]) - y[k]).abs() < 1e-12);
            let (before, after) = (spline.slope(x[k] - 1e-7), spline.slope(x[k] + 1e-7));
            assert!((before - after).abs() < 1e-5, "{k}");
            let bend = |t: f64| (spline.slope(t + 1e-4) - spline.slope(t - 1e-4)) / 2e-4;
            assert!((bend(x[k] - 2e-4) - bend(x[k] + 2e-4)).abs() < 5e-3, "{k}");
        }
    }
}
