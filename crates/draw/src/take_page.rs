//! The page of one take beside a report of many: it plays the take, with curves and a list of gaps.

use super::player;
use super::scene::{Figure, Scene, Table, runs};
use crate::Result;
use crate::io::output::write_file;
use crate::pose::Poses;
use std::io::Read;
use std::path::{Path, PathBuf};

/// What the titles of these pages begin with; by it they are known again.
const TITLE: &str = "Take in posing: ";
/// The title of a page stands among its first bytes.
const HEAD: u64 = 4096;
/// Most bytes of coordinates in a page: a longer take is shown at every few frames.
const MOST_BYTES: usize = 4_000_000;
/// Bytes of a point of a frame and figure, as the page has it.
const BYTES: usize = 16;
/// A page of more points is drawn too slowly.
const MOST_POINTS: usize = 1000;

/// A take to show.
pub struct TakePage<'a> {
    /// Its name.
    pub name: &'a str,
    /// One sentence.
    pub note: &'a str,
    /// Its frames and points.
    pub poses: &'a Poses,
    /// Frames a second, where it has no times.
    pub rate: Option<f64>,
    /// Pairs of points to join.
    pub bones: &'a [(usize, usize)],
    /// From which point on they are markers, with lines to the bones that they are on.
    pub markers: Option<usize>,
    /// How the points stand, over all frames.
    pub figures: Vec<Figure<'a>>,
    /// A table below it.
    pub table: Option<Table>,
}

impl TakePage<'_> {
    /// The page; `None` of takes that cannot be played: without frames, or of very many points.
    ///
    /// # Errors
    /// The page, as [`player::page`] makes it.
    pub fn html(&self) -> Result<Option<String>> {
        let (frames, points) = (self.poses.frames(), self.poses.points.len());
        if frames == 0 || points == 0 || points > MOST_POINTS {
            return Ok(None);
        }
        let rate = self.rate.filter(|rate| rate.is_finite() && *rate > 0.0);
        let rate = rate.unwrap_or(1.0);
        let most = MOST_BYTES / (BYTES * points * self.figures.len().max(1));
        let (title, runs) = (format!("{TITLE}{}", self.name), runs(self.poses, rate));
        let scene = Scene {
            title: &title,
            points: &self.poses.points,
            bones: self.bones,
            markers: self.markers,
            rate,
            figures: self.figures.iter().map(seen).collect(),
            runs: &runs,
            note: Some(self.note),
            table: self.table.clone(),
            ..Scene::default()
        };
        player::page(&scene, Some(frames.div_ceil(most.max(1)))).map(Some)
    }
}

/// A figure, borrowed for less long.
fn seen<'s>(figure: &'s Figure<'_>) -> Figure<'s> {
    Figure {
        name: figure.name,
        xyz: figure.xyz.view(),
        status: figure.status.as_ref().map(|s| s.view()),
        sd: figure.sd.as_ref().map(|s| s.view()),
        method: figure.method.as_ref().map(|m| m.view()),
    }
}

/// The path of a take's page beside a file.
pub fn page_beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".html");
    PathBuf::from(name)
}

/// Whether a file is such a page.
pub fn is_take_page(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|f| f.take(HEAD).read_to_end(&mut head));
    read.is_ok() && String::from_utf8_lossy(&head).contains(&format!("<title>{TITLE}"))
}

/// Writes a page, or removes the one that is there where a take has none any more; a file that is
/// no such page stays. Returns whether the page is there.
///
/// # Errors
/// [`crate::Error::Io`]: writing fails.
pub fn write_take_page(path: &Path, page: Option<&str>) -> Result<bool> {
    let is_there = path.symlink_metadata().is_ok();
    if is_there && !is_take_page(path) {
        return Ok(false);
    }
    match page {
        Some(page) => write_file(path, page.as_bytes()).map(|()| true),
        None => {
            if is_there {
                // What stays of an old page is seen by its title.
                let _ = std::fs::remove_file(path);
            }
            Ok(false)
        }
    }
}
