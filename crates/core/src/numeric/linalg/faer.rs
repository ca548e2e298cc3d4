//! Dense linear algebra by faer, in Rust throughout. All of it runs on the thread that calls, so no
//! result depends on their number.

use super::BackEnd;
use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::evd::{
    ComputeEigenvectors, SelfAdjointEvdParams, self_adjoint_evd, self_adjoint_evd_scratch,
};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Auto, Mat, MatMut, MatRef, Par, Spec};
use ndarray::{Array1, Array2, ShapeBuilder};

/// faer.
pub(super) struct Faer;

impl BackEnd for Faer {
    /// L; what stands above the diagonal is not read.
    type Factor = Mat<f64>;

    fn cholesky_solve(a: Array2<f64>, b: Array1<f64>) -> Option<Array1<f64>> {
        let l = Faer::factorize(a)?;
        let mut x = b.to_vec();
        let mut column = MatMut::from_column_major_slice_mut(&mut x, b.len(), 1);
        solve_lower_triangular_in_place(l.as_ref(), column.as_mut(), Par::Seq);
        solve_upper_triangular_in_place(l.transpose(), column, Par::Seq);
        Some(Array1::from(x))
    }

    fn factorize(a: Array2<f64>) -> Option<Self::Factor> {
        let mut l = columns(&a);
        let scratch = cholesky_in_place_scratch::<f64>(l.nrows(), Par::Seq, Spec::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let as_it_is = LltRegularization::default();
        cholesky_in_place(l.as_mut(), as_it_is, Par::Seq, stack, Spec::default()).ok()?;
        Some(l)
    }

    fn half_solve(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>> {
        let mut x = columns(b);
        solve_lower_triangular_in_place(l.as_ref(), x.as_mut(), Par::Seq);
        Some(rows(&x))
    }

    fn half_solve_transposed(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>> {
        let mut x = columns(b);
        solve_upper_triangular_in_place(l.transpose(), x.as_mut(), Par::Seq);
        Some(rows(&x))
    }

    /// The largest component of each eigenvector, by magnitude and the first of equals, is
    /// positive.
    fn symmetric_eigen(a: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
        let n = a.nrows();
        // Unlike LAPACK, faer does not scale: beside 1e308 and 1e-308 its squares are infinite and
        // 0. A power of 2 changes no digit.
        let scale = match largest(a) {
            0.0 => 1.0,
            value => 2f64.powi(-value.abs().log2().clamp(-1000.0, 1000.0) as i32),
        };
        let scaled = |v: &f64| v * scale;
        // faer reads the lower triangle of columns; of rows that is the upper one.
        let memory: Vec<f64> = match a.t().to_slice() {
            Some(columns) => columns.iter().map(scaled).collect(),
            None => a.iter().map(scaled).collect(),
        };
        // QR steps at every size, whose number is bounded. From 128 on, faer would divide and
        // conquer, no faster at 300; what it drops is 1e-15 whatever the size of the
        // numbers (0.24).
        let mut params: SelfAdjointEvdParams = Auto::<f64>::auto();
        params.recursion_threshold = usize::MAX;
        let both = ComputeEigenvectors::Yes;
        let scratch = self_adjoint_evd_scratch::<f64>(n, both, Par::Seq, params.into());
        let (mut values, mut vectors) = (vec![0.0; n], vec![0.0; n * n]);
        self_adjoint_evd(
            MatRef::from_column_major_slice(&memory, n, n),
            DiagMut::from_slice_mut(&mut values),
            Some(MatMut::from_column_major_slice_mut(&mut vectors, n, n)),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            params.into(),
        )
        .ok()?;
        for vector in vectors.chunks_exact_mut(n) {
            if largest(&*vector) < 0.0 {
                vector.iter_mut().for_each(|v| *v = -*v);
            }
        }
        let vectors = Array2::from_shape_vec((n, n).f(), vectors).ok()?;
        Some((Array1::from(values) / scale, vectors))
    }
}

/// The value of the largest magnitude, with its sign; the first of equals.
fn largest<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    let larger = |most: f64, v: &f64| if v.abs() > most.abs() { *v } else { most };
    values.into_iter().fold(0.0, larger)
}

/// A copy that lies column by column.
fn columns(a: &Array2<f64>) -> Mat<f64> {
    let (n, m) = a.dim();
    match (a.t().to_slice(), a.as_slice()) {
        (Some(columns), _) => MatRef::from_column_major_slice(columns, n, m).to_owned(),
        (_, Some(rows)) => MatRef::from_row_major_slice(rows, n, m).to_owned(),
        _ => Mat::from_fn(n, m, |i, j| a[[i, j]]),
    }
}

/// A copy that lies row by row.
fn rows(a: &Mat<f64>) -> Array2<f64> {
    Array2::from_shape_fn((a.nrows(), a.ncols()), |(i, j)| a[(i, j)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn the_largest_component_of_an_eigenvector_is_positive() {
        let a = array![[2.0, -1.0, 0.3], [-1.0, 2.0, 0.5], [0.3, 0.5, -3.0]];
        for a in [a.clone(), -a] {
            let (_, v) = Faer::symmetric_eigen(&a).unwrap();
            assert!(v.columns().into_iter().all(|v| largest(v) > 0.0));
        }
        // The first of equals.
        let (_, v) = Faer::symmetric_eigen(&array![[0.0, -1.0], [-1.0, 0.0]]).unwrap();
        assert!(v[[0, 0]] > 0.0 && v[[0, 1]] > 0.0);
    }
}
