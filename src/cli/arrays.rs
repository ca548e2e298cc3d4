//! Arrays written frame by frame, though their header, which comes first, counts the frames.

use super::behind::Behind;
use super::streams::Sink;
use crate::io::npy;
use crate::{Error, Result};
use std::fs::File;
use std::io::{self, Seek, Write};

/// How many bytes are written at a time, and how many blocks wait at most.
const BLOCK: usize = 1 << 18;
const WAITING: usize = 4;

/// An array being written.
pub struct ArraySink {
    target: Behind<Vec<u8>, Target>,
    block: Vec<u8>,
    frames: u64,
    width: usize,
}

/// Where the values go.
struct Target {
    sink: Sink,
    /// Where they wait for their count, if the sink's start cannot be written again: a file without a name.
    spool: Option<File>,
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
        let put = |target: &mut Target, blocks: &[Vec<u8>]| {
            blocks.iter().try_for_each(|block| target.put(block))
        };
        Ok(ArraySink {
            target: Behind::new(Target { sink, spool }, WAITING, put),
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
            let block = std::mem::take(&mut self.block);
            self.block = self.target.give(block)?;
            self.block.clear();
        }
        Ok(())
    }

    /// Completes the array.
    pub fn finish(mut self) -> Result<()> {
        let header = npy::header(self.frames, self.width);
        match self.target.end(std::mem::take(&mut self.block))? {
            Some(target) => target.finish(&header),
            None => Ok(()),
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

fn spool_error(e: io::Error) -> Error {
    Error::io("a temporary file", e)
}
