//! What a file is taken for: by what it says itself, else by flags, else by the custom of its format.

use super::scoped::{Scoped, parse_scoped_rate, parse_scoped_units, parse_scoped_up};
use crate::Result;
use crate::cli::units::{Units, Up};
use crate::cli::zeros::ZeroArgs;
use crate::io::{MotionFormat, parse_point_names};
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What is taken for files that do not say it.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Input")]
pub struct ReadArgs {
    /// Frames per second of files that do not say it; c3d=100 is for files of a format, FOLDER=100 for those of a folder, which counts
    /// first; several parted by commas, or the flag again
    #[arg(long, value_name = "[FORMAT|FOLDER=]F", value_delimiter = ',', value_parser = parse_scoped_rate)]
    fps: Vec<Scoped<f64>>,
    /// Unit of length of files that do not say it (BVH files and tables: cm): cm, m, mm, in or asf; for a format or a folder as for --fps
    #[arg(long, value_name = "[FORMAT|FOLDER=]UNIT", value_delimiter = ',', value_parser = parse_scoped_units)]
    units: Vec<Scoped<Units>>,
    /// Axis that points up in files that do not say it (BVH files and tables: y): x, y or z; for a format or a folder as for --fps
    #[arg(long, value_name = "[FORMAT|FOLDER=]AXIS", value_delimiter = ',', value_parser = parse_scoped_up)]
    up: Vec<Scoped<Up>>,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's: 07.asf for 07_01.amc]
    #[arg(long, value_name = "SUBJECT.asf")]
    asf: Option<PathBuf>,
    /// Point names for an array: 23 (the CMU joints), smpl (22, 24, 52 or 55 joints) or a comma-separated list
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// Accept files that end early (not tables): the whole frames before that are kept
    #[arg(long)]
    keep_whole: bool,
    #[command(flatten)]
    zeros: ZeroArgs,
}

impl ReadArgs {
    /// Checks the flags.
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: names of points that cannot be.
    pub fn flags(&self) -> Result<ReadFlags> {
        Ok(ReadFlags {
            scoped: ScopedFlags {
                fps: self.fps.clone(),
                units: self.units.clone(),
                up: self.up.clone(),
            },
            asf: self.asf.clone(),
            joints: self.joints.as_deref().map(parse_point_names).transpose()?,
            keep_whole: self.keep_whole,
            zeros_are_missing: self.zeros.zeros_are_missing,
            ..ReadFlags::default()
        })
    }
}

/// Values for all files, formats and folders.
#[derive(Debug, Clone, Default)]
struct ScopedFlags {
    fps: Vec<Scoped<f64>>,
    units: Vec<Scoped<Units>>,
    up: Vec<Scoped<Up>>,
}

/// What is taken for a file that does not say it. [`ReadFlags::of`] gives it for a file at hand.
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
    /// Whether positions at exactly 0 0 0 are missing (but those of rotations).
    pub zeros_are_missing: bool,
    /// The flags from which fps, units and up are taken.
    scoped: ScopedFlags,
}

impl ReadFlags {
    /// What is taken for a file of this format.
    pub fn of(&self, path: &Path, format: MotionFormat) -> ReadFlags {
        let scoped = &self.scoped;
        ReadFlags {
            fps: Scoped::of(&scoped.fps, path, format).or(self.fps),
            units: Scoped::of(&scoped.units, path, format).or(self.units),
            up: Scoped::of(&scoped.up, path, format).or(self.up),
            scoped: ScopedFlags::default(),
            ..self.clone()
        }
    }
}

/// Where something that was taken for true comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The file says so.
    File,
    /// A flag does.
    Flag,
    /// The custom of the format.
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
