//! Vicon Nexus' files of text: sections such as Devices and Trajectories, each with its rate, its
//! titles and its rows, and an empty line between two. Markers are those of Trajectories:
//! `Subject:Marker` above X, Y, Z and their unit.
//!
//! Older programs of Vicon write `TRAJECTORIES`, the rate with `Hz`, and no unit. Rows may be
//! parted by tabs.
//!
//! Rigid bodies are those of Objects, where there are no markers.

use super::tracker;
use crate::marker_rows::{MarkerRows, Stated};
use crate::marker_take::{CarriedColumns, MarkerTake};
use crate::point_titles::PointTitles;
use crate::row_cells::texts_of;
use crate::text::Lines;
use crate::text_start::{BLANK, is_section, section_rate};
use crate::{Error, Place, Result};
use std::io::BufRead;

/// Reads the file.
pub(crate) fn read(mut lines: Lines<impl BufRead>, keep_whole: bool) -> Result<MarkerTake> {
    let name = lines.name.clone();
    let (mut markers, mut objects) = (None, None);
    let (mut others, mut next): (Vec<String>, Option<String>) = (Vec::new(), None);
    loop {
        let title = match next.take() {
            Some(title) => title,
            None => match lines.next_line()? {
                Some(line) if is_section(line) => line.trim_matches(BLANK).to_string(),
                Some(_) => continue,
                None => break,
            },
        };
        if markers.is_none() && title.eq_ignore_ascii_case("Trajectories") {
            markers = Some(section(&mut lines, &mut next, keep_whole, false)?);
            continue;
        }
        if markers.is_none() && objects.is_none() && title.eq_ignore_ascii_case(tracker::OBJECTS) {
            objects = Some(section(&mut lines, &mut next, keep_whole, true));
        }
        if others.len() < 8 {
            others.push(title);
        }
    }
    let mut take = match (markers, objects) {
        (Some(take), _) => take,
        (None, Some(take)) => {
            others.retain(|title| !title.eq_ignore_ascii_case(tracker::OBJECTS));
            take?
        }
        (None, None) => {
            let what = format!(
                "has no section Trajectories, only {}: export the trajectories too",
                others.join(", ")
            );
            return Err(Error::data(Place::file(name), what));
        }
    };
    if !others.is_empty() {
        let what = format!(
            "its other sections are not converted: {}",
            others.join(", ")
        );
        take.notes.push(what);
    }
    Ok(take)
}

/// Reads the section of markers, or that of rigid bodies, up to the title of the next section,
/// which becomes `next`. Blank lines may stand between its rows.
fn section(
    lines: &mut Lines<impl BufRead>,
    next: &mut Option<String>,
    keep_whole: bool,
    is_of_objects: bool,
) -> Result<MarkerTake> {
    let Head {
        rate,
        titles,
        separator,
        ahead,
        notes,
    } = Head::read(lines, next, is_of_objects)?;
    let units = titles.unit().map_err(|e| e.at(lines.here()))?;
    let width = titles.width;
    let at: Vec<usize> = titles.points.iter().flat_map(|(_, at)| *at).collect();
    let labels: Vec<String> = titles.points.iter().map(|(name, _)| name.clone()).collect();
    let turns = tracker::rotations(&titles).filter(|_| is_of_objects);
    let (names, turns): (Vec<String>, Vec<usize>) = turns.unzip();
    let mut carried = CarriedColumns::new(names.iter().map(String::as_str), &labels);
    let mut rows = MarkerRows::default();
    let mut number = lines.number - ahead.len() as u64 + 1;
    let mut ahead = ahead.into_iter();
    let mut is_whole = lines.whole;
    // How many whole rows lack cells of points, and the line of the first.
    let (mut short, mut first_short) = (0, 0);
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
            *next = Some(line.trim_matches(BLANK).to_string());
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
        let cell = |at: &usize| cells.get(*at).map_or("", |cell| &**cell);
        carried.push(number, turns.iter().map(cell));
        number += 1;
    }
    let stated = Stated {
        labels,
        rate: Some(rate),
        units,
        notes,
        ..Stated::default()
    };
    let mut take = rows.take(&lines.name, stated, is_whole, keep_whole)?;
    take.cells.separator = titles.separator;
    take.cells.move_points(|cell| at[cell]);
    // Frames that the file leaves out have no row.
    let rows = take.cells.lines.iter().flatten().count();
    carried.rows.truncate(rows);
    take.carried = carried;
    if short > 0 {
        take.notes.push(format!(
            "has {short} rows of fewer than {width} cells, first in line {first_short}: what they \
             lack is missing"
        ));
    }
    Ok(take)
}

/// What stands above the rows of the section of markers.
struct Head {
    rate: f64,
    titles: PointTitles,
    /// What parts cells.
    separator: u8,
    /// The first row, which is read already: the older programs have no row of units.
    ahead: Vec<String>,
    notes: Vec<String>,
}

impl Head {
    fn read(
        lines: &mut Lines<impl BufRead>,
        next: &mut Option<String>,
        is_of_objects: bool,
    ) -> Result<Head> {
        let rate = lines.next_line()?.and_then(section_rate);
        let bad = |lines: &Lines<_>, what: &str| Error::data(lines.here(), what);
        let rate = rate.ok_or_else(|| bad(lines, "expected the rate of the trajectories"))?;
        let mut head: Vec<String> = Vec::new();
        while head.len() < 3 {
            let Some(line) = lines.next_line()? else {
                break;
            };
            if is_of_objects && is_section(line) {
                *next = Some(line.trim_matches(BLANK).to_string());
                break;
            }
            head.push(line.to_string());
        }
        if let Some(axes) = head.get_mut(1).filter(|_| is_of_objects) {
            *axes = tracker::plain_axes(axes);
        }
        let of_head: Vec<&str> = head.iter().map(String::as_str).collect();
        let titles = PointTitles::of_markers(&of_head).filter(|t| !t.points.is_empty());
        let mut titles = titles.ok_or_else(|| {
            let what = if is_of_objects {
                "expected the names of the objects above RX, RY, RZ, TX, TY, TZ"
            } else {
                "expected the names of the markers above X, Y, Z and their unit"
            };
            bad(lines, what)
        })?;
        if is_of_objects {
            let names = titles.points.iter_mut().map(|(name, _)| name);
            names.for_each(|name| *name = tracker::name_of_object(name).to_string());
        }
        let units = of_head.get(2).filter(|_| is_of_objects);
        let notes = units.and_then(|row| tracker::unit_note(row));
        let Some(separator) = titles.separator.byte() else {
            return Err(bad(lines, "expected cells that commas or tabs part"));
        };
        Ok(Head {
            rate,
            separator,
            ahead: head.get(titles.rows..).unwrap_or_default().to_vec(),
            titles,
            notes: notes.into_iter().collect(),
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
