//! One take of a table: motion files hold one.

use super::Poses;
use crate::{Error, Place, Result};
use ndarray::Axis;
use std::collections::HashSet;
use std::sync::Arc;

/// Most names that an error lists.
const LISTED: usize = 8;

/// The frames of the take `wanted`, or all frames of a table with one take.
///
/// ```
/// use posing_core::pose::{Poses, one_take::one_take};
///
/// let take = Some(["walk", "run", "run"].map(Into::into).to_vec());
/// let (points, xyz) = (vec!["hand".into()], ndarray::Array2::zeros((3, 3)));
/// let takes = Poses { points, xyz, time: None, take };
/// assert_eq!(one_take(takes.clone(), Some("run"), "day.csv")?.frames(), 2);
/// assert!(one_take(takes, None, "day.csv").is_err()); // two takes, and none is wanted
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Data`] if the table has several takes and none is wanted, or not the wanted one; it
/// lists the takes of the table called `name`.
pub fn one_take(poses: Poses, wanted: Option<&str>, name: &str) -> Result<Poses> {
    let Some(rows) = take_rows(&poses, wanted, name)? else {
        return Ok(poses);
    };
    let of = |list: &[Arc<str>]| rows.iter().map(|&i| list[i].clone()).collect();
    Ok(Poses {
        xyz: poses.xyz.select(Axis(0), &rows),
        time: (poses.time.as_ref()).map(|t| rows.iter().map(|&i| t[i]).collect()),
        take: poses.take.as_deref().map(of),
        points: poses.points,
    })
}

/// The rows of the take `wanted`; `None`: all, of a table with one take. Fails as [`one_take`]
/// does.
#[doc(hidden)]
pub fn take_rows(poses: &Poses, wanted: Option<&str>, name: &str) -> Result<Option<Vec<usize>>> {
    let mut names: Vec<Arc<str>> = Vec::new();
    if let Some(takes) = &poses.take {
        let mut listed = HashSet::new();
        for run in poses.takes() {
            if listed.insert(&takes[run.start]) {
                names.push(takes[run.start].clone());
            }
            // Enough names to know that there are several, and to list some.
            if names.len() > LISTED && wanted.is_none() {
                break;
            }
        }
    }
    let listed = || {
        let mut text = names
            .iter()
            .take(LISTED)
            .map(|n| n.to_string())
            .collect::<Vec<_>>()
            .join(", ");
        if names.len() > LISTED {
            text.push_str(", ...");
        }
        text
    };
    match (wanted, &poses.take) {
        (None, _) if names.len() <= 1 => Ok(None),
        (None, _) => {
            let what = format!(
                "has several takes ({}); choose one with the option `take`",
                listed()
            );
            Err(Error::data(Place::file(name), what))
        }
        (Some(wanted), Some(takes)) if names.iter().any(|n| **n == *wanted) => {
            let is_wanted = |&i: &usize| *takes[i] == *wanted;
            Ok(Some((0..poses.frames()).filter(is_wanted).collect()))
        }
        (Some(wanted), _) => {
            let what = if names.is_empty() {
                "has no column take; leave the option `take` out".to_string()
            } else {
                format!("has no take \"{wanted}\"; it has {}", listed())
            };
            Err(Error::data(Place::file(name), what))
        }
    }
}

/// The first frame's number: 1 + time * rate where that is a whole number, else 1.
pub fn first_frame_number(poses: &Poses, rate: Option<f64>) -> u64 {
    let first = poses.time.as_ref().and_then(|t| t.first());
    let (Some(&time), Some(rate)) = (first, rate) else {
        return 1;
    };
    let number = 1.0 + time * rate;
    if (number - number.round()).abs() <= 0.01 && (0.0..1e15).contains(&number.round()) {
        number.round() as u64
    } else {
        1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn poses(takes: Option<&[&str]>) -> Poses {
        Poses {
            points: vec!["a".into()],
            xyz: Array2::from_shape_fn((3, 3), |(i, j)| (3 * i + j) as f64),
            time: Some(vec![0.0, 1.0, 0.0]),
            take: takes.map(|t| t.iter().map(|&s| Arc::from(s)).collect()),
        }
    }

    #[test]
    fn a_single_take_needs_no_name() {
        assert_eq!(one_take(poses(None), None, "x").unwrap().frames(), 3);
        let one = poses(Some(&["w"; 3]));
        assert_eq!(one_take(one, None, "x").unwrap().frames(), 3);
        assert_eq!(one_take(Poses::default(), None, "x").unwrap().frames(), 0);
    }

    #[test]
    fn one_of_several_is_chosen_by_name() {
        let two = || poses(Some(&["w", "w", "v"]));
        let e = one_take(two(), None, "x.csv").unwrap_err().to_string();
        assert_eq!(
            e,
            "x.csv: has several takes (w, v); choose one with the option `take`"
        );
        let v = one_take(two(), Some("v"), "x").unwrap();
        assert_eq!((v.frames(), v.xyz[[0, 0]]), (1, 6.0));
        assert!(one_take(two(), Some("u"), "x").is_err());
        assert!(one_take(poses(None), Some("u"), "x").is_err());
    }
}
