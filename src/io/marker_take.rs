//! What files of markers have in common: points over time, and what the file says of its rate, unit and axes.

use ndarray::Array2;
use std::collections::HashSet;

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
    /// The axis that points up, if the file says so: `+Z`.
    pub up: Option<String>,
    /// What was odd, a line each.
    pub notes: Vec<String>,
}

/// Names of points from the labels of a file: a repeated label gets `_2` and so on, an empty one is `point17` by its number.
pub fn unique_names<'a>(labels: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut taken = HashSet::new();
    let unique = |(i, label): (usize, &str)| {
        let label = match label.trim() {
            "" => format!("point{}", i + 1),
            label => label.to_string(),
        };
        let others = (2..).map(|n| format!("{label}_{n}"));
        let mut names = std::iter::once(label.clone()).chain(others);
        let free = names.find(|name| !taken.contains(name)).unwrap_or_default();
        taken.insert(free.clone());
        free
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
    }
}
