//! Cleaning: what a take needs and no more. One whose points tremble by noise is denoised; any
//! other keeps what was measured, also where noise cannot be told from motion; outliers are
//! replaced, gaps filled.

use super::complete::Complete;
use super::denoise::Denoise;
use super::gap::{Gap, empty_gaps, find_gaps};
use super::keypoints::Keypoints;
use super::noise_estimation::point_noise;
use super::steady_distances::SteadyDistances;
use super::take::{Method, PointMapping, Take, TakeResult};
use super::tuning::clean::{MOST_SD, SURE_SD, USUAL_NOISE};
use super::tuning::noise_estimation::NOISE_LIMIT;
use ndarray::ArrayView2;
use std::cell::OnceCell;

/// How to clean.
///
/// ```
/// use posing_core::pose::{Poses, Status};
/// use posing_io::Table;
/// use posing_restore::{Clean, Restorer};
///
/// // A marker that goes at an even pace, and one frame in which it is half a meter off.
/// let mut xyz = ndarray::Array2::from_shape_fn((60, 3), |(t, c)| (t + c) as f64);
/// xyz[[30, 1]] += 50.0;
/// let table = Table::from_poses(Poses { points: vec!["knee".into()], xyz, ..Poses::default() });
/// let options = Clean { fps: Some(100.0), ..Clean::default() };
/// let clean = Restorer::without_model().clean(&table, &options)?;
/// assert_ne!(clean.status(30, 0), Status::Observed);
/// assert!((clean.xyz()[[30, 1]] - 31.0).abs() < 1.0);
/// assert_eq!(clean.status(29, 0), Status::Observed);
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Clean {
    /// Takes with more noise are denoised: standard deviation of a coordinate, cm.
    pub noise_limit: f64,
    /// Whether to replace outliers.
    pub outliers: bool,
    /// Longest gap to fill, in seconds; `None`: no limit. Needs a frame rate.
    pub max_gap: Option<f64>,
    /// Gaps that would be filled with a larger standard deviation of a coordinate stay, cm; `None`:
    /// 3, and as much more as the points are noisier than 0.5.
    pub max_sd: Option<f64>,
    /// Frames a second, for a table without times.
    pub fps: Option<f64>,
}

impl Default for Clean {
    fn default() -> Self {
        Clean {
            noise_limit: NOISE_LIMIT,
            outliers: true,
            max_gap: None,
            max_sd: None,
            fps: None,
        }
    }
}

impl Clean {
    /// The largest standard deviation of what is filled, of points without more noise, cm.
    #[doc(hidden)]
    pub fn most_sd(&self) -> f64 {
        self.max_sd.unwrap_or(MOST_SD)
    }

    fn complete(&self) -> Complete {
        Complete {
            max_gap: self.max_gap,
            overwrite_outliers: self.outliers,
            fps: self.fps,
            ..Complete::default()
        }
    }

    fn denoise(&self) -> Denoise {
        Denoise {
            outliers: self.outliers,
            fill: true,
            max_gap: self.max_gap,
            fps: self.fps,
            ..Denoise::default()
        }
    }

    /// Restores points of which no bones tell the noise.
    fn restore_points(
        &self,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult {
        let noise = point_noise(take.xyz, take.runs);
        let level = noise.typical().sqrt();
        let mut out = if level > self.noise_limit && noise.is_noise(take.rate) {
            self.denoise().restore_take(mapping, take, done)
        } else {
            self.complete().restore_take(mapping, take, done)
        };
        if out.noise == 0.0 && level > self.noise_limit {
            out.doubtful_noise = Some(level);
        }
        out
    }

    /// Whether the fill of a gap is likely far off: its standard deviation is larger than is
    /// wanted, or would be if it were off by what it breaks `steady` distances of its point.
    fn is_unsure<'s>(
        &self,
        gap: &Gap,
        out: &TakeResult,
        steady: impl Fn(usize) -> &'s SteadyDistances,
    ) -> bool {
        let sd = typical_sd(gap, out);
        let broken_by = || steady(gap.point).broken_by(gap, out);
        // Where the points themselves are off by more, so may fills be.
        let usual = || self.most_sd() * (out.noise_left / USUAL_NOISE).max(1.0);
        let most = self.max_sd.unwrap_or_else(usual);
        sd > most || sd > SURE_SD && broken_by() > 3.0_f64.sqrt() * most
    }
}

/// The standard deviation of a coordinate in a filled gap: the root mean square over its frames,
/// cm; NaN where it is not filled.
fn typical_sd(gap: &Gap, out: &TakeResult) -> f64 {
    let frames = gap.frames.clone();
    let variances = frames.map(|t| out.state(t, gap.point).sd.powi(2));
    (variances.sum::<f64>() / gap.frames.len() as f64).sqrt()
}

impl Method for Clean {
    fn restore_frames(&self, mapping: &PointMapping<'_>, table: ArrayView2<'_, f64>) -> TakeResult {
        self.complete().restore_frames(mapping, table)
    }

    fn restore_take(
        &self,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult {
        let joints = mapping.filter(|mapping| mapping.is_mapped);
        let found = joints.and_then(|m| Some((m, Keypoints::find(take, self.noise_limit)?)));
        let mut out = match found {
            Some((mapping, keypoints)) => {
                keypoints.restore(mapping, (&self.complete(), &self.denoise()), done)
            }
            None => self.restore_points(mapping, take, done),
        };
        let gaps = find_gaps(take.xyz, take.runs);
        // Of each point once: it may have hundreds of gaps.
        let measured: Vec<OnceCell<SteadyDistances>> = vec![OnceCell::new(); take.xyz.ncols() / 3];
        let steady = |p: usize| measured[p].get_or_init(|| SteadyDistances::measure(take.xyz, p));
        let unsure = gaps.iter().filter(|gap| self.is_unsure(gap, &out, steady));
        let unsure: Vec<&Gap> = unsure.collect();
        empty_gaps(&mut out, take.xyz, unsure.into_iter());
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Status;
    use ndarray::Array2;

    #[test]
    fn a_gap_stays_where_its_fill_is_likely_far_off() {
        let mut out = TakeResult::of(Array2::zeros((4, 6)));
        for (point, sds) in [[3.5, 2.0], [4.5, 3.0]].into_iter().enumerate() {
            for (k, sd) in sds.into_iter().enumerate() {
                out.set(1 + k, point, Status::Inferred, sd);
            }
        }
        let is_unsure = |point| {
            let gap = Gap {
                point,
                frames: 1..3,
                before: Some(0),
                after: Some(3),
            };
            let steady = [0, 1].map(|p| SteadyDistances::measure(out.xyz.view(), p));
            Clean::default().is_unsure(&gap, &out, |p| &steady[p])
        };
        assert_eq!([is_unsure(0), is_unsure(1)], [false, true]);
    }
}
