//! Metrics as model files: kind `metric`, the arrays `shift`, `scale` and `projection` or
//! `weights`.

use super::features::PoseFeatures;
use super::joint_map::{JOINTS, JointMap};
use super::pose_metric::{Norm, PoseMetric, Projection, window_parts};
use super::scaling::{Scaling, ScalingRule};
use crate::io::Model;
use crate::{Error, Place, Result};
use ndarray::Array2;
use serde_json::{Value, json};

/// The kind of a model file that holds a metric.
pub(crate) const KIND: &str = "metric";

impl PoseMetric {
    /// The metric as a model, without a history yet.
    pub fn to_model(&self) -> Model {
        let mut model = Model::new(KIND, self.map.points(), "body");
        let details = &mut model.meta.details;
        details.insert("features".into(), json!(self.features.name()));
        details.insert("scaling".into(), json!(self.scaling.rule.name()));
        details.insert("window".into(), json!(self.window));
        details.insert("norm".into(), json!(self.norm.name()));
        model.insert("shift", column(&self.scaling.shift));
        model.insert("scale", column(&self.scaling.scale));
        match &self.projection {
            Projection::Weights(weights) => model.insert("weights", column(weights)),
            Projection::Matrix(matrix) => model.insert("projection", matrix.clone()),
        }
        model
    }

    /// The metric of a model; `source` names it in errors.
    ///
    /// # Errors
    /// [`Error::Data`]: the model is of another kind, or its arrays and settings do not belong
    /// together.
    pub fn from_model(model: &Model, source: &str) -> Result<PoseMetric> {
        model.check_kind(KIND, "not a metric; train one with rdsr-train", source)?;
        PoseMetric::from_parts(model, source)
    }

    /// The metric that a model of any kind holds.
    pub(super) fn from_parts(model: &Model, source: &str) -> Result<PoseMetric> {
        let fail = |what: String| Error::data(Place::file(source), what);
        let points = JOINTS.iter().zip(&model.meta.points);
        let names = points.map(|(joint, point)| (joint.to_string(), point.clone()));
        let text = |name: &str| model.meta.details.get(name).and_then(Value::as_str);
        let damaged = || fail("is a damaged metric".into());
        let column = |name: &str| -> Result<Vec<f32>> {
            Ok(model.array(name, source)?.iter().copied().collect())
        };
        let window = model.meta.details.get("window").and_then(Value::as_f64);
        let metric = PoseMetric {
            map: JointMap::new(names.collect()).map_err(|e| e.at(Place::file(source)))?,
            features: (text("features").and_then(PoseFeatures::of_name)).ok_or_else(damaged)?,
            scaling: Scaling {
                rule: (text("scaling").and_then(ScalingRule::of_name)).ok_or_else(damaged)?,
                shift: column("shift")?,
                scale: column("scale")?,
            },
            window: window.filter(|w| *w >= 0.0).ok_or_else(damaged)?,
            projection: if model.get("weights").is_some() {
                Projection::Weights(column("weights")?)
            } else {
                Projection::Matrix(model.array("projection", source)?.into_owned())
            },
            norm: (text("norm").and_then(Norm::of_name)).ok_or_else(damaged)?,
        };
        if metric.is_sound() {
            Ok(metric)
        } else {
            Err(damaged())
        }
    }

    /// Whether all arrays have the sizes of the features.
    fn is_sound(&self) -> bool {
        let width = self.features.feature_names().len();
        let rows = match &self.projection {
            Projection::Weights(weights) => weights.len(),
            Projection::Matrix(matrix) => matrix.nrows(),
        };
        let all_finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
        let is_finite = match &self.projection {
            Projection::Weights(weights) => all_finite(weights),
            Projection::Matrix(matrix) => matrix.iter().all(|v| v.is_finite()),
        };
        is_finite
            && all_finite(&self.scaling.shift)
            && all_finite(&self.scaling.scale)
            && self.scaling.shift.len() == width
            && self.scaling.scale.len() == width
            && rows == width * window_parts(self.window)
    }
}

fn column(values: &[f32]) -> Array2<f32> {
    Array2::from_shape_fn((values.len(), 1), |(k, _)| values[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_metric_is_the_same_after_writing_and_reading() {
        let features = PoseFeatures::JointDistances;
        let width = features.feature_names().len();
        let metric = PoseMetric {
            map: JointMap::cmu(),
            features,
            scaling: Scaling {
                rule: ScalingRule::Balanced,
                shift: (0..width).map(|k| k as f32).collect(),
                scale: vec![0.5; width],
            },
            window: 0.2,
            projection: Projection::Matrix(Array2::from_elem((3 * width, 2), 0.25)),
            norm: Norm::City,
        };
        let model = metric.to_model();
        assert_eq!(PoseMetric::from_model(&model, "m").unwrap(), metric);
        let mut cut = model.clone();
        cut.insert("scale", Array2::zeros((3, 1)));
        let error = PoseMetric::from_model(&cut, "m.npz").unwrap_err();
        assert!(error.to_string().contains("m.npz"), "{error}");
        let other = Model::new("sparse", &model.meta.points, "body");
        let error = PoseMetric::from_model(&other, "m.npz")
            .unwrap_err()
            .to_string();
        assert!(error.contains("rdsr-train"), "{error}");
    }
}
