//! Cleaning one file: read, audited, restored, written back, recorded.

use super::record::{
    Fingerprint, MadeFrom, Record, Summary, begin, give_up, has_result, may_write, unchanged,
};
use super::replaced::replaced;
use super::sources::{Job, OutputFormat};
use crate::audit::Limits;
use crate::cli::args::value_name;
use crate::cli::audit::audit_motion;
use crate::cli::body_size::check_body_size;
use crate::cli::gap_report::gap_lines;
use crate::cli::motion_file::{LARGEST_MOTION_FILE, MotionFile, ReadFlags, skeleton_of};
use crate::cli::new_take::NewTake;
use crate::cli::units::{TableUnits, Units, Up};
use crate::io::output::write_file;
use crate::io::{Input, Model, MotionFormat};
use crate::pose::{NameMap, PointNaming, Poses, joints};
use crate::restore::{Clean, Restoration, Restorer};
use crate::{Error, Place, Result};
use ndarray::s;
use serde_json::json;

/// How files are cleaned.
pub struct CleanSettings {
    /// What is taken for files that do not say it.
    pub read: ReadFlags,
    /// The model, its name in messages, and the digest of its bytes; `None`: each take by itself.
    pub model: Option<(Model, String, String)>,
    /// The map of names that was asked for.
    pub map: Option<NameMap>,
    /// How takes are restored.
    pub method: Clean,
    /// Whether points at exactly 0 0 0 are missing.
    pub zeros_are_missing: bool,
    /// Whether rotations that were held are missing.
    pub held_is_missing: bool,
    /// What is still as it should be.
    pub limits: Limits,
    /// Whether bodies of no person's size are accepted.
    pub force: bool,
    /// Whether files are cleaned again whose results are there.
    pub again: bool,
}

/// What became of a file.
#[derive(Debug)]
pub enum Fate {
    /// The file was cleaned.
    Cleaned(Summary),
    /// The result was there, made from the same.
    Unchanged(Summary),
    /// It could not be cleaned; `old_result`: the result of an earlier run still stands there.
    Failed {
        /// Why.
        error: Error,
        /// Whether there is one.
        old_result: bool,
    },
}

impl CleanSettings {
    /// Cleans a file.
    pub fn clean(&self, job: &Job, to: Option<OutputFormat>) -> Fate {
        let run = || self.try_clean(job, to);
        // A defect of ours in one file is to stop no other.
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
        let broken = |_| {
            let what = "cannot be cleaned: a defect of posing; please report it with the file";
            Err(Error::data(
                Place::file(job.input.display().to_string()),
                what,
            ))
        };
        done.unwrap_or_else(broken)
            .unwrap_or_else(|error| Fate::Failed {
                error,
                old_result: has_result(&job.output),
            })
    }

    fn try_clean(&self, job: &Job, to: Option<OutputFormat>) -> Result<Fate> {
        let packed = std::fs::read(&job.input).map_err(|e| Error::io(&job.input, e))?;
        let input = Fingerprint::of(&job.input, &packed);
        let unpacked = Input::new(
            job.input.display().to_string(),
            std::io::Cursor::new(packed),
        )?;
        let is_amc = MotionFormat::of(unpacked.first_bytes()) == MotionFormat::Amc;
        let skeleton = match is_amc {
            true => Some(Fingerprint::read(&skeleton_of(&job.input, &self.read)?)?),
            false => None,
        };
        let made_from = MadeFrom {
            posing: env!("CARGO_PKG_VERSION").to_string(),
            settings: self.recorded(to),
            input,
            skeleton,
        };
        if let Some(summary) = unchanged(&job.output, &made_from).filter(|_| !self.again) {
            return Ok(Fate::Unchanged(summary));
        }
        may_write(&job.output, self.again)?;
        let bytes = unpacked.read_all(LARGEST_MOTION_FILE)?;
        let file = MotionFile::read(&job.input, bytes, &self.read)?;
        self.restore(job, to, file, &made_from).map(Fate::Cleaned)
    }

    fn restore(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        mut file: MotionFile,
        made_from: &MadeFrom,
    ) -> Result<Summary> {
        let rate = file.rate();
        if rate.is_none() && file.table.poses.frames() > 1 {
            let what = "has no times that give a rate; give it with --fps F (frames per second)";
            return Err(Error::data(Place::file(&file.table.name), what));
        }
        let before = audit_motion(&file, &self.limits);
        if self.held_is_missing {
            file.empty_held()?;
        }
        let keeps = keeps_rotations(&file, to);
        // A root at the origin is where an animation begins.
        if self.zeros_are_missing && !keeps {
            empty_zeros(&mut file.table.poses);
        }
        let table = &file.table;
        let naming = self.naming(&table.poses);
        let is_copied = keeps && file.is_whole();
        if !self.force && !is_copied {
            let names = naming.model_names(&table.poses.points);
            let remedy = "give the file's unit with --units";
            check_body_size(&table.poses, &names, &table.name, remedy)?;
        }
        let restorer = self.restorer(&naming, &table.poses);
        let restored = match is_copied {
            true => Restoration::unchanged(table),
            false => restorer.clean(table, &self.method_for(&file, to))?,
        };
        begin(&job.output, made_from)?;
        let written = self.write(job, to, &file, &restored);
        let unheld = written.inspect_err(|_| give_up(&job.output))?;
        let summary = self.summary(&file, to, &naming, &restored, unheld);
        Record {
            command: "clean",
            made_from,
            read_as: &file.read_as,
            map: match &naming {
                PointNaming::Map(map) => Some(&map.name),
                _ => None,
            },
            audit: &before,
            summary: &summary,
            gaps: gap_lines(&restored),
            outliers: replaced(&restored),
            output: Fingerprint::read(&job.output)?,
        }
        .write(&job.output)?;
        Ok(summary)
    }

    /// What is known of the settings in a record: all that changes results.
    fn recorded(&self, to: Option<OutputFormat>) -> serde_json::Value {
        let read = &self.read;
        json!({
            "fps": read.fps,
            "units": read.units.map(value_name),
            "up": read.up.map(value_name),
            "joints": read.joints,
            "keep_whole": read.keep_whole,
            "model": self.model.as_ref().map(|m| m.2.clone()),
            "map": self.map.as_ref().map(|map| &map.joints),
            "noise_limit": self.method.noise_limit,
            "outliers": self.method.outliers,
            "max_gap": self.method.max_gap,
            "zeros_are_missing": self.zeros_are_missing,
            "held_is_missing": self.held_is_missing,
            "max_sd": self.method.max_sd,
            "limits": self.limits,
            "force": self.force,
            "to": to.map(value_name),
        })
    }

    /// How the points of a take are named, for the model; without one, for CMU's names, by which a body is measured.
    fn naming(&self, poses: &Poses) -> PointNaming {
        let known = match &self.model {
            Some((model, ..)) => &model.meta.points,
            None => &joints::cmu_names(),
        };
        match &self.map {
            Some(map) => PointNaming::Map(map.clone()),
            None => PointNaming::of(&poses.points, poses.xyz.view(), known),
        }
    }

    /// What restores a take: the model, where it knows any of its points.
    fn restorer(&self, naming: &PointNaming, poses: &Poses) -> Restorer<'_> {
        let names = naming.model_names(&poses.points);
        match &self.model {
            Some((model, name, _)) if names.iter().any(|n| model.meta.points.contains(n)) => {
                let restorer = Restorer::new(model).named(name);
                restorer.with_naming(naming.clone())
            }
            _ => Restorer::without_model(),
        }
    }

    /// Rotations that stay rotations are filled where they are missing; all others of them are as they were measured.
    fn method_for(&self, file: &MotionFile, to: Option<OutputFormat>) -> Clean {
        let keeps = keeps_rotations(file, to);
        Clean {
            fps: file.rate().or(Some(1.0)),
            outliers: self.method.outliers && !keeps,
            // Of rotations, the limit holds for both estimates together.
            max_sd: if keeps {
                f64::INFINITY
            } else {
                self.method.max_sd
            },
            noise_limit: if keeps {
                f64::INFINITY
            } else {
                self.method.noise_limit
            },
            ..self.method
        }
    }

    /// Writes the result; how many positions, or values of a BVH file, it does not hold.
    fn write(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        file: &MotionFile,
        restored: &Restoration<'_>,
    ) -> Result<usize> {
        let Some(to) = to.filter(|to| !to.is(file.format)) else {
            return file.write_back(&job.output, restored, self.method.max_sd);
        };
        if let Some(table) = to.table() {
            return file
                .write_table(&job.output, table, restored.xyz())
                .map(|()| 0);
        }
        let units = TableUnits {
            unit: Units::Mm,
            up: if to == OutputFormat::C3d {
                Up::Z
            } else {
                Up::Y
            },
        };
        let poses = Poses {
            xyz: restored.xyz().to_owned(),
            ..file.table.poses.clone()
        };
        if poses.takes().len() > 1 {
            let what =
                "has several takes, which one file of markers cannot hold; clean it --to csv";
            return Err(Error::data(Place::file(&file.table.name), what));
        }
        let take = NewTake::new(poses, file.rate().unwrap_or(1.0), units);
        let bytes = match to {
            OutputFormat::C3d => take.c3d()?,
            _ => take.trc()?,
        };
        write_file(&job.output, &bytes).map(|()| 0)
    }
}

/// Whether the result holds rotations, as the file does.
pub fn keeps_rotations(file: &MotionFile, to: Option<OutputFormat>) -> bool {
    matches!(file.format, MotionFormat::Bvh | MotionFormat::Amc) && to.is_none()
}

/// Positions at exactly 0 0 0 become missing ones.
fn empty_zeros(poses: &mut Poses) {
    for mut row in poses.xyz.rows_mut() {
        for p in 0..row.len() / 3 {
            let mut point = row.slice_mut(s![3 * p..3 * p + 3]);
            if point.iter().all(|v| *v == 0.0) {
                point.fill(f64::NAN);
            }
        }
    }
}
