//! The figure that `edit` poses: the skeleton given, or one measured, and the motion files that it
//! can become.

use crate::edit::in_betweens::Motion;
use crate::edit::{Rig, Session};
use crate::ik::estimate_skeleton;
use crate::io::bvh::{BvhPoints, BvhTemplate};
use crate::io::csv::{AddedColumn, After, CsvFormat};
use crate::io::text::number_cell;
use crate::io::{Amc, Asf, Bvh, Columns, Row, SkeletonFile};
use crate::pose::rotation::Axis;
use crate::pose::{NameMap, Poses, Skeleton, Status};
use crate::{Error, Result};
use glam::DMat3;
use std::collections::BTreeMap;

/// A figure and how its files are written.
pub struct Figure {
    /// What it is, in words.
    pub name: String,
    kind: FigureKind,
    /// The joint that is each point of the model.
    map: BTreeMap<String, String>,
    /// Centimeters in the unit of BVH files, and the turn from our axes (y up) to theirs.
    unit: f64,
    turn: DMat3,
}

enum FigureKind {
    Measured(Skeleton),
    Asf(Asf),
    Bvh(Box<BvhTemplate>),
}

impl Figure {
    /// The figure whose bones have the lengths of `poses`.
    ///
    /// # Errors
    /// As [`estimate_skeleton`].
    pub fn measured(name: &str, poses: &Poses) -> Result<Figure> {
        Ok(Figure {
            name: name.to_string(),
            kind: FigureKind::Measured(estimate_skeleton(poses)?),
            map: BTreeMap::new(),
            unit: 1.0,
            turn: DMat3::IDENTITY,
        })
    }

    /// The figure of a skeleton file; `map` names the joint that is each of the `model_points`: by
    /// default the shipped map that fits, where the model knows no joint by its own name. No
    /// bone of it stretches.
    ///
    /// # Errors
    /// [`Error::Usage`]: a map of the user's own names a joint that the skeleton does not have.
    /// Those of [`BvhTemplate::rigid`].
    pub fn of_file(
        name: &str,
        file: SkeletonFile,
        map: Option<&NameMap>,
        model_points: &[String],
    ) -> Result<Figure> {
        let names: Vec<String> = match &file {
            SkeletonFile::Asf(asf) => asf
                .skeleton
                .bones()
                .iter()
                .map(|b| b.name.clone())
                .collect(),
            SkeletonFile::Bvh(template) => {
                let points = template.skeleton.points(BvhPoints::Origins).iter();
                points.map(|(name, _)| name.clone()).collect()
            }
        };
        let own = names.iter().any(|n| model_points.contains(n));
        let map = map.or_else(|| NameMap::fitting(&names).filter(|_| !own));
        Ok(Figure {
            name: name.to_string(),
            map: map.map_or_else(|| Ok(BTreeMap::new()), |map| joints_of(map, &names))?,
            kind: match file {
                SkeletonFile::Asf(asf) => FigureKind::Asf(asf),
                SkeletonFile::Bvh(template) => FigureKind::Bvh(Box::new(template.rigid()?)),
            },
            unit: 1.0,
            turn: DMat3::IDENTITY,
        })
    }

    /// Writes BVH files with this unit (cm) and turn from our axes to theirs; those of a BVH
    /// skeleton are its own.
    #[must_use]
    pub fn with_units(mut self, unit: f64, turn: DMat3) -> Figure {
        (self.unit, self.turn) = (unit, turn);
        self
    }

    /// The rig: all bones of a skeleton, or the joints and End Sites of a BVH file; where that has
    /// the model's own names, which are those of bone ends, the ends of its bones.
    ///
    /// # Errors
    /// As [`Rig::with_joints`].
    pub(crate) fn rig(&self, model_points: &[String]) -> Result<Rig> {
        match &self.kind {
            FigureKind::Measured(skeleton) | FigureKind::Asf(Asf { skeleton, .. }) => {
                let bones = skeleton.bones().iter().enumerate();
                let joints: Vec<_> = bones.map(|(i, b)| (b.name.clone(), i)).collect();
                Rig::with_joints(skeleton.clone(), &joints, model_points, &self.map)
            }
            FigureKind::Bvh(template) => {
                let origins = template.skeleton.points(BvhPoints::Origins);
                let ends = template.skeleton.points(BvhPoints::Ends);
                let known = ends
                    .iter()
                    .filter(|(n, _)| model_points.contains(n))
                    .count();
                let joints = if self.map.is_empty() && known > 0 {
                    ends
                } else {
                    origins
                };
                Rig::with_joints(
                    template.skeleton.skeleton.clone(),
                    joints,
                    model_points,
                    &self.map,
                )
            }
        }
    }

    /// The formats that it can be written in.
    pub(crate) fn formats(&self) -> Vec<&'static str> {
        match self.kind {
            FigureKind::Asf(_) => vec!["bvh", "amc", "csv", "json"],
            _ => vec!["bvh", "csv", "json"],
        }
    }

    /// A motion as the bytes of a file: `bvh`, `csv`, or `amc`.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such format for this figure.
    pub(crate) fn export(
        &self,
        session: &Session,
        motion: &Motion,
        format: &str,
    ) -> Result<Vec<u8>> {
        let frame_time = 1.0 / motion.rate;
        match (format, &self.kind) {
            ("csv", _) => Ok(to_csv(session, motion)),
            ("bvh", FigureKind::Bvh(template)) => {
                let bvh = template.with_values(motion.values.view(), frame_time);
                Ok(bvh.to_bytes(self.unit))
            }
            ("bvh", FigureKind::Measured(skeleton) | FigureKind::Asf(Asf { skeleton, .. })) => {
                let order = [Axis::Z, Axis::Y, Axis::X];
                let values = motion.values.view();
                let bvh = Bvh::from_values(skeleton, values, order, self.turn, frame_time)?;
                Ok(bvh.to_bytes(self.unit))
            }
            ("amc", FigureKind::Asf(asf)) => {
                let first = 1 + (motion.first * motion.rate).round() as u64;
                Ok(Amc::from_values(asf, first, motion.values.view()).to_bytes())
            }
            ("amc", _) => Err(Error::usage(
                "AMC needs an ASF skeleton; give one with the option `skeleton`",
            )),
            _ => {
                let said: String = format.chars().take(20).collect();
                let what = format!(
                    "there is no format \"{said}\"; expected {}",
                    self.formats().join(", ")
                );
                Err(Error::usage(what))
            }
        }
    }
}

/// By point of the model, the joint that it is among `names`. What a shipped map does not find
/// there is left out; what a map of the user's own does not is an error.
fn joints_of(map: &NameMap, names: &[String]) -> Result<BTreeMap<String, String>> {
    let columns = map.columns(names);
    let missing = map
        .joints
        .iter()
        .find(|j| !columns.contains_key(j.0.as_str()));
    if let Some((_, joint)) = missing.filter(|_| NameMap::find(&map.name).is_none()) {
        let what = format!("the map names a joint \"{joint}\" that the skeleton does not have");
        return Err(Error::usage(what));
    }
    let joint = |(point, k): (&str, usize)| (point.to_string(), names[k].clone());
    Ok(columns.into_iter().map(joint).collect())
}

/// A table with the status and the standard deviation of each joint: observed where a pin holds it,
/// else inferred.
fn to_csv(session: &Session, motion: &Motion) -> Vec<u8> {
    let rig = session.rig();
    let columns = Columns::for_points(rig.names.clone(), false, true);
    let added: Vec<AddedColumn> = (0..rig.joints())
        .flat_map(|k| {
            let of = |what| AddedColumn::new(format!("{}.{what}", rig.names[k]), After::Point(k));
            [of("status"), of("sd")]
        })
        .collect();
    let format = CsvFormat::new(&columns, &added);
    let mut out = Vec::new();
    format.push_header(&mut out);
    for t in 0..motion.xyz.nrows() {
        let row = Row {
            time: Some(motion.first + t as f64 / motion.rate),
            ..Row::default()
        };
        let cells: Vec<String> = (0..rig.joints())
            .flat_map(|k| {
                let status = if motion.fixed[[t, k]] {
                    Status::Observed
                } else {
                    Status::Inferred
                };
                [status.name().to_string(), number(motion.sd[[t, k]])]
            })
            .collect();
        let xyz = motion.xyz.row(t).to_vec();
        format.push_row(&mut out, &row, &xyz, &cells);
    }
    out
}

/// A number as a cell; empty where it is not known.
fn number(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if value.is_finite() {
        number_cell(rounded)
    } else {
        String::new()
    }
}
