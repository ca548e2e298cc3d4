//! Points that are corrupt, nobody knows which: found by rigid distances and the prior, averaged by evidence.
//!
//! Distances decide most points ([`super::bones`]). Those in doubt are hidden from the prior, which then says where it
//! expects them: N(m, P) of all of them at once. An assignment z of them weighs
//!
//! ```text
//! Σ_s w_s N(y; m, c_s P + i_s I + R_z) · Π odds · Π over distances between clean ends
//! ```
//!
//! The scales (c, i) are there because priors are surer of unseen poses than they should be. How far off a corrupt point may be
//! (R) its distances tell along themselves alone; where the prior expects it tells more. The assignments that weigh most
//! are asked of the prior, which tells the evidence of all that was seen under each: with that, tempered, in place of the sum
//! they are weighed anew. The few light ones follow from N(m, P), in which points decided to be corrupt had less of a say. The
//! answer is the average.
//!
//! Where many points are in doubt, as with base noise, the prior sees too little that is sure. Then all points are judged by
//! what follows from N(m, P) under each assignment, each without its own observation, and those that stay in doubt are hidden
//! once more.
//! Cost: an answer of the prior for each assignment that is asked and one more, up to three more where many are in doubt.

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

/// Assignments that weigh less than this share of the heaviest are not asked of the prior.
const ASKED: f64 = 0.05;
/// What the log evidences of assignments are multiplied by: a prior is surer than it should be.
const TEMPERATURE: f64 = 0.3;
/// Frames with more points in doubt are looked at twice.
const FEW: usize = 6;
/// Frames that one task looks at.
const CHUNK: usize = 16;

/// An answer with its outliers.
#[derive(Debug, Clone)]
pub struct Found {
    /// The pose. Its evidence is that of one assignment, and is not to be compared.
    pub belief: Posterior,
    /// The probability that each point is corrupt.
    pub corrupt: Vec<f64>,
    /// The variance of the noise that was found of each coordinate, cm².
    pub noise: Vec<f64>,
    /// The lengths of the body it was taken for.
    pub lengths: Lengths,
}

/// The answer of one assignment.
struct Answer {
    weight: f64,
    /// One a point in doubt.
    corrupt: Vec<bool>,
    belief: Posterior,
}

/// Restores frames (rows of `y`, cm) some points of which may be corrupt; `noise_variance` are the variances of what is clean
/// (infinite missing).
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
    rescoring::narrow(prior, &mut frames);
    let crowded = frames.iter_mut().filter(|f| f.undecided.len() > FEW);
    let mut crowded: Vec<&mut FrameState> = crowded.collect();
    let first = assign(prior, &mut crowded);
    for (frame, own) in crowded.into_iter().zip(first) {
        rescoring::again(frame, &own.expected, &own.assignments);
    }
    let answers = answer(prior, &mut frames.iter_mut().collect::<Vec<_>>());
    let each = frames.into_iter().zip(answers);
    each.map(|(frame, answers)| gather(frame, answers))
        .collect()
}

/// The likely assignments of a frame.
struct Assigned {
    /// The heaviest first.
    assignments: Vec<Assignment>,
    /// So many of them are asked of the prior.
    heavy: usize,
    /// What is expected of the points in doubt; not read where there are none: their one assignment is heavy.
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

/// The answers of the likely assignments of each frame.
fn answer(prior: &dyn Prior, frames: &mut [&mut FrameState]) -> Vec<Vec<Answer>> {
    let all = assign(prior, frames);
    // (frame, which assignment) of all that are heavy.
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

/// The likely assignments of each frame, by what the prior expects of the points in doubt where it does not see them; that tells
/// as well how far off they, and those decided to be corrupt, are.
fn assign(prior: &dyn Prior, frames: &mut [&mut FrameState]) -> Vec<Assigned> {
    let open: Vec<usize> = (0..frames.len())
        .filter(|&t| !frames[t].undecided.is_empty() || frames[t].corrupt.contains(&true))
        .collect();
    let expected = expected_by_prior(prior, &open, |t| {
        (frames[t].y.clone(), frames[t].noise(None))
    });
    for (t, expected) in open.iter().zip(&expected) {
        rescoring::farther(frames[*t], expected);
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

/// The answers of a frame's assignments; those of the heavy are `noise_variance` by the prior.
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

/// Weighs the heavy assignments by the tempered evidence of what the prior `noise_variance` under each; together they weigh what they
/// did.
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

/// The average of the assignments' answers; clean points that are exact stay where they are.
fn gather(frame: FrameState, mut answers: Vec<Answer>) -> Found {
    // What weighs nothing may hold no number.
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
        // Points in doubt may move as far as their own covariance lets them.
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
