//! The result of one case: a method on a task under a split with a seed.

use super::dataset::Dataset;
use super::splits::Split;
use super::task::{DamagedPoses, Task};
use crate::numeric::statistics::span;
use crate::pose::ASF_UNIT_CM;
use crate::prior::{EXACT_VARIANCE, Posterior};
use crate::score::error_stats::SD_LEVELS;
use ndarray::ArrayView2;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// A coordinate with a smaller range in training, cm, is constant, like the root, and does not
/// count for calibration.
const MIN_RANGE: f64 = 1e-3;

/// A case of a run: what is tested on what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// The method's name.
    pub model: String,
    /// The split.
    pub split: Split,
    /// The seed of split, training and damage.
    pub seed: u64,
    /// The task.
    pub task: Task,
    /// Standard deviation of the base noise on clean coordinates, asf.
    pub base_asf: f64,
}

impl Case {
    /// A case; `base` is the base noise in cm.
    pub(crate) fn new(model: &str, split: Split, seed: u64, task: Task, base: f64) -> Case {
        Case {
            model: model.into(),
            split,
            seed,
            task,
            base_asf: base / ASF_UNIT_CM,
        }
    }

    /// The case in words, for messages.
    pub fn describe(&self) -> String {
        let base = match self.base_asf {
            0.0 => String::new(),
            base => format!(", base noise {base} asf"),
        };
        let (model, task, split, seed) =
            (&self.model, self.task.name(), self.split.name(), self.seed);
        format!("{model} (task {task}, split {split}, seed {seed}{base})")
    }
}

/// The result of a case. Errors are means over all coordinates of all frames, exactly observed ones
/// included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchmarkResult {
    /// The case.
    #[serde(flatten)]
    pub case: Case,
    /// The number of training frames; `None` for a pretrained model.
    #[serde(rename = "learnt_from")]
    pub training_frames: Option<usize>,
    /// The error on test frames.
    pub test: Measurement,
    /// The error on as many training frames; `None` for a pretrained model.
    pub training: Option<Measurement>,
    /// The tuning of the model for the task on held-back training poses: the choice and the curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tuning: Option<Value>,
    /// Restored example poses by `ExampleKind::name`:
    /// (frames, 3 J) each, cm, to a tenth of a millimeter. A kind is absent where an estimate
    /// was not finite. `None` for a case without examples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub examples: Option<BTreeMap<String, Vec<Vec<f64>>>>,
    /// Seconds a pose on one thread while other threads work. Not part of any compared output.
    pub seconds_per_pose: f64,
    /// Seconds that training took; `None` for a pretrained model.
    pub seconds_training: Option<f64>,
}

impl BenchmarkResult {
    /// Whether the lists have the lengths for this number of joints. A result read from a file may
    /// not.
    pub(crate) fn is_sound(&self, joints: usize) -> bool {
        let parts = [Some(&self.test), self.training.as_ref()];
        let frames: usize = self.test.units.iter().map(|u| u.frames).sum();
        frames == self.test.frames
            && self.test.units.iter().all(|u| u.frames > 0)
            && (parts.into_iter().flatten())
                .all(|m| m.within.len() == SD_LEVELS.len() && m.by_joint.len() == joints)
    }
}

/// Errors on a set of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// The number of frames.
    pub frames: usize,
    /// Mean squared error of a coordinate, asf².
    pub mse: f64,
    /// Mean squared error by joint, asf² (J).
    pub by_joint: Vec<f64>,
    /// The number of coordinates that count for calibration: neither exact nor constant.
    pub coordinates: u64,
    /// How many of these lie within 0.25, 0.5, … 3 standard deviations.
    pub within: Vec<u64>,
    /// Errors by resampling unit, ascending.
    pub units: Vec<ResampledUnit>,
}

/// The unit of the bootstrap: a take, or under the split `frames` a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ResampledUnit {
    /// The index of the take, or the row of the frame.
    pub unit: usize,
    /// The number of its test frames.
    pub frames: usize,
    /// The mean squared error of a coordinate, asf².
    pub mse: f64,
}

impl Measurement {
    /// RMS error of a coordinate, cm.
    pub(crate) fn rms_cm(&self) -> f64 {
        self.mse.sqrt() * ASF_UNIT_CM
    }
    /// The share of coordinates within each of [`SD_LEVELS`]; empty if no coordinate counts.
    pub(crate) fn shares(&self) -> Vec<f64> {
        let share = |n: &u64| *n as f64 / self.coordinates as f64;
        match self.coordinates {
            0 => Vec::new(),
            _ => self.within.iter().map(share).collect(),
        }
    }
}

/// Whether each coordinate differs between training poses.
pub(crate) fn varying_coordinates(poses: ArrayView2<'_, f32>) -> Vec<bool> {
    let columns = poses.columns().into_iter();
    columns
        .map(|c| span(c.iter().map(|v| f64::from(*v))) > MIN_RANGE)
        .collect()
}

/// Compares estimates with the truth.
///
/// `None` if an estimate is not finite.
pub(crate) fn measure(
    data: &Dataset,
    (split, task): (Split, Task),
    damaged: &DamagedPoses,
    estimates: &[Posterior],
    varying: &[bool],
) -> Option<Measurement> {
    let (truth, rows) = (&damaged.truth, &damaged.rows);
    let joints = truth.ncols() / 3;
    let mut out = Measurement {
        frames: rows.len(),
        mse: 0.0,
        by_joint: vec![0.0; joints],
        coordinates: 0,
        within: vec![0; SD_LEVELS.len()],
        units: Vec::new(),
    };
    for (i, estimate) in estimates.iter().enumerate() {
        let mut sum = 0.0;
        for c in 0..truth.ncols() {
            let error = estimate.mean[c] - truth[[i, c]];
            let variance = estimate.variance[c];
            if !error.is_finite() || !variance.is_finite() {
                return None;
            }
            sum += error * error;
            out.by_joint[c / 3] += error * error;
            // Exactly observed coordinates do not count for calibration; under sparse noise none is
            // known to be exact.
            if (task == Task::Sparse || damaged.variance[[i, c]] > 0.0) && varying[c] {
                out.coordinates += 1;
                let off = error.abs() / variance.max(EXACT_VARIANCE).sqrt();
                let counts = out.within.iter_mut().zip(SD_LEVELS);
                counts.for_each(|(n, (sd, _))| *n += u64::from(off <= sd));
            }
        }
        out.mse += sum;
        let unit = match split {
            Split::Frames => rows[i],
            _ => data.take_of(rows[i]),
        };
        match out.units.last_mut().filter(|u| u.unit == unit) {
            Some(last) => (last.frames, last.mse) = (last.frames + 1, last.mse + sum),
            None => out.units.push(ResampledUnit {
                unit,
                frames: 1,
                mse: sum,
            }),
        }
    }
    let asf = ASF_UNIT_CM * ASF_UNIT_CM;
    let frames = rows.len().max(1) as f64;
    out.mse /= frames * truth.ncols().max(1) as f64 * asf;
    out.by_joint
        .iter_mut()
        .for_each(|e| *e /= frames * 3.0 * asf);
    for unit in &mut out.units {
        unit.mse /= unit.frames as f64 * truth.ncols().max(1) as f64 * asf;
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::*;
    use crate::score::error_stats::ONE_AND_TWO_SD;

    #[test]
    fn errors_are_averaged_by_joint_and_unit() {
        let data = takes(&[("01_01", 4), ("01_02", 4)]);
        let rows = [1, 2, 5];
        let truth = data.rows(&rows);
        let estimate = |i: usize, off: f64| Posterior {
            mean: truth.row(i).iter().map(|v| v + off * ASF_UNIT_CM).collect(),
            variance: vec![ASF_UNIT_CM * ASF_UNIT_CM; 69],
            ..Posterior::default()
        };
        let mut damaged = DamagedPoses::undamaged(&data, &rows);
        damaged.variance.fill(1.0);
        damaged.variance[[0, 5]] = 0.0;
        let estimates = [estimate(0, 0.9), estimate(1, 1.1), estimate(2, 2.1)];
        let varying = varying_coordinates(data.xyz.view());
        assert_eq!(varying.iter().filter(|v| !**v).count(), 3);
        let m = |split| {
            let task = Task::Complete;
            measure(&data, (split, task), &damaged, &estimates, &varying).unwrap()
        };
        let by_take = m(Split::Takes);
        let squares = [0.81, 1.21, 4.41];
        assert!((by_take.mse - squares.iter().sum::<f64>() / 3.0).abs() <= 1e-9);
        assert!((by_take.by_joint[7] - by_take.mse).abs() <= 1e-9);
        assert_eq!(by_take.coordinates, 3 * 66 - 1);
        assert_eq!(by_take.within[ONE_AND_TWO_SD[0]], 65);
        assert_eq!(by_take.within[ONE_AND_TWO_SD[1]], 65 + 66);
        assert_eq!(by_take.units.len(), 2);
        assert_eq!((by_take.units[0].unit, by_take.units[0].frames), (0, 2));
        assert!((by_take.units[0].mse - 1.01).abs() <= 1e-9);
        let frames = m(Split::Frames);
        assert_eq!(
            frames.units.iter().map(|u| u.unit).collect::<Vec<_>>(),
            rows
        );
        let mut bad = estimates.clone();
        bad[1].mean[3] = f64::NAN;
        let case = (Split::Takes, Task::Dense);
        let none = measure(&data, case, &damaged, &bad, &varying);
        assert!(none.is_none());
    }

    #[test]
    fn the_gaussian_shares_are_right() {
        // The error function by Simpson's rule.
        for (sd, share) in SD_LEVELS {
            let n = 2000;
            let h = sd / n as f64;
            let f = |x: f64| (-0.5 * x * x).exp();
            let sum: f64 = (0..n)
                .map(|i| {
                    let x = i as f64 * h;
                    f(x) + 4.0 * f(x + h / 2.0) + f(x + h)
                })
                .sum();
            let found = 2.0 * sum * h / 6.0 / (2.0 * std::f64::consts::PI).sqrt();
            assert!((found - share).abs() <= 2e-6, "{sd}: {found}");
        }
    }
}
