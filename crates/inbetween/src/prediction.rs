//! What the windows that are known say of a gap.

use super::body_tree::{BodyTree, Frames, turn};
use super::evidence::{Evidence, Residuals, evidence};
use super::library::MotionLibrary;
use super::regression::{Known, blend};
use super::windows::{Clip, Ends, Windows};
use glam::DVec3;
use ndarray::Array2;

/// With fewer windows nothing is said.
const FEWEST: usize = 60;
/// Takes that are named as the nearest, at most.
const NAMED: usize = 3;

/// Where the motion in a gap is from.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSource {
    /// The error expected, as a share of that of the cubic that bridges the gap.
    pub expected: f64,
    /// How much of the motion is used, from 0 to 1: the rest is the cubic.
    pub weight: f64,
    /// The takes of the nearest windows, and the seconds in them; `None`: the take itself.
    pub nearest: Vec<(Option<String>, f64)>,
}

/// What is said of a gap.
pub(crate) struct Prediction {
    /// What is added to the bridge (steps between the ends, points), cm: nothing where the weight
    /// is 0.
    pub residual: Frames,
    pub evidence: Evidence,
    pub source: MotionSource,
}

/// The prediction for the gap of a clip, in which what is inside does not count; `None`: too
/// little is known.
pub(crate) fn predict(
    tree: &BodyTree,
    known: &Known<'_>,
    (clip, ends): (&Clip, Ends),
    library: Option<&MotionLibrary>,
) -> Option<Prediction> {
    let some = known.others.or(known.own)?;
    let count = |w: Option<&Windows>| w.map_or(0, |w| w.at.len());
    if count(known.others) + count(known.own) < FEWEST {
        return None;
    }
    let features = some.features_of(tree, clip, ends);
    let near = known.distances(features.view());
    let found = blend(known, features.view(), near.clone())?;
    let mut residuals = Residuals::default();
    let residual = residuals.blended(tree, known, &found);
    let evidence = evidence(tree, known, &mut residuals, (&found, &residual), &near)?;
    let mut nearest: Vec<(Option<String>, f64)> = Vec::new();
    for window in &found.windows {
        let windows = known.of(*window)?;
        let library = library.filter(|_| !window.is_own);
        let take = windows.origin(window.index).take;
        let name = library.map(|l| l.takes[take].name.clone());
        if nearest.len() < NAMED && !nearest.iter().any(|(known, _)| *known == name) {
            nearest.push((name, windows.seconds(window.index)));
        }
    }
    // Residuals are in the window's heading, and about that of the root.
    let ahead = turn(ends.heading(clip)) * evidence.weight;
    let points = tree.points();
    let steps = residual.len() / (3 * points);
    let off = |k: usize, p: usize| {
        let i = 3 * (k * points + p);
        ahead * DVec3::new(residual[i], residual[i + 1], residual[i + 2])
    };
    let placed = Array2::from_shape_fn((steps, points), |(k, p)| {
        let about_root = f64::from(u8::from(p != tree.root));
        off(k, p) + about_root * off(k, tree.root)
    });
    Some(Prediction {
        residual: placed,
        source: MotionSource {
            expected: evidence.expected,
            weight: evidence.weight,
            nearest,
        },
        evidence,
    })
}

/// Positions (frames, points) between those at two ends (2, points), with bones of these lengths;
/// what that moves at the ends fades. `u` is where each frame is between them.
pub(crate) fn with_bones(
    tree: &BodyTree,
    lengths: &[f64],
    path: &Frames,
    ends: &Frames,
    u: &[f64],
) -> Frames {
    let off = ends - &tree.with_lengths(ends, 1.0, lengths);
    let mut out = tree.with_lengths(path, 1.0, lengths);
    for (mut frame, u) in out.rows_mut().into_iter().zip(u) {
        for (p, at) in frame.iter_mut().enumerate() {
            *at += (1.0 - u).powi(2) * off[[0, p]] + u * u * off[[1, p]];
        }
    }
    out
}

/// The variance of a coordinate at `u` of a gap of `steps` (points): the gap's, shared over time.
pub(crate) fn variance_at(evidence: &Evidence, steps: usize, u: f64) -> Vec<f64> {
    let profile = |u: f64| (4.0 * u * (1.0 - u)).powf(1.5);
    let on_grid = (1..steps).map(|k| profile(k as f64 / steps as f64));
    let mean = on_grid.sum::<f64>() / (steps - 1) as f64;
    let own = profile(u) / mean;
    evidence.variance.iter().map(|v| v * own).collect()
}
