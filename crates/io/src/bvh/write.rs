//! The writer of BVH files.

use super::Bvh;
use super::read::hierarchy_end;
use crate::pose::Channel;
use crate::{Error, Place, Result};
use glam::DVec3;
use std::io::Write;

/// Digits after the point of angles, offsets and positions: a millionth of a degree moves the end
/// of a limb of a meter by 2e-6 cm.
const DECIMALS: usize = 6;

impl Bvh {
    /// The file's text: lengths in units of `unit` centimeters, angles in degrees.
    pub fn to_bytes(&self, unit: f64) -> Vec<u8> {
        let mut out = b"HIERARCHY\n".to_vec();
        self.put_hierarchy(&mut out, unit);
        out.extend_from_slice(b"MOTION\n");
        self.put_motion(&mut out, unit);
        out
    }

    /// The text of `original`, which has the joints, to the end of its hierarchy, byte for byte;
    /// then the motion, as [`Bvh::to_bytes`] has it.
    ///
    /// # Errors
    /// [`Error::Data`]: `original` is no BVH file.
    pub fn with_hierarchy_of(&self, original: &[u8], unit: f64) -> Result<Vec<u8>> {
        let other = || Error::data(Place::file("the rig"), "is no BVH file");
        let end = hierarchy_end(original).ok_or_else(other)?;
        let mut out = original[..end].to_vec();
        out.push(b'\n');
        self.put_motion(&mut out, unit);
        Ok(out)
    }

    /// The count of frames, the Frame Time and the frames.
    fn put_motion(&self, out: &mut Vec<u8>, unit: f64) {
        let kinds: Vec<bool> = self
            .joints
            .iter()
            .flat_map(|j| &j.channels)
            .map(|c| c.is_angle())
            .collect();
        // Writing to memory cannot fail.
        let _ = write!(
            out,
            "Frames: {}\nFrame Time: {:.10}\n",
            self.motion.nrows(),
            self.frame_time
        );
        for row in self.motion.rows() {
            for (i, (&value, &angle)) in row.iter().zip(&kinds).enumerate() {
                if i > 0 {
                    out.push(b' ');
                }
                let value = if angle {
                    value.to_degrees()
                } else {
                    value / unit
                };
                let _ = write!(out, "{:.DECIMALS$}", tidy(value));
            }
            out.push(b'\n');
        }
    }
}

impl Bvh {
    /// The joints, each with its End Sites where they stood among its children.
    fn put_hierarchy(&self, out: &mut Vec<u8>, unit: f64) {
        // The joints whose braces are open, and how many children and End Sites of each are
        // written.
        let mut open: Vec<(usize, usize, usize)> = Vec::new();
        for (j, joint) in self.joints.iter().enumerate() {
            while let Some(&(above, ..)) = open.last().filter(|o| Some(o.0) != joint.parent) {
                self.close(out, unit, above, &mut open);
            }
            let depth = open.len();
            if let Some((above, children, ends)) = open.last_mut() {
                let due = self.joints[*above].ends[*ends..].iter();
                let due = due.take_while(|end| end.after <= *children).count();
                for end in &self.joints[*above].ends[*ends..*ends + due] {
                    put_end_site(out, depth, end.offset / unit);
                }
                (*children, *ends) = (*children + 1, *ends + due);
            }
            let keyword = if joint.parent.is_none() {
                "ROOT"
            } else {
                "JOINT"
            };
            put(out, depth, &format!("{keyword} {}", joint.name));
            put(out, depth, "{");
            put(out, depth + 1, &offset(joint.offset / unit));
            let names: Vec<String> = joint.channels.iter().map(|c| channel_name(*c)).collect();
            let line = format!("CHANNELS {} {}", names.len(), names.join(" "));
            put(out, depth + 1, line.trim_end());
            open.push((j, 0, 0));
        }
        while let Some(&(above, ..)) = open.last() {
            self.close(out, unit, above, &mut open);
        }
    }

    /// Closes the last joint that is open, after its other End Sites.
    fn close(
        &self,
        out: &mut Vec<u8>,
        unit: f64,
        joint: usize,
        open: &mut Vec<(usize, usize, usize)>,
    ) {
        let written = open.pop().map_or(0, |o| o.2);
        let depth = open.len();
        for end in &self.joints[joint].ends[written..] {
            put_end_site(out, depth + 1, end.offset / unit);
        }
        put(out, depth, "}");
    }
}

fn put_end_site(out: &mut Vec<u8>, depth: usize, end: DVec3) {
    put(out, depth, "End Site");
    put(out, depth, "{");
    put(out, depth + 1, &offset(end));
    put(out, depth, "}");
}

/// A line at a depth.
fn put(out: &mut Vec<u8>, depth: usize, text: &str) {
    // Deep hierarchies would make files that grow with the square of their depth.
    out.resize(out.len() + depth.min(64), b'\t');
    out.extend_from_slice(text.as_bytes());
    out.push(b'\n');
}

fn offset(v: DVec3) -> String {
    let [x, y, z] = v.to_array().map(tidy);
    format!("OFFSET {x:.DECIMALS$} {y:.DECIMALS$} {z:.DECIMALS$}")
}

/// Zero for what would be written as a negative zero.
fn tidy(value: f64) -> f64 {
    if value.abs() < 0.5e-6 { 0.0 } else { value }
}

fn channel_name(channel: Channel) -> String {
    match channel {
        Channel::Translate(axis) => format!("{axis:?}position"),
        Channel::Rotate(axis) => format!("{axis:?}rotation"),
        // No reader knows it, and none of ours makes it.
        Channel::Length => "Length".into(),
    }
}
