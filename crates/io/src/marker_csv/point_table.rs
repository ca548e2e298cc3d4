//! Tables of points of other programs: their titles tell the points, other columns are carried
//! along.

use crate::marker_rows::{MarkerRows, Stated};
use crate::marker_take::{CarriedColumns, MarkerTake};
use crate::point_titles::{MOST_ROWS, PointTitles, is_frame, seconds_of};
use crate::pose::Poses;
use crate::row_cells::texts_of;
use crate::text::{Lines, decimal, excerpt, parse_number};
use crate::text_start::BLANK;
use crate::{Error, Place, Result};
use posing_core::often;
use std::borrow::Cow;
use std::io::BufRead;

/// A line and its number.
type Line = (u64, String);

/// Reads the file.
pub(crate) fn read(mut lines: Lines<impl BufRead>, keep_whole: bool) -> Result<MarkerTake> {
    let name = lines.name.clone();
    let bad = |what: &str| Error::data(Place::file(&name), what);
    let mut head: Vec<Line> = Vec::new();
    while head.len() < MOST_ROWS
        && let Some(line) = next(&mut lines)?
    {
        head.push(line);
    }
    let texts: Vec<&str> = head.iter().map(|(_, line)| line.as_str()).collect();
    let titles = PointTitles::read(&texts);
    let titles = titles.ok_or_else(|| bad("has no columns of points"))?;
    if titles.points.is_empty() {
        let what =
            "has points of two dimensions (x and y without z): positions in space are expected";
        return Err(bad(what));
    }
    let mut table = Table::new(&name, &titles, head.get(titles.rows));
    let rows: Vec<Line> = head.split_off(titles.rows.min(head.len()));
    for (number, line) in rows {
        table.push(&line, number, lines.whole)?;
    }
    while let Some((number, line)) = next(&mut lines)? {
        table.push(&line, number, lines.whole)?;
    }
    table.take(lines.whole, keep_whole)
}

/// The next line that is not blank.
fn next(lines: &mut Lines<impl BufRead>) -> Result<Option<Line>> {
    let line = lines.next_filled(|c| BLANK.contains(&c))?;
    let line = line.map(str::to_string);
    Ok(line.map(|line| (lines.number, line)))
}

/// How the numbers of a table are written whose cells commas do not part.
#[derive(Debug, Default)]
pub(super) struct Decimals {
    has_comma: bool,
    has_point: bool,
}

impl Decimals {
    /// A number's text with a point before its decimals.
    ///
    /// # Errors
    /// [`Error::Unfit`]: some numbers have a comma and some a point, of which one may part
    /// thousands.
    pub(super) fn text<'c>(&mut self, cell: &'c str, separator: u8) -> Result<Cow<'c, str>> {
        self.has_point |= cell.contains('.');
        self.has_comma |= separator != b',' && cell.contains(',');
        match (self.has_comma, self.has_point) {
            (true, true) => Err(format!(
                "has numbers with a comma and with a point, as in \"{}\": write all decimals with \
                 a point, and no signs between thousands",
                excerpt(cell)
            )
            .into()),
            (true, false) => Ok(Cow::Owned(decimal(cell))),
            _ => Ok(Cow::Borrowed(cell)),
        }
    }
}

/// The rows that were read so far.
struct Table<'a> {
    name: &'a str,
    titles: &'a PointTitles,
    separator: u8,
    /// Whether a number was read whose decimals stand behind a comma, and one with a point.
    decimals: Decimals,
    /// The columns of the coordinates, point by point.
    at: Vec<usize>,
    /// The column of the time, and the seconds of its unit.
    time: Option<(usize, f64)>,
    /// The column of the frame's number.
    frame: Option<usize>,
    /// The columns that are carried along.
    others: Vec<usize>,
    rows: MarkerRows,
    times: Vec<f64>,
    /// How often the time falls, and the line where it falls first.
    falls: (usize, u64),
    carried: CarriedColumns,
    last_frame: Option<f64>,
    /// Frames whose number does not follow the one before.
    jumps: usize,
}

impl Table<'_> {
    /// A table with these titles, whose first row is `first`: a column of times that are no numbers
    /// is carried along.
    fn new<'a>(name: &'a str, titles: &'a PointTitles, first: Option<&Line>) -> Table<'a> {
        let separator = titles.separator.byte().unwrap_or(b',');
        let cells = first.map(|(_, line)| texts_of(line, separator));
        let is_number = |column: usize| {
            let cell = cells.as_ref().and_then(|cells| cells.get(column));
            cell.is_some_and(|cell| parse_number(&decimal(cell)).is_ok())
        };
        let mut others = titles.others.iter();
        let time = others.find_map(|(title, column)| {
            let unit = seconds_of(title)?;
            is_number(*column).then_some((*column, unit))
        });
        let mut others = titles.others.iter();
        let frame = others.find(|(title, column)| is_frame(title) && is_number(*column));
        let frame = frame.map(|(_, column)| *column);
        let is_other = |column: &usize| Some(*column) != time.map(|(column, _)| column);
        let others: Vec<(&str, usize)> = (titles.others.iter())
            .map(|(title, column)| (title.as_str(), *column))
            .filter(|(_, column)| is_other(column))
            .collect();
        let points: Vec<String> = titles.points.iter().map(|(name, _)| name.clone()).collect();
        let names = others.iter().map(|(title, _)| *title);
        Table {
            name,
            titles,
            separator,
            decimals: Decimals::default(),
            at: titles.points.iter().flat_map(|(_, at)| *at).collect(),
            time,
            frame,
            carried: CarriedColumns::new(names, &points),
            others: others.into_iter().map(|(_, column)| column).collect(),
            rows: MarkerRows::default(),
            times: Vec::new(),
            falls: (0, 0),
            last_frame: None,
            jumps: 0,
        }
    }

    /// Adds the row in line `number`.
    fn push(&mut self, line: &str, number: u64, is_whole: bool) -> Result<()> {
        let cells = texts_of(line, self.separator);
        let cell = |column: usize| cells.get(column).map(|c| &**c);
        let width = self.titles.width;
        let bad = |what: String| Error::data(Place::line(self.name, number), what);
        if cells.iter().skip(width).any(|c| !c.is_empty()) {
            return Err(bad(format!(
                "expected {width} cells, found {}",
                cells.len()
            )));
        }
        // The last line of a file that is cut off lacks its last cells.
        let is_cut = !is_whole && cells.len() < width;
        let chosen = self.at.iter().map_while(|&c| match cell(c) {
            None if is_cut => None,
            cell => Some(cell.unwrap_or_default()),
        });
        let chosen = chosen.map(|cell| self.decimals.text(cell, self.separator));
        let chosen = chosen.collect::<Result<Vec<_>>>();
        let chosen = chosen.map_err(|e| e.at(Place::line(self.name, number)))?;
        let chosen = chosen.iter().map(|cell| &**cell);
        let pushed = self.rows.push(number, None, None, chosen);
        pushed.map_err(|e| e.at(Place::line(self.name, number)))?;
        if let Some((column, unit)) = self.time {
            let text = self
                .decimals
                .text(cell(column).unwrap_or_default(), self.separator);
            let seconds = text.and_then(|text| parse_number(&text));
            let seconds = seconds.map_err(|what| bad(format!("time: {what}")))?;
            let seconds = seconds * unit;
            if self.times.last().is_some_and(|last| seconds < *last) {
                let first = if self.falls.0 == 0 {
                    number
                } else {
                    self.falls.1
                };
                self.falls = (self.falls.0 + 1, first);
            }
            self.times.push(seconds);
        }
        let others = self.others.iter().map(|&c| cell(c).unwrap_or_default());
        self.carried.push(number, others);
        let frame = self.frame.and_then(|c| parse_number(cell(c)?).ok());
        let follows = match (self.last_frame, frame) {
            (Some(last), Some(frame)) => frame == last + 1.0,
            _ => true,
        };
        self.jumps += usize::from(!follows);
        self.last_frame = frame;
        Ok(())
    }

    /// The take. See [`MarkerRows::take`].
    fn take(self, is_whole: bool, keep_whole: bool) -> Result<MarkerTake> {
        let mut times = self.time.map(|_| self.times);
        let labels: Vec<String> = (self.titles.points.iter())
            .map(|(name, _)| name.clone())
            .collect();
        let units = self.titles.unit();
        let units = units.map_err(|e| e.at(Place::file(self.name)))?;
        let stated = Stated {
            labels,
            units,
            notes: self.titles.notes(),
            ..Stated::default()
        };
        let mut take = self.rows.take(self.name, stated, is_whole, keep_whole)?;
        let frames = take.xyz.nrows();
        if let Some(times) = &mut times {
            times.truncate(frames);
            take.rate = rate_of_times(times);
        }
        if let (falls @ 1.., line) = self.falls {
            take.notes.push(format!(
                "its time falls {}, first in line {line}, but its rows are taken for one take: \
                 split a table of several trials",
                often(falls)
            ));
        }
        if times.is_none() && self.jumps > 0 {
            take.notes.push(format!(
                "the numbers of its frames jump {}, but it has no times: its rows are taken for \
                 frames in a row",
                often(self.jumps)
            ));
        }
        take.times = times;
        take.carried = self.carried;
        take.carried.rows.truncate(frames);
        take.cells.separator = self.titles.separator;
        take.cells.decimal_comma = self.decimals.has_comma;
        take.cells.move_points(|cell| self.at[cell]);
        Ok(take)
    }
}

/// Frames a second by their times.
pub(crate) fn rate_of_times(times: &[f64]) -> Option<f64> {
    let rows = times.iter().map(|t| (Some(*t), None));
    Poses::without_points(rows).rate()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, marker_csv};

    fn take(text: &str) -> Result<MarkerTake> {
        let bytes = text.as_bytes().to_vec();
        let input = Input::new("x.csv", std::io::Cursor::new(bytes))?;
        marker_csv::read(input, None, false)
    }

    const ANIPOSE: &str = "fnum,a_l_x,a_l_y,a_l_z,a_l_error,b_x,b_y,b_z,b_error\n\
        0,1,2,3,.5,4,5,6,.5\n\
        1,1.5,2,3,.25,,,,\n";

    /// The carried cells of a row.
    fn carried(take: &MarkerTake, row: usize) -> Vec<String> {
        let cells = &take.carried.rows[row];
        let text = |i: usize| String::from_utf8_lossy(&cells[i]).into_owned();
        (0..cells.len()).map(text).collect()
    }

    #[test]
    fn other_columns_are_carried_along() {
        let take = take(ANIPOSE).unwrap();
        assert_eq!(take.points, ["a_l", "b"]);
        assert_eq!(take.carried.names, ["fnum", "a_l_error", "b_error"]);
        assert_eq!(carried(&take, 1), ["1", ".25", ""]);
        assert_eq!((take.rate, take.units.is_none()), (None, true));
        assert!(take.xyz[[1, 3]].is_nan() && take.notes.is_empty());
        let mut new = take.xyz.clone();
        new.row_mut(1)[4] = 9.5;
        let bytes = take
            .cells
            .with_points(ANIPOSE.as_bytes(), take.xyz.view(), new.view());
        let wanted = ANIPOSE.replace(".25,,,,\n", ".25,,9.5,,\n");
        assert_eq!(String::from_utf8(bytes).unwrap(), wanted);
    }

    #[test]
    fn decimals_may_stand_behind_a_comma() {
        let text = "time;A.x;A.y;A.z;note\n0;-1,5;2;3,25;\"so, so\"\n0,01;1,5;2;3;\n";
        let read = take(text).unwrap();
        assert_eq!(read.xyz.row(0).to_vec(), [-1.5, 2.0, 3.25]);
        assert_eq!(
            (read.rate, carried(&read, 0)),
            (Some(100.0), vec!["so, so".into()])
        );
        let mut new = read.xyz.clone();
        new[[0, 1]] = 7.5;
        let bytes = read
            .cells
            .with_points(text.as_bytes(), read.xyz.view(), new.view());
        assert_eq!(
            String::from_utf8(bytes).unwrap(),
            text.replace(";2;3,25", ";7,5;3,25")
        );
        // One of them may part thousands.
        let mixed = text.replace("0,01;1,5", "0,01;1.5");
        let said = take(&mixed).unwrap_err().to_string();
        assert!(
            said.contains("x.csv:3: has numbers with a comma and with a point"),
            "{said}"
        );
    }

    #[test]
    fn a_table_of_other_quantities_is_told_by_name() {
        let text = "time,gyr_x,gyr_y,gyr_z,pelvis_scale_x,pelvis_scale_y,pelvis_scale_z\n\
            0,1,2,3,1,1,1\n";
        let said = take(text).unwrap_err().to_string();
        assert!(
            said.contains("no positions") && said.contains("gyr, pelvis_scale"),
            "{said}"
        );
        let with_a_marker = text.replace("gyr", "LFHD");
        let read = take(&with_a_marker).unwrap();
        assert_eq!(read.points, ["LFHD"]);
        assert!(read.notes[0].contains("pelvis_scale"), "{:?}", read.notes);
        assert_eq!(read.carried.names.len(), 3);
    }

    #[test]
    fn times_are_those_of_the_file() {
        let text = "Time (ms);A x;A y;A z;note\n3380;1;2;3;\"a;b\"\n3390;1;2;3;\n3400;1;2;3;x\n";
        let take = take(text).unwrap();
        assert_eq!(take.rate, Some(100.0));
        let times = take.times.clone().unwrap();
        assert!((times[0] - 3.38).abs() <= 1e-12, "{times:?}");
        assert_eq!(
            (carried(&take, 0), take.carried.names.len()),
            (vec!["a;b".into()], 1)
        );
        let clock = super::tests::take(&text.replace("33", "0:33").replace("3400", "0:3400"));
        let clock = clock.unwrap();
        assert_eq!((clock.times, clock.carried.names.len()), (None, 2));
        for (title, factor) in [
            ("timestamp", None),
            ("Timestamps", None),
            ("timestamp (s)", Some(3380.0)),
            ("timestamp_ms", Some(3.0)),
        ] {
            let stamps = super::tests::take(&text.replace("Time (ms)", title)).unwrap();
            let first = stamps.times.as_ref().map(|times| times[0].floor());
            assert_eq!(first, factor, "{title}");
            assert_eq!(
                stamps.carried.names.len(),
                1 + usize::from(factor.is_none())
            );
        }
    }

    #[test]
    fn what_a_person_should_know_is_told() {
        let falls = "t,a_x,a_y,a_z\n0,1,2,3\n1,1,2,3\n0,1,2,3\n1,1,2,3\n0,1,2,3\n";
        let falls = take(falls).unwrap();
        let what = "its time falls 2 times, first in line 4";
        assert!(falls.notes[0].starts_with(what), "{:?}", falls.notes);
        let mixed = "a_x,a_y,a_z,q_x,q_y,q_z,q_w,LAngle_x,LAngle_y,LAngle_z,b_x,b_y\n\
            1,2,3,4,5,6,7,8,9,10,11,12\n";
        let mixed = take(mixed).unwrap();
        assert_eq!((mixed.points.len(), mixed.carried.names.len()), (1, 9));
        assert!(mixed.notes[0].contains("q, LAngle"), "{:?}", mixed.notes);
        assert!(mixed.notes[1].contains("without z: b"), "{:?}", mixed.notes);
        let unnamed = take(",A,,,,,\n,x,y,z,x,y,z\n0,1,2,3,4,5,6\n").unwrap();
        assert_eq!(unnamed.points, ["A", "*2"]);
    }

    #[test]
    fn headers_of_several_rows_are_read() {
        let two = take(",A,A,A,B,B,B\n,x,y,z,x,y,z\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n").unwrap();
        assert_eq!((two.points.len(), two.xyz.nrows()), (2, 2));
        assert_eq!(
            (two.carried.names[0].as_str(), two.xyz[[0, 3]]),
            ("index", 4.0)
        );
        assert_eq!(two.cells.lines, [Some(3), Some(4)]);
        let units = take("t,A,,\n,X,Y,Z\ns,m,m,m\n0,1,2,3\n").unwrap();
        assert_eq!(units.units.as_deref(), Some("m"));
        let said = take("bodyparts,A,A\ncoords,x,y\n0,1,2\n").unwrap_err();
        assert!(said.to_string().contains("two dimensions"), "{said}");
    }

    #[test]
    fn faults_have_a_place_and_jumps_are_told() {
        let fails = |text: &str, part: &str| {
            let said = take(text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        fails(&ANIPOSE.replace("1.5", "x"), "x.csv:3: expected a number");
        fails(
            &ANIPOSE.replace("0,1,2", "0,7,1,2"),
            "x.csv:2: expected 9 cells",
        );
        fails("a_x,a_y,a_z\n", "has no frames");
        let units = "a_x (m),a_y (m),a_z (m),b_x (mm),b_y (mm),b_z (mm)\n1,2,3,4,5,6\n";
        fails(units, "x.csv: has points in m and in mm: convert");
        fails(
            "time,a_x,a_y,a_z\n0,1,2,3\n,1,2,3\n",
            "x.csv:3: time: expected",
        );
        fails("a_x,a_y,a_z\n1,2,3\n1,2", "the option `keep_whole`");
        let jumps = take(&ANIPOSE.replace("\n1,", "\n7,")).unwrap();
        assert!(jumps.notes[0].contains("jump once,"), "{:?}", jumps.notes);
    }
}
