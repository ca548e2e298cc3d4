//! How long the bones of people are, and where they point in the rest pose: a Gaussian prior over
//! the bones of CMU's skeletons, which also tells how unlike left and right are.

use crate::io::Model;
use crate::pose::Skeleton;
use crate::{Error, Result};
use glam::DVec3;
use ndarray::{Array1, Array2};

/// The bones of the middle.
pub const CENTRAL: [&str; 6] = [
    "lowerback",
    "upperback",
    "thorax",
    "lowerneck",
    "upperneck",
    "head",
];
/// The bones of a left and a right side, without their l and r.
pub const PAIRED: [&str; 10] = [
    "hipjoint", "femur", "tibia", "foot", "toes", "clavicle", "humerus", "radius", "wrist", "hand",
];
/// Bones that are learned: those of the middle, then those of the left side.
pub const COUNT: usize = CENTRAL.len() + PAIRED.len();
/// Share of the covariance between coordinates that so few skeletons can tell.
const TOLD: f64 = 0.75;
/// Standard deviation that every coordinate has beside the learned one, cm; and every asymmetry.
const FLOOR: f64 = 0.3;
const UNEVEN: f64 = 0.15;

/// Means and covariance of the bones of people.
#[derive(Debug, Clone, PartialEq)]
pub struct BonePrior {
    /// Vectors of the bones in the rest pose, x y z of each, the left ones for both sides; cm.
    pub mean: Array1<f64>,
    /// Their covariance, cm².
    pub covariance: Array2<f64>,
    /// By pair, the standard deviation of half the difference between left and right, cm.
    pub asymmetry: Vec<f64>,
}

/// The bones of a skeleton as the prior has them: means of left and right (3 [`COUNT`]), and half
/// the differences of the pairs.
pub fn bones_of(skeleton: &Skeleton) -> Result<(Vec<f64>, Vec<DVec3>)> {
    let offset = |name: &str| -> Result<DVec3> {
        let missing = || Error::usage(format!("the skeleton has no bone {name}"));
        let bone = skeleton.find(name).ok_or_else(missing)?;
        Ok(skeleton.bones()[bone].offset)
    };
    let (mut means, mut halves) = (Vec::new(), Vec::new());
    for name in CENTRAL {
        means.extend(offset(name)?.to_array());
    }
    for name in PAIRED {
        let left = offset(&format!("l{name}"))?;
        let right = mirror(offset(&format!("r{name}"))?);
        means.extend(((left + right) / 2.0).to_array());
        halves.push((left - right) / 2.0);
    }
    Ok((means, halves))
}

/// The mirror image of a vector: x points left.
pub fn mirror(v: DVec3) -> DVec3 {
    DVec3::new(-v.x, v.y, v.z)
}

impl BonePrior {
    /// Learns from the skeletons of some people.
    ///
    /// # Errors
    /// [`Error::Usage`]: fewer than three skeletons, or one without CMU's bones.
    pub(crate) fn train(skeletons: &[Skeleton]) -> Result<BonePrior> {
        let all: Vec<(Vec<f64>, Vec<DVec3>)> =
            skeletons.iter().map(bones_of).collect::<Result<_>>()?;
        let count = all.len() as f64;
        if all.len() < 3 {
            return Err(Error::usage(
                "fewer than three skeletons to learn bones from",
            ));
        }
        let mean: Array1<f64> = (0..3 * COUNT)
            .map(|i| all.iter().map(|b| b.0[i]).sum::<f64>() / count)
            .collect();
        let covariance = Array2::from_shape_fn((3 * COUNT, 3 * COUNT), |(i, j)| {
            let off = |b: &(Vec<f64>, Vec<DVec3>), i: usize| b.0[i] - mean[i];
            let sum: f64 = all.iter().map(|b| off(b, i) * off(b, j)).sum();
            if i == j {
                sum / (count - 1.0) + FLOOR * FLOOR
            } else {
                TOLD * sum / (count - 1.0)
            }
        });
        let uneven = |pair: usize| {
            let squares: f64 = all.iter().map(|b| b.1[pair].length_squared()).sum();
            (squares / (3.0 * count)).sqrt() + UNEVEN
        };
        Ok(BonePrior {
            mean,
            covariance,
            asymmetry: (0..PAIRED.len()).map(uneven).collect(),
        })
    }

    /// Adds it to the model of the rotations: `bones` (16, 3), `bones_covariance` (48, 48) and
    /// `bones_asymmetry` (10, 1), cm.
    pub(crate) fn add_to(&self, model: &mut Model) {
        let single = |v: f64| v as f32;
        let mean = Array2::from_shape_fn((COUNT, 3), |(b, c)| single(self.mean[3 * b + c]));
        model.insert("bones", mean);
        model.insert("bones_covariance", self.covariance.mapv(single));
        let uneven = Array2::from_shape_fn((PAIRED.len(), 1), |(p, _)| single(self.asymmetry[p]));
        model.insert("bones_asymmetry", uneven);
    }

    /// Reads it from the model of the rotations.
    ///
    /// # Errors
    /// [`Error::Usage`]: the model has no bones, or arrays of other shapes.
    pub(crate) fn from_model(model: &Model, source: &str) -> Result<BonePrior> {
        let get = |name: &str, shape: (usize, usize)| {
            let array = model.array(name, source)?;
            if array.dim() == shape && array.iter().all(|v| v.is_finite()) {
                Ok(array.mapv(f64::from))
            } else {
                Err(Error::usage(format!(
                    "{source}: {name} is not {shape:?} numbers"
                )))
            }
        };
        let mean = get("bones", (COUNT, 3))?;
        Ok(BonePrior {
            mean: mean.into_iter().collect(),
            covariance: get("bones_covariance", (3 * COUNT, 3 * COUNT))?,
            asymmetry: get("bones_asymmetry", (PAIRED.len(), 1))?
                .into_iter()
                .collect(),
        })
    }
}
