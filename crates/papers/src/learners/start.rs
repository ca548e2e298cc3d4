//! Where the learners that take steps begin.

use super::scatter::{pair_scatter, total_scatter};
use crate::Result;
use crate::metric::train::TrainingPairs;
use crate::numeric::linalg::symmetric_eigen;
use ndarray::{Array2, s};

/// A first map: `directions` times `scale`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Start {
    /// The first principal directions of all poses, unit columns (d, rank).
    pub directions: Array2<f64>,
    /// What makes the mean squared distance of alike pairs 1. Poses times this have a map of the
    /// size of `directions`, so that steps do not depend on the unit of the poses.
    pub scale: f64,
}

/// The start with `rank` directions, or d where that is less.
///
/// # Errors
/// [`crate::Error::Unfit`]: poses that are all the same.
pub(super) fn principal_start(pairs: &TrainingPairs<'_>, rank: usize) -> Result<Start> {
    let total = total_scatter(pairs.x);
    let d = total.nrows();
    let variance = total.diag().sum();
    if !(variance > 0.0) {
        return Err("all poses are the same".into());
    }
    let failed = "the principal components of the poses cannot be computed";
    let (_, vectors) = symmetric_eigen(&total).ok_or(failed)?;
    let first = vectors.slice(s![.., d - rank.min(d)..;-1]);
    let directions = first.as_standard_layout().into_owned();
    let alike = pair_scatter(pairs.x, pairs.alike).dot(&directions);
    let distance = (alike * &directions).sum();
    // Where alike poses are the same, the spread of all poses sets the scale.
    let scale = 1.0 / distance.max(1e-6 * variance).sqrt();
    Ok(Start { directions, scale })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn the_widest_direction_comes_first_and_alike_poses_are_one_apart() {
        let x = array![[0.0, 0.0], [6.0, 1.0], [-6.0, 1.0], [1.0, -2.0]];
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &[[0, 1], [2, 3]],
            unlike: &[],
        };
        for rank in [1, 2, 9] {
            let start = principal_start(&pairs, rank).unwrap();
            let w = start.directions * start.scale;
            assert_eq!(w.dim(), (2, rank.min(2)));
            assert!(w[[0, 0]].abs() > 5.0 * w[[1, 0]].abs());
            let alike = w.t().dot(&pair_scatter(x.view(), pairs.alike)).dot(&w);
            assert!((alike.diag().sum() - 1.0).abs() <= 1e-12);
        }
    }
}
