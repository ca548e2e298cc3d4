//! A person of a take: what was solved, and a small picture.

use crate::draw::stick_picture::stick_picture;
use crate::pose::{Poses, joints};
use ndarray::s;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;

/// Points without bones of which a picture still has few bytes.
const DRAWN: usize = 150;

/// A person of a take.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TakePerson {
    /// What tells the person from the others of the take; one alone has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub person: Option<String>,
    /// The file of the skeleton or of the joint centers, beside the result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Why there is none, where one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub none: Option<String>,
    /// The person in one frame: paths of the middle of the body, of its left and of its right, as
    /// SVG has them, in a box of 64 by 64.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture: Option<[String; 3]>,
}

/// The picture of a person in the first of the frames in which most is `seen`; without `bones`,
/// those that the names of the points say.
pub(super) fn picture(
    poses: &Poses,
    bones: Option<Vec<(usize, usize)>>,
    seen: impl Fn(usize) -> usize,
) -> Option<[String; 3]> {
    let frame = (0..poses.xyz.nrows()).min_by_key(|t| Reverse(seen(*t)))?;
    let bones = bones.unwrap_or_else(|| joints::bones(&poses.points));
    if bones.is_empty() && poses.points.len() > DRAWN {
        return None;
    }
    let pose = poses.xyz.slice(s![frame..frame + 1, ..]);
    stick_picture(&poses.points, &bones, pose)
}
