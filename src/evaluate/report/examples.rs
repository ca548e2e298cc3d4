//! Figures of restored poses: one pose under all models (the paper's figure 3), poses from two dimensions (figure 5), and
//! a take completed frame by frame (figure 6). Each figure can be turned; the take plays.

use super::BenchmarkReport;
use super::tables::short;
use crate::Result;
use crate::evaluate::benchmark::dataset::Dataset;
use crate::evaluate::benchmark::examples::{ExampleKind, ExamplePoses};
use crate::evaluate::benchmark::task::Task;
use crate::evaluate::html::escape;
use crate::evaluate::player;
use crate::evaluate::scene::{Figure, Scene, Status};
use crate::pose::joints;
use ndarray::{Array2, ArrayView2, Axis};
use std::fmt::Write;
use std::ops::Range;

/// The poses of one kind of example: (frames, 3 J) each, cm.
struct Restored {
    truth: Array2<f64>,
    damaged: Array2<f64>,
    /// (frames, J): points that sparse noise has changed.
    changed: Option<Array2<Status>>,
    /// Estimates by model, the model with the lowest error first.
    estimates: Vec<(String, Array2<f64>)>,
}

/// The figures as HTML; empty without examples.
///
/// # Errors
/// As [`ExamplePoses::damaged`] and [`player::page`].
pub fn figures(report: &BenchmarkReport<'_>) -> Result<String> {
    let mut out = String::new();
    let Some(poses) = &report.examples.poses else {
        return Ok(out);
    };
    let kinds = ExampleKind::of(&report.settings.tasks);
    if let Some(&row) = poses.pose_rows.first() {
        let place = frame_name(report.dataset, row);
        let _ = write!(
            out,
            "<h3>One pose under all models</h3><p>{place}, as in the paper's figure 3.</p>"
        );
        for kind in kinds.iter().filter(|k| matches!(k, ExampleKind::Pose(_))) {
            let restored = Restored::new(report, poses, *kind)?;
            restored.draw(&mut out, report, 0..1, damage_text(*kind), 1.0)?;
        }
    }
    if kinds.contains(&ExampleKind::Planar) {
        out.push_str(
            "<h3>From two dimensions to a pose</h3><p>The models are given x and y of each joint, as in a picture from the \
             front, and no depth: the paper's figure 5.</p>",
        );
        let restored = Restored::new(report, poses, ExampleKind::Planar)?;
        for (i, &row) in poses.pose_rows.iter().enumerate() {
            let caption = format!("{}. ", frame_name(report.dataset, row));
            restored.draw(&mut out, report, i..i + 1, &caption, 1.0)?;
        }
    }
    if let (Some(&row), true) = (poses.take_rows.first(), kinds.contains(&ExampleKind::Take)) {
        let frames = poses.take_rows.len();
        let _ = write!(
            out,
            "<h3>A take completed by all models</h3><p>{} and on, {frames} frames, {:.1} s: the paper's figure 6. Each frame is \
             completed by itself from {}. The take is the test take that looks most like a run or a walk.</p>",
            frame_name(report.dataset, row),
            frames as f64 / poses.rate,
            escape(&report.settings.observe.join(", ")),
        );
        let restored = Restored::new(report, poses, ExampleKind::Take)?;
        restored.draw(&mut out, report, 0..frames, "", poses.rate)?;
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
            "Noise of 1 asf on a fifth of the joints (marked as changed; the models are not told which). "
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
        let (truth, damaged) = poses.damaged(report.dataset, report.settings, kind)?;
        let changed = (kind == ExampleKind::Pose(Task::Sparse)).then(|| {
            Array2::from_shape_fn((truth.nrows(), truth.ncols() / 3), |(t, p)| {
                match (3 * p..3 * p + 3).any(|c| damaged.y[[t, c]] != truth[[t, c]]) {
                    true => Status::Changed,
                    false => Status::Observed,
                }
            })
        });
        let task = kind.task();
        let error = |model: &str| {
            let own = report
                .summary
                .iter()
                .find(|r| r.model == model && r.split == poses.split && r.task == task);
            own.map_or(f64::INFINITY, |r| r.mse)
        };
        let estimates = report.examples.methods.iter();
        let mut estimates: Vec<(String, Array2<f64>)> = estimates
            .filter_map(|e| Some((e.model.clone(), e.poses(kind, truth.dim())?)))
            .collect();
        estimates.sort_by(|a, b| error(&a.0).total_cmp(&error(&b.0)));
        Ok(Restored {
            truth,
            damaged: damaged.y,
            changed,
            estimates,
        })
    }

    /// Appends a player of some of the frames, with its caption.
    fn draw(
        &self,
        out: &mut String,
        report: &BenchmarkReport<'_>,
        frames: Range<usize>,
        caption: &str,
        rate: f64,
    ) -> Result<()> {
        let points = &report.dataset.points;
        let parents = joints::parents_by_name(points).into_iter().enumerate();
        let bones: Vec<(usize, usize)> = parents.filter_map(|(c, p)| Some((p?, c))).collect();
        let cut = |a: &Array2<f64>| a.slice_axis(Axis(0), frames.clone().into()).to_owned();
        let (truth, damaged) = (cut(&self.truth), cut(&self.damaged));
        let changed = self.changed.as_ref();
        let changed = changed.map(|c| c.slice_axis(Axis(0), frames.clone().into()));
        let estimates: Vec<Array2<f64>> = self.estimates.iter().map(|(_, e)| cut(e)).collect();
        let figure = |name, xyz, status| Figure { name, xyz, status };
        let mut figures = vec![
            figure("truth", truth.view(), None),
            figure("input", damaged.view(), changed),
        ];
        let mut notes = vec![String::new(); 2];
        for ((model, _), estimate) in self.estimates.iter().zip(&estimates) {
            figures.push(figure(model, estimate.view(), None));
            notes.push(format!("{} cm", short(rms(estimate.view(), truth.view()))));
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
            "<figure class=\"poses\">{}<figcaption>{caption}The truth is drawn faintly behind each estimate; the number is the RMS \
             error of a coordinate here. The model with the lowest error on all test poses comes first.{play} Drag to turn.\
             </figcaption></figure>",
            player::part(&scene, &player::Options::default())?
        );
        Ok(())
    }
}

/// RMS difference of a coordinate, cm.
fn rms(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    (squares.sum::<f64>() / a.len().max(1) as f64).sqrt()
}
