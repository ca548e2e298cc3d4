//! How many values a frame has, and how many frames there are. Headers and parameters of some
//! makers contradict each other: then the length of the file tells which is right.

use super::BLOCK;
use super::parameters::Parameters;

/// Frames that a word of the header can count.
const COUNTED: usize = 1 << 16;

/// What the words of the header say.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Words {
    /// The number of points.
    pub points: u16,
    /// Analog values per frame.
    pub analog: u16,
    /// Samples of each analog channel a frame.
    pub samples: u16,
    /// The numbers of the first and the last frame.
    pub frames: [u16; 2],
    /// Frames a second.
    pub rate: f64,
}

/// The values of a frame, and the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Extent {
    /// The number of points.
    pub points: usize,
    /// Analog values that follow the points of a frame.
    pub analog: usize,
    /// The number of frames that the file promises.
    pub frames: usize,
    /// The number of the first frame, from 1.
    pub first_frame: u32,
}

impl Extent {
    /// What header and parameters say, of `data`, the bytes from the first frame to the end of the
    /// frames' section, in numbers of `width` bytes.
    pub(crate) fn read(
        words: Words,
        parameters: &Parameters,
        data: &[u8],
        width: usize,
        notes: &mut Vec<String>,
    ) -> Extent {
        let count = frames(words.frames, parameters);
        let larger = larger(count, parameters);
        let bytes = |[points, analog]: [usize; 2]| (4 * points + analog) * width;
        let shapes = shapes(words, parameters);
        let fits = |shape: &[usize; 2]| {
            let Some(rest) = data.get(count.frames * bytes(*shape)..) else {
                return false;
            };
            // What is zero behind the header's frames is padding, however long.
            let is_padding = || *shape == shapes[0] && rest.iter().all(|b| *b == 0);
            count.is_open || rest.len() < BLOCK || is_padding()
        };
        let by_more = |shape: &[usize; 2]| {
            let mut counts = larger.iter().copied();
            counts.find(|(_, frames)| fills(count, *frames, data, bytes(*shape)))
        };
        let fitting = shapes.iter().find(|s| fits(s) || by_more(s).is_some());
        let shape = *fitting.unwrap_or(&shapes[0]);
        if shape != shapes[0] {
            notes.push(contradiction(shapes[0], shape));
        }
        let frames = match by_more(&shape) {
            Some((_, frames)) => frames,
            None => longer(count, data, bytes(shape), words.frames),
        };
        let rest = data.get(frames * bytes(shape)..).unwrap_or_default();
        let is_more = rest.len() >= BLOCK.max(bytes(shape)) && rest.iter().any(|b| *b != 0);
        let [first, last] = words.frames;
        let counted = count.frames;
        match (by_more(&shape), larger.first()) {
            _ if frames != counted && last < first => notes.push(format!(
                "its last frame's number is below its first: {last}, {first}; by its length it \
                 has {frames} frames, which are taken"
            )),
            (Some((name, _)), _) => notes.push(format!(
                "its header counts {counted} frames, {name} {frames}, which fit the file's length \
                 and are taken"
            )),
            _ if frames != counted => notes.push(format!(
                "counts {counted} frames, since 16 bits count no further; by its length it has \
                 {frames}, which are taken"
            )),
            (None, Some((name, more))) if is_more => notes.push(format!(
                "its header counts {counted} frames, which are taken, and {name} {more}; the \
                 file's length fits neither"
            )),
            _ => {}
        }
        Extent {
            points: shape[0],
            analog: shape[1],
            frames,
            first_frame: count.first,
        }
    }
}

/// The counts of frames among the parameters that are above the header's, with their names.
fn larger(count: Count, parameters: &Parameters) -> Vec<(&'static str, usize)> {
    let number = |name| (name, parameters.number(name));
    let trial = trial(parameters).map(|(start, end)| f64::from(end) - f64::from(start) + 1.0);
    let counts = [
        number("POINT:LONG_FRAMES"),
        number("POINT:FRAMES"),
        ("TRIAL:ACTUAL_END_FIELD", trial),
    ];
    let is_larger = |n: &f64| *n > count.frames as f64 && *n < f64::from(u32::MAX);
    let counts = counts
        .into_iter()
        .filter_map(|(name, n)| Some((name, n.filter(is_larger)? as usize)));
    counts.collect()
}

/// Whether so many frames, more than are counted, fill the data to within a block. (What is zero
/// and shorter than a block is no frame but fills the last block.)
fn fills(count: Count, frames: usize, data: &[u8], bytes: usize) -> bool {
    let end = frames * bytes;
    let more = data.get(count.frames * bytes..end);
    let is_frames = |more: &[u8]| more.len() >= BLOCK || more.iter().any(|b| *b != 0);
    !count.is_open && more.is_some_and(is_frames) && data.len() - end < BLOCK
}

/// The numbers of the first and the last frame in TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD, of
/// two words each.
fn trial(parameters: &Parameters) -> Option<(u32, u32)> {
    let field = |name: &str| match parameters.numbers(name) {
        [low, high, ..] => Some(u32::from(*low as u16) | u32::from(*high as u16) << 16),
        _ => None,
    };
    field("TRIAL:ACTUAL_START_FIELD").zip(field("TRIAL:ACTUAL_END_FIELD"))
}

fn contradiction(said: [usize; 2], taken: [usize; 2]) -> String {
    let (what, said, taken) = if said[0] == taken[0] {
        ("analog values a frame", said[1], taken[1])
    } else {
        ("points", said[0], taken[0])
    };
    format!(
        "its header says {said} {what}, its parameters {taken}, which fits the file's length and \
         is taken"
    )
}

/// The numbers of points and of analog values per frame that header and parameters allow, the
/// header's first.
fn shapes(words: Words, parameters: &Parameters) -> Vec<[usize; 2]> {
    let number = |name: &str| parameters.number(name).filter(|n| *n >= 0.0 && *n < 1e6);
    let used = number("ANALOG:USED").unwrap_or(0.0);
    let rate = if words.rate > 0.0 {
        words.rate
    } else {
        number("POINT:RATE").unwrap_or(0.0)
    };
    let samples = number("ANALOG:RATE").map_or(0.0, |analog| (analog / rate).round());
    let header = f64::from(words.analog);
    let analog = [
        header,
        used * f64::from(words.samples),
        used * samples,
        // Some headers hold the number of channels.
        header * f64::from(words.samples),
        header * samples,
        0.0,
    ];
    let mut shapes = Vec::new();
    for points in [Some(f64::from(words.points)), number("POINT:USED")] {
        for analog in analog.into_iter().filter(|n| n.is_finite() && *n < 1e6) {
            let shape = [points.unwrap_or(0.0) as usize, analog as usize];
            if shape[0] > 0 && !shapes.contains(&shape) {
                shapes.push(shape);
            }
        }
    }
    if shapes.is_empty() {
        shapes.push([words.points as usize, words.analog as usize]);
    }
    shapes
}

/// The number of the first frame, and how many there are.
#[derive(Debug, Clone, Copy)]
struct Count {
    first: u32,
    frames: usize,
    /// Whether there may be more, since the count stops at what 16 bits hold.
    is_open: bool,
}

/// What header and parameters count. The header counts to 65,535 only; the fields of TRIAL,
/// POINT:LONG_FRAMES and a real POINT:FRAMES go on.
fn frames([first, last]: [u16; 2], parameters: &Parameters) -> Count {
    let is_full = last == u16::MAX;
    if let Some((start, end)) = trial(parameters) {
        // Where header and fields agree as far as the header counts.
        let agrees = |field: u32, word: u16| word == u16::MAX || field as u16 == word;
        if agrees(start, first) && agrees(end, last) && end >= start {
            return Count {
                first: start.max(1),
                frames: (end - start) as usize + 1,
                is_open: is_full && end <= u32::from(u16::MAX),
            };
        }
    }
    let count = (usize::from(last) + 1).saturating_sub(usize::from(first));
    let long = ["POINT:LONG_FRAMES", "POINT:FRAMES"]
        .into_iter()
        .filter_map(|name| parameters.number(name))
        .find(|n| n.is_finite() && *n > count as f64 && *n < f64::from(u32::MAX));
    // A count that was cut to 16 bits agrees with the whole one in these.
    let is_cut = |n: &f64| *n as usize % COUNTED == count % COUNTED;
    let frames = match long.filter(|n| is_full || is_cut(n)) {
        Some(long) => long as usize,
        None => count,
    };
    Count {
        first: u32::from(first).max(1),
        frames,
        is_open: is_full && frames < COUNTED,
    }
}

/// The number of frames of so many bytes by the length of their section: where the count stops at
/// what 16 bits hold, all but the zero frames in the last block, which fill it; where it was cut to
/// 16 bits, the number with these bits that fills the section.
fn longer(count: Count, data: &[u8], bytes: usize, [first, last]: [u16; 2]) -> usize {
    let there = data.len() / bytes.max(1);
    if count.is_open && there > count.frames {
        let is_padding = |frame: &usize| {
            let at = (frame - 1) * bytes;
            at + BLOCK >= data.len() && data[at..at + bytes].iter().all(|b| *b == 0)
        };
        let mut frames = there;
        while frames > count.frames && is_padding(&frames) {
            frames -= 1;
        }
        return frames;
    }
    let low = usize::from(last.wrapping_sub(first)) + 1;
    if (count.frames == low || count.frames == 0) && there >= low {
        let whole = low + (there - low) / COUNTED * COUNTED;
        if whole * bytes + BLOCK > data.len() {
            return whole;
        }
    }
    count.frames
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORDS: Words = Words {
        points: 1,
        analog: 0,
        samples: 0,
        frames: [1, 10],
        rate: 100.0,
    };

    /// One point as integers: 8 bytes per frame.
    fn frames_of(frames: [u16; 2], data: &[u8]) -> usize {
        let words = Words { frames, ..WORDS };
        let mut notes = Vec::new();
        let extent = Extent::read(words, &Parameters::default(), data, 2, &mut notes);
        let counted = (usize::from(frames[1]) + 1).saturating_sub(frames[0].into());
        assert_eq!(notes.len(), usize::from(extent.frames != counted));
        extent.frames
    }

    #[test]
    fn the_length_tells_frames_beyond_16_bits() {
        let mut data = vec![1_u8; 8 * 70_000];
        data.resize(data.len().next_multiple_of(BLOCK), 0);
        // Cut at the most, and cut to the low bits.
        assert_eq!(frames_of([1, 65_535], &data), 70_000);
        assert_eq!(frames_of([1, 4_464], &data), 70_000);
        assert_eq!(frames_of([60_000, 64_463], &data), 70_000);
        // A zero frame before the last block is a frame.
        let at = data.len() - 2 * BLOCK;
        data[at..].fill(0);
        assert_eq!(frames_of([1, 65_535], &data), (data.len() - BLOCK) / 8);
        // Other bytes behind the frames are none.
        assert_eq!(frames_of([1, 10], &[1; 2000]), 10);
        assert_eq!(frames_of([1, 10], &[1; 8]), 10);
        assert_eq!(frames_of([2, 1], &[]), 0);
        assert_eq!(frames_of([1, 65_535], &[1; 8 * 65_535]), 65_535);
    }

    /// Parameters with POINT:FRAMES 20 and ANALOG:USED 7.
    fn parameters() -> Parameters {
        let mut section = vec![1, 0x50, 1, 84];
        section.extend(b"\x05\xffPOINT\x03\0\0\x06\xfeANALOG\x03\0\0");
        section.extend(b"\x06\x01FRAMES\x06\0\x02\0\x14\0");
        section.extend(b"\x04\x02USED\x06\0\x02\0\x07\0\0\0");
        Parameters::read(&section, super::super::numbers::Processor::Intel)
    }

    #[test]
    fn a_larger_count_that_fits_the_length_is_taken() {
        let parameters = parameters();
        assert_eq!(parameters.number("POINT:FRAMES"), Some(20.0));
        // Five points as integers: 40 bytes per frame.
        let read = |frames: [u16; 2], data: &[u8]| {
            let words = Words {
                points: 5,
                frames,
                ..WORDS
            };
            let mut notes = Vec::new();
            let extent = Extent::read(words, &parameters, data, 2, &mut notes);
            (extent.frames, extent.points, notes.join("; "))
        };
        let mut data = vec![1_u8; 20 * 40];
        data.resize(1024, 0);
        for frames in [[1, 10], [11, 20]] {
            let (taken, points, note) = read(frames, &data);
            assert_eq!((taken, points), (20, 5), "{note}");
            assert!(note.contains("counts 10 frames, POINT:FRAMES 20"), "{note}");
        }
        assert_eq!(read([1, 20], &data), (20, 5, String::new()));
        // Zeros that fill a block are no frames.
        data.truncate(800);
        data[400..].fill(0);
        assert_eq!(read([1, 10], &data), (10, 5, String::new()));
        // More than both say.
        let (taken, _, note) = read([1, 10], &[1; 4000]);
        assert!(taken == 10 && note.contains("fits neither"), "{note}");
        let (taken, _, note) = read([65_530, 3], &[1; 400]);
        assert!(
            taken == 10 && note.contains("is below its first: 3, 65530; by its length it has 10"),
            "{note}"
        );
    }

    #[test]
    fn zeros_behind_the_frames_are_padding() {
        let read = |fill: u8| {
            let words = Words {
                samples: 1,
                frames: [1, 20],
                ..WORDS
            };
            let mut data = vec![1_u8; 20 * 8];
            data.resize(20 * 2 * (4 + 7) + 511, fill);
            let mut notes = Vec::new();
            let extent = Extent::read(words, &parameters(), &data, 2, &mut notes);
            (extent.analog, extent.frames, notes.len())
        };
        assert_eq!((read(0), read(1)), ((0, 20, 0), (7, 20, 1)));
    }

    #[test]
    fn analog_values_are_those_that_fit_the_length() {
        let mut section = vec![1, 0x50, 1, 84];
        section.extend(b"\x06\xfeANALOG\x03\0\0");
        section.extend(b"\x04\x02USED\x06\0\x02\0\x07\0\0\0");
        let parameters = Parameters::read(&section, super::super::numbers::Processor::Intel);
        assert_eq!(parameters.number("ANALOG:USED"), Some(7.0));
        let read = |samples: u16, bytes: usize| {
            let words = Words {
                analog: 16,
                samples,
                ..WORDS
            };
            let mut notes = Vec::new();
            let extent = Extent::read(words, &parameters, &vec![1; bytes], 2, &mut notes);
            (extent.analog, notes.len())
        };
        // 7 channels of 16 samples; the header's own; its channels of 3 samples; none.
        assert_eq!(read(16, 10 * 2 * (4 + 112)), (112, 1));
        assert_eq!(read(16, 10 * 2 * (4 + 16)), (16, 0));
        assert_eq!(read(16, 10 * 2 * (4 + 16) + 511), (16, 0));
        assert_eq!(read(60, 10 * 2 * (4 + 16 * 60)), (960, 1));
        assert_eq!(read(16, 10 * 2 * 90), (16, 0));
    }
}
