//! A prior with what it takes to use it in the world: the root's frame, and the bones by which it
//! is carried to another body.

use super::body_adaptation;
use crate::Result;
use crate::io::Model;
use crate::pose::{Anchor, Body, PoseTransform, joints};
use crate::prior::{self, OpenOptions, Prior};
use ndarray::ArrayView2;

/// A body whose bones differ from the model's by no more than this share is taken for the model's.
const SAME_BODY: f64 = 0.002;

/// A prior in memory, for poses in world space or in the model's own.
pub struct PlacedPrior {
    /// The prior of the model's own body.
    pub prior: Box<dyn Prior>,
    /// The root's frame; `None`: poses are in the model's space, and of its body.
    pub anchor: Option<Anchor>,
    /// The model's bones, where it says them and poses are in world space.
    body: Option<Body>,
    /// The other of each left-right pair of points.
    mirror: Vec<Option<usize>>,
}

impl PlacedPrior {
    /// Opens a model named `source`. In world space each pose is placed first; in body space poses
    /// are used as they are.
    ///
    /// # Errors
    /// As [`prior::open`].
    pub fn open(
        model: &Model,
        options: &OpenOptions,
        source: &str,
        world: bool,
    ) -> Result<PlacedPrior> {
        let prior = prior::open(model, options, source)?;
        let names = &model.meta.points;
        let anchor = world.then(|| match Anchor::pelvis(names) {
            Some(pelvis) => pelvis,
            None => Anchor::mean(&prior.representative_poses().row(0).to_vec()),
        });
        Ok(PlacedPrior {
            prior,
            anchor,
            body: (model.meta.body.as_ref().filter(|_| world)).map(Body::from),
            mirror: (0..names.len())
                .map(|i| joints::mirrored(names, i))
                .collect(),
        })
    }

    /// The number of points, J.
    pub fn points(&self) -> usize {
        self.mirror.len()
    }

    /// Whether poses may be of other bodies than the model's.
    pub fn is_for_any_body(&self) -> bool {
        self.body.is_some()
    }

    /// The prior for the body that `frames` (m, 3 J; cm) show; `noise` is the standard deviation of
    /// a coordinate, cm. `None`: the body is the model's own, or the model does not say what
    /// its own is.
    pub fn for_body(&self, frames: ArrayView2<'_, f64>, noise: f64) -> Option<Box<dyn Prior>> {
        let map = body_adaptation::map_to(self.body.as_ref()?, frames, noise, &self.mirror);
        let is_same = match &map {
            PoseTransform::Reshape { ratios, .. } => {
                ratios.iter().all(|r| (r - 1.0).abs() <= SAME_BODY)
            }
            PoseTransform::Rotate(_) => false,
        };
        (!is_same).then(|| self.prior.mapped(&map))
    }
}
