//! The posterior of a frame any points of which may be outliers, averaged over which they are.
//!
//! Rigid distances decide most points ([`super::rigid_likelihood`]). The undecided ones are hidden
//! from the prior, which then expects them at N(m, P). An assignment z of them to clean or outlier
//! has the weight
//!
//! ```text
//! Σ_s w_s N(y; m, c_s P + i_s I + R_z) · Π odds · Π densities of distances between clean ends
//! ```
//!
//! The scales (w, c, i) are there because priors are too sure of unseen poses. The noise R of an
//! outlier comes from its worst distances and from where the prior expects it (`leave_one_out`).
//! The prior's posterior under each likely assignment follows; its log evidence, tempered, replaces
//! the sum. The result is the weighted average.
//!
//! Cost: one posterior for each likely assignment, and one more.

use super::assignment::{Assignment, likely_assignments};
use super::frame_state::{FrameState, expected_by_prior};
use super::leave_one_out::raise_outlier_variances;
use super::tuning::{frame_posterior::*, frame_state::SURE};
use crate::numeric::parallel;
use crate::numeric::small_linalg::log_sum;
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::{EXACT_VARIANCE, Posterior, Prior};
use crate::rigid::body_lengths::{BodyMixture, Lengths};
use crate::rigid::uncertainty;
use ndarray::{Array2, ArrayView2, Axis, arr1};

/// A posterior with its outliers.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    /// The pose. Its evidence is that of one assignment, and not comparable.
    pub belief: Posterior,
    /// The probability of each point to be an outlier.
    pub corrupt: Vec<f64>,
    /// Estimated noise variance of each coordinate, cm².
    pub noise: Vec<f64>,
    /// The lengths of the body that was assumed.
    pub lengths: Lengths,
}

/// Restores frames (rows of `y`, cm); `noise_variance` are the variances of clean coordinates (cm²,
/// infinite where missing).
pub(crate) fn restore(
    prior: &dyn Prior,
    pairs: &RigidPairs,
    bodies: &BodyMixture,
    y: ArrayView2<'_, f64>,
    noise_variance: ArrayView2<'_, f64>,
) -> Vec<Found> {
    let prior = prior.untuned().unwrap_or(prior);
    let mut frames = flat(parallel::map_chunks(y.nrows(), CHUNK, |rows| {
        let state = |t: usize| {
            let (y, noise_variance) = (y.row(t).to_vec(), noise_variance.row(t).to_vec());
            FrameState::new(pairs, bodies, y, noise_variance)
        };
        rows.map(state).collect()
    }));
    let assignments = assign(prior, &mut frames);
    // (frame, assignment) of each posterior.
    let assigned: Vec<(usize, &Assignment)> = (assignments.iter().enumerate())
        .flat_map(|(t, own)| own.iter().map(move |a| (t, a)))
        .collect();
    let posteriors = expected_by_prior(prior, assigned.len(), |i| {
        let (t, assignment) = assigned[i];
        (&frames[t].y, frames[t].noise(Some(&assignment.corrupt)))
    });
    let mut posteriors = posteriors.into_iter();
    (frames.into_iter().zip(assignments))
        .map(|(frame, mut own)| {
            let posteriors: Vec<Posterior> = posteriors.by_ref().take(own.len()).collect();
            reweigh(&mut own, &posteriors);
            average(frame, own, posteriors)
        })
        .collect()
}

/// The likely assignments of each frame, by where the prior expects the undecided points without
/// seeing them.
fn assign(prior: &dyn Prior, frames: &mut [FrameState]) -> Vec<Vec<Assignment>> {
    let open: Vec<usize> = (0..frames.len())
        .filter(|&t| !frames[t].undecided.is_empty() || frames[t].corrupt.contains(&true))
        .collect();
    let expected = expected_by_prior(prior, open.len(), |i| {
        (&frames[open[i]].y, frames[open[i]].noise(None))
    });
    for (t, expected) in open.iter().zip(&expected) {
        raise_outlier_variances(&mut frames[*t], expected);
    }
    let frames = &*frames;
    let likely = flat(parallel::map_chunks(open.len(), CHUNK, |rows| {
        rows.map(|i| likely_assignments(&frames[open[i]], &expected[i]))
            .collect()
    }));
    let mut all = vec![vec![Assignment::NOTHING_UNDECIDED]; frames.len()];
    for (t, likely) in open.into_iter().zip(likely) {
        all[t] = likely;
    }
    all
}

/// Weighs assignments by the tempered evidence of their posteriors.
fn reweigh(assignments: &mut [Assignment], posteriors: &[Posterior]) {
    let logs: Vec<f64> = (assignments.iter().zip(posteriors))
        .map(|(a, p)| a.log_distances + TEMPERATURE * p.log_evidence)
        .map(|log| if log.is_nan() { f64::NEG_INFINITY } else { log })
        .collect();
    let total = log_sum(&logs);
    if assignments.len() > 1 && total.is_finite() {
        for (a, log) in assignments.iter_mut().zip(&logs) {
            a.weight = (log - total).exp();
        }
    }
}

fn flat<T>(parts: Vec<Vec<T>>) -> Vec<T> {
    parts.into_iter().flatten().collect()
}

/// The average of the posteriors under the assignments; exact clean points stay where they are.
fn average(frame: FrameState, assignments: Vec<Assignment>, posteriors: Vec<Posterior>) -> Found {
    let mut parts: Vec<(Assignment, Posterior)> = assignments.into_iter().zip(posteriors).collect();
    // A posterior of weight 0 may not be finite.
    parts.retain(|(a, _)| a.weight > 0.0);
    let d = frame.y.len();
    let log_evidence = parts.first().map_or(0.0, |(_, p)| p.log_evidence);
    let mut belief = Posterior::full(vec![0.0; d], Array2::zeros((d, d)), log_evidence);
    for (a, part) in &mut parts {
        uncertainty::pin_exact(part, &frame.y, &frame.noise(Some(&a.corrupt)));
        let mean = belief.mean.iter_mut().zip(&part.mean);
        mean.for_each(|(m, x)| *m += a.weight * x);
        belief.covariance.scaled_add(a.weight, &part.covariance);
    }
    if parts.len() > 1 {
        for (a, part) in &parts {
            let off = arr1(&part.mean) - arr1(&belief.mean);
            let outer = off
                .view()
                .insert_axis(Axis(1))
                .dot(&off.view().insert_axis(Axis(0)));
            belief.covariance.scaled_add(a.weight, &outer);
        }
    }
    let mut corrupt: Vec<f64> = (frame.corrupt.iter())
        .map(|c| f64::from(u8::from(*c)))
        .collect();
    for (at, p) in frame.undecided.iter().enumerate() {
        let of_corrupt = parts.iter().filter(|(a, _)| a.corrupt[at]);
        corrupt[*p] = of_corrupt.map(|(a, _)| a.weight).sum();
    }
    Found {
        noise: noise_with_outliers(&frame, &corrupt),
        belief,
        corrupt,
        lengths: frame.likelihood.lengths,
    }
}

/// Noise variance of each coordinate: points that are not surely clean may move as far as an
/// outlier.
fn noise_with_outliers(frame: &FrameState, corrupt: &[f64]) -> Vec<f64> {
    let outlier_variance = &frame.likelihood.outlier_variance;
    let least = |p: usize| {
        if corrupt[p] > SURE {
            outlier_variance[p]
        } else {
            EXACT_VARIANCE
        }
    };
    let all = frame.noise_variance.iter().enumerate();
    all.map(|(i, v)| v.max(least(i / 3))).collect()
}
