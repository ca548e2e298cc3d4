//! What is estimated, missing or unsure in a trial.

use crate::angles::{Direction, TURN};
use crate::events::{Event, EventChoice, EventKind, of_file};
use crate::markers::{Frame, MARKERS, Markers};
use crate::parameters::{GivenValues, Parameters, Source, mean_length, plausible_range};
use crate::plates::Contact;
use crate::side::Side;
use crate::statics::{OFFSETS, StaticOffsets};
use crate::trial::Trial;
use serde::Serialize;

/// A static trial whose shank is longer or shorter by more is of another person, mm.
const OTHER_SHANK: f64 = 15.0;
/// A filled marker that is less sure in a frame moves angles by degrees, mm.
const UNSURE: f64 = 6.0;
/// A marker that is not seen for longer at an end is told, seconds.
const LATE: f64 = 0.1;
/// A heel that goes further makes steps, mm.
const STEP: f64 = 300.0;
/// Static offsets further from those stored do not fit, radians.
const OTHER_OFFSET: f64 = 0.035;

/// Something to know before the values are used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// `marker_missing`, `marker_at_zero`, `marker_late`, `gap_left`, `gap_unsure`, `estimated`,
    /// `default`, `parameter_odd`, `parameter_unused`, `no_mass`, `static_differs`, `turns`,
    /// `other_model`, `two_feet`, `plate_unread`, `no_events`, `event_alone`; what contradicts
    /// itself: `markers_exchanged`, `parameters_differ`, `no_foot`, `wrong_foot`, `backwards` or
    /// `plate`; of who reads and fills: `marker_doubtful`, `no_c3d`.
    pub kind: &'static str,
    /// The markers or parameters it is about.
    pub points: Vec<String>,
    /// What it is, and what it costs.
    pub what: String,
}

/// Adds findings.
#[derive(Debug, Default)]
pub(crate) struct Findings(pub Vec<Finding>);

impl Findings {
    fn add(&mut self, kind: &'static str, points: Vec<String>, what: String) {
        self.0.push(Finding { kind, points, what });
    }

    /// What the markers lack.
    pub(crate) fn of_markers(&mut self, markers: &Markers) {
        let lower = MARKERS[..17]
            .iter()
            .filter(|m| !["SACR", "LPSI", "RPSI"].contains(m));
        let is_missing = |m: &str| markers.get(m).is_none_or(|t| t.iter().all(|p| p.is_nan()));
        let mut missing: Vec<String> = lower
            .filter(|m| is_missing(m))
            .map(|m| m.to_string())
            .collect();
        if is_missing("SACR") && (is_missing("LPSI") || is_missing("RPSI")) {
            missing.push("SACR".into());
        }
        if !missing.is_empty() {
            let what = format!("{} missing: what needs it is empty", joined(&missing));
            self.add("marker_missing", missing, what);
        }
        if !markers.at_zero.is_empty() {
            let points: Vec<String> = markers.at_zero.iter().map(|m| m.to_string()).collect();
            let what = format!(
                "{} at exactly 0 0 0 in some frames, taken for missing",
                joined(&points)
            );
            self.add("marker_at_zero", points, what);
        }
    }

    /// Markers of the legs that are not seen at an end of the trial, while others are.
    pub(crate) fn of_spans(&mut self, trial: &Trial) {
        let span = |name: &&str| {
            let track = trial.markers.get(name)?;
            let first = track.iter().position(|p| p.is_finite())?;
            Some([first, track.iter().rposition(|p| p.is_finite())?])
        };
        let spans = MARKERS[..17]
            .iter()
            .filter_map(|name| Some((*name, span(name)?)));
        let spans: Vec<(&str, [usize; 2])> = spans.collect();
        let first = spans.iter().map(|(_, [a, _])| *a).min().unwrap_or_default();
        let last = spans.iter().map(|(_, [_, b])| *b).max().unwrap_or_default();
        let lacks = |[a, b]: [usize; 2]| (a - first).max(last - b) as f64 / trial.rate;
        let late = spans.iter().filter(|(_, span)| lacks(*span) > LATE);
        let late: Vec<String> = late.map(|(name, _)| name.to_string()).collect();
        if !late.is_empty() {
            let most = spans
                .iter()
                .map(|(_, span)| lacks(*span))
                .fold(0.0, f64::max);
            let what = format!(
                "{} not seen at the beginning or the end, for {most:.2} s at most: what needs it \
                 is empty there",
                joined(&late)
            );
            self.add("marker_late", late, what);
        }
    }

    /// Gaps that were left, or filled by positions that are not sure.
    pub(crate) fn of_gaps(&mut self, trial: &Trial) {
        for gap in &trial.gaps {
            let [from, to] = [gap.frames[0], gap.frames[1] - 1].map(|t| trial.time(t));
            let place = format!("{} is missing from {from:.2} to {to:.2} s", gap.marker);
            let points = vec![gap.marker.to_string()];
            match gap.sd_mm {
                None => {
                    let what = format!("{place}: not filled, what needs it is empty");
                    self.add("gap_left", points, what);
                }
                Some(_) if gap.largest_mm > UNSURE => {
                    let what = format!("{place}: filled, +- {:.0} mm", gap.largest_mm);
                    self.add("gap_unsure", points, what);
                }
                Some(_) => {}
            }
        }
    }

    /// Which parameters nobody gave.
    pub(crate) fn of_parameters(&mut self, parameters: &Parameters, given: &GivenValues) {
        for (name, parameter) in &parameters.0 {
            let range = plausible_range(name).unwrap_or([f64::MIN, f64::MAX]);
            if !(range[0]..=range[1]).contains(&parameter.value) {
                let what = format!(
                    "{name} is {:.4} {}: nobody has that, perhaps it is in another unit",
                    parameter.value, parameter.unit
                );
                self.add("parameter_odd", vec![name.clone()], what);
            }
            let own = given
                .get(name)
                .filter(|own| (own - parameter.value).abs() > 1e-6);
            if let Some(own) = own.filter(|_| parameter.source == Source::Trial) {
                let stored = (1e4 * parameter.value).round() / 1e4;
                let what = format!("{name} {own} is not used: the trial stores {stored}");
                self.add("parameter_unused", vec![name.clone()], what);
            }
        }
        let of = |source: Source, words: &[&str]| -> Vec<String> {
            let own = parameters.of_source(source);
            own.filter(|name| words.iter().any(|w| name.contains(w)))
                .map(String::from)
                .collect()
        };
        let estimated = of(Source::Estimate, &["LegLength", "KneeWidth", "AnkleWidth"]);
        if !estimated.is_empty() {
            let sd = |name: &String| {
                let sd = parameters
                    .0
                    .get(name)
                    .and_then(|p| p.sd)
                    .unwrap_or_default();
                format!("{name} (+- {sd:.0} mm)")
            };
            let what = format!(
                "{} estimated from markers: hip and knee abduction +- 2 degrees, at worst 4, other \
                 angles below .8",
                joined(&estimated.iter().map(sd).collect::<Vec<_>>())
            );
            self.add("estimated", estimated, what);
        }
        let defaults = of(Source::Default, &["MarkerDiameter"]);
        if !defaults.is_empty() {
            let what = "MarkerDiameter is not said: 14 mm is taken; 16 would move centers by 1 mm, \
                        angles by .3 degrees";
            self.add("default", defaults, what.into());
        }
        let offsets = of(Source::Default, &OFFSETS);
        if !offsets.is_empty() {
            let what = "no static offsets of the feet, stored or measured: ankle angles and foot \
                        progression are those of the markers' lines";
            self.add("default", offsets, what.into());
        }
        if parameters.value("Bodymass").is_nan() {
            let what = "no Bodymass: no forces, moments and powers, which are per kilogram";
            self.add("no_mass", vec!["Bodymass".into()], what.into());
        }
    }

    /// What does not fit between a trial and its static trial, whose offsets are `measured`.
    pub(crate) fn of_static(&mut self, trial: &Trial, other: &Trial, measured: &StaticOffsets) {
        let names = ["LegLength", "KneeWidth", "AnkleWidth"];
        let names = Side::BOTH.map(|side| names.map(|name| format!("{}{name}", side.letter())));
        let differs = |name: &String| {
            let pair = trial.given.get(name).zip(other.given.get(name));
            pair.is_some_and(|(a, b)| (a - b).abs() > 1.0)
        };
        let mut offsets = Vec::new();
        let mut unlike: Vec<String> = names.into_iter().flatten().filter(differs).collect();
        if !Direction::of(&other.markers).standing {
            let what = "the static trial walks: offsets of feet and head are those of its mean";
            self.add("static_differs", Vec::new(), what.into());
        }
        for side in Side::BOTH {
            let shank = |markers: &Markers| {
                let length = |frame: &Frame| {
                    let [_, kne, _, ank, ..] = frame.leg(side);
                    kne.distance(ank)
                };
                mean_length(markers, &length).map(|(mean, _)| mean)
            };
            let pair = shank(&trial.markers).zip(shank(&other.markers));
            if pair.is_some_and(|(a, b)| (a - b).abs() > OTHER_SHANK) {
                unlike.push(format!("the distance of {0}KNE and {0}ANK", side.letter()));
            }
            for (i, name) in OFFSETS.iter().enumerate() {
                let name = format!("{}{name}", side.letter());
                let stored = trial.given.get(&name).filter(|v| v.abs() <= 1.0);
                let own = measured.feet[side as usize][i];
                if stored.is_some_and(|v| (v - own).abs() > OTHER_OFFSET) {
                    offsets.push(name);
                }
            }
        }
        if unlike.is_empty() && !offsets.is_empty() {
            let what = format!(
                "{} other in the static trial than what the trial stores, which is used",
                joined(&offsets)
            );
            self.add("static_differs", offsets, what);
            return;
        }
        unlike.extend(offsets);
        if !unlike.is_empty() {
            let what = format!(
                "the static trial does not fit, perhaps it is of another person or day: {} in it",
                if unlike.len() == 1 {
                    format!("{} differs", unlike[0])
                } else {
                    format!("{} differ", unlike.join(", "))
                }
            );
            self.add("static_differs", unlike, what);
        }
    }

    /// Plates that tell nothing.
    pub(crate) fn of_plates(&mut self, trial: &Trial, contacts: &[Contact]) {
        let unread = trial.plates.iter().enumerate().filter(|(_, p)| p.is_none());
        for (i, _) in unread {
            let what = format!(
                "plate {} is of a type that is not read, or lacks channels or corners",
                i + 1
            );
            self.add("plate_unread", Vec::new(), what);
        }
        for contact in contacts.iter().filter(|c| c.of_two) {
            let what = format!(
                "plate {} is loaded for {:.2} s from {:.2} s on, by two feet: it tells nothing",
                contact.plate,
                contact.off - contact.on,
                trial.first() + contact.on
            );
            self.add("two_feet", Vec::new(), what);
        }
    }

    /// Angles of another model.
    pub(crate) fn of_other_model(&mut self) {
        let what = "not Plug-in Gait: the trial has not its markers, angles are those between the \
                    bones that solve finds, and there are no forces and moments";
        self.add("other_model", Vec::new(), what.into());
    }

    /// A walk that turns.
    pub(crate) fn of_turn(&mut self, degrees: f64, direction: Direction) {
        if degrees > TURN && !direction.standing {
            let what = format!(
                "the person turns by {degrees:.0} degrees: angles of pelvis and feet, step width \
                 and ground reaction are in the laboratory's axes; scores and norms leave the \
                 trial out"
            );
            self.add("turns", Vec::new(), what);
        }
    }

    /// No events, and the file's own that none of ours is near to.
    pub(crate) fn of_events(
        &mut self,
        trial: &Trial,
        events: &[Event],
        choice: EventChoice,
        direction: Direction,
    ) {
        if events.is_empty() && choice == EventChoice::File {
            let what = "the file stores no strikes and offs of feet, so there are no cycles";
            self.add("no_events", Vec::new(), what.into());
        } else if events.is_empty() && (!direction.standing || feet_move(&trial.markers)) {
            let what = "no strikes and offs are found, so there are no cycles: by plates no foot \
                        is alone on one; by markers feet or pelvis lack markers, the rate is \
                        below 40 Hz, or the person walks in place";
            self.add("no_events", Vec::new(), what.into());
        }
        for own in of_file(&trial.file_events) {
            let is_it = |e: &&Event| {
                e.side == own.side && e.kind == own.kind && e.file_time_s == Some(own.time_s)
            };
            if !events.iter().any(|e| is_it(&e)) {
                let what = format!(
                    "the file has a {} {} at {:.3} s, and there is none within 60 ms",
                    format!("{:?}", own.side).to_lowercase(),
                    if own.kind == EventKind::FootStrike {
                        "strike"
                    } else {
                        "off"
                    },
                    own.time_s
                );
                self.add("event_alone", Vec::new(), what);
            }
        }
    }
}

/// Whether a heel goes to and fro, as on a treadmill.
fn feet_move(markers: &Markers) -> bool {
    let goes = |name: &str| {
        let track = markers.get(name).unwrap_or_default().iter();
        let seen: Vec<_> = track
            .filter(|p| p.is_finite())
            .map(|p| p.truncate())
            .collect();
        let first = seen.first().copied().unwrap_or_default();
        seen.iter().any(|p| p.distance(first) > STEP)
    };
    goes("LHEE") || goes("RHEE")
}

/// `A is`, or `A, B are`.
fn joined(names: &[String]) -> String {
    format!(
        "{} {}",
        names.join(", "),
        if names.len() == 1 { "is" } else { "are" }
    )
}
