//! Reads pose tables row by row, CSV or NPY.

use super::columns::Columns;
use super::csv::CsvReader;
use super::input::{ContentKind, Input};
use super::motion_format::recognized;
use super::npy::NpyReader;
use super::row::{ReadOptions, Row};
use crate::{Error, Place, Result};

/// Rows of a table of either format, one at a time.
pub enum RowReader {
    /// Text.
    Csv(Box<CsvReader>),
    /// NumPy's array.
    Npy(Box<NpyReader>),
}

impl RowReader {
    /// Recognises the format by content and reads the header.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: no table; the place has the line.
    pub fn new(input: Input, options: &ReadOptions) -> Result<RowReader> {
        match input.kind() {
            ContentKind::Npy => NpyReader::new(input, options).map(|r| RowReader::Npy(Box::new(r))),
            ContentKind::Text => {
                if let Some(what) = recognized(input.first_bytes()) {
                    return Err(Error::data(Place::file(input.name), what));
                }
                CsvReader::new(input, options).map(|r| RowReader::Csv(Box::new(r)))
            }
            ContentKind::Empty => Err(Error::data(
                Place::file(input.name),
                "is empty, expected a pose table",
            )),
            ContentKind::Npz => {
                let what = "is an NPZ archive (a model?), expected a pose table as CSV or NPY";
                Err(Error::data(Place::file(input.name), what))
            }
        }
    }
    /// What the columns mean.
    pub fn columns(&self) -> &Columns {
        match self {
            RowReader::Csv(r) => &r.columns,
            RowReader::Npy(r) => &r.columns,
        }
    }
    /// Reads the next frame; `false` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: a bad row; the place has the line and the column.
    pub fn read(&mut self, row: &mut Row) -> Result<bool> {
        match self {
            RowReader::Csv(r) => r.read(row),
            RowReader::Npy(r) => r.read(row),
        }
    }
    /// The name that messages use.
    pub fn name(&self) -> &str {
        match self {
            RowReader::Csv(r) => &r.name,
            RowReader::Npy(r) => &r.name,
        }
    }
}
