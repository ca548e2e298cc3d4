//! One cell: a method on a task under a split with a seed, and all that is measured there.

use super::dataset::Dataset;
use super::splits::Split;
use super::task::{DamagedPoses, Task};
use crate::pose::ASF_UNIT_CM;
use crate::prior::{EXACT_VARIANCE, Posterior};
use ndarray::ArrayView2;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Deviations at which is counted how many coordinates lie within, and the share of a Gaussian that does.
pub const SD_LEVELS: [(f64, f64); 12] = [
    (0.25, 0.197_413),
    (0.5, 0.382_925),
    (0.75, 0.546_745),
    (1.0, 0.682_689),
    (1.25, 0.788_700),
    (1.5, 0.866_386),
    (1.75, 0.919_882),
    (2.0, 0.954_500),
    (2.25, 0.975_551),
    (2.5, 0.987_581),
    (2.75, 0.994_040),
    (3.0, 0.997_300),
];
/// Where one and two deviations stand in [`SD_LEVELS`].
pub const ONE_AND_TWO_SD: [usize; 2] = [3, 7];
/// A coordinate that deviates less than this in training, cm, is constant (the root is), and says nothing of calibration.
const CONSTANT: f64 = 1e-3;

/// What tells a cell from all others of a run.
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
    /// Standard deviation of the noise on clean and exact coordinates, asf.
    pub base_asf: f64,
}

/// A cell's measurements. Errors are means over all coordinates of all frames, those given exactly included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchmarkResult {
    /// Which cell.
    #[serde(flatten)]
    pub case: Case,
    /// Frames that the model was trained from; `None` for a given model.
    #[serde(rename = "learnt_from")]
    pub training_frames: Option<usize>,
    /// On test frames.
    pub test: Measurement,
    /// On as many frames that were learnt from; `None` for a given model.
    pub training: Option<Measurement>,
    /// How the model was tuned for the task on a part of its training poses: what was chosen, and the curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tuning: Option<Value>,
    /// Seconds a pose on one thread, while others work: never compared, never digested.
    pub seconds_per_pose: f64,
    /// Seconds that training took, all threads together; `None` for a given model.
    pub seconds_training: Option<f64>,
}

impl BenchmarkResult {
    /// Whether its lists are as they are made for so many joints: it may come from a file.
    pub fn is_sound(&self, joints: usize) -> bool {
        let parts = [Some(&self.test), self.training.as_ref()];
        let frames: usize = self.test.units.iter().map(|u| u.frames).sum();
        frames == self.test.frames
            && self.test.units.iter().all(|u| u.frames > 0)
            && (parts.into_iter().flatten())
                .all(|m| m.within.len() == SD_LEVELS.len() && m.by_joint.len() == joints)
    }
}

/// What was measured on some frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// How many frames.
    pub frames: usize,
    /// Mean squared error a coordinate, asf².
    pub mse: f64,
    /// The same by joint, J of them, asf².
    pub by_joint: Vec<f64>,
    /// Of how many coordinates it is known whether they lie within their deviation: neither exact nor constant ones.
    pub coordinates: u64,
    /// How many of them lie within each of [`SD_LEVELS`]'s deviations.
    pub within: Vec<u64>,
    /// Sums by unit of resampling, ascending.
    pub units: Vec<ResampledUnit>,
}

/// What is drawn as one when intervals are found: a take, or under the split `frames` a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ResampledUnit {
    /// The take's place in the data, or the frame's row.
    pub unit: usize,
    /// Frames of it that were tested.
    pub frames: usize,
    /// Their mean squared error, asf².
    pub mse: f64,
}

impl Measurement {
    /// RMS a coordinate, cm.
    pub fn rms_cm(&self) -> f64 {
        self.mse.sqrt() * ASF_UNIT_CM
    }
    /// The share of coordinates within each of [`SD_LEVELS`]'s deviations; none where no coordinate counts.
    pub fn shares(&self) -> Vec<f64> {
        let share = |n: &u64| *n as f64 / self.coordinates as f64;
        match self.coordinates {
            0 => Vec::new(),
            _ => self.within.iter().map(share).collect(),
        }
    }
}

/// Which coordinates differ between training poses.
pub fn varies(poses: ArrayView2<'_, f32>) -> Vec<bool> {
    let range = |column: ndarray::ArrayView1<'_, f32>| {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in column {
            low = low.min(f64::from(*v));
            high = high.max(f64::from(*v));
        }
        high - low
    };
    let columns = poses.columns();
    columns.into_iter().map(|c| range(c) > CONSTANT).collect()
}

/// Compares answers with the truth (frames, 3 J), cm; `rows` are the frames' numbers in the data, ascending.
///
/// `None` where an answer is not finite.
pub fn measure(
    data: &Dataset,
    (split, task): (Split, Task),
    rows: &[usize],
    truth: ArrayView2<'_, f64>,
    damaged: &DamagedPoses,
    answers: &[Posterior],
    varies: &[bool],
) -> Option<Measurement> {
    let joints = truth.ncols() / 3;
    let mut out = Measurement {
        frames: rows.len(),
        mse: 0.0,
        by_joint: vec![0.0; joints],
        coordinates: 0,
        within: vec![0; SD_LEVELS.len()],
        units: Vec::new(),
    };
    for (i, answer) in answers.iter().enumerate() {
        let mut sum = 0.0;
        for c in 0..truth.ncols() {
            let error = answer.mean[c] - truth[[i, c]];
            let variance = answer.variance[c];
            if !error.is_finite() || !variance.is_finite() {
                return None;
            }
            sum += error * error;
            out.by_joint[c / 3] += error * error;
            // What a completion sees exactly says nothing; under sparse noise nothing is known to be exact.
            if (task == Task::Sparse || damaged.variance[[i, c]] > 0.0) && varies[c] {
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
    use ndarray::Array2;

    #[test]
    fn errors_are_counted_as_they_are() {
        let data = takes(&[("01_01", 4), ("01_02", 4)]);
        let rows = [1, 2, 5];
        let truth = data.rows(&rows);
        let answer = |i: usize, off: f64| Posterior {
            mean: truth.row(i).iter().map(|v| v + off * ASF_UNIT_CM).collect(),
            variance: vec![ASF_UNIT_CM * ASF_UNIT_CM; 69],
            ..Posterior::default()
        };
        let variance = Array2::from_elem((3, 69), 1.0);
        let mut damaged = DamagedPoses {
            y: truth.clone(),
            variance,
        };
        damaged.variance[[0, 5]] = 0.0;
        let answers = [answer(0, 0.9), answer(1, 1.1), answer(2, 2.1)];
        let varies = varies(data.xyz.view());
        assert_eq!(varies.iter().filter(|v| !**v).count(), 3);
        let m = |split| {
            let all = measure(
                &data,
                (split, Task::Complete),
                &rows,
                truth.view(),
                &damaged,
                &answers,
                &varies,
            );
            all.unwrap()
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
        let mut bad = answers.clone();
        bad[1].mean[3] = f64::NAN;
        let none = measure(
            &data,
            (Split::Takes, Task::Dense),
            &rows,
            truth.view(),
            &damaged,
            &bad,
            &varies,
        );
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
