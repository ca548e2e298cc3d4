//! How two recordings of one performance lie in time: by the speeds of the points that they share.
//!
//! ```text
//! t_A = s + (1 + d) t_B     times since the first frame of each
//! |v_A(t_A)| ≈ g |v_B(t_B)| + c     of each shared point, with a factor and a floor of its own
//! ```
//!
//! Points that move relative to others count likewise once the place is about known. A speed does
//! not depend on where somebody stands and which way they face, and hardly on where on a limb a
//! marker sits. Positions are smoothed first, both by one filter without lag. The shift s is that
//! of the highest correlation over all points at once, and is then refined, with the drift d where
//! it is asked for, by least squares (Gauss-Newton). What the residuals of blocks of the recording
//! say of both is their standard deviation, however residuals follow one another (a sandwich
//! estimate; White 1980).
//!
//! Where the second place is about as good as the best one, nothing is found: the recordings are of
//! other performances, or of movement that repeats itself as exactly as they are measured. It fails
//! too where the points hardly move, and takes two walks of one person for one where they are of a
//! few seconds and hardly differ.

mod aligned_takes;
mod correlation;
mod drift;
mod refinement;
mod search;
mod speeds;

pub use aligned_takes::{AlignedTakes, FramesInSecond, timed};

use crate::pose::{NameMap, Poses, same_points};
use crate::{Error, Result};
use drift::LARGEST_DRIFT;
use refinement::{Fit, refine};
use search::{PlaceInTime, evidence};
use speeds::Speeds;

/// Speeds are searched below this, Hz, where noise hardly is, and refined below that; both below
/// this share of the lower rate.
const SLOW: f64 = 2.5;
const FAST: f64 = 8.0;
const CUTOFF_SHARE: f64 = 0.3;
/// A best place less clear than this is none: its correlation, and how many times more evidence it
/// has than the second.
const LEAST_CORRELATION: f64 = 0.94;
const LEAST_CONTRAST: f64 = 1.1;
/// A shift is not found that is known no better than this, seconds.
const LARGEST_DEVIATION: f64 = 0.02;

/// So many standard deviations are clearly beyond a limit.
const UNSURE: f64 = 2.5;

/// What is estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TimeAlignmentOptions {
    /// Whether one clock may run faster than the other.
    pub drift: bool,
}

/// How a recording B lies in time beside a recording A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeAlignment {
    /// The seconds from the first frame of A to the first of B, by A's clock; below zero where B
    /// begins before.
    pub shift: f64,
    /// Its standard deviation.
    pub shift_sd: f64,
    /// A's seconds in one of B's, less one; 0 unless it was asked for.
    pub drift: f64,
    /// Its standard deviation.
    pub drift_sd: f64,
    /// The correlation of the speeds, smoothed at 2.5 Hz, over all points.
    pub correlation: f64,
    /// The highest correlation elsewhere.
    pub elsewhere: f64,
    /// Whether the place is so good and so much better than all others that it is no chance.
    pub is_clear: bool,
    /// The drift that would fit better where none was asked for and there clearly is one.
    pub unasked_drift: Option<f64>,
}

impl TimeAlignment {
    /// The seconds since B's first frame at a time since A's first frame.
    pub fn in_b(&self, seconds: f64) -> f64 {
        (seconds - self.shift) / (1.0 + self.drift)
    }
}

/// The points that two files share, by their indices in both: those of one name (without a prefix,
/// where that alone tells them apart), or that a map names alike.
///
/// ```
/// use posing_likeness::time_alignment::shared_points;
///
/// let names = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<Vec<_>>();
/// let (a, b) = (names(&["hip", "knee"]), names(&["knee", "toe"]));
/// assert_eq!(shared_points(&a, &b, None), [[1, 0]]);
/// let rig = names(&["mixamorig:Knee", "mixamorig:Hips"]);
/// assert_eq!(shared_points(&b, &rig, None), [[0, 0]]);
/// ```
pub fn shared_points(a: &[String], b: &[String], map: Option<&NameMap>) -> Vec<[usize; 2]> {
    let place = |points: &[String], name: &str| points.iter().position(|p| p == name);
    let Some(map) = map else {
        let both = same_points(a, b).into_iter().enumerate();
        return both.filter_map(|(i, place)| Some([i, place?])).collect();
    };
    let named = |points: &[String], name: &str| {
        let mapped = map.columns(points).get(name).copied();
        place(points, name).or(mapped)
    };
    let names = map.joints.keys();
    names
        .filter_map(|name| Some([named(a, name)?, named(b, name)?]))
        .collect()
}

/// How the recording `b` lies beside `a`, by the points that they share, at the best place, whether
/// it is clear or not; `None` where nothing can be compared. Both have times, which rise, and one
/// take each.
///
/// ```
/// use ndarray::Array2;
/// use posing_core::pose::Poses;
/// use posing_likeness::time_alignment::{TimeAlignmentOptions, align};
///
/// let recorded = |from: f64, rate: f64| {
///     let at = |t: usize| from + t as f64 / rate;
///     let wave = |s: f64, c: f64| 20.0 * (2.0 * s + c).sin() + 9.0 * (s * s + 3.0 * c).sin();
///     Poses {
///         points: vec!["hand".into()],
///         xyz: Array2::from_shape_fn((600, 3), |(t, c)| wave(at(t), c as f64)),
///         time: Some((0..600).map(|t| t as f64 / rate).collect()),
///         take: None,
///     }
/// };
/// let (a, b) = (recorded(0.0, 120.0), recorded(0.5, 100.0));
/// let found = align(&a, &b, &[[0, 0]], &TimeAlignmentOptions::default())?.unwrap();
/// assert!(found.is_clear && (found.shift - 0.5).abs() < 1e-3);
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Unfit`]: one has no times, too few frames for its rate, or lasts over half a day.
pub fn align(
    a: &Poses,
    b: &Poses,
    shared: &[[usize; 2]],
    options: &TimeAlignmentOptions,
) -> Result<Option<TimeAlignment>> {
    if shared.is_empty() {
        return Ok(None);
    }
    let rate = |poses: &Poses| {
        poses
            .rate()
            .ok_or_else(|| Error::unfit("has no times that rise"))
    };
    let highest = CUTOFF_SHARE * rate(a)?.min(rate(b)?);
    let of = |poses, side: usize, cutoff: f64, pairs| {
        let points: Vec<usize> = shared.iter().map(|pair| pair[side]).collect();
        Speeds::of(poses, &points, cutoff.min(highest), pairs)
    };
    let slow = [of(a, 0, SLOW, false)?, of(b, 1, SLOW, false)?];
    let all = refined_places(&slow, options.drift);
    let best = all.iter().max_by(|x, y| x.1.total_cmp(&y.1));
    let Some(first) = best.map(|(fit, _)| *fit) else {
        return Ok(None);
    };
    let others = all.iter().map(|(fit, _)| fit);
    let elsewhere = others
        .filter(|other| (other.shift - first.shift).abs() > search::ANOTHER)
        .map(|other| other.correlation)
        .fold(0.0, f64::max);
    let fast = [of(a, 0, FAST, true)?, of(b, 1, FAST, true)?];
    let fit = refine(&fast, [first.shift, first.drift], options.drift);
    Ok(fit.map(|fit| verdict(&fast, &fit, [first.correlation, elsewhere], options)))
}

/// The best places by slow speeds, refined, and what speaks for each.
fn refined_places(slow: &[Speeds; 2], drift: bool) -> Vec<(Fit, f64)> {
    let places = if drift {
        drift::places(&slow[0], &slow[1])
    } else {
        search::places(&slow[0], &slow[1])
    };
    let refined = |place: &PlaceInTime| {
        let fit = refine(slow, [place.shift, place.drift], drift)?;
        Some((fit, place.weight * evidence(fit.correlation)))
    };
    places.iter().filter_map(refined).collect()
}

/// What the fit of fast speeds, and the correlations of slow ones there and elsewhere, say.
fn verdict(
    fast: &[Speeds; 2],
    fit: &Fit,
    [correlation, elsewhere]: [f64; 2],
    options: &TimeAlignmentOptions,
) -> TimeAlignment {
    let free = refine(fast, [fit.shift, fit.drift], true);
    let runs_alike =
        free.is_none_or(|free| free.drift.abs() <= LARGEST_DRIFT + UNSURE * free.deviations[1]);
    let unasked = free.filter(|free| !options.drift && is_better(fit, free, &fast[0]));
    TimeAlignment {
        shift: fit.shift,
        shift_sd: fit.deviations[0],
        drift: fit.drift,
        drift_sd: fit.deviations[1],
        correlation,
        elsewhere,
        is_clear: evidence(correlation) >= LEAST_CONTRAST * evidence(elsewhere)
            && correlation >= LEAST_CORRELATION
            && fit.deviations[0] <= LARGEST_DEVIATION
            && runs_alike,
        unasked_drift: unasked.map(|free| free.drift),
    }
}

/// Whether a fit with drift shows one: clearly, and of more than a frame over A.
fn is_better(fit: &Fit, other: &Fit, a: &Speeds) -> bool {
    other.drift.abs() > 5.0 * other.deviations[1]
        && other.drift.abs() * a.seconds > 1.0 / a.rate
        && other.correlation > fit.correlation
}

#[cfg(test)]
mod tests;
