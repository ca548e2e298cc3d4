//! Selection of the few nearest by distance, with a fade-out.

/// The indices of the `k` smallest distances (negative ones count as 0), the smallest first, each
/// with a log weight (at most
/// 0) that fades to −∞ as the distance reaches that of the first one left out: candidates come and
///    go without a jump.
pub(crate) fn nearest(distances: &[f32], k: usize) -> Vec<(usize, f64)> {
    // A distance's bits, then its index: such numbers are ordered as the distances are.
    let key = |(index, distance): (usize, &f32)| {
        u64::from(distance.max(0.0).to_bits()) << 32 | index as u64
    };
    let distance = |key: u64| f64::from(f32::from_bits((key >> 32) as u32));
    let mut keys: Vec<u64> = distances.iter().enumerate().map(key).collect();
    let mut left_out = f64::INFINITY;
    if keys.len() > k {
        left_out = distance(*keys.select_nth_unstable(k).1);
        keys.truncate(k);
    }
    keys.sort_unstable();
    let index = |key: &u64| (*key as u32 as usize, fade(distance(*key), left_out));
    keys.iter().map(index).collect()
}

/// log (1 − exp(−½ (left_out − distance))), at least log 1e-9.
fn fade(distance: f64, left_out: f64) -> f64 {
    let remaining = -(-0.5 * (left_out - distance)).exp_m1();
    remaining.max(1e-9).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_by_distance_and_fades_toward_the_first_left_out() {
        let found = nearest(&[5.0, 0.0, 80.0, 5.0, 3.0, 81.0], 4);
        let indices: Vec<usize> = found.iter().map(|f| f.0).collect();
        // Where two distances are equal, the first one.
        assert_eq!(indices, [1, 4, 0, 3]);
        assert!(found[0].1 <= 0.0 && found[0].1 >= -1e-9);
        let found = nearest(&[2.0, 1.0, 2.0 + 1e-6], 2);
        assert!(found[1].1 < -10.0 && found[0].0 == 1 && found[0].1 > -2.0);
        // Nothing left out, nothing fades.
        assert_eq!(nearest(&[7.0], 3), [(0, 0.0)]);
    }
}
