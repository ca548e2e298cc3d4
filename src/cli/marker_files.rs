//! Takes of markers as tables: what a file says of its rate, unit and axes, or else the flags.

use super::args::{OutputArgs, UpArgs, ZeroArgs, parse_rate};
use super::choice::choice;
use super::input::open;
use super::messages;
use super::streams::write_table;
use crate::io::input::take_name;
use crate::io::zeros::{count_zeros, empty_zeros};
use crate::io::{Input, MarkerTake, Table, model_outputs};
use crate::pose::{LengthUnit, Units};
use crate::{Error, Result};
use clap::Args;
use std::path::PathBuf;

/// The unit and the axis of a file of markers, if it does not say them.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("up", |up| up.help(
    "Axis of the file that points up [default: what the file says]"
)))]
pub struct MarkerUnitArgs {
    /// Unit of length of the file [default: what the file says]
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT")]
    pub units: Option<LengthUnit>,
    /// The axis that points up, and the hand of the axes.
    #[command(flatten)]
    pub axes: UpArgs,
}

/// The flags of commands that convert a file of markers.
#[derive(Debug, Clone, Args)]
pub struct MarkerFileArgs {
    /// The file; - or nothing: standard input
    #[arg(value_name = "FILE")]
    pub file: Option<PathBuf>,
    #[command(flatten)]
    units: MarkerUnitArgs,
    /// Frames per second, if the file does not say
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    pub fps: Option<f64>,
    /// Accept a file that ends early: the whole frames before that are kept
    #[arg(long)]
    pub keep_whole: bool,
    #[command(flatten)]
    zeros: ZeroArgs,
    #[command(flatten)]
    out: OutputArgs,
}

impl MarkerUnitArgs {
    /// The unit and the axis: the flags', else the file's.
    ///
    /// # Errors
    /// [`Error::Data`] if neither says one.
    pub fn table_units(&self, take: &MarkerTake) -> Result<Units> {
        if let (Some(given), Some(said)) = (self.units, take.unit())
            && given != said
            && !take.units_are_inferred
        {
            messages::info(&format!(
                "{}: says that its unit is {}; it is taken for {}, as --units says",
                take.name,
                said.name(),
                given.name()
            ));
        }
        let Units { unit, up } = take.units_or(self.units, self.axes.up)?;
        let up = up.handed(self.axes.left_handed);
        Ok(Units { unit, up })
    }
}

impl MarkerFileArgs {
    /// Reads the file with `read`, which is told whether one that ends early is accepted, and
    /// writes its positions as a table; its points that are none become columns of their own
    /// with `model_outputs`.
    ///
    /// # Errors
    /// Those of `read`; [`Error::Data`] if neither the file nor a flag says the rate, the unit or
    /// the axis; [`Error::Usage`] if a flag contradicts the rate of the file.
    pub fn convert(
        &self,
        read: impl Fn(Input, bool) -> Result<MarkerTake>,
        model_outputs: bool,
    ) -> Result<()> {
        let path = self.file.clone().unwrap_or_else(|| PathBuf::from("-"));
        let mut input = open(&path)?;
        // A file of another format is named.
        input.look_ahead()?;
        let take = &read(input, self.keep_whole)?;
        let said = |n: &String| messages::info(&format!("{}: {n}", take.name));
        take.notes.iter().for_each(said);
        let mut positions = take.only_positions();
        if self.zeros.zeros_are_missing {
            empty_zeros(&mut positions.xyz)
        } else {
            report_zeros(&positions)
        }
        if !model_outputs {
            report_model_outputs(take);
        }
        // Columns alone stay as they are.
        let units = if take.points.is_empty() {
            Units::CM_Y
        } else {
            self.units.table_units(take)?
        };
        let poses = positions.to_poses(units, self.rate(take)?, &take_name(&path))?;
        let table = Table::from_poses(poses);
        let xyz = table.poses.xyz.view();
        let carried = take.carried_rows();
        let mut added = carried.columns();
        if model_outputs {
            added.extend(model_outputs::columns(take));
        }
        write_table(&self.out, [Units::CM_Y; 2], &table, xyz, &added, |frame| {
            let mut cells = carried.cells(frame);
            if model_outputs {
                cells.extend(model_outputs::cells(take, frame));
            }
            cells
        })
    }

    /// Frames a second: the file's, else the flag's.
    fn rate(&self, take: &MarkerTake) -> Result<f64> {
        match (take.rate, self.fps) {
            (Some(rate), Some(fps)) if (fps - rate).abs() > 1e-4 * rate => {
                Err(Error::usage(format!(
                    "--fps {fps} contradicts {}, which has {rate} frames per second; leave --fps \
                     out",
                    take.name
                )))
            }
            (Some(rate), _) | (None, Some(rate)) => Ok(rate),
            // The times of the rows are known, if not how many a second.
            (None, None) if take.times.is_some() => Ok(1.0),
            (None, None) => Err(take.asked_for("rate", None, "fps F` (frames per second)")),
        }
    }
}

/// Reports points that are no positions.
fn report_model_outputs(take: &MarkerTake) {
    let is_other = |p: &usize| !take.quantity(*p).is_position();
    let others: Vec<usize> = (0..take.points.len()).filter(is_other).collect();
    if let [first, ..] = others[..] {
        messages::info(&format!(
            "{}: {} points are angles, forces, moments or powers ({} and so on) and left out; \
             --model-outputs writes them as columns of their own",
            take.name,
            others.len(),
            take.points[first]
        ));
    }
}

/// Reports positions at 0 0 0, which stay.
fn report_zeros(take: &MarkerTake) {
    let zeros = count_zeros(take.xyz.view());
    if zeros > 0 {
        messages::info(&format!(
            "{}: {zeros} positions are exactly 0 0 0, which some programs write for missing \
             points; they are kept (--zeros-are-missing empties them)",
            take.name
        ));
    }
}
