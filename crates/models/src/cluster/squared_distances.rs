//! Distances from many poses to many centroids, in blocks that stay in cache.
//!
//! With m a pose near the middle of the table, `|x - c|² = |x'|² + (|c'|² - 2 x'·c')` where
//! x' = x - m and c' = c - m. The bracket is the **score**: one product of the rows (x', 1) and
//! (-2 c', |c'|²), in f32. Subtracting m first matters: far from the origin (poses in world space)
//! the large terms would cancel and take the digits with them.
//!
//! Rounding of a score, for D coordinates and unit roundoff e = 2^-24 (Higham, Accuracy and
//! Stability of Numerical Algorithms, eq. 3.5): at most about e (D + 4) (2 |x'| |c'| + |c'|²).
//! Twice that is used ([`Centroids::margin`]). Where the best and the second-best score are closer
//! than two margins, every distance of that pose is computed again in f64.

use super::KMeans;
use super::dataset::{Dataset, LARGEST, NearestCentroid, exact_nearest, squared_distance};
use crate::numeric::parallel;
use crate::{Error, Result};
use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, ArrayView2, s};

/// Poses scanned together; centroids scanned together. Scores of a tile: 256 KiB.
pub(super) const TILE: usize = 128;
const BLOCK: usize = 512;
/// Lanes of sums and searches.
const LANES: usize = 8;
/// Relative slack put on f64 distances that serve as bounds: far above their rounding, far below
/// what matters.
pub(super) const SLACK: f64 = 1e-10;

/// Centroids made ready for scanning.
pub(super) struct Centroids {
    /// As they are, (k, d).
    exact: Array2<f64>,
    /// Rows (-2 c', |c'|²), (k, d + 1).
    scanned: Array2<f32>,
    /// m, (d).
    middle: Vec<f32>,
    /// The largest |c'|.
    max_norm: f64,
}

/// What one thread needs to scan; made once a chunk of work.
pub(super) struct Scratch {
    /// Rows (x', 1), (TILE, d + 1).
    tile: Array2<f32>,
    /// (TILE, BLOCK)
    scores: Array2<f32>,
    /// Rows of `scanned` of the candidates, (candidates, d + 1).
    gathered: Vec<f32>,
}

impl Scratch {
    /// For poses of `d` coordinates.
    pub(crate) fn new(d: usize) -> Self {
        Scratch {
            tile: Array2::ones((TILE, d + 1)),
            scores: Array2::zeros((TILE, BLOCK)),
            gathered: Vec::new(),
        }
    }
}

impl Centroids {
    /// Prepares `exact` (k, d); `middle` (d) is any point near the poses.
    pub(crate) fn new(exact: Array2<f64>, middle: &[f32]) -> Self {
        let (k, d) = exact.dim();
        let mut scanned = Array2::zeros((k, d + 1));
        let mut max_norm = 0.0f64;
        for (mut row, c) in scanned.rows_mut().into_iter().zip(exact.rows()) {
            let mut squares = 0.0;
            for i in 0..d {
                let shifted = c[i] - f64::from(middle[i]);
                row[i] = (-2.0 * shifted) as f32;
                squares += shifted * shifted;
            }
            row[d] = squares as f32;
            max_norm = max_norm.max(squares.sqrt());
        }
        Centroids {
            exact,
            scanned,
            middle: middle.to_vec(),
            max_norm,
        }
    }

    /// Number of centroids.
    pub(crate) fn k(&self) -> usize {
        self.exact.nrows()
    }

    /// Centroid `j`.
    pub(crate) fn row(&self, j: usize) -> &[f64] {
        let d = self.exact.ncols();
        &self.exact.as_slice().expect("made row by row")[j * d..(j + 1) * d]
    }

    /// The centroids themselves, (k, d).
    pub(crate) fn exact(&self) -> ArrayView2<'_, f64> {
        self.exact.view()
    }

    /// The centroids themselves, (k, d).
    pub(crate) fn into_exact(self) -> Array2<f64> {
        self.exact
    }

    /// How far a score of a point with |x'| = `norm` can be off.
    fn margin(&self, norm: f64) -> f64 {
        let d = self.middle.len() as f64;
        let underflow = (d + 4.0) * f64::from(f32::MIN_POSITIVE);
        f64::from(f32::EPSILON) * (d + 4.0) * (2.0 * norm + self.max_norm) * self.max_norm
            + underflow
    }

    /// The nearest of `candidates` (ascending; all when `None`) for each of at most [`TILE`] poses.
    pub(crate) fn nearest(
        &self,
        poses: Dataset<'_>,
        ids: &[u32],
        candidates: Option<&[u32]>,
        scratch: &mut Scratch,
        found: &mut Vec<NearestCentroid>,
    ) {
        let count = candidates.map_or(self.k(), <[u32]>::len);
        let name = |j: usize| candidates.map_or(j as u32, |c| c[j]);
        let exactly = |i: u32| {
            let all = (0..count).map(|j| (name(j), self.row(name(j) as usize)));
            exact_nearest(poses.row(i as usize), all)
        };
        // A product packs its operands first, which a few poses do not pay back.
        if ids.len() < 4 || count < 4 {
            found.extend(ids.iter().map(|&i| exactly(i)));
            return;
        }
        let norms: Vec<f64> = ids
            .iter()
            .zip(scratch.tile.rows_mut())
            .map(|(&i, mut row)| {
                let row = row.as_slice_mut().expect("a row of a table made here");
                shift(poses.row(i as usize), &self.middle, row)
            })
            .collect();
        let best = self.best_scores(ids.len(), candidates, scratch);
        for ((&i, norm), (first, second, at)) in ids.iter().zip(norms).zip(best) {
            let margin = self.margin(norm);
            found.push(if f64::from(second) - f64::from(first) > 2.0 * margin {
                let label = name(at);
                let squared = squared_distance(poses.row(i as usize), self.row(label as usize));
                let second = f64::from(second) + norm * norm * (1.0 - 1e-6) - margin;
                NearestCentroid {
                    label,
                    squared,
                    second: second.max(0.0),
                }
            } else {
                exactly(i)
            });
        }
    }

    /// The smallest score, the second, and whose the first is among `candidates`, of each of the
    /// first rows of the tile.
    fn best_scores(
        &self,
        rows: usize,
        candidates: Option<&[u32]>,
        scratch: &mut Scratch,
    ) -> Vec<(f32, f32, usize)> {
        let count = candidates.map_or(self.k(), <[u32]>::len);
        let width = self.middle.len() + 1;
        let Scratch {
            tile,
            scores,
            gathered,
        } = scratch;
        gathered.clear();
        if let Some(candidates) = candidates {
            let all = self.scanned.as_slice().expect("made row by row");
            for &j in candidates {
                gathered.extend_from_slice(&all[j as usize * width..(j as usize + 1) * width]);
            }
        }
        let scanned = match candidates {
            None => self.scanned.view(),
            Some(_) => ArrayView2::from_shape((count, width), gathered).expect("rows gathered"),
        };
        let mut best = vec![(f32::INFINITY, f32::INFINITY, 0usize); rows];
        let tile = tile.slice(s![..rows, ..]);
        for start in (0..count).step_by(BLOCK) {
            let end = (start + BLOCK).min(count);
            let mut scores = scores.slice_mut(s![..rows, ..end - start]);
            general_mat_mul(
                1.0,
                &tile,
                &scanned.slice(s![start..end, ..]).t(),
                0.0,
                &mut scores,
            );
            for (best, row) in best.iter_mut().zip(scores.rows()) {
                let (first, second, at) = two_smallest(row.to_slice().expect("contiguous"));
                if first < best.0 {
                    *best = (first, second.min(best.0), start + at);
                } else {
                    best.1 = best.1.min(first);
                }
            }
        }
        best
    }

    /// Distances from each centroid of `of` (at most [`TILE`]) to every centroid, (of, k): none is
    /// too long.
    pub(crate) fn centroid_distances(&self, of: &[u32], scratch: &mut Scratch) -> Array2<f32> {
        let width = self.middle.len() + 1;
        let mut distances_to = Array2::zeros((of.len(), self.k()));
        let mut norms = Vec::with_capacity(of.len());
        for (&j, mut row) in of.iter().zip(scratch.tile.rows_mut()) {
            let c = self.scanned.row(j as usize);
            (0..width - 1).for_each(|i| row[i] = -0.5 * c[i]);
            norms.push(f64::from(c[width - 1]));
        }
        let rows = scratch.tile.slice(s![..of.len(), ..]);
        general_mat_mul(1.0, &rows, &self.scanned.t(), 0.0, &mut distances_to);
        for (mut row, squares) in distances_to.rows_mut().into_iter().zip(norms) {
            // 1e-6: the f32 rounding of |c'|² itself, and of the root below.
            let lower = (squares * (1.0 - 1e-6) - self.margin(squares.sqrt())) as f32;
            row.mapv_inplace(|score| (score + lower).max(0.0).sqrt() * (1.0 - 1e-6));
        }
        distances_to
    }
}

/// Writes x - m into the first entries of `row`; gives |x - m|.
fn shift(pose: &[f32], middle: &[f32], row: &mut [f32]) -> f64 {
    let row = &mut row[..pose.len()];
    for ((to, x), m) in row.iter_mut().zip(pose).zip(middle) {
        *to = x - m;
    }
    // In lanes: one running sum would wait for itself at every coordinate.
    let mut lanes = [0.0f64; LANES];
    for chunk in row.chunks(LANES) {
        for (lane, &x) in lanes.iter_mut().zip(chunk) {
            *lane += f64::from(x) * f64::from(x);
        }
    }
    lanes.iter().sum::<f64>().sqrt()
}

/// The two least values of a row and where the first of them stands.
fn two_smallest(row: &[f32]) -> (f32, f32, usize) {
    // `if a < b` and not `f32::min`: without the care for NaN it is one instruction for four lanes.
    let least = |a: f32, b: f32| if a < b { a } else { b };
    let most = |a: f32, b: f32| if a < b { b } else { a };
    let mut firsts = [f32::INFINITY; LANES];
    let mut seconds = [f32::INFINITY; LANES];
    let chunks = row.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for i in 0..LANES {
            seconds[i] = least(seconds[i], most(firsts[i], chunk[i]));
            firsts[i] = least(firsts[i], chunk[i]);
        }
    }
    let (mut first, mut second) = (f32::INFINITY, f32::INFINITY);
    for &x in firsts.iter().chain(&seconds).chain(rest) {
        second = least(second, most(first, x));
        first = least(first, x);
    }
    (
        first,
        second,
        row.iter().position(|&x| x == first).unwrap_or(0),
    )
}

/// The nearest centroid of each pose and its squared distance.
///
/// `poses` (n, d) and `centroids` (k, d), both in the same unit; gives labels (n) below k and
/// squared distances (n). On a tie the lowest label. Cost: n k d products, in f32 blocks with the
/// doubtful ones computed again in f64, so that the answer is that of f64 throughout.
///
/// ```
/// use ndarray::array;
/// use posing_models::cluster::assign;
///
/// let (poses, centroids) = (array![[1.0_f32, 0.0], [8.0, 0.0]], array![[0.0, 0.0], [9.0, 2.0]]);
/// let (labels, squared_distances) = assign(poses.view(), centroids.view())?;
/// assert_eq!(labels, [0, 1]);
/// assert_eq!(squared_distances, [1.0, 5.0]);
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// Usage: no centroids, widths that differ, a centroid that is not finite. Data: a pose that is not
/// finite, its place naming the file `poses` and, as line, the row counted from 1.
pub fn assign(
    poses: ArrayView2<'_, f32>,
    centroids: ArrayView2<'_, f64>,
) -> Result<(Vec<u32>, Vec<f64>)> {
    let ((k, width), d) = (centroids.dim(), poses.ncols());
    if width != d {
        return Err(Error::usage(format!(
            "poses of {d} columns, centroids of {width}"
        )));
    }
    KMeans {
        k,
        ..KMeans::default()
    }
    .check()?;
    if let Some(j) = centroids
        .rows()
        .into_iter()
        .position(|c| c.iter().any(|x| x.is_nan() || x.abs() > f64::from(LARGEST)))
    {
        return Err(Error::usage(format!(
            "centroid {j} holds a value that is not a finite number"
        )));
    }
    let table = poses.as_standard_layout();
    let poses = Dataset::check(&table)?;
    let middle: Vec<f32> = poses.moments().0.into_iter().map(|m| m as f32).collect();
    let exact = centroids.as_standard_layout().into_owned();
    let centroids = Centroids::new(exact, &middle);
    let found = parallel::map_chunks(poses.n, 8 * TILE, |rows| {
        let mut scratch = Scratch::new(d);
        let mut found = Vec::with_capacity(rows.len());
        let ids: Vec<u32> = rows.map(|i| i as u32).collect();
        for ids in ids.chunks(TILE) {
            centroids.nearest(poses, ids, None, &mut scratch, &mut found);
        }
        found
    });
    Ok(found
        .iter()
        .flatten()
        .map(|near| (near.label, near.squared))
        .unzip())
}

#[cfg(test)]
mod tests {
    use super::super::testdata::{blobs, grid, noise, on_threads, repeated};
    use super::*;

    #[test]
    fn assignment_is_that_of_f64() {
        let pairs = [
            (noise(300, 69, 1), noise(700, 69, 2)),
            (blobs(400, 8, 9, 1) + 1e5f32, blobs(50, 8, 9, 1) + 1e5f32),
            (grid(20), grid(20) + 0.5f32),
            (grid(10), repeated(&grid(10), 7)),
            (noise(9, 2, 1), noise(1, 2, 2)),
            (noise(0, 2, 1), noise(3, 2, 2)),
        ];
        for (poses, centroids) in pairs {
            let centroids = centroids.mapv(f64::from);
            let (labels, squares) = assign(poses.view(), centroids.view()).unwrap();
            assert_eq!(labels.len(), poses.nrows());
            for ((pose, label), squared) in poses.rows().into_iter().zip(&labels).zip(&squares) {
                let all = centroids.rows().into_iter().enumerate();
                let all = all.map(|(j, c)| (j as u32, c.to_slice().unwrap()));
                let near = exact_nearest(pose.as_slice().unwrap(), all);
                assert_eq!((near.label, near.squared), (*label, *squared));
            }
            for threads in [1, 2, 7] {
                let again = on_threads(threads, || assign(poses.view(), centroids.view()).unwrap());
                assert_eq!(again, (labels.clone(), squares.clone()));
            }
        }
    }

    #[test]
    fn bounds_are_bounds() {
        for (table, seed) in [(noise(400, 69, 1), 2), (blobs(400, 6, 5, 3) + 300f32, 4)] {
            let poses = Dataset::trusted(table.as_slice().unwrap(), table.ncols());
            let exact = table.select(ndarray::Axis(0), &(0..200).collect::<Vec<_>>());
            let exact = exact.mapv(f64::from) + seed as f64 * 0.01;
            let middle: Vec<f32> = poses.moments().0.iter().map(|&m| m as f32).collect();
            let centroids = Centroids::new(exact, &middle);
            let (mut scratch, mut found) = (Scratch::new(poses.d), Vec::new());
            let ids: Vec<u32> = (0..100).collect();
            let some: Vec<u32> = (0..200).step_by(3).collect();
            centroids.nearest(poses, &ids, Some(&some), &mut scratch, &mut found);
            for (&i, near) in ids.iter().zip(&found) {
                let rows = some.iter().map(|&j| (j, centroids.row(j as usize)));
                let direct = exact_nearest(poses.row(i as usize), rows);
                assert_eq!((near.label, near.squared), (direct.label, direct.squared));
                assert!(near.second <= direct.second);
                assert!(
                    near.second >= direct.second * 0.9 - 1.0,
                    "the bound is tight"
                );
            }
            let distances_to = centroids.centroid_distances(&[0, 7, 199], &mut scratch);
            for (row, j) in distances_to.rows().into_iter().zip([0, 7, 199]) {
                for (l, &bound) in row.iter().enumerate() {
                    let gaps = centroids.row(j).iter().zip(centroids.row(l));
                    let direct = gaps.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                    assert!(f64::from(bound) <= direct);
                    assert!(f64::from(bound) >= direct * 0.95 - 1.0);
                }
            }
        }
    }

    #[test]
    fn two_smallest_of_rows_of_any_length() {
        for len in 1..40 {
            let table = noise(1, len, len as u64);
            let row = table.as_slice().unwrap();
            let mut sorted = row.to_vec();
            sorted.sort_by(f32::total_cmp);
            let (first, second, at) = two_smallest(row);
            assert_eq!((first, row[at]), (sorted[0], sorted[0]));
            assert_eq!(second, *sorted.get(1).unwrap_or(&f32::INFINITY));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let code = |poses: &Array2<f32>, centroids: &Array2<f64>| {
            assign(poses.view(), centroids.view())
                .unwrap_err()
                .exit_code()
        };
        assert_eq!(code(&Array2::ones((2, 3)), &Array2::ones((2, 4))), 2);
        assert_eq!(code(&Array2::ones((2, 3)), &Array2::ones((0, 3))), 2);
        assert_eq!(code(&Array2::ones((2, 0)), &Array2::ones((1, 0))), 2);
        assert_eq!(
            code(&Array2::ones((2, 3)), &Array2::from_elem((1, 3), f64::NAN)),
            2
        );
        assert_eq!(
            code(&Array2::from_elem((2, 3), f32::NAN), &Array2::ones((1, 3))),
            1
        );
    }
}
