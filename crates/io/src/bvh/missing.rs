//! BVH files with missing values: the word `nan` among the motion, which the format does not have,
//! but which says what no number does.

use super::Bvh;
use super::read::motion_start;
use crate::number_words::Decimals;
use crate::{Error, Place, Result};
use ndarray::ArrayView2;

impl Bvh {
    /// The frames and channels that are missing, in order.
    pub fn missing(&self) -> Vec<(usize, usize)> {
        let values = self.motion.indexed_iter();
        values
            .filter(|(_, v)| v.is_nan())
            .map(|(at, _)| at)
            .collect()
    }

    /// The text of the file, `original`, with the values of `motion` (frames, channels; radians and
    /// centimeters) that are not its own, [missing](Bvh::missing) ones above all; every other byte
    /// stays, as does the text of what `motion` does not have. Lengths in the file are in units of
    /// `unit` centimeters.
    ///
    /// # Errors
    /// [`Error::Data`]: `original` is no BVH file.
    pub fn with_motion(
        &self,
        original: &[u8],
        motion: ArrayView2<'_, f64>,
        unit: f64,
    ) -> Result<Vec<u8>> {
        let other = || Error::data(Place::file("the original"), "is no BVH file");
        let start = motion_start(original).ok_or_else(other)?;
        let is_angle: Vec<bool> = (self.joints.iter())
            .flat_map(|j| j.channels.iter().map(|c| c.is_angle()))
            .collect();
        let (head, body) = original.split_at(start);
        let is_space = |b: &u8| b.is_ascii_whitespace();
        let mut decimals = Decimals::default();
        let words = body.split(is_space).filter(|word| !word.is_empty());
        words.for_each(|word| decimals.count(word));
        let (mut out, mut count) = (head.to_vec(), 0);
        for piece in body.chunk_by(|a, b| is_space(a) == is_space(b)) {
            if is_space(&piece[0]) {
                out.extend_from_slice(piece);
                continue;
            }
            let width = is_angle.len().max(1);
            let at = [count / width, count % width];
            count += 1;
            let is_new = |v: &&f64| {
                let was = self.motion.get(at).copied().unwrap_or(f64::NAN);
                v.is_finite() && v.to_bits() != was.to_bits()
            };
            match motion.get(at).filter(is_new) {
                Some(value) => {
                    let value = if is_angle[at[1]] {
                        value.to_degrees()
                    } else {
                        value / unit
                    };
                    out.extend(decimals.text(value, piece).bytes());
                }
                None => out.extend_from_slice(piece),
            }
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use crate::{Bvh, Input};

    const FILE: &str = "HIERARCHY\nROOT a\n{\
        \n OFFSET 0 0 0\
        \n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\
        \n End Site\n {\n OFFSET 0 10 0\
        \n }\n}\nMOTION\nFrames: 2\
        \nFrame Time: 0.01\
        \n1.50 0 0\t10 nan 0 \
        \n 2 0 0  NaN 1e0 0";

    #[test]
    fn only_what_is_new_changes() {
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
        let filled = bvh.with_motion(&bytes, motion.view(), 1.0).unwrap();
        let tail = |bytes: &[u8]| {
            String::from_utf8_lossy(bytes)
                .split("0.01\n")
                .last()
                .unwrap()
                .to_string()
        };
        assert_eq!(tail(&filled), "1.50 0 0\t10 90.00 0 \n 2 0 0  NaN 1e0 0");
        assert_eq!(filled.len(), bytes.len() + 2);
    }
}
