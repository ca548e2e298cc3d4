//! A person who stands, for tests of this crate and of those above it.

use crate::metric::JointMap;
use crate::metric::joint_map::JOINTS;
use crate::pose::Poses;
use glam::DVec3;
use ndarray::Array2;

/// The map of tables whose points have the joints' own names.
pub(crate) fn own_names() -> JointMap {
    JointMap::new(JOINTS.map(|j| (j.to_string(), j.to_string())).into()).unwrap()
}

/// A take of one pose, cm.
pub(crate) fn take_of(frames: &[[DVec3; 16]]) -> Poses {
    Poses {
        points: JOINTS.map(String::from).into(),
        xyz: Array2::from_shape_fn((frames.len(), 48), |(t, c)| frames[t][c / 3][c % 3]),
        time: Some((0..frames.len()).map(|t| t as f64 / 10.0).collect()),
        take: None,
    }
}

/// A person who stands upright and looks along z, cm: 160 from ankle to head.
pub(crate) fn standing() -> [DVec3; 16] {
    let p = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    [
        p(0.0, 90.0),
        p(0.0, 120.0),
        p(0.0, 140.0),
        p(0.0, 160.0),
        p(20.0, 140.0),
        p(50.0, 140.0),
        p(75.0, 140.0),
        p(-20.0, 140.0),
        p(-50.0, 140.0),
        p(-75.0, 140.0),
        p(10.0, 90.0),
        p(10.0, 50.0),
        p(10.0, 0.0),
        p(-10.0, 90.0),
        p(-10.0, 50.0),
        p(-10.0, 0.0),
    ]
}
