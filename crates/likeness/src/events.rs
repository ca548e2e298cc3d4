//! Where in a database a motion is done: by dynamic time warping of the motion along each take.
//!
//! Each frame of the motion is laid on a frame of the take, 0, 1 or 2 frames after the one before
//! it and never twice on the same one in a row, so that a find is done at half to twice the pace;
//! of all ways the one with the least sum of squared distances counts (the sum of distances, for a
//! city-block norm). An event's distance is the root of the mean, over the frames of the motion.

use super::index::{IndexedTake, PoseIndex};
use super::pose_metric::Norm;
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, s};
use std::ops::Range;

/// Frames a second at which motions are compared, where all takes have as many.
const RATE: f64 = 30.0;
/// Frames of a take whose distances are held together.
const BLOCK: usize = 2048;
/// Frames that a motion has at least.
const LEAST: usize = 3;

/// What is searched for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventSearch {
    /// Events, at most.
    pub most: usize,
    /// Seconds between two events of a take, at least.
    pub apart: f64,
    /// The greatest distance of an event.
    pub within: f32,
}

/// A motion found in a take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// The take.
    pub take: usize,
    /// The time of its first frame, seconds.
    pub from: f64,
    /// The time of its last frame, seconds.
    pub to: f64,
    /// How far the motion is from the example that is nearest.
    pub distance: f32,
}

/// Motions that are looked for in a database.
#[derive(Debug, Clone)]
pub struct Examples<'a> {
    database: &'a PoseIndex,
    /// Frames a second that are compared.
    rate: f64,
    motions: Vec<Array2<f32>>,
}

impl<'a> Examples<'a> {
    /// The takes of `examples`, each whole. Frames that lack joints are left out. All takes are
    /// compared at one rate: 30 frames a second, or the least that one has.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: a take has no frame rate, or one of the examples has under three
    /// frames to compare.
    pub fn new(examples: &PoseIndex, database: &'a PoseIndex) -> crate::Result<Examples<'a>> {
        let mut rate = RATE;
        for take in examples.takes.iter().chain(&database.takes) {
            let own = take.rate.ok_or_else(|| {
                format!("take {} has no frame rate, which motions need", take.name)
            })?;
            rate = rate.min(own);
        }
        let example = |(k, take): (usize, &IndexedTake)| {
            let rows = examples.motion(k);
            let is_whole = |t: &usize| rows.row(*t).iter().all(|v| v.is_finite());
            let mut frames = sampled(0..take.frames, take, rate);
            frames.retain(is_whole);
            match frames.len() {
                ..LEAST => Err(format!(
                    "take {} has {} frames that show all joints, of {rate} a second; a motion \
                     has at least {LEAST}",
                    take.name,
                    frames.len()
                )
                .into()),
                _ => Ok(rows.select(Axis(0), &frames)),
            }
        };
        let motions = examples.takes.iter().enumerate().map(example);
        Ok(Examples {
            database,
            rate,
            motions: motions.collect::<crate::Result<_>>()?,
        })
    }

    /// The events of a database, nearest first, that are not of takes that `allowed` turns down.
    /// None overlaps another.
    pub fn find(&self, search: &EventSearch, allowed: impl Fn(usize) -> bool + Sync) -> Vec<Event> {
        let found = parallel::map_chunks(self.database.takes.len(), 1, |takes| {
            let takes = takes.filter(|take| allowed(*take));
            let found = takes.map(|take| self.in_take(take, search));
            found.collect::<Vec<_>>().concat()
        });
        let mut found = found.concat();
        sort(&mut found);
        found.truncate(search.most);
        found
    }

    /// The events of a take, nearest first.
    fn in_take(&self, take: usize, search: &EventSearch) -> Vec<Event> {
        let (known, rows) = (&self.database.takes[take], self.database.motion(take));
        let norm = self.database.metric.norm;
        let mut all = Vec::new();
        for run in known.runs() {
            let frames = sampled(run, known, self.rate);
            let rows = rows.select(Axis(0), &frames);
            for motion in &self.motions {
                let ends = align(motion.view(), rows.view(), norm);
                let ends = ends.into_iter().enumerate();
                all.extend(ends.filter_map(|(end, way)| {
                    let distance = way.distance(motion.nrows(), norm);
                    let is_near = distance.is_finite() && distance <= search.within;
                    is_near.then_some(())?;
                    Some(Event {
                        take,
                        from: known.time(frames[way.start])?,
                        to: known.time(frames[end])?,
                        distance,
                    })
                }));
            }
        }
        sort(&mut all);
        let mut kept: Vec<Event> = Vec::new();
        for event in all {
            let is_near = |other: &Event| {
                event.from < other.to + search.apart && other.from < event.to + search.apart
            };
            if kept.len() < search.most && !kept.iter().any(is_near) {
                kept.push(event);
            }
        }
        kept
    }
}

/// Nearest first, of equal ones the first.
fn sort(events: &mut [Event]) {
    events.sort_by(|a, b| {
        let distance = a.distance.total_cmp(&b.distance);
        distance
            .then(a.take.cmp(&b.take))
            .then(a.to.total_cmp(&b.to))
    });
}

/// The frames of a run of a take that are compared, `rate` a second.
fn sampled(run: Range<usize>, take: &IndexedTake, rate: f64) -> Vec<usize> {
    let step = (take.rate.unwrap_or(rate) / rate).max(1.0);
    let count = (run.len() as f64 / step).ceil() as usize;
    let frames = (0..count).map(|k| run.start + (k as f64 * step).round() as usize);
    frames.filter(|t| run.contains(t)).collect()
}

/// A way through the frames of a take: where it began, and its sum so far.
#[derive(Debug, Clone, Copy)]
struct Way {
    sum: f32,
    start: usize,
}

impl Way {
    const NONE: Way = Way {
        sum: f32::INFINITY,
        start: 0,
    };

    fn nearer(self, other: Way) -> Way {
        if other.sum < self.sum { other } else { self }
    }

    fn with(self, cost: f32) -> Way {
        Way {
            sum: self.sum + cost,
            ..self
        }
    }

    fn distance(self, frames: usize, norm: Norm) -> f32 {
        let mean = self.sum / frames as f32;
        match norm {
            Norm::Euclidean => mean.sqrt(),
            Norm::City => mean,
        }
    }
}

/// The best way of `motion` (m, dimensions) that ends at each of the `rows` (n, dimensions).
fn align(motion: ArrayView2<'_, f32>, rows: ArrayView2<'_, f32>, norm: Norm) -> Vec<Way> {
    let m = motion.nrows();
    // By frame of the motion, the best ways at the last two rows of the take.
    let (mut last, mut before) = (vec![Way::NONE; m], vec![Way::NONE; m]);
    let mut ends = Vec::with_capacity(rows.nrows());
    for start in (0..rows.nrows()).step_by(BLOCK) {
        let end = (start + BLOCK).min(rows.nrows());
        let costs = costs(motion, rows.slice(s![start..end, ..]), norm);
        for (at, costs) in (start..end).zip(costs.rows()) {
            let ways = advance(&last, &before, at, costs);
            ends.push(ways[m - 1]);
            before = std::mem::replace(&mut last, ways);
        }
    }
    ends
}

/// The best ways at row `at`, from those at the two rows before it.
fn advance(last: &[Way], before: &[Way], at: usize, costs: ArrayView1<'_, f32>) -> Vec<Way> {
    let mut ways = Vec::with_capacity(costs.len());
    // The way that came from another row to this one.
    let mut moved = Way::NONE;
    for (i, cost) in costs.iter().enumerate() {
        let came = match i.checked_sub(1) {
            None => Way {
                sum: 0.0,
                start: at,
            },
            Some(i) => last[i].nearer(before[i]),
        };
        let came = came.with(*cost);
        ways.push(came.nearer(moved.with(*cost)));
        moved = came;
    }
    ways
}

/// What it costs to lay each frame of a motion on each of some rows (rows, m); infinite for rows
/// that lack joints.
fn costs(motion: ArrayView2<'_, f32>, rows: ArrayView2<'_, f32>, norm: Norm) -> Array2<f32> {
    let mut costs = match norm {
        Norm::City => Array2::from_shape_fn((rows.nrows(), motion.nrows()), |(r, i)| {
            norm.distance(rows.row(r), motion.row(i))
        }),
        Norm::Euclidean => {
            // About a frame of the motion, so that near rows are told apart.
            let origin = motion.row(motion.nrows() / 2);
            let (motion, rows) = (&motion - &origin, &rows - &origin);
            let squares = |x: &Array2<f32>| x.rows().into_iter().map(|r| r.dot(&r)).collect();
            let (own, others): (Vec<f32>, Vec<f32>) = (squares(&motion), squares(&rows));
            let mut costs = rows.dot(&motion.t());
            for ((r, i), cost) in costs.indexed_iter_mut() {
                *cost = (own[i] + others[r] - 2.0 * *cost).max(0.0);
            }
            costs
        }
    };
    for (mut costs, row) in costs.rows_mut().into_iter().zip(rows.rows()) {
        if row.iter().any(|v| !v.is_finite()) {
            costs.fill(f32::INFINITY);
        }
    }
    costs
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// The least sum over all ways, by trying each.
    fn least(costs: &Array2<f32>, i: usize, at: usize, stood: bool) -> f32 {
        let own = costs[[at, i]];
        let Some(i) = i.checked_sub(1) else {
            return own;
        };
        let step = |back: usize| match at.checked_sub(back) {
            Some(at) => least(costs, i, at, back == 0),
            None => f32::INFINITY,
        };
        let ways = [1, 2].map(step).into_iter().fold(f32::INFINITY, f32::min);
        let stand = if stood { f32::INFINITY } else { step(0) };
        own + ways.min(stand)
    }

    #[test]
    fn ways_are_the_least_of_all() {
        let motion = array![[0.0f32], [1.0], [3.0], [2.0], [0.5]];
        let rows = array![
            [0.3f32],
            [0.2],
            [1.2],
            [2.9],
            [2.2],
            [0.1],
            [4.0],
            [0.6],
            [1.0]
        ];
        for norm in [Norm::Euclidean, Norm::City] {
            let costs = costs(motion.view(), rows.view(), norm);
            for (at, way) in align(motion.view(), rows.view(), norm).iter().enumerate() {
                let want = least(&costs, 4, at, false);
                let same = (way.sum - want).abs() < 1e-4 || way.sum == want;
                assert!(same, "{at}: {} for {want}", way.sum);
                assert!(way.sum.is_infinite() || way.start <= at);
            }
        }
    }

    #[test]
    fn takes_of_any_rate_are_compared_at_one() {
        let take = |rate: f64| IndexedTake {
            frames: (4.0 * rate) as usize,
            rate: Some(rate),
            ..IndexedTake::default()
        };
        for rate in [30.0, 44.0, 50.0, 59.94, 120.0] {
            let take = take(rate);
            let frames = sampled(0..take.frames, &take, 30.0);
            assert!(
                (118..=121).contains(&frames.len()),
                "{rate}: {}",
                frames.len()
            );
            for (k, t) in frames.iter().enumerate() {
                assert!((*t as f64 / rate - k as f64 / 30.0).abs() <= 0.5 / rate + 1e-9);
            }
        }
    }

    #[test]
    fn rows_that_lack_joints_are_passed_over_or_end_a_way() {
        let motion = array![[0.0f32], [1.0], [2.0], [3.0]];
        let rows = array![[0.0f32], [1.0], [f32::NAN], [2.0], [3.0]];
        let ends = align(motion.view(), rows.view(), Norm::Euclidean);
        assert!(ends[2].sum.is_infinite());
        assert_eq!((ends[4].sum, ends[4].start), (0.0, 0));
    }
}
