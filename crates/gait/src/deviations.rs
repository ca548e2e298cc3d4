//! What doubt about markers does to angles and joint centers: deviations through the Jacobian of
//! the model.

use crate::angles::{ANGLES, Body, CENTERS};
use crate::axes::wrapped;
use crate::markers::{Frame, Markers};
use crate::parameters::Subject;
use crate::side::Side;
use glam::{DMat3, DVec3};
use ndarray::ArrayView2;

/// The step of the numeric Jacobian, mm.
const STEP: f64 = 1.0;
/// Deviations of filled markers are too small by this factor: measured in made gaps of .1 and .25 s
/// of six people's walks and turns.
const INFLATED: f64 = 1.6;
/// What is computed of a side: its angles, then the centers of its joints.
pub(crate) const OUTPUTS: usize = ANGLES.len() + CENTERS.len();

/// The model's values of both sides in a frame.
fn outputs(frame: &Frame, subject: &Subject, lab: DMat3) -> [[DVec3; OUTPUTS]; 2] {
    let body = Body::new(frame, subject);
    Side::BOTH.map(|side| {
        let mut all = [DVec3::NAN; OUTPUTS];
        all[..ANGLES.len()].copy_from_slice(&body.angles(side, lab));
        all[ANGLES.len()..].copy_from_slice(&body.centers(side));
        all
    })
}

/// The derivatives of both sides' values in a frame by a coordinate of a marker, a millimeter.
fn derivative(
    frame: &Frame,
    (marker, axis, step): (usize, usize, f64),
    subject: &Subject,
    lab: DMat3,
) -> [[DVec3; OUTPUTS]; 2] {
    let [up, down] = [step, -step].map(|by| {
        let mut moved = *frame;
        moved.0[marker][axis] += by;
        outputs(&moved, subject, lab)
    });
    let value = |side: usize, i: usize| {
        let mut apart = up[side][i] - down[side][i];
        if i < ANGLES.len() {
            apart = DVec3::from_array(apart.to_array().map(wrapped));
        }
        apart / (2.0 * step)
    };
    [0, 1].map(|side| std::array::from_fn(|i| value(side, i)))
}

/// The deviations of both sides' values: of each frame in which a marker has one, and 0 in others.
/// `sd` (frames, markers of the model) is that of a marker's position along each axis, mm.
pub(crate) fn deviations(
    markers: &Markers,
    sd: ArrayView2<'_, f64>,
    subject: &Subject,
    lab: DMat3,
) -> [Vec<[DVec3; OUTPUTS]>; 2] {
    let mut all = [0, 1].map(|_| vec![[DVec3::ZERO; OUTPUTS]; markers.frames()]);
    for (t, row) in sd.rows().into_iter().enumerate() {
        let frame = markers.frame(t);
        for (marker, &sd) in row.iter().enumerate().filter(|(_, sd)| **sd > 0.0) {
            for axis in 0..3 {
                let slopes = derivative(&frame, (marker, axis, STEP), subject, lab);
                for (side, slopes) in slopes.iter().enumerate() {
                    for (sum, slope) in all[side][t].iter_mut().zip(slopes) {
                        let own = *slope * (INFLATED * sd);
                        // What does not depend on the marker may be missing.
                        *sum += own * own;
                    }
                }
            }
        }
    }
    let root = |v: &mut DVec3| *v = v.map(f64::sqrt);
    all.iter_mut().flatten().flatten().for_each(root);
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::markers::MARKERS;
    use crate::parameters::testdata;
    use ndarray::Array2;

    #[test]
    fn the_jacobian_is_that_of_a_smaller_step() {
        let (frame, subject) = (testdata::standing(), testdata::subject());
        let lab = DMat3::IDENTITY;
        let mut worst: f64 = 0.0;
        for marker in 0..MARKERS.len() {
            for axis in 0..3 {
                let [coarse, fine] = [STEP, STEP / 20.0]
                    .map(|step| derivative(&frame, (marker, axis, step), &subject, lab));
                let all = coarse.iter().flatten().zip(fine.iter().flatten());
                for (coarse, fine) in all {
                    worst = worst.max((*coarse - *fine).abs().max_element());
                }
            }
        }
        assert!(worst < 0.01, "{worst} degrees a millimeter");
    }

    #[test]
    fn deviations_are_those_of_the_markers_that_have_one() {
        let (frame, subject) = (testdata::standing(), testdata::subject());
        let tracks = MARKERS.into_iter().zip(frame.0.map(|p| vec![p; 30]));
        let markers = Markers::new(tracks).unwrap();
        let mut sd = Array2::zeros((30, MARKERS.len()));
        let knee = MARKERS.iter().position(|m| *m == "LKNE").unwrap();
        sd[[5, knee]] = 3.0;
        let [left, right] = deviations(&markers, sd.view(), &subject, DMat3::IDENTITY);
        let (knee, ankle) = (2, ANGLES.len() + 2);
        assert!(left[5][knee].x > 0.3 && left[5][ankle].length() > 0.0);
        assert_eq!(
            (left[4][knee], right[5][knee], left[5][0]),
            Default::default()
        );
    }
}
