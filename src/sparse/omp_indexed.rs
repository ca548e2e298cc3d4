//! A group of poses coded a few together, each atom sought by bounds: see [`super::index`]. By leaves neighbours are best alike.

use super::active_set::ActiveSet;
use super::index::{BallTree, BranchAndBound, OmpQuery, Query, SearchResult, TOGETHER};
use super::omp::SelectionRule;
use super::omp_dense::{AtomBudget, RETRIES};
use super::{Dictionary, StopReason};

/// The state of a few poses.
pub(super) struct IndexedOmp<'a> {
    dictionary: &'a Dictionary,
    tree: &'a BallTree,
    rule: SelectionRule,
    search: BranchAndBound<'a>,
    walks: Vec<OmpState>,
    found: Vec<SearchResult>,
}

/// The state of one pose.
struct OmpState {
    path: OmpQuery,
    /// The index of its active set.
    fit: usize,
    /// Atoms taken, and atoms found to be dependent on them.
    taken: Vec<u32>,
    done: bool,
}

impl<'a> IndexedOmp<'a> {
    /// The state of at most `poses` poses at a time. Codes have at most `DIRECTIONS` atoms.
    pub fn new(
        dictionary: &'a Dictionary,
        tree: &'a BallTree,
        rule: SelectionRule,
        poses: usize,
    ) -> Self {
        let together = poses.min(TOGETHER);
        let walk = || OmpState {
            path: OmpQuery::new(dictionary.width()),
            fit: 0,
            taken: Vec::new(),
            done: true,
        };
        IndexedOmp {
            dictionary,
            tree,
            rule,
            search: BranchAndBound::new(tree),
            walks: std::iter::repeat_with(walk).take(together).collect(),
            found: Vec::new(),
        }
    }

    /// Codes the poses that `fits` were started on; their weights are equal. Appends to `unpruned` the poses for which the
    /// tree excludes too few atoms: the caller starts them again and codes them with dense scans.
    pub fn code(&mut self, fits: &mut [ActiveSet], sparsity: usize, unpruned: &mut Vec<usize>) {
        let full = AtomBudget::of(self.dictionary, sparsity);
        for few in open(fits).chunks(self.walks.len()) {
            if self.tree.tally.is_useless() {
                unpruned.extend(few);
                continue;
            }
            for (walk, i) in self.walks.iter_mut().zip(few) {
                walk.path.begin(&self.tree.basis, &fits[*i]);
                walk.fit = *i;
                walk.taken.clear();
                walk.done = false;
            }
            while self.walks.iter().any(|w| !w.done) {
                for taken in 0..full.most {
                    self.step(fits, taken, full, unpruned);
                }
            }
        }
        fits.iter_mut()
            .for_each(|f| f.stop = f.stop.or(Some(StopReason::Dependent)));
    }

    /// Gives each pose that has taken `taken` atoms another one.
    fn step(
        &mut self,
        fits: &mut [ActiveSet],
        taken: usize,
        full: AtomBudget,
        unpruned: &mut Vec<usize>,
    ) {
        let here = |w: &&OmpState| !w.done && w.path.parts.len() == taken;
        let sought: Vec<Query<'_>> = (self.walks.iter().filter(here))
            .map(|walk| Query {
                path: &walk.path,
                rule: self.rule,
                taken: &walk.taken,
            })
            .collect();
        if sought.is_empty() {
            return;
        }
        self.search.best(&sought, &mut self.found);
        let here = |w: &&mut OmpState| !w.done && w.path.parts.len() == taken;
        for (walk, found) in self.walks.iter_mut().filter(here).zip(&self.found) {
            let atom = match found {
                SearchResult::Atom(atom) => Some(*atom),
                SearchResult::Nothing => None,
                SearchResult::Unpruned => {
                    walk.done = true;
                    unpruned.push(walk.fit);
                    let scan = self.tree.scan();
                    self.tree.tally.scans(full.most, scan);
                    continue;
                }
            };
            walk.take(
                &mut fits[walk.fit],
                atom,
                (self.dictionary, self.tree),
                full,
            );
        }
    }
}

/// Finds the leaf nearest to a pose.
pub(super) struct NearestLeaf<'a> {
    leaves: &'a BallTree,
    search: BranchAndBound<'a>,
    paths: Vec<OmpQuery>,
    nearest: Vec<usize>,
}

impl<'a> NearestLeaf<'a> {
    /// A search of `leaves`.
    pub fn new(leaves: &'a BallTree) -> Self {
        let path = || OmpQuery::new(leaves.width());
        NearestLeaf {
            leaves,
            search: BranchAndBound::new(leaves),
            paths: std::iter::repeat_with(path).take(TOGETHER).collect(),
            nearest: Vec::new(),
        }
    }

    /// The leaf nearest to each pose that `fits` were started on. Leaves near one another have numbers near one another.
    pub fn leaves(&mut self, fits: &[ActiveSet]) -> Vec<u32> {
        let mut places = vec![0; fits.len()];
        for few in open(fits).chunks(TOGETHER) {
            for (path, i) in self.paths.iter_mut().zip(few) {
                path.begin(&self.leaves.basis, &fits[*i]);
            }
            let sought: Vec<Query<'_>> = (self.paths.iter().take(few.len()))
                .map(|path| Query {
                    path,
                    rule: SelectionRule::Omp,
                    taken: &[],
                })
                .collect();
            self.search.nearest(&sought, &mut self.nearest);
            (few.iter().zip(&self.nearest)).for_each(|(i, leaf)| places[*i] = *leaf as u32);
        }
        places
    }
}

/// The poses that are not finished.
fn open(fits: &[ActiveSet]) -> Vec<usize> {
    (0..fits.len())
        .filter(|i| fits[*i].stop.is_none())
        .collect()
}

impl OmpState {
    /// Takes an atom, unless it depends on the others.
    fn take(
        &mut self,
        fit: &mut ActiveSet,
        atom: Option<u32>,
        (dictionary, tree): (&Dictionary, &BallTree),
        full: AtomBudget,
    ) {
        let Some(atom) = atom else {
            self.done = true;
            return;
        };
        self.taken.push(atom);
        let pushed = fit.push(atom, dictionary.row(atom));
        if fit.stop.is_none() && fit.support.len() == full.most {
            fit.stop = Some(full.stop);
        }
        self.done = fit.stop.is_some() || self.taken.len() == full.most + RETRIES;
        if pushed && !self.done {
            self.path.take(&tree.basis, fit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::omp::Tolerance;
    use super::super::omp_dense::DenseOmp;
    use super::super::testdata::random;
    use super::*;
    use crate::numeric::parallel;
    use ndarray::{Array2, ArrayView1, Axis, concatenate, s};
    use proptest::prelude::*;
    use rand::Rng;

    /// Asserts that the tree and dense scans give the same codes to the bit. Returns the share of poses for which the tree
    /// excludes too few atoms, for each set of parameters.
    fn as_by_scans(atoms: &Array2<f64>, poses: &Array2<f64>) -> Vec<f64> {
        let (m, d) = poses.dim();
        let mut shares = Vec::new();
        for (rule, sparsity, tolerance) in [
            (SelectionRule::Oomp, 4, Tolerance::Never),
            (SelectionRule::Oomp, 3, Tolerance::Rms(0.05)),
            (SelectionRule::Omp, 4, Tolerance::Never),
            (SelectionRule::Oomp, 1, Tolerance::Never),
        ] {
            let dictionary = Dictionary::from_rows(atoms.view()).unwrap();
            let started = || -> Vec<ActiveSet> {
                let start = |pose: ArrayView1<'_, f64>| {
                    let mut fit = ActiveSet::new(sparsity.min(atoms.nrows()).min(d), d);
                    fit.start(pose, None::<ArrayView1<'_, f64>>, tolerance)
                        .unwrap();
                    fit
                };
                poses.outer_iter().map(start).collect()
            };
            let mut by_scans = started();
            // Without the Gram matrix, which some of these dictionaries have.
            DenseOmp::of_scans(&dictionary, rule, m).code(&mut by_scans, sparsity);
            // Built for this test: its statistics are empty.
            let tree = BallTree::new(dictionary.atoms());
            let (mut by_bounds, mut unpruned) = (started(), Vec::new());
            let mut group = IndexedOmp::new(&dictionary, &tree, rule, usize::MAX);
            group.code(&mut by_bounds, sparsity, &mut unpruned);
            let both = by_bounds.iter().zip(&by_scans).enumerate();
            for (i, (a, b)) in both.filter(|(i, _)| !unpruned.contains(i)) {
                assert_eq!(a.support, b.support, "pose {i} {rule:?} {sparsity}");
                assert_eq!((a.stop, a.left()), (b.stop, b.left()));
            }
            shares.push(unpruned.len() as f64 / m as f64);
        }
        shares
    }

    /// Three hidden dimensions and a little noise in all others.
    fn flat(n: usize, d: usize, seed: u64) -> Array2<f64> {
        let hidden = random(3, d, seed + 1);
        let mut g = parallel::rng(seed, 2);
        let mixed = Array2::from_shape_fn((n, 3), |_| g.random::<f64>() - 0.3);
        mixed.dot(&hidden) + random(n, d, seed + 3) * 0.005
    }

    #[test]
    fn poses_like_atoms_are_found_by_bounds_alone() {
        let all = flat(5100, 120, 1);
        let (atoms, poses) = all.view().split_at(Axis(0), 5000);
        let near = &atoms.slice(s![..100, ..]) + &(random(100, 120, 5) * 0.01);
        let poses = concatenate![Axis(0), near, poses];
        let shares = as_by_scans(&atoms.to_owned(), &poses);
        // After three atoms the residual is noise, which is unlike all atoms.
        assert_eq!((shares[1], shares[3]), (0.0, 0.0));
    }

    #[test]
    fn where_bounds_tell_nothing_scans_answer() {
        let shares = as_by_scans(&random(1500, 69, 6), &random(40, 69, 7));
        assert!(shares[0] > 0.5, "{shares:?}");
    }

    #[test]
    fn a_pose_of_zeros_has_no_atoms_and_one_that_an_atom_is_has_one() {
        let atoms = flat(200, 12, 8);
        let mut poses = atoms.slice(s![..20, ..]).to_owned() * 3.0;
        poses.row_mut(3).fill(0.0);
        as_by_scans(&atoms, &poses);
    }

    #[test]
    fn atoms_of_fewer_numbers_than_a_head_and_few_of_them_are_found_too() {
        for (n, d) in [
            (1, 1),
            (1, 5),
            (3, 2),
            (17, 3),
            (300, 1),
            (257, 31),
            (40, 33),
        ] {
            as_by_scans(&random(n, d, 9), &random(30, d, 10));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        /// Clustered, repeated and negated atoms: many scores are equal or nearly equal.
        #[test]
        fn bounds_find_what_scans_find(
            seed in 0u64..1000,
            n in 1usize..700,
            d in 1usize..80,
            clusters in 1usize..30,
            apart in prop::sample::select(vec![0.0, 1e-8, 1e-7, 1e-6, 1e-4, 1e-2, 0.3]),
            noise in prop::sample::select(vec![0.0, 1e-7, 1e-3, 0.1]),
        ) {
            let centres = match seed % 2 {
                0 => random(clusters, d, seed),
                _ => flat(clusters, d, seed),
            };
            let mut g = parallel::rng(seed, 4);
            let near = |m: usize, apart: f64, g: &mut rand_chacha::ChaCha8Rng| {
                let mut rows = random(m, d, g.random()) * apart;
                for mut row in rows.outer_iter_mut() {
                    let sign = if g.random() { 1.0 } else { -1.0 };
                    row.scaled_add(sign, &centres.row(g.random_range(0..clusters)));
                }
                rows
            };
            let atoms = near(n, apart, &mut g);
            let mut poses = near(40, noise, &mut g);
            let more = near(40, noise, &mut g);
            poses.scaled_add(0.7, &more);
            as_by_scans(&atoms, &poses);
        }
    }
}
