//! Formats rows of a table as CSV. Unchanged cells keep their text.

use super::super::text::push_f64;
use crate::columns::Columns;
use crate::row::Row;

/// The content of a written column.
#[derive(Debug, Clone, PartialEq)]
enum Source {
    /// A cell with the text that was read.
    Carried(usize),
    /// Number `value` of the frame; the column it was read from, if any.
    Number(usize, Option<usize>),
    /// The take's name, read from this column.
    Take(usize),
    /// The time, read from this column.
    Time(usize),
    /// An added cell.
    Added(usize),
}

/// A column that a command adds to a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AddedColumn {
    /// The header; a column of the table with this name is replaced.
    pub name: String,
    /// The column's position.
    pub after: After,
}

impl AddedColumn {
    /// A column behind those of `after`.
    pub fn new(name: impl Into<String>, after: After) -> AddedColumn {
        AddedColumn {
            name: name.into(),
            after,
        }
    }
}

/// Where an added column goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum After {
    /// Behind the coordinates of a point.
    Point(usize),
    /// Behind all columns.
    All,
}

/// The layout of a CSV table: which column holds what.
pub struct CsvFormat {
    header: Vec<String>,
    sources: Vec<Source>,
    /// Whether the columns are those that were read, in the same order.
    as_it_was: bool,
}

impl CsvFormat {
    /// The layout of tables with the columns `columns` and `added`. An added column replaces one of
    /// the same name.
    #[doc(hidden)]
    pub fn new(columns: &Columns, added: &[AddedColumn]) -> CsvFormat {
        let mut writer = CsvFormat {
            header: Vec::new(),
            sources: Vec::new(),
            as_it_was: true,
        };
        let replaced: Vec<Option<usize>> = added
            .iter()
            .map(|added| columns.names.iter().position(|n| *n == added.name))
            .collect();
        let mut source = vec![None; columns.names.len()];
        for (point, axes) in columns.coordinates.iter().enumerate() {
            for (axis, column) in axes.iter().enumerate() {
                if let Some(column) = column {
                    source[*column] = Some(Source::Number(3 * point + axis, Some(*column)));
                }
            }
        }
        for (i, name) in columns.names.iter().enumerate() {
            let what = match &source[i] {
                Some(number) => number.clone(),
                None => match replaced.iter().position(|r| *r == Some(i)) {
                    Some(a) => Source::Added(a),
                    None if columns.take == Some(i) => Source::Take(i),
                    None if columns.time == Some(i) => Source::Time(i),
                    None => Source::Carried(i),
                },
            };
            writer.push(name, what.clone());
            // What belongs behind a point goes behind the last of its columns.
            if let Source::Number(value, _) = what {
                let point = value / 3;
                if columns.coordinates[point].iter().flatten().max() == Some(&i) {
                    writer.after_point(columns, point, added, &replaced);
                }
            }
        }
        for (a, AddedColumn { name, after }) in added.iter().enumerate() {
            if *after == After::All && replaced[a].is_none() {
                writer.push(name, Source::Added(a));
            }
        }
        writer
    }

    fn after_point(
        &mut self,
        columns: &Columns,
        point: usize,
        added: &[AddedColumn],
        replaced: &[Option<usize>],
    ) {
        for (axis, letter) in ["x", "y", "z"].iter().enumerate() {
            if columns.coordinates[point][axis].is_none() {
                self.push(
                    &format!("{}.{letter}", columns.points[point]),
                    Source::Number(3 * point + axis, None),
                );
            }
        }
        for (a, AddedColumn { name, after }) in added.iter().enumerate() {
            if *after == After::Point(point) && replaced[a].is_none() {
                self.push(name, Source::Added(a));
            }
        }
    }

    fn push(&mut self, name: &str, source: Source) {
        self.as_it_was &= match source {
            Source::Carried(column) | Source::Take(column) | Source::Time(column) => {
                column == self.sources.len()
            }
            Source::Number(_, column) => column == Some(self.sources.len()),
            Source::Added(_) => false,
        };
        self.header.push(name.to_string());
        self.sources.push(source);
    }

    /// Appends the header line.
    #[doc(hidden)]
    pub fn push_header(&self, out: &mut Vec<u8>) {
        for (i, name) in self.header.iter().enumerate() {
            if i > 0 {
                out.push(b',');
            }
            push_cell(out, name.as_bytes());
        }
        out.push(b'\n');
    }

    /// Appends a frame. `row` is what was read (its cells are kept where the numbers are
    /// unchanged), `xyz` the numbers to write, `added` the added columns' cells.
    #[doc(hidden)]
    pub fn push_row(&self, out: &mut Vec<u8>, row: &Row, xyz: &[f64], added: &[String]) {
        let kept = !row.cells.is_empty();
        let unchanged = |n: usize| !row.converted && same(xyz[n], row.xyz[n]);
        if let Some(line) = row.cells.as_line()
            && self.as_it_was
            && (0..xyz.len()).all(unchanged)
        {
            out.extend_from_slice(line);
            out.push(b'\n');
            return;
        }
        for (i, source) in self.sources.iter().enumerate() {
            if i > 0 {
                out.push(b',');
            }
            match *source {
                Source::Number(value, column) => match column {
                    Some(c) if kept && unchanged(value) => push_cell(out, &row.cells[c]),
                    _ => push_f64(out, xyz[value]),
                },
                Source::Carried(c) | Source::Time(c) | Source::Take(c) if kept => {
                    push_cell(out, &row.cells[c]);
                }
                Source::Time(_) => push_f64(out, row.time.unwrap_or(f64::NAN)),
                Source::Take(_) => push_cell(out, row.take.as_deref().unwrap_or("").as_bytes()),
                Source::Carried(_) => {}
                Source::Added(a) => push_cell(out, added[a].as_bytes()),
            }
        }
        out.push(b'\n');
    }
}

/// Whether two numbers have the same bits, or both are missing.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// Appends a cell, quoted where RFC 4180 wants it.
pub fn push_cell(line: &mut Vec<u8>, cell: &[u8]) {
    if !cell
        .iter()
        .any(|b| matches!(b, b',' | b'"' | b'\n' | b'\r'))
    {
        line.extend_from_slice(cell);
        return;
    }
    line.push(b'"');
    for &byte in cell {
        if byte == b'"' {
            line.push(b'"');
        }
        line.push(byte);
    }
    line.push(b'"');
}
