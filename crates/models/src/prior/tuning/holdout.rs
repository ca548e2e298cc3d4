//! Held-out training poses, damaged for each task: the data of the tuning.

use super::{ASF2, Task};
use crate::numeric::parallel;
use crate::pose::{ASF_UNIT_CM, joints};
use crate::prior::EXACT_VARIANCE;
use crate::prior::training_set::{HoldBack, TrainingSet};
use ndarray::{Array2, Axis};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_distr::StandardNormal;
use std::ops::Range;

/// Share of the training poses that is held out.
const SHARE: f64 = 0.2;
/// Largest number of held-out poses restored per setting; half as many if each has its own noise.
const MAX_TESTED: usize = 600;
/// Number of segments into which the takes are cut if they are too few to hold out whole ones.
const SEGMENTS: usize = 20;
/// Share of the points that sparse noise hits (section 4.2).
const HIT: f64 = 0.2;

/// Splits the poses: those kept as a training set, and at most [`MAX_TESTED`] held-out ones, evenly
/// spaced (m, 3 J).
pub(crate) fn hold_back(
    poses: &TrainingSet,
    how: HoldBack,
    seed: u64,
) -> (TrainingSet, Array2<f64>) {
    let n = poses.xyz.nrows();
    let mut held = vec![false; n];
    let mut generator = parallel::rng(seed, 1);
    match how {
        HoldBack::Takes => {
            let mut parts = poses.takes.clone();
            let wanted = (SHARE * n as f64) as usize;
            // Whole takes, where that leaves at least half of the poses to learn from.
            if parts.len() < 5 || parts.iter().any(|p| p.len() > n / 2) {
                parts = segments(&poses.takes, n.div_ceil(SEGMENTS));
            }
            parts.shuffle(&mut generator);
            let mut count = 0;
            for part in parts {
                if count >= wanted {
                    break;
                }
                if count + part.len() <= n / 2 {
                    count += part.len();
                    held[part].fill(true);
                }
            }
        }
        HoldBack::Frames => held
            .iter_mut()
            .for_each(|h| *h = generator.random::<f64>() < SHARE),
    }
    let rows = |which: bool| -> Vec<usize> { (0..n).filter(|&i| held[i] == which).collect() };
    let (kept, tested) = (rows(false), rows(true));
    let mut before = vec![0; n + 1];
    for i in 0..n {
        before[i + 1] = before[i] + usize::from(!held[i]);
    }
    let takes = poses.takes.iter().map(|t| before[t.start]..before[t.end]);
    let part = TrainingSet {
        xyz: poses.xyz.select(Axis(0), &kept),
        takes: takes.filter(|t| !t.is_empty()).collect(),
        points: poses.points.clone(),
        body: poses.body.clone(),
        anchor: poses.anchor.clone(),
        up: None,
        ..*poses
    };
    let step = tested.len().div_ceil(MAX_TESTED).max(1);
    let some: Vec<usize> = tested.into_iter().step_by(step).collect();
    (part, poses.xyz.select(Axis(0), &some).mapv(f64::from))
}

/// Takes cut into segments of at most `length` frames.
fn segments(takes: &[Range<usize>], length: usize) -> Vec<Range<usize>> {
    let length = length.max(1);
    let cut = |t: &Range<usize>| {
        let t = t.clone();
        let starts = t.clone().step_by(length);
        starts.map(move |s| s..(s + length).min(t.end))
    };
    takes.iter().flat_map(cut).collect()
}

/// True poses, damaged poses and stated variances of a task: (m, 3 J) each.
pub(crate) fn damaged(
    held: &Array2<f64>,
    points: &[String],
    task: Task,
    seed: u64,
) -> (Array2<f64>, Array2<f64>, Array2<f64>) {
    let mut generator = parallel::rng(seed, 2 + task as u64);
    // Noise that differs from frame to frame costs a factorization each.
    let step = if task == Task::Treated { 2 } else { 1 };
    let truth = held.slice(ndarray::s![..;step, ..]).to_owned();
    let mut y = truth.clone();
    let mut stated = Array2::zeros(truth.dim());
    let hidden = hidden(points, seed);
    for (mut y, mut stated) in y.rows_mut().into_iter().zip(stated.rows_mut()) {
        for p in 0..points.len() {
            let hit = match task {
                Task::Dense => true,
                Task::Sparse | Task::Treated => generator.random::<f64>() < HIT,
                Task::Complete => false,
            };
            for c in 3 * p..3 * p + 3 {
                if hit {
                    y[c] += ASF_UNIT_CM * generator.sample::<f64, _>(StandardNormal);
                }
                stated[c] = match task {
                    Task::Dense => ASF2,
                    Task::Sparse => 0.0,
                    Task::Complete if hidden[p] => f64::INFINITY,
                    Task::Complete => 0.0,
                    Task::Treated if hit => ASF2,
                    Task::Treated => EXACT_VARIANCE,
                };
            }
        }
    }
    (truth, y, stated)
}

/// The points that are missing in completion: all but Lai et al.'s six, or a random three in four
/// if those are absent.
fn hidden(points: &[String], seed: u64) -> Vec<bool> {
    if let Some(seen) = joints::paper_six_of(points) {
        return (0..points.len()).map(|p| !seen.contains(&p)).collect();
    }
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(&mut parallel::rng(seed, 6));
    let mut hidden = vec![true; points.len()];
    let seen = points.len().div_ceil(4);
    order.iter().take(seen).for_each(|&p| hidden[p] = false);
    hidden
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses(takes: usize, frames: usize) -> TrainingSet {
        let n = takes * frames;
        TrainingSet {
            points: ["a", "b", "c"].map(String::from).to_vec(),
            xyz: Array2::from_shape_fn((n, 9), |(t, c)| 20.0 * ((t * (c + 1)) as f32 * 0.1).sin()),
            takes: (0..takes).map(|t| t * frames..(t + 1) * frames).collect(),
            body: None,
            anchor: None,
            up: None,
            incomplete: 0,
            unplaced: 0,
        }
    }

    #[test]
    fn whole_takes_are_held_back_and_segments_of_one() {
        for (takes, frames, part) in [(10, 50, 50), (1, 500, 25)] {
            let all = poses(takes, frames);
            let (kept, held) = hold_back(&all, HoldBack::Takes, 3);
            assert_eq!(kept.xyz.nrows() + held.nrows(), takes * frames);
            assert_eq!(held.nrows() % part, 0);
            assert!(held.nrows() * 4 >= takes * frames / 2 && held.nrows() * 2 <= takes * frames);
            assert_eq!(kept.takes.last().unwrap().end, kept.xyz.nrows());
        }
        let (kept, held) = hold_back(&poses(2, 200), HoldBack::Frames, 3);
        assert!(held.nrows() >= 50 && held.nrows() <= 110 && kept.takes.len() == 2);
        assert_eq!(hold_back(&poses(1, 1), HoldBack::Takes, 0).1.nrows(), 0);
    }
}
