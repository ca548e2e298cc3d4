//! Files that no command reads: what each is, known by its first bytes, and the way that exists.

/// The bytes that tell one: what follows a `<`, a `{` or an archive's first name.
pub(crate) const BYTES: usize = 1 << 12;

const BLENDER: &str = "open it in Blender and export BVH, which bvh2xyz reads";
const UNPACK: &str = "unpack it first";
const NO_MOTION: &str = "expected motion";

/// A beginning, what a file is that has it, and what to do.
type Beginning = (&'static [u8], &'static str, &'static str);

const BEGINNINGS: &[Beginning] = &[
    (b"glTF", "a binary glTF file (GLB)", BLENDER),
    (b"BLENDER", "a Blender file", BLENDER),
    (b"PXR-USDC", "a USD file", BLENDER),
    (b"#usda", "a USD file", BLENDER),
    (b"Ogawa", "an Alembic file", BLENDER),
    (
        b"//Maya ASCII",
        "a Maya scene",
        "export BVH or FBX from Maya",
    ),
    (b"FOR4", "a Maya scene", "export BVH or FBX from Maya"),
    (b"FOR8", "a Maya scene", "export BVH or FBX from Maya"),
    (
        b"\x89HDF\r\n\x1a\n",
        "an HDF5 file",
        "save its positions as CSV (pandas.read_hdf(FILE).to_csv(TABLE)), which csv2xyz reads",
    ),
    (b"MATLAB 5.0 M", "a MATLAB file (.mat)", MATLAB),
    (b"MATLAB 7.3 M", "a MATLAB file (.mat, HDF5)", MATLAB),
    (
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
        "a compound file, as old Excel workbooks (.xls) and takes of some capture programs are",
        "save it as CSV, or export C3D from the program that wrote it",
    ),
    (
        b"[Header]",
        "an HTR file",
        "export BVH or C3D from the program that wrote it",
    ),
    (
        b"version https://git-lfs",
        "a pointer of Git LFS, not the file itself",
        "fetch it with git lfs pull",
    ),
    (b"PAR1", "a Parquet file", TABLE),
    (b"ARROW1", "an Arrow file", TABLE),
    (b"SQLite format", "an SQLite database", TABLE),
    (b"RDX2\n", "an R data file", TABLE),
    (b"RDX3\n", "an R data file", TABLE),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"%PDF", "a PDF document", NO_MOTION),
    (b"\x89PNG", "a PNG image", NO_MOTION),
    (b"\xff\xd8\xff", "a JPEG image", NO_MOTION),
    (b"GIF8", "a GIF image", NO_MOTION),
    (b"RIFF", "a video or sound file", NO_MOTION),
    (b"\xff\xfe\0\0", "UTF-32 text", UTF32),
    (b"\0\0\xfe\xff", "UTF-32 text", UTF32),
];

const MATLAB: &str =
    "save its positions as CSV (writetable) or as NPY (scipy.io.loadmat, numpy.save)";
const TABLE: &str = "save its positions as CSV, which csv2xyz reads";
const UTF32: &str = "save it as UTF-8 (iconv -f utf-32 -t utf-8)";
const PICKLE: &str = "save its positions with numpy.save as NPY";

/// Words that an XML file of a kind has near its beginning.
const XML: &[Beginning] = &[
    (
        b"<mvnx",
        "an MVNX file of Xsens",
        "export C3D or BVH from Xsens MVN, which c3d2xyz and bvh2xyz read",
    ),
    (b"<COLLADA", "a COLLADA file", BLENDER),
    (
        b"<OpenSimDocument",
        "an OpenSim document: a model or settings",
        "its motion is in .mot, .sto and .trc files, which csv2xyz and trc2xyz read",
    ),
    (
        b"<KinematicModel",
        "a Vicon subject (VSK)",
        "its motion is in C3D files",
    ),
    (
        b"<html",
        "a web page",
        "perhaps a download gave it instead of the file",
    ),
    (
        b"<!doctype html",
        "a web page",
        "perhaps a download gave it instead of the file",
    ),
    (b"<", "an XML file", NO_MOTION),
];

/// Names that an archive of a kind has first.
const ZIPPED: &[Beginning] = &[
    (
        b"[Content_Types].xml",
        "an Excel workbook or another Office file",
        "save it as CSV",
    ),
    (
        b"_rels/",
        "an Excel workbook or another Office file",
        "save it as CSV",
    ),
    (
        b"docProps/",
        "an Excel workbook or another Office file",
        "save it as CSV",
    ),
    (b"xl/", "an Excel workbook", "save it as CSV"),
    (b"mimetype", "an OpenDocument file", "save it as CSV"),
];

/// Whether more than the first bytes tell what a file is that begins so.
pub(crate) fn needs_more(start: &[u8]) -> bool {
    let text = text_of(start);
    text.starts_with(b"<") || text.starts_with(b"{") || text.starts_with(b"PK\x03\x04")
}

/// What a file is that begins so (12 bytes, or [`BYTES`] where it [needs more](needs_more)), and
/// what to do with it; `None` for one that a command may read.
pub(crate) fn foreign(start: &[u8]) -> Option<String> {
    let text = text_of(start);
    let begins = |(beginning, ..): &&Beginning| starts(text, beginning);
    let of = |(_, what, way): &Beginning| format!("is {what}: {way}");
    if let Some(found) = BEGINNINGS.iter().find(begins) {
        return Some(of(found));
    }
    if text.starts_with(b"<") {
        let has = |(word, ..): &&Beginning| has_word(text, word);
        return XML.iter().find(has).map(of);
    }
    if text.starts_with(b"{") && has_word(text, b"\"asset\"") && has_word(text, b"\"version\"") {
        return Some(format!("is a glTF file: {BLENDER}"));
    }
    if let Some(name) = zipped_name(text) {
        let is = |(first, ..): &&Beginning| name.starts_with(first);
        let torch = || {
            let name = name.split(|b| *b == b'/').nth(1);
            let is_torch = name.is_some_and(|n| n.starts_with(b"data.pkl"));
            is_torch.then(|| format!("is a PyTorch file: {PICKLE}"))
        };
        return ZIPPED.iter().find(is).map(of).or_else(torch);
    }
    match start {
        // Protocols 2 to 5, whose first instruction is a frame or an opcode of text.
        [0x80, 2..=5, ..] => Some(format!("is a Python pickle, which may run code: {PICKLE}")),
        [_, _, _, _, b'f', b't', b'y', b'p', ..] => Some(format!("is a video: {NO_MOTION}")),
        _ => None,
    }
}

/// The start without a byte order mark of UTF-8 and blanks.
fn text_of(start: &[u8]) -> &[u8] {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    start.trim_ascii_start()
}

/// Whether a file begins so: its first bytes may be fewer than the beginning.
fn starts(start: &[u8], beginning: &[u8]) -> bool {
    let known = beginning.len().min(12);
    start.len() >= known && start.starts_with(&beginning[..known])
}

fn has_word(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len())
        .any(|w| w.eq_ignore_ascii_case(word))
}

/// The name of the first file of a ZIP archive.
fn zipped_name(start: &[u8]) -> Option<&[u8]> {
    let after = start.strip_prefix(b"PK\x03\x04")?.get(22..)?;
    let length = usize::from(u16::from_le_bytes([*after.first()?, *after.get(1)?]));
    let name = after.get(4..)?;
    name.get(..length.min(name.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_other_programs_are_named_with_a_way() {
        for (start, what, way) in [
            (&b"glTF\x02\0\0\0P\0\0\0"[..], "GLB", "Blender"),
            (b"{\"asset\": {\"version\": \"2.0\"}", "glTF", "Blender"),
            (b"\x89HDF\r\n\x1a\n\0\0\0\0", "HDF5", "CSV"),
            (b"MATLAB 5.0 M", "MATLAB", "NPY"),
            (
                b"<?xml version=\"1.0\"?>\n<mvnx version=\"4\">",
                "MVNX",
                "C3D",
            ),
            (b"\xef\xbb\xbf<mvnx>", "MVNX", "C3D"),
            (b"<!DOCTYPE html><html>", "web page", "download"),
            (b"\x80\x04\x95abc", "pickle", "numpy.save"),
            (b"\xff\xfe\0\0P\0\0\0a\0\0\0", "UTF-32", "utf-32"),
            (b"\0\0\xfe\xff\0\0\0P\0\0\0a", "UTF-32", "utf-32"),
            (b"\0\0\0\x20ftypisom", "video", "motion"),
            (
                b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x13\0\0\0\
                [Content_Types].xml",
                "Excel",
                "CSV",
            ),
        ] {
            let said = foreign(start).unwrap_or_default();
            assert!(
                said.contains(what) && said.contains(way),
                "{start:?}: {said}"
            );
            assert!(what == "UTF-32" || !said.contains("iconv"), "{said}");
        }
    }

    #[test]
    fn what_a_command_may_read_is_not_foreign() {
        for start in [
            &b"\x02\x50\x2c\0\0\0\0\0\0\0\0\0"[..],
            b"HIERARCHY\nRO",
            b"Kaydara FBX ",
            b"; FBX 7.3.0 project",
            b"\x93NUMPY\x01\0v\0{'",
            b"take,time,a.",
            b"{\"skeleton\": 1}",
            b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x08\0\0\0meta.npy",
            b"ply\nformat bi",
            // UTF-16, which is read.
            b"\xff\xfeP\0a\0t\0h\0",
            b"solid x\n",
            b"",
            b"P",
            b"PK\x03\x04",
        ] {
            assert_eq!(foreign(start), None, "{start:?}");
        }
    }
}
