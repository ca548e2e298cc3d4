//! Tables of parameters: `take` and `time` where they are known, then columns of numbers.

use super::csv_file::CsvFile;
use super::streams::open_output;
use crate::io::csv::push_cell;
use crate::io::text::{excerpt, push_f64};
use crate::pose::Poses;
use crate::{Error, Place, Result};
use ndarray::Array2;
use std::path::Path;
use std::sync::Arc;

/// A table of numbers.
#[derive(Debug, Clone, Default)]
pub struct NumberTable {
    /// Where it came from.
    pub name: String,
    /// The names of the columns of numbers.
    pub columns: Vec<String>,
    /// The take of each row.
    pub take: Option<Vec<Arc<str>>>,
    /// The time of each row, seconds.
    pub time: Option<Vec<f64>>,
    /// The numbers (rows, columns); an empty cell is NaN.
    pub values: Array2<f64>,
}

/// Reads a CSV table.
///
/// # Errors
/// [`Error::Data`], with the line: the file cannot be read, a row has another number of cells than
/// the header, or a cell is no number.
pub(crate) fn read(path: &Path) -> Result<NumberTable> {
    let mut file = CsvFile::open(path)?;
    let (name, head) = (file.name.clone(), file.head.clone());
    let fail = |line: u64, what: String| Error::data(Place::line(&name, line), what);
    let numbers: Vec<usize> = (0..head.len())
        .filter(|c| !["take", "time"].contains(&&head[*c]))
        .collect();
    let (take, time) = (file.column("take"), file.column("time"));
    let (mut takes, mut times, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for row in file.rows() {
        let (line, row) = row?;
        let number = |c: usize| match &row[c] {
            "" => Ok(f64::NAN),
            text => text
                .parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| {
                    let what = format!("{}: expected a number, found {}", &head[c], excerpt(text));
                    fail(line, what)
                }),
        };
        takes.extend(take.map(|c| Arc::from(&row[c])));
        times.extend(time.map(number).transpose()?);
        for c in &numbers {
            values.push(number(*c)?);
        }
    }
    let columns: Vec<String> = numbers.iter().map(|c| head[*c].to_string()).collect();
    let rows = values.len() / columns.len().max(1);
    if rows == 0 {
        return Err(Error::data(Place::file(&name), "has no numbers"));
    }
    let shape = (rows, columns.len());
    let values = Array2::from_shape_vec(shape, values);
    Ok(NumberTable {
        take: take.map(|_| takes),
        time: time.map(|_| times),
        values: values.map_err(|e| fail(1, e.to_string()))?,
        columns,
        name,
    })
}

/// Writes a row per frame of `poses`: its take and time where they are known, then its numbers
/// (frames, columns).
///
/// # Errors
/// When the file cannot be written.
pub(crate) fn write(
    path: &Path,
    poses: &Poses,
    columns: &[String],
    values: &Array2<f64>,
) -> Result<()> {
    let mut out = open_output(Some(path), false)?;
    let mut head: Vec<&str> = Vec::new();
    head.extend(poses.take.as_ref().map(|_| "take"));
    head.extend(poses.time.as_ref().map(|_| "time"));
    head.extend(columns.iter().map(String::as_str));
    out.write(format!("{}\n", head.join(",")).as_bytes())?;
    let mut line = Vec::new();
    for (t, row) in values.rows().into_iter().enumerate() {
        line.clear();
        if let Some(take) = &poses.take {
            push_cell(&mut line, take[t].as_bytes());
            line.push(b',');
        }
        if let Some(time) = &poses.time {
            push_f64(&mut line, time[t]);
            line.push(b',');
        }
        for v in row {
            if v.is_finite() {
                push_f64(&mut line, *v);
            }
            line.push(b',');
        }
        line.pop();
        line.push(b'\n');
        out.write(&line)?;
    }
    out.finish()
}
