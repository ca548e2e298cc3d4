//! Points that cannot be where they were captured: a rigid bone that ends there has the wrong length.

use crate::pose::Body;
use glam::DVec3;
use ndarray::ArrayView2;

/// A bone counts as rigid when its length spreads by no more than this over the take (cm, and share of its length).
const RIGID: (f64, f64) = (0.3, 0.01);
/// A rigid bone is broken when its length is off by more than this (cm, and share of its length).
const BROKEN: (f64, f64) = (1.0, 0.03);

/// The rigid bones of a take: (point, parent, length, by how much it may be off).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RigidBones(Vec<(usize, usize, f64, f64)>);

impl RigidBones {
    /// Measures the bones of frames x 3 J numbers; at most 2,000 frames are looked at. At least ten must show a bone.
    pub fn measure(parents: &[Option<usize>], xyz: ArrayView2<'_, f64>) -> RigidBones {
        let body = Body::measure(parents, xyz);
        let step = xyz.nrows().div_ceil(2000).max(1);
        let mut bones = Vec::new();
        for (k, parent) in parents.iter().enumerate() {
            let (Some(p), length) = (*parent, body.lengths[k]) else {
                continue;
            };
            let mut off: Vec<f64> = xyz
                .rows()
                .into_iter()
                .step_by(step)
                .map(|row| {
                    let at = |j: usize| DVec3::new(row[3 * j], row[3 * j + 1], row[3 * j + 2]);
                    ((at(k) - at(p)).length() - length).abs()
                })
                .filter(|d| d.is_finite())
                .collect();
            if off.len() < 10 || !(length > 0.0) {
                continue;
            }
            // Half of the frames: nearly as many may be bad (a fifth of all points makes a third of all bones).
            let at = off.len() / 2;
            let spread = *off.select_nth_unstable_by(at, f64::total_cmp).1;
            if spread <= RIGID.0.max(RIGID.1 * length) {
                // Six standard deviations of what the length does by itself (1.48 medians make one).
                bones.push((
                    k,
                    p,
                    length,
                    BROKEN.0.max(BROKEN.1 * length).max(6.0 * 1.48 * spread),
                ));
            }
        }
        RigidBones(bones)
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The points of a frame that break rigid bones; `noise` is the standard deviation of a coordinate.
    ///
    /// While a bone is broken, the end with the most broken bones is blamed, then the one with the larger share of its
    /// bones broken, then the one that `undecided` (a distance from what the model expects) points at.
    pub fn outliers(&self, y: &[f64], noise: f64, undecided: impl Fn(usize) -> f64) -> Vec<usize> {
        let at = |j: usize| DVec3::from_slice(&y[3 * j..3 * j + 3]);
        let seen: Vec<_> = self
            .0
            .iter()
            .map(|&(k, p, length, slack)| (k, p, (at(k) - at(p)).length() - length, slack))
            .filter(|(_, _, off, _)| off.is_finite())
            .collect();
        let broken_bones = |off: f64, slack: f64| off.abs() > slack + 6.0 * noise;
        let mut blamed: Vec<usize> = Vec::new();
        loop {
            // point -> (broken, all)
            let mut tally = std::collections::BTreeMap::<usize, (usize, usize)>::new();
            for &(k, p, off, slack) in &seen {
                if blamed.contains(&k) || blamed.contains(&p) {
                    continue;
                }
                for end in [k, p] {
                    let entry = tally.entry(end).or_default();
                    entry.1 += 1;
                    entry.0 += usize::from(broken_bones(off, slack));
                }
            }
            let worst =
                tally
                    .into_iter()
                    .filter(|(_, (bad, _))| *bad > 0)
                    .max_by(|(a, x), (b, y)| {
                        let share = |t: &(usize, usize)| t.0 as f64 / t.1 as f64;
                        x.0.cmp(&y.0)
                            .then(share(x).total_cmp(&share(y)))
                            .then(undecided(*a).total_cmp(&undecided(*b)))
                    });
            match worst {
                Some((point, _)) => blamed.push(point),
                None => return blamed,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn chain() -> (Vec<Option<usize>>, Vec<f64>) {
        let parents = vec![None, Some(0), Some(1), Some(2)];
        (
            parents,
            vec![0., 0., 0., 0., 10., 0., 0., 20., 0., 0., 30., 0.],
        )
    }

    #[test]
    fn the_moved_point_is_blamed() {
        let (parents, pose) = chain();
        let xyz = Array2::from_shape_fn((20, 12), |(_, i)| pose[i]);
        let bones = RigidBones::measure(&parents, xyz.view());
        assert!(bones.outliers(&pose, 0.0, |_| 0.0).is_empty());
        for moved in 0..4 {
            let mut y = pose.clone();
            y[3 * moved] += 15.0;
            // At a chain's end both ends of the one broken bone are blamed alike but for their other bones.
            assert_eq!(
                bones.outliers(&y, 0.0, |j| f64::from(j == moved)),
                [moved],
                "{moved}"
            );
            // Noise of that size explains it.
            assert!(bones.outliers(&y, 5.0, |_| 0.0).is_empty());
        }
        let mut y = pose.clone();
        y[3..6].fill(f64::NAN);
        assert!(bones.outliers(&y, 0.0, |_| 0.0).is_empty());
    }

    #[test]
    fn bones_that_stretch_are_not_rigid() {
        let (parents, pose) = chain();
        let mut xyz = Array2::from_shape_fn((20, 12), |(_, i)| pose[i]);
        for t in 0..20 {
            xyz[[t, 10]] += t as f64;
        }
        let bones = RigidBones::measure(&parents, xyz.view());
        assert_eq!(bones.0.len(), 2);
        assert_eq!(
            RigidBones::measure(&parents, Array2::zeros((0, 12)).view()),
            RigidBones::default()
        );
    }
}
