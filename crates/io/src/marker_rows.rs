//! The rows of a table of markers in text, which TRC, Motive and Qualisys files have in common: the
//! frame's number, its time, and three cells per point.

use super::frame_times::{FrameTimes, TimeCells};
use super::marker_take::{MarkerTake, unique_names};
use super::text::{excerpt, parse_number};
use super::text_cells::TextCells;
use crate::{Error, Place, Result};
use ndarray::{Array2, s};

/// The most columns of coordinates in a row.
pub(crate) const MOST_COLUMNS: usize = 100_000;
/// The most frames: 11 hours at 250 a second.
const MOST_FRAMES: usize = 10_000_000;
/// The most values, frames times columns: 2 GiB.
const MOST_VALUES: usize = 1 << 28;
/// More values than this (128 MiB) may not be so many times what the rows hold: a short file would
/// fill the memory with frames that it leaves out, or with points that it names.
const VALUES: usize = 1 << 24;
const MOST_ABSENT: usize = 16;

/// What a file says beside its rows.
#[derive(Debug, Default)]
pub(crate) struct Stated {
    /// The points' labels; a row may have more points.
    pub labels: Vec<String>,
    /// The number of frames.
    pub frames: Option<usize>,
    /// Frames a second.
    pub rate: Option<f64>,
    /// The unit of length.
    pub units: Option<String>,
    /// Whether the first frame of a recording is frame 0, not 1.
    pub from_zero: bool,
    /// Whether the column of times is the time; else it follows from the frames' numbers and the
    /// rate.
    pub has_times: bool,
    /// Whether the rows count where the header announces more: only a file that ends within a row
    /// ends early.
    pub rows_count: bool,
    /// What was odd, a line each.
    pub notes: Vec<String>,
}

/// The rows that were read so far.
#[derive(Debug, Default)]
pub(crate) struct MarkerRows {
    /// The coordinates of all frames, without the missing ones at a frame's end.
    values: Vec<f64>,
    /// The end of each frame in `values`.
    ends: Vec<usize>,
    /// The line of each frame, if it has one.
    lines: Vec<Option<u64>>,
    /// The coordinates of the longest frame, a multiple of 3.
    width: usize,
    /// The number of the first frame.
    first: u64,
    /// The number of rows.
    rows: usize,
    /// The number of cells of the last row, and of all rows.
    cells: usize,
    all_cells: usize,
    times: TimeCells,
}

impl MarkerRows {
    /// Adds the row that stands in line `line`. Frames whose numbers are left out are frames
    /// without points.
    ///
    /// # Errors
    /// [`Error::Unfit`]: a number that cannot be read, frames that do not rise, or more than fit.
    pub(crate) fn push<'a>(
        &mut self,
        line: u64,
        frame: Option<&str>,
        time: Option<&str>,
        cells: impl Iterator<Item = &'a str>,
    ) -> Result<()> {
        self.begin(frame.map(frame_number).transpose()?)?;
        if let Some(cell) = time {
            self.times.push(self.ends.len(), cell);
        }
        self.lines.push(Some(line));
        self.push_cells(cells)
    }

    /// Adds a frame of coordinates (3 P; NaN is missing), which stands in no line of its own; see
    /// [`MarkerRows::push`]. What is missing does not count among what the rows hold.
    ///
    /// # Errors
    /// [`Error::Unfit`]: frames that do not rise, or more than fit.
    pub(crate) fn push_values(
        &mut self,
        frame: Option<u64>,
        time: Option<&str>,
        values: &[f64],
    ) -> Result<()> {
        if let Some(number) = frame.filter(|n| *n > u64::from(u32::MAX)) {
            return Err(format!("{number} is too large for the number of a frame").into());
        }
        self.begin(frame)?;
        if let Some(cell) = time {
            self.times.push(self.ends.len(), cell);
        }
        self.lines.push(None);
        if values.len() > MOST_COLUMNS {
            return Err(format!("the frame has more than {MOST_COLUMNS} columns").into());
        }
        let start = self.values.len();
        self.values.extend_from_slice(values);
        self.end(start, values.iter().filter(|v| !v.is_nan()).count())
    }

    /// Puts what each frame has in one of several parts, `width` coordinates each, into the first.
    pub(crate) fn fold(&mut self, width: usize) {
        let (mut start, mut values) = (0, Vec::new());
        for end in &mut self.ends {
            let part = self.values[start..*end].chunks(width).next_back();
            values.extend_from_slice(part.unwrap_or_default());
            (start, *end) = (*end, values.len());
        }
        (self.values, self.width) = (values, width);
    }

    /// Begins a frame, of this number if it has one. Frames that are left out before it have no
    /// points.
    fn begin(&mut self, number: Option<u64>) -> Result<()> {
        let next = self.first + self.ends.len() as u64;
        let number = number.unwrap_or(next);
        if self.ends.is_empty() {
            self.first = number;
            return Ok(());
        }
        let absent = number
            .checked_sub(next)
            .ok_or_else(|| format!("frame {number} follows frame {}, expected {next}", next - 1))?;
        if absent >= (MOST_FRAMES - self.ends.len()) as u64 {
            return Err(format!("there are more than {MOST_FRAMES} frames").into());
        }
        let frames = self.ends.len() + absent as usize;
        self.ends.resize(frames, self.values.len());
        self.lines.resize(frames, None);
        Ok(())
    }

    fn push_cells<'a>(&mut self, cells: impl Iterator<Item = &'a str>) -> Result<()> {
        let start = self.values.len();
        for (i, cell) in cells.enumerate() {
            if i == MOST_COLUMNS {
                return Err(format!("the row has more than {MOST_COLUMNS} columns").into());
            }
            self.values.push(coordinate(cell)?);
        }
        let count = self.values.len() - start;
        // A separator at the end of a row is no cell.
        let is_behind = count % 3 == 1 && self.values.last().is_some_and(|v| v.is_nan());
        self.end(start, count - usize::from(is_behind))
    }

    /// Ends a frame whose values begin at `start` and fill so many cells.
    fn end(&mut self, start: usize, cells: usize) -> Result<()> {
        self.rows += 1;
        self.cells = cells;
        self.all_cells += cells;
        while self.values.len() > start && self.values.last().is_some_and(|v| v.is_nan()) {
            self.values.pop();
        }
        let length = self.values.len() - start;
        self.width = self.width.max(length.next_multiple_of(3));
        self.ends.push(self.values.len());
        self.check_size(self.width)
    }

    /// Whether the frames fit into the memory at a width, in coordinates.
    fn check_size(&self, width: usize) -> Result<()> {
        let (frames, points) = (self.ends.len(), width / 3);
        let values = frames.saturating_mul(width);
        if values > MOST_VALUES {
            return Err(format!(
                "{frames} frames of {points} points are more than the {MOST_VALUES} values that \
                 fit; split the file"
            )
            .into());
        }
        if values > VALUES && values > MOST_ABSENT.saturating_mul(self.all_cells) {
            let there = self.all_cells / 3;
            return Err(format!(
                "{frames} frames of {points} points by their numbers and names, but only {there} \
                 points in all rows; check the numbers of the frames and the names of the points"
            )
            .into());
        }
        Ok(())
    }

    /// The take, whose [`TextCells::points`] count the cells that were pushed. `whole` says whether
    /// the file's last line has a line break; with `keep_whole`, a file that ends early gives the
    /// frames that it has.
    ///
    /// # Errors
    /// [`Error::Data`]: no points, no frames, too many, or the file ends early.
    pub(crate) fn take(
        mut self,
        name: &str,
        mut stated: Stated,
        whole: bool,
        keep_whole: bool,
    ) -> Result<MarkerTake> {
        let bad = |what: String| Error::data(Place::file(name), what);
        let named = stated.labels.len();
        let is_short = self.cells < 3 * named || !self.cells.is_multiple_of(3);
        // Without a row, it was the header that had no line break.
        let is_cut = !whole && self.rows > 0 && is_short;
        if is_cut {
            self.ends.pop();
            self.lines.pop();
            self.times.truncate(self.ends.len());
            self.rows -= 1;
        }
        if self.rows == 0 {
            return Err(bad("has no frames".into()));
        }
        let promised = stated.frames.filter(|_| !stated.rows_count || is_cut);
        if let Some(what) = ends_early("frame", self.rows, promised, is_cut) {
            if !keep_whole {
                return Err(bad(format!("{what}; the option `keep_whole` reads those")));
            }
            stated.notes.push(what);
        }
        self.note_oddities(&mut stated, is_cut);
        if stated.labels.iter().any(|label| label.contains('\u{fffd}')) {
            let what = "names of its points are not UTF-8: convert the file first (iconv -f latin1 \
                        -t utf-8, or -f shift_jis)";
            stated.notes.push(what.into());
        }
        let width = self.width.max(3 * named);
        if width == 0 {
            return Err(bad("has no markers".into()));
        }
        self.check_size(width)
            .map_err(|e| e.at(Place::file(name)))?;
        let (points, xyz, kept) =
            named_points(self.dense(width), &stated.labels, &mut stated.notes);
        let first = self.first + u64::from(stated.from_zero);
        let own = if stated.has_times {
            self.times.times(xyz.nrows(), first, stated.rate)
        } else {
            FrameTimes::default()
        };
        stated.notes.extend(own.note);
        Ok(MarkerTake {
            name: name.to_string(),
            points,
            xyz,
            // Some files that count from 1 otherwise begin with a frame 0.
            first_frame: u32::try_from(first).unwrap_or(u32::MAX).max(1),
            rate: own.rate.or(stated.rate),
            times: own.times,
            units: stated.units,
            notes: stated.notes,
            cells: TextCells {
                lines: self.lines,
                points: kept.iter().map(|p| [3 * p, 3 * p + 1, 3 * p + 2]).collect(),
                ..TextCells::default()
            },
            ..MarkerTake::default()
        })
    }

    /// Notes what contradicts the file's own header.
    fn note_oddities(&self, stated: &mut Stated, is_cut: bool) {
        let rows = self.rows;
        let is_wrong = |n: &usize| *n < rows || stated.rows_count && *n > rows;
        // Without the row that is cut off, it was said already.
        if let Some(frames) = stated
            .frames
            .filter(|n| is_wrong(n) && !(is_cut && *n > rows))
        {
            let what = format!("announces {frames} frames but has {rows}");
            stated.notes.push(what);
        }
        match self.ends.len() - rows {
            0 => {}
            1 => {
                let what = "leaves out the number of 1 frame, which has no points then";
                stated.notes.push(what.into());
            }
            left => stated.notes.push(format!(
                "leaves out the numbers of {left} frames, which have no points then"
            )),
        }
        if !stated.has_times {
            stated.notes.extend(self.times.contradiction(stated.rate));
        }
    }

    /// The frames at their full width.
    fn dense(&self, width: usize) -> Array2<f64> {
        let mut xyz = Array2::from_elem((self.ends.len(), width), f64::NAN);
        let mut start = 0;
        for (mut row, &end) in xyz.rows_mut().into_iter().zip(&self.ends) {
            let values = &self.values[start..end];
            row.iter_mut()
                .zip(values)
                .for_each(|(to, from)| *to = *from);
            start = end;
        }
        xyz
    }
}

/// How a file of so many whole rows ends early, if it does; a row is a frame or the like.
pub(crate) fn ends_early(
    row: &str,
    there: usize,
    promised: Option<usize>,
    is_cut: bool,
) -> Option<String> {
    match promised {
        Some(promised) if there < promised => {
            Some(format!("ends after {there} of its {promised} {row}s"))
        }
        _ if is_cut => Some(format!("ends within a {row}, after {there} whole ones")),
        _ => None,
    }
}

/// The points with their names and their numbers. Beyond the labels, those that are seen at all are
/// named by their number.
fn named_points(
    xyz: Array2<f64>,
    labels: &[String],
    notes: &mut Vec<String>,
) -> (Vec<String>, Array2<f64>, Vec<usize>) {
    let (named, points) = (labels.len(), xyz.ncols() / 3);
    let is_seen = |p: usize| {
        let point = xyz.slice(s![.., 3 * p..3 * p + 3]);
        point.iter().any(|v| !v.is_nan())
    };
    let kept: Vec<usize> = (0..points).filter(|&p| p < named || is_seen(p)).collect();
    let all = labels.iter().map(String::as_str);
    let all = unique_names(all.chain((named..points).map(|_| "")));
    let names: Vec<String> = kept.iter().map(|&p| all[p].clone()).collect();
    if let (Some(first), Some(last)) = (names.get(named), names.last()) {
        notes.push(format!(
            "names {named} of its {} points; the others are {first} to {last}",
            names.len()
        ));
    }
    let columns: Vec<usize> = kept.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
    let chosen = (xyz.nrows(), columns.len());
    let xyz = if kept.len() == points {
        xyz
    } else {
        Array2::from_shape_fn(chosen, |(t, c)| xyz[[t, columns[c]]])
    };
    (names, xyz, kept)
}

/// The number of a frame.
fn frame_number(text: &str) -> Result<u64> {
    let number = text.trim().parse::<f64>().ok();
    let whole = number.filter(|n| n.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(n));
    let what = || format!("expected a frame's number, found \"{}\"", excerpt(text));
    whole.map(|n| n as u64).ok_or_else(|| what().into())
}

/// A coordinate; NaN where it is missing.
pub(crate) fn coordinate(cell: &str) -> Result<f64> {
    let cell = cell.trim();
    if is_missing(cell) {
        Ok(f64::NAN)
    } else {
        parse_number(cell)
    }
}

/// Whether a cell says that there is no value. Programs built with Microsoft's older compilers
/// print NaN as `-1.#IND`.
pub(crate) fn is_missing(cell: &str) -> bool {
    let unsigned = cell.trim_start_matches(['+', '-']);
    let begins = |word: &str| {
        let start = unsigned.get(..word.len());
        start.is_some_and(|s| s.eq_ignore_ascii_case(word))
    };
    let words = ["", "null", "na", "n/a"];
    begins("nan")
        || ["1.#IND", "1.#QNAN"].into_iter().any(begins)
        || words.into_iter().any(|w| cell.eq_ignore_ascii_case(w))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(lines: &[&str]) -> Result<MarkerRows> {
        let mut rows = MarkerRows::default();
        for line in lines {
            let mut cells = line.split(' ');
            let (frame, time) = (cells.next(), cells.next());
            rows.push(0, frame, time, cells)?;
        }
        Ok(rows)
    }

    fn stated(labels: &[&str]) -> Stated {
        Stated {
            labels: labels.iter().map(|l| l.to_string()).collect(),
            rate: Some(100.0),
            ..Stated::default()
        }
    }

    #[test]
    fn rows_may_be_short_and_points_without_a_name() {
        let lines = ["7 0 1 2 3", "8 0.01 nan nan nan    4 5 6", "9 0.02"];
        let take = rows(&lines).unwrap().take("x", stated(&["a"]), true, false);
        let take = take.unwrap();
        assert_eq!((take.first_frame, take.xyz.dim()), (7, (3, 6)));
        assert_eq!(take.points, ["a", "*3"]);
        assert_eq!(take.xyz[[1, 5]], 6.0);
        assert_eq!(take.xyz.iter().filter(|v| v.is_nan()).count(), 12);
        let said = "names 1 of its 2 points; the others are *3 to *3";
        assert_eq!(take.notes, [said]);
    }

    #[test]
    fn numbers_of_frames_ascend() {
        let gap = rows(&["1 0 1 2 3", "4 0 1 2 3"]).unwrap();
        let take = gap.take("x", stated(&["a"]), true, false).unwrap();
        assert_eq!(take.xyz.nrows(), 4);
        assert!(take.xyz[[1, 0]].is_nan() && take.notes[0].contains("2 frames"));
        assert!(rows(&["2 0 1 2 3", "2 0 1 2 3"]).is_err());
        assert!(rows(&["1 0 1", "4000000000 0 1"]).is_err());
        assert!(rows(&["1.5 0 1"]).is_err() && rows(&["x 0 1"]).is_err());
    }

    #[test]
    fn an_early_end_is_an_error_unless_it_is_accepted() {
        let two = || rows(&["1 0 1 2 3", "2 0 1 2"]).unwrap();
        let promised = |frames| Stated {
            frames: Some(frames),
            ..stated(&["a"])
        };
        assert!(two().take("x", promised(2), true, false).is_ok());
        assert!(two().take("x", promised(3), true, false).is_err());
        let kept = two().take("x", promised(2), false, true).unwrap();
        assert_eq!(kept.xyz.nrows(), 1);
        let more = two().take("x", promised(1), true, false).unwrap();
        assert!(more.notes[0].contains("announces 1"));
        assert!(two().take("x", stated(&["a"]), false, false).is_err());
    }

    #[test]
    fn rows_may_count_and_end_in_a_separator() {
        let stated = |frames| Stated {
            frames: Some(frames),
            rows_count: true,
            ..stated(&["a"])
        };
        let two = || rows(&["1 0 1 2 3 ", "2 0 1 2 3 "]).unwrap();
        let take = two().take("x", stated(109), false, false).unwrap();
        assert_eq!(take.xyz.dim(), (2, 3));
        assert_eq!(take.notes, ["announces 109 frames but has 2"]);
        // A row that is cut off is an early end.
        let cut = || rows(&["1 0 1 2 3 ", "2 0 1 2"]).unwrap();
        let said = cut().take("x", stated(109), false, false).unwrap_err();
        assert!(
            said.to_string().contains("ends after 1 of its 109 frames"),
            "{said}"
        );
        let kept = cut().take("x", stated(109), false, true).unwrap();
        assert_eq!((kept.xyz.nrows(), kept.notes.len()), (1, 1));
    }

    #[test]
    fn times_that_contradict_the_rate_are_noted() {
        let line = |t: i32| format!("{t} {} 1 2 3", f64::from(t) / 50.0);
        let lines: Vec<String> = (0..20).map(line).collect();
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let take = rows(&lines).unwrap().take("x", stated(&["a"]), true, false);
        assert!(take.unwrap().notes[0].contains("times tell 50.000"));
    }

    #[test]
    fn hostile_rows_are_refused_before_they_fill_the_memory() {
        let wide = "1 ".repeat(MOST_COLUMNS + 10);
        assert!(rows(&[&wide]).unwrap_err().to_string().contains("columns"));
        let mut tall = MarkerRows::default();
        let row = vec!["1"; 9000];
        tall.push(1, Some("1"), None, row.into_iter()).unwrap();
        let far = tall.push(2, Some("100000"), None, std::iter::once("1"));
        assert!(far.unwrap_err().to_string().contains("split the file"));
        let labels = vec!["a"; 30_000];
        let few = rows(&["1 0 1", "9000 0 1"]).unwrap();
        let said = few.take("x", stated(&labels), true, false).unwrap_err();
        assert!(said.to_string().contains("split the file"), "{said}");
        // Below the limit, but far more than the rows hold.
        let mut tall = MarkerRows::default();
        tall.push(1, Some("1"), None, vec!["1"; 9000].into_iter())
            .unwrap();
        let far = tall.push(2, Some("29000"), None, std::iter::once("1"));
        assert!(
            far.unwrap_err()
                .to_string()
                .contains("only 3000 points in all rows")
        );
    }

    #[test]
    fn missing_is_written_in_many_ways() {
        for cell in ["", "NaN", "-nan(ind)", "-1.#IND00", "null", "N/A"] {
            assert!(coordinate(cell).unwrap().is_nan(), "{cell}");
        }
        assert_eq!(coordinate(" 0.000 ").unwrap(), 0.0);
        for cell in ["x", "1,5", "inf", "1.#INF"] {
            assert!(coordinate(cell).is_err(), "{cell}");
        }
    }
}
