//! The scan of all atoms for a tile of poses: which atom does each of them take next?
//!
//! For a pose with residual r (after k atoms, weighted and of unit norm at the start) and the orthonormal directions
//! q_1..q_k of its chosen atoms, an atom a (weighted too) has
//!
//! ```text
//! c = <a, r>              the correlation:      c <- c - <q_k, r> <a, q_k>
//! e = |(I - P) a|^2       what is left of it:   e <- e - <a, q_k>^2
//! ```
//!
//! and taking it lowers the squared residual by c^2 / e. The optimised rule takes the largest c^2 / e, the plain rule the
//! largest c^2 / |a|^2. Either way a step needs one product <a, q_k> an atom: it is summed in registers for a few poses and
//! a panel of atoms ([`panel_kernel`]), and used up there.
//!
//! A pose's numbers do not depend on the poses beside it: one pose alone gives the same bits as one of many.
//!
//! Of many atoms most need not be looked at: [`ball_tree`] hold neighbours together, and [`branch_and_bound`] finds what a scan would,
//! to the bit, by bounds. Of few atoms [`gram`] keeps the products with one another, and [`gram_omp`] uses them.

mod argmax;
mod ball_tree;
mod gram;
mod gram_omp;
mod index_cache;
mod packed_atoms;
mod panel_kernel;
mod pca_projection;
mod tree_search;

use super::SelectionRule;
use crate::numeric::simd;
use argmax::{LaneArgmax, StoredArgmax};
use packed_atoms::{Row, WIDTH};
use panel_kernel::{Next, PanelKernel, State, Step};
use pulp::{Simd, WithSimd};

pub use ball_tree::BallTree;
pub use gram::{LazyGram, Term, products};
pub use gram_omp::GramOmp;
pub use index_cache::IndexCache;
pub use packed_atoms::PackedAtoms;
pub use panel_kernel::UNSEEN;
pub use tree_search::{MOST_ATOMS, TreeSearch};

/// What is kept for a tile of poses: c and e of each pose and atom, and the best atom of each pose.
pub struct DenseScan<'a> {
    panels: &'a PackedAtoms,
    poses: usize,
    /// By panels, then poses.
    correlations: Vec<Row>,
    /// The same; nothing as long as all are 1.
    remainders: Vec<Row>,
    /// The same; nothing where all atoms have norm 1.
    floors: Vec<Row>,
    /// D numbers a pose: the newest q, or r before the first.
    pub directions: Vec<f32>,
    /// −<q, r>, one a pose.
    pub parts: Vec<f32>,
    best: Vec<StoredArgmax>,
    used: Used,
    /// e is 1 of all atoms, whatever is kept.
    fresh: bool,
}

impl<'a> DenseScan<'a> {
    /// Room for `poses` poses.
    pub fn new(panels: &'a PackedAtoms, poses: usize) -> DenseScan<'a> {
        DenseScan {
            panels,
            poses,
            correlations: vec![Row::ZERO; panels.iter().len() * poses],
            remainders: Vec::new(),
            floors: Vec::new(),
            directions: vec![0.0; poses * panels.width()],
            parts: vec![0.0; poses],
            best: vec![StoredArgmax::NONE; poses],
            used: Used::default(),
            fresh: true,
        }
    }

    /// How many poses there is room for.
    pub fn poses(&self) -> usize {
        self.poses
    }

    /// Begins with atoms of norm 1.
    pub fn begin(&mut self) {
        self.floors.clear();
        self.fresh = true;
    }

    /// Begins with weights, D a pose.
    pub fn begin_weighted(&mut self, weights: &[f32]) {
        self.fresh = false;
        self.floors.resize(self.correlations.len(), Row::ZERO);
        self.remainders.resize(self.correlations.len(), Row::ZERO);
        self.each(Step::Norms, Some(weights));
    }

    /// Finds each pose's best atom for the residuals in place of the directions.
    pub fn first(&mut self) {
        self.best.fill(StoredArgmax::NONE);
        self.each(Step::First, None);
    }

    /// Brings c and e up to date, if they are needed any more (`last`), and finds each pose's best atom.
    pub fn next(&mut self, rule: SelectionRule, last: bool) {
        let fresh = self.fresh;
        if rule == SelectionRule::Oomp {
            self.remainders.resize(self.correlations.len(), Row::ZERO);
            self.fresh &= last;
        }
        self.best.fill(StoredArgmax::NONE);
        self.each(Step::Next(Next { rule, fresh, last }), None);
    }

    fn each(&mut self, step: Step, weights: Option<&[f32]>) {
        let part = |rows: &std::ops::Range<usize>, of: &[Row]| match of.is_empty() {
            true => 0..0,
            false => rows.clone(),
        };
        self.used
            .of(weights.unwrap_or(&self.directions), self.panels.width());
        for (panel, atoms) in self.panels.iter().enumerate() {
            let rows = panel * self.poses..(panel + 1) * self.poses;
            let remainders = part(&rows, &self.remainders);
            let floors = part(&rows, &self.floors);
            simd::dispatch_widest(PanelKernel {
                step,
                panel,
                atoms,
                used: &self.used.rows,
                directions: &self.used.numbers,
                parts: &self.parts,
                state: State {
                    correlations: &mut self.correlations[rows],
                    remainders: &mut self.remainders[remainders],
                    floors: &mut self.floors[floors],
                },
                best: &mut self.best,
            });
        }
    }

    /// The best atom of a pose, if there is one.
    pub fn best(&self, pose: usize) -> Option<u32> {
        simd::dispatch_widest(Reduce(&self.best[pose]))
    }

    /// A pose is not to take an atom any more.
    pub fn leave_out(&mut self, pose: usize, atom: u32) {
        let (panel, lane) = (atom as usize / WIDTH, atom as usize % WIDTH);
        // Compares with nothing, and stays so.
        self.correlations[panel * self.poses + pose].0[lane] = f32::NAN;
    }

    /// c of one pose and all atoms, one row a panel.
    fn of_pose(&self, pose: usize) -> impl Iterator<Item = &Row> {
        self.correlations.iter().skip(pose).step_by(self.poses)
    }
}

/// The best atom of all lanes.
struct Reduce<'a>(&'a StoredArgmax);

impl WithSimd for Reduce<'_> {
    type Output = Option<u32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<u32> {
        LaneArgmax::best(simd, [self.0.load::<S>()])
    }
}

/// The coordinates that count: where a tile's poses have all the same gaps, an atom need not be read whole. (A product with 0
/// adds nothing to a sum, to the bit but for the sign of 0, which no comparison sees.)
#[derive(Default)]
struct Used {
    rows: Vec<u32>,
    /// The same, those side by side together.
    runs: Vec<std::ops::Range<usize>>,
    /// Of each vector the numbers of those rows.
    numbers: Vec<f32>,
}

impl Used {
    /// Of vectors of `d` numbers.
    fn of(&mut self, vectors: &[f32], d: usize) {
        let counts = |k: &u32| {
            vectors
                .iter()
                .skip(*k as usize)
                .step_by(d)
                .any(|v| *v != 0.0)
        };
        self.rows.clear();
        self.rows.extend((0..d as u32).filter(counts));
        self.runs.clear();
        let runs = self.rows.chunk_by(|k, next| k + 1 == *next);
        let runs = runs.map(|run| run[0] as usize..run[0] as usize + run.len());
        self.runs.extend(runs);
        self.numbers.clear();
        for vector in vectors.chunks_exact(d) {
            for run in &self.runs {
                self.numbers.extend_from_slice(&vector[run.clone()]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::active_set::ActiveSet;
    use super::super::testdata::random;
    use super::super::{Dictionary, Tolerance};
    use super::*;
    use ndarray::Array2;

    /// More than two panels, and poses that fill no whole number of tiles.
    fn atoms() -> Array2<f32> {
        random(150, 21, 1).mapv(|v| v as f32)
    }

    #[test]
    fn each_pose_gets_the_best_of_all_atoms_whatever_is_beside_it() {
        let (atoms, poses) = (atoms(), random(13, 21, 2).mapv(|v| v as f32));
        let panels = PackedAtoms::new(atoms.view());
        let mut all = DenseScan::new(&panels, 13);
        all.begin();
        all.directions.copy_from_slice(poses.as_slice().unwrap());
        all.first();
        for (i, pose) in poses.outer_iter().enumerate() {
            let c = atoms.mapv(f64::from).dot(&pose.mapv(f64::from));
            let most = c.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            let best = all.best(i).unwrap();
            assert!(c[best as usize].abs() >= most * (1.0 - 1e-6), "{i}");
            let mut alone = DenseScan::new(&panels, 1);
            alone.begin();
            alone.directions.copy_from_slice(pose.as_slice().unwrap());
            alone.first();
            assert_eq!(alone.best(0), Some(best));
            let of = |s: &DenseScan<'_>, poses: usize, i: usize| -> Vec<Row> {
                s.correlations
                    .iter()
                    .skip(i)
                    .step_by(poses)
                    .copied()
                    .collect()
            };
            assert_eq!(of(&all, 13, i), of(&alone, 1, 0));
        }
        // An atom that is left out gives way, and where nothing is along any atom there is none.
        let best = all.best(4).unwrap();
        all.leave_out(4, best);
        all.directions.fill(0.0);
        for last in [false, false, true] {
            all.next(SelectionRule::Oomp, last);
            assert_ne!(all.best(4), Some(best));
        }
        all.first();
        assert_eq!(all.best(4), None);
    }

    fn atoms_found(scan: &DenseScan<'_>) -> Vec<Option<u32>> {
        (0..scan.poses()).map(|i| scan.best(i)).collect()
    }

    #[test]
    fn a_last_scan_keeps_nothing() {
        let (atoms, poses) = (atoms(), random(13, 21, 2).mapv(|v| v as f32));
        let weights = random(13, 21, 3).mapv(|v| v as f32 + 0.5);
        let panels = PackedAtoms::new(atoms.view());
        for (rule, weighted) in [SelectionRule::Omp, SelectionRule::Oomp]
            .into_iter()
            .flat_map(|rule| [(rule, false), (rule, true)])
        {
            let mut scan = DenseScan::new(&panels, 13);
            match weighted {
                true => scan.begin_weighted(weights.as_slice().unwrap()),
                false => scan.begin(),
            }
            scan.directions.copy_from_slice(poses.as_slice().unwrap());
            scan.first();
            for (i, row) in scan.directions.chunks_exact_mut(21).enumerate() {
                row.copy_from_slice(atoms.row(i).as_slice().unwrap());
                scan.parts[i] = -0.1;
            }
            for already in [false, true] {
                let before = (scan.correlations.clone(), scan.remainders.clone());
                scan.next(rule, true);
                let found = atoms_found(&scan);
                assert!(scan.correlations == before.0, "{rule:?} {weighted}");
                assert!(before.1.is_empty() || scan.remainders == before.1);
                scan.next(rule, true);
                assert_eq!(atoms_found(&scan), found);
                if !already {
                    scan.next(rule, false);
                    assert_eq!(atoms_found(&scan), found);
                    assert!(scan.correlations != before.0);
                }
            }
        }
    }

    #[test]
    fn rows_of_the_gram_matrix_lead_where_scans_do() {
        let poses = random(13, 21, 2).mapv(|v| v as f32);
        let atoms = Dictionary::from_rows(atoms().view()).unwrap();
        let (index_cache, flat) = (atoms.index_cache(), atoms.flat());
        let (panels, gram) = (
            index_cache.panels(atoms.atoms()),
            index_cache.gram.as_ref().unwrap(),
        );
        for (i, pose) in poses.outer_iter().enumerate() {
            let [mut scan, mut rows] = [0, 1].map(|_| {
                let mut scan = DenseScan::new(panels, 1);
                scan.begin();
                scan.directions.copy_from_slice(pose.as_slice().unwrap());
                scan.first();
                scan
            });
            let mut follower = GramOmp::new(panels);
            follower.begin();
            let mut fit = ActiveSet::new(4, 21);
            fit.start(pose, None::<ndarray::ArrayView1<'_, f32>>, Tolerance::Never)
                .unwrap();
            let mut best = scan.best(0);
            for last in [false, false, true] {
                let atom = best.unwrap();
                assert!(fit.push(atom, atoms.row(atom)));
                let (q, _) = fit.newest();
                let z: f64 = q.iter().zip(pose).map(|(q, y)| q * f64::from(*y)).sum();
                scan.directions
                    .iter_mut()
                    .zip(q)
                    .for_each(|(d, q)| *d = *q as f32);
                scan.parts[0] = -z as f32;
                scan.leave_out(0, atom);
                rows.leave_out(0, atom);
                let mut weights = Vec::new();
                fit.newest_weights(&mut weights);
                let terms: Vec<Term<'_>> = (weights.iter().zip(&fit.support))
                    .map(|(w, atom)| (*w as f32, gram.row(panels, flat, *atom)))
                    .collect();
                scan.next(SelectionRule::Oomp, last);
                best = scan.best(0);
                let how = (SelectionRule::Oomp, last);
                let by_rows = follower.next(&mut rows, 0, (&terms, -z as f32), how);
                assert_eq!(by_rows, best, "{i}");
            }
        }
    }
}
