//! Directions that drown in the noise share one.

use crate::numeric::simd;

/// Directions share one where their variance is below this share of the noise's.
const NEGLIGIBLE_RATIO: f64 = 0.01;

/// The first directions, and one for all others.
#[derive(Debug, Clone)]
pub struct Truncation {
    /// Their λ; the last is the others' mean.
    pub values: Vec<f64>,
    /// How many share the last.
    pub shared: f64,
}

impl Truncation {
    /// Of falling variances, seen through noise of variance `unit`; none where next to all matter.
    pub fn of(values: &[f64], unit: f64) -> Option<Truncation> {
        let matter = values.partition_point(|l| *l > NEGLIGIBLE_RATIO * unit);
        // With the shared one they fill the lanes.
        let kept = simd::padded(matter + 1) - 1;
        if simd::padded(values.len()) < kept + 1 + simd::LANES {
            return None;
        }
        let rest = &values[kept..];
        let mean = rest.iter().sum::<f64>() / rest.len() as f64;
        Some(Truncation {
            values: values[..kept].iter().copied().chain([mean]).collect(),
            shared: rest.len() as f64,
        })
    }
}
