//! Measured positions that were replaced as outliers.

use crate::pose::Status;
use crate::restore::Restoration;
use glam::DVec3;
use ndarray::ArrayView2;
use serde::Serialize;

/// A measured position that was replaced.
#[derive(Debug, Serialize)]
pub(crate) struct ReplacedPosition {
    /// The point.
    pub point: String,
    /// The frame, counted from 0 over the file.
    pub frame: usize,
    /// Where it was, cm, y up.
    pub was: [f64; 3],
    /// How far it was moved, cm.
    pub moved: f64,
}

/// The measured positions that were replaced as outliers; `captured` are those of the file (frames,
/// 3 points).
pub(crate) fn replaced(
    restored: &Restoration<'_>,
    captured: ArrayView2<'_, f64>,
) -> Vec<ReplacedPosition> {
    let poses = &restored.source().poses;
    let mut out = Vec::new();
    for t in 0..poses.frames() {
        for (p, point) in poses.points.iter().enumerate() {
            if restored.status(t, p) != Status::Rejected {
                continue;
            }
            let at = |xyz: ArrayView2<'_, f64>| [0, 1, 2].map(|c| xyz[[t, 3 * p + c]]);
            let (was, now) = (at(captured), at(restored.xyz()));
            let moved = DVec3::from_array(was).distance(DVec3::from_array(now));
            if moved > 0.0 {
                out.push(ReplacedPosition {
                    point: point.clone(),
                    frame: t,
                    was,
                    moved,
                });
            }
        }
    }
    out
}
