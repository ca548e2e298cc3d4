//! The body that is fitted: CMU's bones with markers on them, by one vector of numbers.

use super::landmarks::JointSet;
use super::marker_sets::NamedMarker;
use super::tuning::*;
use crate::io::{Asf, Input};
use crate::pose::{Bone, Skeleton};
use crate::prior::rotations::bones::{BonePrior, CENTRAL, COUNT, PAIRED, bones_of};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::{Array2, s};
use std::io::Cursor;

/// Numbers of the bones: vectors of the middle and of the left side, then half the differences
/// between left and right.
pub(super) const BONES: usize = 3 * COUNT + 3 * PAIRED.len();

/// A vector of three numbers among those of a body, and what turns it into a bone's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub first: usize,
    /// The identity, a mirror, or its opposite.
    pub turn: DMat3,
}

/// A marker on the body.
#[derive(Debug, Clone)]
pub(super) struct BodyMarker {
    pub bone: usize,
    /// The share of the bone at which its offset begins.
    pub along: f64,
    /// Standard deviation of what is measured, cm.
    pub sd: f64,
}

/// Bones and markers, whose positions numbers give.
pub(super) struct Body {
    /// CMU's skeleton without fingers and thumbs.
    pub template: Skeleton,
    pub markers: Vec<BodyMarker>,
    /// By bone, the numbers that add up to its vector.
    parts: Vec<Vec<Part>>,
    /// The most probable numbers, bones and then markers.
    pub mean: Vec<f64>,
    /// One over their covariance.
    pub precision: Array2<f64>,
}

/// CMU's skeleton without fingers and thumbs.
pub(super) fn template() -> Result<Asf> {
    let text = include_bytes!("skeleton.asf");
    Asf::read(
        Input::new("the built-in skeleton".to_string(), Cursor::new(&text[..]))?,
        None,
    )
}

impl Body {
    /// The body of some markers: its bones as those of people, or as those of `given`.
    pub(super) fn new(
        named: &[NamedMarker],
        joints: JointSet,
        bones: &BonePrior,
        given: Option<&Skeleton>,
    ) -> Result<Body> {
        let template = template()?.skeleton;
        let parts = (0..template.bones().len()).map(|b| parts_of(&template.bones()[b].name));
        let parts: Vec<Vec<Part>> = parts.collect();
        let count = BONES + 3 * named.len();
        let mut body = Body {
            markers: Vec::new(),
            mean: vec![0.0; count],
            precision: Array2::zeros((count, count)),
            parts,
            template,
        };
        body.set_bones(joints, bones, given)?;
        for (m, marker) in named.iter().enumerate() {
            let own = marker.landmark.bone.as_ref();
            let side = if marker.is_right { "r" } else { "l" };
            let bone = (body.template.find(own))
                .or_else(|| body.template.find(&format!("{side}{own}")))
                .ok_or_else(|| Error::usage(format!("the body has no bone {own}")))?;
            body.markers.push(BodyMarker {
                bone,
                along: marker.landmark.along,
                sd: marker.sd,
            });
            let [at, sd] = marker.landmark.offset_and_sd(joints, marker.is_right);
            for c in 0..3 {
                let n = BONES + 3 * m + c;
                body.mean[n] = at[c];
                body.precision[[n, n]] = sd[c].powi(-2);
            }
        }
        Ok(body)
    }

    fn set_bones(
        &mut self,
        joints: JointSet,
        bones: &BonePrior,
        given: Option<&Skeleton>,
    ) -> Result<()> {
        let middle = 3 * COUNT;
        if let Some(given) = given {
            let (means, halves) = bones_of(given)?;
            self.mean[..middle].copy_from_slice(&means);
            let halves: Vec<f64> = halves.iter().flat_map(|h| h.to_array()).collect();
            self.mean[middle..BONES].copy_from_slice(&halves);
            (0..BONES).for_each(|n| self.precision[[n, n]] = GIVEN_BONE.powi(-2));
            return Ok(());
        }
        let mut mean = bones.mean.to_vec();
        let mut covariance = bones.covariance.clone();
        let mut uneven = bones.asymmetry.clone();
        match joints {
            JointSet::Cmu => covariance *= CMU_BONES * CMU_BONES,
            JointSet::Anatomical => {
                uneven.fill(UNEVEN);
                let clavicle = CENTRAL.iter().chain(&PAIRED).position(|n| *n == "clavicle");
                let first = 3 * clavicle.unwrap_or(0);
                for n in first..first + 3 {
                    covariance.row_mut(n).mapv_inplace(|v| v * SHOULDERS);
                    covariance.column_mut(n).mapv_inplace(|v| v * SHOULDERS);
                }
                for (name, at) in ANATOMICAL {
                    let bone = CENTRAL.iter().chain(&PAIRED).position(|n| *n == name);
                    let first = 3 * bone.unwrap_or(0);
                    mean[first..first + 3].copy_from_slice(&at);
                }
            }
        }
        self.mean[..middle].copy_from_slice(&mean);
        let singular = || Error::usage("the covariance of the bones is singular");
        let factor = crate::numeric::linalg::Cholesky::new(covariance).ok_or_else(singular)?;
        let inverse = factor.solve(&Array2::eye(middle)).ok_or_else(singular)?;
        self.precision
            .slice_mut(s![..middle, ..middle])
            .assign(&inverse);
        for (pair, sd) in uneven.iter().enumerate() {
            for n in middle + 3 * pair..middle + 3 * pair + 3 {
                self.precision[[n, n]] = sd.powi(-2);
            }
        }
        Ok(())
    }

    /// Lets the pelvis follow the width between the markers of the front hips, which is `measured`
    /// of the one expected.
    pub(super) fn scale_pelvis(&mut self, measured: f64) {
        let [least, most] = WIDTHS;
        let scale = 1.0 + PELVIS * (measured.clamp(least, most) - 1.0);
        for (m, marker) in self.markers.iter().enumerate() {
            if marker.bone == 0 {
                let own = BONES + 3 * m;
                self.mean[own..own + 3].iter_mut().for_each(|v| *v *= scale);
            }
        }
        let hip = 3 * CENTRAL.len();
        self.mean[hip..hip + 3].iter_mut().for_each(|v| *v *= scale);
    }

    fn vector(numbers: &[f64], first: usize) -> DVec3 {
        DVec3::from_slice(&numbers[first..first + 3])
    }

    /// The vector of a bone for some numbers.
    pub(super) fn bone(&self, numbers: &[f64], bone: usize) -> DVec3 {
        let parts = self.parts[bone].iter();
        parts.map(|p| p.turn * Body::vector(numbers, p.first)).sum()
    }

    /// The skeleton for some numbers, without markers.
    pub(super) fn bare_skeleton(&self, numbers: &[f64]) -> Result<Skeleton> {
        Skeleton::new(self.bones(numbers))
    }

    fn bones(&self, numbers: &[f64]) -> Vec<Bone> {
        let bones = self.template.bones().iter().enumerate();
        let sized = bones.map(|(b, bone)| Bone {
            offset: self.bone(numbers, b),
            ..bone.clone()
        });
        sized.collect()
    }

    /// The skeleton for some numbers, and behind its bones one without a joint for each marker,
    /// which ends there.
    pub(super) fn skeleton(&self, numbers: &[f64]) -> Result<Skeleton> {
        let mut bones = self.bones(numbers);
        for (m, marker) in self.markers.iter().enumerate() {
            let own = bones[marker.bone].offset;
            bones.push(Bone {
                name: format!("marker {m}"),
                parent: Some(marker.bone),
                offset: (marker.along - 1.0) * own + Body::vector(numbers, BONES + 3 * m),
                axis: DMat3::IDENTITY,
                dofs: Vec::new(),
            });
        }
        Skeleton::new(bones)
    }

    /// The bones that end at the markers in [`Body::skeleton`].
    pub(super) fn marker_bones(&self) -> Vec<usize> {
        let first = self.template.bones().len();
        (first..first + self.markers.len()).collect()
    }

    /// The weight of each marker, 1/cm².
    pub(super) fn weights(&self) -> Vec<f64> {
        self.markers.iter().map(|m| m.sd.powi(-2)).collect()
    }

    /// By how much the numbers move the end of a bone, `own` of its length counted, for the global
    /// rotations of the bones.
    pub(super) fn moved(&self, bone: usize, own: f64, rotations: &[DMat3]) -> Vec<Part> {
        let bones = self.template.bones();
        let above = std::iter::successors(Some(bone), |&b| bones[b].parent);
        let parts = above.flat_map(|b| {
            let share = if b == bone { own } else { 1.0 };
            self.parts[b].iter().map(move |p| Part {
                first: p.first,
                turn: rotations[b] * p.turn * share,
            })
        });
        parts.filter(|p| p.turn != DMat3::ZERO).collect()
    }

    /// By how much the numbers move a marker.
    pub(super) fn moved_marker(&self, marker: usize, rotations: &[DMat3]) -> Vec<Part> {
        let BodyMarker { bone, along, .. } = self.markers[marker];
        let mut parts = self.moved(bone, along, rotations);
        parts.push(Part {
            first: BONES + 3 * marker,
            turn: rotations[bone],
        });
        parts
    }
}

/// Means of bones that differ where joints are anatomical, cm.
const ANATOMICAL: [(&str, [f64; 3]); 6] = [
    ("hipjoint", [7.8, -9.8, 4.3]),
    ("clavicle", [16.2, 5.2, 1.0]),
    ("humerus", [31.0, 0.0, 0.0]),
    ("lowerback", [0.0, 10.8, -1.2]),
    ("upperback", [0.0, 10.8, -0.2]),
    ("thorax", [0.0, 10.8, 0.3]),
];

/// The numbers that add up to the vector of a bone.
fn parts_of(name: &str) -> Vec<Part> {
    if let Some(n) = CENTRAL.iter().position(|c| *c == name) {
        return vec![Part {
            first: 3 * n,
            turn: DMat3::IDENTITY,
        }];
    }
    let (side, own) = name.split_at(1);
    let Some(pair) = PAIRED.iter().position(|p| *p == own) else {
        return Vec::new();
    };
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let (turn, half) = match side {
        "l" => (DMat3::IDENTITY, DMat3::IDENTITY),
        _ => (mirror, mirror * -1.0),
    };
    let first = 3 * (CENTRAL.len() + pair);
    let difference = Part {
        first: 3 * COUNT + 3 * pair,
        turn: half,
    };
    vec![Part { first, turn }, difference]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rotations::RotationPrior;
    use crate::solve::marker_sets::MarkerSet;

    /// A body with markers of the left and the right and of the middle.
    pub(in crate::solve) fn body(joints: JointSet) -> Body {
        let names = "LFWT RFWT LBWT C7 LSHO RSHO RKNE LKNE LANK RTOE LFIN".split(' ');
        let points: Vec<String> = names.map(String::from).collect();
        let named = MarkerSet::find("cmu41").unwrap().markers(&points);
        assert_eq!(named.len(), points.len());
        let prior = RotationPrior::builtin().unwrap();
        Body::new(&named, joints, prior.bones().unwrap(), None).unwrap()
    }

    #[test]
    fn numbers_move_markers_and_joints_as_the_differences_say() {
        let body = body(JointSet::Cmu);
        let at = |numbers: &[f64]| {
            let skeleton = body.skeleton(numbers).unwrap();
            let q: Vec<f64> = (0..skeleton.dof_count())
                .map(|i| (i as f64 * 1.7).sin() * 0.6)
                .collect();
            skeleton.posture(&q)
        };
        let mut numbers = body.mean.clone();
        for (n, v) in numbers.iter_mut().enumerate() {
            *v += 0.5 * (n as f64).cos();
        }
        let posture = at(&numbers);
        let count = numbers.len();
        let full = |parts: Vec<Part>| {
            let mut all = vec![DVec3::ZERO; count];
            for part in parts {
                (0..3).for_each(|c| all[part.first + c] += part.turn.col(c));
            }
            all
        };
        let elbow = body.template.find("lhumerus").unwrap();
        let mut moved = vec![(elbow, full(body.moved(elbow, 1.0, &posture.rotations)))];
        for (m, bone) in body.marker_bones().into_iter().enumerate() {
            moved.push((bone, full(body.moved_marker(m, &posture.rotations))));
        }
        for n in 0..count {
            let mut other = numbers.clone();
            other[n] += 1e-4;
            let then = at(&other);
            for (bone, moved) in &moved {
                let want = (then.ends[*bone] - posture.ends[*bone]) / 1e-4;
                assert!(
                    want.abs_diff_eq(moved[n], 1e-6),
                    "{n} {bone}: {want} {}",
                    moved[n]
                );
            }
        }
    }

    #[test]
    fn bones_that_are_given_are_kept() {
        let asf = template().unwrap();
        let (means, halves) = bones_of(&asf.skeleton).unwrap();
        assert_eq!(means.len() + 3 * halves.len(), BONES);
        let body = body(JointSet::Anatomical);
        let skeleton = body.bare_skeleton(&body.mean).unwrap();
        for (a, b) in skeleton.bones().iter().zip(asf.skeleton.bones()) {
            assert_eq!((&a.name, a.parent), (&b.name, b.parent));
        }
    }
}
