//! Other poses that satisfy the same pins: near other representative poses of the model, the
//! likeliest first.
//!
//! Poses are compared by the log density of their joints under the model, which knows no gravity;
//! less (tilt / 15°)² / 2, the tilt being that of the pelvis from its present one, whichever way it
//! faces. Poses that this makes less likely by 60 nats than the best are left out.

use super::pose_solver::{Constraints, Pose, PoseSolver, Reference, largest_step};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::{Observation, Similarity};
use crate::prior::Want;
use glam::DVec3;

/// Poses count as different when some joint is this far apart, cm.
const APART: f64 = 5.0;
/// How far joints may go from the representative pose that is tried, cm.
const REST: f64 = 15.0;
/// The noise under which the likelihood of a pose is compared, cm.
const NOISE: f64 = 2.0;
/// The standard deviation of the pelvis's tilt, radians.
const TILT: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// Poses that are less likely than the best by more are left out, nats.
const UNLIKELY: f64 = 60.0;
/// No more poses are found.
const MOST: usize = 8;

/// Another pose.
#[derive(Debug, Clone)]
pub struct OtherPose {
    /// The pose.
    pub pose: Pose,
    /// How likely it is, nats: only differences say something.
    pub evidence: f64,
}

/// Poses with the pins of `goals`, at least 5 cm from `now` and from each other, the likeliest
/// first. Where fewer than three joints are pinned, the others stand where the body stands now.
pub fn other_poses(solver: &PoseSolver, goals: &Constraints, now: &Pose) -> Vec<OtherPose> {
    let pinned: Vec<usize> = (0..solver.rig.joints())
        .filter(|&k| goals.pins[k].iter().all(Option::is_some))
        .collect();
    let mut found: Vec<OtherPose> = Vec::new();
    for typical in solver.model.prior.representative_poses().rows() {
        let model = typical.to_vec();
        let placement = laid_on(solver, &model, &pinned, now);
        let start = solver.placed(&model, placement, &now.q);
        let mut goals = goals.clone();
        (goals.rest, goals.drags) = (REST, vec![None; solver.rig.joints()]);
        let pose = solver.follow(
            &goals,
            &Reference::at(start.xyz.clone()),
            &start,
            f64::INFINITY,
        );
        let is_new = |other: &Pose| largest_step(&other.xyz, &pose.xyz) >= APART;
        let is_held = pose.missed.iter().all(|m| *m == 0.0);
        if !is_held || !is_new(now) {
            continue;
        }
        let evidence = evidence(solver, &pose, now);
        // The likelier of two poses that are alike stays.
        if found
            .iter()
            .any(|o| !is_new(&o.pose) && o.evidence >= evidence)
        {
            continue;
        }
        found.retain(|o| is_new(&o.pose));
        found.push(OtherPose { pose, evidence });
    }
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let best = found.first().map_or(0.0, |o| o.evidence);
    found.retain(|o| o.evidence >= best - UNLIKELY);
    found.truncate(MOST);
    found
}

/// The placement that lays a pose of the model on the pinned joints, or, where these are too few,
/// on the present placement.
fn laid_on(solver: &PoseSolver, model: &[f64], pinned: &[usize], now: &Pose) -> Similarity {
    let pairs = pinned.iter().filter_map(|&k| {
        let p = solver.rig.model_points[k]?;
        Some((
            DVec3::from_slice(&model[3 * p..]),
            DVec3::from_slice(&now.xyz[3 * k..]),
            1.0,
        ))
    });
    let fit = fit_similarity(pairs.clone(), TransformKind::Rigid).filter(|f| f.determined);
    if let Some(fit) = fit {
        return fit.similarity;
    }
    // As the body is turned now, with the pinned joints in the middle of their pins.
    let count = pairs.clone().count();
    let apart = pairs.map(|(from, to, _)| to - now.placement.apply(from));
    let shift = apart.sum::<DVec3>() / count.max(1) as f64;
    Similarity {
        shift: now.placement.shift + shift,
        ..now.placement
    }
}

/// How likely a pose is, nats.
fn evidence(solver: &PoseSolver, pose: &Pose, now: &Pose) -> f64 {
    let up = |pose: &Pose| pose.placement.rotation.transpose() * DVec3::Y;
    let tilt = up(pose).angle_between(up(now)) / TILT;
    let world = solver.rig.to_model(&pose.xyz, solver.model.points.len());
    let mut values = vec![0.0; world.len()];
    pose.placement.undo_pose(&world, &mut values);
    let known = |v: &f64| {
        if v.is_finite() {
            NOISE * NOISE
        } else {
            f64::INFINITY
        }
    };
    let variance: Vec<f64> = world.iter().map(known).collect();
    let seen = Observation {
        values: &values,
        variance: &variance,
    };
    let posterior = solver.model.prior.posterior(&seen, Want::Mean);
    posterior.log_evidence - 0.5 * tilt * tilt
}
