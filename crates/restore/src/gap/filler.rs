//! Gaps filled from the frames around them, shortest first, those of about the same frames
//! together.

use super::estimates::Targets;
use super::known_frames::Known;
use super::local_poses::{LocalPoses, anchor};
use super::motion_limits::MotionLimits;
use super::predictors::{Predictors, other_poses, predictors};
use super::regression::Regression;
use super::tuning::filler::*;
use super::weights::Weighed;
use super::{FilledGap, Gap, ends, path, weights};
use crate::numeric::parallel;
use crate::numeric::statistics::mean_of_finite;
use crate::pose::FillMethod;
use crate::take::Take;
use glam::DVec3;
use ndarray::{Array2, ArrayView2, CowArray, s};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;

/// A take whose gaps are filled.
pub(crate) struct GapFiller<'a, 't> {
    take: &'a Take<'t>,
    gaps: &'a [Gap],
    /// Training poses of a model in the pelvis's frame (n, 3 J), cm; points that the model does
    /// not know are NaN.
    others: Option<ArrayView2<'a, f64>>,
    /// Whether these are unlike the take's.
    in_doubt: bool,
    limits: MotionLimits,
    known: Known,
}

impl<'a, 't> GapFiller<'a, 't> {
    /// Measures what is known of a take and its points, to fill its `gaps`.
    pub(crate) fn new(
        take: &'a Take<'t>,
        gaps: &'a [Gap],
        others: Option<ArrayView2<'a, f64>>,
        in_doubt: bool,
    ) -> GapFiller<'a, 't> {
        GapFiller {
            take,
            gaps,
            others,
            in_doubt,
            limits: MotionLimits::measure(take, gaps),
            known: Known::new(take),
        }
    }

    /// Fills the gaps, those that are not `bridged` already. `None` for one that cannot be filled:
    /// there is nothing to learn from, or no body could follow the estimate, and the point's path
    /// is not smooth enough. Beside it the last estimate of each gap that no body could follow.
    pub(crate) fn fill(
        mut self,
        bridged: &[Option<FilledGap>],
        done: &(dyn Fn(usize) + Sync),
    ) -> (Vec<Option<FilledGap>>, Vec<Option<FilledGap>>) {
        let gaps = self.gaps;
        let mut filled: Vec<Option<FilledGap>> = vec![None; gaps.len()];
        let mut implausible = filled.clone();
        for (gap, filled) in gaps.iter().zip(&mut filled) {
            *filled = path::interpolate_rest(self.take.xyz, gap, self.take.rate);
        }
        for ((gap, filled), bridged) in gaps.iter().zip(&mut filled).zip(bridged) {
            let is_moved = bridged
                .as_ref()
                .is_some_and(|b| b.method == FillMethod::Motion);
            *filled = filled.take().filter(|_| !is_moved).or(bridged.clone());
            if let Some(filled) = filled {
                self.known.put(gap, &filled.xyz);
            }
        }
        for mut open in by_length(gaps) {
            open.retain(|gap| filled[*gap].is_none());
            let mut rounds = vec![0; gaps.len()];
            let mut now = open.clone();
            while !now.is_empty() {
                for (gap, estimate) in self.fill_groups(&now, done) {
                    if self.limits.allow(self.take.xyz, &gaps[gap], &estimate) {
                        filled[gap] = Some(estimate)
                    } else {
                        implausible[gap] = Some(estimate)
                    }
                }
                for &gap in &now {
                    rounds[gap] += 1;
                    if filled[gap].is_none() {
                        filled[gap] = self.by_path(&gaps[gap]);
                    }
                    if let Some(filled) = &filled[gap] {
                        self.known.put(&gaps[gap], &filled.xyz);
                    }
                }
                let is_new = |gap: &&usize| filled[**gap].is_some();
                let new = FrameRanges::of(now.iter().filter(is_new).map(|g| &gaps[*g].frames));
                open.retain(|gap| filled[*gap].is_none());
                // What is filled is known to the gaps for which too little was: those at the same
                // frames are tried again, and, so often, those that learn from these frames.
                let learns = |gap: &usize| {
                    let frames = &gaps[*gap].frames;
                    let is_early = rounds[*gap] < MOST_ROUNDS;
                    new.meet(frames) || is_early && new.meet(&self.window(frames))
                };
                now = open.iter().copied().filter(learns).collect();
            }
        }
        self.refill(&mut filled, done);
        (filled, implausible)
    }

    /// Fills gaps once more beside which another one was filled later: the frames of that one now
    /// say what the regression misses at their ends, and how that changes.
    fn refill(&self, filled: &mut [Option<FilledGap>], done: &(dyn Fn(usize) + Sync)) {
        let length = |gap: &Gap| gap.frames.len().ilog(SAME_LENGTH);
        // The longest gap from each frame on, and up to each.
        let (mut from, mut until) = (HashMap::new(), HashMap::new());
        for gap in self.gaps {
            let longest: &mut u32 = from.entry(gap.frames.start).or_default();
            *longest = length(gap).max(*longest);
            let longest: &mut u32 = until.entry(gap.frames.end).or_default();
            *longest = length(gap).max(*longest);
        }
        let is_learned = |k: &usize| {
            let gap = &self.gaps[*k];
            let beside = [from.get(&gap.frames.end), until.get(&gap.frames.start)];
            let is_later = beside.into_iter().flatten().any(|l| *l > length(gap));
            is_later && (filled[*k].as_ref()).is_some_and(|f| f.method == FillMethod::Regression)
        };
        let again: Vec<usize> = (0..self.gaps.len()).filter(is_learned).collect();
        if again.len() > MANY_AGAIN {
            return;
        }
        for (gap, estimate) in self.fill_groups(&again, done) {
            if self.limits.allow(self.take.xyz, &self.gaps[gap], &estimate) {
                filled[gap] = Some(estimate);
            }
        }
    }

    /// A gap filled by its point's own path, if that is smooth enough.
    fn by_path(&self, gap: &Gap) -> Option<FilledGap> {
        path::interpolate(self.take.xyz, gap, self.take.rate, &self.known.paths)
    }

    /// Those of the gaps `open` that can be filled by what other points say; brief ones over time
    /// where there are too many.
    fn fill_groups(
        &self,
        open: &[usize],
        done: &(dyn Fn(usize) + Sync),
    ) -> Vec<(usize, FilledGap)> {
        let groups = groups(self.gaps, open.to_vec());
        let filled = parallel::map_chunks(groups.len(), 1, |range| {
            done(1);
            let (mut found, mut left) = (Vec::new(), Vec::new());
            for &k in &groups[range.start] {
                let gap = &self.gaps[k];
                let is_brief = self.gaps.len() > MANY_GAPS && gap.frames.len() < BRIEF;
                let path = is_brief.then(|| self.by_path(gap));
                match path.flatten() {
                    Some(filled) => found.push((k, filled)),
                    None => left.push(k),
                }
            }
            found.extend(self.fill_group(&left));
            found
        });
        filled.into_iter().flatten().collect()
    }

    /// Fills the gaps of one group by what other points say, together or else each alone, if
    /// enough is known.
    fn fill_group(&self, group: &[usize]) -> Vec<(usize, FilledGap)> {
        if let Some(filled) = self.regress(group) {
            return group.iter().copied().zip(filled).collect();
        }
        match group {
            [_, _, ..] => {
                let alone = |gap: &usize| self.fill_group(&[*gap]);
                group.iter().flat_map(alone).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Fills the gaps of one group by what other points say. `None` where too little is known.
    ///
    /// A model knows its own points. Where a table has more, these may say more than the model
    /// does, or all may stand elsewhere on the body, and where its poses are unlike the take's they
    /// may say nothing: then the gaps are also learned from the take alone, and the two weighed by
    /// their errors in simulated gaps.
    fn regress(&self, group: &[usize]) -> Option<Vec<FilledGap>> {
        let first = self.regress_on(group, self.others, self.take.names)?;
        let is_sure = !self.in_doubt || self.others.is_none();
        if is_sure && !first.leave_out {
            return Some(first.gaps);
        }
        // Nor is a pelvis by these names the best frame of reference.
        let Some(alone) = self.regress_on(group, None, &[]) else {
            return is_sure.then_some(first.gaps);
        };
        let both = first.gaps.into_iter().zip(alone.gaps);
        let errors = first.errors.iter().zip(&alone.errors);
        let mixed = both
            .zip(errors)
            .zip(group)
            .map(|(((first, alone), (e, f)), gap)| {
                let share = f * f / (MODEL_DOUBT * e * e + f * f);
                let share = if share.is_nan() { UNTRIED_SHARE } else { share };
                let all = [first.clone().mixed_with(&alone, share), alone, first];
                let allows = |f: &&FilledGap| self.limits.allow(self.take.xyz, &self.gaps[*gap], f);
                all.iter().find(allows).unwrap_or(&all[0]).clone()
            });
        Some(mixed.collect())
    }

    /// Fills the gaps of one group by what other points of the take and the poses of `others` say,
    /// in the frame of reference of the pelvis, if `names` have one.
    /// `None` where too little is known.
    fn regress_on(
        &self,
        group: &[usize],
        others: Option<ArrayView2<'_, f64>>,
        names: &[String],
    ) -> Option<Regressed> {
        let (gaps, known) = (self.gaps, &self.known);
        let of = |k: &usize| &gaps[*k].frames;
        let start = group.iter().map(|k| of(k).start).min()?;
        let end = group.iter().map(|k| of(k).end).max()?;
        let targets: Vec<usize> = group.iter().map(|k| gaps[*k].point).collect();
        let around = self.window(&(start..end));
        let gap = start - around.start..end - around.start;
        let Predictors {
            points: predictors,
            frames,
            leave_out,
        } = predictors(known, others, &around, &targets, &(start..end))?;
        let mut xyz = CowArray::from(known.xyz.slice(s![around.clone(), ..]));
        let captured = self.take.xyz.slice(s![around.clone(), ..]);
        let anchor = anchor(names, xyz.view(), &predictors, &frames)?;
        let seconds = &known.seconds[around.clone()];
        let held = ends::hold(&mut xyz, seconds, &gap, &predictors, &targets);
        let own = LocalPoses::new(&anchor, xyz.view(), &predictors, &targets);
        let mut complete = vec![false; own.placements.len()];
        (frames.iter().chain(&held)).for_each(|&t| complete[t] = own.is_complete(t));
        let others = other_poses(others, &anchor, &predictors, &targets);
        let columns: Vec<usize> = targets.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let regression = Regression {
            own: &own,
            complete: &complete,
            seconds,
            rate: self.take.rate,
            others: others.as_ref(),
            noise: self.noise(&predictors, &(start..end)),
        };
        let found = weights::weigh(
            &Targets {
                regression: &regression,
                captured,
                columns: &columns,
            },
            &gap,
        )?;
        let estimated = Estimated {
            captured: self.take.xyz,
            own: &own,
            first: around.start,
            found: &found,
            frames: start..end,
        };
        let group = group.iter().enumerate();
        let filled = group.map(|(k, index)| estimated.filled(k, &gaps[*index]));
        Some(Regressed {
            gaps: filled.collect::<Option<_>>()?,
            errors: found.error,
            leave_out,
        })
    }

    /// The variance of a coordinate of `points` in some frames, cm².
    fn noise(&self, points: &[usize], frames: &Range<usize>) -> f64 {
        let Some(sd) = self.take.sd else { return 0.0 };
        let all = frames
            .clone()
            .flat_map(|t| points.iter().map(move |p| sd[[t, *p]].powi(2)));
        mean_of_finite(all).unwrap_or(0.0)
    }

    /// The frames around a gap that are learned from.
    fn window(&self, gap: &Range<usize>) -> Range<usize> {
        let reach = (WINDOW * self.take.rate).ceil() as usize;
        gap.start.saturating_sub(reach)..(gap.end + reach).min(self.take.xyz.nrows())
    }
}

/// The gaps of a group, filled by regression.
struct Regressed {
    gaps: Vec<FilledGap>,
    /// The mean squared error of a coordinate of each in simulated gaps, cm²; NaN where none was
    /// simulated.
    errors: Vec<f64>,
    /// Whether points that the model does not know were left out.
    leave_out: bool,
}

/// What regression estimated in the frames of a group of gaps.
struct Estimated<'a> {
    /// The take as it was captured (frames, 3 J), cm.
    captured: ArrayView2<'a, f64>,
    /// The poses from which was learned, and the first of their frames.
    own: &'a LocalPoses,
    first: usize,
    found: &'a Weighed,
    /// The frames of the group.
    frames: Range<usize>,
}

impl Estimated<'_> {
    /// Where the point of the k-th gap is in a frame.
    fn position(&self, k: usize, t: usize) -> Option<DVec3> {
        let [x, y, z] = [0, 1, 2].map(|c| self.found.mean[[t - self.frames.start, 3 * k + c]]);
        Some(self.own.placements[t - self.first]?.apply(DVec3::new(x, y, z)))
    }

    /// The k-th gap, filled. `None` where its position is not known.
    fn filled(&self, k: usize, gap: &Gap) -> Option<FilledGap> {
        let (frames, point) = (&gap.frames, gap.point);
        // Where the gap is shorter than the group, its own ends were estimated too.
        let error = |t: usize| {
            let seen = self.captured.slice(s![t, 3 * point..3 * point + 3]);
            let error = DVec3::new(seen[0], seen[1], seen[2]) - self.position(k, t)?;
            Some(error).filter(|e| e.is_finite())
        };
        let before = (frames.start > self.frames.start).then(|| error(frames.start - 1));
        let after = (frames.end < self.frames.end).then(|| error(frames.end));
        let [before, after] = [before, after].map(|e| e.flatten().unwrap_or_default());
        let mut xyz = Array2::zeros((frames.len(), 3));
        let mut variance = Vec::with_capacity(frames.len());
        for (i, t) in frames.clone().enumerate() {
            let share = (i + 1) as f64 / (frames.len() + 1) as f64;
            let position = self.position(k, t)? + before.lerp(after, share);
            (xyz[[i, 0]], xyz[[i, 1]], xyz[[i, 2]]) = (position.x, position.y, position.z);
            let columns = s![t - self.frames.start, 3 * k..3 * k + 3];
            variance.push(self.found.variance.slice(columns).mean()?);
        }
        if !xyz.iter().all(|v| v.is_finite()) {
            return None;
        }
        let method = if self.found.over_time[k] > MOSTLY {
            FillMethod::Interpolation
        } else {
            FillMethod::Regression
        };
        Some(FilledGap {
            xyz,
            variance,
            method,
            contacts: Vec::new(),
        })
    }
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

/// The gaps by length, shortest first: what is filled of one length is known to the next.
fn by_length(gaps: &[Gap]) -> Vec<Vec<usize>> {
    let mut lengths: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (k, gap) in gaps.iter().enumerate() {
        let length = gap.frames.len().ilog(SAME_LENGTH);
        lengths.entry(length).or_default().push(k);
    }
    lengths.into_values().collect()
}

/// The gaps `open`, those of about the same frames together.
fn groups(gaps: &[Gap], mut open: Vec<usize>) -> Vec<Vec<usize>> {
    open.sort_by_key(|k| (gaps[*k].frames.start, gaps[*k].frames.end));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    // The points of each group: a point has one gap in it.
    let mut points: HashSet<(usize, usize)> = HashSet::new();
    for k in open {
        let (frames, point) = (&gaps[k].frames, gaps[k].point);
        let slack = frames.len() / SAME_LENGTH;
        let is_alike = |(number, group): &(usize, &mut Vec<usize>)| {
            let first = &gaps[group[0]].frames;
            frames.start.abs_diff(first.start) <= slack
                && frames.end.abs_diff(first.end) <= slack
                && !points.contains(&(*number, point))
        };
        let mut last = groups.iter_mut().enumerate().rev().take(64);
        let number = match last.find(is_alike) {
            Some((number, group)) => {
                group.push(k);
                number
            }
            None => {
                groups.push(vec![k]);
                groups.len() - 1
            }
        };
        points.insert((number, point));
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::find_gaps;

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
        let take = Take {
            names: &names,
            xyz: captured.view(),
            runs: std::slice::from_ref(&run),
            rate: 120.0,
            sd: None,
            motion: Default::default(),
        };
        let gaps = find_gaps(captured.view(), std::slice::from_ref(&run));
        assert!(gaps.len() > 3000);
        let (filled, _) =
            GapFiller::new(&take, &gaps, None, false).fill(&vec![None; gaps.len()], &|_| {});
        for (gap, filled) in gaps.iter().zip(&filled) {
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
        let filler = GapFiller::new(&take, &gaps, None, false);
        gaps.iter().for_each(|gap| {
            filler.by_path(gap);
        });
        assert_eq!(filler.known.paths.len(), points);
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
        let take = Take {
            names: &names,
            xyz: captured.view(),
            runs: std::slice::from_ref(&run),
            rate: 100.0,
            sd: None,
            motion: Default::default(),
        };
        let gaps = find_gaps(captured.view(), std::slice::from_ref(&run));
        let (filled, _) =
            GapFiller::new(&take, &gaps, None, false).fill(&vec![None; gaps.len()], &|_| ());
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
