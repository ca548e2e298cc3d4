//! Assignments of the undecided points of a frame to clean or outlier, by beam search.
//!
//! The log weight of an assignment z is the sum in the head of [`super::frame_posterior`]. A
//! Cholesky factor of c P + i I + R_z at each scale grows by three rows per point, so each step of
//! the beam costs O(n²) for n coordinates.

use super::frame_state::FrameState;
use super::rigid_likelihood::log_odds;
use super::tuning::assignment::*;
use crate::numeric::simd;
use crate::numeric::small_linalg::log_sum;
use crate::prior::Posterior;
use crate::rigid::distances::base_of;

/// Which of the undecided points are outliers.
#[derive(Debug, Clone)]
pub(crate) struct Assignment {
    /// The weights of a frame's assignments add up to one.
    pub weight: f64,
    /// One for each undecided point.
    pub corrupt: Vec<bool>,
    /// The part of the log weight that comes from the prior odds and the distances.
    pub log_distances: f64,
}

impl Assignment {
    /// The assignment of a frame without undecided points.
    pub(crate) const NOTHING_UNDECIDED: Assignment = Assignment {
        weight: 1.0,
        corrupt: Vec::new(),
        log_distances: 0.0,
    };
}

/// One value for each scale.
type Scaled = [f64; SCALES.len()];

/// An assignment of the first few undecided points.
#[derive(Clone)]
struct Hypothesis {
    assigned: Vec<bool>,
    /// Lower triangle by rows of 1, 2, 3, … values.
    factor: Vec<Scaled>,
    white: Vec<Scaled>,
    log: Scaled,
    /// Log odds and distances.
    more: f64,
}

/// The extension of a hypothesis by the next point.
struct Next {
    score: f64,
    corrupt: bool,
    /// The last three values of each of its rows; those before do not depend on whether it is an
    /// outlier.
    block: [[Scaled; 3]; 3],
    white: [Scaled; 3],
    log: Scaled,
    more: f64,
}

impl Hypothesis {
    fn of_nothing() -> Hypothesis {
        Hypothesis {
            assigned: Vec::new(),
            factor: Vec::new(),
            white: Vec::new(),
            log: SCALES.map(|s| s.0.ln()),
            more: 0.0,
        }
    }

    fn score(&self) -> f64 {
        log_sum(&self.log) + self.more
    }

    /// Extensions by the next point as clean and as outlier. Its rows before its own three values
    /// go to `rows`.
    #[inline(always)]
    fn next(
        &self,
        frame: &FrameState,
        expected: &Posterior,
        rows: &mut [Vec<Scaled>; 3],
    ) -> [Next; 2] {
        let (n, p) = (
            3 * self.assigned.len(),
            frame.undecided[self.assigned.len()],
        );
        for (axis, out) in rows.iter_mut().enumerate() {
            out.clear();
            let row = expected.covariance.row(3 * p + axis);
            for h in 0..n {
                let other = 3 * frame.undecided[h / 3] + h % 3;
                let from = h * (h + 1) / 2;
                let factor = &self.factor[from..=from + h];
                let known = products(&factor[..h], out);
                out.push(each(|s| {
                    (SCALES[s].1 * row[other] - known[s]) / factor[h][s]
                }));
            }
        }
        let known: [[Scaled; 3]; 3] =
            std::array::from_fn(|a| std::array::from_fn(|b| products(&rows[a], &rows[b])));
        let off: [Scaled; 3] = std::array::from_fn(|a| products(&rows[a], &self.white));
        [false, true].map(|corrupt| {
            let noise = if corrupt {
                frame.likelihood.outlier_variance[p]
            } else {
                base_of(&frame.noise_variance, p)
            };
            let mut next = Next {
                score: 0.0,
                corrupt,
                block: Default::default(),
                white: Default::default(),
                log: self.log,
                more: self.more + self.log_distances(frame, p, corrupt),
            };
            for axis in 0..3 {
                next.add(
                    frame,
                    expected,
                    (p, axis),
                    (&known[axis], &off[axis]),
                    noise,
                );
            }
            next.score = log_sum(&next.log) + next.more;
            next
        })
    }

    /// Log odds and distances of the next point.
    fn log_distances(&self, frame: &FrameState, p: usize, corrupt: bool) -> f64 {
        if corrupt {
            return log_odds();
        }
        frame.clean_terms(&self.assigned, p)
    }

    /// Adds the next point, whose rows before its own three values are `rows`.
    fn with(&mut self, next: &Next, rows: &[Vec<Scaled>; 3]) {
        self.assigned.push(next.corrupt);
        for (axis, row) in rows.iter().enumerate() {
            self.factor.extend(row);
            self.factor.extend(&next.block[axis][..=axis]);
        }
        self.white.extend(next.white);
        (self.log, self.more) = (next.log, next.more);
    }
}

impl Next {
    /// Adds the row of one axis of point `p`: `known` are its products with the earlier values of
    /// the rows of all three axes, `off` that with the whitened residual.
    #[inline(always)]
    fn add(
        &mut self,
        frame: &FrameState,
        expected: &Posterior,
        (p, axis): (usize, usize),
        (known, off): (&[Scaled; 3], &Scaled),
        noise: f64,
    ) {
        let at = 3 * p + axis;
        let Next {
            block, white, log, ..
        } = self;
        for s in 0..SCALES.len() {
            let (_, c, i) = SCALES[s];
            for b in 0..axis {
                let inner: f64 = (0..b).map(|k| block[axis][k][s] * block[b][k][s]).sum();
                let v = c * expected.covariance[[at, 3 * p + b]] - known[b][s] - inner;
                block[axis][b][s] = v / block[b][b][s];
            }
            let own: f64 = (0..axis).map(|k| block[axis][k][s].powi(2)).sum();
            let whole = c * expected.covariance[[at, at]] + i + noise;
            let pivot = (whole - known[axis][s] - own).max(1e-9 * whole).sqrt();
            let near: f64 = (0..axis).map(|k| block[axis][k][s] * white[k][s]).sum();
            let z = (frame.y[at] - expected.mean[at] - off[s] - near) / pivot;
            block[axis][axis][s] = pivot;
            white[axis][s] = z;
            log[s] -= 0.5 * z * z + pivot.ln();
        }
    }
}

#[inline(always)]
fn each(of: impl Fn(usize) -> f64) -> Scaled {
    std::array::from_fn(of)
}

/// Σ a b at each scale.
#[inline(always)]
fn products(a: &[Scaled], b: &[Scaled]) -> Scaled {
    let mut sum = Scaled::default();
    for (a, b) in a.iter().zip(b) {
        for s in 0..SCALES.len() {
            sum[s] += a[s] * b[s];
        }
    }
    sum
}

/// The likely assignments of the undecided points, the largest weight first.
pub(crate) fn likely_assignments(frame: &FrameState, expected: &Posterior) -> Vec<Assignment> {
    let mut beam = vec![Hypothesis::of_nothing()];
    let mut rows: Vec<[Vec<Scaled>; 3]> = Vec::new();
    for _ in &frame.undecided {
        beam = widened(frame, expected, beam, &mut rows);
    }
    let best = beam[0].score();
    let mut out: Vec<Assignment> = (beam.into_iter())
        .map(|h| Assignment {
            weight: (h.score() - best).exp(),
            log_distances: h.more,
            corrupt: h.assigned,
        })
        .filter(|a| a.weight >= LEAST)
        .take(MOST_KEPT)
        .collect();
    if out.is_empty() {
        // A prior without a finite expectation: the decision by the distances stands.
        out.push(Assignment {
            weight: 1.0,
            corrupt: frame.undecided.iter().map(|p| frame.corrupt[*p]).collect(),
            log_distances: 0.0,
        });
    }
    let total: f64 = out.iter().map(|a| a.weight).sum();
    out.iter_mut().for_each(|a| a.weight /= total);
    out
}

/// The best hypotheses extended by the next point, the best first. `rows` is scratch.
fn widened(
    frame: &FrameState,
    expected: &Posterior,
    beam: Vec<Hypothesis>,
    rows: &mut Vec<[Vec<Scaled>; 3]>,
) -> Vec<Hypothesis> {
    rows.resize_with(beam.len().max(rows.len()), Default::default);
    let mut next: Vec<(usize, Next)> = Vec::with_capacity(2 * beam.len());
    simd::dispatch8(
        #[inline(always)]
        || {
            for (i, (h, rows)) in beam.iter().zip(rows.iter_mut()).enumerate() {
                next.extend(h.next(frame, expected, rows).map(|next| (i, next)));
            }
        },
    );
    next.sort_by(|a, b| b.1.score.total_cmp(&a.1.score));
    next.truncate(WIDTH);
    let mut left: Vec<usize> = vec![0; beam.len()];
    next.iter().for_each(|(i, _)| left[*i] += 1);
    let mut beam: Vec<Option<Hypothesis>> = beam.into_iter().map(Some).collect();
    let grown = next.iter().filter_map(|(i, next)| {
        left[*i] -= 1;
        // The last extension of a hypothesis takes it over.
        let mut h = match left[*i] {
            0 => beam[*i].take(),
            _ => beam[*i].clone(),
        }?;
        h.with(next, &rows[*i]);
        Some(h)
    });
    grown.collect()
}
