//! Decompositions of dense symmetric matrices, by LAPACK (OpenBLAS) with the feature `openblas`, by
//! faer without it; and products of matrices with themselves, by faer.
//!
//! The two agree but for rounding, and for what is arbitrary: the signs of eigenvectors, and the
//! basis of those that share an eigenvalue. With faer the largest component of an eigenvector is
//! positive; LAPACK has no rule. Nothing that callers measure or restore depends on signs. What
//! they store of directions has those of the back end that it was learned with: projections of
//! metrics, factors of mixtures, latent points, shape components and the numbers that go with them.

mod gram;
// Tests have both.
#[cfg(any(test, not(feature = "openblas")))]
mod faer;
#[cfg(feature = "openblas")]
mod openblas;

#[cfg(not(feature = "openblas"))]
use self::faer::Faer as Chosen;
#[cfg(feature = "openblas")]
use self::openblas::OpenBlas as Chosen;

pub use self::gram::gram;
use ndarray::{Array1, Array2, s};
use std::fmt::Debug;

/// What the functions below ask of a library. Matrices are square, not empty and finite, and shapes
/// fit.
trait BackEnd {
    /// The factor of the Cholesky decomposition.
    type Factor: Clone + Debug;

    fn cholesky_solve(a: Array2<f64>, b: Array1<f64>) -> Option<Array1<f64>>;

    fn factorize(a: Array2<f64>) -> Option<Self::Factor>;

    /// L⁻¹ b. Here and below, b may hold what is not finite.
    fn half_solve(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>>;

    /// L⁻ᵀ b.
    fn half_solve_transposed(l: &Self::Factor, b: &Array2<f64>) -> Option<Array2<f64>>;

    fn symmetric_eigen(a: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)>;
}

/// Solves `A x = b` for a symmetric positive definite A (n, n), of which the lower triangle is
/// read; b has n values.
///
/// `None` when A is not positive definite, holds a value that is not finite, or does not fit b: the
/// caller damps A and tries again, or gives up.
pub fn cholesky_solve(a: Array2<f64>, b: Array1<f64>) -> Option<Array1<f64>> {
    let n = b.len();
    if a.dim() != (n, n) || !a.iter().chain(&b).all(|v| v.is_finite()) {
        return None;
    }
    if n == 0 {
        return Some(b);
    }
    let x = Chosen::cholesky_solve(a, b)?;
    x.iter().all(|v| v.is_finite()).then_some(x)
}

/// The Cholesky factor L of a symmetric positive definite matrix A (n, n) = L Lᵀ.
#[derive(Debug, Clone)]
pub struct Cholesky(<Chosen as BackEnd>::Factor);

impl Cholesky {
    /// Factors `a`, of which the lower triangle is read. `None` when it is empty, not positive
    /// definite or not finite.
    #[doc(hidden)]
    pub fn new(a: Array2<f64>) -> Option<Cholesky> {
        if a.nrows() != a.ncols() || a.is_empty() || !a.iter().all(|v| v.is_finite()) {
            return None;
        }
        Chosen::factorize(a).map(Cholesky)
    }

    /// L⁻¹ `b`, for b (n, m). A column with a value that is not finite gives such a column. `None`
    /// when b has not n rows.
    pub fn half_solve(&self, b: &Array2<f64>) -> Option<Array2<f64>> {
        self.fits(b)?;
        Chosen::half_solve(&self.0, b)
    }

    /// A⁻¹ `b`, for b (n, m), else as [`Cholesky::half_solve`].
    #[doc(hidden)]
    pub fn solve(&self, b: &Array2<f64>) -> Option<Array2<f64>> {
        self.half_solve_transposed(&self.half_solve(b)?)
    }

    /// L⁻ᵀ `b`, for b (n, m), else as [`Cholesky::half_solve`].
    pub fn half_solve_transposed(&self, b: &Array2<f64>) -> Option<Array2<f64>> {
        self.fits(b)?;
        Chosen::half_solve_transposed(&self.0, b)
    }

    fn fits(&self, b: &Array2<f64>) -> Option<()> {
        (b.nrows() == self.0.nrows()).then_some(())
    }
}

/// Eigenvalues in rising order and unit eigenvectors in columns of a symmetric matrix (n, n), of
/// which the upper triangle is read, or the lower one where it lies column by column in memory.
/// `None` when it is not square, not finite, or the steps do not converge, which no symmetric
/// matrix is known to do.
pub fn symmetric_eigen(a: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
    if a.nrows() != a.ncols() || !a.iter().all(|v| v.is_finite()) {
        return None;
    }
    if a.is_empty() {
        return Some((Array1::zeros(0), Array2::zeros((0, 0))));
    }
    Chosen::symmetric_eigen(a)
}

/// The generalized eigenproblem A w = λ B w for a symmetric A and a symmetric positive definite B,
/// both (n, n): the λ in falling order, and the w in columns, scaled so that Wᵀ B W = I. So Wᵀ A W
/// holds the λ on its diagonal.
///
/// With B = L Lᵀ and w = L⁻ᵀ v it is the problem (L⁻¹ A L⁻ᵀ) v = λ v (Golub and Van Loan, Matrix
/// Computations, 8.7). `None` when B is not positive definite, the shapes differ, or a value is not
/// finite.
pub fn generalized_eigen(a: &Array2<f64>, b: &Array2<f64>) -> Option<(Array1<f64>, Array2<f64>)> {
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
    use crate::numeric::parallel;
    use ndarray::{ShapeBuilder, array};
    use rand::Rng;

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
    fn generalized_eigenvectors_are_white_under_b_and_diagonal_under_a() {
        let a = array![[2.0, -1.0, 0.0], [-1.0, 2.0, 0.5], [0.0, 0.5, -3.0]];
        let b = array![[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]];
        let (values, w) = generalized_eigen(&a, &b).unwrap();
        assert!(values[0] >= values[1] && values[1] >= values[2]);
        let white = w.t().dot(&b).dot(&w) - Array2::<f64>::eye(3);
        assert!(white.iter().all(|e| e.abs() <= 1e-14));
        let rest = a.dot(&w) - b.dot(&w).dot(&Array2::from_diag(&values));
        assert!(rest.iter().all(|e| e.abs() <= 1e-13));
        let (one, w) = generalized_eigen(&array![[3.0]], &array![[4.0]]).unwrap();
        assert!((one[0] - 0.75).abs() <= 1e-15 && (w[[0, 0]].abs() - 0.5).abs() <= 1e-15);
        assert!(generalized_eigen(&a, &a).is_none());
        assert!(generalized_eigen(&array![[f64::NAN]], &array![[1.0]]).is_none());
        assert!(generalized_eigen(&array![[1.0]], &b).is_none());
    }

    /// 1, 2 and what the built-in body, two of it, and a window of poses come to.
    const SIZES: [usize; 5] = [1, 2, 69, 120, 300];

    /// Makes a test of a check that holds for every back end.
    macro_rules! of_each {
        ($($test:ident: $check:ident,)*) => {$(
            #[test]
            fn $test() {
                #[cfg(feature = "openblas")]
                $check::<Chosen>();
                $check::<faer::Faer>();
            }
        )*};
    }

    of_each! {
        random_systems_are_solved_at_every_size: systems,
        numbers_that_are_not_finite_stay_in_their_column: columns_apart,
        eigenvectors_give_random_matrices_back_at_every_size: eigenvectors,
        what_is_not_positive_definite_has_no_factor: refusals,
        one_triangle_is_read: triangles,
    }

    fn random(n: usize, m: usize, seed: u64) -> Array2<f64> {
        let mut rng = parallel::rng(seed, n as u64);
        Array2::from_shape_fn((n, m), |_| rng.random_range(-1.0..1.0))
    }

    /// Exactly symmetric, of a rank.
    fn gram(n: usize, rank: usize) -> Array2<f64> {
        let x = random(rank, n, 1);
        let mut gram = x.t().dot(&x);
        (0..n).for_each(|i| (0..i).for_each(|j| gram[[i, j]] = gram[[j, i]]));
        gram
    }

    fn positive(n: usize) -> Array2<f64> {
        gram(n, 2 * n)
    }

    /// The matrix, column by column in memory.
    fn by_columns(a: &Array2<f64>) -> Array2<f64> {
        let mut columns = Array2::zeros(a.raw_dim().f());
        columns.assign(a);
        columns
    }

    fn largest<D: ndarray::Dimension>(a: &ndarray::Array<f64, D>) -> f64 {
        let larger = |most: f64, v: &f64| if v.abs() <= most { most } else { v.abs() };
        a.iter().fold(0.0, larger)
    }

    fn solved<B: BackEnd>(a: Array2<f64>, b: &Array2<f64>) -> Array2<f64> {
        let factor = B::factorize(a).unwrap();
        let half = B::half_solve(&factor, b).unwrap();
        B::half_solve_transposed(&factor, &half).unwrap()
    }

    fn systems<B: BackEnd>() {
        for n in SIZES {
            let a = positive(n);
            let b = random(n, 7, 2);
            let x = solved::<B>(a.clone(), &b);
            let bound = 1e-14 * n as f64 * (largest(&a) * largest(&x) + largest(&b));
            assert!(largest(&(a.dot(&x) - &b)) <= bound, "{n}");
            // In whatever order numbers lie.
            let others = [
                solved::<B>(by_columns(&a), &b),
                solved::<B>(a.clone(), &by_columns(&b)),
            ];
            for other in others {
                assert!(largest(&(other - &x)) <= 1e-10 * largest(&x), "{n}");
            }
            for a in [a.clone(), by_columns(&a)] {
                let got = B::cholesky_solve(a, b.column(4).to_owned()).unwrap();
                assert!(largest(&(got - x.column(4))) <= 1e-10 * largest(&x), "{n}");
            }
            // |L⁻¹ b|² = bᵀ A⁻¹ b.
            let half = B::half_solve(&B::factorize(a).unwrap(), &b).unwrap();
            let squares = b.t().dot(&x);
            let error = largest(&(half.t().dot(&half) - &squares));
            assert!(error <= 1e-11 * largest(&squares), "{n}: {error}");
        }
    }

    fn columns_apart<B: BackEnd>() {
        for n in SIZES {
            let a = positive(n);
            let b = random(n, 5, 6);
            let x = solved::<B>(a.clone(), &b);
            let mut spoiled = b.clone();
            spoiled[[n / 2, 3]] = f64::NAN;
            let got = solved::<B>(a.clone(), &spoiled);
            assert!(got.column(3).iter().any(|v| v.is_nan()));
            for k in [0, 1, 2, 4] {
                let error = largest(&(&got.column(k) - &x.column(k)));
                assert!(error <= 1e-10 * largest(&x), "{n}: {error}");
            }
            let none = solved::<B>(a, &Array2::zeros((n, 0)));
            assert_eq!(none.dim(), (n, 0));
        }
    }

    fn eigenvectors<B: BackEnd>() {
        for n in SIZES {
            let symmetric = random(n, n, 3);
            let symmetric = &symmetric + &symmetric.t();
            let halves = Array2::from_diag(&Array1::from_shape_fn(n, |i| (i % 2) as f64));
            let matrices = [
                positive(n),
                // Most eigenvalues are 0.
                gram(n, 3),
                Array2::zeros((n, n)),
                // One eigenvalue or two, each of many vectors.
                Array2::eye(n),
                halves,
                &symmetric * 1e-10,
                &symmetric * 1e300,
                &symmetric * 1e-300,
                by_columns(&symmetric),
            ];
            for (k, a) in matrices.iter().enumerate() {
                let (values, v) = B::symmetric_eigen(a).unwrap();
                assert!(values.windows(2).into_iter().all(|w| w[0] <= w[1]));
                let error = largest(&(v.t().dot(&v) - Array2::<f64>::eye(n)));
                assert!(error <= 1e-13, "{k} of {n}: {error}");
                let size = largest(a).max(f64::MIN_POSITIVE);
                let back = (&v * &(values / size)).dot(&v.t());
                let error = largest(&(back - a / size));
                assert!(error <= 1e-14 * (10 + n) as f64, "{k} of {n}: {error}");
            }
        }
    }

    fn refusals<B: BackEnd>() {
        let refused = |a: Array2<f64>| {
            let b = Array1::ones(a.nrows());
            B::factorize(by_columns(&a)).is_none()
                && B::factorize(a.clone()).is_none()
                && B::cholesky_solve(a, b).is_none()
        };
        for n in SIZES {
            assert!(refused(Array2::zeros((n, n))));
            assert!(refused(-positive(n)));
            // All pivots but the last are positive.
            let mut last = Array2::eye(n);
            last[[n - 1, n - 1]] = -1e-3;
            assert!(refused(last));
            // Squares overflow.
            let mut large = Array2::<f64>::eye(n);
            large.column_mut(0).fill(1e200);
            assert_eq!(refused(large), n > 1);
            // Singular but for rounding: with or without an answer.
            B::cholesky_solve(gram(n, n.div_ceil(3)), Array1::ones(n));
        }
        assert!(refused(Array2::ones((2, 2))));
    }

    fn triangles<B: BackEnd>() {
        for n in [2, 69, 120] {
            let a = positive(n);
            let b = random(n, 1, 4);
            let spoiled = |lower: bool| {
                let spoils = |i: usize, j: usize| if lower { i > j } else { i < j };
                Array2::from_shape_fn((n, n), |(i, j)| a[[i, j]] + f64::from(spoils(i, j)))
            };
            let x = solved::<B>(a.clone(), &b);
            for a in [spoiled(false), by_columns(&spoiled(false))] {
                assert!(largest(&(solved::<B>(a.clone(), &b) - &x)) <= 1e-10 * largest(&x));
                let got = B::cholesky_solve(a, b.column(0).to_owned()).unwrap();
                assert!(largest(&(got - x.column(0))) <= 1e-10 * largest(&x));
            }
            let (values, _) = B::symmetric_eigen(&a).unwrap();
            for a in [spoiled(true), by_columns(&spoiled(false))] {
                let (got, _) = B::symmetric_eigen(&a).unwrap();
                assert!(largest(&(got - &values)) <= 1e-12 * values[n - 1]);
            }
        }
    }

    #[test]
    fn generalized_eigenvectors_of_random_matrices_are_white() {
        for n in SIZES {
            let (a, b) = (gram(n, n.div_ceil(2)), positive(n));
            let (values, w) = generalized_eigen(&a, &b).unwrap();
            assert!(values.windows(2).into_iter().all(|w| w[0] >= w[1]));
            let white = w.t().dot(&b).dot(&w) - Array2::<f64>::eye(n);
            assert!(largest(&white) <= 1e-10, "{n}");
            let diagonal = w.t().dot(&a).dot(&w) - Array2::from_diag(&values);
            assert!(largest(&diagonal) <= 1e-10 * values[0], "{n}");
        }
    }

    #[test]
    fn a_number_that_is_not_finite_is_told_wherever_it_stands() {
        for n in SIZES {
            let sound = || Array2::<f64>::eye(n);
            let last = n - 1;
            for at in [[0, 0], [last, 0], [0, last], [last, last], [n / 2, n / 3]] {
                for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    let mut a = sound();
                    a[at] = wrong;
                    assert!(symmetric_eigen(&a).is_none());
                    assert!(generalized_eigen(&a, &sound()).is_none());
                    assert!(generalized_eigen(&sound(), &a).is_none());
                    assert!(Cholesky::new(a.clone()).is_none());
                    assert!(cholesky_solve(a, Array1::ones(n)).is_none());
                    let mut b = Array1::ones(n);
                    b[at[0]] = wrong;
                    assert!(cholesky_solve(sound(), b).is_none());
                }
            }
        }
        // A solution beyond the largest number.
        assert!(cholesky_solve(array![[1e-300]], array![1e10]).is_none());
    }

    #[test]
    fn nothing_is_made_of_nothing_and_shapes_must_fit() {
        let empty = || Array2::zeros((0, 0));
        assert!(Cholesky::new(empty()).is_none());
        assert!(generalized_eigen(&empty(), &empty()).is_none());
        let (values, v) = symmetric_eigen(&empty()).unwrap();
        assert!(values.is_empty() && v.is_empty());
        let wide = Array2::<f64>::eye(3).slice(s![..2, ..]).to_owned();
        assert!(Cholesky::new(wide.clone()).is_none());
        assert!(symmetric_eigen(&wide).is_none());
        assert!(cholesky_solve(wide, Array1::zeros(2)).is_none());
        let factor = Cholesky::new(positive(3)).unwrap();
        for wrong in [(2, 3), (4, 3), (0, 1)] {
            assert!(factor.half_solve(&Array2::zeros(wrong)).is_none());
            assert!(
                factor
                    .half_solve_transposed(&Array2::zeros(wrong))
                    .is_none()
            );
        }
    }
}
