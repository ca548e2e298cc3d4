//! The distance that game engines ship to choose the next frame of a character (motion matching; S.
//! Clavel: Motion Matching and the Road to Next-Gen Animation, GDC 2016): positions and velocities
//! of feet and hands, the hip's velocity, and where the character will be and face a third, two
//! thirds and one second later.
//!
//! Weights are by hand: 1 for each group of numbers, and each group is scaled by its spread over
//! the poses at hand.

use super::body_frame::BodyFramePoses;
use super::joint_map::{JOINTS, joint};
use glam::{DVec2, DVec3};

/// Hands and feet.
const ENDS: [usize; 4] = [joint::LHAND, joint::RHAND, joint::LFOOT, joint::RFOOT];
/// How far ahead the trajectory is looked at, seconds.
const AHEAD: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];

/// The groups of features that are scaled together: their widths.
pub(super) const GROUPS: [usize; 5] = [12, 12, 3, 6, 6];

/// The names of the features.
pub(super) fn names() -> Vec<String> {
    let axes = |name: String, axes: &'static str| {
        axes.chars()
            .map(move |a| format!("{name}{a}"))
            .collect::<Vec<_>>()
    };
    let ends = |order: &'static str| {
        ENDS.iter()
            .flat_map(move |j| axes(format!("game({})_{order}", JOINTS[*j]), "xyz"))
    };
    let ahead = |what: &'static str| {
        (1..=AHEAD.len()).flat_map(move |k| axes(format!("game({what}{k})_"), "xz"))
    };
    ends("")
        .chain(ends("v"))
        .chain(axes("game(Hip)_v".into(), "xyz"))
        .chain(ahead("Place"))
        .chain(ahead("Facing"))
        .collect()
}

/// Appends the features of frame `t`, in the body's frame; lengths in body heights, times in
/// seconds. NaN without a rate.
pub(super) fn describe_frame(poses: &BodyFramePoses, t: usize, out: &mut Vec<f32>) {
    let Some(rate) = poses.rate else {
        out.extend(vec![f32::NAN; GROUPS.iter().sum()]);
        return;
    };
    let run = poses.run_of(t);
    let (before, after) = (t.saturating_sub(1).max(run.start), (t + 1).min(run.end - 1));
    let seconds = ((after - before) as f64 / rate).max(f64::MIN_POSITIVE);
    let mut push = |v: DVec3| out.extend([v.x as f32, v.y as f32, v.z as f32]);
    let frame = poses.frame(t);
    ENDS.iter().for_each(|j| push(frame[*j]));
    let (earlier, later) = (poses.frame(before), poses.frame(after));
    (ENDS.iter()).for_each(|j| push((later[*j] - earlier[*j]) / seconds));
    let turn = DVec2::from_angle(poses.yaw[t]);
    // The world's ground (x, z) as the body sees it.
    let local = |v: DVec2| DVec2::new(turn.x * v.x - turn.y * v.y, turn.y * v.x + turn.x * v.y);
    let position = |t: usize| DVec2::from_array(poses.place[t]);
    let moved = local(position(after) - position(before)) / seconds;
    let rise = (poses.hip_height[after] - poses.hip_height[before]) / seconds;
    push(DVec3::new(moved.x, rise, moved.y));
    let ahead = AHEAD.map(|s| (t + (s * rate).round() as usize).min(run.end - 1));
    for at in ahead {
        let to = local(position(at) - position(t));
        out.extend([to.x as f32, to.y as f32]);
    }
    for at in ahead {
        let (sin, cos) = (poses.yaw[at] - poses.yaw[t]).sin_cos();
        out.extend([sin as f32, cos as f32]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::{own_names, standing, take_of};

    #[test]
    fn a_walk_ahead_is_seen_from_the_body_whatever_its_heading() {
        let turn = glam::DQuat::from_rotation_y(1.1);
        let walk = |turned: bool| {
            let frames: Vec<[DVec3; 16]> = (0..15)
                .map(|t| {
                    standing().map(|p| {
                        let p = p + DVec3::new(0.0, 0.0, 16.0 * t as f64);
                        if turned { turn * p } else { p }
                    })
                })
                .collect();
            let poses = BodyFramePoses::new(&take_of(&frames), Some(10.0), &own_names()).unwrap();
            let mut out = Vec::new();
            describe_frame(&poses, 2, &mut out);
            out
        };
        let (a, b) = (walk(false), walk(true));
        assert_eq!(a.len(), names().len());
        assert_eq!(a.len(), GROUPS.iter().sum::<usize>());
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-5));
        let value = |name: &str| a[names().iter().position(|n| n == name).unwrap()];
        // .1 body heights a frame: one a second ahead, which is z.
        assert!((value("game(Hip)_vz") - 1.0).abs() < 1e-5);
        assert!((value("game(Place3)_z") - 1.0).abs() < 1e-5);
        assert!((value("game(Facing3)_z") - 1.0).abs() < 1e-5);
    }
}
