//! A skeleton read from an ASF, a BVH or an FBX file.

use super::asf::Asf;
use super::bvh::{Bvh, BvhTemplate};
use super::input::Input;
use super::motion_file::rig_of_fbx;
use super::motion_format::MotionFormat;
use crate::Result;
use glam::DMat3;
use std::io::Cursor;

/// Larger files are refused.
const MAX_BYTES: u64 = 2 << 30;

/// A skeleton file, of the format that its content has.
pub enum SkeletonFile {
    /// Acclaim skeleton.
    Asf(Asf),
    /// The hierarchy of a BVH file.
    Bvh(Box<BvhTemplate>),
}

impl SkeletonFile {
    /// Reads an ASF, a BVH or an FBX file; the notes of the reader. `unit` (centimeters) and `turn`
    /// (from the file's axes to ours) are those of a BVH; others state their own.
    ///
    /// # Errors
    /// Those of [`Asf::open`] and [`Bvh::open`].
    pub fn read(input: Input, unit: f64, turn: DMat3) -> Result<(SkeletonFile, Vec<String>)> {
        let name = input.name.clone();
        let bytes = input.read_all(MAX_BYTES)?;
        if MotionFormat::of(&bytes) == MotionFormat::Fbx {
            let (rig, notes) = rig_of_fbx(&name, bytes, None)?;
            let rig = Bvh::from_bytes(&name, rig)?;
            let notes = notes.iter().map(|note| format!("{name}: {note}")).collect();
            let template = BvhTemplate::new(rig, DMat3::IDENTITY)?;
            return Ok((SkeletonFile::Bvh(Box::new(template)), notes));
        }
        let start = String::from_utf8_lossy(&bytes[..bytes.len().min(100)]).to_ascii_uppercase();
        let start = start.trim_start_matches('\u{feff}').trim_start();
        let is_bvh = start.starts_with("HIERARCHY");
        let input = Input::new(name, Cursor::new(bytes))?;
        if !is_bvh {
            return Ok((SkeletonFile::Asf(Asf::read(input, None)?), Vec::new()));
        }
        let mut bvh = Bvh::read(input, unit, true)?;
        let notes = std::mem::take(&mut bvh.notes);
        let template = BvhTemplate::new(bvh, turn)?;
        Ok((SkeletonFile::Bvh(Box::new(template)), notes))
    }
}
