//! A skeleton in motion as a mesh that viewers show: an octahedron a bone, as animation software draws bones.

use super::{Animation, Bone, SkinnedMesh};
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use glam::DVec3;
use ndarray::ArrayView2;

/// Where along a bone its octahedron is thickest, and how thick that is, as shares of its length.
const THICKEST: f64 = 0.15;
const THICKNESS: f64 = 0.09;
/// Bones shorter than this, cm, have no octahedron.
const SHORTEST: f64 = 0.5;

impl SkinnedMesh {
    /// The motion `values` (frames, degrees of freedom; radians and cm) of a skeleton as an animation with these `times` (frames;
    /// seconds, rising). `names` are those of its bones. The end of a chain is a bone NAME_end of its own, since glTF knows only where bones
    /// begin.
    ///
    /// # Panics
    /// The numbers of frames, values or names do not fit.
    pub fn of_skeleton(
        name: &str,
        skeleton: &Skeleton,
        names: &[String],
        values: ArrayView2<'_, f64>,
        times: &[f64],
    ) -> SkinnedMesh {
        let rest = skeleton.posture(&vec![0.0; skeleton.dof_count()]);
        let own = skeleton.bones().iter().enumerate();
        let own = own.map(|(b, bone)| Bone {
            name: names[b].clone(),
            parent: bone.parent,
            at: metres(rest.starts[b]),
        });
        let last = chain_ends(skeleton, &rest);
        let ends = last.iter().map(|&b| Bone {
            name: format!("{}_end", names[b]),
            parent: Some(b),
            at: metres(rest.ends[b]),
        });
        let bones: Vec<Bone> = own.chain(ends).collect();
        let mut mesh = SkinnedMesh {
            name: name.to_string(),
            ..SkinnedMesh::default()
        };
        for b in 0..names.len() {
            push_octahedron(&mut mesh, b as u16, rest.starts[b], rest.ends[b]);
        }
        let postures: Vec<Posture> = (values.rows().into_iter())
            .map(|row| skeleton.posture(&row.to_vec()))
            .collect();
        // The axes of all bones are the world's in the rest pose. An end turns as its bone does.
        let turned = |p: &Posture| {
            let all = (0..names.len()).chain(last.iter().copied());
            all.map(|b| p.rotations[b] * rest.rotations[b].transpose())
                .collect()
        };
        let places = |p: &Posture| {
            let ends = last.iter().map(|&b| &p.ends[b]);
            p.starts.iter().chain(ends).map(|at| *at / 100.0).collect()
        };
        let rotations: Vec<Vec<_>> = postures.iter().map(turned).collect();
        let places: Vec<Vec<_>> = postures.iter().map(places).collect();
        let first = times.first().copied().unwrap_or(0.0);
        let times = times.iter().map(|t| (t - first) as f32).collect();
        mesh.animations = vec![Animation::from_world(
            name, &bones, times, &rotations, &places,
        )];
        mesh.bones = bones;
        mesh
    }
}

/// The bones without a bone after them, where they have a length.
fn chain_ends(skeleton: &Skeleton, rest: &Posture) -> Vec<usize> {
    let bones = skeleton.bones();
    let is_last = |b: &usize| bones.iter().all(|bone| bone.parent != Some(*b));
    let is_long = |b: &usize| (rest.ends[*b] - rest.starts[*b]).length() >= SHORTEST;
    (0..bones.len()).filter(is_last).filter(is_long).collect()
}

fn push_octahedron(mesh: &mut SkinnedMesh, bone: u16, start: DVec3, end: DVec3) {
    let length = (end - start).length();
    if length < SHORTEST {
        return;
    }
    let along = (end - start) / length;
    let side = along.any_orthonormal_vector();
    let across = along.cross(side);
    let middle = start + THICKEST * (end - start);
    let corners = [side, across, -side, -across].map(|d| middle + THICKNESS * length * d);
    let first = mesh.vertices.len() as u32;
    let all = [start, end].into_iter().chain(corners);
    mesh.vertices.extend(all.map(metres));
    for i in 0..4 {
        let (a, b) = (first + 2 + i, first + 2 + (i + 1) % 4);
        mesh.faces.push([first, b, a]);
        mesh.faces.push([first + 1, a, b]);
    }
    mesh.weights
        .extend([[(bone, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]; 6]);
}

fn metres(v: DVec3) -> [f32; 3] {
    (v / 100.0).as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use crate::pose::{Channel, Dof};
    use glam::{DMat3, DQuat, Quat, Vec3};
    use ndarray::array;

    /// Two bones of 40 and 30 cm that turn.
    fn arm() -> Skeleton {
        let bone = |name: &str, parent, offset, dofs| crate::pose::Bone {
            name: name.to_string(),
            parent,
            offset,
            axis: DMat3::from_rotation_x(0.3),
            dofs,
        };
        let turn = |axis| Dof::free(Channel::Rotate(axis));
        let root = vec![Dof::free(Channel::Translate(Axis::X)), turn(Axis::Z)];
        Skeleton::new(vec![
            bone("root", None, DVec3::ZERO, root),
            bone("upper", Some(0), DVec3::Y * 40.0, vec![turn(Axis::X)]),
            bone("lower", Some(1), DVec3::X * 30.0, vec![turn(Axis::Z)]),
        ])
        .unwrap()
    }

    #[test]
    fn vertices_follow_the_bones() {
        let skeleton = arm();
        let names: Vec<String> = skeleton.bones().iter().map(|b| b.name.clone()).collect();
        let values = array![[0.0, 0.0, 0.0, 0.0], [50.0, 0.4, -0.7, 1.1]];
        let times = [3.0, 3.5];
        let mesh = SkinnedMesh::of_skeleton("arm", &skeleton, &names, values.view(), &times);
        assert!(mesh.to_glb().unwrap().starts_with(b"glTF"));
        assert_eq!((mesh.vertices.len(), mesh.faces.len()), (12, 16));
        assert_eq!(mesh.animations[0].times, [0.0, 0.5]);
        // The tip of each bone is where kinematics has it.
        let posture = skeleton.posture(&values.row(1).to_vec());
        let animation = &mesh.animations[0];
        let mut world: Vec<(DQuat, DVec3)> = Vec::new();
        for (b, bone) in mesh.bones.iter().enumerate() {
            let own = Quat::from_array(animation.rotations[b][1]).as_dquat();
            let at = Vec3::from_array(animation.translations[b][1]).as_dvec3();
            world.push(match bone.parent {
                None => (own, at),
                Some(p) => (world[p].0 * own, world[p].1 + world[p].0 * at),
            });
        }
        for (vertex, weight) in mesh.vertices.iter().zip(&mesh.weights).skip(1).step_by(6) {
            let b = weight[0].0 as usize;
            let rest = Vec3::from_array(*vertex).as_dvec3()
                - Vec3::from_array(mesh.bones[b].at).as_dvec3();
            let now = world[b].1 + world[b].0 * rest;
            assert!((now * 100.0 - posture.ends[b]).length() < 1e-3, "{b}");
        }
        // The end of the chain is a bone of its own.
        assert_eq!(mesh.bones[3].name, "lower_end");
        assert!((world[3].1 * 100.0 - posture.ends[2]).length() < 1e-3);
    }
}
