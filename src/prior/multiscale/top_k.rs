//! The nearest of some blocks.

/// Distances of blocks, and the few nearest of them.
#[derive(Debug, Default)]
pub struct TopK {
    /// A distance's bits, and its place: the order of such numbers is that of the distances.
    keys: Vec<u64>,
}

impl TopK {
    /// Of no block yet.
    pub fn clear(&mut self) {
        self.keys.clear();
    }

    /// One more block is so far off: at least 0, and taken for that where it is less.
    pub fn push(&mut self, far: f32) {
        let (far, place) = (far.max(0.0), self.keys.len() as u64);
        self.keys.push(u64::from(far.to_bits()) << 32 | place);
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// The nearest few, the nearest first: which, and what its log evidence is to be added: less the nearer it is to being
    /// left out, so that blocks come and go without a jump.
    pub fn quantize(&mut self, quantize: usize) -> impl Iterator<Item = (usize, f64)> {
        let mut last = None;
        if self.keys.len() > quantize {
            last = Some(unpack(*self.keys.select_nth_unstable(quantize).1).0);
            self.keys.truncate(quantize);
        }
        self.keys.sort_unstable();
        self.keys.iter().map(move |key| {
            let (far, place) = unpack(*key);
            (place, last.map_or(0.0, |last| fade(far, last)))
        })
    }
}

/// The distance, and its place.
fn unpack(key: u64) -> (f32, usize) {
    (f32::from_bits((key >> 32) as u32), key as u32 as usize)
}

/// What the log evidence of a block that is so far off is to be added where the first that is left out is at `last`.
fn fade(far: f32, last: f32) -> f64 {
    let left = -(-0.5 * f64::from(last - far)).exp_m1();
    left.max(1e-9).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_come_first_and_fade_the_nearer_they_are_to_the_first_left_out() {
        let mut near = TopK::default();
        for far in [5.0, 0.0, 80.0, 5.0, 3.0, 81.0] {
            near.push(far);
        }
        assert_eq!(near.len(), 6);
        let quantize: Vec<(usize, f64)> = near.quantize(4).collect();
        let places: Vec<usize> = quantize.iter().map(|f| f.0).collect();
        // Of two that are as far, the first one.
        assert_eq!(places, [1, 4, 0, 3]);
        assert!(quantize[0].1 <= 0.0 && quantize[0].1 >= -1e-9);
        near.clear();
        for far in [2.0, 1.0, 2.0 + 1e-6] {
            near.push(far);
        }
        let quantize: Vec<(usize, f64)> = near.quantize(2).collect();
        assert!(quantize[1].1 < -10.0 && quantize[0].0 == 1 && quantize[0].1 > -2.0);
        // Where none is left out, none fades.
        near.clear();
        near.push(7.0);
        assert_eq!(near.quantize(3).collect::<Vec<_>>(), [(0, 0.0)]);
    }
}
