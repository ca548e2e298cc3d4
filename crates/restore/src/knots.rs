//! Frames of a take that are estimated, and those between them: poses of neighboring frames are
//! alike, and what a model corrects of them is so all the more.

use super::tuning::knots::PER_SECOND;
use std::ops::Range;

/// The frames of a take that are estimated.
pub(crate) struct Knots {
    /// The frames, in their order.
    pub frames: Vec<usize>,
    /// For each frame of the take the knots on either side of it, as indices in `frames`, and how
    /// far it is from the first to the second; `None` outside of all runs.
    beside: Vec<Option<([usize; 2], f64)>>,
}

impl Knots {
    /// The knots of `frames` frames with these runs, at `rate` frames a second.
    pub(crate) fn new(frames: usize, runs: &[Range<usize>], rate: f64) -> Knots {
        let step = ((rate / PER_SECOND) as usize).max(1);
        let mut out = Knots {
            frames: Vec::new(),
            beside: vec![None; frames],
        };
        for run in runs {
            let first = out.frames.len();
            out.frames.extend(run.clone().step_by(step));
            let last = run.end.saturating_sub(1);
            if out.frames[first..].last().is_some_and(|t| *t < last) {
                out.frames.push(last);
            }
            for k in first..out.frames.len() {
                let next = (k + 1).min(out.frames.len() - 1);
                let [from, to] = [k, next].map(|k| out.frames[k]);
                for t in from..to.max(from + 1) {
                    let share = (t - from) as f64 / (to - from).max(1) as f64;
                    out.beside[t] = Some(([k, next], share));
                }
            }
        }
        out
    }

    /// The nearer of the knots beside a frame that are `known`.
    pub(crate) fn nearest(&self, frame: usize, known: impl Fn(usize) -> bool) -> Option<usize> {
        let ([before, after], share) = self.beside[frame]?;
        let both = if share <= 0.5 {
            [before, after]
        } else {
            [after, before]
        };
        both.into_iter().find(|k| known(*k))
    }

    /// A value of a frame between those of the knots, `None` where these have none.
    pub(crate) fn between<V>(
        &self,
        frame: usize,
        at: impl Fn(usize) -> Option<V>,
        lerp: impl Fn(V, V, f64) -> V,
    ) -> Option<V> {
        let ([before, after], share) = self.beside[frame]?;
        match (at(before), at(after)) {
            (Some(a), Some(b)) => Some(lerp(a, b, share)),
            (one, other) => one.or(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_lie_between_knots_of_their_run() {
        let knots = Knots::new(12, &[0..5, 5..6, 7..12], 2.0 * PER_SECOND);
        assert_eq!(knots.frames, [0, 2, 4, 5, 7, 9, 11]);
        let value = |t: usize| {
            let at = |k: usize| Some(10.0 * knots.frames[k] as f64);
            knots.between(t, at, |a, b, share| a + share * (b - a))
        };
        for t in (0..12).filter(|t| *t != 6) {
            assert_eq!(value(t), Some(10.0 * t as f64));
        }
        assert_eq!((value(6), knots.nearest(6, |_| true)), (None, None));
        let at = |known: &dyn Fn(usize) -> bool| knots.nearest(10, known).map(|k| knots.frames[k]);
        assert_eq!((at(&|_| true), at(&|k| k > 5)), (Some(9), Some(11)));
        let all = Knots::new(3, std::slice::from_ref(&(0..3)), 30.0);
        assert_eq!(all.frames, [0, 1, 2]);
    }
}
