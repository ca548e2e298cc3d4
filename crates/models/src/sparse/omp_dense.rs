//! Matching pursuit with scores of all atoms, for a tile of poses. One dense scan finds the first
//! atoms of all poses. Rows of the Gram matrix find the others pose by pose, or further scans if
//! there is no Gram matrix or the poses have weights.

use super::active_set::ActiveSet;
use super::index::{DenseScan, GramOmp, LazyGram, PackedAtoms, Term, products};
use super::omp::SelectionRule;
use super::{Dictionary, StopReason};

/// How many atoms of a pose may turn out to be dependent on the others before it stops. Such an
/// atom wins only by rounding, when no useful atom is left.
pub(super) const RETRIES: usize = 4;

/// The largest weight with which rows of the Gram matrix are combined. Larger weights amplify the
/// rounding of the rows, 1e-7, too much.
const LARGEST_WEIGHT: f64 = 32.0;

/// The number of poses in a tile. More poses share a read of the atoms, but their scores have to
/// stay in the cache; 60 is best for any number of atoms, measured.
pub(super) const POSES: usize = 60;

/// The state of a tile, used for many tiles.
pub(super) struct DenseOmp<'a> {
    dictionary: &'a Dictionary,
    panels: &'a PackedAtoms,
    gram: Option<&'a LazyGram>,
    rule: SelectionRule,
    scan: DenseScan<'a>,
    gram_omp: GramOmp,
    /// Scratch: the newest direction as a combination of atoms.
    weights: Vec<f64>,
    terms: Vec<Term<'a>>,
}

impl<'a> DenseOmp<'a> {
    /// The state of tiles of at most `poses` poses.
    pub(crate) fn new(dictionary: &'a Dictionary, rule: SelectionRule, poses: usize) -> Self {
        let index_cache = dictionary.index_cache();
        let panels = index_cache.panels(dictionary.atoms());
        DenseOmp {
            dictionary,
            panels,
            gram: index_cache.gram.as_ref(),
            rule,
            scan: DenseScan::new(panels, poses),
            gram_omp: GramOmp::new(panels),
            weights: Vec::new(),
            terms: Vec::new(),
        }
    }

    /// Codes the poses that `fits` were started on, with at most `sparsity` atoms each.
    pub(crate) fn code(&mut self, fits: &mut [ActiveSet], sparsity: usize) {
        let full = AtomBudget::of(self.dictionary, sparsity);
        debug_assert!(fits.len() <= self.scan.poses());
        self.load(fits);
        self.scan.first();
        match self.gram {
            Some(gram) if fits.iter().all(|f| f.root.is_none()) => self.each(fits, gram, full),
            _ => self.together(fits, full),
        }
        fits.iter_mut()
            .for_each(|f| f.stop = f.stop.or(Some(StopReason::Dependent)));
    }

    /// Sets the residuals in place of the directions, and e to |a|².
    fn load(&mut self, fits: &[ActiveSet]) {
        let d = self.dictionary.width();
        self.scan.directions.fill(0.0);
        for (fit, row) in fits.iter().zip(self.scan.directions.chunks_exact_mut(d)) {
            if fit.stop.is_none() {
                weigh(fit.residual(), fit.root.as_deref(), row);
            }
        }
        if fits.iter().all(|f| f.root.is_none()) {
            return self.scan.begin();
        }
        let mut weights = vec![1.0; self.scan.directions.len()];
        for (fit, row) in fits.iter().zip(weights.chunks_exact_mut(d)) {
            if let Some(root) = &fit.root {
                row.iter_mut()
                    .zip(root)
                    .for_each(|(w, r)| *w = (r * r) as f32);
            }
        }
        self.scan.begin_weighted(&weights);
    }

    /// Takes the atoms after the first scan, one scan of all poses per step.
    fn together(&mut self, fits: &mut [ActiveSet], full: AtomBudget) {
        for _ in 0..full.most + RETRIES {
            self.take(fits, full);
            if fits.iter().all(|f| f.stop.is_some()) {
                break;
            }
            self.scan.next(self.rule);
        }
    }

    /// Gives each pose its best atom, and sets the direction that this adds for the next scan.
    fn take(&mut self, fits: &mut [ActiveSet], full: AtomBudget) {
        let d = self.dictionary.width();
        for (i, fit) in fits.iter_mut().enumerate() {
            let row = i * d..(i + 1) * d;
            let best = self.scan.best(i);
            if let Some(atom) = best {
                self.scan.exclude(i, atom);
            }
            if fit.stop.is_none() && full.push(self.dictionary, fit, best) {
                let (q, z) = fit.newest();
                weigh(q, fit.root.as_deref(), &mut self.scan.directions[row]);
                self.scan.parts[i] = -z as f32;
            } else {
                self.scan.directions[row].fill(0.0);
                self.scan.parts[i] = 0.0;
            }
        }
    }

    /// Takes the atoms after the first scan pose by pose, by rows of the Gram matrix.
    fn each(&mut self, fits: &mut [ActiveSet], gram: &'a LazyGram, full: AtomBudget) {
        let open = (0..fits.len()).filter(|&i| fits[i].stop.is_none() && full.most > 1);
        let firsts = open.filter_map(|i| self.scan.best(i)).collect();
        gram.prepare(self.panels, self.dictionary.flat(), firsts);
        for (i, fit) in fits.iter_mut().enumerate() {
            let mut best = self.scan.best(i);
            self.gram_omp.start(&self.scan, i);
            for _ in 0..full.most + RETRIES {
                let pushed = fit.stop.is_none() && full.push(self.dictionary, fit, best);
                if fit.stop.is_some() {
                    break;
                }
                if let Some(atom) = best {
                    self.gram_omp.exclude(atom);
                }
                best = self.follow(pushed.then_some(&*fit), gram);
            }
        }
    }

    /// The best atom of one pose after the newest direction of its active set; `None`: after no new
    /// direction.
    fn follow(&mut self, fit: Option<&ActiveSet>, gram: &'a LazyGram) -> Option<u32> {
        let Some(fit) = fit else {
            return self.gram_omp.next(&[], 0.0, self.rule);
        };
        let (panels, atoms) = (self.panels, self.dictionary.flat());
        let (q, z) = fit.newest();
        fit.newest_weights(&mut self.weights);
        if self.weights.iter().any(|w| w.abs() > LARGEST_WEIGHT) {
            let direction: Vec<f32> = q.iter().map(|v| *v as f32).collect();
            let row = &products(panels, &direction);
            let terms: [Term<'_>; 1] = [(1.0, row)];
            return self.gram_omp.next(&terms, -z as f32, self.rule);
        }
        let terms = (self.weights.iter().zip(&fit.support))
            .map(|(w, atom)| (*w as f32, gram.row(panels, atoms, *atom)));
        self.terms.clear();
        self.terms.extend(terms);
        self.gram_omp.next(&self.terms, -z as f32, self.rule)
    }
}

/// The largest number of atoms of a code, and the reason to stop there.
#[derive(Clone, Copy)]
pub(super) struct AtomBudget {
    pub most: usize,
    pub stop: StopReason,
}

impl AtomBudget {
    /// The budget for codes of at most `sparsity` atoms; more than n or D atoms are never
    /// independent.
    pub(crate) fn of(dictionary: &Dictionary, sparsity: usize) -> AtomBudget {
        let most = sparsity.min(dictionary.len()).min(dictionary.width());
        let stop = if most == sparsity {
            StopReason::Sparsity
        } else {
            StopReason::Dependent
        };
        AtomBudget { most, stop }
    }

    /// Gives a pose its best atom; `false` if there is none, or it depends on those taken.
    pub(crate) fn push(
        self,
        dictionary: &Dictionary,
        fit: &mut ActiveSet,
        best: Option<u32>,
    ) -> bool {
        let Some(atom) = best else {
            fit.stop = Some(StopReason::Dependent);
            return false;
        };
        let pushed = fit.push(atom, dictionary.row(atom));
        if fit.stop.is_none() && fit.support.len() == self.most {
            fit.stop = Some(self.stop);
        }
        pushed
    }
}

/// √w∘v in single precision: its product with an atom is that of v with the weighted atom.
fn weigh(v: &[f64], root: Option<&[f64]>, out: &mut [f32]) {
    match root {
        Some(root) => {
            out.iter_mut()
                .zip(v)
                .zip(root)
                .for_each(|((o, v), w)| *o = (v * w) as f32);
        }
        None => out.iter_mut().zip(v).for_each(|(o, v)| *o = *v as f32),
    }
}
