//! Whether the body stands along another axis than y, or is a mirror image, by the names of its
//! joints or markers.

use super::{Finding, FindingKind, Take};
use crate::label::people::named_people;
use crate::pose::UpAxis;
use crate::pose::orientation::BodyPoints;
use crate::solve::body_points;

/// What is wrong with the axes of a take; `None` where names tell no legs.
pub(super) fn findings(take: &Take<'_>) -> Option<Vec<Finding>> {
    // Of several people, the sides of one are those of another.
    if named_people(take.points) > 1 {
        return Some(Vec::new());
    }
    let joints = BodyPoints::of_joints(take.points, take.xyz, None);
    let body = if joints.has_legs() {
        joints
    } else {
        body_points(take.points).filter(BodyPoints::has_legs)?
    };
    let finding = |kind: FindingKind, what: String| take.finding(kind, &[], None, what);
    let standing = body.standing(take.xyz);
    let wrong = standing.filter(|s| s.axis != UpAxis::Y && s.is_sure);
    let wrong = wrong.map(|s| finding(FindingKind::UpAxis, s.sentence()));
    let mirrored = body.is_mirrored(take.xyz).then(|| {
        let what = "the body is a mirror image: its left side is where its right would be, as \
                    toes, knees or the chest are in front; if the axes are left-handed, say so \
                    with the option `left_handed`, else exchange the names of left and right";
        finding(FindingKind::Mirrored, what.to_string())
    });
    Some(wrong.into_iter().chain(mirrored).collect())
}
