//! Tables that belong together: their points in one order.

use crate::Result;
use crate::pose::Poses;
use std::fmt::Display;

/// Times that differ by no more are equal, seconds: other tools round times.
const EQUAL_TIME: f64 = 1e-4;

/// The index in `other` of each point of `first`.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_score::alignment::point_order;
///
/// let poses = |points: [&str; 2]| Poses {
///     points: points.map(String::from).to_vec(),
///     xyz: ndarray::Array2::zeros((1, 6)),
///     ..Poses::default()
/// };
/// assert_eq!(point_order(&poses(["hip", "knee"]), &poses(["knee", "hip"]))?, [1, 0]);
/// assert!(point_order(&poses(["hip", "knee"]), &poses(["hip", "toe"])).is_err());
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::Unfit`], such as `has no point "head"`: a point is missing, or frames, takes or
/// times differ.
pub fn point_order(first: &Poses, other: &Poses) -> Result<Vec<usize>> {
    let find = |point: &String| {
        let found = other.points.iter().position(|p| p == point);
        found.ok_or_else(|| format!("has no point \"{point}\"").into())
    };
    let order = first.points.iter().map(find).collect::<Result<_>>()?;
    if first.frames() != other.frames() {
        let (frames, wanted) = (other.frames(), first.frames());
        return Err(format!("has {frames} frames, not {wanted}").into());
    }
    // One take may have another name: that of its file.
    if first.takes().len() > 1 || other.takes().len() > 1 {
        differs("take", &first.take, &other.take, |a, b| a == b)?;
    }
    let equal = |a: &f64, b: &f64| (a - b).abs() <= EQUAL_TIME;
    differs("time", &first.time, &other.time, equal)?;
    Ok(order)
}

/// An error at the first frame in which two columns differ, if both tables have the column.
fn differs<T: Display>(
    what: &str,
    first: &Option<Vec<T>>,
    other: &Option<Vec<T>>,
    equal: impl Fn(&T, &T) -> bool,
) -> Result<()> {
    let (Some(first), Some(other)) = (first, other) else {
        return Ok(());
    };
    let mut frames = first.iter().zip(other).enumerate();
    match frames.find(|(_, (a, b))| !equal(a, b)) {
        Some((t, (a, b))) => {
            Err(format!("has {what} {b} in frame {t} (counted from 0), not {a}").into())
        }
        None => Ok(()),
    }
}
