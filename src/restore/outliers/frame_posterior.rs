//! The posterior of a frame any points of which may be outliers, averaged over which they are.
//!
//! Rigid distances decide most points ([`super::rigid_likelihood`]). The undecided ones are hidden from the prior,
//! which then expects them at N(m, P). An assignment z of them to clean or outlier has the weight
//!
//! ```text
//! Σ_s w_s N(y; m, c_s P + i_s I + R_z) · Π odds · Π densities of distances between clean ends
//! ```
//!
//! The scales (w, c, i) are there because priors are too sure of unseen poses. The noise R of an outlier comes from
//! its worst distances and from where the prior expects it (`rescoring::raise_outlier_variances`). The assignments
//! of large weight go to the prior, whose log evidence, tempered, replaces the sum. Those of small weight follow from
//! N(m, P). The result is their weighted average.
//!
//! Where many points are undecided, as under noise on all points, the hidden points leave the prior too little. All
//! points are then scored once more, each without its own observation (`rescoring::rescore`), and those still
//! undecided are hidden again.
//!
//! Cost: one posterior for each assignment of large weight and one more; up to three more where many are undecided.

use super::assignment::{Assignment, likely};
use super::frame_state::{FrameState, SURE, expected_by_prior};
use super::leave_one_out::Reinserted;
use super::rescoring;
use crate::numeric::parallel;
use crate::numeric::small_linalg::log_sum;
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::{EXACT_VARIANCE, Posterior, Prior};
use crate::restore::rigid::body_lengths::{BodyMixture, Lengths};
use crate::restore::rigid::uncertainty;
use ndarray::{Array2, ArrayView2};

/// Least weight, relative to the largest, of an assignment that goes to the prior.
const ASKED: f64 = 0.05;
/// Factor of the log evidence of assignments: priors are too sure.
const TEMPERATURE: f64 = 0.3;
/// Frames with more undecided points are scored twice.
const FEW: usize = 6;
/// Frames of one parallel task.
const CHUNK: usize = 16;

/// A posterior with its outliers.
#[derive(Debug, Clone)]
pub struct Found {
    /// The pose. Its evidence is that of one assignment, and not comparable.
    pub belief: Posterior,
    /// The probability of each point to be an outlier.
    pub corrupt: Vec<f64>,
    /// Estimated noise variance of each coordinate, cm².
    pub noise: Vec<f64>,
    /// The lengths of the body that was taken.
    pub lengths: Lengths,
}

/// The posterior under one assignment.
struct Answer {
    weight: f64,
    /// One for each undecided point.
    corrupt: Vec<bool>,
    belief: Posterior,
}

/// Restores frames (rows of `y`, cm); `noise_variance` are the variances of clean coordinates (cm², infinite where
/// missing).
pub fn restore(
    prior: &dyn Prior,
    pairs: &RigidPairs,
    bodies: &BodyMixture,
    y: ArrayView2<'_, f64>,
    noise_variance: ArrayView2<'_, f64>,
) -> Vec<Found> {
    let prior = prior.untuned().unwrap_or(prior);
    let mut frames: Vec<FrameState> = flat(parallel::map_chunks(y.nrows(), CHUNK, |rows| {
        rows.map(|t| {
            FrameState::new(
                pairs,
                bodies,
                y.row(t).to_vec(),
                noise_variance.row(t).to_vec(),
            )
        })
        .collect()
    }));
    rescoring::score_crowded(prior, &mut frames);
    let crowded = frames.iter_mut().filter(|f| f.undecided.len() > FEW);
    let mut crowded: Vec<&mut FrameState> = crowded.collect();
    let first = assign(prior, &mut crowded);
    for (frame, own) in crowded.into_iter().zip(first) {
        rescoring::rescore(frame, &own.expected, &own.assignments);
    }
    let answers = answer(prior, &mut frames.iter_mut().collect::<Vec<_>>());
    let each = frames.into_iter().zip(answers);
    each.map(|(frame, answers)| gather(frame, answers))
        .collect()
}

/// The likely assignments of a frame.
struct Assigned {
    /// The largest weight first.
    assignments: Vec<Assignment>,
    /// How many of them go to the prior.
    heavy: usize,
    /// The prior's expectation without the undecided points; unused where there are none.
    expected: Posterior,
}

impl Assigned {
    fn new(assignments: Vec<Assignment>, expected: Posterior) -> Self {
        let least = ASKED * assignments[0].weight;
        Assigned {
            heavy: assignments.iter().filter(|a| a.weight >= least).count(),
            assignments,
            expected,
        }
    }

    fn nothing_in_doubt() -> Self {
        let one = Assignment {
            weight: 1.0,
            corrupt: Vec::new(),
            noise_variance: 0.0,
        };
        Assigned::new(vec![one], Posterior::default())
    }
}

/// The posteriors under the likely assignments of each frame.
fn answer(prior: &dyn Prior, frames: &mut [&mut FrameState]) -> Vec<Vec<Answer>> {
    let all = assign(prior, frames);
    // (frame, assignment) of all of large weight.
    let asked: Vec<(usize, usize)> = (all.iter().enumerate())
        .flat_map(|(t, own)| (0..own.heavy).map(move |i| (t, i)))
        .collect();
    let rows: Vec<usize> = (0..asked.len()).collect();
    let noise_variance = expected_by_prior(prior, &rows, |a| {
        let (t, i) = asked[a];
        let noise = frames[t].noise(Some(&all[t].assignments[i].corrupt));
        (frames[t].y.clone(), noise)
    });
    let mut noise_variance = noise_variance.into_iter();
    let frames = frames.iter().zip(all);
    frames
        .map(|(frame, own)| {
            let noise_variance: Vec<Posterior> = noise_variance.by_ref().take(own.heavy).collect();
            answers(frame, own, noise_variance)
        })
        .collect()
}

/// The likely assignments of each frame, by where the prior expects the undecided points without seeing them.
fn assign(prior: &dyn Prior, frames: &mut [&mut FrameState]) -> Vec<Assigned> {
    let open: Vec<usize> = (0..frames.len())
        .filter(|&t| !frames[t].undecided.is_empty() || frames[t].corrupt.contains(&true))
        .collect();
    let expected = expected_by_prior(prior, &open, |t| {
        (frames[t].y.clone(), frames[t].noise(None))
    });
    for (t, expected) in open.iter().zip(&expected) {
        rescoring::raise_outlier_variances(frames[*t], expected);
    }
    let frames = &*frames;
    let likely: Vec<Vec<Assignment>> = flat(parallel::map_chunks(open.len(), CHUNK, |rows| {
        rows.map(|i| likely(frames[open[i]], &expected[i]))
            .collect()
    }));
    let mut all: Vec<Assigned> = (0..frames.len())
        .map(|_| Assigned::nothing_in_doubt())
        .collect();
    for ((t, likely), expected) in open.into_iter().zip(likely).zip(expected) {
        all[t] = Assigned::new(likely, expected);
    }
    all
}

/// The posteriors under a frame's assignments; `noise_variance` are those that the prior computed.
fn answers(frame: &FrameState, mut own: Assigned, noise_variance: Vec<Posterior>) -> Vec<Answer> {
    weigh_anew(&mut own.assignments[..own.heavy], &noise_variance);
    let mut noise_variance = noise_variance.into_iter();
    own.assignments
        .into_iter()
        .map(|a| Answer {
            weight: a.weight,
            belief: (noise_variance.next())
                .unwrap_or_else(|| Reinserted::of(frame, &own.expected, &a.corrupt).belief()),
            corrupt: a.corrupt,
        })
        .collect()
}

/// Reweighs the assignments of large weight by the tempered evidence of their posteriors; the sum of their weights
/// stays.
fn weigh_anew(heavy: &mut [Assignment], noise_variance: &[Posterior]) {
    let mass: f64 = heavy.iter().map(|a| a.weight).sum();
    let logs: Vec<f64> = (heavy.iter().zip(noise_variance))
        .map(|(a, b)| a.noise_variance + TEMPERATURE * b.log_evidence)
        .map(|log| if log.is_nan() { f64::NEG_INFINITY } else { log })
        .collect();
    let total = log_sum(&logs);
    if heavy.len() > 1 && total.is_finite() {
        for (a, log) in heavy.iter_mut().zip(&logs) {
            a.weight = mass * (log - total).exp();
        }
    }
}

fn flat<T>(parts: Vec<Vec<T>>) -> Vec<T> {
    parts.into_iter().flatten().collect()
}

/// The average of the posteriors; exact clean points stay where they are.
fn gather(frame: FrameState, mut answers: Vec<Answer>) -> Found {
    // A posterior of weight 0 may not be finite.
    answers.retain(|a| a.weight > 0.0);
    let d = frame.y.len();
    let mut corrupt: Vec<f64> = frame
        .corrupt
        .iter()
        .map(|c| f64::from(u8::from(*c)))
        .collect();
    let mut belief = Posterior::full(
        vec![0.0; d],
        Array2::zeros((d, d)),
        answers.first().map_or(0.0, |a| a.belief.log_evidence),
    );
    for (at, p) in frame.undecided.iter().enumerate() {
        let of_corrupt = answers.iter().filter(|a| a.corrupt[at]);
        corrupt[*p] = of_corrupt.map(|a| a.weight).sum();
    }
    for answer in &mut answers {
        let (w, part) = (answer.weight, &mut answer.belief);
        uncertainty::pin_exact(part, &frame.y, &frame.noise(Some(&answer.corrupt)));
        belief
            .mean
            .iter_mut()
            .zip(&part.mean)
            .for_each(|(m, x)| *m += w * x);
        belief.covariance.scaled_add(w, &part.covariance);
    }
    for answer in answers.iter().filter(|_| answers.len() > 1) {
        let w = answer.weight;
        let off: Vec<f64> = (answer.belief)
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
    let mut noise: Vec<f64> = frame
        .noise_variance
        .iter()
        .map(|v| v.max(EXACT_VARIANCE))
        .collect();
    for (p, q) in corrupt.iter().enumerate() {
        // Undecided points may move as far as their covariance allows.
        if *q > SURE {
            noise[3 * p..3 * p + 3]
                .iter_mut()
                .for_each(|v| *v = v.max(frame.likelihood.outlier_variance[p]));
        }
    }
    Found {
        belief,
        corrupt,
        noise,
        lengths: frame.likelihood.lengths,
    }
}
