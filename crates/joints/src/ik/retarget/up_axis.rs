//! The axis that is up in a motion of which nobody said it: that along which its figure stands.

use super::hierarchy::{Hierarchy, Pose};
use super::rest::{RestPose, hips, middle, top};
use super::segments::BodyJoints;
use super::tuning::rest::FRAMES;
use crate::io::Bvh;
use crate::numeric::statistics::range;
use crate::pose::orientation::{Figure, Standing};
use crate::pose::{NameMap, UpAxis};
use glam::{DMat3, DVec3};

/// The axis that the figure of a motion stands along; `map` as for
/// [`Retargeter::retarget`](super::Retargeter::retarget). `None` where nothing tells it: the joints
/// are not known, or somebody may lie.
///
/// ```
/// use posing_core::pose::UpAxis;
/// use posing_io::Bvh;
/// use posing_joints::ik::retarget::up_axis;
///
/// let rig = Bvh::open("../../testdata/examples/animator/goblin.bvh")?;
/// assert_eq!(up_axis(&rig, None), Some(UpAxis::Y));
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn up_axis(source: &Bvh, map: Option<&NameMap>) -> Option<UpAxis> {
    let tree = Hierarchy::new(source, DMat3::IDENTITY);
    let body = BodyJoints::find(&tree, map, "map_from").ok()?;
    let mut pose = Pose::default();
    let frames = source.motion.nrows();
    let mut figure = |t: usize| {
        tree.pose(source.motion.row(t), &mut pose);
        let limbs = |joint: [usize; 2]| middle(&pose, &joint);
        Figure {
            head: body
                .head
                .map_or_else(|| top(&body, &pose), |head| pose.positions[head]),
            hips: limbs(hips(&body)),
            feet: limbs([0, 1].map(|side: usize| body.legs[side].joints[2])),
            hands: (body.arms.as_ref()).map_or(DVec3::NAN, |arms| {
                limbs([0, 1].map(|side: usize| arms[side].joints[2]))
            }),
            heights: range(pose.positions.iter().map(|position| position.y)).into(),
        }
    };
    let is_whole = |t: &usize| source.motion.row(*t).iter().all(|v| v.is_finite());
    let whole = (0..frames)
        .step_by(frames.div_ceil(FRAMES).max(1))
        .filter(is_whole);
    let standing = Standing::of(&whole.map(&mut figure).collect::<Vec<_>>())?;
    // A figure at rest along the same axis was made for it.
    let at_rest = RestPose::zero(&tree, &body).up.and_then(UpAxis::along);
    (standing.is_sure || at_rest == Some(standing.axis)).then_some(standing.axis)
}
