//! A pose model in memory: prior, root frame, body and rigid distances, all in the model's order of
//! points.
//!
//! It adapts to a captured body: bone lengths are measured, and the prior is transformed. The log
//! ratio of each bone to the model's is shrunk by its uncertainty: keep · log(ℓ / ℓ₀) with keep =
//! .1² / (.1² + s²), ℓ the measured length less the noise (cm), s² its relative variance.
//! Transforming the prior ([`PoseTransform`], linear) rather than the poses works whatever points a
//! frame lacks, and needs no inverse.

use super::frame_estimator::FrameEstimator;
use super::placement::PlacementSolver;
use super::rigid::RigidModel;
use super::rigid::noise_floor::NoiseFloor;
use super::tuning::pose_model::*;
use crate::Result;
use crate::io::Model;
use crate::pose::{Anchor, Body, BonePoints, PoseTransform, Poses, sides};
use crate::prior::{self, OpenOptions, Prior, up_directions};
use ndarray::{Array2, ArrayView2};

/// A pose model in memory, for poses in world space or in the model's own.
pub struct PoseModel {
    /// The names of its points (J).
    pub points: Vec<String>,
    /// The prior of the model's own body.
    pub prior: Box<dyn Prior>,
    /// The root's frame; `None`: poses are in the model's space, and of its body.
    pub anchor: Option<Anchor>,
    /// Finds placements.
    pub solver: PlacementSolver,
    /// The model's bones, where it says them and poses are in world space: then poses may be of
    /// other bodies.
    body: Option<Body>,
    /// The other of each left-right pair of points (J).
    pub mirror: Vec<Option<usize>>,
    /// Empty where the model has no rigid pairs or they were not read.
    pub rigid: RigidModel,
    /// Which way is up for each training pose (n, 3), where the model says it and poses are in
    /// world space.
    up: Option<Array2<f64>>,
    /// Rigid distances of a person who has not been measured.
    unknown_body: RigidModel,
}

impl PoseModel {
    /// Opens a model named `source`, without rigid distances. In world space each pose is placed
    /// first; in body space poses are used as they are.
    ///
    /// # Errors
    /// As [`prior::open`].
    pub fn open(
        model: &Model,
        options: &OpenOptions,
        source: &str,
        world: bool,
    ) -> Result<PoseModel> {
        let prior = prior::open(model, options, source)?;
        let up = up_directions::read(model, source)?;
        let points = model.meta.points.clone();
        let anchor = world.then(|| match Anchor::pelvis(&points) {
            Some(pelvis) => pelvis,
            None => Anchor::mean(&prior.representative_poses().row(0).to_vec()),
        });
        Ok(PoseModel {
            prior,
            anchor,
            solver: PlacementSolver::default(),
            body: (model.meta.body.as_ref().filter(|_| world)).map(Body::from),
            mirror: (0..points.len())
                .map(|i| sides::mirrored(&points, i))
                .collect(),
            points,
            rigid: RigidModel::default(),
            up: up.filter(|_| world),
            unknown_body: RigidModel::default(),
        })
    }

    /// Keeps the rigid distances of a model named `source`.
    ///
    /// # Errors
    /// As [`RigidModel::read`].
    pub(crate) fn with_rigid_distances(mut self, model: &Model, source: &str) -> Result<PoseModel> {
        self.rigid = RigidModel::read(model, source)?;
        self.unknown_body = self.rigid.for_unknown_body();
        Ok(self)
    }

    /// The ends of each bone, that nearer to the root first; none where bones are not known.
    pub(crate) fn bones(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let parents = self
            .body
            .iter()
            .flat_map(|body| body.parents.iter().enumerate());
        parents.filter_map(|(point, parent)| Some([(*parent)?, point]))
    }

    /// Whether a bone joins two points.
    pub(crate) fn is_bone(&self, [a, b]: [usize; 2]) -> bool {
        self.bones().any(|ends| ends == [a, b] || ends == [b, a])
    }

    /// Where its points stand on their bones.
    pub(crate) fn bone_points(&self) -> BonePoints {
        BonePoints::of(&self.points, self.prior.representative_poses())
    }

    /// A few of its training poses, far apart, in its own space.
    pub fn representative_poses(&self) -> Poses {
        Poses {
            points: self.points.clone(),
            xyz: self.prior.representative_poses().to_owned(),
            ..Poses::default()
        }
    }

    /// Which way is up for each training pose (n, 3).
    pub(crate) fn up(&self) -> Option<ArrayView2<'_, f64>> {
        self.up.as_ref().map(|up| up.view())
    }

    /// The rigid distances to judge one frame by before its body is measured, and the frame's noise
    /// floor by them.
    pub(crate) fn noise_floor(&self, y: &[f64]) -> Option<(&RigidModel, NoiseFloor)> {
        // In world space the body may be anyone's; body space holds the training bodies.
        let own = self.body.is_none().then_some(&self.rigid);
        let mut all = own.into_iter().chain([&self.unknown_body]);
        all.find_map(|rigid| Some((rigid, rigid.noise_floor(y)?)))
    }

    /// The prior for the body that `frames` (m, 3 J; cm) show; `noise` is the standard deviation of
    /// a coordinate, cm. `None`: the body is the model's own, or the model does not say what its
    /// own is.
    #[doc(hidden)]
    pub fn prior_for(&self, frames: ArrayView2<'_, f64>, noise: f64) -> Option<Box<dyn Prior>> {
        let transform = map_to(self.body.as_ref()?, frames, noise, &self.mirror);
        let is_same = match &transform {
            PoseTransform::Reshape { ratios, .. } => {
                ratios.iter().all(|r| (r - 1.0).abs() <= SAME_BODY)
            }
            PoseTransform::Rotate(_) => false,
        };
        (!is_same).then(|| self.prior.mapped(&transform))
    }

    /// Estimates frames of the model's own body with the prior alone, no rigid distance kept.
    #[doc(hidden)]
    pub fn estimator(&self) -> FrameEstimator<'_> {
        FrameEstimator {
            prior: &*self.prior,
            anchor: self.anchor.as_ref(),
            solver: &self.solver,
            rigid: None,
        }
    }
}

/// The transform from the model's body to the one that `xyz` (frames, 3 J; cm) shows; `noise` is
/// the standard deviation of a coordinate, cm. A noisy length is too long, as each end adds
/// variance. Bones that are never seen take the ratio of their left-right counterpart, else the
/// typical one.
fn map_to(
    model: &Body,
    xyz: ArrayView2<'_, f64>,
    noise: f64,
    mirror: &[Option<usize>],
) -> PoseTransform {
    let seen = Body::measure(&model.parents, xyz);
    let frames = xyz.nrows().max(1) as f64;
    let mut target = seen.clone();
    for k in 0..target.lengths.len() {
        let (length, reference) = (seen.lengths[k], model.lengths[k]);
        if !length.is_finite() || !(reference > 0.0) {
            target.lengths[k] = f64::NAN;
            continue;
        }
        let true_length = (length * length - 4.0 * noise * noise)
            .max(0.25 * reference * reference)
            .sqrt();
        let log = (true_length / reference).ln().clamp(-1.5, 1.5);
        let length_sd = 2.0 * noise * noise / (reference * reference) / frames.sqrt();
        let keep = PEOPLE_DIFFER.powi(2) / (PEOPLE_DIFFER.powi(2) + length_sd);
        target.lengths[k] = reference * (keep * log).exp();
    }
    for k in 0..target.lengths.len() {
        if target.lengths[k].is_nan()
            && let Some(m) =
                mirror[k].filter(|&m| target.lengths[m].is_finite() && model.lengths[m] > 0.0)
        {
            target.lengths[k] = model.lengths[k] * target.lengths[m] / model.lengths[m];
        }
    }
    PoseTransform::reshape(model, &target)
}

/// Standard deviation (cm) of a length measured in `frames` with `noise` (standard deviation of a
/// coordinate, cm). A length that was never seen differs as between people, less what the other
/// bones say.
pub(crate) fn length_sd(length: f64, noise: f64, frames: usize) -> f64 {
    if frames == 0 {
        return 0.3 * PEOPLE_DIFFER * length;
    }
    let measured = 2.0 * noise * noise / (length * length) / (frames as f64).sqrt();
    let people = PEOPLE_DIFFER * PEOPLE_DIFFER;
    length * (people * measured / (people + measured)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_longer_body_is_measured_and_noise_is_allowed_for() {
        let model = Body {
            parents: vec![None, Some(0), Some(1)],
            lengths: vec![f64::NAN, 20.0, 30.0],
        };
        let ratios = |map: &PoseTransform| match map {
            PoseTransform::Reshape { ratios, .. } => ratios.clone(),
            PoseTransform::Rotate(_) => vec![],
        };
        let mut xyz = Array2::zeros((50, 9));
        xyz.column_mut(3).fill(22.0);
        xyz.column_mut(6).fill(22.0);
        xyz.column_mut(7).fill(33.0);
        let mirror = vec![None; 3];
        let exact = ratios(&map_to(&model, xyz.view(), 0.0, &mirror));
        assert!(exact[1..].iter().all(|r| (r - 1.1).abs() <= 1e-9));
        // Under heavy noise in one frame the ratio stays near 1.
        let noisy = ratios(&map_to(
            &model,
            xyz.slice(ndarray::s![..1, ..]),
            8.0,
            &mirror,
        ));
        assert!(
            noisy[1..].iter().all(|r| (0.85..1.1).contains(r)),
            "{noisy:?}"
        );
        // The second bone is never seen: it takes the ratio of the first.
        xyz.column_mut(8).fill(f64::NAN);
        let usual = ratios(&map_to(&model, xyz.view(), 0.0, &mirror));
        assert!((usual[2] - 1.1).abs() <= 1e-9);
    }
}
