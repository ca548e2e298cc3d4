//! Which vertex each marker is on, learned from a mesh of the person.

use posing::body::decomposition::fit_rotations;
use posing::body::{BodyModel, Marker};
use posing::cli::body::{points_of, read_meshes, vertices};
use posing::cli::messages;
use posing::io::Table;
use posing::pose::units::Units;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// A point farther than this from the skin is on no body, centimeters.
const ON_BODY: f64 = 10.0;

/// The points of frame `frame` of a table that are near a mesh of the person in that frame: their
/// names, the vertices nearest to them, and their offsets.
///
/// # Errors
/// [`Error::Data`]: the mesh has another topology than the body, or hardly a point is near it.
/// [`Error::Usage`]: the table has no such
/// frame.
pub fn markers_on_scan(
    body: &BodyModel,
    scan: &Path,
    units: Units,
    table: &Table,
    frame: usize,
) -> Result<(Vec<String>, Vec<Marker>)> {
    let set = read_meshes(&[PathBuf::from(scan)], units)?;
    let fail = |what: String| Err(Error::data(Place::file(&set.names[0]), what));
    let mesh = vertices(&set, 0);
    if mesh.len() != body.template.vertices.len() {
        return fail(format!(
            "has {} vertices, the body {}; register it with mesh-register first",
            mesh.len(),
            body.template.vertices.len()
        ));
    }
    if frame >= table.poses.frames() {
        return Err(Error::usage(format!(
            "--scan-frame {frame}: the table has {} frames",
            table.poses.frames()
        )));
    }
    let rotations = fit_rotations(&body.template, &mesh);
    let all: Vec<usize> = (0..table.poses.points.len()).collect();
    let (mut names, mut markers, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    for (k, point) in points_of(&table.poses, frame, &all).into_iter().enumerate() {
        let name = &table.poses.points[k];
        let distance = |v: &usize| point.map_or(f64::INFINITY, |p| (mesh[*v] - p).length());
        let nearest = (0..mesh.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        match (point, nearest) {
            (Some(point), Some(v)) if distance(&v) <= ON_BODY => {
                let turn = rotations[body.template.vertex_parts[v]].transpose();
                names.push(name.clone());
                markers.push(Marker {
                    vertices: vec![(v, 1.0)],
                    offset: turn * (point - mesh[v]),
                });
            }
            _ => left_out.push(name.as_str()),
        }
    }
    if markers.len() < posing::body::fit::FEWEST {
        return fail(format!(
            "has only {} points of frame {frame} within {ON_BODY} cm; check --scan-units and \
             --scan-frame",
            markers.len()
        ));
    }
    if !left_out.is_empty() {
        messages::info(&format!(
            "left out, missing in frame {frame} or more than {ON_BODY} cm from the scan: {}",
            left_out.join(", ")
        ));
    }
    Ok((names, markers))
}
