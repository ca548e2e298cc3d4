//! BVH files with missing values: the word `nan` among the motion, which the format does not have,
//! but which says what no number does.

use super::Bvh;
use super::read::motion_start;
use crate::pose::Channel;
use crate::{Error, Place, Result};
use ndarray::ArrayView2;

/// Digits after the point of what is filled.
const DECIMALS: usize = 6;

impl Bvh {
    /// The frames and channels that are missing, in order.
    pub fn missing(&self) -> Vec<(usize, usize)> {
        let values = self.motion.indexed_iter();
        values
            .filter(|(_, v)| v.is_nan())
            .map(|(at, _)| at)
            .collect()
    }

    /// The text of the file, `original`, with its missing values ([`Bvh::missing`]) from `motion`
    /// (frames, channels; radians and centimeters); every other byte stays. Lengths in the file
    /// are in units of `unit` centimeters. What `motion` does not have either stays missing.
    ///
    /// # Errors
    /// [`Error::Data`]: `original` is no BVH file.
    pub fn fill_missing(
        &self,
        original: &[u8],
        motion: ArrayView2<'_, f64>,
        unit: f64,
    ) -> Result<Vec<u8>> {
        let other = || Error::data(Place::file("the original"), "is no BVH file");
        let start = motion_start(original).ok_or_else(other)?;
        let channels: Vec<Channel> = (self.joints.iter())
            .flat_map(|j| j.channels.iter().copied())
            .collect();
        let mut out = original[..start].to_vec();
        let mut count = 0;
        let mut at = start;
        while at < original.len() {
            let is_space = |b: &u8| b.is_ascii_whitespace();
            let rest = &original[at..];
            let space = rest.iter().take_while(|b| is_space(b)).count();
            let word = rest[space..].iter().take_while(|b| !is_space(b)).count();
            out.extend_from_slice(&rest[..space]);
            let text = &rest[space..space + word];
            let (frame, channel) = (count / channels.len().max(1), count % channels.len().max(1));
            let value = motion.get([frame, channel]).copied();
            let is_missing = self
                .motion
                .get([frame, channel])
                .is_some_and(|v| v.is_nan());
            match value.filter(|v| v.is_finite() && is_missing && word > 0) {
                Some(value) => {
                    let value = match channels[channel].is_angle() {
                        true => value.to_degrees(),
                        false => value / unit,
                    };
                    out.extend(format!("{value:.DECIMALS$}").bytes());
                }
                None => out.extend_from_slice(text),
            }
            count += usize::from(word > 0);
            at += space + word;
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use crate::io::{Bvh, Input};

    const FILE: &str = "HIERARCHY\nROOT a\n{\
        \n OFFSET 0 0 0\
        \n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\
        \n End Site\n {\n OFFSET 0 10 0\
        \n }\n}\nMOTION\nFrames: 2\
        \nFrame Time: 0.01\
        \n1.50 0 0\t10 nan 0 \
        \n 2 0 0  NaN 1e0 0";

    #[test]
    fn only_what_is_missing_changes() {
        let bytes = FILE.replace("ROOT a", "ROOT h\u{f6}he").into_bytes();
        // Latin-1, as old files have it.
        let bytes: Vec<u8> = bytes
            .into_iter()
            .filter(|b| *b != 0xc3)
            .map(|b| if b == 0xb6 { 0xf6 } else { b })
            .collect();
        let input = Input::new("t.bvh", std::io::Cursor::new(bytes.clone())).unwrap();
        let bvh = Bvh::read(input, 1.0, false).unwrap();
        assert_eq!(bvh.missing(), [(0, 4), (1, 3)]);
        let mut motion = bvh.motion.clone();
        motion[[0, 4]] = 90_f64.to_radians();
        let filled = bvh.fill_missing(&bytes, motion.view(), 1.0).unwrap();
        let tail = |bytes: &[u8]| {
            String::from_utf8_lossy(bytes)
                .split("0.01\n")
                .last()
                .unwrap()
                .to_string()
        };
        assert_eq!(
            tail(&filled),
            "1.50 0 0\t10 90.000000 0 \n 2 0 0  NaN 1e0 0"
        );
        assert_eq!(filled.len(), bytes.len() + 6);
    }
}
