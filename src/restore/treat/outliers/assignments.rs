//! Which points in doubt are corrupt: the likely assignments, by what is expected of all of them at once.

use super::super::bones::{base_of, log_odds};
use super::frame::Frame;
use super::judge::SCALES;
use crate::prior::Belief;
use crate::prior::small::{backward, factorise, forward, log_sum};

/// Assignments that the beam carries along, and that make an answer.
const WIDTH: (usize, usize) = (16, 8);
/// Assignments that weigh less than this share of the heaviest are left out.
const LEAST: f64 = 0.02;

/// Which of a frame's points in doubt are corrupt.
#[derive(Debug, Clone)]
pub struct Assignment {
    /// Beside the others': they add up to one.
    pub weight: f64,
    /// One a point in doubt.
    pub corrupt: Vec<bool>,
    /// What odds and distances say of it: a part of the log weight.
    pub told: f64,
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

/// The likely assignments of the points in doubt, the heaviest first; the weights add up to one.
pub fn likely(frame: &Frame, expected: &Belief) -> Vec<Assignment> {
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
    let mut out: Vec<Assignment> = (beam.into_iter())
        .map(|h| Assignment {
            weight: (h.score() - best).exp(),
            told: h.more,
            corrupt: h.assigned,
        })
        .filter(|a| a.weight >= LEAST)
        .take(WIDTH.1)
        .collect();
    if out.is_empty() {
        // A prior that expects no number tells nothing.
        out.push(Assignment {
            weight: 1.0,
            corrupt: frame.doubt.iter().map(|p| frame.corrupt[*p]).collect(),
            told: 0.0,
        });
    }
    let total: f64 = out.iter().map(|a| a.weight).sum();
    out.iter_mut().for_each(|a| a.weight /= total);
    out
}

/// What is expected of the hidden points, once they are seen with the noise of an assignment.
pub fn conditioned(frame: &Frame, expected: &Belief, assigned: &[bool]) -> Belief {
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
