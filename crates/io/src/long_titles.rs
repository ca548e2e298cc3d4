//! The titles of a long table: a frame or a time, a point, x, y and z, in any order.

use super::point_titles::{add_unit, axis_of, is_frame, seconds_of, separator_of, without_unit};
use super::row_cells::texts_of;

const POINTS: [&str; 8] = [
    "point", "marker", "joint", "name", "keypoint", "landmark", "bodypart", "label",
];
const TAKES: [&str; 2] = ["take", "trial"];
const PEOPLE: [&str; 4] = ["person", "subject", "individual", "actor"];

/// What the columns of a long table are.
#[derive(Debug, PartialEq)]
pub(crate) struct LongTitles {
    pub separator: u8,
    pub width: usize,
    pub frame: Option<usize>,
    /// The column of the time, and the seconds of its unit.
    pub time: Option<(usize, f64)>,
    pub person: Option<usize>,
    /// The column that tells takes apart.
    pub take: Option<usize>,
    pub point: usize,
    pub xyz: [usize; 3],
    /// The units that stand with x, y and z, each once.
    pub units: Vec<String>,
    /// The titles of the other columns.
    pub others: Vec<String>,
}

impl LongTitles {
    /// Reads the first row; `None`: it is none of a long table.
    pub(crate) fn read(line: &str) -> Option<LongTitles> {
        let separator = separator_of(line)?.byte()?;
        let titles = texts_of(line, separator);
        let at = |is: &dyn Fn(&str) -> bool| titles.iter().position(|title| is(title));
        let of = |words: &'static [&str]| {
            at(&|title| {
                let plain = title.to_ascii_lowercase().replace("_name", "");
                let plain = plain.strip_suffix('s').unwrap_or(&plain);
                words.contains(&plain)
            })
        };
        let axis = |axis| at(&|title| axis_of(without_unit(title).0) == Some(axis));
        let time = at(&|title| seconds_of(title).is_some());
        let out = LongTitles {
            separator,
            width: titles.len(),
            frame: at(&|title| is_frame(title) && !title.eq_ignore_ascii_case("index")),
            time: time.and_then(|at| Some((at, seconds_of(&titles[at])?))),
            person: of(&PEOPLE),
            take: of(&TAKES),
            point: of(&POINTS)?,
            xyz: [axis(0)?, axis(1)?, axis(2)?],
            units: Vec::new(),
            others: Vec::new(),
        };
        out.frame.or(out.time.map(|(at, _)| at))?;
        let own = [out.frame, time, out.person, Some(out.point)];
        let is_own = |c: usize| own.contains(&Some(c)) || out.xyz.contains(&c);
        let others = titles.iter().enumerate().filter(|(c, _)| !is_own(*c));
        let others = others.map(|(_, title)| title.to_string());
        let mut units = Vec::new();
        let stated = out.xyz.iter().filter_map(|&c| without_unit(&titles[c]).1);
        stated.for_each(|unit| add_unit(&mut units, unit));
        Some(LongTitles {
            units,
            others: others.filter(|title| !title.is_empty()).collect(),
            ..out
        })
    }
}
