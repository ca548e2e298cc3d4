//! The way back into the file's own format, or into a table.

use super::{MotionFile, Original};
use crate::marker_take::MarkerTake;
use crate::motion_format::MotionFormat;
use crate::output::{Output, write_file};
use crate::pose::Units;
use crate::table_writer::TableFormat;
use crate::unit_writer::UnitWriter;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2};
use std::path::Path;

impl MotionFile {
    /// Writes the file anew, in its own format and with all that it says, with its points at `xyz`
    /// (frames, 3 P; centimeters, y up). A file of rotations (BVH, AMC) is
    /// written as it was read. Returns how many positions are outside of the numbers that the
    /// format holds; they stay as they were.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails. [`Error::Data`]: another shape, or the format does not hold
    /// the new values.
    pub fn write_back(&self, path: impl AsRef<Path>, xyz: ArrayView2<'_, f64>) -> Result<usize> {
        if let Original::Table = self.original {
            let format = self.table_format();
            return self.write_table(path.as_ref(), format, xyz).map(|()| 0);
        }
        let (bytes, left) = self.bytes_with_points(xyz)?;
        write_file(path, &bytes).map(|()| left)
    }

    /// The bytes that [`MotionFile::write_back`] writes, unpacked, and how many positions they do
    /// not hold. A file of rotations (BVH, AMC) is as it was read, whatever the positions: see
    /// [`MotionFile::bytes_with_motion`].
    ///
    /// # Errors
    /// [`Error::Data`]: another shape, or the format does not hold the new values.
    pub fn bytes_with_points(&self, xyz: ArrayView2<'_, f64>) -> Result<(Vec<u8>, usize)> {
        let mut left = 0;
        self.check_shape(xyz)?;
        let bytes = match &self.original {
            Original::C3d(c3d) => {
                let holds = |point| {
                    let holds = c3d.holds(point);
                    left += usize::from(!holds);
                    holds
                };
                c3d.with_points(self.in_file(&c3d.take, xyz, holds).view())?
            }
            Original::Text(bytes, take) => {
                let new = self.in_file(take, xyz, |_| true);
                take.cells.with_points(bytes, take.xyz.view(), new.view())
            }
            Original::Npz(npz) => {
                let new = self.in_file(&npz.take, xyz, |_| true);
                npz.with_points(new.view())?
            }
            Original::Bvh(bytes, _) | Original::Amc(bytes, ..) => bytes.to_vec(),
            Original::Table => {
                let (output, written) = Output::memory(&self.table.name);
                self.write_table_to(output, self.table_format(), xyz)?;
                written.into_bytes()
            }
        };
        Ok((bytes, left))
    }

    /// The bytes of the file as it stands, unpacked: its labels as they were moved, all else as it
    /// was read. Pose tables are written anew.
    ///
    /// # Errors
    /// [`Error::Data`]: the format does not hold its values.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        Ok(self.bytes_with_points(self.table.poses.xyz.view())?.0)
    }

    /// Writes a file of rotations with those values of `motion` (frames, channels; centimeters,
    /// radians) that are new and no NaN; every other byte of the file stays.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails. [`Error::Data`]: it has no rotations.
    #[doc(hidden)]
    pub fn write_channels(&self, path: &Path, motion: ArrayView2<'_, f64>) -> Result<()> {
        write_file(path, &self.bytes_with_motion(motion)?)
    }

    /// The bytes of a file of rotations with those values of `motion` (frames, channels;
    /// centimeters, radians) that are new and no NaN; every other byte of the file stays.
    ///
    /// # Errors
    /// [`Error::Data`]: it has no rotations.
    pub fn bytes_with_motion(&self, motion: ArrayView2<'_, f64>) -> Result<Vec<u8>> {
        match &self.original {
            Original::Bvh(bytes, bvh) => {
                bvh.with_motion(bytes, motion, self.units.unit.centimeters())
            }
            Original::Amc(bytes, amc, _) => Ok(amc.rewritten(bytes, motion)),
            _ => {
                let what = super::retimed::NO_ROTATIONS;
                Err(Error::data(Place::file(&self.table.name), what))
            }
        }
    }

    /// Writes its points as a pose table, with them at `xyz`: of a table in its units, else in
    /// centimeters, y up.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails. [`Error::Data`]: another shape.
    #[doc(hidden)]
    pub fn write_table(
        &self,
        path: &Path,
        format: TableFormat,
        xyz: ArrayView2<'_, f64>,
    ) -> Result<()> {
        self.check_shape(xyz)?;
        self.write_table_to(Output::file(path)?, format, xyz)
    }

    fn write_table_to(
        &self,
        output: Output,
        format: TableFormat,
        xyz: ArrayView2<'_, f64>,
    ) -> Result<()> {
        let units = match self.original {
            Original::Table => self.units,
            _ => Units::CM_Y,
        };
        let carried = match (&self.original, format) {
            (Original::Text(_, take), TableFormat::Csv) => Some(take.carried_rows()),
            _ => None,
        };
        let added = carried.as_ref().map_or(Vec::new(), |c| c.columns());
        let (table, xyz) = (self.whole_table(), self.whole(xyz));
        UnitWriter::new(output, format, [units, units], &table.columns, &added)?.write_table(
            table,
            xyz.view(),
            |frame| carried.as_ref().map_or(Vec::new(), |c| c.cells(frame)),
        )
    }

    /// The format of a file that is a table.
    pub(super) fn table_format(&self) -> TableFormat {
        match self.format {
            MotionFormat::Npy => TableFormat::Npy,
            MotionFormat::Npz => TableFormat::Npz,
            _ => TableFormat::Csv,
        }
    }

    /// Fails where positions are not those of the file's frames and points.
    fn check_shape(&self, xyz: ArrayView2<'_, f64>) -> Result<()> {
        let own = self.table.poses.xyz.dim();
        if xyz.dim() == own {
            return Ok(());
        }
        let size = |(frames, columns): (usize, usize)| format!("{frames} x {}", columns / 3);
        let (own, given) = (size(own), size(xyz.dim()));
        let what = format!("has {own} frames and points; positions of {given} do not fit");
        Err(Error::data(Place::file(&self.table.name), what))
    }

    /// The points of a take, in the file's unit and axes; those that did not move, or that the file
    /// does not hold, have the numbers that they had.
    fn in_file(
        &self,
        take: &MarkerTake,
        xyz: ArrayView2<'_, f64>,
        mut holds: impl FnMut([f64; 3]) -> bool,
    ) -> Array2<f64> {
        let mut out = take.xyz.clone();
        let was = &self.table.poses.xyz;
        for (column, p) in self.point_indices_in(take).into_iter().enumerate() {
            for t in 0..xyz.nrows() {
                let at = [0, 1, 2].map(|c| [t, 3 * column + c]);
                let mut position = at.map(|at| xyz[at]);
                let is_new = at.iter().any(|at| xyz[*at].to_bits() != was[*at].to_bits());
                if !is_new || position.iter().any(|v| v.is_nan()) {
                    continue;
                }
                self.units.write(&mut position);
                if !holds(position) {
                    continue;
                }
                // A coordinate that did not move has the digits that it had.
                let mut old = at.map(|at| was[at]);
                self.units.write(&mut old);
                for c in 0..3 {
                    let own = &mut out[[t, 3 * p + c]];
                    if own.is_nan() || old[c].to_bits() != position[c].to_bits() {
                        *own = position[c];
                    }
                }
            }
        }
        out
    }
}
