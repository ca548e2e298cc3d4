//! LAPACK of OpenBLAS: the only file that names `ndarray_linalg`.

use super::BackEnd;
use ndarray::{Array1, Array2};
use ndarray_linalg::{CholeskyInto, Diag, Eigh, FactorizeCInto, SolveC, SolveTriangular, UPLO};

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

impl BackEnd for OpenBlas {
    /// L, and zeros above the diagonal.
    type Factor = Array2<f64>;

    fn cholesky_solve(a: Array2<f64>, b: Array1<f64>) -> Option<Array1<f64>> {
        on_one_thread();
        let factors = a.factorizec_into(UPLO::Lower).ok()?;
        factors.solvec_into(b).ok()
    }

    fn factorize(a: Array2<f64>) -> Option<Self::Factor> {
        on_one_thread();
        a.cholesky_into(UPLO::Lower).ok()
    }

    fn half_solve(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>> {
        l.solve_triangular(UPLO::Lower, Diag::NonUnit, b).ok()
    }

    fn half_solve_transposed(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>> {
        let upper = l.t().to_owned();
        upper.solve_triangular(UPLO::Upper, Diag::NonUnit, b).ok()
    }

    fn symmetric_eigen(a: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
        on_one_thread();
        a.eigh(UPLO::Lower).ok()
    }
}
