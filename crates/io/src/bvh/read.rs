//! The reader of BVH files.
//!
//! It reads words, not lines: some files have all their frames on one line. What can be understood
//! in one way only is read with a note (stray words and braces, a wrong count of frames, names that
//! stand twice); everything else is an error with its line.

use super::{Bvh, EndSite, Joint, MOST_JOINTS};
use crate::Input;
use crate::motion_format::{MotionFormat, recognized};
use crate::pose::Channel;
use crate::pose::rotation::Axis;
use crate::text::{excerpt, parse_number};
use crate::{Error, Place, Result};
use glam::DVec3;
use ndarray::Array2;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// Larger files are refused; an hour at 120 frames a second takes a fifth of it.
pub const LARGEST_FILE: u64 = 2 << 30;

impl Bvh {
    /// Reads a BVH file from an open input. Lengths in the file are in units of `unit` centimeters.
    /// With `keep_whole`, a file that is cut off in its last frame ends before that frame.
    ///
    /// # Errors
    /// Those of [`Bvh::open`].
    pub fn read(input: Input, unit: f64, keep_whole: bool) -> Result<Bvh> {
        let name = input.name.clone();
        let bytes = input.read_all(LARGEST_FILE)?;
        if MotionFormat::of(&bytes) == MotionFormat::Fbx {
            let what = recognized(&bytes).unwrap_or_default();
            return Err(Error::data(Place::file(name), what));
        }
        let text = decoded(&bytes);
        let mut parser = Parser::new(&text);
        let fail = |fault: BvhFault, words: &Tokens| {
            Error::data(Place::line(&name, words.line_of(fault.0)), fault.1)
        };
        if let Err(fault) = parser.hierarchy() {
            return Err(fail(fault, &parser.words));
        }
        let mut notes = parser.notes(&name, matches!(text, Cow::Owned(_)));
        let Parser {
            mut words,
            mut joints,
            ..
        } = parser;
        let (frames, frame_time, start) = match motion_head(&mut words) {
            Ok(head) => head,
            Err(fault) => return Err(fail(fault, &words)),
        };
        let values = match values(&mut words, &joints, unit, frames) {
            Ok(values) => values,
            Err(fault) => return Err(fail(fault, &words)),
        };
        let motion = whole_frames(values, Bvh::channels(&joints), keep_whole)
            .map_err(|e| e.at(Place::file(&name)))?;
        let whole = motion.nrows();
        if whole as f64 != frames {
            notes.push(format!(
                "{name}:{}: announces {frames} frames but has {whole}; using those",
                words.line_of(start)
            ));
        }
        notes.extend(note_of_renamed(&unique_names(&mut joints), &name));
        joints.iter_mut().for_each(|j| {
            j.offset *= unit;
            j.ends.iter_mut().for_each(|e| e.offset *= unit);
        });
        let missing = motion.iter().filter(|v| v.is_nan()).count();
        if missing > 0 {
            notes.push(format!("{name}: {missing} values are missing (nan)"));
        }
        Ok(Bvh {
            joints,
            frame_time,
            motion,
            notes,
        })
    }
}

/// The frames of so many values each; with `keep_whole`, without one that is cut off.
///
/// # Errors
/// [`Error::Unfit`]: the last frame is cut off.
fn whole_frames(mut values: Vec<f64>, width: usize, keep_whole: bool) -> Result<Array2<f64>> {
    let whole = values.len().checked_div(width).unwrap_or(0);
    if whole * width != values.len() && !keep_whole {
        return Err(Error::unfit(format!(
            "ends in frame {} ({} of {width} values) after {whole} complete frames; use the \
             option `keep_whole` to keep them",
            whole + 1,
            values.len() - whole * width
        )));
    }
    values.truncate(whole * width);
    Array2::from_shape_vec((whole, width), values).map_err(|e| Error::unfit(e.to_string()))
}

/// The note on joints that got other names.
fn note_of_renamed(renamed: &[String], name: &str) -> Option<String> {
    let joints = match renamed.len() {
        1 => "1 joint is".into(),
        n => format!("{n} joints are"),
    };
    let first = renamed.first()?;
    Some(format!(
        "{name}: {joints} of a repeated name; the first is renamed {first}"
    ))
}

/// A node whose brace is open.
enum Open {
    /// A joint, whether its OFFSET and CHANNELS were seen.
    Joint(usize, bool, bool),
    /// An End Site of a joint, whether its OFFSET was seen.
    End(usize, bool),
}

struct Parser<'a> {
    words: Tokens<'a>,
    joints: Vec<Joint>,
    stack: Vec<Open>,
    /// Joints and End Sites so far.
    nodes: usize,
    /// The first word that does not belong, and how many lines of such there are.
    stray: Option<(usize, String, usize)>,
}

impl<'a> Parser<'a> {
    fn new(text: &'a str) -> Parser<'a> {
        Parser {
            words: Tokens {
                text: text.strip_prefix('\u{feff}').unwrap_or(text),
                at: 0,
            },
            joints: Vec::new(),
            stack: Vec::new(),
            nodes: 0,
            stray: None,
        }
    }

    fn hierarchy(&mut self) -> std::result::Result<(), BvhFault> {
        match self.words.next() {
            None => return Err(BvhFault(0, "is empty, expected a BVH file".into())),
            Some((_, word)) if word.eq_ignore_ascii_case("HIERARCHY") => {}
            Some((at, word)) => {
                let what = format!(
                    "expected HIERARCHY, found \"{}\"; not a BVH file",
                    excerpt(word)
                );
                return Err(BvhFault(at, what));
            }
        }
        loop {
            let Some((at, word)) = self.words.next() else {
                let what = match (self.stack.is_empty(), self.joints.is_empty()) {
                    (true, true) => "the BVH file ends after its first line: it has no hierarchy",
                    (true, false) => "has no MOTION; the file is cut off",
                    (false, _) => "the hierarchy is cut off: a } is missing",
                };
                return Err(BvhFault(self.words.text.len(), what.into()));
            };
            let fault = |what: &str| Err(BvhFault(at, what.to_string()));
            match word.to_ascii_uppercase().as_str() {
                "MOTION" if !self.stack.is_empty() => {
                    return fault("MOTION is inside the hierarchy: a } is missing");
                }
                "MOTION" if self.joints.is_empty() => return fault("the hierarchy has no ROOT"),
                "MOTION" => return Ok(()),
                "ROOT" if !self.joints.is_empty() => {
                    return fault("a second ROOT; write one skeleton per file");
                }
                // Some writers call the root JOINT.
                "JOINT"
                    if !self.joints.is_empty()
                        && !matches!(self.stack.last(), Some(Open::Joint(..))) =>
                {
                    return fault("JOINT is outside any joint");
                }
                "ROOT" | "JOINT" => self.open_joint(at)?,
                "{" => return fault("expected ROOT, JOINT or End Site before {"),
                "}" => self.close(at)?,
                "OFFSET" => self.offset(at)?,
                "CHANNELS" => self.channels(at)?,
                // End Site, End site, EndSite, End_Site, End Site NAME, End.
                w if w.starts_with("END") && !self.stack.is_empty() => self.open_end(at)?,
                _ => {
                    self.words.rest_of_line();
                    self.stray(at, word);
                }
            }
        }
    }

    /// What was odd in the hierarchy of a file, which is in Latin-1 or in UTF-8.
    fn notes(&self, name: &str, is_latin: bool) -> Vec<String> {
        let mut out = Vec::new();
        let is_foreign = |joint: &&Joint| !joint.name.is_ascii();
        let foreign = self.joints.iter().filter(is_foreign).count();
        if foreign > 0 && is_latin {
            out.push(format!(
                "{name}: {foreign} names of joints are not UTF-8 and are read as Latin-1; convert \
                 the file first if they have another encoding (iconv -f shift_jis -t utf-8)"
            ));
        }
        if let Some((at, word, count)) = &self.stray {
            let more = match count {
                1 => String::new(),
                count => format!(" and {} more", count - 1),
            };
            out.push(format!(
                "{name}:{}: ignored unexpected \"{}\"{more}",
                self.words.line_of(*at),
                excerpt(word)
            ));
        }
        out
    }

    fn stray(&mut self, at: usize, word: &str) {
        match &mut self.stray {
            Some((_, _, count)) => *count += 1,
            None => self.stray = Some((at, word.to_string(), 1)),
        }
    }

    fn brace(&mut self) -> std::result::Result<(), BvhFault> {
        match self.words.next() {
            Some((_, "{")) => Ok(()),
            Some((at, word)) => Err(BvhFault(
                at,
                format!("expected {{, found \"{}\"", excerpt(word)),
            )),
            None => Err(BvhFault(
                self.words.text.len(),
                "expected {; the file is cut off".into(),
            )),
        }
    }

    fn count(&mut self, at: usize) -> std::result::Result<(), BvhFault> {
        self.nodes += 1;
        if self.nodes > MOST_JOINTS {
            return Err(BvhFault(
                at,
                format!("more than {MOST_JOINTS} joints and End Sites"),
            ));
        }
        Ok(())
    }

    fn open_joint(&mut self, at: usize) -> std::result::Result<(), BvhFault> {
        self.count(at)?;
        let name: String = self
            .words
            .rest_of_line()
            .chars()
            .filter(|c| !c.is_control())
            .collect();
        let name = name.trim();
        let index = self.joints.len();
        let parent = match self.stack.last() {
            Some(Open::Joint(p, ..)) => Some(*p),
            _ => None,
        };
        self.joints.push(Joint {
            name: if name.is_empty() {
                format!("joint{}", index + 1)
            } else {
                name.to_string()
            },
            parent,
            offset: DVec3::ZERO,
            channels: Vec::new(),
            ends: Vec::new(),
        });
        self.brace()?;
        self.stack.push(Open::Joint(index, false, false));
        Ok(())
    }

    fn open_end(&mut self, at: usize) -> std::result::Result<(), BvhFault> {
        let Some(Open::Joint(joint, ..)) = self.stack.last() else {
            return Err(BvhFault(at, "an End Site is inside another".into()));
        };
        let joint = *joint;
        self.count(at)?;
        self.words.rest_of_line();
        self.brace()?;
        self.stack.push(Open::End(joint, false));
        Ok(())
    }

    fn close(&mut self, at: usize) -> std::result::Result<(), BvhFault> {
        match self.stack.pop() {
            Some(Open::Joint(joint, false, _)) => {
                let name = excerpt(&self.joints[joint].name);
                Err(BvhFault(at, format!("joint \"{name}\" has no OFFSET")))
            }
            // An End Site without OFFSET ends where its joint stands.
            Some(Open::End(joint, false)) => {
                self.end_site(joint, DVec3::ZERO);
                Ok(())
            }
            Some(_) => Ok(()),
            None if self.joints.is_empty() => Err(BvhFault(at, "} before any {".into())),
            None => {
                self.stray(at, "}");
                Ok(())
            }
        }
    }

    fn offset(&mut self, at: usize) -> std::result::Result<(), BvhFault> {
        let value = DVec3::from_array(self.words.numbers::<3>()?);
        match self.stack.last_mut() {
            Some(Open::Joint(_, seen @ false, _)) => *seen = true,
            Some(Open::End(joint, seen @ false)) => {
                *seen = true;
                let joint = *joint;
                self.end_site(joint, value);
                return Ok(());
            }
            Some(_) => return Err(BvhFault(at, "a second OFFSET in one joint".into())),
            None => return Err(BvhFault(at, "OFFSET is outside any joint".into())),
        }
        if let Some(Open::Joint(joint, ..)) = self.stack.last() {
            self.joints[*joint].offset = value;
        }
        Ok(())
    }

    fn end_site(&mut self, joint: usize, offset: DVec3) {
        let children = self.joints.iter().filter(|j| j.parent == Some(joint));
        let after = children.count();
        self.joints[joint].ends.push(EndSite { offset, after });
    }

    fn channels(&mut self, at: usize) -> std::result::Result<(), BvhFault> {
        let Some(Open::Joint(joint, _, seen)) = self.stack.last_mut() else {
            return Err(BvhFault(at, "CHANNELS is outside any joint".into()));
        };
        if std::mem::replace(seen, true) {
            return Err(BvhFault(at, "a second CHANNELS in one joint".into()));
        }
        let joint = *joint;
        let [count] = self.words.numbers::<1>()?;
        if !(count.fract() == 0.0 && (0.0..=6.0).contains(&count)) {
            return Err(BvhFault(
                at,
                format!("expected 0 to 6 channels, found {count}"),
            ));
        }
        for _ in 0..count as usize {
            let (at, word) = self.words.next().unwrap_or((at, ""));
            let channel = channel(word).ok_or_else(|| {
                BvhFault(
                    at,
                    format!(
                        "expected a channel such as Xrotation, found \"{}\"",
                        excerpt(word)
                    ),
                )
            })?;
            let channels = &mut self.joints[joint].channels;
            if channels.contains(&channel) {
                return Err(BvhFault(
                    at,
                    format!("channel \"{}\" appears twice", excerpt(word)),
                ));
            }
            channels.push(channel);
        }
        match self.words.peek() {
            Some((at, word)) if channel(word).is_some() => Err(BvhFault(
                at,
                format!("more channels than the stated {count}"),
            )),
            _ => Ok(()),
        }
    }
}

/// `Xposition` or `Xrotation`, in any case.
fn channel(word: &str) -> Option<Channel> {
    let axis = Axis::parse(word.chars().next()?)?;
    match word.get(1..)?.to_ascii_lowercase().as_str() {
        "position" | "translation" => Some(Channel::Translate(axis)),
        "rotation" => Some(Channel::Rotate(axis)),
        _ => None,
    }
}

/// Renames joints whose name stood before (`_2`, `_3`); the new names.
fn unique_names(joints: &mut [Joint]) -> Vec<String> {
    let mut taken: HashSet<String> = joints.iter().map(|j| j.name.clone()).collect();
    // By name: the next number to try. A thousand equal names must not try a thousand numbers each.
    let mut next: HashMap<String, usize> = HashMap::new();
    let mut renamed = Vec::new();
    for joint in joints {
        let Some(n) = next.get_mut(&joint.name) else {
            next.insert(joint.name.clone(), 2);
            continue;
        };
        let name = loop {
            let name = format!("{}_{n}", joint.name);
            *n += 1;
            if taken.insert(name.clone()) {
                break name;
            }
        };
        renamed.push(name.clone());
        joint.name = name;
    }
    renamed
}

/// The text of a file. Where it is no UTF-8, its bytes are taken for Latin-1, as old files have it:
/// names of any encoding stay where they are. What Latin-1 has no letter for is U+FFFD.
fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => {
            let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
            let letter = |b: &u8| match b {
                0x80..=0x9f => char::REPLACEMENT_CHARACTER,
                b => char::from(*b),
            };
            Cow::Owned(bytes.iter().map(letter).collect())
        }
    }
}

/// Where the values of the motion start in the bytes of a file; `None` where it has no head that
/// can be read.
pub(super) fn motion_start(bytes: &[u8]) -> Option<usize> {
    let text = decoded(bytes);
    let mut parser = Parser::new(&text);
    parser.hierarchy().ok()?;
    motion_head(&mut parser.words).ok()?;
    // Counted from the end: what is no UTF-8 is longer in the text, but stands among the names.
    let words = parser.words;
    bytes.len().checked_sub(words.text.len() - words.at)
}

/// Where the numbers of the motion's head stand in the bytes of a file: the count of frames, and
/// the Frame Time; `None` where it has no head that can be read.
pub(super) fn head_numbers(bytes: &[u8]) -> Option<[Range<usize>; 2]> {
    let text = decoded(bytes);
    let mut parser = Parser::new(&text);
    parser.hierarchy().ok()?;
    let mut words = parser.words;
    let mut number = |label: &[&str]| {
        labeled(&mut words, label, "").ok()?;
        // Counted from the end, as for `motion_start`.
        let end = bytes.len().checked_sub(words.text.len() - words.at)?;
        let is_of = |b: &&u8| !b.is_ascii_whitespace() && **b != b':';
        let length = bytes[..end].iter().rev().take_while(is_of).count();
        Some(end - length..end)
    };
    Some([number(&["frames"])?, number(&["frame", "time"])?])
}

/// Where the hierarchy ends in the bytes of a file, behind the word MOTION; `None` where there is
/// none.
pub(super) fn hierarchy_end(bytes: &[u8]) -> Option<usize> {
    let text = decoded(bytes);
    let mut parser = Parser::new(&text);
    parser.hierarchy().ok()?;
    // Counted from the end, as for `motion_start`.
    let words = parser.words;
    bytes.len().checked_sub(words.text.len() - words.at)
}

/// The count of frames, the Frame Time, and where the count stands.
fn motion_head(words: &mut Tokens) -> std::result::Result<(f64, f64, usize), BvhFault> {
    let (frames, start) = labeled(words, &["frames"], "Frames:")?;
    let (time, _) = labeled(words, &["frame", "time"], "Frame Time:")?;
    Ok((frames, time, start))
}

/// A number after a label, however the colon is spaced.
fn labeled(
    words: &mut Tokens,
    label: &[&str],
    shown: &str,
) -> std::result::Result<(f64, usize), BvhFault> {
    let expected = |at: usize, word: &str| {
        BvhFault(at, format!("expected {shown}, found \"{}\"", excerpt(word)))
    };
    let (mut start, mut letters) = (None, String::new());
    let wanted = label.concat();
    while letters != wanted {
        let Some((at, word)) = words.next() else {
            return Err(BvhFault(
                words.text.len(),
                format!("expected {shown}; the file is cut off"),
            ));
        };
        start.get_or_insert(at);
        let (text, value) = match word.split_once(':') {
            Some((text, value)) => (text, value),
            None => (word, ""),
        };
        letters.push_str(&text.to_ascii_lowercase());
        if !wanted.starts_with(&letters) {
            return Err(expected(at, word));
        }
        if !value.is_empty() {
            if letters != wanted {
                return Err(expected(at, word));
            }
            let value = parse_number(value);
            return Ok((
                value.map_err(|what| BvhFault(at, format!("{shown} {what}")))?,
                at,
            ));
        }
    }
    let (mut at, mut word) = words.next().unwrap_or((words.text.len(), ""));
    if word == ":" {
        (at, word) = words.next().unwrap_or((words.text.len(), ""));
    }
    let word = word.strip_prefix(':').unwrap_or(word);
    if word.is_empty() {
        let what = format!("{shown} has no number; the file is cut off");
        return Err(BvhFault(at, what));
    }
    let value = parse_number(word).map_err(|what| BvhFault(at, format!("{shown} {what}")))?;
    Ok((value, start.unwrap_or(at)))
}

/// Everything after the head, which says that there are so many `frames`, in radians and
/// centimeters.
fn values(
    words: &mut Tokens,
    joints: &[Joint],
    unit: f64,
    frames: f64,
) -> std::result::Result<Vec<f64>, BvhFault> {
    let scales: Vec<f64> = joints
        .iter()
        .flat_map(|j| &j.channels)
        .map(|c| {
            if c.is_angle() {
                1f64.to_radians()
            } else {
                unit
            }
        })
        .collect();
    check_lines(&words.text[words.at..], words.at, scales.len(), frames)?;
    let mut out = Vec::new();
    let mut channel = 0;
    while let Some((at, word)) = words.next() {
        // No number of the format: what is missing.
        let value = if word.eq_ignore_ascii_case("nan") {
            Ok(f64::NAN)
        } else {
            bounded(word)
        };
        let value = value.map_err(|what| {
            let frame = out.len() / scales.len().max(1) + 1;
            BvhFault(at, format!("frame {frame}, value {}: {what}", channel + 1))
        })?;
        let Some(scale) = scales.get(channel) else {
            return Err(BvhFault(at, "values, but no joint has channels".into()));
        };
        out.push(value * scale);
        channel = (channel + 1) % scales.len();
    }
    Ok(out)
}

/// Where frames have lines of their own, as many as the file says or most of the lines, one with
/// too few or too many values would shift all after it. (The last may be cut off, and frames may be
/// laid out otherwise: then values count alone.)
fn check_lines(
    text: &str,
    start: usize,
    width: usize,
    frames: f64,
) -> std::result::Result<(), BvhFault> {
    let mut at = start;
    let mut lines = Vec::new();
    for line in text.split_inclusive(['\n', '\r']) {
        let count = line.split_ascii_whitespace().count();
        if count > 0 {
            lines.push((at, count));
        }
        at += line.len();
    }
    let exact = lines.iter().filter(|(_, count)| *count == width).count();
    if width == 0 || !(lines.len() as f64 == frames || 2 * exact > lines.len()) {
        return Ok(());
    }
    for (i, (at, count)) in lines.iter().enumerate() {
        let is_cut_off = i + 1 == lines.len() && *count < width;
        if count % width != 0 && !is_cut_off {
            let what = format!("frame {}: expected {width} values, found {count}", i + 1);
            return Err(BvhFault(*at, what));
        }
    }
    Ok(())
}

/// Numbers beyond this are no lengths and no angles.
const LARGEST_NUMBER: f64 = 1e9;

/// Where in the text, and what is wrong there.
struct BvhFault(usize, String);

/// The text's words, separated by white space.
struct Tokens<'a> {
    /// The whole text.
    text: &'a str,
    /// How far it is read, in bytes.
    at: usize,
}

impl<'a> Tokens<'a> {
    /// The next word and where it starts.
    fn next(&mut self) -> Option<(usize, &'a str)> {
        let rest = &self.text[self.at..];
        let start = self.at + rest.find(|c: char| !c.is_ascii_whitespace())?;
        let rest = &self.text[start..];
        let end = rest
            .find(|c: char| c.is_ascii_whitespace())
            .unwrap_or(rest.len());
        // A brace is a word of its own even where no space follows.
        let end = if rest.starts_with(['{', '}']) { 1 } else { end };
        self.at = start + end;
        Some((start, &rest[..end]))
    }

    /// The next word, left where it is.
    fn peek(&mut self) -> Option<(usize, &'a str)> {
        let at = self.at;
        let word = self.next();
        self.at = at;
        word
    }

    /// The rest of the line, up to a brace: a name may have spaces.
    fn rest_of_line(&mut self) -> &'a str {
        let rest = &self.text[self.at..];
        let end = rest.find(['\n', '\r', '{', '}']).unwrap_or(rest.len());
        self.at += end;
        rest[..end].trim()
    }

    /// The line of an offset in the text, counted from 1.
    fn line_of(&self, at: usize) -> u64 {
        let before = &self.text.as_bytes()[..at.min(self.text.len())];
        1 + before.iter().filter(|&&b| b == b'\n').count() as u64
    }

    /// Three numbers, or the one asked for.
    fn numbers<const N: usize>(&mut self) -> std::result::Result<[f64; N], BvhFault> {
        let mut out = [0.0; N];
        for v in &mut out {
            let (at, word) = self.next().ok_or_else(|| {
                BvhFault(
                    self.text.len(),
                    "expected a number; the file is cut off".into(),
                )
            })?;
            *v = bounded(word).map_err(|e| BvhFault(at, e.to_string()))?;
        }
        Ok(out)
    }
}

/// A finite number of a size that a body can have.
fn bounded(word: &str) -> Result<f64> {
    match parse_number(word)? {
        v if v.abs() <= LARGEST_NUMBER => Ok(v),
        _ => Err(format!(
            "\"{}\" is too large for a length or angle of a body",
            excerpt(word)
        )
        .into()),
    }
}
