//! A skeleton measured from a table: CMU's joints by name, bones as long as they are in the median
//! frame.
//!
//! Every bone is a ball joint. Its rest pose is CMU's: upright, facing z, arms level.

use crate::pose::joints::{CMU, parents_by_name};
use crate::pose::rotation::Axis;
use crate::pose::{Body, Bone, Channel, Dof, Poses, Skeleton};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// CMU's rest pose: the mean over 17 subjects, left and right made equal; centimeters from the
/// root.
#[rustfmt::skip]
const REST: [[f64; 3]; 23] = [
    [0.0, 0.0, 0.0],
    [9.2, -9.9, 4.1], [22.9, -47.5, 4.1], [37.7, -88.1, 4.1], [38.7, -90.9, 15.7],
    [-9.2, -9.9, 4.1], [-22.9, -47.5, 4.1], [-37.7, -88.1, 4.1], [-38.7, -90.9, 15.7],
    [0.0, 11.6, -1.1], [0.0, 23.2, -1.1], [0.0, 34.9, -0.7],
    [0.0, 44.4, 0.1], [0.0, 53.9, -1.2], [0.0, 63.7, -1.8],
    [18.2, 41.1, -1.4], [48.1, 41.1, -1.4], [66.6, 41.1, -1.4], [75.8, 41.1, -1.4],
    [-18.2, 41.1, -1.4], [-48.1, 41.1, -1.4], [-66.6, 41.1, -1.4], [-75.8, 41.1, -1.4],
];

/// The skeleton of a table's points; its bones have the points' names.
///
/// Points that CMU does not know, or that hang on nothing the table shows, are no bones of it.
/// Bones that no frame shows from end to end are as long as CMU's mean.
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
    let mut place = vec![None; names.len()];
    let mut bones: Vec<Bone> = Vec::new();
    for k in body.order() {
        if top(k) != root {
            continue;
        }
        let rotations = [Axis::X, Axis::Y, Axis::Z].map(Channel::Rotate);
        let (parent, offset, channels) = match parents[k] {
            None => {
                let slides = [Axis::X, Axis::Y, Axis::Z].map(Channel::Translate);
                (None, DVec3::ZERO, [slides, rotations].concat())
            }
            Some(p) => {
                let rest = at(k) - at(p);
                let length = Some(body.lengths[k]).filter(|l| l.is_finite());
                let direction = rest.try_normalize().unwrap_or(DVec3::Y);
                let offset = direction * length.unwrap_or(rest.length());
                (place[p], offset, rotations.to_vec())
            }
        };
        place[k] = Some(bones.len());
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
