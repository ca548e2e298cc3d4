//! The bones between the points of a file of motion.

use super::{MotionFile, Original};
use crate::Result;
use crate::cli::plot::{bones, bones_of};
use crate::io::bvh::{BvhPoints, BvhSkeleton};

impl MotionFile {
    /// The pairs of points to join in a picture: those of the file's skeleton, else by the points' names.
    ///
    /// # Errors
    /// [`crate::Error::Data`]: the joints are no tree.
    pub fn bones(&self) -> Result<Vec<(usize, usize)>> {
        match &self.original {
            Original::Bvh(_, bvh) => {
                let skeleton = BvhSkeleton::new(&bvh.joints, self.units.up.rotation(), true)?;
                Ok(bones_of(&skeleton, BvhPoints::Origins))
            }
            _ => bones(None, &self.table.poses.points),
        }
    }
}
