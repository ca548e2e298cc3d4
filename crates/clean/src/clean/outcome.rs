//! What became of a file: it is opened, prepared, restored, written and recorded, a step a file.

use super::earlier_result::EarlierResult;
use super::labeled_beside::LabeledBeside;
use super::opened::Opened;
use super::record::{Fingerprint, Summary};
use super::settings::CleanSettings;
use super::sources::Job;
use crate::io::keypoint_files::bytes_of;
use crate::{Error, Place, Result};

/// What became of a file.
#[derive(Debug)]
pub enum FileOutcome {
    /// The file was cleaned, or copied if there was nothing to change.
    Cleaned(Summary),
    /// The result was there, made from the same.
    Unchanged(Summary),
    /// The file could not be cleaned; `old_result`: an earlier result still stands there.
    Failed {
        /// Why.
        error: Error,
        /// Whether there is one.
        old_result: bool,
    },
}

impl FileOutcome {
    /// Cleans a file; the digest of the capture, where it can be read, comes with what became of
    /// it.
    pub(super) fn of(
        settings: &CleanSettings,
        job: &Job,
        beside: &LabeledBeside,
    ) -> (FileOutcome, Option<String>) {
        let packed = bytes_of(&job.input);
        let input = packed.map(|packed| (Fingerprint::of(&job.input, &packed), packed));
        let sha256 = input.as_ref().ok().map(|(input, _)| input.sha256.clone());
        let run = || clean_file(settings, job, beside, input?);
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
            let error = error.with_option_names(settings.option_names);
            let now = EarlierResult::read(&job.output);
            let old_result = now.leave_failure(&error.to_string());
            FileOutcome::Failed { error, old_result }
        });
        (outcome, sha256)
    }

    /// What became of the file, unless it failed.
    pub(crate) fn summary(&self) -> Option<&Summary> {
        match self {
            FileOutcome::Cleaned(summary) | FileOutcome::Unchanged(summary) => Some(summary),
            FileOutcome::Failed { .. } => None,
        }
    }

    /// Why the file could not be cleaned.
    pub(crate) fn into_error(self) -> Option<Error> {
        match self {
            FileOutcome::Failed { error, .. } => Some(error),
            FileOutcome::Cleaned(_) | FileOutcome::Unchanged(_) => None,
        }
    }

    /// What became of it in one word: cleaned, copied, unchanged or failed.
    pub(crate) fn word(&self) -> &'static str {
        match self {
            FileOutcome::Cleaned(summary) if summary.copied => "copied",
            FileOutcome::Cleaned(_) => "cleaned",
            FileOutcome::Unchanged(_) => "unchanged",
            FileOutcome::Failed { .. } => "failed",
        }
    }
}

/// Takes a file, given with its bytes, from step to step.
fn clean_file(
    settings: &CleanSettings,
    job: &Job,
    beside: &LabeledBeside,
    capture: (Fingerprint, Vec<u8>),
) -> Result<FileOutcome> {
    let opened = Opened::new(settings, job, beside, capture)?;
    if let Some(summary) = opened.unchanged() {
        return Ok(FileOutcome::Unchanged(summary));
    }
    let prepared = opened.prepared()?;
    let written = prepared.restored()?.written()?;
    written.recorded().map(FileOutcome::Cleaned)
}
