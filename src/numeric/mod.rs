//! Numerics that every room above uses: dense, sparse and small linear algebra, L-BFGS,
//! Levenberg-Marquardt, Gaussians, interpolation, SIMD, deterministic parallelism.

pub(crate) mod assignment;
pub(crate) mod butterworth;
pub(crate) mod gaussian;
pub(crate) mod hermite;
pub(crate) mod lbfgs;
pub(crate) mod levenberg_marquardt;
pub(crate) mod linalg;
pub(crate) mod nnls;
pub mod parallel;
pub(crate) mod pchip;
pub(crate) mod product;
pub(crate) mod simd;
pub(crate) mod small_linalg;
pub(crate) mod sparse_cholesky;
pub(crate) mod statistics;
pub(crate) mod track_noise;
