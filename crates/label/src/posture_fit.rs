//! Where the labels are in every frame of a take, from those that are known: each as its most rigid
//! neighbors carry it, by the posture in which these are most as they are here.
//!
//! How rigid labels are with each other is learned of the take as soon as it moves, and how a
//! person's markers lie otherwise than in the labeled takes is as well.

use super::label_model::FittedLabels;
use super::marker_distances::Distances;
use super::posture_model::{PostureModel, looseness_of, stands};
use super::tuning::posture_fit::*;
use crate::numeric::parallel::map_chunks;
use crate::numeric::statistics::median;
use crate::pose::point_at;
use crate::pose::similarity::{Similarity, TransformKind, fit_similarity};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

/// What carries a label of a posture into a frame.
struct Carrier {
    to: Similarity,
    /// Where the label is in the posture.
    at: DVec3,
    /// How loose its neighbors are that are seen there, cm²: the third, as three carry it.
    loose: f64,
}

/// What carries a label in each frame.
struct Carried {
    carriers: Vec<Option<Carrier>>,
    /// How far its own positions are from where the postures have it, in axes of its neighbors, cm.
    off: Option<DVec3>,
    /// How much that changes, cm.
    spread: f64,
    /// In how many frames it is known.
    count: f64,
}

/// Fits the model to labels that are known in some frames (frames, 3 L; NaN is missing).
pub(super) fn fit(model: &PostureModel, known: ArrayView2<'_, f64>) -> FittedLabels {
    let labels = known.ncols() / 3;
    let looseness = looseness(model, known);
    let others = |label: usize| {
        let mut all: Vec<usize> = (0..labels).filter(|l| *l != label).collect();
        let loose = |l: &usize| looseness[[label, *l]];
        all.sort_by(|a, b| loose(a).total_cmp(&loose(b)));
        all
    };
    let fit = Fit {
        model,
        known,
        size: size(model, known, &looseness),
        others: (0..labels).map(others).collect(),
        looseness,
    };
    let carried = map_chunks(labels, 1, |range| fit.carried(range.start));
    let offs = carried.iter().filter_map(|c| Some(c.off?.length()));
    let unlike = median(offs.collect()).unwrap_or(0.0);
    let usual = (UNLIKE * unlike).max(LEAST_UNLIKE);
    let places = map_chunks(labels, 1, |range| {
        let (label, own) = (range.start, &carried[range.start]);
        let off = own.off.unwrap_or(DVec3::ZERO);
        // What lies otherwise than the labels of people do is not believed: it may be another.
        let odd = off.length() / usual;
        let share = own.count / (own.count + BELIEVED) / (1.0 + (odd / ODD).powi(4));
        let place = |carrier: &Option<Carrier>| match carrier {
            Some(c) => c.to.apply(c.at) + c.to.rotation * (share * off),
            None => DVec3::NAN,
        };
        let places: Vec<DVec3> = own.carriers.iter().map(place).collect();
        fit.carried_on(label, own, &places)
    });
    let places = Array2::from_shape_fn(known.raw_dim(), |(t, c)| places[c / 3][t][c % 3]);
    // How far a label may move against its neighbors.
    let loose = |label: usize| {
        let third = fit.others[label].get(2);
        third.map_or(0.0, |l| fit.looseness[[label, *l]].sqrt())
    };
    let reach = |label: usize| {
        let far = unlike + carried[label].spread + loose(label);
        (LEAST_REACH + far / REACHES).min(1.0)
    };
    let deviations: Vec<f64> = (0..labels)
        .map(|label| {
            let sd = usual.hypot(carried[label].spread);
            let off = carried[label].off.map_or(0.0, DVec3::length);
            off / sd.hypot(model.spreads[label])
        })
        .collect();
    // Postures that are those of other labels are nobody's.
    let odd = deviations.iter().filter(|d| **d >= MISPLACED).count() as f64;
    let is_other = unlike > OTHER * fit.size || odd > MOST_MISPLACED * labels as f64;
    let deviation = |d: f64| if is_other { f64::INFINITY } else { d };
    let sd = |own: &Carried| own.off.map_or(UNKNOWN * usual, |_| own.spread);
    FittedLabels {
        places,
        reach: (0..labels).map(reach).collect(),
        sd: carried.iter().map(sd).collect(),
        deviations: deviations.into_iter().map(deviation).collect(),
    }
}

/// How much distances change: in the takes that were learned from, and in this one if it moves.
fn looseness(model: &PostureModel, known: ArrayView2<'_, f64>) -> Array2<f64> {
    let own = Distances::measure(known);
    let mut all = model.looseness.clone();
    if stands(&own) {
        return all;
    }
    for ((a, b), to) in all.indexed_iter_mut() {
        if let Some(own) = own.between(a, b) {
            let frames = own.frames as f64;
            let variance = looseness_of(own.spread, own.median);
            *to = (*to * LEARNED + variance * frames) / (LEARNED + frames);
        }
    }
    all
}

/// The size of the body, of that of the postures.
fn size(model: &PostureModel, known: ArrayView2<'_, f64>, looseness: &Array2<f64>) -> f64 {
    let step = known.nrows().div_ceil(SIZED_FRAMES).max(1);
    let mut ratios = Vec::new();
    let labels = known.ncols() / 3;
    for a in 0..labels {
        for b in 0..a {
            let there = model.postures.iter().map(|p| p[a].distance(p[b]));
            let Some(long) = median(there.filter(|d| d.is_finite()).collect()) else {
                continue;
            };
            if long < LONG || looseness[[a, b]] > (STEADY * long).powi(2) {
                continue;
            }
            let own = (0..known.nrows()).step_by(step);
            let own = own.map(|t| point_at(known, t, a).distance(point_at(known, t, b)));
            let own = median(own.filter(|d| d.is_finite()).collect());
            ratios.extend(own.map(|own| own / long));
        }
    }
    let is_enough = ratios.len() >= FEWEST_RATIOS;
    let size = median(ratios).filter(|_| is_enough);
    size.map_or(1.0, |s| s.clamp(SIZES[0], SIZES[1]))
}

struct Fit<'a> {
    model: &'a PostureModel,
    known: ArrayView2<'a, f64>,
    size: f64,
    looseness: Array2<f64>,
    /// The other labels of each, the most rigid with it first.
    others: Vec<Vec<usize>>,
}

impl Fit<'_> {
    fn carried(&self, label: usize) -> Carried {
        let carriers: Vec<Option<Carrier>> = (0..self.known.nrows())
            .map(|t| self.carrier(label, t))
            .collect();
        let own = carriers.iter().enumerate().filter_map(|(t, carrier)| {
            let Carrier { to, at, .. } = carrier.as_ref()?;
            let off = point_at(self.known, t, label) - to.apply(*at);
            let off = to.rotation.transpose() * off;
            off.is_finite().then_some(off)
        });
        let offs: Vec<DVec3> = own.collect();
        let middle = [0, 1, 2].map(|c| median(offs.iter().map(|o| o[c]).collect()));
        let off = match middle {
            [Some(x), Some(y), Some(z)] if offs.len() >= FEWEST => Some(DVec3::new(x, y, z)),
            _ => None,
        };
        let about = off.unwrap_or(DVec3::ZERO);
        let spread = median(offs.iter().map(|o| o.distance(about)).collect());
        Carried {
            carriers,
            off,
            spread: spread.unwrap_or(0.0),
            count: offs.len() as f64,
        }
    }

    /// What carries a label of a posture into a frame, by its neighbors, and where it is there.
    fn carrier(&self, label: usize, t: usize) -> Option<Carrier> {
        let seen = self.others[label].iter().filter_map(|l| {
            let at = point_at(self.known, t, *l);
            at.is_finite().then_some((*l, at))
        });
        let seen: Vec<(usize, DVec3)> = seen.take(NEIGHBORS).collect();
        if seen.len() < 3 {
            return None;
        }
        let misfit = |posture: &&Vec<DVec3>| {
            let first = &seen[..seen.len().min(COMPARED)];
            let mut sum = 0.0;
            for (k, (a, at)) in first.iter().enumerate() {
                for (b, to) in &first[..k] {
                    let there = self.size * posture[*a].distance(posture[*b]);
                    sum += (at.distance(*to) - there).powi(2);
                }
            }
            if sum.is_finite() && posture[label].is_finite() {
                sum
            } else {
                f64::INFINITY
            }
        };
        let postures = self.model.postures.iter();
        let posture = postures.min_by(|a, b| misfit(a).total_cmp(&misfit(b)))?;
        let mut pairs: Vec<(DVec3, DVec3, f64)> = seen
            .iter()
            .filter(|(l, _)| posture[*l].is_finite())
            .map(|(l, at)| {
                let loose = self.looseness[[label, *l]] + STIFF * STIFF;
                (self.size * posture[*l], *at, 1.0 / (loose * loose))
            })
            .collect();
        let weights: Vec<f64> = pairs.iter().map(|p| p.2).collect();
        let mut fit = fit_similarity(pairs.iter().copied(), TransformKind::Rigid)?;
        // One of them that is named wrongly shall carry nothing.
        let offs = pairs
            .iter()
            .map(|(a, b, _)| fit.similarity.apply(*a).distance(*b));
        let offs: Vec<f64> = offs.collect();
        let usual = median(offs.clone())?.max(STIFF);
        for ((pair, weight), off) in pairs.iter_mut().zip(weights).zip(offs) {
            pair.2 = weight / (1.0 + (off / (2.0 * usual)).powi(2));
        }
        fit = fit_similarity(pairs.into_iter(), TransformKind::Rigid)?;
        let at = self.size * posture[label];
        let carrier = Carrier {
            to: fit.similarity,
            at,
            loose: self.looseness[[label, seen[2].0]],
        };
        (fit.determined && at.is_finite()).then_some(carrier)
    }

    /// The places of a label; where too few of its rigid neighbors are seen, as the others carry it
    /// on from the frames nearby in which more of them are, and none where these are far.
    fn carried_on(&self, label: usize, own: &Carried, places: &[DVec3]) -> Vec<DVec3> {
        let loose = |t: &usize| own.carriers[*t].as_ref().map_or(f64::INFINITY, |c| c.loose);
        let least = (0..places.len())
            .map(|t| loose(&t))
            .fold(f64::INFINITY, f64::min);
        let is_held = |t: &usize| loose(t) <= LOOSER * least + STIFF * STIFF;
        let held: Vec<usize> = (0..places.len()).filter(is_held).collect();
        let on = |t: usize| {
            if is_held(&t) {
                return places[t];
            }
            let next = held.partition_point(|h| *h < t);
            let nearby = [next.checked_sub(1), Some(next)];
            let nearby = nearby.into_iter().flatten().filter_map(|n| held.get(n));
            let from = nearby.min_by_key(|h| h.abs_diff(t));
            let from = from.filter(|h| h.abs_diff(t) <= NEARBY);
            from.and_then(|h| self.moved(label, places[*h], [*h, t]))
                .unwrap_or(DVec3::NAN)
        };
        (0..places.len()).map(on).collect()
    }

    /// Where the neighbors of a label carry it from one frame to another.
    fn moved(&self, label: usize, at: DVec3, [from, to]: [usize; 2]) -> Option<DVec3> {
        let pair = |l: &usize| {
            let [a, b] = [from, to].map(|t| point_at(self.known, t, *l));
            let loose = self.looseness[[label, *l]] + STIFF * STIFF;
            (a - b).is_finite().then_some((a, b, 1.0 / (loose * loose)))
        };
        let pairs = self.others[label].iter().filter_map(pair).take(NEIGHBORS);
        let pairs: Vec<(DVec3, DVec3, f64)> = pairs.collect();
        let fit = fit_similarity(pairs.iter().copied(), TransformKind::Rigid)?;
        (pairs.len() >= 3 && fit.determined).then(|| fit.similarity.apply(at))
    }
}
