//! Inputs and outputs of the commands: files, standard input and output, tables on either.

use super::arrays::ArraySink;
use super::flags::{Format, TableIn, TableOut};
use super::printing::Printer;
use crate::io::csv::{After, CsvWriter};
use crate::io::output::{OutputFile, descriptor};
use crate::io::table::{Builder, Columns, Row, RowReader, Table};
use crate::io::{Input, Model};
use crate::{Error, Place, Result};
use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The name of standard output in messages.
const STDOUT: &str = "standard output";

/// Opens a file, or standard input for `-`.
pub fn open(path: &Path) -> Result<Input> {
    if path == Path::new("-") {
        Input::new("standard input", io::stdin())
    } else {
        Input::open(path)
    }
}

/// Reads a model from a file or, for `-`, from standard input.
pub fn open_model(path: &Path) -> Result<Model> {
    Model::read(open(path)?)
}

/// Fails where two things would be read from standard input.
pub fn one_stdin<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<()> {
    match paths.into_iter().filter(|p| *p == Path::new("-")).count() {
        0 | 1 => Ok(()),
        _ => Err(Error::usage("standard input (-) is named more than once")),
    }
}

/// Fails where a table and another file would both be read from standard input, which is where a table without a name
/// comes from.
pub fn one_stdin_with<'a>(
    table: &'a TableIn,
    others: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<()> {
    let unnamed = usize::from(table.files.is_empty());
    let named = table.files.iter().chain(others);
    match named.filter(|p| *p == Path::new("-")).count() + unnamed {
        0 | 1 => Ok(()),
        _ => Err(Error::usage(
            "standard input (-) would be read for two things; name a file",
        )),
    }
}

/// Rows of several tables with the same columns, one after another.
pub struct RowStream<'a> {
    flags: &'a TableIn,
    planar: bool,
    cells: bool,
    rest: std::vec::IntoIter<PathBuf>,
    /// What the file being read is called as a take.
    take: Arc<str>,
    /// What those before it were called.
    takes: Vec<Arc<str>>,
    reader: RowReader,
    columns: Columns,
}

impl<'a> RowStream<'a> {
    /// Opens the first of the files (standard input when there is none).
    pub fn open(flags: &'a TableIn, planar: bool, cells: bool) -> Result<RowStream<'a>> {
        one_stdin(&flags.files)?;
        let files = if flags.files.is_empty() {
            vec![PathBuf::from("-")]
        } else {
            flags.files.clone()
        };
        let mut rest = files.into_iter();
        let first = rest.next().unwrap_or_default();
        let take = stem(&first).into();
        let reader = RowReader::new(open(&first)?, &flags.options(planar, cells)?)?;
        let columns = reader.columns().clone();
        Ok(RowStream {
            flags,
            planar,
            cells,
            rest,
            take,
            takes: Vec::new(),
            reader,
            columns,
        })
    }

    /// What the columns mean.
    pub fn columns(&self) -> &Columns {
        &self.columns
    }

    /// The name of the file being read.
    pub fn name(&self) -> &str {
        self.reader.name()
    }

    /// Names the take of the next file: the same name twice is two takes.
    fn name_take(&mut self, file: &Path) {
        let mut name = stem(file);
        self.takes.push(self.take.clone());
        while self.takes.iter().any(|t| **t == *name) {
            name.push('\'');
        }
        self.take = name.into();
    }

    /// What the file being read is called as a take, where nothing in it tells.
    fn take_of_file(&self) -> Arc<str> {
        self.take.clone()
    }

    /// The next frame, in centimetres, y up; `false` at the end of the last file.
    pub fn read(&mut self, row: &mut Row) -> Result<bool> {
        while !self.reader.read(row)? {
            let Some(next) = self.rest.next() else {
                return Ok(false);
            };
            self.name_take(&next);
            self.reader =
                RowReader::new(open(&next)?, &self.flags.options(self.planar, self.cells)?)?;
            if self.reader.columns() != &self.columns {
                let what = format!("has other columns than {}", self.flags.files[0].display());
                return Err(Error::data(Place::file(self.reader.name()), what));
            }
        }
        row.converted = self.flags.convert(&mut row.xyz);
        Ok(true)
    }
}

fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Reads whole tables, one after another, into one.
pub fn read_table(flags: &TableIn, planar: bool, cells: bool) -> Result<Table> {
    let mut stream = RowStream::open(flags, planar, cells)?;
    let columns = stream.columns().clone();
    let name = stream.name().to_string();
    let (mut builder, mut kept, mut row) = (Builder::new(&columns), Vec::new(), Row::default());
    // Where neither takes nor times tell how frames hang together, each file is a take.
    let is_telling = columns.take.is_some() || columns.time.is_some() || flags.files.len() < 2;
    let mut files: Vec<Arc<str>> = Vec::new();
    while stream.read(&mut row)? {
        if !is_telling {
            files.push(stream.take_of_file());
        }
        builder.push(&row);
        if cells {
            kept.push(std::mem::take(&mut row.cells));
        }
    }
    let mut poses = builder.finish();
    if !is_telling {
        poses.take = Some(files);
    }
    Ok(Table {
        name,
        columns,
        poses,
        cells: kept,
        converted: row.converted,
    })
}

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
            Some(path) if path != Path::new("-") && descriptor(path) != Some(1) => {
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
        flags: &TableOut,
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
pub fn fits(flags: &TableOut, added: &[(String, After)]) -> Result<()> {
    match (flags.format(), added.first()) {
        (Format::Npy, Some((lost, _))) => Err(Error::usage(format!(
            "an array (NPY) holds coordinates alone: the column {lost} would be lost; write CSV"
        ))),
        _ => Ok(()),
    }
}

/// Writes a whole table whose numbers became `xyz`; `added` gives each frame's added cells.
pub fn write_table(
    flags: &TableOut,
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
