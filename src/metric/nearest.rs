//! The nearest poses of a database, exactly.
//!
//! Squared distances |q|² + |x|² - 2 qᵀx come from products of blocks of queries and poses; of each block only what is nearer than
//! the k-th so far is kept, and the kept distances are computed again from the differences, since the products cancel for poses
//! close by. City-block distances are summed directly.

use super::pose_metric::Norm;
use crate::numeric::parallel;
use ndarray::{Array1, Array2, ArrayView2, s};

/// Queries and poses of one block.
const QUERIES: usize = 32;
const POSES: usize = 2048;
/// Neighbours that are kept beyond those asked for, since distances by products are rounded.
const SPARE: usize = 8;

/// Poses as vectors, to be searched.
#[derive(Debug, Clone)]
pub struct PoseDatabase {
    /// (poses, dimensions).
    vectors: Array2<f32>,
    squares: Array1<f32>,
    norm: Norm,
}

/// A pose found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// Its row.
    pub row: usize,
    /// The distance.
    pub distance: f32,
}

impl PoseDatabase {
    /// A database of vectors (poses, dimensions). Rows with NaN are never found.
    pub fn new(vectors: Array2<f32>, norm: Norm) -> PoseDatabase {
        let squares = vectors.rows().into_iter().map(|v| v.dot(&v)).collect();
        PoseDatabase {
            vectors,
            squares,
            norm,
        }
    }

    /// The `k` nearest poses of each query (queries, dimensions), nearest first, of equal ones the first; fewer where the
    /// database, or what `allowed` (query, row) leaves of it, is smaller; none for a query with NaN.
    pub fn nearest(
        &self,
        queries: ArrayView2<'_, f32>,
        k: usize,
        allowed: impl Fn(usize, usize) -> bool + Sync,
    ) -> Vec<Vec<Neighbour>> {
        // A lone query is shared by its poses, many by their queries.
        if queries.nrows() < QUERIES / 2 {
            return (0..queries.nrows())
                .map(|q| self.nearest_of_one(queries, q, k, &allowed))
                .collect();
        }
        let parts = parallel::map_chunks(queries.nrows(), QUERIES, |range| {
            let mut best: Vec<Best> = range.clone().map(|_| Best::new(k + SPARE)).collect();
            for start in (0..self.vectors.nrows()).step_by(POSES) {
                self.scan(queries, range.clone(), start, &allowed, &mut best);
            }
            let found = range.zip(best);
            found
                .map(|(q, best)| self.exact(queries, q, best.kept, k))
                .collect::<Vec<_>>()
        });
        parts.concat()
    }

    fn nearest_of_one(
        &self,
        queries: ArrayView2<'_, f32>,
        q: usize,
        k: usize,
        allowed: &(impl Fn(usize, usize) -> bool + Sync),
    ) -> Vec<Neighbour> {
        let parts = parallel::map_chunks(self.vectors.nrows(), 8 * POSES, |rows| {
            let mut best = vec![Best::new(k + SPARE)];
            for start in rows.clone().step_by(POSES) {
                self.scan(queries, q..q + 1, start, allowed, &mut best);
            }
            best.remove(0).kept
        });
        self.exact(queries, q, parts.concat(), k)
    }

    /// Offers the block of poses from `start` to the queries of a range.
    fn scan(
        &self,
        queries: ArrayView2<'_, f32>,
        range: std::ops::Range<usize>,
        start: usize,
        allowed: &(impl Fn(usize, usize) -> bool + Sync),
        best: &mut [Best],
    ) {
        let end = (start + POSES).min(self.vectors.nrows());
        let block = self.vectors.slice(s![start..end, ..]);
        let squares = self.squares.slice(s![start..end]);
        let own = queries.slice(s![range.clone(), ..]);
        let products = match self.norm {
            Norm::Euclidean => own.dot(&block.t()),
            Norm::City => Array2::from_shape_fn((range.len(), end - start), |(q, x)| {
                self.norm.distance(own.row(q), block.row(x))
            }),
        };
        for ((q, best), products) in range.zip(best).zip(products.rows()) {
            for (x, (product, square)) in products.iter().zip(squares).enumerate() {
                let key = match self.norm {
                    // |q|² is the same for all.
                    Norm::Euclidean => square - 2.0 * product,
                    Norm::City => *product,
                };
                // NaN is never below the bound.
                if key < best.bound && allowed(q, start + x) {
                    best.offer(start + x, key);
                }
            }
        }
    }

    /// The `k` nearest of some rows, by their differences.
    fn exact(
        &self,
        queries: ArrayView2<'_, f32>,
        q: usize,
        rows: Vec<(f32, usize)>,
        k: usize,
    ) -> Vec<Neighbour> {
        let distance = |row| self.norm.distance(queries.row(q), self.vectors.row(row));
        let mut found: Vec<Neighbour> = (rows.into_iter())
            .map(|(_, row)| Neighbour {
                row,
                distance: distance(row),
            })
            .collect();
        found.sort_by(|a, b| (a.distance.total_cmp(&b.distance)).then(a.row.cmp(&b.row)));
        found.truncate(k);
        found
    }
}

/// The smallest keys so far, not in order.
struct Best {
    most: usize,
    bound: f32,
    kept: Vec<(f32, usize)>,
}

impl Best {
    fn new(most: usize) -> Best {
        Best {
            most,
            bound: f32::INFINITY,
            kept: Vec::with_capacity(2 * most + 1),
        }
    }

    fn offer(&mut self, row: usize, key: f32) {
        self.kept.push((key, row));
        // Thinned out now and then, not at every offer.
        if self.kept.len() >= 2 * self.most {
            let order =
                |a: &(f32, usize), b: &(f32, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
            self.kept.select_nth_unstable_by(self.most - 1, order);
            self.kept.truncate(self.most);
            self.bound = self.kept[self.most - 1].0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    fn vectors(rows: usize, seed: u64) -> Array2<f32> {
        let mut rng = parallel::rng(seed, 0);
        Array2::from_shape_fn((rows, 7), |_| rng.random_range(-1.0..1.0))
    }

    #[test]
    fn the_nearest_are_those_of_a_plain_search_for_one_query_and_for_many() {
        let (mut poses, queries) = (vectors(5000, 1), vectors(60, 2));
        poses.row_mut(17).fill(f32::NAN);
        for norm in [Norm::Euclidean, Norm::City] {
            let database = PoseDatabase::new(poses.clone(), norm);
            let many = database.nearest(queries.view(), 10, |q, row| q != row % 50);
            for q in 0..60 {
                let mut all: Vec<Neighbour> = (0..5000)
                    .filter(|row| q != row % 50 && *row != 17)
                    .map(|row| Neighbour {
                        row,
                        distance: norm.distance(queries.row(q), poses.row(row)),
                    })
                    .collect();
                all.sort_by(|a, b| a.distance.total_cmp(&b.distance));
                assert_eq!(many[q], all[..10]);
            }
            let one = database.nearest(queries.slice(s![3..4, ..]), 10, |_, row| row % 50 != 3);
            assert_eq!(one[0], many[3]);
        }
    }

    #[test]
    fn a_small_database_gives_all_it_has() {
        let database = PoseDatabase::new(vectors(3, 1), Norm::Euclidean);
        let found = database.nearest(vectors(2, 1).view(), 5, |_, _| true);
        assert_eq!(found[0].len(), 3);
        assert_eq!((found[0][0].row, found[0][0].distance), (0, 0.0));
        let nothing = Array2::from_elem((1, 7), f32::NAN);
        assert!(database.nearest(nothing.view(), 5, |_, _| true)[0].is_empty());
    }
}
