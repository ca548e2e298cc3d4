//! Frames that repeat the one before: a resampling doubled them, an animator held them ("on twos"),
//! or they stand in place of frames that were dropped. They hold no measurement of their own.
//!
//! The others follow each other evenly, or, where frames were dropped, at their own times:
//! whichever bends their paths less.

use crate::numeric::statistics::{median, range};
use ndarray::{Array2, ArrayView2, Axis};
use std::ops::Range;

/// A take with fewer repeats has none: a dropped frame, or a body that rests. The share of its
/// frames.
const FEW: f64 = 0.04;
/// A column that changes by no more in a whole take stands still, cm or radians.
const STILL: f64 = 1e-6;
/// The share of the columns that move and are seen in both frames that repeat, to [`SAME`] of the
/// column's largest value.
const REPEATING: f64 = 0.9;
const SAME: f64 = 1e-9;
/// Where this share of the values of the other frames repeats too, the median of them, numbers are
/// rounded: to a centimeter, say.
const COARSE: f64 = 0.5;
/// Repeats that come at one distance by this share are every second frame, third and so on.
const REGULAR: f64 = 0.9;

/// Which frames of a take repeat the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct RepeatedFrames {
    /// The frames that do not, in order.
    pub kept: Vec<usize>,
    /// For each frame, which of `kept` it shows.
    pub shown: Vec<usize>,
    /// Whether [`RepeatedFrames::rows`] are all frames, repeats missing, and not the kept ones.
    keep_times: bool,
}

impl RepeatedFrames {
    /// Those of `columns` (a row a frame; NaN is missing): nearly all values that ever change are
    /// those of the frame before. None repeats where few do.
    pub fn of(columns: ArrayView2<'_, f64>) -> RepeatedFrames {
        let shares = repeating_shares(columns);
        let mut repeats: Vec<bool> = shares.iter().map(|share| *share > REPEATING).collect();
        let count = repeats.iter().filter(|r| **r).count();
        let others = shares.into_iter().filter(|share| *share <= REPEATING);
        let is_coarse = median(others.collect()).is_some_and(|share| share > COARSE);
        if is_coarse || count as f64 <= FEW * repeats.len() as f64 {
            repeats.fill(false);
        }
        let mut out = RepeatedFrames {
            kept: Vec::new(),
            shown: Vec::new(),
            keep_times: false,
        };
        for (t, repeats) in repeats.into_iter().enumerate() {
            if !repeats {
                out.kept.push(t);
            }
            out.shown.push(out.kept.len() - 1);
        }
        out
    }

    /// [`RepeatedFrames::of`], whose kept frames stay at their own times where these bend the paths
    /// less and most of them stand side by side.
    pub fn at_their_times(columns: ArrayView2<'_, f64>) -> RepeatedFrames {
        let mut out = RepeatedFrames::of(columns);
        let (mut evenly, mut at_times) = (0, 0);
        for frames in out.kept.windows(3) {
            let [a, b, c] = [frames[0], frames[1], frames[2]];
            if 2 * b == a + c {
                continue;
            }
            let off = |share: f64| {
                let rows = [a, b, c].map(|t| columns.row(t));
                let off = (0..columns.ncols())
                    .map(|i| (rows[1][i] - rows[0][i] - share * (rows[2][i] - rows[0][i])).abs());
                off.filter(|off| off.is_finite()).sum::<f64>()
            };
            let (even, timed) = (off(0.5), off((b - a) as f64 / (c - a) as f64));
            evenly += usize::from(even < timed);
            at_times += usize::from(timed < even);
        }
        let steps = out.kept.windows(2).map(|w| (w[1] - w[0]) as f64);
        let are_side_by_side = median(steps.collect()) == Some(1.0);
        out.keep_times = are_side_by_side && at_times > evenly;
        out
    }

    /// Whether any frame repeats.
    pub fn is_any(&self) -> bool {
        self.kept.len() < self.shown.len()
    }

    /// The rows a second ([`RepeatedFrames::rows`]), of `rate` frames.
    pub fn rate(&self, rate: f64) -> f64 {
        if self.keep_times {
            rate
        } else {
            rate * self.kept.len() as f64 / self.shown.len().max(1) as f64
        }
    }

    /// The rows of the kept frames, evenly or at their times.
    pub fn rows(&self, rows: ArrayView2<'_, f64>) -> Array2<f64> {
        if !self.keep_times {
            return rows.select(Axis(0), &self.kept);
        }
        let mut out = rows.to_owned();
        for (t, mut row) in out.rows_mut().into_iter().enumerate() {
            if self.kept[self.shown[t]] != t {
                row.fill(f64::NAN);
            }
        }
        out
    }

    /// For each frame, the row that it shows.
    pub fn shown_rows(&self) -> Vec<usize> {
        let row = |k: &usize| if self.keep_times { self.kept[*k] } else { *k };
        self.shown.iter().map(row).collect()
    }

    /// Ranges of consecutive frames as ranges of rows, without those of repeats alone.
    pub fn kept_runs(&self, runs: &[Range<usize>]) -> Vec<Range<usize>> {
        if self.keep_times {
            return runs.to_vec();
        }
        let at = |frame: usize| self.kept.partition_point(|kept| *kept < frame);
        let kept = runs.iter().map(|run| at(run.start)..at(run.end));
        kept.filter(|run| !run.is_empty()).collect()
    }

    /// The frames that show a range of rows.
    pub fn frames(&self, rows: &Range<usize>) -> Range<usize> {
        let first = |row: usize| {
            if self.keep_times {
                self.kept.partition_point(|kept| *kept < row)
            } else {
                row
            }
        };
        let at = |row: usize| {
            let kept = self.kept.get(first(row));
            kept.copied().unwrap_or(self.shown.len())
        };
        at(rows.start)..at(rows.end)
    }

    /// What to call them: every second, third .. frame, or how many.
    pub fn describe(&self) -> Option<String> {
        if !self.is_any() {
            return None;
        }
        let frames = self.shown.len();
        let next = self.kept.iter().skip(1).chain([&frames]);
        let lengths = self.kept.iter().zip(next).map(|(kept, next)| next - kept);
        let lengths: Vec<usize> = lengths.collect();
        let longest = lengths.iter().copied().max().unwrap_or(frames);
        let alike = lengths.iter().filter(|l| **l == longest).count();
        let each = match longest {
            2 => "every second frame repeats".to_string(),
            3 => "two of three frames repeat".to_string(),
            n => format!("{} of {n} frames repeat", n - 1),
        };
        Some(if alike as f64 >= REGULAR * lengths.len() as f64 {
            format!("{each} the one before")
        } else {
            let count = frames - self.kept.len();
            format!("{count} of {frames} frames repeat the one before")
        })
    }
}

/// The share of the values of each frame that are those of the frame before; 0 where none is seen
/// in both.
fn repeating_shares(columns: ArrayView2<'_, f64>) -> Vec<f64> {
    let mut moving = vec![0u32; columns.nrows()];
    let mut same = moving.clone();
    for column in columns.columns() {
        let seen = column.iter().copied().filter(|v| v.is_finite());
        let (low, high) = range(seen);
        if !(high - low > STILL) {
            continue;
        }
        let least = SAME * low.abs().max(high.abs());
        for t in 1..column.len() {
            let step = (column[t] - column[t - 1]).abs();
            moving[t] += u32::from(step.is_finite());
            same[t] += u32::from(step <= least);
        }
    }
    let share = |(same, moving): (u32, u32)| f64::from(same) / f64::from(moving.max(1));
    same.into_iter().zip(moving).map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three points that move, frame by frame; those of `at`.
    fn take(at: impl Iterator<Item = usize>) -> Array2<f64> {
        let at: Vec<usize> = at.collect();
        Array2::from_shape_fn((at.len(), 9), |(t, c)| {
            (at[t] as f64 * 0.1 + c as f64).sin() * 30.0
        })
    }

    #[test]
    fn repeats_are_found_and_named() {
        let found = |at: &dyn Fn(usize) -> usize| RepeatedFrames::of(take((0..120).map(at)).view());
        let sound = found(&|t| t);
        assert!(!sound.is_any() && sound.describe().is_none());
        let twos = found(&|t| t / 2);
        assert_eq!(twos.kept, (0..120).step_by(2).collect::<Vec<_>>());
        assert_eq!(twos.rate(24.0), 12.0);
        assert_eq!(
            twos.describe().unwrap(),
            "every second frame repeats the one before"
        );
        assert!(found(&|t| t / 6).describe().unwrap().starts_with("5 of 6"));
        // Five of four: a film's frames at a video's rate.
        let pulldown = found(&|t| t * 4 / 5);
        assert_eq!(
            pulldown.describe().unwrap(),
            "24 of 120 frames repeat the one before"
        );
        // A rest at the end.
        let rest = found(&|t| t.min(100)).describe().unwrap();
        assert_eq!(rest, "19 of 120 frames repeat the one before");
        // Numbers of whole centimeters.
        let coarse = take(0..400).mapv(|v| (0.02 * v).round());
        assert!(!RepeatedFrames::of(coarse.view()).is_any());
        // One that was dropped, and a rest.
        assert!(!found(&|t| t - usize::from(t > 50)).is_any());
        assert!(!RepeatedFrames::of(Array2::ones((30, 6)).view()).is_any());
        assert!(!RepeatedFrames::of(Array2::zeros((0, 6)).view()).is_any());
    }

    #[test]
    fn frames_keep_their_times_where_some_were_dropped() {
        let dropped = take((0..120).map(|t| t - usize::from(t % 12 == 5)));
        let found = RepeatedFrames::at_their_times(dropped.view());
        let rows = found.rows(dropped.view());
        assert_eq!(rows.nrows(), 120);
        assert!(rows[[5, 0]].is_nan() && rows.row(6) == dropped.row(6));
        assert_eq!((found.rate(60.0), found.shown_rows()[5]), (60.0, 4));
        let runs = [3..20, 20..30];
        assert_eq!(found.kept_runs(&runs), runs);
        assert_eq!((found.frames(&(3..5)), found.frames(&(5..6))), (3..6, 6..6));
        // A gap says nothing, and of doubled frames no two stand side by side.
        let mut gap = take((0..120).map(|t| t / 2));
        (30..50).for_each(|t| gap.row_mut(t).fill(f64::NAN));
        assert!(!RepeatedFrames::at_their_times(gap.view()).keep_times);
        let both = take((0..120).map(|t| t / 2 - usize::from(t / 2 % 12 == 5)));
        assert!(!RepeatedFrames::at_their_times(both.view()).keep_times);
        // Frames of a film follow each other evenly.
        let pulldown = take((0..120).map(|t| t * 4 / 5));
        let found = RepeatedFrames::at_their_times(pulldown.view());
        assert_eq!(found.rows(pulldown.view()).nrows(), 96);
    }

    #[test]
    fn frames_and_kept_ones_lead_to_each_other() {
        let found = RepeatedFrames::of(take((0..20).map(|t| t / 2)).view());
        assert_eq!(found.kept_runs(&[0..7, 7..8, 8..20]), [0..4, 4..10]);
        assert_eq!(found.frames(&(1..3)), 2..6);
        assert_eq!(found.frames(&(9..10)), 18..20);
        assert_eq!(found.shown[5], 2);
        // A point that is missing, or jumps, does not hide a repeat.
        let mut some = take((0..20).map(|t| t / 2));
        some.column_mut(0).fill(f64::NAN);
        assert_eq!(RepeatedFrames::of(some.view()), found);
    }
}
