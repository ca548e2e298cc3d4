//! A take of an FBX file as the BVH file that it becomes.

use super::{MotionFile, ReadOptions, Source, of_bvh, read_as};
use crate::bvh::Bvh;
use crate::fbx;
use crate::input::Input;
use crate::motion_format::MotionFormat;
use crate::pose::Units;
use crate::{Error, Place, Result};
use bytes::Bytes;
use posing_fbx::FbxChoice;
use std::io::Cursor;
use std::path::Path;

/// The file, whose way back is into BVH.
///
/// # Errors
/// [`Error::Data`]: it is damaged, too large, or has no take, or several of which none is chosen.
pub(super) fn of_fbx(path: &Path, input: Input, options: &ReadOptions) -> Result<MotionFile> {
    let name = input.name.clone();
    let fbx = fbx::read(input)?;
    let choice = FbxChoice {
        take: options.take.clone(),
        skeleton: options.skeleton.clone(),
    };
    let take = fbx.take(&choice)?;
    // The rate is the file's, unless it has none that can be meant.
    let motion = fbx.motion(&take, None);
    let motion = motion.or_else(|e| match options.fps {
        Some(fps) => fbx.motion(&take, Some(fps)),
        None => Err(e),
    })?;
    let made = fbx::to_bvh(&motion);
    let bytes = Bytes::from(made.to_bytes(1.0));
    let bvh = Bvh::read(Input::new(name, Cursor::new(bytes.clone()))?, 1.0, false)?;
    let mut file = of_bvh(path, bvh, bytes, Units::CM_Y, options)?;
    file.format = MotionFormat::Fbx;
    file.read_as = read_as(file.read_as.rate, Units::CM_Y, [Source::File; 2]);
    file.notes
        .splice(0..0, motion.notes.into_iter().chain(made.notes));
    Ok(file)
}

/// The hierarchy of an FBX file's skeleton in its rest pose, as the text of a BVH file with one
/// frame; and what was odd. It needs no animation.
///
/// # Errors
/// [`Error::Data`]: it is damaged, too large, or has no skeleton, or several of which none is
/// chosen.
#[doc(hidden)]
pub fn rig_of_fbx(
    name: &str,
    bytes: Vec<u8>,
    skeleton: Option<&str>,
) -> Result<(Vec<u8>, Vec<String>)> {
    let motion = fbx::read(Input::new(name, Cursor::new(bytes))?)?.rest(skeleton)?;
    if motion.positions.iter().any(|v| v.is_nan()) {
        let what = "its rest pose has values that are no numbers";
        return Err(Error::data(Place::file(name), what));
    }
    let rig = fbx::to_bvh(&motion);
    let notes = motion.notes.into_iter().chain(rig.notes.iter().cloned());
    Ok((rig.to_bytes(1.0), notes.collect()))
}
