//! Learning the blocks, and the weights of their levels.

use super::basis::Basis;
use super::cells::Cells;
use super::leaves::Poses;
use super::limit::{HeldBack, Limit};
use super::part::{Level, Part};
use super::parts::parts;
use super::scales::MOST_LEAVES;
use super::{Blocks, FLOOR};
use crate::cluster::{self, Parameters};
use crate::io::Model;
use crate::numeric::parallel;
use crate::numeric::small_linalg::log_sum;
use crate::pose::ASF_UNIT_CM;
use crate::prior::train::Training;
use crate::prior::training::{TrainingPoses, typical};
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
pub struct Settings {
    /// How many cells each level has, rising.
    pub cells: Vec<usize>,
    /// The scales of the cells' covariances.
    pub scales: Vec<f64>,
    /// The scales of the leaves' covariances, and how far they reach along their steps.
    pub leaves: Vec<(f64, f64)>,
    /// The share of a cell's own covariance; the rest is the level's.
    pub own: f64,
    /// Added to every variance, cm².
    pub least: f64,
    /// What the log evidences of the ways to make a body are multiplied by where they are averaged.
    pub temperature: f64,
    /// Steps of EM.
    pub steps: usize,
    /// Held-back poses that the weights are learnt from, for each observation.
    pub tested: usize,
    /// At most so many training poses are leaves: of more, every second (third, ...) of each take.
    pub leaves_kept: usize,
    /// Takes are held back in turn, in so many groups.
    pub folds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            cells: vec![1, 5, 20, 80, 300],
            scales: vec![1.0, 2.5, 6.0, 15.0],
            leaves: vec![(0.3, 0.0), (0.03, 0.0), (0.03, 1.0), (0.001, 1.0)],
            own: 0.8,
            least: 1e-4 * ASF_UNIT_CM * ASF_UNIT_CM,
            temperature: 0.3,
            steps: 60,
            leaves_kept: 80_000,
            tested: 400,
            folds: 4,
        }
    }
}

impl Settings {
    /// Refuses what nothing can be learnt with.
    pub fn check(&self) -> Result<()> {
        let positive = |list: &[f64]| list.iter().all(|s| s.is_finite() && *s > 0.0);
        let along = self.leaves.iter().all(|l| l.1.is_finite() && l.1 >= 0.0);
        let scales: Vec<f64> = self.leaves.iter().map(|l| l.0).collect();
        let rising = self.cells.windows(2).all(|w| w[0] < w[1]);
        if self.cells.is_empty()
            || self.leaves_kept == 0
            || self.cells[0] == 0
            || !rising
            || self.scales.is_empty()
        {
            return Err(Error::usage(
                "blocks: cells must be given, at least 1 and rising, scales, and at least 1 leaf",
            ));
        }
        if !positive(&self.scales)
            || !positive(&scales)
            || !along
            || !positive(&[self.least, self.temperature])
        {
            return Err(Error::usage(
                "blocks: scales, least and temperature must be above 0",
            ));
        }
        if self.leaves.len() > MOST_LEAVES {
            return Err(Error::usage(format!(
                "blocks: leaves of {} kinds, at most {MOST_LEAVES} can be looked at",
                self.leaves.len()
            )));
        }
        if !(0.0..=1.0).contains(&self.own) || self.folds == 0 {
            return Err(Error::usage(
                "blocks: own must be from 0 to 1, folds at least 1",
            ));
        }
        Ok(())
    }

    /// The levels of a part that has so many levels of cells.
    pub(super) fn levels(&self, cells: usize) -> Vec<Level> {
        let of_cells = (0..cells).flat_map(|index| {
            self.scales
                .iter()
                .map(move |&scale| Level::Cells { index, scale })
        });
        let of_leaves = self
            .leaves
            .iter()
            .map(|&(scale, along)| Level::Leaves { scale, along });
        of_cells.chain(of_leaves).collect()
    }
}

/// Poses to learn from, and their takes.
#[derive(Debug, Clone, Copy)]
pub struct Material<'a> {
    /// (N, 3 J), cm.
    pub xyz: ArrayView2<'a, f32>,
    /// The rows of each take.
    pub takes: &'a [Range<usize>],
}

/// Cells hold at least so many poses on average.
const POSES_A_CELL: usize = 20;

/// Learns from training poses: weights first, from takes held back in turn, then the blocks from all of them.
pub fn train(
    training: &Training<'_>,
    settings: &Settings,
    report: &mut dyn FnMut(&str),
) -> Result<Blocks> {
    let poses = training.poses;
    let folds = folds(&poses.takes, settings.folds, training.seed);
    let (mut seen, mut apart) = (Vec::new(), Vec::new());
    for (fold, held) in folds.iter().enumerate() {
        report(&format!(
            "blocks without takes held back, {} of {}",
            fold + 1,
            folds.len()
        ));
        let (evidences, whole) = evidence_of_fold(training, settings, held, fold, folds.len())?;
        seen.extend(evidences);
        apart.push(whole);
    }
    report("blocks of all poses");
    let all = Material {
        xyz: poses.xyz.view(),
        takes: &poses.takes,
    };
    let mut blocks = build(poses, &all, settings, training.seed)?;
    if !seen.is_empty() {
        let (levels, ways) = expectation_maximisation(&blocks, &seen, settings.steps);
        for (part, levels) in blocks.parts.iter_mut().zip(levels) {
            part.weigh(levels);
        }
        blocks.log_ways = ways;
        blocks.limit = Limit::learn(&apart, &blocks.parts[0].log_weights);
    }
    Ok(blocks)
}

/// The evidences of poses whose takes were held back, and of single frames that were, in equal numbers: the weights must
/// do for movements never seen and for those seen nearly. And the whole body learnt without those takes, with their poses.
fn evidence_of_fold(
    training: &Training<'_>,
    settings: &Settings,
    held: &[Range<usize>],
    fold: usize,
    folds: usize,
) -> Result<(Vec<Evidences>, HeldBack)> {
    let poses = training.poses;
    let rest: Vec<Range<usize>> = (poses.takes.iter())
        .filter(|t| !held.contains(t))
        .cloned()
        .collect();
    let tested = settings.tested.div_ceil(folds);
    let mut generator = parallel::rng(training.seed, 2 + fold as u64);
    let mut chosen: Vec<usize> = held.iter().flat_map(|t| t.clone()).collect();
    let measured = poses.xyz.select(Axis(0), &HeldBack::spread(&chosen));
    chosen.shuffle(&mut generator);
    chosen.truncate(tested);
    let mut frames: Vec<usize> = rest.iter().flat_map(|t| t.clone()).collect();
    frames.shuffle(&mut generator);
    frames.truncate(tested.min(frames.len() / 10));
    frames.sort_unstable();
    let (xyz, takes) = rows_of(poses, &rest, &frames);
    let material = Material {
        xyz: xyz.view(),
        takes: &takes,
    };
    let mut blocks = build(poses, &material, settings, training.seed)?;
    chosen.extend(frames);
    let seen = evidences(&blocks, poses, &chosen, training.seed);
    Ok((seen, HeldBack::new(blocks.parts.swap_remove(0), measured)))
}

/// Trains and gives the model's file.
pub fn model(
    training: &Training<'_>,
    settings: &Settings,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    settings.check()?;
    let blocks = train(training, settings, report)?;
    let mut model = training.model("blocks")?;
    super::file::write(&blocks, settings, &mut model)?;
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
    poses: &TrainingPoses,
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
    poses: &TrainingPoses,
    material: &Material<'_>,
    settings: &Settings,
    seed: u64,
) -> Result<Blocks> {
    let (parts, ways) = parts(&poses.points);
    let kept = Kept::of(material, settings.leaves_kept);
    let parts: Vec<Part> = parts
        .into_iter()
        .map(|coordinates| part(coordinates, material, &kept, settings, seed))
        .collect::<Result<_>>()?;
    Ok(Blocks {
        width: material.xyz.ncols(),
        log_ways: vec![-(ways.len() as f64).ln(); ways.len()],
        ways,
        variance: variance_of(&parts[0]),
        met: super::unmet(parts.len()),
        even: super::unmet(parts.len()),
        parts,
        poses: kept.poses,
        temperature: settings.temperature,
        typical: typical(material.xyz)?.mapv(f64::from),
        limit: Limit::default(),
    })
}

/// The mean variance of each coordinate within the finest cells of the whole.
pub fn variance_of(whole: &Part) -> Vec<f64> {
    whole.finest().within.clone()
}

/// The training poses that are leaves.
struct Kept {
    rows: Vec<usize>,
    poses: Arc<Poses>,
}

impl Kept {
    fn of(material: &Material<'_>, most: usize) -> Kept {
        let stride = material.xyz.nrows().div_ceil(most.max(1)).max(1);
        let (mut rows, mut takes) = (Vec::new(), Vec::new());
        for take in material.takes {
            let start = rows.len();
            rows.extend(take.clone().step_by(stride));
            takes.push(start..rows.len());
        }
        let xyz = material.xyz.select(Axis(0), &rows);
        Kept {
            rows,
            poses: Arc::new(Poses::new(xyz.into(), takes)),
        }
    }
}

fn part(
    coordinates: Vec<usize>,
    material: &Material<'_>,
    kept: &Kept,
    settings: &Settings,
    seed: u64,
) -> Result<Part> {
    let xyz = material.xyz.select(Axis(1), &coordinates);
    let mut cells = Vec::new();
    let mut labels = Vec::new();
    for &k in &settings.cells {
        let k = k.min(xyz.nrows() / POSES_A_CELL).max(1);
        let parameters = Parameters {
            k,
            seed,
            restarts: 1,
            max_iterations: 20,
            ..Parameters::default()
        };
        let found = cluster::fit_at_most(xyz.view(), &parameters, &mut |_| ())?;
        let k = found.sizes.len();
        labels = found.labels.iter().map(|l| *l as usize).collect();
        cells.push(cells_of(material.xyz, &coordinates, &labels, k, settings));
    }
    let levels = settings.levels(cells.len());
    let labels = kept.rows.iter().map(|&row| labels[row] as u32);
    let labels: Vec<u32> = labels.collect();
    let poses = kept.poses.clone();
    Ok(Part::new(coordinates, cells, poses, &labels, levels))
}

fn cells_of(
    xyz: ArrayView2<'_, f32>,
    coordinates: &[usize],
    labels: &[usize],
    k: usize,
    settings: &Settings,
) -> Cells {
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
    let mut wholes = Array2::zeros((k, xyz.ncols()));
    let mut covariances = Vec::with_capacity(k);
    for (i, (mean, scatter)) in own.into_iter().enumerate() {
        wholes
            .row_mut(i)
            .iter_mut()
            .zip(mean)
            .for_each(|(a, b)| *a = b);
        let n = members[i].len().max(1) as f64;
        let mut c = scatter * (settings.own / n) + &pooled * (1.0 - settings.own);
        c.diag_mut().mapv_inplace(|v| v + settings.least);
        covariances.push(c);
    }
    let bases = parallel::map_chunks(k, 1, |c| Basis::of(covariances[c.start].view()));
    let share = |n: usize| (n.max(1) as f64 / m as f64).ln();
    let shares = members.iter().map(|r| share(r.len())).collect();
    Cells::new(wholes, shares, bases, coordinates)
}

/// The weights of levels (by part) and of ways, as logs.
type Weights = (Vec<Vec<f64>>, Vec<f64>);

/// One observation's log evidence of each level, by part.
type Evidences = Vec<Vec<f64>>;

/// What blocks make of held-back poses, seen as each task shows them.
fn evidences(
    blocks: &Blocks,
    poses: &TrainingPoses,
    chosen: &[usize],
    seed: u64,
) -> Vec<Evidences> {
    let one = |i: usize, task: u64| {
        let (y, noise) = observe(poses, chosen[i], task, seed, i);
        let seen = blocks.consider_ways(&y, &noise, 0.0).explained;
        seen.into_iter().map(|e| e.levels).collect::<Evidences>()
    };
    let both = (0..2u64).flat_map(|task| {
        parallel::map_chunks(chosen.len(), 4, |range| {
            range.map(|i| one(i, task)).collect::<Vec<_>>()
        })
    });
    both.flatten().collect()
}

fn observe(
    poses: &TrainingPoses,
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
        .map(|c| if known(c / 3) { FLOOR } else { f64::INFINITY })
        .collect();
    (pose, noise)
}

/// So many poses are counted for every level and way before any is seen: none is ever ruled out.
const PSEUDO: f64 = 1.0;

fn expectation_maximisation(blocks: &Blocks, seen: &[Evidences], steps: usize) -> Weights {
    let mut levels: Vec<Vec<f64>> = blocks.parts.iter().map(|p| p.log_weights.clone()).collect();
    let mut ways = blocks.log_ways.clone();
    for _ in 0..steps {
        let mut level_counts: Vec<Vec<f64>> =
            levels.iter().map(|l| vec![PSEUDO; l.len()]).collect();
        let mut way_counts = vec![PSEUDO; ways.len()];
        for pose in seen {
            let each: Vec<Vec<f64>> = pose
                .iter()
                .zip(&levels)
                .map(|(e, w)| e.iter().zip(w).map(|(e, w)| e + w).collect())
                .collect();
            let parts: Vec<f64> = each.iter().map(|e| log_sum(e)).collect();
            let logs: Vec<f64> = blocks
                .ways
                .iter()
                .zip(&ways)
                .map(|(way, log)| log + way.iter().map(|&p| parts[p]).sum::<f64>())
                .collect();
            let all = log_sum(&logs);
            for (f, way) in blocks.ways.iter().enumerate() {
                let r = (logs[f] - all).exp();
                way_counts[f] += r;
                for &p in way {
                    for (count, e) in level_counts[p].iter_mut().zip(&each[p]) {
                        *count += r * (e - parts[p]).exp();
                    }
                }
            }
        }
        ways = logs_of(&way_counts);
        levels = level_counts.iter().map(|c| logs_of(c)).collect();
    }
    (levels, ways)
}

fn logs_of(counts: &[f64]) -> Vec<f64> {
    let total: f64 = counts.iter().sum();
    counts.iter().map(|c| (c / total).ln()).collect()
}
