//! A posture found bone by bone from the root outwards, in closed form: where the solver of P2
//! starts.
//!
//! Each bone turns so that the joints it carries rigidly come as near as they can to where they are
//! wanted, given the bones above it. A ball joint with one such joint is free to twist: it takes
//! the twist that brings the next joints nearest, as far as they are bent enough to tell, and else
//! keeps the twist of the frame before: a neck that nods through straight must not spin. For
//! skeletons of ball joints alone, whose bones have their lengths (Algorithm 1), this is the
//! solution.

use super::tuning::{bones::*, initial_pose::*};
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{Axis, decompose, nearest_equivalent_angle, shortest_arc};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::{Channel, Skeleton};
use glam::{DMat3, DVec3};

/// A joint that a bone carries: the target and its position from the bone's start in the rest
/// posture.
type Carried = (usize, DVec3);

/// The targets that each bone carries, found once for a skeleton and its targets.
pub struct InitialPose<'a> {
    skeleton: &'a Skeleton,
    /// Targets that turn with each bone.
    direct: Vec<Vec<Carried>>,
    /// Targets that turn with the next turning bones below each bone.
    indirect: Vec<Vec<Carried>>,
}

impl<'a> InitialPose<'a> {
    /// `joints[t]` is the bone whose end is target t.
    pub fn new(skeleton: &'a Skeleton, joints: &[usize]) -> InitialPose<'a> {
        let bones = skeleton.bones();
        let rest: Vec<f64> = bones
            .iter()
            .flat_map(|b| &b.dofs)
            .map(|d| -d.offset)
            .collect();
        let rest = skeleton.posture(&rest);
        let (mut direct, mut indirect) =
            (vec![Vec::new(); bones.len()], vec![Vec::new(); bones.len()]);
        for (t, &joint) in joints.iter().enumerate() {
            let carried = |bone: usize| (t, rest.ends[joint] - rest.starts[bone]);
            let (mut at, mut seen) = (Some(joint), 0);
            while let Some(bone) = at {
                if !bones[bone].dofs.is_empty() {
                    match seen {
                        0 => direct[bone].push(carried(bone)),
                        _ => indirect[bone].push(carried(bone)),
                    }
                    // A bone that does not move its own joint is no step on the way to the next.
                    seen += usize::from(carried(bone).1.length() > NO_LENGTH);
                    if seen == 2 {
                        break;
                    }
                }
                at = bones[bone].parent;
            }
        }
        InitialPose {
            skeleton,
            direct,
            indirect,
        }
    }

    /// Sets `q`, which holds the values of the frame before; bones without targets keep theirs.
    /// `targets`: (3 T), NaN is missing.
    pub fn apply(&self, targets: &[f64], q: &mut [f64]) {
        let mut posture = Posture::default();
        for (i, bone) in self.skeleton.bones().iter().enumerate() {
            let (before, above) = match bone.parent {
                Some(p) => (posture.rotations[p], posture.ends[p]),
                None => (DMat3::IDENTITY, DVec3::ZERO),
            };
            let seen = |carried: &[Carried]| -> Vec<(DVec3, DVec3)> {
                carried
                    .iter()
                    .map(|&(t, v)| (v, DVec3::from_slice(&targets[3 * t..3 * t + 3])))
                    .filter(|(_, y)| y.is_finite())
                    .collect()
            };
            let (direct, indirect) = (seen(&self.direct[i]), seen(&self.indirect[i]));
            let q = &mut q[self.skeleton.dofs_of(i)];
            if i == 0 {
                self.set_root(&direct, &indirect, q);
            }
            let (start, held) = self.local(i, q, before, above);
            let arms = |pairs: &[(DVec3, DVec3)]| -> Vec<(DVec3, DVec3)> {
                pairs
                    .iter()
                    .map(|&(v, y)| (v, y - start))
                    .filter(|(v, y)| v.length() > NO_LENGTH && y.length() > NO_LENGTH)
                    .collect()
            };
            let (direct_arms, indirect_arms) = (arms(&direct), arms(&indirect));
            match bone.ball_axes() {
                // Hidden joints: the bone holds its values unless it carries none by its nature.
                Some(_) if direct_arms.is_empty() && !self.has_no_lever(i) => {}
                Some(order) => {
                    if let Some(global) =
                        ball_rotation(&direct_arms, &indirect_arms, &before, &held)
                    {
                        self.set_ball_joint(i, order, &before, &global, q);
                    }
                }
                None => self.set_hinges(i, &direct_arms, &before, q),
            }
            let (start, rotation) = self.local(i, q, before, above);
            posture.starts.push(start);
            posture
                .ends
                .push(start + rotation * self.current_offset(i, q));
            posture.rotations.push(rotation);
        }
    }

    fn has_no_lever(&self, bone: usize) -> bool {
        self.direct[bone]
            .iter()
            .all(|(_, v)| v.length() <= NO_LENGTH)
    }

    /// The bone's vector with its `l`, in rest axes.
    fn current_offset(&self, i: usize, q: &[f64]) -> DVec3 {
        let bone = &self.skeleton.bones()[i];
        let along = bone.offset.try_normalize().unwrap_or(DVec3::ZERO);
        let longer: f64 = (bone.dofs.iter().zip(q))
            .filter(|(d, _)| d.channel == Channel::Length)
            .map(|(d, q)| q + d.offset)
            .sum();
        bone.offset + along * longer
    }

    /// Where bone `i` starts and how it is turned, for its own values `q`, given what stands above
    /// it.
    fn local(&self, i: usize, q: &[f64], before: DMat3, start: DVec3) -> (DVec3, DMat3) {
        let bone = &self.skeleton.bones()[i];
        let (mut turn, mut shift) = (DMat3::IDENTITY, DVec3::ZERO);
        for (dof, &value) in bone.dofs.iter().zip(q) {
            match dof.channel {
                Channel::Rotate(axis) => turn = axis.rotation(value + dof.offset) * turn,
                Channel::Translate(axis) => shift += axis.unit() * (value + dof.offset),
                Channel::Length => {}
            }
        }
        let rotation = before * bone.axis * turn * bone.axis.transpose();
        (start + before * (bone.axis * shift), rotation)
    }

    /// The root's position: its own joint where it is seen, else by what it carries.
    fn set_root(&self, direct: &[(DVec3, DVec3)], indirect: &[(DVec3, DVec3)], q: &mut [f64]) {
        let bone = &self.skeleton.bones()[0];
        let own = direct.iter().find(|(v, _)| v.length() <= NO_LENGTH);
        let fit = |pairs: &mut dyn Iterator<Item = (DVec3, DVec3)>| {
            let pairs: Vec<_> = pairs.map(|(v, y)| (v, y, 1.0)).collect();
            fit_similarity(pairs.iter().copied(), TransformKind::Rigid)
                .filter(|f| f.determined)
                .map(|f| f.similarity.shift)
        };
        let position = own
            .map(|&(_, y)| y)
            .or_else(|| fit(&mut direct.iter().copied()))
            .or_else(|| fit(&mut direct.iter().chain(indirect).copied()));
        let Some(position) = position else { return };
        let position = bone.axis.transpose() * position;
        for (dof, q) in bone.dofs.iter().zip(q) {
            if let Channel::Translate(axis) = dof.channel {
                *q = position[axis.index()] - dof.offset;
            }
        }
    }

    /// The angles of a ball joint for its global rotation, the nearest to the ones before.
    fn set_ball_joint(
        &self,
        i: usize,
        order: [Axis; 3],
        before: &DMat3,
        global: &DMat3,
        q: &mut [f64],
    ) {
        let bone = &self.skeleton.bones()[i];
        let own = bone.axis.transpose() * before.transpose() * *global * bone.axis;
        let at: Vec<usize> = (0..bone.dofs.len())
            .filter(|&n| bone.dofs[n].channel.is_angle())
            .collect();
        // The first named turns first; decompose names the last one first.
        let [first, second, third] = [at[0], at[1], at[2]];
        let near = [third, second, first].map(|n| q[n] + bone.dofs[n].offset);
        let angles = decompose(&own, [order[2], order[1], order[0]], near);
        for (n, angle) in [third, second, first].into_iter().zip(angles) {
            q[n] = angle - bone.dofs[n].offset;
        }
    }

    /// One or two hinges: each in turn takes the angle that is best while the other stays, a few
    /// times over.
    fn set_hinges(&self, i: usize, arms: &[(DVec3, DVec3)], before: &DMat3, q: &mut [f64]) {
        let bone = &self.skeleton.bones()[i];
        if arms.is_empty() {
            return;
        }
        for _ in 0..20 {
            for n in 0..bone.dofs.len() {
                let Channel::Rotate(axis) = bone.dofs[n].channel else {
                    continue;
                };
                // R = outer · R_n · inner: the rotations named before this one turn first.
                let (mut inner, mut outer) = (DMat3::IDENTITY, DMat3::IDENTITY);
                for (m, (dof, &value)) in bone.dofs.iter().zip(q.iter()).enumerate() {
                    if let Channel::Rotate(a) = dof.channel {
                        let turn = a.rotation(value + dof.offset);
                        match m.cmp(&n) {
                            std::cmp::Ordering::Less => inner = turn * inner,
                            std::cmp::Ordering::Greater => outer = turn * outer,
                            std::cmp::Ordering::Equal => {}
                        }
                    }
                }
                let inner = inner * bone.axis.transpose();
                let outer = *before * bone.axis * outer;
                let mut twist = Twist::default();
                for &(v, y) in arms {
                    twist.add(axis.unit(), inner * v, outer.transpose() * y, 1.0);
                }
                if let Some(angle) = twist.angle() {
                    q[n] = nearest_equivalent_angle(angle - bone.dofs[n].offset, q[n]);
                }
            }
        }
    }
}

/// The global rotation of a ball joint that carries `direct` arms to where they are seen, and
/// `indirect` ones near it. Without a turn of its own it would stand as its parent does, `before`;
/// with the values of the frame before it would stand as `held`.
fn ball_rotation(
    direct: &[(DVec3, DVec3)],
    indirect: &[(DVec3, DVec3)],
    before: &DMat3,
    held: &DMat3,
) -> Option<DMat3> {
    let fit = |pairs: &[(DVec3, DVec3)]| {
        fit_similarity(
            pairs.iter().map(|&(v, y)| (v, y, 1.0)),
            TransformKind::Rotation,
        )
        .filter(|f| f.determined)
        .map(|f| f.similarity.rotation)
    };
    let main = if direct.is_empty() { indirect } else { direct };
    if let Some(rotation) = fit(main) {
        return Some(rotation);
    }
    let &(v, y) = main
        .iter()
        .max_by(|a, b| a.0.length_squared().total_cmp(&b.0.length_squared()))?;
    // The shortest way from where the bone stood, then a twist about itself.
    let rotation = shortest_arc(*held * v, y)? * *held;
    if direct.is_empty() {
        return Some(rotation);
    }
    let axis = y.normalize();
    let mut twist = Twist::default();
    for &(s, seen) in indirect {
        // What lies beyond the bone's end, seen from there.
        twist.add(axis, rotation * (s - v), seen - y, 1.0);
    }
    let aside = rotation * (v.normalize().any_orthonormal_vector() * v.length());
    twist.add(axis, aside, aside, TWIST_HELD);
    if let Some(arc) = shortest_arc(*before * v, y) {
        let rest = arc * *before * (rotation.transpose() * aside);
        twist.add(axis, aside, rest, TWIST_REST);
    }
    Some(DMat3::from_axis_angle(axis, twist.angle().unwrap_or(0.0)) * rotation)
}

/// The angle about an axis that carries vectors nearest to others.
#[derive(Default)]
struct Twist {
    sin: f64,
    cos: f64,
}

impl Twist {
    /// Adds the wish for the turn about `axis` that carries `a` to `b`.
    fn add(&mut self, axis: DVec3, a: DVec3, b: DVec3, weight: f64) {
        self.cos += weight * (b.dot(a) - b.dot(axis) * a.dot(axis));
        self.sin += weight * b.dot(axis.cross(a));
    }

    /// Radians; `None` where nothing tells.
    fn angle(&self) -> Option<f64> {
        (self.sin.hypot(self.cos) > 1e-12).then(|| self.sin.atan2(self.cos))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::{Bone, Dof};

    /// A trunk that forks, all ball joints: 0 root, 1 trunk, 2 and 3 arms on it, 4 a hand on 3, 5 a
    /// leg on the root.
    fn body() -> Skeleton {
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let ball = axes.map(Channel::Rotate).to_vec();
        let slide = axes.map(Channel::Translate).to_vec();
        let bone = |name: &str, parent, offset: [f64; 3], channels: Vec<Channel>| Bone {
            name: name.into(),
            parent,
            offset: DVec3::from_array(offset),
            axis: DMat3::from_rotation_x(0.3) * DMat3::from_rotation_z(0.2 * offset[0]),
            dofs: channels.into_iter().map(Dof::free).collect(),
        };
        Skeleton::new(vec![
            bone("root", None, [0., 0., 0.], [slide, ball.clone()].concat()),
            bone("trunk", Some(0), [0., 30., 1.], ball.clone()),
            bone("left", Some(1), [20., 2., 0.], ball.clone()),
            bone("right", Some(1), [-20., 3., 0.], ball.clone()),
            bone("hand", Some(3), [-9., 0., 0.], ball.clone()),
            bone("leg", Some(0), [5., -40., 0.], ball),
        ])
        .unwrap()
    }

    #[test]
    fn ball_joints_are_solved_exactly() {
        let s = body();
        let joints = [0, 1, 2, 3, 4, 5];
        let initial_pose = InitialPose::new(&s, &joints);
        for round in 0..50 {
            let q: Vec<f64> = (0..s.dof_count())
                .map(|i| 3.0 * ((1 + i + 31 * round) as f64 * 1.7).sin())
                .collect();
            let want = s.posture(&q).ends;
            let targets: Vec<f64> = want.iter().flat_map(|e| e.to_array()).collect();
            let mut found = vec![0.0; q.len()];
            initial_pose.apply(&targets, &mut found);
            for (a, b) in s.posture(&found).ends.iter().zip(&want) {
                assert!((*a - *b).length() <= 1e-9, "{round}: {a} {b}");
            }
        }
    }
}
