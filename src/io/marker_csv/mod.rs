//! Tables of markers of other programs, known by their first lines: Motive's CSV and Qualisys' TSV.

mod motive;
mod qualisys;

pub use motive::MotivePoints;

use super::input::Input;
use super::marker_take::MarkerTake;
use super::motion_format::recognized;
use super::text::Lines;
use crate::{Error, Place, Result};

/// Reads a file. `points` are what a Motive file's points shall be, instead of the first kind that it has. With `keep_whole`, a file
/// that ends early gives the frames that it has.
///
/// # Errors
/// [`Error::Data`]: it is of no known format, has no points or frames, ends early, or a cell is no number. [`Error::Io`]: reading
/// fails.
pub fn read(input: Input, points: Option<MotivePoints>, keep_whole: bool) -> Result<MarkerTake> {
    let name = input.name.clone();
    let other = recognized(input.first_bytes());
    let mut lines = Lines::new(&name, input.into_reader());
    let first = lines.next_line()?.map(str::to_string);
    let what = match first.as_deref() {
        Some(line) if line.starts_with("Format Version") => {
            return motive::read(line, lines, points, keep_whole);
        }
        Some(line) if qualisys::is_header(line) && points.is_none() => {
            return qualisys::read(line, lines, keep_whole);
        }
        Some(line) if qualisys::is_header(line) => {
            "is a Qualisys TSV file, which has markers alone; leave --points out"
        }
        Some(_) => other.unwrap_or(
            "is neither a Motive CSV file (it begins with Format Version) nor a Qualisys TSV file (NO_OF_FRAMES or FILE_VERSION)",
        ),
        None => "is empty, expected a Motive CSV or a Qualisys TSV file",
    };
    Err(Error::data(Place::file(name), what))
}
