//! Units of length and up axes of files.

use crate::pose::ASF_UNIT_CM;
use clap::ValueEnum;
use glam::DMat3;
use ndarray::Array2;

/// Units of length in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Units {
    /// Centimetres
    Cm,
    /// Metres
    M,
    /// Millimetres
    Mm,
    /// Inches
    In,
    /// Raw units of CMU's ASF files, 5.644 cm
    Asf,
}

impl Units {
    /// Centimetres in one unit.
    pub fn centimetres(self) -> f64 {
        match self {
            Units::Cm => 1.0,
            Units::M => 100.0,
            Units::Mm => 0.1,
            Units::In => 2.54,
            Units::Asf => ASF_UNIT_CM,
        }
    }
}

/// A length with or without a unit: `3`, `3cm`, `1asf`, `0.02m`; centimetres when none is named.
pub fn parse_length(text: &str) -> std::result::Result<f64, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match &text[digits.len()..] {
        "" => Units::Cm,
        name => Units::from_str(name, true)
            .map_err(|_| format!("unknown unit \"{name}\"; use cm, m, mm, in or asf"))?,
    };
    match digits.parse::<f64>().map(|v| v * unit.centimetres()) {
        Ok(v) if v.is_finite() && v >= 0.0 => Ok(v),
        _ => Err("expected a length such as 3, 3cm or 1asf".into()),
    }
}

/// The axis that points up in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Up {
    /// X is up
    X,
    /// Y is up, as in pose tables
    Y,
    /// Z is up
    Z,
}

impl Up {
    /// The rotation that carries the file's axes to y up.
    pub fn rotation(self) -> DMat3 {
        DMat3::from_cols_array_2d(
            &[[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(|axis| self.to_y(axis)),
        )
    }
    /// Turns a point of the file into one with y up (right-handed both).
    pub fn to_y(self, p: [f64; 3]) -> [f64; 3] {
        match self {
            Up::X => [-p[1], p[0], p[2]],
            Up::Y => p,
            Up::Z => [p[0], p[2], -p[1]],
        }
    }
    /// Turns a point with y up into one of the file.
    pub fn from_y(self, p: [f64; 3]) -> [f64; 3] {
        match self {
            Up::X => [p[1], -p[0], p[2]],
            Up::Y => p,
            Up::Z => [p[0], -p[2], p[1]],
        }
    }
}

/// The unit of length and the up axis of a pose table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableUnits {
    /// The unit.
    pub unit: Units,
    /// The axis.
    pub up: Up,
}

impl TableUnits {
    /// Centimetres, y up: what everything is computed in.
    pub const CM_Y: TableUnits = TableUnits {
        unit: Units::Cm,
        up: Up::Y,
    };

    /// Converts the points of a frame to centimetres, y up.
    pub fn read(self, xyz: &mut [f64]) {
        if self != TableUnits::CM_Y {
            let scale = self.unit.centimetres();
            for p in xyz.chunks_exact_mut(3) {
                p.copy_from_slice(&self.up.to_y([p[0] * scale, p[1] * scale, p[2] * scale]));
            }
        }
    }

    /// Converts all frames (frames, 3 P) to centimetres, y up.
    pub fn read_frames(self, xyz: &mut Array2<f64>) {
        TableUnits::convert(xyz, |row| self.read(row));
    }

    /// Converts all frames (frames, 3 P) from centimetres, y up.
    pub fn write_frames(self, xyz: &mut Array2<f64>) {
        TableUnits::convert(xyz, |row| self.write(row));
    }

    fn convert(xyz: &mut Array2<f64>, convert: impl Fn(&mut [f64])) {
        for mut row in xyz.rows_mut() {
            let mut values = row.to_vec();
            convert(&mut values);
            row.iter_mut().zip(values).for_each(|(to, from)| *to = from);
        }
    }

    /// Converts the points of a frame from centimetres, y up.
    pub fn write(self, xyz: &mut [f64]) {
        if self != TableUnits::CM_Y {
            for p in xyz.chunks_exact_mut(3) {
                let own = self.up.from_y([p[0], p[1], p[2]]);
                p.copy_from_slice(&own.map(|v| self.length(v)));
            }
        }
    }

    /// A length of so many centimetres.
    pub fn length(self, cm: f64) -> f64 {
        cm / self.unit.centimetres()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        assert_eq!(parse_length("3"), Ok(3.0));
        assert_eq!(parse_length("2m"), Ok(200.0));
        assert!((parse_length("1asf").unwrap() - 5.644).abs() <= 1e-3);
        for bad in ["", "x", "3ft", "-1", "inf", "nan", "1e308m"] {
            assert!(parse_length(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn up_axes_turn_to_y() {
        for up in [Up::X, Up::Y, Up::Z] {
            let unit = match up {
                Up::X => [1.0, 0.0, 0.0],
                Up::Y => [0.0, 1.0, 0.0],
                Up::Z => [0.0, 0.0, 1.0],
            };
            assert_eq!(up.to_y(unit)[1], 1.0);
            assert_eq!(up.from_y(up.to_y([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0]);
            // Right-handed stays right-handed: e1 x e2 = e3.
            let [a, b, c] = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]
                .map(|e| glam::DVec3::from_array(up.to_y(e)));
            assert_eq!(a.cross(b), c);
        }
    }
}
