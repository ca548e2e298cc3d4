//! Writing C3D files: into the bytes of another, and anew.

use super::header::Layout;
use super::numbers::Processor;
use super::parameters::{TEXT, continued};
use super::points;
use super::{BLOCK, C3d};
use crate::output::write_file;
use crate::point_move::PointMove;
use crate::pose::{Poses, Units};
use crate::text::excerpt;
use crate::{Error, Place, Result};
use ndarray::ArrayView2;
use std::path::Path;

/// The most blocks of parameters.
pub(super) const MOST_BLOCKS: usize = 255;
/// The bytes of a name at most.
pub(super) const LONGEST_NAME: usize = 255;
/// The most items that one parameter holds.
pub(super) const MOST_ITEMS: usize = 255;
/// The most points that the header counts.
pub(super) const MOST_POINTS: usize = u16::MAX as usize;

impl C3d {
    /// The bytes of the file with its points at `xyz` (frames, 3 P, in the file's units and axes;
    /// NaN: invalid). A point that stays as it is keeps its residual and cameras, one that
    /// changes gets a residual of 0; all other bytes stay.
    ///
    /// # Errors
    /// [`Error::Data`]: another shape, or a coordinate that the file's integers do not hold.
    pub fn with_points(&self, xyz: ArrayView2<'_, f64>) -> Result<Vec<u8>> {
        let place = || Place::file(&self.take.name);
        if xyz.dim() != self.take.xyz.dim() {
            let what = format!(
                "has {} frames of {} points, the table {} of {}",
                self.take.xyz.nrows(),
                self.take.xyz.ncols() / 3,
                xyz.nrows(),
                xyz.ncols() / 3
            );
            return Err(Error::data(place(), what));
        }
        let mut bytes = self.bytes.clone();
        for t in 0..self.layout.frames {
            for p in 0..self.layout.points {
                let point = [0, 1, 2].map(|c| xyz[[t, 3 * p + c]]);
                let point = point.iter().all(|v| v.is_finite()).then_some(point);
                let new = points::encode(point, &self.layout).map_err(|value| {
                    let what = format!(
                        "{value} does not fit into its integers of {} {}",
                        self.layout.scale,
                        self.take.units.as_deref().unwrap_or("units")
                    );
                    Error::data(place().part(self.take.points[p].clone()), what)
                })?;
                let at = self.layout.point_at(t, p);
                let old = &mut bytes[at..at + new.len()];
                let was = points::decode(old, &self.layout);
                if points::decode(&new, &self.layout) != was {
                    old.copy_from_slice(&new);
                }
            }
        }
        Ok(bytes)
    }

    /// The bytes of the file with positions moved between its points, and with them residuals and
    /// cameras; a point that is left is invalid.
    ///
    /// # Errors
    /// None for moves between its points.
    pub(crate) fn with_moved(&self, moves: &[PointMove]) -> Result<Vec<u8>> {
        let invalid = points::encode(None, &self.layout).map_err(|value| {
            let what = format!("does not hold {value}");
            Error::data(Place::file(&self.take.name), what)
        })?;
        let mut bytes = self.bytes.clone();
        let range = |t: usize, p: usize| {
            let at = self.layout.point_at(t, p);
            at..at + invalid.len()
        };
        for step in moves {
            for t in step.frames.clone() {
                bytes[range(t, step.from)].copy_from_slice(&invalid);
            }
        }
        for step in moves {
            for t in step.frames.clone() {
                if let Some(to) = step.to {
                    bytes[range(t, to)].copy_from_slice(&self.bytes[range(t, step.from)]);
                }
            }
        }
        Ok(bytes)
    }

    /// The bytes of the file with the points of `poses` (centimeters, y up), by their names, in the
    /// file's `units`; points that `poses` does not have stay. An empty position becomes an
    /// invalid one. `name` is that of the poses in messages.
    ///
    /// # Errors
    /// [`Error::Data`]: the frames differ, or the file has no such point; those of
    /// [`C3d::with_points`].
    pub fn with_poses(&self, poses: &Poses, units: Units, name: &str) -> Result<Vec<u8>> {
        let mut xyz = self.take.xyz.clone();
        let bad = |what: String| Error::data(Place::file(name), what);
        if poses.frames() != xyz.nrows() {
            return Err(bad(format!(
                "has {} frames, {} has {}",
                poses.frames(),
                self.take.name,
                xyz.nrows()
            )));
        }
        for (from, point) in poses.points.iter().enumerate() {
            let Some(to) = self.take.points.iter().position(|p| p == point) else {
                return Err(bad(format!(
                    "has a point \"{point}\", which {} does not have",
                    self.take.name
                )));
            };
            for t in 0..poses.frames() {
                let mut position = [0, 1, 2].map(|c| poses.xyz[[t, 3 * from + c]]);
                units.write(&mut position);
                (0..3).for_each(|c| xyz[[t, 3 * to + c]] = position[c]);
            }
        }
        self.with_points(xyz.view())
    }

    /// Writes the file with the points that its take has now; see [`C3d::with_points`].
    ///
    /// # Errors
    /// Those of [`C3d::with_points`]; [`Error::Io`]: writing fails.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_file(path, &self.with_points(self.take.xyz.view())?)
    }
}

/// What a new file says of its points.
#[derive(Debug, Clone)]
pub(crate) struct NewC3d<'a> {
    /// The points' names (P).
    pub points: &'a [String],
    /// Frames a second.
    pub rate: f64,
    /// The number of the first frame, from 1.
    pub first_frame: u32,
    /// The unit of length, such as `mm`.
    pub units: &'a str,
    /// The axes to the right and up, such as `+X` and `+Z`.
    pub screen: [&'a str; 2],
}

impl NewC3d<'_> {
    /// The bytes of a file of reals for Intel processors with these points (frames, 3 P; NaN:
    /// invalid).
    ///
    /// # Errors
    /// [`Error::Usage`]: no points or frames, or more than the format counts.
    pub(crate) fn bytes(&self, xyz: ArrayView2<'_, f64>) -> Result<Vec<u8>> {
        let frames = xyz.nrows();
        if self.points.is_empty() || self.points.len() > MOST_POINTS || frames == 0 {
            let what = format!(
                "C3D files hold 1 to {MOST_POINTS} points and at least one frame, not {} and \
                 {frames}",
                self.points.len()
            );
            return Err(Error::usage(what));
        }
        if let Some(long) = self.points.iter().find(|name| name.len() > LONGEST_NAME) {
            let what = format!(
                "the name of a point in a C3D file has {LONGEST_NAME} bytes at most, \"{}\" more",
                excerpt(long)
            );
            return Err(Error::usage(what));
        }
        let last = u32::try_from(frames - 1)
            .ok()
            .and_then(|n| self.first_frame.checked_add(n));
        let last = last.ok_or_else(|| Error::usage("C3D files hold 2^32 frames at most"))?;
        let parameters = self.parameters(frames, last);
        if parameters.len() > MOST_BLOCKS * BLOCK {
            let what = "the names of the points do not fit into a C3D file's parameters";
            return Err(Error::usage(what));
        }
        let layout = Layout {
            processor: Processor::Intel,
            real: true,
            scale: 1.0,
            points: self.points.len(),
            analog: 0,
            start: BLOCK + parameters.len(),
            frames,
            first_frame: self.first_frame,
            rate: self.rate,
        };
        let mut bytes = self.header(&layout, last);
        bytes.extend(parameters);
        for row in xyz.rows() {
            for p in row.to_vec().chunks_exact(3) {
                let point = p
                    .iter()
                    .all(|v| v.is_finite())
                    .then_some([p[0], p[1], p[2]]);
                // Reals hold every number.
                bytes.extend(points::encode(point, &layout).unwrap_or_default());
            }
        }
        bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
        Ok(bytes)
    }

    fn header(&self, layout: &Layout, last: u32) -> Vec<u8> {
        let counted = |frame: u32| u16::try_from(frame).unwrap_or(u16::MAX);
        let mut bytes = vec![2, 0x50];
        for word in [
            layout.points as u16,
            0,
            counted(self.first_frame),
            counted(last),
            0,
        ] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend((-1_f32).to_le_bytes());
        bytes.extend(((layout.start / BLOCK + 1) as u16).to_le_bytes());
        bytes.extend(0_u16.to_le_bytes());
        bytes.extend((self.rate as f32).to_le_bytes());
        bytes.resize(BLOCK, 0);
        bytes
    }

    /// The parameter section, whole blocks.
    fn parameters(&self, frames: usize, last: u32) -> Vec<u8> {
        // The block of the first frame is known when the section's length is.
        let blocks = self.section(frames, last, 0).len() / BLOCK;
        self.section(frames, last, 2 + blocks as u16)
    }

    fn section(&self, frames: usize, last: u32, data_start: u16) -> Vec<u8> {
        let words = |frame: u32| [frame as u16, (frame >> 16) as u16];
        let mut section = Section(vec![1, 0x50, 0, 84]);
        section.group(1, "POINT");
        section.integers(1, "USED", &[self.points.len() as u16]);
        section.reals(1, "SCALE", &[-1.0]);
        section.reals(1, "RATE", &[self.rate as f32]);
        section.integers(1, "DATA_START", &[data_start]);
        section.integers(1, "FRAMES", &[u16::try_from(frames).unwrap_or(u16::MAX)]);
        section.texts(1, "UNITS", &[self.units]);
        section.texts(1, "X_SCREEN", &[self.screen[0]]);
        section.texts(1, "Y_SCREEN", &[self.screen[1]]);
        for (name, labels) in continued("LABELS").zip(self.points.chunks(MOST_ITEMS)) {
            section.entry(1, &name, &text_value(labels));
        }
        section.group(2, "TRIAL");
        section.integers(2, "ACTUAL_START_FIELD", &words(self.first_frame));
        section.integers(2, "ACTUAL_END_FIELD", &words(last));
        section.group(3, "ANALOG");
        section.integers(3, "USED", &[0]);
        section.finish()
    }
}

/// The value of a parameter of texts, as its type, its dimensions and its data: all as wide as the
/// longest.
pub(super) fn text_value<T: AsRef<[u8]>>(texts: &[T]) -> Vec<u8> {
    let longest = texts.iter().map(|t| t.as_ref().len()).max().unwrap_or(0);
    let width = longest.clamp(1, LONGEST_NAME);
    let mut value = vec![TEXT, 2, width as u8, texts.len() as u8];
    for text in texts {
        let mut cell = text.as_ref().to_vec();
        cell.resize(width, b' ');
        value.extend(cell);
    }
    value
}

/// A parameter section that is being written.
struct Section(Vec<u8>);

impl Section {
    fn group(&mut self, id: i8, name: &str) {
        self.entry(-id, name, &[]);
    }

    fn integers(&mut self, group: i8, name: &str, values: &[u16]) {
        let data = values.iter().flat_map(|v| v.to_le_bytes());
        self.parameter(group, name, 2, &[values.len() as u8], data.collect());
    }

    fn reals(&mut self, group: i8, name: &str, values: &[f32]) {
        let data = values.iter().flat_map(|v| v.to_le_bytes());
        self.parameter(group, name, 4, &[values.len() as u8], data.collect());
    }

    fn texts(&mut self, group: i8, name: &str, texts: &[&str]) {
        self.entry(group, name, &text_value(texts));
    }

    /// A single number has no dimension.
    fn parameter(&mut self, group: i8, name: &str, kind: i8, sizes: &[u8], data: Vec<u8>) {
        let sizes = if sizes == [1] { &[][..] } else { sizes };
        let mut bytes = vec![kind as u8, sizes.len() as u8];
        bytes.extend(sizes);
        bytes.extend(data);
        self.entry(group, name, &bytes);
    }

    /// A group or a parameter without a description.
    fn entry(&mut self, group: i8, name: &str, value: &[u8]) {
        self.0.extend([name.len() as u8, group as u8]);
        self.0.extend(name.as_bytes());
        let to_next = (2 + value.len() + 1) as u16;
        self.0.extend(to_next.to_le_bytes());
        self.0.extend(value);
        self.0.push(0);
    }

    fn finish(mut self) -> Vec<u8> {
        self.0.extend([0, 0]);
        self.0.resize(self.0.len().next_multiple_of(BLOCK), 0);
        self.0[2] = (self.0.len() / BLOCK) as u8;
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Input;
    use ndarray::Array2;

    #[test]
    fn frames_beyond_what_the_header_counts_come_back() {
        for (first_frame, frames) in [(1, 3), (70_000, 2), (60_000, 70_000)] {
            let new = NewC3d {
                points: &["a".to_string()],
                rate: 100.0,
                first_frame,
                units: "mm",
                screen: ["+X", "+Z"],
            };
            let mut xyz = Array2::from_shape_fn((frames, 3), |(t, c)| (t % 100 + c) as f64);
            xyz.row_mut(1).fill(f64::NAN);
            let bytes = new.bytes(xyz.view()).unwrap();
            let input = Input::new("t", std::io::Cursor::new(bytes.clone())).unwrap();
            let back = C3d::read(input, false).unwrap();
            assert_eq!(
                (back.take.first_frame, back.take.xyz.nrows()),
                (first_frame, frames)
            );
            assert!(back.take.xyz[[1, 0]].is_nan() && back.take.xyz[[0, 2]] == 2.0);
            assert_eq!(back.with_points(xyz.view()).unwrap(), bytes);
        }
        let long = ["x".repeat(300)];
        let new = NewC3d {
            points: &long,
            rate: 100.0,
            first_frame: 1,
            units: "mm",
            screen: ["+X", "+Z"],
        };
        assert!(new.bytes(Array2::zeros((1, 3)).view()).is_err());
    }

    #[test]
    fn frames_do_not_overlap_the_parameters() {
        let new = NewC3d {
            points: &["a".to_string()],
            rate: 100.0,
            first_frame: 1,
            units: "mm",
            screen: ["+X", "+Z"],
        };
        let mut bytes = new.bytes(Array2::zeros((1, 3)).view()).unwrap();
        // Word 9 of the header is the block of the first frame.
        bytes[16] = 2;
        let input = Input::new("t", std::io::Cursor::new(bytes)).unwrap();
        let said = C3d::read(input, false).unwrap_err().to_string();
        assert_eq!(said, "t: has frames where its parameters begin");
    }
}
