//! A take fitted with a skeleton: the most probable rotations of each frame.
//!
//! Key frames, some 24 a second, are solved from the mean of the prior, each by itself. A body far
//! from that may then land in another minimum than its neighbors, so once through the take forward,
//! and once backward, each is solved from its neighbor's rotations too, and the lower E is kept.
//! The frames between start between the key frames beside them. Frames go side by side; only where
//! a neighbor changed does a key frame wait for it.

use super::bone_normalization::BoneNormalizer;
use super::frame_solver::{FrameFit, FrameSolver, FrameState, Scratch, Start};
use super::solver::{IkSettings, IkSolver, MAX_DOFS, Regularization};
use super::tuning::sequence::*;
use crate::numeric::parallel::map_chunks;
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{angle_between, decompose};
use crate::prior::rotations::{JointPrior, RotationPrior};
use crate::{Error, Result};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// The points of a take that are joints of a skeleton.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Targets<'a> {
    /// The bone at whose end each point is.
    pub joints: &'a [usize],
    /// Which of CMU's joints each point is.
    pub cmu: &'a [Option<usize>],
    /// (frames, 3 points), cm; NaN is missing.
    pub xyz: ArrayView2<'a, f64>,
    /// Standard deviation of a coordinate (frames, points), cm; NaN: measured. `None`: all are.
    pub sd: Option<ArrayView2<'a, f64>>,
    /// Every so many frames is a key frame.
    pub stride: usize,
}

/// The stride of key frames of a take of so many frames a second, where that is known.
pub(crate) fn key_stride(rate: Option<f64>) -> usize {
    rate.map_or(1, |rate| ((rate / KEY_RATE) as usize).max(1))
}

/// A take's values and how well they fit.
#[derive(Debug, Clone, Default)]
pub struct SequenceFit {
    /// (frames, values of the skeleton), radians and centimeters.
    pub values: Array2<f64>,
    /// The mean distance of a fitted joint from its point, centimeters; NaN when no point is
    /// there.
    pub mean: f64,
    /// The largest.
    pub max: f64,
    /// By target, the sum of its distances in cm and the number of frames that have it.
    pub by_target: Vec<(f64, usize)>,
    /// The frame and target of the largest.
    pub worst: Option<(usize, usize)>,
    /// The bone that turns most from one frame to the next, the second of them, and by how much,
    /// radians.
    pub largest_step: Option<(usize, usize, f64)>,
    /// Frames in which a point is missing.
    pub incomplete: usize,
    /// Frames whose root could not be placed: it stands where it stood before.
    pub unplaced: usize,
    /// Frames that did not converge.
    pub unconverged: usize,
}

/// Fits a skeleton to a take.
///
/// What the points leave open is the mean of `prior`; bones that move no point stay at rest. A
/// frame with fewer than three points keeps the rotations of the one before that has more. With
/// `limits` the values are then carried into those of the skeleton. `watch` is called with the
/// number of frames done.
///
/// # Errors
/// [`Error::Usage`]: too many degrees of freedom, no joints, or columns that are not three per
/// joint.
pub(crate) fn fit_sequence(
    skeleton: &Skeleton,
    targets: &Targets<'_>,
    prior: &RotationPrior,
    limits: bool,
    watch: &mut dyn FnMut(usize),
) -> Result<SequenceFit> {
    if skeleton.dof_count() > MAX_DOFS {
        return Err(Error::usage(format!(
            "the skeleton has {} degrees of freedom; at most {MAX_DOFS} can be solved for",
            skeleton.dof_count()
        )));
    }
    let Targets { joints, xyz, .. } = *targets;
    if joints.is_empty() || xyz.ncols() != 3 * joints.len() {
        return Err(Error::usage(
            "no point of the table has the name of a skeleton joint",
        ));
    }
    let root = root(skeleton, targets);
    let labeled = joints.iter().zip(targets.cmu);
    let labeled: Vec<(usize, usize)> = labeled.filter_map(|(&j, cmu)| Some((j, (*cmu)?))).collect();
    let joint_prior = JointPrior::new(prior, skeleton, root, &labeled);
    let solver = FrameSolver::new(skeleton, joints, root, &joint_prior)?;
    Ok(fit_frames(skeleton, targets, root, solver, limits, watch))
}

/// Fits a skeleton to a take with the solver of its frames; the body turns at the bone `root`.
pub(crate) fn fit_frames(
    skeleton: &Skeleton,
    targets: &Targets<'_>,
    root: usize,
    solver: FrameSolver<'_>,
    limits: bool,
    watch: &mut dyn FnMut(usize),
) -> SequenceFit {
    let Targets { joints, xyz, .. } = *targets;
    let fitter = TakeFitter {
        skeleton,
        joints,
        root,
        solver,
        frames: Observed::new(skeleton, targets),
    };
    let mut fits = fitter.fit(targets.stride, watch);
    fitter.bridge_unseen(&mut fits);
    let mut out = SequenceFit {
        values: fitter.values(&fits),
        incomplete: fitter.frames.incomplete,
        unplaced: fits.iter().filter(|f| f.is_none()).count(),
        unconverged: fits.iter().flatten().filter(|f| !f.converged).count(),
        ..SequenceFit::default()
    };
    if limits {
        fitter.carry_into_limits(&mut out.values);
    }
    out.measure(skeleton, joints, xyz);
    out
}

/// The bone at which the body turns: the nearest that moves all points that are joints of CMU's, or
/// all points where none is.
fn root(skeleton: &Skeleton, targets: &Targets<'_>) -> usize {
    let bones = skeleton.bones();
    let labeled = targets.joints.iter().zip(targets.cmu);
    let labeled: Vec<usize> = labeled.filter_map(|(&j, cmu)| cmu.map(|_| j)).collect();
    let all = if labeled.len() > 2 {
        &labeled[..]
    } else {
        targets.joints
    };
    let mut below = vec![0usize; bones.len()];
    for &joint in all {
        let up = std::iter::successors(Some(joint), |&b| bones[b].parent);
        up.for_each(|b| below[b] += 1);
    }
    let turns = |b: &usize| bones[*b].dofs.iter().any(|d| d.channel.is_angle());
    let holds_all = |b: &usize| below[*b] == all.len();
    let found = (0..bones.len()).rev().filter(turns).find(holds_all);
    found.or_else(|| (0..bones.len()).find(turns)).unwrap_or(0)
}

/// The frames of a take as they are solved for.
struct Observed {
    /// (frames, 3 points): carried to the skeleton's lengths.
    xyz: Array2<f64>,
    /// (frames, points): one over the variance, 1/cm².
    weights: Array2<f64>,
    incomplete: usize,
}

impl Observed {
    fn new(skeleton: &Skeleton, targets: &Targets<'_>) -> Observed {
        let lengths = BoneNormalizer::for_skeleton(skeleton, targets.joints);
        let mut xyz = Array2::zeros(targets.xyz.dim());
        let mut incomplete = 0;
        for (from, mut to) in targets.xyz.rows().into_iter().zip(xyz.rows_mut()) {
            let from = from.to_vec();
            incomplete += usize::from(from.iter().any(|v| !v.is_finite()));
            let mut normalized = vec![f64::NAN; from.len()];
            lengths.normalize(&from, &mut normalized);
            to.iter_mut().zip(normalized).for_each(|(to, v)| *to = v);
        }
        let shape = (xyz.nrows(), targets.joints.len());
        let weights = Array2::from_shape_fn(shape, |at| {
            let sd = targets.sd.map_or(f64::NAN, |sd| sd[at]);
            let sd = if sd.is_nan() { LEAST_SD } else { sd };
            sd.clamp(LEAST_SD, MOST_SD).max(sd / FAR_SD).powi(-2)
        });
        Observed {
            xyz,
            weights,
            incomplete,
        }
    }

    /// The points of a frame and their weights.
    fn of(&self, frame: usize) -> (Vec<f64>, Vec<f64>) {
        (
            self.xyz.row(frame).to_vec(),
            self.weights.row(frame).to_vec(),
        )
    }

    fn is_seen(&self, frame: usize) -> bool {
        let row = self.xyz.row(frame);
        let points = row.as_slice().unwrap_or(&[]).chunks_exact(3);
        let seen = points.filter(|y| y.iter().all(|v| v.is_finite())).count();
        seen >= self.weights.ncols().min(3)
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Direction {
    Forward,
    Backward,
}

/// A skeleton and a take.
struct TakeFitter<'a> {
    skeleton: &'a Skeleton,
    joints: &'a [usize],
    root: usize,
    solver: FrameSolver<'a>,
    frames: Observed,
}

impl TakeFitter<'_> {
    /// A frame from a start; `None` where too few points are seen.
    fn solve(&self, frame: usize, start: Start, scratch: &mut Scratch) -> Option<FrameFit> {
        if !self.frames.is_seen(frame) {
            return None;
        }
        let (xyz, weights) = self.frames.of(frame);
        let fit = self.solver.solve(&xyz, &weights, start, scratch);
        fit.energy.is_finite().then_some(fit)
    }

    /// A solved frame, its joints at the measured points.
    fn finish(&self, frame: usize, fit: FrameFit, scratch: &mut Scratch) -> FrameFit {
        let (xyz, weights) = self.frames.of(frame);
        self.solver.finish(&xyz, &weights, fit, scratch)
    }

    /// The fit of each frame; `None` where too few points are seen. Every `stride`-th is a key
    /// frame.
    fn fit(&self, stride: usize, watch: &mut dyn FnMut(usize)) -> Vec<Option<FrameFit>> {
        let count = self.frames.xyz.nrows();
        let keys: Vec<usize> = (0..count).step_by(stride).collect();
        let of_mean = |t: usize, scratch: &mut Scratch| {
            let start = self
                .solver
                .start(self.root, &self.frames.xyz.row(t).to_vec());
            self.solve(t, Start::Far(start), scratch)
        };
        // Each from the one before; the first of a few from the mean.
        let of_few = |range: Range<usize>| {
            let (mut scratch, mut before) = (Scratch::default(), None::<FrameFit>);
            let mut of_key = |n: usize| {
                let fit = match &before {
                    Some(fit) => self.solve(keys[n], Start::Far(fit.state.clone()), &mut scratch),
                    None => of_mean(keys[n], &mut scratch),
                };
                before.clone_from(&fit);
                fit
            };
            range.map(&mut of_key).collect::<Vec<_>>()
        };
        let mut key_fits = map_chunks(keys.len(), CHUNK, of_few).concat();
        for direction in [Direction::Forward, Direction::Backward] {
            self.retry_from_neighbors(&keys, &mut key_fits, direction);
        }
        let between = |t: usize, scratch: &mut Scratch| {
            let (before, after) = (t / stride, (t / stride + 1).min(keys.len() - 1));
            if keys[before] == t {
                return key_fits[before].clone();
            }
            match (&key_fits[before], &key_fits[after]) {
                (Some(a), Some(b)) => {
                    let share = (t - keys[before]) as f64 / stride as f64;
                    let start = if self.is_near(&a.state, &b.state) {
                        Start::Near(
                            self.solver
                                .equations
                                .states
                                .between(&a.state, &b.state, share),
                        )
                    } else if share < 0.5 {
                        Start::Far(a.state.clone())
                    } else {
                        Start::Far(b.state.clone())
                    };
                    self.solve(t, start, scratch)
                }
                (Some(one), None) | (None, Some(one)) => {
                    self.solve(t, Start::Far(one.state.clone()), scratch)
                }
                (None, None) => of_mean(t, scratch),
            }
        };
        self.in_blocks(count, watch, |t, scratch| {
            let fit = between(t, scratch)?;
            Some(self.finish(t, fit, scratch))
        })
    }

    /// Frames side by side, with news after each block of them.
    fn in_blocks(
        &self,
        count: usize,
        watch: &mut dyn FnMut(usize),
        solve: impl Fn(usize, &mut Scratch) -> Option<FrameFit> + Sync,
    ) -> Vec<Option<FrameFit>> {
        let mut fits = Vec::with_capacity(count);
        while fits.len() < count {
            let first = fits.len();
            let block = map_chunks(BLOCK.min(count - first), CHUNK, |range| {
                let mut scratch = Scratch::default();
                range
                    .map(|t| solve(first + t, &mut scratch))
                    .collect::<Vec<_>>()
            });
            fits.extend(block.into_iter().flatten());
            watch(fits.len());
        }
        fits
    }

    /// Every key frame from its neighbor's rotations too.
    fn retry_from_neighbors(
        &self,
        keys: &[usize],
        fits: &mut [Option<FrameFit>],
        direction: Direction,
    ) {
        let neighbor = |n: usize| match direction {
            Direction::Forward => n.checked_sub(1),
            Direction::Backward => Some(n + 1).filter(|n| *n < keys.len()),
        };
        let tried = |n: usize, fits: &[Option<FrameFit>], scratch: &mut Scratch| {
            let (own, other) = (fits[n].as_ref()?, fits[neighbor(n)?].as_ref()?);
            if self.is_near(&own.state, &other.state) {
                None
            } else {
                self.solve(keys[n], Start::Far(other.state.clone()), scratch)
            }
        };
        let known: &[Option<FrameFit>] = fits;
        let ahead = self.in_blocks(keys.len(), &mut |_| (), |n, s| tried(n, known, s));
        let (mut changed, mut scratch) = (vec![false; keys.len()], Scratch::default());
        for (n, ahead) in ordered(ahead, direction) {
            let waits = neighbor(n).is_some_and(|before| changed[before]);
            let found = if waits {
                tried(n, fits, &mut scratch)
            } else {
                ahead
            };
            let own = fits[n].as_ref().map_or(f64::NAN, |fit| fit.energy);
            if let Some(found) = found.filter(|f| f.energy < own - LOWER) {
                (fits[n], changed[n]) = (Some(found), true);
            }
        }
    }

    fn is_near(&self, a: &FrameState, b: &FrameState) -> bool {
        let mut rotations = a.rotations.iter().zip(&b.rotations);
        let mut values = a
            .values
            .iter()
            .zip(&b.values)
            .zip(self.solver.equations.states.angle_values());
        rotations.all(|(a, b)| angle_between(a, b) <= NEAR)
            && values.all(|((a, b), is_angle)| !is_angle || (a - b).abs() <= NEAR)
    }

    /// Carries bones over the frames in which no point shows how they turn: from the frame before
    /// to the one after, held at the ends of the take. By itself a frame has them at the mean.
    fn bridge_unseen(&self, fits: &mut [Option<FrameFit>]) {
        let is_there =
            |t: usize, p: usize| (0..3).all(|c| self.frames.xyz[[t, 3 * p + c]].is_finite());
        for (bone, points) in self.solver.equations.seen_by() {
            let is_seen: Vec<bool> = (0..fits.len())
                .map(|t| fits[t].is_some() && points.iter().any(|p| is_there(t, *p)))
                .collect();
            let seen: Vec<usize> = (0..fits.len()).filter(|t| is_seen[*t]).collect();
            for t in (0..fits.len()).filter(|t| !is_seen[*t]) {
                let next = seen.partition_point(|s| *s < t);
                let after = seen.get(next).copied();
                let Some(before) = next.checked_sub(1).map(|n| seen[n]).or(after) else {
                    break;
                };
                let after = after.unwrap_or(before);
                let share = if after > before {
                    (t - before) as f64 / (after - before) as f64
                } else {
                    0.0
                };
                let (Some(from), Some(to)) = (fits[before].clone(), fits[after].clone()) else {
                    continue;
                };
                if let Some(fit) = &mut fits[t] {
                    let ends = (&from.state, &to.state);
                    self.solver
                        .equations
                        .states
                        .set_between(bone, ends, share, &mut fit.state);
                }
            }
        }
    }

    /// The values of the take; angles follow the frame before.
    fn values(&self, fits: &[Option<FrameFit>]) -> Array2<f64> {
        let mut values = Array2::zeros((fits.len(), self.skeleton.dof_count()));
        let first = fits.iter().flatten().next();
        let mut before: Vec<f64> = match first {
            Some(_) => vec![0.0; self.skeleton.dof_count()],
            None => self.solver.start(self.root, &[]).values,
        };
        let mut state = first.map(|fit| &fit.state);
        for (t, fit) in fits.iter().enumerate() {
            state = fit.as_ref().map(|fit| &fit.state).or(state);
            if let Some(state) = state {
                self.set_values(state, &mut before);
            }
            values
                .row_mut(t)
                .iter_mut()
                .zip(&before)
                .for_each(|(to, v)| *to = *v);
        }
        values
    }

    /// Sets a frame's values, of which `q` has those of the frame before.
    fn set_values(&self, state: &FrameState, q: &mut [f64]) {
        for (i, bone) in self.skeleton.bones().iter().enumerate() {
            let dofs = self.skeleton.dofs_of(i);
            let first = dofs.start;
            let Some(order) = bone.ball_axes() else {
                q[dofs.clone()].copy_from_slice(&state.values[dofs]);
                continue;
            };
            let own = bone.axis.transpose() * state.rotations[i] * bone.axis;
            let is_angle = |n: &usize| bone.dofs[*n].channel.is_angle();
            let angles: Vec<usize> = (0..bone.dofs.len()).filter(is_angle).collect();
            for n in (0..bone.dofs.len()).filter(|n| !is_angle(n)) {
                q[first + n] = state.values[first + n];
            }
            // The first named turns first; decompose names the last one first.
            let back = [angles[2], angles[1], angles[0]];
            let near = back.map(|n| q[first + n] + bone.dofs[n].offset);
            let found = decompose(&own, [order[2], order[1], order[0]], near);
            for (n, angle) in back.into_iter().zip(found) {
                q[first + n] = angle - bone.dofs[n].offset;
            }
        }
    }

    /// Values within the skeleton's limits that put the joints as near to the points.
    fn carry_into_limits(&self, values: &mut Array2<f64>) {
        let settings = IkSettings {
            limits: true,
            ..IkSettings::default()
        };
        let rest = vec![0.0; self.skeleton.dof_count()];
        let fixed = vec![false; rest.len()];
        let within = map_chunks(values.nrows(), CHUNK, |range| {
            let mut solver = IkSolver::new(self.skeleton, self.joints, settings);
            let one = |t: usize| {
                let mut q = self
                    .skeleton
                    .nearest_equivalent(&values.row(t).to_vec(), &rest);
                let previous = q.clone();
                let held = Regularization {
                    previous: &previous,
                    previous_weight: LIMITS_WEIGHT,
                    rest: &rest,
                    rest_weight: 0.0,
                };
                let weights = self.frames.weights.row(t);
                let weights = weights.iter().flat_map(|w| [*w * LEAST_SD * LEAST_SD; 3]);
                solver.set_weights(&weights.collect::<Vec<f64>>());
                solver.solve(&self.frames.xyz.row(t).to_vec(), &fixed, &held, &mut q);
                q
            };
            range.map(one).collect::<Vec<_>>()
        });
        for (mut row, q) in values
            .rows_mut()
            .into_iter()
            .zip(within.into_iter().flatten())
        {
            row.iter_mut().zip(q).for_each(|(to, v)| *to = v);
        }
    }
}

/// Items with their indices, in the order of a direction.
fn ordered<T>(items: Vec<T>, direction: Direction) -> Vec<(usize, T)> {
    let mut items: Vec<(usize, T)> = items.into_iter().enumerate().collect();
    if direction == Direction::Backward {
        items.reverse();
    }
    items
}

impl SequenceFit {
    /// The mean distance of some of the targets, cm; NaN where no frame has one.
    pub fn mean_of(&self, is_counted: impl Fn(usize) -> bool) -> f64 {
        let counted = self.by_target.iter().enumerate();
        let counted = counted.filter(|(t, _)| is_counted(*t)).map(|(_, own)| own);
        let (sum, count) = counted.fold((0.0, 0), |(s, n), own| (s + own.0, n + own.1));
        sum / count as f64
    }

    /// Measures how far the joints of the values are from the points, and the steps of the bones.
    fn measure(&mut self, skeleton: &Skeleton, joints: &[usize], xyz: ArrayView2<'_, f64>) {
        self.by_target = vec![(0.0, 0); joints.len()];
        self.max = f64::NAN;
        let (mut posture, mut before) = (Posture::default(), Posture::default());
        for (i, (q, y)) in self.values.rows().into_iter().zip(xyz.rows()).enumerate() {
            std::mem::swap(&mut posture, &mut before);
            skeleton.posture_into(&q.to_vec(), &mut posture);
            for (t, &joint) in joints.iter().enumerate() {
                let at = DVec3::from_array([0, 1, 2].map(|c| y[3 * t + c]));
                let far = (posture.ends[joint] - at).length();
                if far.is_finite() {
                    let (sum, count) = &mut self.by_target[t];
                    (*sum, *count) = (*sum + far, *count + 1);
                    if !(far <= self.max) {
                        self.max = far;
                        self.worst = Some((i, t));
                    }
                }
            }
            let steps = before.rotations.iter().zip(&posture.rotations).enumerate();
            for (bone, (a, b)) in steps {
                let step = angle_between(a, b);
                if self.largest_step.is_none_or(|(.., most)| step > most) {
                    self.largest_step = Some((bone, i, step));
                }
            }
        }
        self.mean = self.mean_of(|_| true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ik::estimate_skeleton;
    use crate::pose::Poses;
    use crate::pose::joints::{CMU, CMU_PARENT, CMU_REST, cmu_names};
    use crate::pose::rotation::from_rotation_vector;

    /// CMU's rest pose that turns about itself, with forearms that swing.
    fn turning(frames: usize) -> Array2<f64> {
        let position = |joint: usize| DVec3::from_array(CMU_REST[joint]);
        Array2::from_shape_fn((frames, 69), |(t, c)| {
            let (joint, axis) = (c / 3, c % 3);
            let elbow = CMU_PARENT[if CMU[joint].ends_with("wrist") {
                joint - 1
            } else {
                joint
            }];
            let swings = CMU[joint].ends_with("radius") || CMU[joint].ends_with("wrist");
            let bend = if swings { (0.2 * t as f64).sin() } else { 0.0 };
            let arm = from_rotation_vector(DVec3::Z * bend) * (position(joint) - position(elbow));
            (from_rotation_vector(DVec3::Y * 0.4 * t as f64) * (position(elbow) + arm))[axis]
        })
    }

    fn fitted(xyz: Array2<f64>, sd: Option<ArrayView2<'_, f64>>, rate: Option<f64>) -> SequenceFit {
        let poses = Poses {
            xyz,
            points: cmu_names(),
            ..Poses::default()
        };
        let skeleton = estimate_skeleton(&poses).unwrap();
        let joints: Vec<usize> = CMU.iter().map(|n| skeleton.find(n).unwrap()).collect();
        let cmu: Vec<Option<usize>> = (0..23).map(Some).collect();
        let (joints, cmu) = (&joints[..], &cmu[..]);
        let targets = Targets {
            joints,
            cmu,
            xyz: poses.xyz.view(),
            sd,
            stride: key_stride(rate),
        };
        let prior = RotationPrior::builtin().unwrap();
        fit_sequence(&skeleton, &targets, &prior, false, &mut |_| ()).unwrap()
    }

    #[test]
    fn a_body_that_turns_is_followed_through_all_turns() {
        let fit = fitted(turning(60), None, Some(60.0));
        assert!(fit.mean <= 0.1, "{}", fit.mean);
        assert_eq!((fit.unplaced, fit.incomplete, fit.unconverged), (0, 0, 0));
        let (_, _, step) = fit.largest_step.unwrap();
        assert!(step < 0.6, "{step}");
        // Key frames and those between are one motion.
        let apart = (&fit.values - &fitted(turning(60), None, None).values).mapv(f64::abs);
        let most = apart.iter().fold(0.0, |z: f64, v| z.max(*v));
        assert!(most <= 0.1, "{most}");
    }

    #[test]
    fn frames_with_hardly_a_point_keep_their_neighbors_rotations() {
        let mut xyz = turning(9);
        for t in [0, 4, 5, 8] {
            xyz.row_mut(t).fill(f64::NAN);
        }
        xyz.row_mut(2).slice_mut(ndarray::s![30..]).fill(f64::NAN);
        let fit = fitted(xyz, None, Some(60.0));
        assert_eq!((fit.unplaced, fit.incomplete), (4, 5));
        assert!(fit.values.iter().all(|v| v.is_finite()));
        assert_eq!(fit.values.row(4), fit.values.row(3));
        assert_eq!(fit.values.row(0), fit.values.row(1));
        let none = fitted(turning(3) * f64::NAN, None, None);
        assert!(none.mean.is_nan() && none.values.iter().all(|v| *v == 0.0));
    }

    #[test]
    fn a_limb_without_points_goes_on_from_before_to_after() {
        let whole = fitted(turning(30), None, None);
        let mut xyz = turning(30);
        // The left forearm and hand.
        xyz.slice_mut(ndarray::s![10..16, 51..57]).fill(f64::NAN);
        let fit = fitted(xyz, None, None);
        assert_eq!(fit.incomplete, 6);
        let apart = (&fit.values - &whole.values).mapv(f64::abs);
        let most = apart.iter().fold(0.0, |z: f64, v| z.max(*v));
        assert!(most <= 0.5, "{most}");
    }

    #[test]
    fn points_that_all_are_unsure_leave_room_for_the_prior() {
        let mut xyz = turning(12);
        xyz[[5, 3 * 17 + 1]] += 6.0;
        let sd = Array2::from_elem((12, 23), 3.0);
        let elbow = |fit: &SequenceFit| fit.by_target[17].0;
        let (unsure, sure) = (
            fitted(xyz.clone(), Some(sd.view()), None),
            fitted(xyz, None, None),
        );
        assert!(elbow(&unsure) > elbow(&sure) + 1.0);
    }

    #[test]
    fn unsure_points_pull_less() {
        let mut xyz = turning(40);
        // The left hand far up in the first frames.
        (0..4).for_each(|t| xyz[[t, 3 * 18 + 1]] += 20.0);
        let hand = |fit: &SequenceFit| fit.by_target[18].0 / 4.0;
        let mut sd = Array2::from_elem((40, 23), f64::NAN);
        let sure = hand(&fitted(xyz.clone(), None, None));
        (0..4).for_each(|t| sd[[t, 18]] = 300.0);
        let unsure = hand(&fitted(xyz, Some(sd.view()), None));
        assert!(unsure > sure + 3.0, "{unsure} {sure}");
    }
}
