//! NPZ archives of meshes: vertices (n, V, 3) or (V, 3) of `<f4` or `<f8`, and `faces` (F, 3) of a
//! whole type, both in C order. Other arrays are ignored.

use super::super::Input;
use super::super::npy::{Header, read_header, singles};
use super::super::text::{MAX_COORDINATE, excerpt};
use super::MOST;
use crate::{Error, Place, Result};
use std::io::{Cursor, Read};

/// The largest size of an archive, and of an array in it, in bytes.
const LARGEST: u64 = 8 << 30;

/// What an archive holds.
pub(super) struct MeshArrays {
    /// The position of the array that was read in the names asked for.
    pub(super) chosen: usize,
    /// The vertices of each mesh.
    pub(super) count: usize,
    /// The coordinates of all meshes, one after the other; all of a mesh that is not there are
    /// NaN.
    pub(super) xyz: Vec<f32>,
    pub(super) faces: Vec<[u32; 3]>,
}

type Archive = zip::ZipArchive<Cursor<Vec<u8>>>;

/// Reads the first of the arrays `names` that an archive has, and its faces.
pub(super) fn read(input: Input, names: &[&str]) -> Result<MeshArrays> {
    let name = input.name.clone();
    let archive = zip::ZipArchive::new(Cursor::new(input.read_all(LARGEST)?));
    let mut archive = archive.map_err(|e| {
        let what = format!("is a damaged NPZ archive: {}", excerpt(&e.to_string()));
        Error::data(Place::file(&name), what)
    })?;
    let is_there = |part: &&str| archive.index_for_name(&format!("{part}.npy")).is_some();
    let Some(chosen) = names.iter().position(is_there) else {
        let what = format!("{}: the archive has no such array", names.join(" or "));
        return Err(Error::data(Place::file(&name), what));
    };
    let (count, xyz) = vertices(&mut archive, &name, names[chosen])?;
    let faces = faces(&mut archive, &name, count)?;
    Ok(MeshArrays {
        chosen,
        count,
        xyz,
        faces,
    })
}

/// The header and the values of an array, of which each takes the number of bytes that `size`
/// finds.
fn array(
    archive: &mut Archive,
    place: &Place,
    part: &str,
    size: impl Fn(&Header) -> Result<u64>,
) -> Result<(Header, Vec<u8>)> {
    let fail = |what: String| Error::data(place.clone(), what);
    let damaged = |e: String| fail(format!("is damaged: {}", excerpt(&e)));
    let mut entry = match archive.by_name(&format!("{part}.npy")) {
        Ok(entry) => entry,
        Err(zip::result::ZipError::FileNotFound) => {
            return Err(fail("the archive has no such array".into()));
        }
        Err(e) => return Err(damaged(e.to_string())),
    };
    let header = read_header(&mut entry, place)?;
    if header.fortran {
        let what = "is in Fortran order; save it with numpy.ascontiguousarray";
        return Err(fail(what.into()));
    }
    let values = header
        .shape
        .iter()
        .fold(1, |n: u64, d| n.saturating_mul(*d));
    let bytes = values.saturating_mul(size(&header).map_err(|e| e.at(place.clone()))?);
    if bytes > LARGEST {
        return Err(fail(format!("is larger than {} GiB", LARGEST >> 30)));
    }
    // Not allocated by what the header says: the bytes may not be there.
    let mut content = Vec::new();
    let read = entry.by_ref().take(bytes + 1).read_to_end(&mut content);
    read.map_err(|e| damaged(e.to_string()))?;
    match content.len() as u64 {
        n if n < bytes => Err(fail("ends before its last value".into())),
        n if n > bytes => Err(fail("has more bytes than its header says".into())),
        _ => Ok((header, content)),
    }
}

fn vertices(archive: &mut Archive, name: &str, part: &str) -> Result<(usize, Vec<f32>)> {
    let place = Place::file(name).part(part);
    let width = |h: &Header| h.wide().map(|wide| if wide { 8 } else { 4 });
    let (header, bytes) = array(archive, &place, part, width)?;
    let fail = |what: String| Err(Error::data(place.clone(), what));
    let count = match header.shape[..] {
        [_, count, 3] | [count, 3] if count > 0 && count <= MOST as u64 => count as usize,
        _ => {
            let shape = &header.shape;
            return fail(format!(
                "has the shape {shape:?}, expected (meshes, vertices, 3)"
            ));
        }
    };
    let xyz = singles(&bytes, header.descr == "<f8");
    let beyond = |at: &usize| !(f64::from(xyz[*at].abs()) <= MAX_COORDINATE);
    let there = (0..xyz.len() / (3 * count))
        .filter(|k| !is_absent(&xyz[3 * count * k..3 * count * (k + 1)]));
    if let Some(at) = there
        .flat_map(|k| 3 * count * k..3 * count * (k + 1))
        .find(beyond)
    {
        let (mesh, vertex) = (at / 3 / count, at / 3 % count);
        let what = format!("mesh {mesh}, vertex {vertex} (counted from 0)");
        let value = xyz[at];
        return fail(format!(
            "{what}: expected coordinates within {MAX_COORDINATE:e}, found {value}"
        ));
    }
    Ok((count, xyz))
}

/// Whether a mesh is not there: the frame of a take in which nothing is known.
pub(super) fn is_absent(mesh: &[f32]) -> bool {
    mesh.iter().all(|v| v.is_nan())
}

fn faces(archive: &mut Archive, name: &str, vertices: usize) -> Result<Vec<[u32; 3]>> {
    let place = Place::file(name).part("faces");
    let (header, bytes) = array(archive, &place, "faces", |h| whole_size(&h.descr))?;
    let fail = |what: String| Error::data(place.clone(), what);
    if !matches!(header.shape[..], [_, 3]) || header.shape[0] > MOST as u64 {
        let shape = &header.shape;
        return Err(fail(format!(
            "has the shape {shape:?}, expected (faces, 3)"
        )));
    }
    let size = whole_size(&header.descr).map_err(|e| e.at(place.clone()))? as usize;
    let signed = header.descr.as_bytes().get(1) == Some(&b'i');
    let mut faces = Vec::with_capacity(bytes.len() / size / 3);
    for (i, row) in bytes.chunks_exact(3 * size).enumerate() {
        let mut face = [0; 3];
        for (corner, value) in face.iter_mut().zip(row.chunks_exact(size)) {
            let value = whole_value(value, signed);
            if value < 0 || value >= vertices as i128 {
                return Err(fail(format!(
                    "face {i} names vertex {value}, there are {vertices} (counted from 0)"
                )));
            }
            *corner = value as u32;
        }
        faces.push(face);
    }
    Ok(faces)
}

/// The bytes of a value of a whole type such as `<i4`.
fn whole_size(descr: &str) -> Result<u64> {
    match descr {
        "|i1" | "|u1" => Ok(1),
        "<i2" | "<u2" => Ok(2),
        "<i4" | "<u4" => Ok(4),
        "<i8" | "<u8" => Ok(8),
        other => {
            let other = excerpt(other);
            Err(format!("has values of type {other}, expected <i4 or <i8").into())
        }
    }
}

/// A whole number of up to 8 little-endian bytes.
fn whole_value(bytes: &[u8], signed: bool) -> i128 {
    let negative = signed && bytes.last().is_some_and(|b| *b >= 128);
    let mut wide = [if negative { 0xff } else { 0 }; 16];
    wide[..bytes.len()].copy_from_slice(bytes);
    i128::from_le_bytes(wide)
}

#[cfg(test)]
mod tests {
    use super::whole_value;

    #[test]
    fn whole_numbers_of_all_types() {
        assert_eq!(whole_value(&[255], false), 255);
        assert_eq!(whole_value(&[255], true), -1);
        assert_eq!(whole_value(&300_i16.to_le_bytes(), true), 300);
        assert_eq!(whole_value(&(-7_i64).to_le_bytes(), true), -7);
        let largest = u64::MAX.to_le_bytes();
        assert_eq!(whole_value(&largest, false), i128::from(u64::MAX));
    }
}
