//! The paper's Tables 1 to 4 beside what finished runs have measured, as a page and as CSV.
//!
//! The printed errors are in `paper.toml`. A run of one subject stands in Tables 2 to 4, the run of most subjects in
//! Table 1. Equal runs give equal bytes.

use super::findings::findings;
use super::tables::{quoted, short};
use crate::evaluate::benchmark::splits::Split;
use crate::evaluate::benchmark::summary::SummaryRow;
use crate::evaluate::benchmark::task::Task;
use crate::evaluate::html::{escape, fill};
use crate::evaluate::player;
use crate::{Error, Place, Result};
use serde::Deserialize;
use std::fmt::Write;

const DATA: &str = include_str!("paper.toml");
const PAGE: &str = include_str!("paper.html");
const STYLE: &str = concat!(
    include_str!("../player/player.css"),
    include_str!("report.css")
);

/// What `paper.toml` holds.
#[derive(Debug, Clone, Deserialize)]
struct PaperData {
    models: Vec<Model>,
    further_models: Vec<Model>,
    columns: Vec<PrintedColumn>,
}

/// A model by the paper's name and by that of the method here.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(from = "(String, String)")]
pub(super) struct Model {
    pub name: String,
    pub method: String,
}

impl From<(String, String)> for Model {
    fn from((name, method): (String, String)) -> Model {
        Model { name, method }
    }
}

/// The errors of one task for one subject (or `all`), one a model of the paper.
#[derive(Debug, Clone, Deserialize)]
struct PrintedColumn {
    table: usize,
    task: Task,
    subject: String,
    errors: Vec<String>,
}

/// What the comparison needs of a run's `results.json`.
#[derive(Debug, Clone, Deserialize)]
pub struct FinishedRun {
    /// The run's name, for captions.
    #[serde(skip)]
    pub name: String,
    settings: RunSettings,
    data: RunData,
    summary: Vec<SummaryRow>,
}

#[derive(Debug, Clone, Deserialize)]
struct RunSettings {
    seeds: Vec<u64>,
    frames: usize,
}

#[derive(Debug, Clone, Deserialize)]
struct RunData {
    frames: usize,
    takes: Vec<RunTake>,
}

#[derive(Debug, Clone, Deserialize)]
struct RunTake {
    subject: String,
    rate: Option<f64>,
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

    /// The subjects in the order of their names.
    pub(super) fn subjects(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.data.takes.iter().map(|t| t.subject.as_str()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The row of a method, without base noise.
    pub(super) fn row(&self, split: Split, task: Task, method: &str) -> Option<&SummaryRow> {
        self.summary
            .iter()
            .find(|r| r.split == split && r.task == task && r.model == method && r.base_asf == 0.0)
    }

    /// The splits that were run.
    pub(super) fn splits(&self) -> Vec<Split> {
        let has = |s: &Split| self.summary.iter().any(|r| r.split == *s);
        Split::ALL.into_iter().filter(has).collect()
    }

    /// The size of the run, in a sentence.
    fn description(&self) -> String {
        let rates = self.data.takes.iter().filter_map(|t| t.rate);
        let mut rates: Vec<String> = rates.map(|r| format!("{r:.0}")).collect();
        rates.sort();
        rates.dedup();
        let rate = match rates.is_empty() {
            true => String::new(),
            false => format!(" at {} frames a second", rates.join(" and ")),
        };
        let (takes, seeds) = (self.data.takes.len(), self.settings.seeds.len());
        let several = |n: usize| if n == 1 { "" } else { "s" };
        format!(
            "{takes} take{}, {} frames{rate}; {seeds} seed{}, at most {} test poses each",
            several(takes),
            self.data.frames,
            several(seeds),
            self.settings.frames
        )
    }
}

/// One task and subject of a table: what the paper prints, what a run measured, or both.
pub(super) struct Column<'a> {
    pub table: usize,
    pub task: Task,
    pub subject: String,
    /// One a model of [`Comparison::models`]; empty for a subject that the paper does not have.
    printed: Vec<String>,
    pub run: Option<&'a FinishedRun>,
}

impl Column<'_> {
    /// The printed error of a model; `None` if it is absent or has lost a digit.
    pub fn printed(&self, model: usize) -> Option<f64> {
        self.printed.get(model)?.parse().ok()
    }

    /// The measured error of a method, asf².
    pub fn measured(&self, split: Split, method: &str) -> Option<f64> {
        Some(self.row(split, method)?.mse)
    }

    fn row(&self, split: Split, method: &str) -> Option<&SummaryRow> {
        self.run?.row(split, self.task, method)
    }

    fn splits(&self) -> Vec<Split> {
        self.run.map_or_else(Vec::new, FinishedRun::splits)
    }

    fn is_printed(&self) -> bool {
        !self.printed.is_empty()
    }
}

/// The paper's tables joined with runs.
pub struct Comparison<'a> {
    /// The paper's models, its own first.
    pub(super) models: Vec<Model>,
    /// Methods that the paper does not have.
    pub(super) further_models: Vec<Model>,
    /// By table; the paper's subjects first.
    pub(super) columns: Vec<Column<'a>>,
    pub(super) runs: &'a [FinishedRun],
}

impl<'a> Comparison<'a> {
    /// Joins the paper's tables with finished runs.
    ///
    /// # Errors
    /// [`Error::Usage`] without a run.
    pub fn new(runs: &'a [FinishedRun]) -> Result<Comparison<'a>> {
        if runs.is_empty() {
            return Err(Error::usage("--paper: name at least one finished run"));
        }
        let data: PaperData = toml::from_str(DATA).map_err(|e| Error::usage(e.to_string()))?;
        let (single, several): (Vec<&FinishedRun>, Vec<&FinishedRun>) =
            runs.iter().partition(|r| r.subjects().len() == 1);
        let largest = several.into_iter().max_by_key(|r| r.subjects().len());
        let find = |subject: &str| single.iter().copied().find(|r| r.subjects() == [subject]);
        let mut columns: Vec<Column<'a>> = Vec::new();
        for printed in data.columns {
            columns.push(Column {
                run: match printed.table {
                    1 => largest,
                    _ => find(&printed.subject),
                },
                table: printed.table,
                task: printed.task,
                subject: printed.subject,
                printed: printed.errors,
            });
        }
        for (table, task) in [(2, Task::Dense), (3, Task::Sparse), (4, Task::Complete)] {
            for run in &single {
                let subject = run.subjects()[0];
                if !columns
                    .iter()
                    .any(|c| c.table == table && c.subject == subject)
                {
                    columns.push(Column {
                        table,
                        task,
                        subject: subject.into(),
                        printed: Vec::new(),
                        run: Some(run),
                    });
                }
            }
        }
        columns.sort_by_key(|c| c.table);
        Ok(Comparison {
            models: data.models,
            further_models: data.further_models,
            columns,
            runs,
        })
    }

    /// The paper's models, then the further ones.
    pub(super) fn all_models(&self) -> impl Iterator<Item = (usize, &Model)> {
        self.models.iter().chain(&self.further_models).enumerate()
    }

    /// A line for each printed and each measured error.
    pub fn csv(&self) -> String {
        let mut out =
            String::from("table,subject,task,model,method,paper,split,mse,low,high,seeds,frames\n");
        for column in &self.columns {
            for (index, model) in self.all_models() {
                let printed = column
                    .printed(index)
                    .map(|v| v.to_string())
                    .unwrap_or_default();
                let head = format!(
                    "{},{},{},{},{},{printed}",
                    column.table,
                    quoted(&column.subject),
                    column.task.name(),
                    quoted(&model.name),
                    model.method
                );
                let rows: Vec<&SummaryRow> = Split::ALL
                    .into_iter()
                    .filter_map(|s| column.row(s, &model.method))
                    .collect();
                if rows.is_empty() && !printed.is_empty() {
                    let _ = writeln!(out, "{head},,,,,,");
                }
                for row in rows {
                    let [low, high] = row.interval;
                    let _ = writeln!(
                        out,
                        "{head},{},{},{low},{high},{},{}",
                        row.split.name(),
                        row.mse,
                        row.seeds.len(),
                        row.frames
                    );
                }
            }
        }
        out
    }

    /// The page of tables and findings.
    pub fn html(&self) -> String {
        let mut findings_list = String::new();
        for finding in findings(self) {
            let (class, mark) = match finding.holds {
                Some(true) => ("yes", "holds"),
                Some(false) => ("no", "does not hold"),
                None => ("open", "measured"),
            };
            let sentences = finding.sentences.iter();
            let sentences: String = sentences
                .map(|f| format!("<li>{}</li>", escape(f)))
                .collect();
            let _ = write!(
                findings_list,
                "<h3>{} <span class=\"{class}\">{mark}</span></h3><ul>{sentences}</ul>",
                escape(&finding.claim)
            );
        }
        let mut run_list = String::new();
        for run in self.runs {
            let (name, description) = (escape(&run.name), escape(&run.description()));
            let _ = write!(
                run_list,
                "<li><a href=\"{name}/report.html\">{name}</a>: {description}</li>"
            );
        }
        fill(
            PAGE,
            &[
                (
                    "tables",
                    &(1..=4).map(|t| self.table(t)).collect::<String>(),
                ),
                ("findings", &findings_list),
                ("runs", &run_list),
                ("style", STYLE),
                ("style-hash", &player::policy_hash(STYLE)),
                ("version", env!("CARGO_PKG_VERSION")),
            ],
        )
    }

    /// One table of the paper as a section; empty for Table 1 without a run of several subjects.
    fn table(&self, number: usize) -> String {
        let of_table = |c: &&Column| c.table == number;
        let columns: Vec<&Column> = self.columns.iter().filter(of_table).collect();
        let (printed, others): (Vec<&Column>, Vec<&Column>) =
            columns.into_iter().partition(|c| c.is_printed());
        let (heading, note) = match (number, printed.first().and_then(|c| c.run)) {
            (1, None) => return String::new(),
            (1, Some(run)) => (
                "all subjects".to_string(),
                format!(
                    "<p>The paper: all of CMU's database, 2,075,280 test poses. Here: {} subjects, {}.</p>",
                    run.subjects().len(),
                    escape(&run.description())
                ),
            ),
            _ => {
                let task = printed.first().map_or("", |c| title(c.task)).to_lowercase();
                (format!("{task}, single subjects"), String::new())
            }
        };
        let mut out = format!("<section><h2>Table {number}: {heading}</h2>{note}");
        self.grid(&mut out, &printed);
        if !others.is_empty() {
            out.push_str("<p>Subjects that the paper does not have:</p>");
            self.grid(&mut out, &others);
        }
        out + "</section>"
    }

    /// Columns side by side: what the paper prints, then each split of the run. The lowest error of each is marked.
    fn grid(&self, out: &mut String, columns: &[&Column<'_>]) {
        let [mut groups, mut heads] = ["<th>model</th>", "<th></th>"].map(String::from);
        for column in columns {
            let splits = column.splits();
            let width = splits.len() + usize::from(column.is_printed());
            let name = match column.table {
                1 => title(column.task).to_string(),
                _ => format!("subject {}", escape(&column.subject)),
            };
            let _ = write!(groups, "<th colspan=\"{width}\" class=\"task\">{name}</th>");
            let paper = column.is_printed().then_some("paper");
            let names = paper.into_iter().chain(splits.into_iter().map(Split::name));
            names.for_each(|name| heads.push_str(&format!("<th>{name}</th>")));
        }
        let mut body = String::new();
        for (index, model) in self.all_models() {
            let is_known = columns.iter().any(|c| {
                c.printed.get(index).is_some_and(|p| !p.is_empty())
                    || Split::ALL
                        .into_iter()
                        .any(|s| c.row(s, &model.method).is_some())
            });
            if !is_known {
                continue;
            }
            let _ = write!(
                body,
                "<tr><th>{} <small>{}</small></th>",
                model.name, model.method
            );
            for column in columns {
                if column.is_printed() {
                    let all = (0..self.models.len()).filter_map(|m| column.printed(m));
                    let text = column.printed.get(index).filter(|p| !p.is_empty());
                    let text = text.map_or("–", String::as_str);
                    body.push_str(&cell(column.printed(index), all, text));
                }
                for split in column.splits() {
                    let all = self
                        .all_models()
                        .filter_map(|(_, m)| column.measured(split, &m.method));
                    let row = column.row(split, &model.method);
                    let text = row.map_or("–".to_string(), |row| {
                        let [mse, low, high] =
                            [row.mse, row.interval[0], row.interval[1]].map(short);
                        format!("{mse}<br><small>{low} to {high}</small>")
                    });
                    body.push_str(&cell(row.map(|r| r.mse), all, &text));
                }
            }
            body.push_str("</tr>");
        }
        let _ = write!(
            out,
            "<div class=\"wide\"><table class=\"own\"><thead><tr>{groups}</tr><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
        );
    }
}

/// A table cell, marked if its value is the lowest of `all`.
fn cell(value: Option<f64>, all: impl Iterator<Item = f64>, text: &str) -> String {
    let lowest = all.fold(f64::INFINITY, f64::min);
    match value.is_some_and(|v| v <= lowest) {
        true => format!("<td class=\"best\">{text}</td>"),
        false => format!("<td>{text}</td>"),
    }
}

/// A task at the start of a caption.
fn title(task: Task) -> &'static str {
    match task {
        Task::Dense => "Dense noise",
        Task::Sparse => "Sparse noise",
        Task::Complete => "Completion",
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::evaluate::benchmark::method::Method;
    use crate::evaluate::benchmark::summary::{summarize, tests::cell};

    /// A run of subjects: errors by method, twice as large on held-out takes.
    pub fn run(subjects: &[&str], errors: &[(&str, f64)]) -> FinishedRun {
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
        let take = |s: &&str| RunTake {
            subject: s.to_string(),
            rate: Some(120.0),
        };
        FinishedRun {
            name: subjects.join("-"),
            settings: RunSettings {
                seeds: vec![0],
                frames: 30,
            },
            data: RunData {
                frames: 100,
                takes: subjects.iter().map(take).collect(),
            },
            summary: summarize(&cells),
        }
    }

    #[test]
    fn printed_errors_are_read_and_methods_exist() {
        let runs = [run(&["07"], &[("pca", 1.0)])];
        let paper = Comparison::new(&runs).unwrap();
        for (_, model) in paper.all_models() {
            Method::parse(&model.method).unwrap();
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
        let all = paper.columns.iter();
        assert!(all.clone().all(|c| c.printed.len() == paper.models.len()));
        let parsed = all
            .flat_map(|c| (0..7).filter_map(|m| c.printed(m)))
            .count();
        // 15 columns of 7; Table 1 lacks SIK three times and PCA once, and four errors have lost a digit.
        assert_eq!(parsed, 15 * 7 - 4 - 4);
    }

    #[test]
    fn tables_stand_side_by_side() {
        let errors = [("ksvd-omp", 0.04), ("mfa", 0.1), ("gaussian", 0.08)];
        let runs = [
            run(&["07"], &errors),
            run(&["<01>"], &errors),
            run(&["01", "07"], &errors),
        ];
        let paper = Comparison::new(&runs).unwrap();
        let page = paper.html();
        assert_eq!(page.matches("<table ").count(), 1 + 3 * 2);
        assert!(page.contains("subject &lt;01&gt;") && !page.contains("<01>"));
        for outside in ["http:", "https:", "src=", "{{", "NaN", "style=\""] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert!(page == paper.html());
        let csv = paper.csv();
        let width = csv.lines().next().unwrap().split(',').count();
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        for record in reader.records() {
            assert_eq!(record.unwrap().len(), width);
        }
        assert!(csv.contains("2,07,dense,MFA,mfa,0.13,frames,"), "{csv}");
        assert!(csv.contains("4,63,complete,SIK,sik,3.9,,,,,,"), "{csv}");
    }

    #[test]
    fn one_run_is_enough_and_none_is_refused() {
        let page = |run: FinishedRun| Comparison::new(&[run]).unwrap().html();
        let single = page(run(&["07"], &[("pca", 1.0)]));
        assert!(!single.contains("Table 1: all") && single.contains("Table 4: completion"));
        assert!(page(run(&["01", "02"], &[("pca", 1.0)])).contains("Table 1: all"));
        assert_eq!(Comparison::new(&[]).err().unwrap().exit_code(), 2);
        let e = FinishedRun::parse(b"{}", "x", "x/results.json").unwrap_err();
        assert!(e.to_string().starts_with("x/results.json: is not"), "{e}");
    }
}
