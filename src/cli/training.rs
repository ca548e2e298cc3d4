//! Training poses as `ksvd-train` and `prior-train` read them, and the size of a multi-scale
//! mixture.

use super::args::InputArgs;
use super::{input, messages};
use crate::pose::Space;
use crate::prior::{Kind, TrainingSet, multiscale};
use crate::{Error, Result};
use std::path::PathBuf;

/// Reads training poses from files, placed as those of `like` if given; reports the number of
/// skipped frames.
pub fn ready(
    flags: &InputArgs,
    files: Vec<PathBuf>,
    world: bool,
    like: Option<&TrainingSet>,
) -> Result<TrainingSet> {
    let table = input::read_table(&flags.with_files(files), false, false)?;
    let ready = match like {
        Some(like) => like.comparable(&table.poses, &table.name)?,
        None => {
            let space = if world { Space::World } else { Space::Body };
            TrainingSet::from_poses(&table.poses, space, &table.name)?
        }
    };
    for (count, why) in [
        (ready.incomplete, "skipped: missing points"),
        (
            ready.unplaced,
            "skipped: cannot be placed in the model's space",
        ),
    ] {
        if count > 0 {
            messages::info(&format!("{count} of {} frames {why}", table.poses.frames()));
        }
    }
    Ok(ready)
}

/// The size of a multi-scale mixture.
#[derive(Debug, Clone, clap::Args)]
pub struct MultiscaleArgs {
    /// For multiscale: comma-separated number of clusters of each level, increasing (default:
    /// 1,5,20,80,300)
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        help_heading = "Size"
    )]
    pub cells: Option<Vec<usize>>,
    /// For multiscale: largest number of training poses kept as components of their own (default:
    /// 80000)
    #[arg(long, value_name = "N", help_heading = "Size")]
    pub leaves: Option<usize>,
}

impl MultiscaleArgs {
    /// The settings of a mixture of another size than the default, where one is asked for.
    ///
    /// # Errors
    /// When the flags are given for another kind of model.
    pub fn settings(&self, kind: Kind) -> Result<Option<multiscale::TrainSettings>> {
        if self.cells.is_none() && self.leaves.is_none() {
            return Ok(None);
        }
        if kind != Kind::Multiscale {
            let what = "--cells and --leaves are for --kind multiscale";
            return Err(Error::usage(what));
        }
        let mut settings = multiscale::TrainSettings::default();
        if let Some(cells) = &self.cells {
            settings.clusters.clone_from(cells);
        }
        if let Some(leaves) = self.leaves {
            settings.max_exemplars = leaves;
        }
        Ok(Some(settings))
    }
}
