//! One self-contained HTML page that plays meshes with WebGL 2: nothing is fetched, the meshes are
//! inside.
//!
//! The page shares the controls and the looks of the page of poses.

mod packed;

use super::parts::{PAPER, Part, parts};
use super::{PART, Page, frames_left_out, paragraphs, whole_page};
use crate::html::{fill, script_json};
use crate::mesh_scene::{MeshFigure, MeshScene, round_length};
use crate::numeric::statistics::median;
use crate::{Error, Place, Result};
use packed::{Packed, packed};
use serde_json::{Value, json};
use std::sync::LazyLock;

const STYLE: &str = concat!(
    include_str!("../player.css"),
    include_str!("../page.css"),
    include_str!("mesh.css"),
);
static SCRIPT: LazyLock<String> = LazyLock::new(|| {
    let (unpack, solid) = (include_str!("unpack.js"), include_str!("solid.js"));
    let player = parts(&[Part::Playback]);
    let (view, start) = (include_str!("view.js"), include_str!("start.js"));
    format!(
        "{PAPER}{unpack}{solid}\nfunction player(root, scene, figures) {{{player}{view}}}\n{start}"
    )
});
const WIRES: &str = include_str!("wires.html");
const OWN_KEYS: &str = "<dt><kbd>m</kbd></dt><dd>edges of the triangles</dd>";

/// Largest size of the coordinates in a page, bytes of base64.
const LIMIT: usize = 24_000_000;
/// Frames a second of a page whose scene has no rate.
const UNKNOWN_RATE: f64 = 10.0;
/// Where the camera stands at first, degrees: 0 at +z, 90 at +x.
const AZIMUTH: f64 = 30.0;

/// The page that plays meshes: HTML, complete in itself, the same bytes for the same scene. It has
/// one frame of every `every`; `None`: as many as 24 MB of compressed coordinates allow. A figure
/// of one frame stands beside the others throughout.
///
/// Coordinates are rounded to 1/25,000 of the largest side of the figure's box: 0.04 mm at most for
/// a body of 2 m.
///
/// # Errors
/// [`Error::Data`]: no meshes, vertices or faces, a face of a vertex that is not there, a
/// coordinate that is not finite; figures of several frames differ in their number; a single frame
/// is larger than 24 MB. [`Error::Usage`]: a rate that is not above 0, or `every` is 0.
pub fn page(scene: &MeshScene<'_>, every: Option<usize>) -> Result<String> {
    page_within(scene, every, LIMIT)
}

fn page_within(scene: &MeshScene<'_>, every: Option<usize>, limit: usize) -> Result<String> {
    scene.check()?;
    if every == Some(0) {
        return Err(Error::usage("every 0th frame: must be at least 1"));
    }
    let frames = frames(scene)?;
    let (every, figures) = match every {
        Some(every) => (every, pack(scene, every)),
        None => sparing(scene, frames, limit)?,
    };
    let data = script_json(&embedded(scene, frames, every, &figures));
    let values = [
        ("attributes", " data-alone"),
        ("more", WIRES),
        ("scene", &data),
    ];
    Ok(whole_page(&Page {
        title: if scene.title.is_empty() {
            "Meshes"
        } else {
            scene.title
        },
        note: scene.note,
        table: scene.table.as_ref(),
        credit: scene.credit,
        player: &fill(PART, &values),
        remarks: &remarks(scene, frames, every, &figures),
        keys: OWN_KEYS,
        links: "<code>&amp;wires</code>, ",
        style: STYLE,
        script: &SCRIPT,
    }))
}

/// The number of frames of all figures that have several.
fn frames(scene: &MeshScene<'_>) -> Result<usize> {
    let Some(longest) = scene.figures.iter().max_by_key(|f| f.frames()) else {
        return Ok(0);
    };
    let frames = longest.frames();
    let differs = |f: &&MeshFigure<'_>| f.frames() != 1 && f.frames() != frames;
    if let Some(other) = scene.figures.iter().find(differs) {
        let what = format!(
            "has {} meshes, {} has {frames}; sequences played together have the same number, or \
             one",
            other.frames(),
            longest.name
        );
        return Err(Error::data(Place::file(other.name), what));
    }
    Ok(frames)
}

/// One frame of every `every` of each figure.
fn pack(scene: &MeshScene<'_>, every: usize) -> Vec<Packed> {
    let kept = |f: &MeshFigure<'_>| (0..f.frames()).step_by(every).collect::<Vec<_>>();
    let figures = scene.figures.iter();
    figures.map(|f| packed(f, &kept(f))).collect()
}

/// The smallest step through the frames, or nearly so, that keeps the coordinates within `limit`.
fn sparing(scene: &MeshScene<'_>, frames: usize, limit: usize) -> Result<(usize, Vec<Packed>)> {
    // No motion is packed into a thirtieth, so frames beyond that need not be tried.
    let numbers: usize = scene.figures.iter().map(|f| f.vertices.len()).sum();
    let mut every = (numbers * 2 * 4 / 3 / 30).div_ceil(limit).max(1);
    loop {
        let figures = pack(scene, every);
        let size: usize = figures
            .iter()
            .map(|f| f.positions.len() + f.faces.len())
            .sum();
        if size <= limit {
            return Ok((every, figures));
        }
        if every >= frames {
            let (mb, most) = (size / 1_000_000, limit / 1_000_000);
            let what = format!("one frame takes {mb} MB of a page, at most {most} are possible");
            return Err(Error::data(Place::file(scene.figures[0].name), what));
        }
        every = (every * size).div_ceil(limit).clamp(every + 1, frames);
    }
}

/// Everything the script reads.
fn embedded(scene: &MeshScene<'_>, frames: usize, every: usize, packed: &[Packed]) -> Value {
    let (ground, size) = scene.figures.first().map_or((0.0, 1.0), ground_and_size);
    let figures = scene.figures.iter().zip(packed);
    let figures = figures.map(|(figure, packed)| embedded_figure(figure, every, packed));
    json!({
        "frames": frames.div_ceil(every),
        "of": frames,
        "rate": scene.rate.unwrap_or(UNKNOWN_RATE) / every as f64,
        "timed": scene.rate.is_some(),
        "every": every,
        "runs": [],
        "start": 0,
        "azimuth": AZIMUTH,
        "ground": ground,
        "size": size,
        "step": round_length(size),
        "inCm": scene.in_cm,
        "figures": figures.collect::<Vec<_>>(),
    })
}

/// What the script reads of a figure.
fn embedded_figure(figure: &MeshFigure<'_>, every: usize, packed: &Packed) -> Value {
    let labels = figure.labels.iter().step_by(every);
    json!({
        "name": figure.name,
        "frames": packed.origins.len(),
        "vertices": figure.vertices.dim().1,
        "step": packed.step,
        "origins": packed.origins,
        "places": packed.positions,
        "faces": packed.faces,
        "labels": labels.collect::<Vec<_>>(),
    })
}

/// Height of the ground, where a figure's lowest vertex is in its lowest frames, and the usual
/// diagonal of its box.
fn ground_and_size(figure: &MeshFigure<'_>) -> (f64, f64) {
    let boxes: Vec<_> = (0..figure.frames()).map(|t| figure.extent(t)).collect();
    let mut lows: Vec<f32> = boxes.iter().map(|b| b[1][0]).collect();
    let side = |[low, high]: [f32; 2]| (f64::from(high) - f64::from(low)).powi(2);
    let sizes = (boxes.iter())
        .map(|b| b.iter().map(|s| side(*s)).sum::<f64>().sqrt())
        .collect();
    lows.sort_by(f32::total_cmp);
    let size = median(sizes).unwrap_or(0.0);
    // As for poses, the 1% quantile: one wrong frame must not move the ground.
    let ground = f64::from(lows[lows.len() / 100]);
    (ground, if size > 0.0 { size } else { 1.0 })
}

/// Remarks on frames left out, on the rate, and on the rounding of positions.
fn remarks(scene: &MeshScene<'_>, frames: usize, every: usize, packed: &[Packed]) -> String {
    let mut remarks: Vec<String> = frames_left_out(every, frames).into_iter().collect();
    if scene.rate.is_none() && frames > 1 {
        remarks.push(format!(
            "The frame rate is not known: {UNKNOWN_RATE} frames a second are shown."
        ));
    }
    let largest = packed.iter().map(|p| 0.5 * p.step).fold(0.0, f64::max);
    let error = if scene.in_cm {
        format!("{:.3} mm", 10.0 * largest)
    } else {
        "1/50,000 of the figure's largest side".into()
    };
    remarks.push(format!("Positions are rounded, by at most {error}."));
    paragraphs(&remarks)
}

#[cfg(test)]
mod tests;
