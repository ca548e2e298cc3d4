//! A file of a run, and what became of it.

use super::earlier_list::EarlierList;
use super::earlier_result::EarlierResult;
use super::outcome::FileOutcome;
use super::record::record_path;
use super::sources::Job;
use crate::draw::take_page::{is_take_page, page_beside};
use std::path::{Path, PathBuf};

/// A file and what became of it.
pub struct Row {
    /// Its name in tables.
    pub name: String,
    /// What became of it.
    pub outcome: FileOutcome,
    /// The SHA-256 of the capture; none of what cannot be read.
    pub sha256: Option<String>,
    /// Its findings that the last run did not have.
    pub new: Vec<String>,
    /// Whether it failed, and not in the same way in the last run.
    pub is_new_failure: bool,
    /// The path of its result; a folder that cannot be read has none.
    output: Option<PathBuf>,
}

impl Row {
    /// A file, or a folder that cannot be read, which has no job.
    pub(crate) fn new(
        name: String,
        (outcome, sha256): (FileOutcome, Option<String>),
        job: Option<&Job>,
        last: &EarlierList,
    ) -> Row {
        let digest = sha256.as_deref();
        let findings = outcome.summary().map_or(&[][..], |s| &s.findings);
        let new = (findings.iter())
            .filter(|finding| !last.has(&name, digest, finding))
            .cloned()
            .collect();
        let is_new_failure = match &outcome {
            FileOutcome::Failed { error, .. } => {
                !last.has_failure(&name, digest, &error.to_string())
            }
            _ => false,
        };
        Row {
            output: job.map(|job| job.output.clone()),
            name,
            outcome,
            sha256,
            new,
            is_new_failure,
        }
    }

    /// Whether it failed.
    pub(crate) fn has_failed(&self) -> bool {
        matches!(self.outcome, FileOutcome::Failed { .. })
    }

    /// Whether there is something that the last run did not tell.
    pub(crate) fn has_news(&self) -> bool {
        !self.new.is_empty() || self.is_new_failure
    }

    /// The result, where there is one.
    pub(crate) fn result(&self) -> Option<PathBuf> {
        let is_there = match self.outcome {
            FileOutcome::Failed { old_result, .. } => old_result,
            _ => true,
        };
        self.output.clone().filter(|_| is_there)
    }

    /// Its record, where there is one.
    pub(crate) fn record(&self) -> Option<PathBuf> {
        let output = self.output.as_deref();
        let has_record = |output: &&Path| EarlierResult::read(output).has_record();
        output.filter(has_record).map(record_path)
    }

    /// The page of the take, where there is one.
    pub fn page(&self) -> Option<PathBuf> {
        let page = page_beside(&self.result()?);
        is_take_page(&page).then_some(page)
    }
}
