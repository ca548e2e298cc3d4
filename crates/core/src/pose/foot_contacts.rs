//! Where a foot stands, and what holds it there.

use super::ranges;
use crate::numeric::statistics::quantile;
use glam::DVec3;
use std::ops::Range;

/// The ground is where this share of a point's heights lies below.
const LOWEST: f64 = 0.03;

/// What a contact is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLimits {
    /// Slower than this, cm/s.
    pub speed: f64,
    /// Less than this over the ground, cm.
    pub height: f64,
    /// For as long as this, seconds.
    pub seconds: f64,
}

/// The height of a point (frames; NaN missing) where it is low, cm; `None` where it is never seen.
pub fn ground(point: &[DVec3]) -> Option<f64> {
    let heights = point.iter().map(|a| a.y).filter(|y| y.is_finite());
    quantile(heights.collect(), LOWEST)
}

/// The speed of a point in a frame, between the frames beside it, cm/s; NaN where one of them is
/// missing.
pub fn speed(point: &[DVec3], frame: usize, rate: f64) -> f64 {
    let (before, after) = (frame.saturating_sub(1), (frame + 1).min(point.len() - 1));
    point[after].distance(point[before]) * rate / (after - before) as f64
}

/// The frames in which a point of a foot (frames; NaN missing) is in contact, at `rate` frames a
/// second.
pub fn contacts(point: &[DVec3], rate: f64, limits: &ContactLimits) -> Vec<Range<usize>> {
    let Some(ground) = ground(point).filter(|_| point.len() > 1) else {
        return Vec::new();
    };
    let is_planted =
        |t: &usize| speed(point, *t, rate) < limits.speed && point[*t].y - ground < limits.height;
    let mut found = ranges((0..point.len()).filter(is_planted));
    found.retain(|range| range.len() as f64 >= limits.seconds * rate - 1e-6);
    found
}

/// Lets the offsets at the ends of contacts fade by a cosine over the frames around, `longest` at
/// most, to nothing at the next contact at the latest; `weights` are 1 in contacts, and the share
/// that is left around them.
pub fn fade(contacts: &[Range<usize>], longest: usize, offsets: &mut [DVec3], weights: &mut [f64]) {
    let cosine = |n: usize, of: usize| {
        let share = n as f64 / (of + 1) as f64;
        0.5 + 0.5 * (std::f64::consts::PI * share).cos()
    };
    for (i, contact) in contacts.iter().enumerate() {
        let before = match i.checked_sub(1) {
            Some(i) => contact.start - contacts[i].end,
            None => contact.start,
        };
        let after = match contacts.get(i + 1) {
            Some(next) => next.start - contact.end,
            None => offsets.len() - contact.end,
        };
        let [first, last] = [offsets[contact.start], offsets[contact.end - 1]];
        let (before, after) = (before.min(longest), after.min(longest));
        let mut add = |t: usize, offset: DVec3, weight: f64| {
            offsets[t] += weight * offset;
            weights[t] = f64::max(weights[t], weight);
        };
        (1..=before).for_each(|n| add(contact.start - n, first, cosine(n, before)));
        (1..=after).for_each(|n| add(contact.end - 1 + n, last, cosine(n, after)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ankle that stands, swings for 20 frames and stands again, at 100 frames a second.
    fn track() -> Vec<DVec3> {
        let at = |t: usize| {
            let swing = (t as f64 - 40.0).clamp(0.0, 20.0) / 20.0;
            let lift = 15.0 * (std::f64::consts::PI * swing).sin();
            // It rolls a little while it stands.
            DVec3::new(0.02 * t as f64, 8.0 + lift, 70.0 * swing)
        };
        (0..100).map(at).collect()
    }

    #[test]
    fn slow_and_low_ankles_are_in_contact() {
        let limits = |unit: f64| ContactLimits {
            speed: 40.0 * unit,
            height: 6.0 * unit,
            seconds: 0.1,
        };
        let of = |point: &[DVec3]| contacts(point, 100.0, &limits(1.0));
        let found = of(&track());
        assert_eq!(found.len(), 2);
        assert!(found[0].start == 0 && (39..=41).contains(&found[0].end));
        assert!((59..=61).contains(&found[1].start) && found[1].end == 100);
        // In another unit the limits are others.
        let inches: Vec<DVec3> = track().iter().map(|a| *a / 2.54).collect();
        assert_eq!(contacts(&inches, 100.0, &limits(1.0 / 2.54)), found);
        let mut cut = track();
        cut[20] = DVec3::NAN;
        let cut = of(&cut);
        assert_eq!((cut[0].clone(), cut[1].start), (0..19, 22));
        assert!(of(&track()[..5]).is_empty());
        assert!(of(&[]).is_empty());
        assert!(of(&[DVec3::ZERO]).is_empty());
        assert!(of(&[DVec3::NAN; 30]).is_empty());
    }

    #[test]
    fn offsets_fade_to_nothing_at_the_next_contact() {
        let mut offsets = vec![DVec3::ZERO; 20];
        let mut weights = vec![0.0; 20];
        for t in (5..8).chain(11..13) {
            (offsets[t], weights[t]) = (DVec3::X, 1.0);
        }
        fade(&[5..8, 11..13], 4, &mut offsets, &mut weights);
        assert_eq!((offsets[0], offsets[17]), (DVec3::ZERO, DVec3::ZERO));
        assert!(offsets[1].x > 0.0 && offsets[1].x < offsets[2].x && weights[2] < 1.0);
        // Between two contacts that hold alike, all is held alike.
        (5..13).for_each(|t| assert!((offsets[t].x - 1.0).abs() < 1e-12));
    }
}
