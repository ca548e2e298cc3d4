//! The events of feet: by plates, by markers, or as the file has them, each with its source.

use crate::io::FileEvent;
use crate::marker_events;
use crate::markers::Markers;
use crate::plates::Contact;
use crate::side::Side;
use serde::Serialize;

/// What a foot does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The foot meets the floor.
    FootStrike,
    /// The foot leaves the floor.
    FootOff,
}

/// What an event is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EventSource {
    /// A force plate with one foot on it.
    Plate,
    /// The markers alone.
    Markers,
    /// The file's own events.
    File,
}

/// Which events are taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EventChoice {
    /// By plates where a single foot is on one, else by markers.
    #[default]
    Auto,
    /// By plates alone.
    Plates,
    /// By markers alone.
    Markers,
    /// The file's own.
    File,
}

/// An event of a foot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Event {
    /// Seconds; frame 1 is at 0.
    pub time_s: f64,
    /// Whose foot.
    pub side: Side,
    /// What it does.
    pub kind: EventKind,
    /// What says so.
    pub source: EventSource,
    /// The standard deviation of the time, milliseconds.
    pub sd_ms: f64,
    /// The plate, counted from 1.
    pub plate: Option<usize>,
    /// The file's own event of this kind within 60 ms, seconds.
    pub file_time_s: Option<f64>,
}

/// An event of the file is that of ours within so many seconds.
const SAME: f64 = 0.06;
/// Events by markers so near to a contact with a plate are its own, seconds.
const NEAR: f64 = 0.12;
/// The sd of events by plates, and of those of files, whose makers differ among themselves, ms.
const PLATE_SD: f64 = 2.0;
const FILE_SD: f64 = 15.0;
/// The sd of strikes and offs by markers against plates: walking straight, and turning, ms.
const MARKER_SD: [[f64; 2]; 2] = [[6.2, 7.9], [8.0, 14.0]];
/// A pelvis that turns so much within a second walks a turn, radians.
const TURN: f64 = 0.5;

/// The events of both feet in time. `legs` are the legs' mean length, `first` the time of the
/// first frame, `contacts` of single feet.
pub(crate) fn events(
    choice: EventChoice,
    markers: &Markers,
    contacts: &[Contact],
    file: &[FileEvent],
    (legs, rate, first): (f64, f64, f64),
) -> Vec<Event> {
    let mut all = match choice {
        EventChoice::File => of_file(file),
        EventChoice::Plates => of_plates(contacts, first),
        EventChoice::Markers => of_markers(markers, legs, rate, first),
        EventChoice::Auto => {
            let is_own = |e: &Event, c: &Contact| {
                let span = first + c.on - NEAR..first + c.off + NEAR;
                e.side == c.side && span.contains(&e.time_s)
            };
            let mut all = of_markers(markers, legs, rate, first);
            all.retain(|e| !contacts.iter().any(|c| is_own(e, c)));
            all.extend(of_plates(contacts, first));
            all
        }
    };
    let file = of_file(file);
    for event in &mut all {
        let alike = file
            .iter()
            .filter(|f| f.side == event.side && f.kind == event.kind);
        let apart = |f: &Event| (f.time_s - event.time_s).abs();
        let nearest = alike.min_by(|a, b| apart(a).total_cmp(&apart(b)));
        event.file_time_s = nearest.filter(|f| apart(f) <= SAME).map(|f| f.time_s);
    }
    all.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    all
}

impl Event {
    pub(crate) fn new(
        time_s: f64,
        side: Side,
        kind: EventKind,
        source: EventSource,
        sd_ms: f64,
    ) -> Event {
        Event {
            time_s,
            side,
            kind,
            source,
            sd_ms,
            plate: None,
            file_time_s: None,
        }
    }
}

/// The strikes and offs of a file's left and right feet.
pub(crate) fn of_file(events: &[FileEvent]) -> Vec<Event> {
    let of = |event: &FileEvent| {
        let is = |text: &str, word: &str| text.eq_ignore_ascii_case(word);
        let side = Side::BOTH
            .into_iter()
            .find(|s| is(&event.context, &format!("{s:?}")))?;
        let kinds = [
            ("Foot Strike", EventKind::FootStrike),
            ("Foot Off", EventKind::FootOff),
        ];
        let (_, kind) = kinds
            .into_iter()
            .find(|(label, _)| is(&event.label, label))?;
        Some(Event::new(
            event.time,
            side,
            kind,
            EventSource::File,
            FILE_SD,
        ))
    };
    events.iter().filter_map(of).collect()
}

fn of_plates(contacts: &[Contact], first: f64) -> Vec<Event> {
    let of = |contact: &Contact| {
        let (side, plate) = (contact.side, Some(contact.plate));
        let ends = [
            (contact.on, EventKind::FootStrike),
            (contact.off, EventKind::FootOff),
        ];
        ends.map(|(time, kind)| Event {
            plate,
            ..Event::new(first + time, side, kind, EventSource::Plate, PLATE_SD)
        })
    };
    contacts.iter().flat_map(of).collect()
}

fn of_markers(markers: &Markers, legs: f64, rate: f64, first: f64) -> Vec<Event> {
    let event = |side: Side, frame: f64, kind: EventKind| {
        let sd = MARKER_SD[usize::from(turns(markers, frame, rate))][kind as usize];
        Event::new(first + frame / rate, side, kind, EventSource::Markers, sd)
    };
    let of = |side: Side| {
        let found = marker_events::events(markers, side, legs, rate).into_iter();
        let kind =
            |is_strike: bool| [EventKind::FootOff, EventKind::FootStrike][is_strike as usize];
        found.map(move |(frame, is_strike)| event(side, frame, kind(is_strike)))
    };
    Side::BOTH.into_iter().flat_map(of).collect()
}

/// Whether the pelvis turns within half a second of a frame.
fn turns(markers: &Markers, frame: f64, rate: f64) -> bool {
    let ends = [frame - rate / 2.0, frame + rate / 2.0];
    let [before, after] = ends.map(|t| {
        let t = (t.max(0.0) as usize).min(markers.frames() - 1);
        let [left, right, _] = markers.frame(t).pelvis();
        (left - right).truncate()
    });
    before.angle_to(after).abs() > TURN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_s_own_events_stand_beside() {
        let own = |label: &str, time: f64| FileEvent {
            context: "Left".into(),
            label: label.into(),
            time,
        };
        let file = [
            own("Foot Strike", 2.01),
            own("Foot Off", 2.7),
            own("Touch", 2.0),
        ];
        let contact = Contact {
            side: Side::Left,
            plate: 2,
            on: 1.0,
            off: 1.6,
            of_two: false,
        };
        let markers = Markers::new([]).unwrap();
        let of = |choice| events(choice, &markers, &[contact], &file, (900.0, 100.0, 1.0));
        let plates = of(EventChoice::Plates);
        assert_eq!(
            plates.iter().map(|e| e.time_s).collect::<Vec<_>>(),
            [2.0, 2.6]
        );
        assert_eq!(
            plates.iter().map(|e| e.file_time_s).collect::<Vec<_>>(),
            [Some(2.01), None]
        );
        assert_eq!(of(EventChoice::File).len(), 2);
    }
}
