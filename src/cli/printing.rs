//! Rows become text behind a command's back: while it reads and computes the next ones, a thread prints and writes.

use super::streams::Sink;
use crate::Result;
use crate::io::csv::CsvWriter;
use crate::io::table::Row;
use rayon::prelude::*;
use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

/// About how many bytes of text a batch becomes: no row waits for more others than a buffer of a pipe holds.
const BATCH: usize = 1 << 16;

/// How many batches wait at most, and are printed together.
const WAITING: usize = 8;

/// How many rows one thread prints at a time, at least.
const CHUNK: usize = 8;

/// A number's length, about.
const NUMBER: usize = 18;

/// Prints the rows of a table, in order. What was given before an error is written all the same.
pub struct Printer {
    csv: Arc<CsvWriter>,
    batch: Batch,
    /// Taken out when the printer is done.
    stage: Option<Stage>,
}

/// A short table needs no thread.
enum Stage {
    Here(Sink),
    Behind(Press),
}

/// The thread that prints.
struct Press {
    batches: SyncSender<Batch>,
    spent: Receiver<Batch>,
    thread: JoinHandle<(Sink, Result<()>)>,
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
        csv.push_head(&mut head);
        sink.put(&head)?;
        Ok(Printer {
            csv: Arc::new(csv),
            batch: Batch::default(),
            stage: Some(Stage::Here(sink)),
        })
    }

    /// Takes a row: see [`CsvWriter::push_row`]. An error may be that of a row before.
    pub fn write(&mut self, row: &Row, xyz: &[f64], added: &[String]) -> Result<()> {
        self.batch.push(row, xyz, added);
        if self.batch.bytes >= BATCH {
            self.hand_over()?;
        }
        Ok(())
    }

    /// Gives the batch to the thread.
    fn hand_over(&mut self) -> Result<()> {
        let press = match self.stage.take() {
            Some(Stage::Here(sink)) => Press::start(sink, self.csv.clone()),
            Some(Stage::Behind(press)) => press,
            None => return Ok(()),
        };
        let next = press.spent.try_recv().unwrap_or_default();
        if press
            .batches
            .send(std::mem::replace(&mut self.batch, next))
            .is_err()
        {
            // It ended before its time: it could not write.
            return press.end().1;
        }
        self.stage = Some(Stage::Behind(press));
        Ok(())
    }

    /// Prints what is left; the sink, unless it broke before.
    fn end(&mut self) -> Result<Option<Sink>> {
        if matches!(self.stage, Some(Stage::Behind(_))) && self.batch.count > 0 {
            self.hand_over()?;
        }
        match self.stage.take() {
            Some(Stage::Here(mut sink)) => {
                let mut text = Vec::new();
                self.batch.print(&self.csv, 0, usize::MAX, &mut text);
                sink.put(&text)?;
                Ok(Some(sink))
            }
            Some(Stage::Behind(press)) => {
                let (sink, done) = press.end();
                done.map(|()| Some(sink))
            }
            None => Ok(None),
        }
    }

    /// Completes the table.
    pub fn finish(mut self) -> Result<()> {
        self.end()?.map_or(Ok(()), Sink::finish)
    }
}

impl Drop for Printer {
    fn drop(&mut self) {
        // After an error elsewhere, which is the one to be told.
        let _ = self.end();
    }
}

impl Press {
    fn start(sink: Sink, csv: Arc<CsvWriter>) -> Press {
        let (batches, waiting) = sync_channel(WAITING);
        let (used, spent) = channel();
        Press {
            batches,
            spent,
            thread: std::thread::spawn(move || print(sink, &csv, &waiting, &used)),
        }
    }

    /// Waits until all is written; what became of it.
    fn end(self) -> (Sink, Result<()>) {
        drop(self.batches);
        match self.thread.join() {
            Ok(done) => done,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

/// Prints batches and writes them: as soon as one is there, and together what came meanwhile.
fn print(
    mut sink: Sink,
    csv: &CsvWriter,
    waiting: &Receiver<Batch>,
    used: &Sender<Batch>,
) -> (Sink, Result<()>) {
    while let Ok(first) = waiting.recv() {
        let more = waiting.try_iter().take(WAITING - 1);
        let batches: Vec<Batch> = std::iter::once(first).chain(more).collect();
        let chunks: Vec<(&Batch, usize)> = batches
            .iter()
            .flat_map(|batch| {
                (0..batch.count)
                    .step_by(batch.chunk())
                    .map(move |i| (batch, i))
            })
            .collect();
        let texts: Vec<Vec<u8>> = chunks
            .into_par_iter()
            .map(|(batch, start)| {
                let mut text = Vec::with_capacity(BATCH / 2);
                batch.print(csv, start, batch.chunk(), &mut text);
                text
            })
            .collect();
        let done = texts.iter().try_for_each(|text| sink.put(text));
        let done = done.and_then(|()| sink.flush().map_err(|e| sink.fail(e)));
        if done.is_err() {
            return (sink, done);
        }
        for mut batch in batches {
            batch.clear();
            // Nobody wants it any more at the end.
            let _ = used.send(batch);
        }
    }
    (sink, Ok(()))
}

impl Batch {
    fn push(&mut self, row: &Row, xyz: &[f64], added: &[String]) {
        if self.lines.len() == self.count {
            self.lines.push(Line::default());
        }
        let line = &mut self.lines[self.count];
        line.row.copy_from(row);
        line.xyz.clear();
        line.xyz.extend_from_slice(xyz);
        line.added.resize(added.len(), String::new());
        for (to, from) in line.added.iter_mut().zip(added) {
            to.clone_from(from);
        }
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
