//! A sieve: all atoms, each told by the first few numbers of its head in sixteen bits, laid out in panels.
//!
//! Poses fill few dimensions, so the first few of the products that a scan sums tell of nearly all atoms that they are not the
//! best; see [`super::filter_refine`].

use super::ball_tree::{LEAF, in_order};
use super::cost_model::PruningStats;
use super::int16_quantization::{self, PAIRS, PairRow};
use super::packed_atoms::{Row, WIDTH};
use super::pca_projection::{LEVELS, PART, PcaProjection, Projected};
use crate::numeric::parallel;
use ndarray::ArrayView2;

/// Numbers of a head that all atoms are told by.
pub const SHORT: usize = LEVELS[LEVEL] * PART;
const LEVEL: usize = 1;
/// What becomes of the products of an atom costs as much as so many more, measured.
const BESIDE: usize = 14;

/// The first [`SHORT`] numbers of a head, and the length of what is beyond them, at most.
pub fn short(head: &Projected) -> (&[f32], f32) {
    head.short(LEVEL)
}

/// All atoms of a dictionary, in an order in which neighbours are near: each has a place.
pub struct QuantizedTable {
    pub basis: PcaProjection,
    /// The atom at each place, and each atom's place.
    pub atoms: Vec<u32>,
    places: Vec<u32>,
    /// Of each panel [`PAIRS`] rows: the first [`SHORT`] numbers of its atoms' heads.
    pub rows: Vec<PairRow>,
    /// Of each panel the lengths of what is beyond those.
    pub tails: Vec<Row>,
    pub tally: PruningStats,
}

impl QuantizedTable {
    /// Of atoms (n, D) of unit norm.
    pub fn new(atoms: ArrayView2<'_, f32>) -> QuantizedTable {
        let basis = PcaProjection::of(atoms);
        let n = atoms.nrows();
        let heads = basis.heads(atoms);
        let order = in_order(&heads);
        let panels = parallel::map_chunks(n, WIDTH, |places| {
            let (mut rows, mut tails) = ([PairRow::ZERO; PAIRS], Row::ZERO);
            for (lane, atom) in order[places].iter().enumerate() {
                let (numbers, beyond) = short(&heads[*atom as usize]);
                let pairs = int16_quantization::of_atom(numbers);
                (rows.iter_mut().zip(pairs)).for_each(|(row, pair)| row.0[lane] = pair);
                tails.0[lane] = beyond;
            }
            (rows, tails)
        });
        let mut places = vec![0; n];
        (0..)
            .zip(&order)
            .for_each(|(place, atom)| places[*atom as usize] = place);
        QuantizedTable {
            basis,
            atoms: order,
            places,
            rows: panels.iter().flat_map(|(rows, _)| *rows).collect(),
            tails: panels.iter().map(|(_, tails)| *tails).collect(),
            tally: PruningStats::new(1.0),
        }
    }

    /// Rows of lanes that a search multiplies a step, nearly.
    pub fn spent(&self) -> usize {
        self.atoms.len().div_ceil(LEAF) * (PAIRS + BESIDE)
    }

    /// Rows of lanes that a scan of atoms of `d` numbers multiplies a step.
    pub fn scan(&self, d: usize) -> usize {
        self.atoms.len().div_ceil(LEAF) * d
    }

    /// Where an atom is.
    pub fn place(&self, atom: u32) -> usize {
        self.places[atom as usize] as usize
    }
}
