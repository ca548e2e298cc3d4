//! Rows become text behind a command's back: while it reads and computes the next ones, a thread prints and writes.

use super::behind::Behind;
use super::streams::Sink;
use crate::Result;
use crate::io::csv::CsvWriter;
use crate::io::table::Row;
use rayon::prelude::*;
use std::io::Write;

/// How many bytes of text a batch becomes at most: no row waits for more others than a buffer of a pipe holds.
const BATCH: usize = 1 << 16;

/// How many batches wait at most, and are printed together.
const WAITING: usize = 8;

/// How many rows one thread prints at a time, at least.
const CHUNK: usize = 8;

/// No number is longer, its comma included.
const NUMBER: usize = 25;

/// Prints the rows of a table, in order. What was given before an error is written all the same.
pub struct Printer {
    batch: Batch,
    press: Behind<Batch, Sink>,
}

/// Rows to be printed. The first `count` count, the others are memory to be used again.
#[derive(Default)]
struct Batch {
    lines: Vec<Line>,
    count: usize,
    bytes: usize,
}

/// What [`CsvWriter::push_row`] is given.
#[derive(Default)]
struct Line {
    row: Row,
    xyz: Vec<f64>,
    added: Vec<String>,
}

impl Printer {
    /// Writes the header line.
    pub fn new(mut sink: Sink, csv: CsvWriter) -> Result<Printer> {
        let mut head = Vec::new();
        csv.push_header(&mut head);
        sink.put(&head)?;
        let mut texts = Vec::new();
        Ok(Printer {
            batch: Batch::default(),
            press: Behind::new(sink, WAITING, move |sink, batches: &[Batch]| {
                print(&csv, sink, batches, &mut texts)
            }),
        })
    }

    /// Takes a row: see [`CsvWriter::push_row`]. An error may be that of a row before.
    pub fn write(&mut self, row: &Row, xyz: &[f64], added: &[String]) -> Result<()> {
        self.batch.push(row, xyz, added);
        if self.batch.bytes >= BATCH {
            let batch = std::mem::take(&mut self.batch);
            self.batch = self.press.give(batch)?;
            self.batch.clear();
        }
        Ok(())
    }

    /// Completes the table.
    pub fn finish(mut self) -> Result<()> {
        let batch = std::mem::take(&mut self.batch);
        self.press.end(batch)?.map_or(Ok(()), Sink::finish)
    }
}

impl Drop for Printer {
    fn drop(&mut self) {
        // After an error elsewhere, which is the one to be told.
        let _ = self.press.end(std::mem::take(&mut self.batch));
    }
}

/// Prints batches, on all threads, and writes them. `texts` is memory that is used again: got anew, its page faults showed
/// beside the printing.
fn print(
    csv: &CsvWriter,
    sink: &mut Sink,
    batches: &[Batch],
    texts: &mut Vec<Vec<u8>>,
) -> Result<()> {
    let pieces = |batch: &Batch| (0..batch.count).step_by(batch.chunk());
    let chunks: Vec<(&Batch, usize)> = batches
        .iter()
        .flat_map(|batch| pieces(batch).map(move |start| (batch, start)))
        .collect();
    let count = chunks.len();
    texts.resize_with(texts.len().max(count), Vec::new);
    texts[..count]
        .par_iter_mut()
        .zip(chunks)
        .for_each(|(text, (batch, start))| {
            text.clear();
            batch.print(csv, start, batch.chunk(), text);
        });
    texts[..count].iter().try_for_each(|text| sink.put(text))?;
    sink.flush().map_err(|e| sink.fail(e))
}

impl Line {
    /// Becomes this row, in the memory that is there.
    fn set(&mut self, row: &Row, xyz: &[f64], added: &[String]) {
        self.row.time = row.time;
        self.row.take.clone_from(&row.take);
        self.row.converted = row.converted;
        self.row.cells.copy_from(&row.cells);
        // What was read is compared with what is written only where the cells were kept.
        self.row.xyz.clear();
        if !row.cells.is_empty() {
            self.row.xyz.extend_from_slice(&row.xyz);
        }
        self.xyz.clear();
        self.xyz.extend_from_slice(xyz);
        self.added.resize(added.len(), String::new());
        for (to, from) in self.added.iter_mut().zip(added) {
            to.clone_from(from);
        }
    }
}

impl Batch {
    fn push(&mut self, row: &Row, xyz: &[f64], added: &[String]) {
        if self.lines.len() == self.count {
            self.lines.push(Line::default());
        }
        self.lines[self.count].set(row, xyz, added);
        self.count += 1;
        self.bytes += row.cells.bytes().max(NUMBER * xyz.len());
        self.bytes += added.iter().map(|cell| cell.len() + 1).sum::<usize>();
    }

    fn clear(&mut self) {
        (self.count, self.bytes) = (0, 0);
    }

    /// How many rows one thread prints at a time: a quarter of the batch.
    fn chunk(&self) -> usize {
        self.count.div_ceil(4).max(CHUNK)
    }

    /// Appends up to `rows` rows from `start` on.
    fn print(&self, csv: &CsvWriter, start: usize, rows: usize, text: &mut Vec<u8>) {
        for line in self.lines[..self.count].iter().skip(start).take(rows) {
            csv.push_row(text, &line.row, &line.xyz, &line.added);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::csv::After;
    use crate::io::output::OutputFile;
    use crate::io::table::Columns;
    use std::sync::Arc;

    /// What is printed of so many rows, and what they are row by row.
    fn printed(rows: usize) -> (Vec<u8>, Vec<u8>) {
        let columns = Columns::for_points(vec!["a".into(), "b".into()], true, true);
        let csv = || CsvWriter::new(&columns, &[("more".into(), After::All)]);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        let file = OutputFile::create(&path).unwrap();
        let mut printer = Printer::new(Sink::File(file, path.clone()), csv()).unwrap();
        let mut want = Vec::new();
        csv().push_header(&mut want);
        let mut row = Row::default();
        for i in 0..rows {
            row.take = Some(Arc::from(format!("take {}", i / 1000)));
            row.time = Some(i as f64 / 30.0);
            let xyz: Vec<f64> = (0..6).map(|c| (i * c) as f64 / 7.0).collect();
            let added = ["x".repeat(i % 9)];
            csv().push_row(&mut want, &row, &xyz, &added);
            printer.write(&row, &xyz, &added).unwrap();
        }
        printer.finish().unwrap();
        (std::fs::read(&path).unwrap(), want)
    }

    #[test]
    fn rows_come_out_in_order_and_none_is_lost() {
        for rows in [0, 1, 500, 600, 601, 30_000] {
            let (got, want) = printed(rows);
            assert!(got == want, "{rows} rows");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_told_of_sooner_or_later() {
        let path = std::path::PathBuf::from("/dev/full");
        let columns = Columns::for_points(vec!["a".into()], false, false);
        for rows in [1, 100_000] {
            let sink = Sink::File(OutputFile::create(&path).unwrap(), path.clone());
            let mut printer = Printer::new(sink, CsvWriter::new(&columns, &[])).unwrap();
            let row = Row::default();
            let written = (0..rows).try_for_each(|_| printer.write(&row, &[0.1, 0.2, 0.3], &[]));
            assert!(
                written.and_then(|()| printer.finish()).is_err(),
                "{rows} rows"
            );
        }
    }
}
