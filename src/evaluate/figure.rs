//! Stick figures as SVG, for papers and reports: chosen frames, side by side or in one trail.
//!
//! One view serves every panel: a right-handed frame with y up is turned by the azimuth about y, tilted
//! by the elevation, and (if asked) drawn in mild perspective. The same scene gives the same bytes.

use super::markup::{escape, fill};
use super::scene::{Scene, Status};
use super::shapes::{FIGURES, INK, LEFT, PALE, RIGHT, UNKNOWN, dot, n, shortened, stick, wrapped};
use super::stance::{Side, Stance};
use crate::{Error, Result};

/// How frames and figures share the picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Layout {
    /// A column for each frame, a row for each figure.
    #[default]
    Grid,
    /// A column for each frame, the figures on top of each other in their own colours.
    Overlaid,
    /// A row for each figure, all frames where they are in the world, the earlier ones fainter.
    Trail,
}

/// How the scene is seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How frames and figures share the picture.
    pub layout: Layout,
    /// Where the viewer stands, in degrees: 0 at +z, 90 at +x. `None`: chosen so that the body,
    /// if its points' names tell left from right, is seen from the side and a little from the front.
    pub azimuth: Option<f64>,
    /// How far the viewer looks down, in degrees: 0 is level, 90 straight from above.
    pub elevation: f64,
    /// Mild perspective instead of parallel rays.
    pub perspective: bool,
    /// The height of a panel, in pixels: 40 to 4000.
    pub height: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            layout: Layout::Grid,
            azimuth: None,
            elevation: 12.0,
            perspective: false,
            height: 230.0,
        }
    }
}

impl Options {
    /// Fails on an angle that is none or a height out of range.
    pub fn check(&self) -> Result<()> {
        if let Some(azimuth) = self.azimuth.filter(|a| !a.is_finite()) {
            return Err(Error::usage(format!("azimuth {azimuth} must be finite")));
        }
        if !(-90.0..=90.0).contains(&self.elevation) {
            let elevation = self.elevation;
            return Err(Error::usage(format!(
                "elevation {elevation} must be from -90 to 90"
            )));
        }
        if !(40.0..=4000.0).contains(&self.height) {
            let height = self.height;
            return Err(Error::usage(format!(
                "panel height {height} must be from 40 to 4000"
            )));
        }
        Ok(())
    }
}

/// Draws chosen frames (counted from 0) of a scene as an SVG document.
///
/// # Errors
/// Usage, if [`Scene::check`] or [`Options::check`] fails or a frame is past the last.
pub fn svg(scene: &Scene<'_>, frames: &[usize], options: &Options) -> Result<String> {
    scene.check()?;
    options.check()?;
    if let Some(frame) = frames.iter().find(|frame| **frame >= scene.frames()) {
        let count = scene.frames();
        return Err(Error::usage(format!(
            "frame {frame}: there are {count}, counted from 0"
        )));
    }
    let stance = Stance::of(scene);
    let picture = Picture {
        scene,
        azimuth: options
            .azimuth
            .unwrap_or_else(|| stance.azimuth())
            .to_radians(),
        eye: options.perspective.then_some(5.0 * stance.size),
        stance,
        options,
    };
    Ok(picture.draw(frames))
}

/// Pixels left and right of the panels, between two columns, below the last row.
const EDGE: f64 = 18.0;
const BETWEEN: f64 = 10.0;
const FOOT: f64 = 16.0;
/// Room (cm) around what is drawn.
const ROOM: f64 = 14.0;
/// The head's radius, as a share of the figure's size.
const HEAD: f64 = 0.039;
/// The grid's step, and how far it reaches around a figure (cm).
const STEP: f64 = 50.0;
const REACH: f64 = 100.0;
/// A trail is scaled down to this width (px).
const WIDEST: f64 = 1600.0;

/// Frames of figures drawn in one place.
struct Panel {
    row: usize,
    column: usize,
    figures: Vec<usize>,
    frames: Vec<usize>,
    /// What is drawn in the panel's middle: x and z (cm).
    middle: [f64; 2],
}

/// The part of the view that every panel shows (cm on the paper).
#[derive(Clone, Copy)]
struct Window {
    left: f64,
    right: f64,
    low: f64,
    high: f64,
}

struct Picture<'s, 'a> {
    scene: &'s Scene<'a>,
    stance: Stance<'s, 'a>,
    options: &'s Options,
    azimuth: f64,
    eye: Option<f64>,
}

impl Picture<'_, '_> {
    fn draw(&self, frames: &[usize]) -> String {
        let panels = self.panels(frames);
        let window = self.window(&panels);
        let (across, up) = (window.right - window.left, window.high - window.low);
        let scale = (self.options.height / up).min(WIDEST / across);
        let (wide, tall) = (across * scale, up * scale);
        let rows = panels.iter().map(|p| p.row + 1).max().unwrap_or(0);
        let columns = panels.iter().map(|p| p.column + 1).max().unwrap_or(0);

        let head = if self.scene.title.is_empty() {
            50.0
        } else {
            74.0
        };
        let drawn = columns as f64 * (wide + BETWEEN) - BETWEEN;
        let told = self.scene.title.chars().count() as f64 * 8.6;
        let width = 2.0 * EDGE + drawn.max(told.min(WIDEST)).max(400.0);
        let row_height = tall + 24.0;
        let foot = FOOT + if self.scene.runs.len() > 1 { 15.0 } else { 0.0 };
        let credit = wrapped(
            self.scene.credit.unwrap_or_default(),
            (width - 2.0 * EDGE) / 5.6,
        );
        let height = head + rows as f64 * row_height + foot + 13.0 * credit.len() as f64;

        let mut body = self.heading(&panels);
        let start = if columns > 0 {
            (width - drawn) / 2.0
        } else {
            EDGE
        };
        for (i, panel) in panels.iter().enumerate() {
            let x = start + panel.column as f64 * (wide + BETWEEN);
            let y = head + panel.row as f64 * row_height;
            body.push_str(&self.panel(panel, i, window, scale, [x, y]));
            if panel.row + 1 == rows {
                body.push_str(&self.moments(panel, wide, [x + wide / 2.0, y + tall + 16.0]));
            }
        }
        if panels.is_empty() {
            let y = n(head + 4.0);
            body.push_str(&format!(
                "<text x=\"{EDGE}\" y=\"{y}\" fill=\"{PALE}\">no frames</text>\n"
            ));
        }
        for (i, line) in credit.iter().enumerate() {
            let y = n(height - 10.0 - 13.0 * (credit.len() - 1 - i) as f64);
            let text = escape(line);
            body.push_str(&format!(
                "<text x=\"{EDGE}\" y=\"{y}\" font-size=\"9.5\" fill=\"{PALE}\">{text}</text>\n"
            ));
        }
        let title = escape(if self.scene.title.is_empty() {
            "Stick figures"
        } else {
            self.scene.title
        });
        let (w, h) = (n(width), n(height));
        fill(
            DOCUMENT,
            &[("w", &w), ("h", &h), ("title", &title), ("body", &body)],
        )
    }

    fn panels(&self, frames: &[usize]) -> Vec<Panel> {
        let figures: Vec<usize> = (0..self.scene.figures.len()).collect();
        if frames.is_empty() || figures.is_empty() {
            return Vec::new();
        }
        let each = |row, column, figures: &[usize], frames: &[usize]| Panel {
            row,
            column,
            figures: figures.to_vec(),
            frames: frames.to_vec(),
            middle: self.middle(frames),
        };
        match self.options.layout {
            Layout::Trail => figures.iter().map(|f| each(*f, 0, &[*f], frames)).collect(),
            Layout::Overlaid => {
                let columns = frames.iter().enumerate();
                columns
                    .map(|(column, t)| each(0, column, &figures, &[*t]))
                    .collect()
            }
            Layout::Grid => {
                let columns = || frames.iter().enumerate();
                let row = |f| columns().map(move |(column, t)| each(f, column, &[f], &[*t]));
                figures.iter().flat_map(|f| row(*f)).collect()
            }
        }
    }

    /// The middle of the frames' own middles; the origin where nothing is seen.
    fn middle(&self, frames: &[usize]) -> [f64; 2] {
        let seen: Vec<[f64; 2]> = frames
            .iter()
            .filter_map(|t| self.stance.middle(*t))
            .collect();
        let count = seen.len().max(1) as f64;
        [0, 1].map(|axis| seen.iter().map(|m| m[axis]).sum::<f64>() / count)
    }

    /// Right, up and towards the viewer (cm), from where the panel's middle meets the ground.
    fn project(&self, [x, y, z]: [f64; 3], middle: [f64; 2]) -> [f64; 3] {
        let (x, y, z) = (x - middle[0], y - self.stance.ground, z - middle[1]);
        let (sin, cos) = self.azimuth.sin_cos();
        let (tilt_sin, tilt_cos) = self.options.elevation.to_radians().sin_cos();
        let (right, near) = (x * cos - z * sin, x * sin + z * cos);
        let (up, near) = (
            y * tilt_cos - near * tilt_sin,
            near * tilt_cos + y * tilt_sin,
        );
        // What comes close to the eye is not let past it.
        let enlarged = self
            .eye
            .map_or(1.0, |eye| eye / (eye - near).max(eye / 4.0));
        [right * enlarged, up * enlarged, near]
    }

    /// The window that holds all but the farthest strays of all panels.
    fn window(&self, panels: &[Panel]) -> Window {
        let (mut across, mut up) = (Vec::new(), Vec::new());
        for panel in panels {
            for (f, t, p) in self.every_point(panel) {
                if let Some(place) = self.stance.at(f, t, p) {
                    let [right, high, _] = self.project(place, panel.middle);
                    across.push(right);
                    up.push(high);
                }
            }
        }
        across.sort_by(f64::total_cmp);
        up.sort_by(f64::total_cmp);
        let ends = |sorted: &[f64]| {
            let stray = sorted.len() / 400;
            let low = sorted.get(stray).copied().unwrap_or(0.0);
            (low, sorted.iter().rev().nth(stray).copied().unwrap_or(low))
        };
        let ((left, right), (low, high)) = (ends(&across), ends(&up));
        let room = ROOM + HEAD * self.stance.size;
        let half = 0.5 * (right - left).max(0.35 * self.stance.size) + room;
        let middle = 0.5 * (left + right);
        let (left, right) = (middle - half, middle + half);
        Window {
            left,
            right,
            low: low.min(0.0) - room,
            high: high.max(0.0) + room,
        }
    }

    fn every_point(&self, panel: &Panel) -> impl Iterator<Item = (usize, usize, usize)> {
        let points = self.scene.points.len();
        panel.figures.iter().flat_map(move |f| {
            panel
                .frames
                .iter()
                .flat_map(move |t| (0..points).map(move |p| (*f, *t, p)))
        })
    }

    fn panel(&self, panel: &Panel, id: usize, window: Window, scale: f64, at: [f64; 2]) -> String {
        let (wide, tall) = (
            (window.right - window.left) * scale,
            (window.high - window.low) * scale,
        );
        let place = |view: [f64; 3]| {
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
            "<clipPath id=\"c{id}\"><rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/></clipPath>\n\
             <g clip-path=\"url(#c{id})\">\n"
        ));
        out.push_str(&self.grid(panel, &place));
        for (i, frame) in panel.frames.iter().enumerate() {
            let faint = 0.3 + 0.7 * (i + 1) as f64 / panel.frames.len() as f64;
            for figure in &panel.figures {
                out.push_str(&format!("<g opacity=\"{}\">\n", n(faint)));
                out.push_str(&self.body(*figure, *frame, panel, &place, scale));
                out.push_str("</g>\n");
            }
        }
        out.push_str("</g>\n");
        out
    }

    /// The ground: lines every half metre of the world, around all the panel's frames.
    fn grid(&self, panel: &Panel, place: &dyn Fn([f64; 3]) -> [f64; 2]) -> String {
        let mut area = [[panel.middle[0]; 2], [panel.middle[1]; 2]];
        for middle in panel.frames.iter().filter_map(|t| self.stance.middle(*t)) {
            for axis in 0..2 {
                area[axis][0] = area[axis][0].min(middle[axis]);
                area[axis][1] = area[axis][1].max(middle[axis]);
            }
        }
        let [x, z] = area.map(|[low, high]| grid_lines(low - REACH, high + REACH));
        let at = |x, z| place(self.project([x, self.stance.ground, z], panel.middle));
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
        place: &dyn Fn([f64; 3]) -> [f64; 2],
        scale: f64,
    ) -> String {
        let count = self.scene.points.len();
        let seen: Vec<Option<[f64; 3]>> = (0..count)
            .map(|p| {
                self.stance
                    .at(figure, frame, p)
                    .map(|at| self.project(at, panel.middle))
            })
            .collect();
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
        for bone in self.scene.bones {
            let (Some(a), Some(b)) = (seen[bone.0], seen[bone.1]) else {
                continue;
            };
            let ends = [bone.0, bone.1].map(|p| self.stance.status(figure, frame, p));
            let color = self.color(figure, self.stance.bone_side(*bone));
            parts.push((
                (a[2] + b[2]) / 2.0,
                stick(place(a), place(b), color, thick, ends, !overlaid),
            ));
        }
        for (p, view) in seen.iter().enumerate() {
            let Some(view) = view else { continue };
            let head = self.stance.head == Some(p);
            let radius = if head {
                HEAD * self.stance.size * scale
            } else {
                thick * 0.72
            };
            let radius = if head {
                radius + 1.5 * above as f64
            } else {
                radius
            };
            let color = self.color(figure, self.stance.sides[p]);
            let status = self.stance.status(figure, frame, p);
            // Joints lie on their bones, so they come just after them.
            parts.push((
                view[2] + 0.03 * self.stance.size,
                dot(place(*view), radius, color, status),
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

    /// Below a column: the frame's number and time, and its take if there are several;
    /// below a trail, the first's and the last's.
    fn moments(&self, panel: &Panel, wide: f64, [x, y]: [f64; 2]) -> String {
        let (Some(first), Some(last)) = (panel.frames.first(), panel.frames.last()) else {
            return String::new();
        };
        let word = if wide > 125.0 { "frame " } else { "" };
        let told = |t: usize| format!("{word}{t} · {:.2} s", self.scene.moment(t).1);
        let between = |a: String, b: String| if a == b { a } else { format!("{a} → {b}") };
        let mut lines = vec![between(told(*first), told(*last))];
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

    /// The title, and what the colours and signs in use mean.
    fn heading(&self, panels: &[Panel]) -> String {
        let mut out = String::new();
        let mut y = 26.0;
        if !self.scene.title.is_empty() {
            let title = escape(self.scene.title);
            out.push_str(&format!(
                "<text x=\"{EDGE}\" y=\"{y}\" font-size=\"15\" font-weight=\"600\">{title}</text>\n"
            ));
            y = 48.0;
        }
        let sided = self.stance.sides.iter().any(|side| *side != Side::Middle);
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
                self.stance.at(f, t, p).is_some() && self.stance.status(f, t, p) == status
            }) {
                entry(INK, status, status.name());
            }
        }
        let mut x = EDGE + 5.0;
        for (sign, text) in entries {
            let wide = text.chars().count() as f64 * 6.9 + 28.0;
            let at = format!("{} {}", n(x), n(y));
            out.push_str(&format!(
                "<g transform=\"translate({at})\">{sign}<text x=\"9\" fill=\"{PALE}\">{text}</text></g>\n"
            ));
            x += wide;
        }
        out
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

const DOCUMENT: &str = "\
<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{{w}}\" height=\"{{h}}\" viewBox=\"0 0 {{w}} {{h}}\" \
role=\"img\" font-family=\"system-ui, 'Segoe UI', Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"#39424e\">
<title>{{title}}</title>
<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>
{{body}}</svg>
";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::scene::{Figure, Run};
    use ndarray::Array2;

    /// Whether every tag is closed in its turn and every attribute quoted; the tags seen are counted.
    fn well_formed(xml: &str) -> usize {
        let (mut open, mut seen) = (Vec::new(), 0);
        for piece in xml.split('<').skip(1) {
            let (tag, text) = piece.split_once('>').expect("a tag ends");
            assert!(!text.contains('>'), "stray > in {text}");
            let name = tag
                .split(|c: char| !c.is_alphanumeric() && c != '/')
                .next()
                .unwrap();
            seen += 1;
            assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
            if let Some(name) = name.strip_prefix('/') {
                assert_eq!(open.pop(), Some(name));
            } else if !tag.ends_with('/') {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "left open: {open:?}");
        seen
    }

    fn names() -> Vec<String> {
        ["root", "lfoot", "rfoot", "head", "a<b>&\"'"]
            .map(String::from)
            .to_vec()
    }

    fn motion(frames: usize) -> Array2<f64> {
        Array2::from_shape_fn((frames, 15), |(t, c)| {
            20.0 * c as f64 + (t as f64 * 0.7 + c as f64).sin()
        })
    }

    fn all(mut check: impl FnMut(Options)) {
        for layout in [Layout::Grid, Layout::Overlaid, Layout::Trail] {
            for perspective in [false, true] {
                check(Options {
                    layout,
                    perspective,
                    ..Options::default()
                });
            }
        }
    }

    #[test]
    fn hostile_names_leave_it_well_formed_and_self_contained() {
        let (points, mut xyz) = (names(), motion(6));
        xyz[[0, 3]] = f64::NAN;
        xyz[[1, 4]] = f64::INFINITY;
        xyz[[2, 5]] = 1e300;
        let status = Array2::from_shape_fn((6, 5), |(t, p)| Status::ALL[(t + p) % 5]);
        let runs = [
            Run {
                name: "<a \u{1}",
                first: 0,
                time: 0.0,
            },
            Run {
                name: "b",
                first: 3,
                time: 0.0,
            },
        ];
        let scene = Scene {
            title: "</svg><script>alert(1)</script> {{body}}",
            points: &points,
            bones: &[(0, 1), (0, 2), (0, 3), (4, 4)],
            rate: 30.0,
            figures: vec![
                Figure {
                    name: "</text>",
                    xyz: xyz.view(),
                    status: Some(status.view()),
                },
                Figure {
                    name: "b",
                    xyz: xyz.view(),
                    status: None,
                },
            ],
            runs: &runs,
            credit: Some("a & b < c"),
            ..Scene::default()
        };
        all(|options| {
            let drawn = svg(&scene, &scene.spread(4), &options).unwrap();
            assert!(well_formed(&drawn) > 40);
            assert!(
                !drawn.contains("<script") && !drawn.contains("NaN") && !drawn.contains("inf ")
            );
            let without_namespace = drawn.replacen("http://www.w3.org/2000/svg", "", 1);
            assert!(!without_namespace.contains("http") && !drawn.contains("href"));
            assert_eq!(drawn, svg(&scene, &scene.spread(4), &options).unwrap());
        });
    }

    #[test]
    fn nothing_one_point_and_everything_missing_are_drawn() {
        let one = vec!["p".to_string()];
        let none = Array2::from_elem((2, 3), f64::NAN);
        let zero = Array2::zeros((2, 3));
        let empty = Array2::zeros((0, 3));
        let nothing = Scene {
            rate: 1.0,
            ..Scene::default()
        };
        all(|options| {
            well_formed(&svg(&nothing, &[], &options).unwrap());
            for xyz in [&none, &zero, &empty] {
                let figure = Figure {
                    name: "f",
                    xyz: xyz.view(),
                    status: None,
                };
                let scene = Scene {
                    points: &one,
                    rate: 1.0,
                    figures: vec![figure],
                    ..Scene::default()
                };
                let drawn = svg(&scene, &scene.spread(2), &options).unwrap();
                well_formed(&drawn);
                assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
            }
        });
    }

    #[test]
    fn missing_points_and_their_bones_are_left_out() {
        let (points, whole) = (names(), motion(1));
        let mut torn = whole.clone();
        torn[[0, 3]] = f64::NAN;
        let count = |xyz: &Array2<f64>| {
            let figure = Figure {
                name: "f",
                xyz: xyz.view(),
                status: None,
            };
            let scene = Scene {
                points: &points,
                bones: &[(0, 1), (0, 2)],
                rate: 1.0,
                figures: vec![figure],
                ..Scene::default()
            };
            let drawn = svg(&scene, &[0], &Options::default()).unwrap();
            (
                drawn.matches("<circle").count(),
                drawn.matches("linecap").count(),
            )
        };
        let (circles, bones) = count(&whole);
        assert_eq!((circles - 1, bones - 1), count(&torn));
    }

    #[test]
    fn what_is_asked_must_exist() {
        let (points, xyz) = (names(), motion(3));
        let figure = Figure {
            name: "f",
            xyz: xyz.view(),
            status: None,
        };
        let scene = Scene {
            points: &points,
            rate: 1.0,
            figures: vec![figure],
            ..Scene::default()
        };
        let fails = |frames: &[usize], options: Options, with: &str| {
            let error = svg(&scene, frames, &options).unwrap_err().to_string();
            assert!(error.contains(with), "{error}");
        };
        fails(&[3], Options::default(), "there are 3");
        fails(
            &[0],
            Options {
                azimuth: Some(f64::NAN),
                ..Options::default()
            },
            "azimuth",
        );
        fails(
            &[0],
            Options {
                elevation: 91.0,
                ..Options::default()
            },
            "from -90 to 90",
        );
        fails(
            &[0],
            Options {
                elevation: f64::NAN,
                ..Options::default()
            },
            "from -90 to 90",
        );
        fails(
            &[0],
            Options {
                height: 0.0,
                ..Options::default()
            },
            "40 to 4000",
        );
    }
}
