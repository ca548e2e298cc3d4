//! Reads pose tables row by row: CSV, NPY, or positions in an NPZ archive.

use super::columns::Columns;
use super::csv::CsvReader;
use super::input::{ContentKind, Input};
use super::marker_take::MarkerTake;
use super::motion_format::recognized;
use super::npy::NpyReader;
use super::npz_entries::LARGEST;
use super::npz_take::NpzTake;
use super::row::{Row, TableOptions};
use super::table_archive;
use crate::{Error, Place, Result};
use std::io::Cursor;

/// Rows of a table of either format, one at a time.
pub enum RowReader {
    /// Text.
    Csv(Box<CsvReader>),
    /// NumPy's array.
    Npy(Box<NpyReader>),
    /// The positions of an archive of arrays.
    Npz(Box<TakeRows>),
}

/// The frames of a take in memory.
pub struct TakeRows {
    take: MarkerTake,
    columns: Columns,
    next: usize,
}

impl TakeRows {
    fn new(take: MarkerTake) -> TakeRows {
        TakeRows {
            columns: Columns::for_points(take.points.clone(), false, take.rate.is_some()),
            take,
            next: 0,
        }
    }

    fn read(&mut self, row: &mut Row) -> bool {
        *row = Row {
            xyz: std::mem::take(&mut row.xyz),
            time: self.take.rate.map(|rate| self.next as f64 / rate),
            ..Row::default()
        };
        row.xyz.clear();
        if self.next == self.take.xyz.nrows() {
            return false;
        }
        row.xyz.extend(self.take.xyz.row(self.next));
        self.next += 1;
        true
    }
}

impl RowReader {
    /// Recognizes the format by content and reads the header.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: no table; the place has the line.
    #[doc(hidden)]
    pub fn new(mut input: Input, options: &TableOptions) -> Result<RowReader> {
        match input.kind() {
            ContentKind::Npy => NpyReader::new(input, options).map(|r| RowReader::Npy(Box::new(r))),
            ContentKind::Text => {
                input.look_ahead()?;
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
                let name = input.name.clone();
                let archive = input.read_all(LARGEST)?;
                if options.joints.is_none()
                    && let Some(text) = table_archive::csv_of(&name, &archive)?
                {
                    let input = Input::new(name, Cursor::new(text))?;
                    return CsvReader::new(input, options).map(|r| RowReader::Csv(Box::new(r)));
                }
                let input = Input::new(name, Cursor::new(archive))?;
                let npz = NpzTake::read(input, options.joints.as_deref())?;
                Ok(RowReader::Npz(Box::new(TakeRows::new(npz.take))))
            }
        }
    }
    /// The take whose frames are read, where it may say its unit and its axis: of an archive.
    pub fn take(&self) -> Option<&MarkerTake> {
        match self {
            RowReader::Npz(rows) => Some(&rows.take),
            RowReader::Csv(_) | RowReader::Npy(_) => None,
        }
    }
    /// What the columns mean.
    #[doc(hidden)]
    pub fn columns(&self) -> &Columns {
        match self {
            RowReader::Csv(r) => &r.columns,
            RowReader::Npy(r) => &r.columns,
            RowReader::Npz(r) => &r.columns,
        }
    }
    /// Reads the next frame; `false` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: a bad row; the place has the line and the
    /// column.
    #[doc(hidden)]
    pub fn read(&mut self, row: &mut Row) -> Result<bool> {
        match self {
            RowReader::Csv(r) => r.read(row),
            RowReader::Npy(r) => r.read(row),
            RowReader::Npz(r) => Ok(r.read(row)),
        }
    }
    /// The name that messages use.
    #[doc(hidden)]
    pub fn name(&self) -> &str {
        match self {
            RowReader::Csv(r) => &r.name,
            RowReader::Npy(r) => &r.name,
            RowReader::Npz(r) => &r.take.name,
        }
    }
}
