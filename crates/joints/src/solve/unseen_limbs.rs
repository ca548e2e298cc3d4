//! Limbs that no marker shows: their joints are a guess of the prior, whose deviations are those of
//! poses like the ones that it learned, and far too small for any other.
//!
//! A joint is known where a marker is on the bone that ends there, or beyond it, or the bone cannot
//! turn against one that is known.

use crate::pose::{Bone, point_at, ranges};
use ndarray::Array2;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;

/// A limb that is not seen for so long, seconds, is not known there: the longest gap that an audit
/// passes over.
const LONGEST_GAP: f64 = 0.5;

/// A limb, or its end, that no marker shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnseenLimb {
    /// What it is called: `left leg`, `left lower leg and foot`.
    pub limb: String,
    /// Its joints.
    pub joints: Vec<String>,
    /// The first frame and the one after the last; `None` for all.
    pub frames: Option<[usize; 2]>,
    /// The same in seconds from the first frame of the take, where its rate is known.
    pub seconds: Option<[f64; 2]>,
}

impl UnseenLimb {
    /// A line for people.
    pub(super) fn sentence(&self) -> String {
        let limb = &self.limb;
        let when = match (self.frames, self.seconds) {
            (None, _) => {
                return format!("{limb}: no marker; its joints are empty, and its motion rests");
            }
            (_, Some([from, to])) => format!("from {from:.2} to {to:.2} s"),
            (Some([from, to]), None) => format!("in frames {from} to {}", to - 1),
        };
        format!("{limb}: no marker {when}; its joints are empty there, and its motion is a guess")
    }
}

/// What markers show of bones.
pub(super) struct SeenBones<'a> {
    /// The bones without markers, parents first.
    pub bones: &'a [Bone],
    /// The bone of each marker.
    pub marked: &'a [usize],
    /// The markers (frames, 3 M), cm; NaN is missing.
    pub xyz: &'a Array2<f64>,
    /// Frames a second.
    pub rate: Option<f64>,
}

impl SeenBones<'_> {
    /// The frames in which the end of each bone is not known: all, or stretches that are long.
    /// Frames that are not `solved` do not count.
    pub(super) fn unseen(&self, solved: &[bool]) -> Vec<Vec<Range<usize>>> {
        let frames = self.xyz.nrows();
        let seen: Vec<Vec<bool>> = (0..frames).map(|t| self.seen(t)).collect();
        let longest = self.rate.map_or(f64::INFINITY, |rate| LONGEST_GAP * rate);
        let of_bone = |b: usize| {
            let is_unseen = |t: &usize| solved[*t] && !seen[*t][b];
            let count = (0..frames).filter(is_unseen).count();
            if count > 0 && count == solved.iter().filter(|is| **is).count() {
                return std::iter::once(0..frames).collect();
            }
            let mut runs = ranges((0..frames).filter(is_unseen));
            runs.retain(|run| run.len() as f64 > longest);
            runs
        };
        (0..self.bones.len()).map(of_bone).collect()
    }

    /// The bones whose ends are known in a frame.
    fn seen(&self, frame: usize) -> Vec<bool> {
        let mut seen = vec![false; self.bones.len()];
        for (m, &bone) in self.marked.iter().enumerate() {
            seen[bone] |= point_at(self.xyz.view(), frame, m).is_finite();
        }
        for b in (0..seen.len()).rev() {
            if let Some(parent) = self.bones[b].parent.filter(|_| seen[b]) {
                seen[parent] = true;
            }
        }
        for b in 0..seen.len() {
            let parent = self.bones[b].parent;
            seen[b] |= self.bones[b].dofs.is_empty() && parent.is_some_and(|p| seen[p]);
        }
        seen
    }

    /// The limbs of the `joints`, which are at the ends of bones, by the frames in which these are
    /// `unseen`; `frames` are all.
    pub(super) fn limbs(
        &self,
        joints: &[(String, usize)],
        unseen: &[Vec<Range<usize>>],
    ) -> Vec<UnseenLimb> {
        let frames = self.xyz.nrows();
        // By limb and frames, the bone nearest to the trunk and the joints.
        let mut all: BTreeMap<([usize; 2], String), (usize, Vec<String>)> = BTreeMap::new();
        for (joint, bone) in joints {
            for run in &unseen[*bone] {
                let key = (
                    [run.start, run.end],
                    limb_of(&self.bones[*bone].name).concat(),
                );
                let (first, joints) = all.entry(key).or_insert((*bone, Vec::new()));
                *first = (*first).min(*bone);
                joints.push(joint.clone());
            }
        }
        let limb = |((run, _), (bone, joints)): (([usize; 2], String), (usize, Vec<String>))| {
            let [side, limb] = limb_of(&self.bones[bone].name);
            let frames = (run != [0, frames]).then_some(run);
            UnseenLimb {
                limb: [side, part_from(&self.bones[bone].name).unwrap_or(limb)].concat(),
                joints,
                frames,
                seconds: (self.rate.zip(frames))
                    .map(|(rate, frames)| frames.map(|t| t as f64 / rate)),
            }
        };
        all.into_iter().map(limb).collect()
    }
}

/// The side of a bone, and the limb that it is of.
fn limb_of(bone: &str) -> [&'static str; 2] {
    let limb_of_side = |own: &str| match own {
        "hipjoint" | "femur" | "tibia" | "foot" | "toes" => Some("leg"),
        "clavicle" | "humerus" | "radius" | "wrist" | "hand" => Some("arm"),
        _ => None,
    };
    for (letter, side) in [('l', "left "), ('r', "right ")] {
        if let Some(limb) = bone.strip_prefix(letter).and_then(limb_of_side) {
            return [side, limb];
        }
    }
    if bone.ends_with("neck") || bone == "head" {
        ["", "head"]
    } else {
        ["", "trunk"]
    }
}

/// The part of a limb that begins with a bone; `None`: all of it.
fn part_from(bone: &str) -> Option<&'static str> {
    Some(match &bone[bone.len().min(1)..] {
        "tibia" => "lower leg and foot",
        "foot" => "foot",
        "radius" => "forearm and hand",
        "wrist" => "hand",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::body::template;
    use super::*;
    use crate::pose::joints::CMU;

    fn limbs(marked: &[&str], hide: Option<(usize, Range<usize>)>) -> Vec<String> {
        let skeleton = template().unwrap().skeleton;
        let find = |name: &&str| skeleton.find(name).unwrap();
        let mut xyz = Array2::zeros((100, 3 * marked.len()));
        if let Some((m, frames)) = hide {
            xyz.slice_mut(ndarray::s![frames, 3 * m..3 * m + 3])
                .fill(f64::NAN);
        }
        let seen = SeenBones {
            bones: skeleton.bones(),
            marked: &marked.iter().map(find).collect::<Vec<_>>(),
            xyz: &xyz,
            rate: Some(50.0),
        };
        let joints: Vec<_> = CMU.iter().map(|n| (n.to_string(), find(n))).collect();
        let unseen = seen.unseen(&[true; 100]);
        seen.limbs(&joints, &unseen)
            .iter()
            .map(UnseenLimb::sentence)
            .collect()
    }

    #[test]
    fn a_limb_is_seen_by_a_marker_on_it_or_beyond() {
        let all = [
            "root", "ltoes", "rtibia", "rfoot", "head", "lwrist", "rhand",
        ];
        assert_eq!(limbs(&all, None), [""; 0]);
        let of = |marked: &[&str]| -> Vec<String> {
            let lines = limbs(marked, None).into_iter();
            lines
                .map(|l| l.split(':').next().unwrap().to_string())
                .collect()
        };
        assert_eq!(
            of(&["root", "head", "lwrist", "rhand"]),
            ["left leg", "right leg"]
        );
        assert_eq!(
            of(&["root", "lfemur", "rtibia", "head", "lhumerus", "rradius"]),
            [
                "left forearm and hand",
                "left lower leg and foot",
                "right hand",
                "right foot"
            ]
        );
        assert_eq!(
            of(&["root", "ltoes", "rtoes"]),
            ["head", "left arm", "right arm", "trunk"]
        );
    }

    #[test]
    fn a_long_stretch_without_markers_is_told() {
        let all = ["root", "ltoes", "rtoes", "head", "lwrist", "rhand"];
        assert_eq!(limbs(&all, Some((1, 10..35))), [""; 0]);
        let lines = limbs(&all, Some((1, 10..50)));
        let line = "left leg: no marker from 0.20 to 1.00 s; its joints are empty there";
        assert!(lines.len() == 1 && lines[0].starts_with(line), "{lines:?}");
    }
}
