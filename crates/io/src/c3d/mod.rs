//! C3D files: the trajectories of markers, as motion capture systems and biomechanists exchange
//! them.
//!
//! A file is blocks of 512 bytes: a header, a section of parameters, and frames of points, each
//! followed by that frame's samples of analog channels. Written as the C3D Format User Guide
//! (Motion Lab Systems, 2008) has it; what is known to be written otherwise is read with a note.

mod analog;
mod axes;
mod events;
mod extent;
mod force_plates;
mod header;
mod numbers;
mod outputs;
mod parameters;
mod points;
mod rename;
mod stored_parameters;
mod write;

pub use analog::Analog;
pub use events::FileEvent;
pub use force_plates::ForcePlate;
pub use outputs::OutputPoint;
pub(crate) use write::NewC3d;

use self::header::Layout;
use self::numbers::Processor;
use self::parameters::Parameters;
use super::input::Input;
use super::marker_take::{MarkerTake, Quantity, unique_names};
use super::motion_format::{is_c3d, recognized};
use crate::{Error, Place, Result};
use std::collections::HashMap;
use std::path::Path;

/// Larger files are refused, bytes.
const LIMIT: u64 = 1 << 31;
/// Rates that differ by a smaller share agree.
const SAME_RATE: f64 = 0.01;
/// The bytes of a block.
const BLOCK: usize = 512;

/// The parameters that list the points which hold a quantity.
const LISTS: [(&str, Quantity); 10] = [
    ("ANGLES", Quantity::Angles),
    ("FORCES", Quantity::Force),
    ("MOMENTS", Quantity::Moment),
    ("POWERS", Quantity::Power),
    ("SCALARS", Quantity::Scalar),
    ("MODELED_MARKERS", Quantity::Computed),
    ("BONES", Quantity::Computed),
    ("REACTIONS", Quantity::Computed),
    ("REFLECTIONS", Quantity::Computed),
    ("SYMBOLIC", Quantity::Computed),
];

/// A C3D file: its take of markers, and all of its bytes.
#[derive(Debug, Clone)]
pub struct C3d {
    /// The points; NaN where one is missing (its fourth word is below zero).
    pub take: MarkerTake,
    bytes: Vec<u8>,
    layout: Layout,
    parameters: Parameters,
}

impl C3d {
    /// Whether the numbers of the file hold a point (in its units and axes).
    pub(crate) fn holds(&self, point: [f64; 3]) -> bool {
        points::encode(Some(point), &self.layout).is_ok()
    }

    /// The numbers of a parameter, by its name in capitals (`PROCESSING:LLEGLENGTH`); none where it
    /// is not there. Integers of 16 bits are without their sign.
    pub fn numbers(&self, name: &str) -> &[f64] {
        self.parameters.numbers(name)
    }

    /// The parameters of a group that are numbers, by their names in the group: both in capitals.
    pub fn group<'a>(&'a self, group: &'a str) -> impl Iterator<Item = (&'a str, &'a [f64])> {
        self.parameters.numbers_of(group)
    }

    /// The texts of a parameter, by its name in capitals (`SUBJECTS:NAMES`), without the blanks at
    /// their ends; none where it is not there.
    pub fn texts(&self, name: &str) -> &[String] {
        self.parameters.texts(name)
    }

    /// Opens a file.
    ///
    /// ```
    /// use posing_io::C3d;
    ///
    /// let file = C3d::open("../../testdata/examples/biomechanist/gait.c3d")?;
    /// assert_eq!(file.take.rate, Some(60.0));
    /// assert_eq!(file.take.points[0], "LFHD");
    /// assert_eq!(file.take.xyz.ncols(), 3 * file.take.points.len());
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`C3d::read`].
    pub fn open(path: impl AsRef<Path>) -> Result<C3d> {
        C3d::read(Input::open(path)?, false)
    }

    /// Reads a file. With `keep_whole`, one that ends early gives the frames that it has.
    ///
    /// # Errors
    /// [`Error::Data`]: it is no C3D file, has no points or frames, or ends early. [`Error::Io`]:
    /// reading fails.
    pub fn read(input: Input, keep_whole: bool) -> Result<C3d> {
        let name = input.name.clone();
        let bad = |what: String| Error::data(Place::file(&name), what);
        let at = |e: Error| e.at(Place::file(&name));
        let other = what_else(input.first_bytes());
        let bytes = input.read_all(LIMIT)?;
        if !is_c3d(&bytes) {
            return Err(bad(other.into()));
        }
        let mut notes = Vec::new();
        let (processor, section) = parameter_section(&bytes, &mut notes).map_err(at)?;
        let parameters = Parameters::read(section, processor);
        if let Some(broken) = &parameters.broken {
            notes.push(format!("{broken}; the parameters after it are not read"));
        }
        let first = bytes.len() - section.len();
        let layout = Layout::read(
            &bytes,
            processor,
            &parameters,
            first,
            keep_whole,
            &mut notes,
        );
        let layout = layout.map_err(at)?;
        // The first block alone: beyond it, some files say more parameters than they have.
        if layout.start < first + BLOCK && first < layout.end() {
            return Err(bad("has frames where its parameters begin".into()));
        }
        let xyz = points::read(&bytes, &layout);
        let rate = rate(layout.rate, &parameters, &mut notes);
        let labels = labels(&parameters, layout.points);
        let quantities = quantities(&parameters, &labels);
        let points = unique_names(labels);
        let (up, up_is_inferred) = axes::up(&parameters, &points, xyz.view(), &mut notes);
        let take = MarkerTake {
            quantities,
            points,
            up,
            up_is_inferred,
            first_frame: layout.first_frame,
            rate,
            units: parameters.text("POINT:UNITS").map(str::to_string),
            notes,
            name,
            xyz,
            ..MarkerTake::default()
        };
        Ok(C3d {
            take,
            bytes,
            layout,
            parameters,
        })
    }
}

/// What a file that begins so is instead of a C3D file.
fn what_else(start: &[u8]) -> &'static str {
    match start {
        [] => "is empty, expected a C3D file",
        [_, 0x50, ..] => "is no C3D file: it is text alone",
        _ => recognized(start).unwrap_or("is no C3D file: its second byte is not 0x50"),
    }
}

/// The parameter section, and the processor that it names.
fn parameter_section<'a>(
    bytes: &'a [u8],
    notes: &mut Vec<String>,
) -> Result<(Processor, &'a [u8])> {
    let block = (bytes[0] as usize).max(2);
    if bytes[0] < 2 {
        notes.push(format!(
            "the parameters begin in block {}, taken for 2",
            bytes[0]
        ));
    }
    let section = bytes.get(BLOCK * (block - 1)..).filter(|s| s.len() >= 4);
    let section = section.ok_or("ends before its parameters")?;
    let processor = Processor::of_byte(section[3]).ok_or_else(|| {
        format!(
            "names the processor {}, expected 84 (Intel), 85 (DEC) or 86 (SGI)",
            section[3]
        )
    })?;
    Ok((processor, section))
}

/// Frames a second: the header's, else POINT:RATE. Where they differ, the one of which ANALOG:RATE
/// is a whole multiple, else POINT:RATE.
fn rate(header: f64, parameters: &Parameters, notes: &mut Vec<String>) -> Option<f64> {
    let is_rate = |rate: &f64| rate.is_finite() && *rate > 0.0;
    let own = parameters.number("POINT:RATE").filter(is_rate);
    let (header, own) = match (Some(header).filter(is_rate), own) {
        (Some(header), Some(own)) if (header - own).abs() > SAME_RATE * own => (header, own),
        (header, own) => return header.or(own),
    };
    let analog = parameters.number("ANALOG:RATE").filter(is_rate);
    let divides = |rate: f64| {
        let times = analog.map_or(0.0, |analog| analog / rate);
        times.round() >= 1.0 && (times - times.round()).abs() < 1e-3 * times
    };
    let (taken, which, why) = match (divides(header), divides(own)) {
        (true, false) => (
            header,
            "the header's",
            ", since ANALOG:RATE is a multiple of it",
        ),
        _ => (own, "POINT:RATE", ""),
    };
    let [header, own] = [header, own].map(|rate| (1e3 * rate).round() / 1e3);
    notes.push(format!(
        "its header says {header} frames per second, POINT:RATE {own}; {which} is taken{why}"
    ));
    Some(taken)
}

/// The labels of the points: POINT:LABELS, POINT:LABELS2 and so on.
fn labels(parameters: &Parameters, points: usize) -> Vec<&str> {
    let mut labels: Vec<&str> = parameters.all_texts("POINT:LABELS").collect();
    labels.resize(points, "");
    labels
}

/// A label without the subject's name before it.
fn own_name(label: &str) -> &str {
    label.rsplit(':').next().unwrap_or_default().trim()
}

/// What each point is: the parameters list angles and so on, as Vicon writes what its models
/// compute.
fn quantities(parameters: &Parameters, labels: &[&str]) -> Vec<Quantity> {
    let mut listed: HashMap<&str, Quantity> = HashMap::new();
    for (group, quantity) in LISTS {
        let name = format!("POINT:{group}");
        let labels = parameters.all_texts(&name).map(str::trim);
        for label in labels.filter(|label| !label.is_empty()) {
            listed.entry(label).or_insert(quantity);
        }
    }
    // A list may leave out the subject's prefix.
    let quantity = |label: &&str| {
        let known = listed.get(label.trim());
        let known = known.or_else(|| listed.get(own_name(label)));
        known.copied().unwrap_or_default()
    };
    labels.iter().map(quantity).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rate that is taken of a header's, POINT:RATE and ANALOG:RATE, and how many notes there
    /// are.
    fn rate_of(header: f64, own: f32, analog: f32) -> (Option<f64>, usize) {
        let mut section = vec![1, 0x50, 1, 84];
        section.extend(b"\x05\xffPOINT\x03\0\0\x06\xfeANALOG\x03\0\0");
        for (group, rate) in [(1, own), (2, analog)] {
            section.extend([&[4, group][..], b"RATE\x08\0\x04\0", &rate.to_le_bytes()].concat());
        }
        section.extend([0, 0]);
        let parameters = Parameters::read(&section, Processor::Intel);
        let mut notes = Vec::new();
        (rate(header, &parameters, &mut notes), notes.len())
    }

    #[test]
    fn rates_that_differ_are_told() {
        assert_eq!(rate_of(50.0, 100.0, 0.0), (Some(100.0), 1));
        assert_eq!(rate_of(50.0, 100.0, 1000.0), (Some(100.0), 1));
        assert_eq!(rate_of(120.0, 100.0, 1200.0), (Some(100.0), 1));
        assert_eq!(rate_of(120.0, 100.0, 960.0), (Some(120.0), 1));
        assert_eq!(rate_of(119.88, 120.0, 0.0), (Some(119.88), 0));
        assert_eq!(rate_of(0.0, 100.0, 0.0), (Some(100.0), 0));
        assert_eq!(rate_of(f64::NAN, 100.0, 0.0), (Some(100.0), 0));
        assert_eq!(rate_of(50.0, f32::NAN, 0.0), (Some(50.0), 0));
        assert_eq!(rate_of(-1.0, 0.0, 0.0), (None, 0));
    }
}
