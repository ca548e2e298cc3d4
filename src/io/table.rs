//! The pose table: what its columns mean, rows read and written one at a time, or a whole table in memory.
//!
//! Three columns `NAME.x`, `NAME.y`, `NAME.z` are a point; `take` and `time` are what they say; every other column is
//! carried along unchanged. An empty cell (or NaN) is a missing value, 0 never is.

use super::Input;
pub use super::cells::Cells;
use super::csv::CsvReader;
use super::input::ContentKind;
use super::npy::NpyReader;
use super::text::excerpt;
use crate::pose::{Poses, joints};
use crate::{Error, Place, Result};
use ndarray::Array2;
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// What the columns of a table mean.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    /// Every column's name in the file's order; empty for NPY, which has none.
    pub names: Vec<String>,
    /// The points' names.
    pub points: Vec<String>,
    /// For each point the columns of x, y and z; `None` for a z that a table of 2-D points lacks.
    pub coordinates: Vec<[Option<usize>; 3]>,
    /// The column of the take's name.
    pub take: Option<usize>,
    /// The column of the time in seconds.
    pub time: Option<usize>,
}

impl Columns {
    /// Reads a header. With `planar`, `NAME.x` and `NAME.y` without `NAME.z` are a point too: the paper's 2-D input.
    pub fn from_header(header: &[String], planar: bool, place: &Place) -> Result<Columns> {
        let mut index = HashMap::new();
        for (i, name) in header.iter().enumerate() {
            if index.insert(name.as_str(), i).is_some() {
                return Err(Error::data(
                    place.clone(),
                    format!("two columns are named \"{}\"", excerpt(name)),
                ));
            }
        }
        let mut columns = Columns {
            names: header.to_vec(),
            ..Columns::default()
        };
        for name in header {
            let Some(point) = name.strip_suffix(".x").filter(|p| !p.is_empty()) else {
                continue;
            };
            let at = |axis: &str| index.get(format!("{point}.{axis}").as_str()).copied();
            match (at("y"), at("z")) {
                (Some(y), Some(z)) => columns.coordinates.push([at("x"), Some(y), Some(z)]),
                (Some(y), None) if planar => columns.coordinates.push([at("x"), Some(y), None]),
                _ => continue,
            }
            columns.points.push(point.to_string());
        }
        columns.take = index.get("take").copied();
        columns.time = index.get("time").copied();
        if columns.points.is_empty() {
            let what = "no point: expected columns such as root.x,root.y,root.z";
            return Err(Error::data(place.clone(), what));
        }
        Ok(columns)
    }

    /// Columns for points that come without a table, as amc2xyz writes them: take, time, then the points.
    pub fn for_points(points: Vec<String>, take: bool, time: bool) -> Columns {
        let mut names = Vec::new();
        let mut columns = Columns::default();
        for (wanted, name, slot) in [
            (take, "take", &mut columns.take),
            (time, "time", &mut columns.time),
        ] {
            if wanted {
                *slot = Some(names.len());
                names.push(name.to_string());
            }
        }
        for point in &points {
            columns
                .coordinates
                .push([0, 1, 2].map(|a| Some(names.len() + a)));
            names.extend(["x", "y", "z"].map(|a| format!("{point}.{a}")));
        }
        columns.names = names;
        columns.points = points;
        columns
    }

    /// The columns of an NPY array with `width` numbers a frame.
    pub fn for_array(width: usize, names: Option<&[String]>, place: &Place) -> Result<Columns> {
        let points = match names {
            Some(names) if 3 * names.len() == width => names.to_vec(),
            Some(names) => {
                let what = format!(
                    "--joints names {} points, the array has {width} columns",
                    names.len()
                );
                return Err(Error::data(place.clone(), what));
            }
            None if width == 3 * joints::CMU.len() => joints::cmu_names(),
            None => {
                let what =
                    format!("{width} columns are not CMU's 69; name the points with --joints");
                return Err(Error::data(place.clone(), what));
            }
        };
        Ok(Columns::for_points(points, false, false))
    }

    /// How many numbers a frame has: three a point.
    pub fn width(&self) -> usize {
        3 * self.points.len()
    }
}

/// Reads the points' names of `--joints`: `23`, or a list with commas.
pub fn parse_point_names(list: &str) -> Result<Vec<String>> {
    if list == "23" {
        return Ok(joints::cmu_names());
    }
    let names: Vec<String> = list.split(',').map(|n| n.trim().to_string()).collect();
    let mut seen = HashSet::new();
    match names
        .iter()
        .find(|n| n.is_empty() || !seen.insert(n.as_str()))
    {
        Some(bad) => Err(Error::usage(format!(
            "\"{bad}\" in a list of points is empty or stands twice"
        ))),
        None => Ok(names),
    }
}

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

/// Rows of a table of either format, one at a time.
pub enum RowReader {
    /// Text.
    Csv(Box<CsvReader>),
    /// NumPy's array.
    Npy(Box<NpyReader>),
}

impl RowReader {
    /// Recognises the format by content and reads the header.
    pub fn new(input: Input, options: &ReadOptions) -> Result<RowReader> {
        match input.kind() {
            ContentKind::Npy => NpyReader::new(input, options).map(|r| RowReader::Npy(Box::new(r))),
            ContentKind::Text => {
                CsvReader::new(input, options).map(|r| RowReader::Csv(Box::new(r)))
            }
            ContentKind::Empty => Err(Error::data(
                Place::file(input.name),
                "is empty, expected a pose table",
            )),
            ContentKind::Npz => {
                let what = "is an NPZ archive (a model?), expected a pose table as CSV or NPY";
                Err(Error::data(Place::file(input.name), what))
            }
        }
    }
    /// What the columns mean.
    pub fn columns(&self) -> &Columns {
        match self {
            RowReader::Csv(r) => &r.columns,
            RowReader::Npy(r) => &r.columns,
        }
    }
    /// Reads the next frame; `false` at the end.
    pub fn read(&mut self, row: &mut Row) -> Result<bool> {
        match self {
            RowReader::Csv(r) => r.read(row),
            RowReader::Npy(r) => r.read(row),
        }
    }
    /// The name that messages use.
    pub fn name(&self) -> &str {
        match self {
            RowReader::Csv(r) => &r.name,
            RowReader::Npy(r) => &r.name,
        }
    }
}

/// A whole table in memory.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Where it came from.
    pub name: String,
    /// What the columns mean.
    pub columns: Columns,
    /// The poses.
    pub poses: Poses,
    /// The cells as they stood, a row each, if they were kept; else empty.
    pub cells: Vec<Cells>,
    /// Whether the numbers were converted (units, up axis), so that the cells no longer say the same.
    pub converted: bool,
}

impl Table {
    /// Reads a whole table.
    pub fn read(input: Input, options: &ReadOptions) -> Result<Table> {
        let mut reader = RowReader::new(input, options)?;
        let columns = reader.columns().clone();
        let mut builder = PosesBuilder::new(&columns);
        let mut cells = Vec::new();
        let mut row = Row::default();
        while reader.read(&mut row)? {
            builder.push(&row);
            if options.cells {
                cells.push(std::mem::take(&mut row.cells));
            }
        }
        Ok(Table {
            name: reader.name().to_string(),
            columns,
            poses: builder.finish(),
            cells,
            converted: false,
        })
    }
}

/// Gathers rows into poses.
pub struct PosesBuilder {
    points: Vec<String>,
    xyz: Vec<f64>,
    time: Option<Vec<f64>>,
    take: Option<Vec<Arc<str>>>,
}

impl PosesBuilder {
    /// An empty gathering for such columns.
    pub fn new(columns: &Columns) -> PosesBuilder {
        PosesBuilder {
            points: columns.points.clone(),
            xyz: Vec::new(),
            time: columns.time.map(|_| Vec::new()),
            take: columns.take.map(|_| Vec::new()),
        }
    }
    /// Adds a frame.
    pub fn push(&mut self, row: &Row) {
        self.xyz.extend_from_slice(&row.xyz);
        if let Some(time) = &mut self.time {
            time.push(row.time.unwrap_or(f64::NAN));
        }
        if let Some(take) = &mut self.take {
            take.push(row.take.clone().unwrap_or_else(|| Arc::from("")));
        }
    }
    /// The poses gathered.
    pub fn finish(self) -> Poses {
        let width = 3 * self.points.len();
        let frames = self.xyz.len() / width.max(1);
        let xyz = Array2::from_shape_vec((frames, width), self.xyz).unwrap_or_default();
        Poses {
            points: self.points,
            xyz,
            time: self.time,
            take: self.take,
        }
    }
}
