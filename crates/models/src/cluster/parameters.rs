//! What a clustering is asked for.

use crate::{Error, Result};

/// How to cluster. The fields are free until [`KMeans::fit`] checks them.
#[derive(Debug, Clone, PartialEq)]
pub struct KMeans {
    /// Number of clusters, from 1 to the number of poses. Default 1.
    pub k: usize,
    /// Seed of the random choices. Default 0.
    pub seed: u64,
    /// Runs from different seeds, at least 1; the one with the least inertia is kept whole. In a
    /// tree, of every split. Default 1.
    pub restarts: usize,
    /// Updates of the centroids a run may take, at least 1. Default 100.
    pub max_iterations: usize,
    /// A run has converged when the squared shifts of its centroids add up to at most this times
    /// the mean variance of a coordinate (scikit-learn's rule). At 0: when no label changes.
    /// Default 1e-4.
    pub tolerance: f64,
    /// Children of a node, at least 2, to build a tree in place of a flat clustering. Default
    /// `None`.
    pub branch: Option<usize>,
    /// Clusters whose sizes differ by at most 1, with `branch` unset. Default `false`.
    pub balance: bool,
}

impl Default for KMeans {
    fn default() -> Self {
        KMeans {
            k: 1,
            seed: 0,
            restarts: 1,
            max_iterations: 100,
            tolerance: 1e-4,
            branch: None,
            balance: false,
        }
    }
}

impl KMeans {
    /// Checks what can be checked without the poses.
    ///
    /// # Errors
    /// Usage, naming the first value that is out of its range, and the range.
    pub(crate) fn check(&self) -> Result<()> {
        let what = if self.k == 0 {
            "k = 0 clusters: at least 1 is needed".to_string()
        } else if self.restarts == 0 {
            "0 restarts: at least 1 run is needed".to_string()
        } else if self.max_iterations == 0 {
            "0 iterations: at least 1 is needed".to_string()
        } else if !(self.tolerance >= 0.0 && self.tolerance.is_finite()) {
            format!("a tolerance of {}: it must be 0 or more", self.tolerance)
        } else if let Some(branch @ 0..2) = self.branch {
            format!("branch = {branch}: a node of the tree needs at least 2 children")
        } else if self.balance && self.branch.is_some() {
            "balance and branch exclude each other: clusters of equal size are made by halving"
                .to_string()
        } else {
            return Ok(());
        };
        Err(Error::usage(what))
    }
}

#[cfg(test)]
mod tests {
    use super::super::testdata::with_k;
    use super::*;

    #[test]
    fn parameters_out_of_range() {
        let refused = |parameters: KMeans| {
            assert_eq!(
                parameters.check().unwrap_err().exit_code(),
                2,
                "{parameters:?}"
            );
        };
        refused(with_k(0));
        refused(KMeans {
            restarts: 0,
            ..with_k(2)
        });
        refused(KMeans {
            max_iterations: 0,
            ..with_k(2)
        });
        refused(KMeans {
            tolerance: f64::NAN,
            ..with_k(2)
        });
        refused(KMeans {
            tolerance: -1.0,
            ..with_k(2)
        });
        refused(KMeans {
            branch: Some(1),
            ..with_k(2)
        });
        refused(KMeans {
            branch: Some(2),
            balance: true,
            ..with_k(2)
        });
        assert!(KMeans::default().check().is_ok());
    }
}
