//! A body of an absurd size is a table in another unit.

use super::tuning::body_size::*;
use super::typical_noise;
use crate::pose::Poses;
use crate::pose::body::stature;
use crate::pose::stray::points_apart;
use crate::{Error, Place, Result};
use ndarray::s;

/// Fails where the body of a table named `name`, which was read as centimeters, is not of a
/// person's size. `points` are the names of its points at bone ends, as CMU has them; without a
/// head, hips or feet a body is not judged. `remedy` tells how to name the unit.
///
/// # Errors
/// [`Error::Data`], naming the remedy.
pub fn check_body_size(poses: &Poses, points: &[String], name: &str, remedy: &str) -> Result<()> {
    for take in poses.takes() {
        let mut xyz = poses.xyz.slice(s![take, ..]).to_owned();
        // A stray point makes no body larger.
        for apart in points_apart(xyz.view(), *PEOPLE.end()) {
            let columns = s![.., 3 * apart.point..3 * apart.point + 3];
            xyz.slice_mut(columns).fill(f64::NAN);
        }
        let xyz = xyz.view();
        // Noise makes bones longer, which makes no larger body.
        let noise = typical_noise(xyz, std::slice::from_ref(&(0..xyz.nrows())));
        match stature(points, xyz, noise) {
            Some(cm) if !PEOPLE.contains(&cm) => {
                let size = if cm < *PEOPLE.start() {
                    "small"
                } else {
                    "large"
                };
                let what = format!(
                    "the body measures {cm:.3} cm from foot to head, too {size} for a person; \
                     {remedy}, or use the option `force` to continue"
                );
                return Err(Error::data(Place::file(name), what));
            }
            _ => {}
        }
    }
    Ok(())
}
