//! Errors by the state of the damaged table: missing (by gap length), observed, changed.

use super::error_stats::{ErrorStats, ErrorSums, point};
use ndarray::ArrayView2;
use serde::Serialize;
use std::ops::Range;

/// Coordinates that differ by no more than this are unchanged, cm. Rounding to f32 and the way to
/// the model's space and back stay below one micrometer.
pub(crate) const UNCHANGED: f64 = 1e-4;

/// Upper ends of the bins of gap lengths, seconds; the last bin has none.
pub(crate) const GAP_SECONDS: [f64; 5] = [0.1, 0.3, 0.6, 1.0, 2.0];
/// Upper ends of the bins of gap lengths without a rate, frames.
pub(crate) const GAP_FRAMES: [u64; 5] = [10, 30, 60, 100, 200];

/// Errors by the state of the damaged table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorBreakdown {
    /// The damaged table itself against the truth; `still_missing` counts what it lacks.
    pub before: ErrorStats,
    /// The result where the damaged table has no value.
    pub missing: ErrorStats,
    /// `missing` by gap length: the consecutive frames in which a point lacks a coordinate.
    pub by_gap: Vec<GapErrors>,
    /// The result where the damaged table has a value.
    pub observed: ErrorStats,
    /// The result where that value differs from the truth by more than 0.0001 cm.
    pub corrupted: ErrorStats,
    /// The result where that value is right.
    pub intact: ErrorStats,
    /// The result where it differs from that value by more than 0.0001 cm.
    pub changed: ErrorStats,
}

/// Errors in gaps of one bin of lengths.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapErrors {
    /// Gaps longer than this, in seconds; in frames without a rate.
    pub longer_than: f64,
    /// Gaps of up to this length, in seconds (frames without a rate); `None` for the last bin.
    pub up_to: Option<f64>,
    /// The number of gaps, each of one point.
    pub gaps: u64,
    /// The errors in these gaps.
    #[serde(flatten)]
    pub errors: ErrorStats,
}

/// The open gap of a point: its frames so far and its errors.
type OpenGap = (u64, ErrorSums);

impl ErrorBreakdown {
    /// Compares tables (frames, 3 J) within `runs` of consecutive frames, each with its frames a
    /// second; lengths in a unit of `unit` centimeters.
    pub(super) fn of(
        truth: ArrayView2<'_, f64>,
        result: ArrayView2<'_, f64>,
        damaged: ArrayView2<'_, f64>,
        runs: &[(Range<usize>, Option<f64>)],
        unit: f64,
    ) -> ErrorBreakdown {
        let [mut before, mut missing, mut observed] = [ErrorSums::default(); 3];
        let [mut corrupted, mut intact, mut changed] = [ErrorSums::default(); 3];
        let mut bins: [(u64, ErrorSums); GAP_SECONDS.len() + 1] = Default::default();
        let mut open = vec![OpenGap::default(); truth.ncols() / 3];
        let mut last_rate = None;
        for (run, rate) in runs {
            last_rate = rate.or(last_rate);
            for t in run.clone() {
                for (i, gap) in open.iter_mut().enumerate() {
                    let [t, r, d] = [truth, result, damaged].map(|xyz| point(xyz.row(t), i));
                    let is_missing = d.map(f64::is_nan);
                    let is_observed = is_missing.map(|m| !m);
                    // Comparisons with NaN are false: a missing coordinate is in none of these.
                    let is_corrupted = [0, 1, 2].map(|a| (d[a] - t[a]).abs() > UNCHANGED);
                    let is_intact = [0, 1, 2].map(|a| (d[a] - t[a]).abs() <= UNCHANGED);
                    let is_changed = [0, 1, 2].map(|a| (r[a] - d[a]).abs() > UNCHANGED);
                    before.add(t, d, [true; 3]);
                    observed.add(t, r, is_observed);
                    corrupted.add(t, r, is_corrupted);
                    intact.add(t, r, is_intact);
                    changed.add(t, r, is_changed);
                    if is_observed == [true; 3] {
                        close(gap, &mut bins, last_rate);
                    } else {
                        missing.add(t, r, is_missing);
                        gap.0 += 1;
                        gap.1.add(t, r, is_missing);
                    }
                }
            }
            for gap in &mut open {
                close(gap, &mut bins, last_rate);
            }
        }
        let limits = if last_rate.is_some() {
            GAP_SECONDS
        } else {
            GAP_FRAMES.map(|f| f as f64)
        };
        let by_gap = bins.iter().enumerate().map(|(i, (gaps, sums))| GapErrors {
            longer_than: if i == 0 { 0.0 } else { limits[i - 1] },
            up_to: limits.get(i).copied(),
            gaps: *gaps,
            errors: sums.errors(unit),
        });
        ErrorBreakdown {
            by_gap: by_gap.collect(),
            before: before.errors(unit),
            missing: missing.errors(unit),
            observed: observed.errors(unit),
            corrupted: corrupted.errors(unit),
            intact: intact.errors(unit),
            changed: changed.errors(unit),
        }
    }
}

/// Ends a gap. One in which the truth has no value does not count.
fn close(gap: &mut OpenGap, bins: &mut [(u64, ErrorSums)], rate: Option<f64>) {
    let (frames, sums) = std::mem::take(gap);
    if sums.is_empty() {
        return;
    }
    // Whole frames: 9 frames at 29.97 a second are 0.3 s.
    let within = |bin: &usize| match rate {
        Some(rate) => frames as f64 <= (GAP_SECONDS[*bin] * rate).round(),
        None => frames <= GAP_FRAMES[*bin],
    };
    let last = GAP_SECONDS.len();
    let bin = (0..last).find(within).unwrap_or(last);
    bins[bin].0 += 1;
    bins[bin].1.merge(&sums);
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    const NAN: f64 = f64::NAN;

    /// Compares one point whose damaged table lacks the frames marked `.`; the result is off by one
    /// everywhere. `|` starts a run.
    fn gaps(seen: &str, rate: Option<f64>) -> ErrorBreakdown {
        let (mut runs, mut frames) = (Vec::new(), 0);
        for run in seen.split('|') {
            runs.push((frames..frames + run.len(), rate));
            frames += run.len();
        }
        let seen = seen.replace('|', "").into_bytes();
        let value = |(t, _): (usize, usize)| if seen[t] == b'.' { NAN } else { 0.0 };
        let damaged = Array2::from_shape_fn((frames, 3), value);
        let [truth, result] = [0.0, 1.0].map(|v| Array2::from_elem((frames, 3), v));
        ErrorBreakdown::of(truth.view(), result.view(), damaged.view(), &runs, 1.0)
    }

    #[test]
    fn gaps_are_sorted_by_length() {
        let counts = |d: &ErrorBreakdown| d.by_gap.iter().map(|b| b.gaps).collect::<Vec<_>>();
        // At ten frames a second a frame is 0.1 s.
        let d = gaps("x.x..x...x....x......x...........", Some(10.0));
        assert_eq!(counts(&d), [1, 2, 2, 0, 1, 0]);
        assert_eq!(d.by_gap[1].errors.coordinates, 15);
        assert_eq!(d.missing.coordinates, 3 * 27);
        assert_eq!(d.missing.rms, Some(1.0));
        // A gap ends where a run does.
        assert_eq!(counts(&gaps("x..|..x", Some(10.0))), [0, 2, 0, 0, 0, 0]);
        // Without a rate: frames.
        let long = format!("x{}x{}", ".".repeat(10), ".".repeat(201));
        assert_eq!(counts(&gaps(&long, None)), [1, 0, 0, 0, 0, 1]);
        assert_eq!(counts(&gaps("xxx", None)), [0; 6]);
        // Lengths are rounded to frames.
        let nine = format!("x{}x", ".".repeat(9));
        assert_eq!(gaps(&nine, Some(30.0 / 1.001)).by_gap[1].gaps, 1);
    }

    #[test]
    fn coordinates_are_sorted_by_the_damaged_table() {
        let truth = Array2::zeros((1, 12));
        // Left as it was, mended, spoiled, filled but for one coordinate.
        let result = array![[0., 0., 0., 1., 1., 1., 2., 2., 2., 3., 3., NAN]];
        let damaged = array![[0., 0., 0., 9., 9., 9., 0., 0., 0., NAN, NAN, NAN]];
        let [truth, result, damaged] = [&truth, &result, &damaged].map(|a| a.view());
        let d = ErrorBreakdown::of(truth, result, damaged, &[(0..1, None)], 1.0);
        let of = |e: &ErrorStats| (e.coordinates, e.still_missing, e.mse);
        assert_eq!(of(&d.before), (9, 3, Some(27.0)));
        assert_eq!(of(&d.missing), (2, 1, Some(9.0)));
        assert_eq!(of(&d.observed), (9, 0, Some(5.0 / 3.0)));
        assert_eq!(of(&d.corrupted), (3, 0, Some(1.0)));
        assert_eq!(of(&d.intact), (6, 0, Some(2.0)));
        assert_eq!(of(&d.changed), (6, 0, Some(2.5)));
    }
}
