//! Opening an input. The format is recognized by content, never by name.

use super::foreign_format::{self, foreign};
use super::keypoint_files::joined;
use super::motion_format::is_told;
use super::text::wait_for_data;
use super::utf16::{Decoded, Utf16};
use crate::{Error, Place, Result};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The size of the buffers, in bytes.
const BUFFER: usize = 1 << 16;
/// What unpacks to more than this, bytes, may not be so many times larger than it was packed.
const UNPACKED: u64 = 1 << 26;
const MOST_UNPACKED: u64 = 100;
/// The number of bytes by which a format is recognized.
const MAGIC: usize = 12;
/// The most bytes by which a format of text is recognized, and the lines after each of which that
/// is tried.
const AHEAD: usize = 1 << 18;
const TRIED_LINES: usize = 16;

/// An opened input, decompressed, with the name its messages use.
pub struct Input {
    /// The path as the user wrote it, or `standard input`.
    pub name: String,
    kind: ContentKind,
    first: Vec<u8>,
    reader: Box<dyn BufRead>,
    is_utf16: bool,
    /// The bytes of the file, 0 where they are not known.
    size: u64,
}

/// The kind of content, by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContentKind {
    /// NumPy's array file.
    Npy,
    /// A ZIP archive, as `.npz` is.
    Npz,
    /// No bytes.
    Empty,
    /// Anything else: text.
    Text,
}

impl Input {
    /// Opens a file; gzip and zstd are decompressed. A folder of keypoints with a frame a file is
    /// read as one.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: another directory.
    pub fn open(path: impl AsRef<Path>) -> Result<Input> {
        let path = path.as_ref();
        let fail = |e| Error::io(path, e);
        let file = File::open(path).map_err(fail)?;
        let about = file.metadata().map_err(fail)?;
        if about.is_dir() {
            let joined = io::Cursor::new(joined(path)?);
            return Input::new(path.display().to_string(), joined);
        }
        let mut input = Input::new(path.display().to_string(), file)?;
        input.size = about.len();
        Ok(input)
    }

    /// Wraps a stream; gzip and zstd are decompressed. `name` is for messages.
    ///
    /// # Errors
    /// [`Error::Io`]: the first bytes cannot be read or decompressed. [`Error::Data`]: a format
    /// that no command reads; the message
    /// names it and the way that exists.
    pub fn new(name: impl Into<String>, stream: impl Read + 'static) -> Result<Input> {
        let name = name.into();
        let fail = |e| Error::io(&name, e);
        let (first, stream) = start(stream).map_err(fail)?;
        let packed = Arc::new(AtomicU64::new(0));
        let stream = Counted(stream, packed.clone());
        let stream: Box<dyn Read> = if first.starts_with(&[0x1f, 0x8b]) {
            let stream = BufReader::with_capacity(BUFFER, stream);
            Box::new(flate2::bufread::MultiGzDecoder::new(stream))
        } else if first.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]) {
            let stream = BufReader::with_capacity(BUFFER, stream);
            Box::new(zstd::Decoder::with_buffer(stream).map_err(fail)?)
        } else {
            return Input::unpacked(name, first, stream);
        };
        let stream = Unpacked {
            stream,
            count: 0,
            packed,
        };
        let (first, stream) = start(stream).map_err(fail)?;
        Input::unpacked(name, first, stream)
    }

    /// A stream that is not packed and begins with the bytes `first`. Text in UTF-16 becomes UTF-8.
    fn unpacked(name: String, first: Vec<u8>, stream: impl Read + 'static) -> Result<Input> {
        let order = Utf16::of(&first);
        let (first, stream): (Vec<u8>, Box<dyn Read>) = match order {
            Some(order) => {
                let decoded = start(Decoded::new(stream, order));
                let (first, stream) = decoded.map_err(|e| Error::io(&name, e))?;
                (first, Box::new(stream))
            }
            None => (first, Box::new(stream)),
        };
        Input::known(Input {
            kind: kind_of(&first),
            first,
            reader: Box::new(BufReader::with_capacity(BUFFER, stream)),
            is_utf16: order.is_some(),
            size: 0,
            name,
        })
    }

    /// The input, unless no command reads its format.
    fn known(mut input: Input) -> Result<Input> {
        if foreign_format::needs_more(&input.first) {
            input.read_ahead(|start| start.len() >= foreign_format::BYTES)?;
        }
        match foreign(&input.first) {
            Some(what) => Err(Error::data(Place::file(input.name), what)),
            None => Ok(input),
        }
    }

    /// The first bytes: at least 12, or all where there are fewer.
    pub fn first_bytes(&self) -> &[u8] {
        &self.first
    }

    /// Reads on until [`Input::first_bytes`] tell the format of motion that it is; no further than
    /// that, since a table may arrive row by row.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails.
    pub fn look_ahead(&mut self) -> Result<()> {
        if is_told(&self.first) {
            return Ok(());
        }
        let (mut lines, mut next) = (0, 0);
        self.read_ahead(|start| {
            let is_line = start.ends_with(b"\n");
            lines += usize::from(is_line);
            let tried = is_line && lines <= TRIED_LINES || start.len() >= next;
            if tried {
                next = 2 * start.len();
            }
            start.len() >= AHEAD || tried && is_told(start)
        })
    }

    /// Whether it is a text in UTF-16, which is read as UTF-8.
    #[doc(hidden)]
    pub fn is_utf16(&self) -> bool {
        self.is_utf16
    }

    /// Reads ahead piece by piece, each at most a line, until `is_enough` of the first bytes.
    fn read_ahead(&mut self, mut is_enough: impl FnMut(&[u8]) -> bool) -> Result<()> {
        let mut rest = std::mem::replace(&mut self.reader, Box::new(io::empty()));
        let mut ahead = Vec::new();
        loop {
            wait_for_data(&mut rest).map_err(|e| Error::io(&self.name, e))?;
            let there = rest.fill_buf().map_err(|e| Error::io(&self.name, e))?;
            if there.is_empty() {
                break;
            }
            let line = there.iter().position(|b| *b == b'\n');
            let piece = line.map_or(there.len(), |i| i + 1);
            ahead.extend_from_slice(&there[..piece]);
            rest.consume(piece);
            if is_enough(&ahead) {
                break;
            }
        }
        self.reader = Box::new(io::Cursor::new(ahead.clone()).chain(rest));
        if ahead.len() > self.first.len() {
            self.first = ahead;
        }
        Ok(())
    }

    /// The kind of content.
    pub fn kind(&self) -> ContentKind {
        self.kind
    }

    /// Reads the remaining bytes, at most `limit`.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails, or far more is unpacked than was packed. [`Error::Data`]: more
    /// than `limit` bytes.
    pub fn read_all(mut self, limit: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        // A vector that grows as it is filled may be copied, which takes the memory twice. What
        // cannot be had is an error when it is needed.
        let expected = usize::try_from(self.size.min(limit)).unwrap_or(0);
        let _unless_too_much = bytes.try_reserve_exact(expected + 1);
        let mut stream = self.reader.by_ref().take(limit.saturating_add(1));
        let read = stream.read_to_end(&mut bytes);
        read.map_err(|e| Error::io(&self.name, e))?;
        if bytes.len() as u64 > limit {
            let what = format!("is larger than {} MiB", limit >> 20);
            return Err(Error::data(Place::file(self.name), what));
        }
        Ok(bytes)
    }

    /// The stream itself.
    pub fn into_reader(self) -> Box<dyn BufRead> {
        self.reader
    }
}

/// Counts the bytes that are read.
struct Counted<R>(R, Arc<AtomicU64>);

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.0.read(out)?;
        self.1.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

/// What a packed stream unpacks to, as long as it is no bomb.
struct Unpacked<R> {
    stream: R,
    /// The bytes so far.
    count: u64,
    /// The packed bytes that were read for them.
    packed: Arc<AtomicU64>,
}

impl<R: Read> Read for Unpacked<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.stream.read(out)?;
        self.count += count as u64;
        let packed = self.packed.load(Ordering::Relaxed);
        if self.count > UNPACKED.max(MOST_UNPACKED * packed) {
            let what = format!(
                "unpacks to more than {MOST_UNPACKED} times its size; if that is right, unpack it \
                 first"
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        Ok(count)
    }
}

/// The first bytes of a stream, and a stream that begins with them. (A pipe may give them one by
/// one.)
fn start<R: Read>(mut stream: R) -> io::Result<(Vec<u8>, impl Read + use<R>)> {
    let mut bytes = Vec::with_capacity(MAGIC);
    stream.by_ref().take(MAGIC as u64).read_to_end(&mut bytes)?;
    Ok((bytes.clone(), io::Cursor::new(bytes).chain(stream)))
}

fn kind_of(start: &[u8]) -> ContentKind {
    match start {
        [] => ContentKind::Empty,
        s if s.starts_with(b"\x93NUMPY") => ContentKind::Npy,
        s if s.starts_with(b"PK\x03\x04") || s.starts_with(b"PK\x05\x06") => ContentKind::Npz,
        _ => ContentKind::Text,
    }
}

/// The name of a file as a take: without folder and last extension, which a folder has not.
pub fn take_name(path: &Path) -> String {
    let stem = if path.is_dir() {
        path.file_name()
    } else {
        path.file_stem()
    };
    stem.unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// A slow pipe.
    struct OneByOne(std::collections::VecDeque<u8>);

    impl Read for OneByOne {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let (Some(out), Some(byte)) = (out.first_mut(), self.0.pop_front()) else {
                return Ok(0);
            };
            *out = byte;
            Ok(1)
        }
    }

    #[test]
    fn compressed_streams_are_opened_by_content() {
        let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gz.write_all(b"take,time\n").unwrap();
        let gz = gz.finish().unwrap();
        let zst = zstd::encode_all(&b"take,time\n"[..], 1).unwrap();
        for bytes in [b"take,time\n".to_vec(), gz, zst] {
            let input = Input::new("x", OneByOne(bytes.into())).unwrap();
            assert_eq!(input.kind(), ContentKind::Text);
            assert_eq!(input.read_all(1000).unwrap(), b"take,time\n");
        }
    }

    #[test]
    fn what_unpacks_to_far_more_is_refused() {
        let zeros = std::io::repeat(0).take(UNPACKED + 1);
        let mut packed = flate2::read::GzEncoder::new(zeros, flate2::Compression::fast());
        let mut bytes = Vec::new();
        packed.read_to_end(&mut bytes).unwrap();
        let input = || Input::new("x", io::Cursor::new(bytes.clone())).unwrap();
        let message = input().read_all(1 << 40).unwrap_err().to_string();
        let wanted = "unpacks to more than 100 times its size; if that is right, unpack it first";
        assert_eq!(message, format!("x: {wanted}"));
        // Tables are read from the stream.
        let streamed = io::copy(&mut input().into_reader(), &mut io::sink());
        assert_eq!(streamed.unwrap_err().to_string(), wanted);
    }

    #[test]
    fn kinds_and_limits() {
        let kind = |b: &'static [u8]| {
            let slow = OneByOne(b.iter().copied().collect());
            assert_eq!(
                Input::new("x", slow).unwrap().kind(),
                Input::new("x", b).unwrap().kind()
            );
            Input::new("x", b).unwrap().kind()
        };
        assert_eq!(kind(b""), ContentKind::Empty);
        assert_eq!(kind(b"\x93NUMPY\x01"), ContentKind::Npy);
        assert_eq!(kind(b"PK\x03\x04"), ContentKind::Npz);
        assert!(Input::new("x", &b"12345"[..]).unwrap().read_all(4).is_err());
        assert!(Input::new("x", &b"1234"[..]).unwrap().read_all(4).is_ok());
        assert!(Input::open(Path::new(".")).is_err());
    }

    #[test]
    fn a_folder_has_no_ending() {
        let folder = tempfile::tempdir().unwrap();
        let day = folder.path().join("2024.05.01");
        assert_eq!(take_name(&day), "2024.05");
        std::fs::create_dir(&day).unwrap();
        assert_eq!(take_name(&day), "2024.05.01");
    }
}
