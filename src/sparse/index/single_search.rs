//! The search of one pose, step by step; see [`super::branch_and_bound`].

use super::ball_bound::{Bar, Measured};
use super::ball_tree::{BallTree, Leaf};
use super::branch_and_bound::{Query, SearchResult};
use super::exact_score;
use super::leaf_products;
use super::micro_gemm::{self, AT_ONCE, Products};
use super::pca_projection::{CENTRE_PARTS, LEVELS, PART, Projected};
use super::query::RoundingError;
use super::score_bound::NOTHING_BEYOND;
use super::top_balls::Leaders;
use pulp::Simd;

/// The number of leaves visited first, to find a threshold.
const START_LEAVES: usize = 2;
/// Factor that lowers a key by more than rounding can raise a product with it.
pub const BELOW: f32 = 1.0 - 4e-6;
/// The search gives up when more leaves remain than this number plus this share of all: then a dense scan costs less.
const LEAST_KEPT: usize = 8;
const SHARE_KEPT: usize = 4;

/// A leaf that may hold the best atom.
#[derive(Clone, Copy)]
pub struct Kept {
    pub leaf: u32,
    /// Upper bound of the scores of its atoms.
    pub most: f32,
}

/// The number of balls and leaves visited.
#[derive(Default)]
pub struct Spent {
    pub balls: usize,
    pub leaves: usize,
}

/// The search of a pose with N vectors: its residual, then the chosen directions. V SIMD vectors hold a leaf's lanes. A key
/// is a score, c² / e.
pub struct Sweep<'s, S, const N: usize, const V: usize> {
    pub simd: S,
    pub leaves: &'s BallTree,
    pub sought: Query<'s>,
    /// PCA coordinates of the residual and of the directions.
    pub heads: &'s [Projected; N],
    pub noise: RoundingError,
    /// Whether e counts (OOMP, after the first atom).
    pub optimised: bool,
    /// Lower bound of the best score.
    pub key: f32,
    /// The leaf that gave it.
    pub leader: Option<usize>,
    /// The ball test for this key.
    pub bar: Bar,
    pub kept: Vec<Kept>,
    /// Whether too many leaves remained.
    pub is_given_up: bool,
    pub spent: Spent,
}

impl<'s, S: Simd, const N: usize, const V: usize> Sweep<'s, S, N, V> {
    /// Starts a search; `kept` is scratch memory.
    #[inline(always)]
    pub fn new(simd: S, leaves: &'s BallTree, sought: Query<'s>, mut kept: Vec<Kept>) -> Self {
        kept.clear();
        let heads = sought
            .path
            .heads
            .first_chunk()
            .expect("a path has as many heads as the search has directions");
        let mut sweep = Sweep {
            simd,
            leaves,
            sought,
            heads,
            noise: sought.path.noise(),
            optimised: sought.is_optimised(),
            key: 0.0,
            leader: None,
            bar: Bar::default(),
            kept,
            is_given_up: false,
            spent: Spent::default(),
        };
        sweep.raise(0.0);
        sweep
    }

    /// Visits promising leaves: the best one of another pose, and those with the best centers.
    #[inline(always)]
    pub fn start(&mut self, top: &[Measured<S, V>], other: Option<usize>) {
        let likely = self.likely(top);
        for leaf in other.into_iter().chain(likely.into_iter().flatten()) {
            let parts = self.leaf(leaf).first_parts();
            let sums = micro_gemm::products(self.simd, parts, &[self.heads; AT_ONCE], 1);
            self.judge(leaf, &sums[0]);
        }
    }

    /// A greedy descent from the top layer: leaves with nearly the best centers, the best first.
    #[inline(always)]
    pub fn likely(&mut self, top: &[Measured<S, V>]) -> [Option<usize>; START_LEAVES] {
        let mut leaders = Leaders::NONE;
        for (group, measured) in top.iter().enumerate() {
            leaders.meet(&self.score(measured), group);
        }
        for layer in self.leaves.layers.iter().rev().skip(1) {
            let groups = leaders.balls();
            leaders = Leaders::NONE;
            for group in groups {
                let Some(balls) = layer.get(group as usize) else {
                    continue;
                };
                let sums = micro_gemm::products(self.simd, &balls.heads, &[self.heads; AT_ONCE], 1);
                let measured = self.measured(balls, &sums[0]);
                leaders.meet(&self.score(&measured), group as usize);
            }
        }
        leaders.best(self.leaves.leaves.len())
    }

    /// A leaf of the dictionary.
    #[inline(always)]
    pub fn leaf(&self, leaf: usize) -> &'s Leaf {
        &self.leaves.leaves[leaf]
    }

    /// What is found, once the leaves that were kept gave `best`.
    #[inline(always)]
    pub fn found(&self, best: Option<u32>) -> SearchResult {
        match best {
            _ if self.is_given_up => SearchResult::Unpruned,
            Some(atom) => SearchResult::Atom(atom),
            None => SearchResult::Nothing,
        }
    }

    /// The approximate number of rows multiplied.
    pub fn spent(&self) -> usize {
        let balls = self.spent.balls * CENTRE_PARTS * PART;
        let leaves = self.spent.leaves * LEVELS[0] * PART;
        (balls + leaves + self.kept.len() * self.sought.path.width()) * N
    }

    /// Keeps a leaf unless the bounds of its atoms exclude all of them.
    #[inline(always)]
    pub fn judge(&mut self, leaf: usize, sums: &Products<S, N, V>) {
        self.spent.leaves += 1;
        let is_known = self.is_given_up || self.leader == Some(leaf);
        if is_known || !self.may_be_best(self.leaf(leaf), sums) {
            return;
        }
        let mut sums = *sums;
        let more =
            micro_gemm::more::<S, N, V>(self.simd, &self.leaf(leaf).heads, self.heads, LEVELS[0]);
        for n in 0..N {
            for v in 0..V {
                sums[n][v] = self.simd.add_f32s(sums[n][v], more[n][v]);
            }
        }
        let mut keys = self.keys(leaf, &sums, LEVELS.len() - 1);
        if keys.nearly > self.key {
            // The leaf likely holds the best atom so far: full coordinates give the tightest threshold.
            keys = self.keys(leaf, &leaf_products::products(self, leaf), NOTHING_BEYOND);
            if keys.nearly > self.key && keys.least <= self.key {
                // Rounding hides by how much: what a scan finds does not.
                keys.least = exact_score::key(self, leaf);
            }
        }
        if keys.least > self.key {
            self.leader = Some(leaf);
            self.raise(keys.least);
        }
        if keys.most >= self.key {
            self.keep(Kept {
                leaf: leaf as u32,
                most: keys.most,
            });
        }
    }

    #[inline(always)]
    fn keep(&mut self, kept: Kept) {
        let most = self.leaves.leaves.len() / SHARE_KEPT + LEAST_KEPT;
        if self.kept.len() == most {
            let key = self.key;
            self.kept.retain(|k| k.most >= key);
            self.is_given_up = self.kept.len() == most;
        }
        // The leaves of the start are visited again during the descent.
        let first = &self.kept[..self.kept.len().min(1 + START_LEAVES)];
        if !self.is_given_up && first.iter().all(|k| k.leaf != kept.leaf) {
            self.kept.push(kept);
        }
    }
}
