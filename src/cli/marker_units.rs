//! Words for units and axes in files of markers.

use super::units::{Units, Up};

/// The unit of a word such as `mm` or `Millimeters`.
pub fn unit_of(word: &str) -> Option<Units> {
    Some(match word.trim().to_ascii_lowercase().as_str() {
        "mm" | "millimeters" | "millimetres" | "millimeter" | "millimetre" => Units::Mm,
        "cm" | "centimeters" | "centimetres" | "centimeter" | "centimetre" => Units::Cm,
        "m" | "meters" | "metres" | "meter" | "metre" => Units::M,
        "in" | "inch" | "inches" => Units::In,
        _ => return None,
    })
}

/// The axis of a word such as `+Z`; an axis that points down is none.
pub fn axis_of(word: &str) -> Option<Up> {
    Some(match word.trim().to_ascii_lowercase().as_str() {
        "+x" | "x" => Up::X,
        "+y" | "y" => Up::Y,
        "+z" | "z" => Up::Z,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_and_axes_are_read_as_they_are_written() {
        assert_eq!(unit_of(" MM "), Some(Units::Mm));
        assert_eq!(unit_of("Meters"), Some(Units::M));
        assert_eq!(unit_of("furlong"), None);
        assert_eq!(axis_of("+Z"), Some(Up::Z));
        assert_eq!(axis_of("-Z"), None);
    }
}
