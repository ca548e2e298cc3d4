//! What a file is taken for: by what it says itself, else by flags, else by the custom of its format.

use super::super::args::parse_rate;
use super::super::units::{Units, Up};
use crate::Result;
use crate::io::parse_point_names;
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;

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
    /// Point names for an array: 23 (the CMU joints), smpl (22, 24, 52 or 55 joints) or a comma-separated list
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// Accept files that end early (not tables): the whole frames before that are kept
    #[arg(long)]
    keep_whole: bool,
}

impl ReadArgs {
    /// Checks the flags.
    ///
    /// # Errors
    /// [`crate::Error::Usage`]: names of points that cannot be.
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
