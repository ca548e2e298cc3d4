//! What stands in a panel: the ground, and bodies of bones and joints.

use super::shapes::{FIGURES, INK, LEFT, RIGHT, dot, n, stick};
use super::view::{HEAD, Panel, Window};
use super::{Layout, Picture};
use crate::html::escape;
use crate::scene_geometry::Side;

/// The grid's step, and how far it reaches around a figure (cm).
const STEP: f64 = 50.0;
const REACH: f64 = 100.0;

impl Picture<'_, '_> {
    pub(crate) fn panel(
        &self,
        panel: &Panel,
        id: usize,
        window: Window,
        scale: f64,
        at: [f64; 2],
    ) -> String {
        let (wide, tall) = (
            (window.right - window.left) * scale,
            (window.high - window.low) * scale,
        );
        let on_paper = |view: [f64; 3]| {
            [
                at[0] + (view[0] - window.left) * scale,
                at[1] + (window.high - view[1]) * scale,
            ]
        };
        let mut out = String::new();
        if panel.column == 0 && self.options.layout != Layout::Overlaid {
            let name = escape(self.scene.figures[panel.figures[0]].name);
            let (x, y) = (n(at[0]), n(at[1] + 2.0));
            out.push_str(&format!(
                "<text x=\"{x}\" y=\"{y}\" font-weight=\"600\">{name}</text>\n"
            ));
        }
        let (x, y, w, h) = (n(at[0]), n(at[1]), n(wide), n(tall));
        out.push_str(&format!(
            "<clipPath id=\"c{id}\">\
             <rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/></clipPath>\n\
             <g clip-path=\"url(#c{id})\">\n"
        ));
        out.push_str(&self.grid(panel, &on_paper));
        for (i, frame) in panel.frames.iter().enumerate() {
            let faint = 0.3 + 0.7 * (i + 1) as f64 / panel.frames.len() as f64;
            for figure in &panel.figures {
                out.push_str(&format!("<g opacity=\"{}\">\n", n(faint)));
                out.push_str(&self.body(*figure, *frame, panel, &on_paper, scale));
                out.push_str("</g>\n");
            }
        }
        out.push_str("</g>\n");
        out
    }

    /// The ground: lines every half meter of the world, around all the panel's frames.
    fn grid(&self, panel: &Panel, on_paper: &dyn Fn([f64; 3]) -> [f64; 2]) -> String {
        let mut area = [[panel.middle[0]; 2], [panel.middle[1]; 2]];
        for middle in panel.frames.iter().filter_map(|t| self.geometry.middle(*t)) {
            for axis in 0..2 {
                area[axis][0] = area[axis][0].min(middle[axis]);
                area[axis][1] = area[axis][1].max(middle[axis]);
            }
        }
        let [x, z] = area.map(|[low, high]| grid_lines(low - REACH, high + REACH));
        let at = |x, z| on_paper(self.project([x, self.geometry.ground, z], panel.middle));
        let mut path = String::new();
        let mut line = |a: [f64; 2], b: [f64; 2]| {
            path.push_str(&format!("M{} {}L{} {}", n(a[0]), n(a[1]), n(b[0]), n(b[1])));
        };
        for i in &x {
            line(at(*i, z[0]), at(*i, z[z.len() - 1]));
        }
        for i in &z {
            line(at(x[0], *i), at(x[x.len() - 1], *i));
        }
        format!("<path d=\"{path}\" fill=\"none\" stroke=\"#dde2e8\" stroke-width=\"0.8\"/>\n")
    }

    /// One figure in one frame, from the farthest part to the nearest.
    fn body(
        &self,
        figure: usize,
        frame: usize,
        panel: &Panel,
        on_paper: &dyn Fn([f64; 3]) -> [f64; 2],
        scale: f64,
    ) -> String {
        let count = self.scene.points.len();
        let view = |p| {
            let position = self.geometry.at(figure, frame, p)?;
            Some(self.project(position, panel.middle))
        };
        let seen: Vec<Option<[f64; 3]>> = (0..count).map(view).collect();
        let overlaid = panel.figures.len() > 1;
        // Overlaid figures are drawn thinner and thinner, so that the first still frames the last.
        let above = panel
            .figures
            .iter()
            .filter(|f| overlaid && **f > figure)
            .count()
            .min(3);
        let thick = (scale * 2.4).clamp(1.4, 7.0) * (1.0 + 0.5 * above as f64);
        let mut parts: Vec<(f64, String)> = Vec::new();
        for bone in self.scene.bones_of(figure) {
            let (Some(a), Some(b)) = (seen[bone.0], seen[bone.1]) else {
                continue;
            };
            let ends = [bone.0, bone.1].map(|p| self.geometry.status(figure, frame, p));
            let color = self.color(figure, self.geometry.bone_side(*bone));
            parts.push((
                (a[2] + b[2]) / 2.0,
                stick(on_paper(a), on_paper(b), color, thick, ends, !overlaid),
            ));
        }
        for (p, view) in seen.iter().enumerate() {
            let Some(view) = view else { continue };
            let radius = if self.geometry.head == Some(p) {
                HEAD * self.geometry.size * scale + 1.5 * above as f64
            } else {
                thick * 0.72
            };
            let color = self.color(figure, self.geometry.sides[p]);
            let status = self.geometry.status(figure, frame, p);
            // Joints lie on their bones, so they come just after them.
            parts.push((
                view[2] + 0.03 * self.geometry.size,
                dot(on_paper(*view), radius, color, status),
            ));
        }
        parts.sort_by(|a, b| a.0.total_cmp(&b.0));
        parts.into_iter().map(|(_, part)| part).collect()
    }

    fn color(&self, figure: usize, side: Side) -> &'static str {
        let (color, pale) = FIGURES[figure % FIGURES.len()];
        match (self.options.layout, side) {
            (Layout::Overlaid, Side::Right) => pale,
            (Layout::Overlaid, _) => color,
            (_, Side::Left) => LEFT,
            (_, Side::Right) => RIGHT,
            (_, Side::Middle) => INK,
        }
    }
}

/// Multiples of the grid's step from `low` to `high`: always two or more, never many.
fn grid_lines(low: f64, high: f64) -> Vec<f64> {
    let mut step = STEP;
    while (high - low) / step > 200.0 {
        step *= 10.0;
    }
    let (first, last) = ((low / step).floor(), (high / step).ceil());
    let count = (last - first) as usize;
    (0..=count.max(1))
        .map(|i| (first + i as f64) * step)
        .collect()
}
