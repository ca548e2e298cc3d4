//! Dense scan: which atom does each pose of a tile take next?
//!
//! For a pose with residual r (after k atoms, weighted and of unit norm at the start) and the
//! orthonormal directions q_1..q_k of its chosen atoms, an atom a (weighted too) has
//!
//! ```text
//! c = <a, r>              the correlation:      c <- c - <q_k, r> <a, q_k>
//! e = |(I - P) a|^2       its remainder:        e <- e - <a, q_k>^2
//! ```
//!
//! and taking it lowers the squared residual by c^2 / e. The optimized rule takes the largest c^2 /
//! e, the plain rule the largest c^2 / |a|^2. Either way a step needs one product <a, q_k> per
//! atom: it is summed in registers for a few poses and a panel of atoms, and used up there
//! ([`super::panel_kernel`]).
//!
//! A pose's numbers do not depend on the poses beside it: one pose alone gives the same bits as one
//! of many.

use super::super::SelectionRule;
use super::argmax::{LaneArgmax, StoredArgmax};
use super::packed_atoms::{PackedAtoms, Row, WIDTH};
use super::panel_kernel::{PanelKernel, State, Step};
use crate::numeric::simd;
use pulp::{Simd, WithSimd};

/// A tile of poses: c and e of each pose and atom, and the best atom of each pose.
pub(crate) struct DenseScan<'a> {
    pub(super) panels: &'a PackedAtoms,
    poses: usize,
    /// c, (panels, poses).
    pub(super) correlations: Vec<Row>,
    /// e, (panels, poses); empty as long as all are 1.
    remainders: Vec<Row>,
    /// What e counts for at least, (panels, poses); empty where all atoms have norm 1.
    floors: Vec<Row>,
    /// (poses, D): the newest q, or r before the first.
    pub directions: Vec<f32>,
    /// −<q, r>, one per pose.
    pub parts: Vec<f32>,
    best: Vec<StoredArgmax>,
    observed: ObservedRows,
}

impl<'a> DenseScan<'a> {
    /// Room for `poses` poses.
    pub(crate) fn new(panels: &'a PackedAtoms, poses: usize) -> DenseScan<'a> {
        DenseScan {
            panels,
            poses,
            correlations: vec![Row::ZERO; panels.iter().len() * poses],
            remainders: Vec::new(),
            floors: Vec::new(),
            directions: vec![0.0; poses * panels.width()],
            parts: vec![0.0; poses],
            best: vec![StoredArgmax::NONE; poses],
            observed: ObservedRows::default(),
        }
    }

    /// How many poses there is room for.
    pub(crate) fn poses(&self) -> usize {
        self.poses
    }

    /// Begins with atoms of norm 1.
    pub(crate) fn begin(&mut self) {
        self.floors.clear();
        self.remainders.clear();
    }

    /// Begins with weights, D a pose.
    pub(crate) fn begin_weighted(&mut self, weights: &[f32]) {
        self.floors.resize(self.correlations.len(), Row::ZERO);
        self.remainders.resize(self.correlations.len(), Row::ZERO);
        self.each(Step::Norms, Some(weights));
    }

    /// Finds each pose's best atom for the residuals in place of the directions.
    pub(crate) fn first(&mut self) {
        self.best.fill(StoredArgmax::NONE);
        self.each(Step::First, None);
    }

    /// Brings c and e up to date, and finds each pose's best atom.
    pub(crate) fn next(&mut self, rule: SelectionRule) {
        if rule == SelectionRule::Oomp {
            let all = self.correlations.len();
            self.remainders.resize(all, Row([1.0; WIDTH]));
        }
        self.best.fill(StoredArgmax::NONE);
        self.each(Step::Next(rule), None);
    }

    fn each(&mut self, step: Step, weights: Option<&[f32]>) {
        let part = |rows: &std::ops::Range<usize>, of: &[Row]| {
            if of.is_empty() { 0..0 } else { rows.clone() }
        };
        let vectors = weights.unwrap_or(&self.directions);
        self.observed.select(vectors, self.panels.width());
        for (panel, atoms) in self.panels.iter().enumerate() {
            let rows = panel * self.poses..(panel + 1) * self.poses;
            let remainders = part(&rows, &self.remainders);
            let floors = part(&rows, &self.floors);
            simd::dispatch_widest(PanelKernel {
                step,
                panel,
                atoms,
                used: &self.observed.rows,
                directions: &self.observed.numbers,
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
    pub(crate) fn best(&self, pose: usize) -> Option<u32> {
        simd::dispatch_widest(Reduce(&self.best[pose]))
    }

    /// Excludes an atom for a pose.
    pub(crate) fn exclude(&mut self, pose: usize, atom: u32) {
        let (panel, lane) = (atom as usize / WIDTH, atom as usize % WIDTH);
        // Never larger than another number, and NaN in all further steps.
        self.correlations[panel * self.poses + pose].0[lane] = f32::NAN;
    }

    /// c of one pose and all atoms, one row a panel.
    pub(super) fn of_pose(&self, pose: usize) -> impl Iterator<Item = &Row> {
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

/// The coordinates in which some vector of a tile is not 0. Where all poses miss the same
/// coordinates, atoms need not be read whole.
#[derive(Default)]
struct ObservedRows {
    rows: Vec<u32>,
    /// The rows as ranges, which are copied faster than one by one.
    runs: Vec<std::ops::Range<usize>>,
    /// These coordinates of each vector, one vector after the other.
    numbers: Vec<f32>,
}

impl ObservedRows {
    /// Selects the coordinates of vectors (poses, `d`).
    fn select(&mut self, vectors: &[f32], d: usize) {
        let is_used = |k: &u32| {
            let mut column = vectors.iter().skip(*k as usize).step_by(d);
            column.any(|v| *v != 0.0)
        };
        self.rows.clear();
        self.rows.extend((0..d as u32).filter(is_used));
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
    use super::super::super::testdata::random;
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
        // An atom that is excluded gives way, and where nothing is along any atom there is none.
        let best = all.best(4).unwrap();
        all.exclude(4, best);
        all.directions.fill(0.0);
        for _ in 0..2 {
            all.next(SelectionRule::Oomp);
            assert_ne!(all.best(4), Some(best));
        }
        all.first();
        assert_eq!(all.best(4), None);
    }
}
