//! Takes described once by a metric, to be searched again and again; as a model file of kind
//! `pose-index`: the arrays of the metric, and `vectors`, a row for each frame.
//!
//! A metric that compares three frames of a window side by side is kept as vectors of one frame:
//! windows are put together where they are needed, and motions need none.

use super::body_frame::BodyFramePoses;
use super::nearest::PoseDatabase;
use super::pairs::FrameRef;
use super::pose_metric::{PoseMetric, window_frames};
use crate::io::{Matrix, Model};
use crate::{Error, Place, Result};
use ndarray::{Array2, Axis, concatenate, s};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;

/// The kind of a model file that holds an index.
pub(crate) const KIND: &str = "pose-index";

/// What an index knows of a take besides its vectors.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct IndexedTake {
    /// Its name.
    pub name: String,
    /// Its frames.
    pub frames: usize,
    /// Frames a second.
    pub rate: Option<f64>,
    /// The first frame of each run of consecutive frames, and the time there, seconds.
    pub(super) runs: Vec<(usize, f64)>,
}

impl IndexedTake {
    /// A take whose frames are at the times `time`, seconds; without them its frames count from
    /// time 0.
    pub fn new(name: &str, take: &BodyFramePoses, time: Option<&[f64]>) -> IndexedTake {
        let own = |t: usize| t as f64 / take.rate.unwrap_or(1.0);
        let at = |t: usize| time.map_or(own(t), |time| time[t]);
        IndexedTake {
            name: name.into(),
            frames: take.frames(),
            rate: take.rate,
            runs: take.runs.iter().map(|r| (r.start, at(r.start))).collect(),
        }
    }

    /// The runs of consecutive frames.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Range<usize>> {
        let starts = self.runs.iter().map(|(start, _)| *start);
        let ends = starts.clone().skip(1).chain([self.frames]);
        starts.zip(ends).map(|(start, end)| start..end)
    }

    /// The position of the run that a frame is in.
    fn run_at(&self, frame: usize) -> Option<usize> {
        self.runs
            .partition_point(|(start, _)| *start <= frame)
            .checked_sub(1)
    }

    fn run_of(&self, frame: usize) -> Range<usize> {
        let Some(k) = self.run_at(frame) else {
            return frame..frame + 1;
        };
        let end = self
            .runs
            .get(k + 1)
            .map_or(self.frames, |(start, _)| *start);
        self.runs[k].0..end
    }

    /// The time of a frame, seconds; `None` where the take has no rate.
    pub fn time(&self, frame: usize) -> Option<f64> {
        let rate = self.rate?;
        let (start, time) = self.runs[self.run_at(frame)?];
        // Sums of decimal times have more digits than were measured.
        Some(((time + (frame - start) as f64 / rate) * 1e6).round() / 1e6)
    }
}

/// Takes described by a metric.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseIndex {
    /// The metric.
    pub metric: PoseMetric,
    /// The takes.
    pub takes: Vec<IndexedTake>,
    /// A row for each frame, take after take (frames, dimensions); NaN where joints are missing.
    vectors: Matrix,
}

/// Every so-many-th frame of each take, counted through.
#[derive(Debug, Clone)]
pub struct FrameRows {
    every: usize,
    /// The rows before each take, and all.
    before: Vec<usize>,
}

impl FrameRows {
    fn new(takes: &[IndexedTake], every: usize) -> FrameRows {
        let mut before = vec![0];
        for take in takes {
            before.push(before[before.len() - 1] + take.frames.div_ceil(every));
        }
        FrameRows { every, before }
    }

    /// The number of rows.
    pub fn count(&self) -> usize {
        self.before[self.before.len() - 1]
    }

    /// The frame of a row, of which there are so many.
    pub fn frame(&self, row: usize) -> FrameRef {
        let take = self.before.partition_point(|before| *before <= row) - 1;
        FrameRef {
            take,
            frame: self.every * (row - self.before[take]),
        }
    }
}

impl PoseIndex {
    /// Describes takes; of metrics that look at windows as a whole every `every`-th frame alone,
    /// and others are NaN.
    pub fn new(
        metric: &PoseMetric,
        takes: &[(IndexedTake, &BodyFramePoses)],
        every: usize,
    ) -> PoseIndex {
        let one = metric.of_one_frame();
        let describe = |poses: &BodyFramePoses| match &one {
            Some(one) => one.embed(poses),
            None if every == 1 => metric.embed(poses),
            None => {
                let frames: Vec<usize> = (0..poses.frames()).step_by(every).collect();
                let mut all = Array2::from_elem((poses.frames(), metric.dimensions()), f32::NAN);
                let own = metric.embed_frames(poses, &frames);
                let mut rows = all.slice_mut(s![..;every, ..]);
                rows.assign(&own);
                all
            }
        };
        let parts: Vec<Array2<f32>> = takes.iter().map(|(_, poses)| describe(poses)).collect();
        let views: Vec<_> = parts.iter().map(|p| p.view()).collect();
        PoseIndex {
            metric: metric.clone(),
            takes: takes.iter().map(|(take, _)| take.clone()).collect(),
            // All have the metric's dimensions.
            vectors: concatenate(Axis(0), &views).unwrap_or_default().into(),
        }
    }

    /// The vectors of a take's frames (frames, dimensions) for the comparison of motions, frame
    /// by frame.
    pub(crate) fn motion(&self, take: usize) -> Array2<f32> {
        let start: usize = self.takes[..take].iter().map(|t| t.frames).sum();
        self.vectors.rows(start..start + self.takes[take].frames)
    }

    /// Every `every`-th frame of each take: which they are, and a database of them.
    pub fn database(&self, every: usize) -> (FrameRows, PoseDatabase<'_>) {
        let rows = FrameRows::new(&self.takes, every);
        let is_one = self.metric.of_one_frame().is_some();
        let window = if is_one { self.metric.window } else { 0.0 };
        let starts = FrameRows::new(&self.takes, 1).before;
        let own = rows.clone();
        let window = move |row: usize| {
            let at = own.frame(row);
            let take = &self.takes[at.take];
            let frames = window_frames(&take.run_of(at.frame), take.rate, at.frame, window);
            frames.into_iter().map(|f| starts[at.take] + f).collect()
        };
        let vectors = Cow::Borrowed(&self.vectors);
        let norm = self.metric.norm;
        let database = PoseDatabase::of_windows(vectors, norm, rows.count(), window);
        (rows, database)
    }

    /// The index as a model, without a history.
    pub fn to_model(&self) -> Model {
        let mut model = self.metric.to_model();
        model.meta.kind = KIND.into();
        let takes = serde_json::to_value(&self.takes).unwrap_or_default();
        model.meta.details.insert("takes".into(), takes);
        model.insert("vectors", self.vectors.clone());
        model
    }

    /// The index of a model; `source` names it in errors.
    ///
    /// # Errors
    /// [`Error::Data`]: the model is of another kind, or its arrays and settings do not belong
    /// together.
    pub fn from_model(model: &Model, source: &str) -> Result<PoseIndex> {
        let fail = |what: String| Error::data(Place::file(source), what);
        model.check_kind(KIND, "no index; retrieve makes one of a table", source)?;
        let metric = PoseMetric::from_parts(model, source)?;
        let takes = model.meta.details.get("takes").cloned().unwrap_or_default();
        let takes: Vec<IndexedTake> =
            serde_json::from_value(takes).map_err(|_| fail("is a damaged index".into()))?;
        let vectors = model.matrix("vectors", source)?.clone();
        if has_infinite(&vectors) {
            let what = "has infinite values: make it anew of its table, with the option `database`";
            return Err(fail(what.into()));
        }
        let index = PoseIndex {
            metric,
            takes,
            vectors,
        };
        if index.is_sound() {
            Ok(index)
        } else {
            Err(fail("is a damaged index".into()))
        }
    }

    fn is_sound(&self) -> bool {
        let is_whole = |take: &IndexedTake| {
            let starts = self.runs_in_order(take);
            starts && take.rate.is_none_or(|rate| rate > 0.0 && rate.is_finite())
        };
        let frames = self
            .takes
            .iter()
            .try_fold(0usize, |sum, t| sum.checked_add(t.frames));
        let one = self.metric.of_one_frame();
        let width = one.as_ref().unwrap_or(&self.metric).dimensions();
        frames == Some(self.vectors.nrows())
            && self.vectors.ncols() == width
            && self.takes.iter().all(is_whole)
    }

    /// Whether runs begin at frame 0 and go on.
    fn runs_in_order(&self, take: &IndexedTake) -> bool {
        let starts: Vec<usize> = take.runs.iter().map(|(start, _)| *start).collect();
        starts.first().copied().unwrap_or(0) == 0
            && starts.is_sorted_by(|a, b| a < b)
            && starts.last().is_none_or(|last| *last < take.frames)
            && take.runs.iter().all(|(_, time)| time.is_finite())
            && (take.frames == 0) == starts.is_empty()
    }
}

fn has_infinite(vectors: &Matrix) -> bool {
    let mut row = Vec::new();
    (0..vectors.nrows()).any(|k| {
        row.clear();
        vectors.extend_with(k, &mut row);
        row.iter().any(|v| v.is_infinite())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::tests::stroll;
    use crate::testdata::own_names;

    fn index(frames: usize) -> (PoseIndex, BodyFramePoses) {
        let clip = stroll(frames, 30.0, 0.0);
        let take = BodyFramePoses::new(&clip.poses, Some(30.0), &own_names()).unwrap();
        let metric = PoseMetric::of_coordinates(own_names());
        let indexed = IndexedTake::new("a", &take, clip.poses.time.as_deref());
        (PoseIndex::new(&metric, &[(indexed, &take)], 1), take)
    }

    #[test]
    fn windows_put_together_are_what_the_metric_gives() {
        let (index, take) = index(40);
        let (rows, database) = index.database(3);
        let own = index.metric.embed(&take);
        assert_eq!(rows.count(), 14);
        for (k, row) in database.vectors().rows().into_iter().enumerate() {
            assert_eq!(row, own.row(rows.frame(k).frame));
        }
        assert_eq!(index.takes[0].time(15), Some(0.5));
    }

    #[test]
    fn an_index_is_the_same_after_writing_and_reading() {
        let (index, _) = index(20);
        let model = index.to_model();
        assert_eq!(PoseIndex::from_model(&model, "i").unwrap(), index);
        let mut cut = model.clone();
        cut.insert("vectors", Array2::zeros((3, 2)));
        assert!(PoseIndex::from_model(&cut, "i").is_err());
        assert!(PoseIndex::from_model(&index.metric.to_model(), "m").is_err());
        for (name, told) in [("vectors", "infinite values"), ("scale", "damaged")] {
            let mut bad = model.clone();
            let mut values = model.array(name, "i").unwrap().into_owned();
            values[[0, 0]] = f32::INFINITY;
            bad.insert(name, values);
            let said = PoseIndex::from_model(&bad, "i").unwrap_err().to_string();
            assert!(said.contains(told), "{said}");
        }
    }
}
