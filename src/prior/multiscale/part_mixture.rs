//! The blocks of one part of the body: cells at many levels, and every training pose a leaf.

use super::cluster_level::ClusterLevel;
use super::exemplars::{ClusterExemplars, ExemplarPoses, Exemplars};
use super::noisy_covariance::{NoisePattern, NoisyCovariance};
use super::scaled_precision::{IsotropicPrecisions, ScaledPrecisions};
use crate::numeric::simd::{self, padded};
use crate::numeric::small_linalg::add;
use crate::pose::PoseTransform;
use ndarray::Array2;
use std::sync::{Arc, OnceLock};

/// One level: which blocks, at which scale of their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SubMixture {
    /// The cells of `PartMixture::clusters[index]`, their covariance times `scale`.
    Clusters {
        /// Which cells.
        index: usize,
        /// Of their covariance.
        scale: f64,
    },
    /// The leaves, the finest cell's covariance times `scale`, and the step's own variance times `step_scale`.
    Exemplars {
        /// Of the finest cell's covariance.
        scale: f64,
        /// Of the outer product of the step.
        step_scale: f64,
    },
}

/// The blocks of one part.
#[derive(Debug, Clone)]
pub struct PartMixture {
    /// Which of the pose's 3 J coordinates: d of them.
    pub coordinates: Vec<usize>,
    /// From the coarsest to the finest.
    pub cluster_levels: Vec<ClusterLevel>,
    /// The training poses.
    pub exemplars: Exemplars,
    /// All levels.
    pub levels: Vec<SubMixture>,
    /// The log weight of each level.
    pub log_weights: Vec<f64>,
    /// The levels that weigh enough to be looked at: of each level of cells, then of the leaves.
    active: Vec<Vec<ActiveSubMixture>>,
}

/// A level that is looked at.
#[derive(Debug, Clone, Copy)]
pub struct ActiveSubMixture {
    /// Which of the part's levels.
    pub level: usize,
    /// Of the covariance.
    pub scale: f64,
    /// Which of the index's scales that is, each counted once.
    pub at: usize,
    /// Of the step's own variance.
    pub step_scale: f64,
}

/// What one noise pattern makes of a part's blocks; each is looked at when first needed.
#[derive(Debug)]
pub struct ConditionedPart {
    /// The noise variance of each coordinate, cm².
    pub noise: Vec<f64>,
    pattern: NoisePattern,
    /// The coordinates that are seen.
    observed: Arc<[usize]>,
    /// The same without what is changed: what does not hang on that is taken from there.
    isotropic: Option<Arc<ConditionedPart>>,
    /// 1 / (variance within a level's cells + noise), 0 where nothing is seen: by level.
    pub distance_weights: Vec<Vec<f32>>,
    cluster_cache: Vec<Vec<OnceLock<Box<ConditionedCluster>>>>,
}

/// One cell seen through the noise, at all its scales.
#[derive(Debug)]
pub struct ConditionedCluster {
    pub noisy: NoisyCovariance,
    /// At the scales of the cell's levels, each once.
    pub scales: ScaledPrecisions,
    /// At the scales of the leaves' levels, each once; where they were asked for.
    exemplars: OnceLock<ScaledPrecisions>,
    /// What views through changed noise start from: of the cell's levels, and of the leaves'.
    isotropic: [OnceLock<IsotropicPrecisions>; 2],
}

impl ConditionedPart {
    /// Through noise that is everywhere the same.
    pub fn isotropic(part: &PartMixture, base_variance: f64) -> ConditionedPart {
        let noise = vec![base_variance; part.coordinates.len()];
        ConditionedPart::with(part, noise, None)
    }

    /// Nothing looked at yet; `noise` is that of the part's coordinates. `even` gives the view through noise that is
    /// everywhere the same.
    pub fn new(
        part: &PartMixture,
        noise: Vec<f64>,
        isotropic: impl FnOnce(f64) -> Arc<ConditionedPart>,
    ) -> ConditionedPart {
        let isotropic = match NoisePattern::of(&noise) {
            NoisePattern::NearIsotropic {
                base_variance,
                exceptions,
            } if !exceptions.is_empty() => Some(isotropic(base_variance)),
            _ => None,
        };
        ConditionedPart::with(part, noise, isotropic)
    }

    fn with(
        part: &PartMixture,
        noise: Vec<f64>,
        isotropic: Option<Arc<ConditionedPart>>,
    ) -> ConditionedPart {
        let near = |c: &ClusterLevel| {
            let weight = |(v, n): (&f64, &f64)| (1.0 / (v + n)) as f32;
            let mut near: Vec<f32> = c.within.iter().zip(&noise).map(weight).collect();
            near.resize(padded(near.len()), 0.0);
            near
        };
        let none = |c: &ClusterLevel| (0..c.len()).map(|_| OnceLock::new()).collect();
        ConditionedPart {
            distance_weights: part.cluster_levels.iter().map(near).collect(),
            isotropic,
            pattern: NoisePattern::of(&noise),
            observed: (0..noise.len()).filter(|&i| noise[i].is_finite()).collect(),
            cluster_cache: part.cluster_levels.iter().map(none).collect(),
            noise,
        }
    }

    /// Whether any coordinate is observed.
    pub fn observes_any(&self) -> bool {
        self.pattern != NoisePattern::Unobserved
    }

    /// Whether most coordinates are: what is near in them is near.
    pub fn observes_most(&self) -> bool {
        4 * self.observed.len() >= 3 * self.noise.len()
    }

    /// An observation (d) in single precision, padded; 0 where missing.
    pub fn single(&self, y: &[f64]) -> Vec<f32> {
        let observed = y.iter().zip(&self.noise);
        let mut single = Vec::with_capacity(padded(y.len()));
        single.extend(observed.map(|(y, n)| if n.is_finite() { *y as f32 } else { 0.0 }));
        single.resize(padded(single.len()), 0.0);
        single
    }

    /// A cell through this noise.
    pub fn cluster_conditioned(
        &self,
        part: &PartMixture,
        index: usize,
        cluster: usize,
    ) -> &ConditionedCluster {
        self.cluster_cache[index][cluster].get_or_init(|| {
            let basis = part.cluster_levels[index].basis(cluster, &part.coordinates);
            let noisy = NoisyCovariance::new(&basis, &self.noise, &self.observed, &self.pattern);
            let scales = match &self.isotropic {
                None => noisy.at(&cluster_scales(part, index)),
                Some(isotropic) => {
                    let isotropic = &isotropic.cluster_conditioned(part, index, cluster);
                    let of = isotropic.isotropic[0]
                        .get_or_init(|| isotropic.noisy.isotropic(&cluster_scales(part, index)));
                    noisy.exceptions(of, false)
                }
            };
            Box::new(ConditionedCluster {
                scales,
                exemplars: OnceLock::new(),
                noisy,
                isotropic: Default::default(),
            })
        })
    }

    /// A finest cell at the scales of the leaves' levels.
    pub fn exemplars(&self, part: &PartMixture, cluster: usize) -> &ScaledPrecisions {
        let index = part.cluster_levels.len() - 1;
        let cluster_conditioned = self.cluster_conditioned(part, index, cluster);
        cluster_conditioned
            .exemplars
            .get_or_init(|| match &self.isotropic {
                None => cluster_conditioned.noisy.at(&exemplar_scales(part)),
                Some(isotropic) => {
                    let isotropic = &isotropic.cluster_conditioned(part, index, cluster);
                    let of = isotropic.isotropic[1]
                        .get_or_init(|| isotropic.noisy.isotropic(&exemplar_scales(part)));
                    cluster_conditioned.noisy.exceptions(of, true)
                }
            })
    }
}

/// The scales of the levels of an index. A finest cell that is no level's is looked at for its leaves' sake.
fn cluster_scales(part: &PartMixture, index: usize) -> Vec<f64> {
    let own = scales(&part.active[index]);
    if own.is_empty() { vec![1.0] } else { own }
}

/// The scales of the leaves' levels.
fn exemplar_scales(part: &PartMixture) -> Vec<f64> {
    scales(part.exemplar_sub_mixtures())
}

/// The scales of some levels, each once.
fn scales(levels: &[ActiveSubMixture]) -> Vec<f64> {
    let firsts = levels.iter().enumerate().filter(|(i, level)| {
        let before = &levels[..*i];
        before.iter().all(|b| b.scale != level.scale)
    });
    firsts.map(|(_, level)| level.scale).collect()
}

/// Levels of less weight are not looked at.
const MIN_WEIGHT: f64 = 2e-3;

impl PartMixture {
    /// Puts a part together: `labels` gives the finest cell of each training pose.
    pub fn new(
        coordinates: Vec<usize>,
        cluster_levels: Vec<ClusterLevel>,
        poses: Arc<ExemplarPoses>,
        labels: &[u32],
        levels: Vec<SubMixture>,
    ) -> PartMixture {
        let finest = cluster_levels.last().map_or(0, ClusterLevel::len);
        let isotropic = vec![-(levels.len() as f64).ln(); levels.len()];
        let mut part = PartMixture {
            exemplars: Exemplars::new(poses, labels, finest),
            log_weights: Vec::new(),
            active: Vec::new(),
            levels,
            cluster_levels,
            coordinates,
        };
        part.set_log_weights(isotropic);
        part
    }

    /// Gives the levels their log weights. Those of next to none are not looked at, the coarsest apart: it knows of
    /// every pose.
    pub fn set_log_weights(&mut self, log_weights: Vec<f64>) {
        let mut active = vec![Vec::new(); self.cluster_levels.len() + 1];
        for (level, (&what, log)) in self.levels.iter().zip(&log_weights).enumerate() {
            let (index, scale, step_scale) = match what {
                SubMixture::Clusters { index, scale } => (index, scale, 0.0),
                SubMixture::Exemplars { scale, step_scale } => {
                    (self.cluster_levels.len(), scale, step_scale)
                }
            };
            if index == 0 || log.exp() >= MIN_WEIGHT {
                let others = scales(&active[index]);
                let at = others.iter().position(|s| *s == scale);
                active[index].push(ActiveSubMixture {
                    level,
                    scale,
                    at: at.unwrap_or(others.len()),
                    step_scale,
                });
            }
        }
        self.active = active;
        self.log_weights = log_weights;
    }

    /// The same part of poses that went through `map` and are now `poses`.
    pub fn mapped(&self, map: &Arc<PoseTransform>, poses: &Arc<ExemplarPoses>) -> PartMixture {
        let clusters = self
            .cluster_levels
            .iter()
            .map(|c| c.mapped(map, &self.coordinates));
        PartMixture {
            cluster_levels: clusters.collect(),
            exemplars: self.exemplars.mapped(poses.clone()),
            ..self.clone()
        }
    }

    /// The leaves of a finest cell.
    pub fn opened(&self, cluster: usize) -> &ClusterExemplars {
        let finest = self.finest();
        let basis = || finest.basis(cluster, &self.coordinates);
        self.exemplars
            .open(cluster, &self.coordinates, finest.means.row(cluster), basis)
    }

    /// The finest cells.
    pub fn finest(&self) -> &ClusterLevel {
        &self.cluster_levels[self.cluster_levels.len() - 1]
    }

    /// The levels of the leaves that are looked at.
    pub fn exemplar_sub_mixtures(&self) -> &[ActiveSubMixture] {
        &self.active[self.cluster_levels.len()]
    }

    /// The levels of the cells of an index that are looked at.
    pub fn active(&self, index: usize) -> &[ActiveSubMixture] {
        &self.active[index]
    }
}

/// `to` += `weight` x xᵀ.
pub fn add_outer(to: &mut Array2<f64>, weight: f64, x: &[f64]) {
    // All that is added up here was made by rows.
    debug_assert!(to.is_standard_layout());
    let Some(to) = to.as_slice_mut() else { return };
    simd::dispatch8(
        #[inline(always)]
        || {
            for (row, a) in to.chunks_exact_mut(x.len().max(1)).zip(x) {
                add(row, weight * a, x);
            }
        },
    );
}
