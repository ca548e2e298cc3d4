//! What is told of a take on its floor.

use serde::Serialize;

/// Whether a take has a floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// The take stands on one floor.
    OnFloor,
    /// The take never stands: it is left as it is.
    Never,
    /// Standing at heights that are of no one plane: the take is left as it is.
    NoPlane,
}

/// A time in which a foot stands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Contact {
    /// `left`, `right`, or the name of the point.
    pub foot: String,
    /// Seconds from the first frame.
    pub start: f64,
    /// Seconds from the first frame to behind the last of the contact.
    pub end: f64,
    /// How far the foot was from its middle at most, along the floor, in the take's unit.
    pub slide: f64,
}

/// The floor of a take; lengths are in the take's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FloorReport {
    /// How high it was at the first frame, in the middle of the take's way.
    pub height: f64,
    /// The floor's slope, degrees.
    pub slope: f64,
    /// Where it rises to: degrees from z toward x, y up.
    pub direction: f64,
    /// How much it sank, per minute; below 0 it rose.
    pub sinking: f64,
    /// How high the lowest joints of feet stand over that of the result: 0, or soles below them.
    pub sole: f64,
}

/// What was found and done; lengths are in the take's unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroundReport {
    /// Whether the take has a floor.
    pub standing: Standing,
    /// The floor; `None`: it has none.
    pub floor: Option<FloorReport>,
    /// Whether the take was moved onto its floor.
    pub leveled: bool,
    /// The times in which a foot stands, by their start.
    pub contacts: Vec<Contact>,
    /// How many of them were held; `None`: not asked for, or no joints to do it.
    pub held: Option<usize>,
    /// The farthest from its middle that a foot in contact was and is, along the floor.
    pub slide: [f64; 2],
}

impl GroundReport {
    /// That of a take that is left as it is.
    pub(super) fn left(standing: Standing) -> GroundReport {
        GroundReport {
            standing,
            floor: None,
            leveled: false,
            contacts: Vec::new(),
            held: None,
            slide: [0.0; 2],
        }
    }

    /// With these contacts too.
    pub(super) fn add(&mut self, contacts: Vec<Contact>) {
        self.contacts.extend(contacts);
        self.contacts.sort_by(|a, b| a.start.total_cmp(&b.start));
        self.slide[0] = self.contacts.iter().map(|c| c.slide).fold(0.0, f64::max);
        self.slide[1] = self.slide[0];
    }
}

/// A take on its floor.
#[derive(Debug, Clone)]
pub struct Grounded<T> {
    /// The take; as it was, value for value, where nothing moves it.
    pub take: T,
    /// What was found and done.
    pub report: GroundReport,
}
