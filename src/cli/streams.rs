//! The output of commands: files that appear when complete, or standard output.

use super::args::OutputArgs;
use super::closed_stdout::open_stdout;
use super::messages;
use super::units::TableUnits;
use crate::io::csv::{AddedColumn, After};
use crate::io::output::{CompleteOutput, file_descriptor};
use crate::io::text::{MAX_COORDINATE, push_f64};
use crate::io::{Columns, Row, Table};
use crate::io::{Output, TableFormat, TableWriter};
use crate::{Error, Place, Result};
use std::io::{self, BufWriter, IsTerminal};
use std::path::Path;

/// Opens a file, or standard output without a path or for `-`. Binary is never written to a terminal.
pub fn open_output(path: Option<&Path>, binary: bool) -> Result<Output> {
    match path {
        Some(path) if path != Path::new("-") && file_descriptor(path) != Some(1) => {
            Output::file(path)
        }
        _ if binary && io::stdout().is_terminal() => Err(Error::usage(
            "will not write binary output to a terminal; use -o FILE or a pipe",
        )),
        _ => Ok(Output::stream(
            "standard output",
            BufWriter::with_capacity(1 << 16, open_stdout()?),
        )),
    }
}

/// Writes bytes to a file or standard output.
pub fn write_bytes(path: Option<&Path>, bytes: &[u8], binary: bool) -> Result<()> {
    let mut output = open_output(path, binary)?;
    output.write(bytes)?;
    output.finish()
}

/// A table that is being written, from frames in centimetres, y up.
pub struct TableSink {
    writer: TableWriter,
    units: TableUnits,
    /// Whether the cells that were read are of another unit or axis.
    converted: bool,
    /// The columns of standard deviations that were read in another unit.
    deviations: Vec<usize>,
    /// The factor that converts them.
    scale: f64,
}

/// Starts a table with the columns `columns` and `added`; cells that were read are of the units `input`.
pub fn create_table(
    args: &OutputArgs,
    input: TableUnits,
    columns: &Columns,
    added: &[AddedColumn],
) -> Result<TableSink> {
    let format = args.format();
    format.check_added(added)?;
    if format == TableFormat::Npy {
        tell_lost_columns(columns);
    }
    let output = open_output(args.output.as_deref(), format == TableFormat::Npy)?;
    let units = args.table_units(input);
    let is_point = |name: &str| columns.points.iter().any(|p| p == name);
    let is_deviation = |name: &str| {
        name.strip_suffix(".sd").is_some_and(is_point) && added.iter().all(|a| a.name != name)
    };
    let mut added = added.to_vec();
    let mut deviations = Vec::new();
    if units.unit != input.unit && format == TableFormat::Csv {
        deviations.extend((0..columns.names.len()).filter(|&i| is_deviation(&columns.names[i])));
        let replaced = deviations.iter().map(|&i| columns.names[i].as_str());
        added.extend(replaced.map(|name| AddedColumn::new(name, After::All)));
    }
    Ok(TableSink {
        writer: TableWriter::new(output, format, columns, &added)?,
        units,
        converted: units != input,
        deviations,
        scale: units.length(input.unit.centimetres()),
    })
}

impl TableSink {
    /// Writes a frame: `row` as it was read, `xyz` its new coordinates (three a point, centimetres, y up), `added` the cells of
    /// the added columns.
    ///
    /// # Errors
    /// [`Error::Data`]: a coordinate that only damage can give. [`Error::Io`]: writing fails.
    pub fn write(&mut self, row: &mut Row, xyz: &[f64], added: &[String]) -> Result<()> {
        if let Some(far) = xyz.iter().find(|v| v.abs() > MAX_COORDINATE) {
            let what =
                format!("a coordinate would be {far:e} cm: the model or the input is damaged");
            return Err(Error::data(Place::file("the result"), what));
        }
        if self.units == TableUnits::CM_Y && !self.converted {
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

    /// Writes the last rows and completes the table.
    pub fn finish(self) -> Result<()> {
        self.writer.finish()
    }

    /// Writes the last rows; a file is not yet at its path.
    pub fn complete(self) -> Result<CompleteOutput> {
        self.writer.complete()
    }
}

/// Says which columns an array does not hold.
fn tell_lost_columns(columns: &Columns) {
    let points = columns.coordinates.iter().flatten().flatten();
    let points: Vec<usize> = points.copied().collect();
    let lost = columns.names.iter().enumerate();
    let lost: Vec<&str> = lost
        .filter(|(i, _)| !points.contains(i))
        .map(|(_, name)| name.as_str())
        .collect();
    if !lost.is_empty() {
        let what = format!("NPY holds coordinates only: without {}", some_of(&lost));
        messages::info(&what);
    }
}

/// A list of names, the first of many.
fn some_of(names: &[&str]) -> String {
    match names {
        [some @ .., _] if some.len() >= 8 => {
            format!("{} and {} more", some[..8].join(", "), names.len() - 8)
        }
        _ => names.join(", "),
    }
}

/// A standard deviation with five significant figures: more is noise of the conversion.
pub fn significant(value: f64) -> String {
    let rounded = format!("{value:.4e}").parse().unwrap_or(value);
    let mut text = Vec::new();
    push_f64(&mut text, rounded);
    String::from_utf8(text).unwrap_or_default()
}

/// Writes a whole table with the coordinates `xyz` (frames, 3 J); `cells` gives the added cells of a frame. See [`create_table`].
pub fn write_table(
    args: &OutputArgs,
    input: TableUnits,
    table: &Table,
    xyz: ndarray::ArrayView2<'_, f64>,
    added: &[AddedColumn],
    mut cells: impl FnMut(usize) -> Vec<String>,
) -> Result<()> {
    let mut writer = create_table(args, input, &table.columns, added)?;
    let (mut row, mut numbers) = (Row::default(), Vec::new());
    for i in 0..table.poses.frames() {
        table.row_into(i, &mut row);
        numbers.clear();
        numbers.extend(xyz.row(i));
        writer.write(&mut row, &numbers, &cells(i))?;
    }
    writer.finish()
}
