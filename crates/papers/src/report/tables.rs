//! Results as text, CSV and JSON. Run times have a CSV file of their own, since no two runs have
//! the same.

use super::BenchmarkReport;
use crate::benchmark::result::BenchmarkResult;
use crate::benchmark::splits::Split;
use crate::benchmark::summary::{Interval, SummaryRow, interval};
use crate::draw::text_table::aligned;
use crate::draw::text_table::short;
use crate::numeric::parallel;
use crate::pose::ASF_UNIT_CM;
use crate::score::error_stats::{ONE_AND_TWO_SD, SD_LEVELS};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::fmt::Write;

/// The version of the JSON.
const FORMAT: u32 = 1;

impl BenchmarkReport<'_> {
    /// One object: settings, data, the summary over seeds, every cell.
    ///
    /// # Errors
    /// None that the types do not already exclude.
    pub fn json(&self) -> Result<String> {
        let (data, settings) = (self.dataset(), &self.benchmark.settings);
        let name = |take: usize| &data.takes[take].name;
        let takes = data.takes.iter().map(|t| {
            json!({
                "take": t.name, "subject": t.subject, "frames": t.rows.len(),
                "rate": t.rate, "digest": t.digest,
            })
        });
        let twins = self.benchmark.duplicates.iter().map(|t| {
            json!({
                "take": name(t.b), "of": name(t.a), "found_by": t.evidence, "share": t.share,
            })
        });
        let cells = parallel::map_chunks(self.results.len(), 1, |r| {
            self.json_cell(&self.results[r.start])
        });
        let json = json!({
            "format": FORMAT,
            "version": env!("CARGO_PKG_VERSION"),
            "units": "asf^2 a coordinate; 1 asf = 5.644 cm",
            "settings": {
                "models": settings.methods.iter().map(|m| &m.name).collect::<Vec<_>>(),
                "tasks": settings.tasks,
                "splits": settings.splits,
                "seeds": settings.seeds().collect::<Vec<_>>(),
                "frames": settings.frames,
                "base_asf": settings.base.iter().map(|b| b / ASF_UNIT_CM).collect::<Vec<_>>(),
                "observe": settings.observe,
            },
            "data": {
                "digest": data.digest(),
                "points": data.points,
                "frames": data.xyz.nrows(),
                "left_out_incomplete": data.incomplete,
                "takes": takes.collect::<Vec<_>>(),
                "twins": twins.collect::<Vec<_>>(),
            },
            // Deviations and the share of a Gaussian in them, beside each `within`.
            "gaussian_within": SD_LEVELS,
            "summary": self.summary,
            "cells": cells,
        });
        let text = serde_json::to_string_pretty(&json).map_err(|e| Error::usage(e.to_string()))?;
        Ok(text + "\n")
    }

    fn json_cell(&self, cell: &BenchmarkResult) -> Value {
        let (case, test) = (&cell.case, &cell.test);
        // Under `takes` and `subjects`: the error by take.
        let takes = test.units.iter().filter(|_| case.split != Split::Frames);
        let takes = takes.filter_map(|u| {
            let take = self.dataset().takes.get(u.unit)?;
            Some((&take.name, u.frames, u.mse))
        });
        let training = cell.training.as_ref();
        json!({
            "model": case.model, "split": case.split, "seed": case.seed, "task": case.task,
            "base_asf": case.base_asf,
            "learnt_from": cell.training_frames,
            "frames": test.frames,
            "mse": test.mse,
            "interval": interval(cell),
            "rms_cm": test.rms_cm(),
            "training": training.map(|t| json!({"frames": t.frames, "mse": t.mse})),
            "by_joint": test.by_joint,
            "calibrated_on": test.coordinates,
            "within": test.shares(),
            "tuning": cell.tuning,
            "by_take": takes.collect::<Vec<_>>(),
        })
    }

    /// A line per cell, and one for all seeds together (its `seed` is `all`).
    pub fn csv(&self) -> String {
        let mut out = String::from(
            "split,base_asf,task,model,seed,frames,units,mse,low,high,rms_cm,training_mse,\
             within_1sd,within_2sd,best\n",
        );
        for row in &self.summary {
            let head = format!(
                "{},{},{},{}",
                row.split.name(),
                row.base_asf,
                row.task.name(),
                quoted(&row.model)
            );
            let own = |c: &&BenchmarkResult| {
                let case = &c.case;
                (&case.model, case.split, case.task, case.base_asf)
                    == (&row.model, row.split, row.task, row.base_asf)
            };
            for cell in self.results.iter().filter(own) {
                let test = &cell.test;
                let errors = error_cells(
                    test.mse,
                    interval(cell),
                    cell.training.as_ref().map(|t| t.mse),
                    &test.shares(),
                );
                let (seed, units) = (cell.case.seed, test.units.len());
                let _ = writeln!(out, "{head},{seed},{},{units},{errors},", test.frames);
            }
            let errors = error_cells(row.mse, row.interval, row.training_mse, &row.within);
            let best = if row.best { "best" } else { "" };
            let _ = writeln!(
                out,
                "{head},all,{},{},{errors},{best}",
                row.frames, row.units
            );
        }
        out
    }

    /// A line per cell: seconds per pose, seconds of training.
    pub fn times(&self) -> String {
        let mut out =
            String::from("split,base_asf,task,model,seed,seconds_per_pose,seconds_training\n");
        for cell in &self.results {
            let (id, training) = (&cell.case, cell.seconds_training);
            let _ = writeln!(
                out,
                "{},{},{},{},{},{:.3e},{}",
                id.split.name(),
                id.base_asf,
                id.task.name(),
                quoted(&id.model),
                id.seed,
                cell.seconds_per_pose,
                training.map(|t| format!("{t:.3}")).unwrap_or_default(),
            );
        }
        out
    }

    /// Tables to read: a table a split and base noise, a row a model, a column a task; the best is
    /// marked `*`.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let table = |r: &SummaryRow| (r.split, r.base_asf.to_bits());
        for rows in self.summary.chunk_by(|a, b| table(a) == table(b)) {
            let first = &rows[0];
            if !out.is_empty() {
                out.push('\n');
            }
            let base = match first.base_asf {
                0.0 => String::new(),
                b => format!(", {b:.3} asf of noise on what is clean"),
            };
            let seeds = first.seeds.len();
            let plural = if seeds == 1 { "" } else { "s" };
            let _ = writeln!(
                out,
                "split {}{base}: MSE, asf^2 a coordinate, {seeds} seed{plural}, {} frames, 95% \
                 intervals",
                first.split.name(),
                first.frames,
            );
            out.push_str(&aligned(&grid(rows)));
        }
        out
    }
}

/// Cells of a CSV line: error, interval, RMS, training error, shares within one and two standard
/// deviations.
fn error_cells(mse: f64, [low, high]: Interval, training: Option<f64>, within: &[f64]) -> String {
    let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
    let [one, two] = ONE_AND_TWO_SD.map(|i| number(within.get(i).copied()));
    let (rms, training) = (mse.sqrt() * ASF_UNIT_CM, number(training));
    format!("{mse},{low},{high},{rms},{training},{one},{two}")
}

/// The cells of a table as text: a head, then a line a model.
fn grid(rows: &[SummaryRow]) -> Vec<Vec<String>> {
    let (mut tasks, mut models) = (Vec::new(), Vec::new());
    for row in rows {
        if !tasks.contains(&row.task) {
            tasks.push(row.task);
        }
        if !models.contains(&row.model.as_str()) {
            models.push(row.model.as_str());
        }
    }
    let mut head = vec!["  model".to_string()];
    for task in &tasks {
        head.extend([task.name().into(), "between".into(), "learned".into()]);
    }
    let mut grid = vec![head];
    for model in models {
        let mut line = vec![format!("  {model}")];
        for task in &tasks {
            match rows.iter().find(|r| r.model == model && r.task == *task) {
                Some(r) => line.extend([
                    short(r.mse) + if r.best { "*" } else { " " },
                    format!("{} {}", short(r.interval[0]), short(r.interval[1])),
                    r.training_mse.map(short).unwrap_or_else(|| "-".into()),
                ]),
                None => line.extend([String::from("-"), "-".into(), "-".into()]),
            }
        }
        grid.push(line);
    }
    grid
}

/// A CSV cell.
pub(crate) fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.into()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::with_report;
    use super::*;

    #[test]
    fn tables_say_the_same_in_three_ways() {
        with_report(&["a", "b, \"c\""], |report| {
            let csv = report.csv();
            let mut reader = csv::Reader::from_reader(csv.as_bytes());
            let records: Vec<csv::StringRecord> = reader.records().map(|r| r.unwrap()).collect();
            assert_eq!(records.len(), 6 * 3);
            let all: Vec<_> = records.iter().filter(|r| &r[4] == "all").collect();
            assert_eq!(all[1][3], *"b, \"c\"");
            assert_eq!(all[1][14], *"best");
            assert_eq!(all[0][7].parse::<f64>().unwrap(), report.summary[0].mse);
            let json: Value = serde_json::from_str(&report.json().unwrap()).unwrap();
            assert_eq!(
                json["summary"][0]["mse"].as_f64(),
                Some(report.summary[0].mse)
            );
            assert_eq!(json["cells"][3]["seed"], 1);
            assert_eq!(json["data"]["takes"][1]["subject"], "01");
            assert_eq!(report.times().lines().count(), 1 + 12);
            let text = report.text();
            assert_eq!(text.matches('*').count(), 3);
            assert!(text.contains("split frames: MSE") && text.contains("dense"));
        });
    }

    #[test]
    fn numbers_are_short() {
        let all = [12.345, 0.19449, 0.0, 3.8e-3, 1234.6, 2.5e-7, f64::NAN];
        let expected = [
            "12.3", "0.194", "0.000000", "0.00380", "1235", "0.000000", "NaN",
        ];
        assert_eq!(all.map(short), expected);
    }
}
