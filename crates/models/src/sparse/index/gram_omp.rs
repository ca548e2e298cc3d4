//! Steps of pursuit for one pose after its first, by rows of the Gram matrix: c and e of the pose
//! stay in the nearest cache.

use super::super::SelectionRule;
use super::argmax::LaneArgmax;
use super::dense_scan::DenseScan;
use super::gram::Term;
use super::packed_atoms::{INDICES, PackedAtoms, Row, WIDTH};
use super::panel_kernel::{self, Optimized, Plain, Update, Vectors};
use crate::numeric::simd;
use pulp::{Simd, WithSimd};

/// c and e of all atoms for one pose, a row per panel; see [`super::dense_scan`].
pub(crate) struct GramOmp {
    correlations: Vec<Row>,
    remainders: Vec<Row>,
}

impl GramOmp {
    /// A state for any pose.
    pub(crate) fn new(panels: &PackedAtoms) -> GramOmp {
        let rows = vec![Row::ZERO; panels.iter().len()];
        GramOmp {
            correlations: rows.clone(),
            remainders: rows,
        }
    }

    /// Starts with the correlations that a dense scan has found for a pose.
    pub(crate) fn start(&mut self, scan: &DenseScan<'_>, pose: usize) {
        simd::dispatch8(
            #[inline(always)]
            || {
                let rows = self.correlations.iter_mut().zip(scan.of_pose(pose));
                rows.for_each(|(to, from)| *to = *from);
                self.remainders.fill(Row([1.0; WIDTH]));
            },
        );
    }

    /// Excludes an atom.
    pub(crate) fn exclude(&mut self, atom: u32) {
        self.correlations[atom as usize / WIDTH].0[atom as usize % WIDTH] = f32::NAN;
    }

    /// The best atom after the newest direction, the sum of `terms`, along which the residual had
    /// `−part`.
    pub(crate) fn next(
        &mut self,
        terms: &[Term<'_>],
        part: f32,
        rule: SelectionRule,
    ) -> Option<u32> {
        simd::dispatch_widest(Step {
            rule,
            terms,
            part,
            correlations: &mut self.correlations,
            remainders: &mut self.remainders,
        })
    }
}

/// A step over all panels.
struct Step<'a> {
    rule: SelectionRule,
    terms: &'a [Term<'a>],
    part: f32,
    correlations: &'a mut [Row],
    remainders: &'a mut [Row],
}

impl WithSimd for Step<'_> {
    type Output = Option<u32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<u32> {
        match self.rule {
            SelectionRule::Omp => self.of_rule::<S, Plain<true>>(simd),
            SelectionRule::Oomp => self.of_rule::<S, Optimized<true>>(simd),
        }
    }
}

impl Step<'_> {
    #[inline(always)]
    fn of_rule<S: Simd, U: Update>(self, simd: S) -> Option<u32> {
        // So many vectors hold a panel's atoms.
        match S::F32_LANES {
            16 => self.go::<S, U, 4>(simd),
            8 => self.go::<S, U, 8>(simd),
            4 => self.go::<S, U, 16>(simd),
            _ => self.go::<S, U, WIDTH>(simd),
        }
    }

    #[inline(always)]
    fn go<S: Simd, U: Update, const VECTORS: usize>(self, simd: S) -> Option<u32> {
        let part = simd.splat_f32s(self.part);
        let indices = vectors::<S>(&INDICES);
        let mut best = [LaneArgmax::none(simd); VECTORS];
        let rows = self.correlations.iter_mut().zip(self.remainders);
        for (panel, (c, e)) in rows.enumerate() {
            let mut products = [simd.splat_f32s(0.0); VECTORS];
            for (weight, row) in self.terms {
                let (weight, row) = (simd.splat_f32s(*weight), vectors::<S>(&row[panel]));
                for v in 0..VECTORS {
                    products[v] = panel_kernel::add_product(simd, weight, row[v], products[v]);
                }
            }
            let panel = simd.splat_f32s((panel * WIDTH) as f32);
            for v in 0..VECTORS {
                let state = Vectors {
                    c: panel_kernel::vector::<S>(c, v),
                    e: Some(panel_kernel::vector::<S>(e, v)),
                    floor: None,
                };
                if let Some((over, under)) = U::update(simd, products[v], part, state) {
                    best[v].compare(simd, over, under, simd.add_f32s(panel, indices[v]));
                }
            }
        }
        LaneArgmax::best(simd, best)
    }
}

#[inline(always)]
fn vectors<S: Simd>(row: &Row) -> &[S::f32s] {
    S::as_simd_f32s(&row.0).0
}
