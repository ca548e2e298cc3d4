//! A metric from takes and labeled pairs of their frames.

use super::body_frame::BodyFramePoses;
use super::features::PoseFeatures;
use super::joint_map::JointMap;
use super::local_pairs::{Links, scatter_of_pairs};
use super::pairs::{FrameRef, LabeledPair, weighed};
use super::pose_metric::{PoseMetric, WINDOW};
use super::rdsr::{self, Criterion, RdsrSettings};
use super::reduction;
use super::scaling::ScalingRule;
use super::stopwatch::Stopwatch;
use crate::Result;
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView2, Axis};
use rand::seq::index;
use std::collections::BTreeSet;
use std::fmt;

/// How a metric is learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Learner {
    /// Regularized distance metric learning with sparse representation (Chen et al. 2011).
    Rdsr,
    /// Nothing is learned: the scaled features are compared.
    L2,
    /// Another method, from labeled pairs.
    Other(&'static dyn PairLearner),
}

impl Learner {
    /// The name in flags and messages.
    pub fn name(self) -> &'static str {
        match self {
            Learner::Rdsr => "rdsr",
            Learner::L2 => "l2",
            Learner::Other(learner) => learner.name(),
        }
    }

    /// One line on the method.
    pub fn description(self) -> &'static str {
        match self {
            Learner::Rdsr => "Regularized distance metric learning with sparse representation",
            Learner::L2 => "Nothing is learned but the scaling of the features",
            Learner::Other(learner) => learner.description(),
        }
    }
}

/// A method of [`Learner::Other`].
pub trait PairLearner: fmt::Debug + Sync {
    /// The name in flags and messages, which tells it from all others.
    fn name(&self) -> &'static str;

    /// One line on the method.
    fn description(&self) -> &'static str;

    /// Whether it weighs the scaled features. If not, it learns among the directions in which poses
    /// vary.
    fn weighs_features(&self) -> bool {
        false
    }

    /// Whether poses without labels count. [`TrainingPairs::x`] has them anyway, unless the method
    /// weighs features.
    fn uses_unlabeled(&self) -> bool {
        false
    }

    /// Learns from poses as `start` embeds them, up to `rank` dimensions.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: the method lacks labels, or nothing can be learned.
    fn learn(&self, start: &PoseMetric, pairs: &TrainingPairs<'_>, rank: usize) -> Result<Learned>;
}

impl PartialEq for dyn PairLearner {
    fn eq(&self, other: &dyn PairLearner) -> bool {
        self.name() == other.name()
    }
}

impl Eq for dyn PairLearner {}

/// What a [`PairLearner`] learns from.
#[derive(Debug, Clone, Copy)]
pub struct TrainingPairs<'a> {
    /// Poses, labeled and not (n, d).
    pub x: ArrayView2<'a, f64>,
    /// Pairs of rows of `x` that are alike (label 1).
    pub alike: &'a [[usize; 2]],
    /// Pairs of rows of `x` that are not (label 0).
    pub unlike: &'a [[usize; 2]],
}

/// What a [`PairLearner`] found.
#[derive(Debug, Clone)]
pub struct Learned {
    /// The metric.
    pub metric: PoseMetric,
    /// Whether its steps, if it goes by any, came to an end before their limit.
    pub has_converged: bool,
}

/// Settings of the training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainSettings {
    /// Which points the joints are.
    pub map: JointMap,
    /// What describes a pose.
    pub features: PoseFeatures,
    /// How features are scaled.
    pub scaling: ScalingRule,
    /// Seconds to the frames before and after that are described too; 0: none.
    pub window: f64,
    /// The method.
    pub learner: Learner,
    /// Settings of `rdsr`; other methods use its rank.
    pub rdsr: RdsrSettings,
    /// Poses without labels that are drawn from the takes, at most.
    pub unlabeled: usize,
    /// Seconds about a labeled frame for which the label holds: poses within it are paired with
    /// their nearest; 0: the labeled frames alone.
    pub reach: f64,
    /// Whether features are reduced to principal components before learning, or only to their
    /// range.
    pub is_reduced: bool,
    /// The seed of the draw.
    pub seed: u64,
}

impl TrainSettings {
    /// The settings that do best on people who are not in the training takes.
    pub fn new(map: JointMap) -> TrainSettings {
        TrainSettings {
            map,
            features: PoseFeatures::Gpd,
            scaling: ScalingRule::Balanced,
            window: WINDOW,
            learner: Learner::Rdsr,
            rdsr: RdsrSettings {
                criterion: Criterion::RatioTrace,
                rank: 50,
                alpha: 1.0,
                gamma: 0.05,
                tolerance: 1e-4,
                ridge: 0.1,
            },
            unlabeled: 5000,
            reach: 1.0,
            is_reduced: true,
            seed: 0,
        }
    }

    /// Whether takes need a frame rate.
    pub fn needs_rate(&self) -> bool {
        let has_reach = self.learner == Learner::Rdsr && self.reach > 0.0;
        self.features.needs_rate() || self.window > 0.0 || has_reach
    }

    /// Those of Chen et al.: all features of one frame, scaled by (38), the pairs as labeled, the
    /// ratio of traces. What Chen et al. leave open is the ridge: 1e-6.
    pub fn paper(map: JointMap) -> TrainSettings {
        let default = TrainSettings::new(map);
        TrainSettings {
            features: PoseFeatures::GpdWithAccelerations,
            scaling: ScalingRule::UnitLength,
            window: 0.0,
            reach: 0.0,
            is_reduced: false,
            rdsr: RdsrSettings {
                criterion: Criterion::TraceRatio,
                ridge: 1e-6,
                ..default.rdsr
            },
            ..default
        }
    }
}

/// A metric, and how it came about.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The metric.
    pub metric: PoseMetric,
    /// Poses without labels that it is learned from, beyond the scaling of the features.
    pub unlabeled: usize,
    /// Labeled pairs of label 1 and 0 that it is learned from.
    pub alike: usize,
    /// See [`Trained::alike`].
    pub unlike: usize,
    /// Labeled pairs that lack joints.
    pub ignored: usize,
    /// Pairs that were labeled both ways: the labels of the fewer people took as many of the
    /// others' away.
    pub contradicted: usize,
    /// Whether a learner that goes by steps came to an end before their limit, and the sparse
    /// graph is optimal within its tolerance.
    pub has_converged: bool,
    /// The largest violation of optimality of the sparse graph, for a method that has one.
    pub violation: Option<f64>,
    /// Seconds of each step, by name, in order.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Learns a metric from takes and labeled pairs of their frames.
///
/// # Errors
/// [`crate::Error::Unfit`]: no pair that the method needs, no rate, or poses without variation.
pub fn train(
    takes: &[BodyFramePoses],
    pairs: &[LabeledPair],
    settings: &TrainSettings,
) -> Result<Trained> {
    let (pairs, contradicted) = &weighed(pairs);
    check(takes, pairs, settings)?;
    let mut clock = Stopwatch::default();
    let labeled: BTreeSet<FrameRef> = pairs.iter().flat_map(|p| p.ends).collect();
    let sample = match settings.unlabeled {
        0 => labeled.iter().copied().collect(),
        most => sample(takes, most, settings.seed),
    };
    let full = reduction::all_features(
        &settings.map,
        settings.features,
        settings.scaling,
        settings.window,
        takes,
        &sample,
    )?;
    clock.lap("features and scaling");
    let training = Training {
        takes,
        pairs,
        settings,
        sample,
        clock,
    };
    let trained = match settings.learner {
        Learner::L2 => Ok(training.finish(full, Used::default())),
        Learner::Other(learner) if learner.weighs_features() => training.by_pairs(learner, &full),
        _ => training.projection(&full),
    }?;
    Ok(Trained {
        contradicted: *contradicted,
        ..trained
    })
}

/// A training under way.
struct Training<'a> {
    takes: &'a [BodyFramePoses],
    pairs: &'a [LabeledPair],
    settings: &'a TrainSettings,
    /// The poses without labels.
    sample: Vec<FrameRef>,
    clock: Stopwatch,
}

impl Training<'_> {
    fn finish(self, metric: PoseMetric, used: Used) -> Trained {
        Trained {
            metric,
            unlabeled: used.unlabeled,
            alike: used.alike,
            unlike: used.unlike,
            ignored: used.ignored,
            contradicted: 0,
            has_converged: !used.stopped,
            violation: used.violation,
            seconds: self.clock.laps,
        }
    }

    /// By another learner, from poses as `start` embeds them.
    fn by_pairs(mut self, learner: &dyn PairLearner, start: &PoseMetric) -> Result<Trained> {
        let others = if learner.weighs_features() || self.settings.unlabeled == 0 {
            &[][..]
        } else {
            &self.sample
        };
        let labeled = Labeled::new(self.takes, self.pairs, start, others);
        let x = labeled.vectors.mapv(f64::from);
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &labeled.alike,
            unlike: &labeled.unlike,
        };
        self.clock.lap("pairs");
        let learned = learner.learn(start, &pairs, self.settings.rdsr.rank)?;
        self.clock.lap("learning");
        let used = Used {
            unlabeled: if learner.uses_unlabeled() {
                others.len()
            } else {
                0
            },
            stopped: !learned.has_converged,
            ..labeled.used(self.pairs)
        };
        Ok(self.finish(learned.metric, used))
    }

    /// A projection, learned among the directions in which poses vary.
    fn projection(mut self, full: &PoseMetric) -> Result<Trained> {
        let basis = if self.settings.is_reduced {
            reduction::principal(full, self.takes, &self.sample)?
        } else {
            reduction::range(full, self.takes, &self.sample)?
        };
        self.clock.lap("principal components");
        if let Learner::Other(learner) = self.settings.learner {
            return self.by_pairs(learner, &basis);
        }
        let (w, used) = self.rdsr(&basis)?;
        Ok(self.finish(basis.projected(w.view()), used))
    }

    fn rdsr(&mut self, basis: &PoseMetric) -> Result<(Array2<f64>, Used)> {
        let frames: Vec<usize> = self.takes.iter().map(BodyFramePoses::frames).collect();
        let rates: Vec<f64> = self.takes.iter().map(|t| t.rate.unwrap_or(0.0)).collect();
        let links = Links::new(self.pairs, &frames, &rates, self.settings.reach);
        let linked = links.frames();
        let poses = reduction::embed(basis, self.takes, &linked).mapv(f64::from);
        let near = links.pair(&linked, poses.view());
        if near.is_empty() {
            return Err("no labeled pair has all joints".into());
        }
        let alike = scatter_of_pairs(poses.view(), &near);
        self.clock.lap("pairs");
        let x = match self.settings.unlabeled {
            0 => Array2::zeros((0, poses.ncols())),
            _ => self.unlabeled(basis),
        };
        let learned = rdsr::learn(x.view(), &alike, &self.settings.rdsr)?;
        self.clock.laps.extend(learned.seconds);
        let labeled = Labeled::new(self.takes, self.pairs, basis, &[]);
        let used = Used {
            unlike: 0,
            unlabeled: x.nrows(),
            violation: learned.violation,
            stopped: learned
                .violation
                .is_some_and(|v| v > self.settings.rdsr.tolerance),
            ..labeled.used(self.pairs)
        };
        Ok((learned.w, used))
    }

    /// The unlabeled poses that are complete, in a basis (N, d). Chen et al.'s are not centered.
    fn unlabeled(&self, basis: &PoseMetric) -> Array2<f64> {
        let vectors = reduction::embed(basis, self.takes, &self.sample);
        let x = reduction::complete_rows(vectors.view()).mapv(f64::from);
        match x.mean_axis(Axis(0)) {
            Some(mean) if self.settings.is_reduced => x - &mean,
            _ => x,
        }
    }
}

/// The vectors of labeled poses, and of others, with the pairs of their rows. Poses that lack
/// joints are left out, and their pairs.
struct Labeled {
    vectors: Array2<f32>,
    alike: Vec<[usize; 2]>,
    unlike: Vec<[usize; 2]>,
}

/// What a training made use of.
#[derive(Default)]
struct Used {
    alike: usize,
    unlike: usize,
    ignored: usize,
    unlabeled: usize,
    violation: Option<f64>,
    stopped: bool,
}

impl Labeled {
    fn used(&self, pairs: &[LabeledPair]) -> Used {
        let (alike, unlike) = (self.alike.len(), self.unlike.len());
        Used {
            alike,
            unlike,
            ignored: pairs.len() - alike - unlike,
            ..Used::default()
        }
    }

    fn new(
        takes: &[BodyFramePoses],
        pairs: &[LabeledPair],
        metric: &PoseMetric,
        others: &[FrameRef],
    ) -> Labeled {
        let ends = pairs.iter().flat_map(|p| p.ends);
        let frames: BTreeSet<FrameRef> = ends.chain(others.iter().copied()).collect();
        let frames: Vec<FrameRef> = frames.into_iter().collect();
        let all = reduction::embed(metric, takes, &frames);
        let is_complete = |k: &usize| all.row(*k).iter().all(|v| v.is_finite());
        let kept: Vec<usize> = (0..frames.len()).filter(is_complete).collect();
        let row = |end: FrameRef| {
            let all = frames.binary_search(&end).ok()?;
            kept.binary_search(&all).ok()
        };
        let rows = |is_alike: bool| {
            let labeled = pairs.iter().filter(move |p| p.is_alike == is_alike);
            labeled.filter_map(|p| Some([row(p.ends[0])?, row(p.ends[1])?]))
        };
        Labeled {
            alike: rows(true).collect(),
            unlike: rows(false).collect(),
            vectors: all.select(Axis(0), &kept),
        }
    }
}

fn check(takes: &[BodyFramePoses], pairs: &[LabeledPair], settings: &TrainSettings) -> Result<()> {
    if settings.learner != Learner::L2 && !pairs.iter().any(|p| p.is_alike) {
        return Err("no pair has label 1".into());
    }
    if settings.needs_rate() && takes.iter().any(|t| t.rate.is_none()) {
        return Err("the poses have no frame rate, which velocities and windows need".into());
    }
    Ok(())
}

/// Frames of all takes, drawn at random without repetition, in order.
fn sample(takes: &[BodyFramePoses], most: usize, seed: u64) -> Vec<FrameRef> {
    let all: Vec<FrameRef> = (takes.iter().enumerate())
        .flat_map(|(take, poses)| (0..poses.frames()).map(move |frame| FrameRef { take, frame }))
        .collect();
    let mut rng = parallel::rng(seed, 0);
    let mut drawn = index::sample(&mut rng, all.len(), most.min(all.len())).into_vec();
    drawn.sort_unstable();
    drawn.into_iter().map(|k| all[k]).collect()
}
