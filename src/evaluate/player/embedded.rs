//! The scene as JSON that the player's script reads.
//!
//! Coordinates are base64 of little-endian numbers, frame after frame: 16-bit steps between a column's least and greatest
//! value (`-32768`: missing), or 32-bit floats (NaN: missing) where such a step would show. Statuses are run lengths,
//! point by point.

use crate::evaluate::scene::{Scene, Status};
use crate::evaluate::scene_geometry::{SceneGeometry, Side};
use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Value, json};

/// A step between neighbouring 16-bit values above this (cm) would be seen.
const COARSEST: f64 = 0.05;
/// The 16-bit value of what is missing.
pub const MISSING: i16 = i16::MIN;

/// The smallest step through the frames that keeps the coordinates' base64 within the limit.
pub fn sparing(scene: &Scene<'_>, limit: usize) -> usize {
    let figures = scene.figures.len() as u128;
    let a_frame = figures * scene.points.len() as u128 * 3 * 2 * 4 / 3;
    let most = (limit as u128)
        .checked_div(a_frame)
        .unwrap_or(u128::MAX)
        .max(1);
    (scene.frames() as u128).div_ceil(most).max(1) as usize
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
    let columns = 3 * scene.points.len();
    let mut values = Vec::with_capacity(kept.len() * columns);
    for frame in kept {
        for point in 0..scene.points.len() {
            values.extend(geometry.at(figure, *frame, point).unwrap_or([f64::NAN; 3]));
        }
    }
    let mut coded = coordinates(&values, columns);
    coded["name"] = json!(scene.figures[figure].name);
    coded["note"] = json!(scene.notes.get(figure));
    coded["status"] = match scene.figures[figure].status {
        Some(_) => (0..scene.points.len())
            .map(|point| run_lengths(kept.iter().map(|t| geometry.status(figure, *t, point))))
            .collect(),
        None => Value::Null,
    };
    coded
}

/// Rows of `columns` values as base64, and how to read it. NaN is missing.
fn coordinates(values: &[f64], columns: usize) -> Value {
    let mut low = vec![f64::INFINITY; columns];
    let mut high = vec![f64::NEG_INFINITY; columns];
    for (i, value) in values.iter().enumerate() {
        // min and max pass over NaN.
        low[i % columns] = low[i % columns].min(*value);
        high[i % columns] = high[i % columns].max(*value);
    }
    let low: Vec<f64> = low
        .iter()
        .map(|v| {
            if v.is_finite() {
                rounded(*v - 0.0005)
            } else {
                0.0
            }
        })
        .collect();
    let steps: Vec<f64> = (0..columns)
        .map(|c| ((high[c] - low[c]) / 65534.0).max(0.0))
        // Rounded up to a short decimal, so that the greatest value stays in range.
        .map(|step| (step * 1e8).ceil() / 1e8)
        .collect();
    if steps.iter().any(|step| *step > COARSEST) {
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|v| (*v as f32).to_le_bytes())
            .collect();
        return json!({ "format": "f32", "data": BASE64_STANDARD.encode(&bytes) });
    }
    let code = |(i, value): (usize, &f64)| {
        if value.is_nan() {
            return MISSING;
        }
        let (low, step) = (low[i % columns], steps[i % columns]);
        let steps = if step > 0.0 {
            ((value - low) / step).round().clamp(0.0, 65534.0)
        } else {
            0.0
        };
        (steps - 32767.0) as i16
    };
    let bytes: Vec<u8> = values
        .iter()
        .enumerate()
        .map(code)
        .flat_map(i16::to_le_bytes)
        .collect();
    json!({ "format": "i16", "low": low, "step": steps, "data": BASE64_STANDARD.encode(&bytes) })
}

/// Status and how often it follows itself, again and again.
fn run_lengths(statuses: impl Iterator<Item = Status>) -> Value {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for status in statuses {
        let code = Status::ALL.iter().position(|s| *s == status).unwrap_or(0);
        match runs.last_mut() {
            Some([last, length]) if *last == code => *length += 1,
            _ => runs.push([code, 1]),
        }
    }
    json!(runs.concat())
}

/// A thousandth of a centimetre, degree or second is enough for a picture.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_are_run_lengths() {
        use Status::*;
        assert_eq!(
            run_lengths([Observed, Observed, Inferred, Observed].into_iter()),
            json!([0, 2, 2, 1, 0, 1])
        );
        assert_eq!(run_lengths([].into_iter()), json!([]));
    }
}
