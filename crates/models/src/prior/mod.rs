//! Models of what poses look like: one trait, one file a model.
//!
//! A prior answers one question: given numbers for some coordinates of a pose, each with the
//! variance of its noise (0 exact, infinite missing), which pose is it, and how sure is that? Dense
//! noise, outliers and gaps are all variances, so denoising and completing are the same question.

mod builtin;
#[doc(hidden)]
pub mod exemplar;
#[cfg(test)]
mod kind_checks;
#[doc(hidden)]
pub mod model_arrays;
pub mod multiscale;
#[doc(hidden)]
pub mod noise_cache;
pub mod provenance;
#[doc(hidden)]
pub mod registry;
mod representative_poses;
pub mod rigid_pairs;
pub mod rotations;
pub mod sparse_coding;
#[cfg(test)]
mod testdata;
pub mod training_set;
pub mod tuning;
#[doc(hidden)]
pub mod up_directions;

use crate::numeric::parallel;
use crate::pose::{Observation, PoseTransform};
use crate::sparse::SelectionRule;
use ndarray::{Array2, ArrayView2};

pub use builtin::builtin_model;
pub use registry::{Kind, KindEntry, open, register};
pub use sparse_coding::SparseCodingPrior;
pub use training_set::{HoldBack, TrainOptions, TrainingSet};
pub use tuning::Task;

#[doc(hidden)]
pub use crate::numeric::gaussian::EXACT_VARIANCE;

/// Observations of a batch that one thread answers at a time.
const CHUNK: usize = 32;

/// How a model is used. A prior ignores the options that its kind does not know.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OpenOptions {
    /// The largest number of atoms of a pose; `None`: that of the training.
    pub sparsity: Option<usize>,
    /// How atoms are selected.
    pub rule: SelectionRule,
    /// Whether a sparse code's A x is the answer alone, as Lai et al. have it, without the
    /// correction by the residual covariance.
    pub published: bool,
    /// The task whose setting a tuned model uses for every observation. `None`: each observation's
    /// own. [`Task::Treated`] takes the stated variances as they are.
    pub task: Option<Task>,
}

/// How much of a posterior to compute; each costs more than the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Want {
    /// The mean.
    Mean,
    /// The mean and the variance of each coordinate.
    Variances,
    /// The mean, the variances and the full covariance.
    Covariance,
}

/// The posterior of a pose given an observation, N(mean, covariance), and the evidence of the
/// observation.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Posterior {
    /// (3 J), cm.
    pub mean: Vec<f64>,
    /// The variance of each coordinate (3 J), cm²: the diagonal of the covariance. Empty for
    /// [`Want::Mean`].
    pub variance: Vec<f64>,
    /// (3 J, 3 J), cm². Empty unless wanted.
    pub covariance: Array2<f64>,
    /// The log density of the observed values under the prior and their noise, nats (lengths in
    /// cm).
    pub log_evidence: f64,
}

impl Posterior {
    /// A posterior with its full covariance (3 J, 3 J).
    pub fn full(mean: Vec<f64>, covariance: Array2<f64>, log_evidence: f64) -> Posterior {
        Posterior {
            mean,
            variance: covariance.diag().to_vec(),
            covariance,
            log_evidence,
        }
    }
}

/// The closest pose that a prior can represent: the solution of P1a of Lai et al.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reconstruction {
    /// A x, the pose in the span of the chosen atoms (3 J), cm; the posterior mean for priors
    /// without atoms.
    pub pose: Vec<f64>,
    /// The indices of the chosen atoms; empty for priors without atoms.
    pub support: Vec<u32>,
    /// Σ (yᵢ − poseᵢ)² / (noise variance + residual variance) over the observed coordinates: the
    /// objective (7).
    pub objective: f64,
}

/// The log evidence of an observation, and how it changes as the observation moves along n
/// directions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EvidenceGradient {
    /// The log evidence, nats.
    pub log_evidence: f64,
    /// Its derivative along each direction (n).
    pub gradient: Vec<f64>,
    /// The negative Hessian, or a positive semidefinite approximation of it, (n, n) by rows.
    pub curvature: Vec<f64>,
}

/// A model of what poses look like, in the model's space.
///
/// Required are [`posterior`](Prior::posterior) and what placing a pose needs; the other methods
/// have defaults.
pub trait Prior: Send + Sync {
    /// The variance of what the model leaves unexplained in each coordinate (3 J), cm².
    fn residual_variance(&self) -> &[f64];

    /// The posterior of the pose given an observation in the model's space.
    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior;

    /// The posteriors of many observations, in order. Observations that follow one another in time
    /// or share their variances may cost less together; each result equals that of
    /// [`posterior`](Prior::posterior).
    fn posterior_batch(&self, batch: &[(Observation<'_>, Want)]) -> Vec<Posterior> {
        let one = |i: usize| self.posterior(&batch[i].0, batch[i].1);
        let chunks = parallel::map_chunks(batch.len(), CHUNK, |rows| rows.map(one).collect());
        chunks.into_iter().flat_map(|c: Vec<Posterior>| c).collect()
    }

    /// The closest pose of the model to an observation; never worse than the support of `previous`,
    /// refitted.
    fn reconstruct(
        &self,
        observation: &Observation<'_>,
        _previous: Option<&Reconstruction>,
    ) -> Reconstruction {
        let pose = self.posterior(observation, Want::Mean).mean;
        Reconstruction {
            objective: misfit(self, observation, &pose),
            support: Vec::new(),
            pose,
        }
    }

    /// The posterior with the support of a reconstruction of the same observation.
    fn posterior_given(
        &self,
        observation: &Observation<'_>,
        _reconstruction: &Reconstruction,
        want: Want,
    ) -> Posterior {
        self.posterior(observation, want)
    }

    /// The log evidence and its derivatives as the observation moves along `directions` ((3 J)
    /// each, cm): what a placement maximizes. `None`: the model is placed by its
    /// reconstructions instead.
    fn evidence_gradient(
        &self,
        _observation: &Observation<'_>,
        _directions: &[Vec<f64>],
    ) -> Option<EvidenceGradient> {
        None
    }

    /// How much less likely a complete pose (3 J, cm) is than nearly all poses that were held out
    /// of the training, nats: 0 or more. `None`: the model has no such threshold.
    fn novelty(&self, _pose: &[f64]) -> Option<f64> {
        None
    }

    /// The prior that takes the stated variances as they are. `None` if this one does; a tuned
    /// prior takes uneven variances for a guess and replaces them ([`tuning`]).
    fn untuned(&self) -> Option<&dyn Prior> {
        None
    }

    /// A few training poses, far apart, to start placements from: (k, 3 J), cm. A prior that is
    /// opened from a model has at least one; the default is none.
    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        ArrayView2::from(&[[]; 0] as &[[f64; 0]])
    }

    /// The training poses (n, 3 J), cm, if the model keeps them.
    fn training_poses(&self) -> Option<Array2<f64>> {
        None
    }

    /// The prior of poses that went through `map`.
    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior>;
}

/// Computes the posteriors of observations in the rows of `values` (n, 3 J) and `variance` (n, 3
/// J).
#[doc(hidden)]
pub fn posterior_rows<P: Prior + ?Sized>(
    prior: &P,
    values: ArrayView2<'_, f64>,
    variance: ArrayView2<'_, f64>,
    want: Want,
) -> Vec<Posterior> {
    let (values, variance) = (values.as_standard_layout(), variance.as_standard_layout());
    let rows = values.rows().into_iter().zip(variance.rows());
    let slices = rows.filter_map(|(values, variance)| values.to_slice().zip(variance.to_slice()));
    let batch: Vec<_> = slices
        .map(|(values, variance)| (Observation { values, variance }, want))
        .collect();
    prior.posterior_batch(&batch)
}

/// The objective of a [`Reconstruction`] with this pose (3 J).
fn misfit<P: Prior + ?Sized>(prior: &P, observation: &Observation<'_>, pose: &[f64]) -> f64 {
    let variances = observation.variance.iter().zip(prior.residual_variance());
    let terms = observation.values.iter().zip(pose).zip(variances);
    let observed = terms.filter(|(_, (n, _))| n.is_finite());
    observed
        .map(|((y, p), (n, v))| (y - p) * (y - p) / (n + v).max(EXACT_VARIANCE))
        .sum()
}
