//! A file whose labels alone are corrected: the result, its record, and a page to look at.

use super::labels::label_table;
use super::page::write_page_of;
use super::record::{Fingerprint, make_folder_of, record_path};
use crate::draw::scene::Figure;
use crate::draw::take_page::TakePage;
use crate::error::OptionNames;
use crate::io::motion_file::ReadAs;
use crate::io::output::write_file;
use crate::io::{MotionFile, PointMove};
use crate::label::LabelReport;
use crate::{Error, Place, Result};
use serde::Serialize;
use serde_json::{Value, json};
use std::path::Path;

/// The record beside the result.
#[derive(Serialize)]
struct Record<'a> {
    command: &'static str,
    /// The version of posing.
    posing: &'static str,
    input: Fingerprint,
    /// What the file was taken for.
    read_as: &'a ReadAs,
    /// The names of computed points, which are left alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    computed: Vec<&'a str>,
    labels: &'a LabelReport,
    output: Fingerprint,
}

/// Writes a file with its labels put right, as [`check_labels`](crate::label::check_labels) found
/// them, to `output`, with the record `OUTPUT.json`, and, where something changed or is not sure,
/// the page `OUTPUT.html`. `input` is where the file came from; the page calls options
/// as `names` says. Returns a line to be told: another
/// file stands at the path of the page.
///
/// # Errors
/// [`Error::Io`]: writing fails. [`Error::Data`]: the file holds rotations, or something that is no
/// record stands at the path of that.
pub fn write_labeled(
    input: &Path,
    output: &Path,
    file: &MotionFile,
    labels: &LabelReport,
    names: OptionNames,
) -> Result<Option<String>> {
    let record = record_path(output);
    let is_ours = |text: Vec<u8>| {
        let json: Option<Value> = serde_json::from_slice(&text).ok();
        json.is_some_and(|json| json["command"] == json!("label"))
    };
    if std::fs::read(&record).is_ok_and(|text| !is_ours(text)) {
        let what = "stands in the place of a record of label; move it, or give another place \
                    with -o";
        return Err(Error::data(Place::file(record.display().to_string()), what));
    }
    make_folder_of(output)?;
    file.write_moved(output, &labels.moves)?;
    let note = write_page_of(output, page(input, file, labels, names)?.as_deref())?;
    let written = Record {
        command: "label",
        posing: env!("CARGO_PKG_VERSION"),
        input: Fingerprint::read(input)?,
        read_as: &file.read_as,
        computed: file.computed(),
        labels,
        output: Fingerprint::read(output)?,
    };
    let text = serde_json::to_string_pretty(&written).map_err(|e| Error::usage(e.to_string()))?;
    write_file(record, (text + "\n").as_bytes())?;
    Ok(note)
}

/// The page of a take whose labels were changed; `None` where there is nothing to see.
fn page(
    input: &Path,
    file: &MotionFile,
    labels: &LabelReport,
    names: OptionNames,
) -> Result<Option<String>> {
    let Some(table) = label_table(labels, names) else {
        return Ok(None);
    };
    let poses = file.poses();
    let mut moved = poses.xyz.clone();
    PointMove::make_all(&labels.moves, &mut moved);
    let name = input.file_name().unwrap_or_default().to_string_lossy();
    TakePage {
        name: &name,
        note: "The take as it is, and with its labels put right. Centimeters, y up.",
        poses,
        rate: file.rate(),
        bones: &file.bones()?,
        markers: None,
        figures: vec![
            Figure::new("labeled", moved.view()),
            Figure::new("capture", poses.xyz.view()),
        ],
        table: Some(table),
    }
    .html()
}
