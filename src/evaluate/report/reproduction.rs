//! The reproduction page: the paper's Tables 1 to 4 beside what finished runs have measured, and what agrees. Whatever it
//! says of figures is found from them.

use super::charts::title;
use super::findings::{Finding, findings};
use super::paper::{self, MODELS, MORE, Model, Printed, TABLES};
use super::tables::{quoted, short};
use crate::evaluate::benchmark::splits::Split;
use crate::evaluate::benchmark::summary::SummaryRow;
use crate::evaluate::benchmark::task::Task;
use crate::evaluate::html::{escape, fill};
use crate::evaluate::player;
use crate::{Error, Place, Result};
use serde::Deserialize;
use std::fmt::Write;

/// The page around the tables.
const PAGE: &str = include_str!("reproduction.html");
const STYLE: &str = concat!(
    include_str!("../player/player.css"),
    include_str!("report.css")
);

/// What a run's `results.json` tells, as far as it is of use here.
#[derive(Debug, Clone, Deserialize)]
pub struct Run {
    /// The run's name, for messages and captions.
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

impl Run {
    /// Reads a `results.json`; `source` is for messages.
    ///
    /// # Errors
    /// [`Error::Data`] for what is none.
    pub fn parse(text: &[u8], name: &str, source: &str) -> Result<Run> {
        let run: Run = serde_json::from_slice(text).map_err(|e| {
            let what = format!("is no results.json of a run of evaluate ({e})");
            Error::data(Place::file(source), what)
        })?;
        Ok(Run {
            name: name.into(),
            ..run
        })
    }

    /// Whose takes they are, in order of their names.
    pub(super) fn subjects(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.data.takes.iter().map(|t| t.subject.as_str()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The row of a method, without base noise.
    pub(super) fn row(&self, split: Split, task: Task, method: &str) -> Option<&SummaryRow> {
        let own = |r: &&SummaryRow| {
            r.split == split && r.task == task && r.model == method && r.base_asf == 0.0
        };
        self.summary.iter().find(own)
    }

    /// The splits that were run.
    pub(super) fn splits(&self) -> Vec<Split> {
        let has = |s: &Split| self.summary.iter().any(|r| r.split == *s);
        Split::ALL.into_iter().filter(has).collect()
    }

    /// What it is of, in a sentence.
    fn description(&self) -> String {
        let mut rates: Vec<String> = self
            .data
            .takes
            .iter()
            .filter_map(|t| t.rate)
            .map(|r| format!("{r:.0}"))
            .collect();
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

/// The runs, as the tables want them.
pub(super) struct Runs<'a> {
    /// Of several subjects, for Table 1: the one of most.
    pub large: Option<&'a Run>,
    /// Of one subject, for Tables 2 to 4.
    pub small: Vec<&'a Run>,
}

impl<'a> Runs<'a> {
    pub fn of(runs: &'a [Run]) -> Runs<'a> {
        let (one, several): (Vec<&Run>, Vec<&Run>) =
            runs.iter().partition(|r| r.subjects().len() == 1);
        Runs {
            large: several.into_iter().max_by_key(|r| r.subjects().len()),
            small: one,
        }
    }
}

/// The page. The same runs give the same bytes.
///
/// # Errors
/// [`Error::Usage`] where no run is given.
pub fn html(runs: &[Run]) -> Result<String> {
    if runs.is_empty() {
        return Err(Error::usage("--paper: name at least one finished run"));
    }
    let all = Runs::of(runs);
    let mut body = String::new();
    if let Some(run) = all.large {
        table_1(&mut body, run);
    }
    for table in TABLES {
        table_of(&mut body, table.number, table.task, &all.small);
    }
    let mut listed = String::new();
    for run in runs {
        let name = escape(&run.name);
        let _ = write!(
            listed,
            "<li><a href=\"{name}/report.html\">{name}</a>: {}</li>",
            escape(&run.description())
        );
    }
    let mut agreed = String::new();
    for finding in findings(&all) {
        let Finding {
            claim,
            holds,
            found,
        } = finding;
        let (class, mark) = match holds {
            Some(true) => ("yes", "holds"),
            Some(false) => ("no", "does not hold"),
            None => ("open", "measured"),
        };
        let found: String = found
            .iter()
            .map(|f| format!("<li>{}</li>", escape(f)))
            .collect();
        let _ = write!(
            agreed,
            "<h3>{} <span class=\"{class}\">{mark}</span></h3><ul>{found}</ul>",
            escape(&claim)
        );
    }
    let values = [
        ("runs", listed.as_str()),
        ("tables", &body),
        ("findings", &agreed),
        ("style", STYLE),
        ("style-hash", &player::policy_hash(STYLE)),
        ("version", env!("CARGO_PKG_VERSION")),
    ];
    Ok(fill(PAGE, &values))
}

/// The models of a table: the paper's, then ours.
fn models() -> impl Iterator<Item = (Option<usize>, Model)> {
    let theirs = MODELS.into_iter().enumerate().map(|(i, m)| (Some(i), m));
    theirs.chain(MORE.into_iter().map(|m| (None, m)))
}

fn split_name(split: Split) -> &'static str {
    match split {
        Split::Frames => "frames",
        Split::Takes => "takes",
        Split::Subjects => "subjects",
    }
}

/// The columns of a group: what the paper has, and each split of a run.
struct Group<'a> {
    title: String,
    /// By [`MODELS`]; `None`: the paper has no such column.
    printed: Option<[Printed; 7]>,
    run: Option<(&'a Run, Task)>,
}

/// A table of groups of columns; the lowest of each column is marked.
fn grid(out: &mut String, groups: &[Group<'_>]) {
    let splits = |g: &Group<'_>| g.run.map_or_else(Vec::new, |(r, _)| r.splits());
    out.push_str("<div class=\"wide\"><table class=\"own\"><thead><tr><th>model</th>");
    for group in groups {
        let columns = splits(group).len() + usize::from(group.printed.is_some());
        let _ = write!(
            out,
            "<th colspan=\"{columns}\" class=\"task\">{}</th>",
            escape(&group.title)
        );
    }
    out.push_str("</tr><tr><th></th>");
    for group in groups {
        if group.printed.is_some() {
            out.push_str("<th>paper</th>");
        }
        for split in splits(group) {
            let _ = write!(out, "<th>{}</th>", split_name(split));
        }
    }
    out.push_str("</tr></thead><tbody>");
    let known = |index: Option<usize>, model: &Model| {
        groups.iter().any(|g| {
            let printed = index.and_then(|i| g.printed.map(|p| p[i]));
            let printed = printed.is_some_and(|p| p != Printed::Absent);
            let run = |(run, task): (&Run, Task)| {
                Split::ALL
                    .into_iter()
                    .any(|s| run.row(s, task, model.here).is_some())
            };
            printed || g.run.is_some_and(run)
        })
    };
    for (index, model) in models().filter(|(i, m)| known(*i, m)) {
        let _ = write!(
            out,
            "<tr><th>{} <small>{}</small></th>",
            model.name, model.here
        );
        for group in groups {
            if let Some(printed) = &group.printed {
                let lowest = printed.iter().filter_map(|p| p.value());
                let lowest = lowest.fold(f64::INFINITY, f64::min);
                let own = index.map_or(Printed::Absent, |i| printed[i]);
                let best = own.value().is_some_and(|v| v <= lowest);
                let class = if best { " class=\"best\"" } else { "" };
                let _ = write!(out, "<td{class}>{}</td>", own.text());
            }
            for split in splits(group) {
                let Some((run, task)) = group.run else {
                    continue;
                };
                let row = |m: &Model| run.row(split, task, m.here);
                let lowest = models().filter_map(|(_, m)| row(&m).map(|r| r.mse));
                let lowest = lowest.fold(f64::INFINITY, f64::min);
                match row(&model) {
                    Some(row) => {
                        let best = if row.mse <= lowest {
                            " class=\"best\""
                        } else {
                            ""
                        };
                        let _ = write!(
                            out,
                            "<td{best}>{}<br><small>{} to {}</small></td>",
                            short(row.mse),
                            short(row.interval[0]),
                            short(row.interval[1])
                        );
                    }
                    None => out.push_str("<td>–</td>"),
                }
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
}

fn table_1(out: &mut String, run: &Run) {
    let _ = write!(
        out,
        "<section><h2>Table 1: all at once</h2><p>The paper: all of CMU's database, 2,075,280 test poses. Here: {} subjects, \
         {}.</p>",
        run.subjects().len(),
        escape(&run.description())
    );
    let groups = Task::ALL.map(|task| Group {
        title: title(task).into(),
        printed: Some(std::array::from_fn(|m| paper::at_large(task, m))),
        run: Some((run, task)),
    });
    grid(out, &groups);
    out.push_str("</section>");
}

/// Tables 2 to 4: subjects that both have side by side, then those of either alone.
fn table_of(out: &mut String, number: usize, task: Task, runs: &[&Run]) {
    let _ = write!(
        out,
        "<section><h2>Table {number}: {}, single subjects</h2>",
        title(task).to_lowercase()
    );
    let printed = |subject: &str| -> [Printed; 7] {
        std::array::from_fn(|m| paper::at_small(task, subject, m))
    };
    let theirs = TABLES[0].lines.map(|l| l.subject);
    let run_of = |subject: &str| runs.iter().copied().find(|r| r.subjects() == [subject]);
    let side: Vec<Group<'_>> = theirs
        .iter()
        .map(|s| Group {
            title: format!("subject {s}"),
            printed: Some(printed(s)),
            run: run_of(s).map(|r| (r, task)),
        })
        .collect();
    grid(out, &side);
    let others: Vec<Group<'_>> = runs
        .iter()
        .filter(|r| !theirs.contains(&r.subjects()[0]))
        .map(|r| Group {
            title: format!("subject {}", r.subjects()[0]),
            printed: None,
            run: Some((r, task)),
        })
        .collect();
    if !others.is_empty() {
        out.push_str("<p>In place of the subjects that are not at hand:</p>");
        grid(out, &others);
    }
    out.push_str("</section>");
}

/// A line a figure: table, subjects, task, model, what the paper has, and what was measured.
pub fn csv(runs: &[Run]) -> String {
    let mut out =
        String::from("table,subject,task,model,method,paper,split,mse,low,high,seeds,frames\n");
    let all = Runs::of(runs);
    let mut lines = |number: usize, subject: &str, task: Task, run: Option<&Run>| {
        for (index, model) in models() {
            let printed = index.map_or(Printed::Absent, |i| match number {
                1 => paper::at_large(task, i),
                _ => paper::at_small(task, subject, i),
            });
            let paper = printed.value().map(|v| v.to_string()).unwrap_or_default();
            let head = format!(
                "{number},{},{},{},{},{paper}",
                quoted(subject),
                task.name(),
                quoted(model.name),
                model.here
            );
            let rows: Vec<&SummaryRow> = Split::ALL
                .into_iter()
                .filter_map(|s| run?.row(s, task, model.here))
                .collect();
            if rows.is_empty() && !paper.is_empty() {
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
    };
    for task in Task::ALL {
        lines(1, "all", task, all.large);
    }
    for table in TABLES {
        let theirs = table.lines.map(|l| l.subject);
        for subject in theirs {
            let run = all
                .small
                .iter()
                .copied()
                .find(|r| r.subjects() == [subject]);
            lines(table.number, subject, table.task, run);
        }
        for run in &all.small {
            if !theirs.contains(&run.subjects()[0]) {
                lines(table.number, run.subjects()[0], table.task, Some(run));
            }
        }
    }
    out
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::evaluate::benchmark::summary::{rows, tests::cell};

    /// A run of subjects: errors by method.
    pub fn run(subjects: &[&str], errors: &[(&str, f64)]) -> Run {
        let mut cells = Vec::new();
        for split in [Split::Frames, Split::Takes] {
            for task in Task::ALL {
                for (method, mse) in errors {
                    let times = if split == Split::Takes { 2.0 } else { 1.0 };
                    let mut cell = cell(method, 0, task, mse * times, 30);
                    cell.case.split = split;
                    cells.push(cell);
                }
            }
        }
        let take = |s: &&str| RunTake {
            subject: s.to_string(),
            rate: Some(120.0),
        };
        Run {
            name: subjects.join("-"),
            settings: RunSettings {
                seeds: vec![0],
                frames: 30,
            },
            data: RunData {
                frames: 100,
                takes: subjects.iter().map(take).collect(),
            },
            summary: rows(&cells),
        }
    }

    #[test]
    fn tables_stand_side_by_side() {
        let errors = [("ksvd-omp", 0.04), ("mfa", 0.1), ("gaussian", 0.08)];
        let runs = [
            run(&["07"], &errors),
            run(&["<01>"], &errors),
            run(&["01", "07"], &errors),
        ];
        let page = html(&runs).unwrap();
        assert_eq!(page.matches("<table ").count(), 1 + 3 * 2);
        assert!(page.contains("subject &lt;01&gt;") && !page.contains("<01>"));
        for outside in ["http:", "https:", "src=", "{{", "NaN", "style=\""] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert!(page == html(&runs).unwrap());
        let csv = csv(&runs);
        let width = csv.lines().next().unwrap().split(',').count();
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        for record in reader.records() {
            assert_eq!(record.unwrap().len(), width);
        }
        assert!(csv.contains("2,07,dense,MFA,mfa,0.13,frames,"), "{csv}");
        assert!(csv.contains("4,63,complete,SIK,sik,3.9,,,,,,"), "{csv}");
    }

    #[test]
    fn one_run_will_do_and_none_is_refused() {
        let page = html(&[run(&["07"], &[("pca", 1.0)])]).unwrap();
        assert!(!page.contains("Table 1:") && page.contains("Table 4:"));
        html(&[run(&["01", "02"], &[("pca", 1.0)])]).unwrap();
        assert_eq!(html(&[]).unwrap_err().exit_code(), 2);
        let e = Run::parse(b"{}", "x", "x/results.json").unwrap_err();
        assert!(e.to_string().starts_with("x/results.json: is no"), "{e}");
    }
}
