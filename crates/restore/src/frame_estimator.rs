//! The estimate of one frame, behind completing and denoising.
//!
//! ```text
//! y ~ N(s R x + t, diag(r)),   x ~ prior:
//!     (R, t) first, then E[x | y, R, t], then its projection onto rigid distances
//! ```
//!
//! y (3 J, cm) is the frame, r (3 J, cm²) its noise variances, R and t the placement of the model's
//! space.

use super::placement::orthographic;
use super::placement::{PlacementSolution, PlacementSolver};
use super::rigid::{Corrected, OutlierMode, RigidModel};
use super::tuning::frame_estimator::*;
use crate::pose::{Anchor, Observation, Similarity};
use crate::prior::{EXACT_VARIANCE, Posterior, Prior, Want};
use glam::DVec3;
use ndarray::ArrayView2;

/// The estimate of a frame, in world space.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameEstimate {
    /// (3 J), cm.
    pub mean: Vec<f64>,
    /// Standard deviation of a coordinate of each point (J), cm.
    pub sd: Vec<f64>,
    /// Transform from the model's space to the world.
    pub placement: Similarity,
}

/// Estimates frames with one prior.
pub struct FrameEstimator<'a> {
    /// The prior of poses of the captured body.
    pub prior: &'a dyn Prior,
    /// The root's frame; `None` takes frames for poses in the model's space.
    pub anchor: Option<&'a Anchor>,
    /// Finds placements.
    pub solver: &'a PlacementSolver,
    /// The rigid distances; `None` keeps none.
    pub rigid: Option<&'a RigidModel>,
}

impl<'a> FrameEstimator<'a> {
    /// Keeps the rigid distances of `rigid`, unless it has none.
    pub(crate) fn with_rigid_model(mut self, rigid: &'a RigidModel) -> Self {
        self.rigid = (!rigid.is_empty()).then_some(rigid);
        self
    }

    /// Estimates one frame: `y` (3 J, cm) and the noise variance of each coordinate (cm², infinite
    /// where missing).
    ///
    /// `None` when too little is seen: no coordinate at all; in world space fewer than three
    /// points, or all on a line.
    #[doc(hidden)]
    pub fn estimate(&self, y: &[f64], noise: &[f64]) -> Option<FrameEstimate> {
        let seen = observation(y, noise);
        if self.anchor.is_some() && seen.is_partial() {
            let known = self.placement_by_whole_points(seen);
            let (posterior, placement) =
                orthographic::restore(self.prior, seen, self.solver, known)?;
            return Some(FrameEstimate {
                mean: posterior.mean,
                sd: point_sd(&posterior.variance),
                placement,
            });
        }
        Some(self.estimate_placed(seen, &self.solve_placement(seen)?))
    }

    /// Estimates one frame as [`FrameEstimator::estimate`] does, its placement found from that of
    /// the solution `before`; for a pose that is edited, whose frames follow one another closely.
    #[doc(hidden)]
    pub fn follow(
        &self,
        y: &[f64],
        noise: &[f64],
        before: &PlacementSolution,
    ) -> Option<(FrameEstimate, PlacementSolution)> {
        let seen = observation(y, noise);
        let solution = (self.solver).follow(self.prior, seen, self.anchor?, before)?;
        Some((self.estimate_placed(seen, &solution), solution))
    }

    /// Estimates a frame whose placement is known.
    pub(crate) fn estimate_placed(
        &self,
        seen: Observation<'_>,
        solution: &PlacementSolution,
    ) -> FrameEstimate {
        let placement = solution.placement;
        if placement == Similarity::IDENTITY {
            return placed(self.posterior(seen, solution), placement);
        }
        let mut in_model = vec![0.0; seen.dimension()];
        placement.undo_pose(seen.values, &mut in_model);
        let noise = seen.pointwise_variance();
        placed(
            self.posterior(observation(&in_model, &noise), solution),
            placement,
        )
    }

    /// The posterior in the model's space.
    fn posterior(&self, seen: Observation<'_>, solution: &PlacementSolution) -> Posterior {
        if let Some(corrected) = self.corrected(seen, OutlierMode::Ignore) {
            return corrected.posterior;
        }
        match &solution.fit {
            Some(fit) => self.prior.posterior_given(&seen, fit, Want::Variances),
            None => self.prior.posterior(&seen, Want::Variances),
        }
    }

    /// The placement of a frame of whole points; `None` when too little is seen.
    fn solve_placement(&self, seen: Observation<'_>) -> Option<PlacementSolution> {
        let identity = PlacementSolution::from_placement(Similarity::IDENTITY);
        let Some(anchor) = self.anchor else {
            let is_any_seen = seen.variance.iter().any(|v| v.is_finite());
            return is_any_seen.then_some(identity);
        };
        let precise = seen.values.iter().zip(seen.variance);
        let precise: Vec<f64> = precise
            .map(|(y, v)| if *v <= NOISY { *y } else { f64::NAN })
            .collect();
        let known = anchor.place(&precise);
        if known == Some(Similarity::IDENTITY) {
            return Some(identity);
        }
        self.solver
            .solve(self.prior, seen, anchor, known.as_slice())
    }

    /// The placement by the whole points alone; `None` where they are fewer than the partial ones,
    /// or too few.
    fn placement_by_whole_points(&self, seen: Observation<'_>) -> Option<Similarity> {
        let partial = seen.removable_partial_points();
        if partial.is_empty() {
            return None;
        }
        let noise = seen.variance_without(&partial);
        let solution = self.solve_placement(observation(seen.values, &noise))?;
        Some(solution.placement)
    }

    /// Estimates a frame any points of which may be outliers; `variance` is that of the coordinates
    /// of clean points, cm². Returns also the probability of each point to be an outlier (J).
    /// `None` when too little is seen, or nothing rigid is known.
    ///
    /// Distances need no placement: points that they make suspect are left out where the pose is
    /// placed.
    pub(crate) fn estimate_with_outliers(
        &self,
        y: &[f64],
        variance: f64,
    ) -> Option<(FrameEstimate, Vec<f64>)> {
        let clean = |v: &f64| {
            if v.is_finite() {
                variance
            } else {
                f64::INFINITY
            }
        };
        let clean: Vec<f64> = y.iter().map(clean).collect();
        let by_distances = self.rigid?.outlier_probabilities(y, &clean);
        let suspects: Vec<usize> = (0..by_distances.len())
            .filter(|&p| by_distances[p] > SUSPECT)
            .collect();
        let noise = observation(y, &clean).variance_without(&suspects);
        let seen = observation(y, &noise);
        let placement = match self.anchor {
            Some(_) if seen.is_partial() => self.estimate(y, &noise)?.placement,
            _ => self.solve_placement(seen)?.placement,
        };
        let mut in_model = vec![0.0; y.len()];
        placement.undo_pose(y, &mut in_model);
        let seen = observation(&in_model, &clean);
        let corrected = self.corrected(seen, OutlierMode::Search)?;
        let mut found = placed(corrected.posterior, placement);
        let probability = corrected.corrupt;
        for (i, variance) in clean.iter().enumerate() {
            // The way to the model's space and back rounds.
            if *variance <= EXACT_VARIANCE && probability.get(i / 3).is_none_or(|q| *q <= 0.0) {
                found.mean[i] = y[i];
            }
        }
        Some((found, probability))
    }

    /// Novelty of a complete pose (3 J, world space) at a placement, nats; see [`Prior::novelty`].
    /// NaN where the prior has no threshold.
    #[doc(hidden)]
    pub fn novelty(&self, pose: &[f64], placement: &Similarity) -> f64 {
        // Training poses were placed by their pelvis; an estimate from few points may be placed
        // otherwise.
        let anchor = self.anchor.filter(|a| a.root.is_some());
        let placement = anchor.and_then(|a| a.place(pose)).unwrap_or(*placement);
        let mut in_model = vec![0.0; pose.len()];
        placement.undo_pose(pose, &mut in_model);
        self.prior.novelty(&in_model).unwrap_or(f64::NAN)
    }

    /// The estimate in the model's space with rigid distances; `None` where none are known.
    fn corrected(&self, seen: Observation<'_>, mode: OutlierMode) -> Option<Corrected> {
        let rigid = self.rigid.filter(|t| !t.is_empty())?;
        let row = |values| ArrayView2::from_shape((1, seen.dimension()), values).ok();
        let (y, noise) = (row(seen.values)?, row(seen.variance)?);
        rigid.restore(self.prior, y, noise, mode).pop()
    }
}

fn observation<'a>(values: &'a [f64], variance: &'a [f64]) -> Observation<'a> {
    Observation { values, variance }
}

/// A posterior carried to the world.
fn placed(posterior: Posterior, placement: Similarity) -> FrameEstimate {
    let mut mean = posterior.mean;
    if placement != Similarity::IDENTITY {
        let in_model = mean.clone();
        placement.apply_pose(&in_model, &mut mean);
    }
    FrameEstimate {
        mean,
        sd: point_sd(&posterior.variance),
        placement,
    }
}

/// Standard deviation of a coordinate of each point (J): the root of the mean of its three
/// variances.
pub fn point_sd(variance: &[f64]) -> Vec<f64> {
    variance
        .chunks_exact(3)
        .map(|v| (v.iter().sum::<f64>() / 3.0).sqrt())
        .collect()
}

/// The distance between a point's positions in two poses, cm.
pub(crate) fn displacement(a: &[f64], b: &[f64], point: usize) -> f64 {
    (DVec3::from_slice(&a[3 * point..]) - DVec3::from_slice(&b[3 * point..])).length()
}
