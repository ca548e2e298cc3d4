//! Distances between points that go together: bones that drift, points that have fallen off.

use super::nearby;
use super::other_speeds::OtherSpeeds;
use super::{Finding, FindingKind, Limits, Take, ranges};
use crate::numeric::statistics::{at_ranks, median};
use std::collections::HashSet;

/// Points that go together: their distance stays within this share of itself, and this, cm, in the
/// middle half of the frames of a quarter of the take.
const STEADY: f64 = 0.05;
const STEADY_CM: f64 = 1.0;
/// A point that is farther off than this from where those it goes with have it, cm, and slower than
/// this, cm/s, for so many frames while the others move this fast, has fallen off.
const FALLEN_OFF: f64 = 10.0;
const STILL: f64 = 0.5;
const STILL_FRAMES: usize = 10;
const MOVING: f64 = 5.0;
/// Frames that are looked at for steady distances, and of a quarter, at least.
const FRAMES: usize = 400;
const FEWEST: usize = 10;

/// The point that each goes with, and their usual distance, cm: that of the two quarters of the
/// take in which it is steadiest, as it may drift, and a point may fall off.
fn partners(take: &Take<'_>) -> Vec<Option<(usize, f64)>> {
    let (points, frames) = (take.points.len(), take.xyz.nrows());
    let step = frames.div_ceil(FRAMES).max(1);
    let quarter = |k: usize| k * frames / 4..(k + 1) * frames / 4;
    if quarter(3).len().div_ceil(step) < FEWEST {
        // The last quarter is the longest.
        return vec![None; points];
    }
    // The steadiest so far of each, with its spread.
    let mut best: Vec<Option<(usize, f64, f64)>> = vec![None; points];
    for (p, q) in nearby::pairs(take) {
        let of = |k: usize| spread(distances(take, p, q, quarter(k).step_by(step)));
        let mut quarters: Vec<(f64, f64)> = (0..4).filter_map(of).collect();
        quarters.sort_by(|a, b| a.1.total_cmp(&b.1));
        let Some(&(middle, spread)) = quarters.get(1) else {
            continue;
        };
        if !(middle > STEADY_CM && spread <= (STEADY * middle).min(STEADY_CM)) {
            continue;
        }
        let usual = 0.5 * (quarters[0].0 + middle);
        for (one, other) in [(p, q), (q, p)] {
            if best[one].is_none_or(|(_, _, least)| spread < least) {
                best[one] = Some((other, usual, spread));
            }
        }
    }
    let partner = |best: Option<(usize, f64, f64)>| best.map(|(other, usual, _)| (other, usual));
    best.into_iter().map(partner).collect()
}

/// The median of some distances, and how far the middle half of them spreads; `None` of too few.
fn spread(mut all: Vec<f64>) -> Option<(f64, f64)> {
    if all.len() < FEWEST {
        return None;
    }
    let last = (all.len() - 1) as f64;
    let [high, middle, low] = at_ranks(
        &mut all,
        [0.75, 0.5, 0.25].map(|share| (share * last) as usize),
    );
    Some((middle, high - low))
}

fn distances(take: &Take<'_>, p: usize, q: usize, frames: impl Iterator<Item = usize>) -> Vec<f64> {
    let length = |t: usize| Some((take.at(t, p)? - take.at(t, q)?).length());
    frames.filter_map(length).collect()
}

/// Distances that drift, and points that have fallen off.
pub(super) fn findings(take: &Take<'_>, limits: &Limits) -> Vec<Finding> {
    let mut out = Vec::new();
    let others = OtherSpeeds::of(take);
    for (p, partner) in partners(take).into_iter().enumerate() {
        let Some((q, usual)) = partner else { continue };
        match fallen(take, p, (q, usual), &others) {
            Some(found) => out.push(found),
            None => out.extend(drift(take, p, q, limits)),
        }
    }
    // A pair that drifts is one finding, not two.
    let mut seen: HashSet<Vec<String>> = HashSet::new();
    out.retain(|finding| {
        let mut pair = finding.points.clone();
        pair.sort();
        seen.insert(pair) || finding.kind != FindingKind::Drift
    });
    out
}

fn drift(take: &Take<'_>, p: usize, q: usize, limits: &Limits) -> Option<Finding> {
    let frames = take.xyz.nrows();
    let first = distances(take, p, q, 0..frames / 4);
    let last = distances(take, p, q, frames - frames / 4..frames);
    if first.len().min(last.len()) < FEWEST {
        return None;
    }
    let (first, last) = (median(first)?, median(last)?);
    ((last - first).abs() > limits.drift).then(|| {
        let what = format!(
            "{} and {} are {first:.1} cm apart at first and {last:.1} cm at last (limit {} cm)",
            take.points[p], take.points[q], limits.drift
        );
        take.finding(FindingKind::Drift, &[p, q], None, what)
    })
}

fn fallen(
    take: &Take<'_>,
    p: usize,
    (q, usual): (usize, f64),
    others: &OtherSpeeds<'_, '_>,
) -> Option<Finding> {
    let rate = take.rate?;
    let lies = |t: &usize| {
        let (now, next, other) = (take.at(*t, p)?, take.at(*t + 1, p)?, take.at(*t, q)?);
        let is_off = ((now - other).length() - usual).abs() > FALLEN_OFF;
        Some(is_off && (next - now).length() * rate < STILL)
    };
    let lying = ranges(take.steps().filter(|t| lies(t) == Some(true)));
    let long = lying.into_iter().filter(|r| r.len() > STILL_FRAMES);
    let found = long.filter(|r| others.median(r.clone(), p, rate) > MOVING);
    let longest = found.max_by_key(|r| r.len())?;
    let what = format!(
        "{} lies still for {} frames, {FALLEN_OFF} cm and more from where {} has it: it has \
         fallen off",
        take.points[p],
        longest.len(),
        take.points[q]
    );
    Some(take.finding(FindingKind::Fallen, &[p], Some(longest), what))
}
