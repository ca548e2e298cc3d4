//! Some frames of a BVH file as they stand, and its Frame Time.

use super::Bvh;
use super::read::{head_numbers, motion_start};
use crate::{Error, Place, Result};
use std::ops::Range;

impl Bvh {
    /// The text of the file, `original`, with some of its frames, counted from 0, and another Frame
    /// Time, seconds, where one is given. Their count is changed where it is no longer so; every
    /// other byte stays.
    ///
    /// # Errors
    /// [`Error::Data`]: `original` is no BVH file.
    pub fn with_frames(
        &self,
        original: &[u8],
        frames: Range<usize>,
        frame_time: Option<f64>,
    ) -> Result<Vec<u8>> {
        let other = || Error::data(Place::file("the original"), "is no BVH file");
        let [count, time] = head_numbers(original).ok_or_else(other)?;
        let start = motion_start(original).ok_or_else(other)?;
        let all = self.motion.nrows();
        let blanks = original[start..]
            .iter()
            .take_while(|b| b.is_ascii_whitespace());
        let (head, body) = original.split_at(start + blanks.count());
        let mut out = head[..count.start].to_vec();
        if frames == (0..all) {
            out.extend_from_slice(&head[count.clone()]);
        } else {
            out.extend(frames.len().to_string().bytes());
        }
        out.extend_from_slice(&head[count.end..time.start]);
        match frame_time {
            Some(seconds) => out.extend(format!("{seconds:.10}").bytes()),
            None => out.extend_from_slice(&head[time.clone()]),
        }
        out.extend_from_slice(&head[time.end..]);
        let width = self.motion.ncols();
        out.extend_from_slice(&body[kept(body, width, frames, all)]);
        Ok(out)
    }
}

/// The bytes of some frames: each from its first value to where the next frame begins.
fn kept(body: &[u8], width: usize, frames: Range<usize>, all: usize) -> Range<usize> {
    if frames == (0..all) || width == 0 {
        return 0..body.len();
    }
    let is_start = |at: &usize| {
        let is_space = |b: u8| b.is_ascii_whitespace();
        !is_space(body[*at]) && (*at == 0 || is_space(body[at - 1]))
    };
    let mut starts = (0..body.len()).filter(is_start).step_by(width);
    let first = starts.nth(frames.start).unwrap_or(body.len());
    let end = match frames.len() {
        0 => first,
        n => starts.nth(n - 1).unwrap_or(body.len()),
    };
    first..end
}

#[cfg(test)]
mod tests {
    use crate::Bvh;

    const FILE: &str = "HIERARCHY\nROOT a\n{\n OFFSET 0 0 0\
        \n CHANNELS 3 Zrotation Xrotation Yrotation\n}\nMOTION\nFrames : 4\
        \r\nFrame Time:.0083333\
        \r\n1.50 -0 0\r\n2 1e0 0 \r\n 3 nan 0\r\n4 0 0";

    fn with(frames: std::ops::Range<usize>, time: Option<f64>) -> String {
        let bytes = FILE.as_bytes().to_vec();
        let bvh = Bvh::from_bytes("t.bvh", bytes.clone()).unwrap();
        String::from_utf8(bvh.with_frames(&bytes, frames, time).unwrap()).unwrap()
    }

    #[test]
    fn frames_keep_their_text() {
        assert_eq!(with(0..4, None), FILE);
        let head = FILE.split("1.50").next().unwrap();
        let counted = |n: &str| head.replace("Frames : 4", &format!("Frames : {n}"));
        assert_eq!(with(1..3, None), counted("2") + "2 1e0 0 \r\n 3 nan 0\r\n");
        assert_eq!(with(0..1, None), counted("1") + "1.50 -0 0\r\n");
        assert_eq!(with(3..4, None), counted("1") + "4 0 0");
        assert_eq!(with(2..2, None), counted("0"));
    }

    #[test]
    fn the_frame_time_alone_changes() {
        let other = FILE.replace(".0083333", "0.0166666667");
        assert_eq!(with(0..4, Some(1.0 / 60.0)), other);
    }
}
