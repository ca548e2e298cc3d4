//! Whether a skeleton fits a take: one rule for all commands.
//!
//! The mean distance d of the driven joints from their points is held against the leg l (hip, knee,
//! ankle) of the body in the table. A fit is poor where d is over 5% of l, and none where it is
//! over 25%. Tables are in centimeters, so that a person's fit is poor over 2 cm and none over 10
//! cm already: the smaller limit counts. (A leg of 40 cm has both limits equal; 5% of an adult's is
//! twice 2 cm.) The shares are what remains for bodies in another unit.

use super::tuning::fit_quality::*;
use crate::numeric::statistics::median;
use crate::pose::{PointNaming, Poses, joints};
use glam::DVec3;

/// Words in the names of points that hang on the skeleton and do not drive it: skin, or joints too
/// small to tell a fit by.
const HANGING: [&str; 11] = [
    "eye", "eyes", "ear", "ears", "heel", "heels", "finger", "fingers", "thumb", "pinky", "little",
];
/// Words of fingers that may be words of something else, and those beside which they are fingers.
const FINGERS: [&str; 3] = ["index", "middle", "ring"];
const BESIDE: [&str; 8] = [
    "hand",
    "finger",
    "fingers",
    "proximal",
    "intermediate",
    "distal",
    "metacarpal",
    "tip",
];
const SIDES: [&str; 4] = ["left", "right", "l", "r"];
/// Segments of both legs, by CMU's names of joints.
const LEGS: [[&str; 3]; 2] = [
    ["lhipjoint", "lfemur", "ltibia"],
    ["rhipjoint", "rfemur", "rtibia"],
];

/// How well a skeleton fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitVerdict {
    /// The joints are where the points are.
    Good,
    /// Somebody has to look at it.
    Poor,
    /// This is not the motion of the points.
    Failed,
}

/// The fit of a skeleton to a take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitQuality {
    /// Mean distance of the driven joints from their points, cm.
    pub mean: f64,
    /// The length of the leg, cm; `None` where no frame tells it.
    pub leg: Option<f64>,
    /// The joints of the skeleton, without fingers and the like, and how many of them have points.
    pub joints: (usize, usize),
}

impl FitQuality {
    /// Whether it fits.
    ///
    /// ```
    /// use posing_joints::ik::{FitQuality, FitVerdict};
    ///
    /// // The joints are a millimeter from the points of somebody with legs of 90 cm.
    /// let fit = FitQuality { mean: 0.1, leg: Some(90.0), joints: (20, 20) };
    /// assert_eq!(fit.verdict(), FitVerdict::Good);
    /// assert_eq!(FitQuality { mean: 50.0, ..fit }.verdict(), FitVerdict::Failed);
    /// ```
    pub fn verdict(&self) -> FitVerdict {
        let over = |limit: (f64, f64)| !(self.mean <= self.limit(limit));
        match (over(FAILED), over(POOR) || self.is_partial()) {
            (true, _) => FitVerdict::Failed,
            (_, true) => FitVerdict::Poor,
            _ => FitVerdict::Good,
        }
    }

    /// Whether most of a whole body's skeleton has no points.
    pub fn is_partial(&self) -> bool {
        let (all, driven) = self.joints;
        all >= WHOLE_BODY && (driven as f64) < FEWEST_DRIVEN * all as f64
    }

    /// The mean distance over which a fit is poor, cm, and over which it is none.
    pub fn limits(&self) -> [f64; 2] {
        [self.limit(POOR), self.limit(FAILED)]
    }

    fn limit(&self, (share, most): (f64, f64)) -> f64 {
        self.leg.map_or(most, |leg| (share * leg).min(most))
    }
}

/// Whether a point of this name drives the skeleton: eyes, ears, heels and fingers do not.
pub fn drives(name: &str) -> bool {
    let mut words: Vec<String> = Vec::new();
    let letters: Vec<char> = name.chars().collect();
    for (i, &c) in letters.iter().enumerate() {
        let before = i.checked_sub(1).map(|b| letters[b]);
        let next = letters.get(i + 1);
        // LeftEar, LEar, l_ear: a capital begins a word, unless it goes on with capitals.
        let begins = c.is_uppercase()
            && (before.is_some_and(char::is_lowercase) || next.is_some_and(|n| n.is_lowercase()));
        let is_first = begins || before.is_none_or(|b| !b.is_alphabetic());
        match (c.is_alphabetic(), is_first, words.last_mut()) {
            (false, ..) => {}
            (_, false, Some(word)) => word.extend(c.to_lowercase()),
            _ => words.push(c.to_lowercase().collect()),
        }
    }
    let is_numbered = name.contains(|c: char| c.is_ascii_digit());
    let is_finger = |word: &str| {
        let mut others = words.iter().map(String::as_str).filter(|w| *w != word);
        // left_index: a tip.
        let is_alone = others.clone().all(|w| SIDES.contains(&w)) && words.len() > 1;
        is_numbered || is_alone || others.any(|w| BESIDE.contains(&w))
    };
    let hangs = |word: &String| {
        // CMU's lfingers, LHEEL; but "rear" is no ear of the right side.
        let own = word
            .strip_prefix(['l', 'r'])
            .filter(|w| !w.starts_with("ear"));
        let is_one_of =
            |all: &[&str]| all.contains(&word.as_str()) || own.is_some_and(|w| all.contains(&w));
        is_one_of(&HANGING) || is_one_of(&FINGERS) && is_finger(word)
    };
    !words.iter().any(hangs)
}

/// The length of the legs of a take, cm: by the names of its points, else half of the body's
/// largest extent; medians over the frames.
pub fn leg_length(poses: &Poses) -> Option<f64> {
    let naming = PointNaming::of(&poses.points, poses.xyz.view(), &joints::cmu_names());
    let names = naming.model_names(&poses.points);
    let at = |t: usize, p: usize| DVec3::from_array([0, 1, 2].map(|c| poses.xyz[[t, 3 * p + c]]));
    let leg = |leg: [&str; 3]| {
        let point = |name: &str| names.iter().position(|n| n == name);
        let [hip, knee, ankle] = [point(leg[0])?, point(leg[1])?, point(leg[2])?];
        let long = |t: usize| at(t, hip).distance(at(t, knee)) + at(t, knee).distance(at(t, ankle));
        let known = (0..poses.frames()).map(long).filter(|l| l.is_finite());
        median(known.collect())
    };
    let legs: Vec<f64> = LEGS.into_iter().filter_map(leg).collect();
    if !legs.is_empty() {
        return Some(legs.iter().sum::<f64>() / legs.len() as f64);
    }
    let extent = |t: usize| {
        let seen = (0..poses.points.len()).map(|p| at(t, p));
        let seen = seen.filter(|p| p.is_finite());
        let (low, high) = seen.fold((DVec3::MAX, DVec3::MIN), |(l, h), p| (l.min(p), h.max(p)));
        (high - low).max_element()
    };
    let known = (0..poses.frames()).map(extent).filter(|e| *e > 0.0);
    median(known.collect()).map(|size| LEG * size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn eyes_ears_heels_and_fingers_do_not_drive() {
        for name in [
            "LEar",
            "left_ear",
            "lfingers",
            "RightHandThumb1",
            "LHeel",
            "Bip01 L Finger0",
            "f_index.01.L",
            "RightInHandMiddle",
            "LeftEye",
            "LeftFingerBase",
            "LHEEL",
            "lthumb",
            "left_index",
            "LeftRingDistal",
            "lindex1",
        ] {
            assert!(!drives(name), "{name}");
        }
        for name in [
            "LeftForeArm",
            "lradius",
            "root",
            "Head",
            "RightUpLeg",
            "LShoulder",
            "learm",
            "Spine1",
            "RToe",
            "rear",
            "RearLeftThigh",
            "rear_foot",
            "SpineMiddle",
            "middle",
            "RingStrap",
        ] {
            assert!(drives(name), "{name}");
        }
    }

    #[test]
    fn the_smaller_limit_counts() {
        let of = |mean: f64, leg: f64| {
            let joints = (20, 20);
            FitQuality {
                mean,
                leg: Some(leg),
                joints,
            }
            .verdict()
        };
        let (good, poor, failed) = (FitVerdict::Good, FitVerdict::Poor, FitVerdict::Failed);
        assert_eq!(
            [of(1.9, 85.0), of(2.1, 85.0), of(10.5, 85.0)],
            [good, poor, failed]
        );
        assert_eq!(
            [of(0.04, 0.85), of(0.05, 0.85), of(0.3, 0.85)],
            [good, poor, failed]
        );
        assert_eq!(of(f64::NAN, 85.0), failed);
        let half = FitQuality {
            mean: 0.0,
            leg: Some(85.0),
            joints: (20, 9),
        };
        assert_eq!(half.verdict(), poor);
    }

    #[test]
    fn legs_are_known_by_names_or_half_of_a_body() {
        let names = ["LeftUpLeg", "LeftLeg", "LeftFoot", "nose"];
        let mut poses = Poses {
            points: names.map(String::from).to_vec(),
            xyz: Array2::zeros((1, 12)),
            ..Poses::default()
        };
        (poses.xyz[[0, 4]], poses.xyz[[0, 7]], poses.xyz[[0, 10]]) = (-40.0, -80.0, 90.0);
        assert_eq!(leg_length(&poses), Some(85.0));
        poses.points = ["lhipjoint", "lfemur", "ltibia", "head"]
            .map(String::from)
            .to_vec();
        assert_eq!(leg_length(&poses), Some(80.0));
        poses.xyz.fill(f64::NAN);
        assert_eq!(leg_length(&poses), None);
    }
}
