//! Noise of one level, removed and compared with the takes as they were.

use super::baselines::butterworth;
use super::segments::{Segment, of_take};
use super::{ByMethod, RESTORED, TakesSettings, TestTakes, mean_square, rms};
use crate::Result;
use crate::damage::Corruption;
use crate::io::Table;
use crate::numeric::parallel;
use crate::pose::Poses;
use crate::restore::{Denoise, Restorer};
use ndarray::{Array2, ArrayView2};

/// Cutoffs of the Butterworth filter, Hz: the best for each take is chosen with the truth at hand.
const CUTOFFS: std::ops::RangeInclusive<u32> = 3..=20;
/// What is faster than this, Hz, is left out of accelerations.
const FASTEST: f64 = 20.0;
/// The stream of the segments of noise, apart from those of the gaps.
const STREAM: u64 = 1 << 32;

/// Noise of one level.
#[derive(Debug, Clone)]
pub struct NoiseCell {
    /// Standard deviation of a coordinate, cm; 0 shows what a clean take loses.
    pub sd: f64,
    /// The share of the points that are hit in a frame, 0 to 1.
    pub share: f64,
    /// Mean squared error of a coordinate, cm², a take.
    pub mse: ByMethod,
    /// Mean squared error of accelerations below 20 Hz, (m/s²)², a take.
    pub acceleration: ByMethod,
    segments: Vec<Segment>,
}

impl NoiseCell {
    /// Draws a segment of each take, the same for all levels.
    pub(super) fn new(
        takes: &TestTakes,
        sd: f64,
        share: f64,
        settings: &TakesSettings,
    ) -> NoiseCell {
        let mut random = parallel::rng(settings.seed, STREAM);
        let segment = |take| of_take(takes, take, &mut random);
        NoiseCell {
            sd,
            share,
            mse: ByMethod::default(),
            acceleration: ByMethod::default(),
            segments: (0..takes.takes.len()).filter_map(segment).collect(),
        }
    }

    /// Adds noise to the takes of a subject and removes it.
    pub(super) fn test(
        &mut self,
        takes: &TestTakes,
        subject: usize,
        restorer: &Restorer<'_>,
        seed: u64,
    ) -> Result<()> {
        for (k, segment) in self.segments.clone().iter().enumerate() {
            let take = &takes.takes[segment.take];
            if take.subject != subject {
                continue;
            }
            let truth = segment.xyz(takes);
            let noisy = self.corrupt(&truth, &take.poses.points, seed.wrapping_add(k as u64))?;
            let table = Table::from_poses(Poses {
                points: take.poses.points.clone(),
                xyz: noisy.clone(),
                time: Some((0..truth.nrows()).map(|t| t as f64 / take.rate).collect()),
                take: None,
            });
            let restored = restorer.denoise(&table, &Denoise::default())?;
            let found = restored.xyz().to_owned();
            self.compare(truth.view(), &noisy, found, take.rate);
        }
        Ok(())
    }

    fn corrupt(&self, truth: &Array2<f64>, points: &[String], seed: u64) -> Result<Array2<f64>> {
        let (dense, sparse) = if self.share < 1.0 {
            (0.0, self.sd)
        } else {
            (self.sd, 0.0)
        };
        let corruption = Corruption {
            dense,
            sparse,
            share: self.share,
            seed,
            ..Corruption::default()
        };
        let corruptor = corruption.check(points)?;
        let mut noisy = truth.clone();
        corruptor.apply_frames(&mut noisy);
        Ok(noisy)
    }

    /// Compares what was restored and the baselines with the truth.
    fn compare(
        &mut self,
        truth: ArrayView2<'_, f64>,
        noisy: &Array2<f64>,
        found: Array2<f64>,
        rate: f64,
    ) {
        let error = |xyz: &Array2<f64>| {
            let seen = xyz.iter().zip(truth).filter(|(_, t)| t.is_finite());
            mean_square(seen.map(|(x, t)| x - t))
        };
        let jolts = |xyz: &Array2<f64>| acceleration_error(truth, xyz.view(), rate);
        let cutoffs = CUTOFFS.map(f64::from).filter(|c| *c < 0.45 * rate);
        let filtered: Vec<Array2<f64>> = cutoffs.map(|c| filter(noisy.view(), c, rate)).collect();
        let best =
            |of: &dyn Fn(&Array2<f64>) -> f64| filtered.iter().map(of).min_by(f64::total_cmp);
        self.mse.push(RESTORED, error(&found));
        self.acceleration.push(RESTORED, jolts(&found));
        if let (Some(mse), Some(acceleration)) = (best(&error), best(&jolts)) {
            self.mse.push("Butterworth", mse);
            self.acceleration.push("Butterworth", acceleration);
        }
        self.mse.push("as captured", error(noisy));
        self.acceleration.push("as captured", jolts(noisy));
    }

    /// The RMS error of a coordinate over all takes, cm; `None` where no take was tested.
    pub(crate) fn rms(&self, method: &str) -> Option<f64> {
        rms(self.mse.of(method))
    }

    /// The RMS error of an acceleration, m/s²; `None` where no take was tested.
    pub(crate) fn acceleration_rms(&self, method: &str) -> Option<f64> {
        rms(self.acceleration.of(method))
    }
}

/// All coordinates, filtered.
fn filter(xyz: ArrayView2<'_, f64>, cutoff: f64, rate: f64) -> Array2<f64> {
    let mut out = xyz.to_owned();
    for mut column in out.columns_mut() {
        let filtered = butterworth(&column.to_vec(), cutoff, rate);
        column.iter_mut().zip(filtered).for_each(|(o, f)| *o = f);
    }
    out
}

/// Mean squared error of second differences, both sides without what is faster than [`FASTEST`],
/// (m/s²)².
fn acceleration_error(truth: ArrayView2<'_, f64>, found: ArrayView2<'_, f64>, rate: f64) -> f64 {
    let slow = |xyz| filter(xyz, FASTEST.min(0.45 * rate), rate);
    let error = slow(found) - slow(truth);
    let columns = error.columns().into_iter().map(|c| c.to_vec());
    let second = columns.flat_map(|c| {
        let second = c
            .windows(3)
            .map(|w| (w[0] - 2.0 * w[1] + w[2]) * rate * rate / 100.0);
        second.collect::<Vec<_>>()
    });
    mean_square(second.filter(|a| a.is_finite()))
}
