//! Gaps of one length and number of points, filled and compared with what was cut out.

use super::baselines::{CutGap, Moments};
use super::segments::{SegmentWithGap, draw};
use super::{ByMethod, RESTORED, TakesSettings, TestTakes, mean_square, rms};
use crate::Result;
use crate::error_stats::SD_LEVELS;
use crate::io::Table;
use crate::numeric::parallel;
use crate::numeric::statistics::{bootstrap_interval, quantile};
use crate::pose::Poses;
use crate::restore::{Complete, Restoration, Restorer};
use ndarray::{Array2, ArrayView2, Axis, concatenate, s};

/// The length of a gap that lasts until its segment ends, seconds.
const TO_THE_END: f64 = 1.0;

/// How long a gap is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GapLength {
    /// Seconds, above 0; the points are seen before and after.
    Seconds(f64),
    /// The points are lost a second before the segment ends.
    ToTheEnd,
}

impl GapLength {
    fn seconds(self) -> f64 {
        match self {
            GapLength::Seconds(s) => s,
            GapLength::ToTheEnd => TO_THE_END,
        }
    }
}

impl std::fmt::Display for GapLength {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            GapLength::Seconds(s) => write!(f, "{s} s"),
            GapLength::ToTheEnd => write!(f, "to the end"),
        }
    }
}

/// Gaps of one kind.
#[derive(Debug, Clone)]
pub struct GapCell {
    /// Their length.
    pub length: GapLength,
    /// The number of points in each.
    pub points: usize,
    /// Mean squared error of a coordinate, cm², a gap.
    pub mse: ByMethod,
    /// Distances of points from where they were, cm, a point and frame.
    pub distances: ByMethod,
    /// Coordinates that were filled, and how many of them are within 0.25, 0.5, … 3 of
    /// the stated standard deviations.
    pub filled: usize,
    /// See `filled`.
    pub within: [usize; SD_LEVELS.len()],
    /// Gaps that stayed empty in part, which no other figure counts.
    pub left_empty: usize,
    drawn: Vec<SegmentWithGap>,
    seed: u64,
}

impl GapCell {
    /// Draws gaps; fewer than asked for if no more are found.
    pub(super) fn draw(
        takes: &TestTakes,
        length: GapLength,
        points: usize,
        settings: &TakesSettings,
        stream: u64,
    ) -> GapCell {
        let mut random = parallel::rng(settings.seed, stream);
        let to_the_end = length == GapLength::ToTheEnd;
        let one = |_| draw(takes, length.seconds(), points, to_the_end, &mut random);
        GapCell {
            length,
            points,
            mse: ByMethod::default(),
            distances: ByMethod::default(),
            filled: 0,
            within: [0; SD_LEVELS.len()],
            left_empty: 0,
            drawn: (0..settings.gaps).map_while(one).collect(),
            seed: settings.seed,
        }
    }

    /// Fills the gaps in the takes of a subject; `others` are the moments of other subjects' poses
    /// in the pelvis's frame.
    pub(super) fn test(
        &mut self,
        takes: &TestTakes,
        subject: usize,
        restorer: &Restorer<'_>,
        others: Option<&Moments>,
    ) -> Result<()> {
        let own = |g: &&SegmentWithGap| takes.takes[g.segment.take].subject == subject;
        let own: Vec<SegmentWithGap> = self.drawn.iter().filter(own).cloned().collect();
        let Some(first) = own.first() else {
            return Ok(());
        };
        let truth: Vec<Array2<f64>> = own.iter().map(|g| g.segment.xyz(takes)).collect();
        let mut damaged = truth.clone();
        let (mut time, mut take) = (Vec::new(), Vec::new());
        for (k, (gap, xyz)) in own.iter().zip(&mut damaged).enumerate() {
            gap.gap.hide(xyz);
            let rate = takes.takes[gap.segment.take].rate;
            time.extend((0..xyz.nrows()).map(|t| t as f64 / rate));
            take.extend(vec![k.to_string().into(); xyz.nrows()]);
        }
        let views: Vec<_> = damaged.iter().map(|xyz| xyz.view()).collect();
        let table = Table::from_poses(Poses {
            points: takes.takes[first.segment.take].poses.points.clone(),
            // Segments have the same points.
            xyz: concatenate(Axis(0), &views).unwrap_or_default(),
            time: Some(time),
            take: Some(take),
        });
        let restored = restorer.complete(&table, &Complete::default())?;
        let mut start = 0;
        for ((gap, truth), damaged) in own.iter().zip(&truth).zip(&damaged) {
            let cut_gap = CutGap {
                names: &table.poses.points,
                xyz: damaged.view(),
                gap: &gap.gap,
                rate: takes.takes[gap.segment.take].rate,
            };
            self.compare(gap, truth, &cut_gap, &restored, start, others);
            start += truth.nrows();
        }
        Ok(())
    }

    /// Compares one filled gap, whose segment starts at frame `start` of what was restored, and its
    /// baselines with the truth.
    fn compare(
        &mut self,
        gap: &SegmentWithGap,
        truth: &Array2<f64>,
        cut_gap: &CutGap<'_>,
        restored: &Restoration<'_>,
        start: usize,
        others: Option<&Moments>,
    ) {
        let columns = gap.gap.columns();
        let cut = |xyz: ArrayView2<'_, f64>| {
            xyz.slice(s![gap.gap.frames.clone(), ..])
                .select(Axis(1), &columns)
        };
        let wanted = cut(truth.view());
        let found = cut(restored.xyz().slice(s![start..start + truth.nrows(), ..]));
        if found.iter().any(|v| v.is_nan()) {
            self.left_empty += 1;
            return;
        }
        let errors = &found - &wanted;
        for (i, t) in gap.gap.frames.clone().enumerate() {
            for (k, p) in gap.gap.points.iter().enumerate() {
                let sd = restored.sd(start + t, *p);
                for error in errors.slice(s![i, 3 * k..3 * k + 3]) {
                    self.filled += 1;
                    for (count, (level, _)) in self.within.iter_mut().zip(SD_LEVELS) {
                        *count += usize::from(error.abs() <= level * sd);
                    }
                }
            }
        }
        let baselines = [
            (RESTORED, Some(found)),
            ("Gaussian", cut_gap.gaussian(others)),
            ("PCHIP", Some(cut_gap.pchip())),
            ("linear", Some(cut_gap.linear())),
        ];
        for (method, found) in baselines {
            // Without a Gaussian there is what interpolation says.
            let errors = found.unwrap_or_else(|| cut_gap.pchip()) - &wanted;
            self.mse.push(method, mean_square(errors.iter().copied()));
            for row in errors.rows() {
                for e in row.exact_chunks(3) {
                    self.distances.push(method, e.dot(&e).sqrt());
                }
            }
        }
    }

    /// The RMS error of a coordinate over all gaps, cm; `None` without a gap.
    pub(crate) fn rms(&self, method: &str) -> Option<f64> {
        rms(self.mse.of(method))
    }

    /// Median (`share` .5) or other quantile of the points' distances, cm; `None` without a gap.
    pub(crate) fn distance(&self, method: &str, share: f64) -> Option<f64> {
        quantile(self.distances.of(method).to_vec(), share)
    }

    /// The RMS error divided by that of the best baseline, with the 95% interval of a bootstrap
    /// over gaps; `None` without a gap.
    pub(crate) fn to_best_baseline(&self) -> Option<(f64, [f64; 2])> {
        let baselines = self.mse.names().filter(|m| *m != RESTORED);
        let sum = |mse: &[f64]| mse.iter().sum::<f64>();
        let best = baselines
            .map(|m| self.mse.of(m))
            .min_by(|a, b| sum(a).total_cmp(&sum(b)))?;
        let own = self.mse.of(RESTORED);
        let mut random = parallel::rng(self.seed, u64::MAX);
        let interval = bootstrap_interval(own.len(), &mut random, |drawn| {
            let (a, b) = drawn.fold((0.0, 0.0), |(a, b), k| (a + own[k], b + best[k]));
            (a / b).sqrt()
        });
        Some((rms(own)? / rms(best)?, interval))
    }
}
