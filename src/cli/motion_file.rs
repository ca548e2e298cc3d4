//! A file of motion of any format that is read, as a pose table, and the way back into its own format.

use super::args::{Format, OutputArgs, parse_rate, value_name};
use super::input::take_name;
use super::marker_files::{MarkerUnitArgs, asked, axis_of, poses_of_markers, unit_of};
use super::streams::write_table;
use super::units::{TableUnits, Units, Up};
use crate::audit::JointAngles;
use crate::io::amc::{AmcFrames, AmcReader};
use crate::io::bvh::{BvhPoints, BvhSkeleton, LARGEST_FILE};
use crate::io::{
    Asf, Bvh, C3d, Input, MarkerTake, MotionFormat, Output, ReadOptions, Table, marker_csv,
    parse_point_names, trc,
};
use crate::pose::{Channel, Poses, joints, kinematics::Space};
use crate::restore::Restoration;
use crate::restore::ik::{PositionSd, solve_missing_channels};
use crate::{Error, Place, Result};
use clap::Args;
use ndarray::{Array2, ArrayView2, Axis};
use serde::Serialize;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is taken for files that do not say it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Input")]
pub struct ReadArgs {
    /// Frames per second of files that do not say it
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    /// Unit of length of files that do not say it (BVH files and tables: cm)
    #[arg(long, value_enum, value_name = "UNIT")]
    units: Option<Units>,
    /// Axis that points up in files that do not say it (BVH files and tables: y)
    #[arg(long, value_enum, value_name = "AXIS")]
    up: Option<Up>,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's: 07.asf for 07_01.amc]
    #[arg(long, value_name = "SUBJECT.asf")]
    asf: Option<PathBuf>,
    /// Point names for an NPY array: 23 (the CMU joints) or a comma-separated list
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// Accept files that end early (not tables): the whole frames before that are kept
    #[arg(long)]
    keep_whole: bool,
}

impl ReadArgs {
    /// The same, checked.
    ///
    /// # Errors
    /// [`Error::Usage`]: names of points that cannot be.
    pub fn flags(&self) -> Result<ReadFlags> {
        Ok(ReadFlags {
            fps: self.fps,
            units: self.units,
            up: self.up,
            asf: self.asf.clone(),
            joints: self.joints.as_deref().map(parse_point_names).transpose()?,
            keep_whole: self.keep_whole,
        })
    }
}

/// What is taken for a file that does not say it.
#[derive(Debug, Clone, Default)]
pub struct ReadFlags {
    /// Frames a second.
    pub fps: Option<f64>,
    /// The unit of length.
    pub units: Option<Units>,
    /// The axis that points up.
    pub up: Option<Up>,
    /// The skeleton of AMC takes; `None`: the ASF file beside each whose name begins the take's.
    pub asf: Option<PathBuf>,
    /// The names of an array's points.
    pub joints: Option<Vec<String>>,
    /// Whether a file that ends early gives the frames that it has.
    pub keep_whole: bool,
}

/// Where something that was taken for true comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The file says so.
    File,
    /// A flag does.
    Flag,
    /// It is the custom of the format.
    Custom,
}

/// Something that was taken for true, and where it comes from.
#[derive(Debug, Clone, Serialize)]
pub struct Taken<T> {
    /// What it is.
    pub value: T,
    /// Where it comes from.
    pub from: Source,
}

/// What a file was taken for.
#[derive(Debug, Clone, Serialize)]
pub struct ReadAs {
    /// Frames a second; `None`: a single frame.
    pub rate: Option<Taken<f64>>,
    /// The unit of length.
    pub unit: Taken<String>,
    /// The axis that points up.
    pub up: Taken<String>,
}

/// A file of motion.
pub struct MotionFile {
    /// Its format.
    pub format: MotionFormat,
    /// Its points, in centimetres, y up.
    pub table: Table,
    /// What it was taken for.
    pub read_as: ReadAs,
    /// What was odd, a line each.
    pub notes: Vec<String>,
    units: TableUnits,
    original: Original,
}

/// What the way back needs.
enum Original {
    C3d(Box<C3d>),
    Text(Vec<u8>, Box<MarkerTake>),
    Bvh(Vec<u8>, Box<Bvh>),
    Amc(Vec<u8>, Vec<JointAngles>),
    Table,
}

impl MotionFile {
    /// Reads a file whose bytes, unpacked, are `bytes`.
    ///
    /// # Errors
    /// [`Error::Data`]: it is damaged, or neither it nor a flag says its rate, unit or axis.
    pub fn read(path: &Path, bytes: Vec<u8>, flags: &ReadFlags) -> Result<MotionFile> {
        let name = path.display().to_string();
        let input = || Input::new(name.clone(), Cursor::new(bytes.clone()));
        if bytes.is_empty() {
            return Err(Error::data(Place::file(name), "is empty"));
        }
        let format = MotionFormat::of(&bytes[..bytes.len().min(12)]);
        let keep = flags.keep_whole;
        match format {
            MotionFormat::C3d => {
                let c3d = C3d::read(input()?, keep)?;
                let take = c3d.take.clone();
                of_markers(path, format, &take, Original::C3d(Box::new(c3d)), flags)
            }
            MotionFormat::Trc | MotionFormat::MotiveCsv | MotionFormat::QualisysTsv => {
                let take = match format {
                    MotionFormat::Trc => trc::read(input()?, keep)?,
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
            Original::C3d(_) | Original::Text(..) | Original::Table => Vec::new(),
        }
    }

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
    /// [`Error::Io`]: writing fails. [`Error::Data`]: the format does not hold the new values.
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
            Original::Bvh(bytes, bvh) if bvh.missing().is_empty() => bytes.clone(),
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
                let motion =
                    solve_missing_channels(bvh, &poses, Some(sd), self.units.up.rotation())?;
                left = motion.iter().filter(|v| v.is_nan()).count();
                bvh.fill_missing(bytes, motion.view(), self.units.unit.centimetres())?
            }
            Original::Amc(bytes, _) => bytes.clone(),
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
    /// [`Error::Io`]: writing fails.
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
        let positions = (0..take.points.len()).filter(|p| !take.other_quantities.contains(p));
        for (column, p) in positions.enumerate() {
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
    let said = [
        take.units.as_deref().and_then(unit_of).is_some(),
        take.up.as_deref().and_then(axis_of).is_some(),
    ];
    let given = MarkerUnitArgs {
        units: flags.units.filter(|_| !said[0]),
        up: flags.up.filter(|_| !said[1]),
    };
    let units = given.table_units(take)?;
    let rate = rate_of(take.rate, flags);
    let value = rate.as_ref().map(|rate| rate.value);
    let value = value.ok_or_else(|| asked(take, "rate", None, "--fps F (frames per second)"))?;
    let sources = said.map(|said| if said { Source::File } else { Source::Flag });
    let mut notes = take.notes.clone();
    if !take.other_quantities.is_empty() {
        notes.push(format!(
            "{} points are angles, forces, moments or powers, and stay as they are",
            take.other_quantities.len()
        ));
    }
    Ok(MotionFile {
        format,
        table: table(
            path,
            poses_of_markers(&positions(take), units, value, path)?,
        ),
        read_as: read_as(rate, units, sources),
        notes,
        units,
        original,
    })
}

/// A take without its points that are no positions.
fn positions(take: &MarkerTake) -> MarkerTake {
    let is_position = |p: &usize| !take.other_quantities.contains(p);
    let kept: Vec<usize> = (0..take.points.len()).filter(is_position).collect();
    let columns: Vec<usize> = kept.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
    MarkerTake {
        points: kept.iter().map(|&p| take.points[p].clone()).collect(),
        xyz: take.xyz.select(Axis(1), &columns),
        ..take.clone()
    }
}

fn of_bvh(
    path: &Path,
    mut bvh: Bvh,
    bytes: Vec<u8>,
    units: TableUnits,
    flags: &ReadFlags,
) -> Result<MotionFile> {
    let rate = rate_of(bvh.rate(), flags);
    if rate.is_none() && bvh.motion.nrows() > 1 {
        let what = format!("Frame Time is {}; give the rate with --fps", bvh.frame_time);
        return Err(Error::data(Place::file(path.display().to_string()), what));
    }
    let skeleton = BvhSkeleton::new(&bvh.joints, units.up.rotation(), true)?;
    let value = rate.as_ref().map_or(1.0, |rate| rate.value);
    let mut poses = bvh.positions(&skeleton, BvhPoints::Origins, value);
    poses.take = Some(vec![take_name(path).into(); poses.frames()]);
    Ok(MotionFile {
        format: MotionFormat::Bvh,
        table: table(path, poses),
        read_as: read_as(rate, units, custom_sources(flags)),
        notes: std::mem::take(&mut bvh.notes),
        units,
        original: Original::Bvh(bytes, Box::new(bvh)),
    })
}

fn of_amc(path: &Path, input: Input, bytes: Vec<u8>, flags: &ReadFlags) -> Result<MotionFile> {
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

/// The ASF file of an AMC take: the flag's, else the one beside it whose name begins the take's, else the only one there.
pub fn skeleton_of(path: &Path, flags: &ReadFlags) -> Result<PathBuf> {
    if let Some(asf) = &flags.asf {
        return Ok(asf.clone());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let is_asf = |p: &PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("asf"));
    let mut all: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(is_asf).collect();
    all.sort();
    let take = take_name(path);
    // 07_01 is of 07, not of 0.
    let begins = |p: &&PathBuf| {
        let rest = take.strip_prefix(&take_name(p)).map(str::to_string);
        rest.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
    };
    match all.iter().filter(begins).max_by_key(|p| take_name(p).len()) {
        Some(own) => Ok(own.clone()),
        None => {
            let what = format!(
                "no skeleton beside the take begins its name ({} others are there); give it with --asf SUBJECT.asf",
                all.len()
            );
            Err(Error::data(Place::file(path.display().to_string()), what))
        }
    }
}

fn of_table(format: MotionFormat, input: Input, flags: &ReadFlags) -> Result<MotionFile> {
    let options = ReadOptions {
        joints: flags.joints.clone(),
        cells: true,
        ..ReadOptions::default()
    };
    let mut table = Table::read(input, &options)?;
    let units = custom_units(flags);
    units.read_frames(&mut table.poses.xyz);
    let rate = rate_of(table.poses.rate(), flags);
    Ok(MotionFile {
        format,
        read_as: read_as(rate, units, custom_sources(flags)),
        notes: Vec::new(),
        units,
        original: Original::Table,
        table,
    })
}

fn table(path: &Path, poses: Poses) -> Table {
    Table {
        name: path.display().to_string(),
        ..Table::from_poses(poses)
    }
}

/// The largest file that is read, bytes.
pub const LARGEST_MOTION_FILE: u64 = LARGEST_FILE;
