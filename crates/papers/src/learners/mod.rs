//! Learners of a distance from labeled pairs of poses: the baselines of Chen et al. 2011, section
//! 5.4, and later methods.
//!
//! All but [`lms`] learn a linear map W (d, r). The distance of two poses is the Euclidean one
//! after the map (equations 10 and 11): d²(x, y) = (x − y)ᵀ W Wᵀ (x − y). Only the ratios of
//! distances matter; each learner states its own scale.
//!
//! | learner | labels | what it solves | paper |
//! |---|---|---|---|
//! | [`lms`] | both | least squares for weights, at least 0 | Wang and Bodenheimer 2003 |
//! | [`xing`] | both | a concave problem over metrics | Xing, Ng, Jordan and Russell 2003 |
//! | [`sda`] | both | a generalized eigenproblem | Cai, He and Han 2007 |
//! | [`rca`] | alike | a generalized eigenproblem | Bar-Hillel, Hertz, Shental and Weinshall 2005 |
//! | [`lmnn`] | both | gradient steps on W | Weinberger and Saul 2009 |
//! | [`nca`] | alike | gradient steps on W | Goldberger, Roweis, Hinton and Salakhutdinov 2005 |
//!
//! Each gives the same result for the same input on any number of threads. Each takes seconds for
//! some 6,000 poses of 200 dimensions; reduce longer poses by principal components first.

mod boost;
mod components;
mod hinge;
pub(crate) mod lmnn;
pub(crate) mod lms;
pub(crate) mod nca;
mod neighbors;
pub(crate) mod rca;
mod scatter;
pub(crate) mod sda;
mod start;
#[cfg(test)]
mod testdata;
pub(crate) mod weights;
pub(crate) mod xing;

use crate::Result;
use crate::metric::pose_metric::PoseMetric;
use crate::metric::train::{Learned, PairLearner, TrainingPairs};
use ndarray::Array2;
use weights::WeightRule;

/// A learner that papers compare with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PublishedLearner {
    /// Weights by least squares, on the scaled features (Wang and Bodenheimer 2003).
    Lms,
    /// Features chosen by boosting.
    Boost,
    /// A full metric that spreads unlike poses (Xing et al. 2003).
    Xing,
    /// Semi-supervised discriminant analysis (Cai et al. 2007).
    Sda,
    /// Relevant component analysis (Bar-Hillel et al. 2005).
    Rca,
    /// Large margin nearest neighbors (Weinberger and Saul 2009).
    Lmnn,
    /// Neighborhood component analysis (Goldberger et al. 2005).
    Nca,
}

names!(PublishedLearner {
    Lms = "lms",
    Boost = "boost",
    Xing = "xing",
    Sda = "sda",
    Rca = "rca",
    Lmnn = "lmnn",
    Nca = "nca",
});

impl PairLearner for PublishedLearner {
    fn name(&self) -> &'static str {
        PublishedLearner::name(*self)
    }

    fn description(&self) -> &'static str {
        match self {
            PublishedLearner::Lms => {
                "Weights of features or joints by least squares (Wang and Bodenheimer); needs both \
                 labels"
            }
            PublishedLearner::Boost => {
                "Features chosen by boosting (Chen et al. 2009); needs both labels"
            }
            PublishedLearner::Xing => {
                "Distance metric learning with side information (Xing et al.); needs both labels"
            }
            PublishedLearner::Sda => {
                "Semi-supervised discriminant analysis (Cai et al.); needs both labels"
            }
            PublishedLearner::Rca => "Relevant component analysis (Bar-Hillel et al.)",
            PublishedLearner::Lmnn => {
                "Large margin nearest neighbors (Weinberger and Saul); needs both labels"
            }
            PublishedLearner::Nca => "Neighborhood component analysis (Goldberger et al.)",
        }
    }

    fn weighs_features(&self) -> bool {
        matches!(self, PublishedLearner::Lms | PublishedLearner::Boost)
    }

    fn uses_unlabeled(&self) -> bool {
        matches!(self, PublishedLearner::Sda | PublishedLearner::Rca)
    }

    /// Learns with the default settings.
    fn learn(&self, start: &PoseMetric, pairs: &TrainingPairs<'_>, rank: usize) -> Result<Learned> {
        let settings = &Settings {
            rank,
            ..Settings::default()
        };
        let exact = |w: Array2<f64>| LearnedMap { w, converged: true };
        let map = match self {
            PublishedLearner::Lms => return weights::learn(start, WeightRule::LeastSquares, pairs),
            PublishedLearner::Boost => return weights::learn(start, WeightRule::Boosting, pairs),
            PublishedLearner::Xing => xing::fit(pairs, settings),
            PublishedLearner::Sda => sda::fit(pairs, settings).map(exact),
            PublishedLearner::Rca => rca::fit(pairs, settings).map(exact),
            PublishedLearner::Lmnn => lmnn::fit(pairs, settings),
            PublishedLearner::Nca => nca::fit(pairs, settings),
        }?;
        Ok(Learned {
            metric: start.projected(map.w.view()),
            has_converged: map.converged,
        })
    }
}

/// Settings of the learners.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Settings {
    /// Directions to keep.
    pub rank: usize,
    /// For [`rca`], [`sda`] and [`xing`]: the share of a matrix's mean diagonal that is added to
    /// its diagonal.
    pub ridge: f64,
    /// For [`sda`]: neighbors of each pose in the graph.
    pub neighbors: usize,
    /// For [`sda`]: β, the weight of the graph; 1 weighs it as much as the alike pairs, 0 leaves it
    /// out.
    pub beta: f64,
    /// For [`nca`]: largest number of steps.
    pub steps: usize,
    /// For [`lmnn`]: largest number of rounds, of 10 steps each.
    pub rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            // Chen et al.'s useful range is 30 to 90 (section 5.2).
            rank: 50,
            // Fewer pairs than dimensions leave the matrix singular. Directions in which alike
            // poses hardly differ would then win, be they noise or not; a ridge of a tenth keeps
            // them from it.
            ridge: 0.1,
            neighbors: 5,
            // Not tuned.
            beta: 0.1,
            // On made poses of 200 dimensions 20 served unseen poses best: later steps fit the
            // pairs alone.
            steps: 20,
            // More than a few fit the pairs alone.
            rounds: 5,
        }
    }
}

/// What a learner found by steps.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LearnedMap {
    /// The linear map W (d, r).
    pub w: Array2<f64>,
    /// Whether the steps came to an end before their limit; the learner's page says what that
    /// means.
    pub converged: bool,
}

/// The labels that a learner cannot do without.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Needs {
    Alike,
    Both,
}

/// Refuses what `learner` cannot learn a map of `rank` directions from.
fn check(pairs: &TrainingPairs<'_>, learner: &str, needs: Needs, rank: usize) -> Result<()> {
    let (n, d) = pairs.x.dim();
    if rank == 0 {
        return Err(format!("{learner} needs a rank of at least 1").into());
    }
    if d == 0 {
        return Err(format!("{learner} needs poses of at least 1 dimension").into());
    }
    if pairs.alike.is_empty() {
        return Err(format!("{learner} needs pairs of label 1").into());
    }
    if needs == Needs::Both && pairs.unlike.is_empty() {
        return Err(format!("{learner} needs pairs of label 0 too").into());
    }
    let ends = pairs.alike.iter().chain(pairs.unlike).flatten();
    if let Some(row) = ends.into_iter().find(|&&row| row >= n) {
        return Err(format!("a pair names row {row}, but there are {n} poses").into());
    }
    let bad = |row: usize| !pairs.x.row(row).iter().all(|v| v.is_finite());
    match (0..n).find(|&row| bad(row)) {
        Some(row) => Err(format!("row {row} holds a value that is not finite").into()),
        None => Ok(()),
    }
}

/// The rows that some pair names, in rising order, each once.
fn labeled_rows(pairs: &TrainingPairs<'_>) -> Vec<usize> {
    let ends = pairs.alike.iter().chain(pairs.unlike).flatten();
    let mut rows: Vec<usize> = ends.copied().collect();
    rows.sort_unstable();
    rows.dedup();
    rows
}

#[cfg(test)]
mod tests {
    use super::testdata::Planted;
    use super::*;

    /// All learners of a map, by name.
    fn learn(name: &str, pairs: &TrainingPairs<'_>, rank: usize) -> Result<Array2<f64>> {
        match name {
            "xing" => xing::fit(
                pairs,
                &Settings {
                    rank,
                    ..Default::default()
                },
            )
            .map(|l| l.w),
            "sda" => sda::fit(
                pairs,
                &Settings {
                    rank,
                    ..Default::default()
                },
            ),
            "rca" => rca::fit(
                pairs,
                &Settings {
                    rank,
                    ..Default::default()
                },
            ),
            "lmnn" => lmnn::fit(
                pairs,
                &Settings {
                    rank,
                    ..Default::default()
                },
            )
            .map(|l| l.w),
            _ => nca::fit(
                pairs,
                &Settings {
                    rank,
                    ..Default::default()
                },
            )
            .map(|l| l.w),
        }
    }

    const NAMES: [&str; 5] = ["xing", "sda", "rca", "lmnn", "nca"];

    #[test]
    fn noise_is_suppressed_in_poses_never_seen() {
        let data = Planted::new(3, 6);
        let before = data.precision(&Array2::eye(9));
        assert!(before <= 0.7, "{before}");
        for name in NAMES {
            let w = learn(name, &data.pairs(), 4).unwrap();
            assert_eq!(w.dim(), (9, 4), "{name}");
            let after = data.precision(&w);
            assert!(after >= before + 0.2, "{name}: {after} after {before}");
        }
    }

    #[test]
    fn threads_and_repetition_change_nothing() {
        let data = Planted::new(3, 4);
        for name in NAMES {
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                pool.unwrap().install(|| learn(name, &data.pairs(), 3))
            };
            let once = on(1).unwrap();
            assert_eq!(once, on(1).unwrap(), "{name}");
            assert_eq!(once, on(2).unwrap(), "{name}");
        }
    }

    #[test]
    fn any_scale_and_position_of_the_poses_gives_the_same_neighbors() {
        let mut data = Planted::new(3, 4);
        let before: Vec<f64> = NAMES
            .map(|n| data.precision(&learn(n, &data.pairs(), 3).unwrap()))
            .into();
        data.x.mapv_inplace(|v| 1e4 * v + 3e5);
        for (name, before) in NAMES.iter().zip(before) {
            let after = data.precision(&learn(name, &data.pairs(), 3).unwrap());
            assert!((after - before).abs() <= 0.03, "{name}: {after}, {before}");
        }
    }

    #[test]
    fn one_dimension_and_too_high_a_rank_are_served() {
        let data = Planted::new(1, 0);
        for name in NAMES {
            let w = learn(name, &data.pairs(), 50).unwrap();
            assert!(w.dim() == (1, 1) && w[[0, 0]].abs() > 0.0, "{name}: {w}");
        }
        let data = Planted::new(2, 3);
        for name in NAMES {
            let w = learn(name, &data.pairs(), 50).unwrap();
            assert_eq!(w.dim(), (5, 5), "{name}");
            assert!(w.iter().all(|v| v.is_finite()), "{name}");
        }
    }

    #[test]
    fn what_cannot_be_learned_from_is_told() {
        let data = Planted::new(2, 1);
        let whole = data.pairs();
        let refuses = |pairs: &TrainingPairs<'_>, rank: usize, phrase: &str, names: &[&str]| {
            for name in names {
                let error = learn(name, pairs, rank).unwrap_err();
                assert!(error.to_string().contains(phrase), "{name}: {error}");
            }
        };
        let none = TrainingPairs {
            alike: &[],
            ..whole
        };
        refuses(&none, 2, "needs pairs of label 1", &NAMES);
        let none = TrainingPairs {
            unlike: &[],
            ..whole
        };
        refuses(
            &none,
            2,
            "needs pairs of label 0 too",
            &["xing", "sda", "lmnn"],
        );
        assert!(learn("rca", &none, 2).is_ok() && learn("nca", &none, 2).is_ok());
        refuses(&whole, 0, "rank", &NAMES);
        let beyond = TrainingPairs {
            alike: &[[0, 9999]],
            ..whole
        };
        refuses(&beyond, 2, "row 9999", &NAMES);
        let mut bad = data.x.clone();
        bad[[7, 1]] = f64::NAN;
        refuses(
            &TrainingPairs {
                x: bad.view(),
                ..whole
            },
            2,
            "row 7",
            &NAMES,
        );
        bad.fill(3.0);
        refuses(
            &TrainingPairs {
                x: bad.view(),
                ..whole
            },
            2,
            "same",
            &NAMES,
        );
        let narrow = bad.slice(ndarray::s![.., ..0]);
        refuses(
            &TrainingPairs { x: narrow, ..whole },
            2,
            "dimension",
            &NAMES,
        );
    }
}
