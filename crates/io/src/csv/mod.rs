//! Pose tables as CSV (RFC 4180). Cells that did not change are written with the text that was
//! read.

mod block;
mod records;
mod time_column;
mod writer;

pub use time_column::with_times;
pub use writer::{AddedColumn, After, CsvFormat, push_cell};

use super::Input;
use super::block_reader::{BLOCK, BlockReader};
use super::columns::Columns;
use super::row::{Cells, Row, TableOptions};
use super::text::{check_length, excerpt};
use crate::{Error, Place, Result};
use block::RowFormat;
use records::{Records, fault};
use std::io::BufReader;
use std::sync::Arc;

/// Reads a table row by row.
///
/// Regular rows that have arrived are parsed ahead, on all threads. The reader never waits for
/// input while a row that has arrived was not returned.
pub struct CsvReader {
    /// The name that messages use.
    pub name: String,
    /// What the columns mean.
    pub columns: Columns,
    records: Records,
    blocks: BlockReader<RowFormat>,
    /// The next row to be handed out: its piece of the block, and its number there.
    next: (usize, usize),
    /// The line that the block begins in.
    block_line: u64,
    /// The number of bytes in the buffer that were parsed ahead.
    ahead: usize,
    keep: bool,
    take: Arc<str>,
}

impl CsvReader {
    /// Reads the header.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: no header of a pose table.
    pub(crate) fn new(input: Input, options: &TableOptions) -> Result<CsvReader> {
        CsvReader::with_block(input, options, BLOCK)
    }

    fn with_block(input: Input, options: &TableOptions, block: usize) -> Result<CsvReader> {
        let name = input.name.clone();
        let mut records = Records::new(BufReader::with_capacity(block, input.into_reader()));
        let mut header = Cells::default();
        records.read(&mut header).map_err(|e| fault(&name, e))?;
        let place = Place::line(&name, header.line().unwrap_or(1));
        // Names are written again: what cannot be read as text would not be the same.
        let name_of = |i: usize| match std::str::from_utf8(&header[i]) {
            Ok(name) => Ok(name.trim().to_string()),
            Err(_) => {
                let column = place.clone().part(format!("column {}", i + 1));
                Err(Error::data(column, NO_TEXT))
            }
        };
        let header = (0..header.len()).map(name_of).collect::<Result<Vec<_>>>()?;
        if header.first().is_some_and(|h| h.starts_with('#')) {
            return Err(Error::data(
                place,
                "starts with a comment; expected a CSV table that starts with its header line",
            ));
        }
        let columns = Columns::from_header(&header, options.planar, &place)?;
        Ok(CsvReader {
            name,
            blocks: BlockReader::new(RowFormat::new(&columns)),
            next: (0, 0),
            block_line: 1,
            columns,
            records,
            ahead: 0,
            keep: options.cells,
            take: Arc::from(""),
        })
    }

    /// Reads the next frame; `false` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: a bad row; the place has the line and the
    /// column.
    pub(crate) fn read(&mut self, row: &mut Row) -> Result<bool> {
        loop {
            if self.hand_out(row)? {
                return Ok(true);
            }
            self.records.pass(std::mem::take(&mut self.ahead));
            if self.blocks.take_careful() {
                break;
            }
            self.read_ahead()?;
            if self.ahead == 0 {
                break;
            }
        }
        self.read_carefully(row)
    }

    /// Parses the regular rows that come next and have arrived.
    fn read_ahead(&mut self) -> Result<()> {
        let Some((text, line)) = self
            .records
            .waiting()
            .map_err(|e| Error::io(&self.name, e))?
        else {
            return Ok(());
        };
        let parsed = self.blocks.read(text, ());
        (self.next, self.block_line) = ((0, 0), line);
        self.ahead = parsed.bytes;
        self.records.line += parsed.line_feeds;
        Ok(())
    }

    /// Returns the next row that was parsed ahead, if there is one.
    fn hand_out(&mut self, row: &mut Row) -> Result<bool> {
        let (piece, plain) = loop {
            let Some(piece) = self.blocks.pieces().get(self.next.0) else {
                return Ok(false);
            };
            match self.blocks.format.row(&piece.records, self.next.1) {
                Some(row) => break (piece, row),
                None => self.next = (self.next.0 + 1, 0),
            }
        };
        self.next.1 += 1;
        let line = self.block_line + piece.lines_before + plain.line;
        let text = &self.records.there()[piece.offset..][plain.text];
        row.xyz.clear();
        row.xyz.extend_from_slice(plain.xyz);
        row.time = plain.time;
        let take = self.columns.take.map(|column| {
            let start = column.checked_sub(1).map_or(0, |c| plain.ends[c] + 1);
            let name = &text[start..plain.ends[column]];
            known(&mut self.take, name, (&self.name, line))
        });
        row.take = take.transpose()?;
        if self.keep {
            row.cells.set_plain(text, plain.ends, line);
        } else {
            row.cells.clear();
        }
        Ok(true)
    }

    /// Reads the next row, regular or not, or reports its error.
    fn read_carefully(&mut self, row: &mut Row) -> Result<bool> {
        let more = self.records.read(&mut row.cells);
        if !more.map_err(|e| fault(&self.name, e))? {
            return Ok(false);
        }
        let line = row.cells.line().unwrap_or(0);
        let width = self.columns.names.len();
        if row.cells.len() != width {
            let what = format!("expected {width} cells, found {}", row.cells.len());
            return Err(Error::data(Place::line(&self.name, line), what));
        }
        row.xyz.clear();
        for (point, axes) in self.columns.coordinates.iter().enumerate() {
            for (axis, column) in axes.iter().enumerate() {
                let value = match column {
                    None => f64::NAN,
                    Some(column) => coordinate(&row.cells[*column]).map_err(|e| {
                        let part = format!(
                            "{}.{}",
                            excerpt(&self.columns.points[point]),
                            ["x", "y", "z"][axis]
                        );
                        e.at(Place::line(&self.name, line).part(part))
                    })?,
                };
                row.xyz.push(value);
            }
        }
        row.time = match self.columns.time {
            None => None,
            Some(column) => {
                let fail = |e: Error| e.at(Place::line(&self.name, line).part("time"));
                let time = parse_cell(&row.cells[column]).map_err(fail)?;
                if time.is_nan() {
                    return Err(fail("a time is missing".into()));
                }
                Some(time)
            }
        };
        let take = (self.columns.take)
            .map(|column| known(&mut self.take, &row.cells[column], (&self.name, line)));
        row.take = take.transpose()?;
        if !self.keep {
            row.cells.clear();
        }
        Ok(true)
    }
}

/// The error of a file named `name` that the `csv` crate reads, in words of ours.
pub fn csv_fault(name: &str, e: &::csv::Error) -> Error {
    use ::csv::ErrorKind;
    let place = match e.position() {
        Some(position) => Place::line(name, position.line()),
        None => Place::file(name),
    };
    let what = match e.kind() {
        ErrorKind::Utf8 { .. } => "is not UTF-8: convert it (iconv -f latin1 -t utf-8)".to_string(),
        ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => format!("expected {expected_len} cells, found {len}"),
        ErrorKind::Deserialize { err, .. } => excerpt(&err.to_string()),
        ErrorKind::Io(e) => excerpt(&e.to_string()),
        _ => excerpt(&e.to_string()),
    };
    Error::data(place, what)
}

/// The error of a name that is no text.
const NO_TEXT: &str =
    "its name is not UTF-8: convert the table (iconv -f latin1 -t utf-8, if it is Latin-1)";

/// The take with this name: `last` where the name is the same, so that the name is stored once.
/// Bytes that are no UTF-8 are not replaced, because two takes could then get one name.
fn known(last: &mut Arc<str>, name: &[u8], (file, line): (&str, u64)) -> Result<Arc<str>> {
    if last.as_bytes() != name {
        let name = std::str::from_utf8(name)
            .map_err(|_| Error::data(Place::line(file, line).part("take"), NO_TEXT))?;
        *last = Arc::from(name);
    }
    Ok(last.clone())
}

/// A cell's number: NaN for an empty cell or `NaN`.
pub(super) fn parse_cell(cell: &[u8]) -> Result<f64> {
    let text = std::str::from_utf8(cell).unwrap_or("\u{fffd}").trim();
    if text.is_empty() || text.eq_ignore_ascii_case("nan") {
        return Ok(f64::NAN);
    }
    super::text::parse_number(text)
}

/// A cell's coordinate: NaN is a missing one.
fn coordinate(cell: &[u8]) -> Result<f64> {
    match parse_cell(cell)? {
        v if v.is_nan() => Ok(v),
        v => check_length(v),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;
    use proptest::strategy::Strategy;

    fn input(text: &str) -> Input {
        Input::new("t.csv", std::io::Cursor::new(text.as_bytes().to_vec())).unwrap()
    }

    fn through(
        text: &str,
        added: &[AddedColumn],
        cells: &[String],
        change: impl Fn(&mut Vec<f64>),
    ) -> String {
        let options = TableOptions {
            cells: true,
            planar: true,
            ..TableOptions::default()
        };
        let mut reader = CsvReader::new(input(text), &options).unwrap();
        let writer = CsvFormat::new(&reader.columns, added);
        let (mut out, mut row) = (Vec::new(), Row::default());
        writer.push_header(&mut out);
        while reader.read(&mut row).unwrap() {
            let mut xyz = row.xyz.clone();
            change(&mut xyz);
            writer.push_row(&mut out, &row, &xyz, cells);
        }
        String::from_utf8(out).unwrap()
    }

    const TABLE: &str = "take,time,a.x,a.y,note,a.z,b.z,b.x,b.y\n\
        \"x, y\",0.0,1.50,,\"say \"\"hi\"\"\",NaN,3,1e0,2\n";

    #[test]
    fn unchanged_cells_keep_their_text() {
        assert_eq!(through(TABLE, &[], &[], |_| {}), TABLE);
        let changed = through(TABLE, &[], &[], |xyz| xyz[1] = 7.25);
        assert_eq!(changed, TABLE.replace("1.50,,", "1.50,7.25,"));
    }

    #[test]
    fn added_columns_follow_their_point_and_replace_old_ones() {
        let added = [
            AddedColumn::new("b.status", After::Point(1)),
            AddedColumn::new("cluster", After::All),
        ];
        let cells = ["observed".to_string(), "4".to_string()];
        let once = through(TABLE, &added, &cells, |_| {});
        assert!(once.starts_with("take,time,a.x,a.y,note,a.z,b.z,b.x,b.y,b.status,cluster\n"));
        assert!(once.ends_with(",2,observed,4\n"));
        assert_eq!(through(&once, &added, &cells, |_| {}), once);
    }

    #[test]
    fn a_column_name_that_is_no_text_is_refused() {
        let latin = b"a.x,a.y,a.z,h\xf6he\n1,2,3,4\n".to_vec();
        let input = Input::new("t.csv", std::io::Cursor::new(latin)).unwrap();
        let message = CsvReader::new(input, &TableOptions::default())
            .err()
            .unwrap();
        assert!(
            message
                .to_string()
                .contains("t.csv:1: column 4: its name is not UTF-8"),
            "{message}"
        );
    }

    #[test]
    fn take_names_that_are_no_text_are_refused() {
        for rows in [
            "a,1,2,3\nh\u{1}\u{1},4,5,6\n",
            "\"a\",1,2,3\n\"h\u{1}\u{1}\",4,5,6\n",
        ] {
            let table = format!("take,a.x,a.y,a.z\n{rows}").replace('\u{1}', "\u{f6}");
            // Two bytes of UTF-8 each; without every first one they are none.
            let latin = table.into_bytes().into_iter().filter(|b| *b != 0xc3);
            let input =
                Input::new("t.csv", std::io::Cursor::new(latin.collect::<Vec<_>>())).unwrap();
            let mut reader = CsvReader::new(input, &TableOptions::default()).unwrap();
            let mut row = Row::default();
            assert!(reader.read(&mut row).unwrap());
            let message = reader.read(&mut row).unwrap_err().to_string();
            assert!(
                message.starts_with("t.csv:3: take: its name is not UTF-8"),
                "{message}"
            );
        }
    }

    #[test]
    fn points_without_z_are_read_and_given_one() {
        let out = through("a.x,a.y\n1,2\n", &[], &[], |xyz| xyz[2] = 5.0);
        assert_eq!(out, "a.x,a.y,a.z\n1,2,5\n");
        assert!(CsvReader::new(input("a.x,a.y\n1,2\n"), &TableOptions::default()).is_err());
    }

    #[test]
    fn bad_tables_are_refused_with_their_place() {
        let says = |text: &str, part: &str| {
            let e = Table::read(input(text), &TableOptions::default())
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
        let table = Table::read(input(text), &TableOptions::default()).unwrap();
        assert_eq!(table.poses.frames(), 3);
        assert_eq!(table.poses.takes(), [0..2, 2..3]);
        assert_eq!(table.poses.rate(), Some(2.0));
        assert!(table.poses.xyz[[1, 0]].is_nan() && table.poses.xyz[[1, 1]].is_nan());
    }

    /// The rows of a table, and how it ends: read one at a time, or ahead in blocks.
    fn all(text: &[u8], block: Option<(usize, usize)>) -> (Vec<String>, String) {
        let options = TableOptions {
            cells: true,
            ..TableOptions::default()
        };
        let input = Input::new("t.csv", std::io::Cursor::new(text.to_vec())).unwrap();
        let size = block.map_or(BLOCK, |(size, _)| size);
        let mut reader = match CsvReader::with_block(input, &options, size) {
            Ok(reader) => reader,
            Err(e) => return (Vec::new(), e.to_string()),
        };
        reader.blocks.piece_bytes = block.map_or(1, |(_, piece)| piece);
        let (mut rows, mut row) = (Vec::new(), Row::default());
        let end = loop {
            reader.blocks.careful = match block {
                None => 1,
                // Behind an irregular row, too, blocks are what is tested.
                Some(_) => reader.blocks.careful.min(1),
            };
            match reader.read(&mut row) {
                Ok(true) => {
                    let cells: Vec<_> = (0..row.cells.len()).map(|i| &row.cells[i]).collect();
                    let bits: Vec<u64> = row.xyz.iter().map(|v| v.to_bits()).collect();
                    let (time, take, line) = (row.time, &row.take, row.cells.line());
                    rows.push(format!("{bits:?} {time:?} {take:?} {line:?} {cells:?}"));
                }
                Ok(false) => break String::from("end"),
                Err(e) => break e.to_string(),
            }
        };
        (rows, end)
    }

    const PLAIN: &str = "note,a.z,a.x,time,a.y,take,b.y,b.x,b.z\n\
        n,1.5,-2e-3,0,,w,3,nan,5\n\
        ,1,2,0.1,3,w,.5,5.,+6\n\
        \n\
        x,1,2,0.2,3,v,4,5,6\n\
        \n\n\
        y,-0,1e12,0.3,3,v,4,5,123456789.123456789\n";

    #[test]
    fn rows_parsed_ahead_equal_rows_read_one_at_a_time() {
        let quoted = PLAIN.replace("x,1", "\"x,\n\"\"\",1");
        let returns = PLAIN.replace("\nx", "\rx");
        for text in [PLAIN, PLAIN.trim_end(), &quoted, &returns] {
            for text in [text.to_string(), text.replace('\n', "\r\n")] {
                let want = all(text.as_bytes(), None);
                assert_eq!((want.0.len(), &*want.1), (4, "end"), "{text:?}");
                for size in 1..text.len() + 2 {
                    for piece in [1, 30, 1000] {
                        let got = all(text.as_bytes(), Some((size, piece)));
                        assert_eq!(got, want, "{size} {piece} {text:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn lines_are_counted_as_an_editor_does() {
        let (_, end) = all(b"\n\n\na.x,a.y\n", None);
        assert!(end.starts_with("t.csv:4: "), "{end}");
        for (bad, blank) in [(4, "\n"), (3, "")] {
            for ending in ["\n", "\r\n"] {
                let text = format!("a.x,a.y,a.z\n1,2,3\n{blank}1,x,3\n").replace('\n', ending);
                for block in [None, Some((BLOCK, 1)), Some((7, 1))] {
                    let (rows, end) = all(text.as_bytes(), block);
                    assert_eq!(rows.len(), 1);
                    assert!(
                        end.starts_with(&format!("t.csv:{bad}: ")),
                        "{end} {text:?} {block:?}"
                    );
                }
            }
        }
    }

    const ODD: [&str; 7] = ["inf", "NaN", "-nan", "1e13", "\u{e9}", "\"1\"", "0x1"];

    proptest::proptest! {
        #[test]
        fn the_first_bad_row_is_reported(
            cells in proptest::collection::vec(
                proptest::prop_oneof![
                    20 => "-?[0-9]{1,3}(\\.[0-9]{1,17})?",
                    4 => "[0-9]?(e[+-]?[0-9]{1,3})?",
                    1 => "[,\"\r\n a-z+.-]{0,3}",
                    1 => proptest::sample::select(ODD.to_vec()).prop_map(String::from),
                ],
                0..150,
            ),
            ending in proptest::sample::select(vec!["\n", "\r\n", "\r"]),
            size in 1..400usize,
            piece in 1..200usize,
        ) {
            let mut text = format!("a.x,a.y,a.z,time,take{ending}");
            for row in cells.chunks(5) {
                text += &row.join(",");
                text += ending;
            }
            let want = all(text.as_bytes(), None);
            proptest::prop_assert_eq!(all(text.as_bytes(), Some((size, piece))), want);
        }
    }
}
