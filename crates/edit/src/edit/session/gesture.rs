//! Gestures: drags from their first solve to their release, and the marking of a photograph.

use super::{DRAG_SD, Drags, Pins, Session, State};
use crate::Result;
use crate::edit::photograph::{Marks, PhotographFit, fit_photograph};
use crate::edit::pose_solver::{Constraints, Pose, Reference, floor_under};
use glam::DVec3;

/// A drag from its first solve to its release, or the marking of a photograph.
pub(crate) struct Gesture {
    before: State,
    /// The last fit to a photograph.
    photograph: Option<PhotographFit>,
    dragged: Vec<usize>,
    pinned: Vec<usize>,
    reference: Reference,
    /// The goals of the last solve.
    goals: Constraints,
}

impl Gesture {
    /// Whether the same joints are dragged and pinned. Another `rest` goes on only without a drag:
    /// a slider moved to and fro.
    fn goes_on_with(&self, dragged: &[usize], pinned: &[usize], is_same_rest: bool) -> bool {
        let is_same = self.dragged == dragged && self.pinned == pinned;
        is_same && (is_same_rest || dragged.is_empty()) && self.photograph.is_none()
    }

    /// Its name as a step, at whose end the other joints may go as far as `rest`, cm; `names` are
    /// those of the joints.
    fn step(&self, names: &[String], rest: f64) -> String {
        let dragged: Vec<&str> = self.dragged.iter().map(|&k| names[k].as_str()).collect();
        match dragged[..] {
            _ if self.photograph.is_some() => "the photograph".to_string(),
            [] if self.before.rest != rest => "the slider".to_string(),
            [] => "the pins".to_string(),
            _ => format!("the drag of {}", dragged.join(" and ")),
        }
    }
}

impl Session {
    /// Drags one joint to `target`, cm, with the pins as they are.
    ///
    /// # Errors
    /// As [`Session::solve`].
    pub fn drag(&mut self, joint: usize, target: DVec3) -> Result<&Pose> {
        let drags = Drags::from([(joint, (target, DRAG_SD))]);
        self.solve(&drags, &self.pins(), self.now.rest)
    }

    /// Finds the pose with these joints dragged, these pinned, and the others held to where they
    /// were when the gesture began to within `rest`, cm. The gesture goes on while the same
    /// joints are dragged and pinned; other joints begin the next.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): there is no such joint, or a number is not finite or
    /// out of range. Nothing changes then.
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
        let goals = self.goals(drags, pins, rest, &gesture.before.pose.xyz);
        let way = goals.way_from(&gesture.goals);
        self.now.pose = (self.solver).follow(&goals, &gesture.reference, &self.now.pose, way);
        (self.now.pins, self.now.rest) = (goals.pins.clone(), rest);
        gesture.goals = goals;
        self.gesture = Some(gesture);
        self.revision += 1;
        Ok(&self.now.pose)
    }

    /// The beginning of a gesture; what was under way before is a step of its own.
    fn begin(&mut self, drags: &Drags, pins: &Pins, rest: f64) -> Gesture {
        self.release();
        let goals = self.goals(drags, pins, rest, &self.now.pose.xyz);
        let moves = !drags.is_empty() || goals.pins != self.now.pins;
        Gesture {
            before: self.now.clone(),
            photograph: None,
            dragged: drags.keys().copied().collect(),
            pinned: pins.keys().copied().collect(),
            goals: goals.at_positions(&self.now.pose.xyz),
            reference: if moves {
                self.solver.reference(&goals, &self.now.pose)
            } else {
                Reference::at(self.now.pose.xyz.clone())
            },
        }
    }

    /// The goals of a gesture that began with the joints at `from` (3 K, cm).
    pub(super) fn goals(&self, drags: &Drags, pins: &Pins, rest: f64, from: &[f64]) -> Constraints {
        let mut goals = Constraints {
            rest,
            floor: self.now.floor.then(|| floor_under(from)),
            limits: self.now.limits,
            ..Constraints::none(self.rig().joints())
        };
        drags
            .iter()
            .for_each(|(&k, &drag)| goals.drags[k] = Some(drag));
        pins.iter().for_each(|(&k, &pin)| goals.pins[k] = pin);
        goals
    }

    /// Ends a gesture: it becomes one step of undo.
    pub fn release(&mut self) {
        let Some(gesture) = self.gesture.take() else {
            return;
        };
        // What is no longer dragged is no longer out of reach.
        (gesture.dragged.iter()).for_each(|&k| self.now.pose.missed[k] = 0.0);
        if gesture.before != self.now {
            let step = gesture.step(&self.rig().names, self.now.rest);
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

    /// Poses the figure by the marks of a photograph, without pins; released, it is one step,
    /// whatever was marked on the way.
    ///
    /// # Errors
    /// As [`fit_photograph`].
    pub fn photograph(&mut self, marks: &Marks) -> Result<PhotographFit> {
        let marked = self.gesture.as_ref().filter(|g| g.photograph.is_some());
        let previous = marked.and_then(|g| g.photograph.as_ref());
        let fit = fit_photograph(&self.solver, marks, &self.now.pose, previous)?;
        let before = match marked {
            Some(gesture) => gesture.before.clone(),
            None => {
                self.release();
                self.now.clone()
            }
        };
        self.gesture = Some(Gesture {
            before,
            photograph: Some(fit.clone()),
            dragged: Vec::new(),
            pinned: Vec::new(),
            reference: Reference::at(self.now.pose.xyz.clone()),
            goals: Constraints::none(self.rig().joints()),
        });
        self.now.pose = fit.pose.clone();
        self.now.pins.fill([None; 3]);
        self.revision += 1;
        Ok(fit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::pose_solver::REST;
    use crate::edit::session::tests::{pins_of, session};

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
}
