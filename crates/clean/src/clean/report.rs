//! What became of many files: a table for the terminal, and one page.

use super::list::{entries, list, list_path};
use super::outcome::FileOutcome;
use super::places::PlaceToSee;
use super::record::make_folder_of;
use super::row::Row;
use crate::audit::count as count_of;
use crate::draw::href::{encoded, href};
use crate::draw::html::escape;
use crate::draw::plain_page::PlainPage;
use crate::draw::text_table::aligned;
use crate::io::output::write_file;
use crate::{Error, Result};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const STYLE: &str = include_str!("clean.css");
/// The title of the page.
const TITLE: &str = "Takes cleaned";
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

    /// The table, each file's findings below it, and a line that counts.
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
        table + &self.counts() + "\n"
    }

    /// One line: how many files, and what became of them.
    fn counts(&self) -> String {
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

    /// The page, which stands in `folder`.
    pub(crate) fn html(&self, folder: &Path) -> String {
        let mut rows = String::new();
        for row in &self.rows {
            push_row(&mut rows, row, folder);
        }
        let titles: String = TITLES.iter().map(|t| format!("<th>{t}</th>")).collect();
        PlainPage {
            title: TITLE,
            lead: vec![
                format!("{}.", escape(&self.counts())),
                "Missing and filled are positions: points times frames. A file's name leads to a \
                 page that plays the take, where there is something to see; its result's word \
                 leads to the record, a JSON file beside the result that says what it was made \
                 from, what was found, and how each gap was filled."
                    .to_string(),
            ],
            main: format!(
                "<section><div class=\"wide\"><table class=\"files\">\n\
                <tr>{titles}</tr>\n\
                {rows}</table></div></section>"
            ),
            style: STYLE,
            command: "clean",
            data: "",
        }
        .html()
    }
}

/// The cells of a file, as [`TITLES`] has them.
fn cells(row: &Row) -> Vec<String> {
    let mut out = vec![row.name.replace(char::is_control, "\u{fffd}")];
    match row.outcome.summary() {
        Some(s) => {
            let became = match (s.denoised, s.noise_stays) {
                (true, _) => " removed",
                (_, true) => " stays",
                _ => "",
            };
            out.push(s.format.clone());
            out.extend(
                [s.frames, s.points, s.missing, s.filled, s.outliers].map(|n| n.to_string()),
            );
            out.push(match s.noise_deg {
                Some(noise) => format!("{noise:.2} deg{became}"),
                None => format!("{:.2}{became}", s.noise),
            });
        }
        None => out.extend(std::iter::repeat_n(String::new(), TITLES.len() - 2)),
    }
    out.push(match &row.outcome {
        FileOutcome::Failed {
            old_result: true, ..
        } => "failed, old result stays".to_string(),
        outcome => outcome.word().to_string(),
    });
    out
}

fn push_row(out: &mut String, row: &Row, folder: &Path) {
    let class = match row.outcome.summary() {
        None => "failed",
        Some(s) if !s.findings.is_empty() => "found",
        Some(_) => "fine",
    };
    let _ = write!(out, "<tr class=\"{class}\">");
    let link = |path: PathBuf| href(folder, &path);
    let (page, record) = (row.page().map(link), row.record().map(link));
    for (i, cell) in cells(row).iter().enumerate() {
        let tag = if i == 0 { "th" } else { "td" };
        let to = match i {
            0 => &page,
            i if i + 1 == TITLES.len() => &record,
            _ => &None,
        };
        let text = escape(cell);
        let _ = match to {
            Some(to) => write!(out, "<{tag}><a href=\"{to}\">{text}</a></{tag}>"),
            None => write!(out, "<{tag}>{text}</{tag}>"),
        };
    }
    *out += "</tr>\n";
    let item = |line: &String| format!("<li>{}</li>", escape(line));
    let more = match &row.outcome {
        FileOutcome::Failed { error, .. } => item(&error.to_string()),
        FileOutcome::Cleaned(s) | FileOutcome::Unchanged(s) => {
            let notes = s.notes.iter();
            let notes = notes.map(|n| format!("<li class=\"note\">{}</li>", escape(n)));
            let findings: String = s.findings.iter().map(item).collect();
            let places = page.as_ref().map(|page| places(&s.places, page));
            findings + &places.unwrap_or_default() + &notes.collect::<String>()
        }
    };
    if !more.is_empty() {
        let _ = writeln!(
            out,
            "<tr class=\"{class} more\"><td colspan=\"{}\"><ul>{more}</ul></td></tr>",
            TITLES.len()
        );
    }
}

/// Links to the places of a take on its page.
fn places(places: &[PlaceToSee], page: &str) -> String {
    let link = |place: &PlaceToSee| {
        let (point, trail) = match &place.point {
            Some(point) => (
                format!("{point}, "),
                format!("&amp;trail={}", encoded(point)),
            ),
            None => Default::default(),
        };
        let text = format!("{point}frame {}: {}", place.frame, place.what);
        format!(
            "<a href=\"{page}#frame={}{trail}\">{}</a>",
            place.frame,
            escape(&text)
        )
    };
    match places {
        [] => String::new(),
        places => {
            let all: Vec<String> = places.iter().map(link).collect();
            format!("<li class=\"places\">{}</li>", all.join("; "))
        }
    }
}
