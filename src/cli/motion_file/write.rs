//! The way back into the file's own format, or into a table.

use super::{MotionFile, Original};
use crate::Result;
use crate::cli::args::{Format, OutputArgs};
use crate::cli::marker_files::Carried;
use crate::cli::streams::write_table;
use crate::cli::units::TableUnits;
use crate::io::{MarkerTake, MotionFormat, Output};
use crate::pose::Poses;
use crate::restore::Restoration;
use crate::restore::ik::{PositionSd, mix_with_paths, solve_missing_channels};
use ndarray::{Array2, ArrayView2};
use std::path::Path;

impl MotionFile {
    /// Whether a file of rotations lacks none.
    pub fn is_whole(&self) -> bool {
        match &self.original {
            Original::Bvh(_, bvh) => bvh.missing().is_empty(),
            _ => true,
        }
    }

    /// Writes the file anew, in its own format and with all that it says, with its points as they were restored. In a BVH file,
    /// missing values are solved for where the joints that they move are surer than `max_sd` (cm); all else stays. Returns how many positions its numbers do not hold, which stay as they were, or how many values of a BVH file are
    /// missing still.
    ///
    /// # Errors
    /// [`crate::Error::Io`]: writing fails. [`crate::Error::Data`]: the format does not hold the new values.
    pub fn write_back(
        &self,
        path: &Path,
        restored: &Restoration<'_>,
        max_sd: f64,
    ) -> Result<usize> {
        let (xyz, poses) = (restored.xyz(), &self.table.poses);
        let mut left = 0;
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
            Original::Bvh(bytes, bvh) if bvh.missing().is_empty() => bytes.to_vec(),
            Original::Bvh(bytes, bvh) => {
                let points = poses.points.len();
                let sd = Array2::from_shape_fn((xyz.nrows(), points), |(t, p)| restored.sd(t, p));
                let poses = Poses {
                    xyz: xyz.to_owned(),
                    ..poses.clone()
                };
                let sd = PositionSd {
                    sd: sd.view(),
                    most: max_sd,
                };
                let mut motion =
                    solve_missing_channels(bvh, &poses, Some(sd), self.units.up.rotation())?;
                mix_with_paths(bvh, |t, c| self.held.contains(&(t, c)), &mut motion);
                left = motion.iter().filter(|v| v.is_nan()).count();
                bvh.fill_missing(bytes, motion.view(), self.units.unit.centimetres())?
            }
            Original::Amc(bytes, _) => bytes.to_vec(),
            Original::Table => {
                let to = match self.format {
                    MotionFormat::Npy => Format::Npy,
                    _ => Format::Csv,
                };
                return self.write_table(path, to, xyz).map(|()| 0);
            }
        };
        let mut out = Output::file(path)?;
        out.write(&bytes)?;
        out.finish().map(|()| left)
    }

    /// Writes its points as a pose table, with them at `xyz`: of a table in its units, else in centimetres, y up.
    ///
    /// # Errors
    /// [`crate::Error::Io`]: writing fails.
    pub fn write_table(&self, path: &Path, to: Format, xyz: ArrayView2<'_, f64>) -> Result<()> {
        let out = OutputArgs {
            output: Some(path.to_path_buf()),
            to: Some(to),
            out_units: None,
            out_up: None,
        };
        let units = match self.original {
            Original::Table => self.units,
            _ => TableUnits::CM_Y,
        };
        if let (Original::Text(_, take), Format::Csv) = (&self.original, to) {
            let carried = Carried::new(take);
            let columns = carried.columns();
            let cells = |frame| carried.cells(frame);
            return write_table(&out, units, &self.table, xyz, &columns, cells);
        }
        write_table(&out, units, &self.table, xyz, &[], |_| Vec::new())
    }

    /// The points of a take, in the file's unit and axes; those that did not move, or that the file does not hold, have the numbers that
    /// they had.
    fn in_file(
        &self,
        take: &MarkerTake,
        xyz: ArrayView2<'_, f64>,
        mut holds: impl FnMut([f64; 3]) -> bool,
    ) -> Array2<f64> {
        let mut out = take.xyz.clone();
        let was = &self.table.poses.xyz;
        for (column, p) in take.positions().into_iter().enumerate() {
            for t in 0..xyz.nrows() {
                let at = [0, 1, 2].map(|c| [t, 3 * column + c]);
                let mut place = at.map(|at| xyz[at]);
                let is_new = at.iter().any(|at| xyz[*at].to_bits() != was[*at].to_bits());
                if !is_new || place.iter().any(|v| v.is_nan()) {
                    continue;
                }
                self.units.write(&mut place);
                if !holds(place) {
                    continue;
                }
                // A coordinate that did not move has the digits that it had.
                let mut old = at.map(|at| was[at]);
                self.units.write(&mut old);
                for c in 0..3 {
                    let own = &mut out[[t, 3 * p + c]];
                    if own.is_nan() || old[c].to_bits() != place[c].to_bits() {
                        *own = place[c];
                    }
                }
            }
        }
        out
    }
}
