//! A skeleton in motion as a mesh that viewers show: an octahedron per bone, as animation software
//! draws bones.

use super::{Animation, Bone, SkinnedMesh};
use crate::io::bvh::{BvhPoints, BvhTemplate, Joint};
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use glam::DVec3;
use ndarray::ArrayView2;

/// Where along a bone its octahedron is thickest, and how thick that is, as shares of its length.
const THICKEST: f64 = 0.15;
const THICKNESS: f64 = 0.09;
/// Bones shorter than this, cm, have no octahedron.
const SHORTEST: f64 = 0.5;

/// A skeleton as glTF has it: nodes that stand and turn in the world, and the straight pieces
/// between them.
struct Nodes {
    bones: Vec<Bone>,
    /// By piece: the node that it turns with, and where it starts and ends in the rest pose, cm.
    pieces: Vec<(usize, DVec3, DVec3)>,
    /// By node: the bone that it turns with.
    turning: Vec<usize>,
    /// By node: the bone at whose start it stands, or else at whose end.
    at: Vec<(usize, bool)>,
}

impl SkinnedMesh {
    /// The motion `values` (frames, degrees of freedom; radians and cm) of a skeleton as an
    /// animation with these `times` (frames; seconds, rising). The end of a chain is a bone
    /// NAME_end of its own, since glTF knows only where bones begin.
    ///
    /// # Panics
    /// The numbers of frames or values do not fit.
    pub fn of_skeleton(
        name: &str,
        skeleton: &Skeleton,
        values: ArrayView2<'_, f64>,
        times: &[f64],
    ) -> SkinnedMesh {
        let rest = skeleton.posture(&vec![0.0; skeleton.dof_count()]);
        let own = skeleton.bones().iter().enumerate();
        let own = own.map(|(b, bone)| Bone {
            name: bone.name.clone(),
            parent: bone.parent,
            at: meters(rest.starts[b]),
        });
        let count = skeleton.bones().len();
        let last = chain_ends(skeleton, &rest);
        let ends = last.iter().map(|&b| Bone {
            name: format!("{}_end", skeleton.bones()[b].name),
            parent: Some(b),
            at: meters(rest.ends[b]),
        });
        // An end turns as its bone does.
        let starts = (0..count).map(|b| (b, true));
        let nodes = Nodes {
            bones: own.chain(ends).collect(),
            pieces: (0..count)
                .map(|b| (b, rest.starts[b], rest.ends[b]))
                .collect(),
            turning: (0..count).chain(last.iter().copied()).collect(),
            at: starts.chain(last.iter().map(|&b| (b, false))).collect(),
        };
        nodes.animated(name, skeleton, values, times)
    }

    /// The motion `values` (frames, degrees of freedom; radians and cm) of the hierarchy of a BVH
    /// file as an animation with these `times` (frames; seconds, rising): a bone for each
    /// joint, and NAME_end for each End Site.
    ///
    /// # Panics
    /// The numbers of frames or values do not fit.
    pub fn of_template(
        name: &str,
        template: &BvhTemplate,
        values: ArrayView2<'_, f64>,
        times: &[f64],
    ) -> SkinnedMesh {
        let skeleton = &template.skeleton.skeleton;
        let rest = skeleton.posture(&vec![0.0; skeleton.dof_count()]);
        let joints = template.joints();
        let points = template.skeleton.points(BvhPoints::Origins);
        // End Sites follow the joints, in their order.
        let of_joint = |(j, joint): (usize, &Joint)| vec![Some(j); joint.ends.len()];
        let parents = (joints.iter().map(|j| j.parent))
            .chain(joints.iter().enumerate().flat_map(of_joint))
            .collect::<Vec<Option<usize>>>();
        let at = |n: usize| rest.ends[points[n].1];
        let pieces = parents.iter().enumerate();
        let turns_with = |n: usize| match parents[n] {
            Some(parent) if n >= joints.len() => points[parent].1,
            _ => points[n].1,
        };
        let nodes = Nodes {
            bones: (points.iter().zip(&parents).enumerate())
                .map(|(n, ((name, _), parent))| Bone {
                    name: name.clone(),
                    parent: *parent,
                    at: meters(at(n)),
                })
                .collect(),
            pieces: pieces
                .filter_map(|(n, parent)| Some(((*parent)?, at((*parent)?), at(n))))
                .collect(),
            turning: (0..points.len()).map(turns_with).collect(),
            at: points.iter().map(|(_, bone)| (*bone, false)).collect(),
        };
        nodes.animated(name, skeleton, values, times)
    }
}

impl Nodes {
    /// The mesh of the pieces, with the motion of the nodes.
    fn animated(
        self,
        name: &str,
        skeleton: &Skeleton,
        values: ArrayView2<'_, f64>,
        times: &[f64],
    ) -> SkinnedMesh {
        let rest = skeleton.posture(&vec![0.0; skeleton.dof_count()]);
        let mut mesh = SkinnedMesh {
            name: name.to_string(),
            ..SkinnedMesh::default()
        };
        for (bone, start, end) in self.pieces {
            push_octahedron(&mut mesh, bone as u16, start, end);
        }
        let postures: Vec<Posture> = (values.rows().into_iter())
            .map(|row| skeleton.posture(&row.to_vec()))
            .collect();
        // The axes of all bones are the world's in the rest pose.
        let turned = |p: &Posture| {
            let all = self.turning.iter();
            all.map(|&b| p.rotations[b] * rest.rotations[b].transpose())
                .collect()
        };
        let places = |p: &Posture| {
            let place = |&(b, starts): &(usize, bool)| match starts {
                true => p.starts[b] / 100.0,
                false => p.ends[b] / 100.0,
            };
            self.at.iter().map(place).collect()
        };
        let rotations: Vec<Vec<_>> = postures.iter().map(turned).collect();
        let places: Vec<Vec<_>> = postures.iter().map(places).collect();
        let first = times.first().copied().unwrap_or(0.0);
        let times = times.iter().map(|t| (t - first) as f32).collect();
        mesh.animations = vec![Animation::from_world(
            name,
            &self.bones,
            times,
            &rotations,
            &places,
        )];
        mesh.bones = self.bones;
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
    mesh.vertices.extend(all.map(meters));
    for i in 0..4 {
        let (a, b) = (first + 2 + i, first + 2 + (i + 1) % 4);
        mesh.faces.push([first, b, a]);
        mesh.faces.push([first + 1, a, b]);
    }
    mesh.weights
        .extend([[(bone, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]; 6]);
}

fn meters(v: DVec3) -> [f32; 3] {
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
        let values = array![[0.0, 0.0, 0.0, 0.0], [50.0, 0.4, -0.7, 1.1]];
        let times = [3.0, 3.5];
        let mesh = SkinnedMesh::of_skeleton("arm", &skeleton, values.view(), &times);
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

    #[test]
    fn a_bvh_skeleton_stands_where_its_joints_are() {
        let text = "HIERARCHY\nROOT a\n\
            {\nOFFSET 0 0 0\n\
            CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
            JOINT b\n{\nOFFSET 0 30 0\n\
            CHANNELS 3 Zrotation Xrotation Yrotation\n\
            End Site\n{\nOFFSET 0 0 20\n\
            }\n}\nJOINT c\n{\nOFFSET 9 0 0\n\
            CHANNELS 3 Zrotation Xrotation Yrotation\n\
            }\n}\nMOTION\nFrames: 1\n\
            Frame Time: 0.1\n\
            1 2 3 40 0 0 0 50 0 0 0 0\n";
        let input = crate::io::Input::new("t", std::io::Cursor::new(text.as_bytes())).unwrap();
        let bvh = crate::io::Bvh::read(input, 1.0, false).unwrap();
        let poses = bvh.to_poses().unwrap();
        let frame = bvh.motion.row(0).to_vec();
        let template = BvhTemplate::new(bvh, DMat3::IDENTITY).unwrap();
        let mut q = vec![0.0; template.skeleton.skeleton.dof_count()];
        template.skeleton.values(&frame, &mut q);
        let values = ndarray::Array2::from_shape_vec((1, q.len()), q).unwrap();
        let mesh = SkinnedMesh::of_template("t", &template, values.view(), &[0.0]);
        let names: Vec<&str> = mesh.bones.iter().map(|b| b.name.as_str()).collect();
        assert_eq!(names, ["a", "b", "c", "b_end"]);
        let animation = &mesh.animations[0];
        let mut world: Vec<(DQuat, DVec3)> = Vec::new();
        for (b, bone) in mesh.bones.iter().enumerate() {
            let own = Quat::from_array(animation.rotations[b][0]).as_dquat();
            let at = Vec3::from_array(animation.translations[b][0]).as_dvec3();
            let above = bone
                .parent
                .map_or((DQuat::IDENTITY, DVec3::ZERO), |p| world[p]);
            world.push((above.0 * own, above.1 + above.0 * at));
            let want = DVec3::from_array([0, 1, 2].map(|c| poses.xyz[[0, 3 * b + c]]));
            assert!((world[b].1 * 100.0 - want).length() < 1e-3, "{}", bone.name);
        }
        assert_eq!(mesh.faces.len(), 3 * 8);
    }
}
