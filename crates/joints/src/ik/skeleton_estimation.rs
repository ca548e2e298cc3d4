//! A skeleton measured from a table: CMU's joints by name, bones as long as they are in the median
//! frame.
//!
//! Every bone is a ball joint. Its rest pose is CMU's: upright, facing z, arms level.

use crate::numeric::statistics::median;
use crate::pose::joints::{
    CMU, CMU_REST as REST, PELVIS, parents_by_name, pelvis_frame, rest_pelvis,
};
use crate::pose::rotation::Axis;
use crate::pose::{Body, Bone, Channel, Dof, Poses, Skeleton, point_at};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// The skeleton of a table's points; its bones have the points' names.
///
/// Points that CMU does not know, or that hang on nothing the table shows, are no bones of it.
/// Bones that no frame shows from end to end are as long as CMU's mean.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_joints::ik::estimate_skeleton;
///
/// let points = ["lfemur", "ltibia", "lfoot"].map(String::from).to_vec();
/// let xyz = ndarray::array![[0.0, 45.0, 0.0, 0.0, 5.0, 0.0, 0.0, 3.0, 12.0]];
/// let skeleton = estimate_skeleton(&Poses { points, xyz, ..Poses::default() })?;
/// let shin = skeleton.find("ltibia").ok_or("none")?;
/// assert!((skeleton.bones()[shin].offset.length() - 40.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Error::Usage`]: fewer than two points have the names of connected CMU joints.
pub fn estimate_skeleton(poses: &Poses) -> Result<Skeleton> {
    let names = &poses.points;
    let parents = parents_by_name(names);
    let body = Body::measure(&parents, poses.xyz.view());
    // The root is the point that most others hang on.
    let mut below = vec![0usize; names.len()];
    let top = |mut k: usize| {
        while let Some(p) = parents[k] {
            k = p;
        }
        k
    };
    (0..names.len()).for_each(|k| below[top(k)] += 1);
    let root = (0..names.len()).rev().max_by_key(|&k| below[k]);
    let Some(root) = root.filter(|&r| below[r] > 1) else {
        return Err(Error::usage(
            "no skeleton is known for these point names; give the option `skeleton SUBJECT.asf` \
             (or FILE.bvh)",
        ));
    };
    let at = |k: usize| {
        let known = CMU.iter().position(|c| *c == names[k]);
        known.map_or(DVec3::ZERO, |i| DVec3::from_array(REST[i]))
    };
    let pelvis = rigid_hips(poses);
    let mut index = vec![None; names.len()];
    let mut bones: Vec<Bone> = Vec::new();
    for k in body.order() {
        if top(k) != root {
            continue;
        }
        let rotations = [Axis::X, Axis::Y, Axis::Z].map(Channel::Rotate);
        let rigid = pelvis.get(&names[k]);
        let (parent, offset, channels) = match parents[k] {
            None => {
                let slides = [Axis::X, Axis::Y, Axis::Z].map(Channel::Translate);
                (None, DVec3::ZERO, [slides, rotations].concat())
            }
            // No point shows how a hip joint turns against the root.
            Some(p) if let Some(offset) = rigid => (index[p], *offset, Vec::new()),
            Some(p) => {
                let rest = at(k) - at(p);
                let length = Some(body.lengths[k]).filter(|l| l.is_finite());
                let direction = rest.try_normalize().unwrap_or(DVec3::Y);
                let offset = direction * length.unwrap_or(rest.length());
                (index[p], offset, rotations.to_vec())
            }
        };
        index[k] = Some(bones.len());
        bones.push(Bone {
            name: names[k].clone(),
            parent,
            offset,
            axis: DMat3::IDENTITY,
            dofs: channels.into_iter().map(Dof::free).collect(),
        });
    }
    Skeleton::new(bones)
}

/// Where the hip joints are from the root in the rest pose, cm, by their names: they do not move
/// against it. Nothing where a take does not show root and hips together.
fn rigid_hips(poses: &Poses) -> BTreeMap<String, DVec3> {
    let column = |name: &str| poses.points.iter().position(|p| p == name);
    let [Some(root), Some(left), Some(right)] = PELVIS.map(column) else {
        return BTreeMap::new();
    };
    let offset = |hip: usize| {
        let seen = (0..poses.frames()).filter_map(|t| {
            let at = |point: usize| point_at(poses.xyz.view(), t, point);
            let frame = pelvis_frame([root, left, right].map(at))?;
            Some(frame.transpose() * (at(hip) - at(root)))
        });
        Some((
            poses.points[hip].clone(),
            rest_pelvis() * median_position(seen)?,
        ))
    };
    [left, right].into_iter().filter_map(offset).collect()
}

/// The median of positions along each axis; those that are not finite do not count. `None`: there
/// are none.
pub(super) fn median_position(positions: impl Iterator<Item = DVec3>) -> Option<DVec3> {
    let seen: Vec<DVec3> = positions.filter(|position| position.is_finite()).collect();
    let along = |axis: usize| median(seen.iter().map(|position| position[axis]).collect());
    Some(DVec3::new(along(0)?, along(1)?, along(2)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints::cmu_names;
    use ndarray::Array2;

    fn poses(points: Vec<String>, scale: f64) -> Poses {
        let xyz: Vec<f64> = points
            .iter()
            .flat_map(|n| {
                let i = CMU.iter().position(|c| c == n);
                i.map_or([f64::NAN; 3], |i| REST[i].map(|v| scale * v + 5.0))
            })
            .collect();
        Poses {
            xyz: Array2::from_shape_vec((1, xyz.len()), xyz).unwrap(),
            points,
            ..Poses::default()
        }
    }

    #[test]
    fn lengths_come_from_the_table_and_the_rest_pose_from_cmu() {
        let s = estimate_skeleton(&poses(cmu_names(), 1.25)).unwrap();
        assert_eq!(s.bones().len(), 23);
        let rest = s.posture(&vec![0.0; s.dof_count()]);
        for (bone, end) in s.bones().iter().zip(&rest.ends) {
            let i = CMU.iter().position(|c| *c == bone.name).unwrap();
            assert!((*end - 1.25 * DVec3::from_array(REST[i])).length() <= 1e-9);
        }
    }

    #[test]
    fn unconnected_points_are_left_out() {
        let names = |n: &[&str]| n.iter().map(|s| s.to_string()).collect::<Vec<_>>();
        let s = estimate_skeleton(&poses(
            names(&["tail", "lradius", "lhumerus", "lwrist"]),
            1.0,
        ))
        .unwrap();
        let got: Vec<&str> = s.bones().iter().map(|b| b.name.as_str()).collect();
        assert_eq!(got, ["lhumerus", "lradius", "lwrist"]);
        for few in [&["root"][..], &["a", "b"], &[]] {
            assert!(estimate_skeleton(&poses(names(few), 1.0)).is_err());
        }
    }
}
