//! The panels, and the projection from world coordinates to the picture.

use super::{Layout, Picture};

/// Room (cm) around what is drawn.
const ROOM: f64 = 14.0;
/// The head's radius, as a share of the figure's size.
pub(crate) const HEAD: f64 = 0.039;

/// Frames of figures drawn at one position.
pub(crate) struct Panel {
    pub row: usize,
    pub column: usize,
    pub figures: Vec<usize>,
    pub frames: Vec<usize>,
    /// What is drawn in the panel's middle: x and z (cm).
    pub middle: [f64; 2],
}

/// The part of the view that every panel shows (cm on the paper).
#[derive(Clone, Copy)]
pub(crate) struct Window {
    pub left: f64,
    pub right: f64,
    pub low: f64,
    pub high: f64,
}

impl Picture<'_, '_> {
    pub(crate) fn panels(&self, frames: &[usize]) -> Vec<Panel> {
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
            .filter_map(|t| self.geometry.middle(*t))
            .collect();
        let count = seen.len().max(1) as f64;
        [0, 1].map(|axis| seen.iter().map(|m| m[axis]).sum::<f64>() / count)
    }

    /// Right, up and toward the viewer (cm), from where the panel's middle meets the ground.
    pub(crate) fn project(&self, [x, y, z]: [f64; 3], middle: [f64; 2]) -> [f64; 3] {
        let (x, y, z) = (x - middle[0], y - self.geometry.ground, z - middle[1]);
        let (sin, cos) = self.azimuth.sin_cos();
        let (tilt_sin, tilt_cos) = self.options.elevation.to_radians().sin_cos();
        let (right, near) = (x * cos - z * sin, x * sin + z * cos);
        let (up, near) = (
            y * tilt_cos - near * tilt_sin,
            near * tilt_cos + y * tilt_sin,
        );
        [right, up, near]
    }

    /// The window that holds all but the outermost 1/400 of the points on each side.
    pub(crate) fn window(&self, panels: &[Panel]) -> Window {
        let (mut across, mut up) = (Vec::new(), Vec::new());
        for panel in panels {
            for (f, t, p) in self.every_point(panel) {
                if let Some(position) = self.geometry.at(f, t, p) {
                    let [right, high, _] = self.project(position, panel.middle);
                    across.push(right);
                    up.push(high);
                }
            }
        }
        across.sort_by(f64::total_cmp);
        up.sort_by(f64::total_cmp);
        let ends = |sorted: &[f64]| {
            let outliers = sorted.len() / 400;
            let low = sorted.get(outliers).copied().unwrap_or(0.0);
            (
                low,
                sorted.iter().rev().nth(outliers).copied().unwrap_or(low),
            )
        };
        let ((left, right), (low, high)) = (ends(&across), ends(&up));
        let room = ROOM + HEAD * self.geometry.size;
        let half = 0.5 * (right - left).max(0.35 * self.geometry.size) + room;
        let middle = 0.5 * (left + right);
        let (left, right) = (middle - half, middle + half);
        Window {
            left,
            right,
            low: low.min(0.0) - room,
            high: high.max(0.0) + room,
        }
    }

    pub(crate) fn every_point(&self, panel: &Panel) -> impl Iterator<Item = (usize, usize, usize)> {
        let points = self.scene.points.len();
        panel.figures.iter().flat_map(move |f| {
            panel
                .frames
                .iter()
                .flat_map(move |t| (0..points).map(move |p| (*f, *t, p)))
        })
    }
}
