//! One frame restored: placed, fitted, answered. The one function behind `denoise` and `complete`.

use super::planar;
use super::synthesis::{Observed, Synthesis};
use crate::pose::{Anchor, Similarity, Status};
use crate::prior::{EXACT, Prior};
use glam::DVec3;
use ndarray::Array2;

/// A restored frame, where the capture stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Restored {
    /// 3 J numbers, cm.
    pub mean: Vec<f64>,
    /// The standard deviation of a coordinate of each point, cm (J).
    pub sd: Vec<f64>,
    /// Where the model's space stands.
    pub placement: Similarity,
}

/// Restored frames, in the model's order of points.
#[derive(Debug, Clone, Default)]
pub struct Restoration {
    /// (frames, 3 J), cm.
    pub xyz: Array2<f64>,
    /// One a frame and point (frames x J).
    pub status: Vec<Status>,
    /// Standard deviation of a coordinate, cm (frames x J); NaN where unknown.
    pub sd: Vec<f64>,
    /// Frames in which too little was seen.
    pub too_little: usize,
    /// The noise that was assumed, cm: its mean over the frames.
    pub noise: f64,
}

impl Restoration {
    /// Frames as they were captured.
    pub fn of(xyz: Array2<f64>) -> Restoration {
        let count = xyz.nrows() * xyz.ncols() / 3;
        let sd = vec![EXACT.sqrt(); count];
        Restoration {
            xyz,
            status: vec![Status::Observed; count],
            sd,
            too_little: 0,
            noise: 0.0,
        }
    }
    /// How many points a frame has.
    pub fn points(&self) -> usize {
        self.xyz.ncols() / 3
    }
    /// Sets what became of a point.
    pub fn set(&mut self, frame: usize, point: usize, status: Status, sd: f64) {
        let at = frame * self.points() + point;
        self.status[at] = status;
        self.sd[at] = sd;
    }
    /// What became of a point, and how sure it is.
    pub fn of_point(&self, frame: usize, point: usize) -> (Status, f64) {
        let at = frame * self.points() + point;
        (self.status[at], self.sd[at])
    }
}

/// Restores frames with one prior.
pub struct Restorer<'a> {
    /// What poses look like, for the captured body.
    pub prior: &'a dyn Prior,
    /// What poses are placed by; `None` uses rows as they are.
    pub anchor: Option<&'a Anchor>,
    /// How P1 is solved.
    pub synthesis: Synthesis,
}

/// A pelvis this noisy (variance of a coordinate, cm²) gives no heading worth starting from alone.
const NOISY: f64 = 0.25;

impl Restorer<'_> {
    /// Restores one frame: 3 J numbers and the variance of each one's noise (infinite where missing).
    ///
    /// `None` when too little is seen: no point at all; or in world space fewer than three, or all on a line.
    pub fn restore(&self, y: &[f64], noise: &[f64]) -> Option<Restored> {
        let seen = Observed { y, noise };
        let Some(anchor) = self.anchor else {
            noise.iter().any(|n| n.is_finite()).then_some(())?;
            return Some(self.in_place(seen));
        };
        if seen.is_partial() {
            return planar::restore(self.prior, seen, &self.synthesis);
        }
        let visible: Vec<f64> = y
            .iter()
            .zip(noise)
            .map(|(y, n)| if *n <= NOISY { *y } else { f64::NAN })
            .collect();
        let known = anchor.place(&visible);
        if known == Some(Similarity::IDENTITY) {
            return Some(self.in_place(seen));
        }
        let solution = self
            .synthesis
            .solve(self.prior, seen, anchor, known.as_slice())?;
        let placement = solution.placement;
        let mut back = vec![0.0; y.len()];
        placement.undo_pose(y, &mut back);
        let noise = super::synthesis::pointwise(noise);
        let posterior = self.prior.posterior(&back, &noise, &solution.fit);
        let mut mean = vec![0.0; y.len()];
        placement.apply_pose(&posterior.mean, &mut mean);
        Some(Restored {
            mean,
            sd: point_sd(&posterior.variance),
            placement,
        })
    }

    fn in_place(&self, seen: Observed<'_>) -> Restored {
        let fit = self.prior.fit(seen.y, seen.noise, None);
        let posterior = self.prior.posterior(seen.y, seen.noise, &fit);
        Restored {
            sd: point_sd(&posterior.variance),
            mean: posterior.mean,
            placement: Similarity::IDENTITY,
        }
    }
}

/// The standard deviation of a coordinate of each point: the root of the mean of its variances.
pub fn point_sd(variance: &[f64]) -> Vec<f64> {
    variance
        .chunks_exact(3)
        .map(|v| (v.iter().sum::<f64>() / 3.0).sqrt())
        .collect()
}

/// How far a point was moved, cm.
pub fn moved(a: &[f64], b: &[f64], point: usize) -> f64 {
    (DVec3::from_slice(&a[3 * point..]) - DVec3::from_slice(&b[3 * point..])).length()
}
