//! Pose tables in memory: read, changed, written.

use super::columns::Columns;
use super::csv;
use super::input::Input;
use super::output::Output;
use super::row::{Cells, Row, TableOptions};
use super::table_reader::RowReader;
use super::table_writer::{TableFormat, TableWriter};
use crate::Result;
use crate::pose::Poses;
use crate::pose::one_take::{one_take, take_rows};
use ndarray::{Array2, Axis};
use std::path::Path;
use std::sync::Arc;

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
    /// Standard deviation of a coordinate of each point (frames, J), cm, as the columns NAME.sd of
    /// kept cells say; NaN where they say none. `None` without such columns: the points are exact.
    pub sd: Option<Array2<f64>>,
}

impl Table {
    /// Gives a point another name, in its columns too.
    pub(crate) fn rename_point(&mut self, point: usize, name: &str) {
        let old = std::mem::replace(&mut self.poses.points[point], name.to_string());
        if let Some(own) = self.columns.points.get_mut(point) {
            *own = name.to_string();
        }
        for column in &mut self.columns.names {
            let ending = column
                .strip_prefix(&old)
                .and_then(|rest| rest.strip_prefix('.'));
            if let Some(ending) = ending.filter(|rest| !rest.contains('.')) {
                *column = format!("{name}.{ending}");
            }
        }
    }

    /// The poses of the take `wanted`, or of all of a table with one take, and their standard
    /// deviations.
    ///
    /// # Errors
    /// [`Error::Data`](crate::Error::Data): several takes, of which none is wanted, or no such
    /// take.
    pub fn one_take(self, wanted: Option<&str>) -> Result<(Poses, Option<Array2<f64>>)> {
        let rows = take_rows(&self.poses, wanted, &self.name)?;
        let sd = match (rows, self.sd) {
            (Some(rows), Some(sd)) => Some(sd.select(Axis(0), &rows)),
            (_, sd) => sd,
        };
        Ok((one_take(self.poses, wanted, &self.name)?, sd))
    }

    /// Reads a table, CSV or NPY by its content; gzip and zstd are decompressed.
    ///
    /// ```
    /// use posing_io::Table;
    ///
    /// let folder = tempfile::tempdir()?;
    /// let (path, copy) = (folder.path().join("walk.csv"), folder.path().join("copy.csv"));
    /// std::fs::write(&path, "time,hand.x,hand.y,hand.z\n0.0,1.50,2,\n0.1,1e0,2,3\n")?;
    /// let mut table = Table::open(&path)?;
    /// assert_eq!(table.poses.rate(), Some(10.0));
    /// assert!(table.poses.xyz[[0, 2]].is_nan()); // missing
    /// table.poses.xyz[[0, 2]] = 2.5;
    /// table.save(&copy)?;
    /// // The other cells keep their text.
    /// let expected = "time,hand.x,hand.y,hand.z\n0.0,1.50,2,2.5\n0.1,1e0,2,3\n";
    /// assert_eq!(std::fs::read_to_string(&copy)?, expected);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// `Error::Io`: the file cannot be read. `Error::Data`: no table; the place has the line and
    /// the column.
    pub fn open(path: impl AsRef<Path>) -> Result<Table> {
        let options = TableOptions {
            cells: true,
            ..TableOptions::default()
        };
        Table::read(Input::open(path)?, &options)
    }

    /// Reads a whole table from an open input.
    ///
    /// # Errors
    /// Those of [`Table::open`].
    pub fn read(input: Input, options: &TableOptions) -> Result<Table> {
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
            sd: deviations(&columns, &cells, 1.0),
            columns,
            poses: builder.finish(),
            cells,
        })
    }

    /// A table of `poses`, with the columns that `amc2xyz` writes: take and time, where the poses
    /// have them, then the points. [`Table::poses`] are the way back.
    ///
    /// ```
    /// use ndarray::array;
    /// use posing_io::Table;
    /// use posing_core::pose::Poses;
    ///
    /// let (points, xyz) = (vec!["hand".into()], array![[1.0, 2.0, f64::NAN]]);
    /// let poses = Poses { points, xyz, ..Poses::default() };
    /// let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("hand.csv");
    /// Table::from_poses(poses).save(&path)?;
    /// assert_eq!(std::fs::read_to_string(&path)?, "hand.x,hand.y,hand.z\n1,2,\n");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from_poses(poses: Poses) -> Table {
        Table {
            columns: Columns::for_points(
                poses.points.clone(),
                poses.take.is_some(),
                poses.time.is_some(),
            ),
            poses,
            ..Table::default()
        }
    }

    /// Writes the table, NPY where the path ends in `.npy`, else CSV; complete or not at all. The
    /// bytes are those that the commands write: a cell whose text reads as the number in
    /// [`Table::poses`] keeps its text.
    ///
    /// # Errors
    /// `Error::Io`: the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let format = TableFormat::of_path(&path);
        let mut writer = TableWriter::new(Output::file(path)?, format, &self.columns, &[])?;
        let (mut row, mut xyz) = (Row::default(), Vec::new());
        for frame in 0..self.poses.frames() {
            self.row_into(frame, &mut row);
            xyz.clone_from(&row.xyz);
            // The numbers of the file, for comparison: a cell keeps its text if its number has not
            // changed.
            for (point, columns) in self.columns.coordinates.iter().enumerate() {
                for (axis, cell) in columns.iter().enumerate() {
                    if let Some(cell) = cell.and_then(|c| row.cells.get(c)) {
                        row.xyz[3 * point + axis] = csv::parse_cell(cell).unwrap_or(f64::NAN);
                    }
                }
            }
            writer.write(&row, &xyz, &[])?;
        }
        writer.finish()
    }

    /// Sets `row` to frame `frame`.
    pub fn row_into(&self, frame: usize, row: &mut Row) {
        row.xyz.clear();
        row.xyz.extend(self.poses.frame(frame));
        row.time = self.poses.time.as_ref().map(|t| t[frame]);
        row.take = self.poses.take.as_ref().map(|t| t[frame].clone());
        match self.cells.get(frame) {
            Some(cells) => row.cells.copy_from(cells),
            None => row.cells.clear(),
        }
        row.converted = false;
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

/// The standard deviations (frames, J; cm) that the columns NAME.sd of some cells hold, in a unit
/// of so many `centimeters`; NaN where a cell is no number. `None` where no point has such a
/// column.
#[doc(hidden)]
pub fn deviations(columns: &Columns, cells: &[Cells], centimeters: f64) -> Option<Array2<f64>> {
    let of_points = columns.of_points("sd");
    if cells.is_empty() || of_points.iter().all(Option::is_none) {
        return None;
    }
    let number = |cell: &[u8]| std::str::from_utf8(cell).ok()?.trim().parse::<f64>().ok();
    Some(Array2::from_shape_fn(
        (cells.len(), of_points.len()),
        |(t, p)| {
            let cell = of_points[p].and_then(|column| cells[t].get(column));
            let sd = cell.and_then(number).filter(|sd| *sd >= 0.0);
            sd.map_or(f64::NAN, |sd| sd * centimeters)
        },
    ))
}
