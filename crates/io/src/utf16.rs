//! Texts in UTF-16, as some programs of Windows write them, as UTF-8: all readers of text get them
//! so.

use std::io::{self, BufReader, Read};

/// The byte order of a text in UTF-16.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Utf16 {
    /// The low byte first.
    Little,
    /// The high byte first.
    Big,
}

impl Utf16 {
    /// Whether a file that begins so is a text in UTF-16: by its mark, or since every other byte is
    /// zero and the others are ASCII's.
    pub(crate) fn of(start: &[u8]) -> Option<Utf16> {
        let is_text = |of: usize| {
            let text = |b: &u8| b.is_ascii_graphic() || b.is_ascii_whitespace();
            let pairs = start.chunks_exact(2);
            start.len() >= 8 && pairs.into_iter().all(|p| text(&p[of]) && p[1 - of] == 0)
        };
        match start {
            // Not UTF-32.
            [0xff, 0xfe, 0, 0, ..] => None,
            [0xff, 0xfe, ..] => Some(Utf16::Little),
            [0xfe, 0xff, ..] => Some(Utf16::Big),
            _ if is_text(0) => Some(Utf16::Little),
            _ if is_text(1) => Some(Utf16::Big),
            _ => None,
        }
    }
}

/// A stream of UTF-16, without its mark, as UTF-8.
pub(crate) struct Decoded<R> {
    units: Units<R>,
    /// A unit that was read ahead.
    next: Option<u16>,
    bytes: Vec<u8>,
    at: usize,
}

struct Units<R> {
    reader: BufReader<R>,
    order: Utf16,
}

impl<R: Read> Units<R> {
    /// The next unit; `None` at the end, and for a last byte alone.
    fn next(&mut self) -> io::Result<Option<u16>> {
        let mut pair = [0; 2];
        match self.reader.read_exact(&mut pair) {
            Ok(()) => Ok(Some(match self.order {
                Utf16::Little => u16::from_le_bytes(pair),
                Utf16::Big => u16::from_be_bytes(pair),
            })),
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(e) => Err(e),
        }
    }
}

impl<R: Read> Decoded<R> {
    /// Decodes a stream.
    pub(crate) fn new(stream: R, order: Utf16) -> Decoded<R> {
        let reader = BufReader::with_capacity(1 << 16, stream);
        Decoded {
            units: Units { reader, order },
            next: None,
            bytes: Vec::new(),
            at: 0,
        }
    }

    /// Decodes some characters; those that are none become U+FFFD.
    fn fill(&mut self) -> io::Result<()> {
        self.bytes.clear();
        self.at = 0;
        while self.bytes.len() < 1 << 12 {
            let Some(unit) = self
                .next
                .take()
                .map_or_else(|| self.units.next(), |u| Ok(Some(u)))?
            else {
                break;
            };
            let is_high = (0xd800..0xdc00).contains(&unit);
            let low = if is_high { self.units.next()? } else { None };
            let pair = [unit, low.unwrap_or(0)];
            let units = if low.is_some() { &pair[..] } else { &pair[..1] };
            let decoded = char::decode_utf16(units.iter().copied()).next();
            let character = decoded.and_then(std::result::Result::ok);
            if character.is_none() {
                // What follows half a pair stands for itself.
                self.next = low;
            }
            let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
            if character != '\u{feff}' {
                let mut text = [0; 4];
                self.bytes.extend(character.encode_utf8(&mut text).bytes());
            }
        }
        Ok(())
    }
}

impl<R: Read> Read for Decoded<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.at == self.bytes.len() {
            self.fill()?;
        }
        let count = out.len().min(self.bytes.len() - self.at);
        out[..count].copy_from_slice(&self.bytes[self.at..][..count]);
        self.at += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_both_orders_are_decoded() {
        let text = "PathFileType\t4\n\u{e4}\u{1f600}b";
        for order in [Utf16::Little, Utf16::Big] {
            for mark in ["\u{feff}", ""] {
                let units = format!("{mark}{text}").encode_utf16().collect::<Vec<u16>>();
                let bytes = |u: &u16| match order {
                    Utf16::Little => u.to_le_bytes(),
                    Utf16::Big => u.to_be_bytes(),
                };
                let bytes: Vec<u8> = units.iter().flat_map(bytes).collect();
                assert_eq!(Utf16::of(&bytes[..12]), Some(order));
                let mut back = String::new();
                Decoded::new(&bytes[..], order)
                    .read_to_string(&mut back)
                    .unwrap();
                assert_eq!(back, text);
            }
        }
        let broken = [0x41, 0, 0x00, 0xd8, 0x42, 0, 0x43];
        let mut back = String::new();
        Decoded::new(&broken[..], Utf16::Little)
            .read_to_string(&mut back)
            .unwrap();
        assert_eq!(back, "A\u{fffd}B");
        for other in [
            &b"\x02\x50\x2c\0\x03\0\x01\0"[..],
            b"PathFileType",
            b"",
            b"a\0",
            b"\0\0\0\0\0\0\0\0",
        ] {
            assert_eq!(Utf16::of(other), None);
        }
    }
}
