//! Tables of named numbers per frame, such as pose descriptors: CSV with the takes and times of the
//! poses, or NPY.

use super::messages;
use super::name_maps::map_file;
use super::streams::open_output;
use super::toml_file;
use crate::io::csv::push_cell;
use crate::io::npy;
use crate::io::text::{push_f32, push_f64};
use crate::metric::body_frame::BodyFramePoses;
use crate::metric::{JointMap, PoseMetric};
use crate::numeric::parallel;
use crate::pose::{NameMap, Poses};
use crate::{Place, Result};
use ndarray::Array2;
use std::path::Path;

/// Frames whose lines one thread writes at a time.
const LINES: usize = 64;
/// Frames that are written together.
const BATCH: usize = 4096;

/// The flag that names the sixteen joints.
#[derive(Debug, Clone, clap::Args)]
pub struct JointMapArgs {
    /// Which points the sixteen joints are: CMU, a shipped map (posing complete --help lists
    /// them), or a TOML file
    #[arg(
        long,
        value_name = "CMU|NAME|FILE.toml",
        default_value = "CMU",
        help_heading = "Input"
    )]
    pub map: String,
}

impl JointMapArgs {
    /// The map.
    ///
    /// # Errors
    /// Those of [`joint_map`].
    pub fn joint_map(&self) -> Result<JointMap> {
        joint_map(&self.map)
    }
}

/// The flag that names the sixteen joints of commands that find them by the points' names.
#[derive(Debug, Clone, clap::Args)]
pub struct FittingMapArgs {
    /// Which points the sixteen joints are: CMU, a shipped map (posing complete --help lists
    /// them), or a TOML file; a metric has its own [default: by the points' names]
    #[arg(
        long,
        value_name = "CMU|NAME|FILE.toml",
        conflicts_with = "model",
        help_heading = "Input"
    )]
    map: Option<String>,
}

impl FittingMapArgs {
    /// Whether the flag is given.
    pub fn is_given(&self) -> bool {
        self.map.is_some()
    }

    /// The map of a metric, or that which the flag names; `None`: the points' names tell.
    ///
    /// # Errors
    /// Those of [`joint_map`].
    pub fn joint_map(&self, metric: Option<&PoseMetric>) -> Result<Option<JointMap>> {
        match metric {
            Some(metric) => Ok(Some(metric.map.clone())),
            None => self.map.as_deref().map(joint_map).transpose(),
        }
    }
}

/// The joint map that `--map` names: `CMU`, a shipped map of names, or a TOML file.
///
/// # Errors
/// [`crate::Error::Data`] if the file cannot be read, or a joint is missing or unknown.
pub fn joint_map(name: &str) -> Result<JointMap> {
    if name == "CMU" {
        return Ok(JointMap::cmu());
    }
    if let Some(map) = NameMap::find(name) {
        return Ok(JointMap::of_names(map));
    }
    let (points, source) = toml_file::read(map_file(name)?)?;
    JointMap::new(points).map_err(|e| e.at(Place::file(source)))
}

/// The takes of a table in the body's own frame; `rates` are theirs.
///
/// # Errors
/// [`crate::Error::Data`] where joints are missing, or a take shows no body height.
pub fn body_frames(
    poses: &Poses,
    rates: &[Option<f64>],
    map: &JointMap,
    name: &str,
) -> Result<Vec<BodyFramePoses>> {
    let takes = poses.takes().into_iter().zip(rates);
    let place = |(range, rate): (std::ops::Range<usize>, &Option<f64>)| {
        let take = poses.take.as_ref().map(|t| t[range.start].to_string());
        BodyFramePoses::new(&poses.slice(range), *rate, map).map_err(|e| {
            let place = Place::file(name);
            e.at(match take {
                Some(take) => place.part(format!("take {take}")),
                None => place,
            })
        })
    };
    takes.map(place).collect()
}

/// Writes a row per frame: its take and time, empty where the poses have none, then its `features`
/// (frames, names).
///
/// # Errors
/// When the output cannot be written.
pub fn write(
    output: Option<&Path>,
    is_npy: bool,
    poses: &Poses,
    names: &[String],
    features: &Array2<f32>,
) -> Result<()> {
    let mut out = open_output(output, is_npy)?;
    if is_npy {
        out.write(&npy::header_of(
            "<f4",
            &[features.nrows(), features.ncols()],
        ))?;
    } else {
        // Always both, so that a feature has one index.
        let head: Vec<&str> = ["take", "time"]
            .into_iter()
            .chain(names.iter().map(String::as_str))
            .collect();
        out.write(format!("{}\n", head.join(",")).as_bytes())?;
    }
    for start in (0..features.nrows()).step_by(BATCH) {
        let count = BATCH.min(features.nrows() - start);
        let rows = parallel::map_chunks(count, LINES, |range| {
            let mut bytes = Vec::new();
            for t in range.map(|k| start + k) {
                if is_npy {
                    bytes.extend(features.row(t).iter().flat_map(|v| v.to_le_bytes()))
                } else {
                    push_line(&mut bytes, poses, t, features)
                }
            }
            bytes
        });
        rows.iter().try_for_each(|bytes| out.write(bytes))?;
    }
    out.finish()?;
    messages::debug(&format!(
        "{} frames, {} features",
        features.nrows(),
        names.len()
    ));
    Ok(())
}

fn push_line(out: &mut Vec<u8>, poses: &Poses, t: usize, features: &Array2<f32>) {
    if let Some(take) = &poses.take {
        push_cell(out, take[t].as_bytes());
    }
    out.push(b',');
    if let Some(time) = &poses.time {
        push_f64(out, time[t]);
    }
    for value in features.row(t) {
        out.push(b',');
        if value.is_finite() {
            push_f32(out, *value);
        }
    }
    out.push(b'\n');
}
