//! A prior of poses that stand upright in the world, for frames that show few points.
//!
//! Where the points that are seen hardly say how the pelvis is tilted, a free placement lets the
//! body hang in the air at any tilt. But y is up, and models keep which way was up for each of
//! their training poses. So each training pose x_i, its y axis up, is turned about that axis by θ_i
//! and shifted to the points o that are seen of a frame y, both by least squares:
//!
//! ```text
//! d_i² = min over θ, t   |R(θ) x_io + t − y_o|²,      w_i ∝ 1 / (d_i² + 1 cm²)²
//! p(x)  ≈  N(Σ w_i x_i, Σ w_i (x_i − m)(x_i − m)ᵀ + r I)       over the nearest few hundred
//! ```
//!
//! and the answer is that Gaussian given y. What is near one training pose is that pose; what is
//! far from all of them is a regression on the points seen.
//!
//! The height is left free: the floor of a take may be at any height, and with the floor known the
//! errors were the same in a prototype (8.5 for 8.6 cm where head and hands are seen of people left
//! out, 9.5 for 9.4 where chest, arms and head are).

use super::tuning::upright::*;
use crate::numeric::gaussian::ConditionalGaussian;
use crate::pose::rotation::shortest_arc;
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::{Observation, PoseTransform, Similarity};
use crate::prior::{Posterior, Prior, Want};
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, s};

/// Training poses with their up direction along y (n, 3 J), cm; the root at the origin, the pelvis
/// facing the same way.
#[derive(Debug, Clone)]
pub(crate) struct UprightPoses {
    poses: Array2<f64>,
    residual: Vec<f64>,
}

/// A pose turned about y and shifted to the seen points.
struct Near {
    /// The pose.
    row: usize,
    /// The squared distance of the seen points, cm².
    square: f64,
    /// The angle about y, radians.
    angle: f64,
    /// The center of the seen points of the pose before, cm.
    center: DVec3,
}

impl UprightPoses {
    /// Poses (n, 3 J; cm) in a model's space, with the direction up of each (n, 3); at most
    /// [`MOST_POSES`] of them, evenly spaced.
    pub(crate) fn new(poses: ArrayView2<'_, f64>, up: ArrayView2<'_, f64>) -> UprightPoses {
        let step = poses.nrows().div_ceil(MOST_POSES).max(1) as isize;
        let mut poses = poses.slice(s![..;step, ..]).to_owned();
        for (mut pose, up) in poses
            .rows_mut()
            .into_iter()
            .zip(up.slice(s![..;step, ..]).rows())
        {
            let turn = shortest_arc(DVec3::new(up[0], up[1], up[2]), DVec3::Y);
            let turn = turn.unwrap_or(DMat3::IDENTITY);
            for p in 0..pose.len() / 3 {
                let at = turn * point(pose.view(), p);
                (0..3).for_each(|axis| pose[3 * p + axis] = at[axis]);
            }
        }
        UprightPoses {
            residual: vec![RIDGE; poses.ncols()],
            poses,
        }
    }

    /// The placement of the pose nearest to a frame: poses here look along the same axis, so that
    /// a frame that is turned about y has the turned answer. `None` where the frame does not show
    /// three points that are not all above one another.
    pub(crate) fn place(&self, observation: &Observation<'_>) -> Option<Similarity> {
        let seen = seen_points(observation);
        let to = center(&seen);
        let is_beside = |(_, at): &(usize, DVec3)| (*at - to).with_y(0.0).length() > LEAST_BREADTH;
        if seen.len() < 3 || !seen.iter().any(is_beside) {
            return None;
        }
        let nearest = self.nearest(&seen, 1).pop()?;
        let rotation = DMat3::from_rotation_y(nearest.angle);
        Some(Similarity {
            scale: 1.0,
            rotation,
            shift: to - rotation * nearest.center,
        })
    }

    /// Whether y is up in the frames of a take (frames, 3 J; cm, NaN missing): upright poses are
    /// not much farther from them than the same poses would be at any tilt.
    pub(crate) fn are_upright(&self, frames: ArrayView2<'_, f64>) -> bool {
        let step = frames.nrows().div_ceil(JUDGED_FRAMES).max(1) as isize;
        let some = (self.poses.nrows().div_ceil(TILTED_POSES)).max(1) as isize;
        let tilted = self.poses.slice(s![..;some, ..]);
        let (mut upright, mut free, mut most) = (0.0, 0.0, 0);
        for row in frames.slice(s![..;step, ..]).rows() {
            let row = row.to_vec();
            let seen = row.chunks_exact(3).map(DVec3::from_slice).enumerate();
            let seen: Vec<(usize, DVec3)> = seen.filter(|s| s.1.is_finite()).collect();
            let Some(nearest) = self.nearest(&seen, 1).pop() else {
                continue;
            };
            let misfit = |pose: ArrayView1<'_, f64>| {
                let pairs = seen.iter().map(|(p, at)| (point(pose, *p), *at, 1.0));
                Some(fit_similarity(pairs, TransformKind::Rigid)?.error)
            };
            let misfits = tilted.rows().into_iter().filter_map(misfit);
            upright += nearest.square;
            let least = misfits.fold(f64::INFINITY, f64::min);
            free += least.min(nearest.square).max(ROUNDING);
            most = most.max(seen.len());
        }
        let limit = if most >= MANY_POINTS {
            NOT_UP.1
        } else {
            NOT_UP.0
        };
        upright <= limit * limit * free
    }

    /// The `count` poses nearest to the seen points, the nearest first.
    fn nearest(&self, seen: &[(usize, DVec3)], count: usize) -> Vec<Near> {
        let to = center(seen);
        let seen: Vec<(usize, DVec3)> = seen.iter().map(|(p, at)| (*p, *at - to)).collect();
        let size: f64 = seen.iter().map(|(_, at)| at.length_squared()).sum();
        let near = |(row, pose): (usize, ArrayView1<'_, f64>)| {
            let (mut center, mut squares) = (DVec3::ZERO, 0.0);
            let (mut sin, mut cos, mut along) = (0.0, 0.0, 0.0);
            for (p, at) in &seen {
                let x = point(pose, *p);
                center += x;
                squares += x.length_squared();
                sin += x.z * at.x - x.x * at.z;
                cos += x.x * at.x + x.z * at.z;
                along += x.y * at.y;
            }
            let n = seen.len().max(1) as f64;
            let own = squares - center.length_squared() / n;
            Near {
                row,
                square: (own + size - 2.0 * (sin.hypot(cos) + along)).max(0.0),
                angle: sin.atan2(cos),
                center: center / n,
            }
        };
        let mut all: Vec<Near> = self
            .poses
            .rows()
            .into_iter()
            .enumerate()
            .map(near)
            .collect();
        let order = |a: &Near, b: &Near| a.square.total_cmp(&b.square).then(a.row.cmp(&b.row));
        if all.len() > count {
            all.select_nth_unstable_by(count, order);
            all.truncate(count);
        }
        all.sort_by(order);
        all
    }
}

impl Prior for UprightPoses {
    fn residual_variance(&self) -> &[f64] {
        &self.residual
    }

    /// Without its evidence.
    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let seen = seen_points(observation);
        let to = center(&seen);
        let near = self.nearest(&seen, NEAREST);
        let weights = near.iter().map(|n| (n.square + SOFTENING).powi(-2));
        let weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        let width = self.poses.ncols();
        let mut poses = Array2::zeros((near.len(), width));
        for (near, mut out) in near.iter().zip(poses.rows_mut()) {
            let (turn, pose) = (DMat3::from_rotation_y(near.angle), self.poses.row(near.row));
            for p in 0..width / 3 {
                let x = turn * (point(pose, p) - near.center) + to;
                (0..3).for_each(|axis| out[3 * p + axis] = x[axis]);
            }
        }
        let weights = Array1::from_iter(weights.iter().map(|w| w / total));
        let mean = weights.dot(&poses);
        let mut off = poses - &mean;
        off *= &weights.mapv(f64::sqrt).insert_axis(Axis(1));
        let mut covariance = off.t().dot(&off);
        covariance.diag_mut().mapv_inplace(|v| v + RIDGE);
        let given = ConditionalGaussian::new(covariance.view(), observation.variance);
        let residual: Vec<f64> = (observation.values.iter().zip(&mean))
            .map(|(y, m)| y - m)
            .collect();
        let moved = given.mean(&residual);
        let mean = mean.iter().zip(moved).map(|(m, by)| m + by).collect();
        let mut left = given.covariance(covariance.view());
        for (v, noise) in left.diag_mut().iter_mut().zip(observation.variance) {
            // The ridge stands for what the poses do not say of the seen points.
            *v -= if noise.is_finite() { 0.0 } else { RIDGE - LEFT };
        }
        left *= SPREAD;
        let mut posterior = Posterior::full(mean, left, 0.0);
        if want != Want::Covariance {
            posterior.covariance = Array2::zeros((0, 0));
        }
        posterior
    }

    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        self.poses.view()
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        Box::new(UprightPoses {
            poses: map.apply_rows(self.poses.view()),
            residual: self.residual.clone(),
        })
    }
}

/// The whole points of an observation.
fn seen_points(observation: &Observation<'_>) -> Vec<(usize, DVec3)> {
    let points = observation.values.chunks_exact(3).enumerate();
    let is_seen = |p: usize| {
        observation.variance[3 * p..3 * p + 3]
            .iter()
            .all(|v| v.is_finite())
    };
    (points.filter(|(p, _)| is_seen(*p)))
        .map(|(p, at)| (p, DVec3::from_slice(at)))
        .collect()
}

fn point(pose: ArrayView1<'_, f64>, p: usize) -> DVec3 {
    DVec3::new(pose[3 * p], pose[3 * p + 1], pose[3 * p + 2])
}

fn center(seen: &[(usize, DVec3)]) -> DVec3 {
    seen.iter().map(|s| s.1).sum::<DVec3>() / seen.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body of a pelvis, two feet, two hands and a head, that leans forward and back by its
    /// pelvis; its poses in the pelvis's frame, and which way is up in each.
    fn leaning() -> (Array2<f64>, Array2<f64>) {
        let body = [
            [0.0, 0.0, 0.0],
            [9.0, -90.0, 2.0],
            [-9.0, -90.0, -2.0],
            [25.0, -5.0, 5.0],
            [-25.0, 0.0, 10.0],
            [0.0, 70.0, 4.0],
        ];
        let lean = |t: usize| 0.4 * (t as f64 * 0.3).sin();
        let poses = Array2::from_shape_fn((60, 18), |(t, c)| {
            let swing = 8.0 * (t as f64 * 0.3 + (c / 3) as f64).sin();
            body[c / 3][c % 3] + if c >= 9 && c % 3 == 2 { swing } else { 0.0 }
        });
        let up = Array2::from_shape_fn((60, 3), |(t, c)| [0.0, lean(t).cos(), lean(t).sin()][c]);
        (poses, up)
    }

    /// A pose that stands upright somewhere in the world.
    fn standing(upright: &UprightPoses, row: usize) -> Vec<f64> {
        let turn = DMat3::from_rotation_y(2.0);
        let pose = upright.poses.row(row).to_vec();
        let at = |p: &[f64]| turn * DVec3::from_slice(p) + DVec3::new(300.0, 95.0, -40.0);
        pose.chunks_exact(3)
            .flat_map(|p| at(p).to_array())
            .collect()
    }

    fn only(points: &[usize]) -> Vec<f64> {
        let noise = (0..18).map(|c| {
            if points.contains(&(c / 3)) {
                0.0
            } else {
                f64::INFINITY
            }
        });
        noise.collect()
    }

    #[test]
    fn a_body_of_which_three_points_are_seen_stands_upright() {
        let (poses, up) = leaning();
        let upright = UprightPoses::new(poses.view(), up.view());
        let truth = standing(&upright, 17);
        let noise = only(&[3, 4, 5]);
        let given = Observation {
            values: &truth,
            variance: &noise,
        };
        let placed = upright.place(&given).unwrap();
        assert!((placed.shift - DVec3::new(300.0, 95.0, -40.0)).length() <= 1e-6);
        let found = upright.posterior(&given, Want::Covariance);
        for (c, (found, truth)) in found.mean.iter().zip(&truth).enumerate() {
            let most = if c < 9 { 2.0 } else { 1e-6 };
            assert!((found - truth).abs() <= most, "{c}: {found} {truth}");
        }
        let sound = |i: usize| found.variance[i] >= LEFT && found.covariance[[i, i]] >= LEFT;
        assert!((0..9).all(sound));
        // Upside down, the same triangle gives no body that hangs from its feet.
        let mut turned = truth.clone();
        (0..6).for_each(|p| turned[3 * p + 1] = 190.0 - truth[3 * p + 1]);
        let given = Observation {
            values: &turned,
            variance: &noise,
        };
        let found = upright.posterior(&given, Want::Mean);
        assert!(found.mean[4] < turned[16] && found.mean[4] < turned[10]);
    }

    #[test]
    fn a_take_that_is_tilted_is_told() {
        let (poses, up) = leaning();
        let upright = UprightPoses::new(poses.view(), up.view());
        let take = (0..40).flat_map(|t| standing(&upright, t));
        let mut take = Array2::from_shape_vec((40, 18), take.collect()).unwrap();
        take.slice_mut(s![.., ..9]).fill(f64::NAN);
        assert!(upright.are_upright(take.view()));
        let z_up =
            Array2::from_shape_fn((40, 18), |(t, c)| take[[t, 3 * (c / 3) + [2, 0, 1][c % 3]]]);
        assert!(!upright.are_upright(z_up.view()));
    }

    #[test]
    fn points_above_one_another_say_no_heading() {
        let (poses, up) = leaning();
        let upright = UprightPoses::new(poses.view(), up.view());
        let can_place = |y: &[f64], points: &[usize]| {
            let seen = Observation {
                values: y,
                variance: &only(points),
            };
            upright.place(&seen).is_some()
        };
        let mut y = vec![0.0; 18];
        (0..6).for_each(|p| y[3 * p + 1] = 30.0 * p as f64);
        assert!(!can_place(&y, &[3, 4, 5]));
        y[9] = 20.0;
        assert!(can_place(&y, &[3, 4, 5]));
        assert!(!can_place(&y, &[3, 4]));
    }
}
