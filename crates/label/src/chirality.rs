//! Which way round two labels lie on one side of a body: the volumes that they span with labels
//! nearby have the other sign on the other side. Distances hardly tell the inner and the outer
//! side of a foot or a wrist apart; the signs do, however unevenly a few labels were placed.

use super::tuning::chirality::*;
use crate::numeric::statistics::median;
use crate::pose::point_at;
use ndarray::ArrayView2;

/// Labels of one side of a body and their mirror images, each as its track.
#[derive(Clone, Copy)]
pub(super) struct Sides<'a> {
    /// The positions of the tracks (frames, 3 L), cm.
    pub positions: ArrayView2<'a, f64>,
    /// Neighbors of the labels that are asked for.
    pub neighbors: &'a [[usize; 2]],
}

impl Sides<'_> {
    /// How many of the volumes that two labels span have the same sign on both sides, where most
    /// have: these labels are exchanged on one side; -1 where most have not.
    pub(super) fn turned(&self, [a, b]: [[usize; 2]; 2]) -> i32 {
        let (mut same, mut others) = (0, 0);
        for (k, c) in self.neighbors.iter().enumerate() {
            for d in &self.neighbors[..k] {
                let signs = [0, 1].map(|side| self.sign([a, b, *c, *d].map(|l| l[side])));
                match signs {
                    [Some(own), Some(image)] if own == image => same += 1,
                    [Some(_), Some(_)] => others += 1,
                    _ => {}
                }
            }
        }
        let are_most = |of: i32| of >= FEWEST && f64::from(of) >= MOST * f64::from(same + others);
        match (are_most(same), are_most(others)) {
            (true, _) => same,
            (_, true) => -1,
            _ => 0,
        }
    }

    /// Whether the volume of four tracks is positive; `None` where that changes, or they are flat.
    fn sign(&self, four: [usize; 4]) -> Option<bool> {
        let positions = self.positions;
        let step = positions.nrows().div_ceil(MOST_FRAMES).max(1);
        let volume = |t: usize| {
            let [a, b, c, d] = four.map(|track| point_at(positions, t, track));
            let [b, c, d] = [b, c, d].map(|position| (position - a).normalize());
            b.cross(c).dot(d)
        };
        let all = (0..positions.nrows()).step_by(step).map(volume);
        let all: Vec<f64> = all.filter(|v| v.is_finite()).collect();
        let (count, positive) = (all.len(), all.iter().filter(|v| **v > 0.0).count());
        let is_one = positive.max(count - positive) as f64 >= ONE_SIGN * count as f64;
        let is_flat = median(all)?.abs() < FLAT;
        (count >= FEWEST_FRAMES && is_one && !is_flat).then_some(2 * positive > count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// Eight points of a foot, then those of the other one, which are set a little elsewhere.
    fn feet() -> Array2<f64> {
        let foot = [
            [0.0, 3.0, 0.0],
            [3.0, 2.0, 4.0],
            [-3.0, 2.5, 4.0],
            [3.5, 7.0, 5.0],
            [-0.5, 4.0, 17.0],
            [8.0, 18.0, 6.0],
            [-4.0, 10.0, 9.0],
            [2.0, 14.0, -2.0],
        ];
        Array2::from_shape_fn((60, 48), |(t, c)| {
            let [x, y, z] = foot[c / 3 % 8];
            let uneven = (c as f64 * 7.7).sin();
            let [side, uneven] = if c < 24 { [-1.0, 0.0] } else { [1.0, uneven] };
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
        let with_image = |label: usize| [label, label + 8];
        let neighbors = [0, 3, 4, 5, 6, 7].map(with_image);
        let is = |pair: [[usize; 2]; 2], neighbors: &[[usize; 2]]| {
            let positions = xyz.view();
            Sides {
                positions,
                neighbors,
            }
            .turned(pair)
            .signum()
        };
        assert_eq!(is([1, 2].map(with_image), &neighbors), -1);
        // Exchanged on one side, and on both.
        assert_eq!(is([[1, 10], [2, 9]], &neighbors), 1);
        assert_eq!(is([[2, 10], [1, 9]], &neighbors), -1);
        assert_eq!(is([1, 2].map(with_image), &neighbors[..2]), 0);
    }
}
