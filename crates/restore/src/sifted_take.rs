//! A take sifted: its outliers, and the paths of the other points, smoothed.

use super::adapted_prior::AdaptedPrior;
use super::adaptive_smoothing::SmoothedTake;
use super::gap::{fill_gaps, find_gaps};
use super::known_motion::KnownMotion;
use super::outliers::{Outliers, find_outliers};
use super::take::{PointMapping, Take, without};
use super::tuning::sifted_take::EXPECTED;

/// A take sifted.
pub(crate) struct SiftedTake {
    /// The outliers of each frame.
    pub outliers: Vec<Vec<usize>>,
    /// The take without them, smoothed.
    pub smoothed: SmoothedTake,
}

impl SiftedTake {
    /// Finds the outliers of a take, and smooths the paths of the other points; `noise` is the
    /// standard deviation of a coordinate in cm if known. Suspected outliers that lie where the
    /// rest of the take expects them are kept; the paths are then smoothed with them.
    pub(crate) fn new(
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        noise: Option<f64>,
    ) -> SiftedTake {
        let (found, adapted) = find_outliers(mapping, take, noise);
        let first = SiftedTake::without(found.points.clone(), mapping, take, noise);
        match first.expected(&found, adapted.as_ref(), take) {
            Some(outliers) => SiftedTake::without(outliers, mapping, take, noise),
            None => first,
        }
    }

    /// A take without outliers.
    pub(crate) fn whole(
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        noise: Option<f64>,
    ) -> SiftedTake {
        SiftedTake::without(vec![Vec::new(); take.xyz.nrows()], mapping, take, noise)
    }

    /// A take of which these are the outliers.
    fn without(
        outliers: Vec<Vec<usize>>,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        noise: Option<f64>,
    ) -> SiftedTake {
        let seen = without(take.xyz, &outliers);
        let smoothed = SmoothedTake::new(mapping, &take.with_xyz(seen.view()), noise);
        SiftedTake { outliers, smoothed }
    }

    /// The outliers that are left, if some are none: no spikes, and where the rest of the take
    /// expects them, within three standard deviations of what fills their gaps.
    fn expected(
        &self,
        found: &Outliers,
        adapted: Option<&AdaptedPrior<'_>>,
        take: &Take<'_>,
    ) -> Option<Vec<Vec<usize>>> {
        if found.points == found.spikes {
            return None;
        }
        let (xyz, noise) = (take.xyz, &self.smoothed.noise.sd);
        let rest = Take {
            motion: KnownMotion::Nothing,
            ..take.with_xyz(self.smoothed.mean.view())
        };
        let mut gaps = find_gaps(rest.xyz, rest.runs);
        gaps.retain(|gap| gap.is_any_of(&found.points));
        let (filled, _) = fill_gaps(adapted, true, &rest, &gaps, None, &|_| ());
        let mut left = found.points.clone();
        let mut is_any = false;
        for (gap, filled) in gaps.iter().zip(&filled) {
            let Some(filled) = filled else { continue };
            for (k, t) in gap.frames.clone().enumerate() {
                let p = gap.point;
                let off = |axis: usize| (xyz[[t, 3 * p + axis]] - filled.xyz[[k, axis]]).powi(2);
                let variance = 3.0 * (filled.variance[k] + noise[p] * noise[p]);
                let is_spike = found.spikes[t].contains(&p);
                if !is_spike && (0..3).map(off).sum::<f64>() <= EXPECTED * EXPECTED * variance {
                    left[t].retain(|q| *q != p);
                    is_any = true;
                }
            }
        }
        is_any.then_some(left)
    }
}
