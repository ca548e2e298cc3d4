//! The objective of large margin nearest neighbors for given targets and impostors.

use crate::numeric::parallel::map_chunks;
use crate::numeric::product::{product, transposed_product};
use ndarray::{Array2, ArrayView2};

/// Weight μ of the margin beside that of the distances to targets, 1 − μ: ½, as Weinberger and Saul
/// have it.
const MARGIN_WEIGHT: f64 = 0.5;
/// Anchors that are worked on together.
const ANCHORS: usize = 256;

/// A pose with the poses that it is to be near to, and those to be kept away.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Anchor {
    /// Its row.
    pub pose: usize,
    /// Rows of its targets.
    pub targets: Vec<usize>,
    /// Rows of its impostors.
    pub impostors: Vec<usize>,
}

/// The mean over anchors' targets of (1 − μ) D_ij + μ Σ_l max(0, 1 + D_ij − D_il) and its gradient
/// (d, r), for poses x (m, d) and W (d, r).
pub(super) fn objective(
    x: ArrayView2<'_, f64>,
    anchors: &[Anchor],
    w: ArrayView2<'_, f64>,
) -> (f64, Array2<f64>) {
    let z = product(x, w);
    let parts = map_chunks(anchors.len(), ANCHORS, |chunk| {
        let (mut value, mut by_z) = (0.0, Array2::zeros(z.dim()));
        for anchor in &anchors[chunk] {
            value += add_anchor(anchor, &z, &mut by_z);
        }
        (value, by_z)
    });
    let (mut sum, mut by_z) = (0.0, Array2::zeros(z.dim()));
    for (value, part) in parts {
        sum += value;
        by_z += &part;
    }
    let targets: usize = anchors.iter().map(|a| a.targets.len()).sum();
    let count = targets.max(1) as f64;
    // The gradient of |z_i − z_j|² by z_i; half of it was added.
    let gradient = transposed_product(x, by_z.view()) * (2.0 / count);
    (sum / count, gradient)
}

/// The terms of one anchor; adds half of their gradient by z to `by_z` (m, r).
fn add_anchor(anchor: &Anchor, z: &Array2<f64>, by_z: &mut Array2<f64>) -> f64 {
    let i = anchor.pose;
    let to_targets: Vec<f64> = anchor.targets.iter().map(|&j| apart(z, i, j)).collect();
    let mut weights = vec![1.0 - MARGIN_WEIGHT; to_targets.len()];
    let mut value = (1.0 - MARGIN_WEIGHT) * to_targets.iter().sum::<f64>();
    for &l in &anchor.impostors {
        let to_impostor = apart(z, i, l);
        let mut invaded = 0.0;
        for (to_target, weight) in to_targets.iter().zip(&mut weights) {
            let excess = 1.0 + to_target - to_impostor;
            if excess > 0.0 {
                value += MARGIN_WEIGHT * excess;
                *weight += MARGIN_WEIGHT;
                invaded += MARGIN_WEIGHT;
            }
        }
        add_pair(i, l, -invaded, z, by_z);
    }
    for (&j, weight) in anchor.targets.iter().zip(weights) {
        add_pair(i, j, weight, z, by_z);
    }
    value
}

/// Adds half of the gradient of `weight` |z_i − z_j|².
fn add_pair(i: usize, j: usize, weight: f64, z: &Array2<f64>, by_z: &mut Array2<f64>) {
    if weight != 0.0 && i != j {
        let scaled = (&z.row(i) - &z.row(j)) * weight;
        by_z.row_mut(i).scaled_add(1.0, &scaled);
        by_z.row_mut(j).scaled_add(-1.0, &scaled);
    }
}

/// |z_i − z_j|².
pub(super) fn apart(z: &Array2<f64>, i: usize, j: usize) -> f64 {
    let (a, b) = (z.row(i), z.row(j));
    let (Some(a), Some(b)) = (a.to_slice(), b.to_slice()) else {
        return (&a - &b).mapv(|v| v * v).sum();
    };
    // Summed in four lanes: a single one waits for each addition.
    let mut lanes = [0.0; 4];
    let (a, b) = (a.chunks(4), b.chunks(4));
    for (a, b) in a.zip(b) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += (a - b) * (a - b);
        }
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses() -> (Array2<f64>, Vec<Anchor>) {
        let x = Array2::from_shape_fn((40, 4), |(i, j)| ((i * 5 + j * 7) as f64 * 1.1).sin());
        let anchor = |pose| Anchor {
            pose,
            targets: vec![(pose + 1) % 40, (pose * 7 + 3) % 40],
            impostors: (0..40).filter(|l| (l + pose) % 3 == 0).collect(),
        };
        (x, (0..40).map(anchor).collect())
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        let (x, anchors) = poses();
        let w = Array2::from_shape_fn((4, 3), |(i, j)| ((i * 3 + j) as f64 * 1.3).cos());
        let (_, gradient) = objective(x.view(), &anchors, w.view());
        for ((i, j), got) in gradient.indexed_iter() {
            let at = |h: f64| {
                let mut moved = w.clone();
                moved[[i, j]] += h;
                objective(x.view(), &anchors, moved.view()).0
            };
            let want = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((got - want).abs() <= 1e-6, "{i} {j}: {got} {want}");
        }
    }

    #[test]
    fn the_value_is_that_of_the_definition() {
        let x = ndarray::array![[0.0], [1.0], [1.2], [3.0]];
        let anchor = |targets: &[usize], impostors: &[usize]| Anchor {
            pose: 0,
            targets: targets.to_vec(),
            impostors: impostors.to_vec(),
        };
        let of = |a: Anchor| objective(x.view(), &[a], Array2::eye(1).view()).0;
        // 1 + 1 − 1.44 invades; 1 + 1 − 9 does not.
        assert!((of(anchor(&[1], &[2, 3])) - (0.5 + 0.5 * 0.56)).abs() <= 1e-15);
        // A pose that is its own target keeps impostors a unit away.
        assert_eq!(of(anchor(&[0], &[1, 2])), 0.0);
        assert_eq!(of(anchor(&[0], &[0])), 0.5);
        assert_eq!(objective(x.view(), &[], Array2::eye(1).view()).0, 0.0);
    }
}
