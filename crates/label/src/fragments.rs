//! Fragments of tracks: what one point surely was, between the gaps and the jumps of a track.
//!
//! A track is cut at frame t where what comes before and what comes after, each fitted and carried
//! on by half a frame, do not meet: `J = min |L − R|` over a parabola through five frames and a
//! line through three. Too many cuts do no harm: what belongs together is linked again
//! ([`super::links`]).

use super::tuning::fragments::*;
use crate::numeric::statistics::median;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// A fragment of a track.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fragment {
    /// The track: a point of the take.
    pub track: usize,
    /// The frames, in all of which it is seen.
    pub frames: Range<usize>,
    /// Whether the track jumps before it, and after it; else a gap or the take's end is there.
    pub jumps: [bool; 2],
}

/// A fragment that goes on in another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Link {
    /// The fragments.
    pub from: usize,
    pub to: usize,
}

/// The fragments of the tracks of `xyz` (frames, 3 J; cm, NaN missing), track after track and in
/// the order of their frames. `runs` are ranges of consecutive frames, `rate` is in frames a
/// second.
pub(crate) fn fragments(
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
) -> Vec<Fragment> {
    let found = crate::numeric::parallel::map_chunks(xyz.ncols() / 3, 4, |tracks| {
        let of_track = |track: usize| {
            let all = seen_ranges(xyz, track, runs).into_iter();
            all.flat_map(move |seen| divided(xyz, track, &seen, rate))
        };
        tracks.flat_map(of_track).collect::<Vec<_>>()
    });
    found.into_iter().flatten().collect()
}

/// The ranges of consecutive frames in which a track is seen on end.
pub(crate) fn seen_ranges(
    xyz: ArrayView2<'_, f64>,
    track: usize,
    runs: &[Range<usize>],
) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for run in runs {
        let mut is_open = false;
        for t in run.clone() {
            let is_seen = point_at(xyz, t, track).is_finite();
            match out.last_mut() {
                Some(last) if is_seen && is_open => last.end = t + 1,
                _ if is_seen => out.push(t..t + 1),
                _ => {}
            }
            is_open = is_seen;
        }
    }
    out
}

/// A range in which a track is seen, divided where it jumps.
fn divided(
    xyz: ArrayView2<'_, f64>,
    track: usize,
    seen: &Range<usize>,
    rate: f64,
) -> Vec<Fragment> {
    let path: Vec<DVec3> = seen.clone().map(|t| point_at(xyz, t, track)).collect();
    let mut bounds = vec![0];
    bounds.extend(cuts(&path, rate));
    bounds.push(path.len());
    let last = bounds.len() - 2;
    let fragments = bounds.windows(2).enumerate().map(|(k, w)| Fragment {
        track,
        frames: seen.start + w[0]..seen.start + w[1],
        jumps: [k > 0, k < last],
    });
    fragments.collect()
}

/// The frames at which a path jumps, counted from its first.
fn cuts(path: &[DVec3], rate: f64) -> Vec<usize> {
    let count = path.len();
    let step = |t: usize| path[t].distance(path[t - 1]);
    let misses: Vec<Miss> = (0..count).map(|t| Miss::at(path, t)).collect();
    let of_run = median(
        misses
            .iter()
            .map(|m| m.distance)
            .filter(|d| d.is_finite())
            .collect(),
    );
    let of_run = of_run.unwrap_or(0.0).max(LEAST_USUAL);
    let near = ((NEARBY * rate) as usize).max(FIT);
    let is_jump = |t: usize| {
        let Miss { distance, residual } = misses[t];
        if distance.is_nan() {
            return is_jump_at_end(path, t);
        }
        if !(distance > LEAST && step(t) > LEAST_STEP && distance > RESIDUALS * residual) {
            return false;
        }
        let around = t.saturating_sub(near)..(t + near + 1).min(count);
        let around = misses[around].iter().map(|m| m.distance);
        let usual = median(around.filter(|d| d.is_finite()).collect()).unwrap_or(0.0);
        distance > UNUSUAL * usual.max(of_run)
    };
    // Of cuts close by, the clearest.
    let clear = |t: usize| match misses[t] {
        m if m.distance.is_nan() => step(t),
        m => m.distance / (RESIDUAL_ADDED + m.residual),
    };
    let mut out: Vec<usize> = Vec::new();
    for t in (1..count).filter(|t| is_jump(*t)) {
        match out.last_mut().filter(|last| t - **last <= APART) {
            Some(last) if clear(t) > clear(*last) => *last = t,
            Some(_) => {}
            None => out.push(t),
        }
    }
    out
}

/// Whether the step to a frame near an end of the path, where no fit has room, is a jump.
fn is_jump_at_end(path: &[DVec3], t: usize) -> bool {
    if t == 0 {
        return false;
    }
    let step = |t: usize| path[t].distance(path[t - 1]);
    let others = t.saturating_sub(END_STEPS).max(1)..(t + END_STEPS + 1).min(path.len());
    let largest = others.filter(|s| *s != t).map(step).fold(0.0, f64::max);
    step(t) > LEAST + END_STEP * largest
}

/// By how much the fits of both sides miss each other before a frame.
#[derive(Debug, Clone, Copy)]
struct Miss {
    /// cm; NaN where there is no room for them.
    distance: f64,
    /// Standard deviation of a coordinate about both fits, cm.
    residual: f64,
}

/// Frames that the longest fit takes.
const FIT: usize = 5;
/// Weights of frames, the nearest first, that give the value half a frame before them: of the
/// least-squares parabola through five and the line through three.
const PARABOLA: [f64; FIT] = [
    1.307_142_857_142_857,
    0.146_428_571_428_571,
    -0.407_142_857_142_857,
    -0.353_571_428_571_429,
    0.307_142_857_142_857,
];
const LINE: [f64; 3] = [
    1.083_333_333_333_333,
    0.333_333_333_333_333,
    -0.416_666_666_666_667,
];
/// Sums of squares by which five values differ from their parabola (the two differences with it
/// that are left) and three from their line.
const CUBIC: [f64; FIT] = [-1.0, 2.0, 0.0, -2.0, 1.0];
const QUARTIC: [f64; FIT] = [1.0, -4.0, 6.0, -4.0, 1.0];
const BENT: [f64; 3] = [1.0, -2.0, 1.0];

impl Miss {
    /// Before frame `t` of a path.
    fn at(path: &[DVec3], t: usize) -> Miss {
        if t < FIT || path.len() - t < FIT {
            return Miss {
                distance: f64::NAN,
                residual: f64::NAN,
            };
        }
        let sides = |weights: &[f64]| {
            let of = |position: &dyn Fn(usize) -> DVec3| {
                let all = weights.iter().enumerate();
                all.map(|(k, w)| *w * position(k)).sum::<DVec3>()
            };
            [of(&|k| path[t - 1 - k]), of(&|k| path[t + k])]
        };
        let squares = |weights: &[f64]| {
            let own: f64 = weights.iter().map(|w| w * w).sum();
            sides(weights)
                .map(|s| s.length_squared() / own)
                .iter()
                .sum::<f64>()
        };
        let of = |value: &[f64], squares: f64, free: f64| {
            let [left, right] = sides(value);
            Miss {
                distance: left.distance(right),
                // Three coordinates each.
                residual: (squares / (3.0 * free)).sqrt(),
            }
        };
        let parabola = of(&PARABOLA, squares(&CUBIC) + squares(&QUARTIC), 2.0);
        let line = of(&LINE, squares(&BENT), 1.0);
        if line.distance < parabola.distance {
            line
        } else {
            parabola
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    const RATE: f64 = 120.0;

    fn swing() -> Array2<f64> {
        Array2::from_shape_fn((600, 6), |(t, c)| {
            let (t, c) = (t as f64 / RATE, c as f64);
            20.0 * c + 30.0 * (4.0 * t + c).sin() + 0.02 * (t * 997.0 + c).sin()
        })
    }

    fn frames_of(xyz: &Array2<f64>, track: usize) -> Vec<Range<usize>> {
        let all = 0..xyz.nrows();
        let found = fragments(xyz.view(), std::slice::from_ref(&all), RATE);
        let own = found.into_iter().filter(|p| p.track == track);
        own.map(|p| p.frames).collect()
    }

    #[test]
    fn fits_extrapolate_polynomials_exactly() {
        let at = |k: f64| 3.0 - 2.0 * k + 0.5 * k * k;
        let position = |weights: &[f64]| {
            let all = weights.iter().enumerate();
            all.map(|(k, w)| w * at(k as f64 + 0.5)).sum::<f64>()
        };
        assert!((position(&PARABOLA) - 3.0).abs() < 1e-12);
        let line = |k: f64| 3.0 - 2.0 * k;
        let found: f64 = (LINE.iter().enumerate())
            .map(|(k, w)| w * line(k as f64 + 0.5))
            .sum();
        assert!((found - 3.0).abs() < 1e-12);
        for rest in [&CUBIC[..], &QUARTIC] {
            assert!(position(rest).abs() < 1e-12);
        }
    }

    #[test]
    fn a_track_is_cut_where_it_jumps_and_where_it_is_missing() {
        let mut xyz = swing();
        assert_eq!(frames_of(&xyz, 0), vec![0..600]);
        for t in 200..260 {
            (0..3).for_each(|c| xyz.swap([t, c], [t, c + 3]));
        }
        xyz[[400, 1]] = f64::NAN;
        // Near the end of what is seen.
        (398..400).for_each(|t| xyz[[t, 0]] += 9.0);
        assert_eq!(
            frames_of(&xyz, 0),
            vec![0..200, 200..260, 260..398, 398..400, 401..600]
        );
        assert_eq!(frames_of(&xyz, 1), vec![0..200, 200..260, 260..600]);
    }
}
