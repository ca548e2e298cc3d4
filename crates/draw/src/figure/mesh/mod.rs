//! Triangle meshes as SVG: chosen frames side by side, seen by parallel rays, shaded in a few
//! greys.
//!
//! The picture holds shapes only, and only those that are seen: a body of 27,000 triangles takes
//! some 90 KB.

mod outline;
mod visible;

use super::shapes::{PALE, n, shortened, wrapped};
use super::{BETWEEN, DOCUMENT, EDGE, Options};
use crate::html::{escape, fill};
use crate::mesh_scene::{MeshScene, length_text, round_length};
use crate::{Error, Result};
use ndarray::Array2;
use visible::{SHADES, layers};

/// The height that the tallest mesh is drawn with, and the greatest width of the widest (px).
const HEIGHT: f64 = 260.0;
const WIDEST: f64 = 420.0;
/// Units of a path in a pixel.
const UNITS: f64 = 10.0;
/// The darkest and the lightest shade: red, green, blue.
const DARK: [f64; 3] = [52.0, 63.0, 77.0];
const LIGHT: [f64; 3] = [222.0, 230.0, 239.0];

/// A mesh of the picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Still {
    /// The figure of the scene.
    pub figure: usize,
    /// Its frame, counted from 0.
    pub frame: usize,
    /// What stands below it.
    pub caption: String,
}

/// A row of meshes on one ground. Frames of one figure keep their heights above it; meshes of
/// several figures, which need not share an origin, all stand on it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Row {
    /// What stands above it; may be empty.
    pub name: String,
    /// The meshes, from left to right.
    pub stills: Vec<Still>,
}

/// Draws rows of meshes as an SVG document, all at one scale: as seen from the front (+z) and a
/// little from above, unless the options say otherwise. The layout of the options does not count.
/// The same scene gives the same bytes.
///
/// # Errors
/// [`Error::Data`]: no meshes, vertices or faces, a face of a vertex that is not there, a
/// coordinate that is not finite. [`Error::Usage`]: a rate that is not above 0, an angle out of
/// range, a row that names a figure or frame that is not there.
pub fn svg(scene: &MeshScene<'_>, rows: &[Row], options: &Options) -> Result<String> {
    scene.check()?;
    options.check()?;
    let view = View::new(options);
    let mut panels: Vec<Vec<Panel>> = rows
        .iter()
        .map(|row| row.stills.iter().map(|s| panel(scene, s, &view)).collect())
        .collect::<Result<_>>()?;
    for (row, panels) in rows.iter().zip(&mut panels) {
        if row
            .stills
            .windows(2)
            .any(|two| two[0].figure != two[1].figure)
        {
            panels.iter_mut().for_each(Panel::stand);
        }
    }
    Ok(draw(scene, rows, &panels))
}

/// Parallel rays.
struct View {
    azimuth: (f64, f64),
    elevation: (f64, f64),
}

impl View {
    fn new(options: &Options) -> View {
        View {
            azimuth: options.azimuth.unwrap_or(0.0).to_radians().sin_cos(),
            elevation: options.elevation.to_radians().sin_cos(),
        }
    }

    /// Right, up and toward the viewer.
    fn project(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let ((sin, cos), (tilt_sin, tilt_cos)) = (self.azimuth, self.elevation);
        let (right, near) = (x * cos - z * sin, x * sin + z * cos);
        [
            right,
            y * tilt_cos - near * tilt_sin,
            near * tilt_cos + y * tilt_sin,
        ]
    }
}

/// The part of the view that a picture shows.
pub(super) struct Window {
    /// The left and the upper edge, in the mesh's unit.
    left: f64,
    high: f64,
    /// Units of the picture in one of the mesh.
    scale: f64,
    /// Width and height, in units of the picture.
    size: [f64; 2],
}

impl Window {
    /// The pixel of a position in the view, y down.
    fn pixel(&self, [right, up, _]: [f64; 3]) -> [i32; 2] {
        let whole = |v: f64| (v * self.scale).round() as i32;
        [whole(right - self.left), whole(self.high - up)]
    }
}

/// A mesh as it is seen, around the middle of its box on the ground.
struct Panel<'a> {
    vertices: Array2<f64>,
    faces: &'a [[u32; 3]],
    /// Lowest and highest right and up.
    across: [f64; 2],
    up: [f64; 2],
}

impl Panel<'_> {
    /// Moves the mesh up or down, so that its lowest point is at 0.
    fn stand(&mut self) {
        let low = self.up[0];
        self.vertices.column_mut(1).mapv_inplace(|v| v - low);
        self.up = self.up.map(|v| v - low);
    }
}

fn panel<'a>(scene: &MeshScene<'a>, still: &Still, view: &View) -> Result<Panel<'a>> {
    let Some(figure) = scene.figures.get(still.figure) else {
        return Err(Error::usage(format!("there is no figure {}", still.figure)));
    };
    if still.frame >= figure.frames() {
        let (frame, count) = (still.frame, figure.frames());
        let what = format!("frame {frame}: there are {count}, counted from 0");
        return Err(Error::usage(what));
    }
    let [x, _, z] = figure.extent(still.frame);
    let middle = |[low, high]: [f32; 2]| (f64::from(low) + f64::from(high)) / 2.0;
    let middle = [middle(x), 0.0, middle(z)];
    let source = figure.frame(still.frame);
    let mut vertices = Array2::zeros(source.dim());
    let (mut across, mut up) = (
        [f64::INFINITY, f64::NEG_INFINITY],
        [f64::INFINITY, f64::NEG_INFINITY],
    );
    for (from, mut to) in source.outer_iter().zip(vertices.outer_iter_mut()) {
        let at = view.project([0, 1, 2].map(|a| f64::from(from[a]) - middle[a]));
        to.assign(&ndarray::aview1(&at));
        across = [across[0].min(at[0]), across[1].max(at[0])];
        up = [up[0].min(at[1]), up[1].max(at[1])];
    }
    Ok(Panel {
        vertices,
        faces: figure.faces,
        across,
        up,
    })
}

/// The largest of some values, of none 0.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

fn draw(scene: &MeshScene<'_>, rows: &[Row], panels: &[Vec<Panel>]) -> String {
    // Each row has a ground of its own: figures need not share an origin.
    let ups: Vec<[f64; 2]> = panels.iter().map(|row| row_height(row)).collect();
    let wide = largest(panels.iter().flatten().map(|p| p.across[1] - p.across[0]));
    let high = largest(ups.iter().map(|[low, high]| high - low));
    let scale = (HEIGHT / high).min(WIDEST / wide);
    let scale = if scale.is_finite() { scale } else { 1.0 };
    // Narrow meshes still leave room for their captions.
    let column = (wide * scale).max(64.0) + BETWEEN;
    let columns = panels.iter().map(Vec::len).max().unwrap_or(0);

    let title = 8.6 * scene.title.chars().count() as f64;
    let width = 2.0 * EDGE
        + (columns as f64 * column - BETWEEN)
            .max(title.min(1600.0))
            .max(240.0);
    let start = (width - columns as f64 * column + BETWEEN) / 2.0;
    let (mut body, mut y) = heading(scene, scale, high.max(wide));
    for ((row, panels), [low, high]) in rows.iter().zip(panels).zip(ups) {
        if !row.name.is_empty() {
            let (name, at) = (escape(&row.name), n(y + 12.0));
            body += &format!("<text x=\"{EDGE}\" y=\"{at}\" font-weight=\"600\">{name}</text>\n");
            y += 22.0;
        }
        for (i, (panel, still)) in panels.iter().zip(&row.stills).enumerate() {
            let middle = start + i as f64 * column + (column - BETWEEN) / 2.0;
            let half = (panel.across[1] - panel.across[0]) * scale / 2.0;
            let window = Window {
                left: panel.across[0],
                high,
                scale: UNITS * scale,
                size: [2.0 * half * UNITS, (high - low) * scale * UNITS],
            };
            let at = format!("{} {}", n(middle - half), n(y));
            body += &solid(panel, &window, &at);
            let text = escape(&shortened(&still.caption, (column / 6.6) as usize));
            let (x, y) = (n(middle), n(y + (high - low) * scale + 18.0));
            body += &format!(
                "<text x=\"{x}\" y=\"{y}\" text-anchor=\"middle\" fill=\"{PALE}\">{text}</text>\n"
            );
        }
        y += (high - low) * scale + 34.0;
    }
    let credit = wrapped(scene.credit.unwrap_or_default(), (width - 2.0 * EDGE) / 5.6);
    for line in credit {
        let text = escape(&line);
        y += 13.0;
        let at = n(y - 6.0);
        body += &format!(
            "<text x=\"{EDGE}\" y=\"{at}\" font-size=\"9.5\" fill=\"{PALE}\">{text}</text>\n"
        );
    }
    let title = match scene.title {
        "" => "Meshes".into(),
        title => escape(title),
    };
    let (w, h) = (n(width), n(y + 4.0));
    fill(
        DOCUMENT,
        &[("w", &w), ("h", &h), ("title", &title), ("body", &body)],
    )
}

/// Lowest and highest column of a row.
fn row_height(row: &[Panel<'_>]) -> [f64; 2] {
    let mut up = row.iter().map(|p| p.up);
    let first = up.next().unwrap_or([0.0, 0.0]);
    up.fold(first, |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// The title and, where the unit is known, a bar of a round length; and where they end.
fn heading(scene: &MeshScene<'_>, scale: f64, size: f64) -> (String, f64) {
    let (mut out, mut y) = (String::new(), 16.0);
    if !scene.title.is_empty() {
        let title = escape(scene.title);
        out += &format!(
            "<text x=\"{EDGE}\" y=\"28\" font-size=\"15\" font-weight=\"600\">{title}</text>\n"
        );
        y = 44.0;
    }
    if scene.in_cm && size > 0.0 {
        let length = round_length(size);
        let (wide, text) = (n(length * scale), length_text(length));
        let (line, x) = (n(y + 6.0), n(EDGE + length * scale + 8.0));
        let below = n(y + 10.0);
        out += &format!(
            "<path d=\"M{EDGE} {line}m0 -3v6m0 -3h{wide}m0 -3v6\" \
             fill=\"none\" stroke=\"{PALE}\"/>\n\
             <text x=\"{x}\" y=\"{below}\" fill=\"{PALE}\">{text}</text>\n"
        );
        y += 26.0;
    }
    (out, y)
}

/// A mesh with its upper left corner at a pixel of the picture.
fn solid(panel: &Panel<'_>, window: &Window, at: &str) -> String {
    // The stroke closes the hair lines between neighboring areas.
    let mut out = format!(
        "<g transform=\"translate({at}) scale({})\" \
         stroke-width=\"4\" stroke-linejoin=\"round\">\n",
        1.0 / UNITS
    );
    for layer in layers(panel.vertices.view(), panel.faces, window) {
        let (color, path) = (color(layer.shade), outline::path(&layer.triangles));
        out += &format!("<path fill=\"{color}\" stroke=\"{color}\" d=\"{path}\"/>\n");
    }
    out + "</g>\n"
}

fn color(shade: usize) -> String {
    let share = shade as f64 / (SHADES - 1) as f64;
    let [r, g, b] = [0, 1, 2].map(|i| (DARK[i] + share * (LIGHT[i] - DARK[i])).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests;
