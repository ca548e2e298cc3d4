//! A trial of a session on its page: events, parameters, cycles and gaps.

use super::tables::{VALUES, capital, number, table};
use crate::draw::html::escape;
use crate::events::{Event, EventKind};
use crate::parameters::{Parameter, Source};
use crate::session::SessionTrial;
use crate::trial::FilledGap;

/// A trial and the address of the page that plays it.
pub(crate) struct Told<'a> {
    pub trial: &'a SessionTrial,
    pub player: Option<&'a str>,
}

impl Event {
    /// `foot strike` or `foot off`.
    pub(crate) fn words(&self) -> &'static str {
        match self.kind {
            EventKind::FootStrike => "foot strike",
            EventKind::FootOff => "foot off",
        }
    }

    /// Side, kind, source, plate, deviation, the file's own time and how much later ours is, as
    /// cells behind the time.
    pub(crate) fn cells(&self) -> [String; 7] {
        let apart = self.file_time_s.map(|file| 1e3 * (self.time_s - file));
        let apart = apart.map(|ms| format!("{ms:+.0}"));
        [
            format!("{:?}", self.side).to_lowercase(),
            self.words().into(),
            format!("{:?}", self.source).to_lowercase(),
            self.plate.map_or(String::new(), |plate| plate.to_string()),
            format!("{:.0}", self.sd_ms),
            self.file_time_s
                .map_or(String::new(), |t| format!("{t:.3}")),
            apart.unwrap_or_default(),
        ]
    }
}

/// The heads of [`Event::cells`], and of the time.
pub(crate) const EVENT_HEAD: [&str; 8] = [
    "Time, s",
    "Side",
    "Event",
    "Source",
    "Plate",
    "\u{b1} ms",
    "File's own, s",
    "Difference, ms",
];

impl Told<'_> {
    /// A text, as a link to the page that plays the trial, `at` behind its address.
    pub(crate) fn link(&self, text: &str, at: &str) -> String {
        let text = escape(text);
        match self.player {
            Some(page) => format!("<a href=\"{}{at}\">{text}</a>", escape(page)),
            None => text,
        }
    }

    /// The trial as a section.
    pub(crate) fn section(&self) -> String {
        format!(
            "<section><h2>{}</h2>{}{}{}{}</section>\n",
            self.link(&self.trial.name, ""),
            self.events(),
            self.cycles(),
            self.gaps(),
            self.parameters()
        )
    }

    fn events(&self) -> String {
        let row = |event: &Event| {
            let frame = self.trial.frame_at(event.time_s);
            let time = self.link(&format!("{:.3}", event.time_s), &format!("#frame={frame}"));
            let cells = event.cells().map(|cell| cell.replace('-', "\u{2212}"));
            [&[time], &cells[..]].concat()
        };
        let rows: Vec<Vec<String>> = self.trial.gait.events.iter().map(row).collect();
        if rows.is_empty() {
            return "<p>No events.</p>".into();
        }
        format!("<h3>Events</h3>{}", table(4, &EVENT_HEAD, &rows))
    }

    fn cycles(&self) -> String {
        let cycles = &self.trial.gait.cycles;
        if cycles.is_empty() {
            return "<p>No whole cycle.</p>".into();
        }
        let names = cycles.iter().map(|(cycle, _)| {
            let side = format!("{:?}", cycle.side);
            format!("{side} {}, from {:.2} s", cycle.cycle, cycle.start_s)
        });
        let names: Vec<String> = ["Value".into()].into_iter().chain(names).collect();
        let head: Vec<&str> = names.iter().map(String::as_str).collect();
        let row = |(key, words, unit): &(&str, &str, &str)| {
            let name = format!("{words} <small>{unit}</small>");
            let values = cycles
                .iter()
                .map(|(_, values)| number(values.get(key).copied()));
            [name].into_iter().chain(values).collect()
        };
        let rows: Vec<Vec<String>> = VALUES.iter().map(row).collect();
        format!("<h3>Cycles</h3>{}", table(1, &head, &rows))
    }

    fn gaps(&self) -> String {
        let row = |gap: &FilledGap| {
            let [start, end] = gap.frames;
            let first = self.trial.trial.first_frame as usize;
            let frames = format!("{}\u{2013}{}", first + start, first + end - 1);
            let seconds = (end - start) as f64 / self.trial.trial.rate;
            let what = match gap.sd_mm {
                Some(sd) => format!("filled, \u{b1} {} mm", number(Some(sd))),
                None => "left".into(),
            };
            let at = format!("#frame={start}&amp;trail={}", gap.marker);
            let marker = self.link(gap.marker, &at);
            vec![marker, what, frames, number(Some(seconds))]
        };
        let rows: Vec<Vec<String>> = self.trial.trial.gaps.iter().map(row).collect();
        if rows.is_empty() {
            return String::new();
        }
        let head = ["Marker", "Gap", "Frames of the file", "Seconds"];
        format!("<h3>Gaps of markers</h3>{}", table(2, &head, &rows))
    }

    fn parameters(&self) -> String {
        let all = &self.trial.gait.parameters;
        let row = |(name, p): (&String, &Parameter)| {
            let (times, unit) = match p.unit {
                "rad" => (1f64.to_radians().recip(), "degrees"),
                unit => (1.0, unit),
            };
            let source = capital(&format!("{:?}", p.source).to_lowercase());
            let source = match p.source {
                Source::Estimate => format!("<b class=\"estimate\">{source}</b>"),
                _ => source,
            };
            let sd = p.sd.map_or(String::new(), |sd| number(Some(times * sd)));
            let value = number(Some(times * p.value));
            vec![escape(name), source, unit.into(), value, sd]
        };
        let rows: Vec<Vec<String>> = all.0.iter().map(row).collect();
        let estimated = match all.of_source(Source::Estimate).count() {
            0 => String::new(),
            n => format!(", {n} of them estimated"),
        };
        format!(
            "<details><summary>Parameters: {}{estimated}</summary>{}</details>",
            rows.len(),
            table(
                3,
                &["Parameter", "Source", "Unit", "Value", "\u{b1}"],
                &rows
            )
        )
    }
}
