//! The joints of SMPL, SMPL-H and SMPL-X, in the order of their arrays.

/// The joints of the body, which all have first; HumanML3D has these alone.
const BODY: [&str; 22] = [
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
];

const FINGERS: [&str; 5] = ["index", "middle", "pinky", "ring", "thumb"];

/// The names of the joints of an array of so many: 22 of the body; 24 of SMPL, with hands; 52 of
/// SMPL-H, with fingers; 55 of SMPL-X, with jaw, eyes and fingers.
///
/// ```
/// use posing_core::pose::smpl_names;
///
/// assert_eq!(smpl_names(24).map(|names| names[0].clone()).as_deref(), Some("pelvis"));
/// assert_eq!(smpl_names(23), None);
/// ```
pub fn smpl_names(count: usize) -> Option<Vec<String>> {
    let face: &[&str] = match count {
        22 | 52 => &[],
        24 => &["left_hand", "right_hand"],
        55 => &["jaw", "left_eye_smplhf", "right_eye_smplhf"],
        _ => return None,
    };
    let body = BODY.iter().chain(face).map(|name| name.to_string());
    let finger = |side: &'static str| {
        let of = move |finger: &&str| [1, 2, 3].map(|n| format!("{side}_{finger}{n}"));
        FINGERS.iter().flat_map(of)
    };
    let fingers = finger("left").chain(finger("right")).filter(|_| count > 24);
    Some(body.chain(fingers).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_array_has_its_joints() {
        for count in [22, 24, 52, 55] {
            let names = smpl_names(count).unwrap_or_default();
            assert_eq!(names.len(), count);
            let unique: std::collections::HashSet<&String> = names.iter().collect();
            assert_eq!(unique.len(), count);
        }
        let hands = smpl_names(52).unwrap_or_default();
        assert_eq!((&*hands[22], &*hands[51]), ("left_index1", "right_thumb3"));
        assert_eq!(smpl_names(23), None);
    }
}
