//! Frames at which one clip can go over into another: where their distances are locally least.
//!
//! Of the matrix of distances between the frames of two clips only a band of rows is held at a
//! time. Where the clips are alike over a while the matrix has a valley with many minima: of those
//! closer together than `apart` in both clips the nearest is kept. Cost: frames of a x frames of b
//! x dimensions; all minima are held, up to a ninth of the cells.

use super::pose_metric::Norm;
use crate::numeric::parallel;
use ndarray::{ArrayView1, ArrayView2};
use std::ops::Range;

/// Rows of a band.
const BAND: usize = 64;

/// What is searched for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransitionSearch {
    /// Candidates, at most.
    pub most: usize,
    /// Frames that two candidates are apart, in one of the clips at least.
    pub apart: usize,
    /// Frames that the two ends are apart, for a clip into itself; 0 for two clips.
    pub least_jump: usize,
}

/// Frames at which one clip can go over into another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The frame of each clip.
    pub frames: [usize; 2],
    /// The distance of the poses there.
    pub distance: f32,
}

/// The candidates between two clips, nearest first, from the vectors (frames, dimensions) of their
/// frames by a metric. Frames whose vectors have NaN are never candidates. `wanted` is asked in
/// this order about those that may be kept; what it turns down does not keep others away.
///
/// ```
/// use ndarray::array;
/// use posing_likeness::pose_metric::Norm;
/// use posing_likeness::transition::{TransitionSearch, candidates};
///
/// let (walk, run) = (array![[0.0], [1.0], [2.0]], array![[5.0], [2.1]]);
/// let search = TransitionSearch { most: 1, apart: 1, least_jump: 0 };
/// let clips = [walk.view(), run.view()];
/// let found = candidates(clips, Norm::Euclidean, &search, |_| true);
/// assert_eq!(found[0].frames, [2, 1]); // the poses 2 and 2.1
/// ```
pub fn candidates(
    vectors: [ArrayView2<'_, f32>; 2],
    norm: Norm,
    search: &TransitionSearch,
    wanted: impl FnMut(&Candidate) -> bool,
) -> Vec<Candidate> {
    let [a, b] = vectors;
    let columns: Vec<Vec<f32>> = b.columns().into_iter().map(|c| c.to_vec()).collect();
    let bands = parallel::map_chunks(a.nrows(), BAND, |rows| {
        // A row more at each end, to compare with.
        let held = rows.start.saturating_sub(1)..(rows.end + 1).min(a.nrows());
        let band = held
            .clone()
            .map(|i| distances(a.row(i), &columns, b.nrows(), norm));
        let band: Vec<Vec<f32>> = band.collect();
        minima(&band, held.start, rows)
    });
    let mut found: Vec<Candidate> = (bands.concat().into_iter())
        .filter(|[i, j]| i.abs_diff(*j) >= search.least_jump)
        .map(|[i, j]| Candidate {
            frames: [i, j],
            distance: norm.distance(a.row(i), b.row(j)),
        })
        .collect();
    found.sort_by(|x, y| (x.distance.total_cmp(&y.distance)).then(x.frames.cmp(&y.frames)));
    spread(found, search, wanted)
}

/// Distances of a frame to all frames of the other clip, squared for the Euclidean norm; `columns`
/// are its vectors by dimension.
fn distances(
    row: ArrayView1<'_, f32>,
    columns: &[Vec<f32>],
    frames: usize,
    norm: Norm,
) -> Vec<f32> {
    let mut sums = vec![0.0; frames];
    for (x, column) in row.iter().zip(columns) {
        for (sum, y) in sums.iter_mut().zip(column) {
            let d = x - y;
            *sum += match norm {
                Norm::Euclidean => d * d,
                Norm::City => d.abs(),
            };
        }
    }
    sums
}

/// The cells in `rows` that no neighbor is below; `band` are distances from row `start` on.
fn minima(band: &[Vec<f32>], start: usize, rows: Range<usize>) -> Vec<[usize; 2]> {
    let mut found = Vec::new();
    for i in rows {
        for j in 0..band[i - start].len() {
            let own = band[i - start][j];
            let is_least = NEIGHBORS.iter().all(|(down, right, may_equal)| {
                let row = (i - start).checked_add_signed(*down);
                let column = j.checked_add_signed(*right);
                let cell = row.zip(column).and_then(|(r, c)| band.get(r)?.get(c));
                cell.is_none_or(|cell| !(*cell < own || !may_equal && *cell == own))
            });
            if is_least && own.is_finite() {
                found.push([i, j]);
            }
        }
    }
    found
}

/// The cells about one, and whether they may be equal to it. Where a clip stands still whole blocks
/// are equal: their first cell is the minimum. Along the diagonal, where a clip meets its copy,
/// each may be.
const NEIGHBORS: [(isize, isize, bool); 8] = [
    (-1, -1, true),
    (-1, 0, false),
    (-1, 1, false),
    (0, -1, false),
    (0, 1, true),
    (1, -1, true),
    (1, 0, true),
    (1, 1, true),
];

/// The first candidates that are wanted and apart from all before them.
fn spread(
    sorted: Vec<Candidate>,
    search: &TransitionSearch,
    mut wanted: impl FnMut(&Candidate) -> bool,
) -> Vec<Candidate> {
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in sorted {
        if kept.len() == search.most {
            break;
        }
        let is_near = |other: &Candidate| {
            (0..2).all(|k| candidate.frames[k].abs_diff(other.frames[k]) < search.apart)
        };
        if !kept.iter().any(is_near) && wanted(&candidate) {
            kept.push(candidate);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};
    use rand::Rng;

    const SEARCH: TransitionSearch = TransitionSearch {
        most: 1000,
        apart: 1,
        least_jump: 0,
    };

    fn vectors(frames: usize, seed: u64) -> Array2<f32> {
        let mut rng = parallel::rng(seed, 0);
        Array2::from_shape_fn((frames, 3), |_| rng.random_range(-1.0..1.0))
    }

    #[test]
    fn candidates_are_the_minima_of_the_whole_matrix_across_bands() {
        let (mut a, b) = (vectors(2 * BAND + 9, 1), vectors(40, 2));
        a.row_mut(70).fill(f32::NAN);
        for norm in [Norm::Euclidean, Norm::City] {
            let far = |i: usize, j: usize| norm.distance(a.row(i), b.row(j));
            let near = |i: usize, last: usize| i.saturating_sub(1)..=(i + 1).min(last);
            let mut least: Vec<[usize; 2]> = Vec::new();
            for i in 0..a.nrows() {
                for j in 0..b.nrows() {
                    let mut about = near(i, a.nrows() - 1)
                        .flat_map(|r| near(j, b.nrows() - 1).map(move |c| far(r, c)));
                    if far(i, j).is_finite() && about.all(|d| !(d < far(i, j))) {
                        least.push([i, j]);
                    }
                }
            }
            let mut found = candidates([a.view(), b.view()], norm, &SEARCH, |_| true);
            assert!(found.is_sorted_by(|x, y| x.distance <= y.distance));
            found.sort_by_key(|c| c.frames);
            let found: Vec<[usize; 2]> = found.iter().map(|c| c.frames).collect();
            assert_eq!(found, least);
        }
    }

    #[test]
    fn candidates_are_apart_in_one_clip_at_least() {
        let (a, b) = (vectors(80, 3), vectors(80, 4));
        let search = TransitionSearch {
            most: 20,
            apart: 10,
            least_jump: 15,
        };
        let found = candidates([a.view(), b.view()], Norm::Euclidean, &search, |_| true);
        assert_eq!(found.len(), 20);
        for (k, x) in found.iter().enumerate() {
            assert!(x.frames[0].abs_diff(x.frames[1]) >= 15);
            for y in &found[..k] {
                assert!((0..2).any(|c| x.frames[c].abs_diff(y.frames[c]) >= 10));
            }
        }
    }

    #[test]
    fn what_is_not_wanted_keeps_no_other_away() {
        let (a, b) = (vectors(60, 5), vectors(60, 6));
        let search = TransitionSearch {
            apart: 60,
            ..SEARCH
        };
        let found = |wanted: fn(&Candidate) -> bool| {
            candidates([a.view(), b.view()], Norm::Euclidean, &search, wanted)
        };
        let first = found(|_| true);
        assert_eq!(first.len(), 1);
        let late = found(|c| c.frames[0] > 40);
        assert!(late.len() == 1 && late[0].frames[0] > 40);
        assert!(late[0].distance >= first[0].distance);
        assert!(found(|_| false).is_empty());
    }

    #[test]
    fn still_clips_have_one_candidate_and_copies_one_every_apart() {
        let still = array![[0.5], [0.5], [0.5]];
        let found = candidates([still.view(), still.view()], Norm::City, &SEARCH, |_| true);
        assert_eq!((found.len(), found[0].frames), (1, [0, 0]));
        let a = Array2::from_shape_fn((50, 1), |(t, _)| t as f32);
        let search = TransitionSearch {
            apart: 10,
            ..SEARCH
        };
        let found = candidates([a.view(), a.view()], Norm::Euclidean, &search, |_| true);
        let frames: Vec<[usize; 2]> = found.iter().map(|c| c.frames).collect();
        assert_eq!(frames, [0, 10, 20, 30, 40].map(|t| [t, t]));
        let none = Array2::zeros((0, 1));
        assert!(candidates([none.view(), a.view()], Norm::City, &search, |_| true).is_empty());
    }
}
