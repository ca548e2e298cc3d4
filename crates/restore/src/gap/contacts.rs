//! Feet that stand in a gap of their leg.
//!
//! The path that fills the gap of an ankle or of toes floats a little where the foot stands. It
//! stands all through the gap where it does so in one position at both ends; from a planted end on
//! while its path stays near, or while the other foot swings; and between where its path is slow
//! and low. There it is held, and what was added fades. The knee follows by two-bone inverse
//! kinematics; bones keep their lengths. Deviations stay those of the path, and other points of the
//! leg where they were filled.

use super::tuning::contacts::*;
use super::{FilledGap, Gap};
use crate::numeric::statistics::median;
use crate::pose::foot_contacts::{ContactLimits, contacts, fade, ground, speed};
use crate::pose::joints::CMU;
use crate::pose::point_at;
use crate::pose::two_bone::TwoBones;
use crate::take::Take;
use glam::DVec3;
use ndarray::ArrayView1;
use std::ops::Range;

/// Holds the feet of filled gaps where they stand, in tables of CMU's names.
pub(crate) fn hold(take: &Take<'_>, gaps: &[Gap], filled: &mut [Option<FilledGap>]) {
    let legs = [&CMU[1..5], &CMU[5..9]].map(|names| Leg::find(take.names, names));
    let root = take.names.iter().position(|n| *n == CMU[0]);
    for (leg, other) in [(&legs[0], &legs[1]), (&legs[1], &legs[0])] {
        let Some(leg) = leg else { continue };
        let completed = |point| completed(take, gaps, filled, point);
        let paths = LegPaths {
            limb: [leg.hip, leg.knee, leg.ankle].map(completed),
            toes: leg.toes.map(completed),
            other_hip: other.as_ref().map(|other| completed(other.hip)),
            is_left: leg.is_left,
        };
        let Some(unit) = paths.unit() else { continue };
        let scale = [take.rate, unit];
        let swings = match (other, root) {
            (Some(other), Some(root)) => swings(&completed(other.ankle), &completed(root), scale),
            _ => vec![false; take.xyz.nrows()],
        };
        // An ankle whose knee or toes are seen is known better, and so are toes with their ankle.
        let held_of = |point: Option<usize>, beside: [Option<usize>; 2]| {
            let is_open = |k: usize| {
                let is_free = |p: &usize| is_unseen(take, *p, gaps[k].frames.clone());
                filled[k].is_some() && beside.iter().flatten().all(is_free)
            };
            let of = |point| held_of(point, gaps, &is_open, (&completed(point), &swings), scale);
            point.map(of).unwrap_or_default()
        };
        let ankle = held_of(Some(leg.ankle), [Some(leg.knee), leg.toes]);
        let toes = held_of(leg.toes, [Some(leg.ankle), None]);
        if !(ankle.is_empty() && toes.is_empty()) {
            leg.put(&paths, [ankle, toes], gaps, filled);
        }
    }
}

/// Whether a point has no position in any of these frames.
fn is_unseen(take: &Take<'_>, point: usize, mut frames: Range<usize>) -> bool {
    frames.all(|t| !point_at(take.xyz, t, point).is_finite())
}

/// The points of a leg.
struct Leg {
    hip: usize,
    knee: usize,
    ankle: usize,
    toes: Option<usize>,
    is_left: bool,
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

    /// Puts the filled points of the leg where `held` has its ankle and its toes stand.
    fn put(
        &self,
        paths: &LegPaths,
        held: [Vec<Held>; 2],
        gaps: &[Gap],
        filled: &mut [Option<FilledGap>],
    ) {
        let frames = paths.limb[0].len();
        let points = [Some(self.knee), Some(self.ankle), self.toes];
        let gap_of = points.map(|point| point.map(|p| gaps_by_frame(gaps, p, frames)));
        let [by, toes_by] = [0, 1].map(|k: usize| by_frame(&held[k], frames));
        for t in 0..frames {
            let moved = paths.moved(t, [by[t], toes_by[t]]);
            for (gap_of, position) in gap_of.iter().zip(moved) {
                let gap = gap_of.as_ref().and_then(|of| of[t]);
                if let (Some(k), Some(position)) = (gap, position)
                    && let Some(filled) = &mut filled[k]
                {
                    let mut row = filled.xyz.row_mut(t - gaps[k].frames.start);
                    row.assign(&ArrayView1::from(&position.to_array()));
                }
            }
        }
        for mut held in held.into_iter().flatten() {
            let is_there = |k: usize| paths.limb[0][held.frames.start + k].is_finite();
            held.contacts.retain(|c| c.clone().all(is_there));
            if let Some(filled) = &mut filled[held.gap] {
                filled.contacts = held.contacts;
            }
        }
    }
}

/// What is added to the path of a point in its gap.
struct Held {
    /// The frames of the gap.
    frames: Range<usize>,
    offsets: Vec<DVec3>,
    /// Where it stands, counted from the first of them.
    contacts: Vec<Range<usize>>,
    /// Which gap it is.
    gap: usize,
}

/// The position of a point in every frame, filled where a gap of it is.
fn completed(
    take: &Take<'_>,
    gaps: &[Gap],
    filled: &[Option<FilledGap>],
    point: usize,
) -> Vec<DVec3> {
    let seen = |t| point_at(take.xyz, t, point);
    let mut track: Vec<DVec3> = (0..take.xyz.nrows()).map(seen).collect();
    for (gap, filled) in gaps.iter().zip(filled).filter(|(g, _)| g.point == point) {
        let Some(filled) = filled else { continue };
        for (k, t) in gap.frames.clone().enumerate() {
            track[t] = point_at(filled.xyz.view(), k, 0);
        }
    }
    track
}

/// Which gap of a point each frame is in.
fn gaps_by_frame(gaps: &[Gap], point: usize, frames: usize) -> Vec<Option<usize>> {
    let mut out = vec![None; frames];
    for (k, gap) in gaps.iter().enumerate().filter(|(_, g)| g.point == point) {
        out[gap.frames.clone()].fill(Some(k));
    }
    out
}

/// The frames in which a foot swings, by its ankle and the root, at `rate` frames a second; `unit`:
/// what counts as a centimeter.
fn swings(ankle: &[DVec3], root: &[DVec3], [rate, unit]: [f64; 2]) -> Vec<bool> {
    let is_swinging = |t: usize| {
        let usual = speed(root, t, rate).max(ROOT_SPEED * unit);
        speed(ankle, t, rate) > (SWING * unit).max(SWING_MORE * unit + usual)
    };
    (0..ankle.len()).map(is_swinging).collect()
}

/// What holds a point in those of its gaps that `is_open` allows, its completed path being `at`.
fn held_of(
    point: usize,
    gaps: &[Gap],
    is_open: &dyn Fn(usize) -> bool,
    (at, swings): (&[DVec3], &[bool]),
    [rate, unit]: [f64; 2],
) -> Vec<Held> {
    let Some(ground) = ground(at) else {
        return Vec::new();
    };
    let briefest = (BRIEFEST * rate).ceil() as usize;
    let is_held = |(k, gap): &(usize, &Gap)| {
        // A foot that is never seen may stand anywhere.
        let is_seen = gap.before.or(gap.after).is_some();
        gap.point == point && gap.frames.len() >= briefest && is_seen && is_open(*k)
    };
    let all: Vec<(usize, &Gap)> = gaps.iter().enumerate().filter(is_held).collect();
    if all.is_empty() {
        return Vec::new();
    }
    let limits = ContactLimits {
        speed: INSIDE_SPEED * unit,
        height: LOW * unit,
        seconds: INSIDE_SECONDS,
    };
    let path = Path {
        at,
        ground,
        rate,
        unit,
        swings,
        slow: contacts(at, rate, &limits),
    };
    all.into_iter()
        .filter_map(|(k, gap)| path.held(k, gap))
        .collect()
}

/// What is added to a point in every frame of a take.
fn by_frame(held: &[Held], frames: usize) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; frames];
    for held in held {
        out[held.frames.clone()].copy_from_slice(&held.offsets);
    }
    out
}

/// The completed paths of a leg's points.
struct LegPaths {
    /// Hip, knee and ankle.
    limb: [Vec<DVec3>; 3],
    toes: Option<Vec<DVec3>>,
    other_hip: Option<Vec<DVec3>>,
    is_left: bool,
}

impl LegPaths {
    /// What counts as a centimeter: the leg over an adult's. `None` where it does not stand upright
    /// in most frames, as where y is not up, or is never seen whole.
    fn unit(&self) -> Option<f64> {
        let [hip, knee, ankle] = &self.limb;
        let frames = 0..hip.len();
        let of = |f: &dyn Fn(usize) -> f64| {
            median(frames.clone().map(f).filter(|v| v.is_finite()).collect())
        };
        let leg = of(&|t| hip[t].distance(knee[t]) + knee[t].distance(ankle[t]))?;
        let up = of(&|t| (hip[t] - ankle[t]).y / hip[t].distance(ankle[t]))?;
        (up > UPRIGHT && leg > 0.0).then_some(leg / LEG)
    }

    /// Where knee, ankle and toes go in a frame if so much is added to ankle and toes; `None` where
    /// they stay.
    fn moved(&self, t: usize, [by, toes_by]: [DVec3; 2]) -> [Option<DVec3>; 3] {
        let [hip, knee, ankle] = [0, 1, 2].map(|k: usize| self.limb[k][t]);
        let limb = TwoBones { hip, knee, ankle };
        let bent = if by == DVec3::ZERO {
            None
        } else {
            bent(&limb, by, self.forward(t, &limb))
        };
        let (new_knee, new_ankle) = bent.map_or((None, None), |(k, a)| (Some(k), Some(a)));
        let stands = new_ankle.unwrap_or(ankle);
        let is_moved = toes_by != DVec3::ZERO || new_ankle.is_some();
        let toes = self.toes.as_ref().filter(|_| is_moved).map(|path| {
            // The foot keeps its length.
            let to = path[t] + toes_by + ankle - stands;
            stands + at_length(ankle, path[t], to) - ankle
        });
        [new_knee, new_ankle, toes].map(|position| position.filter(|p| p.is_finite()))
    }

    /// The way that the body faces, across the leg.
    fn forward(&self, t: usize, limb: &TwoBones) -> DVec3 {
        let across = match &self.other_hip {
            Some(other) if self.is_left => other[t] - limb.hip,
            Some(other) => limb.hip - other[t],
            None => DVec3::ZERO,
        };
        across.cross(limb.ankle - limb.hip).normalize_or_zero()
    }
}

/// `to`, moved along the line from `from` to be as far away from it as `point` is.
fn at_length(from: DVec3, point: DVec3, to: DVec3) -> DVec3 {
    from + (to - from).normalize_or((point - from).normalize_or_zero()) * point.distance(from)
}

/// Knee and ankle of a leg whose ankle is moved; `forward` is where knees bend to.
fn bent(limb: &TwoBones, by: DVec3, forward: DVec3) -> Option<(DVec3, DVec3)> {
    let moved = (by.length() / MOVED).min(1.0);
    let pole = limb.bend() + FORWARD * moved * forward;
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
    /// What counts as a centimeter: bodies differ in size.
    unit: f64,
    /// Where the other foot swings.
    swings: &'a [bool],
    /// Where it is slow and low, in order.
    slow: Vec<Range<usize>>,
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
            let position = self.at[end.filter(|end| self.is_planted(*end, inner))?];
            Some(position)
        };
        let (before, after) = (planted(gap.before, -1), planted(gap.after, 1));
        if let (Some(a), Some(b)) = (before, after) {
            let is_near = |t: usize| self.at[t].distance(a.midpoint(b)) < STRAYS * self.unit;
            if a.distance(b) < SAME_PLACE * self.unit && frames.clone().all(is_near) {
                return vec![(frames, [a, b])];
            }
        }
        let fades = ((FADE * self.rate).round() as usize).min(frames.len() / 2);
        let (first, last) = (frames.start + fades, frames.end - fades);
        let stays = |t: &usize, position: DVec3| {
            let away = self.at[*t].distance(position) / self.unit;
            away < NEAR && self.is_low(*t) && self.speed(*t) < SLOW * self.unit
                || self.swings[*t] && away < NEAR_IN_SWING && self.height(*t) < HIGHEST
        };
        let mut from = before.map_or(frames.start, |position| {
            let mut all = frames.start..last;
            all.find(|t| !stays(t, position)).unwrap_or(last)
        });
        let mut to = after.map_or(frames.end, |position| {
            let mut all = (first..frames.end).rev();
            all.find(|t| !stays(t, position)).map_or(first, |t| t + 1)
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
        let least = (INSIDE_SECONDS * self.rate).ceil() as usize;
        // Between what is held there is room for the way from one position to the other.
        let mut free = from + fades;
        let first = self.slow.partition_point(|slow| slow.end <= free);
        for slow in &self.slow[first..] {
            let inside = slow.start.max(free)..slow.end.min(to.saturating_sub(fades));
            if inside.len() < least {
                continue;
            }
            free = inside.end + fades;
            let position = self.middle(inside.clone());
            goals.push((inside, [position, position]));
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
        speed < END_SPEED * self.unit && self.is_low(end)
    }

    /// Over the ground, as an adult's.
    fn height(&self, t: usize) -> f64 {
        (self.at[t].y - self.ground) / self.unit
    }

    fn is_low(&self, t: usize) -> bool {
        self.height(t) < LOW
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::FillMethod;
    use ndarray::{Array2, s};

    const FRAMES: usize = 200;

    /// The left leg of a body that steps forward once, at 100 frames a second: hip, knee, ankle and
    /// toes, with a knee that bends.
    fn take() -> Array2<f64> {
        let mut xyz = Array2::zeros((FRAMES, 12));
        for t in 0..FRAMES {
            let swing = ((t as f64 - 120.0) / 30.0).clamp(0.0, 1.0);
            let lift = 12.0 * (std::f64::consts::PI * swing).sin();
            let ankle = DVec3::new(10.0, 8.0 + lift, 60.0 * swing);
            let hip = DVec3::new(10.0, 80.0, 0.3 * t as f64);
            let half = (ankle - hip) / 2.0;
            let side = half.cross(DVec3::X).normalize() * -1.0;
            let knee = hip + half + side * (1764.0 - half.length_squared()).max(1.0).sqrt();
            let toes = ankle + DVec3::new(0.0, -5.0, 14.0);
            for (k, p) in [hip, knee, ankle, toes].into_iter().enumerate() {
                let mut cells = xyz.slice_mut(s![t, 3 * k..3 * k + 3]);
                cells.assign(&ArrayView1::from(&p.to_array()));
            }
        }
        xyz
    }

    /// A take, and what becomes of a gap of knee, ankle and toes in it whose fill floats.
    fn held(
        frames: Range<usize>,
        floats: impl Fn(usize) -> DVec3,
    ) -> (Array2<f64>, Vec<FilledGap>) {
        let truth = take();
        let mut seen = truth.clone();
        seen.slice_mut(s![frames.clone(), 3..]).fill(f64::NAN);
        let gap = |point| Gap {
            point,
            frames: frames.clone(),
            before: Some(frames.start - 1),
            after: Some(frames.end),
        };
        let gaps: Vec<Gap> = (1..4).map(gap).collect();
        let fill = |gap: &Gap| {
            let columns = s![frames.clone(), 3 * gap.point..3 * gap.point + 3];
            let mut xyz = truth.slice(columns).to_owned();
            for (k, mut row) in xyz.outer_iter_mut().enumerate() {
                row += &ArrayView1::from(&floats(k).to_array());
            }
            Some(FilledGap {
                variance: vec![1.0; xyz.nrows()],
                xyz,
                method: FillMethod::Regression,
                contacts: Vec::new(),
            })
        };
        let mut filled: Vec<Option<FilledGap>> = gaps.iter().map(fill).collect();
        let names = [1, 2, 3, 4].map(|k: usize| CMU[k].to_string());
        let run = 0..FRAMES;
        let take = Take {
            names: &names,
            xyz: seen.view(),
            runs: std::slice::from_ref(&run),
            rate: 100.0,
            sd: None,
            motion: Default::default(),
        };
        hold(&take, &gaps, &mut filled);
        (truth, filled.into_iter().flatten().collect())
    }

    #[test]
    fn a_foot_that_stands_at_both_ends_stands_between() {
        let gap = 40..80;
        let wave = |k: usize| 3.0 * (k as f64 / 39.0 * std::f64::consts::PI).sin();
        let (truth, filled) = held(gap.clone(), |k| DVec3::new(wave(k), 0.0, -wave(k)));
        for (point, filled) in [(2, &filled[1]), (3, &filled[2])] {
            assert_eq!((filled.contacts.len(), &filled.contacts[0]), (1, &(0..40)));
            assert_eq!(filled.method_in(7), FillMethod::Contact);
            for (k, t) in gap.clone().enumerate() {
                let off = point_at(filled.xyz.view(), k, 0) - point_at(truth.view(), t, point);
                assert!(off.length() < 1e-6, "{point} {t}: {off}");
            }
        }
        // The thigh is as long as it was filled.
        for (k, t) in gap.enumerate() {
            let knee = point_at(filled[0].xyz.view(), k, 0);
            let float = DVec3::new(wave(k), 0.0, -wave(k));
            let was = point_at(truth.view(), t, 1) + float;
            let hip = point_at(truth.view(), t, 0);
            assert!((knee.distance(hip) - was.distance(hip)).abs() < 1e-9);
        }
    }

    #[test]
    fn a_foot_that_steps_stands_until_it_leaves() {
        let (truth, filled) = held(100..160, |k| DVec3::X * (k.min(59 - k) as f64 / 10.0));
        let ankle = &filled[1];
        assert!(ankle.contacts.len() == 2, "{:?}", ankle.contacts);
        assert!((15..=26).contains(&ankle.contacts[0].end));
        assert!((45..=56).contains(&ankle.contacts[1].start) && ankle.contacts[1].end == 60);
        assert_eq!(ankle.method_in(35), FillMethod::Regression);
        let at = |k: usize| point_at(ankle.xyz.view(), k, 0);
        let truth = |k: usize| point_at(truth.view(), 100 + k, 2);
        assert!(at(14).distance(truth(14)) < 1e-6);
        // Nothing jumps.
        for k in 1..60 {
            let own = truth(k).distance(truth(k - 1));
            assert!(at(k).distance(at(k - 1)) < own + 0.6, "{k}");
        }
    }

    #[test]
    fn brief_gaps_and_feet_in_the_air_are_left_alone() {
        let float = |_: usize| DVec3::X;
        assert!(held(40..50, float).1.iter().all(|f| f.contacts.is_empty()));
        let (truth, filled) = held(124..144, float);
        assert!(filled[1].contacts.is_empty());
        let off = point_at(filled[1].xyz.view(), 10, 0) - point_at(truth.view(), 134, 2);
        assert_eq!(off, DVec3::X);
    }
}
