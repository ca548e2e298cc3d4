//! Points that a person has placed on a scan: `vertex,x,y,z`.

use super::number_table;
use super::units::TableUnits;
use crate::{Error, Place, Result};
use glam::DVec3;
use std::path::Path;

/// Reads vertices of a template with `vertices` vertices, counted from 0, and where they are, in centimetres, y up.
///
/// # Errors
/// [`Error::Data`], with the line: a column is missing, a cell is empty or no number, or a vertex is not there.
pub fn read_placed_points(
    path: &Path,
    units: TableUnits,
    vertices: usize,
) -> Result<Vec<(usize, DVec3)>> {
    let table = number_table::read(path)?;
    let mut columns = [0; 4];
    for (at, name) in columns.iter_mut().zip(["vertex", "x", "y", "z"]) {
        *at = (table.columns.iter().position(|c| c == name)).ok_or_else(|| {
            let what = format!("has no column {name}; expected vertex,x,y,z");
            Error::data(Place::line(&table.name, 1), what)
        })?;
    }
    let mut points = Vec::with_capacity(table.values.nrows());
    for (k, row) in table.values.rows().into_iter().enumerate() {
        let [vertex, x, y, z] = columns.map(|c| row[c]);
        let fail = |what: String| Err(Error::data(Place::line(&table.name, k as u64 + 2), what));
        if [vertex, x, y, z].iter().any(|v| v.is_nan()) {
            return fail("has an empty cell".into());
        }
        if vertex < 0.0 || vertex.fract() != 0.0 || vertex >= vertices as f64 {
            return fail(format!(
                "names vertex {vertex}, there are {vertices} (counted from 0)"
            ));
        }
        let mut at = [x, y, z];
        units.read(&mut at);
        points.push((vertex as usize, DVec3::from_array(at)));
    }
    Ok(points)
}
