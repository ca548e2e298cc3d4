//! What explains an observation: the blocks that a search found.

use super::part_mixture::ConditionedCluster;

/// Blocks this much less likely (nats) than the best do not answer.
pub const NEGLIGIBLE: f64 = 6.0;

/// One block that may explain an observation.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// The log of its weight times its evidence.
    pub log: f64,
    /// Its cell: which of [`Candidates::seen`].
    pub scored: usize,
    /// The leaf among the cell's, where it is one.
    pub exemplar: Option<usize>,
    /// Of a cell: which of its scales. Of a leaf: which of the leaves' levels that are looked at.
    pub at: usize,
}

/// A cell that was looked at.
#[derive(Debug, Clone, Copy)]
pub struct ScoredCluster {
    /// Which level of cells.
    pub index: usize,
    /// Which cell of it.
    pub cluster: usize,
    /// The best log evidence of its scales, its share and fading included.
    pub most: f64,
    /// Where its z begins.
    pub start: usize,
}

/// The blocks that explain an observation best, and how well all of them together do.
#[derive(Debug, Clone, Default)]
pub struct Candidates {
    /// log Σ over the levels and blocks.
    pub evidence: f64,
    /// log Σ over the blocks of each level, without the level's weight.
    pub levels: Vec<f64>,
    /// The best, in no order.
    pub best: Vec<Candidate>,
    /// The cells that were looked at.
    pub scored: Vec<ScoredCluster>,
    /// The observation less each one's mean, in its directions.
    pub zs: Vec<f32>,
}

impl Candidates {
    /// Of a part that is not looked at.
    pub fn nothing() -> Candidates {
        Candidates {
            evidence: f64::NEG_INFINITY,
            ..Candidates::default()
        }
    }

    /// Each block's share, in the order of [`best`](Candidates::best). Less what the least of them weighs: blocks come and go
    /// without a jump.
    pub fn responsibilities(&self) -> Vec<f64> {
        let log_evidences = self.best.iter().map(|h| h.log);
        let top = log_evidences.fold(f64::NEG_INFINITY, f64::max);
        let least = (-NEGLIGIBLE).exp();
        let weights = self.best.iter().map(|h| (h.log - top).exp() - least);
        let mut weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= total);
        weights
    }

    /// The observation less a cell's mean, in its directions.
    pub fn z(&self, scored: usize, cluster_conditioned: &ConditionedCluster) -> &[f32] {
        let start = self.scored[scored].start;
        &self.zs[start..start + cluster_conditioned.noisy.stride()]
    }
}
