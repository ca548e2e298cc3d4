//! How fast poses are coded, in this process: `make bench`.
//!
//! Scans are measured against the machine: a matrix product in single precision on the same
//! threads, of matrices that stay in the cache. Searches by bounds are measured against scans.
//! Every figure is the median of three runs.

mod shared;

use ndarray::{Array2, ArrayView2, Axis, s};
use posing::numeric::parallel;
use posing::sparse::{Dictionary, Encoder, Omp, SearchStrategy};
use shared::{atoms, median};
use std::time::Instant;

const RUNS: usize = 3;
const SPARSITY: usize = 3;
/// Fewer poses than are worth leaves: these are scanned.
const SCANNED: usize = 360;
const SOUGHT: usize = 10_000;

fn main() {
    let peak = peak();
    println!(
        "{} threads; matrix product {:.0} Gflop/s, reading memory {:.1} GB/s",
        rayon::current_num_threads(),
        peak / 1e9,
        bandwidth() / 1e9
    );
    let takes = shared::takes();
    if takes.is_empty() {
        return println!("no takes at ../shared/data/cmu: nothing is coded");
    }
    let takes: Vec<_> = takes.iter().map(|t| t.xyz.view()).collect();
    let takes = ndarray::concatenate(Axis(0), &takes).expect("takes of the same points");
    let mut chosen = parallel::rng(0, 0);
    let mut order: Vec<usize> = (0..takes.nrows()).collect();
    rand::seq::SliceRandom::shuffle(&mut order[..], &mut chosen);
    assert!(order.len() > 2 * SOUGHT, "too few frames: {}", order.len());
    let poses = takes.select(Axis(0), &order[..SOUGHT]);
    order.drain(..SOUGHT);
    order.sort_unstable();
    println!(
        "\n{:>8} {:>12} {:>11} {:>12} {:>9}",
        "atoms", "scan us/pose", "of product", "bounds us", "times"
    );
    let mut points = Vec::new();
    for n in [1_000, 5_000, 20_000, 65_536, 262_759] {
        let atoms = atoms(&takes, &order, n);
        let scan = seconds(&atoms, poses.slice(s![..SCANNED, ..]), false) / SCANNED as f64;
        // A product with every atom for each atom of the code, two operations a number.
        let share = (2 * SPARSITY * n * poses.ncols()) as f64 / scan / peak;
        print!("{n:>8} {:>12.1} {share:>11.2}", scan * 1e6);
        if n <= 2048 {
            println!("   (rows of the Gram matrix after the first scan)");
            continue;
        }
        let bounds = seconds(&atoms, poses.view(), true) / SOUGHT as f64;
        println!(" {:>12.1} {:>9.1}", bounds * 1e6, scan / bounds);
        points.push(((n as f64).ln(), scan.ln(), bounds.ln()));
    }
    let slope = |of: fn(&(f64, f64, f64)) -> f64| {
        let mean = |f: &dyn Fn(&(f64, f64, f64)) -> f64| {
            points.iter().map(f).sum::<f64>() / points.len() as f64
        };
        let (x, y) = (mean(&|p| p.0), mean(&|p| of(p)));
        mean(&|p| (p.0 - x) * (of(p) - y)) / mean(&|p| (p.0 - x).powi(2))
    };
    println!(
        "seconds grow as atoms to the power of {:.2} (scan), {:.2} (bounds)",
        slope(|p| p.1),
        slope(|p| p.2)
    );
}

/// The median of coding with a dictionary of which what searches need is made.
fn seconds(atoms: &Dictionary, poses: ArrayView2<'_, f32>, by_bounds: bool) -> f64 {
    let omp = Omp {
        sparsity: SPARSITY,
        ..Omp::default()
    };
    let mut times: Vec<f64> = (0..RUNS)
        .map(|_| {
            // Its own: one that has been coded with often enough is searched by bounds.
            let dictionary = Dictionary::from_rows(atoms.atoms()).expect("atoms of unit norm");
            let encoder = Encoder::new(&dictionary, omp).expect("parameters in range");
            let code = |poses| encoder.encode(poses).expect("finite poses");
            let rows = encoder.strategy(poses.nrows()) == SearchStrategy::Gram;
            let warm = if by_bounds || rows { poses.nrows() } else { 1 };
            code(poses.slice(s![..warm, ..]));
            let asked = encoder.strategy(poses.nrows());
            let is_bounded = asked == SearchStrategy::BallTree;
            assert!(is_bounded == by_bounds || rows, "{asked:?}");
            let began = Instant::now();
            assert_eq!(code(poses).len(), poses.nrows());
            began.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[RUNS / 2]
}

/// Operations a second of matrix products on all threads.
fn peak() -> f64 {
    const SIDE: usize = 384;
    const PRODUCTS: usize = 64;
    let threads = rayon::current_num_threads();
    let one = Array2::<f32>::from_elem((SIDE, SIDE), 1e-3);
    let all = || {
        parallel::map_chunks(threads, 1, |_| {
            let mut sum = Array2::<f32>::zeros((SIDE, SIDE));
            for _ in 0..PRODUCTS {
                ndarray::linalg::general_mat_mul(1.0, &one, &one, 0.5, &mut sum);
            }
            sum[[0, 0]]
        });
    };
    all();
    (2 * SIDE.pow(3) * PRODUCTS * threads) as f64 / median(RUNS, all)
}

/// Bytes a second that all threads read together.
fn bandwidth() -> f64 {
    let numbers = vec![1u64; 1 << 25];
    let all = || {
        let sums = parallel::map_chunks(numbers.len(), 1 << 18, |r| numbers[r].iter().sum::<u64>());
        assert_eq!(sums.iter().sum::<u64>(), numbers.len() as u64);
    };
    (8 * numbers.len()) as f64 / median(RUNS, all)
}
