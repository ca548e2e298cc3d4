//! The points of a table that are joints of a skeleton.

use crate::pose::Poses;
use ndarray::Array2;

/// The points of a table that are joints of a skeleton.
#[derive(Debug, Clone, Default)]
pub struct Correspondence {
    /// The bone of each.
    pub joints: Vec<usize>,
    /// The points' names.
    pub names: Vec<String>,
    /// Which points of the table they are.
    pub columns: Vec<usize>,
    /// Their coordinates: (frames, 3 of each), centimeters.
    pub xyz: Array2<f64>,
    /// The names of points that are no joints.
    pub unmatched: Vec<String>,
}

/// Keeps the points for which `joints` gives a bone.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_joints::ik::correspondence::match_points;
///
/// let points = ["hat", "knee"].map(String::from).to_vec();
/// let xyz = ndarray::array![[0.0, 170.0, 0.0, 0.0, 45.0, 5.0]];
/// let poses = Poses { points, xyz, ..Poses::default() };
/// let matched = match_points(&poses, &[None, Some(3)]); // the knee is the end of bone 3
/// assert_eq!((matched.joints, matched.unmatched), (vec![3], vec!["hat".to_string()]));
/// assert_eq!(matched.xyz, ndarray::array![[0.0, 45.0, 5.0]]);
/// ```
pub fn match_points(poses: &Poses, joints: &[Option<usize>]) -> Correspondence {
    let mut out = Correspondence::default();
    let mut columns = Vec::new();
    for (k, (name, joint)) in poses.points.iter().zip(joints).enumerate() {
        match *joint {
            Some(bone) => {
                out.joints.push(bone);
                out.names.push(name.clone());
                out.columns.push(k);
                columns.extend([3 * k, 3 * k + 1, 3 * k + 2]);
            }
            None => out.unmatched.push(name.clone()),
        }
    }
    out.xyz = poses.xyz.select(ndarray::Axis(1), &columns);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_matched_by_name() {
        let poses = Poses {
            points: ["a", "b", "c"].map(String::from).to_vec(),
            xyz: Array2::from_shape_fn((1, 9), |(_, j)| j as f64),
            ..Poses::default()
        };
        let m = match_points(&poses, &[Some(1), None, Some(0)]);
        assert_eq!(m.names, ["a", "c"]);
        assert_eq!(m.xyz.as_slice().unwrap(), [0., 1., 2., 6., 7., 8.]);
        assert_eq!(m.unmatched, ["b"]);
    }
}
