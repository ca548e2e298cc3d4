//! Hand-placed points for a registration: where vertices of the template are on the scan.

use super::input;
use super::pair_file::{read_columns, whole_number};
use crate::body::registration::start;
use crate::body::surface::Surface;
use crate::io::Mesh;
use crate::io::text::excerpt;
use crate::pose::units::Units;
use crate::{Error, Place, Result};
use glam::DVec3;
use std::path::Path;

/// A point farther than this from the scan is not on it, centimeters.
const ON_SCAN: f64 = 10.0;

/// The points of a file `vertex,x,y,z`.
pub struct RegistrationPoints {
    /// Where they came from.
    pub name: String,
    /// The lines of the file.
    lines: Vec<u64>,
    /// Vertices of the template, and positions, cm.
    pub points: Vec<(usize, DVec3)>,
}

impl RegistrationPoints {
    /// Reads points on a template of so many vertices.
    ///
    /// # Errors
    /// [`Error::Data`], with the line: no whole number, a vertex that is not there or is named
    /// twice, a coordinate that is not finite.
    pub fn read(path: &Path, vertices: usize, units: Units) -> Result<RegistrationPoints> {
        let (name, rows) = read_columns(path, ["vertex", "x", "y", "z"])?;
        let mut read = RegistrationPoints {
            name,
            lines: Vec::new(),
            points: Vec::new(),
        };
        for (line, [vertex, xyz @ ..]) in &rows {
            let vertex = whole_number(&read.name, *line, vertex, "vertex", vertices)?;
            let wrong = |what: String| Error::data(Place::line(&read.name, *line), what);
            if read.points.iter().any(|(v, _)| *v == vertex) {
                return Err(wrong(format!("places vertex {vertex} a second time")));
            }
            let mut at = [0.0; 3];
            for (at, cell) in at.iter_mut().zip(xyz) {
                let number = cell.parse().ok().filter(|v: &f64| v.is_finite());
                *at = number.ok_or_else(|| {
                    wrong(format!(
                        "expected a coordinate, found \"{}\"",
                        excerpt(cell)
                    ))
                })?;
            }
            units.read(&mut at);
            read.lines.push(*line);
            read.points.push((vertex, DVec3::from_array(at)));
        }
        Ok(read)
    }

    /// Fails if no registration can start from the points: too few, on a line, far from the scan,
    /// or of another size than the template.
    ///
    /// # Errors
    /// [`Error::Data`]: which of these, and the remedy.
    pub fn check(&self, template: &[DVec3], scan: &Surface) -> Result<()> {
        let fail = |what: String| Error::data(Place::file(&self.name), what);
        let similarity =
            start(template, &self.points).map_err(|e| e.at(Place::file(&self.name)))?;
        if !(1.0 / 3.0..3.0).contains(&similarity.scale) {
            return Err(fail(format!(
                "on the scan its {} points lie {:.3} times as far apart as on the template; check \
                 --units and --template-units",
                self.points.len(),
                similarity.scale
            )));
        }
        for (line, (_, at)) in self.lines.iter().zip(&self.points) {
            let distance = scan.nearest(*at).map_or(0.0, |p| (p.at - *at).length());
            if !(distance <= ON_SCAN) {
                let what = format!(
                    "the point is {distance:.0} cm from the scan, expected at most {ON_SCAN:.0}"
                );
                return Err(Error::data(Place::line(&self.name, *line), what));
            }
        }
        Ok(())
    }
}

/// Reads a scan in centimeters, y up.
///
/// # Errors
/// Those of `Mesh::read`.
pub fn read_scan(path: &Path, units: Units) -> Result<Surface> {
    let scan = Mesh::read(input::open(path)?)?;
    let vertex = |v: &[f64; 3]| {
        let mut xyz = *v;
        units.read(&mut xyz);
        DVec3::from_array(xyz)
    };
    let vertices = scan.vertices.iter().map(vertex).collect();
    let faces = (scan.faces.iter())
        .map(|f| units.up.triangle(f.map(|v| v as usize)))
        .collect();
    Ok(Surface::new(vertices, faces))
}
