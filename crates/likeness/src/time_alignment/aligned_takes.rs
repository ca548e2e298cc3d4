//! Two takes, and one on the frames of the other.

use super::{TimeAlignment, TimeAlignmentOptions, align, shared_points};
use crate::numeric::anti_alias::AntiAlias;
use crate::pose::{BonePoints, NameMap, Poses, Retiming};
use crate::{Error, Result};

/// A take with times, and how another lies beside it.
pub struct AlignedTakes<'a> {
    /// The take whose frames and clock count.
    pub first: &'a Poses,
    /// The take that is laid beside it.
    pub second: &'a Poses,
    /// How many points they share.
    pub shared: usize,
    /// The best place of the second, whether it is clear or not; `None` where nothing can be
    /// compared.
    pub found: Option<TimeAlignment>,
}

/// The frames of the first take, by the clock of the second.
pub struct FramesInSecond<'a> {
    takes: &'a AlignedTakes<'a>,
    /// Times of the first, and the same by the clock of the second.
    times: &'a [f64],
    in_second: Vec<f64>,
    /// Frames of the first in a second of the other's clock.
    rate: f64,
}

/// The poses of one take with times that rise: those they have, else by their rate.
///
/// # Errors
/// [`Error::Unfit`]: several takes, fewer than two frames, or no such times.
pub fn timed(poses: &Poses, rate: Option<f64>) -> Result<Poses> {
    if poses.takes().len() > 1 {
        return Err(Error::unfit(
            "has several takes; choose one with `posing trim`",
        ));
    }
    if poses.frames() < 2 {
        return Err(Error::unfit("has too few frames to be laid beside another"));
    }
    let time = poses.times(rate);
    let time = time.ok_or_else(|| Error::unfit("has no times; give the option `fps F`"))?;
    if time.windows(2).any(|pair| pair[1] <= pair[0]) {
        return Err(Error::unfit("has times that do not rise"));
    }
    Ok(Poses {
        time: Some(time),
        ..poses.clone()
    })
}

/// Times are equal that differ by less than this share of a frame.
const EQUAL: f64 = 1e-4;

impl<'a> AlignedTakes<'a> {
    /// How the take `second` lies beside the take `first`, both [`timed`]: by the points of one
    /// name, or that `map` names alike; else, where joints of one have the names of the bones that
    /// start there, and of the other of those that end there, by what ends there.
    ///
    /// # Errors
    /// Those of [`align`].
    pub fn new(
        first: &'a Poses,
        second: &'a Poses,
        map: Option<&NameMap>,
        options: &TimeAlignmentOptions,
    ) -> Result<AlignedTakes<'a>> {
        let takes = [first, second];
        let by_names = |names: [&[String]; 2]| -> Result<AlignedTakes<'a>> {
            let shared = shared_points(names[0], names[1], map);
            Ok(AlignedTakes {
                first,
                second,
                shared: shared.len(),
                found: align(first, second, &shared, options)?,
            })
        };
        let own = by_names(takes.map(|poses| &poses.points[..]))?;
        let stand = takes.map(|poses| BonePoints::of(&poses.points, poses.xyz.view()));
        if own.clear().is_some() || stand[0] == stand[1] {
            return Ok(own);
        }
        let ends = [0, 1].map(|i| stand[i].bone_ends(&takes[i].points));
        let by_ends = by_names([&ends[0], &ends[1]])?;
        Ok(if by_ends.clear().is_some() {
            by_ends
        } else {
            own
        })
    }

    /// How the second lies beside the first, where that is clear.
    pub fn clear(&self) -> Option<TimeAlignment> {
        self.found.filter(|found| found.is_clear)
    }

    /// The frames of the first, where the second has them by `found`.
    pub fn frames(&'a self, found: &TimeAlignment) -> FramesInSecond<'a> {
        let times = times(self.first);
        let starts = [times, self::times(self.second)].map(|t| t.first().copied().unwrap_or(0.0));
        let in_second = |t: &f64| starts[1] + found.in_b(t - starts[0]);
        FramesInSecond {
            takes: self,
            times,
            in_second: times.iter().map(in_second).collect(),
            rate: rate(self.first) * (1.0 + found.drift),
        }
    }
}

impl FramesInSecond<'_> {
    /// The time of the first of them.
    pub fn start(&self) -> f64 {
        self.times.first().copied().unwrap_or(0.0)
    }

    /// Whether they are those of the second as they stand, to a ten thousandth of a frame.
    pub fn are_own(&self) -> bool {
        let own = times(self.takes.second);
        let near = EQUAL / rate(self.takes.second);
        let is_near = |others: &[f64]| own.iter().zip(others).all(|(x, y)| (x - y).abs() < near);
        own.len() == self.times.len() && is_near(&self.in_second) && is_near(self.times)
    }

    /// The second on these frames: positions interpolated between measured neighbors, missing where
    /// it has none; with the times of the first.
    ///
    /// # Errors
    /// None for takes that were laid beside one another.
    pub fn poses(&self) -> Result<Poses> {
        let second = self.takes.second;
        let take = second.take.as_ref().and_then(|take| take.first().cloned());
        Ok(Poses {
            points: second.points.clone(),
            xyz: second.at_times(&self.in_second, self.rate)?,
            time: Some(self.times.to_vec()),
            take: take.map(|take| vec![take; self.times.len()]),
        })
    }

    /// Where they are, counted in frames of the second, for its rotations.
    pub fn retiming(&self) -> Retiming {
        let (own, rate) = (times(self.takes.second), rate(self.takes.second));
        let first = own.first().copied().unwrap_or(0.0);
        Retiming {
            at: self.in_second.iter().map(|t| (t - first) * rate).collect(),
            low_pass: None,
            anti_alias: AntiAlias::new(self.rate / rate),
        }
    }
}

fn times(poses: &Poses) -> &[f64] {
    poses.time.as_deref().unwrap_or_default()
}

fn rate(poses: &Poses) -> f64 {
    poses.rate().unwrap_or(1.0)
}
