//! The rest pose of a skeleton: its bind pose; of joints that it lacks, how they stand against
//! their parents in the file; without a bind pose, how they all do.

use crate::Result;
use crate::skeletons::Skeleton;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;
use ufbx::{Matrix, SceneRoot};

/// A placement in the world without its scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stance {
    /// The origin, cm.
    pub at: DVec3,
    /// The directions of the axes, of unit length: a rotation, or one and a reflection.
    pub axes: DMat3,
}

impl Stance {
    pub fn of(world: &DAffine3) -> Stance {
        let axes = world.matrix3;
        Stance {
            at: world.translation,
            // A scale that is not alike along all axes leaves them oblique below a turn.
            axes: DMat3::from_cols(
                axes.x_axis / axes.x_axis.length(),
                axes.y_axis / axes.y_axis.length(),
                axes.z_axis / axes.z_axis.length(),
            ),
        }
    }
}

/// The placements of the joints in the rest pose.
///
/// # Errors
/// [`crate::Error::Unfit`]: one is none.
pub(crate) fn rest_pose(scene: &SceneRoot, tree: &Skeleton) -> Result<Vec<Stance>> {
    let bound = bind_pose(scene);
    let mut worlds: Vec<DAffine3> = Vec::with_capacity(tree.nodes.len());
    for (i, node) in tree.nodes.iter().enumerate() {
        let node = &scene.nodes[*node];
        let still = affine(&node.node_to_world);
        let world = bound.get(&node.element.element_id).copied();
        worlds.push(world.unwrap_or_else(|| match tree.parents[i] {
            Some(p) if !bound.is_empty() => {
                let above = affine(&scene.nodes[tree.nodes[p]].node_to_world);
                worlds[p] * above.inverse() * still
            }
            _ => still,
        }));
    }
    for (world, node) in worlds.iter().zip(&tree.nodes) {
        let axes = Stance::of(world).axes;
        if !(axes.is_finite() && world.translation.is_finite()) {
            let name: &str = &scene.nodes[*node].element.name;
            let name = crate::excerpt(name);
            return Err(
                format!("the rest pose of \"{name}\" has values that are no numbers").into(),
            );
        }
    }
    Ok(worlds.iter().map(Stance::of).collect())
}

/// The placements of the nodes that a bind pose has; the first of each.
fn bind_pose(scene: &SceneRoot) -> HashMap<u32, DAffine3> {
    let mut worlds = HashMap::new();
    for pose in scene.poses.iter().filter(|pose| pose.is_bind_pose) {
        for bone in &pose.bone_poses {
            let id = bone.bone_node.element.element_id;
            worlds
                .entry(id)
                .or_insert_with(|| affine(&bone.bone_to_world));
        }
    }
    worlds
}

pub(crate) fn affine(m: &Matrix) -> DAffine3 {
    DAffine3::from_cols(
        DVec3::new(m.m00, m.m10, m.m20),
        DVec3::new(m.m01, m.m11, m.m21),
        DVec3::new(m.m02, m.m12, m.m22),
        DVec3::new(m.m03, m.m13, m.m23),
    )
}
