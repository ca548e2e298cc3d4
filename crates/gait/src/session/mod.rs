//! A session: the trials of one person, and what is told of them together.

mod c3d;
mod page;
mod report;
mod tables;

use crate::angles::CENTERS;
use crate::curves::{Curves, is_angle};
use crate::cycles::{Cycle, mean_and_sd, resampled};
use crate::gait_trial::GaitTrial;
use crate::norm::{Norm, ProfileScores};
use crate::side::Side;
use crate::trial::Trial;
use crate::values::symmetry;
use crate::{Error, Result};
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;

/// The trials of one person on one day.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// In the order in which they are told of.
    pub trials: Vec<SessionTrial>,
    /// The file of the static trial.
    pub static_file: Option<String>,
    /// The norm to compare with, and its file.
    pub norm: Option<(String, Norm)>,
    /// Trials that could not be read or computed: the file, and why.
    pub failed: Vec<(String, String)>,
}

/// A trial of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionTrial {
    /// Its name: that of its file without `.c3d`.
    pub name: String,
    /// Its file.
    pub file: String,
    /// What its file gives, gaps of markers filled.
    pub trial: Trial,
    /// What is computed of it.
    pub gait: GaitTrial,
    /// The deviations of its curves where a marker was filled or doubted:
    /// [`GaitTrial::deviations`].
    pub deviations: Option<Curves>,
}

/// A curve of a side, as the tables have it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Series {
    /// The name without the side, `KneeAngles`.
    pub name: &'static str,
    /// A value a frame: centers in centimeters with y up, other curves as [`Curves`] have them.
    pub values: Vec<DVec3>,
    /// The deviations of these.
    pub sd: Option<Vec<DVec3>>,
}

/// The curves by their names without the side, in the order of tables.
pub(crate) const SERIES: [&str; 25] = [
    "HJC",
    "KJC",
    "AJC",
    "PelvisAngles",
    "HipAngles",
    "KneeAngles",
    "AnkleAngles",
    "FootProgressAngles",
    "ThoraxAngles",
    "HeadAngles",
    "SpineAngles",
    "NeckAngles",
    "ShoulderAngles",
    "ElbowAngles",
    "WristAngles",
    "GroundReactionForce",
    "AnkleForce",
    "KneeForce",
    "HipForce",
    "AnkleMoment",
    "KneeMoment",
    "HipMoment",
    "AnklePower",
    "KneePower",
    "HipPower",
];

/// The columns of a curve, behind its name, and which of its numbers each is.
pub(crate) fn axes(name: &str) -> &'static [(&'static str, usize)] {
    match name {
        name if CENTERS.contains(&name) => &[("x", 0), ("y", 1), ("z", 2)],
        name if is_angle(name) => &[("rx", 0), ("ry", 1), ("rz", 2)],
        name if name.ends_with("Moment") => &[("mx", 0), ("my", 1), ("mz", 2)],
        name if name.ends_with("Power") => &[("p", 2)],
        _ => &[("fx", 0), ("fy", 1), ("fz", 2)],
    }
}

impl SessionTrial {
    /// A trial, computed. `sd` are the deviations of markers that were filled or doubted.
    ///
    /// # Errors
    /// [`Error::Unfit`]: `sd` is of another trial.
    pub fn new(
        name: String,
        file: String,
        trial: Trial,
        gait: GaitTrial,
        sd: &Array2<f64>,
    ) -> Result<SessionTrial> {
        let is_sure = sd.iter().all(|sd| *sd == 0.0);
        let deviations = (!is_sure)
            .then(|| gait.deviations(&trial, sd))
            .transpose()?;
        Ok(SessionTrial {
            name,
            file,
            trial,
            gait,
            deviations,
        })
    }

    /// The curves of a side in the order of tables.
    pub(crate) fn series(&self, side: Side) -> Vec<Series> {
        let of = |name: &'static str| {
            let own = format!("{}{name}", side.letter());
            let is_center = CENTERS.contains(&name);
            let table = |v: &DVec3| DVec3::new(v.x, v.z, -v.y) / 10.0;
            let shown = |curve: &Vec<DVec3>| {
                if is_center {
                    curve.iter().map(table).collect()
                } else {
                    curve.clone()
                }
            };
            let deviations = self.deviations.as_ref().and_then(|all| all.get(&own));
            let sd = deviations.map(|sd| shown(sd).into_iter().map(DVec3::abs).collect());
            let values = shown(self.gait.curves.get(&own)?);
            Some(Series { name, values, sd })
        };
        SERIES.into_iter().filter_map(of).collect()
    }

    /// The cycles of a side.
    pub fn cycles(&self, side: Side) -> impl Iterator<Item = &Cycle> {
        let all = self.gait.cycles.iter().map(|(cycle, _)| cycle);
        all.filter(move |cycle| cycle.side == side)
    }

    /// A curve of a side in one of its cycles, 101 points.
    pub(crate) fn resampled(&self, series: &Series, cycle: &Cycle) -> Vec<DVec3> {
        let [from, to] = [cycle.start_s, cycle.end_s].map(|t| self.trial.place(t));
        resampled(&series.values, from, to, is_angle(series.name))
    }
}

/// Mean, standard deviation (n - 1; NaN of one) and number of a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The standard deviation.
    pub sd: f64,
    /// How many.
    pub count: usize,
}

impl Spread {
    /// That of some values; `None` of none.
    pub(crate) fn of(values: &[f64]) -> Option<Spread> {
        let count = values.len();
        let mean = values.iter().sum::<f64>() / count as f64;
        let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        let sd = (sum / (count as f64 - 1.0)).sqrt();
        let sd = if count > 1 { sd } else { f64::NAN };
        (count > 0).then_some(Spread { mean, sd, count })
    }
}

impl Session {
    /// A session of trials with names of their own.
    ///
    /// # Errors
    /// [`Error::Usage`]: two trials have one name, or one has none.
    pub fn new(
        trials: Vec<SessionTrial>,
        static_file: Option<String>,
        norm: Option<(String, Norm)>,
    ) -> Result<Session> {
        let mut seen: BTreeMap<String, &str> = BTreeMap::new();
        for trial in &trials {
            if trial.name.is_empty() {
                let what = format!(
                    "{}: a trial is named by its file, and this is nameless",
                    trial.file
                );
                return Err(Error::usage(what));
            }
            // Some file systems know no capitals.
            if let Some(other) = seen.insert(trial.name.to_lowercase(), &trial.file) {
                let (name, file) = (&trial.name, &trial.file);
                let what = format!("{other} and {file} would both be written as {name}");
                return Err(Error::usage(format!("{what}: give them other names")));
            }
        }
        Ok(Session {
            trials,
            static_file,
            norm,
            failed: Vec::new(),
        })
    }

    /// Whether there is something to know before the values are used.
    pub fn has_findings(&self) -> bool {
        self.trials.iter().any(|t| !t.gait.findings.is_empty())
    }

    /// The number of cycles of a side.
    pub fn cycles(&self, side: Side) -> usize {
        self.trials.iter().map(|t| t.cycles(side).count()).sum()
    }

    /// The values of all cycles of a side by name.
    pub fn values(&self, side: Side) -> BTreeMap<&'static str, Spread> {
        let cycles = self.trials.iter().flat_map(|t| &t.gait.cycles);
        let mut all: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
        for (_, values) in cycles.filter(|(cycle, _)| cycle.side == side) {
            for (name, value) in values {
                all.entry(name).or_default().push(*value);
            }
        }
        let spread = |(name, values): (_, Vec<f64>)| Some((name, Spread::of(&values)?));
        all.into_iter().filter_map(spread).collect()
    }

    /// How far the means of both sides are apart, percent of their mean size, by name.
    pub fn symmetry(&self) -> BTreeMap<&'static str, f64> {
        let [left, right] = Side::BOTH.map(|side| self.values(side));
        let pairs = left.iter().filter_map(|(name, l)| {
            let apart = symmetry(l.mean, right.get(name)?.mean);
            Some((*name, apart)).filter(|_| apart.is_finite())
        });
        pairs.collect()
    }

    /// A curve of a side in all cycles of all trials, mean and standard deviation.
    pub fn mean_curve(&self, side: Side, name: &str) -> Option<[Vec<DVec3>; 2]> {
        let of = |trial: &SessionTrial| {
            let series = trial.series(side).into_iter().find(|s| s.name == name);
            let own = series.map(|s| {
                trial
                    .cycles(side)
                    .map(move |c| trial.resampled(&s, c))
                    .collect()
            });
            own.unwrap_or_else(Vec::new)
        };
        let cycles: Vec<Vec<DVec3>> = self.trials.iter().flat_map(of).collect();
        (!cycles.is_empty()).then(|| mean_and_sd(&cycles, is_angle(name)))
    }

    /// The norm of the session's own cycles, both sides, without those of trials that turn; `None`
    /// without a whole one.
    pub fn own_norm(&self) -> Option<Norm> {
        Norm::of_cycles(&Side::BOTH.map(|side| self.nine_angles(side)).concat())
    }

    fn nine_angles(&self, side: Side) -> Vec<crate::NineAngles> {
        let of = |t: &SessionTrial| {
            let own = t
                .cycles(side)
                .map(|cycle| t.gait.nine_angles(&t.trial, cycle));
            own.collect::<Vec<_>>()
        };
        let straight = self.trials.iter().filter(|t| !t.gait.turns());
        straight.flat_map(of).collect()
    }

    /// The scores of both sides' mean cycles against the norm, and of all: [`Norm`]; trials that
    /// turn do not count. `None` without a norm, or where a side has no whole cycle.
    pub fn scores(&self) -> Option<([[f64; 9]; 2], ProfileScores)> {
        let (_, norm) = self.norm.as_ref()?;
        let [left, right] = Side::BOTH.map(|side| Norm::of_cycles(&self.nine_angles(side)));
        let scores = [left?, right?].map(|own| norm.variable_scores(&own.mean));
        Some((scores, ProfileScores::new(scores)))
    }
}
