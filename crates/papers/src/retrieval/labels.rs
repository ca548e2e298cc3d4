//! Rules that label pairs of poses instead of people. Every report names the rule that it
//! used.

use super::takes::TakeSet;
use crate::metric::blend_test::BlendQuality;
use crate::metric::cross_fade::CrossFade;
use crate::metric::{FrameRef, LabeledPair};
use crate::numeric::parallel;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// The mean distance of joints, (35), up to which poses of different actions are hard to tell
/// apart, body heights: 15 cm.
const NEAR: f64 = 0.09;
/// Draws for one pair, at most.
const TRIES: usize = 2000;
/// The length of a cross-fade, seconds.
const FADE: f64 = 0.3;

/// A rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LabelRule {
    /// Alike: one action by two people, at the same share of its time. Not alike: different
    /// actions.
    Class,
    /// Alike: one action in two takes at the same share of its time. Not alike: near poses of
    /// different actions, or of one action while it moves the other way.
    Phase,
    /// Alike: going over from one clip to the other there keeps bone lengths, planted feet and
    /// accelerations within the clips' own ranges. Not alike: it does not, though the poses are
    /// near.
    Blend,
}

names!(LabelRule {
    Class = "class",
    Phase = "phase",
    Blend = "blend",
});

impl LabelRule {
    /// What it calls alike, and what not.
    pub(crate) fn describe(self) -> &'static str {
        match self {
            LabelRule::Class => {
                "alike: one action by two people at the same share of its time; not alike: \
                 different actions"
            }
            LabelRule::Phase => {
                "alike: one action in two takes at the same share of its time; not alike: near \
                 poses of different actions, or of one action moving the other way"
            }
            LabelRule::Blend => {
                "alike: a cross-fade of .3 s there keeps bone lengths, planted feet and \
                 accelerations within the clips' own ranges; not alike: near poses where it does \
                 not"
            }
        }
    }

    /// Seconds about a labeled frame for which the label holds.
    pub(crate) fn reach(self) -> f64 {
        match self {
            LabelRule::Class => 1.0,
            LabelRule::Phase => 0.2,
            LabelRule::Blend => 0.0,
        }
    }

    /// Up to `count` pairs of each label among different takes, and the same number of both.
    pub(crate) fn label(self, set: &TakeSet, count: usize, seed: u64) -> Vec<LabeledPair> {
        let mut rng = parallel::rng(seed, self as u64);
        let mut labeled: [Vec<LabeledPair>; 2] = Default::default();
        for is_alike in [true, false] {
            for _ in 0..count {
                if let Some(ends) = self.draw(set, is_alike, &mut rng) {
                    labeled[usize::from(is_alike)].push(LabeledPair { ends, is_alike });
                }
            }
        }
        let each = labeled[0].len().min(labeled[1].len());
        labeled.iter().flat_map(|l| &l[..each]).copied().collect()
    }

    fn draw(self, set: &TakeSet, is_alike: bool, rng: &mut ChaCha8Rng) -> Option<[FrameRef; 2]> {
        if set.takes.len() < 2 {
            return None;
        }
        (0..TRIES).find_map(|_| {
            let takes = [0, 1].map(|_| rng.random_range(0..set.takes.len()));
            let [a, b] = takes;
            let share: f64 = rng.random_range(0.0..1.0);
            let last = takes.map(|t| set.takes[t].frames() - 1);
            let same = last.map(|last| (share * last as f64) as usize);
            let any = last.map(|last| rng.random_range(0..=last));
            let is_class = set.about[a].class == set.about[b].class;
            let is_other = set.about[a].subject != set.about[b].subject;
            let ends = |frames: [usize; 2]| {
                [0, 1].map(|k| FrameRef {
                    take: takes[k],
                    frame: frames[k],
                })
            };
            let chosen = match (self, is_alike) {
                (LabelRule::Class, true) => (is_class && is_other).then(|| ends(same)),
                (LabelRule::Class, false) => (!is_class).then(|| ends(any)),
                (LabelRule::Phase, true) => (is_class && a != b).then(|| ends(same)),
                (LabelRule::Phase, false) => {
                    let ends = ends(any);
                    let is_opposite = || is_class && moves_the_other_way(set, ends);
                    (a != b && is_near(set, ends) && (!is_class || is_opposite())).then_some(ends)
                }
                (LabelRule::Blend, _) => {
                    let ends = ends(any);
                    let is_good = || blends_well(set, ends);
                    (a != b && is_near(set, ends) && is_good()? == is_alike).then_some(ends)
                }
            };
            chosen.filter(|ends| is_complete(set, *ends))
        })
    }
}

/// Whether both poses show all joints.
fn is_complete(set: &TakeSet, ends: [FrameRef; 2]) -> bool {
    (ends.iter()).all(|e| {
        set.takes[e.take]
            .frame(e.frame)
            .iter()
            .all(|j| j.is_finite())
    })
}

/// Whether the mean distance of joints is small.
fn is_near(set: &TakeSet, [a, b]: [FrameRef; 2]) -> bool {
    let joints = set.takes[a.take].frame(a.frame);
    let others = set.takes[b.take].frame(b.frame);
    let sum: f64 = (joints.iter().zip(others))
        .map(|(a, b)| (*a - b).length())
        .sum();
    sum < 16.0 * NEAR
}

/// Whether the joints' velocities point against each other.
fn moves_the_other_way(set: &TakeSet, ends: [FrameRef; 2]) -> bool {
    let [a, b] = ends.map(|end| {
        let take = &set.takes[end.take];
        let run = take.run_of(end.frame);
        let before = take.frame(end.frame.saturating_sub(1).max(run.start));
        let after = take.frame((end.frame + 1).min(run.end - 1));
        std::array::from_fn::<_, 16, _>(|j| after[j] - before[j])
    });
    a.iter().zip(&b).map(|(a, b)| a.dot(*b)).sum::<f64>() < 0.0
}

/// Whether a cross-fade there stays within the clips' own ranges; `None` where there is no room for
/// one.
fn blends_well(set: &TakeSet, [a, b]: [FrameRef; 2]) -> Option<bool> {
    let clips = [&set.clips[a.take], &set.clips[b.take]];
    if clips[0].rate != clips[1].rate {
        return None;
    }
    let half = clips[0].frames_in(FADE / 2.0);
    let has_room = |k: usize, frame: usize| clips[k].can_fade(half)[frame];
    if !has_room(0, a.frame) || !has_room(1, b.frame) {
        return None;
    }
    let blend = CrossFade::new(clips, [a.frame, b.frame], half);
    let ranges = [&set.ranges[a.take], &set.ranges[b.take]];
    Some(BlendQuality::measure(&blend, ranges).is_good())
}
