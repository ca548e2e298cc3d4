//! Where a C3D file has its frames, and how many.

use super::BLOCK;
use super::numbers::Processor;
use super::parameters::Parameters;

/// Where the frames are and what each holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
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
    /// The layout that the header and the parameters give.
    pub fn read(
        bytes: &[u8],
        processor: Processor,
        parameters: &Parameters,
        keep_whole: bool,
        notes: &mut Vec<String>,
    ) -> Result<Layout, String> {
        let header = bytes.get(..BLOCK).ok_or("ends within its header")?;
        // Words of the header are counted from 1.
        let word = |i: usize| processor.u16([header[2 * i - 2], header[2 * i - 1]]);
        let real = |i: usize| {
            let at = 2 * i - 2;
            let bytes = [header[at], header[at + 1], header[at + 2], header[at + 3]];
            f64::from(processor.f32(bytes))
        };
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
            return Err(format!("says that its frames begin in block {block}"));
        }
        let (first, promised) = frames(word(4), word(5), parameters);
        let mut layout = Layout {
            processor,
            real: scale < 0.0,
            scale: scale.abs(),
            points: word(2) as usize,
            analog: word(3) as usize,
            start: (block - 1).saturating_mul(BLOCK),
            frames: promised,
            first_frame: first,
            rate: real(11),
        };
        if layout.points == 0 {
            return Err("has no points, only analog channels".into());
        }
        let there = bytes.len().saturating_sub(layout.start) / layout.frame_bytes();
        if there < promised {
            let what = format!("ends after {there} of its {promised} frames");
            if !keep_whole || there == 0 {
                return Err(format!("{what}; --keep-whole reads those"));
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
    pub fn number_bytes(&self) -> usize {
        if self.real { 4 } else { 2 }
    }

    /// The bytes of a frame.
    pub fn frame_bytes(&self) -> usize {
        (4 * self.points + self.analog) * self.number_bytes()
    }

    /// The first byte after the last frame.
    pub fn end(&self) -> usize {
        self.start + self.frames * self.frame_bytes()
    }

    /// The first byte of a point: x, y, z, and its residual with its cameras.
    pub fn point_at(&self, frame: usize, point: usize) -> usize {
        self.start + frame * self.frame_bytes() + 4 * point * self.number_bytes()
    }
}

/// The number of the first frame, and how many there are. The header counts to 65,535 only; TRIAL:ACTUAL_START_FIELD and
/// ACTUAL_END_FIELD, of two words each, go on.
fn frames(first: u16, last: u16, parameters: &Parameters) -> (u32, usize) {
    let field = |name: &str| match parameters.numbers(name) {
        [low, high, ..] => Some(u32::from(*low as u16) | u32::from(*high as u16) << 16),
        _ => None,
    };
    let fields = field("TRIAL:ACTUAL_START_FIELD").zip(field("TRIAL:ACTUAL_END_FIELD"));
    if let Some((start, end)) = fields {
        // Where header and fields agree as far as the header counts.
        let agrees = |field: u32, word: u16| word == u16::MAX || field as u16 == word;
        if agrees(start, first) && agrees(end, last) && end >= start {
            return (start, (end - start) as usize + 1);
        }
    }
    let count = (last as usize + 1).saturating_sub(first as usize);
    let long = parameters
        .number("POINT:LONG_FRAMES")
        .or(parameters.number("POINT:FRAMES"));
    let long = long.filter(|n| n.is_finite() && *n > count as f64);
    match (last, long) {
        (u16::MAX, Some(long)) => (first as u32, long as usize),
        _ => (first as u32, count),
    }
}
