//! Gaussian mixture priors: what PCA, the single Gaussian, the clustered Gaussians and the mixtures
//! share.
//!
//! ```text
//! p(x) = Σ_j w_j N(x; m_j, C_j),   y = x + noise of variances R
//! w_j|y ∝ w_j N(y_o; m_jo, C_j,oo + R_o)
//! m_j|y = m_j + C_j,:o (C_j,oo + R_o)⁻¹ (y_o − m_jo)
//!     C_j|y = C_j − C_j,:o (C_j,oo + R_o)⁻¹ C_j,o:
//! ```
//!
//! x (D) is the pose, cm; m_j (D) and C_j (D, D), cm², the K components with weights w_j; o are the
//! observed coordinates. The posterior is moment-matched over all j, or that of the most likely j
//! alone, as clustered Gaussians are published (`Readout`). A model that explains a pose only in
//! part (PCA) has a second variance U_j (D), cm², which counts as noise of the observed coordinates
//! and is never estimated.
//!
//! Cost: K D² per posterior, and K D³ once for each new noise pattern; recent patterns are cached.
//! The posterior is poor for motion unlike the training poses: far from all means the most similar
//! component is chosen by its tails.

pub(crate) mod clustered;
pub mod em;
pub mod mfa;
pub mod mixture;
mod mixture_params;
pub(crate) mod pca;
pub(crate) mod single;

use crate::Result;
use crate::io::Model;
use crate::numeric::gaussian::ConditionalGaussian;
use crate::numeric::linalg::symmetric_eigen;
use crate::pose::{Observation, PoseTransform};
use crate::prior::noise_cache::NoiseCache;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::tuning::{Grid, PriorFamily, TunedPrior, tune};
use crate::prior::{EXACT_VARIANCE, OpenOptions, Posterior, Prior, Want};
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::sync::Arc;

pub use mixture_params::{MixtureParams, roots};

/// Conditioned components kept in the cache (about 110 kB each).
const MAX_CACHED: usize = 640;
/// Components with less posterior weight are left out.
const MIN_WEIGHT: f64 = 1e-9;

/// How the components' posteriors are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Readout {
    /// The average, weighted by evidence.
    Average,
    /// The posterior of the most likely component.
    Best,
}

/// How a kind uses its Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Style {
    /// How the components' posteriors are combined.
    pub answer: Readout,
    /// Whether the part of a pose outside the factors is estimated. If not, it stays the mean
    /// (PCA).
    pub estimates_rest: bool,
}

#[derive(Debug, Clone)]
struct Component {
    log_weight: f64,
    mean: Vec<f64>,
    /// C_j (D, D), or its estimated part, cm².
    covariance: Array2<f64>,
    /// U_j (D): the part that is not estimated, cm².
    unexplained: Vec<f64>,
}

/// A Gaussian mixture prior at one inflation of its covariances.
#[derive(Debug, Clone)]
pub(crate) struct GaussianMixturePrior {
    components: Vec<Component>,
    answer: Readout,
    variance: Vec<f64>,
    /// The components, conditioned on the observed coordinates of a noise pattern.
    conditionals: NoiseCache<Vec<ConditionalGaussian>>,
}

impl GaussianMixturePrior {
    /// The mixture with its covariances multiplied by `inflation`.
    pub(crate) fn new(parts: &MixtureParams, style: Style, inflation: f64) -> GaussianMixturePrior {
        let component = |j: usize| {
            let (covariance, unexplained) = if style.estimates_rest {
                (parts.covariance(j), vec![0.0; parts.means.ncols()])
            } else {
                (parts.explained(j), parts.rest.row(j).to_vec())
            };
            Component {
                log_weight: parts.weights[j].ln(),
                mean: parts.means.row(j).to_vec(),
                covariance: covariance * inflation,
                unexplained,
            }
        };
        let components = (0..parts.len()).map(component).collect();
        GaussianMixturePrior::of(components, style.answer)
    }

    fn of(components: Vec<Component>, answer: Readout) -> GaussianMixturePrior {
        GaussianMixturePrior {
            variance: alone(&components),
            components,
            answer,
            conditionals: NoiseCache::default(),
        }
    }

    fn conditionals(&self, noise: &[f64]) -> Arc<Vec<ConditionalGaussian>> {
        let condition = |c: &Component| {
            let terms = noise.iter().zip(&c.unexplained);
            let noise: Vec<f64> = terms.map(|(n, u)| n.max(EXACT_VARIANCE) + u).collect();
            ConditionalGaussian::new(c.covariance.view(), &noise)
        };
        let all = || self.components.iter().map(condition).collect();
        let most = (MAX_CACHED / self.components.len().max(1)).max(1);
        self.conditionals.get(noise, most, all)
    }

    /// Index, weight and posterior mean of each component above [`MIN_WEIGHT`]; and the log
    /// evidence, nats.
    fn component_means(
        &self,
        y: &[f64],
        conditionals: &[ConditionalGaussian],
    ) -> (Vec<(usize, f64, Vec<f64>)>, f64) {
        let rest =
            |c: &Component| -> Vec<f64> { y.iter().zip(&c.mean).map(|(y, m)| y - m).collect() };
        let all = || self.components.iter().zip(conditionals);
        let logs: Vec<f64> = all()
            .map(|(c, given)| c.log_weight + given.log_density(&rest(c)))
            .collect();
        let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = logs.iter().map(|l| (l - best).exp()).sum();
        let winner = logs.iter().position(|l| *l == best).unwrap_or(0);
        let weight = |j: usize| match self.answer {
            Readout::Average => (logs[j] - best).exp() / sum,
            Readout::Best => f64::from(u8::from(j == winner)),
        };
        let component_means = all()
            .enumerate()
            .filter(|(j, _)| weight(*j) > MIN_WEIGHT || *j == winner);
        let component_means = component_means.map(|(j, (c, given))| {
            let update = given.mean(&rest(c));
            let mean = c.mean.iter().zip(update).map(|(m, t)| m + t).collect();
            (j, weight(j), mean)
        });
        (component_means.collect(), best + sum.ln())
    }
}

/// The weighted mean of the components' posterior means.
fn average(component_means: &[(usize, f64, Vec<f64>)], width: usize) -> Vec<f64> {
    let mut out = vec![0.0; width];
    let sum: f64 = component_means.iter().map(|(_, w, _)| w).sum();
    for (_, w, mean) in component_means {
        out.iter_mut()
            .zip(mean)
            .for_each(|(o, m)| *o += w / sum * m);
    }
    out
}

/// The variance of each coordinate given all others, cm²: Σ w_j (1 / (C_j⁻¹)_ii + U_j).
fn alone(components: &[Component]) -> Vec<f64> {
    let mut out = vec![0.0; components.first().map_or(0, |c| c.mean.len())];
    for c in components {
        let weight = c.log_weight.exp();
        let Some((values, vectors)) = symmetric_eigen(&c.covariance) else {
            continue;
        };
        for (i, row) in vectors.rows().into_iter().enumerate() {
            let terms = row.iter().zip(&values);
            let precision: f64 = terms.map(|(v, l)| v * v / l.max(EXACT_VARIANCE)).sum();
            out[i] += weight * (1.0 / precision + c.unexplained[i]);
        }
    }
    out
}

impl Prior for GaussianMixturePrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let conditionals = self.conditionals(observation.variance);
        let (component_means, log_evidence) =
            self.component_means(observation.values, &conditionals);
        let d = self.variance.len();
        let mean = average(&component_means, d);
        let sum: f64 = component_means.iter().map(|(_, w, _)| w).sum();
        match want {
            Want::Mean => Posterior {
                mean,
                log_evidence,
                ..Posterior::default()
            },
            Want::Variances => {
                let mut variance = vec![0.0; d];
                for (j, w, own) in &component_means {
                    let unexplained = &self.components[*j].unexplained;
                    for (i, v) in variance.iter_mut().enumerate() {
                        let away = own[i] - mean[i];
                        *v +=
                            w / sum * (conditionals[*j].variance[i] + unexplained[i] + away * away);
                    }
                }
                Posterior {
                    mean,
                    variance,
                    log_evidence,
                    ..Posterior::default()
                }
            }
            Want::Covariance => {
                let mut covariance = Array2::zeros((d, d));
                for (j, w, own) in &component_means {
                    let c = &self.components[*j];
                    covariance
                        .scaled_add(w / sum, &conditionals[*j].covariance(c.covariance.view()));
                    let away: Vec<f64> = own.iter().zip(&mean).map(|(o, m)| o - m).collect();
                    for (i, a) in away.iter().enumerate() {
                        let away = ArrayView1::from(&away);
                        covariance.row_mut(i).scaled_add(w / sum * a, &away);
                        covariance[[i, i]] += w / sum * c.unexplained[i];
                    }
                }
                Posterior::full(mean, covariance, log_evidence)
            }
        }
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        if map.is_identity() {
            return Box::new(self.clone());
        }
        let carried = |c: &Component| {
            let mut mean = c.mean.clone();
            map.apply(&c.mean, &mut mean);
            let unexplained = Array2::from_diag(&ArrayView1::from(&c.unexplained));
            Component {
                log_weight: c.log_weight,
                mean,
                covariance: map.apply_covariance(c.covariance.view()),
                unexplained: map.apply_covariance(unexplained.view()).diag().to_vec(),
            }
        };
        let components = self.components.iter().map(carried).collect();
        Box::new(GaussianMixturePrior::of(components, self.answer))
    }
}

/// A kind of Gaussian mixture: its name, how it is read, and how it learns from poses (n, D) with a
/// seed.
pub(crate) struct MixtureKind {
    /// The name in flags and model files.
    pub name: &'static str,
    /// How the Gaussians are used.
    pub style: Style,
    /// The mixture of poses (n, D).
    pub learn: fn(ArrayView2<'_, f32>, u64) -> Result<MixtureParams>,
}

impl MixtureKind {
    /// A kind that averages Gaussians of which every part is estimated.
    pub(crate) const fn new(
        name: &'static str,
        learn: fn(ArrayView2<'_, f32>, u64) -> Result<MixtureParams>,
    ) -> MixtureKind {
        let style = Style {
            answer: Readout::Average,
            estimates_rest: true,
        };
        MixtureKind { name, style, learn }
    }

    fn family(&self, params: MixtureParams) -> PriorFamily {
        let style = self.style;
        Box::new(move |inflation| Box::new(GaussianMixturePrior::new(&params, style, inflation)))
    }

    /// Trains a model: tuned on held-out poses, then learned from all of them.
    ///
    /// # Errors
    /// Data: no poses to learn from.
    pub fn train(
        &self,
        poses: &TrainingSet,
        options: &TrainOptions,
        report: &mut dyn FnMut(&str),
    ) -> Result<Model> {
        let mut model = poses.model(self.name)?;
        let tried =
            |part: &TrainingSet| Ok(self.family((self.learn)(part.xyz.view(), options.seed)?));
        tune(poses, options, &Grid::default(), &tried, report)?.write(&mut model);
        report("learns from all poses");
        (self.learn)(poses.xyz.view(), options.seed)?.write(&mut model);
        Ok(model)
    }

    /// Opens a model of the kind; `source` names it in messages.
    ///
    /// # Errors
    /// Data: arrays that are missing, of the wrong shape or not finite.
    pub fn open(&self, model: &Model, options: &OpenOptions, source: &str) -> Result<TunedPrior> {
        let params = MixtureParams::read(model, source)?;
        TunedPrior::open(model, options, source, &self.family(params))
    }
}

#[cfg(test)]
mod tests {
    use super::mixture_params::three;
    use super::*;
    use crate::numeric::linalg::cholesky_solve;
    use crate::testdata::PriorExt;
    use ndarray::{Array1, Axis, s};
    use std::f64::consts::PI;

    const AVERAGE: Style = Style {
        answer: Readout::Average,
        estimates_rest: true,
    };

    fn prior(style: Style, inflation: f64) -> GaussianMixturePrior {
        GaussianMixturePrior::new(&three(), style, inflation)
    }

    /// log N(r; 0, A) and A⁻¹ b.
    fn solved(a: &Array2<f64>, r: &Array1<f64>, b: &Array1<f64>) -> (f64, Array1<f64>) {
        let solve = |b: &Array1<f64>| cholesky_solve(a.clone(), b.clone()).unwrap();
        let (values, _) = symmetric_eigen(a).unwrap();
        let log_det: f64 = values.iter().map(|v| (2.0 * PI * v).ln()).sum();
        (-0.5 * (r.dot(&solve(r)) + log_det), solve(b))
    }

    /// The equations at the head of this file, with a general solver.
    fn by_the_book(inflation: f64, y: &[f64], noise: &[f64]) -> (Vec<f64>, Array2<f64>, f64) {
        let parts = three();
        let o: Vec<usize> = (0..6).filter(|&c| noise[c].is_finite()).collect();
        let mut each = Vec::new();
        for j in 0..3 {
            let c = parts.covariance(j) * inflation;
            let mean = parts.means.row(j).to_owned();
            let rows = c.select(Axis(0), &o);
            let mut a = rows.select(Axis(1), &o);
            o.iter()
                .enumerate()
                .for_each(|(k, &i)| a[[k, k]] += noise[i]);
            let r: Array1<f64> = o.iter().map(|&i| y[i] - mean[i]).collect();
            let (log, update) = solved(&a, &r, &r);
            let mut left = c.clone();
            for i in 0..6 {
                let gain = solved(&a, &r, &rows.column(i).to_owned()).1;
                left.row_mut(i).scaled_add(-1.0, &gain.dot(&rows));
            }
            each.push((parts.weights[j] * log.exp(), mean + update.dot(&rows), left));
        }
        let total: f64 = each.iter().map(|e| e.0).sum();
        let mut mean = Array1::<f64>::zeros(6);
        each.iter()
            .for_each(|(w, m, _)| mean.scaled_add(w / total, m));
        let mut covariance = Array2::<f64>::zeros((6, 6));
        for (w, m, left) in &each {
            let off = (m - &mean).insert_axis(Axis(0));
            covariance.scaled_add(w / total, &(left + &off.t().dot(&off)));
        }
        (mean.to_vec(), covariance, total.ln())
    }

    #[test]
    fn the_posterior_is_that_of_the_book() {
        let inf = f64::INFINITY;
        let y = [1.0, -2.0, 0.5, 3.0, 0.0, -1.0];
        let noises = [
            [0.5; 6],
            [1.0, inf, 0.3, inf, inf, 2.0],
            [inf, inf, inf, inf, 0.1, inf],
            [inf; 6],
        ];
        for inflation in [1.0, 2.5] {
            let prior = prior(AVERAGE, inflation);
            for noise in &noises {
                let (mean, covariance, evidence) = by_the_book(inflation, &y, noise);
                let update = prior.full(&y, noise);
                let near = |a: f64, b: f64| (a - b).abs() <= 1e-8;
                assert!(update.mean.iter().zip(&mean).all(|(a, b)| near(*a, *b)));
                let mut each = update.covariance.iter().zip(&covariance);
                assert!(each.all(|(a, b)| near(*a, *b)));
                assert!(near(update.log_evidence, evidence));
                let seen = Observation {
                    values: &y,
                    variance: noise,
                };
                assert_eq!(prior.posterior(&seen, Want::Mean).mean, update.mean);
                let posterior = prior.posterior(&seen, Want::Variances);
                let mut each = posterior.variance.iter().zip(covariance.diag());
                assert!(each.all(|(a, b)| near(*a, *b)));
            }
        }
    }

    #[test]
    fn what_is_never_estimated_counts_as_noise_and_stays_the_mean() {
        let prior = prior(
            Style {
                estimates_rest: false,
                ..AVERAGE
            },
            1.0,
        );
        let parts = three();
        // One Gaussian's factors seen through the noise and its rest.
        let alone = MixtureParams {
            weights: vec![1.0],
            means: parts.means.slice(s![..1, ..]).to_owned(),
            factors: parts.factors.slice(s![..2, ..]).to_owned(),
            rest: Array2::zeros((1, 6)),
        };
        let alone = GaussianMixturePrior::new(&alone, AVERAGE, 1.0);
        let noise: Vec<f64> = parts.rest.row(0).iter().map(|r| r + 0.3).collect();
        let y = parts.means.row(0).to_vec();
        let y: Vec<f64> = y.iter().map(|v| v + 0.5).collect();
        let want = alone.full(&y, &noise);
        let one = GaussianMixturePrior {
            components: prior.components[..1].to_vec(),
            conditionals: NoiseCache::default(),
            ..prior
        };
        let got = one.full(&y, &[0.3; 6]);
        for c in 0..6 {
            assert!((got.mean[c] - want.mean[c]).abs() <= 1e-9);
            let variance = want.covariance[[c, c]] + parts.rest[[0, c]];
            assert!((got.covariance[[c, c]] - variance).abs() <= 1e-9);
        }
    }
}
