//! The first lines of a TRC file. Programs part their cells by tabs, blanks or commas, in any
//! number.

use crate::marker_rows::{Stated, is_missing};
use crate::point_titles::points_of;
use crate::text::{Lines, decimal, excerpt};
use crate::{Error, Result};
use std::io::BufRead;

/// What the header says.
pub(crate) struct Header {
    /// What it says beside the rows.
    pub stated: Stated,
    /// Whether commas part the cells.
    pub has_commas: bool,
}

impl Header {
    /// Reads the lines behind the first, `PathFileType`: keys, values, names.
    ///
    /// # Errors
    /// [`Error::Data`]: the file ends within them, or the third has no Frame# and Time.
    pub(crate) fn read(lines: &mut Lines<impl BufRead>) -> Result<Header> {
        let keys = next_line(lines)?;
        let values = next_line(lines)?;
        let titles = next_line(lines)?;
        let value = |key: &str| value(&keys, &values, key);
        let number = |key: &str| decimal(&value(key)?).parse::<f64>().ok();
        let markers = number("NumMarkers");
        let has_commas = !titles.contains('\t') && titles.contains(',');
        let Some(labels) = labels(titles.trim_start_matches('\t'), has_commas, markers) else {
            let found = excerpt(titles.replace('\t', " ").trim());
            let what = format!("expected Frame#, Time and the names of markers, found \"{found}\"");
            return Err(Error::data(lines.here(), what));
        };
        // Some files name each column.
        let labels = if markers == Some(labels.len() as f64) {
            labels
        } else {
            points_of(&labels).unwrap_or(labels)
        };
        let mut notes = Vec::new();
        if let Some(markers) = markers.filter(|&n| n < labels.len() as f64) {
            notes.push(format!(
                "announces {markers} markers but names {}",
                labels.len()
            ));
        }
        let stated = Stated {
            labels,
            frames: number("NumFrames").map(|n| n as usize),
            rate: number("DataRate").filter(|r| r.is_finite() && *r > 0.0),
            units: value("Units").map(|unit| excerpt(&unit)),
            has_times: true,
            rows_count: true,
            notes,
            ..Stated::default()
        };
        Ok(Header { stated, has_commas })
    }
}

/// The next line that is not blank.
fn next_line(lines: &mut Lines<impl BufRead>) -> Result<String> {
    let line = lines.next_filled(char::is_whitespace)?.map(str::to_string);
    line.ok_or_else(|| {
        let what = "the file ends within its header, before the names of its markers";
        Error::data(lines.here(), what)
    })
}

/// The words of a line, whatever parts them.
pub(crate) fn words(line: &str) -> Vec<&str> {
    // Between digits with tabs beside them, a comma stands before decimals.
    let is_decimal = line.contains('\t');
    let parts = |c: char| c.is_whitespace() || c == ',' && !is_decimal;
    line.split(parts).filter(|word| !word.is_empty()).collect()
}

/// The value of a key: that below it, by number, where each key has one; else by cells.
fn value(keys: &str, values: &str, key: &str) -> Option<String> {
    let is_key = |word: &&str| word.trim().eq_ignore_ascii_case(key);
    let (all, below) = (words(keys), words(values));
    let found = if all.len() == below.len() || !values.contains(['\t', ',']) {
        below.get(all.iter().position(&is_key)?).copied()
    } else {
        let separator = if values.contains('\t') { '\t' } else { ',' };
        let at = keys.split(separator).position(|k| is_key(&k))?;
        values.split(separator).nth(at)
    };
    let found = found.map(str::trim).filter(|v| !is_missing(v))?;
    Some(found.to_string())
}

/// The names of the markers behind Frame# and Time; `None` without these. Every third cell has a
/// name, but in some files each.
fn labels(line: &str, has_commas: bool, markers: Option<f64>) -> Option<Vec<String>> {
    let begins = |word: &str, with: &str| {
        let start = word.trim().get(..with.len());
        start.is_some_and(|s| s.eq_ignore_ascii_case(with))
    };
    let separator = if has_commas { ',' } else { '\t' };
    let cells: Vec<&str> = line.split(separator).map(str::trim).collect();
    let by_cells = match &cells[..] {
        [frame, time, rest @ ..] if begins(frame, "Frame") && begins(time, "Time") => names(rest),
        _ => Vec::new(),
    };
    let words = words(line);
    let time = words.iter().position(|word| begins(word, "Time"))?;
    // "Frame#", "Frame", "Frame #".
    if time == 0 || time > 2 || !begins(words[0], "Frame") {
        return None;
    }
    let by_words = &words[time + 1..];
    let is_told = |count: usize| markers == Some(count as f64);
    if !by_cells.is_empty() && (is_told(by_cells.len()) || !is_told(by_words.len())) {
        return Some(by_cells);
    }
    if line.contains('\t') && !is_told(by_words.len()) {
        // Names may have blanks; two tabs may part the cells.
        let rest = cells
            .iter()
            .skip_while(|cell| !begins(cell, "Time"))
            .skip(1);
        let named: Vec<String> = rest
            .filter(|c| !c.is_empty())
            .map(|c| c.to_string())
            .collect();
        if !named.is_empty() {
            return Some(named);
        }
    }
    Some(by_words.iter().map(|word| word.to_string()).collect())
}

/// The names of the cells above the columns of points.
fn names(cells: &[&str]) -> Vec<String> {
    let mut titles = cells.iter().enumerate();
    let is_spread = titles.all(|(i, title)| i % 3 == 0 || title.is_empty());
    let step = if is_spread { 3 } else { 1 };
    let mut names: Vec<String> = cells.iter().step_by(step).map(|c| c.to_string()).collect();
    if !is_spread {
        names.retain(|name| !name.is_empty());
    }
    while names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    names
}
