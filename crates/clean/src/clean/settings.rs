//! How files are cleaned.

use super::name_source::NamingSettings;
use super::skeleton::SkeletonSettings;
use super::sources::{Job, OutputFormat, is_of_rotations};
use crate::Result;
use crate::audit::Limits;
use crate::error::OptionNames;
use crate::io::motion_file::{ReadOptions, ReadRules};
use crate::io::{Model, MotionFormat};
use crate::label::LabelSettings;
use crate::pose::{LengthUnit, NameMap, Segment, UpAxis};
use crate::restore::Clean;
use crate::restore::inbetween::MotionLibrary;
use serde_json::json;

/// How files are cleaned.
pub struct CleanSettings {
    /// What is taken for files that do not say it.
    pub read: ReadRules,
    /// The model, its name in messages, and the digest of its bytes; `None`: each take by itself.
    pub model: Option<(Model, String, String)>,
    /// Motion that may fill gaps of a whole body, and the digest of its bytes; `None`: each take's
    /// own.
    pub motion: Option<(MotionLibrary, String)>,
    /// The map of names that was asked for.
    pub map: Option<NameMap>,
    /// How takes are restored.
    pub method: Clean,
    /// The noise over which the rotations of a file that keeps them are smoothed, radians about an
    /// axis.
    pub rotation_noise_limit: f64,
    /// How labels are put right first, if they are.
    pub labels: Option<LabelSettings>,
    /// What names tracks without names, beside labeled takes in their folders.
    pub naming: NamingSettings,
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

impl CleanSettings {
    /// Motion that may fill gaps of a whole body.
    pub(super) fn library(&self) -> Option<&MotionLibrary> {
        self.motion.as_ref().map(|(library, _)| library)
    }

    /// What is known of the settings in a record: all that changes results.
    ///
    /// # Errors
    /// None for marker sets of finite numbers.
    pub(super) fn recorded(
        &self,
        job: &Job,
        format: MotionFormat,
        read: &ReadOptions,
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
            "max_sd": self.method.most_sd(),
            "limits": self.limits,
            "force": self.force,
            "to": job.to.map(OutputFormat::name),
        });
        // Results from before there were these stay, but for those of rotations.
        if job.keeps_rotations(format) {
            out["rotation_noise_limit"] = json!(self.rotation_noise_limit.to_degrees());
        }
        if self.method.max_sd.is_some() {
            out["max_sd_is_given"] = json!(true);
        }
        if !self.smooth {
            out["smooth"] = json!(false);
        }
        if let Some((_, digest)) = &self.motion {
            out["motion"] = json!(digest);
        }
        if let Some(settings) = self.labels.as_ref().filter(|_| !is_of_rotations(format)) {
            out["labels"] = json!({
                "keep": settings.keep,
                "take_out": settings.take_out,
                "like": settings.like.digest(),
            });
            if !settings.exchange.is_empty() {
                out["labels"]["exchange"] = json!(settings.exchange);
            }
            if let Some(set) = &self.naming.set_digest {
                out["labels"]["set"] = json!(set);
            }
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

    /// A limit of noise; where no noise is removed, one that nothing is over.
    pub(super) fn unless_noise_stays(&self, limit: f64) -> f64 {
        if self.smooth { limit } else { f64::INFINITY }
    }
}
