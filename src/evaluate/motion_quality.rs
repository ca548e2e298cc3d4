//! Motion quality: how constant bone lengths are, and how large accelerations (jitter).

use super::error_stats::mean;
use super::frame::ScoredFrame;
use crate::pose::joints::parents_by_name;
use serde::Serialize;

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

/// RMS accelerations of a coordinate (unit/s²), over all coordinates with three consecutive frames in truth and result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Accelerations {
    /// The number of accelerations compared.
    pub count: u64,
    /// RMS acceleration of the truth.
    pub truth: Option<f64>,
    /// RMS acceleration of the result: larger than the truth's with jitter, smaller after too much smoothing.
    pub result: Option<f64>,
    /// RMS acceleration of the error, result minus truth.
    pub difference: Option<f64>,
}

/// Mean and summed squared deviations of a series, by Welford's recurrence.
#[derive(Debug, Clone, Default)]
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

/// The sums behind [`BoneLengths`].
#[derive(Debug, Clone)]
pub(super) struct BoneLengthSums {
    /// Point, parent, lengths of truth and result, summed squared differences.
    bones: Vec<(usize, usize, [RunningVariance; 2], f64)>,
}

impl BoneLengthSums {
    pub(super) fn new(points: &[String]) -> BoneLengthSums {
        let parents = parents_by_name(points).into_iter().enumerate();
        let bone = |(point, parent): (usize, Option<usize>)| {
            parent.map(|parent| (point, parent, Default::default(), 0.0))
        };
        BoneLengthSums {
            bones: parents.filter_map(bone).collect(),
        }
    }

    pub(super) fn add(&mut self, truth: &[f64], result: &[f64]) {
        for (point, parent, lengths, squares) in &mut self.bones {
            let [t, r] = [truth, result].map(|xyz| distance(xyz, *point, *parent));
            if !t.is_nan() && !r.is_nan() {
                lengths[0].add(t);
                lengths[1].add(r);
                *squares += (r - t) * (r - t);
            }
        }
    }

    /// `None` without a known bone.
    pub(super) fn finish(&self, points: &[String], unit: f64) -> Option<BoneLengths> {
        if self.bones.is_empty() {
            return None;
        }
        let root = |squares: f64, count: u64| mean(squares, count).map(|v| v.sqrt() / unit);
        let (mut count, mut sums) = (0, [0.0; 3]);
        let mut by_bone = Vec::new();
        for (point, parent, [truth, result], squares) in &self.bones {
            count += truth.count;
            sums[0] += squares;
            sums[1] += truth.squares;
            sums[2] += result.squares;
            let length = |s: &RunningVariance| (s.count > 0).then(|| s.mean / unit);
            by_bone.push(BoneLength {
                point: points[*point].clone(),
                parent: points[*parent].clone(),
                frames: truth.count,
                truth: length(truth),
                result: length(result),
                truth_sd: root(truth.squares, truth.count),
                result_sd: root(result.squares, result.count),
                rms_difference: root(*squares, truth.count),
            });
        }
        let [rms_difference, truth_sd, result_sd] = sums.map(|s| root(s, count));
        Some(BoneLengths {
            rms_difference,
            truth_sd,
            result_sd,
            by_bone,
        })
    }
}

fn distance(xyz: &[f64], a: usize, b: usize) -> f64 {
    let squared = |axis: usize| (xyz[3 * a + axis] - xyz[3 * b + axis]).powi(2);
    (squared(0) + squared(1) + squared(2)).sqrt()
}

/// The sums behind [`Accelerations`].
#[derive(Debug, Clone, Default)]
pub(super) struct AccelerationSums {
    /// Truth and result of the last two frames of the run, newest last.
    last: Vec<[Vec<f64>; 2]>,
    count: u64,
    /// Squared accelerations of truth, result and error.
    squares: [f64; 3],
}

impl AccelerationSums {
    /// Adds a frame of a take with `rate` frames a second.
    pub(super) fn add(&mut self, frame: &ScoredFrame<'_>, rate: f64) {
        let (truth, result) = (frame.truth, frame.result);
        if frame.starts_run {
            self.last.clear();
        }
        if self.last.len() < 2 {
            self.last.push([truth.to_vec(), result.to_vec()]);
            return;
        }
        let second = |new: f64, which: usize, i: usize| {
            (new - 2.0 * self.last[1][which][i] + self.last[0][which][i]) * rate * rate
        };
        for (i, (&t, &r)) in truth.iter().zip(result).enumerate() {
            let (t, r) = (second(t, 0, i), second(r, 1, i));
            if !t.is_nan() && !r.is_nan() {
                self.count += 1;
                for (sum, v) in self.squares.iter_mut().zip([t, r, r - t]) {
                    *sum += v * v;
                }
            }
        }
        self.last.swap(0, 1);
        for (kept, new) in self.last[1].iter_mut().zip([truth, result]) {
            kept.copy_from_slice(new);
        }
    }

    pub(super) fn finish(&self, unit: f64) -> Accelerations {
        let root = |s: f64| mean(s, self.count).map(|v| v.sqrt() / unit);
        let [truth, result, difference] = self.squares.map(root);
        Accelerations {
            count: self.count,
            truth,
            result,
            difference,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|s| s.to_string()).collect()
    }

    #[test]
    fn bones_vary_and_differ() {
        let points = names(&["lfemur", "root", "tail"]);
        let mut sums = BoneLengthSums::new(&points);
        for (frame, longer) in [0.0, 2.0].into_iter().enumerate() {
            let shift = frame as f64;
            let truth = [3.0 + shift, 4.0, 0.0, shift, 0.0, 0.0, 9.0, 9.0, 9.0];
            let mut result = truth;
            result[0] = shift;
            result[1] = 5.0 + longer;
            sums.add(&truth, &result);
        }
        sums.add(&[f64::NAN; 9], &[0.0; 9]);
        let bones = sums.finish(&points, 1.0).unwrap();
        assert_eq!(bones.by_bone.len(), 1);
        let bone = &bones.by_bone[0];
        assert_eq!(
            (bone.point.as_str(), bone.parent.as_str(), bone.frames),
            ("lfemur", "root", 2)
        );
        assert_eq!((bone.truth, bone.result), (Some(5.0), Some(6.0)));
        assert_eq!((bone.truth_sd, bone.result_sd), (Some(0.0), Some(1.0)));
        assert!((bones.rms_difference.unwrap() - 2f64.sqrt()).abs() <= 1e-12);
        assert!(
            BoneLengthSums::new(&names(&["a", "b"]))
                .finish(&names(&["a", "b"]), 1.0)
                .is_none()
        );
    }

    #[test]
    fn a_parabola_has_one_acceleration() {
        let (rate, g) = (50.0, 981.0);
        let mut sums = AccelerationSums::default();
        for i in 0..40 {
            let t = i as f64 / rate;
            let y = -0.5 * g * t * t;
            let frame = ScoredFrame {
                truth: &[0.0, y, 0.0],
                result: &[0.0, y / 2.0, f64::NAN],
                damaged: None,
                starts_run: i == 0,
                rate: Some(rate),
            };
            sums.add(&frame, rate);
        }
        let a = sums.finish(1.0);
        assert_eq!(a.count, 2 * 38);
        // Of two coordinates one falls.
        assert!((a.truth.unwrap() - g / 2f64.sqrt()).abs() <= 1e-6 * g);
        assert!((a.result.unwrap() - g / 8f64.sqrt()).abs() <= 1e-6 * g);
        assert!((a.difference.unwrap() - g / 8f64.sqrt()).abs() <= 1e-6 * g);
    }

    #[test]
    fn a_jump_between_runs_is_no_acceleration() {
        let mut sums = AccelerationSums::default();
        for i in 0..8 {
            let x = if i < 4 { 0.0 } else { 1000.0 };
            let frame = ScoredFrame {
                truth: &[x; 3],
                result: &[x; 3],
                damaged: None,
                starts_run: i == 0 || i == 4,
                rate: Some(120.0),
            };
            sums.add(&frame, 120.0);
        }
        assert_eq!(sums.finish(1.0).truth, Some(0.0));
        assert_eq!(sums.count, 2 * 2 * 3);
        assert_eq!(AccelerationSums::default().finish(1.0).truth, None);
    }
}
