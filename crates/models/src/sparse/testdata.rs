//! Made atoms and poses that several of the tests use.

use super::{Dictionary, Encoder, Omp, SparseCode, SparseCodes};
use crate::Result;
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView1, ArrayView2};
use rand::Rng;

/// Uniform about 0.
pub(crate) fn random(n: usize, d: usize, seed: u64) -> Array2<f64> {
    let mut g = parallel::rng(seed, 0);
    Array2::from_shape_fn((n, d), |_| g.random::<f64>() - 0.5)
}

/// Poses-like atoms: all of them near one another.
pub(crate) fn alike(n: usize, d: usize, seed: u64) -> Dictionary {
    let mean = random(1, d, seed + 1000);
    Dictionary::from_rows((random(n, d, seed) * 0.3 + mean).view()).unwrap()
}

/// Poses made of 3 of 40 hidden directions, with a little noise.
pub(crate) fn poses(m: usize, d: usize, seed: u64) -> Array2<f32> {
    let mut g = parallel::rng(7, 0);
    let hidden = Array2::from_shape_fn((40, d), |_| g.random::<f32>() - 0.3);
    let mut g = parallel::rng(seed, 1);
    let mut y = Array2::from_shape_fn((m, d), |_| 0.02 * (g.random::<f32>() - 0.5));
    for mut row in y.outer_iter_mut() {
        for _ in 0..3 {
            row.scaled_add(g.random::<f32>() + 0.5, &hidden.row(g.random_range(0..40)));
        }
    }
    y
}

/// Codes poses (m, D) with a new encoder.
pub(crate) fn encode(
    omp: &Omp,
    dictionary: &Dictionary,
    poses: ArrayView2<f32>,
    weights: Option<ArrayView2<f32>>,
) -> Result<SparseCodes> {
    Encoder::new(dictionary, *omp)?.encode_weighted(poses, weights)
}

/// Codes one pose (D) with a new encoder.
pub(crate) fn encode_one(
    omp: &Omp,
    dictionary: &Dictionary,
    pose: ArrayView1<f64>,
    weights: Option<ArrayView1<f64>>,
) -> Result<SparseCode> {
    Encoder::new(dictionary, *omp)?.encode_one(pose, weights)
}
