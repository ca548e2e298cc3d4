//! Rigid distances: what they say about outliers, noise and lengths, on top of any prior.
//!
//! n pairs of points keep their distance L (cm, variance V): bones, and whatever else is stiff. A
//! frame y is restored in two steps, in the model's space:
//!
//! ```text
//! no outliers:  prior posterior N(m, P) of y
//!     -> projection onto |x_i − x_j| = L
//! outliers:     distances -> likely outliers -> posterior under each  -> average -> projection
//! ```
//!
//! The second line is [`super::outliers::frame_posterior`]; the projection is [`projection`].

pub(crate) mod body_lengths;
pub(crate) mod distances;
mod jacobian;
pub(crate) mod noise_floor;
pub(crate) mod projection;
pub(super) mod tuning;
pub(crate) mod uncertainty;

use crate::Result;
use crate::io::Model;
use crate::numeric::parallel;
use crate::outliers::frame_posterior;
use crate::outliers::rigid_likelihood::RigidLikelihood;
use crate::pose::Observation;
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::tuning::Task;
use crate::prior::{Posterior, Prior, Want};
use body_lengths::BodyMixture;
use ndarray::ArrayView2;
use noise_floor::{NoiseFloor, NoiseFloorSearch};
use projection::BodyChoice;
use std::ops::Range;
use tuning::model::*;
use uncertainty::Uncertainty;

/// Largest number of points: one bit each in a 128-bit mask.
const MOST_MASKED: usize = 128;

/// Whether outliers are searched for.
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutlierMode {
    /// The stated variances are those of the noise.
    Ignore,
    /// The stated variances are those of clean points; any point may be an outlier.
    Search,
}

impl OutlierMode {
    /// The mode for such noise variances: outliers are searched for where everything is seen and
    /// nearly clean.
    pub fn for_noise(noise_variance: &[f64]) -> OutlierMode {
        match Task::of(noise_variance) {
            Task::Sparse => OutlierMode::Search,
            _ => OutlierMode::Ignore,
        }
    }
}

/// A posterior with rigid distances kept.
#[doc(hidden)]
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Corrected {
    /// The pose.
    pub posterior: Posterior,
    /// The probability of each point to be an outlier (J); empty where none were searched for.
    pub corrupt: Vec<f64>,
}

impl From<Posterior> for Corrected {
    fn from(posterior: Posterior) -> Corrected {
        Corrected {
            posterior,
            corrupt: Vec::new(),
        }
    }
}

/// What is known of a distance of another body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum OwnLength {
    /// The model's length, transformed, with this standard deviation besides, cm.
    Transformed { sd: f64 },
    /// A length measured in the take, cm.
    Measured { length: f64, sd: f64 },
}

/// The rigid distances of a model.
#[derive(Debug, Clone, Default)]
pub struct RigidModel {
    pairs: RigidPairs,
    bodies: BodyMixture,
    noise_floors: NoiseFloorSearch,
}

impl RigidModel {
    /// Learns the rigid pairs of poses (m, 3 J), cm.
    #[doc(hidden)]
    pub fn learn(xyz: ArrayView2<'_, f32>, takes: &[Range<usize>]) -> RigidModel {
        RigidModel::of(RigidPairs::learn(xyz, takes))
    }

    /// A model of known pairs.
    pub(crate) fn of(pairs: RigidPairs) -> RigidModel {
        if pairs.is_empty() {
            return RigidModel::default();
        }
        let bodies = BodyMixture::of(&pairs);
        RigidModel::with(pairs, bodies)
    }

    fn with(pairs: RigidPairs, bodies: BodyMixture) -> RigidModel {
        RigidModel {
            noise_floors: NoiseFloorSearch::of(&bodies),
            bodies,
            pairs,
        }
    }

    /// The pairs of a model file; empty for a model without pairs.
    ///
    /// # Errors
    /// As [`RigidPairs::read`].
    pub(crate) fn read(model: &Model, source: &str) -> Result<RigidModel> {
        RigidPairs::read(model, source).map(RigidModel::of)
    }

    /// The distances of another body. `from` and `to` (k, 3 J) are poses before and after their
    /// transform to it; `own` says what is known of the distance between two points of it, which
    /// is so many cm after the transform. A pair of which nothing is known is left out.
    pub(crate) fn mapped(
        &self,
        from: ArrayView2<'_, f64>,
        to: ArrayView2<'_, f64>,
        own: impl Fn([usize; 2], f64) -> Option<OwnLength>,
    ) -> RigidModel {
        let mut pairs = self.pairs.mapped(from, to);
        let mut kept = Vec::new();
        for (k, pair) in pairs.pairs.iter_mut().enumerate() {
            let known = own(pair.ends, pairs.bodies[[0, k]]);
            match known {
                Some(OwnLength::Transformed { sd }) => pair.sd = pair.sd.hypot(sd),
                Some(OwnLength::Measured { length, sd }) => {
                    pairs.bodies.column_mut(k).fill(length);
                    pair.sd = self.pairs.pairs[k].sd.hypot(sd);
                }
                None => continue,
            }
            kept.push(k);
        }
        RigidModel::of(pairs.selected(&kept))
    }

    /// The distances with a further standard deviation, cm.
    pub(crate) fn loosened(&self, sd: f64) -> RigidModel {
        let mut pairs = self.pairs.clone();
        let each = pairs.pairs.iter_mut();
        each.for_each(|pair| pair.sd = pair.sd.hypot(sd));
        RigidModel::of(pairs)
    }

    /// The distances of a person who has not been measured. The known bodies do not show how people
    /// differ: their bones were all scaled to the model's.
    pub(crate) fn for_unknown_body(&self) -> RigidModel {
        let mut pairs = self.pairs.clone();
        for (pair, lengths) in pairs.pairs.iter_mut().zip(self.pairs.bodies.columns()) {
            let mean = lengths
                .iter()
                .zip(&self.pairs.shares)
                .map(|(l, s)| l * s)
                .sum::<f64>();
            pair.sd = pair.sd.hypot(ANYONES_SHARE * mean);
        }
        // These variances include unknown bodies already.
        let bodies = BodyMixture::known(&pairs);
        RigidModel::with(pairs, bodies)
    }

    /// Whether there are no pairs.
    pub(crate) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The noise floor of a frame (3 J, cm; NaN missing). `None` where too few distances are seen,
    /// or no known body fits.
    pub(crate) fn noise_floor(&self, y: &[f64]) -> Option<NoiseFloor> {
        self.noise_floors.base(&self.pairs, &self.bodies, y)
    }

    /// The probability of each point (J) to be an outlier by the distances alone; `noise` is the
    /// variance of clean coordinates, infinite where missing. Needs no placement.
    pub(crate) fn outlier_probabilities(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        if !self.can_search(y.len() / 3) {
            return vec![0.0; y.len() / 3];
        }
        RigidLikelihood::new(&self.pairs, &self.bodies, y, noise).corrupt
    }

    /// Outliers can be found only if distances connect most points.
    fn can_search(&self, points: usize) -> bool {
        let mut tied = vec![false; points];
        let ends = self.pairs.pairs.iter().flat_map(|p| p.ends);
        ends.for_each(|p| tied[p] = true);
        points <= MOST_MASKED && 2 * tied.iter().filter(|t| **t).count() > points
    }

    /// Restores poses in the prior's space: rows of `y` (cm) with noise variances (cm², infinite
    /// where missing). Exact coordinates stay as they are, unless their point is found to be an
    /// outlier.
    #[doc(hidden)]
    pub fn restore(
        &self,
        prior: &dyn Prior,
        y: ArrayView2<'_, f64>,
        noise: ArrayView2<'_, f64>,
        mode: OutlierMode,
    ) -> Vec<Corrected> {
        if mode == OutlierMode::Search && self.can_search(y.ncols() / 3) {
            let found = frame_posterior::restore(prior, &self.pairs, &self.bodies, y, noise);
            return self.converge(found, |pairs, bodies, found| {
                let whose = BodyChoice::Known(&found.lengths);
                let uncertainty = Uncertainty::Covariance(&found.belief.covariance, 1.0);
                Corrected {
                    posterior: projection::project(
                        pairs,
                        bodies,
                        whose,
                        &found.belief.mean,
                        uncertainty,
                        &found.noise,
                    ),
                    corrupt: found.corrupt.clone(),
                }
            });
        }
        let (y, noise) = (y.as_standard_layout(), noise.as_standard_layout());
        let rows = y.rows().into_iter().zip(noise.rows());
        let slices = rows.filter_map(|(y, noise)| y.to_slice().zip(noise.to_slice()));
        let seen = slices.map(|(values, variance)| Observation { values, variance });
        let batch: Vec<(Observation<'_>, Want)> = seen.map(|o| (o, Want::Covariance)).collect();
        let posteriors = prior.posterior_batch(&batch);
        let rows = batch.iter().zip(posteriors).collect();
        self.converge(
            rows,
            |pairs, bodies, ((seen, _), posterior): &(&(Observation<'_>, Want), Posterior)| {
                let keep = |mean: &[f64], uncertainty| Posterior {
                    log_evidence: posterior.log_evidence,
                    ..projection::project(
                        pairs,
                        bodies,
                        BodyChoice::Any,
                        mean,
                        uncertainty,
                        seen.variance,
                    )
                };
                let dense = Task::of(seen.variance) == Task::Dense;
                let known = known(posterior.variance.iter().sum(), seen.variance);
                if dense && known == 0.0 {
                    let uncertainty = Uncertainty::Variances(&posterior.variance);
                    return keep(&posterior.mean, uncertainty).into();
                }
                let mut posterior = posterior.clone();
                uncertainty::pin_exact(&mut posterior, seen.values, seen.variance);
                let covariance = &posterior.covariance;
                let uncertainty = if dense {
                    Uncertainty::Settled(covariance, known)
                } else {
                    Uncertainty::Covariance(covariance, CORRELATED)
                };
                keep(&posterior.mean, uncertainty).into()
            },
        )
    }

    fn converge<T: Sync>(
        &self,
        rows: Vec<T>,
        keep: impl Fn(&RigidPairs, &BodyMixture, &T) -> Corrected + Sync,
    ) -> Vec<Corrected> {
        let parts = parallel::map_chunks(rows.len(), CHUNK, |range| {
            let all = rows[range].iter();
            all.map(|row| keep(&self.pairs, &self.bodies, row))
                .collect::<Vec<_>>()
        });
        parts.into_iter().flatten().collect()
    }
}

/// How much of a posterior's correlations the projection uses under dense noise, from 0 to 1.
///
/// A posterior that leaves little open ([`KNOWN`] of the noise variance) is that of a pose like the
/// training poses, and its correlations hold. One that leaves much ([`UNKNOWN`]) is that of a pose
/// unlike any, and its correlations are wrong more often than right.
fn known(variance: f64, noise_variance: &[f64]) -> f64 {
    let left = variance / noise_variance.iter().sum::<f64>();
    ((UNKNOWN - left) / (UNKNOWN - KNOWN)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::gaussian::{ConditionalGaussian, EXACT_VARIANCE};
    use crate::pose::{Observation, PoseTransform};
    use crate::prior::posterior_rows;
    use crate::prior::{Posterior, Want};
    use ndarray::{Array2, Axis, s};
    use rand_distr::StandardNormal;

    /// A Gaussian.
    struct Gaussian {
        mean: Vec<f64>,
        covariance: Array2<f64>,
        residual: Vec<f64>,
    }

    impl Prior for Gaussian {
        fn residual_variance(&self) -> &[f64] {
            &self.residual
        }

        fn posterior(&self, observation: &Observation<'_>, _want: Want) -> Posterior {
            let noise = observation.variance.iter().map(|n| n.max(EXACT_VARIANCE));
            let given =
                ConditionalGaussian::new(self.covariance.view(), &noise.collect::<Vec<_>>());
            let off = observation
                .values
                .iter()
                .zip(&self.mean)
                .map(|(v, m)| v - m);
            let off: Vec<f64> = off.collect();
            let mean = given
                .mean(&off)
                .into_iter()
                .zip(&self.mean)
                .map(|(d, m)| d + m);
            let covariance = given.covariance(self.covariance.view());
            Posterior::full(mean.collect(), covariance, given.log_density(&off))
        }

        fn mapped(&self, _: &PoseTransform) -> Box<dyn Prior> {
            unreachable!("poses stay where they are")
        }
    }

    /// Eight points in a chain of rigid bars that swing smoothly, over two takes.
    fn swinging(frames: usize) -> Array2<f64> {
        let mut out = Array2::zeros((frames, 24));
        for t in 0..frames {
            let at = t as f64 * 0.07;
            for p in 1..8 {
                let turn = 1.1 * (at + 2.3 * p as f64).sin();
                let lift = 0.7 * (1.7 * at + 1.9 * p as f64).cos();
                let step = [turn.cos() * lift.cos(), turn.sin() * lift.cos(), lift.sin()];
                for c in 0..3 {
                    out[[t, 3 * p + c]] = out[[t, 3 * (p - 1) + c]] + 12.0 * step[c];
                }
            }
        }
        out
    }

    fn learned(poses: &Array2<f64>) -> (RigidModel, Gaussian) {
        let half = poses.nrows() / 2;
        let xyz = poses.mapv(|v| v as f32);
        let rigid = RigidModel::learn(xyz.view(), &[0..half, half..poses.nrows()]);
        let mean = poses.mean_axis(Axis(0)).unwrap();
        let off = poses - &mean;
        let covariance = off.t().dot(&off) / poses.nrows() as f64 + Array2::<f64>::eye(24) * 0.05;
        let prior = Gaussian {
            mean: mean.to_vec(),
            covariance,
            residual: vec![0.0; 24],
        };
        (rigid, prior)
    }

    /// Moves one point of each frame by about 6 cm; returns which.
    fn hit(poses: &Array2<f64>) -> (Array2<f64>, Vec<usize>) {
        let mut y = poses.clone();
        let which: Vec<usize> = (0..poses.nrows()).map(|t| 1 + (t * 5) % 7).collect();
        for (t, p) in which.iter().enumerate() {
            let shift = |c: usize| 5.0 * ((t * 3 + 7 * c) as f64).sin() + 3.0;
            (0..3).for_each(|c| y[[t, 3 * p + c]] += shift(c));
        }
        (y, which)
    }

    #[test]
    fn nothing_corrupt_nothing_changed() {
        let poses = swinging(200);
        let (rigid, prior) = learned(&poses);
        assert_eq!(rigid.pairs.pairs.len(), 7);
        let noise_variance = Array2::zeros(poses.dim());
        for (t, restored) in rigid
            .restore(
                &prior,
                poses.view(),
                noise_variance.view(),
                OutlierMode::Search,
            )
            .iter()
            .enumerate()
        {
            // A point at the end of the chain may be moved a little.
            let off = (0..24)
                .map(|c| (restored.posterior.mean[c] - poses[[t, c]]).abs())
                .fold(0.0, f64::max);
            assert!(off <= 0.5, "{t}: {off} {:?}", restored.corrupt);
            assert!(restored.corrupt.iter().all(|q| *q < 0.5));
        }
    }

    #[test]
    fn a_corrupt_point_is_found_and_put_back() {
        let poses = swinging(200);
        let (rigid, prior) = learned(&poses);
        let (y, which) = hit(&poses);
        for base in [0.0, 0.08] {
            let noise_variance = Array2::from_elem(poses.dim(), base);
            let (mut before, mut after, mut found) = (0.0, 0.0, 0);
            let all = rigid.restore(&prior, y.view(), noise_variance.view(), OutlierMode::Search);
            for (t, restored) in all.iter().enumerate() {
                found += usize::from(restored.corrupt[which[t]] > 0.5);
                for c in 0..24 {
                    before += (y[[t, c]] - poses[[t, c]]).powi(2);
                    after += (restored.posterior.mean[c] - poses[[t, c]]).powi(2);
                }
            }
            assert!(
                found >= 180 && after <= 0.1 * before,
                "{base}: {found}, {before} {after}"
            );
        }
    }

    #[test]
    fn corrupt_points_are_found_among_noisy_ones() {
        // This much noise leaves most points undecided by their distances.
        let (poses, sd) = (swinging(200), 0.4);
        let (rigid, prior) = learned(&poses);
        let (mut y, which) = hit(&poses);
        let mut generator = crate::numeric::parallel::rng(9, 0);
        y.mapv_inplace(|v| v + sd * rand::Rng::sample::<f64, _>(&mut generator, StandardNormal));
        let noise_variance = Array2::from_elem(poses.dim(), sd * sd);
        let all = rigid.restore(&prior, y.view(), noise_variance.view(), OutlierMode::Search);
        let (mut found, mut wrong, mut before, mut after) = (0, 0, 0.0, 0.0);
        for (t, restored) in all.iter().enumerate() {
            let corrupt: Vec<usize> = (0..8).filter(|p| restored.corrupt[*p] > 0.5).collect();
            found += usize::from(corrupt.contains(&which[t]));
            wrong += corrupt.iter().filter(|p| **p != which[t]).count();
            for c in 0..24 {
                before += (y[[t, c]] - poses[[t, c]]).powi(2);
                after += (restored.posterior.mean[c] - poses[[t, c]]).powi(2);
            }
        }
        assert!(
            found >= 170 && wrong <= 40 && after <= 0.2 * before,
            "{found} {wrong} {before} {after}"
        );
    }

    #[test]
    fn rigid_distances_are_kept() {
        let poses = swinging(200);
        let (rigid, prior) = learned(&poses);
        let mut noise_variance = Array2::zeros((10, 24));
        // Only the ends of the chain and its middle are seen.
        for p in [1, 2, 3, 5, 6] {
            noise_variance
                .slice_mut(s![.., 3 * p..3 * p + 3])
                .fill(f64::INFINITY);
        }
        let y = poses.slice(s![..10, ..]);
        for restored in rigid.restore(&prior, y, noise_variance.view(), OutlierMode::Ignore) {
            let x = &restored.posterior.mean;
            for p in 1..8 {
                let length = (0..3)
                    .map(|c| (x[3 * p + c] - x[3 * p - 3 + c]).powi(2))
                    .sum::<f64>()
                    .sqrt();
                assert!((length - 12.0).abs() <= 0.3, "{length}");
            }
            assert!(restored.posterior.variance.iter().all(|v| *v >= 0.0));
        }
    }

    #[test]
    fn the_threads_change_nothing() {
        let poses = swinging(90);
        let (rigid, prior) = learned(&poses);
        let (y, _) = hit(&poses);
        // Exact points, and noisy ones, which are scored twice.
        for base in [0.0, 0.3] {
            let noise_variance = Array2::from_elem(poses.dim(), base);
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                pool.install(|| {
                    rigid.restore(&prior, y.view(), noise_variance.view(), OutlierMode::Search)
                })
            };
            let one = run(1);
            assert!(run(2) == one && run(7) == one);
            // A frame alone is restored as among others.
            let alone = rigid.restore(
                &prior,
                y.slice(s![41..42, ..]),
                noise_variance.slice(s![41..42, ..]),
                OutlierMode::Search,
            );
            assert_eq!(alone[0], one[41]);
        }
    }

    #[test]
    fn missing_points_and_frames_of_nothing_are_answered() {
        let poses = swinging(60);
        let (rigid, prior) = learned(&poses);
        let mut y = poses.slice(s![..3, ..]).to_owned();
        y.slice_mut(s![0, 6..9]).fill(f64::NAN);
        y.row_mut(1).fill(f64::NAN);
        y.row_mut(2).fill(1e6);
        let noise_variance = Array2::zeros((3, 24));
        let all = rigid.restore(&prior, y.view(), noise_variance.view(), OutlierMode::Search);
        assert_eq!(all.len(), 3);
        for restored in &all {
            assert!(restored.posterior.mean.iter().all(|v| v.is_finite()));
        }
        let off = |c: usize| (all[0].posterior.mean[c] - poses[[0, c]]).abs();
        assert!((0..24).all(|c| off(c) <= 1.0) && all[0].corrupt[2] == 0.0);
        let none = Array2::zeros((0, 24));
        assert!(
            rigid
                .restore(&prior, none.view(), none.view(), OutlierMode::Search)
                .is_empty()
        );
    }

    #[test]
    fn without_pairs_the_prior_answers_alone() {
        let poses = swinging(40);
        let (_, prior) = learned(&poses);
        let noise_variance = Array2::from_elem(poses.dim(), 1.0);
        let plain = posterior_rows(&prior, poses.view(), noise_variance.view(), Want::Variances);
        for mode in [OutlierMode::Ignore, OutlierMode::Search] {
            let all =
                RigidModel::default().restore(&prior, poses.view(), noise_variance.view(), mode);
            assert!(
                all.iter()
                    .zip(&plain)
                    .all(|(a, b)| a.posterior.mean == b.mean
                        && a.posterior.variance == b.variance
                        && a.corrupt.is_empty())
            );
        }
        assert_eq!(OutlierMode::for_noise(&[0.0, 0.08]), OutlierMode::Search);
        assert_eq!(OutlierMode::for_noise(&[31.9, 31.9]), OutlierMode::Ignore);
        assert_eq!(
            OutlierMode::for_noise(&[0.0, f64::INFINITY]),
            OutlierMode::Ignore
        );
    }
}
