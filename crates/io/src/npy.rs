//! NumPy's array files as pose tables: (frames, 3 x points) or (frames, points, 3), `<f4` or `<f8`,
//! C or Fortran order; NaN is missing. Read without seeking, so standard input works.

use super::Input;
use super::columns::Columns;
use super::row::{Row, TableOptions};
use super::text::{MAX_COORDINATE, check_length, excerpt};
use crate::{Error, Place, Result};
use ndarray::ArrayView2;
use std::io::{BufRead, BufReader, Read};

/// Values of a Fortran-order array that are decoded at a time.
const PIECE: usize = 1 << 16;

/// The number of bytes read at a time.
const BLOCK: usize = 1 << 18;

/// Reads the frames of an array one at a time.
pub struct NpyReader {
    /// The name that messages use.
    pub name: String,
    /// What the columns mean.
    pub columns: Columns,
    reader: BufReader<Box<dyn BufRead>>,
    wide: bool,
    frames: u64,
    next: u64,
    /// The frames of a Fortran-order array, transposed after reading it whole.
    whole: Option<Vec<f64>>,
    bytes: Vec<u8>,
}

/// What a header says.
pub(super) struct Header {
    pub(super) descr: String,
    pub(super) fortran: bool,
    pub(super) shape: Vec<u64>,
}

impl Header {
    /// Whether the floats are f64; an error when they are not floats.
    pub(super) fn wide(&self) -> Result<bool> {
        match self.descr.as_str() {
            "<f8" => Ok(true),
            "<f4" => Ok(false),
            "|O" => Err(
                "holds a Python object (a pickle), which may run code: save its positions alone \
                 with numpy.save"
                    .into(),
            ),
            other => {
                Err(format!("has values of type {}, expected <f4 or <f8", excerpt(other)).into())
            }
        }
    }
}

impl NpyReader {
    /// Reads the header; an array in Fortran order is read whole.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: no array of `<f4` or `<f8`, or not three
    /// columns per point.
    pub(crate) fn new(input: Input, options: &TableOptions) -> Result<NpyReader> {
        let name = input.name.clone();
        let place = Place::file(&name);
        let mut reader = BufReader::with_capacity(BLOCK, input.into_reader());
        let header = read_header(&mut reader, &place)?;
        let fail = |what: String| Err(Error::data(place.clone(), what));
        let wide = header.wide().map_err(|e| e.at(place.clone()))?;
        let (frames, width) = match header.shape[..] {
            [_, 263] => {
                return fail(
                    "holds features of HumanML3D (263 a frame), expected positions: those are in \
                     new_joints"
                        .into(),
                );
            }
            [frames, width] => (frames, width),
            [frames, points, 3] | [1, frames, points, 3] => (frames, points.saturating_mul(3)),
            _ => {
                return fail(format!(
                    "has the shape {:?}, expected (frames, 3 x points) or (frames, points, 3)",
                    header.shape
                ));
            }
        };
        if width == 0 || width % 3 != 0 || width > 3_000_000 {
            return fail(format!("has {width} columns, expected three per point"));
        }
        let columns = Columns::for_array(width as usize, options.joints.as_deref(), &place)?;
        let mut out = NpyReader {
            name,
            columns,
            reader,
            wide,
            frames,
            next: 0,
            whole: None,
            bytes: Vec::new(),
        };
        if header.fortran {
            // A first axis of one changes nothing of the order.
            let shape = header.shape.strip_prefix(&[1]).filter(|s| s.len() == 3);
            out.whole = Some(out.read_fortran(shape.unwrap_or(&header.shape))?);
        }
        Ok(out)
    }

    /// Reads the next frame; `false` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: the array ends early or late, or a value is
    /// infinite or too large.
    pub(crate) fn read(&mut self, row: &mut Row) -> Result<bool> {
        let width = self.columns.width();
        *row = Row {
            xyz: std::mem::take(&mut row.xyz),
            ..Row::default()
        };
        row.xyz.clear();
        if self.next == self.frames {
            // Bytes behind the array would be lost: that is no array file.
            let rest = self
                .reader
                .fill_buf()
                .map_err(|e| Error::io(&self.name, e))?;
            if !rest.is_empty() {
                return Err(self.fail("has more bytes than its header says"));
            }
            return Ok(false);
        }
        match &self.whole {
            Some(all) => {
                let at = self.next as usize * width;
                row.xyz.extend_from_slice(&all[at..at + width]);
            }
            None => {
                let need = width * if self.wide { 8 } else { 4 };
                if let Some(frame) = self.reader.buffer().get(..need) {
                    decode(frame, self.wide, &mut row.xyz);
                    self.reader.consume(need);
                } else {
                    self.bytes.resize(need, 0);
                    let done = self.reader.read_exact(&mut self.bytes);
                    done.map_err(|e| self.short_read(e))?;
                    decode(&self.bytes, self.wide, &mut row.xyz);
                }
            }
        }
        self.next += 1;
        // Without an early end, for the compiler to compare several at once; NaN is not beyond
        // anything.
        let beyond = |any: bool, v: &f64| any | (v.abs() > MAX_COORDINATE);
        if row.xyz.iter().fold(false, beyond) {
            return Err(self.beyond(&row.xyz));
        }
        Ok(true)
    }

    /// What is wrong with the frame read last.
    fn beyond(&self, xyz: &[f64]) -> Error {
        let bad = xyz
            .iter()
            .position(|v| v.abs() > MAX_COORDINATE)
            .unwrap_or(0);
        let what = match xyz[bad] {
            v if v.is_infinite() => "the value is infinite".to_string(),
            v => check_length(v).map_or_else(|e| e.to_string(), |_| String::new()),
        };
        self.fail(&format!("frame {}, column {bad}: {what}", self.next - 1))
    }

    fn read_fortran(&mut self, shape: &[u64]) -> Result<Vec<f64>> {
        // Read in pieces: a header that lies about its size must not take memory before the bytes
        // are there.
        let size = if self.wide { 8 } else { 4 };
        let count = self.frames.saturating_mul(self.columns.width() as u64);
        let mut bytes = Vec::new();
        let limit = count.saturating_mul(size);
        self.reader
            .by_ref()
            .take(limit)
            .read_to_end(&mut bytes)
            .map_err(|e| Error::io(&self.name, e))?;
        if (bytes.len() as u64) < limit {
            return Err(self.fail("ends before its last frame"));
        }
        let (frames, points) = (self.frames as usize, shape[1] as usize);
        let width = self.columns.width();
        let mut out = vec![0.0; count as usize];
        let mut values = Vec::new();
        for (piece, bytes) in bytes.chunks(PIECE * size as usize).enumerate() {
            values.clear();
            decode(bytes, self.wide, &mut values);
            for (k, v) in values.iter().enumerate() {
                let i = piece * PIECE + k;
                let (frame, column) = (i % frames, i / frames);
                // In a (frames, points, 3) array the points run before the axes.
                let column = if shape.len() == 3 {
                    3 * (column % points) + column / points
                } else {
                    column
                };
                out[frame * width + column] = *v;
            }
        }
        Ok(out)
    }

    fn fail(&self, what: &str) -> Error {
        Error::data(Place::file(&self.name), what)
    }

    fn short_read(&self, e: std::io::Error) -> Error {
        if e.kind() == std::io::ErrorKind::UnexpectedEof {
            return self.fail(&format!(
                "ends before its last frame: has {} of {}",
                self.next, self.frames
            ));
        }
        Error::io(&self.name, e)
    }
}

fn decode(bytes: &[u8], wide: bool, out: &mut Vec<f64>) {
    if wide {
        let values = bytes.as_chunks::<8>().0.iter();
        out.extend(values.map(|b| f64::from_le_bytes(*b)));
    } else {
        let values = bytes.as_chunks::<4>().0.iter();
        out.extend(values.map(|b| f64::from(f32::from_le_bytes(*b))));
    }
}

/// Floats in single precision, of `<f8` if they are `wide`, else of `<f4`.
pub(super) fn singles(bytes: &[u8], wide: bool) -> Vec<f32> {
    if wide {
        let values = bytes.as_chunks::<8>().0.iter();
        values.map(|b| f64::from_le_bytes(*b) as f32).collect()
    } else {
        let values = bytes.as_chunks::<4>().0.iter();
        values.map(|b| f32::from_le_bytes(*b)).collect()
    }
}

pub(super) fn read_header(reader: &mut dyn Read, place: &Place) -> Result<Header> {
    let fail = |what: String| Error::data(place.clone(), what);
    let cut = |_| fail("ends inside its header".to_string());
    let mut start = [0; 8];
    reader.read_exact(&mut start).map_err(cut)?;
    let length = match start[6] {
        1 => {
            let mut n = [0; 2];
            reader.read_exact(&mut n).map_err(cut)?;
            u32::from(u16::from_le_bytes(n))
        }
        2 | 3 => {
            let mut n = [0; 4];
            reader.read_exact(&mut n).map_err(cut)?;
            u32::from_le_bytes(n)
        }
        v => {
            return Err(fail(format!(
                "is an NPY file of version {v}, expected 1 to 3"
            )));
        }
    };
    if length > 65_536 {
        return Err(fail("has an NPY header longer than 64 KiB".into()));
    }
    let mut text = vec![0; length as usize];
    reader.read_exact(&mut text).map_err(cut)?;
    let text = String::from_utf8_lossy(&text);
    parse_header(&text).map_err(|e| e.at(place.clone()))
}

/// Reads `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 69), }`.
fn parse_header(text: &str) -> Result<Header> {
    let field = |key: &str| -> Result<&str> {
        let quoted = [format!("'{key}'"), format!("\"{key}\"")];
        let at = quoted
            .iter()
            .find_map(|q| text.find(q.as_str()).map(|i| i + q.len()));
        let rest = at
            .map(|i| text[i..].trim_start())
            .and_then(|r| r.strip_prefix(':'));
        rest.map(str::trim_start)
            .ok_or_else(|| Error::unfit(format!("has no \"{key}\" in its header")))
    };
    let descr: String = field("descr")?
        .chars()
        .skip(1)
        .take_while(|c| !"'\"".contains(*c))
        .collect();
    let fortran = match field("fortran_order")? {
        v if v.starts_with("True") => true,
        v if v.starts_with("False") => false,
        _ => return Err("has no plain fortran_order in its header".into()),
    };
    let shape = field("shape")?
        .strip_prefix('(')
        .and_then(|s| s.split(')').next());
    let shape = shape.ok_or("has no plain shape in its header")?;
    let shape = shape
        .split(',')
        .map(str::trim)
        .filter(|s| !s.is_empty())
        .map(|s| s.trim_end_matches('L').parse::<u64>())
        .collect::<std::result::Result<Vec<_>, _>>()
        .map_err(|_| format!("has the shape ({}) in its header", excerpt(shape)))?;
    Ok(Header {
        descr,
        fortran,
        shape,
    })
}

/// The header of a C-order `<f8` array of (frames, width): always 128 bytes for sizes in use, so
/// that a file can be written first and its count of frames set last.
pub fn header(frames: u64, width: usize) -> Vec<u8> {
    header_of("<f8", &[frames as usize, width])
}

/// The header of a C-order array.
pub fn header_of(descr: &str, shape: &[usize]) -> Vec<u8> {
    let shape = match shape {
        [] => "()".to_string(),
        [one] => format!("({one},)"),
        more => format!(
            "({})",
            more.iter()
                .map(usize::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        ),
    };
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    let padded = (10 + text.len() + 1).next_multiple_of(64).max(128) - 10 - 1;
    text.push_str(&" ".repeat(padded - text.len()));
    text.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend_from_slice(&(text.len() as u16).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    out
}

/// The bytes of a one-dimensional `|u1` array in memory.
///
/// # Errors
/// [`Error::Data`]: another kind of array.
pub(crate) fn bytes_of<'a>(file: &'a [u8], place: &Place) -> Result<&'a [u8]> {
    let mut rest = file;
    let header = read_header(&mut rest, place)?;
    if header.descr != "|u1" || header.shape[..] != [rest.len() as u64] {
        return Err(Error::data(place.clone(), "is not an array of bytes"));
    }
    Ok(rest)
}

/// The bytes of an array file of frames, `file`, whose coordinates are `old` (frames, 3 P), with
/// those of `new` that are another number. All other bytes stay; a missing value takes no number
/// away.
///
/// # Errors
/// [`Error::Unfit`]: no array of frames of such a size.
pub(crate) fn with_values(
    file: &[u8],
    old: ArrayView2<'_, f64>,
    new: ArrayView2<'_, f64>,
) -> Result<Vec<u8>> {
    let mut rest = file;
    let header = read_header(&mut rest, &Place::file("")).map_err(|e| e.to_string())?;
    let size = if header.wide()? { 8 } else { 4 };
    let (frames, width) = old.dim();
    let is_right = rest.len() == frames * width * size && new.dim() == old.dim();
    if !is_right {
        return Err("is no array of the frames that were read".into());
    }
    let start = file.len() - rest.len();
    let points = width / 3;
    let mut out = file.to_vec();
    for ((frame, column), value) in new.indexed_iter() {
        if value.is_nan() || *value == old[[frame, column]] {
            continue;
        }
        let index = match (header.fortran, header.shape.len()) {
            (false, _) => frame * width + column,
            (true, 3 | 4) => frame + frames * (column / 3 + points * (column % 3)),
            (true, _) => frame + frames * column,
        };
        let at = start + size * index;
        match size {
            8 => out[at..at + 8].copy_from_slice(&value.to_le_bytes()),
            _ => out[at..at + 4].copy_from_slice(&(*value as f32).to_le_bytes()),
        }
    }
    Ok(out)
}

/// Appends numbers as `<f8`.
pub(crate) fn push_values(out: &mut Vec<u8>, xyz: &[f64]) {
    let start = out.len();
    out.resize(start + 8 * xyz.len(), 0);
    let (cells, _) = out[start..].as_chunks_mut::<8>();
    for (cell, value) in cells.iter_mut().zip(xyz) {
        *cell = value.to_le_bytes();
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::Table;
    use super::*;

    fn array(descr: &str, fortran: &str, shape: &str, values: &[f64]) -> Vec<u8> {
        let text =
            format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut out = b"\x93NUMPY\x01\x00".to_vec();
        out.extend_from_slice(&(text.len() as u16).to_le_bytes());
        out.extend_from_slice(text.as_bytes());
        for &v in values {
            if descr == "<f4" {
                out.extend_from_slice(&(v as f32).to_le_bytes());
            } else {
                out.extend_from_slice(&v.to_le_bytes());
            }
        }
        out
    }

    fn read(bytes: Vec<u8>, joints: Option<&str>) -> Result<Table> {
        let joints = joints.map(|j| j.split(',').map(String::from).collect());
        Table::read(
            Input::new("t.npy", std::io::Cursor::new(bytes))?,
            &TableOptions {
                joints,
                ..Default::default()
            },
        )
    }

    #[test]
    fn both_widths_orders_and_shapes() {
        let c: Vec<f64> = (0..12).map(f64::from).collect();
        // (2, 6): value = 6 frame + column. Fortran order runs over frames first.
        let f: Vec<f64> = (0..12).map(|i| f64::from(6 * (i % 2) + i / 2)).collect();
        // (2, 2, 3) in Fortran order: frame, then point, then axis.
        let f3: Vec<f64> = (0..12)
            .map(|i| f64::from(6 * (i % 2) + 3 * (i / 2 % 2) + i / 4))
            .collect();
        for bytes in [
            array("<f8", "False", "(2, 6)", &c),
            array("<f4", "False", "(2, 2, 3)", &c),
            array("<f8", "True", "(2, 6)", &f),
            array("<f4", "True", "(2, 2, 3)", &f3),
        ] {
            let table = read(bytes, Some("a,b")).unwrap();
            assert_eq!(table.poses.xyz.as_slice().unwrap(), c.as_slice());
            assert_eq!(table.columns.points, ["a", "b"]);
        }
    }

    #[test]
    fn frames_may_lie_across_what_is_read_at_a_time() {
        let values: Vec<f64> = (0..6 * (BLOCK / 8)).map(|i| i as f64 / 7.0).collect();
        let mut bytes = header((BLOCK / 8) as u64, 6);
        push_values(&mut bytes, &values);
        let table = read(bytes.clone(), Some("a,b")).unwrap();
        assert_eq!(table.poses.xyz.as_slice().unwrap(), values.as_slice());
        bytes.pop();
        let e = read(bytes, Some("a,b")).unwrap_err().to_string();
        assert!(
            e.ends_with(&format!("has {} of {}", BLOCK / 8 - 1, BLOCK / 8)),
            "{e}"
        );
    }

    #[test]
    fn other_values_are_written_in_place() {
        let values: Vec<f64> = (0..12).map(f64::from).collect();
        for (descr, fortran, shape) in [
            ("<f8", "False", "(2, 6)"),
            ("<f4", "False", "(2, 2, 3)"),
            ("<f8", "True", "(2, 6)"),
            ("<f4", "True", "(2, 2, 3)"),
            ("<f4", "False", "(1, 2, 2, 3)"),
            ("<f8", "True", "(1, 2, 2, 3)"),
        ] {
            let file = array(descr, fortran, shape, &values);
            let old = read(file.clone(), Some("a,b")).unwrap().poses.xyz;
            let mut new = old.clone();
            new[[1, 4]] = -0.5;
            new[[0, 2]] = f64::NAN;
            let written = with_values(&file, old.view(), new.view()).unwrap();
            let back = read(written.clone(), Some("a,b")).unwrap().poses.xyz;
            new[[0, 2]] = old[[0, 2]];
            assert_eq!(back, new);
            let differ = written.iter().zip(&file).filter(|(a, b)| a != b).count();
            assert!(differ <= 8 && written.len() == file.len());
        }
    }

    #[test]
    fn our_own_header_reads_back() {
        for frames in [0, 1, 123_456_789] {
            let h = header(frames, 69);
            assert_eq!(h.len(), 128);
            let parsed = parse_header(std::str::from_utf8(&h[10..]).unwrap()).unwrap();
            assert_eq!(parsed.shape, [frames, 69]);
        }
        assert_eq!(read(header(0, 69), None).unwrap().poses.frames(), 0);
    }

    #[test]
    fn bad_arrays_are_refused_in_one_line() {
        let values = [0.0; 6];
        let says = |bytes: Vec<u8>, names: &str, part: &str| {
            let e = read(bytes, Some(names)).unwrap_err().to_string();
            assert!(e.contains(part) && e.lines().count() == 1, "{e}");
        };
        says(
            array("<f8", "False", "(2, 6)", &values),
            "a,b",
            "ends before its last frame: has 1 of 2",
        );
        says(
            array("<f8", "True", "(2, 6)", &values),
            "a,b",
            "ends before its last frame",
        );
        says(
            array("<f8", "True", "(99999999999999, 6)", &values),
            "a,b",
            "ends before",
        );
        says(array("<f8", "False", "(1, 3)", &values), "a", "more bytes");
        says(array("<f8", "False", "(6,)", &values), "a,b", "shape");
        says(array("<f8", "False", "(1, 5)", &values), "a,b", "5 columns");
        says(array("<i8", "False", "(1, 6)", &values), "a,b", "<i8");
        says(
            array("<f8", "False", "(1, 6)", &[f64::INFINITY; 6]),
            "a,b",
            "infinite",
        );
        says(
            array("<f8", "False", "(1, 6)", &values),
            "a",
            "the option `joints` names 1",
        );
        says(b"\x93NUMPY\x01\x00\xff\xff{".to_vec(), "a", "header");
        says(b"\x93NUMPY\x09\x00\x00\x00".to_vec(), "a", "version");
        assert!(
            read(array("<f8", "False", "(1, 6)", &values), None)
                .unwrap_err()
                .to_string()
                .contains("the option `joints`")
        );
    }
}
