//! A skeleton in motion as a skinned body that viewers show and animation software takes.

use super::mannequin::{Joint, push_body};
use super::rest_axes::TOGETHER;
use super::{Animation, Bone, SkinnedMesh};
use crate::Result;
use crate::bvh::{Bvh, BvhPoints, BvhTemplate};
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};

/// Chains that end in a bone shorter than this, cm, have no NAME_end.
const SHORTEST: f64 = 0.5;

/// A skeleton as glTF has it: nodes that stand and turn in the world, and the joints between which
/// the body lies.
struct Nodes {
    bones: Vec<Bone>,
    joints: Vec<Joint>,
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
            ..Bone::default()
        });
        let count = skeleton.bones().len();
        let last = chain_ends(skeleton, &rest);
        let ends = last.iter().map(|&b| Bone {
            name: format!("{}_end", skeleton.bones()[b].name),
            parent: Some(b),
            at: meters(rest.ends[b]),
            ..Bone::default()
        });
        // An end turns as its bone does.
        let starts = (0..count).map(|b| (b, true));
        let nodes = Nodes {
            bones: own.chain(ends).collect(),
            joints: (skeleton.bones().iter().enumerate())
                .map(|(b, bone)| Joint {
                    name: bone.name.clone(),
                    parent: bone.parent,
                    at: rest.ends[b],
                    bone: b as u16,
                    carrier: b as u16,
                })
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
        let ends = joints.iter().enumerate();
        let ends = ends.flat_map(|(j, joint)| vec![Some(j); joint.ends.len()]);
        let parents: Vec<Option<usize>> = joints.iter().map(|j| j.parent).chain(ends).collect();
        let at = |n: usize| rest.ends[points[n].1];
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
                    ..Bone::default()
                })
                .collect(),
            joints: (points.iter().zip(&parents).enumerate())
                .map(|(n, ((name, _), parent))| Joint {
                    name: name.clone(),
                    parent: *parent,
                    at: at(n),
                    bone: parent.unwrap_or(n) as u16,
                    carrier: n as u16,
                })
                .collect(),
            turning: (0..points.len()).map(turns_with).collect(),
            at: points.iter().map(|(_, bone)| (*bone, false)).collect(),
        };
        nodes.animated(name, skeleton, values, times)
    }

    /// A BVH file's hierarchy with its motion, as [`SkinnedMesh::of_template`] has it; `turn`
    /// carries the file's axes to y up, and `rate` is in frames a second.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: it has no frames, or values that are missing, which glTF cannot
    /// say.
    pub fn of_bvh(name: &str, bvh: &Bvh, turn: DMat3, rate: f64) -> Result<SkinnedMesh> {
        if bvh.motion.is_empty() {
            return Err("has no frames".into());
        }
        if !bvh.missing().is_empty() {
            let what =
                "has missing values (nan), which GLB cannot say: fill them with `posing clean`";
            return Err(what.into());
        }
        let template = BvhTemplate::new(bvh.clone(), turn)?;
        let count = template.skeleton.skeleton.dof_count();
        let mut values = Array2::zeros((bvh.motion.nrows(), count));
        for (frame, mut to) in bvh.motion.rows().into_iter().zip(values.rows_mut()) {
            let mut q = vec![0.0; count];
            template.skeleton.values(&frame.to_vec(), &mut q);
            to.iter_mut().zip(q).for_each(|(to, q)| *to = q);
        }
        let times: Vec<f64> = (0..values.nrows()).map(|t| t as f64 / rate).collect();
        Ok(SkinnedMesh::of_template(
            name,
            &template,
            values.view(),
            &times,
        ))
    }
}

impl Nodes {
    /// The body, with the motion of the nodes.
    fn animated(
        mut self,
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
        push_body(&mut mesh, &self.joints);
        Bone::point_along(&mut self.bones);
        let postures: Vec<Posture> = (values.rows().into_iter())
            .map(|row| skeleton.posture(&row.to_vec()))
            .collect();
        // Since the rest pose.
        let turned = |p: &Posture| {
            let all = self.turning.iter();
            all.map(|&b| p.rotations[b] * rest.rotations[b].transpose())
                .collect()
        };
        let positions = |p: &Posture| {
            let position = |&(b, starts): &(usize, bool)| {
                if starts {
                    p.starts[b] / 100.0
                } else {
                    p.ends[b] / 100.0
                }
            };
            self.at.iter().map(position).collect()
        };
        let mut rotations: Vec<Vec<DMat3>> = postures.iter().map(turned).collect();
        let mut positions: Vec<Vec<DVec3>> = postures.iter().map(positions).collect();
        if let Some(end) = end_of_root(&self.bones) {
            let along = end.position() - self.bones[0].position();
            for (rotations, positions) in rotations.iter_mut().zip(&mut positions) {
                positions.push(positions[0] + rotations[0] * along);
                rotations.push(rotations[0]);
            }
            self.bones.push(end);
        }
        let first = times.first().copied().unwrap_or(0.0);
        let times = times.iter().map(|t| (t - first) as f32).collect();
        mesh.animations = vec![Animation::from_world(
            name,
            &self.bones,
            times,
            &rotations,
            &positions,
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

/// An end for a root all of whose children stand where it does: importers would draw it a meter
/// long. It is as far away as the nearest bone that is not there.
fn end_of_root(bones: &[Bone]) -> Option<Bone> {
    let root = bones.first()?;
    let away = |b: &Bone| Some((b.position() - root.position()).length()).filter(|d| *d > TOGETHER);
    if bones
        .iter()
        .any(|b| b.parent == Some(0) && away(b).is_some())
    {
        return None;
    }
    let length = bones.iter().filter_map(away).reduce(f64::min)?;
    let at = root.position() + length * root.axes().y_axis;
    Some(Bone {
        name: format!("{}_end", root.name),
        parent: Some(0),
        at: at.as_vec3().to_array(),
        rotation: root.rotation,
    })
}

fn meters(v: DVec3) -> [f32; 3] {
    (v / 100.0).as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use crate::pose::{Channel, Dof};
    use glam::{DQuat, Quat, Vec3};
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

    /// The rotation and the position, meters, of each node in the world at a key.
    fn world(mesh: &SkinnedMesh, key: usize) -> Vec<(DQuat, DVec3)> {
        let animation = &mesh.animations[0];
        let mut world: Vec<(DQuat, DVec3)> = Vec::new();
        for (b, bone) in mesh.bones.iter().enumerate() {
            let own = Quat::from_array(animation.rotations[b][key]).as_dquat();
            let at = Vec3::from_array(animation.translations[b][key]).as_dvec3();
            let above = bone
                .parent
                .map_or((DQuat::IDENTITY, DVec3::ZERO), |p| world[p]);
            world.push((above.0 * own, above.1 + above.0 * at));
        }
        world
    }

    #[test]
    fn nodes_follow_the_bones() {
        let skeleton = arm();
        let values = array![[0.0, 0.0, 0.0, 0.0], [50.0, 0.4, -0.7, 1.1]];
        let times = [3.0, 3.5];
        let mesh = SkinnedMesh::of_skeleton("arm", &skeleton, values.view(), &times);
        assert!(mesh.to_glb().unwrap().starts_with(b"glTF"));
        assert_eq!(mesh.animations[0].times, [0.0, 0.5]);
        let names: Vec<&str> = mesh.bones.iter().map(|b| b.name.as_str()).collect();
        assert_eq!(names, ["root", "upper", "lower", "lower_end", "root_end"]);
        let posture = skeleton.posture(&values.row(1).to_vec());
        let rest = skeleton.posture(&values.row(0).to_vec());
        let world = world(&mesh, 1);
        for b in 0..3 {
            assert!((world[b].1 * 100.0 - posture.starts[b]).length() < 1e-3);
            // The bone turns as kinematics has it, and lies along its node's y axis.
            let turned = posture.rotations[b] * rest.rotations[b].transpose();
            let now = DMat3::from_quat(world[b].0);
            assert!(now.abs_diff_eq(turned * mesh.bones[b].axes(), 1e-6), "{b}");
            let along = (posture.ends[b] - posture.starts[b]).normalize_or(now.y_axis);
            assert!((now.y_axis - along).length() < 1e-5, "{b}");
        }
        assert!((world[3].1 * 100.0 - posture.ends[2]).length() < 1e-3);
        // The root, whose child stands where it does, has an end of its own.
        let end = posture.starts[0] + posture.rotations[0] * DVec3::Y * 40.0;
        assert!((world[4].1 * 100.0 - end).length() < 1e-3);
        // Two tubes.
        assert_eq!(mesh.vertices.len() - mesh.faces.len() / 2, 4);
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
        let input = posing_io::Input::new("t", std::io::Cursor::new(text.as_bytes())).unwrap();
        let bvh = posing_io::Bvh::read(input, 1.0, false).unwrap();
        let poses = bvh.to_poses().unwrap();
        let frame = bvh.motion.row(0).to_vec();
        let template = BvhTemplate::new(bvh, DMat3::IDENTITY).unwrap();
        let mut q = vec![0.0; template.skeleton.skeleton.dof_count()];
        template.skeleton.values(&frame, &mut q);
        let values = ndarray::Array2::from_shape_vec((1, q.len()), q).unwrap();
        let mesh = SkinnedMesh::of_template("t", &template, values.view(), &[0.0]);
        let names: Vec<&str> = mesh.bones.iter().map(|b| b.name.as_str()).collect();
        assert_eq!(names, ["a", "b", "c", "b_end"]);
        for (b, (_, at)) in world(&mesh, 0).into_iter().enumerate() {
            let want = DVec3::from_array([0, 1, 2].map(|c| poses.xyz[[0, 3 * b + c]]));
            assert!((at * 100.0 - want).length() < 1e-3, "{}", names[b]);
        }
        let y_of = |b: usize| mesh.bones[b].axes().y_axis;
        assert!((y_of(0) - DVec3::Y).length() < 1e-6 && (y_of(1) - DVec3::Z).length() < 1e-6);
        // A tube for each of the three bones.
        assert_eq!(mesh.vertices.len() - mesh.faces.len() / 2, 6);
    }
}
