//! What of a trial contradicts the rest of it: markers exchanged, parameters of another person,
//! plates whose forces are no foot's, or another's than the file says.

use crate::angles::Direction;
use crate::events::{EventKind, of_file};
use crate::findings::Finding;
use crate::markers::{Frame, Markers};
use crate::parameters::{estimated_leg, mean_length};
use crate::plates::{Contact, loads};
use crate::side::Side;
use crate::trial::Trial;

/// A stored leg length that is further from the markers' is of another person: five deviations of
/// the estimate, mm.
const OTHER_LEG: f64 = 65.0;
/// A file's event so near to a contact's end is of that contact, seconds.
const SAME: f64 = 0.06;

/// What in a trial contradicts itself; nothing of a sound one. The kinds are `markers_exchanged`,
/// `parameters_differ`, `no_foot`, `wrong_foot`, `backwards` and `plate`.
pub fn contradictions(trial: &Trial) -> Vec<Finding> {
    let mut found = Vec::new();
    for side in Side::BOTH {
        found.extend(exchanged(&trial.markers, side));
        found.extend(other_leg(trial, side));
    }
    found.extend(sides(&trial.markers));
    found.extend(backwards(&trial.markers));
    found.extend(plates(trial));
    for (contact, away) in loads(&trial.plates, &trial.markers, trial.rate) {
        found.extend(wrong_foot(trial, &contact, away));
    }
    found
}

/// A wand that is further from the hip, or from the knee, than the joint below it.
fn exchanged(markers: &Markers, side: Side) -> Vec<Finding> {
    let mean = |of: &dyn Fn([glam::DVec3; 4]) -> f64| {
        let length = |frame: &Frame| {
            let [thi, kne, tib, ank, ..] = frame.leg(side);
            of([thi, kne, tib, ank])
        };
        mean_length(markers, &length).map_or(f64::NAN, |(mean, _)| mean)
    };
    let of = |wand: &str, joint: &str, differs: f64| {
        let points = [wand, joint].map(|name| format!("{}{name}", side.letter()));
        let what = format!(
            "{} is further up the leg than {}: they are exchanged",
            points[1], points[0]
        );
        let kind = "markers_exchanged";
        let points = points.to_vec();
        (differs > 0.0).then_some(Finding { kind, points, what })
    };
    let thigh = mean(&|[thi, kne, _, ank]| kne.distance(ank) - thi.distance(ank));
    let shank = mean(&|[_, kne, tib, ank]| kne.distance(tib) - kne.distance(ank));
    let both = [of("THI", "KNE", thigh), of("TIB", "ANK", shank)];
    both.into_iter().flatten().collect()
}

/// Knees that are on the other side of the pelvis, and heels that are nearer to the other ankle.
fn sides(markers: &Markers) -> Vec<Finding> {
    let mean = |of: &dyn Fn(&Frame) -> f64| mean_length(markers, of).map_or(f64::NAN, |(m, _)| m);
    let pair = |place: usize, frame: &Frame| Side::BOTH.map(|side| frame.leg(side)[place]);
    let across = |frame: &Frame| {
        let ([left, right, _], [l, r]) = (frame.pelvis(), pair(1, frame));
        (l - r).dot((left - right).normalize())
    };
    let heel = |frame: &Frame| {
        let ([al, ar], [l, r]) = (pair(3, frame), pair(4, frame));
        l.distance(ar) + r.distance(al) - l.distance(al) - r.distance(ar)
    };
    let of = |names: [&str; 2], differs: bool, what: &str| {
        let points = names.map(String::from).to_vec();
        let (kind, what) = ("markers_exchanged", what.to_string());
        differs.then_some(Finding { kind, points, what })
    };
    let both = [
        of(
            ["LKNE", "RKNE"],
            mean(&across) < 0.0,
            "LKNE is to the right of RKNE: the sides of the legs, or LASI and RASI, are exchanged",
        ),
        of(
            ["LHEE", "RHEE"],
            mean(&heel) < 0.0,
            "LHEE is nearer to RANK, and RHEE to LANK: the heels are exchanged",
        ),
    ];
    both.into_iter().flatten().collect()
}

/// A pelvis that faces against the walk, and toes behind their heels.
fn backwards(markers: &Markers) -> Vec<Finding> {
    let direction = Direction::of(markers);
    let mean = |of: &dyn Fn(&Frame) -> f64| mean_length(markers, of).map_or(f64::NAN, |(m, _)| m);
    let facing = |frame: &Frame| {
        let [left, right, sacrum] = frame.pelvis();
        ((left + right) / 2.0 - sacrum)
            .normalize()
            .dot(direction.forward)
    };
    let finding = |kind, points, what: String| Finding { kind, points, what };
    let mut found = Vec::new();
    if !direction.standing && mean(&facing) < 0.0 {
        let what = "the pelvis faces against the walk: the person walks backwards, or markers of \
                    the pelvis are exchanged";
        found.push(finding("backwards", Vec::new(), what.into()));
    }
    for side in Side::BOTH {
        let ahead = |frame: &Frame| {
            let ([left, right, sacrum], [.., hee, toe]) = (frame.pelvis(), frame.leg(side));
            (toe - hee).dot((left + right) / 2.0 - sacrum)
        };
        if mean(&ahead) < 0.0 {
            let points = ["HEE", "TOE"].map(|name| format!("{}{name}", side.letter()));
            let what = format!("{} is behind {}: they are exchanged", points[1], points[0]);
            found.push(finding("markers_exchanged", points.to_vec(), what));
        }
    }
    found
}

/// Plates whose forces cannot be those of feet.
fn plates(trial: &Trial) -> Vec<Finding> {
    let stands = Direction::of(&trial.markers).standing;
    let plates = trial.plates.iter().enumerate();
    let found = plates.filter_map(|(i, plate)| {
        let what = plate.as_ref()?.fault(stands)?;
        let what = format!("plate {}: {what}", i + 1);
        Some(Finding {
            kind: "plate",
            points: Vec::new(),
            what,
        })
    });
    found.collect()
}

fn other_leg(trial: &Trial, side: Side) -> Option<Finding> {
    let name = format!("{}LegLength", side.letter());
    let stored = trial.given.get(&name)?;
    let measured = estimated_leg(&trial.markers, side)?;
    let differs = (stored - measured).abs() > OTHER_LEG;
    let what = format!(
        "{name} is stored as {stored:.0} mm, the markers say {measured:.0} +- 13: perhaps it is of \
         another person"
    );
    let points = vec![name];
    differs.then_some(Finding {
        kind: "parameters_differ",
        points,
        what,
    })
}

/// A load that is under no foot, or which the file's own events give to the other foot.
fn wrong_foot(trial: &Trial, contact: &Contact, away: Option<f64>) -> Option<Finding> {
    let [on, off] = [contact.on, contact.off].map(|t| trial.first() + t);
    let place = format!(
        "plate {} is loaded from {on:.2} to {off:.2} s",
        contact.plate
    );
    let finding = |kind, what| {
        Some(Finding {
            kind,
            points: Vec::new(),
            what,
        })
    };
    if let Some(away) = away {
        let what = format!(
            "{place}, {:.0} cm from the nearest foot: its forces are of something else, or its \
             corners are wrong",
            away / 10.0
        );
        return finding("no_foot", what);
    }
    let events = of_file(&trial.file_events);
    let says = |side: Side| {
        let own = events.iter().filter(|e| e.side == side);
        let mut own = own.map(|e| match e.kind {
            EventKind::FootStrike => (e.time_s - on).abs(),
            EventKind::FootOff => (e.time_s - off).abs(),
        });
        own.any(|apart| apart < SAME)
    };
    let other = contact.side.other();
    if contact.of_two || says(contact.side) || !says(other) {
        return None;
    }
    let [near, said] = [contact.side, other].map(|side| ["left", "right"][side as usize]);
    let what = format!("{place} under the {near} foot, and the file's events say the {said}");
    finding("wrong_foot", what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::markers::MARKERS;
    use crate::parameters::testdata;

    /// Somebody who stands, with some names exchanged.
    fn trial(names: &[(&str, &str)]) -> Trial {
        let name = |own: &'static str| {
            let pair = names.iter().find(|(a, b)| *a == own || *b == own);
            pair.map_or(own, |(a, b)| if *a == own { b } else { a })
        };
        let tracks = MARKERS
            .into_iter()
            .map(name)
            .zip(testdata::standing().0.map(|p| vec![p; 4]));
        Trial::new(Markers::new(tracks).unwrap(), 100.0)
    }

    #[test]
    fn exchanged_markers_and_others_legs_are_told() {
        let mut sound = trial(&[]);
        assert_eq!(contradictions(&sound), []);
        let leg = estimated_leg(&sound.markers, Side::Left).unwrap();
        sound.given.set("LLegLength", leg + 30.0);
        assert_eq!(contradictions(&sound), []);
        sound.given.set("LLegLength", leg + 80.0);
        assert_eq!(contradictions(&sound)[0].kind, "parameters_differ");
        let pairs = [
            ("LTHI", "LKNE"),
            ("RTIB", "RANK"),
            ("LHEE", "RHEE"),
            ("RHEE", "RTOE"),
            ("LASI", "RASI"),
        ];
        for pair in pairs {
            let found = contradictions(&trial(&[pair]));
            let of_pair = found.iter().any(|f| f.points.contains(&pair.0.to_string()));
            assert!(
                of_pair || pair.0 == "LASI" && !found.is_empty(),
                "{pair:?} {found:?}"
            );
        }
    }
}
