//! The best of many atoms: the one with the largest key c² / e, in each lane of a vector and then
//! of all.
//!
//! Atoms come in any order, so whether the next is better cannot be predicted: lanes need no
//! branch. Keys are compared by products, so that nothing waits for a division; by rounding, two
//! keys that differ by 1e-7 may change places.

use super::packed_atoms::Wide;
use pulp::Simd;

/// The best atom in each lane.
#[derive(Clone, Copy)]
pub(crate) struct LaneArgmax<S: Simd> {
    /// c²
    over: S::f32s,
    /// e
    under: S::f32s,
    /// Exact: no dictionary has 2^24 atoms.
    atoms: S::f32s,
}

impl<S: Simd> LaneArgmax<S> {
    /// No atom yet.
    #[inline(always)]
    pub(crate) fn none(simd: S) -> Self {
        LaneArgmax {
            over: simd.splat_f32s(0.0),
            under: simd.splat_f32s(1.0),
            atoms: simd.splat_f32s(0.0),
        }
    }

    /// Compares atoms, one per lane, with the best so far. Of equal atoms of a lane the first to be
    /// compared stays. A NaN, for an atom that is excluded, never wins.
    #[inline(always)]
    pub(crate) fn compare(&mut self, simd: S, over: S::f32s, under: S::f32s, atoms: S::f32s) {
        let (new, old) = (
            simd.mul_f32s(over, self.under),
            simd.mul_f32s(self.over, under),
        );
        let more = simd.greater_than_f32s(new, old);
        self.over = simd.select_f32s(more, over, self.over);
        self.under = simd.select_f32s(more, under, self.under);
        self.atoms = simd.select_f32s(more, atoms, self.atoms);
    }

    /// The best atom of all lanes, the first of equal ones; `None` if no key is above 0.
    #[inline(always)]
    pub(crate) fn best<const V: usize>(simd: S, lanes: [Self; V]) -> Option<u32> {
        let mut keys = [simd.splat_f32s(0.0); V];
        let mut most = simd.splat_f32s(0.0);
        for v in 0..V {
            keys[v] = simd.div_f32s(lanes[v].over, lanes[v].under);
            most = simd.max_f32s(most, keys[v]);
        }
        let most = simd.reduce_max_f32s(most);
        if most <= 0.0 {
            return None;
        }
        let (most, none) = (simd.splat_f32s(most), simd.splat_f32s(f32::INFINITY));
        let mut first = none;
        for v in 0..V {
            let is_best = simd.equal_f32s(keys[v], most);
            first = simd.min_f32s(first, simd.select_f32s(is_best, lanes[v].atoms, none));
        }
        Some(simd.reduce_min_f32s(first) as u32)
    }
}

/// A [`LaneArgmax`] in memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StoredArgmax {
    over: Wide,
    under: Wide,
    atoms: Wide,
}

impl StoredArgmax {
    /// No atom yet.
    pub(crate) const NONE: StoredArgmax = StoredArgmax {
        over: Wide::of(0.0),
        under: Wide::of(1.0),
        atoms: Wide::of(0.0),
    };

    /// Loads it into vectors.
    #[inline(always)]
    pub(crate) fn load<S: Simd>(&self) -> LaneArgmax<S> {
        LaneArgmax {
            over: self.over.first::<S>(),
            under: self.under.first::<S>(),
            atoms: self.atoms.first::<S>(),
        }
    }

    /// Stores it.
    #[inline(always)]
    pub(crate) fn store<S: Simd>(&mut self, lanes: LaneArgmax<S>) {
        *self.over.first_mut::<S>() = lanes.over;
        *self.under.first_mut::<S>() = lanes.under;
        *self.atoms.first_mut::<S>() = lanes.atoms;
    }
}

#[cfg(test)]
mod tests {
    use super::super::packed_atoms::{INDICES, Row, WIDTH};
    use super::*;
    use crate::numeric::parallel;
    use crate::numeric::simd::dispatch_widest;
    use pulp::{Scalar, Scalar128b, Scalar256b, Scalar512b, WithSimd};
    use rand::Rng;

    /// c² and e of panels, through memory.
    struct Compare<'a>(&'a [(Row, Row)]);

    impl WithSimd for Compare<'_> {
        type Output = Option<u32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Option<u32> {
            let mut stored = StoredArgmax::NONE;
            for (panel, (over, under)) in self.0.iter().enumerate() {
                let [over, under, indices] =
                    [over, under, &INDICES].map(|row| S::as_simd_f32s(&row.0).0);
                let from = simd.splat_f32s((panel * WIDTH) as f32);
                let mut lanes = stored.load::<S>();
                for v in 0..over.len() {
                    lanes.compare(simd, over[v], under[v], simd.add_f32s(from, indices[v]));
                }
                stored.store(lanes);
            }
            LaneArgmax::best(simd, [stored.load::<S>()])
        }
    }

    fn best(panels: &[(Row, Row)]) -> Option<u32> {
        let best = dispatch_widest(Compare(panels));
        assert_eq!(Compare(panels).with_simd(Scalar), best);
        assert_eq!(Compare(panels).with_simd(Scalar128b), best);
        assert_eq!(Compare(panels).with_simd(Scalar256b), best);
        assert_eq!(Compare(panels).with_simd(Scalar512b), best);
        best
    }

    #[test]
    fn the_largest_ratio_wins_on_vectors_of_any_width() {
        let mut random = parallel::rng(5, 0);
        for round in 0..50 {
            let mut row = |from: f32| Row(std::array::from_fn(|_| from + random.random::<f32>()));
            let mut panels: Vec<(Row, Row)> = (0..5).map(|_| (row(0.0), row(0.1))).collect();
            // An atom that is excluded, and one that is not observed.
            panels[round % 5].0.0[round % WIDTH] = f32::NAN;
            panels[round % 3].1.0[round % 7] = f32::INFINITY;
            let keys = panels.iter().flat_map(|(over, under)| {
                let both = over.0.iter().zip(&under.0);
                both.map(|(o, u)| f64::from(*o) / f64::from(*u))
            });
            let keys = (0..).zip(keys).filter(|(_, key)| !key.is_nan());
            let want = keys.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i);
            assert_eq!(best(&panels), want);
        }
    }

    #[test]
    fn the_first_of_equal_atoms_wins_and_nothing_is_no_atom() {
        let none = (Row::ZERO, Row([1.0; WIDTH]));
        assert_eq!(best(&[none, none]), None);
        let mut panels = [none; 4];
        for (panel, lane) in [(3, 2), (1, 40), (2, 7), (1, 41)] {
            panels[panel].0.0[lane] = 0.5;
        }
        assert_eq!(best(&panels), Some(WIDTH as u32 + 40));
        panels[3].0.0 = [f32::NAN; WIDTH];
        panels[1].0.0 = [f32::NAN; WIDTH];
        assert_eq!(best(&panels), Some(2 * WIDTH as u32 + 7));
    }
}
