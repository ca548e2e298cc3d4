//! A BVH hierarchy as a [`Skeleton`], whose kinematics and solver then serve.
//!
//! A skeleton's bone carries its children at its end; a BVH joint carries each of its children at
//! an OFFSET of its own. So each point of a joint where something stands becomes a bone without
//! freedom, and each joint a bone without length that turns. Joints that start at one position
//! share it, so that it is the end of the bone above them.

use super::skeleton_builder::{Moving, SkeletonBuilder};
use super::{Bvh, Joint};
use crate::Result;
use crate::numeric::statistics::span;
use crate::pose::kinematics::Posture;
use crate::pose::{Channel, Skeleton};
use glam::DMat3;
use ndarray::{Array2, ArrayView1, ArrayView2};

/// The points of a table of this hierarchy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BvhPoints {
    /// Joints, and End Sites as NAME_end.
    Origins,
    /// The end of each bone, under the bone's name: see `BvhSkeleton::points`.
    Ends,
}

/// A hierarchy's skeleton, y up.
#[derive(Debug, Clone)]
pub struct BvhSkeleton {
    /// Its kinematics.
    pub skeleton: Skeleton,
    /// The skeleton's value of each channel of a frame; `None` for one that does not move here.
    pub channels: Vec<Option<usize>>,
    /// What is added to the value of each channel; of one without a value, all that it holds: its
    /// OFFSET.
    pub still: Vec<f64>,
    origins: Vec<(String, usize)>,
    ends: Vec<(String, usize)>,
}

impl BvhSkeleton {
    /// The skeleton of `joints`; `turn` carries the file's axes to ours (y up).
    ///
    /// With `sliding` every position channel is a value of the skeleton. Without, bones keep their
    /// lengths, as when a posture is solved for, and only those move the body as a whole: the
    /// root's, and its only child's, and so on until the first fork (some rigs have a root that
    /// stays where it is and hips that walk).
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: the joints are no tree.
    pub fn new(joints: &[Joint], turn: DMat3, sliding: bool) -> Result<BvhSkeleton> {
        let trunk = trunk(joints);
        BvhSkeleton::with_moving(joints, turn, |joint, _| {
            if sliding || joint <= trunk {
                Moving::FromOrigin
            } else {
                Moving::No
            }
        })
    }

    /// The skeleton in which each position channel (its joint and its number there) moves as
    /// `moving` says.
    fn with_moving(
        joints: &[Joint],
        turn: DMat3,
        moving: impl Fn(usize, usize) -> Moving,
    ) -> Result<BvhSkeleton> {
        let mut builder = SkeletonBuilder::new(turn);
        for joint in joints {
            builder.push_joint(joint, &moving);
            builder.push_end_sites(joint);
        }
        let ends = builder.ends(joints);
        let mut origins = builder.origins;
        origins.extend(builder.end_sites);
        unique(&mut origins);
        Ok(BvhSkeleton {
            skeleton: Skeleton::new(builder.bones)?,
            channels: builder.channels,
            still: builder.still,
            origins,
            ends,
        })
    }

    /// The points of a table and the bone at whose end each is.
    ///
    /// The end of a bone is where the joints on it start and its End Sites are; where those are
    /// apart, their mean, as Blender draws it. A joint that carries nothing ends where it is,
    /// and so does the root, so that a table of ends tells where the body stands.
    #[doc(hidden)]
    pub fn points(&self, which: BvhPoints) -> &[(String, usize)] {
        match which {
            BvhPoints::Origins => &self.origins,
            BvhPoints::Ends => &self.ends,
        }
    }

    /// The pairs of points that the skeleton joins, the one nearer to the root first.
    pub fn bones(&self, which: BvhPoints) -> Vec<(usize, usize)> {
        let points: Vec<usize> = self.points(which).iter().map(|p| p.1).collect();
        let parents = self.skeleton.nearest_above(&points).into_iter();
        let bones = parents.enumerate().filter_map(|(i, p)| Some((p?, i)));
        bones.collect()
    }

    /// The positions of points (frames, 3 P), cm, by the channels of `motion` (frames, channels).
    pub(crate) fn positions(&self, motion: ArrayView2<'_, f64>, which: BvhPoints) -> Array2<f64> {
        let points = self.points(which);
        let mut xyz = Array2::zeros((motion.nrows(), 3 * points.len()));
        let (mut posture, mut q) = (Posture::default(), vec![0.0; self.skeleton.dof_count()]);
        for (frame, mut out) in motion.rows().into_iter().zip(xyz.rows_mut()) {
            self.values(frame.as_slice().unwrap_or(&frame.to_vec()), &mut q);
            self.skeleton.posture_into(&q, &mut posture);
            let ends = points
                .iter()
                .flat_map(|&(_, bone)| posture.ends[bone].to_array());
            out.iter_mut().zip(ends).for_each(|(to, v)| *to = v);
        }
        xyz
    }

    /// A frame's channels as the skeleton's values.
    #[doc(hidden)]
    pub fn values(&self, frame: &[f64], q: &mut [f64]) {
        for ((value, channel), still) in frame.iter().zip(&self.channels).zip(&self.still) {
            if let Some(i) = channel {
                q[*i] = *value - still;
            }
        }
    }

    /// The skeleton's values as a frame's channels.
    #[doc(hidden)]
    pub fn frame<'a>(&'a self, q: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let channels = self.channels.iter().zip(&self.still);
        channels.map(|(c, still)| c.map_or(0.0, |i| q[i]) + still)
    }
}

/// The first joint that carries no single other: position channels down to it move the body as a
/// whole.
fn trunk(joints: &[Joint]) -> usize {
    let fork = (0..joints.len()).find(|&i| {
        let on = joints.iter().filter(|j| j.parent == Some(i)).count();
        on + joints[i].ends.len() != 1
    });
    fork.unwrap_or(0)
}

/// A BVH file whose hierarchy, offsets and channels another motion takes over.
///
/// Position channels take the place of OFFSETs: where those below the trunk hold one value in the
/// file's own motion, that is the bone; where they vary, as stretched bones do, they are values of
/// the skeleton too, about their mean. (Many files have OFFSETs of zero and all bones in position
/// channels.)
#[derive(Debug, Clone)]
pub struct BvhTemplate {
    joints: Vec<Joint>,
    /// The joints with the means of their position channels for OFFSETs.
    bones: Vec<Joint>,
    /// Frames a second of the file's motion.
    rate: Option<f64>,
    turn: DMat3,
    /// The kinematics of the joints; bones keep their lengths, those apart whose position channels
    /// vary.
    pub skeleton: BvhSkeleton,
}

/// A position channel below the trunk that varies by more than this is solved for, cm.
const VARIES: f64 = 0.01;

/// The mean of values and by how much they vary at most; missing ones do not count.
fn mean_and_range(values: ArrayView1<'_, f64>) -> Option<(f64, f64)> {
    let known = || values.iter().copied().filter(|v| v.is_finite());
    let count = known().count();
    (count > 0).then(|| (known().sum::<f64>() / count as f64, span(known())))
}

impl Bvh {
    /// The joints with the means of their position channels, but those that move the body as a
    /// whole, for OFFSETs.
    #[doc(hidden)]
    pub fn mean_bones(&self) -> Vec<Joint> {
        self.bones_and_ranges().0
    }

    /// [`Bvh::mean_bones`], and whether each channel of each joint moves its bone.
    fn bones_and_ranges(&self) -> (Vec<Joint>, Vec<Vec<bool>>) {
        let trunk = trunk(&self.joints);
        let mut bones = self.joints.clone();
        let mut varies = Vec::with_capacity(bones.len());
        let mut column = 0;
        for (j, joint) in bones.iter_mut().enumerate() {
            let mut of_joint = vec![false; joint.channels.len()];
            for (c, channel) in joint.channels.iter().enumerate() {
                let Channel::Translate(axis) = channel else {
                    continue;
                };
                let values = mean_and_range(self.motion.column(column + c));
                if let Some((mean, range)) = values.filter(|_| j > trunk) {
                    joint.offset[axis.index()] = mean;
                    of_joint[c] = range > VARIES;
                }
            }
            column += of_joint.len();
            varies.push(of_joint);
        }
        (bones, varies)
    }
}

impl BvhTemplate {
    /// The hierarchy of `bvh`; `turn` carries the file's axes to ours (y up).
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: the joints are no tree.
    pub fn new(bvh: Bvh, turn: DMat3) -> Result<BvhTemplate> {
        let trunk = trunk(&bvh.joints);
        let (bones, varies) = bvh.bones_and_ranges();
        let skeleton = BvhSkeleton::with_moving(&bones, turn, |j, c| match varies[j][c] {
            _ if j <= trunk => Moving::FromOrigin,
            true => Moving::FromOffset,
            false => Moving::No,
        })?;
        Ok(BvhTemplate {
            skeleton,
            rate: bvh.rate(),
            joints: bvh.joints,
            bones,
            turn,
        })
    }

    /// The template with bones of fixed lengths: none of them slides.
    ///
    /// # Errors
    /// Fails as [`BvhTemplate::new`] does.
    pub fn rigid(self) -> Result<BvhTemplate> {
        Ok(BvhTemplate {
            skeleton: BvhSkeleton::new(&self.bones, self.turn, false)?,
            ..self
        })
    }

    /// The joints of the hierarchy.
    #[doc(hidden)]
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// The joint that turns as a bone of the skeleton.
    #[doc(hidden)]
    pub fn joint_of(&self, bone: usize) -> Option<&str> {
        let bones = self.skeleton.skeleton.bones();
        let mut up = std::iter::successors(Some(bone), |&b| bones[b].parent);
        let origins = &self.skeleton.origins[..self.joints.len()];
        let joint = |b: usize| origins.iter().find(|o| o.1 == b);
        up.find_map(joint).map(|(name, _)| name.as_str())
    }

    /// The names of the joints.
    #[must_use]
    pub fn joint_names(&self) -> Vec<String> {
        self.joints.iter().map(|j| j.name.clone()).collect()
    }

    /// Frames a second of the file's own motion; `None` where its Frame Time is zero.
    pub fn rate(&self) -> Option<f64> {
        self.rate
    }

    /// The bone whose end each point of a table is, by name.
    pub fn bones_of(&self, names: &[String], which: BvhPoints) -> Vec<Option<usize>> {
        let points = self.skeleton.points(which);
        let find = |n: &String| points.iter().find(|p| p.0 == *n).map(|p| p.1);
        names.iter().map(find).collect()
    }

    /// Whether an End Site is among the points of a table, which then holds joints.
    pub fn has_end_site_among(&self, names: &[String]) -> bool {
        let sites = &self.skeleton.origins[self.joints.len()..];
        sites.iter().any(|(site, _)| names.contains(site))
    }

    /// The template with another motion: `values` (frames, degrees of freedom of the skeleton;
    /// radians and centimeters).
    #[doc(hidden)]
    pub fn with_values(&self, values: ArrayView2<'_, f64>, frame_time: f64) -> Bvh {
        let mut motion = Array2::zeros((values.nrows(), Bvh::channels(&self.joints)));
        for (q, mut frame) in values.rows().into_iter().zip(motion.rows_mut()) {
            let q = q.to_vec();
            let channels = self.skeleton.frame(&q);
            frame.iter_mut().zip(channels).for_each(|(to, v)| *to = v);
        }
        Bvh {
            joints: self.joints.clone(),
            frame_time,
            motion,
            notes: Vec::new(),
        }
    }
}

/// A joint may be called what an End Site is called here.
fn unique(points: &mut [(String, usize)]) {
    let mut taken = std::collections::HashSet::new();
    for (name, _) in points {
        if !taken.insert(name.clone()) {
            let free = (2..)
                .map(|n| format!("{name}_{n}"))
                .find(|n| !taken.contains(n));
            *name = free.unwrap_or_default();
            taken.insert(name.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Input;
    use glam::DVec3;

    /// A root, a spine and two arms whose bones are in position channels: OFFSETs are zero.
    /// `stretch` varies the right arm's.
    fn template(stretch: f64) -> BvhTemplate {
        let joint = |name: &str, inner: &str| {
            format!(
                "JOINT {name}\n{{\nOFFSET 0 0 0\n\
                CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
                {inner}}}\n"
            )
        };
        let end = "End Site\n{\nOFFSET 0 9 0\n}\n";
        let all = joint("root", &(joint("left", end) + &joint("right", end)));
        let row = |t: usize| {
            let right = 7.0 + stretch * t as f64;
            format!("{t} 90 0 0 0 0 5 {t}e-9 0 0 0 0 -{right} 0 0 0 0 0\n")
        };
        let rows: String = (0..3).map(row).collect();
        let text = format!("HIERARCHY\n{all}MOTION\nFrames: 3\nFrame Time: 0.01\n{rows}");
        let input = Input::new("t", std::io::Cursor::new(text.into_bytes())).unwrap();
        BvhTemplate::new(Bvh::read(input, 1.0, false).unwrap(), DMat3::IDENTITY).unwrap()
    }

    #[test]
    fn bones_come_from_position_channels_and_those_that_vary_are_values() {
        let rest = |t: &BvhTemplate| {
            let skeleton = &t.skeleton.skeleton;
            let ends = skeleton.posture(&vec![0.0; skeleton.dof_count()]).ends;
            let points = t.skeleton.points(BvhPoints::Origins);
            points.iter().map(|(_, b)| ends[*b]).collect::<Vec<_>>()
        };
        let still = template(0.0);
        assert_eq!(still.skeleton.skeleton.dof_count(), 6 + 3 + 3);
        assert!((rest(&still)[1] - DVec3::X * 5.0).length() < 1e-6);
        assert!((rest(&still)[2] + DVec3::X * 7.0).length() < 1e-6);
        let varied = template(0.5);
        assert_eq!(varied.skeleton.skeleton.dof_count(), 6 + 3 + 4);
        assert!((rest(&varied)[2] + DVec3::X * 7.5).length() < 1e-6);
        // Channels there and back.
        let frame: Vec<f64> = (0..18)
            .map(|i| if i == 6 { 5.0 } else { f64::from(i % 7) })
            .collect();
        let mut q = vec![0.0; varied.skeleton.skeleton.dof_count()];
        varied.skeleton.values(&frame, &mut q);
        let back: Vec<f64> = varied.skeleton.frame(&q).collect();
        assert!((back[12] - frame[12]).abs() < 1e-12 && (back[6] - 5.0).abs() < 1e-6);
        assert_eq!(varied.rigid().unwrap().skeleton.skeleton.dof_count(), 12);
    }
}
