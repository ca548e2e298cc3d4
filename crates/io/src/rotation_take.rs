//! A take with rotations: a BVH or an FBX file, or an AMC file with its ASF.

use super::asf::Asf;
use super::bvh::{Bvh, LARGEST_FILE};
use super::input::Input;
use super::motion_file::{MotionFile, ReadOptions, format_of, skeleton_of};
use super::motion_format::MotionFormat;
use super::{Amc, amc};
use crate::pose::UpAxis;
use crate::{Error, Place, Result};
use std::io::Cursor;
use std::path::Path;

/// A take with rotations, in centimeters.
pub struct RotationTake {
    /// Its hierarchy and motion; those of an AMC file by its bones' starts.
    pub bvh: Bvh,
    /// Frames per second.
    pub rate: f64,
    /// The axis that points up.
    pub up: UpAxis,
    /// Whether the file says that axis itself.
    pub says_up: bool,
    /// What was odd, a line each.
    pub notes: Vec<String>,
    /// The file's bytes, unpacked.
    pub bytes: Vec<u8>,
}

impl RotationTake {
    /// Reads a file, opened from `path`, beside which the skeleton of an AMC file is looked for.
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be read. [`Error::Data`]: it is damaged, of another format, or
    /// neither it nor an option says its rate.
    pub fn read(path: &Path, input: Input, options: &ReadOptions) -> Result<RotationTake> {
        let name = input.name.clone();
        let bad = |what: &str| Error::data(Place::file(&name), what);
        let bytes = input.read_all(LARGEST_FILE)?;
        let again = || Input::new(&name, Cursor::new(bytes.clone()));
        match format_of(&bytes) {
            MotionFormat::Bvh => {
                let mut bvh = Bvh::read(again()?, 1.0, options.keep_whole)?;
                let rate = bvh.rate_or(options.fps);
                Ok(RotationTake {
                    rate: rate.map_err(|e| e.at(Place::file(&name)))?,
                    up: options.up.unwrap_or(UpAxis::Y).handed(options.left_handed),
                    says_up: false,
                    notes: std::mem::take(&mut bvh.notes),
                    bvh,
                    bytes,
                })
            }
            MotionFormat::Amc => {
                let rate = options.fps.ok_or_else(|| bad(amc::NO_RATE))?;
                let asf = Asf::read(Input::open(skeleton_of(path, options)?)?, None)?;
                let (take, dropped) = Amc::read(again()?, &asf, options.keep_whole)?;
                let dropped =
                    dropped.map(|n| format!("{name}: dropped frame {n}, which is incomplete"));
                Ok(RotationTake {
                    bvh: take.to_bvh(rate)?,
                    rate,
                    up: UpAxis::Y,
                    says_up: false,
                    notes: dropped.into_iter().collect(),
                    bytes,
                })
            }
            MotionFormat::Fbx => {
                let file = MotionFile::read(path, bytes, options)?;
                let missing = || bad("has no rotations");
                let bvh = file.bvh().ok_or_else(missing)?;
                Ok(RotationTake {
                    rate: file.rate().or(bvh.rate()).ok_or_else(missing)?,
                    up: UpAxis::Y,
                    says_up: true,
                    notes: file.notes.iter().map(|n| format!("{name}: {n}")).collect(),
                    bvh: bvh.clone(),
                    bytes: file.to_bytes()?,
                })
            }
            MotionFormat::Asf => Err(bad("is a skeleton without motion")),
            other => Err(bad(&format!(
                "is a file of {} without rotations of joints; expected BVH, AMC or FBX",
                other.name()
            ))),
        }
    }
}
