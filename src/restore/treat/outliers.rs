//! Points that are corrupt, nobody knows which: found by rigid distances and the prior, averaged by evidence.
//!
//! Distances decide most points ([`super::bones`]). Those in doubt are hidden from the prior, which then says where it
//! expects them: N(m, P) of all of them at once. An assignment z of them weighs
//!
//! ```text
//! Σ_s w_s N(y; m, c_s P + i_s I + R_z) · Π odds · Π over distances between clean ends
//! ```
//!
//! The scales (c, i) are there because priors are surer of unseen poses than they should be. The answer is the average
//! over the likely assignments: those that weigh most are asked of the prior, the others follow from N(m, P).
//! Cost: about two answers of the prior a pose, and below a tenth of a millisecond more.

use super::bodies::{Bodies, Lengths};
use super::bones::{self, Look, SLAB, base_of, is_seen, log_odds};
use crate::par;
use crate::prior::pairs::RigidPairs;
use crate::prior::small::{backward, factorise, forward, log_sum};
use crate::prior::{Belief, EXACT, Prior};
use ndarray::{Array2, ArrayView2};

/// Points less sure than this to be clean, or corrupt, are in doubt.
const SURE: f64 = 0.01;
/// At most so many points are in doubt at a time.
const MOST: usize = 12;
/// Assignments that the beam carries along, and that make an answer.
const WIDTH: (usize, usize) = (16, 8);
/// Assignments that weigh less than these shares of the heaviest are left out, or not asked of the prior.
const LEAST: (f64, f64) = (0.02, 0.5);
/// How wrong a prior may be: weight, factor of its variance, what is added to it (cm²).
const SCALES: [(f64, f64, f64); 4] = [
    (0.4, 1.0, 0.01 * SLAB),
    (0.3, 4.0, 0.05 * SLAB),
    (0.2, 16.0, 0.2 * SLAB),
    (0.1, 64.0, 0.5 * SLAB),
];
/// Frames that one task looks at.
const CHUNK: usize = 16;

/// An answer with its outliers.
#[derive(Debug, Clone)]
pub struct Found {
    /// The pose.
    pub belief: Belief,
    /// The probability that each point is corrupt.
    pub corrupt: Vec<f64>,
    /// The variance of the noise that was found of each coordinate, cm².
    pub noise: Vec<f64>,
    /// The lengths of the body it was taken for.
    pub lengths: Lengths,
}

/// What is known of a frame before the prior is asked.
struct Frame {
    y: Vec<f64>,
    told: Vec<f64>,
    look: Look,
    /// In doubt, ascending.
    doubt: Vec<usize>,
    /// Corrupt, as far as it is decided.
    corrupt: Vec<bool>,
}

impl Frame {
    /// The noise under an assignment; points in doubt are missing where there is none.
    fn noise(&self, assigned: Option<&[bool]>) -> Vec<f64> {
        let mut out: Vec<f64> = self.told.iter().map(|v| v.max(EXACT)).collect();
        let of = |p: usize| match (self.doubt.iter().position(|d| *d == p), assigned) {
            (Some(_), None) => f64::INFINITY,
            (Some(at), Some(z)) if z[at] => self.look.slab[p],
            (None, _) if self.corrupt[p] => self.look.slab[p],
            _ => 0.0,
        };
        for p in 0..out.len() / 3 {
            let least = of(p);
            out[3 * p..3 * p + 3]
                .iter_mut()
                .for_each(|v| *v = v.max(least));
        }
        out
    }
}

/// Restores frames (rows of `y`, cm) some points of which may be corrupt; `told` are the variances of what is clean
/// (infinite missing).
pub fn restore(
    prior: &dyn Prior,
    pairs: &RigidPairs,
    bodies: &Bodies,
    y: ArrayView2<'_, f64>,
    told: ArrayView2<'_, f64>,
) -> Vec<Found> {
    let prior = prior.as_told().unwrap_or(prior);
    let mut frames: Vec<Frame> = flat(par::map_chunks(y.nrows(), CHUNK, |rows| {
        rows.map(|t| frame(pairs, bodies, y.row(t).to_vec(), told.row(t).to_vec()))
            .collect()
    }));
    narrow(prior, &mut frames);
    let hidden: Vec<usize> = (0..frames.len())
        .filter(|&t| !frames[t].doubt.is_empty())
        .collect();
    let expected = ask(prior, &hidden, |t| {
        (frames[t].y.clone(), frames[t].noise(None))
    });
    let weighed: Vec<Vec<(f64, Vec<bool>)>> = flat(par::map_chunks(hidden.len(), CHUNK, |rows| {
        rows.map(|i| weigh(&frames[hidden[i]], &expected[i]))
            .collect()
    }));
    // (frame, where among the hidden, assignment)
    let mut all: Vec<(usize, f64, Vec<bool>, Option<usize>)> = Vec::new();
    let mut at = 0;
    for (t, frame) in frames.iter().enumerate() {
        if frame.doubt.is_empty() {
            all.push((t, 1.0, Vec::new(), None));
            continue;
        }
        let most = weighed[at].first().map_or(1.0, |w| w.0);
        for (w, z) in &weighed[at] {
            let cheap = *w < LEAST.1 * most;
            all.push((t, *w, z.clone(), cheap.then_some(at)));
        }
        at += 1;
    }
    let asked: Vec<usize> = (0..all.len()).filter(|&a| all[a].3.is_none()).collect();
    let mut answers = ask(prior, &asked, |a| {
        let (t, _, z, _) = &all[a];
        (frames[*t].y.clone(), frames[*t].noise(Some(z)))
    })
    .into_iter();
    let mut parts: Vec<Vec<(f64, Vec<bool>, Belief)>> = frames.iter().map(|_| Vec::new()).collect();
    for (t, w, z, cheap) in all {
        let belief = match cheap {
            Some(at) => conditioned(&frames[t], &expected[at], &z),
            None => answers.next().unwrap_or_default(),
        };
        parts[t].push((w, z, belief));
    }
    frames
        .into_iter()
        .zip(parts)
        .map(|(f, parts)| gather(f, parts))
        .collect()
}

fn flat<T>(parts: Vec<Vec<T>>) -> Vec<T> {
    parts.into_iter().flatten().collect()
}

/// Asks the prior for some rows at once.
fn ask(
    prior: &dyn Prior,
    rows: &[usize],
    of: impl Fn(usize) -> (Vec<f64>, Vec<f64>),
) -> Vec<Belief> {
    if rows.is_empty() {
        return Vec::new();
    }
    let d = prior.width();
    let (mut y, mut noise) = (
        Array2::zeros((rows.len(), d)),
        Array2::zeros((rows.len(), d)),
    );
    for (i, row) in rows.iter().enumerate() {
        let (a, b) = of(*row);
        for c in 0..d {
            // What is missing is read nowhere, but nothing should hang on that.
            y[[i, c]] = if a[c].is_finite() { a[c] } else { 0.0 };
            noise[[i, c]] = b[c];
        }
    }
    prior.believe_all(y.view(), noise.view())
}

fn frame(pairs: &RigidPairs, bodies: &Bodies, y: Vec<f64>, mut told: Vec<f64>) -> Frame {
    for (t, y) in told.iter_mut().zip(&y) {
        if !y.is_finite() {
            *t = f64::INFINITY;
        }
    }
    let look = bones::look(pairs, bodies, &y, &told);
    let mut frame = Frame {
        corrupt: Vec::new(),
        doubt: Vec::new(),
        y,
        told,
        look,
    };
    decide(&mut frame);
    frame
}

/// Which points are in doubt, and what the others are.
fn decide(frame: &mut Frame) {
    let q = &frame.look.corrupt;
    frame.corrupt = q.iter().map(|q| *q > 0.5).collect();
    frame.doubt = (0..q.len())
        .filter(|&p| q[p] > SURE && q[p] < 1.0 - SURE)
        .collect();
}

/// Where too much is in doubt to hide it all, each point is first judged by what the prior expects without it.
fn narrow(prior: &dyn Prior, frames: &mut [Frame]) {
    let many: Vec<usize> = (0..frames.len())
        .filter(|&t| frames[t].doubt.len() > MOST)
        .collect();
    let noise =
        |f: &Frame| -> Vec<f64> { f.told.iter().map(|v| v.max(SLAB * bones::SHARE)).collect() };
    let beliefs = ask(prior, &many, |t| (frames[t].y.clone(), noise(&frames[t])));
    for (&t, belief) in many.iter().zip(&beliefs) {
        let frame = &mut frames[t];
        let guess = noise(frame);
        let points = frame.y.len() / 3;
        let unary: Vec<f64> = (0..points)
            .map(|p| {
                if !is_seen(&frame.y, &frame.told, p) {
                    return f64::NEG_INFINITY;
                }
                let (r, without) = left_out(&frame.y, belief, p, guess[3 * p]);
                let ask = |noise: f64| log_density(&r, &without, noise);
                log_odds() + ask(frame.look.slab[p]) - ask(base_of(&frame.told, p))
            })
            .collect();
        frame.look.corrupt = frame.look.marginals(&unary);
        decide(frame);
        if frame.doubt.len() > MOST {
            let q = frame.look.corrupt.clone();
            frame
                .doubt
                .sort_by(|a, b| (q[*a] - 0.5).abs().total_cmp(&(q[*b] - 0.5).abs()));
            frame.doubt.truncate(MOST);
            frame.doubt.sort_unstable();
        }
    }
}

/// What a belief would be of a point without its own observation of variance `r`: how far that is off, and the
/// covariance (3, 3) by rows.
fn left_out(y: &[f64], belief: &Belief, p: usize, r: f64) -> ([f64; 3], [f64; 9]) {
    // P_cav = P (I − P/r)⁻¹ and y − m_cav = (I − P/r)⁻¹ (y − m).
    let share: [f64; 9] = std::array::from_fn(|k| {
        let v = belief.covariance[[3 * p + k / 3, 3 * p + k % 3]] / r;
        // An observation takes something from any variance: no share is above .98.
        f64::from(u8::from(k / 3 == k % 3)) - 0.98 * v
    });
    let inverse = inverse(&share);
    let off: [f64; 3] = std::array::from_fn(|c| y[3 * p + c] - belief.mean[3 * p + c]);
    let r_out = std::array::from_fn(|a| (0..3).map(|b| inverse[3 * a + b] * off[b]).sum());
    let p_out = std::array::from_fn(|k| {
        let (a, b) = (k / 3, k % 3);
        let of = |c: usize| inverse[3 * a + c] * belief.covariance[[3 * p + c, 3 * p + b]];
        (0..3).map(of).sum()
    });
    (r_out, p_out)
}

fn inverse(a: &[f64; 9]) -> [f64; 9] {
    let cofactor = |i: usize, j: usize| {
        let (r, s) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        a[3 * r + c] * a[3 * s + d] - a[3 * r + d] * a[3 * s + c]
    };
    let det: f64 = (0..3).map(|j| a[j] * cofactor(0, j)).sum();
    std::array::from_fn(|k| cofactor(k % 3, k / 3) / det.abs().max(1e-9))
}

/// log Σ_s w_s N(r; 0, c_s P + (i_s + noise) I), without the constant.
fn log_density(r: &[f64; 3], p: &[f64; 9], noise: f64) -> f64 {
    let logs = SCALES.map(|(w, c, i)| {
        let mut a: Vec<f64> = p.iter().map(|v| c * v).collect();
        (0..3).for_each(|k| a[4 * k] += i + noise);
        factorise(&mut a, 3);
        let mut z = r.to_vec();
        forward(&a, 3, &mut z);
        let log_det: f64 = (0..3).map(|k| a[4 * k].ln()).sum();
        f64::ln(w) - 0.5 * z.iter().map(|z| z * z).sum::<f64>() - log_det
    });
    log_sum(&logs)
}

/// An assignment of the first few points in doubt, with a Cholesky factor at each scale that grows by three rows a point.
#[derive(Clone)]
struct Hypothesis {
    assigned: Vec<bool>,
    /// Rows of 1, 2, 3, … numbers.
    factor: [Vec<f64>; SCALES.len()],
    white: [Vec<f64>; SCALES.len()],
    log: [f64; SCALES.len()],
    /// Odds and distances.
    more: f64,
}

impl Hypothesis {
    fn score(&self) -> f64 {
        log_sum(&self.log) + self.more
    }

    /// With the next point added.
    fn with(&self, frame: &Frame, expected: &Belief, corrupt: bool) -> Hypothesis {
        let mut out = self.clone();
        let (n, p) = (self.assigned.len(), frame.doubt[self.assigned.len()]);
        out.assigned.push(corrupt);
        let noise = if corrupt {
            frame.look.slab[p]
        } else {
            base_of(&frame.told, p)
        };
        for (s, (_, c, i)) in SCALES.iter().enumerate() {
            for axis in 0..3 {
                let g = 3 * n + axis;
                let at = 3 * p + axis;
                let (factor, white) = (&mut out.factor[s], &mut out.white[s]);
                let start = factor.len();
                for h in 0..g {
                    let other = 3 * frame.doubt[h / 3] + h % 3;
                    let row = h * (h + 1) / 2;
                    let known: f64 = (factor[row..row + h].iter().zip(&factor[start..]))
                        .map(|(a, b)| a * b)
                        .sum();
                    let v = (c * expected.covariance[[at, other]] - known) / factor[row + h];
                    factor.push(v);
                }
                let row = &factor[start..];
                let known: f64 = row.iter().map(|v| v * v).sum();
                let whole = c * expected.covariance[[at, at]] + i + noise;
                let pivot = (whole - known).max(1e-9 * whole).sqrt();
                let off: f64 = row.iter().zip(white.iter()).map(|(l, z)| l * z).sum();
                let z = (frame.y[at] - expected.mean[at] - off) / pivot;
                factor.push(pivot);
                white.push(z);
                out.log[s] -= 0.5 * z * z + pivot.ln();
            }
        }
        out.more += if corrupt {
            log_odds()
        } else {
            frame.clean_terms(&out.assigned, p)
        };
        out
    }
}

impl Frame {
    /// What the distances of a clean point to clean ones tell, of those decided so far.
    fn clean_terms(&self, assigned: &[bool], p: usize) -> f64 {
        let clean = |q: usize| match self.doubt.iter().position(|d| *d == q) {
            Some(at) => assigned.get(at).is_some_and(|z| !z),
            None => !self.corrupt[q],
        };
        let of = |t: &&bones::Term| t.ends.contains(&p) && t.ends.iter().all(|q| clean(*q));
        self.look.terms.iter().filter(of).map(|t| t.clean).sum()
    }
}

/// The likely assignments of the points in doubt, the heaviest first; the weights add up to one.
fn weigh(frame: &Frame, expected: &Belief) -> Vec<(f64, Vec<bool>)> {
    let mut beam = vec![Hypothesis {
        assigned: Vec::new(),
        factor: Default::default(),
        white: Default::default(),
        log: SCALES.map(|s| s.0.ln()),
        more: 0.0,
    }];
    for _ in &frame.doubt {
        let mut next: Vec<(f64, Hypothesis)> = Vec::with_capacity(2 * beam.len());
        for h in &beam {
            for corrupt in [false, true] {
                let h = h.with(frame, expected, corrupt);
                next.push((h.score(), h));
            }
        }
        next.sort_by(|a, b| b.0.total_cmp(&a.0));
        next.truncate(WIDTH.0);
        beam = next.into_iter().map(|n| n.1).collect();
    }
    let best = beam[0].score();
    let mut out: Vec<(f64, Vec<bool>)> = (beam.iter())
        .map(|h| ((h.score() - best).exp(), h.assigned.clone()))
        .filter(|(w, _)| *w >= LEAST.0)
        .take(WIDTH.1)
        .collect();
    if out.is_empty() {
        // A prior that expects no number tells nothing.
        out.push((1.0, frame.doubt.iter().map(|p| frame.corrupt[*p]).collect()));
    }
    let total: f64 = out.iter().map(|o| o.0).sum();
    out.iter_mut().for_each(|o| o.0 /= total);
    out
}

/// What is expected of the hidden points, once they are seen with the noise of an assignment.
fn conditioned(frame: &Frame, expected: &Belief, assigned: &[bool]) -> Belief {
    let noise = frame.noise(Some(assigned));
    let at: Vec<usize> = frame.doubt.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
    let n = at.len();
    let mut a = vec![0.0; n * n];
    for (k, i) in at.iter().enumerate() {
        for (l, j) in at[..=k].iter().enumerate() {
            a[k * n + l] = expected.covariance[[*i, *j]];
        }
        a[k * n + k] += noise[*i];
    }
    factorise(&mut a, n);
    let mut out = expected.clone();
    let mut z: Vec<f64> = at.iter().map(|i| frame.y[*i] - expected.mean[*i]).collect();
    forward(&a, n, &mut z);
    backward(&a, n, &mut z);
    for (i, z) in at.iter().zip(&z) {
        let row = expected.covariance.row(*i);
        out.mean.iter_mut().zip(row).for_each(|(m, c)| *m += z * c);
    }
    let mut column = vec![0.0; n];
    let mut rows: Vec<Vec<f64>> = vec![vec![0.0; out.mean.len()]; n];
    for c in 0..out.mean.len() {
        for (v, i) in column.iter_mut().zip(&at) {
            *v = expected.covariance[[*i, c]];
        }
        forward(&a, n, &mut column);
        rows.iter_mut()
            .zip(&column)
            .for_each(|(row, v)| row[c] = *v);
    }
    for row in &rows {
        for (i, v) in row.iter().enumerate() {
            let mut target = out.covariance.row_mut(i);
            target.iter_mut().zip(row).for_each(|(t, w)| *t -= v * w);
        }
    }
    out.covariance.diag_mut().mapv_inplace(|v| v.max(0.0));
    out
}

/// The average of the assignments' answers; clean points that are exact stay where they are.
fn gather(frame: Frame, parts: Vec<(f64, Vec<bool>, Belief)>) -> Found {
    let d = frame.y.len();
    let mut corrupt: Vec<f64> = frame
        .corrupt
        .iter()
        .map(|c| f64::from(u8::from(*c)))
        .collect();
    let mut belief = Belief {
        mean: vec![0.0; d],
        covariance: Array2::zeros((d, d)),
        evidence: parts.first().map_or(0.0, |p| p.2.evidence),
    };
    for (at, p) in frame.doubt.iter().enumerate() {
        corrupt[*p] = parts.iter().filter(|(_, z, _)| z[at]).map(|p| p.0).sum();
    }
    let mut parts = parts;
    for (w, z, part) in &mut parts {
        super::fix(part, &frame.y, &frame.noise(Some(z)));
        belief
            .mean
            .iter_mut()
            .zip(&part.mean)
            .for_each(|(m, x)| *m += *w * x);
        belief.covariance.scaled_add(*w, &part.covariance);
    }
    for (w, _, part) in parts.iter().filter(|_| parts.len() > 1) {
        let off: Vec<f64> = part
            .mean
            .iter()
            .zip(&belief.mean)
            .map(|(x, m)| x - m)
            .collect();
        for (i, a) in off.iter().enumerate().filter(|(_, a)| **a != 0.0) {
            let mut row = belief.covariance.row_mut(i);
            row.iter_mut().zip(&off).for_each(|(c, b)| *c += w * a * b);
        }
    }
    let mut noise: Vec<f64> = frame.told.iter().map(|v| v.max(EXACT)).collect();
    for (p, q) in corrupt.iter().enumerate() {
        // Points in doubt may move as far as their own covariance lets them.
        if *q > SURE {
            noise[3 * p..3 * p + 3]
                .iter_mut()
                .for_each(|v| *v = v.max(frame.look.slab[p]));
        }
    }
    Found {
        belief,
        corrupt,
        noise,
        lengths: frame.look.lengths,
    }
}
