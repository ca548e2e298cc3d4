//! A gap of a whole body filled at the take's own rate.
//!
//! The gap is laid on a grid of about 30 frames a second from the last frame before it to the
//! first after it. The blended residual, times its weight, is added to the cubic that bridges the
//! gap, by a spline that has no slope at the ends; bones keep the take's lengths.

use super::RATE;
use super::body_tree::{BodyTree, Frames};
use super::library::MotionLibrary;
use super::prediction::{MotionSource, predict, variance_at, with_bones};
use super::regression::Known;
use super::sampling::{clamped_spline, sampled};
use super::windows::{BESIDE, Basis, Beside, Clip, Ends, Origin, Windows, cubic};
use crate::pose::{PointNaming, joints::cmu_names, ranges};
use glam::DVec3;
use ndarray::{Array2, ArrayView2, Axis, concatenate, s};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Windows cut from a library every so many frames, and from the take itself.
const STRIDE: usize = 4;
const OWN_STRIDE: usize = 2;
/// Lengths of gaps for which a library's windows are kept.
const KEPT: usize = 8;
/// With fewer windows of its own no basis is found.
const FEWEST: usize = 60;
/// Frames of the take itself that are looked at, those nearest to the gap: two minutes.
const MOST_OWN: usize = 3600;
/// Frames of a stretch of the take that is of use.
const USEFUL: usize = 20;
/// The longest gap of a whole body that is filled where no limit is given, seconds.
pub const LONGEST: f64 = 1.0;

/// What to say where [`knows_body`] is false.
#[doc(hidden)]
pub const NO_BODY: &str = "the point names are not those of a known body, with root and hips: the \
                           library of motion is not used";

/// Whether motion may fill gaps of a body of points with these names, which are CMU's: those of a
/// skeleton, not of markers.
pub fn knows_body(names: &[String]) -> bool {
    BodyTree::of(names).is_some()
}

/// The body of a take, and what is known of its motion.
pub struct MotionFiller<'a> {
    library: Option<&'a MotionLibrary>,
    tree: BodyTree,
    columns: Vec<usize>,
    frames: Frames,
    /// Stretches of consecutive frames that show the whole body.
    whole: Vec<Range<usize>>,
    runs: Vec<Range<usize>>,
    rate: f64,
    lengths: Vec<f64>,
    clips: Arc<[Clip]>,
    /// The library's windows, by the number of steps.
    cut: BTreeMap<usize, Option<Windows>>,
    /// Without a library, the basis of the take's own windows.
    own_basis: BTreeMap<usize, Basis>,
}

/// What becomes of a gap.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Filled from motion.
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

/// The take around a gap, laid on its grid.
struct Grid {
    /// Steps from the frame before the gap to the one after it.
    steps: usize,
    /// The stretches beside the gap, and the others, with where they are.
    parts: Vec<(Frames, Origin)>,
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
                .map_or(Vec::new(), |l| l.clips_for(&tree, Some(&frames), &lengths))
                .into(),
            library,
            tree,
            columns,
            frames,
            whole,
            runs: runs.to_vec(),
            rate,
            lengths,
            cut: BTreeMap::new(),
            own_basis: BTreeMap::new(),
        })
    }

    /// The table's points that are the body's (B).
    pub fn points(&self) -> &[usize] {
        &self.columns
    }

    /// The gaps of no more than `longest` seconds, or [`LONGEST`], in which the body is not whole.
    /// At least four fifths of their frames are `bare`: too little is seen to place a body.
    pub fn gaps(&self, bare: &[bool], longest: Option<f64>) -> Vec<Range<usize>> {
        let most = longest.unwrap_or(LONGEST) * self.rate * (1.0 + 1e-9);
        let is_open = |t: &usize| self.frames.row(*t).iter().any(|v| !v.is_finite());
        let of_run = |run: &Range<usize>| ranges(run.clone().filter(is_open));
        let mut all: Vec<Range<usize>> = self.runs.iter().flat_map(of_run).collect();
        all.retain(|gap| {
            let empty = gap.clone().filter(|t| bare[*t]).count();
            5 * empty >= 4 * gap.len() && gap.len() as f64 <= most
        });
        all
    }

    /// Fills the gap between two frames that show the whole body; `gap` are those between.
    pub fn fill(&mut self, gap: &Range<usize>) -> Verdict {
        let Some(grid) = self.grid(gap) else {
            return Verdict::TooLittle;
        };
        let steps = grid.steps;
        if !self.cut.contains_key(&steps) {
            if self.cut.len() >= KEPT {
                self.cut.clear();
                self.own_basis.clear();
            }
            let clips = self.clips.clone();
            let windows = Windows::cut(&self.tree, clips, [steps, STRIDE], Beside::Motion, None);
            // Few windows make no basis for others.
            let windows = windows.filter(|w| w.at.len() >= FEWEST);
            self.cut.insert(steps, windows);
        }
        let others = self.cut[&steps].as_ref();
        let known = others.map(|w| &w.basis);
        let known = known.or_else(|| self.own_basis.get(&steps));
        let own = self.own_windows(&grid, known);
        if let (None, Some(own)) = (others, &own) {
            // The same axes serve all gaps of a length.
            let basis = || own.basis.clone();
            self.own_basis.entry(steps).or_insert_with(basis);
        }
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
        let [left, right] = [left, right].map(|n| n.min(MOST_OWN / 2));
        let part = |range: &Range<usize>, at: Vec<f64>, start: usize| {
            let origin = Origin {
                start,
                seconds: (range.start as f64 + at[0]) / self.rate,
                ..Origin::default()
            };
            let frames = self.frames.slice(s![range.clone(), ..]).to_owned();
            (sampled(&frames, &at), origin)
        };
        let last = (before.len() - 1) as f64;
        let back = (0..left).rev().map(|k| last - k as f64 * step).collect();
        let on = |count: usize| (0..count).map(|k| k as f64 * step).collect::<Vec<f64>>();
        let mut parts = vec![
            part(before, back, 0),
            part(after, on(right), left + steps - 1),
        ];
        let is_other = |r: &&Range<usize>| *r != before && *r != after && r.len() >= USEFUL;
        let mut others: Vec<&Range<usize>> = self.whole.iter().filter(is_other).collect();
        others.sort_by_key(|r| r.start.abs_diff(gap.start));
        let mut left_over = MOST_OWN.saturating_sub(left + right);
        for other in others {
            let count = room(other.len()).min(left_over);
            left_over -= count;
            if count >= USEFUL {
                // Far from both: it overlaps neither.
                let start = 1_000_000 + (other.start as f64 / step) as usize;
                parts.push(part(other, on(count), start));
            }
        }
        Some(Grid { steps, parts })
    }

    /// The windows of the take itself; `None` where there are too few to find a basis by.
    fn own_windows(&self, grid: &Grid, basis: Option<&Basis>) -> Option<Windows> {
        let mut clips = Vec::new();
        let mut count = 0;
        for (frames, origin) in &grid.parts {
            count += (frames.nrows() + 2).saturating_sub(2 * BESIDE + grid.steps);
            clips.extend(Clip::both(&self.tree, frames.clone(), *origin));
        }
        if basis.is_none() && count < FEWEST {
            return None;
        }
        let size = [grid.steps, OWN_STRIDE];
        Windows::cut(&self.tree, clips.into(), size, Beside::Motion, basis)
    }

    /// What is known of a gap; `None`: too little.
    fn judge(&self, gap: &Range<usize>, grid: &Grid, known: &Known<'_>) -> Option<Verdict> {
        // What is beside the gap as a clip, in which nothing is in the gap.
        let (left, right) = (&grid.parts[0].0, &grid.parts[1].0);
        let inside = Frames::from_elem((grid.steps - 1, self.tree.points()), DVec3::ZERO);
        let around = [
            left.slice(s![left.nrows() - BESIDE.., ..]),
            inside.view(),
            right.slice(s![..BESIDE, ..]),
        ];
        let around = concatenate(Axis(0), &around).ok()?;
        let clip = Clip::new(&self.tree, around, Origin::default());
        let ends = Ends {
            before: BESIDE - 1,
            after: BESIDE - 1 + grid.steps,
        };
        let found = predict(&self.tree, known, (&clip, ends), self.library)?;
        if found.source.weight == 0.0 {
            return Some(Verdict::Unlike(found.source.expected));
        }
        let frames = gap.len() + 1;
        let u: Vec<f64> = (1..frames).map(|k| k as f64 / frames as f64).collect();
        let path = self.path(gap, grid, &found.residual, &u);
        let variance = u
            .iter()
            .flat_map(|u| variance_at(&found.evidence, grid.steps, *u));
        let variance = variance.collect();
        Some(Verdict::Filled(MotionFill {
            xyz: Array2::from_shape_fn((gap.len(), 3 * path.ncols()), |(k, i)| {
                path[[k, i / 3]][i % 3]
            }),
            variance: Array2::from_shape_vec((gap.len(), path.ncols()), variance).ok()?,
            source: found.source,
        }))
    }

    /// The path over a gap at the take's rate: the cubic, and what is added to it on the grid.
    fn path(&self, gap: &Range<usize>, grid: &Grid, residual: &Frames, u: &[f64]) -> Frames {
        let (first, last) = (gap.start - 1, gap.end);
        // Velocities over a step, as in windows.
        let (left, right) = (&grid.parts[0].0, &grid.parts[1].0);
        let end = left.nrows() - 1;
        let mut path = Frames::from_elem((gap.len(), self.tree.points()), DVec3::ZERO);
        for (p, mut path) in path.columns_mut().into_iter().enumerate() {
            let at = |t: usize| self.frames[[t, p]];
            let mut values = vec![DVec3::ZERO];
            values.extend(residual.column(p));
            values.push(DVec3::ZERO);
            let added = clamped_spline(&values, u);
            let velocities = [
                left[[end, p]] - left[[end - 1, p]],
                right[[1, p]] - right[[0, p]],
            ];
            for ((at_u, u), added) in path.iter_mut().zip(u).zip(added) {
                let ends = [at(first), at(last)];
                *at_u = cubic(*u, grid.steps as f64, ends, velocities) + added;
            }
        }
        let ends = self.frames.select(Axis(0), &[first, last]);
        with_bones(&self.tree, &self.lengths, &path, &ends, u)
    }
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
