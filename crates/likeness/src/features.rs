//! Which numbers describe a pose, before they are scaled.

use super::body_frame::BodyFramePoses;
use super::gpd::{Family, Gpd};
use super::motion_matching;
use super::orientation;
use crate::numeric::parallel;
use ndarray::Array2;

/// Frames of one parallel task.
const CHUNK: usize = 64;

/// A set of features of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseFeatures {
    /// The geometric pose descriptor without accelerations.
    Gpd,
    /// All of the geometric pose descriptor.
    GpdWithAccelerations,
    /// Coordinates and their velocities.
    Coordinates,
    /// Distances of joints: the joint relative features of Tang et al.
    JointDistances,
    /// Fitted rotations of the joints, the hip's height, and their velocities.
    Orientations,
    /// What game engines compare: ends of the body, and the path ahead.
    MotionMatching,
}

names!(PoseFeatures {
    Gpd = "gpd",
    GpdWithAccelerations = "gpd+a",
    Coordinates = "jc",
    JointDistances = "jrf",
    Orientations = "jo",
    MotionMatching = "game",
});

impl PoseFeatures {
    /// The families of the geometric pose descriptor that the set is made of, if it is.
    pub(super) fn gpd(self) -> Option<Gpd> {
        let some = |families: &[Family]| Some(Gpd::new(families).without_accelerations());
        match self {
            PoseFeatures::Gpd => some(&Family::ALL),
            PoseFeatures::GpdWithAccelerations => Some(Gpd::default()),
            PoseFeatures::Coordinates => Some(Gpd::coordinates()),
            PoseFeatures::JointDistances => some(&[Family::JointJointDistance]),
            PoseFeatures::Orientations => None,
            PoseFeatures::MotionMatching => None,
        }
    }

    /// The names of the features, in order.
    ///
    /// ```
    /// use posing_likeness::PoseFeatures;
    ///
    /// // Distances of each two of sixteen joints.
    /// assert_eq!(PoseFeatures::JointDistances.feature_names().len(), 16 * 15 / 2);
    /// ```
    pub fn feature_names(self) -> Vec<String> {
        match (self.gpd(), self) {
            (Some(gpd), _) => gpd.names(),
            (None, PoseFeatures::MotionMatching) => motion_matching::names(),
            (None, _) => orientation::names(),
        }
    }

    /// Whether a frame's neighbors in time are needed.
    pub fn needs_rate(self) -> bool {
        self.gpd().is_none_or(|gpd| gpd.needs_rate())
    }

    /// The features of some frames (frames, features); NaN where a joint is missing, or a rate that
    /// is needed.
    pub(crate) fn describe(self, poses: &BodyFramePoses, frames: &[usize]) -> Array2<f32> {
        let width = self.feature_names().len();
        let gpd = self.gpd();
        let rows = parallel::map_chunks(frames.len(), CHUNK, |range| {
            let mut rows = Vec::with_capacity(range.len() * width);
            for t in &frames[range] {
                match (&gpd, self) {
                    (Some(gpd), _) => gpd.describe_frame(poses, *t, &mut rows),
                    (None, PoseFeatures::MotionMatching) => {
                        motion_matching::describe_frame(poses, *t, &mut rows)
                    }
                    (None, _) => orientation::describe_frame(poses, *t, &mut rows),
                }
            }
            rows
        });
        // Each frame has as many features as names.
        Array2::from_shape_vec((frames.len(), width), rows.concat()).unwrap_or_default()
    }
}
