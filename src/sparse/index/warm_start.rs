//! The atoms that are likely the best of a pose, by what was weighed.

use super::branch_and_bound::Query;
use super::packed_atoms::{MOST, Row, WIDTH, Wide};
use super::panel_kernel::FLOOR;
use super::quantized_table::{QuantizedTable, short};
use super::query::OmpQuery;

/// Atoms that are likely the best.
pub const LEADS: usize = 4;

/// A number in each lane of the widest vectors.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Whole(pub [i32; MOST]);

/// Where the atoms are that are likely the best: in each lane of some vectors side by side one.
#[derive(Clone, Copy)]
pub struct Lead {
    /// Their keys, nearly, as logarithms.
    pub keys: Whole,
    /// The first place of the vectors.
    pub places: Whole,
    /// How many lanes a vector has, and how many vectors are side by side.
    pub lanes: usize,
    pub vectors: usize,
}

impl Lead {
    pub const NONE: Lead = Lead {
        keys: Whole([i32::MIN; MOST]),
        places: Whole([0; MOST]),
        lanes: 1,
        vectors: 1,
    };

    /// The most likely of a quarter of the lanes: the lane, and the first place of its vectors.
    fn best(&self, quarter: usize) -> (usize, usize) {
        let mut best = quarter;
        for lane in (quarter..MOST).step_by(LEADS) {
            if self.keys.0[lane] > self.keys.0[best] {
                best = lane;
            }
        }
        (best, self.places.0[best] as usize)
    }
}

/// How much larger than what e is at least it likely is, over an atom's tail. Of an atom near the first taken, the product with
/// its direction is nearly 1, and counts most.
pub fn gap(path: &OmpQuery) -> f32 {
    path.heads.get(1).map_or(0.0, |q| 2.0 * short(q).1)
}

/// What was kept of a pose: every `poses`-th row, and of each panel the largest key that any atom may have.
#[derive(Clone, Copy)]
pub struct Weighed<'a> {
    pub sieve: &'a QuantizedTable,
    pub correlations: &'a [Row],
    pub remainders: &'a [Row],
    pub most: &'a [Wide],
    pub poses: usize,
}

impl Weighed<'_> {
    /// The places of a few atoms that are likely the best.
    pub fn likely(&self, lead: &Lead, sought: &Query<'_>) -> [u32; LEADS] {
        let (gap, is_optimised) = (gap(sought.path), sought.is_optimised());
        let mut places = [0; LEADS];
        // A loop, not `map`: that is not inlined.
        for (quarter, place) in places.iter_mut().enumerate() {
            let (lane, first) = lead.best(quarter);
            let (panel, first) = (first / WIDTH, first % WIDTH + lane);
            let row = panel * self.poses;
            let (c, e) = (&self.correlations[row].0, &self.remainders[row].0);
            let tails = &self.sieve.tails[panel].0;
            let mut best = 0.0;
            for v in 0..lead.vectors {
                let at = (first + v * lead.lanes) % WIDTH;
                let left = match is_optimised {
                    true => (e[at] + gap * tails[at]).max(FLOOR),
                    false => 1.0,
                };
                let key = c[at] * c[at] / left;
                if key > best {
                    (best, *place) = (key, (panel * WIDTH + at) as u32);
                }
            }
        }
        places
    }
}
