//! New files of markers from a take.

use super::c3d::NewC3d;
use super::trc::NewTrc;
use crate::Result;
use crate::pose::one_take::first_frame_number;
use crate::pose::{Poses, Units, UpAxis};

/// What a new file says of a take.
///
/// ```
/// use ndarray::array;
/// use posing_core::pose::{LengthUnit, Poses, UpAxis, Units};
/// use posing_io::{C3d, Input, NewTake};
///
/// let (points, xyz) = (vec!["hand".into()], array![[1.0, 2.0, 3.0]]);
/// let poses = Poses { points, xyz, ..Poses::default() };
/// let units = Units { unit: LengthUnit::Mm, up: UpAxis::Z };
/// let bytes = NewTake::new(poses, 100.0, units).c3d()?;
/// let file = C3d::read(Input::new("hand.c3d", std::io::Cursor::new(bytes))?, false)?;
/// assert_eq!(file.take.xyz, array![[10.0, -30.0, 20.0]]); // millimeters, z up
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug)]
pub struct NewTake {
    /// The frames, in the unit and axes of the file.
    pub poses: Poses,
    /// Frames a second.
    pub rate: f64,
    /// The number of the first frame, from 1.
    pub first_frame: u32,
    units: Units,
}

impl NewTake {
    /// The take `poses` (cm, y up) for a file in `units`.
    pub fn new(mut poses: Poses, rate: f64, units: Units) -> NewTake {
        let number = first_frame_number(&poses, Some(rate));
        units.write_frames(&mut poses.xyz);
        NewTake {
            poses,
            rate,
            first_frame: u32::try_from(number).unwrap_or(1).max(1),
            units,
        }
    }

    /// The bytes of a C3D file.
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: no points or frames, or more than the format counts.
    pub fn c3d(&self) -> Result<Vec<u8>> {
        let axis = self.units.up.handed(false);
        let name = axis.name().to_uppercase();
        let up = if name.starts_with('-') {
            name
        } else {
            format!("+{name}")
        };
        let right = match axis {
            UpAxis::X | UpAxis::MinusX => "+Y",
            _ => "+X",
        };
        NewC3d {
            points: &self.poses.points,
            rate: self.rate,
            first_frame: self.first_frame,
            units: self.units.unit.name(),
            screen: [right, &up],
        }
        .bytes(self.poses.xyz.view())
    }

    /// The bytes of a TRC file.
    ///
    /// ```
    /// use posing_core::pose::{Poses, Units};
    /// use posing_io::NewTake;
    ///
    /// let (points, xyz) = (vec!["hand".into()], ndarray::array![[1.0, 2.0, 3.0]]);
    /// let poses = Poses { points, xyz, ..Poses::default() };
    /// let trc = String::from_utf8(NewTake::new(poses, 50.0, Units::CM_Y).trc()?)?;
    /// assert!(trc.starts_with("PathFileType"));
    /// assert_eq!(trc.lines().last(), Some("1\t0\t1\t2\t3\t"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: no points or frames, or a name that the format cannot hold.
    pub fn trc(&self) -> Result<Vec<u8>> {
        let name = self.poses.take.as_ref().and_then(|names| names.first());
        NewTrc {
            name: &format!("{}.trc", name.map_or("take", |n| &**n)),
            points: &self.poses.points,
            rate: self.rate,
            first_frame: self.first_frame,
            times: self.times(),
            units: self.units.unit.name(),
        }
        .bytes(self.poses.xyz.view())
    }

    /// The times of the frames, where they ascend.
    fn times(&self) -> Option<&[f64]> {
        let times = self.poses.time.as_deref()?;
        let ascend = times.windows(2).all(|pair| pair[0] < pair[1]);
        ascend.then_some(times)
    }
}
