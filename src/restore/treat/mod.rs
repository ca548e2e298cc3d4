//! What any prior's answer gains from knowing two things more: points that are corrupt, and distances that are rigid.
//!
//! ```text
//! observation ── bones: which points are in doubt ── prior, without them ── assignments, weighed ── prior ── average
//!                                                                                                             │
//! answer <───────────────────── rigid distances kept <─────────────────────────────────────────────────────────┘
//! ```

pub mod base;
pub mod bodies;
pub mod bones;
mod gradients;
pub mod outliers;
pub mod rigid;
pub mod sure;

use crate::Result;
use crate::io::Model;
use crate::numeric::parallel;
use crate::prior::pairs::RigidPairs;
use crate::prior::tuning::Task;
use crate::prior::{Belief, EXACT_VARIANCE, Enough, Posterior, Prior};
use base::{BaseNoise, Bases};
use bodies::Bodies;
use ndarray::ArrayView2;
use rigid::Whose;
use std::ops::Range;
use sure::Sure;

/// Frames treated by one piece of parallel work.
const CHUNK: usize = 16;
/// Points a bit mask can hold.
const MOST_MASKED: usize = 128;

/// Whether corrupt points are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seek {
    /// The noise that is told is the noise there is.
    Nothing,
    /// The noise that is told is that of clean points; any may be corrupt.
    Outliers,
}

impl Seek {
    /// What to look for where this noise is told: corrupt points where everything is seen, and nearly clean.
    pub fn by(told: &[f64]) -> Seek {
        match Task::of(told) {
            Task::Sparse => Seek::Outliers,
            _ => Seek::Nothing,
        }
    }
}

/// A treated answer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Treated {
    /// The pose.
    pub posterior: Posterior,
    /// The probability that each point is corrupt (J); none where they were not looked for.
    pub corrupt: Vec<f64>,
}

impl From<Posterior> for Treated {
    fn from(posterior: Posterior) -> Treated {
        Treated {
            posterior,
            corrupt: Vec::new(),
        }
    }
}

/// What is known of the rigid distances of some points.
#[derive(Debug, Clone, Default)]
pub struct Treatment {
    pairs: RigidPairs,
    bodies: Bodies,
    bases: Bases,
}

/// How much of a distance a person may differ by from the model's body. Chosen among 0, .02, .04 and .06 on single frames of
/// subjects 02, 07, 08, 35 and 49, one take each, with the built-in model: at .05 clean frames are moved by an MSE of 5e-7
/// to .005 asf² (.007 to .09 at 0), and sparse noise leaves .016 to .033 (.023 to .11).
const ANYONES_SHARE: f64 = 0.05;

impl Treatment {
    /// Learns the rigid pairs of poses (m, 3 J), cm.
    pub fn learn(xyz: ArrayView2<'_, f32>, takes: &[Range<usize>]) -> Treatment {
        Treatment::of(RigidPairs::learn(xyz, takes))
    }

    /// With pairs that are known.
    pub fn of(pairs: RigidPairs) -> Treatment {
        if pairs.is_empty() {
            return Treatment::default();
        }
        let bodies = Bodies::of(&pairs);
        Treatment::with(pairs, bodies)
    }

    fn with(pairs: RigidPairs, bodies: Bodies) -> Treatment {
        Treatment {
            bases: Bases::of(&bodies),
            bodies,
            pairs,
        }
    }

    /// With the pairs that a model holds; a model without any treats nothing.
    ///
    /// # Errors
    /// As [`RigidPairs::read`].
    pub fn read(model: &Model, source: &str) -> Result<Treatment> {
        RigidPairs::read(model, source).map(Treatment::of)
    }

    /// The same for another body: `from` and `to` (t, 3 J) are poses before and after they were carried to it. `unsure`
    /// tells of two points and their distance how far that may be off: a standard deviation, cm.
    pub fn mapped(
        &self,
        from: ArrayView2<'_, f64>,
        to: ArrayView2<'_, f64>,
        unsure: impl Fn([usize; 2], f64) -> f64,
    ) -> Treatment {
        let mut pairs = self.pairs.mapped(from, to);
        for (k, pair) in pairs.pairs.iter_mut().enumerate() {
            let length = pairs.bodies[[0, k]];
            pair.sd = pair.sd.hypot(unsure(pair.ends, length));
        }
        Treatment::of(pairs)
    }

    /// The same for anyone: a person's distances differ from those of the bodies known, whose bones were all made as long
    /// as the model's are.
    pub fn of_anyone(&self) -> Treatment {
        let mut pairs = self.pairs.clone();
        for (pair, lengths) in pairs.pairs.iter_mut().zip(self.pairs.bodies.columns()) {
            let mean = lengths
                .iter()
                .zip(&self.pairs.shares)
                .map(|(l, s)| l * s)
                .sum::<f64>();
            pair.sd = pair.sd.hypot(ANYONES_SHARE * mean);
        }
        // Nobody is a stranger to lengths that may be anyone's.
        let bodies = Bodies::known(&pairs);
        Treatment::with(pairs, bodies)
    }

    /// Whether there is nothing it knows.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The base noise of a frame (3 J numbers, cm; NaN missing) by its rigid distances. `None` where too few are seen, or
    /// they are of no body that is known.
    pub fn base_noise(&self, y: &[f64]) -> Option<BaseNoise> {
        self.bases.base(&self.pairs, &self.bodies, y)
    }

    /// The probability that each point (J) is corrupt by the distances alone; `noise` is the variance of clean
    /// coordinates, infinite where missing. Needs no placement.
    pub fn doubts(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        if !self.can_seek(y.len() / 3) {
            return vec![0.0; y.len() / 3];
        }
        bones::look(&self.pairs, &self.bodies, y, noise).corrupt
    }

    /// Distances must hang most points together before corrupt ones can be told.
    fn can_seek(&self, points: usize) -> bool {
        let mut tied = vec![false; points];
        let ends = self.pairs.pairs.iter().flat_map(|p| p.ends);
        ends.for_each(|p| tied[p] = true);
        points <= MOST_MASKED && 2 * tied.iter().filter(|t| **t).count() > points
    }

    /// Restores poses in the prior's space: rows of `y` (cm) with the variance of each number's noise (cm²; infinite
    /// missing), as [`Prior::believe_all`] takes them. Numbers told to be exact stay as they are, unless their point is
    /// found to be corrupt.
    pub fn answer(
        &self,
        prior: &dyn Prior,
        y: ArrayView2<'_, f64>,
        noise: ArrayView2<'_, f64>,
        seek: Seek,
    ) -> Vec<Treated> {
        if seek == Seek::Outliers && self.can_seek(y.ncols() / 3) {
            let found = outliers::restore(prior, &self.pairs, &self.bodies, y, noise);
            return self.settle(found, |pairs, bodies, found| {
                let whose = Whose::Known(&found.lengths);
                let sure = Sure::Covariance(&found.belief.covariance, 1.0);
                Treated {
                    posterior: rigid::keep(
                        pairs,
                        bodies,
                        whose,
                        &found.belief.mean,
                        sure,
                        &found.noise,
                    ),
                    corrupt: found.corrupt.clone(),
                }
            });
        }
        let told = |t: usize| noise.row(t).to_vec();
        // Of a dense answer that leaves much open nothing is made use of beyond how sure each coordinate is.
        let enough = noise.rows().into_iter().map(|told| match told.as_slice() {
            Some(told) if Task::of(told) == Task::Dense => UNKNOWN * told.iter().sum::<f64>(),
            _ => f64::INFINITY,
        });
        let rows = prior.believe_enough(y, noise, &enough.collect::<Vec<_>>());
        let rows = rows.into_iter().enumerate().collect();
        self.settle(rows, |pairs, bodies, (t, believed): &(usize, Enough)| {
            let told = told(*t);
            let keep =
                |mean: &[f64], sure| rigid::keep(pairs, bodies, Whose::Any, mean, sure, &told);
            let answer = match believed {
                Enough::Apart(p) => keep(&p.mean, Sure::Variances(&p.variance)),
                Enough::Whole(belief) => {
                    let mut belief = belief.clone();
                    fix(&mut belief, &y.row(*t).to_vec(), &told);
                    let covariance = &belief.covariance;
                    let sure = match Task::of(&told) {
                        Task::Dense => {
                            Sure::Settled(covariance, known(covariance.diag().sum(), &told))
                        }
                        _ => Sure::Covariance(covariance, 0.5),
                    };
                    keep(&belief.mean, sure)
                }
            };
            answer.into()
        })
    }

    fn settle<T: Sync>(
        &self,
        rows: Vec<T>,
        keep: impl Fn(&RigidPairs, &Bodies, &T) -> Treated + Sync,
    ) -> Vec<Treated> {
        let parts = parallel::map_chunks(rows.len(), CHUNK, |range| {
            let all = rows[range].iter();
            all.map(|row| keep(&self.pairs, &self.bodies, row))
                .collect::<Vec<_>>()
        });
        parts.into_iter().flatten().collect()
    }
}

/// Shares of the noise's variance that an answer leaves open: of a pose that is known, and of one that is not.
const KNOWN: f64 = 0.09;
const UNKNOWN: f64 = 0.15;

/// How well known a pose is that was seen through dense noise, from 0 to 1: as much of what the belief says of two
/// coordinates together is made use of when rigid distances are kept.
///
/// An answer that leaves little open ([`KNOWN`] of the noise's variance) is of a pose that is known, and its correlations
/// hold; one that leaves much ([`UNKNOWN`]) is of a pose unlike any, of which they are wrong more often than right. Measured:
/// taken whole, they cost 7% on takes never seen; left out, 10% on frames of takes that were.
fn known(variance: f64, told: &[f64]) -> f64 {
    let left = variance / told.iter().sum::<f64>();
    ((UNKNOWN - left) / (UNKNOWN - KNOWN)).clamp(0.0, 1.0)
}

/// Numbers that are exact are believed as they are.
fn fix(belief: &mut Belief, y: &[f64], noise: &[f64]) {
    for (i, r) in noise.iter().enumerate() {
        if *r <= EXACT_VARIANCE && y[i].is_finite() {
            belief.mean[i] = y[i];
            belief.covariance.row_mut(i).fill(0.0);
            belief.covariance.column_mut(i).fill(0.0);
            belief.covariance[[i, i]] = EXACT_VARIANCE;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::gaussians::{Answer, Gaussians, Parts, Style};
    use ndarray::{Array2, Axis, s};
    use rand_distr::StandardNormal;

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

    fn learnt(poses: &Array2<f64>) -> (Treatment, Gaussians) {
        let half = poses.nrows() / 2;
        let xyz = poses.mapv(|v| v as f32);
        let treatment = Treatment::learn(xyz.view(), &[0..half, half..poses.nrows()]);
        let mean = poses.mean_axis(Axis(0)).unwrap();
        let off = poses - &mean;
        let covariance = off.t().dot(&off) / poses.nrows() as f64 + Array2::<f64>::eye(24) * 0.05;
        let parts =
            Parts::of_covariances(vec![1.0], mean.clone().insert_axis(Axis(0)), &[covariance]);
        let style = Style {
            answer: Answer::Average,
            estimates_rest: true,
        };
        let typical = mean.insert_axis(Axis(0));
        (
            treatment,
            Gaussians::new(&parts, style, 1.0, typical.view()),
        )
    }

    /// Some points of each frame moved by about 6 cm; which.
    fn hit(poses: &Array2<f64>) -> (Array2<f64>, Vec<usize>) {
        let mut y = poses.clone();
        let which: Vec<usize> = (0..poses.nrows()).map(|t| 1 + (t * 5) % 7).collect();
        for (t, p) in which.iter().enumerate() {
            let wave = |c: usize| 5.0 * ((t * 3 + 7 * c) as f64).sin() + 3.0;
            (0..3).for_each(|c| y[[t, 3 * p + c]] += wave(c));
        }
        (y, which)
    }

    #[test]
    fn nothing_corrupt_nothing_changed() {
        let poses = swinging(200);
        let (treatment, prior) = learnt(&poses);
        assert_eq!(treatment.pairs.pairs.len(), 7);
        let told = Array2::zeros(poses.dim());
        for (t, answer) in treatment
            .answer(&prior, poses.view(), told.view(), Seek::Outliers)
            .iter()
            .enumerate()
        {
            // A tip in some doubt moves a little.
            let off = (0..24)
                .map(|c| (answer.posterior.mean[c] - poses[[t, c]]).abs())
                .fold(0.0, f64::max);
            assert!(off <= 0.5, "{t}: {off} {:?}", answer.corrupt);
            assert!(answer.corrupt.iter().all(|q| *q < 0.5));
        }
    }

    #[test]
    fn a_corrupt_point_is_found_and_put_back() {
        let poses = swinging(200);
        let (treatment, prior) = learnt(&poses);
        let (y, which) = hit(&poses);
        for base in [0.0, 0.08] {
            let told = Array2::from_elem(poses.dim(), base);
            let (mut before, mut after, mut found) = (0.0, 0.0, 0);
            let answers = treatment.answer(&prior, y.view(), told.view(), Seek::Outliers);
            for (t, answer) in answers.iter().enumerate() {
                found += usize::from(answer.corrupt[which[t]] > 0.5);
                for c in 0..24 {
                    before += (y[[t, c]] - poses[[t, c]]).powi(2);
                    after += (answer.posterior.mean[c] - poses[[t, c]]).powi(2);
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
        // So much noise on every point leaves most of them in doubt by their distances.
        let (poses, sd) = (swinging(200), 0.4);
        let (treatment, prior) = learnt(&poses);
        let (mut y, which) = hit(&poses);
        let mut generator = crate::numeric::parallel::rng(9, 0);
        y.mapv_inplace(|v| v + sd * rand::Rng::sample::<f64, _>(&mut generator, StandardNormal));
        let told = Array2::from_elem(poses.dim(), sd * sd);
        let answers = treatment.answer(&prior, y.view(), told.view(), Seek::Outliers);
        let (mut found, mut wrong, mut before, mut after) = (0, 0, 0.0, 0.0);
        for (t, answer) in answers.iter().enumerate() {
            let corrupt: Vec<usize> = (0..8).filter(|p| answer.corrupt[*p] > 0.5).collect();
            found += usize::from(corrupt.contains(&which[t]));
            wrong += corrupt.iter().filter(|p| **p != which[t]).count();
            for c in 0..24 {
                before += (y[[t, c]] - poses[[t, c]]).powi(2);
                after += (answer.posterior.mean[c] - poses[[t, c]]).powi(2);
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
        let (treatment, prior) = learnt(&poses);
        let mut told = Array2::zeros((10, 24));
        // Only the ends of the chain and its middle are seen.
        for p in [1, 2, 3, 5, 6] {
            told.slice_mut(s![.., 3 * p..3 * p + 3]).fill(f64::INFINITY);
        }
        let y = poses.slice(s![..10, ..]);
        for answer in treatment.answer(&prior, y, told.view(), Seek::Nothing) {
            let x = &answer.posterior.mean;
            for p in 1..8 {
                let length = (0..3)
                    .map(|c| (x[3 * p + c] - x[3 * p - 3 + c]).powi(2))
                    .sum::<f64>()
                    .sqrt();
                assert!((length - 12.0).abs() <= 0.3, "{length}");
            }
            assert!(answer.posterior.variance.iter().all(|v| *v >= 0.0));
        }
    }

    #[test]
    fn the_threads_change_nothing() {
        let poses = swinging(90);
        let (treatment, prior) = learnt(&poses);
        let (y, _) = hit(&poses);
        // The same for exact points as for noisy ones, which are looked at twice.
        for base in [0.0, 0.3] {
            let told = Array2::from_elem(poses.dim(), base);
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                pool.install(|| treatment.answer(&prior, y.view(), told.view(), Seek::Outliers))
            };
            let one = run(1);
            assert!(run(2) == one && run(7) == one);
            // And a frame alone is answered as among others.
            let alone = treatment.answer(
                &prior,
                y.slice(s![41..42, ..]),
                told.slice(s![41..42, ..]),
                Seek::Outliers,
            );
            assert_eq!(alone[0], one[41]);
        }
    }

    #[test]
    fn missing_points_and_frames_of_nothing_are_answered() {
        let poses = swinging(60);
        let (treatment, prior) = learnt(&poses);
        let mut y = poses.slice(s![..3, ..]).to_owned();
        y.slice_mut(s![0, 6..9]).fill(f64::NAN);
        y.row_mut(1).fill(f64::NAN);
        y.row_mut(2).fill(1e6);
        let told = Array2::zeros((3, 24));
        let answers = treatment.answer(&prior, y.view(), told.view(), Seek::Outliers);
        assert_eq!(answers.len(), 3);
        for answer in &answers {
            assert!(answer.posterior.mean.iter().all(|v| v.is_finite()));
        }
        let off = |c: usize| (answers[0].posterior.mean[c] - poses[[0, c]]).abs();
        assert!((0..24).all(|c| off(c) <= 1.0) && answers[0].corrupt[2] == 0.0);
        let none = Array2::zeros((0, 24));
        assert!(
            treatment
                .answer(&prior, none.view(), none.view(), Seek::Outliers)
                .is_empty()
        );
    }

    #[test]
    fn without_pairs_the_prior_answers_alone() {
        let poses = swinging(40);
        let (_, prior) = learnt(&poses);
        let told = Array2::from_elem(poses.dim(), 1.0);
        let plain = prior.believe_all(poses.view(), told.view());
        for seek in [Seek::Nothing, Seek::Outliers] {
            let answers = Treatment::default().answer(&prior, poses.view(), told.view(), seek);
            assert!(
                answers
                    .iter()
                    .zip(&plain)
                    .all(|(a, b)| a.posterior == b.clone().posterior() && a.corrupt.is_empty())
            );
        }
        assert_eq!(Seek::by(&[0.0, 0.08]), Seek::Outliers);
        assert_eq!(Seek::by(&[31.9, 31.9]), Seek::Nothing);
        assert_eq!(Seek::by(&[0.0, f64::INFINITY]), Seek::Nothing);
    }
}
