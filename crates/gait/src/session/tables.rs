//! The tables of a session: a trial's curves frame by frame, all cycles in percent, and OpenSim's
//! files of angles and of loads.

use crate::angles::CENTERS;
use crate::curves::is_angle;
use crate::cycles::{POINTS, mean_and_sd};
use crate::io::csv::push_cell;
use crate::io::opensim;
use crate::io::text::push_f64;
use crate::session::{SERIES, Series, Session, SessionTrial, axes};
use crate::side::Side;
use glam::DVec3;
use std::io::Write;

/// Values are written to so many parts of a unit.
const PARTS: f64 = 1e6;

/// A column: its name and a value a frame.
struct Column {
    name: String,
    values: Vec<f64>,
}

impl SessionTrial {
    /// The curves as a table of CSV, a frame a row: `take,time`, then the curves of both sides;
    /// with `deviations` those of centers and angles have their `.sd` behind them. An unknown value
    /// is an empty cell.
    pub fn to_csv(&self, deviations: bool) -> Vec<u8> {
        let columns = self.columns(deviations, &|_| true);
        let mut out = b"take,time".to_vec();
        for column in &columns {
            out.push(b',');
            out.extend(column.name.as_bytes());
        }
        for t in 0..self.trial.markers.frames() {
            out.push(b'\n');
            push_cell(&mut out, self.name.as_bytes());
            let values = columns.iter().map(|column| column.values[t]);
            push_cells(&mut out, std::iter::once(self.trial.time(t)).chain(values));
        }
        out.push(b'\n');
        out
    }

    /// The angles as OpenSim's motion file (.mot).
    pub fn to_mot(&self) -> Vec<u8> {
        self.storage(true, &is_angle)
    }

    /// Forces, moments and powers as OpenSim's storage file (.sto).
    pub fn to_sto(&self) -> Vec<u8> {
        let is_load = |name: &str| {
            ["Force", "Moment", "Power"]
                .iter()
                .any(|w| name.ends_with(w))
        };
        self.storage(false, &is_load)
    }

    fn storage(&self, in_degrees: bool, is_own: &dyn Fn(&str) -> bool) -> Vec<u8> {
        let columns = self.columns(false, is_own);
        let frames = self.trial.markers.frames();
        let titles: Vec<&str> = columns.iter().map(|column| &*column.name).collect();
        let rows = (0..frames).map(|t| {
            let values = columns.iter().map(|column| column.values[t]);
            let row = std::iter::once(self.trial.time(t)).chain(values);
            row.map(rounded).collect()
        });
        opensim::storage(&self.name, in_degrees, &titles, rows)
    }

    /// The columns of the curves of which `is_own` says so.
    fn columns(&self, deviations: bool, is_own: &dyn Fn(&str) -> bool) -> Vec<Column> {
        let sides = Side::BOTH.map(|side| self.series(side));
        let mut all = Vec::new();
        for name in SERIES.into_iter().filter(|name| is_own(name)) {
            for (side, series) in Side::BOTH.into_iter().zip(&sides) {
                let Some(series) = series.iter().find(|s| s.name == name) else {
                    continue;
                };
                for (axis, i) in axes(name) {
                    let mut add = |end: &str, values: &[DVec3]| {
                        all.push(Column {
                            name: format!("{}{name}.{axis}{end}", side.letter()),
                            values: values.iter().map(|v| v[*i]).collect(),
                        });
                    };
                    add("", &series.values);
                    if deviations && (is_angle(name) || CENTERS.contains(&name)) {
                        match &series.sd {
                            Some(sd) => add(".sd", sd),
                            // No marker was filled.
                            None => add(
                                ".sd",
                                &series.values.iter().map(|v| *v * 0.0).collect::<Vec<_>>(),
                            ),
                        }
                    }
                }
            }
        }
        all
    }
}

impl Session {
    /// All cycles as a table of CSV, 101 rows each: `trial,side,cycle,start,end,percent`, then the
    /// curves without their side; behind a trial's cycles of a side their `mean` and `sd`, and at
    /// the end those over all trials.
    pub fn cycles_csv(&self) -> Vec<u8> {
        let is_there = |name: &&str| self.trials.iter().any(|t| t.has_curve(name));
        let names: Vec<&'static str> = SERIES.into_iter().filter(is_there).collect();
        let mut out = b"trial,side,cycle,start,end,percent".to_vec();
        for name in &names {
            for (axis, _) in axes(name) {
                let _ = write!(out, ",{name}.{axis}");
            }
        }
        out.push(b'\n');
        let mut all = [Vec::new(), Vec::new()];
        for trial in &self.trials {
            for side in Side::BOTH {
                let series = trial.series(side);
                let mut own = Vec::new();
                for cycle in trial.cycles(side) {
                    let curves = cycle_curves(trial, &series, &names, cycle);
                    let head = Head {
                        trial: &trial.name,
                        side,
                        cycle: cycle.cycle.to_string(),
                        span: [cycle.start_s, cycle.end_s],
                    };
                    head.push_rows(&mut out, &names, &curves);
                    own.push(curves);
                }
                push_statistics(&mut out, &trial.name, side, &names, &own);
                all[side as usize].extend(own);
            }
        }
        for side in Side::BOTH {
            push_statistics(&mut out, "", side, &names, &all[side as usize]);
        }
        out
    }
}

impl SessionTrial {
    fn has_curve(&self, name: &str) -> bool {
        let of = |side: Side| format!("{}{name}", side.letter());
        Side::BOTH
            .into_iter()
            .any(|side| self.gait.curves.contains_key(&of(side)))
    }
}

/// A curve a name, 101 points each.
type CycleCurves = Vec<Vec<DVec3>>;

fn cycle_curves(
    trial: &SessionTrial,
    series: &[Series],
    names: &[&str],
    cycle: &crate::Cycle,
) -> CycleCurves {
    let of = |name: &&str| match series.iter().find(|s| s.name == *name) {
        Some(series) => trial.resampled(series, cycle),
        None => vec![DVec3::NAN; POINTS],
    };
    names.iter().map(of).collect()
}

/// The first cells of a cycle's rows.
struct Head<'a> {
    trial: &'a str,
    side: Side,
    cycle: String,
    /// NaN of a mean.
    span: [f64; 2],
}

impl Head<'_> {
    fn push_rows(&self, out: &mut Vec<u8>, names: &[&str], curves: &CycleCurves) {
        let side = ["left", "right"][self.side as usize];
        for percent in 0..POINTS {
            push_cell(out, self.trial.as_bytes());
            let _ = write!(out, ",{side},{}", self.cycle);
            let values = names.iter().zip(curves).flat_map(|(name, curve)| {
                axes(name)
                    .iter()
                    .map(move |(_, axis)| curve[percent][*axis])
            });
            push_cells(
                out,
                self.span.into_iter().chain([percent as f64]).chain(values),
            );
            out.push(b'\n');
        }
    }
}

/// Adds the rows of mean and standard deviation of some cycles.
fn push_statistics(
    out: &mut Vec<u8>,
    trial: &str,
    side: Side,
    names: &[&str],
    cycles: &[CycleCurves],
) {
    if cycles.is_empty() {
        return;
    }
    let of = |k: usize| {
        let curves: Vec<Vec<DVec3>> = cycles.iter().map(|c| c[k].clone()).collect();
        mean_and_sd(&curves, is_angle(names[k]))
    };
    let both: Vec<[Vec<DVec3>; 2]> = (0..names.len()).map(of).collect();
    for (i, cycle) in ["mean", "sd"].into_iter().enumerate() {
        let head = Head {
            trial,
            side,
            cycle: cycle.to_string(),
            span: [f64::NAN; 2],
        };
        let curves = both.iter().map(|curve| curve[i].clone()).collect();
        head.push_rows(out, names, &curves);
    }
}

/// Adds cells, each behind a comma; an unknown value is empty.
fn push_cells(out: &mut Vec<u8>, values: impl Iterator<Item = f64>) {
    for value in values {
        out.push(b',');
        push_f64(out, rounded(value));
    }
}

/// A value as it is written; a zero has no sign.
fn rounded(value: f64) -> f64 {
    (PARTS * value).round() / PARTS + 0.0
}
