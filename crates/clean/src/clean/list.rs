//! The list of a run beside its page: a row for each file, for programs.

use super::outcome::FileOutcome;
use super::person::TakePerson;
use super::places::PlaceToSee;
use super::row::Row;
use crate::draw::href::relative;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The path of the list beside a page.
pub(crate) fn list_path(page: &Path) -> PathBuf {
    page.with_extension("json")
}

/// The list as JSON; paths are relative to `folder`.
///
/// # Errors
/// [`Error::Usage`]: never of such rows.
pub(crate) fn list(rows: &[Row], folder: &Path) -> Result<String> {
    let json = serde_json::to_string_pretty(&entries(rows, folder));
    let json = json.map_err(|e| Error::usage(e.to_string()))?;
    Ok(json + "\n")
}

/// The entries of the list.
pub(crate) fn entries(rows: &[Row], folder: &Path) -> Vec<Value> {
    rows.iter().map(|row| listed(row, folder)).collect()
}

fn listed(row: &Row, folder: &Path) -> Value {
    let address = |path: Option<PathBuf>| path.map(|path| relative(folder, &path));
    let mut out = json!({
        "command": "clean",
        "file": row.name,
        "sha256": row.sha256,
        "outcome": row.outcome.word(),
        "findings": [],
        "new_findings": row.new,
        "error": null,
        "result": address(row.result()),
        "record": address(row.record()),
        "page": address(row.page()),
    });
    match (&row.outcome, row.outcome.summary()) {
        (FileOutcome::Failed { error, old_result }, _) => {
            out["error"] = json!(error.to_string());
            out["old_result"] = json!(old_result);
        }
        (_, Some(s)) => {
            out["findings"] = json!(s.findings);
            out["places"] = s
                .places
                .iter()
                .map(|place| found_at(place, s.rate))
                .collect();
            out["named_by"] = json!(s.named_by);
            out["names_fit"] = json!(s.names_fit);
            out["put_right"] = json!(s.put_right);
            out["people"] = s.people.iter().map(|p| person(row, p, &address)).collect();
            out["notes"] = json!(s.notes);
            out["format"] = json!(s.format);
            for (key, value) in [
                ("frames", s.frames),
                ("points", s.points),
                ("missing", s.missing),
                ("filled", s.filled),
                ("outliers", s.outliers),
            ] {
                out[key] = json!(value);
            }
            out["rate"] = json!(s.rate);
            out["noise"] = json!(s.noise);
            if let Some(noise) = s.noise_deg {
                out["noise_deg"] = json!(noise);
            }
            out["denoised"] = json!(s.denoised);
            out["copied"] = json!(s.copied);
        }
        _ => {}
    }
    out
}

/// A person of a take: the file of the skeleton, or why there is none.
fn person(
    row: &Row,
    of: &TakePerson,
    address: &dyn Fn(Option<PathBuf>) -> Option<String>,
) -> Value {
    let beside = |file: &String| row.result().map(|result| result.with_file_name(file));
    json!({
        "person": of.person,
        "file": address(of.file.as_ref().and_then(beside)),
        "none": of.none,
    })
}

/// A place to look at, in frames and in seconds.
fn found_at(place: &PlaceToSee, rate: Option<f64>) -> Value {
    json!({
        "finding": place.finding,
        "what": place.what,
        "point": place.point,
        "frames": place.frames(),
        "seconds": place.seconds(rate),
    })
}
