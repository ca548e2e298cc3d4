//! The rows of a table as poses to edit.

use super::Session;
use crate::edit::Rig;
use crate::pose::Poses;
use crate::{Error, Result};
use ndarray::Array2;

impl Session {
    /// The rows of a table that can be edited: (frames, 3 K), cm, NaN where the table says nothing.
    pub fn rows(&self) -> &Array2<f64> {
        &self.rows
    }

    /// Sets the rows of a table that can be edited, and takes the first that places a pose, where
    /// it is; the floor is off, as nothing is known of it.
    ///
    /// # Errors
    /// [`Error::Usage`]: other than three columns per joint, or no row places a pose.
    pub fn edit_rows(&mut self, rows: Array2<f64>) -> Result<()> {
        if rows.ncols() != 3 * self.rig().joints() {
            return Err(Error::usage("rows need three numbers a joint"));
        }
        let placed = rows
            .rows()
            .into_iter()
            .find_map(|row| self.solver.pose_at(&row.to_vec(), &self.now.pose));
        let Some(pose) = placed else {
            return Err(Error::usage(
                "no row has three joints of the model, not all on a line",
            ));
        };
        (self.now.pose, self.now.floor, self.rows) = (pose, false, rows);
        self.revision += 1;
        Ok(())
    }

    /// Takes the pose of a row; joints that the row does not have are placed by the model.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such row, or it places no pose.
    pub fn take_row(&mut self, row: usize) -> Result<()> {
        if row >= self.rows.nrows() {
            return Err(Error::usage(format!("there is no row {row}")));
        }
        let xyz = self.rows.row(row).to_vec();
        self.take_places("the row of the table", &xyz)
    }
}

/// Rows of a table as poses of a rig (frames, 3 K): the columns of the joints' names; NaN where the
/// table has none.
pub fn rows_of_table(rig: &Rig, poses: &Poses) -> Array2<f64> {
    let columns: Vec<Option<usize>> = (rig.names.iter())
        .map(|name| poses.points.iter().position(|p| p == name))
        .collect();
    Array2::from_shape_fn((poses.frames(), 3 * rig.joints()), |(t, c)| {
        columns[c / 3].map_or(f64::NAN, |p| poses.xyz[[t, 3 * p + c % 3]])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::session::tests::session;
    use glam::DVec3;

    #[test]
    fn rows_of_a_table_are_taken_and_gaps_filled() {
        let mut session = session();
        let mut rows = Array2::zeros((2, 69));
        let xyz = session.starts()[3].pose.xyz.clone();
        rows.row_mut(0).fill(f64::NAN);
        rows.row_mut(1).assign(&ndarray::aview1(&xyz));
        let wrist = session.joint("lwrist").unwrap();
        rows.slice_mut(ndarray::s![1, 3 * wrist..3 * wrist + 3])
            .fill(f64::NAN);
        session.edit_rows(rows).unwrap();
        let head = session.joint("head").unwrap();
        let was = DVec3::from_slice(&xyz[3 * head..]);
        assert!((session.position(head) - was).length() < 0.5);
        assert!(session.position(wrist).is_finite());
        assert!(session.take_row(0).is_err() && session.take_row(2).is_err());
        assert!(session.take_row(1).is_ok());
    }
}
