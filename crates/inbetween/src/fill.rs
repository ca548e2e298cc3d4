//! A gap of a whole body filled at the take's own rate.
//!
//! The gap is laid on a grid of about 30 frames a second from the last frame before it to the
//! first after it. The blended residual, times its weight, is added to the cubic that bridges the
//! gap, by a spline that has no slope at the ends; bones keep the take's lengths.

use super::body_tree::{BodyTree, Frames, turn};
use super::evidence::{Evidence, Residuals, evidence};
use super::library::{MotionLibrary, RATE};
use super::regression::{Blend, Known, blend};
use super::sampling::{clamped_spline, sampled};
use super::windows::{BESIDE, Basis, Beside, Clip, Ends, Origin, Windows, cubic};
use crate::pose::{PointNaming, joints::cmu_names, ranges};
use glam::DVec3;
use ndarray::{Array1, Array2, ArrayView2, Axis, concatenate, s};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Windows cut from a library every so many frames, and from the take itself.
const STRIDE: usize = 4;
const OWN_STRIDE: usize = 2;
/// With fewer windows nothing is said.
const FEWEST: usize = 60;
/// Frames of a stretch of the take that is of use.
const USEFUL: usize = 20;
/// Takes that are named as the nearest, at most.
const NAMED: usize = 3;

/// The body of a take, and what is known of its motion.
pub struct MotionFiller<'a> {
    library: Option<&'a MotionLibrary>,
    tree: BodyTree,
    columns: Vec<usize>,
    frames: Frames,
    /// Stretches of consecutive frames that show the whole body.
    whole: Vec<Range<usize>>,
    rate: f64,
    lengths: Vec<f64>,
    clips: Arc<[Clip]>,
    /// The library's windows, by the number of steps.
    cut: BTreeMap<usize, Option<Windows>>,
}

/// What becomes of a gap.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// It is filled from motion.
    Filled(MotionFill),
    /// Nothing that is known is alike: the error expected, as a share of that of the cubic.
    Unlike(f64),
    /// Under a third of a second is known at an end, or too little besides.
    TooLittle,
}

/// A gap that motion filled.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionFill {
    /// (frames, 3 B), cm, of the points [`MotionFiller::points`].
    pub xyz: Array2<f64>,
    /// Variance of a coordinate (frames, B), cm².
    pub variance: Array2<f64>,
    /// How it was found.
    pub source: MotionSource,
}

/// Where the motion in a gap is from.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSource {
    /// The error expected, as a share of that of the cubic that meets both ends.
    pub expected: f64,
    /// How much of the motion is used, from 0 to 1: the rest is the cubic.
    pub weight: f64,
    /// The takes of the nearest windows, and the seconds in them; `None`: the take itself.
    pub nearest: Vec<(Option<String>, f64)>,
}

/// The take around a gap, laid on its grid.
struct Grid {
    /// Steps from the frame before the gap to the one after it.
    steps: usize,
    /// The stretches beside the gap, and the others, with where they begin, in steps.
    parts: Vec<(Frames, usize)>,
}

impl<'a> MotionFiller<'a> {
    /// For a take (frames, 3 J; cm, NaN missing) of points with these names, in runs of
    /// consecutive frames, `rate` a second. `None` where the names tell no body, or no frame shows
    /// it whole.
    pub fn new(
        names: &[String],
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        rate: f64,
        library: Option<&'a MotionLibrary>,
    ) -> Option<MotionFiller<'a>> {
        let naming = PointNaming::of(names, xyz, &cmu_names());
        let (tree, columns) = BodyTree::of(&naming.model_names(names))?;
        let frames = BodyTree::frames(xyz, &columns);
        let is_whole = |t: &usize| frames.row(*t).iter().all(|v| v.is_finite());
        let of_run = |run: &Range<usize>| ranges(run.clone().filter(is_whole));
        let whole: Vec<Range<usize>> = runs.iter().flat_map(of_run).collect();
        if whole.is_empty() {
            return None;
        }
        let lengths = tree.lengths(&frames);
        Some(MotionFiller {
            clips: library
                .map_or(Vec::new(), |l| l.clips_for(&tree, &lengths))
                .into(),
            library,
            tree,
            columns,
            frames,
            whole,
            rate,
            lengths,
            cut: BTreeMap::new(),
        })
    }

    /// The table's points that are the body's (B).
    pub fn points(&self) -> &[usize] {
        &self.columns
    }

    /// Fills the gap between two frames that show the whole body; `gap` are those between.
    pub fn fill(&mut self, gap: &Range<usize>) -> Verdict {
        let Some(grid) = self.grid(gap) else {
            return Verdict::TooLittle;
        };
        let steps = grid.steps;
        if !self.cut.contains_key(&steps) {
            let clips = self.clips.clone();
            let windows = Windows::cut(&self.tree, clips, [steps, STRIDE], Beside::Motion, None);
            self.cut.insert(steps, windows);
        }
        let others = self.cut[&steps].as_ref();
        let own = self.own_windows(&grid, others.map(|w| &w.basis));
        let known = Known {
            others,
            own: own.as_ref(),
        };
        self.judge(gap, &grid, &known).unwrap_or(Verdict::TooLittle)
    }

    /// The grid of a gap; `None` where too little is known beside it.
    fn grid(&self, gap: &Range<usize>) -> Option<Grid> {
        let before = self.whole.iter().find(|r| r.end == gap.start)?;
        let after = self.whole.iter().find(|r| r.start == gap.end)?;
        let frames = gap.len() + 1;
        let steps = ((frames as f64 * RATE / self.rate).round() as usize).max(3);
        let step = frames as f64 / steps as f64;
        let room = |length: usize| ((length - 1) as f64 / step + 1e-9) as usize + 1;
        let [left, right] = [room(before.len()), room(after.len())];
        if left < BESIDE || right < BESIDE {
            return None;
        }
        let part = |range: &Range<usize>, at: Vec<f64>| {
            sampled(&self.frames.slice(s![range.clone(), ..]).to_owned(), &at)
        };
        let last = (before.len() - 1) as f64;
        let back = (0..left).rev().map(|k| last - k as f64 * step).collect();
        let on = |count: usize| (0..count).map(|k| k as f64 * step).collect::<Vec<f64>>();
        let mut parts = vec![
            (part(before, back), 0),
            (part(after, on(right)), left + steps - 1),
        ];
        for other in &self.whole {
            if other != before && other != after && other.len() >= USEFUL {
                // Far from both: it overlaps neither.
                let start = 1_000_000 + (other.start as f64 / step) as usize;
                parts.push((part(other, on(room(other.len()))), start));
            }
        }
        Some(Grid { steps, parts })
    }

    /// The windows of the take itself; `None` where there are too few to find a basis by.
    fn own_windows(&self, grid: &Grid, basis: Option<&Basis>) -> Option<Windows> {
        let mut clips = Vec::new();
        let mut count = 0;
        for (frames, start) in &grid.parts {
            count += (frames.nrows() + 2).saturating_sub(2 * BESIDE + grid.steps);
            let origin = Origin {
                start: *start,
                ..Origin::default()
            };
            clips.extend(Clip::both(&self.tree, frames.clone(), origin));
        }
        if basis.is_none() && count < FEWEST {
            return None;
        }
        let size = [grid.steps, OWN_STRIDE];
        Windows::cut(&self.tree, clips.into(), size, Beside::Motion, basis)
    }

    /// What is known of a gap; `None`: too little.
    fn judge(&self, gap: &Range<usize>, grid: &Grid, known: &Known<'_>) -> Option<Verdict> {
        let some = known.others.or(known.own)?;
        let count = |w: Option<&Windows>| w.map_or(0, |w| w.at.len());
        if count(known.others) + count(known.own) < FEWEST {
            return None;
        }
        // What is beside the gap as a clip, in which nothing is in the gap.
        let (left, right) = (&grid.parts[0].0, &grid.parts[1].0);
        let inside = Frames::from_elem((grid.steps - 1, self.tree.points()), DVec3::ZERO);
        let around = concatenate(
            Axis(0),
            &[
                left.slice(s![left.nrows() - BESIDE.., ..]),
                inside.view(),
                right.slice(s![..BESIDE, ..]),
            ],
        )
        .ok()?;
        let clip = Clip::new(&self.tree, around, Origin::default());
        let ends = Ends {
            before: BESIDE - 1,
            after: BESIDE - 1 + grid.steps,
        };
        let features = some.features_of(&self.tree, &clip, ends);
        let near = known.distances(features.view());
        let found = blend(known, features.view(), near.clone())?;
        let mut residuals = Residuals::default();
        let residual = residuals.blended(&self.tree, known, &found);
        let gap_and_residual = (&found, &residual);
        let evidence = evidence(&self.tree, known, &mut residuals, gap_and_residual, &near)?;
        if evidence.weight == 0.0 {
            return Some(Verdict::Unlike(evidence.expected));
        }
        let xyz = self.path(
            gap,
            grid,
            &(residual * evidence.weight),
            ends.heading(&clip),
        );
        Some(Verdict::Filled(MotionFill {
            variance: variance(&evidence, gap.len(), grid.steps),
            xyz,
            source: MotionSource {
                expected: evidence.expected,
                weight: evidence.weight,
                nearest: self.nearest(&found, known),
            },
        }))
    }

    /// The path over the gap (frames, 3 B), cm.
    fn path(
        &self,
        gap: &Range<usize>,
        grid: &Grid,
        residual: &Array1<f64>,
        heading: f64,
    ) -> Array2<f64> {
        let tree = &self.tree;
        let ahead = turn(heading);
        let points = tree.points();
        let (first, last) = (gap.start - 1, gap.end);
        let frames = gap.len() + 1;
        let u: Vec<f64> = (1..frames).map(|k| k as f64 / frames as f64).collect();
        // Velocities over 1/30 s.
        let reach = ((self.rate / RATE).round() as usize).max(1);
        let [before, after] = [first.saturating_sub(reach), last + reach];
        let mut path = Frames::from_elem((gap.len(), points), DVec3::ZERO);
        for p in 0..points {
            let at = |t: usize| self.frames[[t, p]];
            let off = |k: usize, p: usize| {
                let i = 3 * (k * points + p);
                ahead * DVec3::new(residual[i], residual[i + 1], residual[i + 2])
            };
            let about_root = f64::from(u8::from(p != tree.root));
            let about = |k: usize| off(k, p) + about_root * off(k, tree.root);
            let mut values = vec![DVec3::ZERO];
            values.extend((0..grid.steps - 1).map(about));
            values.push(DVec3::ZERO);
            let added = clamped_spline(&values, &u);
            let velocities =
                [at(first) - at(before), at(after) - at(last)].map(|v| v / reach as f64);
            for (k, (u, added)) in u.iter().zip(added).enumerate() {
                let bridge = cubic(*u, frames as f64, [at(first), at(last)], velocities);
                path[[k, p]] = bridge + added;
            }
        }
        let rigid = |frames: &Frames| tree.with_lengths(frames, 1.0, &self.lengths);
        let ends = self.frames.select(Axis(0), &[first, last]);
        let off = &ends - &rigid(&ends);
        let path = rigid(&path);
        Array2::from_shape_fn((gap.len(), 3 * points), |(k, i)| {
            // What making bones rigid moved at the ends fades.
            let (a, b) = ((1.0 - u[k]).powi(2), u[k] * u[k]);
            (path[[k, i / 3]] + a * off[[0, i / 3]] + b * off[[1, i / 3]])[i % 3]
        })
    }

    /// The takes of the nearest windows.
    fn nearest(&self, blend: &Blend, known: &Known<'_>) -> Vec<(Option<String>, f64)> {
        let mut out: Vec<(Option<String>, f64)> = Vec::new();
        for window in &blend.windows {
            let Some(windows) = known.of(*window) else {
                continue;
            };
            let library = self.library.filter(|_| !window.is_own);
            let take = windows.origin(window.index).take;
            let name = library.map(|l| l.takes[take].name.clone());
            let seconds = windows.gap_start(window.index) as f64 / RATE;
            if out.len() < NAMED && !out.iter().any(|(known, _)| *known == name) {
                out.push((name, seconds));
            }
        }
        out
    }
}

/// The variance of a coordinate (frames, points): the gap's, shared over time.
fn variance(evidence: &Evidence, frames: usize, steps: usize) -> Array2<f64> {
    let profile = |u: f64| (4.0 * u * (1.0 - u)).powf(1.5);
    let on_grid = (1..steps).map(|k| profile(k as f64 / steps as f64));
    let mean = on_grid.sum::<f64>() / (steps - 1) as f64;
    Array2::from_shape_fn((frames, evidence.variance.len()), |(t, p)| {
        let u = (t + 1) as f64 / (frames + 1) as f64;
        evidence.variance[p] * profile(u) / mean
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::tests::table;

    /// A walk, and the library of another's at almost the same pace.
    fn filled(gap: Range<usize>, rate: f64, library: bool) -> (Verdict, Array2<f64>) {
        let frames = (8.0 * rate) as usize;
        let truth = table("a", frames, rate, 1.0, 1.0);
        let mut known = MotionLibrary::default();
        for (name, pace, scale) in [("b", 1.02, 1.05), ("c", 0.97, 0.95), ("d", 1.0, 0.9)] {
            let poses = table(name, 900, 30.0, pace, scale);
            known.add(&poses, &poses.rates(), None, name).unwrap();
        }
        let mut xyz = truth.xyz.clone();
        xyz.slice_mut(s![gap.clone(), ..]).fill(f64::NAN);
        let run = 0..frames;
        let library = library.then_some(&known);
        let mut filler =
            MotionFiller::new(&truth.points, xyz.view(), &[run], rate, library).unwrap();
        let hidden = truth.xyz.slice(s![gap.clone(), ..]).to_owned();
        (filler.fill(&gap), hidden)
    }

    #[test]
    fn a_walk_is_filled_by_walks_and_by_itself() {
        for (gap, rate) in [(100..130, 30.0), (400..520, 120.0), (101..138, 48.0)] {
            for library in [true, false] {
                let (verdict, truth) = filled(gap.clone(), rate, library);
                let Verdict::Filled(fill) = verdict else {
                    panic!("{rate} {library}: {verdict:?}");
                };
                let off = (&fill.xyz - &truth).mapv(|v| v * v).mean().unwrap().sqrt();
                let most = if library { 1.5 } else { 4.0 };
                assert!(off < most, "{rate} {library}: {off} cm");
                assert!(fill.source.expected < 0.6 && !fill.source.nearest.is_empty());
                let sd = fill.variance.mean().unwrap().sqrt();
                assert!(sd > 0.3 * off && sd < 5.0 * off.max(0.2), "{sd} of {off}");
            }
        }
    }

    #[test]
    fn what_is_short_at_an_end_is_left() {
        let (verdict, _) = filled(6..36, 30.0, true);
        assert_eq!(verdict, Verdict::TooLittle);
    }
}
