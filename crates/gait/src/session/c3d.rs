//! A trial's curves and events as a C3D file has them.

use crate::curves::is_angle;
use crate::events::EventKind;
use crate::io::{FileEvent, OutputPoint, Quantity};
use crate::session::{SERIES, SessionTrial};
use crate::side::Side;

impl SessionTrial {
    /// Angles, forces, moments and powers as points of a C3D file, by Plug-in Gait's names. Those
    /// of them that are `stored` in the file and could not be computed are empty: what a file
    /// stores is never taken over.
    pub fn outputs(&self, stored: &[String]) -> Vec<OutputPoint> {
        let quantity = |name: &str| match name {
            name if is_angle(name) => Some(Quantity::Angles),
            name if name.ends_with("Force") => Some(Quantity::Force),
            name if name.ends_with("Moment") => Some(Quantity::Moment),
            name if name.ends_with("Power") => Some(Quantity::Power),
            _ => None,
        };
        let frames = self.trial.markers.frames();
        let of = |(side, name): (Side, &'static str)| {
            let (quantity, name) = (quantity(name)?, format!("{}{name}", side.letter()));
            let is_stored = || stored.iter().any(|s| s.rsplit(':').next() == Some(&name));
            let curve = self.gait.curves.get(&name);
            let values = match curve {
                Some(curve) => curve.iter().map(|v| v.to_array()).collect(),
                None if is_stored() => vec![[f64::NAN; 3]; frames],
                None => return None,
            };
            Some(OutputPoint {
                name,
                quantity,
                values,
            })
        };
        let names = SERIES.into_iter();
        let both = names.flat_map(|name| Side::BOTH.map(|side| (side, name)));
        both.filter_map(of).collect()
    }

    /// The events of the feet by the names that C3D files give them.
    pub fn events(&self) -> Vec<FileEvent> {
        let events = self.gait.events.iter();
        let of = |event: &crate::Event| FileEvent {
            context: format!("{:?}", event.side),
            label: match event.kind {
                EventKind::FootStrike => "Foot Strike".into(),
                EventKind::FootOff => "Foot Off".into(),
            },
            time: event.time_s,
        };
        events.map(of).collect()
    }
}
