//! Results as text, CSV and JSON. Run times have a CSV file of their own, since no two runs have the same.

use super::BenchmarkReport;
use crate::evaluate::benchmark::leakage::DuplicateEvidence;
use crate::evaluate::benchmark::result::{
    BenchmarkResult, Case, Measurement, ONE_AND_TWO_SD, SD_LEVELS,
};
use crate::evaluate::benchmark::splits::Split;
use crate::evaluate::benchmark::summary::{Interval, SummaryRow, interval};
use crate::pose::ASF_UNIT_CM;
use crate::{Error, Result};
use serde::Serialize;
use std::fmt::Write;

/// The version of the JSON.
const FORMAT: u32 = 1;

#[derive(Serialize)]
struct Json<'a> {
    format: u32,
    version: &'static str,
    /// What `mse` and its like are in.
    units: &'static str,
    settings: JsonSettings<'a>,
    data: JsonData<'a>,
    /// Deviations and the share of a Gaussian within them: what each `within` is to be compared with.
    gaussian_within: Vec<(f64, f64)>,
    summary: &'a [SummaryRow],
    cells: Vec<JsonCell<'a>>,
}

#[derive(Serialize)]
struct JsonSettings<'a> {
    models: Vec<&'a str>,
    tasks: Vec<&'a str>,
    splits: Vec<&'a str>,
    seeds: Vec<u64>,
    frames: usize,
    base_asf: Vec<f64>,
    observe: &'a [String],
}

#[derive(Serialize)]
struct JsonData<'a> {
    digest: String,
    points: &'a [String],
    frames: usize,
    left_out_incomplete: usize,
    takes: Vec<JsonTake<'a>>,
    twins: Vec<JsonTwin<'a>>,
}

#[derive(Serialize)]
struct JsonTake<'a> {
    take: &'a str,
    subject: &'a str,
    frames: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate: Option<f64>,
    digest: &'a str,
}

#[derive(Serialize)]
struct JsonTwin<'a> {
    take: &'a str,
    of: &'a str,
    found_by: DuplicateEvidence,
    share: f64,
}

#[derive(Serialize)]
struct JsonCell<'a> {
    #[serde(flatten)]
    case: &'a Case,
    #[serde(rename = "learnt_from")]
    training_frames: Option<usize>,
    frames: usize,
    mse: f64,
    interval: Interval,
    rms_cm: f64,
    training: Option<JsonTraining>,
    by_joint: &'a [f64],
    calibrated_on: u64,
    within: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tuning: Option<&'a serde_json::Value>,
    /// Under `takes` and `subjects`: the error by take.
    by_take: Vec<(&'a str, usize, f64)>,
}

#[derive(Serialize)]
struct JsonTraining {
    frames: usize,
    mse: f64,
}

impl BenchmarkReport<'_> {
    /// One object: settings, data, the summary over seeds, every cell.
    ///
    /// # Errors
    /// None that the types do not already exclude.
    pub fn json(&self) -> Result<String> {
        let (data, settings) = (self.dataset, self.settings);
        let cells = crate::numeric::parallel::map_chunks(self.results.len(), 1, |r| {
            self.json_cell(&self.results[r.start])
        });
        let json = Json {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION"),
            units: "asf^2 a coordinate; 1 asf = 5.644 cm",
            settings: JsonSettings {
                models: settings.methods.iter().map(|m| m.name.as_str()).collect(),
                tasks: settings.tasks.iter().map(|t| t.name()).collect(),
                splits: settings.splits.iter().map(|s| s.name()).collect(),
                seeds: settings.seeds().collect(),
                frames: settings.frames,
                base_asf: settings.base.iter().map(|b| b / ASF_UNIT_CM).collect(),
                observe: &settings.observe,
            },
            data: JsonData {
                digest: data.digest(),
                points: &data.points,
                frames: data.xyz.nrows(),
                left_out_incomplete: data.incomplete,
                takes: data
                    .takes
                    .iter()
                    .map(|t| JsonTake {
                        take: &t.name,
                        subject: &t.subject,
                        frames: t.rows.len(),
                        rate: t.rate,
                        digest: &t.digest,
                    })
                    .collect(),
                twins: self
                    .duplicates
                    .iter()
                    .map(|t| JsonTwin {
                        take: &data.takes[t.b].name,
                        of: &data.takes[t.a].name,
                        found_by: t.evidence,
                        share: t.share,
                    })
                    .collect(),
            },
            gaussian_within: SD_LEVELS.to_vec(),
            summary: self.summary,
            cells,
        };
        let text = serde_json::to_string_pretty(&json).map_err(|e| Error::usage(e.to_string()))?;
        Ok(text + "\n")
    }

    fn json_cell<'c>(&'c self, cell: &'c BenchmarkResult) -> JsonCell<'c> {
        let test = &cell.test;
        let by_take = match cell.case.split {
            Split::Frames => Vec::new(),
            _ => {
                let take = |u: usize| self.dataset.takes.get(u).map_or("", |t| t.name.as_str());
                test.units
                    .iter()
                    .map(|u| (take(u.unit), u.frames, u.mse))
                    .collect()
            }
        };
        JsonCell {
            case: &cell.case,
            training_frames: cell.training_frames,
            frames: test.frames,
            mse: test.mse,
            interval: interval(cell),
            rms_cm: test.rms_cm(),
            training: cell.training.as_ref().map(|t| JsonTraining {
                frames: t.frames,
                mse: t.mse,
            }),
            by_joint: &test.by_joint,
            calibrated_on: test.coordinates,
            within: test.shares(),
            tuning: cell.tuning.as_ref(),
            by_take,
        }
    }

    /// A line a cell, and one for all seeds together (its `seed` is `all`).
    pub fn csv(&self) -> String {
        let mut out = String::from(
            "split,base_asf,task,model,seed,frames,units,mse,low,high,rms_cm,training_mse,within_1sd,within_2sd,best\n",
        );
        let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
        for row in self.summary {
            let same = |c: &&BenchmarkResult| {
                let id = &c.case;
                id.model == row.model
                    && id.split == row.split
                    && id.task == row.task
                    && id.base_asf == row.base_asf
            };
            let mut line = |seed: String,
                            frames,
                            units,
                            mse: f64,
                            between: Interval,
                            training,
                            within: [Option<f64>; 2],
                            best: &str| {
                let (split, task) = (row.split.name(), row.task.name());
                let rms = mse.sqrt() * ASF_UNIT_CM;
                // Names have no comma: they are read from lists with commas; a file's may have a quote or one.
                let model = quoted(&row.model);
                let _ = writeln!(
                    out,
                    "{split},{},{task},{model},{seed},{frames},{units},{mse},{},{},{rms},{},{},{},{best}",
                    row.base_asf,
                    between[0],
                    between[1],
                    number(training),
                    number(within[0]),
                    number(within[1]),
                );
            };
            for cell in self.results.iter().filter(same) {
                let test: &Measurement = &cell.test;
                let shares = test.shares();
                let within = ONE_AND_TWO_SD.map(|i| shares.get(i).copied());
                let training = cell.training.as_ref().map(|t| t.mse);
                line(
                    cell.case.seed.to_string(),
                    test.frames,
                    test.units.len(),
                    test.mse,
                    interval(cell),
                    training,
                    within,
                    "",
                );
            }
            let best = if row.best { "best" } else { "" };
            line(
                "all".into(),
                row.frames,
                row.units,
                row.mse,
                row.interval,
                row.training_mse,
                row.within_one_two(),
                best,
            );
        }
        out
    }

    /// A line a cell: seconds a pose, seconds of training.
    pub fn times(&self) -> String {
        let mut out =
            String::from("split,base_asf,task,model,seed,seconds_per_pose,seconds_training\n");
        for cell in self.results {
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

    /// Tables to read: a table a split and base noise, a row a model, a column a task; the best is marked `*`.
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
                "split {}{base}: MSE, asf^2 a coordinate, {seeds} seed{plural}, {} frames, 95% intervals",
                first.split.name(),
                first.frames,
            );
            out.push_str(&aligned(&grid(rows)));
        }
        out
    }
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
    let mut head = vec!["model".to_string()];
    for task in &tasks {
        head.extend([task.name().into(), "between".into(), "learnt".into()]);
    }
    let mut grid = vec![head];
    for model in models {
        let mut line = vec![model.to_string()];
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

/// Three digits that count, never an exponent above 1e-5.
pub fn short(v: f64) -> String {
    let digits = (2 - v.abs().max(1e-5).log10().floor() as i32).clamp(0, 6) as usize;
    format!("{v:.digits$}")
}

fn aligned(grid: &[Vec<String>]) -> String {
    let columns = grid.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| {
        grid.iter()
            .filter_map(|l| l.get(c))
            .map(|s| s.chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut out = String::new();
    for line in grid {
        let mut text = String::new();
        for (c, (cell, width)) in line.iter().zip(&widths).enumerate() {
            let _ = match c {
                0 => write!(text, "  {cell:<width$}"),
                _ => write!(text, "  {cell:>width$}"),
            };
        }
        out.push_str(text.trim_end());
        out.push('\n');
    }
    out
}

/// A CSV cell.
pub fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::benchmark::dataset::tests::takes;
    use crate::evaluate::benchmark::summary::{summarize, tests::cell};
    use crate::evaluate::benchmark::task::Task;
    use crate::evaluate::report::{ExampleSet, Settings};

    #[test]
    fn tables_say_the_same_in_three_ways() {
        let dataset = takes(&[("01_01", 4), ("01_02", 4)]);
        let settings = Settings::default();
        let mut results = Vec::new();
        for task in [Task::Dense, Task::Sparse] {
            for (model, mse) in [("a", 1.0), ("b, \"c\"", 0.5)] {
                results.extend((0..2).map(|seed| cell(model, seed, task, mse, 30)));
            }
        }
        let summary = summarize(&results);
        let report = BenchmarkReport {
            dataset: &dataset,
            settings: &settings,
            duplicates: &[],
            results: &results,
            summary: &summary,
            examples: &ExampleSet::default(),
        };
        let csv = report.csv();
        assert_eq!(csv.lines().count(), 1 + 4 * 3);
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        let records: Vec<csv::StringRecord> = reader.records().map(|r| r.unwrap()).collect();
        let all: Vec<_> = records.iter().filter(|r| &r[4] == "all").collect();
        assert_eq!(all[1][3], *"b, \"c\"");
        assert_eq!(all[1][14], *"best");
        assert_eq!(all[0][7].parse::<f64>().unwrap(), summary[0].mse);
        let json: serde_json::Value = serde_json::from_str(&report.json().unwrap()).unwrap();
        assert_eq!(json["summary"][0]["mse"].as_f64(), Some(summary[0].mse));
        assert_eq!(json["cells"][3]["seed"], 1);
        assert_eq!(json["data"]["takes"][1]["subject"], "01");
        assert_eq!(report.times().lines().count(), 1 + 8);
        let text = report.text();
        assert_eq!(text.matches('*').count(), 2);
        assert!(
            text.contains("split frames: MSE") && text.contains("dense"),
            "{text}"
        );
        let none = BenchmarkReport {
            summary: &[],
            results: &[],
            ..report
        };
        assert_eq!(none.text(), "");
    }

    #[test]
    fn numbers_are_short() {
        let all = [12.345, 0.19449, 0.0, 3.8e-3, 1234.6, 2.5e-7, f64::NAN];
        let said = [
            "12.3", "0.194", "0.000000", "0.00380", "1235", "0.000000", "NaN",
        ];
        assert_eq!(all.map(short), said);
    }
}
