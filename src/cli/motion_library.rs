//! Libraries of motion: `prior-train --motion` makes one, `--prior` names one.

use super::name_maps::name_map;
use super::{input, messages};
use crate::inbetween::MotionLibrary;
use crate::io::motion_file::{MotionFile, ReadOptions};
use crate::io::{self, Model};
use crate::pose::{PointNaming, joints};
use crate::prior::provenance::{digest, entry};
use crate::restore::BodyGap;
use crate::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// How the takes of a library are read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Motion")]
pub struct MotionArgs {
    /// Keep the motion of the takes, at 30 frames a second, instead of training: BVH, AMC, C3D and
    /// tables of any rate. complete --prior fills gaps of a whole body from it. Takes with the same
    /// bones are one person's
    #[arg(long, conflicts_with_all = ["kind", "cells", "leaves"])]
    pub motion: bool,
    /// Frames per second of takes that do not say it
    #[arg(long, value_name = "F", requires = "motion", value_parser = super::args::parse_rate)]
    fps: Option<f64>,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's]
    #[arg(long, value_name = "SUBJECT.asf", requires = "motion")]
    asf: Option<PathBuf>,
    /// Which points are which joints: a shipped map or a TOML file, as for complete [default: the
    /// names themselves, else the shipped map that fits best]
    #[arg(long, value_name = "NAME|FILE.toml", requires = "motion")]
    map: Option<String>,
}

impl MotionArgs {
    /// The library of some takes, as a model with its history.
    ///
    /// # Errors
    /// Those of reading a file; [`Error::Data`]: it has no body that is known by name, or a take
    /// that another has too.
    pub fn model(&self, files: &[PathBuf]) -> Result<Model> {
        let known = joints::cmu_names();
        let map = self
            .map
            .as_deref()
            .map(|m| name_map(m, &known))
            .transpose()?;
        let naming = map.map(PointNaming::Map);
        let options = ReadOptions {
            fps: self.fps,
            asf: self.asf.clone(),
            ..ReadOptions::default()
        };
        if files.is_empty() {
            return Err(Error::usage("--motion needs the files of takes"));
        }
        let mut library = MotionLibrary::default();
        let mut digests = Vec::new();
        let mut left_out = 0;
        for path in files {
            let file = MotionFile::open(path, &options)?;
            let poses = file.poses();
            let rates: Vec<Option<f64>> = poses.rates().iter().map(|r| r.or(self.fps)).collect();
            let name = io::input::take_name(path);
            let place = |e: Error| e.at(Place::file(path.display().to_string()));
            left_out += library
                .add(poses, &rates, naming.as_ref(), &name)
                .map_err(place)?;
            digests.push(digest(&poses.points, poses.xyz.mapv(|v| v as f32).view()));
        }
        if left_out > 0 {
            messages::info(&format!(
                "{left_out} takes left out: no frame rate (--fps sets it), or no stretch of .7 \
                 seconds that shows the whole body"
            ));
        }
        if library.clips.is_empty() {
            return Err(Error::usage("no take is left: there is no motion to keep"));
        }
        messages::info(&format!(
            "{} takes of {} people, {:.1} minutes",
            library.takes.len(),
            library.people(),
            library.seconds() / 60.0
        ));
        let mut model = library.to_model();
        let flags = [("motion", "true".to_string())];
        model
            .meta
            .history
            .push(entry("prior-train", &flags, digests));
        Ok(model)
    }
}

/// Opens a library of motion.
///
/// # Errors
/// [`Error::Data`]: the file cannot be read, or is no library of motion.
pub fn open_library(path: &Path) -> Result<MotionLibrary> {
    MotionLibrary::from_model(&input::open_model(path)?, &path.display().to_string())
}

/// Says how many gaps of a whole body were filled from motion.
pub fn report_body_gaps(gaps: &[BodyGap]) {
    let filled = gaps.iter().filter(|gap| gap.source.is_some()).count();
    let left = gaps.len() - filled;
    let noun = |n: usize| if n == 1 { "gap" } else { "gaps" };
    match (filled, left) {
        (0, 0) => {}
        (0, _) => messages::info(&format!(
            "{left} whole-body {} filled without motion: nothing alike is known",
            noun(left)
        )),
        (_, 0) => messages::info(&format!(
            "{filled} whole-body {} filled from motion",
            noun(filled)
        )),
        _ => messages::info(&format!(
            "{filled} whole-body {} filled from motion, {left} not: nothing alike is known",
            noun(filled)
        )),
    }
}
