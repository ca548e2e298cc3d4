//! Motion between key poses, from a library.
//!
//! Each span between two keys is a cubic, whose velocity at a key is that of the parabola through
//! it and its neighbors, and what the nearest windows of a library have over theirs, where gaps
//! simulated in them say that this helps. Both sides of a key share one velocity, the mean of what
//! they say.

use super::RATE;
use super::body_tree::{BodyTree, Frames};
use super::library::MotionLibrary;
use super::prediction::{MotionSource, Prediction, predict, variance_at, with_bones};
use super::regression::Known;
use super::sampling::clamped_spline;
use super::windows::{Beside, Clip, Ends, Origin, Windows, cubic, tangent};
use crate::Result;
use crate::pose::{PointNaming, Poses, point_at};
use glam::DVec3;
use ndarray::{Array2, Axis};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Longer spans are not filled from motion, and keys farther off are no neighbors, seconds.
const LONGEST: f64 = 2.0;
/// Steps of a span, at least.
const FEWEST: usize = 3;
/// Windows are cut every so many frames, and kept for so many kinds of spans.
const STRIDE: usize = 4;
const KEPT: usize = 8;
/// Frames that are made, at most.
const MOST_FRAMES: f64 = 1e6;
/// How far off a frame a key may be, in frames.
const OFF: f64 = 0.02;

/// A motion through key poses.
#[derive(Debug, Clone)]
pub struct KeyedMotion {
    /// The motion, with the points of the keys; keys are as they were.
    pub poses: Poses,
    /// Standard deviation of a coordinate of each point (frames, J), cm; 0 in keys, NaN where
    /// nothing is said.
    pub sd: Array2<f64>,
    /// The rows of the table that are keys, and their frames.
    pub keys: Vec<(usize, usize)>,
    /// What is between each two keys that have frames between them.
    pub spans: Vec<KeySpan>,
}

/// What is between two keys.
#[derive(Debug, Clone, PartialEq)]
pub struct KeySpan {
    /// The frames of both keys.
    pub frames: [usize; 2],
    /// Where the motion is from; `None`: it is a spline.
    pub source: Option<MotionSource>,
    /// Whether motion was looked for: the span is neither brief nor long.
    pub is_tried: bool,
}

/// Key poses of a body.
struct Keys<'a> {
    library: &'a MotionLibrary,
    tree: BodyTree,
    frames: Frames,
    /// The seconds of each.
    times: Vec<f64>,
    lengths: Vec<f64>,
    clips: Arc<[Clip]>,
    /// By steps, and steps to the neighbors.
    cut: BTreeMap<(usize, Beside), Option<Windows>>,
}

/// The motion at `rate` frames a second through the key poses of a table with times, from a
/// library. Rows without any position are none; `naming` says how points are named, else the names
/// tell.
///
/// # Errors
/// [`crate::Error::Unfit`]: no times, or times that do not rise or lie between frames; fewer than
/// two keys; one that lacks a point; no body that is known by name.
pub fn through_keys(
    poses: &Poses,
    rate: f64,
    library: &MotionLibrary,
    naming: Option<&PointNaming>,
) -> Result<KeyedMotion> {
    let (tree, columns) = BodyTree::of_table(poses, naming)?;
    let is_any = |t: &usize| poses.xyz.row(*t).iter().any(|v| v.is_finite());
    let keys: Vec<usize> = (0..poses.frames()).filter(is_any).collect();
    let time = poses.time.as_ref().ok_or("has no times, which keys need")?;
    let times: Vec<f64> = keys.iter().map(|t| time[*t]).collect();
    if keys.len() < 2 {
        return Err("has fewer than two key poses".into());
    }
    for key in &keys {
        let lacks = |p: &&usize| !point_at(poses.xyz.view(), *key, **p).is_finite();
        if let Some(p) = columns.iter().find(lacks) {
            let (name, at) = (&poses.points[*p], time[*key]);
            return Err(format!("the key at {at} s lacks {name}: complete fills poses").into());
        }
    }
    let at = frames_of(&times, rate)?;
    let frames = BodyTree::frames(poses.xyz.select(Axis(0), &keys).view(), &columns);
    let lengths = tree.lengths(&frames);
    let mut body = Keys {
        clips: library.clips_for(&tree, None, &lengths).into(),
        library,
        tree,
        frames,
        times,
        lengths,
        cut: BTreeMap::new(),
    };
    let found: Vec<Option<Prediction>> = (1..keys.len()).map(|k| body.predicted(k - 1)).collect();
    let count = at[at.len() - 1] + 1;
    let mut xyz = Array2::from_elem((count, poses.xyz.ncols()), f64::NAN);
    let mut sd = Array2::from_elem((count, poses.points.len()), f64::NAN);
    let mut spans = Vec::new();
    let velocities = body.velocities(&found);
    for (k, found) in found.iter().enumerate() {
        let [from, to] = [at[k], at[k + 1]];
        let u: Vec<f64> = (1..to - from)
            .map(|n| n as f64 / (to - from) as f64)
            .collect();
        let path = body.path(k, found.as_ref(), &velocities, &u);
        for (n, (frame, u)) in path.rows().into_iter().zip(&u).enumerate() {
            let variance = found
                .as_ref()
                .map(|f| variance_at(&f.evidence, f.steps(), *u));
            for (b, p) in columns.iter().enumerate() {
                let row = from + 1 + n;
                (0..3).for_each(|c| xyz[[row, 3 * p + c]] = frame[b][c]);
                sd[[row, *p]] = variance.as_ref().map_or(f64::NAN, |v| v[b].sqrt());
            }
        }
        if to > from + 1 {
            spans.push(KeySpan {
                frames: [from, to],
                source: found.as_ref().map(|f| f.source.clone()),
                is_tried: body.steps(k, k + 1) >= FEWEST,
            });
        }
    }
    let others = (0..poses.points.len()).filter(|p| !columns.contains(p));
    others.for_each(|p| spline(poses, &keys, (&body.times, &at), p, &mut xyz));
    for (key, row) in keys.iter().zip(&at) {
        xyz.row_mut(*row).assign(&poses.xyz.row(*key));
        sd.row_mut(*row).fill(0.0);
    }
    let first = body.times[0];
    Ok(KeyedMotion {
        poses: Poses {
            points: poses.points.clone(),
            xyz,
            time: Some((0..count).map(|t| first + t as f64 / rate).collect()),
            take: None,
        },
        sd,
        keys: keys.into_iter().zip(at).collect(),
        spans,
    })
}

/// The frame of each key.
fn frames_of(times: &[f64], rate: f64) -> Result<Vec<usize>> {
    let mut out: Vec<usize> = Vec::new();
    for time in times {
        let frame = (time - times[0]) * rate;
        if !(frame.abs() <= MOST_FRAMES) {
            let what = format!("the key at {time} s would be frame {frame:.0}: too many frames");
            return Err(what.into());
        }
        if (frame - frame.round()).abs() > OFF {
            return Err(format!(
                "the key at {time} s lies between two frames of {rate} a second; the option `fps` \
                 sets the rate"
            )
            .into());
        }
        let frame = frame.round() as usize;
        if out.last().is_some_and(|last| *last >= frame) {
            return Err(format!("the key at {time} s is not after the one before it").into());
        }
        out.push(frame);
    }
    Ok(out)
}

/// A point that is none of the body's: the cubics through the keys that have it.
fn spline(
    poses: &Poses,
    keys: &[usize],
    (times, at): (&[f64], &[usize]),
    p: usize,
    xyz: &mut Array2<f64>,
) {
    let place = |k: usize| point_at(poses.xyz.view(), keys[k], p);
    let known: Vec<usize> = (0..keys.len()).filter(|k| place(*k).is_finite()).collect();
    for (n, pair) in known.windows(2).enumerate() {
        let [a, b] = [pair[0], pair[1]];
        let span = times[b] - times[a];
        let way = |a: usize, b: usize| {
            let seconds = times[b] - times[a];
            ((place(b) - place(a)) / seconds, seconds)
        };
        let before = known[n.saturating_sub(1)];
        let after = known[(n + 2).min(known.len() - 1)];
        let velocities = [(before, a), (b, after)].map(|(from, to)| match to - from {
            0 => way(a, b).0 * span,
            _ => tangent([way(from, to), way(a, b)]) * span,
        });
        for row in at[a] + 1..at[b] {
            let u = (row - at[a]) as f64 / (at[b] - at[a]) as f64;
            let place = cubic(u, 1.0, [place(a), place(b)], velocities);
            (0..3).for_each(|c| xyz[[row, 3 * p + c]] = place[c]);
        }
    }
}

impl Prediction {
    fn steps(&self) -> usize {
        self.residual.nrows() + 1
    }

    /// The slopes of a point's residual at both ends, cm a step.
    fn slopes(&self, p: usize) -> [DVec3; 2] {
        let n = self.residual.nrows();
        let at = |k: usize| self.residual[[k, p]];
        [
            (4.0 * at(0) - at(1)) / 2.0,
            (at(n - 2) - 4.0 * at(n - 1)) / 2.0,
        ]
    }
}

impl Keys<'_> {
    /// Steps of a library between two keys; 0 where they are the same or far apart.
    fn steps(&self, from: usize, to: usize) -> usize {
        let seconds = self.times[to] - self.times[from];
        if seconds > LONGEST || seconds <= 0.0 {
            return 0;
        }
        ((seconds * RATE).round() as usize).max(1)
    }

    /// The keys before and after a span, where they are near.
    fn neighbors(&self, k: usize) -> [usize; 2] {
        let last = self.times.len() - 1;
        [
            self.steps(k.saturating_sub(1), k),
            self.steps(k + 1, (k + 2).min(last)),
        ]
    }

    /// What the library says of a span; `None`: nothing that would help.
    fn predicted(&mut self, k: usize) -> Option<Prediction> {
        let steps = self.steps(k, k + 1);
        if steps < FEWEST {
            return None;
        }
        let [before, after] = self.neighbors(k);
        let beside = Beside::Keys([before, after]);
        let (tree, clips) = (&self.tree, &self.clips);
        let cut = || Windows::cut(tree, clips.clone(), [steps, STRIDE], beside, None);
        if self.cut.len() >= KEPT && !self.cut.contains_key(&(steps, beside)) {
            self.cut.clear();
        }
        let others = (self.cut.entry((steps, beside)).or_insert_with(cut)).as_ref();
        let known = Known { others, own: None };
        // The keys as a clip, in which nothing is between them.
        let ends = Ends {
            before,
            after: before + steps,
        };
        let mut frames = Frames::from_elem((ends.after + after + 1, tree.points()), DVec3::ZERO);
        let mut put = |row: usize, key: usize| frames.row_mut(row).assign(&self.frames.row(key));
        put(0, if before > 0 { k - 1 } else { k });
        put(ends.after + after, if after > 0 { k + 2 } else { k + 1 });
        put(ends.before, k);
        put(ends.after, k + 1);
        let clip = Clip::new(tree, frames, Origin::default());
        let found = predict(tree, &known, (&clip, ends), Some(self.library))?;
        (found.source.weight > 0.0).then_some(found)
    }

    /// The velocity of each point at each key (keys, points), cm/s: the mean of what both sides
    /// say.
    fn velocities(&self, found: &[Option<Prediction>]) -> Frames {
        let mut sums = Frames::from_elem(self.frames.dim(), DVec3::ZERO);
        let last = found.len();
        for (k, found) in found.iter().enumerate() {
            let seconds = self.times[k + 1] - self.times[k];
            let [before, after] = self.neighbors(k);
            let [a, b] = [
                if before > 0 { k - 1 } else { k },
                if after > 0 { k + 2 } else { k + 1 },
            ];
            for p in 0..self.tree.points() {
                let way = |from: usize, to: usize| {
                    let seconds = self.times[to] - self.times[from];
                    (
                        (self.frames[[to, p]] - self.frames[[from, p]]) / seconds,
                        seconds,
                    )
                };
                let across = way(k, k + 1);
                let mut own = [(a, k), (k + 1, b)].map(|(from, to)| match to - from {
                    0 => across.0,
                    _ => tangent([way(from, to), across]),
                });
                if let Some(found) = found {
                    for (own, slope) in own.iter_mut().zip(found.slopes(p)) {
                        *own += slope * found.steps() as f64 / seconds;
                    }
                }
                for (key, own) in [k, k + 1].into_iter().zip(own) {
                    let sides = if key == 0 || key == last { 1.0 } else { 2.0 };
                    sums[[key, p]] += own / sides;
                }
            }
        }
        sums
    }

    /// The path over a span, at `u` of it.
    fn path(&self, k: usize, found: Option<&Prediction>, velocities: &Frames, u: &[f64]) -> Frames {
        let seconds = self.times[k + 1] - self.times[k];
        let mut path = Frames::from_elem((u.len(), self.tree.points()), DVec3::ZERO);
        for (p, mut path) in path.columns_mut().into_iter().enumerate() {
            let ends = [k, k + 1].map(|k| self.frames[[k, p]]);
            let velocities = [k, k + 1].map(|k| velocities[[k, p]] * seconds);
            let added = found.map(|found| {
                // Less the cubic of its own slopes, which is in the velocities.
                let steps = found.steps();
                let slopes = found.slopes(p);
                let value = |n: usize| {
                    let u = n as f64 / steps as f64;
                    let inside = n > 0 && n < steps;
                    let own = if inside {
                        found.residual[[n - 1, p]]
                    } else {
                        DVec3::ZERO
                    };
                    own - cubic(u, steps as f64, [DVec3::ZERO; 2], slopes)
                };
                clamped_spline(&(0..=steps).map(value).collect::<Vec<_>>(), u)
            });
            for (n, (at, u)) in path.iter_mut().zip(u).enumerate() {
                *at = cubic(*u, 1.0, ends, velocities);
                *at += added.as_ref().map_or(DVec3::ZERO, |added| added[n]);
            }
        }
        let ends = self.frames.select(Axis(0), &[k, k + 1]);
        with_bones(&self.tree, &self.lengths, &path, &ends, u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::tests::table;

    fn library() -> MotionLibrary {
        let mut known = MotionLibrary::default();
        for (name, pace, scale) in [("b", 1.02, 1.05), ("c", 0.97, 0.95), ("d", 1.0, 0.9)] {
            let poses = table(name, 900, 30.0, pace, scale);
            known.add(&poses, &poses.rates(), None, name).unwrap();
        }
        known
    }

    fn keys(truth: &Poses, at: &[usize]) -> Poses {
        Poses {
            take: None,
            ..truth.with_frames(at)
        }
    }

    /// The root mean square of differences, cm.
    fn rms(a: &Array2<f64>, b: &Array2<f64>) -> f64 {
        (a - b).mapv(|v| v * v).mean().unwrap().sqrt()
    }

    #[test]
    fn keys_of_a_walk_become_a_walk() {
        let truth = table("a", 200, 30.0, 1.0, 1.0);
        let at = [40, 55, 70, 88, 100];
        let keyed = through_keys(&keys(&truth, &at), 30.0, &library(), None).unwrap();
        let truth = truth.slice(40..101);
        assert_eq!(keyed.poses.frames(), 61);
        for t in at {
            assert_eq!(keyed.poses.xyz.row(t - 40), truth.xyz.row(t - 40));
        }
        let none = MotionLibrary::default();
        let plain = through_keys(&keys(&truth, &at.map(|t| t - 40)), 30.0, &none, None).unwrap();
        assert!(plain.spans.iter().all(|s| s.source.is_none()));
        assert!(keyed.spans.iter().all(|s| s.source.is_some()));
        let (own, spline) = (
            rms(&keyed.poses.xyz, &truth.xyz),
            rms(&plain.poses.xyz, &truth.xyz),
        );
        assert!(own < 0.5 * spline, "{own} {spline}");
        // No jump in velocity at a key.
        let step = |t: usize| &keyed.poses.xyz.row(t + 1) - &keyed.poses.xyz.row(t);
        let bend = |t: usize| (&step(t) - &step(t - 1)).mapv(f64::abs).sum();
        let usual = (3..58).map(bend).sum::<f64>() / 55.0;
        assert!((15..=48).step_by(15).all(|t| bend(t) < 4.0 * usual));
    }

    #[test]
    fn what_are_no_keys_is_said() {
        let truth = table("a", 60, 30.0, 1.0, 1.0);
        let fails = |poses: &Poses, rate: f64| {
            let error = through_keys(poses, rate, &MotionLibrary::default(), None);
            error.unwrap_err().to_string()
        };
        assert!(fails(&keys(&truth, &[4]), 30.0).contains("two key poses"));
        assert!(fails(&keys(&truth, &[4, 9]), 25.0).contains("between two frames"));
        let mut gappy = keys(&truth, &[4, 9, 20]);
        gappy.xyz[[1, 4]] = f64::NAN;
        assert!(fails(&gappy, 30.0).contains("lacks"));
        gappy.xyz.row_mut(1).fill(f64::NAN);
        let spline = through_keys(&gappy, 30.0, &MotionLibrary::default(), None).unwrap();
        assert_eq!(spline.spans.len(), 1);
    }
}
