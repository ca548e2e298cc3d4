//! How far a result is from the truth.
//!
//! Let t be a coordinate of the truth, r of the result, d of the damaged table that the result was
//! made from. Over a set of coordinates, MSE = mean of (r - t)², as in Lai et al.'s tables (there
//! in asf²). A coordinate that is missing in t does not count. One that is missing in r counts as
//! still missing and is in no mean.

use super::alignment::point_order;
use super::error_breakdown::ErrorBreakdown;
use super::error_stats::{ErrorStats, ErrorSums, point};
use super::motion_quality::{Accelerations, BoneLengths};
use crate::pose::Poses;
use crate::{Error, Result};
use ndarray::Array2;
use serde::Serialize;

/// The result of a score. Lengths are in `units`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScoreReport {
    /// The name of the unit of length.
    pub units: String,
    /// The number of frames.
    pub frames: u64,
    /// The number of points.
    pub points: usize,
    /// Frames a second, if known and equal for all takes with a rate.
    pub rate: Option<f64>,
    /// The different rates of the takes, in order of appearance.
    pub rates: Vec<f64>,
    /// Errors over all coordinates.
    pub all: ErrorStats,
    /// Errors by point.
    pub by_point: Vec<PointErrors>,
    /// Errors by what was missing, observed and changed, if a damaged table is given.
    pub damaged: Option<ErrorBreakdown>,
    /// Bone lengths, if the points' names define bones.
    pub bones: Option<BoneLengths>,
    /// Accelerations, if a rate is known; each take at its own.
    pub accelerations: Option<Accelerations>,
}

/// The errors of one point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PointErrors {
    /// The point's name.
    pub point: String,
    /// The point's errors.
    #[serde(flatten)]
    pub errors: ErrorStats,
}

/// Compares a table with the truth.
///
/// Both must have the same frames. Points are matched by name; further points of the result do not
/// count. Lengths of the report are in centimeters.
///
/// ```
/// use ndarray::array;
/// use posing_score::Score;
/// use posing_core::pose::Poses;
///
/// let table = |xyz| Poses { points: vec!["root".into()], xyz, ..Poses::default() };
/// let truth = table(array![[0.0, 90.0, 0.0], [1.0, 90.0, 0.0]]);
/// let damaged = table(array![[0.0, 90.0, 0.0], [f64::NAN; 3]]);
/// let result = table(array![[0.0, 90.0, 0.0], [1.0, 90.0, 3.0]]);
///
/// let report = Score::new(&truth, &result)?.by_gap(&damaged)?.finish();
/// assert_eq!(report.all.max, Some(3.0));
/// let filled = &report.damaged.as_ref().unwrap().missing;
/// assert_eq!((filled.coordinates, filled.mse), (3, Some(3.0)));
/// println!("{report}");
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Score<'a> {
    truth: &'a Poses,
    /// (frames, 3 J) in the order of the truth's points.
    result: Array2<f64>,
    damaged: Option<Array2<f64>>,
    /// The table with times: the truth if it has any.
    clock: &'a Poses,
    /// Frames a second of each take.
    rates: Vec<Option<f64>>,
}

impl<'a> Score<'a> {
    /// A score of `result` against `truth`.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is no frame, a point is missing in the result, or frames, takes or
    /// times differ.
    pub fn new(truth: &'a Poses, result: &'a Poses) -> Result<Score<'a>> {
        if truth.frames() == 0 {
            return Err(Error::usage("the truth has no frames to compare"));
        }
        let clock = if truth.time.is_some() { truth } else { result };
        Ok(Score {
            truth,
            result: aligned(truth, result, "result")?,
            damaged: None,
            clock,
            rates: clock.rates(),
        })
    }

    /// The table whose takes and times count: the truth if it has times, else the result.
    pub fn clock(&self) -> &'a Poses {
        self.clock
    }

    /// Replaces the frames a second of each take, by default `Poses::rates` of [`Score::clock`].
    #[must_use]
    pub fn with_rates(self, rates: Vec<Option<f64>>) -> Score<'a> {
        Score { rates, ..self }
    }

    /// Also reports errors by what `damaged` lacks, by the length of its gaps, and by what it
    /// observes.
    ///
    /// # Errors
    /// As [`Score::new`], for the damaged table.
    pub fn by_gap(self, damaged: &Poses) -> Result<Score<'a>> {
        Ok(Score {
            damaged: Some(aligned(self.truth, damaged, "damaged table")?),
            ..self
        })
    }

    /// The report, in centimeters.
    pub fn finish(&self) -> ScoreReport {
        self.finish_in("cm", 1.0)
    }

    /// The report, with lengths in a unit of `centimeters`.
    pub fn finish_in(&self, units: &str, centimeters: f64) -> ScoreReport {
        let (points, unit) = (&self.truth.points, centimeters);
        let (truth, result) = (self.truth.xyz.view(), self.result.view());
        let mut all = ErrorSums::default();
        let mut by_point = vec![ErrorSums::default(); points.len()];
        for (truth, result) in truth.rows().into_iter().zip(result.rows()) {
            for (i, sums) in by_point.iter_mut().enumerate() {
                let mut one = ErrorSums::default();
                one.add(point(truth, i), point(result, i), [true; 3]);
                sums.merge(&one);
                all.merge(&one);
            }
        }
        let mut rates = Vec::new();
        for rate in self.rates.iter().flatten() {
            if !rates.contains(rate) {
                rates.push(*rate);
            }
        }
        let runs = self.clock.timed_runs(&self.rates);
        let named = points.iter().zip(&by_point);
        ScoreReport {
            units: units.to_string(),
            frames: self.truth.frames() as u64,
            points: points.len(),
            rate: match rates[..] {
                [rate] => Some(rate),
                _ => None,
            },
            all: all.errors(unit),
            by_point: named
                .map(|(point, sums)| PointErrors {
                    point: point.clone(),
                    errors: sums.errors(unit),
                })
                .collect(),
            bones: BoneLengths::of(points, truth, result, unit),
            accelerations: (!rates.is_empty())
                .then(|| Accelerations::of(truth, result, &runs, unit)),
            damaged: (self.damaged.as_ref())
                .map(|d| ErrorBreakdown::of(truth, result, d.view(), &runs, unit)),
            rates,
        }
    }
}

/// The coordinates of `other` in the order of the truth's points.
fn aligned(truth: &Poses, other: &Poses, name: &str) -> Result<Array2<f64>> {
    let order = point_order(truth, other);
    let order = order.map_err(|what| Error::usage(format!("the {name} {what}")))?;
    let columns: Vec<usize> = order.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
    Ok(other.xyz.select(ndarray::Axis(1), &columns))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ndarray::array;

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    /// A table of points `p0`, `p1`, … at `rate` frames a second.
    pub(crate) fn table(xyz: Array2<f64>, rate: Option<f64>) -> Poses {
        let frames = xyz.nrows();
        Poses {
            points: names(xyz.ncols() / 3),
            xyz,
            time: rate.map(|rate| (0..frames).map(|t| t as f64 / rate).collect()),
            take: None,
        }
    }

    #[test]
    fn all_and_by_point() {
        let nan = f64::NAN;
        let truth = table(
            array![
                [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, nan, nan, nan]
            ],
            None,
        );
        let result = table(
            array![
                [1.0, 1.0, 1.0, 2.0, 2.0, nan],
                [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
            ],
            None,
        );
        let r = Score::new(&truth, &result).unwrap().finish();
        assert_eq!((r.frames, r.points), (2, 2));
        assert_eq!((r.all.coordinates, r.all.still_missing), (8, 1));
        assert_eq!(r.all.mse, Some((6.0 + 8.0) / 8.0));
        assert_eq!(r.by_point[0].errors.rms, Some(1.0));
        assert_eq!(r.by_point[1].errors.mse, Some(4.0));
        assert!(r.accelerations.is_none() && r.bones.is_none() && r.damaged.is_none());
    }

    #[test]
    fn nothing_compared_gives_no_number() {
        let truth = table(array![[f64::NAN; 3]], None);
        let r = Score::new(&truth, &truth).unwrap().finish_in("asf", 5.0);
        assert_eq!((r.all.mse, r.all.max), (None, None));
        let json = serde_json::to_string(&r).unwrap();
        assert!(json.contains("\"mse\":null") && json.contains("\"units\":\"asf\""));
    }

    #[test]
    fn units_scale_every_length() {
        let squares = Array2::from_shape_fn((5, 3), |(t, _)| (t * t) as f64);
        let (truth, result) = (
            table(squares.clone(), Some(10.0)),
            table(2.0 * squares, None),
        );
        let score = Score::new(&truth, &result).unwrap();
        let (one, five) = (score.finish(), score.finish_in("u", 5.0));
        let close = |a: Option<f64>, b: Option<f64>, by: f64| {
            assert!((a.unwrap() / b.unwrap() - by).abs() <= 1e-12);
        };
        close(one.all.mse, five.all.mse, 25.0);
        close(one.all.max, five.all.max, 5.0);
        let [a, b] = [one, five].map(|r| r.accelerations.unwrap());
        close(a.truth, b.truth, 5.0);
        assert!((a.truth.unwrap() - 200.0).abs() <= 1e-9);
    }

    #[test]
    fn points_are_matched_by_name_and_runs_and_rates_come_from_the_clock() {
        let time = |t: i32| f64::from(t) * 0.1 + if t < 3 { 0.0 } else { 5.0 };
        let xyz = Array2::from_shape_fn((6, 6), |(t, c)| ((t * t * 7 + c * 5) % 11) as f64);
        let truth = Poses {
            points: names(2),
            xyz: xyz.clone(),
            time: Some((0..6).map(time).collect()),
            take: None,
        };
        // The result has the points in another order, and one more.
        let mut other = Array2::zeros((6, 9));
        for c in 0..3 {
            other.column_mut(c).assign(&xyz.column(c + 3));
            other.column_mut(6 + c).assign(&(&xyz.column(c) + 1.0));
        }
        let result = Poses {
            points: ["p1", "more", "p0"].map(String::from).to_vec(),
            xyz: other,
            ..Poses::default()
        };
        let mut damaged = truth.clone();
        damaged.xyz[[4, 0]] = f64::NAN;
        let score = Score::new(&truth, &result)
            .unwrap()
            .by_gap(&damaged)
            .unwrap();
        let report = score.finish();
        assert_eq!((report.frames, report.rate), (6, Some(10.0)));
        let mse = [0, 1].map(|p| report.by_point[p].errors.mse);
        assert_eq!(mse, [Some(1.0), Some(0.0)]);
        // Two runs of three frames have an acceleration each of six coordinates.
        assert_eq!(report.accelerations.unwrap().count, 2 * 6);
        assert_eq!(report.damaged.unwrap().by_gap[0].gaps, 1);
        assert_eq!(score.with_rates(vec![None]).finish().accelerations, None);
    }

    #[test]
    fn tables_that_differ_are_refused() {
        let table = |points: usize, frames: usize| Poses {
            points: names(points),
            xyz: Array2::zeros((frames, 3 * points)),
            time: Some((0..frames).map(|t| t as f64).collect()),
            take: Some(vec!["a".into(); frames]),
        };
        let truth = table(2, 3);
        let says = |other: Poses, part: &str| {
            let e = Score::new(&truth, &other).unwrap_err();
            assert!(e.to_string().contains(part), "{e}");
            let good = Score::new(&truth, &truth).unwrap();
            assert!(good.by_gap(&other).unwrap_err().to_string().contains(part));
        };
        says(table(1, 3), "has no point \"p1\"");
        says(table(2, 2), "has 2 frames, not 3");
        says(
            Poses {
                time: Some(vec![0.0, 1.0, 2.1]),
                ..truth.clone()
            },
            "time 2.1 in frame 2",
        );
        says(
            Poses {
                take: Some(vec!["a".into(), "b".into(), "b".into()]),
                ..truth.clone()
            },
            "take b in frame 1",
        );
        assert!(Score::new(&table(2, 0), &table(2, 0)).is_err());
        let renamed = Poses {
            take: Some(vec!["b".into(); 3]),
            ..truth.clone()
        };
        assert!(Score::new(&truth, &renamed).is_ok());
    }
}
