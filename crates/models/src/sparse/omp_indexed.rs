//! Matching pursuit with a ball tree over the atoms, pose by pose.

use super::active_set::ActiveSet;
use super::index::{BallTree, TreeSearch};
use super::omp::SelectionRule;
use super::omp_dense::{AtomBudget, RETRIES};
use super::{Dictionary, StopReason};

/// Codes one pose after the other.
pub(super) struct IndexedOmp<'a> {
    dictionary: &'a Dictionary,
    search: TreeSearch<'a>,
    /// Atoms taken, and atoms found to be dependent on them.
    excluded: Vec<u32>,
}

impl<'a> IndexedOmp<'a> {
    /// A coder with the tree of `dictionary`.
    pub(crate) fn new(dictionary: &'a Dictionary, tree: &'a BallTree, rule: SelectionRule) -> Self {
        IndexedOmp {
            dictionary,
            search: TreeSearch::new(tree, dictionary.flat(), rule),
            excluded: Vec::new(),
        }
    }

    /// Codes the pose that `fit` was started on; its weights are equal.
    pub(crate) fn code(&mut self, fit: &mut ActiveSet, sparsity: usize) {
        let budget = AtomBudget::of(self.dictionary, sparsity);
        self.search.start();
        self.excluded.clear();
        while fit.stop.is_none() && self.excluded.len() < budget.most + RETRIES {
            let best = self.search.best(fit, &self.excluded);
            self.excluded.extend(best);
            if budget.push(self.dictionary, fit, best) && fit.stop.is_none() {
                self.search.add_direction(fit);
            }
        }
        fit.stop = fit.stop.or(Some(StopReason::Dependent));
    }
}
