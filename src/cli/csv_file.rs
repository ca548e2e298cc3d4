//! Small CSV files with a header line.

use super::input;
use crate::io::csv::csv_fault;
use crate::{Error, Place, Result};
use csv::StringRecord;
use std::io::BufRead;
use std::path::Path;

/// A CSV file with a header line; blanks about its cells do not count.
pub(crate) struct CsvFile {
    /// Where it came from.
    pub name: String,
    /// The titles of its columns.
    pub head: StringRecord,
    reader: csv::Reader<Box<dyn BufRead>>,
}

impl CsvFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`Error::Data`]: it cannot be read.
    pub fn open(path: &Path) -> Result<CsvFile> {
        let file = input::open(path)?;
        let name = file.name.clone();
        let mut builder = csv::ReaderBuilder::new();
        let mut reader = builder.trim(csv::Trim::All).from_reader(file.into_reader());
        let head = reader
            .headers()
            .cloned()
            .map_err(|e| csv_fault(&name, &e))?;
        Ok(CsvFile { name, head, reader })
    }

    /// The column of a title.
    pub(crate) fn column(&self, title: &str) -> Option<usize> {
        self.head.iter().position(|h| h == title)
    }

    /// The column of a title; `expected` are the titles that a file has.
    ///
    /// # Errors
    /// [`Error::Data`]: there is none.
    pub(crate) fn needed(&self, title: &str, expected: &str) -> Result<usize> {
        self.column(title).ok_or_else(|| {
            let what = format!("has no column {title}; expected {expected}");
            Error::data(Place::line(&self.name, 1), what)
        })
    }

    /// The rows, each with its line.
    pub(crate) fn rows(&mut self) -> impl Iterator<Item = Result<(u64, StringRecord)>> {
        let name = &self.name;
        self.reader.records().enumerate().map(move |(k, row)| {
            let row = row.map_err(|e| csv_fault(name, &e))?;
            let line = row.position().map_or(k as u64 + 2, csv::Position::line);
            Ok((line, row))
        })
    }
}
