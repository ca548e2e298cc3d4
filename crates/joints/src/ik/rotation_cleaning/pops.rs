//! Pops: rotations that leave their path for a frame or some, and come back: faster than a body, or
//! farther than the joint moves anywhere else in the take. A step of a foot lasts for two frames of
//! a take of 24 a second.

use super::movement::Movable;
use super::tuning::*;
use crate::numeric::pchip::pchip;
use crate::numeric::statistics::median;
use glam::DQuat;
use std::ops::Range;

/// The frames of pops, in runs. Frames that are not `seen` have no pops; `rate`: frames a second.
pub(super) fn pops(rotations: &[DQuat], seen: &[bool], rate: f64) -> Vec<Range<usize>> {
    let frames = rotations.len();
    let between = |a: usize, b: usize| {
        if seen[a] && seen[b] {
            rotations[a].step_to(rotations[b]).length()
        } else {
            f64::NAN
        }
    };
    // The step to each frame.
    let mut steps = vec![f64::NAN; frames];
    (1..frames).for_each(|t| steps[t] = between(t - 1, t));
    let longest = POP_FRAMES.max((POP_SECONDS * rate) as usize);
    let is_pop = |run: &Range<usize>| {
        let least = steps[run.start].min(steps[run.end]);
        let (before, after) = (run.start.saturating_sub(AROUND), run.end + 1);
        let around = (before..run.start).chain(after..(after + AROUND).min(frames));
        let around: Vec<f64> = around.map(|t| steps[t]).collect();
        let around: Vec<f64> = around.into_iter().filter(|s| s.is_finite()).collect();
        let largest = around.iter().copied().fold(0.0, f64::max);
        let is_known = around.len() >= LEAST_AROUND;
        let Some(usual) = median(around).filter(|_| is_known) else {
            return false;
        };
        least > TIMES_MEDIAN * usual.max(LEAST_MEDIAN)
            && least > TIMES_LARGEST * largest
            && between(run.start - 1, run.end) < POP_RETURN * least + (run.len() + 1) as f64 * usual
    };
    let (mut out, mut t) = (Vec::new(), 1);
    while t < frames {
        let ends = (t + 1..frames.min(t + longest + 1)).filter(|&end| steps[end] >= POP_STEP);
        let mut runs = ends.map(|end| t..end);
        match runs.find(|run| steps[t] >= POP_STEP && is_pop(run)) {
            Some(run) => {
                t = run.end + 1;
                out.push(run);
            }
            None => t += 1,
        }
    }
    // The largest step that leads to none of them, nor back.
    let mut others = steps.clone();
    for run in &out {
        (others[run.start], others[run.end]) = (0.0, 0.0);
    }
    let largest = others.into_iter().fold(0.0, f64::max);
    out.retain(|run| {
        let is_fast = (run.len() + 1) as f64 <= POP_FAST * rate;
        let is_unique = steps[run.start].min(steps[run.end]) > POP_UNIQUE * largest;
        is_fast || is_unique && frames >= POP_FRAMES_OF_TAKE
    });
    out
}

/// Puts rotations on a smooth path (PCHIP) through the `kept` frames at all that are not.
pub(super) fn bridge(rotations: &mut [DQuat], kept: &[bool]) {
    let frames = |is: bool| (0..kept.len()).filter(move |t| kept[*t] == is);
    // A pop of half a turn may have turned the signs of what follows it.
    let mut before: Option<DQuat> = None;
    for t in frames(true) {
        if before.is_some_and(|q| q.dot(rotations[t]) < 0.0) {
            rotations[t] = -rotations[t];
        }
        before = Some(rotations[t]);
    }
    let x: Vec<f64> = frames(true).map(|t| t as f64).collect();
    let (Some(first), Some(last)) = (x.first().copied(), x.last().copied()) else {
        return;
    };
    let at: Vec<f64> = frames(false)
        .map(|t| (t as f64).clamp(first, last))
        .collect();
    let paths = [0, 1, 2, 3].map(|c| {
        let y: Vec<f64> = frames(true).map(|t| rotations[t].to_array()[c]).collect();
        pchip(&x, &y, &at)
    });
    for (i, t) in frames(false).enumerate() {
        let q = DQuat::from_array([0, 1, 2, 3].map(|c| paths[c][i]));
        if q.length() > 1e-3 {
            rotations[t] = q.normalize();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A joint that swings.
    fn swing(frames: usize) -> Vec<DQuat> {
        let at = |t: usize| DQuat::from_rotation_x((0.05 * t as f64).sin());
        (0..frames).map(at).collect()
    }

    #[test]
    fn pops_are_found_and_bridged_and_a_fast_motion_is_none() {
        let truth = swing(120);
        let mut popped = truth.clone();
        let turn = DQuat::from_scaled_axis(DVec3::new(0.5, 0.4, -0.6));
        for t in [20, 50, 51, 118] {
            popped[t] *= turn;
        }
        let found = pops(&popped, &[true; 120], 60.0);
        assert_eq!(found, [20..21, 50..52, 118..119]);
        let kept: Vec<bool> = (0..120)
            .map(|t| !found.iter().any(|r| r.contains(&t)))
            .collect();
        bridge(&mut popped, &kept);
        for t in [20, 50, 51, 118] {
            assert!(popped[t].step_to(truth[t]).length() < 0.01, "{t}");
        }
        assert!(pops(&truth, &[true; 120], 60.0).is_empty());
        // A jump without return.
        let jump: Vec<DQuat> = (0..60)
            .map(|t| if t < 30 { truth[0] } else { turn })
            .collect();
        assert!(pops(&jump, &[true; 60], 60.0).is_empty());
        for frames in 0..4 {
            assert!(pops(&truth[..frames], &vec![true; frames], 60.0).is_empty());
        }
    }

    #[test]
    fn frames_that_are_not_seen_have_no_pops() {
        let mut rotations = swing(60);
        rotations[30] = DQuat::from_rotation_z(2.0);
        let mut seen = vec![true; 60];
        seen[30] = false;
        assert!(pops(&rotations, &seen, 30.0).is_empty());
        bridge(&mut rotations, &[false; 60]);
        assert!(rotations[30].z > 0.5);
    }
}
