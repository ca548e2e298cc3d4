//! Figures of restored poses: one pose under all models (Lai et al.'s figure 3), poses from two
//! dimensions (figure 5), and a take completed frame by frame (figure 6). Each figure can be
//! turned; the take plays.

use super::BenchmarkReport;
use crate::Result;
use crate::benchmark::dataset::Dataset;
use crate::benchmark::examples::{ExampleKind, ExamplePoses};
use crate::benchmark::task::{DamagedPoses, Task};
use crate::draw::html::escape;
use crate::draw::player;
use crate::draw::scene::{Figure, Scene, Status};
use crate::draw::text_table::short;
use crate::pose::joints;
use ndarray::{Array2, ArrayView2, Axis};
use std::fmt::Write;
use std::ops::Range;

/// Largest number of models in a figure, those with the lowest errors.
const MAX_MODELS: usize = 24;

/// The poses of one kind of example: (frames, 3 J) each, cm.
struct Restored {
    damaged: DamagedPoses,
    /// (frames, J): points that sparse noise has changed.
    changed: Option<Array2<Status>>,
    /// Estimates by model, the model with the lowest error first.
    estimates: Vec<(String, Array2<f64>)>,
}

/// The figures as HTML; empty if no task has examples.
///
/// # Errors
/// As [`ExamplePoses::damaged`] and [`player::page`].
pub(crate) fn figures(report: &BenchmarkReport<'_>, poses: &ExamplePoses) -> Result<String> {
    let mut out = String::new();
    let (dataset, settings) = (report.dataset(), &report.benchmark.settings);
    let kinds: Vec<ExampleKind> = (settings.tasks.iter())
        .flat_map(|task| ExampleKind::of(*task))
        .collect();
    if let Some(&row) = poses.pose_rows.first() {
        let frame = frame_name(dataset, row);
        let _ = write!(
            out,
            "<h3>One pose under all models</h3><p>{frame}, as in figure 3 of Lai et al.</p>"
        );
        for kind in kinds.iter().filter(|k| matches!(k, ExampleKind::Pose(_))) {
            let restored = Restored::new(report, poses, *kind)?;
            restored.draw(&mut out, dataset, 0..1, damage_text(*kind), 1.0)?;
        }
    }
    if kinds.contains(&ExampleKind::Planar) {
        out.push_str(
            "<h3>From two dimensions to a pose</h3><p>The models are given x and y of each joint, \
             as in a picture from the front, and no depth: figure 5 of Lai et al.</p>",
        );
        let restored = Restored::new(report, poses, ExampleKind::Planar)?;
        for (i, &row) in poses.pose_rows.iter().enumerate() {
            let caption = format!("{}. ", frame_name(dataset, row));
            restored.draw(&mut out, dataset, i..i + 1, &caption, 1.0)?;
        }
    }
    if let (Some(&row), true) = (poses.take_rows.first(), kinds.contains(&ExampleKind::Take)) {
        let frames = poses.take_rows.len();
        let _ = write!(
            out,
            "<h3>A take completed by all models</h3><p>{} and on, {frames} frames, {:.1} s: \
             figure 6 of Lai et al. Each frame is completed by itself from {}. The take is the \
             longest of the test takes.</p>",
            frame_name(dataset, row),
            frames as f64 / poses.rate,
            escape(&settings.observe.join(", ")),
        );
        let restored = Restored::new(report, poses, ExampleKind::Take)?;
        restored.draw(&mut out, dataset, 0..frames, "", poses.rate)?;
    }
    Ok(out)
}

/// `Take 07_01, frame 12 of 300`, frames counted from 0.
fn frame_name(dataset: &Dataset, row: usize) -> String {
    let take = &dataset.takes[dataset.take_of(row)];
    let frame = row - take.rows.start;
    format!(
        "Take {}, frame {frame} of {}",
        escape(&take.name),
        take.rows.len()
    )
}

fn damage_text(kind: ExampleKind) -> &'static str {
    match kind {
        ExampleKind::Pose(Task::Dense) => "Noise of 1 asf on every coordinate. ",
        ExampleKind::Pose(Task::Sparse) => {
            "Noise of 1 asf on a fifth of the joints (marked as changed; the models are not told \
             which). "
        }
        _ => "The models are given the observed joints alone, without noise. ",
    }
}

impl Restored {
    fn new(
        report: &BenchmarkReport<'_>,
        poses: &ExamplePoses,
        kind: ExampleKind,
    ) -> Result<Restored> {
        let observe = &report.benchmark.settings.observe;
        let damaged = poses.damaged(report.dataset(), observe, kind)?;
        let (truth, shape) = (&damaged.truth, damaged.truth.dim());
        let changed = (kind == ExampleKind::Pose(Task::Sparse)).then(|| {
            Array2::from_shape_fn((shape.0, shape.1 / 3), |(t, p)| {
                if (3 * p..3 * p + 3).any(|c| damaged.y[[t, c]] != truth[[t, c]]) {
                    Status::Changed
                } else {
                    Status::Observed
                }
            })
        });
        let error = |model: &str| {
            let own = report
                .summary
                .iter()
                .find(|r| r.model == model && r.split == poses.split && r.task == kind.task());
            own.map_or(f64::INFINITY, |r| r.mse)
        };
        let restored = report.results.iter().filter_map(|result| {
            let case = &result.case;
            let is_own =
                (case.split, case.seed, case.task) == (poses.split, poses.seed, kind.task());
            let rows = result
                .examples
                .as_ref()
                .filter(|_| is_own)?
                .get(kind.name())?;
            let array = Array2::from_shape_vec(shape, rows.concat()).ok()?;
            Some((case.model.clone(), array))
        });
        let mut estimates: Vec<(String, Array2<f64>)> = restored.collect();
        estimates.sort_by(|a, b| error(&a.0).total_cmp(&error(&b.0)));
        estimates.truncate(MAX_MODELS);
        Ok(Restored {
            damaged,
            changed,
            estimates,
        })
    }

    /// Appends a player of some of the frames, with its caption.
    fn draw(
        &self,
        out: &mut String,
        dataset: &Dataset,
        frames: Range<usize>,
        caption: &str,
        rate: f64,
    ) -> Result<()> {
        let points = &dataset.points;
        let parents = joints::parents_by_name(points).into_iter().enumerate();
        let bones: Vec<(usize, usize)> = parents.filter_map(|(c, p)| Some((p?, c))).collect();
        let rows = || frames.clone().into();
        let truth = self.damaged.truth.slice_axis(Axis(0), rows());
        let damaged = self.damaged.y.slice_axis(Axis(0), rows());
        let changed = self.changed.as_ref();
        let changed = changed.map(|c| c.slice_axis(Axis(0), rows()));
        let figure = |name, xyz, status| Figure {
            status,
            ..Figure::new(name, xyz)
        };
        let mut figures = vec![
            figure("truth", truth, None),
            figure("input", damaged, changed),
        ];
        let mut notes = vec![String::new(); 2];
        for (model, estimate) in &self.estimates {
            let estimate = estimate.slice_axis(Axis(0), rows());
            figures.push(figure(model, estimate, None));
            notes.push(format!("{} cm", short(rms(estimate, truth))));
        }
        let scene = Scene {
            points,
            bones: &bones,
            rate,
            figures,
            notes: &notes,
            behind: Some(0),
            start: frames.len() / 2,
            ..Scene::default()
        };
        let play = match frames.len() {
            0 | 1 => "",
            _ => " Press play; all panels move together.",
        };
        let _ = write!(
            out,
            "<figure class=\"poses\">{}<figcaption>{caption}The truth is drawn faintly behind \
             each estimate; the number is the RMS error of a coordinate here. The model with the \
             lowest error on all test poses comes first.{play} Drag to turn.</figcaption></figure>",
            player::part(&scene)?
        );
        Ok(())
    }
}

/// RMS difference of a coordinate, cm.
fn rms(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    (squares.sum::<f64>() / a.len().max(1) as f64).sqrt()
}
