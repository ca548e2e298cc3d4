//! Names of motion formats that are no pose tables, by how they begin, so that one given for a table is told what it is.

/// What a file that begins so is, and what to do with it; `None` for what may be a table.
pub fn recognized(start: &[u8]) -> Option<&'static str> {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let is = |prefix: &str| {
        let text = text.trim_ascii_start();
        text.len() >= prefix.len() && text[..prefix.len()].eq_ignore_ascii_case(prefix.as_bytes())
    };
    Some(match start {
        // The first block of parameters and the key of all C3D files, then numbers, never text alone.
        [_, 0x50, ..] if start.iter().any(|b| *b < 9) => "is a C3D file: convert it with c3d2xyz",
        _ if is("HIERARCHY") => "is a BVH file: convert it with bvh2xyz",
        _ if is("#!OML:") || is(":FULLY") || is(":DEGREES") => {
            "is an AMC file: convert it with amc2xyz --asf SUBJECT.asf --fps F"
        }
        _ if is("# AST") || is("# ASF") || is(":version") => {
            "is an ASF skeleton: give it to amc2xyz --asf, together with an AMC take"
        }
        _ if is("PathFileT") => "is a TRC file: convert it with trc2xyz --up y",
        _ if is("Format Ve") => "is a Motive CSV file: convert it with csv2xyz --up y",
        _ if is("NO_OF_FRA") || is("FILE_VERS") => {
            "is a Qualisys TSV file: convert it with csv2xyz --units mm --up z"
        }
        _ => return None,
    })
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
    }
}
