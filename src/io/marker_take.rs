//! What files of markers have in common: points over time, and what the file says of its rate, unit and axes.

use super::row::Cells;
use super::text_cells::TextCells;
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
    /// The times of the frames in seconds, where the file's own are taken; `None`: they follow from the first frame's number and the rate.
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
    /// Their text, a row for each frame that has a line in the file; a row may lack its last cells.
    pub rows: Vec<Cells>,
}

impl CarriedColumns {
    /// Columns of these names, which a table holds beside `take`, `time` and the points.
    pub fn new<'a>(names: impl IntoIterator<Item = &'a str>, points: &[String]) -> CarriedColumns {
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
    pub fn push<'a>(&mut self, line: u64, cells: impl Iterator<Item = &'a str>) {
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

/// What the three numbers of a point are: C3D files store what models compute as points too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quantity {
    /// A position.
    #[default]
    Position,
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
            Quantity::Position => &["x", "y", "z"],
            Quantity::Angles => &["rx", "ry", "rz"],
            Quantity::Force => &["fx", "fy", "fz"],
            Quantity::Moment => &["mx", "my", "mz"],
            Quantity::Power => &["p"],
            Quantity::Scalar => &["s"],
        }
    }
}

impl MarkerTake {
    /// What a point is.
    pub fn quantity(&self, point: usize) -> Quantity {
        self.quantities.get(point).copied().unwrap_or_default()
    }

    /// The points that are positions.
    pub fn positions(&self) -> Vec<usize> {
        let is_position = |p: &usize| self.quantity(*p) == Quantity::Position;
        (0..self.points.len()).filter(is_position).collect()
    }

    /// The take without its points that are no positions.
    pub fn only_positions(&self) -> MarkerTake {
        let kept = self.positions();
        if kept.len() == self.points.len() {
            return self.clone();
        }
        let columns: Vec<usize> = kept.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        MarkerTake {
            points: kept.iter().map(|&p| self.points[p].clone()).collect(),
            xyz: self.xyz.select(Axis(1), &columns),
            quantities: Vec::new(),
            ..self.clone()
        }
    }
}

/// Names of points from the labels of a file: a repeated label gets `_2` and so on, an empty one is `point17` by its number. Control
/// characters, which a terminal would obey, are dropped.
pub fn unique_names<'a>(labels: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut taken = HashSet::new();
    // By label: the next number to try. A thousand equal labels must not try a thousand numbers each.
    let mut next: HashMap<String, usize> = HashMap::new();
    let unique = |(i, label): (usize, &str)| {
        let label: String = label.chars().filter(|c| !c.is_control()).collect();
        let label = match label.trim() {
            "" => format!("point{}", i + 1),
            label => label.to_string(),
        };
        let n = next.entry(label.clone()).or_insert(1);
        loop {
            let name = match *n {
                1 => label.clone(),
                n => format!("{label}_{n}"),
            };
            *n += 1;
            if taken.insert(name.clone()) {
                return name;
            }
        }
    };
    labels.into_iter().enumerate().map(unique).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_never_empty() {
        let names = unique_names(["LASI", "LASI", "", " RASI ", "LASI", "LASI_2"]);
        let wanted = ["LASI", "LASI_2", "point3", "RASI", "LASI_3", "LASI_2_2"];
        assert_eq!(names, wanted);
        assert_eq!(unique_names(["\u{1}", "A\u{1b}[2J"]), ["point1", "A[2J"]);
    }

    #[test]
    fn a_label_that_stands_thousands_of_times_takes_no_time() {
        let names = unique_names(vec!["A"; 200_000]);
        assert_eq!(names[199_999], "A_200000");
    }
}
