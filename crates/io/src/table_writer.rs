//! Writes pose tables row by row, as CSV, as an NPY array or as an NPZ archive.
//!
//! A background thread formats the rows (CSV on all threads) and writes them in order, while the
//! caller computes the next ones. The text of a CSV row is that of [`CsvFormat::push_row`].

use super::columns::Columns;
use super::csv::{AddedColumn, CsvFormat};
use super::motion_folder::unpacked;
use super::npy;
use super::output::{CompleteOutput, Output};
use super::row::Row;
use super::table_archive::ArchiveRows;
use crate::{Error, Result};
use rayon::prelude::*;
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

/// The size of a batch, in bytes of output: no more than the buffer of a pipe, so that a row waits
/// for few others.
const BATCH_BYTES: usize = 1 << 16;
/// The largest number of batches that wait for the background thread, which takes all of them at
/// once.
const MAX_WAITING: usize = 8;
/// The least number of rows that one thread formats at a time.
const MIN_CHUNK: usize = 8;
/// An upper bound of the length of a number in text, with its comma.
const NUMBER_BYTES: usize = 25;

/// A file format of pose tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// Text with a header line.
    Csv,
    /// NumPy array of (frames, 3 x points), `<f8`.
    Npy,
    /// NumPy archive: `xyz` (frames, points, 3), `names`, `fps`, and an array for each kind of
    /// other columns, such as `status` and `sd` (frames, points).
    Npz,
}

impl TableFormat {
    /// The format that the extension of a path names: NPY for `.npy`, in either case, packed
    /// (`.npy.gz`, `.npy.zst`) or not; CSV for any other.
    ///
    /// ```
    /// use posing_io::TableFormat;
    ///
    /// assert_eq!(TableFormat::of_path("walk.npy.gz"), TableFormat::Npy);
    /// assert_eq!(TableFormat::of_path("walk.txt"), TableFormat::Csv);
    /// ```
    pub fn of_path(path: impl AsRef<Path>) -> TableFormat {
        match unpacked(path.as_ref()).extension() {
            Some(e) if e.eq_ignore_ascii_case("npy") => TableFormat::Npy,
            Some(e) if e.eq_ignore_ascii_case("npz") => TableFormat::Npz,
            _ => TableFormat::Csv,
        }
    }

    /// Checks that a table in this format can have `added` columns: an array holds coordinates
    /// alone.
    ///
    /// # Errors
    /// [`Error::Usage`]: columns would be added to an array.
    pub fn check_added(self, added: &[AddedColumn]) -> Result<()> {
        match (self, added.first()) {
            (TableFormat::Npy, Some(lost)) => Err(Error::usage(format!(
                "NPY holds coordinates only: the column {} would be lost; write CSV or NPZ",
                lost.name
            ))),
            _ => Ok(()),
        }
    }
}

/// A table that is being written. Rows that were given before an error are written all the same.
pub struct TableWriter {
    batch: Batch,
    keeps_cells: bool,
    /// `None` once the table is finished or writing has failed.
    stage: Option<Stage>,
}

enum Stage {
    /// No batch is full yet: a small table needs no thread.
    Start(Encoder),
    Running(Background),
}

/// The background thread.
struct Background {
    full: SyncSender<Batch>,
    /// Batches that were written, to be filled again.
    empty: Receiver<Batch>,
    thread: JoinHandle<(Encoder, Result<()>)>,
}

impl TableWriter {
    /// Starts a table with the columns `columns` and `added`, and writes its header.
    ///
    /// # Errors
    /// [`Error::Usage`]: added columns in an array. [`Error::Io`]: writing fails.
    pub(crate) fn new(
        output: Output,
        format: TableFormat,
        columns: &Columns,
        added: &[AddedColumn],
    ) -> Result<TableWriter> {
        format.check_added(added)?;
        Ok(TableWriter {
            batch: Batch::default(),
            keeps_cells: format != TableFormat::Npy,
            stage: Some(Stage::Start(Encoder::new(output, format, columns, added)?)),
        })
    }

    /// Writes a frame: `row` as it was read, `xyz` its new coordinates (three per point,
    /// centimeters, NaN is missing), `added` the cells of the added columns. See
    /// [`CsvFormat::push_row`].
    ///
    /// # Errors
    /// [`Error::Io`]: this row or one before it could not be written.
    pub(crate) fn write(&mut self, row: &Row, xyz: &[f64], added: &[String]) -> Result<()> {
        self.batch.push(row, xyz, added, self.keeps_cells);
        if self.batch.bytes >= BATCH_BYTES {
            let batch = std::mem::take(&mut self.batch);
            self.batch = self.send(batch)?;
            (self.batch.count, self.batch.bytes) = (0, 0);
        }
        Ok(())
    }

    /// Writes the last rows and completes the table.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub(crate) fn finish(self) -> Result<()> {
        self.complete()?.publish()
    }

    /// Writes the last rows; the file is not yet at its path ([`Output::complete`]).
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub(crate) fn complete(mut self) -> Result<CompleteOutput> {
        match self.drain()? {
            Some(encoder) => encoder.complete(),
            None => Ok(CompleteOutput::default()),
        }
    }

    /// Gives a batch to the background thread, and an empty one back.
    fn send(&mut self, batch: Batch) -> Result<Batch> {
        let background = match self.stage.take() {
            Some(Stage::Start(encoder)) => Background::start(encoder),
            Some(Stage::Running(background)) => background,
            None => return Ok(batch),
        };
        let next = background.empty.try_recv().unwrap_or_default();
        if background.full.send(batch).is_err() {
            // The thread ends early only after an error.
            return background.join().1.map(|()| next);
        }
        self.stage = Some(Stage::Running(background));
        Ok(next)
    }

    /// Writes all rows that were given; the encoder, unless an error was reported before.
    fn drain(&mut self) -> Result<Option<Encoder>> {
        let last = std::mem::take(&mut self.batch);
        let (encoder, done) = match self.stage.take() {
            Some(Stage::Start(mut encoder)) => {
                let done = encoder.write(&[last]);
                (encoder, done)
            }
            Some(Stage::Running(background)) => {
                // A send fails only after an error, which `join` returns.
                let _ = background.full.send(last);
                background.join()
            }
            None => return Ok(None),
        };
        done.map(|()| Some(encoder))
    }
}

impl Drop for TableWriter {
    fn drop(&mut self) {
        // After an error elsewhere, which is the one to report.
        let _ = self.drain();
    }
}

impl Background {
    fn start(mut encoder: Encoder) -> Background {
        let (full, waiting) = sync_channel(MAX_WAITING);
        let (written, empty) = channel();
        let thread = std::thread::spawn(move || {
            let done = encoder.write_all(&waiting, &written);
            (encoder, done)
        });
        Background {
            full,
            empty,
            thread,
        }
    }

    /// Waits until all batches are written.
    fn join(self) -> (Encoder, Result<()>) {
        drop(self.full);
        match self.thread.join() {
            Ok(done) => done,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

/// Rows to be written. The first `count` are in use, the others are memory for later rows.
#[derive(Default)]
struct Batch {
    rows: Vec<PendingRow>,
    count: usize,
    /// The size of the rows in text, at most.
    bytes: usize,
}

/// The arguments of [`TableWriter::write`].
#[derive(Default)]
struct PendingRow {
    row: Row,
    xyz: Vec<f64>,
    added: Vec<String>,
}

impl Batch {
    fn push(&mut self, row: &Row, xyz: &[f64], added: &[String], keeps_cells: bool) {
        if self.rows.len() == self.count {
            self.rows.push(PendingRow::default());
        }
        let pending = &mut self.rows[self.count];
        self.count += 1;
        pending.xyz.clear();
        pending.xyz.extend_from_slice(xyz);
        if !keeps_cells {
            self.bytes += 8 * xyz.len();
            return;
        }
        pending.set_text(row, added);
        self.bytes += row.cells.bytes().max(NUMBER_BYTES * xyz.len());
        self.bytes += added.iter().map(|cell| cell.len() + 1).sum::<usize>();
    }

    fn rows(&self) -> &[PendingRow] {
        &self.rows[..self.count]
    }
}

impl PendingRow {
    /// Copies everything but the new coordinates, without allocating where memory is there.
    fn set_text(&mut self, row: &Row, added: &[String]) {
        self.row.time = row.time;
        self.row.take.clone_from(&row.take);
        self.row.converted = row.converted;
        self.row.cells.copy_from(&row.cells);
        // The old coordinates matter only where the cells were kept.
        self.row.xyz.clear();
        if !row.cells.is_empty() {
            self.row.xyz.extend_from_slice(&row.xyz);
        }
        self.added.resize(added.len(), String::new());
        for (to, from) in self.added.iter_mut().zip(added) {
            to.clone_from(from);
        }
    }
}

/// Turns batches into bytes and writes them.
struct Encoder {
    output: Output,
    format: Format,
    /// Formatted pieces; kept, because allocating them anew for each batch costs page faults.
    texts: Vec<Vec<u8>>,
}

enum Format {
    Csv(CsvFormat),
    Npy {
        width: usize,
        frames: u64,
        /// A nameless file for the values, where the header of the output cannot be rewritten once
        /// their count is known.
        spool: Option<File>,
    },
    Npz(Box<ArchiveRows>),
}

impl Encoder {
    fn new(
        mut output: Output,
        format: TableFormat,
        columns: &Columns,
        added: &[AddedColumn],
    ) -> Result<Encoder> {
        let format = match format {
            TableFormat::Csv => {
                let csv = CsvFormat::new(columns, added);
                let mut header = Vec::new();
                csv.push_header(&mut header);
                output.write(&header)?;
                Format::Csv(csv)
            }
            TableFormat::Npz => Format::Npz(Box::new(ArchiveRows::new(columns, added))),
            TableFormat::Npy => {
                let width = columns.width();
                let spool = if output.can_rewrite() {
                    output.write(&npy::header(0, width))?;
                    None
                } else {
                    Some(tempfile::tempfile().map_err(spool_error)?)
                };
                Format::Npy {
                    width,
                    frames: 0,
                    spool,
                }
            }
        };
        Ok(Encoder {
            output,
            format,
            texts: Vec::new(),
        })
    }

    /// Writes batches as they come, until the other side hangs up.
    fn write_all(&mut self, waiting: &Receiver<Batch>, written: &Sender<Batch>) -> Result<()> {
        while let Ok(first) = waiting.recv() {
            let more = waiting.try_iter().take(MAX_WAITING - 1);
            let batches: Vec<Batch> = std::iter::once(first).chain(more).collect();
            self.write(&batches)?;
            for batch in batches {
                // The receiver is gone only at the end.
                let _ = written.send(batch);
            }
        }
        Ok(())
    }

    fn write(&mut self, batches: &[Batch]) -> Result<()> {
        match &mut self.format {
            Format::Csv(csv) => {
                let chunk = |batch: &Batch| batch.count.div_ceil(4).max(MIN_CHUNK);
                let pieces: Vec<&[PendingRow]> = batches
                    .iter()
                    .flat_map(|batch| batch.rows().chunks(chunk(batch)))
                    .collect();
                let count = pieces.len();
                self.texts
                    .resize_with(self.texts.len().max(count), Vec::new);
                let texts = &mut self.texts[..count];
                texts.par_iter_mut().zip(pieces).for_each(|(text, rows)| {
                    text.clear();
                    for row in rows {
                        csv.push_row(text, &row.row, &row.xyz, &row.added);
                    }
                });
                texts.iter().try_for_each(|text| self.output.write(text))?;
                self.output.flush()
            }
            Format::Npz(archive) => {
                for row in batches.iter().flat_map(Batch::rows) {
                    archive.push(&row.row, &row.xyz, &row.added);
                }
                Ok(())
            }
            Format::Npy { frames, spool, .. } => {
                self.texts.resize_with(1, Vec::new);
                let bytes = &mut self.texts[0];
                bytes.clear();
                for row in batches.iter().flat_map(Batch::rows) {
                    npy::push_values(bytes, &row.xyz);
                    *frames += 1;
                }
                match spool {
                    Some(spool) => spool.write_all(bytes).map_err(spool_error),
                    None => self.output.write(bytes),
                }
            }
        }
    }

    fn complete(mut self) -> Result<CompleteOutput> {
        match self.format {
            Format::Csv(_) => {}
            Format::Npz(archive) => self.output.write(&archive.bytes()?)?,
            Format::Npy {
                width,
                frames,
                spool,
            } => {
                let header = npy::header(frames, width);
                match spool {
                    None => self.output.rewrite_start(&header)?,
                    Some(mut spool) => {
                        self.output.write(&header)?;
                        spool.rewind().map_err(spool_error)?;
                        copy(spool, &mut self.output)?;
                    }
                }
            }
        }
        self.output.complete()
    }
}

/// Writes what a temporary file holds.
fn copy(mut spool: File, output: &mut Output) -> Result<()> {
    let mut block = vec![0; 1 << 18];
    loop {
        match spool.read(&mut block) {
            Ok(0) => return Ok(()),
            Ok(n) => output.write(&block[..n])?,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(spool_error(e)),
        }
    }
}

fn spool_error(e: io::Error) -> Error {
    Error::io("a temporary file", e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::csv::After;
    use std::sync::Arc;

    /// A table of so many rows as the writer writes it, and formatted row by row.
    fn written(rows: usize) -> (Vec<u8>, Vec<u8>) {
        let columns = Columns::for_points(vec!["a".into(), "b".into()], true, true);
        let added = [AddedColumn::new("more", After::All)];
        let csv = CsvFormat::new(&columns, &added);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        let output = Output::file(&path).unwrap();
        let mut writer = TableWriter::new(output, TableFormat::Csv, &columns, &added).unwrap();
        let mut want = Vec::new();
        csv.push_header(&mut want);
        let mut row = Row::default();
        for i in 0..rows {
            row.take = Some(Arc::from(format!("take {}", i / 1000)));
            row.time = Some(i as f64 / 30.0);
            let xyz: Vec<f64> = (0..6).map(|c| (i * c) as f64 / 7.0).collect();
            let added = ["x".repeat(i % 9)];
            csv.push_row(&mut want, &row, &xyz, &added);
            writer.write(&row, &xyz, &added).unwrap();
        }
        writer.finish().unwrap();
        (std::fs::read(&path).unwrap(), want)
    }

    #[test]
    fn all_rows_are_written_in_order() {
        for rows in [0, 1, 500, 600, 601, 30_000] {
            let (got, want) = written(rows);
            assert!(got == want, "{rows} rows");
        }
    }

    #[test]
    fn an_array_is_the_same_in_a_file_and_a_stream() {
        let columns = Columns::for_points(vec!["a".into()], false, false);
        let dir = tempfile::tempdir().unwrap();
        for rows in [0u16, 3, 20_000] {
            let (file, pipe) = (dir.path().join("f.npy"), dir.path().join("p.npy"));
            let stream = Output::stream("p", File::create(&pipe).unwrap());
            for output in [Output::file(&file).unwrap(), stream] {
                let mut writer = TableWriter::new(output, TableFormat::Npy, &columns, &[]).unwrap();
                for i in 0..rows {
                    let xyz = [0.5, 1.5, 2.5].map(|x| x + f64::from(i));
                    writer.write(&Row::default(), &xyz, &[]).unwrap();
                }
                writer.finish().unwrap();
            }
            let bytes = std::fs::read(&file).unwrap();
            assert_eq!(bytes.len(), 128 + 24 * usize::from(rows));
            assert_eq!(bytes[..128], npy::header(u64::from(rows), 3));
            assert!(bytes == std::fs::read(&pipe).unwrap());
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_an_error() {
        let columns = Columns::for_points(vec!["a".into()], false, false);
        for rows in [1, 100_000] {
            let output = Output::file("/dev/full").unwrap();
            let mut writer = TableWriter::new(output, TableFormat::Csv, &columns, &[]).unwrap();
            let row = Row::default();
            let written = (0..rows).try_for_each(|_| writer.write(&row, &[0.1, 0.2, 0.3], &[]));
            assert!(
                written.and_then(|()| writer.finish()).is_err(),
                "{rows} rows"
            );
        }
    }
}
