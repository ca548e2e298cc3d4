//! A pose that is edited point by point.
//!
//! Each solve restores one observation y ~ N(x, diag(r)) of the pose x (3 J, cm): pinned points are exact, dragged points
//! have a standard deviation of 0.5 cm, and all others are observed where they stood, to within 10 cm. The placement starts
//! from that of the solve before ([`PlacementSolver::follow`](crate::restore::placement::PlacementSolver::follow)), so the
//! pose changes smoothly while a point moves.

use crate::io::Model;
use crate::pose::Similarity;
use crate::prior::EXACT_VARIANCE;
use crate::restore::Restorer;
use crate::restore::placement::PlacementSolution;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Standard deviation of a dragged point, cm.
const DRAGGED: f64 = 0.5;
/// Standard deviation of the points that are neither dragged nor pinned about where they stood, cm.
const FREE: f64 = 10.0;

/// Edits a pose under a model; starts from a typical pose at the origin.
///
/// ```
/// use posing::edit::Session;
/// # fn main() -> posing::Result<()> {
/// let model = posing::io::Model::builtin()?;
/// let mut session = Session::new(&model);
/// session.solve()?;
/// for foot in ["lfoot", "rfoot"] {
///     let here = session.position(foot).unwrap();
///     session.pin(foot, here);
/// }
/// let [x, y, z] = session.position("lwrist").unwrap();
/// session.drag("lwrist", [x, y + 10.0, z]);
/// let pose = session.solve()?; // 3 coordinates a point, cm
/// assert_eq!(pose.len(), 3 * session.points().len());
/// assert!(session.position("lwrist").unwrap()[1] > y + 5.0);
/// # Ok(())
/// # }
/// ```
pub struct Session<'m> {
    points: &'m [String],
    restorer: Restorer<'m>,
    /// Target of each dragged point, cm.
    dragged: BTreeMap<String, [f64; 3]>,
    /// Position of each pinned point, cm.
    pinned: BTreeMap<String, [f64; 3]>,
    /// The pose and the placement of the last solve; empty before the first.
    pose: Vec<f64>,
    solution: PlacementSolution,
}

impl<'m> Session<'m> {
    /// A session with a model, which is opened at the first solve.
    pub fn new(model: &'m Model) -> Session<'m> {
        Session {
            points: &model.meta.points,
            restorer: Restorer::new(model),
            dragged: BTreeMap::new(),
            pinned: BTreeMap::new(),
            pose: Vec::new(),
            solution: PlacementSolution::from_placement(Similarity::IDENTITY),
        }
    }

    /// The names of the points, J of them.
    pub fn points(&self) -> &[String] {
        self.points
    }

    /// Where a point stands after the last solve, cm; `None` before the first, and for an unknown name.
    pub fn position(&self, point: &str) -> Option<[f64; 3]> {
        let p = self.points.iter().position(|name| name == point)?;
        self.pose.get(3 * p..3 * p + 3)?.try_into().ok()
    }

    /// Moves a point to `target`, cm, as near as the model allows.
    pub fn drag(&mut self, point: &str, target: [f64; 3]) -> &mut Self {
        self.dragged.insert(point.to_string(), target);
        self
    }

    /// Holds a point exactly at `position`, cm.
    pub fn pin(&mut self, point: &str, position: [f64; 3]) -> &mut Self {
        self.pinned.insert(point.to_string(), position);
        self
    }

    /// Lets go of a dragged or pinned point.
    pub fn release(&mut self, point: &str) -> &mut Self {
        self.dragged.remove(point);
        self.pinned.remove(point);
        self
    }

    /// The pose (3 J coordinates, cm, in the order of [`Session::points`]) that the dragged and pinned points lead to.
    ///
    /// # Errors
    /// [`Error::Usage`] for a point that the model does not have or a target that is not finite; [`Error::Data`] if the model
    /// cannot be opened or the points do not determine where the pose stands.
    pub fn solve(&mut self) -> Result<&[f64]> {
        let restorer = self.restorer.frame_restorer()?;
        let mut y = match self.pose.is_empty() {
            true => restorer.prior.representative_poses().row(0).to_vec(),
            false => self.pose.clone(),
        };
        let mut noise = vec![FREE * FREE; y.len()];
        let dragged = self.dragged.iter().map(|(n, t)| (n, t, DRAGGED * DRAGGED));
        let pinned = self.pinned.iter().map(|(n, t)| (n, t, EXACT_VARIANCE));
        for (name, target, variance) in dragged.chain(pinned) {
            let Some(p) = self.points.iter().position(|n| n == name) else {
                return Err(Error::usage(format!("the model has no point \"{name}\"")));
            };
            if target.iter().any(|v| !v.is_finite()) {
                return Err(Error::usage(format!("{name}: the target is not finite")));
            }
            y[3 * p..3 * p + 3].copy_from_slice(target);
            noise[3 * p..3 * p + 3].fill(variance);
        }
        let Some((restored, solution)) = restorer.follow(&y, &noise, &self.solution) else {
            return Err(Error::usage("the points do not determine a pose"));
        };
        (self.pose, self.solution) = (restored.mean, solution);
        Ok(&self.pose)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
        let squares = (0..3).map(|c| (a[c] - b[c]).powi(2));
        squares.sum::<f64>().sqrt()
    }

    #[test]
    fn a_dragged_wrist_is_followed_and_pinned_feet_stay() {
        let model = crate::io::Model::builtin().unwrap();
        let mut session = Session::new(&model);
        assert!(session.position("lwrist").is_none());
        session.solve().unwrap();
        let at = |s: &Session<'_>, name: &str| s.position(name).unwrap();
        let feet = ["lfoot", "rfoot"].map(|f| (f, at(&session, f)));
        for (name, position) in feet {
            session.pin(name, position);
        }
        let mut target = at(&session, "lwrist");
        let arm = distance(target, at(&session, "lradius"));
        for _ in 0..10 {
            let before = at(&session, "lwrist");
            target[1] += 1.0;
            session.drag("lwrist", target).solve().unwrap();
            assert!(distance(before, at(&session, "lwrist")) <= 5.0);
        }
        assert!(distance(target, at(&session, "lwrist")) <= 3.0);
        for (name, position) in feet {
            assert!(distance(position, at(&session, name)) <= 0.05, "{name}");
        }
        let length = distance(at(&session, "lwrist"), at(&session, "lradius"));
        assert!((length - arm).abs() <= 0.3, "{length} {arm}");
        assert!(session.drag("nose", [0.0; 3]).solve().is_err());
        session.release("nose").drag("lwrist", [f64::NAN; 3]);
        assert!(session.solve().is_err());
    }
}
