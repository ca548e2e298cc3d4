//! Contacts of a foot with a level floor.

use super::report::Contact;
use super::stance::{reach, speed, stances};
use super::tuning::*;
use crate::numeric::statistics::median;
use crate::pose::ranges;
use glam::DVec3;
use std::ops::Range;

/// The contacts of a point that is on a level floor, and their middles.
pub(super) struct Contacts {
    points: Vec<DVec3>,
    /// The frames of each: all, from setting down to lifting.
    whole: Vec<Range<usize>>,
    /// And those in which the foot neither sets down nor lifts.
    pub frames: Vec<Range<usize>>,
    middles: Vec<DVec3>,
}

/// Ranges in rising order, those with at most `gap` frames between them as one: no foot is set
/// elsewhere in so short a time, and noise looks like it.
fn joined(ranges: impl Iterator<Item = Range<usize>>, gap: f64) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for range in ranges {
        match out.last_mut() {
            Some(last) if (range.start - last.end) as f64 <= gap => last.end = range.end,
            _ => out.push(range),
        }
    }
    out
}

impl Contacts {
    /// Those of a point (frames) that stands at `height`.
    pub(super) fn of(points: Vec<DVec3>, height: f64, [rate, unit]: [f64; 2]) -> Contacts {
        let is_low = |t: usize| points[t].y < height + HEIGHT * unit;
        let standing = |range: &Range<usize>| {
            let speeds: Vec<f64> = range.clone().map(|t| speed(&points, t, rate)).collect();
            let usual = median(speeds.clone()).unwrap_or(0.0);
            let most = (STEP[0] * usual).max(STEP[1] * unit);
            ranges(range.clone().filter(|t| speeds[t - range.start] < most))
        };
        let slow = stances(&points, [rate, unit], SLOW, is_low);
        let whole = joined(slow.iter().flat_map(standing), LEAST * rate + 1e-6);
        let is_long = |range: &Range<usize>| range.len() as f64 >= LEAST * rate - 1e-6;
        let whole: Vec<Range<usize>> = whole.into_iter().filter(is_long).collect();
        // Speeds are means: in its first frames a foot is still set down, in its last it lifts.
        let core = |range: &Range<usize>| {
            let reach = reach(rate).min((range.len() - 1) / 2);
            let start = range.start + if range.start == 0 { 0 } else { reach };
            let is_last = range.end == points.len();
            start..range.end - if is_last { 0 } else { reach }
        };
        let frames: Vec<Range<usize>> = whole.iter().map(core).collect();
        let middle = |range: &Range<usize>| {
            let of = |c: usize| points[range.clone()].iter().map(|p| p[c]).collect();
            let axis = |c: usize| median(of(c)).unwrap_or(f64::NAN);
            DVec3::new(axis(0), axis(1), axis(2))
        };
        Contacts {
            middles: frames.iter().map(middle).collect(),
            frames,
            whole,
            points,
        }
    }

    /// The way along the floor to the middle of the contact `n` in a frame.
    pub(super) fn offset(&self, n: usize, frame: usize) -> DVec3 {
        (self.middles[n] - self.points[frame]) * DVec3::new(1.0, 0.0, 1.0)
    }

    /// The farthest that the contact `n` is from its middle.
    pub(super) fn slide(&self, n: usize) -> f64 {
        let far = |t: usize| self.offset(n, t).length();
        self.frames[n].clone().map(far).fold(0.0, f64::max)
    }

    /// What is told of them.
    pub(super) fn told(&self, foot: &str, rate: f64) -> Vec<Contact> {
        let one = |(n, range): (usize, &Range<usize>)| Contact {
            foot: foot.to_string(),
            start: range.start as f64 / rate,
            end: range.end as f64 / rate,
            slide: self.slide(n),
        };
        self.whole.iter().enumerate().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A toe at 60 frames a second that slides by 4 cm/s for a second, is set 5 cm aside within 0.2
    /// seconds and stands there for another; then it lifts.
    fn track() -> Vec<DVec3> {
        let at = |t: usize| {
            let t = t as f64 / 60.0;
            let aside = 25.0 * (t - 1.0).clamp(0.0, 0.2);
            DVec3::new(4.0 * t + aside, 100.0 * (t - 2.2).max(0.0), 0.0)
        };
        (0..180).map(at).collect()
    }

    #[test]
    fn a_foot_that_is_set_elsewhere_stands_twice() {
        let found = Contacts::of(track(), 0.0, [60.0, 1.0]);
        let told = found.told("left", 60.0);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(
            told[0].start == 0.0 && (told[0].end - 1.0).abs() <= 0.08,
            "{told:?}"
        );
        assert!((told[1].start - 1.2).abs() <= 0.08 && (told[1].end - 2.2).abs() <= 0.08);
        // A second of 4 cm/s is 2 cm to both sides of the middle.
        assert!(
            told.iter().all(|c| (1.6..=2.1).contains(&c.slide)),
            "{told:?}"
        );
        assert!(found.offset(0, 5).x > 1.0 && found.offset(0, 5).y == 0.0);
        assert!(Contacts::of(track(), -4.0, [60.0, 1.0]).frames.is_empty());
        assert!(
            Contacts::of(vec![DVec3::NAN; 60], 0.0, [60.0, 1.0])
                .frames
                .is_empty()
        );
        assert!(Contacts::of(Vec::new(), 0.0, [60.0, 1.0]).frames.is_empty());
    }

    #[test]
    fn short_gaps_are_joined() {
        let ranges = [2..5, 7..9, 14..20];
        assert_eq!(joined(ranges.into_iter(), 2.5), [2..9, 14..20]);
        assert_eq!(joined(std::iter::empty(), 2.5), []);
    }
}
