//! Positions moved between the points of a file, as the file has them: no number is written anew.

use super::{MotionFile, Original};
use crate::marker_take::MarkerTake;
use crate::output::write_file;
use crate::{Error, Place, Result};
use crate::{PointMove, Table};
use std::collections::HashSet;
use std::path::Path;

impl MotionFile {
    /// Writes the file with positions moved between its points, all at once: residuals and cameras
    /// of C3D files go with them, the digits of text stay. Points are those of its table.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails. [`Error::Data`]: its points follow from rotations.
    pub fn write_moved(&self, path: impl AsRef<Path>, moves: &[PointMove]) -> Result<()> {
        if let Some(bytes) = self.moved_bytes(moves)? {
            return write_file(path, &bytes);
        }
        let moved = self.with_moved_table(moves);
        let (format, xyz) = (self.table_format(), moved.table.poses.xyz.view());
        moved.write_table(path.as_ref(), format, xyz)
    }

    /// The file with positions moved between its points, as [`MotionFile::write_moved`] writes it:
    /// its labels put right in memory.
    ///
    /// ```
    /// use posing_io::{MotionFile, PointMove, motion_file::ReadOptions};
    ///
    /// let csv = b"l.x,l.y,l.z,r.x,r.y,r.z\n1,0,0,2,0,0\n2,0,0,1,0,0\n".to_vec();
    /// let file = MotionFile::from_bytes("two.csv", csv, &ReadOptions::default())?;
    /// let one = |from, to| PointMove { from, to: Some(to), frames: 1..2 };
    /// let moved = file.moved(&[one(0, 1), one(1, 0)])?;
    /// assert_eq!(moved.to_bytes()?, b"l.x,l.y,l.z,r.x,r.y,r.z\n1,0,0,2,0,0\n1,0,0,2,0,0\n");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: its points follow from rotations.
    pub fn moved(&self, moves: &[PointMove]) -> Result<MotionFile> {
        Ok(match self.moved_bytes(moves)? {
            Some(bytes) => MotionFile {
                notes: self.notes.clone(),
                ..self.read_alike(bytes)?
            },
            None => self.with_moved_table(moves),
        })
    }

    /// The file with some of its points named anew.
    ///
    /// # Errors
    /// [`Error::Data`]: the file cannot be written with other names.
    pub fn renamed(&self, names: &[(usize, String)]) -> Result<MotionFile> {
        let names_of = |take: &MarkerTake| -> Vec<(usize, String)> {
            let indices = self.point_indices_in(take);
            names
                .iter()
                .map(|(p, name)| (indices[*p], name.clone()))
                .collect()
        };
        let refuse = |what: &str| Err(Error::data(Place::file(&self.table.name), what));
        let bytes = match &self.original {
            Original::C3d(c3d) => c3d.with_names(&names_of(&c3d.take))?,
            Original::Text(bytes, take) => {
                let named = take.cells.with_names(bytes, &take.points, &names_of(take));
                let what = "does not name its points where others do: its names stay; give it as \
                            C3D or as a table";
                match named {
                    Some(bytes) => bytes,
                    None => return refuse(what),
                }
            }
            Original::Table if !self.table.columns.names.is_empty() => {
                let (mut table, indices) = (self.whole_table().clone(), self.point_indices());
                for (point, name) in names {
                    table.rename_point(indices[*point], name);
                }
                return Ok(self.of_table(table));
            }
            _ => return refuse("is of a format whose points are not named; give it as C3D or CSV"),
        };
        let named = MotionFile {
            notes: self.notes.clone(),
            ..self.read_alike(bytes)?
        };
        let mut wanted = self.table.poses.points.clone();
        names
            .iter()
            .for_each(|(p, name)| wanted[*p].clone_from(name));
        if named.table.poses.points != wanted {
            return refuse(
                "cannot be written with other names of its points; give it as C3D or as a table",
            );
        }
        Ok(named)
    }

    /// Reads a file of the same points; those that are computed here are so there.
    fn read_alike(&self, bytes: Vec<u8>) -> Result<MotionFile> {
        let options = &self.options;
        let file = MotionFile::read_whole(Path::new(&self.table.name), bytes, options)?;
        Ok(file.without_computed_of(self).without_zeros(options))
    }

    /// A file that is a table, with positions moved between its points.
    fn with_moved_table(&self, moves: &[PointMove]) -> MotionFile {
        let moves = at_indices(moves, &self.point_indices());
        self.of_table(moved_table(self.whole_table(), &moves))
    }

    /// A file that is a table, with another table of all its points.
    fn of_table(&self, table: Table) -> MotionFile {
        let file = MotionFile {
            format: self.format,
            table,
            read_as: self.read_as.clone(),
            notes: self.notes.clone(),
            units: self.units,
            options: self.options.clone(),
            original: Original::Table,
            all: None,
        };
        file.without_computed_of(self)
    }

    /// The bytes of the file with positions moved; `None` of a table.
    fn moved_bytes(&self, moves: &[PointMove]) -> Result<Option<Vec<u8>>> {
        Ok(Some(match &self.original {
            Original::C3d(c3d) => c3d.with_moved(&self.in_take(&c3d.take, moves))?,
            Original::Text(bytes, take) => take.cells.with_moved(bytes, &self.in_take(take, moves)),
            Original::Npz(npz) => {
                let mut xyz = npz.take.xyz.clone();
                PointMove::make_all(&self.in_take(&npz.take, moves), &mut xyz);
                npz.with_points(xyz.view())?
            }
            Original::Bvh(..) | Original::Amc(..) => {
                let what = "holds rotations, whose points have no labels to change";
                return Err(Error::data(Place::file(&self.table.name), what));
            }
            Original::Table => return Ok(None),
        }))
    }

    /// Moves between the points of its take, which are more than those of its table.
    fn in_take(&self, take: &MarkerTake, moves: &[PointMove]) -> Vec<PointMove> {
        at_indices(moves, &self.point_indices_in(take))
    }
}

/// Moves between points that have other indices now.
fn at_indices(moves: &[PointMove], indices: &[usize]) -> Vec<PointMove> {
    let of = |m: &PointMove| PointMove {
        from: indices[m.from],
        to: m.to.map(|to| indices[to]),
        frames: m.frames.clone(),
    };
    moves.iter().map(of).collect()
}

/// A table with positions moved between its points, and with them the text of all columns that
/// begin with their names.
fn moved_table(table: &Table, moves: &[PointMove]) -> Table {
    let mut out = table.clone();
    PointMove::make_all(moves, &mut out.poses.xyz);
    if let Some(sd) = &mut out.sd {
        PointMove::make_all_of(moves, sd, 1);
    }
    let names = &table.columns.names;
    let points: HashSet<&str> = table.poses.points.iter().map(String::as_str).collect();
    // hand.l.x is of hand.l where there is such a point.
    let parted = |name: &'_ str| -> Option<usize> {
        let mut dots = name.rmatch_indices('.').map(|(at, _)| at);
        dots.find(|at| points.contains(&name[..*at]))
    };
    let of_point = |p: usize| {
        let columns = names.iter().enumerate();
        let own = columns.filter_map(|(c, n)| {
            let at = parted(n).filter(|at| n[..*at] == table.poses.points[p])?;
            Some((c, &n[at + 1..]))
        });
        own.collect::<Vec<_>>()
    };
    let columns: Vec<Vec<(usize, Option<usize>)>> = moves
        .iter()
        .map(|m| {
            let to = m.to.map(of_point).unwrap_or_default();
            let twin = |name: &str| to.iter().find(|(_, n)| *n == name).map(|(c, _)| *c);
            of_point(m.from)
                .into_iter()
                .map(|(c, name)| (c, twin(name)))
                .collect()
        })
        .collect();
    for (t, cells) in out.cells.iter_mut().enumerate() {
        let here = moves
            .iter()
            .zip(&columns)
            .filter(|(m, _)| m.frames.contains(&t));
        let pairs: Vec<(usize, Option<usize>)> = here
            .flat_map(|(_, columns)| columns.iter().copied())
            .collect();
        if !pairs.is_empty() {
            cells.move_all(&pairs);
        }
    }
    out
}
