//! `--held-is-missing`: rotations that were held count as missing.

use super::{MotionFile, Original};
use crate::Result;
use crate::audit::held_rotations;
use crate::io::Bvh;
use crate::io::bvh::{BvhPoints, BvhSkeleton};

impl MotionFile {
    /// Takes rotations of a BVH file that were held for missing ones, and the positions that follow from them; says which, and what
    /// it cannot do.
    ///
    /// # Errors
    /// None for a file that was read.
    pub fn empty_held(&mut self) -> Result<()> {
        let (angles, Some(rate)) = (self.joint_angles(), self.rate()) else {
            return Ok(());
        };
        let held = held_rotations(&angles, rate);
        let Original::Bvh(_, bvh) = &mut self.original else {
            if !held.is_empty() {
                let what = "held rotations stay: --held-is-missing fills BVH files alone";
                self.notes.push(what.to_string());
            }
            return Ok(());
        };
        let columns = rotation_columns(bvh);
        let last = bvh.motion.nrows();
        for held in held {
            let names: Vec<&str> = held.joints.iter().map(|&j| &*angles[j].joint).collect();
            let of = names.join(", ");
            if held.frames.start == 0 || held.frames.end == last {
                let what = "at an end of the take, where nothing leads a way: they stay";
                self.notes
                    .push(format!("held rotations of {of} are {what}"));
                continue;
            }
            let missing = held.frames.start + 1..held.frames.end;
            let columns = held.joints.iter().flat_map(|&j| &columns[j]);
            for &column in columns {
                let mut values = bvh.motion.column_mut(column);
                missing.clone().for_each(|t| values[t] = f64::NAN);
                self.held.extend(missing.clone().map(|t| (t, column)));
            }
            self.notes.push(format!(
                "held rotations of {of} in frames {} to {} count as missing",
                missing.start,
                missing.end - 1
            ));
        }
        let skeleton = BvhSkeleton::new(&bvh.joints, self.units.up.rotation(), true)?;
        let poses = bvh.positions(&skeleton, BvhPoints::Origins, rate);
        self.table.poses.xyz = poses.xyz;
        Ok(())
    }
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
