//! Vicon Nexus' files of text: sections such as Devices and Trajectories, each with its rate, its
//! titles and its rows, and an empty line between two. Markers are those of Trajectories:
//! `Subject:Marker` above X, Y, Z and their unit.
//!
//! Older programs of Vicon write `TRAJECTORIES`, the rate with `Hz`, and no unit. Rows may be
//! parted by tabs.

use crate::marker_rows::{MarkerRows, Stated};
use crate::marker_take::MarkerTake;
use crate::point_titles::PointTitles;
use crate::row_cells::texts_of;
use crate::text::Lines;
use crate::text_start::{BLANK, is_section, section_rate};
use crate::{Error, Place, Result};
use std::io::BufRead;

/// Reads the file.
pub(crate) fn read(mut lines: Lines<impl BufRead>, keep_whole: bool) -> Result<MarkerTake> {
    let name = lines.name.clone();
    let mut others: Vec<String> = Vec::new();
    loop {
        let Some(line) = lines.next_line()? else {
            let what = format!(
                "has no section Trajectories, only {}: export the trajectories too",
                others.join(", ")
            );
            return Err(Error::data(Place::file(name), what));
        };
        let title = line.trim_matches(BLANK);
        if title.eq_ignore_ascii_case("Trajectories") {
            break;
        }
        if is_section(line) && others.len() < 8 {
            others.push(title.to_string());
        }
    }
    let (mut take, next) = trajectories(&mut lines, keep_whole)?;
    others.extend(next);
    while let Some(line) = lines.next_line()? {
        if is_section(line) && others.len() < 8 {
            others.push(line.trim_matches(BLANK).to_string());
        }
    }
    if !others.is_empty() {
        let what = format!(
            "its other sections are not converted: {}",
            others.join(", ")
        );
        take.notes.push(what);
    }
    Ok(take)
}

/// Reads the section of markers, up to the title of the next section, which is given too. Blank
/// lines may stand between its rows.
fn trajectories(
    lines: &mut Lines<impl BufRead>,
    keep_whole: bool,
) -> Result<(MarkerTake, Option<String>)> {
    let Head {
        rate,
        titles,
        separator,
        ahead,
    } = Head::read(lines)?;
    let units = titles.unit().map_err(|e| e.at(lines.here()))?;
    let width = titles.width;
    let at: Vec<usize> = titles.points.iter().flat_map(|(_, at)| *at).collect();
    let mut rows = MarkerRows::default();
    let mut number = lines.number - ahead.len() as u64 + 1;
    let mut ahead = ahead.into_iter();
    let mut is_whole = lines.whole;
    // How many whole rows lack cells of points, and the line of the first.
    let (mut short, mut first_short) = (0, 0);
    let mut next = None;
    let last_point = at.iter().copied().max().unwrap_or_default();
    loop {
        let line = match ahead.next() {
            Some(line) => line,
            None => match lines.next_line()? {
                Some(line) => line.to_string(),
                None => break,
            },
        };
        if is_section(&line) {
            next = Some(line.trim_matches(BLANK).to_string());
            break;
        }
        if line.trim_matches(BLANK).is_empty() {
            number += 1;
            continue;
        }
        is_whole = lines.whole;
        let cells = texts_of(&line, separator);
        let place = Place::line(&lines.name, number);
        if cells.iter().skip(width).any(|c| !c.is_empty()) {
            let what = format!("expected {width} cells, found {}", cells.len());
            return Err(Error::data(place, what));
        }
        if cells.len() <= last_point && lines.whole {
            first_short = if short == 0 { number } else { first_short };
            short += 1;
        }
        let chosen = at.iter().map_while(|&c| cells.get(c).map(|c| &**c));
        let pushed = rows.push(number, cells.first().map(|c| &**c), None, chosen);
        pushed.map_err(|e| e.at(place))?;
        number += 1;
    }
    let stated = Stated {
        labels: titles.points.iter().map(|(name, _)| name.clone()).collect(),
        rate: Some(rate),
        units,
        ..Stated::default()
    };
    let mut take = rows.take(&lines.name, stated, is_whole, keep_whole)?;
    take.cells.separator = titles.separator;
    take.cells.move_points(|cell| at[cell]);
    if short > 0 {
        take.notes.push(format!(
            "has {short} rows of fewer than {width} cells, first in line {first_short}: what they \
             lack is missing"
        ));
    }
    Ok((take, next))
}

/// What stands above the rows of the section of markers.
struct Head {
    rate: f64,
    titles: PointTitles,
    /// What parts cells.
    separator: u8,
    /// The first row, which is read already: the older programs have no row of units.
    ahead: Vec<String>,
}

impl Head {
    fn read(lines: &mut Lines<impl BufRead>) -> Result<Head> {
        let rate = lines.next_line()?.and_then(section_rate);
        let bad = |lines: &Lines<_>, what: &str| Error::data(lines.here(), what);
        let rate = rate.ok_or_else(|| bad(lines, "expected the rate of the trajectories"))?;
        let mut head: Vec<String> = Vec::new();
        while head.len() < 3 {
            let Some(line) = lines.next_line()? else {
                break;
            };
            head.push(line.to_string());
        }
        let of_head: Vec<&str> = head.iter().map(String::as_str).collect();
        let titles = PointTitles::of_markers(&of_head).filter(|t| !t.points.is_empty());
        let titles = titles.ok_or_else(|| {
            let what = "expected the names of the markers above X, Y, Z and their unit";
            bad(lines, what)
        })?;
        let Some(separator) = titles.separator.byte() else {
            return Err(bad(lines, "expected cells that commas or tabs part"));
        };
        Ok(Head {
            rate,
            separator,
            ahead: head.get(titles.rows..).unwrap_or_default().to_vec(),
            titles,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, marker_csv};

    const NEXUS: &str = "\u{feff}Devices\n1000\n\
        ,,Plate - Force,,\n\
        Frame,Sub Frame,Fx,Fy,Fz\n\
        ,,N,N,N\n11,0,1,2,3\n\
        11,1,1,2,3\n\nTrajectories\n\
        100\n\
        ,,Ann:A,,,Bob:A,,\n\
        Frame,Sub Frame,X,Y,Z,X,Y,Z\n\
        ,,mm,mm,mm,mm,mm,mm\n\
        11,0,1,2,3,4,5,6\n12,0,1.5,2,3,,,\n\
        \nModel Outputs\n100\n\
        ,,Ann:LKneeAngles,,\n\
        Frame,Sub Frame,X,Y,Z\n\
        ,,deg,deg,deg\n11,0,7,8,9\n";

    fn take(text: &str) -> Result<MarkerTake> {
        let bytes = text.as_bytes().to_vec();
        let input = Input::new("x.csv", std::io::Cursor::new(bytes))?;
        marker_csv::read(input, None, false)
    }

    #[test]
    fn trajectories_are_read_wherever_they_stand() {
        let take = take(NEXUS).unwrap();
        assert_eq!(take.points, ["Ann:A", "Bob:A"]);
        assert_eq!((take.first_frame, take.rate), (11, Some(100.0)));
        assert_eq!(
            (take.units.as_deref(), take.up.as_deref()),
            (Some("mm"), None)
        );
        assert_eq!(take.xyz.row(0).to_vec(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert!(take.xyz.row(1).iter().skip(3).all(|v| v.is_nan()));
        assert_eq!(take.xyz.nrows(), 2);
        assert_eq!(
            take.notes,
            ["its other sections are not converted: Devices, Model Outputs"]
        );
        let mut new = take.xyz.clone();
        new[[1, 4]] = -7.25;
        let bytes = take
            .cells
            .with_points(NEXUS.as_bytes(), take.xyz.view(), new.view());
        let wanted = NEXUS.replace("12,0,1.5,2,3,,,\n", "12,0,1.5,2,3,,-7.25,\n");
        assert_eq!(String::from_utf8(bytes).unwrap(), wanted);
    }

    #[test]
    fn variants_of_versions_and_spreadsheets_are_read() {
        let section = NEXUS.split("\n\n").nth(1).unwrap();
        let plain = take(section).unwrap();
        let old = section
            .replace("Trajectories\n100\n,,", "TRAJECTORIES\n100,Hz\n,")
            .replace("Frame,Sub Frame", "Field #")
            .replace(",,mm,mm,mm,mm,mm,mm\n", "")
            .replace("1,0,1,2", "1,1,2")
            .replace("2,0,1.5", "2,1.5");
        let padded = section.replace("ories\n100\n", "ories,,,,,,,\n100,,,,,,,\n");
        for text in [
            format!("\n\n{section}\n"),
            section.replace(',', "\t"),
            section.replace('\n', "\r\n"),
            section.replace("\n12,", "\n\n12,"),
            padded.clone() + "\n,,,,,,,\n",
            old.clone(),
        ] {
            let take = take(&text).unwrap();
            assert_eq!((take.points, take.first_frame), (plain.points.clone(), 11));
            let bits = |xyz: &ndarray::Array2<f64>| -> Vec<u64> {
                xyz.iter().map(|v| v.to_bits()).collect()
            };
            assert_eq!(bits(&take.xyz), bits(&plain.xyz), "{text}");
            let units = (text != old).then_some("mm");
            assert_eq!(take.units.as_deref(), units);
        }
        // Velocities and accelerations beside each position.
        let more = section
            .replace("Ann:A,,,Bob:A,,", "Ann:A,,,,,,Bob:A,,,,,")
            .replace("X,Y,Z", "X,Y,Z,X',Y',Z'")
            .replace("mm,mm,mm", "mm,mm,mm,mm/s,mm/s,mm/s")
            .replace("1,2,3,4,5,6", "1,2,3,0,0,0,4,5,6,0,0,0")
            .replace("1.5,2,3,,,", "1.5,2,3,,,,,,,,,");
        let more = take(&more).unwrap();
        assert_eq!((more.points, more.xyz[[0, 3]]), (plain.points.clone(), 4.0));
        // Names of markers are no quantities, and one without a name has a number.
        let named = section.replace("Ann:A", "Ann:L_ACC").replace("Bob:A", "");
        assert_eq!(take(&named).unwrap().points, ["Ann:L_ACC", "*2"]);
        assert!(plain.notes.is_empty());
        let short = section.replace("1.5,2,3,,,", "1.5,2,3\n");
        let short = take(&short).unwrap();
        assert_eq!(short.xyz.dim(), plain.xyz.dim());
        let what = "has 1 rows of fewer than 8 cells, first in line 7";
        assert!(short.notes[0].starts_with(what), "{:?}", short.notes);
    }

    #[test]
    fn rows_go_on_after_a_blank_line() {
        let blank = NEXUS.replace("\n12,0,1.5,2,3,,,\n", "\n\n,,,,,,,\n12,0,1.5,2,3,,,\n\n");
        let read = take(&blank).unwrap();
        assert_eq!(read.xyz.nrows(), 2);
        assert_eq!(read.cells.lines, [Some(14), Some(17)]);
        assert_eq!(
            read.notes,
            ["its other sections are not converted: Devices, Model Outputs"]
        );
    }

    #[test]
    fn faults_have_a_place() {
        let fails = |text: &str, part: &str| {
            let said = take(text).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        fails(
            "Devices\n1000\n\n",
            "has no section Trajectories, only Devices",
        );
        fails("Trajectories\n100\n", "x.csv:2: expected the names");
        fails(
            &NEXUS.replace("1.5,2", "1.5,x"),
            "x.csv:15: expected a number",
        );
        fails(
            &NEXUS.replace("\n12,", "\n10,"),
            "frame 10 follows frame 11",
        );
        fails(
            &NEXUS.replace("\n\nModel Outputs", "\n\nOther things"),
            "x.csv:17: expected a frame's number, found \"Other things\"",
        );
        fails(
            &NEXUS.replace("4,5,6\n", "4,5,6,7\n"),
            "x.csv:14: expected 8 cells, found 9",
        );
        fails(
            NEXUS.split_once("\n11,0,1,2,3,4").unwrap().0,
            "has no frames",
        );
    }
}
