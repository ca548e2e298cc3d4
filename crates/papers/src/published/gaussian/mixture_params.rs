//! Gaussians as they are stored, whatever the kind.

use crate::io::Model;
use crate::numeric::linalg::symmetric_eigen;
use crate::prior::model_arrays;
use crate::{Error, Place, Result};
use ndarray::{Array2, s};

/// Gaussians as they are stored: C_j = F_jᵀ F_j + diag(rest_j), whatever the kind.
#[derive(Debug, Clone, PartialEq)]
pub struct MixtureParams {
    /// (K), above 0, adding up to 1.
    pub weights: Vec<f64>,
    /// (K, D), cm.
    pub means: Array2<f64>,
    /// (K q, D), cm: q rows per component, one after the other.
    pub factors: Array2<f64>,
    /// (K, D), cm², at least 0.
    pub rest: Array2<f64>,
}

impl MixtureParams {
    /// From full covariances (D, D) of which the factors are the scaled eigenvectors: exact, and
    /// sound in f32.
    pub(crate) fn of_covariances(
        weights: Vec<f64>,
        means: Array2<f64>,
        covariances: &[Array2<f64>],
    ) -> MixtureParams {
        let (k, d) = means.dim();
        let mut factors = Array2::zeros((k * d, d));
        for (j, covariance) in covariances.iter().enumerate() {
            let rows = s![j * d..(j + 1) * d, ..];
            factors.slice_mut(rows).assign(&roots(covariance));
        }
        MixtureParams {
            weights,
            rest: Array2::zeros(means.dim()),
            means,
            factors,
        }
    }

    /// The number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.weights.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }

    /// F_jᵀ F_j.
    pub(crate) fn explained(&self, j: usize) -> Array2<f64> {
        let q = self.factors.nrows() / self.len().max(1);
        let f = self.factors.slice(s![j * q..(j + 1) * q, ..]);
        f.t().dot(&f)
    }

    /// C_j.
    pub(crate) fn covariance(&self, j: usize) -> Array2<f64> {
        let mut c = self.explained(j);
        c.diag_mut().zip_mut_with(&self.rest.row(j), |c, r| *c += r);
        c
    }

    /// Stores them as the arrays `weights` (K, 1), `means`, `factors` and `rest`.
    pub(crate) fn write(&self, model: &mut Model) {
        let weights = Array2::from_shape_fn((self.len(), 1), |(j, _)| self.weights[j]);
        for (name, array) in [
            ("weights", &weights),
            ("means", &self.means),
            ("factors", &self.factors),
            ("rest", &self.rest),
        ] {
            model.insert(name, array.mapv(|v| v as f32));
        }
    }

    /// Reads what `MixtureParams::write` left.
    ///
    /// # Errors
    /// Data: arrays that are not there, do not fit together, or hold what is not finite or out of
    /// range.
    pub fn read(model: &Model, source: &str) -> Result<MixtureParams> {
        let d = 3 * model.meta.points.len();
        let wrong = |name: &str, what: &str| Err(Error::data(Place::file(source).part(name), what));
        let array = |name: &str, rows, columns| {
            let array = model_arrays::array(model, name, (rows, Some(columns)), source);
            array.map(|a| a.mapv(f64::from))
        };
        let weights = array("weights", None, 1)?;
        let k = weights.len();
        let (means, factors) = (array("means", Some(k), d)?, array("factors", None, d)?);
        let rest = array("rest", Some(k), d)?;
        if weights.iter().any(|w| *w < 0.0) || !(weights.sum() > 0.0) {
            return wrong("weights", "must be positive");
        }
        if !factors.nrows().is_multiple_of(k) || factors.nrows() > k * d {
            return wrong("factors", "does not have as many rows for each Gaussian");
        }
        if rest.iter().any(|v| *v < 0.0) {
            return wrong("rest", "holds a variance below 0");
        }
        let sum = weights.sum();
        Ok(MixtureParams {
            weights: weights.iter().map(|w| w / sum).collect(),
            means,
            factors,
            rest,
        })
    }
}

/// The rows whose products make up a covariance: √λ_i v_iᵀ, the largest first.
pub fn roots(covariance: &Array2<f64>) -> Array2<f64> {
    let d = covariance.nrows();
    let mut out = Array2::zeros((d, d));
    // LAPACK gives up on no symmetric matrix of finite numbers.
    if let Some((values, vectors)) = symmetric_eigen(covariance) {
        for i in 0..d {
            let scale = values[i].max(0.0).sqrt();
            out.row_mut(d - 1 - i).assign(&(&vectors.column(i) * scale));
        }
    }
    out
}

/// For tests: three Gaussians of two points, each with two factors and a residual variance.
#[cfg(test)]
pub(crate) fn three() -> MixtureParams {
    MixtureParams {
        weights: vec![0.5, 0.3, 0.2],
        means: crate::testdata::normal(3, 6, 11) * 3.0,
        factors: crate::testdata::normal(6, 6, 12) * 2.0,
        rest: Array2::from_shape_fn((3, 6), |(j, c)| 0.2 + 0.1 * (j + c) as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_gives_them_back_and_damage_is_told() {
        let points = ["a", "b"].map(String::from);
        let mut model = Model::new("mixture", &points, "body");
        three().write(&mut model);
        let back = MixtureParams::read(&model, "m").unwrap();
        for j in 0..3 {
            let off = back.covariance(j) - three().covariance(j);
            assert!(off.iter().all(|d| d.abs() <= 1e-4));
        }
        for (name, value, what) in [("weights", -1.0, "positive"), ("rest", -0.1, "below 0")] {
            let mut broken = model.clone();
            let mut array = broken.get(name).unwrap().into_owned();
            array[[0, 0]] = value;
            broken.insert(name, array);
            let error = MixtureParams::read(&broken, "m").unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(what), "{error}");
        }
    }
}
