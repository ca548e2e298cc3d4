//! A ball tree over the atoms. A leaf holds 16 atoms that are near one another; a ball around its
//! center bounds their scores. Inner balls hold 16 balls of the layer below.
//!
//! The tree stores the atoms' PCA coordinates only (see [`super::pca_projection`]): they decide for
//! almost all atoms.

use super::pca_projection::{COORDINATES, LEADING, PcaProjection, Projected, ROUNDING};
use crate::numeric::parallel;
use ndarray::ArrayView2;

/// The number of atoms in a leaf, and of balls in an inner ball.
pub(crate) const LEAF: usize = 16;
/// The largest number of groups of balls in the top layer; a search visits all of them.
const TOP: usize = 8;
/// Marks an empty slot in a leaf.
pub(crate) const NO_ATOM: u32 = u32::MAX;
/// The largest number of atoms from which a split is computed.
const SPLIT_SAMPLE: usize = 1024;
/// Branches of more atoms than this are split in parallel.
const LARGE: usize = 4096;

/// One number for each atom of a leaf, or for each ball of a group.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Lanes(pub [f32; LEAF]);

impl Lanes {
    pub(crate) const ZERO: Lanes = Lanes([0.0; LEAF]);
}

/// What a search reads first of a leaf.
#[derive(Clone)]
pub(crate) struct Leaf {
    /// The first PCA coordinates, a row each.
    pub leading: [Lanes; LEADING],
    /// Upper bounds of the atoms' norms beyond them.
    pub beyond: Lanes,
}

/// The rest of a leaf.
#[derive(Clone)]
pub(crate) struct LeafDetails {
    /// The other PCA coordinates, a row each.
    pub others: [Lanes; COORDINATES - LEADING],
    /// Upper bounds of the atoms' norms beyond all coordinates.
    pub beyond: Lanes,
    pub atoms: [u32; LEAF],
}

/// A group of balls, each around one leaf or around a group of the layer below. m is a center.
#[derive(Clone)]
pub(crate) struct Balls {
    /// The first PCA coordinates of m, a row each; the others are 0.
    pub centers: [Lanes; LEADING],
    /// |m|²; infinite for an empty slot.
    pub norms: Lanes,
    /// All atoms of the ball are within this distance of m.
    pub radii: Lanes,
}

/// The ball tree over all atoms of a dictionary.
pub(crate) struct BallTree {
    pub basis: PcaProjection,
    pub leaves: Vec<Leaf>,
    pub details: Vec<LeafDetails>,
    /// Layer 0 has a ball for each leaf; each further layer has a ball for each group of the layer
    /// before. The last is the top.
    pub layers: Vec<Vec<Balls>>,
}

impl BallTree {
    /// Builds the tree over atoms (n, D) of unit norm. O(n D 32 + n log n).
    pub(crate) fn new(atoms: ArrayView2<'_, f32>) -> BallTree {
        let basis = PcaProjection::of(atoms);
        let n = atoms.nrows();
        let projected = basis.project_all(atoms);
        let order = in_order(&projected);
        let leaves = parallel::map_chunks(n, LEAF, |range| leaf(&order[range], &projected));
        let (leaves, details) = leaves.into_iter().unzip();
        let layer = |atoms: usize| -> Vec<Balls> {
            let balls = parallel::map_chunks(n, atoms, |range| ball(&order[range], &projected));
            balls.chunks(LEAF).map(group).collect()
        };
        let (mut layers, mut atoms_each) = (vec![layer(LEAF)], LEAF);
        while layers[layers.len() - 1].len() > TOP {
            atoms_each *= LEAF;
            layers.push(layer(atoms_each));
        }
        BallTree {
            basis,
            leaves,
            details,
            layers,
        }
    }
}

/// Returns the atoms in an order in which neighbors are near one another.
fn in_order(projected: &[Projected]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..projected.len() as u32).collect();
    split(&mut order, projected);
    order
}

/// Splits atoms at the median of their coordinate along the direction of largest variance,
/// recursively, down to leaves.
fn split(order: &mut [u32], projected: &[Projected]) {
    if order.len() <= LEAF {
        return;
    }
    let widest = widest(order, projected);
    let at = |atom: &u32| -> f32 {
        let point = projected[*atom as usize].leading();
        point.iter().zip(&widest).map(|(p, w)| p * w).sum()
    };
    let mut keyed: Vec<(f32, u32)> = order.iter().map(|a| (at(a), *a)).collect();
    let half = (order.len() / 2).next_multiple_of(LEAF);
    keyed.select_nth_unstable_by(half.min(order.len() - 1), |a, b| {
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    order.iter_mut().zip(&keyed).for_each(|(o, p)| *o = p.1);
    let large = order.len() > LARGE;
    let (low, high) = order.split_at_mut(half);
    if large {
        rayon::join(|| split(low, projected), || split(high, projected));
    } else {
        split(low, projected);
        split(high, projected);
    }
}

/// The direction of largest variance of the PCA coordinates, approximately: a few steps of the
/// power method.
fn widest(order: &[u32], projected: &[Projected]) -> [f32; LEADING] {
    let some = order.iter().step_by(order.len().div_ceil(SPLIT_SAMPLE));
    let rows: Vec<&[f32; LEADING]> = some.map(|a| projected[*a as usize].leading()).collect();
    let mean: [f32; LEADING] =
        std::array::from_fn(|k| rows.iter().map(|r| r[k]).sum::<f32>() / rows.len() as f32);
    let mut spread = [[0.0f32; LEADING]; LEADING];
    for row in rows {
        let apart: [f32; LEADING] = std::array::from_fn(|k| row[k] - mean[k]);
        for (line, a) in spread.iter_mut().zip(apart) {
            line.iter_mut().zip(apart).for_each(|(s, b)| *s += a * b);
        }
    }
    let longest = (0..LEADING).max_by(|a, b| spread[*a][*a].total_cmp(&spread[*b][*b]));
    let mut widest = spread[longest.unwrap_or(0)];
    for _ in 0..8 {
        let longest = widest.iter().fold(f32::MIN_POSITIVE, |m, w| m.max(w.abs()));
        widest.iter_mut().for_each(|w| *w /= longest);
        widest = spread.map(|line| line.iter().zip(widest).map(|(s, w)| s * w).sum());
    }
    widest
}

fn leaf(atoms: &[u32], projected: &[Projected]) -> (Leaf, LeafDetails) {
    let mut leaf = Leaf {
        leading: [Lanes::ZERO; LEADING],
        beyond: Lanes::ZERO,
    };
    let mut details = LeafDetails {
        others: [Lanes::ZERO; COORDINATES - LEADING],
        beyond: Lanes::ZERO,
        atoms: [NO_ATOM; LEAF],
    };
    for (lane, atom) in atoms.iter().enumerate() {
        let of = &projected[*atom as usize];
        let rows = leaf.leading.iter_mut().chain(&mut details.others);
        rows.zip(of.coordinates)
            .for_each(|(row, c)| row.0[lane] = c);
        leaf.beyond.0[lane] = of.beyond[0];
        details.beyond.0[lane] = of.beyond[1];
        details.atoms[lane] = *atom;
    }
    (leaf, details)
}

struct Ball {
    center: [f32; LEADING],
    radius: f64,
}

/// The ball around the mean of some atoms' leading coordinates; the norms beyond those coordinates
/// count for its radius.
fn ball(atoms: &[u32], projected: &[Projected]) -> Ball {
    let points = || atoms.iter().map(|a| &projected[*a as usize]);
    let center: [f32; LEADING] =
        std::array::from_fn(|k| points().map(|p| p.leading()[k]).sum::<f32>() / atoms.len() as f32);
    let squared = points().map(|p| {
        let apart = (p.leading().iter().zip(center)).map(|(a, c)| f64::from(a - c).powi(2));
        apart.sum::<f64>() + f64::from(p.beyond[0]).powi(2)
    });
    let radius = squared.fold(0.0, f64::max).sqrt() * (1.0 + ROUNDING) + ROUNDING;
    Ball { center, radius }
}

/// The layout of a group of balls.
fn group(balls: &[Ball]) -> Balls {
    let mut all = Balls {
        centers: [Lanes::ZERO; LEADING],
        norms: Lanes([f32::INFINITY; LEAF]),
        radii: Lanes::ZERO,
    };
    for (lane, ball) in balls.iter().enumerate() {
        let rows = all.centers.iter_mut().zip(ball.center);
        rows.for_each(|(row, c)| row.0[lane] = c);
        let norm: f64 = ball.center.iter().map(|c| f64::from(*c).powi(2)).sum();
        all.norms.0[lane] = norm as f32;
        all.radii.0[lane] = ball.radius as f32;
    }
    all
}
