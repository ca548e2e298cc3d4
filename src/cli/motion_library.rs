//! Libraries of motion: `prior-train --motion` makes one, `--prior` names one.

use super::args::UpArgs;
use super::choice::choice;
use super::name_maps::name_map;
use super::{input, messages};
use crate::inbetween::MotionLibrary;
use crate::io::motion_file::{MotionFile, ReadOptions};
use crate::io::motion_folder::MotionFolder;
use crate::io::{self, Model};
use crate::pose::{LengthUnit, PointNaming, joints};
use crate::prior::provenance::{digest, entry};
use crate::restore::BodyGap;
use crate::restore::body_size::check_body_size;
use crate::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// How the takes of a library are read.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Motion")]
#[command(mut_arg("up", |up| up.requires("motion").help(
    "Axis that points up in takes that do not say it [default: y]"
)))]
#[command(mut_arg("left_handed", |left| left.requires("motion")))]
pub struct MotionArgs {
    /// Keep the motion of the takes, at 30 frames a second, instead of training: files of BVH, AMC,
    /// C3D and tables of any rate, or folders of these. complete --prior (tables), clean --prior
    /// (any file) and between use it. Takes whose bone lengths match count as one person's
    #[arg(long, conflicts_with_all = ["kind", "cells", "leaves", "space", "seed"])]
    pub motion: bool,
    /// Frames per second of takes that do not say it
    #[arg(long, value_name = "F", requires = "motion", value_parser = super::args::parse_rate)]
    fps: Option<f64>,
    /// Unit of length of takes that do not say it [default: cm]
    #[arg(long, value_name = "UNIT", requires = "motion", value_parser = choice::<LengthUnit>())]
    units: Option<LengthUnit>,
    #[command(flatten)]
    axes: UpArgs,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's]
    #[arg(long, value_name = "SUBJECT.asf", requires = "motion")]
    asf: Option<PathBuf>,
    /// Go on with a body that is smaller or larger than people are
    #[arg(long, requires = "motion")]
    force: bool,
    /// Which points are which joints: a shipped map or a TOML file, as for complete [default: the
    /// names themselves, else the shipped map that fits best]
    #[arg(long, value_name = "NAME|FILE.toml", requires = "motion")]
    map: Option<String>,
}

impl MotionArgs {
    /// The library of some takes, as a model with its history.
    ///
    /// # Errors
    /// Those of reading a file; [`Error::Data`]: it has no body that is known by name. Files of a
    /// folder are left out instead.
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
            units: self.units,
            asf: self.asf.clone(),
            ..self.axes.options()
        };
        if files.is_empty() {
            return Err(Error::usage("--motion needs the files of takes"));
        }
        let mut library = MotionLibrary::default();
        let mut digests = Vec::new();
        for path in files {
            if !path.is_dir() {
                digests.push(self.add(&mut library, path, &options, naming.as_ref())?);
                continue;
            }
            let found = MotionFolder::search(path, None, |_| true);
            for (_, _, error) in &found.unreadable {
                messages::error(&error.to_string());
            }
            for (path, _) in &found.files {
                // One that is of no use stops no other.
                match self.add(&mut library, path, &options, naming.as_ref()) {
                    Ok(digest) => digests.push(digest),
                    Err(error) => messages::info(&format!("left out: {error}")),
                }
            }
        }
        if library.clips.is_empty() {
            return Err(Error::usage("no take is left: there is no motion to keep"));
        }
        messages::info(&format!(
            "{} of {}, {:.1} minutes",
            counted(library.takes.len(), "take", "takes"),
            counted(library.people(), "person", "people"),
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

impl MotionArgs {
    /// Adds the takes of a file; returns the digest of its poses.
    fn add(
        &self,
        library: &mut MotionLibrary,
        path: &Path,
        options: &ReadOptions,
        naming: Option<&PointNaming>,
    ) -> Result<String> {
        let file = MotionFile::open(path, options)?;
        let poses = file.poses();
        let rates: Vec<Option<f64>> = poses.rates().iter().map(|r| r.or(self.fps)).collect();
        let name = io::input::take_name(path);
        let own = PointNaming::of(&poses.points, poses.xyz.view(), &joints::cmu_names());
        let names = naming.unwrap_or(&own).model_names(&poses.points);
        let remedy = "give the unit with --units (m, mm, in)";
        let source = path.display().to_string();
        if !self.force {
            check_body_size(poses, &names, &source, remedy)?;
        }
        let left_out = library.add(poses, &rates, naming, &name);
        let left_out = left_out.map_err(|e| e.at(Place::file(&source)))?;
        if left_out > 0 {
            messages::info(&format!(
                "{source}: {} left out: no rate of 10 frames a second or more (--fps sets one), or \
                 no .7 seconds that show the whole body",
                counted(left_out, "take", "takes")
            ));
        }
        Ok(digest(&poses.points, poses.xyz.mapv(|v| v as f32).view()))
    }
}

fn counted(n: usize, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
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
    let unlike = gaps.iter().filter(|gap| gap.is_unlike).count();
    let counts = [
        (filled, "filled from motion"),
        (unlike, "not: no similar motion was found"),
        (
            gaps.len() - filled - unlike,
            "not: too little motion is known beside it, or at all",
        ),
    ];
    let counts = counts.iter().filter(|(n, _)| *n > 0);
    let what: Vec<String> = counts.map(|(n, what)| format!("{n} {what}")).collect();
    if !what.is_empty() {
        messages::info(&format!("whole-body gaps: {}", what.join("; ")));
    }
}
