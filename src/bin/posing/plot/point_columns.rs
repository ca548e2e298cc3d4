//! What the columns of `--status` say of each point: `NAME.status`, `NAME.sd`, `NAME.method`.

use ndarray::{Array2, Axis};
use posing::io::{Columns, Row};
use posing::pose::FillMethod;
use posing::pose::Status;
use posing::{Error, Place, Result};

/// Frames x points each; `None` where the table has no such columns.
#[derive(Debug, Clone, Default)]
pub struct PointColumns {
    /// `NAME.status`; a point without it is observed.
    pub status: Option<Array2<Status>>,
    /// `NAME.sd` in centimeters; NaN where nothing is stated.
    pub sd: Option<Array2<f64>>,
    /// `NAME.method`; `None` where a point was not filled.
    pub method: Option<Array2<Option<FillMethod>>>,
}

impl PointColumns {
    /// The columns of some points, in the order given.
    pub fn select(&self, points: &[usize]) -> PointColumns {
        PointColumns {
            status: self.status.as_ref().map(|s| s.select(Axis(1), points)),
            sd: self.sd.as_ref().map(|s| s.select(Axis(1), points)),
            method: self.method.as_ref().map(|m| m.select(Axis(1), points)),
        }
    }
}

/// Reads them row by row.
pub struct PointColumnsReader {
    /// Centimeters in the unit of the table.
    unit: f64,
    /// The indices of status, deviation and method among the columns, for each point.
    indices: Vec<[Option<usize>; 3]>,
    status: Vec<Status>,
    sd: Vec<f64>,
    method: Vec<Option<FillMethod>>,
}

impl PointColumnsReader {
    /// Finds the columns. Without a status, a column of the other two names may hold anything, so
    /// it is left alone.
    pub fn new(columns: &Columns, unit: f64) -> PointColumnsReader {
        let index = |point: &str, ending: &str| {
            let wanted = format!("{point}.{ending}");
            columns.names.iter().position(|name| *name == wanted)
        };
        let of_point = |point: &String| match index(point, "status") {
            None => [None; 3],
            status => [status, index(point, "sd"), index(point, "method")],
        };
        PointColumnsReader {
            unit,
            indices: columns.points.iter().map(of_point).collect(),
            status: Vec::new(),
            sd: Vec::new(),
            method: Vec::new(),
        }
    }

    fn has(&self, column: usize) -> bool {
        self.indices.iter().any(|of| of[column].is_some())
    }

    /// Reads a row of `file`.
    ///
    /// # Errors
    /// Data: a cell is no status, no deviation, or no method.
    pub fn push(&mut self, file: &str, row: &Row) -> Result<()> {
        let [has_status, has_sd, has_method] = [0, 1, 2].map(|column| self.has(column));
        for [status, sd, method] in &self.indices {
            if has_status {
                self.status.push(read_status(file, row, *status)?);
            }
            if has_sd {
                self.sd.push(self.unit * read_sd(file, row, *sd)?);
            }
            if has_method {
                self.method.push(read_method(file, row, *method)?);
            }
        }
        Ok(())
    }

    /// What was read.
    pub fn finish(self) -> PointColumns {
        let points = self.indices.len();
        PointColumns {
            status: shaped(self.status, points),
            sd: shaped(self.sd, points),
            method: shaped(self.method, points),
        }
    }
}

/// Frames x points; `None` without values.
fn shaped<T>(values: Vec<T>, points: usize) -> Option<Array2<T>> {
    let frames = values.len().checked_div(points).filter(|f| *f > 0)?;
    Array2::from_shape_vec((frames, points), values).ok()
}

/// The text of a cell; `None` without the column.
fn text(row: &Row, column: Option<usize>) -> Option<String> {
    let cell = row.cells.get(column?)?;
    Some(String::from_utf8_lossy(cell).into_owned())
}

fn fault(file: &str, row: &Row, what: String) -> Error {
    Error::data(Place::line(file, row.cells.line().unwrap_or(0)), what)
}

fn read_status(file: &str, row: &Row, column: Option<usize>) -> Result<Status> {
    let Some(word) = text(row, column) else {
        return Ok(Status::Observed);
    };
    Status::of_name(&word).ok_or_else(|| {
        let names = Status::ALL.map(Status::name).join(", ");
        let what = format!("\"{word}\" is not a status; expected one of {names}");
        fault(file, row, what)
    })
}

fn read_sd(file: &str, row: &Row, column: Option<usize>) -> Result<f64> {
    let cell = text(row, column).unwrap_or_default();
    if cell.is_empty() {
        return Ok(f64::NAN);
    }
    match cell.parse::<f64>() {
        Ok(sd) if sd.is_nan() || sd >= 0.0 => Ok(sd),
        _ => {
            let what = format!("\"{cell}\" is not a standard deviation");
            Err(fault(file, row, what))
        }
    }
}

fn read_method(file: &str, row: &Row, column: Option<usize>) -> Result<Option<FillMethod>> {
    let word = text(row, column).unwrap_or_default();
    if word.is_empty() {
        return Ok(None);
    }
    let method = FillMethod::of_name(&word).ok_or_else(|| {
        let names = FillMethod::ALL.map(FillMethod::name).join(", ");
        let what = format!("\"{word}\" is not a method; expected one of {names}");
        fault(file, row, what)
    });
    method.map(Some)
}
