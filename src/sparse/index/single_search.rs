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

/// BallTree that are looked into before it is known which are worth it.
const START_LEAVES: usize = 2;
/// A key counts for so much less that rounding a product with it makes it no larger.
pub const BELOW: f32 = 1.0 - 4e-6;
/// So many leaves may hold the best, at most, and this share of all; then a scan costs less.
const LEAST_KEPT: usize = 8;
const SHARE_KEPT: usize = 4;

/// A leaf that may hold the best atom.
#[derive(Clone, Copy)]
pub struct Kept {
    pub leaf: u32,
    /// No atom of it has a larger key.
    pub most: f32,
}

/// What was multiplied in a search.
#[derive(Default)]
pub struct Spent {
    pub balls: usize,
    pub leaves: usize,
}

/// The search of a pose with N directions, its residual's the first; V vectors hold a leaf's lanes.
pub struct Sweep<'s, S, const N: usize, const V: usize> {
    pub simd: S,
    pub leaves: &'s BallTree,
    pub sought: Query<'s>,
    /// Of the residual and the directions.
    pub heads: &'s [Projected; N],
    pub noise: RoundingError,
    /// What is left of an atom counts.
    pub optimised: bool,
    /// The best atom's key is as large, at least.
    pub key: f32,
    /// Which leaf tells so.
    pub leader: Option<usize>,
    /// What balls have to reach for that.
    pub bar: Bar,
    pub kept: Vec<Kept>,
    /// Too many leaves may hold the best.
    pub is_given_up: bool,
    pub spent: Spent,
}

impl<'s, S: Simd, const N: usize, const V: usize> Sweep<'s, S, N, V> {
    /// `kept` is room.
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

    /// Looks into leaves that are likely good: one that is for another pose, and those whose centres are.
    #[inline(always)]
    pub fn start(&mut self, top: &[Measured<S, V>], other: Option<usize>) {
        let likely = self.likely(top);
        for leaf in other.into_iter().chain(likely.into_iter().flatten()) {
            let parts = self.leaf(leaf).first_parts();
            let sums = micro_gemm::products(self.simd, parts, &[self.heads; AT_ONCE], 1);
            self.judge(leaf, &sums[0]);
        }
    }

    /// The leaves with the best centres, nearly, the best first: from the `top` down those within the best.
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

    /// Rows that were multiplied, nearly.
    pub fn spent(&self) -> usize {
        let balls = self.spent.balls * CENTRE_PARTS * PART;
        let leaves = self.spent.leaves * LEVELS[0] * PART;
        (balls + leaves + self.kept.len() * self.sought.path.width()) * N
    }

    /// Keeps a leaf unless the products of its atoms' heads rule all of them out.
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
            // It is likely the best so far: what its key is tells which others are worth a look.
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
        // Those that were likely good are met again on the way.
        let first = &self.kept[..self.kept.len().min(1 + START_LEAVES)];
        if !self.is_given_up && first.iter().all(|k| k.leaf != kept.leaf) {
            self.kept.push(kept);
        }
    }
}
