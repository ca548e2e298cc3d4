//! Acclaim motion (AMC): read frame by frame or as many as are there, and written.
//!
//! A frame is its number on a line of its own, then a line per bone: its name and one value for
//! each of its degrees of freedom, in the ASF's order. Bones without degrees of freedom may be left
//! out or stand there without values.

mod block;
mod of_rotations;
mod rewrite;
mod write;

pub(crate) use rewrite::AmcMotion;
use write::{write_frame, write_header};

use super::Input;
use super::asf::Asf;
use super::block_reader::{BLOCK, BlockReader};
use super::bvh::Bvh;
use super::output::write_file;
use super::text::{Lines, check_length, excerpt, parse_number};
use crate::pose::kinematics::{Posture, Space};
use crate::pose::rotation::Axis;
use crate::pose::{Poses, Skeleton};
use crate::{Error, Place, Result};
use block::FrameFormat;
use glam::DMat3;
use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;
use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::sync::Arc;

/// Why a take cannot be timed.
pub(super) const NO_RATE: &str = "an AMC file does not say its rate; give it with the option `fps \
                                  F` (frames per second)";

/// One frame of a take.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AmcFrame {
    /// The number that the file gives it; the first of a take need not be 1.
    pub number: u64,
    /// One value for each degree of freedom of the skeleton, radians and centimeters.
    pub values: Vec<f64>,
}

/// Several frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AmcFrames {
    /// Their numbers.
    pub numbers: Vec<u64>,
    /// Their values, one frame's behind the other's, as in [`AmcFrame::values`].
    pub values: Vec<f64>,
}

/// The number of frames that one thread turns into positions at a time.
const CHUNK: usize = 64;

impl AmcFrames {
    /// The positions of `joints` (bones of `skeleton`, whose ends they are): three numbers per
    /// joint, centimeters, frame after frame.
    pub fn positions(&self, skeleton: &Skeleton, joints: &[usize], space: Space) -> Vec<f64> {
        let (dofs, width) = (skeleton.dof_count(), 3 * joints.len());
        let needed = skeleton.ancestors(joints);
        let mut xyz = vec![0.0; self.numbers.len() * width];
        // Skeletons without degrees of freedom or a list without joints: nothing to compute.
        let chunks = xyz.par_chunks_mut((CHUNK * width).max(1)).enumerate();
        chunks.for_each(|(chunk, out)| {
            let (mut posture, mut q) = (Posture::default(), vec![0.0; dofs]);
            for (i, out) in out.chunks_exact_mut(width).enumerate() {
                q.copy_from_slice(&self.values[(chunk * CHUNK + i) * dofs..][..dofs]);
                skeleton.move_root_to(&mut q, space);
                skeleton.posture_of_bones(&needed, &q, &mut posture);
                for (&joint, out) in joints.iter().zip(out.chunks_exact_mut(3)) {
                    out.copy_from_slice(&posture.ends[joint].to_array());
                }
            }
        });
        xyz
    }
}

/// A take in memory: the joint angles of a skeleton over time.
///
/// ```
/// use posing_io::{Amc, Asf};
///
/// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
/// let take = Amc::open("../../testdata/cmu/09/09_06.amc", &asf)?;
/// let poses = take.to_poses(120.0)?;
/// assert_eq!(poses.points[0], "root");
/// assert_eq!(poses.frames(), take.frames.numbers.len());
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Amc<'a> {
    asf: &'a Asf,
    /// The take's name: that of the file, without its extension.
    pub name: String,
    /// The frames.
    pub frames: AmcFrames,
}

impl<'a> Amc<'a> {
    /// Opens a take of the skeleton `asf`.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: no sound AMC file, or one of
    /// another skeleton; the
    /// place has the line.
    pub fn open(path: impl AsRef<Path>, asf: &'a Asf) -> Result<Amc<'a>> {
        let path = path.as_ref();
        let (mut amc, _) = Amc::read(Input::open(path)?, asf, false)?;
        let name = path.file_stem().unwrap_or(path.as_os_str());
        amc.name = name.to_string_lossy().into_owned();
        Ok(amc)
    }

    /// Reads a take of the skeleton `asf` from an open input, whose name is the take's. With
    /// `keep_whole`, one that is cut off in its last frame ends before that frame; its number.
    ///
    /// # Errors
    /// Those of [`Amc::open`].
    pub fn read(input: Input, asf: &'a Asf, keep_whole: bool) -> Result<(Amc<'a>, Option<u64>)> {
        let name = input.name.clone();
        let mut reader = AmcReader::new(asf, input, keep_whole)?;
        let (mut frames, mut block) = (AmcFrames::default(), AmcFrames::default());
        while reader.read_block(&mut block)? {
            frames.numbers.append(&mut block.numbers);
            frames.values.append(&mut block.values);
        }
        Ok((Amc { asf, name, frames }, reader.dropped))
    }

    /// A take of the skeleton `asf` from `values` (frames, degrees of freedom; radians and
    /// centimeters), whose first frame has the number `first`.
    pub fn from_values(asf: &'a Asf, first: u64, values: ArrayView2<'_, f64>) -> Amc<'a> {
        Amc {
            asf,
            name: String::new(),
            frames: AmcFrames {
                numbers: (first..).take(values.nrows()).collect(),
                values: values.iter().copied().collect(),
            },
        }
    }

    /// The positions of all joints of the skeleton, as captured. A frame's time is its number less
    /// one, over `rate` frames a second: an AMC file does not state its rate.
    ///
    /// # Errors
    /// [`Error::Usage`]: a rate that is not above zero.
    pub fn to_poses(&self, rate: f64) -> Result<Poses> {
        check_rate(rate)?;
        let skeleton = &self.asf.skeleton;
        let joints: Vec<usize> = (0..skeleton.bones().len()).collect();
        let xyz = self.frames.positions(skeleton, &joints, Space::World);
        let numbers = &self.frames.numbers;
        let take: Arc<str> = Arc::from(&*self.name);
        Ok(Poses {
            points: skeleton.bones().iter().map(|b| b.name.clone()).collect(),
            xyz: Array2::from_shape_vec((numbers.len(), 3 * joints.len()), xyz)
                .map_err(|e| Error::usage(e.to_string()))?,
            time: Some(numbers.iter().map(|&n| (n as f64 - 1.0) / rate).collect()),
            take: Some(vec![take; numbers.len()]),
        })
    }

    /// The take as a BVH file at `rate` frames a second, in centimeters: joint NAME stands at the
    /// start of bone NAME.
    ///
    /// # Errors
    /// [`Error::Usage`]: a rate that is not above zero.
    pub fn to_bvh(&self, rate: f64) -> Result<Bvh> {
        check_rate(rate)?;
        let skeleton = &self.asf.skeleton;
        let shape = (self.frames.numbers.len(), skeleton.dof_count());
        let values = ArrayView2::from_shape(shape, &self.frames.values);
        let values = values.map_err(|e| Error::usage(e.to_string()))?;
        let order = [Axis::Z, Axis::Y, Axis::X];
        Bvh::from_values(skeleton, values, order, DMat3::IDENTITY, 1.0 / rate)
    }

    /// The file's text, in degrees and the skeleton's units.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        write_header(&mut out);
        let frames = self.frames.numbers.iter();
        let values = (self.frames.values).chunks_exact(self.asf.skeleton.dof_count().max(1));
        for (&number, values) in frames.zip(values) {
            write_frame(&mut out, self.asf, number, values);
        }
        out
    }

    /// Writes an AMC file, complete or not at all.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_file(path, &self.to_bytes())
    }
}

fn check_rate(rate: f64) -> Result<()> {
    if rate > 0.0 && rate.is_finite() {
        Ok(())
    } else {
        Err(Error::usage(format!(
            "a rate of {rate}: expected a number above zero"
        )))
    }
}

/// Reads the frames of a take, one at a time or as many as are there.
pub struct AmcReader<'a> {
    asf: &'a Asf,
    by_name: HashMap<&'a str, usize>,
    lines: Lines<BufReader<Box<dyn BufRead>>>,
    blocks: BlockReader<FrameFormat<'a>>,
    frame: AmcFrame,
    degrees: bool,
    /// The number of the frame whose number line was read already.
    next: Option<u64>,
    last: Option<u64>,
    whole: u64,
    keep_whole: bool,
    /// Set when `keep_whole` dropped the last, cut off frame: its number.
    pub dropped: Option<u64>,
    seen: Vec<bool>,
}

/// A line of a take.
enum Line {
    Number(u64),
    Bone(usize),
    Nothing,
}

/// A faulty line of values; a wrong count may be the take's cut off end.
enum Fault {
    Cut(Error),
    Wrong(Error),
}

impl<'a> AmcReader<'a> {
    /// Reads the take's head. With `keep_whole`, a take cut off in its last frame ends before that
    /// frame.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: no frame, or none with a number.
    pub fn new(asf: &'a Asf, input: Input, keep_whole: bool) -> Result<AmcReader<'a>> {
        AmcReader::with_block(asf, input, keep_whole, BLOCK)
    }

    fn with_block(
        asf: &'a Asf,
        input: Input,
        keep_whole: bool,
        block: usize,
    ) -> Result<AmcReader<'a>> {
        let by_name = asf
            .skeleton
            .bones()
            .iter()
            .enumerate()
            .map(|(i, b)| (b.name.as_str(), i))
            .collect();
        let name = input.name.clone();
        let mut reader = AmcReader {
            asf,
            by_name,
            lines: Lines::new(name, BufReader::with_capacity(block, input.into_reader())),
            blocks: BlockReader::new(FrameFormat::new(asf)),
            frame: AmcFrame::default(),
            degrees: asf.degrees,
            next: None,
            last: None,
            whole: 0,
            keep_whole,
            dropped: None,
            seen: vec![false; asf.skeleton.bones().len()],
        };
        reader.head()?;
        reader.blocks.format.degrees = reader.degrees;
        Ok(reader)
    }

    /// Whether the take's angles are in degrees.
    pub(crate) fn degrees(&self) -> bool {
        self.degrees
    }

    fn head(&mut self) -> Result<()> {
        while let Some(line) = self.lines.next_line()? {
            let text = line.split('#').next().unwrap_or("").trim();
            match text.to_ascii_uppercase().as_str() {
                "" => continue,
                ":DEGREES" => self.degrees = true,
                ":RADIANS" => self.degrees = false,
                other if other.starts_with(':') => continue,
                _ => {
                    let first = text.split_whitespace().next().unwrap_or("");
                    let found = excerpt(first);
                    self.next = Some(first.parse::<u64>().map_err(|_| {
                        Error::data(
                            self.lines.here(),
                            format!("expected a frame's number, found \"{found}\""),
                        )
                    })?);
                    return Ok(());
                }
            }
        }
        Err(Error::data(Place::file(&self.lines.name), "has no frames"))
    }

    /// The next frames into `frames`: those that are there, at least one; `false` at the end of the
    /// take.
    ///
    /// # Errors
    /// Those of [`AmcReader::read`].
    pub fn read_block(&mut self, frames: &mut AmcFrames) -> Result<bool> {
        frames.numbers.clear();
        frames.values.clear();
        if !self.blocks.take_careful() {
            self.read_plain(frames)?;
        }
        if !frames.numbers.is_empty() {
            return Ok(true);
        }
        let mut frame = std::mem::take(&mut self.frame);
        let more = self.read(&mut frame)?;
        if more {
            frames.numbers.push(frame.number);
            frames.values.extend_from_slice(&frame.values);
        }
        self.frame = frame;
        Ok(more)
    }

    /// Appends what plain frames come next and are there.
    fn read_plain(&mut self, frames: &mut AmcFrames) -> Result<()> {
        let Some(first) = self.next else {
            return Ok(());
        };
        if self
            .last
            .is_some_and(|last| last.checked_add(1) != Some(first))
        {
            return Ok(());
        }
        let parsed = self.blocks.read(self.lines.waiting()?, first);
        for piece in self.blocks.pieces() {
            let records = &piece.records;
            let numbers = (records.first..).take(records.count as usize);
            frames.numbers.extend(numbers);
            frames.values.extend_from_slice(&records.values);
            self.next = Some(records.next);
        }
        self.lines.pass(parsed.bytes, parsed.line_feeds);
        self.last = frames.numbers.last().copied().or(self.last);
        self.whole += frames.numbers.len() as u64;
        Ok(())
    }

    /// The next frame into `frame`; `false` at the end of the take.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: a bone or a value is missing, unknown or
    /// doubled, frames are not numbered
    /// without a gap, or the take is cut off; the place has the line.
    pub fn read(&mut self, frame: &mut AmcFrame) -> Result<bool> {
        let Some(number) = self.next.take() else {
            return Ok(false);
        };
        if let Some(last) = self.last
            && Some(number) != last.checked_add(1)
        {
            let kind = if number == last {
                "repeats"
            } else {
                "does not follow"
            };
            let what = format!(
                "frame {number} {kind} frame {last}; frames must be numbered without a gap"
            );
            return Err(Error::data(self.lines.here(), what));
        }
        self.last = Some(number);
        frame.number = number;
        frame.values.clear();
        frame.values.resize(self.asf.skeleton.dof_count(), 0.0);
        self.seen.fill(false);
        loop {
            match self.bone_line(frame) {
                Ok(Some(Line::Number(next))) => {
                    self.next = Some(next);
                    let line = self.lines.number;
                    if let Some(bone) = self.missing() {
                        let what =
                            format!("frame {number} ends without bone \"{}\"", excerpt(bone));
                        return Err(Error::data(Place::line(&self.lines.name, line), what));
                    }
                    break;
                }
                Ok(Some(Line::Bone(bone))) => {
                    if std::mem::replace(&mut self.seen[bone], true) {
                        let name = excerpt(&self.asf.skeleton.bones()[bone].name);
                        let what = format!("bone \"{name}\" appears twice in frame {number}");
                        return Err(Error::data(self.lines.here(), what));
                    }
                }
                Ok(Some(Line::Nothing)) => {}
                Ok(None) => match self.missing() {
                    Some(bone) => {
                        let why = format!("bone \"{}\" is missing", excerpt(bone));
                        return self.cut_off(number, &why);
                    }
                    None => break,
                },
                Err(Fault::Wrong(e)) => return Err(e),
                // A short or broken line is the cut off end of a take only when nothing follows it.
                Err(Fault::Cut(e)) => {
                    while let Some(line) = self.lines.next_line()? {
                        if !line.trim().is_empty() {
                            return Err(e);
                        }
                    }
                    let what = match e {
                        Error::Data { what, .. } => what.to_string(),
                        e => return Err(e),
                    };
                    return self.cut_off(number, &what);
                }
            }
        }
        self.whole += 1;
        Ok(true)
    }

    fn missing(&self) -> Option<&'a str> {
        let bones = self.asf.skeleton.bones();
        let at = (0..bones.len()).find(|&i| !self.seen[i] && !bones[i].dofs.is_empty())?;
        Some(&bones[at].name)
    }

    fn cut_off(&mut self, number: u64, why: &str) -> Result<bool> {
        if self.keep_whole && self.whole > 0 {
            self.dropped = Some(number);
            return Ok(false);
        }
        let what = if self.whole > 0 {
            format!(
                "the take is cut off in frame {number} ({why}) after {} complete frames; use the \
                 option `keep_whole` to keep them",
                self.whole
            )
        } else {
            format!("the take is cut off in its first frame, {number} ({why})")
        };
        Err(Error::data(self.lines.here(), what))
    }

    fn bone_line(&mut self, frame: &mut AmcFrame) -> std::result::Result<Option<Line>, Fault> {
        let degrees = self.degrees;
        let Some(line) = self.lines.next_line().map_err(Fault::Wrong)? else {
            return Ok(None);
        };
        let text = line.split('#').next().unwrap_or("").trim();
        let mut words = text.split_ascii_whitespace();
        let Some(name) = words.next() else {
            return Ok(Some(Line::Nothing));
        };
        if name.starts_with(|c: char| c.is_ascii_digit())
            && words.clone().next().is_none()
            && let Ok(number) = name.parse()
        {
            return Ok(Some(Line::Number(number)));
        }
        let Some(&bone) = self.by_name.get(name) else {
            let what = format!("the skeleton has no bone \"{}\"", excerpt(name));
            return Err(Fault::Cut(Error::data(self.lines.here(), what)));
        };
        let skeleton = &self.asf.skeleton;
        let range = skeleton.dofs_of(bone);
        let mut count = 0;
        let mut fault = None;
        for word in words {
            if count < range.len() {
                let angle = skeleton.bones()[bone].dofs[count].channel.is_angle();
                let value = parse_number(word).and_then(|value| match (angle, degrees) {
                    (true, true) => Ok(value.to_radians()),
                    (true, false) => Ok(value),
                    (false, _) => check_length(value * self.asf.unit),
                });
                match value {
                    Ok(value) => frame.values[range.start + count] = value,
                    Err(e) => {
                        fault = Some(e);
                        break;
                    }
                }
            }
            count += 1;
        }
        let here = || {
            self.lines
                .here()
                .part(excerpt(&skeleton.bones()[bone].name))
        };
        if let Some(fault) = fault {
            return Err(Fault::Cut(fault.at(here())));
        }
        if count != range.len() {
            let what = format!("expected {} values, found {count}", range.len());
            return Err(Fault::Cut(Error::data(here(), what)));
        }
        Ok(Some(Line::Bone(bone)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASF: &str = "\u{feff}# made for tests\r\
        \n:version 1.10\r\n:units\r\
        \n  length 0.45\r\n  angle deg\r\
        \n:root\
        \n order TX TY TZ RX RY RZ\
        \n axis XYZ\n position 0 0 0\
        \n orientation 0 0 0\
        \n:bonedata\n begin\
        \n id 1\n name hip\n direction 1 0 0\
        \n length 2\n axis 0 0 0 XYZ\
        \n end\n begin\n name leg\
        \n direction 0 -1 0\
        \n length 4.5\
        \n axis 10 20 30 ZYX\
        \n dof rx rz\n limits (-10 20)\
        \n (-inf inf)\n end\
        \n:hierarchy\n begin\
        \n root hip\n hip leg\
        \n end\n";

    pub(super) fn asf() -> Asf {
        Asf::read(Input::new("t.asf", ASF.as_bytes()).unwrap(), None).unwrap()
    }

    fn take(text: &str, keep: bool) -> Result<Vec<AmcFrame>> {
        let asf = asf();
        let mut reader = AmcReader::new(
            &asf,
            Input::new("t.amc", std::io::Cursor::new(text.as_bytes().to_vec()))?,
            keep,
        )?;
        let (mut frames, mut frame) = (Vec::new(), AmcFrame::default());
        while reader.read(&mut frame)? {
            frames.push(frame.clone());
        }
        Ok(frames)
    }

    const TWO: &str = "#!OML\r\n\
        :FULLY-SPECIFIED\r\n\
        :DEGREES\r\n7\r\n\
        root 1 2 3 4 5 6\r\n\
        \r\nhip\r\nleg 90 -45\r\n\
        # between\r\n8\r\nleg 1 2\r\n\
        root 1 2 3 4 5 6";

    #[test]
    fn a_take_is_read_in_centimeters_and_radians() {
        let frames = take(TWO, false).unwrap();
        assert_eq!(frames.iter().map(|f| f.number).collect::<Vec<_>>(), [7, 8]);
        assert!((frames[0].values[0] - 2.54 / 0.45).abs() <= 1e-12);
        assert!((frames[0].values[6] - std::f64::consts::FRAC_PI_2).abs() <= 1e-12);
        let radians = take(&TWO.replace("DEGREES", "RADIANS"), false).unwrap();
        assert_eq!(radians[0].values[6], 90.0);
        let limits = asf().skeleton.limits();
        assert!((limits[6].0 + 10f64.to_radians()).abs() <= 1e-12 && limits[7].1.is_infinite());
    }

    #[test]
    fn written_takes_read_back() {
        let asf = asf();
        let frames = take(TWO, false).unwrap();
        let mut out = Vec::new();
        write_header(&mut out);
        (frames.iter()).for_each(|f| write_frame(&mut out, &asf, f.number, &f.values));
        let back = take(std::str::from_utf8(&out).unwrap(), false).unwrap();
        for (a, b) in frames.iter().zip(&back) {
            assert!(
                a.values
                    .iter()
                    .zip(&b.values)
                    .all(|(x, y)| (x - y).abs() <= 1e-9)
            );
        }
    }

    #[test]
    fn bad_takes_are_refused_with_line_and_reason() {
        let says = |text: &str, line: u64, part: &str| {
            let e = take(text, false).unwrap_err().to_string();
            assert!(
                e.starts_with(&format!("t.amc:{line}")) && e.contains(part),
                "{e}"
            );
            assert_eq!(e.lines().count(), 1);
        };
        says(&TWO.replace("leg 1 2", "tail 1"), 11, "no bone \"tail\"");
        says(
            &TWO.replace("leg 90 -45\r\n", ""),
            9,
            "without bone \"leg\"",
        );
        says(
            &TWO.replace("leg 1 2", "leg 1"),
            11,
            "expected 2 values, found 1",
        );
        says(&TWO.replace("leg 1 2", "leg 1 2 3"), 11, "found 3");
        says(&TWO.replace("leg 1 2", "leg 1 abc"), 11, "found \"abc\"");
        says(&TWO.replace("leg 1 2", "leg 1 nan"), 11, "finite");
        says(&TWO.replace("\n8\r", "\n9\r"), 10, "does not follow");
        says(&TWO.replace("\n8\r", "\n7\r"), 10, "repeats");
        says(
            &TWO.replace("leg 1 2\r\n", "leg 1 2\r\nleg 1 2\r\n"),
            12,
            "twice",
        );
        assert!(
            take("", false)
                .unwrap_err()
                .to_string()
                .contains("has no frames")
        );
    }

    #[test]
    fn a_cut_take_names_its_whole_frames_and_the_flag() {
        for cut in [
            "leg 1 2\r\nroot 1 2",
            "leg 1 2\r\nro",
            "leg 1 2\r\nroot 1 2 3 4 5 -",
        ] {
            let text = format!("{}{cut}", &TWO[..TWO.find("leg 1").unwrap()]);
            let e = take(&text, false).unwrap_err().to_string();
            assert!(
                e.contains("after 1 complete frames; use the option `keep_whole`"),
                "{e}"
            );
            assert_eq!(take(&text, true).unwrap().len(), 1);
        }
        assert!(
            take(":DEGREES\n1\nroot 1", true)
                .unwrap_err()
                .to_string()
                .contains("first frame")
        );
    }

    #[test]
    fn bad_skeletons_are_refused() {
        let says = |text: String, part: &str| {
            let e = Input::new("t.asf", std::io::Cursor::new(text.into_bytes()))
                .and_then(|input| Asf::read(input, None))
                .unwrap_err()
                .to_string();
            assert!(e.starts_with("t.asf") && e.contains(part), "{e}");
        };
        says(
            ASF.replace(" root hip\n", " root leg\n")
                .replace(" hip leg\n", " hip hip\n"),
            "cycle",
        );
        says(ASF.replace(" hip leg\n", ""), "not in the hierarchy");
        says(ASF.replace(" hip leg\n", " hip leg tail\n"), "\"tail\"");
        says(
            ASF.replace(" hip leg\n", " hip leg\n root leg\n"),
            "two parents",
        );
        says(ASF.replace("length 0.45", "mass 1"), "the option `units`");
        says(ASF.replace("length 2\n", "length x\n"), "found \"x\"");
        says(
            ASF.replace("limits (-10 20)\n (-inf inf)", "limits (-10 20)"),
            "limits",
        );
        says(ASF.replace("dof rx rz", "dof rx qz"), "qz");
        says(ASF[..ASF.find("dof").unwrap()].to_string(), "cut off");
        says(String::new(), "has no skeleton");
    }
}
