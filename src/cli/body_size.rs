//! A body of an absurd size is a table in another unit.

use crate::pose::body::stature;
use crate::pose::bone_points::bone_ends_of_starts;
use crate::pose::{BonePoints, Poses};
use crate::{Error, Place, Result};
use ndarray::{ArrayView2, s};

/// The statures of people, from the foot along the bones to the head, cm.
const PEOPLE: std::ops::RangeInclusive<f64> = 80.0..=260.0;

/// The remedy of commands that read centimetres alone.
pub const IN_CENTIMETRES: &str =
    "this command reads centimetres (complete and denoise convert: --units m --out-units cm)";

/// Fails where the body of a table named `name`, which was read as centimetres, is not of a person's size. Points that lack a head,
/// hips or feet by CMU's names are not judged. `remedy` tells how to name the unit.
///
/// # Errors
/// [`Error::Data`], naming the remedy.
pub fn check_body_size(poses: &Poses, points: BonePoints, name: &str, remedy: &str) -> Result<()> {
    let renamed;
    let names = match points {
        BonePoints::Ends => &poses.points,
        BonePoints::Starts => {
            renamed = bone_ends_of_starts(&poses.points);
            &renamed
        }
    };
    for take in poses.takes() {
        let xyz = poses.xyz.slice(s![take, ..]);
        match stature(names, xyz, noise_of(xyz)) {
            Some(cm) if !PEOPLE.contains(&cm) => {
                let size = if cm < *PEOPLE.start() {
                    "small"
                } else {
                    "large"
                };
                let what = format!(
                    "the body measures {cm:.3} cm from foot to head, too {size} for a person; {remedy}, or use --force to continue"
                );
                return Err(Error::data(Place::file(name), what));
            }
            _ => {}
        }
    }
    Ok(())
}

/// The standard deviation of the noise of a coordinate, by the second differences of consecutive frames, cm: enough to tell a body
/// whose bones noise makes longer from a larger one.
fn noise_of(xyz: ArrayView2<'_, f64>) -> f64 {
    let mut second: Vec<f64> = (1..xyz.nrows().saturating_sub(1).min(500))
        .flat_map(|t| (0..xyz.ncols()).map(move |i| (t, i)))
        .map(|(t, i)| (xyz[[t - 1, i]] - 2.0 * xyz[[t, i]] + xyz[[t + 1, i]]).abs())
        .filter(|d| d.is_finite())
        .collect();
    if second.is_empty() {
        return 0.0;
    }
    let middle = second.len() / 2;
    // The median of a normal variable's size is .6745 of its standard deviation, which is √6 of the noise's here.
    *second.select_nth_unstable_by(middle, f64::total_cmp).1 / (0.6745 * 6f64.sqrt())
}
