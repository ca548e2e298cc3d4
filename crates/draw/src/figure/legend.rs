//! What is written around the panels: the title, what colors and signs mean, and which moments are
//! shown.

use super::shapes::{FIGURES, INK, LEFT, PALE, RIGHT, UNKNOWN, dot, n, shortened};
use super::view::Panel;
use super::{EDGE, Layout, Picture};
use crate::html::escape;
use crate::scene::Status;
use crate::scene_geometry::Side;

impl Picture<'_, '_> {
    /// Below a column: the frame's number and time, and its take if there are several;
    /// below a trail, the first's and the last's.
    pub(crate) fn moments(&self, panel: &Panel, wide: f64, [x, y]: [f64; 2]) -> String {
        let (Some(first), Some(last)) = (panel.frames.first(), panel.frames.last()) else {
            return String::new();
        };
        let word = if wide > 125.0 { "frame " } else { "" };
        let label = |t: usize| format!("{word}{t} · {:.2} s", self.scene.moment(t).1);
        let between = |a: String, b: String| if a == b { a } else { format!("{a} → {b}") };
        let mut lines = vec![between(label(*first), label(*last))];
        if self.scene.runs.len() > 1 {
            let take = |t: usize| self.scene.moment(t).0.to_string();
            let takes = between(take(*first), take(*last));
            lines.push(shortened(&takes, (wide / 7.0) as usize));
        }
        let x = n(x);
        let line = |(i, text): (usize, &String)| {
            let (y, text) = (n(y + 15.0 * i as f64), escape(text));
            format!(
                "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\" fill=\"{PALE}\">{text}</text>\n"
            )
        };
        lines.iter().enumerate().map(line).collect()
    }

    /// The title, and what the colors and signs in use mean.
    pub(crate) fn heading(&self, panels: &[Panel]) -> String {
        let mut out = String::new();
        let mut y = 26.0;
        if !self.scene.title.is_empty() {
            let title = escape(self.scene.title);
            out.push_str(&format!(
                "<text x=\"{EDGE}\" y=\"{y}\" font-size=\"15\" \
                 font-weight=\"600\">{title}</text>\n"
            ));
            y = 48.0;
        }
        let sided = self.geometry.sides.iter().any(|side| *side != Side::Middle);
        let mut entries: Vec<(String, String)> = Vec::new();
        let mut entry = |color: &str, status: Status, text: &str| {
            entries.push((
                dot(
                    [0.0, -4.0],
                    if status == Status::Observed { 4.0 } else { 3.2 },
                    color,
                    status,
                ),
                escape(text),
            ));
        };
        if self.options.layout == Layout::Overlaid {
            for (figure, (color, _)) in self.scene.figures.iter().zip(FIGURES.iter().cycle()) {
                entry(color, Status::Observed, figure.name);
            }
            if sided {
                entry(UNKNOWN, Status::Observed, "right limbs fainter");
            }
        } else if sided {
            entry(LEFT, Status::Observed, "left");
            entry(RIGHT, Status::Observed, "right");
        }
        for status in Status::ALL.into_iter().skip(1) {
            let mut all = panels.iter().flat_map(|panel| self.every_point(panel));
            if all.any(|(f, t, p)| {
                self.geometry.at(f, t, p).is_some() && self.geometry.status(f, t, p) == status
            }) {
                entry(INK, status, status.name());
            }
        }
        let mut x = EDGE + 5.0;
        for (sign, text) in entries {
            let wide = text.chars().count() as f64 * 6.9 + 28.0;
            let at = format!("{} {}", n(x), n(y));
            out.push_str(&format!(
                "<g transform=\"translate({at})\">{sign}<text x=\"9\" \
                 fill=\"{PALE}\">{text}</text></g>\n"
            ));
            x += wide;
        }
        out
    }
}
