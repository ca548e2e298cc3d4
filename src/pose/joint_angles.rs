//! The rotations of a joint over time, as the angles that files have.

use super::rotation::Axis;
use ndarray::Array2;

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

impl JointAngles {
    /// Reverses the order of the product.
    pub(crate) fn reverse(&mut self) {
        self.axes.reverse();
        self.angles.invert_axis(ndarray::Axis(1));
    }
}
