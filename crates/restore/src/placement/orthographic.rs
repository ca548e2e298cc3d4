//! 2-D input of Lai et al.: only two coordinates of some points are observed, as in a picture.
//!
//! ```text
//! min over x, R, t   Σ wᵢ (aᵢᵀ (R (A x)ᵢ + t) − yᵢ)²
//!     over the observed coordinates yᵢ (cm) along the axes aᵢ
//! ```
//!
//! The rotation has no closed form, and rotating a point mixes observed coordinates with missing
//! ones. So the model is rotated instead of the points: for fixed R the code of the rotated atoms
//! is P1a; for fixed x, (R, t) follow by damped Gauss-Newton. The scale is that of the code, as
//! atoms pass through the origin.

use super::PlacementSolver;
use super::tuning::orthographic::*;
use crate::numeric::levenberg_marquardt::Damping;
use crate::numeric::linalg::cholesky_solve;
use crate::pose::Observation;
use crate::pose::rotation::from_rotation_vector;
use crate::pose::{PoseTransform, Similarity};
use crate::prior::{Posterior, Prior, Reconstruction, Want};
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2};

const SCHEDULE: Damping = Damping {
    start: DAMPING,
    accepted: |damping, _| damping / 10.0,
    rejected: |damping| damping * 10.0,
    most: MOST_DAMPED,
};

/// The posterior of a frame with partly observed points, in world axes, and its placement: from a
/// `known` one or else from representative poses. `None` with fewer than four points.
pub(crate) fn restore(
    prior: &dyn Prior,
    seen: Observation<'_>,
    solver: &PlacementSolver,
    known: Option<Similarity>,
) -> Option<(Posterior, Similarity)> {
    let count = seen
        .variance
        .chunks_exact(3)
        .filter(|n| n.iter().any(|v| v.is_finite()))
        .count();
    if count < FEWEST_POINTS {
        return None;
    }
    let mut best: Option<(Reconstruction, DMat3, DVec3)> = None;
    let starts = match known {
        Some(known) => vec![(known.rotation, known.shift)],
        None => views(prior, seen, solver.headings)
            .into_iter()
            .map(|view| (view.rotation, view.shift))
            .collect(),
    };
    for start in starts {
        let solved = descend(prior, seen, start, solver.iterations.min(ITERATIONS));
        if best
            .as_ref()
            .is_none_or(|(b, ..)| solved.0.objective < b.objective)
        {
            best = Some(solved);
        }
    }
    let (fit, rotation, mut shift) = best?;
    // The depth of the whole pose is not observed: the model's origin gets depth 0.
    for axis in 0..3 {
        if seen
            .variance
            .iter()
            .skip(axis)
            .step_by(3)
            .all(|n| !n.is_finite())
        {
            shift[axis] = 0.0;
        }
    }
    let turned = prior.mapped(&PoseTransform::Rotate(rotation));
    let moved = shifted(seen.values, -shift);
    let moved_observation = Observation {
        values: &moved,
        variance: seen.variance,
    };
    let mut posterior = turned.posterior_given(&moved_observation, &fit, Want::Variances);
    posterior.mean = shifted(&posterior.mean, shift);
    let placement = Similarity {
        rotation,
        shift,
        scale: 1.0,
    };
    Some((posterior, placement))
}

/// Shifts all points.
fn shifted(pose: &[f64], by: DVec3) -> Vec<f64> {
    pose.iter()
        .enumerate()
        .map(|(i, v)| v + by[i % 3])
        .collect()
}

/// The observed coordinates: (index, value, weight).
fn observed(prior: &dyn Prior, seen: Observation<'_>) -> Vec<(usize, f64, f64)> {
    (0..seen.values.len())
        .filter(|&i| seen.variance[i].is_finite())
        .map(|i| {
            (
                i,
                seen.values[i],
                1.0 / (seen.variance[i] + prior.residual_variance()[i]),
            )
        })
        .collect()
}

/// Alternates code and placement from one start; the objective never rises.
fn descend(
    prior: &dyn Prior,
    seen: Observation<'_>,
    start: (DMat3, DVec3),
    iterations: usize,
) -> (Reconstruction, DMat3, DVec3) {
    let code = |r: DMat3, t: DVec3, before: Option<&Reconstruction>| {
        let turned = prior.mapped(&PoseTransform::Rotate(r));
        let moved = Observation {
            values: &shifted(seen.values, -t),
            variance: seen.variance,
        };
        turned.reconstruct(&moved, before)
    };
    let coordinates = observed(prior, seen);
    let (mut rotation, mut shift) = start;
    let mut fit = code(rotation, shift, None);
    for _ in 0..iterations {
        // The fitted pose has the directions of the world.
        let (r, t) = place(&coordinates, &fit.pose, rotation, shift);
        let next = code(r, t, Some(&fit));
        if !(next.objective < fit.objective) {
            break;
        }
        let settled = fit.objective - next.objective <= SETTLED * fit.objective;
        (rotation, shift, fit) = (r, t, next);
        if settled {
            break;
        }
    }
    (fit, rotation, shift)
}

/// Rotates and shifts `pose` (already rotated by `rotation`) onto the coordinates, by damped
/// Gauss-Newton.
fn place(
    coordinates: &[(usize, f64, f64)],
    pose: &[f64],
    rotation: DMat3,
    shift: DVec3,
) -> (DMat3, DVec3) {
    let cost = |&(r, t): &(DMat3, DVec3)| -> f64 {
        coordinates
            .iter()
            .map(|&(i, y, w)| {
                let p = r * DVec3::from_slice(&pose[3 * (i / 3)..]) + t;
                w * (p[i % 3] - y).powi(2)
            })
            .sum()
    };
    let step = |&(turn, t): &(DMat3, DVec3), damping: f64, _| {
        let mut normal = Array2::zeros((6, 6));
        let mut gradient = Array1::zeros(6);
        for &(i, y, w) in coordinates {
            let x = turn * DVec3::from_slice(&pose[3 * (i / 3)..]);
            let axis = DVec3::AXES[i % 3];
            // d(axis · exp(ω) x)/dω = x × axis.
            let turning = x.cross(axis);
            let row = [turning.x, turning.y, turning.z, axis.x, axis.y, axis.z];
            let rest = (x + t)[i % 3] - y;
            for a in 0..6 {
                gradient[a] += w * row[a] * rest;
                for b in 0..6 {
                    normal[[a, b]] += w * row[a] * row[b];
                }
            }
        }
        let mut diagonal = normal.diag_mut();
        diagonal.mapv_inplace(|v| v + damping * v + 1e-9);
        let step = cholesky_solve(normal, gradient)?;
        let by = from_rotation_vector(-DVec3::new(step[0], step[1], step[2]));
        let next = (by * turn, t - DVec3::new(step[3], step[4], step[5]));
        Some((cost(&next), next))
    };
    let start = (DMat3::IDENTITY, shift);
    let start = (cost(&start), start);
    let ((turn, t), _) = SCHEDULE.minimize((STEPS, STEPS), (0.0, STEP_SETTLED), start, step);
    (turn * rotation, t)
}

/// A pose seen from far away: (x, y) = the first two of `scale` `rotation` p + `shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrthographicView {
    /// From the model's space to the camera's.
    pub rotation: DMat3,
    /// In the picture's unit.
    pub shift: DVec3,
    /// The picture's unit over a centimeter.
    pub scale: f64,
}

/// The best scaled orthographic view of each representative pose of a prior on the points that
/// `seen` has x and y of, the best fits first, at most so many.
///
/// The affine map M (2, 3) of a pose onto the picture is linear least squares; the nearest pair of
/// orthonormal rows is the rotation.
pub fn views(prior: &dyn Prior, seen: Observation<'_>, most: usize) -> Vec<OrthographicView> {
    let planar: Vec<(usize, DVec3)> = (0..seen.values.len() / 3)
        .filter(|j| seen.variance[3 * j].is_finite() && seen.variance[3 * j + 1].is_finite())
        .map(|j| {
            (
                j,
                DVec3::new(seen.values[3 * j], seen.values[3 * j + 1], 0.0),
            )
        })
        .collect();
    let center = planar.iter().map(|(_, y)| *y).sum::<DVec3>() / planar.len().max(1) as f64;
    let mut found = Vec::new();
    for typical in prior.representative_poses().rows() {
        let at = |j: usize| DVec3::new(typical[3 * j], typical[3 * j + 1], typical[3 * j + 2]);
        let middle = planar.iter().map(|(j, _)| at(*j)).sum::<DVec3>() / planar.len().max(1) as f64;
        let (mut spread, mut cross) = (DMat3::IDENTITY * 1e-3, DMat3::ZERO);
        for (j, y) in &planar {
            let (x, y) = (at(*j) - middle, *y - center);
            spread += DMat3::from_cols(x * x.x, x * x.y, x * x.z);
            cross += DMat3::from_cols(y * x.x, y * x.y, y * x.z);
        }
        let affine = cross * spread.inverse();
        let (r1, r2) = (affine.row(0), affine.row(1));
        // The nearest orthonormal pair: M ← (M Mᵀ)^(-1/2) M, in closed form for two rows.
        let (a, b, d) = (r1.length_squared(), r1.dot(r2), r2.length_squared());
        let root = (a * d - b * b).max(0.0).sqrt();
        let trace = (a + d + 2.0 * root).sqrt();
        if !(root > 1e-12 && trace > 0.0) {
            continue;
        }
        let s = 1.0 / (root * trace);
        let u = (r1 * (d + root) - r2 * b) * s;
        let v = (r2 * (a + root) - r1 * b) * s;
        let rotation = DMat3::from_cols(u, v, u.cross(v)).transpose();
        let scale = trace / 2.0;
        let rest: f64 = planar
            .iter()
            .map(|(j, y)| {
                let p = rotation * (at(*j) - middle) * scale;
                (DVec3::new(p.x, p.y, 0.0) - (*y - center)).length_squared()
            })
            .sum();
        let view = OrthographicView {
            rotation,
            shift: center - rotation * middle * scale,
            scale,
        };
        found.push((rest, view));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let best = found.into_iter().take(most.max(1));
    best.map(|(_, view)| view).collect()
}
