//! Files of rotations with other frames or another rate.

use super::{MotionFile, Original};
use crate::amc::{AmcMotion, NO_RATE};
use crate::bvh::Bvh;
use crate::pose::{Retiming, resampled_motion, without_jumps};
use crate::{Error, Place, Result};
use ndarray::{Array2, s};
use std::ops::Range;

impl MotionFile {
    /// The bytes of a file of rotations with some of its frames, counted from 0, and of a BVH file
    /// with another rate, where one is given. No value is touched: each frame's own text stays.
    ///
    /// ```
    /// use posing_io::{MotionFile, motion_file::ReadOptions};
    ///
    /// let file = "../../testdata/examples/animator/goblin.bvh";
    /// let file = MotionFile::open(file, &ReadOptions::default())?;
    /// let bytes = file.bytes_of_frames(0..1, Some(60.0))?;
    /// let part = MotionFile::from_bytes("part.bvh", bytes, &ReadOptions::default())?;
    /// assert_eq!((part.poses().frames(), part.rate()), (1, Some(60.0)));
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: it has no rotations, or a rate is given and it is no BVH file.
    pub fn bytes_of_frames(&self, frames: Range<usize>, rate: Option<f64>) -> Result<Vec<u8>> {
        match &self.original {
            Original::Bvh(bytes, bvh) => bvh.with_frames(bytes, frames, rate.map(|f| 1.0 / f)),
            Original::Amc(..) if rate.is_some() => Err(self.unfit(NO_RATE)),
            Original::Amc(bytes, ..) => Ok(AmcMotion::with_frames(bytes, frames)),
            _ => Err(self.unfit(NO_ROTATIONS)),
        }
    }

    /// The bytes of a file of rotations with some of its frames, like
    /// [`MotionFile::bytes_of_frames`], but that no angle jumps by more than half a turn: one that
    /// does gets whole turns ([`without_jumps`]). How many values are other ones.
    ///
    /// # Errors
    /// Those of [`MotionFile::bytes_of_frames`].
    pub fn bytes_of_part(
        &self,
        frames: Range<usize>,
        rate: Option<f64>,
    ) -> Result<(Vec<u8>, usize)> {
        let motion = self.motion().ok_or_else(|| self.unfit(NO_ROTATIONS))?;
        let part = motion.slice(s![frames.clone(), ..]);
        let mut new = motion.to_owned();
        new.slice_mut(s![frames.clone(), ..])
            .assign(&without_jumps(part, &self.channels()));
        let is_other = |(a, b): (&f64, &f64)| a.to_bits() != b.to_bits();
        let others = new
            .iter()
            .zip(&motion)
            .filter(|pair| is_other(*pair))
            .count();
        if others == 0 {
            return Ok((self.bytes_of_frames(frames, rate)?, 0));
        }
        let bytes = self.bytes_with_motion(new.view())?;
        let of_frames = match &self.original {
            Original::Bvh(_, bvh) => bvh.with_frames(&bytes, frames, rate.map(|f| 1.0 / f))?,
            _ => AmcMotion::with_frames(&bytes, frames),
        };
        Ok((of_frames, others))
    }

    /// The bytes of a file of rotations with some of its frames at other times (counted in frames
    /// from the first of these) and at another rate, where one is given: each joint's rotation as a
    /// rotation, see [`resampled_motion`]. The hierarchy of a BVH file stays byte for byte; the
    /// numbers of an AMC file's frames are those of times from `start` on, seconds.
    ///
    /// # Errors
    /// [`Error::Data`]: it has no rotations.
    pub fn bytes_at_times(
        &self,
        frames: Range<usize>,
        timing: &Retiming,
        rate: Option<f64>,
        start: f64,
    ) -> Result<Vec<u8>> {
        let motion = self.motion().ok_or_else(|| self.unfit(NO_ROTATIONS))?;
        let chosen = motion.slice(s![frames.clone(), ..]);
        let new = resampled_motion(chosen, &self.channels(), timing);
        self.bytes_of_motion(new, rate, start)
    }

    /// The bytes of a file of rotations with another motion, which begins at `start`.
    fn bytes_of_motion(
        &self,
        motion: Array2<f64>,
        rate: Option<f64>,
        start: f64,
    ) -> Result<Vec<u8>> {
        match &self.original {
            Original::Bvh(bytes, bvh) => {
                let new = Bvh {
                    joints: bvh.joints.clone(),
                    frame_time: rate.map_or(bvh.frame_time, |f| 1.0 / f),
                    motion,
                    notes: Vec::new(),
                };
                new.with_hierarchy_of(bytes, self.units.unit.centimeters())
            }
            Original::Amc(_, amc, _) => {
                let rate = rate.or(self.rate()).unwrap_or(1.0);
                Ok(amc.with_values((start * rate).round() as u64 + 1, motion.view()))
            }
            _ => Err(self.unfit(NO_ROTATIONS)),
        }
    }

    fn unfit(&self, what: &str) -> Error {
        Error::data(Place::file(&self.table.name), what)
    }
}

/// Why a file of points has no such bytes.
pub(super) const NO_ROTATIONS: &str = "has no rotations: it is no BVH or AMC file";
