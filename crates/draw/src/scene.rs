//! A scene to draw: figures over the same frames, with title, notes and table.
//!
//! [`figure::svg`](super::figure::svg) and [`player::page`](super::player::page) draw the same
//! [`Scene`].

use crate::pair::{Paired, TakePair};
pub use crate::pose::FillMethod;
use crate::pose::Poses;
pub use crate::pose::Status;
use crate::{Error, Result};
use ndarray::ArrayView2;
use std::ops::Range;

/// One take or table. All figures of a scene have the same points and frames.
#[derive(Debug, Clone, Copy)]
pub struct Figure<'a> {
    /// The caption, such as "truth", "damaged" or "restored".
    pub name: &'a str,
    /// Frames x (3 x points): x, y, z of each point in centimeters, right-handed, y up.
    /// A point is missing where one of its three is not finite (or beyond 100 km); an axis that is
    /// missing throughout (a 2-D capture) is drawn as zero.
    pub xyz: ArrayView2<'a, f64>,
    /// Frames x points, if known. A point without coordinates is missing whatever its status.
    pub status: Option<ArrayView2<'a, Status>>,
    /// Frames x points, if known: the standard deviation of a coordinate, cm; NaN where unknown
    /// (page only).
    pub sd: Option<ArrayView2<'a, f64>>,
    /// Frames x points, if known: how a point was filled (page only).
    pub method: Option<ArrayView2<'a, Option<FillMethod>>>,
}

impl<'a> Figure<'a> {
    /// A figure without statuses.
    pub fn new(name: &'a str, xyz: ArrayView2<'a, f64>) -> Figure<'a> {
        Figure {
            name,
            xyz,
            status: None,
            sd: None,
            method: None,
        }
    }
}

/// A range of consecutive frames: a take, or what lies between two cuts in one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run<'a> {
    /// The take's name.
    pub name: &'a str,
    /// Its first frame, counted from 0 over the whole scene.
    pub first: usize,
    /// The time of that frame, in seconds.
    pub time: f64,
    /// Frames a second: finite and above 0.
    pub rate: f64,
}

/// A small table of text below the figures, scores for instance.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Table {
    /// What the table shows; may be empty.
    pub caption: String,
    /// The heads of the columns.
    pub header: Vec<String>,
    /// The rows, each as long as the header.
    pub rows: Vec<Vec<String>>,
    /// Where the first cell of a row leads to; may be shorter than the list of rows.
    pub links: Vec<String>,
}

/// One or more figures over the same frames.
#[derive(Debug, Clone, Default)]
pub struct Scene<'a> {
    /// The heading.
    pub title: &'a str,
    /// The points' names.
    pub points: &'a [String],
    /// Pairs of points to join, the one nearer to the root first; without any, only points are
    /// drawn.
    pub bones: &'a [(usize, usize)],
    /// From which point on they are markers: these, and the lines to them, are drawn thin (page
    /// only).
    pub markers: Option<usize>,
    /// Frames a second, of frames that are in no run: finite and above 0.
    pub rate: f64,
    /// The figures, in the order of their panels. The first is the reference for camera and ground
    /// unless another misses fewer points.
    pub figures: Vec<Figure<'a>>,
    /// Where runs begin, in rising order, the first at frame 0; empty: one run from time 0.
    pub runs: &'a [Run<'a>],
    /// A note beside the name of each figure (page only); may be shorter than the list of figures.
    pub notes: &'a [String],
    /// The figure that is drawn faintly behind each other one (page only).
    pub behind: Option<usize>,
    /// The frame that the page opens with, counted from 0.
    pub start: usize,
    /// A sentence below the heading.
    pub note: Option<&'a str>,
    /// A table below the figures (page only).
    pub table: Option<Table>,
    /// The credit line for the data, at the end.
    pub credit: Option<&'a str>,
    /// The two takes that the figures are, to be compared: each has its own bones.
    pub pair: Option<&'a TakePair>,
}

impl<'a> Scene<'a> {
    /// The scene of two takes, on `runs` of their timeline: those of [`pair_runs`].
    pub fn of_pair(pair: &'a TakePair, runs: &'a [Run<'a>]) -> Scene<'a> {
        let figure = |take: &'a Paired| Figure {
            name: &take.name,
            xyz: take.xyz.view(),
            status: take.status.as_ref().map(|s| s.view()),
            sd: take.sd.as_ref().map(|sd| sd.view()),
            method: take.method.as_ref().map(|m| m.view()),
        };
        Scene {
            points: &pair.points,
            rate: runs.first().map_or(1.0, |run| run.rate),
            figures: pair.takes.iter().map(figure).collect(),
            runs,
            pair: Some(pair),
            ..Scene::default()
        }
    }

    /// The pairs of points to join of a figure.
    pub(crate) fn bones_of(&self, figure: usize) -> &'a [(usize, usize)] {
        let own = self.pair.and_then(|pair| pair.takes.get(figure));
        own.map_or(self.bones, |take| &take.bones)
    }

    /// The number of frames (0 without figures).
    pub fn frames(&self) -> usize {
        self.figures.first().map_or(0, |figure| figure.xyz.nrows())
    }

    /// The take that a frame belongs to (empty without runs) and its time in seconds.
    pub(crate) fn moment(&self, frame: usize) -> (&str, f64) {
        let run = self.runs.iter().rev().find(|run| run.first <= frame);
        match run {
            Some(run) => (run.name, run.time + (frame - run.first) as f64 / run.rate),
            None => ("", frame as f64 / self.rate),
        }
    }

    /// Checks that the scene can be drawn.
    ///
    /// # Errors
    /// [`Error::Usage`] for a rate that is not above 0, a bone without its points, figures of
    /// different shapes, or runs out of order.
    pub(crate) fn check(&self) -> Result<()> {
        let usage = |what: String| Err(Error::usage(what));
        let points = self.points.len();
        let mut rates = self.runs.iter().map(|run| run.rate).chain([self.rate]);
        if let Some(rate) = rates.find(|rate| !(rate.is_finite() && *rate > 0.0)) {
            return usage(format!("rate {rate} must be above 0 frames a second"));
        }
        if let Some((a, b)) = self.bones.iter().find(|(a, b)| *a.max(b) >= points) {
            return usage(format!(
                "bone {a}-{b}: there are {points} points, counted from 0"
            ));
        }
        for figure in &self.figures {
            let wanted = (self.frames(), 3 * points);
            if figure.xyz.dim() != wanted {
                return usage(format!(
                    "figure {}: {:?} frames and columns, expected {wanted:?}",
                    figure.name,
                    figure.xyz.dim(),
                ));
            }
            let wanted = (self.frames(), points);
            let of_points = [
                ("statuses", figure.status.map(|s| s.dim())),
                ("deviations", figure.sd.map(|s| s.dim())),
                ("methods", figure.method.map(|m| m.dim())),
            ];
            for (what, dim) in of_points {
                if let Some(dim) = dim.filter(|dim| *dim != wanted) {
                    return usage(format!(
                        "figure {}: {what} are {dim:?} frames and points, expected {wanted:?}",
                        figure.name,
                    ));
                }
            }
        }
        if let Some(behind) = self.behind.filter(|b| *b >= self.figures.len()) {
            let count = self.figures.len();
            return usage(format!(
                "figure {behind} to stand behind: there are {count}, counted from 0"
            ));
        }
        let starts_late = self.runs.first().is_some_and(|run| run.first != 0);
        if starts_late
            || self
                .runs
                .windows(2)
                .any(|pair| pair[0].first >= pair[1].first)
        {
            return usage("runs must begin at frame 0 and follow one another".into());
        }
        if let Some(run) = self.runs.iter().find(|run| !run.time.is_finite()) {
            return usage(format!(
                "run {}: its time {} must be finite",
                run.name, run.time
            ));
        }
        Ok(())
    }
}

/// Up to `count` of `frames` frames, spread evenly from the first to the last, both included.
///
/// ```
/// use posing_draw::scene::spread;
///
/// assert_eq!(spread(101, 3), [0, 50, 100]);
/// assert_eq!(spread(2, 5), [0, 1]); // there are no more
/// ```
pub fn spread(frames: usize, count: usize) -> Vec<usize> {
    match count.min(frames) {
        0 => Vec::new(),
        1 => vec![0],
        count => (0..count).map(|i| i * (frames - 1) / (count - 1)).collect(),
    }
}

/// The runs of a table; `rate` is that of takes without a rate of their own.
///
/// ```
/// use posing_core::pose::Poses;
///
/// let time = Some(vec![0.0, 0.1, 0.2, 5.0, 5.1]);
/// let xyz = ndarray::Array2::zeros((5, 3));
/// let poses = Poses { points: vec!["hand".into()], xyz, time, take: None };
/// let runs = posing_draw::scene::runs(&poses, 10.0);
/// assert_eq!((runs.len(), runs[1].first, runs[1].time), (2, 3, 5.0));
/// ```
pub fn runs(poses: &Poses, rate: f64) -> Vec<Run<'_>> {
    let run = |(range, own): (Range<usize>, Option<f64>)| Run {
        name: poses.take.as_ref().map_or("", |t| &t[range.start]),
        first: range.start,
        time: poses.time.as_ref().map_or(0.0, |t| t[range.start]),
        rate: own.unwrap_or(rate),
    };
    let runs = poses.timed_runs(&poses.rates());
    runs.into_iter().map(run).collect()
}

/// The runs of two takes.
pub fn pair_runs(pair: &TakePair) -> Vec<Run<'_>> {
    let runs = pair.runs.iter().map(|run| Run {
        name: &run.name,
        first: run.first,
        time: run.time,
        rate: run.rate,
    });
    runs.collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ndarray::Array2;

    pub(crate) fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|name| name.to_string()).collect()
    }

    /// A scene of one figure at 60 frames a second.
    pub(crate) fn scene<'a>(points: &'a [String], xyz: &'a Array2<f64>) -> Scene<'a> {
        Scene {
            points,
            rate: 60.0,
            figures: vec![Figure::new("f", xyz.view())],
            ..Scene::default()
        }
    }

    /// A run at 60 frames a second.
    pub(crate) fn run(name: &str, first: usize, time: f64) -> Run<'_> {
        Run {
            name,
            first,
            time,
            rate: 60.0,
        }
    }

    fn fails<'a>(good: &Scene<'a>, change: impl Fn(&mut Scene<'a>), part: &str) {
        let mut scene = good.clone();
        scene.check().unwrap();
        change(&mut scene);
        let e = scene.check().unwrap_err();
        assert!(e.to_string().contains(part) && e.exit_code() == 2, "{e}");
    }

    #[test]
    fn each_rule_has_its_message() {
        let points = names(&["a", "b"]);
        let (xyz, short) = (Array2::zeros((3, 6)), Array2::zeros((2, 6)));
        let status = Array2::from_elem((3, 1), Status::Observed);
        let (late, timeless) = ([run("", 1, 0.0)], [run("", 0, f64::NAN)]);
        let mut still = [run("", 0, 0.0)];
        still[0].rate = 0.0;
        let good = scene(&points, &xyz);
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            fails(&good, |s| s.rate = rate, "above 0");
        }
        fails(&good, |s| s.runs = &still, "above 0");
        fails(&good, |s| s.behind = Some(1), "to stand behind");
        fails(&good, |s| s.bones = &[(0, 2)], "2 points");
        let other = Figure::new("g", short.view());
        fails(&good, |s| s.figures.push(other), "figure g");
        let status = Some(status.view());
        fails(&good, |s| s.figures[0].status = status, "statuses");
        let sd = Array2::zeros((3, 1));
        let sd = Some(sd.view());
        fails(&good, |s| s.figures[0].sd = sd, "deviations");
        fails(&good, |s| s.runs = &late, "begin at frame 0");
        fails(&good, |s| s.runs = &timeless, "finite");
    }

    #[test]
    fn frames_are_spread_from_first_to_last() {
        let (points, xyz) = (names(&["a"]), Array2::zeros((10, 3)));
        let scene = scene(&points, &xyz);
        assert_eq!(spread(scene.frames(), 4), [0, 3, 6, 9]);
        assert_eq!(spread(scene.frames(), 1), [0]);
        assert_eq!(spread(scene.frames(), 99).len(), 10);
        assert!(spread(0, 3).is_empty());
    }

    #[test]
    fn a_frame_knows_its_take_and_time() {
        let (points, xyz) = (names(&["a"]), Array2::zeros((10, 3)));
        let runs = [run("a", 0, 1.0), run("b", 4, 0.0)];
        let scene = Scene {
            runs: &runs,
            ..scene(&points, &xyz)
        };
        assert_eq!(scene.moment(3), ("a", 1.05));
        assert_eq!(scene.moment(7), ("b", 0.05));
    }

    #[test]
    fn each_take_plays_at_its_own_rate() {
        let takes = [("a", 0.1), ("a", 0.1), ("a", 0.5), ("b", 0.01), ("c", 1.0)];
        let (mut time, mut frames) = (0.0, Vec::new());
        for (take, step) in takes {
            for _ in 0..3 {
                time += step;
                frames.push((Some(time), Some(take.into())));
            }
        }
        frames.pop();
        frames.pop();
        let mut poses = Poses::without_points(frames.into_iter());
        poses.xyz = Array2::zeros((13, 0));
        let found: Vec<_> = runs(&poses, 7.0)
            .iter()
            .map(|run| (run.name, run.first, run.rate))
            .collect();
        // A run begins at each long step; a single frame has no rate.
        let want = [
            ("a", 0, 10.0),
            ("a", 6, 10.0),
            ("a", 7, 10.0),
            ("a", 8, 10.0),
            ("b", 9, 100.0),
            ("c", 12, 7.0),
        ];
        assert_eq!(found, want);
    }
}
