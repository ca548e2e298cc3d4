//! How fast distances of poses are learnt, computed and searched, in this process: `make bench`. Median of three runs.

use ndarray::{Array2, s};
use posing::metric::baselines::Baseline;
use posing::metric::pose_metric::Norm;
use posing::metric::sparse_graph::SparseGraph;
use posing::metric::{BodyFramePoses, Gpd, JointMap, PoseDatabase};
use posing::numeric::parallel;
use posing::pose::Poses;
use rand::Rng;

mod shared;

const DATABASE: usize = 1_000_000;
const DIMENSIONS: usize = 50;

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

/// The sparse graph of 5,000 poses.
fn graph() {
    let bodies = bodies();
    let gpd = Gpd::default().without_accelerations();
    let mut rows: Vec<_> = Vec::new();
    for body in &bodies {
        let described = gpd.describe(body).mapv(f64::from);
        rows.extend(described.rows().into_iter().map(|r| r.to_owned()));
    }
    let step = rows.len() / 5000;
    if step == 0 {
        return;
    }
    let chosen: Vec<_> = rows.iter().step_by(step).take(5000).collect();
    let x = Array2::from_shape_fn((5000, chosen[0].len()), |(i, j)| chosen[i][j]);
    let mean = x.mean_axis(ndarray::Axis(0)).expect("poses");
    let spread = x
        .std_axis(ndarray::Axis(0), 0.0)
        .mapv(|s| if s > 1e-9 { s } else { 1.0 });
    let x = (x - mean) / spread;
    let products = x.dot(&x.t());
    for tolerance in [1e-4, 1e-6] {
        let took = seconds(|| SparseGraph::code(products.view(), 0.05, tolerance));
        println!("sparse graph of 5,000 poses to {tolerance:.0e}: {took:.2} s");
    }
}
