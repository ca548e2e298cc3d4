//! Types of the library as values of flags.

use crate::clean::OutputFormat;
use crate::gait::{EventChoice, FlatFoot};
use crate::io::TableFormat;
use crate::io::marker_csv::MotivePoints;
use crate::pose::BonePoints;
use crate::pose::kinematics::Space;
use crate::pose::units::{LengthUnit, UpAxis};
use crate::sparse::SelectionRule;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// A type of the library that is a flag's value. (clap's `ValueEnum` can only be implemented where
/// the type stands.)
pub trait Choice: Copy + PartialEq + Send + Sync + 'static {
    /// Each value, its name and its help.
    const ALL: &'static [(Self, &'static str, &'static str)];
}

/// Parses a flag's value; `--help` lists all.
pub fn choice<T: Choice>() -> impl TypedValueParser<Value = T> {
    let all = T::ALL.iter();
    let named = all.map(|(_, name, help)| PossibleValue::new(*name).help(*help));
    PossibleValuesParser::new(named).map(|given| {
        let found = T::ALL.iter().find(|(_, name, _)| *name == given);
        found.map_or(T::ALL[0].0, |(value, ..)| *value)
    })
}

/// The value of a name, in any case.
pub fn named<T: Choice>(name: &str) -> Option<T> {
    let found = T::ALL
        .iter()
        .find(|(_, own, _)| own.eq_ignore_ascii_case(name));
    found.map(|(value, ..)| *value)
}

/// A value of a flag as a user types it.
pub fn value_name<T: Choice>(value: T) -> String {
    let found = T::ALL.iter().find(|(own, ..)| *own == value);
    found.map_or_else(String::new, |(_, name, _)| (*name).to_string())
}

/// Makes an enum of the library a flag's values, each with its name and its help.
macro_rules! choices {
    ($type:ident { $($variant:ident $name:literal: $help:literal;)* }) => {
        impl $crate::cli::choice::Choice for $type {
            const ALL: &'static [($type, &'static str, &'static str)] =
                &[$((<$type>::$variant, $name, $help),)*];
        }
    };
}

pub(crate) use choices;

choices!(LengthUnit {
    Cm "cm": "Centimeters";
    M "m": "Meters";
    Mm "mm": "Millimeters";
    In "in": "Inches";
    Asf "asf": "Raw units of CMU's ASF files, 5.644 cm";
});

choices!(UpAxis {
    X "x": "X is up";
    Y "y": "Y is up, as in pose tables";
    Z "z": "Z is up";
    MinusX "-x": "X points down";
    MinusY "-y": "Y points down, as in images";
    MinusZ "-z": "Z points down";
});

choices!(OutputFormat {
    C3d "c3d": "C3D, millimeters, z up";
    Trc "trc": "TRC, millimeters, y up";
    Csv "csv": "A pose table as CSV";
    Npy "npy": "A pose table as NPY, which holds coordinates only";
});

choices!(TableFormat {
    Csv "csv": "Text with a header line";
    Npy "npy": "NumPy array of the coordinates alone";
    Npz "npz": "NumPy archive of all columns: xyz (frames, points, 3), names, fps, status, sd";
});

choices!(SelectionRule {
    Oomp "oomp": "Optimized orthogonal matching pursuit, the more accurate";
    Omp "omp": "Orthogonal matching pursuit, as Lai et al. use";
});

choices!(Space {
    World "world": "As captured";
    Root "root": "Root at the origin, global rotation kept";
    Body "body": "Root at the origin, no global rotation, as Lai et al. train";
});

choices!(BonePoints {
    Starts "starts": "Where the bone of the point's name starts";
    Ends "ends": "Where it ends";
});

choices!(MotivePoints {
    Markers "markers": "Measured markers";
    Expected "expected": "Where the markers of rigid bodies and skeletons are expected, also when \
                          they are hidden";
    Bones "bones": "Bones and rigid bodies";
});

choices!(EventChoice {
    Auto "auto": "By plates where a single foot is on one, else by markers";
    Plates "plates": "By force plates alone";
    Markers "markers": "By markers alone";
    File "file": "Those that the file stores";
});

choices!(FlatFoot {
    Auto "auto": "As the offsets stored in the static trial say; flat where it stores none";
    Yes "yes": "The soles lay flat: heel and toe markers count as equally high";
    No "no": "The markers are as they are";
});
