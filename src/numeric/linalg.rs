//! Decompositions by LAPACK: the only file that names `ndarray_linalg`.

use ndarray::{Array1, Array2, s};
use ndarray_linalg::{CholeskyInto, Diag, Eigh, FactorizeCInto, SolveC, SolveTriangular, UPLO};

/// Keeps LAPACK to the thread that calls it: matrices here are small and the cores are at work on others. Threads of its
/// own would only wait for each other, and they wait by spinning.
#[allow(unsafe_code)]
fn on_one_thread() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    unsafe extern "C" {
        fn openblas_set_num_threads(threads: std::ffi::c_int);
    }
    // SAFETY: OpenBLAS, which is linked, has this function with this signature; it may be called at any time.
    ONCE.call_once(|| unsafe { openblas_set_num_threads(1) });
}

/// Solves `A x = b` for a symmetric positive definite A (n, n), of which the lower triangle is read; b has n values.
///
/// `None` when A is not positive definite, holds a value that is not finite, or does not fit b: the caller damps A
/// and tries again, or gives up.
pub fn cholesky_solve(a: Array2<f64>, b: Array1<f64>) -> Option<Array1<f64>> {
    let n = b.len();
    if a.dim() != (n, n) || !a.iter().chain(&b).all(|v| v.is_finite()) {
        return None;
    }
    if n == 0 {
        return Some(b);
    }
    on_one_thread();
    let factors = a.factorizec_into(UPLO::Lower).ok()?;
    let x = factors.solvec_into(b).ok()?;
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// The Cholesky factor L of a symmetric positive definite matrix A (n, n) = L Lᵀ.
#[derive(Debug, Clone)]
pub struct Cholesky(Array2<f64>);

impl Cholesky {
    /// Factors `a`, of which the lower triangle is read. `None` when it is not positive definite or not finite.
    pub fn new(a: Array2<f64>) -> Option<Cholesky> {
        if a.nrows() != a.ncols() || a.is_empty() || !a.iter().all(|v| v.is_finite()) {
            return None;
        }
        on_one_thread();
        a.cholesky_into(UPLO::Lower).ok().map(Cholesky)
    }

    /// L⁻¹ `b`, for b (n, m).
    pub fn half_solve(&self, b: &Array2<f64>) -> Option<Array2<f64>> {
        (self.0)
            .solve_triangular(UPLO::Lower, Diag::NonUnit, b)
            .ok()
    }

    /// A⁻¹ `b`, for b (n, m).
    pub fn solve(&self, b: &Array2<f64>) -> Option<Array2<f64>> {
        self.half_solve_transposed(&self.half_solve(b)?)
    }

    /// L⁻ᵀ `b`, for b (n, m).
    pub fn half_solve_transposed(&self, b: &Array2<f64>) -> Option<Array2<f64>> {
        let upper = self.0.t().to_owned();
        upper.solve_triangular(UPLO::Upper, Diag::NonUnit, b).ok()
    }
}

/// Eigenvalues in rising order and unit eigenvectors in columns of a symmetric matrix (n, n), of which the lower
/// triangle is read. `None` when it is not square, not finite, or LAPACK gives up.
pub fn symmetric_eigen(a: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
    if a.nrows() != a.ncols() || !a.iter().all(|v| v.is_finite()) {
        return None;
    }
    if a.is_empty() {
        return Some((Array1::zeros(0), Array2::zeros((0, 0))));
    }
    on_one_thread();
    a.eigh(UPLO::Lower).ok()
}

/// The generalised eigenproblem A w = λ B w for a symmetric A and a symmetric positive definite B, both (n, n): the λ in
/// falling order, and the w in columns, scaled so that Wᵀ B W = I. So Wᵀ A W holds the λ on its diagonal.
///
/// With B = L Lᵀ and w = L⁻ᵀ v it is the problem (L⁻¹ A L⁻ᵀ) v = λ v (Golub and Van Loan, Matrix Computations, 8.7).
/// `None` when B is not positive definite, the shapes differ, or a value is not finite.
pub fn generalised_eigen(a: &Array2<f64>, b: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
    if a.dim() != b.dim() || !a.iter().all(|v| v.is_finite()) {
        return None;
    }
    let factor = Cholesky::new(b.clone())?;
    let half = factor.half_solve(a)?;
    let whitened = factor.half_solve(&half.t().as_standard_layout().into_owned())?;
    let (values, v) = symmetric_eigen(&whitened)?;
    let w = factor.half_solve_transposed(&v.as_standard_layout().into_owned())?;
    let falling = |w: Array2<f64>| w.slice(s![.., ..;-1]).as_standard_layout().into_owned();
    Some((values.slice(s![..;-1]).to_owned(), falling(w)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{ShapeBuilder, array};

    #[test]
    fn a_positive_definite_system_is_solved_in_both_layouts() {
        let rows = array![[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]];
        let mut columns = Array2::zeros((3, 3).f());
        columns.assign(&rows);
        let x = array![1.0, -2.0, 0.25];
        for a in [rows, columns] {
            let got = cholesky_solve(a.clone(), a.dot(&x)).unwrap();
            assert!((&got - &x).iter().all(|e| e.abs() <= 1e-14));
        }
    }

    #[test]
    fn a_factor_solves_for_many_columns() {
        let a = array![[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]];
        let x = array![[1.0, 2.0], [-2.0, 0.0], [0.25, 1.0]];
        let factor = Cholesky::new(a.clone()).unwrap();
        let b = a.dot(&x);
        let got = factor.solve(&b).unwrap();
        assert!((&got - &x).iter().all(|e| e.abs() <= 1e-14));
        // |L⁻¹ b|² = bᵀ A⁻¹ b.
        let half = factor.half_solve(&b).unwrap();
        assert!(
            (half.t().dot(&half) - b.t().dot(&x))
                .iter()
                .all(|e| e.abs() <= 1e-12)
        );
        assert!(Cholesky::new(array![[1.0, 2.0], [2.0, 1.0]]).is_none());
    }

    #[test]
    fn what_cannot_be_solved_is_told() {
        assert!(cholesky_solve(array![[1.0, 2.0], [2.0, 1.0]], array![1.0, 1.0]).is_none());
        assert!(cholesky_solve(array![[f64::NAN]], array![1.0]).is_none());
        assert!(cholesky_solve(array![[1.0]], array![1.0, 2.0]).is_none());
        assert!(cholesky_solve(Array2::zeros((0, 0)), Array1::zeros(0)).is_some());
        assert!(symmetric_eigen(&array![[f64::INFINITY]]).is_none());
    }

    #[test]
    fn eigenvectors_give_the_matrix_back() {
        let a = array![[2.0, -1.0, 0.0], [-1.0, 2.0, 0.5], [0.0, 0.5, -3.0]];
        let (values, v) = symmetric_eigen(&a).unwrap();
        assert!(values[0] <= values[1] && values[1] <= values[2]);
        let back = v.dot(&Array2::from_diag(&values)).dot(&v.t());
        assert!((&back - &a).iter().all(|e| e.abs() <= 1e-14));
    }

    #[test]
    fn generalised_eigenvectors_are_white_under_b_and_diagonal_under_a() {
        let a = array![[2.0, -1.0, 0.0], [-1.0, 2.0, 0.5], [0.0, 0.5, -3.0]];
        let b = array![[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]];
        let (values, w) = generalised_eigen(&a, &b).unwrap();
        assert!(values[0] >= values[1] && values[1] >= values[2]);
        let white = w.t().dot(&b).dot(&w) - Array2::<f64>::eye(3);
        assert!(white.iter().all(|e| e.abs() <= 1e-14));
        let rest = a.dot(&w) - b.dot(&w).dot(&Array2::from_diag(&values));
        assert!(rest.iter().all(|e| e.abs() <= 1e-13));
        let (one, w) = generalised_eigen(&array![[3.0]], &array![[4.0]]).unwrap();
        assert!((one[0] - 0.75).abs() <= 1e-15 && (w[[0, 0]].abs() - 0.5).abs() <= 1e-15);
        assert!(generalised_eigen(&a, &a).is_none());
        assert!(generalised_eigen(&array![[f64::NAN]], &array![[1.0]]).is_none());
        assert!(generalised_eigen(&array![[1.0]], &b).is_none());
    }
}
