//! Missing rotations and positions: three paths over a gap, weighed on gaps that are simulated
//! elsewhere in the take.
//!
//! ```text
//! result = s exp(w_h log(s'h) + w_g log(s'g)),   w ≥ 0, w_h + w_g ≤ 1
//!     s  the straight way between the frames beside the gap (slerp)
//!     h  a cubic with the velocities there (Hermite)
//!     g  ridge regression on the rotations of the other joints, learned in the take; what it
//!        misses at both ends is carried off linearly
//! ```
//!
//! The weights are those of least squares over up to n gaps of the same track and length, or where
//! none has room of half of it, and so on, times n / (n + 1); g is learned anew without each.
//! Nothing to compare with: the straight way.

use super::movement::{Movable, gaps, straight};
use super::tuning::*;
use crate::numeric::hermite::hermite;
use crate::numeric::linalg::Cholesky;
use glam::{DQuat, DVec3};
use ndarray::{Array2, ArrayView1};
use std::collections::HashMap;
use std::ops::Range;

/// A gap that was filled.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FilledGap {
    pub frames: Range<usize>,
    /// The error (rms, radians or cm) over gaps like it; NaN where there are none.
    pub error: f64,
}

/// What predicts a track: the rotations of others.
pub(super) struct Predictors {
    /// (frames, axes), radians from the mean rotation; missing ones on the straight way.
    values: Array2<f64>,
    /// The track of each column.
    tracks: Vec<usize>,
    /// Whether each track is seen, by frame.
    seen: Vec<Vec<bool>>,
    /// values' values, their sums and number: of all frames.
    sums: Sums,
}

/// Sums of products over frames.
#[derive(Clone)]
struct Sums {
    count: f64,
    /// (axes, axes) and (axes).
    xx: Array2<f64>,
    x: Vec<f64>,
    /// (axes, 3) and (3).
    xy: Array2<f64>,
    y: DVec3,
}

impl Sums {
    fn none(axes: usize) -> Sums {
        Sums {
            count: 0.0,
            xx: Array2::zeros((axes, axes)),
            x: vec![0.0; axes],
            xy: Array2::zeros((axes, 3)),
            y: DVec3::ZERO,
        }
    }

    /// Counts a frame's predictors `sign` times.
    fn add_predictors(&mut self, sign: f64, x: ArrayView1<'_, f64>) {
        self.count += sign;
        for (i, a) in x.iter().enumerate() {
            self.x[i] += sign * a;
            self.xx.row_mut(i).scaled_add(sign * a, &x);
        }
    }

    fn add_target(&mut self, sign: f64, x: ArrayView1<'_, f64>, y: DVec3) {
        self.y += sign * y;
        for (c, v) in y.to_array().into_iter().enumerate() {
            self.xy.column_mut(c).scaled_add(sign * v, &x);
        }
    }
}

impl Predictors {
    /// The predictors of rotations, with whether they are seen, and their free axes (1: about x, or
    /// 3).
    pub(super) fn new(tracks: &[(&[DQuat], &[bool], usize)], frames: usize) -> Predictors {
        let mut columns: Vec<(f64, usize, Vec<f64>)> = Vec::new();
        for (j, (rotations, _, axes)) in tracks.iter().enumerate() {
            let Some(mean) = DQuat::mean(rotations) else {
                continue;
            };
            let steps: Vec<DVec3> = rotations.iter().map(|q| q.off_mean(mean)).collect();
            let turns = steps.iter().map(|s| s.length_squared()).sum::<f64>();
            if turns <= STILL * STILL * frames as f64 {
                continue;
            }
            for c in 0..*axes {
                let column: Vec<f64> = steps.iter().map(|s| s[c]).collect();
                columns.push((column.iter().map(|v| v * v).sum(), j, column));
            }
        }
        columns.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        columns.truncate(MOST_PREDICTORS);
        let values = Array2::from_shape_fn((frames, columns.len()), |(t, c)| columns[c].2[t]);
        let mut sums = Sums::none(columns.len());
        sums.count = frames as f64;
        sums.xx = values.t().dot(&values);
        sums.x = values.sum_axis(ndarray::Axis(0)).to_vec();
        Predictors {
            tracks: columns.iter().map(|c| c.1).collect(),
            seen: tracks.iter().map(|t| t.1.to_vec()).collect(),
            values,
            sums,
        }
    }

    /// The columns that predict a track over frames: those of others that are seen there.
    fn columns(&self, own: Option<usize>, frames: &Range<usize>) -> Vec<usize> {
        let is_seen = |j: usize| frames.clone().all(|t| self.seen[j][t]);
        let serves = |c: &usize| Some(self.tracks[*c]) != own && is_seen(self.tracks[*c]);
        (0..self.tracks.len()).filter(serves).collect()
    }
}

/// A linear map from predictors to steps from a track's mean.
struct Regression {
    columns: Vec<usize>,
    /// (columns, 3).
    slopes: Array2<f64>,
    at: Vec<f64>,
    mean: DVec3,
}

impl Regression {
    fn new(sums: &Sums, columns: &[usize]) -> Option<Regression> {
        let n = sums.count;
        if n < 2.0 || columns.is_empty() {
            return None;
        }
        let at: Vec<f64> = columns.iter().map(|&c| sums.x[c] / n).collect();
        let mean = sums.y / n;
        let shape = (columns.len(), columns.len());
        let mut a = Array2::from_shape_fn(shape, |(i, j)| {
            sums.xx[[columns[i], columns[j]]] - n * at[i] * at[j]
        });
        a.diag_mut().mapv_inplace(|v| v + n * RIDGE);
        let b = Array2::from_shape_fn((columns.len(), 3), |(i, c)| {
            sums.xy[[columns[i], c]] - n * at[i] * mean[c]
        });
        let slopes = Cholesky::new(a)?.solve(&b)?;
        Some(Regression {
            columns: columns.to_vec(),
            slopes,
            at,
            mean,
        })
    }

    fn predict(&self, x: ArrayView1<'_, f64>) -> DVec3 {
        let columns = self.columns.iter().zip(&self.at).enumerate();
        columns.fold(self.mean, |sum, (i, (&c, at))| {
            let row = self.slopes.row(i);
            sum + (x[c] - at) * DVec3::new(row[0], row[1], row[2])
        })
    }
}

/// A track with gaps.
pub(super) struct Gappy<'a, M> {
    /// Missing ones on the straight way.
    pub values: &'a [M],
    pub seen: &'a [bool],
    pub predictors: &'a Predictors,
    /// Which of the predictors' tracks it is itself.
    pub own: Option<usize>,
    /// Seconds a frame.
    pub step: f64,
}

/// How the paths over gaps of one kind are weighed.
#[derive(Clone, Copy)]
struct Weights {
    hermite: f64,
    regression: f64,
    error: f64,
}

/// Gaps of one length with as much beside them and the same predictors share their weights.
#[derive(PartialEq, Eq, Hash)]
struct Kind {
    length: usize,
    has_sides: [bool; 2],
    columns: Vec<usize>,
}

/// The three paths over a gap: the straight one, and the steps from it to the others.
struct Paths<M> {
    straight: Vec<M>,
    hermite: Vec<DVec3>,
    regression: Vec<DVec3>,
}

impl<M: Movable> Gappy<'_, M> {
    /// The values over the gaps that are no longer than `longest` frames.
    pub(super) fn fill(&self, longest: usize) -> Vec<(FilledGap, Vec<M>)> {
        let mut all = gaps(self.seen);
        all.retain(|gap| gap.len() <= longest && gap.len() < self.seen.len());
        let seen: Vec<M> = (self.values.iter().zip(self.seen))
            .filter_map(|(v, s)| s.then_some(*v))
            .collect();
        let Some(mean) = M::mean(&seen).filter(|_| !all.is_empty()) else {
            return Vec::new();
        };
        let mut learned = None;
        let mut known: HashMap<Kind, (Weights, Option<Regression>)> = HashMap::new();
        let mut regressed = 0;
        let mut fill = |gap: Range<usize>| {
            let mut kind = self.kind(&gap);
            if !known.contains_key(&kind) && !kind.columns.is_empty() {
                regressed += 1;
                if regressed > MOST_REGRESSED {
                    kind.columns.clear();
                }
            }
            let has_sides = kind.has_sides;
            let (weights, regression) = &*known.entry(kind).or_insert_with_key(|kind| {
                let sums = if kind.columns.is_empty() {
                    None
                } else {
                    Some(&*learned.get_or_insert_with(|| self.sums(mean)))
                };
                let regression = sums.and_then(|sums| Regression::new(sums, &kind.columns));
                (self.weigh(kind, sums, mean), regression)
            });
            let paths = self.paths(&gap, has_sides, regression.as_ref(), mean);
            let filled = FilledGap {
                frames: gap,
                error: weights.error,
            };
            (filled, paths.mixed(*weights))
        };
        all.into_iter().map(&mut fill).collect()
    }

    /// What kind of gap one is; those that are short have no predictors.
    fn kind(&self, gap: &Range<usize>) -> Kind {
        let is_long = gap.len() as f64 * self.step > SHORT;
        Kind {
            length: gap.len(),
            has_sides: [gap.start > 0, gap.end < self.seen.len()],
            columns: if is_long {
                self.predictors.columns(self.own, gap)
            } else {
                Vec::new()
            },
        }
    }

    /// The sums over the frames in which the track is seen.
    fn sums(&self, mean: M) -> Sums {
        let predictors = self.predictors;
        let mut sums = predictors.sums.clone();
        for (t, x) in predictors.values.rows().into_iter().enumerate() {
            if self.seen[t] {
                sums.add_target(1.0, x, self.values[t].off_mean(mean))
            } else {
                sums.add_predictors(-1.0, x)
            }
        }
        sums
    }

    /// Weighs the paths over gaps of a kind.
    fn weigh(&self, kind: &Kind, sums: Option<&Sums>, mean: M) -> Weights {
        let simulated = self.simulated(kind);
        // The normal equations of the steps from the straight way.
        let (mut hh, mut hg, mut gg, mut hc, mut gc, mut cc) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for gap in &simulated {
            let regression = sums.and_then(|sums| {
                let mut sums = sums.clone();
                for t in gap.clone() {
                    let x = self.predictors.values.row(t);
                    sums.add_predictors(-1.0, x);
                    sums.add_target(-1.0, x, self.values[t].off_mean(mean));
                }
                Regression::new(&sums, &kind.columns)
            });
            let paths = self.paths(gap, kind.has_sides, regression.as_ref(), mean);
            for (k, t) in gap.clone().enumerate() {
                let (h, g) = (paths.hermite[k], paths.regression[k]);
                let c = paths.straight[k].step_to(self.values[t]);
                (hh, hg, gg) = (hh + h.dot(h), hg + h.dot(g), gg + g.dot(g));
                (hc, gc, cc) = (hc + h.dot(c), gc + g.dot(c), cc + c.dot(c));
            }
        }
        let cost = |[h, g]: [f64; 2]| {
            cc - 2.0 * (h * hc + g * gc) + h * h * hh + 2.0 * h * g * hg + g * g * gg
        };
        let [h, g] = least([hh, hg, gg], [hc, gc], cost);
        let n = simulated.len() as f64;
        let share = n / (n + 1.0);
        let is_alike = simulated.iter().all(|gap| gap.len() == kind.length);
        let frames = n * kind.length as f64;
        let error = (cost([share * h, share * g]).max(0.0) / frames).sqrt();
        Weights {
            hermite: share * h,
            regression: share * g,
            error: if is_alike { error } else { f64::NAN },
        }
    }

    /// Gaps of a kind, spread over the frames in which the track is seen; where none has room,
    /// half as long ones, and so on.
    fn simulated(&self, kind: &Kind) -> Vec<Range<usize>> {
        let sides = kind.has_sides.map(|has| if has { SIDE / 2 } else { 0 });
        let mut unseen = vec![0; self.seen.len() + 1];
        (0..self.seen.len()).for_each(|t| unseen[t + 1] = unseen[t] + usize::from(!self.seen[t]));
        let room = |length: usize| -> Vec<usize> {
            let needed = sides[0] + length + sides[1];
            let starts = 0..(self.seen.len() + 1).saturating_sub(needed);
            starts
                .filter(|&t| unseen[t + needed] == unseen[t])
                .collect()
        };
        let lengths = std::iter::successors(Some(kind.length), |length| Some(length / 2));
        let long = lengths.take_while(|length| *length > SIDE || *length == kind.length);
        let mut all = long.map(|length| (length, room(length)));
        let Some((length, room)) = all.find(|(_, room)| !room.is_empty()) else {
            return Vec::new();
        };
        let count = room.len().min(SIMULATED);
        // In the middle of as many parts of the room.
        let pick = |i: usize| room[(2 * i + 1) * room.len() / (2 * count)] + sides[0];
        (0..count).map(|i| pick(i)..pick(i) + length).collect()
    }

    /// The paths over a gap, of which the frames on the sides that it `has` are seen.
    fn paths(
        &self,
        gap: &Range<usize>,
        has: [bool; 2],
        regression: Option<&Regression>,
        mean: M,
    ) -> Paths<M> {
        let before = gap.start.checked_sub(1).filter(|_| has[0]);
        let after = Some(gap.end).filter(|_| has[1]);
        let straight = match (before, after) {
            (Some(_), Some(_)) => straight(self.values, gap),
            (one, other) => {
                let held = one.or(other).map(|t| self.values[t]);
                held.map_or(Vec::new(), |v| vec![v; gap.len()])
            }
        };
        let hermite = match (before, after) {
            (Some(_), Some(_)) => self.hermite(gap, &straight),
            _ => vec![DVec3::ZERO; gap.len()],
        };
        let regression = match regression {
            Some(regression) => {
                let at = |t: usize| mean.stepped(regression.predict(self.predictors.values.row(t)));
                let missed = |t: usize| at(t).step_to(self.values[t]);
                let (first, last) = (before.map(missed), after.map(missed));
                let [first, last] = [first.or(last), last.or(first)].map(Option::unwrap_or_default);
                let step = |(k, s): (usize, &M)| {
                    let share = (k + 1) as f64 / (gap.len() + 1) as f64;
                    s.step_to(at(gap.start + k).stepped(first.lerp(last, share)))
                };
                straight.iter().enumerate().map(step).collect()
            }
            None => vec![DVec3::ZERO; gap.len()],
        };
        Paths {
            straight,
            hermite,
            regression,
        }
    }

    /// The steps from the straight way to the cubic.
    fn hermite(&self, gap: &Range<usize>, straight: &[M]) -> Vec<DVec3> {
        let middle = straight[gap.len() / 2];
        let is_seen = |t: &usize| self.seen[*t];
        let first = (gap.start.saturating_sub(SIDE)..gap.start)
            .rev()
            .take_while(is_seen)
            .count();
        let last = (gap.end..(gap.end + SIDE).min(self.seen.len()))
            .take_while(is_seen)
            .count();
        let known: Vec<usize> = (gap.start - first..gap.start)
            .chain(gap.end..gap.end + last)
            .collect();
        let steps: Vec<DVec3> = known
            .iter()
            .map(|&t| middle.step_to(self.values[t]))
            .collect();
        let time = |t: usize| t as f64 * self.step;
        let x: Vec<f64> = known.iter().map(|&t| time(t)).collect();
        let at: Vec<f64> = gap.clone().map(time).collect();
        let paths = [0, 1, 2].map(|c| {
            let y: Vec<f64> = steps.iter().map(|s| s[c]).collect();
            hermite(&x, &y, first, &at, self.step)
        });
        let step = |(k, s): (usize, &M)| {
            s.step_to(middle.stepped(DVec3::from_array([0, 1, 2].map(|c| paths[c][k]))))
        };
        straight.iter().enumerate().map(step).collect()
    }
}

impl<M: Movable> Paths<M> {
    fn mixed(&self, weights: Weights) -> Vec<M> {
        let steps = self.hermite.iter().zip(&self.regression);
        let step = |((h, g), s): ((&DVec3, &DVec3), &M)| {
            s.stepped(weights.hermite * *h + weights.regression * *g)
        };
        steps.zip(&self.straight).map(step).collect()
    }
}

/// The weights (h, g) with h, g ≥ 0 and h + g ≤ 1 of least cost, by their normal equations.
fn least([hh, hg, gg]: [f64; 3], [hc, gc]: [f64; 2], cost: impl Fn([f64; 2]) -> f64) -> [f64; 2] {
    let ratio = |a: f64, b: f64| {
        if b > 1e-12 {
            (a / b).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    let determinant = hh * gg - hg * hg;
    let inside = if determinant > 1e-9 * hh * gg {
        [
            (hc * gg - gc * hg) / determinant,
            (gc * hh - hc * hg) / determinant,
        ]
    } else {
        [0.0; 2]
    };
    let is_allowed = |w: &[f64; 2]| w.iter().all(|v| *v >= 0.0) && w[0] + w[1] <= 1.0;
    // On the edges: h alone, g alone, h + g = 1.
    let on_line = ratio(hc - gc - hg + gg, hh - 2.0 * hg + gg);
    let edges = [
        [0.0; 2],
        [ratio(hc, hh), 0.0],
        [0.0, ratio(gc, gg)],
        [on_line, 1.0 - on_line],
        inside,
    ];
    let allowed = edges.into_iter().filter(is_allowed);
    let best = allowed.min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
    best.unwrap_or([0.0; 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 300;

    /// How two joints move, irregularly: the second as the first does.
    fn joints() -> (Vec<DQuat>, Vec<DQuat>) {
        let way = |t: usize, speed: f64| {
            let t = t as f64;
            (speed * t).sin() + 0.5 * (0.37 * speed * t).cos() + 0.3 * (1.7 * speed * t).sin()
        };
        let first = |t: usize| DVec3::new(0.5 * way(t, 0.09), 0.2 * way(t, 0.05), 0.0);
        let second = |t: usize| DVec3::new(0.0, -0.3 * way(t, 0.05), 0.4 * way(t, 0.09));
        let all = |of: &dyn Fn(usize) -> DVec3| {
            let at = |t: usize| DQuat::from_scaled_axis(of(t));
            (0..FRAMES).map(at).collect()
        };
        (all(&first), all(&second))
    }

    /// The rms errors of the fill and of the straight way over the gap of the second joint, and
    /// what it says of its error.
    fn errors(gap: Range<usize>, is_first_seen: bool, frames: usize) -> (f64, f64, f64) {
        let (mut first, truth) = joints();
        let (first, truth) = (&mut first[..frames], &truth[..frames]);
        let seen: Vec<bool> = (0..frames).map(|t| !gap.contains(&t)).collect();
        let mut values = truth.to_vec();
        let straight = straight(truth, &gap);
        values[gap.clone()].copy_from_slice(&straight);
        let all = vec![true; frames];
        let of_first = if is_first_seen { &all } else { &seen };
        let predictors = Predictors::new(&[(first, of_first, 3), (&values, &seen, 3)], frames);
        let gappy = Gappy {
            values: &values,
            seen: &seen,
            predictors: &predictors,
            own: Some(1),
            step: 1.0 / 60.0,
        };
        let filled = gappy.fill(usize::MAX);
        assert_eq!(filled.len(), 1);
        let rms = |found: &[DQuat]| {
            let pairs = found.iter().zip(&truth[gap.clone()]);
            let squares = pairs.map(|(a, b)| a.step_to(*b).length_squared());
            (squares.sum::<f64>() / gap.len() as f64).sqrt()
        };
        assert!(gappy.fill(gap.len() - 1).is_empty());
        (rms(&filled[0].1), rms(&straight), filled[0].0.error)
    }

    #[test]
    fn what_others_tell_is_taken_and_else_time_alone_serves() {
        let (error, slerp, said) = errors(100..140, true, FRAMES);
        assert!(
            error < 0.25 * slerp && said < 0.25 * slerp,
            "{error} {said} {slerp}"
        );
        // The other is missing in the same frames.
        let (error, slerp, _) = errors(100..120, false, FRAMES);
        assert!(error < 0.9 * slerp, "{error} {slerp}");
        // At an end of the take.
        let (error, held, _) = errors(270..FRAMES, true, FRAMES);
        assert!(error < 0.6 * held, "{error} {held}");
    }

    #[test]
    fn with_nothing_to_compare_with_the_straight_way_is_taken() {
        let (error, slerp, said) = errors(5..25, true, 30);
        assert!(error == slerp && said.is_nan());
    }

    #[test]
    fn weights_are_those_of_least_cost_that_are_allowed() {
        let sums = [
            [2.0, 0.5, 1.0],
            [4.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
            [0.0, 0.0, 0.0],
        ];
        for [hh, hg, gg] in sums {
            for [hc, gc] in [[0.5, 0.3], [3.0, 2.0], [-1.0, 0.4], [-1.0, -1.0]] {
                let cost = |[h, g]: [f64; 2]| {
                    -2.0 * (h * hc + g * gc) + h * h * hh + 2.0 * h * g * hg + g * g * gg
                };
                let best = cost(least([hh, hg, gg], [hc, gc], cost));
                for i in 0..=20 {
                    for j in 0..=20 - i {
                        let other = [i, j].map(|v| f64::from(v) / 20.0);
                        let is_zero = hh == 0.0;
                        assert!(is_zero || best <= cost(other) + 1e-9, "{other:?}");
                    }
                }
            }
        }
    }
}
