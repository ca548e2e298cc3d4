//! Poses: frames of named points, with their takes and times.

use crate::Error;
use glam::DVec3;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, s};
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

/// The position of a point in a frame of `xyz` (frames, 3 J), cm; NaN where it is missing.
#[doc(hidden)]
#[inline]
pub fn point_at(xyz: ArrayView2<'_, f64>, frame: usize, point: usize) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| xyz[[frame, 3 * point + axis]]))
}

/// Frames x points: positions of named points over time.
#[derive(Debug, Clone, Default)]
pub struct Poses {
    /// The points' names, J of them.
    pub points: Vec<String>,
    /// (frames, 3 J), centimeters, y up; NaN is missing.
    pub xyz: Array2<f64>,
    /// Seconds, one a frame, where the table has them.
    pub time: Option<Vec<f64>>,
    /// The take of each frame, where the table names them.
    pub take: Option<Vec<Arc<str>>>,
}

impl Poses {
    /// Poses without points: only the times and the takes of frames. They have no rows in
    /// [`Poses::xyz`], which [`Poses::frames`] counts.
    pub fn without_points(frames: impl Iterator<Item = (Option<f64>, Option<Arc<str>>)>) -> Poses {
        let (time, take): (Vec<_>, Vec<_>) = frames.unzip();
        Poses {
            time: time.into_iter().collect(),
            take: take.into_iter().collect(),
            ..Poses::default()
        }
    }

    /// The poses of some frames, with their times and takes.
    #[must_use]
    pub fn slice(&self, frames: Range<usize>) -> Poses {
        Poses {
            points: self.points.clone(),
            xyz: self.xyz.slice(s![frames.clone(), ..]).to_owned(),
            time: self.time.as_ref().map(|t| t[frames.clone()].to_vec()),
            take: self.take.as_ref().map(|t| t[frames].to_vec()),
        }
    }

    /// The poses of some frames, in the order given.
    #[must_use]
    pub fn with_frames(&self, frames: &[usize]) -> Poses {
        let time = self.time.as_ref();
        let take = self.take.as_ref();
        Poses {
            points: self.points.clone(),
            xyz: self.xyz.select(Axis(0), frames),
            time: time.map(|time| frames.iter().map(|&t| time[t]).collect()),
            take: take.map(|take| frames.iter().map(|&t| take[t].clone()).collect()),
        }
    }

    /// The poses of some points, in the order given.
    ///
    /// ```
    /// use posing_core::pose::Poses;
    ///
    /// let points = ["hip", "knee"].map(String::from).to_vec();
    /// let xyz = ndarray::array![[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]];
    /// let poses = Poses { points, xyz, ..Poses::default() };
    /// let names = ["knee".to_string()];
    /// assert_eq!(poses.with_points(&names)?.xyz, ndarray::array![[4.0, 5.0, 6.0]]);
    /// # Ok::<(), String>(())
    /// ```
    ///
    /// # Errors
    /// The name of a point that there is not.
    pub fn with_points<'n>(&self, names: &'n [String]) -> Result<Poses, &'n str> {
        let find = |name: &'n String| {
            let at = self.points.iter().position(|p| p == name);
            at.ok_or(name.as_str())
        };
        let at = names.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let columns: Vec<usize> = at.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        Ok(Poses {
            points: names.to_vec(),
            xyz: self.xyz.select(Axis(1), &columns),
            ..self.clone()
        })
    }

    /// The number of frames.
    pub fn frames(&self) -> usize {
        self.xyz.nrows()
    }

    /// One frame, (3 J), centimeters.
    pub fn frame(&self, index: usize) -> ArrayView1<'_, f64> {
        self.xyz.row(index)
    }

    /// The angle of each frame at a point between two others, degrees from 0 to 180, where it is
    /// on the line from one to the other; NaN where one of them is missing. The flexion of a knee
    /// is 180 less that at its center.
    ///
    /// ```
    /// use posing_core::pose::Poses;
    ///
    /// let leg = Poses {
    ///     points: ["hip", "knee", "ankle"].map(String::from).to_vec(),
    ///     xyz: ndarray::array![[0.0, 90.0, 0.0, 0.0, 45.0, 0.0, 0.0, 45.0, -40.0]],
    ///     ..Poses::default()
    /// };
    /// assert_eq!(leg.angle(["hip", "knee", "ankle"])?, [90.0]);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Unfit`]: no point has such a name.
    pub fn angle(&self, points: [&str; 3]) -> crate::Result<Vec<f64>> {
        let mut at = [0; 3];
        for (index, name) in at.iter_mut().zip(points) {
            let own = self.points.iter().position(|p| p == name);
            *index = own.ok_or_else(|| Error::unfit(format!("has no point {name}")))?;
        }
        let angle = |frame: usize| {
            let [first, middle, last] = at.map(|point| point_at(self.xyz.view(), frame, point));
            let (one, other) = (first - middle, last - middle);
            one.cross(other).length().atan2(one.dot(other)).to_degrees()
        };
        Ok((0..self.frames()).map(angle).collect())
    }

    /// Frames a second of all takes: 1 / the median step of time. The rate is rounded to a whole
    /// number or an NTSC rate (n/1.001) where the rounding of the times allows it.
    ///
    /// `None` without times, or if no step is above zero.
    ///
    /// ```
    /// use posing_core::pose::Poses;
    ///
    /// let times = [0.0, 0.033, 0.067, 0.1]; // milliseconds, as files round them
    /// let poses = Poses::without_points(times.into_iter().map(|time| (Some(time), None)));
    /// assert_eq!(poses.rate(), Some(30.0));
    /// ```
    pub fn rate(&self) -> Option<f64> {
        self.rate_within(0..self.time.as_ref()?.len())
    }

    /// [`Poses::rate`] of some frames, such as those of one take.
    #[doc(hidden)]
    pub fn rate_within(&self, frames: Range<usize>) -> Option<f64> {
        let time = self.time.as_deref()?.get(frames.clone())?;
        rate_of(time, |i| self.same_take(frames.start + i))
    }

    /// Seconds of each frame: its own, else by `fps` from the start of its take; `None` without
    /// either.
    pub fn times(&self, fps: Option<f64>) -> Option<Vec<f64>> {
        let by_rate = |fps: f64| {
            let takes = self.takes().into_iter();
            takes
                .flat_map(|take| (0..take.len()).map(move |t| t as f64 / fps))
                .collect()
        };
        self.time.clone().or_else(|| fps.map(by_rate))
    }

    /// The runs of consecutive frames, each with the frames per second of its take; `rates` are
    /// those of the takes.
    #[doc(hidden)]
    pub fn timed_runs(&self, rates: &[Option<f64>]) -> Vec<(Range<usize>, Option<f64>)> {
        let takes = self.takes();
        let timed = |run: Range<usize>| {
            let take = takes.partition_point(|take| take.end <= run.start);
            (run, rates.get(take).copied().flatten())
        };
        self.runs().into_iter().map(timed).collect()
    }

    /// Frames a second of each of the [takes](Poses::takes), `None` where it has no times. The
    /// rounded times of a short take determine its rate badly: a take gets the rate of a longer
    /// take if its times are consistent with that rate. So many rates are compared at most: 64.
    #[doc(hidden)]
    pub fn rates(&self) -> Vec<Option<f64>> {
        let takes = self.takes();
        let mut longest: Vec<usize> = (0..takes.len()).collect();
        longest.sort_by_key(|&take| std::cmp::Reverse(takes[take].len()));
        let (mut rates, mut known) = (vec![None; takes.len()], Vec::new());
        for take in longest {
            let Some(own) = self.rate_within(takes[take].clone()) else {
                continue;
            };
            let allows = |rate: &f64| self.is_consistent_with_rate(takes[take].clone(), *rate);
            let longer = known.iter().copied().find(allows);
            if longer.is_none() && known.len() < MOST_RATES {
                known.push(own);
            }
            rates[take] = longer.or(Some(own));
        }
        rates
    }

    /// Whether the times of some frames are consistent with `rate` frames a second, given their
    /// rounding. True without times.
    #[doc(hidden)]
    pub fn is_consistent_with_rate(&self, frames: Range<usize>, rate: f64) -> bool {
        let time = self.time.as_deref().and_then(|t| t.get(frames.clone()));
        time.is_none_or(|time| allows(time, |i| self.same_take(frames.start + i), rate))
    }

    /// Runs of consecutive frames. A new take, a time that does not increase, and a step of more
    /// than 1.5 frames each start a new run. Nothing is ever interpolated across runs.
    ///
    /// ```
    /// use posing_core::pose::Poses;
    ///
    /// let time = Some(vec![0.0, 0.1, 0.2, 0.9, 1.0]); // a pause after the third frame
    /// let xyz = ndarray::Array2::zeros((5, 3));
    /// let poses = Poses { points: vec!["hand".into()], xyz, time, take: None };
    /// assert_eq!(poses.runs(), [0..3, 3..5]);
    /// ```
    pub fn runs(&self) -> Vec<Range<usize>> {
        let mut runs = Vec::new();
        for take in self.takes() {
            // Takes may be of different rates.
            let step = self.rate_within(take.clone()).map(|r| 1.0 / r);
            let mut start = take.start;
            for i in take.start + 1..take.end {
                let broken = match (&self.time, step) {
                    (Some(t), Some(step)) => !(t[i] > t[i - 1] && t[i] - t[i - 1] <= 1.5 * step),
                    (Some(t), None) => !(t[i] > t[i - 1]),
                    (None, _) => false,
                };
                if broken {
                    runs.push(start..i);
                    start = i;
                }
            }
            runs.push(start..take.end);
        }
        runs
    }

    /// The frames of each take, whatever their times.
    pub fn takes(&self) -> Vec<Range<usize>> {
        let mut takes = Vec::new();
        let mut start = 0;
        for i in 1..=self.frames() {
            if i == self.frames() || !self.same_take(i) {
                takes.push(start..i);
                start = i;
            }
        }
        takes
    }

    /// Whether frame `i` and the one before it belong to the same take.
    fn same_take(&self, i: usize) -> bool {
        self.take.as_ref().is_none_or(|t| t[i] == t[i - 1])
    }
}

/// Rates of longer takes that the times of a take are compared with, at most.
const MOST_RATES: usize = 64;

/// The steps that count as one frame, relative to the median step: times may be rounded, for
/// instance to milliseconds.
const ONE_FRAME: RangeInclusive<f64> = 0.65..=1.35;

/// Whether times are consistent with a rate: their estimated rate is that rate, or they differ from
/// it by no more than their rounding. `joined(i)`: whether step `i - 1 -> i` counts.
fn allows(time: &[f64], joined: impl Fn(usize) -> bool, rate: f64) -> bool {
    let Some(own) = rate_of(time, &joined) else {
        return true;
    };
    if (own - rate).abs() <= CLOSE * rate {
        return true;
    }
    let (mut steps, mut span, mut segments, mut goes_on) = (0, 0.0, 0, false);
    for i in 1..time.len() {
        let step = time[i] - time[i - 1];
        let is_one = joined(i) && ONE_FRAME.contains(&(step * rate));
        if is_one {
            segments += usize::from(!goes_on);
            (steps, span) = (steps + 1, span + step);
        }
        goes_on = is_one;
    }
    // The ends of each segment are off by up to half a grain.
    let slack = grain(time) * segments as f64 + CLOSE * span;
    ONE_FRAME.contains(&(own / rate)) && (span - f64::from(steps) / rate).abs() <= slack
}

/// The unit that the times are rounded to, seconds; 0 if none is found.
fn grain(time: &[f64]) -> f64 {
    let is_whole = |t: f64| (t - t.round()).abs() <= 1e-3;
    let mut grains = [1e-3, 1e-4, 1e-5, 1e-6].into_iter();
    let is_of = |grain: &f64| time.iter().all(|t| is_whole(t / grain));
    grains.find(is_of).unwrap_or(0.0)
}

/// The rate of a series of times. `joined(i)`: whether step `i - 1 -> i` counts.
fn rate_of(time: &[f64], joined: impl Fn(usize) -> bool) -> Option<f64> {
    let mut steps: Vec<f64> = (1..time.len())
        .filter(|&i| joined(i))
        .map(|i| time[i] - time[i - 1])
        .filter(|&s| s > 0.0)
        .collect();
    if steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let (_, &mut step, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    // The median step of times rounded to milliseconds is off by up to one: the mean of many steps
    // is not.
    steps.retain(|s| ONE_FRAME.contains(&(s / step)));
    let (least, most) = steps
        .iter()
        .fold((step, step), |(l, m), s| (s.min(l), s.max(m)));
    let span: f64 = steps.iter().sum();
    Some(near_rate(
        steps.len() as f64 / span,
        ((most - least) / span).clamp(CLOSE, MOST_UNSURE),
    ))
}

/// A rate is rounded to a whole one that is this close, relative to it.
const CLOSE: f64 = 1e-4;
/// The largest relative uncertainty of the times within which a rate is rounded.
const MOST_UNSURE: f64 = 5e-3;

/// The nearest whole rate, or NTSC rate (n/1.001), when it is within 1e-4 of it.
pub fn round_rate(rate: f64) -> f64 {
    near_rate(rate, CLOSE)
}

/// [`round_rate`] within the relative distance `share`.
fn near_rate(rate: f64, share: f64) -> f64 {
    let whole = rate.round();
    let ntsc = (rate * 1.001).round() / 1.001;
    let close = |r: f64| r >= 1.0 && (r - rate).abs() <= share * r;
    if close(whole) {
        whole
    } else if close(ntsc) {
        ntsc
    } else {
        rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses(time: &[f64], take: Option<&[&str]>) -> Poses {
        Poses {
            points: vec!["a".into()],
            xyz: Array2::zeros((time.len(), 3)),
            time: Some(time.to_vec()),
            take: take.map(|t| t.iter().map(|&s| Arc::from(s)).collect()),
        }
    }

    #[test]
    fn chooses_points_by_name() {
        let poses = poses(&[0.0], None);
        assert_eq!(
            poses.with_points(&["a".to_string()]).unwrap().xyz,
            poses.xyz
        );
        assert_eq!(poses.with_points(&["b".to_string()]).unwrap_err(), "b");
    }

    #[test]
    fn rates_are_rounded_only_when_close() {
        let at = |f: f64| poses(&(0..9).map(|i| i as f64 / f).collect::<Vec<_>>(), None).rate();
        assert_eq!(at(120.0), Some(120.0));
        assert_eq!(at(119.999), Some(120.0));
        assert!((at(29.97002997).unwrap() - 30.0 / 1.001).abs() <= 1e-9);
        assert!((at(59.5).unwrap() - 59.5).abs() <= 1e-6);
        assert_eq!(poses(&[1.0], None).rate(), None);
        assert_eq!(poses(&[], None).rate(), None);
        // A slow rate below one frame a second is kept.
        assert!((at(0.2).unwrap() - 0.2).abs() <= 1e-9);
    }

    #[test]
    fn times_rounded_to_milliseconds_give_the_rate() {
        for (rate, frames) in [
            (120.0, 60),
            (120.0, 3000),
            (240.0, 500),
            (30.0 / 1.001, 2000),
        ] {
            let round = |t: f64| (t * 1e3).round() / 1e3;
            let times: Vec<f64> = (0..frames).map(|i| round(i as f64 / rate)).collect();
            let p = poses(&times, None);
            assert!((p.rate().unwrap() - rate).abs() <= 1e-9, "{rate} {frames}");
            assert_eq!(p.runs().len(), 1);
        }
    }

    #[test]
    fn each_take_has_its_own_rate() {
        let fast = (0..9).map(|i| i as f64 / 120.0);
        let slow = (0..5).map(|i| i as f64 / 30.0);
        let times: Vec<f64> = fast.chain(slow).collect();
        let takes: Vec<&str> = (0..14).map(|i| if i < 9 { "a" } else { "b" }).collect();
        let p = poses(&times, Some(&takes));
        assert_eq!(p.runs(), [0..9, 9..14]);
        assert_eq!(
            [p.rate_within(0..9), p.rate_within(9..14)],
            [Some(120.0), Some(30.0)]
        );
    }

    #[test]
    fn a_short_take_has_the_rate_of_a_longer_one_where_its_times_allow_it() {
        let rounded = |rate: f64, frames: usize, digits: f64| -> Vec<f64> {
            let times = (0..frames).map(|i| (i as f64 / rate * digits).round() / digits);
            times.collect()
        };
        let rates = |takes: &[Vec<f64>]| {
            let names: Vec<String> = (0..takes.len()).map(|i| i.to_string()).collect();
            let name = |i: usize| vec![names[i].as_str(); takes[i].len()];
            let names: Vec<&str> = (0..takes.len()).flat_map(name).collect();
            poses(&takes.concat(), Some(&names)).rates()
        };
        let of = |frames: usize| rounded(120.0, frames, 1e3);
        let short = [of(2), of(5), of(20), of(500), of(1)];
        let all = [Some(120.0); 4].into_iter().chain([None]);
        assert_eq!(rates(&short), all.collect::<Vec<_>>());
        // Rates that really differ are kept: close ones over many frames, half and double ones over
        // few.
        for other in [119.88, 60.0, 240.0, 100.0] {
            let frames = if other == 119.88 { 3000 } else { 9 };
            let found = rates(&[rounded(120.0, 4000, 1e6), rounded(other, frames, 1e6)]);
            let found: Vec<f64> = found.into_iter().flatten().collect();
            assert_eq!(found[0], 120.0);
            assert!((found[1] - other).abs() <= 1e-3 * other, "{found:?}");
        }
        // Times that tremble tell their own rate, one odd step or not.
        let tremble = |i: i32| f64::from(i) / 120.0 + 4e-4 * f64::from(i * 7 % 5 - 2) / 2.0;
        let mut times: Vec<f64> = (0..60).map(tremble).collect();
        times.insert(30, (times[29] + 3.0 * times[30]) / 4.0);
        let trembling = poses(&times, None);
        let own = trembling.rate().unwrap();
        assert!(
            trembling.is_consistent_with_rate(0..61, own)
                && !trembling.is_consistent_with_rate(0..61, 100.0)
        );
        // The last digits of times are no other rate.
        let even = |from: f64| (0..50).map(|i| from + i as f64 / 58.3).collect::<Vec<_>>();
        let found = rates(&[even(0.0), even(1.7), even(33.3)]);
        assert!(found.iter().all(|r| *r == found[0]));
    }

    #[test]
    fn runs_break_at_takes_gaps_and_steps_back() {
        let p = poses(&[0.0, 0.1, 0.2, 0.4, 0.5, 0.1, 0.2], None);
        assert_eq!(p.runs(), [0..3, 3..5, 5..7]);
        let p = poses(&[0.0, 0.1, 0.2, 0.3], Some(&["a", "a", "b", "b"]));
        assert_eq!(p.runs(), [0..2, 2..4]);
        assert_eq!(p.takes(), [0..2, 2..4]);
        assert!(poses(&[], None).runs().is_empty());
        assert!(poses(&[], None).takes().is_empty());
    }
}
