//! The scene as JSON that the player's script reads.
//!
//! Coordinates are base64 of little-endian 32-bit floats, frame after frame; NaN is missing. Statuses are run lengths, point
//! by point.

use crate::evaluate::scene::{Scene, Status};
use crate::evaluate::scene_geometry::{SceneGeometry, Side};
use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Value, json};

/// Largest size of the coordinates in a page, bytes of base64.
const LIMIT: usize = 24_000_000;

/// The smallest step through the frames that keeps the coordinates within [`LIMIT`].
pub fn sparing(scene: &Scene<'_>) -> usize {
    let bytes_per_frame = scene.figures.len() * scene.points.len() * 3 * 4 * 4 / 3;
    let most = LIMIT
        .checked_div(bytes_per_frame)
        .unwrap_or(usize::MAX)
        .max(1);
    scene.frames().div_ceil(most).max(1)
}

/// Everything the script reads.
pub fn embedded(
    scene: &Scene<'_>,
    geometry: &SceneGeometry<'_, '_>,
    kept: &[usize],
    every: usize,
) -> Value {
    let side = |side: &Side| match side {
        Side::Left => 'l',
        Side::Right => 'r',
        Side::Middle => 'm',
    };
    let figures: Vec<Value> = (0..scene.figures.len())
        .map(|figure| embedded_figure(scene, geometry, kept, figure))
        .collect();
    json!({
        "points": scene.points,
        "bones": scene.bones,
        "sides": geometry.sides.iter().map(side).collect::<String>(),
        "head": geometry.head,
        "rate": scene.rate / every as f64,
        "every": every,
        "frames": kept.len(),
        "reference": geometry.reference,
        "behind": scene.behind,
        "start": scene.start / every,
        "ground": rounded(geometry.ground),
        "size": rounded(geometry.size),
        "azimuth": rounded(geometry.azimuth()),
        "runs": runs(scene, kept.len(), every),
        "figures": figures,
    })
}

/// Name, first embedded frame, its time and the embedded frames a second of every run that has an embedded frame.
fn runs(scene: &Scene<'_>, kept: usize, every: usize) -> Vec<Value> {
    let first = |i: usize| scene.runs[i].first.div_ceil(every);
    (0..scene.runs.len())
        .filter(|i| first(*i) < kept)
        .filter(|i| i + 1 == scene.runs.len() || first(i + 1) > first(*i))
        .map(|i| {
            json!([
                scene.runs[i].name,
                first(i),
                rounded(scene.moment(first(i) * every).1),
                scene.runs[i].rate / every as f64
            ])
        })
        .collect()
}

fn embedded_figure(
    scene: &Scene<'_>,
    geometry: &SceneGeometry<'_, '_>,
    kept: &[usize],
    figure: usize,
) -> Value {
    let points = 0..scene.points.len();
    let mut bytes = Vec::with_capacity(kept.len() * points.len() * 12);
    for frame in kept {
        for point in points.clone() {
            let place = geometry.at(figure, *frame, point);
            let place = place.unwrap_or([f64::NAN; 3]).map(|v| v as f32);
            bytes.extend(place.into_iter().flat_map(f32::to_le_bytes));
        }
    }
    let statuses = |point| run_lengths(kept.iter().map(|t| geometry.status(figure, *t, point)));
    let has_statuses = scene.figures[figure].status.is_some();
    json!({
        "name": scene.figures[figure].name,
        "note": scene.notes.get(figure),
        "data": BASE64_STANDARD.encode(&bytes),
        "status": has_statuses.then(|| points.map(statuses).collect::<Value>()),
    })
}

/// Run lengths: the index in [`Status::ALL`] and the length of each stretch of equal statuses, one after another.
fn run_lengths(statuses: impl Iterator<Item = Status>) -> Vec<usize> {
    let code = |status| Status::ALL.iter().position(|s| *s == status).unwrap_or(0);
    let codes: Vec<usize> = statuses.map(code).collect();
    let runs = codes.chunk_by(|a, b| a == b);
    runs.flat_map(|run| [run[0], run.len()]).collect()
}

/// A thousandth of a centimetre, degree or second is enough for a picture.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::scene::Figure;

    #[test]
    fn a_long_scene_keeps_every_few_frames() {
        let points = vec![String::new(); 100];
        let xyz = ndarray::Array2::zeros((30_000, 300));
        let scene = Scene {
            points: &points,
            figures: vec![Figure::new("f", xyz.view())],
            ..Scene::default()
        };
        // 1,600 bytes a frame: 15,000 frames fit.
        assert_eq!(sparing(&scene), 2);
        assert_eq!(sparing(&Scene::default()), 1);
    }

    #[test]
    fn statuses_are_run_lengths() {
        use Status::*;
        let statuses = [Observed, Observed, Inferred, Observed];
        assert_eq!(run_lengths(statuses.into_iter()), [0, 2, 2, 1, 0, 1]);
        assert!(run_lengths([].into_iter()).is_empty());
    }
}
