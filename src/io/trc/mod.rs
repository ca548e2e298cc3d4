//! TRC files: trajectories of markers as text, by Motion Analysis, which OpenSim and Pose2Sim read and write too.
//!
//! Three lines say what the file is: `PathFileType`, names of values, and the values. The fourth names the markers, each above three
//! columns, the fifth the columns; a frame a row follows, its number and time first. Cells are parted by tabs, in some files by
//! blanks. Written as seen in files of Cortex, Filmbox, BTK, OpenSim and Pose2Sim: rows may lack their last cells, and may have
//! points without a name beyond the named ones.

mod write;

pub use write::NewTrc;

use super::input::Input;
use super::marker_rows::{MarkerRows, Stated, is_missing};
use super::marker_take::MarkerTake;
use super::motion_format::recognized;
use super::text::{Lines, excerpt};
use super::text_cells::Separator;
use crate::{Error, Place, Result};
use std::io::BufRead;

/// Reads a file. With `keep_whole`, one that ends early gives the frames that it has.
///
/// # Errors
/// [`Error::Data`]: it is no TRC file, has no points or frames, ends early, or a cell is no number. [`Error::Io`]: reading fails.
pub fn read(input: Input, keep_whole: bool) -> Result<MarkerTake> {
    let name = input.name.clone();
    let other = recognized(input.first_bytes());
    let mut lines = Lines::new(&name, input.into_reader());
    let first = match lines.next_line()? {
        Some(line) if line.trim_start().starts_with("PathFileType") => check_axes(line),
        Some(_) => Err(other.map_or(
            "is no TRC file, which begins with PathFileType".into(),
            Into::into,
        )),
        None => Err("is empty, expected a TRC file".into()),
    };
    first.map_err(|what| Error::data(Place::file(&name), what))?;
    let stated = stated(&mut lines)?;
    let mut rows = MarkerRows::default();
    let mut is_first = true;
    loop {
        let number = lines.number + 1;
        let Some(line) = lines.next_line()? else {
            break;
        };
        let cells = cells(line);
        if cells.iter().all(|c| c.trim().is_empty()) {
            continue;
        }
        // The line of X1, Y1, Z1, which some files lack.
        let is_title = is_first && cells[0].trim().parse::<f64>().is_err();
        is_first = false;
        if is_title {
            continue;
        }
        let (frame, time) = (Some(cells[0]), cells.get(1).copied());
        let pushed = rows.push(number, frame, time, cells.iter().skip(2).copied());
        pushed.map_err(|what| Error::data(lines.here(), what))?;
    }
    let mut take = rows.take(&name, stated, lines.whole, keep_whole)?;
    take.cells.separator = Separator::TabOrBlanks;
    take.cells.move_points(|cell| 2 + cell);
    Ok(take)
}

/// The cells of a line; there is at least one.
fn cells(line: &str) -> Vec<&str> {
    match line.contains('\t') || line.trim().is_empty() {
        true => line.split('\t').collect(),
        false => line.split_whitespace().collect(),
    }
}

/// The third cell of the first line tells the columns of a point.
fn check_axes(line: &str) -> std::result::Result<(), String> {
    let axes = cells(line).get(2).map_or("", |c| c.trim()).to_string();
    match axes.starts_with('(') && !axes.eq_ignore_ascii_case("(X/Y/Z)") {
        true => Err(format!("has columns {}, expected (X/Y/Z)", excerpt(&axes))),
        false => Ok(()),
    }
}

/// What lines 2 to 4 say.
fn stated(lines: &mut Lines<impl BufRead>) -> Result<Stated> {
    let keys = header_line(lines)?;
    let values = header_line(lines)?;
    let titles = header_line(lines)?;
    let value = |key: &str| {
        let at = keys.iter().position(|k| k.eq_ignore_ascii_case(key))?;
        values.get(at).filter(|v| !is_missing(v))
    };
    let number = |key: &str| value(key)?.parse::<f64>().ok();
    let is = |i: usize, word: &str| {
        let title = titles.get(i).and_then(|t| t.get(..word.len()));
        title.is_some_and(|t| t.eq_ignore_ascii_case(word))
    };
    if !is(0, "Frame") || !is(1, "Time") {
        let found = excerpt(titles.join(" ").trim());
        let what = format!("expected Frame#, Time and the names of markers, found \"{found}\"");
        return Err(Error::data(lines.here(), what));
    }
    let labels = labels(&titles[2..]);
    let mut notes = Vec::new();
    if let Some(markers) = number("NumMarkers").filter(|&n| n < labels.len() as f64) {
        let what = format!("announces {markers} markers but names {}", labels.len());
        notes.push(what);
    }
    Ok(Stated {
        labels,
        frames: number("NumFrames").map(|n| n as usize),
        rate: number("DataRate").filter(|r| r.is_finite() && *r > 0.0),
        units: value("Units").map(|unit| excerpt(unit)),
        from_zero: false,
        notes,
    })
}

/// The cells of the next line of the header.
fn header_line(lines: &mut Lines<impl BufRead>) -> Result<Vec<String>> {
    let cells = lines.next_line()?.map(|line| {
        let cells = cells(line).into_iter();
        cells.map(|c| c.trim().to_string()).collect()
    });
    cells.ok_or_else(|| {
        let what = "the file ends within its header, before the names of its markers";
        Error::data(lines.here(), what)
    })
}

/// The names above the columns: every third cell has one, but in some files each.
fn labels(titles: &[String]) -> Vec<String> {
    let is_spread = titles
        .iter()
        .enumerate()
        .all(|(i, title)| i % 3 == 0 || title.is_empty());
    let step = if is_spread { 3 } else { 1 };
    let mut labels: Vec<String> = titles.iter().step_by(step).cloned().collect();
    if !is_spread {
        labels.retain(|label| !label.is_empty());
    }
    while labels.last().is_some_and(String::is_empty) {
        labels.pop();
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n100\t  2\t2\tmm\nFrame#\tTime\tA\t\t\tB\t\t\t\n";
    const ROWS: &str =
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n5\t0.04\t1\t2\t3\t4\t5\t6\n6\t0.05\t\t\t\tnan\tNaN\tnan\n";

    fn take(text: &str) -> Result<MarkerTake> {
        let bytes = text.as_bytes().to_vec();
        read(Input::new("x.trc", std::io::Cursor::new(bytes))?, false)
    }

    #[test]
    fn tabs_blanks_and_line_ends_are_read_alike() {
        let text = format!("{HEAD}{ROWS}");
        let tabs = take(&text).unwrap();
        assert_eq!((tabs.first_frame, tabs.rate), (5, Some(100.0)));
        assert_eq!(tabs.units.as_deref(), Some("mm"));
        assert_eq!(tabs.points, ["A", "B"]);
        assert_eq!(tabs.xyz.row(0).to_vec(), [1., 2., 3., 4., 5., 6.]);
        assert!(tabs.xyz.row(1).iter().all(|v| v.is_nan()) && tabs.notes.is_empty());
        let others = [
            text.replace('\n', "\r\n"),
            text.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n", ""),
            text.replace("A\t\t\tB\t\t\t", "A\tB"),
            text.replace("\t\t\t\tnan", "\tNaN\tNaN\tNaN\tnan")
                .replace('\t', "  "),
        ];
        for other in others {
            let read = take(&other).unwrap();
            assert_eq!((&read.points, read.xyz.nrows()), (&tabs.points, 2));
            assert_eq!(read.xyz.row(0), tabs.xyz.row(0), "{other:?}");
        }
    }

    #[test]
    fn faults_have_a_place() {
        let whole = format!("{HEAD}{ROWS}");
        for (text, part) in [
            ("", "x.trc: is empty"),
            ("HIERARCHY\n", "x.trc: is a BVH file"),
            ("time,a.x\n", "begins with PathFileType"),
            ("PathFileType\t4\t(X/Y)\n", "(X/Y/Z)"),
            ("PathFileType\t4\nDataRate\n100\n", "x.trc:3: the file ends"),
            (HEAD, "has no frames"),
            (HEAD.trim_end(), "has no frames"),
            (&HEAD.replace("Frame#", "Foo"), "x.trc:4: expected Frame#"),
            (
                &whole.replace("\t4\t5", "\tx\t5"),
                "x.trc:7: expected a number",
            ),
            (&whole.replace("  2", "3"), "--keep-whole"),
        ] {
            let said = take(text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        }
    }
}
