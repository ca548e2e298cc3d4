//! Pose tables as CSV (RFC 4180): read row by row, written with unchanged cells as they stood.

use super::Input;
use super::table::{Columns, ReadOptions, Row};
use super::text::{push_number, short, within};
use crate::{Error, Place, Result};
use std::io::{BufRead, Write};
use std::sync::Arc;

/// Reads a table row by row.
pub struct CsvReader {
    /// The name that messages use.
    pub name: String,
    /// What the columns mean.
    pub columns: Columns,
    reader: csv::Reader<Box<dyn BufRead>>,
    keep: bool,
    take: Arc<str>,
}

impl CsvReader {
    /// Reads the header.
    pub fn new(input: Input, options: &ReadOptions) -> Result<CsvReader> {
        let name = input.name.clone();
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .from_reader(input.into_reader());
        let place = Place::line(&name, 1);
        let header = reader.byte_headers().map_err(|e| fail(&name, e))?;
        let header: Vec<String> = header
            .iter()
            .map(|h| String::from_utf8_lossy(h).trim().to_string())
            .collect();
        if header.first().is_some_and(|h| h.starts_with('#')) {
            return Err(Error::data(
                place,
                "starts with a comment; a pose table is plain CSV with a header line",
            ));
        }
        let columns = Columns::from_header(&header, options.planar, &place)?;
        Ok(CsvReader {
            name,
            columns,
            reader,
            keep: options.cells,
            take: Arc::from(""),
        })
    }

    /// Reads the next frame; `false` at the end.
    pub fn read(&mut self, row: &mut Row) -> Result<bool> {
        if !self
            .reader
            .read_byte_record(&mut row.cells)
            .map_err(|e| fail(&self.name, e))?
        {
            return Ok(false);
        }
        let line = row.cells.position().map_or(0, csv::Position::line);
        let width = self.columns.names.len();
        if row.cells.len() != width {
            let what = format!("expected {width} cells, found {}", row.cells.len());
            return Err(Error::data(Place::line(&self.name, line), what));
        }
        row.xyz.clear();
        for (point, place) in self.columns.place.iter().enumerate() {
            for (axis, column) in place.iter().enumerate() {
                let value = match column {
                    None => f64::NAN,
                    Some(column) => coordinate(&row.cells[*column]).map_err(|what| {
                        let part = format!(
                            "{}.{}",
                            short(&self.columns.points[point]),
                            ["x", "y", "z"][axis]
                        );
                        Error::data(Place::line(&self.name, line).part(part), what)
                    })?,
                };
                row.xyz.push(value);
            }
        }
        row.time = match self.columns.time {
            None => None,
            Some(column) => {
                let fail = |what| Error::data(Place::line(&self.name, line).part("time"), what);
                let time = parse(&row.cells[column]).map_err(fail)?;
                if time.is_nan() {
                    return Err(fail("a time is missing".to_string()));
                }
                Some(time)
            }
        };
        row.take = self.columns.take.map(|column| {
            let take = String::from_utf8_lossy(&row.cells[column]);
            if *take != *self.take {
                self.take = Arc::from(&*take);
            }
            self.take.clone()
        });
        if !self.keep {
            row.cells.clear();
        }
        Ok(true)
    }
}

/// A cell's number: NaN for an empty cell or `NaN`.
fn parse(cell: &[u8]) -> std::result::Result<f64, String> {
    let text = std::str::from_utf8(cell).unwrap_or("\u{fffd}").trim();
    if text.is_empty() || text.eq_ignore_ascii_case("nan") {
        return Ok(f64::NAN);
    }
    super::text::number(text)
}

/// A cell's coordinate: NaN is a missing one.
fn coordinate(cell: &[u8]) -> std::result::Result<f64, String> {
    match parse(cell)? {
        v if v.is_nan() => Ok(v),
        v => within(v),
    }
}

/// One line for an error of the csv crate.
fn fail(name: &str, error: csv::Error) -> Error {
    let line = error.position().map(|p| p.line());
    match error.into_kind() {
        csv::ErrorKind::Io(e) => Error::io(name, e),
        other => Error::data(
            Place {
                file: name.into(),
                line,
                part: None,
            },
            short(&format!("{other:?}")),
        ),
    }
}

/// What a written column holds.
#[derive(Debug, Clone, PartialEq)]
enum Source {
    /// A cell as it was read.
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

/// Where an added column goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum After {
    /// Behind the coordinates of a point.
    Point(usize),
    /// Behind everything.
    All,
}

/// Writes rows of a table.
pub struct CsvWriter {
    header: Vec<String>,
    sources: Vec<Source>,
    line: Vec<u8>,
}

impl CsvWriter {
    /// A writer for tables such as `columns`, with `added` columns; one that is there already is replaced.
    pub fn new(columns: &Columns, added: &[(String, After)]) -> CsvWriter {
        let mut writer = CsvWriter {
            header: Vec::new(),
            sources: Vec::new(),
            line: Vec::new(),
        };
        let replaced: Vec<Option<usize>> = added
            .iter()
            .map(|(name, _)| columns.names.iter().position(|n| n == name))
            .collect();
        let mut source = vec![None; columns.names.len()];
        for (point, place) in columns.place.iter().enumerate() {
            for (axis, column) in place.iter().enumerate() {
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
                if columns.place[point].iter().flatten().max() == Some(&i) {
                    writer.after_point(columns, point, added, &replaced);
                }
            }
        }
        for (a, (name, after)) in added.iter().enumerate() {
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
        added: &[(String, After)],
        replaced: &[Option<usize>],
    ) {
        for (axis, letter) in ["x", "y", "z"].iter().enumerate() {
            if columns.place[point][axis].is_none() {
                self.push(
                    &format!("{}.{letter}", columns.points[point]),
                    Source::Number(3 * point + axis, None),
                );
            }
        }
        for (a, (name, after)) in added.iter().enumerate() {
            if *after == After::Point(point) && replaced[a].is_none() {
                self.push(name, Source::Added(a));
            }
        }
    }

    fn push(&mut self, name: &str, source: Source) {
        self.header.push(name.to_string());
        self.sources.push(source);
    }

    /// Writes the header line.
    pub fn head(&mut self, out: &mut dyn Write) -> std::io::Result<()> {
        self.line.clear();
        for (i, name) in self.header.iter().enumerate() {
            if i > 0 {
                self.line.push(b',');
            }
            push_cell(&mut self.line, name.as_bytes());
        }
        self.line.push(b'\n');
        out.write_all(&self.line)
    }

    /// Writes a frame. `row` is what was read (its cells are kept where the numbers are unchanged), `xyz` the numbers
    /// to write, `added` the added columns' cells.
    pub fn row(
        &mut self,
        out: &mut dyn Write,
        row: &Row,
        xyz: &[f64],
        added: &[String],
    ) -> std::io::Result<()> {
        self.line.clear();
        let kept = !row.cells.is_empty();
        for (i, source) in self.sources.iter().enumerate() {
            if i > 0 {
                self.line.push(b',');
            }
            match *source {
                Source::Number(value, column) => {
                    let new = xyz[value];
                    match column {
                        Some(c) if kept && !row.converted && same(new, row.xyz[value]) => {
                            push_cell(&mut self.line, &row.cells[c])
                        }
                        _ => push_number(&mut self.line, new),
                    }
                }
                Source::Carried(c) | Source::Time(c) | Source::Take(c) if kept => {
                    push_cell(&mut self.line, &row.cells[c]);
                }
                Source::Time(_) => push_number(&mut self.line, row.time.unwrap_or(f64::NAN)),
                Source::Take(_) => {
                    push_cell(&mut self.line, row.take.as_deref().unwrap_or("").as_bytes())
                }
                Source::Carried(_) => {}
                Source::Added(a) => push_cell(&mut self.line, added[a].as_bytes()),
            }
        }
        self.line.push(b'\n');
        out.write_all(&self.line)
    }
}

/// The same number, or both missing.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// A cell, quoted where RFC 4180 wants it.
fn push_cell(line: &mut Vec<u8>, cell: &[u8]) {
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

#[cfg(test)]
mod tests {
    use super::super::table::Table;
    use super::*;

    fn input(text: &str) -> Input {
        Input::new("t.csv", std::io::Cursor::new(text.as_bytes().to_vec())).unwrap()
    }

    fn through(
        text: &str,
        added: &[(String, After)],
        cells: &[String],
        change: impl Fn(&mut Vec<f64>),
    ) -> String {
        let options = ReadOptions {
            cells: true,
            planar: true,
            ..ReadOptions::default()
        };
        let mut reader = CsvReader::new(input(text), &options).unwrap();
        let mut writer = CsvWriter::new(&reader.columns, added);
        let (mut out, mut row) = (Vec::new(), Row::default());
        writer.head(&mut out).unwrap();
        while reader.read(&mut row).unwrap() {
            let mut xyz = row.xyz.clone();
            change(&mut xyz);
            writer.row(&mut out, &row, &xyz, cells).unwrap();
        }
        String::from_utf8(out).unwrap()
    }

    const TABLE: &str = "take,time,a.x,a.y,note,a.z,b.z,b.x,b.y\n\"x, y\",0.0,1.50,,\"say \"\"hi\"\"\",NaN,3,1e0,2\n";

    #[test]
    fn unchanged_cells_keep_their_text() {
        assert_eq!(through(TABLE, &[], &[], |_| {}), TABLE);
        let changed = through(TABLE, &[], &[], |xyz| xyz[1] = 7.25);
        assert_eq!(changed, TABLE.replace("1.50,,", "1.50,7.25,"));
    }

    #[test]
    fn added_columns_follow_their_point_and_replace_old_ones() {
        let added = [
            ("b.status".to_string(), After::Point(1)),
            ("cluster".to_string(), After::All),
        ];
        let cells = ["observed".to_string(), "4".to_string()];
        let once = through(TABLE, &added, &cells, |_| {});
        assert!(once.starts_with("take,time,a.x,a.y,note,a.z,b.z,b.x,b.y,b.status,cluster\n"));
        assert!(once.ends_with(",2,observed,4\n"));
        assert_eq!(through(&once, &added, &cells, |_| {}), once);
    }

    #[test]
    fn points_without_z_are_read_and_given_one() {
        let out = through("a.x,a.y\n1,2\n", &[], &[], |xyz| xyz[2] = 5.0);
        assert_eq!(out, "a.x,a.y,a.z\n1,2,5\n");
        assert!(CsvReader::new(input("a.x,a.y\n1,2\n"), &ReadOptions::default()).is_err());
    }

    #[test]
    fn bad_tables_are_refused_with_their_place() {
        let says = |text: &str, part: &str| {
            let e = Table::read(input(text), &ReadOptions::default())
                .unwrap_err()
                .to_string();
            assert!(e.contains(part) && e.lines().count() == 1, "{e}");
        };
        says(
            "a.x,a.y,a.z\n1,2,3\n1,abc,3\n",
            "t.csv:3: a.y: expected a number, found \"abc\"",
        );
        says("a.x,a.y,a.z\n1,2\n", "t.csv:2: expected 3 cells, found 2");
        says("a.x,a.y,a.z\n1,inf,3\n", "finite");
        says(
            "time,a.x,a.y,a.z\n,1,2,3\n",
            "t.csv:2: time: a time is missing",
        );
        says("a.x,a.x,a.y,a.z\n", "two columns");
        says("# made by hand\na.x,a.y,a.z\n", "comment");
        says("u,v\n1,2\n", "no point");
        says("", "empty");
    }

    #[test]
    fn takes_and_times_are_read() {
        let text = "take,time,a.x,a.y,a.z\nw,0,1,2,3\nw,0.5,,nan,3\nv,0,1,2,3\n";
        let table = Table::read(input(text), &ReadOptions::default()).unwrap();
        assert_eq!(table.poses.frames(), 3);
        assert_eq!(table.poses.takes(), [0..2, 2..3]);
        assert_eq!(table.poses.rate(), Some(2.0));
        assert!(table.poses.xyz[[1, 0]].is_nan() && table.poses.xyz[[1, 1]].is_nan());
    }
}
