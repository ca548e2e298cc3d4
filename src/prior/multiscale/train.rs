//! Learning the blocks, and the weights of their levels.

use super::body_parts::parts;
use super::cluster_level::ClusterLevel;
use super::eigen_covariance::EigenCovariance;
use super::exemplars::ExemplarPoses;
use super::novelty::{HeldOutPoses, NoveltyDetector};
use super::part_mixture::{PartMixture, SubMixture};
use super::scaled_precision::MAX_EXEMPLAR_SCALES;
use super::{MIN_NOISE, MultiscaleMixture};
use crate::cluster::KMeans;
use crate::io::Model;
use crate::numeric::parallel;
use crate::numeric::small_linalg::log_sum;
use crate::pose::ASF_UNIT_CM;
use crate::prior::representative_poses::representative_poses;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::{Error, Result};
use ndarray::{Array2, ArrayView2, Axis};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// How blocks are learnt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainSettings {
    /// How many cells each level has, rising.
    #[serde(alias = "cells")]
    pub clusters: Vec<usize>,
    /// The scales of the cells' covariances.
    pub scales: Vec<f64>,
    /// The scales of the leaves' covariances, and how far they reach along their steps.
    #[serde(alias = "leaves")]
    pub exemplars: Vec<(f64, f64)>,
    /// The share of a cell's own covariance; the rest is the level's.
    #[serde(alias = "own")]
    pub own_share: f64,
    /// Added to every variance, cm².
    #[serde(alias = "least")]
    pub min_variance: f64,
    /// What the log evidences of the ways to make a body are multiplied by where they are averaged.
    pub temperature: f64,
    /// Steps of EM.
    #[serde(alias = "steps")]
    pub em_steps: usize,
    /// Held-back poses that the weights are learnt from, for each observation.
    #[serde(alias = "tested")]
    pub held_out_poses: usize,
    /// At most so many training poses are leaves: of more, every second (third, ...) of each take.
    #[serde(alias = "leaves_kept")]
    pub max_exemplars: usize,
    /// Takes are held back in turn, in so many groups.
    pub folds: usize,
}

impl Default for TrainSettings {
    fn default() -> Self {
        TrainSettings {
            clusters: vec![1, 5, 20, 80, 300],
            scales: vec![1.0, 2.5, 6.0, 15.0],
            exemplars: vec![(0.3, 0.0), (0.03, 0.0), (0.03, 1.0), (0.001, 1.0)],
            own_share: 0.8,
            min_variance: 1e-4 * ASF_UNIT_CM * ASF_UNIT_CM,
            temperature: 0.3,
            em_steps: 60,
            max_exemplars: 80_000,
            held_out_poses: 400,
            folds: 4,
        }
    }
}

impl TrainSettings {
    /// Refuses what nothing can be learnt with.
    pub fn check(&self) -> Result<()> {
        let positive = |list: &[f64]| list.iter().all(|s| s.is_finite() && *s > 0.0);
        let step_scale = self.exemplars.iter().all(|l| l.1.is_finite() && l.1 >= 0.0);
        let scales: Vec<f64> = self.exemplars.iter().map(|l| l.0).collect();
        let rising = self.clusters.windows(2).all(|w| w[0] < w[1]);
        if self.clusters.is_empty()
            || self.max_exemplars == 0
            || self.clusters[0] == 0
            || !rising
            || self.scales.is_empty()
        {
            return Err(Error::usage(
                "multiscale: clusters must be given, at least 1 and rising, scales, and at least 1 exemplar",
            ));
        }
        if !positive(&self.scales)
            || !positive(&scales)
            || !step_scale
            || !positive(&[self.min_variance, self.temperature])
        {
            return Err(Error::usage(
                "multiscale: scales, min_variance and temperature must be above 0",
            ));
        }
        if self.exemplars.len() > MAX_EXEMPLAR_SCALES {
            return Err(Error::usage(format!(
                "multiscale: exemplars at {} scales, at most {MAX_EXEMPLAR_SCALES} are possible",
                self.exemplars.len()
            )));
        }
        if !(0.0..=1.0).contains(&self.own_share) || self.folds == 0 {
            return Err(Error::usage(
                "multiscale: own_share must be from 0 to 1, folds at least 1",
            ));
        }
        Ok(())
    }

    /// The levels of a part that has so many levels of cells.
    pub(super) fn levels(&self, clusters: usize) -> Vec<SubMixture> {
        let of_cells = (0..clusters).flat_map(|index| {
            self.scales
                .iter()
                .map(move |&scale| SubMixture::Clusters { index, scale })
        });
        let exemplar_sub_mixtures = self
            .exemplars
            .iter()
            .map(|&(scale, step_scale)| SubMixture::Exemplars { scale, step_scale });
        of_cells.chain(exemplar_sub_mixtures).collect()
    }
}

/// Poses to learn from, and their takes.
#[derive(Debug, Clone, Copy)]
pub struct TrainingRows<'a> {
    /// (N, 3 J), cm.
    pub xyz: ArrayView2<'a, f32>,
    /// The rows of each take.
    pub takes: &'a [Range<usize>],
}

/// Cells hold at least so many poses on average.
const POSES_PER_CLUSTER: usize = 20;

/// Learns from training poses: weights first, from takes held back in turn, then the blocks from all of them.
pub fn train(
    poses: &TrainingSet,
    options: &TrainOptions,
    settings: &TrainSettings,
    report: &mut dyn FnMut(&str),
) -> Result<MultiscaleMixture> {
    let folds = folds(&poses.takes, settings.folds, options.seed);
    let (mut evidences_of_poses, mut add_spread_of_means) = (Vec::new(), Vec::new());
    for (fold, held) in folds.iter().enumerate() {
        report(&format!(
            "mixture without held-out takes, {} of {}",
            fold + 1,
            folds.len()
        ));
        let (evidences, whole) =
            evidence_of_fold(poses, options, settings, held, fold, folds.len())?;
        evidences_of_poses.extend(evidences);
        add_spread_of_means.push(whole);
    }
    report("mixture of all poses");
    let all = TrainingRows {
        xyz: poses.xyz.view(),
        takes: &poses.takes,
    };
    let mut mixture = build(poses, &all, settings, options.seed)?;
    if !evidences_of_poses.is_empty() {
        let (levels, factorizations) =
            expectation_maximisation(&mixture, &evidences_of_poses, settings.em_steps);
        for (part, levels) in mixture.parts.iter_mut().zip(levels) {
            part.set_log_weights(levels);
        }
        mixture.log_factorization_weights = factorizations;
        mixture.limit = NoveltyDetector::learn(&add_spread_of_means, &mixture.parts[0].log_weights);
    }
    Ok(mixture)
}

/// The evidences of poses whose takes were held back, and of single frames that were, in equal numbers: the weights must
/// do for movements never seen and for those seen nearly. And the whole body learnt without those takes, with their poses.
fn evidence_of_fold(
    poses: &TrainingSet,
    options: &TrainOptions,
    settings: &TrainSettings,
    held: &[Range<usize>],
    fold: usize,
    folds: usize,
) -> Result<(Vec<SubMixtureEvidences>, HeldOutPoses)> {
    let rest: Vec<Range<usize>> = (poses.takes.iter())
        .filter(|t| !held.contains(t))
        .cloned()
        .collect();
    let held_out_poses = settings.held_out_poses.div_ceil(folds);
    let mut generator = parallel::rng(options.seed, 2 + fold as u64);
    let mut chosen: Vec<usize> = held.iter().flat_map(|t| t.clone()).collect();
    let measured = poses.xyz.select(Axis(0), &HeldOutPoses::spread(&chosen));
    chosen.shuffle(&mut generator);
    chosen.truncate(held_out_poses);
    let mut frames: Vec<usize> = rest.iter().flat_map(|t| t.clone()).collect();
    frames.shuffle(&mut generator);
    frames.truncate(held_out_poses.min(frames.len() / 10));
    frames.sort_unstable();
    let (xyz, takes) = rows_of(poses, &rest, &frames);
    let material = TrainingRows {
        xyz: xyz.view(),
        takes: &takes,
    };
    let mut mixture = build(poses, &material, settings, options.seed)?;
    chosen.extend(frames);
    let evidences_of_poses = evidences(&mixture, poses, &chosen, options.seed);
    Ok((
        evidences_of_poses,
        HeldOutPoses::new(mixture.parts.swap_remove(0), measured),
    ))
}

/// Trains and gives the model's file.
pub fn model(
    poses: &TrainingSet,
    options: &TrainOptions,
    settings: &TrainSettings,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    settings.check()?;
    let mixture = train(poses, options, settings, report)?;
    let mut model = poses.model("multiscale")?;
    super::file::write(&mixture, settings, &mut model)?;
    Ok(model)
}

/// Parts the takes in so many groups of nearly as many each, drawn by the seed; none where there is but one take.
fn folds(takes: &[Range<usize>], count: usize, seed: u64) -> Vec<Vec<Range<usize>>> {
    if takes.len() < 2 {
        return Vec::new();
    }
    let mut order: Vec<usize> = (0..takes.len()).collect();
    order.shuffle(&mut parallel::rng(seed, 1));
    let count = count.min(takes.len());
    (0..count)
        .map(|fold| {
            let mut held: Vec<usize> = order.iter().copied().skip(fold).step_by(count).collect();
            held.sort_unstable();
            held.into_iter().map(|t| takes[t].clone()).collect()
        })
        .collect()
}

/// The rows of some takes without those `left_out` (rising), and where each take is among them.
fn rows_of(
    poses: &TrainingSet,
    takes: &[Range<usize>],
    left_out: &[usize],
) -> (Array2<f32>, Vec<Range<usize>>) {
    let mut rows = Vec::new();
    let mut ranges = Vec::new();
    for take in takes {
        let start = rows.len();
        rows.extend(take.clone().filter(|r| left_out.binary_search(r).is_err()));
        ranges.push(start..rows.len());
    }
    (poses.xyz.select(Axis(0), &rows), ranges)
}

fn build(
    poses: &TrainingSet,
    material: &TrainingRows<'_>,
    settings: &TrainSettings,
    seed: u64,
) -> Result<MultiscaleMixture> {
    let (parts, factorizations) = parts(&poses.points);
    let kept = KeptExemplars::of(material, settings.max_exemplars);
    let parts: Vec<PartMixture> = parts
        .into_iter()
        .map(|coordinates| part(coordinates, material, &kept, settings, seed))
        .collect::<Result<_>>()?;
    Ok(MultiscaleMixture {
        width: material.xyz.ncols(),
        log_factorization_weights: vec![-(factorizations.len() as f64).ln(); factorizations.len()],
        factorizations,
        variance: variance_of(&parts[0]),
        conditioned_cache: super::empty_caches(parts.len()),
        isotropic: super::empty_caches(parts.len()),
        parts,
        poses: kept.poses,
        temperature: settings.temperature,
        typical: representative_poses(material.xyz)?.mapv(f64::from),
        limit: NoveltyDetector::default(),
    })
}

/// The mean variance of each coordinate within the finest cells of the whole.
pub fn variance_of(whole: &PartMixture) -> Vec<f64> {
    whole.finest().within.clone()
}

/// The training poses that are leaves.
struct KeptExemplars {
    rows: Vec<usize>,
    poses: Arc<ExemplarPoses>,
}

impl KeptExemplars {
    fn of(material: &TrainingRows<'_>, most: usize) -> KeptExemplars {
        let stride = material.xyz.nrows().div_ceil(most.max(1)).max(1);
        let (mut rows, mut takes) = (Vec::new(), Vec::new());
        for take in material.takes {
            let start = rows.len();
            rows.extend(take.clone().step_by(stride));
            takes.push(start..rows.len());
        }
        let xyz = material.xyz.select(Axis(0), &rows);
        KeptExemplars {
            rows,
            poses: Arc::new(ExemplarPoses::new(xyz.into(), takes)),
        }
    }
}

fn part(
    coordinates: Vec<usize>,
    material: &TrainingRows<'_>,
    kept: &KeptExemplars,
    settings: &TrainSettings,
    seed: u64,
) -> Result<PartMixture> {
    let xyz = material.xyz.select(Axis(1), &coordinates);
    let mut clusters = Vec::new();
    let mut labels = Vec::new();
    for &k in &settings.clusters {
        let k = k.min(xyz.nrows() / POSES_PER_CLUSTER).max(1);
        let kmeans = KMeans {
            k,
            seed,
            restarts: 1,
            max_iterations: 20,
            ..KMeans::default()
        };
        let candidates = kmeans.fit_at_most(xyz.view(), &mut |_| ())?;
        let k = candidates.sizes.len();
        labels = candidates.labels.iter().map(|l| *l as usize).collect();
        clusters.push(cells_of(material.xyz, &coordinates, &labels, k, settings));
    }
    let levels = settings.levels(clusters.len());
    let labels = kept.rows.iter().map(|&row| labels[row] as u32);
    let labels: Vec<u32> = labels.collect();
    let poses = kept.poses.clone();
    Ok(PartMixture::new(
        coordinates,
        clusters,
        poses,
        &labels,
        levels,
    ))
}

fn cells_of(
    xyz: ArrayView2<'_, f32>,
    coordinates: &[usize],
    labels: &[usize],
    k: usize,
    settings: &TrainSettings,
) -> ClusterLevel {
    let (m, d) = (xyz.nrows(), coordinates.len());
    let mut members = vec![Vec::new(); k];
    labels
        .iter()
        .enumerate()
        .for_each(|(i, &l)| members[l].push(i));
    let own: Vec<(Vec<f64>, Array2<f64>)> = parallel::map_chunks(k, 1, |c| {
        let rows = xyz.select(Axis(0), &members[c.start]).mapv(f64::from);
        let whole = rows.sum_axis(Axis(0)) / rows.nrows().max(1) as f64;
        let mean = whole.select(Axis(0), coordinates);
        let centred = &rows.select(Axis(1), coordinates) - &mean;
        (whole.to_vec(), centred.t().dot(&centred))
    });
    let mut pooled = Array2::<f64>::zeros((d, d));
    own.iter().for_each(|(_, c)| pooled += c);
    pooled /= m as f64;
    let mut full_means = Array2::zeros((k, xyz.ncols()));
    let mut covariances = Vec::with_capacity(k);
    for (i, (mean, scatter)) in own.into_iter().enumerate() {
        full_means
            .row_mut(i)
            .iter_mut()
            .zip(mean)
            .for_each(|(a, b)| *a = b);
        let n = members[i].len().max(1) as f64;
        let mut c = scatter * (settings.own_share / n) + &pooled * (1.0 - settings.own_share);
        c.diag_mut().mapv_inplace(|v| v + settings.min_variance);
        covariances.push(c);
    }
    let bases = parallel::map_chunks(k, 1, |c| EigenCovariance::of(covariances[c.start].view()));
    let share = |n: usize| (n.max(1) as f64 / m as f64).ln();
    let shares = members.iter().map(|r| share(r.len())).collect();
    ClusterLevel::new(full_means, shares, bases, coordinates)
}

/// The weights of levels (by part) and of ways, as logs.
type LogWeights = (Vec<Vec<f64>>, Vec<f64>);

/// One observation's log evidence of each level, by part.
type SubMixtureEvidences = Vec<Vec<f64>>;

/// What blocks make of held-back poses, seen as each task shows them.
fn evidences(
    mixture: &MultiscaleMixture,
    poses: &TrainingSet,
    chosen: &[usize],
    seed: u64,
) -> Vec<SubMixtureEvidences> {
    let one = |i: usize, task: u64| {
        let (y, noise) = observe(poses, chosen[i], task, seed, i);
        let evidences_of_poses = mixture.evaluate_parts_above(&y, &noise, 0.0).candidates;
        evidences_of_poses
            .into_iter()
            .map(|e| e.levels)
            .collect::<SubMixtureEvidences>()
    };
    let both = (0..2u64).flat_map(|task| {
        parallel::map_chunks(chosen.len(), 4, |range| {
            range.map(|i| one(i, task)).collect::<Vec<_>>()
        })
    });
    both.flatten().collect()
}

fn observe(
    poses: &TrainingSet,
    row: usize,
    task: u64,
    seed: u64,
    i: usize,
) -> (Vec<f64>, Vec<f64>) {
    let pose: Vec<f64> = poses.xyz.row(row).iter().map(|v| f64::from(*v)).collect();
    if task == 0 {
        let mut generator = parallel::rng(seed, 1000 + i as u64);
        let y = pose
            .iter()
            .map(|v| v + ASF_UNIT_CM * generator.sample::<f64, _>(StandardNormal))
            .collect();
        return (y, vec![ASF_UNIT_CM * ASF_UNIT_CM; pose.len()]);
    }
    let six = crate::pose::joints::PAPER_SIX;
    let known = |p: usize| six.contains(&poses.points[p].as_str());
    let noise = (0..pose.len())
        .map(|c| {
            if known(c / 3) {
                MIN_NOISE
            } else {
                f64::INFINITY
            }
        })
        .collect();
    (pose, noise)
}

/// So many poses are counted for every level and way before any is seen: none is ever ruled out.
const PSEUDO_COUNT: f64 = 1.0;

fn expectation_maximisation(
    mixture: &MultiscaleMixture,
    evidences_of_poses: &[SubMixtureEvidences],
    steps: usize,
) -> LogWeights {
    let mut levels: Vec<Vec<f64>> = mixture
        .parts
        .iter()
        .map(|p| p.log_weights.clone())
        .collect();
    let mut factorizations = mixture.log_factorization_weights.clone();
    for _ in 0..steps {
        let mut level_counts: Vec<Vec<f64>> =
            levels.iter().map(|l| vec![PSEUDO_COUNT; l.len()]).collect();
        let mut way_counts = vec![PSEUDO_COUNT; factorizations.len()];
        for pose in evidences_of_poses {
            let each: Vec<Vec<f64>> = pose
                .iter()
                .zip(&levels)
                .map(|(e, w)| e.iter().zip(w).map(|(e, w)| e + w).collect())
                .collect();
            let parts: Vec<f64> = each.iter().map(|e| log_sum(e)).collect();
            let log_evidences: Vec<f64> = mixture
                .factorizations
                .iter()
                .zip(&factorizations)
                .map(|(factorization, log)| {
                    log + factorization.iter().map(|&p| parts[p]).sum::<f64>()
                })
                .collect();
            let all = log_sum(&log_evidences);
            for (f, factorization) in mixture.factorizations.iter().enumerate() {
                let r = (log_evidences[f] - all).exp();
                way_counts[f] += r;
                for &p in factorization {
                    for (count, e) in level_counts[p].iter_mut().zip(&each[p]) {
                        *count += r * (e - parts[p]).exp();
                    }
                }
            }
        }
        factorizations = logs_of(&way_counts);
        levels = level_counts.iter().map(|c| logs_of(c)).collect();
    }
    (levels, factorizations)
}

fn logs_of(counts: &[f64]) -> Vec<f64> {
    let total: f64 = counts.iter().sum();
    counts.iter().map(|c| (c / total).ln()).collect()
}
