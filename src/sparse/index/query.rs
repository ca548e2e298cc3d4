//! What a pruned search knows of a pose: its signal, and the directions of the atoms that it took.

use super::super::active_set::ActiveSet;
use super::leaf_products::CHAINS;
use super::pca_projection::{HEAD, PcaProjection, Projected, Turned};

/// Roundings beside those of a sum's terms.
const SOME: usize = 8;

/// A pose on its way.
pub struct OmpQuery {
    d: usize,
    /// The signal, then the directions taken, D each.
    pub vectors: Vec<f32>,
    /// The residual, then the directions taken, in the basis of the bounds.
    pub heads: Vec<Projected>,
    /// What is left, in that basis.
    residual: Turned,
    /// −<q, r> of each direction.
    pub parts: Vec<f32>,
    /// |residual|².
    pub left: f32,
}

impl OmpQuery {
    /// For vectors of `d` numbers.
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

    /// Begins with a pose that has no atoms yet.
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

    /// Takes the direction of the newest atom along.
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

    /// What rounding may change, in a scan and here, of a product of an atom with the residual and of what is left of the
    /// atom's square.
    ///
    /// A sum of k products, each fused into it, of unit vectors errs by k u at most, u = 2^-24 (Higham, Accuracy and
    /// Stability of Numerical Algorithms, 3.1); some more are for numbers that were rounded themselves. The scan's c is such
    /// a sum of D and one more a direction, times its part. Here sums are of a head's numbers, or of a quarter of D at most.
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

/// Bounds of rounding; see [`OmpQuery::noise`].
#[derive(Debug, Clone, Copy)]
pub struct RoundingError {
    pub product: f32,
    pub rest: f32,
}
