//! TRC files: trajectories of markers as text, by Motion Analysis, which OpenSim and Pose2Sim read
//! and write too.
//!
//! Three lines say what the file is: `PathFileType`, names of values, and the values. The fourth
//! names the markers, each above three columns, the fifth the columns; a frame a row follows, its
//! number and time first. Cells are parted by tabs, in some files by blanks or commas. Written as
//! seen in files of Cortex, EVaRT, Filmbox, BTK, OpenSim and Pose2Sim: rows may lack their last
//! cells, and may have points without a name beyond the named ones; keys may be in any case, blank
//! lines anywhere.

mod header;
mod write;

pub(crate) use write::NewTrc;

use self::header::{Header, words};
use super::input::Input;
use super::marker_rows::MarkerRows;
use super::marker_take::MarkerTake;
use super::motion_format::recognized;
use super::text::{Lines, decimal, excerpt};
use super::text_cells::Separator;
use crate::{Error, Place, Result};
use std::io::BufRead;

/// Reads a file. With `keep_whole`, one that ends within a row gives the frames before.
///
/// ```
/// use posing_io::{Input, trc};
///
/// let text = "PathFileType\t4\t(X/Y/Z)\twalk.trc\n\
///             DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n\
///             100\t100\t1\t1\tmm\nFrame#\tTime\tknee\n\t\tX1\tY1\tZ1\n\
///             1\t0.00\t10\t20\t30\n";
/// let take = trc::read(Input::new("walk.trc", text.as_bytes())?, false)?;
/// assert_eq!((take.rate, take.units.as_deref()), (Some(100.0), Some("mm")));
/// assert_eq!(take.xyz, ndarray::array![[10.0, 20.0, 30.0]]);
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Data`]: it is no TRC file, has no points or frames, ends within a row, or a cell is no
/// number. [`Error::Io`]: reading fails.
pub fn read(input: Input, keep_whole: bool) -> Result<MarkerTake> {
    let name = input.name.clone();
    let other = recognized(input.first_bytes());
    let mut lines = Lines::new(&name, input.into_reader()).any_end();
    check_first(&mut lines, other)?;
    let header = Header::read(&mut lines)?;
    // The cells of a whole row: the frame's number, its time, the points.
    let whole = 2 + 3 * header.stated.labels.len();
    let separator = if header.has_commas {
        Separator::Comma
    } else {
        Separator::TabOrBlanks { whole }
    };
    let mut rows = MarkerRows::default();
    let (mut is_first, mut decimal_comma) = (true, false);
    // Whether an empty cell stands before the frame's number, as in the first row.
    let mut has_margin: Option<bool> = None;
    loop {
        let number = lines.number + 1;
        let Some(line) = lines.next_line()? else {
            break;
        };
        if line.trim().is_empty() {
            continue;
        }
        let commaless;
        let line = if !header.has_commas && line.contains(',') {
            decimal_comma = true;
            commaless = decimal(line);
            &commaless
        } else {
            line
        };
        let mut cells = cells(line, separator);
        let is_blank = cells.iter().all(|c| c.trim().is_empty());
        // The line of X1, Y1, Z1, which some files lack.
        let is_number = |cell: &str| cell.trim().parse::<f64>().is_ok();
        let is_title = is_first && !is_number(cells[0]) && !begins_with_margin(&cells, whole);
        is_first &= is_blank;
        if is_blank || is_title {
            continue;
        }
        if *has_margin.get_or_insert_with(|| begins_with_margin(&cells, whole))
            && !cells.remove(0).trim().is_empty()
        {
            let what = "does not begin with an empty cell, as the rows before do";
            return Err(Error::data(lines.here(), what));
        }
        let (frame, time) = (Some(cells[0]), cells.get(1).copied());
        let pushed = rows.push(number, frame, time, cells.iter().skip(2).copied());
        pushed.map_err(|e| e.at(lines.here()))?;
    }
    let mut take = rows.take(&name, header.stated, lines.whole, keep_whole)?;
    take.cells.separator = separator;
    take.cells.decimal_comma = decimal_comma;
    take.cells
        .move_points(|cell| 2 + usize::from(has_margin == Some(true)) + cell);
    Ok(take)
}

/// The cells of a row; there is at least one.
fn cells(line: &str, separator: Separator) -> Vec<&str> {
    match separator.of_row(line.as_bytes()) {
        Some(byte) => line.split(char::from(byte)).collect(),
        None => line.split_whitespace().collect(),
    }
}

/// Whether an empty cell stands before the frame's number in a row that has a cell more than a
/// `whole` one.
fn begins_with_margin(cells: &[&str], whole: usize) -> bool {
    match cells {
        [first, frame, time, ..] => {
            let is_number = |cell: &str| decimal(cell.trim()).parse::<f64>().is_ok();
            first.trim().is_empty()
                && frame.trim().parse::<u64>().is_ok()
                && is_number(time)
                && cells.len() > whole
        }
        _ => false,
    }
}

/// Checks the first line that is not blank: `PathFileType`, and the columns of a point as its third
/// word.
fn check_first(lines: &mut Lines<impl BufRead>, other: Option<&'static str>) -> Result<()> {
    let name = lines.name.clone();
    let bad = |what: String| Error::data(Place::file(&name), what);
    loop {
        match lines.next_line()? {
            None => return Err(bad("is empty, expected a TRC file".into())),
            Some(line) if line.trim().is_empty() => {}
            Some(line) => {
                let words = words(line);
                let key = words.first().map_or("", |word| word);
                if !key.eq_ignore_ascii_case("PathFileType") {
                    let what = "is no TRC file, which begins with PathFileType";
                    return Err(bad(other.unwrap_or(what).into()));
                }
                let axes = words.get(2).copied().unwrap_or_default();
                return if axes.starts_with('(') && !axes.eq_ignore_ascii_case("(X/Y/Z)") {
                    Err(bad(format!(
                        "has columns {}, expected (X/Y/Z)",
                        excerpt(axes)
                    )))
                } else {
                    Ok(())
                };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "PathFileType\t4\t(X/Y/Z)\tx.trc\n\
        DataRate\tNumFrames\tNumMarkers\tUnits\n\
        100\t  2\t2\tmm\n\
        Frame#\tTime\tA\t\t\tB\t\t\t\n";
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
    fn headers_are_read_however_their_cells_are_parted() {
        let text = format!("{HEAD}{ROWS}");
        let tabs = take(&text).unwrap();
        let commas = "PathFileType,4,(X/Y/Z),x.trc\n\
            DataRate,NumFrames,NumMarkers,Units\n\
            100,2,2,mm\n\
            Frame#,Time,A,,,B,,\n\
            ,,X1,Y1,Z1,X2,Y2,Z2\n\
            5,0.04,1,2,3,4,5,6\n\
            6,0.05,,,,nan,NaN,nan\n";
        let others = [
            text.replace("100\t  2\t2\tmm", " 100\t\t 2 \t  \t2\t\tmm \t"),
            text.replace("\tNumFrames\t", "   NumFrames \t"),
            text.replace("Frame#\tTime\tA\t", "Frame#  Time\tA\t"),
            text.replace(
                "Frame#\tTime\tA\t\t\tB\t\t\t",
                "Frame #\t\tTime\t\tA\t\t\t\t\tB",
            ),
            text.replace("5\t0.04\t1\t2", "5\t\t0.04\t\t1\t \t2"),
            text.replace(
                "PathFileType\t4\t(X/Y/Z)\t",
                " PathFileType  4  (X/Y/Z) C:\\a b ",
            ),
            format!(
                "\n \r\n{}",
                text.to_lowercase().replace("a\t\t\tb", "A\t\t\tB")
            ),
            text.replace('\n', "\r") + "\x1a",
            commas.to_string(),
        ];
        for other in others {
            let read = take(&other).unwrap();
            assert_eq!(read.points, tabs.points, "{other:?}");
            assert_eq!(
                (read.rate, &read.units),
                (tabs.rate, &tabs.units),
                "{other:?}"
            );
            assert_eq!(read.xyz.row(0), tabs.xyz.row(0), "{other:?}");
            assert_eq!(
                (read.xyz.nrows(), &read.notes[..]),
                (2, &[][..]),
                "{other:?}"
            );
        }
        let decimals = text
            .replace("0.04\t1\t", "0,04\t1,5\t")
            .replace("100", "100,0");
        let read = take(&decimals).unwrap();
        assert_eq!((read.rate, read.xyz[[0, 0]]), (Some(100.0), 1.5));
        assert!(read.cells.decimal_comma);
    }

    #[test]
    fn rows_may_begin_with_a_tab() {
        let text = format!("{HEAD}{ROWS}");
        let sound = take(&text).unwrap();
        let shifted = text.replace("\n5\t", "\n\t5\t").replace("\n6\t", "\n\t6\t");
        // The line of X1, Y1, Z1 may lack, and the titles may begin with a tab too.
        let bare = shifted.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n", "");
        let titled = shifted.replace("Frame#", "\tFrame#");
        for other in [&shifted, &bare, &titled] {
            let read = take(other).unwrap();
            assert_eq!((&read.points, read.xyz.nrows()), (&sound.points, 2));
            assert_eq!((read.first_frame, read.xyz.row(0)), (5, sound.xyz.row(0)));
            let mut new = read.xyz.clone();
            new[[0, 0]] = 9.5;
            let bytes = read
                .cells
                .with_points(other.as_bytes(), read.xyz.view(), new.view());
            let wanted = other.replace("5\t0.04\t1\t", "5\t0.04\t9.5\t");
            assert_eq!(String::from_utf8(bytes).unwrap(), wanted);
        }
        let mixed = shifted.replace("\n\t6", "\n6");
        let said = take(&mixed).unwrap_err().to_string();
        assert!(said.contains("does not begin with an empty cell"), "{said}");
    }

    #[test]
    fn names_may_stand_above_each_column() {
        let each = "A_x\tA_y\tA_z\tB.X\tB.Y\tB.Z";
        let text = format!("{HEAD}{ROWS}").replace("A\t\t\tB\t\t\t", each);
        let read = take(&text).unwrap();
        assert_eq!(
            (read.points, read.notes),
            (vec!["A".into(), "B".into()], vec![])
        );
        // Markers that are called so are as many as the header says.
        let three = "PathFileType\t4\t(X/Y/Z)\nDataRate\tNumFrames\tNumMarkers\tUnits\n\
            100\t1\t3\tmm\nFrame#\tTime\tA_x\t\t\tA_y\t\t\tA_z\n\
            1\t0\t1\t2\t3\t4\t5\t6\t7\t8\t9\n";
        assert_eq!(take(three).unwrap().points, ["A_x", "A_y", "A_z"]);
    }

    #[test]
    fn names_of_another_encoding_are_told() {
        let text = format!("{HEAD}{ROWS}").replace("A\t\t\t", "\u{e4}\t\t\t");
        assert!(take(&text).unwrap().notes.is_empty());
        let bytes = text.chars().map(|c| c as u8).collect::<Vec<u8>>();
        let input = Input::new("x.trc", std::io::Cursor::new(bytes)).unwrap();
        let notes = read(input, false).unwrap().notes;
        assert!(
            notes[0].contains("not UTF-8") && notes.len() == 1,
            "{notes:?}"
        );
    }

    #[test]
    fn rows_that_end_in_a_tab_lose_no_frame() {
        let text = format!("{HEAD}{ROWS}").replace("5\t6\n", "5\t6\t\n");
        let ended = text.replace("nan\tNaN\tnan\n", "7\t8\t9\t");
        let read = take(&ended).unwrap();
        assert_eq!((read.xyz.nrows(), read.xyz[[1, 5]]), (2, 9.0));
        assert!(read.notes.is_empty());
        // The rows count; a row that is cut off is an early end.
        let more = take(&ended.replace("  2", "109")).unwrap();
        assert_eq!(more.notes, ["announces 109 frames but has 2"]);
        let cut = ended.replace("7\t8\t9\t", "7\t8");
        assert!(take(&cut).unwrap_err().to_string().contains("`keep_whole`"));
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
            (&whole.replace("nan\tNaN\tnan\n", "nan"), "`keep_whole`"),
        ] {
            let said = take(text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        }
    }
}
