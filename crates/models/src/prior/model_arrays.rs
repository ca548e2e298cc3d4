//! Checked arrays of models.

use crate::io::Model;
use crate::{Error, Place, Result};
use ndarray::{CowArray, Ix2};

/// An array of finite numbers with that many rows and columns; `None` allows any number, but at
/// least one row.
///
/// # Errors
/// Data: no such array, another shape, numbers that are not finite.
pub fn array<'a>(
    model: &'a Model,
    name: &str,
    (rows, columns): (Option<usize>, Option<usize>),
    source: &str,
) -> Result<CowArray<'a, f32, Ix2>> {
    let array = model.array(name, source)?;
    let (n, d) = array.dim();
    let wrong = |what: String| Err(Error::data(Place::file(source).part(name), what));
    if n == 0 || rows.is_some_and(|r| r != n) || columns.is_some_and(|c| c != d) {
        let shown = |v: Option<usize>| v.map_or("some".into(), |v| v.to_string());
        let (rows, columns) = (shown(rows), shown(columns));
        return wrong(format!(
            "has the shape ({n}, {d}), expected ({rows}, {columns})"
        ));
    }
    if array.iter().any(|v| !v.is_finite()) {
        return wrong("holds a value that is not finite".into());
    }
    Ok(array)
}

/// An array of one finite number for each coordinate of the model's points: whole poses in its
/// rows, at least one, cm.
///
/// # Errors
/// As [`array`].
pub(super) fn poses<'a>(
    model: &'a Model,
    name: &str,
    source: &str,
) -> Result<CowArray<'a, f32, Ix2>> {
    let width = 3 * model.meta.points.len();
    array(model, name, (None, Some(width)), source)
}
