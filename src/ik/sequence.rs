//! A take fitted with a skeleton: Algorithm 1, then P2, frame after frame.
//!
//! Each frame starts from the one before, so that what the joints leave open (a twist) moves no
//! more than it must. Where that ends far from the joints, it starts again: from the posture found
//! bone by bone, then from ones in which the limbs that do not fit are turned at random (seeded, so
//! that the same take gives the same values).

use super::bone_normalization::BoneNormalizer;
use super::initial_pose::InitialPose;
use super::solver::{IkSettings, IkSolver, MAX_DOFS, Regularization};
use super::tuning::sequence::*;
use crate::pose::Skeleton;
use crate::{Error, Result};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// How a take is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceSettings {
    /// The solver of each frame.
    pub solve: IkSettings,
    /// Other starts for a frame that does not fit, the first frame apart, which has four times as
    /// many.
    pub restarts: usize,
    /// Where randomness starts.
    pub seed: u64,
}

impl Default for SequenceSettings {
    fn default() -> Self {
        SequenceSettings {
            solve: IkSettings::default(),
            restarts: 8,
            seed: 0,
        }
    }
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
    /// Frames in which a point is missing.
    pub incomplete: usize,
    /// Frames whose root could not be placed: it stands where it stood before.
    pub unplaced: usize,
    /// Frames that needed another start.
    pub restarted: usize,
    /// Frames that neither fit nor converged.
    pub unconverged: usize,
}

/// Fits a skeleton to a take.
///
/// `joints[k]` is the bone whose end is the point in columns 3 k to 3 k + 2 of `xyz` (frames, 3 K;
/// centimeters; NaN is missing). Degrees of freedom that only missing points determine stay as they
/// were in the frame before (at a take's start, as in the first frame that shows them). The root
/// stays where its own point and all but two are missing. `watch` is called after each frame with
/// the number of frames done.
///
/// # Errors
/// [`Error::Usage`]: too many degrees of freedom, no joints, or columns that are not three per
/// joint.
pub fn fit_sequence(
    skeleton: &Skeleton,
    joints: &[usize],
    xyz: ArrayView2<'_, f64>,
    settings: &SequenceSettings,
    watch: &mut dyn FnMut(usize),
) -> Result<SequenceFit> {
    if skeleton.dof_count() > MAX_DOFS {
        return Err(Error::usage(format!(
            "the skeleton has {} degrees of freedom; at most {MAX_DOFS} can be solved for",
            skeleton.dof_count()
        )));
    }
    if joints.is_empty() || xyz.ncols() != 3 * joints.len() {
        return Err(Error::usage(
            "no point of the table has the name of a skeleton joint",
        ));
    }
    let mut fitter = SequenceFitter::new(skeleton, joints, settings);
    let mut out = SequenceFit {
        values: Array2::zeros((xyz.nrows(), skeleton.dof_count())),
        mean: f64::NAN,
        max: f64::NAN,
        by_target: vec![(0.0, 0); joints.len()],
        ..SequenceFit::default()
    };
    let Some(first) = fitter.most_complete_frame(xyz) else {
        return Ok(out);
    };
    fitter.solve_first_frame(
        xyz.row(first)
            .as_slice()
            .unwrap_or(&xyz.row(first).to_vec()),
    );
    for (i, row) in xyz.rows().into_iter().enumerate() {
        let y = row.to_vec();
        fitter.solve_frame(&y, &mut out);
        out.values
            .row_mut(i)
            .iter_mut()
            .zip(&fitter.q)
            .for_each(|(v, q)| *v = *q);
        let q = std::mem::take(&mut fitter.q);
        let posture = fitter.solver.posture(&q);
        for (t, (&joint, y)) in joints.iter().zip(y.chunks_exact(3)).enumerate() {
            let far = (posture.ends[joint] - DVec3::from_slice(y)).length();
            if far.is_finite() {
                let (sum, count) = &mut out.by_target[t];
                (*sum, *count) = (*sum + far, *count + 1);
                if !(far <= out.max) {
                    out.max = far;
                    out.worst = Some((i, t));
                }
            }
        }
        fitter.q = q;
        watch(i + 1);
    }
    out.mean = out.mean_of(|_| true);
    Ok(out)
}

impl SequenceFit {
    /// The mean distance of some of the targets, cm; NaN where no frame has one.
    pub fn mean_of(&self, is_counted: impl Fn(usize) -> bool) -> f64 {
        let counted = self.by_target.iter().enumerate();
        let counted = counted.filter(|(t, _)| is_counted(*t)).map(|(_, own)| own);
        let (sum, count) = counted.fold((0.0, 0), |(s, n), own| (s + own.0, n + own.1));
        sum / count as f64
    }
}

/// The state carried from frame to frame.
struct SequenceFitter<'a> {
    skeleton: &'a Skeleton,
    joints: &'a [usize],
    bones: BoneNormalizer,
    initial_pose: InitialPose<'a>,
    solver: IkSolver<'a>,
    settings: SequenceSettings,
    random: ChaCha8Rng,
    rest: Vec<f64>,
    /// The frame before, then this one.
    q: Vec<f64>,
    targets: Vec<f64>,
    fixed: Vec<bool>,
    root: Option<usize>,
    /// The usual misfit a joint, squared centimeters.
    typical_misfit: f64,
    /// Frames to go before other starts are tried again, and how many it was the last time.
    pause: (usize, usize),
}

/// The solution of one frame.
struct FrameSolution {
    q: Vec<f64>,
    energy: f64,
    misfit: f64,
    converged: bool,
}

impl<'a> SequenceFitter<'a> {
    /// A fitter that starts from the rest posture.
    fn new(
        skeleton: &'a Skeleton,
        joints: &'a [usize],
        settings: &SequenceSettings,
    ) -> SequenceFitter<'a> {
        let rest = vec![0.0; skeleton.dof_count()];
        SequenceFitter {
            skeleton,
            joints,
            bones: BoneNormalizer::for_skeleton(skeleton, joints),
            initial_pose: InitialPose::new(skeleton, joints),
            solver: IkSolver::new(skeleton, joints, settings.solve),
            settings: *settings,
            random: crate::numeric::parallel::rng(settings.seed, 0),
            q: rest.clone(),
            targets: vec![f64::NAN; 3 * joints.len()],
            fixed: vec![false; rest.len()],
            rest,
            root: joints.iter().position(|&j| j == 0),
            typical_misfit: 0.0,
            pause: (0, 0),
        }
    }

    /// The first frame with as many points as any of the first thousand.
    fn most_complete_frame(&self, xyz: ArrayView2<'_, f64>) -> Option<usize> {
        let (mut best, mut most) = (None, 0);
        for (i, row) in xyz.rows().into_iter().enumerate() {
            let seen = row.iter().filter(|v| v.is_finite()).count();
            // The root's own point counts for more than all others.
            let root = self.root.is_some_and(|r| row[3 * r].is_finite());
            let seen = seen + if root { row.len() } else { 0 };
            if seen > most {
                (best, most) = (Some(i), seen);
            }
            if i >= FIRST_AMONG && best.is_some() {
                break;
            }
        }
        best
    }

    /// Finds the first posture, from many starts.
    fn solve_first_frame(&mut self, y: &[f64]) {
        self.bones.normalize(y, &mut self.targets);
        let far = self.settings.restarts.saturating_mul(FIRST_FRAME_STARTS);
        let mut q = self.rest.clone();
        // The twist of each bone follows the frame before, here itself: settle it before it can be
        // seen to move.
        for _ in 0..FIRST_FRAME_ROUNDS {
            self.initial_pose.apply(&self.targets, &mut q);
        }
        let mut best = self.solve(q, 0.0, FIRST_REST_WEIGHT);
        self.restart(&mut best, far, 0.0, FIRST_REST_WEIGHT, FITS);
        if self.settings.solve.limits {
            self.solver.clamp(&mut best.q);
        } else {
            // A restart may have added whole turns.
            best.q = self.skeleton.nearest_equivalent(&best.q, &self.rest);
        }
        self.typical_misfit = best.misfit / self.observed_count().max(1) as f64;
        self.q = best.q;
    }

    /// How many points this frame shows.
    fn observed_count(&self) -> usize {
        let there = |y: &&[f64]| y.iter().all(|v| v.is_finite());
        self.targets.chunks_exact(3).filter(there).count()
    }

    /// Follows the next frame; counts it in `out`.
    fn solve_frame(&mut self, y: &[f64], out: &mut SequenceFit) {
        self.bones.normalize(y, &mut self.targets);
        let seen = self.observed_count();
        out.incomplete += usize::from(y.iter().any(|v| !v.is_finite()));
        let root_seen = self.root.is_none_or(|r| self.targets[3 * r].is_finite());
        let placed = seen > 2 || (root_seen && seen > 0);
        out.unplaced += usize::from(!placed);
        self.fixed[self.skeleton.dofs_of(0)].fill(!placed);
        let before = self.q.clone();
        let previous_weight = PREVIOUS_WEIGHT + NOISE_WEIGHT * self.typical_misfit;
        let limit = FITS.max(2.0 * self.typical_misfit.sqrt());
        let fits = |a: &FrameSolution| a.misfit <= limit * limit * seen as f64;
        // Ball joints alone: the closed form depends on this frame only, so it comes first.
        let exact = self.initial_pose.is_exact() && placed && !self.settings.solve.limits;
        let mut best = if exact {
            let mut q = before.clone();
            self.initial_pose.apply(&self.targets, &mut q);
            let misfit = self.solver.misfit(&q, &self.targets);
            if misfit <= FITS * FITS * seen as f64 {
                FrameSolution {
                    q,
                    energy: misfit,
                    misfit,
                    converged: true,
                }
            } else {
                let nearer = self.solver.misfit(&before, &self.targets) < misfit;
                let q = if nearer { before.clone() } else { q };
                self.solve(q, previous_weight, REST_WEIGHT)
            }
        } else {
            self.solve(before.clone(), previous_weight, REST_WEIGHT)
        };
        // Near a pole the values must run far for a small turn, and what holds them costs a part of
        // it: let go by steps.
        for _ in 0..POLE_ROUNDS {
            if fits(&best) {
                break;
            }
            self.q.copy_from_slice(&best.q);
            let next = self.solve(best.q.clone(), previous_weight, REST_WEIGHT);
            let gain = next.misfit < POLE_HELPED * best.misfit;
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
                self.initial_pose.apply(&self.targets, &mut q);
            }
            let other = self.solve(q, previous_weight, REST_WEIGHT);
            if other.energy < best.energy {
                best = other;
            }
            let tries = self.settings.restarts;
            self.restart(&mut best, tries, previous_weight, REST_WEIGHT, limit);
            // A skeleton that cannot fit must not cost a search every frame.
            let helped = best.misfit < HELPED * found;
            let pause = if helped {
                0
            } else {
                (2 * self.pause.1).clamp(PAUSE.0, PAUSE.1)
            };
            self.pause = (pause, pause);
        }
        if !self.settings.solve.limits {
            best.q = self.skeleton.nearest_equivalent(&best.q, &before);
        }
        out.unconverged += usize::from(!best.converged && !fits(&best));
        if seen > 0 {
            self.typical_misfit +=
                TYPICAL_SHARE * (best.misfit / seen as f64 - self.typical_misfit);
        }
        self.q = best.q;
    }

    /// Solves a frame from one start, held to the frame before and the rest posture.
    fn solve(&mut self, mut q: Vec<f64>, previous_weight: f64, rest_weight: f64) -> FrameSolution {
        let regularization = Regularization {
            previous: &self.q,
            previous_weight,
            rest: &self.rest,
            rest_weight,
        };
        let done = self
            .solver
            .solve(&self.targets, &self.fixed, &regularization, &mut q);
        FrameSolution {
            q,
            energy: done.energy,
            misfit: done.misfit,
            converged: done.converged,
        }
    }
}

impl SequenceFitter<'_> {
    /// Other starts, until one fits to `limit`: the bones above the joints that do not fit are
    /// turned at random.
    fn restart(
        &mut self,
        best: &mut FrameSolution,
        tries: usize,
        previous_weight: f64,
        rest_weight: f64,
        limit: f64,
    ) {
        let seen = self.observed_count();
        // A step costs the cube of the values: large skeletons get fewer tries, none of a body's
        // size does.
        let n = self.rest.len().max(1);
        for _ in 0..tries.min(1 + 4_000_000 / (n * n)) {
            if best.misfit <= limit * limit * seen as f64 {
                return;
            }
            let mut q = best.q.clone();
            for i in self.angles_above_misfits(&best.q) {
                q[i] += self.random.random_range(-1.5..1.5);
            }
            let other = self.solve(q, previous_weight, rest_weight);
            if other.energy < best.energy {
                *best = other;
            }
        }
    }

    /// The angles of the three nearest turning bones above each joint that fits worst, or half as
    /// badly.
    fn angles_above_misfits(&mut self, q: &[f64]) -> Vec<usize> {
        let posture = self.solver.posture(q);
        let far: Vec<f64> = self
            .joints
            .iter()
            .zip(self.targets.chunks_exact(3))
            .map(|(&j, y)| (posture.ends[j] - DVec3::from_slice(y)).length())
            .collect();
        let worst = far.iter().fold(0.0, |z: f64, &f| z.max(f));
        let mut angles = Vec::new();
        for (&joint, _) in self
            .joints
            .iter()
            .zip(&far)
            .filter(|(_, f)| **f >= 0.5 * worst)
        {
            let (mut at, mut turning) = (Some(joint), 0);
            while let Some(bone) = at.filter(|_| turning < 3) {
                let b = &self.skeleton.bones()[bone];
                let dofs = self.skeleton.dofs_of(bone);
                // The root's own turn is found in closed form.
                if b.parent.is_some() && !dofs.is_empty() {
                    turning += 1;
                    angles.extend(dofs.filter(|i| {
                        b.dofs[i - self.skeleton.dofs_of(bone).start]
                            .channel
                            .is_angle()
                    }));
                }
                at = b.parent;
            }
        }
        angles.sort_unstable();
        angles.dedup();
        angles
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use crate::pose::{Bone, Channel, Dof};
    use glam::DMat3;

    /// A root that slides and turns, an arm that is a ball joint, a hinge on it.
    fn arm() -> Skeleton {
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let turns = axes.map(Channel::Rotate).to_vec();
        let bone = |name: &str, parent, offset: [f64; 3], channels: Vec<Channel>| Bone {
            name: name.into(),
            parent,
            offset: DVec3::from_array(offset),
            axis: DMat3::from_rotation_y(0.4),
            dofs: channels.into_iter().map(Dof::free).collect(),
        };
        let six = [axes.map(Channel::Translate).to_vec(), turns.clone()].concat();
        Skeleton::new(vec![
            bone("root", None, [0., 0., 0.], six),
            bone("a", Some(0), [9., 1., 0.], vec![]),
            bone("b", Some(0), [-9., 0., 2.], vec![]),
            bone("upper", Some(1), [0., -30., 1.], turns),
            bone(
                "lower",
                Some(3),
                [0., -25., 3.],
                vec![Channel::Rotate(Axis::X)],
            ),
        ])
        .unwrap()
    }

    /// A motion that large_steps far from frame to frame.
    fn large_steps(s: &Skeleton, frames: usize) -> Array2<f64> {
        let mut xyz = Array2::zeros((frames, 15));
        for (i, mut row) in xyz.rows_mut().into_iter().enumerate() {
            let q: Vec<f64> = (0..s.dof_count())
                .map(|k| 1.5 * ((k + 1 + 13 * i) as f64 * 2.3).sin())
                .collect();
            let places = s.posture(&q).ends.into_iter().flat_map(|e| e.to_array());
            row.iter_mut().zip(places).for_each(|(a, b)| *a = b);
        }
        xyz
    }

    #[test]
    fn large_steps_are_followed_and_results_are_reproducible() {
        let (s, joints) = (arm(), [0, 1, 2, 3, 4]);
        let xyz = large_steps(&s, 40);
        let mut done = 0;
        let run = |watch: &mut dyn FnMut(usize)| {
            fit_sequence(&s, &joints, xyz.view(), &SequenceSettings::default(), watch)
        };
        let found = run(&mut |n| done = n).unwrap();
        assert_eq!((done, found.incomplete, found.unplaced), (40, 0, 0));
        // Leaps of a radian a frame look like noise, which holds the values a little.
        assert!(found.max <= 0.05, "{}", found.max);
        assert_eq!(found.values, run(&mut |_| {}).unwrap().values);
    }

    #[test]
    fn missing_points_are_no_error() {
        let (s, joints) = (arm(), [0, 1, 2, 3, 4]);
        let none = Array2::from_elem((3, 15), f64::NAN);
        let found = fit_sequence(
            &s,
            &joints,
            none.view(),
            &SequenceSettings::default(),
            &mut |_| {},
        )
        .unwrap();
        assert!(found.mean.is_nan() && found.values.iter().all(|v| *v == 0.0));
        let empty = Array2::zeros((0, 15));
        assert_eq!(
            fit_sequence(
                &s,
                &joints,
                empty.view(),
                &SequenceSettings::default(),
                &mut |_| {}
            )
            .unwrap()
            .values
            .nrows(),
            0
        );
        assert!(
            fit_sequence(
                &s,
                &[],
                empty.view(),
                &SequenceSettings::default(),
                &mut |_| {}
            )
            .is_err()
        );
        // Infinite and huge points are no places.
        let mut odd = large_steps(&s, 4);
        odd[[1, 4]] = f64::INFINITY;
        odd[[2, 7]] = 1e200;
        let found = fit_sequence(
            &s,
            &joints,
            odd.view(),
            &SequenceSettings::default(),
            &mut |_| {},
        )
        .unwrap();
        assert!(found.values.iter().all(|v| v.is_finite()));
    }
}
