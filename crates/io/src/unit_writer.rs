//! Pose tables in another unit, or with another axis up, than centimeters and y.

use super::columns::Columns;
use super::csv::{AddedColumn, After};
use super::output::{CompleteOutput, Output};
use super::row::Row;
use super::table::Table;
use super::table_writer::{TableFormat, TableWriter};
use super::text::{MAX_COORDINATE, significant};
use crate::pose::Units;
use crate::{Error, Place, Result};
use ndarray::ArrayView2;

/// A table that is being written, from frames in centimeters, y up.
pub struct UnitWriter {
    writer: TableWriter,
    units: Units,
    /// Whether the cells that were read are of another unit or axis.
    converted: bool,
    /// The columns of standard deviations that were read in another unit.
    deviations: Vec<usize>,
    /// The factor that converts them.
    scale: f64,
}

impl UnitWriter {
    /// Starts a table with the columns `columns` and `added`; of the units `[read, written]` the
    /// first are those of the cells that were read.
    ///
    /// # Errors
    /// Those of [`TableWriter::new`].
    #[doc(hidden)]
    pub fn new(
        output: Output,
        format: TableFormat,
        [read, written]: [Units; 2],
        columns: &Columns,
        added: &[AddedColumn],
    ) -> Result<UnitWriter> {
        let is_point = |name: &str| columns.points.iter().any(|p| p == name);
        let is_deviation = |name: &str| {
            name.strip_suffix(".sd").is_some_and(is_point) && added.iter().all(|a| a.name != name)
        };
        let mut added = added.to_vec();
        let mut deviations = Vec::new();
        if written.unit != read.unit && format != TableFormat::Npy {
            let all = 0..columns.names.len();
            deviations.extend(all.filter(|&i| is_deviation(&columns.names[i])));
            let replaced = deviations.iter().map(|&i| columns.names[i].as_str());
            added.extend(replaced.map(|name| AddedColumn::new(name, After::All)));
        }
        Ok(UnitWriter {
            writer: TableWriter::new(output, format, columns, &added)?,
            units: written,
            converted: written != read,
            deviations,
            scale: written.length(read.unit.centimeters()),
        })
    }

    /// Writes a frame: `row` as it was read, `xyz` its new coordinates (three per point,
    /// centimeters, y up), `added` the cells of the added columns.
    ///
    /// # Errors
    /// [`Error::Data`]: a coordinate that only damage can give. [`Error::Io`]: writing fails.
    pub fn write(&mut self, row: &mut Row, xyz: &[f64], added: &[String]) -> Result<()> {
        if let Some(far) = xyz.iter().find(|v| v.abs() > MAX_COORDINATE) {
            let what =
                format!("a coordinate would be {far:e} cm: the model or the input is damaged");
            return Err(Error::data(Place::file("the result"), what));
        }
        if self.units == Units::CM_Y && !self.converted {
            return self.writer.write(row, xyz, added);
        }
        let mut xyz = xyz.to_vec();
        self.units.write(&mut xyz);
        self.units.write(&mut row.xyz);
        row.converted = self.converted;
        let mut added = added.to_vec();
        for &column in &self.deviations {
            let cell = row.cells.get(column).unwrap_or_default();
            let text = String::from_utf8_lossy(cell);
            added.push(match text.trim().parse::<f64>() {
                Ok(sd) => significant(sd * self.scale),
                Err(_) => text.into_owned(),
            });
        }
        self.writer.write(row, &xyz, &added)
    }

    /// Writes a whole table with the coordinates `xyz` (frames, 3 P); `cells` gives the added cells
    /// of a frame.
    ///
    /// # Errors
    /// Those of [`UnitWriter::write`].
    #[doc(hidden)]
    pub fn write_table(
        mut self,
        table: &Table,
        xyz: ArrayView2<'_, f64>,
        mut cells: impl FnMut(usize) -> Vec<String>,
    ) -> Result<()> {
        let (mut row, mut numbers) = (Row::default(), Vec::new());
        for i in 0..table.poses.frames() {
            table.row_into(i, &mut row);
            numbers.clear();
            numbers.extend(xyz.row(i));
            self.write(&mut row, &numbers, &cells(i))?;
        }
        self.finish()
    }

    /// Writes the last rows and completes the table.
    pub fn finish(self) -> Result<()> {
        self.writer.finish()
    }

    /// Writes the last rows; a file is not yet at its path.
    pub fn complete(self) -> Result<CompleteOutput> {
        self.writer.complete()
    }
}
