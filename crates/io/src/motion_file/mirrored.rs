//! A file as in a mirror: what is left is right.

use super::{MotionFile, Original};
use crate::PointMove;
use crate::pose::UpAxis;
use crate::pose::rotation::Axis;
use crate::pose::sides::{is_of_side, mirror_images};
use crate::{Error, Place, Result};
use glam::DVec3;
use std::path::Path;

/// A file's mirror image.
pub struct MirrorImage {
    /// The bytes of the file, unpacked, in its own format (FBX as BVH).
    pub bytes: Vec<u8>,
    /// The number of pairs of names that changed sides.
    pub pairs: usize,
    /// Names that say a side and have no other: they stay on the body where they were.
    pub alone: Vec<String>,
    /// What was odd about the file, and what is not mirrored, a line each.
    pub notes: Vec<String>,
}

impl MotionFile {
    /// The file as in a mirror: positions are reflected and change places with those of the other
    /// side, which the names tell ([`mirrored`](crate::pose::sides::mirrored)) or `pairs` does;
    /// of BVH, rotations and offsets do. Names and their order stay. The mirror image of it is the
    /// file.
    ///
    /// Positions are reflected at the plane x = 0 of a take that is y up; rotations along the axis
    /// of the file that parts the sides in the zero pose. All vertical planes give the same but for
    /// a turn about the vertical. `up` is the axis of a BVH file that points up, where it is
    /// another than was read.
    ///
    /// ```
    /// use posing_io::{MotionFile, motion_file::ReadOptions};
    ///
    /// let csv = b"l.x,l.y,l.z,r.x,r.y,r.z\n1.5,0,0,-2,0,7\n".to_vec();
    /// let file = MotionFile::from_bytes("two.csv", csv, &ReadOptions::default())?;
    /// let image = file.mirror_image(&[], None)?;
    /// assert_eq!(image.bytes, b"l.x,l.y,l.z,r.x,r.y,r.z\n2,0,7,-1.5,0,0\n");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: there are no names of sides, one of `pairs` is not there, or the format
    /// (AMC) has rotations whose axes differ from side to side.
    pub fn mirror_image(
        &self,
        pairs: &[(String, String)],
        up: Option<UpAxis>,
    ) -> Result<MirrorImage> {
        if self.all.is_some() {
            // Computed points are reflected too.
            let (path, bytes) = (Path::new(&self.table.name), self.to_bytes()?);
            return MotionFile::read_whole(path, bytes, &self.options)?.mirror_image(pairs, up);
        }
        let bad = |what: String| Error::data(Place::file(&self.table.name), what);
        let names: Vec<String> = match &self.original {
            Original::Bvh(_, bvh) => bvh.joints.iter().map(|j| j.name.clone()).collect(),
            Original::Amc(..) => {
                return Err(bad(
                    "is an AMC file, whose axes differ from side to side: carry it \
                                over to BVH with `posing retarget` first"
                        .into(),
                ));
            }
            _ => self.table.poses.points.clone(),
        };
        if self.table.poses.frames() == 0 {
            return Err(bad("has no frames".into()));
        }
        let images = images(&names, pairs).map_err(bad)?;
        match &self.original {
            Original::Bvh(bytes, bvh) => {
                let images = bvh.mirror_images(&images);
                let axis = bvh.lateral_axis(&images, vertical(up.unwrap_or(self.units.up)));
                let unit = self.units.unit.centimeters();
                let bytes = bvh.mirrored_bytes(bytes, &images, axis, unit);
                self.told(bytes, &names, &images)
            }
            _ => {
                let frames = 0..self.table.poses.frames();
                let pairs = images.iter().enumerate().filter(|(i, other)| i != *other);
                let moves: Vec<PointMove> = pairs
                    .map(|(from, to)| PointMove {
                        from,
                        to: Some(*to),
                        frames: frames.clone(),
                    })
                    .collect();
                let moved = self.moved(&moves)?;
                let mut xyz = moved.table.poses.xyz.clone();
                for mut row in xyz.rows_mut() {
                    row.iter_mut()
                        .step_by(3)
                        .filter(|x| **x != 0.0)
                        .for_each(|x| *x = -*x);
                }
                let (bytes, left) = moved.bytes_with_points(xyz.view())?;
                if left > 0 {
                    return Err(bad(format!(
                        "{left} positions are out of the numbers it holds"
                    )));
                }
                self.told(bytes, &names, &images)
            }
        }
    }

    fn told(&self, bytes: Vec<u8>, names: &[String], images: &[usize]) -> Result<MirrorImage> {
        let alone = (0..names.len()).filter(|i| images[*i] == *i && is_of_side(&names[*i]));
        let mut notes = self.notes.clone();
        if self.c3d().is_some() {
            notes.push("analog channels, force plates and events stay as they are".to_string());
        }
        Ok(MirrorImage {
            bytes,
            pairs: images
                .iter()
                .enumerate()
                .filter(|(i, other)| i < *other)
                .count(),
            alone: alone.map(|i| names[i].clone()).collect(),
            notes,
        })
    }
}

/// The image of each name.
fn images(names: &[String], pairs: &[(String, String)]) -> std::result::Result<Vec<usize>, String> {
    let mut images = mirror_images(names);
    let find = |name: &String| {
        let at = names.iter().position(|n| n == name);
        at.ok_or_else(|| format!("has no point or joint \"{name}\""))
    };
    for (left, right) in pairs {
        let pair = [find(left)?, find(right)?];
        for one in pair {
            let other = images[one];
            (images[one], images[other]) = (one, other);
        }
        (images[pair[0]], images[pair[1]]) = (pair[1], pair[0]);
    }
    if images.iter().enumerate().all(|(i, other)| i == *other) {
        return Err(
            "has no names of two sides (Left and Right, L and R, l and r); name them with \
                    the option `pairs LEFT:RIGHT`"
                .into(),
        );
    }
    Ok(images)
}

/// The axis of a file that is vertical.
fn vertical(up: UpAxis) -> Axis {
    let direction = up.rotation().transpose() * DVec3::Y;
    let axes = [Axis::X, Axis::Y, Axis::Z];
    let along = axes
        .into_iter()
        .find(|axis| direction[axis.index()].abs() > 0.5);
    along.unwrap_or(Axis::Y)
}
