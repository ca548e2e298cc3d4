//! Qualisys' TSV files of rigid bodies (DATA_INCLUDED 6D): of each body its position, three angles
//! in degrees, the residual and the rotation matrix. The position is a point; the angles are
//! carried along as NAME.rx, NAME.ry and NAME.rz, as they stand in the file.
//!
//! A body that QTM could not compute has a residual of -1 and zeros.

use super::qualisys_head::{Head, value_of};
use crate::marker_rows::{MarkerRows, Stated};
use crate::marker_take::{CarriedColumns, MarkerTake, unique_names};
use crate::text::{Lines, excerpt};
use crate::{Error, Place, Result};
use std::io::BufRead;

/// Cells of a body: position, angles, residual, rotation matrix.
const WIDTH: usize = 16;
/// The cells of the angles and of the residual within a body.
const ANGLES: usize = 3;
const RESIDUAL: usize = 6;

/// Reads the rows behind the header `head`, whose last line before the rows was `titles`.
pub(crate) fn read(
    head: &Head,
    titles: &[String],
    mut row: Option<String>,
    mut lines: Lines<impl BufRead>,
    keep_whole: bool,
) -> Result<MarkerTake> {
    let name = lines.name.clone();
    let bodies = bodies(head).map_err(|e| e.at(Place::file(&name)))?;
    let axes = axes_of(titles);
    let angle = |body: &String| ["rx", "ry", "rz"].map(|axis| format!("{body}.{axis}"));
    let angles: Vec<String> = bodies.iter().flat_map(angle).collect();
    let mut carried = CarriedColumns::new(angles.iter().map(String::as_str), &bodies);
    let mut rows = MarkerRows::default();
    let mut starts: Option<Vec<usize>> = None;
    while let Some(line) = row {
        if !line.trim().is_empty() {
            let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
            if starts.is_none() {
                starts = starts_of(titles, &cells, bodies.len());
            }
            let Some(starts) = &starts else {
                let what = format!(
                    "expected {WIDTH} cells for each of {} bodies, found {}",
                    bodies.len(),
                    cells.len()
                );
                return Err(Error::data(lines.here(), what));
            };
            push(
                &mut rows,
                &mut carried,
                &cells,
                (starts, axes),
                frame_and_time(titles, starts),
                lines.number,
            )
            .map_err(|e| e.at(lines.here()))?;
        }
        row = lines.next_line()?.map(str::to_string);
    }
    let number = |key: &str| {
        value_of(head, key)?
            .parse::<f64>()
            .ok()
            .filter(|n| *n > 0.0)
    };
    let stated = Stated {
        labels: bodies,
        frames: number("NO_OF_FRAMES").map(|n| n as usize),
        rate: number("FREQUENCY"),
        ..Stated::default()
    };
    let mut take = rows.take(&name, stated, lines.whole, keep_whole)?;
    let starts = starts.unwrap_or_default();
    take.cells.move_points(|cell| starts[cell / 3] + cell % 3);
    // Frames that the file leaves out have no row.
    carried
        .rows
        .truncate(take.cells.lines.iter().flatten().count());
    take.carried = carried;
    Ok(take)
}

/// The names of the bodies.
fn bodies(head: &Head) -> Result<Vec<String>> {
    let names = head.get("BODY_NAMES");
    let names = names.ok_or("has no line BODY_NAMES, so it has no bodies that are known")?;
    let last = names.iter().rposition(|n| !n.is_empty());
    let names = &names[..last.map_or(0, |last| last + 1)];
    let announced = value_of(head, "NO_OF_BODIES").and_then(|n| n.parse::<usize>().ok());
    match announced {
        Some(count) if count != names.len() => {
            Err(format!("announces {count} bodies but names {}", names.len()).into())
        }
        _ if names.is_empty() => Err("has no bodies".into()),
        _ => Ok(unique_names(names.iter().map(String::as_str))),
    }
}

/// Which of x, y, z each of the three angles turns about. QTM calls them roll, pitch and yaw, in an
/// order that its settings tell; angles of other names are those about x, y, z in this order.
fn axes_of(titles: &[String]) -> [usize; 3] {
    let axis = |title: &String| {
        let title = title.to_ascii_lowercase();
        let names = ["roll", "pitch", "yaw"];
        names.iter().position(|name| title.ends_with(name))
    };
    let first = titles.iter().position(|t| axis(t).is_some());
    let found: Vec<Option<usize>> = (first.and_then(|i| titles.get(i..i + 3)))
        .map(|titles| titles.iter().map(axis).collect())
        .unwrap_or_default();
    match found[..] {
        [Some(a), Some(b), Some(c)] if a != b && b != c && a != c => [a, b, c],
        _ => [0, 1, 2],
    }
}

/// The columns of the frame's number and its time: by their titles, else the two before the first
/// body.
fn frame_and_time(titles: &[String], starts: &[usize]) -> [Option<usize>; 2] {
    let before = starts.first().copied().unwrap_or_default();
    let titles = titles.iter().take(before);
    let titled = ["Frame", "Time"].map(|title| titles.clone().position(|t| t == title));
    match titled {
        [None, None] if before == 2 => [Some(0), Some(1)],
        titled => titled,
    }
}

/// Where each body begins in a row: by the titles, if they name all bodies, as far apart as bodies
/// are, else by the number of cells. (The angles may have the titles of a position.) Between two
/// bodies may stand an empty cell, and before the first the frame's number and time.
fn starts_of(titles: &[String], cells: &[&str], bodies: usize) -> Option<Vec<usize>> {
    let titled = titles.iter().enumerate();
    let titled: Vec<usize> = titled
        .filter(|(_, title)| *title == "X" || title.ends_with(" X"))
        .map(|(i, _)| i)
        .collect();
    let is_body = |pair: &[usize]| (WIDTH..=WIDTH + 1).contains(&(pair[1] - pair[0]));
    let fits = titled
        .last()
        .is_some_and(|last| last + WIDTH <= cells.len());
    if titled.len() == bodies && titled.windows(2).all(is_body) && fits {
        return Some(titled);
    }
    let width = cells.iter().rposition(|c| !c.is_empty())? + 1;
    for (before, between) in [(0, 1), (0, 0), (2, 1), (2, 0)] {
        let all = before + bodies * WIDTH + between * (bodies - 1);
        let is_apart = (1..bodies).all(|b| {
            let cell = cells.get(before + b * (WIDTH + between) - 1);
            between == 0 || cell.is_some_and(|c| c.is_empty())
        });
        if width == all && is_apart {
            let start = |b: usize| before + b * (WIDTH + between);
            return Some((0..bodies).map(start).collect());
        }
    }
    None
}

/// Adds a row: the positions, and the angles as they stand.
fn push(
    rows: &mut MarkerRows,
    carried: &mut CarriedColumns,
    cells: &[&str],
    (starts, axes): (&[usize], [usize; 3]),
    [frame, time]: [Option<usize>; 2],
    number: u64,
) -> Result<()> {
    let cell = |at: usize| cells.get(at).copied().unwrap_or_default();
    let value = |at: usize| cell(at).parse::<f64>().ok();
    let is_lost = |start: &usize| {
        let is_zero = (0..3).all(|c| value(start + c) == Some(0.0));
        is_zero && value(start + RESIDUAL).is_some_and(|r| r < 0.0)
    };
    let lost: Vec<bool> = starts.iter().map(is_lost).collect();
    let seen = |(body, at): (usize, usize)| if lost[body] { "" } else { cell(at) };
    let positions = starts.iter().enumerate();
    let positions = positions.flat_map(|(b, start)| (0..3).map(move |c| (b, start + c)));
    // A row that is cut off lacks its last cells.
    let positions = positions.take_while(|(_, at)| *at < cells.len());
    let named = |at: Option<usize>| at.and_then(|at| cells.get(at).copied());
    rows.push(number, named(frame), named(time), positions.map(seen))?;
    let angle = |start: usize, axis: usize| {
        let at = axes.iter().position(|a| *a == axis).unwrap_or(axis);
        start + ANGLES + at
    };
    let angles = starts.iter().enumerate();
    let angles = angles.flat_map(|(b, &start)| (0..3).map(move |axis| (b, angle(start, axis))));
    carried.push(number, angles.map(seen));
    Ok(())
}

/// What a file of another kind of data holds.
pub(crate) fn refused(data: &str) -> String {
    format!(
        "holds {} data, expected markers (3D) or rigid bodies (6D)",
        excerpt(data)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, marker_csv};

    const HEAD: &str = "NO_OF_FRAMES\t2\nNO_OF_BODIES\t2\n\
        FREQUENCY\t100\n\
        DATA_INCLUDED\t6D\n\
        BODY_NAMES\tFoot Left\tHead\n";
    const TITLES: &str = " X\t Y\t Z\t Roll\t Pitch\t Yaw\t Residual\t Rot[0]\t Rot[1]\t Rot[2]\t \
                          Rot[3]\t Rot[4]\t Rot[5]\t Rot[6]\t Rot[7]\t Rot[8]";
    const MATRIX: &str = "1\t0\t0\t0\t1\t0\t0\t0\t1";

    fn take(text: &str) -> Result<MarkerTake> {
        let bytes = text.as_bytes().to_vec();
        let input = Input::new("x.tsv", std::io::Cursor::new(bytes))?;
        marker_csv::read(input, None, false)
    }

    fn angles(take: &MarkerTake, row: usize) -> Vec<String> {
        let cells = &take.carried.rows[row];
        let text = |i: usize| String::from_utf8_lossy(&cells[i]).into_owned();
        (0..cells.len()).map(text).collect()
    }

    #[test]
    fn positions_are_points_and_angles_are_columns() {
        let body = |xyz: &str, angles: &str, residual: &str| {
            format!("{xyz}\t{angles}\t{residual}\t{MATRIX}")
        };
        let first = body("1\t2\t3", "10\t20\t30", "0.2");
        let second = body("4\t5\t6", "40\t50\t60", "0.2");
        let lost = body("0.000\t0.000\t0.000", "0\t0\t0", "-1.0");
        for (titles, between, before) in [
            (TITLES.to_string(), "\t\t", ""),
            (TITLES.to_string(), "\t", ""),
            (format!("{TITLES}\t\t{TITLES}"), "\t\t", ""),
            (format!("Frame\tTime\t{TITLES}"), "\t\t", "1\t0.0\t"),
            (String::new(), "\t\t", ""),
        ] {
            let next = before.replacen('1', "2", 1);
            let rows = format!("{before}{first}{between}{second}\n{next}{first}{between}{lost}\n");
            let text = format!("{HEAD}{titles}\n{rows}");
            let read = take(&text).unwrap();
            assert_eq!(read.points, ["Foot Left", "Head"]);
            assert_eq!(
                read.xyz.row(0).to_vec(),
                [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
                "{text}"
            );
            assert!(read.xyz.row(1).iter().skip(3).all(|v| v.is_nan()));
            assert_eq!(read.carried.names[..2], ["Foot Left.rx", "Foot Left.ry"]);
            assert_eq!(angles(&read, 0), ["10", "20", "30", "40", "50", "60"]);
            assert_eq!(angles(&read, 1)[3..], ["", "", ""]);
            assert_eq!((read.rate, read.units.is_none()), (Some(100.0), true));
            let mut new = read.xyz.clone();
            new[[1, 3]] = 7.5;
            let bytes = read
                .cells
                .with_points(text.as_bytes(), read.xyz.view(), new.view());
            let at = text.rfind("0.000\t0.000\t0.000").unwrap();
            let wanted = format!("{}7.5{}", &text[..at], &text[at + 5..]);
            assert_eq!(String::from_utf8(bytes).unwrap(), wanted);
        }
        // Angles with the titles of a position.
        let alike = TITLES.replace(" Roll\t Pitch\t Yaw", " X\t Y\t Z");
        let read = take(&format!(
            "{HEAD}{alike}\n{first}\t\t{second}\n{first}\t\t{lost}\n"
        ));
        let read = read.unwrap();
        assert_eq!(read.xyz.row(0).to_vec(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(angles(&read, 0), ["10", "20", "30", "40", "50", "60"]);
        // The numbers of frames are the file's.
        for titles in [format!("Frame\tTime\t{TITLES}"), String::new()] {
            let rows = format!("500\t4.99\t{first}\t\t{second}\n503\t5.02\t{first}\t\t{second}\n");
            let read = take(&format!("{HEAD}{titles}\n{rows}")).unwrap();
            assert_eq!((read.first_frame, read.xyz.nrows()), (500, 4));
            assert_eq!((read.carried.rows.len(), read.xyz[[3, 3]]), (2, 4.0));
            assert!(read.xyz[[1, 0]].is_nan());
        }
        let yaw_first = TITLES.replace(" Roll\t Pitch\t Yaw", " Yaw\t Pitch\t Roll");
        let rows = format!("{first}\t\t{second}\n{first}\t\t{lost}\n");
        let read = take(&format!("{HEAD}{yaw_first}\n{rows}")).unwrap();
        assert_eq!(angles(&read, 0)[..3], ["30", "20", "10"]);
    }

    #[test]
    fn faults_have_a_place() {
        let fails = |text: &str, part: &str| {
            let said = take(text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        fails(
            &format!("{HEAD}{TITLES}\n1\t2\t3\n"),
            "x.tsv:7: expected 16 cells",
        );
        fails(&HEAD.replace("BODY_NAMES", "NAMES"), "no line BODY_NAMES");
        fails(
            &HEAD.replace("\tHead", ""),
            "announces 2 bodies but names 1",
        );
        fails(&HEAD.replace("6D", "ANALOG"), "holds ANALOG data");
    }
}
