//! The report's figures: a pose under all models (the paper's figure 3), 2-D points to poses (figure 5), a take completed
//! by all (figure 6). Each can be turned; the last plays.

use super::tables::{Results, short};
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

/// What is drawn of one sight: the truth, what is seen, and the answers, best model first.
struct Drawn {
    truth: Array2<f64>,
    seen: Array2<f64>,
    /// The points that noise has hit, where it did not hit all.
    hit: Option<Array2<Status>>,
    answers: Vec<(String, Array2<f64>)>,
}

/// The section, empty where there are no examples.
///
/// # Errors
/// As [`ExamplePoses::seen`].
pub(super) fn section(results: &Results<'_>) -> Result<String> {
    let mut out = String::new();
    let Some(scenes) = &results.examples.scenes else {
        return Ok(out);
    };
    let sights = ExampleKind::of(&results.settings.tasks);
    let still: Vec<ExampleKind> = sights
        .iter()
        .copied()
        .filter(|s| matches!(s, ExampleKind::Still(_)))
        .collect();
    if let Some(&row) = scenes.stills.first() {
        let _ = write!(
            out,
            "<h3>One pose under all models</h3><p>{}, as in the paper's figure 3.</p>",
            whence(results.data, row)
        );
        for sight in still {
            let drawn = Drawn::of(results, scenes, sight)?;
            player_of(&mut out, results, &drawn, 0..1, words(sight), 1.0)?;
        }
    }
    if sights.contains(&ExampleKind::Flat) {
        out.push_str(
            "<h3>From two dimensions to a pose</h3><p>Of every joint x and y are seen, as in a picture from the front, and no \
             depth: the paper's figure 5.</p>",
        );
        let drawn = Drawn::of(results, scenes, ExampleKind::Flat)?;
        for (i, &row) in scenes.stills.iter().enumerate() {
            let caption = format!(
                "{}. What is seen lies in one plane. ",
                whence(results.data, row)
            );
            player_of(&mut out, results, &drawn, i..i + 1, &caption, 1.0)?;
        }
    }
    if let Some(&row) = scenes
        .stretch
        .first()
        .filter(|_| sights.contains(&ExampleKind::Stretch))
    {
        let seconds = scenes.stretch.len() as f64 / scenes.rate;
        let _ = write!(
            out,
            "<h3>A take completed by all models</h3><p>{} and on, {} frames, {seconds:.1} s: the paper's figure 6. Each pose is \
             completed by itself from {}; the take is the one tested that looks most like a run or a walk.</p>",
            whence(results.data, row),
            scenes.stretch.len(),
            escape(&results.settings.observe.join(", ")),
        );
        let drawn = Drawn::of(results, scenes, ExampleKind::Stretch)?;
        let all = 0..scenes.stretch.len();
        player_of(&mut out, results, &drawn, all, "", scenes.rate)?;
    }
    Ok(out)
}

/// Which pose it is.
fn whence(data: &Dataset, row: usize) -> String {
    let take = &data.takes[data.take_of(row)];
    format!(
        "Take {}, frame {} of {}",
        escape(&take.name),
        row - take.rows.start,
        take.rows.len()
    )
}

fn words(sight: ExampleKind) -> &'static str {
    match sight {
        ExampleKind::Still(Task::Dense) => "Dense noise of 1 asf on every coordinate. ",
        ExampleKind::Still(Task::Sparse) => {
            "Noise of 1 asf on a fifth of the joints; which, is not told (they are marked as changed). "
        }
        _ => "Only the observed joints are seen, exactly. ",
    }
}

impl Drawn {
    fn of(results: &Results<'_>, scenes: &ExamplePoses, sight: ExampleKind) -> Result<Drawn> {
        let (truth, damaged) = scenes.seen(results.data, results.settings, sight)?;
        let hit = (sight == ExampleKind::Still(Task::Sparse)).then(|| {
            let shape = (truth.nrows(), truth.ncols() / 3);
            Array2::from_shape_fn(shape, |(t, p)| {
                let moved = (3 * p..3 * p + 3).any(|c| damaged.y[[t, c]] != truth[[t, c]]);
                if moved {
                    Status::Changed
                } else {
                    Status::Observed
                }
            })
        });
        let task = match sight {
            ExampleKind::Still(task) => task,
            ExampleKind::Flat | ExampleKind::Stretch => Task::Complete,
        };
        let error = |model: &str| {
            let own = results
                .rows
                .iter()
                .find(|r| r.model == model && r.split == scenes.split && r.task == task);
            own.map_or(f64::INFINITY, |r| r.mse)
        };
        let mut answers: Vec<(String, Array2<f64>)> = results
            .examples
            .all
            .iter()
            .filter_map(|e| Some((e.model.clone(), e.poses(sight, truth.dim())?)))
            .collect();
        answers.sort_by(|a, b| error(&a.0).total_cmp(&error(&b.0)));
        Ok(Drawn {
            truth,
            seen: damaged.y,
            hit,
            answers,
        })
    }
}

/// A player of some of the frames, with its caption.
fn player_of(
    out: &mut String,
    results: &Results<'_>,
    drawn: &Drawn,
    frames: std::ops::Range<usize>,
    caption: &str,
    rate: f64,
) -> Result<()> {
    let points = &results.data.points;
    let parents = joints::parents_by_name(points);
    let bones = parents.iter().enumerate();
    let bones: Vec<(usize, usize)> = bones.filter_map(|(c, p)| Some(((*p)?, c))).collect();
    let cut = |a: &Array2<f64>| a.slice_axis(Axis(0), frames.clone().into()).to_owned();
    let (truth, seen) = (cut(&drawn.truth), cut(&drawn.seen));
    let hit = drawn.hit.as_ref();
    let hit = hit.map(|h| h.slice_axis(Axis(0), frames.clone().into()).to_owned());
    let named: Vec<(&str, Array2<f64>)> = drawn
        .answers
        .iter()
        .map(|(model, answer)| (model.as_str(), cut(answer)))
        .collect();
    let error = |(_, answer): &(&str, Array2<f64>)| {
        format!("{} cm", short(rms(answer.view(), truth.view())))
    };
    let before = ["", ""].map(String::from);
    let notes: Vec<String> = before.into_iter().chain(named.iter().map(error)).collect();
    let figure = |name, xyz, status| Figure { name, xyz, status };
    let mut figures = vec![
        figure("truth", truth.view(), None),
        figure("what is seen", seen.view(), hit.as_ref().map(|h| h.view())),
    ];
    figures.extend(named.iter().map(|(n, a)| figure(n, a.view(), None)));
    let scene = Scene {
        title: "",
        points,
        bones: &bones,
        rate,
        figures,
        notes: &notes,
        behind: Some(0),
        start: frames.len() / 2,
        ..Scene::default()
    };
    let moves = match frames.len() {
        0 | 1 => "",
        _ => " Press play; all panels move together.",
    };
    let _ = write!(
        out,
        "<figure class=\"poses\">{}<figcaption>{caption}Behind each answer, faint, the truth; below each name its RMS error \
         of a coordinate here, the model with the lowest error of all first.{moves} Drag to turn.</figcaption></figure>",
        player::part(&scene, &player::Options::default())?
    );
    Ok(())
}

/// RMS of a coordinate, cm.
fn rms(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    (squares.sum::<f64>() / a.len().max(1) as f64).sqrt()
}
