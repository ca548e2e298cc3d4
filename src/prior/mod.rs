//! Models of what poses look like: one trait, one file a model.
//!
//! A prior answers one question: given numbers for some coordinates of a pose, each with the variance of its noise
//! (0 exact, infinite missing), which pose is it, and how sure is that? Dense noise, outliers and gaps are all
//! variances, so denoising and completing are the same question.

pub mod builtin;
pub mod exemplar;
pub mod gaussian;
pub mod gplvm;
mod model_arrays;
pub mod multiscale;
mod noise_cache;
pub mod provenance;
pub mod registry;
mod representative_poses;
pub mod rigid_pairs;
pub mod sparse_coding;
#[cfg(test)]
mod testdata;
pub mod training_set;
pub mod tuning;

use crate::pose::PoseTransform;
use ndarray::{Array2, ArrayView2};

pub use registry::open;
pub use sparse_coding::{OpenOptions, SparseCodingPrior};
pub use tuning::Task;

pub use crate::numeric::gaussian::EXACT_VARIANCE;

/// What a prior makes of an observation, to the point that the placement needs (the paper's P1a).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fit {
    /// The pose in the span of the chosen atoms (or the like), 3 J numbers.
    pub pose: Vec<f64>,
    /// What was chosen: the atoms' indices.
    pub support: Vec<u32>,
    /// Σ (yᵢ − poseᵢ)² / (noise variance + model variance) over the observed: the objective (7).
    pub objective: f64,
}

/// The answer: a pose and how sure it is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Posterior {
    /// 3 J numbers, cm.
    pub mean: Vec<f64>,
    /// The variance of each, cm².
    pub variance: Vec<f64>,
}

/// All that a prior has to say of an observation: a Gaussian over poses, and how well the prior explains it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Belief {
    /// 3 J numbers, cm.
    pub mean: Vec<f64>,
    /// (3 J, 3 J), cm².
    pub covariance: Array2<f64>,
    /// The log density of the observed coordinates under the prior and their noise, in nats (cm); what the outliers and
    /// the poses unlike any seen are found by.
    pub evidence: f64,
}

/// How the log evidence changes as an observation moves along some ways, n of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Slope {
    /// The log evidence.
    pub evidence: f64,
    /// Its derivative along each way (n).
    pub gradient: Vec<f64>,
    /// How fast the gradient falls, (n, n) by rows: positive semidefinite, at least the second derivative's part that is.
    pub curvature: Vec<f64>,
}

impl Belief {
    /// The mean and the variance of each coordinate.
    pub fn posterior(self) -> Posterior {
        Posterior {
            variance: self.covariance.diag().to_vec(),
            mean: self.mean,
        }
    }
}

/// What a prior believes, as much of it as was asked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Enough {
    /// All.
    Whole(Belief),
    /// Nothing of coordinates together.
    Apart(Posterior),
}

/// A model of what poses look like in the model's space.
///
/// An observation is 3 J numbers `y` (read where observed) and the variance `noise` of each, cm²: 0 exact, infinite
/// missing.
pub trait Prior: Send + Sync {
    /// Numbers a pose: 3 J.
    fn width(&self) -> usize;
    /// The variance of what the model leaves unexplained in each coordinate, cm².
    fn variance(&self) -> &[f64];
    /// What the pose is, given an observation.
    fn believe(&self, y: &[f64], noise: &[f64]) -> Belief;
    /// The mean alone, where no more is needed.
    fn mean(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        self.believe(y, noise).mean
    }
    /// The evidence alone, where no more is needed.
    fn evidence(&self, y: &[f64], noise: &[f64]) -> f64 {
        self.believe(y, noise).evidence
    }
    /// The same for many observations, one a row: (frames, 3 J) twice. Rows that follow one another in time, or share
    /// their noise, may cost less together.
    fn believe_all(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Vec<Belief> {
        let rows = y.rows().into_iter().zip(noise.rows());
        rows.map(|(y, noise)| self.believe(&y.to_vec(), &noise.to_vec()))
            .collect()
    }
    /// The same for one who does without the covariance of a row whose variances add up to that much (cm²; one number a
    /// row, infinite: never): such a row may say no more than how sure each coordinate is, if that costs less.
    fn believe_enough(
        &self,
        y: ArrayView2<'_, f64>,
        noise: ArrayView2<'_, f64>,
        _enough: &[f64],
    ) -> Vec<Enough> {
        let beliefs = self.believe_all(y, noise).into_iter();
        beliefs.map(Enough::Whole).collect()
    }
    /// The means alone of [`believe_all`](Prior::believe_all), (frames, 3 J), for those who need no more.
    fn means(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = Array2::zeros(y.dim());
        let rows = y.rows().into_iter().zip(noise.rows());
        for (mut row, (y, noise)) in out.rows_mut().into_iter().zip(rows) {
            let mean = self.mean(&y.to_vec(), &noise.to_vec());
            row.iter_mut().zip(mean).for_each(|(o, m)| *o = m);
        }
        out
    }
    /// The means of [`believe_all`](Prior::believe_all) and the variance of each coordinate, for those who need no more.
    fn posteriors(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Vec<Posterior> {
        let beliefs = self.believe_all(y, noise).into_iter();
        beliefs.map(Belief::posterior).collect()
    }
    /// The closest pose of the model to an observation. With `before`, never worse than that choice refitted.
    fn fit(&self, y: &[f64], noise: &[f64], _before: Option<&Fit>) -> Fit {
        let pose = self.mean(y, noise);
        Fit {
            objective: misfit(self, y, noise, &pose),
            support: Vec::new(),
            pose,
        }
    }
    /// The same for one of many observations with this noise: what serves them all may be made first.
    fn fit_often(&self, y: &[f64], noise: &[f64], before: Option<&Fit>) -> Fit {
        self.fit(y, noise, before)
    }
    /// How the evidence changes as the observation moves along some ways (3 J numbers each, those of what is observed are
    /// read): what a placement climbs by. `None` where a model is placed by its fits instead.
    fn slope(&self, _y: &[f64], _noise: &[f64], _moves: &[Vec<f64>]) -> Option<Slope> {
        None
    }
    /// The pose to answer with, once placed and fitted.
    fn posterior(&self, y: &[f64], noise: &[f64], _fit: &Fit) -> Posterior {
        self.believe(y, noise).posterior()
    }
    /// The same model at the setting in which the noise told is the noise there is, point by point; `None` where it
    /// always is. TaskSettings models take uneven noise for a guess otherwise.
    fn as_told(&self) -> Option<&dyn Prior> {
        None
    }
    /// How unlike all that the model has seen a whole pose is (3 J numbers, cm, in the model's space, none missing): by
    /// how many nats its log evidence lies below what nearly all poses have that the model was not learnt from. 0: not at
    /// all; `None`: the model knows no such limit.
    fn unlike(&self, _pose: &[f64]) -> Option<f64> {
        None
    }
    /// A few poses, far apart, that headings are found with: (k, 3 J).
    fn typical(&self) -> ArrayView2<'_, f64>;
    /// The same model of poses that went through `map`.
    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior>;
}

/// The objective of [`Fit`].
fn misfit<P: Prior + ?Sized>(prior: &P, y: &[f64], noise: &[f64], pose: &[f64]) -> f64 {
    let terms = y.iter().zip(pose).zip(noise.iter().zip(prior.variance()));
    let seen = terms.filter(|(_, (n, _))| n.is_finite());
    seen.map(|((y, p), (n, v))| (y - p) * (y - p) / (n + v).max(EXACT_VARIANCE))
        .sum()
}
