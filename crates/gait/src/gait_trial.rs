//! A trial computed: curves, events, cycles and values.

use crate::angles::{ANGLES, Body, CENTERS, Direction, TURN, turn};
use crate::contradictions::contradictions;
use crate::curves::{Curves, is_angle, kinematics};
use crate::cycles::{Cycle, cycles, resampled};
use crate::deviations::deviations;
use crate::events::{Event, EventChoice, events};
use crate::findings::{Finding, Findings};
use crate::loads::Loads;
use crate::markers::MARKERS;
use crate::norm::{GVS, NineAngles};
use crate::parameters::{Given, GivenValues, Parameters};
use crate::plates::{Contact, contacts};
use crate::side::Side;
use crate::statics::{FlatFoot, StaticOffsets};
use crate::trial::Trial;
use crate::values::{CycleValues, values};
use crate::{Error, Result};
use glam::DVec3;
use ndarray::Array2;

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

/// What is computed of a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct GaitTrial {
    /// `Plug-in Gait`, or the words by which a model is told apart from it.
    pub model: &'static str,
    /// Where the person walks.
    pub direction: Direction,
    /// How far the pelvis turns from where it faces first, at most, degrees.
    pub turn_deg: f64,
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
        check_rate(trial)?;
        let markers = &trial.markers;
        let has_pelvis = |t: usize| markers.frame(t).pelvis().iter().all(|p| p.is_finite());
        if !(0..markers.frames()).any(has_pelvis) {
            let what = "has no frame with LASI, RASI and SACR (or LPSI and RPSI)";
            return Err(Error::unfit(what));
        }
        let mut findings = Findings::default();
        findings.of_markers(markers);
        findings.of_spans(trial);
        findings.of_gaps(trial);
        let parameters = parameters(trial, statics, settings, &mut findings);
        findings.of_parameters(&parameters, &settings.given);
        let subject = parameters.subject();
        let bodies: Vec<Body> = (0..markers.frames())
            .map(|t| Body::new(&markers.frame(t), &subject))
            .collect();
        let direction = Direction::of(markers);
        let curves = kinematics(&bodies, direction, settings.vicon_quirks);
        let mut gait = GaitTrial::with_curves(trial, settings, parameters, curves, findings);
        if subject.mass.is_finite() && !trial.plates.is_empty() {
            for side in Side::BOTH {
                let loads = Loads {
                    side,
                    contacts: &gait.contacts,
                    events: &gait.events,
                };
                loads.add_kinetics(&mut gait.curves, trial, &bodies, &subject);
            }
        }
        Ok(gait)
    }

    /// A trial whose curves another model computed: `trial` has markers near Plug-in Gait's, for
    /// events and distances. It has no forces and moments, and a finding says that it is not
    /// Plug-in Gait.
    ///
    /// # Errors
    /// [`Error::Unfit`]: the trial has no frames or no rate.
    pub fn of_other_model(
        trial: &Trial,
        curves: Curves,
        settings: &GaitSettings,
    ) -> Result<GaitTrial> {
        check_rate(trial)?;
        let mut findings = Findings::default();
        findings.of_other_model();
        let parameters = parameters(trial, None, settings, &mut findings);
        let mut gait = GaitTrial::with_curves(trial, settings, parameters, curves, findings);
        gait.model = "not Plug-in Gait";
        Ok(gait)
    }

    /// Contacts, events and cycles beside curves.
    fn with_curves(
        trial: &Trial,
        settings: &GaitSettings,
        parameters: Parameters,
        curves: Curves,
        mut findings: Findings,
    ) -> GaitTrial {
        let markers = &trial.markers;
        let direction = Direction::of(markers);
        let contacts = contacts(&trial.plates, markers, trial.rate);
        findings.of_plates(trial, &contacts);
        let alone: Vec<Contact> = contacts.iter().filter(|c| !c.of_two).copied().collect();
        let legs = parameters.subject().mean_leg();
        let times = (legs, trial.rate, trial.first());
        let events = events(settings.events, markers, &alone, &trial.file_events, times);
        findings.of_events(trial, &events, settings.events, direction);
        let turn_deg = turn(markers);
        findings.of_turn(turn_deg, direction);
        findings.0.extend(contradictions(trial));
        let last = trial.time(markers.frames() - 1);
        let with_values = |cycle: Cycle| {
            let values = values(&cycle, &events, markers, trial.rate, trial.first());
            (cycle, values)
        };
        let cycles = cycles(&events, trial.first(), last).into_iter();
        GaitTrial {
            model: "Plug-in Gait",
            cycles: cycles.map(with_values).collect(),
            direction,
            turn_deg,
            parameters,
            curves,
            contacts,
            events,
            findings: findings.0,
        }
    }

    /// Whether the person turns so much that what is told in the laboratory's axes changes with it.
    pub fn turns(&self) -> bool {
        self.turn_deg > TURN
    }

    /// A curve of a cycle's side in that cycle, 101 points; `name` is without the side
    /// (`KneeAngles`). `None` where there is no such curve.
    pub fn in_cycle(&self, trial: &Trial, cycle: &Cycle, name: &str) -> Option<Vec<DVec3>> {
        let curve = self.curves.get(&format!("{}{name}", cycle.side.letter()))?;
        let [from, to] = [cycle.start_s, cycle.end_s].map(|t| trial.place(t));
        Some(resampled(curve, from, to, is_angle(name)))
    }

    /// The nine angles of [`Norm`](crate::Norm) in a cycle.
    pub fn nine_angles(&self, trial: &Trial, cycle: &Cycle) -> NineAngles {
        GVS.map(|(_, curve, axis)| {
            let points = self.in_cycle(trial, cycle, curve).unwrap_or_default();
            points.iter().map(|v| v[axis]).collect()
        })
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
        let sides = deviations(&trial.markers, sd.view(), &subject, lab);
        let names = || ANGLES.into_iter().chain(CENTERS).enumerate();
        let of = |side: Side, i: usize| sides[side as usize].iter().map(|v| v[i]).collect();
        let all = Side::BOTH.into_iter().flat_map(|side| {
            names().map(move |(i, name)| (side, i, format!("{}{name}", side.letter())))
        });
        let known = all.filter(|(_, _, name)| self.curves.contains_key(name));
        Ok(known.map(|(side, i, name)| (name, of(side, i))).collect())
    }
}

fn check_rate(trial: &Trial) -> Result<()> {
    if trial.rate > 0.0 && trial.rate.is_finite() && trial.markers.frames() > 0 {
        return Ok(());
    }
    Err(Error::unfit("has no frames, or no rate"))
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
