//! How far a result is from the truth, added up frame by frame in memory that does not grow.
//!
//! Let t be a coordinate of the truth, r of the result, d of what the result was made from (the damaged table). Over a
//! set of coordinates, MSE = mean of (r - t)^2, as in the paper's tables (there in raw ASF units, squared). A coordinate
//! that t lacks does not count; one that r lacks is counted as still missing, and is in no mean.

use super::motion::{AccelerationSums, Accelerations, BoneSums, Bones};
use super::tally::{Errors, Tally};
use serde::Serialize;
use std::sync::Arc;

/// Coordinates that differ by no more than this count as unchanged, in centimetres: a micrometre, which single precision
/// and a turn to the model's space and back stay below, and no capture resolves.
pub const UNCHANGED: f64 = 1e-4;

/// The upper ends of the bins of gap lengths in seconds; the last bin has none.
pub const GAP_SECONDS: [f64; 5] = [0.1, 0.3, 0.6, 1.0, 2.0];
/// The same in frames, where there is no rate.
pub const GAP_FRAMES: [u64; 5] = [10, 30, 60, 100, 200];

/// One frame to be scored: 3 J numbers each in centimetres, NaN is missing, points in the same order.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// The truth.
    pub truth: &'a [f64],
    /// What is scored.
    pub result: &'a [f64],
    /// What the result was made from.
    pub damaged: Option<&'a [f64]>,
    /// Whether this frame does not follow the one before it: see [`Runs`].
    pub starts_run: bool,
}

/// Everything a score tells. Lengths are in `units`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The name of the unit of length.
    pub units: String,
    /// How many frames were read.
    pub frames: u64,
    /// How many points there are.
    pub points: usize,
    /// Frames a second, where known.
    pub rate: Option<f64>,
    /// Over all coordinates.
    pub all: Errors,
    /// Point by point.
    pub by_point: Vec<PointErrors>,
    /// Where a damaged table was given: what was missing, observed and changed.
    pub damaged: Option<Damage>,
    /// Where the points' names tell of bones.
    pub bones: Option<Bones>,
    /// Where there is a rate.
    pub accelerations: Option<Accelerations>,
}

/// The errors of one point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PointErrors {
    /// Its name.
    pub point: String,
    /// Its errors.
    #[serde(flatten)]
    pub errors: Errors,
}

/// The errors by what the damaged table held.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Damage {
    /// The damaged table itself against the truth: how bad things were. What it lacks is its `still_missing`.
    pub before: Errors,
    /// The result over what was missing.
    pub missing: Errors,
    /// The same by the length of the gap: the frames in a row in which a point lacked any coordinate.
    pub by_gap: Vec<GapErrors>,
    /// The result over what was observed.
    pub observed: Errors,
    /// The result over what was observed and off the truth (by more than [`UNCHANGED`]).
    pub corrupted: Errors,
    /// The result over what was observed and right.
    pub intact: Errors,
    /// The result over what was observed and is another value now (by more than [`UNCHANGED`]).
    pub changed: Errors,
}

/// The errors over gaps of some length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapErrors {
    /// Gaps longer than this many seconds; frames where there is no rate.
    pub longer_than: f64,
    /// Gaps of up to this many seconds (frames); none for the last bin.
    pub up_to: Option<f64>,
    /// How many gaps of a point there are.
    pub gaps: u64,
    /// Their errors.
    #[serde(flatten)]
    pub errors: Errors,
}

/// Finds the frames that do not follow the one before them: a new take, a time that does not go forward, a step of more
/// than 1.5 frames. The rule is that of [`crate::pose::Poses::runs`], for frames that come one at a time.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    step: Option<f64>,
    last: Option<(Option<f64>, Option<Arc<str>>)>,
}

impl Runs {
    /// For tables of so many frames a second, where known.
    pub fn new(rate: Option<f64>) -> Runs {
        Runs {
            step: rate.map(|r| 1.0 / r),
            last: None,
        }
    }

    /// Whether the next frame starts a run. The first does.
    pub fn starts(&mut self, time: Option<f64>, take: &Option<Arc<str>>) -> bool {
        let last = self.last.replace((time, take.clone()));
        let Some((last_time, last_take)) = last else {
            return true;
        };
        let on = match (last_time, time) {
            (Some(a), Some(b)) => b > a && self.step.is_none_or(|step| b - a <= 1.5 * step),
            _ => true,
        };
        !on || last_take != *take
    }
}

/// Adds up a score.
#[derive(Debug, Clone)]
pub struct Scores {
    points: Vec<String>,
    rate: Option<f64>,
    frames: u64,
    all: Tally,
    by_point: Vec<Tally>,
    damage: Option<DamageSums>,
    bones: BoneSums,
    accelerations: AccelerationSums,
}

impl Scores {
    /// A score of frames of these points; `damaged` tells whether every frame will come with what it was made from.
    pub fn new(points: &[String], rate: Option<f64>, damaged: bool) -> Scores {
        Scores {
            points: points.to_vec(),
            rate,
            frames: 0,
            all: Tally::default(),
            by_point: vec![Tally::default(); points.len()],
            damage: damaged.then(|| DamageSums::new(points.len(), rate)),
            bones: BoneSums::new(points),
            accelerations: AccelerationSums::default(),
        }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &Frame<'_>) {
        self.frames += 1;
        for (i, tally) in self.by_point.iter_mut().enumerate() {
            let [truth, result] = [frame.truth, frame.result].map(|xyz| point(xyz, i));
            let mut one = Tally::default();
            one.add(truth, result, [true; 3]);
            tally.merge(&one);
            self.all.merge(&one);
        }
        self.bones.add(frame.truth, frame.result);
        if self.rate.is_some() {
            self.accelerations
                .add(frame.truth, frame.result, frame.starts_run);
        }
        if let (Some(sums), Some(damaged)) = (&mut self.damage, frame.damaged) {
            sums.add(frame, damaged);
        }
    }

    /// The report, its lengths in a unit of this name and of so many centimetres.
    pub fn finish(self, units: &str, centimetres: f64) -> Report {
        let unit = centimetres;
        let named = self.points.iter().zip(&self.by_point);
        Report {
            units: units.to_string(),
            frames: self.frames,
            points: self.points.len(),
            rate: self.rate,
            all: self.all.errors(unit),
            by_point: named
                .map(|(point, tally)| PointErrors {
                    point: point.clone(),
                    errors: tally.errors(unit),
                })
                .collect(),
            bones: self.bones.finish(&self.points, unit),
            accelerations: self.rate.map(|rate| self.accelerations.finish(rate, unit)),
            damaged: self.damage.map(|sums| sums.finish(unit)),
        }
    }
}

/// Point `i` of a frame.
fn point(xyz: &[f64], i: usize) -> [f64; 3] {
    [xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]]
}

/// Adds up [`Damage`].
#[derive(Debug, Clone)]
struct DamageSums {
    before: Tally,
    missing: Tally,
    observed: Tally,
    corrupted: Tally,
    intact: Tally,
    changed: Tally,
    /// The gap each point is in: its frames so far and its errors.
    open: Vec<(u64, Tally)>,
    /// Each bin's gaps and errors.
    bins: [(u64, Tally); GAP_SECONDS.len() + 1],
    rate: Option<f64>,
}

impl DamageSums {
    fn new(points: usize, rate: Option<f64>) -> DamageSums {
        DamageSums {
            before: Tally::default(),
            missing: Tally::default(),
            observed: Tally::default(),
            corrupted: Tally::default(),
            intact: Tally::default(),
            changed: Tally::default(),
            open: vec![Default::default(); points],
            bins: Default::default(),
            rate,
        }
    }

    fn add(&mut self, frame: &Frame<'_>, damaged: &[f64]) {
        for i in 0..self.open.len() {
            let [t, r, d] = [frame.truth, frame.result, damaged].map(|xyz| point(xyz, i));
            let missing = d.map(f64::is_nan);
            let observed = missing.map(|m| !m);
            // A difference from NaN is above nothing: what is missing is in none of these.
            let corrupted = [0, 1, 2].map(|a| (d[a] - t[a]).abs() > UNCHANGED);
            let intact = [0, 1, 2].map(|a| (d[a] - t[a]).abs() <= UNCHANGED);
            let changed = [0, 1, 2].map(|a| (r[a] - d[a]).abs() > UNCHANGED);
            self.before.add(t, d, [true; 3]);
            self.observed.add(t, r, observed);
            self.corrupted.add(t, r, corrupted);
            self.intact.add(t, r, intact);
            self.changed.add(t, r, changed);
            if frame.starts_run || observed == [true; 3] {
                self.close(i);
            }
            if observed != [true; 3] {
                self.missing.add(t, r, missing);
                self.open[i].0 += 1;
                self.open[i].1.add(t, r, missing);
            }
        }
    }

    /// Ends the gap a point is in, if any. One where the truth has nothing either is none.
    fn close(&mut self, point: usize) {
        let (frames, tally) = std::mem::take(&mut self.open[point]);
        if tally.is_empty() {
            return;
        }
        // Whole frames: 9 frames at 29.97 a second are 0.3 s.
        let within = |bin: usize| match self.rate {
            Some(rate) => frames as f64 <= (GAP_SECONDS[bin] * rate).round(),
            None => frames <= GAP_FRAMES[bin],
        };
        let last = GAP_SECONDS.len();
        let bin = (0..last).find(|&bin| within(bin)).unwrap_or(last);
        self.bins[bin].0 += 1;
        self.bins[bin].1.merge(&tally);
    }

    fn finish(mut self, unit: f64) -> Damage {
        for point in 0..self.open.len() {
            self.close(point);
        }
        let limits = match self.rate {
            Some(_) => GAP_SECONDS,
            None => GAP_FRAMES.map(|f| f as f64),
        };
        let bins = self.bins.iter().enumerate();
        let by_gap = bins.map(|(i, (gaps, tally))| GapErrors {
            longer_than: if i == 0 { 0.0 } else { limits[i - 1] },
            up_to: limits.get(i).copied(),
            gaps: *gaps,
            errors: tally.errors(unit),
        });
        Damage {
            by_gap: by_gap.collect(),
            before: self.before.errors(unit),
            missing: self.missing.errors(unit),
            observed: self.observed.errors(unit),
            corrupted: self.corrupted.errors(unit),
            intact: self.intact.errors(unit),
            changed: self.changed.errors(unit),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: f64 = f64::NAN;

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    fn frame<'a>(truth: &'a [f64], result: &'a [f64]) -> Frame<'a> {
        Frame {
            truth,
            result,
            damaged: None,
            starts_run: false,
        }
    }

    #[test]
    fn all_and_by_point() {
        let mut s = Scores::new(&names(2), None, false);
        s.add(&frame(&[0.0; 6], &[1.0, 1.0, 1.0, 2.0, 2.0, NAN]));
        s.add(&frame(&[0.0, 0.0, 0.0, NAN, NAN, NAN], &[1.0; 6]));
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
        let r = Scores::new(&names(1), Some(1.0), true).finish("asf", 5.0);
        assert_eq!((r.all.mse, r.all.max), (None, None));
        let json = serde_json::to_string(&r).unwrap();
        assert!(json.contains("\"mse\":null") && json.contains("\"units\":\"asf\""));
    }

    /// Scores one point whose damaged table lacks the frames marked `.`; the result is off by one everywhere.
    fn gaps(seen: &str, rate: Option<f64>, starts: &[usize]) -> Damage {
        let mut s = Scores::new(&names(1), rate, true);
        for (i, c) in seen.chars().enumerate() {
            s.add(&Frame {
                truth: &[0.0; 3],
                result: &[1.0; 3],
                damaged: Some(&[if c == '.' { NAN } else { 0.0 }; 3]),
                starts_run: i == 0 || starts.contains(&i),
            });
        }
        s.finish("cm", 1.0).damaged.unwrap()
    }

    #[test]
    fn gaps_are_sorted_by_length() {
        let counts = |d: &Damage| d.by_gap.iter().map(|b| b.gaps).collect::<Vec<_>>();
        // At ten frames a second a frame is 0.1 s.
        let d = gaps("x.x..x...x....x......x...........", Some(10.0), &[]);
        assert_eq!(counts(&d), [1, 2, 2, 0, 1, 0]);
        assert_eq!(d.by_gap[1].errors.coordinates, 15);
        assert_eq!(d.missing.coordinates, 3 * 27);
        assert_eq!(d.missing.rms, Some(1.0));
        // A gap ends where a run does.
        assert_eq!(
            counts(&gaps("x....x", Some(10.0), &[3])),
            [0, 2, 0, 0, 0, 0]
        );
        // Without a rate: frames.
        let long = format!("x{}x{}", ".".repeat(10), ".".repeat(201));
        assert_eq!(counts(&gaps(&long, None, &[])), [1, 0, 0, 0, 0, 1]);
        assert_eq!(counts(&gaps("xxx", None, &[])), [0; 6]);
    }

    #[test]
    fn gaps_of_whole_frames_fall_in_the_bin_they_were_made_for() {
        let rate = 30.0 / 1.001;
        let d = gaps(&format!("x{}x", ".".repeat(9)), Some(rate), &[]);
        assert_eq!(d.by_gap[1].gaps, 1);
    }

    #[test]
    fn sets_by_what_the_damaged_table_held() {
        let mut s = Scores::new(&names(4), None, true);
        s.add(&Frame {
            truth: &[0.0; 12],
            // Left as it was, mended, spoilt, filled but for one coordinate.
            result: &[0., 0., 0., 1., 1., 1., 2., 2., 2., 3., 3., NAN],
            damaged: Some(&[0., 0., 0., 9., 9., 9., 0., 0., 0., NAN, NAN, NAN]),
            starts_run: true,
        });
        let d = s.finish("cm", 1.0).damaged.unwrap();
        let of = |e: &Errors| (e.coordinates, e.still_missing, e.mse);
        assert_eq!(of(&d.before), (9, 3, Some(27.0)));
        assert_eq!(of(&d.missing), (2, 1, Some(9.0)));
        assert_eq!(of(&d.observed), (9, 0, Some(5.0 / 3.0)));
        assert_eq!(of(&d.corrupted), (3, 0, Some(1.0)));
        assert_eq!(of(&d.intact), (6, 0, Some(2.0)));
        assert_eq!(of(&d.changed), (6, 0, Some(2.5)));
    }

    #[test]
    fn units_scale_every_length() {
        let score = |unit| {
            let mut s = Scores::new(&names(1), Some(10.0), false);
            for i in 0..5 {
                let x = f64::from(i * i);
                s.add(&frame(&[x; 3], &[2.0 * x; 3]));
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
        let mut runs = Runs::new(poses.rate());
        let starts: Vec<usize> = (0..8)
            .filter(|&i| runs.starts(Some(time[i]), &Some(take[i].clone())))
            .collect();
        let want: Vec<usize> = poses.runs().iter().map(|r| r.start).collect();
        assert_eq!(starts, want);
        let mut bare = Runs::new(Some(1.0));
        assert!(bare.starts(None, &None) && !bare.starts(None, &None));
    }
}
