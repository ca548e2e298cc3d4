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
    /// The places of the tracks (frames, 3 L), cm.
    pub places: ArrayView2<'a, f64>,
    /// Neighbors of the labels that are asked for.
    pub neighbors: &'a [[usize; 2]],
}

impl Sides<'_> {
    /// How many volumes say that two labels are exchanged on one side, less those that say that
    /// they are not. More than nothing only where most of those that they span together have the
    /// same sign on both sides, and neither lies worse in the other's place; less only where most
    /// have not.
    pub(super) fn turned(&self, [a, b]: [[usize; 2]; 2]) -> i32 {
        let pairs = combinations(self.neighbors, 2);
        let all = pairs.iter().map(|of| [a, b, of[0], of[1]]);
        let both = all.filter_map(|four| {
            let [own, image] = [0, 1].map(|side| self.sign(four.map(|l| l[side])));
            Some(own? == image?)
        });
        let are_same: Vec<bool> = both.collect();
        let same = are_same.iter().filter(|same| **same).count();
        let others = are_same.len() - same;
        let are_most = |of: usize| of >= FEWEST && of as f64 >= MOST * are_same.len() as f64;
        if are_most(others) {
            return -1;
        }
        let better = || [[a, b], [b, a]].map(|[label, other]| self.better(label, other));
        match are_most(same).then(better) {
            Some([a, b]) if a.min(b) >= 0 => same as i32 + a + b,
            _ => 0,
        }
    }

    /// How many more of the volumes of a label with three of its neighbors have the other sign on
    /// the other side where it is in the track of another label.
    fn better(&self, [own, image]: [usize; 2], [other, _]: [usize; 2]) -> i32 {
        let triples = combinations(self.neighbors, 3);
        let each = triples.iter().map(|of| {
            let sign = |track: usize, side: usize| {
                self.sign([track, of[0][side], of[1][side], of[2][side]])
            };
            let Some(image) = sign(image, 1) else {
                return 0;
            };
            let is_same = |track: usize| i32::from(sign(track, 0) == Some(image));
            is_same(own) - is_same(other)
        });
        each.sum()
    }

    /// Whether the volume of four tracks is positive; `None` where that changes, or they are flat.
    fn sign(&self, four: [usize; 4]) -> Option<bool> {
        let places = self.places;
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
}

/// All choices of so many of some labels.
fn combinations(of: &[[usize; 2]], count: usize) -> Vec<Vec<[usize; 2]>> {
    if count == 0 {
        return vec![Vec::new()];
    }
    let with = |(k, first): (usize, &[usize; 2])| {
        let mut rest = combinations(&of[k + 1..], count - 1);
        rest.iter_mut().for_each(|choice| choice.insert(0, *first));
        rest
    };
    of.iter().enumerate().flat_map(with).collect()
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
            let places = xyz.view();
            Sides { places, neighbors }.turned(pair).signum()
        };
        assert_eq!(is([1, 2].map(with_image), &neighbors), -1);
        // Exchanged on one side, and on both.
        assert_eq!(is([[1, 8], [2, 7]], &neighbors), 1);
        assert_eq!(is([[2, 8], [1, 7]], &neighbors), -1);
        assert_eq!(is([1, 2].map(with_image), &neighbors[..2]), 0);
    }
}
