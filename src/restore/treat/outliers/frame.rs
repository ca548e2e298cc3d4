//! A frame some points of which may be corrupt: which are in doubt, and what the others are.

use super::super::bodies::Bodies;
use super::super::bones::{self, Look};
use crate::prior::pairs::RigidPairs;
use crate::prior::{Belief, EXACT};

/// Points less sure than this to be clean, or corrupt, are in doubt.
pub const SURE: f64 = 0.01;
/// At most so many points are hidden from the prior at a time.
pub const MOST: usize = 12;

/// What is known of a frame before the prior is asked.
pub struct Frame {
    /// 3 J numbers, cm.
    pub y: Vec<f64>,
    /// The variance of each number's noise where it is clean, cm²; infinite missing.
    pub told: Vec<f64>,
    /// What its distances tell.
    pub look: Look,
    /// In doubt, ascending.
    pub doubt: Vec<usize>,
    /// Corrupt, as far as it is decided.
    pub corrupt: Vec<bool>,
}

impl Frame {
    /// As far as the distances tell.
    pub fn new(pairs: &RigidPairs, bodies: &Bodies, y: Vec<f64>, mut told: Vec<f64>) -> Frame {
        for (t, y) in told.iter_mut().zip(&y) {
            if !y.is_finite() {
                *t = f64::INFINITY;
            }
        }
        let look = bones::look(pairs, bodies, &y, &told);
        let mut frame = Frame {
            corrupt: Vec::new(),
            doubt: Vec::new(),
            y,
            told,
            look,
        };
        frame.decide();
        frame
    }

    /// How many points it has.
    pub fn points(&self) -> usize {
        self.y.len() / 3
    }

    /// Decides what the distances and the log odds of each point by itself (−∞: it is not corrupt) leave no doubt of; of
    /// the rest, the [`MOST`] doubtful are in doubt; the others are what they more likely are.
    pub fn judge(&mut self, unary: &[f64]) {
        self.look.corrupt = self.look.marginals(unary);
        self.decide();
        if self.doubt.len() > MOST {
            let q = &self.look.corrupt;
            self.doubt
                .sort_by(|a, b| (q[*a] - 0.5).abs().total_cmp(&(q[*b] - 0.5).abs()));
            self.doubt.truncate(MOST);
            self.doubt.sort_unstable();
        }
    }

    fn decide(&mut self) {
        let q = &self.look.corrupt;
        self.corrupt = q.iter().map(|q| *q > 0.5).collect();
        self.doubt = (0..q.len())
            .filter(|&p| q[p] > SURE && q[p] < 1.0 - SURE)
            .collect();
    }

    /// What a model expects of the points that may be corrupt tells how far off they are: a distance tells that along itself
    /// alone, and a point may be far off and a distance of it right. But the variance of a coordinate is never above the square
    /// of the worst distance: a point whose distances are all right is no outlier where only the model does not expect it.
    /// Right of points that were hidden; one that is decided to be corrupt was shown with its slab, and is told too little of.
    pub fn expect(&mut self, expected: &Belief) {
        for p in 0..self.points() {
            let square =
                |i: usize| (self.y[i] - expected.mean[i]).powi(2) - expected.covariance[[i, i]];
            let off = (3 * p..3 * p + 3).map(square).sum::<f64>() / 3.0;
            if self.look.corrupt[p] > SURE && off.is_finite() {
                let slab = &mut self.look.slab[p];
                *slab = slab.max(off.min(self.look.farthest[p]));
            }
        }
    }

    /// The noise under an assignment; points in doubt are missing where there is none.
    pub fn noise(&self, assigned: Option<&[bool]>) -> Vec<f64> {
        let mut out: Vec<f64> = self.told.iter().map(|v| v.max(EXACT)).collect();
        let of = |p: usize| match (self.doubt.iter().position(|d| *d == p), assigned) {
            (Some(_), None) => f64::INFINITY,
            (Some(at), Some(z)) if z[at] => self.look.slab[p],
            (None, _) if self.corrupt[p] => self.look.slab[p],
            _ => 0.0,
        };
        for p in 0..out.len() / 3 {
            let least = of(p);
            out[3 * p..3 * p + 3]
                .iter_mut()
                .for_each(|v| *v = v.max(least));
        }
        out
    }

    /// What the distances of a point that is taken for clean to clean ones tell, of those decided so far.
    pub fn clean_terms(&self, assigned: &[bool], p: usize) -> f64 {
        let clean = |q: usize| match self.doubt.iter().position(|d| *d == q) {
            _ if q == p => true,
            Some(at) => assigned.get(at).is_some_and(|z| !z),
            None => !self.corrupt[q],
        };
        let of = |t: &&bones::Term| t.ends.contains(&p) && t.ends.iter().all(|q| clean(*q));
        self.look.terms.iter().filter(of).map(|t| t.clean).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::pairs::Pair;
    use ndarray::Array2;

    #[test]
    fn a_point_is_as_far_off_as_from_where_it_is_expected_but_no_farther_than_its_worst_distance() {
        // A chain of six points, 10 cm apart.
        let pairs = RigidPairs {
            pairs: (0..5)
                .map(|k| Pair {
                    ends: [k, k + 1],
                    sd: 0.0,
                    still: false,
                })
                .collect(),
            bodies: Array2::from_elem((1, 5), 10.0),
            shares: vec![1.0],
        };
        let bodies = Bodies::of(&pairs);
        let pose: Vec<f64> = (0..6).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        let expected = |mean: &[f64]| Belief {
            mean: mean.to_vec(),
            covariance: Array2::eye(18),
            evidence: 0.0,
        };
        // Turned about its neighbour: one of its distances is right, the other tells how far off it is.
        let mut y = pose.clone();
        (y[9], y[10]) = (21.0, 9.9);
        let mut frame = Frame::new(&pairs, &bodies, y.clone(), vec![0.0; 18]);
        let before = frame.look.slab.clone();
        frame.expect(&expected(&pose));
        let off = |p: usize| -> f64 {
            let squares = (3 * p..3 * p + 3).map(|i| (y[i] - pose[i]).powi(2) - 1.0);
            squares.sum::<f64>() / 3.0
        };
        assert!(before[3] < off(3) && off(3) < frame.look.farthest[3]);
        assert_eq!(frame.look.slab[3], off(3));
        // Expected farther off still.
        let far: Vec<f64> = pose.iter().map(|v| v + 400.0).collect();
        frame.expect(&expected(&far));
        assert_eq!(frame.look.slab[3], frame.look.farthest[3]);
        // Points whose distances are right are none the worse for it, and no number tells nothing.
        let mut whole = Frame::new(&pairs, &bodies, pose, vec![0.0; 18]);
        let before = whole.look.slab.clone();
        whole.expect(&expected(&far));
        whole.expect(&expected(&[f64::NAN; 18]));
        assert_eq!(whole.look.slab, before);
    }
}
