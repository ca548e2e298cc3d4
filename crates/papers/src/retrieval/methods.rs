//! The distances that are compared.

use crate::Result;
use crate::metric::train::Learner;
use crate::metric::{
    BodyFramePoses, JointMap, LabeledPair, PoseFeatures, PoseMetric, TrainSettings, train,
};
use crate::{Baseline, PublishedLearner};

/// Frames of one window, seconds.
pub(crate) const WINDOW: f64 = 0.2;

/// A distance to be trained and tested.
#[derive(Debug, Clone, PartialEq)]
pub struct Method {
    /// Its name in tables.
    pub name: String,
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Baseline(Baseline),
    Trained(Box<TrainSettings>),
}

/// Seconds of each step of a training.
pub type StepSeconds = Vec<(&'static str, f64)>;

impl Method {
    /// Learns the distance; also the seconds of its steps.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: labels that it needs are missing, or nothing can be learned.
    pub(crate) fn fit(
        &self,
        map: &JointMap,
        takes: &[BodyFramePoses],
        pairs: &[LabeledPair],
    ) -> Result<(PoseMetric, StepSeconds)> {
        match &self.kind {
            Kind::Baseline(baseline) => Ok((baseline.metric(map, takes, pairs)?, Vec::new())),
            Kind::Trained(settings) => {
                let trained = train(takes, pairs, settings)?;
                Ok((trained.metric, trained.seconds))
            }
        }
    }

    fn trained(name: &str, settings: TrainSettings) -> Method {
        Method {
            name: name.into(),
            kind: Kind::Trained(Box::new(settings)),
        }
    }
}

/// The methods of each table, for labels that hold for `reach` seconds.
#[derive(Debug, Clone)]
pub(crate) struct Methods {
    default: TrainSettings,
    map: JointMap,
}

impl Methods {
    /// Methods for a joint map.
    pub(crate) fn new(map: &JointMap, reach: f64, seed: u64) -> Methods {
        let mut default = TrainSettings::new(map.clone());
        default.reach = reach;
        default.window = WINDOW;
        default.seed = seed;
        Methods {
            default,
            map: map.clone(),
        }
    }

    /// The default metric.
    pub(crate) fn default_method(&self) -> Method {
        Method::trained("gpd+rdsr", self.default.clone())
    }

    /// Published distances, coordinates at the default's window, and the default (Chen et al.'s
    /// figure 5).
    pub(crate) fn distances(&self) -> Vec<Method> {
        let baselines = Baseline::ALL.into_iter().map(|b| Method {
            name: b.name().into(),
            kind: Kind::Baseline(b),
        });
        let coordinates = |window: f64| TrainSettings {
            features: PoseFeatures::Coordinates,
            learner: Learner::L2,
            window,
            ..self.default.clone()
        };
        let one_frame = TrainSettings {
            window: 0.0,
            ..self.default.clone()
        };
        let published = TrainSettings {
            seed: self.default.seed,
            ..TrainSettings::paper(self.map.clone())
        };
        baselines
            .chain([
                Method::trained("coordinates, one frame", coordinates(0.0)),
                Method::trained("coordinates, window", coordinates(WINDOW)),
                Method::trained("gpd+rdsr as published", published),
                Method::trained("gpd+rdsr, one frame", one_frame),
                self.default_method(),
            ])
            .collect()
    }

    /// Features by learners, at the default's window (figure 6).
    pub(crate) fn features_by_learners(&self) -> Vec<Method> {
        let learners = [
            Learner::L2,
            Learner::Other(&PublishedLearner::Lms),
            Learner::Other(&PublishedLearner::Xing),
            Learner::Other(&PublishedLearner::Sda),
            Learner::Other(&PublishedLearner::Rca),
            Learner::Other(&PublishedLearner::Lmnn),
            Learner::Other(&PublishedLearner::Nca),
            Learner::Rdsr,
        ];
        let features = [
            PoseFeatures::Orientations,
            PoseFeatures::Coordinates,
            PoseFeatures::JointDistances,
            PoseFeatures::Gpd,
        ];
        let cross = learners.into_iter().flat_map(|l| features.map(|f| (l, f)));
        cross
            .map(|(learner, features)| {
                let settings = TrainSettings {
                    features,
                    learner,
                    ..self.default.clone()
                };
                let name = format!("{}+{}", features.name(), learner.name());
                Method::trained(&name, settings)
            })
            .collect()
    }

    /// Ranks (figure 4).
    pub(crate) fn ranks(&self) -> Vec<Method> {
        let with = |rank: usize| {
            let mut settings = self.default.clone();
            settings.rdsr.rank = rank;
            Method::trained(&format!("rank {rank}"), settings)
        };
        [5, 10, 20, 30, 50, 80, 120, 200].map(with).into()
    }

    /// Numbers of unlabeled poses (figure 7).
    pub(crate) fn unlabeled(&self) -> Vec<Method> {
        let with = |unlabeled: usize| {
            let settings = TrainSettings {
                unlabeled,
                ..self.default.clone()
            };
            Method::trained(&format!("{unlabeled} poses"), settings)
        };
        [0, 500, 1000, 2000, 5000, 10_000].map(with).into()
    }
}
