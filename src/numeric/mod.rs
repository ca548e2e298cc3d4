//! Numerics that every room above uses: dense, sparse and small linear algebra, L-BFGS,
//! Levenberg-Marquardt, Gaussians, SIMD, deterministic parallelism.

pub mod butterworth;
pub mod gaussian;
pub mod lbfgs;
pub(crate) mod levenberg_marquardt;
pub mod linalg;
pub mod nnls;
pub mod parallel;
pub mod pchip;
pub mod product;
pub mod simd;
pub mod small_linalg;
pub mod sparse_cholesky;
pub mod statistics;
