//! Units of length and up axes.

use super::ASF_UNIT_CM;
use crate::Result;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// A unit of length.
///
/// ```
/// use posing_core::pose::units::LengthUnit;
///
/// let unit = LengthUnit::of_name("mm");
/// assert_eq!(unit, Some(LengthUnit::Mm));
/// assert_eq!(unit.map(LengthUnit::centimeters), Some(0.1));
/// assert_eq!(LengthUnit::of_name("mile"), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Centimeters
    Cm,
    /// Meters
    M,
    /// Millimeters
    Mm,
    /// Inches
    In,
    /// Raw units of CMU's ASF files, 5.644 cm
    Asf,
}

names!(LengthUnit {
    Cm = "cm",
    M = "m",
    Mm = "mm",
    In = "in",
    Asf = "asf",
});

impl LengthUnit {
    /// Centimeters in one unit.
    pub fn centimeters(self) -> f64 {
        match self {
            LengthUnit::Cm => 1.0,
            LengthUnit::M => 100.0,
            LengthUnit::Mm => 0.1,
            LengthUnit::In => 2.54,
            LengthUnit::Asf => ASF_UNIT_CM,
        }
    }

    /// The unit of a word in a file, such as `mm` or `Millimeters`.
    #[doc(hidden)]
    pub fn of_word(word: &str) -> Option<LengthUnit> {
        let word = word.trim().to_ascii_lowercase().replace("tre", "ter");
        Some(match word.as_str() {
            "mm" | "millimeters" | "millimeter" => LengthUnit::Mm,
            "cm" | "centimeters" | "centimeter" => LengthUnit::Cm,
            "m" | "meters" | "meter" => LengthUnit::M,
            "in" | "inch" | "inches" => LengthUnit::In,
            _ => return None,
        })
    }
}

/// A length with or without a unit: `3`, `3cm`, `1asf`, `0.02m`; centimeters when none is named.
///
/// ```
/// use posing_core::pose::units::parse_length;
///
/// assert_eq!(parse_length("0.25m")?, 25.0);
/// assert_eq!(parse_length("3")?, 3.0); // centimeters
/// assert!(parse_length("3 feet").is_err());
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn parse_length(text: &str) -> Result<f64> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match &text[digits.len()..] {
        "" => LengthUnit::Cm,
        name => LengthUnit::ALL
            .into_iter()
            .find(|unit| unit.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| format!("unknown unit \"{name}\"; use cm, m, mm, in or asf"))?,
    };
    match digits.parse::<f64>().map(|v| v * unit.centimeters()) {
        Ok(v) if v.is_finite() && v >= 0.0 => Ok(v),
        _ => Err("expected a length such as 3, 3cm or 1asf".into()),
    }
}

/// The axis that points up in a file, and whether its axes are left-handed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UpAxis {
    /// X is up
    X,
    /// Y is up, as in pose tables
    Y,
    /// Z is up
    Z,
    /// X points down
    MinusX,
    /// Y points down, as in images
    MinusY,
    /// Z points down
    MinusZ,
    /// X is up, left-handed
    LeftX,
    /// Y is up, left-handed, as in Unity
    LeftY,
    /// Z is up, left-handed, as in Unreal
    LeftZ,
    /// X points down, left-handed
    LeftMinusX,
    /// Y points down, left-handed
    LeftMinusY,
    /// Z points down, left-handed
    LeftMinusZ,
}

names!(UpAxis {
    X = "x",
    Y = "y",
    Z = "z",
    MinusX = "-x",
    MinusY = "-y",
    MinusZ = "-z",
    LeftX = "x, left-handed",
    LeftY = "y, left-handed",
    LeftZ = "z, left-handed",
    LeftMinusX = "-x, left-handed",
    LeftMinusY = "-y, left-handed",
    LeftMinusZ = "-z, left-handed",
});

impl UpAxis {
    /// The axis of a word in a file, such as `+Z`, or in what is documented of it: `y down`. `-Z`
    /// is none: programs write it where z is up.
    #[doc(hidden)]
    pub fn of_word(word: &str) -> Option<UpAxis> {
        Some(match word.trim().to_ascii_lowercase().as_str() {
            "+x" | "x" => UpAxis::X,
            "+y" | "y" => UpAxis::Y,
            "+z" | "z" => UpAxis::Z,
            "y down" => UpAxis::MinusY,
            _ => return None,
        })
    }

    /// This axis in a file whose axes are left-handed (`is_left`) or right-handed.
    ///
    /// ```
    /// use glam::DVec3;
    /// use posing_core::pose::UpAxis;
    ///
    /// // Unity: x points to the right, z forward; ours points to the left.
    /// let unity = UpAxis::Y.handed(true);
    /// assert_eq!(unity.rotation() * DVec3::new(1.0, 2.0, 3.0), DVec3::new(-1.0, 2.0, 3.0));
    /// assert_eq!(unity.handed(false), UpAxis::Y);
    /// ```
    #[must_use]
    pub fn handed(self, is_left: bool) -> UpAxis {
        let pair = HANDS.into_iter().find(|pair| pair.contains(&self));
        pair.map_or(self, |[right, left]| if is_left { left } else { right })
    }

    /// A triangle of the file with its corners the other way round, if the file's axes are
    /// left-handed: their reflection turns a surface inside out.
    ///
    /// ```
    /// use posing_core::pose::UpAxis;
    ///
    /// assert_eq!(UpAxis::LeftY.triangle([0, 1, 2]), [0, 2, 1]);
    /// assert_eq!(UpAxis::Z.triangle([0, 1, 2]), [0, 1, 2]);
    /// ```
    pub fn triangle<T>(self, [a, b, c]: [T; 3]) -> [T; 3] {
        if self == self.handed(false) {
            [a, b, c]
        } else {
            [a, c, b]
        }
    }

    /// The direction that is up, in the file's axes.
    pub(crate) fn direction(self) -> DVec3 {
        DVec3::from_array(self.turn_from_y([0.0, 1.0, 0.0]))
    }

    /// The axis that is up along a direction.
    #[doc(hidden)]
    pub fn along(direction: DVec3) -> Option<UpAxis> {
        let is_near = |up: &UpAxis| up.direction().dot(direction.normalize_or_zero()) > 0.9;
        UpAxis::ALL.into_iter().find(is_near)
    }

    /// The rotation that carries the file's axes to y up; of left-handed ones, with a reflection:
    /// x changes its sign where y is up, y where z is, z where x is.
    ///
    /// ```
    /// use glam::DVec3;
    /// use posing_core::pose::UpAxis;
    ///
    /// let turn = UpAxis::Z.rotation();
    /// assert_eq!(turn * DVec3::Z, DVec3::Y);
    /// assert_eq!(turn * DVec3::Y, -DVec3::Z); // the axes stay right-handed
    /// ```
    pub fn rotation(self) -> DMat3 {
        DMat3::from_cols_array_2d(
            &[[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(|axis| self.to_y(axis)),
        )
    }

    /// Turns a point of the file into one with y up, right-handed.
    pub(crate) fn to_y(self, p: [f64; 3]) -> [f64; 3] {
        let p = self.as_right_handed(p);
        match self.handed(false) {
            UpAxis::X => [-p[1], p[0], p[2]],
            UpAxis::Y => p,
            UpAxis::Z => [p[0], p[2], -p[1]],
            UpAxis::MinusX => [p[1], -p[0], p[2]],
            UpAxis::MinusY => [p[0], -p[1], -p[2]],
            _ => [p[0], -p[2], p[1]],
        }
    }

    /// A point in axes of the other hand, if the file's are left-handed.
    fn as_right_handed(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            UpAxis::LeftX | UpAxis::LeftMinusX => [x, y, -z],
            UpAxis::LeftY | UpAxis::LeftMinusY => [-x, y, z],
            UpAxis::LeftZ | UpAxis::LeftMinusZ => [x, -y, z],
            _ => [x, y, z],
        }
    }

    /// Turns a point with y up into one of the file.
    pub(crate) fn turn_from_y(self, p: [f64; 3]) -> [f64; 3] {
        let own = match self.handed(false) {
            UpAxis::X => [p[1], -p[0], p[2]],
            UpAxis::Y => p,
            UpAxis::Z => [p[0], -p[2], p[1]],
            UpAxis::MinusX => [-p[1], p[0], p[2]],
            UpAxis::MinusY => [p[0], -p[1], -p[2]],
            _ => [p[0], p[2], -p[1]],
        };
        self.as_right_handed(own)
    }
}

/// Each axis of right-handed files beside that of left-handed ones.
const HANDS: [[UpAxis; 2]; 6] = [
    [UpAxis::X, UpAxis::LeftX],
    [UpAxis::Y, UpAxis::LeftY],
    [UpAxis::Z, UpAxis::LeftZ],
    [UpAxis::MinusX, UpAxis::LeftMinusX],
    [UpAxis::MinusY, UpAxis::LeftMinusY],
    [UpAxis::MinusZ, UpAxis::LeftMinusZ],
];

/// The unit of length and the up axis of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// The unit.
    pub unit: LengthUnit,
    /// The axis.
    pub up: UpAxis,
}

impl Units {
    /// Centimeters, y up: what everything is computed in.
    pub const CM_Y: Units = Units {
        unit: LengthUnit::Cm,
        up: UpAxis::Y,
    };

    /// Converts the points of a frame to centimeters, y up.
    #[doc(hidden)]
    pub fn read(self, xyz: &mut [f64]) {
        if self != Units::CM_Y {
            let scale = self.unit.centimeters();
            for p in xyz.chunks_exact_mut(3) {
                p.copy_from_slice(&self.up.to_y([p[0] * scale, p[1] * scale, p[2] * scale]));
            }
        }
    }

    /// Converts all frames (frames, 3 P) to centimeters, y up.
    #[doc(hidden)]
    pub fn read_frames(self, xyz: &mut Array2<f64>) {
        Units::convert(xyz, |row| self.read(row));
    }

    /// Converts all frames (frames, 3 P) from centimeters, y up.
    #[doc(hidden)]
    pub fn write_frames(self, xyz: &mut Array2<f64>) {
        Units::convert(xyz, |row| self.write(row));
    }

    fn convert(xyz: &mut Array2<f64>, convert: impl Fn(&mut [f64])) {
        for mut row in xyz.rows_mut() {
            let mut values = row.to_vec();
            convert(&mut values);
            row.iter_mut().zip(values).for_each(|(to, from)| *to = from);
        }
    }

    /// Converts the points of a frame from centimeters, y up.
    #[doc(hidden)]
    pub fn write(self, xyz: &mut [f64]) {
        if self != Units::CM_Y {
            for p in xyz.chunks_exact_mut(3) {
                let own = self.up.turn_from_y([p[0], p[1], p[2]]);
                p.copy_from_slice(&own.map(|v| self.length(v)));
            }
        }
    }

    /// A length of so many centimeters.
    ///
    /// ```
    /// use posing_core::pose::units::{LengthUnit, UpAxis, Units};
    ///
    /// let meters = Units { unit: LengthUnit::M, up: UpAxis::Z };
    /// assert_eq!(meters.length(180.0), 1.8);
    /// ```
    pub fn length(self, cm: f64) -> f64 {
        cm / self.unit.centimeters()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        assert_eq!(parse_length("3").unwrap(), 3.0);
        assert_eq!(parse_length("2m").unwrap(), 200.0);
        assert!((parse_length("1asf").unwrap() - 5.644).abs() <= 1e-3);
        for bad in ["", "x", "3ft", "-1", "inf", "nan", "1e308m"] {
            assert!(parse_length(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn up_axes_turn_to_y() {
        for up in UpAxis::ALL {
            let unit = match up.handed(false) {
                UpAxis::X => [1.0, 0.0, 0.0],
                UpAxis::Y => [0.0, 1.0, 0.0],
                UpAxis::Z => [0.0, 0.0, 1.0],
                UpAxis::MinusX => [-1.0, 0.0, 0.0],
                UpAxis::MinusY => [0.0, -1.0, 0.0],
                _ => [0.0, 0.0, -1.0],
            };
            assert_eq!(up.to_y(unit)[1], 1.0);
            assert_eq!(up.turn_from_y(up.to_y([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0]);
            assert_eq!(up.direction().to_array(), unit);
            assert_eq!(UpAxis::along(2.0 * up.direction()), Some(up.handed(false)));
            // Right-handed stays right-handed: e1 x e2 = e3; left-handed becomes so.
            let [a, b, c] = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]
                .map(|e| glam::DVec3::from_array(up.to_y(e)));
            let is_right = up == up.handed(false);
            assert_eq!(a.cross(b), if is_right { c } else { -c });
        }
    }

    #[test]
    fn units_and_axes_are_read_as_they_are_written() {
        assert_eq!(LengthUnit::of_word(" MM "), Some(LengthUnit::Mm));
        assert_eq!(
            LengthUnit::of_word(&["Millime", "tres"].concat()),
            Some(LengthUnit::Mm)
        );
        assert_eq!(LengthUnit::of_word("furlong"), None);
        assert_eq!(UpAxis::of_word("+Z"), Some(UpAxis::Z));
        assert_eq!(UpAxis::of_word("-Z"), None);
    }
}
