//! What is posed: a skeleton, the joints that are shown and dragged, and the points of the model
//! that they are.

use crate::pose::{Skeleton, sides};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;

/// Fewer joints that the model knows do not place a pose.
const FEWEST_KNOWN: usize = 3;

/// A skeleton and its joints.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The skeleton that is solved for.
    pub skeleton: Skeleton,
    /// The names of the joints (K).
    pub names: Vec<String>,
    /// The bone at whose end each joint is (K).
    pub bones: Vec<usize>,
    /// The nearest joint above each (K).
    pub parents: Vec<Option<usize>>,
    /// The other of each left-right pair of joints (K).
    pub mirrors: Vec<Option<usize>>,
    /// The point of the model that each joint is (K).
    pub model_points: Vec<Option<usize>>,
}

impl Rig {
    /// A rig whose joints are the ends of all bones, with their names.
    ///
    /// ```
    /// use posing_edit::edit::Rig;
    /// use posing_io::Asf;
    ///
    /// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
    /// let rig = Rig::new(asf.skeleton, &posing_core::pose::joints::cmu_names())?;
    /// let (left, right) = (rig.find("lwrist"), rig.find("rwrist"));
    /// assert_eq!(left.and_then(|joint| rig.mirrors[joint]), right);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Rig::with_joints`].
    pub fn new(skeleton: Skeleton, model_points: &[String]) -> Result<Rig> {
        let bones = skeleton.bones().iter().enumerate();
        let joints: Vec<_> = bones.map(|(i, b)| (b.name.clone(), i)).collect();
        Rig::with_joints(skeleton, &joints, model_points, &BTreeMap::new())
    }

    /// A rig with these joints (names and the bones at whose ends they are). `map` names the joint
    /// that is each point of the model, such as `lhumerus` = `LeftForeArm`; points that it does
    /// not have are joints of their own names.
    ///
    /// # Errors
    /// [`Error::Usage`]: `map` names a joint or a point that there is not, or fewer than three
    /// joints are points of the model.
    pub fn with_joints(
        skeleton: Skeleton,
        joints: &[(String, usize)],
        model_points: &[String],
        map: &BTreeMap<String, String>,
    ) -> Result<Rig> {
        let names: Vec<String> = joints.iter().map(|j| j.0.clone()).collect();
        let bones: Vec<usize> = joints.iter().map(|j| j.1).collect();
        if let Some(unknown) = map.keys().find(|p| !model_points.contains(p)) {
            let what = format!("the map names a point \"{unknown}\" that the model does not have");
            return Err(Error::usage(what));
        }
        let mut points = vec![None; names.len()];
        for (p, point) in model_points.iter().enumerate() {
            let name = map.get(point).unwrap_or(point);
            match names.iter().position(|n| n == name) {
                Some(k) => points[k] = Some(p),
                None if map.contains_key(point) => {
                    let what =
                        format!("the map names a joint \"{name}\" that the skeleton does not have");
                    return Err(Error::usage(what));
                }
                None => {}
            }
        }
        if points.iter().flatten().count() < FEWEST_KNOWN {
            return Err(Error::usage(format!(
                "the model knows fewer than {FEWEST_KNOWN} joints of the skeleton; say with the \
                 option `map` which joints are its points ({}, ...)",
                model_points[..model_points.len().min(4)].join(", ")
            )));
        }
        let parents = skeleton.nearest_above(&bones);
        Ok(Rig {
            mirrors: mirrors(&names, &points, model_points),
            skeleton,
            names,
            bones,
            parents,
            model_points: points,
        })
    }

    /// The number of joints, K.
    pub fn joints(&self) -> usize {
        self.names.len()
    }

    /// The joint of a name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// The positions (3 K, cm) of the joints for the skeleton's values `q`.
    pub fn positions(&self, q: &[f64]) -> Vec<f64> {
        let posture = self.skeleton.posture(q);
        let ends = self.bones.iter().map(|&b| posture.ends[b]);
        ends.flat_map(|p: DVec3| p.to_array()).collect()
    }

    /// The mirror image of the joints `xyz` (3 K, cm) with left and right exchanged: about the
    /// upright plane through the first joint that the pairs of joints stand across.
    pub fn mirrored(&self, xyz: &[f64]) -> Vec<f64> {
        let at = |k: usize| DVec3::from_slice(&xyz[3 * k..]);
        // Each pair once: the first of it to the second.
        let pairs = self.mirrors.iter().enumerate();
        let pairs = pairs.filter_map(|(k, m)| m.filter(|m| k < *m).map(|m| (k, m)));
        let across: DVec3 = pairs.map(|(k, m)| at(m) - at(k)).sum();
        let across = across.with_y(0.0).try_normalize().unwrap_or(DVec3::X);
        let image = |k: usize| at(k) - across * (2.0 * (at(k) - at(0)).dot(across));
        let mirrored = (0..self.joints()).map(|k| image(self.mirrors[k].unwrap_or(k)));
        mirrored.flat_map(|p| p.to_array()).collect()
    }

    /// Positions of joints (3 K, cm) in the model's order of `points` (3 J); NaN for those that are
    /// no joints.
    pub fn to_model(&self, xyz: &[f64], points: usize) -> Vec<f64> {
        let mut out = vec![f64::NAN; 3 * points];
        for (k, point) in self.model_points.iter().enumerate() {
            if let Some(p) = *point {
                out[3 * p..3 * p + 3].copy_from_slice(&xyz[3 * k..3 * k + 3]);
            }
        }
        out
    }
}

/// The other of each pair: by the points of the model, or else by the joints' own names.
fn mirrors(
    names: &[String],
    points: &[Option<usize>],
    model_points: &[String],
) -> Vec<Option<usize>> {
    let other = |k: usize| {
        let by_point = points[k]
            .and_then(|p| sides::mirrored(model_points, p))
            .and_then(|m| points.iter().position(|p| *p == Some(m)));
        by_point.or_else(|| sides::mirrored(names, k))
    };
    let found: Vec<Option<usize>> = (0..names.len()).map(other).collect();
    // Only where both say so.
    let is_pair = |k: &usize| found[*k].is_some_and(|m| m != *k && found[m] == Some(*k));
    (0..names.len())
        .map(|k| found[k].filter(|_| is_pair(&k)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::{Bone, Channel, Dof};
    use glam::DMat3;

    fn skeleton(names: &[&str]) -> Skeleton {
        let bone = |(i, name): (usize, &&str)| Bone {
            name: name.to_string(),
            parent: i.checked_sub(1),
            offset: DVec3::Y * (i as f64),
            axis: DMat3::IDENTITY,
            dofs: vec![Dof::free(Channel::parse("rx").unwrap())],
        };
        Skeleton::new(names.iter().enumerate().map(bone).collect()).unwrap()
    }

    fn owned(names: &[&str]) -> Vec<String> {
        names.iter().map(|s| s.to_string()).collect()
    }

    #[test]
    fn joints_are_points_of_their_names_or_of_the_map() {
        let points = owned(&["root", "lfoot", "rfoot", "head"]);
        let rig = Rig::new(skeleton(&["root", "tail", "rfoot", "lfoot"]), &points).unwrap();
        assert_eq!(rig.model_points, [Some(0), None, Some(2), Some(1)]);
        assert_eq!(rig.mirrors, [None, None, Some(3), Some(2)]);
        assert_eq!(rig.parents, [None, Some(0), Some(1), Some(2)]);
        let xyz: Vec<f64> = (0..12).map(f64::from).collect();
        let there = rig.to_model(&xyz, 4);
        assert_eq!(there[3..6], [9.0, 10.0, 11.0]);
        assert!(there[9].is_nan());

        let map = BTreeMap::from([("head".to_string(), "Kopf".to_string())]);
        let joints = [("Kopf", 2), ("lfoot", 3), ("root", 0)].map(|(n, b)| (n.to_string(), b));
        let parts = || skeleton(&["a", "b", "c", "d"]);
        let rig = Rig::with_joints(parts(), &joints, &points, &map).unwrap();
        assert_eq!(rig.model_points, [Some(3), Some(1), Some(0)]);
        assert_eq!(rig.parents, [Some(2), Some(0), None]);
    }

    #[test]
    fn a_mirror_image_exchanges_left_and_right() {
        let points = owned(&["root", "lfoot", "rfoot"]);
        let rig = Rig::new(skeleton(&["root", "lfoot", "rfoot"]), &points).unwrap();
        // Turned by 90 degrees: left is along z.
        let xyz = [1.0, 90.0, 2.0, 5.0, 1.0, 12.0, 0.0, 3.0, -9.0];
        let mirrored = rig.mirrored(&xyz);
        assert_eq!(mirrored[..3], xyz[..3]);
        let again = rig.mirrored(&mirrored);
        assert!(again.iter().zip(&xyz).all(|(a, b)| (a - b).abs() < 1e-9));
        assert_eq!((mirrored[4], mirrored[7]), (3.0, 1.0));
    }

    #[test]
    fn a_wrong_map_and_a_strange_skeleton_are_refused() {
        let points = owned(&["root", "lfoot", "rfoot"]);
        let strange = Rig::new(skeleton(&["root", "b", "c"]), &points).unwrap_err();
        assert!(
            strange.to_string().contains("the option `map`"),
            "{strange}"
        );
        let joints = ["root", "lfoot", "rfoot"].map(|n| (n.to_string(), 0));
        for (point, joint, what) in [
            ("nose", "root", "point \"nose\""),
            ("root", "x", "joint \"x\""),
        ] {
            let map = BTreeMap::from([(point.to_string(), joint.to_string())]);
            let said = Rig::with_joints(skeleton(&["a"]), &joints, &points, &map).unwrap_err();
            assert!(said.to_string().contains(what), "{said}");
        }
    }
}
