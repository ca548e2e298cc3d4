//! How fast the other points are while one lies still.

use super::Take;
use crate::numeric::statistics::median;
use std::cell::RefCell;
use std::collections::HashMap;
use std::ops::Range;

/// Points that are measured, at most: evenly chosen.
const MOST: usize = 500;

/// The points' speeds (cm a frame, in the median), in order.
type Speeds = Vec<(f64, usize)>;

/// The speeds of points in ranges of frames, each range measured once.
pub(crate) struct OtherSpeeds<'a, 't> {
    take: &'a Take<'t>,
    known: RefCell<HashMap<Range<usize>, Speeds>>,
}

impl<'a, 't> OtherSpeeds<'a, 't> {
    pub(crate) fn of(take: &'a Take<'t>) -> OtherSpeeds<'a, 't> {
        OtherSpeeds {
            take,
            known: RefCell::default(),
        }
    }

    /// The speed of the points but `point` from the first to the last frame, in the median, cm/s.
    pub(crate) fn median(&self, frames: Range<usize>, point: usize, rate: f64) -> f64 {
        let mut known = self.known.borrow_mut();
        let key = frames.clone();
        let all = known.entry(key).or_insert_with(|| self.measure(frames));
        let others = all.iter().filter(|(_, p)| *p != point);
        let count = all.len() - usize::from(all.iter().any(|(_, p)| *p == point));
        let middle = others.map(|(step, _)| step * rate).nth(count / 2);
        middle.unwrap_or(0.0)
    }

    fn measure(&self, frames: Range<usize>) -> Speeds {
        let step = |p: usize| {
            let steps = frames.clone().zip(frames.clone().skip(1));
            let steps = steps.filter_map(|(t, next)| {
                Some((self.take.at(next, p)? - self.take.at(t, p)?).length())
            });
            Some((median(steps.collect())?, p))
        };
        let points = self.take.points.len();
        let every = points.div_ceil(MOST).max(1);
        let mut all: Speeds = (0..points).step_by(every).filter_map(step).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    }
}
