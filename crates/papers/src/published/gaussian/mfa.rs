//! A mixture of factor analyzers (Ghahramani and Hinton 1996).
//!
//! ```text
//! x = m_j + L_j z + e,   z ~ N(0, I_q),   e ~ N(0, Ψ)     so that   C_j = L_j L_jᵀ + Ψ
//! B = M⁻¹ L_jᵀ Ψ⁻¹,   M = I + L_jᵀ Ψ⁻¹ L_j,   E = M⁻¹ + B S_j Bᵀ
//! L_j ← S_j Bᵀ E⁻¹,   Ψ ← Σ_j w_j diag(S_j − L_j B S_j)
//! ```
//!
//! L_j (D, q) is the analyzer's, the diagonal Ψ is common to all, S_j the moments of the E step
//! (`em`). Each round takes several such steps with the same responsibilities: they cost little
//! beside the E step, and none lowers the likelihood. EM starts from k-means, with each cluster's
//! principal components. The sizes are ours: neither Lai et al. nor Ghahramani and Hinton name any.

use super::em::{self, Fitted, Gaussian, Moments, Stop, clusters, weights};
use super::single::RIDGE;
use super::{MixtureKind, MixtureParams, roots};
use crate::Result;
use crate::numeric::linalg::symmetric_eigen;
use ndarray::{Array1, Array2, ArrayView2, Axis, concatenate, s};

/// Number of analyzers.
const ANALYZERS: usize = 20;
/// Factors of each analyzer.
const FACTORS: usize = 10;
/// Smallest mean number of poses per analyzer; fewer training poses give fewer analyzers.
const LEAST: usize = 30;
/// Factor-analysis steps per EM round, with the same responsibilities.
const STEPS: usize = 10;

/// The kind `mfa`.
pub(crate) const KIND: MixtureKind = MixtureKind::new("mfa", learn);

fn learn(xyz: ArrayView2<'_, f32>, seed: u64) -> Result<MixtureParams> {
    Ok(fit(xyz, (ANALYZERS, FACTORS), seed, Stop::default())?.0)
}

/// Fits a mixture of `analyzers` factor analyzers with at most `factors` factors each to poses (n,
/// D); returns the EM run, too.
///
/// # Errors
/// Those of clustering, which the fit starts from.
pub fn fit(
    xyz: ArrayView2<'_, f32>,
    (analyzers, factors): (usize, usize),
    seed: u64,
    stop: Stop,
) -> Result<(MixtureParams, Fitted)> {
    let start = clusters(xyz, analyzers, LEAST, seed)?;
    let mut analyzers = Analyzers::start(&start, factors.min(xyz.ncols()));
    let start = analyzers.update(&start);
    let fitted = em::fit(xyz, start, stop, &mut |m| analyzers.update(m));
    Ok((analyzers.parts(&fitted.mixture), fitted))
}

/// L_j and Ψ between EM rounds.
struct Analyzers {
    /// L_jᵀ (q, D) of each analyzer, cm.
    loadings: Vec<Array2<f64>>,
    /// Ψ (D), cm².
    noise: Array1<f64>,
}

impl Analyzers {
    /// Each cluster's leading principal components, and the mean variance outside them.
    fn start(moments: &[Moments], factors: usize) -> Analyzers {
        let d = moments.first().map_or(0, |m| m.mean.len());
        let mut noise = Array1::<f64>::zeros(d);
        let mut loadings = Vec::new();
        for (m, w) in moments.iter().zip(weights(moments)) {
            let roots = roots(&m.covariance);
            noise += &(roots
                .slice(s![factors.., ..])
                .mapv(|v| v * v)
                .sum_axis(Axis(0))
                * w);
            loadings.push(roots.slice(s![..factors, ..]).to_owned());
        }
        noise.mapv_inplace(|v| v.max(RIDGE));
        Analyzers { loadings, noise }
    }

    /// The M step: factor analysis on these moments. Returns the components.
    fn update(&mut self, moments: &[Moments]) -> Vec<Gaussian> {
        let weights = weights(moments);
        for _ in 0..STEPS {
            let mut noise = Array1::<f64>::zeros(self.noise.len());
            for ((m, w), loading) in moments.iter().zip(&weights).zip(&mut self.loadings) {
                noise.scaled_add(*w, &step(loading, &self.noise, &m.covariance));
            }
            self.noise = noise.mapv(|v| v.max(RIDGE));
        }
        let components = moments.iter().zip(weights).zip(&self.loadings);
        let components = components.map(|((m, weight), loading)| Gaussian {
            weight,
            mean: m.mean.clone(),
            covariance: loading.t().dot(loading) + Array2::from_diag(&self.noise),
        });
        components.collect()
    }

    fn parts(&self, mixture: &[Gaussian]) -> MixtureParams {
        let means: Vec<_> = mixture.iter().map(|g| g.mean.view()).collect();
        let factors: Vec<_> = self.loadings.iter().map(|l| l.view()).collect();
        let d = self.noise.len();
        MixtureParams {
            weights: mixture.iter().map(|g| g.weight).collect(),
            // All have one width.
            means: ndarray::stack(Axis(0), &means).unwrap_or_default(),
            factors: concatenate(Axis(0), &factors).unwrap_or_default(),
            rest: Array2::from_shape_fn((mixture.len(), d), |(_, i)| self.noise[i]),
        }
    }
}

/// One factor-analysis step of one analyzer: updates L, returns diag(S − L B S).
fn step(loading: &mut Array2<f64>, noise: &Array1<f64>, s: &Array2<f64>) -> Array1<f64> {
    // L here is Lᵀ (q, D): whitened = Lᵀ Ψ⁻¹.
    let whitened = &*loading / noise;
    let m = Array2::eye(loading.nrows()) + whitened.dot(&loading.t());
    let m = inverse(&m);
    let b = m.dot(&whitened);
    let bs = b.dot(s);
    let e = m + bs.dot(&b.t());
    // Lᵀ ← E⁻¹ B S, as S and E are symmetric.
    *loading = inverse(&e).dot(&bs);
    let explained = (&*loading * &bs).sum_axis(Axis(0));
    s.diag().to_owned() - explained
}

/// The inverse of a small positive definite matrix.
fn inverse(a: &Array2<f64>) -> Array2<f64> {
    let n = a.nrows();
    // LAPACK gives up on no symmetric matrix of finite numbers.
    let (values, vectors) = symmetric_eigen(a).unwrap_or((Array1::ones(n), Array2::eye(n)));
    (&vectors / &values.mapv(|v| v.max(f64::MIN_POSITIVE))).dot(&vectors.t())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::{blobs, factors, loading};

    const LONG: Stop = Stop {
        rounds: 2000,
        gain: 1e-9,
    };

    /// The mean log likelihood of one Gaussian about the poses' mean.
    fn likelihood(x: &Array2<f32>, covariance: Array2<f64>) -> f64 {
        let gaussian = Gaussian {
            weight: 1.0,
            mean: x.mapv(f64::from).sum_axis(Axis(0)) / x.nrows() as f64,
            covariance,
        };
        em::likelihood(x.view(), &[gaussian])
    }

    #[test]
    fn what_is_stored_is_factors_and_a_diagonal() {
        let (parts, fitted) = fit(blobs().view(), (3, 2), 0, Stop::default()).unwrap();
        assert_eq!(parts.factors.dim(), (3 * 2, 6));
        for (j, g) in fitted.mixture.iter().enumerate() {
            let l = parts.factors.slice(s![2 * j..2 * (j + 1), ..]);
            let want = l.t().dot(&l) + Array2::from_diag(&parts.rest.row(j));
            assert!((&want - &g.covariance).iter().all(|d| d.abs() <= 1e-9));
            assert!(
                (&want - &parts.covariance(j))
                    .iter()
                    .all(|d| d.abs() <= 1e-9)
            );
            // Ψ is common to all.
            assert_eq!(parts.rest.row(j), parts.rest.row(0));
        }
    }

    #[test]
    fn the_likelihood_never_falls() {
        for (x, size) in [(blobs(), (3, 2)), (factors(), (4, 1)), (factors(), (1, 3))] {
            let (_, fitted) = fit(x.view(), size, 1, LONG).unwrap();
            let likelihood = &fitted.likelihood;
            assert!(likelihood.len() > 2);
            let falls = |w: &[f64]| !(w[1] >= w[0] - 1e-10);
            assert!(!likelihood.windows(2).any(falls), "{likelihood:?}");
        }
    }

    #[test]
    fn a_planted_analyzer_is_found() {
        let x = factors();
        let (parts, _) = fit(x.view(), (1, 2), 0, LONG).unwrap();
        let found = likelihood(&x, parts.covariance(0));
        // What the poses were made with is less likely than what fits them best, but not by much.
        let noise: Array1<f64> = (0..9).map(|c| (0.5 + 0.1 * f64::from(c)).powi(2)).collect();
        let planted = loading().t().dot(&loading()) + Array2::from_diag(&noise);
        let planted = likelihood(&x, planted);
        assert!(
            found > planted && found < planted + 0.1,
            "{found} {planted}"
        );
        // A factor less cannot say it.
        let (fewer, _) = fit(x.view(), (1, 1), 0, LONG).unwrap();
        assert!(likelihood(&x, fewer.covariance(0)) < found - 1.0);
    }
}
