//! The graph of nearest neighbors.

use super::scatter::centered;
use crate::numeric::parallel::map_chunks;
use ndarray::{Array1, ArrayView2, s};

/// Rows whose distances to all others are held at one time.
const ROWS: usize = 64;

/// The edges (i, j), i < j, between rows of which one is among the `k` nearest of the other; each
/// once, in rising order.
///
/// Where distances are equal the lower row counts as nearer. O(n² d) time, O(n (k + d)) memory.
pub(super) fn edges(x: ArrayView2<'_, f64>, k: usize) -> Vec<[usize; 2]> {
    // Far from the origin products would cancel.
    let x = centered(x);
    let squares: Array1<f64> = x.rows().into_iter().map(|row| row.dot(&row)).collect();
    let mut edges = map_chunks(x.nrows(), ROWS, |rows| {
        let products = x.slice(s![rows.clone(), ..]).dot(&x.t());
        let of = |(i, products): (usize, _)| {
            let near = nearest(i, products, &squares, k);
            near.into_iter().map(move |j| [i.min(j), i.max(j)])
        };
        let each = rows.zip(products.rows()).flat_map(of);
        each.collect::<Vec<_>>()
    })
    .concat();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// The `k` rows nearest to row `i`, given its products with all.
fn nearest(
    i: usize,
    products: ndarray::ArrayView1<'_, f64>,
    squares: &Array1<f64>,
    k: usize,
) -> Vec<usize> {
    let mut near: Vec<(f64, usize)> = Vec::with_capacity(k + 1);
    for (j, (product, square)) in products.iter().zip(squares).enumerate() {
        let distance = square - 2.0 * product; // less |x_i|², which is the same for all
        if j == i || (near.len() == k && near.last().is_none_or(|last| distance >= last.0)) {
            continue;
        }
        let at = near.partition_point(|other| other.0 <= distance);
        near.insert(at, (distance, j));
        near.truncate(k);
    }
    near.into_iter().map(|(_, j)| j).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    #[test]
    fn a_line_of_poses_is_a_chain() {
        let x = array![[0.0], [1.0], [2.5], [3.0], [9.0]];
        assert_eq!(edges(x.view(), 1), [[0, 1], [2, 3], [3, 4]]);
        assert!(edges(x.view(), 0).is_empty());
        assert_eq!(edges(x.view(), 99).len(), 10);
    }

    #[test]
    fn the_nearest_are_those_of_all_distances() {
        let x = Array2::from_shape_fn((150, 3), |(i, j)| {
            ((i * 17 + j * 5) as f64 * 1.3).sin() + 9.0
        });
        let apart = |i: usize, j: usize| (&x.row(i) - &x.row(j)).mapv(|v| v * v).sum();
        let mut want = Vec::new();
        for i in 0..150 {
            let mut others: Vec<usize> = (0..150).filter(|&j| j != i).collect();
            others.sort_by(|&a, &b| apart(i, a).total_cmp(&apart(i, b)));
            want.extend(others[..4].iter().map(|&j| [i.min(j), i.max(j)]));
        }
        want.sort_unstable();
        want.dedup();
        assert_eq!(edges(x.view(), 4), want);
    }

    #[test]
    fn copies_are_neighbors_and_no_row_its_own() {
        assert_eq!(edges(Array2::ones((3, 2)).view(), 1), [[0, 1], [0, 2]]);
        assert!(edges(Array2::ones((1, 2)).view(), 5).is_empty());
    }
}
