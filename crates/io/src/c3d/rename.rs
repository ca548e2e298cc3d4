//! The points of a C3D file named anew: its parameters with other labels, which lose their
//! description, all else as it is.

use super::C3d;
use super::parameters::text;
use super::stored_parameters::{StoredParameters, text_values};
use crate::{Place, Result};

impl C3d {
    /// The bytes of the file with other names of some of its points.
    ///
    /// # Errors
    /// [`Error::Data`]: a name, or all of them, are too long for the format.
    pub(crate) fn with_names(&self, names: &[(usize, String)]) -> Result<Vec<u8>> {
        let named = self.with_labels(names);
        named.map_err(|e| e.at(Place::file(&self.take.name)))
    }

    fn with_labels(&self, names: &[(usize, String)]) -> Result<Vec<u8>> {
        let mut parameters = StoredParameters::of(self, "its points cannot be named")?;
        let group = parameters.group("POINT");
        let group = group.ok_or("has no parameters of points: they cannot be named")?;
        // Also labels of points that the file does not have.
        let stored = parameters.texts(group, "LABELS").unwrap_or_default();
        let labels = stored.iter().map(|label| text(label).into_bytes());
        let mut labels: Vec<Vec<u8>> = labels.collect();
        labels.resize(labels.len().max(self.layout.points), Vec::new());
        for (point, name) in names {
            labels[*point] = name.clone().into_bytes();
        }
        parameters.set_described(group, "LABELS", text_values(&labels)?, &[0])?;
        let bytes = parameters.finish(&self.bytes[self.layout.start..]);
        bytes.ok_or_else(|| "has no room for such long names".into())
    }
}

#[cfg(test)]
mod tests {
    use super::super::write::NewC3d;
    use super::*;
    use crate::Input;
    use ndarray::Array2;

    fn read(bytes: Vec<u8>) -> C3d {
        C3d::read(
            Input::new("take.c3d".to_string(), std::io::Cursor::new(bytes)).unwrap(),
            false,
        )
        .unwrap()
    }

    #[test]
    fn points_are_named_anew_and_all_else_stays() {
        for count in [3, 300] {
            let points: Vec<String> = (0..count).map(|n| format!("*{n}")).collect();
            let xyz = Array2::from_shape_fn((4, 3 * count), |(t, c)| (t * 7 + c) as f64 / 3.0);
            let new = NewC3d {
                points: &points,
                rate: 100.0,
                first_frame: 5,
                units: "mm",
                screen: ["+X", "+Z"],
            };
            let c3d = read(new.bytes(xyz.view()).unwrap());
            let long = "a name that is far longer than those were".to_string();
            for name in ["L".to_string(), long] {
                let names = [(1, name.clone()), (count - 1, "R".into())];
                let renamed = read(c3d.with_names(&names).unwrap());
                let mut want = points.clone();
                (want[1], want[count - 1]) = (name, "R".into());
                assert_eq!(renamed.take.points, want);
                assert_eq!(renamed.take.xyz, c3d.take.xyz);
                assert_eq!(
                    (renamed.take.rate, renamed.take.first_frame),
                    (Some(100.0), 5)
                );
                assert_eq!(renamed.take.units, c3d.take.units);
                assert_eq!(renamed.take.notes, Vec::<String>::new());
            }
            let error = c3d
                .with_names(&[(0, "x".repeat(256))])
                .unwrap_err()
                .to_string();
            assert!(error.contains("so long a name"), "{error}");
        }
    }
}
