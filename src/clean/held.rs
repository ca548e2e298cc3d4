//! Rotations that were held, as missing ones.

use crate::Result;
use crate::audit::held_rotations;
use crate::io::{Bvh, MotionFile};

/// Takes rotations of a BVH file that were held for missing ones, and the positions that follow
/// from them; notes say which, and what cannot be done.
///
/// # Errors
/// None for a file that was read.
pub(crate) fn empty_held(file: &mut MotionFile) -> Result<()> {
    let (angles, Some(rate)) = (file.joint_angles(), file.rate()) else {
        return Ok(());
    };
    let held = held_rotations(&angles, rate);
    let Some(bvh) = file.bvh() else {
        if !held.is_empty() {
            let what = "held rotations stay: only in BVH files are they filled";
            file.notes.push(what.to_string());
        }
        return Ok(());
    };
    let columns = rotation_columns(bvh);
    let last = bvh.motion.nrows();
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
        let columns = held.joints.iter().flat_map(|&j| &columns[j]);
        missing.extend(columns.flat_map(|&c| frames.clone().map(move |t| (t, c))));
        file.notes.push(format!(
            "held rotations of {of} in frames {} to {} count as missing",
            frames.start,
            frames.end - 1
        ));
    }
    file.empty_channels(&missing)
}

/// The columns of the rotations of each joint that has some.
fn rotation_columns(bvh: &Bvh) -> Vec<Vec<usize>> {
    let mut first = 0;
    let mut out = Vec::with_capacity(bvh.joints.len());
    for joint in &bvh.joints {
        let channels = joint.channels.iter().enumerate();
        let angles = channels.filter(|(_, channel)| channel.is_angle());
        let columns: Vec<usize> = angles.map(|(c, _)| first + c).collect();
        out.extend(Some(columns).filter(|c| !c.is_empty()));
        first += joint.channels.len();
    }
    out
}
