//! A body from a partial scan of it, and a few points that a person has placed.
//!
//! The points start the pose. Then, in turn, each point of the scan is paired with the nearest
//! point of the present surface, and a Gauss-Newton step on rotations, shape and shift lowers the
//! distances to the planes there, with priors on twists and shape. Pairs farther apart than a
//! threshold that shrinks, or whose normals disagree, do not count. Last the surface is warped
//! towards the scan, as little as possible in its edges.

use super::body_model::BodyModel;
use super::fit::{BodyState, FitProblem};
use super::fit_prior::{FitPrior, NormalEquations, twist_derivatives};
use super::marker_model::{Marker, MarkerModel};
use super::pose_model::twists;
use super::surface::{Surface, SurfacePoint};
use super::vertex_jacobian::vertex_jacobian;
use crate::Result;
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel;
use crate::numeric::product::gram;
use crate::numeric::sparse_cholesky::SparseCholesky;
use crate::pose::rotation::from_rotation_vector;
use glam::DVec3;
use ndarray::{Array1, Array2, Array3, Axis};

const ROUNDS: usize = 24;
/// Pairs count up to this distance in the first and in the last round, centimeters.
const REACH: [f64; 2] = [15.0, 1.0];
/// The least standard deviation of a point of the scan from the model's plane, centimeters; that of
/// a placed point.
const SCAN_DEVIATION: f64 = 0.3;
const POINT_DEVIATION: f64 = 1.0;
/// The cosine of the largest angle between normals of a pair.
const LEAST_COSINE: f64 = 0.5;
/// As many points of the scan err independently of each other.
const INDEPENDENT: f64 = 1000.0;
/// The weight of a point of the scan against the edges in the warp.
const WARP_WEIGHT: f64 = 1.0;

/// What was fitted to a scan.
#[derive(Debug, Clone)]
pub struct ScanFit {
    /// The pose and the shape.
    pub state: BodyState,
    /// The vertices of the model, centimeters.
    pub predicted: Vec<DVec3>,
    /// These, warped towards the scan.
    pub completed: Vec<DVec3>,
    /// The root mean square distance of the scan's points from the predicted surface, centimeters,
    /// of those that count at the end.
    pub rms: f64,
    /// The share of the scan's points that count at the end.
    pub share: f64,
    /// Whether the scan's normals were found to look inwards, and turned.
    pub is_inside_out: bool,
}

/// A scan, and how its faces are turned.
struct Scan<'a> {
    points: &'a [DVec3],
    /// The normal at each point, 0 for a cloud.
    normals: &'a [DVec3],
    /// 1, or -1 where the normals look inwards.
    orientation: f64,
}

impl<'a> Scan<'a> {
    /// A scan near the surface of these vertices.
    fn new(scan: &'a Surface, vertices: &[DVec3], body: &BodyModel) -> Scan<'a> {
        let mut found = Scan {
            points: scan.vertices(),
            normals: scan.normals(),
            orientation: 0.0,
        };
        let surface = Surface::new(vertices.to_vec(), body.template.surface().to_vec());
        for (point, normal) in found.points.iter().zip(found.normals) {
            let nearest = surface.nearest(*point);
            found.orientation += nearest.map_or(0.0, |n| n.normal.dot(*normal));
        }
        found.orientation = if found.orientation < 0.0 { -1.0 } else { 1.0 };
        found
    }
}

/// A point of the scan, and the point of the model that it belongs to.
struct Pair {
    scan: DVec3,
    model: SurfacePoint,
}

/// Fits a body to the vertices of a scan, centimeters, and to placed points: a vertex and where it
/// is.
///
/// # Errors
/// [`crate::Error::Unfit`]: there are too few placed points, or the scan has no points near them.
pub fn fit_scan(body: &BodyModel, scan: &Surface, placed: &[(usize, DVec3)]) -> Result<ScanFit> {
    let (mut state, mut shift) = start(body, placed)?;
    let mut prior = body.fit_prior();
    prior.noise = POINT_DEVIATION;
    let mut vertices = placed_vertices(body, &state, shift);
    let scan = &Scan::new(scan, &vertices, body);
    for round in 0..ROUNDS {
        let reach = reach(round);
        let pairs = pairs(body, scan, &vertices, reach);
        let jacobian = vertex_jacobian(body, &state.rotations, &state.shape);
        let deviation = SCAN_DEVIATION.max(reach / 5.0);
        let mut normal = priors(body, &state, &prior);
        normal.add_pairs(&pairs, &jacobian, deviation);
        normal.add_placed(placed, &vertices, &jacobian);
        let step = normal.solve().ok_or("has points that determine no pose")?;
        (state, shift) = moved(&state, shift, &step);
        vertices = placed_vertices(body, &state, shift);
    }
    let pairs = pairs(body, scan, &vertices, REACH[1]);
    if pairs.is_empty() {
        return Err("has no points near the body that the placed points give".into());
    }
    let squares: f64 = pairs.iter().map(|p| plane_distance(p).powi(2)).sum();
    Ok(ScanFit {
        completed: warped(body, &vertices, &pairs),
        rms: (squares / pairs.len() as f64).sqrt(),
        share: pairs.len() as f64 / scan.points.len() as f64,
        is_inside_out: scan.orientation < 0.0,
        predicted: vertices,
        state,
    })
}

fn reach(round: usize) -> f64 {
    let share = round as f64 / (ROUNDS - 1) as f64;
    REACH[0] * (REACH[1] / REACH[0]).powf(share)
}

/// The pose and the shift of the placed points alone.
fn start(body: &BodyModel, placed: &[(usize, DVec3)]) -> Result<(BodyState, DVec3)> {
    let markers: Vec<Marker> = placed.iter().map(|(v, _)| Marker::on(*v)).collect();
    let targets: Vec<Option<DVec3>> = placed.iter().map(|(_, p)| Some(*p)).collect();
    let model = MarkerModel::new(body, &markers);
    let mut prior = body.fit_prior();
    prior.noise = POINT_DEVIATION;
    let fit = FitProblem::new(&model, &prior, &targets)?.solve(None);
    let vertices = body.synthesize(&fit.state.rotations, &fit.state.shape);
    Ok((fit.state, fit.shift - vertices[0]))
}

fn placed_vertices(body: &BodyModel, state: &BodyState, shift: DVec3) -> Vec<DVec3> {
    let vertices = body.synthesize(&state.rotations, &state.shape);
    vertices.into_iter().map(|v| v + shift).collect()
}

/// Each point of the scan with the nearest point of the surface, where that counts.
fn pairs(body: &BodyModel, scan: &Scan<'_>, vertices: &[DVec3], reach: f64) -> Vec<Pair> {
    let surface = Surface::new(vertices.to_vec(), body.template.surface().to_vec());
    let chunks = parallel::map_chunks(scan.points.len(), 512, |range| {
        let pair = |k: usize| {
            let model = surface.nearest(scan.points[k])?;
            let near = (model.at - scan.points[k]).length() <= reach;
            let agrees =
                scan.normals[k] == DVec3::ZERO || scan.normals[k].dot(model.normal) >= LEAST_COSINE;
            (near && agrees && model.normal != DVec3::ZERO).then_some(Pair {
                scan: scan.points[k],
                model,
            })
        };
        range.filter_map(pair).collect::<Vec<_>>()
    });
    chunks.into_iter().flatten().collect()
}

fn plane_distance(pair: &Pair) -> f64 {
    pair.model.normal.dot(pair.model.at - pair.scan)
}

/// The normal equations of one step: rotations, shape, then the shift; the priors first.
fn priors(body: &BodyModel, state: &BodyState, prior: &FitPrior) -> NormalEquations {
    let joints = body.template.joint_parts();
    let twists = twists(&joints, &state.rotations);
    let turns = twist_derivatives(&joints, &twists, &state.rotations);
    let n = 3 * state.rotations.len() + state.shape.len() + 3;
    let mut normal = NormalEquations::zeros(n);
    prior.add(1.0, &joints, &twists, &turns, &state.shape, &mut normal);
    normal
}

impl NormalEquations {
    fn add_pairs(&mut self, pairs: &[Pair], jacobian: &Array3<f64>, deviation: f64) {
        let n = jacobian.dim().1;
        let share = (INDEPENDENT / pairs.len().max(1) as f64).min(1.0);
        let weight = share.sqrt() / deviation;
        let mut rows = Array2::zeros((pairs.len(), n + 3));
        let mut left = Array1::zeros(pairs.len());
        for (i, pair) in pairs.iter().enumerate() {
            let normal = pair.model.normal.to_array();
            for (v, share) in pair.model.corners.iter().zip(pair.model.shares) {
                let of_vertex = jacobian.index_axis(Axis(0), *v);
                for c in 0..n {
                    let along: f64 = (0..3).map(|a| normal[a] * of_vertex[[c, a]]).sum();
                    rows[[i, c]] += weight * share * along;
                }
            }
            for a in 0..3 {
                rows[[i, n + a]] = weight * normal[a];
            }
            left[i] = weight * plane_distance(pair);
        }
        self.hessian += &gram(rows.view());
        self.gradient += &rows.t().dot(&left);
    }

    fn add_placed(
        &mut self,
        placed: &[(usize, DVec3)],
        vertices: &[DVec3],
        jacobian: &Array3<f64>,
    ) {
        let n = jacobian.dim().1;
        for (v, target) in placed {
            for a in 0..3 {
                let mut row = Array1::zeros(n + 3);
                for c in 0..n {
                    row[c] = jacobian[[*v, c, a]] / POINT_DEVIATION;
                }
                row[n + a] = 1.0 / POINT_DEVIATION;
                let left = (vertices[*v][a] - target[a]) / POINT_DEVIATION;
                self.gradient.scaled_add(left, &row);
                let column = row.clone().insert_axis(Axis(1));
                self.hessian += &column.dot(&row.insert_axis(Axis(0)));
            }
        }
    }

    fn solve(mut self) -> Option<Array1<f64>> {
        self.hessian.diag_mut().mapv_inplace(|v| v * 1.001 + 1e-9);
        let right = self.gradient.mapv(|v| -v).insert_axis(Axis(1));
        let step = Cholesky::new(self.hessian)?.solve(&right)?;
        Some(step.column(0).to_owned())
    }
}

fn moved(state: &BodyState, shift: DVec3, step: &Array1<f64>) -> (BodyState, DVec3) {
    /// The largest turn of a part in one step, radians: pairs are wrong at first.
    const LARGEST: f64 = 0.3;
    let parts = state.rotations.len();
    let vector = |k: usize| DVec3::new(step[k], step[k + 1], step[k + 2]);
    let turn = |p: usize| from_rotation_vector(vector(3 * p).clamp_length_max(LARGEST));
    let shape = 3 * parts;
    let next = BodyState {
        rotations: (0..parts).map(|p| turn(p) * state.rotations[p]).collect(),
        shape: (state.shape.iter().enumerate())
            .map(|(k, b)| b + step[shape + k])
            .collect(),
    };
    (next, shift + vector(shape + state.shape.len()))
}

/// The vertices warped so that the paired points come to the scan: min |G (y - y₀)|² + w Σ |y_v -
/// target_v|².
fn warped(body: &BodyModel, vertices: &[DVec3], pairs: &[Pair]) -> Vec<DVec3> {
    let mut sums = vec![(DVec3::ZERO, 0.0); vertices.len()];
    for pair in pairs {
        let miss = -pair.model.normal * plane_distance(pair);
        for (v, share) in pair.model.corners.iter().zip(pair.model.shares) {
            sums[*v] = (sums[*v].0 + miss * share, sums[*v].1 + share);
        }
    }
    let mut entries = body.template.edge_entries();
    let mut right = Array2::zeros((vertices.len(), 3));
    for (v, (miss, weight)) in sums.iter().enumerate() {
        entries.push((v, v, WARP_WEIGHT * weight));
        for a in 0..3 {
            right[[v, a]] = WARP_WEIGHT * miss[a];
        }
    }
    let Some(factor) = SparseCholesky::new(vertices.len(), &entries) else {
        return vertices.to_vec();
    };
    let moved = factor.solve(right.view());
    (vertices.iter().zip(moved.rows()))
        .map(|(v, m)| *v + DVec3::new(m[0], m[1], m[2]))
        .collect()
}
