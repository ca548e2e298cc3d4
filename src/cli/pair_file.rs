//! Small CSV files of two columns, such as `vertex,part` and `point,vertex`.

use super::csv_file::CsvFile;
use crate::io::text::excerpt;
use crate::{Error, Place, Result};
use std::path::Path;

/// The rows of a file of two columns.
#[derive(Debug, Clone)]
pub struct PairFile {
    /// Where it came from.
    pub name: String,
    /// The line and the two cells of each row.
    pub rows: Vec<(u64, String, String)>,
}

impl PairFile {
    /// Reads the columns `columns` of a CSV file with a header line; others are ignored.
    ///
    /// # Errors
    /// [`Error::Data`], with the line: the file cannot be read, or a column is missing.
    pub fn read(path: &Path, columns: [&str; 2]) -> Result<PairFile> {
        let (name, rows) = read_columns(path, columns)?;
        let rows = (rows.into_iter())
            .map(|(line, [a, b])| (line, a, b))
            .collect();
        Ok(PairFile { name, rows })
    }

    /// A whole number below `count` from a cell of a row; `what` names it.
    ///
    /// # Errors
    /// [`Error::Data`], with the line: no whole number, or too large.
    pub fn index(&self, line: u64, cell: &str, what: &str, count: usize) -> Result<usize> {
        whole_number(&self.name, line, cell, what, count)
    }
}

/// The line and the cells of each row of a file.
type Rows<const N: usize> = Vec<(u64, [String; N])>;

/// The name of a CSV file with a header line, and the line and the cells `columns` of each row.
///
/// # Errors
/// Those of [`PairFile::read`].
pub(crate) fn read_columns<const N: usize>(
    path: &Path,
    columns: [&str; N],
) -> Result<(String, Rows<N>)> {
    let mut file = CsvFile::open(path)?;
    let mut at = [0; N];
    for (at, column) in at.iter_mut().zip(columns) {
        *at = file.needed(column, &columns.join(","))?;
    }
    let mut rows = Vec::new();
    for row in file.rows() {
        let (line, row) = row?;
        rows.push((line, at.map(|c| row[c].to_string())));
    }
    if rows.is_empty() {
        return Err(Error::data(Place::file(&file.name), "has no rows"));
    }
    Ok((file.name, rows))
}

/// A whole number below `count` from a cell of line `line` of the file `name`; `what` names it.
///
/// # Errors
/// [`Error::Data`], with the line: no whole number, or too large.
pub(crate) fn whole_number(
    name: &str,
    line: u64,
    cell: &str,
    what: &str,
    count: usize,
) -> Result<usize> {
    let wrong = |why: String| Error::data(Place::line(name, line), why);
    let value: usize = cell.parse().map_err(|_| {
        let cell = excerpt(cell);
        wrong(format!(
            "expected a {what} counted from 0, found \"{cell}\""
        ))
    })?;
    if value < count {
        Ok(value)
    } else {
        Err(wrong(format!(
            "names {what} {value}, there are {count} (counted from 0)"
        )))
    }
}
