use super::*;
use glam::{DAffine3, DMat3, DQuat, DVec3, Quat};
use serde_json::Value;

/// A reader of files, apart from the writer.
struct Reader {
    json: Value,
    bytes: Vec<u8>,
}

impl Reader {
    fn new(file: &[u8]) -> Reader {
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(
            (&file[..4], word(4), word(8)),
            (&b"glTF"[..], 2, file.len())
        );
        let json = word(12);
        assert_eq!((&file[16..20], json % 4), (&b"JSON"[..], 0));
        let bytes = &file[20 + json..];
        assert_eq!((&bytes[4..8], bytes.len() % 4), (&b"BIN\0"[..], 0));
        assert_eq!(word(20 + json), bytes.len() - 8);
        Reader {
            json: serde_json::from_slice(&file[20..20 + json]).unwrap(),
            bytes: bytes[8..].to_vec(),
        }
    }

    /// The rows of an accessor; checks its offset and its bounds.
    fn rows(&self, accessor: &Value) -> Vec<Vec<f64>> {
        let accessor = &self.json["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let [start, length] = ["byteOffset", "byteLength"].map(|n| view[n].as_u64().unwrap());
        assert_eq!(start % 4, 0);
        let bytes = &self.bytes[start as usize..(start + length) as usize];
        let numbers: Vec<f64> = match accessor["componentType"].as_u64() {
            Some(5126) => (bytes.chunks_exact(4))
                .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
                .collect(),
            Some(5125) => (bytes.chunks_exact(4))
                .map(|b| f64::from(u32::from_le_bytes(b.try_into().unwrap())))
                .collect(),
            Some(5123) => (bytes.chunks_exact(2))
                .map(|b| f64::from(u16::from_le_bytes(b.try_into().unwrap())))
                .collect(),
            other => panic!("{other:?}"),
        };
        let width = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let rows: Vec<Vec<f64>> = numbers.chunks_exact(width).map(<[f64]>::to_vec).collect();
        assert_eq!(rows.len() as u64, accessor["count"].as_u64().unwrap());
        for (name, pick) in [("min", f64::min as fn(f64, f64) -> f64), ("max", f64::max)] {
            for (c, bound) in accessor[name].as_array().into_iter().flatten().enumerate() {
                let found = rows.iter().map(|r| r[c]).reduce(pick).unwrap();
                assert_eq!(bound.as_f64(), Some(found));
            }
        }
        rows
    }

    fn points(&self, accessor: &Value) -> Vec<DVec3> {
        let rows = self.rows(accessor);
        rows.iter().map(|r| DVec3::from_slice(r)).collect()
    }

    /// The value of a node's property at a key of the first animation.
    fn keyed(&self, node: usize, path: &str, key: usize, width: usize) -> Option<Vec<f64>> {
        let animation = &self.json["animations"][0];
        let channel = animation["channels"]
            .as_array()?
            .iter()
            .find(|c| c["target"]["node"] == node && c["target"]["path"] == path)?;
        let sampler = &animation["samplers"][channel["sampler"].as_u64()? as usize];
        let numbers = self.rows(&sampler["output"]).concat();
        Some(numbers[key * width..(key + 1) * width].to_vec())
    }

    /// Where a node stands in the world at a key.
    fn node(&self, node: usize, key: usize) -> DAffine3 {
        let nodes = self.json["nodes"].as_array().unwrap();
        let rest = |path: &str| -> Option<Vec<f64>> {
            let numbers = nodes[node][path].as_array()?;
            Some(numbers.iter().map(|v| v.as_f64().unwrap()).collect())
        };
        let translation = self.keyed(node, "translation", key, 3);
        let translation = translation.or(rest("translation"));
        let translation = translation.map_or(DVec3::ZERO, |t| DVec3::from_slice(&t));
        let rotation = self.keyed(node, "rotation", key, 4).or(rest("rotation"));
        let rotation = rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_slice(&q));
        let local = DAffine3::from_rotation_translation(rotation, translation);
        let holds = |n: &Value| {
            n["children"]
                .as_array()
                .is_some_and(|c| c.iter().any(|c| c == node))
        };
        match nodes.iter().position(holds) {
            Some(parent) => self.node(parent, key) * local,
            None => local,
        }
    }

    /// The vertices at a key, as a viewer computes them.
    fn vertices(&self, key: usize) -> Vec<DVec3> {
        let nodes = self.json["nodes"].as_array().unwrap();
        let carrier = nodes.iter().position(|n| n.get("mesh").is_some()).unwrap();
        let primitive = &self.json["meshes"][0]["primitives"][0];
        let attributes = &primitive["attributes"];
        let mut vertices = self.points(&attributes["POSITION"]);
        let targets = primitive["targets"].as_array().map_or(&[][..], |t| t);
        let weights = self.keyed(carrier, "weights", key, targets.len());
        for (target, weight) in targets.iter().zip(weights.into_iter().flatten()) {
            let offsets = self.points(&target["POSITION"]);
            vertices
                .iter_mut()
                .zip(offsets)
                .for_each(|(v, o)| *v += weight * o);
        }
        let Some(skin) = self.json["skins"].get(0) else {
            return vertices;
        };
        let motions: Vec<DAffine3> = (skin["joints"].as_array().unwrap().iter())
            .zip(self.rows(&skin["inverseBindMatrices"]))
            .map(|(joint, inverse)| {
                let inverse = glam::DMat4::from_cols_slice(&inverse);
                let node = self.node(joint.as_u64().unwrap() as usize, key);
                node * DAffine3::from_mat4(inverse)
            })
            .collect();
        let joints = self.rows(&attributes["JOINTS_0"]);
        let weights = self.rows(&attributes["WEIGHTS_0"]);
        let moved = |v: usize| {
            let pairs = joints[v].iter().zip(&weights[v]);
            let of = |(j, w): (&f64, &f64)| motions[*j as usize].transform_point3(vertices[v]) * *w;
            pairs.map(of).sum::<DVec3>()
        };
        (0..vertices.len()).map(moved).collect()
    }
}

/// A number between -1 and 1 for each k.
fn wave(k: usize) -> f64 {
    (1.7 * k as f64 + 0.3).sin()
}

fn wave3(k: usize) -> DVec3 {
    DVec3::new(wave(3 * k), wave(3 * k + 1), wave(3 * k + 2))
}

/// Three bones, of which the first hangs on the last, a grid of triangles and two morph targets.
fn sample() -> SkinnedMesh {
    let vertices: Vec<[f32; 3]> = (0..20).map(|v| wave3(v).as_vec3().to_array()).collect();
    let shape = |name: &str, k: usize| Shape {
        name: name.into(),
        offsets: (0..20)
            .map(|v| (0.1 * wave3(v + k)).as_vec3().to_array())
            .collect(),
    };
    let bone = |name: &str, parent, at: [f32; 3], turned: usize| Bone {
        name: name.into(),
        parent,
        at,
        rotation: Quat::from_scaled_axis(wave3(turned).as_vec3()).to_array(),
    };
    SkinnedMesh {
        name: "sample".into(),
        faces: (0..18).map(|f| [f, f + 1, f + 2]).collect(),
        bones: vec![
            bone("arm", Some(2), [0.1, 0.7, 0.0], 3),
            bone("hand", Some(0), [0.3, 0.9, -0.2], 5),
            bone("hips", None, [0.0, 0.5, 0.1], 8),
        ],
        weights: (0..20)
            .map(|v| [(2, 0.5), (v % 2, 0.25), (0, 0.0), (7, 0.0)])
            .collect(),
        shapes: vec![shape("heavy", 50), shape("tall", 90)],
        vertices,
        animations: Vec::new(),
    }
}

#[test]
fn a_reader_poses_the_vertices_as_they_were() {
    let mut mesh = sample();
    let turn = |k: usize| DMat3::from_quat(DQuat::from_scaled_axis(3.0 * wave3(k)));
    let rotations: Vec<Vec<DMat3>> = (0..4)
        .map(|t| (0..3).map(|b| turn(5 * t + b)).collect())
        .collect();
    let positions: Vec<Vec<DVec3>> = (0..4)
        .map(|t| (0..3).map(|b| wave3(7 * t + b)).collect())
        .collect();
    let times = vec![0.0, 0.1, 0.3, 1.0];
    let mut animation = Animation::from_world("dance", &mesh.bones, times, &rotations, &positions);
    animation.weights = (0..4)
        .map(|t| vec![wave(t) as f32, wave(t + 9) as f32])
        .collect();
    mesh.animations.push(animation.clone());
    let reader = Reader::new(&mesh.to_glb().unwrap());
    for t in 0..4 {
        let found = reader.vertices(t);
        for v in 0..20 {
            let mut x = DVec3::from(mesh.vertices[v].map(f64::from));
            for (shape, weight) in mesh.shapes.iter().zip(&animation.weights[t]) {
                x += f64::from(*weight) * DVec3::from(shape.offsets[v].map(f64::from));
            }
            let moved = |b: usize| {
                rotations[t][b] * (x - DVec3::from(mesh.bones[b].at.map(f64::from)))
                    + positions[t][b]
            };
            // The weights are scaled to sum 1.
            let expected = moved(2) * (2.0 / 3.0) + moved(v % 2) / 3.0;
            assert!(
                (found[v] - expected).length() <= 1e-5,
                "key {t}, vertex {v}"
            );
        }
    }
    let names = &reader.json["meshes"][0]["extras"]["targetNames"];
    assert_eq!(names, &serde_json::json!(["heavy", "tall"]));
}

#[test]
fn the_rest_pose_is_the_mesh_itself() {
    let mesh = sample();
    let reader = Reader::new(&mesh.to_glb().unwrap());
    let found = reader.vertices(0);
    for (a, b) in found.iter().zip(&mesh.vertices) {
        assert!((*a - DVec3::from(b.map(f64::from))).length() <= 1e-6);
    }
    let attributes = &reader.json["meshes"][0]["primitives"][0]["attributes"];
    let weights = reader.rows(&attributes["WEIGHTS_0"]);
    assert!(
        weights
            .iter()
            .all(|w| (w.iter().sum::<f64>() - 1.0).abs() <= 2e-7)
    );
    let bones = reader.rows(&attributes["JOINTS_0"]);
    assert!(bones.iter().all(|b| b[3] == 0.0));
    let bare = SkinnedMesh {
        bones: Vec::new(),
        weights: Vec::new(),
        ..mesh
    };
    let reader = Reader::new(&bare.to_glb().unwrap());
    assert!(reader.json.get("skins").is_none());
    assert_eq!(reader.vertices(0).len(), 20);
}

#[test]
fn equal_meshes_give_equal_bytes_and_a_saved_file_holds_them() {
    let bytes = sample().to_glb().unwrap();
    assert_eq!(bytes, sample().to_glb().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sample.glb");
    sample().save(&path).unwrap();
    assert_eq!(std::fs::read(path).unwrap(), bytes);
}

#[test]
fn normals_follow_the_larger_triangles() {
    // Over the x axis a small triangle that faces z and a large one that faces -y.
    let vertices = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 3.0],
        [9.0; 3],
    ];
    let found = normals::smooth(&vertices, &[[0, 1, 2], [0, 1, 3]]);
    let expected = DVec3::new(0.0, -3.0, 1.0).normalize();
    assert!((DVec3::from(found[0].map(f64::from)) - expected).length() <= 1e-6);
    assert_eq!((found[2], found[3]), ([0.0, 0.0, 1.0], [0.0, -1.0, 0.0]));
    assert_eq!(found[4], [0.0, 1.0, 0.0]);
}

#[test]
fn more_than_65535_vertices_are_counted_in_four_bytes() {
    let mesh = |count: u32| SkinnedMesh {
        vertices: (0..count)
            .map(|v| [v as f32, (v % 2) as f32, 0.0])
            .collect(),
        faces: vec![[0, 1, count - 1]],
        ..SkinnedMesh::default()
    };
    for (count, component) in [(65_535, 5123), (65_536, 5125)] {
        let reader = Reader::new(&mesh(count).to_glb().unwrap());
        let corners = &reader.json["meshes"][0]["primitives"][0]["indices"];
        let rows = reader.rows(corners);
        assert_eq!(rows[2], [f64::from(count - 1)]);
        let accessor = &reader.json["accessors"][corners.as_u64().unwrap() as usize];
        assert_eq!(accessor["componentType"], component);
    }
}

#[test]
fn quaternions_are_of_unit_length_and_go_the_shorter_way() {
    let mut mesh = sample();
    let key = |angle: f32, sign: f32| (Quat::from_rotation_y(angle) * 2.0 * sign).to_array();
    let keys = vec![key(0.1, -1.0), key(0.2, 1.0), key(0.3, -1.0)];
    mesh.animations.push(Animation {
        times: vec![0.0, 1.0, 2.0],
        rotations: vec![keys; 3],
        ..Animation::default()
    });
    let reader = Reader::new(&mesh.to_glb().unwrap());
    for key in 0..3 {
        let q = DQuat::from_slice(&reader.keyed(1, "rotation", key, 4).unwrap());
        assert!((q.length() - 1.0).abs() <= 1e-6 && q.w > 0.9);
        // Bones keep their positions.
        assert!(reader.keyed(1, "translation", key, 3).is_none());
    }
}

#[test]
fn weights_of_0_to_1_look_as_before() {
    let mut mesh = sample();
    let animation = |name: &str, weights: Vec<Vec<f32>>| Animation {
        name: name.into(),
        times: vec![0.0, 1.0],
        weights,
        ..Animation::default()
    };
    let weights = vec![vec![-1.5, 0.5], vec![2.5, 1.0]];
    mesh.animations = vec![animation("a", weights)];
    let before = Reader::new(&mesh.to_glb().unwrap());
    let vertices = mesh.vertices.clone();
    mesh.unit_weights();
    let after = Reader::new(&mesh.to_glb().unwrap());
    for key in 0..2 {
        let pairs = before.vertices(key).into_iter().zip(after.vertices(key));
        assert!(pairs.into_iter().all(|(a, b)| (a - b).length() <= 1e-6));
    }
    let weights = &mesh.animations[0].weights;
    assert_eq!(weights, &[[0.0, 0.5, 1.0], [1.0, 1.0, 1.0]]);
    assert_eq!((&mesh.vertices, mesh.shapes.len()), (&vertices, 3));
    let once = mesh.clone();
    mesh.unit_weights();
    assert_eq!(mesh, once);
}

#[test]
fn what_is_no_mesh_is_refused() {
    let refused = |change: fn(&mut SkinnedMesh)| {
        let mut mesh = sample();
        change(&mut mesh);
        mesh.to_glb().unwrap_err().to_string()
    };
    let animated = |change: fn(&mut Animation)| {
        let mut mesh = sample();
        let mut animation = Animation {
            name: "walk".into(),
            times: vec![0.0, 1.0],
            weights: vec![vec![0.0; 2]; 2],
            ..Animation::default()
        };
        change(&mut animation);
        mesh.animations.push(animation);
        mesh.to_glb().unwrap_err().to_string()
    };
    let cases = [
        (refused(|m| m.vertices.clear()), "has no vertices"),
        (refused(|m| m.faces[3][0] = 20), "names vertex 20"),
        (refused(|m| m.vertices[2][1] = f32::NAN), "not finite"),
        (
            refused(|m| m.weights.truncate(3)),
            "expected 20 weights, found 3",
        ),
        (
            refused(|m| m.weights[5][0].0 = 3),
            "vertex 5: there is no bone 3",
        ),
        (refused(|m| m.weights[5][0].1 = -1.0), "of at least 0"),
        (
            refused(|m| m.weights[5] = [(0, 0.0); 4]),
            "one of them above 0",
        ),
        (
            refused(|m| m.weights[5] = [(1, 0.5); 4]),
            "follows bone 1 twice",
        ),
        (refused(|m| m.bones[2].parent = Some(1)), "form a circle"),
        (
            refused(|m| m.bones[1].rotation = [0.0; 4]),
            "a quaternion is 0",
        ),
        (
            refused(|m| m.bones[2].parent = Some(9)),
            "there is no bone 9",
        ),
        (
            refused(|m| m.shapes[1].offsets.truncate(1)),
            "tall: expected 20 offsets",
        ),
        (animated(|a| a.times.clear()), "walk: expected one time"),
        (animated(|a| a.times[1] = 0.0), "rising"),
        (animated(|a| a.times[1] = f32::NAN), "not finite"),
        (animated(|a| a.weights.clear()), "moves no bone"),
        (
            animated(|a| a.weights[1].truncate(1)),
            "expected 2 weights of a key",
        ),
        (
            animated(|a| a.rotations = vec![vec![[0.0; 4]; 2]; 3]),
            "a quaternion is 0",
        ),
        (
            animated(|a| a.translations = vec![vec![[0.0; 3]; 2]; 2]),
            "expected 3 bones",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains(expected), "{message}: {expected}");
    }
}
