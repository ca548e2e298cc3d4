//! How features are scaled before poses are compared.

use super::features::PoseFeatures;
use super::gpd::{Family, Gpd};
use super::motion_matching;
use ndarray::{Array2, ArrayView2, Axis};

/// Velocities count as the way of this many seconds.
const VELOCITY_SECONDS: f32 = 0.2;
/// The total standard deviation of the features that are neither coordinates nor velocities, of
/// which the total is 1.
const STATIC_SPREAD: f64 = 0.3;

/// Rules by which features are scaled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScalingRule {
    /// As they are.
    None,
    /// Coordinates in body heights and velocities as the way of .2 seconds, with a total variance
    /// of 1; of other families each feature has the same variance, and all of them a total
    /// standard deviation of .3. Rotations and their velocities are as coordinates are. Groups
    /// of game features have equal variance each. All have mean 0.
    Balanced,
    /// Each feature to [0, 1] by its range, then each pose to unit length: Chen et al.'s (38).
    UnitLength,
    /// Each feature to mean 0 and variance 1.
    Standard,
}

names!(ScalingRule {
    None = "none",
    Balanced = "balanced",
    UnitLength = "unit-length",
    Standard = "standard",
});

/// Scaled features: (x - shift) scale, and then unit length where the rule says so.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaling {
    /// The rule.
    pub rule: ScalingRule,
    /// One for each feature.
    pub shift: Vec<f32>,
    /// One for each feature; 0 for a feature that does not vary.
    pub scale: Vec<f32>,
}

impl Scaling {
    /// Learns the scaling from poses (m, features), all finite.
    pub(crate) fn fit(
        rule: ScalingRule,
        features: PoseFeatures,
        poses: ArrayView2<'_, f32>,
    ) -> Scaling {
        let width = poses.ncols();
        let moments: Vec<(f64, f64)> = (poses.axis_iter(Axis(1)))
            .map(|column| mean_and_variance(column.iter().map(|v| f64::from(*v))))
            .collect();
        let inverse = |spread: f64| if spread > 1e-9 { 1.0 / spread } else { 0.0 };
        let means = || moments.iter().map(|(mean, _)| *mean as f32).collect();
        let (shift, scale) = match rule {
            ScalingRule::None => (vec![0.0; width], vec![1.0; width]),
            ScalingRule::Standard => {
                let scale = moments.iter().map(|(_, v)| inverse(v.sqrt()) as f32);
                (means(), scale.collect())
            }
            ScalingRule::UnitLength => (poses.axis_iter(Axis(1)))
                .map(|column| {
                    let low = column.iter().copied().fold(f32::INFINITY, f32::min);
                    let high = column.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                    (low, inverse(f64::from(high - low)) as f32)
                })
                .unzip(),
            ScalingRule::Balanced => {
                let variances: Vec<f64> = moments.iter().map(|(_, v)| *v).collect();
                (means(), balance(features, &variances))
            }
        };
        Scaling { rule, shift, scale }
    }

    /// Coordinates in body heights as they are, velocities as the way of .2 seconds, and nothing
    /// else: no poses are needed.
    pub(crate) fn of_coordinates() -> Scaling {
        let families = Gpd::coordinates().feature_families();
        Scaling {
            rule: ScalingRule::None,
            shift: vec![0.0; families.len()],
            scale: families.iter().map(|f| unit(f).unwrap_or(0.0)).collect(),
        }
    }

    /// Scales poses (m, features) in place.
    pub(crate) fn apply(&self, poses: &mut Array2<f32>) {
        for mut pose in poses.rows_mut() {
            for ((v, shift), scale) in pose.iter_mut().zip(&self.shift).zip(&self.scale) {
                *v = (*v - shift) * scale;
            }
            if self.rule == ScalingRule::UnitLength {
                let length = pose.iter().map(|v| v * v).sum::<f32>().sqrt();
                if length > 0.0 {
                    pose /= length;
                }
            }
        }
    }
}

fn mean_and_variance(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    (
        mean,
        values.map(|v| (v - mean).powi(2)).sum::<f64>() / count,
    )
}

/// The scales of [`ScalingRule::Balanced`], given each feature's variance.
fn balance(features: PoseFeatures, variances: &[f64]) -> Vec<f32> {
    if let Some(gpd) = features.gpd() {
        return balance_families(&gpd.feature_families(), variances);
    }
    match features {
        PoseFeatures::MotionMatching => {
            let mut start = 0;
            let group = |width: usize| {
                let total: f64 = variances[start..start + width].iter().sum();
                start += width;
                vec![total.max(1e-12).powf(-0.5) as f32; width]
            };
            motion_matching::GROUPS
                .into_iter()
                .flat_map(group)
                .collect()
        }
        _ => {
            let (still, moving) = variances.split_at(variances.len() / 2);
            let moving = moving
                .iter()
                .map(|v| v * f64::from(VELOCITY_SECONDS).powi(2));
            let total = still.iter().sum::<f64>() + moving.sum::<f64>();
            let scale = total.max(1e-12).powf(-0.5) as f32;
            let mut scales = vec![scale; variances.len()];
            scales[still.len()..].fill(scale * VELOCITY_SECONDS);
            scales
        }
    }
}

/// How a feature counts before the total is fixed: `None` for those that are standardized.
fn unit(family: &Family) -> Option<f32> {
    match family {
        Family::JointCoordinate => Some(1.0),
        Family::JointKinetics => Some(VELOCITY_SECONDS),
        _ => None,
    }
}

fn balance_families(families: &[Family], variances: &[f64]) -> Vec<f32> {
    let coordinates = (families.iter().zip(variances))
        .filter_map(|(family, v)| Some(v * f64::from(unit(family)?).powi(2)))
        .sum::<f64>();
    let coordinates = coordinates.max(1e-12).powf(-0.5) as f32;
    let others = families.iter().filter(|f| unit(f).is_none()).count();
    let others = STATIC_SPREAD / (others.max(1) as f64).sqrt();
    (families.iter().zip(variances))
        .map(|(family, v)| match unit(family) {
            Some(unit) => unit * coordinates,
            None if v.sqrt() > 1e-9 => (others / v.sqrt()) as f32,
            None => 0.0,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn total_variance(poses: &Array2<f32>, columns: impl Fn(usize) -> bool) -> f64 {
        (0..poses.ncols())
            .filter(|c| columns(*c))
            .map(|c| mean_and_variance(poses.column(c).iter().map(|v| f64::from(*v))).1)
            .sum()
    }

    #[test]
    fn balanced_features_have_the_stated_spreads() {
        let features = PoseFeatures::Gpd;
        let names = features.feature_names();
        let mut poses = Array2::from_shape_fn((20, names.len()), |(t, c)| {
            ((t * 7 + c * 13) % 11) as f32 * (1 + c % 5) as f32
        });
        Scaling::fit(ScalingRule::Balanced, features, poses.view()).apply(&mut poses);
        let moving = |c: usize| names[c].starts_with("J_c") || names[c].starts_with("J_k");
        assert!((total_variance(&poses, moving) - 1.0).abs() < 1e-3);
        assert!((total_variance(&poses, |c| !moving(c)).sqrt() - 0.3).abs() < 1e-3);
    }

    #[test]
    fn the_papers_scaling_gives_ranges_of_one_then_unit_length() {
        let features = PoseFeatures::JointDistances;
        let poses = array![[1.0, 5.0, 2.0], [3.0, 5.0, 6.0], [2.0, 5.0, 2.0]];
        let scaling = Scaling::fit(ScalingRule::UnitLength, features, poses.view());
        assert_eq!(scaling.shift, [1.0, 5.0, 2.0]);
        assert_eq!(scaling.scale, [0.5, 0.0, 0.25]);
        let mut scaled = poses.clone();
        scaling.apply(&mut scaled);
        assert_eq!(scaled.row(0).to_vec(), [0.0, 0.0, 0.0]);
        assert!((scaled[[1, 0]] - 0.5_f32.sqrt()).abs() < 1e-6);
        assert_eq!(scaled.row(2).to_vec(), [1.0, 0.0, 0.0]);
    }
}
