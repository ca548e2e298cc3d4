//! Segments of takes, drawn at random, with a gap in each.

use super::TestTakes;
use crate::damage::gaps::Gap;
use ndarray::Array2;
use rand::Rng;
use rand::seq::index::sample;
use std::ops::Range;

/// Seconds of a segment, at most.
const SECONDS: f64 = 12.5;
/// Seconds that are left on either side of a gap, at least.
const MARGIN: f64 = 0.2;
/// Draws until a gap fits.
const TRIES: usize = 200;

/// Frames of a take.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    /// The index of the take.
    pub take: usize,
    /// Its frames, all of one run.
    pub frames: Range<usize>,
}

/// A segment with a gap.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SegmentWithGap {
    pub segment: Segment,
    /// The gap, whose frames are counted in the segment.
    pub gap: Gap,
}

/// Draws a segment in which `points` random points are seen during a gap of `seconds` and right
/// beside it, or, `to_the_end`, until the segment ends. `None` where none is found.
pub(super) fn draw(
    takes: &TestTakes,
    seconds: f64,
    points: usize,
    to_the_end: bool,
    random: &mut impl Rng,
) -> Option<SegmentWithGap> {
    (0..TRIES).find_map(|_| {
        let take = random.random_range(0..takes.takes.len());
        let (poses, rate) = (&takes.takes[take].poses, takes.takes[take].rate);
        let frames = |seconds: f64| (seconds * rate).round().max(1.0) as usize;
        let (length, margin) = (frames(seconds), frames(MARGIN).max(2));
        let runs: Vec<Range<usize>> = poses.runs();
        let run = &runs[random.random_range(0..runs.len())];
        if run.len() < length + 2 * margin {
            return None;
        }
        let most = frames(SECONDS).max(length + 2 * margin).min(run.len());
        let start = run.start + random.random_range(0..=run.len() - most);
        let first = if to_the_end {
            most - length
        } else {
            random.random_range(margin..=most - margin - length)
        };
        let gap = first..first + length;
        let beside = start + gap.start - 1..(start + gap.end + 1).min(start + most);
        let is_seen = |point: &usize| {
            let columns = 3 * point..3 * point + 3;
            let cells = poses.xyz.slice(ndarray::s![beside.clone(), columns]);
            cells.iter().all(|v| v.is_finite())
        };
        let seen: Vec<usize> = (0..poses.points.len()).filter(is_seen).collect();
        if seen.len() < points {
            return None;
        }
        let mut points: Vec<usize> = sample(random, seen.len(), points)
            .into_iter()
            .map(|k| seen[k])
            .collect();
        points.sort_unstable();
        Some(SegmentWithGap {
            segment: Segment {
                take,
                frames: start..start + most,
            },
            gap: Gap {
                frames: gap,
                points,
            },
        })
    })
}

/// The longest run of a take, or a random part of it.
pub(super) fn of_take(takes: &TestTakes, take: usize, random: &mut impl Rng) -> Option<Segment> {
    let runs = takes.takes[take].poses.runs();
    let run = runs.into_iter().max_by_key(|run| run.len())?;
    let most = ((SECONDS * takes.takes[take].rate) as usize).min(run.len());
    let start = run.start + random.random_range(0..=run.len() - most);
    Some(Segment {
        take,
        frames: start..start + most,
    })
}

impl Segment {
    /// Its frames (n, 3 J), cm; NaN missing.
    pub(crate) fn xyz(&self, takes: &TestTakes) -> Array2<f64> {
        let poses = &takes.takes[self.take].poses;
        poses
            .xyz
            .slice(ndarray::s![self.frames.clone(), ..])
            .to_owned()
    }
}
