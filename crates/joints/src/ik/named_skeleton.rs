//! A skeleton from any points that a map of names knows: SMPL's, OpenPose's, MediaPipe's, Mixamo's.
//!
//! Joints stand at the points and have their names; the rest pose is a T-pose, y up, the left side
//! at +x, facing +z, with bones as long as in the median frame. Where the names have no root it is
//! a joint `hips` in the middle of the hips; where they have no spine, one bone `Spine` goes to the
//! neck, or to the middle of the shoulders, and `LeftCollar` and `RightCollar` from there. Every
//! last bone ends in an End Site.

use super::skeleton_estimation::median_position;
use super::tuning::named_skeleton::*;
use crate::io::Bvh;
use crate::io::bvh::{BvhTemplate, EndSite, Joint};
use crate::numeric::statistics::median;
use crate::pose::joints::rest_pelvis;
use crate::pose::rotation::{Axis, frame_along};
use crate::pose::{Channel, NameMap, Poses, point_at};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::{Array2, concatenate};

/// A skeleton from the points of a take.
#[derive(Debug, Clone)]
pub struct NamedSkeleton {
    /// The take, with points in the middle of others that the skeleton goes by, at its end.
    pub poses: Poses,
    /// The columns of the others, for each such point.
    middles: Vec<Vec<usize>>,
    /// The skeleton.
    pub template: BvhTemplate,
}

/// Measures the skeleton of a take whose points `map` names. `order` is that of its rotation
/// channels, the last turning first.
///
/// # Errors
/// [`Error::Usage`]: a hip, knee, ankle, shoulder, elbow or wrist is missing, or no frame shows
/// them.
pub fn named_skeleton(poses: &Poses, map: &NameMap, order: [Axis; 3]) -> Result<NamedSkeleton> {
    let points = BodyPoints::find(poses, map)?;
    let mut builder = Builder::new(poses, &points)?;
    builder.add_root();
    let chest = builder.add_spine();
    for side in [0, 1] {
        builder.add_leg(side);
    }
    builder.add_neck(chest);
    for side in [0, 1] {
        builder.add_arm(side, chest);
    }
    let joints = builder.depth_first(order);
    let bvh = Bvh {
        motion: Array2::zeros((0, joints.iter().map(|j| j.channels.len()).sum())),
        joints,
        frame_time: 0.0,
        notes: Vec::new(),
    };
    Ok(NamedSkeleton {
        middles: builder.middles.iter().map(|m| m.1.clone()).collect(),
        poses: builder.with_middles(),
        template: BvhTemplate::new(bvh, DMat3::IDENTITY)?,
    })
}

impl NamedSkeleton {
    /// Deviations (frames, points) with those of points in the middle of others, which are as sure
    /// as the least sure of these.
    pub fn with_middles(&self, sd: &Array2<f64>) -> Array2<f64> {
        let (frames, points) = sd.dim();
        Array2::from_shape_fn((frames, points + self.middles.len()), |(t, p)| {
            match p.checked_sub(points) {
                None => sd[[t, p]],
                Some(n) => (self.middles[n].iter()).fold(f64::NAN, |z, &c| z.max(sd[[t, c]])),
            }
        })
    }
}

/// A point of the body: a column of the table, or the middle of several.
type BodyPoint = Vec<usize>;

/// The columns of a body's points; of sides, left and right.
struct BodyPoints {
    root: Option<usize>,
    hips: [usize; 2],
    knees: [usize; 2],
    ankles: [usize; 2],
    toes: [Option<usize>; 2],
    spine: Vec<usize>,
    neck: Option<BodyPoint>,
    head: Option<BodyPoint>,
    collars: [Option<usize>; 2],
    shoulders: [usize; 2],
    elbows: [usize; 2],
    wrists: [usize; 2],
    hands: [Option<usize>; 2],
}

impl BodyPoints {
    fn find(poses: &Poses, map: &NameMap) -> Result<BodyPoints> {
        let columns = map.columns(&poses.points);
        let find = |name: &str| columns.get(name).copied();
        let sides = |name: &str| ["l", "r"].map(|side| find(&format!("{side}{name}")));
        let needed = |name: &str| {
            let [Some(left), Some(right)] = sides(name) else {
                let missing = map.missing(&poses.points).join(", ");
                let what = format!(
                    "no skeleton without both {name}s: the map {} misses {missing}",
                    map.name
                );
                return Err(Error::usage(what));
            };
            Ok([left, right])
        };
        let bones = |name: &str| map.bone_columns(name, &poses.points);
        let middle = |name: &str| bones(name).into_iter().next();
        let one = |point: BodyPoint| point.first().copied().filter(|_| point.len() == 1);
        let collars = bones("Collars");
        let collar = |side: usize| collars.get(side).cloned().and_then(one);
        Ok(BodyPoints {
            root: find("root"),
            hips: needed("hipjoint")?,
            knees: needed("femur")?,
            ankles: needed("tibia")?,
            toes: sides("foot"),
            spine: bones("Spine").into_iter().filter_map(one).collect(),
            neck: middle("Neck"),
            head: middle("Skull").or_else(|| middle("Head")),
            collars: [collar(0), collar(1)],
            shoulders: needed("clavicle")?,
            elbows: needed("humerus")?,
            wrists: needed("radius")?,
            hands: sides("wrist"),
        })
    }
}

/// A joint of the skeleton to be.
struct NewJoint {
    name: String,
    parent: Option<usize>,
    /// From the root, cm.
    rest: DVec3,
    /// From the joint, cm.
    end: Option<DVec3>,
}

struct Builder<'a> {
    poses: &'a Poses,
    points: &'a BodyPoints,
    /// The mean length of the legs, cm.
    leg: f64,
    joints: Vec<NewJoint>,
    /// Points in the middle of others, with their names.
    middles: Vec<(String, BodyPoint)>,
}

/// +1 of the left side, -1 of the right.
fn outward(side: usize) -> f64 {
    if side == 0 { 1.0 } else { -1.0 }
}

impl<'a> Builder<'a> {
    fn new(poses: &'a Poses, points: &'a BodyPoints) -> Result<Builder<'a>> {
        let mut builder = Builder {
            poses,
            points,
            leg: 0.0,
            joints: Vec::new(),
            middles: Vec::new(),
        };
        let p = points;
        let part = |a: usize, b: usize| builder.length(&vec![a], &vec![b]);
        let leg = |s: usize| Some(part(p.hips[s], p.knees[s])? + part(p.knees[s], p.ankles[s])?);
        let legs: Vec<f64> = [0, 1].into_iter().filter_map(leg).collect();
        let mean = legs.iter().sum::<f64>() / legs.len() as f64;
        if !(mean > 0.0) {
            let what = "no frame shows a whole leg, whose length stands in for others";
            return Err(Error::usage(what));
        }
        builder.leg = mean;
        Ok(builder)
    }

    /// Where a point of the body is in a frame, cm; NaN where a point of it is missing.
    fn at(&self, frame: usize, body_point: &BodyPoint) -> DVec3 {
        let at = |&p: &usize| point_at(self.poses.xyz.view(), frame, p);
        let sum = body_point.iter().map(at).sum::<DVec3>();
        sum / body_point.len() as f64
    }

    /// The median distance of two points, cm; `None` where no frame has both.
    fn length(&self, a: &BodyPoint, b: &BodyPoint) -> Option<f64> {
        let apart = (0..self.poses.frames()).map(|t| self.at(t, a).distance(self.at(t, b)));
        median(apart.filter(|d| d.is_finite()).collect())
    }

    /// The median distance of two points, else a share of the leg, cm.
    fn long(&self, a: &BodyPoint, b: &BodyPoint, share: f64) -> f64 {
        self.length(a, b).unwrap_or(share * self.leg)
    }

    /// Where a point is in the axes of a frame that two pairs of points span (x, then y), from an
    /// origin: medians, cm.
    fn within(
        &self,
        body_point: &BodyPoint,
        origin: &BodyPoint,
        x: [&BodyPoint; 2],
        y: [&BodyPoint; 2],
    ) -> Option<DVec3> {
        let frames = (0..self.poses.frames()).filter_map(|t| {
            let [a, b, c, d] = [x[0], x[1], y[0], y[1]].map(|p| self.at(t, p));
            let frame = frame_along(b - a, d - c)?;
            Some(frame.transpose() * (self.at(t, body_point) - self.at(t, origin)))
        });
        median_position(frames)
    }

    fn push(&mut self, name: String, parent: Option<usize>, rest: DVec3) -> usize {
        self.joints.push(NewJoint {
            name,
            parent,
            rest,
            end: None,
        });
        self.joints.len() - 1
    }

    fn push_point(&mut self, point: usize, parent: usize, rest: DVec3) -> usize {
        self.push(self.poses.points[point].clone(), Some(parent), rest)
    }

    /// A name that no point and no joint has.
    fn new_name(&self, name: &str) -> String {
        let is_taken =
            |n: &String| self.poses.points.contains(n) || self.joints.iter().any(|j| j.name == *n);
        let numbered = (2..).map(|n| format!("{name}{n}"));
        let mut names = std::iter::once(name.to_string()).chain(numbered);
        names.find(|n| !is_taken(n)).unwrap_or_default()
    }

    /// The joint at a point of the body: of a point, or new, with a point of its own in the middle
    /// of others.
    fn push_joint(
        &mut self,
        body_point: &BodyPoint,
        name: &str,
        parent: usize,
        rest: DVec3,
    ) -> usize {
        if let [point] = body_point[..] {
            return self.push_point(point, parent, rest);
        }
        let name = self.new_name(name);
        self.middles.push((name.clone(), body_point.clone()));
        self.push(name, Some(parent), rest)
    }

    fn hips(&self) -> BodyPoint {
        self.points.hips.to_vec()
    }

    /// The root's own point.
    fn root_point(&self) -> BodyPoint {
        self.points.root.map_or(self.hips(), |root| vec![root])
    }

    fn neck_point(&self) -> BodyPoint {
        let shoulders = self.points.shoulders.to_vec();
        self.points.neck.clone().unwrap_or(shoulders)
    }

    fn add_root(&mut self) {
        let name = match self.points.root {
            Some(root) => self.poses.points[root].clone(),
            None => self.new_name("hips"),
        };
        self.push(name, None, DVec3::ZERO);
    }

    /// The position of a point that is rigid with the pelvis, in the rest pose.
    fn on_pelvis(&self, body_point: &BodyPoint) -> Option<DVec3> {
        let root = self.root_point();
        let hips = self.hips();
        let [left, right] = self.points.hips.map(|p| vec![p]);
        let x = [&right, &left];
        // The root above the hips tells how the pelvis is tilted, as it does in CMU's rest pose.
        if self.has_tilt() {
            return Some(rest_pelvis() * self.within(body_point, &root, x, [&hips, &root])?);
        }
        self.within(body_point, &root, x, [&hips, &self.neck_point()])
    }

    /// Whether the root stands off the middle of the hips: in the median, so that noise tells none.
    fn has_tilt(&self) -> bool {
        let hips = self.hips();
        let [left, right] = self.points.hips.map(|p| vec![p]);
        let up = [&hips, &self.neck_point()];
        let at = self.within(&self.root_point(), &hips, [&right, &left], up);
        at.is_some_and(|at| at.length() > LEAST_TILT * self.leg)
    }

    /// The spine; gives the joint that carries neck and arms.
    fn add_spine(&mut self) -> usize {
        let mut last = 0;
        let mut below = self.root_point();
        for &point in &self.points.spine {
            let body_point = vec![point];
            let up = self.long(&below, &body_point, SPINE);
            let rest = match last {
                0 => self.on_pelvis(&body_point).unwrap_or(DVec3::Y * up),
                _ => self.joints[last].rest + DVec3::Y * up,
            };
            last = self.push_point(point, last, rest);
            below = body_point;
        }
        if last == 0 {
            let name = self.new_name("Spine");
            last = self.push(name, Some(0), DVec3::ZERO);
        }
        last
    }

    fn add_leg(&mut self, side: usize) {
        let p = self.points;
        let [hip, knee, ankle] = [p.hips[side], p.knees[side], p.ankles[side]];
        let aside = DVec3::X * outward(side) * HIP * self.leg;
        let mut rest = self.on_pelvis(&vec![hip]).unwrap_or(aside);
        if !self.has_tilt() {
            // Off the line through the root, noise of millimeters would tell a tilt.
            rest = DVec3::X * rest.x;
        }
        let hip_joint = self.push_point(hip, 0, rest);
        let down = |long: f64| DVec3::NEG_Y * long;
        let rest = rest + down(self.long(&vec![hip], &vec![knee], 0.5));
        let knee_joint = self.push_point(knee, hip_joint, rest);
        let rest = rest + down(self.long(&vec![knee], &vec![ankle], 0.5));
        let ankle_joint = self.push_point(ankle, knee_joint, rest);
        let forward = DVec3::from_array(FOOT).normalize();
        match p.toes[side] {
            None => self.joints[ankle_joint].end = Some(forward * FOOT_LENGTH * self.leg),
            Some(toe) => {
                let long = self.long(&vec![ankle], &vec![toe], FOOT_LENGTH);
                let toe = self.push_point(toe, ankle_joint, rest + forward * long);
                self.joints[toe].end = Some(forward * (TOES * long).max(LEAST_END));
            }
        }
    }

    fn add_neck(&mut self, chest: usize) {
        let neck = self.neck_point();
        let up = self.long(&self.chest_point(), &neck, SPINE);
        let rest = self.joints[chest].rest + DVec3::Y * up;
        let neck_joint = self.push_joint(&neck, "Neck", chest, rest);
        let Some(head) = self.points.head.clone() else {
            self.joints[neck_joint].end = Some(DVec3::Y * NECK * self.leg);
            return;
        };
        let up = self.long(&neck, &head, NECK).max(LEAST_END);
        let head = self.push_joint(&head, "Head", neck_joint, rest + DVec3::Y * up);
        self.joints[head].end = Some(DVec3::Y * HEAD * self.leg);
    }

    /// The point at which the last joint of the spine stands.
    fn chest_point(&self) -> BodyPoint {
        let last = self.points.spine.last();
        last.map_or(self.root_point(), |&point| vec![point])
    }

    fn add_arm(&mut self, side: usize, chest: usize) {
        let p = self.points;
        let out = outward(side);
        let shoulder = vec![p.shoulders[side]];
        let (from, rest, direction) = match p.collars[side] {
            Some(collar) => {
                let [left, right] = p.shoulders.map(|s| vec![s]);
                let (chest_point, neck) = (self.chest_point(), self.neck_point());
                let (x, y) = ([&right, &left], [&chest_point, &neck]);
                let within = self.within(&vec![collar], &chest_point, x, y);
                let within = within.unwrap_or(DVec3::new(out * HIP * self.leg, 0.0, 0.0));
                (vec![collar], self.joints[chest].rest + within, COLLAR)
            }
            // CMU's collar bones hang on the chest; those of sets without a chest on the neck.
            None if !p.spine.is_empty() => {
                (self.chest_point(), self.joints[chest].rest, CMU_COLLAR)
            }
            None => {
                let neck = self.neck_point();
                let up = self.long(&self.chest_point(), &neck, SPINE);
                (neck, self.joints[chest].rest + DVec3::Y * up, LEVEL)
            }
        };
        let collar = match p.collars[side] {
            Some(collar) => self.push_point(collar, chest, rest),
            None => {
                let name = self.new_name(if side == 0 {
                    "LeftCollar"
                } else {
                    "RightCollar"
                });
                self.push(name, Some(chest), rest)
            }
        };
        let aside = DVec3::from_array(direction).normalize() * DVec3::new(out, 1.0, 1.0);
        let rest = rest + aside * self.long(&from, &shoulder, COLLAR_LENGTH);
        let mut last = self.push_point(p.shoulders[side], collar, rest);
        let (mut rest, mut before) = (rest, shoulder);
        let arm = [Some(p.elbows[side]), Some(p.wrists[side]), p.hands[side]];
        let shares = [UPPER_ARM, FOREARM, HAND];
        for (point, share) in arm.into_iter().zip(shares) {
            let Some(point) = point else { continue };
            let body_point = vec![point];
            rest += DVec3::X * out * self.long(&before, &body_point, share);
            last = self.push_point(point, last, rest);
            before = body_point;
        }
        let share = if p.hands[side].is_some() {
            FINGERS
        } else {
            HAND
        };
        self.joints[last].end = Some(DVec3::X * out * share * self.leg);
    }

    /// The joints in the order of a file.
    fn depth_first(&self, order: [Axis; 3]) -> Vec<Joint> {
        let (mut sorted, mut open) = (Vec::new(), vec![(0, None)]);
        while let Some((at, parent)) = open.pop() {
            let joint = &self.joints[at];
            let from = joint.parent.map_or(DVec3::ZERO, |p| self.joints[p].rest);
            let slides = [Axis::X, Axis::Y, Axis::Z].map(Channel::Translate);
            let mut channels = if at == 0 { slides.to_vec() } else { Vec::new() };
            channels.extend(order.map(Channel::Rotate));
            let offset = joint.rest - from;
            let ends = joint.end.map(|offset| EndSite { offset, after: 0 });
            sorted.push(Joint {
                name: joint.name.clone(),
                parent,
                offset,
                channels,
                ends: ends.into_iter().collect(),
            });
            let own = sorted.len() - 1;
            let children = (0..self.joints.len()).rev();
            let children = children.filter(|&j| self.joints[j].parent == Some(at));
            open.extend(children.map(|j| (j, Some(own))));
        }
        sorted
    }

    /// The take with the points in the middle of others.
    fn with_middles(self) -> Poses {
        let mut poses = self.poses.clone();
        let added = Array2::from_shape_fn((poses.frames(), 3 * self.middles.len()), |(t, c)| {
            self.at(t, &self.middles[c / 3].1)[c % 3]
        });
        poses
            .points
            .extend(self.middles.iter().map(|(name, _)| name.clone()));
        if let Ok(xyz) = concatenate(ndarray::Axis(1), &[poses.xyz.view(), added.view()]) {
            poses.xyz = xyz;
        }
        poses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ik::SkeletonFit;
    use crate::pose::joints::{CMU, CMU_REST};

    const ORDER: [Axis; 3] = [Axis::Z, Axis::Y, Axis::X];

    /// CMU's rest pose, turned and moved from frame to frame, under the names of a map.
    fn take(map: &NameMap, frames: usize) -> Poses {
        let own = CMU.iter().filter_map(|c| Some((c, map.joints.get(*c)?)));
        let first = |names: &String| names.split('|').next().unwrap_or_default().to_string();
        let known: Vec<(usize, String)> = own
            .map(|(c, name)| (CMU.iter().position(|o| o == c).unwrap(), first(name)))
            .collect();
        let xyz = Array2::from_shape_fn((frames, 3 * known.len()), |(t, c)| {
            let at = DVec3::from_array(CMU_REST[known[c / 3].0]);
            (DMat3::from_rotation_y(0.3 * t as f64) * at + DVec3::Y * 90.0)[c % 3]
        });
        let points = known.into_iter().map(|k| k.1).collect();
        Poses {
            xyz,
            points,
            ..Poses::default()
        }
    }

    /// Where the left hip stands from the root at rest, in a take whose root is moved.
    fn left_hip(moved: impl Fn(usize, DVec3) -> DVec3) -> DVec3 {
        let map = NameMap::shipped().iter().find(|m| m.name == "openpose");
        let map = map.unwrap();
        let mut poses = take(map, 30);
        let columns = map.columns(&poses.points);
        let [root, left, right] = ["root", "lhipjoint", "rhipjoint"].map(|name| columns[name]);
        for t in 0..30 {
            let hips = [left, right].map(|p| point_at(poses.xyz.view(), t, p));
            let at = moved(t, (hips[0] + hips[1]) / 2.0);
            (0..3).for_each(|axis| poses.xyz[[t, 3 * root + axis]] = at[axis]);
        }
        let named = named_skeleton(&poses, map, ORDER).unwrap();
        let joints = named.template.joints();
        let hip = joints.iter().find(|j| j.name == poses.points[left]);
        hip.unwrap().offset
    }

    #[test]
    fn a_root_among_the_hips_tells_no_tilt_whatever_its_noise() {
        let noise = |t: usize| DVec3::new(0.0, (9 * t) as f64, (5 * t) as f64).map(f64::sin);
        let hip = left_hip(|t, middle| middle + 2.0 * noise(t));
        assert!(hip.x > 5.0 && hip.y == 0.0 && hip.z == 0.0, "{hip}");
        let hip = left_hip(|_, middle| middle + 8.0 * DVec3::Y);
        assert!(hip.x > 5.0 && hip.y < -5.0, "{hip}");
    }

    #[test]
    fn bodies_of_all_maps_rest_in_a_t_pose_with_ends() {
        for map in NameMap::shipped() {
            let poses = take(map, 8);
            let named = named_skeleton(&poses, map, ORDER).unwrap();
            let joints = named.template.joints();
            let position = |name: &str| {
                let mut at = joints.iter().position(|j| j.name == name);
                let mut sum = DVec3::ZERO;
                while let Some(j) = at {
                    sum += joints[j].offset;
                    at = joints[j].parent;
                }
                sum
            };
            let name = |cmu: &str| {
                let column = map.columns(&poses.points)[cmu];
                poses.points[column].clone()
            };
            let along = |a: &str, b: &str| (position(&name(b)) - position(&name(a))).normalize();
            for (side, out) in [("l", DVec3::X), ("r", DVec3::NEG_X)] {
                let of = |bone: &str| format!("{side}{bone}");
                let arm = along(&of("clavicle"), &of("humerus"));
                let leg = along(&of("hipjoint"), &of("tibia"));
                assert!(arm.dot(out) > 0.999 && leg.y < -0.999, "{}", map.name);
            }
            for (i, joint) in joints.iter().enumerate() {
                let is_last = joints.iter().all(|j| j.parent != Some(i));
                assert_eq!(joint.ends.len(), usize::from(is_last), "{}", joint.name);
                assert!(joint.ends.iter().all(|e| e.offset.length() >= LEAST_END));
            }
            let fit = SkeletonFit::with_joints(&named.template).map(Some(map));
            let fit = fit.fit(&named.poses).unwrap().sequence;
            assert!(fit.mean <= 2.0, "{}: {}", map.name, fit.mean);
        }
    }

    #[test]
    fn what_a_skeleton_cannot_do_without_is_said() {
        let map = NameMap::find("mediapipe").unwrap();
        let mut poses = take(map, 3);
        let wrist = poses.points.iter().position(|p| p == "left_wrist").unwrap();
        poses.points[wrist] = "something".into();
        let error = named_skeleton(&poses, map, ORDER).unwrap_err().to_string();
        assert!(error.contains("left_wrist"), "{error}");
        let mut empty = take(map, 3);
        empty.xyz.fill(f64::NAN);
        let error = named_skeleton(&empty, map, ORDER).unwrap_err().to_string();
        assert!(error.contains("leg"), "{error}");
        // A part that no frame shows has the length of people's.
        let mut armless = take(map, 3);
        let elbow = armless
            .points
            .iter()
            .position(|p| p == "left_elbow")
            .unwrap();
        (0..3).for_each(|c| armless.xyz.column_mut(3 * elbow + c).fill(f64::NAN));
        let named = named_skeleton(&armless, map, ORDER).unwrap();
        let joints = named.template.joints();
        let elbow = joints.iter().find(|j| j.name == "left_elbow").unwrap();
        assert!(elbow.offset.length() > 20.0 && elbow.offset.length() < 40.0);
    }
}
