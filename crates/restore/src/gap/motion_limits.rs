//! What a point of a take can do: move as fast as it is seen to, and be as far from others. A
//! filled path that does more was estimated from too little.

use super::tuning::motion_limits::*;
use super::{FilledGap, Gap};
use crate::pose::point_at;
use crate::take::Take;
use ndarray::ArrayView2;
use std::collections::BTreeMap;

/// The limits of the points that have gaps.
pub(crate) struct MotionLimits {
    points: BTreeMap<usize, PointLimits>,
    /// The step that any point may make, cm.
    any_step: f64,
}

struct PointLimits {
    /// The longest step from one frame to the next, cm; infinite where the point is seen too
    /// little to say.
    step: f64,
    /// Other points, and how far away they are at most, cm.
    distances: Vec<(usize, f64)>,
}

impl MotionLimits {
    /// Measures them in a take.
    pub(crate) fn measure(take: &Take<'_>, gaps: &[Gap]) -> MotionLimits {
        let captured = take.xyz;
        let points: BTreeMap<usize, ()> = gaps.iter().map(|g| (g.point, ())).collect();
        let limits = |(point, ()): (usize, ())| {
            let steps = take.runs.iter().flat_map(|r| r.start + 1..r.end);
            let steps = steps
                .map(|t| point_at(captured, t, point).distance(point_at(captured, t - 1, point)));
            let spread = captured.nrows().div_ceil(FRAMES).max(1);
            let stride = (captured.ncols() / 3).div_ceil(OTHERS).max(1);
            let others = (0..captured.ncols() / 3)
                .step_by(stride)
                .filter(|o| *o != point);
            let distance =
                |other: usize| {
                    let frames = (0..captured.nrows()).step_by(spread);
                    most(frames.map(|t| {
                        point_at(captured, t, point).distance(point_at(captured, t, other))
                    }))
                };
            let distances = others.map(|o| (o, distance(o))).collect();
            (
                point,
                PointLimits {
                    step: most(steps),
                    distances,
                },
            )
        };
        MotionLimits {
            points: points.into_iter().map(limits).collect(),
            any_step: ANY_SPEED / take.rate,
        }
    }

    /// Whether a filled gap stays within its point's limits.
    pub(crate) fn allow(
        &self,
        captured: ArrayView2<'_, f64>,
        gap: &Gap,
        filled: &FilledGap,
    ) -> bool {
        let Some(limits) = self.points.get(&gap.point) else {
            return true;
        };
        let path = |k: usize| point_at(filled.xyz.view(), k, 0);
        let step = self.any_step.max(MORE * limits.step);
        (1..filled.xyz.nrows()).all(|k| path(k).distance(path(k - 1)) <= step)
            && gap.frames.clone().enumerate().all(|(k, t)| {
                limits.distances.iter().all(|&(other, most)| {
                    let distance = path(k).distance(point_at(captured, t, other));
                    distance.is_nan() || distance <= LEAST_DISTANCE + MORE * most
                })
            })
    }
}

/// The largest of the numbers; infinite where there are too few.
fn most(values: impl Iterator<Item = f64>) -> f64 {
    let known = values.filter(|v| v.is_finite());
    let (count, most) = known.fold((0, 0.0), |(n, most), v| (n + 1, v.max(most)));
    if count < FEWEST { f64::INFINITY } else { most }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::FillMethod;
    use ndarray::Array2;

    #[test]
    fn what_no_frame_shows_is_not_allowed() {
        // A point that circles another, 20 cm away, 2 cm a frame.
        let mut xyz = Array2::zeros((100, 6));
        for t in 0..100 {
            let (sin, cos) = (0.1 * t as f64).sin_cos();
            (xyz[[t, 3]], xyz[[t, 4]]) = (20.0 * cos, 20.0 * sin);
        }
        let truth = xyz.slice(ndarray::s![40..50, 3..]).to_owned();
        xyz.slice_mut(ndarray::s![40..50, 3..]).fill(f64::NAN);
        let gap = Gap {
            point: 1,
            frames: 40..50,
            before: Some(39),
            after: Some(50),
        };
        let take = Take {
            names: &[],
            xyz: xyz.view(),
            runs: std::slice::from_ref(&(0..100)),
            rate: 120.0,
            sd: None,
            motion: Default::default(),
        };
        let limits = MotionLimits::measure(&take, std::slice::from_ref(&gap));
        let allows = |path: Array2<f64>| {
            let filled = FilledGap {
                xyz: path,
                variance: vec![0.0; 10],
                method: FillMethod::Regression,
                contacts: Vec::new(),
            };
            limits.allow(xyz.view(), &gap, &filled)
        };
        assert!(allows(truth.clone()));
        assert!(!allows(&truth * 3.0));
        let mut jump = truth;
        jump[[5, 0]] -= 15.0; // more than 800 / 120 cm
        assert!(!allows(jump));
    }
}
