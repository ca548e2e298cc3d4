//! A take's text with some of its values changed.

use super::{Amc, AmcFrames, Asf};
use crate::number_words::Decimals;
use crate::pose::{JointChannels, Space};
use ndarray::{Array2, ArrayView2};
use std::collections::HashMap;
use std::ops::Range;

/// The motion of a take, with what its text needs to be written anew.
pub(crate) struct AmcMotion {
    /// The skeleton.
    pub asf: Asf,
    /// (frames, degrees of freedom), radians and centimeters; NaN where a value counts as missing.
    pub values: Array2<f64>,
    /// Whether the take's angles are in degrees.
    pub degrees: bool,
}

impl AmcMotion {
    /// The channels of each bone.
    pub(crate) fn channels(&self) -> Vec<JointChannels> {
        let bones = self.asf.skeleton.bones().iter();
        let mut all = JointChannels::all(bones.map(|bone| {
            let channels = bone.dofs.iter().map(|dof| dof.channel).collect();
            (bone.name.clone(), channels)
        }));
        // Acclaim's first angle is applied first, so it stands last in the product.
        all.iter_mut().for_each(|joint| joint.angles.reverse());
        all
    }

    /// The positions of bones (frames, 3 B), cm, with other values.
    pub(crate) fn positions(&self, values: ArrayView2<'_, f64>, bones: &[usize]) -> Array2<f64> {
        let frames = AmcFrames {
            numbers: (1..).take(values.nrows()).collect(),
            values: values.iter().copied().collect(),
        };
        let xyz = frames.positions(&self.asf.skeleton, bones, Space::World);
        let shape = (values.nrows(), 3 * bones.len());
        Array2::from_shape_vec(shape, xyz).unwrap_or_else(|_| Array2::zeros(shape))
    }

    /// The text of the take, `original`, with those of `values` that are new and no NaN; every
    /// other byte stays.
    pub(crate) fn rewritten(&self, original: &[u8], values: ArrayView2<'_, f64>) -> Vec<u8> {
        let mut decimals = Decimals::default();
        self.walk(original, |word, at| {
            at.into_iter().for_each(|_| decimals.count(word));
        });
        let mut out = Vec::with_capacity(original.len());
        self.walk(original, |word, at| {
            let is_new = |at: &[usize; 2]| {
                values[*at].is_finite() && values[*at].to_bits() != self.values[*at].to_bits()
            };
            match at.filter(is_new) {
                Some(at) => {
                    let text = decimals.text(self.in_file(at[1], values[at]), word);
                    out.extend(text.bytes());
                }
                None => out.extend_from_slice(word),
            }
        });
        out
    }

    /// The text of the take, `original`, with some of its frames, counted from 0, whose numbers
    /// stay.
    pub(crate) fn with_frames(original: &[u8], frames: Range<usize>) -> Vec<u8> {
        let (mut out, mut begun) = (Vec::new(), 0);
        for line in original.split_inclusive(|b| *b == b'\n') {
            begun += usize::from(is_frame_number(line));
            if begun == 0 || frames.contains(&(begun - 1)) {
                out.extend_from_slice(line);
            }
        }
        out
    }

    /// The text of a take with other values (frames, degrees of freedom), whose first frame has the
    /// number `first`: in degrees.
    pub(crate) fn with_values(&self, first: u64, values: ArrayView2<'_, f64>) -> Vec<u8> {
        Amc::from_values(&self.asf, first, values).to_bytes()
    }

    /// A value in the file's unit.
    fn in_file(&self, dof: usize, value: f64) -> f64 {
        let skeleton = &self.asf.skeleton;
        let bones = skeleton.bones().iter().enumerate();
        let dofs = bones.flat_map(|(b, bone)| skeleton.dofs_of(b).zip(&bone.dofs));
        let is_angle =
            |(i, of): (usize, &crate::pose::Dof)| (i == dof).then(|| of.channel.is_angle());
        match (dofs.into_iter().find_map(is_angle), self.degrees) {
            (Some(true), true) => value.to_degrees(),
            (Some(true), false) => value,
            _ => value / self.asf.unit,
        }
    }

    /// Hears each piece of the text in turn: words, with the frame and the degree of freedom of
    /// values, and what lies between them.
    fn walk(&self, text: &[u8], mut hear: impl FnMut(&[u8], Option<[usize; 2]>)) {
        let bones = self.asf.skeleton.bones().iter().enumerate();
        let by_name: HashMap<&[u8], usize> =
            bones.map(|(i, bone)| (bone.name.as_bytes(), i)).collect();
        let mut frames = 0;
        for line in text.split_inclusive(|b| *b == b'\n') {
            let comment = line.iter().position(|b| *b == b'#').unwrap_or(line.len());
            let (body, comment) = line.split_at(comment);
            let mut words = body
                .split(u8::is_ascii_whitespace)
                .filter(|w| !w.is_empty());
            let first = words.next().unwrap_or_default();
            frames += usize::from(is_frame_number(line));
            let bone = by_name
                .get(first)
                .filter(|_| (1..=self.values.nrows()).contains(&frames));
            let dofs = bone.map_or(0..0, |b| self.asf.skeleton.dofs_of(*b));
            let mut count = 0;
            for piece in body.chunk_by(|a, b| a.is_ascii_whitespace() == b.is_ascii_whitespace()) {
                let is_word = !piece[0].is_ascii_whitespace();
                // The first word is the name.
                let dof = dofs
                    .clone()
                    .nth(usize::wrapping_sub(count, 1))
                    .filter(|_| is_word);
                hear(piece, dof.map(|dof| [frames - 1, dof]));
                count += usize::from(is_word);
            }
            hear(comment, None);
        }
    }
}

/// Whether a line is the number of a frame.
fn is_frame_number(line: &[u8]) -> bool {
    let body = line.split(|b| *b == b'#').next().unwrap_or_default();
    let number = body.trim_ascii();
    !number.is_empty() && number.iter().all(u8::is_ascii_digit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Input;
    use crate::amc::AmcReader;
    use std::io::Cursor;

    const ASF: &str = ":units\n length 0.45\n angle deg\n:root\n order TX TY TZ RX RY RZ\n axis \
        XYZ\n position 0 0 0\n orientation 0 0 0\n:bonedata\n begin\n id 1\n name thigh\n \
        direction 0 -1 0\n length 2\n axis 0 0 0 XYZ\n dof rx\n end\n:hierarchy\n begin\n \
        root thigh\n end\n";

    #[test]
    fn only_new_values_are_written() {
        let text = ":FULLY-SPECIFIED\r\n:DEGREES\r\n1\r\nroot 1 2 3 10 20 30 # thigh 1\r\n\
            thigh  4.125\r\n2\r\nroot 1 2 3 10 20 30\r\nthigh 1e-3\r\n";
        let input = |text: &str| Input::new("t", Cursor::new(text.as_bytes().to_vec())).unwrap();
        let asf = Asf::read(input(ASF), None).unwrap();
        let mut reader = AmcReader::new(&asf, input(text), false).unwrap();
        let (mut frames, mut values) = (AmcFrames::default(), Vec::new());
        while reader.read_block(&mut frames).unwrap() {
            values.extend_from_slice(&frames.values);
        }
        let values = Array2::from_shape_vec((2, 7), values).unwrap();
        let motion = AmcMotion {
            asf: asf.clone(),
            values: values.clone(),
            degrees: true,
        };
        let write = |values: &Array2<f64>| {
            String::from_utf8(motion.rewritten(text.as_bytes(), values.view())).unwrap()
        };
        assert_eq!(write(&values), text);
        let mut other = values.clone();
        (other[[0, 6]], other[[1, 0]]) = (0.5_f64.to_radians(), 4.0 * asf.unit);
        other[[1, 6]] = f64::NAN;
        let wanted = text
            .replace("4.125", "0.500")
            .replace("2\r\nroot 1", "2\r\nroot 4.000");
        assert_eq!(write(&other), wanted);
        let cut = AmcMotion::with_frames(text.as_bytes(), 1..2);
        let (head, _) = text.split_once("1\r\n").unwrap();
        let (_, second) = text.split_once("2\r\n").unwrap();
        assert_eq!(
            String::from_utf8(cut).unwrap(),
            format!("{head}2\r\n{second}")
        );
        let names: Vec<usize> = motion.channels().iter().map(|j| j.angles.len()).collect();
        assert_eq!(names, [3, 1]);
        assert_eq!(motion.channels()[0].angles[0].0, 5);
    }
}
