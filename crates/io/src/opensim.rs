//! OpenSim's .mot and .sto files: a header that ends in `endheader`, a row of titles, and rows of
//! numbers, the time first. They hold angles, forces, muscles' states and the like, and no
//! positions of points: all columns are carried along.

use super::input::Input;
use super::marker_csv::point_table::rate_of_times;
use super::marker_rows::{ends_early, is_missing};
use super::marker_take::{CarriedColumns, MarkerTake};
use super::motion_format::{MotionFormat, recognized};
use super::text::{Lines, excerpt, parse_number, push_f64};
use super::text_start::MOST_HEADER_LINES;
use crate::{Error, Place, Result};
use ndarray::Array2;
use std::io::BufRead;

/// Reads a file. Its take has no points; its times and its columns are the file's. With
/// `keep_whole`, one that ends early gives the rows that it has.
///
/// # Errors
/// [`Error::Data`]: it is no such file, has no times or rows, ends early, or a row has other cells
/// than there are titles.
/// [`Error::Io`]: reading fails.
pub fn read(mut input: Input, keep_whole: bool) -> Result<MarkerTake> {
    input.look_ahead()?;
    let name = input.name.clone();
    let bad = |what: String| Error::data(Place::file(&name), what);
    if MotionFormat::of(input.first_bytes()) != MotionFormat::OpenSim {
        let other = recognized(input.first_bytes());
        let what = other.unwrap_or("is no .mot or .sto file: it has no line endheader");
        return Err(bad(what.into()));
    }
    let mut lines = Lines::new(&name, input.into_reader());
    let header = Header::read(&mut lines)?;
    let Some(line) = next(&mut lines)? else {
        return Err(bad("ends behind its header".into()));
    };
    let titles: Vec<String> = cells(&line, None).iter().map(|t| t.to_string()).collect();
    let time = titles.iter().position(|t| t.eq_ignore_ascii_case("time"));
    let time = time.ok_or_else(|| Error::data(lines.here(), "expected a title time"))?;
    let others = titles.iter().enumerate().filter(|(c, _)| *c != time);
    let names = others.map(|(_, title)| title.as_str());
    let mut carried = CarriedColumns::new(names, &[]);
    let mut times = Vec::new();
    let mut is_cut = false;
    while let Some(line) = next(&mut lines)? {
        let row = cells(&line, Some(titles.len()));
        if row.len() != titles.len() {
            is_cut = !lines.whole;
            if is_cut {
                break;
            }
            let what = format!("expected {} cells, found {}", titles.len(), row.len());
            return Err(Error::data(lines.here(), what));
        }
        let seconds = parse_number(row[time]);
        times.push(seconds.map_err(|e| e.at(lines.here().part("time")))?);
        let others = row.iter().enumerate().filter(|(c, _)| *c != time);
        carried.push(lines.number, others.map(|(_, cell)| *cell));
    }
    let early = ends_early("row", times.len(), header.rows, is_cut);
    if let Some(what) = early.as_ref().filter(|_| !keep_whole) {
        return Err(bad(format!("{what}; the option `keep_whole` reads those")));
    }
    if times.is_empty() {
        return Err(bad("has no rows".into()));
    }
    let mut notes: Vec<String> = early.into_iter().collect();
    notes.extend(header.notes(times.len()));
    notes.extend(missing_cells(&carried));
    notes.push(format!(
        "holds no positions; columns beside the time: {}",
        carried.names.len()
    ));
    Ok(MarkerTake {
        name: name.clone(),
        xyz: Array2::zeros((times.len(), 0)),
        first_frame: 1,
        rate: rate_of_times(&times),
        times: Some(times),
        notes,
        carried,
        ..MarkerTake::default()
    })
}

/// A file: `titles` are those behind `time`, a row is the time, seconds, and a value each. NaN is
/// written as nan, which OpenSim refuses in forces.
#[doc(hidden)]
pub fn storage(
    name: &str,
    in_degrees: bool,
    titles: &[&str],
    rows: impl ExactSizeIterator<Item = Vec<f64>>,
) -> Vec<u8> {
    let in_degrees = if in_degrees { "yes" } else { "no" };
    let head = format!(
        "{}\nversion=1\nnRows={}\nnColumns={}\ninDegrees={in_degrees}\nendheader\ntime",
        // A name is a line.
        name.replace(char::is_control, " "),
        rows.len(),
        titles.len() + 1
    );
    let mut out = head.into_bytes();
    for title in titles {
        out.push(b'\t');
        out.extend(title.as_bytes());
    }
    for row in rows {
        for (i, value) in row.into_iter().enumerate() {
            out.push(if i == 0 { b'\n' } else { b'\t' });
            match value {
                v if v.is_nan() => out.extend(b"nan"),
                v => push_f64(&mut out, v),
            }
        }
    }
    out.push(b'\n');
    out
}

/// Which columns lack how many values, in a line; `None`: none does.
fn missing_cells(carried: &CarriedColumns) -> Option<String> {
    /// The most columns that the line names.
    const MOST: usize = 8;
    let rows = carried.rows.len();
    let is_missing =
        |cell: Option<&[u8]>| cell.is_none_or(|cell| is_missing(&String::from_utf8_lossy(cell)));
    let counts = carried.names.iter().enumerate().map(|(column, name)| {
        let missing = carried
            .rows
            .iter()
            .filter(|row| is_missing(row.get(column)));
        (name, missing.count())
    });
    let lacking: Vec<(&String, usize)> = counts.filter(|(_, count)| *count > 0).collect();
    let mut told: Vec<String> = (lacking.iter().take(MOST))
        .map(|(name, count)| format!("{} {count} of {rows}", excerpt(name)))
        .collect();
    if lacking.len() > MOST {
        told.push(format!("{} columns more", lacking.len() - MOST));
    }
    (!told.is_empty()).then(|| format!("values are missing: {}", told.join(", ")))
}

/// What the header says.
#[derive(Debug, Default)]
struct Header {
    /// The number of rows: `nRows=20` or `datarows 20`.
    rows: Option<usize>,
    /// `inDegrees=yes`.
    in_degrees: Option<bool>,
}

impl Header {
    fn read(lines: &mut Lines<impl BufRead>) -> Result<Header> {
        let mut header = Header::default();
        while lines.number < MOST_HEADER_LINES as u64
            && let Some(line) = lines.next_line()?
        {
            let line = line.trim();
            if line.eq_ignore_ascii_case("endheader") {
                return Ok(header);
            }
            let parted = line
                .split_once('=')
                .or_else(|| line.split_once([' ', '\t']));
            let Some((key, value)) = parted else {
                continue;
            };
            let value = value.trim().trim_start_matches('=').trim();
            match key.trim().to_ascii_lowercase().as_str() {
                "nrows" | "datarows" => header.rows = value.parse().ok(),
                "indegrees" => {
                    header.in_degrees = match value.to_ascii_lowercase().as_str() {
                        "yes" | "1" | "true" => Some(true),
                        "no" | "0" | "false" => Some(false),
                        _ => None,
                    };
                }
                _ => {}
            }
        }
        Err(Error::data(lines.here(), "expected a line endheader"))
    }

    /// What a person should know of it.
    fn notes(&self, rows: usize) -> Vec<String> {
        let more = self.rows.filter(|n| *n < rows);
        let more = more.map(|n| format!("announces {n} rows but has {rows}"));
        let angles = self.in_degrees.map(|is| {
            if is {
                "its angles are in degrees".to_string()
            } else {
                "its angles are in radians".to_string()
            }
        });
        more.into_iter().chain(angles).collect()
    }
}

/// The next line that is not blank.
fn next(lines: &mut Lines<impl BufRead>) -> Result<Option<String>> {
    Ok(lines.next_filled(char::is_whitespace)?.map(str::to_string))
}

/// The cells of a row: parted by tabs or, where these do not give the cells that are `expected`, by
/// blanks.
fn cells(line: &str, expected: Option<usize>) -> Vec<&str> {
    let mut by_tabs: Vec<&str> = line.trim_end().split('\t').map(str::trim).collect();
    // Rows may begin with a tab.
    if by_tabs.len() > 1 && by_tabs[0].is_empty() && expected != Some(by_tabs.len()) {
        by_tabs.remove(0);
    }
    let is_of_tabs = match expected {
        Some(count) => by_tabs.len() == count,
        None => by_tabs.len() > 1,
    };
    if is_of_tabs {
        by_tabs
    } else {
        line.split_whitespace().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    const MOT: &str = "Coordinates\nversion=1\n\
        nRows=2\nnColumns=3\n\
        inDegrees=yes\n\n\
        Units are S.I. units.\n\
        \nendheader\n\
        time\tpelvis_tilt\tknee_angle_r\n\
        3.3800\t0.00000\t-1.00000\n\
        3.3900\t3.97339\t-0.94496\n";

    fn take(text: &str, keep_whole: bool) -> Result<MarkerTake> {
        read(
            Input::new("x.mot", Cursor::new(text.as_bytes().to_vec()))?,
            keep_whole,
        )
    }

    fn text(take: &MarkerTake, row: usize) -> Vec<String> {
        let cells = &take.carried.rows[row];
        let text = |i: usize| String::from_utf8_lossy(&cells[i]).into_owned();
        (0..cells.len()).map(text).collect()
    }

    #[test]
    fn columns_and_times_are_those_of_the_file() {
        let blanks = MOT.replace('\t', "   ").replace("\n3.", "\n   3.");
        let simm = "name walk\ndatacolumns 3\ndatarows 2\nrange 3.38 3.39\nendheader\n";
        let (_, rows) = MOT.split_once("endheader\n").unwrap();
        for file in [
            MOT.to_string(),
            MOT.replace('\n', "\r\n"),
            MOT.replace("\t0.0", "\t 0.0").replace("\n3.", "\n\t3."),
            blanks,
            format!("{simm}{rows}"),
            MOT.replace("angle_r\n", "angle_r\t\n"),
        ] {
            let read = take(&file, false).unwrap();
            assert_eq!(
                read.carried.names,
                ["pelvis_tilt", "knee_angle_r"],
                "{file}"
            );
            assert_eq!(read.times, Some(vec![3.38, 3.39]));
            assert_eq!(text(&read, 1), ["3.97339", "-0.94496"]);
            assert_eq!((read.xyz.dim(), read.points.len()), ((2, 0), 0));
            let last = read.notes.last().unwrap();
            assert_eq!(last, "holds no positions; columns beside the time: 2");
        }
        assert_eq!(
            take(MOT, false).unwrap().notes[0],
            "its angles are in degrees"
        );
    }

    #[test]
    fn what_is_written_reads_back() {
        let rows = [[0.5, 1.0 / 3.0, f64::NAN], [0.51, -2.0, 1e20]].map(Vec::from);
        let text = storage("a\nb", true, &["p", "q"], rows.clone().into_iter());
        let text = String::from_utf8(text).unwrap();
        let head = "a b\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\nendheader\ntime\tp\tq\n";
        assert!(text.starts_with(head), "{text}");
        let read = take(&text, false).unwrap();
        assert_eq!(read.times, Some(vec![0.5, 0.51]));
        assert_eq!(self::text(&read, 0), ["0.3333333333333333", "nan"]);
        let none = storage("x", false, &[], std::iter::empty());
        assert!(none.ends_with(b"nRows=0\nnColumns=1\ninDegrees=no\nendheader\ntime\n"));
    }

    #[test]
    fn missing_values_are_told_by_column() {
        let holed = MOT.replace("-1.00000", "NaN").replace("-0.94496", "nan");
        let read = take(&holed, false).unwrap();
        assert_eq!(read.notes[1], "values are missing: knee_angle_r 2 of 2");
        assert_eq!(text(&read, 0), ["0.00000", "NaN"]);
    }

    #[test]
    fn a_column_that_a_point_would_have_and_cells_of_vectors_stay() {
        let vectors = "x\nendheader\ntime\tq\tq\ttake\n0\t1,0,0,0\t2\tw\n";
        let read = take(vectors, false).unwrap();
        assert_eq!(read.carried.names, ["q", "q_2", "take_2"]);
        assert_eq!(text(&read, 0), ["1,0,0,0", "2", "w"]);
    }

    #[test]
    fn faults_have_a_place() {
        let fails = |text: &str, part: &str| {
            let said = take(text, false).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        fails("a\nb\n", "no line endheader");
        fails("a\nendheader\n", "ends behind its header");
        fails("a\nendheader\nspeed\n1\n", "x.mot:3: expected a title time");
        fails("a\nendheader\ntime\tb\n", "has no rows");
        fails(&MOT.replace("3.3900", "x"), "x.mot:12: time: expected");
        fails(
            &MOT.replace("\t-1.0", "\t5\t-1.0"),
            "x.mot:11: expected 3 cells",
        );
        fails(
            &MOT.replace("=2", "=3"),
            "after 2 of its 3 rows; the option `keep_whole`",
        );
        let cut = MOT.replace("\t-0.94496\n", "");
        fails(&cut, "the option `keep_whole`");
        assert_eq!(take(&cut, true).unwrap().xyz.nrows(), 1);
    }
}
