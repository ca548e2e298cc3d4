//! What holds feet where they stand: legs that reach, and hips that are lowered where these are too
//! short.

use super::contacts::Contacts;
use super::legs::Legs;
use super::tuning::*;
use crate::ik::retarget::feet::{LegFrame, carry};
use crate::ik::retarget::tuning::feet::REACH;
use crate::pose::foot_contacts::fade;
use glam::{DMat3, DVec3};

/// What holds both feet.
pub(super) struct Held {
    /// By side and frame, what turns thigh and shin from the left, in the directions of the level
    /// floor; `None`: nothing.
    pub turns: [Vec<[Option<DMat3>; 2]>; 2],
    /// By frame, how much lower the body is.
    pub lowered: Vec<f64>,
    /// The number of contacts that are held.
    pub contacts: usize,
    /// How far a foot in contact is from its middle at most.
    pub slide: f64,
}

/// Holds both feet of legs on a level floor.
pub(super) fn hold(legs: &Legs, standing: &[Contacts; 2]) -> Held {
    let [rate, unit] = legs.feet.scale;
    let longest = (FADE * rate).round() as usize;
    let count = legs.frames[0].len();
    let (mut contacts, mut slide) = (0, 0.0);
    let mut both = standing.each_ref().map(|own| {
        let (mut offsets, mut weights) = (vec![DVec3::ZERO; count], vec![0.0; count]);
        for (n, range) in own.frames.iter().enumerate() {
            let far = own.slide(n);
            let is_held = (STILL * unit..=SHIFTED * unit).contains(&far);
            if is_held {
                contacts += 1;
            } else {
                slide = f64::max(slide, far);
            }
            for t in range.clone() {
                weights[t] = 1.0;
                if is_held {
                    offsets[t] = own.offset(n, t);
                }
            }
        }
        fade(&own.frames, longest, &mut offsets, &mut weights);
        (offsets, weights)
    });
    let lack = |t: usize| {
        let of_side = |side: usize| lack(&legs.frames[side][t], both[side].0[t]);
        f64::max(of_side(0), of_side(1)).min(LOWERED * unit)
    };
    let lowered = eased(&(0..count).map(lack).collect::<Vec<_>>(), longest);
    let turns = [0, 1].map(|side: usize| {
        let mut frames = legs.frames[side].clone();
        let (offsets, weights) = &mut both[side];
        for (t, frame) in frames.iter_mut().enumerate() {
            let down = lowered[t] * DVec3::Y;
            let bones = &mut frame.bones;
            for point in [&mut bones.hip, &mut bones.knee, &mut bones.ankle] {
                *point -= down;
            }
            offsets[t] += down;
        }
        let (turns, left) = carry(&frames, legs.leg, offsets, weights);
        slide = f64::max(slide, left);
        turns
    });
    Held {
        turns,
        lowered,
        contacts,
        slide,
    }
}

/// How much lower a hip must be for its leg to carry the ankle by `offset`, with the knee a little
/// bent or as straight as it is.
fn lack(frame: &LegFrame, offset: DVec3) -> f64 {
    let bones = &frame.bones;
    if offset == DVec3::ZERO || !frame.source.is_finite() {
        return 0.0;
    }
    let length = bones.knee.distance(bones.hip) + bones.ankle.distance(bones.knee);
    let reach = (REACH * length).max(bones.ankle.distance(bones.hip));
    let way = bones.hip - (bones.ankle + offset);
    if way.length() <= reach {
        return 0.0;
    }
    let across = way.x.hypot(way.z);
    (way.y - (reach * reach - across * across).max(0.0).sqrt()).max(0.0)
}

/// Values that rise to each of `values` and fall from it by a cosine over `longest` frames.
fn eased(values: &[f64], longest: usize) -> Vec<f64> {
    let mut out = vec![0.0; values.len()];
    for (t, value) in values.iter().enumerate().filter(|(_, value)| **value > 0.0) {
        let (from, to) = (
            t.saturating_sub(longest),
            (t + longest).min(values.len() - 1),
        );
        for (n, out) in out.iter_mut().enumerate().take(to + 1).skip(from) {
            let share = n.abs_diff(t) as f64 / (longest + 1) as f64;
            *out = f64::max(
                *out,
                value * (0.5 + 0.5 * (std::f64::consts::PI * share).cos()),
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_eased_to_and_from_each_peak() {
        let mut values = vec![0.0; 21];
        (values[10], values[12]) = (1.0, 0.5);
        let eased = eased(&values, 4);
        assert_eq!((eased[10], eased[5], eased[17]), (1.0, 0.0, 0.0));
        assert!(eased.iter().zip(&values).all(|(e, v)| e >= v));
        assert!((6..10).all(|t| eased[t] < eased[t + 1]));
        assert!(super::eased(&[], 3).is_empty());
    }
}
