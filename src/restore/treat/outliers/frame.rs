//! A frame some points of which may be corrupt: which are in doubt, and what the others are.

use super::super::bodies::Bodies;
use super::super::bones::{self, Look};
use crate::prior::EXACT_VARIANCE;
use crate::prior::pairs::RigidPairs;

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

    /// The noise under an assignment. Where there is none, points in doubt are missing, and those decided to be corrupt may
    /// be as far off as their worst distance tells.
    pub fn noise(&self, assigned: Option<&[bool]>) -> Vec<f64> {
        let mut out: Vec<f64> = self.told.iter().map(|v| v.max(EXACT_VARIANCE)).collect();
        let of = |p: usize| match (self.doubt.iter().position(|d| *d == p), assigned) {
            (Some(_), None) => f64::INFINITY,
            (Some(at), Some(z)) if z[at] => self.look.slab[p],
            (None, None) if self.corrupt[p] => self.look.slab[p].max(self.look.farthest[p]),
            (None, Some(_)) if self.corrupt[p] => self.look.slab[p],
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
