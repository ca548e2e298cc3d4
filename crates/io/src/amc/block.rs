//! The regular frames of a take: lines of a bone and its values, every bone once, frames numbered
//! without a gap.

use crate::asf::Asf;
use crate::block_reader::{BlockFormat, Parsed};
use crate::text::{check_length, finite_prefix};
use memchr::memchr;
use std::collections::HashMap;
use std::ops::Range;

/// The frames of a skeleton.
pub(super) struct FrameFormat<'a> {
    bones: Vec<Bone<'a>>,
    by_name: HashMap<&'a [u8], usize>,
    /// The number of bones that a frame must name: those with degrees of freedom.
    needed: usize,
    /// The number of values of a frame.
    dofs: usize,
    unit: f64,
    /// Whether the take's angles are in degrees.
    pub(super) degrees: bool,
}

struct Bone<'a> {
    name: &'a [u8],
    values: Range<usize>,
    /// Whether each value is an angle.
    angles: Vec<bool>,
}

/// The frames of a piece, which starts behind the number line of its first frame.
#[derive(Default)]
pub(super) struct Frames {
    /// The number of the first frame.
    pub(super) first: u64,
    pub(super) count: u64,
    /// (frames, degrees of freedom), radians and centimeters.
    pub(super) values: Vec<f64>,
    /// The number on the last number line.
    pub(super) next: u64,
    /// The frame that named each bone last, counted from 1 in the piece.
    seen: Vec<u64>,
    /// The bone that followed each bone last time, because takes keep their order. The last entry
    /// stands for the start of a frame.
    follower: Vec<usize>,
}

/// Why a frame was not parsed.
enum Stop {
    /// The text ends inside the frame.
    End,
    Irregular,
}

impl<'a> FrameFormat<'a> {
    pub(super) fn new(asf: &'a Asf) -> FrameFormat<'a> {
        let skeleton = &asf.skeleton;
        let bones: Vec<Bone> = skeleton
            .bones()
            .iter()
            .enumerate()
            .map(|(i, bone)| Bone {
                name: bone.name.as_bytes(),
                values: skeleton.dofs_of(i),
                angles: bone.dofs.iter().map(|d| d.channel.is_angle()).collect(),
            })
            .collect();
        // A name that a line could not hold (with a `#`, say) is for the careful reader to miss.
        let plain = |b: &Bone| b.name.iter().all(|&c| c.is_ascii_graphic() && c != b'#');
        let needed = if bones.iter().all(plain) {
            bones.iter().filter(|b| !b.angles.is_empty()).count()
        } else {
            usize::MAX
        };
        FrameFormat {
            by_name: bones.iter().enumerate().map(|(i, b)| (b.name, i)).collect(),
            needed,
            bones,
            dofs: skeleton.dof_count(),
            unit: asf.unit,
            degrees: asf.degrees,
        }
    }

    /// Parses the lines of one frame, up to the next number line.
    fn parse_frame(
        &self,
        text: &[u8],
        frames: &mut Frames,
        parsed: &mut Parsed,
    ) -> Result<(), Stop> {
        let start = frames.values.len() - self.dofs;
        let frame = frames.count + 1;
        let (mut at, mut lines, mut named) = (parsed.bytes, 0, 0);
        let mut before = self.bones.len();
        loop {
            at += blanks(&text[at..]);
            lines += 1;
            match text.get(at) {
                None => return Err(Stop::End),
                Some(b'\n') => at += 1,
                Some(b'0'..=b'9') if named < self.needed => return Err(Stop::Irregular),
                Some(b'0'..=b'9') => {
                    let (number, length) = number_line(&text[at..]).ok_or(Stop::Irregular)?;
                    parsed.bytes = at + length;
                    parsed.line_feeds += lines;
                    frames.next = number;
                    return Ok(());
                }
                Some(_) => {
                    let follower = &mut frames.follower[before];
                    let bone = self.bone(&text[at..], *follower).ok_or(Stop::Irregular)?;
                    (*follower, before) = (bone, bone);
                    if std::mem::replace(&mut frames.seen[bone], frame) == frame {
                        return Err(Stop::Irregular);
                    }
                    at += self.bones[bone].name.len();
                    let values = &mut frames.values[start..][self.bones[bone].values.clone()];
                    named += usize::from(!values.is_empty());
                    let parsed = self.parse_values(&text[at..], bone, values);
                    at += parsed.ok_or(Stop::Irregular)?;
                }
            }
        }
    }

    /// The bone that a line begins with: first asked for is `guess`.
    fn bone(&self, line: &[u8], guess: usize) -> Option<usize> {
        let ends = |at: usize| line.get(at).is_some_and(u8::is_ascii_whitespace);
        match self.bones.get(guess) {
            Some(bone) if line.starts_with(bone.name) && ends(bone.name.len()) => Some(guess),
            _ => {
                let end = line.iter().position(u8::is_ascii_whitespace)?;
                self.by_name.get(&line[..end]).copied()
            }
        }
    }

    /// Reads a bone's values; how long the rest of its line is.
    fn parse_values(&self, rest: &[u8], bone: usize, values: &mut [f64]) -> Option<usize> {
        let mut at = 0;
        for (out, &angle) in values.iter_mut().zip(&self.bones[bone].angles) {
            at += blanks(&rest[at..]);
            let (value, length) = finite_prefix(&rest[at..])?;
            at += length;
            if !rest[at].is_ascii_whitespace() {
                return None;
            }
            *out = match (angle, self.degrees) {
                (true, true) => value.to_radians(),
                (true, false) => value,
                (false, _) => check_length(value * self.unit).ok()?,
            };
        }
        at += blanks(&rest[at..]);
        (rest[at] == b'\n').then_some(at + 1)
    }
}

impl BlockFormat for FrameFormat<'_> {
    type Records = Frames;
    /// The number on the line before the piece.
    type Start = u64;

    fn cut(&self, text: &[u8], from: usize) -> Option<(usize, u64)> {
        let mut at = from + memchr(b'\n', text.get(from..)?)? + 1;
        while at < text.len() {
            if let Some((number, length)) = number_line(&text[at..]) {
                return Some((at + length, number));
            }
            at += memchr(b'\n', &text[at..])? + 1;
        }
        None
    }

    fn parse(&self, text: &[u8], first: u64, frames: &mut Frames) -> Parsed {
        (frames.first, frames.next, frames.count) = (first, first, 0);
        frames.values.clear();
        frames.seen.clear();
        frames.seen.resize(self.bones.len(), 0);
        if frames.follower.is_empty() {
            frames.follower.extend((1..=self.bones.len()).chain([0]));
        }
        let mut parsed = Parsed::default();
        loop {
            let before = frames.values.len();
            frames.values.resize(before + self.dofs, 0.0);
            if let Err(stop) = self.parse_frame(text, frames, &mut parsed) {
                frames.values.truncate(before);
                parsed.is_irregular = matches!(stop, Stop::Irregular);
                return parsed;
            }
            frames.count += 1;
            if first.checked_add(frames.count) != Some(frames.next) {
                parsed.is_irregular = true;
                return parsed;
            }
        }
    }
}

/// How many blanks (no line ends) stand at the start.
fn blanks(text: &[u8]) -> usize {
    let blank = |&&c: &&u8| c.is_ascii_whitespace() && c != b'\n';
    text.iter().take_while(blank).count()
}

/// The number on a line that holds nothing else, and the line's length.
fn number_line(text: &[u8]) -> Option<(u64, usize)> {
    let digits = text.iter().take_while(|c| c.is_ascii_digit()).count();
    // What has nineteen digits is no more than a u64 can be.
    if digits == 0 || digits > 19 {
        return None;
    }
    let number = text[..digits]
        .iter()
        .fold(0, |n, c| 10 * n + u64::from(c - b'0'));
    let end = digits + blanks(&text[digits..]);
    (text.get(end) == Some(&b'\n')).then_some((number, end + 1))
}

#[cfg(test)]
mod tests {
    use super::super::tests::asf;
    use super::super::{AmcFrame, AmcFrames, AmcReader};
    use crate::Input;
    use crate::block_reader::BLOCK;

    /// What a take holds, and how it ends, read one frame at a time or in blocks.
    fn all(text: &str, keep: bool, block: Option<(usize, usize)>) -> (Vec<AmcFrame>, String) {
        let asf = asf();
        let input = Input::new("t.amc", std::io::Cursor::new(text.as_bytes().to_vec())).unwrap();
        let size = block.map_or(BLOCK, |(size, _)| size);
        let mut reader = match AmcReader::with_block(&asf, input, keep, size) {
            Ok(reader) => reader,
            Err(e) => return (Vec::new(), e.to_string()),
        };
        let (mut out, mut frame, mut frames) =
            (Vec::new(), AmcFrame::default(), AmcFrames::default());
        if let Some((_, piece)) = block {
            reader.blocks.piece_bytes = piece;
        }
        let end = loop {
            let more = match block {
                None => reader.read(&mut frame),
                Some(_) => {
                    // Behind an irregular frame, too, blocks are what is tested.
                    reader.blocks.careful = reader.blocks.careful.min(1);
                    reader.read_block(&mut frames)
                }
            };
            match more {
                Ok(false) => break format!("{:?} {}", reader.dropped, reader.lines.number),
                Err(e) => break e.to_string(),
                Ok(true) if block.is_none() => out.push(frame.clone()),
                Ok(true) => {
                    let values = frames.values.chunks_exact(asf.skeleton.dof_count());
                    assert!(!frames.numbers.is_empty() && values.len() == frames.numbers.len());
                    out.extend(frames.numbers.iter().zip(values).map(|(&number, values)| {
                        let values = values.to_vec();
                        AmcFrame { number, values }
                    }));
                }
            }
        };
        (out, end)
    }

    /// Twelve plain frames, in two orders of bones.
    fn long() -> String {
        let mut text = String::from(":DEGREES\n");
        for i in 7..19 {
            let root = format!("root {i} 2.5 -3 4e-1 5 6\n");
            let leg = format!("leg -{i}.25 0.5\n");
            text += &if i % 5 == 0 {
                format!("{i}\n{leg}{root}")
            } else {
                format!("{i}\n{root}{leg}hip\n")
            };
        }
        text
    }

    #[test]
    fn blocks_of_any_size_hold_the_same_frames() {
        let text = long();
        let odd = text
            .replace("12\n", "12 # here\n")
            .replace("leg -9.25", " leg\t-9.25 ");
        let crlf = text.replace('\n', "\r\n");
        for text in [&text, &odd, &crlf, text.trim_end()] {
            let want = all(text, false, None);
            assert_eq!(want.0.len(), 12);
            for size in (1..text.len() + 2).chain([BLOCK]) {
                for piece in [1, 40, 200] {
                    assert_eq!(
                        all(text, false, Some((size, piece))),
                        want,
                        "{size} {piece}"
                    );
                }
            }
        }
    }

    #[test]
    fn blocks_end_where_single_frames_do() {
        let text = long();
        let lines: Vec<&str> = text.lines().collect();
        let damages = [
            "",
            "leg 1",
            "leg 1 2 3",
            "tail 1",
            "leg 1 nan",
            "leg 1 1e999",
            "root 1e300 2 3 4 5 6",
            "14",
            "0x",
            "leg",
            "leg 1 2#",
            "99999999999999999999",
            "hip hip",
        ];
        for (at, damage) in (1..lines.len()).flat_map(|at| damages.map(|d| (at, d))) {
            let mut lines = lines.clone();
            lines[at] = damage;
            let text = lines.join("\n");
            for keep in [false, true] {
                let want = all(&text, keep, None);
                for (size, piece) in [(50, 20), (BLOCK, 60), (BLOCK, BLOCK)] {
                    assert_eq!(all(&text, keep, Some((size, piece))), want, "{text}");
                }
            }
        }
    }
}
