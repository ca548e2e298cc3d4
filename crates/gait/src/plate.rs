//! A force plate with its samples: force and moment from its channels.
//!
//! The types are those of the C3D Format User Guide (Motion Lab Systems, 2008). With the origin o
//! from the sensors to the middle of the surface, in the plate's axes with z down, the moment about
//! that middle is m = n + f x o, n being that about the sensors' origin: of types 2 and 4 three of
//! their numbers, of type 3 by the forces of four sensors at +-o.x and +-o.y. Type 1 gives the
//! center of pressure p and the free moment t themselves: m = p x f + t.
//!
//! The corners say where x and y point, and x times y says where z does. In a left-handed
//! laboratory that product of their numbers is mirrored, so there z is taken for what the format
//! has it: downwards. The corners, carried to a right-handed laboratory, then tell the hand of the
//! plate's own axes. They are right-handed where a left-handed laboratory stands around a common
//! plate, whose channels mean what they always do. They are left-handed where the plate's numbers
//! are mirrored too: by a reflection S the force is S f, and the moment, a product of two vectors
//! by their numbers, S r x S f = -S (r x f).

use crate::io::{Analog, C3d, ForcePlate};
use crate::pose::{LengthUnit, Units, UpAxis};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// A plate whose z has less than this along the vertical stands upright: a ramp of 60 degrees.
const LEAST_LEVEL: f64 = 0.5;

/// A force plate with its samples, in millimeters and the axes that were asked for: a
/// [`Trial`](crate::Trial)'s are those of the laboratory, z up, of [`Forces`](crate::Forces) y up.
#[derive(Debug, Clone, PartialEq)]
pub struct Plate {
    /// The middle of its surface.
    pub center: DVec3,
    /// The direction at right angles to its surface, up or down, of length 1.
    pub normal: DVec3,
    /// Samples a frame of the markers.
    pub per_frame: usize,
    /// The force on the foot, a sample each, N.
    pub force: Vec<DVec3>,
    /// The moment on the foot about `center`, a sample each, N mm.
    pub moment: Vec<DVec3>,
}

impl Plate {
    /// The plates of a file in their order; in the place of one that cannot be computed, why not
    /// ([`Error::Unfit`]). `units` are the file's; `up` is the axis of the plates that points up.
    pub(crate) fn of_file(file: &C3d, units: Units, up: UpAxis) -> Vec<Result<Plate>> {
        let analog = file.analog();
        let plate = |plate: &ForcePlate| {
            let analog = analog.as_ref().ok_or("has no analog channels")?;
            Plate::new(plate, analog, units, up)
        };
        file.force_plates().iter().map(plate).collect()
    }

    fn new(plate: &ForcePlate, analog: &Analog, units: Units, up: UpAxis) -> Result<Plate> {
        let scale = 10.0 * units.unit.centimeters();
        let to_lab = up.rotation().transpose() * units.up.rotation();
        let sensors = Sensors::new(plate, analog, scale)?;
        let [a, b, c, d] = plate.corners;
        let (x, y) = ((a - b).normalize(), a - d);
        let z = x.cross(y).normalize();
        if !z.is_finite() {
            return Err(Error::unfit("has corners that span no surface"));
        }
        let mut axes = to_lab * DMat3::from_cols(x, z.cross(x), z);
        if to_lab.determinant() < 0.0 {
            let height = axes.z_axis.dot(up.rotation().transpose().y_axis);
            if height.abs() < LEAST_LEVEL {
                return Err(Error::unfit(
                    "stands upright: in left-handed axes its corners do not tell its own axes",
                ));
            }
            axes.z_axis *= -height.signum();
        }
        // A moment in left-handed axes, r x f by the numbers, turns the other way.
        let hand = axes.determinant().signum();
        let samples = analog.values.rows().into_iter().map(|row| {
            let raw: Vec<f64> = sensors.columns.iter().map(|c| row[*c]).collect();
            let [force, moment] = sensors.load(&raw);
            (axes * force, hand * (axes * moment))
        });
        let (force, moment) = samples.unzip();
        Ok(Plate {
            center: to_lab * (a + b + c + d) / 4.0 * scale,
            normal: axes.z_axis,
            per_frame: analog.per_frame,
            force,
            moment,
        })
    }

    /// The center of pressure of a sample, on the surface; not finite where nothing presses.
    pub(crate) fn pressure(&self, sample: usize) -> DVec3 {
        let (f, m) = (self.force[sample], self.moment[sample]);
        self.center + self.normal.cross(m) / self.normal.dot(f)
    }

    /// The free moment of a sample about the center of pressure, N mm.
    pub(crate) fn free_moment(&self, sample: usize) -> DVec3 {
        let arm = self.pressure(sample) - self.center;
        self.moment[sample] - arm.cross(self.force[sample])
    }
}

/// What turns the numbers of a plate's channels into force and moment.
struct Sensors<'a> {
    kind: u32,
    columns: &'a [usize],
    /// From the origin of the sensors to the middle of the surface, mm.
    origin: DVec3,
    matrix: Option<[[f64; 6]; 6]>,
    /// Millimeters in a unit of the channels of type 1 with the center of pressure.
    arm_scale: f64,
    /// N mm in a unit of the channels with moments.
    moment_scale: f64,
}

impl Sensors<'_> {
    fn new<'a>(plate: &'a ForcePlate, analog: &Analog, scale: f64) -> Result<Sensors<'a>> {
        let kind = plate.kind;
        if !(1..=4).contains(&kind) {
            let what = format!("is of type {kind}; types 1, 2, 3 and 4 are read");
            return Err(Error::unfit(what));
        }
        let count = if kind == 3 { 8 } else { 6 };
        let is_there = |all: &&[usize]| all.iter().all(|c| *c < analog.values.ncols());
        let columns = plate.channels.get(..count).filter(is_there);
        let columns =
            columns.ok_or_else(|| format!("lacks some of the {count} channels of type {kind}"))?;
        let matrix = plate.matrix.filter(|_| kind == 4);
        if kind == 4 && matrix.is_none() {
            return Err(Error::unfit("is of type 4 and has no CAL_MATRIX"));
        }
        let unit = |channel: usize| &*analog.units[columns[channel]];
        let arm_unit = LengthUnit::of_word(unit(3)).map(|unit| 10.0 * unit.centimeters());
        // z points down, from the sensors below the surface up to it; some files turn it.
        let turn = if plate.origin.z > 0.0 { -1.0 } else { 1.0 };
        Ok(Sensors {
            kind,
            columns,
            origin: plate.origin * scale * turn,
            matrix,
            arm_scale: arm_unit.unwrap_or(scale),
            moment_scale: moment_unit(unit(if kind == 1 { 5 } else { 3 })).unwrap_or(scale),
        })
    }

    /// The force on the foot, N, and its moment about the middle of the surface, N mm, in the
    /// plate's axes.
    fn load(&self, raw: &[f64]) -> [DVec3; 2] {
        let three = |v: &[f64]| DVec3::new(v[0], v[1], v[2]);
        if self.kind == 1 {
            let force = three(raw);
            let arm = DVec3::new(raw[3], raw[4], 0.0) * self.arm_scale;
            let free = DVec3::Z * raw[5] * self.moment_scale;
            return [force, arm.cross(force) + free];
        }
        if let [x12, x34, y14, y23, z1, z2, z3, z4] = *raw {
            let DVec3 { x: a, y: b, z: c } = self.origin;
            let force = DVec3::new(x12 + x34, y14 + y23, z1 + z2 + z3 + z4);
            let moment = DVec3::new(
                b * (z1 + z2 - z3 - z4),
                a * (z2 + z3 - z1 - z4),
                b * (x34 - x12) + a * (y14 - y23),
            );
            return [force, moment + force.cross(DVec3::Z * c)];
        }
        let six = self.matrix.map_or_else(
            || raw.to_vec(),
            |m| {
                let rows = m.iter();
                rows.map(|row| row.iter().zip(raw).map(|(m, v)| m * v).sum())
                    .collect()
            },
        );
        let (force, moment) = (three(&six), three(&six[3..]) * self.moment_scale);
        [force, moment + force.cross(self.origin)]
    }
}

/// The N mm of a channel's unit of moments; `None` of words that are none.
fn moment_unit(word: &str) -> Option<f64> {
    let letters = word.chars().filter(char::is_ascii_alphanumeric);
    match &*letters.collect::<String>().to_ascii_lowercase() {
        "nm" => Some(1e3),
        "ncm" => Some(10.0),
        "nmm" => Some(1.0),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    const MATRIX: [[f64; 6]; 6] = [
        [2.0, 0.5, 0.0, 0.0, 0.0, 0.0],
        [0.0, 2.0, 0.5, 0.0, 0.0, 0.0],
        [0.0, 0.0, 2.0, 0.5, 0.0, 0.0],
        [0.0, 0.0, 0.0, 2.0, 0.5, 0.0],
        [0.0, 0.0, 0.0, 0.0, 2.0, 0.5],
        [0.0, 0.0, 0.0, 0.0, 0.0, 2.0],
    ];
    /// Corners of a plate that is turned, sloping and raised, its z down.
    const MIDDLE: DVec3 = DVec3::new(300.0, 400.0, 150.0);
    /// On the foot, in the plate's axes: N, mm, N mm.
    const FORCE: DVec3 = DVec3::new(30.0, -45.0, -700.0);
    const ARM: DVec3 = DVec3::new(60.0, -110.0, 0.0);
    const FREE: DVec3 = DVec3::new(0.0, 0.0, 4e3);

    fn axes() -> DMat3 {
        DMat3::from_rotation_z(0.5) * DMat3::from_rotation_y(0.14) * DMat3::from_rotation_x(3.1)
    }

    /// A plate of a type with its file's origin and the numbers of its channels.
    fn planted(kind: u32, origin: DVec3) -> (ForcePlate, Vec<f64>) {
        seen_in(DVec3::ONE, kind, origin)
    }

    /// A plate as [`planted`] whose own axes `hand` reflects, one of them or none.
    fn seen_in(hand: DVec3, kind: u32, origin: DVec3) -> (ForcePlate, Vec<f64>) {
        let (force, arm) = (hand * FORCE, hand * ARM);
        let free = hand * FREE * hand.element_product();
        let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
        let corners =
            corners.map(|(x, y)| MIDDLE + axes() * (hand * DVec3::new(232.0 * x, 254.0 * y, 0.0)));
        let sunk = if kind == 3 {
            DVec3::Z * origin.z
        } else {
            origin
        };
        let n = arm.cross(force) + free - force.cross(sunk);
        let six = [force.to_array(), n.to_array()].concat();
        let raw = match kind {
            1 => vec![force.x, force.y, force.z, arm.x, arm.y, free.z],
            3 => {
                let (a, b) = (origin.x, origin.y);
                let z = |s: f64, v: f64| (force.z + s * n.x / b + v * n.y / a) / 4.0;
                let (x, y) = (n.z / b / 4.0, n.z / a / 4.0);
                let two = [force.x / 2.0 - x, force.x / 2.0 + x];
                let four = [force.y / 2.0 + y, force.y / 2.0 - y];
                let z = [z(1.0, -1.0), z(1.0, 1.0), z(-1.0, 1.0), z(-1.0, -1.0)];
                [&two[..], &four, &z].concat()
            }
            4 => {
                let mut raw = six;
                for i in (0..6).rev() {
                    let next = raw.get(i + 1).map_or(0.0, |v| 0.5 * v);
                    raw[i] = (raw[i] - next) / 2.0;
                }
                raw
            }
            _ => six,
        };
        let plate = ForcePlate {
            kind,
            corners,
            origin,
            channels: (0..raw.len()).rev().collect(),
            matrix: Some(MATRIX),
        };
        (plate, raw)
    }

    /// The plate as it is computed from its channels, which stand in the reverse order.
    fn computed(
        plate: &ForcePlate,
        raw: &[f64],
        words: &[&str],
        unit: LengthUnit,
    ) -> Result<Plate> {
        computed_in(UpAxis::Z, plate, raw, words, unit)
    }

    fn computed_in(
        up: UpAxis,
        plate: &ForcePlate,
        raw: &[f64],
        words: &[&str],
        unit: LengthUnit,
    ) -> Result<Plate> {
        let analog = Analog {
            labels: vec![String::new(); raw.len()],
            units: words.iter().rev().map(|unit| unit.to_string()).collect(),
            per_frame: 10,
            values: Array2::from_shape_fn((3, raw.len()), |(s, c)| {
                let at = raw.len() - 1 - c;
                // Twice the load, at the same point.
                let is_arm = plate.kind == 1 && [3, 4].contains(&at);
                raw[at] * if is_arm { 1.0 } else { s as f64 }
            }),
        };
        Plate::new(plate, &analog, Units { unit, up }, UpAxis::Y)
    }

    fn is_planted(plate: &Plate) {
        let turn = UpAxis::Z.rotation();
        let lab = turn * axes();
        let moment = ARM.cross(FORCE) + FREE;
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-9 * b.length(), "{a} {b}");
        near(plate.center, turn * MIDDLE);
        for s in 1..3 {
            near(plate.force[s], lab * FORCE * s as f64);
            near(plate.moment[s], lab * moment * s as f64);
            near(plate.pressure(s), turn * MIDDLE + lab * ARM);
            near(plate.free_moment(s), lab * FREE * s as f64);
        }
        assert!(!plate.pressure(0).is_finite() && plate.force[0] == DVec3::ZERO);
    }

    #[test]
    fn a_planted_force_is_found_by_each_type() {
        for kind in 1..=4 {
            let origins = match kind {
                3 => vec![DVec3::new(120.0, 200.0, -42.0)],
                // Turned round in some files.
                _ => vec![DVec3::new(3.0, -2.0, -40.0), DVec3::new(-3.0, 2.0, 40.0)],
            };
            let (plate, raw) = planted(kind, origins[0]);
            for origin in origins {
                let plate = ForcePlate {
                    origin,
                    ..plate.clone()
                };
                is_planted(
                    &computed(&plate, &raw, &["V"; 8][..raw.len()], LengthUnit::Mm).unwrap(),
                );
            }
        }
    }

    #[test]
    fn left_handed_laboratories_have_the_same_loads() {
        let origins = [
            DVec3::new(3.0, -2.0, -40.0),
            DVec3::new(120.0, 200.0, -42.0),
        ];
        // The plate's own axes are its maker's, or as in the mirror that the file is: x or y.
        let hands = [DVec3::ONE, DVec3::ONE.with_x(-1.0), DVec3::ONE.with_y(-1.0)];
        for (kind, hand) in (1..=4).flat_map(|kind| hands.map(|hand| (kind, hand))) {
            let is_third = kind == 3;
            let origin = if is_third {
                origins[1]
            } else {
                hand * origins[0]
            };
            let (mut plate, raw) = seen_in(hand, kind, origin);
            plate.corners = plate.corners.map(|c| c * DVec3::new(1.0, -1.0, 1.0));
            let words = &["V"; 8][..raw.len()];
            let in_up = |up| computed_in(up, &plate, &raw, words, LengthUnit::Mm).unwrap();
            is_planted(&in_up(UpAxis::LeftZ));
            assert!(in_up(UpAxis::Z).force[1] != in_up(UpAxis::LeftZ).force[1]);
        }
        let (mut plate, raw) = planted(2, origins[0]);
        let upright = |c: DVec3| DVec3::new(c.x, c.z, c.y);
        plate.corners = plate.corners.map(upright);
        let said = computed_in(UpAxis::LeftZ, &plate, &raw, &["V"; 6], LengthUnit::Mm);
        let said = said.unwrap_err().to_string();
        assert!(said.contains("stands upright"), "{said}");
    }

    #[test]
    fn units_are_those_of_channels_else_of_points() {
        for kind in 1..=4 {
            let (mut plate, mut raw) = planted(kind, DVec3::new(120.0, 200.0, -42.0));
            plate.corners.iter_mut().for_each(|corner| *corner /= 1e3);
            plate.origin /= 1e3;
            // Type 4's matrix mixes forces and moments.
            let units = match kind {
                1 => {
                    raw[3] /= 10.0;
                    raw[4] /= 10.0;
                    ["N", "N", "N", "cm", "cm", "N.mm"]
                }
                3 => {
                    let found = computed(&plate, &raw, &["N"; 8], LengthUnit::M);
                    is_planted(&found.unwrap());
                    continue;
                }
                _ => ["N", "N", "N", "Nmm", "Nmm", "Nmm"],
            };
            is_planted(&computed(&plate, &raw, &units, LengthUnit::M).unwrap());
        }
        let (plate, mut raw) = planted(2, DVec3::new(3.0, -2.0, -40.0));
        raw[3..].iter_mut().for_each(|moment| *moment /= 1e3);
        let words = ["N", "N", "N", "Nm", "Nm", "Nm"];
        is_planted(&computed(&plate, &raw, &words, LengthUnit::Mm).unwrap());
        assert_eq!(
            ["N-m", "Ncm", "mV", "ntmm", ""].map(moment_unit),
            [Some(1e3), Some(10.0), None, None, None]
        );
    }

    #[test]
    fn what_is_not_whole_is_refused() {
        let (plate, raw) = planted(2, DVec3::ZERO);
        let refused = |plate: ForcePlate, part: &str| {
            let said = computed(&plate, &raw, &[""; 6], LengthUnit::Mm)
                .unwrap_err()
                .to_string();
            assert!(said.contains(part), "{said}");
        };
        let of = |kind| ForcePlate {
            kind,
            ..plate.clone()
        };
        refused(of(21), "is of type 21; types 1, 2, 3 and 4 are read");
        refused(of(3), "lacks some of the 8 channels");
        refused(
            ForcePlate {
                matrix: None,
                ..of(4)
            },
            "no CAL_MATRIX",
        );
        refused(
            ForcePlate {
                channels: (1..7).collect(),
                ..of(2)
            },
            "lacks some",
        );
        refused(
            ForcePlate {
                corners: [DVec3::ONE; 4],
                ..of(2)
            },
            "corners",
        );
    }
}
