//! How long one pose takes, as while a joint is dragged: `make bench`.
//!
//! Whole poses from root, feet, hands and head of frames of takes that no atom is from, turned and
//! carried away: P1 and what the model says of the other joints, in this process, over 262,759
//! atoms; medians and 99th percentiles.

mod shared;

use glam::{DMat3, DVec3};
use ndarray::Axis;
use posing::io::Model;
use posing::pose::Observation;
use posing::pose::{Anchor, Similarity};
use posing::prior::{OpenOptions, Prior, SparseCodingPrior, Want};
use posing::restore::placement::{PlacementSolution, PlacementSolver};
use shared::Take;
use std::time::Instant;

const ATOMS: usize = 262_759;
const SHOWN: [&str; 6] = ["root", "lfoot", "rfoot", "lhand", "rhand", "head"];
/// One take in so many is kept for the poses.
const HELD_OUT: usize = 10;
/// Frames between two poses: 60 a second.
const STEP: usize = 2;
/// Poses of a take.
const POSES: usize = 100;

fn main() {
    let takes = shared::takes();
    if takes.len() <= 1 {
        return println!("no takes at ../shared/data/cmu: nothing is posed");
    }
    let (posed, learned): (Vec<_>, Vec<_>) = takes
        .iter()
        .enumerate()
        .partition(|(i, _)| i % HELD_OUT == 0);
    let frames: Vec<_> = learned.iter().map(|(_, t)| t.xyz.view()).collect();
    let frames = ndarray::concatenate(Axis(0), &frames).expect("takes of the same points");
    let all: Vec<usize> = (0..frames.nrows()).collect();
    let mut model = Model::new("sparse", &takes[0].points, "body");
    model.insert("atoms", shared::atoms(&frames, &all, ATOMS).into_atoms());
    model.meta.training_rms = Some(1.0);
    let prior = SparseCodingPrior::from_model(&model, &OpenOptions::default(), "the bench")
        .expect("a model");
    drop(model);
    let anchor = Anchor::pelvis(&takes[0].points).expect("a pelvis");
    let dragging = Dragging {
        prior: &prior,
        anchor: &anchor,
    };
    let mut times = Times::default();
    for (_, take) in &posed {
        dragging.drag(take, &mut times);
    }
    println!(
        "one pose from six joints, {ATOMS} atoms, ms{:>18} {:>8} {:>8} {:>8}",
        "poses", "median", "99%", "most"
    );
    for (what, mut ms) in [
        ("the first", times.first),
        ("from nothing", times.nothing),
        ("from the pose before", times.before),
    ] {
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms[((share * ms.len() as f64) as usize).min(ms.len() - 1)];
        println!(
            "{what:<42} {:>17} {:>8.2} {:>8.2} {:>8.2}",
            ms.len(),
            at(0.5),
            at(0.99),
            at(1.0)
        );
    }
    println!(
        "alternations from the pose before: {:.1}",
        times.alternations as f64 / times.solved.max(1) as f64
    );
}

/// Milliseconds a pose.
#[derive(Default)]
struct Times {
    first: Vec<f64>,
    nothing: Vec<f64>,
    before: Vec<f64>,
    alternations: usize,
    solved: usize,
}

struct Dragging<'a> {
    prior: &'a SparseCodingPrior,
    anchor: &'a Anchor,
}

impl Dragging<'_> {
    fn drag(&self, take: &Take, times: &mut Times) {
        let away = Similarity {
            scale: 1.0,
            rotation: DMat3::from_rotation_y(1.0),
            shift: DVec3::new(120.0, 95.0, -40.0),
        };
        let is_shown = |c: usize| SHOWN.contains(&take.points[c / 3].as_str());
        let noise: Vec<f64> = (0..take.xyz.ncols())
            .map(|c| if is_shown(c) { 0.0 } else { f64::INFINITY })
            .collect();
        let mut before: Option<PlacementSolution> = None;
        for (i, frame) in take.xyz.outer_iter().step_by(STEP).take(POSES).enumerate() {
            let frame: Vec<f64> = frame.iter().map(|v| f64::from(*v)).collect();
            let mut y = vec![0.0; frame.len()];
            away.apply_pose(&frame, &mut y);
            let seen = Observation {
                values: &y,
                variance: &noise,
            };
            if i % 10 == 0 {
                let ms = self
                    .pose(seen, |s| s.solve(self.prior, seen, self.anchor, &[]))
                    .1;
                if times.first.is_empty() {
                    times.first.push(ms)
                } else {
                    times.nothing.push(ms)
                }
            }
            let (solution, ms) = self.pose(seen, |s| match &before {
                Some(before) => s.follow(self.prior, seen, self.anchor, before),
                None => s.solve(self.prior, seen, self.anchor, &[]),
            });
            if before.is_some() {
                times.before.push(ms);
                times.alternations += solution.iterations;
                times.solved += 1;
            }
            before = Some(solution);
        }
    }

    /// A pose whole, and the milliseconds that took.
    fn pose(
        &self,
        seen: Observation<'_>,
        solve: impl FnOnce(&PlacementSolver) -> Option<PlacementSolution>,
    ) -> (PlacementSolution, f64) {
        let began = Instant::now();
        let solution =
            solve(&PlacementSolver::default()).expect("six joints determine a placement");
        let mut back = vec![0.0; seen.values.len()];
        solution.placement.undo_pose(seen.values, &mut back);
        let fit = solution.fit.as_ref().expect("a code");
        let observation = Observation {
            values: &back,
            variance: seen.variance,
        };
        let whole = (self.prior)
            .posterior_given(&observation, fit, Want::Variances)
            .mean;
        let ms = began.elapsed().as_secs_f64() * 1e3;
        assert!(whole.iter().all(|v| v.is_finite()));
        (solution, ms)
    }
}
