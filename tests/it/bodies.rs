//! Bodies on the shared meshes: 40 poses of one person and 40 people. Skipped where they are not at
//! hand.

use crate::common::bodies::{self as shared, errors, mean};
use glam::{DMat3, DVec3};
use posing::body::completion::complete;
use posing::body::decomposition::{SMOOTHNESS, fit_rotations, synthesize};
use posing::body::fit::FitProblem;
use posing::body::pose_model::{Follows, JointInputs};
use posing::body::skinning::{JointSkinning, Sample, Skinning};
use posing::body::train::{Settings, train};
use posing::body::{Decomposer, Marker, MarkerModel, PoseModel, Template};

#[test]
fn poses_are_decomposed_and_predicted_from_their_rotations() {
    let Some(path) = crate::common::shared("data/bodies/makehuman-40-people-40-poses.npz") else {
        return crate::common::skipped("bodies: ../shared/data/bodies is not there");
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
    let back = |k: usize| synthesize(&template, &decomposed[k].0, &decomposed[k].1);
    let exact = mean((0..40).map(|k| error(&back(k), &bodies.poses[k])).collect());
    // Every fourth pose is held out.
    let (test, train): (Vec<usize>, Vec<usize>) = (0..40).partition(|k| k % 4 == 1);
    let training: Vec<_> = train.iter().map(|k| decomposed[*k].clone()).collect();
    let model =
        PoseModel::learn(&template, &training, Follows::default(), JointInputs::Twist).unwrap();
    let predicted = |k: &usize| {
        let rotations = &decomposed[*k].0;
        let q = model.deformations(&template, rotations);
        error(&synthesize(&template, rotations, &q), &bodies.poses[*k])
    };
    let rigid = |k: &usize| {
        let q = vec![DMat3::IDENTITY; template.faces.len()];
        error(
            &synthesize(&template, &decomposed[*k].0, &q),
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
    let Some(path) = crate::common::shared("data/bodies/makehuman-40-people-40-poses.npz") else {
        return crate::common::skipped("bodies: ../shared/data/bodies is not there");
    };
    let bodies = shared::read(&path);
    let template = Template::new(bodies.poses[0].clone(), bodies.faces, bodies.parts).unwrap();
    let rotations: Vec<Vec<DMat3>> = (bodies.poses.iter())
        .map(|p| fit_rotations(&template, p))
        .collect();
    let sample = |k: usize| Sample {
        rotations: &rotations[k],
        vertices: &bodies.poses[k],
    };
    let (test, train): (Vec<usize>, Vec<usize>) = (0..40).partition(|k| k % 4 == 1);
    let training: Vec<Sample<'_>> = train.iter().map(|k| sample(*k)).collect();
    let areas = areas(&template);
    let total: f64 = areas.iter().sum();
    let by_area = |e: &[f64]| e.iter().zip(&areas).map(|(e, a)| e * a).sum::<f64>() / total;
    let jointed = JointSkinning::fit(&template, &training).unwrap();
    let predicted = |k: &usize| mean(&errors(&jointed.pose(&rotations[*k]), &bodies.poses[*k]));
    let jointed = mean(&test.iter().map(predicted).collect::<Vec<_>>());
    println!("joints by forward kinematics {jointed:.2} mm");
    assert!(jointed <= 6.0, "{jointed} mm");
    for (shapes, most) in [(0, 1.6), (5, 1.15), (10, 1.05), (20, 0.9)] {
        let skinning = Skinning::fit(&template, &training, shapes).unwrap();
        let (mut plain, mut weighted) = (Vec::new(), Vec::new());
        for k in &test {
            let frame = skinning.frame(&sample(*k)).unwrap();
            let e = errors(&skinning.pose(&frame), &bodies.poses[*k]);
            plain.push(frame.error_mm);
            weighted.push(by_area(&e));
        }
        let (found, area) = (mean(&plain), mean(&weighted));
        println!("{shapes} corrective shapes {found:.2} mm, by area {area:.2} mm");
        assert!(found <= most, "{shapes} corrective shapes: {found} mm");
    }
}

#[test]
fn people_and_markers_that_were_not_seen_are_completed() {
    let Some(path) = crate::common::shared("data/bodies/makehuman-40-people-40-poses.npz") else {
        return crate::common::skipped("bodies: ../shared/data/bodies is not there");
    };
    let bodies = shared::read(&path);
    let parts = bodies.parts.clone();
    let template = Template::new(bodies.poses[0].clone(), bodies.faces, bodies.parts).unwrap();
    let seen = |all: &[Vec<DVec3>]| -> Vec<Vec<DVec3>> {
        let kept = (0..all.len()).filter(|k| k % 4 != 1);
        kept.map(|k| all[k].clone()).collect()
    };
    let settings = Settings::default();
    let (poses, people) = (seen(&bodies.poses), seen(&bodies.people));
    let body = train(template, &poses, &people, &settings, &mut || ()).unwrap();
    let shaped = |count: usize| {
        let of = |k: usize| {
            let rotations = fit_rotations(&body.template, &bodies.people[k]);
            let shape = body.shape_of(&bodies.people[k], &rotations, count);
            mean(&errors(
                &body.synthesize(&rotations, &shape),
                &bodies.people[k],
            ))
        };
        mean(&(1..40).step_by(4).map(of).collect::<Vec<_>>())
    };
    for (count, most) in [(5, 5.0), (10, 3.2), (20, 1.6)] {
        let found = shaped(count);
        println!("{count} components of shape {found:.2} mm");
        assert!(found <= most, "{count} components: {found} mm");
    }
    // Four vertices a part, spread over its list.
    let on: Vec<usize> = (0..16)
        .flat_map(|part| {
            let own: Vec<usize> = (0..parts.len()).filter(|v| parts[*v] == part).collect();
            (0..4).map(move |k| own[(2 * k + 1) * own.len() / 8])
        })
        .collect();
    let markers: Vec<Marker> = on.iter().map(|v| Marker::on(*v)).collect();
    let model = MarkerModel::new(&body, &markers);
    let prior = body.fit_prior();
    let turn = DMat3::from_axis_angle(DVec3::new(0.0, 0.6, 0.8), 1.2);
    let complete_turned = |mesh: &[DVec3], turn: DMat3| -> Vec<DVec3> {
        let seen: Vec<_> = on.iter().map(|v| Some(turn * mesh[*v])).collect();
        let fit = FitProblem::new(&model, &prior, &seen).unwrap().solve(None);
        assert!(fit.energies.windows(2).all(|w| w[1] < w[0]));
        let orthonormal = |r: &DMat3| (*r * r.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-9);
        assert!(fit.state.rotations.iter().all(orthonormal));
        let shape = body.shape.matrices(&fit.state.shape);
        complete(&body, &fit, &shape, None).completed
    };
    for (what, all) in [("poses", &bodies.poses), ("people", &bodies.people)] {
        let of = |k: usize| {
            let found = complete_turned(&all[k], DMat3::IDENTITY);
            mean(&errors(&found, &all[k]))
        };
        let found = mean(&(1..40).step_by(4).map(of).collect::<Vec<_>>());
        println!("{what} completed from {} markers {found:.2} mm", on.len());
        assert!(found <= 2.5, "{found} mm");
        let (straight, turned) = (
            complete_turned(&all[5], DMat3::IDENTITY),
            complete_turned(&all[5], turn),
        );
        let apart = straight
            .iter()
            .zip(&turned)
            .map(|(a, b)| (turn * *a - *b).length());
        assert!(apart.fold(0.0, f64::max) < 0.01);
    }
}
