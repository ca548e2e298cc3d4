//! Angles, forces, moments and powers, which C3D files store as points: columns of their own, never
//! positions.

use super::csv::{AddedColumn, After};
use super::marker_take::{MarkerTake, Quantity};
use super::text::number_cell;

/// The columns of a take's points that are no positions.
pub fn columns(take: &MarkerTake) -> Vec<AddedColumn> {
    let columns = others(take).flat_map(|p| {
        let endings = take.quantity(p).endings().iter();
        endings
            .map(move |ending| AddedColumn::new(format!("{}.{ending}", take.points[p]), After::All))
    });
    columns.collect()
}

/// The cells of these columns in a frame, in the units of the file; empty where the file has none.
pub fn cells(take: &MarkerTake, frame: usize) -> Vec<String> {
    let mut out = Vec::new();
    for p in others(take) {
        let xyz = [0, 1, 2].map(|c| take.xyz[[frame, 3 * p + c]]);
        match take.quantity(p) {
            // Most writers use the last of the three numbers only; else they are the parts by axis.
            Quantity::Power | Quantity::Scalar => out.push(number_cell(xyz.iter().sum())),
            _ => out.extend(xyz.map(number_cell)),
        }
    }
    out
}

/// The points that are no positions.
fn others(take: &MarkerTake) -> impl Iterator<Item = usize> {
    (0..take.points.len()).filter(|p| !take.quantity(*p).is_position())
}
