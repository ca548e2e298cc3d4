//! Tables of markers of other programs, known by their first lines: Motive's CSV, Qualisys' TSV,
//! Vicon Nexus' CSV, and tables whose titles are NAME_x, NAME_y, NAME_z or names above x, y, z.

mod long_table;
mod motive;
mod nexus;
pub(crate) mod point_table;
mod qualisys;
mod qualisys_6d;
mod qualisys_head;
mod tracker;

pub use motive::MotivePoints;

use super::input::Input;
use super::marker_take::MarkerTake;
use super::motion_format::{MotionFormat, recognized};
use super::text::Lines;
use super::text_start::{TextStart, no_positions, of_lines, too_long};
use crate::{Error, Place, Result};

/// Reads a file. `points` are what a Motive file's points shall be, instead of the first kind that
/// it has. With `keep_whole`, a file that ends early gives the frames that it has.
///
/// # Errors
/// [`Error::Data`]: it is of no known format, has no points or frames, ends early, or a cell is no
/// number. [`Error::Io`]: reading
/// fails.
pub fn read(
    mut input: Input,
    points: Option<MotivePoints>,
    keep_whole: bool,
) -> Result<MarkerTake> {
    input.look_ahead()?;
    let name = input.name.clone();
    let format = MotionFormat::of(input.first_bytes());
    let other = recognized(input.first_bytes());
    if points.is_some() && format != MotionFormat::MotiveCsv {
        let what = format!(
            "is no Motive CSV file but {}: leave the option `points` out",
            format.name()
        );
        return Err(Error::data(Place::file(name), what));
    }
    let is_pose_table = of_lines(input.first_bytes()) == Some(TextStart::PoseTable);
    let no_positions = no_positions(input.first_bytes());
    let is_empty = input.first_bytes().is_empty();
    let too_long = too_long(input.first_bytes());
    let mut lines = Lines::new(&name, input.into_reader());
    let first = |lines: &mut Lines<_>| -> Result<String> {
        Ok(lines.next_line()?.unwrap_or_default().to_string())
    };
    match format {
        MotionFormat::MotiveCsv => motive::read(&first(&mut lines)?, lines, points, keep_whole),
        MotionFormat::QualisysTsv => qualisys::read(&first(&mut lines)?, lines, keep_whole),
        MotionFormat::NexusCsv => nexus::read(lines, keep_whole),
        MotionFormat::LongTable => long_table::read(lines, keep_whole),
        MotionFormat::PointTable => point_table::read(lines, keep_whole),
        // Another program's table may have a pose table's titles, but not its unit and axis.
        MotionFormat::Csv if is_pose_table => point_table::read(lines, keep_whole),
        MotionFormat::Csv if is_empty => Err(Error::data(
            Place::file(name),
            "is empty, expected a table of markers",
        )),
        MotionFormat::Csv if let Some(others) = no_positions => Err(Error::data(
            Place::file(name),
            format!(
                "has no positions: by their titles {others} are angles, velocities, forces, \
                 scales or the like; give markers another name"
            ),
        )),
        MotionFormat::Csv => {
            let known = "is neither a Motive CSV file (it begins with Format Version), a Qualisys \
                         TSV file (NO_OF_FRAMES or FILE_VERSION), a Vicon CSV file (Trajectories, \
                         Objects), an OpenSim file (a line endheader), an NPY array nor an NPZ \
                         archive, and has no columns of positions NAME_x, NAME_y, NAME_z";
            let what = other.map(str::to_string).or(too_long);
            Err(Error::data(
                Place::file(name),
                what.unwrap_or(known.to_string()),
            ))
        }
        _ => Err(Error::data(
            Place::file(name),
            other.unwrap_or("is no table of markers"),
        )),
    }
}

#[cfg(test)]
mod tests;
