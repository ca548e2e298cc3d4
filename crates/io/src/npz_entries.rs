//! The arrays of an NPZ archive: their headers, texts and numbers.

use super::npy::{Header, read_header};
use super::text::excerpt;
use crate::{Error, Place, Result};
use std::io::{Cursor, Read};

/// The largest archive that is read, bytes.
pub(super) const LARGEST: u64 = 8 << 30;
/// What unpacks to more than this, bytes, may not be so many times larger than the archive.
const UNPACKED: u64 = 1 << 26;
const MOST_PACKED: u64 = 100;
/// More entries are no archive of a take.
const MOST_ENTRIES: usize = 4096;
/// Entries that a message lists.
const LISTED: usize = 8;

/// What the header of an entry says.
pub(super) struct Entry {
    pub(super) index: usize,
    pub(super) name: String,
    pub(super) header: Header,
}

/// An archive and its name in messages.
pub(super) struct Zipped<'a> {
    pub(super) name: &'a str,
    pub(super) archive: &'a [u8],
}

impl Zipped<'_> {
    pub(super) fn fail(&self, what: &str) -> Error {
        let what = format!("is a damaged NPZ archive: {}", excerpt(what));
        Error::data(Place::file(self.name), what)
    }

    pub(super) fn open(&self) -> Result<zip::ZipArchive<Cursor<&[u8]>>> {
        zip::ZipArchive::new(Cursor::new(self.archive)).map_err(|e| self.fail(&e.to_string()))
    }

    /// The arrays of the archive.
    pub(super) fn entries(&self) -> Result<Vec<Entry>> {
        let mut zip = self.open()?;
        let bad = |what: &str| Error::data(Place::file(self.name), what);
        if zip.len() > MOST_ENTRIES {
            return Err(bad(
                "is an archive of more than 4096 files: unpack it first",
            ));
        }
        let mut out = Vec::new();
        for index in 0..zip.len() {
            let mut entry = zip.by_index(index).map_err(|e| self.fail(&e.to_string()))?;
            let name = entry.name().map_err(|e| self.fail(&e.to_string()))?;
            let Some(name) = name.strip_suffix(".npy").map(String::from) else {
                continue;
            };
            let place = Place::file(self.name).part(&name);
            let header = read_header(&mut entry, &place)?;
            out.push(Entry {
                index,
                name,
                header,
            });
        }
        if out.is_empty() {
            Err(bad("is a ZIP archive without arrays: unpack it first"))
        } else {
            Ok(out)
        }
    }

    /// What an entry holds.
    pub(super) fn content(&self, index: usize) -> Result<Vec<u8>> {
        let mut zip = self.open()?;
        let entry = zip.by_index(index).map_err(|e| self.fail(&e.to_string()))?;
        let most = UNPACKED.max(MOST_PACKED * self.archive.len() as u64);
        let mut content = Vec::new();
        let read = entry.take(most + 1).read_to_end(&mut content);
        read.map_err(|e| self.fail(&e.to_string()))?;
        if content.len() as u64 > most {
            Err(self.fail("unpacks to far more than its size"))
        } else {
            Ok(content)
        }
    }

    /// The values of an array behind its header.
    pub(super) fn values(&self, entry: &Entry) -> Result<Vec<u8>> {
        let content = self.content(entry.index)?;
        let mut rest = &content[..];
        read_header(&mut rest, &Place::file(self.name).part(&entry.name))?;
        Ok(rest.to_vec())
    }
}

/// The name of an array without case and signs.
pub(super) fn plain(name: &str) -> String {
    let letters = name.chars().filter(|c| c.is_ascii_alphanumeric());
    letters.map(|c| c.to_ascii_lowercase()).collect()
}

/// Arrays with their shapes.
pub(super) fn listed<'a>(entries: impl Iterator<Item = &'a Entry>) -> String {
    let all: Vec<String> = entries
        .map(|e| {
            let shape: Vec<String> = e.header.shape.iter().take(5).map(u64::to_string).collect();
            format!("{} ({})", e.name, shape.join(", "))
        })
        .collect();
    match all.len() {
        0..=LISTED => all.join(", "),
        n => format!("{} and {} more", all[..LISTED].join(", "), n - LISTED),
    }
}

/// The bytes of a text of an array: `<U4` has four characters of four bytes, `|S4` four bytes.
pub(super) fn text_width(descr: &str) -> Option<usize> {
    let width = |letter: &str, bytes: usize| {
        let count = descr.strip_prefix(letter)?.parse::<usize>().ok()?;
        count.checked_mul(bytes).filter(|w| *w > 0)
    };
    width("<U", 4).or(width("|S", 1))
}

/// The texts of an array.
pub(super) fn texts(descr: &str, bytes: &[u8]) -> Vec<String> {
    let Some(width) = text_width(descr) else {
        return Vec::new();
    };
    let text = |bytes: &[u8]| -> String {
        let text: String = if descr.starts_with("<U") {
            (bytes.as_chunks::<4>().0.iter())
                .filter_map(|b| char::from_u32(u32::from_le_bytes(*b)))
                .collect()
        } else {
            String::from_utf8_lossy(bytes).into_owned()
        };
        text.trim_end_matches('\0').to_string()
    };
    bytes.chunks_exact(width).map(text).collect()
}

/// The number of an array of one.
pub(super) fn number(descr: &str, bytes: &[u8]) -> Option<f64> {
    fn first<const N: usize>(bytes: &[u8]) -> Option<[u8; N]> {
        bytes.first_chunk::<N>().copied()
    }
    Some(match descr {
        "<f8" => f64::from_le_bytes(first(bytes)?),
        "<f4" => f64::from(f32::from_le_bytes(first(bytes)?)),
        "<i8" => i64::from_le_bytes(first(bytes)?) as f64,
        "<u8" => u64::from_le_bytes(first(bytes)?) as f64,
        "<i4" => f64::from(i32::from_le_bytes(first(bytes)?)),
        "<u4" => f64::from(u32::from_le_bytes(first(bytes)?)),
        "<i2" => f64::from(i16::from_le_bytes(first(bytes)?)),
        "<u2" => f64::from(u16::from_le_bytes(first(bytes)?)),
        "|u1" | "|i1" => f64::from(*bytes.first()?),
        _ => return None,
    })
}
