//! What a search knows of balls: whether an atom in one of them may be the best.

use super::ball_tree::{Balls, FAR, LEAF, Lanes, NEAR};
use super::micro_gemm::{Products, vectors, vectors_mut};
use super::panel_kernel::add_product;
use super::single_search::{BELOW, Sweep};
use pulp::Simd;

/// The test that a ball has to pass.
#[derive(Clone, Copy, Default)]
pub struct Bar {
    key: f32,
    /// √(|r|² − key).
    beside: f32,
    /// How much rounding widens a ball beyond [`FAR`] of the chosen span, and one beyond [`NEAR`].
    far: f32,
    near: f32,
}

/// |<m, r>|, and |m|² in the complement of the chosen directions, for eight balls.
#[derive(Clone, Copy)]
pub struct Measured<S: Simd, const V: usize> {
    along: [S::f32s; V],
    left: [S::f32s; V],
}

impl<S: Simd, const V: usize> Measured<S, V> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        Measured {
            along: [simd.splat_f32s(0.0); V],
            left: [simd.splat_f32s(0.0); V],
        }
    }
}

impl<S: Simd, const N: usize, const V: usize> Sweep<'_, S, N, V> {
    /// |<m, r>|, and |m|² in the complement of the chosen directions, from the products of eight centers.
    #[inline(always)]
    pub fn measured(&mut self, balls: &Balls, sums: &Products<S, N, V>) -> Measured<S, V> {
        self.spent.balls += 1;
        let simd = self.simd;
        let mut measured = Measured::none(simd);
        for v in 0..V {
            let mut left = vectors::<S>(&balls.norms)[v];
            if self.optimised {
                for n in 1..N {
                    left = add_product(simd, simd.neg_f32s(sums[n][v]), sums[n][v], left);
                }
            }
            measured.along[v] = simd.abs_f32s(sums[0][v]);
            measured.left[v] = left;
        }
        measured
    }

    /// Approximate scores of the centers, to choose where to start.
    #[inline(always)]
    pub fn score(&self, measured: &Measured<S, V>) -> Lanes {
        let simd = self.simd;
        let mut score = Lanes::ZERO;
        for v in 0..V {
            let (along, left) = (measured.along[v], measured.left[v]);
            let under = simd.max_f32s(left, simd.splat_f32s(NEAR * NEAR));
            vectors_mut::<S>(&mut score)[v] = simd.div_f32s(simd.mul_f32s(along, along), under);
        }
        score
    }

    /// Adds `mark` to those of eight balls that may hold the best atom.
    #[inline(always)]
    pub fn open(
        &self,
        balls: &Balls,
        measured: &Measured<S, V>,
        mark: u16,
        open: &mut [u16; LEAF],
    ) {
        if self.is_given_up {
            return;
        }
        let excess = self.excess(balls, measured);
        // Without a branch, which could not be predicted.
        for (open, excess) in open.iter_mut().zip(excess.0) {
            *open |= mark * u16::from(excess >= 0.0);
        }
    }

    /// A number that is negative if no atom of the ball can reach the key.
    #[inline(always)]
    fn excess(&self, balls: &Balls, measured: &Measured<S, V>) -> Lanes {
        let simd = self.simd;
        let (key, beside) = (
            simd.splat_f32s(self.bar.key),
            simd.splat_f32s(self.bar.beside),
        );
        let (far, near) = (
            simd.splat_f32s(self.bar.far),
            simd.splat_f32s(self.bar.near),
        );
        let (product, rest) = (
            simd.splat_f32s(self.noise.product),
            simd.splat_f32s(self.noise.rest),
        );
        let mut excess = Lanes::ZERO;
        for v in 0..V {
            let (along, left) = (measured.along[v], measured.left[v]);
            let is_far = simd.greater_than_f32s(left, vectors::<S>(&balls.far)[v]);
            let wider = simd.select_f32s(is_far, far, near);
            let radius = simd.add_f32s(vectors::<S>(&balls.radii)[v], wider);
            let reach = add_product(simd, beside, radius, simd.add_f32s(along, product));
            let wide = simd.sub_f32s(left, rest);
            let wide = add_product(simd, simd.neg_f32s(radius), radius, wide);
            let more = simd.sub_f32s(simd.mul_f32s(reach, reach), simd.mul_f32s(key, wide));
            let near = simd.sub_f32s(vectors::<S>(&balls.near)[v], left);
            vectors_mut::<S>(&mut excess)[v] = match self.optimised {
                true => simd.max_f32s(more, near),
                false => more,
            };
        }
        excess
    }

    /// Raises the lower bound of the best score to `key`.
    ///
    /// An atom a (in the complement of the chosen directions) can reach the key if |<a, r>| + δ >= √key |a|, where δ bounds
    /// the rounding errors of <a, r> and of |a|. So it lies near the cone of vectors that reach the key exactly. With the
    /// angle α of the cone, cos α = √key / |r|, and α + φ the angle of the atom,
    ///
    /// ```text
    /// δ >= |a| |r| (cos α - cos(α + φ)) = |a| |r| 2 sin(α + φ/2) sin(φ/2),    distance = |a| sin φ <= 2 |a| sin(φ/2)
    /// ```
    ///
    /// α + φ is at most 90°, because the cone opens to both sides. So the distance to the cone is at most δ / (|r| sin α),
    /// and at most √(2 |a| δ / |r|) with |a| <= 1. Balls are widened by this distance.
    #[inline(always)]
    pub fn raise(&mut self, key: f32) {
        self.key = key;
        let (noise, left) = (self.noise, self.sought.path.left);
        // Rounding can make the key larger than |r|²: then the cone is a ray.
        let key = key.min(left) * BELOW;
        // Divisors are rounded down, limits up.
        let beside = |left: f32| (left - key).max(0.0).sqrt();
        let (least, most) = (beside(left * BELOW), beside(left * (2.0 - BELOW)));
        let wider = |gap: f32| -> f32 {
            let slack = match self.optimised {
                true => noise.product + key.sqrt() * noise.rest / (gap * 0.99),
                false => noise.product,
            };
            (slack / least).min((2.0 * slack / left.sqrt()).sqrt()) * 1.001
        };
        self.bar = Bar {
            key,
            beside: most * (2.0 - BELOW),
            far: wider(FAR),
            near: wider(NEAR),
        };
    }
}
