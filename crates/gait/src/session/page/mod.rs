//! The page of a session: what is to be known, values, scores, curves, and each trial.

mod chart;
mod curves;
mod player;
mod tables;
mod trials;

use self::tables::{capital, number, table};
use self::trials::Told;
use crate::draw::html::escape;
use crate::draw::plain_page::PlainPage;
use crate::findings::Finding;
use crate::session::Session;
use crate::side::Side;

const STYLE: &str = include_str!("page.css");

impl Session {
    /// The session as a page without a script, which needs no other file. `players` are the
    /// addresses of pages that play the trials, as they stand in a link.
    pub fn page(&self, players: &[Option<String>]) -> String {
        let told: Vec<Told<'_>> = self
            .trials
            .iter()
            .enumerate()
            .map(|(i, trial)| {
                let player = players.get(i).and_then(Option::as_deref);
                Told { trial, player }
            })
            .collect();
        let file = self.static_file.as_deref().map_or("none".into(), escape);
        let parts = [
            trials(&told),
            self.findings_section(),
            tables::values(self),
            tables::scores(self),
            curves::section(self),
            told.iter().map(Told::section).collect(),
        ];
        PlainPage {
            title: "Gait",
            lead: vec![format!("Static trial: {file}.")],
            main: parts.concat(),
            style: STYLE,
            command: "gait",
            data: "All numbers are in gait.json and cycles.csv.",
        }
        .html()
    }

    /// The findings, those of several trials once.
    fn findings_section(&self) -> String {
        let mut all: Vec<(&Finding, Vec<&str>)> = Vec::new();
        for trial in &self.trials {
            for finding in &trial.gait.findings {
                match all.iter_mut().find(|(other, _)| *other == finding) {
                    Some((_, names)) => names.push(&trial.name),
                    None => all.push((finding, vec![&trial.name])),
                }
            }
        }
        let item = |(finding, names): &(&Finding, Vec<&str>)| {
            let names = match names.len() {
                n if n == self.trials.len() && n > 1 => "all trials".into(),
                _ => names.join(", "),
            };
            let kind = capital(&finding.kind.replace('_', " "));
            let [what, names] = [&finding.what, &names].map(|text| escape(text));
            format!("<li><b>{kind}</b>: {what} <small>({names})</small></li>")
        };
        let failed = self.failed.iter();
        let failed =
            failed.map(|(_, error)| format!("<li><b>Not computed</b>: {}</li>", escape(error)));
        let failed: String = failed.collect();
        let list = if all.is_empty() && failed.is_empty() {
            "<p>Nothing to note.</p>".into()
        } else {
            format!(
                "<ul>{failed}{}</ul>",
                all.iter().map(item).collect::<String>()
            )
        };
        format!("<section id=\"findings\"><h2>Findings</h2>{list}</section>\n")
    }
}

/// The trials, a row each.
fn trials(told: &[Told<'_>]) -> String {
    let row = |told: &Told<'_>| {
        let (trial, direction) = (told.trial, told.trial.gait.direction);
        let walks = if direction.standing {
            "stands, faces"
        } else {
            "walks to"
        };
        let [left, right] = Side::BOTH.map(|side| trial.cycles(side).count().to_string());
        let frames = trial.trial.markers.frames().to_string();
        let direction = format!("{walks} {}", direction.name().replace('-', "\u{2212}"));
        let rate = number(Some(trial.trial.rate));
        vec![
            told.link(&trial.name, ""),
            direction,
            frames,
            rate,
            left,
            right,
        ]
    };
    let rows: Vec<Vec<String>> = told.iter().map(row).collect();
    let head = [
        "Trial",
        "Direction",
        "Frames",
        "Rate, Hz",
        "Left cycles",
        "Right cycles",
    ];
    let is_played = told.iter().any(|t| t.player.is_some());
    let note = if is_played {
        "<p>A trial's name leads to a page that plays it.</p>"
    } else {
        ""
    };
    let table = table(2, &head, &rows);
    format!("<section id=\"trials\"><h2>Trials</h2>{note}{table}</section>\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::{Event, EventKind, EventSource};
    use crate::parameters::testdata;
    use crate::{Cycle, GaitSettings, GaitTrial, MARKERS, Markers, SessionTrial, Trial};

    /// A person who stands, of whom it is said that both feet made a step.
    fn session(name: &str) -> Session {
        let tracks = testdata::standing().0.map(|p| vec![p; 120]);
        let trial = Trial::new(
            Markers::new(MARKERS.into_iter().zip(tracks)).unwrap(),
            100.0,
        );
        let mut gait = GaitTrial::new(&trial, None, &GaitSettings::default()).unwrap();
        for side in Side::BOTH {
            let (cycle, start_s, end_s) = (1, 0.1, 1.1);
            let cycle = Cycle {
                side,
                cycle,
                start_s,
                end_s,
            };
            gait.cycles.push((cycle, [("stride_time_s", 1.0)].into()));
            let kind = EventKind::FootStrike;
            gait.events
                .push(Event::new(0.1, side, kind, EventSource::Plate, 2.0));
        }
        let own = SessionTrial {
            name: name.into(),
            file: format!("{name}.c3d"),
            trial,
            gait,
            deviations: None,
        };
        Session::new(vec![own], Some("<i>.c3d".into()), None).unwrap()
    }

    #[test]
    fn a_page_says_what_is_known_and_no_more() {
        let mut session = session("<b>walk");
        let page = session.page(&[Some("w.html".into())]);
        assert!(page.contains("<a href=\"w.html\">&lt;b&gt;walk</a>") && !page.contains("<b>walk"));
        assert!(page.contains("&lt;i&gt;.c3d") && !page.contains("NaN") && !page.contains("inf "));
        assert!(page.contains("<b>No mass</b>") && page.contains("class=\"estimate\""));
        assert!(page.contains("Stride time") && page.contains("href=\"w.html#frame=10\""));
        assert!(page.contains("Knee flexion") && page.contains("Thorax tilt"));
        assert!(!page.contains("Elbow flexion") && !page.contains("Hip moment"));
        assert!(!page.contains("class=\"norm\"") && !page.contains("id=\"scores\""));
        session.norm = Some(("<u>.json".into(), session.own_norm().unwrap()));
        let page = session.page(&[]);
        assert!(page.contains("&lt;u&gt;.json") && page.contains("id=\"scores\""));
        assert!(!page.contains("href=\"w.html") && !page.contains("NaN"));
        session.trials[0].gait.cycles.clear();
        let page = session.page(&[]);
        assert!(page.contains("No whole cycle") && !page.contains("<svg"));
    }

    #[test]
    fn a_trial_is_played_with_its_events() {
        let session = session("walk <b>");
        let page = session.trials[0]
            .player(Some("index.html"))
            .unwrap()
            .unwrap();
        assert!(page.contains("walk &lt;b&gt;") && !page.contains("walk <b>"));
        assert!(page.contains("href=\"#frame=10\"") && page.contains("href=\"index.html\""));
    }
}
