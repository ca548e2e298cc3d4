//! A trial computed: curves, events, cycles and values.

use crate::angles::{ANGLES, Body, Direction};
use crate::cycles::{Cycle, cycles, resampled};
use crate::deviations::deviations;
use crate::events::{Event, EventChoice, EventKind, events};
use crate::findings::{Finding, Findings};
use crate::kinetics::{self, JOINTS, JointKinetics};
use crate::markers::{Frame, MARKERS};
use crate::parameters::{Given, GivenValues, Parameters, Subject, mean_length};
use crate::plates::{Contact, contacts, on_foot};
use crate::side::Side;
use crate::statics::{FlatFoot, StaticOffsets};
use crate::trial::Trial;
use crate::values::{CycleValues, values};
use crate::{Error, Result};
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;

/// How a trial is computed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GaitSettings {
    /// The user's values of the subject's parameters.
    pub given: GivenValues,
    /// How the feet lay in the static trial.
    pub flat_foot: FlatFoot,
    /// Whether the left foot's progression along +x is written as Vicon does, which is no angle of
    /// the foot.
    pub vicon_quirks: bool,
    /// Which events are taken.
    pub events: EventChoice,
}

/// Curves by Plug-in Gait's names, a value of three numbers a frame; NaN where it is not known.
///
/// `LKneeAngles` and so on are degrees in [-180, 180). `LHJC`, `LKJC` and `LAJC` are the centers of
/// hip, knee and ankle, millimeters in the laboratory's axes with z up; `LGroundReactionForce` is
/// N/kg in these axes. `LKneeForce` is N/kg, `LKneeMoment` N mm/kg, `LKneePower` W/kg in the third
/// number.
pub type Curves = BTreeMap<String, Vec<DVec3>>;

/// What is computed of a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct GaitTrial {
    /// Where the person walks.
    pub direction: Direction,
    /// The subject's parameters with their sources.
    pub parameters: Parameters,
    /// The curves.
    pub curves: Curves,
    /// The contacts of feet with plates.
    pub contacts: Vec<Contact>,
    /// The events of both feet in time.
    pub events: Vec<Event>,
    /// The cycles of both sides, each with its values.
    pub cycles: Vec<(Cycle, CycleValues)>,
    /// What is estimated, missing or unsure.
    pub findings: Vec<Finding>,
}

/// The centers, as [`Curves`] name them.
pub(crate) const CENTERS: [&str; 3] = ["HJC", "KJC", "AJC"];

/// Whether a curve is of angles, which go around.
pub fn is_angle(curve: &str) -> bool {
    curve.ends_with("Angles")
}

impl GaitTrial {
    /// Computes a trial; `statics` is the person standing, which tells how the feet lie.
    ///
    /// # Errors
    /// [`Error::Unfit`]: the trial has no frames, no rate, or not the markers of the pelvis.
    pub fn new(
        trial: &Trial,
        statics: Option<&Trial>,
        settings: &GaitSettings,
    ) -> Result<GaitTrial> {
        let markers = &trial.markers;
        let has_pelvis = |t: usize| markers.frame(t).pelvis().iter().all(|p| p.is_finite());
        if !(trial.rate > 0.0 && trial.rate.is_finite() && (0..markers.frames()).any(has_pelvis)) {
            let what = "has no frame with LASI, RASI and SACR (or LPSI and RPSI), or no rate";
            return Err(Error::unfit(what));
        }
        let mut findings = Findings::default();
        findings.of_markers(markers);
        let parameters = parameters(trial, statics, settings, &mut findings);
        findings.of_parameters(&parameters);
        let subject = parameters.subject();
        let bodies: Vec<Body> = (0..markers.frames())
            .map(|t| Body::new(&markers.frame(t), &subject))
            .collect();
        let direction = Direction::of(markers);
        let mut curves = kinematics(&bodies, direction, settings.vicon_quirks);
        let contacts = contacts(&trial.plates, markers, trial.rate);
        findings.of_plates(trial, &contacts);
        let alone: Vec<Contact> = contacts.iter().filter(|c| !c.of_two).copied().collect();
        let times = (subject.mean_leg(), trial.rate, trial.first());
        let events = events(settings.events, markers, &alone, &trial.file_events, times);
        findings.of_events(trial, &events);
        if subject.mass.is_finite() && !trial.plates.is_empty() {
            for side in Side::BOTH {
                let loads = Loads {
                    side,
                    contacts: &contacts,
                    events: &events,
                };
                loads.add_kinetics(&mut curves, trial, &bodies, &subject);
            }
        }
        let last = trial.time(markers.frames() - 1);
        let cycles = cycles(&events, trial.first(), last)
            .into_iter()
            .map(|cycle| {
                let values = values(&cycle, &events, markers, trial.rate, trial.first());
                (cycle, values)
            });
        Ok(GaitTrial {
            cycles: cycles.collect(),
            direction,
            parameters,
            curves,
            contacts,
            events,
            findings: findings.0,
        })
    }

    /// A curve of a cycle's side in that cycle, 101 points; `name` is without the side
    /// (`KneeAngles`). `None` where there is no such curve.
    pub fn in_cycle(&self, trial: &Trial, cycle: &Cycle, name: &str) -> Option<Vec<DVec3>> {
        let curve = self.curves.get(&format!("{}{name}", cycle.side.letter()))?;
        let [from, to] = [cycle.start_s, cycle.end_s].map(|t| trial.place(t));
        Some(resampled(curve, from, to, is_angle(name)))
    }

    /// The deviations of angles (degrees) and centers (mm) by the curves' names, where markers have
    /// one: `sd` is that of each marker of [`MARKERS`] by frames, (frames, 35), mm along each axis,
    /// and 0 for a marker that was seen. In frames without any it is 0.
    ///
    /// # Errors
    /// [`Error::Unfit`]: `sd` has another shape.
    pub fn deviations(&self, trial: &Trial, sd: &Array2<f64>) -> Result<Curves> {
        if sd.dim() != (trial.markers.frames(), MARKERS.len()) {
            return Err(Error::unfit(
                "the deviations are not one a frame and a marker",
            ));
        }
        let subject = self.parameters.subject();
        let lab = self.direction.axes();
        let sides = deviations(&trial.markers, sd.view(), &subject, lab, trial.rate);
        let names = || ANGLES.into_iter().chain(CENTERS).enumerate();
        let of = |side: Side, i: usize| sides[side as usize].iter().map(|v| v[i]).collect();
        let all = Side::BOTH.into_iter().flat_map(|side| {
            names().map(move |(i, name)| (side, i, format!("{}{name}", side.letter())))
        });
        let known = all.filter(|(_, _, name)| self.curves.contains_key(name));
        Ok(known.map(|(side, i, name)| (name, of(side, i))).collect())
    }
}

/// The parameters, those of the static trial's markers too.
fn parameters(
    trial: &Trial,
    statics: Option<&Trial>,
    settings: &GaitSettings,
    findings: &mut Findings,
) -> Parameters {
    let mut parameters = Parameters::find(Given {
        trial: &trial.given,
        options: &settings.given,
        statics: statics.map(|s| &s.given),
        markers: statics.map_or(&trial.markers, |s| &s.markers),
    });
    if let Some(other) = statics {
        let subject = parameters.subject();
        let flat = settings.flat_foot;
        let measured = StaticOffsets::measure(&other.markers, &subject, flat, &other.given);
        measured.fill(&mut parameters);
        findings.of_static(trial, other, &measured);
    }
    parameters
}

/// Angles and centers; the upper body's where it has any.
fn kinematics(bodies: &[Body], direction: Direction, quirks: bool) -> Curves {
    let (mut curves, lab) = (Curves::new(), direction.axes());
    for side in Side::BOTH {
        let all: Vec<_> = bodies.iter().map(|body| body.angles(side, lab)).collect();
        for (i, name) in ANGLES.into_iter().enumerate() {
            let mut curve: Vec<DVec3> = all.iter().map(|angles| angles[i]).collect();
            if quirks
                && name == "FootProgressAngles"
                && side == Side::Left
                && direction.name() == "+x"
            {
                curve
                    .iter_mut()
                    .for_each(|v| *v = crate::angles::with_quirk(*v));
            }
            if i < 5 || curve.iter().any(|v| v.is_finite()) {
                curves.insert(format!("{}{name}", side.letter()), curve);
            }
        }
        for (i, name) in CENTERS.into_iter().enumerate() {
            let center = |body: &Body| {
                let leg = &body.legs[side as usize];
                [leg.hip, leg.knee, leg.ankle][i]
            };
            let curve = bodies.iter().map(center).collect();
            curves.insert(format!("{}{name}", side.letter()), curve);
        }
    }
    curves
}

/// A foot that is off at an end of the trial is so for at most this, seconds.
const LONGEST_SWING: f64 = 0.5;
/// A plate's load reaches so far beyond its contact, seconds: into the mean of a frame's samples.
const EDGE: f64 = 0.04;

/// What tells the loads of a side's foot.
struct Loads<'a> {
    side: Side,
    contacts: &'a [Contact],
    events: &'a [Event],
}

impl Loads<'_> {
    /// Adds the forces, moments and powers of the side, empty where its foot is on the floor and
    /// what acts on it is not known, and in a trial in which it is on no plate.
    fn add_kinetics(&self, curves: &mut Curves, trial: &Trial, bodies: &[Body], subject: &Subject) {
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
        let known: Vec<bool> = (0..bodies.len())
            .map(|t| is_told && self.is_known(trial, t))
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
    /// while no plate is under two feet.
    fn is_known(&self, trial: &Trial, frame: usize) -> bool {
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
        let mut own = self.events.iter().filter(|e| e.side == self.side);
        let after = own.clone().find(|e| e.time_s > time);
        let before = own.rfind(|e| e.time_s <= time);
        let is_off = before.is_none_or(|e| e.kind == EventKind::FootOff);
        let strikes = after.is_none_or(|e| e.kind == EventKind::FootStrike);
        let is_near = |e: &Event| (e.time_s - time).abs() < LONGEST_SWING;
        let is_swing = before.and(after).is_some() || before.or(after).is_some_and(is_near);
        let is_shared = |c: &Contact| c.of_two && is_under(c, EDGE);
        is_off && strikes && is_swing && !self.contacts.iter().any(is_shared)
    }
}
