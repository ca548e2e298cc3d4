//! The distances that Chen et al. compare with (section 5.3), and the one that game engines ship.
//!
//! | name | what | from pairs |
//! |---|---|---|
//! | `jod` | rotations and their velocities, all joints: (40) | |
//! | `wjod` | the same of shoulders, elbows, hips, knees, pelvis and spine: (41) | |
//! | `ljod` | the same, with a weight per joint | weights |
//! | `jcd`, `wjcd`, `ljcd` | coordinates in place of rotations: (42), (43) | weights of `ljcd` |
//! | `jrf-lms` | weighted differences of distances of joints: (44) | weights |
//! | `rgf-boost` | differences of chosen geometric features: (45) | the choice |
//! | `game` | ends of the body and the path ahead, scaled by their spreads | |
//!
//! Chen et al. leave open: how rotations are compared (here by 2 sin(θ/2), see `features`;
//! fitted to the joints, without the twist about a bone), the units (body heights and seconds, λ =
//! 1), and the pool of `rgf-boost` (the geometric pose descriptor, each feature of variance 1). The
//! hip's position is compared by its height alone, as the position on the ground is removed.
//! Distances are the roots of (40) to (43), which order poses alike.

use super::learners::PublishedLearner;
use super::learners::weights::joint_of;
use crate::Result;
use crate::metric::body_frame::BodyFramePoses;
use crate::metric::features::PoseFeatures;
use crate::metric::joint_map::{JOINTS, JointMap, joint};
use crate::metric::pairs::LabeledPair;
use crate::metric::pose_metric::{PoseMetric, Projection};
use crate::metric::scaling::ScalingRule;
use crate::metric::train::{Learner, TrainSettings, train};

/// The joints that (41) and (43) compare.
const MAIN: [usize; 10] = [
    joint::HIP,
    joint::CHEST,
    joint::LSHOULDER,
    joint::LELBOW,
    joint::RSHOULDER,
    joint::RELBOW,
    joint::LHIP,
    joint::LKNEE,
    joint::RHIP,
    joint::RKNEE,
];

/// A distance to compare with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// Joint orientation distance.
    Jod,
    /// Weighted joint orientation distance.
    Wjod,
    /// Learned joint orientation distance.
    Ljod,
    /// Joint coordinate distance.
    Jcd,
    /// Weighted joint coordinate distance.
    Wjcd,
    /// Learned joint coordinate distance.
    Ljcd,
    /// Joint relative features with least-squares weights.
    JrfLms,
    /// Geometric features chosen by boosting.
    RgfBoost,
    /// Motion matching.
    MotionMatching,
}

names!(Baseline {
    Jod = "jod",
    Wjod = "wjod",
    Ljod = "ljod",
    Jcd = "jcd",
    Wjcd = "wjcd",
    Ljcd = "ljcd",
    JrfLms = "jrf-lms",
    RgfBoost = "rgf-boost",
    MotionMatching = "game",
});

impl Baseline {
    /// Whether it is learned from pairs of both labels.
    pub fn is_learned(self) -> bool {
        matches!(
            self,
            Baseline::Ljod | Baseline::Ljcd | Baseline::JrfLms | Baseline::RgfBoost
        )
    }

    /// What it compares.
    pub fn features(self) -> PoseFeatures {
        match self {
            Baseline::Jod | Baseline::Wjod | Baseline::Ljod => PoseFeatures::Orientations,
            Baseline::Jcd | Baseline::Wjcd | Baseline::Ljcd => PoseFeatures::Coordinates,
            Baseline::JrfLms => PoseFeatures::JointDistances,
            Baseline::RgfBoost => PoseFeatures::Gpd,
            Baseline::MotionMatching => PoseFeatures::MotionMatching,
        }
    }

    /// The distance, from `takes` and, where it is learned, labeled pairs of their frames.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: labels or joints that it needs are missing.
    pub fn metric(
        self,
        map: &JointMap,
        takes: &[BodyFramePoses],
        pairs: &[LabeledPair],
    ) -> Result<PoseMetric> {
        let settings = TrainSettings {
            features: self.features(),
            scaling: match self {
                Baseline::MotionMatching => ScalingRule::Balanced,
                Baseline::RgfBoost => ScalingRule::Standard,
                _ => ScalingRule::None,
            },
            window: 0.0,
            learner: match self {
                Baseline::RgfBoost => Learner::Other(&PublishedLearner::Boost),
                _ if self.is_learned() => Learner::Other(&PublishedLearner::Lms),
                _ => Learner::L2,
            },
            ..TrainSettings::new(map.clone())
        };
        let mut metric = train(takes, pairs, &settings)?.metric;
        if !self.is_learned() && self != Baseline::MotionMatching {
            let joints = if matches!(self, Baseline::Wjod | Baseline::Wjcd) {
                &MAIN[..]
            } else {
                &[][..]
            };
            metric.projection = Projection::Weights(hand_weights(self.features(), joints));
        }
        Ok(metric)
    }
}

/// 1 for features of `joints` (all joints, if there are none), 0 for others and for the rate of
/// climb, which no equation has.
fn hand_weights(features: PoseFeatures, joints: &[usize]) -> Vec<f32> {
    let names = features.feature_names();
    let weight = |name: &String| {
        let is_climb = features == PoseFeatures::Orientations && name == "J_c(Hip)_vy";
        let is_in = |j: &usize| JOINTS[*j] == joint_of(name);
        let counts = joints.is_empty() || joints.iter().any(is_in);
        f32::from(u8::from(counts && !is_climb))
    };
    names.iter().map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::standing::{own_names, standing, take_of};
    use glam::DVec3;

    #[test]
    fn a_raised_hand_counts_only_where_hands_do() {
        let mut raised = standing();
        raised[joint::LHAND] += DVec3::new(0.0, 16.0, 0.0);
        let frames = [standing(), standing(), standing(), raised, raised, raised];
        let takes = vec![BodyFramePoses::new(&take_of(&frames), Some(10.0), &own_names()).unwrap()];
        let distance = |baseline: Baseline| {
            let metric = baseline.metric(&own_names(), &takes, &[]).unwrap();
            let vectors = metric.embed(&takes[0]);
            metric.norm.distance(vectors.row(0), vectors.row(5))
        };
        assert!((distance(Baseline::Jcd) - 0.1).abs() < 1e-6);
        assert_eq!(distance(Baseline::Wjcd), 0.0);
        // The elbow's rotation, by atan(16 / 25).
        let angle = (16.0f32 / 25.0).atan();
        assert!((distance(Baseline::Jod) - 2.0 * (angle / 2.0).sin()).abs() < 1e-5);
        assert!((distance(Baseline::Wjod) - distance(Baseline::Jod)).abs() < 1e-6);
        assert!(distance(Baseline::MotionMatching) > 0.0);
        let error = Baseline::Ljcd
            .metric(&own_names(), &takes, &[])
            .unwrap_err();
        assert!(error.to_string().contains("label"), "{error}");
    }
}
