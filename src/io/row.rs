//! One row of a pose table: a frame, and the text of its cells.

use std::ops::Index;
use std::sync::Arc;

/// One frame as it was read.
#[derive(Debug, Clone, Default)]
pub struct Row {
    /// Three numbers a point, centimetres; NaN is missing.
    pub xyz: Vec<f64>,
    /// Seconds.
    pub time: Option<f64>,
    /// The take's name.
    pub take: Option<Arc<str>>,
    /// The cells as they stood; empty for NPY.
    pub cells: Cells,
    /// Whether the numbers were converted (units, up axis), so that the cells no longer say the same.
    pub converted: bool,
}

/// How a table is to be read.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// The points' names for an array without any.
    pub joints: Option<Vec<String>>,
    /// Take `NAME.x`, `NAME.y` without `NAME.z` for a point.
    pub planar: bool,
    /// Keep the cells as they stood, to write unchanged ones as they were.
    pub cells: bool,
}

/// The cells of one row, unquoted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// The cells, a byte between each and the next.
    text: Vec<u8>,
    /// Where each cell ends in `text`.
    ends: Vec<usize>,
    line: Option<u64>,
    /// Whether `text` is the line as it stood.
    plain: bool,
}

impl Cells {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }
    /// Whether there are none: they were not kept, or the row comes from an array.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }
    /// One of them.
    pub fn get(&self, at: usize) -> Option<&[u8]> {
        let start = match at {
            0 => 0,
            _ => self.ends.get(at - 1)? + 1,
        };
        Some(&self.text[start..*self.ends.get(at)?])
    }
    /// The line that the row begins at, counted from 1.
    pub fn line(&self) -> Option<u64> {
        self.line
    }
    /// The line as it stood, if its cells are written as they are read: none is quoted, none holds a line's end.
    pub(super) fn as_line(&self) -> Option<&[u8]> {
        self.plain.then_some(&self.text)
    }
    /// How many bytes they take.
    pub fn bytes(&self) -> usize {
        self.text.len()
    }
    /// Forgets them.
    pub fn clear(&mut self) {
        self.text.clear();
        self.ends.clear();
        self.plain = false;
    }
    /// Becomes a copy, in the memory that is there.
    pub fn copy_from(&mut self, other: &Cells) {
        self.text.clone_from(&other.text);
        self.ends.clone_from(&other.ends);
        (self.line, self.plain) = (other.line, other.plain);
    }
    /// Becomes the cells of `line`, in which commas and nothing else part them.
    pub(super) fn set_plain(&mut self, text: &[u8], ends: &[usize], line: u64) {
        self.text.clear();
        self.text.extend_from_slice(text);
        self.ends.clear();
        self.ends.extend_from_slice(ends);
        (self.line, self.plain) = (Some(line), true);
    }
    /// Becomes the cells that end at `ends` in `text`, nothing between them.
    pub(super) fn set_fields(&mut self, text: &[u8], ends: &[usize], line: u64) {
        self.clear();
        let mut start = 0;
        for &end in ends {
            self.text.extend_from_slice(&text[start..end]);
            self.ends.push(self.text.len());
            self.text.push(b',');
            start = end;
        }
        self.line = Some(line);
    }
}

impl Index<usize> for Cells {
    type Output = [u8];
    fn index(&self, at: usize) -> &[u8] {
        let start = if at == 0 { 0 } else { self.ends[at - 1] + 1 };
        &self.text[start..self.ends[at]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_found_whether_they_stood_plain_or_not() {
        let (mut plain, mut fields) = (Cells::default(), Cells::default());
        plain.set_plain(b"a,,bcd", &[1, 2, 6], 7);
        fields.set_fields(b"abcd", &[1, 1, 4], 7);
        for cells in [&plain, &fields] {
            let all: Vec<_> = (0..4).map(|i| cells.get(i)).collect();
            assert_eq!(all, [Some(&b"a"[..]), Some(b""), Some(b"bcd"), None]);
            assert_eq!(&cells[2], b"bcd");
            assert_eq!((cells.len(), cells.line()), (3, Some(7)));
        }
        assert_eq!(plain.as_line(), Some(&b"a,,bcd"[..]));
        assert_eq!(fields.as_line(), None);
    }
}
