//! A cubic over a gap that meets both of its ends with the velocities there (Hermite).
//!
//! The velocity at an end is the mean of two: that of the chord over the last frames, which errs
//! little in noise but lags, and that of a parabola fitted to more frames, which does not lag.
//! Where there are too few for that, it is that of the parabola that also meets the other end.

use glam::{DMat3, DVec3};

/// Frames of the velocity at an end: seconds, and intervals at least.
const CHORD: (f64, f64) = (1.0 / 60.0, 1.0);
const PARABOLA: (f64, f64) = (1.0 / 15.0, 4.0);
/// Samples that a parabola is fitted to, at least.
const FEWEST: usize = 4;

/// The cubic through the gap that lies between `x[before - 1]` and `x[before]`, x rising, at each
/// of `at`; (`x`, `y`) is what is known around it, on both sides, and `step` an interval of x.
pub fn hermite(x: &[f64], y: &[f64], before: usize, at: &[f64], step: f64) -> Vec<f64> {
    let (a, b) = (before - 1, before);
    let length = x[b] - x[a];
    let secant = (y[b] - y[a]) / length;
    let end = |samples: Vec<(f64, f64)>| {
        velocity(&samples, step, Some((secant, length))).unwrap_or(secant) * length
    };
    let sample = |k: usize| (x[k], y[k]);
    let v = end((0..before).rev().map(sample).collect());
    let w = end((before..x.len()).map(sample).collect());
    let value = |t: &f64| {
        let u = (t - x[a]) / length;
        let (to, left) = (u * u * (3.0 - 2.0 * u), u * (1.0 - u));
        y[a] + to * (y[b] - y[a]) + left * ((1.0 - u) * v - u * w)
    };
    at.iter().map(value).collect()
}

/// The velocity at the first of some samples (x, y); the others lie on one side of it, the nearest
/// first, `step` apart where none is missing. `across`: the velocity of the chord over the gap on
/// the other side, and its length. `None` for one sample.
pub fn velocity(samples: &[(f64, f64)], step: f64, across: Option<(f64, f64)>) -> Option<f64> {
    let &(x0, y0) = samples.first()?;
    let away = |k: usize| (samples[k].0 - x0, samples[k].1 - y0);
    let within = |(seconds, steps): (f64, f64)| {
        let reach = seconds.max(steps * step) * (1.0 + 1e-6);
        (samples.iter())
            .take_while(|s| (s.0 - x0).abs() <= reach)
            .count()
    };
    if samples.len() < 2 {
        return None;
    }
    let (x, y) = away(within(CHORD).max(2) - 1);
    let chord = y / x;
    let fitted = within(PARABOLA);
    if fitted < FEWEST {
        let (secant, length) = across.unwrap_or((chord, x.abs()));
        return Some((chord * length + secant * x.abs()) / (length + x.abs()));
    }
    let unit = away(fitted - 1).0;
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (x, y) in (0..fitted).map(away) {
        let powers = DVec3::new(1.0, x / unit, (x / unit).powi(2));
        normal += DMat3::from_cols(powers * powers.x, powers * powers.y, powers * powers.z);
        right += powers * y;
    }
    let slope = (normal.inverse() * right).y / unit;
    Some(0.5 * (chord + slope)).filter(|v| v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_met_with_its_velocities_but_for_the_lag_of_chords() {
        let path = |t: f64| 3.0 - 2.0 * t + 40.0 * t * t;
        let step = 1.0 / 120.0;
        let x: Vec<f64> = ((0..20).chain(32..52))
            .map(|k| f64::from(k) * step)
            .collect();
        let y: Vec<f64> = x.iter().map(|t| path(*t)).collect();
        let at: Vec<f64> = (20..32).map(|k| f64::from(k) * step).collect();
        let found = hermite(&x, &y, 20, &at, step);
        for (t, v) in at.iter().zip(found) {
            // Chords of two frames lag by one: half of 2 * 40 / 120 in each velocity.
            assert!((v - path(*t)).abs() < 0.01, "{v} at {t}");
        }
        // A line, from two samples on either side, or one.
        let line = hermite(&[0.0, 1.0, 3.0, 4.0], &[0.0, 1.0, 3.0, 4.0], 2, &[2.0], 1.0);
        assert!((line[0] - 2.0).abs() < 1e-12);
        let line = hermite(&[1.0, 3.0], &[1.0, 3.0], 1, &[2.0], 1.0);
        assert!((line[0] - 2.0).abs() < 1e-12);
    }
}
