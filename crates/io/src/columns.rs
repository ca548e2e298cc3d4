//! The columns of a pose table.
//!
//! Three columns `NAME.x`, `NAME.y`, `NAME.z` are a point; `take` and `time` are what they say;
//! every other column is carried along unchanged. An empty cell (or NaN) is a missing value, 0
//! never is.

use super::text::excerpt;
use crate::pose::{joints, smpl_names};
use crate::{Error, Place, Result};
use std::collections::{HashMap, HashSet};

/// The most columns that a line names.
const MOST_LOST: usize = 8;

/// The meaning of a table's columns.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    /// Every column's name in the file's order; empty for NPY, which has none.
    pub names: Vec<String>,
    /// The points' names.
    pub points: Vec<String>,
    /// The columns of x, y and z of each point; `None` for a z that a table of 2-D points lacks.
    pub coordinates: Vec<[Option<usize>; 3]>,
    /// The column of the take's name.
    pub take: Option<usize>,
    /// The column of the time in seconds.
    pub time: Option<usize>,
}

impl Columns {
    /// The column `NAME.ending` of each point: the first of several.
    #[doc(hidden)]
    pub fn of_points(&self, ending: &str) -> Vec<Option<usize>> {
        let by_point: HashMap<&str, usize> = (self.names.iter().enumerate().rev())
            .filter_map(|(n, name)| Some((name.strip_suffix(ending)?.strip_suffix('.')?, n)))
            .collect();
        let column = |point: &String| by_point.get(point.as_str()).copied();
        self.points.iter().map(column).collect()
    }

    /// What an array does not hold of a table, in a line; `None`: it holds all.
    #[doc(hidden)]
    pub fn lost_in_array(&self) -> Option<String> {
        let some = self.but_for(&[])?;
        Some(format!("NPY holds coordinates only: without {some}"))
    }

    /// The columns that are neither take, time nor of a point, the first of them by name; `None`:
    /// there are none.
    #[doc(hidden)]
    pub fn of_no_point(&self) -> Option<String> {
        self.but_for(&[self.take, self.time])
    }

    /// The columns but for coordinates and `held`.
    fn but_for(&self, held: &[Option<usize>]) -> Option<String> {
        let coordinates = self.coordinates.iter().flatten();
        let held: HashSet<usize> = coordinates.chain(held).flatten().copied().collect();
        let lost = (self.names.iter().enumerate()).filter(|(i, _)| !held.contains(i));
        let lost: Vec<&str> = lost.map(|(_, name)| name.as_str()).collect();
        match lost.len() {
            0 => None,
            1..=MOST_LOST => Some(lost.join(", ")),
            n => {
                let (first, more) = (lost[..MOST_LOST].join(", "), n - MOST_LOST);
                Some(format!("{first} and {more} more"))
            }
        }
    }

    /// Reads a header. With `planar`, `NAME.x` and `NAME.y` without `NAME.z` are a point too: the
    /// 2-D input of Lai et al.
    ///
    /// # Errors
    /// [`Error::Data`]: two columns with one name, or no point.
    pub(crate) fn from_header(header: &[String], planar: bool, place: &Place) -> Result<Columns> {
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
            let what = "has no points; expected columns such as root.x,root.y,root.z";
            return Err(Error::data(place.clone(), what));
        }
        Ok(columns)
    }

    /// Columns for points that come without a table, as amc2xyz writes them: take, time, then the
    /// points.
    ///
    /// ```
    /// use posing_io::Columns;
    ///
    /// let columns = Columns::for_points(vec!["hand".into()], false, true);
    /// assert_eq!(columns.names, ["time", "hand.x", "hand.y", "hand.z"]);
    /// assert_eq!(columns.coordinates, [[Some(1), Some(2), Some(3)]]);
    /// ```
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

    /// The columns of an NPY array with `width` numbers per frame.
    ///
    /// # Errors
    /// [`Error::Data`]: not three columns a name, or no names and not the 69 columns of CMU's
    /// joints.
    pub(crate) fn for_array(
        width: usize,
        names: Option<&[String]>,
        place: &Place,
    ) -> Result<Columns> {
        let points = match names {
            Some([one]) if one == SMPL && width != 3 => smpl(width, place)?,
            Some(names) if 3 * names.len() == width => names.to_vec(),
            Some(names) => {
                let what = format!(
                    "the option `joints` names {} points, the array has {width} columns",
                    names.len()
                );
                return Err(Error::data(place.clone(), what));
            }
            None if width == 3 * joints::CMU.len() => joints::cmu_names(),
            None => {
                let of_smpl = smpl_names(width / 3).is_some();
                let way = if of_smpl { " (smpl for SMPL's)" } else { "" };
                let what = format!(
                    "has {width} columns, not the 69 of CMU's joints; name the points with the \
                     option `joints`{way}"
                );
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

/// The name that stands for the joints of SMPL, of whichever array it is.
const SMPL: &str = "smpl";

/// The names of the joints of an array of SMPL, SMPL-H or SMPL-X with `width` numbers per frame.
fn smpl(width: usize, place: &Place) -> Result<Vec<String>> {
    smpl_names(width / 3).ok_or_else(|| {
        let what = format!(
            "has {} points: arrays of SMPL's joints have 22 (the body), 24, 52 (SMPL-H) or 55 \
             (SMPL-X); name the points with the option `joints A,B,...`",
            width / 3
        );
        Error::data(place.clone(), what)
    })
}

/// Reads the points' names of `--joints`: `23`, `smpl` (which an array gives its names by its
/// width), or a list with commas.
///
/// ```
/// use posing_io::parse_point_names;
///
/// assert_eq!(parse_point_names("hip, knee")?, ["hip", "knee"]);
/// assert!(parse_point_names("hip,hip").is_err());
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Usage`]: an empty name, or one that stands twice.
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
            "\"{bad}\" in the list of points is empty or repeated"
        ))),
        None => Ok(names),
    }
}
