//! Lines with any ending, parsing and formatting of numbers.

pub use posing_core::error::excerpt;

use crate::{Error, Place, Result};
use std::io::{BufRead, Read};

/// The longest line a text format may have. (A BVH with all its frames on one line is read
/// elsewhere.)
pub(crate) const MAX_LINE_BYTES: usize = 1 << 20;

/// The byte ^Z, with which programs of DOS end a text.
const DOS_END: u8 = 0x1a;

/// The byte that ends the lines of a text: a line feed, but CR where there is no other in the first
/// [`MAX_LINE_BYTES`].
pub(crate) fn line_end(text: &[u8]) -> u8 {
    let start = &text[..text.len().min(MAX_LINE_BYTES + 1)];
    if !start.contains(&b'\n') && start.contains(&b'\r') {
        b'\r'
    } else {
        b'\n'
    }
}

/// Lines of a text, numbered from 1, without their ending (LF, CRLF or none, CR alone where [asked
/// for](Lines::any_end)) and without a byte-order mark. A line of ^Z alone, the mark of DOS, is the
/// end.
///
/// Bytes that are no UTF-8 are replaced: old files have Latin-1 names in their comments.
pub(crate) struct Lines<R> {
    reader: R,
    /// The name that messages use.
    pub name: String,
    /// The number of the line last read.
    pub number: u64,
    /// Whether the line last read had a line break at its end, which the last line of a file may
    /// lack.
    pub whole: bool,
    /// The byte that ends a line; `None` before the first line of a text that may end its lines in
    /// CR alone.
    end: Option<u8>,
    /// What of such a text was read ahead, and how much of it was passed on.
    ahead: (Vec<u8>, usize),
    buffer: Vec<u8>,
    text: String,
}

impl<R: BufRead> Lines<R> {
    /// Lines of `reader`.
    pub(crate) fn new(name: impl Into<String>, reader: R) -> Self {
        Lines {
            reader,
            name: name.into(),
            number: 0,
            whole: true,
            end: Some(b'\n'),
            ahead: (Vec::new(), 0),
            buffer: Vec::new(),
            text: String::new(),
        }
    }

    /// Accepts lines that end in CR alone too. [`Lines::waiting`] is not for them.
    pub(crate) fn any_end(mut self) -> Self {
        self.end = None;
        self
    }

    /// The next line, or `None` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: a line longer than [`MAX_LINE_BYTES`].
    pub(crate) fn next_line(&mut self) -> Result<Option<&str>> {
        let end = match self.end {
            Some(end) => end,
            None => {
                self.read_until(b'\n')?;
                std::mem::swap(&mut self.ahead.0, &mut self.buffer);
                *self.end.insert(line_end(&self.ahead.0))
            }
        };
        if self.read_until(end)? == 0 {
            return Ok(None);
        }
        self.number += 1;
        if self.buffer.len() > MAX_LINE_BYTES {
            return Err(Error::data(
                self.here(),
                format!("the line is longer than {MAX_LINE_BYTES} bytes"),
            ));
        }
        let is_whole = self.buffer.last() == Some(&end);
        let is_mark = |b: &u8| *b == DOS_END;
        if !is_whole
            || self
                .buffer
                .iter()
                .all(|b| is_mark(b) || b.is_ascii_whitespace())
        {
            let marks = self.buffer.iter().filter(|b| is_mark(b)).count();
            if marks > 0 {
                self.buffer.retain(|b| !is_mark(b));
            }
            if marks > 0 && self.buffer.trim_ascii().is_empty() {
                return Ok(None);
            }
        }
        self.whole = is_whole;
        while matches!(self.buffer.last(), Some(b'\n' | b'\r')) {
            self.buffer.pop();
        }
        let mut bytes = &self.buffer[..];
        if self.number == 1 {
            bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        }
        self.text.clear();
        match std::str::from_utf8(bytes) {
            Ok(text) => self.text.push_str(text),
            Err(_) => self.text.push_str(&String::from_utf8_lossy(bytes)),
        }
        Ok(Some(&self.text))
    }

    /// The next line in which not all characters are blank, or `None` at the end.
    ///
    /// # Errors
    /// Fails as [`Lines::next_line`] does.
    pub(crate) fn next_filled(&mut self, is_blank: impl Fn(char) -> bool) -> Result<Option<&str>> {
        while self.next_line()?.is_some() {
            if !self.text.chars().all(&is_blank) {
                return Ok(Some(&self.text));
            }
        }
        Ok(None)
    }

    /// Reads a line with its end, or the start of one that is too long, into the buffer; how many
    /// bytes.
    fn read_until(&mut self, end: u8) -> Result<usize> {
        self.buffer.clear();
        let (ahead, at) = (&self.ahead.0, self.ahead.1);
        let rest = &ahead[at..];
        let line = rest.iter().position(|b| *b == end);
        self.buffer
            .extend_from_slice(&rest[..line.map_or(rest.len(), |i| i + 1)]);
        self.ahead.1 += self.buffer.len();
        if line.is_none() {
            self.ahead = (Vec::new(), 0);
            let limit = (MAX_LINE_BYTES + 1).saturating_sub(self.buffer.len());
            let mut reader = self.reader.by_ref().take(limit as u64);
            let read = reader.read_until(end, &mut self.buffer);
            read.map_err(|e| Error::io(&self.name, e))?;
        }
        Ok(self.buffer.len())
    }

    /// The buffered bytes; waits only if there are none.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails.
    pub(crate) fn waiting(&mut self) -> Result<&[u8]> {
        wait_for_data(&mut self.reader).map_err(|e| Error::io(&self.name, e))?;
        self.reader.fill_buf().map_err(|e| Error::io(&self.name, e))
    }

    /// Consumes `bytes` of the buffer, which are `lines` whole lines.
    pub(crate) fn pass(&mut self, bytes: usize, lines: u64) {
        self.reader.consume(bytes);
        self.number += lines;
    }

    /// The place of the line last read.
    pub(crate) fn here(&self) -> Place {
        Place::line(&self.name, self.number)
    }
}

/// Waits for the reader's buffer to hold something, unless it ended. (A call that was only
/// interrupted is repeated.)
pub(crate) fn wait_for_data(reader: &mut impl BufRead) -> std::io::Result<()> {
    loop {
        match reader.fill_buf() {
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            other => return other.map(drop),
        }
    }
}

/// The finite number that `text` begins with, and its length in bytes. [`parse_number`] reads the
/// same number.
pub(crate) fn finite_prefix(text: &[u8]) -> Option<(f64, usize)> {
    let (value, length) = fast_float2::parse_partial::<f64, _>(text).ok()?;
    value.is_finite().then_some((value, length))
}

/// A finite number, or what stands there instead.
///
/// # Errors
/// [`Error::Unfit`]: no number, or an infinite one.
pub fn parse_number(text: &str) -> Result<f64> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        Ok(_) => Err(format!("expected a finite number, found \"{}\"", excerpt(text)).into()),
        Err(_) => Err(format!("expected a number, found \"{}\"", excerpt(text)).into()),
    }
}

/// No coordinate or length is further from zero, centimeters: a larger one is damage, and its
/// square would not be finite much longer.
pub(crate) const MAX_COORDINATE: f64 = 1e12;

/// A length in centimeters that is no damage, or what is wrong with it.
///
/// # Errors
/// [`Error::Unfit`]: the length is beyond [`MAX_COORDINATE`].
pub(crate) fn check_length(centimeters: f64) -> Result<f64> {
    if centimeters.abs() <= MAX_COORDINATE {
        Ok(centimeters)
    } else {
        Err(
            format!("{centimeters:e} cm is too large: expected at most {MAX_COORDINATE:e} cm")
                .into(),
        )
    }
}

/// A number whose decimals may stand behind a comma.
pub(crate) fn decimal(cell: &str) -> String {
    cell.replace(',', ".")
}

/// Appends the shortest text that reads back to `value`; nothing for NaN (an empty cell is a
/// missing value).
pub fn push_f64(out: &mut Vec<u8>, value: f64) {
    push_shortest(out, value);
}

/// Like [`push_f64`], the shortest text that is read as the same single precision number.
pub fn push_f32(out: &mut Vec<u8>, value: f32) {
    push_shortest(out, value);
}

/// Appends a whole number.
pub fn push_integer(out: &mut Vec<u8>, mut value: u32) {
    let mut digits = [0; 10];
    let mut from = digits.len();
    loop {
        from -= 1;
        digits[from] = b'0' + (value % 10) as u8;
        value /= 10;
        if value == 0 {
            return out.extend_from_slice(&digits[from..]);
        }
    }
}

fn push_shortest(out: &mut Vec<u8>, value: impl zmij::Float + Into<f64> + Copy) {
    let wide: f64 = value.into();
    if wide.is_nan() {
        return;
    }
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(value);
    let start = out.len();
    out.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
    // Large numbers have been 1e20, not 1e+20, from the first table on.
    if wide.abs() >= 1e15
        && let Some(plus) = out[start..].iter().position(|&c| c == b'+')
    {
        out.remove(start + plus);
    }
}

/// A standard deviation with five significant figures: more is noise of the conversion.
#[doc(hidden)]
pub fn significant(value: f64) -> String {
    number_cell(format!("{value:.4e}").parse().unwrap_or(value))
}

/// A number as a cell; empty for NaN.
#[doc(hidden)]
pub fn number_cell(value: f64) -> String {
    let mut text = Vec::new();
    push_f64(&mut text, value);
    String::from_utf8(text).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_written_as_they_are() {
        for value in [0, 9, 10, 999, 1_000_000, u32::MAX] {
            let mut out = b"a".to_vec();
            push_integer(&mut out, value);
            assert_eq!(out, format!("a{value}").into_bytes());
        }
    }

    #[test]
    fn lines_of_any_ending() {
        let mut lines = Lines::new("x", &b"\xef\xbb\xbfa b\r\n\n# \xf6\nlast"[..]);
        let mut seen = Vec::new();
        while let Some(line) = lines.next_line().unwrap() {
            seen.push(line.to_string());
            assert_eq!(lines.whole, lines.number < 4);
        }
        assert_eq!(seen, ["a b", "", "# \u{fffd}", "last"]);
        assert_eq!(lines.here().to_string(), "x:4");
    }

    #[test]
    fn lines_may_end_in_cr_alone_and_a_file_in_a_dos_mark() {
        for (text, wanted) in [
            (&b"a\r\rb\r"[..], &["a", "", "b"][..]),
            (b"a\r\r\nb\n\x1a", &["a", "b"]),
            (b"a\nb\x1a", &["a", "b"]),
            (b"a\nb\n\x1a\x1a\r\nc", &["a", "b"]),
        ] {
            // A slow pipe.
            let slow = std::io::BufReader::with_capacity(2, text);
            let mut lines = Lines::new("x", slow).any_end();
            let mut seen = Vec::new();
            while let Some(line) = lines.next_line().unwrap() {
                seen.push(line.to_string());
            }
            assert_eq!(seen, wanted, "{text:?}");
        }
    }

    #[test]
    fn an_endless_line_is_refused() {
        let long = vec![b'x'; MAX_LINE_BYTES + 10];
        assert!(Lines::new("x", &long[..]).next_line().is_err());
    }

    #[test]
    fn numbers_are_short_and_read_back() {
        for v in [
            0.0,
            -0.0,
            1.0,
            0.1,
            1e300,
            -2.5e-12,
            123456.75,
            f64::MIN_POSITIVE,
        ] {
            let mut out = Vec::new();
            push_f64(&mut out, v);
            let back: f64 = std::str::from_utf8(&out).unwrap().parse().unwrap();
            assert_eq!(back.to_bits(), v.to_bits());
        }
        let mut out = Vec::new();
        push_f64(&mut out, 3.0);
        push_f64(&mut out, f64::NAN);
        assert_eq!(out, b"3");
        for (value, text) in [
            (1e15, "1000000000000000"),
            (1e16, "1e16"),
            (-2.5e300, "-2.5e300"),
            (1e-7, "1e-7"),
        ] {
            out.truncate(1);
            push_f64(&mut out, value);
            assert_eq!(&out[1..], text.as_bytes());
        }
        out.clear();
        push_f32(&mut out, 1e30);
        push_f32(&mut out, 45.1978);
        assert_eq!(out, b"1e3045.1978");
    }

    #[test]
    fn messages_stay_on_one_line() {
        assert_eq!(
            parse_number("a\nb").unwrap_err().to_string(),
            "expected a number, found \"a\u{fffd}b\""
        );
        assert!(
            parse_number("inf")
                .unwrap_err()
                .to_string()
                .contains("finite")
        );
        assert!(parse_number("1e999").is_err() && parse_number("").is_err());
        assert!(excerpt(&"x".repeat(100)).chars().count() == 41);
    }

    proptest::proptest! {
        #[test]
        fn a_prefix_is_the_number_at_the_start(
            value in proptest::num::f64::ANY, digits in "[0-9]{1,30}",
            exponent in -340..310i32, behind in "[,; \n#x_]?",
        ) {
            let decimal = format!("-{digits}.{digits}e{exponent}");
            for text in [value.to_string(), format!("{value:e}"), digits, decimal] {
                let whole = parse_number(&text).ok().map(|v| (v.to_bits(), text.len()));
                let prefix = finite_prefix(format!("{text}{behind}").as_bytes());
                proptest::prop_assert_eq!(prefix.map(|(v, n)| (v.to_bits(), n)), whole);
            }
        }
    }
}
