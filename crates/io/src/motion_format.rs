//! The formats of motion files, known by how a file begins, never by its name.

use super::text_start::{TextStart, is_binary, of_lines};
use serde::{Deserialize, Serialize};

/// What kind of file of motion it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionFormat {
    /// C3D: markers, binary.
    C3d,
    /// TRC: markers, text.
    Trc,
    /// Motive's CSV: markers.
    MotiveCsv,
    /// Qualisys' TSV: markers.
    QualisysTsv,
    /// Vicon's CSV: markers of Nexus, perhaps with devices and model outputs, or Tracker's objects.
    NexusCsv,
    /// A table of points of another program: NAME_x, NAME_y, NAME_z, or names above x, y, z.
    PointTable,
    /// A row for each point in each frame, as CSV. It is read, and written as a pose table.
    LongTable,
    /// JSON of OpenPose's or MediaPipe's keypoints. It is read, and written as CSV.
    Keypoints,
    /// OpenSim's .mot and .sto: columns over time.
    OpenSim,
    /// BVH: a skeleton and its rotations.
    Bvh,
    /// AMC: rotations of a skeleton that an ASF file has.
    Amc,
    /// ASF: a skeleton without motion.
    Asf,
    /// FBX: a scene with skeletons and their takes. It is read, and written as BVH.
    Fbx,
    /// A pose table as CSV, or what may be one.
    Csv,
    /// A pose table as NPY.
    Npy,
    /// An archive of arrays, NPZ: AMASS' markers, or positions of joints.
    Npz,
}

names!(MotionFormat {
    C3d = "C3D",
    Trc = "TRC",
    MotiveCsv = "Motive CSV",
    QualisysTsv = "Qualisys TSV",
    NexusCsv = "Vicon CSV",
    PointTable = "points CSV",
    LongTable = "long CSV",
    Keypoints = "keypoints JSON",
    OpenSim = "OpenSim",
    Bvh = "BVH",
    Amc = "AMC",
    Asf = "ASF",
    Fbx = "FBX",
    Csv = "CSV",
    Npy = "NPY",
    Npz = "NPZ",
});

impl MotionFormat {
    /// Whether a file of it has the rotations of joints.
    #[doc(hidden)]
    pub fn has_rotations(self) -> bool {
        matches!(
            self,
            MotionFormat::Bvh | MotionFormat::Fbx | MotionFormat::Amc
        )
    }

    /// Whether a file of it, as it is written, is no text.
    #[doc(hidden)]
    pub fn is_binary(self) -> bool {
        matches!(
            self,
            MotionFormat::C3d | MotionFormat::Npy | MotionFormat::Npz
        )
    }

    /// Whether a file of it is a pose table.
    #[doc(hidden)]
    pub fn is_pose_table(self) -> bool {
        matches!(
            self,
            MotionFormat::Csv | MotionFormat::Npy | MotionFormat::Npz
        )
    }

    /// The format of a file that begins so; what is nothing else may be a pose table.
    ///
    /// ```
    /// use posing_io::MotionFormat;
    ///
    /// assert_eq!(MotionFormat::of(b"HIERARCHY\nROOT Hips\n"), MotionFormat::Bvh);
    /// assert_eq!(MotionFormat::of(b"hand.x,hand.y,hand.z\n"), MotionFormat::Csv);
    /// ```
    pub fn of(start: &[u8]) -> MotionFormat {
        let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
        let is = |prefix: &str| {
            let text = text.trim_ascii_start();
            text.len() >= prefix.len()
                && text[..prefix.len()].eq_ignore_ascii_case(prefix.as_bytes())
        };
        match start {
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => MotionFormat::Npy,
            [b'P', b'K', 3, 4, ..] | [b'P', b'K', 5, 6, ..] => MotionFormat::Npz,
            _ if is_c3d(start) => MotionFormat::C3d,
            _ if is("Kaydara FBX") || is("; FBX") => MotionFormat::Fbx,
            _ if is("HIERARCHY") => MotionFormat::Bvh,
            _ if is("#!OML:") || is(":FULLY") || is(":DEGREES") => MotionFormat::Amc,
            _ if is("# AST") || is("# ASF") || is(":version") => MotionFormat::Asf,
            _ if is("PathFileT") => MotionFormat::Trc,
            _ if is("Format Ve") => MotionFormat::MotiveCsv,
            _ if is_json(text) => MotionFormat::Keypoints,
            _ if is("NO_OF_FRA") || is("FILE_VERS") => MotionFormat::QualisysTsv,
            _ => match of_lines(text) {
                Some(TextStart::OpenSim) => MotionFormat::OpenSim,
                Some(TextStart::Nexus) => MotionFormat::NexusCsv,
                Some(TextStart::Long) => MotionFormat::LongTable,
                Some(TextStart::Points) => MotionFormat::PointTable,
                Some(TextStart::PoseTable) | None => MotionFormat::Csv,
            },
        }
    }
}

/// What a file that begins so is instead of a pose table, and what to do with it; `None` for what
/// may be a table. The first lines of text tell more than its first bytes
/// ([`look_ahead`](super::Input::look_ahead)).
pub fn recognized(start: &[u8]) -> Option<&'static str> {
    Some(match MotionFormat::of(start) {
        MotionFormat::C3d => "is a C3D file: convert it with c3d2xyz",
        MotionFormat::Bvh => {
            "is a BVH file: clean it with `posing clean`, which keeps its rotations, or convert it \
             with bvh2xyz"
        }
        MotionFormat::Fbx => {
            "is an FBX file: convert it with fbx2xyz or fbx2bvh, or clean it with `posing clean`, \
             which writes BVH"
        }
        MotionFormat::Amc => {
            "is an AMC file: clean it with `posing clean`, which keeps its rotations, or convert \
             it with amc2xyz; both with the option `asf SUBJECT.asf` and the option `fps F`"
        }
        MotionFormat::Asf => {
            "is an ASF skeleton: give it to amc2xyz with the option `asf`, together with an AMC \
             take"
        }
        MotionFormat::Trc => "is a TRC file: convert it with trc2xyz, with the option `up y`",
        MotionFormat::MotiveCsv => {
            "is a Motive CSV file: convert it with csv2xyz, with the option `up y`"
        }
        MotionFormat::QualisysTsv => {
            "is a Qualisys TSV file: convert it with csv2xyz, with the option `units mm` and the \
             option `up z`"
        }
        MotionFormat::NexusCsv => {
            "is a Vicon CSV file: convert it with csv2xyz, with the option `up z`"
        }
        MotionFormat::PointTable | MotionFormat::LongTable => {
            "is a table of points of another program: convert it with csv2xyz, with the option \
             `units`, the option `up` and the option `fps`"
        }
        MotionFormat::OpenSim => {
            "is an OpenSim file (.mot, .sto), which holds columns and no points: csv2xyz makes a \
             table of them"
        }
        MotionFormat::Keypoints => {
            "is a JSON file: csv2xyz converts keypoints of OpenPose or MediaPipe, with the option \
             `fps`; save other positions as CSV"
        }
        MotionFormat::Csv if is_binary(start) => {
            "is a binary file of no format that is read (the second byte of a C3D file is 0x50): \
             export C3D, TRC, BVH or CSV from the program that wrote it (Motive's .tak, Vicon's \
             .x2d, Xsens' .mvn and Qualisys' .qtm are theirs alone)"
        }
        MotionFormat::Csv | MotionFormat::Npy | MotionFormat::Npz => return None,
    })
}

/// Whether a file that begins so is a C3D file: the second byte is the key of all, and what stands
/// around it are numbers, never text alone.
pub(crate) fn is_c3d(start: &[u8]) -> bool {
    matches!(start, [_, 0x50, ..]) && is_binary(&start[..start.len().min(12)])
}

/// Whether a text that begins so is JSON, a list or an object: no title of a table is one.
fn is_json(text: &[u8]) -> bool {
    let mut letters = text.iter().copied().filter(|b| !b.is_ascii_whitespace());
    match (letters.next(), letters.next()) {
        (Some(b'{'), Some(b'"' | b'}')) => true,
        (Some(b'['), Some(next)) => b"[]{\"-n".contains(&next) || next.is_ascii_digit(),
        _ => false,
    }
}

/// Whether these first bytes tell the format: no later ones would change it.
pub(crate) fn is_told(start: &[u8]) -> bool {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    match MotionFormat::of(start) {
        MotionFormat::Csv => is_binary(start) || of_lines(text) == Some(TextStart::PoseTable),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_told_by_their_beginnings() {
        for (start, word) in [
            (&b"\x02\x50\x2c\x00\x00\x00"[..], "c3d2xyz"),
            (b"HIERARCHY\nROOT", "bvh2xyz"),
            (b"\r\nhierarchy\r\n", "bvh2xyz"),
            (b"#!OML:ASF F:\\VIC", "amc2xyz"),
            (b"# AST/ASF file g", "ASF"),
            (b"PathFileType\t4\t(", "trc2xyz"),
            (b"\xef\xbb\xbfPathFileType\t4\t(", "trc2xyz"),
            (
                b"\xef\xbb\xbfFormat Version,1",
                "Motive CSV file: convert it with csv2xyz",
            ),
            (
                b"NO_OF_FRAMES\t200",
                "Qualisys TSV file: convert it with csv2xyz",
            ),
            (b"FILE_VERSION\t2.0.0", "csv2xyz"),
        ] {
            let start = &start[..start.len().min(12)];
            let said = recognized(start).unwrap_or_default();
            assert!(said.contains(word), "{start:?}: {said}");
        }
        for table in [
            &b"time,root.x,root"[..],
            b"# a comment\n",
            b"\x93NUMPY",
            b"",
            b"aP.x,",
        ] {
            assert!(recognized(table).is_none(), "{table:?}");
        }
        assert_eq!(MotionFormat::of(b"\x93NUMPY\x01"), MotionFormat::Npy);
        let late = b"\r\n \r\n\r\n\r\npathfiletype\t4";
        assert_eq!(MotionFormat::of(late), MotionFormat::Trc);
        assert_eq!(MotionFormat::of(b"\n"), MotionFormat::Csv);
    }
}
