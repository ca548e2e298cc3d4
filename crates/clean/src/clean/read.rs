//! A capture that is read.

use super::opened::{Opened, Run};
use super::record::Fingerprint;
use crate::Result;
use crate::io::MotionFile;
use crate::io::motion_file::LARGEST_MOTION_FILE;

/// A capture that is read.
pub(super) struct Read<'a> {
    pub run: Run<'a>,
    pub file: MotionFile,
    pub bytes: Bytes,
}

/// The bytes of a capture, unpacked.
pub(super) struct Bytes {
    pub size: usize,
    pub sha256: String,
}

impl<'a> Opened<'a> {
    /// Reads the capture.
    ///
    /// # Errors
    /// A file of somebody else stands in the place of the result; those of reading.
    pub(super) fn read(self) -> Result<Read<'a>> {
        self.check_places()?;
        let Opened { run, bytes, .. } = self;
        let is_utf16 = bytes.is_utf16();
        let bytes = bytes.read_all(LARGEST_MOTION_FILE)?;
        let input = &run.job.input;
        let of_bytes = Bytes {
            size: bytes.len(),
            sha256: Fingerprint::of(input, &bytes).sha256,
        };
        let mut file = MotionFile::read(input, bytes, &run.read)?;
        if is_utf16 {
            let what = "is a text in UTF-16; the result is in UTF-8".to_string();
            file.notes.push(what);
        }
        Ok(Read {
            run,
            file,
            bytes: of_bytes,
        })
    }
}
