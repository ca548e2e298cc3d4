//! The best atom of all, in each lane of a vector one until all are met.
//!
//! Atoms come in any order, so whether the next is better cannot be foretold: kept by lanes it costs no branch of the
//! program.

use super::panels::{PLACES, Row, WIDTH, Wide};
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

/// The atoms ahead in all lanes of a panel, once all are met.
pub struct Finish {
    over: Row,
    under: Row,
    panels: Row,
}

impl Finish {
    pub const NONE: Finish = Finish {
        over: Row::ZERO,
        under: Row::ZERO,
        panels: Row::ZERO,
    };

    /// Those of a panel's vector `v`.
    #[inline(always)]
    pub fn put<S: Simd>(&mut self, v: usize, ahead: Ahead<S>) {
        S::as_mut_simd_f32s(&mut self.over.0).0[v] = ahead.over;
        S::as_mut_simd_f32s(&mut self.under.0).0[v] = ahead.under;
        S::as_mut_simd_f32s(&mut self.panels.0).0[v] = ahead.panels;
    }

    /// The best atom: the first of equals. `None` where none has a key above 0.
    #[inline(always)]
    pub fn atom<S: Simd>(mut self, simd: S) -> Option<u32> {
        let keys = S::as_mut_simd_f32s(&mut self.over.0).0;
        let mut most = simd.splat_f32s(0.0);
        for (key, under) in keys.iter_mut().zip(S::as_simd_f32s(&self.under.0).0) {
            *key = simd.div_f32s(*key, *under);
            most = simd.max_f32s(most, *key);
        }
        let most = simd.reduce_max_f32s(most);
        if most <= 0.0 {
            return None;
        }
        let (all, none) = (simd.splat_f32s(most), simd.splat_f32s(f32::INFINITY));
        let panels = S::as_simd_f32s(&self.panels.0).0;
        let places = S::as_simd_f32s(&PLACES.0).0;
        let mut first = none;
        for v in 0..keys.len() {
            // Exact: no dictionary that is met so has 2^24 atoms.
            let atom = simd.mul_add_e_f32s(panels[v], simd.splat_f32s(WIDTH as f32), places[v]);
            let atom = simd.select_f32s(simd.equal_f32s(keys[v], all), atom, none);
            first = simd.min_f32s(first, atom);
        }
        Some(simd.reduce_min_f32s(first) as u32)
    }
}
