//! LAPACK of OpenBLAS: the only file that names `ndarray_linalg`.

use super::BackEnd;
use ndarray::{Array1, Array2, ArrayView2, ShapeBuilder};
use ndarray_linalg::{Diag, Eigh, FactorizeCInto, SolveC, SolveTriangularInto, UPLO};

/// Keeps LAPACK to the thread that calls it: matrices here are small and the cores are at work on
/// others. Threads of its own would only wait for each other, and they wait by spinning.
#[allow(unsafe_code)]
fn on_one_thread() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    unsafe extern "C" {
        fn openblas_set_num_threads(threads: std::ffi::c_int);
    }
    // SAFETY: OpenBLAS, which is linked, has this function with this signature; it may be called at
    // any time.
    ONCE.call_once(|| unsafe { openblas_set_num_threads(1) });
}

/// LAPACK of OpenBLAS.
pub(super) struct OpenBlas;

/// L and Lᵀ, column by column in memory, as LAPACK wants them: all else would be transposed each
/// time. Beyond the diagonals they hold what A had there.
#[derive(Debug, Clone)]
pub(super) struct Triangles {
    lower: Array2<f64>,
    upper: Array2<f64>,
}

impl Triangles {
    pub(super) fn nrows(&self) -> usize {
        self.lower.nrows()
    }
}

/// A copy, column by column in memory.
fn by_columns(a: ArrayView2<'_, f64>) -> Array2<f64> {
    let mut columns = Array2::zeros(a.raw_dim().f());
    columns.assign(&a);
    columns
}

impl BackEnd for OpenBlas {
    type Factor = Triangles;

    fn cholesky_solve(a: Array2<f64>, b: Array1<f64>) -> Option<Array1<f64>> {
        on_one_thread();
        let factors = a.factorizec_into(UPLO::Lower).ok()?;
        factors.solvec_into(b).ok()
    }

    fn factorize(a: Array2<f64>) -> Option<Self::Factor> {
        on_one_thread();
        // The lower triangle in rows is the upper one in columns.
        let upper = a.reversed_axes().factorizec_into(UPLO::Upper).ok()?.factor;
        Some(Triangles {
            lower: by_columns(upper.t()),
            upper,
        })
    }

    fn half_solve(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>> {
        (l.lower
            .solve_triangular_into(UPLO::Lower, Diag::NonUnit, by_columns(b.view())))
        .ok()
    }

    fn half_solve_transposed(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>> {
        (l.upper
            .solve_triangular_into(UPLO::Upper, Diag::NonUnit, by_columns(b.view())))
        .ok()
    }

    fn symmetric_eigen(a: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
        on_one_thread();
        a.eigh(UPLO::Lower).ok()
    }
}
