//! What became of many files: a table for the terminal, and one page.

use super::one_file::Fate;
use super::record::Summary;
use crate::Error;
use crate::cli::messages;
use crate::evaluate::html::escape;
use crate::evaluate::plain_page::PlainPage;
use crate::evaluate::text_table::aligned;
use std::fmt::Write;
use std::path::Path;

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

/// Whether a file is a page that [`CleanReport::html`] made.
pub fn is_page(path: &Path) -> bool {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.contains(&format!("<title>{TITLE}</title>"))
}

/// The files and what became of them.
pub struct CleanReport<'a> {
    rows: Vec<(String, &'a Fate)>,
    left_out: usize,
}

impl<'a> CleanReport<'a> {
    /// The report of files by their names and their `fates`; `left_out` files of folders are none of motion.
    pub fn new(names: Vec<String>, fates: &'a [Fate], left_out: usize) -> CleanReport<'a> {
        CleanReport {
            rows: names.into_iter().zip(fates).collect(),
            left_out,
        }
    }

    /// Whether somebody has to look at a file.
    pub fn has_findings(&self) -> bool {
        self.rows.iter().any(|(_, fate)| match fate.summary() {
            Some(summary) => !summary.findings.is_empty(),
            None => true,
        })
    }

    /// An error line for each file that could not be cleaned.
    pub fn tell_failures(&self) {
        for (_, fate) in &self.rows {
            if let Fate::Failed { error, .. } = fate {
                messages::error(&error.to_string());
            }
        }
    }

    /// The table, each file's findings below it, and a line that counts.
    pub fn text(&self) -> String {
        let mut rows = vec![TITLES.map(String::from).to_vec()];
        for (name, fate) in &self.rows {
            rows.push(cells(name, fate));
            let findings = fate.summary().map_or(&[][..], |s| &s.findings);
            rows.extend(findings.iter().take(SHOWN).map(|f| vec![format!("  {f}")]));
            if findings.len() > SHOWN {
                rows.push(vec![format!("  and {} more", findings.len() - SHOWN)]);
            }
        }
        aligned(&rows) + &self.counts() + "\n"
    }

    /// One line: how many files, and what became of them.
    fn counts(&self) -> String {
        let count = |is: fn(&Fate) -> bool| self.rows.iter().filter(|r| is(r.1)).count();
        let cleaned = count(|f| matches!(f, Fate::Cleaned(_)));
        let unchanged = count(|f| matches!(f, Fate::Unchanged(_)));
        let failed = count(|f| matches!(f, Fate::Failed { .. }));
        let found = count(|f| f.summary().is_some_and(|s| !s.findings.is_empty()));
        let files = if self.rows.len() == 1 {
            "file"
        } else {
            "files"
        };
        let mut line = format!(
            "{} {files}: {cleaned} cleaned, {unchanged} unchanged since the last run, {failed} failed; findings in {found}",
            self.rows.len()
        );
        if self.left_out > 0 {
            let _ = write!(
                line,
                "; left out, as none of motion or results: {}",
                self.left_out
            );
        }
        line
    }

    /// The page.
    pub fn html(&self) -> String {
        let mut rows = String::new();
        for (name, fate) in &self.rows {
            push_row(&mut rows, name, fate);
        }
        let titles: String = TITLES.iter().map(|t| format!("<th>{t}</th>")).collect();
        PlainPage {
            title: TITLE,
            lead: vec![
                format!("{}.", escape(&self.counts())),
                "Missing and filled are positions: points times frames. A JSON file beside each result says what it was made from, what was found, and how each gap was filled.".to_string(),
            ],
            main: format!(
                "<section><div class=\"wide\"><table class=\"files\">\n<tr>{titles}</tr>\n{rows}</table></div></section>"
            ),
            style: STYLE,
            command: "clean",
            data: "",
        }
        .html()
    }
}

impl Fate {
    /// What became of the file, unless it failed.
    pub fn summary(&self) -> Option<&Summary> {
        match self {
            Fate::Cleaned(summary) | Fate::Unchanged(summary) => Some(summary),
            Fate::Failed { .. } => None,
        }
    }

    /// Why the file could not be cleaned.
    pub fn into_error(self) -> Option<Error> {
        match self {
            Fate::Failed { error, .. } => Some(error),
            Fate::Cleaned(_) | Fate::Unchanged(_) => None,
        }
    }

    fn word(&self) -> &'static str {
        match self {
            Fate::Cleaned(_) => "cleaned",
            Fate::Unchanged(_) => "unchanged",
            Fate::Failed {
                old_result: true, ..
            } => "failed, old result stays",
            Fate::Failed { .. } => "failed",
        }
    }
}

/// The cells of a file, as [`TITLES`] has them.
fn cells(name: &str, fate: &Fate) -> Vec<String> {
    let mut row = vec![name.replace(char::is_control, "\u{fffd}")];
    match fate.summary() {
        Some(s) => {
            let noise = format!("{:.2}{}", s.noise, if s.denoised { " removed" } else { "" });
            row.push(s.format.clone());
            row.extend(
                [s.frames, s.points, s.missing, s.filled, s.outliers].map(|n| n.to_string()),
            );
            row.push(noise);
        }
        None => row.extend(std::iter::repeat_n(String::new(), TITLES.len() - 2)),
    }
    row.push(fate.word().to_string());
    row
}

fn push_row(out: &mut String, name: &str, fate: &Fate) {
    let class = match fate.summary() {
        None => "failed",
        Some(s) if !s.findings.is_empty() => "found",
        Some(_) => "fine",
    };
    let _ = write!(out, "<tr class=\"{class}\">");
    for (i, cell) in cells(name, fate).iter().enumerate() {
        let tag = if i == 0 { "th" } else { "td" };
        let _ = write!(out, "<{tag}>{}</{tag}>", escape(cell));
    }
    *out += "</tr>\n";
    let list = |lines: &[String]| -> String {
        let item = |line: &String| format!("<li>{}</li>", escape(line));
        lines.iter().map(item).collect()
    };
    let more = match fate {
        Fate::Failed { error, .. } => list(&[error.to_string()]),
        Fate::Cleaned(s) | Fate::Unchanged(s) => {
            let notes = s
                .notes
                .iter()
                .map(|n| format!("<li class=\"note\">{}</li>", escape(n)));
            list(&s.findings) + &notes.collect::<String>()
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
