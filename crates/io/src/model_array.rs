//! A matrix of a model, in the number format of the file.

use super::npy;
use crate::{Error, Place, Result};
use bytes::Bytes;
use ndarray::{Array2, CowArray, Ix2};

/// A matrix, (rows, columns), as f32 in memory or as the file keeps it.
#[derive(Debug, Clone)]
pub enum Matrix {
    /// Single precision.
    Floats(Array2<f32>),
    /// The numbers of the file.
    Packed(PackedMatrix),
}

/// Whether all numbers are equal, however they are kept.
impl PartialEq for Matrix {
    fn eq(&self, other: &Matrix) -> bool {
        self.floats() == other.floats()
    }
}

/// The type of a file's numbers, and its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NumberType {
    /// `<i2`.
    Short = 2,
    /// `<f4`.
    Single = 4,
}

/// A matrix of 16-bit integers or floats, which are multiplied by a step. A clone shares the
/// numbers with the file that they were read from; only the rows that are asked for are converted.
#[derive(Debug, Clone)]
pub struct PackedMatrix {
    /// The numbers, row by row.
    numbers: Bytes,
    number_type: NumberType,
    shape: (usize, usize),
    /// The factor of all numbers.
    pub(super) step: f32,
}

impl PackedMatrix {
    /// A matrix of numbers, row by row; `None` where there are none, or not as many as the shape
    /// says.
    pub(crate) fn new(
        numbers: Bytes,
        number_type: NumberType,
        shape: (usize, usize),
    ) -> Option<PackedMatrix> {
        let size = shape
            .0
            .checked_mul(shape.1)?
            .checked_mul(number_type as usize)?;
        (size > 0 && numbers.len() == size).then_some(PackedMatrix {
            numbers,
            number_type,
            shape,
            step: 1.0,
        })
    }

    /// Rounds `array` to multiples of the smallest step that can hold the largest value. Every
    /// value must be finite.
    pub(crate) fn quantized(array: &Array2<f32>) -> PackedMatrix {
        let largest = array.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let step = (largest / f32::from(i16::MAX)).max(f32::MIN_POSITIVE);
        let numbers = array.iter().map(|v| (v / step).round() as i16);
        PackedMatrix {
            numbers: numbers.flat_map(i16::to_le_bytes).collect(),
            number_type: NumberType::Short,
            shape: array.dim(),
            step,
        }
    }

    /// Appends the numbers of a row.
    fn extend_with(&self, row: usize, out: &mut Vec<f32>) {
        let (from, to) = (row * self.shape.1, (row + 1) * self.shape.1);
        match self.number_type {
            NumberType::Short => {
                let numbers = self.numbers.as_chunks::<2>().0[from..to].iter();
                out.extend(numbers.map(|b| f32::from(i16::from_le_bytes(*b)) * self.step));
            }
            NumberType::Single => {
                let numbers = self.numbers.as_chunks::<4>().0[from..to].iter();
                out.extend(numbers.map(|b| f32::from_le_bytes(*b) * self.step));
            }
        }
    }
}

impl Matrix {
    /// The array of an NPY file in memory, of one dimension (one column) or two: `<f8`, or `<f4` or
    /// `<i2`, whose numbers are shared with `file`.
    ///
    /// # Errors
    /// [`Error::Data`]: other numbers, more dimensions, or not as many bytes as the shape needs.
    pub(crate) fn from_npy(file: &Bytes, place: &Place) -> Result<Matrix> {
        let fail = |what: String| Error::data(place.clone(), what);
        let mut rest = &file[..];
        let header = npy::read_header(&mut rest, place)?;
        let (number_type, bytes) = if header.descr == "<i2" {
            (Some(NumberType::Short), 2)
        } else if header.wide().map_err(|e| e.at(place.clone()))? {
            (None, 8)
        } else {
            (Some(NumberType::Single), 4)
        };
        let (rows, columns) = match header.shape[..] {
            [n] => (n, 1),
            [n, d] => (n, d),
            _ => {
                return Err(fail(format!(
                    "has the shape {:?}, expected a matrix",
                    header.shape
                )));
            }
        };
        let size = rows.saturating_mul(columns).saturating_mul(bytes);
        if size != rest.len() as u64 {
            return Err(fail(format!(
                "has {} bytes, but its shape needs {size}",
                rest.len()
            )));
        }
        let (rows, columns) = (rows as usize, columns as usize);
        // An empty matrix may claim any number of rows: arrays of floats refuse too many.
        if let Some(number_type) = number_type
            && !header.fortran
            && size > 0
        {
            let packed = PackedMatrix::new(file.slice_ref(rest), number_type, (rows, columns));
            return (packed.map(Matrix::Packed)).ok_or_else(|| fail("is too large".into()));
        }
        let values: Vec<f32> = match number_type {
            Some(NumberType::Short) => {
                let pairs = rest.as_chunks::<2>().0.iter();
                pairs.map(|b| f32::from(i16::from_le_bytes(*b))).collect()
            }
            other => npy::singles(rest, other.is_none()),
        };
        let array = if header.fortran {
            Array2::from_shape_vec((columns, rows), values)
                .map(|a| a.reversed_axes().as_standard_layout().into_owned())
        } else {
            Array2::from_shape_vec((rows, columns), values)
        };
        (array.map(Matrix::Floats)).map_err(|e| fail(e.to_string()))
    }

    /// The NPY file of the numbers.
    pub(crate) fn to_npy(&self) -> Vec<u8> {
        let shape = [self.nrows(), self.ncols()];
        match self {
            Matrix::Packed(packed) => {
                let descr = match packed.number_type {
                    NumberType::Short => "<i2",
                    NumberType::Single => "<f4",
                };
                [&npy::header_of(descr, &shape)[..], &packed.numbers].concat()
            }
            Matrix::Floats(array) => {
                let mut bytes = npy::header_of("<f4", &shape);
                bytes.extend(array.iter().flat_map(|v| v.to_le_bytes()));
                bytes
            }
        }
    }

    /// The factor of the numbers in the file; `None` where they are the values.
    pub(crate) fn step(&self) -> Option<f32> {
        match self {
            Matrix::Packed(p) if p.number_type == NumberType::Short || p.step != 1.0 => {
                Some(p.step)
            }
            _ => None,
        }
    }

    /// (rows, columns).
    pub(crate) fn dim(&self) -> (usize, usize) {
        match self {
            Matrix::Floats(array) => array.dim(),
            Matrix::Packed(packed) => packed.shape,
        }
    }

    /// The number of rows.
    pub fn nrows(&self) -> usize {
        self.dim().0
    }

    /// The number of columns.
    pub fn ncols(&self) -> usize {
        self.dim().1
    }

    /// Appends the numbers of a row to `out`.
    pub fn extend_with(&self, row: usize, out: &mut Vec<f32>) {
        match self {
            Matrix::Floats(array) => out.extend(array.row(row)),
            Matrix::Packed(packed) => packed.extend_with(row, out),
        }
    }

    /// Some rows as f32, (rows, columns).
    pub fn rows(&self, rows: impl IntoIterator<Item = usize>) -> Array2<f32> {
        let (mut all, mut count) = (Vec::new(), 0);
        for row in rows {
            self.extend_with(row, &mut all);
            count += 1;
        }
        // As many as there are: cannot fail.
        Array2::from_shape_vec((count, self.ncols()), all).unwrap_or_default()
    }

    /// The matrix as f32, (rows, columns): borrowed, or converted from what the file keeps.
    pub fn floats(&self) -> CowArray<'_, f32, Ix2> {
        match self {
            Matrix::Floats(array) => array.view().into(),
            Matrix::Packed(packed) => self.rows(0..packed.shape.0).into(),
        }
    }
}

impl From<Array2<f32>> for Matrix {
    fn from(array: Array2<f32>) -> Matrix {
        Matrix::Floats(array)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn packed_numbers_read_as_floats_do() {
        let array = array![[1.0f32, -2.5, 0.0], [32767.0, 3.3, -32767.0]];
        let packed = Matrix::Packed(PackedMatrix::quantized(&array));
        let rounded = packed.floats().into_owned();
        assert_eq!(rounded, array![[1.0, -3.0, 0.0], [32767.0, 3.0, -32767.0]]);
        let floats = Matrix::from(rounded.clone());
        for matrix in [&packed, &floats] {
            assert_eq!(matrix.dim(), (2, 3));
            let mut rows = Vec::new();
            matrix.extend_with(1, &mut rows);
            assert_eq!(rows, rounded.row(1).to_vec());
        }
    }

    #[test]
    fn too_few_numbers_are_refused() {
        assert!(
            PackedMatrix::new(Bytes::from_static(&[0; 11]), NumberType::Short, (2, 3)).is_none()
        );
        assert!(PackedMatrix::new(Bytes::new(), NumberType::Short, (usize::MAX, 3)).is_none());
        assert!(PackedMatrix::new(Bytes::new(), NumberType::Short, (usize::MAX, 0)).is_none());
    }
}
