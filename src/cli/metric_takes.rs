//! Takes as distances of poses see them: named, in the body's own frame; and files of labeled pairs
//! of their frames.

use super::args::InputArgs;
use super::csv_file::CsvFile;
use super::feature_table::body_frames;
use super::{input, messages};
use crate::io::csv::push_cell;
use crate::io::text::excerpt;
use crate::metric::{
    BodyFramePoses, FrameRef, IndexedTake, JointMap, LabeledPair, PoseIndex, PoseMetric,
};
use crate::pose::Poses;
use crate::{Error, Place, Result};
use ndarray::Array2;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Named takes.
pub struct MetricTakes {
    /// The name of the table, for messages.
    pub source: String,
    /// The table.
    pub poses: Poses,
    /// The takes' names.
    pub names: Vec<String>,
    /// The takes.
    pub takes: Vec<BodyFramePoses>,
}

/// Opens a metric.
///
/// # Errors
/// [`Error::Data`]: the file cannot be read, or is no metric.
pub fn open_metric(path: &Path) -> Result<PoseMetric> {
    PoseMetric::from_model(&input::open_model(path)?, &path.display().to_string())
}

/// Opens an index of takes.
///
/// # Errors
/// [`Error::Data`]: the file cannot be read, or is no index.
pub fn open_index(path: &Path) -> Result<PoseIndex> {
    PoseIndex::from_model(&input::open_model(path)?, &path.display().to_string())
}

/// Reads takes from `files`. A take that the tables do not name has the name of its file. Without
/// a map the joints are found by the points' names.
///
/// # Errors
/// [`Error::Data`]: a table cannot be read, lacks joints, shows no body height, or has a take
/// twice. [`Error::Usage`]: no frame
/// rate, where `needs_rate`.
pub fn read_takes(
    flags: &InputArgs,
    files: Vec<PathBuf>,
    map: Option<&JointMap>,
    needs_rate: bool,
) -> Result<MetricTakes> {
    let flags = flags.with_files(files);
    let table = input::read_table(&flags, false, false)?;
    let rates = flags.rates(&table.poses)?;
    if needs_rate && rates.iter().any(Option::is_none) {
        return Err(Error::usage(format!(
            "{}: velocities and windows need a frame rate, and the table's times give none; give \
             it with --fps",
            table.name
        )));
    }
    let map = match map {
        Some(map) => map.clone(),
        None => JointMap::fitting(&table.poses.points),
    };
    let takes = body_frames(&table.poses, &rates, &map, &table.name)?;
    let own = crate::io::input::take_name(Path::new(&table.name));
    let name = |start: usize| match &table.poses.take {
        Some(takes) if !takes[start].is_empty() => takes[start].to_string(),
        _ => own.clone(),
    };
    let names: Vec<String> = (table.poses.takes().iter())
        .map(|range| name(range.start))
        .collect();
    let mut seen = HashMap::new();
    for (k, name) in names.iter().enumerate() {
        if seen.insert(name, k).is_some() {
            let what = format!(
                "has take \"{}\" in two places; give them two names",
                excerpt(name)
            );
            return Err(Error::data(Place::file(&table.name), what));
        }
    }
    report_rates(&rates, &table.name);
    Ok(MetricTakes {
        source: table.name,
        poses: table.poses,
        names,
        takes,
    })
}

/// Says that takes have several rates, which is no error: windows and velocities are in seconds.
fn report_rates(rates: &[Option<f64>], source: &str) {
    let mut rates: Vec<f64> = rates.iter().flatten().copied().collect();
    rates.sort_by(f64::total_cmp);
    if let (Some(least), Some(most)) = (rates.first(), rates.last())
        && most - least > 1e-3 * most
    {
        messages::info(&format!(
            "{source}: takes have {least} to {most} frames per second; they are compared by \
             seconds"
        ));
    }
}

impl MetricTakes {
    /// The takes, described by a metric; see [`PoseIndex::new`].
    pub fn index(&self, metric: &PoseMetric, every: usize) -> PoseIndex {
        let ranges = self.poses.takes();
        let takes = (self.names.iter().zip(&self.takes)).zip(ranges);
        let takes: Vec<_> = takes
            .map(|((name, take), range)| {
                let time = self.poses.time.as_ref().map(|time| &time[range]);
                (IndexedTake::new(name, take, time), take)
            })
            .collect();
        PoseIndex::new(metric, &takes, every)
    }

    /// Every `every`-th frame of each take by a metric: which frames, and their vectors.
    pub fn embed(&self, metric: &PoseMetric, every: usize) -> (Vec<FrameRef>, Array2<f32>) {
        metric.embed_takes(&self.takes, |_| every)
    }

    /// Appends a frame's take and number as two cells.
    pub fn push_frame(&self, out: &mut Vec<u8>, at: FrameRef) {
        push_cell(out, self.names[at.take].as_bytes());
        out.push(b',');
        out.extend(at.frame.to_string().bytes());
    }

    /// Reads pairs, labeled or not, like [`MetricTakes::read_pairs`], and whether all have labels.
    /// A pair without a label counts as alike.
    ///
    /// # Errors
    /// Those of [`MetricTakes::read_pairs`].
    pub fn read_pairs_to_compare(&self, path: &Path) -> Result<(Vec<LabeledPair>, bool)> {
        self.read(path, false)
    }

    /// Reads labeled pairs: `a_take,a_frame,b_take,b_frame,label`, label 1 alike, 0 not. Other
    /// columns are ignored; people may disagree about a pair.
    ///
    /// # Errors
    /// [`Error::Data`], with the line: a column is missing, a take is unknown, a frame is out of
    /// range, or a label is neither 0 nor 1.
    pub fn read_pairs(&self, path: &Path) -> Result<Vec<LabeledPair>> {
        self.read(path, true).map(|(pairs, _)| pairs)
    }

    fn read(&self, path: &Path, needs_labels: bool) -> Result<(Vec<LabeledPair>, bool)> {
        let mut file = CsvFile::open(path)?;
        let source = file.name.clone();
        let needed = |name: &str| file.needed(name, "a_take,a_frame,b_take,b_frame,label");
        let ends = [
            (needed("a_take")?, needed("a_frame")?),
            (needed("b_take")?, needed("b_frame")?),
        ];
        let label = if needs_labels {
            Some(needed("label")?)
        } else {
            file.column("label")
        };
        let takes: HashMap<&str, usize> = (self.names.iter().enumerate())
            .map(|(k, name)| (name.as_str(), k))
            .collect();
        let mut pairs: Vec<LabeledPair> = Vec::new();
        let mut has_labels = label.is_some();
        for record in file.rows() {
            let (line, record) = record?;
            let fail = |what: String| Error::data(Place::line(&source, line), what);
            let end =
                |(take, frame): (usize, usize)| self.frame(&takes, &record[take], &record[frame]);
            let label = label.map_or("", |k| &record[k]);
            has_labels &= !label.is_empty();
            let pair = LabeledPair {
                ends: [end(ends[0]).map_err(fail)?, end(ends[1]).map_err(fail)?],
                is_alike: match label {
                    "1" => true,
                    "0" => false,
                    "" if !needs_labels => true,
                    other => {
                        let other = excerpt(other);
                        return Err(fail(format!("has label \"{other}\"; expected 1 or 0")));
                    }
                },
            };
            pairs.push(pair);
        }
        if pairs.is_empty() {
            Err(Error::data(Place::file(&source), "has no pairs"))
        } else {
            Ok((pairs, has_labels))
        }
    }

    /// The frame that a line names.
    fn frame(
        &self,
        takes: &HashMap<&str, usize>,
        take: &str,
        frame: &str,
    ) -> std::result::Result<FrameRef, String> {
        let index = *takes.get(take).ok_or_else(|| {
            format!(
                "names take \"{}\", which {} does not have",
                excerpt(take),
                self.source
            )
        })?;
        let frames = self.takes[index].frames();
        match frame.parse::<usize>() {
            Ok(frame) if frame < frames => Ok(FrameRef { take: index, frame }),
            _ => Err(format!(
                "has frame \"{}\" of take {take}; expected 0 to {}",
                excerpt(frame),
                frames - 1
            )),
        }
    }
}
