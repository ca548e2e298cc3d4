//! The bones of the limbs of a denoised take held to one length each.
//!
//! A bone's length is the median over the take; what varies by more than noise and breathing bones
//! do is none. In each frame the ends of the bones are moved along them until every length is near,
//! the less the surer they are (Müller et al. 2007, Position based dynamics).

use super::take::TakeResult;
use super::tuning::bone_lengths::*;
use crate::label::marker_distances::Distance;
use crate::pose::{Status, point_at};
use glam::{DMat3, DVec3};

/// Holds `bones`, pairs of points, to their lengths. Points that are as they were measured stay.
pub(crate) fn hold(out: &mut TakeResult, bones: &[[usize; 2]]) {
    let frames = out.xyz.nrows();
    let length = |[a, b]: [usize; 2]| {
        let is_measured = |t: &usize| {
            let status = [a, b].map(|p| out.state(*t, p).status);
            (status.iter()).all(|s| matches!(s, Status::Observed | Status::Changed))
        };
        let of = |t| point_at(out.xyz.view(), t, a).distance(point_at(out.xyz.view(), t, b));
        let lengths = (0..frames).filter(is_measured).map(of);
        let found = Distance::of(lengths.filter(|l| l.is_finite()).collect())?;
        let is_bone = found.frames >= FEWEST_FRAMES && found.spread <= MOST_SPREAD * found.median;
        is_bone.then_some(found.median)
    };
    let measured = bones.iter().map(|bone| Some((*bone, length(*bone)?)));
    let bones: Vec<([usize; 2], f64)> = measured.flatten().collect();
    for t in 0..frames {
        hold_frame(out, t, &bones);
    }
}

fn hold_frame(out: &mut TakeResult, t: usize, bones: &[([usize; 2], f64)]) {
    let mut at: Vec<DVec3> = (0..out.points())
        .map(|p| point_at(out.xyz.view(), t, p))
        .collect();
    let covariance = |p: usize| match out.state(t, p).status {
        Status::Observed | Status::Unknown => DMat3::ZERO,
        _ => DMat3::from_diagonal(DVec3::splat(out.state(t, p).sd.powi(2))),
    };
    draw(&mut at, bones, covariance, ROUNDS, NEAR);
    for p in bones.iter().flat_map(|(ends, _)| *ends) {
        (0..3).for_each(|axis| out.xyz[[t, 3 * p + axis]] = at[p][axis]);
    }
}

/// Draws the points of a frame along `bones`, their ends and lengths, until every length is within
/// `near`, in so many rounds at most: each the more the less sure it is, where it is least so, by
/// the `covariance` of a point; of none it stays.
pub(crate) fn draw(
    at: &mut [DVec3],
    bones: &[([usize; 2], f64)],
    covariance: impl Fn(usize) -> DMat3,
    rounds: usize,
    near: f64,
) {
    for _ in 0..rounds {
        let mut worst = 0.0f64;
        for (ends, length) in bones {
            let apart = at[ends[1]] - at[ends[0]];
            let along = apart.normalize_or_zero();
            let weighed = ends.map(|p| covariance(p) * along);
            let off = apart.length() - length;
            let by = off / along.dot(weighed[0] + weighed[1]);
            if by.is_finite() {
                at[ends[0]] += by * weighed[0];
                at[ends[1]] -= by * weighed[1];
                worst = worst.max(off.abs());
            }
        }
        if worst <= near {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn lengths_are_right_and_sure_points_move_less() {
        let x = [0.0, 30.0, 55.0];
        let xyz = Array2::from_shape_fn((40, 9), |(t, c)| match c % 3 {
            0 => x[c / 3] + 2.0 * ((t * (c + 7)) as f64).sin(),
            _ => (t as f64 / 10.0 + c as f64).sin(),
        });
        let mut out = TakeResult::captured(xyz.view());
        for t in 0..40 {
            (0..3).for_each(|p| out.set(t, p, Status::Changed, [0.1, 1.0, 1.0][p]));
        }
        out.set(7, 1, Status::Observed, 1e-6);
        let before = out.xyz.clone();
        hold(&mut out, &[[0, 1], [1, 2]]);
        let length = |t: usize, a: usize, b: usize| {
            point_at(out.xyz.view(), t, a).distance(point_at(out.xyz.view(), t, b))
        };
        let [first, second] = [length(0, 0, 1), length(0, 1, 2)];
        for t in 0..40 {
            assert!((length(t, 0, 1) - first).abs() <= 2.0 * NEAR);
            assert!((length(t, 1, 2) - second).abs() <= 2.0 * NEAR);
        }
        let moved = |t: usize, p: usize| {
            point_at(out.xyz.view(), t, p).distance(point_at(before.view(), t, p))
        };
        assert_eq!(moved(7, 1), 0.0);
        assert!(moved(3, 0) < 0.1 * moved(3, 1));
    }
}
