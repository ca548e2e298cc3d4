//! Algorithm 1 of Lai et al.: a pose carried to given bone lengths.
//!
//! `ỹₖ = ỹₚ + Lₖ (yₖ − yₚ) / |yₖ − yₚ|`, from the root outwards, with p the parent of k. (Lai et
//! al. print Δyₚ where ỹₚ must stand; with Δ the bones would not hang together.) Cost: one pass
//! over the points.

use super::tuning::bones::*;
use crate::pose::Skeleton;
use glam::DVec3;

/// Bones of fixed length between points.
#[derive(Debug, Clone, PartialEq)]
pub struct BoneNormalizer {
    /// The point each point hangs on; `None` for those that stay where they are.
    parents: Vec<Option<usize>>,
    /// Centimeters; NaN where the length is not fixed and the segment stays as it is.
    lengths: Vec<f64>,
    /// Parents first.
    order: Vec<usize>,
}

impl BoneNormalizer {
    /// The bones between the joints of some bones of a skeleton: `joints[k]` is the bone whose end
    /// is point k.
    ///
    /// A point hangs on the nearest point above it. Where a joint between the two turns or slides,
    /// or the bone itself can grow, their distance is no bone's length and is left as it is.
    pub fn for_skeleton(skeleton: &Skeleton, joints: &[usize]) -> BoneNormalizer {
        let bones = skeleton.bones();
        let mut point_of = vec![None; bones.len()];
        for (k, &joint) in joints.iter().enumerate() {
            point_of[joint].get_or_insert(k);
        }
        let (mut parents, mut lengths) = (Vec::new(), Vec::new());
        for (k, &joint) in joints.iter().enumerate() {
            // The nearest point above; a second column of the same joint hangs on the first by no
            // length.
            let (mut at, mut path) = (joint, DVec3::ZERO);
            // Whether what is gathered turns against the bones above it, and whether its length is
            // fixed.
            let (mut turns, mut rigid) = (false, true);
            let parent = loop {
                if let Some(p) = point_of[at].filter(|&p| p != k) {
                    break Some(p);
                }
                let bone = &bones[at];
                let Some(above) = bone.parent else { break None };
                let slides = bone.dofs.iter().any(|d| !d.channel.is_angle());
                rigid &= !(slides || turns && bone.offset != DVec3::ZERO);
                path += bone.offset;
                turns |= path != DVec3::ZERO && !bone.dofs.is_empty();
                at = above;
            };
            parents.push(parent);
            lengths.push(if rigid && parent.is_some() {
                path.length()
            } else {
                f64::NAN
            });
        }
        BoneNormalizer::new(parents, lengths)
    }

    /// Bones of given lengths (cm; NaN: not fixed). Parents that form a cycle count as none.
    pub fn new(parents: Vec<Option<usize>>, lengths: Vec<f64>) -> BoneNormalizer {
        let n = parents.len();
        let mut bones = BoneNormalizer {
            parents,
            lengths,
            order: Vec::with_capacity(n),
        };
        let mut children = vec![Vec::new(); n];
        for (k, parent) in bones.parents.iter().enumerate() {
            match *parent {
                Some(p) if p < n && p != k => children[p].push(k),
                _ => bones.order.push(k),
            }
        }
        let mut next = 0;
        while next < bones.order.len() {
            bones.order.extend_from_slice(&children[bones.order[next]]);
            next += 1;
        }
        let mut reached = vec![false; n];
        bones.order.iter().for_each(|&k| reached[k] = true);
        for k in 0..n {
            if !reached[k] || bones.parents[k].is_some_and(|p| p >= n || p == k) {
                bones.parents[k] = None;
                if !reached[k] {
                    bones.order.push(k);
                }
            }
        }
        bones
    }

    /// The length of each point's bone, centimeters; NaN where it has none that is fixed.
    pub fn lengths(&self) -> &[f64] {
        &self.lengths
    }

    /// The point each point hangs on.
    pub fn parents(&self) -> &[Option<usize>] {
        &self.parents
    }

    /// Carries the pose `y` (3 numbers per point, NaN is missing) to the bones' lengths.
    ///
    /// A missing point stays missing, and so becomes one that lies on its parent although its bone
    /// has a length: no direction is known for it. A point below a missing one moves as the
    /// nearest seen point above it does.
    pub fn normalize(&self, y: &[f64], out: &mut [f64]) {
        let at = |v: &[f64], k: usize| DVec3::from_slice(&v[3 * k..3 * k + 3]);
        for &k in &self.order {
            let here = at(y, k);
            let to = match self.parents[k] {
                None => here,
                Some(p) => {
                    let (was, is) = (at(y, p), at(out, p));
                    let step = here - was;
                    let long = step.length();
                    if !here.is_finite() {
                        DVec3::NAN
                    } else if !is.is_finite() {
                        here + self.ancestor_shift(p, y, out)
                    } else if self.lengths[k].is_nan() {
                        is + step
                    } else if long > NO_LENGTH {
                        is + step * (self.lengths[k] / long)
                    } else if self.lengths[k] <= NO_LENGTH {
                        is
                    } else {
                        DVec3::NAN
                    }
                }
            };
            out[3 * k..3 * k + 3].copy_from_slice(&to.to_array());
        }
    }

    /// How the nearest seen point above a missing one was moved.
    fn ancestor_shift(&self, mut k: usize, y: &[f64], out: &[f64]) -> DVec3 {
        loop {
            let at = |v: &[f64]| DVec3::from_slice(&v[3 * k..3 * k + 3]);
            let shift = at(out) - at(y);
            if shift.is_finite() {
                return shift;
            }
            match self.parents[k] {
                Some(p) => k = p,
                None => return DVec3::ZERO,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: f64 = f64::NAN;

    fn chain(lengths: [f64; 4]) -> BoneNormalizer {
        BoneNormalizer::new(vec![None, Some(0), Some(1), Some(2)], lengths.to_vec())
    }

    #[test]
    fn bones_get_their_lengths_and_keep_their_directions() {
        let y = [1., 2., 3., 1., 4., 3., 4., 4., 3., 4., 4., 9.];
        let mut out = [0.; 12];
        chain([N, 5., 1., 0.5]).normalize(&y, &mut out);
        assert_eq!(out, [1., 2., 3., 1., 7., 3., 2., 7., 3., 2., 7., 3.5]);
        let mut again = [0.; 12];
        chain([N, 5., 1., 0.5]).normalize(&out, &mut again);
        assert_eq!(out, again);
    }

    #[test]
    fn missing_points_stay_missing_and_descendants_follow_visible_ancestors() {
        let y = [0., 0., 0., 0., 2., 0., N, N, N, 0., 6., 1.];
        let mut out = [0.; 12];
        chain([N, 3., 1., 1.]).normalize(&y, &mut out);
        assert_eq!(out[3..6], [0., 3., 0.]);
        assert!(out[6..9].iter().all(|v| v.is_nan()));
        assert_eq!(out[9..], [0., 7., 1.]);
    }

    #[test]
    fn segments_without_length() {
        let y = [0., 0., 0., 0., 0., 0., 0., 1., 0., 0., 1., 0.];
        let mut out = [0.; 12];
        // The first has a length but no direction; the last has neither.
        chain([N, 3., 2., 0.]).normalize(&y, &mut out);
        assert!(out[3..6].iter().all(|v| v.is_nan()));
        assert_eq!(out[6..9], [0., 1., 0.]);
        assert_eq!(out[9..], [0., 1., 0.]);
        BoneNormalizer::new(vec![], vec![]).normalize(&[], &mut []);
    }

    #[test]
    fn cyclic_parents_are_cut() {
        let bones = BoneNormalizer::new(vec![Some(1), Some(0), Some(9), Some(3)], vec![1.; 4]);
        let mut out = [0.; 12];
        let y: Vec<f64> = (0..12).map(f64::from).collect();
        bones.normalize(&y, &mut out);
        assert!(out.iter().all(|v| v.is_finite()));
    }
}
