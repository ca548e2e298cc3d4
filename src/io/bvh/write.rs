//! The writer of BVH files.

use super::Bvh;
use crate::pose::Channel;
use glam::DVec3;
use std::io::Write;

/// Digits after the point of angles, offsets and positions: a millionth of a degree moves the end of a limb of a metre
/// by 2e-6 cm.
const DECIMALS: usize = 6;

impl Bvh {
    /// The file's text: lengths in units of `unit` centimetres, angles in degrees.
    pub fn to_bytes(&self, unit: f64) -> Vec<u8> {
        let mut out = b"HIERARCHY\n".to_vec();
        let mut depths: Vec<usize> = Vec::with_capacity(self.joints.len());
        let mut open = 0;
        for joint in &self.joints {
            let depth = joint.parent.map_or(0, |p| depths[p] + 1);
            while open > depth {
                open -= 1;
                put(&mut out, open, "}");
            }
            let keyword = if joint.parent.is_none() {
                "ROOT"
            } else {
                "JOINT"
            };
            put(&mut out, depth, &format!("{keyword} {}", joint.name));
            put(&mut out, depth, "{");
            put(&mut out, depth + 1, &offset(joint.offset / unit));
            let names: Vec<String> = joint.channels.iter().map(|c| channel_name(*c)).collect();
            let line = format!("CHANNELS {} {}", names.len(), names.join(" "));
            put(&mut out, depth + 1, line.trim_end());
            for &end in &joint.ends {
                put(&mut out, depth + 1, "End Site");
                put(&mut out, depth + 1, "{");
                put(&mut out, depth + 2, &offset(end / unit));
                put(&mut out, depth + 1, "}");
            }
            depths.push(depth);
            open = depth + 1;
        }
        while open > 0 {
            open -= 1;
            put(&mut out, open, "}");
        }
        let kinds: Vec<bool> = self
            .joints
            .iter()
            .flat_map(|j| &j.channels)
            .map(|c| c.is_angle())
            .collect();
        // Writing to memory cannot fail.
        let _ = write!(
            out,
            "MOTION\nFrames: {}\nFrame Time: {:.10}\n",
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
        out
    }
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
