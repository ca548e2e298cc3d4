//! The output of commands: files that appear when complete, or standard output.

use super::args::OutputArgs;
use super::closed_stdout::open_stdout;
use super::endings::ending;
use super::messages;
use super::paths::OutputPath;
use crate::io::csv::AddedColumn;
use crate::io::output::{drop_waiting, file_descriptor, publish_waiting};
use crate::io::unit_writer::UnitWriter;
use crate::io::{Columns, NewTake, Output, Table, TableFormat};
use crate::pose::Poses;
use crate::pose::units::Units;
use crate::{Error, Result};
use std::io::{self, BufWriter, IsTerminal};
use std::path::Path;

/// Does some work and then puts the files at their paths that it opened by [`open_output`]: all, or
/// none where it fails. A reader of standard output that went away is no failure.
///
/// # Errors
/// Those of the work; a file cannot be put at its path.
pub fn together<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    let done = work();
    match &done {
        Err(e) if !e.is_closed_pipe() => drop_waiting(),
        _ => publish_waiting()?,
    }
    done
}

/// Opens a file, or standard output without a path or for `-`. Binary is never written to a
/// terminal. The file appears when the command is done: see [`together`].
pub fn open_output(path: Option<&Path>, binary: bool) -> Result<Output> {
    match path {
        Some(path) if path != Path::new("-") && file_descriptor(path) != Some(1) => {
            Output::file(path).map(Output::waiting)
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

/// Starts a table with the columns `columns` and `added`; `units` are those of cells that were read
/// and those of the output.
pub fn create_table(
    args: &OutputArgs,
    units: [Units; 2],
    columns: &Columns,
    added: &[AddedColumn],
) -> Result<UnitWriter> {
    let format = args.format();
    format.check_added(added)?;
    if format == TableFormat::Npy {
        let lost = columns.lost_in_array();
        lost.iter().for_each(|what| messages::info(what));
    }
    let output = open_output(args.output.as_deref(), format != TableFormat::Csv)?;
    UnitWriter::new(output, format, units, columns, added)
}

/// Writes a whole table with the coordinates `xyz` (frames, 3 J); `cells` gives the added cells of
/// a frame. See [`create_table`].
pub fn write_table(
    args: &OutputArgs,
    units: [Units; 2],
    table: &Table,
    xyz: ndarray::ArrayView2<'_, f64>,
    added: &[AddedColumn],
    cells: impl FnMut(usize) -> Vec<String>,
) -> Result<()> {
    create_table(args, units, &table.columns, added)?.write_table(table, xyz, cells)
}

/// Writes the points of a take (centimeters, y up) as its path's ending says: C3D or TRC, in the
/// second units, else a table, in the first ones.
pub fn write_points(
    output: Option<&OutputPath>,
    poses: Poses,
    rate: f64,
    [of_table, of_take]: [Units; 2],
) -> Result<()> {
    let path = output.map(|path| &**path);
    match path.and_then(ending).as_deref() {
        Some("c3d") => write_bytes(path, &NewTake::new(poses, rate, of_take).c3d()?, true),
        Some("trc") => write_bytes(path, &NewTake::new(poses, rate, of_take).trc()?, false),
        _ => {
            let (table, to) = (Table::from_poses(poses), None);
            let output = output.cloned();
            let xyz = table.poses.xyz.view();
            let units = [Units::CM_Y, of_table];
            write_table(&OutputArgs { output, to }, units, &table, xyz, &[], |_| {
                Vec::new()
            })
        }
    }
}
