//! Products of a matrix with itself.

use ::faer::linalg::matmul::triangular::{BlockStructure, matmul};
use ::faer::{Accum, MatMut, MatRef, Par};
use ndarray::{Array2, ArrayView2};

/// Xᵀ X (m, m) of X (n, m): half of the work of a product, as it is symmetric.
pub fn gram(x: ArrayView2<'_, f64>) -> Array2<f64> {
    let (n, m) = x.dim();
    let copy;
    let x = match (x.to_slice(), x.t().to_slice()) {
        (Some(rows), _) => MatRef::from_row_major_slice(rows, n, m),
        (_, Some(columns)) => MatRef::from_column_major_slice(columns, n, m),
        _ => {
            copy = x.iter().copied().collect::<Vec<f64>>();
            MatRef::from_row_major_slice(&copy, n, m)
        }
    };
    let mut out = vec![0.0; m * m];
    matmul(
        MatMut::from_column_major_slice_mut(&mut out, m, m),
        BlockStructure::TriangularLower,
        Accum::Replace,
        x.transpose(),
        BlockStructure::Rectangular,
        x,
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
    for row in 1..m {
        for column in 0..row {
            out[row * m + column] = out[column * m + row];
        }
    }
    match Array2::from_shape_vec((m, m), out) {
        Ok(out) => out,
        Err(_) => unreachable!("m times m numbers"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{ShapeBuilder, s};

    #[test]
    fn it_is_the_product_in_every_layout() {
        for (n, m) in [(1, 1), (3, 7), (70, 150), (401, 33), (0, 4), (5, 0)] {
            let x = Array2::from_shape_fn((n, m), |(i, j)| ((i * 31 + j * 17) as f64).sin());
            let want = x.t().dot(&x);
            let mut columns = Array2::zeros((n, m).f());
            columns.assign(&x);
            let wide = Array2::from_shape_fn((n, 2 * m), |(i, j)| x[[i, j / 2]]);
            for view in [x.view(), columns.view(), wide.slice(s![.., ..;2])] {
                let off = &gram(view) - &want;
                assert!(off.iter().all(|v| v.abs() <= 1e-12 * n as f64), "{n} {m}");
            }
        }
    }
}
