//! Left and right exchanged, as markerless systems and solvers do for some frames: both points jump
//! to each other's position, and back.
//!
//! A limb is a chain of pairs, left and right. In each frame each pair is as it is named or
//! exchanged, and the cheapest sequence of these states is found (Viterbi's algorithm). Points on
//! it that are no joints follow, unless their own way says no:
//!
//! ```text
//! step of a point over g frames     |Δx|² / 2σ²    σ² = (g V h)² + 2 r
//! a change of state                 C for the first pair of the limb, C' for each further
//! an exchanged pair in a frame      P
//!     h the duration of a frame, r the variance of the noise, cm²
//!     V how fast the pair is in the frames nearby, cm/s
//! ```

use super::tuning::exchanges::*;
use crate::numeric::statistics::median;
use crate::pose::joints::parents_by_name;
use crate::pose::sides::mirrored;
use crate::pose::{is_other, point_at, ranges};
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// Two points that bear each other's names for some frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Exchange {
    /// The points.
    pub points: [usize; 2],
    /// The frames.
    pub frames: Range<usize>,
}

impl Exchange {
    /// Gives the points their own positions in `xyz` (frames, 3 J).
    pub fn put_back(&self, xyz: &mut Array2<f64>) {
        let [a, b] = self.points;
        for t in self.frames.clone() {
            (0..3).for_each(|axis| xyz.swap([t, 3 * a + axis], [t, 3 * b + axis]));
        }
    }
}

/// The exchanges of left and right in `xyz` (frames, 3 J; cm, NaN missing), whose points have the
/// `names` of CMU's joints, or others that begin with Left and Right. `runs` are ranges of
/// consecutive frames, `rate` is in frames a second, `noise` is the standard deviation of a
/// coordinate, cm.
pub fn exchanges(
    names: &[String],
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
    noise: f64,
) -> Vec<Exchange> {
    let mut found = Vec::new();
    for (pairs, followers) in limbs(names, xyz) {
        for run in runs {
            let limb = Limb {
                xyz,
                pairs: &pairs,
                frames: run.clone(),
                rate,
                noise,
            };
            let states = limb.supported(limb.states());
            let of_pair = |k: usize, points: [usize; 2]| {
                let is_exchanged = |t: &usize| states[t - run.start] >> k & 1 == 1;
                let exchanged = ranges(run.clone().filter(is_exchanged)).into_iter();
                exchanged.map(move |frames| Exchange { points, frames })
            };
            for (k, points) in pairs.iter().enumerate() {
                found.extend(of_pair(k, *points));
            }
            for (k, points) in &followers {
                found.extend(of_pair(*k, *points).filter(|e| limb.follows(e)));
            }
        }
    }
    found.sort_by_key(|e| (e.frames.start, e.points));
    found
}

/// Pairs of left and right points.
type Pairs = Vec<[usize; 2]>;
/// Such pairs, each with the index of that which it follows, where its own way does not say no.
type Followers = Vec<(usize, [usize; 2])>;

/// The pairs of left and right points, joined to limbs by the bones between them, and what follows
/// them: pairs of points that are no joints follow the pair that they are nearest to.
fn limbs(names: &[String], xyz: ArrayView2<'_, f64>) -> Vec<(Pairs, Followers)> {
    let (joints, others): (Vec<usize>, Vec<usize>) =
        (0..names.len()).partition(|p| !is_other(&names[*p]));
    let mut limbs = chains(names, &joints);
    if limbs.is_empty() {
        limbs = chains(names, &others);
        return limbs.into_iter().map(|pairs| (pairs, Vec::new())).collect();
    }
    let mut out: Vec<(Pairs, Followers)> = limbs.into_iter().map(|l| (l, Vec::new())).collect();
    for left in others {
        let Some(right) = mirrored(names, left).filter(|_| is_left(&names[left])) else {
            continue;
        };
        let all = out.iter().enumerate().flat_map(|(n, (pairs, _))| {
            let far = move |pair: &[usize; 2]| median_distance(xyz, left, pair[0]);
            pairs
                .iter()
                .enumerate()
                .map(move |(k, pair)| (far(pair), n, k))
        });
        if let Some((_, n, k)) = all.min_by(|a, b| a.0.total_cmp(&b.0)) {
            out[n].1.push((k, [left, right]));
        }
    }
    out
}

/// The median distance of two points, cm; infinite where it is never seen.
fn median_distance(xyz: ArrayView2<'_, f64>, a: usize, b: usize) -> f64 {
    let frames = (0..xyz.nrows()).step_by(xyz.nrows().div_ceil(SAMPLED).max(1));
    let apart = frames.map(|t| point_at(xyz, t, a).distance(point_at(xyz, t, b)));
    median(apart.filter(|d| d.is_finite()).collect()).unwrap_or(f64::INFINITY)
}

/// The pairs among some points, joined by the bones between them.
fn chains(names: &[String], points: &[usize]) -> Vec<Pairs> {
    let parents = parents_by_name(names);
    let mut limbs: Vec<Pairs> = Vec::new();
    for &left in points {
        let Some(right) = mirrored(names, left).filter(|_| is_left(&names[left])) else {
            continue;
        };
        let pair = [left, right];
        let above = pair.map(|p| parents[p]);
        let is_above = |[l, r]: &[usize; 2]| above == [Some(*l), Some(*r)];
        let limb = limbs.iter_mut().find(|limb| limb.iter().any(is_above));
        match limb.filter(|limb| limb.len() < MOST_PAIRS) {
            Some(limb) => limb.push(pair),
            None => limbs.push(vec![pair]),
        }
    }
    limbs
}

fn is_left(name: &str) -> bool {
    name.starts_with(['l', 'L'])
}

/// One limb, left and right, in one run.
struct Limb<'a> {
    xyz: ArrayView2<'a, f64>,
    pairs: &'a [[usize; 2]],
    frames: Range<usize>,
    /// Frames a second.
    rate: f64,
    /// cm.
    noise: f64,
}

impl Limb<'_> {
    /// The cheapest state of each frame: a bit for each pair, set where it is exchanged.
    fn states(&self) -> Vec<usize> {
        let states = 1 << self.pairs.len();
        let changes = Array2::from_shape_fn((states, states), |(from, to): (usize, usize)| {
            match (from ^ to).count_ones() {
                0 => 0.0,
                n => CHANGE + FURTHER_CHANGE * f64::from(n - 1),
            }
        });
        let mut tracks: Vec<PairTrack> = (self.pairs.iter())
            .map(|pair| PairTrack::new(self, *pair))
            .collect();
        let mut cost = changes.row(0).to_vec();
        let mut cheapest: Vec<Vec<usize>> = Vec::with_capacity(self.frames.len());
        for t in self.frames.clone() {
            let steps: Vec<[[f64; 2]; 2]> = (tracks.iter_mut())
                .map(|track| track.step(self, t))
                .collect();
            let step = |from: usize, to: usize| {
                let of_pair = |(k, s): (usize, &[[f64; 2]; 2])| s[from >> k & 1][to >> k & 1];
                steps.iter().enumerate().map(of_pair).sum::<f64>()
            };
            let best = |to: usize| {
                let total = |from: usize| cost[from] + changes[[from, to]] + step(from, to);
                let all = (0..states).map(|from| (total(from), from));
                all.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default()
            };
            let best: Vec<(f64, usize)> = (0..states).map(best).collect();
            let exchanged = |to: usize| EXCHANGED * to.count_ones() as f64;
            cost = (best.iter().enumerate())
                .map(|(to, b)| b.0 + exchanged(to))
                .collect();
            cheapest.push(best.iter().map(|b| b.1).collect());
        }
        let last = (0..states).min_by(|a, b| cost[*a].total_cmp(&cost[*b]));
        let mut state = last.unwrap_or(0);
        let mut out = vec![0; cheapest.len()];
        for (out, from) in out.iter_mut().zip(&cheapest).rev() {
            *out = state;
            state = from[state];
        }
        out
    }

    /// Whether the way of a pair that follows another is no longer with an exchange than without.
    fn follows(&self, exchange: &Exchange) -> bool {
        let Range { start, end } = exchange.frames;
        let mut track = PairTrack::new(self, exchange.points);
        let mut more = 0.0;
        for t in self.frames.start..(end + 1).min(self.frames.end) {
            let cost = track.step(self, t);
            let [before, now] = [t > start && t <= end, t >= start && t < end].map(usize::from);
            more += cost[before][now] - cost[0][0];
        }
        more <= 0.0
    }

    /// States without the stretches in which both points of a pair are hardly ever seen: these are
    /// told by no jump of both.
    fn supported(&self, mut states: Vec<usize>) -> Vec<usize> {
        for stretch in ranges((0..states.len()).filter(|t| states[*t] > 0)) {
            let is_seen =
                |t: usize, p: &usize| point_at(self.xyz, self.frames.start + t, *p).is_finite();
            let of_frame = |t: usize| {
                let exchanged = self.pairs.iter().enumerate();
                let exchanged = exchanged.filter(|(k, _)| states[t] >> k & 1 == 1);
                exchanged
                    .filter(|(_, pair)| pair.iter().all(|p| is_seen(t, p)))
                    .count()
            };
            if stretch.clone().map(of_frame).sum::<usize>() < FEWEST_SEEN {
                states[stretch].fill(0);
            }
        }
        states
    }

    /// Frames over which a speed is measured, and before and after which.
    fn nearby(&self) -> usize {
        ((NEARBY * self.rate) as usize).max(FEWEST_NEARBY)
    }
}

/// A pair of a limb, frame by frame.
struct PairTrack {
    columns: [usize; 2],
    /// How far the pair goes in a frame, cm, for each [`Limb::nearby`] frames.
    steps: Vec<f64>,
    /// The frames in which its columns were seen last.
    last: [Option<usize>; 2],
}

impl PairTrack {
    fn new(limb: &Limb<'_>, columns: [usize; 2]) -> PairTrack {
        let Range { start, end } = limb.frames;
        let at = |t: usize, column: usize| point_at(limb.xyz, t, column);
        let step = |t: usize| columns.map(|c| at(t, c).distance(at(t - 1, c)));
        let near = limb.nearby();
        let of_block = |from: usize| {
            let to = (from + 2 * near).min(end);
            let frames = from.saturating_sub(near).max(start + 1)..to;
            let known = frames.flat_map(step).filter(|d| d.is_finite());
            let usual = median(known.collect()).unwrap_or(0.0);
            usual.max(FAST / limb.rate)
        };
        PairTrack {
            columns,
            steps: (start..end).step_by(near).map(of_block).collect(),
            last: [None; 2],
        }
    }

    /// The cost of the steps to frame `t`, for each state before it and in it; 0 where one of the
    /// columns is not seen.
    fn step(&mut self, limb: &Limb<'_>, t: usize) -> [[f64; 2]; 2] {
        let columns = self.columns;
        let now = columns.map(|column| point_at(limb.xyz, t, column));
        let usual = self.steps[(t - limb.frames.start) / limb.nearby()];
        let way = |square: f64, frames: usize| {
            let variance = (usual * frames as f64).powi(2) + 2.0 * limb.noise * limb.noise;
            (square / (2.0 * variance)).min(FARTHEST)
        };
        let mut cost = [[0.0; 2]; 2];
        for (before, last) in self.last.iter().enumerate() {
            let Some(last) = last.filter(|last| (t - last) as f64 <= limb.rate) else {
                // Nothing says that it was the other's: that costs something to say.
                cost[before][1 - before] += FARTHEST / 2.0;
                continue;
            };
            let there = point_at(limb.xyz, last, columns[before]);
            for (after, here) in now.iter().enumerate().filter(|(_, x)| x.is_finite()) {
                let way = way(here.distance_squared(there), t - last);
                // The left point: column `before` in state `before`; the right one: the others.
                cost[before][after] += way;
                cost[1 - before][1 - after] += way;
            }
        }
        for (last, here) in self.last.iter_mut().zip(now) {
            if here.is_finite() {
                *last = Some(t);
            }
        }
        cost
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use rand_distr::{Distribution, StandardNormal};

    const RATE: f64 = 30.0;

    fn names() -> Vec<String> {
        let names = "root lfemur ltibia lfoot rfemur rtibia rfoot LeftHand RightHand";
        names.split(' ').map(String::from).collect()
    }

    /// Legs that swing past each other, and hands.
    fn walk() -> Array2<f64> {
        let mut rng = parallel::rng(3, 0);
        Array2::from_shape_fn((240, 27), |(t, c)| {
            let (p, axis) = (c / 3, c % 3);
            let noise: f64 = StandardNormal.sample(&mut rng);
            let side = if (1..4).contains(&p) || p == 7 {
                1.0
            } else {
                -1.0
            };
            let swing = side * 40.0 * (t as f64 / 6.0).sin();
            let at = [8.0 * side, 30.0 * p as f64, swing + 4.0 * t as f64];
            at[axis] + 0.5 * noise
        })
    }

    fn found(xyz: &Array2<f64>) -> Vec<Exchange> {
        let all = 0..xyz.nrows();
        exchanges(&names(), xyz.view(), std::slice::from_ref(&all), RATE, 0.5)
    }

    #[test]
    fn limbs_are_chains_of_pairs() {
        assert_eq!(
            chains(&names(), &[0, 1, 2, 3, 4, 5, 6, 7, 8]),
            [vec![[1, 4], [2, 5], [3, 6]], vec![[7, 8]]]
        );
    }

    #[test]
    fn what_is_exchanged_is_found_and_put_back() {
        let truth = walk();
        assert_eq!(found(&truth), []);
        let all = [
            (vec![[2, 5], [3, 6]], 40..52),
            (vec![[1, 4], [2, 5], [3, 6]], 90..97),
            (vec![[7, 8]], 150..165),
            // To the end of the take.
            (vec![[7, 8]], 230..240),
        ];
        let mut xyz = truth.clone();
        let mut want = Vec::new();
        for (pairs, frames) in all {
            want.extend(pairs.iter().map(|points| Exchange {
                points: *points,
                frames: frames.clone(),
            }));
        }
        want.iter().for_each(|e| e.put_back(&mut xyz));
        assert_eq!(found(&xyz), want);
        found(&xyz).iter().for_each(|e| e.put_back(&mut xyz));
        assert_eq!(xyz, truth);
    }

    #[test]
    fn points_that_are_lost_meanwhile_are_exchanged_too() {
        let mut truth = walk();
        for (t, p) in (95..105).map(|t| (t, 3)).chain((108..113).map(|t| (t, 5))) {
            (0..3).for_each(|axis| truth[[t, 3 * p + axis]] = f64::NAN);
        }
        let mut xyz = truth.clone();
        for points in [[2, 5], [3, 6]] {
            let frames = 98..110;
            Exchange { points, frames }.put_back(&mut xyz);
        }
        found(&xyz).iter().for_each(|e| e.put_back(&mut xyz));
        let same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
        assert!(xyz.iter().zip(&truth).all(same));
    }

    #[test]
    fn what_is_no_joint_follows_unless_its_own_way_says_no() {
        let mut names = names();
        names.extend(["LHeel (other)", "RHeel (other)"].map(String::from));
        // The heels are beside the toes.
        let walk = walk();
        let heels = Array2::from_shape_fn((walk.nrows(), 33), |(t, c)| match c / 3 {
            9 => walk[[t, 9 + c % 3]] + 2.0,
            10 => walk[[t, 18 + c % 3]] + 2.0,
            _ => walk[[t, c]],
        });
        let leg = [[1, 4], [2, 5], [3, 6]].map(|points| Exchange {
            points,
            frames: 90..97,
        });
        for has_heels in [false, true] {
            let mut want = leg.to_vec();
            if has_heels {
                want.push(Exchange {
                    points: [9, 10],
                    frames: 90..97,
                });
            }
            let mut xyz = heels.clone();
            want.iter().for_each(|e| e.put_back(&mut xyz));
            let all = 0..xyz.nrows();
            let found = exchanges(&names, xyz.view(), std::slice::from_ref(&all), RATE, 0.5);
            assert_eq!(found, want);
        }
    }
}
