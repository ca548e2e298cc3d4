//! Takes with rotations on their floor.

use super::feet::{target, told};
use super::hold::hold;
use super::legs::Legs;
use super::motion::Body;
use super::report::{GroundReport, Grounded};
use crate::ik::retarget::hierarchy::Hierarchy;
use crate::ik::retarget::segments::BodyJoints;
use crate::io::Bvh;
use crate::pose::{NameMap, UpAxis};
use crate::{Error, Result};
use ndarray::Array2;

/// How a take is put on the floor.
#[derive(Debug, Clone, Copy)]
pub struct GroundOptions<'a> {
    /// The axis that points up.
    pub up: UpAxis,
    /// Frames per second, where the take does not say them.
    pub rate: Option<f64>,
    /// The names of the joints, as for [`Retargeter::new`](crate::ik::retarget::Retargeter::new).
    pub map: Option<&'a NameMap>,
    /// Whether feet are held where they stand.
    pub holds_feet: bool,
}

impl Default for GroundOptions<'_> {
    fn default() -> Self {
        GroundOptions {
            up: UpAxis::Y,
            rate: None,
            map: None,
            holds_feet: true,
        }
    }
}

/// Puts a take with rotations on its floor, and holds its feet where they stand: the values of its
/// channels.
///
/// ```
/// use posing_io::{Amc, Asf};
/// use posing_joints::ik::ground::{GroundOptions, Standing, ground_rotations};
///
/// let asf = Asf::open("../../testdata/cmu/07/07.asf")?;
/// let walk = Amc::open("../../testdata/cmu/07/07_01.amc", &asf)?.to_bvh(120.0)?;
/// let grounded = ground_rotations(&walk, &GroundOptions::default())?;
/// assert_eq!(grounded.report.standing, Standing::OnFloor);
/// assert!(!grounded.report.contacts.is_empty());
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Unfit`]: no frames or rate, nothing tells which joints are legs, or no joint above them
/// has the channels that would move the body.
pub fn ground_rotations(bvh: &Bvh, options: &GroundOptions<'_>) -> Result<Grounded<Array2<f64>>> {
    if bvh.motion.nrows() == 0 {
        return Err(Error::unfit("has no frames"));
    }
    let rate = bvh.rate_or(options.rate)?;
    let tree = Hierarchy::new(bvh, options.up.rotation());
    let joints = BodyJoints::find(&tree, options.map, "map")?;
    let body = Body::new(bvh, &tree, &joints, options.up)?;
    let mut legs = Legs::read(bvh, &tree, &joints, body.carrier, rate)?;
    let floor = match legs.feet.floor(|track, t| legs.is_upright(track, t)) {
        Ok(floor) => floor,
        Err(standing) => {
            let (take, report) = (bvh.motion.clone(), GroundReport::left(standing));
            return Ok(Grounded { take, report });
        }
    };
    let unit = legs.feet.scale[1];
    let lowest = floor.lowest(unit);
    let (sole, at_zero) = legs.sole(&floor, lowest);
    let height = target(&floor, lowest, sole, at_zero, unit);
    let level = floor.level(lowest, height, rate);
    let mut report = told(&level, [lowest, height], bvh.motion.nrows());
    legs.place(&level);
    let standing = legs.standing(&level);
    for (foot, contacts) in ["left", "right"].into_iter().zip(&standing) {
        report.add(contacts.told(foot, rate));
    }
    let held = options.holds_feet.then(|| hold(&legs, &standing));
    if let Some(held) = &held {
        report.held = Some(held.contacts);
        report.slide[1] = held.slide;
    }
    let take = body.motion(&level, held.as_ref());
    Ok(Grounded { take, report })
}
