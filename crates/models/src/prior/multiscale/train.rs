//! Training: clusters by k-means, exemplars, and the weights by EM on held-out poses.
//!
//! The takes are held out in turn, in a few groups. A mixture of the other takes evaluates poses of
//! the held-out takes, and single held-out frames of the others in equal number: the weights must
//! suit both unseen motion and motion like that seen. Each pose is observed twice, with dense noise
//! and as a few exact points. EM then fits the weights of the sub-mixtures and of the
//! factorizations to all evidences, and the final mixture is built from all takes.
//!
//! Cost: (folds + 1) × (k-means of every part and level + K eigendecompositions of (d, d) a level).

use super::MultiscaleMixture;
use super::cluster_level::{ClusterLevel, StoredCovariances};
use super::eigen_covariance::EigenCovariance;
use super::exemplars::ExemplarPoses;
use super::noise_pattern::MIN_NOISE;
use super::novelty::{HeldOutPoses, NoveltyDetector};
use super::part_mixture::PartMixture;
use super::settings::TrainSettings;
use crate::Result;
use crate::cluster::KMeans;
use crate::io::Model;
use crate::numeric::parallel;
use crate::numeric::small_linalg::log_sum;
use crate::pose::{ASF_UNIT_CM, joints};
use crate::prior::representative_poses::representative_poses;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::up_directions;
use ndarray::{Array2, ArrayView2, Axis};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_distr::StandardNormal;
use std::ops::Range;
use std::sync::Arc;

/// Poses to train with, and their takes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TrainingRows<'a> {
    /// (N, 3 J), cm.
    pub xyz: ArrayView2<'a, f32>,
    /// The rows of each take.
    pub takes: &'a [Range<usize>],
}

/// Clusters hold at least this many poses on average.
const POSES_PER_CLUSTER: usize = 20;

/// Trains a mixture.
///
/// # Errors
/// Data: k-means finds the poses unusable.
pub fn train(
    poses: &TrainingSet,
    options: &TrainOptions,
    settings: &TrainSettings,
    report: &mut dyn FnMut(&str),
) -> Result<MultiscaleMixture> {
    let folds = folds(&poses.takes, settings.folds, options.seed);
    let (mut evidences, mut held_out) = (Vec::new(), Vec::new());
    for (fold, held) in folds.iter().enumerate() {
        report(&format!(
            "mixture without held-out takes, {} of {}",
            fold + 1,
            folds.len()
        ));
        let (of_fold, whole) =
            evidences_of_fold(poses, options, settings, held, fold, folds.len())?;
        evidences.extend(of_fold);
        held_out.push(whole);
    }
    report("mixture of all poses");
    let all = TrainingRows {
        xyz: poses.xyz.view(),
        takes: &poses.takes,
    };
    let mut mixture = build(poses, &all, settings, options.seed)?;
    if !evidences.is_empty() {
        let (levels, factorizations) =
            expectation_maximization(&mixture, &evidences, settings.em_steps);
        for (part, levels) in mixture.parts.iter_mut().zip(levels) {
            part.set_log_weights(levels);
        }
        mixture.log_factorization_weights = factorizations;
        mixture.novelty = NoveltyDetector::learn(&held_out, &mixture.parts[0].log_weights());
    }
    Ok(mixture)
}

/// The evidences of held-out poses, of whole takes and of single frames, under a mixture of all
/// others; and that mixture's first part, the whole body, with poses of the held-out takes.
fn evidences_of_fold(
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
    let count = settings.held_out_poses.div_ceil(folds);
    let mut generator = parallel::rng(options.seed, 2 + fold as u64);
    let mut chosen: Vec<usize> = held.iter().flat_map(|t| t.clone()).collect();
    let measured = poses.xyz.select(Axis(0), &HeldOutPoses::spread(&chosen));
    chosen.shuffle(&mut generator);
    chosen.truncate(count);
    let mut frames: Vec<usize> = rest.iter().flat_map(|t| t.clone()).collect();
    frames.shuffle(&mut generator);
    frames.truncate(count.min(frames.len() / 10));
    frames.sort_unstable();
    let (xyz, takes) = rows_of(poses, &rest, &frames);
    let rows = TrainingRows {
        xyz: xyz.view(),
        takes: &takes,
    };
    let mut mixture = build(poses, &rows, settings, options.seed)?;
    chosen.extend(frames);
    let evidences = evidences(&mixture, poses, &chosen, options.seed);
    let whole = mixture.parts.swap_remove(0);
    Ok((evidences, HeldOutPoses::new(whole, measured)))
}

/// Trains a mixture and puts it into a model.
///
/// # Errors
/// Usage: a setting out of range. Data: k-means finds the poses unusable.
pub fn model(
    poses: &TrainingSet,
    options: &TrainOptions,
    settings: &TrainSettings,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    settings.check()?;
    let mixture = train(poses, options, settings, report)?;
    let mut model = poses.model(super::file::KIND)?;
    super::file::write(&mixture, settings, &mut model)?;
    let (rows, _) = kept(&poses.takes, poses.xyz.nrows(), settings.max_exemplars);
    up_directions::write(poses.up.as_ref(), &rows, &mut model);
    Ok(model)
}

/// Draws `count` groups of nearly as many takes each; none if there is a single take.
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

/// A mixture of some poses, with equal weights.
fn build(
    poses: &TrainingSet,
    rows: &TrainingRows<'_>,
    settings: &TrainSettings,
    seed: u64,
) -> Result<MultiscaleMixture> {
    let body = joints::body_parts(&poses.points);
    let kept = KeptExemplars::of(rows, settings.max_exemplars);
    let parts = body.parts.into_iter();
    let parts = parts.map(|coordinates| part(coordinates, rows, &kept, settings, seed));
    let parts: Vec<PartMixture> = parts.collect::<Result<_>>()?;
    let equal = -(body.factorizations.len() as f64).ln();
    Ok(MultiscaleMixture {
        log_factorization_weights: vec![equal; body.factorizations.len()],
        factorizations: body.factorizations,
        temperature: settings.temperature,
        representative_poses: representative_poses(rows.xyz)?.mapv(f64::from),
        ..MultiscaleMixture::of_parts(parts, kept.poses)
    })
}

/// The training poses that are exemplars.
struct KeptExemplars {
    rows: Vec<usize>,
    poses: Arc<ExemplarPoses>,
}

impl KeptExemplars {
    fn of(rows: &TrainingRows<'_>, most: usize) -> KeptExemplars {
        let (kept, takes) = kept(rows.takes, rows.xyz.nrows(), most);
        let xyz = rows.xyz.select(Axis(0), &kept);
        KeptExemplars {
            rows: kept,
            poses: Arc::new(ExemplarPoses::new(xyz, takes)),
        }
    }
}

/// The rows of `takes` that are exemplars, at most about `most` of `count`, evenly spaced; and
/// where each take is among them.
fn kept(takes: &[Range<usize>], count: usize, most: usize) -> (Vec<usize>, Vec<Range<usize>>) {
    let stride = count.div_ceil(most.max(1)).max(1);
    let (mut rows, mut ranges) = (Vec::new(), Vec::new());
    for take in takes {
        let start = rows.len();
        rows.extend(take.clone().step_by(stride));
        ranges.push(start..rows.len());
    }
    (rows, ranges)
}

fn part(
    coordinates: Vec<usize>,
    rows: &TrainingRows<'_>,
    kept: &KeptExemplars,
    settings: &TrainSettings,
    seed: u64,
) -> Result<PartMixture> {
    let xyz = rows.xyz.select(Axis(1), &coordinates);
    let mut levels = Vec::new();
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
        let found = kmeans.fit_at_most(xyz.view(), &mut |_| ())?;
        let k = found.sizes.len();
        labels = found.labels.iter().map(|l| *l as usize).collect();
        levels.push(cluster_level(rows.xyz, &coordinates, &labels, k, settings));
    }
    let sub_mixtures = settings.sub_mixtures(levels.len());
    let labels: Vec<u32> = kept.rows.iter().map(|&row| labels[row] as u32).collect();
    Ok(PartMixture::new(
        coordinates,
        levels,
        kept.poses.clone(),
        &labels,
        sub_mixtures,
    ))
}

/// k clusters of the poses (N, 3 J), whose labels are given: means, and covariances shrunk toward
/// the pooled one.
fn cluster_level(
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
        let centered = &rows.select(Axis(1), coordinates) - &mean;
        (whole.to_vec(), centered.t().dot(&centered))
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
    let covariances =
        parallel::map_chunks(k, 1, |c| EigenCovariance::of(covariances[c.start].view()));
    let log_proportion = |n: usize| (n.max(1) as f64 / m as f64).ln();
    let log_proportions: Vec<f64> = members.iter().map(|r| log_proportion(r.len())).collect();
    let stored = StoredCovariances::of(&covariances, d);
    let within = stored.mean_variances(&log_proportions);
    ClusterLevel::new(
        full_means,
        log_proportions,
        stored.into(),
        within,
        coordinates,
    )
}

/// The log weights of the sub-mixtures, by part, and of the factorizations.
type LogWeights = (Vec<Vec<f64>>, Vec<f64>);

/// One observation's log evidence of each sub-mixture, by part.
type SubMixtureEvidences = Vec<Vec<f64>>;

/// The evidences of some poses, each observed as the two tasks show it.
fn evidences(
    mixture: &MultiscaleMixture,
    poses: &TrainingSet,
    chosen: &[usize],
    seed: u64,
) -> Vec<SubMixtureEvidences> {
    let one = |i: usize, task: u64| -> SubMixtureEvidences {
        let (y, noise) = observe(poses, chosen[i], task, seed, i);
        let candidates = mixture
            .evaluate_above(&y, &noise, 0.0)
            .candidates
            .into_iter();
        candidates.map(|c| c.sub_mixture_evidences).collect()
    };
    let both = (0..2u64).flat_map(|task| {
        parallel::map_chunks(chosen.len(), 4, |range| {
            range.map(|i| one(i, task)).collect::<Vec<_>>()
        })
    });
    both.flatten().collect()
}

/// A pose as a task shows it, with the noise variances, cm²: task 0 adds dense noise of one asf
/// unit, task 1 shows few points exactly.
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
    let shown = joints::few_observed(&poses.points);
    let noise = (0..pose.len())
        .map(|c| {
            if shown[c / 3] {
                MIN_NOISE
            } else {
                f64::INFINITY
            }
        })
        .collect();
    (pose, noise)
}

/// Poses counted for every sub-mixture and factorization before any is seen: no weight becomes 0.
const PSEUDO_COUNT: f64 = 1.0;

fn expectation_maximization(
    mixture: &MultiscaleMixture,
    poses: &[SubMixtureEvidences],
    steps: usize,
) -> LogWeights {
    let mut levels: Vec<Vec<f64>> = mixture.parts.iter().map(PartMixture::log_weights).collect();
    let mut factorizations = mixture.log_factorization_weights.clone();
    for _ in 0..steps {
        let counts = levels.iter().map(|l| vec![PSEUDO_COUNT; l.len()]);
        let mut level_counts: Vec<Vec<f64>> = counts.collect();
        let mut factorization_counts = vec![PSEUDO_COUNT; factorizations.len()];
        for pose in poses {
            // log (weight × evidence) of each sub-mixture, and of each part.
            let weighted = |(evidences, weights): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
                evidences.iter().zip(weights).map(|(e, w)| e + w).collect()
            };
            let each: Vec<Vec<f64>> = pose.iter().zip(&levels).map(weighted).collect();
            let parts: Vec<f64> = each.iter().map(|e| log_sum(e)).collect();
            let logs = mixture.factorizations.iter().zip(&factorizations);
            let logs: Vec<f64> = logs
                .map(|(parts_of, log)| log + parts_of.iter().map(|&p| parts[p]).sum::<f64>())
                .collect();
            let all = log_sum(&logs);
            for (f, parts_of) in mixture.factorizations.iter().enumerate() {
                let responsibility = (logs[f] - all).exp();
                factorization_counts[f] += responsibility;
                for &p in parts_of {
                    for (count, e) in level_counts[p].iter_mut().zip(&each[p]) {
                        *count += responsibility * (e - parts[p]).exp();
                    }
                }
            }
        }
        factorizations = logs_of(&factorization_counts);
        levels = level_counts.iter().map(|c| logs_of(c)).collect();
    }
    (levels, factorizations)
}

/// The logs of the counts' proportions.
fn logs_of(counts: &[f64]) -> Vec<f64> {
    let total: f64 = counts.iter().sum();
    counts.iter().map(|c| (c / total).ln()).collect()
}
