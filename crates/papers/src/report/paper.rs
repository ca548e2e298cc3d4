//! Tables 1 to 4 of the paper of Lai et al. beside what finished runs have measured, as a page and
//! as CSV.
//!
//! The printed errors are in `paper.toml`. The run of most subjects is compared with Table 1, each
//! run of one subject with Tables 2 to 4. The page carries the numbers as JSON; its script draws
//! the tables.

use super::HELPERS;
use super::tables::quoted;
use crate::benchmark::splits::Split;
use crate::benchmark::summary::SummaryRow;
use crate::benchmark::task::Task;
use crate::draw::html::{page, script_json};
use crate::draw::plain_page::STYLE;
use crate::{Error, Place, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fmt::Write;

const DATA: &str = include_str!("paper.toml");
const PAGE: &str = include_str!("paper.html");
const TABLES: &str = include_str!("paper.js");

/// What the comparison needs of a run's `results.json`.
#[derive(Debug, Clone, Deserialize)]
pub struct FinishedRun {
    /// The run's name, for captions.
    #[serde(skip)]
    name: String,
    settings: Value,
    data: Value,
    summary: Vec<SummaryRow>,
}

impl FinishedRun {
    /// Reads a `results.json`; `source` names the file in messages.
    ///
    /// # Errors
    /// [`Error::Data`] if the text is not a `results.json`.
    pub fn parse(text: &[u8], name: &str, source: &str) -> Result<FinishedRun> {
        let run: FinishedRun = serde_json::from_slice(text).map_err(|e| {
            let what = format!("is not the results.json of an evaluate run ({e})");
            Error::data(Place::file(source), what)
        })?;
        Ok(FinishedRun {
            name: name.into(),
            ..run
        })
    }

    fn subjects(&self) -> BTreeSet<&str> {
        let takes = self.data["takes"].as_array();
        takes
            .into_iter()
            .flatten()
            .filter_map(|t| t["subject"].as_str())
            .collect()
    }

    /// The subject of a run of one subject.
    fn single(&self) -> Option<&str> {
        let subjects = self.subjects();
        (subjects.len() == 1).then(|| subjects.first().copied())?
    }
}

/// The content of `paper.toml`.
#[derive(Debug, Clone, Deserialize)]
struct PrintedTables {
    /// The paper's models by name and method, its own first.
    models: Vec<(String, String)>,
    /// Methods that the paper does not have.
    further_models: Vec<(String, String)>,
    columns: Vec<Column>,
}

/// One task of one subject (or `all`) in a table.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Column {
    table: usize,
    task: Task,
    subject: String,
    /// The printed errors, one a model of the paper; empty for a subject that the paper does not
    /// have.
    errors: Vec<String>,
    /// The measured errors of each split and method, without base noise.
    #[serde(skip_deserializing)]
    measured: Vec<SummaryRow>,
}

impl Column {
    /// The printed error of a model; `None` if it is absent or has lost a digit.
    fn printed(&self, model: usize) -> Option<f64> {
        self.errors.get(model)?.parse().ok()
    }

    fn measure(&mut self, run: &FinishedRun) {
        let own = |r: &&SummaryRow| r.task == self.task && r.base_asf == 0.0;
        self.measured = run.summary.iter().filter(own).cloned().collect();
        for row in &mut self.measured {
            (row.by_joint, row.within) = (Vec::new(), Vec::new());
        }
    }
}

/// The paper's tables joined with runs.
pub struct Comparison<'a> {
    /// The paper's models, then the further ones: name and method.
    models: Vec<(String, String)>,
    /// By table; the paper's subjects first.
    columns: Vec<Column>,
    runs: &'a [FinishedRun],
}

impl<'a> Comparison<'a> {
    /// Joins the paper's tables with finished runs.
    ///
    /// # Errors
    /// [`Error::Usage`] without a run.
    pub fn new(runs: &'a [FinishedRun]) -> Result<Comparison<'a>> {
        if runs.is_empty() {
            return Err(Error::usage(
                "the option `paper`: name at least one finished run",
            ));
        }
        let tables: PrintedTables =
            toml::from_str(DATA).map_err(|e| Error::usage(e.to_string()))?;
        let (single, several): (Vec<&FinishedRun>, Vec<&FinishedRun>) =
            runs.iter().partition(|r| r.single().is_some());
        let mut columns = tables.columns;
        for subject in single.iter().filter_map(|r| r.single()) {
            for (table, task) in (2..).zip(Task::ALL) {
                if !columns
                    .iter()
                    .any(|c| c.table == table && c.subject == subject)
                {
                    columns.push(Column {
                        table,
                        task,
                        subject: subject.into(),
                        errors: Vec::new(),
                        measured: Vec::new(),
                    });
                }
            }
        }
        columns.sort_by_key(|c| c.table);
        let largest = several.into_iter().max_by_key(|r| r.subjects().len());
        for column in &mut columns {
            let own = |r: &&FinishedRun| r.single() == Some(&column.subject);
            let run = match column.table {
                1 => largest,
                _ => single.iter().copied().find(own),
            };
            if let Some(run) = run {
                column.measure(run);
            }
        }
        Ok(Comparison {
            models: [tables.models, tables.further_models].concat(),
            columns,
            runs,
        })
    }

    /// A line for each printed and each measured error.
    pub fn csv(&self) -> String {
        let mut out =
            String::from("table,subject,task,model,method,paper,split,mse,low,high,seeds,frames\n");
        for column in &self.columns {
            for (index, (model, method)) in self.models.iter().enumerate() {
                let printed = column.printed(index);
                let head = format!(
                    "{},{},{},{},{method},{}",
                    column.table,
                    quoted(&column.subject),
                    column.task.name(),
                    quoted(model),
                    printed.map(|v| v.to_string()).unwrap_or_default(),
                );
                let row = |split: Split| {
                    let mut rows = column.measured.iter();
                    rows.find(|r| r.model == *method && r.split == split)
                };
                let rows: Vec<&SummaryRow> = Split::ALL.into_iter().filter_map(row).collect();
                if rows.is_empty() && printed.is_some() {
                    let _ = writeln!(out, "{head},,,,,,");
                }
                for row in rows {
                    let (split, mse, [low, high]) = (row.split.name(), row.mse, row.interval);
                    let (seeds, frames) = (row.seeds.len(), row.frames);
                    let _ = writeln!(out, "{head},{split},{mse},{low},{high},{seeds},{frames}");
                }
            }
        }
        out
    }

    /// The page of tables.
    pub fn html(&self) -> String {
        let run = |r: &FinishedRun| json!({"name": r.name, "settings": r.settings, "data": r.data});
        let data = json!({
            "models": self.models,
            "columns": self.columns,
            "runs": self.runs.iter().map(run).collect::<Vec<_>>(),
        });
        let script = format!("{HELPERS}\n{TABLES}");
        page(PAGE, STYLE, &script, &[("results", &script_json(&data))])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::method::Method;
    use crate::benchmark::summary::{summarize, tests::cell};

    /// A run of subjects: errors by method, twice as large on held-out takes.
    fn run(subjects: &[&str], errors: &[(&str, f64)]) -> FinishedRun {
        let mut cells = Vec::new();
        for (split, factor) in [(Split::Frames, 1.0), (Split::Takes, 2.0)] {
            for task in Task::ALL {
                for (method, mse) in errors {
                    let mut cell = cell(method, 0, task, mse * factor, 30);
                    cell.case.split = split;
                    cells.push(cell);
                }
            }
        }
        let take = |subject: &&str| json!({"subject": subject, "rate": 120.0});
        let takes: Vec<Value> = subjects.iter().map(take).collect();
        let results = json!({
            "settings": {"seeds": [0], "frames": 30},
            "data": {"frames": 100, "takes": takes},
            "summary": summarize(&cells),
        });
        FinishedRun::parse(results.to_string().as_bytes(), &subjects.join("-"), "x").unwrap()
    }

    #[test]
    fn printed_errors_are_read_and_methods_exist() {
        crate::published::register();
        let runs = [run(&["07"], &[("pca", 1.0)])];
        let paper = Comparison::new(&runs).unwrap();
        for (_, method) in &paper.models {
            Method::parse(method).unwrap();
        }
        let column = |table: usize, subject: &str| {
            let mut all = paper.columns.iter();
            all.find(|c| c.table == table && c.subject == subject)
                .unwrap()
        };
        assert_eq!(column(1, "all").printed(0), Some(0.12));
        assert_eq!(column(4, "07").printed(4), Some(0.95));
        // A lost digit is not a number.
        assert_eq!(column(2, "102").printed(6), None);
        let parsed = |c: &Column| (0..7).filter_map(|m| c.printed(m)).count();
        // 15 columns of 7; Table 1 lacks SIK three times and PCA once, and four errors have lost a
        // digit.
        assert_eq!(
            paper.columns.iter().map(parsed).sum::<usize>(),
            15 * 7 - 4 - 4
        );
    }

    #[test]
    fn measured_errors_stand_beside_printed_ones() {
        let errors = [("ksvd-omp", 0.04), ("mfa", 0.1), ("gaussian", 0.08)];
        let runs = [
            run(&["07"], &errors),
            run(&["<01>"], &errors),
            run(&["01", "07"], &errors),
        ];
        let paper = Comparison::new(&runs).unwrap();
        let measured = |c: &&Column| !c.measured.is_empty();
        assert_eq!(paper.columns.iter().filter(measured).count(), 3 + 3 * 2);
        let page = paper.html();
        assert!(page == paper.html() && !page.contains("<01>"));
        for outside in ["http:", "https:", "src=", "{{", "style=\""] {
            assert!(!page.contains(outside), "{outside}");
        }
        let csv = paper.csv();
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        assert!(reader.records().all(|record| record.unwrap().len() == 12));
        assert!(csv.contains("2,07,dense,MFA,mfa,0.13,frames,"), "{csv}");
        assert!(csv.contains("2,<01>,dense,MFA,mfa,,takes,"), "{csv}");
        assert!(csv.contains("4,63,complete,SIK,sik,3.9,,,,,,"), "{csv}");
    }

    #[test]
    fn no_run_and_a_wrong_file_are_refused() {
        assert_eq!(Comparison::new(&[]).err().unwrap().exit_code(), 2);
        let e = FinishedRun::parse(b"{}", "x", "x/results.json").unwrap_err();
        assert!(e.to_string().starts_with("x/results.json: is not"), "{e}");
    }
}
