//! The regular rows of a table: the right number of cells, none quoted, numbers where numbers
//! belong.

use crate::block_reader::{BlockFormat, Parsed};
use crate::columns::Columns;
use crate::text::{check_length, finite_prefix};
use memchr::memchr;
use std::ops::Range;

/// The content of a column.
#[derive(Clone, Copy)]
enum Column {
    /// This coordinate of the frame.
    Coordinate(usize),
    Time,
    /// Text that is kept as it is.
    Other,
}

/// The columns of a table.
pub(super) struct RowFormat {
    columns: Vec<Column>,
    /// The number of coordinates of a frame.
    width: usize,
    has_time: bool,
}

/// The rows of a piece.
#[derive(Default)]
pub(super) struct Rows {
    rows: Vec<Span>,
    xyz: Vec<f64>,
    time: Vec<f64>,
    /// The ends of each row's cells, from the start of the row.
    ends: Vec<usize>,
}

struct Span {
    /// The text of the row, in the piece.
    text: Range<usize>,
    /// The line feeds of the piece before the row.
    line: u64,
}

/// A row of a piece.
pub(super) struct PlainRow<'a> {
    pub(super) xyz: &'a [f64],
    pub(super) time: Option<f64>,
    /// The text of the row, in the piece.
    pub(super) text: Range<usize>,
    pub(super) ends: &'a [usize],
    /// The line feeds of the piece before the row.
    pub(super) line: u64,
}

impl RowFormat {
    pub(super) fn new(columns: &Columns) -> RowFormat {
        let mut kinds = vec![Column::Other; columns.names.len()];
        for (point, coordinates) in columns.coordinates.iter().enumerate() {
            for (axis, column) in coordinates.iter().enumerate() {
                if let Some(column) = column {
                    kinds[*column] = Column::Coordinate(3 * point + axis);
                }
            }
        }
        if let Some(column) = columns.time {
            kinds[column] = Column::Time;
        }
        RowFormat {
            columns: kinds,
            width: columns.width(),
            has_time: columns.time.is_some(),
        }
    }

    /// Row `index` of a piece; `None` behind the last.
    pub(super) fn row<'a>(&self, rows: &'a Rows, index: usize) -> Option<PlainRow<'a>> {
        let span = rows.rows.get(index)?;
        let cells = self.columns.len();
        Some(PlainRow {
            xyz: &rows.xyz[index * self.width..][..self.width],
            time: self.has_time.then(|| rows.time[index]),
            text: span.text.clone(),
            ends: &rows.ends[index * cells..][..cells],
            line: span.line,
        })
    }

    /// Parses the cells of the row that starts at `start`; the end of its last cell.
    fn parse_row(&self, text: &[u8], start: usize, rows: &mut Rows) -> Option<usize> {
        let first = rows.xyz.len() - self.width;
        let mut at = start;
        for (i, column) in self.columns.iter().enumerate() {
            if i > 0 {
                if text[at] != b',' {
                    return None;
                }
                at += 1;
            }
            match *column {
                Column::Coordinate(n) => {
                    let (value, length) = coordinate(&text[at..])?;
                    rows.xyz[first + n] = value;
                    at += length;
                }
                Column::Time => {
                    let (value, length) = finite_prefix(&text[at..])?;
                    rows.time.push(value);
                    at += length;
                }
                Column::Other => at += unquoted(&text[at..]),
            }
            rows.ends.push(at - start);
        }
        match &text[at..] {
            [b'\n', ..] | [b'\r', b'\n', ..] => Some(at),
            _ => None,
        }
    }
}

impl BlockFormat for RowFormat {
    type Records = Rows;
    type Start = ();

    fn cut(&self, text: &[u8], from: usize) -> Option<(usize, ())> {
        let end = from + memchr(b'\n', text.get(from..)?)? + 1;
        (end < text.len()).then_some((end, ()))
    }

    fn parse(&self, text: &[u8], (): (), rows: &mut Rows) -> Parsed {
        rows.rows.clear();
        rows.xyz.clear();
        rows.time.clear();
        rows.ends.clear();
        let mut parsed = Parsed::default();
        while parsed.bytes < text.len() {
            let at = parsed.bytes;
            // A blank line is no row.
            let blank = match &text[at..] {
                [b'\n', ..] => 1,
                [b'\r', b'\n', ..] => 2,
                _ => 0,
            };
            if blank > 0 {
                parsed.line_feeds += 1;
                parsed.bytes += blank;
                continue;
            }
            let count = rows.rows.len();
            rows.xyz.resize((count + 1) * self.width, f64::NAN);
            let Some(end) = self.parse_row(text, at, rows) else {
                parsed.is_irregular = true;
                break;
            };
            rows.rows.push(Span {
                text: at..end,
                line: parsed.line_feeds,
            });
            parsed.line_feeds += 1;
            parsed.bytes = end + if text[end] == b'\n' { 1 } else { 2 };
        }
        parsed
    }
}

/// The coordinate that `text` begins with, and its length: NaN for an empty cell or `NaN`.
fn coordinate(text: &[u8]) -> Option<(f64, usize)> {
    match text {
        [b',' | b'\n' | b'\r', ..] => Some((f64::NAN, 0)),
        [b'n' | b'N', b'a' | b'A', b'n' | b'N', ..] => Some((f64::NAN, 3)),
        _ => {
            let (value, length) = finite_prefix(text)?;
            Some((check_length(value).ok()?, length))
        }
    }
}

/// The length of the cell that `text` begins with, up to a quote.
fn unquoted(text: &[u8]) -> usize {
    let goes_on = |c: &&u8| !matches!(c, b',' | b'\n' | b'\r' | b'"');
    text.iter().take_while(goes_on).count()
}
