//! Stick figures as SVG, for papers and reports: chosen frames, side by side or in one trail.
//!
//! One view serves every panel: a right-handed frame with y up is turned by the azimuth about y,
//! tilted by the elevation, and drawn by parallel rays. The same scene gives the same bytes.

mod body;
mod legend;
pub mod mesh;
mod shapes;
pub mod strip;
mod view;

use crate::html::{escape, fill};
use crate::scene::Scene;
use crate::scene_geometry::SceneGeometry;
use crate::{Error, Result};
use shapes::{PALE, n, wrapped};

/// How frames and figures share the picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Layout {
    /// A column for each frame, a row for each figure.
    #[default]
    Grid,
    /// A column for each frame, the figures on top of each other in their own colors.
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
    /// if its points' names define left and right, is seen from the side and a little from the
    /// front.
    pub azimuth: Option<f64>,
    /// How far the viewer looks down, in degrees: 0 is level, 90 straight from above.
    pub elevation: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            layout: Layout::Grid,
            azimuth: None,
            elevation: 12.0,
        }
    }
}

impl Options {
    /// Checks the limits.
    ///
    /// # Errors
    /// [`Error::Usage`] for an angle out of range.
    pub(crate) fn check(&self) -> Result<()> {
        if let Some(azimuth) = self.azimuth.filter(|a| !a.is_finite()) {
            return Err(Error::usage(format!("azimuth {azimuth} must be finite")));
        }
        if !(-90.0..=90.0).contains(&self.elevation) {
            let elevation = self.elevation;
            return Err(Error::usage(format!(
                "elevation {elevation} must be from -90 to 90"
            )));
        }
        Ok(())
    }
}

/// Draws chosen frames (counted from 0) of a scene as an SVG document.
///
/// # Errors
/// [`Error::Usage`]: a rate that is not above 0, a bone without its points, figures of different
/// shapes, runs out of order, an angle out of range, a frame that does not exist.
pub fn svg(scene: &Scene<'_>, frames: &[usize], options: &Options) -> Result<String> {
    scene.check()?;
    options.check()?;
    if let Some(frame) = frames.iter().find(|frame| **frame >= scene.frames()) {
        let count = scene.frames();
        return Err(Error::usage(format!(
            "frame {frame}: there are {count}, counted from 0"
        )));
    }
    let geometry = SceneGeometry::of(scene);
    let picture = Picture {
        scene,
        azimuth: options
            .azimuth
            .unwrap_or_else(|| geometry.azimuth())
            .to_radians(),
        geometry,
        options,
    };
    Ok(picture.draw(frames))
}

/// The height of a panel (px).
const HEIGHT: f64 = 230.0;
/// Pixels left and right of the panels, between two columns, below the last row.
const EDGE: f64 = 18.0;
const BETWEEN: f64 = 10.0;
const FOOT: f64 = 16.0;
/// A trail is scaled down to this width (px).
const WIDEST: f64 = 1600.0;

struct Picture<'s, 'a> {
    scene: &'s Scene<'a>,
    geometry: SceneGeometry<'s, 'a>,
    options: &'s Options,
    azimuth: f64,
}

impl Picture<'_, '_> {
    fn draw(&self, frames: &[usize]) -> String {
        let panels = self.panels(frames);
        let window = self.window(&panels);
        let (across, up) = (window.right - window.left, window.high - window.low);
        let scale = (HEIGHT / up).min(WIDEST / across);
        let (wide, tall) = (across * scale, up * scale);
        let rows = panels.iter().map(|p| p.row + 1).max().unwrap_or(0);
        let columns = panels.iter().map(|p| p.column + 1).max().unwrap_or(0);

        let head = if self.scene.title.is_empty() {
            50.0
        } else {
            74.0
        };
        let drawn = columns as f64 * (wide + BETWEEN) - BETWEEN;
        let title_width = self.scene.title.chars().count() as f64 * 8.6;
        let width = 2.0 * EDGE + drawn.max(title_width.min(WIDEST)).max(400.0);
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
}

const DOCUMENT: &str = "\
<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{{w}}\" height=\"{{h}}\" viewBox=\"0 0 {{w}} \
                        {{h}}\" role=\"img\" font-family=\"system-ui, 'Segoe UI', Helvetica, \
                        Arial, sans-serif\" font-size=\"12\" fill=\"#39424e\">
<title>{{title}}</title>
<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>
{{body}}</svg>
";

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::scene::tests::{names, run, scene};
    use crate::scene::{Figure, Status, spread};
    use ndarray::Array2;

    /// Whether every tag is closed in its turn and every attribute quoted; the tags seen are
    /// counted.
    pub(crate) fn well_formed(xml: &str) -> usize {
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

    fn points() -> Vec<String> {
        names(&["root", "lfoot", "rfoot", "head", "a<b>&\"'"])
    }

    fn motion(frames: usize) -> Array2<f64> {
        Array2::from_shape_fn((frames, 15), |(t, c)| {
            20.0 * c as f64 + (t as f64 * 0.7 + c as f64).sin()
        })
    }

    fn all(mut check: impl FnMut(Options)) {
        for layout in [Layout::Grid, Layout::Overlaid, Layout::Trail] {
            check(Options {
                layout,
                ..Options::default()
            });
        }
    }

    #[test]
    fn hostile_names_leave_it_well_formed_and_self_contained() {
        let (points, mut xyz) = (points(), motion(6));
        xyz[[0, 3]] = f64::NAN;
        xyz[[1, 4]] = f64::INFINITY;
        xyz[[2, 5]] = 1e300;
        let status = Array2::from_shape_fn((6, 5), |(t, p)| Status::ALL[(t + p) % 5]);
        let runs = [run("<a \u{1}", 0, 0.0), run("b", 3, 0.0)];
        let mut scene = Scene {
            title: "</svg><script>alert(1)</script> {{body}}",
            bones: &[(0, 1), (0, 2), (0, 3), (4, 4)],
            runs: &runs,
            credit: Some("a & b < c"),
            ..scene(&points, &xyz)
        };
        scene.figures[0].name = "</text>";
        scene.figures[0].status = Some(status.view());
        scene.figures.push(Figure::new("b", xyz.view()));
        all(|options| {
            let drawn = svg(&scene, &spread(scene.frames(), 4), &options).unwrap();
            assert!(well_formed(&drawn) > 40);
            assert!(
                !drawn.contains("<script") && !drawn.contains("NaN") && !drawn.contains("inf ")
            );
            let without_namespace = drawn.replacen("http://www.w3.org/2000/svg", "", 1);
            assert!(!without_namespace.contains("http") && !drawn.contains("href"));
            assert_eq!(
                drawn,
                svg(&scene, &spread(scene.frames(), 4), &options).unwrap()
            );
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
                let scene = scene(&one, xyz);
                let drawn = svg(&scene, &spread(scene.frames(), 2), &options).unwrap();
                well_formed(&drawn);
                assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
            }
        });
    }

    #[test]
    fn missing_points_and_their_bones_are_left_out() {
        let (points, whole) = (points(), motion(1));
        let mut torn = whole.clone();
        torn[[0, 3]] = f64::NAN;
        let count = |xyz: &Array2<f64>| {
            let scene = Scene {
                bones: &[(0, 1), (0, 2)],
                ..scene(&points, xyz)
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
    fn unknown_frames_and_bad_options_are_refused() {
        let (points, xyz) = (points(), motion(3));
        let scene = scene(&points, &xyz);
        let fails = |frames: &[usize], change: &dyn Fn(&mut Options), part: &str| {
            let mut options = Options::default();
            change(&mut options);
            let e = svg(&scene, frames, &options).unwrap_err();
            assert!(e.to_string().contains(part), "{e}");
        };
        fails(&[3], &|_| (), "there are 3");
        fails(&[0], &|o| o.azimuth = Some(f64::NAN), "azimuth");
        fails(&[0], &|o| o.elevation = 91.0, "from -90 to 90");
        fails(&[0], &|o| o.elevation = f64::NAN, "from -90 to 90");
    }
}
