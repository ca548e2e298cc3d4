//! ErrorStats by what the damaged table held: what was missing, by the length of the gap, what was observed, what changed.

use super::error_stats::{ErrorStats, ErrorSums, point};
use super::frame::ScoredFrame;
use serde::Serialize;

/// Coordinates that differ by no more than this count as unchanged, in centimetres: a micrometre, which single precision
/// and a turn to the model's space and back stay below, and no capture resolves.
pub const UNCHANGED: f64 = 1e-4;

/// The upper ends of the bins of gap lengths in seconds; the last bin has none.
pub const GAP_SECONDS: [f64; 5] = [0.1, 0.3, 0.6, 1.0, 2.0];
/// The same in frames, where there is no rate.
pub const GAP_FRAMES: [u64; 5] = [10, 30, 60, 100, 200];

/// The errors by what the damaged table held.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorBreakdown {
    /// The damaged table itself against the truth: how bad things were. What it lacks is its `still_missing`.
    pub before: ErrorStats,
    /// The result over what was missing.
    pub missing: ErrorStats,
    /// The same by the length of the gap: the frames in a row in which a point lacked any coordinate.
    pub by_gap: Vec<GapErrors>,
    /// The result over what was observed.
    pub observed: ErrorStats,
    /// The result over what was observed and off the truth (by more than [`UNCHANGED`]).
    pub corrupted: ErrorStats,
    /// The result over what was observed and right.
    pub intact: ErrorStats,
    /// The result over what was observed and is another value now (by more than [`UNCHANGED`]).
    pub changed: ErrorStats,
}

/// The errors over gaps of some length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapErrors {
    /// GapInjection longer than this many seconds; frames where there is no rate.
    pub longer_than: f64,
    /// GapInjection of up to this many seconds (frames); none for the last bin.
    pub up_to: Option<f64>,
    /// How many gaps of a point there are.
    pub gaps: u64,
    /// Their errors.
    #[serde(flatten)]
    pub errors: ErrorStats,
}

/// Adds up [`ErrorBreakdown`].
#[derive(Debug, Clone)]
pub(super) struct BreakdownSums {
    before: ErrorSums,
    missing: ErrorSums,
    observed: ErrorSums,
    corrupted: ErrorSums,
    intact: ErrorSums,
    changed: ErrorSums,
    /// The gap each point is in: its frames so far and its errors.
    open: Vec<(u64, ErrorSums)>,
    /// Each bin's gaps and errors.
    bins: [(u64, ErrorSums); GAP_SECONDS.len() + 1],
    /// Of the last take that has one.
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
            // A difference from NaN is above nothing: what is missing is in none of these.
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

    /// Ends the gap a point is in, if any. One where the truth has nothing either is none.
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

    /// `is_timed`: gaps are told in seconds.
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

    /// ScoreSums one point whose damaged table lacks the frames marked `.`; the result is off by one everywhere.
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
    fn gaps_of_whole_frames_fall_in_the_bin_they_were_made_for() {
        let rate = 30.0 / 1.001;
        let d = gaps(&format!("x{}x", ".".repeat(9)), Some(rate), &[]);
        assert_eq!(d.by_gap[1].gaps, 1);
    }

    #[test]
    fn sets_by_what_the_damaged_table_held() {
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
