//! Poses to start from: the model's representative poses, standing ones first, on the floor.

use super::pose_solver::{Constraints, Pose, PoseSolver};
use crate::pose::Similarity;
use crate::pose::joints::CMU;
use glam::DVec3;

/// A pose to start from.
#[derive(Debug, Clone)]
pub struct StartPose {
    /// What it looks like, such as `standing`.
    pub name: &'static str,
    /// The pose.
    pub pose: Pose,
}

/// The representative poses of a model as the rig takes them; at least one.
pub fn start_poses(solver: &PoseSolver) -> Vec<StartPose> {
    let rest = vec![0.0; solver.rig.skeleton.dof_count()];
    let typical = solver.model.prior.representative_poses();
    let mut starts: Vec<(f64, StartPose)> = (typical.rows().into_iter())
        .map(|row| {
            let model = row.to_vec();
            let pose = solver.placed(&model, Similarity::IDENTITY, &rest);
            let heights = pose.xyz.iter().skip(1).step_by(3);
            let lift = -heights.fold(f64::INFINITY, |z, y| z.min(*y));
            let lifted = Similarity {
                shift: DVec3::Y * lift,
                ..Similarity::IDENTITY
            };
            let pose = solver.placed(&model, lifted, &pose.q);
            let figure = Figure::of(solver, &pose.xyz);
            let (name, order) = figure.map_or(("pose", 0.0), |f| f.describe());
            (order, StartPose { name, pose })
        })
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut starts: Vec<StartPose> = starts.into_iter().map(|s| s.1).collect();
    starts.push(rest_pose(solver));
    starts
}

/// The skeleton's rest posture, on the floor.
fn rest_pose(solver: &PoseSolver) -> StartPose {
    let rest = vec![0.0; solver.rig.skeleton.dof_count()];
    let xyz = solver.rig.positions(&rest);
    let none = Constraints::none(solver.rig.joints());
    let pose = solver.at_positions(&none, &xyz, Similarity::IDENTITY, &rest);
    let pose = solver.pose_at(&xyz, &pose).unwrap_or(pose);
    let heights = xyz.iter().skip(1).step_by(3);
    let lift = -heights.fold(f64::INFINITY, |z, y| z.min(*y));
    StartPose {
        name: "rest pose of the skeleton",
        pose: solver.moved(&pose, DVec3::Y * lift),
    }
}

/// Some joints of a person.
struct Figure {
    root: DVec3,
    thorax: DVec3,
    head: DVec3,
    /// Hip joint, knee, ankle and wrist, left and right.
    sides: [[DVec3; 4]; 2],
}

impl Figure {
    /// `None` unless the rig has CMU's points.
    fn of(solver: &PoseSolver, xyz: &[f64]) -> Option<Figure> {
        let points = &solver.model.points;
        let at = |name: &str| {
            let p = points.iter().position(|n| n == name)?;
            let k = (solver.rig.model_points.iter()).position(|q| *q == Some(p))?;
            Some(DVec3::from_slice(&xyz[3 * k..]))
        };
        let side = |names: [&str; 4]| {
            let [a, b, c, d] = names.map(at);
            Some([a?, b?, c?, d?])
        };
        Some(Figure {
            root: at(CMU[0])?,
            thorax: at(CMU[11])?,
            head: at(CMU[14])?,
            sides: [
                side([CMU[1], CMU[2], CMU[3], CMU[18]])?,
                side([CMU[5], CMU[6], CMU[7], CMU[22]])?,
            ],
        })
    }

    /// What the figure does, and a number that sorts standing figures with low arms first.
    fn describe(&self) -> (&'static str, f64) {
        let bend = |a: DVec3, b: DVec3, c: DVec3| (b - a).angle_between(c - b).to_degrees();
        let knees = self
            .sides
            .map(|[hip, knee, ankle, _]| bend(hip, knee, ankle));
        let hips = self
            .sides
            .map(|[hip, knee, ..]| bend(self.thorax, self.root, self.root + knee - hip));
        let lean = (self.thorax - self.root)
            .angle_between(DVec3::Y)
            .to_degrees();
        let raised = self.sides.map(|[.., wrist]| wrist.y - self.head.y);
        let stride = (self.sides[0][2] - self.sides[1][2]).with_y(0.0).length();
        let most = |v: [f64; 2]| v[0].max(v[1]);
        let least = |v: [f64; 2]| v[0].min(v[1]);
        let arms: f64 = self
            .sides
            .map(|[.., wrist]| wrist.y - self.root.y)
            .iter()
            .sum();
        let order = most(knees) + most(hips) + lean + stride + arms.max(0.0);
        let name = if least(hips) > 60.0 && least(knees) > 50.0 {
            "sitting"
        } else if lean > 40.0 {
            "bending"
        } else if most(raised) > 0.0 {
            "arm raised"
        } else if least(knees) > 50.0 {
            "crouching"
        } else if (self.sides[0][2].y - self.sides[1][2].y).abs() > 20.0 {
            "leg raised"
        } else if stride > 45.0 {
            "striding"
        } else {
            "standing"
        };
        (name, order)
    }
}
