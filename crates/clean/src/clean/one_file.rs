//! Cleaning one file: read, audited, restored, written back, recorded.

use super::held::{empty_held, held_of};
use super::labels::relabeled;
use super::page::write_page;
use super::places::PlaceToSee;
use super::record::{
    Fingerprint, MadeFrom, Record, Summary, begin, give_up, has_result, is_in_doubt, leave_failure,
    may_write, unchanged,
};
use super::redo;
use super::replaced::{ReplacedPosition, replaced};
use super::rotations::CleanedFile;
use super::skeleton::{self, SkeletonSettings};
use super::sources::{Job, OutputFormat};
use crate::audit::{Limits, TakeAudit, audit_motion, name_options};
use crate::error::OptionNames;
use crate::ik::rotation_cleaning::{RotationCleaning, clean_rotations};
use crate::io::motion_file::{LARGEST_MOTION_FILE, ReadOptions, ReadRules, skeleton_of};
use crate::io::motion_folder::name_of;
use crate::io::output::{TemporaryFile, write_file};
use crate::io::{Input, Model, MotionFile, MotionFormat, NewTake};
use crate::label::LabelSettings;
use crate::pose::{
    LengthUnit, NameMap, PointNaming, Poses, Segment, Units, UpAxis, check_unit, joints,
};
use crate::restore::body_size::check_body_size;
use crate::restore::gap_report::gap_lines;
use crate::restore::{Clean, Restoration, Restorer};
use crate::solve::{MarkerSet, doubt};
use crate::{Error, Place, Result};
use serde_json::json;
use std::path::Path;

/// How files are cleaned.
pub struct CleanSettings {
    /// What is taken for files that do not say it.
    pub read: ReadRules,
    /// The model, its name in messages, and the digest of its bytes; `None`: each take by itself.
    pub model: Option<(Model, String, String)>,
    /// The map of names that was asked for.
    pub map: Option<NameMap>,
    /// How takes are restored.
    pub method: Clean,
    /// The noise over which the rotations of a file that keeps them are smoothed, radians about an
    /// axis.
    pub rotation_noise_limit: f64,
    /// How labels are put right first, if they are.
    pub labels: Option<LabelSettings>,
    /// Whether noise is removed at all.
    pub smooth: bool,
    /// Whether rotations that were held are missing.
    pub held_is_missing: bool,
    /// What is still as it should be.
    pub limits: Limits,
    /// Whether bodies of no person's size are accepted.
    pub force: bool,
    /// Whether files are cleaned again whose results are there.
    pub again: bool,
    /// Segments that count as missing.
    pub redo: Vec<Segment>,
    /// The cutoff of a low-pass filter after all else, Hz.
    pub butterworth: Option<f64>,
    /// How markers are solved for a skeleton beside each result, if they are.
    pub skeletons: Option<SkeletonSettings>,
    /// What results, records and pages call options.
    pub option_names: OptionNames,
}

/// What was made of a file.
pub(super) struct CleanedTake<'t> {
    /// Its points.
    pub points: Restoration<'t>,
    /// Its rotations, where it keeps them.
    pub rotations: Option<CleanedFile>,
}

/// The capture of a job: the bytes that it has, unpacked, and how they are read.
struct Capture {
    size: usize,
    sha256: String,
    read: ReadOptions,
}

/// What became of a file.
#[derive(Debug)]
pub enum FileOutcome {
    /// The file was cleaned, or copied if there was nothing to change.
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

/// What is known of a file beside its result.
pub(super) struct Known<'a> {
    /// Places that were done again, and those where labels changed or are not sure.
    pub places: Vec<PlaceToSee>,
    /// The audit of the capture.
    pub audit: &'a [TakeAudit],
    /// Its positions that were replaced as outliers.
    pub replaced: &'a [ReplacedPosition],
}

impl CleanSettings {
    /// Cleans a file; the digest of the capture, where it can be read, comes with what became of
    /// it.
    pub(crate) fn clean(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
    ) -> (FileOutcome, Option<String>) {
        let packed = std::fs::read(&job.input).map_err(|e| Error::io(&job.input, e));
        let input = packed.map(|packed| (Fingerprint::of(&job.input, &packed), packed));
        let sha256 = input.as_ref().ok().map(|(input, _)| input.sha256.clone());
        let run = || self.try_clean(job, to, input?);
        // A defect of ours in one file is to stop no other.
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
        let broken = |_| {
            let what = "cannot be cleaned: a defect of posing; please report it with the file";
            Err(Error::data(
                Place::file(job.input.display().to_string()),
                what,
            ))
        };
        let outcome = done.unwrap_or_else(broken).unwrap_or_else(|error| {
            let error = error.with_option_names(self.option_names);
            // Where no record can be left, the table has the error all the same.
            let _ = leave_failure(&job.output, &error.to_string());
            FileOutcome::Failed {
                error,
                old_result: has_result(&job.output),
            }
        });
        (outcome, sha256)
    }

    fn try_clean(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        (input, packed): (Fingerprint, Vec<u8>),
    ) -> Result<FileOutcome> {
        let mut unpacked = Input::new(
            job.input.display().to_string(),
            std::io::Cursor::new(packed),
        )?;
        unpacked.look_ahead()?;
        let format = MotionFormat::of(unpacked.first_bytes());
        let read = self.read.of(&job.input, format);
        let skeleton = match format {
            MotionFormat::Amc => Some(Fingerprint::read(&skeleton_of(&job.input, &read)?)?),
            _ => None,
        };
        let made_from = MadeFrom {
            posing: env!("CARGO_PKG_VERSION").to_string(),
            settings: self.recorded(&read, format, to)?,
            input,
            skeleton,
        };
        let skeletons = self.skeletons.as_ref().filter(|_| !is_of_rotations(format));
        let has_skeleton = skeletons.is_none_or(|s| s.is_done(&job.output));
        let unchanged = unchanged(&job.output, &made_from);
        if let Some(summary) = unchanged.filter(|_| !self.again && has_skeleton) {
            return Ok(FileOutcome::Unchanged(summary));
        }
        may_write(&job.output, self.again)?;
        if let Some(skeletons) = skeletons {
            skeletons.check(&job.output)?;
        }
        let is_utf16 = unpacked.is_utf16();
        let bytes = unpacked.read_all(LARGEST_MOTION_FILE)?;
        let capture = Capture {
            size: bytes.len(),
            sha256: Fingerprint::of(&job.input, &bytes).sha256,
            read,
        };
        let mut file = MotionFile::read(&job.input, bytes, &capture.read)?;
        if is_utf16 {
            let what = "is a text in UTF-16; the result is in UTF-8".to_string();
            file.notes.push(what);
        }
        self.restore(job, to, file, &made_from, &capture)
            .map(FileOutcome::Cleaned)
    }

    fn restore(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        file: MotionFile,
        made_from: &MadeFrom,
        capture: &Capture,
    ) -> Result<Summary> {
        let rate = file.rate();
        if rate.is_none() && file.table.poses.frames() > 1 {
            let what = "has no times that give a rate; give it with the option `fps F` (frames \
                        per second)";
            return Err(Error::data(Place::file(&file.table.name), what));
        }
        if !self.force && !keeps_rotations(&file, to) {
            check_unit(file.poses(), file.units(), &file.table.name)?;
        }
        let mut before = audit_motion(&file, &self.limits);
        name_options(&mut before, self.option_names);
        let (mut file, labels) = relabeled(self.labels.as_ref(), file)?;
        if self.held_is_missing {
            empty_held(&mut file)?;
        }
        let keeps = keeps_rotations(&file, to);
        if keeps && file.table.poses.points.is_empty() {
            file.notes
                .push("copied: there are no positions to clean".into());
        }
        let (redone, mut notes) = self.redo(&mut file, keeps)?;
        let naming = self.naming(&file.table.poses);
        let mut restored = self.restored(&file, to, &naming)?;
        restored.points.reject(labels.taken_out());
        let (restored, smoothed) = self.smoothed(&file, keeps, restored)?;
        notes.extend(smoothed);
        let points = &restored.points;
        if !self.again && is_in_doubt(&job.output) {
            self.check_same(job, to, &file, &restored)?;
        }
        skeleton::remove_old(&job.output);
        let old = begin(&job.output, made_from)?;
        let written = self.write(job, to, &file, &restored);
        let unheld = written.inspect_err(|_| give_up(&job.output, old.as_deref()))?;
        let outliers = replaced(points, labels.captured(&file));
        let known = Known {
            places: redone.into_iter().chain(labels.places()).collect(),
            audit: &before,
            replaced: &outliers,
        };
        let mut summary = self.summary(&file, to, &naming, &restored, unheld, known);
        summary.notes.extend(notes);
        summary.notes.extend(labels.notes());
        summary.findings.extend(labels.findings());
        summary.findings.extend(self.doubt(&file));
        if to == Some(OutputFormat::Npy) && file.format != MotionFormat::Npy {
            summary.notes.extend(file.table.columns.lost_in_array());
        }
        summary.copied =
            labels.captured.is_none() && self.is_copied(job, to, &file, points, capture);
        let limit = self.rotation_noise_limit.to_degrees();
        if let Some(noise) = summary.noise_deg.filter(|n| summary.copied && *n < limit) {
            let note = format!("unchanged: the noise is {noise:.2} degrees");
            summary.notes.push(note);
        }
        summary.findings.extend(self.kept(&file, to, points));
        let solved = self.solved(job, &file, points, &mut summary);
        // The result is whole also where its page is not written.
        match write_page(job, &file, &labels, points, &summary) {
            Ok(note) => summary.notes.extend(note),
            Err(e) => summary.findings.push(format!("page: not written: {e}")),
        }
        Record {
            command: "clean",
            made_from,
            read_as: &file.read_as,
            map: match &naming {
                PointNaming::Map(map) => Some(&map.name),
                _ => None,
            },
            audit: before,
            summary: &summary,
            redone: &self.redo,
            labels: labels.record().cloned(),
            gaps: gap_lines(points),
            gaps_by_point: Vec::new(),
            outliers,
            rotations: (restored.rotations.as_ref()).map(|r| r.lines()),
            solved,
            left_out: 0,
            output: Fingerprint::read(&job.output)?,
        }
        .write(&job.output, capture.size)?;
        Ok(summary)
    }

    /// Why the labels of a file may be of several people.
    fn doubt(&self, file: &MotionFile) -> Option<String> {
        let set = MarkerSet::of(&file.poses().points).filter(|_| file.motion().is_none())?;
        doubt(file.poses(), set).map(|what| self.option_names.in_text(&format!("labels: {what}")))
    }

    /// The skeleton beside the result, if it is asked for; why there is none is a finding.
    fn solved(
        &self,
        job: &Job,
        file: &MotionFile,
        points: &Restoration<'_>,
        summary: &mut Summary,
    ) -> Option<serde_json::Value> {
        let skeletons = self
            .skeletons
            .as_ref()
            .filter(|_| !is_of_rotations(file.format))?;
        match skeletons.write(&job.output, file, points.xyz().to_owned()) {
            Ok(solved) => {
                let findings = solved["findings"].as_array().into_iter().flatten();
                let findings = findings.filter_map(|f| f.as_str());
                let findings = findings.map(|f| format!("skeleton: {f}"));
                // Whole limbs come first.
                summary.findings.splice(0..0, findings);
                Some(solved)
            }
            Err(e) => {
                summary.findings.insert(0, format!("skeleton: none: {e}"));
                Some(json!({"none": e.to_string()}))
            }
        }
    }

    /// The take as it is restored; rotations that stay rotations by themselves.
    fn restored<'t>(
        &self,
        file: &'t MotionFile,
        to: Option<OutputFormat>,
        naming: &PointNaming,
    ) -> Result<CleanedTake<'t>> {
        let table = &file.table;
        let of_points = |points| CleanedTake {
            points,
            rotations: None,
        };
        match (keeps_rotations(file, to), file.motion()) {
            (true, Some(motion)) => {
                let how = RotationCleaning {
                    noise_limit: if self.smooth {
                        self.rotation_noise_limit
                    } else {
                        f64::INFINITY
                    },
                    pops: self.method.outliers,
                    max_gap: self.method.max_gap,
                    held: held_of(file),
                };
                let rate = file.rate().unwrap_or(1.0);
                let cleaned = clean_rotations(&file.channels(), motion, rate, &how);
                let xyz = file.positions_of(cleaned.motion.view())?;
                return Ok(CleanedTake {
                    points: Restoration::followed(table, xyz),
                    rotations: Some(CleanedFile::new(file, cleaned, self.method.max_sd)),
                });
            }
            (true, None) => return Ok(of_points(Restoration::unchanged(table))),
            _ => {}
        }
        if !self.force {
            let names = naming.model_names(&table.poses.points);
            let remedy = "give the file's unit with the option `units`";
            check_body_size(&table.poses, &names, &table.name, remedy)?;
        }
        let method = Clean {
            fps: file.rate().or(Some(1.0)),
            noise_limit: if self.smooth {
                self.method.noise_limit
            } else {
                f64::INFINITY
            },
            ..self.method
        };
        let restorer = self.restorer(naming, &table.poses);
        restorer.clean(table, &method).map(of_points)
    }

    /// Empties what is to be done again; its places, and a line on each.
    fn redo(&self, file: &mut MotionFile, keeps: bool) -> Result<(Vec<PlaceToSee>, Vec<String>)> {
        if keeps && !self.redo.is_empty() {
            let what = "holds rotations, and only positions can be done again; write nan for what \
                        is bad in a BVH file, or clean it with the option `to csv`";
            return Err(Error::data(Place::file(&file.table.name), what));
        }
        let rate = file.rate();
        let (mut places, mut notes) = (Vec::new(), Vec::new());
        for segment in &self.redo {
            let emptied = redo::empty(segment, &mut file.table.poses, rate);
            let (frame, count) = emptied.map_err(|e| e.at(Place::file(&file.table.name)))?;
            let [from, to] = segment.seconds;
            notes.push(format!(
                "{count} positions of {} from {from} to {to} s counted as missing, to be done \
                 again",
                segment.point
            ));
            places.push(PlaceToSee {
                what: "done again".to_string(),
                point: Some(segment.point.clone()),
                frame,
            });
        }
        Ok((places, notes))
    }

    /// What a file of markers keeps of segments that were to be done again, and could not be
    /// filled.
    fn kept(
        &self,
        file: &MotionFile,
        to: Option<OutputFormat>,
        restored: &Restoration<'_>,
    ) -> Option<String> {
        let is_table = matches!(file.format, MotionFormat::Csv | MotionFormat::Npy);
        let points = &file.table.poses.points;
        let is_left = |segment: &Segment| {
            let find = points.iter().position(|p| *p == segment.point);
            let frames = segment.frames(&file.table.poses, file.rate());
            let is_open = |p: usize, t: &usize| restored.xyz()[[*t, 3 * p]].is_nan();
            find.is_some_and(|p| frames.iter().any(|t| is_open(p, t)))
        };
        let is_kept = !is_table && to.is_none() && self.redo.iter().any(is_left);
        let what = "redo: what could not be filled again stays in the file as it was measured";
        is_kept.then(|| what.to_string())
    }

    /// The take after the low-pass filter, and a line on that.
    fn smoothed<'t>(
        &self,
        file: &MotionFile,
        keeps: bool,
        restored: CleanedTake<'t>,
    ) -> Result<(CleanedTake<'t>, Option<String>)> {
        let Some(cutoff) = self.butterworth else {
            return Ok((restored, None));
        };
        if keeps {
            let what =
                "no low-pass filter, since the file holds rotations; as csv, its positions have it";
            return Ok((restored, Some(what.to_string())));
        }
        let (points, short) = (restored.points.low_passed(cutoff, file.rate()))
            .map_err(|e| e.at(Place::file(&file.table.name)))?;
        let restored = CleanedTake { points, ..restored };
        let mut note = format!("smoothed (Butterworth, {cutoff} Hz, forwards and backwards)");
        if short > 0 {
            note += &format!("; {short} pieces of fewer than 10 frames are not");
        }
        Ok((restored, Some(note)))
    }

    /// Whether the result is what the capture was: the same bytes, or the same numbers in the same
    /// format where all are positions and none was taken for missing.
    fn is_copied(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        file: &MotionFile,
        restored: &Restoration<'_>,
        capture: &Capture,
    ) -> bool {
        if to.is_some_and(|to| !to.is(file.format)) {
            return false;
        }
        let (was, is) = (&file.table.poses.xyz, restored.xyz());
        let is_same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
        let is_emptied = self.read.all.zeros_are_missing || !self.redo.is_empty();
        if !keeps_rotations(file, to) && !is_emptied {
            return was.iter().zip(&is).all(is_same);
        }
        let written = Input::open(&job.output).and_then(|i| i.read_all(LARGEST_MOTION_FILE));
        written.is_ok_and(|bytes| Fingerprint::of(&job.output, &bytes).sha256 == capture.sha256)
    }

    /// What is known of the settings in a record: all that changes results.
    fn recorded(
        &self,
        read: &ReadOptions,
        format: MotionFormat,
        to: Option<OutputFormat>,
    ) -> Result<serde_json::Value> {
        let mut out = json!({
            "fps": read.fps,
            "units": read.units.map(LengthUnit::name),
            "up": read.up.map(UpAxis::name),
            "joints": read.joints,
            "keep_whole": read.keep_whole,
            "model": self.model.as_ref().map(|m| m.2.clone()),
            "map": self.map.as_ref().map(|map| &map.joints),
            "noise_limit": self.method.noise_limit,
            "outliers": self.method.outliers,
            "max_gap": self.method.max_gap,
            "zeros_are_missing": read.zeros_are_missing,
            "held_is_missing": self.held_is_missing,
            "max_sd": self.method.max_sd,
            "limits": self.limits,
            "force": self.force,
            "to": to.map(OutputFormat::name),
        });
        // Results from before there were these stay, but for those of rotations.
        if is_of_rotations(format) && to.is_none() {
            out["rotation_noise_limit"] = json!(self.rotation_noise_limit.to_degrees());
        }
        if !self.smooth {
            out["smooth"] = json!(false);
        }
        if let Some(settings) = self.labels.as_ref().filter(|_| !is_of_rotations(format)) {
            out["labels"] = json!({
                "keep": settings.keep,
                "take_out": settings.take_out,
                "like": settings.like.digest(),
            });
        }
        if !self.redo.is_empty() {
            out["redo"] = json!(self.redo);
        }
        if let Some(cutoff) = self.butterworth {
            out["butterworth"] = json!(cutoff);
        }
        if let Some(skeletons) = self.skeletons.as_ref().filter(|_| !is_of_rotations(format)) {
            out["skeletons"] = skeletons.recorded()?;
        }
        Ok(out)
    }

    /// How the points of a take are named, for the model; without one, for CMU's names, by which a
    /// body is measured.
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

    /// Fails where the file in the place of the result is not what is to be written there.
    fn check_same(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        file: &MotionFile,
        restored: &CleanedTake<'_>,
    ) -> Result<()> {
        // Its name ends as that of the result, which says how it is packed.
        let suffix = format!("-{}", name_of(&job.output).display());
        let made = TemporaryFile::new(&suffix, b"").map_err(|e| Error::io(&job.output, e))?;
        let other = Job {
            output: made.path().to_path_buf(),
            ..job.clone()
        };
        self.write(&other, to, file, restored)?;
        let digest = |path| Fingerprint::read(path).map(|of| of.sha256);
        if digest(&other.output)? == digest(&job.output)? {
            return Ok(());
        }
        let what = "a run was stopped as it wrote this, and somebody may have changed it since; \
                    move it, or make it again with the option `again`";
        Err(Error::data(
            Place::file(job.output.display().to_string()),
            what,
        ))
    }

    /// Writes the file anew in its own format. How many positions its numbers do not hold, or how
    /// many values of rotations are missing still.
    fn write_back(
        &self,
        path: &Path,
        file: &MotionFile,
        restored: &CleanedTake<'_>,
    ) -> Result<usize> {
        match &restored.rotations {
            Some(rotations) => {
                file.write_channels(path, rotations.cleaned.motion.view())?;
                Ok(rotations.missing())
            }
            None => file.write_back(path, restored.points.xyz()),
        }
    }

    /// Writes the result; how many positions, or values of a BVH file, it does not hold.
    fn write(
        &self,
        job: &Job,
        to: Option<OutputFormat>,
        file: &MotionFile,
        restored: &CleanedTake<'_>,
    ) -> Result<usize> {
        let Some(to) = to.filter(|to| !to.is(file.format)) else {
            return self.write_back(&job.output, file, restored);
        };
        if let Some(table) = to.table() {
            return file
                .write_table(&job.output, table, restored.points.xyz())
                .map(|()| 0);
        }
        let units = Units {
            unit: LengthUnit::Mm,
            up: if to == OutputFormat::C3d {
                UpAxis::Z
            } else {
                UpAxis::Y
            },
        };
        let poses = Poses {
            xyz: file.whole(restored.points.xyz()),
            ..file.whole_table().poses.clone()
        };
        if poses.takes().len() > 1 {
            let what = "has several takes, which one file of markers cannot hold; clean it with \
                        the option `to csv`";
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

/// Whether the result holds rotations or columns, as the file does, and no positions.
pub(crate) fn keeps_rotations(file: &MotionFile, to: Option<OutputFormat>) -> bool {
    is_of_rotations(file.format) && to.is_none()
}

fn is_of_rotations(format: MotionFormat) -> bool {
    matches!(
        format,
        MotionFormat::Bvh | MotionFormat::Amc | MotionFormat::OpenSim
    )
}
