//! Gaps laid into takes on purpose: some points unseen for a while.

use super::corruption::Stream;
use crate::pose::Poses;
use crate::{Error, Result};
use ndarray::ArrayView2;
use rand::Rng;
use std::ops::Range;

/// What gaps every take is to have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gaps {
    /// How many, at least 1.
    pub count: usize,
    /// How many consecutive frames each, at least 1.
    pub frames: usize,
    /// In how many points each, at least 1.
    pub points: usize,
    /// Where randomness starts.
    pub seed: u64,
}

/// A gap: these points are unseen in these frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gap {
    /// Consecutive frames of one run.
    pub frames: Range<usize>,
    /// The points' indices, ascending.
    pub points: Vec<usize>,
}

/// The gaps of one take.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Laid {
    /// The take's frames.
    pub take: Range<usize>,
    /// Its gaps; fewer than asked for where no more fit.
    pub gaps: Vec<Gap>,
    /// The length of its longest run; below the gaps' length, none can be laid.
    pub longest: usize,
}

/// How many frames last `seconds` at `rate` frames a second: the nearest whole number.
///
/// # Errors
/// [`Error::Usage`] when that is none.
pub fn frames_in(seconds: f64, rate: f64) -> Result<usize> {
    let frames = (seconds * rate).round();
    if !(frames >= 1.0) {
        return Err(Error::usage(format!(
            "--length {seconds} is less than half a frame at {rate} frames a second"
        )));
    }
    // Saturates; a gap longer than any take is told later.
    Ok(frames as usize)
}

impl Gaps {
    /// Lays the gaps of every take (of the whole table where it names no takes).
    ///
    /// A gap lies within one run and hides points that are observed throughout, in all its frames and in the frame before
    /// and after it; so two gaps of a point never touch, each is as long as asked for, and the first and last frame of
    /// a run stay as they are. Only where no run of a take is longer than the gap by two frames may a gap reach the
    /// run's ends. Among the places left, each is equally likely.
    ///
    /// # Errors
    /// [`Error::Usage`] when a number is 0, or there are fewer points than a gap is to have.
    pub fn lay(&self, poses: &Poses) -> Result<Vec<Laid>> {
        let points = poses.points.len();
        if self.count == 0 || self.frames == 0 {
            return Err(Error::usage("--gaps and --length: expected at least one"));
        }
        if self.points == 0 || self.points > points {
            let asked = self.points;
            return Err(Error::usage(format!(
                "--points {asked}: expected 1 to {points} (the table's points)"
            )));
        }
        let runs = poses.runs();
        let mut rest = &runs[..];
        let takes = poses.takes().into_iter().enumerate();
        let laid = takes.map(|(index, take)| {
            // A run ends where its take does, so each take has its own stretch of the runs.
            let own = rest.partition_point(|r| r.end <= take.end);
            let (runs, others) = rest.split_at(own);
            rest = others;
            let mut random = Stream::Gaps.generator(self.seed, index as u64);
            Laid {
                gaps: self.lay_one(poses.xyz.view(), &take, runs, &mut random),
                longest: runs.iter().map(Range::len).max().unwrap_or(0),
                take,
            }
        });
        Ok(laid.collect())
    }

    fn lay_one(
        &self,
        xyz: ArrayView2<'_, f64>,
        take: &Range<usize>,
        runs: &[Range<usize>],
        random: &mut impl Rng,
    ) -> Vec<Gap> {
        let mut room = Room::new(self, xyz, take, runs);
        let mut gaps = Vec::new();
        while gaps.len() < self.count && !room.open.is_empty() {
            let start = room.open[random.random_range(0..room.open.len())];
            let free = room.free_points(start);
            let mut points = rand::seq::index::sample(random, free.len(), self.points)
                .into_iter()
                .map(|i| free[i])
                .collect::<Vec<_>>();
            points.sort_unstable();
            room.occupy(start, &points);
            let first = take.start + start;
            gaps.push(Gap {
                frames: first..first + self.frames,
                points,
            });
        }
        gaps
    }
}

/// Where in a take a gap may still start. Frames count from the take's first.
struct Room {
    /// Length of a gap in frames, and how many points it needs.
    frames: usize,
    needed: usize,
    points: usize,
    /// (frames, points): whether a gap of this point may start here.
    free: Vec<bool>,
    /// How many points are free at a start.
    left: Vec<usize>,
    /// The starts at which enough points are free.
    open: Vec<usize>,
    /// Where in `open` a start stands.
    slot: Vec<Option<usize>>,
}

impl Room {
    fn new(
        gaps: &Gaps,
        xyz: ArrayView2<'_, f64>,
        take: &Range<usize>,
        runs: &[Range<usize>],
    ) -> Room {
        let points = xyz.ncols() / 3;
        let mut room = Room {
            frames: gaps.frames,
            needed: gaps.points,
            points,
            free: Vec::new(),
            left: Vec::new(),
            open: Vec::new(),
            slot: Vec::new(),
        };
        if runs.iter().all(|r| r.len() < gaps.frames) {
            return room;
        }
        room.free = vec![false; take.len() * points];
        room.left = vec![0; take.len()];
        room.slot = vec![None; take.len()];
        let margin = usize::from(runs.iter().any(|r| r.len() - 1 > gaps.frames));
        for run in runs.iter().filter(|r| r.len() >= gaps.frames + 2 * margin) {
            for point in 0..points {
                room.free_in_run(xyz, take.start, run, margin, point);
            }
        }
        for start in 0..take.len() {
            if room.left[start] >= room.needed {
                room.slot[start] = Some(room.open.len());
                room.open.push(start);
            }
        }
        room
    }

    /// Frees the starts of a run from which a point is seen throughout, with `margin` frames on both sides.
    fn free_in_run(
        &mut self,
        xyz: ArrayView2<'_, f64>,
        first: usize,
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
                let start = frame + 1 - window + margin - first;
                self.free[start * self.points + point] = true;
                self.left[start] += 1;
            }
        }
    }

    fn free_points(&self, start: usize) -> Vec<usize> {
        let row = &self.free[start * self.points..][..self.points];
        (0..self.points).filter(|&p| row[p]).collect()
    }

    /// Closes every start from which a gap of these points would overlap or touch the one at `start`.
    fn occupy(&mut self, start: usize, points: &[usize]) {
        let last = (start + self.frames).min(self.left.len() - 1);
        for near in start.saturating_sub(self.frames)..=last {
            for &point in points {
                let free = &mut self.free[near * self.points + point];
                if std::mem::take(free) {
                    self.left[near] -= 1;
                }
            }
            if self.left[near] < self.needed {
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
    use std::sync::Arc;

    fn poses(frames: usize, points: usize) -> Poses {
        Poses {
            points: (0..points).map(|i| format!("p{i}")).collect(),
            xyz: Array2::zeros((frames, 3 * points)),
            time: None,
            take: None,
        }
    }

    fn gaps(count: usize, frames: usize, points: usize) -> Gaps {
        Gaps {
            count,
            frames,
            points,
            seed: 1,
        }
    }

    /// Lengths of the stretches in which a point is missing.
    fn stretches(poses: &Poses, laid: &[Laid]) -> Vec<usize> {
        let mut missing = Array2::from_elem((poses.frames(), poses.points.len()), false);
        for gap in laid.iter().flat_map(|l| &l.gaps) {
            for f in gap.frames.clone() {
                for &p in &gap.points {
                    assert!(!std::mem::replace(&mut missing[[f, p]], true), "overlap");
                }
            }
        }
        let mut found = Vec::new();
        for column in missing.columns() {
            let column = column.to_vec();
            found.extend(column.split(|m| !m).map(<[bool]>::len).filter(|l| *l > 0));
        }
        found
    }

    proptest! {
        #[test]
        fn gaps_have_their_number_length_and_points(
            count in 1usize..6, frames in 1usize..12, points in 1usize..5, seed in 0u64..1000
        ) {
            let poses = poses(150, 9);
            let what = Gaps { count, frames, points, seed };
            let laid = what.lay(&poses).unwrap();
            prop_assert_eq!(&what.lay(&poses).unwrap(), &laid);
            prop_assert_eq!(laid.len(), 1);
            prop_assert_eq!(laid[0].gaps.len(), count);
            for gap in &laid[0].gaps {
                prop_assert!(gap.frames.start >= 1 && gap.frames.end <= 149);
                prop_assert_eq!(gap.frames.len(), frames);
                prop_assert_eq!(gap.points.len(), points);
                prop_assert!(gap.points.windows(2).all(|w| w[0] < w[1]));
            }
            // Two gaps of a point never touch, so every stretch is one gap.
            prop_assert_eq!(stretches(&poses, &laid), vec![frames; count * points]);
        }
    }

    #[test]
    fn every_take_has_its_gaps_and_none_crosses_a_run() {
        let mut poses = poses(60, 2);
        poses.take = Some(
            (0..60)
                .map(|i| Arc::from(if i < 40 { "a" } else { "b" }))
                .collect(),
        );
        // The first take is broken after 15 frames.
        let time = |i: usize| i as f64 / 10.0 + if (15..40).contains(&i) { 9.0 } else { 0.0 };
        poses.time = Some((0..60).map(time).collect());
        for seed in 0..50 {
            let laid = Gaps {
                seed,
                ..gaps(2, 6, 1)
            }
            .lay(&poses)
            .unwrap();
            assert_eq!(
                laid.iter().map(|l| l.gaps.len()).collect::<Vec<_>>(),
                [2, 2]
            );
            assert_eq!(laid[0].longest, 25);
            for gap in laid.iter().flat_map(|l| &l.gaps) {
                let inside = |r: Range<usize>| gap.frames.start > r.start && gap.frames.end < r.end;
                assert!(inside(0..15) || inside(15..40) || inside(40..60), "{gap:?}");
            }
        }
    }

    #[test]
    fn every_place_is_as_likely() {
        let poses = poses(12, 2);
        let mut starts = [0; 12];
        for seed in 0..8000 {
            let laid = Gaps {
                seed,
                ..gaps(1, 3, 1)
            }
            .lay(&poses)
            .unwrap();
            starts[laid[0].gaps[0].frames.start] += 1;
        }
        assert!(starts[0] == 0 && starts[9..] == [0; 3]);
        for s in &starts[1..9] {
            assert!((f64::from(*s) - 1000.0).abs() <= 6.0 * 30.0, "{starts:?}");
        }
    }

    #[test]
    fn short_takes_have_gaps_at_their_ends_or_none() {
        let fits = |n: usize| gaps(1, 5, 1).lay(&poses(n, 1)).unwrap().remove(0);
        assert!(fits(4).gaps.is_empty() && fits(4).longest == 4);
        assert_eq!(fits(5).gaps[0].frames, 0..5);
        assert_eq!(fits(6).gaps.len(), 1);
        assert_eq!(fits(7).gaps[0].frames, 1..6);
        assert!(gaps(1, 5, 1).lay(&poses(0, 1)).unwrap().is_empty());
        assert!(
            gaps(1, usize::MAX, 1).lay(&poses(9, 1)).unwrap()[0]
                .gaps
                .is_empty()
        );
    }

    #[test]
    fn what_is_missing_already_is_no_place_for_a_gap() {
        let mut poses = poses(30, 2);
        poses.xyz.column_mut(4).fill(f64::NAN);
        poses.xyz[[10, 0]] = f64::NAN;
        for seed in 0..100 {
            let laid = Gaps {
                seed,
                ..gaps(1, 5, 1)
            }
            .lay(&poses)
            .unwrap();
            let gap = &laid[0].gaps[0];
            assert_eq!(gap.points, [0]);
            assert!(gap.frames.end < 10 || gap.frames.start > 11, "{gap:?}");
        }
        // No two points are observed at once: no gap of two.
        assert!(gaps(1, 5, 2).lay(&poses).unwrap()[0].gaps.is_empty());
    }

    #[test]
    fn a_full_take_has_as_many_gaps_as_fit() {
        // Gaps of one frame and their neighbours fill at most every other frame.
        let laid = gaps(1000, 1, 1).lay(&poses(21, 1)).unwrap();
        assert!((5..=10).contains(&laid[0].gaps.len()));
        assert!(stretches(&poses(21, 1), &laid).iter().all(|l| *l == 1));
    }

    #[test]
    fn limits_are_named() {
        let says = |g: Gaps, part: &str| {
            let e = g.lay(&poses(9, 3)).unwrap_err();
            assert!(e.to_string().contains(part) && e.exit_code() == 2, "{e}");
        };
        says(gaps(0, 1, 1), "--gaps");
        says(gaps(1, 1, 0), "--points 0: expected 1 to 3");
        says(gaps(1, 1, 4), "--points 4: expected 1 to 3");
        assert_eq!(frames_in(0.4, 120.0).unwrap(), 48);
        for bad in [0.0, 0.001, f64::NAN] {
            assert!(
                frames_in(bad, 120.0)
                    .unwrap_err()
                    .to_string()
                    .contains("--length")
            );
        }
    }
}
