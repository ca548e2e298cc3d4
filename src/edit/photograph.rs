//! A pose from a photograph: joints marked on a picture (section 4.4 and figure 5 of the posing paper).
//!
//! The camera looks along −z with x to the right and y up, as the world is. With the scale s (pixels a centimetre at the body), a
//! mark u (pixels from the middle of the picture) observes x and y of its joint, to within 2 cm, and says nothing of z:
//!
//! ```text
//! (x, y) = u / s · (1 − z / Z),    Z = f / s the distance of the camera, f its focal length in pixels; Z infinite: weak perspective
//! ```
//!
//! z on the right is that of the pose before: three rounds settle it. For each s of a grid the pose and its placement are those of
//! [`orthographic::restore`]; of all s the likeliest wins: log p(u / s) − 2 n log s for n marks. The s below which a bone would be
//! longer than it is are left out.

use super::pose_solver::{Constraints, Pose, PoseSolver};
use crate::pose::{Observation, Similarity};
use crate::restore::RestoredFrame;
use crate::restore::frame_restorer::point_sd;
use crate::restore::placement::orthographic;
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// Fewer marks do not place a pose.
pub const FEWEST_MARKS: usize = 4;
/// How well a mark is where its joint is, cm.
const MARK_SD: f64 = 2.0;
/// Depths of a limb that is flipped are known to within this, cm.
const FLIPPED_SD: f64 = 4.0;
/// The scales that are tried, as multiples of the smallest, and the width of the last search around the best.
const SCALES: [f64; 6] = [1.0, 1.06, 1.13, 1.22, 1.35, 1.55];
/// Rounds of the perspective.
const ROUNDS: usize = 3;

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
    /// Pixels a centimetre at the depth of the origin.
    pub scale: f64,
    /// The distance of the camera from the origin, cm; infinite: weak perspective.
    pub distance: f64,
    /// The place in the world of what the picture's origin shows at depth 0, cm.
    pub origin: DVec3,
}

impl Camera {
    /// Where a place of the world is in the picture, pixels from its middle.
    pub fn project(&self, place: DVec3) -> DVec2 {
        let from = place - self.origin;
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
}

/// The pose that the marks show. `before` is where inverse kinematics starts.
///
/// # Errors
/// [`Error::Usage`]: fewer than four marked joints that the model knows, or marks that lie together.
pub fn fit_photograph(solver: &PoseSolver, marks: &Marks, before: &Pose) -> Result<PhotographFit> {
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
        marks,
        known,
        depths: Vec::new(),
    };
    let mut view = problem.best_view()?;
    if !marks.flips.is_empty() {
        problem.depths = problem.flipped_depths(&view);
        view = problem.view(view.scale, Some(&view)).unwrap_or(view);
    }
    Ok(problem.fitted(view, before))
}

/// One estimate of the pose, in the camera's world: the middle of the picture at the origin.
#[derive(Clone)]
struct View {
    scale: f64,
    /// (3 J), cm.
    mean: Vec<f64>,
    /// (3 J), cm².
    variance: Vec<f64>,
    placement: Similarity,
    likelihood: f64,
}

struct Problem<'a> {
    solver: &'a PoseSolver,
    marks: &'a Marks,
    /// Joint, point of the model, mark.
    known: Vec<(usize, usize, DVec2)>,
    /// Points whose depth is known, and it, cm.
    depths: Vec<(usize, f64)>,
}

impl Problem<'_> {
    fn best_view(&self) -> Result<View> {
        let least = self.smallest_scale();
        let mut best: Option<View> = None;
        let consider = |view: Option<View>, best: &mut Option<View>| {
            let view = view.filter(|v| v.likelihood.is_finite());
            if let Some(view) = view
                && best.as_ref().is_none_or(|b| view.likelihood > b.likelihood)
            {
                *best = Some(view);
            }
        };
        for share in SCALES {
            consider(self.view(least * share, None), &mut best);
        }
        for step in [0.06, 0.03, 0.015] {
            let Some(now) = best.clone() else { break };
            for factor in [1.0 - step, 1.0 + step] {
                consider(self.view(now.scale * factor, Some(&now)), &mut best);
            }
        }
        best.ok_or_else(|| Error::usage("the marks do not determine a pose: they lie together"))
    }

    /// The scale at which the bone that looks longest lies in the picture's plane, pixels a centimetre.
    fn smallest_scale(&self) -> f64 {
        let parents = &self.solver.rig.parents;
        let rest = vec![0.0; self.solver.rig.skeleton.dof_count()];
        let rest = self.solver.rig.positions(&rest);
        let at = |k: usize| DVec3::from_slice(&rest[3 * k..]);
        // Between two marks the chain of bones is no shorter than what is seen of it.
        let chain = |from: usize, to: usize| -> f64 {
            let up = |k: usize| std::iter::successors(Some(k), |&k| parents[k]);
            let meet = up(from).find(|a| up(to).any(|b| b == *a));
            let length = |k: usize| -> f64 {
                let way = up(k).take_while(|a| Some(*a) != meet);
                way.filter_map(|k| parents[k].map(|p| (at(k) - at(p)).length()))
                    .sum()
            };
            length(from) + length(to)
        };
        let mut scales = Vec::new();
        for (i, &(a, _, u)) in self.known.iter().enumerate() {
            for &(b, _, v) in &self.known[i + 1..] {
                let length = chain(a, b);
                if length > 5.0 {
                    scales.push((u - v).length() / length);
                }
            }
        }
        // Marks are not exact: a little smaller is possible.
        0.95 * scales.iter().copied().fold(0.0, f64::max)
    }

    /// The pose at one scale; from the placement of a view before, or from all.
    fn view(&self, scale: f64, before: Option<&View>) -> Option<View> {
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let rounds = if self.marks.focal.is_some() {
            ROUNDS
        } else {
            1
        };
        let mut view = before.cloned();
        for _ in 0..rounds {
            view = Some(self.view_once(scale, view.as_ref())?);
        }
        view
    }

    fn view_once(&self, scale: f64, before: Option<&View>) -> Option<View> {
        let points = self.solver.prior.points;
        let (mut y, mut noise) = (vec![0.0; 3 * points], vec![f64::INFINITY; 3 * points]);
        for &(_, p, mark) in &self.known {
            let depth = before.map_or(0.0, |v| v.mean[3 * p + 2]);
            let seen = mark / scale * (1.0 - depth / self.distance(scale));
            (y[3 * p], y[3 * p + 1]) = (seen.x, seen.y);
            noise[3 * p..3 * p + 2].fill(MARK_SD * MARK_SD);
        }
        for &(p, depth) in &self.depths {
            y[3 * p + 2] = depth;
            noise[3 * p + 2] = FLIPPED_SD * FLIPPED_SD;
        }
        let seen = Observation {
            values: &y,
            variance: &noise,
        };
        let restorer = self.solver.prior.restorer();
        let known = before.map(|v| v.placement);
        let (posterior, placement) =
            orthographic::restore(restorer.prior, seen, restorer.solver, known)?;
        Some(View {
            scale,
            likelihood: posterior.log_evidence - 2.0 * self.known.len() as f64 * scale.ln(),
            mean: posterior.mean,
            variance: posterior.variance,
            placement,
        })
    }

    /// The distance of the camera, cm.
    fn distance(&self, scale: f64) -> f64 {
        self.marks.focal.map_or(f64::INFINITY, |f| f / scale)
    }

    /// The depths of the points below each flipped joint, mirrored about that joint's own.
    fn flipped_depths(&self, view: &View) -> Vec<(usize, f64)> {
        let rig = &self.solver.rig;
        let is_below = |k: usize, above: usize| {
            std::iter::successors(rig.parents[k], |&k| rig.parents[k]).any(|a| a == above)
        };
        let mut depths = Vec::new();
        for &joint in &self.marks.flips {
            let Some(from) = rig.model_points[joint] else {
                continue;
            };
            for k in (0..rig.joints()).filter(|&k| is_below(k, joint)) {
                if let Some(p) = rig.model_points[k] {
                    depths.push((p, 2.0 * view.mean[3 * from + 2] - view.mean[3 * p + 2]));
                }
            }
        }
        depths
    }

    /// The rig in a view, on the floor.
    fn fitted(&self, view: View, before: &Pose) -> PhotographFit {
        let camera = Camera {
            scale: view.scale,
            distance: self.distance(view.scale),
            origin: DVec3::ZERO,
        };
        let restored = RestoredFrame {
            sd: point_sd(&view.variance),
            mean: view.mean.clone(),
            placement: view.placement,
        };
        let mut asked = Constraints::none(self.solver.rig.joints());
        // The figure is on the marks, at the depth that the prior says.
        for &(k, p, mark) in &self.known {
            let depth = view.mean[3 * p + 2];
            let seen = mark / view.scale * (1.0 - depth / camera.distance);
            asked.drags[k] = Some((seen.extend(depth), MARK_SD));
        }
        let pose = self.solver.posed(&asked, &restored, &before.q);
        let lowest = pose
            .xyz
            .iter()
            .skip(1)
            .step_by(3)
            .fold(f64::INFINITY, |z, y| z.min(*y));
        let lift = DVec3::Y * -lowest;
        let pose = self.solver.moved(&pose, lift);
        let marked = |k: &usize| self.marks.at.contains_key(k);
        let unmarked =
            (0..self.solver.rig.joints()).filter(|k| !marked(k) && pose.sd[*k].is_finite());
        PhotographFit {
            next: unmarked.max_by(|a, b| pose.sd[*a].total_cmp(&pose.sd[*b])),
            camera: Camera {
                origin: lift,
                ..camera
            },
            pose,
        }
    }
}
