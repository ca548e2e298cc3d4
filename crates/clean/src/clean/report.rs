//! What became of many files: a table for the terminal, and one page.

use super::list::{entries, list, list_path};
use super::outcome::FileOutcome;
use super::record::{Summary, make_folder_of};
use super::row::Row;
use crate::audit::count as count_of;
use crate::draw::text_table::aligned;
use crate::io::output::write_file;
use crate::{Error, Result};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The title of the page.
pub(super) const TITLE: &str = "Takes cleaned";
const TITLES: [&str; 9] = [
    "file",
    "format",
    "frames",
    "points",
    "missing",
    "filled",
    "outliers",
    "noise, cm",
    "result",
];
/// Findings of a file that the terminal shows; the page and the record have all.
const SHOWN: usize = 3;

fn folder_of(page: &Path) -> &Path {
    page.parent().unwrap_or(Path::new(""))
}

/// Whether a file is a page that [`CleanReport::html`] made.
pub(crate) fn is_page(path: &Path) -> bool {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.contains(&format!("<title>{TITLE}</title>"))
}

/// The files and what became of them.
pub struct CleanReport {
    /// The files.
    pub rows: Vec<Row>,
    /// The files of folders that hold no motion, or are results.
    pub left_out: usize,
    /// Whether what the last run reported is not reported again.
    pub only_new: bool,
    /// The path of the page of all.
    pub page: Option<PathBuf>,
    /// Whether one file was cleaned by itself.
    pub is_one: bool,
}

impl CleanReport {
    /// Whether somebody has to look at a result.
    pub fn has_findings(&self) -> bool {
        let has = |row: &Row| {
            if self.only_new {
                !row.new.is_empty()
            } else {
                row.outcome
                    .summary()
                    .is_some_and(|s| !s.findings.is_empty())
            }
        };
        self.rows.iter().any(has)
    }

    /// Whether a file failed.
    pub fn has_failures(&self) -> bool {
        self.failures().next().is_some()
    }

    fn failures(&self) -> impl Iterator<Item = &Row> {
        let is_told = |row: &&Row| row.has_failed() && (!self.only_new || row.is_new_failure);
        self.rows.iter().filter(is_told)
    }

    /// Why files could not be cleaned; with `only_new`, what the last run did not tell.
    pub fn errors(&self) -> impl Iterator<Item = &Error> {
        self.failures().filter_map(|row| match &row.outcome {
            FileOutcome::Failed { error, .. } => Some(error),
            _ => None,
        })
    }

    /// What is to be known of how the one file was taken; nothing of several.
    pub fn notes(&self) -> &[String] {
        match (self.is_one, &self.rows[..]) {
            (true, [row]) => match &row.outcome {
                FileOutcome::Cleaned(summary) => &summary.notes,
                _ => &[],
            },
            _ => &[],
        }
    }

    /// Writes the page, if there is to be one.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub fn write_page(&self) -> Result<()> {
        let Some(page) = &self.page else {
            return Ok(());
        };
        make_folder_of(page)?;
        write_file(page, self.html(folder_of(page)).as_bytes())
    }

    /// Writes the list beside the page: what it has counts as reported.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub fn write_list(&self) -> Result<()> {
        let Some(page) = &self.page else {
            return Ok(());
        };
        let list = list(&self.rows, folder_of(page))?;
        write_file(list_path(page), list.as_bytes())
    }

    /// What the list has of each file, with paths as they were given.
    pub fn files(&self) -> Vec<Value> {
        entries(&self.rows, Path::new(""))
    }

    /// The table, each file's findings below it, and a line that counts and, if there is more to
    /// see, says where the page is.
    pub fn text(&self) -> String {
        let mut rows = vec![TITLES.map(String::from).to_vec()];
        for row in self.rows.iter().filter(|r| !self.only_new || r.has_news()) {
            rows.push(cells(row));
            let findings = match (self.only_new, row.outcome.summary()) {
                (true, _) => &row.new[..],
                (false, summary) => summary.map_or(&[][..], |s| &s.findings),
            };
            rows.extend(findings.iter().take(SHOWN).map(|f| vec![format!("  {f}")]));
            if findings.len() > SHOWN {
                rows.push(vec![format!("  and {} more", findings.len() - SHOWN)]);
            }
        }
        let table = if rows.len() > 1 {
            aligned(&rows)
        } else {
            String::new()
        };
        let page = match &self.page {
            Some(page) if self.has_findings() || self.has_failures() => {
                format!("; see {}", plain(&page.display().to_string()))
            }
            _ => String::new(),
        };
        format!("{table}{}{page}\n", self.counts())
    }

    /// One line: how many files, and what became of them.
    pub(super) fn counts(&self) -> String {
        let count = |is: &dyn Fn(&Row) -> bool| self.rows.iter().filter(|r| is(r)).count();
        let of = |word: &str| count(&|row| row.outcome.word() == word);
        let found = count(&|r| r.outcome.summary().is_some_and(|s| !s.findings.is_empty()));
        let mut line = format!(
            "{}: {} cleaned, {} copied, {} unchanged since the last run, {} failed; \
             findings in {found}",
            count_of(self.rows.len(), "file"),
            of("cleaned"),
            of("copied"),
            of("unchanged"),
            of("failed"),
        );
        if self.only_new {
            let _ = write!(line, ", new in {}", count(&|r| !r.new.is_empty()));
        }
        if self.left_out > 0 {
            let _ = write!(line, "; {} ignored", count_of(self.left_out, "other file"));
        }
        line
    }
}

/// A name without characters that move a terminal's cursor.
fn plain(name: &str) -> String {
    name.replace(char::is_control, "\u{fffd}")
}

/// The cells of a file, as [`TITLES`] has them.
fn cells(row: &Row) -> Vec<String> {
    let mut out = vec![plain(&row.name)];
    match row.outcome.summary() {
        Some(s) => {
            out.push(s.format.clone());
            out.extend(
                [s.frames, s.points, s.missing, s.filled, s.outliers].map(|n| n.to_string()),
            );
            out.push(noise(s, ""));
        }
        None => out.extend(std::iter::repeat_n(String::new(), TITLES.len() - 2)),
    }
    let named_by = row.outcome.summary().and_then(|s| s.named_by.as_ref());
    let named = named_by.map(|by| format!(", named by {}", plain(by)));
    out.push(fate(row).to_string() + &named.unwrap_or_default());
    out
}

/// The noise of a file, and what became of it; positions have the `unit` of lengths.
pub(super) fn noise(summary: &Summary, unit: &str) -> String {
    let became = match (summary.denoised, summary.noise_stays) {
        (true, _) => " removed",
        (_, true) => " stays",
        _ => "",
    };
    match summary.noise_deg {
        Some(noise) => format!("{noise:.2} deg{became}"),
        None => format!("{:.2}{unit}{became}", summary.noise),
    }
}

/// What became of a file, in words.
pub(super) fn fate(row: &Row) -> &'static str {
    match &row.outcome {
        FileOutcome::Failed {
            old_result: true, ..
        } => "failed, old result stays",
        outcome => outcome.word(),
    }
}
