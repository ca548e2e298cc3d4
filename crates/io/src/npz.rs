//! A writer of NumPy archives: arrays of any number of dimensions. (`npz_take` reads them.)

use super::npy::header_of;
use crate::{Error, Place, Result};
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;

/// An array in C order.
#[derive(Debug, Clone, PartialEq)]
pub enum NpzValues {
    /// `<f4`.
    Floats(Vec<f32>),
    /// `<f8`.
    Doubles(Vec<f64>),
    /// `<i4`.
    Whole(Vec<i32>),
    /// `<U`, as wide as the longest text.
    Texts(Vec<String>),
}

impl NpzValues {
    /// The type of the values, and their bytes.
    fn encoded(&self) -> (String, Vec<u8>) {
        match self {
            NpzValues::Floats(v) => (
                "<f4".into(),
                v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            ),
            NpzValues::Doubles(v) => (
                "<f8".into(),
                v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            ),
            NpzValues::Whole(v) => (
                "<i4".into(),
                v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            ),
            NpzValues::Texts(v) => {
                let width = v.iter().map(|text| text.chars().count()).max();
                let width = width.unwrap_or(0).max(1);
                let padded = |text: &String| {
                    let letters = text.chars().map(u32::from).collect::<Vec<_>>();
                    let padding = std::iter::repeat_n(0, width - letters.len());
                    letters
                        .into_iter()
                        .chain(padding)
                        .flat_map(u32::to_le_bytes)
                };
                (format!("<U{width}"), v.iter().flat_map(padded).collect())
            }
        }
    }
}

/// A named array of an archive.
///
/// ```
/// use posing_io::npz::{NpzArray, NpzValues, npz_bytes};
///
/// let values = NpzValues::Doubles(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
/// let array = NpzArray { name: "xyz".into(), shape: vec![2, 3], values };
/// let bytes = npz_bytes(&[array])?;
/// assert!(bytes.starts_with(b"PK")); // a ZIP archive, as numpy.load opens
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct NpzArray {
    /// The name.
    pub name: String,
    /// The lengths of the axes; their product is the number of values.
    pub shape: Vec<usize>,
    /// The values, the last axis fastest.
    pub values: NpzValues,
}

/// The bytes of an archive that `numpy.load` opens; equal arrays give equal bytes.
///
/// # Errors
/// [`Error::Data`]: the archive cannot be made.
pub fn npz_bytes(arrays: &[NpzArray]) -> Result<Vec<u8>> {
    let fail = |e: String| Error::data(Place::file("the archive"), e);
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for array in arrays {
        let (descr, bytes) = array.values.encoded();
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default())
            .large_file(bytes.len() as u64 > u64::from(u32::MAX) - 1024);
        zip.start_file(format!("{}.npy", array.name), options)
            .map_err(|e| fail(e.to_string()))?;
        (zip.write_all(&header_of(&descr, &array.shape))
            .and_then(|()| zip.write_all(&bytes)))
        .map_err(|e| fail(e.to_string()))?;
    }
    Ok(zip.finish().map_err(|e| fail(e.to_string()))?.into_inner())
}
