//! One row of a pose table: a frame, and the text of its cells.

use std::ops::Index;
use std::sync::Arc;

/// One frame as it was read.
#[derive(Debug, Clone, Default)]
pub struct Row {
    /// Coordinates, three per point, centimeters; NaN is missing.
    pub xyz: Vec<f64>,
    /// Seconds.
    pub time: Option<f64>,
    /// The take's name.
    pub take: Option<Arc<str>>,
    /// The text of the cells; empty for NPY, or where it was not kept.
    pub cells: Cells,
    /// Whether the coordinates are of another unit or axis than the text of the cells.
    pub converted: bool,
}

/// How a table is to be read.
#[derive(Debug, Clone, Default)]
pub struct TableOptions {
    /// The points' names for an array without any.
    pub joints: Option<Vec<String>>,
    /// Read `NAME.x`, `NAME.y` without `NAME.z` as a point of two dimensions.
    pub planar: bool,
    /// Keep the text of the cells, so that unchanged cells can be written with the same text.
    pub cells: bool,
}

/// The text of a row's cells, unquoted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// The cells, with one byte between a cell and the next.
    text: Vec<u8>,
    /// The end of each cell in `text`.
    ends: Vec<usize>,
    line: Option<u64>,
    /// Whether `text` is the line of the file.
    plain: bool,
}

impl Cells {
    /// The number of cells.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }
    /// Whether there are no cells: they were not kept, or the row comes from an array.
    pub(crate) fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }
    /// The text of cell `at`; `None` behind the last.
    pub fn get(&self, at: usize) -> Option<&[u8]> {
        let start = match at {
            0 => 0,
            _ => self.ends.get(at - 1)? + 1,
        };
        Some(&self.text[start..*self.ends.get(at)?])
    }
    /// The line that the row begins in, counted from 1.
    pub fn line(&self) -> Option<u64> {
        self.line
    }
    /// The line of the file, if no cell is quoted.
    pub(super) fn as_line(&self) -> Option<&[u8]> {
        self.plain.then_some(&self.text)
    }
    /// The size of the text in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.text.len()
    }
    /// Moves the text of cells to others, all at once; one that is left without is empty.
    pub(crate) fn move_all(&mut self, pairs: &[(usize, Option<usize>)]) {
        let mut all: Vec<&[u8]> = (0..self.len()).map(|at| &self[at]).collect();
        let old: Vec<Option<&[u8]>> = pairs.iter().map(|(from, _)| self.get(*from)).collect();
        for (from, _) in pairs.iter().filter(|(from, _)| *from < self.len()) {
            all[*from] = b"";
        }
        for ((_, to), old) in pairs.iter().zip(old) {
            if let (Some(to), Some(old)) = (to.filter(|to| *to < self.len()), old) {
                all[to] = old;
            }
        }
        let mut ends = Vec::with_capacity(all.len());
        let mut text = Vec::with_capacity(self.text.len());
        for cell in all {
            text.extend_from_slice(cell);
            ends.push(text.len());
        }
        self.set_fields(&text, &ends, self.line.unwrap_or(1));
    }
    /// Removes all cells.
    pub(crate) fn clear(&mut self) {
        self.text.clear();
        self.ends.clear();
        self.plain = false;
    }
    /// Becomes a copy of `other`, in the memory that is there.
    pub(crate) fn copy_from(&mut self, other: &Cells) {
        self.text.clone_from(&other.text);
        self.ends.clone_from(&other.ends);
        (self.line, self.plain) = (other.line, other.plain);
    }
    /// Becomes the cells of a line that has commas between them and no quotes; cell k ends at
    /// `ends[k]`.
    pub(super) fn set_plain(&mut self, text: &[u8], ends: &[usize], line: u64) {
        self.text.clear();
        self.text.extend_from_slice(text);
        self.ends.clear();
        self.ends.extend_from_slice(ends);
        (self.line, self.plain) = (Some(line), true);
    }
    /// Becomes the cells of `text`, which has nothing between them; cell k ends at `ends[k]`.
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
    fn cells_of_quoted_and_unquoted_lines_are_found() {
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
