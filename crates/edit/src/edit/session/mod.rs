//! A pose that is edited: its state, its steps, and what is set of it.

mod checks;
mod file;
mod gesture;
mod key_poses;
mod mirror;
mod pins;
mod rows;
mod whole_poses;

pub use file::LARGEST_SESSION;
pub use rows::rows_of_table;

use super::history::History;
use super::keys::Keys;
use super::other_poses::OtherPose;
use super::pose_solver::{Pose, PoseSolver, REST};
use super::rig::Rig;
use super::rig_prior::{for_rig, open_model};
use super::start_poses::{self, StartPose};
use crate::Result;
use crate::ik::estimate_skeleton;
use crate::io::Model;
use crate::restore::PoseModel;
use gesture::Gesture;
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;

/// The standard deviation of a dragged joint if nothing else is said, cm.
pub const DRAG_SD: f64 = 0.5;

/// What undo brings back.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// The pose.
    pub pose: Pose,
    /// The coordinates at which each joint is pinned (K), cm.
    pub pins: Vec<[Option<f64>; 3]>,
    /// The standard deviation of the other joints about where they were, cm.
    pub rest: f64,
    /// Whether no joint may go below y = 0.
    pub floor: bool,
    /// Whether the skeleton's limits are kept.
    pub limits: bool,
    /// The key poses.
    pub keys: Keys,
}

/// The joints that are dragged: the target of each and its standard deviation, cm.
pub type Drags = BTreeMap<usize, (DVec3, f64)>;
/// The joints that are pinned, and at which coordinates, cm.
pub type Pins = BTreeMap<usize, [Option<f64>; 3]>;

/// Edits one pose of one rig under a model.
///
/// ```
/// use posing_edit::edit::Session;
/// use posing_models::prior::builtin_model;
/// # fn main() -> posing_core::Result<()> {
/// let mut session = Session::of_model(&builtin_model()?)?;
/// let feet = ["lfoot", "rfoot"].map(|name| session.joint(name).unwrap());
/// for foot in feet {
///     session.pin(foot, session.position(foot).to_array().map(Some))?;
/// }
/// let wrist = session.joint("lwrist").unwrap();
/// let target = session.position(wrist) + glam::DVec3::Y * 10.0;
/// session.drag(wrist, target)?;
/// session.release();
/// assert!((session.position(wrist) - target).length() < 0.5);
/// session.undo();
/// # Ok(())
/// # }
/// ```
pub struct Session {
    solver: PoseSolver,
    now: State,
    gesture: Option<Gesture>,
    history: History<State>,
    starts: Vec<StartPose>,
    others: Vec<OtherPose>,
    rows: Array2<f64>,
    revision: u64,
}

impl Session {
    /// A session with the model's own body, for models with CMU's names.
    ///
    /// # Errors
    /// [`Error::Data`](crate::Error::Data) if the model cannot be opened,
    /// [`Error::Usage`](crate::Error::Usage) if no skeleton is known for its points.
    pub fn of_model(model: &Model) -> Result<Session> {
        let opened = open_model(model, "the model")?;
        let skeleton = estimate_skeleton(&opened.representative_poses())?;
        let rig = Rig::new(skeleton, &opened.points)?;
        Ok(Session::with_model(opened, rig))
    }

    /// A session with a rig; `source` names the model in errors.
    ///
    /// # Errors
    /// As [`open_model`].
    pub fn new(model: &Model, source: &str, rig: Rig) -> Result<Session> {
        Ok(Session::with_model(open_model(model, source)?, rig))
    }

    /// A session with a rig, from the typical pose that stands most upright, on the floor.
    pub fn with_model(model: PoseModel, rig: Rig) -> Session {
        let model = for_rig(model, &rig);
        let joints = rig.joints();
        let solver = PoseSolver { rig, model };
        let starts = start_poses::start_poses(&solver);
        let pose = starts[0].pose.clone();
        Session {
            solver,
            now: State {
                pose,
                pins: vec![[None; 3]; joints],
                rest: REST,
                floor: true,
                limits: false,
                keys: Keys::default(),
            },
            gesture: None,
            history: History::default(),
            starts,
            others: Vec::new(),
            rows: Array2::zeros((0, 3 * joints)),
            revision: 0,
        }
    }

    /// The skeleton and its joints.
    pub fn rig(&self) -> &Rig {
        &self.solver.rig
    }

    /// Finds poses as this session does, without changing it.
    pub fn solver(&self) -> &PoseSolver {
        &self.solver
    }

    /// The present state.
    pub fn state(&self) -> &State {
        &self.now
    }

    /// Grows with each change.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The steps that can be undone and done again.
    pub fn history(&self) -> &History<State> {
        &self.history
    }

    /// Poses to start from.
    pub fn starts(&self) -> &[StartPose] {
        &self.starts
    }

    /// The joint of a name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.rig().find(name)
    }

    /// Where a joint is, cm.
    ///
    /// # Panics
    /// There is no such joint.
    pub fn position(&self, joint: usize) -> DVec3 {
        DVec3::from_slice(&self.now.pose.xyz[3 * joint..])
    }

    /// Says whether joints stay above the floor, y = 0.
    pub fn set_floor(&mut self, on: bool) {
        self.change("the floor", |now, _| now.floor = on);
    }

    /// Says whether the skeleton's limits are kept; a pose beyond them is carried into them.
    pub fn set_limits(&mut self, on: bool) {
        self.change("the limits", |now, solver| {
            now.limits = on;
            if on {
                now.pose = solver.within_limits(&now.pose, &now.pins);
            }
        });
    }

    /// Sets how far the other joints may go from where they were, without moving any, cm.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): out of range.
    pub fn set_rest(&mut self, rest: f64) -> Result<()> {
        self.check(&Drags::new(), &Pins::new(), rest)?;
        self.change("the slider", |now, _| now.rest = rest);
        Ok(())
    }

    /// Undoes the last step; a gesture under way is released first.
    pub fn undo(&mut self) {
        self.release();
        if let Some(before) = self.history.undo(self.now.clone()) {
            self.now = before;
            self.revision += 1;
        }
    }

    /// Does again what was undone last.
    pub fn redo(&mut self) {
        self.release();
        if let Some(after) = self.history.redo(self.now.clone()) {
            self.now = after;
            self.revision += 1;
        }
    }

    /// A change that is a step of its own.
    fn change(&mut self, step: &str, change: impl FnOnce(&mut State, &PoseSolver)) {
        self.release();
        let before = self.now.clone();
        change(&mut self.now, &self.solver);
        if before != self.now {
            self.history.record(step, before);
            self.revision += 1;
        }
    }

    /// Puts the session into another state, as a step.
    fn restore(&mut self, step: &str, state: State) {
        self.change(step, |now, _| *now = state);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::builtin_model;

    pub(super) fn session() -> Session {
        Session::of_model(&builtin_model().unwrap()).unwrap()
    }

    pub(super) fn pins_of(session: &Session, names: &[&str]) -> Pins {
        let pin = |name: &&str| {
            let k = session.joint(name).unwrap();
            (k, session.position(k).to_array().map(Some))
        };
        names.iter().map(pin).collect()
    }

    #[test]
    fn gestures_are_undone_whole_and_canceled() {
        let mut session = session();
        let wrist = session.joint("lwrist").unwrap();
        let first = session.state().clone();
        let from = session.position(wrist);
        for step in 1..=5 {
            session
                .drag(wrist, from + DVec3::Y * f64::from(step))
                .unwrap();
        }
        session.release();
        let second = session.state().clone();
        // Another joint is another step, without a release.
        let head = session.joint("head").unwrap();
        session
            .drag(head, session.position(head) + DVec3::X * 3.0)
            .unwrap();
        session.undo();
        assert_eq!(session.state(), &second);
        session.undo();
        assert_eq!(session.state(), &first);
        session.undo();
        session.redo();
        assert_eq!(session.state(), &second);
        session.drag(wrist, from).unwrap();
        session.cancel();
        assert_eq!(session.state(), &second);
    }

    #[test]
    fn limits_are_kept_when_asked_for() {
        let asf = crate::io::Asf::open("../../testdata/cmu/07/07.asf").unwrap();
        let model = builtin_model().unwrap();
        let rig = Rig::new(asf.skeleton, &model.meta.points).unwrap();
        let mut session = Session::new(&model, "the model", rig).unwrap();
        // Some of its joints the model does not know: a release without a move is no step all the
        // same.
        let wrist = session.joint("lwrist").unwrap();
        session.release();
        session.set_rest(REST).unwrap();
        assert_eq!(
            (session.history().undo_step(), session.state()),
            (None, &session.state().clone())
        );
        session.set_limits(true);
        let from = session.position(wrist);
        for step in 1..=10 {
            session
                .drag(wrist, from + DVec3::new(0.0, 4.0, -6.0) * f64::from(step))
                .unwrap();
            let limits = session.rig().skeleton.limits();
            for (q, (low, high)) in session.state().pose.q.iter().zip(limits) {
                assert!(*q >= low - 1e-12 && *q <= high + 1e-12);
            }
        }
    }
}
