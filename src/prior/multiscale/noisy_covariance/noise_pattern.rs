//! How the coordinates of a part are seen: nothing of it, alike but for a few, or through noise of many kinds.

use std::sync::Arc;

/// How the coordinates of a part are seen.
#[derive(Debug, Clone, PartialEq)]
pub enum NoisePattern {
    /// None is.
    Unobserved,
    /// Noise of one variance, but for some coordinates: (which, their variance, above that of the rest).
    NearIsotropic {
        /// The variance of most, and the least.
        base_variance: f64,
        /// Those of another.
        exceptions: Arc<[(usize, f64)]>,
    },
    /// Of many kinds.
    Diagonal,
}

impl NoisePattern {
    /// Of noise variances (infinite: missing).
    pub fn of(noise: &[f64]) -> NoisePattern {
        let base_variance = noise.iter().copied().fold(f64::INFINITY, f64::min);
        if base_variance == f64::INFINITY {
            return NoisePattern::Unobserved;
        }
        let exceptions: Vec<(usize, f64)> = (noise.iter().copied().enumerate())
            .filter(|(_, n)| *n > base_variance)
            .collect();
        // Above this the small solves cost more than a decomposition of what is seen.
        if 5 * exceptions.len() > 3 * noise.len() {
            return NoisePattern::Diagonal;
        }
        NoisePattern::NearIsotropic {
            base_variance,
            exceptions: exceptions.into(),
        }
    }
}
