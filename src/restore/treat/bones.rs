//! What rigid distances alone tell of which points are corrupt.
//!
//! Each point is clean or corrupt (odds .8 : .2). A distance between clean points deviates by what it does by itself and
//! by the base noise; where an end is corrupt, by that end's slab as well:
//!
//! ```text
//! p(z, d) ∝ Π_j (.8 or .2) Π_k N(d_k − L_k; shift, V_k + b_i² + b_j² + z_i S_i + z_j S_j)
//! ```
//!
//! The sum over z is taken over the best few assignments of a beam that goes from point to point.

use super::bodies::{Bodies, Lengths};
use crate::pose::ASF_UNIT_CM;
use crate::prior::EXACT;
use crate::prior::pairs::RigidPairs;

/// The share of points that are corrupt.
pub const SHARE: f64 = 0.2;
/// The least variance of a corrupt point's coordinate, cm²: (1 asf)².
pub const SLAB: f64 = ASF_UNIT_CM * ASF_UNIT_CM;
/// What a prior leaves of a distance's deviation when it knows of no bones, cm²: the lengths tell what they tell beyond it.
const PRIOR_KNOWS: f64 = 1.0;
/// Assignments that a beam carries along.
const WIDTH: usize = 64;
/// Standard deviations of base noise that are tried, cm.
const BASES: [f64; 12] = [
    0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.2, 3.6, 6.0,
];

/// The log odds of a corrupt point before anything is known.
pub fn log_odds() -> f64 {
    (SHARE / (1.0 - SHARE)).ln()
}

/// log N(x; 0, v) without the constant.
fn log_normal(x: f64, v: f64) -> f64 {
    -0.5 * (x * x / v + v.ln())
}

/// A distance seen.
#[derive(Debug, Clone)]
pub struct Term {
    /// Its ends.
    pub ends: [usize; 2],
    /// The log density of its deviation by which ends are corrupt: none, the first, the second, both.
    logs: [f64; 4],
    /// What clean ends make more likely, beyond what a prior knows of the distance.
    pub clean: f64,
}

/// What the distances of a frame tell.
#[derive(Debug, Clone)]
pub struct Look {
    /// The distances between points that are seen.
    pub terms: Vec<Term>,
    /// The probability that each point is corrupt; 0 for those not seen.
    pub corrupt: Vec<f64>,
    /// The variance of a coordinate of each point if it is corrupt, cm².
    pub slab: Vec<f64>,
    /// Whose lengths were taken.
    pub lengths: Lengths,
}

fn distance(y: &[f64], [i, j]: [usize; 2]) -> f64 {
    (0..3)
        .map(|c| (y[3 * i + c] - y[3 * j + c]).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Whether a point is seen: all of it.
pub fn is_seen(y: &[f64], told: &[f64], p: usize) -> bool {
    (3 * p..3 * p + 3).all(|i| y[i].is_finite() && told[i].is_finite())
}

/// The base variance of a point, cm².
pub fn base_of(told: &[f64], p: usize) -> f64 {
    (told[3 * p..3 * p + 3].iter().sum::<f64>() / 3.0).max(EXACT)
}

/// How far each distance is off, and with what base variance.
fn deviations<'a>(
    pairs: &'a RigidPairs,
    y: &'a [f64],
    told: &'a [f64],
) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
    let both = move |&(_, ends): &(usize, [usize; 2])| ends.iter().all(|p| is_seen(y, told, *p));
    let of = pairs.pairs.iter().map(|p| p.ends).enumerate().filter(both);
    of.map(move |(k, ends)| {
        (
            k,
            distance(y, ends),
            base_of(told, ends[0]) + base_of(told, ends[1]),
        )
    })
}

/// The lengths of the body that explains most distances, whatever points are corrupt; and how well it does.
fn body(pairs: &RigidPairs, bodies: &Bodies, y: &[f64], told: &[f64]) -> (Lengths, Vec<f64>) {
    let seen: Vec<(usize, f64, f64)> = deviations(pairs, y, told).collect();
    let clean = (1.0 - SHARE).powi(2);
    let logs: Vec<f64> = bodies
        .all
        .iter()
        .map(|(share, l)| {
            let of = |&(k, d, base): &(usize, f64, f64)| {
                let (off, v) = (d - l.mean[k], l.variance[k] + base);
                let (a, b) = (log_normal(off, v), log_normal(off, v + SLAB));
                let top = a.max(b);
                top + (clean * (a - top).exp() + (1.0 - clean) * (b - top).exp()).ln()
            };
            share + seen.iter().map(of).sum::<f64>()
        })
        .collect();
    (bodies.given(&logs), logs)
}

/// The base noise of a frame by itself: the standard deviation of a coordinate, cm, under which its distances are most
/// likely, a fifth of the points aside. `None` where too few are seen, or the body is a stranger's: its lengths would
/// explain anything.
pub fn base(pairs: &RigidPairs, bodies: &Bodies, y: &[f64]) -> Option<f64> {
    let all = vec![EXACT; y.len()];
    if deviations(pairs, y, &all).count() < 6 {
        return None;
    }
    let mut best: Option<(f64, Option<f64>)> = None;
    for base in BASES {
        let told = vec![base * base; y.len()];
        let logs = body(pairs, bodies, y, &told).1;
        // The stranger comes last, and loses where another does as well.
        for (at, log) in logs.iter().enumerate() {
            if best.is_none_or(|(b, _)| *log > b) {
                best = Some((*log, (at + 1 < logs.len()).then_some(base)));
            }
        }
    }
    best.and_then(|(_, base)| base)
}

/// Looks at a frame: `told` holds the base variance of each coordinate, infinite where it is missing.
pub fn look(pairs: &RigidPairs, bodies: &Bodies, y: &[f64], told: &[f64]) -> Look {
    let points = y.len() / 3;
    let lengths = body(pairs, bodies, y, told).0;
    let seen: Vec<(usize, f64, f64)> = deviations(pairs, y, told).collect();
    // All distances of a point that is far off are off, its neighbours' others are not.
    let mut least = vec![f64::INFINITY; points];
    for &(k, d, _) in &seen {
        for p in pairs.pairs[k].ends {
            least[p] = least[p].min((d - lengths.mean[k]).powi(2));
        }
    }
    let slab: Vec<f64> = least
        .iter()
        .map(|l| if l.is_finite() { l.max(SLAB) } else { SLAB })
        .collect();
    let terms: Vec<Term> = seen
        .iter()
        .map(|&(k, d, base)| {
            let ends = pairs.pairs[k].ends;
            let (off, v) = (d - lengths.mean[k], lengths.variance[k] + base);
            let log = |z: usize| {
                let more = if z & 1 > 0 { slab[ends[0]] } else { 0.0 }
                    + if z & 2 > 0 { slab[ends[1]] } else { 0.0 };
                // Noise across a bone makes it longer.
                let shift = (more / lengths.mean[k].max(1.0)).min(more.sqrt());
                log_normal(off - shift, v + more)
            };
            Term {
                ends,
                logs: std::array::from_fn(log),
                clean: log_normal(off, v) - log_normal(off, v + PRIOR_KNOWS),
            }
        })
        .collect();
    let mut look = Look {
        terms,
        corrupt: Vec::new(),
        slab,
        lengths,
    };
    let unary: Vec<f64> = (0..points)
        .map(|p| {
            if is_seen(y, told, p) {
                log_odds()
            } else {
                f64::NEG_INFINITY
            }
        })
        .collect();
    look.corrupt = look.marginals(&unary);
    look
}

impl Look {
    /// The probability that each point is corrupt, given the log odds of each by itself (−∞: it is not).
    pub fn marginals(&self, unary: &[f64]) -> Vec<f64> {
        let points = unary.len();
        let mut ending: Vec<Vec<&Term>> = vec![Vec::new(); points];
        for term in &self.terms {
            ending[term.ends[0].max(term.ends[1])].push(term);
        }
        let mut beam: Vec<(u128, f64)> = vec![(0, 0.0)];
        for p in 0..points {
            let mut next = Vec::with_capacity(2 * beam.len());
            for &(z, score) in &beam {
                for c in 0..2u128 {
                    if c == 1 && unary[p] == f64::NEG_INFINITY {
                        continue;
                    }
                    let z = z | c << p;
                    let bit = |q: usize| (z >> q & 1) as usize;
                    let of = |t: &&Term| t.logs[bit(t.ends[0]) + 2 * bit(t.ends[1])];
                    let more: f64 = ending[p].iter().map(of).sum();
                    next.push((z, score + more + if c == 1 { unary[p] } else { 0.0 }));
                }
            }
            if next.len() > WIDTH {
                next.select_nth_unstable_by(WIDTH, |a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                next.truncate(WIDTH);
            }
            beam = next;
        }
        beam.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let best = beam.first().map_or(0.0, |b| b.1);
        let mut out = vec![0.0; points];
        let mut total = 0.0;
        for (z, score) in &beam {
            let w = (score - best).exp();
            total += w;
            for (p, o) in out.iter_mut().enumerate() {
                *o += w * (z >> p & 1) as f64;
            }
        }
        out.iter_mut().for_each(|o| *o /= total);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::pairs::Pair;
    use ndarray::Array2;

    /// A chain of five points, 10 cm apart.
    pub(in super::super) fn chain() -> (RigidPairs, Vec<f64>) {
        let pairs = (0..4).map(|k| Pair {
            ends: [k, k + 1],
            sd: 0.0,
            still: false,
        });
        let pairs = RigidPairs {
            pairs: pairs.collect(),
            bodies: Array2::from_elem((1, 4), 10.0),
            shares: vec![1.0],
        };
        let pose = (0..5).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        (pairs, pose)
    }

    #[test]
    fn a_point_within_the_chain_is_found_and_a_tip_is_in_doubt() {
        let (pairs, pose) = chain();
        let bodies = Bodies::of(&pairs);
        let none = look(&pairs, &bodies, &pose, &[0.0; 15]);
        assert!(none.corrupt.iter().all(|q| *q < 0.05), "{:?}", none.corrupt);
        let mut y = pose.clone();
        y[7] += 9.0;
        y[6] += 3.0;
        let one = look(&pairs, &bodies, &y, &[0.0; 15]);
        assert!(one.corrupt[2] > 0.97, "{:?}", one.corrupt);
        assert!([0, 1, 3, 4].iter().all(|p| one.corrupt[*p] < 0.05));
        let mut y = pose.clone();
        y[12] += 4.0;
        let tip = look(&pairs, &bodies, &y, &[0.0; 15]);
        assert!((0.3..1.0).contains(&tip.corrupt[4]), "{:?}", tip.corrupt);
        // A point not seen is not corrupt, and tells nothing of its neighbours.
        let mut y = pose;
        y[6] = f64::NAN;
        let gap = look(&pairs, &bodies, &y, &[0.0; 15]);
        assert!(gap.corrupt[2] == 0.0 && gap.terms.len() == 2);
    }

    #[test]
    fn the_base_noise_is_told_from_outliers() {
        let pairs = RigidPairs {
            pairs: (0..20)
                .map(|k| Pair {
                    ends: [k, k + 1],
                    sd: 0.0,
                    still: false,
                })
                .collect(),
            bodies: Array2::from_elem((1, 20), 10.0),
            shares: vec![1.0],
        };
        let bodies = Bodies::of(&pairs);
        let mut y: Vec<f64> = (0..21).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        for p in [3, 9, 10, 16] {
            y[3 * p] += 6.0;
            y[3 * p + 1] -= 4.0;
        }
        assert!(base(&pairs, &bodies, &y).unwrap() <= 0.02);
        let noisy = |sd: f64| -> Vec<f64> {
            let wave = |i: usize| ((i * i * 7 + 3 * i) as f64).sin() * std::f64::consts::SQRT_2;
            y.iter()
                .enumerate()
                .map(|(i, v)| v + sd * wave(i))
                .collect()
        };
        let found = base(&pairs, &bodies, &noisy(0.3)).unwrap();
        assert!((0.1..=0.8).contains(&found), "{found}");
        assert!(base(&pairs, &bodies, &noisy(6.0)).unwrap() >= 2.0);
        assert!(base(&pairs, &bodies, &vec![f64::NAN; 63]).is_none());
    }
}
