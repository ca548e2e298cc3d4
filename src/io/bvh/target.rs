//! The skeleton a BVH file is written for: that of an ASF, of another BVH, or one measured.

use super::{Bvh, BvhExporter, BvhSkeleton, Joint, read};
use crate::io::{Input, asf};
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use crate::pose::rotation::Axis;
use crate::{Error, Result};
use glam::DMat3;
use ndarray::{Array2, ArrayView2};
use std::io::Cursor;

/// Larger files are refused.
const LARGEST_FILE: u64 = 2 << 30;

/// Where the bones of a file come from.
pub enum Target {
    /// A skeleton whose joints are the ends of its bones.
    Bones(Skeleton),
    /// A BVH, whose hierarchy, offsets and channels are kept.
    Template(Vec<Joint>, Box<BvhSkeleton>),
}

impl Target {
    /// Reads an ASF or a BVH, told apart by content, and what there is to note. `unit` (centimetres) and `turn` (from
    /// the file's axes to ours) are those of a BVH; an ASF states its own.
    pub fn read(input: Input, unit: f64, turn: DMat3) -> Result<(Target, Vec<String>)> {
        let name = input.name.clone();
        let bytes = input.read_all(LARGEST_FILE)?;
        let start = String::from_utf8_lossy(&bytes[..bytes.len().min(100)]).to_ascii_uppercase();
        let start = start.trim_start_matches('\u{feff}').trim_start();
        let is_bvh = start.starts_with("HIERARCHY");
        let input = Input::new(name, Cursor::new(bytes))?;
        if !is_bvh {
            return Ok((Target::Bones(asf::read(input, None)?.skeleton), Vec::new()));
        }
        let loaded = read(input, unit, true)?;
        let rig = BvhSkeleton::new(&loaded.bvh.joints, turn, false)?;
        Ok((
            Target::Template(loaded.bvh.joints, Box::new(rig)),
            loaded.notes,
        ))
    }

    /// What is solved for.
    pub fn skeleton(&self) -> &Skeleton {
        match self {
            Target::Bones(skeleton) => skeleton,
            Target::Template(_, rig) => &rig.skeleton,
        }
    }

    /// For each of a table's points the bone at whose end it is.
    pub fn joints(&self, names: &[String]) -> Vec<Option<usize>> {
        match self {
            Target::Bones(skeleton) => names.iter().map(|n| skeleton.find(n)).collect(),
            Target::Template(_, rig) => {
                let points = rig.points(rig.points_among(names));
                let find = |n: &String| points.iter().find(|p| p.0 == *n).map(|p| p.1);
                names.iter().map(find).collect()
            }
        }
    }

    /// The file for solved `values` (frames, values of the skeleton). `order` is that of the rotation channels, which
    /// a template keeps as it has it; `turn` carries the file's axes to ours.
    pub fn motion(
        &self,
        values: ArrayView2<'_, f64>,
        order: [Axis; 3],
        turn: DMat3,
        frame_time: f64,
    ) -> Result<Bvh> {
        let rows = values.rows().into_iter().map(|row| row.to_vec());
        let mut motion = Vec::new();
        let joints = match self {
            Target::Template(joints, rig) => {
                rows.for_each(|q| motion.extend(rig.frame(&q)));
                joints.clone()
            }
            Target::Bones(skeleton) => {
                let mut converter = BvhExporter::new(skeleton, order, turn.transpose());
                let mut posture = Posture::default();
                for q in rows {
                    skeleton.posture_into(&q, &mut posture);
                    converter.frame(&posture, &mut motion);
                }
                converter.joints().to_vec()
            }
        };
        let shape = (values.nrows(), Bvh::channels(&joints));
        Ok(Bvh {
            joints,
            frame_time,
            motion: Array2::from_shape_vec(shape, motion)
                .map_err(|e| Error::usage(e.to_string()))?,
        })
    }
}
