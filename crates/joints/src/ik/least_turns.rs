//! The rotations of a frame whose joints are where positions say, by the least turns from others:
//! a bone turns as little as it has to, so that its twist is that of the others.

use crate::io::Bvh;
use crate::pose::rotation::{Axis, decompose, shortest_arc, three_axes};
use crate::pose::similarity::nearest_rotation;
use crate::pose::{Channel, JointChannels};
use glam::{DMat3, DVec3};

/// Shorter offsets say nothing of a rotation, cm.
const SHORT: f64 = 0.1;

/// Turns the channels of a frame (radians and centimeters) so that each joint points to its
/// children: `at` has the position of each joint, cm, in the file's axes; `None` where it is not
/// known. Joints with fewer than three angles stay as they are.
pub(super) fn turn_to(
    bvh: &Bvh,
    channels: &[JointChannels],
    at: &[Option<DVec3>],
    frame: &mut [f64],
) {
    let mut global = vec![DMat3::IDENTITY; bvh.joints.len()];
    let mut place = vec![DVec3::ZERO; bvh.joints.len()];
    for (j, joint) in bvh.joints.iter().enumerate() {
        let own = &channels[j];
        let parent = joint.parent.map(|p| (global[p], place[p]));
        let turned = parent.map_or(DMat3::IDENTITY, |p| p.0);
        let has_position = !own.positions.is_empty();
        if let (None, true, Some(at)) = (parent, has_position, at[j]) {
            (own.positions.iter()).for_each(|(c, axis)| frame[*c] = at[axis.index()]);
        }
        let mut offset = joint.offset;
        (own.positions.iter()).for_each(|(c, axis)| offset[axis.index()] = frame[*c]);
        place[j] = parent.map_or(offset, |(turned, place)| place + turned * offset);
        let rotation = |frame: &[f64]| {
            let turn = |r: DMat3, (c, axis): &(usize, Axis)| r * axis.rotation(frame[*c]);
            own.angles.iter().fold(DMat3::IDENTITY, turn)
        };
        let mut to = turned * rotation(frame);
        if let Some(least) = least_turn(bvh, j, to, at, at[j].unwrap_or(place[j])) {
            to = least * to;
            let order = three_axes(own.angles.iter().map(|a| a.1));
            if let (Some(order), [a, b, c]) = (order, &own.angles[..]) {
                let near = [a.0, b.0, c.0].map(|channel| frame[channel]);
                let found = decompose(&(turned.transpose() * to), order, near);
                for (channel, angle) in [a.0, b.0, c.0].into_iter().zip(found) {
                    frame[channel] = angle;
                }
            }
            to = turned * rotation(frame);
        }
        global[j] = to;
    }
}

/// The least turn of a joint with a global rotation that carries its children to where they are.
fn least_turn(
    bvh: &Bvh,
    joint: usize,
    rotation: DMat3,
    at: &[Option<DVec3>],
    place: DVec3,
) -> Option<DMat3> {
    let children = bvh.joints.iter().enumerate();
    let ways: Vec<(DVec3, DVec3)> = children
        .filter(|(_, child)| child.parent == Some(joint) && child.offset.length() > SHORT)
        .filter(|(_, child)| {
            !child
                .channels
                .iter()
                .any(|c| matches!(c, Channel::Translate(_)))
        })
        .filter_map(|(c, child)| Some((rotation * child.offset, at[c]? - place)))
        .collect();
    if let [(from, to)] = ways[..] {
        return shortest_arc(from, to);
    }
    let outer = |m: DMat3, (from, to): &(DVec3, DVec3)| {
        m + DMat3::from_cols(*from * to.x, *from * to.y, *from * to.z)
    };
    let sum = ways.iter().fold(DMat3::ZERO, outer);
    let (turn, _, is_unique) = nearest_rotation(&sum);
    (ways.len() > 1 && is_unique).then_some(turn)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frame that is posed.
    const AT: usize = 1;

    #[test]
    fn joints_point_where_they_should_and_keep_their_twist() {
        let bytes = std::fs::read("../../testdata/examples/animator/goblin.bvh").unwrap();
        let mut bvh = Bvh::from_bytes("goblin", bytes).unwrap();
        let rest = bvh.motion.row(0).to_vec();
        let channels = JointChannels::all(
            bvh.joints
                .iter()
                .map(|j| (j.name.clone(), j.channels.clone())),
        );
        let mut pose = rest.clone();
        for (c, _) in channels.iter().flat_map(|j| &j.angles) {
            pose[*c] += 0.3 * (*c as f64).sin();
        }
        let both = rest.iter().copied().chain(pose).collect();
        bvh.motion = ndarray::Array2::from_shape_vec((2, rest.len()), both).unwrap();
        let rig = crate::io::bvh::BvhSkeleton::new(&bvh.joints, DMat3::IDENTITY, true).unwrap();
        let poses = bvh.positions(&rig, crate::io::bvh::BvhPoints::Origins, 30.0);
        let at: Vec<Option<DVec3>> = (bvh.joints.iter())
            .map(|j| {
                let p = poses.points.iter().position(|n| *n == j.name)?;
                Some(crate::pose::point_at(poses.xyz.view(), AT, p))
            })
            .collect();
        // From the rotations of another frame, and back from its own.
        let truth = bvh.motion.row(AT).to_vec();
        let mut same = truth.clone();
        turn_to(&bvh, &channels, &at, &mut same);
        let far = |a: &[f64], b: &[f64]| {
            (a.iter().zip(b)).fold(0.0f64, |far, (a, b)| far.max((a - b).abs()))
        };
        assert!(far(&same, &truth) < 1e-4, "{}", far(&same, &truth));
        let mut other = rest;
        turn_to(&bvh, &channels, &at, &mut other);
        let mut moved = bvh.clone();
        moved.motion = ndarray::Array2::from_shape_vec((1, other.len()), other).unwrap();
        let found = moved.positions(&rig, crate::io::bvh::BvhPoints::Origins, 30.0);
        // Nothing says where the End Sites are.
        for (p, _) in (poses.points.iter().enumerate()).filter(|(_, n)| !n.ends_with("_end")) {
            let [found, truth] = [(&found, 0), (&poses, AT)]
                .map(|(poses, t)| crate::pose::point_at(poses.xyz.view(), t, p));
            assert!(found.distance(truth) < 1e-6);
        }
    }
}
