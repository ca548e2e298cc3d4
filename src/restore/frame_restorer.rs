//! One frame restored: placed, fitted, answered. The one function behind `denoise` and `complete`.

use super::placement::alternating::{PlacementSolution, PlacementSolver};
use super::placement::orthographic;
use super::rigid::{OutlierMode, RigidModel};
use crate::pose::Observation;
use crate::pose::{Anchor, Similarity, Status};
use crate::prior::{EXACT_VARIANCE, Posterior, Prior, Want};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

/// A restored frame, where the capture stands.
#[derive(Debug, Clone, PartialEq)]
pub struct RestoredFrame {
    /// 3 J numbers, cm.
    pub mean: Vec<f64>,
    /// The standard deviation of a coordinate of each point, cm (J).
    pub sd: Vec<f64>,
    /// Where the model's space stands.
    pub placement: Similarity,
}

/// Restored frames, in the model's order of points.
#[derive(Debug, Clone, Default)]
pub struct RestoredFrames {
    /// (frames, 3 J), cm.
    pub xyz: Array2<f64>,
    /// One a frame and point (frames x J).
    pub status: Vec<Status>,
    /// Standard deviation of a coordinate, cm (frames x J); NaN where unknown.
    pub sd: Vec<f64>,
    /// Frames in which too little was seen.
    pub too_little: usize,
    /// The noise that was assumed, cm: its mean over the frames.
    pub noise: f64,
    /// By how many nats each frame's pose is unlike all that the model has seen (frames), see [`Prior::novelty`]; NaN where
    /// the model knows no limit or did not restore the frame.
    pub unlike: Vec<f64>,
}

impl RestoredFrames {
    /// Frames as they were captured.
    pub fn of(xyz: Array2<f64>) -> RestoredFrames {
        let count = xyz.nrows() * xyz.ncols() / 3;
        let sd = vec![EXACT_VARIANCE.sqrt(); count];
        RestoredFrames {
            unlike: vec![f64::NAN; xyz.nrows()],
            xyz,
            status: vec![Status::Observed; count],
            sd,
            too_little: 0,
            noise: 0.0,
        }
    }
    /// How many points a frame has.
    pub fn points(&self) -> usize {
        self.xyz.ncols() / 3
    }
    /// Sets what became of a point.
    pub fn set(&mut self, frame: usize, point: usize, status: Status, sd: f64) {
        let at = frame * self.points() + point;
        self.status[at] = status;
        self.sd[at] = sd;
    }
    /// What became of a point, and how sure it is.
    pub fn of_point(&self, frame: usize, point: usize) -> (Status, f64) {
        let at = frame * self.points() + point;
        (self.status[at], self.sd[at])
    }
}

/// Restores frames with one prior.
pub struct FrameRestorer<'a> {
    /// What poses look like, for the captured body.
    pub prior: &'a dyn Prior,
    /// What poses are placed by; `None` uses rows as they are.
    pub anchor: Option<&'a Anchor>,
    /// How P1 is solved.
    pub solver: PlacementSolver,
    /// What is known of rigid distances; `None` keeps none.
    pub rigid: Option<&'a RigidModel>,
}

/// A pelvis this noisy (variance of a coordinate, cm²) gives no heading worth starting from alone.
const NOISY: f64 = 0.25;
/// A point this likely to be corrupt does not place a pose.
const IN_DOUBT: f64 = 0.05;

impl<'a> FrameRestorer<'a> {
    /// The same with a treatment, unless it knows nothing.
    pub fn with_rigid_model(mut self, rigid: &'a RigidModel) -> FrameRestorer<'a> {
        self.rigid = (!rigid.is_empty()).then_some(rigid);
        self
    }

    /// Restores one frame: 3 J numbers and the variance of each one's noise (infinite where missing).
    ///
    /// `None` when too little is seen: no point at all; or in world space fewer than three, or all on a line.
    pub fn restore(&self, y: &[f64], noise: &[f64]) -> Option<RestoredFrame> {
        let seen = Observation {
            values: y,
            variance: noise,
        };
        let Some(anchor) = self.anchor else {
            noise.iter().any(|n| n.is_finite()).then_some(())?;
            return Some(self.in_place(seen));
        };
        if seen.is_partial() {
            let known = self.stand_by_whole(anchor, seen);
            return orthographic::restore(self.prior, seen, &self.solver, known);
        }
        let Some(solution) = self.stand(anchor, seen)? else {
            return Some(self.in_place(seen));
        };
        let placement = solution.placement;
        let mut back = vec![0.0; y.len()];
        placement.undo_pose(y, &mut back);
        let noise = seen.pointwise_variance();
        let posterior = match self.corrected(&back, &noise, OutlierMode::Ignore) {
            Some(corrected) => corrected.0,
            None => {
                let seen = Observation {
                    values: &back,
                    variance: &noise,
                };
                match &solution.fit {
                    Some(fit) => self.prior.posterior_given(&seen, fit, Want::Variances),
                    None => self.prior.posterior(&seen, Want::Variances),
                }
            }
        };
        Some(placed(posterior, placement))
    }

    /// Where a frame stands: `None` when too little is seen to tell, `Some(None)` when it is in place already.
    fn stand(&self, anchor: &Anchor, seen: Observation<'_>) -> Option<Option<PlacementSolution>> {
        let visible = seen.values.iter().zip(seen.variance);
        let visible: Vec<f64> = visible
            .map(|(y, n)| if *n <= NOISY { *y } else { f64::NAN })
            .collect();
        let known = anchor.place(&visible);
        if known == Some(Similarity::IDENTITY) {
            return Some(None);
        }
        let known = known.as_slice();
        let solution = self.solver.solve(self.prior, seen, anchor, known)?;
        Some(Some(solution))
    }

    /// Where the points seen whole say that a frame stands; `None` where they are fewer than those seen in part, or too few.
    fn stand_by_whole(&self, anchor: &Anchor, seen: Observation<'_>) -> Option<Similarity> {
        let parts = seen.removable_partial_points();
        if parts.is_empty() {
            return None;
        }
        let noise = seen.variance_without(&parts);
        let only = Observation {
            values: seen.values,
            variance: &noise,
        };
        let solution = self.stand(anchor, only)?;
        Some(solution.map_or(Similarity::IDENTITY, |s| s.placement))
    }

    /// The placement that [`restore`](Restorer::restore) would find, without the answer.
    fn placement(&self, y: &[f64], noise: &[f64]) -> Option<Similarity> {
        let seen = Observation {
            values: y,
            variance: noise,
        };
        match self.anchor {
            None => noise
                .iter()
                .any(|n| n.is_finite())
                .then_some(Similarity::IDENTITY),
            Some(_) if seen.is_partial() => Some(self.restore(y, noise)?.placement),
            Some(anchor) => {
                let solution = self.stand(anchor, seen)?;
                Some(solution.map_or(Similarity::IDENTITY, |s| s.placement))
            }
        }
    }

    /// Restores a frame any points of which may be corrupt; `base` is the variance of a coordinate of clean ones, cm².
    /// The answer comes with the probability of each point to be corrupt.
    ///
    /// Bones need no placement: points in doubt by them are left out where the pose is placed.
    pub fn restore_outliers(&self, y: &[f64], base: f64) -> Option<(RestoredFrame, Vec<f64>)> {
        let noise_variance = |v: &f64| if v.is_finite() { base } else { f64::INFINITY };
        let noise_variance: Vec<f64> = y.iter().map(noise_variance).collect();
        let outlier_probabilities = self.rigid?.outlier_probabilities(y, &noise_variance);
        let noise = (noise_variance.iter().enumerate()).map(|(i, n)| {
            if outlier_probabilities[i / 3] > IN_DOUBT {
                f64::INFINITY
            } else {
                *n
            }
        });
        let noise: Vec<f64> = noise.collect();
        let placement = self.placement(y, &noise)?;
        let mut back = vec![0.0; y.len()];
        placement.undo_pose(y, &mut back);
        let (posterior, corrupt) = self.corrected(&back, &noise_variance, OutlierMode::Search)?;
        let mut restored = placed(posterior, placement);
        for (i, noise_variance) in noise_variance.iter().enumerate() {
            // There and back again is not quite where it was.
            if *noise_variance <= EXACT_VARIANCE && corrupt.get(i / 3).is_none_or(|q| *q <= 0.0) {
                restored.mean[i] = y[i];
            }
        }
        Some((restored, corrupt))
    }

    /// By how many nats a whole pose (3 J), which stands where `placement` says, is unlike all that the model has seen; NaN
    /// where the model knows no limit.
    pub fn unlike(&self, pose: &[f64], placement: &Similarity) -> f64 {
        // Poses were learnt from as their pelvis placed them; where few points placed the answer, it may stand otherwise.
        let anchor = self.anchor.filter(|a| a.root.is_some());
        let placement = anchor.and_then(|a| a.place(pose)).unwrap_or(*placement);
        let mut back = vec![0.0; pose.len()];
        placement.undo_pose(pose, &mut back);
        self.prior.novelty(&back).unwrap_or(f64::NAN)
    }

    /// The answer in the model's space with rigid distances kept, and who is corrupt; `None` where nothing is known.
    fn corrected(
        &self,
        y: &[f64],
        noise: &[f64],
        mode: OutlierMode,
    ) -> Option<(Posterior, Vec<f64>)> {
        let rigid = self.rigid.filter(|t| !t.is_empty())?;
        let shape = (1, y.len());
        let (y, noise) = (
            ArrayView2::from_shape(shape, y).ok()?,
            ArrayView2::from_shape(shape, noise).ok()?,
        );
        let corrected = rigid.restore(self.prior, y, noise, mode).pop()?;
        Some((corrected.posterior, corrected.corrupt))
    }

    fn in_place(&self, seen: Observation<'_>) -> RestoredFrame {
        let posterior = match self.corrected(seen.values, seen.variance, OutlierMode::Ignore) {
            Some(corrected) => corrected.0,
            None => self.prior.posterior(&seen, Want::Variances),
        };
        RestoredFrame {
            sd: point_sd(&posterior.variance),
            mean: posterior.mean,
            placement: Similarity::IDENTITY,
        }
    }
}

/// An answer carried to where the capture stands.
fn placed(posterior: Posterior, placement: Similarity) -> RestoredFrame {
    let mut mean = vec![0.0; posterior.mean.len()];
    placement.apply_pose(&posterior.mean, &mut mean);
    RestoredFrame {
        mean,
        sd: point_sd(&posterior.variance),
        placement,
    }
}

/// The standard deviation of a coordinate of each point: the root of the mean of its variances.
pub fn point_sd(variance: &[f64]) -> Vec<f64> {
    variance
        .chunks_exact(3)
        .map(|v| (v.iter().sum::<f64>() / 3.0).sqrt())
        .collect()
}

/// How far a point was moved, cm.
pub fn moved(a: &[f64], b: &[f64], point: usize) -> f64 {
    (DVec3::from_slice(&a[3 * point..]) - DVec3::from_slice(&b[3 * point..])).length()
}
