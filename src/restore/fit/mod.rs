//! A take fitted with a skeleton: Algorithm 1, then P2, frame after frame.
//!
//! Each frame starts from the one before, so that what the joints leave open (a twist) moves no more than it must.
//! Where that ends far from the joints, it starts again: from the posture found bone by bone, then from ones in which
//! the limbs that do not fit are turned at random (seeded, so that the same take gives the same values).

mod fitter;
mod starts;

use super::ik::{MOST_VALUES, Settings};
use crate::pose::Skeleton;
use crate::{Error, Result};
use fitter::Fitter;
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

/// How a take is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitSettings {
    /// Of each frame's solution.
    pub solve: Settings,
    /// Other starts for a frame that does not fit, the first frame apart, which has four times as many.
    pub restarts: usize,
    /// Where randomness starts.
    pub seed: u64,
}

impl Default for FitSettings {
    fn default() -> Self {
        FitSettings {
            solve: Settings::default(),
            restarts: 8,
            seed: 0,
        }
    }
}

/// A take's values and how well they fit.
#[derive(Debug, Clone, Default)]
pub struct Fit {
    /// (frames, values of the skeleton), radians and centimetres.
    pub values: Array2<f64>,
    /// The mean distance of a fitted joint from its point, centimetres; NaN when no point is there.
    pub mean: f64,
    /// The largest.
    pub max: f64,
    /// The frame and target of the largest.
    pub worst: Option<(usize, usize)>,
    /// Frames in which a point is missing.
    pub incomplete: usize,
    /// Frames whose root could not be placed: it stands where it stood before.
    pub unplaced: usize,
    /// Frames that needed another start.
    pub restarted: usize,
    /// Frames that neither fit nor converged.
    pub unconverged: usize,
}

/// Fits a skeleton to a take.
///
/// `joints[k]` is the bone whose end is the point in columns 3 k to 3 k + 2 of `xyz` (frames, 3 K; centimetres; NaN is
/// missing). A missing point says nothing: the values it alone would tell stay as they were in the frame before (in
/// the first seen frame after, for a take's start); the root does where its own point and all but two are missing.
/// `watch` is told after each frame how many are done.
pub fn fit(
    skeleton: &Skeleton,
    joints: &[usize],
    xyz: ArrayView2<'_, f64>,
    settings: &FitSettings,
    watch: &mut dyn FnMut(usize),
) -> Result<Fit> {
    if skeleton.dof_count() > MOST_VALUES {
        return Err(Error::usage(format!(
            "the skeleton has {} degrees of freedom; at most {MOST_VALUES} can be solved for",
            skeleton.dof_count()
        )));
    }
    if joints.is_empty() || xyz.ncols() != 3 * joints.len() {
        return Err(Error::usage(
            "no point of the table is a joint of the skeleton",
        ));
    }
    let mut fitter = Fitter::new(skeleton, joints, settings);
    let mut out = Fit {
        values: Array2::zeros((xyz.nrows(), skeleton.dof_count())),
        mean: f64::NAN,
        max: f64::NAN,
        ..Fit::default()
    };
    let Some(first) = fitter.best_seen(xyz) else {
        return Ok(out);
    };
    fitter.start(
        xyz.row(first)
            .as_slice()
            .unwrap_or(&xyz.row(first).to_vec()),
    );
    let (mut sum, mut count) = (0.0, 0u64);
    for (i, row) in xyz.rows().into_iter().enumerate() {
        let y = row.to_vec();
        fitter.frame(&y, &mut out);
        out.values
            .row_mut(i)
            .iter_mut()
            .zip(&fitter.q)
            .for_each(|(v, q)| *v = *q);
        let q = std::mem::take(&mut fitter.q);
        let posture = fitter.solver.posture(&q);
        for (t, (&joint, y)) in joints.iter().zip(y.chunks_exact(3)).enumerate() {
            let far = (posture.ends[joint] - DVec3::from_slice(y)).length();
            if far.is_finite() {
                sum += far;
                count += 1;
                if !(far <= out.max) {
                    out.max = far;
                    out.worst = Some((i, t));
                }
            }
        }
        fitter.q = q;
        watch(i + 1);
    }
    if count > 0 {
        out.mean = sum / count as f64;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use crate::pose::{Bone, Channel, Dof};
    use glam::DMat3;

    /// A root that slides and turns, an arm that is a ball joint, a hinge on it.
    fn arm() -> Skeleton {
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let turns = axes.map(Channel::Rotate).to_vec();
        let bone = |name: &str, parent, offset: [f64; 3], channels: Vec<Channel>| Bone {
            name: name.into(),
            parent,
            offset: DVec3::from_array(offset),
            axis: DMat3::from_rotation_y(0.4),
            dofs: channels.into_iter().map(Dof::free).collect(),
        };
        let six = [axes.map(Channel::Translate).to_vec(), turns.clone()].concat();
        Skeleton::new(vec![
            bone("root", None, [0., 0., 0.], six),
            bone("a", Some(0), [9., 1., 0.], vec![]),
            bone("b", Some(0), [-9., 0., 2.], vec![]),
            bone("upper", Some(1), [0., -30., 1.], turns),
            bone(
                "lower",
                Some(3),
                [0., -25., 3.],
                vec![Channel::Rotate(Axis::X)],
            ),
        ])
        .unwrap()
    }

    /// A motion that leaps far from frame to frame.
    fn leaps(s: &Skeleton, frames: usize) -> Array2<f64> {
        let mut xyz = Array2::zeros((frames, 15));
        for (i, mut row) in xyz.rows_mut().into_iter().enumerate() {
            let q: Vec<f64> = (0..s.dof_count())
                .map(|k| 1.5 * ((k + 1 + 13 * i) as f64 * 2.3).sin())
                .collect();
            let places = s.posture(&q).ends.into_iter().flat_map(|e| e.to_array());
            row.iter_mut().zip(places).for_each(|(a, b)| *a = b);
        }
        xyz
    }

    #[test]
    fn even_leaps_are_followed_and_the_same_take_gives_the_same_values() {
        let (s, joints) = (arm(), [0, 1, 2, 3, 4]);
        let xyz = leaps(&s, 40);
        let mut told = 0;
        let run = |watch: &mut dyn FnMut(usize)| {
            fit(&s, &joints, xyz.view(), &FitSettings::default(), watch)
        };
        let found = run(&mut |n| told = n).unwrap();
        assert_eq!((told, found.incomplete, found.unplaced), (40, 0, 0));
        // Leaps of a radian a frame look like noise, which holds the values a little.
        assert!(found.max <= 0.05, "{}", found.max);
        assert_eq!(found.values, run(&mut |_| {}).unwrap().values);
    }

    #[test]
    fn what_is_not_there_is_no_fault() {
        let (s, joints) = (arm(), [0, 1, 2, 3, 4]);
        let none = Array2::from_elem((3, 15), f64::NAN);
        let found = fit(
            &s,
            &joints,
            none.view(),
            &FitSettings::default(),
            &mut |_| {},
        )
        .unwrap();
        assert!(found.mean.is_nan() && found.values.iter().all(|v| *v == 0.0));
        let empty = Array2::zeros((0, 15));
        assert_eq!(
            fit(
                &s,
                &joints,
                empty.view(),
                &FitSettings::default(),
                &mut |_| {}
            )
            .unwrap()
            .values
            .nrows(),
            0
        );
        assert!(fit(&s, &[], empty.view(), &FitSettings::default(), &mut |_| {}).is_err());
        // Infinite and huge points are no places.
        let mut odd = leaps(&s, 4);
        odd[[1, 4]] = f64::INFINITY;
        odd[[2, 7]] = 1e200;
        let found = fit(
            &s,
            &joints,
            odd.view(),
            &FitSettings::default(),
            &mut |_| {},
        )
        .unwrap();
        assert!(found.values.iter().all(|v| v.is_finite()));
    }
}
