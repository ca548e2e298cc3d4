//! Pose tables as NPZ archives, which `numpy.load` opens: `xyz` (frames, points, 3), `names`
//! (points), `fps` where all takes have one rate, and the columns `take` and `time` (frames).
//!
//! `posing` says that it is such a table, in the unit and axes of a table as CSV.
//! Other columns come along: those of points, `NAME.sd`, as an array `sd` (frames, points), others
//! as one of (frames). A column is of `<f8`, NaN where cells are empty, or of text. Both ways go
//! through the text of CSV: an archive holds the numbers that the table would hold as CSV, bit for
//! bit, though not how their text is written.

use super::columns::Columns;
use super::csv::{AddedColumn, CsvFormat, push_cell};
use super::marker_take::unique_names;
use super::npz::{NpzArray, NpzValues, npz_bytes};
use super::npz_entries::{Entry, Zipped, number, text_width, texts};
use super::row::Row;
use super::text::{excerpt, push_f64};
use crate::pose::Poses;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayD, IxDyn, ShapeBuilder};
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Arrays that are no columns; `posing` is the version of the format, and tells that an archive is
/// such a table.
const OWN: [&str; 4] = ["posing", "xyz", "names", "fps"];
const VERSION: i32 = 1;
/// The largest array of texts, bytes: each is as wide as the longest.
const LARGEST_TEXTS: usize = 1 << 30;
/// The most digits of a whole number that `<f8` holds.
const DIGITS: usize = 15;

/// The rows of a table that becomes an archive.
pub(super) struct ArchiveRows {
    format: CsvFormat,
    line: Vec<u8>,
    reader: csv_core::Reader,
    columns: Vec<Cells>,
    points: Vec<String>,
    frames: usize,
}

/// Columns of points of one kind: what stands behind the names, and the column of each point.
type PointColumns<'a> = (&'a str, Vec<Option<&'a Cells>>);

/// A column: each cell's number among the different texts that the column has; of coordinates the
/// values alone.
#[derive(Default)]
struct Cells {
    name: String,
    coordinates: Option<Vec<f64>>,
    texts: Vec<Arc<str>>,
    known: HashMap<Arc<str>, u32>,
    cells: Vec<u32>,
}

impl Cells {
    fn push(&mut self, text: &str) {
        if let Some(values) = &mut self.coordinates {
            values.push(fast_float2::parse(text).unwrap_or(f64::NAN));
            return;
        }
        let id = match self.known.get(text) {
            Some(id) => *id,
            None => {
                let (id, text) = (self.texts.len() as u32, Arc::<str>::from(text));
                self.texts.push(text.clone());
                self.known.insert(text, id);
                id
            }
        };
        self.cells.push(id);
    }

    /// The cells as numbers, NaN where they are empty; `None`: some are none.
    fn numbers(&self) -> Option<Vec<f64>> {
        if self.coordinates.is_some() {
            return self.coordinates.clone();
        }
        let number = |text: &Arc<str>| match &**text {
            "" => Some(f64::NAN),
            text => fast_float2::parse::<f64, _>(text).ok(),
        };
        let of: Vec<f64> = self.texts.iter().map(number).collect::<Option<_>>()?;
        Some(self.cells.iter().map(|&id| of[id as usize]).collect())
    }

    /// The cells as numbers; `None`: some are none, or are names that look like numbers, such as
    /// 007.
    fn quantities(&self) -> Option<Vec<f64>> {
        let is_name = |text: &Arc<str>| {
            let digits = text.trim_start_matches('-');
            let is_whole = digits.bytes().all(|b| b.is_ascii_digit());
            let is_padded = digits.len() > 1 && digits.starts_with('0');
            let is_word = digits.starts_with(|c: char| c.is_alphabetic());
            let is_word = is_word && !digits.eq_ignore_ascii_case("nan");
            is_word || is_whole && (is_padded || digits.len() > DIGITS)
        };
        if self.texts.iter().any(is_name) {
            None
        } else {
            self.numbers()
        }
    }

    fn text(&self, frame: usize) -> &str {
        &self.texts[self.cells[frame] as usize]
    }
}

impl ArchiveRows {
    /// A table with the columns `columns` and `added`.
    pub(super) fn new(columns: &Columns, added: &[AddedColumn]) -> ArchiveRows {
        let mut rows = ArchiveRows {
            format: CsvFormat::new(columns, added),
            line: Vec::new(),
            reader: csv_core::Reader::new(),
            columns: Vec::new(),
            points: columns.points.clone(),
            frames: 0,
        };
        rows.format.push_header(&mut rows.line);
        let of_point = |point: &String| ["x", "y", "z"].map(|axis| format!("{point}.{axis}"));
        let coordinates: HashSet<String> = columns.points.iter().flat_map(of_point).collect();
        let (text, ends) = rows.fields();
        let named = |name: Cow<'_, str>| Cells {
            coordinates: coordinates.contains(&*name).then(Vec::new),
            name: name.into_owned(),
            ..Cells::default()
        };
        rows.columns = cells(&text, &ends).map(named).collect();
        rows
    }

    /// Adds a frame; the arguments are those of [`CsvFormat::push_row`].
    pub(super) fn push(&mut self, row: &Row, xyz: &[f64], added: &[String]) {
        self.line.clear();
        self.format.push_row(&mut self.line, row, xyz, added);
        let (text, ends) = self.fields();
        for (column, cell) in self.columns.iter_mut().zip(cells(&text, &ends)) {
            column.push(&cell);
        }
        self.frames += 1;
    }

    /// The text of the line's cells, and where each ends.
    fn fields(&mut self) -> (Vec<u8>, Vec<usize>) {
        let mut text = vec![0; self.line.len() + 1];
        let mut ends = vec![0; self.line.len() + 1];
        let read = self.reader.read_record(&self.line, &mut text, &mut ends);
        ends.truncate(read.3);
        (text, ends)
    }

    /// The bytes of the archive.
    ///
    /// # Errors
    /// [`Error::Data`]: a text is so long that an array of it would be too large.
    pub(super) fn bytes(self) -> Result<Vec<u8>> {
        for column in &self.columns {
            let longest = column.texts.iter().map(|text| text.chars().count()).max();
            let longest = longest.unwrap_or(0);
            if self.frames.saturating_mul(4 * longest) > LARGEST_TEXTS
                && column.quantities().is_none()
            {
                let what = format!(
                    "column {} has a text of {longest} letters, and every text of an array is as \
                     wide: write CSV",
                    excerpt(&column.name)
                );
                return Err(Error::data(Place::file("the archive"), what));
            }
        }
        npz_bytes(&self.arrays())
    }

    fn arrays(&self) -> Vec<NpzArray> {
        let (frames, points) = (self.frames, self.points.len());
        let at: HashMap<&str, usize> = (self.columns.iter().enumerate())
            .map(|(i, column)| (column.name.as_str(), i))
            .collect();
        // Columns by what stands behind the names of points.
        let mut of_points: Vec<PointColumns<'_>> = Vec::new();
        let mut of_frames = Vec::new();
        let number: HashMap<&str, usize> = (self.points.iter().enumerate())
            .map(|(i, point)| (point.as_str(), i))
            .collect();
        for column in &self.columns {
            let parted = column.name.rsplit_once('.');
            let point = |name: &str| number.get(name).copied();
            match parted.and_then(|(name, what)| Some((point(name)?, what))) {
                Some((point, what)) => {
                    let at = of_points.iter().position(|(known, _)| *known == what);
                    let at = at.unwrap_or_else(|| {
                        of_points.push((what, vec![None; points]));
                        of_points.len() - 1
                    });
                    of_points[at].1[point] = Some(column);
                }
                None => of_frames.push(column),
            }
        }
        let array = |name: &str, shape: &[usize], values| NpzArray {
            name: name.to_string(),
            shape: shape.to_vec(),
            values,
        };
        let xyz = NpzValues::Doubles(self.xyz(&mut of_points));
        let mut arrays = vec![
            array("posing", &[], NpzValues::Whole(vec![VERSION])),
            array("xyz", &[frames, points, 3], xyz),
            array("names", &[points], NpzValues::Texts(self.points.clone())),
        ];
        let rate = self.rate(&at).map(|fps| NpzValues::Doubles(vec![fps]));
        arrays.extend(rate.map(|fps| array("fps", &[], fps)));
        for column in of_frames {
            let is_text = column.name == "take";
            let values = values(&[Some(column)], frames, is_text);
            arrays.push(array(&free_name(&column.name, &arrays), &[frames], values));
        }
        for (what, columns) in of_points {
            let values = values(&columns, frames, false);
            arrays.push(array(&free_name(what, &arrays), &[frames, points], values));
        }
        arrays
    }

    /// The coordinates (frames, points, 3), which are taken out of the columns.
    fn xyz(&self, of_points: &mut Vec<PointColumns<'_>>) -> Vec<f64> {
        let points = self.points.len();
        let mut xyz = vec![f64::NAN; self.frames * 3 * points];
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let Some(at) = of_points.iter().position(|(what, _)| *what == letter) else {
                continue;
            };
            for (point, column) in of_points.remove(at).1.iter().enumerate() {
                let numbers = column.and_then(Cells::numbers).unwrap_or_default();
                for (t, value) in numbers.into_iter().enumerate() {
                    xyz[(t * points + point) * 3 + axis] = value;
                }
            }
        }
        xyz
    }

    /// Frames per second of all takes.
    fn rate(&self, at: &HashMap<&str, usize>) -> Option<f64> {
        let time = self.columns[*at.get("time")?].numbers()?;
        let takes = at.get("take").map(|&i| &self.columns[i]);
        let take = |c: &Cells| (0..self.frames).map(|t| Arc::from(c.text(t))).collect();
        let poses = Poses {
            xyz: Array2::zeros((self.frames, 0)),
            time: Some(time),
            take: takes.map(take),
            ..Poses::default()
        };
        let rates = poses.rates();
        let first = *rates.first()?;
        rates
            .iter()
            .all(|rate| *rate == first)
            .then_some(first)
            .flatten()
    }
}

/// The cells of a line.
fn cells<'a>(text: &'a [u8], ends: &'a [usize]) -> impl Iterator<Item = Cow<'a, str>> {
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let both = starts.zip(ends);
    both.map(|(from, to)| String::from_utf8_lossy(&text[from..*to]))
}

/// The name of an array that holds a column: another than those that are there.
fn free_name(column: &str, arrays: &[NpzArray]) -> String {
    let mut name = column.to_string();
    while OWN.contains(&&*name) || arrays.iter().any(|array| array.name == name) {
        name.push('_');
    }
    name
}

/// The values of columns side by side (frames, columns): numbers where all cells are.
fn values(columns: &[Option<&Cells>], frames: usize, is_text: bool) -> NpzValues {
    let missing = || vec![f64::NAN; frames];
    let numbers = |c: &Option<&Cells>| c.map_or_else(|| Some(missing()), Cells::quantities);
    let all: Option<Vec<Vec<f64>>> = if is_text {
        None
    } else {
        columns.iter().map(numbers).collect()
    };
    match all {
        Some(all) => NpzValues::Doubles(
            (0..frames)
                .flat_map(|t| all.iter().map(move |column| column[t]))
                .collect(),
        ),
        None => NpzValues::Texts(
            (0..frames)
                .flat_map(|t| columns.iter().map(move |c| c.map_or("", |c| c.text(t))))
                .map(str::to_string)
                .collect(),
        ),
    }
}

/// An array that was read, in C order.
enum Values {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}

impl Values {
    /// Reads an array; `None`: it holds neither numbers nor texts.
    fn read(zipped: &Zipped<'_>, entry: &Entry) -> Result<Option<Values>> {
        let (shape, descr) = (&entry.header.shape, entry.header.descr.as_str());
        let bytes = zipped.values(entry)?;
        let values = match text_width(descr) {
            Some(_) => Values::Texts(c_order(entry, texts(descr, &bytes))),
            None => {
                let size = descr.trim_start_matches(|c: char| !c.is_ascii_digit());
                let size = size.parse().ok().filter(|size| (1..=8).contains(size));
                let values = bytes.chunks_exact(size.unwrap_or(8));
                match values.map(|value| number(descr, value)).collect() {
                    Some(numbers) => Values::Numbers(c_order(entry, numbers)),
                    None => return Ok(None),
                }
            }
        };
        let count = match &values {
            Values::Numbers(numbers) => numbers.len(),
            Values::Texts(texts) => texts.len(),
        };
        let wanted = shape.iter().fold(1, |n: u64, axis| n.saturating_mul(*axis));
        if count as u64 == wanted {
            Ok(Some(values))
        } else {
            Err(zipped.fail(&format!("{} has not as many values as it says", entry.name)))
        }
    }

    fn push(&self, at: usize, line: &mut Vec<u8>) {
        match self {
            Values::Numbers(values) => push_f64(line, values[at]),
            Values::Texts(texts) => push_cell(line, texts[at].as_bytes()),
        }
    }
}

/// The values of an array that may be in Fortran order, the last axis fastest.
fn c_order<T: Clone>(entry: &Entry, values: Vec<T>) -> Vec<T> {
    let shape: Vec<usize> = entry.header.shape.iter().map(|&n| n as usize).collect();
    let is_whole = shape.iter().product::<usize>() == values.len();
    if !entry.header.fortran || !is_whole {
        return values;
    }
    let array = ArrayD::from_shape_vec(IxDyn(&shape).f(), values);
    array.map_or_else(|_| Vec::new(), |array| array.iter().cloned().collect())
}

/// A column of the table in an archive: of frame t it is value `t * width + offset`.
struct Source<'a> {
    head: String,
    values: &'a Values,
    width: usize,
    offset: usize,
}

/// The table in an archive as CSV text; `None`: the archive is no table of posing, which has
/// `posing`, `xyz` and `names`.
///
/// # Errors
/// [`Error::Data`]: it is damaged.
pub(super) fn csv_of(name: &str, archive: &[u8]) -> Result<Option<Vec<u8>>> {
    let zipped = Zipped { name, archive };
    let entries = zipped.entries()?;
    let find = |wanted: &str| entries.iter().find(|e| e.name == wanted);
    let (Some(xyz), Some(named), Some(_)) = (find("xyz"), find("names"), find("posing")) else {
        return Ok(None);
    };
    let &[frames, points, 3] = &xyz.header.shape[..] else {
        return Ok(None);
    };
    if named.header.shape[..] != [points] {
        return Ok(None);
    }
    let (Some(xyz), Some(Values::Texts(named))) =
        (Values::read(&zipped, xyz)?, Values::read(&zipped, named)?)
    else {
        return Ok(None);
    };
    if frames == 0 || points == 0 {
        return Err(Error::data(
            Place::file(name),
            "has no frames, or no points",
        ));
    }
    let is_column = |entry: &&Entry| {
        let shape = &entry.header.shape[..];
        !OWN.contains(&&*entry.name) && (shape == [frames] || shape == [frames, points])
    };
    let mut arrays = Vec::new();
    for entry in entries.iter().filter(is_column) {
        let values = Values::read(&zipped, entry)?;
        let axes = entry.header.shape.len();
        arrays.extend(values.map(|values| (entry.name.as_str(), axes, values)));
    }
    let rate = match find("fps") {
        Some(fps) => number(&fps.header.descr, &zipped.values(fps)?),
        None => None,
    };
    let is_timed = arrays.iter().any(|(name, ..)| *name == "time");
    if let Some(rate) = rate.filter(|rate| !is_timed && *rate > 0.0 && *rate <= 1e6) {
        let takes = arrays.iter().find(|(name, ..)| *name == "take");
        let times = times(frames as usize, rate, takes.map(|(.., takes)| takes));
        arrays.insert(0, ("time", 1, times));
    }
    // The take stands first.
    arrays.sort_by_key(|(name, ..)| *name != "take");
    let names = unique_names(named.iter().map(String::as_str));
    Ok(Some(text(&sources(&names, &xyz, &arrays), frames as usize)))
}

/// Whether an archive is a table of posing.
///
/// # Errors
/// [`Error::Data`]: it is damaged.
pub(super) fn is_table(name: &str, archive: &[u8]) -> Result<bool> {
    let entries = Zipped { name, archive }.entries()?;
    let has = |wanted: &str| entries.iter().any(|entry| entry.name == wanted);
    Ok(["posing", "xyz", "names"].into_iter().all(has))
}

/// The times of frames at `rate`; each take begins at 0.
fn times(frames: usize, rate: f64, takes: Option<&Values>) -> Values {
    let mut first = 0;
    let time = |t: usize| {
        if let Some(Values::Texts(takes)) = takes
            && t > 0
            && takes[t] != takes[t - 1]
        {
            first = t;
        }
        (t - first) as f64 / rate
    };
    Values::Numbers((0..frames).map(time).collect())
}

/// The columns in their order: take and time, those of each point, other ones of frames.
fn sources<'a>(
    names: &[String],
    xyz: &'a Values,
    arrays: &'a [(&str, usize, Values)],
) -> Vec<Source<'a>> {
    let points = names.len();
    let of_frame = |(head, _, values): &'a (&str, usize, Values)| Source {
        head: (*head).to_string(),
        values,
        width: 1,
        offset: 0,
    };
    let is_first = |name: &str| name == "take" || name == "time";
    let of_frames = arrays.iter().filter(|(_, axes, _)| *axes == 1);
    let (first, last): (Vec<_>, Vec<_>) = of_frames.partition(|(name, ..)| is_first(name));
    let of_points = names.iter().enumerate().flat_map(|(point, name)| {
        let coordinates = ["x", "y", "z"].into_iter().enumerate();
        let coordinates = coordinates.map(move |(axis, letter)| Source {
            head: format!("{name}.{letter}"),
            values: xyz,
            width: 3 * points,
            offset: 3 * point + axis,
        });
        let others = arrays.iter().filter(|(_, axes, _)| *axes == 2);
        coordinates.chain(others.map(move |(what, _, values)| Source {
            head: format!("{name}.{what}"),
            values,
            width: points,
            offset: point,
        }))
    });
    let first = first.into_iter().map(of_frame);
    first
        .chain(of_points)
        .chain(last.into_iter().map(of_frame))
        .collect()
}

fn text(sources: &[Source<'_>], frames: usize) -> Vec<u8> {
    let mut text = Vec::new();
    for (i, source) in sources.iter().enumerate() {
        text.extend((i > 0).then_some(b','));
        push_cell(&mut text, source.head.as_bytes());
    }
    text.push(b'\n');
    for t in 0..frames {
        for (i, source) in sources.iter().enumerate() {
            text.extend((i > 0).then_some(b','));
            source
                .values
                .push(t * source.width + source.offset, &mut text);
        }
        text.push(b'\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::csv::After;
    use crate::{Input, RowReader, TableOptions};
    use std::io::Cursor;

    type Frame = (Row, Vec<f64>, Vec<String>);

    /// A table with a quoted take, a missing value, a column of text that one point lacks, and one
    /// of frames.
    fn table() -> (Columns, Vec<AddedColumn>, Vec<Frame>) {
        let columns = Columns::for_points(vec!["a".into(), "b.c".into()], true, true);
        let added = vec![
            AddedColumn::new("b.c.status", After::Point(1)),
            AddedColumn::new("unlike", After::All),
        ];
        let row = |t: usize| {
            let row = Row {
                time: Some(t as f64 / 120.0),
                take: Some(Arc::from("walk, slow")),
                ..Row::default()
            };
            let xyz = vec![0.1 + t as f64, 1.0 / 3.0, -0.0, f64::NAN, f64::NAN, 5e-324];
            (row, xyz, vec!["inferred".into(), format!("{}.5", t)])
        };
        (columns, added, (0..5).map(row).collect())
    }

    #[test]
    fn an_archive_is_the_table_as_csv() {
        let (columns, added, rows) = table();
        let format = CsvFormat::new(&columns, &added);
        let mut csv = Vec::new();
        format.push_header(&mut csv);
        let mut archive = ArchiveRows::new(&columns, &added);
        for (row, xyz, cells) in &rows {
            format.push_row(&mut csv, row, xyz, cells);
            archive.push(row, xyz, cells);
        }
        let bytes = archive.bytes().unwrap();
        let back = csv_of("a.npz", &bytes).unwrap().unwrap();
        let csv = String::from_utf8(csv).unwrap();
        // Both points have a column of what one has.
        let csv = csv
            .replace("a.z,", "a.z,a.status,")
            .replace(",-0,", ",-0,,");
        assert_eq!(String::from_utf8(back).unwrap(), csv);
        let input = Input::new("a.npz", Cursor::new(bytes)).unwrap();
        let mut reader = RowReader::new(input, &TableOptions::default()).unwrap();
        let mut row = Row::default();
        assert!(reader.read(&mut row).unwrap());
        assert_eq!(row.take.as_deref(), Some("walk, slow"));
        assert_eq!(row.xyz[1].to_bits(), (1.0f64 / 3.0).to_bits());
    }

    #[test]
    fn one_rate_is_told_and_gives_times_where_there_are_none() {
        let (columns, added, rows) = table();
        let mut archive = ArchiveRows::new(&columns, &added);
        for (row, xyz, cells) in &rows {
            archive.push(row, xyz, cells);
        }
        let mut arrays = archive.arrays();
        let fps = arrays.iter().find(|a| a.name == "fps").map(|a| &a.values);
        assert_eq!(fps, Some(&NpzValues::Doubles(vec![120.0])));
        arrays.retain(|a| a.name != "time");
        let text = csv_of("a.npz", &npz_bytes(&arrays).unwrap()).unwrap();
        let text = String::from_utf8(text.unwrap()).unwrap();
        assert!(text.starts_with("take,time,a.x"), "{text}");
        assert!(
            text.contains("\n\"walk, slow\",0.008333333333333333,"),
            "{text}"
        );
    }

    #[test]
    fn names_that_look_like_numbers_and_clashing_columns_come_back() {
        let mut columns = Columns::for_points(vec!["a".into()], false, false);
        for name in ["id", "force", "status", "xyz", "note"] {
            columns.names.push(name.into());
        }
        let added: Vec<AddedColumn> = ["id", "force", "status", "xyz", "note"]
            .map(|name| AddedColumn::new(name, After::All))
            .into_iter()
            .chain([AddedColumn::new("a.status", After::Point(0))])
            .collect();
        let mut archive = ArchiveRows::new(&columns, &added);
        let cells = ["007", "1.50", "s", "1", "inf", "observed"].map(String::from);
        archive.push(&Row::default(), &[1.0, 2.0, 3.0], &cells);
        let arrays = archive.arrays();
        let find = |name: &str| arrays.iter().find(|a| a.name == name).map(|a| &a.values);
        assert_eq!(find("id"), Some(&NpzValues::Texts(vec!["007".into()])));
        assert_eq!(find("force"), Some(&NpzValues::Doubles(vec![1.5])));
        assert_eq!(find("note"), Some(&NpzValues::Texts(vec!["inf".into()])));
        assert_eq!(find("xyz_"), Some(&NpzValues::Doubles(vec![1.0])));
        assert!(find("status").is_some() && find("status_").is_some());
        let text = csv_of("a.npz", &npz_bytes(&arrays).unwrap()).unwrap();
        assert!(text.is_some_and(|text| String::from_utf8_lossy(&text).contains("007")));
    }

    #[test]
    fn another_archive_is_no_table_and_one_without_points_is_an_error() {
        let array = |name: &str, shape: &[usize], values| NpzArray {
            name: name.into(),
            shape: shape.to_vec(),
            values,
        };
        let names = array("names", &[0], NpzValues::Texts(Vec::new()));
        let xyz = array("xyz", &[9, 0, 3], NpzValues::Doubles(Vec::new()));
        let foreign = npz_bytes(&[xyz.clone(), names.clone()]).unwrap();
        assert!(csv_of("a.npz", &foreign).unwrap().is_none());
        let own = array("posing", &[], NpzValues::Whole(vec![VERSION]));
        let own = npz_bytes(&[own, xyz, names]).unwrap();
        assert!(csv_of("a.npz", &own).is_err());
    }
}
