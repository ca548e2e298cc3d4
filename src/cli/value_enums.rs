//! Types of the library as values of flags.

use crate::clean::OutputFormat;
use crate::pose::units::{LengthUnit, UpAxis};
use clap::ValueEnum;
use clap::builder::PossibleValue;

/// Makes an enum of the library a flag's values, each with its help.
macro_rules! value_enum {
    ($type:ty { $($variant:ident: $name:literal, $help:literal;)* }) => {
        impl ValueEnum for $type {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(<$type>::$variant),*]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                Some(match self {
                    $(<$type>::$variant => PossibleValue::new($name).help($help),)*
                })
            }
        }
    };
}

value_enum!(LengthUnit {
    Cm: "cm", "Centimeters";
    M: "m", "Meters";
    Mm: "mm", "Millimeters";
    In: "in", "Inches";
    Asf: "asf", "Raw units of CMU's ASF files, 5.644 cm";
});

value_enum!(UpAxis {
    X: "x", "X is up";
    Y: "y", "Y is up, as in pose tables";
    Z: "z", "Z is up";
});

value_enum!(OutputFormat {
    C3d: "c3d", "C3D, millimeters, z up";
    Trc: "trc", "TRC, millimeters, y up";
    Csv: "csv", "A pose table as CSV";
    Npy: "npy", "A pose table as NPY, which holds coordinates only";
});
