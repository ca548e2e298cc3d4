//! Which way round two labels lie on one side of a body: the volumes that they span with labels
//! nearby have the other sign on the other side. Distances hardly tell the inner and the outer
//! side of a foot or a wrist apart; the signs do, however unevenly a few labels were placed.

use super::tuning::chirality::*;
use crate::numeric::statistics::median;
use crate::pose::point_at;
use ndarray::ArrayView2;

/// Whether two labels lie the wrong way round beside their mirror images: by most of the volumes
/// that they span with each two of some `neighbors`. Every label is given with its mirror image, as
/// the tracks at `places` (frames, 3 L; cm). `None` where too few volumes have one sign, or they
/// differ.
pub(super) fn is_turned(
    places: ArrayView2<'_, f64>,
    pair: [[usize; 2]; 2],
    neighbors: &[[usize; 2]],
) -> Option<bool> {
    let [a, b] = pair;
    let (mut turned, mut all) = (0, 0);
    for (k, c) in neighbors.iter().enumerate() {
        for d in &neighbors[..k] {
            let [own, image] = [0, 1].map(|side| sign(places, [a, b, *c, *d].map(|l| l[side])));
            let Some((own, image)) = own.zip(image) else {
                continue;
            };
            turned += usize::from(own == image);
            all += 1;
        }
    }
    let are_most = |votes: usize| all >= FEWEST && votes as f64 >= MOST * all as f64;
    match (are_most(turned), are_most(all - turned)) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ => None,
    }
}

/// Whether the volume of four tracks is positive; `None` where that changes, or they are flat.
fn sign(places: ArrayView2<'_, f64>, four: [usize; 4]) -> Option<bool> {
    let step = places.nrows().div_ceil(MOST_FRAMES).max(1);
    let volume = |t: usize| {
        let [a, b, c, d] = four.map(|track| point_at(places, t, track));
        let [b, c, d] = [b, c, d].map(|place| (place - a).normalize());
        b.cross(c).dot(d)
    };
    let all = (0..places.nrows()).step_by(step).map(volume);
    let all: Vec<f64> = all.filter(|v| v.is_finite()).collect();
    let (count, positive) = (all.len(), all.iter().filter(|v| **v > 0.0).count());
    let is_one = positive.max(count - positive) as f64 >= ONE_SIGN * count as f64;
    let is_flat = median(all)?.abs() < FLAT;
    (count >= FEWEST_FRAMES && is_one && !is_flat).then_some(2 * positive > count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// Six points of a foot, then those of the other one, which are set a little elsewhere.
    fn feet() -> Array2<f64> {
        let foot = [
            [0.0, 3.0, 0.0],
            [3.0, 2.0, 4.0],
            [-3.0, 2.5, 4.0],
            [3.5, 7.0, 5.0],
            [-0.5, 4.0, 17.0],
            [8.0, 18.0, 6.0],
        ];
        Array2::from_shape_fn((60, 36), |(t, c)| {
            let [x, y, z] = foot[c / 3 % 6];
            let uneven = (c as f64 * 7.7).sin();
            let [side, uneven] = if c < 18 { [-1.0, 0.0] } else { [1.0, uneven] };
            let turn = 0.02 * t as f64 * side;
            let at = [
                side * x,
                y * turn.cos() - z * turn.sin(),
                y * turn.sin() + z * turn.cos(),
            ];
            at[c % 3] + uneven + [9.0 * side, 0.0, t as f64][c % 3]
        })
    }

    #[test]
    fn labels_the_wrong_way_round_show_beside_the_other_side() {
        let xyz = feet();
        let with_image = |label: usize| [label, label + 6];
        let neighbors = [0, 3, 4, 5].map(with_image);
        let is = |pair: [[usize; 2]; 2], neighbors: &[[usize; 2]]| {
            is_turned(xyz.view(), pair, neighbors)
        };
        assert_eq!(is([1, 2].map(with_image), &neighbors), Some(false));
        // Exchanged on one side, and on both.
        assert_eq!(is([[1, 8], [2, 7]], &neighbors), Some(true));
        assert_eq!(is([[2, 8], [1, 7]], &neighbors), Some(false));
        assert_eq!(is([1, 2].map(with_image), &neighbors[..2]), None);
    }
}
