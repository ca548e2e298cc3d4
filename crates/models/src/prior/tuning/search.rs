//! The search for the best setting: a grid, and on from its edges.

use super::holdout::{damaged, hold_back};
use super::{ASF2, PriorFamily, Setting, Task, TaskSettings, Trial, Tuning};
use crate::Result;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::{Prior, Want, posterior_rows};

/// Factor to the next value beyond an edge of the grid.
const STEP_FACTOR: f64 = 2.0;
/// Smallest relative fall of the error with which the search goes on beyond an edge.
const MIN_GAIN: f64 = 2e-3;
/// Largest number of steps beyond the grid.
const MAX_STEPS: usize = 12;

/// The settings that are tried first: every inflation with every noise of the task. An axis of one
/// value stays there.
#[doc(hidden)]
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Above 0.
    pub inflation: Vec<f64>,
    /// Noise assumed under sparse noise, cm².
    pub sparse: Vec<f64>,
    /// Noise assumed of the observed coordinates in completion, cm².
    pub complete: Vec<f64>,
}

impl Default for Grid {
    fn default() -> Self {
        let asf = |v: &[f64]| v.iter().map(|v| v * ASF2).collect();
        Grid {
            inflation: vec![0.5, 1.0, 2.5, 4.0, 6.0, 12.0, 24.0],
            sparse: asf(&[0.05, 0.1, 0.2, 0.4, 0.8]),
            complete: asf(&[1e-4, 1e-3, 1e-2, 1e-1]),
        }
    }
}

impl Grid {
    fn settings(&self, task: Task) -> Vec<Setting> {
        let stated = [0.0];
        let noises = match task {
            Task::Sparse => &self.sparse[..],
            Task::Complete => &self.complete[..],
            Task::Dense | Task::Treated => &stated[..],
        };
        let with = |&inflation: &f64| noises.iter().map(move |&noise| (inflation, noise));
        let all = self.inflation.iter().flat_map(with);
        all.map(|(inflation, noise)| Setting { inflation, noise })
            .collect()
    }
}

/// Searches the grid, and on from an edge of it while that is better: `learn` is given the poses
/// kept, and what it learned is tried on those held back.
///
/// The damage is the same for every setting. Ties go to the setting named first.
///
/// # Errors
/// Those of `learn`.
#[doc(hidden)]
pub fn tune(
    poses: &TrainingSet,
    options: &TrainOptions,
    grid: &Grid,
    learn: &dyn Fn(&TrainingSet) -> Result<PriorFamily>,
    report: &mut dyn FnMut(&str),
) -> Result<Tuning> {
    let (kept, held) = hold_back(poses, options.hold_back, options.seed);
    let mut tuning = Tuning {
        chosen: TaskSettings::default(),
        held_back: options.hold_back,
        learnt_from: kept.xyz.nrows(),
        tested: held.nrows(),
        curve: Vec::new(),
    };
    if tuning.tested == 0 {
        return Ok(tuning);
    }
    report("learns from a part, to tune on the rest");
    let learned = learn(&kept)?;
    for task in Task::ALL {
        report(&format!("tunes for the task {}", task.name()));
        let (truth, y, stated) = damaged(&held, &kept.points, task, options.seed);
        let mut prior: Option<(f64, Box<dyn Prior>)> = None;
        let (chosen, tried) = search(grid.settings(task), &mut |setting| {
            let made = prior.take().filter(|(i, _)| *i == setting.inflation);
            let (_, prior) = prior
                .insert(made.unwrap_or_else(|| (setting.inflation, learned(setting.inflation))));
            let noise = stated.mapv(|n| setting.noise_of(n));
            let answers = posterior_rows(&**prior, y.view(), noise.view(), Want::Mean);
            let means = answers.iter().flat_map(|a| &a.mean);
            let squares = means.zip(&truth).map(|(m, t)| (m - t) * (m - t));
            squares.sum::<f64>() / truth.len() as f64
        });
        tuning.chosen.set(task, chosen);
        let tried = tried.into_iter().map(|(setting, mse)| Trial {
            task,
            inflation: setting.inflation,
            noise: setting.noise,
            mse,
        });
        tuning.curve.extend(tried);
    }
    Ok(tuning)
}

/// The setting of the least error among `first` (at least one) and those beyond its edges; and all
/// that was tried.
fn search(
    first: Vec<Setting>,
    error: &mut dyn FnMut(Setting) -> f64,
) -> (Setting, Vec<(Setting, f64)>) {
    let mut tried: Vec<(Setting, f64)> = first.into_iter().map(|s| (s, error(s))).collect();
    let least = |tried: &[(Setting, f64)]| {
        let start = tried[0];
        let better = |a: (Setting, f64), b: &(Setting, f64)| if b.1 < a.1 { *b } else { a };
        tried.iter().fold(start, better)
    };
    let mut best = least(&tried);
    for _ in 0..MAX_STEPS {
        let next = beyond(&tried, best.0);
        if next.is_empty() {
            break;
        }
        tried.extend(next.into_iter().map(|s| (s, error(s))));
        let before = best.1;
        best = least(&tried);
        if !(best.1 < before * (1.0 - MIN_GAIN)) {
            break;
        }
    }
    (best.0, tried)
}

/// The settings next to the best one that lie outside of all that was tried: none where it lies
/// within.
fn beyond(tried: &[(Setting, f64)], best: Setting) -> Vec<Setting> {
    let further = |of: fn(&Setting) -> f64| {
        let at = of(&best);
        let all = || tried.iter().map(|(s, _)| of(s));
        match (all().any(|v| v < at), all().any(|v| v > at)) {
            (true, false) => Some(at * STEP_FACTOR),
            (false, true) => Some(at / STEP_FACTOR),
            _ => None,
        }
    };
    let (inflation, noise) = (further(|s| s.inflation), further(|s| s.noise));
    let at = |inflation, noise| Setting { inflation, noise };
    let mut next = Vec::new();
    next.extend(noise.map(|n| at(best.inflation, n)));
    next.extend(inflation.map(|i| at(i, best.noise)));
    if let (Some(i), Some(n)) = (inflation, noise) {
        next.push(at(i, n));
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<Setting> {
        let grid = Grid {
            inflation: vec![0.5, 1.0, 2.0],
            sparse: vec![0.1, 0.2, 0.4],
            complete: vec![0.1],
        };
        grid.settings(Task::Sparse)
    }

    /// Least at an inflation of 2^i and a noise of 0.1 2^n.
    fn bowl(i: f64, n: f64) -> impl FnMut(Setting) -> f64 {
        move |s| 1.0 + (s.inflation.log2() - i).powi(2) + ((10.0 * s.noise).log2() - n).powi(2)
    }

    #[test]
    fn within_the_grid_it_stays_there() {
        let (found, tried) = search(grid(), &mut bowl(0.0, 1.0));
        assert_eq!((found.inflation, found.noise), (1.0, 0.2));
        assert_eq!(tried.len(), 9);
    }

    #[test]
    fn beyond_an_edge_and_beyond_a_corner_the_best_is_found() {
        for (i, n) in [
            (4.0, 1.0),
            (-5.0, 1.0),
            (0.0, 5.0),
            (-4.0, -3.0),
            (5.0, 4.0),
        ] {
            let (found, tried) = search(grid(), &mut bowl(i, n));
            let near = |a: f64, b: f64| (a / b - 1.0).abs() <= 1e-9;
            assert!(near(found.inflation, i.exp2()) && near(found.noise, 0.1 * n.exp2()));
            assert!(tried.len() <= 9 + 3 * MAX_STEPS);
        }
    }

    #[test]
    fn what_makes_no_difference_or_has_no_end_is_not_looked_for_long() {
        assert_eq!(search(grid(), &mut |_| 1.0).1.len(), 9 + 3);
        let (_, tried) = search(grid(), &mut |s| 1.0 / s.inflation);
        assert!(tried.len() <= 9 + 3 * MAX_STEPS);
        let nan = search(grid(), &mut |_| f64::NAN);
        assert_eq!(nan.0, grid()[0]);
    }

    #[test]
    fn an_axis_of_one_value_stays() {
        let one = vec![grid()[0]];
        assert_eq!(search(one, &mut bowl(9.0, 9.0)).1.len(), 1);
    }
}
