//! Parses text ahead in blocks, on all threads.
//!
//! A [`BlockFormat`] parses regular records only, such as almost all text consists of. A block ends
//! before the first irregular record (a comment, a quoted cell, an error). The reader of the format
//! then reads some records one at a time, with all care: that reader alone reports errors.

use memchr::{memchr, memrchr};
use rayon::prelude::*;
use std::ops::{Range, RangeInclusive};

/// The size of a block in bytes, at most.
pub(super) const BLOCK: usize = 1 << 20;

/// The size of a piece, which one thread parses, in bytes.
pub(super) const PIECE: usize = 1 << 15;

/// The number of records that are read one at a time after an irregular one. The number doubles
/// with each irregular record, so that a text full of them is not parsed twice, and one with a few
/// is read nearly as fast as one without.
const CAREFUL: RangeInclusive<u32> = 8..=1000;

/// How the records of a text format are found and parsed.
pub(super) trait BlockFormat: Sync {
    /// The parsed records of a piece.
    type Records: Default + Send;
    /// State that the parser needs at the start of a piece.
    type Start: Copy + Send + Sync;

    /// The end of the first record that ends behind `from`, and the start of the next piece there.
    fn cut(&self, text: &[u8], from: usize) -> Option<(usize, Self::Start)>;

    /// Replaces `records` by the regular records at the start of `text`, which ends with a line
    /// feed.
    fn parse(&self, text: &[u8], start: Self::Start, records: &mut Self::Records) -> Parsed;
}

/// The part of a text that was parsed.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parsed {
    pub(super) bytes: usize,
    /// Line feeds in these bytes.
    pub(super) line_feeds: u64,
    /// Whether the next record is irregular.
    pub(super) is_irregular: bool,
}

/// Consecutive records of a block.
pub(super) struct Piece<F: BlockFormat> {
    range: Range<usize>,
    start: F::Start,
    parsed: Parsed,
    /// The offset of the piece in the block.
    pub(super) offset: usize,
    /// The line feeds of the block before the piece.
    pub(super) lines_before: u64,
    pub(super) records: F::Records,
}

/// Parses blocks of one text.
pub(super) struct BlockReader<F: BlockFormat> {
    pub(super) format: F,
    /// The first `count` hold the last block; the others are memory for later ones.
    pieces: Vec<Piece<F>>,
    count: usize,
    /// [`PIECE`]; smaller in tests.
    pub(super) piece_bytes: usize,
    /// The size of the next block; small after an irregular record.
    block_bytes: usize,
    /// Records that are still to be read one at a time.
    pub(super) careful: u32,
    /// The value of `careful` after the next irregular record.
    next_careful: u32,
}

impl<F: BlockFormat> BlockReader<F> {
    pub(super) fn new(format: F) -> BlockReader<F> {
        BlockReader {
            format,
            pieces: Vec::new(),
            count: 0,
            piece_bytes: PIECE,
            block_bytes: BLOCK,
            careful: 0,
            next_careful: *CAREFUL.start(),
        }
    }

    /// Whether the next record is to be read alone, because an irregular one was close before it.
    pub(super) fn take_careful(&mut self) -> bool {
        let is_careful = self.careful > 0;
        self.careful = self.careful.saturating_sub(1);
        is_careful
    }

    /// Parses the regular records at the start of `text`, a block at most; [`BlockReader::pieces`]
    /// holds them.
    pub(super) fn read(&mut self, text: &[u8], start: F::Start) -> Parsed {
        let beyond = text.get(self.block_bytes..).unwrap_or_default();
        let end = memchr(b'\n', beyond).map_or(text.len(), |at| self.block_bytes + at + 1);
        let text = &text[..end];
        let text = &text[..memrchr(b'\n', text).map_or(0, |at| at + 1)];
        self.split(text, start);
        let format = &self.format;
        let parse = |piece: &mut Piece<F>| {
            let text = &text[piece.range.clone()];
            piece.parsed = format.parse(text, piece.start, &mut piece.records);
        };
        match &mut self.pieces[..self.count] {
            [one] => parse(one),
            all => all.par_iter_mut().for_each(parse),
        }
        let parsed = self.join();
        if parsed.is_irregular {
            self.careful = self.next_careful;
            self.next_careful = (2 * self.next_careful).min(*CAREFUL.end());
            self.block_bytes = PIECE;
        } else {
            self.next_careful = *CAREFUL.start();
            self.block_bytes = (2 * self.block_bytes).min(BLOCK);
        }
        parsed
    }

    /// The pieces that the last block consists of.
    pub(super) fn pieces(&self) -> &[Piece<F>] {
        &self.pieces[..self.count]
    }

    /// Cuts `text` into pieces.
    fn split(&mut self, text: &[u8], mut start: F::Start) {
        self.count = 0;
        let mut at = 0;
        loop {
            let next = self.format.cut(text, at + self.piece_bytes);
            let range = at..next.map_or(text.len(), |(end, _)| end);
            match self.pieces.get_mut(self.count) {
                Some(piece) => (piece.range, piece.start) = (range, start),
                None => self.pieces.push(Piece {
                    range,
                    start,
                    parsed: Parsed::default(),
                    offset: 0,
                    lines_before: 0,
                    records: F::Records::default(),
                }),
            }
            self.count += 1;
            match next {
                Some(next) => (at, start) = next,
                None => return,
            }
        }
    }

    /// Keeps the pieces up to the first that was not parsed to its end.
    fn join(&mut self) -> Parsed {
        let mut all = Parsed::default();
        let mut kept = 0;
        for piece in &mut self.pieces[..self.count] {
            piece.offset = all.bytes;
            piece.lines_before = all.line_feeds;
            all.bytes += piece.parsed.bytes;
            all.line_feeds += piece.parsed.line_feeds;
            all.is_irregular = piece.parsed.is_irregular;
            kept += 1;
            if all.is_irregular || piece.parsed.bytes < piece.range.len() {
                break;
            }
        }
        self.count = kept;
        all
    }
}
