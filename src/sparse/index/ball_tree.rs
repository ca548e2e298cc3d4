//! A ball tree over the atoms. A leaf holds 8 atoms that are near one another; a ball around its center bounds their scores.
//!
//! Atoms are stored by their PCA coordinates first (see [`super::pca_projection`]), because a search reads those first. Inner
//! balls hold 8 balls of the layer below.

use super::cost_model::PruningStats;
use super::pca_projection::{
    CENTRE, CENTRE_PARTS, LEVELS, PART, PARTS, PcaProjection, Projected, ROUNDING,
};
use crate::numeric::parallel;
use ndarray::ArrayView2;

/// The number of atoms in a leaf, and of balls in an inner ball.
pub const LEAF: usize = 8;
/// The largest number of groups of eight balls in the top layer; a search visits all of them.
const TOP: usize = 16;
/// Marks an empty place in a leaf.
pub const NO_ATOM: u32 = u32::MAX;

/// Cost of multiplying a row in a dense scan relative to a tree search, measured: in a search a row serves fewer poses.
const WORTH: f64 = 0.4;
/// The largest number of atoms from which a split is computed.
const SPLIT_SAMPLE: usize = 1024;
/// Branches of more atoms than this are split in parallel.
const LARGE: usize = 4096;
/// A ball within this distance of the span of the chosen atoms is always visited: its atoms have a small remainder there,
/// which rounding distorts.
pub const NEAR: f32 = 0.03;
/// Beyond this distance of the span rounding hardly matters.
pub const FAR: f32 = 0.15;

/// One number for each atom of a leaf, or for each of eight balls.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct Lanes(pub [f32; LEAF]);

impl Lanes {
    pub const ZERO: Lanes = Lanes([0.0; LEAF]);
}

/// A leaf: eight atoms.
#[derive(Clone)]
pub struct Leaf {
    pub heads: [[Lanes; PART]; PARTS],
    /// Norms of the atoms beyond each of [`LEVELS`].
    pub tails: [Lanes; LEVELS.len()],
    pub atoms: [u32; LEAF],
}

impl Leaf {
    /// The PCA coordinates up to the first of [`LEVELS`].
    pub fn first_parts(&self) -> &[[Lanes; PART]] {
        &self.heads[..LEVELS[0]]
    }
}

/// Eight balls, each around one leaf or around eight balls of the layer below. m is a center.
#[derive(Clone)]
pub struct Balls {
    pub heads: [[Lanes; PART]; CENTRE_PARTS],
    /// |m|²; infinite for an empty place.
    pub norms: Lanes,
    /// All atoms of the ball are within this distance of m.
    pub radii: Lanes,
    /// (radius + [`NEAR`])².
    pub near: Lanes,
    /// (radius + [`FAR`])².
    pub far: Lanes,
}

/// The ball tree over all atoms of a dictionary.
pub struct BallTree {
    pub basis: PcaProjection,
    pub leaves: Vec<Leaf>,
    /// (leaves, D): the full atoms of each leaf, a row of lanes per coordinate.
    pub whole: Vec<Lanes>,
    /// Layer 0 has a ball for each leaf; each further layer has a ball for eight balls of the layer before. The last is the
    /// top.
    pub layers: Vec<Vec<Balls>>,
    /// The leaf of each atom.
    places: Vec<u32>,
    pub tally: PruningStats,
}

impl BallTree {
    /// Builds the tree over atoms (n, D) of unit norm. O(n D 32 + n log n).
    pub fn new(atoms: ArrayView2<'_, f32>) -> BallTree {
        let basis = PcaProjection::of(atoms);
        let n = atoms.nrows();
        let heads = basis.heads(atoms);
        let order = in_order(&heads);
        let leaves: Vec<Leaf> =
            parallel::map_chunks(n, LEAF, |places| leaf(&order[places], &heads));
        let layer = |atoms: usize| -> Vec<Balls> {
            let balls = parallel::map_chunks(n, atoms, |places| ball(&order[places], &heads));
            balls.chunks(LEAF).map(beside).collect()
        };
        let (mut layers, mut atoms_each) = (vec![layer(LEAF)], LEAF);
        while layers[layers.len() - 1].len() > TOP {
            atoms_each *= LEAF;
            layers.push(layer(atoms_each));
        }
        let whole = parallel::map_chunks(n, LEAF, |places| whole(&order[places], atoms)).concat();
        let mut places = vec![0; n];
        for (place, atom) in order.iter().enumerate() {
            places[*atom as usize] = (place / LEAF) as u32;
        }
        BallTree {
            basis,
            leaves,
            whole,
            layers,
            places,
            tally: PruningStats::new(WORTH),
        }
    }

    /// The number of coordinates of an atom, D.
    pub fn width(&self) -> usize {
        self.whole.len() / self.leaves.len().max(1)
    }

    /// The number of rows of lanes that a dense scan multiplies in a step.
    pub fn scan(&self) -> usize {
        self.whole.len()
    }

    /// The balls of the top layer.
    pub fn top(&self) -> &[Balls] {
        self.layers.last().map_or(&[], |layer| layer)
    }

    /// The leaf of an atom. Leaves near each other have numbers near each other.
    pub fn place(&self, atom: u32) -> u32 {
        self.places[atom as usize]
    }
}

/// Returns the atoms in an order in which neighbors are near one another.
pub fn in_order(heads: &[Projected]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..heads.len() as u32).collect();
    split(&mut order, heads);
    order
}

/// Splits atoms at the median of their coordinate along the direction of largest variance, recursively, down to eight.
fn split(order: &mut [u32], heads: &[Projected]) {
    if order.len() <= LEAF {
        return;
    }
    let widest = widest(order, heads);
    let at = |atom: &u32| -> f32 {
        let head = heads[*atom as usize].centre();
        head.iter().zip(&widest).map(|(h, w)| h * w).sum()
    };
    let mut placed: Vec<(f32, u32)> = order.iter().map(|a| (at(a), *a)).collect();
    let half = (order.len() / 2).next_multiple_of(LEAF);
    placed.select_nth_unstable_by(half.min(order.len() - 1), |a, b| {
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    order.iter_mut().zip(&placed).for_each(|(o, p)| *o = p.1);
    let large = order.len() > LARGE;
    let (low, high) = order.split_at_mut(half);
    match large {
        true => {
            rayon::join(|| split(low, heads), || split(high, heads));
        }
        false => {
            split(low, heads);
            split(high, heads);
        }
    }
}

/// The direction of largest variance of the PCA coordinates, approximately: a few steps of the power method.
fn widest(order: &[u32], heads: &[Projected]) -> [f32; CENTRE] {
    let some = order.iter().step_by(order.len().div_ceil(SPLIT_SAMPLE));
    let rows: Vec<&[f32]> = some.map(|a| heads[*a as usize].centre()).collect();
    let mean: [f32; CENTRE] =
        std::array::from_fn(|k| rows.iter().map(|r| r[k]).sum::<f32>() / rows.len() as f32);
    let mut spread = [[0.0f32; CENTRE]; CENTRE];
    for row in rows {
        let apart: [f32; CENTRE] = std::array::from_fn(|k| row[k] - mean[k]);
        for (line, a) in spread.iter_mut().zip(apart) {
            line.iter_mut().zip(apart).for_each(|(s, b)| *s += a * b);
        }
    }
    let longest = (0..CENTRE).max_by(|a, b| spread[*a][*a].total_cmp(&spread[*b][*b]));
    let mut widest = spread[longest.unwrap_or(0)];
    for _ in 0..8 {
        let longest = widest.iter().fold(f32::MIN_POSITIVE, |m, w| m.max(w.abs()));
        widest.iter_mut().for_each(|w| *w /= longest);
        widest = spread.map(|line| line.iter().zip(widest).map(|(s, w)| s * w).sum());
    }
    widest
}

fn leaf(atoms: &[u32], heads: &[Projected]) -> Leaf {
    let mut leaf = Leaf {
        heads: [[Lanes::ZERO; PART]; PARTS],
        tails: [Lanes::ZERO; LEVELS.len()],
        atoms: [NO_ATOM; LEAF],
    };
    for (lane, atom) in atoms.iter().enumerate() {
        let head = &heads[*atom as usize];
        let rows = leaf.heads.as_flattened_mut().iter_mut();
        rows.zip(head.along.as_flattened())
            .for_each(|(row, h)| row.0[lane] = *h);
        (leaf.tails.iter_mut().zip(head.beyond)).for_each(|(row, t)| row.0[lane] = t);
        leaf.atoms[lane] = *atom;
    }
    leaf
}

/// The full atoms of a leaf, a row of lanes per coordinate.
fn whole(some: &[u32], atoms: ArrayView2<'_, f32>) -> Vec<Lanes> {
    let mut rows = vec![Lanes::ZERO; atoms.ncols()];
    for (lane, atom) in some.iter().enumerate() {
        for (row, a) in rows.iter_mut().zip(atoms.row(*atom as usize)) {
            row.0[lane] = *a;
        }
    }
    rows
}

struct Ball {
    centre: [f32; CENTRE],
    radius: f64,
}

/// The ball around the mean of some atoms' PCA coordinates; the norms beyond those coordinates count for its radius.
fn ball(atoms: &[u32], heads: &[Projected]) -> Ball {
    let heads = || atoms.iter().map(|a| &heads[*a as usize]);
    let centre: [f32; CENTRE] =
        std::array::from_fn(|k| heads().map(|h| h.centre()[k]).sum::<f32>() / atoms.len() as f32);
    let squared = heads().map(|h| {
        let apart = h
            .centre()
            .iter()
            .zip(centre)
            .map(|(a, c)| f64::from(a - c).powi(2));
        apart.sum::<f64>() + f64::from(h.beyond_centre()).powi(2)
    });
    let radius = squared.fold(0.0, f64::max).sqrt() * (1.0 + ROUNDING) + ROUNDING;
    Ball { centre, radius }
}

fn beside(balls: &[Ball]) -> Balls {
    let mut all = Balls {
        heads: [[Lanes::ZERO; PART]; CENTRE_PARTS],
        norms: Lanes([f32::INFINITY; LEAF]),
        radii: Lanes::ZERO,
        near: Lanes::ZERO,
        far: Lanes::ZERO,
    };
    for (lane, ball) in balls.iter().enumerate() {
        let rows = all.heads.as_flattened_mut().iter_mut();
        rows.zip(ball.centre).for_each(|(row, c)| row.0[lane] = c);
        let norm: f64 = ball.centre.iter().map(|c| f64::from(*c).powi(2)).sum();
        all.norms.0[lane] = norm as f32;
        all.radii.0[lane] = ball.radius as f32;
        for (row, gap) in [(&mut all.near, NEAR), (&mut all.far, FAR)] {
            let reach = ball.radius + f64::from(gap) + ROUNDING;
            row.0[lane] = (reach * reach + 10.0 * ROUNDING) as f32;
        }
    }
    all
}
