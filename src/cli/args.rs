//! Flags that several commands share.

use super::choice::{choice, choices};
use super::paths::OutputPath;
use super::{memory_limit, messages};
use crate::io::TableFormat;
use crate::io::motion_file::ReadOptions;
use crate::io::{TableOptions, parse_point_names};
use crate::pose::Poses;
use crate::pose::units::{LengthUnit, Units, UpAxis};
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use glam::DMat3;
use std::ops::Range;
use std::path::{Path, PathBuf};

// Flags of every command; what stood here as documentation would be the description of each.
#[derive(Debug, Clone, Args)]
pub(crate) struct CommonArgs {
    /// Number of threads, 1 to 4096 (default: all processors); the result does not depend on it
    #[arg(long, value_name = "N", help_heading = "Shared")]
    pub threads: Option<usize>,
    /// Print errors only
    #[arg(short, long, help_heading = "Shared")]
    pub quiet: bool,
    /// Print more messages
    #[arg(short, long, conflicts_with = "quiet", help_heading = "Shared")]
    pub verbose: bool,
}

impl CommonArgs {
    /// Sets the number of threads and the verbosity; called once, first.
    pub(crate) fn apply(&self) -> Result<()> {
        messages::set_verbosity(self.quiet, self.verbose);
        if let Some(threads) = self.threads.filter(|n| !(1..=4096).contains(n)) {
            let what = format!("--threads {threads}: expected 1 to 4096");
            return Err(Error::usage(what));
        }
        memory_limit::make_pool(self.threads);
        Ok(())
    }
}

/// The tables of a command that reads centimeters, y up, with names of their points.
#[derive(Debug, Clone, Args)]
pub struct TableArgs {
    /// Pose tables, CSV, NPY or NPZ; - or nothing: standard input
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,
}

/// Tables whose rate counts.
#[derive(Debug, Clone, Args)]
pub struct TimedTableArgs {
    #[command(flatten)]
    tables: TableArgs,
    /// Frames per second, for a table without times
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
}

impl TableArgs {
    /// How the tables are read.
    pub fn input(&self) -> InputArgs {
        InputArgs::plain(self.files.clone(), None)
    }
}

impl TimedTableArgs {
    /// How the tables are read.
    pub fn input(&self) -> InputArgs {
        InputArgs::plain(self.tables.files.clone(), self.fps)
    }
}

/// The axis that points up in files that do not say it, and the hand of their axes: where a command
/// has the one, it has the other. `mut_arg` of a command says what the axis is otherwise.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct UpArgs {
    /// Axis of these files that points up [default: y]
    #[arg(long, value_parser = choice::<UpAxis>(), value_name = "AXIS", allow_hyphen_values = true)]
    pub up: Option<UpAxis>,
    /// Axes of these files are left-handed, as Unity's and Unreal's: one is reflected
    #[arg(long)]
    pub left_handed: bool,
}

impl UpArgs {
    /// The axis of the flag, else that of the file or of custom.
    pub fn or(self, own: UpAxis) -> UpAxis {
        self.up.unwrap_or(own).handed(self.left_handed)
    }

    /// The options of the library's reader of motion.
    pub fn options(self) -> ReadOptions {
        ReadOptions {
            up: self.up,
            left_handed: self.left_handed,
            ..ReadOptions::default()
        }
    }
}

/// The tables of a command that converts them.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("left_handed", |left| left.help_heading("Input").help(
    "Axes of the input are left-handed, as Unity's and Unreal's: one is reflected (FBX files say \
     it themselves)"
)))]
#[command(mut_arg("up", |up| up.help_heading("Input").help(
    "Axis of the input that points up [default: y; of AMASS' markers z]"
)))]
pub struct InputArgs {
    /// Pose tables, CSV, NPY or NPZ; - or nothing: standard input
    #[arg(value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Frames per second, for a table without times
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    pub fps: Option<f64>,
    /// Point names for an array: 23 (the CMU joints), smpl (22, 24, 52 or 55 joints) or a
    /// comma-separated list
    #[arg(long, value_name = "LIST", help_heading = "Input")]
    pub joints: Option<String>,
    /// Unit of length of the input [default: cm; of AMASS' markers m]
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT", help_heading = "Input")]
    pub units: Option<LengthUnit>,
    /// The axis that points up, and the hand of the axes.
    #[command(flatten)]
    pub axes: UpArgs,
}

impl InputArgs {
    /// Tables in centimeters, y up.
    pub fn plain(files: Vec<PathBuf>, fps: Option<f64>) -> InputArgs {
        InputArgs {
            files,
            fps,
            joints: None,
            units: None,
            axes: UpArgs::default(),
        }
    }

    /// The flags for other files.
    #[must_use]
    pub fn with_files(&self, files: Vec<PathBuf>) -> InputArgs {
        InputArgs {
            files,
            ..self.clone()
        }
    }

    /// The options of the library's reader.
    pub fn options(&self, planar: bool, cells: bool) -> Result<TableOptions> {
        let joints = self.joints.as_deref().map(parse_point_names).transpose()?;
        Ok(TableOptions {
            joints,
            planar,
            cells,
        })
    }

    /// The unit and the axis of the input.
    pub fn table_units(&self) -> Units {
        Units {
            unit: self.units.unwrap_or(LengthUnit::Cm),
            up: self.axes.or(UpAxis::Y),
        }
    }

    /// The rate of a table: from its times, or from `--fps`; they must not contradict each other.
    pub fn rate(&self, poses: &Poses) -> Result<Option<f64>> {
        let timed = 0..poses.time.as_ref().map_or(0, Vec::len);
        self.rate_of(poses, timed, poses.rate())
    }

    /// The rate of each take: from its times, or from `--fps`; they must not contradict each other.
    pub fn rates(&self, poses: &Poses) -> Result<Vec<Option<f64>>> {
        let takes = poses.takes().into_iter().zip(poses.rates());
        takes
            .map(|(take, own)| self.rate_of(poses, take, own))
            .collect()
    }

    /// The rate of some frames whose times give the rate `own`.
    fn rate_of(
        &self,
        poses: &Poses,
        frames: Range<usize>,
        own: Option<f64>,
    ) -> Result<Option<f64>> {
        match (own, self.fps) {
            (Some(_), Some(flag)) if poses.is_consistent_with_rate(frames, flag) => Ok(Some(flag)),
            (Some(table), Some(flag)) => Err(Error::usage(format!(
                "--fps {flag} contradicts the table's times ({table} frames per second); leave \
                 --fps out"
            ))),
            (table, flag) => Ok(table.or(flag)),
        }
    }
}

/// Parses a number that passes a test; the message says what is expected.
pub fn parse_if(
    text: &str,
    fits: impl Fn(f64) -> bool,
    expected: &str,
) -> std::result::Result<f64, String> {
    let number = text.parse().ok().filter(|v| fits(*v));
    number.ok_or_else(|| format!("expected {expected}"))
}

/// A rate: above zero.
pub fn parse_rate(text: &str) -> std::result::Result<f64, String> {
    let expected = "frames per second, above 0 to 1000000";
    parse_if(text, |v| v > 0.0 && v <= 1e6, expected)
}

/// A number above zero.
pub fn parse_positive(text: &str) -> std::result::Result<f64, String> {
    parse_if(text, |v| v.is_finite() && v > 0.0, "a number above 0")
}

/// A frequency with or without its unit.
pub fn parse_hertz(text: &str) -> std::result::Result<f64, String> {
    let digits = text
        .strip_suffix("Hz")
        .or(text.strip_suffix("hz"))
        .unwrap_or(text);
    parse_positive(digits).map_err(|_| "expected a frequency above 0, such as 6 or 6Hz".into())
}

/// The unit and the axis of files of meshes, which do not say them.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("up", |up| up.help_heading("Input")))]
#[command(mut_arg("left_handed", |left| left.help_heading("Input")))]
pub struct MeshUnitArgs {
    /// Unit of length of the input: its files have none
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT", help_heading = "Input")]
    units: LengthUnit,
    /// The axis that points up, and the hand of the axes.
    #[command(flatten)]
    pub axes: UpArgs,
}

impl MeshUnitArgs {
    /// The unit and the axis.
    pub fn table_units(&self) -> Units {
        Units {
            unit: self.units,
            up: self.axes.or(UpAxis::Y),
        }
    }
}

/// The unit and the axis of BVH files.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("up", |up| up.help(
    "Axis that points up in the BVH files written, and in a BVH skeleton [default: y]"
)))]
#[command(mut_arg("left_handed", |left| left.help(
    "Axes of the BVH files written, and of a BVH skeleton, are left-handed, as Unity's and \
     Unreal's; the input is right-handed (trim --left-handed --out-up y makes it so)"
)))]
pub struct BvhUnitArgs {
    /// Unit of length of the BVH files written, and of a BVH skeleton
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT", default_value = "cm")]
    units: LengthUnit,
    #[command(flatten)]
    axes: UpArgs,
}

impl BvhUnitArgs {
    /// The unit in centimeters.
    pub fn centimeters(&self) -> f64 {
        self.units.centimeters()
    }

    /// Whether one is asked for.
    pub fn is_given(&self) -> bool {
        self.units != LengthUnit::Cm || self.axes.up.is_some() || self.axes.left_handed
    }

    /// The rotation that carries the files' axes to y up.
    pub fn rotation(&self) -> DMat3 {
        self.axes.or(UpAxis::Y).rotation()
    }
}

/// The output table of a command.
#[derive(Debug, Clone, Args)]
pub struct OutputArgs {
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub output: Option<OutputPath>,
    /// Output format (default: by FILE's extension, else csv)
    #[arg(
        long,
        value_parser = choice::<TableFormat>(),
        value_name = "FORMAT",
        help_heading = "Output"
    )]
    pub to: Option<TableFormat>,
}

/// The unit and the axis of the output of a command that converts tables.
#[derive(Debug, Clone, Args)]
pub struct OutUnitArgs {
    /// Unit of length of the output (default: that of an input table, else cm)
    #[arg(
        long,
        value_parser = choice::<LengthUnit>(),
        value_name = "UNIT",
        help_heading = "Output"
    )]
    out_units: Option<LengthUnit>,
    /// Axis of the output that points up (default: that of an input table, else y)
    #[arg(long, value_parser = choice::<UpAxis>(), value_name = "AXIS", help_heading = "Output")]
    #[arg(allow_hyphen_values = true)]
    out_up: Option<UpAxis>,
}

impl OutputArgs {
    /// The format of `--to`, else that of the file's name, else CSV.
    pub fn format(&self) -> TableFormat {
        let named = self.output.as_ref().map(TableFormat::of_path);
        self.to.or(named).unwrap_or(TableFormat::Csv)
    }
}

impl OutUnitArgs {
    /// Whether one is given.
    pub fn are_given(&self) -> bool {
        self.out_units.is_some() || self.out_up.is_some()
    }

    /// The unit and the axis of the output, given those of the input table.
    pub fn table_units(&self, input: Units) -> Units {
        Units {
            unit: self.out_units.unwrap_or(input.unit),
            up: self.out_up.unwrap_or(input.up),
        }
    }
}

/// The space in which poses are restored or learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Space {
    /// Each pose is moved to the model's space and back.
    World,
    /// Rows are used as they are: root at the origin, no global rotation.
    Body,
}

choices!(Space {
    World "world": "Move each pose to the model's space and back";
    Body "body": "Use rows as they are: root at the origin, no global rotation";
});

/// Whether outliers are detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OutlierDetection {
    /// Detect and replace outliers
    Auto,
    /// Use every point as measured
    None,
}

/// The format of `--to`, else that of the file's extension.
///
/// # Errors
/// [`crate::Error::Usage`]: neither gives a format.
pub fn format_of<F: ValueEnum>(to: Option<F>, output: Option<&Path>) -> Result<F> {
    let extension = output.and_then(Path::extension);
    let extension = extension.map(|e| e.to_string_lossy().to_lowercase());
    let named = extension.map(|e| match &*e {
        "htm" => F::from_str("html", false),
        name => F::from_str(name, false),
    });
    let found = to.or(named.and_then(std::result::Result::ok));
    found.ok_or_else(|| {
        let all = F::value_variants().iter();
        let names = all.filter_map(|value| Some(value.to_possible_value()?.get_name().to_string()));
        let names: Vec<String> = names.collect();
        let files: String = names.iter().map(|n| format!("-o FILE.{n}, ")).collect();
        Error::usage(format!(
            "choose a format: {files}or --to {}",
            names.join("|")
        ))
    })
}

/// The seed of a command.
#[derive(Debug, Clone, Args)]
pub struct SeedArgs {
    /// Seed of the random numbers; the same seed gives the same result
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Shared")]
    pub seed: u64,
}

/// The flag that takes positions at 0 0 0 for missing ones.
#[derive(Debug, Clone, Copy, Default, Args)]
pub(crate) struct ZeroArgs {
    /// Take positions of exactly 0 0 0 for missing ones, as some programs write them (not those of
    /// BVH and AMC files)
    #[arg(long)]
    pub zeros_are_missing: bool,
}
