//! The sparse graph of poses (Chen et al., section 4.2.2): each pose as a sparse combination of the
//! others.
//!
//! For each pose x_i, the weights a_i minimize
//!
//! ```text
//! 1/2 |x_i - Σ_j a_ij x_j|² + γ_i Σ_j |a_ij|,   a_ii = 0,   γ_i = γ max_{j≠i} |x_jᵀ x_i|
//! ```
//!
//! Chen et al. print the length in (16) without the square; this is the lasso, which they cite. γ
//! is relative to the largest correlation, so that it means the same on any data: from 1 on all
//! weights are 0.
//!
//! Only inner products are needed. Coordinate descent runs on a working set of poses, to which
//! those that violate optimality most are added until none does; the weights on a working set are
//! finished by solving the equations of their signs, stepping only as far as the signs hold. Cost:
//! O(N s) a pose and round for s poses with weights, and O(N²) memory for the products.

use crate::numeric::parallel;
use crate::numeric::small_linalg::{backward, dot, factorize, forward};
use ndarray::ArrayView2;

/// Poses that one thread codes at a time.
const CHUNK: usize = 16;
/// Poses added to a working set at a time, at least.
const ADDED: usize = 8;
/// Sweeps of coordinate descent between exact steps.
const SWEEPS: usize = 4;
/// Rounds of descent on one working set, and of working sets.
const ROUNDS: usize = 200;

/// The weights of poses on others.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseGraph {
    /// A pose's neighbors and their weights, in the order of the neighbors.
    pub weights: Vec<Vec<(usize, f64)>>,
    /// The largest violation of optimality, relative to the pose's γ_i: |x_jᵀ r_i| - γ_i for a
    /// pose without weight, |x_jᵀ r_i - γ_i sign a_ij| for one with. It is above the tolerance
    /// if a pose did not converge.
    pub violation: f64,
}

impl SparseGraph {
    /// Codes each pose by the others, given all inner products (N, N), until optimality holds to
    /// `tolerance`. γ is 0 to 1.
    pub fn code(products: ArrayView2<'_, f64>, gamma: f64, tolerance: f64) -> SparseGraph {
        let standard = products.as_standard_layout();
        let n = standard.nrows();
        // In standard layout there is a slice.
        let products = standard.as_slice().unwrap_or(&[]);
        let parts = parallel::map_chunks(n, CHUNK, |range| {
            range
                .map(|i| PoseCode::solve(products, n, i, gamma, tolerance))
                .collect::<Vec<_>>()
        });
        let (weights, violations): (Vec<_>, Vec<f64>) = parts.into_iter().flatten().unzip();
        SparseGraph {
            weights,
            violation: violations.into_iter().fold(0.0, f64::max),
        }
    }
}

/// The code of one pose while it is looked for.
struct PoseCode<'a> {
    products: &'a [f64],
    n: usize,
    pose: usize,
    gamma: f64,
    /// Poses that may have weights, their weights, and the inner products of these poses.
    working: Vec<usize>,
    weights: Vec<f64>,
    gram: Vec<f64>,
    /// x_jᵀ r of each pose of the working set.
    correlations: Vec<f64>,
}

impl PoseCode<'_> {
    fn solve(
        products: &[f64],
        n: usize,
        pose: usize,
        gamma: f64,
        tolerance: f64,
    ) -> (Vec<(usize, f64)>, f64) {
        let row = &products[pose * n..(pose + 1) * n];
        let others = (0..n).filter(|j| *j != pose);
        let largest = others.map(|j| row[j].abs()).fold(0.0, f64::max);
        let gamma = gamma * largest;
        if gamma <= 0.0 {
            return (Vec::new(), 0.0);
        }
        let mut code = PoseCode {
            products,
            n,
            pose,
            gamma,
            working: Vec::new(),
            weights: Vec::new(),
            gram: Vec::new(),
            correlations: Vec::new(),
        };
        let mut violation = f64::INFINITY;
        let mut correlations = row.to_vec();
        for _ in 0..ROUNDS {
            violation = code.violation(&correlations);
            if violation <= tolerance || !code.extend(&correlations, tolerance) {
                break;
            }
            code.descend(tolerance);
            correlations.copy_from_slice(row);
            for (j, weight) in code.working.iter().zip(&code.weights) {
                if *weight != 0.0 {
                    let other = &products[j * n..(j + 1) * n];
                    (correlations.iter_mut().zip(other)).for_each(|(c, g)| *c -= weight * g);
                }
            }
        }
        let weights = code.working.into_iter().zip(code.weights);
        let mut weights: Vec<_> = weights.filter(|(_, w)| *w != 0.0).collect();
        weights.sort_unstable_by_key(|(j, _)| *j);
        (weights, violation)
    }

    /// The largest violation, relative to γ_i, given x_jᵀ r of all poses.
    fn violation(&self, correlations: &[f64]) -> f64 {
        let mut largest: f64 = 0.0;
        for (j, c) in correlations.iter().enumerate() {
            if j != self.pose {
                largest = largest.max(c.abs() - self.gamma);
            }
        }
        for (j, w) in self.working.iter().zip(&self.weights) {
            if *w != 0.0 {
                largest = largest.max((correlations[*j] - self.gamma * w.signum()).abs());
            }
        }
        largest / self.gamma
    }

    /// Drops poses without weight, and adds those that violate optimality most. `false` if there
    /// are none.
    fn extend(&mut self, correlations: &[f64], tolerance: f64) -> bool {
        let kept: Vec<usize> = (0..self.working.len())
            .filter(|k| self.weights[*k] != 0.0)
            .collect();
        self.weights = kept.iter().map(|k| self.weights[*k]).collect();
        self.working = kept.iter().map(|k| self.working[*k]).collect();
        let bound = self.gamma * (1.0 + tolerance);
        let mut violating: Vec<usize> = (0..self.n)
            .filter(|j| *j != self.pose && correlations[*j].abs() > bound)
            .filter(|j| !self.working.contains(j))
            .collect();
        let most = ADDED.max(self.working.len() / 2);
        if violating.len() > most {
            let size = |j: &usize| correlations[*j].abs();
            violating.select_nth_unstable_by(most, |a, b| size(b).total_cmp(&size(a)));
            violating.truncate(most);
        }
        let grows = !violating.is_empty();
        self.working.extend(violating);
        self.weights.resize(self.working.len(), 0.0);
        let entry = |a: &usize, b: &usize| self.products[a * self.n + b];
        let of = |a: &usize| self.working.iter().map(|b| entry(a, b)).collect::<Vec<_>>();
        self.gram = self.working.iter().flat_map(of).collect();
        grows || !self.working.is_empty()
    }

    /// Minimizes over the working set.
    fn descend(&mut self, tolerance: f64) {
        for _ in 0..ROUNDS {
            self.correlate();
            for _ in 0..SWEEPS {
                self.sweep();
            }
            self.step_to_signs();
            self.correlate();
            let violation = self.working_violation();
            if violation <= 0.1 * tolerance {
                return;
            }
        }
    }

    /// x_jᵀ r of the working set, from its weights.
    fn correlate(&mut self) {
        let m = self.working.len();
        self.correlations = (0..m)
            .map(|k| {
                let own = self.products[self.pose * self.n + self.working[k]];
                own - dot(&self.gram[k * m..(k + 1) * m], &self.weights)
            })
            .collect();
    }

    fn working_violation(&self) -> f64 {
        let each = self.correlations.iter().zip(&self.weights);
        let violation = each.map(|(c, w)| match *w {
            0.0 => c.abs() - self.gamma,
            w => (c - self.gamma * w.signum()).abs(),
        });
        violation.fold(0.0, f64::max) / self.gamma
    }

    /// One sweep of coordinate descent.
    fn sweep(&mut self) {
        let m = self.working.len();
        for k in 0..m {
            let own = self.gram[k * m + k];
            if own <= 0.0 {
                continue;
            }
            let pull = self.correlations[k] + own * self.weights[k];
            let weight = pull.signum() * (pull.abs() - self.gamma).max(0.0) / own;
            let change = weight - self.weights[k];
            if change != 0.0 {
                self.weights[k] = weight;
                let row = &self.gram[k * m..(k + 1) * m];
                (self.correlations.iter_mut().zip(row)).for_each(|(c, g)| *c -= change * g);
            }
        }
    }

    /// Goes toward the minimum for the present signs; a weight that reaches 0 on the way stays
    /// there, and the rest goes on.
    fn step_to_signs(&mut self) {
        let m = self.working.len();
        for _ in 0..m {
            let support: Vec<usize> = (0..m).filter(|k| self.weights[*k] != 0.0).collect();
            let s = support.len();
            let row = |a: &usize| {
                let row = &self.gram[a * m..(a + 1) * m];
                support.iter().map(|b| row[*b])
            };
            let mut gram: Vec<f64> = support.iter().flat_map(row).collect();
            let mut goal: Vec<f64> = (support.iter())
                .map(|k| {
                    self.products[self.pose * self.n + self.working[*k]]
                        - self.gamma * self.weights[*k].signum()
                })
                .collect();
            factorize(&mut gram, s);
            forward(&gram, s, &mut goal);
            backward(&gram, s, &mut goal);
            if !goal.iter().all(|v| v.is_finite()) {
                return;
            }
            let share = |(k, goal): (&usize, &f64)| {
                let weight = self.weights[*k];
                (weight * goal <= 0.0).then(|| (weight / (weight - goal), *k))
            };
            let blocks = support.iter().zip(&goal).filter_map(share);
            let first = blocks.min_by(|a, b| a.0.total_cmp(&b.0));
            let part = first.map_or(1.0, |(part, _)| part);
            for (k, goal) in support.iter().zip(&goal) {
                self.weights[*k] += part * (goal - self.weights[*k]);
            }
            match first {
                Some((_, k)) => self.weights[k] = 0.0,
                None => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    fn poses(n: usize, d: usize) -> Array2<f64> {
        use rand::Rng;
        let mut rng = parallel::rng(5, 0);
        let basis = Array2::from_shape_fn((4, d), |_| rng.random_range(-1.0..1.0));
        let codes = Array2::from_shape_fn((n, 4), |_| rng.random_range(0.0..1.0));
        let noise = Array2::from_shape_fn((n, d), |_| rng.random_range(-0.05..0.05));
        codes.dot(&basis) + noise
    }

    #[test]
    fn optimality_holds_for_every_pose() {
        let x = poses(120, 12);
        let products = x.dot(&x.t());
        let graph = SparseGraph::code(products.view(), 0.05, 1e-6);
        assert!(graph.violation <= 1e-6);
        for (i, weights) in graph.weights.iter().enumerate() {
            let mut rest = x.row(i).to_owned();
            weights
                .iter()
                .for_each(|(j, w)| rest.scaled_add(-w, &x.row(*j)));
            let largest = (0..120)
                .filter(|j| *j != i)
                .map(|j| products[[i, j]].abs())
                .fold(0.0, f64::max);
            for j in (0..120).filter(|j| *j != i) {
                let correlation = x.row(j).dot(&rest) / (0.05 * largest);
                let expected = weights.iter().find(|(k, _)| *k == j);
                let violation = match expected {
                    Some((_, w)) => (correlation - w.signum()).abs(),
                    None => correlation.abs() - 1.0,
                };
                assert!(violation <= 2e-6, "pose {i} on {j}: {violation}");
            }
        }
    }

    #[test]
    fn a_pose_is_not_its_own_neighbor_and_large_gamma_gives_no_weights() {
        let x = poses(30, 6);
        let products = x.dot(&x.t());
        let graph = SparseGraph::code(products.view(), 0.1, 1e-6);
        assert!(
            graph
                .weights
                .iter()
                .enumerate()
                .all(|(i, w)| w.iter().all(|(j, _)| *j != i))
        );
        assert!(graph.weights.iter().any(|w| !w.is_empty()));
        let none = SparseGraph::code(products.view(), 1.0, 1e-6);
        assert!(none.weights.iter().all(Vec::is_empty));
    }

    #[test]
    fn duplicates_and_poses_of_zeros_converge() {
        let x = array![[1.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.5, 0.5], [1.0, 0.0]];
        let graph = SparseGraph::code(x.dot(&x.t()).view(), 0.01, 1e-6);
        assert!(graph.violation <= 1e-6);
        let sum: f64 = graph.weights[0].iter().map(|(_, w)| w).sum();
        assert!((sum - 0.99).abs() < 1e-6);
        assert!(graph.weights[2].is_empty());
    }
}
