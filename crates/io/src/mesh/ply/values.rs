//! The values of a PLY file one after the other, as text or binary.

use super::super::super::text::{Lines, excerpt};
use super::header::{Element, Kind};
use crate::{Error, Place, Result};

/// A reader of rows.
pub(super) trait Values {
    /// Whether the file can hold the rows of an element, or what is wrong.
    fn check_size(&self, element: &Element) -> Result<()>;
    /// Begins a row.
    fn start_row(&mut self) -> Result<()>;
    /// The next value of the row.
    fn value(&mut self, kind: Kind) -> Result<f64>;
    /// Ends a row.
    fn end_row(&self) -> Result<()>;
    /// Where the row begun last is.
    fn place(&self, element: &Element, row: u64) -> Place;
    /// Ends the file.
    fn finish(&mut self) -> Result<()>;
}

/// Rows of text, one a line.
pub(super) struct TextValues<'a> {
    lines: Lines<&'a [u8]>,
    row: Vec<f64>,
    next: usize,
}

impl<'a> TextValues<'a> {
    pub(super) fn new(lines: Lines<&'a [u8]>) -> Self {
        TextValues {
            lines,
            row: Vec::new(),
            next: 0,
        }
    }

    /// Reads the next line that is not blank; `false` at the end.
    fn read_line(&mut self) -> Result<bool> {
        self.row.clear();
        self.next = 0;
        while let Some(line) = self.lines.next_line()? {
            for word in line.split_ascii_whitespace() {
                // Not finite numbers may be normals or the like; coordinates are checked later.
                let Ok(value) = word.parse() else {
                    let what = format!("expected a number, found \"{}\"", excerpt(word));
                    return Err(Error::data(self.lines.here(), what));
                };
                self.row.push(value);
            }
            if !self.row.is_empty() {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

impl Values for TextValues<'_> {
    fn check_size(&self, _: &Element) -> Result<()> {
        Ok(())
    }

    fn start_row(&mut self) -> Result<()> {
        if self.read_line()? {
            return Ok(());
        }
        let what = "ends before all the rows that its header counts";
        Err(Error::data(self.lines.here(), what))
    }

    fn value(&mut self, _: Kind) -> Result<f64> {
        let value = self.row.get(self.next);
        self.next += 1;
        let too_few = || format!("has only {} values", self.row.len());
        Ok(value.copied().ok_or_else(too_few)?)
    }

    fn end_row(&self) -> Result<()> {
        let (expected, found) = (self.next, self.row.len());
        if expected == found {
            return Ok(());
        }
        Err(format!("expected {expected} values, found {found}").into())
    }

    fn place(&self, _: &Element, _: u64) -> Place {
        self.lines.here()
    }

    fn finish(&mut self) -> Result<()> {
        if self.read_line()? {
            let what = "has more rows than its header counts";
            return Err(Error::data(self.lines.here(), what));
        }
        Ok(())
    }
}

/// Binary rows.
pub(super) struct BinaryValues<'a> {
    pub(super) name: &'a str,
    pub(super) rest: &'a [u8],
    pub(super) big_endian: bool,
}

impl BinaryValues<'_> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let Some((bytes, rest)) = self.rest.split_first_chunk() else {
            return Err("the file ends inside it".into());
        };
        self.rest = rest;
        let mut bytes: [u8; N] = *bytes;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl Values for BinaryValues<'_> {
    fn check_size(&self, element: &Element) -> Result<()> {
        let (count, left) = (element.count, self.rest.len());
        if count.saturating_mul(element.smallest_row()) <= left as u64 {
            return Ok(());
        }
        let place = Place::file(self.name).part(excerpt(&element.name));
        let what = format!("{left} bytes are too few for the {count} rows that the header counts");
        Err(Error::data(place, what))
    }

    fn start_row(&mut self) -> Result<()> {
        Ok(())
    }

    fn value(&mut self, kind: Kind) -> Result<f64> {
        Ok(match kind {
            Kind::I8 => f64::from(i8::from_le_bytes(self.bytes()?)),
            Kind::U8 => f64::from(u8::from_le_bytes(self.bytes()?)),
            Kind::I16 => f64::from(i16::from_le_bytes(self.bytes()?)),
            Kind::U16 => f64::from(u16::from_le_bytes(self.bytes()?)),
            Kind::I32 => f64::from(i32::from_le_bytes(self.bytes()?)),
            Kind::U32 => f64::from(u32::from_le_bytes(self.bytes()?)),
            Kind::F32 => f64::from(f32::from_le_bytes(self.bytes()?)),
            Kind::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }

    fn end_row(&self) -> Result<()> {
        Ok(())
    }

    fn place(&self, element: &Element, row: u64) -> Place {
        Place::file(self.name).part(format!("{} {row}", excerpt(&element.name)))
    }

    fn finish(&mut self) -> Result<()> {
        if self.rest.trim_ascii().is_empty() {
            return Ok(());
        }
        let what = "has more bytes than its header counts";
        Err(Error::data(Place::file(self.name), what))
    }
}
