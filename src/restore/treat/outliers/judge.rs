//! Points judged one by one: by what a belief expects of each without its own observation.

use super::super::bones::{SHARE, SLAB, base_of, is_seen, log_odds};
use super::Answer;
use super::frame::{Frame, MOST};
use crate::prior::small::{factorise, forward, log_sum};
use crate::prior::{Belief, Prior};

/// How wrong a prior may be: weight, factor of its variance, what is added to it (cm²).
pub const SCALES: [(f64, f64, f64); 4] = [
    (0.4, 1.0, 0.01 * SLAB),
    (0.3, 4.0, 0.05 * SLAB),
    (0.2, 16.0, 0.2 * SLAB),
    (0.1, 64.0, 0.5 * SLAB),
];
/// What judging a point by an answer counts for, as a share of its log odds: the answer has used the point.
const SECOND: f64 = 0.5;

/// Where too much is in doubt to hide it all, each point is first judged by what the prior expects of it.
pub fn narrow(prior: &dyn Prior, frames: &mut [Frame]) {
    let many: Vec<usize> = (0..frames.len())
        .filter(|&t| frames[t].doubt.len() > MOST)
        .collect();
    let noise = |f: &Frame| -> Vec<f64> { f.told.iter().map(|v| v.max(SLAB * SHARE)).collect() };
    let beliefs = super::ask(prior, &many, |t| (frames[t].y.clone(), noise(&frames[t])));
    for (&t, belief) in many.iter().zip(&beliefs) {
        let frame = &mut frames[t];
        let guess = noise(frame);
        let odds = |p: usize| {
            let [clean, corrupt] = logs(frame, belief, p, guess[3 * p]);
            log_odds() + corrupt - clean
        };
        let unary = of_seen(frame, odds);
        frame.judge(&unary);
    }
}

/// Judges all points anew, by the answers of the likely assignments.
pub fn again(frame: &mut Frame, answers: &[Answer]) {
    let noises: Vec<Vec<f64>> = answers
        .iter()
        .map(|a| frame.noise(Some(&a.corrupt)))
        .collect();
    let odds = |p: usize| {
        let (mut clean, mut corrupt) = (Vec::new(), Vec::new());
        for (answer, noise) in answers.iter().zip(&noises) {
            let logs = logs(frame, &answer.belief, p, noise[3 * p]);
            clean.push(answer.weight.ln() + logs[0]);
            corrupt.push(answer.weight.ln() + logs[1]);
        }
        log_odds() + SECOND * (log_sum(&corrupt) - log_sum(&clean))
    };
    let unary = of_seen(frame, odds);
    frame.judge(&unary);
}

/// Of each point that is seen; −∞ of the others.
fn of_seen(frame: &Frame, odds: impl Fn(usize) -> f64) -> Vec<f64> {
    let seen = |p: usize| is_seen(&frame.y, &frame.told, p);
    let of = |p: usize| if seen(p) { odds(p) } else { f64::NEG_INFINITY };
    (0..frame.points()).map(of).collect()
}

/// The log density of a point where it was seen, if it is clean and if it is corrupt, by a belief that took it for noisy by
/// the variance `r`.
fn logs(frame: &Frame, belief: &Belief, p: usize, r: f64) -> [f64; 2] {
    let (off, without) = left_out(&frame.y, belief, p, r);
    [base_of(&frame.told, p), frame.look.slab[p]].map(|n| log_density(&off, &without, n))
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
