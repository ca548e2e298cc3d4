//! All pairs of poses that are near each other; of very many a random share is kept.

use super::{APART, LOOKS, PairRules, SAME_POSE, TIME_EPSILON, TakeFrame};
use crate::body_frame::BodyFramePoses;
use crate::joint_map::joint::*;
use crate::numeric::parallel;

/// The distances below `near` fall into this many equal classes.
pub(crate) const CLASSES: usize = 10;
/// Candidates kept in each class for each pair to propose. One proposed pair rules out at most 49
/// others (7 x 7, where a second has under 15 looked-at poses), so a full class alone has enough.
const KEPT: usize = 100;
/// Rows of the table of pairs that are searched before candidates are thinned, and that one thread
/// searches at a time.
const ROWS: usize = 256;
const THREAD_ROWS: usize = 8;

/// The outer joints of each limb.
const LIMBS: [[usize; 2]; 4] = [
    [LELBOW, LHAND],
    [RELBOW, RHAND],
    [LKNEE, LFOOT],
    [RKNEE, RFOOT],
];

/// A pose that is looked at.
pub(crate) struct SamplePose {
    /// Where it comes from.
    pub at: TakeFrame,
    /// Seconds since its take began.
    pub time: f64,
    /// x of all joints, then y, then z, cm.
    joints: [[f64; 16]; 3],
}

/// The sums of the joints of each of the [`LIMBS`]: x of all limbs, then y, then z, cm.
type LimbSums = [[f64; 4]; 3];

/// The poses that are looked at, take after take.
pub(crate) struct Sample {
    /// The poses.
    pub poses: Vec<SamplePose>,
    /// Number of poses of each take.
    pub counts: Vec<usize>,
    /// Sums of each pose.
    limbs: Vec<LimbSums>,
}

impl Sample {
    /// About [`LOOKS`] complete poses a second, each with `margin` seconds of its run before and
    /// after it, scaled to bodies of `height` cm.
    pub(crate) fn new(takes: &[BodyFramePoses], rates: &[f64], height: f64, margin: f64) -> Sample {
        let mut poses = Vec::new();
        let mut counts = Vec::new();
        for (take, (motion, rate)) in takes.iter().zip(rates).enumerate() {
            let before = poses.len();
            let step = ((rate / LOOKS).round() as usize).max(1);
            let margin = (margin * rate - 1e-6).ceil() as usize;
            for run in &motion.runs {
                let usable = run.start + margin..run.end.saturating_sub(margin);
                poses.extend(usable.step_by(step).filter_map(|frame| {
                    let pose = motion.frame(frame);
                    let axis = |axis: usize| pose.map(|joint| height * joint[axis]);
                    let is_whole = pose.iter().all(|joint| joint.is_finite());
                    is_whole.then(|| SamplePose {
                        at: TakeFrame { take, frame },
                        time: frame as f64 / rate,
                        joints: [axis(0), axis(1), axis(2)],
                    })
                }));
            }
            counts.push(poses.len() - before);
        }
        let limbs = poses.iter().map(SamplePose::limb_sums).collect();
        Sample {
            poses,
            counts,
            limbs,
        }
    }
}

impl SamplePose {
    fn limb_sums(&self) -> LimbSums {
        self.joints.map(|x| LIMBS.map(|[j, k]| x[j] + x[k]))
    }
}

/// The lengths of n differences, cm, added up.
fn total_length<const N: usize>(a: &[[f64; N]; 3], b: &[[f64; N]; 3]) -> f64 {
    let mut lengths = [0.0; N];
    for (k, length) in lengths.iter_mut().enumerate() {
        let d = [a[0][k] - b[0][k], a[1][k] - b[1][k], a[2][k] - b[2][k]];
        *length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    }
    lengths.iter().sum()
}

impl Sample {
    /// The mean joint distance of two poses, cm (equation 35), if it is below `near`.
    fn distance(&self, i: usize, j: usize, near: f64) -> Option<f64> {
        // A limb's sums differ by no more than its joints do: most pairs are too far apart by their
        // limbs alone.
        if !(total_length(&self.limbs[i], &self.limbs[j]) < 16.0 * near) {
            return None;
        }
        let mean = total_length(&self.poses[i].joints, &self.poses[j].joints) / 16.0;
        (mean < near).then_some(mean)
    }
}

/// A pair of looked-at poses that may be proposed.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// The rank of the pair in the random choice; low is chosen first.
    pub rank: f64,
    /// Index of one pose.
    pub a: u32,
    /// Index of the other pose.
    pub b: u32,
    /// Their distance, cm.
    pub distance: f64,
}

impl Candidate {
    /// The order of the choice; no two candidates are equal in it.
    pub(crate) fn order(&self, other: &Candidate) -> std::cmp::Ordering {
        let poses = |c: &Candidate| (c.a, c.b);
        (self.rank.total_cmp(&other.rank)).then(poses(self).cmp(&poses(other)))
    }
}

/// The candidates of a sample.
pub(crate) struct Found {
    /// Candidates by class of distance, in the order of the choice.
    pub classes: [Vec<Candidate>; CLASSES],
    /// The number of candidates before they were thinned.
    pub count: u64,
}

impl Found {
    /// Searches all pairs.
    pub(crate) fn search(sample: &Sample, rules: &PairRules) -> Found {
        let kept = KEPT * rules.count;
        let mut found = Found {
            classes: Default::default(),
            count: 0,
        };
        let rows = sample.poses.len();
        for first in (0..rows).step_by(ROWS) {
            let limits = found.classes.each_ref().map(|class| match class.len() {
                n if n >= kept => class[kept - 1].rank,
                _ => f64::INFINITY,
            });
            let parts = parallel::map_chunks(ROWS.min(rows - first), THREAD_ROWS, |range| {
                rows_of(
                    sample,
                    rules,
                    first + range.start..first + range.end,
                    &limits,
                )
            });
            for part in parts {
                found.count += part.count;
                for (class, more) in found.classes.iter_mut().zip(part.classes) {
                    class.extend(more);
                }
            }
            for class in &mut found.classes {
                class.sort_unstable_by(Candidate::order);
                class.truncate(kept);
            }
        }
        found
    }
}

/// The candidates whose pose `a` is one of `rows`; only those whose rank is at most the limit of
/// their class.
fn rows_of(
    sample: &Sample,
    rules: &PairRules,
    rows: std::ops::Range<usize>,
    limits: &[f64; CLASSES],
) -> Found {
    let mut found = Found {
        classes: Default::default(),
        count: 0,
    };
    for i in rows {
        let a = &sample.poses[i];
        for (j, b) in sample.poses.iter().enumerate().skip(i + 1) {
            let same_take = a.at.take == b.at.take;
            if same_take && (rules.other_takes || b.time - a.time < APART - TIME_EPSILON) {
                continue;
            }
            let distance = sample.distance(i, j, rules.near);
            let Some(distance) = distance.filter(|d| *d >= SAME_POSE) else {
                continue;
            };
            found.count += 1;
            // Divided by the number of pairs of both takes, so that long takes are not chosen more
            // often than short ones.
            let pairs = sample.counts[a.at.take] * sample.counts[b.at.take];
            let rank = -uniform(rules.seed, i as u64, j as u64).ln() * pairs as f64;
            let class = ((distance / rules.near * CLASSES as f64) as usize).min(CLASSES - 1);
            if rank <= limits[class] {
                found.classes[class].push(Candidate {
                    rank,
                    a: i as u32,
                    b: j as u32,
                    distance,
                });
            }
        }
    }
    found
}

/// A number above 0 to 1 that depends on the three alone (splitmix64).
fn uniform(seed: u64, i: u64, j: u64) -> f64 {
    let mix = |mut z: u64| {
        z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let bits = mix(mix(mix(seed) ^ i) ^ j) >> 11;
    (bits + 1) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::{own_names, standing, take_of};

    #[test]
    fn the_distance_is_that_of_equation_35() {
        let mut moved = standing();
        moved[LHAND].y += 16.0;
        moved[RFOOT].z += 32.0;
        // Two of three, so that the body's height is that of the person who stands.
        let take = take_of(&[standing(), moved, standing()]);
        let take = BodyFramePoses::new(&take, Some(10.0), &own_names()).unwrap();
        let sample = Sample::new(&[take], &[10.0], 160.0, 0.0);
        let distance = |near| sample.distance(0, 1, near);
        assert!((distance(10.0).unwrap() - 3.0).abs() < 1e-9);
        assert!(distance(3.1).is_some() && distance(2.9).is_none());
        // The same bodies at another size.
        let small = take_of(&[standing(), moved, standing()].map(|pose| pose.map(|p| p / 2.0)));
        let small = BodyFramePoses::new(&small, Some(10.0), &own_names()).unwrap();
        let sample = Sample::new(&[small], &[10.0], 160.0, 0.0);
        assert!((sample.distance(0, 1, 10.0).unwrap() - 3.0).abs() < 1e-9);
    }

    #[test]
    fn uniform_numbers_are_spread() {
        let all: Vec<f64> = (0..10_000).map(|i| uniform(3, i / 100, i % 100)).collect();
        assert!(all.iter().all(|u| *u > 0.0 && *u <= 1.0));
        let mean = all.iter().sum::<f64>() / 1e4;
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
    }
}
