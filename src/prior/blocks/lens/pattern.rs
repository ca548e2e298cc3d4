//! How the coordinates of a part are seen: nothing of it, alike but for a few, or through noise of many kinds.

use std::sync::Arc;

/// How the coordinates of a part are seen.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// None is.
    Nothing,
    /// Noise of one variance, but for some coordinates: (which, their variance, above that of the rest).
    Changed {
        /// The variance of most, and the least.
        unit: f64,
        /// Those of another.
        changed: Arc<[(usize, f64)]>,
    },
    /// Of many kinds.
    Mixed,
}

impl Pattern {
    /// Of noise variances (infinite: missing).
    pub fn of(noise: &[f64]) -> Pattern {
        let unit = noise.iter().copied().fold(f64::INFINITY, f64::min);
        if unit == f64::INFINITY {
            return Pattern::Nothing;
        }
        let changed: Vec<(usize, f64)> = (noise.iter().copied().enumerate())
            .filter(|(_, n)| *n > unit)
            .collect();
        // Above this the small solves cost more than a decomposition of what is seen.
        if 5 * changed.len() > 3 * noise.len() {
            return Pattern::Mixed;
        }
        Pattern::Changed {
            unit,
            changed: changed.into(),
        }
    }
}
