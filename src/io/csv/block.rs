//! The plain rows at the start of a stretch of a table, read on all threads.
//!
//! Only what is as plain as tables mostly are is taken: rows of the right number of cells, none quoted, numbers where
//! numbers belong. At anything else, and at the end of what is there, it ends before that row, and the careful reader
//! goes on from there: it alone says what is wrong.

use super::super::text::{PIECE, check_length, finite_prefix};
use crate::io::columns::Columns;
use memchr::{memchr, memrchr};
use rayon::prelude::*;
use std::ops::Range;

/// What a column holds.
#[derive(Clone, Copy)]
enum Column {
    /// This number of the frame.
    Number(usize),
    Time,
    /// Whatever it may be.
    Other,
}

/// Reads stretches of one table.
pub(super) struct Blocks {
    columns: Vec<Column>,
    /// How many numbers a frame has.
    width: usize,
    timed: bool,
    pieces: Vec<Piece>,
    /// How many pieces hold what was read last.
    count: usize,
    /// The piece and the row in it to be handed out next.
    next: (usize, usize),
    /// [`PIECE`]; smaller in tests.
    pub(super) piece: usize,
}

/// What was taken of a stretch.
pub(super) struct Taken {
    pub(super) bytes: usize,
    /// Line feeds in them.
    pub(super) line_feeds: u64,
    /// Whether what follows is not plain.
    pub(super) odd: bool,
}

/// A part of a stretch and the rows in it.
#[derive(Default)]
struct Piece {
    range: Range<usize>,
    rows: Vec<Span>,
    xyz: Vec<f64>,
    time: Vec<f64>,
    /// Of each row where its cells end, counted from its start.
    ends: Vec<usize>,
    bytes: usize,
    line_feeds: u64,
    odd: bool,
}

/// One row of a piece.
struct Span {
    /// Where its text stands in the stretch.
    text: Range<usize>,
    /// Line feeds before it, in the piece; then its line in the table.
    line: u64,
}

/// One row handed out.
pub(super) struct PlainRow<'a> {
    pub(super) xyz: &'a [f64],
    pub(super) time: Option<f64>,
    /// Where its text stands in the stretch.
    pub(super) text: Range<usize>,
    pub(super) ends: &'a [usize],
    pub(super) line: u64,
}

impl Blocks {
    pub(super) fn new(columns: &Columns) -> Blocks {
        let mut kinds = vec![Column::Other; columns.names.len()];
        for (point, place) in columns.coordinates.iter().enumerate() {
            for (axis, column) in place.iter().enumerate() {
                if let Some(column) = column {
                    kinds[*column] = Column::Number(3 * point + axis);
                }
            }
        }
        if let Some(column) = columns.time {
            kinds[column] = Column::Time;
        }
        Blocks {
            columns: kinds,
            width: columns.width(),
            timed: columns.time.is_some(),
            pieces: Vec::new(),
            count: 0,
            next: (0, 0),
            piece: PIECE,
        }
    }

    /// Reads the plain rows at the start of `text`, of which line `line` is the first; [`Blocks::next_row`] hands them out.
    pub(super) fn read(&mut self, text: &[u8], line: u64) -> Taken {
        let text = &text[..memrchr(b'\n', text).map_or(0, |at| at + 1)];
        let mut pieces = std::mem::take(&mut self.pieces);
        let count = split(text, self.piece, &mut pieces);
        match &mut pieces[..count] {
            [one] => self.piece(text, one),
            all => all.par_iter_mut().for_each(|piece| self.piece(text, piece)),
        }
        let (mut bytes, mut line_feeds, mut odd) = (0, 0, false);
        self.count = 0;
        for piece in &mut pieces[..count] {
            (piece.rows.iter_mut()).for_each(|row| row.line += line + line_feeds);
            line_feeds += piece.line_feeds;
            bytes += piece.bytes;
            odd = piece.odd;
            self.count += 1;
            if odd {
                break;
            }
        }
        self.pieces = pieces;
        self.next = (0, 0);
        Taken {
            bytes,
            line_feeds,
            odd,
        }
    }

    /// The next row of what was read last.
    pub(super) fn next_row(&mut self) -> Option<PlainRow<'_>> {
        while self.next.0 < self.count && self.next.1 == self.pieces[self.next.0].rows.len() {
            self.next = (self.next.0 + 1, 0);
        }
        if self.next.0 == self.count {
            return None;
        }
        let (piece, row) = (&self.pieces[self.next.0], self.next.1);
        self.next.1 += 1;
        let (cells, span) = (self.columns.len(), &piece.rows[row]);
        Some(PlainRow {
            xyz: &piece.xyz[row * self.width..][..self.width],
            time: self.timed.then(|| piece.time[row]),
            text: span.text.clone(),
            ends: &piece.ends[row * cells..][..cells],
            line: span.line,
        })
    }

    /// Reads the rows of a piece.
    fn piece(&self, text: &[u8], piece: &mut Piece) {
        let range = piece.range.clone();
        piece.clear();
        let text = &text[..range.end];
        let mut at = range.start;
        while at < text.len() {
            // A blank line is no row.
            let blank = match &text[at..] {
                [b'\n', ..] => 1,
                [b'\r', b'\n', ..] => 2,
                _ => 0,
            };
            if blank > 0 {
                at += blank;
                piece.line_feeds += 1;
                piece.bytes = at - range.start;
                continue;
            }
            let rows = piece.rows.len();
            piece.xyz.resize((rows + 1) * self.width, f64::NAN);
            let Some(end) = self.row(text, at, piece) else {
                piece.xyz.truncate(rows * self.width);
                piece.odd = true;
                return;
            };
            let line = piece.line_feeds;
            piece.rows.push(Span {
                text: at..end,
                line,
            });
            // What stands behind the row: LF or CR LF.
            piece.line_feeds += 1;
            at = end + if text[end] == b'\n' { 1 } else { 2 };
            piece.bytes = at - range.start;
        }
    }

    /// Reads the cells of the row that starts at `start`; where its last one ends.
    fn row(&self, text: &[u8], start: usize, piece: &mut Piece) -> Option<usize> {
        let first = piece.xyz.len() - self.width;
        let mut at = start;
        for (i, column) in self.columns.iter().enumerate() {
            if i > 0 {
                if text[at] != b',' {
                    return None;
                }
                at += 1;
            }
            match *column {
                Column::Number(n) => {
                    let (value, length) = coordinate(&text[at..])?;
                    piece.xyz[first + n] = value;
                    at += length;
                }
                Column::Time => {
                    let (value, length) = finite_prefix(&text[at..])?;
                    piece.time.push(value);
                    at += length;
                }
                Column::Other => at += other(&text[at..]),
            }
            piece.ends.push(at - start);
        }
        match &text[at..] {
            [b'\n', ..] | [b'\r', b'\n', ..] => Some(at),
            _ => None,
        }
    }
}

impl Piece {
    /// Forgets the rows, keeps the memory.
    fn clear(&mut self) {
        self.rows.clear();
        self.xyz.clear();
        self.time.clear();
        self.ends.clear();
        (self.bytes, self.line_feeds, self.odd) = (0, 0, false);
    }
}

/// The coordinate that `text` begins with and its length: NaN for an empty cell or `NaN`.
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

/// How long the cell is that `text` begins with; a quoted one is none.
fn other(text: &[u8]) -> usize {
    let goes_on = |c: &&u8| !matches!(c, b',' | b'\n' | b'\r' | b'"');
    text.iter().take_while(goes_on).count()
}

/// Cuts whole lines behind line feeds, each piece at least `size` bytes long; how many pieces there are.
fn split(text: &[u8], size: usize, pieces: &mut Vec<Piece>) -> usize {
    let (mut start, mut count) = (0, 0);
    while start < text.len() {
        let from = text.get(start + size..).unwrap_or_default();
        let end = memchr(b'\n', from).map_or(text.len(), |at| start + size + at + 1);
        if pieces.len() == count {
            pieces.push(Piece::default());
        }
        pieces[count].range = start..end;
        count += 1;
        start = end;
    }
    count
}
