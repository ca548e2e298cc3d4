//! One frame after another, each from the one before.

use super::super::bones::Bones;
use super::super::greedy::Greedy;
use super::super::ik::{Hold, Solver};
use super::{Fit, FitSettings};
use crate::pose::Skeleton;
use ndarray::ArrayView2;
use rand_chacha::ChaCha8Rng;

/// What holds the values that the joints leave open to the frame before, cm² a squared radian.
const TO_BEFORE: f64 = 1e-4;
/// What draws them to the rest posture: so little that it takes a hundred frames.
const TO_REST: f64 = 1e-6;
/// A noisy take's share of its mean squared misfit: one centimetre of noise is about 0.4 radians of twist.
const OF_NOISE: f64 = 5.0;
/// A root-mean-square misfit (centimetres a joint) below which nothing is searched for.
const FITS: f64 = 1e-4;

/// What is carried from frame to frame.
pub struct Fitter<'a> {
    pub skeleton: &'a Skeleton,
    pub joints: &'a [usize],
    bones: Bones,
    greedy: Greedy<'a>,
    pub solver: Solver<'a>,
    settings: FitSettings,
    pub random: ChaCha8Rng,
    pub rest: Vec<f64>,
    /// The frame before, then this one.
    pub q: Vec<f64>,
    pub targets: Vec<f64>,
    fixed: Vec<bool>,
    root: Option<usize>,
    /// The usual misfit a joint, squared centimetres.
    usual: f64,
    /// Frames to go before other starts are tried again, and how many it was the last time.
    pause: (usize, usize),
}

/// One frame's answer.
pub struct Answer {
    pub q: Vec<f64>,
    pub energy: f64,
    pub misfit: f64,
    converged: bool,
}

impl<'a> Fitter<'a> {
    /// At rest.
    pub fn new(skeleton: &'a Skeleton, joints: &'a [usize], settings: &FitSettings) -> Fitter<'a> {
        let rest = vec![0.0; skeleton.dof_count()];
        Fitter {
            skeleton,
            joints,
            bones: Bones::of(skeleton, joints),
            greedy: Greedy::new(skeleton, joints),
            solver: Solver::new(skeleton, joints, settings.solve),
            settings: *settings,
            random: crate::numeric::parallel::rng(settings.seed, 0),
            q: rest.clone(),
            targets: vec![f64::NAN; 3 * joints.len()],
            fixed: vec![false; rest.len()],
            rest,
            root: joints.iter().position(|&j| j == 0),
            usual: 0.0,
            pause: (0, 0),
        }
    }

    /// The first frame with as many points as any of the first thousand.
    pub fn best_seen(&self, xyz: ArrayView2<'_, f64>) -> Option<usize> {
        let (mut best, mut most) = (None, 0);
        for (i, row) in xyz.rows().into_iter().enumerate() {
            let seen = row.iter().filter(|v| v.is_finite()).count();
            // The root's own point counts for more than all others.
            let root = self.root.is_some_and(|r| row[3 * r].is_finite());
            let seen = seen + if root { row.len() } else { 0 };
            if seen > most {
                (best, most) = (Some(i), seen);
            }
            if i >= 1000 && best.is_some() {
                break;
            }
        }
        best
    }

    /// Finds the first posture, from many starts.
    pub fn start(&mut self, y: &[f64]) {
        self.bones.normalise(y, &mut self.targets);
        let far = self.settings.restarts.saturating_mul(4);
        let mut q = self.rest.clone();
        self.greedy.pose(&self.targets, &mut q);
        let mut best = self.solve(q, 0.0, 1e-4);
        self.search(&mut best, far, 0.0, 1e-4, FITS);
        if self.settings.solve.limits {
            self.solver.clamp(&mut best.q);
        } else {
            self.nearest_turns(&mut best.q, &self.rest.clone());
        }
        self.usual = best.misfit / self.seen().max(1) as f64;
        self.q = best.q;
    }

    /// How many points this frame shows.
    pub fn seen(&self) -> usize {
        let there = |y: &&[f64]| y.iter().all(|v| v.is_finite());
        self.targets.chunks_exact(3).filter(there).count()
    }

    /// Follows the next frame; counts in `out` what there is to say of it.
    pub fn frame(&mut self, y: &[f64], out: &mut Fit) {
        self.bones.normalise(y, &mut self.targets);
        let seen = self.seen();
        out.incomplete += usize::from(y.iter().any(|v| !v.is_finite()));
        let root_seen = self.root.is_none_or(|r| self.targets[3 * r].is_finite());
        let placed = seen > 2 || (root_seen && seen > 0);
        out.unplaced += usize::from(!placed);
        self.fixed[self.skeleton.dofs_of(0)].fill(!placed);
        let before = self.q.clone();
        let to_before = TO_BEFORE + OF_NOISE * self.usual;
        let limit = FITS.max(2.0 * self.usual.sqrt());
        let fits = |a: &Answer| a.misfit <= limit * limit * seen as f64;
        // Ball joints alone: the closed form depends on this frame only, so it comes first.
        let exact = self.greedy.is_exact() && placed && !self.settings.solve.limits;
        let mut best = if exact {
            let mut q = before.clone();
            self.greedy.pose(&self.targets, &mut q);
            let misfit = self.solver.misfit(&q, &self.targets);
            if misfit <= FITS * FITS * seen as f64 {
                Answer {
                    q,
                    energy: misfit,
                    misfit,
                    converged: true,
                }
            } else {
                let nearer = self.solver.misfit(&before, &self.targets) < misfit;
                let q = if nearer { before.clone() } else { q };
                self.solve(q, to_before, TO_REST)
            }
        } else {
            self.solve(before.clone(), to_before, TO_REST)
        };
        // Near a pole the values must run far for a small turn, and what holds them costs a part of it: let go by steps.
        for _ in 0..3 {
            if fits(&best) {
                break;
            }
            self.q.copy_from_slice(&best.q);
            let next = self.solve(best.q.clone(), to_before, TO_REST);
            let gain = next.misfit < 0.5 * best.misfit;
            if gain {
                best = next;
            }
            self.q.copy_from_slice(&before);
            if !gain {
                break;
            }
        }
        self.pause.0 = self.pause.0.saturating_sub(1);
        if !fits(&best) && self.pause.0 == 0 {
            out.restarted += 1;
            let found = best.misfit;
            let mut q = before.clone();
            if !exact && placed {
                self.greedy.pose(&self.targets, &mut q);
            }
            let other = self.solve(q, to_before, TO_REST);
            if other.energy < best.energy {
                best = other;
            }
            let tries = self.settings.restarts;
            self.search(&mut best, tries, to_before, TO_REST, limit);
            // A skeleton that cannot fit must not cost a search every frame.
            let helped = best.misfit < 0.25 * found;
            let pause = if helped {
                0
            } else {
                (2 * self.pause.1).clamp(2, 64)
            };
            self.pause = (pause, pause);
        }
        if !self.settings.solve.limits {
            self.nearest_turns(&mut best.q, &before);
        }
        out.unconverged += usize::from(!best.converged && !fits(&best));
        if seen > 0 {
            // About the last twenty frames.
            self.usual += 0.05 * (best.misfit / seen as f64 - self.usual);
        }
        self.q = best.q;
    }

    /// From one start, held to the frame before and the rest posture.
    pub fn solve(&mut self, mut q: Vec<f64>, to_before: f64, to_rest: f64) -> Answer {
        let hold = Hold {
            before: &self.q,
            to_before,
            rest: &self.rest,
            to_rest,
        };
        let done = self.solver.solve(&self.targets, &self.fixed, &hold, &mut q);
        Answer {
            q,
            energy: done.energy,
            misfit: done.misfit,
            converged: done.converged,
        }
    }
}
