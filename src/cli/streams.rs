//! The output of commands: files that appear when complete, or standard output.

use super::args::OutputArgs;
use crate::io::csv::AddedColumn;
use crate::io::output::file_descriptor;
use crate::io::{Columns, Row, Table};
use crate::io::{Output, TableFormat, TableWriter};
use crate::{Error, Result};
use std::io::{self, BufWriter, IsTerminal};
use std::path::Path;

/// Opens a file, or standard output without a path or for `-`. Binary is never written to a terminal.
pub fn open_output(path: Option<&Path>, binary: bool) -> Result<Output> {
    match path {
        Some(path) if path != Path::new("-") && file_descriptor(path) != Some(1) => {
            super::signals::watch();
            Output::file(path)
        }
        _ if binary && io::stdout().is_terminal() => Err(Error::usage(
            "will not write binary output to a terminal; use -o FILE or a pipe",
        )),
        _ => Ok(Output::stream(
            "standard output",
            BufWriter::with_capacity(1 << 16, io::stdout()),
        )),
    }
}

/// Writes bytes to a file or standard output.
pub fn write_bytes(path: Option<&Path>, bytes: &[u8], binary: bool) -> Result<()> {
    let mut output = open_output(path, binary)?;
    output.write(bytes)?;
    output.finish()
}

/// Starts a table with the columns `columns` and `added`.
pub fn create_table(
    args: &OutputArgs,
    columns: &Columns,
    added: &[AddedColumn],
) -> Result<TableWriter> {
    let format = args.format();
    format.check_added(added)?;
    let output = open_output(args.output.as_deref(), format == TableFormat::Npy)?;
    TableWriter::new(output, format, columns, added)
}

/// Writes a whole table with the coordinates `xyz` (frames, 3 J); `cells` gives the added cells of a frame.
pub fn write_table(
    args: &OutputArgs,
    table: &Table,
    xyz: ndarray::ArrayView2<'_, f64>,
    added: &[AddedColumn],
    mut cells: impl FnMut(usize) -> Vec<String>,
) -> Result<()> {
    let mut writer = create_table(args, &table.columns, added)?;
    let (mut row, mut numbers) = (Row::default(), Vec::new());
    for i in 0..table.poses.frames() {
        table.row_into(i, &mut row);
        numbers.clear();
        numbers.extend(xyz.row(i));
        writer.write(&row, &numbers, &cells(i))?;
    }
    writer.finish()
}
