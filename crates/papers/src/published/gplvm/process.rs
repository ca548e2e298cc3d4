//! The Gaussian process from latent points to poses: what it predicts at a point, and how that
//! changes with it.

use crate::numeric::linalg::symmetric_eigen;
use crate::pose::PoseTransform;
use ndarray::{Array1, Array2, ArrayView2};

/// A learned process.
#[derive(Debug, Clone)]
pub(super) struct Learned {
    /// Active poses about the mean, (M, D).
    pub poses: Array2<f64>,
    /// (M, L).
    pub latent: Array2<f64>,
    /// γ.
    pub gamma: f64,
    /// ν.
    pub noise: f64,
    /// 1 / w_c², cm².
    pub scales: Vec<f64>,
    /// The mean pose.
    pub mean: Vec<f64>,
}

/// What predictions need.
#[derive(Debug)]
pub(crate) struct Process {
    /// Latent points of the active poses, (M, L).
    pub latent: Array2<f64>,
    /// γ.
    pub gamma: f64,
    /// ν.
    pub noise: f64,
    /// K⁻¹, (M, M).
    pub inverse: Array2<f64>,
    /// K⁻¹ Y, (M, D).
    pub weights: Array2<f64>,
    /// f at the active points, (M, D).
    pub fitted: Array2<f64>,
    /// 1 / w_c², cm².
    pub scales: Vec<f64>,
    /// The mean pose.
    pub mean: Vec<f64>,
}

/// f and σ² at a latent point, and their derivatives by it.
pub(crate) struct Prediction {
    /// (D), about the mean pose.
    pub f: Array1<f64>,
    /// σ².
    pub variance: f64,
    /// (L, D).
    pub slope: Array2<f64>,
    /// (L).
    pub variance_slope: Array1<f64>,
}

impl Process {
    /// From what was learned: factorizes K. `None` when K is not sound.
    pub(crate) fn new(learned: &Learned) -> Option<Process> {
        let (gamma, noise) = (learned.gamma, learned.noise);
        let kernel = kernel(learned.latent.view(), gamma, noise);
        let (values, vectors) = symmetric_eigen(&kernel)?;
        let scaled = &vectors / &values.mapv(|v| v.max(1e-12));
        let inverse = scaled.dot(&vectors.t());
        let weights = inverse.dot(&learned.poses);
        Some(Process {
            // (K − ν I) K⁻¹ Y.
            fitted: &learned.poses - &(&weights * noise),
            weights,
            latent: learned.latent.clone(),
            gamma,
            noise,
            inverse,
            scales: learned.scales.clone(),
            mean: learned.mean.clone(),
        })
    }

    /// f(x), σ²(x) and their derivatives. O(M² + M L D).
    pub(crate) fn predict(&self, x: &[f64]) -> Prediction {
        let (m, l) = self.latent.dim();
        let k: Array1<f64> = (0..m).map(|i| self.nearness(x, i)).collect();
        let solved = self.inverse.dot(&k);
        let rest = 1.0 + self.noise - k.dot(&solved);
        // σ² is at least the noise, but for rounding.
        let floored = !(rest > self.noise);
        let mut by_x = Array2::<f64>::zeros((l, m));
        for i in 0..m {
            for j in 0..l {
                by_x[[j, i]] = -self.gamma * (x[j] - self.latent[[i, j]]) * k[i];
            }
        }
        let scale = if floored { 0.0 } else { -2.0 };
        Prediction {
            f: k.dot(&self.weights),
            variance: rest.max(self.noise),
            slope: by_x.dot(&self.weights),
            variance_slope: by_x.dot(&solved) * scale,
        }
    }

    /// The process of poses that went through `map`.
    pub(crate) fn mapped(&self, map: &PoseTransform) -> Process {
        let scales = Array2::from_diag(&Array1::from(self.scales.clone()));
        let mut mean = vec![0.0; self.mean.len()];
        map.apply(&self.mean, &mut mean);
        Process {
            latent: self.latent.clone(),
            gamma: self.gamma,
            noise: self.noise,
            inverse: self.inverse.clone(),
            weights: map.apply_rows(self.weights.view()),
            fitted: map.apply_rows(self.fitted.view()),
            scales: map.apply_covariance(scales.view()).diag().to_vec(),
            mean,
        }
    }

    fn nearness(&self, x: &[f64], i: usize) -> f64 {
        let squares = x
            .iter()
            .zip(self.latent.row(i))
            .map(|(a, b)| (a - b) * (a - b));
        (-0.5 * self.gamma * squares.sum::<f64>()).exp()
    }
}

/// K of latent points (M, L).
pub(crate) fn kernel(latent: ArrayView2<'_, f64>, gamma: f64, noise: f64) -> Array2<f64> {
    let m = latent.nrows();
    let mut out = Array2::zeros((m, m));
    for i in 0..m {
        for j in 0..=i {
            let pairs = latent.row(i).into_iter().zip(latent.row(j));
            let squares: f64 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
            let own = if i == j { noise } else { 0.0 };
            out[[i, j]] = (-0.5 * gamma * squares).exp() + own;
            out[[j, i]] = out[[i, j]];
        }
    }
    out
}
