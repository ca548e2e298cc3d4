//! Linear systems of a tree: row i has entries in the columns of its ancestors only, as the normal
//! equations of a skeleton do.
//!
//! `H = Lᵀ L` from the leaves inwards keeps every zero (R. Featherstone, Rigid Body Dynamics
//! Algorithms, 2008, section 6.5), so that a solution costs O(n depth²), not O(n³ / 3).

/// Solves `H x = b`; x replaces `b`.
///
/// `h`: the lower triangle of a symmetric matrix (n, n), row after row, which is lost; `parents[i]
/// < i` is the next column of row i that is not zero, from the diagonal downwards. `false` where H
/// is not positive definite to rounding, or not finite; then `b` is lost.
pub(crate) fn solve_tree(h: &mut [f64], parents: &[Option<usize>], b: &mut [f64]) -> bool {
    let n = parents.len();
    let above = |k: usize| std::iter::successors(parents[k], |&i| parents[i]);
    let mut path = Vec::with_capacity(n);
    for k in (0..n).rev() {
        let pivot = h[k * n + k];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        h[k * n + k] = root;
        path.clear();
        path.extend(above(k));
        let (rows, row) = h.split_at_mut(k * n);
        path.iter().for_each(|&i| row[i] /= root);
        for (m, &i) in path.iter().enumerate() {
            let (factor, to) = (row[i], &mut rows[i * n..][..=i]);
            path[m..].iter().for_each(|&j| to[j] -= factor * row[j]);
        }
    }
    for k in (0..n).rev() {
        b[k] /= h[k * n + k];
        for i in above(k) {
            b[i] -= h[k * n + i] * b[k];
        }
    }
    for k in 0..n {
        let known: f64 = above(k).map(|i| h[k * n + i] * b[i]).sum();
        b[k] = (b[k] - known) / h[k * n + k];
    }
    b.iter().all(|v| v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tree of seven rows with two branches, and a second root.
    const PARENTS: [Option<usize>; 7] = [None, Some(0), Some(1), Some(1), Some(3), None, Some(5)];

    fn tree() -> Vec<f64> {
        let mut h = vec![0.0; 49];
        for k in 0..7 {
            h[8 * k] = 10.0 + k as f64;
            for i in std::iter::successors(PARENTS[k], |&i| PARENTS[i]) {
                h[7 * k + i] = 1.0 + 0.3 * (k * i) as f64;
            }
        }
        h
    }

    #[test]
    fn a_solution_satisfies_its_equations() {
        let h = tree();
        let b: Vec<f64> = (0..7).map(|i| (1.0 + i as f64).sin()).collect();
        let mut x = b.clone();
        assert!(solve_tree(&mut h.clone(), &PARENTS, &mut x));
        for k in 0..7 {
            let entry = |i: usize| h[7 * k.max(i) + k.min(i)];
            let sum: f64 = (0..7).map(|i| entry(i) * x[i]).sum();
            assert!((sum - b[k]).abs() <= 1e-12, "row {k}: {sum} for {}", b[k]);
        }
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        let mut h = tree();
        h[8] = -1.0;
        assert!(!solve_tree(&mut h, &PARENTS, &mut [1.0; 7]));
    }
}
