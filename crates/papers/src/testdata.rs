//! Made poses for the tests of priors.

use ndarray::Array2;
#[path = "../../models/src/prior/testdata.rs"]
mod short_calls;

pub(crate) use short_calls::PriorExt;

/// Nearly normal numbers: sums of twelve uniform ones (Park and Miller 1988, their "minimal
/// standard").
pub(crate) fn normal(n: usize, d: usize, seed: u64) -> Array2<f64> {
    let mut x = seed;
    let mut uniform = || {
        x = x * 16807 % 2_147_483_647;
        x as f64 / 2_147_483_647.0
    };
    Array2::from_shape_simple_fn((n, d), || (0..12).fold(-6.0, |sum, _| sum + uniform()))
}

/// L (2, 9) of [`factors`].
pub(crate) fn loading() -> Array2<f64> {
    Array2::from_shape_fn((2, 9), |(k, c)| {
        4.0 * (1.0 + 8.0 * k as f64 + c as f64).sin()
    })
}

/// 600 poses of one analyzer of two factors, with a noise of deviation 0.5 + 0.1 c in coordinate c.
pub(crate) fn factors() -> Array2<f32> {
    let noise = normal(600, 9, 2);
    let own = Array2::from_shape_fn((600, 9), |(i, c)| noise[[i, c]] * (0.5 + 0.1 * c as f64));
    (normal(600, 2, 1).dot(&loading()) + own).mapv(|v| v as f32)
}

/// 900 poses of three overlapping Gaussians in turn, each wider than the one before.
pub(crate) fn blobs() -> Array2<f32> {
    let mut x = normal(900, 6, 3);
    for (i, mut row) in x.rows_mut().into_iter().enumerate() {
        let j = (i % 3) as f64;
        for (c, v) in row.iter_mut().enumerate() {
            let c = c as f64;
            *v = *v * (1.0 + j) * (1.0 + 0.2 * c) + 12.0 * (3.0 * j + c).sin();
        }
        row[1] += 0.8 * row[0];
    }
    x.mapv(|v| v as f32)
}
