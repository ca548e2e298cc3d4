//! How far a result is from the truth, added up frame by frame in memory that does not grow.
//!
//! Let t be a coordinate of the truth, r of the result, d of what the result was made from (the damaged table). Over a
//! set of coordinates, MSE = mean of (r - t)^2, as in the paper's tables (there in raw ASF units, squared). A coordinate
//! that t lacks does not count; one that r lacks is counted as still missing, and is in no mean.

use super::error_breakdown::{BreakdownSums, ErrorBreakdown};
use super::error_stats::{ErrorStats, ErrorSums, point};
use super::motion_quality::{AccelerationSums, Accelerations, BoneLengthSums, BoneLengths};
use serde::Serialize;
use std::sync::Arc;

/// One frame to be scored: 3 J numbers each in centimetres, NaN is missing, points in the same order.
#[derive(Debug, Clone, Copy)]
pub struct ScoredFrame<'a> {
    /// The truth.
    pub truth: &'a [f64],
    /// What is scored.
    pub result: &'a [f64],
    /// What the result was made from.
    pub damaged: Option<&'a [f64]>,
    /// Whether this frame does not follow the one before it: see [`RunDetector`].
    pub starts_run: bool,
    /// Frames a second of its take, where known.
    pub rate: Option<f64>,
}

/// Everything a score tells. Lengths are in `units`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScoreReport {
    /// The name of the unit of length.
    pub units: String,
    /// How many frames were read.
    pub frames: u64,
    /// How many points there are.
    pub points: usize,
    /// Frames a second, where known and the same of all takes that have a rate.
    pub rate: Option<f64>,
    /// Each rate that takes have, in the order in which they were met.
    pub rates: Vec<f64>,
    /// Over all coordinates.
    pub all: ErrorStats,
    /// Point by point.
    pub by_point: Vec<PointErrors>,
    /// Where a damaged table was given: what was missing, observed and changed.
    pub damaged: Option<ErrorBreakdown>,
    /// Where the points' names tell of bones.
    pub bones: Option<BoneLengths>,
    /// Where there is a rate: each take's own.
    pub accelerations: Option<Accelerations>,
}

/// The errors of one point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PointErrors {
    /// Its name.
    pub point: String,
    /// Its errors.
    #[serde(flatten)]
    pub errors: ErrorStats,
}

/// Finds the frames that do not follow the one before them: a new take, a time that does not go forward, a step of more
/// than 1.5 frames. The rule is that of [`crate::pose::Poses::runs`], for frames that come one at a time.
#[derive(Debug, Clone, Default)]
pub struct RunDetector {
    last: Option<(Option<f64>, Option<Arc<str>>)>,
}

impl RunDetector {
    /// Whether the next frame, of a take of so many frames a second, where known, starts a run. The first does.
    pub fn starts(
        &mut self,
        time: Option<f64>,
        take: &Option<Arc<str>>,
        rate: Option<f64>,
    ) -> bool {
        let last = self.last.replace((time, take.clone()));
        let Some((last_time, last_take)) = last else {
            return true;
        };
        let on = match (last_time, time) {
            (Some(a), Some(b)) => b > a && rate.is_none_or(|rate| b - a <= 1.5 / rate),
            _ => true,
        };
        !on || last_take != *take
    }
}

/// Adds up a score.
#[derive(Debug, Clone)]
pub struct ScoreSums {
    points: Vec<String>,
    rates: Vec<f64>,
    frames: u64,
    all: ErrorSums,
    by_point: Vec<ErrorSums>,
    damage: Option<BreakdownSums>,
    bones: BoneLengthSums,
    accelerations: AccelerationSums,
}

impl ScoreSums {
    /// A score of frames of these points; `damaged` tells whether every frame will come with what it was made from.
    pub fn new(points: &[String], damaged: bool) -> ScoreSums {
        ScoreSums {
            points: points.to_vec(),
            rates: Vec::new(),
            frames: 0,
            all: ErrorSums::default(),
            by_point: vec![ErrorSums::default(); points.len()],
            damage: damaged.then(|| BreakdownSums::new(points.len())),
            bones: BoneLengthSums::new(points),
            accelerations: AccelerationSums::default(),
        }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &ScoredFrame<'_>) {
        self.frames += 1;
        for (i, sums) in self.by_point.iter_mut().enumerate() {
            let [truth, result] = [frame.truth, frame.result].map(|xyz| point(xyz, i));
            let mut one = ErrorSums::default();
            one.add(truth, result, [true; 3]);
            sums.merge(&one);
            self.all.merge(&one);
        }
        self.bones.add(frame.truth, frame.result);
        if let Some(rate) = frame.rate {
            if !self.rates.contains(&rate) {
                self.rates.push(rate);
            }
            self.accelerations.add(frame, rate);
        }
        if let (Some(sums), Some(damaged)) = (&mut self.damage, frame.damaged) {
            sums.add(frame, damaged);
        }
    }

    /// How many frames were added.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The report, its lengths in a unit of this name and of so many centimetres.
    pub fn finish(self, units: &str, centimetres: f64) -> ScoreReport {
        let unit = centimetres;
        let is_timed = !self.rates.is_empty();
        let named = self.points.iter().zip(&self.by_point);
        ScoreReport {
            units: units.to_string(),
            frames: self.frames,
            points: self.points.len(),
            rate: match self.rates[..] {
                [rate] => Some(rate),
                _ => None,
            },
            all: self.all.errors(unit),
            by_point: named
                .map(|(point, sums)| PointErrors {
                    point: point.clone(),
                    errors: sums.errors(unit),
                })
                .collect(),
            bones: self.bones.finish(&self.points, unit),
            accelerations: is_timed.then(|| self.accelerations.finish(unit)),
            damaged: self.damage.map(|sums| sums.finish(unit, is_timed)),
            rates: self.rates,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    fn frame<'a>(truth: &'a [f64], result: &'a [f64]) -> ScoredFrame<'a> {
        ScoredFrame {
            truth,
            result,
            damaged: None,
            starts_run: false,
            rate: None,
        }
    }

    #[test]
    fn all_and_by_point() {
        let mut s = ScoreSums::new(&names(2), false);
        s.add(&frame(&[0.0; 6], &[1.0, 1.0, 1.0, 2.0, 2.0, f64::NAN]));
        s.add(&frame(
            &[0.0, 0.0, 0.0, f64::NAN, f64::NAN, f64::NAN],
            &[1.0; 6],
        ));
        let r = s.finish("cm", 1.0);
        assert_eq!((r.frames, r.points), (2, 2));
        assert_eq!((r.all.coordinates, r.all.still_missing), (8, 1));
        assert_eq!(r.all.mse, Some((6.0 + 8.0) / 8.0));
        assert_eq!(r.by_point[0].errors.rms, Some(1.0));
        assert_eq!(r.by_point[1].errors.mse, Some(4.0));
        assert!(r.accelerations.is_none() && r.bones.is_none() && r.damaged.is_none());
    }

    #[test]
    fn nothing_compared_is_no_number() {
        let r = ScoreSums::new(&names(1), true).finish("asf", 5.0);
        assert_eq!((r.all.mse, r.all.max), (None, None));
        let json = serde_json::to_string(&r).unwrap();
        assert!(json.contains("\"mse\":null") && json.contains("\"units\":\"asf\""));
    }

    #[test]
    fn units_scale_every_length() {
        let score = |unit| {
            let mut s = ScoreSums::new(&names(1), false);
            for i in 0..5 {
                let x = f64::from(i * i);
                s.add(&ScoredFrame {
                    rate: Some(10.0),
                    ..frame(&[x; 3], &[2.0 * x; 3])
                });
            }
            s.finish("u", unit)
        };
        let (one, five) = (score(1.0), score(5.0));
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
    fn runs_are_those_of_poses() {
        use crate::pose::Poses;
        let time = vec![0.0, 0.1, 0.2, 0.4, 0.5, 0.1, 0.2, 0.3];
        let take: Vec<Arc<str>> = "aaaaaaab"
            .chars()
            .map(|c| Arc::from(c.to_string()))
            .collect();
        let poses = Poses {
            xyz: ndarray::Array2::zeros((8, 3)),
            time: Some(time.clone()),
            take: Some(take.clone()),
            ..Poses::default()
        };
        let mut runs = RunDetector::default();
        let starts: Vec<usize> = (0..8)
            .filter(|&i| runs.starts(Some(time[i]), &Some(take[i].clone()), poses.rate()))
            .collect();
        let want: Vec<usize> = poses.runs().iter().map(|r| r.start).collect();
        assert_eq!(starts, want);
        let mut bare = RunDetector::default();
        let rate = Some(1.0);
        assert!(bare.starts(None, &None, rate) && !bare.starts(None, &None, rate));
    }
}
