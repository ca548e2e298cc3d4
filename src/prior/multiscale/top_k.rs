//! Selection of the few nearest by distance, with a fade-out.

/// Distances, and the few smallest of them.
#[derive(Debug, Default)]
pub struct TopK {
    /// A distance's bits, then its place: such numbers are ordered as the distances are.
    keys: Vec<u64>,
}

impl TopK {
    /// Forgets all distances.
    pub fn clear(&mut self) {
        self.keys.clear();
    }

    /// Adds a distance; a negative one counts as 0.
    pub fn push(&mut self, distance: f32) {
        let (distance, place) = (distance.max(0.0), self.keys.len() as u64);
        self.keys.push(u64::from(distance.to_bits()) << 32 | place);
    }

    /// The number of distances.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// The places of the `k` smallest distances, the smallest first, each with a log weight (at most 0) that fades to −∞ as
    /// the distance reaches that of the first one left out: candidates come and go without a jump.
    pub fn nearest(&mut self, k: usize) -> impl Iterator<Item = (usize, f64)> {
        let mut left_out = None;
        if self.keys.len() > k {
            left_out = Some(unpack(*self.keys.select_nth_unstable(k).1).0);
            self.keys.truncate(k);
        }
        self.keys.sort_unstable();
        self.keys.iter().map(move |key| {
            let (distance, place) = unpack(*key);
            (
                place,
                left_out.map_or(0.0, |left_out| fade(distance, left_out)),
            )
        })
    }
}

/// The distance and its place.
fn unpack(key: u64) -> (f32, usize) {
    (f32::from_bits((key >> 32) as u32), key as u32 as usize)
}

/// log (1 − exp(−½ (left_out − distance))), at least log 1e-9.
fn fade(distance: f32, left_out: f32) -> f64 {
    let remaining = -(-0.5 * f64::from(left_out - distance)).exp_m1();
    remaining.max(1e-9).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_by_distance_and_fades_towards_the_first_left_out() {
        let mut top = TopK::default();
        for distance in [5.0, 0.0, 80.0, 5.0, 3.0, 81.0] {
            top.push(distance);
        }
        assert_eq!(top.len(), 6);
        let nearest: Vec<(usize, f64)> = top.nearest(4).collect();
        let places: Vec<usize> = nearest.iter().map(|f| f.0).collect();
        // Of two equal distances, the first one.
        assert_eq!(places, [1, 4, 0, 3]);
        assert!(nearest[0].1 <= 0.0 && nearest[0].1 >= -1e-9);
        top.clear();
        for distance in [2.0, 1.0, 2.0 + 1e-6] {
            top.push(distance);
        }
        let nearest: Vec<(usize, f64)> = top.nearest(2).collect();
        assert!(nearest[1].1 < -10.0 && nearest[0].0 == 1 && nearest[0].1 > -2.0);
        // Nothing left out, nothing fades.
        top.clear();
        top.push(7.0);
        assert_eq!(top.nearest(3).collect::<Vec<_>>(), [(0, 0.0)]);
    }
}
