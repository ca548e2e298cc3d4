//! Feet that stand in a gap of their leg.
//!
//! The path that fills the gap of an ankle or of toes floats a little where the foot stands. It
//! stands all through the gap where it does so in one place at both ends; from a planted end on
//! while its path stays near, or while the other foot swings; and between where its path is slow
//! and low. There it is held, and what was added fades. The knee follows by two-bone inverse
//! kinematics where it is filled too; bones keep their lengths.

use super::tuning::contacts::*;
use super::{FilledGap, Gap};
use crate::numeric::statistics::median;
use crate::pose::foot_contacts::{ContactLimits, contacts, fade, ground, speed};
use crate::pose::joints::CMU;
use crate::pose::point_at;
use crate::pose::two_bone::TwoBones;
use crate::restore::take::Take;
use glam::DVec3;
use ndarray::ArrayView1;
use std::ops::Range;

/// Holds the feet of filled gaps where they stand, in tables of CMU's names.
pub(crate) fn hold(take: &Take<'_>, gaps: &[Gap], filled: &mut [Option<FilledGap>]) {
    let [left, right] = [&CMU[1..5], &CMU[5..9]].map(|names| Leg::find(take.names, names));
    for (leg, other) in [(&left, &right), (&right, &left)] {
        let Some(leg) = leg else { continue };
        let root = take.names.iter().position(|n| *n == CMU[0]);
        let swings = match (other, root) {
            (Some(other), Some(root)) => {
                let tracks = [other.ankle, root].map(|p| completed(take, gaps, filled, p));
                swings(&tracks, take.rate)
            }
            _ => vec![false; take.xyz.nrows()],
        };
        leg.hold(take, gaps, filled, other.as_ref(), &swings);
    }
}

/// The points of a leg.
struct Leg {
    hip: usize,
    knee: usize,
    ankle: usize,
    toes: Option<usize>,
    is_left: bool,
}

/// What is added to the path of a point in its gap.
struct Held {
    /// In which frames of the take.
    frames: Range<usize>,
    offsets: Vec<DVec3>,
    contacts: Vec<Range<usize>>,
    /// Which gap it is.
    gap: usize,
}

/// The place of a point in every frame, filled where a gap of it is.
fn completed(
    take: &Take<'_>,
    gaps: &[Gap],
    filled: &[Option<FilledGap>],
    point: usize,
) -> Vec<DVec3> {
    let mut track: Vec<DVec3> = (0..take.xyz.nrows())
        .map(|t| point_at(take.xyz, t, point))
        .collect();
    for (gap, filled) in gaps.iter().zip(filled).filter(|(g, _)| g.point == point) {
        let Some(filled) = filled else { continue };
        for (k, t) in gap.frames.clone().enumerate() {
            track[t] = point_at(filled.xyz.view(), k, 0);
        }
    }
    track
}

/// The frames in which a foot swings, by its ankle and the root.
fn swings([ankle, root]: &[Vec<DVec3>; 2], rate: f64) -> Vec<bool> {
    let is_swinging = |t: usize| {
        let usual = speed(root, t, rate).max(ROOT_SPEED);
        speed(ankle, t, rate) > SWING.max(SWING_MORE + usual)
    };
    (0..ankle.len()).map(is_swinging).collect()
}

impl Leg {
    fn find(names: &[String], of: &[&str]) -> Option<Leg> {
        let find = |name: &str| names.iter().position(|n| n == name);
        Some(Leg {
            hip: find(of[0])?,
            knee: find(of[1])?,
            ankle: find(of[2])?,
            toes: find(of[3]),
            is_left: of[0] == CMU[1],
        })
    }

    /// Holds the foot in the gaps of its ankle and toes.
    fn hold(
        &self,
        take: &Take<'_>,
        gaps: &[Gap],
        filled: &mut [Option<FilledGap>],
        other: Option<&Leg>,
        swings: &[bool],
    ) {
        let briefest = (BRIEFEST * take.rate).ceil() as usize;
        let of = |filled: &[Option<FilledGap>], p| completed(take, gaps, filled, p);
        let held_of = |filled: &[Option<FilledGap>], point: usize| {
            let path = of(filled, point);
            let Some(ground) = ground(&path) else {
                return Vec::new();
            };
            let of_point = |(k, gap): (usize, &Gap)| {
                let is_held = gap.point == point && gap.frames.len() >= briefest;
                filled[k].as_ref().filter(|_| is_held)?;
                Path {
                    at: &path,
                    ground,
                    rate: take.rate,
                    swings,
                }
                .held(k, gap)
            };
            gaps.iter().enumerate().filter_map(of_point).collect()
        };
        let ankle = held_of(filled, self.ankle);
        let toes = self.toes.map_or(Vec::new(), |p| held_of(filled, p));
        if ankle.is_empty() && toes.is_empty() {
            return;
        }
        let frames = take.xyz.nrows();
        let (ankle_by_frame, toes_by_frame) = (by_frame(&ankle, frames), by_frame(&toes, frames));
        let hips = other.map(|other| of(filled, other.hip));
        let joints = [self.hip, self.knee, self.ankle].map(|p| of(filled, p));
        let toe_path = self.toes.map(|p| of(filled, p));
        let mut put = |point: usize, t: usize, at: DVec3| {
            let mut all = gaps.iter().zip(filled.iter_mut());
            let is_here = |(gap, _): &(&Gap, _)| gap.point == point && gap.frames.contains(&t);
            if let Some((gap, Some(filled))) = all.find(is_here) {
                let row = &mut filled.xyz.row_mut(t - gap.frames.start);
                row.assign(&ArrayView1::from(&at.to_array()));
            }
        };
        let is_missing = |p: usize, t: usize| !point_at(take.xyz, t, p).is_finite();
        for t in 0..frames {
            let (by, toes_by) = (ankle_by_frame[t], toes_by_frame[t]);
            if by == DVec3::ZERO && toes_by == DVec3::ZERO {
                continue;
            }
            let [hip, knee, ankle] = [0, 1, 2].map(|k: usize| joints[k][t]);
            let limb = TwoBones { hip, knee, ankle };
            let mut stands = ankle;
            if by != DVec3::ZERO {
                let forward = hips.as_ref().map(|h| self.forward(&limb, h[t]));
                match is_missing(self.knee, t) {
                    true => {
                        let Some((knee, ankle)) = bent(&limb, by, forward) else {
                            continue;
                        };
                        put(self.knee, t, knee);
                        stands = ankle;
                    }
                    // The shin keeps its length on a knee that is seen.
                    false => stands = at_length(knee, ankle, ankle + by),
                }
                put(self.ankle, t, stands);
            }
            if let (Some(point), Some(path)) = (self.toes, &toe_path)
                && is_missing(point, t)
            {
                put(
                    point,
                    t,
                    stands
                        + (at_length(ankle, path[t], path[t] + toes_by + ankle - stands) - ankle),
                );
            }
        }
        for held in ankle.into_iter().chain(toes) {
            if let Some(filled) = &mut filled[held.gap] {
                filled.contacts = held.contacts;
            }
        }
    }

    /// The way that the body faces, across the leg.
    fn forward(&self, limb: &TwoBones, other_hip: DVec3) -> DVec3 {
        let across = match self.is_left {
            true => other_hip - limb.hip,
            false => limb.hip - other_hip,
        };
        across.cross(limb.ankle - limb.hip).normalize_or_zero()
    }
}

/// What is added to a point in every frame of a take.
fn by_frame(held: &[Held], frames: usize) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; frames];
    for held in held {
        out[held.frames.clone()].copy_from_slice(&held.offsets);
    }
    out
}

/// `to`, moved along the line from `from` to be as far away from it as `point` is.
fn at_length(from: DVec3, point: DVec3, to: DVec3) -> DVec3 {
    from + (to - from).normalize_or((point - from).normalize_or_zero()) * point.distance(from)
}

/// Knee and ankle of a leg whose ankle is moved.
fn bent(limb: &TwoBones, by: DVec3, forward: Option<DVec3>) -> Option<(DVec3, DVec3)> {
    let moved = (by.length() / MOVED).min(1.0);
    let pole = limb.bend() + FORWARD * moved * forward.unwrap_or_default();
    let reached = limb.reach(limb.ankle + by, pole, REACH)?;
    let knee = limb.hip + reached.upper * (limb.knee - limb.hip);
    (knee.is_finite() && reached.ankle.is_finite()).then_some((knee, reached.ankle))
}

/// The path of a point of a foot.
struct Path<'a> {
    /// (frames), cm.
    at: &'a [DVec3],
    /// Its height where it is low, cm.
    ground: f64,
    /// Frames a second.
    rate: f64,
    /// Where the other foot swings.
    swings: &'a [bool],
}

impl Path<'_> {
    /// What holds the point in a gap; `None` where it does not stand.
    fn held(&self, number: usize, gap: &Gap) -> Option<Held> {
        let goals = self.goals(gap);
        if goals.is_empty() {
            return None;
        }
        let frames = gap.frames.clone();
        let mut offsets = vec![DVec3::ZERO; frames.len()];
        let mut weights = vec![0.0; frames.len()];
        let mut contacts = Vec::new();
        for (range, [from, to]) in goals {
            for t in range.clone() {
                let share = (t + 1 - range.start) as f64 / (range.len() + 1) as f64;
                offsets[t - frames.start] = from.lerp(to, share) - self.at[t];
                weights[t - frames.start] = 1.0;
            }
            contacts.push(range.start - frames.start..range.end - frames.start);
        }
        let longest = (FADE * self.rate).round() as usize;
        fade(&contacts, longest, &mut offsets, &mut weights);
        offsets.iter().all(|o| o.is_finite()).then_some(Held {
            frames,
            offsets,
            contacts,
            gap: number,
        })
    }

    /// Where the point stands in a gap, in order, and the line that it stands on.
    fn goals(&self, gap: &Gap) -> Vec<(Range<usize>, [DVec3; 2])> {
        let frames = gap.frames.clone();
        let planted = |end: Option<usize>, inner: isize| {
            let place = self.at[end.filter(|end| self.is_planted(*end, inner))?];
            Some(place)
        };
        let (before, after) = (planted(gap.before, -1), planted(gap.after, 1));
        if let (Some(a), Some(b)) = (before, after) {
            let is_near = |t: usize| self.at[t].distance(a.midpoint(b)) < STRAYS;
            if a.distance(b) < SAME_PLACE && frames.clone().all(is_near) {
                return vec![(frames, [a, b])];
            }
        }
        let fades = ((FADE * self.rate).round() as usize).min(frames.len() / 2);
        let (first, last) = (frames.start + fades, frames.end - fades);
        let stays = |t: &usize, place: DVec3| {
            let away = self.at[*t].distance(place);
            away < NEAR && self.is_low(*t) && self.speed(*t) < SLOW
                || self.swings[*t] && away < NEAR_IN_SWING
        };
        let mut from = before.map_or(frames.start, |place| {
            let mut all = frames.start..last;
            all.find(|t| !stays(t, place)).unwrap_or(last)
        });
        let mut to = after.map_or(frames.end, |place| {
            let mut all = (first..frames.end).rev();
            all.find(|t| !stays(t, place)).map_or(first, |t| t + 1)
        });
        if from + fades > to {
            // Both would hold it: each up to where the way from one to the other begins.
            let middle = usize::midpoint(from, to);
            from = middle.saturating_sub(fades / 2).max(frames.start);
            to = (middle + fades.div_ceil(2)).min(frames.end);
        }
        let mut goals: Vec<(Range<usize>, [DVec3; 2])> = Vec::new();
        goals.extend(
            before
                .filter(|_| from > frames.start)
                .map(|a| (frames.start..from, [a, a])),
        );
        let limits = ContactLimits {
            speed: INSIDE_SPEED,
            height: LOW,
            seconds: INSIDE_SECONDS,
        };
        let least = (INSIDE_SECONDS * self.rate).ceil() as usize;
        for inside in contacts(self.at, self.rate, &limits) {
            let inside = inside.start.max(from).max(first)..inside.end.min(to).min(last);
            if inside.len() >= least {
                let place = self.middle(inside.clone());
                goals.push((inside, [place, place]));
            }
        }
        goals.extend(
            after
                .filter(|_| to < frames.end)
                .map(|b| (to..frames.end, [b, b])),
        );
        goals
    }

    /// Whether the point stands at the end of a gap, by the frames on its side.
    fn is_planted(&self, end: usize, inner: isize) -> bool {
        let count = ((END_SECONDS * self.rate).round() as isize).max(1);
        let Some(far) = end
            .checked_add_signed(inner * count)
            .filter(|t| *t < self.at.len())
        else {
            return false;
        };
        let speed = self.at[end].distance(self.at[far]) * self.rate / count as f64;
        speed < END_SPEED && self.is_low(end)
    }

    fn is_low(&self, t: usize) -> bool {
        self.at[t].y - self.ground < LOW
    }

    fn speed(&self, t: usize) -> f64 {
        speed(self.at, t, self.rate)
    }

    /// The median of each coordinate over some frames.
    fn middle(&self, frames: Range<usize>) -> DVec3 {
        let of = |c: usize| median(self.at[frames.clone()].iter().map(|p| p[c]).collect());
        DVec3::from_array([0, 1, 2].map(|c| of(c).unwrap_or(0.0)))
    }
}
