//! Means over the seeds with bootstrap intervals.
//!
//! Intervals are percentiles (2.5% to 97.5%) of a bootstrap over takes, or over frames under the
//! split `frames`. Units are drawn with replacement from all that any seed has tested, with the
//! same draws for all seeds, tasks and models. A take tested by several seeds is therefore one
//! unit, and models are compared on equal draws. Consecutive frames are alike, so intervals under
//! `frames` are too narrow.

use super::result::{BenchmarkResult, Case, Measurement, ResampledUnit};
use super::splits::Split;
use super::task::Task;
use crate::numeric::parallel;
use crate::numeric::statistics::{DRAWS, interval_95};
use crate::pose::ASF_UNIT_CM;
use rand::Rng;
use serde::{Deserialize, Serialize};

/// A 95% interval: low and high.
pub(crate) type Interval = [f64; 2];

/// A method on a task under a split, over all seeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SummaryRow {
    /// The method's name.
    pub model: String,
    /// The split.
    pub split: Split,
    /// The task.
    pub task: Task,
    /// Base noise on clean coordinates, asf.
    pub base_asf: f64,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// Test frames, all seeds together.
    pub frames: usize,
    /// The number of different takes (frames under `frames`) that were tested.
    pub units: usize,
    /// Mean over the seeds of the mean squared error of a coordinate, asf².
    pub mse: f64,
    /// The 95% interval of `mse`.
    pub interval: Interval,
    /// RMS error of a coordinate, cm.
    pub rms_cm: f64,
    /// The error on training frames, asf²; `None` for a pretrained model.
    pub training_mse: Option<f64>,
    /// Mean squared error by joint, asf².
    pub by_joint: Vec<f64>,
    /// The share of coordinates within each of [`crate::score::error_stats::SD_LEVELS`].
    pub within: Vec<f64>,
    /// Whether no method has a lower error.
    pub best: bool,
    /// The error divided by that of the best other method, with the interval of the ratio.
    pub to_best_other: Option<(f64, Interval)>,
}

/// Averages over seeds. Results must be grouped by split, base noise, task and method, as
/// [`super::Benchmark::run`] returns them; the rows keep that order.
pub(crate) fn summarize(cells: &[BenchmarkResult]) -> Vec<SummaryRow> {
    let table = |c: &BenchmarkResult| (c.case.split, c.case.base_asf.to_bits(), c.case.task);
    cells
        .chunk_by(|a, b| table(a) == table(b))
        .flat_map(summarize_table)
        .collect()
}

/// The 95% interval of one result.
pub(crate) fn interval(cell: &BenchmarkResult) -> Interval {
    interval_of(bootstrap(&[&cell.test], &units(&[&cell.test])))
}

/// The rows of one task under one split.
fn summarize_table(cells: &[BenchmarkResult]) -> Vec<SummaryRow> {
    let models: Vec<&[BenchmarkResult]> = cells
        .chunk_by(|a, b| a.case.model == b.case.model)
        .collect();
    let tests: Vec<&Measurement> = cells.iter().map(|c| &c.test).collect();
    let all = units(&tests);
    let drawn: Vec<Vec<f64>> = models
        .iter()
        .map(|cells| bootstrap(&cells.iter().map(|c| &c.test).collect::<Vec<_>>(), &all))
        .collect();
    let mean = |cells: &[BenchmarkResult]| mean(cells.iter().map(|c| c.test.mse));
    let errors: Vec<f64> = models.iter().map(|c| mean(c)).collect();
    let lowest = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let mut rows = Vec::new();
    for (k, cells) in models.iter().enumerate() {
        let other = (0..models.len())
            .filter(|&o| o != k)
            .min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
        let to_best_other = other.map(|o| {
            let ratios = drawn[k].iter().zip(&drawn[o]).map(|(a, b)| a / b);
            (errors[k] / errors[o], interval_of(ratios))
        });
        rows.push(SummaryRow {
            interval: interval_of(drawn[k].iter().copied()),
            best: errors[k] <= lowest,
            to_best_other: to_best_other.filter(|(r, _)| r.is_finite()),
            ..over_seeds(cells, errors[k])
        });
    }
    rows
}

/// The row of a method, without interval and comparison.
fn over_seeds(cells: &[BenchmarkResult], mse: f64) -> SummaryRow {
    let id: &Case = &cells[0].case;
    let tests: Vec<&Measurement> = cells.iter().map(|c| &c.test).collect();
    let training: Option<Vec<f64>> = cells
        .iter()
        .map(|c| c.training.as_ref().map(|t| t.mse))
        .collect();
    let joints = tests[0].by_joint.len();
    let counted: u64 = tests.iter().map(|t| t.coordinates).sum();
    let within = |i: usize| {
        let sum: u64 = tests.iter().map(|t| t.within[i]).sum();
        sum as f64 / counted as f64
    };
    SummaryRow {
        model: id.model.clone(),
        split: id.split,
        task: id.task,
        base_asf: id.base_asf,
        seeds: cells.iter().map(|c| c.case.seed).collect(),
        frames: tests.iter().map(|t| t.frames).sum(),
        units: units(&tests).len(),
        mse,
        interval: [mse, mse],
        rms_cm: mse.sqrt() * ASF_UNIT_CM,
        training_mse: training.map(|t| mean(t.into_iter())),
        by_joint: (0..joints)
            .map(|j| {
                mean(
                    tests
                        .iter()
                        .map(|t| t.by_joint.get(j).copied().unwrap_or(f64::NAN)),
                )
            })
            .collect(),
        within: match counted {
            0 => Vec::new(),
            _ => (0..crate::score::error_stats::SD_LEVELS.len())
                .map(within)
                .collect(),
        },
        best: false,
        to_best_other: None,
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    values.for_each(|v| (sum, count) = (sum + v, count + 1));
    sum / f64::from(count)
}

/// The different units, ascending.
fn units(tests: &[&Measurement]) -> Vec<usize> {
    let mut all: Vec<usize> = tests
        .iter()
        .flat_map(|t| t.units.iter().map(|u| u.unit))
        .collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// The mean error over seeds (one test each) in each bootstrap draw of the units.
fn bootstrap(tests: &[&Measurement], all: &[usize]) -> Vec<f64> {
    // The index of each unit among all, found once and not in every draw.
    let indexed: Vec<Vec<(usize, ResampledUnit)>> = tests
        .iter()
        .map(|t| {
            let index = |u: &ResampledUnit| all.binary_search(&u.unit).ok().map(|at| (at, *u));
            t.units.iter().filter_map(index).collect()
        })
        .collect();
    parallel::map_chunks(DRAWS, 1, |range| {
        // The seed is the number of the draw, so that equal units have equal draws.
        let mut random = parallel::rng(0, 1 + range.start as u64);
        let mut times = vec![0_u32; all.len()];
        (0..all.len()).for_each(|_| times[random.random_range(0..all.len())] += 1);
        let of_seed = |units: &Vec<(usize, ResampledUnit)>| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (at, unit) in units {
                let w = f64::from(times[*at]) * unit.frames as f64;
                (sum, weight) = (sum + w * unit.mse, weight + w);
            }
            // A seed without a drawn unit does not count.
            (weight > 0.0).then_some(sum / weight)
        };
        mean(indexed.iter().filter_map(of_seed))
    })
}

/// The 95% interval of the finite values.
fn interval_of(values: impl IntoIterator<Item = f64>) -> Interval {
    let finite = values.into_iter().filter(|v| v.is_finite());
    interval_95(&finite.collect::<Vec<_>>())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::score::error_stats::ONE_AND_TWO_SD;
    use rand_distr::StandardNormal;

    /// A result with `units` units of one frame each and errors near `mse`.
    pub(crate) fn cell(
        model: &str,
        seed: u64,
        task: Task,
        mse: f64,
        units: usize,
    ) -> BenchmarkResult {
        let mut random = parallel::rng(seed, 3);
        let units: Vec<ResampledUnit> = (0..units)
            .map(|i| ResampledUnit {
                unit: 10 * i + seed as usize,
                frames: 1,
                mse: mse * (1.0 + 0.5 * random.sample::<f64, _>(StandardNormal)).abs(),
            })
            .collect();
        let mse = mean(units.iter().map(|u| u.mse));
        let test = Measurement {
            frames: units.len(),
            mse,
            by_joint: vec![mse; 2],
            coordinates: 100,
            within: (0..12).map(|i| 8 * i).collect(),
            units,
        };
        BenchmarkResult {
            case: Case::new(model, Split::Frames, seed, task, 0.0),
            training_frames: Some(10),
            training: Some(Measurement {
                mse: mse / 2.0,
                units: Vec::new(),
                ..test.clone()
            }),
            test,
            tuning: None,
            examples: None,
            seconds_per_pose: 1e-3,
            seconds_training: Some(1.0),
        }
    }

    #[test]
    fn intervals_contain_the_mean_and_narrow_with_more_units() {
        let widths = [50, 800].map(|n| {
            let row = &summarize(&[cell("a", 0, Task::Dense, 1.0, n)])[0];
            assert!(row.interval[0] < row.mse && row.mse < row.interval[1]);
            assert_eq!(interval(&cell("a", 0, Task::Dense, 1.0, n)), row.interval);
            row.interval[1] - row.interval[0]
        });
        // Sixteen times the units, a quarter of the width: 2 x 1.96 x 0.5 / sqrt n.
        assert!((widths[0] / widths[1] - 4.0).abs() <= 1.0, "{widths:?}");
        assert!(
            (widths[1] / (3.92 * 0.5 / 800_f64.sqrt()) - 1.0).abs() <= 0.2,
            "{widths:?}"
        );
    }

    #[test]
    fn the_best_is_marked_and_compared_on_the_same_draws() {
        let mut cells = Vec::new();
        for task in [Task::Dense, Task::Complete] {
            for (model, mse) in [("a", 1.0), ("b", 0.8), ("c", 2.0)] {
                cells.extend((0..3).map(|seed| cell(model, seed, task, mse, 60)));
            }
        }
        let rows = summarize(&cells);
        assert_eq!(rows.len(), 6);
        let best: Vec<&str> = rows
            .iter()
            .filter(|r| r.best)
            .map(|r| r.model.as_str())
            .collect();
        assert_eq!(best, ["b", "b"]);
        assert_eq!(
            (rows[0].seeds.len(), rows[0].frames, rows[0].units),
            (3, 180, 180)
        );
        // All models' units have the same errors but for a factor: on the same draws the ratio does
        // not vary.
        let (ratio, interval) = rows[1].to_best_other.unwrap();
        assert!((ratio - 0.8).abs() <= 1e-9 && (interval[1] - interval[0]).abs() <= 1e-9);
        assert!((rows[0].training_mse.unwrap() - rows[0].mse / 2.0).abs() <= 1e-12);
        assert_eq!(ONE_AND_TWO_SD.map(|i| rows[0].within[i]), [0.24, 0.56]);
        assert!(super::summarize(&[]).is_empty());
    }

    #[test]
    fn the_number_of_threads_does_not_change_the_draws() {
        let cells: Vec<BenchmarkResult> =
            (0..3).map(|s| cell("a", s, Task::Dense, 1.0, 40)).collect();
        let with = |n| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap();
            pool.install(|| summarize(&cells))
        };
        assert_eq!(with(1), with(7));
    }
}
