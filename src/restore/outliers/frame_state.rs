//! A frame some points of which may be corrupt: which are in doubt, and what the others are.

use super::rigid_likelihood::{DistanceTerm, RigidLikelihood};
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::{EXACT_VARIANCE, Posterior, Prior, Want, posterior_rows};
use crate::restore::rigid::body_lengths::BodyMixture;
use ndarray::Array2;

/// Points less sure than this to be clean, or corrupt, are in doubt.
pub const SURE: f64 = 0.01;
/// At most so many points are hidden from the prior at a time.
pub const MOST: usize = 12;

/// What is known of a frame before the prior is asked.
pub struct FrameState {
    /// 3 J numbers, cm.
    pub y: Vec<f64>,
    /// The variance of each number's noise where it is clean, cm²; infinite missing.
    pub noise_variance: Vec<f64>,
    /// What its distances tell.
    pub likelihood: RigidLikelihood,
    /// In doubt, ascending.
    pub undecided: Vec<usize>,
    /// Corrupt, as far as it is decided.
    pub corrupt: Vec<bool>,
}

impl FrameState {
    /// As far as the distances tell.
    pub fn new(
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

    /// How many points it has.
    pub fn points(&self) -> usize {
        self.y.len() / 3
    }

    /// Decides what the distances and the log odds of each point by itself (−∞: it is not corrupt) leave no doubt of; of
    /// the rest, the [`MOST`] doubtful are in doubt; the others are what they more likely are.
    pub fn judge(&mut self, unary: &[f64]) {
        self.likelihood.corrupt = self.likelihood.marginals(unary);
        self.decide();
        if self.undecided.len() > MOST {
            let q = &self.likelihood.corrupt;
            self.undecided
                .sort_by(|a, b| (q[*a] - 0.5).abs().total_cmp(&(q[*b] - 0.5).abs()));
            self.undecided.truncate(MOST);
            self.undecided.sort_unstable();
        }
    }

    fn decide(&mut self) {
        let q = &self.likelihood.corrupt;
        self.corrupt = q.iter().map(|q| *q > 0.5).collect();
        self.undecided = (0..q.len())
            .filter(|&p| q[p] > SURE && q[p] < 1.0 - SURE)
            .collect();
    }

    /// The noise under an assignment. Where there is none, points in doubt are missing, and those decided to be corrupt may
    /// be as far off as their worst distance tells.
    pub fn noise(&self, assigned: Option<&[bool]>) -> Vec<f64> {
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

    /// What the distances of a point that is taken for clean to clean ones tell, of those decided so far.
    pub fn clean_terms(&self, assigned: &[bool], p: usize) -> f64 {
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

/// Asks the prior for some rows at once.
pub fn expected_by_prior(
    prior: &dyn Prior,
    rows: &[usize],
    of: impl Fn(usize) -> (Vec<f64>, Vec<f64>),
) -> Vec<Posterior> {
    if rows.is_empty() {
        return Vec::new();
    }
    let d = prior.residual_variance().len();
    let (mut y, mut noise) = (
        Array2::zeros((rows.len(), d)),
        Array2::zeros((rows.len(), d)),
    );
    for (i, row) in rows.iter().enumerate() {
        let (a, b) = of(*row);
        for c in 0..d {
            // What is missing is read nowhere, but nothing should hang on that.
            y[[i, c]] = if a[c].is_finite() { a[c] } else { 0.0 };
            noise[[i, c]] = b[c];
        }
    }
    posterior_rows(prior, y.view(), noise.view(), Want::Covariance)
}
