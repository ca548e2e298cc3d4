//! The prior of the poses of a rig: a model, carried to the rig's bone lengths.

use super::rig::Rig;
use crate::Result;
use crate::io::Model;
use crate::prior::{OpenOptions, Task};
use crate::restore::PoseModel;
use ndarray::Array2;

/// Iterations of a placement: while a joint is dragged, the next pose goes on from where this one
/// ends.
const ITERATIONS: usize = 8;

/// Opens a model, of its own body still; `source` names it in errors. No rigid distances are kept,
/// inverse kinematics does that.
///
/// # Errors
/// As [`prior::open`](crate::prior::open).
pub fn open_model(model: &Model, source: &str) -> Result<PoseModel> {
    // The stated variances are what the user asks for: no task's own setting replaces them.
    let options = OpenOptions {
        task: Some(Task::Treated),
        ..OpenOptions::default()
    };
    PoseModel::open(model, &options, source, true)
}

/// A model for the body of a rig.
pub fn for_rig(mut model: PoseModel, rig: &Rig) -> PoseModel {
    let rest = rest_pose(rig, model.points.len());
    if let Some(prior) = model.prior_for(rest.view(), 0.0) {
        model.prior = prior;
    }
    model.solver.iterations = ITERATIONS;
    model
}

/// The joints of the rest posture in the model's order, one frame.
fn rest_pose(rig: &Rig, points: usize) -> Array2<f64> {
    let rest = rig.positions(&vec![0.0; rig.skeleton.dof_count()]);
    let rest = rig.to_model(&rest, points);
    Array2::from_shape_fn((1, rest.len()), |(_, c)| rest[c])
}
