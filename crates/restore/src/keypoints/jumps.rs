//! Keypoints that jump off their path for a frame.

use super::tuning::*;
use crate::numeric::statistics::median;
use crate::outliers::spikes_by_time;
use crate::pose::point_at;
use crate::take::Take;

/// The points of each frame that jump off their path: those that `spikes_by_time` finds, and those
/// that stand off between the frames beside them, for a single frame, by many times what is usual
/// nearby.
pub(super) fn jumps(take: &Take<'_>) -> Vec<Vec<usize>> {
    let mut out = spikes_by_time(take, None);
    let reach = (JUMP_NEARBY * take.rate).ceil() as usize;
    for (p, run) in (0..take.names.len()).flat_map(|p| take.runs.iter().map(move |run| (p, run))) {
        let at = |t: usize| point_at(take.xyz, t, p);
        let off = |t: usize| at(t).distance(at(t - 1).midpoint(at(t + 1)));
        let first = run.start + 1;
        let offs: Vec<f64> = (first..run.end.saturating_sub(1)).map(off).collect();
        for (n, far) in offs.iter().enumerate().filter(|(_, far)| **far > JUMP) {
            let near = &offs[n.saturating_sub(reach)..(n + reach + 1).min(offs.len())];
            // The frames beside a jump are off by half of it.
            let beside = &offs[n.saturating_sub(1)..(n + 2).min(offs.len())];
            let usual = median(near.iter().copied().filter(|d| d.is_finite()).collect());
            let is_jump = *far > JUMP_TIMES * usual.unwrap_or(f64::INFINITY);
            if is_jump && !beside.iter().any(|other| other > far) && !out[first + n].contains(&p) {
                out[first + n].push(p);
            }
        }
    }
    out
}
