//! What `denoise` and `complete` tell of what they did: columns of the table, and lines at the end.

use super::messages;
use crate::io::Columns;
use crate::io::csv::{AddedColumn, After};
use crate::io::text::push_f64;
use crate::pose::Status;
use crate::restore::{BoundModel, RestoredFrames};
use ndarray::ArrayView2;

/// The columns that `--status` adds.
pub fn status_columns(status: bool, columns: &Columns) -> Vec<AddedColumn> {
    if !status {
        return Vec::new();
    }
    let names = columns.points.iter().enumerate();
    let of_points = names.flat_map(|(p, n)| {
        [
            AddedColumn::new(format!("{n}.status"), After::Point(p)),
            AddedColumn::new(format!("{n}.sd"), After::Point(p)),
        ]
    });
    of_points
        .chain([AddedColumn::new("unlike", After::All)])
        .collect()
}

/// Their cells for one frame: points that the model does not know are as they were.
pub fn status_cells(
    status: bool,
    job: &BoundModel,
    columns: &Columns,
    restored: &RestoredFrames,
    t: usize,
    before: &[f64],
) -> Vec<String> {
    if !status {
        return Vec::new();
    }
    let mut of_point: Vec<(Status, f64)> = (0..columns.points.len())
        .map(|p| {
            let missing = before[3 * p..3 * p + 3].iter().any(|v| v.is_nan());
            (
                if missing {
                    Status::Unknown
                } else {
                    Status::Observed
                },
                f64::NAN,
            )
        })
        .collect();
    for p in 0..restored.points() {
        if let Some(at) = job.in_table(p) {
            of_point[at] = restored.of_point(t, p);
        }
    }
    of_point
        .into_iter()
        .flat_map(|(status, s)| [status.name().to_string(), number((s * 1e4).round() / 1e4)])
        // Rounded up, so that only 0 is 0.
        .chain([number((restored.unlike[t] * 10.0).ceil() / 10.0)])
        .collect()
}

/// A cell; empty for NaN.
fn number(value: f64) -> String {
    let mut text = Vec::new();
    push_f64(&mut text, value);
    String::from_utf8(text).unwrap_or_default()
}

/// What is said at the end.
#[derive(Default)]
pub struct RunSummary {
    frames: usize,
    too_little: usize,
    filled: usize,
    rejected: usize,
    left: usize,
    /// Whether gaps may be left for their length.
    pub max_gap: bool,
    noise: f64,
    unlike: usize,
}

impl RunSummary {
    /// Nothing counted yet.
    pub fn new(max_gap: bool) -> RunSummary {
        RunSummary {
            max_gap,
            ..RunSummary::default()
        }
    }

    /// Counts restored frames, which were `before`.
    pub fn add(
        &mut self,
        job: &BoundModel,
        restored: &RestoredFrames,
        before: ArrayView2<'_, f64>,
    ) {
        self.noise += restored.noise * before.nrows() as f64;
        self.frames += before.nrows();
        self.too_little += restored.too_little;
        let points = restored.points().max(1);
        let of_table = |at: usize| job.in_table(at % points).is_some();
        let count = |status: Status| {
            let all = restored.status.iter().enumerate();
            all.filter(|(at, s)| **s == status && of_table(*at)).count()
        };
        self.filled += count(Status::Inferred);
        self.rejected += count(Status::Rejected);
        self.left += count(Status::Unknown);
        self.unlike += restored.unlike.iter().filter(|u| **u > 0.0).count();
    }

    /// Says what was counted; `too_little` is what too little was seen for, `status` whether it stands in the table too.
    pub fn report(&self, too_little: &str, status: bool) {
        if self.too_little > 0 {
            messages::info(&format!(
                "{} of {} frames {too_little}",
                self.too_little, self.frames
            ));
        }
        if self.rejected > 0 {
            messages::info(&format!("ignored {} outliers", self.rejected));
        }
        if self.unlike > 0 {
            let which = if status {
                "the column unlike"
            } else {
                "--status"
            };
            messages::info(&format!(
                "{} of {} frames have a pose unlike all training poses ({which} shows by how much)",
                self.unlike, self.frames
            ));
        }
        if self.max_gap && self.left > 0 {
            messages::info(&format!("{} points left empty", self.left));
        }
        messages::debug(&format!(
            "{} frames, {} points filled",
            self.frames, self.filled
        ));
        if self.noise > 0.0 {
            messages::debug(&format!(
                "noise {:.3} cm per coordinate",
                self.noise / self.frames.max(1) as f64
            ));
        }
    }
}
