//! The prior of the poses of a rig: a model, carried to the rig's bone lengths.

use super::rig::Rig;
use crate::Result;
use crate::io::Model;
use crate::pose::{Anchor, Body, Poses, joints};
use crate::prior::{self, OpenOptions, Prior, Task};
use crate::restore::FrameRestorer;
use crate::restore::body_adaptation::map_to;
use crate::restore::placement::PlacementSolver;
use ndarray::Array2;

/// Iterations of a placement: while a joint is dragged, the next pose goes on from where this one ends.
const ITERATIONS: usize = 8;

/// A prior of the poses of one body, and how they are placed.
pub struct RigPrior {
    prior: Box<dyn Prior>,
    anchor: Anchor,
    placement: PlacementSolver,
    /// The names of the model's points (J).
    pub names: Vec<String>,
    /// The number of the model's points, J.
    pub points: usize,
}

impl RigPrior {
    /// Opens a model named `source` for the body of `rig`.
    ///
    /// # Errors
    /// As [`prior::open`].
    pub fn open(model: &Model, source: &str, rig: &Rig) -> Result<RigPrior> {
        // The stated variances are what the user asks for: no task's own setting replaces them.
        let options = OpenOptions {
            task: Some(Task::Treated),
            ..OpenOptions::default()
        };
        let opened = prior::open(model, &options, source)?;
        let names = &model.meta.points;
        let body = model.meta.body.as_ref().map(Body::from);
        let prior = match body {
            Some(body) => opened.mapped(&map_to(
                &body,
                rest_pose(rig, names.len()).view(),
                0.0,
                &(0..names.len())
                    .map(|p| joints::mirrored(names, p))
                    .collect::<Vec<_>>(),
            )),
            None => opened,
        };
        let anchor = Anchor::pelvis(names)
            .unwrap_or_else(|| Anchor::mean(&prior.representative_poses().row(0).to_vec()));
        Ok(RigPrior {
            prior,
            anchor,
            placement: PlacementSolver {
                iterations: ITERATIONS,
                ..PlacementSolver::default()
            },
            points: names.len(),
            names: names.clone(),
        })
    }

    /// Restores observations (3 J) of the body: see [`FrameRestorer`]. No rigid distances are kept, inverse kinematics does that.
    pub fn restorer(&self) -> FrameRestorer<'_> {
        FrameRestorer {
            prior: &*self.prior,
            anchor: Some(&self.anchor),
            solver: &self.placement,
            rigid: None,
        }
    }

    /// A few training poses of this body, far apart, in the model's space: (k, 3 J), cm.
    pub fn representative_poses(&self) -> Array2<f64> {
        self.prior.representative_poses().to_owned()
    }
}

/// A few of the model's training poses, far apart, in the model's space.
///
/// # Errors
/// As [`prior::open`].
pub fn typical_poses(model: &Model) -> Result<Poses> {
    let prior = prior::open(model, &OpenOptions::default(), "the model")?;
    Ok(Poses {
        points: model.meta.points.clone(),
        xyz: prior.representative_poses().to_owned(),
        ..Poses::default()
    })
}

/// The joints of the rest posture in the model's order, one frame.
fn rest_pose(rig: &Rig, points: usize) -> Array2<f64> {
    let rest = rig.positions(&vec![0.0; rig.skeleton.dof_count()]);
    let rest = rig.to_model(&rest, points);
    Array2::from_shape_fn((1, rest.len()), |(_, c)| rest[c])
}
