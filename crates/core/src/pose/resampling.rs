//! Takes at another rate, and a low-pass filter for them.

use super::poses::Poses;
use crate::numeric::anti_alias::AntiAlias;
use crate::numeric::butterworth::{FEWEST, LowPass};
use crate::numeric::cubic_spline::CubicSpline;
use crate::numeric::pchip::pchip;
use ndarray::{Array2, ArrayViewMut1, Axis};
use std::ops::Range;

/// More values are not resampled to: 1 GiB.
const MOST_VALUES: f64 = (1_u64 << 27) as f64;
/// Two measured frames further apart than this many steps are a gap, not neighbors.
const NEIGHBORS: f64 = 1.5;

/// Times of frames are whole multiples of a step if they differ by less than this share of it.
const ROUNDED: f64 = 0.05;

impl Poses {
    /// Each take at another rate: frames at its first time and each 1 / `rate` seconds after it, up
    /// to its last. A coordinate is interpolated (PCHIP) between measured neighbors; across a
    /// gap or a pause it stays missing.
    ///
    /// ```
    /// use posing_core::pose::Poses;
    ///
    /// let poses = Poses {
    ///     points: vec!["hand".into()],
    ///     xyz: ndarray::array![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]],
    ///     time: Some(vec![0.0, 0.1, 0.2]),
    ///     ..Poses::default()
    /// };
    /// let finer = poses.resampled(20.0)?; // twice the rate
    /// assert_eq!(finer.frames(), 5);
    /// assert!((finer.xyz[[1, 0]] - 1.0).abs() < 1e-9);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: no times, times that do not rise, or more than 2^27 values.
    pub fn resampled(&self, rate: f64) -> crate::Result<Poses> {
        let time = self.time.as_ref().ok_or("has no times to resample")?;
        let (mut rows, mut times, mut takes) = (Vec::new(), Vec::new(), Vec::new());
        for (frames, own) in self.takes().into_iter().zip(self.rates()) {
            let step = 1.0 / own.unwrap_or(rate);
            let (first, last) = (time[frames.start], time[frames.end - 1]);
            if let Some(t) = (frames.start + 1..frames.end).find(|&t| time[t] <= time[t - 1]) {
                return Err(format!(
                    "the time of frame {t} (counted from 0) is {}, after {}: it has to rise",
                    time[t],
                    time[t - 1]
                )
                .into());
            }
            let count = ((last - first) * rate + 1e-6).floor() + 1.0;
            if count * self.xyz.ncols().max(1) as f64 > MOST_VALUES {
                return Err(
                    format!("a take lasts {} s: too long to resample", last - first).into(),
                );
            }
            let count = count as usize;
            let at: Vec<f64> = (0..count).map(|i| first + i as f64 / rate).collect();
            let mut xyz = Array2::from_elem((count, self.xyz.ncols()), f64::NAN);
            for c in 0..self.xyz.ncols() {
                self.resample(c, frames.clone(), step, &at, xyz.column_mut(c));
            }
            rows.push(xyz);
            times.extend(at);
            let name = self.take.as_ref().map(|t| t[frames.start].clone());
            takes.extend(std::iter::repeat_n(name, count));
        }
        let views: Vec<_> = rows.iter().map(|r| r.view()).collect();
        Ok(Poses {
            points: self.points.clone(),
            xyz: ndarray::concatenate(Axis(0), &views).unwrap_or_default(),
            time: Some(times),
            take: takes.into_iter().collect(),
        })
    }

    /// The times that frames have if their rate is really `rate`: of each take, its times over its
    /// own rate, and exact multiples where they are those up to their rounding.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: no times, or none that rise.
    pub fn times_at_rate(&self, rate: f64) -> crate::Result<Vec<f64>> {
        let time = self.time.as_ref().ok_or("has no times to correct")?;
        let mut out = Vec::with_capacity(time.len());
        for (frames, own) in self.takes().into_iter().zip(self.rates()) {
            let own = match own {
                Some(own) => own,
                None if frames.len() < 2 => rate,
                None => return Err("has times that do not rise: they tell no rate".into()),
            };
            let counted = time[frames].iter().map(|t| t * own);
            let whole = |count: f64| match count.round() {
                near if (count - near).abs() < ROUNDED => near,
                _ => count,
            };
            out.extend(counted.map(|count| whole(count) / rate));
        }
        Ok(out)
    }

    /// The poses `speed` times as fast: times after the first of each take are divided by it.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: no times.
    pub fn sped_up(mut self, speed: f64) -> crate::Result<Poses> {
        let takes = self.takes();
        let time = self.time.as_mut().ok_or("has no times to change")?;
        for frames in takes {
            let first = time[frames.start];
            let own = time[frames].iter_mut();
            own.for_each(|t| *t = first + (*t - first) / speed);
        }
        Ok(self)
    }

    /// One coordinate of a take at the times `at`.
    fn resample(
        &self,
        column: usize,
        frames: Range<usize>,
        step: f64,
        at: &[f64],
        mut out: ArrayViewMut1<'_, f64>,
    ) {
        let Some(time) = &self.time else { return };
        let mut next = 0;
        for seen in self.seen_runs(column, frames, NEIGHBORS * step) {
            let x = &time[seen.clone()];
            let (first, last) = (x[0] - 1e-6, x[x.len() - 1] + 1e-6);
            let start = next + at[next..].partition_point(|t| *t < first);
            next = start + at[start..].partition_point(|t| *t <= last);
            let y: Vec<f64> = seen.map(|t| self.xyz[[t, column]]).collect();
            let inside: Vec<f64> = at[start..next]
                .iter()
                .map(|t| t.clamp(x[0], last))
                .collect();
            for (i, value) in pchip(x, &y, &inside).into_iter().enumerate() {
                out[start + i] = value;
            }
        }
    }

    /// The positions (times, 3 J) at other times, which rise and are those of a new `rate`: by
    /// cubic splines through measured neighbors; across a gap or a pause, and outside of the
    /// frames, they are missing. Before a lower rate, what it cannot show is filtered out. Of one
    /// take.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: no times.
    pub fn at_times(&self, at: &[f64], rate: f64) -> crate::Result<Array2<f64>> {
        let time = self.time.as_ref().ok_or("has no times to resample")?;
        let own = self.rate().unwrap_or(rate);
        let filter = AntiAlias::new(rate / own);
        let mut out = Array2::from_elem((at.len(), self.xyz.ncols()), f64::NAN);
        for c in 0..self.xyz.ncols() {
            for seen in self.seen_runs(c, 0..self.frames(), NEIGHBORS / own) {
                let x = &time[seen.clone()];
                let mut y: Vec<f64> = seen.map(|t| self.xyz[[t, c]]).collect();
                filter.iter().for_each(|filter| filter.apply(&mut y));
                let spline = CubicSpline::new(x.to_vec(), y);
                let (first, last) = (x[0] - 1e-6, x[x.len() - 1] + 1e-6);
                let from = at.partition_point(|t| *t < first);
                for k in (from..at.len()).take_while(|k| at[*k] <= last) {
                    out[[k, c]] = spline.value(at[k].clamp(x[0], x[x.len() - 1]));
                }
            }
        }
        Ok(out)
    }

    /// Filters each coordinate by a zero-lag Butterworth filter of order 4, forwards and backwards.
    /// `cutoff` is in Hz; `fps` is the rate of a table without times. A gap parts a coordinate;
    /// stretches of fewer than ten frames stay as they are: how many did is returned.
    ///
    /// ```
    /// use posing_core::pose::Poses;
    ///
    /// // A slow motion, with a tremor of 50 Hz in it: one frame up, one frame down.
    /// let value = |(t, _): (usize, usize)| t as f64 * 0.1 + if t % 2 == 0 { 0.5 } else { -0.5 };
    /// let xyz = ndarray::Array2::from_shape_fn((200, 3), value);
    /// let mut poses = Poses { points: vec!["hand".into()], xyz, ..Poses::default() };
    /// assert_eq!(poses.low_pass(6.0, Some(100.0))?, 0); // no stretch is too short
    /// assert!((poses.xyz[[100, 0]] - 10.0).abs() < 0.01);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Unfit`], and nothing is filtered: a take has no rate, or the cutoff is not
    /// below .4 of it.
    pub fn low_pass(&mut self, cutoff: f64, fps: Option<f64>) -> crate::Result<usize> {
        let rates = self.rates().into_iter();
        let filters = rates.map(|own| low_pass_filter(cutoff, own.or(fps)));
        let filters = filters.collect::<crate::Result<Vec<_>>>()?;
        let mut short = 0;
        for (frames, (rate, filter)) in self.takes().into_iter().zip(filters) {
            for c in 0..self.xyz.ncols() {
                for seen in self.seen_runs(c, frames.clone(), NEIGHBORS / rate) {
                    let mut values: Vec<f64> = seen.clone().map(|t| self.xyz[[t, c]]).collect();
                    short += usize::from(values.len() < FEWEST);
                    filter.apply(&mut values);
                    for (t, value) in seen.zip(values) {
                        self.xyz[[t, c]] = value;
                    }
                }
            }
        }
        Ok(short)
    }

    /// The ranges of frames on end in which a coordinate is there, no two further apart in time
    /// than `most` seconds.
    fn seen_runs(&self, column: usize, frames: Range<usize>, most: f64) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = Vec::new();
        let is_next = |t: usize| {
            let times = self.time.as_ref();
            times.is_none_or(|time| time[t] > time[t - 1] && time[t] - time[t - 1] <= most)
        };
        for t in frames.filter(|&t| self.xyz[[t, column]].is_finite()) {
            match runs.last_mut() {
                Some(run) if run.end == t && is_next(t) => run.end = t + 1,
                _ => runs.push(t..t + 1),
            }
        }
        runs
    }
}

/// The filter of a take, and the take's rate.
fn low_pass_filter(cutoff: f64, rate: Option<f64>) -> crate::Result<(f64, LowPass)> {
    let rate =
        rate.ok_or("has no times, and a filter needs a rate; give it with the option `fps`")?;
    let filter = LowPass::new(cutoff, rate).ok_or_else(|| {
        format!(
            "has {rate} frames per second: the option `butterworth {cutoff}` has to be below .4 \
             of that"
        )
    })?;
    Ok((rate, filter))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two takes of one point that moves evenly, 100 frames a second, with a gap in the first.
    fn poses() -> Poses {
        let time: Vec<f64> = (0..60).map(|t| (t % 30) as f64 / 100.0).collect();
        let mut xyz = Array2::from_shape_fn((60, 3), |(t, c)| (t % 30) as f64 + c as f64);
        xyz.slice_mut(ndarray::s![10..15, ..]).fill(f64::NAN);
        Poses {
            points: vec!["a".into()],
            xyz,
            time: Some(time),
            take: Some(
                (0..60)
                    .map(|t| if t < 30 { "p".into() } else { "q".into() })
                    .collect(),
            ),
        }
    }

    #[test]
    fn another_rate_keeps_takes_positions_and_gaps() {
        let at = poses().resampled(50.0).unwrap();
        assert_eq!(at.frames(), 30);
        assert_eq!(at.takes(), [0..15, 15..30]);
        for (t, row) in at.xyz.rows().into_iter().enumerate() {
            let there = 2.0 * (t % 15) as f64;
            if (5..=7).contains(&t) {
                assert!(row.iter().all(|v| v.is_nan()), "{t}");
            } else {
                assert!((row[0] - there).abs() < 1e-9, "{t}: {row}");
            }
        }
        let finer = poses().resampled(200.0).unwrap();
        assert_eq!(finer.frames(), 2 * 59);
        assert!((finer.xyz[[3, 0]] - 1.5).abs() < 1e-9);
        assert!(finer.xyz[[19, 0]].is_nan() && finer.xyz[[18, 0]] == 9.0);
    }

    #[test]
    fn positions_at_other_times_keep_gaps_and_end_with_the_frames() {
        let one = poses().slice(0..30);
        let at: Vec<f64> = (-1..62).map(|k| f64::from(k) / 200.0 + 0.001).collect();
        let new = one.at_times(&at, 200.0).unwrap();
        for (t, row) in at.iter().zip(new.rows()) {
            let there = (0.0..=0.09).contains(t) || (0.15..=0.29).contains(t);
            assert!(row.iter().all(|v| v.is_finite() == there), "{t}");
            assert!(!there || (row[1] - 100.0 * t - 1.0).abs() < 1e-9, "{t}");
        }
        assert!(Poses::default().at_times(&at, 200.0).is_err());
    }

    #[test]
    fn a_wrong_rate_is_corrected_and_speed_changes_times_alone() {
        let mended = poses().times_at_rate(50.0).unwrap();
        assert_eq!((mended[1], mended[29], mended[31]), (0.02, 0.58, 0.02));
        let mut rounded = poses();
        rounded.time = Some(
            (0..60)
                .map(|t| f64::from(8 * (t % 30) + t % 3) / 1e3)
                .collect(),
        );
        let times = rounded.times_at_rate(60.0).unwrap();
        assert!((times[29] - 29.0 / 60.0).abs() < 2e-3);
        let fast = poses().sped_up(2.0).unwrap();
        let time = fast.time.unwrap();
        assert!((time[29] - 0.145).abs() < 1e-12 && time[30] == 0.0);
        assert!(Poses::default().times_at_rate(60.0).is_err());
        assert!(Poses::default().sped_up(2.0).is_err());
    }

    #[test]
    fn filters_each_stretch_of_a_take() {
        let mut filtered = poses();
        assert_eq!(filtered.low_pass(6.0, None).unwrap(), 0);
        assert!(filtered.xyz[[12, 0]].is_nan());
        assert!((filtered.xyz[[45, 0]] - 15.0).abs() < 0.1);
        assert!(poses().low_pass(60.0, None).is_err());
        let mut restarted = poses();
        restarted.take = None;
        assert!(
            restarted
                .resampled(50.0)
                .unwrap_err()
                .to_string()
                .contains("frame 30")
        );
    }
}
