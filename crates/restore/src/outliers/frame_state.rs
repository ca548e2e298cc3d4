//! A frame in the search for outliers: which points are undecided, and what the others are.

use super::rigid_likelihood::{DistanceTerm, RigidLikelihood};
use super::tuning::frame_state::*;
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::{EXACT_VARIANCE, Posterior, Prior, Want, posterior_rows};
use crate::rigid::body_lengths::BodyMixture;
use ndarray::Array2;

/// A frame and what is decided of it.
pub(crate) struct FrameState {
    /// (3 J), cm.
    pub y: Vec<f64>,
    /// Noise variance of each clean coordinate, cm²; infinite where missing.
    pub noise_variance: Vec<f64>,
    /// The likelihood of outliers by rigid distances.
    pub likelihood: RigidLikelihood,
    /// The undecided points, ascending.
    pub undecided: Vec<usize>,
    /// Whether each point is an outlier, where decided.
    pub corrupt: Vec<bool>,
}

impl FrameState {
    /// Decides by the distances alone.
    pub(crate) fn new(
        pairs: &RigidPairs,
        bodies: &BodyMixture,
        y: Vec<f64>,
        mut noise_variance: Vec<f64>,
    ) -> FrameState {
        for (t, y) in noise_variance.iter_mut().zip(&y) {
            if !y.is_finite() {
                *t = f64::INFINITY;
            }
        }
        let likelihood = RigidLikelihood::new(pairs, bodies, &y, &noise_variance);
        let mut frame = FrameState {
            corrupt: Vec::new(),
            undecided: Vec::new(),
            y,
            noise_variance,
            likelihood,
        };
        frame.decide();
        frame
    }

    /// The number of points.
    pub(crate) fn points(&self) -> usize {
        self.y.len() / 3
    }

    /// Decides by the distances. The [`MOST`] least certain points are undecided; the others are
    /// what they more likely are.
    fn decide(&mut self) {
        let q = &self.likelihood.corrupt;
        self.corrupt = q.iter().map(|q| *q > 0.5).collect();
        self.undecided = (0..q.len())
            .filter(|&p| q[p] > SURE && q[p] < 1.0 - SURE)
            .collect();
        let from_even = |p: &usize| (q[*p] - 0.5).abs();
        self.undecided
            .sort_by(|a, b| from_even(a).total_cmp(&from_even(b)));
        self.undecided.truncate(MOST);
        self.undecided.sort_unstable();
    }

    /// Noise variances under an assignment. Without one, undecided points are missing, and outliers
    /// have at least the square of their worst distance.
    pub(crate) fn noise(&self, assigned: Option<&[bool]>) -> Vec<f64> {
        let mut out: Vec<f64> = self
            .noise_variance
            .iter()
            .map(|v| v.max(EXACT_VARIANCE))
            .collect();
        let of = |p: usize| match (self.undecided.iter().position(|d| *d == p), assigned) {
            (Some(_), None) => f64::INFINITY,
            (Some(at), Some(z)) if z[at] => self.likelihood.outlier_variance[p],
            (None, None) if self.corrupt[p] => {
                self.likelihood.outlier_variance[p].max(self.likelihood.farthest[p])
            }
            (None, Some(_)) if self.corrupt[p] => self.likelihood.outlier_variance[p],
            _ => 0.0,
        };
        for p in 0..out.len() / 3 {
            let least = of(p);
            out[3 * p..3 * p + 3]
                .iter_mut()
                .for_each(|v| *v = v.max(least));
        }
        out
    }

    /// Log density of the distances between a clean point and the points decided to be clean so
    /// far.
    pub(crate) fn clean_terms(&self, assigned: &[bool], p: usize) -> f64 {
        let clean = |q: usize| match self.undecided.iter().position(|d| *d == q) {
            _ if q == p => true,
            Some(at) => assigned.get(at).is_some_and(|z| !z),
            None => !self.corrupt[q],
        };
        let of = |t: &&DistanceTerm| t.ends.contains(&p) && t.ends.iter().all(|q| clean(*q));
        self.likelihood
            .terms
            .iter()
            .filter(of)
            .map(|t| t.clean)
            .sum()
    }
}

/// The prior's posteriors of `count` frames: the values and noise variances of each.
pub(crate) fn expected_by_prior<'a>(
    prior: &dyn Prior,
    count: usize,
    frame: impl Fn(usize) -> (&'a Vec<f64>, Vec<f64>),
) -> Vec<Posterior> {
    if count == 0 {
        return Vec::new();
    }
    let d = prior.residual_variance().len();
    let mut y = Array2::zeros((count, d));
    let mut noise = Array2::zeros((count, d));
    for i in 0..count {
        let (values, variances) = frame(i);
        for c in 0..d {
            // Missing values are never read; 0 keeps them finite.
            y[[i, c]] = if values[c].is_finite() {
                values[c]
            } else {
                0.0
            };
            noise[[i, c]] = variances[c];
        }
    }
    posterior_rows(prior, y.view(), noise.view(), Want::Covariance)
}
