//! Seeds: greedy k-means++.
//!
//! Arthur and Vassilvitskii, k-means++: the advantages of careful seeding, 2007. Each next seed is
//! drawn with probability d²(x) / sum d², where d is the distance to the nearest seed so far. The
//! greedy form (their section 5) draws 2 + ln k candidates and keeps the one that lowers the sum
//! most.
//!
//! The poses are kept by nearest seed, in **cells**. A candidate c closer to x than its seed s must
//! have `|c - s| < 2 |x - s|` (Elkan 2003, lemma 1), so a cell whose farthest pose is nearer than
//! half the way is passed over whole, and of the others only such poses are measured. The cost
//! falls from n k ln k distances to a small part of it as the cells shrink.

use super::dataset::Dataset;
use super::update::key;
use crate::numeric::parallel;
use ndarray::linalg::general_mat_mul;
use ndarray::{ArrayView2, ArrayViewMut2};
use rand::Rng;
use std::collections::HashSet;

/// Poses of a cell measured as one piece of work, and pieces a thread takes at once.
const PIECE: usize = 512;
const PIECES: usize = 4;
const LANES: usize = 8;

/// The poses nearest to one seed s. Their coordinates are copied: fetched from all over the table
/// for every candidate, they took three quarters of the time.
struct Cell {
    members: Vec<u32>,
    /// x - s of each member, (members, d).
    rows: Vec<f32>,
    /// |x - s|² of each member.
    squares: Vec<f32>,
    /// Their sum.
    potential: f64,
    /// The largest of them.
    widest: f32,
}

impl Cell {
    fn new(poses: Dataset<'_>, seed: u32, members: Vec<u32>) -> Self {
        let seed = poses.row(seed as usize);
        let zero = vec![0.0; poses.d];
        let parts = parallel::map_chunks(members.len(), 4096, |chunk| {
            let mut rows = vec![0.0; chunk.len() * poses.d];
            for (&i, row) in members[chunk].iter().zip(rows.chunks_exact_mut(poses.d)) {
                subtract(poses.row(i as usize), seed, row);
            }
            let squares: Vec<f32> = rows
                .chunks_exact(poses.d)
                .map(|row| squared_distance(row, &zero))
                .collect();
            (rows, squares)
        });
        let (mut rows, mut squares) = (Vec::with_capacity(members.len() * poses.d), Vec::new());
        for part in parts {
            rows.extend(part.0);
            squares.extend(part.1);
        }
        let mut cell = Cell {
            members,
            rows,
            squares,
            potential: 0.0,
            widest: 0.0,
        };
        cell.sum_up();
        cell
    }

    /// Drops the members at `gone`, ascending; others take their indices.
    fn drop(&mut self, gone: &[(usize, usize)], d: usize) {
        for &(_, at) in gone.iter().rev() {
            let last = self.members.len() - 1;
            self.members.swap_remove(at);
            self.squares.swap_remove(at);
            self.rows.copy_within(last * d.., at * d);
            self.rows.truncate(last * d);
        }
        if self.rows.len() < self.rows.capacity() / 2 {
            self.rows.shrink_to_fit();
        }
        self.sum_up();
    }

    /// x - s of the member at `at`.
    fn row(&self, at: usize, d: usize) -> &[f32] {
        &self.rows[at * d..(at + 1) * d]
    }

    fn sum_up(&mut self) {
        self.potential = self
            .squares
            .iter()
            .map(|&s| f64::from(s))
            .sum::<f64>()
            .max(0.0);
        self.widest = self
            .squares
            .iter()
            .fold(0.0, |w, &s| if s > w { s } else { w });
    }
}

/// |x - y|², in f32: a draw needs no more.
fn squared_distance(x: &[f32], y: &[f32]) -> f32 {
    let mut lanes = [0.0f32; LANES];
    let (x, y) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    for (lane, (x, y)) in lanes
        .iter_mut()
        .zip(x.remainder().iter().zip(y.remainder()))
    {
        *lane = (x - y) * (x - y);
    }
    for (x, y) in x.zip(y) {
        for i in 0..LANES {
            lanes[i] += (x[i] - y[i]) * (x[i] - y[i]);
        }
    }
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

/// x - y.
fn subtract(x: &[f32], y: &[f32], to: &mut [f32]) {
    to.iter_mut()
        .zip(x)
        .zip(y)
        .for_each(|((to, x), y)| *to = x - y);
}

/// Indices of `k` different poses, and for each pose (n) which of them is about the nearest.
///
/// Fewer than `k`, namely all different poses once, when there are not so many. `observer` hears
/// how many there are so far.
pub(super) fn kmeans_plus_plus(
    poses: Dataset<'_>,
    k: usize,
    generator: &mut impl Rng,
    observer: &mut dyn FnMut(usize),
) -> (Vec<u32>, Vec<u32>) {
    let first = generator.random_range(0..poses.n) as u32;
    let mut seeds = vec![first];
    let mut cells = vec![Cell::new(poses, first, (0..poses.n as u32).collect())];
    let trials = 2 + (k as f64).ln() as usize;
    while seeds.len() < k {
        let total: f64 = cells.iter().map(|cell| cell.potential).sum();
        if total <= 0.0 {
            // Every pose is on a seed, or too near for its square to show in f32.
            add_unseen(poses, k, &mut seeds);
            break;
        }
        let candidates: Vec<u32> = (0..trials)
            .map(|_| draw(&cells, generator.random::<f64>() * total))
            .collect();
        let distances_to = parallel::map_chunks(seeds.len() * trials, 2048, |pairs| {
            pairs
                .map(|p| {
                    let (seed, candidate) = (seeds[p / trials], candidates[p % trials]);
                    squared_distance(poses.row(seed as usize), poses.row(candidate as usize))
                })
                .collect::<Vec<f32>>()
        })
        .concat();
        let gains = gains(poses, &cells, &seeds, &candidates, &distances_to);
        let best = (1..trials).fold(0, |best, t| if gains[t] > gains[best] { t } else { best });
        let distances_to: Vec<f32> = distances_to.chunks(trials).map(|a| a[best]).collect();
        let members = claim(poses, &mut cells, &seeds, candidates[best], &distances_to);
        cells.push(Cell::new(poses, candidates[best], members));
        seeds.push(candidates[best]);
        observer(seeds.len());
    }
    let mut labels = vec![0; poses.n];
    for (j, cell) in cells.iter().enumerate() {
        cell.members
            .iter()
            .for_each(|&i| labels[i as usize] = j as u32);
    }
    (seeds, labels)
}

/// The pose at `depth` in the sum of all squared distances; never one that is on its seed.
fn draw(cells: &[Cell], mut depth: f64) -> u32 {
    let mut last = 0;
    for cell in cells.iter().filter(|cell| cell.potential > 0.0) {
        let inside = depth < cell.potential;
        for (&i, &s) in cell.members.iter().zip(&cell.squares).filter(|_| inside) {
            if s > 0.0 {
                last = i;
                if depth < f64::from(s) {
                    return i;
                }
            }
            depth -= f64::from(s);
        }
        if inside {
            return last;
        }
        depth -= cell.potential;
    }
    // Rounding took the depth past the end: the last pose that can be drawn.
    let mut all = cells
        .iter()
        .rev()
        .flat_map(|c| c.members.iter().zip(&c.squares).rev());
    all.find(|(_, s)| **s > 0.0).map_or(last, |(&i, _)| i)
}

/// How much each candidate would lower the sum. `distances_to`: (seeds, candidates).
fn gains(
    poses: Dataset<'_>,
    cells: &[Cell],
    seeds: &[u32],
    candidates: &[u32],
    distances_to: &[f32],
) -> Vec<f64> {
    let trials = candidates.len();
    let distances_to = |j: usize| &distances_to[j * trials..(j + 1) * trials];
    let pieces = pieces(cells, |j| {
        distances_to(j).iter().any(|&a| a < 4.0 * cells[j].widest)
    });
    let parts = parallel::map_chunks(pieces.len(), PIECES, |chunk| {
        let mut gains = vec![0.0; trials];
        let mut tile = vec![0.0; PIECE * poses.d];
        let mut drawn = vec![0.0; trials * poses.d];
        let mut products = vec![0.0; PIECE * trials];
        for &(j, start, end) in &pieces[chunk] {
            let (cell, seed) = (&cells[j], poses.row(seeds[j] as usize));
            let near: Vec<(usize, f32)> = distances_to(j)
                .iter()
                .copied()
                .enumerate()
                .filter(|r| r.1 < 4.0 * cell.widest)
                .collect();
            for ((t, _), row) in near.iter().zip(drawn.chunks_exact_mut(poses.d)) {
                subtract(poses.row(candidates[*t] as usize), seed, row);
            }
            let closest = near.iter().fold(f32::INFINITY, |least, r| least.min(r.1));
            let reached = |at: &usize| closest < 4.0 * cell.squares[*at];
            let mut count = (start..end).filter(reached).count();
            // The others gain nothing anyway; they are left out where that saves more than the copy
            // costs.
            let rows = if 2 * count > end - start {
                count = end - start;
                &cell.rows[start * poses.d..]
            } else {
                let rows = tile
                    .chunks_exact_mut(poses.d)
                    .zip((start..end).filter(reached));
                rows.for_each(|(row, at)| row.copy_from_slice(cell.row(at, poses.d)));
                &tile
            };
            // |x - s|² - |x - c|² = 2 (x - s)·(c - s) - |c - s|²
            let products = &mut products[..count * near.len()];
            double_products(rows, &drawn, poses.d, products, near.len());
            for row in products.chunks_exact(near.len()) {
                for (product, (t, distances_to)) in row.iter().zip(&near) {
                    let gain = product - distances_to;
                    gains[*t] += if gain > 0.0 { f64::from(gain) } else { 0.0 };
                }
            }
        }
        gains
    });
    let mut gains = vec![0.0; trials];
    for part in parts {
        gains.iter_mut().zip(part).for_each(|(g, p)| *g += p);
    }
    gains
}

/// Writes 2 x·y into `products` (xs, ys) for its rows of `xs` (.., d) and its `count` rows of `ys`
/// (.., d).
fn double_products(xs: &[f32], ys: &[f32], d: usize, products: &mut [f32], count: usize) {
    let rows = products.len() / count.max(1);
    let xs = ArrayView2::from_shape((rows, d), &xs[..rows * d]).expect("rows of d");
    let ys = ArrayView2::from_shape((count, d), &ys[..count * d]).expect("rows of d");
    let mut to = ArrayViewMut2::from_shape((rows, count), products).expect("a product's shape");
    general_mat_mul(2.0, &xs, &ys.t(), 0.0, &mut to);
}

/// Takes from the cells the poses nearer to the new seed. `distances_to`: (seeds), its squared
/// distances.
fn claim(
    poses: Dataset<'_>,
    cells: &mut [Cell],
    seeds: &[u32],
    new: u32,
    distances_to: &[f32],
) -> Vec<u32> {
    let pieces = pieces(cells, |j| distances_to[j] < 4.0 * cells[j].widest);
    let before = &*cells;
    let nearer = parallel::map_chunks(pieces.len(), PIECES, |chunk| {
        let mut nearer = Vec::new();
        let mut shift = vec![0.0; poses.d];
        for &(j, start, end) in &pieces[chunk] {
            let cell = &before[j];
            subtract(
                poses.row(new as usize),
                poses.row(seeds[j] as usize),
                &mut shift,
            );
            let is_nearer = |at: &usize| {
                distances_to[j] < 4.0 * cell.squares[*at]
                    && squared_distance(cell.row(*at, poses.d), &shift) < cell.squares[*at]
            };
            nearer.extend((start..end).filter(is_nearer).map(|at| (j, at)));
        }
        nearer
    });
    let nearer = nearer.concat();
    let members = nearer.iter().map(|&(j, at)| cells[j].members[at]).collect();
    for gone in nearer.chunk_by(|a, b| a.0 == b.0) {
        cells[gone[0].0].drop(gone, poses.d);
    }
    members
}

/// The cells that `wanted` picks, cut into pieces: cell, first and past-the-last member.
fn pieces(cells: &[Cell], wanted: impl Fn(usize) -> bool) -> Vec<(usize, usize, usize)> {
    (0..cells.len())
        .filter(|&j| wanted(j))
        .flat_map(|j| {
            let len = cells[j].members.len();
            (0..len)
                .step_by(PIECE)
                .map(move |s| (j, s, (s + PIECE).min(len)))
        })
        .collect()
}

/// Fills up the seeds with poses different from all of them, in the order of the table.
fn add_unseen(poses: Dataset<'_>, k: usize, seeds: &mut Vec<u32>) {
    let mut seen: HashSet<Vec<u32>> = seeds.iter().map(|&i| key(poses.row(i as usize))).collect();
    for i in 0..poses.n {
        if seeds.len() == k {
            break;
        }
        if seen.insert(key(poses.row(i))) {
            seeds.push(i as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testdata::{blobs, grid, noise, on_threads, repeated};
    use super::*;
    use ndarray::Array2;

    fn seeds(table: &Array2<f32>, k: usize, seed: u64) -> (Vec<u32>, Vec<u32>) {
        let poses = Dataset::trusted(table.as_slice().expect("rows"), table.ncols());
        kmeans_plus_plus(poses, k, &mut parallel::rng(seed, 0), &mut |_| ())
    }

    #[test]
    fn seeds_are_different_poses() {
        let doubled = repeated(&noise(40, 5, 1), 4);
        for (table, k, expected) in [
            (noise(500, 69, 1), 100, 100),
            (doubled.clone(), 40, 40),
            (doubled, 60, 40),
            (grid(9), 81, 81),
            (noise(30, 3, 2) * 1e-25, 30, 30),
            (Array2::ones((7, 2)), 3, 1),
        ] {
            let (seeds, labels) = seeds(&table, k, 3);
            let keys: HashSet<Vec<u32>> = seeds
                .iter()
                .map(|&i| key(table.row(i as usize).as_slice().unwrap()))
                .collect();
            assert_eq!((seeds.len(), keys.len()), (expected, expected));
            assert_eq!(labels.len(), table.nrows());
            assert!(labels.iter().all(|&l| (l as usize) < seeds.len()));
        }
    }

    #[test]
    fn passing_cells_over_loses_no_nearer_seed() {
        for table in [noise(3000, 69, 4), blobs(3000, 4, 50, 5)] {
            let (seeds, labels) = seeds(&table, 120, 1);
            let row = |i: u32| table.row(i as usize).to_slice().unwrap();
            for (i, &label) in labels.iter().enumerate() {
                let pose = row(i as u32);
                let least = seeds
                    .iter()
                    .map(|&s| squared_distance(pose, row(s)))
                    .fold(f32::MAX, f32::min);
                let own = squared_distance(pose, row(seeds[label as usize]));
                assert!(own <= least * (1.0 + 1e-4) + 1e-4, "{own} {least}");
            }
        }
    }

    #[test]
    fn one_seed_a_heap() {
        let (seeds, _) = seeds(&blobs(2000, 10, 25, 6), 25, 2);
        let heaps: HashSet<u32> = seeds.iter().map(|i| i % 25).collect();
        assert_eq!(heaps.len(), 25);
    }

    #[test]
    fn the_same_at_any_number_of_threads() {
        let table = noise(9000, 6, 7);
        let first = seeds(&table, 60, 1);
        for threads in [1, 2, 7] {
            assert_eq!(on_threads(threads, || seeds(&table, 60, 1)), first);
        }
        assert_ne!(seeds(&table, 60, 2), first);
    }
}
