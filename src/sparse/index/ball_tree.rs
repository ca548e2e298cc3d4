//! Atoms by eights that are near one another, each told by a few of its numbers: what a pruned search looks at first.
//!
//! A leaf is 8 atoms of neighbouring heads; all of them lie in a ball about its centre, which bounds them together.

use super::cost_model::PruningStats;
use super::pca_projection::{
    CENTRE, CENTRE_PARTS, LEVELS, PART, PARTS, PcaProjection, Projected, ROUNDING,
};
use crate::numeric::parallel;
use ndarray::ArrayView2;

/// Atoms in a leaf, and leaves beside one another.
pub const LEAF: usize = 8;
/// The top layer has so many groups of eight balls, at most: all of them are looked at.
const TOP: usize = 16;
/// Marks a place of a leaf without an atom.
pub const NO_ATOM: u32 = u32::MAX;

/// What a row multiplied in a scan is worth in a search, measured: in a search it serves fewer poses at once.
const WORTH: f64 = 0.4;
/// Atoms of a branch that its split is learnt from, at most.
const SPLIT_SAMPLE: usize = 1024;
/// Branches of more atoms are split beside one another.
const LARGE: usize = 4096;
/// A ball that is within this of what the chosen atoms span is always looked into: what is left of its atoms there is
/// little, and rounding tells in it.
pub const NEAR: f32 = 0.03;
/// Beyond this rounding hardly tells.
pub const FAR: f32 = 0.15;

/// One number of each atom of a leaf, or of each of eight leaves.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct Lanes(pub [f32; LEAF]);

impl Lanes {
    pub const ZERO: Lanes = Lanes([0.0; LEAF]);
}

/// Eight atoms.
#[derive(Clone)]
pub struct Leaf {
    pub heads: [[Lanes; PART]; PARTS],
    /// The lengths of what is beyond each of [`LEVELS`].
    pub tails: [Lanes; LEVELS.len()],
    pub atoms: [u32; LEAF],
}

impl Leaf {
    /// The heads as far as the first of [`LEVELS`].
    pub fn first_parts(&self) -> &[[Lanes; PART]] {
        &self.heads[..LEVELS[0]]
    }
}

/// Eight balls, each about the atoms of a leaf or of several.
#[derive(Clone)]
pub struct Balls {
    pub heads: [[Lanes; PART]; CENTRE_PARTS],
    /// |m|²; infinite where there is no leaf.
    pub norms: Lanes,
    /// All atoms of the leaf are within this of m.
    pub radii: Lanes,
    /// (radius + [`NEAR`])².
    pub near: Lanes,
    /// (radius + [`FAR`])².
    pub far: Lanes,
}

/// All atoms of a dictionary.
pub struct BallTree {
    pub basis: PcaProjection,
    pub leaves: Vec<Leaf>,
    /// Of each leaf D rows: its atoms as they are.
    pub whole: Vec<Lanes>,
    /// Of each leaf a ball; then of each eight balls of the layer before one, up to the top.
    pub layers: Vec<Vec<Balls>>,
    /// Of each atom, in which leaf it is.
    places: Vec<u32>,
    pub tally: PruningStats,
}

impl BallTree {
    /// Of atoms (n, D) of unit norm.
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

    /// How many numbers an atom has, D.
    pub fn width(&self) -> usize {
        self.whole.len() / self.leaves.len().max(1)
    }

    /// Rows of lanes that a scan multiplies a step.
    pub fn scan(&self) -> usize {
        self.whole.len()
    }

    /// The balls that are all looked at.
    pub fn top(&self) -> &[Balls] {
        self.layers.last().map_or(&[], |layer| layer)
    }

    /// In which leaf an atom is; neighbouring leaves have neighbouring numbers.
    pub fn place(&self, atom: u32) -> u32 {
        self.places[atom as usize]
    }
}

/// Atoms in an order in which neighbours are near.
pub fn in_order(heads: &[Projected]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..heads.len() as u32).collect();
    split(&mut order, heads);
    order
}

/// Orders atoms so that each eight are neighbours: halves by where they are along their widest direction, and so on.
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

/// The direction in which heads differ most, nearly: a few steps of the power method.
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

/// The atoms of a leaf as they are, a row of lanes a coordinate.
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

/// The ball of a leaf about the mean of its heads: what is beyond them counts for its radius.
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
