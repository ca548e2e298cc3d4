//! Qualisys' TSV files of motion data (QTM, "Include TSV header"): lines of a name and its values,
//! perhaps a line of titles, and a frame a row.
//!
//! Which text stands for a missing point depends on QTM's settings, and programs that read its
//! files differ: MoCap Toolbox takes 0 for missing, others `null`. So empty cells and words for
//! "none" are missing, and zeros stay.

use super::qualisys_6d;
use super::qualisys_head::{Head, KEYS, value_of};
use crate::marker_rows::{MarkerRows, Stated, is_missing};
use crate::marker_take::MarkerTake;
use crate::text::Lines;
use crate::{Place, Result};
use std::io::BufRead;

/// Where the cells of a row are.
#[derive(Debug, Clone, Copy)]
struct Layout {
    frame: Option<usize>,
    time: Option<usize>,
    /// The first coordinate.
    xyz: usize,
}

/// Reads the file after its first line.
pub(crate) fn read(
    first: &str,
    mut lines: Lines<impl BufRead>,
    keep_whole: bool,
) -> Result<MarkerTake> {
    let Header {
        head,
        mut layout,
        titles,
        mut row,
    } = header(first, &mut lines)?;
    if value_of(&head, "DATA_INCLUDED").is_some_and(|d| d.eq_ignore_ascii_case("6D")) {
        return qualisys_6d::read(&head, &titles, row, lines, keep_whole);
    }
    let stated = stated(head).map_err(|e| e.at(Place::file(&lines.name)))?;
    let points = stated.labels.len();
    let mut rows = MarkerRows::default();
    while let Some(line) = row {
        if !line.trim().is_empty() {
            let cells: Vec<&str> = line.split('\t').collect();
            let layout = *layout.get_or_insert_with(|| Layout::of_row(&cells, points));
            let cell = |at: Option<usize>| at.and_then(|at| cells.get(at).copied());
            let xyz = cells.iter().skip(layout.xyz).take(3 * points).copied();
            let pushed = rows.push(lines.number, cell(layout.frame), cell(layout.time), xyz);
            pushed.map_err(|e| e.at(lines.here()))?;
        }
        row = lines.next_line()?.map(str::to_string);
    }
    let name = lines.name.clone();
    let mut take = rows.take(&name, stated, lines.whole, keep_whole)?;
    let first = layout.map_or(0, |layout| layout.xyz);
    take.cells.move_points(|cell| first + cell);
    Ok(take)
}

/// What stands above the rows, and the first row.
struct Header {
    head: Head,
    /// The layout that a line of titles tells.
    layout: Option<Layout>,
    /// The line before the first row.
    titles: Vec<String>,
    row: Option<String>,
}

/// Reads the header.
fn header(first: &str, lines: &mut Lines<impl BufRead>) -> Result<Header> {
    let (mut head, mut layout) = (Head::new(), None);
    let mut next = Some(first.to_string());
    let mut before = String::new();
    let titles = |before: &str| before.split('\t').map(|c| c.trim().to_string()).collect();
    while let Some(line) = next {
        let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
        if let Some(titled) = Layout::of_titles(&cells) {
            layout = Some(titled);
        } else if is_value(cells[0]) && !line.trim().is_empty() {
            return Ok(Header {
                head,
                layout,
                titles: titles(&before),
                row: Some(line),
            });
        } else if let Some(key) = KEYS.into_iter().find(|key| *key == cells[0]) {
            let values = cells[1..].iter().map(|c| c.to_string()).collect();
            head.entry(key).or_insert(values);
        }
        before = line;
        next = lines.next_line()?.map(str::to_string);
    }
    Ok(Header {
        head,
        layout,
        titles: titles(&before),
        row: None,
    })
}

/// Whether a row begins so, not a line of the header.
fn is_value(cell: &str) -> bool {
    is_missing(cell) || cell.parse::<f64>().is_ok()
}

impl Layout {
    /// By the titles above the rows: `Frame`, `Time`, `NAME X`, ...
    fn of_titles(cells: &[&str]) -> Option<Layout> {
        let xyz = cells.iter().position(|c| c.ends_with(" X"))?;
        let y = cells.get(xyz + 1).is_some_and(|c| c.ends_with(" Y"));
        let index = |title: &str| cells[..xyz].iter().position(|c| *c == title);
        y.then_some(Layout {
            frame: index("Frame"),
            time: index("Time"),
            xyz,
        })
    }

    /// Without titles, by the number of cells: QTM writes the frame's number and its time both or
    /// not at all.
    fn of_row(cells: &[&str], points: usize) -> Layout {
        let numbered = cells.len() >= 3 * points + 2;
        Layout {
            frame: numbered.then_some(0),
            time: numbered.then_some(1),
            xyz: if numbered { 2 } else { 0 },
        }
    }
}

/// What the header says.
fn stated(mut head: Head) -> Result<Stated> {
    let value = |key: &str| value_of(&head, key);
    if let Some(other) = value("DATA_INCLUDED").filter(|d| !d.eq_ignore_ascii_case("3D")) {
        return Err(qualisys_6d::refused(other).into());
    }
    let number = |key: &str| value(key)?.parse::<f64>().ok().filter(|n| *n > 0.0);
    let (frames, rate) = (number("NO_OF_FRAMES"), number("FREQUENCY"));
    let markers = number("NO_OF_MARKERS");
    let mut labels = head
        .remove("MARKER_NAMES")
        .ok_or("has no line MARKER_NAMES, so it has no markers that are known")?;
    while labels.last().is_some_and(String::is_empty) {
        labels.pop();
    }
    let named = labels.len();
    if let Some(markers) = markers.filter(|&n| n != named as f64) {
        return Err(format!("announces {markers} markers but names {named}").into());
    }
    Ok(Stated {
        labels,
        frames: frames.map(|n| n as usize),
        rate,
        ..Stated::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, marker_csv};

    const HEAD: &str = "NO_OF_FRAMES\t2\nNO_OF_MARKERS\t2\n\
        FREQUENCY\t100\nDESCRIPTION\t--\n\
        DATA_INCLUDED\t3D\n\
        EVENT\tgo\t1\t0.0\n\
        MARKER_NAMES\tNew 0000\tB\n";
    const TITLES: &str = "Frame\tTime\tNew 0000 X\tNew 0000 Y\tNew 0000 Z\tB X\tB Y\tB Z\t\n";
    const ROWS: &str = "3\t0.02\t1\t2\t3\t4\t5\t6\n4\t0.03\t0.000\t0.000\t0.000\t\t\t\n";

    fn take(text: &str) -> Result<MarkerTake> {
        let bytes = text.as_bytes().to_vec();
        let input = Input::new("x.tsv", std::io::Cursor::new(bytes))?;
        marker_csv::read(input, None, false)
    }

    #[test]
    fn titles_and_frames_may_be_absent() {
        let titled = take(&format!("{HEAD}{TITLES}{ROWS}")).unwrap();
        assert_eq!((titled.first_frame, titled.rate), (3, Some(100.0)));
        assert_eq!(titled.points, ["New 0000", "B"]);
        assert_eq!((titled.units.clone(), titled.up.clone()), (None, None));
        assert_eq!(titled.xyz.row(0).to_vec(), [1., 2., 3., 4., 5., 6.]);
        assert_eq!(titled.xyz[[1, 2]], 0.0);
        assert!(titled.xyz[[1, 3]].is_nan());
        let untitled = take(&format!("FILE_VERSION\t2.0.0\n{HEAD}{ROWS}")).unwrap();
        assert_eq!(untitled.first_frame, 3);
        assert_eq!(untitled.xyz.row(0), titled.xyz.row(0));
        let bare = ROWS.replace("3\t0.02\t", "").replace("4\t0.03\t", "");
        let bare = take(&format!("{HEAD}{bare}")).unwrap();
        assert_eq!((bare.first_frame, bare.xyz.row(0)), (1, titled.xyz.row(0)));
    }

    #[test]
    fn faults_have_a_place() {
        let fails = |text: &str, part: &str| {
            let said = take(text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        let whole = format!("{HEAD}{TITLES}{ROWS}");
        fails(&whole.replace("\t3D", "\t6D"), "no line BODY_NAMES");
        fails(&whole.replace("\t3D", "\tGAZE"), "holds GAZE data");
        fails(&whole.replace("MARKER_N", "BODY_N"), "no line MARKER_NAMES");
        fails(
            &whole.replace("FRAMES\t2", "FRAMES\t5"),
            "ends after 2 of its 5",
        );
        fails(
            &whole.replace("\tB\n", "\n"),
            "announces 2 markers but names 1",
        );
        fails(&whole.replace("5\t6", "x\t6"), "x.tsv:9: expected a number");
        fails(HEAD, "has no frames");
        fails("", "is empty");
        fails("time,a.x\n", "neither a Motive CSV");
    }
}
