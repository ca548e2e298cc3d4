//! Missing rotations and positions: four paths over a gap, weighed on gaps that are simulated
//! elsewhere in the take.
//!
//! ```text
//! result = s exp(w_h log(s'h) + w_g log(s'g) + w_l log(s'l)),   w ≥ 0, Σ w ≤ 1
//!     s  the straight way between the frames beside the gap (slerp)
//!     h  a cubic with the velocities there (Hermite)
//!     g  ridge regression on the rotations of the other joints, learned in the take; what it
//!        misses at both ends is carried off linearly
//!     l  the same, learned near the gap: a frame weighs the less the farther it is in time
//! ```
//!
//! The weights are those of least squares over up to n gaps of the same track and length, or where
//! none has room of half of it, and so on, times n / (n + 1); g and l are learned anew without
//! each. Nothing to compare with: the straight way.

use super::movement::{Movable, gaps, straight};
use super::tuning::*;
use crate::numeric::hermite::hermite;
use crate::numeric::linalg::Cholesky;
use crate::numeric::mixing::best_weights;
use glam::{DQuat, DVec3};
use ndarray::{Array1, Array2, ArrayView1};
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
    fn new(sums: &Sums, columns: &[usize], ridge: f64) -> Option<Regression> {
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
        a.diag_mut().mapv_inplace(|v| v + n * ridge);
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
#[derive(Clone)]
struct Weights {
    /// Of the straight way and of each other path.
    of: Array1<f64>,
    error: f64,
}

/// Gaps of one length with as much beside them and the same predictors share their weights.
#[derive(PartialEq, Eq, Hash)]
struct Kind {
    length: usize,
    has_sides: [bool; 2],
    columns: Vec<usize>,
}

/// The paths over a gap: the straight one, and the steps from it to each other.
struct Paths<M> {
    straight: Vec<M>,
    /// (other paths) of (frames).
    steps: [Vec<DVec3>; OTHERS],
}

/// Paths besides the straight one.
const OTHERS: usize = 3;

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
        let (mut regressed, mut locals) = (0, 0);
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
                let regression = sums.and_then(|sums| Regression::new(sums, &kind.columns, RIDGE));
                (self.weigh(kind, sums, mean), regression)
            });
            locals += 1;
            let local = (regression.as_ref())
                .filter(|_| locals <= MOST_LOCAL)
                .and_then(|global| self.local(&gap, &global.columns, mean));
            let paths = self.paths(&gap, has_sides, [regression.as_ref(), local.as_ref()], mean);
            let filled = FilledGap {
                frames: gap,
                error: weights.error,
            };
            (filled, paths.mixed(weights))
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
        let mut gram = Array2::zeros((1 + OTHERS, 1 + OTHERS));
        for gap in &simulated {
            let regression = sums.and_then(|sums| {
                let mut sums = sums.clone();
                for t in gap.clone() {
                    let x = self.predictors.values.row(t);
                    sums.add_predictors(-1.0, x);
                    sums.add_target(-1.0, x, self.values[t].off_mean(mean));
                }
                Regression::new(&sums, &kind.columns, RIDGE)
            });
            let local = (regression.as_ref()).and_then(|r| self.local(gap, &r.columns, mean));
            let paths = self.paths(
                gap,
                kind.has_sides,
                [regression.as_ref(), local.as_ref()],
                mean,
            );
            for (k, t) in gap.clone().enumerate() {
                let truth = paths.straight[k].step_to(self.values[t]);
                let error = |path: usize| match path {
                    0 => -truth,
                    _ => paths.steps[path - 1][k] - truth,
                };
                gram.indexed_iter_mut()
                    .for_each(|((i, j), sum)| *sum += error(i).dot(error(j)));
            }
        }
        let plain = Array1::from_shape_fn(1 + OTHERS, |path| f64::from(u8::from(path == 0)));
        let n = simulated.len() as f64;
        let of = (best_weights(&gram, &plain, 0.0) * n + plain) / (n + 1.0);
        let is_alike = simulated.iter().all(|gap| gap.len() == kind.length);
        let frames = n * kind.length as f64;
        let error = (of.dot(&gram.dot(&of)).max(0.0) / frames).sqrt();
        Weights {
            of,
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
        [global, local]: [Option<&Regression>; 2],
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
        let between = before.is_some() && after.is_some();
        let still = || vec![DVec3::ZERO; gap.len()];
        let to = |ways: Vec<M>| {
            let steps = straight.iter().zip(ways).map(|(s, way)| s.step_to(way));
            steps.collect::<Vec<DVec3>>()
        };
        let hermite = if between {
            let middle = straight[gap.len() / 2];
            let steps = self.cubic(gap, |t| middle.step_to(self.values[t]));
            to(steps.into_iter().map(|step| middle.stepped(step)).collect())
        } else {
            still()
        };
        let carried = |regression: &Regression| {
            let at = |t: usize| mean.stepped(regression.predict(self.predictors.values.row(t)));
            let missed = |t: usize| at(t).step_to(self.values[t]);
            let (first, last) = (before.map(missed), after.map(missed));
            let [first, last] = [first.or(last), last.or(first)].map(Option::unwrap_or_default);
            let step = |k: usize| {
                let share = (k + 1) as f64 / (gap.len() + 1) as f64;
                at(gap.start + k).stepped(first.lerp(last, share))
            };
            to((0..gap.len()).map(step).collect())
        };
        let global = global.map_or_else(still, carried);
        let local = local.map_or_else(|| global.clone(), carried);
        let steps = [hermite, global, local];
        Paths { straight, steps }
    }

    /// The regression that is learned near a gap.
    fn local(&self, gap: &Range<usize>, columns: &[usize], mean: M) -> Option<Regression> {
        let seconds = gap.len() as f64 * self.step;
        let near = (LOCAL_SHARE * seconds).max(LOCAL);
        let reach = (LOCAL_REACH * near / self.step) as usize;
        let mut frames: Vec<(usize, f64)> = Vec::new();
        for t in gap.start.saturating_sub(reach)..(gap.end + reach).min(self.seen.len()) {
            let away = gap
                .start
                .saturating_sub(t)
                .max((t + 1).saturating_sub(gap.end));
            if away > 0 && self.seen[t] {
                frames.push((t, (-(away as f64) * self.step / near).exp()));
            }
        }
        let x = Array2::from_shape_fn((frames.len(), columns.len()), |(i, c)| {
            self.predictors.values[[frames[i].0, columns[c]]]
        });
        let mut weighted = x.clone();
        let mut sums = Sums::none(columns.len());
        for (mut row, (t, weight)) in weighted.rows_mut().into_iter().zip(&frames) {
            row *= *weight;
            sums.add_target(1.0, row.view(), self.values[*t].off_mean(mean));
            sums.count += weight;
        }
        sums.x = weighted.sum_axis(ndarray::Axis(0)).to_vec();
        sums.xx = x.t().dot(&weighted);
        sums.y = (frames.iter())
            .map(|(t, w)| *w * self.values[*t].off_mean(mean))
            .sum();
        let all: Vec<usize> = (0..columns.len()).collect();
        let local = Regression::new(&sums, &all, RIDGE * seconds.clamp(LEAST_RIDGE, 1.0).powi(2))?;
        Some(Regression {
            columns: columns.to_vec(),
            ..local
        })
    }

    /// The cubic over a gap through steps that are known where the track is seen.
    fn cubic(&self, gap: &Range<usize>, step_at: impl Fn(usize) -> DVec3) -> Vec<DVec3> {
        let is_seen = |t: &usize| self.seen[*t];
        let first = (gap.start.saturating_sub(SIDE)..gap.start)
            .rev()
            .take_while(is_seen)
            .count();
        let last = (gap.end..(gap.end + SIDE).min(self.seen.len()))
            .take_while(is_seen)
            .count();
        let known = || (gap.start - first..gap.start).chain(gap.end..gap.end + last);
        let steps: Vec<DVec3> = known().map(step_at).collect();
        let time = |t: usize| t as f64 * self.step;
        let x: Vec<f64> = known().map(time).collect();
        let at: Vec<f64> = gap.clone().map(time).collect();
        let paths = [0, 1, 2].map(|c| {
            let y: Vec<f64> = steps.iter().map(|s| s[c]).collect();
            hermite(&x, &y, first, &at, self.step)
        });
        let step = |k: usize| DVec3::from_array([0, 1, 2].map(|c| paths[c][k]));
        (0..gap.len()).map(step).collect()
    }
}

impl<M: Movable> Paths<M> {
    fn mixed(&self, weights: &Weights) -> Vec<M> {
        let step = |(k, s): (usize, &M)| {
            let steps = self.steps.iter().zip(weights.of.iter().skip(1));
            s.stepped(steps.map(|(steps, w)| *w * steps[k]).sum())
        };
        self.straight.iter().enumerate().map(step).collect()
    }
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
}
