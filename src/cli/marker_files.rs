//! Takes of markers as tables: what a file says of its rate, unit and axes, or else the flags.

use super::args::{CommonArgs, OutputArgs, parse_rate, value_name};
use super::input::{open, take_name};
use super::marker_units::{axis_of, unit_of};
use super::messages;
use super::model_outputs;
use super::streams::write_table;
use super::units::{TableUnits, Units, Up};
use super::zeros::{ZeroArgs, count_zeros, empty_zeros};
use crate::io::csv::{AddedColumn, After};
use crate::io::text::check_length;
use crate::io::{CarriedColumns, Input, MarkerTake, Quantity, Table};
use crate::pose::Poses;
use crate::{Error, Place, Result};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The unit and the axis of a file of markers, if it does not say them.
#[derive(Debug, Clone, Args)]
pub struct MarkerUnitArgs {
    /// Unit of length of the file [default: what the file says]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub units: Option<Units>,
    /// Axis of the file that points up [default: what the file says]
    #[arg(long, value_enum, value_name = "AXIS")]
    pub up: Option<Up>,
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
    #[command(flatten)]
    common: CommonArgs,
}

impl MarkerUnitArgs {
    /// The unit and the axis: the flags', else the file's.
    ///
    /// # Errors
    /// [`Error::Data`] if neither says one.
    pub fn table_units(&self, take: &MarkerTake) -> Result<TableUnits> {
        let said = take.units.as_deref().and_then(unit_of);
        let unit = self.units.or(said).ok_or_else(|| {
            asked(
                take,
                "unit",
                take.units.as_deref(),
                "--units mm (or cm, m, in)",
            )
        })?;
        if let (Some(given), Some(said)) = (self.units, said)
            && given != said
            && !take.units_are_inferred
        {
            messages::info(&format!(
                "{}: says that its unit is {}; it is taken for {}, as --units says",
                take.name,
                value_name(said),
                value_name(given)
            ));
        }
        let up = (self.up)
            .or(take.up.as_deref().and_then(axis_of))
            .ok_or_else(|| asked(take, "up axis", take.up.as_deref(), "--up z (or x, y)"))?;
        Ok(TableUnits { unit, up })
    }
}

impl MarkerFileArgs {
    /// Reads the file with `read`, which is told whether one that ends early is accepted, and writes its positions as a table; its points
    /// that are none become columns of their own with `model_outputs`.
    ///
    /// # Errors
    /// Those of `read`; [`Error::Data`] if neither the file nor a flag says the rate, the unit or the axis; [`Error::Usage`] if a flag
    /// contradicts the rate of the file.
    pub fn convert(
        &self,
        read: impl Fn(Input, bool) -> Result<MarkerTake>,
        model_outputs: bool,
    ) -> Result<()> {
        self.common.apply()?;
        let path = self.file.clone().unwrap_or_else(|| PathBuf::from("-"));
        let mut input = open(&path)?;
        // A file of another format is named.
        input.look_ahead()?;
        let take = read(input, self.keep_whole)?;
        let said = |n: &String| messages::info(&format!("{}: {n}", take.name));
        take.notes.iter().for_each(said);
        let mut positions = take.only_positions();
        match self.zeros.zeros_are_missing {
            true => empty_zeros(&mut positions.xyz),
            false => report_zeros(&positions),
        }
        if !model_outputs {
            report_model_outputs(&take);
        }
        // Columns alone stay as they are.
        let units = match take.points.is_empty() {
            true => TableUnits::CM_Y,
            false => self.units.table_units(&take)?,
        };
        let poses = poses_of_markers(&positions, units, self.rate(&take)?, &path)?;
        let table = Table::from_poses(poses);
        let xyz = table.poses.xyz.view();
        let carried = Carried::new(&take);
        let mut added = carried.columns();
        if model_outputs {
            added.extend(model_outputs::columns(&take));
        }
        write_table(&self.out, TableUnits::CM_Y, &table, xyz, &added, |frame| {
            let mut cells = carried.cells(frame);
            if model_outputs {
                cells.extend(model_outputs::cells(&take, frame));
            }
            cells
        })
    }

    /// Frames a second: the file's, else the flag's.
    fn rate(&self, take: &MarkerTake) -> Result<f64> {
        match (take.rate, self.fps) {
            (Some(rate), Some(fps)) if (fps - rate).abs() > 1e-4 * rate => {
                Err(Error::usage(format!(
                    "--fps {fps} contradicts {}, which has {rate} frames per second; leave --fps out",
                    take.name
                )))
            }
            (Some(rate), _) | (None, Some(rate)) => Ok(rate),
            // The times of the rows are known, if not how many a second.
            (None, None) if take.times.is_some() => Ok(1.0),
            (None, None) => Err(asked(take, "rate", None, "--fps F (frames per second)")),
        }
    }
}

/// What is neither in the file nor given.
pub fn asked(take: &MarkerTake, what: &str, said: Option<&str>, flag: &str) -> Error {
    let what = match said {
        Some(said) => {
            format!("says \"{said}\" of its {what}, which is not understood; give it with {flag}")
        }
        None => format!("does not say its {what}; give it with {flag}"),
    };
    Error::data(Place::file(&take.name), what)
}

/// Reports points that are no positions.
fn report_model_outputs(take: &MarkerTake) {
    let is_other = |p: &usize| take.quantity(*p) != Quantity::Position;
    let others: Vec<usize> = (0..take.points.len()).filter(is_other).collect();
    if let [first, ..] = others[..] {
        messages::info(&format!(
            "{}: {} points are angles, forces, moments or powers ({} and so on) and left out; --model-outputs writes them as columns of their own",
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
            "{}: {zeros} positions are exactly 0 0 0, which some programs write for missing points; they are kept (--zeros-are-missing empties them)",
            take.name
        ));
    }
}

/// The columns of a take that are carried along, frame by frame.
pub struct Carried<'a> {
    columns: &'a CarriedColumns,
    /// The row of each frame; `None` of a frame that the file leaves out.
    rows: Vec<Option<usize>>,
}

impl<'a> Carried<'a> {
    /// Those of a take.
    pub fn new(take: &'a MarkerTake) -> Carried<'a> {
        let mut row = 0..take.carried.rows.len();
        let rows = match take.points.is_empty() {
            true => row.map(Some).collect(),
            false => (take.cells.lines.iter())
                .map(|line| line.and_then(|_| row.next()))
                .collect(),
        };
        Carried {
            columns: &take.carried,
            rows,
        }
    }

    /// The columns, behind all others.
    pub fn columns(&self) -> Vec<AddedColumn> {
        let names = self.columns.names.iter();
        names
            .map(|name| AddedColumn::new(name, After::All))
            .collect()
    }

    /// The cells of a frame.
    pub fn cells(&self, frame: usize) -> Vec<String> {
        let row = self.rows.get(frame).copied().flatten();
        let row = row.and_then(|row| self.columns.rows.get(row));
        let text = |column: usize| {
            let cell = row.and_then(|row| row.get(column)).unwrap_or_default();
            String::from_utf8_lossy(cell).into_owned()
        };
        (0..self.columns.names.len()).map(text).collect()
    }
}

/// The points of a take in centimetres, y up, a frame a row; its name is that of the file.
pub fn poses_of_markers(
    take: &MarkerTake,
    units: TableUnits,
    rate: f64,
    path: &Path,
) -> Result<Poses> {
    let mut xyz = take.xyz.clone();
    units.read_frames(&mut xyz);
    for (t, row) in xyz.rows().into_iter().enumerate() {
        let present = row.iter().filter(|v| !v.is_nan());
        let checked: std::result::Result<Vec<f64>, String> =
            present.map(|v| check_length(*v)).collect();
        checked.map_err(|what| {
            let frame = format!("frame {}", u64::from(take.first_frame) + t as u64);
            Error::data(Place::file(&take.name).part(frame), what)
        })?;
    }
    let name: Arc<str> = take_name(path).into();
    let first = f64::from(take.first_frame) - 1.0;
    let by_number = || (0..xyz.nrows()).map(|t| (first + t as f64) / rate);
    let times = take.times.clone().unwrap_or_else(|| by_number().collect());
    Ok(Poses {
        points: take.points.clone(),
        time: Some(times),
        take: Some(vec![name; xyz.nrows()]),
        xyz,
    })
}
