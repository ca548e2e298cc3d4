//! Errors by the state of the damaged table: missing (by gap length), observed, changed.

use super::error_stats::{ErrorStats, ErrorSums, point};
use super::frame::ScoredFrame;
use serde::Serialize;

/// Coordinates that differ by no more than this are unchanged, cm. Rounding to f32 and the way to the model's space and back
/// stay below one micrometre.
pub const UNCHANGED: f64 = 1e-4;

/// Upper ends of the bins of gap lengths, seconds; the last bin has none.
pub const GAP_SECONDS: [f64; 5] = [0.1, 0.3, 0.6, 1.0, 2.0];
/// Upper ends of the bins of gap lengths without a rate, frames.
pub const GAP_FRAMES: [u64; 5] = [10, 30, 60, 100, 200];

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
    /// The result where that value differs from the truth by more than [`UNCHANGED`].
    pub corrupted: ErrorStats,
    /// The result where that value is right.
    pub intact: ErrorStats,
    /// The result where it differs from that value by more than [`UNCHANGED`].
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

/// The sums behind [`ErrorBreakdown`].
#[derive(Debug, Clone)]
pub(super) struct BreakdownSums {
    before: ErrorSums,
    missing: ErrorSums,
    observed: ErrorSums,
    corrupted: ErrorSums,
    intact: ErrorSums,
    changed: ErrorSums,
    /// The open gap of each point: its frames so far and its errors.
    open: Vec<(u64, ErrorSums)>,
    /// The gaps and errors of each bin.
    bins: [(u64, ErrorSums); GAP_SECONDS.len() + 1],
    /// The rate of the last take that has one.
    rate: Option<f64>,
}

impl BreakdownSums {
    pub(super) fn new(points: usize) -> BreakdownSums {
        BreakdownSums {
            before: ErrorSums::default(),
            missing: ErrorSums::default(),
            observed: ErrorSums::default(),
            corrupted: ErrorSums::default(),
            intact: ErrorSums::default(),
            changed: ErrorSums::default(),
            open: vec![Default::default(); points],
            bins: Default::default(),
            rate: None,
        }
    }

    pub(super) fn add(&mut self, frame: &ScoredFrame<'_>, damaged: &[f64]) {
        if frame.starts_run {
            (0..self.open.len()).for_each(|i| self.close(i));
        }
        self.rate = frame.rate.or(self.rate);
        for i in 0..self.open.len() {
            let [t, r, d] = [frame.truth, frame.result, damaged].map(|xyz| point(xyz, i));
            let missing = d.map(f64::is_nan);
            let observed = missing.map(|m| !m);
            // Comparisons with NaN are false: a missing coordinate is in none of these.
            let corrupted = [0, 1, 2].map(|a| (d[a] - t[a]).abs() > UNCHANGED);
            let intact = [0, 1, 2].map(|a| (d[a] - t[a]).abs() <= UNCHANGED);
            let changed = [0, 1, 2].map(|a| (r[a] - d[a]).abs() > UNCHANGED);
            self.before.add(t, d, [true; 3]);
            self.observed.add(t, r, observed);
            self.corrupted.add(t, r, corrupted);
            self.intact.add(t, r, intact);
            self.changed.add(t, r, changed);
            if observed == [true; 3] {
                self.close(i);
            }
            if observed != [true; 3] {
                self.missing.add(t, r, missing);
                self.open[i].0 += 1;
                self.open[i].1.add(t, r, missing);
            }
        }
    }

    /// Ends the open gap of a point. A gap in which the truth has no value does not count.
    fn close(&mut self, point: usize) {
        let (frames, sums) = std::mem::take(&mut self.open[point]);
        if sums.is_empty() {
            return;
        }
        // Whole frames: 9 frames at 29.97 a second are 0.3 s.
        let within = |bin: usize| match self.rate {
            Some(rate) => frames as f64 <= (GAP_SECONDS[bin] * rate).round(),
            None => frames <= GAP_FRAMES[bin],
        };
        let last = GAP_SECONDS.len();
        let bin = (0..last).find(|&bin| within(bin)).unwrap_or(last);
        self.bins[bin].0 += 1;
        self.bins[bin].1.merge(&sums);
    }

    /// `is_timed`: bins are in seconds.
    pub(super) fn finish(mut self, unit: f64, is_timed: bool) -> ErrorBreakdown {
        for point in 0..self.open.len() {
            self.close(point);
        }
        let limits = match is_timed {
            true => GAP_SECONDS,
            false => GAP_FRAMES.map(|f| f as f64),
        };
        let bins = self.bins.iter().enumerate();
        let by_gap = bins.map(|(i, (gaps, sums))| GapErrors {
            longer_than: if i == 0 { 0.0 } else { limits[i - 1] },
            up_to: limits.get(i).copied(),
            gaps: *gaps,
            errors: sums.errors(unit),
        });
        ErrorBreakdown {
            by_gap: by_gap.collect(),
            before: self.before.errors(unit),
            missing: self.missing.errors(unit),
            observed: self.observed.errors(unit),
            corrupted: self.corrupted.errors(unit),
            intact: self.intact.errors(unit),
            changed: self.changed.errors(unit),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::score::ScoreAccumulator;
    use super::*;

    const NAN: f64 = f64::NAN;

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    /// Scores one point whose damaged table lacks the frames marked `.`; the result is off by one everywhere.
    fn gaps(seen: &str, rate: Option<f64>, starts: &[usize]) -> ErrorBreakdown {
        let mut s = ScoreAccumulator::new(&names(1), true);
        for (i, c) in seen.chars().enumerate() {
            s.add(&ScoredFrame {
                truth: &[0.0; 3],
                result: &[1.0; 3],
                damaged: Some(&[if c == '.' { NAN } else { 0.0 }; 3]),
                starts_run: i == 0 || starts.contains(&i),
                rate,
            });
        }
        s.finish("cm", 1.0).damaged.unwrap()
    }

    #[test]
    fn gaps_are_sorted_by_length() {
        let counts = |d: &ErrorBreakdown| d.by_gap.iter().map(|b| b.gaps).collect::<Vec<_>>();
        // At ten frames a second a frame is 0.1 s.
        let d = gaps("x.x..x...x....x......x...........", Some(10.0), &[]);
        assert_eq!(counts(&d), [1, 2, 2, 0, 1, 0]);
        assert_eq!(d.by_gap[1].errors.coordinates, 15);
        assert_eq!(d.missing.coordinates, 3 * 27);
        assert_eq!(d.missing.rms, Some(1.0));
        // A gap ends where a run does.
        assert_eq!(
            counts(&gaps("x....x", Some(10.0), &[3])),
            [0, 2, 0, 0, 0, 0]
        );
        // Without a rate: frames.
        let long = format!("x{}x{}", ".".repeat(10), ".".repeat(201));
        assert_eq!(counts(&gaps(&long, None, &[])), [1, 0, 0, 0, 0, 1]);
        assert_eq!(counts(&gaps("xxx", None, &[])), [0; 6]);
    }

    #[test]
    fn gap_lengths_are_rounded_to_frames() {
        let rate = 30.0 / 1.001;
        let d = gaps(&format!("x{}x", ".".repeat(9)), Some(rate), &[]);
        assert_eq!(d.by_gap[1].gaps, 1);
    }

    #[test]
    fn coordinates_are_sorted_by_the_damaged_table() {
        let mut s = ScoreAccumulator::new(&names(4), true);
        s.add(&ScoredFrame {
            truth: &[0.0; 12],
            // Left as it was, mended, spoilt, filled but for one coordinate.
            result: &[0., 0., 0., 1., 1., 1., 2., 2., 2., 3., 3., NAN],
            damaged: Some(&[0., 0., 0., 9., 9., 9., 0., 0., 0., NAN, NAN, NAN]),
            starts_run: true,
            rate: None,
        });
        let d = s.finish("cm", 1.0).damaged.unwrap();
        let of = |e: &ErrorStats| (e.coordinates, e.still_missing, e.mse);
        assert_eq!(of(&d.before), (9, 3, Some(27.0)));
        assert_eq!(of(&d.missing), (2, 1, Some(9.0)));
        assert_eq!(of(&d.observed), (9, 0, Some(5.0 / 3.0)));
        assert_eq!(of(&d.corrupted), (3, 0, Some(1.0)));
        assert_eq!(of(&d.intact), (6, 0, Some(2.0)));
        assert_eq!(of(&d.changed), (6, 0, Some(2.5)));
    }
}
