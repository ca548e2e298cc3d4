//! The JSON of a file: one scene of a mesh and its skeleton.
//!
//! Node b is bone b. Then comes the node that all bones without a parent hang on, and the mesh's
//! node. The mesh's node stands at the scene's root, as its own position does not count: bones
//! carry its vertices.

use super::buffer::{Buffer, container};
use super::{Animation, SkinnedMesh, normals};
use crate::{Error, Place, Result};
use glam::{DMat3, DMat4, DQuat, DVec3};
use gltf_json::animation::{Channel, Interpolation, Property, Sampler, Target};
use gltf_json::buffer::Target as View;
use gltf_json::extras::RawValue;
use gltf_json::material::{PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mode, MorphTarget, Primitive, Semantic};
use gltf_json::scene::UnitQuaternion;
use gltf_json::validation::{Checked::Valid, USize64};
use gltf_json::{Accessor, Index, Material, Mesh, Node, Root, Scene, Skin};

/// A light skin tone, linear RGBA.
const SKIN_TONE: [f32; 4] = [0.60, 0.42, 0.33, 1.0];
const ROUGHNESS: f32 = 0.7;

/// The bytes of a file of a mesh that was checked.
pub(crate) fn write(mesh: &SkinnedMesh) -> Result<Vec<u8>> {
    let (mut root, mut buffer) = (Root::default(), Buffer::default());
    root.asset.generator = Some(concat!("posing ", env!("CARGO_PKG_VERSION")).into());
    skeleton(mesh, &mut root);
    let surface = surface(mesh, &mut root, &mut buffer)?;
    let skin = (!mesh.bones.is_empty()).then(|| skin(mesh, &mut root, &mut buffer));
    let node = root.push(Node {
        mesh: Some(surface),
        skin,
        name: Some(mesh.name.clone()),
        ..Node::default()
    });
    for animation in &mesh.animations {
        animate(animation, node, &mut root, &mut buffer);
    }
    let skeleton = (!mesh.bones.is_empty()).then(|| index(mesh.bones.len()));
    let scene = Scene {
        nodes: skeleton.into_iter().chain([node]).collect(),
        name: None,
        extensions: None,
        extras: None,
    };
    root.scene = Some(root.push(scene));
    root.push(gltf_json::Buffer {
        byte_length: USize64::from(buffer.bytes.len()),
        name: None,
        uri: None,
        extensions: None,
        extras: None,
    });
    let json = root.to_vec().map_err(|e| fail(&e.to_string()))?;
    container(json, &buffer.bytes).ok_or_else(|| fail("is larger than 4 GiB"))
}

fn fail(what: &str) -> Error {
    Error::data(Place::file("the mesh"), what)
}

fn index<T>(k: usize) -> Index<T> {
    Index::new(k as u32)
}

/// The nodes of the bones, and the one they hang on.
fn skeleton(mesh: &SkinnedMesh, root: &mut Root) {
    let children = |parent: Option<usize>| {
        let of = (0..mesh.bones.len()).filter(|b| mesh.bones[*b].parent == parent);
        let children: Vec<Index<Node>> = of.map(index).collect();
        (!children.is_empty()).then_some(children)
    };
    for (b, bone) in mesh.bones.iter().enumerate() {
        let above = bone.parent.map(|p| &mesh.bones[p]);
        let (back, origin) = above.map_or((DMat3::IDENTITY, DVec3::ZERO), |p| {
            (p.axes().transpose(), p.position())
        });
        let rotation = DQuat::from_mat3(&(back * bone.axes())).normalize();
        let translation = back * (bone.position() - origin);
        root.push(Node {
            name: Some(bone.name.clone()),
            rotation: Some(UnitQuaternion(rotation.as_quat().to_array())),
            translation: Some(translation.as_vec3().to_array()),
            children: children(Some(b)),
            ..Node::default()
        });
    }
    if !mesh.bones.is_empty() {
        root.push(Node {
            name: Some(format!("{} skeleton", mesh.name)),
            children: children(None),
            ..Node::default()
        });
    }
}

/// The triangles, normals, weights, morph targets and the material.
fn surface(mesh: &SkinnedMesh, root: &mut Root, buffer: &mut Buffer) -> Result<Index<Mesh>> {
    let vertices = Some(View::ArrayBuffer);
    let positions = mesh.vertices.iter().copied();
    let mut attributes = vec![(
        Semantic::Positions,
        buffer.floats(root, positions, vertices, true),
    )];
    let normals = normals::smooth(&mesh.vertices, &mesh.faces);
    let normals = buffer.floats(root, normals, vertices, false);
    attributes.push((Semantic::Normals, normals));
    if !mesh.bones.is_empty() {
        let (bones, weights): (Vec<_>, Vec<_>) = mesh.weights.iter().map(scaled).unzip();
        let bones = buffer.shorts(root, bones, View::ArrayBuffer);
        attributes.push((Semantic::Joints(0), bones));
        let weights = buffer.floats(root, weights, vertices, false);
        attributes.push((Semantic::Weights(0), weights));
    }
    let primitive = Primitive {
        attributes: attributes.into_iter().map(|(s, a)| (Valid(s), a)).collect(),
        indices: Some(corners(mesh, root, buffer)),
        material: Some(material(root)),
        mode: Valid(Mode::Triangles),
        targets: targets(mesh, root, buffer),
        extensions: None,
        extras: None,
    };
    let names: Vec<&str> = mesh.shapes.iter().map(|s| s.name.as_str()).collect();
    let has_shapes = !names.is_empty();
    // The names that three.js, Babylon.js and Blender read; the format itself has none.
    let extras = gltf_json::serialize::to_string(&serde_json::json!({ "targetNames": names }))
        .and_then(RawValue::from_string)
        .map_err(|e| fail(&e.to_string()))?;
    Ok(root.push(Mesh {
        name: Some(mesh.name.clone()),
        primitives: vec![primitive],
        weights: has_shapes.then(|| vec![0.0; names.len()]),
        extensions: None,
        extras: has_shapes.then_some(extras),
    }))
}

/// Bones and weights of sum 1, to within rounding; what is not used names bone 0.
fn scaled(weights: &[(u16, f32); 4]) -> ([u16; 4], [f32; 4]) {
    let sum: f64 = weights.iter().map(|w| f64::from(w.1)).sum();
    let scaled = weights.map(|(_, w)| (f64::from(w) / sum) as f32);
    let bones = [0, 1, 2, 3].map(|k| if scaled[k] > 0.0 { weights[k].0 } else { 0 });
    (bones, scaled)
}

/// The corners of the triangles, in two bytes where that is enough (the largest number is kept
/// free).
fn corners(mesh: &SkinnedMesh, root: &mut Root, buffer: &mut Buffer) -> Index<Accessor> {
    let corners = mesh.faces.iter().flatten().copied();
    if mesh.vertices.len() <= usize::from(u16::MAX) {
        buffer.shorts(root, corners.map(|v| [v as u16]), View::ElementArrayBuffer)
    } else {
        buffer.integers(root, corners, View::ElementArrayBuffer)
    }
}

fn material(root: &mut Root) -> Index<Material> {
    root.push(Material {
        name: Some("skin".into()),
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor(SKIN_TONE),
            metallic_factor: StrengthFactor(0.0),
            roughness_factor: StrengthFactor(ROUGHNESS),
            ..PbrMetallicRoughness::default()
        },
        ..Material::default()
    })
}

fn targets(mesh: &SkinnedMesh, root: &mut Root, buffer: &mut Buffer) -> Option<Vec<MorphTarget>> {
    let mut target = |offsets: &Vec<[f32; 3]>| {
        let offsets = offsets.iter().copied();
        MorphTarget {
            positions: Some(buffer.floats(root, offsets, Some(View::ArrayBuffer), true)),
            normals: None,
            tangents: None,
        }
    };
    let targets: Vec<MorphTarget> = mesh.shapes.iter().map(|s| target(&s.offsets)).collect();
    (!targets.is_empty()).then_some(targets)
}

/// The skin: its bones, and how each is brought from its rest position and axes to the origin's.
fn skin(mesh: &SkinnedMesh, root: &mut Root, buffer: &mut Buffer) -> Index<Skin> {
    let inverse = mesh.bones.iter().map(|bone| {
        let back = DQuat::from_mat3(&bone.axes().transpose());
        let inverse = DMat4::from_rotation_translation(back, back * -bone.position());
        inverse.as_mat4().to_cols_array()
    });
    let inverse = buffer.floats(root, inverse, None, false);
    root.push(Skin {
        name: Some(mesh.name.clone()),
        joints: (0..mesh.bones.len()).map(index).collect(),
        inverse_bind_matrices: Some(inverse),
        skeleton: Some(index(mesh.bones.len())),
        extensions: None,
        extras: None,
    })
}

/// An animation of the bones, and of the morph targets of the mesh's node.
fn animate(from: &Animation, mesh: Index<Node>, root: &mut Root, buffer: &mut Buffer) {
    let times = from.times.iter().map(|t| [*t]);
    let input = buffer.floats(root, times, None, true);
    let mut outputs = Vec::new();
    for (b, keys) in from.rotations.iter().enumerate() {
        let keys = buffer.floats(root, continuous(keys), None, false);
        outputs.push((index(b), Property::Rotation, keys));
    }
    for (b, keys) in from.translations.iter().enumerate() {
        let keys = buffer.floats(root, keys.iter().copied(), None, false);
        outputs.push((index(b), Property::Translation, keys));
    }
    if !from.weights.is_empty() {
        let keys = from.weights.iter().flatten().map(|w| [*w]);
        let keys = buffer.floats(root, keys, None, false);
        outputs.push((mesh, Property::MorphTargetWeights, keys));
    }
    let channel = |(k, (node, path, _)): (usize, &(_, Property, _))| Channel {
        sampler: index(k),
        target: Target {
            node: *node,
            path: Valid(*path),
            extensions: None,
            extras: None,
        },
        extensions: None,
        extras: None,
    };
    let sampler = |(_, _, output): &(_, _, Index<Accessor>)| Sampler {
        input,
        output: *output,
        interpolation: Valid(Interpolation::Linear),
        extensions: None,
        extras: None,
    };
    let animation = gltf_json::Animation {
        name: Some(from.name.clone()),
        channels: outputs.iter().enumerate().map(channel).collect(),
        samplers: outputs.iter().map(sampler).collect(),
        extensions: None,
        extras: None,
    };
    root.push(animation);
}

/// Unit quaternions; of q and -q, one rotation, the one nearer to the key before, for software that
/// interpolates as they stand.
fn continuous(keys: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let mut before = DQuat::IDENTITY;
    let next = |key: &[f32; 4]| {
        let q = DQuat::from_array(key.map(f64::from)).normalize();
        before = if q.dot(before) < 0.0 { -q } else { q };
        before.as_quat().to_array()
    };
    keys.iter().map(next).collect()
}
