//! Injects gaps into takes: some points are missing for some time.

use super::noise::Stream;
use crate::pose::Poses;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, s};
use rand::Rng;
use std::ops::Range;

/// A gap: these points are missing in these frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Gap {
    /// Consecutive frames of one run.
    pub frames: Range<usize>,
    /// The points' indices, ascending.
    pub points: Vec<usize>,
}

impl Gap {
    /// The columns of the points' coordinates.
    pub(crate) fn columns(&self) -> Vec<usize> {
        self.points.iter().flat_map(|p| 3 * p..3 * p + 3).collect()
    }

    /// Makes the points missing in the frames of a take (frames, 3 J).
    pub(crate) fn hide(&self, xyz: &mut Array2<f64>) {
        for column in self.columns() {
            xyz.slice_mut(s![self.frames.clone(), column])
                .fill(f64::NAN);
        }
    }
}

/// The gaps of a take.
#[derive(Debug, Clone, PartialEq, Eq)]
struct InjectedGaps {
    /// The gaps; fewer than asked for if no more fit.
    gaps: Vec<Gap>,
    /// The frames of the take's longest run. No gap fits if it is shorter than a gap.
    longest: usize,
}

/// How many frames last `seconds` at `rate` frames a second: the nearest whole number.
///
/// # Errors
/// [`Error::Usage`] when that is none.
fn frames_in(seconds: f64, rate: f64) -> Result<usize> {
    let frames = (seconds * rate).round();
    if frames.is_nan() || frames < 1.0 {
        return Err(Error::usage(format!(
            "the option `length {seconds}` is less than half a frame at {rate} frames a second"
        )));
    }
    // The cast saturates; a gap longer than any take is reported later.
    Ok(frames as usize)
}

/// Gaps of a length in time, in each take of a table.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_score::damage::GapInjection;
///
/// let (points, xyz) = (vec!["knee".into()], ndarray::Array2::zeros((200, 3)));
/// let mut poses = Poses { points, xyz, ..Poses::default() };
/// let gaps = GapInjection { count: 2, seconds: 0.1, points: 1, seed: 7 };
/// gaps.inject(&mut poses, &[Some(100.0)], "walk.csv", &mut |_| ())?;
/// assert_eq!(poses.xyz.column(0).iter().filter(|x| x.is_nan()).count(), 20);
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct GapInjection {
    /// The number of gaps in each take, at least 1.
    pub count: usize,
    /// The length of a gap, seconds.
    pub seconds: f64,
    /// Points of a gap, at least 1.
    pub points: usize,
    /// The seed.
    pub seed: u64,
}

impl GapInjection {
    /// Injects the gaps into each take; `rates` are the takes' frames a second. Calls `skipped`
    /// with each take that gets no gap, and why.
    ///
    /// # Errors
    /// [`Error::Usage`] if a number is 0 or a take has fewer points than a gap; [`Error::Data`] if
    /// the gaps of a take do not fit, or no take is as long as a gap.
    pub fn inject(
        &self,
        poses: &mut Poses,
        rates: &[Option<f64>],
        table: &str,
        skipped: &mut dyn FnMut(&str),
    ) -> Result<()> {
        let fail = |what: String| Err(Error::data(Place::file(table), what));
        let (takes, mut with_gaps) = (poses.takes(), 0);
        for (index, (range, rate)) in takes.iter().zip(rates).enumerate() {
            let name = poses.take.as_ref().map(|names| &names[range.start]);
            let name = name.map_or("the table".into(), |name| format!("take \"{name}\""));
            let Some(rate) = rate else {
                skipped(&format!("{name} gets no gap: its times give no frame rate"));
                continue;
            };
            let frames = frames_in(self.seconds, *rate)?;
            let mut take = poses.slice(range.clone());
            let injected = self.inject_take(&mut take, frames, index as u64)?;
            let (fit, longest) = (injected.gaps.len(), injected.longest);
            if longest < frames {
                skipped(&format!(
                    "{name} gets no gap: its longest run has {longest} frames, a gap has {frames}"
                ));
                continue;
            }
            if fit < self.count {
                return fail(format!(
                    "{name}: only {fit} of {} gaps of {frames} frames in {} points fit; use fewer \
                     gaps, a shorter length or fewer points",
                    self.count, self.points
                ));
            }
            poses.xyz.slice_mut(s![range.clone(), ..]).assign(&take.xyz);
            with_gaps += 1;
        }
        if with_gaps == 0 && !takes.is_empty() {
            fail("no take is as long as a gap; use a shorter length".into())
        } else {
            Ok(())
        }
    }

    /// Injects gaps of `frames` consecutive frames into take number `index`: coordinates in a gap
    /// become NaN.
    ///
    /// A gap lies within one run. Its points are observed in all its frames and in the frames
    /// before and after, so that two gaps of a point never touch and the first and last frame
    /// of a run keep their values. Only if no run is longer than a gap by two frames may a gap
    /// reach the ends of a run. All starts left are equally likely. Time and memory are linear in
    /// the size of the take.
    fn inject_take(&self, take: &mut Poses, frames: usize, index: u64) -> Result<InjectedGaps> {
        let (asked, points) = (self.points, take.points.len());
        if self.count == 0 || frames == 0 {
            return Err(Error::usage(
                "the option `gaps` and the option `length`: expected at least one",
            ));
        }
        if asked == 0 || asked > points {
            return Err(Error::usage(format!(
                "the option `points {asked}`: expected 1 to {points} (the table's points)"
            )));
        }
        let runs = take.runs();
        let mut random = Stream::Gaps.generator(self.seed, index);
        let gaps = self.choose(take.xyz.view(), &runs, frames, &mut random);
        gaps.iter().for_each(|gap| gap.hide(&mut take.xyz));
        let longest = runs.iter().map(Range::len).max().unwrap_or(0);
        Ok(InjectedGaps { gaps, longest })
    }

    fn choose(
        &self,
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        frames: usize,
        random: &mut impl Rng,
    ) -> Vec<Gap> {
        let mut starts = FreeStarts::new(xyz, runs, frames, self.points);
        let mut gaps = Vec::new();
        while gaps.len() < self.count && !starts.open.is_empty() {
            let start = starts.open[random.random_range(0..starts.open.len())];
            let free = starts.free_points(start);
            let mut points = rand::seq::index::sample(random, free.len(), self.points)
                .into_iter()
                .map(|i| free[i])
                .collect::<Vec<_>>();
            points.sort_unstable();
            starts.occupy(start, &points);
            gaps.push(Gap {
                frames: start..start + frames,
                points,
            });
        }
        gaps
    }
}

/// The frames at which a gap can still start.
struct FreeStarts {
    /// Frames and points of a gap.
    frames: usize,
    needed: usize,
    points: usize,
    /// (frames, points): whether a gap of this point may start here.
    free: Vec<bool>,
    /// The starts at which enough points are free.
    open: Vec<usize>,
    /// The index of each start in `open`.
    slot: Vec<Option<usize>>,
}

impl FreeStarts {
    /// For gaps of `length` frames in `needed` points.
    fn new(
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        length: usize,
        needed: usize,
    ) -> FreeStarts {
        let (frames, points) = (xyz.nrows(), xyz.ncols() / 3);
        let mut starts = FreeStarts {
            frames: length,
            needed,
            points,
            free: Vec::new(),
            open: Vec::new(),
            slot: Vec::new(),
        };
        if runs.iter().all(|r| r.len() < length) {
            return starts;
        }
        starts.free = vec![false; frames * points];
        starts.slot = vec![None; frames];
        let margin = usize::from(runs.iter().any(|r| r.len() - 1 > length));
        for run in runs.iter().filter(|r| r.len() >= length + 2 * margin) {
            for point in 0..points {
                starts.free_in_run(xyz, run, margin, point);
            }
        }
        for start in 0..frames {
            if starts.free_points(start).len() >= needed {
                starts.slot[start] = Some(starts.open.len());
                starts.open.push(start);
            }
        }
        starts
    }

    /// Frees the starts of a run from which a point is observed throughout, with `margin` frames on
    /// both sides.
    fn free_in_run(
        &mut self,
        xyz: ArrayView2<'_, f64>,
        run: &Range<usize>,
        margin: usize,
        point: usize,
    ) {
        let window = self.frames + 2 * margin;
        let mut seen = 0;
        for frame in run.clone() {
            let observed = (0..3).all(|a| !xyz[[frame, 3 * point + a]].is_nan());
            seen = if observed { seen + 1 } else { 0 };
            if seen >= window {
                let start = frame + 1 - window + margin;
                self.free[start * self.points + point] = true;
            }
        }
    }

    fn free_points(&self, start: usize) -> Vec<usize> {
        let row = &self.free[start * self.points..][..self.points];
        (0..self.points).filter(|&p| row[p]).collect()
    }

    /// Closes every start from which a gap of these points would overlap or touch the one at
    /// `start`.
    fn occupy(&mut self, start: usize, points: &[usize]) {
        let last = (start + self.frames).min(self.slot.len() - 1);
        for near in start.saturating_sub(self.frames)..=last {
            for &point in points {
                self.free[near * self.points + point] = false;
            }
            if self.free_points(near).len() < self.needed {
                self.close(near);
            }
        }
    }

    fn close(&mut self, start: usize) {
        let Some(slot) = self.slot[start].take() else {
            return;
        };
        self.open.swap_remove(slot);
        if let Some(&moved) = self.open.get(slot) {
            self.slot[moved] = Some(slot);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use proptest::prelude::*;

    fn poses(frames: usize, points: usize) -> Poses {
        Poses {
            points: (0..points).map(|i| format!("p{i}")).collect(),
            xyz: Array2::zeros((frames, 3 * points)),
            time: None,
            take: None,
        }
    }

    fn seeded(seed: u64, gaps: GapInjection) -> GapInjection {
        GapInjection { seed, ..gaps }
    }

    /// Gaps at one frame a second.
    fn gaps(count: usize, frames: usize, points: usize) -> GapInjection {
        GapInjection {
            count,
            seconds: frames as f64,
            points,
            seed: 1,
        }
    }

    /// Injects into a copy.
    fn inject(what: &GapInjection, take: &Poses) -> (InjectedGaps, Poses) {
        let mut take = take.clone();
        (
            what.inject_take(&mut take, what.seconds as usize, 0)
                .unwrap(),
            take,
        )
    }

    /// Lengths of the runs in which a coordinate is missing.
    fn runs(take: &Poses) -> Vec<usize> {
        let mut found = Vec::new();
        for column in take.xyz.columns() {
            let column = column.to_vec();
            let runs = column.split(|v| !v.is_nan()).map(<[f64]>::len);
            found.extend(runs.filter(|l| *l > 0));
        }
        found
    }

    proptest! {
        #[test]
        fn gaps_have_their_number_length_and_points(
            count in 1usize..6, frames in 1usize..12, points in 1usize..5, seed in 0u64..1000
        ) {
            let whole = poses(150, 9);
            let what = seeded(seed, gaps(count, frames, points));
            let (laid, take) = inject(&what, &whole);
            prop_assert_eq!(&inject(&what, &whole).0, &laid);
            prop_assert_eq!(laid.gaps.len(), count);
            for gap in &laid.gaps {
                prop_assert!(gap.frames.start >= 1 && gap.frames.end <= 149);
                prop_assert_eq!(gap.frames.len(), frames);
                prop_assert_eq!(gap.points.len(), points);
                prop_assert!(gap.points.windows(2).all(|w| w[0] < w[1]));
            }
            // Two gaps of a point never touch, so every run is one gap.
            prop_assert_eq!(runs(&take), vec![frames; 3 * count * points]);
        }
    }

    #[test]
    fn each_take_has_different_gaps() {
        let what = gaps(2, 6, 1);
        let laid = |index| what.inject_take(&mut poses(60, 9), 6, index).unwrap().gaps;
        assert_eq!(laid(3), laid(3));
        assert_ne!(laid(3), laid(4));
    }

    #[test]
    fn no_gap_crosses_a_run() {
        let mut take = poses(40, 2);
        // Broken after 15 frames.
        let time = |i: usize| i as f64 / 10.0 + if i < 15 { 0.0 } else { 9.0 };
        take.time = Some((0..40).map(time).collect());
        for seed in 0..50 {
            let (laid, _) = inject(&seeded(seed, gaps(2, 6, 1)), &take);
            assert_eq!((laid.gaps.len(), laid.longest), (2, 25));
            for gap in &laid.gaps {
                let inside = |r: Range<usize>| gap.frames.start > r.start && gap.frames.end < r.end;
                assert!(inside(0..15) || inside(15..40), "{gap:?}");
            }
        }
    }

    #[test]
    fn all_starts_are_equally_likely() {
        let take = poses(12, 2);
        let mut starts = [0; 12];
        for seed in 0..8000 {
            let (laid, _) = inject(&seeded(seed, gaps(1, 3, 1)), &take);
            starts[laid.gaps[0].frames.start] += 1;
        }
        assert!(starts[0] == 0 && starts[9..] == [0; 3]);
        for s in &starts[1..9] {
            assert!((f64::from(*s) - 1000.0).abs() <= 6.0 * 30.0, "{starts:?}");
        }
    }

    #[test]
    fn short_takes_have_gaps_at_their_ends_or_none() {
        let fits = |n: usize| inject(&gaps(1, 5, 1), &poses(n, 1)).0;
        assert!(fits(0).gaps.is_empty() && fits(0).longest == 0);
        assert!(fits(4).gaps.is_empty() && fits(4).longest == 4);
        assert_eq!(fits(5).gaps[0].frames, 0..5);
        assert_eq!(fits(6).gaps.len(), 1);
        assert_eq!(fits(7).gaps[0].frames, 1..6);
        let endless = gaps(1, usize::MAX, 1);
        assert!(inject(&endless, &poses(9, 1)).0.gaps.is_empty());
    }

    #[test]
    fn no_gap_covers_missing_values() {
        let mut take = poses(30, 2);
        take.xyz.column_mut(4).fill(f64::NAN);
        take.xyz[[10, 0]] = f64::NAN;
        for seed in 0..100 {
            let (laid, _) = inject(&seeded(seed, gaps(1, 5, 1)), &take);
            let gap = &laid.gaps[0];
            assert_eq!(gap.points, [0]);
            assert!(gap.frames.end < 10 || gap.frames.start > 11, "{gap:?}");
        }
        // No two points are observed at once: no gap of two.
        assert!(inject(&gaps(1, 5, 2), &take).0.gaps.is_empty());
    }

    #[test]
    fn too_many_gaps_are_cut_to_those_that_fit() {
        // Gaps of one frame and their neighbors fill at most every other frame.
        let (laid, take) = inject(&gaps(1000, 1, 1), &poses(21, 1));
        assert!((5..=10).contains(&laid.gaps.len()));
        assert!(runs(&take).iter().all(|l| *l == 1));
    }

    #[test]
    fn limits_are_named() {
        let says = |g: GapInjection, part: &str| {
            let e = g.inject_take(&mut poses(9, 3), 1, 0).unwrap_err();
            assert!(e.to_string().contains(part) && e.exit_code() == 2, "{e}");
        };
        says(gaps(0, 1, 1), "the option `gaps`");
        says(gaps(1, 1, 0), "the option `points 0`: expected 1 to 3");
        says(gaps(1, 1, 4), "the option `points 4`: expected 1 to 3");
        assert_eq!(frames_in(0.4, 120.0).unwrap(), 48);
        for bad in [0.0, 0.001, f64::NAN] {
            let e = frames_in(bad, 120.0).unwrap_err().to_string();
            assert!(e.contains("the option `length "));
        }
    }
}
