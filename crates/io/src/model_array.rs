//! A matrix of a model, in the number format of the file.

use super::npy;
use crate::{Error, Place, Result};
use bytes::Bytes;
use ndarray::{Array2, CowArray, Ix2};

/// A matrix, (rows, columns), as f32 or as 16-bit integers with a step.
#[derive(Debug, Clone, PartialEq)]
pub enum Matrix {
    /// Single precision.
    Floats(Array2<f32>),
    /// 16-bit whole multiples of a step.
    Quantized(QuantizedMatrix),
}

/// A matrix of 16-bit integers, which are multiplied by a step. A clone shares the integers with
/// the file that they were read from; only the rows that are asked for are converted.
#[derive(Debug, Clone, PartialEq)]
pub struct QuantizedMatrix {
    /// The integers as `<i2`, row by row.
    numbers: Bytes,
    shape: (usize, usize),
    /// The factor of all integers.
    pub(super) step: f32,
}

impl QuantizedMatrix {
    /// A matrix of `<i2` integers, row by row; `None` where there are none, or not as many as the
    /// shape says.
    pub(crate) fn new(numbers: Bytes, shape: (usize, usize), step: f32) -> Option<QuantizedMatrix> {
        let size = shape.0.checked_mul(shape.1)?.checked_mul(2)?;
        (size > 0 && numbers.len() == size).then_some(QuantizedMatrix {
            numbers,
            shape,
            step,
        })
    }

    /// Rounds `array` to multiples of the smallest step that can hold the largest value. Every
    /// value must be finite.
    pub(crate) fn of(array: &Array2<f32>) -> QuantizedMatrix {
        let largest = array.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let step = (largest / f32::from(i16::MAX)).max(f32::MIN_POSITIVE);
        let numbers = array.iter().map(|v| (v / step).round() as i16);
        QuantizedMatrix {
            numbers: numbers.flat_map(i16::to_le_bytes).collect(),
            shape: array.dim(),
            step,
        }
    }

    /// The integers as `<i2`, row by row.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.numbers
    }

    fn pairs(&self, row: usize) -> &[[u8; 2]] {
        let width = self.shape.1;
        &self.numbers.as_chunks::<2>().0[row * width..(row + 1) * width]
    }

    fn parse_number(&self, pair: [u8; 2]) -> f32 {
        f32::from(i16::from_le_bytes(pair)) * self.step
    }
}

impl Matrix {
    /// The array of an NPY file in memory, of one dimension (one column) or two: `<f4`, `<f8`, or
    /// `<i2`, whose integers are shared with `file`.
    ///
    /// # Errors
    /// [`Error::Data`]: other numbers, more dimensions, or not as many bytes as the shape needs.
    pub(crate) fn from_npy(file: &Bytes, place: &Place) -> Result<Matrix> {
        let fail = |what: String| Error::data(place.clone(), what);
        let mut rest = &file[..];
        let header = npy::read_header(&mut rest, place)?;
        let short = header.descr == "<i2";
        let wide = !short && header.wide().map_err(|e| e.at(place.clone()))?;
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
        let size = rows.saturating_mul(columns).saturating_mul(if short {
            2
        } else if wide {
            8
        } else {
            4
        });
        if size != rest.len() as u64 {
            return Err(fail(format!(
                "has {} bytes, but its shape needs {size}",
                rest.len()
            )));
        }
        let (rows, columns) = (rows as usize, columns as usize);
        // An empty matrix may claim any number of rows: arrays of floats refuse too many.
        if short && !header.fortran && size > 0 {
            let packed = QuantizedMatrix::new(file.slice_ref(rest), (rows, columns), 1.0);
            return (packed.map(Matrix::Quantized)).ok_or_else(|| fail("is too large".into()));
        }
        let values: Vec<f32> = if short {
            let pairs = rest.as_chunks::<2>().0.iter();
            pairs.map(|b| f32::from(i16::from_le_bytes(*b))).collect()
        } else {
            npy::singles(rest, wide)
        };
        let array = if header.fortran {
            Array2::from_shape_vec((columns, rows), values)
                .map(|a| a.reversed_axes().as_standard_layout().into_owned())
        } else {
            Array2::from_shape_vec((rows, columns), values)
        };
        (array.map(Matrix::Floats)).map_err(|e| fail(e.to_string()))
    }

    /// (rows, columns).
    pub(crate) fn dim(&self) -> (usize, usize) {
        match self {
            Matrix::Floats(array) => array.dim(),
            Matrix::Quantized(packed) => packed.shape,
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

    /// Appends the numbers of `rows` to `out`, row by row.
    pub(crate) fn extend_with(&self, rows: std::ops::Range<usize>, out: &mut Vec<f32>) {
        for row in rows {
            match self {
                Matrix::Floats(array) => out.extend(array.row(row)),
                Matrix::Quantized(packed) => {
                    out.extend(packed.pairs(row).iter().map(|b| packed.parse_number(*b)));
                }
            }
        }
    }

    /// The matrix as f32, (rows, columns): borrowed, or converted from integers.
    pub fn floats(&self) -> CowArray<'_, f32, Ix2> {
        match self {
            Matrix::Floats(array) => array.view().into(),
            Matrix::Quantized(packed) => {
                let (rows, columns) = packed.shape;
                let mut all = Vec::with_capacity(rows * columns);
                self.extend_with(0..rows, &mut all);
                // As many as there are: cannot fail.
                let all = Array2::from_shape_vec((rows, columns), all);
                all.unwrap_or_default().into()
            }
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
        let packed = Matrix::Quantized(QuantizedMatrix::of(&array));
        let rounded = packed.floats().into_owned();
        assert_eq!(rounded, array![[1.0, -3.0, 0.0], [32767.0, 3.0, -32767.0]]);
        let floats = Matrix::from(rounded.clone());
        for matrix in [&packed, &floats] {
            assert_eq!(matrix.dim(), (2, 3));
            let mut rows = Vec::new();
            matrix.extend_with(1..2, &mut rows);
            assert_eq!(rows, rounded.row(1).to_vec());
        }
    }

    #[test]
    fn too_few_numbers_are_refused() {
        assert!(QuantizedMatrix::new(Bytes::from_static(&[0; 11]), (2, 3), 1.0).is_none());
        assert!(QuantizedMatrix::new(Bytes::new(), (usize::MAX, 3), 1.0).is_none());
        assert!(QuantizedMatrix::new(Bytes::new(), (usize::MAX, 0), 1.0).is_none());
    }
}
