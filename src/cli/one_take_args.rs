//! The flags of commands that write one take of a table to a file: the take, its rate, its first
//! frame's number.

use super::args::{InputArgs, parse_rate};
use super::ik::report_time_jumps;
use super::input::{check_single_stdin, or_stdin, read_table};
use super::paths::OutputPath;
use super::streams::write_bytes;
use crate::io::NewTake;
use crate::pose::Poses;
use crate::pose::units::Units;
use crate::{Error, Place, Result};
use clap::Args;
use ndarray::Array2;
use std::path::PathBuf;

/// The flags of commands that write one take to a file.
#[derive(Debug, Clone, Args)]
pub struct OneTakeArgs {
    /// Pose tables, CSV, NPY or NPZ; - or nothing: standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<OutputPath>,
    /// Take to write, if the table has several
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Frames per second, for a table without times
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
}

/// One take of a table.
#[derive(Debug)]
pub struct OneTake {
    /// Its frames, in centimeters, y up.
    pub poses: Poses,
    /// Standard deviations of the points (frames, points), cm, where the table has them.
    pub sd: Option<Array2<f64>>,
    /// The table's name in messages.
    pub table: String,
}

impl OneTakeArgs {
    /// Reads the take; `other` is a file that is read too.
    pub fn read(&self, other: Option<&PathBuf>) -> Result<OneTake> {
        let files = or_stdin(&self.files);
        check_single_stdin(files.iter().chain(other))?;
        let table = read_table(&self.input(), false, true)?;
        let name = table.name.clone();
        let (poses, sd) = table.one_take(self.take.as_deref())?;
        let table = name;
        Ok(OneTake { poses, sd, table })
    }

    /// What a new file of a `format` such as `TRC` says of the take.
    pub fn new_take(&self, one: OneTake, units: Units, format: &str) -> Result<NewTake> {
        let OneTake { poses, table, .. } = one;
        let rate = match self.input().rate(&poses)? {
            Some(rate) => rate,
            None if poses.frames() == 1 => 1.0,
            None => {
                let what =
                    format!("has no times, and {format} files need a rate; give it with --fps");
                return Err(Error::data(Place::file(table), what));
            }
        };
        report_time_jumps(&poses, &table, &format!("a {format} file"));
        Ok(NewTake::new(poses, rate, units))
    }

    /// Writes the file.
    pub fn write(&self, bytes: &[u8], binary: bool) -> Result<()> {
        write_bytes(self.output.as_deref(), bytes, binary)
    }

    fn input(&self) -> InputArgs {
        InputArgs::plain(self.files.clone(), self.fps)
    }
}
