//! One frame to be scored, and where runs of frames begin.

use std::sync::Arc;

/// One frame to be scored: 3 J numbers each in centimetres, NaN is missing, points in equal order.
#[derive(Debug, Clone, Copy)]
pub struct ScoredFrame<'a> {
    /// The true pose.
    pub truth: &'a [f64],
    /// The pose to be scored.
    pub result: &'a [f64],
    /// The pose that the result was made from.
    pub damaged: Option<&'a [f64]>,
    /// Whether this frame does not follow the previous one: see [`RunDetector`].
    pub starts_run: bool,
    /// Frames a second of the take, if known.
    pub rate: Option<f64>,
}

/// Finds the frames that do not follow the previous one: a new take, a time that does not increase, a step of more than
/// 1.5 frames. The rule is that of [`crate::pose::Poses::runs`], for frames that come one at a time.
#[derive(Debug, Clone, Default)]
pub struct RunDetector {
    last: Option<(Option<f64>, Option<Arc<str>>)>,
}

impl RunDetector {
    /// Whether the next frame starts a run; the first one does. `rate` is that of the frame's take, if known.
    pub fn starts(
        &mut self,
        time: Option<f64>,
        take: &Option<Arc<str>>,
        rate: Option<f64>,
    ) -> bool {
        let last = self.last.replace((time, take.clone()));
        let Some((last_time, last_take)) = last else {
            return true;
        };
        let follows = match (last_time, time) {
            (Some(a), Some(b)) => b > a && rate.is_none_or(|rate| b - a <= 1.5 / rate),
            _ => true,
        };
        !follows || last_take != *take
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Poses;

    #[test]
    fn runs_are_those_of_poses() {
        let time = vec![0.0, 0.1, 0.2, 0.4, 0.5, 0.1, 0.2, 0.3];
        let take: Vec<Arc<str>> = "aaaaaaab"
            .chars()
            .map(|c| Arc::from(c.to_string()))
            .collect();
        let poses = Poses {
            xyz: ndarray::Array2::zeros((8, 3)),
            time: Some(time.clone()),
            take: Some(take.clone()),
            ..Poses::default()
        };
        let mut runs = RunDetector::default();
        let starts: Vec<usize> = (0..8)
            .filter(|&i| runs.starts(Some(time[i]), &Some(take[i].clone()), poses.rate()))
            .collect();
        let want: Vec<usize> = poses.runs().iter().map(|r| r.start).collect();
        assert_eq!(starts, want);
        let mut bare = RunDetector::default();
        let rate = Some(1.0);
        assert!(bare.starts(None, &None, rate) && !bare.starts(None, &None, rate));
    }
}
