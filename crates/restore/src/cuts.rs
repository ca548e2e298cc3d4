//! Cuts in a take: frames at which the whole body jumps and stays. What was joined there are two
//! captures, and nothing is interpolated across.

use super::tuning::cuts::*;
use crate::numeric::statistics::median;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// The runs of a take (frames, 3 J; cm, NaN missing) divided where the body jumps. `rate`: frames a
/// second.
pub(crate) fn split_at_cuts(
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
) -> Vec<Range<usize>> {
    let jumps = Jumps::new(xyz, runs, rate);
    let back = ((BACK * rate) as usize).max(BACK_FRAMES);
    let mut out = Vec::new();
    for run in runs {
        let mut start = run.start;
        let mut t = run.start + 1;
        while t < run.end {
            let is_at_end = t - run.start <= back || run.end - t <= back;
            let least = if is_at_end { LEAST_AT_END } else { LEAST };
            let is_jump = |a, b| jumps.is_jump(a, b, run, least);
            // Dropouts are usual at cuts: the last frame that shows enough of the body counts.
            let seen = (start.max(t.saturating_sub(back + 1))..t).rev();
            let before = seen.clone().find(|&a| is_jump(a, t).is_some());
            if let Some(a) = before.filter(|&a| is_jump(a, t) == Some(true)) {
                let until = run.end.min(t + back + 1);
                let is_back = |s: &usize| {
                    is_jump(a, *s) == Some(false) && (!is_at_end || jumps.is_nearer(a, t, *s))
                };
                match (t + 1..until).find(is_back) {
                    Some(returned) => t = returned,
                    None => {
                        out.push(start..t);
                        start = t;
                    }
                }
            }
            t += 1;
        }
        out.push(start..run.end);
    }
    out
}

struct Jumps<'a> {
    xyz: ArrayView2<'a, f64>,
    /// Seconds a frame.
    step: f64,
    /// What the points do usually, cm.
    usual: f64,
}

impl<'a> Jumps<'a> {
    fn new(xyz: ArrayView2<'a, f64>, runs: &[Range<usize>], rate: f64) -> Jumps<'a> {
        let mut jumps = Jumps {
            xyz,
            step: 1.0 / rate,
            usual: 0.0,
        };
        let mut all = Vec::new();
        for run in runs {
            for t in run.start + 1..run.end {
                all.extend(jumps.deviations(t - 1, t, run));
            }
        }
        jumps.usual = median(all).unwrap_or(0.0);
        jumps
    }

    fn at(&self, t: usize, p: usize) -> DVec3 {
        DVec3::new(
            self.xyz[[t, 3 * p]],
            self.xyz[[t, 3 * p + 1]],
            self.xyz[[t, 3 * p + 2]],
        )
    }

    /// How far the points that are seen in frames a < b are from where they were, or from where
    /// their velocity leads, before a or after b, cm: the least. (Beside a jump, and at the end
    /// of a run, velocities there are unreliable.)
    fn deviations<'s>(
        &'s self,
        a: usize,
        b: usize,
        run: &'s Range<usize>,
    ) -> impl Iterator<Item = f64> + 's {
        let points = 0..self.xyz.ncols() / 3;
        points.filter_map(move |p| {
            let moved = self.at(b, p) - self.at(a, p);
            let before = (a > run.start).then(|| self.at(a, p) - self.at(a - 1, p));
            let after = (b + 1 < run.end).then(|| self.at(b + 1, p) - self.at(b, p));
            let known = [before, after].into_iter().flatten();
            let off = (known.filter(|v| v.is_finite()))
                .map(|v| (moved - v * (b - a) as f64).length())
                .fold(moved.length(), f64::min);
            Some(off).filter(|d| d.is_finite())
        })
    }

    /// Whether most points are nearer in frame c to where they are in a than to where they are in
    /// b: what has jumped less far than a body moves by c is not back.
    fn is_nearer(&self, a: usize, b: usize, c: usize) -> bool {
        let distances = (0..self.xyz.ncols() / 3).map(|p| {
            let now = self.at(c, p);
            [
                (now - self.at(a, p)).length(),
                (now - self.at(b, p)).length(),
            ]
        });
        let (mut nearer, mut all) = (0, 0);
        for [to_a, to_b] in distances.filter(|d| d.iter().all(|d| d.is_finite())) {
            nearer += usize::from(to_a < to_b);
            all += 1;
        }
        2 * nearer > all
    }

    /// Whether the body as a whole cannot have moved from where it is in frame a to where it is in
    /// b; `None` where they show too little of it.
    fn is_jump(&self, a: usize, b: usize, run: &Range<usize>, least: f64) -> Option<bool> {
        let seconds = (b - a) as f64 * self.step;
        let acceleration = if b - a == 1 { MOST } else { MOST_LONG };
        let most = least.max(UNUSUAL * self.usual) + acceleration * seconds * seconds;
        let all: Vec<f64> = self.deviations(a, b, run).collect();
        let far = all.iter().filter(|d| **d > most).count();
        (all.len() >= POINTS).then_some(far as f64 >= SHARE * all.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// Five points that swing, 100 frames a second.
    fn swing(frames: usize) -> Array2<f64> {
        Array2::from_shape_fn((frames, 15), |(t, i)| {
            60.0 * (0.05 * t as f64 + i as f64).sin() + 10.0 * i as f64
        })
    }

    fn of(xyz: &Array2<f64>) -> Vec<Range<usize>> {
        let all = 0..xyz.nrows();
        split_at_cuts(xyz.view(), std::slice::from_ref(&all), 100.0)
    }

    #[test]
    fn a_body_that_jumps_and_stays_starts_a_run() {
        let mut xyz = swing(100);
        xyz.slice_mut(ndarray::s![40.., ..])
            .mapv_inplace(|v| v + 30.0);
        xyz.slice_mut(ndarray::s![99.., ..])
            .mapv_inplace(|v| v + 30.0);
        assert_eq!(of(&xyz), [0..40, 40..99, 99..100]);
        // A dropout at the cut, and one behind it.
        xyz.slice_mut(ndarray::s![39..40, ..]).fill(f64::NAN);
        xyz.slice_mut(ndarray::s![42..43, ..]).fill(f64::NAN);
        assert_eq!(of(&xyz), [0..40, 40..99, 99..100]);
    }

    #[test]
    fn a_pose_before_the_take_is_cut_off_though_some_points_are_near() {
        // Another pose about a point that stays: points are 1 to 22 cm away.
        for other in [0..1, 0..2, 99..100, 98..100] {
            let mut xyz = swing(100);
            for t in other.clone() {
                for p in 0..5 {
                    let off = [1.0, 8.0, 12.0, 17.0, 22.0][p];
                    xyz[[t, 3 * p + 1]] += off;
                }
            }
            let wanted = match other.start {
                0 => [0..other.end, other.end..100],
                start => [0..start, start..100],
            };
            assert_eq!(of(&xyz), wanted);
        }
    }

    #[test]
    fn one_that_comes_back_a_fast_one_and_a_point_alone_do_not() {
        let mut xyz = swing(100);
        xyz.slice_mut(ndarray::s![40..43, ..])
            .mapv_inplace(|v| v + 30.0);
        xyz.slice_mut(ndarray::s![70.., ..6])
            .mapv_inplace(|v| v + 30.0);
        assert_eq!(of(&xyz), std::slice::from_ref(&(0..100)));
        // A stop within a frame, at 10 m/s.
        let fast = Array2::from_shape_fn((100, 15), |(t, i)| 10.0 * t.min(50) as f64 + i as f64);
        assert_eq!(of(&fast), std::slice::from_ref(&(0..100)));
    }
}
