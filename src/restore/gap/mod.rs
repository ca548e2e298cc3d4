//! Gaps of a take filled from the frames around them.
//!
//! A gap is a point that is missing for some frames on end. Short gaps are filled before long ones,
//! whose neighbors they then are:
//!
//! 0. A point that rests on either side of a short gap, as a planted foot does, rests in it
//!    (`path`).
//! 1. Gaps of about the same frames are one question. The points that are seen all through it are
//!    its predictors; they also give the frame of reference (`local_poses`).
//! 2. `regression` learns the missing points from the predictors: from the take's own frames, from
//!    a model's training poses, and over time. `estimates` adds what is known at the ends, and
//!    PCHIP.
//! 3. `weights` simulates gaps of the same length where the take is known, and mixes the estimates
//!    by their errors.
//! 4. Where nothing can be learned, `path` interpolates each point over time, if its path is smooth
//!    enough.
//! 5. `rigid_distances` holds what was filled, by a model too, to the distances that are rigid in
//!    this take.
//!
//! Any points will do; a body is known only by its pelvis, whose frame of reference a model's
//! training poses share.

mod estimates;
mod known_frames;
mod local_poses;
mod motion_limits;
mod path;
mod regression;
mod rigid_distances;
mod weights;

use crate::numeric::parallel;
use crate::pose::FillMethod;
use estimates::Targets;
use glam::DVec3;
use known_frames::KnownFrames;
pub(crate) use local_poses::{LocalPoses, anchor as local_anchor};
pub use motion_limits::MotionLimits;
use ndarray::{Array2, ArrayView2, s};
use path::PathVariances;
use regression::{OtherPoses, Regression};
use rigid_distances::TakeDistances;
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

/// The variance of a measured coordinate, cm².
const MEASURED: f64 = 1e-10;
/// Complete frames that a gap's points can be learned from, at least; fewer where a model knows the
/// points.
const FEWEST_FRAMES: usize = 30;
const FEWEST_WITH_OTHERS: usize = 8;
/// Training poses of a model that are placed for one question, at most.
const MOST_PLACED: usize = 3000;
/// Predictors, at most: those at the steadiest distances.
const MOST_PREDICTORS: usize = 40;
/// Frames with all predictors, as a share of those with the targets: predictors that are missing
/// more often are left out.
const SHARE_COMPLETE: f64 = 0.5;
/// Gaps whose lengths are within this factor are filled at the same time.
const WAVE: usize = 4;
/// In a take with more gaps of under [`WAVE`] frames than this, such gaps are interpolated over
/// time: there are too many to learn each, and the path is nearly as good.
const FLOOD: usize = 200;
/// How often a gap is asked for at most since others are filled from whose frames it would be
/// learned.
const MOST_ROUNDS: usize = 16;
/// Seconds on either side of a gap that are learned from.
const WINDOW: f64 = 25.0;
/// Seconds between two runs: what is further apart than anything.
const BREAK: f64 = 1e6;
/// A gap filled mostly by interpolation is called that.
const MOSTLY: f64 = 0.5;

/// A point that is missing for some frames on end.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// The point.
    pub point: usize,
    /// The frames in which it is missing.
    pub frames: Range<usize>,
    /// The frame before, where the point is seen.
    pub before: Option<usize>,
    /// The frame after, where the point is seen.
    pub after: Option<usize>,
}

/// A filled gap.
#[derive(Debug, Clone)]
pub struct FilledGap {
    /// (frames, 3), cm.
    pub xyz: Array2<f64>,
    /// Variance of a coordinate in each frame, cm².
    pub variance: Vec<f64>,
    /// How it was filled.
    pub method: FillMethod,
}

/// The gaps of `seen` (frames, 3 J; NaN missing) within its `runs` of consecutive frames.
pub fn find_gaps(seen: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> Vec<Gap> {
    runs.iter().flat_map(|run| gaps_of(seen, run)).collect()
}

fn gaps_of(seen: ArrayView2<'_, f64>, run: &Range<usize>) -> Vec<Gap> {
    let mut gaps = Vec::new();
    for point in 0..seen.ncols() / 3 {
        let is_missing = |t: usize| (3 * point..3 * point + 3).any(|i| seen[[t, i]].is_nan());
        let mut t = run.start;
        while t < run.end {
            if !is_missing(t) {
                t += 1;
                continue;
            }
            let start = t;
            while t < run.end && is_missing(t) {
                t += 1;
            }
            gaps.push(Gap {
                point,
                frames: start..t,
                before: (start > run.start).then(|| start - 1),
                after: (t < run.end).then_some(t),
            });
        }
    }
    gaps
}

/// Ranges of frames, apart from one another and in their order.
struct FrameRanges(Vec<Range<usize>>);

impl FrameRanges {
    /// The frames of some ranges.
    fn of<'a>(ranges: impl Iterator<Item = &'a Range<usize>>) -> FrameRanges {
        let mut ranges: Vec<Range<usize>> = ranges.cloned().collect();
        ranges.sort_by_key(|range| range.start);
        let mut out: Vec<Range<usize>> = Vec::new();
        for range in ranges {
            match out.last_mut() {
                Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
                _ => out.push(range),
            }
        }
        FrameRanges(out)
    }

    /// Whether some of them are within `frames`.
    fn meet(&self, frames: &Range<usize>) -> bool {
        let first = self.0.partition_point(|range| range.end <= frames.start);
        self.0.get(first).is_some_and(|r| r.start < frames.end)
    }
}

/// What the frames around gaps say, a gap each.
pub struct GapAnswers {
    /// `None` for a gap that cannot be filled: there is nothing to learn from, or no body could
    /// follow the answer, and the point's path is not smooth enough.
    pub filled: Vec<Option<FilledGap>>,
    /// The answers that no body could follow.
    pub refused: Vec<Option<FilledGap>>,
}

/// A take whose gaps are filled.
pub struct GapFiller<'a> {
    /// The names of the points (J).
    pub names: &'a [String],
    /// (frames, 3 J), cm; NaN missing.
    pub captured: ArrayView2<'a, f64>,
    /// Ranges of consecutive frames.
    pub runs: &'a [Range<usize>],
    /// Frames a second.
    pub rate: f64,
    /// Training poses of a model in the pelvis's frame (n, 3 J), cm; points that the model does
    /// not know are NaN.
    pub others: Option<ArrayView2<'a, f64>>,
}

impl GapFiller<'_> {
    /// Fills `gaps`, which are those of the captured frames; [`GapFiller::hold_distances`] comes
    /// after.
    pub fn fill(&self, gaps: &[Gap], done: &(dyn Fn(usize) + Sync)) -> GapAnswers {
        let seen = KnownFrames::of(self.captured);
        let mut known = Known {
            xyz: self.captured.to_owned(),
            frames: KnownFrames::of(self.captured),
            seen: &seen,
            seconds: self.seconds(),
            paths: PathVariances::default(),
        };
        let limits = MotionLimits::measure(self.captured, self.runs, self.rate, gaps);
        let mut filled: Vec<Option<FilledGap>> = vec![None; gaps.len()];
        let mut refused = filled.clone();
        for (gap, filled) in gaps.iter().zip(&mut filled) {
            *filled = path::interpolate_rest(self.captured, gap, self.rate);
            if let Some(rest) = filled {
                known.put(gap, &rest.xyz);
            }
        }
        for mut open in waves(gaps) {
            open.retain(|gap| filled[*gap].is_none());
            let mut rounds = vec![0; gaps.len()];
            let mut asked = open.clone();
            while !asked.is_empty() {
                let answers = self.ask(gaps, &asked, &known, done);
                for (gap, answer) in answers {
                    match limits.allow(self.captured, &gaps[gap], &answer) {
                        true => filled[gap] = Some(answer),
                        false => refused[gap] = Some(answer),
                    }
                }
                for &gap in &asked {
                    rounds[gap] += 1;
                    if filled[gap].is_none() {
                        filled[gap] = self.by_path(&gaps[gap], &known);
                    }
                    if let Some(answer) = &filled[gap] {
                        known.put(&gaps[gap], &answer.xyz);
                    }
                }
                let is_new = |gap: &&usize| filled[**gap].is_some();
                let new = FrameRanges::of(asked.iter().filter(is_new).map(|g| &gaps[*g].frames));
                open.retain(|gap| filled[*gap].is_none());
                // What is filled is known to the gaps for which too little was: those at the same
                // frames are asked again, and, so often, those that learn from
                // these frames.
                let learns = |gap: &usize| {
                    let frames = &gaps[*gap].frames;
                    let is_early = rounds[*gap] < MOST_ROUNDS;
                    new.meet(frames) || is_early && new.meet(&self.window(frames))
                };
                asked = open.iter().copied().filter(learns).collect();
            }
        }
        GapAnswers { filled, refused }
    }

    /// A gap filled by its point's own path, if that is smooth enough.
    fn by_path(&self, gap: &Gap, known: &Known<'_>) -> Option<FilledGap> {
        path::interpolate(self.captured, gap, self.rate, &known.paths)
    }

    /// Seconds of each frame.
    fn seconds(&self) -> Vec<f64> {
        let mut seconds = vec![0.0; self.captured.nrows()];
        for (k, run) in self.runs.iter().enumerate() {
            run.clone()
                .for_each(|t| seconds[t] = k as f64 * BREAK + t as f64 / self.rate);
        }
        seconds
    }

    /// Those of the gaps `open` that can be filled by what other points say, and brief ones of a
    /// flood over time.
    fn ask(
        &self,
        gaps: &[Gap],
        open: &[usize],
        known: &Known<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> Vec<(usize, FilledGap)> {
        let questions = questions(gaps, open.to_vec());
        let is_flood = questions.len() > FLOOD;
        let answers = parallel::map_chunks(questions.len(), 1, |range| {
            done(1);
            let (mut found, mut left) = (Vec::new(), Vec::new());
            for &k in &questions[range.start] {
                let by_path = is_flood && gaps[k].frames.len() < WAVE;
                let path = by_path.then(|| self.by_path(&gaps[k], known));
                match path.flatten() {
                    Some(filled) => found.push((k, filled)),
                    None => left.push(k),
                }
            }
            found.extend(self.answer(gaps, &left, known));
            found
        });
        answers.into_iter().flatten().collect()
    }

    /// Fills the gaps of one question by what other points say, together or else each alone, if
    /// enough is known.
    fn answer(
        &self,
        gaps: &[Gap],
        question: &[usize],
        known: &Known<'_>,
    ) -> Vec<(usize, FilledGap)> {
        if let Some(answers) = self.regress(gaps, question, known) {
            return question.iter().copied().zip(answers).collect();
        }
        match question {
            [_, _, ..] => {
                let alone = |gap: &usize| self.answer(gaps, &[*gap], known);
                question.iter().flat_map(alone).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Fills the gaps of one question by what other points say. `None` where too little is known.
    fn regress(
        &self,
        gaps: &[Gap],
        question: &[usize],
        known: &Known<'_>,
    ) -> Option<Vec<FilledGap>> {
        let of = |k: &usize| &gaps[*k].frames;
        let start = question.iter().map(|k| of(k).start).min()?;
        let end = question.iter().map(|k| of(k).end).max()?;
        let targets: Vec<usize> = question.iter().map(|k| gaps[*k].point).collect();
        let around = self.window(&(start..end));
        let gap = start - around.start..end - around.start;
        let (predictors, frames) = self.predictors(known, &around, &targets, &(start..end))?;
        let xyz = known.xyz.slice(s![around.clone(), ..]);
        let captured = self.captured.slice(s![around.clone(), ..]);
        let anchor = local_anchor(self.names, xyz, &predictors, &frames)?;
        let own = LocalPoses::new(&anchor, xyz, &predictors, &targets);
        let mut complete = vec![false; own.placements.len()];
        frames
            .iter()
            .for_each(|&t| complete[t] = own.is_complete(t));
        let others = self.others(&anchor, &predictors, &targets);
        let columns: Vec<usize> = targets.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let regression = Regression {
            own: &own,
            complete: &complete,
            seconds: &known.seconds[around],
            rate: self.rate,
            others: others.as_ref(),
        };
        let found = weights::weigh(
            &Targets {
                regression: &regression,
                captured,
                columns: &columns,
            },
            &gap,
        )?;
        let mut filled = Vec::new();
        for (k, index) in question.iter().enumerate() {
            let (frames, point) = (&gaps[*index].frames, gaps[*index].point);
            let place = |t: usize| {
                let at = t - start;
                let [x, y, z] = [0, 1, 2].map(|axis| found.mean[[at, 3 * k + axis]]);
                Some(own.placements[gap.start + at]?.apply(DVec3::new(x, y, z)))
            };
            // Where the gap is shorter than the question, its own ends are among what was asked.
            let error = |t: usize| {
                let seen = self.captured.slice(s![t, 3 * point..3 * point + 3]);
                let error = DVec3::new(seen[0], seen[1], seen[2]) - place(t)?;
                Some(error).filter(|e| e.is_finite())
            };
            let before = (frames.start > start).then(|| error(frames.start - 1));
            let after = (frames.end < end).then(|| error(frames.end));
            let [before, after] = [before, after].map(|e| e.flatten().unwrap_or_default());
            let mut xyz = Array2::zeros((frames.len(), 3));
            let mut variance = Vec::with_capacity(frames.len());
            for (i, t) in frames.clone().enumerate() {
                let share = (i + 1) as f64 / (frames.len() + 1) as f64;
                let placed = place(t)? + before.lerp(after, share);
                (xyz[[i, 0]], xyz[[i, 1]], xyz[[i, 2]]) = (placed.x, placed.y, placed.z);
                let columns = s![t - start, 3 * k..3 * k + 3];
                variance.push(found.variance.slice(columns).mean()?);
            }
            if !xyz.iter().all(|v| v.is_finite()) {
                return None;
            }
            let method = match found.over_time[k] > MOSTLY {
                true => FillMethod::Interpolation,
                false => FillMethod::Regression,
            };
            filled.push(FilledGap {
                xyz,
                variance,
                method,
            });
        }
        Some(filled)
    }

    /// The frames around a gap that are learned from.
    fn window(&self, gap: &Range<usize>) -> Range<usize> {
        let reach = (WINDOW * self.rate).ceil() as usize;
        gap.start.saturating_sub(reach)..(gap.end + reach).min(self.captured.nrows())
    }

    /// The predictors of `targets` in the frames `gap`, and the frames `around` it in which all of
    /// both are known, counted from the first around. `None` where either are too few.
    fn predictors(
        &self,
        known: &Known<'_>,
        around: &Range<usize>,
        targets: &[usize],
        gap: &Range<usize>,
    ) -> Option<(Vec<usize>, Vec<usize>)> {
        let frames = known.seen.all_known(targets, around);
        let count = frames.len();
        let of_model = |p: &usize| self.others.is_some_and(|o| o[[0, 3 * p]].is_finite());
        let is_of_model = targets.iter().all(of_model);
        let fewest = if is_of_model {
            FEWEST_WITH_OTHERS
        } else {
            FEWEST_FRAMES
        };
        if count < fewest {
            return None;
        }
        let lacking = |p: usize| count - known.frames.count(p, &frames);
        let mut candidates: Vec<(usize, usize)> = (0..known.frames.points())
            .filter(|p| known.frames.has_all(*p, gap.clone()) && !targets.contains(p))
            .map(|p| (lacking(p), p))
            .filter(|(lacks, _)| *lacks < count)
            .collect();
        candidates.sort_unstable();
        let mut points: Vec<usize> = candidates.into_iter().map(|c| c.1).collect();
        if is_of_model {
            // Points that the model does not know would leave its training poses out.
            let both: Vec<usize> = points.iter().copied().filter(|p| of_model(p)).collect();
            if 2 * both.len() >= points.len() {
                points = both;
            }
        }
        let mut complete = frames;
        let mut kept: Vec<usize> = Vec::new();
        for p in points {
            if known.frames.count(p, &complete) as f64 >= SHARE_COMPLETE * count as f64 {
                complete = known.frames.intersection(p, &complete);
                kept.push(p);
            }
        }
        if complete.len() < fewest {
            return None;
        }
        let complete: Vec<usize> = complete.frames().map(|t| t - around.start).collect();
        if kept.len() > MOST_PREDICTORS {
            let xyz = known.xyz.slice(s![around.clone(), ..]);
            kept = steadiest(xyz, &kept, targets, &complete);
        }
        kept.sort_unstable();
        Some((kept, complete))
    }

    /// The model's training poses in the frame of reference of the predictors; `None` without a
    /// model, or where it does not know all points.
    fn others(
        &self,
        anchor: &crate::pose::Anchor,
        predictors: &[usize],
        targets: &[usize],
    ) -> Option<OtherPoses> {
        let others = self.others.filter(|o| o.nrows() > 1)?;
        let mut points = predictors.iter().chain(targets);
        if !points.all(|p| others[[0, 3 * p]].is_finite()) {
            return None;
        }
        let poses = match anchor.root {
            Some(_) => LocalPoses::in_place(others, predictors, targets),
            None => {
                let step = others.nrows().div_ceil(MOST_PLACED) as isize;
                LocalPoses::new(anchor, others.slice(s![..;step, ..]), predictors, targets)
            }
        };
        Some(OtherPoses::new(poses))
    }

    /// Holds what was filled, by this or otherwise, to the rigid distances of the take.
    pub fn hold_distances(&self, gaps: &[Gap], filled: &mut [Option<FilledGap>]) {
        let mut known = self.captured.to_owned();
        for (gap, filled) in gaps.iter().zip(filled.iter()) {
            if let Some(filled) = filled {
                put(&mut known, gap, &filled.xyz);
            }
        }
        // frame -> gaps that are filled there
        let mut frames: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (k, gap) in gaps
            .iter()
            .enumerate()
            .filter(|(k, _)| filled[*k].is_some())
        {
            (gap.frames.clone()).for_each(|t| frames.entry(t).or_default().push(k));
        }
        let mut points: Vec<usize> = frames.values().flatten().map(|k| gaps[*k].point).collect();
        points.sort_unstable();
        points.dedup();
        let distances = TakeDistances::measure(self.captured, &points);
        let frames: Vec<(usize, Vec<usize>)> = frames.into_iter().collect();
        let held = parallel::map_chunks(frames.len(), 16, |range| {
            let hold = |(t, here): &(usize, Vec<usize>)| {
                let points: Vec<usize> = here.iter().map(|k| gaps[*k].point).collect();
                let mut frame = known.row(*t).to_vec();
                let mut variance = Vec::with_capacity(3 * here.len());
                for k in here {
                    let Some(filled) = &filled[*k] else { continue };
                    for i in 3 * gaps[*k].point..3 * gaps[*k].point + 3 {
                        // What was measured of a point seen in part stays.
                        let measured = self.captured[[*t, i]];
                        let is_measured = measured.is_finite();
                        variance.push(match is_measured {
                            true => MEASURED,
                            false => filled.variance[t - gaps[*k].frames.start],
                        });
                        if is_measured {
                            frame[i] = measured;
                        }
                    }
                }
                distances.hold(&mut frame, &points, &mut variance);
                (frame, variance)
            };
            frames[range].iter().map(hold).collect::<Vec<_>>()
        });
        for ((t, here), (frame, variance)) in frames.iter().zip(held.into_iter().flatten()) {
            known
                .row_mut(*t)
                .iter_mut()
                .zip(frame)
                .for_each(|(k, f)| *k = f);
            for (k, variance) in here.iter().zip(variance.chunks_exact(3)) {
                let gap = &gaps[*k];
                if let Some(filled) = &mut filled[*k] {
                    filled.variance[t - gap.frames.start] = variance.iter().sum::<f64>() / 3.0;
                    let columns = s![*t, 3 * gap.point..3 * gap.point + 3];
                    (filled.xyz.row_mut(t - gap.frames.start)).assign(&known.slice(columns));
                }
            }
        }
    }
}

/// What is known of a take while its gaps are filled.
struct Known<'a> {
    /// (frames, 3 J), cm: captured or filled; NaN missing.
    xyz: Array2<f64>,
    /// The frames in which each point is captured or filled.
    frames: KnownFrames,
    /// Those in which it is captured.
    seen: &'a KnownFrames,
    /// Seconds of each frame.
    seconds: Vec<f64>,
    /// How well points are interpolated.
    paths: PathVariances,
}

impl Known<'_> {
    /// Puts a filled gap in place.
    fn put(&mut self, gap: &Gap, xyz: &Array2<f64>) {
        put(&mut self.xyz, gap, xyz);
        self.frames.add(gap.point, gap.frames.clone());
    }
}

/// Puts filled values in place.
fn put(known: &mut Array2<f64>, gap: &Gap, xyz: &Array2<f64>) {
    let columns = 3 * gap.point..3 * gap.point + 3;
    known.slice_mut(s![gap.frames.clone(), columns]).assign(xyz);
}

/// The gaps by length, shortest first: what is filled in one wave is known in the next.
fn waves(gaps: &[Gap]) -> Vec<Vec<usize>> {
    let mut waves: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (k, gap) in gaps.iter().enumerate() {
        waves
            .entry(gap.frames.len().ilog(WAVE))
            .or_default()
            .push(k);
    }
    waves.into_values().collect()
}

/// The gaps of one wave, those of about the same frames together.
fn questions(gaps: &[Gap], mut wave: Vec<usize>) -> Vec<Vec<usize>> {
    wave.sort_by_key(|k| (gaps[*k].frames.start, gaps[*k].frames.end));
    let mut questions: Vec<Vec<usize>> = Vec::new();
    // The points of each question: a point has one gap in it.
    let mut points: HashSet<(usize, usize)> = HashSet::new();
    for k in wave {
        let (frames, point) = (&gaps[k].frames, gaps[k].point);
        let slack = frames.len() / WAVE;
        let is_alike = |(number, question): &(usize, &mut Vec<usize>)| {
            let first = &gaps[question[0]].frames;
            frames.start.abs_diff(first.start) <= slack
                && frames.end.abs_diff(first.end) <= slack
                && !points.contains(&(*number, point))
        };
        let mut last = questions.iter_mut().enumerate().rev().take(64);
        let number = match last.find(is_alike) {
            Some((number, question)) => {
                question.push(k);
                number
            }
            None => {
                questions.push(vec![k]);
                questions.len() - 1
            }
        };
        points.insert((number, point));
    }
    questions
}

/// The predictors whose distances to the targets vary least.
fn steadiest(
    known: ArrayView2<'_, f64>,
    predictors: &[usize],
    targets: &[usize],
    frames: &[usize],
) -> Vec<usize> {
    let step = frames.len().div_ceil(50);
    let frames: Vec<usize> = frames.iter().copied().step_by(step).collect();
    let variance = |a: usize, b: usize| {
        let lengths = frames.iter().map(|&t| {
            let square =
                |axis: usize| (known[[t, 3 * a + axis]] - known[[t, 3 * b + axis]]).powi(2);
            (0..3).map(square).sum::<f64>().sqrt()
        });
        let (n, sum, squares) =
            lengths.fold((0.0, 0.0, 0.0), |(n, s, q), l| (n + 1.0, s + l, q + l * l));
        squares / n - (sum / n) * (sum / n)
    };
    let mut ranked: Vec<(f64, usize)> = (predictors.iter())
        .map(|&p| {
            let least = targets
                .iter()
                .map(|&q| variance(p, q))
                .fold(f64::INFINITY, f64::min);
            (least, p)
        })
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.truncate(MOST_PREDICTORS);
    ranked.into_iter().map(|r| r.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_found_with_their_ends() {
        let mut xyz = Array2::<f64>::zeros((6, 6));
        xyz[[0, 1]] = f64::NAN;
        xyz[[2, 4]] = f64::NAN;
        xyz[[3, 3]] = f64::NAN;
        xyz[[5, 5]] = f64::NAN;
        let gap = |point, frames: Range<usize>, before, after| Gap {
            point,
            frames,
            before,
            after,
        };
        assert_eq!(
            gaps_of(xyz.view(), &(0..6)),
            [
                gap(0, 0..1, None, Some(1)),
                gap(1, 2..4, Some(1), Some(4)),
                gap(1, 5..6, Some(4), None)
            ]
        );
        // The edge of a run is an end like that of the take.
        assert_eq!(gaps_of(xyz.view(), &(3..6))[0], gap(1, 3..4, None, Some(4)));
    }

    #[test]
    fn gaps_out_of_step_are_filled_by_paths_that_are_measured_once() {
        let (frames, points) = (900, 12);
        let truth = Array2::from_shape_fn((frames, 3 * points), |(t, c)| {
            20.0 * c as f64 + 30.0 * (t as f64 / 40.0 + c as f64).sin()
        });
        let mut captured = truth.clone();
        for t in 0..frames {
            for p in (0..points).filter(|p| (t + p) % 3 == 0) {
                captured.slice_mut(s![t, 3 * p..3 * p + 3]).fill(f64::NAN);
            }
        }
        let names: Vec<String> = (0..points).map(|p| format!("p{p}")).collect();
        let run = 0..frames;
        let filler = GapFiller {
            names: &names,
            captured: captured.view(),
            runs: std::slice::from_ref(&run),
            rate: 120.0,
            others: None,
        };
        let gaps = find_gaps(captured.view(), std::slice::from_ref(&run));
        assert!(gaps.len() > 3000);
        let answers = filler.fill(&gaps, &|_| {});
        for (gap, filled) in gaps.iter().zip(&answers.filled) {
            // At the ends of the take nothing is known on one side.
            if gap.before.is_none() || gap.after.is_none() {
                continue;
            }
            let filled = filled.as_ref().expect("a path");
            for axis in 0..3 {
                let off = filled.xyz[[0, axis]] - truth[[gap.frames.start, 3 * gap.point + axis]];
                assert!(off.abs() <= 0.05, "{off} at {:?}", gap.frames);
            }
        }
        let seen = KnownFrames::of(captured.view());
        let known = Known {
            xyz: captured.clone(),
            frames: KnownFrames::of(captured.view()),
            seen: &seen,
            seconds: filler.seconds(),
            paths: PathVariances::default(),
        };
        gaps.iter().for_each(|gap| {
            filler.by_path(gap, &known);
        });
        assert_eq!(known.paths.len(), points);
    }

    #[test]
    fn a_chain_of_gaps_is_filled_to_its_end() {
        // Each gap lacks frames of the one before it: as many rounds as gaps, while one end is
        // filled after the other.
        let (points, chain, length, step) = (5, 30, 60, 40);
        let frames = 800 + chain * step + 800;
        let truth = Array2::from_shape_fn((frames, 3 * points), |(t, c)| {
            let (t, i) = (t as f64, (c / 3) as f64);
            let turn = 0.5 * (t / 9.0).sin() + 0.2 * (t / 3.7).sin();
            let (x, z) = (10.0 * i.cos(), 9.0 * (1.7 * i).sin());
            match c % 3 {
                0 => {
                    x * turn.cos() - z * turn.sin()
                        + 30.0 * (t / 5.0).sin()
                        + 15.0 * (t / 2.3).sin()
                }
                1 => 100.0 + 12.0 * (2.3 * i).sin() + 8.0 * (t / 3.1).sin(),
                _ => x * turn.sin() + z * turn.cos() + 10.0 * (t / 4.0).cos(),
            }
        });
        let mut captured = truth.clone();
        for k in 0..chain {
            let (start, p) = (800 + k * step, k % points);
            let mut hidden = captured.slice_mut(s![start..start + length, 3 * p..3 * p + 3]);
            hidden.fill(f64::NAN);
        }
        let names: Vec<String> = (0..points).map(|p| format!("p{p}")).collect();
        let run = 0..frames;
        let filler = GapFiller {
            names: &names,
            captured: captured.view(),
            runs: std::slice::from_ref(&run),
            rate: 100.0,
            others: None,
        };
        let gaps = find_gaps(captured.view(), std::slice::from_ref(&run));
        let filled = filler.fill(&gaps, &|_| ()).filled;
        for (gap, filled) in gaps.iter().zip(&filled) {
            let filled = filled.as_ref().expect("a gap stays");
            for (i, t) in gap.frames.clone().enumerate() {
                for axis in 0..3 {
                    let off = filled.xyz[[i, axis]] - truth[[t, 3 * gap.point + axis]];
                    assert!(off.abs() < 0.1, "{gap:?}: {off}");
                }
            }
        }
    }
}
