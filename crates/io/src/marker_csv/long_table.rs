//! Long tables: a row for each point in each frame, with columns of the frame or the time, the
//! point's name and x, y, z, in any order; a person's name may stand before the point's.

use super::point_table::{Decimals, rate_of_times};
use crate::long_titles::LongTitles;
use crate::marker_rows::{MOST_COLUMNS, MarkerRows, Stated, coordinate};
use crate::marker_take::MarkerTake;
use crate::point_titles::one_unit;
use crate::row_cells::texts_of;
use crate::text::{Lines, excerpt, parse_number};
use crate::text_start::BLANK;
use crate::{Error, Place, Result};
use std::collections::HashMap;
use std::io::BufRead;

/// The most rows: 2.5 GiB.
const MOST_ROWS: usize = 1 << 26;
/// A row: a position in a frame.
struct Row {
    /// The number of the frame; its time, where frames have no numbers.
    frame: f64,
    seconds: f64,
    point: usize,
    xyz: [f64; 3],
    line: u64,
}

/// Reads the file.
pub(crate) fn read(mut lines: Lines<impl BufRead>, keep_whole: bool) -> Result<MarkerTake> {
    let name = lines.name.clone();
    let bad = |what: String| Error::data(Place::file(&name), what);
    let titles = lines.next_filled(|c| BLANK.contains(&c))?;
    let titles = titles.and_then(LongTitles::read);
    let titles = titles.ok_or_else(|| bad("has no columns of a long table".into()))?;
    let mut seen = Seen::default();
    let mut rows: Vec<Row> = Vec::new();
    let mut cut = None;
    while let Some(line) = lines.next_filled(|c| BLANK.contains(&c))? {
        let cells = texts_of(line, titles.separator);
        let row = row(&titles, &mut seen, &cells);
        let (is_short, number) = (cells.len() < titles.width, lines.number);
        // The last row of a file that is cut off lacks its last cells.
        if !lines.whole && is_short {
            cut = Some(format!(
                "ends within a row, after {} whole ones",
                rows.len()
            ));
            break;
        }
        let row = row.map_err(|e| e.at(Place::line(&name, number)))?;
        if rows.len() == MOST_ROWS || seen.names.len() > MOST_COLUMNS / 3 {
            let most = MOST_COLUMNS / 3;
            let what = format!("has more than {MOST_ROWS} rows or {most} points: split it");
            return Err(bad(what));
        }
        rows.push(Row {
            line: number,
            ..row
        });
    }
    match cut {
        Some(what) if !keep_whole => {
            Err(bad(format!("{what}; the option `keep_whole` reads those")))
        }
        cut => take(&name, titles, seen, rows, cut),
    }
}

/// What the rows so far have.
#[derive(Default)]
struct Seen {
    /// The points' names.
    names: Vec<String>,
    by_name: HashMap<String, usize>,
    decimals: Decimals,
    /// The take, where a column has it.
    take: Option<String>,
}

impl Seen {
    fn index(&mut self, name: String) -> usize {
        *self.by_name.entry(name).or_insert_with_key(|name| {
            self.names.push(name.clone());
            self.names.len() - 1
        })
    }
}

fn row(titles: &LongTitles, seen: &mut Seen, cells: &[std::borrow::Cow<'_, str>]) -> Result<Row> {
    let (width, found) = (titles.width, cells.len());
    if cells.iter().skip(width).any(|c| !c.is_empty()) {
        return Err(format!("expected {width} cells, found {found}").into());
    }
    let cell = |at: usize| cells.get(at).map_or("", |cell| &**cell);
    if let Some(take) = titles.take.map(cell) {
        let before = seen.take.get_or_insert_with(|| take.to_string());
        if take != before {
            let (take, before) = (excerpt(take), excerpt(before));
            return Err(
                format!("is of take {take} after rows of {before}: split the takes").into(),
            );
        }
    }
    let mut number = |at: usize| seen.decimals.text(cell(at), titles.separator);
    let seconds = match titles.time {
        Some((at, unit)) => {
            let seconds = number(at).and_then(|text| parse_number(&text));
            unit * seconds.map_err(|e| format!("time: {e}"))?
        }
        None => f64::NAN,
    };
    let frame = match titles.frame {
        Some(at) => {
            let number = parse_number(cell(at)).map_err(|e| format!("frame: {e}"))?;
            let is_number = number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number);
            is_number.then_some(number).ok_or_else(|| {
                format!("expected a frame's number, found \"{}\"", excerpt(cell(at)))
            })?
        }
        None => seconds,
    };
    let mut name = cell(titles.point).to_string();
    if let Some(person) = titles.person.map(cell).filter(|person| !person.is_empty()) {
        name = format!("{person}:{name}");
    }
    let [x, y, z] = titles.xyz.map(|at| coordinate(&number(at)?));
    Ok(Row {
        frame,
        seconds,
        point: seen.index(name),
        xyz: [x?, y?, z?],
        line: 0,
    })
}

/// Fails where the rows of a frame differ in their times.
fn check_time(name: &str, frame: &[Row]) -> Result<()> {
    let differs = |row: &&Row| !frame[0].seconds.is_nan() && row.seconds != frame[0].seconds;
    let Some(other) = frame.iter().find(differs) else {
        return Ok(());
    };
    let mut two = [&frame[0], other];
    two.sort_by_key(|row| row.line);
    let [first, second] = two;
    let what = format!(
        "has the time {} s in frame {}, line {} has {} s: split takes, or number their frames on",
        second.seconds, second.frame, first.line, first.seconds
    );
    Err(Error::data(Place::line(name, second.line), what))
}

/// The take: its frames in the order of their numbers or times, its points in that of the file.
fn take(
    name: &str,
    titles: LongTitles,
    seen: Seen,
    mut rows: Vec<Row>,
    cut: Option<String>,
) -> Result<MarkerTake> {
    rows.sort_by(|a, b| (a.frame.total_cmp(&b.frame)).then(a.point.cmp(&b.point)));
    let twice = rows
        .array_windows()
        .filter(|[a, b]| a.frame == b.frame && a.point == b.point);
    if let Some([a, b]) = twice.min_by_key(|[a, b]| a.line.max(b.line)) {
        let point = excerpt(&seen.names[a.point]);
        let (first, second) = (a.line.min(b.line), a.line.max(b.line));
        let what = format!(
            "has {point} of this frame a second time, after line {first}: split takes or people"
        );
        return Err(Error::data(Place::line(name, second), what));
    }
    let mut frames = MarkerRows::default();
    for frame in rows.chunk_by(|a, b| a.frame == b.frame) {
        check_time(name, frame)?;
        let mut values = vec![f64::NAN; 3 * (frame[frame.len() - 1].point + 1)];
        for row in frame {
            values[3 * row.point..][..3].copy_from_slice(&row.xyz);
        }
        let number = titles.frame.map(|_| frame[0].frame as u64);
        let seconds = titles.time.map(|_| frame[0].seconds.to_string());
        let pushed = frames.push_values(number, seconds.as_deref(), &values);
        pushed.map_err(|e| e.at(Place::line(name, frame[0].line)))?;
    }
    let mut notes: Vec<String> = cut.into_iter().collect();
    if !titles.others.is_empty() {
        let shown: Vec<String> = titles
            .others
            .iter()
            .take(8)
            .map(|title| excerpt(title))
            .collect();
        notes.push(format!(
            "its other columns are not converted: {}",
            shown.join(", ")
        ));
    }
    let units = one_unit(&titles.units).map_err(|e| e.at(Place::file(name)))?;
    let stated = Stated {
        labels: seen.names,
        units,
        has_times: titles.time.is_some(),
        notes,
        ..Stated::default()
    };
    let mut take = frames.take(name, stated, true, false)?;
    take.rate = take.times.as_deref().and_then(rate_of_times);
    Ok(take)
}
