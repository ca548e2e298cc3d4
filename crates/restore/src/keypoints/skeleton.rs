//! The bones between joints that have names, their lengths, and the noise that these show.

use super::tuning::*;
use crate::bone_lengths::draw;
use crate::numeric::statistics::{mean_of_finite, median, quantile, span};
use crate::pose::sides::mirror_images;
use crate::pose::{is_other, point_at};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// The bones of limbs by the names of the joints at their ends, without the side.
const LIMBS: [[&str; 2]; 4] = [
    ["hipjoint", "femur"],
    ["femur", "tibia"],
    ["clavicle", "humerus"],
    ["humerus", "radius"],
];
/// Other distances that are those of bones, with their sides.
const TRUNK: [[&str; 2]; 4] = [
    ["root", "lhipjoint"],
    ["root", "rhipjoint"],
    ["lhipjoint", "rhipjoint"],
    ["lclavicle", "rclavicle"],
];

/// The bones between the points of a take.
pub(super) struct Skeleton {
    /// The ends of each, the limbs' bones first.
    bones: Vec<[usize; 2]>,
    limbs: usize,
    /// The point on the other side of each, or itself.
    mirrored: Vec<usize>,
    /// The points of feet, left and right.
    pub feet: [Vec<usize>; 2],
    /// The bones of which each stands: its own, those of its leg, and those between the hips.
    legs: [Vec<usize>; 2],
}

impl Skeleton {
    /// The bones between points that have the names of CMU's joints, or others; `None` where the
    /// limbs are not known.
    pub(super) fn of(names: &[String], xyz: ArrayView2<'_, f64>) -> Option<Skeleton> {
        let find = |name: &str| names.iter().position(|n| n == name);
        let bone = |[a, b]: [&str; 2]| Some([find(a)?, find(b)?]);
        let sided = |[a, b]: [&str; 2]| {
            ["l", "r"].map(|side| bone([&format!("{side}{a}"), &format!("{side}{b}")]))
        };
        let mut bones: Vec<[usize; 2]> = LIMBS.into_iter().flat_map(sided).flatten().collect();
        let limbs = bones.len();
        if limbs < FEWEST_BONES || is_planar(xyz) {
            return None;
        }
        bones.extend(TRUNK.into_iter().filter_map(bone));
        let feet = ["l", "r"].map(|side| foot(names, xyz, side));
        for foot in &feet {
            let pairs = (foot.iter().enumerate())
                .flat_map(|(n, a)| foot[n + 1..].iter().map(move |b| [*a, *b]));
            bones.extend(pairs);
        }
        let legs = [0, 1].map(|side: usize| {
            let joints =
                ["hipjoint", "femur"].map(|name| find(&format!("{}{name}", ["l", "r"][side])));
            let hips = ["root", "lhipjoint", "rhipjoint"].map(find);
            let is_of_leg = |p: &usize| joints.contains(&Some(*p)) || feet[side].contains(p);
            let is_of_hips = |p: &usize| hips.contains(&Some(*p));
            let is_own =
                |n: &usize| bones[*n].iter().all(is_of_leg) || bones[*n].iter().all(is_of_hips);
            (0..bones.len()).filter(is_own).collect()
        });
        Some(Skeleton {
            bones,
            limbs,
            mirrored: mirror_images(names),
            feet,
            legs,
        })
    }

    /// The bones of the leg of each side.
    pub(super) fn leg(&self, lengths: &Lengths, side: usize) -> Lengths {
        let bones = self.legs[side].iter().map(|n| lengths.bones[*n]);
        Lengths {
            bones: bones.collect(),
            limbs: 0,
        }
    }

    /// The fast noise, if the lengths of the limbs' bones say that what trembles in their ends is
    /// noise.
    pub(super) fn noise(&self, xyz: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> Option<Noise> {
        let of_bone = |bone: &[usize; 2]| Trembling::of(xyz, runs, *bone);
        let bones = self.bones[..self.limbs].iter().filter_map(of_bone);
        let bones: Vec<Trembling> = bones.collect();
        if bones.len() < FEWEST_BONES {
            return None;
        }
        let sum = |of: fn(&Trembling) -> f64| bones.iter().map(of).sum::<f64>();
        if !(sum(|b| b.of_length) >= NOISE_SHARE * sum(|b| b.of_ends)) {
            return None;
        }
        let median = |of: fn(&Trembling) -> f64| median(bones.iter().map(of).collect());
        Some(Noise {
            sd: median(|b| b.noise)?,
            lag: median(|b| b.lag)?,
        })
    }

    /// The lengths of the bones of a take: the medians, of both sides their mean.
    pub(super) fn lengths(&self, xyz: ArrayView2<'_, f64>) -> Lengths {
        let own = |[a, b]: [usize; 2]| {
            let all = (0..xyz.nrows()).map(|t| length(xyz, t, [a, b]));
            median(all.filter(|l| l.is_finite()).collect()).unwrap_or(f64::NAN)
        };
        let of_bone = |bone: &[usize; 2]| {
            let other = bone.map(|p| self.mirrored[p]);
            (*bone, mean_of_finite([own(*bone), own(other)]))
        };
        let bones = self.bones.iter().map(of_bone);
        Lengths {
            bones: bones
                .map(|(ends, l)| (ends, l.unwrap_or(f64::NAN)))
                .collect(),
            limbs: self.limbs,
        }
    }
}

/// Whether all points are in a plane across one axis: pictures of bones, which have no lengths.
fn is_planar(xyz: ArrayView2<'_, f64>) -> bool {
    let is_flat = |axis: usize| {
        let all = xyz.slice(s![.., axis..;3]);
        span(all.iter().copied().filter(|v| v.is_finite())) <= 0.0
    };
    (0..3).any(is_flat)
}

/// The points of a foot: ankle, toe, and those near them that have no joint's name.
fn foot(names: &[String], xyz: ArrayView2<'_, f64>, side: &str) -> Vec<usize> {
    let joints = ["tibia", "foot"].map(|name| format!("{side}{name}"));
    let ends: Vec<usize> = (0..names.len())
        .filter(|p| joints.contains(&names[*p]))
        .collect();
    let step = xyz.nrows().div_ceil(100).max(1);
    let apart = |a: usize, b: usize| {
        let all = (0..xyz.nrows())
            .step_by(step)
            .map(|t| length(xyz, t, [a, b]));
        median(all.filter(|l| l.is_finite()).collect()).unwrap_or(f64::INFINITY)
    };
    let other = if side == "l" { "rtibia" } else { "ltibia" };
    let other = names.iter().position(|n| n == other);
    let is_near = |p: &usize| {
        let own = (ends.iter().map(|e| apart(*p, *e))).fold(f64::INFINITY, f64::min);
        own <= OF_FOOT && other.is_none_or(|other| own < apart(*p, other))
    };
    let is_foreign = |p: &usize| is_other(&names[*p]);
    let near = (0..names.len())
        .filter(is_foreign)
        .filter(is_near)
        .collect::<Vec<_>>();
    ends.into_iter().chain(near).collect()
}

fn length(xyz: ArrayView2<'_, f64>, frame: usize, [a, b]: [usize; 2]) -> f64 {
    point_at(xyz, frame, a).distance(point_at(xyz, frame, b))
}

/// The fast noise of joints.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// Standard deviation of a coordinate, cm.
    pub sd: f64,
    /// How much of it is that of the frame before (0: white noise).
    pub lag: f64,
}

/// How a bone trembles: its second differences in the quieter half of the frames.
struct Trembling {
    /// The sum of the squares of its length's.
    of_length: f64,
    /// The sum of the squares of its ends', along it.
    of_ends: f64,
    /// Standard deviation of a coordinate of an end, by its length's, cm.
    noise: f64,
    /// How much of that is that of the frame before.
    lag: f64,
}

impl Trembling {
    fn of(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>], bone: [usize; 2]) -> Option<Trembling> {
        let second = |t: usize| {
            let frames = [t, t + 1, t + 2];
            let [a, b] = bone.map(|p| {
                let [before, at, after] = frames.map(|t| point_at(xyz, t, p));
                (at, before - 2.0 * at + after)
            });
            let along = (a.0 - b.0).normalize_or_zero();
            let [before, at, after] = frames.map(|t| length(xyz, t, bone));
            let ends = a.1.dot(along).powi(2) + b.1.dot(along).powi(2);
            (before - 2.0 * at + after, ends)
        };
        let of_run = |run: &Range<usize>| run.start..run.end.saturating_sub(2).max(run.start);
        let all = runs.iter().flat_map(of_run).map(second);
        let mut all: Vec<(f64, f64)> = all.filter(|d| d.1.is_finite()).collect();
        if all.len() < FEWEST_FRAMES {
            return None;
        }
        let lengths = || {
            runs.iter()
                .flat_map(|run| run.clone().map(|t| length(xyz, t, bone)))
        };
        let at = |share| quantile(lengths().filter(|l| l.is_finite()).collect(), share);
        let (size, lag) = (
            // The median of |N(0, 1)| is 1 / 1.4826.
            1.4826 * median(all.iter().map(|d| d.0.abs()).collect())?,
            lag(xyz, runs, bone)?,
        );
        // Of first-order autoregressive noise, second differences have 6 - 8 lag + 2 lag² times the
        // variance; the middle half of normal values is 1.349 standard deviations wide.
        let a = lag.clamp(0.0, MOST_LAG);
        let of_noise = 1.349 * size / (6.0 - 8.0 * a + 2.0 * a * a).sqrt();
        let most = (MOST_VARYING * at(0.5)?).max(MOST_OF_NOISE * of_noise);
        if !(at(0.75)? - at(0.25)? <= most) {
            return None;
        }
        all.sort_by(|a, b| a.1.total_cmp(&b.1));
        all.truncate(all.len() / 2);
        Some(Trembling {
            of_length: all.iter().map(|d| d.0 * d.0).sum(),
            of_ends: all.iter().map(|d| d.1).sum(),
            // Both ends count, each with 1 + 4 + 1.
            noise: size / 12.0_f64.sqrt(),
            lag,
        })
    }
}

/// How much of the noise of a bone's length is that of the frame before: of a first-order
/// autoregression, neighboring differences correlate by (lag − 1) / 2. Jumps do not count.
fn lag(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>], bone: [usize; 2]) -> Option<f64> {
    let step = |t: usize| length(xyz, t + 1, bone) - length(xyz, t, bone);
    let of_run = |run: &Range<usize>| run.start..run.end.saturating_sub(2).max(run.start);
    let pairs = runs.iter().flat_map(of_run).map(|t| [step(t), step(t + 1)]);
    let pairs: Vec<[f64; 2]> = pairs.filter(|[a, b]| (a + b).is_finite()).collect();
    let most = JUMP_TIMES * median(pairs.iter().map(|[a, _]| a.abs()).collect())?;
    let kept = pairs.iter().filter(|[a, b]| a.abs().max(b.abs()) <= most);
    let (both, own) = kept.fold((0.0, 0.0), |(both, own), [a, b]| {
        (both + a * b, own + (a * a + b * b) / 2.0)
    });
    (own > 0.0).then(|| 1.0 + 2.0 * both / own)
}

/// The lengths of bones.
pub(super) struct Lengths {
    /// The ends and the length of each, cm, the limbs' first.
    bones: Vec<([usize; 2], f64)>,
    limbs: usize,
}

impl Lengths {
    /// How many times the variance of the points (frames, 3 J) is that of a `covariance`, by what
    /// the limbs' bones differ from their lengths.
    pub(super) fn scale(&self, xyz: ArrayView2<'_, f64>, covariance: DMat3) -> f64 {
        let of_bone = |(ends, l): &([usize; 2], f64)| {
            let ([a, b], l) = (*ends, *l);
            let of = move |t: usize| {
                let apart = point_at(xyz, t, a) - point_at(xyz, t, b);
                let along = apart.normalize_or_zero();
                (apart.length() - l).powi(2) / (2.0 * along.dot(covariance * along))
            };
            (0..xyz.nrows()).map(of)
        };
        let all = self.bones.iter().take(self.limbs).flat_map(of_bone);
        mean_of_finite(all).unwrap_or(0.0)
    }

    /// The points (frames, 3 J) moved until every bone has its length, where their noise is largest
    /// by its `covariance` ([`draw`]). Points that are `held` in a frame stay.
    pub(super) fn hold(
        &self,
        xyz: ArrayView2<'_, f64>,
        covariance: DMat3,
        held: impl Fn(usize, usize) -> bool,
    ) -> Array2<f64> {
        let mut out = xyz.to_owned();
        for t in 0..xyz.nrows() {
            let of_point = |p| point_at(xyz, t, p);
            let mut at: Vec<DVec3> = (0..xyz.ncols() / 3).map(of_point).collect();
            let of = |p: usize| f64::from(u8::from(!held(t, p))) * covariance;
            draw(&mut at, &self.bones, of, ROUNDS, 0.0);
            for (p, at) in at.iter().enumerate() {
                super::put(&mut out, t, p, *at);
            }
        }
        out
    }
}
