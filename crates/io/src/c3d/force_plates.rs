//! The force plates of a C3D file: where they lie and which analog channels are theirs.

use super::C3d;
use glam::DVec3;

/// A force plate as the file describes it, in the file's unit and axes.
#[derive(Debug, Clone, PartialEq)]
pub struct ForcePlate {
    /// FORCE_PLATFORM:TYPE. 1 has the force, the center of pressure and the free moment in six
    /// channels, 2 the force and the moment about three axes, 4 the same through a matrix; 3 has
    /// the forces of four sensors in eight.
    pub kind: u32,
    /// The corners of the surface in the laboratory: at the plate's +x +y, -x +y, -x -y, +x -y.
    pub corners: [DVec3; 4],
    /// FORCE_PLATFORM:ORIGIN: from the origin of the sensors to the middle of the surface, in the
    /// plate's axes (z down). Of type 3: from its middle to the sensors along x and y, then z.
    pub origin: DVec3,
    /// The analog channels in the order of its type, counted from 0.
    pub channels: Vec<usize>,
    /// FORCE_PLATFORM:CAL_MATRIX of type 4: what the six channels are multiplied with, by rows.
    pub matrix: Option<[[f64; 6]; 6]>,
}

impl C3d {
    /// The force plates in their order; those without corners or channels are left out.
    pub fn force_plates(&self) -> Vec<ForcePlate> {
        let all = |name: &str| {
            self.parameters
                .all_numbers(&format!("FORCE_PLATFORM:{name}"))
        };
        let used = self.parameters.number("FORCE_PLATFORM:USED");
        let used = used.unwrap_or(0.0) as usize;
        let (kinds, corners, origins) = (all("TYPE"), all("CORNERS"), all("ORIGIN"));
        let (channels, matrices) = (all("CHANNEL"), all("CAL_MATRIX"));
        let each = channels.len().checked_div(used).unwrap_or(0);
        let point = |p: &[f64]| DVec3::new(p[0], p[1], p[2]);
        let plate = |(i, corners): (usize, &[f64])| {
            let own = channels.get(i * each..(i + 1) * each)?;
            // Beside plates of more channels, zeros stand behind those of fewer.
            let count = own.iter().rposition(|c| *c > 0.0)? + 1;
            let own = &own[..count];
            let own = own.iter().map(|c| (*c as usize).checked_sub(1));
            let matrix = matrices.get(36 * i..36 * (i + 1));
            Some(ForcePlate {
                kind: *kinds.get(i)? as u32,
                corners: [0, 1, 2, 3].map(|c| point(&corners[3 * c..])),
                origin: origins.get(3 * i..3 * i + 3).map(point)?,
                channels: own.collect::<Option<Vec<_>>>()?,
                // The file counts by columns.
                matrix: matrix
                    .map(|m| [0, 1, 2, 3, 4, 5].map(|r| [0, 1, 2, 3, 4, 5].map(|c| m[6 * c + r]))),
            })
        };
        let corners = corners.chunks_exact(12).enumerate().take(used);
        corners.filter_map(plate).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::analog::testdata::file;
    use super::*;

    #[test]
    fn plates_that_are_whole_are_read() {
        let corners: Vec<f32> = (0..30_u8).map(f32::from).collect();
        let matrix: Vec<f32> = (0..36_u8).map(f32::from).collect();
        let channels: Vec<f32> = (1..=18_u8).map(f32::from).collect();
        let parameters: [(u8, &str, &[f32]); 6] = [
            (2, "USED", &[3.0]),
            (2, "TYPE", &[4.0, 2.0, 2.0]),
            (2, "CORNERS", &corners),
            (2, "ORIGIN", &[0.0, 1.0, -40.0, 0.0, 0.0, 9.0]),
            (2, "CHANNEL", &channels),
            (2, "CAL_MATRIX", &matrix),
        ];
        let plates = file(&parameters, b"", &[]).force_plates();
        assert_eq!(plates.len(), 2); // the third has but half of its corners
        assert_eq!((plates[0].kind, plates[1].kind), (4, 2));
        assert_eq!(plates[1].corners[0], DVec3::new(12.0, 13.0, 14.0));
        assert_eq!(plates[0].origin, DVec3::new(0.0, 1.0, -40.0));
        assert_eq!(plates[1].channels, [6, 7, 8, 9, 10, 11]);
        assert!(plates[0].matrix.unwrap()[1][2] == 13.0 && plates[1].matrix.is_none());
        let padded = [1.0, 2.0, 0.0, 3.0, 0.0, 4.0];
        let padded = [
            &parameters[1..4],
            &[(2, "USED", &[2.0]), (2, "CHANNEL", &padded)],
        ]
        .concat();
        let plates = file(&padded, b"", &[]).force_plates();
        assert!(plates.len() == 1 && plates[0].channels == [0, 1]); // a channel 0 is none
        let many: [(u8, &str, &[f32]); 2] = [(2, "USED", &[6e4]), (2, "CORNERS", &corners)];
        assert!(file(&many, b"", &[]).force_plates().is_empty());
    }
}
