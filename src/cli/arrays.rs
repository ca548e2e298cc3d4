//! Arrays written frame by frame, though their header, which comes first, counts the frames.

use super::streams::Sink;
use crate::io::npy;
use crate::{Error, Result};
use std::fs::File;
use std::io::{self, Seek, Write};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

/// How many bytes are written at a time, and how many blocks wait at most.
const BLOCK: usize = 1 << 18;
const WAITING: usize = 4;

/// An array being written.
pub struct ArraySink {
    /// Taken out when the array is done.
    stage: Option<Stage>,
    block: Vec<u8>,
    frames: u64,
    width: usize,
}

/// A short array needs no thread.
enum Stage {
    Here(Target),
    Behind(Behind),
}

/// Where the values go.
struct Target {
    sink: Sink,
    /// Where they wait for their count, if the sink's start cannot be written again: a file without a name.
    spool: Option<File>,
}

/// The thread that writes, while the command reads and computes.
struct Behind {
    blocks: SyncSender<Vec<u8>>,
    spent: Receiver<Vec<u8>>,
    thread: JoinHandle<(Target, Result<()>)>,
}

impl ArraySink {
    /// Starts an array of `width` numbers a frame.
    pub fn new(mut sink: Sink, width: usize) -> Result<ArraySink> {
        let spool = match &sink {
            Sink::File(file, _) if file.can_rewrite() => None,
            _ => Some(tempfile::tempfile().map_err(spool_error)?),
        };
        if spool.is_none() {
            sink.put(&npy::header(0, width))?;
        }
        Ok(ArraySink {
            stage: Some(Stage::Here(Target { sink, spool })),
            block: Vec::new(),
            frames: 0,
            width,
        })
    }

    /// Writes a frame. An error may be that of a frame before.
    pub fn write(&mut self, xyz: &[f64]) -> Result<()> {
        self.frames += 1;
        npy::push_values(&mut self.block, xyz);
        if self.block.len() >= BLOCK {
            self.hand_over()?;
        }
        Ok(())
    }

    /// Gives the block to the thread.
    fn hand_over(&mut self) -> Result<()> {
        let behind = match self.stage.take() {
            Some(Stage::Here(target)) => Behind::start(target),
            Some(Stage::Behind(behind)) => behind,
            None => return Ok(()),
        };
        // Memory that was written is used again.
        let mut next = behind.spent.try_recv().unwrap_or_default();
        next.clear();
        let block = std::mem::replace(&mut self.block, next);
        if behind.blocks.send(block).is_err() {
            // It ended before its time: it could not write.
            return behind.end().1;
        }
        self.stage = Some(Stage::Behind(behind));
        Ok(())
    }

    /// Waits until all is written; where to, unless it broke before.
    fn end(&mut self) -> Result<Option<Target>> {
        let mut target = match self.stage.take() {
            Some(Stage::Here(target)) => target,
            Some(Stage::Behind(behind)) => {
                let (target, done) = behind.end();
                done?;
                target
            }
            None => return Ok(None),
        };
        target.put(&self.block)?;
        Ok(Some(target))
    }

    /// Completes the array.
    pub fn finish(mut self) -> Result<()> {
        let header = npy::header(self.frames, self.width);
        match self.end()? {
            Some(target) => target.finish(&header),
            None => Ok(()),
        }
    }
}

impl Drop for ArraySink {
    fn drop(&mut self) {
        // After an error elsewhere, which is the one to be told: the thread lets go of its files before the process ends.
        if let Some(Stage::Behind(behind)) = self.stage.take() {
            let _ = behind.end();
        }
    }
}

impl Target {
    fn put(&mut self, block: &[u8]) -> Result<()> {
        match &mut self.spool {
            Some(spool) => spool.write_all(block).map_err(spool_error),
            None => self.sink.put(block),
        }
    }

    /// Puts the header where it belongs.
    fn finish(mut self, header: &[u8]) -> Result<()> {
        match (&mut self.sink, self.spool) {
            (sink, Some(mut spool)) => {
                spool.rewind().map_err(spool_error)?;
                sink.put(header)?;
                sink.copy(&mut spool)?;
            }
            (Sink::File(file, path), None) => {
                let done = file.rewrite_start(header);
                done.map_err(|e| Error::io(&*path, e))?;
            }
            (Sink::Stdout(_), None) => {}
        }
        self.sink.finish()
    }
}

impl Behind {
    fn start(target: Target) -> Behind {
        let (blocks, waiting) = sync_channel(WAITING);
        let (used, spent) = channel();
        Behind {
            blocks,
            spent,
            thread: std::thread::spawn(move || put_all(target, &waiting, &used)),
        }
    }

    /// Waits until all is written; what became of it.
    fn end(self) -> (Target, Result<()>) {
        drop(self.blocks);
        match self.thread.join() {
            Ok(done) => done,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

fn put_all(
    mut target: Target,
    waiting: &Receiver<Vec<u8>>,
    used: &Sender<Vec<u8>>,
) -> (Target, Result<()>) {
    for block in waiting {
        if let Err(e) = target.put(&block) {
            return (target, Err(e));
        }
        // Nobody wants it any more at the end.
        let _ = used.send(block);
    }
    (target, Ok(()))
}

fn spool_error(e: io::Error) -> Error {
    Error::io("a temporary file", e)
}
