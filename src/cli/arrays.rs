//! Arrays written frame by frame, though their header, which comes first, counts the frames.

use super::streams::Sink;
use crate::io::npy;
use crate::{Error, Result};
use std::fs::File;
use std::io::{self, Seek, Write};

/// How many bytes are written at a time.
const BLOCK: usize = 1 << 18;

/// An array being written.
pub struct ArraySink {
    sink: Sink,
    /// Where the values wait for their count, if the sink's start cannot be written again: a file without a name.
    spool: Option<File>,
    block: Vec<u8>,
    frames: u64,
    width: usize,
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
            sink,
            spool,
            block: Vec::new(),
            frames: 0,
            width,
        })
    }

    /// Writes a frame.
    pub fn write(&mut self, xyz: &[f64]) -> Result<()> {
        self.frames += 1;
        npy::push_values(&mut self.block, xyz);
        if self.block.len() >= BLOCK {
            self.write_block()?;
        }
        Ok(())
    }

    fn write_block(&mut self) -> Result<()> {
        match &mut self.spool {
            Some(spool) => spool.write_all(&self.block).map_err(spool_error)?,
            None => self.sink.put(&self.block)?,
        }
        self.block.clear();
        Ok(())
    }

    /// Completes the array.
    pub fn finish(mut self) -> Result<()> {
        self.write_block()?;
        let header = npy::header(self.frames, self.width);
        match (&mut self.sink, self.spool) {
            (sink, Some(mut spool)) => {
                spool.rewind().map_err(spool_error)?;
                sink.put(&header)?;
                sink.copy(&mut spool)?;
            }
            (Sink::File(file, path), None) => {
                let done = file.rewrite_start(&header);
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
