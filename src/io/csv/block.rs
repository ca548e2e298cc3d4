//! The plain rows at the start of a stretch of a table, read on all threads.
//!
//! Only what is as plain as tables mostly are is taken: rows of the right number of cells, none quoted, numbers where
//! numbers belong. At anything else, and at the end of what is there, it ends before that row, and the careful reader
//! goes on from there: it alone says what is wrong.

use super::super::table::Columns;
use super::super::text::{finite_prefix, within};
use memchr::{memchr, memrchr};
use rayon::prelude::*;
use std::ops::Range;

/// How many bytes one thread reads at a time.
const PIECE: usize = 1 << 15;

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

/// Where a table is read: what the careful reader knows of its lines.
///
/// A row's line is told as the number of line feeds before the reader left the row before it. Behind a row that ends
/// with CR LF it stands before the LF, and blank lines are passed on the way to the next row, not after the last one.
#[derive(Clone, Copy)]
pub(super) struct Lines {
    /// One more than the line feeds passed.
    pub(super) line: u64,
    /// What is told of the next row.
    pub(super) told: u64,
}

/// What was taken of a stretch.
pub(super) struct Taken {
    pub(super) bytes: usize,
    pub(super) lines: Lines,
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
    /// As [`Lines::told`], counted from the piece's start; `None` where no row came yet.
    told: Option<u64>,
    odd: bool,
}

/// One row of a piece.
struct Span {
    /// Where its text stands in the stretch.
    text: Range<usize>,
    /// As [`Piece::told`] before this row.
    told: Option<u64>,
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
