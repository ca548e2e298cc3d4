//! A Gaussian prior over the rotations of a body's joints: what the positions of its points leave
//! open - the twist of a limb, how the spine shares its own - is what it mostly was in CMU's takes.
//!
//! Bones are CMU's ([`joints::CMU`](crate::pose::joints::CMU)). L_b is the rotation of bone b in
//! the frame of its parent, the identity in the rest pose of an ASF file; M_b is the mean of L_b,
//! and r_b = log(L_b M_bᵀ) is normal with mean zero and one covariance for all bones, which ties
//! the head to the chest and shares the twist of the spine. The root, and the hip joints that are
//! rigid with it, have no rotation here.

#[doc(hidden)]
pub mod bones;
mod carried;
mod tuning;

use self::bones::BonePrior;
use self::tuning::*;
use crate::io::Model;
use crate::pose::Skeleton;
use crate::pose::joints::{CMU, CMU_PARENT, PELVIS, cmu_names};
use crate::pose::rotation::{from_rotation_vector, rotation_vector};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;

#[doc(hidden)]
pub use carried::JointPrior;

/// The kind in the file of a prior.
const KIND: &str = "rotations";
/// Bones.
const BONES: usize = CMU.len();
/// The file as `make model` left it.
static BYTES: &[u8] = include_bytes!("../rotations.npz");

/// The rotations of CMU's bones in one frame, each in the frame of its parent.
pub type LocalRotations = [DMat3; BONES];

/// Means and covariance of the rotations of a body's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct RotationPrior {
    /// M by bone.
    mean: [DMat3; BONES],
    /// Covariance of the rotation vectors r, (3 bones, 3 bones), squared radians.
    covariance: Array2<f64>,
    /// The bones of the people, where they were learned.
    bones: Option<BonePrior>,
}

impl RotationPrior {
    /// The prior that is compiled in.
    ///
    /// # Errors
    /// None in a sound build.
    pub fn builtin() -> Result<RotationPrior> {
        let model = Model::from_bytes(BYTES, "the built-in prior of rotations")?;
        RotationPrior::from_model(&model, "the built-in prior of rotations")
    }

    /// The prior in a file of [`RotationPrior::to_model`]; `source` names it in errors.
    ///
    /// # Errors
    /// [`Error::Usage`]: a model of another kind, or arrays of other shapes.
    pub fn from_model(model: &Model, source: &str) -> Result<RotationPrior> {
        if model.meta.kind != KIND {
            return Err(Error::usage(format!(
                "{source}: a model of the kind {}, not of rotations; train one with \
                 rotations-train",
                model.meta.kind
            )));
        }
        let (mean, covariance) = (
            model.array("mean", source)?,
            model.array("covariance", source)?,
        );
        let is_sound = mean.dim() == (BONES, 3)
            && covariance.dim() == (3 * BONES, 3 * BONES)
            && mean.iter().chain(&covariance).all(|v| v.is_finite());
        if !is_sound {
            return Err(Error::usage(format!(
                "{source}: not the mean rotations and the covariance of {BONES} bones"
            )));
        }
        let vector = |b: usize| DVec3::from_array([0, 1, 2].map(|c| f64::from(mean[[b, c]])));
        Ok(RotationPrior {
            mean: std::array::from_fn(|b| from_rotation_vector(vector(b))),
            covariance: covariance.mapv(f64::from),
            bones: if model.get("bones").is_some() {
                Some(BonePrior::from_model(model, source)?)
            } else {
                None
            },
        })
    }

    /// The prior as a model: `mean` (bones, 3) and `covariance` (3 bones, 3 bones), radians.
    pub fn to_model(&self) -> Model {
        let mut model = Model::new(KIND, &cmu_names(), "body");
        let mean = Array2::from_shape_fn((BONES, 3), |(b, c)| {
            rotation_vector(&self.mean[b])[c] as f32
        });
        model.insert("mean", mean);
        model.insert("covariance", self.covariance.mapv(|v| v as f32));
        self.bones.iter().for_each(|bones| bones.add_to(&mut model));
        model
    }

    /// Learns how long the bones of people are, too, from their skeletons.
    ///
    /// # Errors
    /// [`Error::Usage`]: fewer than three skeletons, or one without CMU's bones.
    pub fn with_bones(mut self, skeletons: &[Skeleton]) -> Result<RotationPrior> {
        self.bones = Some(BonePrior::train(skeletons)?);
        Ok(self)
    }

    /// The bones of people; `None` where they were not learned.
    #[doc(hidden)]
    pub fn bones(&self) -> Option<&BonePrior> {
        self.bones.as_ref()
    }

    /// Learns from the frames of several subjects. Each weighs as the square root of its frames, so
    /// that none outweighs the rest.
    ///
    /// # Errors
    /// [`Error::Usage`]: no frame at all.
    pub fn train(subjects: &[Vec<LocalRotations>]) -> Result<RotationPrior> {
        let weights = subjects
            .iter()
            .map(|s| 1.0 / (s.len().max(1) as f64).sqrt());
        let frames = subjects.iter().zip(weights);
        let frames: Vec<(&LocalRotations, f64)> = frames
            .flat_map(|(s, w)| s.iter().map(move |f| (f, w)))
            .collect();
        let all: f64 = frames.iter().map(|f| f.1).sum();
        if frames.is_empty() {
            return Err(Error::usage("no frame to learn rotations from"));
        }
        let mean: LocalRotations = std::array::from_fn(|b| {
            let mut mean = frames[0].0[b];
            for _ in 0..MEAN_ROUNDS {
                let off = |(f, w): &(&LocalRotations, f64)| {
                    rotation_vector(&(f[b] * mean.transpose())) * *w
                };
                let step = frames.iter().map(off).sum::<DVec3>() / all;
                mean = from_rotation_vector(step) * mean;
            }
            mean
        });
        let mut covariance = Array2::zeros((3 * BONES, 3 * BONES));
        let mut r = vec![0.0; 3 * BONES];
        for (frame, weight) in &frames {
            for (b, r) in r.chunks_exact_mut(3).enumerate() {
                let off = rotation_vector(&(frame[b] * mean[b].transpose()));
                r.copy_from_slice(&off.to_array());
            }
            for (i, a) in r.iter().enumerate() {
                let mut row = covariance.row_mut(i);
                row.iter_mut()
                    .zip(&r)
                    .for_each(|(c, b)| *c += weight / all * a * b);
            }
        }
        Ok(RotationPrior {
            mean,
            covariance,
            bones: None,
        })
    }
}

/// The rotations of CMU's bones in the frames of a take: the `values` of each (degrees of freedom)
/// of a skeleton that has them all. The root and the hip joints count as still.
///
/// # Errors
/// [`Error::Usage`]: a bone of CMU's is missing, or hangs on another.
pub fn local_rotations(skeleton: &Skeleton, values: &[&[f64]]) -> Result<Vec<LocalRotations>> {
    let find = |name: &&str| {
        let missing = || Error::usage(format!("the skeleton has no bone {name}"));
        skeleton.find(name).ok_or_else(missing)
    };
    let bones: Vec<usize> = CMU.iter().map(find).collect::<Result<_>>()?;
    for (b, &bone) in bones.iter().enumerate().skip(1) {
        if skeleton.bones()[bone].parent != Some(bones[CMU_PARENT[b]]) {
            let (name, parent) = (CMU[b], CMU[CMU_PARENT[b]]);
            let what = format!("the skeleton's bone {name} does not hang on {parent}");
            return Err(Error::usage(what));
        }
    }
    let frame = |q: &&[f64]| {
        let posture = skeleton.posture(q);
        let global = |b: usize| posture.rotations[bones[b]];
        std::array::from_fn(|b| {
            if is_free(b) {
                global(CMU_PARENT[b]).transpose() * global(b)
            } else {
                DMat3::IDENTITY
            }
        })
    };
    Ok(values.iter().map(frame).collect())
}

/// Whether a bone turns against its parent: the root has none, and the hip joints are rigid.
fn is_free(bone: usize) -> bool {
    !PELVIS.contains(&CMU[bone])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel::rng;
    use rand::Rng;

    /// Frames whose rotations lie around some of 40 degrees.
    fn frames(count: usize) -> Vec<LocalRotations> {
        let mut random = rng(1, 0);
        let mut vector =
            |most: f64| DVec3::from_array([0; 3].map(|_: i32| random.random_range(-most..most)));
        let means: [DVec3; BONES] = std::array::from_fn(|_| vector(0.7));
        let frame = |_| {
            std::array::from_fn(|b| {
                if is_free(b) {
                    from_rotation_vector(vector(0.3)) * from_rotation_vector(means[b])
                } else {
                    DMat3::IDENTITY
                }
            })
        };
        (0..count).map(frame).collect()
    }

    #[test]
    fn rotations_are_about_their_mean() {
        let (a, b) = (frames(300), frames(200));
        let prior = RotationPrior::train(&[a.clone(), b.clone()]).unwrap();
        for bone in 0..BONES {
            let off = |frames: &[LocalRotations]| {
                let each = frames
                    .iter()
                    .map(|f| f[bone] * prior.mean[bone].transpose());
                let sum = each.map(|r| rotation_vector(&r)).sum::<DVec3>();
                sum / (frames.len() as f64).sqrt()
            };
            assert!((off(&a) + off(&b)).length() <= 1e-9, "{bone}");
            let variance = prior.covariance[[3 * bone, 3 * bone]];
            let expected = if is_free(bone) { 0.03 } else { 0.0 };
            assert!((variance - expected).abs() <= 0.01, "{bone}: {variance}");
        }
        assert!(RotationPrior::train(&[]).is_err());
    }

    #[test]
    fn files_give_the_prior_back() {
        let prior = RotationPrior::train(&[frames(50)]).unwrap();
        let model = prior.to_model();
        let again = RotationPrior::from_model(&model, "t").unwrap();
        let turned = |b: usize| again.mean[b] * prior.mean[b].transpose();
        assert!((0..BONES).all(|b| rotation_vector(&turned(b)).length() <= 1e-6));
        let far = &again.covariance - &prior.covariance;
        assert!(far.iter().all(|v| v.abs() <= 1e-7));
        let other = Model::new("pca", &cmu_names(), "body");
        let error = RotationPrior::from_model(&other, "t")
            .unwrap_err()
            .to_string();
        assert!(error.contains("rotations-train"), "{error}");
        let mut broken = prior.to_model();
        broken.insert("mean", Array2::zeros((3, 3)));
        assert!(RotationPrior::from_model(&broken, "t").is_err());
        assert!(RotationPrior::builtin().is_ok());
    }
}
