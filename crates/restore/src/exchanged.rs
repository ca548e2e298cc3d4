//! Left and right that were exchanged, put back.

use super::take::Take;
use crate::label::exchanges::exchanges;
use crate::pose::point_at;
use ndarray::{Array2, ArrayView2};

/// A take whose exchanged points have their own positions.
pub(crate) struct Exchanged {
    /// (frames, 3 J), cm.
    pub xyz: Array2<f64>,
    /// The points of each frame that were measured as another alone, and are now missing.
    pub emptied: Vec<Vec<usize>>,
    /// How many pairs of points were exchanged, frame by frame.
    pub count: usize,
}

impl Exchanged {
    /// A take in which nothing was exchanged.
    pub(crate) fn none(xyz: ArrayView2<'_, f64>) -> Exchanged {
        Exchanged {
            emptied: vec![Vec::new(); xyz.nrows()],
            xyz: xyz.to_owned(),
            count: 0,
        }
    }
}

/// Gives exchanged points of `xyz` (frames, 3 J) their own positions; `seen` is the same take
/// without its spikes, which tells what was exchanged, and `noise` the standard deviation of a
/// coordinate, cm.
pub(crate) fn put_back(seen: &Take<'_>, xyz: ArrayView2<'_, f64>, noise: f64) -> Exchanged {
    let found = exchanges(seen.names, seen.xyz, seen.runs, seen.rate, noise);
    let mut out = Exchanged::none(xyz);
    found.iter().for_each(|e| e.put_back(&mut out.xyz));
    for e in &found {
        for t in e.frames.clone() {
            let is_seen = |xyz, p| point_at(xyz, t, p).is_finite();
            let is_emptied = |p: &&usize| is_seen(xyz, **p) && !is_seen(out.xyz.view(), **p);
            out.emptied[t].extend(e.points.iter().filter(is_emptied));
        }
    }
    out.count = found.iter().map(|e| e.frames.len()).sum();
    out
}
