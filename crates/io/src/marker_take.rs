//! What files of markers have in common: points over time, and what the file says of its rate, unit
//! and axes.

use super::csv::{AddedColumn, After};
use super::row::Cells;
use super::text::check_length;
use super::text_cells::TextCells;
use crate::pose::{LengthUnit, Poses, Units, UpAxis};
use crate::{Error, Place, Result};
use ndarray::{Array2, Axis};
use std::collections::{HashMap, HashSet};

/// A take of markers as its file has it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MarkerTake {
    /// The name of the file in messages.
    pub name: String,
    /// The points' names (P), each once.
    pub points: Vec<String>,
    /// (frames, 3 P), in the file's unit and axes; NaN is missing.
    pub xyz: Array2<f64>,
    /// The number of the first frame, from 1.
    pub first_frame: u32,
    /// Frames a second, if the file says so.
    pub rate: Option<f64>,
    /// The unit of length, if the file says so: `mm`.
    pub units: Option<String>,
    /// Whether the unit is a custom and not said, so that a flag goes before it.
    pub units_are_inferred: bool,
    /// The axis that points up, if the file says so: `+Z`.
    pub up: Option<String>,
    /// Whether the axis is not said in so many words, so that a flag goes before it.
    pub up_is_inferred: bool,
    /// What each point is; empty where all are positions.
    pub quantities: Vec<Quantity>,
    /// The times of the frames in seconds, where the file's own are taken; `None`: they follow
    /// from the first frame's number and the rate.
    pub times: Option<Vec<f64>>,
    /// What was odd, a line each.
    pub notes: Vec<String>,
    /// Where the coordinates stand, in a file of text.
    pub cells: TextCells,
    /// Other columns, which tables carry along.
    pub carried: CarriedColumns,
}

/// Columns of a file that are no points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CarriedColumns {
    /// Their names, each once; none is that of a column of the points.
    pub names: Vec<String>,
    /// Their text, a row for each frame that has a line in the file; a row may lack its last
    /// cells.
    pub rows: Vec<Cells>,
}

impl CarriedColumns {
    /// Columns of these names, which a table holds beside `take`, `time` and the points.
    pub(crate) fn new<'a>(
        names: impl IntoIterator<Item = &'a str>,
        points: &[String],
    ) -> CarriedColumns {
        let own = |p: &String| ["x", "y", "z"].map(|axis| format!("{p}.{axis}"));
        let mut taken: Vec<String> = vec!["take".into(), "time".into()];
        taken.extend(points.iter().flat_map(own));
        let known = taken.len();
        taken.extend(names.into_iter().map(str::to_string));
        let all = unique_names(taken.iter().map(String::as_str));
        CarriedColumns {
            names: all[known..].to_vec(),
            rows: Vec::new(),
        }
    }

    /// Adds a row, which stands in line `line`.
    pub(crate) fn push<'a>(&mut self, line: u64, cells: impl Iterator<Item = &'a str>) {
        if self.names.is_empty() {
            return;
        }
        let (mut text, mut ends) = (Vec::new(), Vec::new());
        for cell in cells {
            text.extend_from_slice(cell.as_bytes());
            ends.push(text.len());
        }
        let mut row = Cells::default();
        row.set_fields(&text, &ends, line);
        self.rows.push(row);
    }
}

/// The columns of a take that are carried along, frame by frame.
pub struct CarriedRows<'a> {
    columns: &'a CarriedColumns,
    /// The row of each frame; `None` of a frame that the file leaves out.
    rows: Vec<Option<usize>>,
}

impl CarriedRows<'_> {
    /// The columns, behind all others.
    #[doc(hidden)]
    pub fn columns(&self) -> Vec<AddedColumn> {
        let names = self.columns.names.iter();
        names
            .map(|name| AddedColumn::new(name, After::All))
            .collect()
    }

    /// The cells of a frame.
    #[doc(hidden)]
    pub fn cells(&self, frame: usize) -> Vec<String> {
        let row = self.rows.get(frame).copied().flatten();
        let row = row.and_then(|row| self.columns.rows.get(row));
        let text = |column: usize| {
            let cell = row.and_then(|row| row.get(column)).unwrap_or_default();
            String::from_utf8_lossy(cell).into_owned()
        };
        (0..self.columns.names.len()).map(text).collect()
    }
}

/// What the three numbers of a point are: C3D files store what models compute as points too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quantity {
    /// A position.
    #[default]
    Position,
    /// A position that a model computed.
    Computed,
    /// Angles about three axes.
    Angles,
    /// A force.
    Force,
    /// A moment of force.
    Moment,
    /// A power: one number, whose parts by axis are summed.
    Power,
    /// Another single number.
    Scalar,
}

impl Quantity {
    /// The endings of the columns that hold it: never those of a position.
    pub fn endings(self) -> &'static [&'static str] {
        match self {
            Quantity::Position | Quantity::Computed => &["x", "y", "z"],
            Quantity::Angles => &["rx", "ry", "rz"],
            Quantity::Force => &["fx", "fy", "fz"],
            Quantity::Moment => &["mx", "my", "mz"],
            Quantity::Power => &["p"],
            Quantity::Scalar => &["s"],
        }
    }

    /// Whether it is a position.
    pub fn is_position(self) -> bool {
        matches!(self, Quantity::Position | Quantity::Computed)
    }
}

impl MarkerTake {
    /// What a point is.
    #[doc(hidden)]
    pub fn quantity(&self, point: usize) -> Quantity {
        self.quantities.get(point).copied().unwrap_or_default()
    }

    /// The points that are positions.
    pub fn positions(&self) -> Vec<usize> {
        let is_position = |p: &usize| self.quantity(*p).is_position();
        (0..self.points.len()).filter(is_position).collect()
    }

    /// The unit of length, where the file says one that is known.
    pub fn unit(&self) -> Option<LengthUnit> {
        self.units.as_deref().and_then(LengthUnit::of_word)
    }

    /// The axis that points up, where the file says one.
    pub fn up_axis(&self) -> Option<UpAxis> {
        self.up.as_deref().and_then(UpAxis::of_word)
    }

    /// The unit and the axis: those given, else the file's.
    ///
    /// # Errors
    /// [`Error::Data`]: neither says one.
    #[doc(hidden)]
    pub fn units_or(&self, unit: Option<LengthUnit>, up: Option<UpAxis>) -> Result<Units> {
        let units = "units mm` (or cm, m, in)";
        Ok(Units {
            unit: (unit.or(self.unit()))
                .ok_or_else(|| self.asked_for("unit", self.units.as_deref(), units))?,
            up: (up.or(self.up_axis()))
                .ok_or_else(|| self.asked_for("up axis", self.up.as_deref(), "up z` (or x, y)"))?,
        })
    }

    /// The error of something that the file does not say, or says in words that are not known, and
    /// that no option gives.
    #[doc(hidden)]
    pub fn asked_for(&self, what: &str, said: Option<&str>, option: &str) -> Error {
        let what = match said {
            Some(said) => format!(
                "says \"{said}\" of its {what}, which is not understood; give it with the option \
                 `{option}"
            ),
            None => format!("does not say its {what}; give it with the option `{option}"),
        };
        Error::data(Place::file(&self.name), what)
    }

    /// The points in centimeters, y up, a frame a row, as the take `name`, with `rate` frames per
    /// second.
    ///
    /// ```
    /// use posing_core::pose::{LengthUnit, UpAxis, Units};
    /// use posing_io::MarkerTake;
    ///
    /// let (points, xyz) = (vec!["knee".into()], ndarray::array![[10.0, 20.0, 30.0]]);
    /// let take = MarkerTake { points, xyz, ..MarkerTake::default() };
    /// let units = Units { unit: LengthUnit::Mm, up: UpAxis::Z };
    /// let poses = take.to_poses(units, 100.0, "walk")?;
    /// assert_eq!(poses.xyz, ndarray::array![[1.0, 3.0, -2.0]]);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: a coordinate is too large.
    pub fn to_poses(&self, units: Units, rate: f64, name: &str) -> Result<Poses> {
        let mut xyz = self.xyz.clone();
        units.read_frames(&mut xyz);
        for (t, row) in xyz.rows().into_iter().enumerate() {
            let mut present = row.iter().filter(|v| !v.is_nan());
            present
                .try_for_each(|v| check_length(*v).map(drop))
                .map_err(|e| {
                    let frame = format!("frame {}", u64::from(self.first_frame) + t as u64);
                    e.at(Place::file(&self.name).part(frame))
                })?;
        }
        let first = f64::from(self.first_frame) - 1.0;
        let by_number = || (0..xyz.nrows()).map(|t| (first + t as f64) / rate);
        let times = self.times.clone().unwrap_or_else(|| by_number().collect());
        Ok(Poses {
            points: self.points.clone(),
            time: Some(times),
            take: Some(vec![name.into(); xyz.nrows()]),
            xyz,
        })
    }

    /// The columns that are carried along, frame by frame.
    #[doc(hidden)]
    pub fn carried_rows(&self) -> CarriedRows<'_> {
        let mut row = 0..self.carried.rows.len();
        let rows = if self.points.is_empty() {
            row.map(Some).collect()
        } else {
            (self.cells.lines.iter())
                .map(|line| line.and_then(|_| row.next()))
                .collect()
        };
        CarriedRows {
            columns: &self.carried,
            rows,
        }
    }

    /// The take without its points that are no positions.
    #[doc(hidden)]
    pub fn only_positions(&self) -> MarkerTake {
        let kept = self.positions();
        if kept.len() == self.points.len() {
            return self.clone();
        }
        let columns: Vec<usize> = kept.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        MarkerTake {
            points: kept.iter().map(|&p| self.points[p].clone()).collect(),
            xyz: self.xyz.select(Axis(1), &columns),
            quantities: kept.iter().map(|&p| self.quantity(p)).collect(),
            ..self.clone()
        }
    }
}

/// Names of points from the labels of a file: a repeated label gets `_2` and so on, an empty one is
/// none: `*17` by its number. Control characters, which a terminal would obey, are dropped.
pub(crate) fn unique_names<'a>(labels: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut taken = HashSet::new();
    // By label: the next number to try. A thousand equal labels must not try a thousand numbers
    // each.
    let mut next: HashMap<String, usize> = HashMap::new();
    let labels = labels.into_iter().enumerate();
    let names = labels.map(|(i, label)| {
        let label: String = label.chars().filter(|c| !c.is_control()).collect();
        let label = match label.trim() {
            "" => format!("*{}", i + 1),
            label => label.to_string(),
        };
        let number = next.entry(label.clone()).or_insert(1);
        unique_name(&label, number, &mut taken)
    });
    names.collect()
}

/// The first name of a label that is not taken, from a number on, which is counted up.
fn unique_name(label: &str, number: &mut usize, taken: &mut HashSet<String>) -> String {
    loop {
        let name = match *number {
            1 => label.to_string(),
            n => format!("{label}_{n}"),
        };
        *number += 1;
        if taken.insert(name.clone()) {
            return name;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_never_empty() {
        let names = unique_names(["LASI", "LASI", "", " RASI ", "LASI", "LASI_2"]);
        let wanted = ["LASI", "LASI_2", "*3", "RASI", "LASI_3", "LASI_2_2"];
        assert_eq!(names, wanted);
        assert_eq!(unique_names(["\u{1}", "A\u{1b}[2J"]), ["*1", "A[2J"]);
    }

    #[test]
    fn a_label_that_stands_thousands_of_times_takes_no_time() {
        let names = unique_names(vec!["A"; 200_000]);
        assert_eq!(names[199_999], "A_200000");
    }
}
