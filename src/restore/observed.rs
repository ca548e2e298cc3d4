//! What is seen of a pose.

use glam::DVec3;

/// So many whole points tell a pose: as many as the paper completes from.
const ENOUGH: usize = 6;

/// An observation: 3 J numbers with the variance of the noise of each; infinite where missing.
#[derive(Debug, Clone, Copy)]
pub struct Observed<'a> {
    /// Numbers, cm.
    pub y: &'a [f64],
    /// Variances, cm².
    pub noise: &'a [f64],
}

impl<'a> Observed<'a> {
    /// The points of which all three coordinates are observed, with their precision against `model` variances.
    pub fn points(
        &self,
        model: &'a [f64],
    ) -> impl Iterator<Item = (usize, DVec3, f64)> + Clone + 'a {
        let (y, noise) = (self.y, self.noise);
        (0..y.len() / 3).filter_map(move |j| {
            let variance: f64 = (3 * j..3 * j + 3).map(|c| noise[c] + model[c]).sum();
            variance
                .is_finite()
                .then(|| (j, DVec3::from_slice(&y[3 * j..]), 3.0 / variance))
        })
    }

    /// Whether some point is observed in part: the paper's 2-D input.
    pub fn is_partial(&self) -> bool {
        (0..self.noise.len() / 3).any(|p| self.is_in_part(p))
    }

    /// The noise where those points are not seen at all.
    pub fn noise_without(&self, points: &[usize]) -> Vec<f64> {
        let mut noise = self.noise.to_vec();
        for p in points {
            noise[3 * p..3 * p + 3].fill(f64::INFINITY);
        }
        noise
    }

    /// How many coordinates of a point are observed.
    fn count(&self, p: usize) -> usize {
        let point = &self.noise[3 * p..3 * p + 3];
        point.iter().filter(|v| v.is_finite()).count()
    }

    fn is_in_part(&self, p: usize) -> bool {
        matches!(self.count(p), 1 | 2)
    }

    /// The points observed in part, where no fewer and at least six are whole: those tell where the pose stands. A picture
    /// has none.
    pub fn parts_among_whole(&self) -> Vec<usize> {
        let points = 0..self.noise.len() / 3;
        let whole = points.clone().filter(|&p| self.count(p) == 3).count();
        let parts: Vec<usize> = points.filter(|&p| self.is_in_part(p)).collect();
        if whole >= ENOUGH.max(parts.len()) {
            parts
        } else {
            Vec::new()
        }
    }
}

/// The noise of whole points: turning a point mixes its coordinates, so each gets their mean.
pub(super) fn pointwise(noise: &[f64]) -> Vec<f64> {
    noise
        .chunks_exact(3)
        .flat_map(|n| [n.iter().sum::<f64>() / 3.0; 3])
        .collect()
}
