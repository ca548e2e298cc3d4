//! Files of any format on their floor: see [`ik::ground`](crate::ik::ground).

use crate::ik::ground::{GroundOptions, GroundReport, ground_points, ground_rotations};
use crate::ik::retarget::up_axis;
use crate::io::bvh::Bvh;
use crate::io::motion_file::{LARGEST_MOTION_FILE, MotionFile, ReadOptions, ReadRules, format_of};
use crate::io::rotation_take::RotationTake;
use crate::io::{Input, MotionFormat};
use crate::pose::NameMap;
use crate::{Error, Place, Result};
use std::io::Cursor;
use std::path::Path;

/// A file's take on its floor.
#[derive(Debug, Clone)]
pub struct GroundedFile {
    /// The bytes of a file: BVH where the take has rotations, else one of its own format. Those of
    /// the file itself where nothing moves.
    pub bytes: Vec<u8>,
    /// What was found and done.
    pub report: GroundReport,
    /// What was odd, a line each.
    pub notes: Vec<String>,
}

/// Puts the take of a file, opened from `path`, on its floor; `map`: the names of its joints;
/// `holds_feet`: whether feet are held where they stand. Feet of takes of points never are.
///
/// # Errors
/// [`Error::Data`]: it is damaged, has several takes, or nothing tells its feet; else those of
/// [`ground_rotations`].
pub fn ground_file(
    path: &Path,
    input: Input,
    read: &ReadRules,
    map: Option<&NameMap>,
    holds_feet: bool,
) -> Result<GroundedFile> {
    let name = input.name.clone();
    let bytes = input.read_all(LARGEST_MOTION_FILE)?;
    let format = format_of(&bytes);
    let read = &read.of(path, format);
    let done = match format {
        MotionFormat::Bvh | MotionFormat::Fbx | MotionFormat::Amc => {
            let take = Input::new(&name, Cursor::new(bytes))?;
            let take = RotationTake::read(path, take, read)?;
            of_rotations(take, &name, read, map, holds_feet)
        }
        _ => {
            let file = MotionFile::read(path, bytes.clone(), read)?;
            of_points(&file, bytes, &name, holds_feet)
        }
    };
    done.map_err(|e| e.at(Place::file(&name)))
}

fn of_rotations(
    take: RotationTake,
    name: &str,
    read: &ReadOptions,
    map: Option<&NameMap>,
    holds_feet: bool,
) -> Result<GroundedFile> {
    let mut notes = take.notes;
    let said = read.up.is_some() || take.says_up;
    let own = if said {
        None
    } else {
        up_axis(&take.bvh, map).filter(|up| *up != take.up)
    };
    if let Some(up) = own {
        let up = up.name();
        notes.push(format!(
            "{name}: the figure stands along {up}, which is taken for up; the option `up` says \
             otherwise"
        ));
    }
    let options = GroundOptions {
        up: own.unwrap_or(take.up),
        rate: Some(take.rate),
        map,
        holds_feet,
    };
    let done = ground_rotations(&take.bvh, &options)?;
    let motion = done.take;
    let bytes = if format_of(&take.bytes) == MotionFormat::Bvh {
        take.bvh.with_motion(&take.bytes, motion.view(), 1.0)?
    } else {
        Bvh { motion, ..take.bvh }.to_bytes(1.0)
    };
    let report = done.report;
    Ok(GroundedFile {
        bytes,
        report,
        notes,
    })
}

fn of_points(
    file: &MotionFile,
    original: Vec<u8>,
    name: &str,
    holds_feet: bool,
) -> Result<GroundedFile> {
    let poses = file.poses();
    let takes = poses.take.as_deref().unwrap_or_default();
    if takes.windows(2).any(|two| two[0] != two[1]) {
        return Err(Error::unfit("has several takes: choose one with trim"));
    }
    let rate = file.rate().ok_or_else(|| {
        Error::unfit("has no rate; give the frames per second with the option `fps`")
    })?;
    let done = ground_points(poses, rate)?;
    let mut notes: Vec<String> = file.notes.iter().map(|n| format!("{name}: {n}")).collect();
    let (bytes, left) = if done.report.leveled {
        file.bytes_with_points(done.take.view())?
    } else {
        (original, 0)
    };
    if left > 0 {
        notes.push(format!(
            "{name}: the format does not hold {left} positions, which stay"
        ));
    }
    if holds_feet {
        notes.push(format!(
            "{name}: a take of points is leveled alone; feet are held in takes with rotations"
        ));
    }
    let report = done.report;
    Ok(GroundedFile {
        bytes,
        report,
        notes,
    })
}
