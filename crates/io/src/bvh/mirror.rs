//! A BVH file as in a mirror: what is left is right.
//!
//! With F the reflection along one axis of the file, a joint takes the offset F o and the rotation
//! F R F of its image on the other side: a rotation about the axis keeps its angle, one about
//! another axis turns the other way round. So, since it takes the channels of its image too, values
//! only change places and signs, in the text too, and the mirror image of the mirror image is the
//! file.

use super::read::motion_start;
use super::{Bvh, Joint};
use crate::Input;
use crate::pose::Channel;
use crate::pose::rotation::Axis;
use glam::{BVec3, DVec3};
use std::io::Cursor;
use std::ops::Range;

impl Bvh {
    /// The image of each joint: the joint of the other side by its name, where both hang on joints
    /// that are images and has as many ends; else itself.
    pub(crate) fn mirror_images(&self, by_name: &[usize]) -> Vec<usize> {
        let mut images = by_name.to_vec();
        loop {
            let fits = |i: usize| {
                let (own, other) = (&self.joints[i], &self.joints[images[i]]);
                let ends = |joint: &Joint| joint.ends.iter().map(|e| e.after).collect::<Vec<_>>();
                own.parent.map(|p| images[p]) == other.parent && ends(own) == ends(other)
            };
            let pairs = (0..images.len()).filter(|i| images[*i] != *i);
            let Some(wrong) = pairs.into_iter().find(|i| !fits(*i)) else {
                return images;
            };
            let other = images[wrong];
            (images[wrong], images[other]) = (wrong, other);
        }
    }

    /// The axis of the file along which the two sides are apart in the zero pose; not `up`.
    pub(crate) fn lateral_axis(&self, images: &[usize], up: Axis) -> Axis {
        let mut at: Vec<DVec3> = Vec::new();
        for joint in &self.joints {
            at.push(joint.parent.map_or(DVec3::ZERO, |p| at[p] + joint.offset));
        }
        let apart = |axis: Axis| -> f64 {
            let pairs = images.iter().enumerate();
            pairs
                .map(|(i, other)| (at[i] - at[*other])[axis.index()].abs())
                .sum()
        };
        let level = [Axis::X, Axis::Z, Axis::Y]
            .into_iter()
            .filter(|axis| *axis != up);
        // Of equals the first.
        level
            .reduce(|best, axis| {
                if apart(axis) > apart(best) {
                    axis
                } else {
                    best
                }
            })
            .unwrap_or(Axis::X)
    }

    /// The mirror image along an axis of the file; `images` are those of the joints. A joint has
    /// the channels of its image.
    fn mirrored(&self, images: &[usize], axis: Axis) -> Bvh {
        let mut out = self.clone();
        let flip = |v: DVec3| DVec3::select(mask(axis), -v, v);
        for (joint, image) in out.joints.iter_mut().zip(images) {
            let image = &self.joints[*image];
            joint.offset = flip(image.offset);
            joint.channels.clone_from(&image.channels);
            let ends = joint.ends.iter_mut().zip(&image.ends);
            ends.for_each(|(end, other)| end.offset = flip(other.offset));
        }
        for (to, (from, flips)) in self.mirrored_columns(images, axis).into_iter().enumerate() {
            let sign = if flips { -1.0 } else { 1.0 };
            let column = self.motion.column(from).mapv(|v| sign * v);
            out.motion.column_mut(to).assign(&column);
        }
        out
    }

    /// The column whose values each column of the mirror image has, and whether with another sign.
    fn mirrored_columns(&self, images: &[usize], axis: Axis) -> Vec<(usize, bool)> {
        let widths = self.joints.iter().map(|joint| joint.channels.len());
        let first = widths.scan(0, |sum, width| Some(std::mem::replace(sum, *sum + width)));
        let first: Vec<usize> = first.collect();
        let of_image = |image: &usize| {
            let channels = self.joints[*image].channels.iter().enumerate();
            let from = first[*image];
            channels.map(move |(k, channel)| (from + k, changes_sign(*channel, axis)))
        };
        images.iter().flat_map(of_image).collect()
    }

    /// The text of the mirror image, in which words of `original` only change places and numbers
    /// their signs; `None` where that is not all.
    fn mirrored_words(&self, original: &[u8], images: &[usize], axis: Axis) -> Option<Vec<u8>> {
        let columns = self.mirrored_columns(images, axis);
        let (head, body) = original.split_at(motion_start(original)?);
        let mut out = self.mirrored_head(head, images, axis)?;
        let words: Vec<&[u8]> = words(body).map(|word| &body[word]).collect();
        let (width, mut count) = (columns.len(), 0);
        for piece in body.chunk_by(|a, b| a.is_ascii_whitespace() == b.is_ascii_whitespace()) {
            if piece[0].is_ascii_whitespace() || count / width >= self.motion.nrows() {
                out.extend_from_slice(piece);
                continue;
            }
            let (from, flips) = columns[count % width];
            push_word(&mut out, words[count / width * width + from], flips);
            count += 1;
        }
        Some(out)
    }

    /// The text before the motion, with the OFFSET and the CHANNELS of each joint those of its
    /// image.
    fn mirrored_head(&self, head: &[u8], images: &[usize], axis: Axis) -> Option<Vec<u8>> {
        let words: Vec<Range<usize>> = words(head).collect();
        let is =
            |at: usize, word: &str| head[words[at].clone()].eq_ignore_ascii_case(word.as_bytes());
        let all = |word: &str| {
            (0..words.len())
                .filter(|at| is(*at, word))
                .collect::<Vec<_>>()
        };
        let (nodes, offsets, lists) = (self.nodes(), all("OFFSET"), all("CHANNELS"));
        if offsets.len() != nodes.len() || lists.len() != self.joints.len() {
            return None;
        }
        // What is replaced, by what, and whether it is a number that changes its sign.
        let mut replaced = Vec::new();
        for ((joint, end), own) in nodes.iter().zip(&offsets) {
            let image = nodes
                .iter()
                .position(|node| *node == (images[*joint], *end))?;
            for i in 0..3 {
                let [to, from] = [*own, offsets[image]].map(|at| words.get(at + 1 + i).cloned());
                replaced.push((to?, from?, i == axis.index()));
            }
        }
        for (joint, image) in images.iter().enumerate() {
            let list = |joint: usize| {
                let (first, count) = (lists[joint] + 1, self.joints[joint].channels.len());
                Some(words.get(first)?.start..words.get(first + count)?.end)
            };
            replaced.push((list(joint)?, list(*image)?, false));
        }
        replaced.sort_by_key(|(to, ..)| to.start);
        let (mut out, mut done) = (Vec::with_capacity(head.len()), 0);
        for (to, from, flips) in replaced {
            out.extend_from_slice(head.get(done..to.start)?);
            push_word(&mut out, &head[from], flips);
            done = to.end;
        }
        out.extend_from_slice(&head[done..]);
        Some(out)
    }

    /// The joints and their End Sites as they stand in a file.
    fn nodes(&self) -> Vec<(usize, Option<usize>)> {
        fn add(bvh: &Bvh, joint: usize, out: &mut Vec<(usize, Option<usize>)>) {
            out.push((joint, None));
            let children = (0..bvh.joints.len()).filter(|c| bvh.joints[*c].parent == Some(joint));
            let (mut ends, own) = (0, &bvh.joints[joint].ends);
            for (before, child) in children.map(Some).chain([None]).enumerate() {
                while ends < own.len() && (child.is_none() || own[ends].after <= before) {
                    out.push((joint, Some(ends)));
                    ends += 1;
                }
                if let Some(child) = child {
                    add(bvh, child, out);
                }
            }
        }
        let mut out = Vec::new();
        add(self, 0, &mut out);
        out
    }

    /// The bytes of the mirror image of the file `original`: its words in other places, with other
    /// signs, where that says it; else written anew, lengths in units of `unit` centimeters.
    pub(crate) fn mirrored_bytes(
        &self,
        original: &[u8],
        images: &[usize],
        axis: Axis,
        unit: f64,
    ) -> Vec<u8> {
        let wanted = self.mirrored(images, axis);
        let words = self.mirrored_words(original, images, axis);
        let is_it = |bytes: &Vec<u8>| {
            let input = Input::new("", Cursor::new(bytes.clone()));
            let read = input.and_then(|input| Bvh::read(input, unit, true));
            read.is_ok_and(|read| read.is_near(&wanted))
        };
        words.filter(is_it).unwrap_or_else(|| wanted.to_bytes(unit))
    }

    /// Whether two files are the same to their digits.
    fn is_near(&self, other: &Bvh) -> bool {
        let near = |a: f64, b: f64| a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-9;
        let joints = self.joints.iter().zip(&other.joints);
        self.joints.len() == other.joints.len()
            && self.motion.dim() == other.motion.dim()
            && self
                .motion
                .iter()
                .zip(&other.motion)
                .all(|(a, b)| near(*a, *b))
            && joints.into_iter().all(|(a, b)| {
                let ends = a.ends.iter().zip(&b.ends);
                a.name == b.name
                    && a.offset.abs_diff_eq(b.offset, 1e-9)
                    && ends
                        .into_iter()
                        .all(|(a, b)| a.offset.abs_diff_eq(b.offset, 1e-9))
            })
    }
}

/// The words of a text by their bytes.
fn words(text: &[u8]) -> impl Iterator<Item = Range<usize>> {
    let mut at = 0;
    let pieces = text.chunk_by(|a, b| a.is_ascii_whitespace() == b.is_ascii_whitespace());
    let ranges = pieces.map(move |piece| {
        at += piece.len();
        at - piece.len()..at
    });
    ranges.filter(|range| !text[range.start].is_ascii_whitespace())
}

/// The word of a number, with the other sign if it `flips`; zeros and words such as nan stay.
fn push_word(out: &mut Vec<u8>, word: &[u8], flips: bool) {
    let digits = word
        .strip_prefix(b"-")
        .or(word.strip_prefix(b"+"))
        .unwrap_or(word);
    let is_number = digits
        .first()
        .is_some_and(|b| b.is_ascii_digit() || *b == b'.');
    let mantissa = digits
        .split(|b| matches!(b, b'e' | b'E'))
        .next()
        .unwrap_or_default();
    let is_zero = mantissa.iter().all(|b| matches!(b, b'0' | b'.'));
    if !flips || !is_number || is_zero {
        out.extend_from_slice(word);
        return;
    }
    if !word.starts_with(b"-") {
        out.push(b'-');
    }
    out.extend_from_slice(digits);
}

/// Whether a value changes its sign in a mirror along an axis.
fn changes_sign(channel: Channel, axis: Axis) -> bool {
    match channel {
        Channel::Rotate(own) => own != axis,
        Channel::Translate(own) => own == axis,
        Channel::Length => false,
    }
}

fn mask(axis: Axis) -> BVec3 {
    let [x, y, z] = [Axis::X, Axis::Y, Axis::Z].map(|own| own == axis);
    BVec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{BvhPoints, BvhSkeleton};
    use crate::pose::poses::point_at;
    use crate::pose::sides::mirror_images;
    use glam::DMat3;

    /// A body with arms of two bones; the right arm's channels are `right`.
    fn file(right: &str) -> String {
        let arm = |side: &str, x: f64, channels: &str| {
            format!(
                "JOINT {side}Arm\n{{\nOFFSET {x:.4} 40.5 1\nCHANNELS {channels}\n\
                 JOINT {side}Hand\n{{\nOFFSET {x:.4} -20 0.25\nCHANNELS 1 Yrotation\n\
                 End Site\n{{\nOFFSET {x:.4} 0 -3\n}}\n}}\n}}\n"
            )
        };
        let left = "3 Zrotation Xrotation Yrotation";
        format!(
            "HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\n\
             CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\
             End Site\n{{\nOFFSET 1 2 3\n}}\n{}{}}}\nMOTION\nFrames: 2\nFrame Time: 0.01\n\
             1.50 90 -3.25 10 20 30 40 50 60 5 -70 80 10.0 -15\n\
             -2 91 0.000 +5 -6 7e1 8 9 10 0 1 2 3 4\n",
            arm("Left", 15.5, left),
            arm("Right", -17.0, right),
        )
    }

    /// A file and its mirror image, with the images of its joints.
    fn mirrored(text: &str) -> (Bvh, Bvh, Vec<u8>, Vec<usize>) {
        let bvh = Bvh::from_bytes("t.bvh", text.as_bytes().to_vec()).unwrap();
        let names: Vec<String> = bvh.joints.iter().map(|j| j.name.clone()).collect();
        let images = bvh.mirror_images(&mirror_images(&names));
        let axis = bvh.lateral_axis(&images, Axis::Y);
        assert_eq!(axis, Axis::X);
        let bytes = bvh.mirrored_bytes(text.as_bytes(), &images, axis, 1.0);
        let image = Bvh::from_bytes("t.bvh", bytes.clone()).unwrap();
        (bvh, image, bytes, images)
    }

    fn assert_is_image(bvh: &Bvh, image: &Bvh, images: &[usize], tolerance: f64) {
        let at = |bvh: &Bvh| {
            let skeleton = BvhSkeleton::new(&bvh.joints, DMat3::IDENTITY, true).unwrap();
            bvh.positions(&skeleton, BvhPoints::Origins, 100.0)
        };
        let (own, other) = (at(bvh), at(image));
        assert_eq!(own.points, other.points);
        let find = |name: &str| own.points.iter().position(|p| p == name).unwrap();
        for (j, joint) in bvh.joints.iter().enumerate() {
            for end in ["", "_end"] {
                let [from, to] = [images[j], j].map(|j| bvh.joints[j].name.clone() + end);
                if !own.points.contains(&to) {
                    continue;
                }
                for frame in 0..own.frames() {
                    let wanted = point_at(own.xyz.view(), frame, find(&from));
                    let wanted = wanted * DVec3::new(-1.0, 1.0, 1.0);
                    let far = (point_at(other.xyz.view(), frame, find(&to)) - wanted).length();
                    assert!(far < tolerance, "{} {frame}: {far}", joint.name);
                }
            }
        }
    }

    #[test]
    fn every_joint_is_where_the_mirror_shows_it() {
        let text = file("3 Zrotation Xrotation Yrotation");
        let (bvh, image, bytes, images) = mirrored(&text);
        assert_eq!(images, [0, 3, 4, 1, 2]);
        assert_is_image(&bvh, &image, &images, 1e-12);
        // Numbers only change places and signs.
        let said = String::from_utf8(bytes.clone()).unwrap();
        assert!(said.contains("OFFSET 17.0000 40.5 1\n"), "{said}");
        assert!(said.contains("-1.50 90 -3.25 -10 20 -30 70 80 "), "{said}");
        let (.., again, _) = mirrored(&said);
        assert_eq!(String::from_utf8(again).unwrap(), text.replace("+5", "5"));
    }

    #[test]
    fn sides_change_their_channels_too() {
        for right in [
            "3 Xrotation Yrotation Zrotation",
            "3 Yrotation Zrotation Xposition",
            "3 Xposition Yrotation Yposition",
        ] {
            let text = file(right);
            let (bvh, image, bytes, images) = mirrored(&text);
            assert_is_image(&bvh, &image, &images, 1e-12);
            assert_eq!(image.joints[1].channels, bvh.joints[3].channels);
            let (.., again, _) = mirrored(&String::from_utf8(bytes).unwrap());
            assert_eq!(String::from_utf8(again).unwrap(), text.replace("+5", "5"));
        }
        // Of other widths, as of joints that slide on one side alone.
        let (bvh, image, _, images) = mirrored(
            &file("2 Xrotation Zposition")
                .replace(" 5 -70 80 10.0 -15", " 5 -70 80 10.0")
                .replace(" 0 1 2 3 4", " 0 1 2 3"),
        );
        assert_is_image(&bvh, &image, &images, 1e-12);
    }

    #[test]
    fn sides_that_hang_elsewhere_are_none() {
        // The right hand hangs on the hips.
        let text = file("3 Zrotation Xrotation Yrotation");
        let moved = text.replace("JOINT RightHand", "JOINT Wing");
        let bvh = Bvh::from_bytes("t.bvh", moved.into_bytes()).unwrap();
        assert_eq!(bvh.mirror_images(&[0, 3, 2, 1, 4]), [0, 3, 2, 1, 4]);
        assert_eq!(bvh.mirror_images(&[0, 4, 2, 3, 1]), [0, 1, 2, 3, 4]);
        assert_eq!(bvh.mirror_images(&[0, 1, 4, 3, 2]), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn signs_are_of_numbers_alone() {
        let flipped = |word: &str| {
            let mut out = Vec::new();
            push_word(&mut out, word.as_bytes(), true);
            String::from_utf8(out).unwrap()
        };
        for (word, wanted) in [
            ("1.50", "-1.50"),
            ("-.5", ".5"),
            ("+2e-3", "-2e-3"),
            ("0.00", "0.00"),
            ("-0e5", "-0e5"),
            ("nan", "nan"),
            ("NaN", "NaN"),
        ] {
            assert_eq!(flipped(word), wanted);
        }
    }
}
