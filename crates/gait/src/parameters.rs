//! The subject's parameters: each with its value, where it is from, and what an estimate costs.

use crate::io::C3d;
use crate::markers::{Frame, Markers};
use crate::side::Side;
use serde::Serialize;
use std::collections::BTreeMap;

/// Values by Plug-in Gait's names of them, of which capitals and blanks do not count.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GivenValues(BTreeMap<String, f64>);

impl GivenValues {
    /// Sets a value, in millimeters, kilograms or radians.
    pub fn set(&mut self, name: &str, value: f64) {
        self.0.insert(plain(name), value);
    }

    /// Those that a file stores, in its group PROCESSING.
    pub fn of_c3d(file: &C3d) -> GivenValues {
        let mut given = GivenValues::default();
        for (name, values) in file.group("PROCESSING") {
            values.first().iter().for_each(|v| given.set(name, **v));
        }
        given
    }

    /// Takes over the values of others that it has not.
    pub fn fill_from(&mut self, other: &GivenValues) {
        for (name, value) in &other.0 {
            if self.get(name).is_none() {
                self.set(name, *value);
            }
        }
    }

    /// A value that is a number; a 0 is none for a length or a mass.
    pub fn get(&self, name: &str) -> Option<f64> {
        let value = self.0.get(&plain(name)).copied();
        value.filter(|v| v.is_finite() && (*v > 0.0 || unit_of(name) == "rad"))
    }
}

/// A name without blanks, in capitals.
fn plain(name: &str) -> String {
    name.split_whitespace()
        .collect::<String>()
        .to_ascii_uppercase()
}

/// Where a parameter is from, the best source first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The trial's own file (PROCESSING).
    Trial,
    /// Given by the user.
    Option,
    /// The static trial: its file or its markers.
    Static,
    /// Estimated from the markers.
    Estimate,
    /// What the model takes where nothing is said.
    Default,
}

/// A parameter of the subject.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parameter {
    /// The value.
    pub value: f64,
    /// `mm`, `kg` or `rad`.
    pub unit: &'static str,
    /// Where it is from.
    pub source: Source,
    /// The standard deviation of an estimate, in its unit.
    pub sd: Option<f64>,
}

/// The parameters by Plug-in Gait's names (`LLegLength`, `HeadOffset`, `Bodymass`). What is not
/// known is not there.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Parameters(pub BTreeMap<String, Parameter>);

/// What is given of a trial: its file's values, the user's, the static trial's and its markers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Given<'a> {
    pub trial: &'a GivenValues,
    pub options: &'a GivenValues,
    pub statics: Option<&'a GivenValues>,
    /// The static trial's, else the trial's own.
    pub markers: &'a Markers,
}

/// The parameters by name, those of a side without its L or R, and what values people have: mm, kg,
/// radians.
pub const PARAMETERS: [(&str, [f64; 2]); 16] = [
    ("MarkerDiameter", [1.0, 60.0]),
    ("Bodymass", [2.0, 400.0]),
    ("HeadOffset", [-1.6, 1.6]),
    ("InterAsisDistance", [50.0, 500.0]),
    ("LegLength", [200.0, 1500.0]),
    ("KneeWidth", [30.0, 250.0]),
    ("AnkleWidth", [20.0, 200.0]),
    ("AsisTrocanterDistance", [-60.0, 250.0]),
    ("StaticPlantFlex", [-1.6, 1.6]),
    ("StaticRotOff", [-1.6, 1.6]),
    ("ThighRotation", [-1.6, 1.6]),
    ("ShankRotation", [-1.6, 1.6]),
    ("ShoulderOffset", [5.0, 200.0]),
    ("ElbowWidth", [20.0, 200.0]),
    ("WristWidth", [10.0, 150.0]),
    ("HandThickness", [5.0, 100.0]),
];

/// The values of a parameter that people have, by its name with or without its side; `None` of a
/// name that the model does not know.
pub fn plausible_range(name: &str) -> Option<[f64; 2]> {
    let name = plain(name);
    let is_it = |known: &str| {
        let known = plain(known);
        let is_sided = ![
            "MARKERDIAMETER",
            "BODYMASS",
            "HEADOFFSET",
            "INTERASISDISTANCE",
        ]
        .contains(&known.as_str());
        name == known || is_sided && name.strip_prefix(['L', 'R']) == Some(&known)
    };
    let found = PARAMETERS.iter().find(|(known, _)| is_it(known));
    found.map(|(_, range)| *range)
}

/// Parameters of a side that no marker tells, without which its arm has no axes.
const ARM: [&str; 4] = [
    "ShoulderOffset",
    "ElbowWidth",
    "WristWidth",
    "HandThickness",
];
/// Angles that are 0 where nothing is said.
const ANGLES: [&str; 4] = [
    "StaticPlantFlex",
    "StaticRotOff",
    "ThighRotation",
    "ShankRotation",
];

impl Parameters {
    /// The value of a parameter; NaN where it is not known.
    pub fn value(&self, name: &str) -> f64 {
        self.0.get(name).map_or(f64::NAN, |p| p.value)
    }

    /// The names of those from a source.
    pub fn of_source(&self, source: Source) -> impl Iterator<Item = &str> {
        let all = self.0.iter().filter(move |(_, p)| p.source == source);
        all.map(|(name, _)| name.as_str())
    }

    /// Each parameter from its best source. Those of the static trial's markers, the offsets of
    /// feet and head, are 0 until they are measured.
    pub(crate) fn find(given: Given<'_>) -> Parameters {
        let mut all = Parameters::default();
        all.take(given, "MarkerDiameter", || {
            Some((14.0, Source::Default, None))
        });
        all.take(given, "Bodymass", || None);
        all.take(given, "HeadOffset", || Some((0.0, Source::Default, None)));
        all.take(given, "InterAsisDistance", || {
            let apart = |frame: &Frame| frame.pelvis()[0].distance(frame.pelvis()[1]);
            let (mean, sd) = mean_length(given.markers, &apart)?;
            let of_static = given.statics.map(|_| (mean, Source::Static, None));
            of_static.or(Some((mean, Source::Estimate, Some(sd))))
        });
        for side in Side::BOTH {
            all.take_side(given, side);
        }
        all.in_radians();
        all
    }

    fn take_side(&mut self, given: Given<'_>, side: Side) {
        let own = |name: &str| format!("{}{name}", side.letter());
        let estimate = |value: f64, sd: f64| Some((value, Source::Estimate, Some(sd)));
        let length = || {
            let length = estimated_leg(given.markers, side)?;
            estimate(length, 13.0)
        };
        self.take(given, &own("LegLength"), length);
        let leg = self.0.get(&own("LegLength")).copied();
        self.take(given, &own("KneeWidth"), || {
            estimate(0.126 * leg?.value, 11.0)
        });
        self.take(given, &own("AnkleWidth"), || {
            estimate(0.080 * leg?.value, 5.0)
        });
        self.take(given, &own("AsisTrocanterDistance"), || {
            let (leg, formula) = (leg?, |leg: f64| 0.1288 * leg - 48.56);
            match leg.sd {
                Some(sd) => estimate(formula(leg.value), 0.1288 * sd),
                None => Some((formula(leg.value), Source::Default, None)),
            }
        });
        for name in ANGLES {
            self.take(given, &own(name), || Some((0.0, Source::Default, None)));
        }
        for name in ARM {
            self.take(given, &own(name), || None);
        }
    }

    /// Takes a parameter from its best source, else what `other` makes of the markers.
    fn take(
        &mut self,
        given: Given<'_>,
        name: &str,
        other: impl FnOnce() -> Option<(f64, Source, Option<f64>)>,
    ) {
        let said = [
            (Some(given.trial), Source::Trial),
            (Some(given.options), Source::Option),
            (given.statics, Source::Static),
        ];
        let said = said
            .into_iter()
            .find_map(|(values, source)| values?.get(name).map(|value| (value, source, None)));
        if let Some((value, source, sd)) = said.or_else(other) {
            self.set(name, value, source, sd);
        }
    }

    /// Sets a parameter.
    pub(crate) fn set(&mut self, name: &str, value: f64, source: Source, sd: Option<f64>) {
        let unit = unit_of(name);
        self.0.insert(
            name.to_string(),
            Parameter {
                value,
                unit,
                source,
                sd,
            },
        );
    }

    /// Vicon's Workstation 5 wrote the static offsets in degrees, of which no foot has over one in
    /// radians.
    fn in_radians(&mut self) {
        let offsets = self
            .0
            .iter_mut()
            .filter(|(name, _)| name.contains("Static"));
        let mut offsets: Vec<&mut f64> = offsets.map(|(_, p)| &mut p.value).collect();
        if offsets.iter().any(|value| value.abs() > 1.0) {
            offsets
                .iter_mut()
                .for_each(|value| **value = value.to_radians());
        }
    }

    /// The values as the model takes them.
    pub(crate) fn subject(&self) -> Subject {
        let of = |side: Side| {
            let own = |name: &str| self.value(&format!("{}{name}", side.letter()));
            SideValues {
                leg: own("LegLength"),
                asis_trochanter: own("AsisTrocanterDistance"),
                knee_width: own("KneeWidth"),
                ankle_width: own("AnkleWidth"),
                thigh_turn: own("ThighRotation"),
                shank_turn: own("ShankRotation"),
                plant_flexion: own("StaticPlantFlex"),
                rotation_offset: own("StaticRotOff"),
                shoulder_offset: own("ShoulderOffset"),
                elbow_width: own("ElbowWidth"),
                wrist_width: own("WristWidth"),
                hand_thickness: own("HandThickness"),
            }
        };
        Subject {
            radius: self.value("MarkerDiameter") / 2.0,
            inter_asis: self.value("InterAsisDistance"),
            head_offset: self.value("HeadOffset"),
            mass: self.value("Bodymass"),
            sides: Side::BOTH.map(of),
        }
    }
}

/// The unit of a parameter.
fn unit_of(name: &str) -> &'static str {
    let name = plain(name);
    let is_angle = ["STATIC", "ROTATION", "HEAD"]
        .iter()
        .any(|word| name.contains(word));
    if is_angle {
        "rad"
    } else if name == "BODYMASS" {
        "kg"
    } else {
        "mm"
    }
}

/// The length of a leg as markers tell it, mm.
pub(crate) fn estimated_leg(markers: &Markers, side: Side) -> Option<f64> {
    let path = |frame: &Frame| {
        let (asis, [_, kne, _, ank, ..]) = (frame.pelvis()[side as usize], frame.leg(side));
        asis.distance(kne) + kne.distance(ank)
    };
    Some(1.005 * mean_length(markers, &path)?.0)
}

/// The mean and the standard deviation of a length over the frames that have it.
pub(crate) fn mean_length(markers: &Markers, length: &dyn Fn(&Frame) -> f64) -> Option<(f64, f64)> {
    let lengths = (0..markers.frames()).map(|t| length(&markers.frame(t)));
    let lengths: Vec<f64> = lengths.filter(|l| l.is_finite()).collect();
    let (count, sum) = (lengths.len() as f64, lengths.iter().sum::<f64>());
    let spread = lengths
        .iter()
        .map(|l| (l - sum / count).powi(2))
        .sum::<f64>();
    (count > 0.0).then(|| (sum / count, (spread / count).sqrt()))
}

/// The parameters as the model takes them: millimeters, kilograms, radians; NaN is not known.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Subject {
    /// Of a marker.
    pub radius: f64,
    pub inter_asis: f64,
    pub head_offset: f64,
    pub mass: f64,
    /// Left and right.
    pub sides: [SideValues; 2],
}

impl Subject {
    /// The mean of both legs' lengths.
    pub(crate) fn mean_leg(&self) -> f64 {
        (self.sides[0].leg + self.sides[1].leg) / 2.0
    }
}

/// The parameters of a side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SideValues {
    pub leg: f64,
    pub asis_trochanter: f64,
    pub knee_width: f64,
    pub ankle_width: f64,
    pub thigh_turn: f64,
    pub shank_turn: f64,
    pub plant_flexion: f64,
    pub rotation_offset: f64,
    pub shoulder_offset: f64,
    pub elbow_width: f64,
    pub wrist_width: f64,
    pub hand_thickness: f64,
}

#[cfg(test)]
pub(crate) mod testdata {
    use super::*;
    use crate::markers::MARKERS;
    use glam::DVec3;

    /// A person who faces +x.
    pub(crate) fn subject() -> Subject {
        let mut given = GivenValues::default();
        let lengths = [
            ("LegLength", 850.0),
            ("KneeWidth", 100.0),
            ("AnkleWidth", 65.0),
            ("ShoulderOffset", 40.0),
            ("ElbowWidth", 80.0),
            ("WristWidth", 50.0),
            ("HandThickness", 30.0),
        ];
        for (name, value) in lengths {
            ["L", "R"]
                .iter()
                .for_each(|side| given.set(&format!("{side}{name}"), value));
        }
        let markers = Markers::new([]).unwrap();
        given.set("InterAsisDistance", 230.0);
        let none = GivenValues::default();
        let given = Given {
            trial: &given,
            options: &none,
            statics: None,
            markers: &markers,
        };
        Parameters::find(given).subject()
    }

    /// Markers of that person in a frame.
    pub(crate) fn standing() -> Frame {
        let half = [
            ("ASI", [100.0, 115.0, 950.0]),
            ("PSI", [-90.0, 50.0, 960.0]),
            ("THI", [10.0, 180.0, 700.0]),
            ("KNE", [15.0, 160.0, 500.0]),
            ("TIB", [-5.0, 170.0, 300.0]),
            ("ANK", [-20.0, 145.0, 90.0]),
            ("HEE", [-80.0, 110.0, 40.0]),
            ("TOE", [130.0, 120.0, 50.0]),
            ("FHD", [110.0, 70.0, 1600.0]),
            ("BHD", [-70.0, 70.0, 1590.0]),
            ("SHO", [-10.0, 180.0, 1400.0]),
            ("ELB", [-40.0, 260.0, 1130.0]),
            ("WRA", [90.0, 250.0, 930.0]),
            ("WRB", [60.0, 300.0, 910.0]),
            ("FIN", [130.0, 270.0, 840.0]),
        ];
        let middle = [
            ("C7", [-60.0, 0.0, 1440.0]),
            ("T10", [-100.0, 0.0, 1200.0]),
            ("CLAV", [70.0, 0.0, 1380.0]),
            ("STRN", [110.0, 0.0, 1230.0]),
            ("SACR", [-90.0, 0.0, 960.0]),
        ];
        let place = |name: &&str| {
            let own = middle.iter().find(|(n, _)| n == name);
            let side = half.iter().find(|(n, _)| *n == &name[1..]);
            let turned = if name.starts_with('R') { -1.0 } else { 1.0 };
            let of_side = side.map(|(_, p)| DVec3::new(p[0], turned * p[1], p[2]));
            own.map_or(of_side.unwrap_or(DVec3::NAN), |(_, p)| {
                DVec3::from_array(*p)
            })
        };
        Frame(MARKERS.each_ref().map(place))
    }

    #[test]
    fn each_parameter_is_from_its_best_source() {
        let sets: [&[(&str, f64)]; 3] = [
            &[
                ("Marker Diameter", 16.0),
                ("RKneeWidth", 0.0),
                ("LStaticPlantFlex", 12.0),
            ],
            &[
                ("MarkerDiameter", 10.0),
                ("LLegLength", 900.0),
                ("HeadOffset", 0.0),
            ],
            &[("RKneeWidth", 104.0), ("LLegLength", 910.0)],
        ];
        let [trial, options, statics] = sets.map(|set| {
            let mut given = GivenValues::default();
            set.iter().for_each(|(name, value)| given.set(name, *value));
            given
        });
        let track = standing().0.map(|p| vec![p; 2]);
        let markers = Markers::new(MARKERS.into_iter().zip(track)).unwrap();
        let given = Given {
            trial: &trial,
            options: &options,
            statics: Some(&statics),
            markers: &markers,
        };
        let all = Parameters::find(given);
        let of = |name: &str| (all.value(name), all.0[name].source);
        assert_eq!(of("MarkerDiameter"), (16.0, Source::Trial));
        assert_eq!(of("HeadOffset"), (0.0, Source::Option));
        assert_eq!(of("LLegLength"), (900.0, Source::Option));
        assert_eq!(of("RKneeWidth"), (104.0, Source::Static));
        assert_eq!(of("LKneeWidth"), (0.126 * 900.0, Source::Estimate));
        assert_eq!(of("InterAsisDistance"), (230.0, Source::Static));
        assert_eq!(of("LStaticPlantFlex"), (12f64.to_radians(), Source::Trial));
        assert!(all.0["RLegLength"].sd == Some(13.0) && all.value("Bodymass").is_nan());
    }
}
