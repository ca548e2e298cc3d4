//! Where the coordinates of a take stand in its file of text, so that they can be written again and
//! all else stays as it is.

use super::point_move::PointMove;
use super::row_cells::cells_of;
use super::text::{line_end, push_f64};
use ndarray::ArrayView2;
use std::borrow::Cow;

/// Digits after the point of what is written: a micrometer in files of meters.
const DECIMALS: f64 = 1e6;

/// How the cells of a row are parted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Separator {
    /// By tabs.
    #[default]
    Tab,
    /// By commas.
    Comma,
    /// By semicolons.
    Semicolon,
    /// By tabs; by tabs and blanks, of any number, in a row without a tab, and in a row that is
    /// whole only so.
    TabOrBlanks {
        /// The cells of a whole row.
        whole: usize,
    },
}

impl Separator {
    /// The byte between cells, where it is one.
    pub(crate) fn byte(self) -> Option<u8> {
        match self {
            Separator::Tab => Some(b'\t'),
            Separator::Comma => Some(b','),
            Separator::Semicolon => Some(b';'),
            Separator::TabOrBlanks { .. } => None,
        }
    }

    /// The byte that parts the cells of a row; `None`: tabs and blanks of any number.
    pub(crate) fn of_row(self, row: &[u8]) -> Option<u8> {
        let Separator::TabOrBlanks { whole } = self else {
            return self.byte();
        };
        let is_blank = |b: &u8| b.is_ascii_whitespace();
        let words = || row.split(is_blank).filter(|word| !word.is_empty()).count();
        let is_mixed = |cell: &[u8]| cell.trim_ascii().iter().any(is_blank);
        let mut cells = row.split(|b| *b == b'\t');
        // Two tabs beside the frame's number, or blanks within a cell: else an empty cell is a
        // missing value.
        let time = cells.clone().nth(1);
        let is_odd = time.is_some_and(|time| time.trim_ascii().is_empty()) || cells.any(is_mixed);
        let by_words = !row.contains(&b'\t') || is_odd && words() == whole;
        (!by_words).then_some(b'\t')
    }
}

/// Where the coordinates of a take stand in its file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TextCells {
    /// The number of the line of each frame, from 1; `None` of a frame that the file leaves out.
    pub lines: Vec<Option<u64>>,
    /// The cells of each point's x, y and z in a row, from 0.
    pub points: Vec<[usize; 3]>,
    /// How the cells are parted.
    pub separator: Separator,
    /// Whether a comma stands before the decimals.
    pub decimal_comma: bool,
}

impl TextCells {
    /// Sets the cells of the points, which were counted among those of the points, to those of the
    /// rows.
    pub(crate) fn move_points(&mut self, cell: impl Fn(usize) -> usize) {
        let cells = self.points.iter_mut().flatten();
        cells.for_each(|c| *c = cell(*c));
    }

    /// The bytes of the file, `original`, whose coordinates are `old`, with the coordinates `new`
    /// (frames, 3 P; both in the file's unit and axes). Every other byte stays; a missing value
    /// takes no measured one away.
    pub fn with_points(
        &self,
        original: &[u8],
        old: ArrayView2<'_, f64>,
        new: ArrayView2<'_, f64>,
    ) -> Vec<u8> {
        self.rewritten(original, |line, t, out| {
            let values = old.row(t).into_iter().zip(new.row(t)).enumerate();
            let changed = values.filter(|(_, (old, new))| new.is_finite() && old != new);
            let cell = |i: usize| self.points[i / 3][i % 3];
            let changed = changed.map(|(i, (_, new))| (cell(i), *new));
            self.push_row(line, &changed.collect::<Vec<_>>(), out);
        })
    }

    /// The bytes of the file with the cells of points moved to those of others in some frames; a
    /// cell that is left is empty.
    pub(crate) fn with_moved(&self, original: &[u8], moves: &[PointMove]) -> Vec<u8> {
        self.rewritten(original, |line, t, out| {
            let here = moves.iter().filter(|m| m.frames.contains(&t));
            self.push_moved(line, &here.collect::<Vec<_>>(), out);
        })
    }

    /// The bytes of the file, whose points are `points`, with other names of some of them in the
    /// line that names most; `None` where none names one.
    pub(crate) fn with_names(
        &self,
        original: &[u8],
        points: &[String],
        names: &[(usize, String)],
    ) -> Option<Vec<u8>> {
        let end = line_end(original);
        let first = self.lines.iter().flatten().min().map_or(1, |n| *n as usize);
        let lines: Vec<&[u8]> = original.split_inclusive(|b| *b == end).collect();
        let is = |row: &Row<'_>, cell: usize, name: &str| bare(&row.text(cell)) == name.as_bytes();
        let named = |line: &[u8]| {
            let row = Row::new(line, self.separator);
            let has = |p: &String| (0..row.cells.len()).any(|cell| is(&row, cell, p));
            points.iter().filter(|p| has(p)).count()
        };
        let head = lines.iter().take(first - 1).enumerate();
        let counts = head
            .map(|(n, line)| (named(line), n))
            .filter(|(count, _)| *count > 0);
        let (_, line) = counts.max()?;
        let mut row = Row::new(lines[line], self.separator);
        let was = Row::new(lines[line], self.separator);
        for (point, name) in names {
            let own = self.points[*point];
            let old = &points[*point];
            let stands = |cell: &usize| is(&was, *cell, old);
            let mut cells: Vec<usize> = own.into_iter().filter(stands).collect();
            if cells.is_empty() {
                cells = (0..was.cells.len()).filter(stands).collect();
            }
            let is_unnamed = bare(&was.text(own[0])).is_empty() && own[0] < was.cells.len();
            match cells.len() {
                0 if is_unnamed => row.set(own[0], Cow::Owned(name.clone().into_bytes())),
                0 => return None,
                _ => cells
                    .iter()
                    .for_each(|cell| row.set(*cell, Cow::Owned(name.clone().into_bytes()))),
            }
        }
        let mut out = lines[..line].concat();
        row.push(&mut out);
        out.extend(lines[line + 1..].concat());
        Some(out)
    }

    /// The bytes of the file, each line of a frame by `push`, which appends it; others stay.
    fn rewritten(&self, original: &[u8], push: impl Fn(&[u8], usize, &mut Vec<u8>)) -> Vec<u8> {
        let mut out = Vec::with_capacity(original.len());
        let lines = self.lines.iter().enumerate();
        let mut frames = lines.filter_map(|(t, line)| Some(((*line)?, t))).peekable();
        let end = line_end(original);
        for (i, line) in original.split_inclusive(|b| *b == end).enumerate() {
            match frames.next_if(|(number, _)| *number == i as u64 + 1) {
                Some((_, t)) => push(line, t, &mut out),
                None => out.extend_from_slice(line),
            }
        }
        out
    }

    fn push_moved(&self, line: &[u8], moves: &[&PointMove], out: &mut Vec<u8>) {
        if moves.is_empty() {
            out.extend_from_slice(line);
            return;
        }
        let mut row = Row::new(line, self.separator);
        let was: Vec<[Cow<'_, [u8]>; 3]> = moves
            .iter()
            .map(|m| self.points[m.from].map(|cell| row.text(cell)))
            .collect();
        for step in moves {
            let empty = row.empty;
            self.points[step.from]
                .iter()
                .for_each(|c| row.set(*c, Cow::Borrowed(empty)));
        }
        for (step, was) in moves.iter().zip(was) {
            let Some(to) = step.to else { continue };
            self.points[to]
                .iter()
                .zip(was)
                .for_each(|(cell, text)| row.set(*cell, text));
        }
        row.push(out);
    }

    /// A row with some of its cells written anew.
    fn push_row(&self, line: &[u8], changed: &[(usize, f64)], out: &mut Vec<u8>) {
        if changed.is_empty() {
            out.extend_from_slice(line);
            return;
        }
        let mut row = Row::new(line, self.separator);
        for &(cell, value) in changed {
            let mut text = Vec::new();
            push_f64(&mut text, (value * DECIMALS).round() / DECIMALS);
            if self.decimal_comma {
                let points = text.iter_mut().filter(|b| **b == b'.');
                points.for_each(|b| *b = b',');
            }
            row.set(cell, Cow::Owned(text));
        }
        row.push(out);
    }
}

/// A row of a file, cell by cell.
struct Row<'a> {
    line: &'a [u8],
    /// The line without its end.
    body: &'a [u8],
    is_of_words: bool,
    cells: Vec<Cell<'a>>,
    /// What stands between cells, and for one that is empty.
    between: &'static [u8],
    empty: &'static [u8],
}

impl<'a> Row<'a> {
    fn new(line: &'a [u8], separator: Separator) -> Row<'a> {
        let is_end = |b: &&u8| matches!(**b, b'\n' | b'\r');
        let body = &line[..line.len() - line.iter().rev().take_while(is_end).count()];
        let separator = separator.of_row(body);
        let (between, empty) = match separator {
            Some(b',') => (&b","[..], &b""[..]),
            Some(b';') => (&b";"[..], &b""[..]),
            Some(_) => (&b"\t"[..], &b""[..]),
            None => (&b" "[..], &b"nan"[..]),
        };
        Row {
            line,
            body,
            is_of_words: separator.is_none(),
            cells: match separator {
                Some(byte) => cells(body, byte),
                None => words(body),
            },
            between,
            empty,
        }
    }

    fn text(&self, cell: usize) -> Cow<'a, [u8]> {
        let own = self.cells.get(cell).map(|(_, text)| text.clone());
        own.unwrap_or(Cow::Borrowed(self.empty))
    }

    fn set(&mut self, cell: usize, text: Cow<'a, [u8]>) {
        // A row may lack its last cells.
        while self.cells.len() <= cell {
            self.cells.push((self.between, Cow::Borrowed(self.empty)));
        }
        self.cells[cell].1 = text;
    }

    fn push(&self, out: &mut Vec<u8>) {
        for (before, cell) in &self.cells {
            out.extend_from_slice(before);
            out.extend_from_slice(cell);
        }
        if self.is_of_words {
            let is_blank = |b: &&u8| b.is_ascii_whitespace();
            let blanks = self.body.iter().rev().take_while(is_blank).count();
            out.extend_from_slice(&self.body[self.body.len() - blanks..]);
        }
        out.extend_from_slice(&self.line[self.body.len()..]);
    }
}

/// A cell without blanks and quotes around it.
fn bare(cell: &[u8]) -> &[u8] {
    let cell = cell.trim_ascii();
    let inner = cell.strip_prefix(b"\"").and_then(|c| c.strip_suffix(b"\""));
    inner.unwrap_or(cell)
}

/// What stands before a cell, and the cell.
type Cell<'a> = (&'a [u8], Cow<'a, [u8]>);

/// The cells of a row, each with the separator before it.
fn cells(body: &[u8], separator: u8) -> Vec<Cell<'_>> {
    let mut at = 0usize;
    cells_of(body, separator)
        .map(|cell| {
            let before = &body[at.saturating_sub(1)..at];
            at += cell.len() + 1;
            (before, Cow::Borrowed(cell))
        })
        .collect()
}

/// The words of a row, each with the blanks before it.
fn words(body: &[u8]) -> Vec<Cell<'_>> {
    let mut rest = body;
    let mut out = Vec::new();
    while !rest.is_empty() {
        let is_blank = |b: &u8| b.is_ascii_whitespace();
        let start = rest.iter().position(|b| !is_blank(b));
        let (before, word) = rest.split_at(start.unwrap_or(rest.len()));
        let end = word.iter().position(is_blank).unwrap_or(word.len());
        let (word, after) = word.split_at(end);
        if word.is_empty() {
            // Blanks at the end.
            break;
        }
        out.push((before, Cow::Borrowed(word)));
        rest = after;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Two points in two frames, of which `new` has some values anew.
    fn written(original: &str, separator: Separator) -> String {
        let cells = TextCells {
            lines: vec![Some(2), None, Some(4)],
            points: vec![[4, 5, 6], [1, 2, 3]],
            separator,
            decimal_comma: false,
        };
        let n = f64::NAN;
        let old = array![[1., 2., 3., n, n, n], [n; 6], [4., 5., 6., 7., 8., 9.]];
        let mut new = old.clone();
        new[[0, 3]] = 0.25;
        new[[0, 5]] = 1.0 / 3.0;
        new[[1, 0]] = 5.0;
        new[[2, 4]] = -8.5;
        new[[2, 5]] = n;
        let bytes = cells.with_points(original.as_bytes(), old.view(), new.view());
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn only_the_cells_of_new_values_change() {
        let file = "head\r\n0,,nan,,1.0,2.50,3,x\r\n\r\n1,7,8,9,4,5,6\r\n9,9";
        let wanted = "head\r\n0,0.25,nan,0.333333,1.0,2.50,3,x\r\n\r\n1,7,-8.5,9,4,5,6\r\n9,9";
        assert_eq!(written(file, Separator::Comma), wanted);
        let tabs = |text: &str| text.replace(',', "\t");
        assert_eq!(written(&tabs(file), Separator::Tab), tabs(wanted));
        assert_eq!(
            written(&tabs(file), Separator::TabOrBlanks { whole: 8 }),
            tabs(wanted)
        );
        let blanks = |text: &str| {
            text.replace("0,,nan,,", "0,nan,nan,nan,")
                .replace(',', "  ")
        };
        let wanted = wanted.replace(',', "  ");
        assert_eq!(
            written(&blanks(file), Separator::TabOrBlanks { whole: 8 }),
            wanted
        );
    }

    #[test]
    fn cells_of_odd_files_are_found() {
        // CR alone ends the lines; two tabs and a blank part the cells; a comma stands before
        // decimals.
        let cells = TextCells {
            lines: vec![Some(2)],
            points: vec![[1, 2, 3]],
            separator: Separator::TabOrBlanks { whole: 4 },
            decimal_comma: true,
        };
        let original = b"head\r7\t\t1,5\t 2\t\t3\t\rx";
        let gap = Separator::TabOrBlanks { whole: 5 }.of_row(b"7\t0.1\t\t\t\t1\t2\t3");
        assert_eq!(gap, Some(b'\t'));
        let new = [array![[1.5, -2.25, 3.0]], array![[1.5, 2.0, 3.0]]];
        let bytes = cells.with_points(original, new[1].view(), new[0].view());
        assert_eq!(bytes, b"head\r7\t\t1,5\t -2,25\t\t3\t\rx");
    }

    #[test]
    fn points_are_named_anew() {
        let cells = TextCells {
            lines: vec![Some(4)],
            points: vec![[2, 3, 4], [5, 6, 7], [8, 9, 10]],
            separator: Separator::Tab,
            decimal_comma: false,
        };
        let points = ["*1", "A:*2", "point3"].map(String::from);
        let frame = "1\t0\t*1\t2\t3\t4\t5\t6\t7\t8\t9\n";
        let named = |head: &str, names: &[(usize, &str)]| {
            let names: Vec<_> = names.iter().map(|(p, n)| (*p, n.to_string())).collect();
            let file = format!("path\t*1\n{head}\nx\ty\n{frame}");
            let out = cells.with_names(file.as_bytes(), &points, &names)?;
            let out = String::from_utf8(out).unwrap();
            let rest = format!("\nx\ty\n{frame}");
            Some(
                out.strip_prefix("path\t*1\n")?
                    .strip_suffix(&rest)?
                    .to_string(),
            )
        };
        // In the first of three cells, in all of them, and one after another.
        let trc = "#\tt\t*1\t\t\tA:*2\t\t\t\t\t";
        assert_eq!(
            named(trc, &[(0, "L"), (1, "R"), (2, "C")]).as_deref(),
            Some("#\tt\tL\t\t\tR\t\t\tC\t\t")
        );
        assert_eq!(
            named("\t\t*1\t*1\t*1", &[(0, "L")]).as_deref(),
            Some("\t\tL\tL\tL")
        );
        assert_eq!(
            named("NAMES\t\"*1\"\tA:*2", &[(1, "R")]).as_deref(),
            Some("NAMES\t\"*1\"\tR")
        );
        assert_eq!(named("NAMES\tx", &[(1, "R")]), None);
    }

    #[test]
    fn short_rows_grow() {
        let file = "head\n0\n\n1\t7\n";
        assert_eq!(
            written(file, Separator::Tab),
            "head\n0\t0.25\t\t0.333333\n\n1\t7\t-8.5\n"
        );
        let grown = written("head\n0\n\n1 7\n", Separator::TabOrBlanks { whole: 8 });
        assert_eq!(grown, "head\n0 0.25 nan 0.333333\n\n1 7 -8.5\n");
    }
}
