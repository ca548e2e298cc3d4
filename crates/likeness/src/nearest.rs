//! The nearest poses of a database, exactly.
//!
//! Squared distances |q|² + |x|² - 2 qᵀx come from products of blocks of queries and poses, about
//! the mean of the poses. Products are rounded, so each distance is known between two bounds; what
//! may be among the k nearest by its lower bound is kept, and is compared by its differences at the
//! end. City-block distances are summed directly.

use super::pose_metric::Norm;
use crate::numeric::parallel;
use ndarray::{Array1, Array2, ArrayView2, s};

/// Queries and poses of one block.
const QUERIES: usize = 32;
const POSES: usize = 2048;
/// Half the distance of 1 to the next f32.
const UNIT: f32 = f32::EPSILON / 2.0;

/// Poses as vectors, to be searched.
#[derive(Debug, Clone)]
pub struct PoseDatabase {
    /// (poses, dimensions).
    vectors: Array2<f32>,
    /// The vectors about their mean.
    centered: Array2<f32>,
    mean: Array1<f32>,
    /// Their squared lengths.
    squares: Array1<f32>,
    norm: Norm,
}

/// A pose found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Its row.
    pub row: usize,
    /// The distance.
    pub distance: f32,
}

impl PoseDatabase {
    /// A database of vectors (poses, dimensions). Rows with NaN are never found.
    pub fn new(vectors: Array2<f32>, norm: Norm) -> PoseDatabase {
        let mean = mean(&vectors);
        let centered = &vectors - &mean;
        PoseDatabase {
            squares: centered.rows().into_iter().map(|v| v.dot(&v)).collect(),
            vectors,
            centered,
            mean,
            norm,
        }
    }

    /// The `k` nearest poses of each query (queries, dimensions), nearest first, of equal ones the
    /// first; fewer where the database, or what `allowed` (query, row) leaves of it, is
    /// smaller; none for a query with NaN.
    ///
    /// ```
    /// use ndarray::array;
    /// use posing_likeness::{PoseDatabase, pose_metric::Norm};
    ///
    /// let poses = array![[0.0, 0.0], [3.0, 4.0], [9.0, 9.0]];
    /// let database = PoseDatabase::new(poses, Norm::Euclidean);
    /// let found = database.nearest(array![[0.0, 1.0]].view(), 2, |_, row| row != 2);
    /// assert_eq!((found[0][0].row, found[0][0].distance), (0, 1.0));
    /// assert_eq!(found[0][1].row, 1);
    /// ```
    pub fn nearest(
        &self,
        queries: ArrayView2<'_, f32>,
        k: usize,
        allowed: impl Fn(usize, usize) -> bool + Sync,
    ) -> Vec<Vec<Neighbor>> {
        // A lone query is shared by its poses, many by their queries.
        if queries.nrows() < QUERIES / 2 {
            return (0..queries.nrows())
                .map(|q| self.nearest_of_one(queries, q, k, &allowed))
                .collect();
        }
        let parts = parallel::map_chunks(queries.nrows(), QUERIES, |range| {
            let mut best: Vec<Best> = range.clone().map(|_| Best::new(k)).collect();
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
    ) -> Vec<Neighbor> {
        let parts = parallel::map_chunks(self.vectors.nrows(), 8 * POSES, |rows| {
            let mut best = vec![Best::new(k)];
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
        match self.norm {
            Norm::City => {
                let block = self.vectors.slice(s![start..end, ..]);
                for (q, best) in range.zip(best) {
                    for (x, row) in block.rows().into_iter().enumerate() {
                        let distance = self.norm.distance(queries.row(q), row);
                        best.offer([distance; 2], start + x, |row| allowed(q, row));
                    }
                }
            }
            Norm::Euclidean => {
                let own = &queries.slice(s![range.clone(), ..]) - &self.mean;
                let products = own.dot(&self.centered.slice(s![start..end, ..]).t());
                let squares = self.squares.slice(s![start..end]);
                // The error of a sum of d products is at most that share of the lengths (Higham,
                // Accuracy and Stability of Numerical Algorithms, 3.1); |q|² is the
                // same for all, and left out.
                let share = (self.vectors.ncols() + 4) as f32 * UNIT;
                for (((q, best), own), products) in
                    range.zip(best).zip(own.rows()).zip(products.rows())
                {
                    let slack = share * own.dot(&own);
                    for (x, (product, square)) in products.iter().zip(squares).enumerate() {
                        let key = square - 2.0 * product;
                        let error = 2.0 * share * square + slack;
                        best.offer([key - error, key + error], start + x, |row| allowed(q, row));
                    }
                }
            }
        }
    }

    /// The `k` nearest of some rows, by their differences.
    fn exact(
        &self,
        queries: ArrayView2<'_, f32>,
        q: usize,
        rows: Vec<Kept>,
        k: usize,
    ) -> Vec<Neighbor> {
        let distance = |row| self.norm.distance(queries.row(q), self.vectors.row(row));
        let mut found: Vec<Neighbor> = (rows.into_iter())
            .map(|kept| Neighbor {
                row: kept.row,
                distance: distance(kept.row),
            })
            .collect();
        found.sort_by(|a, b| (a.distance.total_cmp(&b.distance)).then(a.row.cmp(&b.row)));
        found.truncate(k);
        found
    }
}

/// A pose that may be among the nearest, and the bounds of its key.
#[derive(Debug, Clone, Copy)]
struct Kept {
    lower: f32,
    upper: f32,
    row: usize,
}

/// What may be among the `most` smallest keys so far, not in order.
struct Best {
    most: usize,
    /// No key above it can be among them.
    bound: f32,
    /// The length at which what is kept is thinned out.
    full: usize,
    kept: Vec<Kept>,
}

impl Best {
    fn new(most: usize) -> Best {
        Best {
            most,
            bound: f32::INFINITY,
            full: 2 * most + 16,
            kept: Vec::new(),
        }
    }

    fn offer(&mut self, [lower, upper]: [f32; 2], row: usize, allowed: impl Fn(usize) -> bool) {
        // NaN is never below the bound.
        if lower <= self.bound && allowed(row) {
            self.kept.push(Kept { lower, upper, row });
            if self.kept.len() >= self.full {
                self.thin();
            }
        }
    }

    fn thin(&mut self) {
        let by_upper = |a: &Kept, b: &Kept| a.upper.total_cmp(&b.upper);
        let (_, last, _) = self.kept.select_nth_unstable_by(self.most - 1, by_upper);
        let bound = last.upper;
        self.kept.retain(|kept| kept.lower <= bound);
        self.bound = bound;
        // Where many poses are equally near, all are kept; thinning must not become the work.
        self.full = 2 * self.kept.len().max(self.most) + 16;
    }
}

/// The mean of the rows that are finite.
fn mean(vectors: &Array2<f32>) -> Array1<f32> {
    let mut sum = Array1::<f64>::zeros(vectors.ncols());
    let mut count = 0.0;
    for row in vectors.rows() {
        if row.iter().all(|v| v.is_finite()) {
            sum.zip_mut_with(&row, |s, v| *s += f64::from(*v));
            count += 1.0;
        }
    }
    sum.mapv(|s| (s / f64::max(count, 1.0)) as f32)
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
                let mut all: Vec<Neighbor> = (0..5000)
                    .filter(|row| q != row % 50 && *row != 17)
                    .map(|row| Neighbor {
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
    fn poses_that_hardly_differ_are_told_apart() {
        // Far from the origin, and nearer to each other than products tell.
        let poses = vectors(3000, 3).mapv(|v| 40.0 + 3e-4 * v);
        let database = PoseDatabase::new(poses.clone(), Norm::Euclidean);
        let found = database.nearest(poses.slice(s![..200, ..]), 1, |_, _| true);
        for (q, found) in found.iter().enumerate() {
            assert_eq!((found[0].row, found[0].distance), (q, 0.0));
        }
        let still = Array2::from_elem((3000, 7), 5.0);
        let database = PoseDatabase::new(still.clone(), Norm::Euclidean);
        let found = database.nearest(still.slice(s![..20, ..]), 2, |_, _| true);
        assert!(found.iter().all(|f| f[0].row == 0 && f[1].row == 1));
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
