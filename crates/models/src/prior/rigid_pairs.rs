//! Pairs of points at a rigid distance, such as the ends of a bone, learned from poses.
//!
//! A distance is rigid when it hardly changes *within* takes. Between takes it may: the lengths are
//! the person's, so they are kept body by body, one row for all takes that agree. Pairs that others
//! imply (the third side of a stretched chain) are left out, by Gram-Schmidt on the gradients of
//! the distances at one pose.

use crate::io::Model;
use crate::pose::ASF_UNIT_CM;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// A distance is rigid when its standard deviation within takes is below this, cm (0.03 asf).
const RIGID: f64 = 0.03 * ASF_UNIT_CM;
/// A point that moves less than this within takes, cm, stands still: the space fixes it.
const STILL: f64 = 1e-2;
/// What rounding alone may do to a length, cm; below it all pairs are alike.
const ROUNDING: f64 = 1e-3;
/// Takes whose lengths differ by no more than this, cm (and three deviations), are of one body.
const SAME_BODY: f64 = 0.05;
/// A pair whose gradient lies in the span of better ones but for this share is implied by them.
const IMPLIED: f64 = 0.1;
/// Largest numbers of pairs, bodies, points and sampled frames.
const MOST: (usize, usize, usize, usize) = (96, 256, 128, 4000);

/// Two points at a rigid distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// The points, the lower one first.
    pub ends: [usize; 2],
    /// The standard deviation of the distance within takes, cm.
    pub sd: f64,
    /// Whether both stand still in the model's space, so that nothing is gained from their
    /// distance there.
    pub still: bool,
}

/// The rigid pairs of some points, and how long they are in each body seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RigidPairs {
    /// n of them.
    pub pairs: Vec<Pair>,
    /// (bodies, n), cm.
    pub bodies: Array2<f64>,
    /// Each body's share of the poses.
    pub shares: Vec<f64>,
}

impl RigidPairs {
    /// Learns them from poses (m, 3 J) of some takes. None where nothing is rigid, or where takes
    /// are single frames.
    #[doc(hidden)]
    pub fn learn(xyz: ArrayView2<'_, f32>, takes: &[Range<usize>]) -> RigidPairs {
        let points = xyz.ncols() / 3;
        let sampled: Vec<Vec<usize>> = sample(takes);
        if !(2..=MOST.2).contains(&points) || sampled.is_empty() {
            return RigidPairs::default();
        }
        let still: Vec<bool> = (0..points)
            .map(|p| {
                (3 * p..3 * p + 3).all(|c| spread(&sampled, |t| f64::from(xyz[[t, c]])).1 < STILL)
            })
            .collect();
        let mut found: Vec<(Pair, Vec<f64>)> = Vec::new();
        for i in 0..points {
            for j in i + 1..points {
                let (means, sd) = spread(&sampled, |t| distance(xyz, t, i, j));
                let pair = Pair {
                    ends: [i, j],
                    sd,
                    still: still[i] && still[j],
                };
                if sd < RIGID && means.iter().all(|m| *m > ROUNDING) {
                    found.push((pair, means));
                }
            }
        }
        // The stiffest first, and of those the shortest: bones before what they imply.
        let key = |f: &(Pair, Vec<f64>)| ((f.0.sd / ROUNDING) as u64, f.1[0]);
        found.sort_by(|a, b| {
            let (x, y) = (key(a), key(b));
            x.0.cmp(&y.0)
                .then(x.1.total_cmp(&y.1))
                .then(a.0.ends.cmp(&b.0.ends))
        });
        let reference = sampled[0][sampled[0].len() / 2];
        let found = independent(found, xyz, reference);
        let weights: Vec<f64> = sampled.iter().map(|s| s.len() as f64).collect();
        of_bodies(found, &weights)
    }

    /// What parts agree on that were learned from other poses of the same points, `weights` being
    /// their numbers of poses: the pairs that are rigid in all of them, and the bodies of each.
    pub(crate) fn joined(parts: &[RigidPairs], weights: &[f64]) -> RigidPairs {
        let at = |part: &RigidPairs, ends| part.pairs.iter().position(|p| p.ends == ends);
        let mut found: Vec<(Pair, Vec<f64>)> = Vec::new();
        for pair in parts.first().map_or(&[][..], |first| &first.pairs) {
            let own: Option<Vec<(&RigidPairs, usize)>> = (parts.iter())
                .map(|part| at(part, pair.ends).map(|k| (part, k)))
                .collect();
            let Some(own) = own else { continue };
            let all = own.iter().map(|(part, k)| part.pairs[*k]);
            let joined = Pair {
                ends: pair.ends,
                sd: all.clone().map(|p| p.sd).fold(0.0, f64::max),
                still: all.clone().all(|p| p.still),
            };
            let lengths = own.iter().flat_map(|(part, k)| part.bodies.column(*k));
            found.push((joined, lengths.copied().collect()));
        }
        if found.is_empty() {
            return RigidPairs::default();
        }
        let weights: Vec<f64> = (parts.iter().zip(weights))
            .flat_map(|(part, w)| part.shares.iter().map(move |s| s * w))
            .collect();
        of_bodies(found, &weights)
    }

    /// Whether there is none.
    #[doc(hidden)]
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The pairs of a body that is the model's carried by a map: each length as much longer as in
    /// `to` (t, 3 J), which are the poses `from` carried by it.
    #[doc(hidden)]
    pub fn mapped(&self, from: ArrayView2<'_, f64>, to: ArrayView2<'_, f64>) -> RigidPairs {
        let mut out = self.clone();
        let rows = from.nrows().min(to.nrows());
        for (k, pair) in self.pairs.iter().enumerate() {
            let [i, j] = pair.ends;
            let mut ratios: Vec<f64> = (0..rows)
                .map(|t| distance(to, t, i, j) / distance(from, t, i, j))
                .filter(|r| r.is_finite() && *r > 0.0)
                .collect();
            ratios.sort_by(f64::total_cmp);
            if let Some(ratio) = ratios.get(ratios.len() / 2) {
                out.bodies.column_mut(k).mapv_inplace(|l| l * ratio);
                // What was rigid need not be once its bones have changed differently.
                let (low, high) = (
                    ratios[ratios.len() / 8],
                    ratios[ratios.len() - 1 - ratios.len() / 8],
                );
                let length = out.bodies.column(k).iter().sum::<f64>() / out.bodies.nrows() as f64;
                out.pairs[k].sd = pair.sd.hypot(0.5 * (high - low) / ratio * length);
            }
        }
        out
    }

    /// The rigid pairs of which these are the numbers, with their lengths.
    #[doc(hidden)]
    pub fn selected(&self, pairs: &[usize]) -> RigidPairs {
        RigidPairs {
            pairs: pairs.iter().map(|k| self.pairs[*k]).collect(),
            bodies: self.bodies.select(ndarray::Axis(1), pairs),
            shares: self.shares.clone(),
        }
    }

    /// Stores them as the arrays `rigid` (n, 4: both points, standard deviation, whether still) and
    /// `rigid_lengths` (bodies, 1 + n: the body's share first). Nothing is stored where nothing
    /// is rigid.
    pub(crate) fn write(&self, model: &mut Model) {
        if self.is_empty() {
            return;
        }
        let rigid = Array2::from_shape_fn((self.pairs.len(), 4), |(k, c)| {
            let pair = &self.pairs[k];
            match c {
                0 | 1 => pair.ends[c] as f32,
                2 => pair.sd as f32,
                _ => f32::from(u8::from(pair.still)),
            }
        });
        let lengths =
            Array2::from_shape_fn(
                (self.shares.len(), 1 + self.pairs.len()),
                |(b, c)| match c {
                    0 => self.shares[b] as f32,
                    _ => self.bodies[[b, c - 1]] as f32,
                },
            );
        model.insert("rigid", rigid);
        model.insert("rigid_lengths", lengths);
    }

    /// Reads what `RigidPairs::write` left; none where the model has none.
    ///
    /// # Errors
    /// Data: arrays that do not fit together or the points, or numbers out of range.
    pub fn read(model: &Model, source: &str) -> Result<RigidPairs> {
        let (Some(rigid), Some(lengths)) = (model.get("rigid"), model.get("rigid_lengths")) else {
            return Ok(RigidPairs::default());
        };
        let wrong = || {
            let what = "is not a list of rigid pairs with their lengths; train the model again";
            Err(Error::data(Place::file(source).part("rigid"), what))
        };
        let points = model.meta.points.len();
        let (n, bodies) = (rigid.nrows(), lengths.nrows());
        let fits = rigid.ncols() == 4 && lengths.ncols() == 1 + n && bodies > 0;
        // More are never learned; what they cost grows with their square.
        if !fits || n > MOST.0 || bodies > MOST.1 {
            return wrong();
        }
        let mut out = RigidPairs {
            pairs: Vec::with_capacity(n),
            bodies: lengths.slice(ndarray::s![.., 1..]).mapv(f64::from),
            shares: lengths.column(0).iter().map(|s| f64::from(*s)).collect(),
        };
        let index =
            |v: f32| (v >= 0.0 && v.fract() == 0.0 && (v as usize) < points).then_some(v as usize);
        for row in rigid.rows() {
            let (Some(i), Some(j)) = (index(row[0]), index(row[1])) else {
                return wrong();
            };
            if i == j || !(0.0..1e3).contains(&row[2]) {
                return wrong();
            }
            out.pairs.push(Pair {
                ends: [i, j],
                sd: f64::from(row[2]),
                still: row[3] != 0.0,
            });
        }
        let sound = |v: &f64| *v > 0.0 && v.is_finite();
        if !out.bodies.iter().all(sound) || !out.shares.iter().all(sound) {
            return wrong();
        }
        Ok(out)
    }
}

/// Evenly spaced rows of each take; takes of a single frame are left out.
fn sample(takes: &[Range<usize>]) -> Vec<Vec<usize>> {
    let most = (MOST.3 / takes.len().max(1)).max(8);
    let some = |t: &Range<usize>| {
        t.clone()
            .step_by(t.len().div_ceil(most).max(1))
            .collect::<Vec<_>>()
    };
    takes.iter().filter(|t| t.len() >= 2).map(some).collect()
}

/// The mean in each take, and the standard deviation within them.
fn spread(takes: &[Vec<usize>], value: impl Fn(usize) -> f64) -> (Vec<f64>, f64) {
    let (mut sum, mut count) = (0.0, 0usize);
    let means = takes
        .iter()
        .map(|take| {
            let values: Vec<f64> = take.iter().map(|&t| value(t)).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            sum += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            count += values.len() - 1;
            mean
        })
        .collect();
    (means, (sum / count.max(1) as f64).sqrt())
}

fn distance<T: Copy + Into<f64>>(xyz: ArrayView2<'_, T>, t: usize, i: usize, j: usize) -> f64 {
    let off = |c: usize| xyz[[t, 3 * i + c]].into() - xyz[[t, 3 * j + c]].into();
    (0..3).map(|c| off(c).powi(2)).sum::<f64>().sqrt()
}

/// The pairs that those before them do not imply; pairs that stand still imply nothing and are
/// kept.
fn independent(
    found: Vec<(Pair, Vec<f64>)>,
    xyz: ArrayView2<'_, f32>,
    reference: usize,
) -> Vec<(Pair, Vec<f64>)> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut kept = Vec::new();
    for one in found {
        if kept.len() >= MOST.0 {
            break;
        }
        if one.0.still {
            kept.push(one);
            continue;
        }
        let [i, j] = one.0.ends;
        let length = distance(xyz, reference, i, j).max(ROUNDING);
        let mut gradient = vec![0.0; xyz.ncols()];
        for c in 0..3 {
            let u = f64::from(xyz[[reference, 3 * i + c]] - xyz[[reference, 3 * j + c]]) / length;
            gradient[3 * i + c] = u / std::f64::consts::SQRT_2;
            gradient[3 * j + c] = -u / std::f64::consts::SQRT_2;
        }
        // Twice is enough.
        for _ in 0..2 {
            for b in &basis {
                let along: f64 = b.iter().zip(&gradient).map(|(b, g)| b * g).sum();
                gradient
                    .iter_mut()
                    .zip(b)
                    .for_each(|(g, b)| *g -= along * b);
            }
        }
        let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
        if norm > IMPLIED {
            gradient.iter_mut().for_each(|g| *g /= norm);
            basis.push(gradient);
            kept.push(one);
        }
    }
    kept
}

/// Puts takes of the same lengths together.
fn of_bodies(found: Vec<(Pair, Vec<f64>)>, weights: &[f64]) -> RigidPairs {
    let pairs: Vec<Pair> = found.iter().map(|f| f.0).collect();
    // (weight, Σ weight · lengths)
    let mut bodies: Vec<(f64, Vec<f64>)> = Vec::new();
    for (take, w) in weights.iter().enumerate() {
        let lengths: Vec<f64> = found.iter().map(|f| f.1[take]).collect();
        let same = |body: &(f64, Vec<f64>)| {
            let all = body.1.iter().zip(&lengths).zip(&pairs);
            all.into_iter()
                .all(|((sum, l), p)| (sum / body.0 - l).abs() <= SAME_BODY + 3.0 * p.sd)
        };
        match bodies.iter().position(same) {
            Some(at) => {
                let body = &mut bodies[at];
                body.0 += w;
                body.1
                    .iter_mut()
                    .zip(&lengths)
                    .for_each(|(s, l)| *s += w * l);
            }
            None if bodies.len() < MOST.1 => {
                bodies.push((*w, lengths.iter().map(|l| w * l).collect()))
            }
            None => {}
        }
    }
    let total: f64 = bodies.iter().map(|b| b.0).sum();
    RigidPairs {
        bodies: Array2::from_shape_fn((bodies.len(), pairs.len()), |(b, k)| {
            bodies[b].1[k] / bodies[b].0
        }),
        shares: bodies.iter().map(|b| b.0 / total).collect(),
        pairs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One take.
    fn one(rows: Range<usize>) -> Vec<Range<usize>> {
        vec![rows]
    }

    /// A hinge of two bars, and a point that wanders; the second take's bars are longer.
    fn hinge() -> Array2<f32> {
        Array2::from_shape_fn((200, 12), |(t, c)| {
            let long = if t < 100 { 10.0 } else { 12.0 };
            let a = t as f32 * 0.05;
            match c {
                3 => long,
                6 => long + long * a.cos(),
                7 => long * a.sin(),
                9..12 => (t * c) as f32 % 17.0,
                _ => 0.0,
            }
        })
    }

    #[test]
    fn bars_are_found_with_their_lengths_body_by_body() {
        let found = RigidPairs::learn(hinge().view(), &[0..100, 100..200]);
        let ends: Vec<[usize; 2]> = found.pairs.iter().map(|p| p.ends).collect();
        assert_eq!(ends, [[0, 1], [1, 2]]);
        assert!(found.pairs[0].still && !found.pairs[1].still);
        assert_eq!(found.bodies.dim(), (2, 2));
        for (b, long) in [10.0, 12.0].into_iter().enumerate() {
            assert!(found.bodies.row(b).iter().all(|l| (l - long).abs() <= 1e-4));
        }
        assert!((found.shares[0] - 0.5).abs() <= 1e-12);
    }

    #[test]
    fn they_travel_in_a_model_and_bad_ones_are_refused() {
        let found = RigidPairs::learn(hinge().view(), &[0..100, 100..200]);
        let points = ["a", "b", "c", "d"].map(String::from);
        let mut model = Model::new("gaussian", &points, "body");
        assert!(RigidPairs::read(&model, "m").unwrap().is_empty());
        found.write(&mut model);
        let read = RigidPairs::read(&model, "m").unwrap();
        assert_eq!(read.pairs.len(), 2);
        assert!(
            (&read.bodies - &found.bodies)
                .iter()
                .all(|d| d.abs() <= 1e-4)
        );
        for (name, at, value) in [
            ("rigid", [0, 0], 4.0),
            ("rigid", [0, 1], f32::NAN),
            ("rigid", [1, 2], -1.0),
            ("rigid_lengths", [0, 1], f32::NAN),
            ("rigid_lengths", [1, 0], 0.0),
        ] {
            let mut bad = model.clone();
            let mut array = bad.get(name).unwrap().into_owned();
            array[at] = value;
            bad.insert(name, array);
            assert!(RigidPairs::read(&bad, "m").is_err(), "{name} {at:?}");
        }
        let (rigid, lengths) = (
            Array2::from_shape_fn((MOST.0 + 1, 4), |(_, c)| [0.0, 1.0, 0.1, 1.0][c]),
            Array2::ones((1, MOST.0 + 2)),
        );
        model.insert("rigid", rigid);
        model.insert("rigid_lengths", lengths);
        assert!(RigidPairs::read(&model, "m").is_err());
    }

    #[test]
    fn joined_parts_keep_what_all_agree_on() {
        let (xyz, takes) = (hinge(), [0..100, 100..200]);
        let whole = RigidPairs::learn(xyz.view(), &takes);
        let parts = takes.map(|t| RigidPairs::learn(xyz.slice(ndarray::s![t, ..]), &one(0..100)));
        let joined = RigidPairs::joined(&parts, &[100.0, 100.0]);
        let ends =
            |all: &RigidPairs| -> Vec<[usize; 2]> { all.pairs.iter().map(|p| p.ends).collect() };
        assert_eq!(ends(&joined), ends(&whole));
        assert_eq!(joined.shares, whole.shares);
        assert!(
            (&joined.bodies - &whole.bodies)
                .iter()
                .all(|d| d.abs() <= 1e-4)
        );
        // The same body twice is one.
        let twice = [parts[0].clone(), parts[0].clone()];
        assert_eq!(RigidPairs::joined(&twice, &[3.0, 1.0]).shares, [1.0]);
        // A part where nothing is rigid says of no pair that it is.
        let none = [parts[0].clone(), RigidPairs::default()];
        assert!(RigidPairs::joined(&none, &[1.0, 1.0]).is_empty());
    }

    #[test]
    fn little_or_nothing_to_learn_from_gives_none() {
        let xyz = hinge();
        for takes in [vec![], vec![0..1, 1..2]] {
            assert!(RigidPairs::learn(xyz.view(), &takes).is_empty());
        }
        assert!(RigidPairs::learn(Array2::zeros((5, 6)).view(), &one(0..5)).is_empty());
        assert!(
            RigidPairs::learn(Array2::from_elem((5, 6), f32::NAN).view(), &one(0..5)).is_empty()
        );
    }

    #[test]
    fn another_body_has_other_lengths() {
        let xyz = hinge().mapv(f64::from);
        let found = RigidPairs::learn(hinge().view(), &one(0..100));
        let twice = found.mapped(xyz.view(), (&xyz * 2.0).view());
        assert!(twice.bodies.iter().all(|l| (l - 20.0).abs() <= 1e-3));
        assert!(twice.pairs.iter().all(|p| p.sd <= 1e-3));
    }
}
