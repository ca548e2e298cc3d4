//! The nearest poses of a database, exactly.
//!
//! A pose is a vector, or those of the frames of a window side by side. A distance is at least the
//! part of the middle frame. Its square, |q|² + |x|² - 2 qᵀx, comes from products of blocks of
//! queries and frames about their mean, less what rounding may be; a pose for which that is above
//! the distances found so far is none of the nearest. Others are compared by their differences,
//! and all are by city-block distances.

use super::pose_metric::Norm;
use crate::io::Matrix;
use crate::numeric::parallel;
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, s};
use std::borrow::Cow;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Queries and poses of one block.
const QUERIES: usize = 128;
const POSES: usize = 1024;
/// Half the distance of 1 to the next f32.
const UNIT: f32 = f32::EPSILON / 2.0;
/// Frames whose mean stands for that of all.
const MEAN_OF: usize = 1000;

/// Poses as vectors, to be searched.
pub struct PoseDatabase<'a> {
    /// A row for each frame (frames, dimensions of a frame).
    frames: Cow<'a, Matrix>,
    /// The number of poses.
    poses: usize,
    /// The frames of a pose, an odd number.
    window: Box<dyn Fn(usize) -> Vec<usize> + Sync + 'a>,
    mean: Array1<f32>,
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

impl Eq for Neighbor {}

impl PartialOrd for Neighbor {
    fn partial_cmp(&self, other: &Neighbor) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// Nearer ones first; of equal ones the first row.
impl Ord for Neighbor {
    fn cmp(&self, other: &Neighbor) -> std::cmp::Ordering {
        (self.distance.total_cmp(&other.distance)).then(self.row.cmp(&other.row))
    }
}

impl<'a> PoseDatabase<'a> {
    /// A database of vectors (poses, dimensions). Rows with NaN are never found.
    pub fn new(vectors: Array2<f32>, norm: Norm) -> PoseDatabase<'static> {
        let poses = vectors.nrows();
        PoseDatabase::of_windows(Cow::Owned(vectors.into()), norm, poses, |row| vec![row])
    }

    /// A database of `poses` poses, which are the vectors of the frames that `window` tells side
    /// by side, of each an equal, odd number.
    pub(crate) fn of_windows(
        frames: Cow<'a, Matrix>,
        norm: Norm,
        poses: usize,
        window: impl Fn(usize) -> Vec<usize> + Sync + 'a,
    ) -> PoseDatabase<'a> {
        PoseDatabase {
            mean: mean(&frames),
            frames,
            poses,
            window: Box::new(window),
            norm,
        }
    }

    /// The vectors of all poses (poses, dimensions).
    pub fn vectors(&self) -> Array2<f32> {
        let mut all = Vec::new();
        for pose in 0..self.poses {
            self.extend_with(pose, &mut all);
        }
        let width = all.len() / self.poses.max(1);
        // As many as there are: cannot fail.
        Array2::from_shape_vec((self.poses, width), all).unwrap_or_default()
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
        // Few queries are shared by their poses, many by themselves.
        if queries.nrows() < QUERIES / 2 {
            let parts = parallel::map_chunks(self.poses, 16 * POSES, |poses| {
                self.scan(queries, 0..queries.nrows(), poses, k, &allowed)
            });
            return (0..queries.nrows())
                .map(|q| {
                    let parts = parts.iter().flat_map(|part| &part[q]);
                    let mut all: Vec<Neighbor> = parts.copied().collect();
                    all.sort_unstable();
                    all.truncate(k);
                    all
                })
                .collect();
        }
        let parts = parallel::map_chunks(queries.nrows(), QUERIES, |range| {
            self.scan(queries, range, 0..self.poses, k, &allowed)
        });
        parts.concat()
    }

    /// The nearest of some poses to some queries, nearest first.
    fn scan(
        &self,
        queries: ArrayView2<'_, f32>,
        range: Range<usize>,
        poses: Range<usize>,
        k: usize,
        allowed: &(impl Fn(usize, usize) -> bool + Sync),
    ) -> Vec<Vec<Neighbor>> {
        let mut best: Vec<Best> = range.clone().map(|_| Best::new(k)).collect();
        let middles = self.middles(queries.slice(s![range.clone(), ..]));
        let mut vector = Vec::new();
        for start in poses.clone().step_by(POSES) {
            let block = start..(start + POSES).min(poses.end);
            let least = self.least_squares(&middles, block.clone());
            for ((q, best), least) in range.clone().zip(&mut best).zip(least.rows()) {
                let query = queries.row(q);
                for (row, least) in block.clone().zip(least) {
                    // NaN goes on, and is no distance.
                    if *least > best.bound_squared || !allowed(q, row) {
                        continue;
                    }
                    vector.clear();
                    self.extend_with(row, &mut vector);
                    let distance = self.norm.distance(query, ArrayView1::from(&vector));
                    best.offer(Neighbor { row, distance });
                }
            }
        }
        best.into_iter().map(Best::sorted).collect()
    }

    /// The middle frames of queries, about the mean.
    fn middles(&self, queries: ArrayView2<'_, f32>) -> Array2<f32> {
        let width = self.mean.len();
        let before = queries.ncols().saturating_sub(width) / 2;
        &queries.slice(s![.., before..before + width]) - &self.mean
    }

    /// What the squared distances of queries and poses are at least (queries, poses).
    fn least_squares(&self, middles: &Array2<f32>, poses: Range<usize>) -> Array2<f32> {
        if self.norm == Norm::City {
            return Array2::zeros((middles.nrows(), poses.len()));
        }
        let middle = |pose| {
            let window = (self.window)(pose);
            window[window.len() / 2]
        };
        let frames = self.frames.rows(poses.map(middle)) - &self.mean;
        // The error of a sum of d products is at most that share of the lengths (Higham, Accuracy
        // and Stability of Numerical Algorithms, 3.1).
        let share = 2.0 * (self.mean.len() + 8) as f32 * UNIT;
        let square = |v: ArrayView1<'_, f32>| (1.0 - share) * v.dot(&v);
        let squares: Array1<f32> = frames.rows().into_iter().map(square).collect();
        let mut out = middles.dot(&frames.t());
        for (mut out, own) in out.rows_mut().into_iter().zip(middles.rows()) {
            let own = square(own);
            out.zip_mut_with(&squares, |out, square| *out = own + square - 2.0 * *out);
        }
        out
    }

    /// Appends the vector of a pose.
    fn extend_with(&self, pose: usize, out: &mut Vec<f32>) {
        for frame in (self.window)(pose) {
            self.frames.extend_with(frame, out);
        }
    }
}

/// The nearest of those that were offered so far.
struct Best {
    most: usize,
    /// No pose whose squared distance is above it can be among them.
    bound_squared: f32,
    kept: BinaryHeap<Neighbor>,
}

impl Best {
    fn new(most: usize) -> Best {
        Best {
            most,
            bound_squared: if most == 0 { -1.0 } else { f32::INFINITY },
            kept: BinaryHeap::new(),
        }
    }

    fn offer(&mut self, pose: Neighbor) {
        if pose.distance.is_nan() {
            return;
        }
        self.kept.push(pose);
        if self.kept.len() > self.most {
            self.kept.pop();
        }
        if self.kept.len() == self.most
            && let Some(last) = self.kept.peek()
        {
            // The distance's own rounding.
            self.bound_squared = 1.001 * last.distance * last.distance;
        }
    }

    fn sorted(self) -> Vec<Neighbor> {
        self.kept.into_sorted_vec()
    }
}

/// The mean of rows that are finite, some for all.
fn mean(frames: &Matrix) -> Array1<f32> {
    let step = frames.nrows().div_ceil(MEAN_OF).max(1);
    let rows = frames.rows((0..frames.nrows()).step_by(step));
    let mut sum = Array1::<f64>::zeros(frames.ncols());
    let mut count = 0.0;
    for row in rows.rows() {
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
