//! Rigid distances kept: a belief made to agree with the lengths that are known.
//!
//! With m, P the belief's mean and covariance, g the distances, H their Jacobian and L the lengths (variances V):
//!
//! ```text
//! P' = P + I,   x ← m + P'Hᵀ (H P' Hᵀ + V)⁻¹ (L − g(x) − H (m − x))     until nothing moves, ten times at most
//! ```
//!
//! I is what a belief is less sure of than it says: i in each direction that was not observed, 1/(1/i + 1/R) where noise
//! of variance R was. i, and whose body it is (L), are the most likely ones given how far off the believed distances
//! are. Cost: n² (n/3 + 36) for each step and n D² for the covariance, n pairs and D numbers a pose.

use crate::pose::ASF_UNIT_CM;
use crate::prior::pairs::RigidPairs;
use crate::prior::{Belief, EXACT};

/// Values of i that are tried, cm² (.003, .02, .1 and .6 asf²).
const UNSURE: [f64; 4] = [0.003, 0.02, 0.1, 0.6];
/// Steps at most; from the third on they are damped by half where they do not shrink, but for the last.
const STEPS: usize = 10;
/// No step moves a coordinate by more than this, cm: where a limb is straight, a distance does not tell its own gradient.
const FARTHEST: f64 = 3.0;
/// Steps end when no distance changes by more than this, cm.
const SETTLED: f64 = 2e-3;
/// The share of bodies nobody has seen, and how much their lengths differ from the mean of those seen.
const STRANGER: (f64, f64) = (0.02, 0.06);

/// The lengths of pairs, and their variances.
#[derive(Debug, Clone, PartialEq)]
pub struct Lengths {
    /// n of them, cm.
    pub mean: Vec<f64>,
    /// cm²; never below [`EXACT`].
    pub variance: Vec<f64>,
}

/// A distance's gradient: along `u` at the first point, against it at the second.
struct Gradient {
    ends: [usize; 2],
    u: [f64; 3],
    length: f64,
}

/// The bodies a pose may be of: those seen, and a stranger's.
#[derive(Debug, Clone, Default)]
pub struct Bodies {
    /// Log share and lengths; the stranger comes last.
    pub all: Vec<(f64, Lengths)>,
}

impl Bodies {
    /// From what was learnt.
    pub fn of(pairs: &RigidPairs) -> Bodies {
        let own = |k: usize| (pairs.pairs[k].sd * pairs.pairs[k].sd).max(EXACT);
        let n = pairs.pairs.len();
        let mut all: Vec<(f64, Lengths)> = (pairs.bodies.rows().into_iter().zip(&pairs.shares))
            .map(|(row, share)| {
                let lengths = Lengths {
                    mean: row.to_vec(),
                    variance: (0..n).map(own).collect(),
                };
                (((1.0 - STRANGER.0) * share).ln(), lengths)
            })
            .collect();
        let weights: Vec<f64> = pairs.shares.iter().map(|s| s.max(0.0)).collect();
        let mut stranger = mixed(&all, &weights);
        for (v, l) in stranger.variance.iter_mut().zip(&stranger.mean) {
            *v += (STRANGER.1 * l).powi(2);
        }
        all.push((STRANGER.0.ln(), stranger));
        Bodies { all }
    }

    /// The lengths, given how likely each body is (logs, to a constant; their shares included).
    pub fn given(&self, logs: &[f64]) -> Lengths {
        let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|l| (l - best).exp()).collect();
        mixed(&self.all, &weights)
    }
}

/// Mean and variance of a mixture; the weights need not add up to one.
fn mixed(all: &[(f64, Lengths)], weights: &[f64]) -> Lengths {
    let total: f64 = weights.iter().sum();
    let n = all.first().map_or(0, |a| a.1.mean.len());
    let (mut mean, mut variance) = (vec![0.0; n], vec![0.0; n]);
    for ((_, l), w) in all.iter().zip(weights).filter(|(_, w)| **w > 1e-12 * total) {
        for k in 0..n {
            mean[k] += w / total * l.mean[k];
        }
    }
    for ((_, l), w) in all.iter().zip(weights).filter(|(_, w)| **w > 1e-12 * total) {
        for k in 0..n {
            variance[k] += w / total * (l.variance[k] + (l.mean[k] - mean[k]).powi(2));
        }
    }
    Lengths { mean, variance }
}

/// Makes a belief agree with the lengths: `noise` is what it was given (cm²; infinite missing). `bodies` are read where
/// `known` does not tell the lengths. The evidence stays as it was.
pub fn keep(
    pairs: &RigidPairs,
    bodies: &Bodies,
    known: Option<&Lengths>,
    belief: &mut Belief,
    noise: &[f64],
) {
    let used: Vec<usize> = (0..pairs.pairs.len())
        .filter(|&k| !pairs.pairs[k].still)
        .collect();
    let sound = belief
        .mean
        .iter()
        .chain(&belief.covariance)
        .all(|v| v.is_finite());
    if used.is_empty() || bodies.all.is_empty() || !sound {
        return;
    }
    let ends: Vec<[usize; 2]> = used.iter().map(|&k| pairs.pairs[k].ends).collect();
    let only = |l: &Lengths| Lengths {
        mean: used.iter().map(|&k| l.mean[k]).collect(),
        variance: used.iter().map(|&k| l.variance[k]).collect(),
    };
    let bodies = Bodies {
        all: match known {
            Some(l) => vec![(0.0, only(l))],
            None => bodies.all.iter().map(|(w, l)| (*w, only(l))).collect(),
        },
    };
    let rows = gradients(&ends, &belief.mean);
    let (add, lengths) = choose(&bodies, &rows, belief, noise);
    let extra: Vec<f64> = noise.iter().map(|r| shared(add, *r)).collect();
    let n = rows.len();
    let mut x = belief.mean.clone();
    let mut before = f64::INFINITY;
    for step in 0..STEPS {
        let rows = gradients(&ends, &x);
        let cross = cross(&rows, belief, &extra);
        let mut a = products(&rows, &cross);
        for k in 0..n {
            a[k * n + k] += lengths.variance[k];
        }
        let off: Vec<f64> = rows
            .iter()
            .zip(&lengths.mean)
            .map(|(row, l)| l - row.length - row.along(&belief.mean) + row.along(&x))
            .collect();
        factorise(&mut a, n);
        let mut z = off;
        forward(&a, n, &mut z);
        backward(&a, n, &mut z);
        let mut to = belief.mean.clone();
        for (row, z) in cross.iter().zip(&z) {
            to.iter_mut().zip(row).for_each(|(t, c)| *t += z * c);
        }
        let moved: Vec<f64> = to.iter().zip(&x).map(|(t, x)| t - x).collect();
        let most = moved.iter().fold(0.0, |a: f64, m| a.max(m.abs()));
        if !most.is_finite() {
            return;
        }
        let last = most <= SETTLED || step + 1 == STEPS;
        let shrinks = most <= 0.5 * before;
        before = most;
        let by = if last || step < 2 || shrinks {
            1.0
        } else {
            0.5
        };
        let by = by * (FARTHEST / most).min(1.0);
        x.iter_mut().zip(&moved).for_each(|(x, m)| *x += by * m);
        if last {
            // Lengths that cannot all be met (a point taken for clean that is not) are better left alone.
            if misfit(&ends, &x, &lengths) < misfit(&ends, &belief.mean, &lengths) {
                condition(belief, &extra, &a, cross, n);
                belief.mean = x;
            }
            return;
        }
    }
}

/// Σ (g − L)² / V.
fn misfit(ends: &[[usize; 2]], x: &[f64], lengths: &Lengths) -> f64 {
    let off = gradients(ends, x).into_iter().map(|row| row.length);
    let terms = off.zip(&lengths.mean).zip(&lengths.variance);
    terms.map(|((g, l), v)| (g - l).powi(2) / v).sum()
}

/// 1 / (1/i + 1/R).
fn shared(i: f64, r: f64) -> f64 {
    if r.is_finite() {
        i * r.max(EXACT) / (i + r.max(EXACT))
    } else {
        i
    }
}

/// The most likely i, and the lengths of the bodies that are likely with it.
fn choose(bodies: &Bodies, rows: &[Gradient], belief: &Belief, noise: &[f64]) -> (f64, Lengths) {
    let n = rows.len();
    let none = vec![0.0; noise.len()];
    let within = products(rows, &cross(rows, belief, &none));
    let mut best: Option<(f64, f64, Vec<f64>)> = None;
    for unsure in UNSURE {
        let i = unsure * ASF_UNIT_CM * ASF_UNIT_CM;
        let extra: Vec<f64> = noise.iter().map(|r| shared(i, *r)).collect();
        let mut logs = Vec::with_capacity(bodies.all.len());
        // Bodies seen have the same variances: one factorisation serves them all, another the stranger.
        let mut factor: Option<(&[f64], Vec<f64>)> = None;
        for (share, lengths) in &bodies.all {
            if factor
                .as_ref()
                .is_none_or(|(v, _)| *v != lengths.variance.as_slice())
            {
                let mut a = within.clone();
                add_diagonal(&mut a, rows, &extra);
                for k in 0..n {
                    a[k * n + k] += lengths.variance[k];
                }
                factorise(&mut a, n);
                factor = Some((&lengths.variance, a));
            }
            let Some((_, a)) = &factor else { continue };
            let mut z: Vec<f64> = lengths
                .mean
                .iter()
                .zip(rows)
                .map(|(l, r)| l - r.length)
                .collect();
            forward(a, n, &mut z);
            let log_det: f64 = (0..n).map(|k| a[k * n + k].ln()).sum();
            logs.push(share - 0.5 * z.iter().map(|z| z * z).sum::<f64>() - log_det);
        }
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum = top + logs.iter().map(|l| (l - top).exp()).sum::<f64>().ln();
        if best.as_ref().is_none_or(|b| sum > b.0) {
            best = Some((sum, i, logs));
        }
    }
    match best {
        Some((_, i, logs)) => (i, bodies.given(&logs)),
        None => (
            UNSURE[0] * ASF_UNIT_CM * ASF_UNIT_CM,
            bodies.all[0].1.clone(),
        ),
    }
}

impl Gradient {
    /// H x of this row.
    fn along(&self, x: &[f64]) -> f64 {
        let [i, j] = self.ends;
        (0..3)
            .map(|c| self.u[c] * (x[3 * i + c] - x[3 * j + c]))
            .sum()
    }
}

fn gradients(ends: &[[usize; 2]], x: &[f64]) -> Vec<Gradient> {
    let of = |&[i, j]: &[usize; 2]| {
        let v: [f64; 3] = std::array::from_fn(|c| x[3 * i + c] - x[3 * j + c]);
        let length = v.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-6);
        Gradient {
            ends: [i, j],
            u: v.map(|v| v / length),
            length,
        }
    };
    ends.iter().map(of).collect()
}

/// H P', by rows of D.
fn cross(rows: &[Gradient], belief: &Belief, extra: &[f64]) -> Vec<Vec<f64>> {
    let of = |row: &Gradient| {
        let mut out = vec![0.0; extra.len()];
        let [i, j] = row.ends;
        for c in 0..3 {
            let (a, b) = (
                belief.covariance.row(3 * i + c),
                belief.covariance.row(3 * j + c),
            );
            let u = row.u[c];
            out.iter_mut()
                .zip(a.iter().zip(b))
                .for_each(|(o, (a, b))| *o += u * (a - b));
        }
        for c in 0..3 {
            out[3 * i + c] += row.u[c] * extra[3 * i + c];
            out[3 * j + c] -= row.u[c] * extra[3 * j + c];
        }
        out
    };
    rows.iter().map(of).collect()
}

/// H P' Hᵀ, lower triangle by rows of n.
fn products(rows: &[Gradient], cross: &[Vec<f64>]) -> Vec<f64> {
    let n = rows.len();
    let mut a = vec![0.0; n * n];
    for k in 0..n {
        for l in 0..=k {
            a[k * n + l] = rows[l].along(&cross[k]);
        }
    }
    a
}

/// Adds H I Hᵀ.
fn add_diagonal(a: &mut [f64], rows: &[Gradient], extra: &[f64]) {
    let n = rows.len();
    for (k, one) in rows.iter().enumerate() {
        for (l, other) in rows[..=k].iter().enumerate() {
            for (s, p) in one.ends.iter().enumerate() {
                for (t, q) in other.ends.iter().enumerate() {
                    if p == q {
                        let sign = if s == t { 1.0 } else { -1.0 };
                        let sum: f64 = (0..3)
                            .map(|c| one.u[c] * other.u[c] * extra[3 * p + c])
                            .sum();
                        a[k * n + l] += sign * sum;
                    }
                }
            }
        }
    }
}

/// What the covariance becomes: P' less what the lengths told.
fn condition(
    belief: &mut Belief,
    extra: &[f64],
    factor: &[f64],
    mut cross: Vec<Vec<f64>>,
    n: usize,
) {
    for k in 0..n {
        let (before, rest) = cross.split_at_mut(k);
        let row = &mut rest[0];
        for (l, other) in before.iter().enumerate() {
            let f = factor[k * n + l];
            row.iter_mut().zip(other).for_each(|(r, o)| *r -= f * o);
        }
        let scale = 1.0 / factor[k * n + k];
        row.iter_mut().for_each(|r| *r *= scale);
    }
    for (i, extra) in extra.iter().enumerate() {
        belief.covariance[[i, i]] += extra;
        let mut target = belief.covariance.row_mut(i);
        for row in &cross {
            let v = row[i];
            target.iter_mut().zip(row).for_each(|(t, w)| *t -= v * w);
        }
    }
    belief.covariance.diag_mut().mapv_inplace(|v| v.max(0.0));
}

/// Cholesky in place, lower triangle by rows of n. A pivot that rounding has eaten becomes a small one.
pub(super) fn factorise(a: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let (x, y) = (&a[i * n..i * n + j], &a[j * n..j * n + j]);
            let sum: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
            let rest = a[i * n + j] - sum;
            a[i * n + j] = if i == j {
                rest.max(1e-12 * a[i * n + i].abs()).max(1e-300).sqrt()
            } else {
                rest / a[j * n + j]
            };
        }
    }
}

/// z ← L⁻¹ z.
pub(super) fn forward(a: &[f64], n: usize, z: &mut [f64]) {
    for i in 0..n {
        let known: f64 = a[i * n..i * n + i]
            .iter()
            .zip(&z[..i])
            .map(|(l, z)| l * z)
            .sum();
        z[i] = (z[i] - known) / a[i * n + i];
    }
}

/// z ← L⁻ᵀ z.
pub(super) fn backward(a: &[f64], n: usize, z: &mut [f64]) {
    for i in (0..n).rev() {
        z[i] /= a[i * n + i];
        let zi = z[i];
        let (before, _) = z.split_at_mut(i);
        before
            .iter_mut()
            .zip(&a[i * n..i * n + i])
            .for_each(|(b, l)| *b -= l * zi);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::pairs::Pair;
    use ndarray::{Array2, array};

    fn bar(lengths: Array2<f64>, shares: &[f64]) -> RigidPairs {
        RigidPairs {
            pairs: vec![Pair {
                ends: [0, 1],
                sd: 0.0,
                still: false,
            }],
            bodies: lengths,
            shares: shares.to_vec(),
        }
    }

    fn belief(mean: &[f64], variance: f64) -> Belief {
        Belief {
            mean: mean.to_vec(),
            covariance: Array2::eye(mean.len()) * variance,
            evidence: -3.0,
        }
    }

    fn length(x: &[f64]) -> f64 {
        (0..3)
            .map(|c| (x[c] - x[3 + c]).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    #[test]
    fn the_length_is_kept_and_the_surer_end_moves_less() {
        let pairs = bar(array![[10.0]], &[1.0]);
        let bodies = Bodies::of(&pairs);
        let mut b = belief(&[0.0, 0.0, 0.0, 12.0, 3.0, 0.0], 4.0);
        keep(&pairs, &bodies, None, &mut b, &[f64::INFINITY; 6]);
        assert!((length(&b.mean) - 10.0).abs() <= 1e-2, "{:?}", b.mean);
        assert!(b.evidence == -3.0 && b.covariance[[3, 3]] < 4.0 + 0.6 * 31.9);
        let mut sure = belief(&[0.0, 0.0, 0.0, 12.0, 3.0, 0.0], 4.0);
        for c in 0..3 {
            sure.covariance[[c, c]] = EXACT;
        }
        let noise = [
            EXACT,
            EXACT,
            EXACT,
            f64::INFINITY,
            f64::INFINITY,
            f64::INFINITY,
        ];
        keep(&pairs, &bodies, None, &mut sure, &noise);
        assert!(sure.mean[..3].iter().all(|v| v.abs() <= 1e-3));
        assert!((length(&sure.mean) - 10.0).abs() <= 1e-2);
    }

    #[test]
    fn the_body_that_fits_is_taken() {
        let pairs = bar(array![[10.0], [14.0]], &[0.5, 0.5]);
        let bodies = Bodies::of(&pairs);
        for long in [10.0, 14.0] {
            let mut b = belief(&[0.0, 0.0, 0.0, long + 0.3, 0.0, 0.0], 0.05);
            keep(&pairs, &bodies, None, &mut b, &[0.05; 6]);
            assert!((length(&b.mean) - long).abs() <= 0.1, "{:?}", b.mean);
        }
    }

    #[test]
    fn a_belief_that_is_no_number_stays() {
        let pairs = bar(array![[10.0]], &[1.0]);
        let mut b = belief(&[f64::NAN, 0.0, 0.0, 1.0, 0.0, 0.0], 1.0);
        keep(&pairs, &Bodies::of(&pairs), None, &mut b, &[1.0; 6]);
        assert!(b.mean[0].is_nan() && b.mean[3] == 1.0);
        // Both ends in one place: no direction, and no end of the world.
        let mut b = belief(&[0.0; 6], 1.0);
        keep(&pairs, &Bodies::of(&pairs), None, &mut b, &[1.0; 6]);
        assert!(b.mean.iter().all(|v| v.is_finite()));
    }
}
