//! Feet of a rig planted as the source's are.
//!
//! An ankle of the source is in contact while it is slow and low. There the rig's ankle goes to `k
//! (a - median a) + median a'`: the position that it has itself, with the source's own roll, k the
//! scale; over a ground it is as high as the source's, but for how high the ankles of both stand.
//! The legs reach it by two-bone inverse kinematics; what was added fades before and after. Where
//! a sole would be under the ground, foot and toes turn up.

use super::soles::Ground;
use super::tuning::feet::*;
use crate::numeric::statistics::median;
use crate::pose::foot_contacts::{ContactLimits, contacts, fade};
use crate::pose::two_bone::TwoBones;
use glam::{DMat3, DVec3};

/// A leg in one frame: the rig's, and the source's ankle.
#[derive(Debug, Clone, Copy)]
pub(in crate::ik) struct LegFrame {
    pub bones: TwoBones,
    /// The global rotation of the thigh.
    pub thigh: DMat3,
    /// The source's ankle; nan where it is missing.
    pub source: DVec3,
    /// The global rotations of foot and toes.
    pub foot: [DMat3; 2],
    /// Whether the toes turn with the foot.
    pub toes_rest: bool,
}

/// What plants a foot.
#[derive(Debug, Default)]
pub(super) struct Planted {
    /// By frame, what turns thigh, shin, foot and toes, from the left; `None`: nothing.
    pub turns: Vec<[Option<DMat3>; 4]>,
    /// The number of contacts.
    pub contacts: usize,
    /// How far the ankle leaves its goal at most, cm.
    pub slide: f64,
}

/// What a contact is, `unit` being what counts as a centimeter.
fn limits(unit: f64) -> ContactLimits {
    ContactLimits {
        speed: SPEED * unit,
        height: HEIGHT * unit,
        seconds: LEAST,
    }
}

/// Plants a foot, on a ground if there is one; `scale` is the rig's length of a unit of the source,
/// `leg` the rig's leg, and `unit` what counts as a centimeter of the source.
pub(super) fn plant(
    frames: &[LegFrame],
    rate: f64,
    [scale, leg, unit]: [f64; 3],
    ground: Option<&Ground>,
) -> Planted {
    let source: Vec<DVec3> = frames.iter().map(|f| f.source).collect();
    let contacts = contacts(&source, rate, &limits(unit));
    let mut offsets = vec![DVec3::ZERO; frames.len()];
    let mut weights = vec![0.0; frames.len()];
    for contact in &contacts {
        let mut shift = middle(&frames[contact.clone()], |f| {
            f.bones.ankle - scale * f.source
        });
        shift.y = ground.map_or(shift.y, |ground| ground.raise);
        for t in contact.clone() {
            offsets[t] = scale * frames[t].source + shift - frames[t].bones.ankle;
            weights[t] = 1.0;
        }
    }
    fade(
        &contacts,
        (FADE * rate).round() as usize,
        &mut offsets,
        &mut weights,
    );
    let mut turns = vec![[None; 2]; frames.len()];
    if let Some(ground) = ground {
        for (t, frame) in frames.iter().enumerate() {
            let (feet, lift) =
                ground.clear(frame.bones.ankle + offsets[t], frame.foot, frame.toes_rest);
            turns[t] = feet;
            offsets[t].y += lift;
        }
    }
    let (legs, slide) = carry(frames, leg, &offsets, &weights);
    let both = |([upper, lower], [foot, toes]): ([_; 2], [_; 2])| [upper, lower, foot, toes];
    Planted {
        turns: legs.into_iter().zip(turns).map(both).collect(),
        contacts: contacts.len(),
        slide,
    }
}

/// What turns thigh and shin, from the left, in each frame so that ankles move by `offsets`, with a
/// leg of the length `leg`; and how far an ankle leaves its goal at most where `weights` are 1.
/// Bones keep their lengths, and knees bend to the side to which they bend in the mean.
pub(in crate::ik) fn carry(
    frames: &[LegFrame],
    leg: f64,
    offsets: &[DVec3],
    weights: &[f64],
) -> (Vec<[Option<DMat3>; 2]>, f64) {
    let hinge: DVec3 = frames
        .iter()
        .map(|f| f.thigh.transpose() * f.bones.bend())
        .sum();
    let hinge = hinge.normalize_or_zero() * HINGE * leg / LEG;
    let (mut turns, mut slide) = (Vec::with_capacity(frames.len()), 0.0);
    for (t, frame) in frames.iter().enumerate() {
        let (offset, weight) = (offsets[t], weights[t]);
        let is_moved = offset != DVec3::ZERO && frame.source.is_finite();
        let reached = is_moved.then(|| {
            // What hardly moves keeps the plane of its knee.
            let moved = (offset.length() / (HARDLY * leg)).min(1.0);
            let pole = frame.bones.bend() + weight * moved * (frame.thigh * hinge);
            frame.bones.reach(frame.bones.ankle + offset, pole, REACH)
        });
        let reached = reached.flatten();
        if let Some(reached) = reached.filter(|_| weight == 1.0) {
            let goal = frame.bones.ankle + offset;
            slide = f64::max(slide, reached.ankle.distance(goal));
        }
        turns.push([reached.map(|r| r.upper), reached.map(|r| r.lower)]);
    }
    (turns, slide)
}

/// The median of each coordinate.
fn middle(frames: &[LegFrame], point: impl Fn(&LegFrame) -> DVec3) -> DVec3 {
    let one = |c: usize| median(frames.iter().map(|f| point(f)[c]).collect()).unwrap_or(0.0);
    DVec3::new(one(0), one(1), one(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ankle that stands, rolling a little, swings for 20 frames and stands again, at 100 frames
    /// a second.
    fn track() -> Vec<DVec3> {
        let at = |t: usize| {
            let swing = (t as f64 - 40.0).clamp(0.0, 20.0) / 20.0;
            let lift = 15.0 * (std::f64::consts::PI * swing).sin();
            DVec3::new(0.02 * t as f64, 8.0 + lift, 70.0 * swing)
        };
        (0..100).map(at).collect()
    }

    fn legs(error: impl Fn(usize) -> DVec3) -> Vec<LegFrame> {
        let frame = |(t, source): (usize, DVec3)| {
            let ankle = 0.9 * source + error(t);
            let hip = DVec3::new(0.0, 80.0, 0.9 * 70.0 * t as f64 / 100.0);
            // Thigh and shin of 40, bent forward.
            let half = (ankle - hip) / 2.0;
            let side = DVec3::X.cross(half).normalize() * -1.0;
            let knee = hip + half + side * (1600.0 - half.length_squared()).max(0.0).sqrt();
            LegFrame {
                bones: TwoBones { hip, knee, ankle },
                thigh: DMat3::IDENTITY,
                source,
                foot: [DMat3::IDENTITY; 2],
                toes_rest: false,
            }
        };
        track().into_iter().enumerate().map(frame).collect()
    }

    #[test]
    fn a_planted_foot_has_the_sources_roll_and_fades_out() {
        let wobble = |t: usize| DVec3::new((t as f64 * 0.3).sin(), 0.0, (t as f64 * 0.2).cos());
        let frames = legs(wobble);
        let planted = plant(&frames, 100.0, [0.9, 80.0, 1.0], None);
        assert_eq!(planted.contacts, 2);
        assert!(planted.slide <= 1e-9, "{}", planted.slide);
        let ankle = |t: usize| {
            let TwoBones { hip, knee, ankle } = frames[t].bones;
            match planted.turns[t] {
                [Some(upper), Some(lower), ..] => {
                    hip + upper * (knee - hip) + lower * (ankle - knee)
                }
                _ => ankle,
            }
        };
        for contact in contacts(&track(), 100.0, &limits(1.0)) {
            let first = ankle(contact.start) - 0.9 * frames[contact.start].source;
            for t in contact {
                assert!((ankle(t) - 0.9 * frames[t].source - first).length() <= 1e-9);
            }
        }
        for t in 1..100 {
            let added = |t: usize| ankle(t) - frames[t].bones.ankle;
            let step = (added(t) - added(t - 1)).length();
            assert!(step <= 0.6, "{t}: {step}");
        }
    }

    #[test]
    fn a_foot_that_follows_already_is_left_alone() {
        let mut frames = legs(|_| DVec3::X);
        // Knees that bend to another side than in the mean.
        let turn = |t: usize| DMat3::from_rotation_y((t as f64 * 0.1).sin());
        frames
            .iter_mut()
            .enumerate()
            .for_each(|(t, frame)| frame.thigh = turn(t));
        let planted = plant(&frames, 100.0, [0.9, 80.0, 1.0], None);
        let still = |turn: &DMat3| turn.abs_diff_eq(DMat3::IDENTITY, 1e-6);
        assert!(planted.turns.iter().flatten().flatten().all(still));
    }
}
