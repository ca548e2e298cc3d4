//! Numerics that every room above uses: dense, sparse and small linear algebra, L-BFGS,
//! Levenberg-Marquardt, Gaussians, interpolation, SIMD, deterministic parallelism.

#[doc(hidden)]
pub mod anti_alias;
#[doc(hidden)]
pub mod assignment;
#[doc(hidden)]
pub mod butterworth;
#[doc(hidden)]
pub mod cubic_spline;
#[doc(hidden)]
#[doc(hidden)]
pub mod gaussian;
#[doc(hidden)]
pub mod hermite;
#[doc(hidden)]
pub mod lbfgs;
#[doc(hidden)]
pub mod levenberg_marquardt;
#[doc(hidden)]
pub mod linalg;
#[doc(hidden)]
pub mod mixing;
#[doc(hidden)]
pub mod nnls;
pub mod parallel;
#[doc(hidden)]
pub mod pchip;
#[doc(hidden)]
pub mod product;
#[doc(hidden)]
pub mod simd;
#[doc(hidden)]
pub mod small_linalg;
#[doc(hidden)]
pub mod sparse_cholesky;
#[doc(hidden)]
pub mod statistics;
#[doc(hidden)]
pub mod track_noise;
#[doc(hidden)]
pub mod union_find;
