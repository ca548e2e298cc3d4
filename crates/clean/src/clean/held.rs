//! Rotations that were held, as missing ones.

use crate::Result;
use crate::audit::{HeldRotations, held_rotations};
use crate::io::MotionFile;
use std::ops::Range;

/// The joints of a file whose rotations were held, by their index among its channels, and the
/// frames: none where the file has no rate.
pub(crate) fn held_of(file: &MotionFile) -> Vec<(usize, Range<usize>)> {
    let held = file.rate().map_or(Vec::new(), |rate| {
        held_rotations(&file.joint_angles(), rate)
    });
    let channels = file.channels();
    let turning = (0..channels.len()).filter(|j| !channels[*j].angles.is_empty());
    let turning: Vec<usize> = turning.collect();
    let of = |held: HeldRotations| {
        let joints = held
            .joints
            .into_iter()
            .filter_map(|j| turning.get(j).copied());
        joints
            .map(move |joint| (joint, held.frames.clone()))
            .collect::<Vec<_>>()
    };
    held.into_iter().flat_map(of).collect()
}

/// Takes rotations that were held for missing ones, and the positions that follow from them; notes
/// say which, and what cannot be done.
///
/// # Errors
/// None for a file that was read.
pub(crate) fn empty_held(file: &mut MotionFile) -> Result<()> {
    let (angles, Some(rate)) = (file.joint_angles(), file.rate()) else {
        return Ok(());
    };
    let held = held_rotations(&angles, rate);
    let mut channels = file.channels();
    channels.retain(|joint| !joint.angles.is_empty());
    let last = file.table.poses.frames();
    let mut missing = Vec::new();
    for held in held {
        let names: Vec<&str> = held.joints.iter().map(|&j| &*angles[j].joint).collect();
        let of = names.join(", ");
        if held.frames.start == 0 || held.frames.end == last {
            let what = "at an end of the take, where nothing leads a way: they stay";
            file.notes
                .push(format!("held rotations of {of} are {what}"));
            continue;
        }
        let frames = held.frames.start + 1..held.frames.end;
        let columns = held.joints.iter().flat_map(|&j| &channels[j].angles);
        missing.extend(columns.flat_map(|&(c, _)| frames.clone().map(move |t| (t, c))));
        file.notes.push(format!(
            "held rotations of {of} in frames {} to {} count as missing",
            frames.start,
            frames.end - 1
        ));
    }
    file.empty_channels(&missing)
}
