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
//! a panel of atoms ([`kernel`]), and used up there.
//!
//! A pose's numbers do not depend on the poses beside it: one pose alone gives the same bits as one of many.

mod kernel;
mod panels;

use kernel::{Best, Job, State};
use panels::{Row, WIDTH};

pub use kernel::Step;
pub use panels::Panels;

/// What is kept for a tile of poses: c and e of each pose and atom, and the best atom of each pose.
pub struct Scan<'a> {
    panels: &'a Panels,
    poses: usize,
    /// By panels, then poses.
    correlations: Vec<Row>,
    remainders: Vec<Row>,
    /// Empty where all atoms have norm 1.
    floors: Vec<Row>,
    /// D numbers a pose: the newest q, or r before the first.
    pub directions: Vec<f32>,
    /// −<q, r>, one a pose.
    pub parts: Vec<f32>,
    best: Vec<Best>,
}

impl<'a> Scan<'a> {
    /// Room for `poses` poses.
    pub fn new(panels: &'a Panels, poses: usize) -> Scan<'a> {
        let size = panels.iter().len() * poses;
        Scan {
            panels,
            poses,
            correlations: vec![Row::ZERO; size],
            remainders: vec![Row::ZERO; size],
            floors: Vec::new(),
            directions: vec![0.0; poses * panels.width()],
            parts: vec![0.0; poses],
            best: vec![Best::NONE; poses],
        }
    }

    /// Begins with atoms of norm 1.
    pub fn begin(&mut self) {
        self.floors.clear();
        self.remainders.fill(Row::ONE);
    }

    /// Begins with weights, D a pose.
    pub fn begin_weighted(&mut self, weights: &[f32]) {
        self.floors.resize(self.remainders.len(), Row::ZERO);
        self.each(Step::Norms, Some(weights));
    }

    /// Brings c and e up to date and finds each pose's best atom.
    pub fn step(&mut self, step: Step) {
        self.best.fill(Best::NONE);
        self.each(step, None);
    }

    fn each(&mut self, step: Step, weights: Option<&[f32]>) {
        for (panel, atoms) in self.panels.iter().enumerate() {
            let rows = panel * self.poses..(panel + 1) * self.poses;
            let floors = if self.floors.is_empty() {
                0..0
            } else {
                rows.clone()
            };
            kernel::run(Job {
                step,
                panel,
                atoms,
                directions: weights.unwrap_or(&self.directions),
                parts: &self.parts,
                state: State {
                    correlations: &mut self.correlations[rows.clone()],
                    remainders: &mut self.remainders[rows],
                    floors: &mut self.floors[floors],
                },
                best: &mut self.best,
            });
        }
    }

    /// The best atom of a pose, if there is one.
    pub fn best(&self, pose: usize) -> Option<u32> {
        self.best[pose].atom()
    }

    /// A pose is not to take an atom any more.
    pub fn leave_out(&mut self, pose: usize, atom: u32) {
        let (panel, lane) = (atom as usize / WIDTH, atom as usize % WIDTH);
        self.remainders[panel * self.poses + pose].0[lane] = f32::INFINITY;
    }
}

#[cfg(test)]
mod tests {
    use super::super::testdata::random;
    use super::*;
    use ndarray::Array2;

    /// More than two panels, and poses that fill no whole number of tiles.
    fn atoms() -> Array2<f32> {
        random(150, 21, 1).mapv(|v| v as f32)
    }

    #[test]
    fn each_pose_gets_the_best_of_all_atoms_whatever_is_beside_it() {
        let (atoms, poses) = (atoms(), random(13, 21, 2).mapv(|v| v as f32));
        let panels = Panels::new(atoms.view());
        let mut all = Scan::new(&panels, 13);
        all.begin();
        all.directions.copy_from_slice(poses.as_slice().unwrap());
        all.step(Step::First);
        for (i, pose) in poses.outer_iter().enumerate() {
            let c = atoms.mapv(f64::from).dot(&pose.mapv(f64::from));
            let most = c.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            let best = all.best(i).unwrap();
            assert!(c[best as usize].abs() >= most * (1.0 - 1e-6), "{i}");
            let mut alone = Scan::new(&panels, 1);
            alone.begin();
            alone.directions.copy_from_slice(pose.as_slice().unwrap());
            alone.step(Step::First);
            assert_eq!(alone.best(0), Some(best));
            let of = |s: &Scan<'_>, poses: usize, i: usize| -> Vec<Row> {
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
        all.step(Step::First);
        assert_ne!(all.best(4), Some(best));
        all.directions.fill(0.0);
        all.step(Step::First);
        assert_eq!(all.best(4), None);
    }
}
