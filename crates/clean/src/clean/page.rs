//! The page of a take beside its result.

use super::labels::label_table;
use super::record::Summary;
use super::restored::Restored;
use crate::Result;
use crate::draw::scene::Figure;
use crate::draw::take_page::{TakePage, page_beside, write_take_page};
use ndarray::Array2;
use std::path::Path;

/// Writes the page of a take in which there is something to see; a line, where another file stands
/// at its path.
///
/// # Errors
/// [`crate::Error::Io`]: writing fails.
pub(crate) fn write_page(restored: &Restored<'_>, summary: &Summary) -> Result<Option<String>> {
    let is_seen = !summary.places.is_empty() || !summary.findings.is_empty() || summary.denoised;
    let html = if is_seen { take_page(restored)? } else { None };
    write_page_of(&restored.take.run.job.output, html.as_deref())
}

/// Writes the page of a result, or removes its old one. Returns a line to be told: another file
/// stands at its path.
///
/// # Errors
/// [`crate::Error::Io`]: writing fails.
pub(super) fn write_page_of(output: &Path, html: Option<&str>) -> Result<Option<String>> {
    let path = page_beside(output);
    let is_written = write_take_page(&path, html)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let in_the_way = || format!("no page of the take: {name} is there and is none of posing's");
    Ok((html.is_some() && !is_written).then(in_the_way))
}

/// The page of a take: the capture, and the result beside it where that differs.
fn take_page(restored: &Restored<'_>) -> Result<Option<String>> {
    let (take, restored) = (restored.take, &restored.points);
    let poses = &take.file.table.poses;
    let shape = (poses.frames(), poses.points.len());
    let status = Array2::from_shape_fn(shape, |(t, p)| restored.status(t, p));
    let sd = Array2::from_shape_fn(shape, |(t, p)| restored.sd(t, p));
    let method = Array2::from_shape_fn(shape, |(t, p)| restored.method(t, p));
    let captured = take.labels.captured(&take.file);
    let mut figures = vec![Figure::new("capture", captured)];
    if restored.xyz() != captured {
        figures.push(Figure {
            status: Some(status.view()),
            sd: Some(sd.view()),
            method: Some(method.view()),
            ..Figure::new("cleaned", restored.xyz())
        });
    }
    TakePage {
        name: &take.run.job.name,
        note: "The capture, and beside it the result where it differs. Centimeters, y up.",
        poses,
        rate: take.file.rate(),
        bones: &take.file.bones()?,
        markers: None,
        figures,
        table: label_table(&take.labels.report, take.labels.option_names),
    }
    .html()
}
