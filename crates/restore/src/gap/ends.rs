//! The ends of a gap at which its points are seen, but not all of what they are learned from.
//!
//! Where a predictor goes missing in the very frame in which a gap ends, the regression would not
//! know that end. For that one frame the predictor goes straight on, at its rigid distances from
//! what is seen, which errs by less than what a whole gap drifts from an end that is not known.

use super::rigid_distances::TakeDistances;
use super::tuning::ends::*;
use crate::numeric::hermite::velocity;
use ndarray::{ArrayView1, CowArray, Ix2};
use std::ops::Range;

/// Carries predictors on into the frames right before and after `gap` in which all `targets` of
/// `xyz` (frames, 3 J; NaN missing) are known; `seconds` of each frame. Returns those frames.
pub(crate) fn hold(
    xyz: &mut CowArray<'_, f64, Ix2>,
    seconds: &[f64],
    gap: &Range<usize>,
    predictors: &[usize],
    targets: &[usize],
) -> Vec<usize> {
    let last = xyz.nrows();
    let before = gap.start.checked_sub(1).map(|t| {
        let inner: Vec<usize> = (gap.start..last).take(FRAMES).collect();
        (t, inner)
    });
    let after = (gap.end < last).then(|| (gap.end, (0..gap.end).rev().take(FRAMES).collect()));
    let mut held = Vec::new();
    for (t, inner) in before.into_iter().chain(after) {
        let is_known = |t: usize, p: usize| (3 * p..3 * p + 3).all(|i| xyz[[t, i]].is_finite());
        let is_missing = |p: &usize| !is_known(t, *p);
        let missing: Vec<usize> = predictors.iter().copied().filter(is_missing).collect();
        // Beyond a cut nothing goes on.
        let step = (seconds[inner[0]] - seconds[t]).abs();
        if missing.is_empty() || targets.iter().any(is_missing) || step > 1.0 {
            continue;
        }
        let carried = |i: usize| {
            let known = inner.iter().take_while(|k| xyz[[**k, i]].is_finite());
            let samples: Vec<(f64, f64)> = known.map(|k| (seconds[*k], xyz[[*k, i]])).collect();
            let on = velocity(&samples, step, None)? * (seconds[t] - samples[0].0);
            Some((i, samples[0].1 + on))
        };
        let coordinates = missing.iter().flat_map(|p| 3 * p..3 * p + 3);
        if let Some(carried) = coordinates.map(carried).collect::<Option<Vec<_>>>() {
            let mut frame = xyz.row(t).to_vec();
            carried.into_iter().for_each(|(i, v)| frame[i] = v);
            let mut variance = vec![SD * SD; 3 * missing.len()];
            TakeDistances::measure(xyz.view(), &missing).hold(
                &mut frame,
                &missing,
                &mut variance,
                |_| 0.0,
            );
            xyz.row_mut(t).assign(&ArrayView1::from(&frame));
            held.push(t);
        }
    }
    held
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn a_predictor_goes_on_for_the_frame_in_which_the_gap_ends() {
        let mut xyz = Array2::from_shape_fn((40, 6), |(t, c)| (t * (c + 1)) as f64);
        let truth = xyz.clone();
        // The target, point 0, is missing in 10..20, the predictor from 20 on and before 10.
        for t in (0..10).chain(20..40) {
            xyz.slice_mut(ndarray::s![t, 3..]).fill(f64::NAN);
        }
        let mut cow = CowArray::from(&xyz);
        let seconds: Vec<f64> = (0..40).map(|t| f64::from(t) / 100.0).collect();
        let gap = 10..20;
        assert_eq!(hold(&mut cow, &seconds, &gap, &[1], &[0]), [9, 20]);
        for (t, i) in [(9, 3), (9, 5), (20, 4)] {
            assert!((cow[[t, i]] - truth[[t, i]]).abs() < 1e-9);
        }
        assert!(cow[[21, 3]].is_nan());
        // Where the target is not seen either there is nothing to hold.
        xyz[[20, 0]] = f64::NAN;
        let mut cow = CowArray::from(&xyz);
        assert_eq!(hold(&mut cow, &seconds, &gap, &[1], &[0]), [9]);
    }
}
