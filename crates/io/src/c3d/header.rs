//! Where a C3D file has its frames, and how many.

use super::BLOCK;
use super::extent::{Extent, Words};
use super::numbers::Processor;
use super::parameters::Parameters;
use crate::Result;

/// Where the frames are and what each holds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    pub processor: Processor,
    /// Whether points and analog samples are reals of 32 bits, else integers of 16.
    pub real: bool,
    /// The length of one step of an integer, in the file's unit.
    pub scale: f64,
    /// The number of points, P.
    pub points: usize,
    /// Analog samples that follow the points of a frame.
    pub analog: usize,
    /// The first byte of the first frame.
    pub start: usize,
    /// The number of frames.
    pub frames: usize,
    /// The number of the first frame, from 1.
    pub first_frame: u32,
    /// Frames a second; 0 where the header does not say.
    pub rate: f64,
}

impl Layout {
    /// The layout that the header and the parameters give; the section of these begins at the byte
    /// `parameters_at`.
    pub(crate) fn read(
        bytes: &[u8],
        processor: Processor,
        parameters: &Parameters,
        parameters_at: usize,
        keep_whole: bool,
        notes: &mut Vec<String>,
    ) -> Result<Layout> {
        let header = bytes.get(..BLOCK).ok_or("ends within its header")?;
        // Words of the header are counted from 1.
        let word = |i: usize| processor.u16([header[2 * i - 2], header[2 * i - 1]]);
        let real = |i: usize| {
            let at = 2 * i - 2;
            let bytes = [header[at], header[at + 1], header[at + 2], header[at + 3]];
            f64::from(processor.f32(bytes))
        };
        if word(2) == 0 && parameters.number("POINT:USED").unwrap_or(0.0) < 1.0 {
            return Err(without_points(word(3), parameters).into());
        }
        let mut scale = real(7);
        if scale == 0.0 || !scale.is_finite() {
            scale = parameters.number("POINT:SCALE").unwrap_or(0.0);
        }
        if scale == 0.0 || !scale.is_finite() {
            return Err("has no scale (POINT:SCALE), so that its numbers have no size".into());
        }
        let block = match word(9) {
            0 => parameters.number("POINT:DATA_START").unwrap_or(0.0) as usize,
            block => block as usize,
        };
        if block < 2 {
            return Err(format!("says that its frames begin in block {block}").into());
        }
        let start = (block - 1).saturating_mul(BLOCK);
        let words = Words {
            points: word(2),
            analog: word(3),
            samples: word(10),
            frames: [word(4), word(5)],
            rate: real(11),
        };
        let data = section(bytes, start, parameters_at, parameters);
        let width = if scale < 0.0 { 4 } else { 2 };
        let extent = Extent::read(words, parameters, data, width, notes);
        let mut layout = Layout {
            processor,
            real: scale < 0.0,
            scale: scale.abs(),
            points: extent.points,
            analog: extent.analog,
            start,
            frames: extent.frames,
            first_frame: extent.first_frame,
            rate: words.rate,
        };
        let (there, promised) = (data.len() / layout.frame_bytes().max(1), extent.frames);
        if there < promised {
            let what = format!("ends after {there} of its {promised} frames");
            if !keep_whole || there == 0 {
                return Err(format!("{what}; the option `keep_whole` reads those").into());
            }
            notes.push(what);
            layout.frames = there;
        }
        if layout.frames == 0 {
            return Err("has no frames".into());
        }
        Ok(layout)
    }

    /// The bytes of one number.
    pub(crate) fn number_bytes(&self) -> usize {
        if self.real { 4 } else { 2 }
    }

    /// The bytes of a frame.
    pub(crate) fn frame_bytes(&self) -> usize {
        (4 * self.points + self.analog) * self.number_bytes()
    }

    /// The first byte after the last frame.
    pub(crate) fn end(&self) -> usize {
        self.start + self.frames * self.frame_bytes()
    }

    /// The first byte of a point: x, y, z, and its residual with its cameras.
    pub(crate) fn point_at(&self, frame: usize, point: usize) -> usize {
        self.start + frame * self.frame_bytes() + 4 * point * self.number_bytes()
    }
}

/// The bytes from the first frame to the next section of the file: the parameters, which may stand
/// behind, or rotations.
fn section<'a>(
    bytes: &'a [u8],
    start: usize,
    parameters_at: usize,
    parameters: &Parameters,
) -> &'a [u8] {
    let rotations = parameters.number("ROTATION:DATA_START").unwrap_or(0.0);
    let rotations = (rotations as usize).saturating_sub(1).saturating_mul(BLOCK);
    let next = [parameters_at, rotations, bytes.len()].into_iter();
    let end = next.filter(|at| *at > start).min();
    bytes.get(start..end.unwrap_or(start)).unwrap_or_default()
}

/// What a file without points has instead.
fn without_points(analog: u16, parameters: &Parameters) -> String {
    let number = |name: &str| parameters.number(name).unwrap_or(0.0);
    let mut has = Vec::new();
    let rotations = number("ROTATION:USED");
    if rotations > 0.0 || parameters.has_group("ROTATION") {
        has.push(format!("{rotations} rotations of segments (ROTATION)"));
    }
    let channels = number("ANALOG:USED");
    if channels > 0.0 {
        has.push(format!("{channels} analog channels"));
    } else if analog > 0 {
        has.push(format!("{analog} analog values a frame"));
    }
    if has.is_empty() {
        "has no points".into()
    } else {
        format!(
            "has no points, only {}, which posing does not read: export the file with markers or \
         joint positions",
            has.join(" and ")
        )
    }
}
