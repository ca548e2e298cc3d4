//! A pose that is edited: gestures, undo, and what else is asked for than drags.

use super::history::History;
use super::in_betweens::{Motion, in_betweens};
use super::keys::{Key, Keys};
use super::other_poses::{OtherPose, other_poses};
use super::photograph::{Marks, PhotographFit, fit_photograph};
use super::pose_solver::{
    Constraints, DRAG_RANGE, Pose, PoseSolver, REST, REST_RANGE, Reference, floor_under,
};
use super::rig::Rig;
use super::rig_prior::RigPrior;
use super::start_poses::{self, StartPose};
use crate::io::Model;
use crate::pose::Poses;
use crate::prior::{self, OpenOptions};
use crate::restore::ik::estimate_skeleton;
use crate::{Error, Result};
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;

/// The standard deviation of a dragged joint if nothing else is said, cm.
pub const DRAG_SD: f64 = 0.5;
/// A joint this near to its pin is there, cm: pages round.
const THERE: f64 = 1e-3;
/// The latest time of a key, seconds.
const LATEST: f64 = 3600.0;
/// Farther from the origin nothing is placed, cm.
const FARTHEST: f64 = 1e5;

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

/// A drag from its first solve to its release, or the marking of a photograph.
struct Gesture {
    before: State,
    is_photograph: bool,
    dragged: Vec<usize>,
    pinned: Vec<usize>,
    reference: Reference,
    /// What the last solve asked for.
    asked: Constraints,
}

impl Gesture {
    /// Whether the same joints are dragged and pinned. Another `rest` goes on only without a drag: a slider moved to and fro.
    fn goes_on_with(&self, dragged: &[usize], pinned: &[usize], is_same_rest: bool) -> bool {
        let is_same = self.dragged == dragged && self.pinned == pinned;
        is_same && (is_same_rest || dragged.is_empty()) && !self.is_photograph
    }
}

/// Edits one pose of one rig under a model.
///
/// ```
/// use posing::edit::Session;
/// use posing::io::Model;
/// # fn main() -> posing::Result<()> {
/// let mut session = Session::of_model(&Model::builtin()?)?;
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
    /// [`Error::Data`] if the model cannot be opened, [`Error::Usage`] if no skeleton is known for its points.
    pub fn of_model(model: &Model) -> Result<Session> {
        let points = &model.meta.points;
        let rig = Rig::new(estimate_skeleton(&typical_poses(model)?)?, points)?;
        Session::new(model, "the model", rig)
    }

    /// A session with a rig, from the typical pose that stands most upright, on the floor; `source` names the model in errors.
    ///
    /// # Errors
    /// As [`RigPrior::open`].
    pub fn new(model: &Model, source: &str, rig: Rig) -> Result<Session> {
        let prior = RigPrior::open(model, source, &rig)?;
        let joints = rig.joints();
        let solver = PoseSolver { rig, prior };
        let starts = start_poses::start_poses(&solver);
        let pose = starts[0].pose.clone();
        Ok(Session {
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
        })
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

    /// Drags one joint to `target`, cm, with the pins as they are.
    ///
    /// # Errors
    /// As [`Session::solve`].
    pub fn drag(&mut self, joint: usize, target: DVec3) -> Result<&Pose> {
        let drags = Drags::from([(joint, (target, DRAG_SD))]);
        self.solve(&drags, &self.pins(), self.now.rest)
    }

    /// Finds the pose with these joints dragged, these pinned, and the others held to where they were when the gesture began to
    /// within `rest`, cm. The gesture goes on while the same joints are dragged and pinned; other joints begin the next.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such joint, or a number is not finite or out of range. Nothing changes then.
    pub fn solve(&mut self, drags: &Drags, pins: &Pins, rest: f64) -> Result<&Pose> {
        self.check(drags, pins, rest)?;
        let dragged: Vec<usize> = drags.keys().copied().collect();
        let pinned: Vec<usize> = pins.keys().copied().collect();
        let goes_on = (self.gesture.as_ref())
            .is_some_and(|g| g.goes_on_with(&dragged, &pinned, self.now.rest == rest));
        let mut gesture = match self.gesture.take() {
            Some(gesture) if goes_on => gesture,
            other => {
                self.gesture = other;
                self.begin(drags, pins, rest)
            }
        };
        let asked = self.asked(drags, pins, rest, &gesture.before.pose.xyz);
        let way = asked.way_from(&gesture.asked);
        self.now.pose = (self.solver).follow(&asked, &gesture.reference, &self.now.pose, way);
        (self.now.pins, self.now.rest) = (asked.pins.clone(), rest);
        gesture.asked = asked;
        self.gesture = Some(gesture);
        self.revision += 1;
        Ok(&self.now.pose)
    }

    /// The beginning of a gesture; what was under way before is a step of its own.
    fn begin(&mut self, drags: &Drags, pins: &Pins, rest: f64) -> Gesture {
        self.release();
        let asked = self.asked(drags, pins, rest, &self.now.pose.xyz);
        let moves = !drags.is_empty() || asked.pins != self.now.pins;
        Gesture {
            before: self.now.clone(),
            is_photograph: false,
            dragged: drags.keys().copied().collect(),
            pinned: pins.keys().copied().collect(),
            asked: asked.at_places(&self.now.pose.xyz),
            reference: match moves {
                true => self.solver.reference(&asked, &self.now.pose),
                false => Reference::at(self.now.pose.xyz.clone()),
            },
        }
    }

    /// What is asked in a gesture that began with the joints at `from` (3 K, cm).
    fn asked(&self, drags: &Drags, pins: &Pins, rest: f64, from: &[f64]) -> Constraints {
        let mut asked = Constraints {
            rest,
            floor: self.now.floor.then(|| floor_under(from)),
            limits: self.now.limits,
            ..Constraints::none(self.rig().joints())
        };
        drags
            .iter()
            .for_each(|(&k, &drag)| asked.drags[k] = Some(drag));
        pins.iter().for_each(|(&k, &pin)| asked.pins[k] = pin);
        asked
    }

    fn check_joints<'k>(&self, joints: impl IntoIterator<Item = &'k usize>) -> Result<()> {
        let mut joints = joints.into_iter();
        match joints.find(|k| **k >= self.rig().joints()) {
            Some(k) => Err(Error::usage(format!("there is no joint {k}"))),
            None => Ok(()),
        }
    }

    fn check(&self, drags: &Drags, pins: &Pins, rest: f64) -> Result<()> {
        let name = |k: usize| self.rig().names.get(k).map_or("?", String::as_str);
        let is_place = |v: f64| v.abs() <= FARTHEST;
        let is_in = |v: f64, range: (f64, f64)| v >= range.0 && v <= range.1;
        self.check_joints(drags.keys().chain(pins.keys()))?;
        for (&k, (target, sd)) in drags {
            if !target.to_array().into_iter().all(is_place) {
                let what = format!(
                    "{}: the target is not a place within {FARTHEST} cm",
                    name(k)
                );
                return Err(Error::usage(what));
            }
            if !is_in(*sd, DRAG_RANGE) {
                let (least, most) = DRAG_RANGE;
                let what = format!("{}: sd is {sd}; expected {least} to {most} cm", name(k));
                return Err(Error::usage(what));
            }
        }
        for (&k, pin) in pins {
            if !pin.iter().flatten().copied().all(is_place) {
                let what = format!("{}: the pin is not a place within {FARTHEST} cm", name(k));
                return Err(Error::usage(what));
            }
        }
        if !is_in(rest, REST_RANGE) {
            let (least, most) = REST_RANGE;
            return Err(Error::usage(format!(
                "rest is {rest}; expected {least} to {most} cm"
            )));
        }
        Ok(())
    }

    /// Ends a gesture: it becomes one step of undo.
    pub fn release(&mut self) {
        if let Some(gesture) = &self.gesture {
            // What is no longer dragged is no longer out of reach.
            (gesture.dragged.iter()).for_each(|&k| self.now.pose.missed[k] = 0.0);
        }
        if let Some(gesture) = self.gesture.take().filter(|g| g.before != self.now) {
            let names: Vec<&str> = (gesture.dragged.iter())
                .map(|&k| self.solver.rig.names[k].as_str())
                .collect();
            let step = match names[..] {
                _ if gesture.is_photograph => "the photograph".to_string(),
                [] if gesture.before.rest != self.now.rest => "the slider".to_string(),
                [] => "the pins".to_string(),
                _ => format!("the drag of {}", names.join(" and ")),
            };
            self.history.record(step, gesture.before);
            self.revision += 1;
        }
    }

    /// Goes back to where the gesture under way began.
    pub fn cancel(&mut self) {
        if let Some(gesture) = self.gesture.take() {
            self.now = gesture.before;
            self.revision += 1;
        }
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

    /// Pins a joint at some coordinates, cm, and moves it there; no coordinate: frees it.
    ///
    /// # Errors
    /// As [`Session::solve`].
    pub fn pin(&mut self, joint: usize, at: [Option<f64>; 3]) -> Result<()> {
        let mut pins = self.pins();
        match at.iter().any(Option::is_some) {
            true => pins.insert(joint, at),
            false => pins.remove(&joint),
        };
        self.pin_all(&pins)
    }

    /// The joints that are pinned.
    pub fn pins(&self) -> Pins {
        let pins = self.now.pins.iter().copied().enumerate();
        pins.filter(|(_, pin)| pin.iter().any(Option::is_some))
            .collect()
    }

    /// Replaces all pins. Joints that are not where they are pinned now move there.
    ///
    /// # Errors
    /// As [`Session::solve`].
    pub fn pin_all(&mut self, pins: &Pins) -> Result<()> {
        self.check(&Drags::new(), pins, self.now.rest)?;
        let is_there = |(&k, pin): (&usize, &[Option<f64>; 3])| {
            let at = self.position(k).to_array();
            let apart = pin.iter().zip(at).filter_map(|(p, at)| p.map(|p| p - at));
            apart.into_iter().all(|d| d.abs() <= THERE)
        };
        if pins.iter().all(is_there) {
            let asked = self.asked(&Drags::new(), pins, self.now.rest, &self.now.pose.xyz);
            self.change("the pins", |now, _| now.pins = asked.pins);
            return Ok(());
        }
        self.solve(&Drags::new(), pins, self.now.rest)?;
        self.release();
        Ok(())
    }

    /// A change that is a step of its own.
    pub(super) fn change(&mut self, step: &str, change: impl FnOnce(&mut State, &PoseSolver)) {
        self.release();
        let before = self.now.clone();
        change(&mut self.now, &self.solver);
        if before != self.now {
            self.history.record(step, before);
            self.revision += 1;
        }
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
    /// [`Error::Usage`]: out of range.
    pub fn set_rest(&mut self, rest: f64) -> Result<()> {
        self.check(&Drags::new(), &Pins::new(), rest)?;
        self.change("the slider", |now, _| now.rest = rest);
        Ok(())
    }

    /// Takes another pose, without its pins.
    pub fn take(&mut self, step: &str, pose: Pose) {
        self.change(step, |now, _| {
            now.pose = pose;
            now.pins.fill([None; 3]);
        });
    }

    /// Takes the pose nearest to these places of the joints (3 K, cm; NaN: the model says).
    ///
    /// # Errors
    /// [`Error::Usage`]: too few joints to place a pose.
    pub fn take_places(&mut self, step: &str, xyz: &[f64]) -> Result<()> {
        let Some(pose) = self.solver.pose_at(xyz, &self.now.pose) else {
            return Err(Error::usage(
                "fewer than three joints are there, or all on a line",
            ));
        };
        self.take(step, pose);
        Ok(())
    }

    /// Joints forget where they were: the model places them by the others.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such joint.
    pub fn reset(&mut self, joints: &[usize]) -> Result<()> {
        self.check_joints(joints)?;
        self.change("the reset", |now, solver| {
            joints.iter().for_each(|&k| now.pins[k] = [None; 3]);
            let mut asked = Constraints {
                rest: 1.0,
                pins: now.pins.clone(),
                floor: now.floor.then(|| floor_under(&now.pose.xyz)),
                limits: now.limits,
                ..Constraints::none(solver.rig.joints())
            };
            joints.iter().for_each(|&k| asked.forgotten[k] = true);
            let reference = Reference::at(now.pose.xyz.clone());
            now.pose = solver.follow(&asked, &reference, &now.pose, f64::INFINITY);
        });
        Ok(())
    }

    /// Exchanges left and right about the body's own plane.
    pub fn mirror(&mut self) {
        let mirrored = self.solver.rig.mirrored(&self.now.pose.xyz);
        self.take_mirrored(&mirrored, &|_| true, "the mirroring");
    }

    /// Takes mirrored places (3 K, cm) of the joints. A copied joint is pinned where its other was.
    fn take_mirrored(&mut self, places: &[f64], is_copied: &dyn Fn(usize) -> bool, step: &str) {
        let Some(pose) = self.solver.pose_at(places, &self.now.pose) else {
            return;
        };
        let mirrors = self.solver.rig.mirrors.clone();
        self.change(step, |now, _| {
            let pins = std::mem::replace(&mut now.pins, vec![[None; 3]; mirrors.len()]);
            now.pose = pose;
            for (k, pin) in now.pins.iter_mut().enumerate() {
                let source = if is_copied(k) {
                    mirrors[k].unwrap_or(k)
                } else {
                    k
                };
                let at = &now.pose.xyz[3 * k..3 * k + 3];
                *pin = std::array::from_fn(|c| pins[source][c].map(|_| at[c]));
            }
        });
    }

    /// Copies one side of the body, the joints whose names (or those of their points) begin with `from`, onto the other; joints
    /// between the sides move onto the plane between them.
    pub fn copy_side(&mut self, from: &str) {
        let (rig, xyz) = (&self.solver.rig, &self.now.pose.xyz);
        let points = &self.solver.prior.names;
        let begins = |name: &str| name.to_lowercase().starts_with(from);
        let name = |k: usize| rig.model_points[k].map_or(&rig.names[k], |p| &points[p]);
        let mirrored = rig.mirrored(xyz);
        let is_other: Vec<bool> = (0..rig.joints())
            .map(|k| rig.mirrors[k].is_some_and(|m| begins(name(m))))
            .collect();
        let share = |k: usize| match rig.mirrors[k] {
            None => 0.5,
            Some(_) if is_other[k] => 1.0,
            Some(_) => 0.0,
        };
        let places: Vec<f64> = (0..xyz.len())
            .map(|c| xyz[c] + share(c / 3) * (mirrored[c] - xyz[c]))
            .collect();
        self.take_mirrored(&places, &|k| is_other[k], "the copy of a side");
    }

    /// Pins joints at some of their coordinates (x, y, z), where they are now.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such joint.
    pub fn pin_here(&mut self, joints: &[usize], axes: [bool; 3]) -> Result<()> {
        self.check_joints(joints)?;
        self.release();
        let mut pins = self.pins();
        for &k in joints {
            let at = self.position(k).to_array();
            pins.insert(k, std::array::from_fn(|c| axes[c].then_some(at[c])));
        }
        pins.retain(|_, pin| pin.iter().any(Option::is_some));
        self.pin_all(&pins)
    }

    /// Makes the pose and its pins a key at `time`, seconds.
    ///
    /// # Errors
    /// [`Error::Usage`]: the time is negative, or too large.
    pub fn set_key(&mut self, time: f64) -> Result<()> {
        check_time(time)?;
        self.change("the key", |now, _| {
            let (pose, pins) = (now.pose.clone(), now.pins.clone());
            now.keys.set(Key { time, pose, pins });
        });
        Ok(())
    }

    /// Makes the pose and the pins of a key the present ones.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such key.
    pub fn open_key(&mut self, key: usize) -> Result<()> {
        self.check_key(key)?;
        self.change("the way to another key", |now, _| {
            now.pose = now.keys[key].pose.clone();
            now.pins = now.keys[key].pins.clone();
        });
        Ok(())
    }

    /// Moves a key to another time, seconds; it replaces a key that is there.
    ///
    /// # Errors
    /// As [`Session::set_key`] and [`Session::open_key`].
    pub fn move_key(&mut self, key: usize, time: f64) -> Result<()> {
        self.check_key(key)?;
        check_time(time)?;
        self.change("the move of a key", |now, _| {
            let moved = now.keys.remove(key);
            now.keys.set(Key { time, ..moved });
        });
        Ok(())
    }

    /// Removes a key.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such key.
    pub fn remove_key(&mut self, key: usize) -> Result<()> {
        self.check_key(key)?;
        self.change("the removal of a key", |now, _| {
            now.keys.remove(key);
        });
        Ok(())
    }

    /// Sets the frames a second of the motion between keys.
    ///
    /// # Errors
    /// [`Error::Usage`]: not from 1 to 1000.
    pub fn set_rate(&mut self, rate: f64) -> Result<()> {
        check_rate(rate)?;
        self.change("the rate", |now, _| now.keys.set_rate(rate));
        Ok(())
    }

    /// The motion through the keys.
    ///
    /// # Errors
    /// As [`in_betweens`].
    pub fn motion(&self) -> Result<Motion> {
        let keys = &self.now.keys;
        in_betweens(&self.solver, keys, keys.rate(), self.now.floor)
    }

    /// The present pose as a motion of one frame; joints that are pinned have no standard deviation.
    pub fn still(&self, rate: f64) -> Motion {
        let (pose, pins) = (&self.now.pose, &self.now.pins);
        let sd = pose.sd.iter().zip(pins);
        let sd = sd.map(|(sd, pin)| {
            if pin.iter().all(Option::is_some) {
                0.0
            } else {
                *sd
            }
        });
        Motion::of_one(pose, sd.collect(), rate)
    }

    /// Finds other poses with the present pins; see [`other_poses`].
    pub fn find_others(&mut self) -> &[OtherPose] {
        self.release();
        let asked = self.asked(
            &Drags::new(),
            &self.pins(),
            self.now.rest,
            &self.now.pose.xyz,
        );
        self.others = other_poses(&self.solver, &asked, &self.now.pose);
        &self.others
    }

    /// What [`Session::find_others`] found last.
    pub fn others(&self) -> &[OtherPose] {
        &self.others
    }

    /// Takes the pose of one that [`Session::find_others`] found last, with the pins as they are.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is none.
    pub fn take_other(&mut self, index: usize) -> Result<()> {
        let Some(other) = self.others.get(index) else {
            return Err(Error::usage(format!("there is no solution {index}")));
        };
        let pose = other.pose.clone();
        self.change("the other pose", |now, _| now.pose = pose);
        Ok(())
    }

    /// Poses the figure by the marks of a photograph, without pins; released, it is one step, whatever was marked on the way.
    ///
    /// # Errors
    /// As [`fit_photograph`].
    pub fn photograph(&mut self, marks: &Marks) -> Result<PhotographFit> {
        let fit = fit_photograph(&self.solver, marks, &self.now.pose, None)?;
        if self.gesture.as_ref().is_none_or(|g| !g.is_photograph) {
            self.release();
            let none = Constraints::none(self.rig().joints());
            self.gesture = Some(Gesture {
                before: self.now.clone(),
                is_photograph: true,
                dragged: Vec::new(),
                pinned: Vec::new(),
                reference: Reference::at(self.now.pose.xyz.clone()),
                asked: none,
            });
        }
        self.now.pose = fit.pose.clone();
        self.now.pins.fill([None; 3]);
        self.revision += 1;
        Ok(fit)
    }

    /// The rows of a table that can be edited: (frames, 3 K), cm, NaN where the table says nothing.
    pub fn rows(&self) -> &Array2<f64> {
        &self.rows
    }

    /// Sets the rows of a table that can be edited, and takes the first that places a pose, where it is; the floor is off, as nothing
    /// is known of it.
    ///
    /// # Errors
    /// [`Error::Usage`]: other than three columns a joint, or no row places a pose.
    pub fn edit_rows(&mut self, rows: Array2<f64>) -> Result<()> {
        if rows.ncols() != 3 * self.rig().joints() {
            return Err(Error::usage("rows need three numbers a joint"));
        }
        let placed = rows
            .rows()
            .into_iter()
            .find_map(|row| self.solver.pose_at(&row.to_vec(), &self.now.pose));
        let Some(pose) = placed else {
            return Err(Error::usage(
                "no row has three joints of the model, not all on a line",
            ));
        };
        (self.now.pose, self.now.floor, self.rows) = (pose, false, rows);
        self.revision += 1;
        Ok(())
    }

    /// Takes the pose of a row; joints that the row does not have are placed by the model.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such row, or it places no pose.
    pub fn take_row(&mut self, row: usize) -> Result<()> {
        if row >= self.rows.nrows() {
            return Err(Error::usage(format!("there is no row {row}")));
        }
        let xyz = self.rows.row(row).to_vec();
        self.take_places("the row of the table", &xyz)
    }

    /// Checks the numbers of a state that did not come from this session.
    pub(super) fn check_numbers(
        &self,
        rest: f64,
        rate: f64,
        mut times: impl Iterator<Item = f64>,
    ) -> Result<()> {
        self.check(&Drags::new(), &Pins::new(), rest)?;
        check_rate(rate)?;
        times.try_for_each(check_time)
    }

    /// Checks pins (K) that did not come from this session.
    pub(super) fn check_pins(&self, pins: &[[Option<f64>; 3]]) -> Result<()> {
        let pins = pins.iter().copied().enumerate().collect();
        self.check(&Drags::new(), &pins, REST)
    }

    fn check_key(&self, key: usize) -> Result<()> {
        match self.now.keys.get(key) {
            Some(_) => Ok(()),
            None => Err(Error::usage(format!("there is no key {key}"))),
        }
    }

    /// Puts the session into another state, as a step.
    pub(super) fn restore(&mut self, step: &str, state: State) {
        self.change(step, |now, _| *now = state);
    }
}

fn check_rate(rate: f64) -> Result<()> {
    match (1.0..=1000.0).contains(&rate) {
        true => Ok(()),
        false => Err(Error::usage(format!(
            "the rate is {rate}; expected 1 to 1000 frames a second"
        ))),
    }
}

fn check_time(time: f64) -> Result<()> {
    match (0.0..=LATEST).contains(&time) {
        true => Ok(()),
        false => Err(Error::usage(format!(
            "the time is {time}; expected 0 to {LATEST} seconds"
        ))),
    }
}

/// A few of the model's training poses, far apart, in the model's space.
///
/// # Errors
/// As [`prior::open`].
pub fn typical_poses(model: &Model) -> Result<Poses> {
    let prior = prior::open(model, &OpenOptions::default(), "the model")?;
    Ok(Poses {
        points: model.meta.points.clone(),
        xyz: prior.representative_poses().to_owned(),
        ..Poses::default()
    })
}

/// Rows of a table as poses of a rig (frames, 3 K): the columns of the joints' names; NaN where the table has none.
pub fn rows_of_table(rig: &Rig, poses: &Poses) -> Array2<f64> {
    let columns: Vec<Option<usize>> = (rig.names.iter())
        .map(|name| poses.points.iter().position(|p| p == name))
        .collect();
    Array2::from_shape_fn((poses.frames(), 3 * rig.joints()), |(t, c)| {
        columns[c / 3].map_or(f64::NAN, |p| poses.xyz[[t, 3 * p + c % 3]])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn session() -> Session {
        Session::of_model(&Model::builtin().unwrap()).unwrap()
    }

    fn pins_of(session: &Session, names: &[&str]) -> Pins {
        let pin = |name: &&str| {
            let k = session.joint(name).unwrap();
            (k, session.position(k).to_array().map(Some))
        };
        names.iter().map(pin).collect()
    }

    fn lengths(session: &Session) -> Vec<f64> {
        let parents = session.rig().parents.iter().enumerate();
        let bones = parents.filter_map(|(k, p)| p.map(|p| (k, p)));
        bones
            .map(|(k, p)| (session.position(k) - session.position(p)).length())
            .collect()
    }

    #[test]
    fn a_dragged_wrist_is_where_it_is_dragged_and_pinned_feet_stay() {
        let mut session = session();
        let pins = pins_of(&session, &["lfoot", "rfoot"]);
        let wrist = session.joint("lwrist").unwrap();
        let (from, bones) = (session.position(wrist), lengths(&session));
        let mut before = session.state().pose.clone();
        for step in 1..=30 {
            let target = from + DVec3::new(0.3, 0.9, 0.2) * f64::from(step);
            let drags = Drags::from([(wrist, (target, DRAG_SD))]);
            session.solve(&drags, &pins, REST).unwrap();
            assert!((session.position(wrist) - target).length() < 0.5);
            for (&foot, pin) in &pins {
                let off = session.position(foot) - DVec3::from_array(pin.map(Option::unwrap));
                assert!(off.length() < 1e-3, "{off}");
            }
            let now = &session.state().pose;
            let far = (0..session.rig().joints()).map(|k| {
                (DVec3::from_slice(&now.xyz[3 * k..]) - DVec3::from_slice(&before.xyz[3 * k..]))
                    .length()
            });
            assert!(far.fold(0.0, f64::max) < 4.0);
            before = now.clone();
        }
        let longer = lengths(&session)
            .iter()
            .zip(&bones)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(longer < 1e-9, "{longer}");
    }

    #[test]
    fn a_touch_moves_nothing() {
        let mut session = session();
        let wrist = session.joint("rwrist").unwrap();
        let before = session.state().pose.xyz.clone();
        session.drag(wrist, session.position(wrist)).unwrap();
        let after = &session.state().pose.xyz;
        let moved = before
            .iter()
            .zip(after)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(moved < 0.05, "{moved}");
    }

    #[test]
    fn what_is_out_of_reach_is_said_and_bones_keep_their_lengths() {
        let mut session = session();
        let bones = lengths(&session);
        let mut pins = pins_of(&session, &["lfoot", "rfoot"]);
        let wrist = session.joint("lwrist").unwrap();
        let far = session.position(wrist) + DVec3::new(300.0, 0.0, 0.0);
        session
            .solve(&Drags::from([(wrist, (far, DRAG_SD))]), &pins, REST)
            .unwrap();
        assert!(session.state().pose.missed[wrist] > 50.0);
        pins.insert(wrist, far.to_array().map(Some));
        session.pin_all(&pins).unwrap();
        assert!(session.state().pose.missed[wrist] > 50.0);
        for (a, b) in lengths(&session).iter().zip(&bones) {
            assert!((a - b).abs() < 1e-9);
        }
        assert!(session.state().pose.xyz.iter().all(|v| v.is_finite()));
    }

    #[test]
    fn gestures_are_undone_whole_and_cancelled() {
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
    fn the_same_requests_give_the_same_pose() {
        let poses = [(), ()].map(|()| {
            let mut session = session();
            let wrist = session.joint("lwrist").unwrap();
            let from = session.position(wrist);
            for step in 1..=8 {
                session
                    .drag(wrist, from + DVec3::new(1.0, 2.0, -1.0) * f64::from(step))
                    .unwrap();
            }
            session.state().pose.clone()
        });
        assert_eq!(poses[0], poses[1]);
    }

    #[test]
    fn a_refused_request_changes_nothing() {
        let mut session = session();
        let before = session.state().clone();
        let wrist = session.joint("lwrist").unwrap();
        let at = |target, sd| Drags::from([(wrist, (target, sd))]);
        assert!(
            session
                .solve(&at(DVec3::NAN, 1.0), &Pins::new(), REST)
                .is_err()
        );
        assert!(
            session
                .solve(&at(DVec3::ZERO, -1.0), &Pins::new(), REST)
                .is_err()
        );
        assert!(
            session
                .solve(&at(DVec3::splat(1e300), 1.0), &Pins::new(), REST)
                .is_err()
        );
        assert!(
            session
                .solve(&at(DVec3::ZERO, 1.0), &Pins::new(), f64::NAN)
                .is_err()
        );
        assert!(session.pin(99, [Some(0.0); 3]).is_err());
        assert!(session.set_key(-1.0).is_err() && session.open_key(0).is_err());
        assert_eq!((session.state(), session.revision()), (&before, 0));
    }

    #[test]
    fn mirroring_twice_comes_back_and_a_side_is_copied() {
        let mut session = session();
        let at = |s: &Session, name: &str| s.position(s.joint(name).unwrap());
        let wrist = session.joint("lwrist").unwrap();
        session
            .drag(wrist, at(&session, "lwrist") + DVec3::new(10.0, 25.0, 5.0))
            .unwrap();
        session.release();
        let before = session.state().pose.xyz.clone();
        session.mirror();
        let mirrored = session.rig().mirrored(&before);
        let apart = |a: &[f64], b: &[f64]| {
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max)
        };
        // The bones of the two sides are not of one length.
        assert!(apart(&session.state().pose.xyz, &mirrored) < 3.0);
        session.mirror();
        assert!(apart(&session.state().pose.xyz, &before) < 3.0);
        session.copy_side("l");
        assert!(at(&session, "rwrist").y > at(&session, "rhumerus").y - 60.0);
        assert!((at(&session, "rwrist").y - at(&session, "lwrist").y).abs() < 5.0);
    }

    #[test]
    fn limits_are_kept_when_asked_for() {
        let asf = crate::io::Asf::open("testdata/cmu/07/07.asf").unwrap();
        let model = Model::builtin().unwrap();
        let rig = Rig::new(asf.skeleton, &model.meta.points).unwrap();
        let mut session = Session::new(&model, "the model", rig).unwrap();
        // Some of its joints the model does not know: a release without a move is no step all the same.
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

    #[test]
    fn other_poses_hold_the_pins_and_differ() {
        let mut session = session();
        let pins = pins_of(&session, &["lfoot", "rfoot", "lwrist"]);
        session.pin_all(&pins).unwrap();
        let now = session.state().pose.xyz.clone();
        let others = session.find_others().to_vec();
        assert!(!others.is_empty());
        let apart = |a: &[f64], b: &[f64]| {
            let joints = a.chunks_exact(3).zip(b.chunks_exact(3));
            joints
                .map(|(a, b)| (DVec3::from_slice(a) - DVec3::from_slice(b)).length())
                .fold(0.0, f64::max)
        };
        for (i, other) in others.iter().enumerate() {
            assert!(apart(&other.pose.xyz, &now) >= 5.0);
            assert!(others[..i].iter().all(
                |o| apart(&o.pose.xyz, &other.pose.xyz) >= 5.0 && o.evidence >= other.evidence
            ));
            for (&k, pin) in &pins {
                let at = DVec3::from_array(pin.map(Option::unwrap));
                assert!((DVec3::from_slice(&other.pose.xyz[3 * k..]) - at).length() < 0.05);
            }
        }
        session.take_other(0).unwrap();
        assert_eq!(session.pins(), pins);
        assert!(session.take_other(99).is_err());
    }

    #[test]
    fn keys_are_met_exactly_and_pinned_feet_stay_between() {
        let mut session = session();
        let feet = pins_of(&session, &["lfoot", "rfoot"]);
        session.pin_all(&feet).unwrap();
        session.set_key(0.0).unwrap();
        let first = session.state().pose.xyz.clone();
        let root = session.joint("root").unwrap();
        let down = session.position(root) + DVec3::new(0.0, -25.0, -5.0);
        session
            .solve(&Drags::from([(root, (down, DRAG_SD))]), &feet, REST)
            .unwrap();
        session.release();
        session.set_key(1.01).unwrap();
        let last = session.state().pose.xyz.clone();
        assert!(session.motion().is_ok());
        let motion = session.motion().unwrap();
        assert_eq!(motion.xyz.nrows(), 31);
        assert_eq!(motion.xyz.row(0).to_vec(), first);
        assert_eq!(motion.xyz.row(30).to_vec(), last);
        for row in motion.xyz.rows() {
            for (&foot, pin) in &feet {
                let at = DVec3::from_slice(&row.to_vec()[3 * foot..]);
                assert!((at - DVec3::from_array(pin.map(Option::unwrap))).length() < 1e-2);
            }
        }
        let step = |t: usize| {
            (&motion.xyz.row(t + 1) - &motion.xyz.row(t)).fold(0.0, |z: f64, v| z.max(v.abs()))
        };
        assert!((0..30).all(|t| step(t) < 4.0), "no frame jumps");
        session.remove_key(0).unwrap();
        assert!(session.motion().is_err());
    }

    #[test]
    fn a_file_opens_to_the_same_state() {
        let mut session = session();
        let pins = pins_of(&session, &["lfoot"]);
        session.pin_all(&pins).unwrap();
        let wrist = session.joint("lwrist").unwrap();
        session
            .drag(wrist, session.position(wrist) + DVec3::Y * 12.0)
            .unwrap();
        session.release();
        session.set_key(0.5).unwrap();
        let json = session.to_json();
        let mut other = Session::of_model(&Model::builtin().unwrap()).unwrap();
        other.open_json(json.as_bytes()).unwrap();
        assert_eq!(other.to_json(), json);
        assert_eq!(other.state().pose.q, session.state().pose.q);
        let before = other.state().clone();
        for wrong in [
            "",
            "{}",
            "[1",
            &json.replace("session 1", "session 9"),
            &json.replace("lwrist", "nose"),
        ] {
            assert!(other.open_json(wrong.as_bytes()).is_err());
        }
        // Poses of another body are fitted with this one.
        let stretched = json.replacen("\"xyz\":[", "\"xyz\":[0.5,", 1);
        assert!(
            other.open_json(stretched.as_bytes()).is_err(),
            "a number too many"
        );
        assert_eq!(other.state(), &before);
    }

    #[test]
    fn rows_of_a_table_are_taken_and_gaps_filled() {
        let mut session = session();
        let mut rows = Array2::zeros((2, 69));
        let xyz = session.starts()[3].pose.xyz.clone();
        rows.row_mut(0).fill(f64::NAN);
        rows.row_mut(1).assign(&ndarray::aview1(&xyz));
        let wrist = session.joint("lwrist").unwrap();
        rows.slice_mut(ndarray::s![1, 3 * wrist..3 * wrist + 3])
            .fill(f64::NAN);
        session.edit_rows(rows).unwrap();
        let head = session.joint("head").unwrap();
        let was = DVec3::from_slice(&xyz[3 * head..]);
        assert!((session.position(head) - was).length() < 0.5);
        assert!(session.position(wrist).is_finite());
        assert!(session.take_row(0).is_err() && session.take_row(2).is_err());
        assert!(session.take_row(1).is_ok());
    }
}
