//! Types of the library as values of flags.

use crate::clean::OutputFormat;
use crate::pose::units::{LengthUnit, UpAxis};
use clap::ValueEnum;
use clap::builder::PossibleValue;

/// Makes an enum of the library a flag's values by the function that names them, each with its
/// help.
macro_rules! value_enum {
    ($type:ty, $name:ident { $($variant:ident: $help:literal;)* }) => {
        impl ValueEnum for $type {
            fn value_variants<'a>() -> &'a [Self] {
                &<$type>::ALL
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                let help = match self {
                    $(<$type>::$variant => $help,)*
                };
                Some(PossibleValue::new(self.$name()).help(help))
            }
        }
    };
}

value_enum!(LengthUnit, name {
    Cm: "Centimeters";
    M: "Meters";
    Mm: "Millimeters";
    In: "Inches";
    Asf: "Raw units of CMU's ASF files, 5.644 cm";
});

value_enum!(UpAxis, name {
    X: "X is up";
    Y: "Y is up, as in pose tables";
    Z: "Z is up";
});

value_enum!(OutputFormat, extension {
    C3d: "C3D, millimeters, z up";
    Trc: "TRC, millimeters, y up";
    Csv: "A pose table as CSV";
    Npy: "A pose table as NPY, which holds coordinates only";
});
