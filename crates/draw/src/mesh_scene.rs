//! A scene of triangle meshes to draw.
//!
//! [`figure::mesh::svg`](super::figure::mesh::svg) and
//! [`player::mesh::page`](super::player::mesh::page) draw the same [`MeshScene`].

use super::scene::Table;
use crate::{Error, Place, Result};
use ndarray::{ArrayView2, ArrayView3, Axis};

/// Coordinates beyond this cannot be told apart in single precision.
const MAX_COORDINATE: f32 = 1e9;

/// A sequence of meshes of one topology.
#[derive(Debug, Clone, Copy)]
pub struct MeshFigure<'a> {
    /// The caption; messages call the figure so.
    pub name: &'a str,
    /// Frames x vertices x 3, y up: centimeters if [`MeshScene::in_cm`], otherwise of any unit.
    pub vertices: ArrayView3<'a, f32>,
    /// The corners of the triangles: vertices counted from 0, anticlockwise as seen from outside.
    pub faces: &'a [[u32; 3]],
    /// A name for each frame, such as its file's; may be empty.
    pub labels: &'a [String],
}

/// One or more sequences of meshes, in one space.
#[derive(Debug, Clone, Default)]
pub struct MeshScene<'a> {
    /// The heading.
    pub title: &'a str,
    /// The figures, in the order of their panels. The first is the reference for camera and
    /// ground.
    pub figures: Vec<MeshFigure<'a>>,
    /// Frames a second, if known: finite and above 0.
    pub rate: Option<f64>,
    /// Whether lengths are centimeters; otherwise no lengths are written.
    pub in_cm: bool,
    /// A sentence below the heading (page only).
    pub note: Option<&'a str>,
    /// A table below the figures (page only).
    pub table: Option<Table>,
    /// The credit line for the data, at the end.
    pub credit: Option<&'a str>,
}

impl<'a> MeshFigure<'a> {
    /// The number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.vertices.len_of(Axis(0))
    }

    /// The vertices of a frame, vertices x 3.
    pub(super) fn frame(&self, frame: usize) -> ArrayView2<'a, f32> {
        self.vertices.index_axis_move(Axis(0), frame)
    }

    /// Lowest and highest x, y, z of a frame.
    pub(super) fn extent(&self, frame: usize) -> [[f32; 2]; 3] {
        let mut extent = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
        for vertex in self.frame(frame).rows() {
            for (known, v) in extent.iter_mut().zip(vertex) {
                *known = [known[0].min(*v), known[1].max(*v)];
            }
        }
        extent
    }

    /// The largest side of the box around a frame, over all frames.
    pub(super) fn largest_side(&self) -> f64 {
        let sides = (0..self.frames()).flat_map(|t| self.extent(t));
        let sides = sides.map(|[low, high]| f64::from(high) - f64::from(low));
        sides.fold(0.0, f64::max)
    }

    fn check(&self) -> Result<()> {
        let fail = |what: String| Err(Error::data(Place::file(self.name), what));
        let (frames, vertices, axes) = self.vertices.dim();
        if frames == 0 {
            return fail("has no meshes to draw".into());
        }
        if vertices == 0 || axes != 3 {
            return fail("has no vertices".into());
        }
        if self.faces.is_empty() {
            return fail("has no faces to draw".into());
        }
        if let Some(corner) = self
            .faces
            .iter()
            .flatten()
            .find(|v| **v as usize >= vertices)
        {
            return fail(format!(
                "a face names vertex {corner}, there are {vertices}"
            ));
        }
        let is_bad = |v: &f32| !(v.abs() <= MAX_COORDINATE);
        if let Some(((frame, vertex, _), v)) = self.vertices.indexed_iter().find(|(_, v)| is_bad(v))
        {
            return fail(format!(
                "mesh {frame}, vertex {vertex} (counted from 0): {v} is no coordinate to draw"
            ));
        }
        Ok(())
    }
}

impl MeshScene<'_> {
    /// Checks that the meshes can be drawn.
    ///
    /// # Errors
    /// [`Error::Data`], with the figure's name: no meshes, vertices or faces, a face of a vertex
    /// that is not there, a coordinate that is not finite. [`Error::Usage`]: a rate that is not
    /// above 0.
    pub(crate) fn check(&self) -> Result<()> {
        if let Some(rate) = self.rate.filter(|r| !(r.is_finite() && *r > 0.0)) {
            return Err(Error::usage(format!("rate {rate} must be above 0")));
        }
        self.figures.iter().try_for_each(MeshFigure::check)
    }
}

/// A round length (1, 2 or 5 times a power of 10) of about a quarter of `size`.
pub(super) fn round_length(size: f64) -> f64 {
    let wanted = (size / 4.0).max(f64::MIN_POSITIVE);
    let power = 10f64.powf(wanted.log10().floor());
    // The largest of the three that is not much larger than wanted.
    let step = [5.0, 2.0, 1.0]
        .into_iter()
        .find(|s| s * power <= 1.2 * wanted);
    step.unwrap_or(1.0) * power
}

/// A length in centimeters as text: meters from one meter on, millimeters below one centimeter.
pub(super) fn length_text(cm: f64) -> String {
    let (value, unit) = match cm {
        _ if cm >= 100.0 => (cm / 100.0, "m"),
        _ if cm >= 1.0 => (cm, "cm"),
        _ => (cm * 10.0, "mm"),
    };
    // Two digits that count are enough, and `0.30000000000000004` is none.
    let digits = if value >= 1.0 {
        0
    } else {
        1 - value.log10().floor() as i32
    };
    let text = format!("{value:.*}", digits.max(0) as usize);
    let text = if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        &text
    };
    format!("{text} {unit}")
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ndarray::Array3;

    /// A closed cube from -1 to 1, faces anticlockwise as seen from outside.
    pub(crate) fn cube() -> (Array3<f32>, Vec<[u32; 3]>) {
        let corner = |(_, v, a): (usize, usize, usize)| if v >> a & 1 == 1 { 1.0 } else { -1.0 };
        let quads: [[u32; 4]; 6] = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        (
            Array3::from_shape_fn((1, 8, 3), corner),
            quads.into_iter().flat_map(halves).collect(),
        )
    }

    /// A scene of one figure.
    pub(crate) fn scene<'a>(vertices: &'a Array3<f32>, faces: &'a [[u32; 3]]) -> MeshScene<'a> {
        MeshScene {
            figures: vec![MeshFigure {
                name: "m",
                vertices: vertices.view(),
                faces,
                labels: &[],
            }],
            ..MeshScene::default()
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_named() {
        let (vertices, faces) = cube();
        scene(&vertices, &faces).check().unwrap();
        let fails = |vertices: &Array3<f32>, faces: &[[u32; 3]], part: &str| {
            let e = scene(vertices, faces).check().unwrap_err().to_string();
            assert!(e.starts_with("m: ") && e.contains(part), "{e}");
        };
        fails(&vertices, &[], "no faces");
        fails(&vertices, &[[0, 1, 8]], "vertex 8, there are 8");
        fails(&Array3::zeros((0, 8, 3)), &faces, "no meshes");
        fails(&Array3::zeros((1, 0, 3)), &faces, "no vertices");
        for bad in [f32::NAN, f32::INFINITY, 1e30] {
            let mut vertices = vertices.clone();
            vertices[[0, 5, 1]] = bad;
            fails(&vertices, &faces, "mesh 0, vertex 5");
        }
        for rate in [0.0, -1.0, f64::NAN] {
            let mut scene = scene(&vertices, &faces);
            scene.rate = Some(rate);
            assert_eq!(scene.check().unwrap_err().exit_code(), 2);
        }
    }

    #[test]
    fn lengths_are_round() {
        for (size, step) in [
            (190.0, 50.0),
            (4.0, 1.0),
            (0.8, 0.2),
            (1.9, 0.5),
            (9e3, 2e3),
        ] {
            assert!((round_length(size) / step - 1.0).abs() <= 1e-9, "{size}");
        }
        for (cm, text) in [
            (50.0, "50 cm"),
            (200.0, "2 m"),
            (0.5, "5 mm"),
            (0.02, "0.2 mm"),
        ] {
            assert_eq!(length_text(cm), text);
        }
    }
}
