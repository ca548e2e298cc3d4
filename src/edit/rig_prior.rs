//! The prior of the poses of a rig: a model, carried to the rig's bone lengths.

use super::rig::Rig;
use crate::Result;
use crate::io::Model;
use crate::pose::{Anchor, Poses};
use crate::prior::{OpenOptions, Prior, Task};
use crate::restore::placement::PlacementSolver;
use crate::restore::{FrameRestorer, PlacedPrior};
use ndarray::Array2;

/// Iterations of a placement: while a joint is dragged, the next pose goes on from where this one
/// ends.
const ITERATIONS: usize = 8;

/// A model in memory, of its own body still.
pub struct OpenedModel {
    placed: PlacedPrior,
    /// The names of its points (J).
    points: Vec<String>,
}

impl OpenedModel {
    /// Opens a model; `source` names it in errors.
    ///
    /// # Errors
    /// As [`prior::open`](crate::prior::open).
    pub fn open(model: &Model, source: &str) -> Result<OpenedModel> {
        // The stated variances are what the user asks for: no task's own setting replaces them.
        let options = OpenOptions {
            task: Some(Task::Treated),
            ..OpenOptions::default()
        };
        Ok(OpenedModel {
            placed: PlacedPrior::open(model, &options, source, true)?,
            points: model.meta.points.clone(),
        })
    }

    /// The names of its points (J).
    pub fn points(&self) -> &[String] {
        &self.points
    }

    /// A few of its training poses, far apart, in its own space.
    pub fn typical_poses(&self) -> Poses {
        Poses {
            points: self.points.clone(),
            xyz: self.placed.prior.representative_poses().to_owned(),
            ..Poses::default()
        }
    }

    /// The prior of the poses of a rig.
    pub fn for_rig(self, rig: &Rig) -> RigPrior {
        let rest = rest_pose(rig, self.points.len());
        let adapted = self.placed.for_body(rest.view(), 0.0);
        RigPrior {
            prior: adapted.unwrap_or(self.placed.prior),
            anchor: self.placed.anchor,
            placement: PlacementSolver {
                iterations: ITERATIONS,
                ..PlacementSolver::default()
            },
            names: self.points,
        }
    }
}

/// A prior of the poses of one body, and how they are placed.
pub struct RigPrior {
    prior: Box<dyn Prior>,
    anchor: Option<Anchor>,
    placement: PlacementSolver,
    /// The names of the model's points (J).
    pub names: Vec<String>,
}

impl RigPrior {
    /// Opens a model named `source` for the body of `rig`.
    ///
    /// # Errors
    /// As [`OpenedModel::open`].
    pub fn open(model: &Model, source: &str, rig: &Rig) -> Result<RigPrior> {
        Ok(OpenedModel::open(model, source)?.for_rig(rig))
    }

    /// The number of the model's points, J.
    pub fn points(&self) -> usize {
        self.names.len()
    }

    /// Restores observations (3 J) of the body: see [`FrameRestorer`]. No rigid distances are kept,
    /// inverse kinematics does that.
    pub fn restorer(&self) -> FrameRestorer<'_> {
        FrameRestorer {
            prior: &*self.prior,
            anchor: self.anchor.as_ref(),
            solver: &self.placement,
            rigid: None,
        }
    }

    /// A few training poses of this body, far apart, in the model's space: (k, 3 J), cm.
    pub fn representative_poses(&self) -> Array2<f64> {
        self.prior.representative_poses().to_owned()
    }
}

/// The joints of the rest posture in the model's order, one frame.
fn rest_pose(rig: &Rig, points: usize) -> Array2<f64> {
    let rest = rig.positions(&vec![0.0; rig.skeleton.dof_count()]);
    let rest = rig.to_model(&rest, points);
    Array2::from_shape_fn((1, rest.len()), |(_, c)| rest[c])
}
