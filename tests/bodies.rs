//! Bodies on the shared meshes: 40 poses of one person and 40 people. Skipped where they are not at hand.

mod common;

#[path = "common/bodies.rs"]
mod shared;

use glam::DMat3;
use posing::body::decomposition::{SMOOTHNESS, fit_rotations, synthesise};
use posing::body::pose_model::Follows;
use posing::body::{Decomposer, PoseModel, Template};
use shared::{errors, mean};

#[test]
fn poses_are_decomposed_and_predicted_from_their_rotations() {
    let Some(path) = common::shared("data/bodies/makehuman-40-people-40-poses.npz") else {
        return common::skipped("bodies: ../shared/data/bodies is not there");
    };
    let bodies = shared::read(&path);
    let error = |a: &[_], b: &[_]| mean(&errors(a, b));
    let template = Template::new(bodies.poses[0].clone(), bodies.faces, bodies.parts).unwrap();
    assert_eq!((template.parts(), template.joints.len()), (16, 15));
    let decomposer = Decomposer::new(&template, SMOOTHNESS).unwrap();
    let decomposed: Vec<(Vec<DMat3>, Vec<DMat3>)> = (bodies.poses.iter())
        .map(|pose| {
            let rotations = fit_rotations(&template, pose);
            let q = decomposer.deformations(pose, &rotations);
            (rotations, q)
        })
        .collect();
    let mean = |errors: Vec<f64>| mean(&errors);
    let back = |k: usize| synthesise(&template, &decomposed[k].0, &decomposed[k].1);
    let exact = mean((0..40).map(|k| error(&back(k), &bodies.poses[k])).collect());
    // Every fourth pose is held out.
    let (test, train): (Vec<usize>, Vec<usize>) = (0..40).partition(|k| k % 4 == 1);
    let training: Vec<_> = train.iter().map(|k| decomposed[*k].clone()).collect();
    let model = PoseModel::learn(&template, &training, Follows::default()).unwrap();
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
