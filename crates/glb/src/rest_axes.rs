//! Axes of bones in the rest pose: y along the bone.
//!
//! glTF knows only where bones begin. Blender's importer draws a bone along its own y axis, as long
//! as the nearest child is away; so y has to point to the child that goes on.

use super::Bone;
use glam::{DMat3, DQuat, DVec3};

/// Children nearer than this, meters, stand where their bone does. (Blender's importer has the
/// same.)
pub(crate) const TOGETHER: f64 = 0.004;
/// Bones that lie so nearly along the world's x axis, by the cosine, have z to the front; others x
/// to the side.
const SIDEWAYS: f64 = 0.8;

impl Bone {
    /// Turns the axes of all `bones` in the rest pose: y points to the child that goes on, x as
    /// far as may be to the left of the world, or z to the front for what lies sideways.
    ///
    /// The child that goes on is the straightest; on the root, the one that carries most bones.
    /// What has no child lies on as its parent does. Bones in a circle are left as they are.
    #[doc(hidden)]
    pub fn point_along(bones: &mut [Bone]) {
        let tree = Tree::of(bones);
        let mut along = tree.directions();
        for &b in &tree.order {
            along[b] = along[b].or(tree.parents[b].and_then(|p| along[p]));
            if let Some(y) = along[b] {
                let q = DQuat::from_mat3(&axes(y)).normalize();
                bones[b].rotation = q.as_quat().to_array();
            }
        }
    }

    /// The axes in the world in the rest pose, as columns.
    pub(crate) fn axes(&self) -> DMat3 {
        DMat3::from_quat(DQuat::from_array(self.rotation.map(f64::from)).normalize())
    }

    pub(crate) fn position(&self) -> DVec3 {
        DVec3::from(self.at.map(f64::from))
    }
}

/// The unit axes with this y.
fn axes(y: DVec3) -> DMat3 {
    let (x, z) = if y.x.abs() < SIDEWAYS {
        let x = (DVec3::X - y.x * y).normalize();
        (x, x.cross(y))
    } else {
        let z = (DVec3::Z - y.z * y).normalize();
        (y.cross(z), z)
    };
    DMat3::from_cols(x, y, z)
}

/// Bones by what they carry.
struct Tree {
    positions: Vec<DVec3>,
    parents: Vec<Option<usize>>,
    children: Vec<Vec<usize>>,
    /// How many bones each carries, itself among them.
    carried: Vec<usize>,
    /// Parents before children.
    order: Vec<usize>,
}

impl Tree {
    fn of(bones: &[Bone]) -> Tree {
        let parents: Vec<Option<usize>> = (bones.iter())
            .map(|b| b.parent.filter(|p| *p < bones.len()))
            .collect();
        let mut children = vec![Vec::new(); bones.len()];
        let mut order = Vec::new();
        for (b, parent) in parents.iter().enumerate() {
            match parent {
                Some(p) => children[*p].push(b),
                None => order.push(b),
            }
        }
        let mut next = 0;
        while let Some(&b) = order.get(next) {
            order.extend(&children[b]);
            next += 1;
        }
        let mut carried = vec![1; bones.len()];
        for &b in order.iter().rev() {
            carried[b] += children[b].iter().map(|c| carried[*c]).sum::<usize>();
        }
        Tree {
            positions: bones.iter().map(Bone::position).collect(),
            parents,
            children,
            carried,
            order,
        }
    }

    /// The direction of each bone; `None` for those that carry nothing away from them.
    fn directions(&self) -> Vec<Option<DVec3>> {
        // By bone: the direction in which one comes to it from the last position above it.
        let mut toward: Vec<Option<DVec3>> = vec![None; self.positions.len()];
        for &b in &self.order {
            let from = self.parents[b];
            toward[b] = from.and_then(|p| self.step(p, b).or(toward[p]));
        }
        let mut along = vec![None; self.positions.len()];
        for &b in self.order.iter().rev() {
            let steps = self.children[b].iter().map(|c| (*c, self.step(b, *c)));
            let straightness = |step: Option<DVec3>| step?.dot(toward[b]?).into();
            let better = |best: (usize, Option<DVec3>), next: (usize, Option<DVec3>)| {
                let rank = |(c, step): (usize, Option<DVec3>)| -> (bool, f64, usize) {
                    let straight: Option<f64> = straightness(step);
                    (step.is_some(), straight.unwrap_or(0.0), self.carried[c])
                };
                if rank(next) > rank(best) { next } else { best }
            };
            let main = steps.reduce(better);
            // Where all children are at the same position, one of them goes on for it.
            along[b] = main.and_then(|(c, step)| step.or(along[c]));
        }
        along
    }

    fn step(&self, from: usize, to: usize) -> Option<DVec3> {
        let step = self.positions[to] - self.positions[from];
        (step.length() > TOGETHER).then(|| step.normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bones(list: &[(Option<usize>, [f32; 3])]) -> Vec<Bone> {
        let bone = |(parent, at): &(Option<usize>, [f32; 3])| Bone {
            parent: *parent,
            at: *at,
            ..Bone::default()
        };
        let mut bones: Vec<Bone> = list.iter().map(bone).collect();
        Bone::point_along(&mut bones);
        bones
    }

    fn y_of(bone: &Bone) -> DVec3 {
        bone.axes().y_axis
    }

    #[test]
    fn y_points_to_the_child_that_goes_on() {
        let bones = bones(&[
            (None, [0.0, 1.0, 0.0]),
            // A leg and its end, before the spine.
            (Some(0), [0.1, 0.9, 0.0]),
            (Some(1), [0.1, 0.0, 0.0]),
            // The spine, with an arm, a collar at the same position, and the neck.
            (Some(0), [0.0, 1.3, 0.0]),
            (Some(3), [0.5, 1.3, 0.0]),
            (Some(3), [0.0, 1.3, 0.0]),
            (Some(3), [0.0, 1.5, 0.1]),
            (Some(6), [0.0, 1.5, 0.1]),
        ]);
        let along = |b: usize, direction: [f64; 3]| {
            let away = (y_of(&bones[b]) - DVec3::from(direction).normalize()).length();
            assert!(away < 1e-6, "{b}: {:?}", y_of(&bones[b]));
            let axes = bones[b].axes();
            assert!((axes.determinant() - 1.0).abs() < 1e-6);
        };
        along(0, [0.0, 0.3, 0.0]);
        along(1, [0.0, -0.9, 0.0]);
        along(3, [0.0, 0.2, 0.1]);
        // What has no child, or one at its own position, lies on as its parent does.
        along(2, [0.0, -0.9, 0.0]);
        along(6, [0.0, 0.2, 0.1]);
        along(7, [0.0, 0.2, 0.1]);
        // Left to the side, or z to the front.
        assert!(bones[1].axes().x_axis.x > 0.99);
        let arm = super::axes(DVec3::X);
        assert_eq!(arm.z_axis, DVec3::Z);
    }

    #[test]
    fn bones_at_one_position_keep_their_axes() {
        let bones = bones(&[(None, [0.0; 3]), (Some(0), [0.0; 3])]);
        assert!(bones.iter().all(|b| b.axes() == DMat3::IDENTITY));
        Bone::point_along(&mut []);
        let mut circle = vec![
            Bone {
                parent: Some(1),
                ..Bone::default()
            },
            Bone {
                parent: Some(0),
                ..Bone::default()
            },
        ];
        Bone::point_along(&mut circle);
        assert_eq!(circle[0].rotation, Bone::default().rotation);
    }
}
