use super::*;
use crate::pose::rotation::from_rotation_vector;
use crate::template::tests::column;

/// The joint of the planted column.
const JOINT: DVec3 = DVec3::new(0.25, 5.5, -0.5);

/// The share of the upper bone at a height: it rises over the three rings about the joint.
fn share(height: f64) -> f64 {
    ((height - 3.5) / 4.0).clamp(0.0, 1.0)
}

/// A bump on one side, in the rest pose.
fn bump(x: DVec3) -> DVec3 {
    DVec3::new(0.3 * (-(x.y - 5.5).powi(2) / 4.0).exp() * x.x, 0.0, 0.0)
}

/// Columns with one joint, skinned exactly, each with the bump `c` times and the upper bone `slip`
/// cm off its joint.
fn planted(template: &Template, slip: f64, bumps: f64) -> Vec<(Vec<DMat3>, Vec<DVec3>)> {
    let one = |i: usize| {
        let wave = |k: f64| (k * (i + 1) as f64).sin();
        let lower = from_rotation_vector(DVec3::new(wave(1.0), wave(2.3), wave(3.1)) * 0.4);
        let turn = from_rotation_vector(DVec3::new(wave(1.7), wave(0.7), wave(2.9)) * 0.9);
        let (upper, shift) = (lower * turn, DVec3::new(wave(4.0), 2.0, 0.0));
        let off = slip * DVec3::new(wave(5.1), wave(5.7), wave(6.3));
        let vertex = |x: &DVec3| {
            let w = share(x.y);
            let x = *x + bumps * wave(7.7) * bump(*x);
            let moved = upper * (x - JOINT) + lower * JOINT + off;
            lower * x * (1.0 - w) + moved * w + shift
        };
        (
            vec![lower, upper],
            template.vertices.iter().map(vertex).collect(),
        )
    };
    (0..12).map(one).collect()
}

fn samples(meshes: &[(Vec<DMat3>, Vec<DVec3>)]) -> Vec<Sample<'_>> {
    let sample = |(rotations, vertices)| Sample {
        rotations,
        vertices,
    };
    meshes.iter().map(|(r, v)| sample((r, v))).collect()
}

#[test]
fn planted_weights_and_free_translations_are_found() {
    let template = column(12);
    let meshes = planted(&template, 0.5, 0.0);
    let skinning = Skinning::fit(&template, &samples(&meshes), 0).unwrap();
    for (x, weights) in template.vertices.iter().zip(&skinning.weights) {
        let sum: f32 = weights.iter().map(|w| w.1).sum();
        assert!((sum - 1.0).abs() <= 1e-6 && weights.iter().all(|w| w.1 >= 0.0));
        let upper: f32 = weights.iter().filter(|w| w.0 == 1).map(|w| w.1).sum();
        assert!(
            (f64::from(upper) - share(x.y)).abs() <= 0.02,
            "{x}: {upper}"
        );
    }
    for sample in samples(&meshes) {
        let frame = skinning.frame(&sample).unwrap();
        assert!(frame.error_mm <= 0.05, "{} mm", frame.error_mm);
        let found = skinning.pose(&frame);
        let far = found
            .iter()
            .zip(sample.vertices)
            .map(|(a, b)| (*a - *b).length());
        let mean = 10.0 * far.sum::<f64>() / found.len() as f64;
        assert!((mean - frame.error_mm).abs() <= 1e-9);
    }
}

#[test]
fn a_planted_shape_is_found_with_its_weights() {
    let template = column(12);
    let meshes = planted(&template, 0.5, 1.0);
    let mean = |skinning: &Skinning| {
        let errors = samples(&meshes)
            .into_iter()
            .map(|s| skinning.frame(&s).unwrap().error_mm);
        errors.sum::<f64>() / meshes.len() as f64
    };
    let without = Skinning::fit(&template, &samples(&meshes), 0).unwrap();
    let with = Skinning::fit(&template, &samples(&meshes), 1).unwrap();
    assert!(
        mean(&with) <= 0.1 * mean(&without),
        "{} of {}",
        mean(&with),
        mean(&without)
    );
    let squares: f64 = (samples(&meshes).iter())
        .map(|s| with.frame(s).unwrap().weights[0].powi(2))
        .sum();
    assert!(
        (squares / meshes.len() as f64 - 1.0).abs() <= 0.1,
        "{squares}"
    );
}

#[test]
fn rotations_alone_give_the_vertices_where_bones_keep_to_their_joint() {
    let template = column(12);
    let meshes = planted(&template, 0.0, 0.0);
    let (test, training) = meshes.split_first().unwrap();
    let skin = JointSkinning::fit(&template, &samples(training)).unwrap();
    assert!(
        (skin.joints[0] - JOINT).length() <= 0.05,
        "{}",
        skin.joints[0]
    );
    let found = skin.pose(&test.0);
    let mean = test.1.iter().sum::<DVec3>() / found.len() as f64;
    let far = found
        .iter()
        .zip(&test.1)
        .map(|(a, b)| (*a + mean - *b).length());
    assert!(far.fold(0.0, f64::max) <= 0.02);
}

#[test]
fn turning_a_mesh_turns_its_fit() {
    let template = column(12);
    let meshes = planted(&template, 0.5, 1.0);
    let skinning = Skinning::fit(&template, &samples(&meshes), 2).unwrap();
    let turn = from_rotation_vector(DVec3::new(2.0, -1.0, 0.5));
    let (rotations, vertices) = &meshes[3];
    let turned: Vec<DMat3> = rotations.iter().map(|r| turn * *r).collect();
    let moved: Vec<DVec3> = vertices.iter().map(|y| turn * *y + DVec3::X).collect();
    let [before, after] = [(rotations, vertices), (&turned, &moved)].map(|(r, v)| {
        let sample = Sample {
            rotations: r,
            vertices: v,
        };
        skinning.frame(&sample).unwrap()
    });
    assert!((before.error_mm - after.error_mm).abs() <= 1e-6);
    for (a, b) in before.weights.iter().zip(&after.weights) {
        assert!((a - b).abs() <= 1e-6);
    }
    assert_eq!(skinning.parents, [None, Some(0)]);
    assert!((skinning.places[1] - JOINT).length() <= 1.0);
}

#[test]
fn samples_that_cannot_be_fitted_to_are_refused() {
    let template = column(6);
    let meshes = planted(&template, 0.0, 0.0);
    let fit = |s: &[Sample<'_>], shapes| {
        let fitted = Skinning::fit(&template, s, shapes);
        fitted.unwrap_err().to_string()
    };
    assert!(fit(&[], 0).contains("one sample or more"));
    assert!(fit(&samples(&meshes), 13).contains("13 corrective shapes"));
    let short = Sample {
        rotations: &meshes[0].0[..1],
        vertices: &meshes[0].1,
    };
    assert!(fit(&[short], 0).contains("expected 24 vertices and 2 rotations, found 24 and 1"));
    let broken = vec![DVec3::NAN; 24];
    let broken = Sample {
        rotations: &meshes[0].0,
        vertices: &broken,
    };
    assert!(fit(&[broken], 0).contains("not finite"));
    // One sample is enough: the skin is rigid where it tells nothing.
    assert!(Skinning::fit(&template, &samples(&meshes[..1]), 1).is_ok());
}
