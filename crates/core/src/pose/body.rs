//! A body: which joints its bones join, and how long they are.
//!
//! Carrying a pose from one body to another, `y'ₖ = y'ₚ + rₖ (yₖ − yₚ)` with rₖ the ratio of the
//! lengths, is linear in the pose. So a whole dictionary can be carried to the captured body,
//! whatever joints are missing there.

use super::joints::{CMU, parents_by_name};
use crate::numeric::statistics::median;
use glam::DVec3;
use ndarray::ArrayView2;

/// Bones between points, and their lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// The point each point hangs on; `None` for roots.
    pub parents: Vec<Option<usize>>,
    /// Bone lengths from parent to point, centimeters; NaN where unknown or where there is no
    /// parent.
    pub lengths: Vec<f64>,
}

impl Body {
    /// A body whose lengths are not known.
    pub fn unknown(parents: Vec<Option<usize>>) -> Body {
        let lengths = vec![f64::NAN; parents.len()];
        Body { parents, lengths }
    }

    /// The bones of frames x 3 J numbers: each length is the median over the frames that show both
    /// ends.
    ///
    /// At most 2,000 frames are looked at, evenly spread, so that the cost does not grow with the
    /// take.
    pub fn measure(parents: &[Option<usize>], xyz: ArrayView2<'_, f64>) -> Body {
        let step = xyz.nrows().div_ceil(2000).max(1);
        let lengths = parents
            .iter()
            .enumerate()
            .map(|(k, parent)| {
                let Some(p) = *parent else { return f64::NAN };
                let seen: Vec<f64> = xyz
                    .rows()
                    .into_iter()
                    .step_by(step)
                    .map(|row| {
                        let at = |j: usize| DVec3::new(row[3 * j], row[3 * j + 1], row[3 * j + 2]);
                        (at(k) - at(p)).length()
                    })
                    .filter(|l| l.is_finite())
                    .collect();
                median(seen).unwrap_or(f64::NAN)
            })
            .collect();
        Body {
            parents: parents.to_vec(),
            lengths,
        }
    }

    /// The points in an order in which parents come first.
    #[doc(hidden)]
    pub fn order(&self) -> Vec<usize> {
        let mut order = Vec::with_capacity(self.parents.len());
        let mut done = vec![false; self.parents.len()];
        // At most as many rounds as the deepest chain; a cycle (never built here) would end them
        // early.
        loop {
            let before = order.len();
            for k in 0..self.parents.len() {
                if !done[k] && self.parents[k].is_none_or(|p| done[p]) {
                    done[k] = true;
                    order.push(k);
                }
            }
            if order.len() == before {
                return order;
            }
        }
    }

    /// Ratio of each bone's length in `other` to its length here. Bones that either body does not
    /// know take the median of the known ratios, or 1 when there is none.
    pub(crate) fn ratios_to(&self, other: &Body) -> Vec<f64> {
        let ratio = |k: usize| other.lengths[k] / self.lengths[k];
        let known = |r: &f64| r.is_finite() && *r > 0.0;
        let all = (0..self.lengths.len()).map(ratio).filter(known);
        let usual = median(all.collect()).unwrap_or(1.0);
        (0..self.lengths.len())
            .map(ratio)
            .map(|r| if known(&r) { r } else { usual })
            .collect()
    }

    /// Carries a pose of 3 J numbers to another body: bone k becomes `ratios[k]` times as long, and
    /// keeps its direction. Roots stay. Linear in the pose.
    ///
    /// ```
    /// use posing_core::pose::Body;
    ///
    /// // A hip and a knee 40 cm below it; the other person's thigh is a quarter longer.
    /// let body = Body { parents: vec![None, Some(0)], lengths: vec![0.0, 40.0] };
    /// let mut other = [0.0; 6];
    /// body.reshape(&[0, 1], &[1.0, 1.25], &[0.0, 90.0, 0.0, 0.0, 50.0, 0.0], &mut other);
    /// assert_eq!(other, [0.0, 90.0, 0.0, 0.0, 40.0, 0.0]);
    /// ```
    pub fn reshape(&self, order: &[usize], ratios: &[f64], pose: &[f64], out: &mut [f64]) {
        for &k in order {
            for c in 0..3 {
                out[3 * k + c] = match self.parents[k] {
                    None => pose[3 * k + c],
                    Some(p) => out[3 * p + c] + ratios[k] * (pose[3 * k + c] - pose[3 * p + c]),
                };
            }
        }
    }
}

/// The sum of the median bone lengths from a foot over the hips to the head, cm, for points with
/// CMU's names (bone ends) and `noise` of this standard deviation on each coordinate, cm; `None`
/// where a foot, a hip and the head are not all among them, or no foot and head of which every bone
/// to the root is seen: what is left of a body is no measure of it.
pub fn stature(names: &[String], xyz: ArrayView2<'_, f64>, noise: f64) -> Option<f64> {
    let find = |name: &str| names.iter().position(|n| n == name);
    let head = find(CMU[14])?;
    find(CMU[1]).or(find(CMU[5])).or(find(CMU[0]))?;
    let body = Body::measure(&parents_by_name(names), xyz);
    let up = |from: usize| {
        let chain = std::iter::successors(Some(from), |&k| body.parents[k]);
        let bones = chain.filter(|&k| body.parents[k].is_some());
        let lengths: Vec<f64> = bones.map(|k| body.lengths[k]).collect();
        if !lengths.iter().all(|l| l.is_finite()) {
            return 0.0;
        }
        (lengths.iter())
            // Noise makes a bone longer: the mean square is L² + 6 σ².
            .map(|l| (l * l - 6.0 * noise * noise).max(0.25 * l * l).sqrt())
            .sum::<f64>()
    };
    let feet = [find(CMU[4]), find(CMU[8])].into_iter().flatten().map(up);
    let leg = feet.fold(0.0, f64::max);
    (leg > 0.0 && up(head) > 0.0).then(|| leg + up(head))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn lengths_are_medians_of_what_is_seen() {
        let parents = vec![None, Some(0), Some(1)];
        let n = f64::NAN;
        let xyz = array![
            [0., 0., 0., 3., 4., 0., n, 0., 0.],
            [0., 0., 0., 0., 0., 5., 0., 0., 7.],
            [n, n, n, 1., 1., 1., 0., 0., 0.]
        ];
        let body = Body::measure(&parents, xyz.view());
        assert!(body.lengths[0].is_nan());
        assert!((body.lengths[1] - 5.0).abs() <= 1e-12);
        assert!((body.lengths[2] - 2.0).abs() <= 1e-12);
    }

    #[test]
    fn reshaping_gives_the_lengths_asked_for_and_turns_back() {
        // Parents may follow their children in the table.
        let parents = vec![Some(2), Some(0), None];
        let pose = [1.0, 2.0, 0.5, 4.0, 4.0, 4.0, 0.0, 0.0, 1.0];
        let from = Body::measure(&parents, ArrayView2::from_shape((1, 9), &pose).unwrap());
        let mut to = from.clone();
        to.lengths = vec![7.0, 3.0, f64::NAN];
        let order = from.order();
        let ratios = from.ratios_to(&to);
        let mut out = [0.0; 9];
        from.reshape(&order, &ratios, &pose, &mut out);
        let got = Body::measure(&parents, ArrayView2::from_shape((1, 9), &out).unwrap());
        assert!((got.lengths[0] - 7.0).abs() <= 1e-12 && (got.lengths[1] - 3.0).abs() <= 1e-12);
        let mut back = [0.0; 9];
        let inverse: Vec<f64> = ratios.iter().map(|r| 1.0 / r).collect();
        from.reshape(&order, &inverse, &out, &mut back);
        assert!(pose.iter().zip(back).all(|(a, b)| (a - b).abs() <= 1e-12));
    }

    #[test]
    fn a_stature_needs_a_leg_that_is_seen_whole() {
        let names = crate::pose::joints::cmu_names();
        let mut xyz = ndarray::Array2::from_shape_fn((3, 69), |(_, c)| (c / 3 * (c % 3)) as f64);
        let whole = stature(&names, xyz.view(), 0.0).unwrap();
        // One leg is enough; its foot alone, or its knee alone, is not.
        xyz.slice_mut(ndarray::s![.., 6..15]).fill(f64::NAN);
        let one = stature(&names, xyz.view(), 0.0).unwrap();
        assert!(one > 0.0 && one <= whole);
        let knee = ndarray::s![.., 21..24];
        xyz.slice_mut(knee).fill(f64::NAN);
        assert!(stature(&names, xyz.view(), 0.0).is_none());
    }

    #[test]
    fn unknown_bones_take_the_usual_ratio() {
        let a = Body {
            parents: vec![None, Some(0), Some(0)],
            lengths: vec![f64::NAN, 2.0, f64::NAN],
        };
        let b = Body {
            parents: a.parents.clone(),
            lengths: vec![f64::NAN, 3.0, 9.0],
        };
        assert_eq!(a.ratios_to(&b), [1.5, 1.5, 1.5]);
        assert_eq!(
            a.ratios_to(&Body::unknown(a.parents.clone())),
            [1.0, 1.0, 1.0]
        );
    }
}
