//! Any CSV record (RFC 4180), one at a time: quoted cells, line ends inside cells, lines that end
//! in CR alone.

use super::super::text::wait_for_data;
use crate::row::Cells;
use crate::{Error, Place};
use csv_core::ReadRecordResult;
use std::io::{self, BufRead, BufReader};

/// A quote that is never closed, of a cell of the record that begins in this line.
#[derive(Debug, thiserror::Error)]
#[error("a cell begins with a quote that is never closed")]
struct Unclosed(u64);

/// The error of a file with that name.
pub(super) fn fault(name: &str, e: io::Error) -> Error {
    let inner = e.get_ref();
    let unclosed = inner.and_then(|e| e.downcast_ref::<Unclosed>());
    let too_long = inner.and_then(|e| e.downcast_ref::<TooLong>());
    let line = unclosed.map(|what| what.0).or(too_long.map(|what| what.0));
    match (line, inner) {
        (Some(line), Some(what)) => Error::data(Place::line(name, line), what.to_string()),
        _ => Error::io(name, e),
    }
}

/// Longer records are refused, bytes, and such with more cells: a quote that is not closed, or no
/// table at all.
const MOST_BYTES: usize = 1 << 24;
const MOST_CELLS: usize = 1 << 20;

/// A record that is too long, and the line that it begins in.
#[derive(Debug, thiserror::Error)]
#[error(
    "a row has more than {MOST_BYTES} bytes or {MOST_CELLS} cells: is it a table, and are its \
     quotes closed?"
)]
struct TooLong(u64);

/// Reads records one at a time; between two records, the buffer may be parsed ahead.
pub(super) struct Records {
    reader: BufReader<Box<dyn BufRead>>,
    core: csv_core::Reader,
    /// The line that the next byte is in, counted from 1.
    pub(super) line: u64,
    ended: bool,
    text: Vec<u8>,
    ends: Vec<usize>,
}

impl Records {
    pub(super) fn new(reader: BufReader<Box<dyn BufRead>>) -> Records {
        Records {
            reader,
            core: csv_core::Reader::new(),
            line: 1,
            ended: false,
            text: vec![0; 1 << 10],
            ends: vec![0; 1 << 7],
        }
    }

    /// The next record; `false` at the end.
    pub(super) fn read(&mut self, cells: &mut Cells) -> io::Result<bool> {
        cells.clear();
        if self.ended {
            return Ok(false);
        }
        self.pass_blank_lines().inspect_err(|_| self.ended = true)?;
        let line = self.line;
        let (mut text, mut ends, mut has_begun) = (0, 0, false);
        self.core.set_line(line);
        loop {
            let there = wait_for_data(&mut self.reader).and_then(|()| self.reader.fill_buf());
            let there = there.inspect_err(|_| self.ended = true)?;
            // A last line may do without its end. Within quotes an end of line is part of the cell.
            let is_last = has_begun && there.is_empty();
            let there = if is_last { b"\n" } else { there };
            let (result, read, more, cells_more) =
                self.core
                    .read_record(there, &mut self.text[text..], &mut self.ends[ends..]);
            if !is_last {
                let new = there.strip_prefix(b"\xef\xbb\xbf").unwrap_or(there);
                let new = &new[..new.len().min(read)];
                has_begun |= new.iter().any(|b| !matches!(b, b'\r' | b'\n'));
                self.reader.consume(read);
                self.line = self.core.line();
            }
            (text, ends) = (text + more, ends + cells_more);
            match result {
                ReadRecordResult::InputEmpty if is_last => {
                    self.ended = true;
                    return Err(io::Error::new(io::ErrorKind::InvalidData, Unclosed(line)));
                }
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::OutputFull if text < MOST_BYTES => {
                    self.text.resize(2 * self.text.len(), 0);
                }
                ReadRecordResult::OutputEndsFull if ends < MOST_CELLS => {
                    self.ends.resize(2 * self.ends.len(), 0);
                }
                ReadRecordResult::OutputFull | ReadRecordResult::OutputEndsFull => {
                    self.ended = true;
                    return Err(io::Error::new(io::ErrorKind::InvalidData, TooLong(line)));
                }
                ReadRecordResult::Record => {
                    cells.set_fields(&self.text[..text], &self.ends[..ends], line);
                    return Ok(true);
                }
                ReadRecordResult::End => {
                    self.ended = true;
                    return Ok(false);
                }
            }
        }
    }

    /// Ends of lines before the next record: of the one that the record before ended with, its LF
    /// may be left.
    fn pass_blank_lines(&mut self) -> io::Result<()> {
        loop {
            wait_for_data(&mut self.reader)?;
            let there = self.reader.fill_buf()?;
            let blank = there.iter().take_while(|b| matches!(b, b'\r' | b'\n'));
            let (bytes, line_feeds) = blank.fold((0, 0), |(all, feeds), b| {
                (all + 1, feeds + u64::from(*b == b'\n'))
            });
            if bytes == 0 {
                return Ok(());
            }
            self.line += line_feeds;
            self.reader.consume(bytes);
        }
    }

    /// The buffered bytes behind the last record, and the line that they begin in. Waits only if
    /// there are none. `None` at the end.
    pub(super) fn waiting(&mut self) -> io::Result<Option<(&[u8], u64)>> {
        if self.ended {
            return Ok(None);
        }
        wait_for_data(&mut self.reader)?;
        Ok(Some((self.reader.buffer(), self.line)))
    }

    /// The buffered bytes, without waiting.
    pub(super) fn there(&self) -> &[u8] {
        self.reader.buffer()
    }

    /// Consumes `bytes` of the buffer; the caller adds their line feeds to [`Records::line`].
    pub(super) fn pass(&mut self, bytes: usize) {
        self.reader.consume(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    /// The number of records, or the error.
    fn count(text: &'static str, at_once: usize) -> Result<usize, String> {
        let reader: Box<dyn BufRead> = Box::new(text.as_bytes());
        let mut records = Records::new(BufReader::with_capacity(at_once, reader));
        let (mut cells, mut n) = (Cells::default(), 0);
        while records
            .read(&mut cells)
            .map_err(|e| fault("t", e).to_string())?
        {
            n += 1;
        }
        Ok(n)
    }

    #[test]
    fn a_record_without_end_is_refused_before_it_fills_memory() {
        for start in ["a,b\n", "a,b\n\"", "a,"] {
            let reader = std::io::Cursor::new(start).chain(std::io::repeat(b'x'));
            let reader: Box<dyn BufRead> = Box::new(BufReader::new(reader));
            let mut records = Records::new(BufReader::new(reader));
            let mut cells = Cells::default();
            let first = loop {
                if let Err(e) = records.read(&mut cells) {
                    break fault("t", e).to_string();
                }
            };
            assert!(first.contains("more than"), "{first}");
        }
    }

    #[test]
    fn an_unclosed_quote_is_an_error() {
        for at_once in [1, 2, 3, 64] {
            for (text, records) in [
                ("a,b\n1,\"2\"", 2),
                ("a,b\n1,\"2\"\"\"", 2),
                ("a,b\n1,\"2\n3\"\n", 2),
                ("a,b\n1,2\" 3", 2),
                ("", 0),
            ] {
                assert_eq!(count(text, at_once), Ok(records), "{text}");
            }
            for text in [
                "a,b\n1,\"2\n3,4\n5,6\n",
                "a,b\n1,\"2",
                "a,b\n1,\"2\"\"",
                "\"",
            ] {
                let message = count(text, at_once).unwrap_err();
                assert!(message.contains("never closed"), "{message}");
            }
        }
        assert!(count("a,b\n\n1,\"2\n", 9).unwrap_err().starts_with("t:3: "));
        assert_eq!(count("\u{feff}\n", 64), Ok(0));
    }
}
