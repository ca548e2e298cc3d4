//! A file of motion of any format: its points as a pose table, and the way back into its own
//! format.

mod amc_skeleton;
mod aside;
#[cfg_attr(not(feature = "fbx"), path = "no_fbx.rs")]
mod fbx_take;
mod mirrored;
mod moved;
mod read_as;
mod read_rules;
mod retimed;
mod write_back;

#[doc(hidden)]
pub use amc_skeleton::skeleton_of;
#[doc(hidden)]
pub use fbx_take::rig_of_fbx;
pub use mirrored::MirrorImage;
pub use read_as::{Assumed, ReadAs, Source};
pub use read_rules::{ReadRules, Scope, Scoped};

use super::amc::{AmcFrames, AmcMotion, AmcReader, NO_RATE};
use super::asf::Asf;
use super::bvh::{Bvh, BvhPoints, BvhSkeleton, LARGEST_FILE};
use super::c3d::C3d;
use super::input::{Input, take_name};
use super::marker_take::{MarkerTake, Quantity};
use super::motion_format::MotionFormat;
use super::npz_take::NpzTake;
use super::row::TableOptions;
use super::table::Table;
use super::table_archive::is_table;
use super::zeros::empty_zeros;
use super::{keypoints, marker_csv, opensim, trc};
use crate::pose::{
    JointAngles, JointChannels, LengthUnit, Poses, Units, UpAxis, joints, kinematics,
};
use crate::{Error, Place, Result};
use aside::AllPoints;
use bytes::Bytes;
use ndarray::{Array2, ArrayView2};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file of motion.
///
/// ```
/// use posing_io::motion_file::{MotionFile, ReadOptions};
///
/// let folder = tempfile::tempdir()?;
/// let (path, copy) = (folder.path().join("walk.trc"), folder.path().join("new.trc"));
/// # let text = "PathFileType\t4\t(X/Y/Z)\twalk.trc\n\
/// #   DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n\
/// #   100\t100\t2\t1\tmm\nFrame#\tTime\tknee\n\t\tX1\tY1\tZ1\n\
/// #   1\t0.00\t10\t20\t30\n2\t0.01\t\t\t\n";
/// # std::fs::write(&path, text)?;
/// // A TRC file says its unit, but not which axis points up.
/// let options = ReadOptions { up: Some(posing_core::pose::UpAxis::Z), ..ReadOptions::default() };
/// let file = MotionFile::open(&path, &options)?;
/// let mut xyz = file.poses().xyz.clone(); // centimeters, y up
/// assert_eq!(xyz.row(0).to_vec(), [1.0, 3.0, -2.0]);
/// (0..3).for_each(|c| xyz[[1, c]] = xyz[[0, c]]);
/// file.write_back(&copy, xyz.view())?;
/// assert!(std::fs::read_to_string(&copy)?.contains("2\t0.01\t10\t20\t30"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct MotionFile {
    /// The format.
    pub format: MotionFormat,
    /// The points, in centimeters, y up; without computed ones ([`MotionFile::computed`]).
    pub table: Table,
    /// What it was taken for.
    pub read_as: ReadAs,
    /// What was odd, a line each.
    pub notes: Vec<String>,
    units: Units,
    /// What it was read by.
    options: ReadOptions,
    original: Original,
    /// All points, where some are computed.
    all: Option<Box<AllPoints>>,
}

/// What is taken for a file that does not say it.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Frames per second.
    pub fps: Option<f64>,
    /// The unit of length.
    pub units: Option<LengthUnit>,
    /// The axis that points up.
    pub up: Option<UpAxis>,
    /// Whether the axes are left-handed; those of FBX and AMC files say it themselves.
    pub left_handed: bool,
    /// The skeleton of AMC takes; `None`: the ASF file beside each whose name begins the take's.
    pub asf: Option<PathBuf>,
    /// The take of an FBX file that has several.
    pub take: Option<String>,
    /// The skeleton of an FBX file that has several: its root joint, or what stands above that.
    pub skeleton: Option<String>,
    /// The names of an array's points.
    pub joints: Option<Vec<String>>,
    /// Whether a file that ends early gives the frames that it has.
    pub keep_whole: bool,
    /// Whether positions at exactly 0 0 0 are missing (but those of rotations).
    pub zeros_are_missing: bool,
}

/// What the way back needs.
enum Original {
    C3d(Box<C3d>),
    Text(Bytes, Box<MarkerTake>),
    Npz(Box<NpzTake>),
    Bvh(Bytes, Box<Bvh>),
    /// With the bones whose ends are its points.
    Amc(Bytes, Box<AmcMotion>, Vec<usize>),
    Table,
}

impl MotionFile {
    /// Opens a file; gzip and zstd are decompressed.
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be read. [`Error::Data`]: it is damaged, or neither it nor an
    /// option says its rate, unit or axis.
    pub fn open(path: impl AsRef<Path>, options: &ReadOptions) -> Result<MotionFile> {
        let bytes = Input::open(&path)?.read_all(LARGEST_MOTION_FILE)?;
        MotionFile::read(path.as_ref(), bytes, options)
    }

    /// Opens a file by what is taken for those that do not say it; gzip and zstd are decompressed.
    ///
    /// # Errors
    /// Those of [`MotionFile::open`].
    pub fn open_by(path: impl AsRef<Path>, rules: &ReadRules) -> Result<MotionFile> {
        let bytes = Input::open(&path)?.read_all(LARGEST_MOTION_FILE)?;
        let options = rules.of(path.as_ref(), format_of(&bytes));
        MotionFile::read(path.as_ref(), bytes, &options)
    }

    /// Reads the bytes of a file; those of gzip and zstd are decompressed. `name` is for messages,
    /// and where the skeleton of an AMC take is looked for.
    ///
    /// ```
    /// use posing_io::{MotionFile, motion_file::ReadOptions};
    ///
    /// let bvh = std::fs::read("../../testdata/examples/animator/goblin.bvh")?;
    /// let file = MotionFile::from_bytes("goblin.bvh", bvh.clone(), &ReadOptions::default())?;
    /// assert_eq!(file.rate(), Some(30.0));
    /// assert_eq!(file.to_bytes()?, bvh);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: it is damaged, or neither it nor an option says its rate, unit or axis.
    pub fn from_bytes(
        name: impl AsRef<Path>,
        bytes: Vec<u8>,
        options: &ReadOptions,
    ) -> Result<MotionFile> {
        let shown = name.as_ref().display().to_string();
        let unpacked = Input::new(shown, Cursor::new(bytes))?.read_all(LARGEST_MOTION_FILE)?;
        MotionFile::read(name.as_ref(), unpacked, options)
    }

    /// Reads a file whose bytes, unpacked, are `bytes`.
    ///
    /// # Errors
    /// [`Error::Data`]: it is damaged, or neither it nor an option says its rate, unit or axis.
    #[doc(hidden)]
    pub fn read(path: &Path, bytes: Vec<u8>, options: &ReadOptions) -> Result<MotionFile> {
        let file = MotionFile::read_whole(path, bytes, options)?;
        if file.motion().is_some() {
            return Ok(file);
        }
        let listed = file.listed_as_computed();
        Ok(file.without_computed(&listed).without_zeros(options))
    }

    /// The file without positions at 0 0 0, where these are missing.
    fn without_zeros(mut self, options: &ReadOptions) -> MotionFile {
        if options.zeros_are_missing {
            empty_zeros(&mut self.table.poses.xyz);
        }
        self
    }

    /// Reads a file with all its points.
    fn read_whole(path: &Path, bytes: Vec<u8>, options: &ReadOptions) -> Result<MotionFile> {
        let name = path.display().to_string();
        let bytes = Bytes::from(bytes);
        let input = || Input::new(name.clone(), Cursor::new(bytes.clone()));
        if bytes.is_empty() {
            return Err(Error::data(Place::file(name), "is empty"));
        }
        let format = format_of(&bytes);
        let keep = options.keep_whole;
        match format {
            MotionFormat::C3d => {
                let c3d = C3d::read(input()?, keep)?;
                let take = c3d.take.clone();
                of_markers(path, format, &take, Original::C3d(Box::new(c3d)), options)
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
                of_markers(path, format, &take, original, options)
            }
            MotionFormat::Keypoints => {
                of_made(path, format, keypoints::read(input()?, keep)?, options)
            }
            MotionFormat::LongTable => {
                let take = marker_csv::read(input()?, None, keep)?;
                of_made(path, format, take, options)
            }
            MotionFormat::Bvh => {
                let units = custom_units(options);
                let bvh = Bvh::read(input()?, units.unit.centimeters(), keep)?;
                of_bvh(path, bvh, bytes, units, options)
            }
            MotionFormat::Amc => of_amc(path, input()?, bytes, options),
            MotionFormat::Fbx => fbx_take::of_fbx(path, input()?, options),
            MotionFormat::Asf => {
                let what = "is a skeleton without motion; AMC takes find it beside them";
                Err(Error::data(Place::file(name), what))
            }
            MotionFormat::Npz if options.joints.is_none() && is_table(&name, &bytes)? => {
                of_table(format, input()?, options)
            }
            MotionFormat::Npz => {
                let npz = NpzTake::read(input()?, options.joints.as_deref())?;
                let take = npz.take.clone();
                of_markers(path, format, &take, Original::Npz(Box::new(npz)), options)
            }
            MotionFormat::Csv | MotionFormat::Npy => of_table(format, input()?, options),
        }
    }

    /// The rate of its frames, where it has one.
    pub fn rate(&self) -> Option<f64> {
        self.read_as.rate.as_ref().map(|rate| rate.value)
    }

    /// Fails where `fps` contradicts the rate that the file says.
    ///
    /// # Errors
    /// [`Error::Usage`]: it does.
    #[doc(hidden)]
    pub fn check_rate(&self, fps: Option<f64>) -> Result<()> {
        match (self.rate(), fps) {
            (Some(own), Some(fps)) if (own - fps).abs() > 1e-4 * own => Err(Error::usage(format!(
                "the option `fps {fps}` contradicts {}, which has {own} frames per second; leave \
                 it out",
                self.table.name
            ))),
            _ => Ok(()),
        }
    }

    /// Its points, in centimeters, y up.
    pub fn poses(&self) -> &Poses {
        &self.table.poses
    }

    /// The unit and the axis of the file.
    pub fn units(&self) -> Units {
        self.units
    }

    /// The C3D file that it is; `None` of other formats.
    pub fn c3d(&self) -> Option<&C3d> {
        match &self.original {
            Original::C3d(file) => Some(file),
            _ => None,
        }
    }

    /// The BVH file that it is; `None` of other formats.
    pub fn bvh(&self) -> Option<&Bvh> {
        match &self.original {
            Original::Bvh(_, bvh) => Some(bvh),
            _ => None,
        }
    }

    /// The values of a file of rotations (frames, channels; radians and centimeters; NaN is
    /// missing), BVH or AMC.
    pub fn motion(&self) -> Option<ArrayView2<'_, f64>> {
        match &self.original {
            Original::Bvh(_, bvh) => Some(bvh.motion.view()),
            Original::Amc(_, amc, _) => Some(amc.values.view()),
            _ => None,
        }
    }

    /// The channels of each joint; none of a file without rotations.
    ///
    /// ```
    /// use posing_core::pose::rotation::Axis;
    /// use posing_io::{MotionFile, motion_file::ReadOptions};
    ///
    /// let file = "../../testdata/examples/animator/goblin.bvh";
    /// let file = MotionFile::open(file, &ReadOptions::default())?;
    /// let hips = &file.channels()[0];
    /// assert_eq!(hips.joint, "Hips");
    /// assert_eq!(hips.angles[0], (3, Axis::Y)); // the three columns before are its position
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    pub fn channels(&self) -> Vec<JointChannels> {
        match &self.original {
            Original::Bvh(_, bvh) => {
                let joints = bvh.joints.iter();
                JointChannels::all(joints.map(|j| (j.name.clone(), j.channels.clone())))
            }
            Original::Amc(_, amc, _) => amc.channels(),
            _ => Vec::new(),
        }
    }

    /// The positions (frames, 3 P; centimeters, y up) that follow from values of the channels; the
    /// file's own where it has no rotations.
    ///
    /// # Errors
    /// None for a file that was read.
    pub fn positions_of(&self, motion: ArrayView2<'_, f64>) -> Result<Array2<f64>> {
        match &self.original {
            Original::Bvh(_, bvh) => {
                let skeleton = BvhSkeleton::new(&bvh.joints, self.units.up.rotation(), true)?;
                Ok(skeleton.positions(motion, BvhPoints::Origins))
            }
            Original::Amc(_, amc, bones) => Ok(amc.positions(motion, bones)),
            _ => Ok(self.table.poses.xyz.clone()),
        }
    }

    /// The positions that the file lists as computed, by their indices among all its positions.
    fn listed_as_computed(&self) -> Vec<usize> {
        let Original::C3d(c3d) = &self.original else {
            return Vec::new();
        };
        let positions = c3d.take.positions().into_iter().enumerate();
        let is_listed = |(_, p): &(usize, usize)| c3d.take.quantity(*p) == Quantity::Computed;
        positions.filter(is_listed).map(|(at, _)| at).collect()
    }

    /// Takes values of channels, (frame, channel), for missing ones, and so the positions that
    /// follow from them. Files without rotations stay.
    ///
    /// # Errors
    /// None for a file that was read.
    #[doc(hidden)]
    pub fn empty_channels(&mut self, values: &[(usize, usize)]) -> Result<()> {
        let motion = match &mut self.original {
            Original::Bvh(_, bvh) => &mut bvh.motion,
            Original::Amc(_, amc, _) => &mut amc.values,
            _ => return Ok(()),
        };
        values.iter().for_each(|at| motion[*at] = f64::NAN);
        let motion = motion.clone();
        self.table.poses.xyz = self.positions_of(motion.view())?;
        Ok(())
    }

    /// The pairs of points to join in a picture: those of the file's skeleton, else by the points'
    /// names.
    ///
    /// # Errors
    /// [`Error::Data`]: the joints are no tree.
    #[doc(hidden)]
    pub fn bones(&self) -> Result<Vec<(usize, usize)>> {
        let Some(bvh) = self.bvh() else {
            return Ok(joints::bones(&self.table.poses.points));
        };
        let skeleton = BvhSkeleton::new(&bvh.joints, self.units.up.rotation(), true)?;
        Ok(skeleton.bones(BvhPoints::Origins))
    }

    /// The angles of its joints, where it has rotations.
    #[doc(hidden)]
    pub fn joint_angles(&self) -> Vec<JointAngles> {
        self.motion()
            .map_or(Vec::new(), |motion| self.joint_angles_of(motion))
    }

    /// The angles of its joints by values of its channels.
    #[doc(hidden)]
    pub fn joint_angles_of(&self, motion: ArrayView2<'_, f64>) -> Vec<JointAngles> {
        let channels = self.channels();
        channels
            .iter()
            .filter_map(|joint| joint.angles_in(motion))
            .collect()
    }
}

/// The unit and the axis of a format that does not say them.
fn custom_units(options: &ReadOptions) -> Units {
    Units {
        unit: options.units.unwrap_or(LengthUnit::Cm),
        up: options.up.unwrap_or(UpAxis::Y).handed(options.left_handed),
    }
}

fn read_as(rate: Option<Assumed<f64>>, units: Units, sources: [Source; 2]) -> ReadAs {
    let [unit, up] = sources;
    ReadAs {
        rate,
        unit: Assumed {
            value: units.unit.name().to_string(),
            from: unit,
        },
        up: Assumed {
            value: units.up.name().to_string(),
            from: up,
        },
    }
}

/// Where the unit and the axis of a format come from that does not say them.
fn custom_sources(options: &ReadOptions) -> [Source; 2] {
    [options.units.is_some(), options.up.is_some()].map(|given| {
        if given {
            Source::Option
        } else {
            Source::Custom
        }
    })
}

/// The rate: the file's, else the flag's.
fn rate_of(own: Option<f64>, options: &ReadOptions) -> Option<Assumed<f64>> {
    let taken = |from: Source| move |value: f64| Assumed { value, from };
    let flag = options.fps.map(taken(Source::Option));
    own.map(taken(Source::File)).or(flag)
}

fn of_markers(
    path: &Path,
    format: MotionFormat,
    take: &MarkerTake,
    original: Original,
    options: &ReadOptions,
) -> Result<MotionFile> {
    let inferred = [take.units_are_inferred, take.up_is_inferred];
    let said = [
        take.unit().is_some() && !(inferred[0] && options.units.is_some()),
        take.up_axis().is_some() && !(inferred[1] && options.up.is_some()),
    ];
    // Columns alone stay as they are.
    let mut units = if take.points.is_empty() {
        Units::CM_Y
    } else {
        take.units_or(
            options.units.filter(|_| !said[0]),
            options.up.filter(|_| !said[1]),
        )?
    };
    if options.left_handed && !take.points.is_empty() {
        units.up = units.up.handed(true);
    }
    let rate = rate_of(take.rate, options);
    let value = rate.as_ref().map(|rate| rate.value);
    let is_timed = take.times.is_some();
    let value = value
        .or(is_timed.then_some(1.0))
        .ok_or_else(|| take.asked_for("rate", None, "fps F` (frames per second)"))?;
    let sources = [0, 1].map(|i| match (said[i], inferred[i]) {
        (true, true) => Source::Custom,
        (true, false) => Source::File,
        (false, _) => Source::Option,
    });
    let mut notes = take.notes.clone();
    let positions = take.only_positions();
    let others = take.points.len() - positions.points.len();
    if others > 0 {
        notes.push(format!(
            "{others} points are angles, forces, moments or powers, and stay as they are"
        ));
    }
    Ok(MotionFile {
        format,
        table: table(path, positions.to_poses(units, value, &take_name(path))?),
        read_as: read_as(rate, units, sources),
        notes,
        units,
        options: options.clone(),
        original,
        all: None,
    })
}

/// A take whose format is not written: its way back is into a pose table.
fn of_made(
    path: &Path,
    format: MotionFormat,
    take: MarkerTake,
    options: &ReadOptions,
) -> Result<MotionFile> {
    let mut file = of_markers(path, format, &take, Original::Table, options)?;
    file.units = Units::CM_Y;
    Ok(file)
}

fn of_bvh(
    path: &Path,
    bvh: Bvh,
    bytes: Bytes,
    units: Units,
    options: &ReadOptions,
) -> Result<MotionFile> {
    let rate = rate_of(bvh.rate(), options);
    let value = bvh.rate_or(options.fps);
    let value = value.map_err(|e| e.at(Place::file(path.display().to_string())))?;
    let skeleton = BvhSkeleton::new(&bvh.joints, units.up.rotation(), true)?;
    let mut poses = bvh.positions(&skeleton, BvhPoints::Origins, value);
    poses.take = Some(vec![take_name(path).into(); poses.frames()]);
    Ok(MotionFile {
        format: MotionFormat::Bvh,
        table: table(path, poses),
        read_as: read_as(rate, units, custom_sources(options)),
        // Those of a motion file do not begin with its name.
        notes: bvh
            .notes
            .iter()
            .map(|note| without_name(note, path))
            .collect(),
        units,
        options: options.clone(),
        original: Original::Bvh(bytes, Box::new(bvh)),
        all: None,
    })
}

/// A note without the name of its file.
fn without_name(note: &str, path: &Path) -> String {
    let name = format!("{}: ", path.display());
    note.strip_prefix(&name).unwrap_or(note).to_string()
}

fn of_amc(path: &Path, input: Input, bytes: Bytes, options: &ReadOptions) -> Result<MotionFile> {
    let bad = |what: &str| Error::data(Place::file(path.display().to_string()), what);
    let rate = options.fps.ok_or_else(|| bad(NO_RATE))?;
    let asf = Asf::read(Input::open(skeleton_of(path, options)?)?, None)?;
    let mut reader = AmcReader::new(&asf, input, options.keep_whole)?;
    let bones = asf.skeleton.bones();
    let known: Option<Vec<usize>> = (joints::cmu_names().iter())
        .map(|name| asf.skeleton.find(name))
        .collect();
    let shown = known.unwrap_or_else(|| (0..bones.len()).collect());
    let (mut xyz, mut time) = (Vec::new(), Vec::new());
    let (mut frames, mut values) = (AmcFrames::default(), Vec::new());
    while reader.read_block(&mut frames)? {
        values.extend_from_slice(&frames.values);
        xyz.extend(frames.positions(&asf.skeleton, &shown, kinematics::Space::World));
        time.extend(frames.numbers.iter().map(|&n| (n as f64 - 1.0) / rate));
    }
    let (dropped, degrees) = (reader.dropped, reader.degrees());
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
    let units = Units::CM_Y;
    let of_skeleton = [Source::File, Source::Custom];
    Ok(MotionFile {
        format: MotionFormat::Amc,
        table: table(path, poses),
        read_as: read_as(rate_of(None, options), units, of_skeleton),
        notes: dropped.into_iter().collect(),
        units,
        options: options.clone(),
        original: Original::Amc(
            bytes,
            Box::new(AmcMotion {
                asf,
                values,
                degrees,
            }),
            shown,
        ),
        all: None,
    })
}

fn of_table(format: MotionFormat, input: Input, options: &ReadOptions) -> Result<MotionFile> {
    let table_options = TableOptions {
        joints: options.joints.clone(),
        cells: true,
        ..TableOptions::default()
    };
    let mut table = Table::read(input, &table_options)?;
    let units = custom_units(options);
    units.read_frames(&mut table.poses.xyz);
    (table.sd.iter_mut().flatten()).for_each(|sd| *sd *= units.unit.centimeters());
    let rate = rate_of(table.poses.rate(), options);
    Ok(MotionFile {
        format,
        read_as: read_as(rate, units, custom_sources(options)),
        notes: Vec::new(),
        units,
        options: options.clone(),
        original: Original::Table,
        table,
        all: None,
    })
}

fn table(path: &Path, poses: Poses) -> Table {
    Table {
        name: path.display().to_string(),
        ..Table::from_poses(poses)
    }
}

/// The format of a file that has these bytes.
#[doc(hidden)]
pub fn format_of(bytes: &[u8]) -> MotionFormat {
    MotionFormat::of(&bytes[..bytes.len().min(MOST_TITLES)])
}

/// The bytes that a file's titles may have.
const MOST_TITLES: usize = 1 << 18;

/// The largest file that is read, bytes.
pub const LARGEST_MOTION_FILE: u64 = LARGEST_FILE;
