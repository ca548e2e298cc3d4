//! Distances between points that go together: bones that drift, points that have fallen off.

use super::motion::speed_of_others;
use super::{Finding, FindingKind, Limits, Take, median, ranges};

/// Points that go together: their distance stays within this share of itself, and this, cm, in the middle half of the frames of a
/// quarter of the take.
const STEADY: f64 = 0.05;
const STEADY_CM: f64 = 1.0;
/// A point that is farther off than this from where those it goes with have it, cm, and slower than this, cm/s, for so many frames
/// while the others move this fast, has fallen off.
const FALLEN_OFF: f64 = 10.0;
const STILL: f64 = 0.5;
const STILL_FRAMES: usize = 10;
const MOVING: f64 = 5.0;
/// Frames that are looked at for steady distances, and of a quarter, at least.
const FRAMES: usize = 400;
const FEWEST: usize = 10;

/// The point that each goes with, and their usual distance, cm: that of the two quarters of the take in which it is steadiest, as it
/// may drift, and a point may fall off.
fn partners(take: &Take<'_>) -> Vec<Option<(usize, f64)>> {
    let (points, frames) = (take.points.len(), take.xyz.nrows());
    let step = frames.div_ceil(FRAMES).max(1);
    let quarter = |k: usize| k * frames / 4..(k + 1) * frames / 4;
    let partner = |p: usize| {
        let candidates = (0..points).filter(|&q| q != p).filter_map(|q| {
            let of = |k: usize| spread(distances(take, p, q, quarter(k).step_by(step)));
            let mut quarters: Vec<(f64, f64)> = (0..4).filter_map(of).collect();
            quarters.sort_by(|a, b| a.1.total_cmp(&b.1));
            let (middle, spread) = *quarters.get(1)?;
            let is_steady = middle > STEADY_CM && spread <= (STEADY * middle).min(STEADY_CM);
            is_steady.then_some((q, 0.5 * (quarters[0].0 + middle), spread))
        });
        let best = candidates.min_by(|a, b| a.2.total_cmp(&b.2));
        best.map(|(q, middle, _)| (q, middle))
    };
    (0..points).map(partner).collect()
}

/// The median of some distances, and how far the middle half of them spreads; `None` of too few.
fn spread(mut all: Vec<f64>) -> Option<(f64, f64)> {
    if all.len() < FEWEST {
        return None;
    }
    all.sort_by(f64::total_cmp);
    let at = |share: f64| all[(share * (all.len() - 1) as f64) as usize];
    Some((at(0.5), at(0.75) - at(0.25)))
}

fn distances(take: &Take<'_>, p: usize, q: usize, frames: impl Iterator<Item = usize>) -> Vec<f64> {
    let length = |t: usize| Some((take.at(t, p)? - take.at(t, q)?).length());
    frames.filter_map(length).collect()
}

/// Distances that drift, and points that have fallen off.
pub(super) fn findings(take: &Take<'_>, limits: &Limits) -> Vec<Finding> {
    let mut out = Vec::new();
    for (p, partner) in partners(take).into_iter().enumerate() {
        let Some((q, usual)) = partner else { continue };
        match fallen(take, p, q, usual) {
            Some(found) => out.push(found),
            None => out.extend(drift(take, p, q, limits)),
        }
    }
    // A pair that drifts is one finding, not two.
    let mut seen: Vec<Vec<String>> = Vec::new();
    out.retain(|finding| {
        let mut pair = finding.points.clone();
        pair.sort();
        let is_new = finding.kind != FindingKind::Drift || !seen.contains(&pair);
        seen.push(pair);
        is_new
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

fn fallen(take: &Take<'_>, p: usize, q: usize, usual: f64) -> Option<Finding> {
    let rate = take.rate?;
    let lies = |t: &usize| {
        let (now, next, other) = (take.at(*t, p)?, take.at(*t + 1, p)?, take.at(*t, q)?);
        let is_off = ((now - other).length() - usual).abs() > FALLEN_OFF;
        Some(is_off && (next - now).length() * rate < STILL)
    };
    let lying = ranges(take.steps().filter(|t| lies(t) == Some(true)));
    let long = lying.into_iter().filter(|r| r.len() > STILL_FRAMES);
    let found = long.filter(|r| speed_of_others(take, r.clone(), p, rate) > MOVING);
    let longest = found.max_by_key(|r| r.len())?;
    let what = format!(
        "{} lies still for {} frames, {FALLEN_OFF} cm and more from where {} has it: it has fallen off",
        take.points[p],
        longest.len(),
        take.points[q]
    );
    Some(take.finding(FindingKind::Fallen, &[p], Some(longest), what))
}
