//! Titles of tables of points, as many programs write them: one row of NAME_x, NAME_y, NAME_z, or a
//! row of names above a row of x, y, z (pandas, DeepLabCut, Vicon Nexus).

use super::marker_rows::is_missing;
use super::row_cells::texts_of;
use super::text::{decimal, excerpt};
use super::text_cells::Separator;
use crate::Result;
use std::collections::HashMap;

/// The most rows that titles have: scorer, individual, point, axis, and the unit or the name of the
/// index.
pub(crate) const MOST_ROWS: usize = 5;

/// What stands between a name and an axis.
const PARTING: [char; 5] = ['_', '.', ' ', ':', '-'];

/// What the columns of a table of points are.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct PointTitles {
    /// How cells are parted.
    pub separator: Separator,
    /// How many rows are titles.
    pub rows: usize,
    /// The number of columns.
    pub width: usize,
    /// The points and their columns of x, y and z.
    pub points: Vec<(String, [usize; 3])>,
    /// The other columns.
    pub others: Vec<(String, usize)>,
    /// The units that stand with the axes, each once.
    pub units: Vec<String>,
    /// What has x, y and z but is no position by its name or by a column w.
    pub quantities: Vec<String>,
    /// Points of x and y without z.
    pub planar: Vec<String>,
}

impl PointTitles {
    /// Reads the titles that the first rows of a table, `lines`, begin with; `None` where they are
    /// no titles of points.
    pub(crate) fn read(lines: &[&str]) -> Option<PointTitles> {
        PointTitles::of_lines(lines, Group::is_position)
    }

    /// Reads titles all of which are those of points, whatever their names are.
    pub(crate) fn of_markers(lines: &[&str]) -> Option<PointTitles> {
        PointTitles::of_lines(lines, |_| true)
    }

    fn of_lines(lines: &[&str], is_position: fn(&Group) -> bool) -> Option<PointTitles> {
        let titles = PointTitles::of_any(lines, is_position)?;
        (!titles.points.is_empty() || !titles.planar.is_empty()).then_some(titles)
    }

    /// What the first rows of a table have with axes though nothing of it is a position, for a
    /// message; `None`: nothing, or positions.
    pub(crate) fn no_positions(lines: &[&str]) -> Option<String> {
        let titles = PointTitles::of_any(lines, Group::is_position)?;
        let is_none = titles.points.is_empty() && titles.planar.is_empty();
        (is_none && !titles.quantities.is_empty()).then(|| list(&titles.quantities))
    }

    fn of_any(lines: &[&str], is_position: fn(&Group) -> bool) -> Option<PointTitles> {
        let separator = separator_of(lines.first()?)?;
        let byte = separator.byte()?;
        let of_line = |line: &&str| texts_of(line, byte).iter().map(|c| c.to_string()).collect();
        let rows: Vec<Vec<String>> = lines.iter().take(MOST_ROWS).map(of_line).collect();
        let mut titles = match Group::of_one_row(&rows[0]) {
            groups if groups.iter().any(|g| g.xyz().is_some()) => {
                PointTitles::of_groups(groups, &rows[0], 1, is_position)
            }
            one => {
                let axes = (1..rows.len().min(4)).find(|&r| is_axes(&rows[r]));
                let of_rows = axes.map(|axes| {
                    let names = names_above(&rows, axes);
                    let groups = Group::of_rows(&names, &rows[axes]);
                    let titles: Vec<String> = (0..names.len().max(rows[axes].len()))
                        .map(|c| joined(names.get(c), rows[axes].get(c)))
                        .collect();
                    PointTitles::of_groups(groups, &titles, axes + 1, is_position)
                });
                of_rows.unwrap_or_else(|| PointTitles::of_groups(one, &rows[0], 1, is_position))
            }
        };
        titles.separator = separator;
        titles.take_last_row(&rows);
        Some(titles)
    }

    /// The unit of length, if one is stated.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: there are several.
    pub(crate) fn unit(&self) -> Result<Option<String>> {
        one_unit(&self.units)
    }

    /// What stays among the other columns though it has axes, a line each.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.quantities.is_empty() {
            notes.push(format!(
                "carried along, since they are no positions by their titles: {}",
                list(&self.quantities)
            ));
        }
        if !self.planar.is_empty() {
            notes.push(format!(
                "carried along, since they have x and y without z: {}",
                list(&self.planar)
            ));
        }
        notes
    }

    fn of_groups(
        groups: Vec<Group>,
        titles: &[String],
        rows: usize,
        is_position: fn(&Group) -> bool,
    ) -> PointTitles {
        let mut is_point = vec![false; titles.len()];
        let mut out = PointTitles {
            rows,
            width: titles.len(),
            ..PointTitles::default()
        };
        for group in groups {
            match group.xyz() {
                Some(xyz) if is_position(&group) => {
                    xyz.iter().for_each(|&c| is_point[c] = true);
                    group
                        .units
                        .iter()
                        .for_each(|unit| add_unit(&mut out.units, unit));
                    out.points.push((group.name, xyz));
                }
                Some(_) => out.quantities.push(group.name),
                None if group.is_planar() && is_position(&group) => out.planar.push(group.name),
                None => {}
            }
        }
        let others = titles.iter().enumerate().filter(|(c, _)| !is_point[*c]);
        // Cells at a row's end, behind a last separator, have no title.
        let last = titles.iter().rposition(|t| !t.is_empty()).unwrap_or(0);
        let others = others.filter(|(c, _)| *c <= last);
        out.others = others
            .map(|(c, title)| match title.as_str() {
                "" => ("index".to_string(), c),
                title => (title.to_string(), c),
            })
            .collect();
        out
    }

    /// Behind the axes may stand a row of units, or one that only names the index.
    fn take_last_row(&mut self, rows: &[Vec<String>]) {
        let Some(row) = rows.get(self.rows) else {
            return;
        };
        let mut cells = self.points.iter().flat_map(|(_, at)| at);
        let cells: Vec<&str> = cells
            .by_ref()
            .map(|&c| row.get(c).map_or("", String::as_str))
            .collect();
        let is_word = |cell: &&str| !is_missing(cell) && decimal(cell).parse::<f64>().is_err();
        let names_index = self.rows > 1
            && row.first().is_some_and(|c| is_word(&c.as_str()))
            && row.iter().skip(1).all(String::is_empty);
        if !cells.is_empty() && cells.iter().all(is_word) {
            cells
                .iter()
                .for_each(|unit| add_unit(&mut self.units, unit));
            self.rows += 1;
        } else if names_index {
            self.rows += 1;
        }
    }
}

/// Adds a unit that a title states, unless it is known.
pub(crate) fn add_unit(units: &mut Vec<String>, unit: &str) {
    let is_known = |known: &String| known.eq_ignore_ascii_case(unit);
    if !unit.is_empty() && !units.iter().any(is_known) {
        units.push(unit.to_string());
    }
}

/// The only unit of the points, if one is stated.
///
/// # Errors
/// [`crate::Error::Unfit`]: there are several.
pub(crate) fn one_unit(units: &[String]) -> Result<Option<String>> {
    match units {
        [one, other, ..] => Err(format!(
            "has points in {} and in {}: convert them to one unit, or leave out those of the other",
            excerpt(one),
            excerpt(other)
        )
        .into()),
        units => Ok(units.first().map(|unit| excerpt(unit))),
    }
}

/// The points of columns that are all named by a point and an axis, x, y and z in turn; `None`:
/// some are not.
pub(crate) fn points_of(columns: &[String]) -> Option<Vec<String>> {
    let (points, rest) = columns.as_chunks::<3>();
    let point = |three: &[String; 3]| {
        let axes = three.each_ref().map(|title| TitledAxis::of(title));
        let [Some(x), Some(y), Some(z)] = axes else {
            return None;
        };
        let is_one = x.key() == y.key() && y.key() == z.key();
        (is_one && [x.axis, y.axis, z.axis] == [0, 1, 2]).then(|| x.name.to_string())
    };
    if rest.is_empty() {
        points.iter().map(point).collect()
    } else {
        None
    }
}

/// Names for a note: not more than a line holds.
fn list(names: &[String]) -> String {
    const MOST: usize = 8;
    let mut shown: Vec<String> = names.iter().take(MOST).map(|n| excerpt(n)).collect();
    let unnamed = shown.iter_mut().filter(|name| name.is_empty());
    unnamed.for_each(|name| *name = "points without a name".to_string());
    if names.len() > MOST {
        shown.push(format!("{} more", names.len() - MOST));
    }
    shown.join(", ")
}

/// Words that a name has whose x, y and z are no position; they may stand in the plural.
const OTHER_QUANTITIES: [&str; 33] = [
    "rot",
    "rotation",
    "euler",
    "angle",
    "orientation",
    "quat",
    "quaternion",
    "vel",
    "velocity",
    "velocities",
    "acc",
    "accel",
    "acceleration",
    "accelerometer",
    "gyr",
    "gyro",
    "gyroscope",
    "mag",
    "magnetometer",
    "omega",
    "angular",
    "speed",
    "jerk",
    "scale",
    "scaling",
    "factor",
    "impulse",
    "force",
    "grf",
    "moment",
    "torque",
    "power",
    "reaction",
];
/// Last words of a position, whatever is said before: the center of rotation is one.
const POSITIONS: [&str; 3] = ["pos", "position", "center"];

/// Whether a name says that its x, y and z are no position.
fn is_other_quantity(name: &str) -> bool {
    let words = words_of(name);
    let is_of = |word: &String, list: &[&str]| {
        let single = word.strip_suffix('s').unwrap_or(word);
        list.contains(&word.as_str()) || list.contains(&single)
    };
    // Europeans write center with -tre.
    let american = |word: &String| word.replace("tre", "ter");
    let is_position = (words.last()).is_some_and(|word| is_of(&american(word), &POSITIONS));
    !is_position && words.iter().any(|word| is_of(word, &OTHER_QUANTITIES))
}

/// The words of a name in small letters: `LKneeAngles_2` has l, knee, angles.
fn words_of(name: &str) -> Vec<String> {
    let letters: Vec<char> = name.chars().collect();
    let mut words = vec![String::new()];
    for (i, letter) in letters.iter().enumerate() {
        let before = i.checked_sub(1).map(|b| letters[b]);
        let is_small = |i: usize| letters.get(i).is_some_and(|c| c.is_lowercase());
        // The plural of a word in capitals, such as GRFs, is one word.
        let is_plural = letters.get(i + 1) == Some(&'s') && !is_small(i + 2);
        let begins = letter.is_uppercase()
            && (before.is_some_and(char::is_lowercase) || is_small(i + 1) && !is_plural);
        if begins || !letter.is_alphabetic() {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| letter.is_alphabetic()) {
            word.extend(letter.to_lowercase());
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

/// How the first row is parted: by what stands in it most often.
pub(crate) fn separator_of(line: &str) -> Option<Separator> {
    let count = |separator: &Separator| {
        let byte = separator.byte();
        line.bytes().filter(|b| Some(*b) == byte).count()
    };
    let all = [Separator::Semicolon, Separator::Tab, Separator::Comma];
    all.into_iter().max_by_key(count).filter(|s| count(s) > 0)
}

/// Columns of one name.
#[derive(Debug)]
struct Group {
    name: String,
    /// The columns of x, y, z, and of w, which a quaternion has.
    axes: [Option<usize>; 4],
    /// What stands in brackets behind the axes.
    units: Vec<String>,
}

impl Group {
    fn new(name: &str) -> Group {
        Group {
            name: name.to_string(),
            axes: [None; 4],
            units: Vec::new(),
        }
    }

    fn xyz(&self) -> Option<[usize; 3]> {
        let [x, y, z, _] = self.axes;
        Some([x?, y?, z?])
    }

    fn is_planar(&self) -> bool {
        self.axes[0].is_some() && self.axes[1].is_some()
    }

    fn is_position(&self) -> bool {
        self.axes[3].is_none() && !is_other_quantity(&self.name)
    }

    /// The groups of a row of NAME_x, NAME_y, NAME_z.
    fn of_one_row(titles: &[String]) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        let mut by_key: HashMap<(&str, char, bool), usize> = HashMap::new();
        for (column, title) in titles.iter().enumerate() {
            let Some(axis) = TitledAxis::of(title) else {
                continue;
            };
            let group = *by_key.entry(axis.key()).or_insert_with(|| {
                groups.push(Group::new(axis.name));
                groups.len() - 1
            });
            groups[group].axes[axis.axis].get_or_insert(column);
            groups[group].units.extend(axis.unit.map(str::to_string));
        }
        groups
    }

    /// The groups of a row of axes below names, one per column; before the first name there are
    /// none. A name that comes again begins a new group.
    fn of_rows(names: &[String], axes: &[String]) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        let mut last: HashMap<&str, usize> = HashMap::new();
        let named = names.iter().position(|name| !name.is_empty());
        let columns = names.iter().zip(axes).enumerate();
        for (column, (name, axis)) in columns.skip(named.unwrap_or(names.len())) {
            let Some(axis) = axis_of(axis) else {
                continue;
            };
            let open = last.get(name.as_str()).copied();
            let open = open.filter(|&g| groups[g].axes[axis].is_none());
            let group = open.unwrap_or_else(|| {
                groups.push(Group::new(name));
                groups.len() - 1
            });
            last.insert(name, group);
            groups[group].axes[axis] = Some(column);
        }
        groups
    }
}

/// A title that is a name and an axis.
struct TitledAxis<'a> {
    name: &'a str,
    axis: usize,
    parting: char,
    is_upper: bool,
    unit: Option<&'a str>,
}

impl<'a> TitledAxis<'a> {
    /// Reads `LFHD_x`, `LFHD.X`, `LFHD x (mm)`.
    fn of(title: &'a str) -> Option<TitledAxis<'a>> {
        let (title, unit) = without_unit(title);
        let mut back = title.char_indices().rev();
        let (at, letter) = back.next()?;
        let (end, parting) = back.next().filter(|(_, c)| PARTING.contains(c))?;
        let name = title[..end].trim();
        let axis = axis_of(&title[at..])?;
        (!name.is_empty()).then_some(TitledAxis {
            name,
            axis,
            parting,
            is_upper: letter.is_uppercase(),
            unit,
        })
    }

    fn key(&self) -> (&'a str, char, bool) {
        (self.name, self.parting, self.is_upper)
    }
}

/// A title without a unit in brackets, and the unit.
pub(crate) fn without_unit(title: &str) -> (&str, Option<&str>) {
    for (open, close) in [('(', ')'), ('[', ']')] {
        let inner = title.strip_suffix(close).and_then(|t| t.rsplit_once(open));
        if let Some((title, unit)) = inner {
            return (title.trim_end(), Some(unit.trim()));
        }
    }
    (title, None)
}

/// The number of an axis; w, the fourth number of a quaternion, is 3.
pub(crate) fn axis_of(title: &str) -> Option<usize> {
    let is = |axis: &&str| title.eq_ignore_ascii_case(axis);
    ["x", "y", "z", "w"].iter().position(is)
}

/// The seconds of the unit of a column of times, by its title. Timestamps without a unit may be of
/// any: milliseconds, nanoseconds.
pub(crate) fn seconds_of(title: &str) -> Option<f64> {
    let plain: String = title.to_ascii_lowercase();
    let plain: String = plain.chars().filter(char::is_ascii_alphanumeric).collect();
    match plain.as_str() {
        "timestamps" if title.trim().eq_ignore_ascii_case("timestamps") => None,
        "time" | "times" | "t" | "timesec" | "timeseconds" | "timeins" | "seconds"
        | "timestamps" | "timestampsec" | "timestampseconds" => Some(1.0),
        "timems" | "timemsec" | "timemilliseconds" | "milliseconds" | "timestampms" => Some(1e-3),
        _ => None,
    }
}

/// Whether a column counts frames, by its title.
pub(crate) fn is_frame(title: &str) -> bool {
    let plain: String = title.to_ascii_lowercase();
    let plain: String = plain.chars().filter(char::is_ascii_alphanumeric).collect();
    let names = [
        "frame",
        "frames",
        "fnum",
        "framenumber",
        "frameno",
        "framenum",
        "index",
    ];
    names.contains(&plain.as_str())
}

/// Whether a row has axes below names: x and y at least.
fn is_axes(row: &[String]) -> bool {
    let has = |axis: usize| row.iter().any(|c| axis_of(c) == Some(axis));
    has(0) && has(1)
}

/// A row of names with each repeated up to the next one; where `ends`, an axis that comes a second
/// time ends it.
fn filled(row: &[String], axes: &[String], ends: bool) -> Vec<String> {
    let mut last = String::new();
    let mut seen = [false; 4];
    let mut out = Vec::with_capacity(axes.len());
    for (c, axis) in axes.iter().enumerate() {
        if let Some(name) = row.get(c).filter(|name| !name.is_empty()) {
            last.clone_from(name);
            seen = [false; 4];
        }
        if let Some(axis) = axis_of(axis)
            && ends
            && std::mem::replace(&mut seen[axis], true)
        {
            last.clear();
        }
        out.push(last.clone());
    }
    out
}

/// The name of each column, from the row above the axes; with that of its person, from the rows
/// above it where they differ. A name may stand above the first of its columns alone: it ends where
/// an axis comes a second time, and what follows has no name.
fn names_above(rows: &[Vec<String>], axes: usize) -> Vec<String> {
    let mut names = filled(&rows[axes - 1], &rows[axes], true);
    // The first column is an index, unless it is a point's.
    let index = usize::from(axis_of(&rows[axes][0]).is_none());
    for above in rows[..axes - 1].iter().rev() {
        let known = above.iter().skip(index).filter(|c| !c.is_empty());
        let mut known: Vec<&String> = known.collect();
        known.dedup();
        if known.len() < 2 {
            continue;
        }
        let persons = filled(above, &rows[axes], false);
        let named = names.iter_mut().zip(&persons).skip(index);
        named
            .filter(|(name, person)| !name.is_empty() && !person.is_empty())
            .for_each(|(name, person)| *name = format!("{person}:{name}"));
    }
    names
}

/// The title of a column that is no point's.
fn joined(name: Option<&String>, axis: Option<&String>) -> String {
    let part = |part: Option<&String>| part.cloned().unwrap_or_default();
    match (part(name), part(axis)) {
        (name, axis) if axis.is_empty() => name,
        (name, axis) if name.is_empty() || is_index(&name) => axis,
        (name, axis) => format!("{name}_{axis}"),
    }
}

/// Whether pandas writes this above the axes to name what stands in the rows of titles.
fn is_index(name: &str) -> bool {
    ["bodyparts", "individuals", "scorer"].contains(&name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(titles: &PointTitles) -> Vec<&str> {
        titles.points.iter().map(|(n, _)| n.as_str()).collect()
    }

    #[test]
    fn one_row_has_names_with_any_parting_and_case() {
        for row in [
            "fnum,a_l_x,a_l_y,a_l_z,a_l_error,b_x,b_y,b_z",
            "fnum,a_l.X,a_l.Y,a_l.Z,a_l_error,b.X,b.Y,b.Z",
            "fnum;a_l x;a_l y;a_l z;a_l_error;b x;b y;b z",
            "fnum\ta_l_x\t\"a_l_y\"\ta_l_z\ta_l_error\tb_x\tb_y\tb_z\t",
            "fnum,a_l_x (mm),a_l_y (mm),a_l_z (mm),a_l_error,b_x[mm],b_y[mm],b_z[mm]",
        ] {
            let titles = PointTitles::read(&[row, "0,1,2,3,4,5,6,7"]).unwrap();
            assert_eq!(names(&titles), ["a_l", "b"], "{row}");
            assert_eq!(titles.points[1].1, [5, 6, 7]);
            assert_eq!(titles.others[1], ("a_l_error".to_string(), 4));
            assert_eq!((titles.rows, titles.others.len()), (1, 2));
            let units = row.contains("mm").then_some("mm".to_string());
            assert_eq!(titles.unit().unwrap(), units);
        }
        let apart = PointTitles::read(&["a_x,b_x,a_y,b_y,a_z,b_z"]).unwrap();
        assert_eq!(apart.points[1].1, [1, 3, 5]);
    }

    #[test]
    fn several_rows_have_names_above_axes() {
        let pandas = PointTitles::read(&[",A,A,A,B,B,B", ",x,y,z,x,y,z", "0,1,2,3,4,5,6"]).unwrap();
        assert_eq!((names(&pandas), pandas.rows), (vec!["A", "B"], 2));
        assert_eq!(pandas.others, [("index".to_string(), 0)]);
        let merged = [
            "Time,A,,,B,,",
            ",X,Y,Z,X,Y,Z",
            ",mm,mm,mm,mm,mm,mm",
            "0,1,2,3,4,5,6",
        ];
        let merged = PointTitles::read(&merged).unwrap();
        assert_eq!((names(&merged), merged.rows), (vec!["A", "B"], 3));
        assert_eq!(merged.units, ["mm"]);
        assert_eq!(merged.others, [("Time".to_string(), 0)]);
        let labcut = [
            "scorer,s,s,s,s,s,s,s,s",
            "individuals,p,p,p,p,q,q,q,q",
            "bodyparts,nose,nose,nose,nose,nose,nose,nose,nose",
            "coords,x,y,z,likelihood,x,y,z,likelihood",
            "0,1,2,3,1,4,5,6,1",
        ];
        let labcut = PointTitles::read(&labcut).unwrap();
        assert_eq!((names(&labcut), labcut.rows), (vec!["p:nose", "q:nose"], 4));
        let others = [
            ("coords".to_string(), 0),
            ("p:nose_likelihood".to_string(), 4),
        ];
        assert_eq!(labcut.others[..2], others);
        let index = ["name,A,A,A", "axis,x,y,z", "frame,,,", "0,1,2,3"];
        let index = PointTitles::read(&index).unwrap();
        assert_eq!((names(&index), index.rows), (vec!["A"], 3));
        let nexus = [
            ",,P:A,,,P:B,,,",
            "Frame,Sub Frame,X,Y,Z,X,Y,Z",
            ",,mm,mm,mm,mm,mm,mm",
        ];
        let nexus = PointTitles::read(&nexus).unwrap();
        assert_eq!(names(&nexus), ["P:A", "P:B"]);
        assert_eq!(nexus.others[0], ("Frame".to_string(), 0));
        let planar = ["bodyparts,A,A,A", "coords,x,y,likelihood", "0,1,2,3"];
        let planar = PointTitles::read(&planar).unwrap();
        assert!(planar.points.is_empty());
        assert_eq!(planar.planar, ["A"]);
        // Without an index, the first column has a person too.
        let persons = [
            "p,p,p,q,q,q",
            "nose,nose,nose,nose,nose,nose",
            "x,y,z,x,y,z",
        ];
        let persons = PointTitles::read(&persons).unwrap();
        assert_eq!(names(&persons), ["p:nose", "q:nose"]);
    }

    #[test]
    fn a_name_ends_with_its_axes() {
        let rows = [",A,,,,,,B,,", ",x,y,z,error,x,y,x,y,z"];
        let titles = PointTitles::read(&rows).unwrap();
        assert_eq!(names(&titles), ["A", "B"]);
        assert_eq!(titles.planar, [""]);
        assert_eq!(titles.others[1], ("A_error".to_string(), 4));
        let unnamed = PointTitles::read(&[",A,,,,,", ",x,y,z,x,y,z"]).unwrap();
        assert_eq!(names(&unnamed), ["A", ""]);
        let each = PointTitles::read(&[",A,A,A,A,A,A", ",x,y,z,x,y,z"]).unwrap();
        assert_eq!(names(&each), ["A", "A"]);
    }

    #[test]
    fn two_units_are_an_error() {
        for rows in [
            &["A_x (m),A_y (m),A_z (m),B_x (mm),B_y (mm),B_z (mm)"][..],
            &["A_x (m),A_y (mm),A_z (m)"],
            &["A,,,B,,", "x,y,z,x,y,z", "m,m,m,mm,mm,mm"],
        ] {
            let said = PointTitles::read(rows).unwrap().unit().unwrap_err();
            assert!(said.to_string().contains("in m and in mm"), "{said}");
        }
        let same = "A_x (m),A_y (M),A_z (m),LAngle_x (deg),LAngle_y (deg),LAngle_z (deg)";
        let same = PointTitles::read(&[same]).unwrap();
        assert_eq!(same.unit().unwrap().as_deref(), Some("m"));
    }

    #[test]
    fn rotations_and_forces_are_no_points() {
        let row = "Hips_pos_x,Hips_pos_y,Hips_pos_z,Hips_rot_x,Hips_rot_y,Hips_rot_z,grf.x";
        let titles = PointTitles::read(&[row]).unwrap();
        assert_eq!((names(&titles), titles.others.len()), (vec!["Hips_pos"], 4));
        assert_eq!(titles.quantities, ["Hips_rot"]);
        assert_eq!(PointTitles::read(&["t,acc_x,acc_y,acc_z"]), None);
        assert_eq!(PointTitles::read(&[",A,A,A,A", ",x,y,z,w"]), None);
        for other in [
            "LKneeAngles",
            "Hips_localRotation",
            "rotation_hips",
            "LGroundReactionForce",
            "LKneeMoment",
            "LKneePower",
            "GRFs",
            "acc1",
            "Ann:L_ACC",
            "Rotation:Hips",
            "CenterOfMassVelocity",
            "gyr",
            "imu1_accelerometer",
            "pelvis_scale",
            "scaleFactors",
            "AngularRate",
        ] {
            assert!(is_other_quantity(other), "{other}");
        }
        for point in [
            "LAnkle",
            "Ann:LFHD",
            "Forehead",
            "LMAG",
            "hip_rotation_center",
            "GRF_position",
            "Accra",
            "RASIS",
            "LSCA",
            "Gyrus",
            "CenterOfGravity",
            "",
        ] {
            assert!(!is_other_quantity(point), "{point}");
        }
        let row = "q_x,q_y,q_z,q_w,LAngle_x,LAngle_y,LAngle_z,A_x,A_y,A_z,knee_x,knee_y";
        let mixed = PointTitles::read(&[row]).unwrap();
        assert_eq!(names(&mixed), ["A"]);
        assert_eq!(mixed.quantities, ["q", "LAngle"]);
        let notes = mixed.notes();
        assert!(notes[0].ends_with(": q, LAngle") && notes[1].ends_with(": knee"));
        assert_eq!(mixed.others.len(), 9);
        let unity = [
            ",Rotation,Rotation,Rotation,Position,Position,Position",
            ",Hips,Hips,Hips,Hips,Hips,Hips",
            ",x,y,z,x,y,z",
        ];
        let unity = PointTitles::read(&unity).unwrap();
        assert_eq!(names(&unity), ["Position:Hips"]);
        let markers = [",,Ann:ACC,,", "Frame,Sub Frame,X,Y,Z"];
        assert_eq!(PointTitles::read(&markers), None);
        assert_eq!(
            names(&PointTitles::of_markers(&markers).unwrap()),
            ["Ann:ACC"]
        );
    }

    #[test]
    fn what_is_no_table_of_points_is_none() {
        for lines in [
            &["u,v", "1,2"][..],
            &["x,y,z", "1,2,3"],
            &["time,speed"],
            &[""],
            &["a_x"],
            &["HIERARCHY", "ROOT x"],
        ] {
            assert_eq!(PointTitles::read(lines), None, "{lines:?}");
        }
    }
}
