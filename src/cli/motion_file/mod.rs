//! A file of motion of any format that is read, as a pose table, and the way back into its own format.

mod bones;
mod held;
mod read_as;
mod scoped;
mod skeleton;
mod write;

pub use read_as::{ReadArgs, ReadAs, ReadFlags, Source, Taken};
pub use skeleton::skeleton_of;

use super::args::value_name;
use super::input::take_name;
use super::marker_files::{MarkerUnitArgs, asked, poses_of_markers};
use super::marker_units::{axis_of, unit_of};
use super::units::{TableUnits, Units, Up};
use super::zeros::empty_zeros;
use crate::audit::JointAngles;
use crate::io::amc::{AmcFrames, AmcReader};
use crate::io::bvh::{BvhPoints, BvhSkeleton, LARGEST_FILE};
use crate::io::{
    Asf, Bvh, C3d, Input, MarkerTake, MotionFormat, NpzTake, ReadOptions, Table, marker_csv,
    opensim, trc,
};
use crate::pose::{Channel, Poses, joints, kinematics::Space};
use crate::{Error, Place, Result};
use bytes::Bytes;
use ndarray::{Array2, ArrayView2, Axis};
use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

/// A file of motion.
pub struct MotionFile {
    /// The format.
    pub format: MotionFormat,
    /// The points, in centimetres, y up.
    pub table: Table,
    /// What it was taken for.
    pub read_as: ReadAs,
    /// What was odd, a line each.
    pub notes: Vec<String>,
    units: TableUnits,
    original: Original,
    /// The frames and channels that were held and count as missing.
    held: BTreeSet<(usize, usize)>,
}

/// What the way back needs.
enum Original {
    C3d(Box<C3d>),
    Text(Bytes, Box<MarkerTake>),
    Npz(Box<NpzTake>),
    Bvh(Bytes, Box<Bvh>),
    Amc(Bytes, Vec<JointAngles>),
    Table,
}

impl MotionFile {
    /// Reads a file whose bytes, unpacked, are `bytes`.
    ///
    /// # Errors
    /// [`Error::Data`]: it is damaged, or neither it nor a flag says its rate, unit or axis.
    pub fn read(path: &Path, bytes: Vec<u8>, flags: &ReadFlags) -> Result<MotionFile> {
        let name = path.display().to_string();
        let bytes = Bytes::from(bytes);
        let input = || Input::new(name.clone(), Cursor::new(bytes.clone()));
        if bytes.is_empty() {
            return Err(Error::data(Place::file(name), "is empty"));
        }
        let format = MotionFormat::of(&bytes[..bytes.len().min(MOST_TITLES)]);
        let flags = &flags.of(path, format);
        let keep = flags.keep_whole;
        match format {
            MotionFormat::C3d => {
                let c3d = C3d::read(input()?, keep)?;
                let take = c3d.take.clone();
                of_markers(path, format, &take, Original::C3d(Box::new(c3d)), flags)
            }
            MotionFormat::Trc
            | MotionFormat::MotiveCsv
            | MotionFormat::QualisysTsv
            | MotionFormat::NexusCsv
            | MotionFormat::PointTable
            | MotionFormat::OpenSim => {
                let take = match format {
                    MotionFormat::Trc => trc::read(input()?, keep)?,
                    MotionFormat::OpenSim => opensim::read(input()?, keep)?,
                    _ => marker_csv::read(input()?, None, keep)?,
                };
                let original = Original::Text(bytes, Box::new(take.clone()));
                of_markers(path, format, &take, original, flags)
            }
            MotionFormat::Bvh => {
                let units = custom_units(flags);
                let bvh = Bvh::read(input()?, units.unit.centimetres(), keep)?;
                of_bvh(path, bvh, bytes, units, flags)
            }
            MotionFormat::Amc => of_amc(path, input()?, bytes, flags),
            MotionFormat::Asf => {
                let what = "is a skeleton without motion; AMC takes find it beside them";
                Err(Error::data(Place::file(name), what))
            }
            MotionFormat::Npz => {
                let npz = NpzTake::read(input()?, flags.joints.as_deref())?;
                let take = npz.take.clone();
                of_markers(path, format, &take, Original::Npz(Box::new(npz)), flags)
            }
            MotionFormat::Csv | MotionFormat::Npy => of_table(format, input()?, flags),
        }
    }

    /// The rate of its frames, where it has one.
    pub fn rate(&self) -> Option<f64> {
        self.read_as.rate.as_ref().map(|rate| rate.value)
    }

    /// The angles of its joints, where it has rotations.
    pub fn joint_angles(&self) -> Vec<JointAngles> {
        match &self.original {
            Original::Amc(_, angles) => angles.clone(),
            Original::Bvh(_, bvh) => {
                let joints = bvh.joints.iter();
                let joints = joints.map(|joint| (joint.name.clone(), joint.channels.clone()));
                joint_angles(joints, bvh.motion.view())
            }
            Original::C3d(_) | Original::Text(..) | Original::Npz(_) | Original::Table => {
                Vec::new()
            }
        }
    }
}

/// The unit and the axis of a format that does not say them.
fn custom_units(flags: &ReadFlags) -> TableUnits {
    TableUnits {
        unit: flags.units.unwrap_or(Units::Cm),
        up: flags.up.unwrap_or(Up::Y),
    }
}

fn read_as(rate: Option<Taken<f64>>, units: TableUnits, sources: [Source; 2]) -> ReadAs {
    let [unit, up] = sources;
    ReadAs {
        rate,
        unit: Taken {
            value: value_name(units.unit),
            from: unit,
        },
        up: Taken {
            value: value_name(units.up),
            from: up,
        },
    }
}

/// Where the unit and the axis of a format come from that does not say them.
fn custom_sources(flags: &ReadFlags) -> [Source; 2] {
    [flags.units.is_some(), flags.up.is_some()].map(|given| match given {
        true => Source::Flag,
        false => Source::Custom,
    })
}

/// The rate: the file's, else the flag's.
fn rate_of(own: Option<f64>, flags: &ReadFlags) -> Option<Taken<f64>> {
    let taken = |from: Source| move |value: f64| Taken { value, from };
    let flag = flags.fps.map(taken(Source::Flag));
    own.map(taken(Source::File)).or(flag)
}

fn of_markers(
    path: &Path,
    format: MotionFormat,
    take: &MarkerTake,
    original: Original,
    flags: &ReadFlags,
) -> Result<MotionFile> {
    let inferred = [take.units_are_inferred, take.up_is_inferred];
    let said = [
        take.units.as_deref().and_then(unit_of).is_some()
            && !(inferred[0] && flags.units.is_some()),
        take.up.as_deref().and_then(axis_of).is_some() && !(inferred[1] && flags.up.is_some()),
    ];
    let given = MarkerUnitArgs {
        units: flags.units.filter(|_| !said[0]),
        up: flags.up.filter(|_| !said[1]),
    };
    // Columns alone stay as they are.
    let units = match take.points.is_empty() {
        true => TableUnits::CM_Y,
        false => given.table_units(take)?,
    };
    let rate = rate_of(take.rate, flags);
    let value = rate.as_ref().map(|rate| rate.value);
    let is_timed = take.times.is_some();
    let value = value
        .or(is_timed.then_some(1.0))
        .ok_or_else(|| asked(take, "rate", None, "--fps F (frames per second)"))?;
    let sources = [0, 1].map(|i| match (said[i], inferred[i]) {
        (true, true) => Source::Custom,
        (true, false) => Source::File,
        (false, _) => Source::Flag,
    });
    let mut notes = take.notes.clone();
    let mut positions = take.only_positions();
    let others = take.points.len() - positions.points.len();
    if others > 0 {
        notes.push(format!(
            "{others} points are angles, forces, moments or powers, and stay as they are"
        ));
    }
    if flags.zeros_are_missing {
        empty_zeros(&mut positions.xyz);
    }
    Ok(MotionFile {
        format,
        table: table(path, poses_of_markers(&positions, units, value, path)?),
        read_as: read_as(rate, units, sources),
        notes,
        units,
        original,
        held: BTreeSet::new(),
    })
}

fn of_bvh(
    path: &Path,
    mut bvh: Bvh,
    bytes: Bytes,
    units: TableUnits,
    flags: &ReadFlags,
) -> Result<MotionFile> {
    let rate = rate_of(bvh.rate(), flags);
    let bad = |what| Error::data(Place::file(path.display().to_string()), what);
    let value = bvh.rate_or(flags.fps).map_err(bad)?;
    let skeleton = BvhSkeleton::new(&bvh.joints, units.up.rotation(), true)?;
    let mut poses = bvh.positions(&skeleton, BvhPoints::Origins, value);
    poses.take = Some(vec![take_name(path).into(); poses.frames()]);
    Ok(MotionFile {
        format: MotionFormat::Bvh,
        table: table(path, poses),
        read_as: read_as(rate, units, custom_sources(flags)),
        notes: std::mem::take(&mut bvh.notes),
        units,
        original: Original::Bvh(bytes, Box::new(bvh)),
        held: BTreeSet::new(),
    })
}

fn of_amc(path: &Path, input: Input, bytes: Bytes, flags: &ReadFlags) -> Result<MotionFile> {
    let bad = |what: &str| Error::data(Place::file(path.display().to_string()), what);
    let rate = flags.fps.ok_or_else(|| {
        bad("an AMC file does not say its rate; give it with --fps F (frames per second)")
    })?;
    let asf = Asf::read(Input::open(skeleton_of(path, flags)?)?, None)?;
    let mut reader = AmcReader::new(&asf, input, flags.keep_whole)?;
    let bones = asf.skeleton.bones();
    let known: Option<Vec<usize>> = (joints::cmu_names().iter())
        .map(|name| asf.skeleton.find(name))
        .collect();
    let shown = known.unwrap_or_else(|| (0..bones.len()).collect());
    let (mut xyz, mut time) = (Vec::new(), Vec::new());
    let (mut frames, mut values) = (AmcFrames::default(), Vec::new());
    while reader.read_block(&mut frames)? {
        values.extend_from_slice(&frames.values);
        xyz.extend(frames.positions(&asf.skeleton, &shown, Space::World));
        time.extend(frames.numbers.iter().map(|&n| (n as f64 - 1.0) / rate));
    }
    let dropped = reader.dropped;
    let dropped = dropped.map(|n| format!("dropped frame {n}, which is incomplete"));
    let name: Arc<str> = take_name(path).into();
    let poses = Poses {
        points: shown.iter().map(|&j| bones[j].name.clone()).collect(),
        take: Some(vec![name; time.len()]),
        xyz: Array2::from_shape_vec((time.len(), 3 * shown.len()), xyz)
            .map_err(|e| bad(&e.to_string()))?,
        time: Some(time),
    };
    let shape = (
        values.len() / asf.skeleton.dof_count().max(1),
        asf.skeleton.dof_count(),
    );
    let values = Array2::from_shape_vec(shape, values).map_err(|e| bad(&e.to_string()))?;
    let channels = bones.iter().map(|bone| {
        let channels = bone.dofs.iter().map(|dof| dof.channel).collect();
        (bone.name.clone(), channels)
    });
    // Acclaim's first angle is applied first, so it stands last in the product.
    let mut angles = joint_angles(channels, values.view());
    angles.iter_mut().for_each(JointAngles::reverse);
    let units = TableUnits::CM_Y;
    let of_skeleton = [Source::File, Source::Custom];
    Ok(MotionFile {
        format: MotionFormat::Amc,
        table: table(path, poses),
        read_as: read_as(rate_of(None, flags), units, of_skeleton),
        notes: dropped.into_iter().collect(),
        units,
        original: Original::Amc(bytes, angles),
        held: BTreeSet::new(),
    })
}

/// The angles among the channels of joints, whose values follow one another in `values` (frames, channels).
fn joint_angles(
    joints: impl Iterator<Item = (String, Vec<Channel>)>,
    values: ArrayView2<'_, f64>,
) -> Vec<JointAngles> {
    let mut first = 0;
    let mut out = Vec::new();
    for (joint, channels) in joints {
        let axis = |(i, channel): (usize, &Channel)| match channel {
            Channel::Rotate(axis) => Some((first + i, *axis)),
            _ => None,
        };
        let (columns, axes): (Vec<usize>, Vec<_>) =
            channels.iter().enumerate().filter_map(axis).unzip();
        if !columns.is_empty() {
            out.push(JointAngles {
                joint,
                axes,
                angles: values.select(Axis(1), &columns),
            });
        }
        first += channels.len();
    }
    out
}

fn of_table(format: MotionFormat, input: Input, flags: &ReadFlags) -> Result<MotionFile> {
    let options = ReadOptions {
        joints: flags.joints.clone(),
        cells: true,
        ..ReadOptions::default()
    };
    let mut table = Table::read(input, &options)?;
    if flags.zeros_are_missing {
        empty_zeros(&mut table.poses.xyz);
    }
    let units = custom_units(flags);
    units.read_frames(&mut table.poses.xyz);
    let rate = rate_of(table.poses.rate(), flags);
    Ok(MotionFile {
        format,
        read_as: read_as(rate, units, custom_sources(flags)),
        notes: Vec::new(),
        units,
        original: Original::Table,
        held: BTreeSet::new(),
        table,
    })
}

fn table(path: &Path, poses: Poses) -> Table {
    Table {
        name: path.display().to_string(),
        ..Table::from_poses(poses)
    }
}

/// The bytes that a file's titles may have.
const MOST_TITLES: usize = 1 << 18;

/// The largest file that is read, bytes.
pub const LARGEST_MOTION_FILE: u64 = LARGEST_FILE;
