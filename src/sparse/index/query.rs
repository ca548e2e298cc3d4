//! The input of a tree search: a pose's signal, residual and chosen directions, and bounds of rounding errors.

use super::super::active_set::ActiveSet;
use super::leaf_products::CHAINS;
use super::pca_projection::{HEAD, PcaProjection, Projected, Turned};

/// Roundings in a sum beside those of its terms, generously.
const SOME: usize = 8;

/// The state of matching pursuit for one pose, as the search reads it.
pub struct OmpQuery {
    d: usize,
    /// (1 + atoms, D): the signal, then the chosen directions.
    pub vectors: Vec<f32>,
    /// PCA coordinates of the residual, then of the chosen directions.
    pub heads: Vec<Projected>,
    /// The residual in the PCA basis, in double precision.
    residual: Turned,
    /// −<q, r> of each direction.
    pub parts: Vec<f32>,
    /// |residual|².
    pub left: f32,
}

impl OmpQuery {
    /// A state for vectors of `d` coordinates.
    pub fn new(d: usize) -> OmpQuery {
        OmpQuery {
            d,
            vectors: Vec::new(),
            heads: Vec::new(),
            residual: Turned::NONE,
            parts: Vec::new(),
            left: 0.0,
        }
    }

    /// D.
    pub fn width(&self) -> usize {
        self.d
    }

    /// Starts with a pose that has no atoms yet.
    pub fn begin(&mut self, basis: &PcaProjection, fit: &ActiveSet) {
        self.vectors.clear();
        self.vectors
            .extend(fit.residual().iter().map(|v| *v as f32));
        self.residual = basis.turned(fit.residual());
        self.heads.clear();
        self.heads.push(self.residual.head());
        self.parts.clear();
        self.left = fit.left() as f32;
    }

    /// Adds the direction of the newest atom.
    pub fn take(&mut self, basis: &PcaProjection, fit: &ActiveSet) {
        let (q, z) = fit.newest();
        self.vectors.extend(q.iter().map(|v| *v as f32));
        let turned = basis.turned(q);
        self.heads.push(turned.head());
        self.parts.push(-z as f32);
        self.residual.less(z, &turned, fit.left());
        self.heads[0] = self.residual.head();
        self.left = fit.left() as f32;
    }

    /// Bounds of the rounding errors of c and e.
    ///
    /// A sum of k products, each fused into the sum, of unit vectors errs by at most k u, u = 2^-24 (Higham, Accuracy and
    /// Stability of Numerical Algorithms, 3.1). A dense scan's
    /// c is such a sum of D terms, and one more per direction times its part. The sums here have as many terms as there are PCA
    /// coordinates, or D / 4.
    pub fn noise(&self) -> RoundingError {
        let unit = f32::EPSILON / 2.0;
        let scan = (self.d + SOME) as f32 * unit;
        let head = (HEAD + SOME) as f32 * unit;
        let summed = (self.d.div_ceil(CHAINS) + SOME) as f32 * unit;
        let parts: f32 = self.parts.iter().map(|p| p.abs()).sum();
        let here = head.max(summed * (1.0 + parts));
        let count = self.parts.len() as f32;
        RoundingError {
            product: scan * (1.0 + parts) + here,
            rest: 2.0 * (scan + head.max(summed)) * count.sqrt(),
        }
    }
}

/// Bounds of rounding errors; see [`OmpQuery::noise`].
#[derive(Debug, Clone, Copy)]
pub struct RoundingError {
    pub product: f32,
    pub rest: f32,
}
