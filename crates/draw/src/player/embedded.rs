//! The scene as JSON that the player's script reads.
//!
//! Coordinates are base64 of little-endian 32-bit floats, frame after frame; NaN is missing.
//! Statuses and methods are run lengths, point by point. Of standard deviations only those of
//! points that were changed, filled or rejected are there: run lengths of frames without and with
//! one in turn, point by point, and base64 of 16-bit numbers.

use crate::pair::{PointDifference, TakePair};
use crate::scene::{FillMethod, Scene, Status};
use crate::scene_geometry::{SceneGeometry, Side};
use base64::prelude::{BASE64_STANDARD, Engine};
use ndarray::ArrayView2;
use serde_json::{Value, json};

/// Largest size of the coordinates in a page, bytes of base64.
const LIMIT: usize = 24_000_000;
/// Steps of a standard deviation in a centimeter; the largest that is stated is 65 cm.
const SD_STEPS: f64 = 1e3;

/// The smallest step through the frames that keeps the coordinates within [`LIMIT`].
pub(crate) fn sparing(scene: &Scene<'_>) -> usize {
    let bytes_per_frame = scene.figures.len() * scene.points.len() * 3 * 4 * 4 / 3;
    let most = LIMIT
        .checked_div(bytes_per_frame)
        .unwrap_or(usize::MAX)
        .max(1);
    scene.frames().div_ceil(most).max(1)
}

/// Everything the script reads.
pub(crate) fn embedded(
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
        "markers": scene.markers,
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
        "pair": scene.pair.map(|pair| embedded_pair(pair, kept, every)),
        "figures": figures,
    })
}

/// Name, first embedded frame, its time and the embedded frames a second of every run that has an
/// embedded frame.
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
            let position = geometry.at(figure, *frame, point);
            let position = position.unwrap_or([f64::NAN; 3]).map(|v| v as f32);
            bytes.extend(position.into_iter().flat_map(f32::to_le_bytes));
        }
    }
    let code = |status| Status::ALL.iter().position(|s| *s == status).unwrap_or(0);
    let statuses = |point| {
        let codes = kept
            .iter()
            .map(|t| code(geometry.status(figure, *t, point)));
        run_lengths(codes)
    };
    let stated = |sd, t, p| match geometry.status(figure, t, p) {
        Status::Observed => 0.0,
        _ => sd,
    };
    let of = &scene.figures[figure];
    let has_statuses = of.status.is_some();
    json!({
        "name": of.name,
        "note": scene.notes.get(figure),
        "data": BASE64_STANDARD.encode(&bytes),
        "status": has_statuses.then(|| points.clone().map(statuses).collect::<Value>()),
        "method": of.method.map(|m| methods(m, kept)),
        "sd": of.sd.map(|sd| deviations(points.len(), kept, |t, p| stated(sd[[t, p]], t, p))),
    })
}

/// What the script reads of two takes: of each its bones, the points that it has and its own frames
/// (null where these are those of the page), and the differences in centimeters.
fn embedded_pair(pair: &TakePair, kept: &[usize], every: usize) -> Value {
    let takes = pair.takes.iter().map(|take| {
        let frames = kept.iter().map(|t| take.frames[*t]);
        json!({
            "bones": take.bones,
            "has": take.has,
            "frames": (!pair.is_frame_by_frame).then(|| frames.collect::<Vec<_>>()),
        })
    });
    let differences = pair.differences.as_ref().map(|told| {
        let of_frame = |t: &usize| {
            told.frames[*t].map(|d| json!([rounded(d.rms), rounded(d.largest), d.point]))
        };
        let of_point = |d: &PointDifference| {
            json!([d.point, rounded(d.rms), rounded(d.largest), d.frame / every])
        };
        json!({
            "frames": kept.iter().map(of_frame).collect::<Value>(),
            "points": told.points.iter().map(of_point).collect::<Value>(),
        })
    });
    json!({ "takes": takes.collect::<Value>(), "differences": differences })
}

/// Run lengths of how each point was filled: 0 where it was not, else 1 more than the index in
/// [`FillMethod::ALL`].
fn methods(method: ArrayView2<'_, Option<FillMethod>>, kept: &[usize]) -> Vec<Vec<usize>> {
    let index = |method| FillMethod::ALL.iter().position(|m| *m == method);
    let code = |method: Option<FillMethod>| method.and_then(index).map_or(0, |at| at + 1);
    let of_point = |p| run_lengths(kept.iter().map(|t| code(method[[*t, p]])));
    (0..method.ncols()).map(of_point).collect()
}

/// The standard deviations of frames and points, where they are above 0.
fn deviations(points: usize, kept: &[usize], sd: impl Fn(usize, usize) -> f64) -> Value {
    // NaN becomes 0; what is too large, the largest.
    let step = |sd: f64| (sd * SD_STEPS).round() as u16;
    let (mut runs, mut bytes) = (Vec::new(), Vec::new());
    for p in 0..points {
        let steps: Vec<u16> = kept.iter().map(|t| step(sd(*t, p))).collect();
        let is_stated = steps.iter().map(|step| usize::from(*step > 0));
        // Without their codes, the lengths take turns, the first one that of frames without.
        let coded = run_lengths(is_stated);
        let first = coded.first().filter(|code| **code == 1).map(|_| 0);
        let lengths = coded.chunks(2).map(|run| run[1]);
        runs.push(first.into_iter().chain(lengths).collect::<Vec<usize>>());
        let stated = steps.into_iter().filter(|step| *step > 0);
        bytes.extend(stated.flat_map(u16::to_le_bytes));
    }
    json!({ "runs": runs, "data": BASE64_STANDARD.encode(&bytes) })
}

/// Run lengths: the code and the length of each run of equal codes, one after another.
fn run_lengths(codes: impl Iterator<Item = usize>) -> Vec<usize> {
    let codes: Vec<usize> = codes.collect();
    let runs = codes.chunk_by(|a, b| a == b);
    runs.flat_map(|run| [run[0], run.len()]).collect()
}

/// A thousandth of a centimeter, degree or second is enough for a picture.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Figure;

    #[test]
    fn a_long_scene_keeps_every_few_frames() {
        let points = vec![String::new(); 100];
        let xyz = ndarray::Array2::zeros((30_000, 300));
        let scene = Scene {
            points: &points,
            figures: vec![Figure::new("f", xyz.view())],
            ..Scene::default()
        };
        // 1,600 bytes per frame: 15,000 frames fit.
        assert_eq!(sparing(&scene), 2);
        assert_eq!(sparing(&Scene::default()), 1);
    }

    #[test]
    fn statuses_are_run_lengths() {
        assert_eq!(run_lengths([0, 0, 2, 0].into_iter()), [0, 2, 2, 1, 0, 1]);
        assert!(run_lengths([].into_iter()).is_empty());
    }

    #[test]
    fn deviations_are_kept_where_they_are_stated() {
        let sd = ndarray::arr2(&[[0.0, 0.25], [1.5, f64::NAN], [99.0, 0.0], [0.0, 1e-5]]);
        let packed = deviations(2, &[0, 1, 2, 3], |t, p| sd[[t, p]]);
        assert_eq!(packed["runs"], json!([[1, 2, 1], [0, 1, 3]]));
        let bytes = BASE64_STANDARD.decode(packed["data"].as_str().unwrap());
        let bytes = bytes.unwrap();
        let steps = bytes.chunks(2).map(|b| u16::from_le_bytes([b[0], b[1]]));
        assert_eq!(steps.collect::<Vec<_>>(), [1500, 65535, 250]);
    }

    #[test]
    fn methods_are_run_lengths() {
        use FillMethod::*;
        let method = [None, Some(Regression), Some(Regression), Some(Model)];
        let method = ndarray::Array2::from_shape_vec((4, 1), method.to_vec()).unwrap();
        assert_eq!(methods(method.view(), &[0, 1, 2, 3]), [[0, 1, 1, 2, 3, 1]]);
        assert_eq!(methods(method.view(), &[0, 3]), [[0, 1, 3, 1]]);
    }
}
