//! How fast distances of poses are learned, computed and searched, in this process: `make bench`.
//! Median of three runs.

use ndarray::{Array2, Axis, s};
use posing::io::npy;
use posing::metric::baselines::Baseline;
use posing::metric::pose_metric::Norm;
use posing::metric::sparse_graph::SparseGraph;
use posing::metric::{BodyFramePoses, Gpd, JointMap, PoseDatabase};
use posing::numeric::parallel;
use posing::pose::Poses;
use rand::Rng;
use std::path::PathBuf;

mod shared;

const DATABASE: usize = 1_000_000;
const DIMENSIONS: usize = 50;
/// Poses of the sparse graph, and those that are dumped.
const POSES: usize = 5000;
const DUMPED: usize = 500;

fn main() {
    println!("{} threads", rayon::current_num_threads());
    features();
    search();
    graph();
}

fn seconds<R>(mut work: impl FnMut() -> R) -> f64 {
    shared::median(3, || {
        std::hint::black_box(work());
    })
}

/// Poses of the shared takes in the body's frame.
fn bodies() -> Vec<BodyFramePoses> {
    let map = JointMap::cmu();
    let takes = shared::takes();
    (takes.iter())
        .filter_map(|take| {
            let poses = Poses {
                points: take.points.clone(),
                xyz: take.xyz.mapv(f64::from),
                ..Poses::default()
            };
            BodyFramePoses::new(&poses, Some(120.0), &map).ok()
        })
        .collect()
}

fn features() {
    let bodies = bodies();
    let frames: usize = bodies.iter().map(BodyFramePoses::frames).sum();
    if frames == 0 {
        return println!("no takes at ../shared/data/cmu: nothing is described");
    }
    let gpd = Gpd::default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.expect("one thread");
    let all =
        pool.install(|| seconds(|| bodies.iter().map(|b| gpd.describe(b).len()).sum::<usize>()));
    println!(
        "features: {:.0} poses a second, one thread",
        frames as f64 / all
    );
    let wjod = Baseline::Wjod.metric(&JointMap::cmu(), &bodies[..1], &[]);
    let wjod = wjod.expect("a walk");
    let all = pool.install(|| seconds(|| wjod.embed(&bodies[0]).len()));
    let frames = bodies[0].frames() as f64;
    println!("wjod: {:.0} poses a second, one thread", frames / all);
}

fn search() {
    let random = |rows: usize, seed: u64| {
        let parts = parallel::map_chunks(rows, 10_000, |range| {
            let mut rng = parallel::rng(seed, range.start as u64);
            let count = range.len() * DIMENSIONS;
            (0..count)
                .map(|_| rng.random_range(-1.0..1.0))
                .collect::<Vec<f32>>()
        });
        Array2::from_shape_vec((rows, DIMENSIONS), parts.concat()).expect("all rows")
    };
    let queries = random(100, 2);
    let database = PoseDatabase::new(random(DATABASE, 1), Norm::Euclidean);
    let many = seconds(|| database.nearest(queries.view(), 10, |_, _| true));
    let one = seconds(|| database.nearest(queries.slice(s![..1, ..]), 10, |_, _| true));
    println!(
        "10 nearest of {DATABASE} poses: {:.2} ms a query in a batch of 100, {:.1} ms alone",
        1e3 * many / 100.0,
        1e3 * one
    );
}

/// The sparse graph of 5,000 poses, centered and of equal variances. With `--dump FOLDER` the poses
/// and the weights of 500 of them are written as NPY, to be compared with other solvers.
fn graph() {
    let bodies = bodies();
    let gpd = Gpd::default().without_accelerations();
    let described: Vec<_> = bodies
        .iter()
        .map(|b| gpd.describe(b).mapv(f64::from))
        .collect();
    let views: Vec<_> = described.iter().map(|d| d.view()).collect();
    let Ok(all) = ndarray::concatenate(Axis(0), &views) else {
        return;
    };
    let step = (all.nrows() / POSES).max(1);
    let x = all.slice(s![..;step, ..]).slice(s![..POSES, ..]).to_owned();
    let spread = x.std_axis(Axis(0), 0.0);
    let spread = spread.mapv(|s| if s > 1e-9 { s } else { 1.0 });
    let x = (&x - &x.mean_axis(Axis(0)).expect("poses")) / spread;
    let products = x.dot(&x.t());
    for tolerance in [1e-4, 1e-6] {
        let took = seconds(|| SparseGraph::code(products.view(), 0.05, tolerance));
        println!("sparse graph of {POSES} poses to {tolerance:.0e}: {took:.2} s");
    }
    let dump = std::env::args().skip_while(|a| a != "--dump").nth(1);
    if let Some(folder) = dump.map(PathBuf::from) {
        let x = x.slice(s![..DUMPED, ..]);
        let graph = SparseGraph::code(x.dot(&x.t()).view(), 0.05, 1e-6);
        let mut weights = Array2::zeros((DUMPED, DUMPED));
        for (i, row) in graph.weights.iter().enumerate() {
            row.iter().for_each(|(j, w)| weights[[i, *j]] = *w);
        }
        for (name, array) in [("poses.npy", x), ("weights.npy", weights.view())] {
            let mut bytes = npy::header_of("<f8", &[array.nrows(), array.ncols()]);
            array.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            std::fs::write(folder.join(name), bytes).expect("a folder to write to");
        }
    }
}
