//! The line of shifts over a recording whose clock runs faster or slower: windows of B are found in
//! A one after another, the first anywhere, the others near it, and the line is that of the medians
//! of their slopes (Theil 1950; Sen 1968).

use super::search::{GRID, PlaceInTime, moving, places_of, vertex};
use super::speeds::Speeds;
use crate::numeric::statistics::median;
use std::ops::Range;

/// The window that is found first, seconds, at most; and the others.
const FIRST: f64 = 30.0;
const WINDOW: f64 = 12.0;
const FEWEST_WINDOWS: f64 = 5.0;
/// Clocks differ by no more.
pub(super) const LARGEST_DRIFT: f64 = 0.012;
/// A window is found within this of where the line may be, seconds.
const SLACK: f64 = 0.25;
/// Windows that correlate less are not.
const LEAST_CORRELATION: f64 = 0.6;

/// The best places of B beside A, with the drift by the first of them.
pub(super) fn places(a: &Speeds, b: &Speeds) -> Vec<PlaceInTime> {
    let grid = GRID.min(a.rate).min(b.rate);
    let (a, b) = (a.sampled(1.0 / grid), b.sampled(1.0 / grid));
    let points = moving(&a, &b);
    let frames = b.first().map_or(0, Vec::len);
    let size = frames.min((FIRST * grid) as usize);
    let window = liveliest(&b, &points, size);
    let part: Vec<Vec<f64>> = b.iter().map(|v| v[window.clone()].to_vec()).collect();
    let places = places_of(&a, &part, grid);
    let Some(first) = places.first() else {
        return places;
    };
    let anchor = [
        (window.start + window.end) as f64 / 2.0,
        first.shift * grid - window.start as f64,
    ];
    let size = (frames as f64 / FEWEST_WINDOWS).min(WINDOW * grid) as usize;
    let starts = (0..=frames.saturating_sub(size)).step_by((size / 2).max(1));
    let found: Vec<[f64; 2]> = starts
        .filter_map(|start| near(&a, &b, &points, start..start + size, anchor, grid))
        .collect();
    let drift = slope(&found, size as f64).unwrap_or(0.0);
    let shift = median(found.iter().map(|[at, shift]| shift - drift * at).collect());
    let line = shift.unwrap_or(anchor[1]) / grid;
    let on_line = |place: &PlaceInTime| PlaceInTime {
        shift: line + place.shift - first.shift,
        drift,
        ..*place
    };
    places.iter().map(on_line).collect()
}

/// The frames in a row, so many, in which the speeds vary most.
fn liveliest(b: &[Vec<f64>], points: &[usize], size: usize) -> Range<usize> {
    let frames = b.first().map_or(0, Vec::len);
    let change = |t: usize| {
        let steps = points.iter().map(|p| (b[*p][t] - b[*p][t - 1]).powi(2));
        steps.filter(|v| v.is_finite()).sum::<f64>()
    };
    let mut sums = vec![0.0; frames.max(1)];
    (1..frames).for_each(|t| sums[t] = sums[t - 1] + change(t));
    let within = |start: usize| sums[start + size - 1] - sums[start];
    let starts = 0..=frames - size;
    let best = starts
        .filter(|_| size > 0)
        .max_by(|x, y| within(*x).total_cmp(&within(*y)));
    best.map_or(0..0, |start| start..start + size)
}

/// The middle of a window of B and its shift in A, both in frames, near the line through `anchor`
/// (such a middle and shift); `None` where it is not found.
fn near(
    a: &[Vec<f64>],
    b: &[Vec<f64>],
    points: &[usize],
    window: Range<usize>,
    anchor: [f64; 2],
    grid: f64,
) -> Option<[f64; 2]> {
    let middle = (window.start + window.end) as f64 / 2.0;
    let reach = LARGEST_DRIFT * (middle - anchor[0]).abs() + SLACK * grid;
    let from = (anchor[1] - reach).floor() as isize;
    let to = (anchor[1] + reach).ceil() as isize;
    let correlations: Vec<f64> = (from - 1..=to + 1)
        .map(|shift| correlation(a, b, points, window.clone(), shift))
        .collect();
    let inner = 1..correlations.len() - 1;
    let best = inner.max_by(|x, y| correlations[*x].total_cmp(&correlations[*y]))?;
    let beside = [best - 1, best, best + 1].map(|k| correlations[k]);
    let is_peak = beside[1] >= LEAST_CORRELATION && beside[1] >= beside[0].max(beside[2]);
    let shift = (from - 1) as f64 + best as f64 + vertex(beside);
    is_peak.then_some([middle, shift])
}

/// The correlation of a window of B with A at a shift, over all points; 0 where A lacks a quarter.
fn correlation(
    a: &[Vec<f64>],
    b: &[Vec<f64>],
    points: &[usize],
    window: Range<usize>,
    shift: isize,
) -> f64 {
    let (mut covariance, mut variances, mut compared) = (0.0, [0.0; 2], 0);
    for p in points {
        let (mut n, mut sums) = (0.0, [0.0; 5]);
        for t in window.clone() {
            let in_a = t.checked_add_signed(shift).and_then(|t| a[*p].get(t));
            let (x, y) = (in_a.copied().unwrap_or(f64::NAN), b[*p][t]);
            if (x * y).is_finite() {
                n += 1.0;
                let all = [x, y, x * x, y * y, x * y];
                sums.iter_mut().zip(all).for_each(|(sum, v)| *sum += v);
            }
        }
        if n > 0.0 {
            let [x, y, xx, yy, xy] = sums;
            covariance += xy - x * y / n;
            variances[0] += xx - x * x / n;
            variances[1] += yy - y * y / n;
            compared += n as usize;
        }
    }
    let r = covariance / (variances[0] * variances[1]).sqrt();
    let is_whole = 4 * compared >= 3 * window.len() * points.len();
    if is_whole && r.is_finite() { r } else { 0.0 }
}

/// The median of the slopes between windows that do not overlap.
fn slope(found: &[[f64; 2]], size: f64) -> Option<f64> {
    let mut slopes = Vec::new();
    for (i, [x, y]) in found.iter().enumerate() {
        let later = found[i + 1..].iter().filter(|other| other[0] - x >= size);
        slopes.extend(later.map(|other| (other[1] - y) / (other[0] - x)));
    }
    median(slopes).map(|slope| slope.clamp(-LARGEST_DRIFT, LARGEST_DRIFT))
}
