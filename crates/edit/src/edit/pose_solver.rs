//! One pose from its goals.
//!
//! Everything is a precision. With K joints, each is observed as y ~ N(x, r):
//!
//! | joint | y | r |
//! |---|---|---|
//! | pinned | its pin | 0 |
//! | dragged | its target | sd² |
//! | other | where it was when the gesture began, `a` | rest², on the floor at most 5² |
//!
//! A dragged root carries along those that no pinned or standing joint is below.
//!
//! So `rest` runs from Lai et al.'s free dragging (P is the identity; section 4.4) to its
//! completion (P has the pins alone). The pose is found in three steps: the placement follows that
//! of the pose before ([`PlacementSolver::follow`]); the prior's posterior of all joints; and P2
//! over the skeleton's own degrees of freedom, which keeps bone lengths:
//!
//! ```text
//! min over q   Σ wₖ |fₖ(q) − mₖ|²,
//!     m the target of a dragged joint, p + λ (a − p₀) of the others,
//!                                     w = 1 / sd², .1 / (posterior variance + 3.5²)
//! ```
//!
//! p is the posterior mean, and p₀ what it was with the drag's targets where their joints were. The
//! prior draws a pose toward those it was trained on; with λ = exp(−d / L), d how far the drag has
//! come, that happens little by little, and a touch alone moves nothing. L is 20 cm and the largest
//! |a − p₀|.
//!
//! Where that is far from the pose before, it is approached in steps: no joint goes farther at once
//! than three times as far as the hand. A pose that would flip turns instead, while it is solved
//! for again ([`Pose::is_moving`]).
//!
//! A joint that is dragged outweighs each other five hundred times at the usual sd of .5 cm: it is
//! where the pointer is, whatever the prior says. Pins come last: the values nearest to that
//! solution that hold them exactly.
//!
//! [`PlacementSolver::follow`]: crate::restore::placement::PlacementSolver::follow

use super::rig::Rig;
use crate::ik::initial_pose::InitialPose;
use crate::ik::solver::{IkSettings, IkSolver, Regularization};
use crate::pose::Similarity;
use crate::prior::EXACT_VARIANCE;
use crate::restore::placement::PlacementSolution;
use crate::restore::{FrameEstimate, PoseModel};
use glam::DVec3;

/// `rest` if nothing else is said, cm.
pub(crate) const REST: f64 = 10.0;
/// The range of `rest`, cm.
pub const REST_RANGE: (f64, f64) = (0.5, 1000.0);
/// The range of the standard deviation of a dragged joint, cm.
pub const DRAG_RANGE: (f64, f64) = (0.01, 1000.0);

/// The weight of what the prior says, and what is added to its standard deviation, cm, so that a
/// dragged joint outweighs the others together.
const PRIOR_SHARE: f64 = 0.1;
const PRIOR_SD: f64 = 3.5;
/// The weight of a pin among the other targets, 1/cm², and where it is to be exact.
const PIN_WEIGHT: f64 = 20.0;
const EXACT_WEIGHT: f64 = 1e5;
/// Holds what no target moves to the pose before, cm² a squared radian.
const PREVIOUS_WEIGHT: f64 = 1e-3;
/// A pin that is missed by more is out of reach, cm; a dragged joint, this and its standard
/// deviation.
const MISSED_PIN: f64 = 0.05;
const MISSED_DRAG: f64 = 0.5;
/// A joint lower than this stands on the floor, cm, and stays there to within this standard
/// deviation.
const ON_FLOOR: f64 = 4.0;
const FLOOR_SD: f64 = 5.0;
/// A joint this far below the floor is lifted, cm.
const BELOW_FLOOR: f64 = 0.01;
/// The standard deviation of a joint whose position is given, cm.
const EXACT_SD: f64 = 0.05;
/// How far a joint goes at once, as a multiple of the way of the hand; and where the hand rests,
/// cm.
const STEP_RATIO: f64 = 3.0;
const SETTLING_STEP: f64 = 1.5;
/// The shortest L, cm.
const ONSET: f64 = 20.0;

/// The goals of a pose of K joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraints {
    /// The coordinates at which each joint is pinned (K), cm.
    pub pins: Vec<[Option<f64>; 3]>,
    /// The target of each dragged joint (K) and its standard deviation, cm.
    pub drags: Vec<Option<(DVec3, f64)>>,
    /// The standard deviation of the other joints about where they were, cm.
    pub rest: f64,
    /// Joints that are reset (K): the prior alone places them.
    pub forgotten: Vec<bool>,
    /// The lowest y of each joint (K), cm; `None`: no floor. See [`floor_under`].
    pub floor: Option<Vec<f64>>,
    /// Whether the skeleton's limits are kept.
    pub limits: bool,
}

impl Constraints {
    /// No goals for `joints` joints: all are where they were, to within 10 cm.
    pub fn none(joints: usize) -> Constraints {
        Constraints {
            pins: vec![[None; 3]; joints],
            drags: vec![None; joints],
            rest: REST,
            forgotten: vec![false; joints],
            floor: None,
            limits: false,
        }
    }

    /// The same joints dragged and pinned, at the positions `xyz` (3 K, cm).
    pub(crate) fn at_positions(&self, xyz: &[f64]) -> Constraints {
        let mut there = self.clone();
        for (k, at) in xyz.chunks_exact(3).enumerate() {
            there.drags[k] = self.drags[k].map(|(_, sd)| (DVec3::from_slice(at), sd));
            there.pins[k] = std::array::from_fn(|c| self.pins[k][c].map(|_| at[c]));
        }
        there
    }

    /// How far the drags and pins went since `before`, the farthest of them, cm.
    pub(crate) fn way_from(&self, before: &Constraints) -> f64 {
        let way = |k: usize| {
            let drag = self.drags[k].zip(before.drags[k]);
            let drag = drag.map_or(0.0, |((to, _), (from, _))| (to - from).length());
            let pins = self.pins[k].iter().zip(&before.pins[k]);
            let pins = pins.filter_map(|(to, from)| Some((to.as_ref()? - from.as_ref()?).powi(2)));
            drag.max(pins.sum::<f64>().sqrt())
        };
        (0..self.pins.len()).map(way).fold(0.0, f64::max)
    }
}

/// The floor, y = 0, under the joints `xyz` (3 K, cm): one that is below it already may stay as low
/// as it is.
pub fn floor_under(xyz: &[f64]) -> Vec<f64> {
    xyz.iter().skip(1).step_by(3).map(|y| y.min(0.0)).collect()
}

/// A pose of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// The values of the skeleton's degrees of freedom, radians and cm.
    pub q: Vec<f64>,
    /// The joints (3 K), cm.
    pub xyz: Vec<f64>,
    /// The standard deviation of a coordinate of each joint (K), cm; infinite for joints that the
    /// model does not know.
    pub sd: Vec<f64>,
    /// How far each pinned or dragged joint is from where it has to be (K), cm; 0 where it is
    /// there.
    pub missed: Vec<f64>,
    /// How much less likely the pose is than nearly all training poses, nats; `None` where the
    /// model cannot tell.
    pub unlike: Option<f64>,
    /// The transform from the model's space to the world.
    pub placement: Similarity,
    /// Whether the pose is still on its way to the goals: solved for again, it comes nearer.
    pub is_moving: bool,
}

/// Where a gesture began.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// a: the joints (3 K), cm.
    pub xyz: Vec<f64>,
    /// a − p₀ (3 J, in the model's order), cm; empty: the prior draws the pose at once.
    offset: Vec<f64>,
}

impl Reference {
    /// A pose that the prior draws at once.
    pub fn at(xyz: Vec<f64>) -> Reference {
        let offset = Vec::new();
        Reference { xyz, offset }
    }
}

/// Finds poses of one rig.
pub struct PoseSolver {
    /// The skeleton and its joints.
    pub rig: Rig,
    /// The prior of its poses.
    pub model: PoseModel,
}

impl PoseSolver {
    /// Where a gesture begins that drags some joints of the pose `before`.
    pub fn reference(&self, goals: &Constraints, before: &Pose) -> Reference {
        let (y, noise) = self.observation(&goals.at_positions(&before.xyz), &before.xyz);
        let start = PlacementSolution::from_placement(before.placement);
        let restored = self.model.estimator().follow(&y, &noise, &start);
        let mean = restored.map(|(r, _)| r.mean).unwrap_or_default();
        let apart = |(y, mean): (&f64, &f64)| if y.is_finite() { y - mean } else { 0.0 };
        Reference {
            offset: y.iter().zip(&mean).map(apart).collect(),
            xyz: before.xyz.clone(),
        }
    }

    /// The pose for `goals` in a gesture that began at `reference`, found from the pose `before`,
    /// since which the hand went `way` cm.
    pub fn follow(
        &self,
        goals: &Constraints,
        reference: &Reference,
        before: &Pose,
        way: f64,
    ) -> Pose {
        let (y, noise) = self.observation(goals, &reference.xyz);
        let start = PlacementSolution::from_placement(before.placement);
        let Some((mut restored, _)) = self.model.estimator().follow(&y, &noise, &start) else {
            return before.clone();
        };
        let share = onset(goals, reference);
        let offsets = restored.mean.iter_mut().zip(&reference.offset);
        offsets.for_each(|(mean, offset)| *mean += share * offset);
        let wanted = self.fitted(goals, &restored, std::slice::from_ref(&before.q));
        let most = if way > 0.0 {
            STEP_RATIO * way
        } else {
            SETTLING_STEP
        };
        self.approached(goals, before, wanted, most)
    }

    /// The pose on the way from `before` to `wanted`, no joint of which is much farther than `most`
    /// cm from where it was, except as drags and pins ask for it.
    fn approached(&self, goals: &Constraints, before: &Pose, wanted: Pose, most: f64) -> Pose {
        let step = largest_step(&before.xyz, &wanted.xyz);
        if step <= most {
            return wanted;
        }
        let to = (self.rig.skeleton).nearest_equivalent(&wanted.q, &before.q);
        let mut share = most / step;
        for _ in 0..3 {
            let q: Vec<f64> = (before.q.iter().zip(&to))
                .map(|(from, to)| from + share * (to - from))
                .collect();
            let xyz = self.rig.positions(&q);
            let pose = self.at_positions(goals, &xyz, wanted.placement, &q);
            if largest_step(&before.xyz, &pose.xyz) <= 1.2 * most || share < 1e-2 {
                return Pose {
                    is_moving: true,
                    sd: wanted.sd,
                    ..pose
                };
            }
            share /= 2.0;
        }
        wanted
    }

    /// The pose for `goals` from nothing: every placement is tried. `None` where the joints do not
    /// determine one.
    pub fn restart(&self, goals: &Constraints, reference: &[f64], before: &Pose) -> Option<Pose> {
        let (y, noise) = self.observation(goals, reference);
        let restored = self.model.estimator().estimate(&y, &noise)?;
        Some(self.posed(goals, &restored, &before.q))
    }

    /// The pose whose joints are nearest to `xyz` (3 K, cm); where that is NaN, the prior says.
    /// `None` where too little is there.
    pub fn pose_at(&self, xyz: &[f64], before: &Pose) -> Option<Pose> {
        let mut goals = Constraints::none(self.rig.joints());
        for (k, at) in xyz.chunks_exact(3).enumerate() {
            let at = DVec3::from_slice(at);
            goals.forgotten[k] = true;
            goals.drags[k] = at.is_finite().then_some((at, EXACT_SD));
        }
        let mut pose = self.restart(&goals, xyz, before)?;
        pose.missed.fill(0.0);
        Some(pose)
    }

    /// A pose of the model (3 J) at a placement, as the rig takes it, found from the values
    /// `start`.
    pub fn placed(&self, model: &[f64], placement: Similarity, start: &[f64]) -> Pose {
        let mut mean = vec![0.0; model.len()];
        placement.apply_pose(model, &mut mean);
        let exact = FrameEstimate {
            sd: vec![0.0; self.model.points.len()],
            mean,
            placement,
        };
        self.posed(&Constraints::none(self.rig.joints()), &exact, start)
    }

    /// The rig in a restored pose, with its goals, found from the values `start` or in
    /// closed form.
    pub(crate) fn posed(
        &self,
        goals: &Constraints,
        restored: &FrameEstimate,
        start: &[f64],
    ) -> Pose {
        let mut closed_form = start.to_vec();
        let (targets, _) = self.soft_targets(goals, restored);
        InitialPose::new(&self.rig.skeleton, &self.rig.bones).apply(&targets, &mut closed_form);
        self.fitted(goals, restored, &[start.to_vec(), closed_form])
    }

    /// A pose carried elsewhere.
    pub(crate) fn moved(&self, pose: &Pose, shift: DVec3) -> Pose {
        let mut xyz = pose.xyz.clone();
        xyz.chunks_exact_mut(3)
            .for_each(|p| (0..3).for_each(|c| p[c] += shift[c]));
        let placement = Similarity {
            shift: pose.placement.shift + shift,
            ..pose.placement
        };
        let goals = Constraints::none(self.rig.joints());
        Pose {
            sd: pose.sd.clone(),
            ..self.at_positions(&goals, &xyz, placement, &pose.q)
        }
    }

    /// The rig with its joints at `xyz` (3 K, cm), the pins of `goals` held, found from the values
    /// `start`; the prior says nothing.
    pub(crate) fn at_positions(
        &self,
        goals: &Constraints,
        xyz: &[f64],
        placement: Similarity,
        start: &[f64],
    ) -> Pose {
        let there = FrameEstimate {
            mean: self.rig.to_model(xyz, self.model.points.len()),
            sd: vec![0.0; self.model.points.len()],
            placement,
        };
        self.fitted(goals, &there, &[start.to_vec()])
    }

    /// A pose carried into the skeleton's limits, with its pins held.
    pub fn within_limits(&self, pose: &Pose, pins: &[[Option<f64>; 3]]) -> Pose {
        let mut goals = Constraints::none(self.rig.joints());
        goals.pins.copy_from_slice(pins);
        goals.limits = true;
        Pose {
            sd: pose.sd.clone(),
            ..self.at_positions(&goals, &pose.xyz, pose.placement, &pose.q)
        }
    }

    /// The goals as an observation in the model's order: values and variances (3 J).
    fn observation(&self, goals: &Constraints, reference: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut y = (self.rig).to_model(&self.carried(goals, reference), self.model.points.len());
        let mut noise = vec![f64::INFINITY; y.len()];
        for (k, point) in self.rig.model_points.iter().enumerate() {
            let Some(p) = *point else { continue };
            let pin = goals.pins[k];
            let rest = if stands(goals, reference, k) {
                goals.rest.min(FLOOR_SD)
            } else {
                goals.rest
            };
            let mut variance = if goals.forgotten[k] {
                f64::INFINITY
            } else {
                rest * rest
            };
            if let Some((target, sd)) = goals.drags[k] {
                y[3 * p..3 * p + 3].copy_from_slice(&target.to_array());
                variance = sd * sd;
            }
            for c in 0..3 {
                y[3 * p + c] = pin[c].unwrap_or(y[3 * p + c]);
            }
            // The placement turns points: one variance for all three coordinates.
            if pin.iter().all(Option::is_some) {
                variance = EXACT_VARIANCE;
            }
            noise[3 * p..3 * p + 3].fill(variance);
        }
        (y, noise)
    }

    /// Where the joints are to stay: where they were, but a dragged root carries along those that
    /// no held joint is below.
    fn carried(&self, goals: &Constraints, reference: &[f64]) -> Vec<f64> {
        let mut carried = reference.to_vec();
        let drags = goals.drags.iter().zip(&self.rig.parents).enumerate();
        let mut roots = drags.filter(|(_, (_, parent))| parent.is_none());
        let Some((root, to)) = roots.find_map(|(k, (drag, _))| Some((k, (*drag)?.0))) else {
            return carried;
        };
        let way = to - DVec3::from_slice(&reference[3 * root..]);
        let mut stays = vec![false; self.rig.joints()];
        for held in (0..self.rig.joints()).filter(|&k| is_held(goals, reference, k)) {
            let above = std::iter::successors(Some(held), |&k| self.rig.parents[k]);
            above.for_each(|k| stays[k] = true);
        }
        let joints = carried.chunks_exact_mut(3).zip(stays);
        for (at, _) in joints.filter(|(_, stays)| !stays) {
            (0..3).for_each(|c| at[c] += way[c]);
        }
        carried
    }

    /// P2: the rig in the restored pose, with what is dragged and pinned where it has to be.
    fn fitted(&self, goals: &Constraints, restored: &FrameEstimate, starts: &[Vec<f64>]) -> Pose {
        let (mut targets, mut weights) = self.soft_targets(goals, restored);
        let settings = IkSettings {
            limits: goals.limits,
            tolerance: 1e-6,
            ..IkSettings::default()
        };
        let mut solver = IkSolver::new(&self.rig.skeleton, &self.rig.bones, settings);
        let mut found = starts.iter().map(|start| {
            let mut q = start.clone();
            let energy = solve(&mut solver, &targets, &weights, &mut q);
            (energy, q)
        });
        let first = found.next().unwrap_or_default();
        let (_, mut q) = found.fold(first, |a, b| if b.0 < a.0 { b } else { a });
        let mut xyz = self.rig.positions(&q);
        for _ in 0..3 {
            let holds = hold(goals, &xyz, &mut targets, &mut weights);
            if !holds {
                break;
            }
            solve(&mut solver, &targets, &weights, &mut q);
            xyz = self.rig.positions(&q);
        }
        let sd = (self.rig.model_points.iter())
            .map(|p| p.map_or(f64::INFINITY, |p| restored.sd[p]))
            .collect();
        Pose {
            missed: missed(goals, &xyz),
            unlike: self.unlike(&xyz, &restored.placement),
            placement: restored.placement,
            is_moving: false,
            q,
            xyz,
            sd,
        }
    }

    /// Targets and weights (3 K) of P2 before the pins are made exact; a joint without a target is
    /// NaN.
    fn soft_targets(&self, goals: &Constraints, restored: &FrameEstimate) -> (Vec<f64>, Vec<f64>) {
        let n = self.rig.joints();
        let (mut targets, mut weights) = (vec![f64::NAN; 3 * n], vec![0.0; 3 * n]);
        for k in 0..n {
            let (mut target, mut weight) = ([f64::NAN; 3], [0.0; 3]);
            if let Some(p) = self.rig.model_points[k] {
                target.copy_from_slice(&restored.mean[3 * p..3 * p + 3]);
                let sd = restored.sd[p];
                weight = [PRIOR_SHARE / (sd * sd + PRIOR_SD * PRIOR_SD); 3];
            }
            if let Some((to, sd)) = goals.drags[k] {
                (target, weight) = (to.to_array(), [1.0 / (sd * sd); 3]);
            }
            if let Some(floor) = &goals.floor {
                // NaN stays NaN: `max` would give the floor.
                target[1] = if target[1] < floor[k] {
                    floor[k]
                } else {
                    target[1]
                };
            }
            for c in 0..3 {
                if let Some(pin) = goals.pins[k][c] {
                    (target[c], weight[c]) = (pin, PIN_WEIGHT);
                }
                // A coordinate that nothing is known of has no weight, but a number.
                if target[c].is_nan() && goals.pins[k].iter().any(Option::is_some) {
                    target[c] = 0.0;
                }
            }
            targets[3 * k..3 * k + 3].copy_from_slice(&target);
            weights[3 * k..3 * k + 3].copy_from_slice(&weight);
        }
        (targets, weights)
    }

    /// Novelty of a pose (3 K); `None` where the model cannot tell.
    fn unlike(&self, xyz: &[f64], placement: &Similarity) -> Option<f64> {
        let pose = self.rig.to_model(xyz, self.model.points.len());
        let is_whole = pose.iter().all(|v| v.is_finite());
        let novelty = is_whole.then(|| self.model.estimator().novelty(&pose, placement));
        novelty.filter(|n| n.is_finite())
    }
}

/// The farthest that a joint goes from one pose (3 K) to the other, cm.
pub(super) fn largest_step(from: &[f64], to: &[f64]) -> f64 {
    let joints = from.chunks_exact(3).zip(to.chunks_exact(3));
    let steps = joints.map(|(a, b)| (DVec3::from_slice(a) - DVec3::from_slice(b)).length());
    steps.fold(0.0, f64::max)
}

/// Whether a joint stood on the floor where it was (3 K).
fn stands(goals: &Constraints, reference: &[f64], k: usize) -> bool {
    goals.floor.is_some() && reference[3 * k + 1] < ON_FLOOR
}

/// Whether a joint is pinned, or stood on the floor.
fn is_held(goals: &Constraints, reference: &[f64], k: usize) -> bool {
    goals.pins[k].iter().all(Option::is_some) || stands(goals, reference, k)
}

/// λ: the share of the prior's first pull that is held back still.
fn onset(goals: &Constraints, reference: &Reference) -> f64 {
    let come = goals.way_from(&goals.at_positions(&reference.xyz));
    let pull = reference
        .offset
        .iter()
        .fold(0.0, |z: f64, v| z.max(v.abs()));
    (-come / (ONSET + pull)).exp()
}

/// Improves `q` for weighted targets; what is left of the misfit.
fn solve(solver: &mut IkSolver<'_>, targets: &[f64], weights: &[f64], q: &mut [f64]) -> f64 {
    let before = q.to_vec();
    let regularization = Regularization {
        previous: &before,
        previous_weight: PREVIOUS_WEIGHT,
        rest: &before,
        rest_weight: 0.0,
    };
    solver.set_weights(weights);
    let fixed = vec![false; q.len()];
    solver.solve(targets, &fixed, &regularization, q).misfit
}

/// Makes the joints `xyz` the targets, and the pins and the floor exact. Whether there is anything
/// to hold that is not yet held.
fn hold(goals: &Constraints, xyz: &[f64], targets: &mut [f64], weights: &mut [f64]) -> bool {
    let mut holds = false;
    for (c, &at) in xyz.iter().enumerate() {
        let (k, axis) = (c / 3, c % 3);
        let floor = goals.floor.as_ref().map(|floor| floor[k]);
        let floor = floor.filter(|floor| axis == 1 && at < floor - BELOW_FLOOR);
        match goals.pins[k][axis].or(floor) {
            Some(to) => {
                holds |= (at - to).abs() > 1e-6;
                (targets[c], weights[c]) = (to, EXACT_WEIGHT);
            }
            // What was lifted to the floor stays there.
            None if weights[c] == EXACT_WEIGHT => {}
            None => targets[c] = at,
        }
    }
    holds
}

/// How far each pinned or dragged joint is from where it has to be (K), cm.
fn missed(goals: &Constraints, xyz: &[f64]) -> Vec<f64> {
    let at = |k: usize| DVec3::from_slice(&xyz[3 * k..]);
    let by_pin = |k: usize| {
        let pins = goals.pins[k].iter().zip(at(k).to_array());
        let squares = pins.filter_map(|(pin, at)| pin.map(|p| (p - at).powi(2)));
        squares.sum::<f64>().sqrt()
    };
    let by_drag = |k: usize| {
        let drag = goals.drags[k].filter(|_| goals.pins[k].iter().all(Option::is_none));
        drag.map_or((0.0, f64::INFINITY), |(to, sd)| {
            ((to - at(k)).length(), MISSED_DRAG + sd)
        })
    };
    let one = |k: usize| match (by_pin(k), by_drag(k)) {
        (pin, _) if pin > MISSED_PIN => pin,
        (_, (drag, allowed)) if drag > allowed => drag,
        _ => 0.0,
    };
    (0..goals.pins.len()).map(one).collect()
}
