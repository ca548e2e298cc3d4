//! Motive's CSV files, by OptiTrack: a line of names and values, lines that tell what each column
//! is, and a frame a row.

use crate::marker_rows::{MarkerRows, Stated};
use crate::marker_take::MarkerTake;
use crate::text::{Lines, excerpt};
use crate::text_cells::Separator;
use crate::{Error, Result};
use std::io::BufRead;

/// More lines than any version has above its rows.
const MOST_TITLES: usize = 16;

/// Which columns are points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotivePoints {
    /// Measured markers (type Marker); empty where one is hidden.
    Markers,
    /// Where Motive expects the markers of its rigid bodies and skeletons (types Rigid Body Marker
    /// and Bone Marker). By OptiTrack's page "Data Export: CSV" a hidden one stays where it is
    /// expected, so that these are no measurements.
    Expected,
    /// Origins of rigid bodies and bones.
    Bones,
}

use MotivePoints::{Bones, Expected, Markers};

impl MotivePoints {
    /// What a column of this type is.
    fn of_type(name: &str) -> Option<MotivePoints> {
        let name = name.trim().to_ascii_lowercase();
        Some(match name.as_str() {
            "marker" | "labeled marker" | "unlabeled marker" => Markers,
            "bone" | "rigid body" => Bones,
            name if name.ends_with(" marker") => Expected,
            name if name.ends_with(" bone") => Bones,
            _ => return None,
        })
    }

    /// The name in messages.
    fn name(self) -> &'static str {
        match self {
            Markers => "measured markers",
            Expected => "expected markers",
            Bones => "bones and rigid bodies",
        }
    }
}

/// Reads the file after its first line.
pub(crate) fn read(
    first: &str,
    mut lines: Lines<impl BufRead>,
    wanted: Option<MotivePoints>,
    keep_whole: bool,
) -> Result<MarkerTake> {
    let head = cells(first);
    let columns = Columns::read(&mut lines)?;
    let chosen = choose(&head, &columns, wanted);
    let (at, stated) = chosen.map_err(|e| e.at(lines.here()))?;
    let mut rows = MarkerRows::default();
    loop {
        let number = lines.number + 1;
        let Some(line) = lines.next_line()? else {
            break;
        };
        if line.trim_matches([',', ' ']).is_empty() {
            continue;
        }
        let cells: Vec<&str> = line.split(',').collect();
        let chosen = at.iter().map_while(|&c| cells.get(c).copied());
        let pushed = rows.push(
            number,
            cells.first().copied(),
            cells.get(1).copied(),
            chosen,
        );
        pushed.map_err(|e| e.at(lines.here()))?;
    }
    let name = lines.name.clone();
    let mut take = rows.take(&name, stated, lines.whole, keep_whole)?;
    take.cells.separator = Separator::Comma;
    take.cells.move_points(|cell| at[cell]);
    Ok(take)
}

/// The columns of the points, and what the first line says of them.
fn choose(
    head: &[String],
    columns: &Columns,
    wanted: Option<MotivePoints>,
) -> Result<(Vec<usize>, Stated)> {
    let value = |key: &str| {
        let at = head.iter().position(|c| c == key)?;
        head.get(at + 1).filter(|value| !value.is_empty())
    };
    let number = |key: &str| value(key)?.parse::<f64>().ok().filter(|n| *n > 0.0);
    let kinds = [Markers, Expected, Bones];
    let first = kinds.into_iter().find(|&k| columns.of(k).next().is_some());
    let kind = wanted.or(first).unwrap_or(Markers);
    let points: Vec<(usize, String)> = columns.of(kind).collect();
    if points.is_empty() {
        return Err(format!("there are no columns of {}", kind.name()).into());
    }
    if kind == Bones && value("Coordinate Space").is_some_and(|s| s == "Local") {
        return Err("bones are relative to their parents; export with global coordinates".into());
    }
    let at = points.iter().flat_map(|(c, _)| *c..c + 3).collect();
    let stated = Stated {
        labels: points.into_iter().map(|(_, name)| name).collect(),
        frames: number("Total Exported Frames").map(|n| n as usize),
        rate: number("Export Frame Rate").or(number("Capture Frame Rate")),
        units: value("Length Units").map(|unit| excerpt(unit)),
        from_zero: true,
        notes: left_out(columns, kind),
        ..Stated::default()
    };
    Ok((at, stated))
}

/// A note of what the file has beside the points that are read.
fn left_out(columns: &Columns, kind: MotivePoints) -> Vec<String> {
    let count = |k: MotivePoints| columns.of(k).count();
    let others = [Markers, Expected, Bones]
        .into_iter()
        .filter(|&k| k != kind && count(k) > 0)
        .map(|k| format!("{} {}", count(k), k.name()));
    let mut others: Vec<String> = others.collect();
    if columns.components.iter().any(|c| c == "Rotation") {
        others.push("rotations".into());
    }
    if others.is_empty() {
        Vec::new()
    } else {
        vec![format!(
            "{} {} are converted; {} are not (see the option `points`)",
            count(kind),
            kind.name(),
            others.join(", ")
        )]
    }
}

/// What the columns are, cell by cell.
#[derive(Debug, Default)]
struct Columns {
    types: Vec<String>,
    names: Vec<String>,
    /// `Position` or `Rotation`; empty where no line tells.
    components: Vec<String>,
    /// `X`, `Y`, `Z` or `W`.
    axes: Vec<String>,
}

impl Columns {
    /// Reads the lines up to that of `Frame`, which is the last before the rows.
    fn read(lines: &mut Lines<impl BufRead>) -> Result<Columns> {
        let mut titles: Vec<Vec<String>> = Vec::new();
        while titles.len() < MOST_TITLES {
            let Some(line) = lines.next_line()? else {
                break;
            };
            let line = cells(line);
            if line[0].eq_ignore_ascii_case("Frame") {
                return Ok(Columns::of_titles(&titles, line));
            }
            titles.push(line);
        }
        let what = "expected the titles Frame, Time (Seconds), X, Y, Z above the rows";
        Err(Error::data(lines.here(), what))
    }

    /// The second cell names a line in newer versions. In older ones the line of types is known by
    /// its words; names follow it.
    fn of_titles(titles: &[Vec<String>], axes: Vec<String>) -> Columns {
        let titled = |word: &str| {
            titles
                .iter()
                .position(|t| t.get(1).is_some_and(|c| c == word))
        };
        let has_types = |t: &Vec<String>| t.iter().any(|c| MotivePoints::of_type(c).is_some());
        let has_components = |t: &Vec<String>| t.iter().any(|c| c == "Position");
        let types = titled("Type").or_else(|| titles.iter().position(has_types));
        let names = titled("Name").or(types.map(|i| i + 1));
        let line = |i: Option<usize>| i.and_then(|i| titles.get(i)).cloned().unwrap_or_default();
        Columns {
            types: line(types),
            names: line(names),
            components: line(titles.iter().position(has_components)),
            axes,
        }
    }

    /// The first column and the name of each point of a kind.
    fn of(&self, kind: MotivePoints) -> impl Iterator<Item = (usize, String)> {
        let is_position = move |c: usize| match self.components.get(c) {
            Some(component) => component == "Position",
            None => kind != Bones,
        };
        let is_point = move |c: &usize| {
            let axes = self.axes.get(*c..c + 3);
            axes.is_some_and(|a| a == ["X", "Y", "Z"]) && is_position(*c)
        };
        let is_kind = move |c: &usize| {
            let is = self.types.get(*c).and_then(|t| MotivePoints::of_type(t));
            is == Some(kind)
        };
        let name = |c: usize| (c, self.names.get(c).cloned().unwrap_or_default());
        let columns = (2..self.axes.len()).filter(is_kind).filter(is_point);
        columns.map(name)
    }
}

/// The cells of a line, of which names may be quoted; there is at least one.
fn cells(line: &str) -> Vec<String> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .from_reader(line.as_bytes());
    match reader.records().next() {
        Some(Ok(cells)) => cells.iter().map(|c| c.trim().to_string()).collect(),
        _ => vec![String::new()],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, marker_csv};

    const NEW: &str = "\
        Format Version,1.25,Take Name,x,Capture Frame Rate,120,Export Frame Rate,60,\
        Total Exported Frames,2,Length Units,Meters,Coordinate Space,Global,\n\
        \n\
        ,Type,Bone,Bone,Bone,Bone,Bone,Bone,Bone,Bone Marker,Bone Marker,Bone Marker,Marker,\
        Marker,Marker\n\
        ,Name,Hip,Hip,Hip,Hip,Hip,Hip,Hip,\"A,1\",\"A,1\",\"A,1\",\"A,1\",\"A,1\",\"A,1\"\n\
        ,ID,,,,,,,,,,,,,\n\
        ,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Position,Position,\
        Position,Position,Position,Position\n\
        Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z,X,Y,Z\n\
        0,0,0,0,0,1,7,8,9,4,5,6,1,2,3\n\
        1,0.016667,0,0,0,1,7,8,9,4,5,6,,,\n";

    fn take(text: &str, points: Option<MotivePoints>) -> Result<MarkerTake> {
        let bytes = text.as_bytes().to_vec();
        let input = Input::new("x.csv", std::io::Cursor::new(bytes))?;
        marker_csv::read(input, points, false)
    }

    #[test]
    fn measured_markers_come_before_expected_ones_and_bones() {
        let measured = take(NEW, None).unwrap();
        assert_eq!((measured.first_frame, measured.rate), (1, Some(60.0)));
        assert_eq!(measured.units.as_deref(), Some("Meters"));
        assert_eq!(measured.points, ["A,1"]);
        assert_eq!(measured.xyz.row(0).to_vec(), [1.0, 2.0, 3.0]);
        assert!(measured.xyz.row(1).iter().all(|v| v.is_nan()));
        let said = "1 measured markers are converted; 1 expected markers, 1 bones and rigid \
                    bodies, rotations are not (see the option `points`)";
        assert_eq!(measured.notes, [said]);
        let expected = take(NEW, Some(Expected)).unwrap();
        assert_eq!(expected.xyz.row(1).to_vec(), [4.0, 5.0, 6.0]);
        let bones = take(NEW, Some(Bones)).unwrap();
        assert_eq!(bones.xyz.row(1).to_vec(), [7.0, 8.0, 9.0]);
        assert_eq!(bones.points, ["Hip"]);
        assert!(take(&NEW.replace("Global", "Local"), Some(Bones)).is_err());
        assert!(take(&NEW.replace("Global", "Local"), None).is_ok());
        let no_markers = NEW.replace(",Marker", ",Force");
        assert_eq!(take(&no_markers, None).unwrap().xyz[[0, 0]], 4.0);
        assert!(take(&no_markers, Some(Markers)).is_err());
    }

    #[test]
    fn older_files_do_not_title_their_lines() {
        let old = NEW.replace(",Type,", ",,").replace(",Name,", ",,");
        assert_eq!(take(&old, None).unwrap().points, ["A,1"]);
    }

    #[test]
    fn faults_have_a_place() {
        let fails = |text: &str, part: &str| {
            let said = take(text, None).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        fails("Format Version,1.2\n", "x.csv:1: expected the titles");
        fails(
            &NEW.replace("Frames,2", "Frames,3"),
            "the option `keep_whole`",
        );
        fails(&NEW.replace("1,2,3", "1,x,3"), "x.csv:8: expected a number");
        fails(NEW.split_once("\n0,").unwrap().0, "has no frames");
        let none = NEW.replace("Marker", "x").replace("Bone", "x");
        fails(&none, "x.csv:7: there are no columns of measured markers");
    }
}
