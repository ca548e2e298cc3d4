//! What the commands write: files that appear when complete, standard output, tables on either.

use super::args::{Format, OutputArgs};
use super::arrays::ArraySink;
use super::printing::Printer;
use crate::io::csv::{After, CsvWriter};
use crate::io::output::{OutputFile, file_descriptor};
use crate::io::table::{Columns, Row, Table};
use crate::{Error, Result};
use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};

/// The name of standard output in messages.
const STDOUT: &str = "standard output";

/// A stream that is written to: a file that appears when it is complete, or standard output.
pub enum Sink {
    /// A file.
    File(OutputFile, PathBuf),
    /// Standard output.
    Stdout(Box<BufWriter<io::Stdout>>),
}

impl Sink {
    /// Opens the output; binary is never written to a terminal.
    pub fn open(path: Option<&Path>, binary: bool) -> Result<Sink> {
        match path {
            Some(path) if path != Path::new("-") && file_descriptor(path) != Some(1) => {
                super::signals::watch();
                Ok(Sink::File(OutputFile::create(path)?, path.to_path_buf()))
            }
            _ if binary && io::stdout().is_terminal() => Err(Error::usage(
                "binary output would go to the terminal; name a file with -o, or pipe it on",
            )),
            _ => Ok(Sink::Stdout(Box::new(BufWriter::with_capacity(
                1 << 16,
                io::stdout(),
            )))),
        }
    }
    /// Flushes, and lets a file appear.
    pub fn finish(self) -> Result<()> {
        match self {
            Sink::File(file, _) => file.finish(),
            Sink::Stdout(mut out) => out.flush().map_err(|e| Error::io(STDOUT, e)),
        }
    }
    /// An error of writing here.
    pub fn fail(&self, e: io::Error) -> Error {
        match self {
            Sink::File(_, path) => Error::io(path, e),
            Sink::Stdout(_) => Error::io(STDOUT, e),
        }
    }
    /// Writes what is left of a file, from kernel to kernel where the system can.
    pub fn copy(&mut self, file: &mut File) -> Result<()> {
        let done = match self {
            Sink::File(out, _) => io::copy(file, out),
            Sink::Stdout(out) => io::copy(file, &mut **out),
        };
        done.map(drop).map_err(|e| self.fail(e))
    }
    /// Writes everything, or says where it failed.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.write_all(bytes).map_err(|e| self.fail(e))
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Sink::File(f, _) => f.write(bytes),
            Sink::Stdout(f) => f.write(bytes),
        }
    }
    fn flush(&mut self) -> io::Result<()> {
        match self {
            Sink::File(f, _) => f.flush(),
            Sink::Stdout(f) => f.flush(),
        }
    }
}

/// Writes bytes to a file or standard output.
pub fn write_bytes(path: Option<&Path>, bytes: &[u8], binary: bool) -> Result<()> {
    let mut sink = Sink::open(path, binary)?;
    sink.put(bytes)?;
    sink.finish()
}

/// A table being written, in either format.
pub enum TableSink {
    /// Text.
    Csv(Printer),
    /// NumPy's array.
    Npy(ArraySink),
}

impl TableSink {
    /// Starts a table such as `columns` with `added` columns (which an array cannot carry).
    pub fn create(
        flags: &OutputArgs,
        columns: &Columns,
        added: &[(String, After)],
    ) -> Result<TableSink> {
        let binary = flags.format() == Format::Npy;
        fits(flags, added)?;
        let sink = Sink::open(flags.output.as_deref(), binary)?;
        if binary {
            return Ok(TableSink::Npy(ArraySink::new(sink, columns.width())?));
        }
        Ok(TableSink::Csv(Printer::new(
            sink,
            CsvWriter::new(columns, added),
        )?))
    }

    /// Writes a frame: see [`CsvWriter::push_row`].
    pub fn write(&mut self, row: &Row, xyz: &[f64], added: &[String]) -> Result<()> {
        match self {
            TableSink::Csv(printer) => printer.write(row, xyz, added),
            TableSink::Npy(array) => array.write(xyz),
        }
    }

    /// Completes the table.
    pub fn finish(self) -> Result<()> {
        match self {
            TableSink::Csv(printer) => printer.finish(),
            TableSink::Npy(array) => array.finish(),
        }
    }
}

/// Refuses an output that has no room for added columns.
pub fn fits(flags: &OutputArgs, added: &[(String, After)]) -> Result<()> {
    match (flags.format(), added.first()) {
        (Format::Npy, Some((lost, _))) => Err(Error::usage(format!(
            "an array (NPY) holds coordinates alone: the column {lost} would be lost; write CSV"
        ))),
        _ => Ok(()),
    }
}

/// Writes a whole table whose numbers became `xyz`; `added` gives each frame's added cells.
pub fn write_table(
    flags: &OutputArgs,
    table: &Table,
    xyz: ndarray::ArrayView2<'_, f64>,
    added: &[(String, After)],
    mut cells: impl FnMut(usize) -> Vec<String>,
) -> Result<()> {
    let mut sink = TableSink::create(flags, &table.columns, added)?;
    let poses = &table.poses;
    let mut row = Row::default();
    let mut numbers = Vec::new();
    for i in 0..poses.frames() {
        row.xyz.clear();
        row.xyz.extend(poses.frame(i));
        row.time = poses.time.as_ref().map(|t| t[i]);
        row.take = poses.take.as_ref().map(|t| t[i].clone());
        row.cells = table.cells.get(i).cloned().unwrap_or_default();
        row.converted = table.converted;
        numbers.clear();
        numbers.extend(xyz.row(i));
        sink.write(&row, &numbers, &cells(i))?;
    }
    sink.finish()
}
