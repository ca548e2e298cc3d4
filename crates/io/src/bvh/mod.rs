//! Biovision hierarchies (BVH): read with whatever about ten exporters make of them, and written.
//!
//! A joint stands at OFFSET from its parent's joint, in its parent's frame, and turns what hangs on
//! it: with channels `c₁ c₂ c₃` its rotation is `R = R_c₁ R_c₂ R_c₃`, the last named turning first.
//! A position channel takes the place of its OFFSET component; it is not added to it. (Files with
//! position channels below the root or a root OFFSET repeat the OFFSET in them, and MotionBuilder
//! and Blender read them so.)
//!
//! The crate bvh_anim 0.4 serves here as an independent reader in the tests, not as the reader. Of
//! thirteen real files of about ten exporters it reads eleven as we do; of one (Mixamo's) it cuts
//! every name at its colon, and one with stray braces it refuses. By its source it also keeps
//! values in single precision and Frame Time in whole nanoseconds, writing it without its whole
//! seconds; loses a leaf without an End Site; and panics where a keyword is not expected, a name is
//! missing or braces do not match, so that to make a text safe for it is to parse it all. It
//! can write only what it read: its builder drops the joints.

mod export;
mod frame_lines;
mod mirror;
mod missing;
mod read;
mod skeleton;
mod skeleton_builder;
mod write;

pub use export::BvhExporter;
pub use read::LARGEST_FILE;
pub use skeleton::{BvhPoints, BvhSkeleton, BvhTemplate};

use super::input::Input;
use super::output::write_file;
use crate::pose::poses::round_rate;
use crate::pose::{Channel, Poses};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;
use std::io::Cursor;
use std::path::Path;

/// The Frame Times that motion has, seconds. What lies outside is a damaged file, or another unit
/// of time.
pub(crate) const FRAME_TIMES: std::ops::RangeInclusive<f64> = 0.0001..=10.0;

/// The most joints and End Sites a file may have: no skeleton has them.
pub(crate) const MOST_JOINTS: usize = 4096;

/// One joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// The joint's name; no two are equal.
    pub name: String,
    /// The index of the parent joint, which comes before this one; `None` for the first alone.
    pub parent: Option<usize>,
    /// Vector from the parent joint to this one, in the parent's frame, centimeters.
    pub offset: DVec3,
    /// The channels in the file's order.
    pub channels: Vec<Channel>,
    /// The End Sites, in the file's order. Most joints have none or one.
    pub ends: Vec<EndSite>,
}

/// Where a chain ends.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EndSite {
    /// Vector from its joint, in the joint's frame, centimeters.
    pub offset: DVec3,
    /// The number of child joints that stand before it in the file; most End Sites have none
    /// beside them.
    pub after: usize,
}

/// A hierarchy and its motion, in the file's axes; centimeters and radians.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bvh {
    /// The joints, depth first, as the file names them.
    pub joints: Vec<Joint>,
    /// The file's Frame Time: seconds from frame to frame.
    pub frame_time: f64,
    /// (frames, channels), radians and centimeters.
    pub motion: Array2<f64>,
    /// Warnings of the reader, a line each.
    pub notes: Vec<String>,
}

impl Bvh {
    /// Opens a BVH file in centimeters.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: no sound BVH file; the place has
    /// the line.
    pub fn open(path: impl AsRef<Path>) -> Result<Bvh> {
        Bvh::read(Input::open(path)?, 1.0, false)
    }

    /// Reads the bytes of a BVH file in centimeters; `name` is for messages.
    ///
    /// ```
    /// let bytes = std::fs::read("../../testdata/examples/animator/goblin.bvh")?;
    /// let rig = posing_io::Bvh::from_bytes("goblin.bvh", bytes)?;
    /// assert_eq!(rig.joints[0].name, "Hips");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: no sound BVH file; the place has the line.
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Result<Bvh> {
        Bvh::read(Input::new(name, Cursor::new(bytes))?, 1.0, false)
    }

    /// Writes a BVH file in centimeters, complete or not at all.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_file(path, &self.to_bytes(1.0))
    }

    /// The number of channels of a frame.
    #[doc(hidden)]
    pub fn channels(joints: &[Joint]) -> usize {
        joints.iter().map(|j| j.channels.len()).sum()
    }

    /// Frames a second, rounded to the exact rate that the Frame Time stands for (files often cut
    /// it to six decimals); `None` where the Frame Time is none of a motion: outside
    /// `FRAME_TIMES`.
    pub fn rate(&self) -> Option<f64> {
        let is_one = FRAME_TIMES.contains(&self.frame_time);
        is_one.then(|| round_rate(1.0 / self.frame_time))
    }

    /// [`Bvh::rate`], else the rate given.
    ///
    /// # Errors
    /// [`Error::Unfit`]: neither is there. The Frame Time 0 of a single frame is no fault; its rate
    /// is 1.
    pub fn rate_or(&self, given: Option<f64>) -> Result<f64> {
        let is_still = self.motion.nrows() <= 1 && self.frame_time == 0.0;
        let rate = self.rate().or(given).or(is_still.then_some(1.0));
        let (least, most) = (FRAME_TIMES.start(), FRAME_TIMES.end());
        rate.ok_or_else(|| {
            Error::unfit(format!(
                "its Frame Time is {} s, outside {least} to {most} s; \
                 give the frames per second with the option `fps`",
                self.frame_time
            ))
        })
    }

    /// The positions of the joints and End Sites (`NAME_end`), for a file whose y axis points up.
    ///
    /// # Errors
    /// [`Error::Usage`]: the Frame Time gives no rate ([`Bvh::rate_or`]), or the joints are no
    /// tree.
    pub fn to_poses(&self) -> Result<Poses> {
        let skeleton = BvhSkeleton::new(&self.joints, DMat3::IDENTITY, true)?;
        let rate = self.rate_or(None).map_err(Error::into_usage)?;
        Ok(self.positions(&skeleton, BvhPoints::Origins, rate))
    }

    /// The positions of `which` points of `skeleton`, which is that of [`Bvh::joints`], at `rate`
    /// frames a second.
    pub fn positions(&self, skeleton: &BvhSkeleton, which: BvhPoints, rate: f64) -> Poses {
        let points = skeleton.points(which);
        let xyz = skeleton.positions(self.motion.view(), which);
        Poses {
            points: points.iter().map(|(name, _)| name.clone()).collect(),
            time: Some((0..xyz.nrows()).map(|i| i as f64 / rate).collect()),
            xyz,
            take: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;
    use std::io::Cursor;

    /// Leaves with and without End Sites, two joints at one position, orders of all kinds, odd
    /// spellings.
    const ODD: &str = "\u{feff}Hierarchy\r\
        \nROOT Left Hip:x\r\
        \n{\r\n OFFSET 1 2 3\r\
        \n CHANNELS 6 Zrotation Xrotation Yrotation Xposition Yposition Zposition\r\
        \n JOINT a {\n OFFSET 0 10. .5\
        \n CHANNELS 3 xROTATION YRotation Zrotation\
        \n End site\n {\n OFFSET 0 1e0 0\
        \n }\n }\n JOINT b\n {\
        \n OFFSET 0 10 .5\
        \n CHANNELS 1 Yrotation\
        \n EndSite {\n }\n }\
        \n JOINT a\n {\n OFFSET -3 0 0\
        \n }\n}\nMOTION\nFrames : 2\
        \nFrame Time:.0083333\
        \n";

    fn load(text: impl Into<Vec<u8>>, whole: bool) -> Result<Bvh> {
        Bvh::read(Input::new("t.bvh", Cursor::new(text.into()))?, 1.0, whole)
    }

    fn odd(values: &str) -> String {
        format!("{ODD}{values}")
    }

    const FRAME: &str = "90 0 0 5 6 7 0 0 0 0 ";

    #[test]
    fn names_that_are_not_utf_8_stay_apart_and_are_told() {
        let text = odd(&FRAME.repeat(2)).replace("JOINT a {", "JOINT \u{e4} {");
        assert_eq!(load(text.clone(), false).unwrap().notes.len(), 0);
        // Two words of Shift-JIS, in bytes, one of which has that of a no-break space.
        let start = text
            .replace('\u{e4}', "AAAA")
            .replace("JOINT b\n", "JOINT BBBB\n");
        let mut bytes = start.into_bytes();
        for (word, own) in [(b"AAAA", b"\x8d\xb6\x98r"), (b"BBBB", b"\x89\xa0\x83\\")] {
            let at = bytes.windows(4).position(|four| four == word).unwrap();
            bytes[at..at + 4].copy_from_slice(own);
        }
        let bvh = load(bytes.clone(), false).unwrap();
        let names: Vec<&str> = bvh.joints.iter().map(|j| j.name.as_str()).collect();
        assert_eq!(
            names[1..3],
            ["\u{fffd}\u{b6}\u{fffd}r", "\u{fffd}\u{a0}\u{fffd}\\"]
        );
        let told = "2 names of joints are not UTF-8";
        assert!(
            bvh.notes.len() == 1 && bvh.notes[0].contains(told),
            "{:?}",
            bvh.notes
        );
        let again = bvh.with_motion(&bytes, bvh.motion.view(), 1.0).unwrap();
        assert_eq!(again, bytes);
    }

    #[test]
    fn odd_files_are_read() {
        let loaded = load(odd(&FRAME.repeat(2)), false).unwrap();
        assert_eq!(loaded.notes.len(), 1, "{:?}", loaded.notes);
        let bvh = loaded;
        let names: Vec<&str> = bvh.joints.iter().map(|j| j.name.as_str()).collect();
        assert_eq!(names, ["Left Hip:x", "a", "b", "a_2"]);
        assert_eq!(bvh.motion.dim(), (2, 10));
        assert!((bvh.frame_time - 0.0083333).abs() <= 1e-15);
        assert_eq!(bvh.joints[2].ends, [EndSite::default()]);
        let rig = BvhSkeleton::new(&bvh.joints, DMat3::IDENTITY, true).unwrap();
        let mut q = vec![0.0; rig.skeleton.dof_count()];
        rig.values(&bvh.motion.row(0).to_vec(), &mut q);
        let ends = rig.skeleton.posture(&q).ends;
        let at = |name: &str, which| {
            let points = rig.points(which);
            ends[points.iter().find(|p| p.0 == name).unwrap().1]
        };
        let close = |a: DVec3, b: [f64; 3]| (a - DVec3::from_array(b)).length() <= 1e-12;
        // The root's position takes the place of its OFFSET, and a quarter turn about z carries y
        // to -x.
        assert!(close(at("Left Hip:x", BvhPoints::Origins), [5., 6., 7.]));
        assert!(close(at("a", BvhPoints::Origins), [-5., 6., 7.5]));
        assert!(close(at("a_end", BvhPoints::Origins), [-6., 6., 7.5]));
        assert!(close(at("a", BvhPoints::Ends), [-6., 6., 7.5]));
        assert!(close(at("a_2", BvhPoints::Ends), [5., 3., 7.]));
        assert_eq!(
            rig.frame(&q).collect::<Vec<_>>(),
            bvh.motion.row(0).to_vec()
        );
    }

    #[test]
    fn names_have_no_control_characters_and_no_blanks_at_their_ends() {
        let text = odd(FRAME).replace("JOINT b", "JOINT \u{1} b\u{1b} \u{7}");
        let bvh = load(text, false).unwrap();
        assert_eq!(bvh.joints[2].name, "b");
        let again = load(bvh.to_bytes(1.0), false).unwrap();
        assert_eq!(again.joints[2].name, "b");
    }

    #[test]
    fn a_line_with_a_wrong_number_of_values_is_reported() {
        let frame = |line: &str| format!("{}\n", line.trim());
        let (excerpt, long) = ("90 0 0 5 6 7 0 0 0", "90 0 0 5 6 7 0 0 0 0 0");
        for (lines, wrong) in [
            ([excerpt, FRAME, FRAME], 1),
            ([FRAME, excerpt, FRAME], 2),
            ([long, excerpt, ""], 1),
            ([FRAME, FRAME, long], 3),
            // As many lines as the file says are its frames.
            ([long, long, ""], 1),
            ([excerpt, FRAME, ""], 1),
        ] {
            let text: String = lines.into_iter().map(frame).collect();
            for keep_whole in [false, true] {
                let message = load(odd(&text), keep_whole).unwrap_err().to_string();
                let named = format!("frame {wrong}: expected 10 values");
                assert!(message.contains(&named), "{message}");
            }
        }
        // Laid out otherwise, values count alone.
        let wrapped = frame(&FRAME.replace('5', "5\n")).repeat(3);
        assert_eq!(load(odd(&wrapped), false).unwrap().motion.nrows(), 3);
        let by_width = FRAME.repeat(10);
        let by_width: Vec<&str> = by_width.split_whitespace().collect();
        let by_width: Vec<String> = by_width.chunks(9).map(|c| c.join(" ") + "\n").collect();
        let first_whole = frame(FRAME) + &by_width.concat();
        assert_eq!(load(odd(&first_whole), false).unwrap().motion.nrows(), 11);
        let two_at_once = frame(FRAME) + &frame(&FRAME.repeat(2));
        assert_eq!(load(odd(&two_at_once), false).unwrap().motion.nrows(), 3);
    }

    #[test]
    fn frame_times_outside_of_motion_give_no_rate() {
        let timed = |time: &str| {
            let text = odd(&FRAME.repeat(2)).replace(".0083333", time);
            load(text, false).unwrap()
        };
        for time in ["18446744073709551615", "0", "-0.01", "0.00001", "11"] {
            let bvh = timed(time);
            let fault = bvh.rate_or(None).unwrap_err().to_string();
            assert!(
                fault.contains("Frame Time") && fault.contains("the option `fps`"),
                "{fault}"
            );
            assert_eq!(bvh.rate_or(Some(30.0)).unwrap(), 30.0);
            assert!(bvh.to_poses().is_err());
        }
        assert_eq!(timed("0.0001").rate(), Some(10_000.0));
        assert_eq!(timed("10").rate(), Some(0.1));
        let still = |time: &str| load(odd(FRAME).replace(".0083333", time), false).unwrap();
        assert_eq!(still("0").rate_or(None).unwrap(), 1.0);
        assert!(still("1e12").rate_or(None).is_err());
    }

    #[test]
    fn a_root_called_joint_and_end_sites_after_children_keep_their_positions() {
        let text = "HIERARCHY\nJOINT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xrotation Yrotation Zrotation\n\
            End Site\n{\nOFFSET 1 0 0\n}\n\
            JOINT b\n{\nOFFSET 0 1 0\nCHANNELS 0\nEnd Site\n{\nOFFSET 2 0 0\n}\n}\n\
            End Site\n{\nOFFSET 3 0 0\n}\n\
            JOINT c\n{\nOFFSET 0 2 0\nCHANNELS 0\n}\nEnd Site\n{\nOFFSET 4 0 0\n}\n}\n\
            MOTION\nFrames: 1\nFrame Time: 0.01\n0 0 0\n";
        let bvh = load(text, false).unwrap();
        let after: Vec<usize> = bvh.joints[0].ends.iter().map(|e| e.after).collect();
        assert_eq!(after, [0, 1, 2]);
        let written = String::from_utf8(bvh.to_bytes(1.0)).unwrap();
        let bare = |text: &str| -> Vec<String> {
            let head = text.split("MOTION").next().unwrap();
            let lines = head.lines().map(|l| l.trim().replace(".000000", ""));
            lines.map(|l| l.replace("JOINT a", "ROOT a")).collect()
        };
        assert_eq!(bare(&written), bare(text));
        assert_eq!(load(written, false).unwrap(), bvh);
    }

    #[test]
    fn the_frame_count_of_the_header_is_not_trusted() {
        let three = load(odd(&FRAME.repeat(3)), false).unwrap();
        assert_eq!(three.motion.nrows(), 3);
        assert!(
            three.notes[0].contains("announces 2 frames but has 3"),
            "{:?}",
            three.notes
        );
        let e = load(odd(&format!("{FRAME}1 2")), false)
            .unwrap_err()
            .to_string();
        assert!(
            e.contains("frame 2 (2 of 10 values) after 1 complete")
                && e.contains("the option `keep_whole`"),
            "{e}"
        );
        assert_eq!(
            load(odd(&format!("{FRAME}1 2")), true)
                .unwrap()
                .motion
                .nrows(),
            1
        );
        assert_eq!(load(odd(""), false).unwrap().motion.nrows(), 0);
        let many = odd(FRAME).replace("Frames : 2", "Frames: 99999999999999");
        assert_eq!(load(many, false).unwrap().motion.nrows(), 1);
    }

    #[test]
    fn bad_files_are_refused_with_line_and_reason() {
        let says = |text: String, part: &str| {
            let e = load(text, false).unwrap_err().to_string();
            assert!(
                e.starts_with("t.bvh") && e.contains(part) && e.lines().count() == 1,
                "{e}"
            );
        };
        let good = odd(FRAME);
        says(String::new(), "is empty");
        says("take,time\n".into(), "t.bvh:1: expected HIERARCHY");
        says(good[..good.find("MOTION").unwrap()].into(), "has no MOTION");
        says("HIERARCHY\n".into(), "ends after its first line");
        says(
            good[..good.find("End site").unwrap()].into(),
            "hierarchy is cut off",
        );
        says(
            good[..good.find(".0083").unwrap()].into(),
            "Frame Time: has no number",
        );
        says(good.replace("}\nMOTION", "MOTION"), "} is missing");
        says(
            good.replace("OFFSET 1 2 3", "OFFSET 1 2 x"),
            "t.bvh:4: expected a number, found \"x\"",
        );
        says(good.replace("OFFSET -3 0 0", ""), "\"a\" has no OFFSET");
        says(
            good.replace("CHANNELS 1 Yrotation", "CHANNELS 1 Wrotation"),
            "found \"Wrotation\"",
        );
        says(
            good.replace("CHANNELS 1 Yrotation", "CHANNELS 2 Yrotation Yrotation"),
            "twice",
        );
        says(
            good.replace("CHANNELS 1 Yrotation", "CHANNELS 1 Yrotation Xrotation"),
            "more channels",
        );
        says(
            good.replace("CHANNELS 1", "CHANNELS 999999999"),
            "0 to 6 channels",
        );
        says(good.replace("Frames", "Fames"), "expected Frames:");
        says(
            good.replace("Frame Time", "Frame Tim"),
            "expected Frame Time:",
        );
        says(good.replace("90 0", "inf 0"), "frame 1, value 1");
        says(
            good.replace("90 0", "1e300 0"),
            "too large for a length or angle",
        );
        says(
            good.replace("}\nMOTION", "}\nROOT again\n{\nOFFSET 0 0 0\n}\nMOTION"),
            "second ROOT",
        );
        let deep = format!(
            "HIERARCHY ROOT r {{ OFFSET 0 0 0 {}",
            "JOINT j { OFFSET 0 1 0 ".repeat(5000)
        );
        says(deep, "more than 4096");
    }

    #[test]
    fn written_files_read_back_here_and_in_bvh_anim() {
        let mut bvh = load(odd(&FRAME.repeat(2)), false).unwrap();
        // What the crate cannot read: names with spaces or colons, leaves without an End Site.
        bvh.joints[0].name = "root".into();
        bvh.joints[3].ends.push(EndSite {
            offset: DVec3::X,
            after: 0,
        });
        let text = bvh.to_bytes(2.54);
        let back = Bvh::read(
            Input::new("t", Cursor::new(text.clone())).unwrap(),
            2.54,
            false,
        )
        .unwrap();
        assert!(back.notes.is_empty(), "{:?}", back.notes);
        let near = |a: DVec3, b: DVec3| (a - b).length() <= 1e-5;
        for (a, b) in bvh.joints.iter().zip(&back.joints) {
            assert_eq!(
                (&a.name, a.parent, &a.channels),
                (&b.name, b.parent, &b.channels)
            );
            assert!(near(a.offset, b.offset));
            assert!(
                (a.ends.iter().zip(&b.ends)).all(|(a, b)| near(a.offset, b.offset))
                    && a.ends.len() == b.ends.len()
            );
        }
        assert!((&bvh.motion - &back.motion).iter().all(|e| e.abs() <= 1e-5));
        assert!((bvh.frame_time - back.frame_time).abs() <= 1e-10);
        let other = bvh_anim::from_bytes(&text).unwrap();
        assert_eq!(other.num_frames(), 2);
        assert_eq!(other.joints().count(), bvh.joints.len());
        for (frame, row) in other.frames().zip(back.motion.rows()) {
            let kinds = bvh.joints.iter().flat_map(|j| &j.channels);
            for ((a, &b), kind) in frame.as_slice().iter().zip(row).zip(kinds) {
                let b = if kind.is_angle() {
                    b.to_degrees()
                } else {
                    b / 2.54
                };
                assert!((f64::from(*a) - b).abs() <= 1e-4);
            }
        }
    }

    #[test]
    fn real_files_read_as_bvh_anim_reads_them() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../../shared/data/formats/bvh");
        if !folder.exists() {
            eprintln!("skipped: no {}", folder.display());
            return;
        }
        let mut agreed = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let ours = Bvh::open(&path).unwrap();
            let Ok(other) = bvh_anim::from_bytes(std::fs::read(&path).unwrap()) else {
                continue;
            };
            assert_eq!(other.num_frames(), ours.motion.nrows());
            for (a, b) in other.joints().zip(&ours.joints) {
                let a = a.data();
                assert!(b.name.starts_with(&a.name().to_string()));
                assert_eq!(a.channels().len(), b.channels.len());
                assert!((f64::from(a.offset().y) - b.offset.y).abs() <= 1e-4);
            }
            let kinds: Vec<bool> = ours
                .joints
                .iter()
                .flat_map(|j| &j.channels)
                .map(|c| c.is_angle())
                .collect();
            for (frame, row) in other.frames().zip(ours.motion.rows()) {
                for ((a, &b), angle) in frame.as_slice().iter().zip(row).zip(&kinds) {
                    let b = if *angle { b.to_degrees() } else { b };
                    // Single precision; angles here run to thousands of degrees.
                    assert!((f64::from(*a) - b).abs() <= 1e-6 * (100.0 + b.abs()));
                }
            }
            agreed += 1;
        }
        assert!(agreed >= 12, "{agreed}");
    }

    #[test]
    fn mutated_files_neither_panic_nor_hang() {
        let mut random = crate::numeric::parallel::rng(7, 0);
        let good = odd(&FRAME.repeat(2)).into_bytes();
        let bits: [&[u8]; 14] = [
            b"{",
            b"}",
            b"nan",
            b"-",
            b"1e999",
            b"\0",
            b"\xff\xfe",
            b" JOINT j ",
            b" End Site ",
            b" 99999999999 ",
            b":",
            b" CHANNELS 6 ",
            b"\n\nMOTION\n",
            b" OFFSET 0 0 0 ",
        ];
        for _ in 0..10_000 {
            let mut bytes = good.clone();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..bytes.len().max(1)).min(bytes.len());
                match random.random_range(0..5) {
                    0 if at < bytes.len() => bytes[at] = random.random(),
                    1 => drop(bytes.drain(at..(at + random.random_range(1..200)).min(bytes.len()))),
                    2 => bytes.truncate(at),
                    3 => {
                        let to = (at + 100).min(bytes.len());
                        let copy = bytes[at..to].to_vec();
                        let into = random.random_range(0..=bytes.len());
                        bytes.splice(into..into, copy);
                    }
                    _ => {
                        let bit = bits[random.random_range(0..bits.len())];
                        bytes.splice(at..at, bit.iter().copied());
                    }
                }
            }
            let Ok(loaded) = load(bytes, random.random()) else {
                continue;
            };
            for sliding in [true, false] {
                let rig = BvhSkeleton::new(&loaded.joints, DMat3::IDENTITY, sliding).unwrap();
                let mut q = vec![0.0; rig.skeleton.dof_count()];
                let rows = loaded.motion.rows().into_iter();
                for row in rows.filter(|row| row.iter().all(|v| v.is_finite())) {
                    rig.values(&row.to_vec(), &mut q);
                    assert!(rig.skeleton.posture(&q).ends.iter().all(|e| e.is_finite()));
                }
            }
            let again = loaded.to_bytes(1.0);
            assert_eq!(
                load(again, false).unwrap().motion.dim(),
                loaded.motion.dim()
            );
        }
    }
}
