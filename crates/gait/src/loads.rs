//! When it is known what acts on a foot, and the forces, moments and powers that follow.

use crate::angles::Body;
use crate::curves::Curves;
use crate::events::{Event, EventKind};
use crate::kinetics::{self, JOINTS, JointKinetics};
use crate::markers::Frame;
use crate::parameters::{Subject, mean_length};
use crate::plates::{Contact, on_foot};
use crate::side::Side;
use crate::trial::Trial;
use glam::DVec3;

/// A foot that is off at an end of the trial is so for at most this, seconds.
const LONGEST_SWING: f64 = 0.5;
/// A plate's load reaches so far beyond its contact, seconds: into the mean of a frame's samples.
const EDGE: f64 = 0.04;

/// What tells the loads of a side's foot.
pub(crate) struct Loads<'a> {
    pub side: Side,
    /// Both sides.
    pub contacts: &'a [Contact],
    pub events: &'a [Event],
}

impl Loads<'_> {
    /// Adds the forces, moments and powers of the side, empty where its foot is on the floor and
    /// what acts on it is not known, and in a trial in which it is on no plate.
    pub(crate) fn add_kinetics(
        &self,
        curves: &mut Curves,
        trial: &Trial,
        bodies: &[Body],
        subject: &Subject,
    ) {
        let side = self.side;
        let alone = self.contacts.iter().filter(|c| c.side == side && !c.of_two);
        let alone: Vec<Contact> = alone.copied().collect();
        let is_told = !alone.is_empty();
        let mut loads = on_foot(&trial.plates, &alone, bodies.len(), trial.rate);
        loads.iter_mut().flatten().for_each(|v| *v /= subject.mass);
        let foot = |frame: &Frame| {
            let [.., hee, toe] = frame.leg(side);
            hee.distance(toe)
        };
        let foot = mean_length(&trial.markers, &foot).map_or(f64::NAN, |(mean, _)| mean);
        let joints = kinetics::leg(bodies, side, &loads, foot - subject.radius, trial.rate);
        let own: Vec<&Event> = self.events.iter().filter(|e| e.side == side).collect();
        let known: Vec<bool> = (0..bodies.len())
            .map(|t| is_told && self.is_known(trial, &own, t))
            .collect();
        let mut add = |name: &str, curve: Vec<DVec3>| {
            let shown = curve.into_iter().zip(&known);
            let shown = shown.map(|(v, known)| if *known { v } else { DVec3::NAN });
            curves.insert(format!("{}{name}", side.letter()), shown.collect());
        };
        add(
            "GroundReactionForce",
            loads.iter().map(|load| load[0]).collect(),
        );
        for (
            name,
            JointKinetics {
                force,
                moment,
                power,
            },
        ) in JOINTS.iter().zip(joints)
        {
            add(&format!("{name}Force"), force);
            add(&format!("{name}Moment"), moment);
            add(&format!("{name}Power"), power);
        }
    }

    /// Whether it is known in a frame what acts on the foot: it is alone on a plate, or swings
    /// while no plate is under two feet. `own` are the events of its side.
    fn is_known(&self, trial: &Trial, own: &[&Event], frame: usize) -> bool {
        let time = trial.time(frame);
        let is_under =
            |c: &Contact, edge: f64| (c.on - edge..c.off + edge).contains(&(time - trial.first()));
        let mut alone = self
            .contacts
            .iter()
            .filter(|c| c.side == self.side && !c.of_two);
        if alone.any(|c| is_under(c, 0.0)) {
            return true;
        }
        let next = own.partition_point(|e| e.time_s <= time);
        let (before, after) = (next.checked_sub(1).map(|i| own[i]), own.get(next).copied());
        let is_off = before.is_none_or(|e| e.kind == EventKind::FootOff);
        let strikes = after.is_none_or(|e| e.kind == EventKind::FootStrike);
        let is_near = |e: &Event| (e.time_s - time).abs() < LONGEST_SWING;
        let is_swing = before.and(after).is_some() || before.or(after).is_some_and(is_near);
        let is_shared = |c: &Contact| c.of_two && is_under(c, EDGE);
        is_off && strikes && is_swing && !self.contacts.iter().any(is_shared)
    }
}
