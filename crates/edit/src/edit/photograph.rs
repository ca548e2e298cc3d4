//! A pose from a photograph: joints marked on a picture (section 4.4 and figure 5 of Lai et
//! al.).
//!
//! The camera looks along −z with x to the right and y up, as the world is. With the scale s
//! (pixels a centimeter at the body), a mark u (pixels from the middle of the picture) observes x
//! and y of its joint, to within 2 cm, and says nothing of z:
//!
//! ```text
//! (x, y) = u / s · (1 − z / Z),
//!     Z = f / s the distance of the camera, f its focal length in pixels;
//!     Z infinite: weak perspective
//! ```
//!
//! z on the right is that of the estimate before: three rounds settle it. The rotation R of the
//! body, its position t and s are those under which the n marks are likeliest:
//!
//! ```text
//! max over R, t, s   log p(u / s · (1 − z / Z) − t; R) − 2 n log s
//! ```
//!
//! p is the prior's evidence, its poses turned by R. (Alternating between pose and placement, as
//! for points of three dimensions, stops where it starts: the prior has a pose for most marks,
//! whichever way the body is turned.) The climb starts from the best views
//! of the prior's representative poses.

use super::pose_solver::{Constraints, Pose, PoseSolver};
use crate::numeric::lbfgs::minimize;
use crate::numeric::parallel;
use crate::pose::rotation::from_rotation_vector;
use crate::pose::{Observation, PoseTransform, Similarity};
use crate::prior::{Posterior, Prior, Want};
use crate::restore::FrameEstimate;
use crate::restore::frame_estimator::point_sd;
use crate::restore::placement::orthographic;
use crate::{Error, Result};
use glam::{DMat3, DVec2, DVec3};
use std::collections::BTreeMap;

/// Fewer marks do not place a pose.
pub(crate) const FEWEST_MARKS: usize = 4;
/// How well a mark is where its joint is, cm.
const MARK_SD: f64 = 2.0;
/// Depths of a limb that is flipped are known to within this, cm.
const FLIPPED_SD: f64 = 1.5;
/// Starting views that are climbed from, the likeliest of all, and steps of the climb from each.
const STARTS: usize = 4;
const STEPS: usize = 25;
/// Rounds of the perspective, and steps of the climb in each.
const ROUNDS: usize = 3;
const ROUND_STEPS: usize = 8;
/// The length that turns and scales are measured at in the climb, cm: a step of 1 moves a joint at
/// this distance by 1 cm.
const LEVER: f64 = 40.0;
/// The step of its differences, cm.
const DIFFERENCE: f64 = 0.2;

/// What is marked on a picture.
#[derive(Debug, Clone, Default)]
pub struct Marks {
    /// Where joints are, pixels from the middle of the picture, x to the right, y up.
    pub at: BTreeMap<usize, DVec2>,
    /// The focal length in pixels; `None`: weak perspective.
    pub focal: Option<f64>,
    /// Joints below which the limb is bent the other way in depth.
    pub flips: Vec<usize>,
}

/// How a picture shows the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Pixels a centimeter at the depth of the origin.
    pub scale: f64,
    /// The distance of the camera from the origin, cm; infinite: weak perspective.
    pub distance: f64,
    /// The position in the world of what the picture's origin shows at depth 0, cm.
    pub origin: DVec3,
}

impl Camera {
    /// Where a position of the world is in the picture, pixels from its middle.
    pub fn project(&self, position: DVec3) -> DVec2 {
        let from = position - self.origin;
        from.truncate() * self.scale / (1.0 - from.z / self.distance)
    }
}

/// A pose that was fitted to a picture.
#[derive(Debug, Clone)]
pub struct PhotographFit {
    /// The pose, with its lowest joint on the floor.
    pub pose: Pose,
    /// How the picture shows it.
    pub camera: Camera,
    /// The joint that is least certain of those without a mark.
    pub next: Option<usize>,
    view: View,
}

/// The pose that the marks show. `before` is where inverse kinematics starts. With the `previous`
/// fit to fewer marks, the climb starts from its view, and from one other only.
///
/// # Errors
/// [`Error::Usage`]: fewer than four marked joints that the model knows, or marks that lie
/// together.
pub fn fit_photograph(
    solver: &PoseSolver,
    marks: &Marks,
    before: &Pose,
    previous: Option<&PhotographFit>,
) -> Result<PhotographFit> {
    let known: Vec<(usize, usize, DVec2)> = (marks.at.iter())
        .filter_map(|(&k, &u)| Some((k, solver.rig.model_points[k]?, u)))
        .collect();
    if known.len() < FEWEST_MARKS {
        let what = format!(
            "{} joints are marked; {FEWEST_MARKS} are needed",
            known.len()
        );
        return Err(Error::usage(what));
    }
    let mut problem = Problem {
        solver,
        focal: marks.focal,
        known,
        depths: vec![0.0; solver.model.points.len()],
        flipped: Vec::new(),
    };
    let mut view = problem.best_view(previous.map(|fit| fit.view))?;
    if marks.focal.is_some() {
        for _ in 0..ROUNDS {
            problem.depths = problem.depths_of(&view);
            view = problem.climbed(view, ROUND_STEPS).1;
        }
    }
    if !marks.flips.is_empty() {
        problem.flipped = problem.mirrored_depths(&view, &marks.flips);
        view = problem.climbed(view, STEPS).1;
        problem.depths = problem.depths_of(&view);
    }
    Ok(problem.fitted(&view, before))
}

/// How the body is seen: the middle of the picture is the origin of the world.
#[derive(Debug, Clone, Copy)]
struct View {
    rotation: DMat3,
    shift: DVec2,
    scale: f64,
}

impl View {
    /// The view after steps in cm: three turns, two shifts, the scale.
    fn moved(&self, by: &[f64]) -> View {
        let turn = DVec3::from_slice(by) / LEVER;
        View {
            rotation: from_rotation_vector(turn) * self.rotation,
            shift: self.shift + DVec2::from_slice(&by[3..]),
            scale: self.scale * (by[5] / LEVER).exp(),
        }
    }
}

struct Problem<'a> {
    solver: &'a PoseSolver,
    focal: Option<f64>,
    /// Joint, point of the model, mark.
    known: Vec<(usize, usize, DVec2)>,
    /// The depth of every point (J) that perspective takes it for, cm.
    depths: Vec<f64>,
    /// Points whose depth is observed, and it, cm.
    flipped: Vec<(usize, f64)>,
}

impl Problem<'_> {
    /// The likeliest view of those climbed to from a `previous` one and from the best starts.
    fn best_view(&self, previous: Option<View>) -> Result<View> {
        let points = self.solver.model.points.len();
        let (mut marks, mut noise) = (vec![0.0; 3 * points], vec![f64::INFINITY; 3 * points]);
        for &(_, p, mark) in &self.known {
            (marks[3 * p], marks[3 * p + 1]) = (mark.x, mark.y);
            noise[3 * p..3 * p + 2].fill(1.0);
        }
        let seen = Observation {
            values: &marks,
            variance: &noise,
        };
        let prior = &*self.solver.model.prior;
        let views = orthographic::views(prior, seen, usize::MAX);
        let mut views = parallel::map_chunks(views.len(), 1, |range| {
            let view = &views[range.start];
            let view = View {
                rotation: view.rotation,
                shift: view.shift.truncate() / view.scale,
                scale: view.scale,
            };
            (self.log_likelihood(&view), view)
        });
        views.sort_by(|a, b| b.0.total_cmp(&a.0));
        let most = if previous.is_some() { 1 } else { STARTS };
        let others = views.iter().take(most).map(|(_, view)| *view);
        let starts: Vec<View> = previous.into_iter().chain(others).collect();
        let climbs = parallel::map_chunks(starts.len(), 1, |range| {
            self.climbed(starts[range.start], STEPS)
        });
        let best = climbs.into_iter().filter(|(e, _)| e.is_finite());
        let best = best.max_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, view)| view)
            .ok_or_else(|| Error::usage("the marks do not determine a pose: they lie together"))
    }

    /// Climbs from a view; the log likelihood, and where it ends.
    fn climbed(&self, start: View, steps: usize) -> (f64, View) {
        if !self.log_likelihood(&start).is_finite() {
            return (f64::NEG_INFINITY, start);
        }
        let mut cost = |by: &[f64]| {
            let (value, slope) = self.likelihood_and_slope(&start.moved(by));
            (-value, slope.iter().map(|v| -v).collect())
        };
        let found = minimize(vec![0.0; 6], steps, 1e-4, &mut cost);
        (-found.value, start.moved(&found.at))
    }

    fn log_likelihood(&self, view: &View) -> f64 {
        self.likelihood_along(view, &[]).0
    }

    /// The log likelihood of a view and its slope along the steps of [`View::moved`]. What moves
    /// the marks in the picture costs nothing more; turns out of its plane turn the model anew
    /// and are differences.
    fn likelihood_and_slope(&self, view: &View) -> (f64, [f64; 6]) {
        let mut along = vec![vec![0.0; 3 * self.solver.model.points.len()]; 4];
        for &(_, p, mark) in &self.known {
            let seen = self.seen(view, p, mark);
            // The part of the perspective does not depend on the scale: z / Z · u / s = z u / f.
            let nearer = mark / view.scale;
            let moves = [-seen.perp() / LEVER, -DVec2::X, -DVec2::Y, -nearer / LEVER];
            for (direction, by) in along.iter_mut().zip(moves) {
                (direction[3 * p], direction[3 * p + 1]) = (by.x, by.y);
            }
        }
        let (value, in_plane) = self.likelihood_along(view, &along);
        let mut slope = [0.0; 6];
        slope[2..].copy_from_slice(&in_plane);
        slope[5] -= 2.0 * self.known.len() as f64 / LEVER;
        for i in 0..2 {
            let mut by = [0.0; 6];
            by[i] = DIFFERENCE;
            slope[i] = (self.log_likelihood(&view.moved(&by)) - value) / DIFFERENCE;
        }
        (value, slope)
    }

    /// The log likelihood of a view, and how it changes as the observation (3 J) moves along these
    /// directions.
    fn likelihood_along(&self, view: &View, along: &[Vec<f64>]) -> (f64, Vec<f64>) {
        let prior = self.turned_prior(view);
        let (y, noise) = self.observation(view);
        let evidence = |y: &[f64]| {
            let seen = Observation {
                values: y,
                variance: &noise,
            };
            prior.posterior(&seen, Want::Mean).log_evidence
        };
        let seen = Observation {
            values: &y,
            variance: &noise,
        };
        let (evidence, slope) = match prior.evidence_gradient(&seen, along) {
            Some(found) => (found.log_evidence, found.gradient),
            None => {
                let here = evidence(&y);
                let difference = |direction: &Vec<f64>| {
                    let moved = y.iter().zip(direction);
                    let moved: Vec<f64> = moved.map(|(y, d)| y + DIFFERENCE * d).collect();
                    (evidence(&moved) - here) / DIFFERENCE
                };
                (here, along.iter().map(difference).collect())
            }
        };
        (
            evidence - 2.0 * self.known.len() as f64 * view.scale.ln(),
            slope,
        )
    }

    /// x and y of a marked point from the model's origin, in the directions of the camera, cm.
    fn seen(&self, view: &View, point: usize, mark: DVec2) -> DVec2 {
        mark / view.scale * self.nearness(view, point) - view.shift
    }

    /// The posterior of the pose in the directions of the camera, its origin that of the model's
    /// space.
    fn posterior(&self, view: &View, want: Want) -> Posterior {
        let (values, variance) = self.observation(view);
        let seen = Observation {
            values: &values,
            variance: &variance,
        };
        self.turned_prior(view).posterior(&seen, want)
    }

    /// The prior in the directions of the camera.
    fn turned_prior(&self, view: &View) -> Box<dyn Prior> {
        let prior = &*self.solver.model.prior;
        prior.mapped(&PoseTransform::Rotate(view.rotation))
    }

    /// The marks as an observation in the directions of the camera: values and variances (3 J).
    fn observation(&self, view: &View) -> (Vec<f64>, Vec<f64>) {
        let points = self.solver.model.points.len();
        let (mut y, mut noise) = (vec![0.0; 3 * points], vec![f64::INFINITY; 3 * points]);
        for &(_, p, mark) in &self.known {
            let seen = self.seen(view, p, mark);
            (y[3 * p], y[3 * p + 1]) = (seen.x, seen.y);
            noise[3 * p..3 * p + 2].fill(MARK_SD * MARK_SD);
        }
        for &(p, depth) in &self.flipped {
            y[3 * p + 2] = depth;
            noise[3 * p + 2] = FLIPPED_SD * FLIPPED_SD;
        }
        (y, noise)
    }

    /// 1 − z / Z: smaller for points near the camera.
    fn nearness(&self, view: &View, point: usize) -> f64 {
        1.0 - self.depths[point] / self.distance(view)
    }

    /// The distance of the camera, cm.
    fn distance(&self, view: &View) -> f64 {
        self.focal.map_or(f64::INFINITY, |f| f / view.scale)
    }

    /// The depths (J) of a view's mean pose, within the distance of the camera.
    fn depths_of(&self, view: &View) -> Vec<f64> {
        let mean = self.posterior(view, Want::Mean).mean;
        let most = 0.5 * self.distance(view);
        mean.iter()
            .skip(2)
            .step_by(3)
            .map(|z| z.clamp(-most, most))
            .collect()
    }

    /// The depths of the points below each of these joints, mirrored about that joint's own.
    fn mirrored_depths(&self, view: &View, joints: &[usize]) -> Vec<(usize, f64)> {
        let (rig, mut depths) = (&self.solver.rig, self.depths_of(view));
        let is_below = |k: usize, above: usize| {
            std::iter::successors(rig.parents[k], |&k| rig.parents[k]).any(|a| a == above)
        };
        let mut mirrored = Vec::new();
        for &joint in joints {
            let Some(from) = rig.model_points[joint] else {
                continue;
            };
            let below = (0..rig.joints()).filter(|&k| is_below(k, joint));
            for p in below.filter_map(|k| rig.model_points[k]) {
                depths[p] = 2.0 * depths[from] - depths[p];
                mirrored.push(p);
            }
        }
        // Each of several limbs within limbs is mirrored in turn.
        mirrored.sort_unstable();
        mirrored.dedup();
        mirrored.into_iter().map(|p| (p, depths[p])).collect()
    }

    /// The rig in a view, on the floor.
    fn fitted(&self, view: &View, before: &Pose) -> PhotographFit {
        let posterior = self.posterior(view, Want::Variances);
        let shift = view.shift.extend(0.0);
        let mean = posterior.mean.chunks_exact(3);
        let restored = FrameEstimate {
            mean: mean
                .flat_map(|p| (DVec3::from_slice(p) + shift).to_array())
                .collect(),
            sd: point_sd(&posterior.variance),
            placement: Similarity {
                rotation: view.rotation,
                shift,
                ..Similarity::IDENTITY
            },
        };
        let mut goals = Constraints::none(self.solver.rig.joints());
        // The figure is on the marks, at the depth that the prior says.
        for &(k, p, mark) in &self.known {
            let seen = mark / view.scale * self.nearness(view, p);
            goals.drags[k] = Some((seen.extend(restored.mean[3 * p + 2]), MARK_SD));
        }
        let pose = self.solver.posed(&goals, &restored, &before.q);
        let heights = pose.xyz.iter().skip(1).step_by(3);
        let lift = DVec3::Y * -heights.fold(f64::INFINITY, |z, y| z.min(*y));
        let pose = self.solver.moved(&pose, lift);
        let is_marked = |k: usize| self.known.iter().any(|known| known.0 == k);
        let unmarked =
            (0..self.solver.rig.joints()).filter(|&k| !is_marked(k) && pose.sd[k].is_finite());
        PhotographFit {
            view: *view,
            next: unmarked.max_by(|a, b| pose.sd[*a].total_cmp(&pose.sd[*b])),
            camera: Camera {
                scale: view.scale,
                distance: self.distance(view),
                origin: lift,
            },
            pose,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Session;
    use super::*;
    use crate::prior::builtin_model;

    /// A start pose, turned, as a camera sees it: the joints from the root, and marks without
    /// noise.
    fn seen(session: &Session, start: usize, focal: f64, distance: f64) -> (Vec<DVec3>, Marks) {
        let xyz = &session.starts()[start].pose.xyz;
        let at = |k: usize| DVec3::from_slice(&xyz[3 * k..]);
        let turn = DMat3::from_rotation_x(0.1) * DMat3::from_rotation_y(0.7);
        let joints = 0..session.rig().joints();
        let joints: Vec<DVec3> = joints.map(|k| turn * (at(k) - at(0))).collect();
        let marks = [
            "lhipjoint",
            "rhipjoint",
            "lclavicle",
            "rclavicle",
            "head",
            "lfemur",
            "rfemur",
            "ltibia",
            "rtibia",
            "lhumerus",
            "rhumerus",
            "lradius",
            "rradius",
        ];
        let marks = marks.map(|name| {
            let k = session.joint(name).unwrap();
            (k, joints[k].truncate() * focal / (distance - joints[k].z))
        });
        let marks = Marks {
            at: marks.into(),
            focal: Some(focal),
            flips: Vec::new(),
        };
        (joints, marks)
    }

    #[test]
    fn the_slope_of_the_likelihood_equals_differences() {
        let session = Session::of_model(&builtin_model().unwrap()).unwrap();
        let (_, marks) = seen(&session, 5, 1500.0, 400.0);
        let point = |k: usize| session.rig().model_points[k].unwrap();
        let problem = Problem {
            solver: session.solver(),
            focal: marks.focal,
            known: marks.at.iter().map(|(&k, &u)| (k, point(k), u)).collect(),
            depths: vec![10.0; session.solver().model.points.len()],
            flipped: Vec::new(),
        };
        let view = View {
            rotation: DMat3::from_rotation_y(0.4),
            shift: DVec2::new(3.0, -4.0),
            scale: 3.6,
        };
        let (_, slope) = problem.likelihood_and_slope(&view);
        for i in 0..6 {
            let at = |step: f64| {
                let mut by = [0.0; 6];
                by[i] = step;
                problem.log_likelihood(&view.moved(&by))
            };
            let difference = (at(1e-3) - at(-1e-3)) / 2e-3;
            let off = (slope[i] - difference).abs();
            assert!(
                off < 0.05 * difference.abs() + 0.5,
                "{i}: {} {difference}",
                slope[i]
            );
        }
    }

    #[test]
    fn a_pose_is_found_from_its_picture_and_projects_onto_the_marks() {
        let session = Session::of_model(&builtin_model().unwrap()).unwrap();
        let (joints, marks) = seen(&session, 5, 1500.0, 400.0);
        let fit = fit_photograph(session.solver(), &marks, &session.state().pose, None).unwrap();
        let at = |k: usize| DVec3::from_slice(&fit.pose.xyz[3 * k..]);
        let squares = (0..joints.len()).map(|k| (at(k) - at(0) - joints[k]).length_squared());
        let rms = (squares.sum::<f64>() / (3 * joints.len()) as f64).sqrt();
        assert!(rms < 5.0, "{rms} cm");
        for (&k, mark) in &marks.at {
            let off = (fit.camera.project(at(k)) - *mark).length() / fit.camera.scale;
            assert!(off < 4.0, "{off} cm");
        }
        let lowest = (0..joints.len())
            .map(|k| at(k).y)
            .fold(f64::INFINITY, f64::min);
        assert!(lowest.abs() < 1e-3, "{lowest} cm");
        assert!(
            (fit.camera.distance - 400.0).abs() < 80.0,
            "{}",
            fit.camera.distance
        );
        let next = fit.next.unwrap();
        assert!(!marks.at.contains_key(&next));
    }

    #[test]
    fn a_flipped_limb_is_on_the_other_side_in_depth() {
        let session = Session::of_model(&builtin_model().unwrap()).unwrap();
        let (_, marks) = seen(&session, 5, 1500.0, 400.0);
        let before = &session.state().pose;
        let fit = fit_photograph(session.solver(), &marks, before, None).unwrap();
        let [shoulder, wrist] = ["lclavicle", "lradius"].map(|n| session.joint(n).unwrap());
        let depth =
            |fit: &PhotographFit| fit.pose.xyz[3 * wrist + 2] - fit.pose.xyz[3 * shoulder + 2];
        let flipped = Marks {
            flips: vec![shoulder],
            ..marks
        };
        let flipped = fit_photograph(session.solver(), &flipped, before, None).unwrap();
        assert!(depth(&fit).abs() > 2.0, "the limb has a depth");
        assert!(
            depth(&flipped) * depth(&fit) < 0.0,
            "{} {}",
            depth(&flipped),
            depth(&fit)
        );
    }

    #[test]
    fn too_few_marks_and_marks_at_one_position_are_refused() {
        let session = Session::of_model(&builtin_model().unwrap()).unwrap();
        let (_, mut marks) = seen(&session, 0, 1500.0, 400.0);
        marks.at.values_mut().for_each(|at| *at = DVec2::ONE);
        let together = fit_photograph(session.solver(), &marks, &session.state().pose, None);
        assert!(together.unwrap_err().to_string().contains("together"));
        while marks.at.len() > 3 {
            marks.at.pop_first();
        }
        let few = fit_photograph(session.solver(), &marks, &session.state().pose, None);
        assert!(few.unwrap_err().to_string().contains("3 joints are marked"));
    }
}
