//! A body for unit tests.

use super::BodyModel;
use super::template::tests::column;
use super::train::{Settings, train};
use glam::{DMat3, DVec3};

/// A column of two parts that bulges where it bends, and comes thick and thin.
pub(crate) fn bending_body() -> BodyModel {
    let template = column(12);
    let bent = |angle: f64, axis: DVec3| -> Vec<DVec3> {
        let turn = DMat3::from_axis_angle(axis, angle);
        let pivot = DVec3::new(0.0, 5.5, 0.0);
        (template.vertices.iter())
            .map(|v| {
                let near = 1.0 + 0.3 * angle * angle / (1.0 + (v.y - 5.5).powi(2));
                let v = DVec3::new(v.x * near, v.y, v.z);
                if v.y > 5.5 {
                    pivot + turn * (v - pivot)
                } else {
                    v
                }
            })
            .collect()
    };
    let poses: Vec<Vec<DVec3>> = (0..8)
        .map(|k| bent(0.2 * k as f64, [DVec3::X, DVec3::Y, DVec3::Z][k % 3]))
        .collect();
    let scaled = |x: f64, y: f64| -> Vec<DVec3> {
        let by = DVec3::new(x, y, 1.0);
        template.vertices.iter().map(|v| *v * by).collect()
    };
    let people = [(1.2, 1.0), (0.9, 1.0), (1.0, 1.1), (1.0, 0.9)];
    let people = people.map(|(x, y)| scaled(x, y));
    train(
        template.clone(),
        &poses,
        &people,
        &Settings::default(),
        &mut || (),
    )
    .unwrap()
}
