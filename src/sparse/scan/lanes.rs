//! The best atom of all, in each lane of a vector one until all are met.
//!
//! Atoms come in any order, so whether the next is better cannot be foretold: kept by lanes it costs no branch of the
//! program.

use super::panels::{PLACES, WIDTH, Wide};
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
