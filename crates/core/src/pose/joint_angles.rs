//! The rotations of a joint over time, as the angles that files have.

use super::rotation::Axis;
use super::skeleton::Channel;
use ndarray::{Array2, ArrayView2};

/// The channels of a joint among those of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct JointChannels {
    /// The name of the joint.
    pub joint: String,
    /// The columns of its angles, with their axes; the rotation is the product of those about each
    /// in turn.
    pub angles: Vec<(usize, Axis)>,
    /// The columns of its position, with their axes.
    pub positions: Vec<(usize, Axis)>,
}

impl JointChannels {
    /// Those of joints whose channels follow one another in a frame.
    #[doc(hidden)]
    pub fn all(joints: impl Iterator<Item = (String, Vec<Channel>)>) -> Vec<JointChannels> {
        let mut first = 0;
        let mut out = Vec::new();
        for (joint, channels) in joints {
            let (mut angles, mut positions) = (Vec::new(), Vec::new());
            for (i, channel) in channels.iter().enumerate() {
                match channel {
                    Channel::Rotate(axis) => angles.push((first + i, *axis)),
                    Channel::Translate(axis) => positions.push((first + i, *axis)),
                    Channel::Length => {}
                }
            }
            first += channels.len();
            out.push(JointChannels {
                joint,
                angles,
                positions,
            });
        }
        out
    }

    /// Its angles over time, from `motion` (frames, channels); `None` where it has none.
    #[doc(hidden)]
    pub fn angles_in(&self, motion: ArrayView2<'_, f64>) -> Option<JointAngles> {
        let (columns, axes): (Vec<usize>, Vec<Axis>) = self.angles.iter().copied().unzip();
        (!columns.is_empty()).then(|| JointAngles {
            joint: self.joint.clone(),
            axes,
            angles: motion.select(ndarray::Axis(1), &columns),
        })
    }
}

/// The angles of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointAngles {
    /// The name of the joint.
    pub joint: String,
    /// The axes; the rotation is the product of those about each in turn.
    pub axes: Vec<Axis>,
    /// (frames, axes), radians; NaN is missing.
    pub angles: Array2<f64>,
}
