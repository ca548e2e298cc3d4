//! The whole frames at the start of a stretch of a take, read on all threads.
//!
//! Only what is as plain as takes mostly are is taken: lines of a bone and its values, every bone once, frames numbered
//! without a gap. At anything else (a comment, a broken line, the end of what is there) it ends before that frame, and
//! [`super::AmcReader::read`] goes on from there: it alone says what is wrong.

use super::{AmcFrames, Asf};
use crate::io::text::{PIECE, check_length, finite_prefix};
use memchr::{memchr, memrchr};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;

/// What a skeleton's frames look like, and room to read them.
pub(super) struct Blocks<'a> {
    bones: Vec<Bone<'a>>,
    by_name: HashMap<&'a [u8], usize>,
    /// How many bones a frame must name: those with degrees of freedom.
    needed: usize,
    /// How many values a frame has.
    dofs: usize,
    unit: f64,
    pieces: Vec<Piece>,
    /// [`PIECE`]; smaller in tests.
    pub(super) piece: usize,
}

struct Bone<'a> {
    name: &'a [u8],
    values: Range<usize>,
    /// Of each value whether it is an angle.
    angles: Vec<bool>,
}

/// What was taken of a stretch: it ends with a number line.
#[derive(Default)]
pub(super) struct Taken {
    pub(super) bytes: usize,
    pub(super) lines: u64,
    /// The number on that line.
    pub(super) next: u64,
    /// Whether what follows is not plain.
    pub(super) odd: bool,
}

/// A part of a stretch and the frames in it.
#[derive(Default)]
struct Piece {
    range: Range<usize>,
    /// The number on the line before the piece.
    first: u64,
    frames: u64,
    values: Vec<f64>,
    taken: Taken,
    /// For each bone the frame that named it last, counted from 1 in the piece.
    seen: Vec<u64>,
    /// For each bone the one that followed it last time: takes keep their order. (One more tells which came first.)
    follower: Vec<usize>,
}

/// Why a frame was not taken.
enum Stop {
    /// The text ends inside it.
    End,
    /// It is not plain.
    Odd,
}

impl<'a> Blocks<'a> {
    pub(super) fn new(asf: &'a Asf) -> Blocks<'a> {
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
        Blocks {
            by_name: bones.iter().enumerate().map(|(i, b)| (b.name, i)).collect(),
            needed,
            bones,
            dofs: skeleton.dof_count(),
            unit: asf.unit,
            pieces: Vec::new(),
            piece: PIECE,
        }
    }

    /// Appends the plain frames at the start of `text`, which stands behind the number line of frame `first`.
    pub(super) fn read(
        &mut self,
        text: &[u8],
        first: u64,
        degrees: bool,
        frames: &mut AmcFrames,
    ) -> Taken {
        let text = &text[..memrchr(b'\n', text).map_or(0, |at| at + 1)];
        let mut pieces = std::mem::take(&mut self.pieces);
        let count = split(text, first, self.piece, &mut pieces);
        match &mut pieces[..count] {
            [one] => self.piece(text, degrees, one),
            all => all
                .par_iter_mut()
                .for_each(|piece| self.piece(text, degrees, piece)),
        }
        let mut taken = Taken {
            next: first,
            ..Taken::default()
        };
        let mut expected = Some(first);
        for piece in &pieces[..count] {
            if expected != Some(piece.first) {
                taken.odd = true;
                break;
            }
            frames
                .numbers
                .extend((piece.first..).take(piece.frames as usize));
            frames.values.extend_from_slice(&piece.values);
            taken.bytes += piece.taken.bytes;
            taken.lines += piece.taken.lines;
            taken.next = piece.taken.next;
            if piece.taken.bytes < piece.range.len() {
                taken.odd = piece.taken.odd;
                break;
            }
            expected = piece.first.checked_add(piece.frames);
        }
        self.pieces = pieces;
        taken
    }

    /// Reads the frames of a piece.
    fn piece(&self, text: &[u8], degrees: bool, piece: &mut Piece) {
        let text = &text[piece.range.clone()];
        piece.frames = 0;
        piece.values.clear();
        piece.seen.clear();
        piece.seen.resize(self.bones.len(), 0);
        if piece.follower.is_empty() {
            // The last stands for the start of a frame.
            piece.follower.extend((1..=self.bones.len()).chain([0]));
        }
        piece.taken = Taken {
            next: piece.first,
            ..Taken::default()
        };
        loop {
            let before = piece.values.len();
            piece.values.resize(before + self.dofs, 0.0);
            if let Err(stop) = self.frame(text, degrees, piece) {
                piece.values.truncate(before);
                piece.taken.odd = matches!(stop, Stop::Odd);
                return;
            }
            piece.frames += 1;
            if piece.first.checked_add(piece.frames) != Some(piece.taken.next) {
                piece.taken.odd = true;
                return;
            }
        }
    }

    /// Reads the lines of one frame, up to the next number line.
    fn frame(&self, text: &[u8], degrees: bool, piece: &mut Piece) -> Result<(), Stop> {
        let start = piece.values.len() - self.dofs;
        let frame = piece.frames + 1;
        let (mut at, mut lines, mut named) = (piece.taken.bytes, 0, 0);
        let mut before = self.bones.len();
        loop {
            at += blanks(&text[at..]);
            lines += 1;
            match text.get(at) {
                None => return Err(Stop::End),
                Some(b'\n') => at += 1,
                Some(b'0'..=b'9') if named < self.needed => return Err(Stop::Odd),
                Some(b'0'..=b'9') => {
                    let (number, length) = number_line(&text[at..]).ok_or(Stop::Odd)?;
                    piece.taken = Taken {
                        bytes: at + length,
                        lines: piece.taken.lines + lines,
                        next: number,
                        odd: false,
                    };
                    return Ok(());
                }
                Some(_) => {
                    let follower = &mut piece.follower[before];
                    let bone = self.bone(&text[at..], *follower).ok_or(Stop::Odd)?;
                    (*follower, before) = (bone, bone);
                    if std::mem::replace(&mut piece.seen[bone], frame) == frame {
                        return Err(Stop::Odd);
                    }
                    at += self.bones[bone].name.len();
                    let values = &mut piece.values[start..][self.bones[bone].values.clone()];
                    named += usize::from(!values.is_empty());
                    at += self
                        .values(&text[at..], degrees, bone, values)
                        .ok_or(Stop::Odd)?;
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
    fn values(&self, rest: &[u8], degrees: bool, bone: usize, values: &mut [f64]) -> Option<usize> {
        let mut at = 0;
        for (out, &angle) in values.iter_mut().zip(&self.bones[bone].angles) {
            at += blanks(&rest[at..]);
            let (value, length) = finite_prefix(&rest[at..])?;
            at += length;
            if !rest[at].is_ascii_whitespace() {
                return None;
            }
            *out = match (angle, degrees) {
                (true, true) => value.to_radians(),
                (true, false) => value,
                (false, _) => check_length(value * self.unit).ok()?,
            };
        }
        at += blanks(&rest[at..]);
        (rest[at] == b'\n').then_some(at + 1)
    }
}

/// Cuts `text` behind number lines, each piece at least `size` bytes long; how many pieces there are.
fn split(text: &[u8], first: u64, size: usize, pieces: &mut Vec<Piece>) -> usize {
    let (mut start, mut number, mut count) = (0, first, 0);
    loop {
        let cut = cut(text, start + size);
        if pieces.len() == count {
            pieces.push(Piece::default());
        }
        pieces[count].range = start..cut.map_or(text.len(), |(end, _)| end);
        pieces[count].first = number;
        count += 1;
        let Some(next) = cut else {
            return count;
        };
        (start, number) = next;
    }
}

/// The end of the first number line that begins behind `from`, and its number.
fn cut(text: &[u8], from: usize) -> Option<(usize, u64)> {
    let mut at = from + memchr(b'\n', text.get(from..)?)? + 1;
    while at < text.len() {
        if let Some((number, length)) = number_line(&text[at..]) {
            return Some((at + length, number));
        }
        at += memchr(b'\n', &text[at..])? + 1;
    }
    None
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
    use crate::io::Input;
    use crate::io::text::BLOCK;

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
            reader.blocks.piece = piece;
        }
        let end = loop {
            let more = match block {
                None => reader.read(&mut frame),
                Some(_) => {
                    // Behind an odd frame, too, blocks are what is tested.
                    reader.pace.careful = reader.pace.careful.min(1);
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
