//! A simple body around a skeleton: tubes for trunk, limbs and fingers, an egg for the head.
//!
//! Names, by a map of names, tell hips, knees, ankles, shoulders, elbows and wrists; the tree tells
//! what lies between and beyond. Widths are those of a person whose legs are `LEG` long, scaled to
//! the skeleton's. Where the names tell nothing, each bone has a tube.

use super::SkinnedMesh;
use super::tube::{Knot, Width, push_ellipsoid, push_tube};
use crate::pose::{BonePoints, NameMap};
use glam::DVec3;
use ndarray::Array2;

/// The length of thigh and shin, cm, that goes with the widths below: the mean of CMU's subjects.
const LEG: f64 = 83.0;
/// Half widths along the limbs, cm, at equal steps from joint to joint.
const THIGH: [f64; 4] = [8.4, 7.9, 6.7, 5.5];
const SHIN: [f64; 5] = [5.5, 5.8, 5.3, 4.3, 3.7];
const COLLAR: [f64; 2] = [5.0, 5.4];
const UPPER_ARM: [f64; 4] = [5.4, 5.0, 4.5, 4.1];
const FOREARM: [f64; 4] = [4.1, 4.1, 3.5, 2.8];
const NECK: [f64; 3] = [7.0, 5.7, 5.2];
/// The trunk from between the hips to between the shoulders: shares of its length, half widths
/// beyond the hips and in shares of the shoulders' half distance, half depths.
const TRUNK: [(f64, f64, f64); 6] = [
    (0.0, 6.8, 10.0),
    (0.22, 6.0, 10.2),
    (0.45, 0.74, 9.3),
    (0.65, 0.82, 10.2),
    (0.84, 0.86, 10.4),
    (1.0, 0.7, 7.0),
];
/// The share of the trunk's length up to which its widths go by the hips.
const BY_HIPS: f64 = 0.3;
/// The shoulders' least half distance, cm: some rigs have them far inside.
const SHOULDERS: f64 = 15.0;
/// The head: half axes to the side, to the front and up, and how far its middle is above the
/// shoulders, and at least above its joint, cm.
const HEAD: [f64; 3] = [7.8, 9.8, 11.8];
const HEAD_ABOVE: (f64, f64) = (24.0, 5.0);
/// A hand without fingers: its length, and half widths from wrist to tip, wide and deep, cm.
const HAND: f64 = 17.0;
const MITTEN: [(f64, f64, f64); 4] = [
    (0.0, 2.9, 2.3),
    (0.25, 3.9, 1.8),
    (0.6, 4.0, 1.5),
    (1.0, 2.2, 0.9),
];
/// Half widths of the bones of the palm and of the fingers, cm; hands with fewer ends than
/// `FINGERS` are mittens.
const PALM: [f64; 2] = [1.9, 1.4];
const FINGER: [f64; 2] = [1.0, 0.8];
const FINGERS: usize = 4;
/// The foot: the heel behind and below the ankle, the height of the ball below it, and the least
/// way from the ankle to the tip, cm; half widths from heel to tip, wide and deep.
const HEEL: (f64, f64) = (3.0, 4.8);
const BALL_BELOW: f64 = 5.8;
const FOOT: f64 = 16.0;
const SOLE: [(f64, f64, f64); 4] = [
    (0.0, 3.2, 3.2),
    (0.45, 3.9, 3.0),
    (0.72, 4.6, 2.4),
    (1.0, 3.4, 1.8),
];
const INSTEP: [f64; 2] = [3.7, 2.6];
/// Half widths of other bones, in shares of their length, and at most, cm.
const OTHER: (f64, f64) = (0.13, 6.0);
/// Bones shorter than this, cm, are left out where nothing is known.
const SHORTEST: f64 = 0.5;

/// A joint in the rest pose, at the end of a straight piece from its parent.
#[derive(Debug, Clone)]
pub(crate) struct Joint {
    pub name: String,
    pub parent: Option<usize>,
    /// Its position, cm.
    pub at: DVec3,
    /// The bone that the piece turns with, and the one that what stands on the joint turns with.
    pub bone: u16,
    pub carrier: u16,
}

/// Adds the body of joints, of which parents come first.
pub(crate) fn push_body(mesh: &mut SkinnedMesh, joints: &[Joint]) {
    if let Some(body) = Body::of(joints) {
        return body.push(mesh);
    }
    for joint in joints {
        push_other(mesh, joints, joint);
    }
}

/// A tube around one piece.
fn push_other(mesh: &mut SkinnedMesh, joints: &[Joint], joint: &Joint) {
    let Some(start) = joint.parent.map(|p| joints[p].at) else {
        return;
    };
    let length = (joint.at - start).length();
    if length >= SHORTEST {
        let width = (OTHER.0 * length).min(OTHER.1);
        push_tube(
            mesh,
            &piece(start, joint),
            &even(&[width, 0.7 * width], 1.0),
            DVec3::Z,
        );
    }
}

fn piece(start: DVec3, joint: &Joint) -> [Knot; 2] {
    let bone = joint.bone;
    [Knot { at: start, bone }, Knot { at: joint.at, bone }]
}

/// Round widths at equal steps.
fn even(widths: &[f64], unit: f64) -> Vec<Width> {
    let last = (widths.len() - 1) as f64;
    let width = |(k, w): (usize, &f64)| Width {
        share: k as f64 / last,
        wide: w * unit,
        deep: w * unit,
    };
    widths.iter().enumerate().map(width).collect()
}

fn flat(widths: &[(f64, f64, f64)], unit: f64) -> Vec<Width> {
    let width = |(share, wide, deep): &(f64, f64, f64)| Width {
        share: *share,
        wide: wide * unit,
        deep: deep * unit,
    };
    widths.iter().map(width).collect()
}

/// The joints of an arm or a leg: shoulder, elbow and wrist, or hip, knee and ankle.
type Limb = [usize; 3];

struct Body<'a> {
    joints: &'a [Joint],
    legs: [Limb; 2],
    arms: [Limb; 2],
    /// The joints that carry both legs, and both arms.
    pelvis: usize,
    chest: usize,
    /// Where the middles of the hips and of the shoulders are, cm.
    hips: DVec3,
    shoulders: DVec3,
    up: DVec3,
    left: DVec3,
    front: DVec3,
    /// The size of the body against one with legs of the length `LEG`.
    unit: f64,
}

impl<'a> Body<'a> {
    /// `None` where the names do not tell a body, or where it has no size.
    fn of(joints: &'a [Joint]) -> Option<Body<'a>> {
        let limbs = limbs(joints)?;
        let [left_leg, right_leg, left_arm, right_arm] = limbs;
        let (legs, arms) = ([left_leg, right_leg], [left_arm, right_arm]);
        let is_whole =
            |limb: &Limb| above(joints, limb[1], limb[0]) && above(joints, limb[2], limb[1]);
        if !limbs.iter().all(is_whole) {
            return None;
        }
        let pelvis = fork(joints, legs[0][0], legs[1][0])?;
        let chest = fork(joints, arms[0][0], arms[1][0])?;
        if !above(joints, chest, pelvis) {
            return None;
        }
        let at = |j: usize| joints[j].at;
        let middle = |limbs: &[Limb; 2]| (at(limbs[0][0]) + at(limbs[1][0])) / 2.0;
        let (hips, shoulders) = (middle(&legs), middle(&arms));
        let up = (shoulders - hips).try_normalize()?;
        let across = at(legs[0][0]) - at(legs[1][0]) + at(arms[0][0]) - at(arms[1][0]);
        let left = (across - across.dot(up) * up).try_normalize()?;
        let long = |[a, b, c]: &Limb| (at(*a) - at(*b)).length() + (at(*b) - at(*c)).length();
        let unit = (long(&legs[0]) + long(&legs[1])) / 2.0 / LEG;
        (unit > 1e-3).then_some(Body {
            joints,
            legs,
            arms,
            pelvis,
            chest,
            hips,
            shoulders,
            up,
            left,
            front: left.cross(up),
            unit,
        })
    }

    fn push(&self, mesh: &mut SkinnedMesh) {
        // What is drawn, or lies inside.
        let mut drawn = vec![false; self.joints.len()];
        let mut mark = |j: usize| {
            let mut next = Some(j);
            while let Some(j) = next.filter(|j| !drawn[*j]) {
                drawn[j] = true;
                next = self.joints[j].parent;
            }
        };
        self.push_trunk(mesh);
        for &[hip, knee, ankle] in &self.legs {
            self.push_limb(mesh, [hip, knee, ankle], (&THIGH, &SHIN), self.left);
            let beyond = self.beyond(ankle);
            self.push_foot(mesh, ankle, &beyond);
            beyond.iter().chain([&ankle]).for_each(|j| mark(*j));
        }
        for &[shoulder, elbow, wrist] in &self.arms {
            let collar = self.path(self.chest, shoulder);
            push_tube(mesh, &collar, &even(&COLLAR, self.unit), self.front);
            self.push_limb(
                mesh,
                [shoulder, elbow, wrist],
                (&UPPER_ARM, &FOREARM),
                self.front,
            );
            let beyond = self.beyond(wrist);
            self.push_hand(mesh, [elbow, wrist], &beyond);
            beyond.iter().chain([&wrist]).for_each(|j| mark(*j));
        }
        let arms = self.arms.map(|arm| arm[0]);
        let beyond = self.beyond(self.chest).into_iter();
        let head: Vec<usize> = beyond
            .filter(|j| {
                !arms
                    .iter()
                    .any(|a| above(self.joints, *j, *a) || above(self.joints, *a, *j))
            })
            .collect();
        self.push_head(mesh, &head);
        head.iter().for_each(|j| mark(*j));
        mark(self.pelvis);
        for (joint, _) in self.joints.iter().zip(&drawn).filter(|(_, drawn)| !**drawn) {
            push_other(mesh, self.joints, joint);
        }
    }

    /// From between the hips over the spine to between the shoulders.
    fn push_trunk(&self, mesh: &mut SkinnedMesh) {
        let carrier = |j: usize| self.joints[j].carrier;
        let mut knots = vec![Knot {
            at: self.hips,
            bone: carrier(self.pelvis),
        }];
        let height = |at: DVec3| (at - self.hips).dot(self.up);
        let spine = self.path(self.pelvis, self.chest);
        // Joints below the hips or above the shoulders would fold the surface.
        let top = height(self.shoulders);
        for knot in &spine {
            let lowest = knots.last().map_or(0.0, |k| height(k.at)) + 0.5;
            if (lowest..top - 0.5).contains(&height(knot.at)) {
                knots.push(*knot)
            } else {
                knots
                    .last_mut()
                    .into_iter()
                    .for_each(|k| k.bone = knot.bone)
            }
        }
        if let Some(last) = knots
            .last_mut()
            .filter(|_| height(self.joints[self.chest].at) < top)
        {
            last.bone = carrier(self.chest);
        }
        knots.push(Knot {
            at: self.shoulders,
            bone: carrier(self.chest),
        });
        let half = |limbs: &[Limb; 2]| {
            let [a, b] = limbs.map(|limb| self.joints[limb[0]].at);
            (a - b).length() / 2.0
        };
        let hips = half(&self.legs);
        let shoulders = half(&self.arms).max(SHOULDERS * self.unit);
        let width = |(share, wide, deep): (f64, f64, f64)| Width {
            share,
            wide: if share < BY_HIPS {
                hips + wide * self.unit
            } else {
                shoulders * wide
            },
            deep: deep * self.unit,
        };
        push_tube(mesh, &knots, &TRUNK.map(width), self.left);
    }

    fn push_limb(
        &self,
        mesh: &mut SkinnedMesh,
        [first, middle, last]: Limb,
        (upper, lower): (&[f64], &[f64]),
        side: DVec3,
    ) {
        let (a, b) = (self.path(first, middle), self.path(middle, last));
        let long = |path: &[Knot]| -> f64 {
            let steps = path.windows(2).map(|p| (p[1].at - p[0].at).length());
            steps.sum()
        };
        let share = long(&a) / (long(&a) + long(&b)).max(f64::MIN_POSITIVE);
        let upper = even(upper, self.unit).into_iter().map(|w| Width {
            share: share * w.share,
            ..w
        });
        let lower = even(lower, self.unit).into_iter().map(|w| Width {
            share: share + (1.0 - share) * w.share,
            ..w
        });
        let profile: Vec<Width> = upper.chain(lower.skip(1)).collect();
        let knots: Vec<Knot> = a.into_iter().chain(b).collect();
        push_tube(mesh, &knots, &profile, side);
    }

    /// An egg with a nose on a neck; `beyond`: the joints of neck and head.
    fn push_head(&self, mesh: &mut SkinnedMesh, beyond: &[usize]) {
        let height = |at: DVec3| (at - self.shoulders).dot(self.up);
        let high = |j: &usize| height(self.joints[*j].at);
        let unit = self.unit;
        let mut top = (beyond.iter().copied()).max_by(|a, b| high(a).total_cmp(&high(b)));
        // The joint of the head is the last that is not inside it.
        let highest = (HEAD_ABOVE.0 - HEAD_ABOVE.1) * unit;
        let base = |top: usize| self.joints[top].parent.filter(|base| *base != self.chest);
        while let Some(base) = top.and_then(base).filter(|base| high(base) > highest) {
            top = Some(base);
        }
        let (mut neck, bone) = match top.and_then(|t| Some((t, self.joints[t].parent?))) {
            Some((top, base)) => (self.path(self.chest, base), self.joints[top].bone),
            None => (Vec::new(), self.joints[self.chest].carrier),
        };
        let base = neck.last().map_or(self.shoulders, |k| k.at);
        let above = (HEAD_ABOVE.0 * unit - height(base)).max(HEAD_ABOVE.1 * unit);
        let center = base + above * self.up;
        neck.push(Knot { at: base, bone });
        neck.push(Knot { at: center, bone });
        push_tube(mesh, &neck, &even(&NECK, unit), self.left);
        let [side, front, up] = HEAD.map(|half| half * unit);
        let half = [side * self.left, -front * self.front, up * self.up];
        push_ellipsoid(mesh, center, [half[0], half[1], half[2]], bone);
        let nose = center + 0.97 * front * self.front - 0.12 * up * self.up;
        let half = [0.2 * half[0], 0.2 * half[1], 0.22 * half[2]];
        push_ellipsoid(mesh, nose, half, bone);
    }

    fn push_hand(&self, mesh: &mut SkinnedMesh, [elbow, wrist]: [usize; 2], beyond: &[usize]) {
        let at = |j: usize| self.joints[j].at;
        let ends = beyond
            .iter()
            .filter(|j| !beyond.iter().any(|c| self.joints[*c].parent == Some(**j)));
        let mitten = if ends.count() >= FINGERS {
            Vec::new()
        } else {
            let mut knots = self.farthest(wrist, beyond);
            let along = (at(wrist) - at(elbow)).normalize_or(self.up);
            self.lengthen(&mut knots, HAND * self.unit, along);
            push_tube(mesh, &knots, &flat(&MITTEN, self.unit), self.front);
            self.chain(wrist, beyond)
        };
        for &j in beyond.iter().filter(|j| !mitten.contains(j)) {
            let Some(parent) = self.joints[j].parent else {
                continue;
            };
            let widths = if parent == wrist { PALM } else { FINGER };
            let knots = piece(at(parent), &self.joints[j]);
            push_tube(mesh, &knots, &even(&widths, self.unit), self.front);
        }
    }

    fn push_foot(&self, mesh: &mut SkinnedMesh, ankle: usize, beyond: &[usize]) {
        let unit = self.unit;
        let start = self.joints[ankle].at;
        let mut knots = self.farthest(ankle, beyond);
        let tip = knots[knots.len() - 1].at - start;
        let flat_tip = tip - tip.dot(self.up) * self.up;
        // Feet of rigs that rest on tiptoe have no way forwards of their own.
        let forwards = if flat_tip.length() > 0.3 * tip.length() && flat_tip.length() > SHORTEST {
            flat_tip.normalize()
        } else {
            self.front
        };
        self.lengthen(&mut knots, FOOT * unit, forwards);
        // The sole is flat.
        for knot in knots.iter_mut().skip(1) {
            let below = (start - knot.at).dot(self.up);
            knot.at += (below - BALL_BELOW * unit) * self.up;
        }
        let heel = start - HEEL.0 * unit * forwards - HEEL.1 * unit * self.up;
        let side = self.up.cross(forwards);
        let ball = knots[1];
        push_tube(mesh, &[knots[0], ball], &even(&INSTEP, unit), side);
        knots[0].at = heel;
        push_tube(mesh, &knots, &flat(&SOLE, unit), side);
    }

    /// Makes a chain at least so long, cm; one without a piece goes `along`.
    fn lengthen(&self, knots: &mut Vec<Knot>, length: f64, along: DVec3) {
        let first = knots[0].at;
        if knots.len() == 1 {
            let at = first + length * along;
            return knots.push(Knot { at, ..knots[0] });
        }
        let (last, before) = (knots.len() - 1, knots[knots.len() - 2].at);
        let lacks = length - (knots[last].at - first).length();
        if lacks > 0.0 {
            let on = (knots[last].at - before).normalize_or(along);
            knots[last].at += lacks * on;
        }
    }

    /// The joints beyond one.
    fn beyond(&self, joint: usize) -> Vec<usize> {
        let all = joint + 1..self.joints.len();
        all.filter(|j| above(self.joints, *j, joint)).collect()
    }

    /// The joints from the one after `from` to the farthest from it.
    fn chain(&self, from: usize, beyond: &[usize]) -> Vec<usize> {
        let far = |j: &usize| (self.joints[*j].at - self.joints[from].at).length();
        let farthest = beyond
            .iter()
            .copied()
            .max_by(|a, b| far(a).total_cmp(&far(b)));
        let mut chain = Vec::new();
        let mut next = farthest;
        while let Some(j) = next.filter(|j| *j != from) {
            chain.push(j);
            next = self.joints[j].parent;
        }
        chain.reverse();
        chain
    }

    /// The chain from a joint to the farthest beyond it; without any, its own position alone.
    fn farthest(&self, from: usize, beyond: &[usize]) -> Vec<Knot> {
        match self.chain(from, beyond).last() {
            Some(last) => self.path(from, *last),
            None => vec![Knot {
                at: self.joints[from].at,
                bone: self.joints[from].carrier,
            }],
        }
    }

    /// The knots from a joint to one beyond it.
    fn path(&self, from: usize, to: usize) -> Vec<Knot> {
        let mut knots = vec![Knot {
            at: self.joints[to].at,
            bone: self.joints[to].carrier,
        }];
        let mut j = to;
        while let Some(parent) = self.joints[j].parent.filter(|_| j != from) {
            knots.push(Knot {
                at: self.joints[parent].at,
                bone: self.joints[j].bone,
            });
            j = parent;
        }
        knots.reverse();
        knots
    }
}

/// Whether a joint is another or stands on it.
fn above(joints: &[Joint], joint: usize, on: usize) -> bool {
    let mut next = Some(joint);
    while let Some(j) = next.filter(|j| *j != on) {
        next = joints[j].parent;
    }
    next.is_some()
}

/// The last joint on which both stand.
fn fork(joints: &[Joint], a: usize, b: usize) -> Option<usize> {
    let mut next = Some(a);
    while let Some(j) = next.filter(|j| !above(joints, b, *j)) {
        next = joints[j].parent;
    }
    next
}

/// Left leg, right leg, left arm, right arm, by names.
fn limbs(joints: &[Joint]) -> Option<[Limb; 4]> {
    let names: Vec<String> = joints.iter().map(|j| j.name.clone()).collect();
    let row = joints.iter().flat_map(|j| j.at.to_array()).collect();
    let xyz = Array2::from_shape_vec((1, 3 * joints.len()), row).ok()?;
    let own = BonePoints::of(&names, xyz.view()).bone_ends(&names);
    let limb = |find: &dyn Fn(&str) -> Option<usize>, side: char, bones: [&str; 3]| {
        let [a, b, c] = bones.map(|bone| find(&format!("{side}{bone}")));
        Some([a?, b?, c?])
    };
    let all = |find: &dyn Fn(&str) -> Option<usize>| {
        let (leg, arm) = (
            ["hipjoint", "femur", "tibia"],
            ["clavicle", "humerus", "radius"],
        );
        Some([
            limb(find, 'l', leg)?,
            limb(find, 'r', leg)?,
            limb(find, 'l', arm)?,
            limb(find, 'r', arm)?,
        ])
    };
    all(&|name| own.iter().position(|n| n == name)).or_else(|| {
        let columns = NameMap::fitting(&names)?.columns(&names);
        all(&|name| columns.get(name).copied())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints::{CMU, CMU_PARENT, CMU_REST};

    /// CMU's joints, each on a bone of its own.
    fn cmu() -> Vec<Joint> {
        let joint = |j: usize| Joint {
            name: CMU[j].to_string(),
            parent: (j > 0).then_some(CMU_PARENT[j]),
            at: DVec3::from_array(CMU_REST[j]),
            bone: j as u16,
            carrier: j as u16,
        };
        (0..CMU.len()).map(joint).collect()
    }

    fn body(joints: &[Joint]) -> SkinnedMesh {
        let mut mesh = SkinnedMesh::default();
        push_body(&mut mesh, joints);
        mesh
    }

    /// The number of closed surfaces.
    fn surfaces(mesh: &SkinnedMesh) -> usize {
        (mesh.vertices.len() - mesh.faces.len() / 2) / 2
    }

    /// The largest coordinate of the vertices that follow a bone alone, cm.
    fn farthest(mesh: &SkinnedMesh, bone: &str, axis: usize) -> f64 {
        let b = CMU.iter().position(|n| *n == bone).unwrap() as u16;
        let own = mesh.vertices.iter().zip(&mesh.weights);
        let own = own.filter(|(_, w)| w[0] == (b, 1.0));
        own.map(|(v, _)| 100.0 * f64::from(v[axis]))
            .fold(f64::MIN, f64::max)
    }

    #[test]
    fn a_known_skeleton_has_a_persons_body() {
        let mesh = body(&cmu());
        // Trunk, neck, head and nose; and twice a leg, a foot of two, a collar, an arm, a hand.
        assert_eq!(surfaces(&mesh), 4 + 2 * 6);
        let heights = mesh.vertices.iter().map(|v| 100.0 * f64::from(v[1]));
        let (low, high) = heights.fold((0.0, 0.0), |(a, b), y| (f64::min(a, y), f64::max(b, y)));
        assert!((170.0..180.0).contains(&(high - low)), "{low} to {high}");
        // The nose is in front, the left hand ends to the left.
        assert!(farthest(&mesh, "head", 2) > 9.0);
        assert!((80.0..90.0).contains(&farthest(&mesh, "lwrist", 0)));
        assert!(mesh.vertices.len() < 6000);
    }

    #[test]
    fn a_turned_body_is_the_same() {
        let turn = glam::DMat3::from_rotation_x(1.2) * glam::DMat3::from_rotation_z(2.0);
        let mut turned = cmu();
        turned.iter_mut().for_each(|j| j.at = turn * j.at);
        let (a, b) = (body(&cmu()), body(&turned));
        assert!(a.faces == b.faces);
        for (a, b) in a.vertices.iter().zip(&b.vertices) {
            let [a, b] = [a, b].map(|v| DVec3::from(v.map(f64::from)));
            assert!((turn * a - b).length() < 1e-5);
        }
    }

    #[test]
    fn names_of_maps_and_starts_of_bones_are_known() {
        let mut mixamo = cmu();
        let map = NameMap::find("mixamo").unwrap();
        for joint in &mut mixamo {
            let name = map.joints.get(&joint.name).unwrap_or(&joint.name);
            joint.name = format!("mixamorig:{name}");
        }
        assert!(body(&mixamo) == body(&cmu()));
        // What no map knows has a tube a bone.
        let mut unknown = cmu();
        for (j, joint) in unknown.iter_mut().enumerate() {
            joint.name = format!("j{j}");
        }
        assert_eq!(surfaces(&body(&unknown)), 22);
    }

    #[test]
    fn bodies_without_size_or_tree_are_no_bodies() {
        let mut flat = cmu();
        flat.iter_mut().for_each(|j| j.at = DVec3::ZERO);
        assert!(body(&flat).vertices.is_empty());
        // A knee that stands on no hip.
        let mut loose = cmu();
        loose[2].parent = Some(0);
        assert_eq!(surfaces(&body(&loose)), 22);
        assert!(body(&[]).vertices.is_empty());
        let mut nan = cmu();
        nan[14].at = DVec3::NAN;
        body(&nan);
    }

    #[test]
    fn fingers_are_thin_and_other_bones_have_tubes() {
        let mut joints = cmu();
        let palm = joints.iter().position(|j| j.name == "lradius").unwrap();
        let wrist = joints[palm].at;
        for k in 0..4 {
            joints.push(Joint {
                name: format!("finger{k}"),
                parent: Some(palm),
                at: wrist + DVec3::new(9.0, 0.0, 2.0 * f64::from(k) - 4.0),
                bone: 40 + k as u16,
                carrier: 40 + k as u16,
            });
        }
        let tail = Joint {
            name: "tail".into(),
            parent: Some(0),
            at: DVec3::new(0.0, 0.0, -30.0),
            bone: 50,
            carrier: 50,
        };
        joints.push(tail);
        // Five fingers for one mitten, and a tail.
        assert_eq!(surfaces(&body(&joints)), 16 + 4 + 1);
    }
}
