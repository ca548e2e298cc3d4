#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Gait by Vicon's Plug-in Gait: joint centers, angles, forces, moments, events, cycles and values
//! from markers and force plates.
//!
//! A [`Trial`] is markers, a rate and what else its file holds; [`GaitTrial`] is what is computed
//! of it: curves by Plug-in Gait's names, events with their sources, cycles with their values, and
//! what is unsure. Lengths are millimeters in the axes of the laboratory with z up, angles degrees
//! of the human joint as Plug-in Gait defines them, forces and moments per kilogram of the body.
//!
//! ```
//! use glam::DVec3;
//! use posing_gait::{GaitSettings, GaitTrial, Markers, Trial};
//!
//! // The left leg of somebody who stands and faces +x, millimeters, z up.
//! let places = [
//!     ("LASI", [100.0, 115.0, 950.0]), ("RASI", [100.0, -115.0, 950.0]),
//!     ("SACR", [-90.0, 0.0, 960.0]), ("LTHI", [10.0, 180.0, 700.0]),
//!     ("LKNE", [15.0, 160.0, 500.0]), ("LTIB", [-5.0, 170.0, 300.0]),
//!     ("LANK", [-20.0, 145.0, 90.0]), ("LHEE", [-80.0, 110.0, 40.0]),
//!     ("LTOE", [130.0, 120.0, 50.0]),
//! ];
//! let tracks = places.map(|(name, place)| (name, vec![DVec3::from_array(place); 10]));
//! let trial = Trial::new(Markers::new(tracks)?, 100.0);
//! let mut settings = GaitSettings::default();
//! for (name, value) in [("LegLength", 850.0), ("KneeWidth", 100.0), ("AnkleWidth", 65.0)] {
//!     ["L", "R"].iter().for_each(|side| settings.given.set(&format!("{side}{name}"), value));
//! }
//! let gait = GaitTrial::new(&trial, None, &settings)?;
//! assert!(gait.direction.standing && gait.direction.name() == "+x");
//! let knee = gait.curves["LKneeAngles"][0]; // flexion, adduction, rotation
//! assert!(knee.x.abs() < 20.0);
//! assert!(gait.findings.iter().any(|f| f.what.contains("RKNE"))); // the right leg is empty
//! assert!(gait.curves["RKneeAngles"][0].is_nan());
//! # Ok::<(), posing_core::Error>(())
//! ```
//!
//! | file | what it knows |
//! |---|---|
//! | `markers`, `trial` | what is given |
//! | `parameters`, `statics` | the subject: widths, lengths, offsets, each with its source |
//! | `axes`, `lower`, `upper`, `angles`, `curves`, `centers` | the model |
//! | `plate`, `forces` | the forces that the channels of force plates tell, and their tables |
//! | `plates`, `loads`, `kinetics` | what acts on a foot, and on the joints |
//! | `marker_events`, `events` | when feet meet the floor and leave it |
//! | `contradictions`, `findings` | what of it cannot be, and what is to be known |
//! | `cycles`, `values`, `norm` | what is told of a walk |
//! | `filled`, `deviations` | gaps of markers, and what doubt about these does to angles |
//! | `norm_file` | a norm as a file |
//! | `session` | the trials of a person: their tables, C3D files and page |
//!
//! Vicon's own values of six people's trials are met to .0005 mm and .00003 degrees, joint forces
//! to .004 N/kg, moments and powers to .2% of their range, in straight walks and in turns.

use posing_core::{Error, Place, Result, numeric, pose};
use posing_draw as draw;
use posing_io as io;

mod angles;
mod axes;
mod centers;
mod contradictions;
mod curves;
mod cycles;
mod deviations;
mod events;
mod filled;
mod findings;
mod forces;
mod gait_trial;
mod kinetics;
mod loads;
mod lower;
mod marker_events;
mod markers;
mod norm;
mod norm_file;
mod parameters;
mod peaks;
mod plate;
mod plates;
mod session;
mod side;
mod statics;
mod trial;
mod upper;
mod values;

#[doc(hidden)]
pub use angles::lower_angles;
pub use angles::{ANGLES, Direction};
pub use centers::JointCenters;
#[doc(hidden)]
pub use contradictions::contradictions;
pub use curves::Curves;
#[doc(hidden)]
pub use curves::is_angle;
pub use cycles::{Cycle, POINTS};
pub use events::{Event, EventChoice, EventKind, EventSource};
pub use findings::Finding;
pub use forces::Forces;
pub use gait_trial::{GaitSettings, GaitTrial};
pub use markers::{MARKERS, Markers};
pub use norm::{GVS, NineAngles, Norm, ProfileScores};
pub use parameters::{GivenValues, PARAMETERS, Parameter, Parameters, Source, plausible_range};
pub use plate::Plate;
pub use plates::Contact;
pub use session::{Session, SessionTrial, Spread};
pub use side::Side;
pub use statics::FlatFoot;
pub use trial::{FilledGap, Trial};
pub use values::CycleValues;
