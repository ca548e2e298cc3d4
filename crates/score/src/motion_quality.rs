//! Motion quality: how constant bone lengths are, and how large accelerations (jitter).

use super::error_stats::mean;
use crate::pose::joints::parents_by_name;
use ndarray::{ArrayView1, ArrayView2};
use serde::Serialize;
use std::ops::Range;

/// Lengths of the bones that the points' names define (CMU's), in the unit of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BoneLengths {
    /// RMS difference of a bone's length, result minus truth, over all bones and frames.
    pub rms_difference: Option<f64>,
    /// Standard deviation of a bone's length around its mean in the truth, pooled over the bones.
    pub truth_sd: Option<f64>,
    /// Standard deviation of a bone's length around its mean in the result, pooled over the bones.
    pub result_sd: Option<f64>,
    /// Each bone.
    pub by_bone: Vec<BoneLength>,
}

/// The length of one bone over the frames in which truth and result have both ends.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BoneLength {
    /// The end of the bone.
    pub point: String,
    /// The start of the bone.
    pub parent: String,
    /// The number of frames compared.
    pub frames: u64,
    /// Mean length in the truth.
    pub truth: Option<f64>,
    /// Mean length in the result.
    pub result: Option<f64>,
    /// Standard deviation of the length in the truth.
    pub truth_sd: Option<f64>,
    /// Standard deviation of the length in the result.
    pub result_sd: Option<f64>,
    /// RMS difference, result minus truth.
    pub rms_difference: Option<f64>,
}

/// RMS accelerations of a coordinate (unit/s²), over all coordinates with three consecutive frames
/// in truth and result.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_score::Score;
///
/// let table = |xyz| Poses { points: vec!["knee".into()], xyz, ..Poses::default() };
/// let truth = table(ndarray::Array2::zeros((20, 3)));
/// let shaken = ndarray::Array2::from_shape_fn((20, 3), |(t, _)| (t % 2) as f64);
/// let report = Score::new(&truth, &table(shaken))?.with_rates(vec![Some(10.0)]).finish();
/// let accelerations = report.accelerations.ok_or("no rate")?;
/// assert_eq!(accelerations.truth, Some(0.0));
/// assert_eq!(accelerations.result, Some(200.0)); // 2 cm, times the rate squared
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Accelerations {
    /// The number of accelerations compared.
    pub count: u64,
    /// RMS acceleration of the truth.
    pub truth: Option<f64>,
    /// RMS acceleration of the result: larger than the truth's with jitter, smaller after too much
    /// smoothing.
    pub result: Option<f64>,
    /// RMS acceleration of the error, result minus truth.
    pub difference: Option<f64>,
}

/// Mean and summed squared deviations of a series, by Welford's recurrence.
#[derive(Debug, Clone, Copy, Default)]
struct RunningVariance {
    count: u64,
    mean: f64,
    squares: f64,
}

impl RunningVariance {
    fn add(&mut self, value: f64) {
        self.count += 1;
        let off = value - self.mean;
        self.mean += off / self.count as f64;
        self.squares += off * (value - self.mean);
    }
}

impl BoneLengths {
    /// The bones of two tables (frames, 3 J); lengths in a unit of `unit` centimeters. `None`
    /// without a known bone.
    pub(super) fn of(
        points: &[String],
        truth: ArrayView2<'_, f64>,
        result: ArrayView2<'_, f64>,
        unit: f64,
    ) -> Option<BoneLengths> {
        let root = |squares: f64, count: u64| mean(squares, count).map(|v| v.sqrt() / unit);
        let (mut count, mut sums) = (0, [0.0; 3]);
        let mut by_bone = Vec::new();
        for (point, parent) in parents_by_name(points).into_iter().enumerate() {
            let Some(parent) = parent else {
                continue;
            };
            let [mut of_truth, mut of_result] = [RunningVariance::default(); 2];
            let mut squares = 0.0;
            for (truth, result) in truth.rows().into_iter().zip(result.rows()) {
                let [t, r] = [truth, result].map(|xyz| distance(xyz, point, parent));
                if !t.is_nan() && !r.is_nan() {
                    of_truth.add(t);
                    of_result.add(r);
                    squares += (r - t) * (r - t);
                }
            }
            count += of_truth.count;
            for (sum, own) in (sums.iter_mut()).zip([squares, of_truth.squares, of_result.squares])
            {
                *sum += own;
            }
            let length = |s: &RunningVariance| (s.count > 0).then(|| s.mean / unit);
            by_bone.push(BoneLength {
                point: points[point].clone(),
                parent: points[parent].clone(),
                frames: of_truth.count,
                truth: length(&of_truth),
                result: length(&of_result),
                truth_sd: root(of_truth.squares, of_truth.count),
                result_sd: root(of_result.squares, of_truth.count),
                rms_difference: root(squares, of_truth.count),
            });
        }
        let [rms_difference, truth_sd, result_sd] = sums.map(|s| root(s, count));
        (!by_bone.is_empty()).then_some(BoneLengths {
            rms_difference,
            truth_sd,
            result_sd,
            by_bone,
        })
    }
}

fn distance(xyz: ArrayView1<'_, f64>, a: usize, b: usize) -> f64 {
    let squared = |axis: usize| (xyz[3 * a + axis] - xyz[3 * b + axis]).powi(2);
    (squared(0) + squared(1) + squared(2)).sqrt()
}

impl Accelerations {
    /// The second differences of two tables (frames, 3 J) within `runs` of consecutive frames, each
    /// with its frames a second; lengths in a unit of `unit` centimeters.
    pub(super) fn of(
        truth: ArrayView2<'_, f64>,
        result: ArrayView2<'_, f64>,
        runs: &[(Range<usize>, Option<f64>)],
        unit: f64,
    ) -> Accelerations {
        let (mut count, mut squares) = (0, [0.0; 3]);
        for (run, rate) in runs {
            let Some(rate) = rate else {
                continue;
            };
            for t in run.start + 2..run.end {
                for c in 0..truth.ncols() {
                    let [truth, result] = [truth, result]
                        .map(|x| (x[[t, c]] - 2.0 * x[[t - 1, c]] + x[[t - 2, c]]) * rate * rate);
                    if !truth.is_nan() && !result.is_nan() {
                        count += 1;
                        for (sum, v) in squares.iter_mut().zip([truth, result, result - truth]) {
                            *sum += v * v;
                        }
                    }
                }
            }
        }
        let root = |s: f64| mean(s, count).map(|v| v.sqrt() / unit);
        let [truth, result, difference] = squares.map(root);
        Accelerations {
            count,
            truth,
            result,
            difference,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    #[test]
    fn bones_vary_and_differ() {
        let points = ["lfemur", "root", "tail"].map(String::from);
        let nan = f64::NAN;
        let truth = array![
            [3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 9.0, 9.0, 9.0],
            [4.0, 4.0, 0.0, 1.0, 0.0, 0.0, 9.0, 9.0, 9.0],
            [nan, nan, nan, nan, nan, nan, nan, nan, nan]
        ];
        let mut result = truth.clone();
        result[[0, 0]] = 0.0;
        result[[0, 1]] = 5.0;
        result[[1, 0]] = 1.0;
        result[[1, 1]] = 7.0;
        result.row_mut(2).fill(0.0);
        let bones = BoneLengths::of(&points, truth.view(), result.view(), 1.0).unwrap();
        assert_eq!(bones.by_bone.len(), 1);
        let bone = &bones.by_bone[0];
        assert_eq!(
            (&*bone.point, &*bone.parent, bone.frames),
            ("lfemur", "root", 2)
        );
        assert_eq!((bone.truth, bone.result), (Some(5.0), Some(6.0)));
        assert_eq!((bone.truth_sd, bone.result_sd), (Some(0.0), Some(1.0)));
        assert!((bones.rms_difference.unwrap() - 2f64.sqrt()).abs() <= 1e-12);
        let unknown = ["a", "b", "c"].map(String::from);
        assert_eq!(
            BoneLengths::of(&unknown, truth.view(), result.view(), 1.0),
            None
        );
    }

    #[test]
    fn a_parabola_has_one_acceleration() {
        let (rate, g) = (50.0, 981.0);
        let y = |i: usize| -0.5 * g * (i as f64 / rate).powi(2);
        let truth = Array2::from_shape_fn((40, 3), |(i, c)| if c == 1 { y(i) } else { 0.0 });
        let mut result = &truth / 2.0;
        result.column_mut(2).fill(f64::NAN);
        let a = Accelerations::of(truth.view(), result.view(), &[(0..40, Some(rate))], 1.0);
        assert_eq!(a.count, 2 * 38);
        // One of two coordinates falls.
        assert!((a.truth.unwrap() - g / 2f64.sqrt()).abs() <= 1e-6 * g);
        assert!((a.result.unwrap() - g / 8f64.sqrt()).abs() <= 1e-6 * g);
        assert!((a.difference.unwrap() - g / 8f64.sqrt()).abs() <= 1e-6 * g);
    }

    #[test]
    fn a_jump_between_runs_is_no_acceleration() {
        let x = Array2::from_shape_fn((8, 3), |(i, _)| if i < 4 { 0.0 } else { 1000.0 });
        let runs = [(0..4, Some(120.0)), (4..8, Some(120.0))];
        let a = Accelerations::of(x.view(), x.view(), &runs, 1.0);
        assert_eq!((a.truth, a.count), (Some(0.0), 2 * 2 * 3));
        assert_eq!(
            Accelerations::of(x.view(), x.view(), &[(0..8, None)], 1.0).truth,
            None
        );
    }
}
