//! The inner loop: one panel of atoms against a few poses, and what becomes of the products.
//!
//! A tile of products <a, q> is summed in registers, coordinate after coordinate, each term fused
//! into the sum; it is used up there. So a product has the same bits whatever poses are beside it,
//! and whatever the vectors are: only a machine that cannot fuse (x86 before AVX2) rounds
//! otherwise.

use super::super::SelectionRule;
use super::argmax::StoredArgmax;
use super::packed_atoms::{INDICES, Row, WIDTH};
use pulp::{Simd, WithSimd};

/// What is left of an atom counts as at least this share of its squared norm. Below it the
/// difference of f32 numbers is rounding; a smaller value would let a copy of a chosen atom win by
/// noise.
pub(crate) const FLOOR: f32 = 1e-6;

/// An atom with at most this share of its squared norm (1) on what is observed is not seen at all.
pub(crate) const UNSEEN: f32 = 1e-20;

/// What is done with the products.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Those of squared atoms and weights: e, and its floor.
    Norms,
    /// c is the product itself.
    First,
    /// c changes, and e falls by the optimized rule.
    Next(SelectionRule),
}

/// One panel of atoms and all poses of a tile.
pub(crate) struct PanelKernel<'a> {
    pub step: Step,
    /// Which panel.
    pub panel: usize,
    /// D rows.
    pub atoms: &'a [Row],
    /// Which of the rows any pose has a number for that is not 0.
    pub used: &'a [u32],
    /// So many numbers a pose: its direction, or its weights.
    pub directions: &'a [f32],
    /// Minus what each pose has along its direction.
    pub parts: &'a [f32],
    /// The state, one row per pose.
    pub state: State<'a>,
    /// The best atom of each pose so far.
    pub best: &'a mut [StoredArgmax],
}

/// What is kept for a panel: one row per pose.
pub(crate) struct State<'a> {
    /// c; no number once the atom is taken.
    pub correlations: &'a mut [Row],
    /// e; infinite if the atom is not seen. Empty where it is 1 of all atoms.
    pub remainders: &'a mut [Row],
    /// What e counts for at least; empty where all atoms have norm 1.
    pub floors: &'a mut [Row],
}

impl WithSimd for PanelKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // As many sums as the registers hold beside the atoms and a number of a pose.
        match S::F32_LANES {
            16 => self.of_step::<S, 6, 4>(simd),
            8 => self.of_step::<S, 6, 2>(simd),
            _ => self.of_step::<S, 4, 4>(simd),
        }
    }
}

impl PanelKernel<'_> {
    #[inline(always)]
    fn of_step<S: Simd, const POSES: usize, const VECTORS: usize>(self, simd: S) {
        let unit = self.state.floors.is_empty();
        match self.step {
            Step::Norms => self.go::<S, Norms, POSES, VECTORS>(simd),
            Step::First if unit => self.go::<S, First<true>, POSES, VECTORS>(simd),
            Step::First => self.go::<S, First<false>, POSES, VECTORS>(simd),
            Step::Next(SelectionRule::Omp) if unit => {
                self.go::<S, Plain<true>, POSES, VECTORS>(simd)
            }
            Step::Next(SelectionRule::Omp) => self.go::<S, Plain<false>, POSES, VECTORS>(simd),
            Step::Next(SelectionRule::Oomp) if unit => {
                self.go::<S, Optimized<true>, POSES, VECTORS>(simd)
            }
            Step::Next(SelectionRule::Oomp) => self.go::<S, Optimized<false>, POSES, VECTORS>(simd),
        }
    }

    #[inline(always)]
    fn go<S: Simd, U: Update, const POSES: usize, const VECTORS: usize>(mut self, simd: S) {
        let poses = self.best.len();
        let whole = poses - poses % POSES;
        for from in (0..whole).step_by(POSES) {
            self.few::<S, U, POSES, VECTORS>(simd, from);
        }
        for from in whole..poses {
            self.few::<S, U, 1, VECTORS>(simd, from);
        }
    }

    /// `POSES` poses, `VECTORS` vectors of atoms at a time.
    #[inline(always)]
    fn few<S: Simd, U: Update, const POSES: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        from: usize,
    ) {
        let (d, lanes) = (self.used.len(), S::F32_LANES);
        let directions = |p: usize| &self.directions[(from + p) * d..(from + p + 1) * d];
        let directions: [&[f32]; POSES] = std::array::from_fn(directions);
        for at in (0..WIDTH / lanes).step_by(VECTORS) {
            let tile =
                products::<S, U, POSES, VECTORS>(simd, (self.atoms, self.used), directions, at);
            let indices = &S::as_simd_f32s(&INDICES.0).0[at..at + VECTORS];
            let panel = simd.splat_f32s((self.panel * WIDTH) as f32);
            for (p, products) in tile.into_iter().enumerate() {
                let pose = from + p;
                let part = simd.splat_f32s(self.parts[pose]);
                let mut best = self.best[pose].load::<S>();
                for (v, product) in products.into_iter().enumerate() {
                    let c = &mut self.state.correlations[pose];
                    let e = self.state.remainders.get_mut(pose);
                    let floor = self.state.floors.get_mut(pose);
                    let state = Vectors {
                        c: vector::<S>(c, at + v),
                        e: e.map(|e| vector::<S>(e, at + v)),
                        floor: floor.map(|f| vector::<S>(f, at + v)),
                    };
                    if let Some((over, under)) = U::update(simd, product, part, state) {
                        best.compare(simd, over, under, simd.add_f32s(panel, indices[v]));
                    }
                }
                self.best[pose].store(best);
            }
        }
    }
}

#[inline(always)]
pub(crate) fn vector<S: Simd>(row: &mut Row, v: usize) -> &mut S::f32s {
    &mut S::as_mut_simd_f32s(&mut row.0).0[v]
}

/// The products of a few poses' directions with some vectors of atoms, from one on.
#[inline(always)]
fn products<S: Simd, U: Update, const POSES: usize, const VECTORS: usize>(
    simd: S,
    (atoms, used): (&[Row], &[u32]),
    directions: [&[f32]; POSES],
    from: usize,
) -> [[S::f32s; VECTORS]; POSES] {
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; POSES];
    for (k, row) in used.iter().enumerate() {
        let row = &atoms[*row as usize];
        let row = &S::as_simd_f32s(&row.0).0[from..from + VECTORS];
        let mut row: [S::f32s; VECTORS] = std::array::from_fn(|v| row[v]);
        if U::SQUARED {
            row = row.map(|a| simd.mul_f32s(a, a));
        }
        for (sums, direction) in sums.iter_mut().zip(directions) {
            // In range: a direction has as many numbers as rows are used.
            let q = simd.splat_f32s(direction[k]);
            for (sum, a) in sums.iter_mut().zip(row) {
                *sum = add_product(simd, a, q, *sum);
            }
        }
    }
    sums
}

/// a b + c: fused wherever that is an instruction.
#[inline(always)]
pub(crate) fn add_product<S: Simd>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
    if S::IS_SCALAR {
        simd.mul_add_e_f32s(a, b, c)
    } else {
        simd.mul_add_f32s(a, b, c)
    }
}

/// A vector of what is kept; see [`State`].
pub(crate) struct Vectors<'a, S: Simd> {
    pub c: &'a mut S::f32s,
    pub e: Option<&'a mut S::f32s>,
    pub floor: Option<&'a mut S::f32s>,
}

/// What is done with a vector of products; gives c² and e where atoms are compared.
pub(crate) trait Update {
    /// Atoms and directions are squared.
    const SQUARED: bool = false;

    fn update<S: Simd>(
        simd: S,
        product: S::f32s,
        part: S::f32s,
        state: Vectors<'_, S>,
    ) -> Option<(S::f32s, S::f32s)>;
}

struct Norms;

impl Update for Norms {
    const SQUARED: bool = true;

    #[inline(always)]
    fn update<S: Simd>(
        simd: S,
        product: S::f32s,
        _: S::f32s,
        state: Vectors<'_, S>,
    ) -> Option<(S::f32s, S::f32s)> {
        let seen = simd.greater_than_f32s(product, simd.splat_f32s(UNSEEN));
        if let (Some(e), Some(floor)) = (state.e, state.floor) {
            *e = simd.select_f32s(seen, product, simd.splat_f32s(f32::INFINITY));
            *floor = simd.mul_f32s(product, simd.splat_f32s(FLOOR));
        }
        None
    }
}

/// `UNIT`: all atoms have norm 1.
struct First<const UNIT: bool>;

impl<const UNIT: bool> Update for First<UNIT> {
    #[inline(always)]
    fn update<S: Simd>(
        simd: S,
        product: S::f32s,
        _: S::f32s,
        state: Vectors<'_, S>,
    ) -> Option<(S::f32s, S::f32s)> {
        *state.c = product;
        Some((
            simd.mul_f32s(product, product),
            norm::<S, UNIT>(simd, state.e),
        ))
    }
}

/// The plain rule. `UNIT`: all atoms have norm 1.
pub(crate) struct Plain<const UNIT: bool>;

impl<const UNIT: bool> Update for Plain<UNIT> {
    #[inline(always)]
    fn update<S: Simd>(
        simd: S,
        product: S::f32s,
        part: S::f32s,
        state: Vectors<'_, S>,
    ) -> Option<(S::f32s, S::f32s)> {
        *state.c = add_product(simd, part, product, *state.c);
        let c = *state.c;
        Some((simd.mul_f32s(c, c), norm::<S, UNIT>(simd, state.e)))
    }
}

#[inline(always)]
fn norm<S: Simd, const UNIT: bool>(simd: S, e: Option<&mut S::f32s>) -> S::f32s {
    match e {
        Some(e) if !UNIT => *e,
        _ => simd.splat_f32s(1.0),
    }
}

/// The optimized rule. `UNIT`: all atoms have norm 1.
pub(crate) struct Optimized<const UNIT: bool>;

impl<const UNIT: bool> Update for Optimized<UNIT> {
    #[inline(always)]
    fn update<S: Simd>(
        simd: S,
        product: S::f32s,
        part: S::f32s,
        state: Vectors<'_, S>,
    ) -> Option<(S::f32s, S::f32s)> {
        let (c, e) = (state.c, state.e?);
        *c = add_product(simd, part, product, *c);
        *e = add_product(simd, simd.neg_f32s(product), product, *e);
        let floor = if UNIT {
            simd.splat_f32s(FLOOR)
        } else {
            *state.floor?
        };
        Some((simd.mul_f32s(*c, *c), simd.max_f32s(*e, floor)))
    }
}
