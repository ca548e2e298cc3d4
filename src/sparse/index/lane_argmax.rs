//! The best atom of all, in each lane of a vector one until all are met.
//!
//! Atoms come in any order, so whether the next is better cannot be foretold: kept by lanes it costs no branch of the
//! program.

use super::packed_atoms::{PLACES, WIDTH, Wide};
use pulp::Simd;

/// The largest key met so far in each lane, and the first panel that has it.
#[derive(Debug, Clone, Copy)]
pub struct Leading {
    keys: Wide,
    /// Exact: no dictionary has 2^24 panels.
    panels: Wide,
}

impl Leading {
    /// Nothing yet.
    pub const NONE: Leading = Leading {
        keys: Wide::ZERO,
        panels: Wide::ZERO,
    };

    /// Meets some keys of a panel; panels are met in their order.
    #[inline(always)]
    pub fn meet<S: Simd, const V: usize>(&mut self, simd: S, panel: usize, new: [S::f32s; V]) {
        let (keys, panels) = (self.keys.first_mut::<S>(), self.panels.first_mut::<S>());
        let mut most = simd.splat_f32s(0.0);
        for key in new {
            // What is no number, of an atom that is taken, is not more.
            most = simd.select_f32s(simd.greater_than_f32s(key, most), key, most);
        }
        let more = simd.greater_than_f32s(most, *keys);
        *keys = simd.select_f32s(more, most, *keys);
        *panels = simd.select_f32s(more, simd.splat_f32s(panel as f32), *panels);
    }

    /// The best atom: the first of equals. `None` where none has a key above 0. `keys` gives the keys of a panel again.
    #[inline(always)]
    pub fn atom<S: Simd, const V: usize>(
        self,
        simd: S,
        keys: impl FnOnce(usize) -> [S::f32s; V],
    ) -> Option<u32> {
        let (of_lanes, panels) = (self.keys.first::<S>(), self.panels.first::<S>());
        let most = simd.reduce_max_f32s(of_lanes);
        if most <= 0.0 {
            return None;
        }
        let (all, none) = (simd.splat_f32s(most), simd.splat_f32s(f32::INFINITY));
        let panel = simd.select_f32s(simd.equal_f32s(of_lanes, all), panels, none);
        let panel = simd.reduce_min_f32s(panel) as usize;
        let places = S::as_simd_f32s(&PLACES.0).0;
        let mut first = none;
        for (key, place) in keys(panel).iter().zip(places) {
            let place = simd.select_f32s(simd.equal_f32s(*key, all), *place, none);
            first = simd.min_f32s(first, place);
        }
        Some((panel * WIDTH) as u32 + simd.reduce_min_f32s(first) as u32)
    }
}

/// The atom in front in each lane of one of a panel's vectors: that with the largest key, c² / e. Which of two is larger is
/// told by products, so that nothing waits for a division; by rounding, two keys that differ by 1e-7 may change places.
#[derive(Clone, Copy)]
pub struct Ahead<S: Simd> {
    over: S::f32s,
    under: S::f32s,
    panels: S::f32s,
}

impl<S: Simd> Ahead<S> {
    /// Nothing yet.
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        Ahead {
            over: simd.splat_f32s(0.0),
            under: simd.splat_f32s(1.0),
            panels: simd.splat_f32s(0.0),
        }
    }

    /// Meets a panel's atoms with c² = `over` and e = `under`; panels are met in their order.
    #[inline(always)]
    pub fn meet(&mut self, simd: S, panel: usize, over: S::f32s, under: S::f32s) {
        let (new, old) = (
            simd.mul_f32s(over, self.under),
            simd.mul_f32s(self.over, under),
        );
        // What is no number, of an atom that is taken, is not more.
        let more = simd.greater_than_f32s(new, old);
        self.over = simd.select_f32s(more, over, self.over);
        self.under = simd.select_f32s(more, under, self.under);
        self.panels = simd.select_f32s(more, simd.splat_f32s(panel as f32), self.panels);
    }
}

/// The best of the atoms ahead in all lanes of a panel, once all panels are met: the first of equals. `None` where none has a
/// key above 0.
#[inline(always)]
pub fn best<S: Simd, const V: usize>(simd: S, ahead: [Ahead<S>; V]) -> Option<u32> {
    let mut keys = [simd.splat_f32s(0.0); V];
    let mut most = simd.splat_f32s(0.0);
    for v in 0..V {
        keys[v] = simd.div_f32s(ahead[v].over, ahead[v].under);
        most = simd.max_f32s(most, keys[v]);
    }
    let most = simd.reduce_max_f32s(most);
    if most <= 0.0 {
        return None;
    }
    let (all, none) = (simd.splat_f32s(most), simd.splat_f32s(f32::INFINITY));
    let places = S::as_simd_f32s(&PLACES.0).0;
    let mut first = none;
    for v in 0..V {
        // Exact: no dictionary that is met so has 2^24 atoms.
        let panel = simd.mul_f32s(ahead[v].panels, simd.splat_f32s(WIDTH as f32));
        let atom = simd.add_f32s(panel, places[v]);
        let atom = simd.select_f32s(simd.equal_f32s(keys[v], all), atom, none);
        first = simd.min_f32s(first, atom);
    }
    Some(simd.reduce_min_f32s(first) as u32)
}

#[cfg(test)]
mod tests {
    use super::super::packed_atoms::Row;
    use super::*;
    use crate::numeric::parallel;
    use crate::numeric::simd::{dispatch_widest, dispatch8_job};
    use pulp::{Scalar, Scalar128b, Scalar256b, Scalar512b, WithSimd};
    use rand::Rng;

    /// c² and e by panels.
    struct Met<'a>(&'a [(Row, Row)]);

    impl Met<'_> {
        fn by<S: Simd, const V: usize>(self, simd: S) -> Option<u32> {
            let mut ahead = [Ahead::none(simd); V];
            for (panel, (over, under)) in self.0.iter().enumerate() {
                let (over, under) = (S::as_simd_f32s(&over.0).0, S::as_simd_f32s(&under.0).0);
                for v in 0..V {
                    ahead[v].meet(simd, panel, over[v], under[v]);
                }
            }
            best(simd, ahead)
        }
    }

    impl WithSimd for Met<'_> {
        type Output = Option<u32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Option<u32> {
            match S::F32_LANES {
                16 => self.by::<S, 4>(simd),
                8 => self.by::<S, 8>(simd),
                4 => self.by::<S, 16>(simd),
                _ => self.by::<S, WIDTH>(simd),
            }
        }
    }

    fn told(panels: &[(Row, Row)]) -> Option<u32> {
        let of = dispatch_widest(Met(panels));
        assert_eq!(dispatch8_job(Met(panels)), of);
        assert_eq!(Met(panels).with_simd(Scalar), of);
        assert_eq!(Met(panels).with_simd(Scalar128b), of);
        assert_eq!(Met(panels).with_simd(Scalar256b), of);
        assert_eq!(Met(panels).with_simd(Scalar512b), of);
        of
    }

    #[test]
    fn the_largest_ratio_leads_on_vectors_of_any_width() {
        let mut random = parallel::rng(5, 0);
        for round in 0..50 {
            let mut row = |from: f32| Row(std::array::from_fn(|_| from + random.random::<f32>()));
            let mut panels: Vec<(Row, Row)> = (0..5).map(|_| (row(0.0), row(0.1))).collect();
            // An atom that is taken is no number.
            panels[round % 5].0.0[round % WIDTH] = f32::NAN;
            let keys = panels.iter().flat_map(|(over, under)| {
                let both = over.0.iter().zip(&under.0);
                both.map(|(o, u)| f64::from(*o) / f64::from(*u))
            });
            let keys = (0..).zip(keys).filter(|(_, key)| !key.is_nan());
            let want = keys.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i);
            assert_eq!(told(&panels), want);
        }
    }

    #[test]
    fn of_equals_the_first_leads_and_nothing_is_no_atom() {
        let none = (Row::ZERO, Row([1.0; WIDTH]));
        assert_eq!(told(&[none, none]), None);
        let mut panels = [none; 4];
        for (panel, lane) in [(3, 2), (1, 40), (2, 7), (1, 41)] {
            panels[panel].0.0[lane] = 0.5;
        }
        assert_eq!(told(&panels), Some(WIDTH as u32 + 40));
        panels[3].0.0 = [f32::NAN; WIDTH];
        panels[1].0.0 = [f32::NAN; WIDTH];
        assert_eq!(told(&panels), Some(2 * WIDTH as u32 + 7));
    }
}
