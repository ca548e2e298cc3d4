//! Bodies on the shared meshes: 40 poses of one person and 40 people. Skipped where they are not at hand.

mod common;

use glam::{DMat3, DVec3};
use posing::body::decomposition::{SMOOTHNESS, synthesise};
use posing::body::pose_model::NEAREST_JOINTS;
use posing::body::skinning::{JointSkinning, Sample, Skinning};
use posing::body::{Decomposer, PoseModel, Template};
use std::io::Read;

/// The shared meshes, centimetres.
struct Bodies {
    poses: Vec<Vec<DVec3>>,
    faces: Vec<[usize; 3]>,
    parts: Vec<usize>,
}

/// The numbers of an array of the archive: little-endian integers of `size` bytes.
fn numbers(archive: &mut zip::ZipArchive<std::fs::File>, name: &str, size: usize) -> Vec<i64> {
    let mut bytes = Vec::new();
    let mut entry = archive.by_name(&format!("{name}.npy")).unwrap();
    entry.read_to_end(&mut bytes).unwrap();
    let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let number = |b: &[u8]| match *b {
        [a] => i64::from(a as i8),
        [a, b] => i64::from(i16::from_le_bytes([a, b])),
        _ => unreachable!("integers of one or two bytes"),
    };
    bytes[head..].chunks_exact(size).map(number).collect()
}

fn bodies() -> Option<Bodies> {
    let path = common::shared("data/bodies/makehuman-40-people-40-poses.npz")?;
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let faces = numbers(&mut archive, "faces", 2);
    let parts: Vec<usize> = (numbers(&mut archive, "part", 1).iter())
        .map(|p| *p as usize)
        .collect();
    // Whole multiples of 50 micrometres.
    let poses: Vec<DVec3> = (numbers(&mut archive, "poses", 2).chunks_exact(3))
        .map(|c| 5e-3 * DVec3::new(c[0] as f64, c[1] as f64, c[2] as f64))
        .collect();
    Some(Bodies {
        poses: poses.chunks_exact(parts.len()).map(<[_]>::to_vec).collect(),
        faces: faces
            .chunks_exact(3)
            .map(|f| [f[0], f[1], f[2]].map(|v| v as usize))
            .collect(),
        parts,
    })
}

/// The mean distance of vertices, mm, after their means are put together.
fn error(found: &[DVec3], truth: &[DVec3]) -> f64 {
    let n = truth.len() as f64;
    let shift = (truth.iter().sum::<DVec3>() - found.iter().sum::<DVec3>()) / n;
    let far = found
        .iter()
        .zip(truth)
        .map(|(a, b)| (*a + shift - *b).length());
    10.0 * far.sum::<f64>() / n
}

#[test]
fn poses_are_decomposed_and_predicted_from_their_rotations() {
    let Some(bodies) = bodies() else {
        return common::skipped("bodies: ../shared/data/bodies is not there");
    };
    let template = Template::new(bodies.poses[0].clone(), bodies.faces, bodies.parts).unwrap();
    assert_eq!((template.parts(), template.joints.len()), (16, 15));
    let decomposer = Decomposer::new(&template, SMOOTHNESS).unwrap();
    let decomposed: Vec<(Vec<DMat3>, Vec<DMat3>)> = (bodies.poses.iter())
        .map(|pose| {
            let rotations = decomposer.rotations(pose);
            let q = decomposer.deformations(pose, &rotations);
            (rotations, q)
        })
        .collect();
    let mean = |errors: Vec<f64>| errors.iter().sum::<f64>() / errors.len() as f64;
    let back = |k: usize| synthesise(&template, &decomposed[k].0, &decomposed[k].1);
    let exact = mean((0..40).map(|k| error(&back(k), &bodies.poses[k])).collect());
    // Every fourth pose is held out.
    let (test, train): (Vec<usize>, Vec<usize>) = (0..40).partition(|k| k % 4 == 1);
    let training: Vec<_> = train.iter().map(|k| decomposed[*k].clone()).collect();
    let model = PoseModel::learn(&template, &training, NEAREST_JOINTS).unwrap();
    let predicted = |k: &usize| {
        let rotations = &decomposed[*k].0;
        let q = model.deformations(&template, rotations);
        error(&synthesise(&template, rotations, &q), &bodies.poses[*k])
    };
    let rigid = |k: &usize| {
        let q = vec![DMat3::IDENTITY; template.faces.len()];
        error(
            &synthesise(&template, &decomposed[*k].0, &q),
            &bodies.poses[*k],
        )
    };
    let (model, rigid) = (
        mean(test.iter().map(predicted).collect()),
        mean(test.iter().map(rigid).collect()),
    );
    println!("decomposition {exact:.4} mm, pose model {model:.2} mm, rigid parts {rigid:.1} mm");
    assert!(exact <= 0.05, "{exact} mm");
    assert!(
        model <= 3.0 && model < rigid / 4.0,
        "{model} mm, rigid {rigid} mm"
    );
}

/// A third of the area of each vertex's triangles.
fn areas(template: &Template) -> Vec<f64> {
    let mut areas = vec![0.0; template.vertices.len()];
    for (face, [a, b]) in template.faces.iter().zip(&template.edges) {
        face.iter()
            .for_each(|v| areas[*v] += a.cross(*b).length() / 6.0);
    }
    areas
}

#[test]
fn poses_are_skinned_with_bones_and_corrective_shapes() {
    let Some(bodies) = bodies() else {
        return common::skipped("bodies: ../shared/data/bodies is not there");
    };
    let (faces, parts) = (bodies.faces.clone(), bodies.parts.clone());
    let template = Template::new(bodies.poses[0].clone(), faces, parts).unwrap();
    let decomposer = Decomposer::new(&template, SMOOTHNESS).unwrap();
    let rotations: Vec<Vec<DMat3>> = (bodies.poses.iter())
        .map(|p| decomposer.rotations(p))
        .collect();
    let sample = |k: usize| Sample {
        rotations: &rotations[k],
        vertices: &bodies.poses[k],
    };
    let (test, train): (Vec<usize>, Vec<usize>) = (0..40).partition(|k| k % 4 == 1);
    let training: Vec<Sample> = train.iter().map(|k| sample(*k)).collect();
    let mean = |errors: Vec<f64>| errors.iter().sum::<f64>() / errors.len() as f64;
    let areas = areas(&template);
    let by_area = |found: &[DVec3], k: usize| {
        let far = found.iter().zip(&bodies.poses[k]).zip(&areas);
        let sum: f64 = far.map(|((a, b), area)| area * (*a - *b).length()).sum();
        10.0 * sum / areas.iter().sum::<f64>()
    };

    let jointed = JointSkinning::fit(&template, &training).unwrap();
    let predicted = |k: &usize| error(&jointed.pose(&rotations[*k]), &bodies.poses[*k]);
    let jointed = mean(test.iter().map(predicted).collect());
    println!("joints by forward kinematics {jointed:.2} mm");
    assert!(jointed <= 6.0, "{jointed} mm");
    for (shapes, most) in [(0, 1.6), (5, 1.15), (10, 1.05), (20, 0.9)] {
        let skinning = Skinning::fit(&template, &training, shapes).unwrap();
        let frames: Vec<_> = test
            .iter()
            .map(|k| skinning.frame(&sample(*k)).unwrap())
            .collect();
        let found = mean(frames.iter().map(|f| f.error_mm).collect());
        let areas = frames
            .iter()
            .zip(&test)
            .map(|(f, k)| by_area(&skinning.pose(f), *k));
        println!(
            "{shapes} corrective shapes {found:.2} mm, by area {:.2} mm",
            mean(areas.collect())
        );
        assert!(found <= most, "{shapes} corrective shapes: {found} mm");
    }
}
