//! Learning a scaled GPLVM: latent points, kernel and scales by gradient (Grochow et al. 2004,
//! section 5).
//!
//! For the active poses Y (M, D) about the mean pose and their kernel matrix K (see [`super`]),
//! minimized over latent points x (M, L), γ and ν:
//!
//! ½ D ln |K| + ½ M Σ_c ln(y_cᵀ K⁻¹ y_c / M + ε) + ½ Σ |x|²
//!
//! which is the paper's likelihood at its best scales, 1 / w_c² = y_cᵀ K⁻¹ y_c / M + ε; ε keeps
//! coordinates that never move from infinite precision. The kernel's own scale α is one with the
//! w_c, and left out. Starts from PCA.
//!
//! The active poses are the centers of a greedy cover: each is the pose farthest from those before,
//! so that rare poses are kept. Cost: O(M³ + M² D) a step.

use super::process::{Learned, kernel};
use crate::numeric::lbfgs::minimize;
use crate::numeric::linalg::symmetric_eigen;
use ndarray::{Array1, Array2, ArrayView2, Axis};

/// Largest number of training poses, evenly spaced.
const MOST: usize = 2000;
/// Number of active poses M.
const ACTIVE: usize = 150;
/// Dimensions L of the latent space; the paper's authors use 2 to 5.
const LATENT: usize = 3;
/// Steps of the gradient method.
const STEPS: usize = 100;
/// A step whose relative fall is at most this is the last.
pub(super) const TOLERANCE: f64 = 1e-9;
/// ε, cm².
const STILL: f64 = 1e-3;
/// Smallest ν: below it K is numerically singular.
const LEAST_NOISE: f64 = 1e-4;

/// Learns from poses (n, D), n above 0.
pub(super) fn learn(xyz: ArrayView2<'_, f32>, report: &mut dyn FnMut(&str)) -> Learned {
    let step = xyz.nrows().div_ceil(MOST).max(1);
    let some: Vec<usize> = (0..xyz.nrows()).step_by(step).collect();
    let all = xyz.select(Axis(0), &some).mapv(f64::from);
    let mean = all.mean_axis(Axis(0));
    let mean = mean.unwrap_or_else(|| Array1::zeros(xyz.ncols()));
    let all = all - &mean;
    let poses = all.select(Axis(0), &cover(&all, ACTIVE));
    let latent = projected(&poses);
    let mut start: Vec<f64> = latent.iter().copied().collect();
    start.extend([0.0, (0.01f64).ln()]);
    let mut count = 0;
    let end = minimize(start, STEPS, TOLERANCE, &mut |theta| {
        count += 1;
        if count % 50 == 0 {
            report(&format!("latent points: evaluation {count}"));
        }
        objective(theta, &poses)
    })
    .at;
    let (latent, gamma, noise) = unpack(&end, poses.nrows());
    let scales = scales_of(&poses, &latent, gamma, noise);
    Learned {
        poses,
        latent,
        gamma,
        noise,
        scales,
        mean: mean.to_vec(),
    }
}

/// Rows of a greedy cover: the first, then always the one farthest from those taken; copies are
/// left out.
fn cover(poses: &Array2<f64>, most: usize) -> Vec<usize> {
    let n = poses.nrows();
    let mut nearest = vec![f64::INFINITY; n];
    let (mut taken, mut next) = (Vec::new(), 0);
    while taken.len() < most.min(n) {
        taken.push(next);
        let pose = poses.row(next);
        let mut farthest = (0.0, 0);
        for (i, nearest) in nearest.iter_mut().enumerate() {
            let rest = &poses.row(i) - &pose;
            *nearest = nearest.min(rest.dot(&rest));
            if *nearest > farthest.0 {
                farthest = (*nearest, i);
            }
        }
        if farthest.0 <= 0.0 {
            break;
        }
        next = farthest.1;
    }
    taken
}

/// Coordinates along the first principal axes, each of unit variance: (M, L).
fn projected(poses: &Array2<f64>) -> Array2<f64> {
    let (m, d) = poses.dim();
    let mut out = Array2::zeros((m, LATENT));
    let Some((values, vectors)) = symmetric_eigen(&poses.t().dot(poses)) else {
        return out;
    };
    for l in 0..LATENT.min(d) {
        let axis = vectors.column(d - 1 - l);
        let along = poses.dot(&axis);
        let deviation = (values[d - 1 - l].max(0.0) / m as f64).sqrt();
        if deviation > 1e-6 {
            out.column_mut(l).assign(&(along / deviation));
        }
    }
    out
}

/// Latent points, γ = exp(θ), ν = least + exp(θ).
fn unpack(theta: &[f64], m: usize) -> (Array2<f64>, f64, f64) {
    let l = (theta.len() - 2) / m.max(1);
    let latent = Array2::from_shape_fn((m, l), |(i, j)| theta[i * l + j]);
    let gamma = theta[m * l].exp().clamp(1e-12, 1e12);
    let noise = LEAST_NOISE + theta[m * l + 1].exp().min(1e12);
    (latent, gamma, noise)
}

fn scales_of(poses: &Array2<f64>, latent: &Array2<f64>, gamma: f64, noise: f64) -> Vec<f64> {
    let kernel = kernel(latent.view(), gamma, noise);
    let Some((values, vectors)) = symmetric_eigen(&kernel) else {
        return vec![1.0; poses.ncols()];
    };
    let along = vectors.t().dot(poses);
    let quadratic = along.columns().into_iter().map(|c| {
        let terms = c.iter().zip(&values).map(|(c, v)| c * c / v.max(1e-12));
        terms.sum::<f64>() / poses.nrows() as f64 + STILL
    });
    quadratic.collect()
}

/// The objective in the module's head, and its gradient.
fn objective(theta: &[f64], poses: &Array2<f64>) -> (f64, Vec<f64>) {
    let (m, d) = poses.dim();
    let (latent, gamma, noise) = unpack(theta, m);
    let l = latent.ncols();
    let kernel = kernel(latent.view(), gamma, noise);
    let Some((values, vectors)) = symmetric_eigen(&kernel) else {
        return (f64::INFINITY, vec![0.0; theta.len()]);
    };
    let values = values.mapv(|v| v.max(1e-12));
    let inverse = (&vectors / &values).dot(&vectors.t());
    let weighted = inverse.dot(poses);
    let quadratic = (&weighted * poses).sum_axis(Axis(0)) / m as f64 + STILL;
    let mut value = 0.5 * d as f64 * values.mapv(f64::ln).sum();
    value += 0.5 * m as f64 * quadratic.mapv(f64::ln).sum();
    // ∂/∂K = ½ (D K⁻¹ − K⁻¹ Y W² Yᵀ K⁻¹).
    let by_kernel = (inverse * d as f64 - (&weighted / &quadratic).dot(&weighted.t())) * 0.5;
    let mut gradient = vec![0.0; theta.len()];
    let mut by_gamma = 0.0;
    for i in 0..m {
        for j in (0..m).filter(|j| *j != i) {
            let by = by_kernel[[i, j]] * kernel[[i, j]];
            for c in 0..l {
                let apart = latent[[i, c]] - latent[[j, c]];
                gradient[i * l + c] -= 2.0 * gamma * by * apart;
                by_gamma -= 0.5 * by * apart * apart;
            }
        }
        for c in 0..l {
            let x = latent[[i, c]];
            value += 0.5 * x * x;
            gradient[i * l + c] += x;
        }
    }
    gradient[m * l] = by_gamma * gamma;
    gradient[m * l + 1] = by_kernel.diag().sum() * (noise - LEAST_NOISE);
    (value, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_differences() {
        let poses =
            Array2::from_shape_fn((7, 4), |(t, c)| ((t * 3 + c * c) as f64 * 0.7).sin() * 5.0);
        let theta: Vec<f64> = (0..7 * LATENT + 2)
            .map(|i| (i as f64 * 1.3).cos() - 0.4)
            .collect();
        let (_, gradient) = objective(&theta, &poses);
        for i in 0..theta.len() {
            let at = |h: f64| {
                let mut moved = theta.clone();
                moved[i] += h;
                objective(&moved, &poses).0
            };
            let want = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (gradient[i] - want).abs() <= 1e-4 * (1.0 + want.abs()),
                "{i}"
            );
        }
    }

    #[test]
    fn covers_take_no_pose_twice() {
        let mut poses = Array2::from_shape_fn((40, 3), |(t, c)| ((t / 2 * 5 + c) as f64).sin());
        assert_eq!(cover(&poses, 100).len(), 20);
        let mut five = cover(&poses, 5);
        five.sort_unstable();
        five.dedup();
        assert_eq!(five.len(), 5);
        poses.fill(1.0);
        assert_eq!(cover(&poses, 5), [0]);
    }
}
