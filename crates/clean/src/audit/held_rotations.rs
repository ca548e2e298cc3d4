//! Rotations that stand still beside moving ones: a value that was held while the joint was not
//! seen.

use super::{Finding, FindingKind, ranges};
use crate::numeric::statistics::{median, range};
use crate::pose::JointAngles;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// A rotation that stands still for longer than this, seconds, may be held; and for no fewer
/// frames.
const SECONDS: f64 = 0.2;
const LEAST_FRAMES: usize = 5;
/// Angles that differ by less are the same, radians: the last digit of a file.
const SAME: f64 = 1e-6;
/// A joint that rests in a larger share of its other steps (a finger, a toe, a keyed animation) is
/// not held by a fault, nor one that rests in more of the take.
const RESTING: f64 = 0.3;
const LONGEST: f64 = 0.5;
/// An angle this near to its least or largest in the take, as a share of their distance, is at a
/// limit of the joint.
const AT_LIMIT: f64 = 1e-3;
/// A step after a rest that is this many times as large as any within a motion ends a value that
/// was held, at a limit too.
const BREAK: f64 = 1.5;
/// What the joint would have turned by meanwhile at its usual speed, radians, and how fast others
/// turn, radians a second: less is a pause.
const LEAST_TURN: f64 = 3.0 * PI / 180.0;
const LEAST_SPEED: f64 = 10.0 * PI / 180.0;

/// Joints whose rotations stand still in the same frames.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldRotations {
    /// Their indices.
    pub joints: Vec<usize>,
    /// The frames with one value; the first frame's value is a measurement.
    pub frames: Range<usize>,
}

/// The rotations that were held, in the order of their frames: those of joints that move in most of
/// the take, while others move. Files hold them where sensors or solvers fail. `rate`: frames a
/// second.
///
/// ```
/// use posing_clean::audit::held_rotations;
/// use posing_core::pose::{JointAngles, rotation::Axis};
///
/// // Both joints turn all the time, but for the knee from frame 100 on, for a second.
/// let joint = |name: &str, held: std::ops::Range<usize>| JointAngles {
///     joint: name.into(),
///     axes: vec![Axis::X],
///     angles: ndarray::Array2::from_shape_fn((400, 1), |(t, _)| {
///         let t = if held.contains(&t) { held.start } else { t };
///         (t as f64 / 20.0).sin()
///     }),
/// };
/// let held = held_rotations(&[joint("hip", 0..0), joint("knee", 100..200)], 100.0);
/// assert_eq!((held[0].joints.clone(), held[0].frames.clone()), (vec![1], 100..200));
/// ```
pub fn held_rotations(joints: &[JointAngles], rate: f64) -> Vec<HeldRotations> {
    let motions: Vec<JointMotion> = joints.iter().map(JointMotion::of).collect();
    let least = LEAST_FRAMES.max((SECONDS * rate) as usize + 1);
    let mut together: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (j, motion) in motions.iter().enumerate() {
        for steps in motion.held_steps(rate) {
            let frames = (steps.start, steps.end + 1);
            if frames.1 - frames.0 >= least {
                together.entry(frames).or_default().push(j);
            }
        }
    }
    let held = together
        .into_iter()
        .map(|((start, end), joints)| HeldRotations {
            joints,
            frames: start..end,
        });
    held.filter(|held| is_beside_motion(held, &motions, rate))
        .collect()
}

/// The findings of [`held_rotations`], one a run of frames.
pub(crate) fn held_findings(joints: &[JointAngles], rate: Option<f64>) -> Vec<Finding> {
    let held = rate.map_or(Vec::new(), |rate| held_rotations(joints, rate));
    let finding = |held: HeldRotations| {
        let names: Vec<String> = (held.joints.iter())
            .map(|&j| joints[j].joint.clone())
            .collect();
        let (verb, own) = match names.len() {
            1 => ("stands", "its last rotation was"),
            _ => ("stand", "their last rotations were"),
        };
        Finding {
            kind: FindingKind::Held,
            frames: Some([held.frames.start, held.frames.end]),
            what: format!(
                "{} {verb} still in frames {} to {} while others turn: {own} held (clean fills \
                 them with the option `held_is_missing`)",
                names.join(", "),
                held.frames.start,
                held.frames.end - 1
            ),
            points: names,
        }
    };
    held.into_iter().map(finding).collect()
}

/// Whether as many other joints move, in the median faster than in a pause.
fn is_beside_motion(held: &HeldRotations, motions: &[JointMotion], rate: f64) -> bool {
    let steps = held.frames.start..held.frames.end - 1;
    let others = (0..motions.len()).filter(|j| motions[*j].moves && !held.joints.contains(j));
    let speed = |j: usize| {
        let own = &motions[j].steps[steps.clone()];
        let known: Vec<f64> = own.iter().copied().filter(|s| s.is_finite()).collect();
        known.iter().sum::<f64>() / known.len().max(1) as f64 * rate
    };
    let speeds: Vec<f64> = others.map(speed).collect();
    speeds.len() >= held.joints.len() && median(speeds).is_some_and(|s| s > LEAST_SPEED)
}

/// How the angles of a joint change.
struct JointMotion {
    /// The largest change of an angle to the next frame, radians; NaN where one is missing.
    steps: Vec<f64>,
    /// Whether it moves in most of the take, and the number of steps in which it does not.
    moves: bool,
    still: usize,
    /// Its usual step where it moves, radians.
    typical: f64,
    /// Whether a single angle changes.
    is_hinge: bool,
    /// By frame, whether it is at a limit.
    at_limit: Vec<bool>,
}

impl JointMotion {
    fn of(joint: &JointAngles) -> JointMotion {
        let angles = &joint.angles;
        let change = |t: usize, c: usize| {
            let step = angles[[t + 1, c]] - angles[[t, c]];
            (step + PI).rem_euclid(TAU) - PI
        };
        let largest = |z: f64, s: f64| {
            if z.is_nan() || s.is_nan() {
                f64::NAN
            } else {
                z.max(s)
            }
        };
        let step = |t: usize| {
            let changes = (0..angles.ncols()).map(|c| change(t, c).abs());
            changes.fold(0.0, largest)
        };
        let count = angles.nrows().saturating_sub(1);
        let steps: Vec<f64> = (0..count).map(step).collect();
        let moving: Vec<f64> = steps.iter().copied().filter(|s| *s > SAME).collect();
        let varies = |c: &usize| (0..count).any(|t| change(t, *c).abs() > SAME);
        let varying: Vec<usize> = (0..angles.ncols()).filter(varies).collect();
        JointMotion {
            at_limit: at_limits(joint, &varying),
            moves: moving.len() as f64 > LONGEST * count as f64,
            still: steps.iter().filter(|s| **s <= SAME).count(),
            typical: median(moving).unwrap_or(0.0),
            is_hinge: varying.len() < 2,
            steps,
        }
    }

    /// Ranges of steps in which it stands still and should not.
    fn held_steps(&self, rate: f64) -> Vec<Range<usize>> {
        let same = |t: &usize| self.steps[*t] <= SAME;
        let usual_turn = |r: &Range<usize>| self.typical * r.len() as f64;
        let leaps = |r: &Range<usize>| self.steps.get(r.end).is_none_or(|s| *s > self.typical);
        let follows_rest = |t: usize| t > 0 && same(&(t - 1));
        let in_motion = (0..self.steps.len()).filter(|t| !follows_rest(*t));
        let largest = in_motion.fold(0.0, |most: f64, t| most.max(self.steps[t]));
        // A joint leaves the limit of its hinge smoothly.
        let breaks = |r: &Range<usize>| self.steps.get(r.end).is_some_and(|s| *s > BREAK * largest);
        let is_alone = |r: &Range<usize>| {
            let (all, own) = (self.steps.len() as f64, r.len() as f64);
            own <= LONGEST * all && self.still as f64 - own <= RESTING * (all - own)
        };
        let is_held = |r: &Range<usize>| {
            let is_long = r.len() as f64 > 0.5 * SECONDS * rate;
            // A hinge may rest where it likes, and leaves its rest smoothly; a ball joint never has
            // the very same three angles.
            let is_unusual = !self.at_limit[r.start] && (!self.is_hinge || leaps(r));
            let is_odd = is_unusual || breaks(r);
            is_long && is_alone(r) && is_odd && usual_turn(r) >= LEAST_TURN
        };
        let still = ranges((0..self.steps.len()).filter(same)).into_iter();
        still.filter(is_held).collect()
    }
}

/// By frame, whether each of the angles that vary is the least or the largest of the take: knees
/// rest at the limits of their hinges.
fn at_limits(joint: &JointAngles, varying: &[usize]) -> Vec<bool> {
    let angles = &joint.angles;
    let bounds = varying.iter().map(|&c| {
        let known = angles.column(c).into_iter().copied();
        let known = known.filter(|v| v.is_finite());
        let (low, high) = range(known);
        (c, low, high, AT_LIMIT * (high - low) + SAME)
    });
    let bounds: Vec<(usize, f64, f64, f64)> = bounds.collect();
    let is_at = |t: usize| {
        let mut all = bounds.iter();
        all.all(|&(c, low, high, near)| {
            angles[[t, c]] <= low + near || angles[[t, c]] >= high - near
        })
    };
    (0..angles.nrows()).map(is_at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use ndarray::Array2;

    /// Joints of `axes` angles that swing, 60 a second, with `hold` frames of the first `joints`
    /// held.
    fn swinging(axes: usize, count: usize, joints: usize, hold: Range<usize>) -> Vec<JointAngles> {
        let joint = |j: usize| {
            let angle = |t: usize, c: usize| (0.07 * t as f64 + j as f64 + c as f64).sin();
            let kept = |t: usize| {
                if j < joints && hold.contains(&t) {
                    hold.start
                } else {
                    t
                }
            };
            JointAngles {
                joint: format!("j{j}"),
                axes: [Axis::Z, Axis::X, Axis::Y][..axes].to_vec(),
                angles: Array2::from_shape_fn((120, axes), |(t, c)| angle(kept(t), c)),
            }
        };
        (0..count).map(joint).collect()
    }

    #[test]
    fn a_leap_out_of_a_limit_ends_a_held_rotation() {
        // The hold begins at the largest angle of the take.
        let held = held_rotations(&swinging(1, 8, 1, 22..43), 60.0);
        let frames: Vec<Range<usize>> = held.into_iter().map(|h| h.frames).collect();
        assert!(frames.len() == 1 && frames[0] == (22..43), "{frames:?}");
    }

    #[test]
    fn rotations_that_stand_still_beside_moving_ones_are_found_once() {
        let held = held_rotations(&swinging(3, 8, 2, 40..61), 60.0);
        assert_eq!(
            held,
            [HeldRotations {
                joints: vec![0, 1],
                frames: 40..61
            }]
        );
        let found = held_findings(&swinging(3, 8, 2, 40..61), Some(60.0));
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].kind, found[0].frames),
            (FindingKind::Held, Some([40, 61]))
        );
        assert!(
            found[0]
                .what
                .starts_with("j0, j1 stand still in frames 40 to 60"),
            "{found:?}"
        );
        assert_eq!(held_findings(&swinging(3, 8, 2, 40..61), None), []);
        assert_eq!(held_rotations(&swinging(1, 8, 1, 40..61), 60.0).len(), 1);
    }

    #[test]
    fn pauses_rests_and_short_stops_are_not_held() {
        // A fifth of a second; the whole body; a joint that mostly rests; nothing moves; missing
        // values.
        assert_eq!(held_rotations(&swinging(3, 8, 1, 40..52), 60.0), []);
        assert_eq!(held_rotations(&swinging(3, 8, 8, 40..70), 60.0), []);
        assert_eq!(held_rotations(&swinging(3, 8, 1, 20..90), 60.0), []);
        // A third of a short take is.
        assert_eq!(held_rotations(&swinging(3, 8, 1, 40..80), 60.0).len(), 1);
        let mut still = swinging(3, 8, 1, 40..61);
        still.iter_mut().for_each(|j| j.angles.fill(0.5));
        assert_eq!(held_rotations(&still, 60.0), []);
        let mut missing = swinging(3, 8, 0, 0..0);
        missing[0]
            .angles
            .slice_mut(ndarray::s![40..61, ..])
            .fill(f64::NAN);
        assert_eq!(held_rotations(&missing, 60.0), []);
        assert_eq!(held_rotations(&[], 60.0), []);
    }

    #[test]
    fn a_joint_at_its_limit_is_not_held() {
        let mut joints = swinging(1, 8, 0, 0..0);
        joints[0].angles.mapv_inplace(|a| a.max(-0.3));
        assert_eq!(held_rotations(&joints, 60.0), []);
        // Written as a ball joint whose angles follow from that of the hinge.
        let hinge = joints[0].angles.column(0).to_owned();
        joints[0].axes = vec![Axis::Z, Axis::X, Axis::Y];
        joints[0].angles = Array2::from_shape_fn((120, 3), |(t, c)| [0.9, -0.4, 0.2][c] * hinge[t]);
        assert_eq!(held_rotations(&joints, 60.0), []);
    }
}
