//! Metrics that weigh features, learned from pairs: by least squares, or by boosting.

use super::{boost, lms};
use crate::Result;
use crate::metric::features::PoseFeatures;
use crate::metric::pose_metric::{Norm, PoseMetric, Projection};
use crate::metric::train::{Learned, TrainingPairs};
use ndarray::Array2;

/// How weights are learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WeightRule {
    /// [`lms`].
    LeastSquares,
    /// [`boost`].
    Boosting,
}

/// `full` with weights, learned from its vectors of labeled poses.
///
/// By least squares, coordinates and rotations have a weight per joint (Wang and Bodenheimer: LJCD,
/// LJOD), distances of joints one each for their magnitudes (Tang et al.: JRF+LMS), other features
/// one each for their squares.
///
/// # Errors
/// [`crate::Error::Unfit`]: one of the labels is missing.
pub(super) fn learn(
    full: &PoseMetric,
    rule: WeightRule,
    pairs: &TrainingPairs<'_>,
) -> Result<Learned> {
    let ends = [pairs.alike, pairs.unlike].concat();
    let is_alike: Vec<bool> = (0..ends.len()).map(|k| k < pairs.alike.len()).collect();
    let magnitudes = boost::magnitudes(pairs.x, &ends);
    let is_city = rule == WeightRule::Boosting || full.features == PoseFeatures::JointDistances;
    let weights: Vec<f32> = match rule {
        WeightRule::Boosting => {
            let chosen = boost::choose(magnitudes.view(), &is_alike)?;
            chosen.iter().map(|c| f32::from(u8::from(*c))).collect()
        }
        WeightRule::LeastSquares => {
            let group = groups(full.features, magnitudes.ncols());
            let count = group.iter().max().map_or(0, |g| g + 1);
            let mut terms = Array2::zeros((ends.len(), count));
            for ((k, j), v) in magnitudes.indexed_iter() {
                let v = f64::from(*v);
                terms[[k, group[j]]] += if is_city { v } else { v * v };
            }
            let weights = lms::fit(terms.view(), &is_alike)?;
            let of = |w: f64| if is_city { w } else { w.sqrt() };
            group.iter().map(|g| of(weights[*g]) as f32).collect()
        }
    };
    if weights.iter().all(|w| *w == 0.0) {
        return Err("no feature tells pairs that are alike from others".into());
    }
    let metric = PoseMetric {
        projection: Projection::Weights(weights),
        norm: if is_city { Norm::City } else { Norm::Euclidean },
        ..full.clone()
    };
    Ok(Learned {
        metric,
        has_converged: true,
    })
}

/// The group of each feature of a window: features of a group have one weight.
fn groups(features: PoseFeatures, width: usize) -> Vec<usize> {
    let has_joints = matches!(
        features,
        PoseFeatures::Coordinates | PoseFeatures::Orientations
    );
    if !has_joints {
        return (0..width).collect();
    }
    let mut joints: Vec<String> = Vec::new();
    let names = features.feature_names();
    let group = |name: &String| {
        let joint = joint_of(name).to_string();
        joints.iter().position(|j| *j == joint).unwrap_or_else(|| {
            joints.push(joint);
            joints.len() - 1
        })
    };
    let groups: Vec<usize> = names.iter().map(group).collect();
    (0..width).map(|k| groups[k % groups.len()]).collect()
}

/// What stands in the brackets of a feature's name.
pub(crate) fn joint_of(name: &str) -> &str {
    let inside = name.split(['(', ')']).nth(1);
    inside.unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_and_velocities_of_a_joint_have_one_weight() {
        let names = PoseFeatures::Coordinates.feature_names();
        let groups = groups(PoseFeatures::Coordinates, 3 * names.len());
        let group = |name: &str| groups[names.iter().position(|n| n == name).unwrap()];
        assert_eq!(group("J_c(LHand)_x"), group("J_k(LHand)_vz"));
        assert_ne!(group("J_c(LHand)_x"), group("J_c(RHand)_x"));
        assert_eq!(groups.iter().max(), Some(&15));
        assert_eq!(groups[0], groups[names.len()]);
    }
}
