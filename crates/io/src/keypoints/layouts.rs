//! The names of keypoints, which stand in files by their number alone.

/// OpenPose's BODY_25.
const BODY_25: &str = "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist MidHip RHip RKnee \
                       RAnkle LHip LKnee LAnkle REye LEye REar LEar LBigToe LSmallToe LHeel \
                       RBigToe RSmallToe RHeel";
/// OpenPose's COCO.
const COCO_18: &str = "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist RHip RKnee RAnkle \
                       LHip LKnee LAnkle REye LEye REar LEar";
/// MediaPipe's pose landmarks.
const LANDMARKS: &str = "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye \
                         right_eye_outer left_ear right_ear mouth_left mouth_right left_shoulder \
                         right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky \
                         right_pinky left_index right_index left_thumb right_thumb left_hip \
                         right_hip left_knee right_knee left_ankle right_ankle left_heel \
                         right_heel left_foot_index right_foot_index";

/// What the keypoints of a file are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Kind {
    /// OpenPose's, in space.
    OpenPose,
    /// MediaPipe's in space.
    World,
    /// MediaPipe's in space or in pictures: the file does not say.
    #[default]
    Landmarks,
}

impl Kind {
    /// The names of so many points; `None`: it has no such set.
    pub(super) fn names(self, points: usize) -> Option<impl Iterator<Item = &'static str>> {
        let sets = match self {
            Kind::OpenPose => &[BODY_25, COCO_18][..],
            Kind::World | Kind::Landmarks => &[LANDMARKS],
        };
        let mut names = sets.iter().map(|set| set.split_whitespace());
        names.find(|names| names.clone().count() == points)
    }

    /// The sets that it has, for a message.
    pub(super) fn sets(self) -> &'static str {
        match self {
            Kind::OpenPose => "BODY_25 (25) or COCO (18)",
            Kind::World | Kind::Landmarks => "MediaPipe's 33",
        }
    }
}
