//! Principal components: poses in the subspace that keeps 90% of the energy.
//!
//! ```text
//! x = m + U c + e,   c ~ N(0, Λ / λ),   e ~ N(0, σ² I)
//! ```
//!
//! U (D, q) and Λ are the leading eigenvectors and eigenvalues of the covariance, σ² the mean of
//! the other eigenvalues (Tipping and Bishop 1999). As published, the posterior mean lies in the
//! subspace: m + U c, with c given the observed coordinates. e is noise of the observed coordinates
//! and is not estimated; the posterior variance includes σ².

use super::em::moments_of;
use super::{MixtureKind, MixtureParams, Readout, Style, roots};
use crate::Result;
use ndarray::{Array2, ArrayView2, Axis, s};

/// Share of the eigenvalues' sum that is kept.
const ENERGY: f64 = 0.9;

/// The kind `pca`.
pub(crate) const KIND: MixtureKind = MixtureKind {
    name: "pca",
    style: Style {
        answer: Readout::Average,
        estimates_rest: false,
    },
    learn,
};

fn learn(xyz: ArrayView2<'_, f32>, _seed: u64) -> Result<MixtureParams> {
    let moments = moments_of(xyz, &vec![0; xyz.nrows()], 1).remove(0);
    let roots = roots(&moments.covariance);
    let energies: Vec<f64> = roots.rows().into_iter().map(|r| r.dot(&r)).collect();
    let (kept, left) = cut(&energies);
    Ok(MixtureParams {
        weights: vec![1.0],
        means: moments.mean.insert_axis(Axis(0)),
        factors: roots.slice(s![..kept, ..]).to_owned(),
        rest: Array2::from_elem((1, xyz.ncols()), left),
    })
}

/// The number of leading eigenvalues kept, at least one, and the mean of the others, cm².
fn cut(energies: &[f64]) -> (usize, f64) {
    let total: f64 = energies.iter().sum();
    let (mut kept, mut sum) = (0, 0.0);
    while kept < energies.len() && (kept == 0 || sum < ENERGY * total) {
        sum += energies[kept];
        kept += 1;
    }
    let left = energies[kept..].iter().sum::<f64>();
    (kept, left / (energies.len() - kept).max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::linalg::symmetric_eigen;
    use crate::testdata::factors;

    #[test]
    fn the_energy_wanted_is_kept_and_no_more() {
        assert_eq!(cut(&[8.0, 1.5, 0.5, 0.0]), (2, 0.25));
        assert_eq!(cut(&[9.0, 0.5, 0.5]), (1, 0.5));
        assert_eq!(cut(&[1.0, 1.0]), (2, 0.0));
        assert_eq!(cut(&[0.0, 0.0]), (1, 0.0));
    }

    #[test]
    fn the_subspace_is_that_of_the_leading_eigenvectors() {
        let x = factors();
        let parts = learn(x.view(), 0).unwrap();
        let away = x.mapv(f64::from) - parts.means.row(0);
        let (values, vectors) = symmetric_eigen(&(away.t().dot(&away) / 600.0)).unwrap();
        let leading = vectors.slice(s![.., 7..]);
        let lengths: Vec<f64> = parts
            .factors
            .rows()
            .into_iter()
            .map(|r| r.dot(&r))
            .collect();
        let mut ours = parts.factors.clone();
        for (mut row, length) in ours.rows_mut().into_iter().zip(&lengths) {
            row /= length.sqrt();
        }
        let (ours, theirs) = (ours.t().dot(&ours), leading.dot(&leading.t()));
        assert!((ours - theirs).iter().all(|d| d.abs() <= 1e-9));
        let left = values.slice(s![..7]).sum() / 7.0;
        assert!(parts.rest.iter().all(|r| (r / left - 1.0).abs() <= 1e-9));
        assert_eq!(lengths.len(), 2);
    }
}
