//! The speeds of points over time.

use crate::Result;
use crate::numeric::cubic_spline::CubicSpline;
use crate::pose::Poses;
use ndarray::Axis;
use std::ops::Range;

/// At the ends of what is seen, speeds are left out over this, seconds: filters err there.
const ENDS: f64 = 0.04;
/// Longer recordings are refused, seconds: half a day.
const LONGEST: f64 = 43_200.0;
/// Fewer frames on end tell no speed.
const FEWEST: usize = 12;

/// What moves: a point, or one relative to another.
type Mover = (usize, Option<usize>);

/// The speeds of some points, each by the stretches in which it is seen.
pub(super) struct Speeds {
    /// Frames a second.
    pub rate: f64,
    /// From the first frame to the last.
    pub seconds: f64,
    /// Speeds of each point, and perhaps of pairs, over seconds since the first frame.
    pub tracks: Vec<Vec<CubicSpline>>,
}

impl Speeds {
    /// Those of `points` whose positions are smoothed at `cutoff` Hz; with `pairs`, those of each
    /// relative to another too, which know nothing of errors that all have in common, such as those
    /// of the root of a skeleton.
    pub(super) fn of(poses: &Poses, points: &[usize], cutoff: f64, pairs: bool) -> Result<Speeds> {
        let columns: Vec<usize> = points.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let time = poses.time.as_ref().ok_or("has no times")?;
        let first = time.first().copied().unwrap_or(0.0);
        let mut own = Poses {
            points: points.iter().map(|p| p.to_string()).collect(),
            xyz: poses.xyz.select(Axis(1), &columns),
            time: Some(time.iter().map(|t| t - first).collect()),
            take: None,
        };
        let rate = own.rate().ok_or("has no times that rise")?;
        let seconds = time.last().map_or(0.0, |last| last - first);
        if seconds > LONGEST {
            return Err(format!("lasts {seconds} s, more than {LONGEST}: cut it first").into());
        }
        own.low_pass(cutoff, Some(rate))?;
        let runs = own.runs();
        let time = own.time.as_deref().unwrap_or_default();
        let of = |mover: Mover| {
            let runs = runs.iter().flat_map(|run| seen(&own, mover, run.clone()));
            let speeds = runs.filter_map(|run| speed(&own, time, mover, run, rate));
            speeds.collect::<Vec<_>>()
        };
        let n = points.len();
        let across = if pairs && n > 1 { n } else { 0 };
        let alone = (0..n).map(|p| (p, None));
        let movers = alone.chain((0..across).map(|p| (p, Some((p + n.div_ceil(2)) % n))));
        Ok(Speeds {
            rate,
            seconds,
            tracks: movers.map(of).collect(),
        })
    }

    /// The speeds at times `step` apart from the first frame on, cm/s; NaN where they are missing.
    pub(super) fn sampled(&self, step: f64) -> Vec<Vec<f64>> {
        let count = (self.seconds / step + 1e-6).floor() as usize + 1;
        let of = |track: &Vec<CubicSpline>| {
            let mut out = vec![f64::NAN; count];
            for run in track {
                let Some((first, last)) = ends(run) else {
                    continue;
                };
                let from = (first / step - 1e-6).ceil() as usize;
                let to = ((last / step + 1e-6).floor() as usize + 1).min(count);
                (from..to).for_each(|k| out[k] = run.value(k as f64 * step));
            }
            out
        };
        self.tracks.iter().map(of).collect()
    }
}

/// The first and the last time of a stretch.
pub(super) fn ends(run: &CubicSpline) -> Option<(f64, f64)> {
    Some((*run.points().first()?, *run.points().last()?))
}

/// Where a mover is along an axis; NaN where it is missing.
fn place(poses: &Poses, (point, other): Mover, frame: usize, axis: usize) -> f64 {
    let of = |point: usize| poses.xyz[[frame, 3 * point + axis]];
    of(point) - other.map_or(0.0, of)
}

/// The frames of a run in which a mover is there, by stretches.
fn seen(poses: &Poses, mover: Mover, run: Range<usize>) -> Vec<Range<usize>> {
    let is_seen = |t: usize| (0..3).all(|axis| place(poses, mover, t, axis).is_finite());
    let mut out: Vec<Range<usize>> = Vec::new();
    for t in run.filter(|t| is_seen(*t)) {
        match out.last_mut() {
            Some(range) if range.end == t => range.end = t + 1,
            _ => out.push(t..t + 1),
        }
    }
    out
}

/// The speed of a mover over a stretch without its ends; `None` for few frames.
fn speed(
    poses: &Poses,
    time: &[f64],
    mover: Mover,
    run: Range<usize>,
    rate: f64,
) -> Option<CubicSpline> {
    let end = (ENDS * rate).ceil() as usize;
    if run.len() < FEWEST + 2 * end {
        return None;
    }
    let along = |axis: usize| {
        let values = run.clone().map(|t| place(poses, mover, t, axis));
        CubicSpline::new(time[run.clone()].to_vec(), values.collect())
    };
    let paths = [0, 1, 2].map(along);
    let times = &time[run.start + end..run.end - end];
    let of = |t: &f64| paths.iter().map(|path| path.slope(*t).powi(2)).sum::<f64>();
    let speeds = times.iter().map(|t| of(t).sqrt()).collect();
    Some(CubicSpline::new(times.to_vec(), speeds))
}
