//! The names of the points of single frames: postures of labeled takes put at the points, turned
//! about the vertical, and bent.
//!
//! In rounds, labels and points are assigned to each other within a gate that narrows; then each
//! label goes where the others carry it, at first all of them alike, at last those that are rigid
//! with it. It never carries itself: what is left between it and its point tells how well the names
//! fit. A frame is also tried from the frame beside it, which has bent by little.

use super::label_model::NamedFrame;
use super::posture_model::{PostureModel, middle};
use super::tuning::posture_search::*;
use crate::numeric::assignment::assign;
use crate::numeric::parallel::map_chunks;
use crate::numeric::statistics::median;
use crate::pose::similarity::{TransformKind, fit_similarity};
use glam::{DMat3, DVec3};

/// A posture put at the points of a frame.
#[derive(Debug, Clone)]
struct Put {
    posture: usize,
    /// Its size, of that of the posture.
    size: f64,
    /// Where its labels are.
    places: Vec<DVec3>,
    /// The point of each label.
    points: Vec<Option<usize>>,
    cost: f64,
}

/// Names the points of frames that follow each other.
pub(super) fn named_frames(model: &PostureModel, frames: &[Vec<DVec3>]) -> Vec<NamedFrame> {
    let search = Search { model };
    let mut found = map_chunks(frames.len(), 1, |range| {
        search.best(&frames[range.start], search.starts(&frames[range.start]), 0)
    });
    let of = |p: &Option<Put>| p.as_ref().map_or(f64::INFINITY, |p| p.cost);
    let best = (0..found.len()).min_by(|a, b| of(&found[*a]).total_cmp(&of(&found[*b])));
    let best = best.unwrap_or(0);
    let onward = (best + 1..found.len()).map(|n| [n - 1, n]);
    let back = (0..best).rev().map(|n| [n + 1, n]);
    for [beside, n] in onward.chain(back) {
        let Some(put) = &found[beside] else { continue };
        let moved = search.moved(put, &frames[beside], &frames[n]);
        let from_there = search.best(&frames[n], vec![moved], FROM_BESIDE);
        if of(&from_there) < of(&found[n]) {
            found[n] = from_there;
        }
    }
    let count = |put: &Put| put.points.iter().flatten().count() as f64;
    let most = found.iter().flatten().map(count).fold(0.0, f64::max);
    let named = |(points, put): (&Vec<DVec3>, Option<Put>)| {
        let mut labels = vec![None; points.len()];
        // A frame in which far fewer labels fit is in no posture that is known.
        let Some(put) = put.filter(|put| count(put) >= KNOWN_POSTURE * most) else {
            return NamedFrame {
                labels,
                cost: NOWHERE,
            };
        };
        for (label, n) in put.points.iter().enumerate() {
            if let Some(n) = n {
                labels[*n] = Some(label);
            }
        }
        NamedFrame {
            labels,
            cost: put.cost,
        }
    };
    frames.iter().zip(found).map(named).collect()
}

struct Search<'a> {
    model: &'a PostureModel,
}

impl Search<'_> {
    fn labels(&self) -> usize {
        self.model.looseness.nrows()
    }

    /// The postures in the middle of the points, turned; those nearest to them.
    fn starts(&self, points: &[DVec3]) -> Vec<Put> {
        let middle = middle(points);
        let put = |n: usize| {
            let (posture, yaw) = (n / YAWS, n % YAWS);
            let turn = DMat3::from_rotation_y(yaw as f64 / YAWS as f64 * std::f64::consts::TAU);
            let own = &self.model.postures[posture];
            let places: Vec<DVec3> = own.iter().map(|p| middle + turn * *p).collect();
            Put {
                cost: apart(&places, points),
                posture,
                size: 1.0,
                places,
                points: Vec::new(),
            }
        };
        let mut all: Vec<Put> = (0..YAWS * self.model.postures.len()).map(put).collect();
        all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        all.truncate(STARTS);
        all
    }

    /// A posture of the frame beside, moved as far as the points have moved.
    fn moved(&self, put: &Put, from: &[DVec3], to: &[DVec3]) -> Put {
        let off = middle(to) - middle(from);
        let mut put = put.clone();
        put.places.iter_mut().for_each(|p| *p += off);
        put
    }

    /// The best of some starts, from a round on.
    fn best(&self, points: &[DVec3], mut all: Vec<Put>, from: usize) -> Option<Put> {
        let shrink = (NARROW / WIDE).powf(1.0 / (GATES - 1) as f64);
        for round in from..GATES {
            let gate = WIDE * shrink.powi(round as i32);
            for put in &mut all {
                self.improve(points, put, gate);
            }
            all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            if HALVED.contains(&round) {
                all.truncate(all.len().div_ceil(2));
            }
        }
        let mut best = all.into_iter().next()?;
        for _ in 0..LAST_ROUNDS {
            self.improve(points, &mut best, NARROW);
        }
        Some(best)
    }

    /// A round: points for the labels, then places for them.
    fn improve(&self, points: &[DVec3], put: &mut Put, gate: f64) {
        put.points = assigned(points, &put.places, gate);
        if gate < SIZED {
            put.size = self.size(points, put);
        }
        let rest = &self.model.postures[put.posture];
        let seen: Vec<(usize, DVec3, f64)> = put
            .points
            .iter()
            .enumerate()
            .filter_map(|(l, n)| {
                let at = points[(*n)?];
                let off = at.distance_squared(put.places[l]);
                Some((l, at, 1.0 / (1.0 + off / (0.25 * gate * gate))))
            })
            .collect();
        let stiff = (STIFFER * gate).powi(2);
        let place = |label: usize| {
            let pairs = seen.iter().filter(|(l, ..)| *l != label);
            let pairs = pairs.map(|(l, at, weight)| {
                let loose = self.model.looseness[[label, *l]] + stiff;
                (put.size * rest[*l], *at, weight / (loose * loose))
            });
            let fit = fit_similarity(pairs, TransformKind::Rigid)?;
            let at = fit.similarity.apply(put.size * rest[label]);
            (fit.determined && at.is_finite()).then_some(at)
        };
        let places: Vec<Option<DVec3>> = (0..self.labels()).map(place).collect();
        for (to, at) in put.places.iter_mut().zip(places) {
            *to = at.unwrap_or(*to);
        }
        let cost = |(n, place): (&Option<usize>, &DVec3)| {
            let off = n.map_or(f64::INFINITY, |n| points[n].distance_squared(*place));
            1.0 + nats(off.min(NARROW * NARROW))
        };
        put.cost = put.points.iter().zip(&put.places).map(cost).sum();
    }

    /// The size of the body by the distances of labels that are rather rigid.
    fn size(&self, points: &[DVec3], put: &Put) -> f64 {
        let rest = &self.model.postures[put.posture];
        let known: Vec<(usize, DVec3)> = put
            .points
            .iter()
            .enumerate()
            .filter_map(|(l, n)| Some((l, points[(*n)?])))
            .collect();
        let mut ratios = Vec::new();
        for (k, (a, at)) in known.iter().enumerate() {
            for (b, to) in &known[..k] {
                let long = rest[*a].distance(rest[*b]);
                if long > LONG && self.model.looseness[[*a, *b]] < (STEADY * long).powi(2) {
                    ratios.push(at.distance(*to) / long);
                }
            }
        }
        let is_enough = ratios.len() >= FEWEST_RATIOS;
        let size = median(ratios).filter(|_| is_enough);
        size.map_or(put.size, |s| s.clamp(SIZES[0], SIZES[1]))
    }
}

/// The point of each label within a gate.
fn assigned(points: &[DVec3], places: &[DVec3], gate: f64) -> Vec<Option<usize>> {
    let is_wide = gate > EXACT;
    let cost = |l: usize, n: usize| {
        let far = places[l].distance_squared(points[n]);
        match far.is_finite() {
            true if is_wide => far,
            true => nats(far),
            false => f64::INFINITY,
        }
    };
    let alone = if is_wide {
        gate * gate
    } else {
        nats(gate * gate)
    };
    assign(places.len(), points.len(), alone, cost)
}

/// What a squared distance costs: that of the same person is exact mostly, and one that is not may
/// be any.
fn nats(far: f64) -> f64 {
    (far / (SD * SD)).ln_1p()
}

/// How far places and points are from each other's nearest: the mean, no distance over a limit.
fn apart(places: &[DVec3], points: &[DVec3]) -> f64 {
    let mut nearest = vec![FARTHEST * FARTHEST; points.len()];
    let (mut sum, mut count) = (0.0, 0.0);
    for place in places.iter().filter(|p| p.is_finite()) {
        let mut own = FARTHEST * FARTHEST;
        for (n, point) in points.iter().enumerate() {
            let far = place.distance_squared(*point);
            own = own.min(far);
            nearest[n] = nearest[n].min(far);
        }
        sum += own.sqrt();
        count += 1.0;
    }
    let back: f64 = nearest.iter().map(|far| far.sqrt()).sum();
    sum / f64::max(count, 1.0) + back / points.len().max(1) as f64
}
