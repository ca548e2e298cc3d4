//! Writing Acclaim skeletons (ASF).

use super::asf::Asf;
use crate::pose::rotation::{Axis, decompose};
use crate::pose::{Bone, Channel};
use std::fmt::Write;

/// Centimeters in an inch, the unit of a length of 1.
const INCH: f64 = 2.54;

impl Asf {
    /// The file's text: lengths in the skeleton's unit, angles in degrees. Limits are left out.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = String::from(":version 1.10\n:name posing\n:units\n  mass 1.0\n");
        // Writing to a string does not fail.
        let _ = writeln!(out, "  length {}\n  angle deg", INCH / self.unit);
        let bones = self.skeleton.bones();
        let _ = writeln!(
            out,
            ":root\n  order {}\n  axis XYZ\n  position 0 0 0\n  orientation 0 0 0\n:bonedata",
            channels(&bones[0]).to_uppercase()
        );
        for (n, bone) in bones.iter().enumerate().skip(1) {
            let length = bone.offset.length();
            let direction = bone.offset.try_normalize().unwrap_or(glam::DVec3::X);
            let back = [Axis::Z, Axis::Y, Axis::X];
            let [z, y, x] = decompose(&bone.axis, back, [0.0; 3]).map(f64::to_degrees);
            let _ = writeln!(
                out,
                "  begin\n    id {n}\n    name {}\n    direction {} {} {}\n    length {}\n    \
                 axis {x} {y} {z} XYZ",
                bone.name,
                direction.x,
                direction.y,
                direction.z,
                length / self.unit
            );
            if !bone.dofs.is_empty() {
                let _ = writeln!(out, "    dof {}", channels(bone));
            }
            out.push_str("  end\n");
        }
        out.push_str(":hierarchy\n  begin\n");
        for (n, bone) in bones.iter().enumerate() {
            let children = bones.iter().filter(|b| b.parent == Some(n));
            let names: Vec<&str> = children.map(|b| b.name.as_str()).collect();
            if !names.is_empty() {
                let _ = writeln!(out, "    {} {}", bone.name, names.join(" "));
            }
        }
        out.push_str("  end\n");
        out.into_bytes()
    }
}

/// The words of a bone's degrees of freedom.
fn channels(bone: &Bone) -> String {
    let word = |channel: Channel| match channel {
        Channel::Rotate(axis) => format!("r{}", letter(axis)),
        Channel::Translate(axis) => format!("t{}", letter(axis)),
        Channel::Length => "l".to_string(),
    };
    let words: Vec<String> = bone.dofs.iter().map(|d| word(d.channel)).collect();
    words.join(" ")
}

fn letter(axis: Axis) -> char {
    ['x', 'y', 'z'][axis.index()]
}

#[cfg(test)]
mod tests {
    use super::super::Input;
    use super::*;
    use std::io::Cursor;

    #[test]
    fn a_skeleton_comes_back() {
        let read = |bytes: Vec<u8>| Asf::read(Input::new("t", Cursor::new(bytes)).unwrap(), None);
        let text = include_bytes!("../../joints/src/solve/skeleton.asf").to_vec();
        let asf = read(text).unwrap();
        let again = read(asf.to_bytes()).unwrap();
        let both = asf.skeleton.bones().iter().zip(again.skeleton.bones());
        for (a, b) in both {
            assert_eq!((&a.name, a.parent, &a.dofs), (&b.name, b.parent, &b.dofs));
            assert!(a.offset.abs_diff_eq(b.offset, 1e-9), "{}", a.name);
            assert!(a.axis.abs_diff_eq(b.axis, 1e-9), "{}", a.name);
        }
        assert!((asf.unit - again.unit).abs() <= 1e-12);
    }
}
