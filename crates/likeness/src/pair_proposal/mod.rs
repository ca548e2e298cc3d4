//! Hard pairs of poses for people to label (Chen et al., section 5.1.1).
//!
//! Most pairs of poses are plainly unlike, and a person learns nothing from labeling them. A pair
//! is proposed where the mean joint distance (equation 35) is small:
//!
//! d(x, y) = 1/16 sum_k |c_k(x) - c_k(y)| < near
//!
//! c_k: joint k in the body's own frame (no position, no yaw), scaled to one body height, cm.
//! `near` is 10 cm in Chen et al. Poses are looked at about ten times a second. The proposed pairs
//! are spread over takes and over distances, and no two of them are within .25 s of each other on
//! both sides. Cost: n^2 / 2 distances of n looked-at poses, in parallel.

mod candidates;
mod choice;

use super::body_frame::BodyFramePoses;
use crate::Result;
use crate::numeric::statistics::median;
use candidates::{Found, Sample};
use std::collections::HashSet;

/// Poses looked at in a second.
const LOOKS: f64 = 10.0;
/// Two poses of one take are at least this far apart, seconds.
pub(crate) const APART: f64 = 1.0;
/// Two pairs that are this close on both sides show nearly the same, seconds.
pub const NEAR_COPY: f64 = 0.25;
/// Poses closer than this are one pose twice, cm.
const SAME_POSE: f64 = 0.1;
/// Most pairs of one proposal.
const MOST: usize = 2000;
/// Rounding of times, seconds.
const TIME_EPSILON: f64 = 1e-9;

/// The rules of a proposal.
#[derive(Debug, Clone, PartialEq)]
pub struct PairRules {
    /// Mean joint distance below which a pair is a candidate, cm of a body of the takes' median
    /// height.
    pub near: f64,
    /// Number of pairs to propose, 1 to 2,000.
    pub count: usize,
    /// Seconds of unbroken motion before and after each pose.
    pub margin: f64,
    /// Whether both poses must be of different takes.
    pub other_takes: bool,
    /// Seed of the choice among candidates.
    pub seed: u64,
}

impl Default for PairRules {
    fn default() -> Self {
        PairRules {
            near: 10.0,
            count: 100,
            margin: 0.5,
            other_takes: false,
            seed: 0,
        }
    }
}

impl PairRules {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`], with the option and its limits.
    pub fn check(&self) -> Result<()> {
        if !(1..=MOST).contains(&self.count) {
            return Err(format!("the option `count {}`: expected 1 to {MOST}", self.count).into());
        }
        if !(self.near > SAME_POSE && self.near <= 1000.0) {
            return Err(format!(
                "the option `near {}`: expected above {SAME_POSE} to 1000 cm",
                self.near
            )
            .into());
        }
        if !(0.1..=5.0).contains(&self.margin) {
            return Err(format!(
                "the option `seconds {}`: expected 0.1 to 5 seconds",
                self.margin
            )
            .into());
        }
        Ok(())
    }
}

/// A frame of a take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TakeFrame {
    /// Index of the take.
    pub take: usize,
    /// Its frame, counted from 0.
    pub frame: usize,
}

/// A pair to label. The pose `a` comes first in the input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProposedPair {
    /// One pose.
    pub a: TakeFrame,
    /// The other pose.
    pub b: TakeFrame,
    /// Their mean joint distance, cm.
    pub distance: f64,
}

/// The proposed pairs and how many there were to choose from.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// The pairs, in random order.
    pub pairs: Vec<ProposedPair>,
    /// Pairs of looked-at poses that are near enough, before the choice.
    pub candidates: u64,
    /// Poses looked at.
    pub poses: usize,
    /// The body height that all poses are scaled to, cm: the median of the takes, from the ankles
    /// to the head.
    pub height: f64,
}

/// Proposes pairs of poses of `takes`, whose names are `names`.
///
/// # Errors
/// [`crate::Error::Unfit`]: the rules are out of range, two takes have one name, a take has no
/// rate, takes are too few or too
/// short, or no pair is near enough.
pub fn propose(takes: &[BodyFramePoses], names: &[String], rules: &PairRules) -> Result<Proposal> {
    rules.check()?;
    let mut seen = HashSet::new();
    if let Some(twice) = names.iter().find(|name| !seen.insert(*name)) {
        return Err(format!(
            "two takes are named \"{twice}\", and labels tell takes apart by name"
        )
        .into());
    }
    let rates: Option<Vec<f64>> = takes.iter().map(|t| t.rate).collect();
    let rates =
        rates.ok_or("the times of a take give no frame rate; give it with the option `fps`")?;
    if rules.other_takes && takes.len() < 2 {
        return Err("has one take, and the option `other_takes` needs two".into());
    }
    let height = median(takes.iter().map(|t| t.height).collect()).ok_or("has no frames")?;
    let sample = Sample::new(takes, &rates, height, rules.margin);
    if sample.poses.is_empty() {
        return Err(too_short(takes, &rates, rules.margin).into());
    }
    let found = Found::search(&sample, rules);
    let pairs = choice::choose(&sample, &found, rules);
    if pairs.is_empty() {
        return Err(nothing_near(takes, &rates, rules).into());
    }
    Ok(Proposal {
        pairs,
        candidates: found.count,
        poses: sample.poses.len(),
        height,
    })
}

/// The longest run, seconds.
fn longest(takes: &[BodyFramePoses], rates: &[f64]) -> f64 {
    let spans = takes.iter().zip(rates).flat_map(|(take, rate)| {
        let frames = take.runs.iter().map(|run| run.len());
        frames.map(move |n| n.saturating_sub(1) as f64 / rate)
    });
    spans.fold(0.0, f64::max)
}

/// Why no pose could be looked at.
fn too_short(takes: &[BodyFramePoses], rates: &[f64], margin: f64) -> String {
    let longest = longest(takes, rates);
    if longest < 2.0 * margin {
        format!(
            "the longest unbroken motion lasts {longest:.2} s, and a pose needs {margin} s before \
         and after it; see the option `seconds`"
        )
    } else {
        format!(
            "no frame with {margin} s of motion before and after it has all 16 joints; fill gaps \
         with complete"
        )
    }
}

/// Why poses were looked at and no pair was found.
fn nothing_near(takes: &[BodyFramePoses], rates: &[f64], rules: &PairRules) -> String {
    let (needed, lasts) = (2.0 * rules.margin + APART, longest(takes, rates));
    if takes.len() == 1 && takes[0].runs.len() == 1 && lasts < needed {
        return format!(
            "one take of {lasts:.2} s is too short: poses {APART} s apart with {} s around them \
             need {needed} s; see the option `seconds`",
            rules.margin
        );
    }
    let where_from = if rules.other_takes {
        "of different takes".to_string()
    } else {
        format!("of different takes or {APART} s apart")
    };
    format!(
        "no two poses {where_from} that differ are within {} cm; see the option `near`",
        rules.near
    )
}

#[cfg(test)]
mod tests;
