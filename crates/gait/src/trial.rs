//! A trial: all that a file or its maker gives of a walk.

use crate::io::{C3d, FileEvent};
use crate::markers::Markers;
use crate::parameters::GivenValues;
use crate::plate::Plate;
use crate::pose::{LengthUnit, Units, UpAxis};
use crate::{Error, Result};

/// A walk, or a person who stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// The tracks of the markers.
    pub markers: Markers,
    /// Frames a second.
    pub rate: f64,
    /// The number of the first frame; frame 1 is at 0 s.
    pub first_frame: u32,
    /// The force plates in the file's order; `None` in the place of one that is not read.
    pub plates: Vec<Option<Plate>>,
    /// The subject's parameters that are stored with the trial.
    pub given: GivenValues,
    /// The events that are stored with the trial.
    pub file_events: Vec<FileEvent>,
    /// The gaps of its markers that were filled or left: [`Trial::filled`].
    pub gaps: Vec<FilledGap>,
}

/// A gap of a marker, within its span.
#[derive(Debug, Clone, PartialEq)]
pub struct FilledGap {
    /// The marker.
    pub marker: &'static str,
    /// Its first frame and the one behind its last, counted from 0.
    pub frames: [usize; 2],
    /// The standard deviation of the filled positions along an axis, root mean square, mm; `None`
    /// where the gap was left.
    pub sd_mm: Option<f64>,
    /// The largest of these deviations, mm; 0 where the gap was left.
    pub largest_mm: f64,
}

impl Trial {
    /// A trial of markers alone, from frame 1.
    pub fn new(markers: Markers, rate: f64) -> Trial {
        Trial {
            markers,
            rate,
            first_frame: 1,
            plates: Vec::new(),
            given: GivenValues::default(),
            file_events: Vec::new(),
            gaps: Vec::new(),
        }
    }

    /// What a C3D file holds. `unit` and `up` go before what it says of them. Points that a model
    /// computed, and stored angles and forces, are not read.
    ///
    /// # Errors
    /// [`Error::Data`]: it does not say its unit, its axis that is up, or its rate.
    pub fn from_c3d(file: &C3d, unit: Option<LengthUnit>, up: Option<UpAxis>) -> Result<Trial> {
        let take = file.take.only_positions();
        let units = take.units_or(unit, up)?;
        let rate = take
            .rate
            .ok_or_else(|| Error::unfit("does not say its rate"));
        let rate = rate.map_err(|e| e.at(crate::Place::file(&take.name)))?;
        let poses = take.to_poses(units, rate, "")?;
        Ok(Trial {
            first_frame: take.first_frame,
            plates: plates(file, units),
            given: GivenValues::of_c3d(file),
            file_events: file.events(),
            ..Trial::new(Markers::from_poses(&poses), rate)
        })
    }

    /// The time of the first frame, seconds.
    pub(crate) fn first(&self) -> f64 {
        (f64::from(self.first_frame) - 1.0) / self.rate
    }

    /// The time of a frame, counted from 0, in seconds; frame 1 of the file is at 0.
    pub fn time(&self, frame: usize) -> f64 {
        self.first() + frame as f64 / self.rate
    }

    /// The place of a time among the frames, counted from 0.
    pub fn place(&self, time: f64) -> f64 {
        (time - self.first()) * self.rate
    }
}

/// The plates of a file in the laboratory's axes, z up.
fn plates(file: &C3d, units: Units) -> Vec<Option<Plate>> {
    let plates = Plate::of_file(file, units, UpAxis::Z);
    plates.into_iter().map(Result::ok).collect()
}
